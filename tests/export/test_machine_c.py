"""Plants and loops as C: the same switches in the same order as `simulate`, from a loop that nobody wrote a second time."""

import ctypes
import errno
import io
import math
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

import toolbox.stepping.modes as modes_of_the_loop
from controllers import PI, LinearMPC, SoftTorque, StiffPI
from models import BitRock, BlockOnBelt, wells
from models.friction import Hyperbolic
from studies.benchmarks.machines_in_c import COMPILER, DONE, OVERRUN, STRICT, CompiledMachine
from tests.plants import BELT, RIG
from tests.refusals import refusals
from toolbox import Controller, Sampled, Scene, SceneError, Update, closed_loop, compose, export_c, quantity, simulate, state
from toolbox.commands.command_line import main
from toolbox.compilation import work_layout as layout
from toolbox.export.machine_c import EVENTS, MODELS, machine, machine_files
from toolbox.stepping.modes import decide, two_directions

compiled = pytest.mark.skipif(COMPILER is None or sys.platform != "linux", reason="a machine in C is compiled with `cc`, which is not here")
LOOP = closed_loop(RIG, SoftTorque(reference=8.0), sample_time=0.01)


def same_switches(found, run, tolerance):
    assert [event[1:] for event in found] == [tuple(event)[1:] for event in run.events]
    assert np.abs(np.subtract([event[0] for event in found], [event.time for event in run.events])).max(initial=0.0) < tolerance


@compiled
@pytest.mark.parametrize("period", [None, 0.1])
def test_a_rig_with_a_sampled_drive_switches_as_it_does_in_simulate(tmp_path, period):
    loop = closed_loop(RIG, Sampled(StiffPI(reference=4.7), 0.01, delay=0.015))
    run = simulate(loop, 30.0)
    assert len(run.events) > 5
    found = CompiledMachine(export_c(loop, tmp_path / "rig", part="loop", duration=30.0)[0])
    same_switches(found.run(30.0, period), run, 1e-9 if period is None else 1e-5)
    assert found.output("bit.speed") == pytest.approx(run.at(30.0)["bit.speed"], abs=1e-9 if period is None else 1e-4)
    assert found.output("bit.torque") == pytest.approx(run.at(30.0)["bit.torque"], rel=1e-6)


@compiled
def test_an_input_that_the_caller_changes_jumps_as_a_table_does_and_gains_and_parameters_are_numbers(tmp_path):
    plain = compose(wells.NAVARRO_LOPEZ_4, BitRock(weight=97_347.0))
    found = CompiledMachine(export_c(closed_loop(plain, inputs={"top.torque": 9000.0}), tmp_path / "plain", duration=20.0)[0])
    assert found.set("INPUT", "top.torque", float("nan")) != DONE
    assert found.set("PARAMETER", "bit.friction.static", 0.75) == DONE  # before the first step: from the start
    events = found.run(12.0)
    assert found.set("INPUT", "top.torque", 12_000.0) == DONE
    assert found.set("PARAMETER", "bit.friction.static", -0.1) != DONE  # below its bound
    for time in (11.0, float("nan"), float("inf")):  # time does not run backward, nor for ever
        assert found.step(time) not in (DONE, OVERRUN)
    events += found.run(20.0)
    table = ((0.0, 12.0, 12.0, 20.0), (9000.0, 9000.0, 12_000.0, 12_000.0))
    run = simulate(closed_loop(plain, inputs={"top.torque": table}, parameters={"bit.friction.static": 0.75}), 20.0)
    assert "PLAIN_PARAMETER_bit_weight" not in found.macros and "PLAIN_INPUT_bit_weight" in found.macros  # one variable
    same_switches(events, run, 1e-7)
    assert len(events) > 2 and found.output("bit.speed") == pytest.approx(run.at(20.0)["bit.speed"], abs=1e-5)


