"""Dates and times of day as rigs write them: the same moments in every form, an order that is settled or asked back, never guessed."""

from __future__ import annotations

import datetime

import numpy as np
import pytest

from tests.plants import RIG
from tests.refusals import refusals
from toolbox import SceneError
from toolbox.calibration import Recording
from toolbox.logs.dates import seconds_of

BEGIN = datetime.datetime(2017, 8, 25, 23, 59, 50)
COLUMNS = {"time": "Time", "top.speed": "RPM", "top.torque": "TQ"}


def moments(step=1.0, count=20, begin=BEGIN):
    return [begin + datetime.timedelta(seconds=step * k) for k in range(count)]


def log(path, times, head="Time", mark=";"):
    """A log with these cells of time."""
    rows = [mark.join([each, f"{100 + k % 7}", f"{10 + 0.1 * (k % 5):.1f}"]) for k, each in enumerate(times)]
    path.write_text("\n".join([mark.join([head, "RPM [rpm]", "TQ [kN m]"]), *rows]) + "\n")
    return path


@pytest.mark.parametrize(
    "form",
    [
        "%d-%b-%Y %H:%M:%S", "%m/%d/%Y %I:%M:%S %p", "%d.%m.%Y %H:%M:%S", "%d/%m/%Y-%H:%M:%S", "%Y%m%d %H%M%S", "%d-%b-%y %H:%M:%S", "%b %d %Y %H:%M:%S",
        "%Y-%m-%dT%H:%M:%S-05:00", "%Y/%m/%d %H:%M:%S.000", "%d %b %Y %H:%M:%S", "%Y/%m/%d-%H:%M:%S", "%d%b%Y %H:%M:%S", "%a %b %d %H:%M:%S %Y",
        "%B %d, %Y %H:%M:%S", "%Y-%b-%d %H:%M:%S", "%A, %d. %B %Y %H:%M:%S", "%H:%M:%S %d/%m/%Y", "%d-%m-%Y_%H:%M:%S", "%Y.%m.%d %H:%M:%S", "%d/%b/%Y:%H:%M:%S",
        "%Y-%m-%d %H:%M:%S+0200", "%m-%d-%Y %H:%M:%S", "%d/%m/%Y %H:%M:%S Z", "%H:%M:%S",
    ],
)  # fmt: skip
def test_times_in_every_form_go_on_past_midnight_second_by_second(tmp_path, form):
    found = Recording.of(log(tmp_path / "log.csv", [each.strftime(form) for each in moments()]), RIG, COLUMNS)
    assert found.time.tolist() == [float(k) for k in range(20)]
    assert not found.found("time")


@pytest.mark.parametrize("form", ["%d-%b-%y", "%d/%m/%Y", "%Y/%m/%d", "%d.%m.%y"])
def test_dates_without_a_time_of_day_are_midnights(form):
    days = [datetime.datetime(2020, 1, 28) + datetime.timedelta(days=k) for k in range(10)]
    assert np.diff(seconds_of([each.strftime(form) for each in days], "The log")[0]).tolist() == [86_400.0] * 9


@pytest.mark.parametrize(
    ("name", "month"), [("Mai", 5), ("Okt", 10), ("Dez", 12), ("mars", 3), ("août", 8), ("juil.", 7), ("JUNE", 6), ("Sept", 9)]
)
def test_a_month_is_known_by_how_its_name_begins(name, month):
    found, _ = seconds_of([f"02-{name}-2020 00:00:00", f"03-{name}-2020 00:00:00"], "The log")
    assert found[0] == datetime.datetime(2020, month, 2, tzinfo=datetime.UTC).timestamp()


@pytest.mark.parametrize("mark", ["/", "-"])
def test_a_day_that_may_be_a_month_is_asked_back_and_a_declared_order_answers(tmp_path, mark):
    # two readings that both go on, by 31 and by 30 days: nothing in the column settles it
    cells = [f"{d:02d}{mark}04{mark}2024 10:00:0{k}" for k, d in enumerate((3, 5, 7))]
    with pytest.raises(
        SceneError, match=r"day and month can be told apart, but `03.04.2024 10:00:00` may be either.*\[DD/MM/YYYY\].*--column"
    ):
        Recording.of(log(tmp_path / "log.csv", cells), RIG, COLUMNS)
    for order, days in (("DD/MM/YYYY", 2), ("MM/DD/YYYY", 61)):  # 3 to 5 April are 2 days; 4 March to 4 May are 61
        found = Recording.of(tmp_path / "log.csv", RIG, {**COLUMNS, "time": f"Time [{order}]"})
        assert found.time[1] == days * 86_400.0 + 1.0
        beside = Recording.of(log(tmp_path / "head.csv", cells, f"Time ({order} HH:MM:SS)"), RIG, COLUMNS)
        assert beside.time[1] == found.time[1]


