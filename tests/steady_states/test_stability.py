"""Hopf points, steady states and slopes against closed forms; what a linear criterion says and what it cannot."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import control
import numpy as np
import pytest

from controllers import PI, IdealSlidingMode, SoftTorque, StiffPI
from models import BitRock, BlockOnBelt, Coulomb, Exponential, Tabulated, TopDrive, TwoDisks, closed_forms, oscillators, wells
from tests.refusals import each_of, refusals
from toolbox import Sampled, SceneError, closed_loop, compose, linearise, measure, simulate
from toolbox.errors import NoSteadyState
from toolbox.inputs import sine
from toolbox.scenes.scene import Scene
from toolbox.steady_states import hopf
from toolbox.steady_states.equilibria import equilibria, flow_slopes
from toolbox.steady_states.hopf import hopf_curve, hopf_points
from toolbox.steady_states.poles import pole_locus

RIG = (wells.JANSEN_2, BitRock())
FALL = 97_347.0 * 0.155575 * 0.3 * 0.9
"""W R_b (mu_s - mu_c) decay: the friction of the bit falls by this times exp(-0.9 w)."""


def only(points):
    assert len(points) == 1, [str(point) for point in points]
    return points[0]


# --- Hopf points in closed form


@pytest.mark.parametrize("name", ["THOMSEN_FIDLIN", "VERASZTO_STEPAN"])
def test_the_hopf_speed_of_a_published_block_is_that_of_the_closed_form(name):
    block = getattr(oscillators, name)
    point = only(hopf_points(compose(block), "block.belt_speed", (0.05, 0.48)))
    assert point.value == pytest.approx(oscillators.hopf_speed(block), rel=1e-12)
    assert point.frequency == pytest.approx(math.sqrt(block.stiffness / block.mass), rel=1e-12)
    assert point.stable == "above" and point.residual < 1e-12 and point.unit == "m/s"


def test_any_number_of_the_machine_can_be_what_varies():
    # c + d = N (mu_s - mu_k) decay exp(-decay v), solved for each of its letters
    block = oscillators.VERASZTO_STEPAN
    plant, v, slope = compose(block), block.belt_speed, 40.0 * math.exp(-10 * block.belt_speed)
    damping = only(hopf_points(plant, "block.damping", (3.0, 10.0)))
    assert damping.value == pytest.approx(slope - block.drag, rel=1e-10) and damping.stable == "above"
    static = only(hopf_points(plant, "belt.friction.static", (3.0, 9.0)))
    assert static.value == pytest.approx(2.0 + (block.damping + block.drag) * math.exp(10 * v) / 10, rel=1e-10) and static.stable == "below"
    load = only(hopf_points(plant, "block.load", (0.5, 2.0)))  # an input of the plant
    assert load.value == pytest.approx((block.damping + block.drag) / slope, rel=1e-10)


@pytest.mark.parametrize("weight", [60_000.0, 97_347.0])
@pytest.mark.parametrize("well", [wells.JANSEN_2, wells.NAVARRO_LOPEZ_2], ids=["Jansen", "Navarro-Lopez"])
def test_two_inertias_under_a_constant_torque_lose_stability_where_hurwitz_says_just_before_steady_running_ends(well, weight):
    rock = BitRock(weight=weight)
    point = only(hopf_points(compose(well, rock), "top.torque", (3000.0, 40_000.0)))
    w = closed_forms.hopf_speed_of_string(well, rock)
    assert point.point["bit.speed"] == pytest.approx(w, rel=1e-9)
    # the torque of steady running, (c_r + c_b) w + T(w), is smallest where its slope is zero: closer to the Hopf point than neighbours of the search
    fall = weight * rock.radius * 0.3 * 0.9
    last = math.log(fall / (well.top_drag + well.bit_drag)) / 0.9
    assert last < w and point.value - ((well.top_drag + well.bit_drag) * (last + 1 / 0.9) + weight * rock.radius * 0.5) < 37_000.0 / 32


def test_a_drive_that_holds_its_speed_leaves_only_the_damping_of_the_string():
    rock = BitRock()
    plant = compose(wells.JANSEN_2, rock)
    limit = closed_forms.hopf_speed_of_string(wells.JANSEN_2, rock, held=True)
    assert limit == pytest.approx(math.log(FALL / (23.2 + 50.0)) / 0.9, rel=1e-14)
    errors = []
    for gain in (1e6, 1e7):
        point = only(hopf_points(closed_loop(plant, PI(proportional=gain, integral=1.0)), "top.reference", (2.0, 9.0)))
        errors.append(abs(point.value - limit))
    # a proportional drive of gain P lets go of the torque c_r w + T by an error of 1 / P, and stiffens as 1 / P
    assert errors[1] < 0.11 * errors[0] < 0.02


def test_under_a_pi_drive_the_quartic_of_hurwitz_agrees():
    law = StiffPI()
    point = only(hopf_points(closed_loop(compose(*RIG), law), "top.reference", (2.0, 8.0)))
    (j1, j2), k, c = wells.JANSEN_2.inertia, 473.0, 23.2
    d1, d2 = 425.0 + law.proportional, 50.0 - FALL * math.exp(-0.9 * point.value)
    top, bit, tie = [j1, d1 + c, k + law.integral], [j2, d2 + c, k], [c, k]
    quartic = np.polysub(np.polymul(top, bit), np.polymul(tie, tie))
    a4, a3, a2, a1, a0 = quartic
    assert a3 * a2 * a1 == pytest.approx(a4 * a1**2 + a0 * a3**2, rel=1e-9)
    assert point.frequency**2 == pytest.approx(a1 / a3, rel=1e-9)
    assert point.point["bit.speed"] == pytest.approx(point.value, rel=1e-12)


@pytest.mark.parametrize(
    ("loop", "number", "between"),
    [
        (compose(*RIG), "top.torque", (3000.0, 40_000.0)),
        (closed_loop(compose(*RIG), StiffPI()), "top.reference", (2.0, 9.0)),
        (closed_loop(compose(*RIG, TopDrive(drive_lag=0.1)), SoftTorque()), "top.reference", (2.0, 9.0)),
    ],
    ids=["constant torque", "stiff PI", "soft torque by a slow drive"],
)
def test_from_a_guess_some_thousandths_away_newtons_steps_alone_lead_to_the_last_digits_of_a_hopf_point(monkeypatch, loop, number, between):
    near, crossing = hopf_points(loop, number, between)[-1], hopf._crossing
    monkeypatch.setattr(hopf, "_crossing", lambda *given: None if (value := crossing(*given)) is None else 1.003 * value)
    monkeypatch.setattr(hopf, "searched", lambda *given: pytest.fail("a search from afar"))
    far = hopf_points(loop, number, between)[-1]
    assert far.residual < 1e-13
    assert [far.value, far.frequency] == pytest.approx([near.value, near.frequency], rel=1e-11)


def test_a_drive_that_gives_way_moves_the_hopf_point_down():
    plant = compose(*RIG)
    stiff, soft = (only(hopf_points(closed_loop(plant, law), "top.reference", (2.0, 9.0))).value for law in (StiffPI(), SoftTorque()))
    assert soft < 0.9 * stiff


def test_on_the_ideal_sliding_surface_the_hopf_point_is_found_with_the_relay_in_its_slide():
    point = only(hopf_points(closed_loop(compose(*RIG), IdealSlidingMode()), "top.reference", (2.0, 9.0)))
    assert point.point.modes == {"bit": "slip+", "idealslidingmode": "stick"}
    poles = linearise(point.point.plant, point.point).poles()
    np.testing.assert_allclose(sorted(poles[np.abs(poles.imag) > 1e-6].imag), [-point.frequency, point.frequency], rtol=1e-9)
    assert np.abs(poles[np.abs(poles.imag) > 1e-6].real).max() < 1e-9


def test_a_lag_in_the_drive_is_part_of_the_loop():
    # at the outermost point a pair is on the axis, and none beyond it
    point = hopf_points(closed_loop(compose(*RIG, TopDrive(drive_lag=0.1)), SoftTorque()), "top.reference", (2.0, 9.0))[-1]
    poles = linearise(point.point.plant, point.point).poles()
    assert np.abs(poles.real).min() < 1e-9 and poles.real.max() < 1e-9
    assert abs(point.value - only(hopf_points(closed_loop(compose(*RIG), SoftTorque()), "top.reference", (2.0, 9.0))).value) > 0.05


def test_the_critical_speed_over_the_weight_on_bit_is_a_logarithm():
    weights = np.array([40e3, 60e3, 80e3, 100e3])
    curve = hopf_curve(closed_loop(compose(*RIG), StiffPI()), "top.reference", (1.0, 9.0), "bit.weight", weights)
    # the slope at which the loop is lost does not depend on the speed, so W exp(-0.9 w) is constant
    np.testing.assert_allclose(weights * np.exp(-0.9 * curve), weights[0] * math.exp(-0.9 * curve[0]), rtol=1e-9)


def test_where_nothing_falls_there_is_no_hopf_point():
    assert hopf_points(compose(BlockOnBelt(damping=0.1, friction=Coulomb())), "block.belt_speed", (0.1, 1.0)) == []
    curve = hopf_curve(compose(oscillators.VERASZTO_STEPAN), "block.belt_speed", (0.01, 1.0), "block.damping", [5.746, 80.0])
    assert curve[0] == pytest.approx(0.190616, rel=1e-5) and math.isnan(curve[1])


def test_a_kink_of_a_table_at_which_the_poles_jump_across_the_axis_is_an_abrupt_loss():
    """m x'' + (c + s) x' + k x = 0 with the slope s of the table: -5, -12.7, -4.4, 0 N s/m, so that c = 8 N s/m is too little only from 0.06 to 0.115 m/s."""
    table = Tabulated(speeds=(0.0, 0.06, 0.115, 0.275, 1.0), coefficients=(2.4, 2.1, 1.4, 0.7, 0.7), static=2.4)
    block = compose(BlockOnBelt(mass=0.25, stiffness=60.0, damping=8.0, belt_speed=0.08, friction=table))
    low, high = hopf_points(block, "block.belt_speed", (0.01, 0.5))
    growth = (0.7 / 0.055 - 8.0) / (2 * 0.25)
    for point, value, stable in ((low, 0.06, "below"), (high, 0.115, "above")):
        assert point.value == pytest.approx(value, rel=1e-9) and point.stable == stable and point.kind == "abrupt"
        assert point.frequency == pytest.approx(math.sqrt(60.0 / 0.25 - growth**2), rel=1e-9)
    assert "abrupt loss of stability" in str(low)
    assert hopf_curve(block, "block.belt_speed", (0.01, 0.5), "block.mass", [0.25, 0.5]) == pytest.approx([0.115, 0.115], rel=1e-9)
    calm = compose(BlockOnBelt(mass=0.25, stiffness=60.0, damping=13.0, belt_speed=0.08, friction=table))
    assert hopf_points(calm, "block.belt_speed", (0.01, 0.5)) == []