@compiled
def test_a_copy_of_the_memory_is_a_saved_state_and_nothing_is_allocated_or_global(tmp_path):
    source, _ = export_c(LOOP, tmp_path / "rig", part="loop", duration=20.0)
    found = CompiledMachine(source)
    found.run(5.0)
    saved = bytes(found.memory.raw)
    first = found.run(15.0), found.outputs()
    found.memory.raw = saved
    again = found.run(15.0), found.outputs()
    assert first[0] == again[0] and np.array_equal(first[1], again[1])
    subprocess.run([COMPILER, *STRICT, "-fno-pic", "-c", str(source), "-o", str(tmp_path / "rig.o")], check=True)
    symbols = subprocess.run(["nm", str(tmp_path / "rig.o")], capture_output=True, text=True, check=True).stdout.split("\n")
    kinds = {line.split()[-2] for line in symbols if line}
    assert not kinds & set("BbDdCc"), "something that changes is global"
    needed = {line.split()[-1] for line in symbols if " U " in line}
    assert needed <= {
        "exp",
        "log",
        "cos",
        "sin",
        "floor",
        "pow",
        "sqrt",
        "fmin",
        "fmax",
        "fabs",
        "memcpy",
        "memset",
        "memmove",
        "__stack_chk_fail",
    }
    assert all(line.split()[-1].startswith("rig_") for line in symbols if " T " in line)


@compiled
@pytest.mark.parametrize("name", ["w", "int"])
def test_a_machine_may_have_the_name_of_a_word_of_c(tmp_path, name):
    found = CompiledMachine(export_c(BELT, tmp_path / name, duration=10.0)[0])
    same_switches(found.run(10.0), simulate(BELT, 10.0, method="explicit"), 1e-9)  # the same steps


@compiled
def test_a_call_does_a_bounded_amount_and_the_next_one_goes_on(tmp_path):
    run = simulate(BELT, 2000.0)
    found = CompiledMachine(export_c(BELT, tmp_path / "belt", duration=2000.0)[0])
    assert found.step(2000.0) == OVERRUN
    events = found.events()
    assert 0 < len(events) <= EVENTS + 2 < len(run.events)
    same_switches(events + found.run(2000.0), run, 1e-5)


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_the_example_builds_and_runs(tmp_path, compiler):
    if shutil.which(compiler) is None or sys.platform != "linux":
        pytest.skip(f"it is compiled with `{compiler}`, which is not here")
    source, _ = export_c(compose(BlockOnBelt()), tmp_path / "belt", duration=50.0)
    program = tmp_path / "program"
    subprocess.run([compiler, *STRICT, str(source), str(source.with_name("main.c")), "-lm", "-o", str(program)], check=True)
    lines = subprocess.run([str(program), "50"], capture_output=True, text=True, check=True).stdout.splitlines()
    events = [line for line in lines if not line.startswith("#")]
    assert len(events) == len(simulate(compose(BlockOnBelt()), 50.0).events) > 3


def text_of(loop):
    return machine_files(machine(closed_loop(loop), "belt", 10.0))["belt.c"]


def test_a_change_of_a_friction_law_or_of_the_modes_changes_the_c(monkeypatch):
    class Other(Hyperbolic):
        def sliding(self, speed):
            return 0.5 * super().sliding(speed)

    before = text_of(compose(BlockOnBelt()))
    assert text_of(compose(BlockOnBelt())) == before
    assert text_of(compose(BlockOnBelt(friction=Other()))) != before

    def decided_otherwise(w, t):
        """A rule of modes that the toolbox does not have."""
        for i in range(w.ints[layout.NE]):
            if two_directions(w, i):
                return False
        return decide(w, t) and w.reals[layout.TIME] < 12345.0

    monkeypatch.setattr(modes_of_the_loop, "decide", decided_otherwise)
    assert "12345.0" not in before and "12345.0" in text_of(compose(BlockOnBelt()))


def test_the_c_holds_no_address_of_the_process_that_wrote_it():
    made = machine(LOOP, "rig", 5.0)
    addresses = [int(made.work["ints"][place]) for place in MODELS]
    assert all(address > 2**20 for address in addresses if address) and any(addresses)
    text = machine_files(made)["rig.c"]
    assert not [address for address in addresses if address and str(address) in text]