def test_two_numbers_of_a_year_that_may_stand_first_are_asked_back():
    # 25 to 28 August 2017, or 17 August of 2025 and 2028
    with pytest.raises(SceneError, match=r"`25/08/17 10:00:00` may be either"):
        seconds_of(["25/08/17 10:00:00", "28/08/17 10:00:00"], "The log")
    assert np.diff(seconds_of(["25/08/17 10:00:00", "28/08/17 10:00:00"], "The log", "DD/MM/YY")[0]).tolist() == [3 * 86_400.0]
    assert np.diff(seconds_of(["17/08/25 23:59:59", "17/08/26 00:00:01"], "The log")[0]).tolist() == [
        2.0
    ]  # the year first: no step of a year


def test_digits_are_a_time_of_day_only_if_they_are_declared_to_be(tmp_path):
    path = log(tmp_path / "log.csv", [each.strftime("%H%M%S") for each in moments()])
    with pytest.raises(SceneError, match=r"must name its unit.*\[HHMMSS\]"):
        Recording.of(path, RIG, COLUMNS)
    assert Recording.of(path, RIG, {**COLUMNS, "time": "Time [HHMMSS]"}).time.tolist() == [float(k) for k in range(20)]
    headed = log(tmp_path / "head.csv", [f"{int(each.strftime('%H%M%S'))}" for each in moments()], "Time (hhmmss)")  # 5 for 00:00:05
    assert Recording.of(headed, RIG, COLUMNS).time.tolist() == [float(k) for k in range(20)]
    whole = log(tmp_path / "whole.csv", [each.strftime("%Y%m%d%H%M%S") for each in moments()], "Time [YYYYMMDDHHMMSS]")
    assert Recording.of(whole, RIG, COLUMNS).time.tolist() == [float(k) for k in range(20)]


def test_digits_under_seconds_are_seconds(tmp_path):
    found = Recording.of(log(tmp_path / "log.csv", ["235958", "235959", "235960"], "Time [s]"), RIG, COLUMNS)
    assert found.time.tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("meant", ["DAY", "CLOCK"])
def test_a_date_and_a_time_of_day_in_two_columns_are_one_time_whichever_is_named(tmp_path, meant):
    times = [
        *moments(),
        *moments(begin=BEGIN + datetime.timedelta(days=2)),
    ]  # a break of two days, which the time of day alone does not show
    rows = [f"{each:%Y/%m/%d},{each:%H:%M:%S},{100 + k % 7},{10 + k % 5}" for k, each in enumerate(times)]
    (tmp_path / "log.csv").write_text("DAY,CLOCK,RPM (rpm),TQ (kN m)\n" + "\n".join(rows))
    found = Recording.of(tmp_path / "log.csv", RIG, {**COLUMNS, "time": meant})
    assert found.time.tolist() == [(each - BEGIN).total_seconds() for each in times]


def test_a_date_that_stands_still_past_midnight_is_none_of_the_time_of_day(tmp_path):
    rows = [f"2017/08/01,{each:%H:%M:%S},{100 + k % 7},{10 + k % 5}" for k, each in enumerate(moments())]
    (tmp_path / "log.csv").write_text("SPUD,CLOCK,RPM (rpm),TQ (kN m)\n" + "\n".join(rows))
    found = Recording.of(tmp_path / "log.csv", RIG, {**COLUMNS, "time": "CLOCK"})
    assert found.time.tolist() == [float(k) for k in range(20)]
    assert "`SPUD` stands still past midnight" in str(found)


@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M:%S", "%H:%M:%S", "%d/%m/%Y %H:%M:%S"])
def test_a_table_whose_newest_row_stands_first_is_turned(tmp_path, form):
    cells = [each.strftime(form) for each in moments()]
    up = Recording.of(log(tmp_path / "up.csv", cells), RIG, COLUMNS)
    rows = (tmp_path / "up.csv").read_text().splitlines()
    (tmp_path / "down.csv").write_text("\n".join([rows[0], *rows[:0:-1]]))
    down = Recording.of(tmp_path / "down.csv", RIG, COLUMNS)
    assert down.time.tolist() == up.time.tolist() and "turned" in str(down)
    assert all(np.array_equal(down.signals[name], up.signals[name]) for name in up.signals)


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: seconds_of(["13/05/2024 10:00", "05/14/2024 10:00"], "The log"), "no order fits all"),
    (lambda: seconds_of(["01/05/2024 10:00", "13/05/2024 10:00"], "The log", "MM/DD/YYYY"),
     r"dates as MM/DD/YYYY, as was declared, but no order fits all, `13/05/2024 10:00` among them"),
    (lambda tmp_path: Recording.of(log(tmp_path / "log.csv", ["235959", "235961", "240000"], "Time [HHMMSS]"), RIG, COLUMNS),
     r"must hold times as HHMMSS, as was declared, but it holds `235961`"),
    (lambda tmp_path: Recording.of(log(tmp_path / "log.csv", ["day 3 at noon", "day 3 at one", "day 3 at two"]), RIG, COLUMNS),
     r"must hold times, but it holds `day 3 at noon`. Understood are .*31-Dec-2024.*--column"),
)  # fmt: skip
