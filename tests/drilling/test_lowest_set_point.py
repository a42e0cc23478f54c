"""The lowest set-point of a law: found where runs of its own show it, kept, resumed, told, and refused where the question makes no sense."""

from __future__ import annotations

import dataclasses
import json
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers import PI, Lifting, SoftTorque, StiffPI
from models import BitRock, BlockOnBelt, Coulomb, wells
from toolbox import Controller, Sampled, SceneError, closed_loop, compose, lowest_set_point, onset, simulate
from toolbox.commands.command_line import main
from toolbox.drilling import Group, LowestSetPoints, Machine, Varying, machine_groups
from toolbox.drilling.lowest_set_point import Cells, SetPointLimit, borders, lowest
from toolbox.drilling.set_points import Outcome, Trial, verdict
from toolbox.modelling import Takeover

PLANT = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
LOOP = closed_loop(PLANT, Sampled(SoftTorque(), "10 ms", delay="30 ms"))
BRIEF = Group("nominal", (Machine("nominal"),), noise=0.0, takeover_phases=(0.0, 0.5))


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    path = tmp_path_factory.mktemp("known") / "cells.jsonl"
    said: list[str] = []
    return lowest_set_point(
        LOOP, StiffPI(), [BRIEF], protocols=["takeover"], bounds=("62 rpm", "110 rpm"), step="4 rpm", checkpoint=path, callback=said.append
    ), path, said  # fmt: skip


def test_the_border_is_that_of_runs_of_ones_own(found):
    held = found[0]["SoftTorque", "nominal"]
    trial = Trial(LOOP, StiffPI())
    for speed, ends in ((held.lowest_set_point, True), (held.lowest_set_point - 4 * np.pi / 30, False)):
        stuck = []
        for phase in BRIEF.takeover_phases:
            at = trial.takeover(speed, phase)
            both = Takeover(StiffPI(reference=speed), SoftTorque(reference=speed), at=at)
            run = simulate(closed_loop(PLANT, Sampled(both, 0.01, 0.03), start=trial.cycle(speed).start), 180.0)
            assert run.time_in("bit", "stick", until=at) > 1.0  # there is something to be ended
            stuck.append(run.time_in("bit", "stick", after=120.0))
        assert (max(stuck) == 0.0) == ends
    assert (
        held.disk_margin == held.disk_margin_nominal > 0.0
        and held.recovery_time > 0.0
        and held.max_bit_speed > held.lowest_set_point
        and np.isnan(held.max_lifts)
    )


def test_the_table_tells_what_was_asked_in_the_units_typed_and_survives_a_file(found, tmp_path):
    result, _, _ = found
    text = str(result)
    assert text.startswith("Lowest set-points at which a controller ends the stick-slip under StiffPI (62 to 110 rpm, steps of 4 rpm)")
    assert "lowest [rpm]" in text and f"{result['SoftTorque', 'nominal'].lowest_set_point * 30 / np.pi:.3g}" in text
    assert repr(LowestSetPoints.load(result.save(tmp_path / "found.npz"))) == repr(result)
    lines = result.save(tmp_path / "found.csv").read_text().splitlines()
    assert lines[0].startswith("controller,group,protocol,lowest_set_point,why") and lines[1].startswith("SoftTorque,nominal,takeover,")
    with pytest.raises(SceneError, match="nominal"):
        result["SoftTorque", "declard"]
    assert result.plot().get_xlabel().startswith("lowest set-point [rpm]")


def test_a_range_in_si_is_answered_in_the_units_of_the_loop():
    law = SoftTorque(reference="80 rpm", highest_torque="20 kN m")
    loop = closed_loop(PLANT, Sampled(law, "10 ms", delay="30 ms"))
    said: list[str] = []
    text = str(
        lowest_set_point(
            loop, StiffPI(), [BRIEF], protocols=["takeover"], bounds=(7.0, 9.0), step=1.0, long_run=False, callback=said.append
        )
    )
    assert "lowest [rpm]" in text and "torque [kN m]" in text and "66.8 to 85.9 rpm" in text
    assert all(" rpm: " in line for line in said)


