"""Numbers that are known as distributions."""

import numpy as np
import pytest
from scipy import stats

from models import BitRock, wells
from toolbox import SceneError, closed_loop, compose, sweep
from toolbox.drilling import drawn_group
from toolbox.probability import Draws, LogNormal, Normal, Uniform, drawn


@pytest.fixture(scope="module")
def rig():
    return compose(wells.JANSEN_2, BitRock())


@pytest.mark.parametrize("text", ["97 kN +- 8 kN", "97 +- 8 kN", "97 kN ± 8 kN", "97000 +- 8000", "97 kN +/- 8000 N"])
def test_text_is_a_normal_distribution_in_si(rig, text):
    found = drawn(rig, {"bit.weight": text}, 20_000).points[:, 0]
    assert stats.kstest(found, stats.norm(97e3, 8e3).cdf).pvalue > 1e-3


def test_a_deviation_in_per_cent_is_of_the_mean(rig):
    assert np.array_equal(drawn(rig, {"bit.weight": "100 kN +- 8 %"}, 50).points, drawn(rig, {"bit.weight": Normal(100e3, 8e3)}, 50).points)


@pytest.mark.parametrize(
    "given, truth",
    [
        (Uniform("50 kN", "90 kN"), stats.uniform(50e3, 40e3)),
        (LogNormal("70 kN", 0.2), stats.lognorm(0.2, scale=70e3)),
        (Normal(5e3, 5e3), stats.truncnorm(-1.0, np.inf, 5e3, 5e3)),
    ],
    ids=["uniform", "log-normal", "cut at zero"],
)
def test_draws_follow_their_distribution_within_the_bounds_of_the_number(rig, given, truth):
    found = drawn(rig, {"bit.weight": given}, 20_000).points[:, 0]
    assert found.min() >= 0 and stats.kstest(found, truth.cdf).pvalue > 1e-3


def test_a_further_number_leaves_the_draws_of_the_others(rig):
    alone = drawn(rig, {"bit.weight": "90 kN +- 8 kN"}, 100)
    both = drawn(rig, {"bit.friction.static": "0.8 +- 0.05", "bit.weight": "90 kN +- 8 kN"}, 100)
    assert np.array_equal(alone.points[:, 0], both.points[:, 1])
    assert abs(np.corrcoef(both.points.T)[0, 1]) < 0.4
    assert not np.array_equal(alone.points, drawn(rig, {"bit.weight": "90 kN +- 8 kN"}, 100, seed=1).points)


def test_draws_known_together_stay_together(rig):
    values = {"bit.weight": [60e3, 70e3, 80e3], "bit.friction.static": [0.6, 0.7, 0.8]}
    found = drawn(rig, Draws(values), 300).points
    assert {tuple(row) for row in found.tolist()} == set(zip(*values.values(), strict=True))


def test_a_sweep_takes_what_is_drawn(rig):
    found = sweep(rig, drawn(rig, {"bit.weight": "60 kN +- 5 kN"}, 8), 5.0, metrics="maximum")
    assert found.shape == (8,) and np.isfinite(found["maximum"]).all() and found.display_units["N"] == "kN"


@pytest.mark.parametrize(
    "uncertain, words",
    [
        ({"bit.weight": 97e3}, "`bit.weight` must be a distribution, or text such as"),
        ({"bit.weight": "97 kN"}, "`bit.weight` must be a distribution, or text such as"),
        ({"bit.weight": "97 kN +- 8"}, "must say the unit of its deviation"),
        ({"bit.weight": "97 kN +- 0 kN"}, "`deviation` of `bit.weight` must be > 0"),
        ({"bit.weight": "97 kN +- 8 rpm"}, "rpm"),
        ({"bit.weight": Normal(-9e4, 1e3)}, "must have a distribution within the bounds of the number"),
        ({"bit.weight": Uniform(9e4, 8e4)}, "low < high"),
        ({"bit.wait": "97 kN +- 8 kN"}, "bit.weight"),
        ({}, "must map at least one name"),
        (Draws({"bit.weight": [1.0], "bit.friction.static": [0.5, 0.6]}), "rows of finite numbers of equal length"),
    ],
)
def test_what_is_no_distribution_is_refused(rig, uncertain, words):
    with pytest.raises(SceneError, match=words):
        drawn(rig, uncertain, 10)


def test_a_group_of_drawn_machines_has_their_numbers_as_factors_of_the_declared_ones(rig):
    known = {"bit.weight": "80 kN +- 8 kN", "bit.friction.static": Uniform(0.7, 0.9)}
    group, design = drawn_group(rig, known, 5, seed=3), drawn(rig, known, 5, 3)
    assert group.name == "drawn" and len(group.machines) == 5
    for machine, row in zip(group.machines, design.points, strict=True):
        values = [factor * closed_loop(rig).number(name).value for name, factor in machine.parameter_factors]
        assert values == pytest.approx(row.tolist(), rel=1e-14)


def test_a_number_that_is_zero_as_declared_makes_no_group(rig):
    with pytest.raises(SceneError, match="must name numbers that are not zero, but `bit.weight` is"):
        drawn_group(closed_loop(rig).at("bit.weight", 0.0), {"bit.weight": Uniform(1e3, 2e3)}, 5)


def test_draws_have_numbers_beside_them_that_are_known_independently(rig):
    known = Draws({"bit.friction.static": [0.7, 0.8], "bit.radius": [0.15, 0.16]}).also({"bit.weight": "80 kN +- 8 kN"})
    found = drawn(rig, known, 50, 3)
    assert found.names == ("bit.friction.static", "bit.radius", "bit.weight")
    assert {tuple(row) for row in found.points[:, :2].tolist()} == {(0.7, 0.15), (0.8, 0.16)}
    assert np.array_equal(found.points[:, 2], drawn(rig, {"bit.weight": "80 kN +- 8 kN"}, 50, 3).points[:, 0])
    with pytest.raises(SceneError, match="must name other numbers than the draws"):
        drawn(rig, known.also({"bit.radius": Uniform(0.1, 0.2)}), 5)
