"""Borders and zeros inside an interval: as exact as asked, with jumps, roots of several orders and what makes no sense."""

import math

import pytest

from toolbox.halving import divided, halved, zero


def counted(function):
    """The function, and the places at which it was asked."""
    places = []

    def asked(x):
        places.append(x)
        return function(x)

    return asked, places


@pytest.mark.parametrize(
    ("function", "low", "high", "where"),
    [
        (lambda x: x**3 - 2.0, 0.0, 2.0, 2.0 ** (1 / 3)),
        (lambda x: math.cos(x) - x, 1.0, 0.0, 0.7390851332151607),
        (lambda x: math.exp(-50.0 * x) - 1e-9, 0.0, 10.0, math.log(1e9) / 50.0),
        (lambda x: math.tanh(1e6 * (x - 0.3)), -1.0, 1.0, 0.3),
        (lambda x: (x - 0.25) ** 7, -1.0, 3.0, 0.25),
        (lambda x: 1e200 * (x - 1.0), 0.0, 3.0, 1.0),
    ],
    ids=["cubic", "ends in any order", "far from straight", "almost a jump", "seven times zero", "huge"],
)
def test_the_zero_is_as_near_as_asked_and_needs_few_steps(function, low, high, where):
    asked, places = counted(function)
    assert zero(asked, low, high, 1e-12) == pytest.approx(where, abs=1.1e-12)
    assert len(places) < 70


def test_a_smooth_function_needs_far_fewer_steps_than_halving():
    asked, places = counted(lambda x: math.cos(x) - x)
    zero(asked, 0.0, 1.0, 1e-14)
    assert len(places) <= 10  # halving takes 47


def test_the_place_of_a_jump_is_found():
    assert zero(lambda x: 5.0 if x > 0.7 else -1.0, 0.0, 1.0, 1e-10) == pytest.approx(0.7, abs=1e-10)


def test_an_end_that_is_zero_is_the_answer():
    assert zero(lambda x: x, 0.0, 1.0, 1e-9) == 0.0
    assert zero(lambda x: x - 1.0, 0.0, 1.0, 1e-9) == 1.0


def test_without_a_tolerance_it_ends_at_round_off():
    assert zero(lambda x: x * x - 2.0, 1.0, 2.0, 0.0) == pytest.approx(math.sqrt(2.0), rel=1e-15)


def test_equal_signs_and_nan_are_refused():
    with pytest.raises(ValueError, match="signs of the function must differ"):
        zero(lambda x: x + 1.0, 0.0, 1.0, 1e-9)
    with pytest.raises(ValueError, match="nan"):
        zero(lambda x: math.nan if 0.1 < x < 0.9 else x - 0.5, 0.0, 1.0, 1e-9)


@pytest.mark.parametrize("parts", [2, 3, 32])
def test_an_interval_that_is_divided_ends_at_the_border_and_asks_for_all_parts_at_once(parts):
    asked = []

    def hold(values):
        asked.append(len(values))
        return [value > 0.37 for value in values]

    low, high = divided(hold, 0.0, 1.0, parts, 0.0, 1e-6)
    assert low <= 0.37 < high and high - low <= 1e-6
    assert len(asked) == math.ceil(6 / math.log10(parts)) and set(asked) == {parts - 1}


def test_of_several_borders_the_lowest_that_is_seen_is_found():
    low, high = divided(lambda values: [0.2 < value < 0.4 or value > 0.9 for value in values], 0.0, 1.0, 32, 0.0, 1e-9)
    assert low <= 0.2 < high
    assert halved(lambda value: value > 0.9, 0.0, 1.0, 1e-9)[1] == pytest.approx(0.9, rel=2e-9)