def test_what_is_known_is_not_asked_again_and_another_machine_is(found, monkeypatch):
    result, path, said = found
    monkeypatch.setattr(Trial, "outcome", lambda *given: pytest.fail("it is known"))
    again = lowest_set_point(LOOP, StiffPI(), [BRIEF], protocols=["takeover"], bounds=("62 rpm", "110 rpm"), step="4 rpm", checkpoint=path)
    assert repr(again) == repr(result) and len([json.loads(line) for line in path.read_text().split("\n") if line]) == len(said)
    later = LOOP.with_controllers([Sampled(SoftTorque(), "10 ms", delay="20 ms")])
    keys = {
        json.dumps(Trial(loop, before).key(5.0))
        for loop, before in (
            (LOOP, StiffPI()), (LOOP.at("bit.weight", 9e4), StiffPI()), (LOOP, PI()), (later, StiffPI()),
            (closed_loop(PLANT, Sampled(SoftTorque(detuning=0.9), 0.01, 0.03)), StiffPI()),
        )
    }  # fmt: skip
    assert len(keys) == 5


@pytest.mark.parametrize("speed", [3.6, 4.4])
def test_smooth_running_that_grows_is_no_success_however_calm_the_window(speed):
    """The same border as that of `onset`, which follows smooth running to where it is lost."""
    loop = closed_loop(PLANT, PI(), sample_time=0.01)
    lost = onset(loop, "top.reference", (3.5, 4.5), num_values=3, tolerance=0.1).loss
    assert 3.6 < lost < 4.4
    grows, name = Trial(loop, StiffPI()).growth([Machine("nominal")], speed)
    assert (grows > 0.0) == (speed < lost)
    assert name == "nominal"


def test_a_machine_of_a_group_has_its_numbers_its_delay_and_its_weight_in_time():
    groups = machine_groups(LOOP)
    assert list(groups) == ["nominal", "noisy", "one_at_a_time", "combined", "other_rocks", "varying_weight"]
    trial = Trial(LOOP, StiffPI())
    heavy = next(each for each in groups["one_at_a_time"].machines if each.name == "weight +20 %")
    assert trial.steady(heavy, 6.0).number("bit.weight").value == pytest.approx(1.2 * 97_347.0)
    late = next(each for each in groups["one_at_a_time"].machines if each.delay)
    assert trial.steady(late, 6.0).controllers[0].delay == pytest.approx(0.06)
    loop, _ = trial.takes_over(
        Machine("noise", weight_variation=Varying(0.05, 0.2, noise=True)), groups["varying_weight"], 6.0, "takeover", 101, 20.0
    )
    weight = simulate(loop, 300.0).at(np.arange(0.0, 300.0, 0.5))["bit.weight"]
    assert weight.mean() == pytest.approx(97_347.0, rel=0.01) and weight.std() == pytest.approx(0.05 * 97_347.0, rel=0.1)
    assert "other_rocks" not in machine_groups(compose(wells.JANSEN_2, BitRock(friction=Coulomb(0.8, 0.5))))


def test_every_seed_of_a_weight_that_varies_is_a_course_of_its_own():
    group = machine_groups(LOOP)["varying_weight"]
    assert group.runs == 4 * 10 * 2
    for machine in group.machines:
        courses = {machine.weight_variation.input(97_347.0, seed).coefficients for seed in group.seeds}
        assert len(courses) == len(group.seeds)
        assert {each[:2] for each in courses} == {(97_347.0, machine.weight_variation.size * 97_347.0)}  # mean and size stay
    phases = sorted(group.machines[2].weight_variation.input(1.0, seed).coefficients[3] for seed in group.seeds)
    gaps = np.diff([*phases, phases[0] + 2.0 * np.pi])
    assert gaps.max() < 2.0 * np.pi / 5  # spread over the turn


