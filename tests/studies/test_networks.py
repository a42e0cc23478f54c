"""The study of what surrounds the machine: its answers in numbers."""

from __future__ import annotations

import numpy as np
import pytest

from studies.questions import networks
from toolbox import measure


def test_the_motor_cuts_the_start_torque_to_what_it_has():
    runs = networks.start_up()
    peaks = {name: measure.extent(run, "top.torque").maximum for name, run in runs.items()}
    limit = 10.5 * 3400.0 * 0.95 - 50.0  # ratio, limit of the motor, teeth and idle torque
    assert peaks["limits of the motor"] == pytest.approx(limit, rel=1e-6)
    assert peaks["no limits"] > 5 * limit
    assert all(run.time_in("bit", "stick", after=10.0) > 3.0 for run in runs.values())


@pytest.mark.parametrize("eta", [0.98, 0.9])
def test_a_differential_loses_nothing_as_a_block_and_most_where_its_carrier_stands(eta):
    found = networks.differential(eta)
    assert found[np.argmin(abs(networks.RING_SPEEDS - 20.0))] == pytest.approx(1.0, abs=1e-12)
    assert found[np.argmin(abs(networks.RING_SPEEDS))] == pytest.approx((1 + 3 * eta) / 4, rel=1e-12)
    assert networks.RING_SPEEDS[np.argmin(found)] == pytest.approx(-20.0 / 3, abs=0.25)
    assert eta <= found.min() < eta + 0.002


def test_the_hand_is_shaken_where_the_block_sticks_and_slips_and_nowhere_else():
    dose, stuck = networks.exposures()
    assert 0.0 < networks.BELT_SPEEDS[stuck > 0].max() < 0.08
    assert np.all(dose[stuck > 0] > 0.5)
    assert 0.04 < networks.BELT_SPEEDS[np.argmax(dose)] < networks.BELT_SPEEDS[stuck > 0].max()  # just below the end
    assert np.all(dose[stuck == 0.0] < 1e-3)


def test_a_gelled_line_breaks_at_less_than_its_strength_because_it_breaks_from_the_pump_on():
    runs = networks.circulation()
    peak = {n: measure.extent(run, "line.inlet_pressure").maximum for n, run in runs.items()}
    strength, flowing = (4 * stress * networks.LENGTH / networks.BORE for stress in (networks.STRENGTH, networks.YIELD))
    assert peak[1] == pytest.approx(strength, rel=0.01) and peak[1] > strength
    assert flowing < peak[24] < peak[6] < 0.65 * strength
