"""Laws as C and as python-control state space: the same law as the one that was simulated."""

import ctypes
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace

import control
import numpy as np
import pytest

from controllers import (
    LQG,
    LQR,
    PI,
    ActiveDamping,
    HInfinity,
    IdealSlidingMode,
    ImpedanceSuperTwisting,
    ImplicitSlidingMode,
    Lifting,
    LinearMPC,
    SlidingMode,
    SoftTorque,
    StiffPI,
    SuperTwisting,
    ZTorque,
)
from controllers.linear_mpc_c import export
from controllers.observers import Kalman
from controllers.string_model import drilling_point
from models import BitRock, wells
from tests.plants import RIG
from toolbox import ClosedLoop, Controller, Sampled, SceneError, closed_loop, compose, export_c, linearise, simulate, to_control
from toolbox.modelling import ObserverBasedController, Takeover

LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}
PERIOD = 0.01
COMPILER = shutil.which("cc")
compiled = pytest.mark.skipif(COMPILER is None or sys.platform != "linux", reason="the C of a law is compiled with `cc`, which is not here")


class CompiledLaw:
    """An exported law, compiled to a shared library, as a callable (t, y) -> u with its own memory."""

    def __init__(self, c, memory, actuated_signals, sources=(), flags=()):
        library = c.with_suffix(".so")
        warnings = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-std=c99", *flags]
        subprocess.run(
            [COMPILER, *warnings, "-O1", "-ffp-contract=off", "-shared", "-fPIC", str(c), *sources, "-lm", "-o", str(library)], check=True
        )
        functions = ctypes.CDLL(str(library))
        self.step, start = getattr(functions, f"{c.stem}_step"), getattr(functions, f"{c.stem}_start")
        self.memory, self.u = np.full(memory + 1, np.pi), np.zeros(actuated_signals)
        start(self.memory.ctypes.data_as(ctypes.c_void_p))

    def __call__(self, t, y):
        y = np.ascontiguousarray(y, float)
        failed = self.step(*(array.ctypes.data_as(ctypes.c_void_p) for array in (y, self.memory, self.u)))
        assert failed == 0 and self.memory[-1] == np.pi, "the step failed, or wrote behind its memory"
        return self.u.copy()


def header(path):
    """What a header says: {macro: number}, and the names behind y, u and memory."""
    text = path.read_text()
    defined = [line.split() for line in text.splitlines() if line.startswith("#define")]
    macros = {words[1]: float(words[2]) for words in defined if len(words) == 3}
    rows = {"y": [], "u": [], "memory": [], "gains": []}
    for line in text.splitlines():
        words = line.split()
        if len(words) > 2 and words[0] == "*" and "[" in words[1]:
            rows[words[1].partition("[")[0]].append(words[2])
    return macros, rows


LAWS = {
    "PI": PI(reference=8.0),
    "StiffPI, limits": StiffPI(reference=8.0, torque_rate=30_000.0, **LIMITS),
    "SoftTorque": SoftTorque(reference=8.0, **LIMITS),
    "ZTorque": ZTorque(reference=8.0, **LIMITS),
    "ActiveDamping": ActiveDamping(reference=8.0),
    "SlidingMode": SlidingMode(reference=8.0, **LIMITS),
    # what it learns is an integral of an integral, which takes up the round-off of a run that is played back
    "ImplicitSlidingMode": ImplicitSlidingMode(reference=8.0, adaptation_gain=0.0),
    "SuperTwisting": SuperTwisting(reference=8.0, **LIMITS),
    "ImpedanceSuperTwisting": ImpedanceSuperTwisting(reference=8.0),
    "LQR": LQR(reference=8.0),
    "LQG": LQG(reference=8.0, delay_samples=2, **LIMITS),
    "HInfinity": HInfinity(reference=8.0),
    "ObserverBasedController": ObserverBasedController(SlidingMode(reference=8.0, **LIMITS), Kalman()),
    "Lifting": Lifting(PI(reference=8.0, **LIMITS)),
    "Lifting with relief": Lifting(PI(reference=8.0, **LIMITS), weight_relief=0.4, speed_limit_factor=1.2),
}


