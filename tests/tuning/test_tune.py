"""Tuning: optima and fronts that are known in closed form, and a search that can be killed and goes on."""

import contextlib
import dataclasses
import itertools
import json
import math
import statistics
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
import pytest
from scipy.optimize import OptimizeResult

from controllers import LQG, PI, ActiveDamping, SoftTorque, StiffPI, ZTorque
from models import BitRock, Block, TorsionalChain, wells
from tests.plants import RIG
from toolbox import (
    Controller,
    Equations,
    Sampled,
    SceneError,
    closed_loop,
    compose,
    linearise,
    measure,
    quantity,
    simulate,
    state,
    sweep,
    tune,
)
from toolbox.errors import ControllerError
from toolbox.scenes.cases import Case
from toolbox.scenes.scene import Scene
from toolbox.tuning import search


@dataclass(frozen=True)
class Dials(Controller):
    """A law of two numbers that an objective can read back: a torque and a signal."""

    measured_signals, actuated_signals = ("top.speed",), ("top.torque",)
    torque: float = quantity(1000.0, "N m", "constant torque")
    dial: float = quantity(0.0, "1", "a number that drives nothing")
    gain: float = quantity(1.0, "1", "must be positive", above=0)

    def continuous(self, signal):
        return Equations(outputs={"top.torque": (self.torque, "N m"), "read.dial": (self.dial, "1")})


def scene(*cases, duration=0.1, **changes):
    parts = changes.pop("parts", (wells.JANSEN_2, BitRock()))
    return Scene("rig", parts, cases or (Case("dials", Dials()),), duration, "bit", "bit.speed", "top.torque", 0.5 * duration, **changes)


def end(run, signal):
    return float(run.at(run.end)[signal])


def off_by(run):
    return abs(end(run, "top.torque") - end(run, "bit.weight"))


def squared(run):
    return off_by(run) ** 2


LOADS = (1000.0, 2000.0, 6000.0)


def loads():
    return {f"{load:g} N": scene(parameters={"bit.weight": load}) for load in LOADS}


# --- what it finds


def test_the_worst_case_of_distances_is_smallest_in_the_middle_and_the_mean_of_squares_at_the_mean():
    box = {"dials.torque": (100.0, 10_000.0)}
    worst = tune(loads(), Dials(), off_by, box, runs=120)
    assert worst.law.torque == pytest.approx((min(LOADS) + max(LOADS)) / 2, rel=1e-3)
    assert worst.counted(worst.best)[0] == pytest.approx((max(LOADS) - min(LOADS)) / 2, rel=1e-3)
    assert worst.counted(worst.before)[0] == pytest.approx(max(LOADS) - 1000.0)  # the law as given, on the farthest load
    mean = tune(loads(), Dials(), squared, box, aggregate=statistics.fmean, runs=120)
    assert mean.law.torque == pytest.approx(statistics.fmean(LOADS), rel=1e-3)


def test_a_plant_without_friction_is_tuned_to_the_least_integral_of_its_squared_error():
    @dataclass(frozen=True)
    class Damper(Controller):
        measured_signals, actuated_signals = ("block.speed",), ("block.force",)
        damping: float = quantity(0.2, "N s/m", "damping 2 z of x'' + 2 z x' + x = 1", at_least=0)

        def continuous(self, signal):
            return Equations(outputs={"block.force": (1.0 - self.damping * signal("block.speed", "m/s"), "N")})

    def squares(run):  # from rest J = z + 1 / (4 z): least, 1, at z = 1/2; from z = 0.1 2.6
        return run.end * measure.mean_square(run, "block.position", 1.0)

    found = tune(compose(Block()), Damper(), squares, {"damper.damping": (0.1, 5.0)}, duration=80.0, runs=60)
    assert found.law.damping == pytest.approx(1.0, rel=1e-3)
    assert found.counted(found.best)[0] == pytest.approx(1.0, rel=1e-6)
    assert found.counted(found.before)[0] == pytest.approx(2.6, rel=1e-5)
    with pytest.raises(SceneError, match="must have a contact with dry friction"):
        tune(compose(Block()), Damper(), "stuck", {"damper.damping": (0.1, 5.0)}, duration=80.0)


