"""Derivatives through sampled laws: sample, update, hold and delay, with stick and slip between them, against closed forms and central differences."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import minimize

from controllers import PI, StiffPI
from models import BlockOnBelt, Coulomb
from tests.plants import RIG
from toolbox import Component, Controller, Equations, Sampled, SceneError, Update, compose, measure, quantity, sensitivity, simulate, state
from toolbox.errors import GrazingError

START = {"chain.speed.0": 9.0, "chain.speed.1": 5.0}


def differenced(of, values, name, by=1e-6):
    """Central difference of `of({name: value})` with respect to one of the named values."""
    step = by * (abs(values[name]) or 1.0)
    return (of({**values, name: values[name] + step}) - of({**values, name: values[name] - step})) / (2 * step)


@dataclass(frozen=True)
class Cart(Component):
    """x' = u."""

    def equations(self, signal):
        x = state("cart.position", "m")
        return Equations(flow={x: signal("cart.speed", "m/s", default=0.0)})


@dataclass(frozen=True)
class Proportional(Controller):
    """u = gain (reference - x)."""

    measured_signals, actuated_signals = ("cart.position",), ("cart.speed",)
    gain: float = quantity(2.0, "1/s", "gain")
    reference: float = quantity(0.0, "m", "set-point")

    def sampled(self, signal, period):
        return Update({}, {"cart.speed": (self.gain * (self.reference - signal("cart.position", "m")), "m/s")})


def test_a_sampled_integrator_has_the_derivatives_of_its_geometric_series():
    # x_n = r + (1 - K h)^n (x_0 - r)
    gain, h, n, x0, r = 2.0, 0.1, 7, 1.5, 0.4
    run = simulate(compose(Cart()), n * h, start={"cart.position": x0}, controller=Proportional(gain, r), sample_time=h, accuracy=1e-12)
    law = next(name for name in run.program.system.parameters if name.endswith(".gain")).rpartition(".")[0]
    exact = sensitivity(run, (f"{law}.gain", f"{law}.reference", "cart.position"))
    factor = 1 - gain * h
    theory = [-n * h * factor ** (n - 1) * (x0 - r), 1 - factor**n, factor**n]
    np.testing.assert_allclose(exact.end("cart.position"), theory, rtol=1e-12)
    held = simulate(
        compose(Cart()), (n + 0.5) * h, start={"cart.position": x0}, controller=Proportional(gain, r), sample_time=h, accuracy=1e-12
    )
    slope = sensitivity(held, (f"{law}.gain",)).end("cart.speed")
    np.testing.assert_allclose(slope, -(factor**n) * (x0 - r) + n * h * gain * factor ** (n - 1) * (x0 - r), rtol=1e-12)


NAMES = (
    "stiffpi.proportional",
    "stiffpi.integral",
    "stiffpi.reference",
    "bit.weight",
    "chain.stiffness.0",
    "chain.speed.1",
    "stiffpi.angle",
)


def drilled(values, *, duration=14.0, period=0.05, **sampled):
    """A run of Jansen's rig under a sampled stiff PI with the given numbers."""
    law = StiffPI(**{name: values[f"stiffpi.{name}"] for name in ("proportional", "integral", "reference")})
    return simulate(
        RIG, duration, start={**START, "chain.speed.1": values["chain.speed.1"], "stiffpi.angle": values["stiffpi.angle"]}, accuracy=1e-12,
        parameters={"bit.weight": values["bit.weight"], "chain.stiffness": (values["chain.stiffness.0"],)}, controller=Sampled(law, period, **sampled),
    )  # fmt: skip


VALUES = dict(zip(NAMES, (2e4, 2e3, 9.9, 97_347.0, 473.0, 5.0, 3.0), strict=True))