def test_what_the_translator_does_not_know_is_refused_by_name_and_line(monkeypatch):
    def unknown(w, t):
        return len([mode for mode in w.m if mode]) > 0

    text_of(compose(BlockOnBelt()))  # compiles the event loop of this process
    monkeypatch.setattr(modes_of_the_loop, "decide", unknown)
    with pytest.raises(SceneError, match=r"unknown, line \d+: `.*` is not known"):
        text_of(compose(BlockOnBelt()))


def python_law(t, y):
    return 0.0


python_law.measured_signals, python_law.actuated_signals = "top.speed", "top.torque"


@pytest.mark.parametrize(
    ("loop", "words"),
    [
        (closed_loop(RIG, python_law, sample_time=0.1), "law in Python"),
        (
            closed_loop(RIG, LinearMPC(reference=8.0, lowest_torque=0.0, highest_torque=2e4), sample_time=0.1),
            "solves a program at every sample",
        ),
        (Scene.load("studies/scenes/elastic_slider.toml"), "stiff"),
    ],
    ids=["Python", "LinearMPC", "stiff"],
)
def test_what_cannot_go_is_refused_by_name(tmp_path, loop, words):
    loop = loop[loop.cases[0].label] if isinstance(loop, Scene) else loop
    with pytest.raises(SceneError, match=words):
        export_c(loop, tmp_path / "rig", part="loop", duration=loop.duration or 5.0)
    assert not (tmp_path / "rig").exists()


@compiled
def test_the_command_writes_the_case_of_a_scene(tmp_path, capsys):
    call = ["export", "studies/scenes/jansen_2.toml", "--controller", "softer PI, 100 Hz", "--out", str(tmp_path / "out")]
    assert main([*call, "--duration", "20 s"]) == 0
    assert "softer PI, 100 Hz: loop as c" in capsys.readouterr().out
    scene = Scene.load("studies/scenes/jansen_2.toml")
    found = CompiledMachine(tmp_path / "out" / "jansen_2" / "jansen_2.c")
    same_switches(found.run(20.0), simulate(scene["softer PI, 100 Hz"], 20.0), 1e-7)
    assert main([*call, "--part", "law", "--name", "drive"]) == 0 and (tmp_path / "out" / "drive.h").exists()
    assert main([*call, "--part", "law", "--duration", "3 s"]) == 2
    assert main([*call, "--name", "my drive"]) == 2 and "name of C" in capsys.readouterr().err


def test_an_export_that_is_refused_leaves_no_folder(tmp_path, capsys):
    call = ["export", "studies/scenes/predictive.toml", "--controller", "nonlinear MPC", "--part", "law", "--out", str(tmp_path / "out")]
    assert main(call) == 2
    assert "NonlinearMPC is a Python callable: it runs in Python alone" in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize("part", ["loop", "law"])
def test_an_export_for_which_the_disk_has_no_room_leaves_the_earlier_one_as_it_was(tmp_path, monkeypatch, part):
    class Full(io.FileIO):
        def write(self, data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def opened(handle, mode):
        count.append(handle)
        return io.BufferedWriter(Full(handle, mode)) if len(count) == 2 else inner(handle, mode)

    span = {"duration": 10.0} if part == "loop" else {}
    count, inner = [], os.fdopen
    (tmp_path / "rig").mkdir()
    export_c(closed_loop(RIG, SoftTorque(), sample_time=0.01), tmp_path / "rig" / "rig", part=part, **span)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    monkeypatch.setattr(os, "fdopen", opened)
    with pytest.raises(OSError, match="No space"):
        export_c(closed_loop(RIG, StiffPI(), sample_time=0.02), tmp_path / "rig" / "rig", part=part, **span)
    assert len(count) == 2 and {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda tmp_path: export_c(LOOP, tmp_path / "rig", part="plant"), '`part` must be "law" or "loop"'),
    (lambda tmp_path: export_c(LOOP, tmp_path / "rig", part="loop"), "`duration` must be given"),
    (lambda tmp_path: export_c(LOOP, tmp_path / "rig", duration=3.0), 'belong to `part="loop"`'),
    (lambda tmp_path: export_c(RIG, tmp_path / "my rig", duration=3.0), "name of C"),
    (lambda tmp_path: export_c(RIG, tmp_path / "main", duration=3.0), "must not end in main"),
)  # fmt: skip