# --- soft or hard


def test_the_loss_of_thomsen_and_fidlin_is_soft_and_its_amplitude_is_that_of_the_normal_form():
    # r' = sigma r + l r^3 for eigenvectors of length one: r = sqrt(-sigma / l), and 2 r times an entry is the amplitude of that state
    block = oscillators.THOMSEN_FIDLIN
    point = only(hopf_points(compose(block), "block.belt_speed", (0.3, 0.5)))
    assert point.kind == "soft"
    near = dataclasses.replace(block, belt_speed=0.999 * point.value)
    growth = np.linalg.eigvals(flow_slopes(equilibria(compose(near))[0])).real.max()
    amplitude = 2 * math.sqrt(-growth / (point.coefficient * point.frequency)) * math.sqrt(0.5)
    assert amplitude == pytest.approx(closed_forms.slip_amplitude(near), rel=2e-3)


def test_the_loss_of_veraszto_and_stepan_is_hard():
    assert only(hopf_points(compose(oscillators.VERASZTO_STEPAN), "block.belt_speed", (0.1, 0.3))).kind == "hard"


# --- steady states


def test_a_torque_has_a_fast_a_slow_and_a_stuck_steady_state():
    points = equilibria(closed_loop(compose(*RIG), inputs={"top.torque": 10_000.0}))
    assert [point.modes["bit"] for point in points] == ["slip+", "slip+", "stick"]
    for point in points[:2]:
        w = point["bit.speed"]
        assert 475.0 * w + FALL / 0.27 * (0.5 + 0.3 * math.exp(-0.9 * w)) == pytest.approx(10_000.0, rel=1e-9)
    growths = [np.linalg.eigvals(flow_slopes(point)).real.max() for point in points[:2]]
    assert growths[0] < 0 < growths[1]