@pytest.mark.parametrize(
    "sampled", [{}, {"delay": 0.02}, {"delay": 0.12}, {"noise": {"top.speed": 0.05}, "seed": 3}], ids=["hold", "late", "two late", "noise"]
)
def test_derivatives_of_a_drill_string_under_a_sampled_drive_agree_with_differences(sampled):
    run = drilled(VALUES, **sampled)
    assert len(run.events) >= 3
    exact = sensitivity(run, NAMES)

    def ends(values):
        other = drilled(values, **sampled)
        return np.concatenate([other.states[-1], other.held[-1, :2], [e.time for e in other.events]])

    for j, name in enumerate(NAMES):
        found = differenced(ends, VALUES, name, by=1e-5)  # a torque of 1e4 N m has a round-off that a smaller step would show
        mine = np.concatenate(
            [exact.states[-1][:, j], [exact["top.torque"][-1, j], exact["stiffpi.angle"][-1, j]], exact.event_times[:, j]]
        )
        np.testing.assert_allclose(mine, found, atol=1e-6 * np.abs(found).max(), err_msg=name)
    found = differenced(lambda values: drilled(values, **sampled).time_in("bit", "stick"), VALUES, "bit.weight")
    np.testing.assert_allclose(exact.time_in("bit", "stick")[3], found, rtol=1e-5)


def test_output_times_between_samples_have_the_derivatives_of_the_same_instants():
    times = np.linspace(0.0, 14.0, 29)
    run = drilled(VALUES)
    some = simulate(
        RIG,
        14.0,
        start={**START, "stiffpi.angle": 3.0},
        controller=Sampled(StiffPI(reference=9.9), 0.05),
        accuracy=1e-12,
        output_times=times,
    )
    exact = sensitivity(some, ("stiffpi.proportional", "bit.weight"))
    np.testing.assert_allclose(exact["bit.speed"][-1], sensitivity(run, ("stiffpi.proportional", "bit.weight"))["bit.speed"][-1], rtol=1e-9)
    found = differenced(lambda values: drilled(values).at(times)["bit.speed"], VALUES, "bit.weight")
    np.testing.assert_allclose(exact["bit.speed"][:, 1], found, atol=1e-6 * np.abs(found).max())


@dataclass(frozen=True)
class Reference(Controller):
    """A slow outer law that moves the set-point by what the bit lacks: reference = base + gain (base - bit speed)."""

    measured_signals, actuated_signals = ("bit.speed",), ("top.reference",)
    base: float = quantity(9.9, "rad/s", "set-point of the bit")
    gain: float = quantity(0.1, "1", "gain")

    def sampled(self, signal, period):
        return Update({}, {"top.reference": (self.base + self.gain * (self.base - signal("bit.speed", "rad/s")), "rad/s")})


def test_a_law_that_reads_what_another_holds_and_limits_of_torque_are_differentiated():
    values = {"gain": 0.1, "proportional": 3000.0, "highest": 14_000.0}

    def run(numbers):
        inner = PI(proportional=numbers["proportional"], integral=500.0, lowest_torque=0.0, highest_torque=numbers["highest"])
        laws = [Sampled(Reference(gain=numbers["gain"]), 0.13), Sampled(inner, 0.03)]
        return simulate(RIG, 16.0, start=START, controller=laws, accuracy=1e-12)

    here = run(values)
    torque = here["top.torque"]
    assert torque.max() == 14_000.0 and torque.min() < 13_999.0 and len(here.events) >= 2  # it meets its limit and leaves it
    outer = next(name for name in here.program.system.parameters if name.endswith(".gain"))
    exact = sensitivity(here, (outer, "pi.proportional", "pi.highest_torque"))

    def ends(numbers):
        other = run(numbers)
        return np.concatenate([other.states[-1], [e.time for e in other.events]])

    for j, name in enumerate(values):
        found = differenced(ends, values, name)
        mine = np.concatenate([exact.states[-1][:, j], exact.event_times[:, j]])
        np.testing.assert_allclose(mine, found, atol=1e-6 * np.abs(found).max(), err_msg=name)


