"""Torque and drag against closed forms: a straight inclined hole, the capstan, a cone of friction, and a string that is wound up while its bit stays."""

from __future__ import annotations

import dataclasses
import math
import re

import matplotlib
import numpy as np
import pytest

from models import Coulomb, DrillString, Section, Survey, TorqueDrag, torque_drag, torque_drag_operations
from toolbox import SceneError, compose, simulate
from toolbox.commands.command_line import main
from toolbox.inputs import ramp

PIPE = Section(1500.0, 0.127, 0.1086)
COLLAR = Section(200.0, 0.165, 0.0714)
INCLINATION, MU, MUD = 0.9, 0.25, 1200.0
STRAIGHT = Survey((0.0, 2000.0), (INCLINATION,) * 2, (0.4,) * 2)
WEIGHTS = (PIPE.weight(MUD) * 1500.0, COLLAR.weight(MUD) * 200.0)
ACROSS, ALONG = sum(WEIGHTS) * math.sin(INCLINATION), sum(WEIGHTS) * math.cos(INCLINATION)
TURNED = sum(w * radius for w, radius in zip(WEIGHTS, (0.127 / 2, 0.165 / 2), strict=True)) * math.sin(INCLINATION)


def moved(**kind):
    return torque_drag([PIPE, COLLAR], STRAIGHT, MU, mud_density=MUD, **kind)


@pytest.mark.parametrize(("speed", "way"), [(-0.3, 1.0), ("0.3 m/s", -1.0)], ids=["pulled", "lowered"])
def test_in_a_straight_hole_the_drag_is_mu_times_the_weight_across_it(speed, way):
    found = moved(axial_speed=speed, weight_on_bit="20 kN")
    assert found.drag == pytest.approx(way * MU * ACROSS, rel=1e-12)
    assert found.tension[0] == pytest.approx(ALONG - 20e3 + way * MU * ACROSS, rel=1e-12)
    assert found.is_moving and not found.torque.any() and found.tension[-1] == -20e3


def test_in_a_straight_hole_the_torque_is_mu_times_the_weight_across_it_times_the_radius():
    found = moved(turning_speed="120 rpm", bit_torque="3 kN m")
    assert found.torque[0] == pytest.approx(3e3 + MU * TURNED, rel=1e-12)
    assert found.drag == 0.0 and found.torque[-1] == 3e3
    assert moved(turning_speed="-120 rpm", bit_torque="3 kN m").torque[0] == pytest.approx(-found.torque[0], rel=1e-15)


def test_a_string_that_slides_and_turns_shares_one_cone():
    pipe, v, w = [dataclasses.replace(PIPE, length=1700.0)], -0.2, 5.0
    found = torque_drag(pipe, STRAIGHT, MU, axial_speed=v, turning_speed=w)
    load, slip = 1700.0 * pipe[0].weight() * math.sin(INCLINATION), math.hypot(v, w * 0.0635)
    assert found.drag == pytest.approx(MU * load * 0.2 / slip, rel=1e-12)
    assert found.torque[0] == pytest.approx(MU * load * 0.0635 * (w * 0.0635) / slip, rel=1e-12)


@pytest.mark.parametrize(("speed", "way"), [(-0.1, -1.0), (0.1, 1.0)], ids=["pulled", "lowered"])
def test_a_weightless_string_in_a_curve_is_a_capstan(speed, way):
    # dT/dtheta = +-mu T in mud of its own density, pushed on by the weight on bit
    radius, angle, mu = 300.0, 1.3, 0.4
    hole = Survey((0.0, 100.0, 100.0 + radius * angle, 800.0), (0.0, 0.0, angle, angle), (0.0,) * 4)
    found = torque_drag([dataclasses.replace(PIPE, length=800.0)], hole, mu, axial_speed=speed, mud_density=7850.0, weight_on_bit=5e4)
    below = found.depth >= 100.0 + radius * angle
    assert (found.tension[below] == -5e4).all()
    turned = np.clip((100.0 + radius * angle - found.depth) / radius, 0.0, angle)
    np.testing.assert_allclose(found.tension, -5e4 * np.exp(way * mu * turned), rtol=1e-9)


