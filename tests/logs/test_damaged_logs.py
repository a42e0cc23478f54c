"""Logs that are damaged, or that would take more memory than they may: one error that names the file, or the samples that are data."""

from __future__ import annotations

import random
import tracemalloc
import zipfile
import zlib

import numpy as np
import pytest

from tests.plants import BELT
from toolbox import SceneError
from toolbox.calibration.recording import Recording
from toolbox.files.tables import Column, read

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


def bursting(file, h5py):
    far = file.create_dataset("far", shape=(1, 1000), dtype="f8", chunks=(1, 1000), compression="gzip")
    far.id.write_direct_chunk((0, 0), zlib.compress(bytes(2**27)))


def packed_twice(file, h5py):
    notes = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    notes.set_chunk((1000,))
    notes.set_deflate(9)
    notes.set_deflate(9)
    far = h5py.h5d.create(file.id, b"far", h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple((1000,)), notes)
    far.write_direct_chunk((0,), zlib.compress(zlib.compress(bytes(2**27))))


def naming(file, h5py):
    inner = file.create_dataset("inner", data=np.ones((1, 3)))
    file.create_dataset("far", shape=(1, 30_000), dtype=h5py.ref_dtype)[:] = inner.ref


@pytest.mark.parametrize(
    "change", [linked, elsewhere, chunked, around, referring, bursting, packed_twice, naming], ids=lambda each: each.__name__
)
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
    (tmp_path / "rig.las").write_text("~V\n" + "A." * 1000 + " : x\n~A\n1 2\n")
    with pytest.raises(SceneError, match="a line of its head has more than 1000 characters"):
        Recording.of(tmp_path / "rig.las", BELT)


SHARED = b'<sst xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">%s</sst>'
LAS = "~Version\nVERS. 2.0:\nWRAP. NO:\n~Well\nNULL. -999:\n{head}~Curve\nTIME.s:\nSPEED.m/s:\n~A\n"


def test_a_long_text_that_many_cells_of_a_sheet_name_stands_in_memory_once(tmp_path):
    path, length, times = tmp_path / "rig.xlsx", 10_000, 20_000
    sheet(path)
    cells = b"".join(b'<row><c><v>%f</v></c><c><v>1</v></c><c t="s"><v>0</v></c></row>' % (10 + k / 10) for k in range(times))
    repacked(path, "xl/worksheets/sheet1.xml", lambda text: text.replace(b"</sheetData>", cells + b"</sheetData>"))
    part = b'<Override PartName="/xl/sharedStrings.xml" ContentType="application/vnd.openxmlformats-officedocument.spreadsheetml.sharedStrings+xml"/>'
    repacked(path, "[Content_Types].xml", lambda text: text.replace(b"</Types>", part + b"</Types>"))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("xl/sharedStrings.xml", SHARED % (b"<si><t>" + b"x" * length + b"</t></si>"))
    tracemalloc.start()
    assert Recording.of(path, BELT).time.size == times + 50
    assert tracemalloc.get_traced_memory()[1] < length * times
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("part", "change", "reason"),
    [
        (
            "sheet1.xml",
            lambda text: text.replace(b"</sheetData>", b"<row>" + b"<c/>" * 20_000 + b"</row></sheetData>"),
            "more than 16384 cells",
        ),
        ("sharedStrings.xml", lambda _: SHARED % (b"<si>" + b"<r><t>a</t></r>" * 300_000 + b"</si>"), "take at most 256 MiB"),
    ],
    ids=["a row of 20 000 cells", "a text of 300 000 pieces"],
)
def test_parts_of_a_sheet_that_take_minutes_are_refused(tmp_path, part, change, reason):
    path = sheet(tmp_path / "rig.xlsx")
    if part == "sharedStrings.xml":
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("xl/sharedStrings.xml", change(b""))
    else:
        repacked(path, f"xl/worksheets/{part}", change)
    with pytest.raises(SceneError, match=rf"File `.*rig\.xlsx` must.*{reason}"):
        Recording.of(path, BELT)


def test_lists_in_a_parquet_file_are_left_out_and_told_and_texts_stand_in_memory_once(tmp_path):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    count, long = 20_000, "x" * 20_000
    texts = pyarrow.DictionaryArray.from_arrays(np.zeros(count, "i4"), [long])
    time = np.arange(count) / 10
    held = {"time [s]": time, "block.speed [m/s]": np.sin(time), "block.position [m]": texts, "lists": [[long[:5000]] * 3] * count}
    parquet.write_table(pyarrow.table(held), tmp_path / "rig.parquet")
    tracemalloc.start()
    with pytest.raises(SceneError, match=r"column `block\.position`"):  # it holds no number
        Recording.of(tmp_path / "rig.parquet", BELT)
    assert tracemalloc.get_traced_memory()[1] < 2**27
    tracemalloc.stop()
    del held["block.position [m]"]
    parquet.write_table(pyarrow.table(held), tmp_path / "rig.parquet")
    assert "`lists` left out: lists or structures" in str(Recording.of(tmp_path / "rig.parquet", BELT))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (LAS.format(head="") + "1 " * 200_000, "a line of its data has more than 1000 values"),
        (LAS.format(head="A.m:\n" * 500), "one mnemonic more than 40 times"),
        (LAS.format(head="".join(f"A{k}.m:\n" for k in range(2000))), "its head has more than 1000 lines"),
        (LAS.format(head="") + "1 2\n" * 6_000_000, "take at most 256 MiB"),
    ],
    ids=["values", "one mnemonic", "mnemonics", "rows"],
)
def test_a_las_file_that_takes_hours_is_refused(tmp_path, text, reason):
    (tmp_path / "rig.las").write_text(text)
    with pytest.raises(SceneError, match=rf"File `.*rig\.las` must.*{reason}"):
        Recording.of(tmp_path / "rig.las", BELT)


def test_parameters_and_remarks_of_a_las_file_may_be_long(tmp_path):
    remarks = "~Parameter\n" + "A.m:\n" * 500 + "~Other\n" + "." * 9000 + "\n"
    (tmp_path / "rig.las").write_text(LAS.format(head=remarks) + "".join(f"{k / 10} {np.sin(k / 10)}\n" for k in range(50)))
    assert Recording.of(tmp_path / "rig.las", BELT, columns={"block.speed": "SPEED"}).signals["block.speed"].size == 50


@pytest.mark.parametrize(
    ("name", "row"), [("rig.csv", "1,2\n"), ("rig.txt", "1 2\n"), ("rig.csv", "\r")], ids=["commas", "blanks", "lines"]
)
def test_a_table_in_text_of_more_cells_than_memory_is_refused(tmp_path, name, row):
    (tmp_path / name).write_text("time [s],block.speed [m/s]\n" + row * 2_500_000)
    assert "must take at most 256 MiB" in refused_cheaply(tmp_path / name)


def test_a_message_about_many_keys_names_some_of_them(tmp_path):
    (tmp_path / "well.toml").write_text("".join(f"k{k} = 1\n" for k in range(9000)))
    with pytest.raises(SceneError, match="`k0`, .* and 8970 more") as refusal:
        read(tmp_path / "well.toml", [Column("length", "m")])
    assert len(str(refusal.value)) < 1000