def test_the_best_damped_pi_drive_on_a_free_string_is_the_optimum_of_jansen_and_van_den_steen():
    string = TorsionalChain(inertia=(2122.0, 374.0), stiffness=(473.0,), damping=(0.0,), top_drag=0.0, bit_drag=0.0)
    slip = scene(duration=0.01, parts=(string, BitRock(weight=0.0)), start={"chain.speed": (5.0, 5.0)})

    def least_damped(run):
        return float(linearise(run.run.system, at=run.at(run.end)).poles().real.max())

    given = PI(proportional=2e4, integral=2e3)
    found = tune(slip, given, {"growth [1/s]": least_damped}, {"pi.proportional": (100.0, 1e5), "pi.integral": (50.0, 5e4)}, runs=400)
    spring, damper = ActiveDamping.gains(473.0, 374.0, 2122.0)
    om = math.sqrt(473.0 / 374.0)
    optimum = -0.5 * om * math.sqrt(374.0 / 2122.0)  # real part of the double pair
    assert optimum <= found.counted(found.best)[0] < 0.98 * optimum
    assert found.law.integral == pytest.approx(spring, rel=0.05) and found.law.proportional == pytest.approx(damper, rel=0.05)
    assert found.counted(found.before)[0] > 0.2 * optimum  # the drive as given hardly damps


@pytest.mark.parametrize(
    ("values", "ends"),
    [([2.0, 2.0001], True), ([-2.0, -2.0001], True), ([2.0, 2.1], False), ([0.5, 1.0], False), ([search.WORST] * 2, False)],
)
def test_an_evolution_ends_where_all_its_members_are_as_good_as_the_best_and_not_where_all_fail(values, ends):
    with pytest.raises(StopIteration) if ends else contextlib.nullcontext():
        search._gathered(OptimizeResult(population_energies=np.array(values)))


def test_the_front_of_two_distances_is_all_that_lies_between_their_zeros():
    first, last = 2000.0, 6000.0
    objectives = {"low": lambda run: (end(run, "top.torque") - first) ** 2, "high": lambda run: (end(run, "top.torque") - last) ** 2}
    found = tune(scene(), Dials(torque=9500.0), objectives, {"dials.torque": (100.0, 10_000.0)}, runs=150)
    torques = np.array([trial.numbers[0] for trial in found.front])
    assert torques.min() == pytest.approx(first, abs=10.0) and torques.max() == pytest.approx(last, abs=10.0)
    assert len(torques) > 40 and np.diff(torques).max() < 500.0
    for (
        trial
    ) in found.front:  # the closed form of the front; its last points may lie beyond the zeros, by as much as the search missed them
        low, high = found.counted(trial)
        assert math.sqrt(low) + math.sqrt(high) == pytest.approx(last - first, abs=20.0 if not first <= trial.numbers[0] <= last else 1e-6)
    assert found.best.numbers[0] == pytest.approx((first + last) / 2, abs=300.0)
    low_given = tune(scene(), Dials(torque=1000.0), objectives, {"dials.torque": (100.0, 10_000.0)}, runs=60)
    assert (np.array(low_given.counted(low_given.best)) <= low_given.counted(low_given.before)).all()  # not bought by a loss elsewhere
    assert low_given.best.numbers[0] <= 3000.0
    beaten = [trial for trial in found.trials if not first - 20 <= trial.numbers[0] <= last + 20]
    assert beaten and not any(trial in found.front for trial in beaten)


def test_a_front_that_is_not_convex_is_reached_in_its_middle():
    # C. M. Fonseca, P. J. Fleming 1995: both numbers equal between -1/sqrt 2 and 1/sqrt 2 on the front
    def numbers(run):
        return np.array([end(run, "top.torque") / 1000.0, end(run, "read.dial")])

    objectives = {
        "one": lambda run: 1 - math.exp(-np.sum((numbers(run) - 1 / math.sqrt(2)) ** 2)),
        "other": lambda run: 1 - math.exp(-np.sum((numbers(run) + 1 / math.sqrt(2)) ** 2)),
    }
    found = tune(scene(), Dials(), objectives, {"dials.torque": (-4000.0, 4000.0), "dials.dial": (-4.0, 4.0)}, runs=300)
    values = np.array([found.counted(trial) for trial in found.front])
    t = np.linspace(-1, 1, 2001) / math.sqrt(2)
    truth = np.column_stack([1 - np.exp(-2 * (t - 1 / math.sqrt(2)) ** 2), 1 - np.exp(-2 * (t + 1 / math.sqrt(2)) ** 2)])
    to_front = np.min(np.linalg.norm(values[:, None] - truth[None], axis=2), axis=1)
    assert np.median(to_front) < 0.01
    middle = values[(values > 0.45).all(axis=1) & (values < 0.8).all(axis=1)]  # there weighted sums find nothing
    assert len(middle) >= 3
    both = np.exp(-1.0)  # at the middle of the front both objectives are 1 - exp(-1)
    assert np.min(np.abs(values - (1 - both)).max(axis=1)) < 0.06


