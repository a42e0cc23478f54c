"""Both borders of stick-slip by simulation: against closed forms, against each other, and with the laws that move them."""

from __future__ import annotations

import csv
import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from controllers import PI, SoftTorque, StiffPI
from models import BitRock, BlockOnBelt, Coulomb, TopDrive, closed_forms, oscillators, wells
from toolbox import Sampled, SceneError, closed_loop, compose, follow, hopf_points, limit_cycle, measure, onset, simulate
from toolbox.onsets.comparison import Comparison
from toolbox.onsets.results import Border
from toolbox.scenes.scene import Scene


@pytest.fixture(scope="module")
def rig():
    return compose(wells.JANSEN_2, BitRock())


@pytest.fixture(scope="module")
def stiff(rig):
    return onset(closed_loop(rig, StiffPI(reference=9.95)), "top.reference", (2.0, 16.0), num_values=8)


@pytest.fixture(scope="module")
def soft(rig):
    return onset(closed_loop(rig, SoftTorque(reference=9.95)), "top.reference", (2.0, 16.0), num_values=8)


def test_both_borders_of_thomsen_and_fidlin_are_those_of_first_order():
    block = oscillators.THOMSEN_FIDLIN
    found = onset(compose(block), "block.belt_speed", (0.3, 0.5), num_values=6, tolerance=1e-3)
    # smooth running is lost at v_b1 exactly; stick-slip ends at v_b0 to first order in damping and friction
    assert found.loss == pytest.approx(oscillators.hopf_speed(block), abs=1.1e-3)
    assert found.end == pytest.approx(closed_forms.stick_slip_speed(block), rel=0.02)
    assert found.end < found.loss and found.bistable == []
    assert found.hopf[0].value == pytest.approx(oscillators.hopf_speed(block), rel=1e-12) and found.hopf[0].kind == "soft"
    assert found.verdict((found.end + found.loss) / 2) == "swing"
    assert all(border.confirmed and border.safe == "above" for border in (*found.losses, *found.ends))


@pytest.mark.slow
def test_to_the_left_borders_are_those_to_the_right_and_one_at_rest_has_no_margin(rig):
    found = onset(closed_loop(rig, PI(reference=8.0)), "top.reference", (-11.0, 11.0), num_values=7)
    for borders in (found.losses, found.ends):
        left, right = borders
        assert left.value == pytest.approx(-right.value, rel=1e-6) and (left.safe, right.safe) == ("below", "above")
    assert any(abs(border.value) <= border.tolerance for border in found.breakaways)
    assert found.advice.count("%") == 2 and "break-away" not in found.advice


@pytest.mark.parametrize("damping", [0.05, 0.16])
def test_stick_slip_on_a_belt_ends_where_the_block_just_reaches_the_belt_again(damping):
    """A change of the belt's speed would end a stick at once if the block were not carried along with it."""
    static, kinetic = 1.0, 0.5

    def reaches(speed):
        """Highest speed of the block after its stick, above that of the belt, in closed form: a free damped swing about the stretch that friction holds."""
        z = damping / 2
        w = math.sqrt(1 - z**2)
        a = static - damping * speed - kinetic
        b = (speed + z * a) / w
        t = np.linspace(2.0, 9.0, 20_001)
        return (np.exp(-z * t) * ((w * b - z * a) * np.cos(w * t) - (z * b + w * a) * np.sin(w * t))).max() - speed

    block = compose(BlockOnBelt(damping=damping, friction=Coulomb(static=static, kinetic=kinetic)))
    found = onset(block, "block.belt_speed", (0.05, 8.0), num_values=9)
    assert found.end == pytest.approx(brentq(reaches, 0.05, 8.0), rel=1e-5)
    assert found.ends[0].followed == "grazing-sliding"