def test_a_torque_beyond_the_static_bound_has_one_steady_state():
    points = equilibria(closed_loop(compose(*RIG), inputs={"top.torque": 14_000.0}))
    assert [point.modes["bit"] for point in points] == ["slip+"]


def test_the_slope_of_a_law_is_its_derivative_by_slip_speed():
    block = BlockOnBelt(belt_speed=0.3, load=2.0, friction=Exponential(static=1.0, kinetic=0.4, decay=2.0))
    slope = -2.0 * 0.6 * 2.0 * math.exp(-0.6)
    assert flow_slopes(equilibria(compose(block))[0])[1, 1] == pytest.approx(-(block.damping + slope) / block.mass, rel=1e-13)


# --- locus, and the objects of python-control


def test_the_poles_of_a_locus_follow_their_own_and_cross_at_the_hopf_point():
    plant = compose(*RIG)
    point = only(hopf_points(closed_loop(plant, StiffPI()), "top.reference", (2.0, 9.0)))
    speeds = np.linspace(0.8, 1.2, 81) * point.value
    locus = pole_locus(closed_loop(plant, StiffPI()), "top.reference", speeds)
    assert locus.shape == (81, 4)
    crossing = [j for j in range(4) if locus[0, j].real > 0 > locus[-1, j].real]
    assert len(crossing) == 2
    assert np.abs(np.diff(locus, axis=0)).max() < 0.05
    assert locus[40, crossing[0]].real == pytest.approx(0.0, abs=1e-9)


