"""Friction factors from measured hook load and torque, against closed forms of a straight hole and a soft-string sum written here; effects of numbers."""

from __future__ import annotations

import json
import math

import matplotlib
import numpy as np
import pytest

from models import Section, Survey, calibrate_friction, torque_drag_effects
from models.drag_effects import STEEL
from tests.refusals import each_of, refusals
from toolbox import SceneError
from toolbox.commands.command_line import main

PIPE, COLLAR = Section(1500.0, 0.127, 0.1086), Section(200.0, 0.165, 0.0714)
INCLINATION, MUD, HOOK = 0.9, 1200.0, 120e3
STRAIGHT = Survey((0.0, 2000.0), (INCLINATION,) * 2, (0.4,) * 2)
SHOE, UPPER, LOWER = 900.0, 0.15, 0.4


def straight(depths, hook=HOOK, upper=UPPER, lower=LOWER):
    """Measurements in a straight hole: the drag is the sum of mu w sin(inc) over the lengths, the torque that of mu w sin(inc) R."""
    rows = []
    for bit in depths:
        along = across = turned = 0.0
        for section, top, end in ((PIPE, 0.0, bit - 200.0), (COLLAR, bit - 200.0, bit)):
            cased = np.clip(SHOE, top, end) - top
            rubbing = section.weight(MUD) * math.sin(INCLINATION) * (upper * cased + lower * (end - top - cased))
            along += section.weight(MUD) * math.cos(INCLINATION) * (end - top)
            across, turned = across + rubbing, turned + rubbing * section.outer / 2
        rows.append((bit, hook + along + across, hook + along - across, hook + along, turned))
    return dict(
        zip(
            ("depth", "picking up", "slacking off", "rotating off bottom", "torque off bottom"),
            map(list, zip(*rows, strict=True)),
            strict=True,
        )
    )


def calibrated(measured, depths=(SHOE, 2000.0), **kind):
    return calibrate_friction([PIPE, COLLAR], STRAIGHT, measured, depths, mud_density=MUD, **kind)


def test_the_factors_of_a_straight_hole_and_the_weight_of_the_hook_are_found():
    # the bit is higher than the end of the string, at it, and deeper, by more of the first section
    found = calibrated(straight([500.0, 800.0, 1100.0, 1400.0, 1700.0, 1900.0]))
    assert found.factors == pytest.approx((UPPER, LOWER), abs=1e-6) and found.hook_weight == pytest.approx(HOOK, rel=1e-6)
    assert max(found.half_widths) < 1e-6 and found.hook_weight_half_width < 1.0
    assert found.friction == [(SHOE, found.factors[0]), (2000.0, found.factors[1])]
    assert all(computed == pytest.approx(measured, rel=1e-6) for _, _, measured, computed in found.rows) and len(found.rows) == 24


def test_the_torque_alone_determines_the_factors():
    whole = straight([500.0, 1100.0, 1700.0])
    found = calibrated({name: whole[name] for name in ("depth", "torque off bottom")})
    assert found.factors == pytest.approx((UPPER, LOWER), abs=1e-6) and (found.hook_weight, found.hook_weight_half_width) == (0.0, 0.0)


def summed(bit, upper, lower, way, turning):
    """(hook load, torque) of pipe of one size in a plane hole that builds, by elements of half a metre from the bit upwards (Johancsik 1984)."""
    weight, size, load, torque = PIPE.weight(MUD), 0.5, 0.0, 0.0
    for k in range(round(bit / size), 0, -1):
        middle = (k - 0.5) * size
        inclination = np.interp(middle, [400.0, 1000.0], [0.0, 1.0])
        curvature = 1.0 / 600.0 if 400.0 < middle < 1000.0 else 0.0
        middle_load = load + 0.5 * size * weight * math.cos(inclination)
        friction = (upper if middle < SHOE else lower) * abs(middle_load * curvature - weight * math.sin(inclination))
        load += size * (weight * math.cos(inclination) + (0.0 if turning else way * friction))
        torque += size * friction * PIPE.outer / 2 if turning else 0.0
    return load, torque


def test_the_factors_of_a_hole_that_builds_are_those_of_an_independent_soft_string_sum():
    measured = {"depth": [800.0, 1100.0, 1500.0]}
    for name, way in (("picking up", 1.0), ("slacking off", -1.0)):
        measured[name] = [HOOK + summed(bit, 0.2, 0.35, way, False)[0] for bit in measured["depth"]]
    measured["torque off bottom"] = [summed(bit, 0.2, 0.35, 0.0, True)[1] for bit in measured["depth"]]
    hole = Survey((0.0, 400.0, 1000.0, 1500.0), (0.0, 0.0, 1.0, 1.0), (0.3,) * 4)
    found = calibrate_friction([PIPE], hole, measured, [SHOE, 1500.0], mud_density=MUD)
    assert found.factors == pytest.approx((0.2, 0.35), abs=1e-3)  # first order of the load within an element: 0.5 m of 600 m
    assert found.hook_weight == pytest.approx(HOOK, rel=1e-3)


