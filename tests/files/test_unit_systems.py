"""Answers in the units of the reader: every report and figure says the same physics in rpm and klbf as in SI, and what Python and files get stays SI."""

from __future__ import annotations

import re

import numpy as np
import pytest

from controllers import PI, StiffPI
from tests.plants import RIG
from toolbox import Scene, SceneError, closed_loop, equilibrium, hopf_points, measure, onset, plot, simulate, sweep, use_units
from toolbox.commands.command_line import main
from toolbox.files.unit_systems import SYSTEMS, reading
from toolbox.files.units import parse

RPM = np.pi / 30
SCENE = "studies/scenes/jansen_2.toml"


def numbers(text: str) -> list[float]:
    return [float(word) for word in re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]\d+)?", text)]


@pytest.mark.parametrize("system", SYSTEMS)
def test_every_unit_of_a_system_is_one_that_is_understood_where_quantities_are_typed(system):
    with use_units(system):
        for unit in SYSTEMS[system]:
            factor, other = reading(unit)
            assert parse(f"{12.5 * factor!r} {other}", unit) == pytest.approx(12.5, rel=1e-14)
        assert reading("1") == (1.0, "1") and reading("N m s^-0.5") == (1.0, "N m s^-0.5")


def test_factors_are_those_by_definition():
    with use_units("oilfield"):
        assert reading("N").factor == pytest.approx(1 / 4448.2216152605, rel=1e-15)
        assert reading("N m").factor == pytest.approx(1 / (4448.2216152605 * 0.3048), rel=1e-14)
        assert reading("rad/s").factor == pytest.approx(30 / np.pi, rel=1e-15)
        assert reading("Pa").factor == pytest.approx((0.3048 / 12) ** 2 / 4.4482216152605, rel=1e-12)


def test_a_system_holds_inside_of_its_block_or_from_there_on():
    with use_units("metric"):
        assert reading("N").unit == "kN"
        with use_units("oilfield"):
            assert reading("N").unit == "klbf"
        assert reading("N").unit == "kN"
    assert reading("N") == (1.0, "N")
    with use_units("si"):  # chosen as well: it wins over what was typed
        assert reading("N", {"N": "kN"}) == (1.0, "N")
    chosen = use_units("oilfield")
    assert reading("rad/s").unit == "rpm"
    chosen.__exit__()
    with pytest.raises(SceneError, match="no system of units `imperial`"):
        use_units("imperial")


def test_reports_say_the_same_in_other_units_and_numbers_stay_si():
    point = equilibrium(closed_loop(RIG, inputs={"top.torque": "20 kN m"}))
    before = str(point)
    with use_units("oilfield"):
        line = next(line for line in str(point).splitlines() if line.split()[0] == "top.speed")
        assert line.endswith(" rpm") and numbers(line)[-1] == pytest.approx(point["top.speed"] / RPM, rel=1e-5)
        assert "klbf ft" in str(point) and point["top.speed"] == equilibrium(closed_loop(RIG, inputs={"top.torque": 20_000.0}))["top.speed"]
    assert str(point) == before and "rpm" not in before
    run = simulate(RIG, 5.0, inputs={"top.torque": 10_000.0})
    with use_units("metric"):
        line = next(line for line in str(run).splitlines() if " top.speed " in line)
        assert line.endswith("rpm") and numbers(line)[-1] == pytest.approx(run["top.speed"][-1] / RPM, rel=1e-4)
    hopf = hopf_points(closed_loop(RIG, StiffPI()), "top.reference", (4.0, 14.0))[-1]
    with use_units("metric"):
        assert f"top.reference = {hopf.value / RPM:.6g} rpm" in str(hopf)
    found = sweep(closed_loop(RIG, PI()), {"bit.weight": [50e3, 60e3]}, 5.0)
    with use_units("oilfield"):
        line = next(line for line in str(found).splitlines() if "bit.weight" in line)
        assert numbers(line)[:2] == pytest.approx([50 / 4.4482216, 60 / 4.4482216], rel=1e-4) and "klbf" in line
    assert found.points.ravel().tolist() == [50e3, 60e3]


def test_an_onset_answers_in_rpm():
    found = onset(
        closed_loop(RIG, StiffPI()).at("top.reference", "120 rpm"),
        "top.reference",
        ("60 rpm", "140 rpm"),
        duration="40 s",
        tolerance="5 rpm",
        num_values=3,
    )
    text, picture = str(found), found.plot()  # it was asked in rpm, and nothing else was chosen
    with use_units("metric"):
        assert str(found) == text
    with use_units("si"):
        assert "rpm" not in str(found) and "The working point 12.5664 rad/s" in str(found)
    assert "top.reference from 60 to 140 rpm" in text and "The working point 120 rpm" in text
    assert f"{found.end / RPM:.6g} rpm" in text and "rad/s" not in text
    assert picture.get_xlabel() == "top reference [rpm]"
    picture.figure.canvas.draw()
    shown = [float(label.get_text()) for label in picture.get_xticklabels()]
    places = picture.get_xticks()
    assert np.allclose(np.array(places) / RPM, shown, rtol=1e-9) and all(number % 5 == 0 for number in shown)
    assert picture.get_xlim() == pytest.approx((60 * RPM, 140 * RPM))  # data stay SI


def test_figures_of_a_run_are_read_in_the_chosen_units():
    run = simulate(RIG, 10.0, inputs={"top.torque": 10_000.0})
    with use_units("oilfield"):
        speed, torque = run.plot("top.speed", "top.torque")
        phase = plot.phase_plane(run, "bit.torque", "bit.speed")
    assert phase.get_xlabel() == "bit torque [klbf ft]" and phase.get_ylabel() == "bit speed [rpm]"
    assert speed.get_ylabel() == "top speed [rpm]" and torque.get_ylabel() == "top torque [klbf ft]"
    assert np.nanmax(speed.lines[0].get_ydata()) == pytest.approx(measure.extent(run, "top.speed").maximum, rel=1e-3)
    plain = run.plot("top.speed")
    assert plain[0].get_ylabel() == "top speed [rad/s]"


def test_a_study_table_and_every_command_take_units(capsys):
    scene = Scene.load(SCENE)
    assert main(["simulate", SCENE, "--controller", scene.labels[0], "--duration", "5 s", "--units", "oilfield"]) == 0
    said = capsys.readouterr().out
    assert "rpm" in said and "klbf ft" in said and "rad/s" not in said
    with pytest.raises(SystemExit):
        main(["simulate", SCENE, "--units", "imperial"])
    assert "--units" in capsys.readouterr().err
    assert reading("N").unit == "N"  # the system of a command ends with it