def test_a_bode_diagram_and_a_root_locus_come_from_the_linear_system_as_it_is():
    point = equilibria(closed_loop(compose(*RIG), inputs={"top.torque": 12_000.0}))[0]
    system = linearise(point.plant, point, inputs="top.torque", outputs="top.speed")
    response = control.frequency_response(system, np.array([1e-6, 1e4]))
    slope = -FALL * math.exp(-0.9 * point["bit.speed"])
    assert response.magnitude.ravel()[0] == pytest.approx(1 / (475.0 + slope), rel=1e-6)  # all drags, at rest
    assert response.magnitude.ravel()[1] == pytest.approx(1 / (2122.0 * 1e4), rel=1e-6)  # the top inertia alone
    assert control.root_locus_map(system, gains=[0.0, 1e3]).loci.shape == (2, 3)


# --- closed forms against simulation


def test_the_cycle_of_a_block_is_the_closed_form():
    block = BlockOnBelt(mass=2.0, stiffness=8.0, belt_speed=0.3, friction=Coulomb(static=1.2, kinetic=0.7))
    run = simulate(compose(block), 60.0, start={"block.speed": 0.3}, accuracy=1e-10)
    sticks = measure.stick_intervals(run, "belt", 20.0)[1:-1]
    cycle = closed_forms.belt_cycle(block)
    assert sticks[1][0] - sticks[0][0] == pytest.approx(cycle.period, rel=1e-8)
    assert sticks[0][1] - sticks[0][0] == pytest.approx(cycle.stick, rel=1e-8)


def test_the_cycle_of_two_disks_is_the_closed_form():
    disks = TwoDisks(rotor_inertia=1e9, damping=0.0, friction=Coulomb(static=0.4, kinetic=0.3))
    cycle = closed_forms.driven_disks_cycle(disks, 2.0)
    z = 1000.0 * 0.1 * 0.1 * math.sqrt(2000.0 / 0.02) / (2000.0 * 2.0)
    assert cycle.period * math.sqrt(2000.0 / 0.02) / (2 * math.pi) == pytest.approx(1 + (z - math.atan(z)) / math.pi, rel=1e-14)
    run = simulate(compose(disks), 1.0, start={"disks.rotor_speed": 2.0, "disks.stator_speed": 2.0}, accuracy=1e-10)
    sticks = measure.stick_intervals(run, "disks", 0.5)[1:-1]
    assert sticks[1][0] - sticks[0][0] == pytest.approx(cycle.period, rel=1e-6)
    assert sticks[0][1] - sticks[0][0] == pytest.approx(cycle.stick, rel=1e-6)


@pytest.mark.parametrize("r", [0.7, 1.3])
def test_den_hartogs_amplitude_is_that_of_the_run(r):
    block = BlockOnBelt(mass=2.0, stiffness=8.0, belt_speed=0.0, friction=Coulomb(static=0.3, kinetic=0.3))
    run = simulate(compose(block), 400.0, inputs={"block.force": sine(0.0, 1.0, 2 * r / (2 * math.pi))}, accuracy=1e-9)
    found = measure.extent(run, "block.position", 380.0)
    assert (found.maximum - found.minimum) / 2 == pytest.approx(closed_forms.den_hartog_amplitude(block, 1.0, 2 * r), rel=1e-5)


@pytest.mark.parametrize("odd", [3, 5, 7])
def test_no_motion_at_an_odd_part_of_the_natural_frequency_is_without_stops(odd):
    block = BlockOnBelt(belt_speed=0.0, friction=Coulomb(0.1, 0.1))
    assert closed_forms.den_hartog_bound(block, 1.0 / odd) < 1e-14
    assert closed_forms.den_hartog_bound(block, 1.001 / odd) > 1e-4
    with pytest.raises(SceneError, match="Argument `force` must be >= "):
        closed_forms.den_hartog_amplitude(block, 1.0, 1.0 / odd)


