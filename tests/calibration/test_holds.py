"""Inputs that a digital drive holds between samples: found or declared, they give the numbers of the axis; drawn as straight lines they do not."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from models import Coulomb
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, compose, fit, quantity, simulate, state
from toolbox.calibration import Recording, Search

MASS, VISCOUS, LEVEL, OFFSET = 95.1089, 203.5034, 20.3935, -3.1648
"""Published numbers of the electro-mechanical positioning system: A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, 2019."""

GAIN, POSITION_GAIN, SPEED_GAIN, STEP = 35.15065188248547, 160.18, 243.45, 1e-3


@dataclass(frozen=True)
class Axis(Component):
    mass: Quantity = quantity(80.0, "kg", "mass", above=0)
    viscous: Quantity = quantity(150.0, "N s/m", "viscous friction", at_least=0)
    offset: Quantity = quantity(0.1, "N", "offset of the force")
    friction: FrictionLaw = Coulomb(static=15.0, kinetic=15.0)

    def equations(self, signal):
        x, v = state("axis.position", "m"), state("axis.speed", "m/s")
        rail = DryFriction("rail", v, self.friction)
        force = signal("axis.force", "N", default=0.0)
        return Equations(flow={x: v, v: (force - self.offset - self.viscous * v + rail.force) / self.mass}, elements=[rail])


def moved(x, v, force, duration):
    """Where an axis is after a time of constant force: exponentials in slip, exact stops and exact rest."""
    while duration > 0.0:
        side = math.copysign(1.0, v) if v else (math.copysign(1.0, force) if abs(force) > LEVEL else 0.0)
        if not side:
            return x, 0.0
        end, rate = (force - side * LEVEL) / VISCOUS, VISCOUS / MASS
        stop = math.log(1.0 - v / end) / rate if v and v / end < 0.0 else math.inf
        slid = min(stop, duration)
        fall = -math.expm1(-rate * slid)
        x, v = x + end * slid + (v - end) * fall / rate, 0.0 if stop <= duration else v + (end - v) * fall
        duration -= slid
    return x, v


def lap(seconds=6.0):
    """(time, force, position, speed at the start): a position loop at 1 kHz on a trapezoidal profile of speed, encoder of 50 nm, commands held for 1 ms."""
    count = round(seconds / STEP)
    time = np.arange(count) * STEP
    wanted = np.cumsum(0.11 * np.clip(3.0 * np.sin(2.0 * np.pi * time / 3.1), -1.0, 1.0)) * STEP
    x = v = before = last = 0.0
    position, force = np.empty(count), np.empty(count)
    for k in range(count):
        position[k] = seen = round(x / 5e-8) * 5e-8
        middle = 0.5 * (seen + before)
        volts = SPEED_GAIN * (POSITION_GAIN * (wanted[k] - seen) - (middle - last) / STEP)
        before, last, force[k] = seen, middle, GAIN * min(max(volts, -10.0), 10.0)
        x, v = moved(x, v, force[k] - OFFSET, STEP)
    return time, force, position


NAMES = ["axis.mass", "axis.viscous", "axis.offset", "rail.friction.static", "rail.friction.kinetic"]
TRUTH = dict(zip(NAMES, (MASS, VISCOUS, OFFSET, LEVEL, LEVEL), strict=True))
RANGES = dict(zip(NAMES, ((50, 200), (10, 500), (-10, 10), (5, 60), (5, 60)), strict=True))


def test_the_closed_form_of_the_axis_is_the_motion_of_the_toolbox():
    time, force, position = lap(1.0)
    true = compose(Axis(mass=MASS, viscous=VISCOUS, offset=OFFSET, friction=Coulomb(LEVEL, LEVEL)))
    inputs = Recording.of({"time": time, "axis.force": force, "axis.position": position}, true, held="axis.force").driving(true)
    run = simulate(true, time[-1], inputs=inputs, output_times=time, accuracy=1e-10)
    assert np.abs(run["axis.position"] - position).max() < 3e-8  # half a step of the encoder


@pytest.mark.slow
@pytest.mark.parametrize("shift", [False, True])
def test_an_axis_under_held_commands_has_its_numbers_in_their_intervals_and_not_under_straight_lines(shift):
    time, force, position = lap()
    log = {"time": time, "axis.force": force, "axis.position": position}
    names = [*NAMES, "axis.position", *(["axis.force.shift"] if shift else [])]
    ranges = {**RANGES, "axis.force.shift": (-0.005, 0.005)} if shift else RANGES
    found = fit(compose(Axis()), log, names, ranges, starts=1, held="axis.force" if shift else None)
    assert list(found.held) == ["axis.force"] and "is held between its samples" in str(found)
    for name, value in TRUTH.items():
        low, high = found.interval(name)
        assert low <= value <= high and high - low < 2e-3 * abs(value), name
    if not shift:
        lines = fit(compose(Axis()), log, names, RANGES, starts=1, held=())
        low, high = lines.interval("axis.mass")
        assert not low <= MASS <= high and lines.held == {}


def test_an_input_that_is_a_line_between_its_samples_stays_one():
    true = compose(Axis(mass=2.0, viscous=1.0, offset=0.0, friction=Coulomb(1.0, 1.0)))
    time = np.arange(0.0, 6.0, 0.02)
    force = 4.0 * np.sin(3.0 * time)
    run = simulate(true, time[-1], inputs={"axis.force": (time, force)}, output_times=time)
    log = {
        "time": time,
        "axis.force": force,
        "axis.position": run["axis.position"] + 1e-5 * np.random.default_rng(0).standard_normal(time.size),
    }
    found = fit(compose(Axis(mass=1.5, viscous=1.5, friction=Coulomb(0.8, 0.8))), log, ["axis.mass", "axis.viscous"], starts=1,
                window=(0.0, 6.0))  # fmt: skip
    assert found.held == {}


def test_who_declares_a_hold_names_a_channel():
    log = {"time": np.arange(9.0), "axis.force": np.arange(9.0), "axis.position": np.arange(9.0)}
    with pytest.raises(SceneError, match="no channel `axis.forc`"):
        fit(compose(Axis()), log, ["axis.mass"], starts=Search(1), held="axis.forc")
