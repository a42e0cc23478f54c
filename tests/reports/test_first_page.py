"""The first page of a report: who succeeds, in which situation, at what price, how sure, and what to try next, from the values of verdicts."""

import csv
import dataclasses
import math
import re
from pathlib import Path

import pytest

from tests.reports.test_report import Page
from toolbox import Scene
from toolbox.commands.command_line import main
from toolbox.drilling.answer_results import STARTS, Answers, ControllerAnswer, Counted
from toolbox.files.unit_systems import use_units
from toolbox.measuring.verdict import DOES_NOT_STAND, FREE, NO_MODES, RUN_FAILED, STICK_SLIP
from toolbox.reports import report
from toolbox.reports.first_page import first_page, of_answers, of_study
from toolbox.scenes.verdict_table import JUDGED, Row, read_table, write_table

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


def stop(label, verdict, releases, distance, jerk, settling=3.0, **kwargs):
    return Row(
        label,
        verdict,
        settling=settling,
        peak=3000.0,
        error=1e-8,
        more={"releases": releases, "distance": distance, "jerk": jerk},
        **kwargs,
    )


@pytest.fixture(scope="module")
def brake():
    return dataclasses.replace(Scene.load(SCENES / "brake_laws.toml"), parameters={}, units={"rad/s": "rpm", "N": "kN"})


def test_five_sentences_say_who_stops_without_groan_where_at_what_price_how_surely_and_what_next(brake):
    rows = [stop("held", STICK_SLIP, 7, 14.5, 37.0), stop("eased", FREE, 0, 15.0, 16.0), stop("planned", FREE, 0, 14.2, 15.4)]
    sentences, table = first_page([of_study(brake, rows)])
    assert sentences[0] == "`eased` and `planned` stop without groan; `held` does not (stick-slip)."
    assert "the nominal plant, started from `disc.speed` = 57.2958 rpm, judged until standstill (0.9549 rpm)" in sentences[1]
    assert sentences[2] == (
        "Price: distance 14.2 rad (`planned`) to 15 rad (`eased`), others 14.5 rad; jerk 15.4 rad/s3 (`planned`) to 16 rad/s3 (`eased`), others 37 rad/s3."
    )
    assert (
        sentences[3]
        == "How sure: one run of each controller with the numbers of the scene, with a numerical error of at most 1e-08; no number was varied."
    )
    assert "friction 20 % lower and higher" in sentences[4] and len(sentences) == 5
    (grid,) = Page(table).tables
    assert grid[0] == ["controller", "verdict", "releases", "distance [rad]", "jerk [rad/s3]", "peak of brake.force [kN]"]
    assert grid[1] == ["held", "stick-slip", "7", "14.5", "37", "3"]


def test_a_stop_that_does_not_end_is_no_success_has_no_releases_and_needs_a_longer_run(brake):
    rows = [stop("weak", DOES_NOT_STAND, 0, math.inf, 0.1, settling=math.inf), Row("broken", RUN_FAILED, failure="why", settling=3.0)]
    sentences, table = first_page([of_study(brake, rows)])
    assert sentences[0] == "No controller stops without groan (`weak`: does not stand; `broken`: failed)."
    assert sentences[-1] == f"To try next: a longer `duration`, because `weak` did not stand within {brake.duration:g} s."
    assert Page(table).tables[0][1][:5] == ["weak", "does not stand", "-", "never", "-"]


def test_a_verdict_that_decides_nothing_counts_as_no_run(brake):
    sentences, _ = first_page([of_study(brake, [stop("open", NO_MODES, 0, 1.0, 1.0)])])
    assert sentences[0] == "No controller stops without groan (`open`: not judged)."


