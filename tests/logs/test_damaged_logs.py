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


def repacked(path, name, change):
    with zipfile.ZipFile(path) as archive:
        held = {each: archive.read(each) for each in archive.namelist()}
    held[name] = change(held[name])
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for each, content in held.items():
            archive.writestr(each, content)


FAR = b'<row r="1048576"><c r="XFD1048576"><v>1</v></c></row></sheetData>'
HIDDEN = {
    "in UTF-16": lambda text: text.replace(b"</sheetData>", FAR).decode().encode("utf-16"),
    "in entities": lambda text: text.replace(b"</sheetData>", FAR.replace(b"XFD", b"&#88;FD")),
    "in a declared entity": lambda text: b'<!DOCTYPE a [<!ENTITY b "x">]>' + text,
}


@pytest.mark.parametrize("how", HIDDEN)
def test_a_far_cell_that_is_hidden_from_the_bytes_is_refused(tmp_path, how):
    path = sheet(tmp_path / "rig.xlsx")
    Recording.of(path, BELT)
    repacked(path, "xl/worksheets/sheet1.xml", HIDDEN[how])
    with pytest.raises(SceneError, match="must be a sheet, but it is not: its part"):
        Recording.of(path, BELT)


def test_styles_and_sheets_that_stand_very_often_are_refused(tmp_path):
    path = sheet(tmp_path / "rig.xlsx")
    repacked(path, "xl/styles.xml", lambda text: text.replace(b"</cellXfs>", b"<xf/>" * 400_000 + b"</cellXfs>"))
    with pytest.raises(SceneError, match="must take at most 256 MiB"):
        Recording.of(path, BELT)


def linked(file, h5py):
    file["far"] = h5py.ExternalLink("other.h5", "/x")


def elsewhere(file, h5py):
    file.create_dataset("far", shape=(1, 50), dtype="f8", external=[("/dev/zero", 0, 400)])


def chunked(file, h5py):
    file.create_dataset("far", shape=(10,), maxshape=(None,), chunks=(2**27,), dtype="f8", compression="gzip")


def around(file, h5py):
    file.create_group("far")["again"] = file["/"]


def referring(file, h5py):
    last = file.create_dataset("inner", data=np.ones((1, 100_000)))
    for k in range(12):
        cells = file.create_dataset(f"cells{k}", shape=(1, 8), dtype=h5py.ref_dtype)
        cells[:] = last.ref
        last = cells


@pytest.mark.parametrize("change", [linked, elsewhere, chunked, around, referring], ids=lambda each: each.__name__)
def test_a_mat_file_of_version_7_3_that_leads_elsewhere_or_to_itself_is_refused(tmp_path, change):
    h5py = pytest.importorskip("h5py")
    pytest.importorskip("pymatreader")
    with h5py.File(tmp_path / "rig.mat", "w") as file:
        for name in ("time", "block.speed"):
            file.create_dataset(name, data=np.arange(50.0)[None])
        change(file, h5py)
    with pytest.raises(SceneError, match=r"File `.*rig\.mat` must"):
        Recording.of(tmp_path / "rig.mat", BELT)


@pytest.mark.parametrize("name", ["rig.csv", "rig.las"])
def test_a_file_of_zeros_is_no_table(tmp_path, name):
    (tmp_path / name).write_bytes(bytes(10_000))
    with pytest.raises(SceneError, match="must be a table in text, a sheet"):
        Recording.of(tmp_path / name, BELT)


def test_a_long_line_in_the_head_of_a_las_file_is_refused(tmp_path):
    (tmp_path / "rig.las").write_text("~V\n" + "A." * 10_000 + " : x\n~A\n1 2\n")
    with pytest.raises(SceneError, match="a line of its head has more than 10000 characters"):
        Recording.of(tmp_path / "rig.las", BELT)
