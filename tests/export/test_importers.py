"""Machines in other people's simulators: the same switches as `simulate`, at times that become exact with the tolerance."""

import shutil
import sys

import pytest

from controllers import StiffPI
from models import BlockOnBelt
from tests.plants import RIG
from toolbox import Sampled, Scene, closed_loop, compose, export_fmu, simulate

pytest.importorskip("fmpy", reason="FMUs are loaded with fmpy, which is not here")
from studies.benchmarks.fmu_grazes import Graze, first_other, graze
from studies.benchmarks.fmu_masters import (
    by_co_simulation,
    by_cvode,
    by_ecos,
    by_libcosim,
    by_own_master,
    compared,
    parted,
    shift,
    switches_of,
)

pytestmark = pytest.mark.skipif(
    shutil.which("cc") is None or sys.platform != "linux", reason="an FMU is compiled with `cc`, which is not here"
)
LOOPS = {
    "belt": (closed_loop(compose(BlockOnBelt())), 100.0),
    "rig": (closed_loop(RIG, StiffPI(reference=4.7)), 60.0),
    "driven": (closed_loop(RIG, Sampled(StiffPI(reference=4.7), 0.01, delay=0.015)), 30.0),
}


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """(unit, duration [s], switches of `simulate`) of a loop, each made once."""
    folder, made = tmp_path_factory.mktemp("units"), {}

    def unit(name, version="2.0"):
        if (name, version) not in made:
            loop, duration = LOOPS[name]
            path = export_fmu(loop, folder / f"{name}{version[0]}.fmu", part="loop", duration=duration, version=version)
            made[name, version] = path, duration, switches_of(simulate(loop, duration, accuracy=1e-11))
        return made[name, version]

    return unit


def errors(master, case, settings):
    """Largest errors of switching times [s] at some settings; the switches must be the same."""
    path, duration, wanted = case
    found = []
    for setting in settings:
        mine, theirs, same, error = compared(master(path, duration, setting), wanted)
        assert mine == theirs == same > 2
        found.append(error)
    return found


@pytest.mark.parametrize("name", ["belt", "rig"])
def test_errors_in_a_master_that_locates_events_fall_tenfold_with_the_tolerance(exported, name):
    found = errors(by_own_master, exported(name), (1e-4, 1e-7, 1e-8, 1e-9))
    assert found[1] < 1e-3 * found[0] and found[2] < 0.15 * found[1] and found[3] < 0.15 * found[2]


@pytest.mark.parametrize("name", ["belt", "rig", "driven"])
def test_errors_with_cvode_fall_with_the_tolerance_by_more_than_500(exported, name):
    found = errors(by_cvode, exported(name), (1e-4, 1e-6, 1e-8))
    assert found[0] > found[1] > found[2] and found[2] < found[0] / 500.0


@pytest.mark.parametrize("name", ["belt", "driven"])
def test_switches_of_co_simulation_do_not_hang_on_the_communication_step(exported, name):
    assert max(errors(by_co_simulation, exported(name, "3.0"), (1.0, 0.1, 0.01))) < 1e-5


@pytest.mark.parametrize("master", [by_ecos, by_libcosim])
def test_other_importers_of_co_simulation_see_the_same_switches(exported, master):
    path, duration, wanted = exported("driven")
    try:
        found = master(path, duration, 0.01)
    except ImportError as error:
        pytest.skip(str(error))
    mine, theirs, same, error = compared(found, wanted)
    assert mine == theirs == same > 2 and error <= 0.01 + 1e-5


def test_runs_part_where_a_switch_is_missing_though_modes_agree():
    wanted = {"a": [(1.0, "stick"), (2.0, "slip+"), (2.1, "stick"), (3.0, "slip+")], "b": [(2.5, "open")]}
    late = {"a": [(time + 0.02, mode) for time, mode in wanted["a"]], "b": [(2.52, "open")]}
    without = {"a": [wanted["a"][0], *wanted["a"][3:]], "b": wanted["b"]}  # a slip that is not seen
    assert parted(late, wanted) == float("inf") and shift(late, wanted, 10.0) == pytest.approx(0.02)
    assert parted(without, wanted) == 2.0 and shift(without, wanted, 2.0) == 0.0
    assert parted({"a": wanted["a"], "b": []}, wanted) == 2.5