def rig(weight=97_347.0):
    cases = (Case("stiff", StiffPI(reference=9.9)), Case("stiff, 100 Hz", StiffPI(reference=9.9), sample_time=0.01))
    return scene(*cases, duration=80.0, reference=9.9, parameters={"bit.weight": weight})


def test_tuning_frees_the_bit_that_the_stiff_drive_leaves_in_stick_slip_on_every_weight():
    scenes = {f"{weight / 1e3:g} kN": rig(weight) for weight in (90e3, 100e3)}
    found = tune(scenes, "stiff, 100 Hz", "severity", {"stiffpi.proportional": (500.0, 5e4), "stiffpi.integral": (50.0, 2e4)}, runs=20)
    assert all(value > 0.5 for (value,) in found.before.values)  # as given: stick-slip on both
    assert all(value < 0.02 for (value,) in found.best.values)
    law = found.law
    assert isinstance(law, Sampled) and law.period == 0.01
    for each in scenes.values():
        loop = each["stiff, 100 Hz"]
        given, tuned = simulate(loop), simulate(closed_loop(loop, law))
        assert given.time_in("bit", "stick", after=40.0) > 5.0
        assert tuned.time_in("bit", "stick", after=40.0) == 0.0
    report = str(found)
    for word in ("StiffPI `stiff, 100 Hz`", "proportional [N m s/rad]", "worst of 2 scenes", "90 kN", "severity", "given", "tuned", "log"):
        assert word in report


def test_plants_stand_for_scenes_that_are_judged_as_a_scene_file_is():
    """On the free string |torque - weight| is smallest at the weight; on two weights in the middle."""
    box = {"dials.torque": (100.0, 10_000.0)}
    plants = {f"{load:g} N": RIG.with_parameters({"bit.weight": load}) for load in LOADS}
    worst = tune(plants, Dials(), off_by, box, duration=0.1, runs=120)
    assert worst.law.torque == tune(loads(), Dials(), off_by, box, runs=120).law.torque
    alone = tune(plants["2000 N"], Dials(), off_by, box, duration=0.1, runs=60)
    assert alone.law.torque == pytest.approx(2000.0, rel=1e-3)
    drive = PI(reference=9.95, proportional=20e3, integral=2e3)
    found = tune(RIG, Sampled(drive, 0.01), ["settling", "stuck"], {"pi.proportional": (300.0, 20e3)}, duration=60.0, runs=12)
    assert (
        isinstance(found.controller, Sampled) and found.before.values[0][1] > 1.0
    )  # sticks as given; the law's own reference is the set-point


def test_measures_of_the_verdict_are_those_of_the_study_and_may_be_given_as_functions():
    by_name = tune(rig(), "stiff", ["severity", "peak"], {"stiffpi.proportional": (1e3, 1e5)}, runs=10)
    by_function = tune(rig(), "stiff", [measure.severity, "peak"], {"stiffpi.proportional": (1e3, 1e5)}, runs=10)
    assert by_name.trials == by_function.trials and by_name.objectives == by_function.objectives
    run = rig().run("stiff")
    assert by_name.before.values == ((measure.severity(run, "bit.speed", after=40.0), measure.extent(run, "top.torque").maximum),)
    assert by_name.units == ("1", "N m")


def test_numbers_of_nested_laws_and_of_those_that_design_fills_in_can_be_free():
    found = tune(rig(), Sampled(LQG(reference=9.9), 0.01), "stuck", {"lqg.bit_speed_scale": (0.5, 5.0)}, runs=10)
    assert isinstance(found.law, Sampled) and isinstance(found.law.law, LQG)
    drive = ZTorque(reference=9.9)  # whose impedance is read from the chain
    loop = closed_loop(rig()["stiff"], drive)
    found = tune(rig(), drive, "severity", {"ztorque.impedance": (100.0, 1e4)}, runs=10)
    assert found.before.numbers == (loop.number("ztorque.impedance").value,)
    assert found.law == dataclasses.replace(drive, impedance=found.best.numbers[0])
    others = {"rig": rig(), "longer": dataclasses.replace(rig(), parts=(wells.NAVARRO_LOPEZ_4, BitRock()))}
    found = tune(others, drive, "severity", {"impedance": (100.0, 1e4)}, runs=10)  # the name is the only one that ends so
    assert found.before.numbers == (None,) and "by design" in str(found)


