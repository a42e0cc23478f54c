"""Machines that Python steps from outside: the motion is that of `simulate`, whoever samples the law."""

import numpy as np
import pytest

from controllers import StiffPI
from models import BlockOnBelt
from tests.plants import RIG
from toolbox import Sampled, SceneError, closed_loop, compose, simulate, stepper

START = {"chain.speed": (4.0, 4.0), "chain.twist": (20.0,)}


def test_a_law_outside_moves_the_rig_as_the_same_law_inside_does():
    inside = simulate(closed_loop(RIG, StiffPI(reference=4.7), sample_time=0.01, start=START), 40.0)
    machine = stepper(closed_loop(RIG, start=START), "10 ms", inputs="top.torque", outputs=("top.speed", "bit.speed"), duration="40 s")
    seen, events, angle = machine.reset(), [], 0.0
    for _ in range(4000):
        error = 4.7 - seen[0]
        seen = machine.step(2e4 * error + 2e3 * angle)
        events += machine.events
        angle += 0.01 * error
    assert machine.time == pytest.approx(40.0) and len(events) > 6
    assert [event[1:] for event in events] == [tuple(event)[1:] for event in inside.events]
    np.testing.assert_allclose([event.time for event in events], [event.time for event in inside.events], atol=1e-4)
    assert seen[1] == pytest.approx(inside.at(40.0)["bit.speed"], abs=1e-3)


def test_a_reset_begins_anew_with_other_seeds_and_starts():
    loop = closed_loop(RIG, Sampled(StiffPI(reference=12.0), 0.01, noise={"top.speed": 0.05}))
    machine = stepper(loop, 0.1, outputs=("bit.speed", "top.torque"), duration=5.0)

    def episode(**given):
        return np.array([machine.reset(**given), *(machine.step() for _ in range(50))])

    first = episode()
    np.testing.assert_array_equal(first, episode())
    assert np.abs(episode(seed=5) - first).max() > 1.0
    other = episode(seed=0, start={"chain.speed.1": 3.0})
    assert other[0, 0] == 3.0 and first[0, 0] == 0.0
    run = simulate(loop.replace(start={"chain.speed": (0.0, 3.0)}), 5.0)
    np.testing.assert_allclose(other[1:, 0], run.at(np.linspace(0.1, 5.0, 50))["bit.speed"], atol=1e-4)


def test_a_parameter_that_is_set_acts_from_that_step_on():
    machine = stepper(compose(BlockOnBelt()), 0.5, inputs=("belt.friction.static",), outputs=("belt.force",), duration=30.0)
    machine.reset()
    held = [machine.step(1.0)[0] for _ in range(4)]
    machine.step(0.2)
    assert max(np.abs(held)) > 0.25 > abs(machine.step(0.2)[0])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"inputs": "top.torqe"}, "did you mean `top.torque`"), ({"outputs": "bit.sped"}, "bit.speed"), ({"period": -1.0}, "period"),
        ({"outputs": "chain.speed"}, "must name scalar signals"),
    ],
)  # fmt: skip
def test_wrong_names_and_numbers_are_told(arguments, words):
    with pytest.raises(SceneError, match=words):
        stepper(RIG, **({"period": 0.1} | arguments))


def test_wrong_values_and_closed_machines_are_told():
    machine = stepper(RIG, 0.1, inputs="top.torque", outputs="bit.speed")
    for values in ((), (1.0, 2.0), np.nan, "10 kN m", ["10 kN m"], None, [[1.0]]):
        with pytest.raises(SceneError, match="1 finite number"):
            machine.step(values)
    with pytest.raises(SceneError, match="chain.speed.1"):
        machine.reset(start={"chain.sped.1": 1.0})
    with pytest.raises(SceneError, match=r"`bit.friction.static` must be >= 0, but it is -0.1"):
        stepper(RIG, 0.1, inputs="bit.friction.static").step(-0.1)
    machine.close()
    with pytest.raises(SceneError, match="closed"):
        machine.step(1.0)


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space")
def test_an_environment_passes_the_checker_of_gymnasium_and_ends_on_time():
    checker = pytest.importorskip("gymnasium.utils.env_checker")
    from toolbox.export.environment import environment

    def reward(signals, events):
        return -abs(signals["bit.speed"] - 5.0) - len(events)

    made = environment(
        RIG, "50 ms", "2 s", actions={"top.torque": ("0 kN m", "20 kN m")}, observations={"top.speed": (-50.0, 50.0), "bit.speed": (-50.0, 50.0)},
        reward=reward, start=lambda rng: {"chain.speed.0": rng.uniform(0.0, 5.0)},
    )  # fmt: skip
    checker.check_env(made, skip_render_check=True)
    made.reset(seed=1)
    steps, late = 0, False
    while not late:
        seen, gain, ended, late, about = made.step(np.array([30e3]))  # cut off at 20 kN m
        steps += 1
    assert steps == 40 and about["time"] == pytest.approx(2.0) and not ended
    assert gain == pytest.approx(-abs(seen[1] - 5.0) - len(about["events"]))
    assert made.machine.step(20e3) is not None
    with pytest.raises(SceneError, match="range of `top.torque`"):
        environment(RIG, 0.1, 1.0, actions=["top.torque"], observations={"bit.speed": (-1.0, 1.0)}, reward=reward)
