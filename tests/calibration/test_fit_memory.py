"""Laws with memory are found from measured loops, of which speed or way was measured, within two per cent and within their intervals."""

from dataclasses import dataclass

import numpy as np
import pytest

from models import BlockOnBelt, Dahl, Exponential, LuGre, RateAndState
from toolbox import FrictionLaw, Quantity, SceneError, closed_loop, compose, fit, quantity, simulate

TIME = np.linspace(0.0, 20.0, 4001)
PUSH = {"block.force": (TIME, 3.0 * np.sin(2.0 * TIME) + 2.0 * np.sin(5.2 * TIME))}


@dataclass(frozen=True)
class Worn(FrictionLaw):
    """A law of a user: friction that falls by a half with the work that it does."""

    kinetic: Quantity = quantity(1.0, "1", "coefficient when new", above=0)
    life: Quantity = quantity(10.0, "m", "way over which it wears", above=0)
    stiffness: Quantity = quantity(100.0, "1/m", "of its bristles", above=0)

    def memory(self, directions):
        return {"deflection": ("m", (0.0,) * directions), "worn": ("1", 0.0)}

    def sliding(self, speed):
        return self.kinetic

    def breakaway(self):
        return self.kinetic

    def evolution(self, slip, speed, load, memory):
        z, worn = memory["deflection"], memory["worn"]
        bound = self.kinetic * (1 - 0.5 * worn)
        return self.stiffness * z, {"deflection": slip - self.stiffness * speed * z / bound, "worn": (1 - worn) * speed / self.life}


def block(law):
    return compose(BlockOnBelt(stiffness=50.0, belt_speed=0.0, friction=law))


def loop_of(law, seed=1, measured=("block.speed",), push=PUSH, start=None):
    """The loop of a block that is pushed, with noise of a two-hundredth in its force."""
    run = simulate(closed_loop(block(law), inputs=push, start=start), TIME[-1], output_times=TIME, accuracy=1e-9)
    force = run["belt.force"]
    noise = 0.005 * force.std() * np.random.default_rng(seed).standard_normal(force.size)
    return {"time": TIME, "belt.force": force + noise, **{name: run[name] for name in measured}}


LAWS = {
    "Dahl": (Dahl(stiffness=80.0, kinetic=1.2), Dahl(), ("stiffness", "kinetic")),
    "LuGre": (
        LuGre(stiffness=300.0, damping=2.0, steady=Exponential(static=1.2, kinetic=0.8, decay=5.0)),
        LuGre(stiffness=200.0, damping=1.0, steady=Exponential(static=1.0, kinetic=0.6, decay=3.0)),
        ("stiffness", "damping", "steady.static", "steady.kinetic", "steady.decay"),
    ),
    "rate and state": (
        RateAndState(base=0.8, direct=0.03, evolving=0.02, distance=0.02, speed=0.01, regularisation_speed=1e-6),
        RateAndState(base=0.6, direct=0.02, evolving=0.03, distance=0.04, speed=0.01, regularisation_speed=1e-6),
        ("base", "direct", "evolving", "distance"),
    ),
    "of a user": (Worn(kinetic=1.2, life=6.0, stiffness=80.0), Worn(), ("kinetic", "life", "stiffness")),
}


@pytest.mark.parametrize(  # the logarithm of a speed asks for the speed
    ("name", "measured"),
    [
        (name, speed)
        for name in LAWS
        for speed in ("block.speed", "block.position")
        if (name, speed) != ("rate and state", "block.position")
    ],
)
def test_a_law_with_memory_is_found_from_its_loop(name, measured):
    true, guess, fields = LAWS[name]
    free = [f"belt.friction.{field}" for field in fields]
    found = fit(block(guess), loop_of(true, measured=(measured,)), free, contact="belt", starts=1)
    truth = np.array([block(true).parameter(each) for each in free])
    assert np.abs(found.values / truth - 1).max() < 0.02, str(found)
    assert (np.abs(found.values - truth) < 4.0 * found.standard_errors).all(), str(found)
    assert found.plant.parameter(free[0]) == found[free[0]] and "with memory" in str(found)