@compiled
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_c_of_a_law_answers_a_closed_loop_run_like_the_law_in_the_loop(tmp_path, law):
    c, h = export_c(closed_loop(RIG, law, sample_time=PERIOD), tmp_path / "drive")
    macros, rows = header(h)
    grid = PERIOD * np.arange(3001)
    times = (0.0, 15.0, 16.0, 30.0)
    run = simulate(
        RIG, 30.0, controller=law, sample_time=PERIOD, output_times=grid, inputs={"top.reference": (times, (8.0, 8.0, 5.0, 5.0))}
    )
    assert set(rows["u"]) >= set(law.actuated_signals) and set(rows["y"]) >= {"top.speed"}
    exported = CompiledLaw(c, len(rows["memory"]), len(rows["u"]))
    y = np.column_stack([value_of(run, name) for name in rows["y"]])
    answers = np.array([exported(t, values) for t, values in zip(grid, y, strict=True)])[:-1]
    for answer, name in zip(answers.T, rows["u"], strict=True):
        held = run[name][:-1]  # the run ends before the sample at its end
        assert np.ptp(held) > {"top.torque": 1000.0, "bit.weight": 1e4, "lifting.reference": 1.0}[name]  # the run asks something of the law
        assert np.abs(answer - held).max() <= 1e-12 * np.abs(held).max()
    assert macros["DRIVE_READS"] == len(rows["y"]) and macros["DRIVE_MEMORY"] == len(rows["memory"]) and macros["DRIVE_PERIOD"] == PERIOD


@compiled
def test_the_c_of_a_law_closes_the_loop_and_frees_the_bit_that_a_constant_torque_leaves_in_stick_slip(tmp_path):
    plant = compose(wells.NAVARRO_LOPEZ_4, BitRock(weight=97_347.0))
    law = SoftTorque(reference=4.7)
    c, h = export_c(closed_loop(plant, law, sample_time=PERIOD), tmp_path / "soft.h")
    _, rows = header(h)
    exported = CompiledLaw(c, len(rows["memory"]), 1)

    def drive(t, y):
        return float(exported(t, [y[0], 0.0, 4.7])[0])

    constant = simulate(plant, 80.0, inputs={"top.torque": 10_000.0})
    assert constant.time_in("bit", "stick", after=50.0) > 5.0
    run = simulate(plant, 80.0, controller=drive, sample_time=PERIOD)
    assert run.time_in("bit", "stick", after=50.0) == 0.0
    inside = simulate(plant, 80.0, controller=law, sample_time=PERIOD)
    assert abs(run.at(80.0)["bit.speed"] - inside.at(80.0)["bit.speed"]) < 1e-9


@compiled
def test_gains_may_be_others_than_those_of_the_law(tmp_path):
    made = {}
    for name, law in (
        ("one", PI(reference=8.0, proportional=3.0, integral=2.0)),
        ("two", PI(reference=8.0, proportional=5.0, integral=7.0)),
    ):
        c, h = export_c(closed_loop(RIG, law, sample_time=PERIOD), tmp_path / name)
        made[name] = CompiledLaw(c, len(header(h)[1]["memory"]), 1), header(h)[1]["gains"], c
    one, gains, c = made["one"]
    assert gains == ["law.proportional", "law.integral"]
    functions = ctypes.CDLL(str(c.with_suffix(".so")))
    numbers = np.zeros(2)
    functions.one_gains(numbers.ctypes.data_as(ctypes.c_void_p))
    assert numbers.tolist() == [3.0, 2.0]
    numbers[:] = 5.0, 7.0
    for speed in (0.0, 3.0, 9.0):
        y = np.array([speed, 0.0, 8.0][: len(header(c.with_suffix(".h"))[1]["y"])])
        y[-1] = 8.0
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (numbers, y, one.memory, one.u)]
        assert functions.one_step_with(*pointers) == 0
        assert one.u[0] == made["two"][0](0.0, y)[0]