def test_a_number_of_a_designed_law_is_changed_where_it_acts_as_in_a_sweep():
    law, box = SoftTorque(reference=9.9), {"softtorque.proportional": (500.0, 2e3)}
    found = tune(rig(), law, "severity", box, runs=10)
    swept = sweep(
        closed_loop(rig()["stiff"], law), {"softtorque.proportional": [trial.numbers[0] for trial in found.trials]}, metrics="severity"
    )
    assert [value for ((value,),) in (trial.values for trial in found.trials)] == pytest.approx(
        swept["severity"], rel=1e-5, abs=1e-6
    )  # the accuracy of the runs
    best = found.best.numbers[0]
    assert found.law == dataclasses.replace(
        closed_loop(RIG, law).designed_controllers[0], proportional=best
    )  # a PI with the integral that was designed
    tuned = closed_loop(rig()["stiff"], found.law)
    assert tuned.number("softtorque.integral").value == closed_loop(RIG, law).number("softtorque.integral").value
    with pytest.raises(SceneError, match="designed otherwise in each scene, as SoftTorque is, but it holds `softtorque.proportional`"):
        others = {"rig": rig(), "longer": dataclasses.replace(rig(), parts=(wells.NAVARRO_LOPEZ_4, BitRock()))}
        tune(others, law, "severity", box, runs=10)


def test_another_number_compiles_nothing(monkeypatch):
    tune(rig(), "stiff", "severity", {"stiffpi.proportional": (1e3, 1e5)}, runs=10)
    monkeypatch.setattr("toolbox.compilation.kernel.compiled_for", lambda *_: pytest.fail("compiled again"))
    monkeypatch.setattr("toolbox.compilation.emitter.object_code", lambda *_: pytest.fail("compiled again"))
    found = tune(rig(), "stiff", "severity", {"stiffpi.integral": (1e2, 1e4)}, runs=10, seed=4)
    assert len(found.trials) >= 8 and not any(trial.failed for trial in found.trials)


# --- what fails


@dataclass(frozen=True)
class Escape(Controller):
    """A law whose state leaves every bound at the time pi / 2 / growth, and which cannot be designed above a growth of 5."""

    actuated_signals = ("top.torque",)
    growth: float = quantity(0.1, "1/s", "growth", above=0)

    def design(self, plant):
        if self.growth > 5.0:
            raise SceneError("There is no such law.")
        return self

    def continuous(self, signal):
        x = state("escape.state", "1")
        return Equations(flow={x: self.growth * (1 + x**2)}, outputs={"top.torque": (1000.0 * self.growth, "N m")})


@dataclass(frozen=True)
class Wish(Controller):
    """A number that only the design knows, which makes of it the law with that growth."""

    actuated_signals = ("top.torque",)
    growth: float = quantity(0.1, "1/s", "growth", above=0)

    def design(self, plant):
        return Escape(self.growth).design(plant)


def test_runs_that_fail_and_laws_that_cannot_be_designed_are_infinitely_bad_and_recorded(tmp_path):
    long = scene(Case("escape", Wish()), duration=1.0)
    found = tune(long, "escape", {"torque": lambda run: -end(run, "top.torque")}, {"wish.design.growth": (0.5, 20.0)}, runs=60)
    failed = [trial for trial in found.trials if trial.failed]
    assert failed and all(trial.values == ((math.inf,),) for trial in failed)
    for trial in found.trials:
        if abs(trial.numbers[0] - math.pi / 2) > 1e-5:  # where the state is finite, but beyond what a run can resolve
            assert trial.failed == (trial.numbers[0] > math.pi / 2)
    assert {words.partition(":")[0] for trial in failed for words in trial.failures} >= {"SceneError"}
    assert any("SceneError" not in trial.failures[0] for trial in failed)
    assert found.law.growth == pytest.approx(math.pi / 2, rel=1e-2)  # the cliff
    assert f"{len(failed)} of the points" in str(found)
    text = found.save(tmp_path / "trials.csv").read_text().splitlines()
    assert text[0] == "wish.design.growth [1/s],torque,front,failure" and len(text) == len(found.trials) + 1
    assert sum("There is no such law" in line for line in text) > 0