def test_the_smooth_onset_of_a_stiff_drive_understates_the_danger_by_a_factor_of_about_three(stiff):
    assert stiff.loss == pytest.approx(stiff.hopf[0].value, abs=2 * stiff.losses[0].tolerance)
    assert 2.5 < stiff.end / stiff.loss < 3.5
    assert stiff.bistable == [(stiff.loss, stiff.end)]
    assert stiff.verdict(stiff.at) == "bistable"
    assert all(border.confirmed for border in (*stiff.losses, *stiff.ends))


def test_what_the_report_calls_bistable_is_so_in_plain_runs(rig, stiff):
    law = StiffPI(reference=9.95)
    rest = next(point for point in (stiff.hopf[0].point,))
    assert rest["bit.speed"] == pytest.approx(stiff.hopf[0].value, rel=1e-9)
    twist = (50.0 * 9.95 + 97_347.0 * 0.155575 * (0.5 + 0.3 * math.exp(-0.9 * 9.95))) / 473.0
    smooth = {"chain.speed": (9.95, 9.95), "chain.twist": twist, "stiffpi.angle": (425.0 * 9.95 + 473.0 * twist) / 2000.0}
    calm = simulate(rig, 600.0, controller=law, start=smooth | {"chain.speed": (9.95, 9.9)})
    begun = simulate(rig, 600.0, controller=law, start=smooth | {"chain.speed": (9.95, 0.0)})
    assert measure.stick_intervals(calm, "bit") == []
    assert measure.stuck_ratio(begun, "bit", 500.0) > 0.1


@pytest.mark.slow
def test_a_drive_that_gives_way_moves_both_borders_down(stiff, soft):
    assert soft.loss < 0.9 * stiff.loss
    assert soft.end < 0.75 * stiff.end
    assert stiff.verdict(9.95) == "bistable" and soft.verdict(9.95) == "free"
    assert soft.ends[0].margin(9.95) > 0 > stiff.ends[0].margin(9.95)


def test_the_border_of_stick_slip_is_where_plain_runs_from_inside_change_their_fate(rig, soft):
    # another way: a ramp of the set-point from inside stick-slip, slow enough for the cycle to be gone where it stops being stable
    law = SoftTorque(reference=6.0)
    ramp = ((0.0, 200.0, 1000.0, 21_000.0), (6.0, 6.0, 8.2, 8.6))
    run = simulate(rig, 21_000.0, controller=law, inputs={"top.reference": ramp}, start={"chain.speed": (6.0, 0.0)})
    last = measure.stick_intervals(run, "bit")[-1][1]
    assert float(np.interp(last, *ramp)) == pytest.approx(soft.end, rel=5e-3)


def test_beyond_the_hopf_speed_of_veraszto_and_stepan_the_hard_loss_makes_a_bistable_band():
    found = onset(compose(oscillators.VERASZTO_STEPAN), "block.belt_speed", (0.1, 0.5), num_values=6)
    hopf = oscillators.hopf_speed(oscillators.VERASZTO_STEPAN)
    assert found.loss == pytest.approx(hopf, abs=2 * found.losses[0].tolerance)
    assert found.hopf[0].kind == "hard"
    assert found.bistable == [(found.loss, found.end)] and found.end > 1.3 * hopf


def test_a_sampled_law_is_judged_as_it_runs(rig, soft):
    law = SoftTorque(reference=9.95)
    fast = onset(closed_loop(rig, law, sample_time=0.02), "top.reference", (3.0, 9.0), num_values=3, tolerance=0.1, duration=300.0)
    assert fast.loss == pytest.approx(soft.loss, abs=0.2) and fast.end == pytest.approx(soft.end, abs=0.3)
    assert fast.hopf[0].value == pytest.approx(fast.loss, abs=1e-8)
    # half a second late, the loop is another one, though its continuous form is the same
    late = onset(closed_loop(rig, Sampled(law, 0.02, 0.5)), "top.reference", (3.0, 9.0), num_values=3, tolerance=0.1, duration=300.0)
    assert late.loss != pytest.approx(fast.loss, abs=0.3)