def test_a_group_stops_where_nothing_holds_and_says_why(monkeypatch):
    trial = Trial(LOOP, StiffPI())
    found = borders(trial, [BRIEF], ["takeover"], higher=3.0, lower=2.0, step=0.5)
    held = found["nominal", "takeover"]
    assert np.isnan(held.lowest_set_point) and held.why.startswith("nominal, seed 0, phase 0: stuck")


@given(st.integers(16, 129), st.integers(10, 123))
@settings(max_examples=40)
def test_a_window_of_a_rad_per_second_is_found_below_a_highest_set_point_that_fails(first, width):
    class Window(Cells):
        """A law that holds from one set-point to another, both on the grid, below 14 rad/s."""

        def outcome(self, trial, group, reference, way):
            return Outcome(first <= round(10.0 * reference) <= min(first + width, 139), why=f"at {reference:g}")

    held = lowest(Trial(LOOP, StiffPI()), BRIEF, cells=Window(), lower=1.5, higher=14.0, step=0.1, lasts=False)
    assert held.range == pytest.approx((first / 10.0, min(first + width, 139) / 10.0)) and held.why == f"at {first / 10.0 - 0.1:g}"


def test_a_window_is_told_and_drawn_with_both_ends():
    window = SetPointLimit(5.0, "stuck below", highest_set_point=9.0)
    found = LowestSetPoints(
        "StiffPI", {("PI", "nominal", "takeover"): window, ("PI", "noisy", "takeover"): SetPointLimit(5.0, "")}, (1.5, 14.0), 0.1
    )
    assert "5 to 9 " in str(found) and str(found).count(" to 9") == 1
    assert [line.get_xdata().tolist() for line in found.plot().lines if len(line.get_xdata()) == 2] == [[5.0, 9.0]]


def test_lifts_are_counted_and_their_price_is_told():
    group = dataclasses.replace(BRIEF, takeover_phases=(0.0,))
    outcome = Trial(closed_loop(PLANT, Sampled(Lifting(SoftTorque()), 0.01, 0.03)), StiffPI()).outcome(group, 5.0)
    assert outcome.passed and outcome.max_lifts >= 1.0 and 10.0 < outcome.recovery_time < 80.0 and outcome.time_above_setpoint == 0.0
    assert outcome.max_bit_speed > 10.0 and outcome.max_torque > 1e4