def test_where_every_run_fails_the_report_says_so_and_there_is_no_law():
    hopeless = tune(scene(Case("escape", Escape(growth=3.0)), duration=1.0), "escape", "severity", {"escape.growth": (2.0, 4.0)}, runs=30)
    assert hopeless.front == () and "Nothing was found" in str(hopeless)
    with pytest.raises(SceneError, match="all .* trials failed"):
        _ = hopeless.law
    several = tune(
        scene(Case("escape", Escape(growth=3.0)), duration=1.0), "escape", ["severity", "stuck"], {"escape.growth": (2.0, 4.0)}, runs=30
    )
    assert several.front == ()


def test_an_objective_that_does_not_exist_is_infinitely_bad():
    found = tune(
        scene(),
        Dials(),
        {"root": lambda run: math.sqrt(x) if (x := end(run, "read.dial")) >= 0 else math.nan},
        {"dials.dial": (-1.0, 1.0)},
        runs=60,
    )
    assert all(math.isinf(trial.values[0][0]) == (trial.numbers[0] < 0) for trial in found.trials)
    assert found.law.dial == pytest.approx(0.0, abs=1e-3)


# --- a search that can be killed


@pytest.mark.parametrize("several", [False, True])
def test_a_killed_tuning_goes_on_from_its_journal_to_the_result_it_would_have_had(tmp_path, monkeypatch, several):
    objective = {"off": off_by, "torque": torque_of} if several else {"off": off_by}
    arguments = (loads(), Dials(), objective, {"dials.torque": (100.0, 10_000.0)})
    whole = tune(*arguments, runs=60)
    path = tmp_path / "journal.jsonl"
    calls = []

    def killing(loop):
        calls.append(loop)
        if len(calls) == 77:
            raise KeyboardInterrupt
        return simulate(loop)

    monkeypatch.setattr(search, "simulate", killing)
    with pytest.raises(KeyboardInterrupt):
        tune(*arguments, runs=60, checkpoint=path)
    assert len(path.read_text().splitlines()) == 1 + 76 // 3  # the arguments, and every point that was done
    with path.open("a") as file:
        file.write('{"numbers": [12')  # as if killed while writing
    resumed = tune(*arguments, runs=60, checkpoint=path)
    assert resumed.trials == whole.trials and resumed.law == whole.law and str(resumed) == str(whole)
    assert resumed.simulated_runs == whole.simulated_runs - 3 * (76 // 3)
    again = tune(*arguments, runs=60, checkpoint=path)
    assert again.trials == whole.trials and again.simulated_runs == 0
    longer = tune(*arguments, runs=80, checkpoint=path)
    assert longer.simulated_runs < 3 * len(longer.trials)


def torque_of(run):
    return end(run, "top.torque")


def test_a_journal_keeps_failures_and_values_to_the_last_bit(tmp_path):
    long = scene(Case("escape", Escape()), duration=1.0)
    arguments = (long, "escape", "severity", {"escape.growth": (0.5, 20.0)})
    first = tune(*arguments, runs=20, checkpoint=tmp_path / "j")
    assert any(trial.failed for trial in first.trials)
    second = tune(*arguments, runs=20, checkpoint=tmp_path / "j")
    assert second.trials == first.trials and second.simulated_runs == 0


def test_a_journal_of_other_arguments_is_refused_by_the_name_of_what_differs(tmp_path):
    path = tmp_path / "j"
    box = {"dials.torque": (100.0, 10_000.0)}
    tune(loads(), Dials(), off_by, box, runs=10, checkpoint=path)
    before = path.read_bytes()
    for word, arguments, more in (
        ("ranges", (loads(), Dials(), off_by, {"dials.torque": (100.0, 20_000.0)}), {}),
        ("controller", (loads(), Dials(dial=1.0), off_by, box), {}),
        ("scene", (scene(), Dials(), off_by, box), {}),
        ("objective", (loads(), Dials(), squared, box), {}),
        ("seed", (loads(), Dials(), off_by, box), {"seed": 1}),
    ):
        with pytest.raises(SceneError, match=f"same arguments.*of another `{word}`"):
            tune(*arguments, runs=10, checkpoint=path, **more)
    assert path.read_bytes() == before
    limits = [1.0, 2.0]
    objectives = [lambda run, limit=limit: off_by(run) - limit for limit in limits]  # functions that differ in what they hold
    tune(scene(), Dials(), {"f": objectives[0]}, box, runs=10, checkpoint=tmp_path / "k")
    with pytest.raises(SceneError, match="objective"):
        tune(scene(), Dials(), {"f": objectives[1]}, box, runs=10, checkpoint=tmp_path / "k")


def test_a_file_that_is_no_journal_is_left_alone(tmp_path):
    for content in ("my notes\n", "my notes", "{}\n", json.dumps({"format": "other", "arguments": {}}) + "\n"):
        path = tmp_path / "notes"
        path.write_text(content)
        with pytest.raises(SceneError, match="something else"):
            tune(scene(), Dials(), off_by, {"dials.torque": (1.0, 2.0)}, runs=10, checkpoint=path)
        assert path.read_text() == content
    path = tmp_path / "broken"
    tune(scene(), Dials(), off_by, {"dials.torque": (1.0, 2.0)}, runs=10, checkpoint=path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:2], "nonsense", *lines[2:]]) + "\n")
    with pytest.raises(SceneError, match="line 3"):
        tune(scene(), Dials(), off_by, {"dials.torque": (1.0, 2.0)}, runs=10, checkpoint=path)
    with pytest.raises(SceneError, match="cannot"):
        tune(scene(), Dials(), off_by, {"dials.torque": (1.0, 2.0)}, runs=10, checkpoint=tmp_path / "nowhere" / "j")