def test_a_gain_and_a_weight_can_be_what_varies(rig):
    found = onset(closed_loop(rig, StiffPI(reference=4.0)), "bit.weight", (2000.0, 140_000.0), num_values=7, tolerance=500.0)
    assert [border.safe for border in found.losses] == ["below"] and found.losses[0].margin(2000.0) > 0
    # the slope that is lost does not depend on the speed: W exp(-0.9 w) is what it is at the Hopf speed of the declared weight
    speed = hopf_points(closed_loop(rig, StiffPI()), "top.reference", (2.0, 8.0))[0].value
    hopf = 97_347.0 * math.exp(-0.9 * (speed - 4.0))
    assert found.hopf[0].value == pytest.approx(hopf, rel=1e-9)
    assert found.loss == pytest.approx(hopf, abs=1000.0)
    assert found.end < found.loss
    gain = onset(
        closed_loop(rig, PI(proportional=4000.0, integral=300.0, reference=5.0)), "pi.proportional", (200.0, 20_000.0), num_values=4
    )
    assert gain.unit == "N m s/rad" and gain.at == 4000.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("between", "values", "tolerance"),
    [((6000.0, 14_000.0), 5, 10.0), ((9000.0, 13_000.0), 13, None), ((10_550.0, 12_500.0), 4, 50.0), ((9900.0, 12_200.0), 7, None)],
)
def test_under_a_constant_torque_stick_slip_ends_at_one_torque_and_standstill_at_another(between, values, tolerance):
    # standstill holds up to the break-away torque W R mu_s; the cycle of this string is gone far below it, in whatever range it is asked for
    plant = compose(wells.NAVARRO_LOPEZ_4, BitRock())
    found = onset(closed_loop(plant, inputs={"top.torque": 10_560.0}), "top.torque", between, num_values=values, tolerance=tolerance)
    assert found.breakaway == pytest.approx(0.8 * 97_347.0 * 0.155575, rel=1e-8) and found.breakaways[0].safe == "above"
    cycle = limit_cycle(simulate(plant, 400.0, inputs={"top.torque": 10_300.0}, accuracy=1e-9))
    lost = follow(cycle, "top.torque", (10_300.0, 11_000.0), start_towards=11_000.0).bifurcations[0]
    # beside it lives a cycle of twice the period, which lasts 0.13 N m longer
    assert found.end == pytest.approx(lost.value, rel=2e-5) and [border.safe for border in found.ends] == ["above"]
    assert found.verdict(10_560.0) == "bistable" and found.verdict(11_800.0) == "smooth or stuck"
    assert found.regimes(11_800.0) == ("smooth", "standstill") and found.regimes(12_150.0) == ("smooth",)
    assert found.bistable[-1][1] == found.end


@pytest.mark.slow
def test_towards_low_torques_stick_slip_does_not_end_in_smooth_running_but_stalls():
    plant = compose(wells.NAVARRO_LOPEZ_4, BitRock())
    found = onset(closed_loop(plant, inputs={"top.torque": 10_300.0}), "top.torque", (9000.0, 11_000.0), num_values=5)
    assert [border.safe for border in found.stalls] == ["below"] and found.stalls[0].beyond == "stands"
    # an independent way: the torque lowered by a part in 3e5 per second
    lowered = ((0.0, 100.0, 3500.0, 33_500.0), (10_300.0, 10_300.0, 10_000.0, 9000.0))
    run = simulate(plant, 33_500.0, inputs={"top.torque": lowered})
    begin, end = measure.stick_intervals(run, "bit")[-1]
    assert end == run.end and float(np.interp(begin, *lowered)) == pytest.approx(found.stall, rel=5e-3)
    assert found.verdict(9500.0) == "smooth or stuck" and found.verdict(9100.0) == "stuck"
    for word in ("existing stick-slip ends", "existing stick-slip stalls", "period doubling", "fold"):
        assert word in str(found)


