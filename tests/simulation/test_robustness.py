"""What must not happen to a user: pulses stepped over, friction that drives, results lost, things that cannot travel."""

import copy
import pickle
import threading

import casadi as ca
import numpy as np
import pytest

from controllers import PI
from models import BitRock, BlockOnBelt, wells
from toolbox import Sampled, SceneError, SimulationError, compose, simulate, time


@pytest.fixture(scope="module")
def rig():
    return compose(wells.JANSEN_2, BitRock())


@pytest.mark.parametrize("width", [1.0, 3.0])
def test_a_pulse_in_a_formula_is_not_stepped_over_from_rest(width):
    # a strong pulse of force: the block, held by friction 1 N and a spring, must move; its impulse is F sqrt(pi) width
    plant = compose(BlockOnBelt(belt_speed=0.0))
    run = simulate(plant, 100.0, inputs={"block.force": 1e4 * ca.exp(-(((time - 50) / width) ** 2))})
    assert np.abs(run["block.position"]).max() > 1000.0
    assert run.error_estimate < 1e-5


def test_a_load_that_a_formula_or_a_law_makes_negative_is_an_error_that_says_when(rig):
    with pytest.raises(SimulationError, match=r"`bit` must be >= 0.*t = "):
        simulate(rig, 30.0, inputs={"top.torque": 1.5e4, "bit.weight": 5e4 * ca.cos(time)})

    def lifting(t, y):
        return -1e5 if t > 5 else 5e4

    lifting.measured_signals, lifting.actuated_signals = ("bit.speed",), ("bit.weight",)
    with pytest.raises(SimulationError, match=r"`bit` must be >= 0") as caught:
        simulate(rig, 30.0, inputs={"top.torque": 1.5e4}, controller=lifting, sample_time=0.1)
    assert caught.value.run is not None


def test_a_delayed_signal_has_its_default_until_the_first_output_arrives(rig):
    def weight(t, y):
        return 5e4

    weight.measured_signals, weight.actuated_signals = ("bit.speed",), ("bit.weight",)
    run = simulate(rig, 2.0, controller=Sampled(weight, 0.1, delay=0.5))
    assert run.at(0.3)["bit.weight"] == 97_347.0
    assert run.at(0.7)["bit.weight"] == 5e4


def test_a_law_that_cannot_be_copied_runs_as_it_is(rig):
    class Locked:
        measured_signals, actuated_signals = ("top.speed",), ("top.torque",)

        def __init__(self):
            self.lock = threading.Lock()

        def __call__(self, t, y):
            return 1e4

    assert simulate(rig, 1.0, controller=Locked(), sample_time=0.1).at(0.5)["top.torque"] == 1e4


def test_an_exception_of_a_law_carries_the_run_so_far(rig):
    def failing(t, y):
        return 1e4 / (1.0 if t < 0.55 else 0.0)

    with pytest.raises(ZeroDivisionError) as caught:
        simulate(rig, 2.0, controller=failing, sample_time=0.1)
    assert caught.value.run.end == pytest.approx(0.6)


@pytest.mark.filterwarnings("ignore::toolbox.errors.UnusualValue")  # no machine, but numbers that the engine must survive
def test_a_delay_far_beyond_the_run_costs_nothing(rig):
    run = simulate(rig, 1.0, controller=Sampled(PI(), 1e-3, delay=1e6))
    assert np.all(run["top.torque"] == 0.0)


def test_plants_runs_and_errors_travel_between_processes(rig):
    plant = pickle.loads(pickle.dumps(rig.with_parameters({"bit.weight": 9e4})))
    assert plant.parameter("bit.weight") == 9e4
    run = simulate(rig, 20.0, controller=PI(), sample_time=0.01)
    twin = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(twin["bit.torque"], run["bit.torque"])
    assert twin.events == run.events and twin.at(12.5)["bit.speed"] == run.at(12.5)["bit.speed"]
    assert copy.deepcopy(rig).parameter("bit.weight") == rig.parameter("bit.weight")
    error = pickle.loads(pickle.dumps(SimulationError("lost", run)))
    assert str(error) == "lost" and error.run.end == 20.0


def test_modes_are_known_at_any_time_and_unknown_elements_are_errors(rig):
    run = simulate(rig, 20.0, inputs={"top.torque": 1e4})
    assert run.at(1.0).modes["bit"][0] == "stick"
    with pytest.raises(SceneError, match="did you mean `bit`"):
        run.modes["bitt"]
    with pytest.raises(SceneError, match="after"):
        run.time_in("bit", "stick", after=float("nan"))
    with pytest.raises(SceneError, match="must be <= 20 s, but it is 100"):
        run.time_in("bit", "stick", after=100.0)
    with pytest.raises(SceneError, match="time"):
        run.at([[1.0, 2.0], [3.0, 4.0]])


def test_tables_may_be_lists_or_arrays(rig):
    for table in (([0.0, 5.0], [0.0, 1e4]), [[0.0, 5.0], [0.0, 1e4]], np.array([[0.0, 5.0], [0.0, 1e4]])):
        assert simulate(rig, 5.0, inputs={"top.torque": table}).at(2.5)["top.torque"] == pytest.approx(5e3)


def test_recorded_slips_keep_the_sign_of_their_mode(rig):
    run = simulate(rig, 60.0, inputs={"top.torque": 1e4})
    assert np.all(run["bit.slip"][run.modes["bit"] == "slip+"] >= 0.0)


def test_a_run_on_a_grid_repeats_the_answers_of_a_law_and_never_asks_it_again(rig):
    calls = []

    def counting(t, y):
        calls.append(t)
        return 1e3 * len(calls)

    counting.measured_signals, counting.actuated_signals = ("top.speed",), ("top.torque",)
    run = simulate(rig, 1.0, controller=counting, sample_time=0.1, output_times=[0.0, 0.5, 1.0])
    held = run["top.torque"]
    np.testing.assert_array_equal(run.at([0.0, 0.5, 1.0])["top.torque"], held)
    assert len(calls) == 10