CHAOTIC = {"alternating_load", "whirl"}
"""Scenes whose error estimate is above 1: two runs of them differ."""

STIFF = {"elastic_slider"}
MANY = {"elastic_face", "string_on_wall"}
"""Scenes of many contacts, which are no loops."""


@compiled
@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({path.stem for path in Path("studies/scenes").glob("*.toml")} - CHAOTIC - STIFF - MANY))
def test_every_scene_of_equations_switches_as_it_does_in_simulate(tmp_path, name):
    scene = Scene.load(f"studies/scenes/{name}.toml")
    loop = scene[scene.cases[0].label]
    run = simulate(loop, method="explicit")
    found = CompiledMachine(export_c(loop, tmp_path / name, part="loop")[0])
    followers = loop.system.shared_modes  # frictions on one slip are one element in C
    listed = SimpleNamespace(events=[event for event in run.events if event.element not in followers])
    same_switches(found.run(loop.duration), listed, max(1e-9, 10.0 * run.accuracy))


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(CHAOTIC))
def test_the_scenes_that_are_left_out_are_chaotic(name):
    scene = Scene.load(f"studies/scenes/{name}.toml")
    assert simulate(scene[scene.cases[0].label], method="explicit").error_estimate > 1.0


def test_only_the_steps_that_go_to_c_are_compiled():
    class Fresh(Hyperbolic):
        """A law that no other test has compiled anything for."""

    plant = compose(BlockOnBelt(friction=Fresh(static=1.0, decay=3.0)))
    made = machine(closed_loop(plant), "belt", 10.0)
    assert [key[-1] for key in made.run.system.cache if key[0] == "program"] == [made.program.formulas.name]
    assert simulate(plant, 10.0).program.formulas.series  # which are others


@dataclass(frozen=True)
class Overflowing(Controller):
    """z_k = g^k; commands clip(z_k^2 - 3 z_k^2, -1, 1), which from the k on at which z_k^2 is beyond all numbers is a clip of inf - inf."""

    measured_signals = ("block.speed",)
    actuated_signals = ("block.force",)

    growth: float = quantity(1.0, "1", "factor g of the memory", above=0)

    def sampled(self, signal, period):
        exponent = state("overflowing.exponent", "1")
        size = ca.exp(exponent) + 0.0 * signal("block.speed", "m/s")
        wanted = size**2 - 3.0 * size**2
        return Update({exponent: exponent + ca.log(self.growth)}, {"block.force": (ca.fmin(ca.fmax(wanted, -1.0), 1.0), "N")})


def overflow(growth):
    """The first sample whose square is no number."""
    return math.floor(math.log(sys.float_info.max) / (2.0 * math.log(growth))) + 1


@compiled
def test_a_controller_that_gives_no_finite_number_stops_the_machine_and_is_named(tmp_path):
    loop = closed_loop(compose(BlockOnBelt()), Overflowing(), sample_time=0.01)
    found = CompiledMachine(export_c(loop, tmp_path / "belt", part="loop", duration=1.0)[0])
    assert found.set("PARAMETER", "overflowing.growth", 1e10) == DONE
    last = overflow(1e10)
    assert found.step((last - 0.5) * 0.01) == DONE
    assert found.step(1.0) == layout.NOT_FINITE == int(found.macros["BELT_NOT_FINITE"])
    time = found._function("time", ctypes.c_double)(found.memory)
    assert time == pytest.approx(last * 0.01) and found.step(1.0) == layout.NOT_FINITE  # it does not go on
    name = found._function("culprit_name", ctypes.c_char_p, ctypes.c_int)(found.memory, layout.NOT_FINITE)
    assert name == b"block.force of Overflowing"
    text = found.library["belt_status_text"]
    text.restype = ctypes.c_char_p
    assert b"no finite number" in text(layout.NOT_FINITE)


