"""Static laws of dry friction: numbers of the papers, limits, and values that a law must refuse."""

from __future__ import annotations

import dataclasses
import math

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from models import (
    BitRock,
    BlockOnBelt,
    Coulomb,
    CubicStribeck,
    Exponential,
    GaussianStribeck,
    Hyperbolic,
    RationalStribeck,
    SmoothStepFriction,
    StepFriction,
    Tabulated,
    TwoDisks,
    oscillators,
    wells,
)
from tests.refusals import refusals
from toolbox import SceneError, compose, hopf_points, limit_cycle, simulate

LAWS = [
    Coulomb(static=0.5, kinetic=0.3),
    Exponential(static=0.8, kinetic=0.5, decay=0.9),
    Hyperbolic(static=1.0, decay=3.0),
    CubicStribeck(static=0.4, minimum=0.25, minimum_speed=0.5),
    SmoothStepFriction(static=0.3, kinetic=0.195, transition_speed=1.5),
    GaussianStribeck(static=1.5, kinetic=1.0, stribeck_speed=0.1),
    RationalStribeck(static=0.4, kinetic=0.1, decay=3.0, quadratic_rise=0.2),
    Tabulated(speeds=(0.0, 0.1, 0.5), coefficients=(0.4, 0.3, 0.2), static=0.4),
]
each_law = pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)


def coefficient(law, speed):
    return float(ca.DM(law.sliding(ca.DM(speed))))


def test_coulomb_friction_does_not_depend_on_speed():
    law = Coulomb(static=0.5, kinetic=0.3)
    assert [coefficient(law, v) for v in (0.0, 1e-9, 1.0, 1e9)] == [0.3] * 4
    assert law.breakaway() == 0.5


def test_exponential_friction_is_the_law_of_navarro_lopez_and_cortes():
    # W R_b [mu_c + (mu_s - mu_c) exp(-gamma |w| / v_f)]
    for speed in (0.0, 0.1, 1.0, 5.0):
        assert coefficient(Exponential(), speed) == pytest.approx(0.5 + 0.3 * math.exp(-0.9 * speed / 1.0), rel=1e-15)
    assert 97_347.0 * 0.155575 * Exponential().breakaway() == pytest.approx(12_115.807, rel=1e-6)


def test_the_transition_takes_most_of_the_drop_about_its_speed():
    law = SmoothStepFriction(static=0.3, kinetic=0.195, transition_speed=1.5)
    assert coefficient(law, 1.5) == pytest.approx(0.195 + 0.105 / math.e, rel=1e-15)
    left = [(coefficient(law, ratio * 1.5) - 0.195) / 0.105 for ratio in (0.42, 1.37)]
    assert left == pytest.approx([0.97, 0.03], abs=1e-3)
    assert coefficient(law, 20.0) == 0.195


def test_the_drop_is_the_limit_of_steep_laws_and_has_one_break():
    law = StepFriction(static=0.3, kinetic=0.195, drop_speed=1.5)
    assert law.break_speeds() == (1.5,)
    assert [law.sliding(1.0, beyond) for beyond in (0, 1)] == [0.3, 0.195]
    with pytest.raises(SceneError, match="kinetic"):
        compose(BlockOnBelt(friction=StepFriction(static=0.1, kinetic=0.2)))


def test_hyperbolic_friction_is_the_law_of_leine():
    for speed in (0.0, 0.2, 1.0):
        assert coefficient(Hyperbolic(), speed) == pytest.approx(1.0 / (1 + 3 * speed), rel=1e-15)


def test_cubic_friction_has_its_minimum_where_it_is_declared():
    # mu(v_m) = mu_m with zero slope and positive curvature; mu_s - 1.5 (mu_s - mu_m) (2 - 8/3) = mu_s + (mu_s - mu_m) at 2 v_m
    law = CubicStribeck(static=0.4, minimum=0.25, minimum_speed=0.5)
    v = ca.SX.sym("v")
    slope = ca.Function("slope", [v], [ca.gradient(law.sliding(v), v)])
    assert coefficient(law, 0.5) == pytest.approx(0.25, rel=1e-15)
    assert float(slope(0.5)) == pytest.approx(0.0, abs=1e-15)
    assert float(slope(0.49)) < 0 < float(slope(0.51))
    assert coefficient(law, 1.0) == pytest.approx(0.55, rel=1e-15)