@compiled
def test_two_exported_laws_link_into_one_program(tmp_path):
    for name, law in (("first", PI(**LIMITS)), ("second", HInfinity(**LIMITS))):
        export_c(closed_loop(RIG, law, sample_time=PERIOD), tmp_path / f"{name}.c")
    (tmp_path / "main.c").write_text(
        '#include "first.h"\n#include "second.h"\n'
        "int main(void) { double y[2] = {0, 8}, u[1], a[FIRST_MEMORY], b[SECOND_MEMORY];\n"
        "first_start(a); second_start(b); return first_step(y, a, u) || second_step(y, b, u) || !(u[0] > 0); }\n"
    )
    program = tmp_path / "program"
    subprocess.run([COMPILER, "main.c", "first.c", "second.c", "-lm", "-o", str(program)], cwd=tmp_path, check=True)
    assert subprocess.run([str(program)]).returncode == 0


# --- predictive law

WEIGHT = 97_347.0
HEAVY = compose(wells.JANSEN_2, BitRock(weight=WEIGHT))
PREDICTIVE = LinearMPC(reference=8.0, torque_rate=20_000.0, highest_speed=14.0, **LIMITS)


OBJECTS = {}
"""{text of a file of the solver: its machine code}."""


def solver_objects(sources, flags, folder):
    """Machine code of the solver, which is the same for most laws, so that each file is compiled once."""
    for path in sources:
        if path.read_bytes() not in OBJECTS:
            made = OBJECTS[path.read_bytes()] = folder / f"{path.stem}.o"
            subprocess.run([COMPILER, *flags, "-O1", "-ffp-contract=off", "-fPIC", "-c", str(path), "-o", str(made)], check=True)
    return [str(OBJECTS[path.read_bytes()]) for path in sources]


def compiled_program(tmp_path, law, iterations=20_000):
    """A predictive law and its solver as a shared library: (callable, number of entries of its memory)."""
    planned = law.design(HEAVY)
    c, h = tmp_path / "mpc.c", tmp_path / "mpc.h"
    export(planned, c, h, law.period, iterations=iterations)
    solver = tmp_path / "mpc_osqp"
    sources = [*solver.glob("*.c"), *(solver / "src").glob("*.c")]
    folders = [f"-I{folder}" for folder in (solver, solver / "inc" / "public", solver / "inc" / "private")]
    _, rows = header(h)
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", *(folder.replace("-I", "-isystem") for folder in folders)]
    subprocess.run([COMPILER, *strict, "-c", str(c), "-o", str(tmp_path / "strict.o")], check=True)  # the solver's own code is not ours
    return CompiledLaw(c, len(rows["memory"]), 1, solver_objects(sources, (*folders, "-w"), tmp_path), (*folders, "-w")), rows


@compiled
@pytest.mark.parametrize(("delay", "waiting"), [(0.0, 1), (0.25, 3)])
def test_the_c_of_the_linear_mpc_plans_each_sample_like_the_law_in_python_with_warm_start(tmp_path, delay, waiting):
    law = replace(PREDICTIVE, highest_torque=18_000.0, delay=delay)
    exported, rows = compiled_program(tmp_path, law)
    assert rows["y"] == ["top.speed", "top.torque.held", "top.reference"] and len(rows["memory"]) == 15 + waiting
    run = simulate(HEAVY, 40.0, controller=Sampled(law, 0.1, delay=delay), output_times=0.1 * np.arange(401))
    planned = law.design(HEAVY)
    torques, wanted = [], []
    for k, speed in enumerate(run["top.speed"][:-1]):
        # the loop, not the law alone, forgets what was: each sample starts from the memory of the law in Python
        exported.memory[: 4 + waiting] = (*planned.filter.z, *planned.filter.waiting)
        torques.append(float(exported(0.1 * k, [speed, 0.0, 8.0])[0]))
        wanted.append(planned(0.1 * k, [speed]))
        assert np.allclose(exported.memory[: 4 + waiting], (*planned.filter.z, *planned.filter.waiting), rtol=1e-6, atol=1e-4)
        assert exported.memory[14 + waiting] == 0.0  # the plan passed its check
    assert not planned.record.fallbacks
    assert max(wanted) == pytest.approx(18_000.0, rel=1e-12) and np.abs(np.diff(wanted)).max() == pytest.approx(
        2000.0
    )  # limits of torque and rate bind
    assert np.abs(np.subtract(torques, wanted)).max() < 1e-6 * 20_000.0