def test_den_hartogs_amplitude_is_refused_where_the_motion_has_stops():
    block = BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=0.9, kinetic=0.9))
    with pytest.raises(SceneError, match="without stops"):
        closed_forms.den_hartog_amplitude(block, 1.0, 0.7)
    free = dataclasses.replace(block, friction=Coulomb(static=0.0, kinetic=0.0))
    assert closed_forms.den_hartog_amplitude(free, 1.0, 0.5) == pytest.approx(1 / (1 - 0.25), rel=1e-14)


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: closed_forms.belt_cycle(BlockOnBelt()), "friction"),
        (lambda: closed_forms.belt_cycle(BlockOnBelt(friction=Coulomb(), damping=0.1)), "damping"),
        (lambda: closed_forms.belt_cycle(BlockOnBelt(friction=Coulomb(), belt_speed=0.0)), "speed"),
        (lambda: closed_forms.driven_disks_cycle(TwoDisks(friction=Coulomb()), 2.0), "damping"),
        (lambda: closed_forms.stick_slip_speed(BlockOnBelt()), "CubicStribeck"),
        (lambda: closed_forms.slip_amplitude(dataclasses.replace(oscillators.THOMSEN_FIDLIN, belt_speed=0.1)), "sticks"),
        (lambda: closed_forms.den_hartog_amplitude(BlockOnBelt(belt_speed=0.0), 1.0, 0.5), "static = kinetic"),
        (lambda: closed_forms.den_hartog_bound(BlockOnBelt(belt_speed=0.0), 1.0), "frequency"),
        (lambda: closed_forms.bearable_fall(wells.NAVARRO_LOPEZ_4), "2 inertias"),
        (lambda: closed_forms.hopf_speed_of_string(wells.JANSEN_2, BitRock(friction=Coulomb())), "Exponential"),
    ],
)
def test_a_closed_form_is_refused_outside_of_its_range(call, word):
    with pytest.raises(SceneError, match=word):
        call()


# --- mistakes


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"parameter": "top.refrence"}, "top.reference"),
        ({"bounds": (3.0, 2.0)}, "bounds"),
        ({"bounds": (3.0, math.nan)}, "bounds"),
        ({"bounds": 3.0}, "bounds"),
        ({"parameter": "chain.inertia"}, "chain.inertia.0"),
        ({"controller": lambda t, y: 0.0, "sample_time": 0.1}, "continuous form"),
        ({"inputs": {"bit.wieght": 1.0}}, "bit.weight"),
    ],
)
def test_a_mistake_is_named(arguments, word):
    asked = {"parameter": "top.reference", "bounds": (2.0, 8.0)}
    others = {key: value for key, value in arguments.items() if key not in asked}
    with pytest.raises(SceneError, match=word):
        hopf_points(
            closed_loop(compose(*RIG), **({"controller": StiffPI()} | others)),
            **(asked | {k: arguments[k] for k in asked if k in arguments}),
        )


def test_a_sampled_law_is_not_taken_for_its_continuous_form_without_a_word():
    with pytest.raises(SceneError, match="sample time and delay would be left out"):
        linearise(closed_loop(compose(*RIG), [Sampled(StiffPI(), 0.05)]))
    continuous = only(hopf_points(closed_loop(compose(*RIG), StiffPI()), "top.reference", (2.0, 8.0)))
    sampled = [
        only(hopf_points(closed_loop(compose(*RIG), Sampled(StiffPI(), *clock)), "top.reference", (2.0, 8.0)))
        for clock in ((1e-4, 0.0), (0.05, 0.3))
    ]
    assert sampled[0].value == pytest.approx(continuous.value, abs=2e-4) != pytest.approx(sampled[1].value, abs=5e-3)
    with pytest.raises(SceneError, match="`mode` must be left out"):
        pole_locus(closed_loop(compose(*RIG), Sampled(StiffPI(), 0.05)), "top.reference", [4.0], mode={"bit": "slip+"})


test_wrong_uses_are_refused_in_these_words = refusals(
    *each_of(lambda force: closed_forms.den_hartog_amplitude(BlockOnBelt(belt_speed=0.0, friction=Coulomb(0.1, 0.1)), force, 0.7),
     "Argument `force` must be > 0", [0.0, -1.0, -0.05]),
    # relaxed for long enough its angle is so large that round-off would hide its rate, and a state that never rests would be taken for one
    (lambda: hopf_points(Scene.load(Path(__file__).parents[2] / "studies" / "scenes" / "whirl.toml")["stiff PI"], "top.reference",
     ("60 rpm", "160 rpm")), "`collar.angle` still changes", NoSteadyState),
)  # fmt: skip