def test_gaussian_friction_falls_steepest_at_its_speed_by_root_two():
    law = GaussianStribeck(static=1.5, kinetic=1.0, stribeck_speed=0.1)
    assert coefficient(law, 0.1) == pytest.approx(1.0 + 0.5 / math.e, rel=1e-15)
    v = ca.SX.sym("v")
    slope = ca.Function("slope", [v], [ca.jacobian(law.sliding(v), v), ca.hessian(law.sliding(v), v)[0]])
    steepest, turn = slope(0.1 / math.sqrt(2))
    assert float(steepest) == pytest.approx(-math.sqrt(2 / math.e) * 0.5 / 0.1, rel=1e-14) and float(turn) == pytest.approx(0.0, abs=1e-10)
    assert float(slope(0.0)[0]) == 0.0  # sliding may be stable at creeping speeds, where an exponential law is worst


def test_under_gaussian_friction_sliding_is_unstable_between_two_hopf_speeds():
    law = GaussianStribeck(static=1.5, kinetic=1.0, stribeck_speed=0.1)
    plant = compose(BlockOnBelt(damping=2.0, friction=law))
    low, high = hopf_points(plant, "block.belt_speed", (0.005, 0.5))
    for point, stable in ((low, "below"), (high, "above")):
        assert point.stable == stable  # c = 2 (mu_s - mu_k) v / v_s^2 exp(-(v / v_s)^2)
        assert pytest.approx(2 * 0.5 * point.value / 0.01 * math.exp(-((point.value / 0.1) ** 2)), rel=1e-9) == 2.0


def test_rational_friction_holds_the_laws_of_leine_and_of_galvanetto_and_bishop():
    for v in (0.0, 0.2, 1.0, 5.0):
        assert coefficient(RationalStribeck(static=1.0, kinetic=0.0, decay=3.0), v) == coefficient(Hyperbolic(static=1.0, decay=3.0), v)
        law = RationalStribeck(static=1.0, kinetic=0.3, decay=3.0, quadratic_rise=1e-3)
        assert coefficient(law, v) == pytest.approx((1 - 0.3) / (1 + 3.0 * v) + 0.3 + 1e-3 * v * v, rel=1e-15)
    leine = simulate(compose(oscillators.LEINE), 40.0)
    same = simulate(compose(BlockOnBelt(friction=RationalStribeck(static=1.0, kinetic=0.0, decay=3.0))), 40.0)
    assert [event.time for event in same.events] == pytest.approx([event.time for event in leine.events], rel=1e-12)
    assert compose(wells.JANSEN_2, BitRock(friction=RationalStribeck())).parameters["bit.friction.quadratic_rise"].unit == "s2/rad2"


def test_tabulated_friction_goes_through_its_table_and_stays_at_its_end():
    speeds, coefficients = [0.0, 0.1, 0.5, 2.0], np.array([0.4, 0.3, 0.2, 0.25])
    law = Tabulated(speeds=speeds, coefficients=coefficients, static=0.5)
    for v in (0.0, 0.05, 0.1, 0.3, 1.0, 2.0, 50.0):
        assert coefficient(law, v) == pytest.approx(np.interp(v, speeds, coefficients), rel=1e-14)
    assert law.breakaway() == 0.5


def test_a_table_of_one_level_is_coulomb_friction():
    """Period of the belt cycle (2 / w_n)(pi - arctan z) + 2 z / w_n with z = N (mu_s - mu_k) w_n / (k v), exact."""
    level = Tabulated(speeds=(0.0, 0.1, 0.4), coefficients=(0.6, 0.6, 0.6), static=1.0)
    z = 0.4 / 0.2
    cycle = limit_cycle(compose(BlockOnBelt(belt_speed=0.2, friction=level)), 60.0)
    assert cycle.period == pytest.approx(2 * (math.pi - math.atan(z)) + 2 * z, rel=1e-11)


def test_a_run_over_the_kinks_of_a_table_keeps_its_accuracy():
    """v' = -x + mu(0.2 - v) from v = -1.5 to where the slip ends, over all three kinks, against scipy in tiny steps."""
    speeds, coefficients = (0.0, 0.1, 0.5, 1.0), (1.0, 0.7, 0.5, 0.6)
    plant = compose(BlockOnBelt(belt_speed=0.2, friction=Tabulated(speeds, coefficients, static=1.0)))
    run = simulate(plant, 10.0, start={"block.speed": -1.5}, accuracy=1e-9)

    def flow(t, y):
        return [y[1], -y[0] + np.interp(0.2 - y[1], speeds, coefficients)]

    def slip(t, y):
        return 0.2 - y[1]

    slip.terminal = True
    found = solve_ivp(flow, (0.0, 10.0), [0.0, -1.5], method="DOP853", rtol=1e-12, atol=1e-13, events=slip, max_step=1e-3)
    assert run.events[0].time == pytest.approx(found.t[-1], rel=1e-8)
    assert run.at(found.t[-1])["block.position"] == pytest.approx(found.y[0, -1], rel=1e-8)


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({"speeds": (0.1, 0.2), "coefficients": (0.4, 0.3)}, "begin at 0"),
        ({"speeds": (0.0, 0.2, 0.2), "coefficients": (0.4, 0.3, 0.2)}, "increase"),
        ({"speeds": (0.0, 0.2), "coefficients": (0.4, 0.3, 0.2)}, "as many entries"),
        ({"speeds": (0.0,), "coefficients": (0.4,)}, "2 or more"),
        ({"static": 0.3}, "static coefficient"),
    ],
)
def test_a_table_that_is_none_is_refused(fields, word):
    with pytest.raises(SceneError, match=word):
        compose(BlockOnBelt(friction=dataclasses.replace(Tabulated(), **fields)))


