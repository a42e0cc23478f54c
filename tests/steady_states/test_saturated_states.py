"""Steady states of machines with limits: a search passes rate limits and saturations, and ends where the limits as declared have it."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

from controllers import HeldSpeed
from models import BrakeActuator, DiscBrake, Tabulated
from toolbox import Component, Equations, closed_loop, compose, equilibrium, quantity, severity_map, state
from toolbox.errors import NoSteadyState, SceneError
from toolbox.steady_states.running import running

CURVE = Tabulated(speeds=(0.0, 0.05, 0.2, 0.6, 1.5, 4.0), coefficients=(0.46, 0.45, 0.43, 0.40, 0.385, 0.38), static=0.46)
BRAKE = compose(DiscBrake(force=0.0, wheel_radius="300 mm", radius="115 mm", friction=CURVE), BrakeActuator())


def limited(value, limit):
    return ca.fmin(ca.fmax(value, -limit), limit)


@dataclass(frozen=True)
class Servo(Component):
    """A mass on a spring, pushed by a valve and a cylinder in a row, each with a lag, a limit and a rate limit; a controller holds the position.

        f1' = clip((sat(u, size_1) - f1) / lag_1, rate_1),   f2' = clip((sat(f1, size_2) - f2) / lag_2, rate_2)
        m x'' = f2 + push - k x - c x',   u = gain (reference - x)
    """  # fmt: skip

    kind: str = "clip"
    lags: tuple[float, float] = quantity((0.01, 0.05), "s", "lags")
    rates: tuple[float, float] = quantity((10.0, 10.0), "N/s", "rate limits")
    sizes: tuple[float, float] = quantity((1e3, 1e3), "N", "limits")
    stiffness: float = quantity(1e3, "N/m", "stiffness of the spring")
    gain: float = quantity(0.0, "N/m", "gain of the controller")

    def equations(self, signal):
        first, second, x, v = (
            state("servo.valve", "N"),
            state("servo.force", "N"),
            state("servo.position", "m"),
            state("servo.speed", "m/s"),
        )
        asked = signal("servo.command", "N", default=0.0) + self.gain * (signal("servo.reference", "m", default=0.0) - x)
        before, flow = asked, {}
        for force, lag, rate, size in zip((first, second), self.lags, self.rates, self.sizes, strict=True):
            wanted = limited(before, size) if self.kind == "clip" else size * ca.tanh(before / size)
            flow[force] = limited((wanted - force) / lag, rate)
            before = force
        return Equations(flow={**flow, x: v, v: second + signal("servo.push", "N", default=0.0) - self.stiffness * x - 20.0 * v})


def at_rest(servo, command, reference, push, kind):
    """Position at which the forces of a servo are in balance, by halving: its force falls with the position, and the spring rises."""

    def saturated(value, size):
        return np.clip(value, -size, size) if kind == "clip" else size * np.tanh(value / size)

    low, high = -1e6, 1e6
    for _ in range(200):
        x = 0.5 * (low + high)
        force = saturated(saturated(command + servo.gain * (reference - x), servo.sizes[0]), servo.sizes[1])
        low, high = (x, high) if force + push > servo.stiffness * x else (low, x)
    return x


@pytest.mark.parametrize("kind", ["clip", "tanh"])
@pytest.mark.parametrize("seed", range(20))
def test_a_drawn_actuator_with_limits_and_rate_limits_has_the_steady_state_of_its_balance(kind, seed):
    rng = np.random.default_rng(seed)

    def drawn(low, high):
        return float(10.0 ** rng.uniform(np.log10(low), np.log10(high)))

    servo = Servo(
        kind=kind,
        lags=(drawn(1e-4, 1.0), drawn(1e-4, 1.0)),
        rates=(drawn(1.0, 1e5), drawn(1.0, 1e5)),
        sizes=(drawn(10.0, 1e4), drawn(10.0, 1e4)),
        stiffness=drawn(10.0, 1e5),
        gain=0.0 if seed % 3 == 0 else drawn(10.0, 1e5),
    )
    values = [float(v) for v in rng.choice([-1.0, 1.0], 3) * 10.0 ** rng.uniform([0.0, -3.0, 0.0], [5.0, 1.0, 4.0])]
    inputs = dict(zip(("servo.command", "servo.reference", "servo.push"), values, strict=True))
    expected = at_rest(servo, *values, kind)
    size = abs(expected) + (abs(values[0]) + servo.gain * abs(values[1])) / (servo.gain + servo.stiffness)
    guesses = [None, *({"servo.valve": a, "servo.force": b, "servo.position": c} for a, b, c in rng.normal(size=(3, 3)) * [1e5, 1e5, 10.0])]
    for guess in guesses:
        rest = equilibrium(closed_loop(compose(servo), inputs=inputs), guess=guess)
        assert rest["servo.position"] == pytest.approx(expected, abs=1e-8 * size)
        assert rest["servo.speed"] == pytest.approx(0.0, abs=1e-8 * size)


@pytest.mark.parametrize("command", [0.2e3, 3.1e3, 7.9e3, 12e3])
@pytest.mark.parametrize("guess", [None, {"actuator.force": 5e4}, {"actuator.force": -3e3, "disc.car_speed": 40.0}])
def test_a_held_brake_is_pressed_as_commanded_up_to_the_highest_force_however_far_the_guess(command, guess):
    rest = equilibrium(closed_loop(BRAKE, HeldSpeed(reference=6.0), inputs={"actuator.command": command}), guess=guess)
    force = min(command, 8e3)
    coefficient = np.interp(6.0 * 0.115, (0.6, 1.5), (0.40, 0.385))
    assert rest["brake.force"] == pytest.approx(force, rel=1e-12)
    assert rest["disc.speed"] == pytest.approx(6.0, rel=1e-12)
    assert rest["brake.torque"] == pytest.approx(2.0 * coefficient * force * 0.115, rel=1e-12)


def test_groan_of_a_brake_with_a_rate_limit_is_mapped_beyond_the_highest_force():
    loop = closed_loop(BRAKE, HeldSpeed(reference=6.0), element="pad")
    found = severity_map(loop, {"car.reference": (0.9, 3.0), "actuator.command": ("0.2 kN", "20 kN")}, shape=(2, 4), halvings=0)
    forces, falls = np.minimum(found.axes[1], 8e3), np.array([(0.43 - 0.40) / 0.4, (0.40 - 0.385) / 0.9])
    expected = (2.0 * falls[:, None] * forces - 200.0) / (2.0 * 10.0)  # of the pad alone, beside a disc of 36 kg m2
    np.testing.assert_allclose(found.growth[:, 1:], expected[:, 1:], rtol=1e-3)
    assert (expected[:, 0] < found.growth[:, 0]).all() and (found.growth[:, 0] < -2.0).all()  # the least damped motion is that of the drive


def test_the_input_that_keeps_a_speed_is_found_past_a_rate_limit():
    coefficient = np.interp(6.0 * 0.115, (0.6, 1.5), (0.40, 0.385))
    held = running(closed_loop(BRAKE, inputs={"actuator.command": 3100.0}), {"disc.speed": 6.0}, "disc.torque")
    assert held["disc.torque"] == pytest.approx(2.0 * 0.115 * coefficient * 3100.0, rel=1e-12)
    pressed = running(closed_loop(BRAKE, inputs={"disc.torque": 300.0}), {"disc.speed": 6.0}, "actuator.command")
    assert pressed["actuator.command"] == pytest.approx(300.0 / (2.0 * 0.115 * coefficient), rel=1e-12)
    with pytest.raises(SceneError, match="There is no steady running"):  # 8 kN are not enough
        running(closed_loop(BRAKE, inputs={"disc.torque": 900.0}), {"disc.speed": 6.0}, "actuator.command")


def test_a_limit_that_leaves_no_steady_state_is_still_told():
    @dataclass(frozen=True)
    class Weak(Component):
        """A motor that is too weak for its load, and an integral that winds up: no steady state."""

        def equations(self, signal):
            v, wound = state("cart.speed", "m/s"), state("cart.wound", "m")
            return Equations(flow={v: limited(5.0 * wound + 3.0 * (1.0 - v), 2.0) - 3.0 - 0.1 * v, wound: 1.0 - v})

    with pytest.raises(NoSteadyState, match="still changes by"):
        equilibrium(compose(Weak()))