@pytest.mark.slow
def test_a_limit_of_the_motor_frees_a_bit_that_the_same_law_without_limit_keeps(stiff):
    limited = compose(wells.JANSEN_2, BitRock(), TopDrive(torque_limit=15_000.0))
    # the steady state is behind the limit for a search that begins at rest
    found = onset(closed_loop(limited, StiffPI(reference=9.95)), "top.reference", (4.0, 13.0), num_values=5, tolerance=0.1)
    assert found.hopf[0].value == pytest.approx(stiff.hopf[0].value, rel=1e-3)  # small swings never meet the limit
    assert found.end < stiff.end - 1.0


def test_a_machine_without_falling_friction_is_free_everywhere():
    plant = compose(BlockOnBelt(damping=0.1, friction=Coulomb(static=1.0, kinetic=1.0)))
    found = onset(plant, "block.belt_speed", (0.1, 1.0), num_values=3)
    assert found.losses == () and found.ends == () and found.hopf == () and found.bistable == []
    assert math.isnan(found.loss) and math.isnan(found.end)
    assert found.verdict(0.5) == "free" and "no stick-slip was found" in str(found)


def test_a_single_release_is_not_stick_slip(rig):
    # the bit starts stuck and breaks free once under soft torque: that run must not count
    found = onset(closed_loop(rig, SoftTorque()), "top.reference", (10.0, 14.0), num_values=3)
    assert {judged.regime for judged in (*found.smooth, *found.sticking)} == {"smooth"}
    run = simulate(rig, 100.0, controller=SoftTorque(reference=10.0))
    assert len(measure.stick_intervals(run, "bit")) >= 1


def test_the_report_shows_both_branches_margins_and_what_was_checked(stiff):
    text = str(stiff)
    for word in (
        "Hopf point",
        "smooth running is lost",
        "existing stick-slip ends",
        "bistable",
        "Margin",
        "from smooth running",
        "Checked",
    ):
        assert word in text
    assert "NOT confirmed" not in text and f"{stiff.runs} runs" in text


def test_a_scene_gives_its_plant_contact_and_law_by_label(root, tmp_path):
    scene = Scene.load(root / "studies" / "scenes" / "jansen_2.toml")
    found = onset(scene["soft torque"], "top.reference", (2.0, 16.0), num_values=4, tolerance=0.2)
    assert found.element == "bit" and found.at == pytest.approx(95 * math.pi / 30)
    path = found.save(tmp_path / "onset.csv")
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    np.testing.assert_array_equal([float(row["top.reference [rad/s]"]) for row in rows], found.values)
    assert {row["smooth regime"] for row in rows} <= {"smooth", "sticks and slips", "swings"}


def test_a_comparison_names_every_controller(stiff, soft):
    table = str(Comparison({"stiff": stiff, "soft": soft}, {"none": "no reference"}))
    assert "bistable" in table and "free" in table and "none failed: no reference" in table
    with pytest.raises(SceneError, match="soft"):
        Comparison({"stiff": stiff, "soft": soft})["sofd"]


def test_a_margin_is_positive_on_the_safe_side():
    assert Border(10.0, 0.1, "above", True).margin(12.0) == pytest.approx(0.2)
    assert Border(10.0, 0.1, "below", True).margin(12.0) == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"loop": 3}, "Argument `loop`"),
        ({"parameter": "top.referenc"}, "top.reference"),
        ({"bounds": (5.0, 1.0)}, "bounds"),
        ({"values": 2}, "values"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"duration": -1.0}, "duration"),
        ({"perturbation": math.nan}, "perturbation"),
    ],
)
def test_a_mistake_is_named(rig, arguments, word):
    given = {"loop": closed_loop(rig, StiffPI()), "parameter": "top.reference", "bounds": (2.0, 8.0)} | arguments
    with pytest.raises(SceneError, match=word):
        onset(given.pop("loop"), given.pop("parameter"), given.pop("bounds"), **given)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"element": "bitt"}, "no contact `bitt` to be judged: did you mean `bit`"),
        ({"signal": "bit.sped"}, "no signal `bit.sped`: did you mean `bit.speed`"),
        ({"controller": lambda t, y: 0.0, "sample_time": 0.1}, "a set-point belongs to a control law"),
        ({"inputs": {"bit.weight": math.nan}}, "Argument `bit.weight` must be a finite number"),
    ],
)
def test_a_mistake_in_the_loop_is_named(rig, arguments, word):
    with pytest.raises(SceneError, match=word):
        onset(closed_loop(rig, **{"controller": StiffPI(), **arguments}), "top.reference", (2.0, 8.0))


