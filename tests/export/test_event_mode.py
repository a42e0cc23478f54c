"""The event mode of a machine as an FMU stands what importers do: they stop near a crossing, ask where nothing is due, and meet two events at one instant."""

import shutil
import sys

import numpy as np
import pytest

from controllers import StiffPI
from models import AxialChain, BitRock, BlockOnBelt, ElasticRock, wells
from tests.plants import RIG
from toolbox import Sampled, Scene, closed_loop, compose, export_fmu, simulate

pytest.importorskip("fmpy", reason="FMUs are loaded with fmpy, which is not here")
import fmpy

from studies.benchmarks.fmu_masters import exchanged, switches_of

pytestmark = pytest.mark.skipif(
    shutil.which("cc") is None or sys.platform != "linux", reason="an FMU is compiled with `cc`, which is not here"
)
STICK, BACKWARD, OPEN = 0, -1, 1


@pytest.fixture(scope="module")
def belt(tmp_path_factory):
    return export_fmu(compose(BlockOnBelt()), tmp_path_factory.mktemp("belt") / "belt.fmu", part="loop", duration=100.0)


def before(master, stop, time):
    """Go back by a time from a located event, along the slope there."""
    x = master.state()
    master.go(stop - time, x - time * master.slope(stop, x))
    master.unit.completedIntegratorStep()
    master.unit.enterEventMode()


def test_a_stop_just_before_a_crossing_is_that_crossing(belt):
    with exchanged(belt, 1e-10) as master:
        master.events(0.0)
        stop = master.smooth(0.0, 100.0)
        assert master.watch.modes == [BACKWARD]
        before(master, stop, 1e-8)
        master.events(stop - 1e-8)
        assert (
            master.watch.modes == [STICK] and master.indicator(stop, master.state()).min() > 0.1
        )  # far from the next one: no master stays here


def test_an_event_mode_with_nothing_to_do_changes_nothing(belt):
    with exchanged(belt, 1e-10) as master:
        master.events(0.0)
        stop = master.smooth(0.0, 100.0)
        before(master, stop, 1e-3)
        x = master.state()
        for _ in range(3):
            again, _, _, _, known, _ = master.unit.newDiscreteStates()
            assert not again and not known
        np.testing.assert_array_equal(master.state(), x)
        master.unit.enterContinuousTimeMode()
        assert master.watch.modes == [BACKWARD]
        assert master.smooth(stop - 1e-3, 100.0) == pytest.approx(stop, abs=1e-5)


def test_a_time_event_that_comes_an_ulp_early_is_that_event(tmp_path):
    loop = closed_loop(RIG, Sampled(StiffPI(reference=4.7), 0.01))
    with exchanged(export_fmu(loop, tmp_path / "rig.fmu", part="loop", duration=10.0), 1e-8) as master:
        following, torques = master.events(0.0), []
        for k in range(1, 40):
            assert following == pytest.approx(k * 0.01, abs=1e-12)
            early = np.nextafter(following, 0.0)
            master.smooth((k - 1) * 0.01, early)
            master.unit.enterEventMode()
            following = master.events(early)
            torques.append(master.read("top.torque"))
        assert len(set(torques)) == len(torques)  # a sample was taken at each


def test_an_input_that_changes_where_a_contact_lets_go_acts_at_that_instant(tmp_path):
    plant, torques = compose(wells.NAVARRO_LOPEZ_4, BitRock(weight=97_347.0)), (9000.0, 14_000.0)
    loop = closed_loop(plant, inputs={"top.torque": torques[0]})
    path = export_fmu(loop, tmp_path / "plain.fmu", part="loop", duration=20.0)
    with exchanged(path, 1e-9) as master:
        master.events(0.0)
        stop = master.smooth(0.0, 20.0)
        master.unit.enterEventMode()
        master.unit.setReal([master.references["top.torque"]], [torques[1]])
        master.events(stop)
        assert master.watch.switches["bit"][0] == (stop, "slip+")
        master.unit.enterEventMode()  # once more, with nothing to do
        master.run(20.0, stop)
        found, speed = master.watch.switches["bit"], master.read("bit.speed")
    run = simulate(closed_loop(plant, inputs={"top.torque": ((0.0, stop, stop, 20.0), np.repeat(torques, 2))}), 20.0, accuracy=1e-9)
    wanted = switches_of(run)["bit"]
    assert [mode for _, mode in found] == [mode for _, mode in wanted]
    assert max(abs(mine[0] - theirs[0]) for mine, theirs in zip(found, wanted, strict=True)) < 1e-5
    assert speed == pytest.approx(run.at(20.0)["bit.speed"], abs=1e-4)


def test_a_contact_that_has_just_opened_stays_open_however_small_its_gap(tmp_path):
    string = AxialChain(mass=(34e3,), stiffness=(), damping=(), hook_load=100e3)
    loop = closed_loop(compose(string, ElasticRock()), start={"bit.position": -0.01})
    with exchanged(export_fmu(loop, tmp_path / "drop.fmu", part="loop", duration=1.0), 1e-9) as master:
        master.events(0.0)
        stop = 0.0
        while "open" not in [mode for _, mode in master.watch.switches["bit.bottom"]]:
            stop = master.smooth(stop, 1.0)
            master.unit.enterEventMode()
            master.events(stop)
        x, slope = master.state(), master.slope(stop, master.state())
        rate = master.indicator(stop, x)[2]  # of its gap
        assert rate > 0.1
        for gap in 10.0 ** np.arange(-18.0, -6.0):
            master.go(stop + gap / rate, x + gap / rate * slope)
            master.unit.completedIntegratorStep()
            master.unit.enterEventMode()
            assert not master.unit.newDiscreteStates()[0]
            master.unit.enterContinuousTimeMode()
            assert master.unit.getInteger([master.references["bit.bottom.mode"]]) == [OPEN]


def test_slip_in_stick_is_exactly_zero_where_it_is_a_state(tmp_path):
    plant = compose(wells.NAVARRO_LOPEZ_4, BitRock(weight=97_347.0))
    loop = closed_loop(plant, inputs={"top.torque": 3000.0}, start={"chain.speed.0": 2.0})
    path = export_fmu(loop, tmp_path / "rig.fmu", part="loop", duration=1000.0)
    for tolerance in (1e-6, 1e-8):
        found = fmpy.simulate_fmu(
            str(path), stop_time=1000.0, output_interval=1.0, fmi_type="ModelExchange", output=["bit.speed", "bit.mode", "top.speed"],
            relative_tolerance=tolerance,
        )  # fmt: skip
        assert (found["bit.mode"] == STICK).all() and np.abs(found["top.speed"]).max() > 1.0
        assert (found["bit.speed"] == 0.0).all()


def test_slip_in_stick_stays_below_the_round_off_where_it_is_a_difference_of_states(tmp_path):
    scene = Scene.load("studies/scenes/two_disks.toml")
    loop = scene[scene.labels[0]]
    path = export_fmu(loop, tmp_path / "disks.fmu", part="loop", duration=1000.0)
    found = fmpy.simulate_fmu(
        str(path), stop_time=1000.0, output_interval=0.25, fmi_type="ModelExchange", output=["disks.slip", "disks.mode", "disks.rotor_speed"],
        relative_tolerance=1e-6,
    )  # fmt: skip
    stuck = found["disks.mode"] == STICK
    assert stuck.sum() > 100 and (~stuck).sum() > 50
    assert np.abs(found["disks.slip"][stuck]).max() < 1e-12 * np.abs(found["disks.rotor_speed"]).max()