def test_a_pipe_pulled_through_a_flat_turn_weighs_on_its_low_side_too():
    # T' = mu sqrt((T / R)^2 + w^2) in a horizontal turn: T = R w sinh(mu theta) from a free end
    radius, angle, mu = 400.0, 1.5, 0.3
    hole = Survey((0.0, 300.0, 600.0), (math.pi / 2,) * 3, (0.0, angle / 2, angle))
    found = torque_drag([dataclasses.replace(PIPE, length=600.0)], hole, mu, axial_speed=-1.0)
    np.testing.assert_allclose(found.tension, radius * PIPE.weight() * np.sinh(mu * (600.0 - found.depth) / radius), rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize(("kind", "sign"), [({"axial_speed": -1.0}, 1.0), ({"axial_speed": 1.0}, -1.0)], ids=["pulled", "lowered"])
def test_a_string_pulled_too_little_slides_as_far_as_its_friction_is_overcome(kind, sign):
    # (H - H0) = mu w sin(inc) s
    part, across = 0.4013, MU * PIPE.weight(MUD) * math.sin(INCLINATION)
    found = moved(load_at_top=ALONG + sign * part * across * 1500.0, **kind)
    assert found.sliding_front == pytest.approx(part * 1500.0, rel=1e-9) and not found.is_moving
    np.testing.assert_allclose(
        found.tension - found.frictionless_tension, sign * across * np.maximum(0.0, found.sliding_front - found.depth), atol=1e-6
    )
    assert not found.torque.any() and found.is_sliding.sum() == np.count_nonzero(found.depth <= 0.4013 * 1500.0)


def test_a_string_wound_up_too_little_is_twisted_down_to_its_front():
    # M = mu w sin(inc) R (s* - s), twist = M0^2 / (2 G J mu w sin(inc) R)
    slope = MU * PIPE.weight(MUD) * math.sin(INCLINATION) * PIPE.outer / 2
    found = moved(turning_speed=1.0, load_at_top=f"{slope * 700.0} N m")
    assert found.sliding_front == pytest.approx(700.0, rel=1e-9)
    assert found.twist == pytest.approx((slope * 700.0) ** 2 / (2 * PIPE.torsional_rigidity * slope), rel=1e-9)
    assert (found.torque[found.depth > 700.0] == 0.0).all() and found.drag == 0.0
    whole = moved(turning_speed=1.0)
    assert moved(turning_speed=1.0, load_at_top=1.01 * whole.torque[0]).torque[0] == whole.torque[0] and whole.is_moving


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_string_that_brings_its_bit_less_torque_than_the_rock_takes_slides_down_to_the_bit(way):
    # M = M0 - mu w sin(inc) R s reaches the bit with M0 - mu (..), 1 kN m of the 3 that the rock takes
    whole = moved(turning_speed=way, bit_torque="3 kN m")
    found = moved(turning_speed=way, bit_torque="3 kN m", load_at_top=way * (1e3 + MU * TURNED))
    assert found.torque[-1] == pytest.approx(way * 1e3, rel=1e-9)
    assert whole.torque - found.torque == pytest.approx(np.full(found.depth.size, way * 2e3), rel=1e-9)
    assert found.sliding_front == found.depth[-1] and found.bit_static and not found.is_moving and "which the rock holds" in str(found)
    assert not whole.bit_static and whole.is_moving


def test_the_run_of_a_string_that_is_wound_up_slowly_leaves_stuck_what_is_below_the_front():
    hole = Survey((0.0, 600.0, 1100.0, 1700.0), (0.0, 0.0, 1.2, 1.2), (0.0,) * 4)
    chain = DrillString.from_tables([PIPE, COLLAR], hole, top_inertia=500.0, elements=20, friction=Coulomb(MU, MU), mud_density=MUD, doglegs=True,
                                    internal_damping=0.3, drag_rate=2.0)  # fmt: skip
    whole = torque_drag([PIPE, COLLAR], hole, MU, mud_density=MUD, turning_speed=1.0)
    torque = 0.45 * whole.torque[0]
    run = simulate(compose(chain), 100.0, inputs={"top.torque": ramp(0.0, torque, begin=0.0, finish=85.0)}, accuracy=1e-4)
    found = torque_drag([PIPE, COLLAR], hole, MU, mud_density=MUD, turning_speed=1.0, load_at_top=torque)
    slid = [chain.depth[i] for i in chain.friction_at if run.time_in(f"chain.{i}", "stick") < 95.0]
    spacing = max(np.diff(chain.depth))
    assert 800.0 < found.sliding_front < 1600.0 and max(slid) == pytest.approx(found.sliding_front, abs=1.5 * spacing)
    assert float(np.sum(run.at(100.0)["chain.twist"])) == pytest.approx(found.twist, rel=0.03)


def test_its_picture_shades_what_is_stuck_and_takes_another_motion(tmp_path):
    matplotlib.use("Agg")
    found = moved(axial_speed=-1.0)
    axes = found.plot("pulled")
    part = moved(turning_speed=1.0, load_at_top=2000.0)
    assert part.plot("wound", axes) is axes and not part.is_moving
    assert [text.get_text() for text in axes[0].figure.legends[0].get_texts()] == [
        "without drag",
        "pulled",
        "wound",
        "stuck, wound",
    ] and not axes[0].patches
    band = axes[1].patches[0].get_extents().transformed(axes[1].transData.inverted())
    assert sorted((band.y0, band.y1)) == pytest.approx([part.sliding_front, 1700.0])
    assert TorqueDrag.load(part.save(tmp_path / "part.npz")).sliding_front == part.sliding_front
    assert len(part.to_csv(tmp_path / "part.csv").read_text().splitlines()) == part.depth.size + 1
    assert "stuck below" in str(part) and "all of it slides" in str(found)


def test_the_path_of_a_well_is_drawn_to_scale():
    matplotlib.use("Agg")
    hole = Survey((0.0, 500.0, 1000.0, 2000.0), (0.0, 0.0, 1.0, 1.0), (0.5,) * 4)
    section, plan = hole.plot()
    end = hole.position([2000.0])[0]
    (x, y) = section.get_lines()[0].get_data()
    assert (x[-1], y[-1]) == pytest.approx((math.hypot(end[0], end[1]), end[2])) and section.yaxis_inverted()
    (x, y) = plan.get_lines()[0].get_data()
    assert (x[-1], y[-1]) == pytest.approx((end[1], end[0])) and "29°" in section.get_xlabel()
    assert section.get_aspect() == plan.get_aspect() == 1.0


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ({}, "must not both be 0"),
        ({"turning_speed": 1.0, "axial_speed": 1.0, "load_at_top": 1.0}, "one motion"),
        ({"turning_speed": 1.0, "load_at_top": -5.0}, "torque above 0 N m"),
        ({"axial_speed": -1.0, "load_at_top": 1.0}, "hook load above"),
        ({"axial_speed": 1.0, "load_at_top": 1e7}, "hook load below"),
        ({"axial_speed": 1.0, "weight_on_bit": -1.0}, "weight_on_bit"),
    ],
)
def test_what_does_not_move_or_is_not_against_friction_is_refused(kind, words):
    with pytest.raises(SceneError, match=words):
        moved(**kind)