def test_the_first_switch_that_is_not_in_both_runs_is_told_apart_from_one_that_is_late():
    wanted = {"a": [(1.0, "open"), (1.01, "closed"), (3.0, "open"), (3.01, "closed"), (5.0, "open")]}
    late = {"a": [(time + 0.1, mode) for time, mode in wanted["a"]]}
    assert first_other(late, wanted) == (float("inf"), "")
    assert first_other({"a": wanted["a"][:1] + wanted["a"][3:]}, wanted) == (1.01, "a")
    assert first_other(wanted, {"a": wanted["a"][:2] + wanted["a"][4:]}) == (3.0, "a")
    assert first_other({"a": wanted["a"][:3]}, wanted) == (3.01, "a")


def test_a_graze_is_told_from_a_guard_that_goes_far():
    assert str(Graze("touch", 1.0, -2e-3, 1e-3)).startswith(
        "graze: `touch` at 1 s, whose guard turns 2.0e-03 of its size behind zero, turns 1.0e-03"
    )
    assert str(Graze("touch", 1.0, -float("inf"), 1e-3)).startswith("no graze") and str(Graze("touch", 1.0, -2e-3, 0.5)).startswith(
        "no graze"
    )


@pytest.mark.slow
def test_the_depth_of_a_graze_is_the_same_in_the_own_master_and_from_a_point_of_cvode(tmp_path):
    scene, duration = Scene.load("studies/scenes/bit_bounce.toml"), 8.0
    loop = scene[scene.labels[0]]
    path = export_fmu(loop, tmp_path / "unit.fmu", part="loop", duration=duration)
    found = by_cvode(path, duration, 1e-9)
    listed = found["bit.bottom"]
    assert graze(path, duration, 1e-9, found, found) is None
    i = min(range(0, len(listed), 2), key=lambda i: listed[i + 1][0] - listed[i][0])  # the shortest flight
    told = graze(path, duration, 1e-9, found | {"bit.bottom": listed[:i] + listed[i + 2 :]}, found)
    assert told.element == "bit.bottom" and told.time == pytest.approx(listed[i][0]) and -0.01 < told.exact < 0.0
    assert told.found == pytest.approx(told.exact, rel=0.1)


def test_a_sample_and_a_delayed_output_an_ulp_apart_are_one_instant_for_an_importer(tmp_path):
    period, delay = 0.01, 0.03
    assert any(k * period + delay != (k + 3) * period for k in range(40))  # neighbours among the floats
    loop = closed_loop(RIG, Sampled(StiffPI(reference=4.7), period, delay=delay))
    path = export_fmu(loop, tmp_path / "late.fmu", part="loop", duration=20.0)
    mine, theirs, same, error = compared(by_cvode(path, 20.0, 1e-8), switches_of(simulate(loop, 20.0, accuracy=1e-11)))
    assert mine == theirs == same > 2 and error < 1e-4


@pytest.mark.slow
def test_a_lift_off_of_less_than_a_millisecond_is_seen_from_a_tolerance_of_a_millionth_on(tmp_path):
    scene = Scene.load("studies/scenes/bit_bounce.toml")
    loop = scene[scene.labels[0]]
    case = export_fmu(loop, tmp_path / "unit.fmu", part="loop"), loop.duration, switches_of(simulate(loop, accuracy=1e-10))
    assert max(errors(by_cvode, case, (1e-6, 1e-8))) < 1e-2
    open_ = [time for time, _ in case[2]["bit.bottom"]]
    assert min(b - a for a, b in zip(open_[::2], open_[1::2], strict=False)) < 1e-3
