"""Example: the tests of a control law of your own. Copy this file beside your law and change the law, the rig and the numbers."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from controllers import StiffPI
from models import BitRock, wells
from toolbox import Controller, Equations, Update, closed_loop, compose, quantity, simulate, state

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
SPEED = 9.95
"""Set-point [rad/s], 95 rpm."""


@dataclass(frozen=True)
class Yielding(Controller):
    """A drive that gives way to torsional waves: u = damping e + stiffness int e dt, e = reference - top speed."""

    measured_signals, actuated_signals = ("top.speed",), ("top.torque",)
    damping: float = quantity(900.0, "N m s/rad", "damping felt by the string", at_least=0)
    stiffness: float = quantity(600.0, "N m/rad", "stiffness felt by the string", at_least=0)
    reference: float = quantity(SPEED, "rad/s", "set-point")

    def continuous(self, signal):
        angle = state("yielding.angle", "rad")
        error = signal("top.reference", "rad/s", default=self.reference) - signal("top.speed", "rad/s")
        return Equations(flow={angle: error}, outputs={"top.torque": (self.damping * error + self.stiffness * angle, "N m")})

    def sampled(self, signal, period):
        angle = state("yielding.angle", "rad")
        error = signal("top.reference", "rad/s", default=self.reference) - signal("top.speed", "rad/s")
        return Update(
            memory={angle: angle + period * error}, outputs={"top.torque": (self.damping * error + self.stiffness * angle, "N m")}
        )


def driven(law=None, duration=200.0, **arguments):
    """The rig under the law from rest, the bit stuck: the start that a drive must free."""
    return simulate(RIG, duration, controller=law or Yielding(), **arguments)


def test_a_stiff_drive_leaves_the_bit_in_stick_slip(stickslip_checks):
    # the twin of every claim below: without the law the problem is there
    with pytest.raises(AssertionError, match="must not stick"):
        stickslip_checks.no_stick_slip(driven(StiffPI(reference=SPEED)), after=100.0)


@pytest.mark.stickslip_perturbed({"bit.weight": 0.2, "chain.stiffness": 0.2, "chain.damping": 0.5, "bit.friction.static": 0.1})
def test_the_bit_is_freed_on_a_machine_that_is_not_quite_the_declared_one(stickslip_checks, perturbed):
    stickslip_checks.no_stick_slip(driven(parameters=perturbed(RIG)), after=100.0)


def test_the_speed_settles_smoothly_within_the_limits_of_the_motor(stickslip_checks):
    run = driven()
    stickslip_checks.settles(run, "bit.speed", SPEED, within=100.0)
    stickslip_checks.severity_below(run, 0.01, after=150.0)
    stickslip_checks.respects_limits(run, {"top.torque": 20_000.0, "top.speed": (0.0, 15.0)})
    stickslip_checks.energy_balances(run)


def test_the_law_beats_a_stiff_drive_by_far(stickslip_checks):
    stickslip_checks.beats(driven(), driven(StiffPI(reference=SPEED)), after=150.0, by=100.0)


def test_sampled_at_100_hertz_it_still_frees_the_bit(stickslip_checks):
    stickslip_checks.no_stick_slip(driven(sample_time=0.01), after=100.0)


def test_neither_a_disturbance_nor_an_existing_stick_slip_survives_above_90_rpm(stickslip_checks):
    found = stickslip_checks.onset_below(closed_loop(RIG, Yielding()), "top.reference", 9.4, (2.0, 14.0), num_values=7, tolerance=0.1)
    assert found.loss < found.end