@pytest.mark.parametrize("speed", ["-0.3 m/s", "0.3 m/s"])
def test_every_length_of_a_straight_hole_takes_its_own_friction_factor(speed):
    # casing over the upper 900 m: the drag is the sum of mu w sin(inc) over the lengths
    found = torque_drag([PIPE, COLLAR], STRAIGHT, [("900 m", 0.15), (1700.0, 0.4)], mud_density=MUD, axial_speed=speed)
    w_pipe, w_collar = PIPE.weight(MUD), COLLAR.weight(MUD)
    across = math.sin(INCLINATION) * (0.15 * w_pipe * 900.0 + 0.4 * (w_pipe * 600.0 + w_collar * 200.0))
    assert abs(found.drag) == pytest.approx(across, rel=1e-12)
    turned = torque_drag([PIPE, COLLAR], STRAIGHT, [("900 m", 0.15), (1700.0, 0.4)], mud_density=MUD, turning_speed=1.0)
    own = (0.15 * w_pipe * 900.0 + 0.4 * w_pipe * 600.0) * 0.127 / 2 + 0.4 * w_collar * 200.0 * 0.165 / 2
    assert turned.torque[0] == pytest.approx(own * math.sin(INCLINATION), rel=1e-12)


def test_a_stuck_string_that_is_pulled_is_a_capstan_with_two_factors():
    # T(top) = overpull exp(mu_1 theta_1 + mu_2 theta_2), without weight
    radius, angle = 300.0, 1.2
    hole = Survey((0.0, 100.0, 100.0 + radius * angle, 800.0), (0.0, 0.0, angle, angle), (0.0,) * 4)
    factors = [(100.0 + radius * 0.5, 0.2), (800.0, 0.35)]
    pipe = [dataclasses.replace(PIPE, length=800.0)]
    found = torque_drag(pipe, hole, factors, axial_speed=-1.0, mud_density=7850.0, overpull="50 kN")
    assert found.tension[-1] == 5e4 and found.tension[0] == pytest.approx(5e4 * math.exp(0.2 * 0.5 + 0.35 * 0.7), rel=1e-9)


def test_one_factor_over_two_depths_is_one_factor():
    hole = Survey((0.0, 500.0, 1100.0, 1700.0), (0.0, 0.0, 1.0, 1.0), (0.0, 0.0, 0.3, 0.3))
    one, two = (
        torque_drag([PIPE, COLLAR], hole, friction, mud_density=MUD, axial_speed=-1.0) for friction in (MU, [(800.0, MU), (1700.0, MU)])
    )
    assert two.tension[0] == pytest.approx(one.tension[0], rel=1e-9)