@dataclass(frozen=True)
class Staircase(Controller):
    """A force that rises by `rise` at every sample, and remembers how far it is."""

    measured_signals, actuated_signals = (), ("block.force",)
    rise: float = quantity(0.3, "N", "rise")

    def sampled(self, signal, period):
        force = state("stairs.force", "N")
        return Update({force: force + self.rise}, {"block.force": (force, "N")})


def test_a_release_by_a_step_of_force_keeps_its_time_and_passes_derivatives_on():
    plant = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=1.0, kinetic=0.6)))
    values = {"rise": 0.3, "friction": 1.0, "stiffness": 1.0}

    def run(numbers):
        parameters = {"belt.friction.static": numbers["friction"], "block.stiffness": numbers["stiffness"]}
        return simulate(plant, 3.3, parameters=parameters, controller=Staircase(rise=numbers["rise"]), sample_time=0.5, accuracy=1e-12)

    here = run(values)
    assert here.events[0].time == 2.0  # 4 rises are 1.2 N, 3 are 0.9 N
    name = next(name for name in here.program.system.parameters if name.endswith(".rise"))
    exact = sensitivity(here, (name, "belt.friction.static", "block.stiffness"))
    assert exact.event_times[0].tolist() == [0.0, 0.0, 0.0]
    for j, key in enumerate(values):
        np.testing.assert_allclose(exact.states[-1][:, j], differenced(lambda v: run(v).states[-1], values, key), atol=1e-7)


def test_an_event_that_meets_a_sample_is_refused_and_one_beside_it_is_not():
    # from x = 0 at belt speed v the block sticks until k x = F_s: t = F_s / (k v) = 1 s
    @dataclass(frozen=True)
    class Weak(Controller):
        measured_signals, actuated_signals = ("block.position",), ("block.force",)
        gain: float = quantity(0.0, "N/m", "gain")

        def sampled(self, signal, period):
            return Update({}, {"block.force": (self.gain * signal("block.position", "m"), "N")})

    plant = compose(BlockOnBelt(belt_speed=0.5, stiffness=2.0, friction=Coulomb(static=1.0, kinetic=0.6)))
    start = {"block.speed": 0.5}
    meeting = simulate(plant, 2.0, start=start, controller=Weak(), sample_time=0.5, accuracy=1e-12)
    with pytest.raises(GrazingError, match="`belt` switches at a sample"):
        sensitivity(meeting, "block.stiffness")
    beside = simulate(plant, 2.0, start=start, controller=Weak(), sample_time=0.499, accuracy=1e-12)
    np.testing.assert_allclose(sensitivity(beside, "block.stiffness").event_times[0], [-0.5], rtol=1e-9)
    # four rises of a quarter of the static friction reach it exactly
    plant = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=1.0, kinetic=0.6)))
    just = simulate(plant, 3.3, controller=Staircase(rise=0.25), sample_time=0.5)
    with pytest.raises(GrazingError, match="just to its bound"):
        sensitivity(just, "block.stiffness")


def test_what_has_no_derivative_is_named():
    def law(t, y):
        return 1e4

    with pytest.raises(SceneError, match="Python"):
        sensitivity(simulate(RIG, 1.0, controller=law, sample_time=0.1), "bit.weight")
    with pytest.raises(SceneError, match="encoder"):
        coarse = Sampled(StiffPI(reference=5.0), 0.1, resolution={"top.speed": 0.01})
        sensitivity(simulate(RIG, 1.0, controller=coarse), "bit.weight")
    run = simulate(RIG, 1.0, controller=StiffPI(reference=5.0), sample_time=0.1)
    with pytest.raises(SceneError, match="sample time"):
        sensitivity(run, "stiffpi.sample_time")
    with pytest.raises(SceneError, match=r"stiffpi\.gain"):
        sensitivity(run, "stiffpi.gain")


GAINS = ("pi.proportional", "pi.integral")


