"""Results as tables in a notebook: every number of the report is there, and no text is read as HTML."""

from __future__ import annotations

import xml.etree.ElementTree as xml

import numpy as np
import pytest

from controllers import PI
from models import BlockOnBelt, oscillators, wells
from tests.plants import BELT, RIG
from toolbox import Trajectory, compose, fit, limit_cycle, onset, severity_map, simulate, tune
from toolbox.files.printing import table


def cells(text):
    """Rows of all tables in order, cells as text; fails for HTML that is not well formed."""
    page = xml.fromstring(f"<page>{text}</page>")
    return [["".join(cell.itertext()) for cell in row] for row in page.iter("tr")]


def test_text_is_escaped_and_numbers_stand_at_the_right():
    text = table("a < b & c", ("<b>", "value"), [("<script>", 1.23456789), ("slip+", "-"), ("infinite", float("inf"))], ["1 > 0"])
    assert cells(text) == [["<b>", "value"], ["<script>", "1.23457"], ["slip+", "-"], ["infinite", "inf"]]
    assert "<script>" not in text and "a &lt; b &amp; c" in text and "1 &gt; 0" in text
    sides = [cell.get("style") for cell in xml.fromstring(text).iter("td")]
    assert sides == ["text-align:left", "text-align:right", "text-align:left", "text-align:left", "text-align:left", "text-align:right"]


def test_a_plant_shows_every_parameter_with_value_unit_and_meaning():
    rows = cells(RIG._repr_html_())
    assert rows[0] == ["parameter", "value", "unit", "meaning"]
    assert [row[0] for row in rows[1:]] == list(RIG.parameters)
    assert ["bit.weight", f"{RIG.parameter('bit.weight'):.6g}", "N", RIG.parameters["bit.weight"].meaning] in rows
    heavier = RIG.with_parameters({"bit.weight": 123_456.0})
    assert "123456" in heavier._repr_html_() and "123456" not in RIG._repr_html_()


def test_a_run_and_the_same_run_from_its_file_show_stays_and_ranges(tmp_path):
    run = simulate(BELT, 20.0)
    for shown in (run, Trajectory.load(run.save(tmp_path / "run.npz"))):
        rows = cells(shown._repr_html_())
        stick = next(row for row in rows if row[:2] == ["belt", "stick"])
        assert float(stick[2]) == pytest.approx(run.time_in("belt", "stick"), rel=1e-5)
        assert float(stick[3]) == pytest.approx(100 * run.time_in("belt", "stick") / 20.0, abs=0.05)
        speed = next(row for row in rows if row[0] == "block.speed")
        assert [float(speed[k]) for k in (1, 2, 3)] == pytest.approx(
            [run["block.speed"].min(), run["block.speed"].max(), run["block.speed"][-1]], rel=1e-5
        )
        assert speed[4] == "m/s"
        assert "block.speed" in str(shown) and len(str(shown).splitlines()) < 20


def test_a_run_of_a_plant_without_contacts_shows_its_signals():
    rows = cells(simulate(compose(wells.JANSEN_2), 1.0)._repr_html_())
    assert any(row[0] == "top.speed" for row in rows)


def test_a_cycle_shows_its_states():
    cycle = limit_cycle(BELT, 60.0)
    rows = cells(cycle._repr_html_())
    low, high = cycle.extremes("block.speed")
    assert ["block.speed", f"{low:.6g}", f".. {high:.6g}", "m/s"] in rows
    assert repr(cycle) == str(cycle) and "Floquet multipliers" in cycle._repr_html_()


def test_a_fit_shows_estimate_and_interval():
    run = simulate(BELT, 12.0, output_times=np.linspace(0, 12, 100))
    found = fit(compose(BlockOnBelt(mass=1.1)), run, "block.mass", {"block.mass": (0.8, 1.6)}, starts=1)
    row = cells(found._repr_html_())[1]
    low, high = found.interval("block.mass")
    assert row[:4] == ["block.mass", f"{found['block.mass']:.6g}", f"{low:.6g} .. {high:.6g}", "kg"]
    assert repr(found) == str(found)


@pytest.mark.slow
def test_a_map_and_an_onset_show_verdicts_and_borders():
    over = {"top.torque": (8e3, 20e3), "bit.weight": (60e3, 90e3)}
    found = severity_map(RIG, over, shape=(3, 3))
    rows = cells(found._repr_html_())
    shares = {row[0]: float(row[1].removesuffix(" %")) for row in rows[1:] if row[0] in found.regions}
    assert sum(shares.values()) == pytest.approx(100.0, abs=0.2)
    assert all(shares[name] == pytest.approx(100 * where.mean(), abs=0.05) for name, where in found.regions.items() if name in shares)
    assert ["border", "top.torque", "bit.weight"] in rows


@pytest.mark.slow
def test_an_onset_shows_its_borders_and_the_verdict_at_each_value():
    found = onset(compose(oscillators.THOMSEN_FIDLIN), "block.belt_speed", (0.3, 0.5), num_values=4, tolerance=1e-2)
    rows = cells(found._repr_html_())
    assert rows[0][:2] == ["border", "block.belt_speed"]
    assert f"{found.loss:.6g} m/s" in [row[1] for row in rows if row[0] == "smooth running is lost"]
    verdicts = rows[[row[:2] for row in rows].index(["block.belt_speed [m/s]", "from smooth running"]) + 1 :]
    assert [row[1] for row in verdicts] == [judged.regime for judged in found.smooth]
    assert repr(found) == str(found) and found.advice in found._repr_html_()


def test_a_tuning_shows_the_given_and_the_tuned_numbers():
    found = tune(RIG, PI(reference=9.0), "severity", {"pi.proportional": (1000.0, 9000.0)}, duration=5.0, runs=10)
    rows = cells(found._repr_html_())
    assert rows[0] == ["", "given", "tuned", "range"]
    name, given, tuned, span = rows[1]
    assert (name, given, span) == ("pi.proportional [N m s/rad]", "4000", "1000 .. 9000")
    assert float(tuned) == pytest.approx(found.best.numbers[0], rel=1e-5)
    assert repr(found) == str(found)
