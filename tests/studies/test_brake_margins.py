"""What is left of the borders of groan and dither on machines that are a little different: the tables' claims, at single points of them."""

from __future__ import annotations

import math

import pytest

from controllers.dither import widest
from studies.questions import brake_margins as study
from studies.questions import dither


@pytest.mark.parametrize(("border", "expected"), [(2.04, 2.0), (0.4, math.nan), (9.0, 5.0)])
def test_the_search_finds_the_border_on_its_grid(border, expected):
    found = study.highest(lambda value: "" if value <= border else "groan", 0.5, 5.0, 0.1)
    assert found.value == pytest.approx(expected, nan_ok=True)
    assert found.ended == ("scan" if border > 5.0 else "groan")


def test_a_law_that_fails_below_its_highest_success_is_not_given_that_success():
    assert study.highest(lambda value: "" if value <= 3.0 and not 2.75 < value < 2.85 else "way", 0.5, 5.0, 0.1).value <= 2.7


def test_an_eased_stop_is_silent_where_friction_is_a_fifth_more_and_the_constant_force_is_not():
    eased, constant = study.row_called("PI, eased"), study.row_called("constant force")
    for phase in (0.0, 0.375):
        assert study.stop_fails(eased, 2.5, study.STOPS["friction +20 %"], phase) == ""
    assert any(study.stop_fails(constant, 2.5, study.STOPS["friction +20 %"], phase) for phase in (0.0, 0.375))


def test_dither_of_leines_block_holds_about_a_half_on_every_rig_in_the_middle_of_its_band_and_does_harm_below_it():
    label = dither.LEINE.label
    errors = [factors for word, factors in study.rigs(label).items() if not word.startswith("frequency")]
    worst = max(study.swing(label, 3.5 * dither.LEINE.natural, 0.9, factors, phase) for factors in errors for phase in study.PHASES)
    assert 0.4 < worst < 0.55
    assert study.swing(label, 0.8 * dither.LEINE.natural, 0.9, {}, 0.0) > 1.0


def test_the_widest_run_of_frequencies_is_the_band():
    assert widest([1.0, 2.0, 3.0, 4.0], [True, False, True, True]) == (3.0, 4.0)
    assert math.isnan(widest([1.0], [False])[0])