def test_ninety_five_of_a_hundred_intervals_hold_the_factor():
    depths, rng = [700.0, 1200.0, 1700.0], np.random.default_rng(63)
    exact = straight(depths)
    noise = {name: 0.01 * max(exact["picking up"]) for name in exact} | {"torque off bottom": 0.05 * max(exact["torque off bottom"])}
    truth, found, widths = (UPPER, LOWER, HOOK), [], []
    for _ in range(100):
        noisy = {name: list(np.abs(values + rng.normal(size=3) * noise[name])) for name, values in exact.items() if name != "depth"}
        one = calibrated({"depth": depths, **noisy})
        found.append((*one.factors, one.hook_weight))
        widths.append((*one.half_widths, one.hook_weight_half_width))
    held = np.abs(np.array(found) - truth) <= np.array(widths)
    assert (held.sum(axis=0) >= 88).all(), held.sum(axis=0)  # a binomial of .95 is lower once in 500
    assert np.mean(widths, axis=0) == pytest.approx(
        2.26 * np.std(found, axis=0), rel=0.3
    )  # Student's t of 9 degrees of freedom: not too wide


def test_factors_that_one_depth_cannot_tell_apart_are_told():
    whole = straight([1500.0])  # its torque would tell them apart by the radius of the collars
    found = calibrated({name: whole[name] for name in ("depth", "picking up", "slacking off")}, hook_weight=HOOK)
    assert np.isnan(found.factors).all() and np.isnan(found.half_widths).all() and found.hook_weight == HOOK
    words = "do not tell `friction factor, 0 to 900 m` and `friction factor, 900 to 2000 m` apart: measure with the bit at other depths"
    assert words in str(found) and "not determined" in str(found) and "not determined" in found._repr_html_()
    with pytest.raises(
        SceneError, match="must determine every friction factor, but not `friction factor, 0 to 900 m`, `friction factor, 900"
    ):
        _ = found.friction


def test_a_factor_below_every_bit_is_told():
    found = calibrated(straight([500.0, 700.0, 850.0]))
    assert found.factors[0] == pytest.approx(UPPER, abs=1e-6) and math.isnan(found.factors[1])
    assert "No measurement changes with `friction factor, 900 to 2000 m`: measure with the bit below 900 m" in str(found)


def test_a_weight_of_the_hook_that_is_lost_in_the_friction_is_told():
    whole = straight([500.0])
    found = calibrated({name: whole[name] * 2 for name in ("depth", "picking up")}, [2000.0])
    assert math.isnan(found.factors[0]) and math.isnan(found.hook_weight)
    assert "Weight of hook and block: not determined." in str(found) and "and `weight of hook and block` apart" in str(found)


def test_factors_that_are_hardly_told_apart_have_a_note_with_their_correlation():
    whole = straight([1640.0, 1700.0])
    found = calibrated({name: whole[name] for name in ("depth", "picking up", "slacking off")}, hook_weight=HOOK)
    assert found.factors == pytest.approx((UPPER, LOWER), abs=1e-5)
    assert found.correlation[0, 1] < -0.95 and "(correlation -1.00): their intervals are wide" in str(found)


def test_as_many_unknown_numbers_as_measurements_leave_no_interval():
    whole = straight([700.0, 1500.0])
    found = calibrated({name: whole[name] for name in ("depth", "picking up")}, hook_weight="120 kN")
    assert found.factors == pytest.approx((UPPER, LOWER), abs=1e-6) and np.isnan(found.half_widths).all()
    assert "There are as many unknown numbers as measurements: the intervals are not known." in str(found)


def test_a_table_with_empty_cells_and_its_own_units_is_the_same(tmp_path):
    whole = straight([500.0, 1100.0, 1700.0])
    (tmp_path / "road.csv").write_text(
        "MD [ft];PU [klbf];torque [kN m]\n"
        + "".join(
            f"{bit / 0.3048:.17g};{'' if k == 1 else f'{up / 4448.2216152605:.17g}'};{turned / 1e3:.17g}\n"
            for k, (bit, up, turned) in enumerate(zip(whole["depth"], whole["picking up"], whole["torque off bottom"], strict=True))
        )
    )
    whole["picking up"][1] = None
    given = {name: whole[name] for name in ("depth", "picking up", "torque off bottom")}
    one, two = calibrated(given), calibrated(tmp_path / "road.csv", display_units={"N": "klbf", "m": "ft"})
    assert two.factors == pytest.approx(one.factors, rel=1e-9) and two.hook_weight == pytest.approx(one.hook_weight, rel=1e-9)
    assert "klbf" in str(two) and f"{1700 / 0.3048:.5g}" in str(two) and len(two.rows) == 5