REFUSED = {
    "pi.proportional": (0.0, -1.0, np.nan, np.inf), "pi.integral": (-1e-300, -np.inf), "pi.highest_torque": (0.0, -1.0), "pi.lowest_torque": (2e4, 3e4),
    "bit.friction.static": (0.4,), "bit.friction.kinetic": (0.81,), "bit.radius": (0.0,), "chain.inertia.1": (0.0, -5.0), "bit.weight": (-1.0, np.nan),
}  # fmt: skip


@compiled
def test_numbers_that_python_refuses_change_nothing(tmp_path):
    loop = closed_loop(RIG, PI(lowest_torque=0.0, highest_torque=2e4), sample_time=0.01)
    found = CompiledMachine(export_c(loop, tmp_path / "rig", part="loop", duration=1.0)[0])
    for step in (False, True):
        before = bytes(found.memory.raw)
        for name, values in REFUSED.items():
            for value in values:
                group = "INPUT" if name == "bit.weight" else "PARAMETER"
                assert found.set(group, name, value) == -3, (name, value)
        assert bytes(found.memory.raw) == before
        if not step:
            found.step(0.5)
    for name, value in (
        ("pi.highest_torque", 4e4),
        ("pi.lowest_torque", 3e4),
        ("bit.friction.static", 0.9),
        ("bit.friction.kinetic", 0.85),
    ):
        assert found.set("PARAMETER", name, value) == DONE  # in this order no pair is ever wrong


@compiled
def test_the_step_of_a_law_returns_a_status_and_keeps_its_memory(tmp_path):
    c, h = export_c(closed_loop(RIG, PI(lowest_torque=0.0, highest_torque=2e4), sample_time=0.01), tmp_path / "drive")
    library = c.with_suffix(".so")
    subprocess.run([COMPILER, *STRICT, "-shared", "-fPIC", str(c), "-lm", "-o", str(library)], check=True)
    macros = dict(line.split()[1:3] for line in h.read_text().splitlines() if line.startswith("#define") and len(line.split()) > 2)
    law, many = ctypes.CDLL(str(library)), int(macros["DRIVE_GAINS"])
    memory, gains, u = (np.zeros(int(size)) for size in (macros["DRIVE_MEMORY"], many, macros["DRIVE_DRIVES"]))
    at = [array.ctypes.data_as(ctypes.c_void_p) for array in (memory, gains, u)]

    def stepped(*y):
        given = np.array([*y, *[8.0] * (int(macros["DRIVE_READS"]) - len(y))])
        return law.drive_step_with(at[1], given.ctypes.data_as(ctypes.c_void_p), at[0], at[2])

    law.drive_start(at[0])
    law.drive_gains(at[1])
    assert stepped(1.0) == 0 and u[0] > 0.0
    kept = memory.copy(), u.copy()
    for bad in (np.nan, np.inf, -np.inf):
        assert stepped(bad) == int(macros["DRIVE_NOT_FINITE"])
    rows = [line.split() for line in h.read_text().splitlines() if line.split()[1:2] and line.split()[1].startswith("gains[")]
    names = [words[2] for words in rows]
    for name, value in (("law.proportional", 0.0), ("law.integral", -1.0), ("law.highest_torque", -1.0), ("law.integral", np.nan)):
        law.drive_gains(at[1])
        gains[names.index(name)] = value
        assert stepped(1.0) == int(macros["DRIVE_OUTSIDE"]) and law.drive_allowed(at[1]) == 0
    np.testing.assert_array_equal(kept[0], memory)
    np.testing.assert_array_equal(kept[1], u)