def test_a_chain_from_tables_has_the_friction_of_its_depths():
    # the load of the inertias times the kinetic coefficient is the torque of friction along the string
    survey = Survey((0.0, 1700.0), (INCLINATION,) * 2, (0.4,) * 2)
    made = {
        "sections": [PIPE, COLLAR],
        "survey": survey,
        "top_inertia": 2000.0,
        "elements": 6,
        "mud_density": MUD,
        "friction": Coulomb(0.3, 0.25),
    }
    plain, cased = (DrillString.from_tables(**made, friction_factors=factors) for factors in (None, [("900 m", 0.15), ("1700 m", 0.4)]))
    w_pipe, w_collar = PIPE.weight(MUD) * PIPE.outer / 2, COLLAR.weight(MUD) * COLLAR.outer / 2
    assert sum(cased.friction_load) * 0.25 == pytest.approx(
        math.sin(INCLINATION) * (0.15 * w_pipe * 900.0 + 0.4 * (w_pipe * 600.0 + w_collar * 200.0)), rel=1e-9
    )
    assert sum(plain.friction_load) == pytest.approx(math.sin(INCLINATION) * (w_pipe * 1500.0 + w_collar * 200.0), rel=1e-9)
    assert cased.friction_at == plain.friction_at and cased.friction == plain.friction


@pytest.mark.parametrize(
    ("friction", "words"),
    [
        ([("900 m", 0.2)], "must reach the end of the string at 1700 m, but its last depth is 900 m"),
        ([("900 m", 0.2), ("800 m", 0.2)], "`friction.1.depth` must be > 900 m, but it is 800.0"),
        ([("900 m", -0.2), ("1800 m", 0.2)], "`friction.0.factor` must be >= 0, but it is -0.2"),
        ([("900 m",)], "must be a number, or pairs"),
        ([], "must be a number, or pairs"),
        ("0.2 m", "friction"),
        ([("900 kg", 0.2), ("1800 m", 0.2)], "friction.0.depth"),
        ([(math.nan, 0.2), ("1800 m", 0.2)], "friction.0.depth"),
    ],
)
def test_friction_factors_that_are_none_are_told(friction, words):
    with pytest.raises(SceneError, match=re.escape(words)):
        torque_drag([PIPE, COLLAR], STRAIGHT, friction, axial_speed=1.0)


def test_a_law_without_a_kinetic_coefficient_takes_no_factors():
    with pytest.raises(SceneError, match="`friction_factors` must come with a `friction` that has a kinetic coefficient"):
        DrillString.from_tables([PIPE], STRAIGHT, top_inertia=2000.0, friction_factors=[("1700 m", 0.2)])
    with pytest.raises(SceneError, match="must not both be given"):
        torque_drag([PIPE], STRAIGHT, 0.2, axial_speed=-1.0, weight_on_bit="1 kN", overpull="1 kN")


def test_the_operations_of_a_rig_are_those_of_single_calls():
    factors = [("900 m", 0.15), ("1700 m", 0.4)]
    found = torque_drag_operations(
        [PIPE, COLLAR],
        STRAIGHT,
        factors,
        mud_density=MUD,
        weight_on_bit="50 kN",
        bit_torque="3 kN m",
        overpull="100 kN",
        display_units={"N": "klbf"},
    )
    assert found["rotating on bottom"].torque[0] - found["rotating off bottom"].torque[0] == pytest.approx(3e3)
    assert found["rotating off bottom"].tension[0] - found["rotating on bottom"].tension[0] == pytest.approx(50e3)
    assert found["picking up"].drag == pytest.approx(-found["slacking off"].drag, rel=1e-12)
    assert found["pulling on a stuck bit"].tension[-1] == 100e3 and found["sliding with weight on bit"].tension[-1] == -50e3
    told = str(found)
    assert "hook load [klbf]" in told and "0.15 from 0 to 900 m, 0.4 from 900 to 1700 m" in told and "in compression below" in told
    assert len(found.plot()) == 2
    with pytest.raises(SceneError, match="There is no operation `pickup`"):
        found["pickup"]


def test_the_command_reads_the_tables_of_a_scene(root, tmp_path, capsys):
    scene = root / "studies" / "scenes" / "aarsnes_shor.toml"
    assert main(["torquedrag", str(scene), "--out", str(tmp_path / "out"), "--overpull", "100 kN"]) == 0
    told = capsys.readouterr().out
    assert "rotating off bottom" in told and "pulling on a stuck bit" in told
    assert {each.name for each in (tmp_path / "out").iterdir()} >= {"torquedrag.txt", "torquedrag.png", "torquedrag.csv", "torquedrag.npz"}
    assert main(["torquedrag", str(scene), "--friction", "20 km=0"]) == 0
    rows = {line.split("  ")[1].strip(): line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("  ")}
    assert float(rows["picking up"][3]) == float(rows["slacking off"][3]) == 0.0
    assert main(["torquedrag", str(root / "studies" / "scenes" / "jansen_2.toml")]) == 2
    assert "none of its parts is made from a table of sections" in capsys.readouterr().err