def test_the_figure_has_measured_points_computed_curves_and_the_factors(tmp_path):
    matplotlib.use("Agg")
    found = calibrated(straight([500.0, 1100.0, 1700.0]))
    left, right = found.plot()
    texts = [text.get_text() for text in left.figure.legends[0].get_texts()]
    assert texts[:2] == ["picking up, computed", "picking up, measured"] and texts[-1] == "torque off bottom, measured"
    assert left.yaxis_inverted() and left.get_xlabel() == "hook load [kN]" and right.get_xlabel() == "torque at the top [kN m]"
    assert [text.get_text() for text in right.texts] == ["friction factor\n0.15 ± 0.00", "friction factor\n0.40 ± 0.00"]
    (x, y) = left.get_lines()[1].get_data()
    assert list(y) == [500.0, 1100.0, 1700.0] and list(x) == pytest.approx(straight([500.0, 1100.0, 1700.0])["picking up"], rel=1e-12)
    rows = found.to_csv(tmp_path / "found.csv").read_text().splitlines()
    assert rows[0] == "bit depth [m],measurement,measured,computed,unit" and len(rows) == 13 and rows[4].endswith(",N m")


def table(tmp_path, text):
    (tmp_path / "road.csv").write_text(text)
    return calibrated(tmp_path / "road.csv")


test_measurements_that_are_none_are_refused = refusals(
    (lambda tmp_path: table(tmp_path, "depth [m],pull [kN]\n500,300\n"), "unknown column `pull \\[kN\\]`"),
    (lambda tmp_path: table(tmp_path, "depth [m],picking up\n500,300\n"), "column `picking up` must name its unit"),
    (lambda tmp_path: table(tmp_path, "depth [m],picking up [m]\n500,300\n"), "picking up"),
    (lambda tmp_path: table(tmp_path, "picking up [kN]\n300\n"), "must have a column `depth \\[m\\]`"),
    (lambda tmp_path: table(tmp_path, "depth [m],picking up [kN]\n500,300\n-900,400\n"), "row 2 \\(line 3\\), column `depth \\[m\\]`: it must be > 0 m"),
    (lambda tmp_path: table(tmp_path, "depth [m],picking up [kN]\n500,300\n900,-400\n"), "row 2 \\(line 3\\), column `picking up \\[kN\\]`: it must be >= 0"),
    (lambda tmp_path: table(tmp_path, "depth [m],picking up [kN]\n500,nan\n"), "must be a finite number, but it is `nan`"),
    (lambda tmp_path: table(tmp_path, "depth [m],picking up [kN]\n,300\n"), "must not be empty"),
    (lambda tmp_path: table(tmp_path, "depth [m],picking up [kN]\n500,\n"), "at least one value of `picking up`"),
    (lambda tmp_path: table(tmp_path, "depth [m],picking up [kN]\n500,300\n1500,500\n"), "as there are unknown numbers, 3, but it holds 2"),
    (lambda: calibrated({"depth": [500.0], "pull": [3e5]}), "must have `depth` and other columns of"),
    (lambda: calibrated({"picking up": [3e5]}), "must have `depth` and other columns of"),
    (lambda: calibrated({"depth": [500.0, 600.0], "picking up": [3e5]}), "lists of one length"),
    (lambda: calibrated({"depth": 500.0, "picking up": 3e5}), "lists of one length"),
    (lambda: calibrated({"depth": [-5.0], "picking up": [3e5]}), "`measurements.depth.0` must be > 0"),
    (lambda: calibrated({"depth": [None], "picking up": [3e5]}), "measurements.depth.0"),
    (lambda: calibrated({"depth": [500.0], "picking up": [math.nan]}), "measurements.picking up.0"),
    (lambda: calibrated({"depth": [500.0], "picking up": ["3 kN m"]}), "measurements.picking up.0"),
    (lambda: calibrated(straight([500.0, 1500.0]), [SHOE]), "`depths` must reach the end of the string at 1500 m"),
    (lambda: calibrated(straight([500.0, 2100.0]), [SHOE, 2100.0]), "must reach the end of the string at 2100 m"),
    (lambda: calibrated(straight([500.0, 1500.0]), hook_weight="-1 kN"), "hook_weight"),
    *each_of(lambda change: torque_drag_effects([PIPE], STRAIGHT, 0.2, change=change), "change", [0.0, 1.0, -0.1, math.nan]),
)  # fmt: skip