def test_the_same_seed_gives_the_same_search_and_another_one_another():
    arguments = (scene(), Dials(), off_by, {"dials.torque": (100.0, 10_000.0)})
    first, second, other = (tune(*arguments, runs=40, seed=seed) for seed in (1, 1, 2))
    assert first.trials == second.trials
    assert first.trials != other.trials


# --- mistakes


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scene": 3}, "`scene` must be a Scene, a plant"),
        ({"scene": RIG}, "`controller` must be a law"),
        ({"scene": RIG, "controller": Dials()}, "`duration` must be"),
        ({"duration": 5.0}, "`duration` must be left out"),
        ({"scene": []}, "at least one Scene"),
        ({"controller": "dial"}, "did you mean `dials`"),
        ({"controller": lambda t, y: 0.0}, "`controller` must be"),
        ({"controller": "bare"}, "has none"),
        ({"objective": "severty"}, "did you mean `severity`"),
        ({"objective": "settling"}, "no set-point of `bit.speed`"),
        ({"objective": []}, "at least one"),
        ({"objective": 3}, "`objective` must be"),
        ({"objective": ["stuck", "stuck"]}, "every measure once"),
        ({"ranges": {}}, "`ranges` must map"),
        ({"ranges": {"torqe": (1.0, 2.0)}}, "did you mean `dials.torque`"),
        ({"ranges": {"dials.torque": (2.0, 1.0)}}, "low < high"),
        ({"ranges": {"dials.torque": (1.0, math.inf)}}, "low < high"),
        ({"ranges": {"dials.gain": (0.0, 1.0)}}, "must be > 0"),
        ({"ranges": {"bit.weight": (0.0, 1.0)}}, "gains of the controller that is tuned, not `bit.weight`"),
        ({"ranges": {"torque": (1.0, math.nan)}}, "low < high"),
        ({"ranges": {"name": (0.0, 1.0)}}, "no number `name`"),
        ({"aggregate": 3}, "`aggregate` must be"),
        ({"runs": 3}, "`runs` must be"),
        ({"seed": -1}, "`seed` must be"),
        ({"objective": lambda run: run["no.signal"][0]}, "no.signal"),
    ],
)
def test_a_mistake_names_the_argument(change, words):
    two = scene(Case("dials", Dials()), Case("bare", inputs={"top.torque": 1.0}))
    arguments = {"scene": two, "controller": "dials", "objective": off_by, "ranges": {"dials.torque": (1.0, 2.0)}} | change
    with pytest.raises(SceneError, match=words):
        tune(**arguments)