@pytest.mark.parametrize("law", [law for law in LAWS if not isinstance(law, Coulomb)], ids=lambda law: type(law).__name__)
def test_friction_starts_at_the_static_bound_where_the_law_is_continuous(law):
    assert coefficient(law, 0.0) == pytest.approx(law.breakaway(), rel=1e-15)


def test_an_exponential_law_without_decay_is_coulomb_friction_at_the_static_bound():
    assert coefficient(Exponential(static=0.6, kinetic=0.2, decay=0.0), 3.0) == 0.6


def test_an_exponential_law_with_a_steep_decay_is_coulomb_friction_with_a_jump():
    assert coefficient(Exponential(static=0.6, kinetic=0.2, decay=1e6), 1e-3) == 0.2


@each_law
def test_the_force_in_a_run_is_minus_the_sign_of_slip_times_load_times_the_law(law):
    for speed in (0.25, -0.25):
        plant = compose(BlockOnBelt(belt_speed=0.0, load=2.5, friction=law))
        run = simulate(plant, 0.01, start={"block.speed": speed})
        slip = run["block.speed"]
        expected = -np.sign(speed) * 2.5 * np.array([coefficient(law, abs(v)) for v in slip])
        np.testing.assert_allclose(run["belt.force"], expected, rtol=1e-14)


@each_law
def test_the_static_bound_decides_whether_a_block_starts_to_move(law):
    bound = 2.5 * law.breakaway()
    plant = compose(BlockOnBelt(belt_speed=0.0, load=2.5, friction=law))
    held = simulate(plant, 1.0, inputs={"block.force": bound * (1 - 1e-6)})
    assert held.time_in("belt", "stick") == 1.0
    assert held.at(0.5)["belt.force"] == pytest.approx(-bound * (1 - 1e-6), rel=1e-15)
    freed = simulate(plant, 1.0, inputs={"block.force": bound * (1 + 1e-6)})
    assert freed.time_in("belt", "stick") < 1.0


@pytest.mark.parametrize(
    "law",
    [Coulomb(static=0.3, kinetic=0.5), Exponential(static=0.3, kinetic=0.5), CubicStribeck(static=0.2, minimum=0.3)],
    ids=lambda law: type(law).__name__,
)
@pytest.mark.parametrize("part", [BlockOnBelt, BitRock, TwoDisks], ids=lambda part: part.__name__)
def test_kinetic_friction_above_the_static_bound_is_refused(law, part):
    parts = (wells.JANSEN_2, part(friction=law)) if part is BitRock else (part(friction=law),)
    with pytest.raises(SceneError, match="static"):
        compose(*parts)


def test_the_parameters_of_a_law_are_named_after_its_contact():
    plant = compose(BlockOnBelt(friction=Exponential()))
    assert {"belt.friction.static", "belt.friction.kinetic", "belt.friction.decay"} <= set(plant.parameters)
    assert plant.parameter("belt.friction.decay") == 0.9


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: compose(BlockOnBelt(friction=Coulomb(static=0.5, kinetic=0.3))).with_parameters({"belt.friction.kinetic": 0.6}), "static"),
    (lambda: simulate(compose(BlockOnBelt(friction=Coulomb(static=0.5, kinetic=0.3))), 1.0, parameters={"belt.friction.static": 0.2}), "static"),
    (lambda: compose(BlockOnBelt(friction=Tabulated(coefficients=(0.5, 0.3, 0.2, 0.2)))),
     "Argument `coefficients` must begin with at most the static coefficient 0.4, but it begins with 0.5"),
    (lambda: compose(BlockOnBelt(friction=CubicStribeck(static=0.1))), "Argument `minimum` must be <= the static coefficient 0.1"),
)  # fmt: skip


def test_a_law_that_is_a_force_is_a_coefficient_under_a_weight_on_a_radius():
    under_weight = compose(wells.JANSEN_2, BitRock(friction=Hyperbolic(static=0.8)))
    assert under_weight.unit("bit.friction.static") == "1" and compose(BlockOnBelt()).unit("belt.friction.static") == "N"