@pytest.mark.parametrize(
    ("loop", "arguments", "words"),
    [
        (closed_loop(PLANT, SoftTorque()), {}, "one sampled law that drives `top.torque`"),
        (closed_loop(PLANT), {}, "one sampled law"),
        (LOOP, {"groups": ["combind"]}, "There is no group `combind`: did you mean `combined`"),
        (LOOP, {"protocols": ["straight"]}, "There is no protocol `straight`"),
        (LOOP, {"step": -1.0}, "step"),
        (LOOP, {"executor": 2}, "Argument `executor` must be a concurrent.futures.Executor"),
        (LOOP, {"bounds": (5.0, 4.0)}, "bounds"),
        (LOOP.with_parameters({"softtorque.proportional": 400.0}), {}, "must be given to the law itself"),
        (closed_loop(compose(BlockOnBelt())), {}, "one sampled law that drives `top.torque`"),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(loop, arguments, words):
    with pytest.raises(SceneError, match=words):
        lowest_set_point(loop, StiffPI(), **arguments)


def test_the_command_writes_the_table_and_goes_on_where_it_was(tmp_path, capsys):
    call = [
        "setpoints",
        "studies/scenes/jansen_2.toml",
        "--controller",
        "softer PI, 100 Hz",
        "--controller",
        "constant torque",
        "--group",
        "nominal",
    ]
    call += ["--protocol", "takeover", "--range", "top.reference=80 rpm:120 rpm", "--step", "20 rpm", "--out", str(tmp_path / "drives")]
    assert main(call) == 0
    out, progress = capsys.readouterr()
    assert "under stiff PI" in out and "lowest [rpm]" in out and "`constant torque` must be one law" in out
    assert "cell 1 of 1: softer PI, 100 Hz, nominal, takeover, 100 rpm: holds" in progress
    assert progress.startswith("constant torque takes no part")  # said before the first run
    assert {each.name for each in (tmp_path / "drives").iterdir()} == {
        "setpoints.txt",
        "setpoints.csv",
        "setpoints.npz",
        "setpoints.png",
        "scene.toml",
        "cells.jsonl",
        "origin.json",
    }
    assert main(call) == 0
    again, progress = capsys.readouterr()
    assert again == out and "cell" not in progress
    assert main([*call, "--quiet", "--step", "10 rpm"]) == 0
    assert capsys.readouterr() == ("", "")


def test_a_table_leaves_out_what_no_law_does_and_says_where_it_was_tried_if_none_was_found(found):
    result, _, _ = found
    assert "lifts" not in str(result) and any("lifts" in head for head in result.rows[0])
    none = dataclasses.replace(result, entries={("SoftTorque", "nominal", "takeover"): SetPointLimit(np.nan, "stuck")})
    assert str(none).splitlines()[-1].split("takeover")[1].split() == ["none", "at", "110", "rpm:", "stuck"]
    ax = none.plot()  # the mark of what has none stands beside the axes, below a word that says so
    assert [text.get_text() for text in ax.texts] == ["none"] and ax.lines[0].get_xdata()[0] > ax.get_xlim()[1]
    assert not result.plot().texts


def test_the_command_says_at_once_which_law_takes_no_part(capsys):
    call = ["setpoints", "studies/scenes/jansen_2.toml", "--controller", "ideal sliding mode", "--group", "nominal"]
    assert main(call) == 2
    assert "`ideal sliding mode` must have a sampled form to take part, but IdealSlidingMode has none" in capsys.readouterr().err


def test_a_law_that_takes_weight_off_is_tried_on_machines_with_other_weights_and_its_price_is_told():
    law = Lifting(SoftTorque(), first_factor=1.3, factor_step=0.25, raise_rate=0.2, weight_relief=0.4)
    trial = Trial(closed_loop(PLANT, Sampled(law, 0.01, 0.03)), StiffPI())
    heavy = Machine("heavy", (("bit.weight", 1.1),))
    assert float(trial.steady(heavy, 5.0).number("weight.reference").value) == pytest.approx(1.1 * 97_347.0)
    outcome = trial.outcome(dataclasses.replace(BRIEF, machines=(heavy,), takeover_phases=(0.0,)), 6.0)
    assert outcome.passed and outcome.max_lifts >= 1.0 and outcome.relapses_per_hour == 0.0 and 0.02 < outcome.max_weight_relief < 0.4
    loop, _ = trial.takes_over(
        Machine("heave", weight_variation=Varying(0.1, 0.1)), machine_groups(LOOP)["varying_weight"], 6.0, "takeover", 101, 20.0
    )
    weight = simulate(loop, 300.0).at(np.arange(250.0, 300.0, 0.1))["bit.weight"]
    assert np.ptp(weight) == pytest.approx(0.2 * 97_347.0, rel=0.02)


def test_a_lift_that_comes_again_is_no_success_for_half_an_hour():
    calm = {"stuck": 0.0, "speed": 6.0, "torque": 5e3, "square": 25e6, "limited": 0.0}
    assert verdict({**calm, "relapses_per_hour": 2.0, "lifted": 0.01}, 6.0, 0.01) == ""
    assert verdict({**calm, "relapses_per_hour": 2.0, "lifted": 0.01}, 6.0, 0.01, lasting=True) == "lifted again"
    assert verdict({**calm, "relapses_per_hour": 2.0, "lifted": 0.01}, 6.0, 0.01, varying=True, lasting=True) == ""
    assert verdict({**calm, "relapses_per_hour": 2.0, "lifted": 0.03}, 6.0, 0.01, varying=True) == "lifted 3.0 % of the time"


def test_a_group_may_want_a_disk_margin_and_its_border_is_raised_until_there_is_one(found):
    held, path = found[0]["SoftTorque", "nominal"], found[1]
    step = 4 * np.pi / 30
    raised = dataclasses.replace(BRIEF, min_disk_margin=held.disk_margin + 1e-6)
    search = {"protocols": ["takeover"], "bounds": ("62 rpm", "110 rpm"), "step": "4 rpm", "checkpoint": path}
    more = lowest_set_point(LOOP, StiffPI(), [raised], **search)["SoftTorque", "nominal"]
    assert more.lowest_set_point == pytest.approx(held.lowest_set_point + step) and more.disk_margin > held.disk_margin
    assert more.why == f"nominal: disk margin {held.disk_margin:.3f}"
    none = lowest_set_point(LOOP, StiffPI(), [dataclasses.replace(BRIEF, min_disk_margin=1.9)], **search)["SoftTorque", "nominal"]
    assert np.isnan(none.lowest_set_point) and "disk margin" in none.why


def test_the_command_raises_borders_to_a_disk_margin_and_refuses_one_that_no_loop_has(tmp_path, capsys):
    call = [
        "setpoints",
        "studies/scenes/jansen_2.toml",
        "--controller",
        "softer PI, 100 Hz",
        "--group",
        "nominal",
        "--protocol",
        "takeover",
    ]
    call += ["--range", "top.reference=80 rpm:120 rpm", "--step", "20 rpm"]
    assert main([*call, "--margin", "1.99"]) == 0
    told = capsys.readouterr().out
    row = next(line for line in told.splitlines() if line.strip().startswith("softer PI, 100 Hz"))
    assert "nominal: disk margin" in row and row.split("takeover")[1].split()[0] == "none"
    assert main([*call, "--margin", "2.5"]) == 2
    assert "--margin" in capsys.readouterr().err


# --- who does the runs, and how far it is
@pytest.mark.slow
def test_laws_are_searched_side_by_side_with_the_same_result(tmp_path, capfd):
    call = ["setpoints", "studies/scenes/drives.toml", "--group", "nominal", "--group", "noisy", "--protocol", "takeover"]
    call += ["--range", "top.reference=60 rpm:120 rpm", "--step", "20 rpm"]
    assert main([*call, "--out", str(tmp_path / "one")]) == 0
    alone = capfd.readouterr()
    assert main([*call, "--processes", "2", "--out", str(tmp_path / "two")]) == 0
    both = capfd.readouterr()
    assert both.out.replace("two", "one") == alone.out and sorted(both.err.splitlines()) == sorted(alone.err.splitlines())
    kept = [sorted((tmp_path / name / "cells.jsonl").read_text().splitlines()) for name in ("one", "two")]
    assert kept[0] == kept[1] and len(kept[0]) > 4


def test_no_law_is_searched_by_no_process(capsys):
    assert main(["setpoints", "studies/scenes/jansen_2.toml", "--processes", "0"]) == 2
    assert "`--processes` must be an integer >= 1, but it is 0" in capsys.readouterr().err


SEARCH = {"protocols": ["takeover"], "bounds": ("62 rpm", "110 rpm"), "step": "4 rpm"}


class Counted(ThreadPoolExecutor):
    """Threads that count what they are given."""

    def __init__(self):
        super().__init__(2)
        self.given = 0

    def submit(self, *arguments, **named):
        self.given += 1
        return super().submit(*arguments, **named)


def test_an_executor_does_the_runs_and_finds_the_same(found):
    with Counted() as pool:
        assert repr(lowest_set_point(LOOP, StiffPI(), [BRIEF], **SEARCH, executor=pool)) == repr(found[0])
    assert pool.given >= len(found[2])


@contextmanager
def processes():
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        yield pool


@contextmanager
def dask():
    import distributed  # of the extra `dev`

    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client.get_executor()


@pytest.mark.slow
@pytest.mark.parametrize("executor", [processes, dask])
def test_other_processes_find_the_same(found, executor):
    with executor() as pool:
        assert repr(lowest_set_point(LOOP, StiffPI(), [BRIEF], **SEARCH, executor=pool)) == repr(found[0])


@dataclasses.dataclass(frozen=True)
class InPython(Controller):
    """u = 900 (reference - y) + 8900, which holds the bit there, at every sample by a call into Python."""

    reference: float = 9.0
    measured_signals = ("top.speed",)
    actuated_signals = ("top.torque",)

    def design(self, plant):
        return Called(self.reference)


class Called:
    """`InPython`, designed."""

    measured_signals, actuated_signals, dt = ("top.speed",), ("top.torque",), 0.1

    def __init__(self, reference):
        self.reference = reference

    def design(self, plant):
        return self

    def __call__(self, t, y):
        return 900.0 * (self.reference - y[0]) + 8900.0


@pytest.mark.slow
def test_runs_of_a_law_in_python_travel_too():
    class Local(Called):
        pass

    class Hidden(InPython):
        def design(self, plant):
            return Local(self.reference)

    law = closed_loop(PLANT, Sampled(InPython(), 0.1))
    here = Trial(law, StiffPI()).outcome(BRIEF, 9.0)
    with processes() as pool:
        assert repr(Trial(law, StiffPI(), pool).outcome(BRIEF, 9.0)) == repr(here)
        with pytest.raises(SceneError, match="must be importable"):
            Trial(closed_loop(PLANT, Sampled(Hidden(), 0.1)), StiffPI(), pool).outcome(BRIEF, 9.0)


def test_a_law_in_python_is_tried_on_another_plant_too():
    other = compose(wells.JANSEN_2, BitRock(weight=97_347.0, friction=Coulomb(0.8, 0.5)))
    trial, machine = Trial(closed_loop(PLANT, Sampled(InPython(), 0.1)), StiffPI()), Machine("Coulomb", plant=other)
    loop, _ = trial.takes_over(machine, BRIEF, 9.0, "takeover", 0, trial.takeover(9.0))
    (law,) = loop.designed_controllers
    assert isinstance(law.inside[0], Called)


class Told(Trial):
    """A trial of which is told at which set-points it fails, and at which smooth running grows, and that notes what it is asked."""

    def outcome(self, group, reference, way="takeover"):
        self.asked.append((reference, group.judged_time))
        return Outcome(reference not in (*self.failing, *(self.growing if group.judged_time > 80.0 else ())), "fails")

    def growth(self, machines, reference):
        return (1.0 if reference in self.growing else -1.0), "nominal"

    def disk_margins(self, machines, reference):
        return 1.0, 1.0, "nominal"


def told(failing, growing=()):
    trial = Told(LOOP, StiffPI())
    trial.__dict__.update(failing=failing, growing=growing, asked=[])
    return trial


def test_the_end_of_the_range_is_tried_where_nothing_fails_above_it():
    trial = told(())
    assert lowest(trial, BRIEF, lower=3.0, higher=6.0, step=1.0).lowest_set_point == 3.0
    held = lowest(told((3.0,)), BRIEF, lower=3.0, higher=6.0, step=1.0)
    assert (held.lowest_set_point, held.why) == (4.0, "fails")
    asked = told((4.0,))
    assert lowest(asked, BRIEF, lower=3.0, higher=6.0, step=1.0).lowest_set_point == 5.0
    assert 3.0 not in [reference for reference, _ in asked.asked]


def test_a_set_point_at_which_smooth_running_grows_is_not_confirmed_above_it():
    trial = told((3.0,), growing=(4.0,))
    held = lowest(trial, BRIEF, lower=2.0, higher=9.0, step=1.0)
    assert (held.lowest_set_point, held.why) == (5.0, "fails")
    assert (6.0, 80.0) not in trial.asked[: trial.asked.index((4.0, 1800.0))]
    assert {reference for reference, judged in trial.asked if judged > 80.0} == {4.0, 5.0}


def test_how_far_a_search_is_stands_in_every_line():
    said = []
    cells = Cells(say=said.append)
    borders(told((3.0,)), [BRIEF, dataclasses.replace(BRIEF, name="mine")], ["takeover", "ramp"], cells, 3.0, higher=6.0, step=1.0)
    assert [line.split(": ")[0] for line in said if "6 rad/s: holds" in line] == [f"cell {k} of 4" for k in (1, 2, 3, 4)]
    assert all(line.startswith("cell ") for line in said)
