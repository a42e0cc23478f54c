"""The disc brake: stops and cycles in closed form, groan and what ends it, the actuator."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import pytest

from models import Coulomb, DiscBrake, Exponential
from toolbox import (
    Controller,
    SceneError,
    SimulationError,
    Update,
    closed_loop,
    compose,
    energy_audit,
    equilibrium,
    linearise,
    measure,
    quantity,
    simulate,
    state,
)
from toolbox.inputs import sine

BRAKE = DiscBrake()
STEADY = dataclasses.replace(BRAKE, friction=Coulomb(static=0.4, kinetic=0.4))


def test_a_stop_under_constant_friction_takes_as_long_and_as_far_as_constant_torque_says():
    # torque 2 mu N r from the first instant; the pad swings about its own place and carries no momentum of note
    torque, w0 = 2 * 0.4 * 1000.0 * 0.12, 4.0
    run = simulate(compose(STEADY), 3.0, start={"disc.speed": w0}, accuracy=1e-9)
    stop = w0 * 36.0 / torque
    assert run.intervals("pad")[0][1] == pytest.approx(stop, rel=1e-3)
    assert run.at(1.0)["brake.torque"] == torque
    assert run.at(1.0)["disc.speed"] == pytest.approx(w0 - torque / 36.0, abs=1e-9)
    assert run.intervals("pad")[-1][2] == "stick"


@pytest.mark.parametrize("parts", [BRAKE, dataclasses.replace(BRAKE, lag=0.05)], ids=["no lag", "lag"])
def test_every_joule_of_a_stop_is_accounted_for(parts):
    run = simulate(compose(parts), 1.5, start={"disc.speed": 2.0}, inputs={"disc.torque": 10.0}, accuracy=1e-9)
    assert len(run.events) > 10
    audit = energy_audit(run)
    assert audit.relative < 1e-8
    assert audit.losses["disc.friction"] > 0 and audit.losses["disc.caliper"] > 0


@pytest.mark.parametrize("z", [0.3, 2.0])
def test_a_driven_disc_and_an_undamped_pad_stick_and_slip_as_the_closed_form_says(z):
    # z = (F_s - F_k) w_n / (k r w);  t_slip = (2 / w_n)(pi - arctan z);  t_stick = 2 z / w_n
    w_n, speed, kinetic = math.sqrt(1e6 / 10), 1.0, 700.0
    static = kinetic + z * 1e6 * 0.12 * speed / w_n
    friction = Coulomb(static=static / 2000, kinetic=kinetic / 2000)
    plant = compose(dataclasses.replace(BRAKE, inertia=1e12, damping=0.0, friction=friction))
    caught = (2 * kinetic - static) / 1e6
    run = simulate(plant, 0.2, start={"disc.speed": speed, "pad.speed": 0.12 * speed, "pad.position": caught}, accuracy=1e-11)
    pieces = run.intervals("pad")[:-1]
    slip, stick = ([end - begin for begin, end, mode in pieces if mode == word] for word in ("slip+", "stick"))
    assert len(slip) > 5
    np.testing.assert_allclose(slip, (2 / w_n) * (math.pi - math.atan(z)), rtol=1e-7)
    np.testing.assert_allclose(stick, 2 * z / w_n, rtol=1e-7)


def groan(brake, speed=1.0, **arguments):
    """The last second of two on a disc that turns at a constant speed."""
    run = simulate(compose(dataclasses.replace(brake, inertia=1e9)), 2.0, start={"disc.speed": speed}, **arguments)
    found = measure.extent(run, "pad.position", 1.0)
    return run.time_in("pad", "stick", after=1.0), found.maximum - found.minimum


def test_the_brake_groans_at_low_speed_under_constant_force_and_not_where_friction_does_not_fall():
    stuck, swing = groan(BRAKE)
    assert stuck > 0.1 and swing > 1e-4
    stuck, swing = groan(STEADY)
    assert stuck == 0.0 and swing < 1e-3 * math.exp(-10)  # the swing of the first second decays with c / 2 m = 10 1/s


def test_groan_has_about_the_frequency_of_the_caliper():
    run = simulate(compose(dataclasses.replace(BRAKE, inertia=1e9)), 3.0, start={"disc.speed": 1.0})
    caught = [event.time for event in run.events if event.after == "stick" and event.time > 2.0]
    assert 0.7 * 50.3 < 1 / np.diff(caught).mean() < 50.3  # stick makes the cycle longer than sqrt(k / m) / 2 pi


def test_the_pad_loses_its_damping_below_the_speed_of_the_closed_form():
    # 2 N (mu_s - mu_k) decay exp(-decay r w) = c
    border = math.log(2 * 1000.0 * 0.1 * 5.0 / 200.0) / (5.0 * 0.12)
    assert 2.5 < border < 3.0
    for ratio, side in ((0.99, 1), (1.01, -1)):
        # the drive that holds this speed
        torque = 0.12 * 2000.0 * (0.35 + 0.1 * math.exp(-5.0 * 0.12 * ratio * border))
        plant = compose(dataclasses.replace(BRAKE, inertia=1e9))
        rest = equilibrium(
            closed_loop(plant, inputs={"disc.torque": torque}), guess={"disc.speed": ratio * border, "pad.position": torque / 0.12 / 1e6}
        )
        poles = linearise(plant, rest).poles()
        assert np.sign(poles[np.abs(poles.imag) > 100].real).tolist() == [side, side]


def test_a_groaning_stop_has_stick_slip_before_its_end_and_a_stop_without_falling_friction_has_none():
    def sticks(brake):
        run = simulate(compose(brake), 3.0, start={"disc.speed": 2.0})
        assert run.intervals("pad")[-1][2] == "stick"
        # before the disc has come to rest, and after the first swing of a pad that the force hit at once
        return sum(begin > 0.3 and run.at(begin)["disc.speed"] > 0.2 for begin, _, mode in run.intervals("pad") if mode == "stick")

    assert sticks(BRAKE) > 10
    assert sticks(STEADY) == 0


def test_a_car_that_creeps_off_under_light_brake_groans():
    # 100 N m turn the wheel slowly against a torque between 84 and 108 N m
    run = simulate(compose(BRAKE), 4.0, start={"disc.speed": 0.5}, inputs={"disc.torque": 100.0})
    assert run.time_in("pad", "stick", after=2.0) > 0.1
    assert run.time_in("pad", "slip+", after=2.0) > 0.1


def test_a_driven_disc_stands_while_the_brake_holds_more_than_the_drive():
    # disc and pad swing on k r^2 until the torque is the drive's; at most twice that, which is below 2 mu_s N r = 108 N m
    run = simulate(compose(BRAKE), 300.0, inputs={"disc.torque": 50.0})
    assert run.time_in("pad", "stick") == 300.0
    assert run.at(300.0)["brake.torque"] == pytest.approx(50.0, rel=1e-4)
    slips = simulate(compose(BRAKE), 300.0, inputs={"disc.torque": 60.0})
    assert slips.time_in("pad", "stick") < 300.0


def test_an_alternating_force_reaches_the_pads_as_its_formula_says():
    run = simulate(compose(STEADY), 0.5, start={"disc.speed": 10.0}, inputs={"brake.disturbance": sine(0.0, 300.0, 30.0)})
    times = np.linspace(0, 0.5, 200)
    expected = 0.12 * 2 * 0.4 * (1000.0 + 300.0 * np.sin(2 * math.pi * 30.0 * times))
    np.testing.assert_allclose(run.at(times)["brake.torque"], expected, rtol=1e-12)


def test_a_lagging_actuator_follows_a_step_of_the_command_exponentially():
    plant = compose(dataclasses.replace(STEADY, lag=0.05))
    run = simulate(plant, 0.3, start={"disc.speed": 10.0}, inputs={"brake.force": 2000.0}, accuracy=1e-10)
    times = np.linspace(0, 0.3, 100)
    np.testing.assert_allclose(run.at(times)["brake.normal_force"], 2000.0 * -np.expm1(-times / 0.05), atol=1e-6)
    np.testing.assert_allclose(run.at(times)["brake.torque"], 0.12 * 2 * 0.4 * run.at(times)["brake.normal_force"], rtol=1e-12)


def test_pads_cannot_pull():
    with pytest.raises(SceneError, match=r"disc\.force|brake\.force"):
        compose(DiscBrake(force=-1.0))
    with pytest.raises(SimulationError, match="must be >= 0"):
        simulate(compose(BRAKE), 0.1, start={"disc.speed": 1.0}, inputs={"brake.force": sine(100.0, 200.0, 20.0)})


def test_less_fall_of_friction_or_more_damping_ends_the_groan():
    assert groan(BRAKE)[0] > 0.1
    assert groan(dataclasses.replace(BRAKE, damping=1200.0))[0] == 0.0
    assert groan(dataclasses.replace(BRAKE, friction=Exponential(static=0.36, kinetic=0.35, decay=5.0)))[0] == 0.0


@dataclass(frozen=True)
class Follow(Controller):
    """Force that brakes with the deceleration a = `deceleration` under the friction `expected`, plus `gain` times the speed in excess of the plan."""

    measured_signals, actuated_signals = ("disc.speed",), ("brake.force",)
    deceleration: float = quantity(2.0, "rad/s2", "wanted deceleration")
    expected: float = quantity(0.4, "1", "friction believed in")
    gain: float = quantity(0.0, "N s/rad", "feedback of speed", at_least=0)
    reference: float = quantity(4.0, "rad/s", "speed at the start")

    def sampled(self, signal, period):
        count = state("follow.count", "1")
        planned = self.reference - self.deceleration * period * count
        force = 36.0 * self.deceleration / (2 * 0.12 * self.expected) + self.gain * (signal("disc.speed", "rad/s") - planned)
        return Update(memory={count: count + 1}, outputs={"brake.force": (force, "N")})


def test_a_sampled_law_brakes_through_the_force_of_the_pads():
    # the friction is a quarter lower than the law believes: the wheel is too fast by a t / 4 without feedback, and less with it
    plant = compose(dataclasses.replace(BRAKE, friction=Coulomb(static=0.3, kinetic=0.3)))
    late = {}
    for gain in (0.0, 2000.0):
        run = simulate(plant, 1.5, start={"disc.speed": 4.0}, controller=Follow(gain=gain), sample_time=0.01)
        late[gain] = run.at(1.5)["disc.speed"] - 1.0
    assert late[0.0] == pytest.approx(2.0 * 1.5 / 4, rel=1e-6)
    # closed loop: e' = a / 4 - (2 mu r gain / I) e, up to the sampling
    rate = 2 * 0.3 * 0.12 * 2000.0 / 36.0
    assert late[2000.0] == pytest.approx(0.5 / rate * -math.expm1(-1.5 * rate), rel=0.03)
