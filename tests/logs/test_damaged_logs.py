"""Logs that are damaged, or that would take more memory than they may: one error that names the file, or the samples that are data."""

from __future__ import annotations

import random
import tracemalloc
import zipfile

import numpy as np
import pytest

from models import BlockOnBelt
from toolbox import SceneError, compose
from toolbox.calibration.recording import Recording
from toolbox.files.tables import Column, read

BELT = compose(BlockOnBelt())
HEAD = "time [s],block.speed [m/s],block.position [mm]"


def rows(count):
    return [f"{k / 10:.1f},{np.sin(k / 10):.6f},{np.cos(k / 10):.6f}" for k in range(count)]


def table(path, lines):
    path.write_text("\n".join([HEAD, *lines]) + "\n")
    return path


def sheet(path, change=lambda sheet: None):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["time [s]", "block.speed [m/s]"])
    for k in range(50):
        book.active.append([k / 10, np.sin(k / 10)])
    change(book.active)
    book.save(path)
    return path


def refused_cheaply(path):
    """The words of the error of a file, for which less than 64 MiB was taken."""
    tracemalloc.start()
    try:
        with pytest.raises(SceneError) as refusal:
            Recording.of(path, BELT)
        assert tracemalloc.get_traced_memory()[1] < 2**26
    finally:
        tracemalloc.stop()
    return str(refusal.value)


@pytest.mark.parametrize("count", [200, 9000])
@pytest.mark.parametrize("seed", range(3))
def test_one_quotation_mark_in_a_log_is_an_error_that_names_the_line(tmp_path, count, seed):
    lines, at = rows(count), random.Random(seed).randrange(count // 2)
    cells = lines[at].split(",")
    cells[seed] = '"' + cells[seed]
    lines[at] = ",".join(cells)
    with pytest.raises(SceneError, match=rf"rig\.csv`, line {at + 2}: a cell that a quotation mark opens must be closed"):
        Recording.of(table(tmp_path / "rig.csv", lines), BELT)


def test_a_heading_between_quotation_marks_may_have_two_lines(tmp_path):
    path = tmp_path / "rig.csv"
    path.write_text("\n".join(['time [s],"block.speed\n[m/s]"', *(f"{k / 10},{np.sin(k / 10)}" for k in range(50))]))
    assert Recording.of(path, BELT).signals["block.speed"].size == 50


def test_one_quotation_mark_in_a_long_row_of_a_table_is_an_error_that_names_the_line(tmp_path):
    path = tmp_path / "well.csv"
    path.write_text('name,length [m]\none,1\n"' + "x" * 140_000 + ",2\n")
    with pytest.raises(SceneError, match=r"well\.csv`, line 3: a cell that a quotation mark opens must be closed"):
        read(path, [Column("name", None), Column("length", "m")])


@pytest.mark.parametrize("place", [0, 30, 99])
@pytest.mark.parametrize("stray", [-1e20, 1e20, -1e28, 1e12])
def test_one_time_that_is_none_is_left_out_and_told(tmp_path, place, stray):
    lines = rows(100)
    lines[place] = f"{stray!r},{lines[place].partition(',')[2]}"
    found = Recording.of(table(tmp_path / "rig.csv", lines), BELT)
    kept = [k / 10 for k in range(100) if k != place]
    assert np.allclose(found.time, np.array(kept) - kept[0], rtol=0, atol=1e-9)
    assert sum(count for kind, count in found.found("time").items() if kind in ("stray", "backward")) == 1
    assert "samples over 9." in str(found)


def test_a_break_of_a_day_in_a_log_of_ten_seconds_is_a_gap_and_no_stray_time(tmp_path):
    lines = rows(100)
    lines[99] = f"86400.0,{lines[99].partition(',')[2]}"
    found = Recording.of(table(tmp_path / "rig.csv", lines), BELT)
    assert found.time[-1] == 86400.0 and found.found("time") == {"gap": 1}


def test_a_sheet_with_one_far_cell_is_refused_before_it_is_laid_out(tmp_path, monkeypatch):
    path = sheet(tmp_path / "rig.xlsx", lambda sheet: sheet.cell(100_000, 400, 1))
    words = refused_cheaply(path)
    need = -(-64 * 100_000 * 400 // 2**20)
    assert f"must take at most 256 MiB once it is read, but it takes {need} MiB" in words and f"STICKSLIP_UNPACKED={need}" in words
    near = sheet(tmp_path / "near.xlsx", lambda sheet: sheet.cell(400, 90, 1))
    assert Recording.of(near, BELT).signals["block.speed"].size >= 50
    monkeypatch.setenv("STICKSLIP_UNPACKED", "1")
    with pytest.raises(SceneError, match="must take at most 1 MiB"):
        Recording.of(near, BELT)


def test_a_sheet_that_unpacks_to_400_mb_is_refused_before_it_is_unpacked(tmp_path):
    path, big = sheet(tmp_path / "rig.xlsx"), tmp_path / "big.xlsx"
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(big, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
        for name in archive.namelist():
            with packed.open(name, "w") as entry:
                entry.write(archive.read(name))
                for _ in range(400 if "sheet1" in name else 0):
                    entry.write(b" " * 2**20)
    assert "once it is read, but it takes 401 MiB" in refused_cheaply(big)


def test_a_parquet_file_of_fifty_million_rows_is_refused_before_it_is_read(tmp_path):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    part = pyarrow.table({"time [s]": np.zeros(5_000_000), "block.speed [m/s]": np.zeros(5_000_000)})
    with parquet.ParquetWriter(tmp_path / "rig.parquet", part.schema) as writer:
        for _ in range(10):
            writer.write_table(part)
    assert (tmp_path / "rig.parquet").stat().st_size < 2**20
    assert f"but it takes {-(-3 * 8 * 2 * 50_000_000 // 2**20)} MiB" in refused_cheaply(tmp_path / "rig.parquet")


def test_arrays_of_a_mat_file_of_version_7_3_are_measured_before_they_are_read(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "rig.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_dataset("time", (1, 100_000_000), "f8", chunks=(1, 100_000), compression="gzip").attrs["MATLAB_class"] = np.bytes_(
            "double"
        )
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    assert f"but it takes {-(-3 * 8 * 100_000_000 // 2**20)} MiB" in refused_cheaply(path)
