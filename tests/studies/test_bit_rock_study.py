"""The numbers of the study of rock and bit."""

from __future__ import annotations

import pytest

from studies.questions import bit_rock
from toolbox import energy_audit


def test_a_drag_bit_loses_a_sixth_of_its_mean_torque_between_slow_turning_and_steady_cutting():
    slow, fast = bit_rock.cycle(6.0), bit_rock.cycle(1.06 * bit_rock.CRITICAL)
    critical = bit_rock.CRITICAL
    assert critical == pytest.approx(15.12, abs=0.01)
    assert fast[0] == pytest.approx(bit_rock.STEADY, rel=1e-3) and fast[1] == 0.0
    assert slow[0] == pytest.approx(1.19 * bit_rock.STEADY, rel=0.01) and slow[1] > 0.4
    assert slow[2] > 0.0  # it bobs, but never leaves the bottom


def test_the_coupled_bit_of_the_figure_sticks_in_torsion_and_axially_and_stays_on_bottom():
    run = bit_rock.coupled()
    assert run.time_in("bit", "stick", after=10.0) > 0.1 and run.time_in("bit.axial", "stick", after=10.0) > 5.0
    assert run["bit.cut_depth"][run.time > 1.0].min() > 0.0
    assert energy_audit(run).relative < 1e-7


def test_the_lobes_throw_the_bit_off_bottom_above_the_closed_form_only():
    onset = bit_rock.bounce_onset()
    assert onset * 30 / 3.141592653589793 == pytest.approx(90.0, abs=0.5)
    assert bit_rock.bounce(0.97 * onset)[0] == 0.0
    off, weight = bit_rock.bounce(1.03 * onset)
    assert off > 0.5 and weight > 3 * bit_rock.BOUNCE_WEIGHT


def test_every_rock_of_the_figure_keeps_the_stiff_drive_in_stick_slip():
    for run in bit_rock.loops().values():
        assert run.time_in("bit", "stick", after=100.0) > 5.0