def test_the_effects_of_a_straight_hole_are_their_closed_forms(tmp_path):
    matplotlib.use("Agg")
    found = torque_drag_effects([PIPE], STRAIGHT, 0.25, change=0.2, mud_density=MUD, bit_torque="3 kN m", display_units={"N": "klbf"})
    weight = PIPE.weight(MUD) * PIPE.length
    effects = {name: (low, high) for name, low, high in zip(found.numbers, found.low, found.high, strict=True)}
    drag, along = 0.25 * weight * math.sin(INCLINATION), weight * math.cos(INCLINATION)
    assert list(found.quantities.values()) == pytest.approx([along + drag, along - drag, 3e3 + drag * PIPE.outer / 2], rel=1e-12)
    assert effects["friction factor"][1] == pytest.approx(0.2 * drag * np.array([1.0, -1.0, PIPE.outer / 2]), rel=1e-9)
    assert effects["friction factor"][0] == pytest.approx(-effects["friction factor"][1], rel=1e-9)
    assert effects["torque on bit"][1] == pytest.approx([0.0, 0.0, 600.0], rel=1e-9, abs=1e-6)
    whole = np.array([along + drag, along - drag, drag * PIPE.outer / 2])
    heavier = 0.2 * PIPE.density / (PIPE.density - MUD)  # of the weight in mud
    assert effects[STEEL][1] == pytest.approx(heavier * whole, rel=1e-9)
    assert effects["mud density"][1] == pytest.approx(-0.2 * MUD / (PIPE.density - MUD) * whole, rel=1e-9)
    assert found.numbers == ("friction factor", "mud density", "torque on bit", STEEL)  # no weight on bit was given
    told = str(found)
    assert (
        "20 % lower" in told
        and "picking up [klbf]" in told
        and told.index(STEEL) < told.index("mud density")
        and "<table" in found._repr_html_()
    )
    axes = found.plot()
    assert [text.get_text() for text in axes[0].get_yticklabels()][-1] == STEEL and axes[0].get_title() == "picking up"
    assert len(axes[0].patches) == 6 and len(axes[2].patches) == 8  # the torque on bit has no bar for a hook load
    assert len(found.to_csv(tmp_path / "effects.csv").read_text().splitlines()) == 13


def test_a_string_without_friction_has_its_weight_alone():
    matplotlib.use("Agg")
    found = torque_drag_effects([PIPE], STRAIGHT, 0.0)
    assert found.numbers == (STEEL,) and not found.low[:, 2].any() and len(found.plot()[2].patches) == 0


def test_the_command_finds_friction_factors_and_draws_the_effects(root, tmp_path, capsys):
    scene, out = root / "studies" / "scenes" / "aarsnes_shor.toml", tmp_path / "out"
    assert main(["torquedrag", str(scene), "--quiet", "--friction", "20 km=0.21", "--out", str(out)]) == 0
    (tmp_path / "road.csv").write_text(
        "depth [m],picking up [kN],torque off bottom [kN m]\n1700,700,4\n2000,830,8\n2300,950,12\n2450,1000,15\n"
    )
    line = [
        "torquedrag",
        str(scene),
        "--measured",
        str(tmp_path / "road.csv"),
        "--hook-weight",
        "100 kN",
        "--change",
        "10%",
        "--out",
        str(out),
    ]
    assert main([*line, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert set(data) == {"torquedrag", "friction_factors", "effects"} and data["friction_factors"]["hook_weight"] == 100e3
    stems = {each.stem for each in out.iterdir()}
    assert (
        stems == {"torquedrag", "friction_factors", "effects", "origin", "scene"}
        and str(tmp_path / "road.csv") in (out / "origin.json").read_text()
    )
    assert main(["report", str(out), "--page", str(tmp_path / "page.html")]) == 0
    answer = (tmp_path / "page.html").read_text().partition("Appendix</h2>")[0]
    assert answer.count("data:image/png") == 3 and "95 % interval" in answer and "Effect of each number" in answer
    assert main(["torquedrag", str(scene), "--quiet", "--friction", "20 km=0.21", "--out", str(out)]) == 0
    assert {each.stem for each in out.iterdir()} == {"torquedrag", "origin", "scene"}  # those of the earlier call are replaced


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (["--hook-weight", "100 kN"], "`--hook-weight` must come with `--measured`"),
        (["--friction-depth", "2 km"], "`--friction-depth` must come with `--measured`"),
        (["--measured", "road.csv", "--friction", "20 km=0.2"], "must not both be given"),
        (["--measured", "road.csv"], "road.csv"),
        (["--change", "120%"], "`--change` must be > 0 and < 1"),
    ],
)
def test_options_that_do_not_fit_are_told(line, words, root, capsys):
    assert main(["torquedrag", str(root / "studies" / "scenes" / "aarsnes_shor.toml"), *line]) == 2
    told = capsys.readouterr().err
    assert words in told and told.count("\n") == 1
