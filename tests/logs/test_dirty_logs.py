"""Logs of every kind are read right with every flaw told, or refused with what to do."""

import pytest

from studies.benchmarks.dirty_logs import faults, made

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