@compiled
def test_the_c_of_the_linear_mpc_closes_the_loop_where_a_stiff_drive_sticks(tmp_path):
    exported, _ = compiled_program(tmp_path, PREDICTIVE)
    stiff = simulate(HEAVY, 60.0, controller=StiffPI(reference=8.0, **LIMITS), sample_time=0.01)
    assert stiff.time_in("bit", "stick", after=40.0) > 1.0
    run = simulate(HEAVY, 60.0, controller=lambda t, y: float(exported(t, [y[0], 0.0, 8.0])[0]), sample_time=0.1)
    inside = simulate(HEAVY, 60.0, controller=PREDICTIVE, sample_time=0.1)
    assert run.time_in("bit", "stick", after=40.0) == inside.time_in("bit", "stick", after=40.0) == 0.0
    grid = np.linspace(0.0, 60.0, 601)
    assert np.abs(run.at(grid)["bit.speed"] - inside.at(grid)["bit.speed"]).max() < 1e-3


@compiled
def test_where_the_solver_has_no_answer_the_soft_drive_acts_as_in_python(tmp_path, monkeypatch):
    exported, _ = compiled_program(tmp_path, PREDICTIVE, iterations=1)
    planned = PREDICTIVE.design(HEAVY)
    monkeypatch.setattr(planned, "plan", lambda z: (None, "no answer"))
    rng = np.random.default_rng(1)
    fallen = 0
    for k, speed in enumerate(rng.uniform(0.0, 12.0, 60)):
        torque = float(exported(0.1 * k, [speed, 0.0, 8.0])[0])
        assert exported.memory[15] == 1.0
        assert torque == pytest.approx(planned(0.1 * k, [speed]), rel=1e-9, abs=1e-6)
        fallen += 1
    assert fallen == len(planned.record.fallbacks) == 60


@compiled
@pytest.mark.parametrize("delay", [0.0, 0.25])
def test_the_c_of_the_linear_mpc_takes_over_from_a_torque_that_acts_as_in_python(tmp_path, delay):
    law = replace(PREDICTIVE, delay=delay)
    exported, _ = compiled_program(tmp_path, law)
    planned = law.design(HEAVY)
    _, x, torque, _ = drilling_point(HEAVY, 8.0)
    for k in range(5):
        found = float(exported(0.1 * k, [8.0, torque, 8.0])[0])
        assert found == pytest.approx(planned(0.1 * k, [8.0, torque, 8.0]), rel=1e-6)
        assert found == pytest.approx(torque, rel=1e-3)
    assert planned.filter.z[:-1] == pytest.approx(x, rel=1e-3)


def test_the_predictive_law_is_exported_at_its_own_period_and_hides_no_folder(tmp_path):
    with pytest.raises(SceneError, match="`sample_time` must be 0.1 s"):
        export_c(closed_loop(HEAVY, PREDICTIVE, sample_time=0.01), tmp_path / "mpc")
    (tmp_path / "mpc_osqp").mkdir()
    (tmp_path / "mpc_osqp" / "mine.txt").write_text("keep")
    with pytest.raises(SceneError, match="not from an earlier export"):
        export_c(closed_loop(HEAVY, PREDICTIVE, sample_time=0.1), tmp_path / "mpc")
    assert (tmp_path / "mpc_osqp" / "mine.txt").read_text() == "keep"
    shutil.rmtree(tmp_path / "mpc_osqp")
    for _ in range(2):
        c, _ = export_c(closed_loop(HEAVY, PREDICTIVE, sample_time=0.1), tmp_path / "mpc")
    assert c.exists() and not list((tmp_path / "mpc_osqp").glob("*.py"))
    assert "top.torque.held [N m]  0.0 before the first call" in c.with_suffix(".h").read_text()


