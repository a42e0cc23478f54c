"""Logs of every kind are read right with every flaw told, or refused with what to do."""

import datetime

import numpy as np
import pytest

from models import BitRock, wells
from studies.benchmarks.dirty_logs import RIG, faults, made
from toolbox import SceneError, compose
from toolbox.calibration import Recording
from toolbox.logs.dates import seconds_of
from toolbox.logs.grids import of_text

NAMES = (
    "commas", "semicolons and decimal commas", "decimal commas and points for thousands", "thousands in quotes", "tabulators and round brackets", "spaces",
    "a preamble", "units in the second line", "units given", "latin-1", "utf-16", "a byte order mark and carriage returns", "ISO times with a zone",
    "ISO times without a zone", "milliseconds since 1970", "date and time of day apart", "units in capitals", "LAS with its own null", "MAT 7.3", "xlsx",
    "parquet over dates", "null -999.25", "null -32768", "null 1e30", "a declared null", "empty cells", "words in cells", "drop-outs to zero", "clipping",
    "reversed speed", "jumps of an encoder", "a gap of three seconds", "two gaps", "rows written twice", "a block written again", "a time that goes back",
    "a row that is cut short", "a heading mistyped", "no units", "days or months", "thousands or decimals", "WITSML",
)  # fmt: skip


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    for package in ("pandas", "pyarrow", "openpyxl", "lasio", "pymatreader", "h5py"):
        pytest.importorskip(package)
    found = made(tmp_path_factory.mktemp("logs"))
    assert tuple(found) == NAMES
    return found


@pytest.mark.parametrize("name", NAMES)
def test_a_log_is_read_right_with_every_flaw_told_or_refused_with_what_to_do(logs, name):
    assert faults(logs[name]) == []


@pytest.mark.parametrize(("words", "values"), [(1, 1), (1, 2), (1, 5), (2, 2), (2, 5), (3, 3)])
def test_a_time_with_a_blank_does_not_part_a_log_at_blanks_whose_cells_are_parted_by_tabulators(words, values):
    names = ["time", *[f"note{i}" for i in range(words)], *[f"signal{i}" for i in range(values)]]
    rows = [
        [f"2024-03-01 10:00:{second:02d}", *["drilling"] * words, *[f"{second + 0.5 * i}" for i in range(values)]] for second in range(40)
    ]
    found = of_text("\n".join("\t".join(row) for row in [names, *rows]), "The log")
    assert [column.name for column in found.columns] == names and found.notes == ["cells parted by tabulators"]
    assert found.columns[-1].cells == [row[-1] for row in rows]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("0,nan\n0.1,nan\n0.2,\n0.3,nan\n", "column `bit.speed`, must hold at least three values, but 4 of 4 samples are none"),
        ("0,1.5\n", "must hold at least three samples, but they hold 1"),
        ("", "must hold a table of numbers"),
    ],
    ids=["no value at all", "one sample", "headings alone"],
)
def test_a_log_with_nothing_in_it_is_refused_with_what_it_lacks(tmp_path, lines, said):
    log = tmp_path / "log.csv"
    log.write_text("time [s],bit.speed [rad/s],top.torque [N m]\n" + lines.replace("\n", ",nan\n"))
    with pytest.raises(SceneError, match=said):
        Recording.of(log, compose(wells.JANSEN_2, BitRock()))


@pytest.mark.parametrize(
    "cells",
    [
        ["31.12.2024 23:59:59.5", "01.01.2025 00:00:02", "05.02.2025"],
        ["31/12/24 23:59:59,5", "1/1/25 0:00:02", "5/2/25"],
        ["12/31/2024 11:59:59.5 PM", "1/1/2025 12:00:02 AM", "2/5/2025"],
        ["31-12-2024T23:59:59.5", "01-01-2025T00:00:02", "05-02-2025"],
        ["2024-12-31 23:59:59.5", "2025-01-01T00:00:02", "2025-02-05"],
    ],
    ids=["points", "day first", "month first", "lines", "ISO"],
)
def test_a_date_is_the_same_moment_in_every_way_of_writing_it(cells):
    moments = [datetime.datetime(2024, 12, 31, 23, 59, 59, 500_000), datetime.datetime(2025, 1, 1, 0, 0, 2), datetime.datetime(2025, 2, 5)]
    found, words = seconds_of(cells, "A log")
    assert found.tolist() == [(each - datetime.datetime(1970, 1, 1)).total_seconds() for each in moments]
    assert words == "dates without a zone"


@pytest.mark.parametrize(
    ("cells", "steps"),
    [
        (["03/07/2024 23:59:58", "03/07/2024 23:59:59", "03/08/2024 00:00:01"], [1.0, 2.0]),
        (["07/03/2024 23:59:58", "07/03/2024 23:59:59", "08/03/2024 00:00:01"], [1.0, 2.0]),
        (["03/07/2024 10:00:00", "03/07/2024 10:00:01", "", "03/07/2024 10:00:03"], [1.0, float("nan"), float("nan")]),
    ],
    ids=["month first", "day first", "on one date"],
)
def test_day_and_month_are_told_apart_by_a_time_that_goes_on(cells, steps):
    # the 7th of March, or the 3rd of July: the other reading would step over a month
    assert list(np.diff(seconds_of(cells, "The log")[0])) == pytest.approx(steps, nan_ok=True)