def test_several_studies_are_cases_of_one_table_with_the_highest_prices(brake):
    def study(word, verdict, distance):
        scene = dataclasses.replace(brake, title=f"Friction {word}: stop at 2.5 m/s2")
        return of_study(scene, [stop("held", STICK_SLIP, 7, distance, 30.0), stop("eased", verdict, 1, distance + 1.0, 16.0)])

    sentences, table = first_page([study("low", FREE, 18.0), study("high", STICK_SLIP, 12.0)])
    assert (
        sentences[0]
        == "No controller stops without groan in every case (`held`: in no case; `eased`: not in 1 of 2 cases (Friction high: stick-slip))."
    )
    (grid,) = Page(table).tables
    assert grid[0][:5] == ["controller", "Friction low", "Friction high", "highest releases", "highest distance [rad]"]
    assert grid[2][:5] == ["eased", "free", "stick-slip", "1", "19"]
    sentences, _ = first_page([study("low", FREE, 18.0), study("high", FREE, 12.0)])
    assert sentences[0] == "`eased` stops without groan in every case; `held` in no case."
    assert "2 cases" in sentences[1] and "in each of the 2 cases" in sentences[3] and "`car_jerk`" in sentences[4]


def answered(lowest):
    held = Counted(4, 4)
    soft = ControllerAnswer(
        dict.fromkeys(STARTS, held), Counted(8, 8), math.nan, lowest, top_peak=12.0, bit_peak=20.0, torque_peak=9e3, torque_limit=2e4
    )
    stiff = ControllerAnswer(dict.fromkeys(STARTS, held) | {"step": Counted(0, 1, "sticks")}, Counted(7, 8), 5.7, {}, 9.0, 30.0, 2e4)
    return Answers(
        "Rig", "StiffPI", "top.reference", "rad/s", 10.0, (6.0, 14.0), 1.0, {"soft": soft, "stiff": stiff}, {}, "Holds for: all."
    )


def test_answers_are_told_by_start_with_their_lowest_set_point_and_the_runs_that_they_rest_on():
    with use_units("metric"):
        sentences, table = first_page([of_answers(answered(dict.fromkeys(STARTS, 8.0) | {"connection": 9.0}))])
    assert (
        sentences[0]
        == "`soft` ends stick-slip in every case; `stiff` not in 2 of 5 cases (from rest, step: 1 of 1 runs fail; one number off: 1 of 8 runs fail)."
    )
    assert "Rig at a set-point of 95.49 rpm" in sentences[1]
    assert sentences[2] == "Price: lowest set-point for all starts 85.94 rpm; torque peak 9 kN m."
    assert (
        sentences[3] == "How sure: 21 to 24 runs of each controller, 8 of them with one number of the plant off."
        and "chance" in sentences[4]
    )
    (grid,) = Page(table).tables
    assert len(grid[0]) == 12 and grid[1][1:6] == ["4 of 4"] * 4 + ["8 of 8"] and grid[2][7] == "5.7"
    without = first_page([of_answers(answered(dict.fromkeys(STARTS, 8.0) | {"connection": math.nan}))])[0]
    assert "lowest set-point" not in without[2]


def test_the_first_page_comes_first_and_rests_on_the_table_not_on_what_was_printed(tmp_path):
    assert main(["study", str(SCENES / "brake_stop.toml"), "--out", str(tmp_path / "results")]) == 0
    text = report(tmp_path / "results", path=tmp_path / "page.html").read_text()
    first = re.search(r"<main>\s*<section class=\"first\">(.*?)</section>", text, re.DOTALL)[1]
    assert first.count("<li>") == 5
    rows = read_table(tmp_path / "results" / "table.csv")
    assert [str(row.verdict) for row in rows] == [cells[1] for cells in Page(first).tables[0][1:]]
    (tmp_path / "results" / "study.txt").write_text("nothing\n")
    assert first in report(tmp_path / "results", path=tmp_path / "page.html").read_text()
    write_table([dataclasses.replace(row, verdict=STICK_SLIP) for row in rows], tmp_path / "results" / "table.csv")
    assert "No controller stops without groan" in report(tmp_path / "results", path=tmp_path / "page.html").read_text()
    with (tmp_path / "results" / "table.csv").open(newline="") as file:
        cells = [{name: text for name, text in row.items() if name not in JUDGED} for row in csv.DictReader(file)]
    with (tmp_path / "results" / "table.csv").open("w", newline="") as file:  # of an earlier version, with the words alone
        writer = csv.DictWriter(file, list(cells[0]))
        writer.writeheader()
        writer.writerows(cells)
    earlier = report(tmp_path / "results", path=tmp_path / "page.html").read_text()
    assert 'class="first"' not in earlier and "stick-slip" in earlier