def test_the_header_names_signals_units_defaults_period_and_memory(tmp_path):
    c, h = export_c(closed_loop(RIG, ZTorque(reference=7.25), sample_time=0.02), tmp_path / "z_torque")
    text = h.read_text()
    for line in ("y[0]  top.speed [rad/s]", "y[1]  top.torque.held [N m]",
                 "y[2]  top.reference [rad/s]  set-point, 7.25", "u[0]  top.torque [N m]", "memory[0]  ztorque.speed [rad/s]",
                 "#define Z_TORQUE_PERIOD 0.02", "int z_torque_step(const double *y, double *memory, double *u);", "every 0.02 s"):  # fmt: skip
        assert line in text
    assert "malloc" not in c.read_text() and '#include "z_torque.h"' in c.read_text()


@dataclass(frozen=True)
class InPython(Controller):
    """A law that no casadi expression holds."""

    measured_signals, actuated_signals = ("top.speed",), ("top.torque",)

    def design(self, plant):
        return lambda t, y: 0.0


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (IdealSlidingMode(), "no sampled form"),
        (InPython(), "Python callable"),
        (lambda t, y: 0.0, "must hold a Controller to be written down"),
        (Sampled(PI(), 0.02), "`sample_time` must be left out where every controller is Sampled"),
        (Takeover(PI(), StiffPI(), 3.0), "time itself"),
        (PI(proportional=-1.0), "proportional"),
    ],
)
def test_laws_that_have_no_c_say_why(tmp_path, law, words):
    with pytest.raises(SceneError, match=words):
        export_c(closed_loop(RIG, law, sample_time=PERIOD), tmp_path / "law")
    assert not list(tmp_path.iterdir())


def test_bad_periods_names_and_places_are_refused(tmp_path):
    with pytest.raises(SceneError, match="`sample_time`|period"):
        export_c(closed_loop(RIG, PI(), sample_time=0.0), tmp_path / "law")
    with pytest.raises(SceneError, match=r"write `export_c\(closed_loop"):
        export_c(PI(), 3, PERIOD, tmp_path / "law")
    for name in ("my law", "2nd", "law.cpp"):
        with pytest.raises(SceneError, match="`path`"):
            export_c(closed_loop(RIG, PI(), sample_time=PERIOD), tmp_path / name)
    with pytest.raises(SceneError, match="Cannot write"):
        export_c(closed_loop(RIG, PI(), sample_time=PERIOD), tmp_path / "nowhere" / "law")


# --- python-control

SIGNALS = ("top.speed", "bit.speed", "top.reference", "chain.twist.0", "chain.speed.0", "chain.speed.1")
LINEAR = {
    "PI": PI(reference=8.0),
    "StiffPI": StiffPI(reference=8.0),
    "SoftTorque": SoftTorque(reference=8.0),
    "ZTorque": ZTorque(reference=8.0),
    "ActiveDamping": ActiveDamping(reference=8.0),
    "LQR": LQR(reference=8.0),
    "LQG": LQG(reference=8.0),
    "HInfinity": HInfinity(reference=8.0),
}


@pytest.mark.parametrize("law", LINEAR.values(), ids=LINEAR)
def test_poles_of_the_loop_closed_by_python_control_are_those_of_the_linearised_closed_loop(law):
    closed = compose(wells.JANSEN_2, BitRock(), law)
    end = simulate(RIG, 400.0, controller=law).at(400.0)
    assert end.modes["bit"] == "slip+"
    whole = linearise(closed, at=end, mode={"bit": "slip+"}).poles()
    by_itself = to_control(closed_loop(RIG, law))
    point = {name: end[name] for name in RIG.states}
    string = linearise(
        RIG, at=point, mode={"bit": "slip+"}, inputs="top.torque", outputs=["top.speed", "bit.speed", "chain.twist", "chain.speed"]
    )
    measured = [label for label in by_itself.input_labels if label in string.output_labels]  # without the set-point
    assert len(measured) >= len(by_itself.input_labels) - 1
    rows, columns = [string.output_labels.index(label) for label in measured], [by_itself.input_labels.index(label) for label in measured]
    string = control.ss(string.A, string.B, string.C[rows], string.D[rows])
    feedback = control.ss(by_itself.A, by_itself.B[:, columns], by_itself.C, by_itself.D[:, columns])
    joined = control.feedback(string, feedback, sign=1).poles()
    assert joined.size == whole.size
    assert max(np.abs(joined - pole).min() for pole in whole) < 1e-6 * np.abs(whole).max()
    assert max(np.abs(string.poles() - pole).min() for pole in whole) > 0.01  # the law moves the poles