def test_a_log_that_steps_by_a_month_in_either_reading_is_refused():
    with pytest.raises(SceneError, match=r"day and month can be told apart, but `03/04/2024 10:00` may be either"):
        seconds_of(["03/04/2024 10:00", "04/05/2024 10:00", "05/06/2024 10:00"], "The log")


def recorded(tmp_path, lines, columns=None, end="\n"):
    log = tmp_path / "log.csv"
    log.write_text("\n".join(lines) + end)
    return Recording.of(log, RIG, columns)


def test_a_file_that_ends_inside_its_last_number_is_read_without_that_row(tmp_path):
    lines = ["time [s];bit.speed [rad/s];bit.weight [kN]", *(f"{k};{9 + 0.1 * k:.2f};{95 + k:.3f}" for k in range(20))]
    whole = recorded(tmp_path, lines, end="")
    assert whole.time.size == 20 and not any("last row" in note for note in whole.notes)
    for lost in (1, 3, 4):  # 114.00, 114., 114
        cut = recorded(tmp_path, [*lines[:-1], lines[-1][:-lost]], end="")
        assert cut.time.size == 19 and any("the last row left out: the file ends inside its last number" in note for note in cut.notes)
    ended = recorded(tmp_path, [*lines[:-1], lines[-1][:-1]])
    assert ended.time.size == 20  # a recorder that ends its line wrote the number whole


@pytest.mark.parametrize("none", ["NaN", "#N/A", "---", "null"])
def test_first_rows_without_values_are_no_headings(tmp_path, none):
    rows = [f"{k},{none},{none},{none}" for k in range(5)] + [f"{k},{9 + 0.1 * k},{95 + k},{9000 + 7 * k}" for k in range(5, 20)]
    found = recorded(tmp_path, ["time [s],bit.speed [rad/s],bit.weight [kN],top.torque [N m]", *rows])
    assert found.time.size == 20 and np.isnan(found.signals["bit.speed"][:5]).all() and found.signals["bit.speed"][5] == 9.5


def test_a_point_in_another_column_does_not_make_a_decimal_comma_one_of_thousands(tmp_path):
    lines = ["time [min];bit.speed [rpm];bit.weight [kN]", *(f"{k / 60:.6f};{100 + k},{120 + k};{95 + k},{300 + k}" for k in range(20))]
    with pytest.raises(SceneError, match="must tell thousands from decimals, but `100,120` may be either"):
        recorded(tmp_path, lines)
    lines[7] = lines[7].rpartition(";")[0] + ";-999.25"  # the recorder writes its null with a point
    with pytest.raises(SceneError, match="must tell thousands from decimals"):
        recorded(tmp_path, lines)
    lines = ["time [s];bit.speed [rpm];bit.weight [kN]", *(f"{k};{100 + k};{'1,000' if k == 9 else f'{990.5 + k}'}" for k in range(20))]
    assert recorded(tmp_path, lines).signals["bit.weight"][9] == pytest.approx(1000e3)  # others of its column have a point


def test_digits_under_seconds_that_are_a_time_of_day_are_asked_back(tmp_path):
    moments = [datetime.datetime(2024, 1, 1, 0, 0, 30) + datetime.timedelta(seconds=5 * k) for k in range(20)]
    rows = [f"{moment:%H%M%S},{9 + 0.1 * k}" for k, moment in enumerate(moments)]
    with pytest.raises(SceneError, match=r"say `time \[HHMMSS\]` where you say which column is `time`"):
        recorded(tmp_path, ["time [s],bit.speed [rad/s]", *rows])
    declared = recorded(tmp_path, ["time [HHMMSS],bit.speed [rad/s]", *rows])
    assert declared.time.tolist() == [5.0 * k for k in range(20)]
    seconds = recorded(tmp_path, ["time [s],bit.speed [rad/s]", *(f"{100000 + 5 * k},{9 + 0.1 * k}" for k in range(20))])
    assert seconds.time.tolist() == [5.0 * k for k in range(20)]  # 100060 is no time of day


@pytest.mark.parametrize("unit", ["-", "1", "unitless", "", "n/a"])
def test_a_time_whose_unit_is_none_is_an_epoch_or_asked_back(tmp_path, unit):
    head = f"time [{unit}],bit.speed [rad/s]"
    found = recorded(tmp_path, [head, *(f"{1_503_705_580 + 2 * k},{9 + 0.1 * k}" for k in range(20))])
    assert found.time.tolist() == [2.0 * k for k in range(20)]
    with pytest.raises(SceneError, match=r"must name its unit, such as `time \[s\]`"):
        recorded(tmp_path, [head, *(f"{2 * k},{9 + 0.1 * k}" for k in range(20))])


@pytest.mark.parametrize("null", [999.25, 9999.0])
def test_nulls_above_zero_are_no_values(tmp_path, null):
    rows = [f"{k},{null if k in (3, 7) else 95 + k}" for k in range(20)]
    found = recorded(tmp_path, ["time [s],bit.weight [kN]", *rows])
    assert found.found("bit.weight") == {"null": 2} and np.flatnonzero(np.isnan(found.signals["bit.weight"])).tolist() == [3, 7]