def test_the_law_as_given_fails_aloud_where_it_is_wrong_and_is_recorded_where_only_its_run_fails():
    with pytest.raises(SceneError, match="no such law"):
        tune(scene(Case("escape", Escape(growth=6.0))), "escape", "severity", {"escape.growth": (0.5, 1.0)}, runs=10)
    found = tune(scene(Case("escape", Escape(growth=3.0)), duration=1.0), "escape", torque_of, {"escape.growth": (0.5, 1.0)}, runs=10)
    assert found.before.failed and found.before.failures[0].startswith(ControllerError.__name__)
    assert found.law.growth <= 1.0


def test_scenes_whose_laws_start_from_different_numbers_are_refused():
    scenes = {word: scene(Case("dials", Dials(torque=torque))) for word, torque in (("a", 1000.0), ("b", 2000.0))}
    with pytest.raises(SceneError, match="same `dials.torque` in every scene, but it is 1000 in `a` and 2000 in `b`"):
        tune(scenes, "dials", off_by, {"dials.torque": (100.0, 1e4)}, runs=10)
    found = tune(scenes, "dials", off_by, {"dials.dial": (0.0, 1.0)}, runs=10)  # numbers that are not free may differ
    assert found.before.values[0] != found.before.values[1]


@pytest.mark.parametrize("objectives", [2, 3, 4, 5])
def test_weights_are_all_shares_of_one_whole_as_fine_as_fifteen_of_them_and_the_runs_allow(objectives):
    for most in (1, 3, 6, 10, 15, 16, 40, 200):
        found = search._directions(objectives, most)
        parts = round(1.0 / found[found > 0].min())
        assert sorted(map(tuple, np.round(parts * found).astype(int))) == sorted(
            each for each in itertools.product(range(parts + 1), repeat=objectives) if sum(each) == parts
        )
        np.testing.assert_allclose(found.sum(axis=1), 1.0, rtol=1e-15)
        assert len(found) <= max(objectives, min(most, 15)) < math.comb(parts + objectives, parts + 1)  # of a finer grid there are as many


def test_the_figure_shows_the_front_or_the_best_so_far(tmp_path):
    both = tune(scene(), Dials(), {"off [N]": off_by, "torque [N m]": torque_of}, {"dials.torque": (100.0, 10_000.0)}, runs=40)
    ax = both.plot()
    assert ax.get_xlabel() == "off [N]" and ax.get_ylabel() == "torque [N m]"
    assert {text.get_text() for text in ax.get_legend().get_texts()} >= {"front", "as given", "tuned", "tried"}
    one = tune(scene(), Dials(), off_by, {"dials.torque": (100.0, 10_000.0)}, runs=40).plot()
    line = next(line for line in one.get_lines() if line.get_label() == "best so far")
    assert (np.diff(line.get_ydata()) <= 0).all()


# --- on several cores


def farthest(run):
    return off_by(run)


def nearest(run):
    return -abs(end(run, "top.torque") - 2500.0)


@pytest.fixture(scope="module")
def pool():
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        yield executor


@pytest.mark.slow
@pytest.mark.parametrize("objectives", [farthest, (farthest, nearest)])
def test_processes_find_the_same_and_write_the_same_journal(tmp_path, objectives, pool):
    box = {"dials.torque": (100.0, 10_000.0)}
    here = tune(loads(), Dials(), objectives, box, runs=60, checkpoint=tmp_path / "here")
    there = tune(loads(), Dials(), objectives, box, runs=60, checkpoint=tmp_path / "there", executor=pool)
    assert there == here
    assert (tmp_path / "there").read_bytes() == (tmp_path / "here").read_bytes()
    lines = (tmp_path / "there").read_bytes().splitlines(keepends=True)
    (tmp_path / "cut").write_bytes(b"".join(lines[:30]) + lines[30][:9])  # as a kill leaves it
    went_on = tune(loads(), Dials(), objectives, box, runs=60, checkpoint=tmp_path / "cut", executor=pool)
    assert went_on.trials == here.trials and went_on.simulated_runs == 3 * (len(here.trials) - 29)


def test_what_cannot_travel_to_a_process_and_what_is_wrong_there_is_said_here(pool):
    box = {"dials.torque": (100.0, 10_000.0)}
    with pytest.raises(SceneError, match="objectives that travel to other processes must be importable"):
        tune(loads(), Dials(), lambda run: 0.0, box, runs=20, executor=pool)
    with pytest.raises(SceneError, match="must be > 0"):
        tune(loads(), Dials(gain=-1.0), farthest, box, runs=20, executor=pool)