@pytest.mark.parametrize("law", LINEAR.values(), ids=LINEAR)
def test_a_sampled_law_in_python_control_answers_like_the_law_in_the_loop(law):
    grid = PERIOD * np.arange(2001)
    found = to_control(closed_loop(RIG, law, sample_time=PERIOD))
    assert found.dt == PERIOD and found.output_labels == ["top_torque"]
    # what is constant in a law, such as the torque at its working point, falls out of the difference of two runs
    (y, torque), (other, other_torque) = (asked_and_given(law, found, grid, weight) for weight in (80e3, 100e3))
    _, answer = control.forced_response(found, grid, y - other)
    change = (torque - other_torque)[:-1]  # the runs end before the sample at their end
    assert np.abs(np.ravel(answer)[:-1] - change).max() < 1e-9 * np.abs(torque).max()
    assert np.ptp(change) > 100.0


def asked_and_given(law, found, grid, weight):
    run = simulate(RIG, grid[-1], controller=law, sample_time=PERIOD, output_times=grid, inputs={"bit.weight": weight})
    dotted = {re.sub(r"\.(\d+)$", r"[\1]", name).replace(".", "_"): name for name in SIGNALS}
    return np.array([value_of(run, dotted[label]) for label in found.input_labels]), run["top.torque"]


def value_of(run, name):
    if name.endswith(".held"):  # until the sample, at which `run` shows what is held from it on
        return np.append(0.0, run[name.removesuffix(".held")][:-1])
    head, _, tail = name.rpartition(".")
    return run[head][:, int(tail)] if tail.isdigit() else run[name]


def test_a_kalman_filter_gives_its_linear_estimates_and_converges_where_a_gain_of_zero_does_not():
    found = to_control(Kalman().design(RIG))
    assert found.input_labels == ["top_speed", "top_torque"]
    assert "bit_speed" in found.output_labels and "bit_torque" in found.output_labels
    assert "bit_friction_scale" not in found.output_labels  # a quotient of estimates
    assert found.poles().real.max() < 0
    blind = to_control(Kalman().design(RIG), outputs="bit.torque")
    assert blind.output_labels == ["bit_torque"]
    with pytest.raises(SceneError, match=r"bit\.friction_scale"):
        to_control(Kalman().design(RIG), outputs="bit.friction_scale")


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (SoftTorque(**LIMITS), "torque limits"),
        (SlidingMode(), "linear"),
        (SlidingMode(highest_torque=1e4), "linear"),
        (IdealSlidingMode(), "idealslidingmode"),
        (closed_loop(RIG, InPython(), sample_time=0.1), "Python callable"),
        (SuperTwisting(), "no continuous form"),
        (LQR(), "design"),
    ],
)
def test_laws_that_are_not_linear_are_refused_by_what_is_to_blame(law, words):
    with pytest.raises(SceneError, match=words):
        to_control(law if isinstance(law, (LQR, ClosedLoop)) else closed_loop(RIG, law))


def test_a_law_with_all_its_numbers_needs_no_plant():
    found = to_control(PI(proportional=3.0, integral=2.0))
    assert np.allclose(found(1j).ravel(), np.array([-1.0, 1.0]) * (3.0 + 2.0 / 1j))
    assert isinstance(found, control.StateSpace)
    with pytest.raises(SceneError, match="did you mean `top.torque`"):
        to_control(PI(), outputs="top.torqe")