def test_a_working_point_is_a_finite_number(rig):
    with pytest.raises(SceneError, match="Argument `top.reference` must be a finite number"):
        onset(closed_loop(rig, StiffPI()).at("top.reference", math.inf), "top.reference", (2.0, 8.0))


def test_what_belongs_to_the_loop_is_refused_with_the_line_to_write(rig):
    with pytest.raises(SceneError, match=r"write `onset\(closed_loop\(plant, law, element=\.\.\.\), \.\.\.\)`"):
        onset(rig, "top.reference", (2.0, 8.0), controller=StiffPI(), element="bit")


def test_a_scene_whose_input_moves_has_no_onset(root):
    scene = Scene.load(root / "studies" / "scenes" / "jansen_2.toml")
    from toolbox.scenes.cases import Waveform

    moving = dataclasses.replace(scene, inputs={"bit.weight": Waveform("step", {"before": 1.0, "after": 2.0, "at": 1.0})})
    with pytest.raises(SceneError, match=r"bit\.weight.*must be a number"):
        onset(moving["stiff PI"], "top.reference", (2.0, 8.0))


def test_a_cycle_that_sticks_twice_is_judged_over_whole_cycles():
    """An integrating drive holds the mean at the set-point, so the severity is swing / (2 set-point), whatever the pattern of sticks."""
    plant, law = compose(wells.JANSEN_2, BitRock(weight=60e3)), PI(proportional=400.0, integral=250.0)
    found = onset(closed_loop(plant, law), "top.reference", (1.45, 1.55), num_values=3)
    run = simulate(plant, 1000.0, controller=law, inputs={"top.reference": 1.45}, start={"chain.speed": (1.45, 0.0)})
    sticks = [b - a for a, b in measure.stick_intervals(run, "bit", 500.0) if b < run.end]
    assert abs(sticks[-1] - sticks[-2]) > 0.5 and sticks[-1] == pytest.approx(sticks[-3], rel=1e-3)
    swing = measure.extent(run, "bit.speed", 500.0)
    expected = (swing.maximum - swing.minimum) / (2 * 1.45)
    assert [each[0].severity for each in (found.smooth, found.sticking)] == pytest.approx([expected] * 2, rel=1e-3)


@pytest.mark.slow
def test_measurement_noise_hides_neither_border():
    """Smooth running is lost where it is without noise; existing stick-slip is judged with the noise, of which 2 % of swing are left when it has ended."""
    plant, law = compose(wells.JANSEN_2, BitRock(weight=60e3)), SoftTorque(reference=6.0)
    calm, noisy = (
        onset(closed_loop(plant, Sampled(law, 0.05, noise=noise, seed=11)), "top.reference", (2.5, 9.0), num_values=3)
        for noise in ({}, {"top.speed": 0.1})
    )
    assert noisy.loss == calm.loss
    assert noisy.end == pytest.approx(calm.end, rel=0.05)
    assert [each.regime for each in noisy.smooth] == [each.regime for each in calm.smooth]
    assert noisy.sticking[-1].regime == "smooth" and 0.001 < noisy.sticking[-1].severity < 0.05
    assert any("without measurement noise" in note for note in noisy.notes)