def test_the_slopes_of_a_loop_with_memory_are_those_of_its_differences():
    true, guess, fields = LAWS["LuGre"]
    free = [f"belt.friction.{field}" for field in fields] + ["belt.deflection"]
    misfit = fit(block(guess), loop_of(true), free, contact="belt", starts=1).misfit
    values = np.array([200.0, 1.0, 1.0, 0.6, 3.0, 1e-3])
    exact = misfit.slopes(values, values)["belt.force"]
    for i, value in enumerate(values.tolist()):
        ahead, back = values.copy(), values.copy()
        ahead[i], back[i] = value * (1 + 1e-5), value * (1 - 1e-5)
        across = (misfit.model(ahead)["belt.force"] - misfit.model(back)["belt.force"]) / (2e-5 * value)
        assert np.abs(exact[:, i] - across).max() < 1e-5 * np.abs(across).max()


def test_the_start_of_the_memory_and_a_late_force_are_unknowns():
    true, guess, fields = LAWS["Dahl"]
    free = [f"belt.friction.{field}" for field in fields]
    data = loop_of(true, start={"belt.deflection": -0.01})
    found = fit(block(guess), data, [*free, "belt.deflection"], contact="belt", starts=1)
    assert abs(found["belt.deflection"] + 0.01) < 4 * found.standard_errors[2] < 0.001
    data["belt.force"] = np.interp(TIME - 0.05, TIME, data["belt.force"])
    late = fit(
        block(guess), data, [*free, "belt.deflection", "belt.force.shift"], {"belt.force.shift": (-0.5, 0.5)}, contact="belt", starts=1
    )
    assert late["belt.force.shift"] == pytest.approx(0.05, abs=1e-3)
    assert late[free[1]] == pytest.approx(1.2, rel=0.02)


def test_what_a_law_with_memory_needs_is_told():
    true, _, _ = LAWS["Dahl"]
    data = loop_of(true, measured=("block.speed", "block.position"))
    without = {name: values for name, values in data.items() if not name.startswith("block")}
    for bad, words in (
        (without, "must hold `block.speed`, which the friction of `belt` depends on"),
        ({name: data[name] for name in ("time", "block.speed")}, "exactly one signal with the force of `belt`"),
        ({**data, "block.speed": np.where((TIME > 5) & (TIME < 6), np.nan, data["block.speed"])}, "choose among the windows 0 .. 5 s, 6"),
    ):
        with pytest.raises(SceneError, match=words):
            fit(block(true), bad, "belt.friction.kinetic", contact="belt")
    with pytest.raises(SceneError, match="must hold parameters and the memory of `belt`"):
        fit(block(true), data, "block.position", contact="belt")


@pytest.mark.slow
def test_intervals_along_a_way_that_is_measured_seldom_hold_the_truth_with_what_is_said_of_the_samples():
    true, _, fields = LAWS["LuGre"]
    free = [f"belt.friction.{field}" for field in fields]
    truth = np.array([block(true).parameter(each) for each in free])
    time = np.linspace(0.0, 20.0, 1001)
    run = simulate(closed_loop(block(true), inputs=PUSH), 20.0, output_times=time, accuracy=1e-9)
    force, off = run["belt.force"], []
    for seed in range(20):
        noise = 0.002 * force.std() * np.random.default_rng(seed).standard_normal(force.size)
        data = {"time": time, "belt.force": force + noise, "block.position": run["block.position"]}
        found = fit(block(true), data, free, contact="belt", starts=1)
        off.append(np.abs(found.values - truth) / (found.interval_factor * found.standard_errors + np.abs(found.sampling_errors)))
    assert np.mean(np.array(off) <= 1.0) >= 0.95 and np.max(off) < 2.0
    assert np.abs(found.values[:2] / truth[:2] - 1.0).max() < 0.005  # of stiffness and damping
