"""Inputs that a digital drive holds between samples: found or declared, they give the numbers of the axis; drawn as straight lines they do not."""

from dataclasses import dataclass

import numpy as np
import pytest

from models import Coulomb
from studies.benchmarks.measured_cases import LEVEL, MASS, OFFSET, VISCOUS, emps
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, compose, fit, quantity, simulate, state
from toolbox.calibration import Recording, Search


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


def lap(seconds=6.0):
    """(time, force, position) of the published axis in its loop."""
    return tuple(emps(seconds).values())


NAMES = ["axis.mass", "axis.viscous", "axis.offset", "rail.friction.static", "rail.friction.kinetic"]
TRUTH = dict(zip(NAMES, (MASS, VISCOUS, OFFSET, LEVEL, LEVEL), strict=True))
RANGES = dict(zip(NAMES, ((50, 200), (10, 500), (-10, 10), (5, 60), (5, 60)), strict=True))


def test_the_closed_form_of_the_axis_is_the_motion_of_the_toolbox():
    time, force, position = lap(1.0)
    true = compose(Axis(mass=MASS, viscous=VISCOUS, offset=OFFSET, friction=Coulomb(LEVEL, LEVEL)))
    inputs = Recording.of({"time": time, "axis.force": force, "axis.position": position}, true, zero_order_hold="axis.force").driving(true)
    run = simulate(true, time[-1], inputs=inputs, output_times=time, accuracy=1e-10)
    assert np.abs(run["axis.position"] - position).max() < 3e-8  # half a step of the encoder


@pytest.mark.slow
@pytest.mark.parametrize("shift", [False, True])
def test_an_axis_under_held_commands_has_its_numbers_in_their_intervals_and_not_under_straight_lines(shift):
    time, force, position = lap()
    log = {"time": time, "axis.force": force, "axis.position": position}
    names = [*NAMES, "axis.position", *(["axis.force.shift"] if shift else [])]
    ranges = {**RANGES, "axis.force.shift": (-0.005, 0.005)} if shift else RANGES
    found = fit(compose(Axis()), log, names, ranges, starts=1, zero_order_hold="axis.force" if shift else None)
    assert list(found.held) == ["axis.force"] and "is held between its samples" in str(found)
    for name, value in TRUTH.items():
        low, high = found.interval(name)
        assert low <= value <= high and high - low < 2e-3 * abs(value), name
    if not shift:
        lines = fit(compose(Axis()), log, names, RANGES, starts=1, zero_order_hold=())
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
        fit(compose(Axis()), log, ["axis.mass"], starts=Search(1), zero_order_hold="axis.forc")