def stepped(gains, accuracy=1e-10):
    """A step of the set-point from 9 to 10 rad/s under a sampled PI, from steady drilling at 9 rad/s."""
    law = PI(proportional=gains[0], integral=gains[1], reference=10.0)
    twist = (50.0 * 9.0 + 97_347.0 * 0.155575 * (0.5 + 0.3 * np.exp(-0.9 * 9.0))) / 473.0
    start = {"chain.speed": (9.0, 9.0), "chain.twist": twist, "pi.angle": (425.0 * 9.0 + 473.0 * twist - gains[0]) / gains[1]}
    return simulate(RIG, 40.0, start=start, controller=law, sample_time=0.1, accuracy=accuracy)


def slopes(gains, measured):
    """Derivatives of a measure of `stepped` with respect to the gains; the memory with which it starts depends on them."""
    exact = sensitivity(stepped(gains), (*GAINS, "pi.angle"))
    start = float(stepped(gains).at(0.0)["pi.angle"])
    p, i, angle = measured(exact)
    return np.array([p - angle / gains[1], i - angle * start / gains[1]])


def test_the_mean_square_error_and_the_settling_time_have_the_derivatives_that_differences_show():
    gains = (1500.0, 600.0)
    for value, derivative in (
        (
            lambda run: measure.mean_square(run, "bit.speed", 10.0, after=0.03),
            lambda exact: exact.mean_square("bit.speed", 10.0, after=0.03),
        ),
        (lambda run: measure.settling(run, "bit.speed", 10.0), lambda exact: exact.settling("bit.speed", 10.0)),
    ):
        found = []
        for j in range(2):
            by = np.zeros(2)
            by[j] = 1e-5 * gains[j]
            found.append((value(stepped(gains + by, 1e-12)) - value(stepped(gains - by, 1e-12))) / (2 * by[j]))
        np.testing.assert_allclose(slopes(gains, derivative), found, rtol=1e-6)
    # a signal that jumps at an event: the event's own time counts
    torque = differenced(lambda values: measure.mean_square(drilled(values), "bit.torque", 5e3), VALUES, "bit.weight")
    np.testing.assert_allclose(sensitivity(drilled(VALUES), "bit.weight").mean_square("bit.torque", 5e3), [torque], rtol=1e-6)
    with pytest.raises(SceneError, match="settles during the run"):
        sensitivity(drilled(VALUES), "bit.weight").settling("bit.speed", 9.9)


def test_gains_of_a_sampled_pi_are_tuned_by_the_gradient():
    begin = np.array([1500.0, 600.0])
    scale = begin

    def cost(z):
        return measure.mean_square(stepped(z * scale), "bit.speed", 10.0)

    def gradient(z):
        return slopes(z * scale, lambda exact: exact.mean_square("bit.speed", 10.0)) * scale

    found = minimize(cost, np.ones(2), jac=gradient, method="L-BFGS-B", bounds=[(0.2, 5.0)] * 2, options={"maxiter": 12})
    assert found.fun < 0.8 * cost(np.ones(2))
    for factor in (0.9, 1.1):  # no neighbour is better
        for direction in (np.array([factor, 1.0]), np.array([1.0, factor])):
            assert cost(np.clip(found.x * direction, 0.2, 5.0)) >= found.fun * (1 - 1e-6)


def test_a_continuous_law_and_its_fast_sampled_form_have_nearly_the_same_derivatives():
    law = dataclasses.replace(StiffPI(reference=9.9), proportional=3000.0)
    names = ("stiffpi.proportional", "bit.weight")
    smooth = sensitivity(simulate(RIG, 6.0, start=START, controller=law, accuracy=1e-10), names)
    fast = sensitivity(simulate(RIG, 6.0, start=START, controller=law, sample_time=0.002, accuracy=1e-10), names)
    np.testing.assert_allclose(fast.end("bit.speed"), smooth.end("bit.speed"), rtol=0.02)
