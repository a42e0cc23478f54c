"""A damaged file is an error that names it, or the same data: never other data, and never another exception."""

from __future__ import annotations

import gzip
import json
import os
import struct
import tracemalloc
import zipfile
import zlib

import numpy as np
import pytest
import scipy.sparse
from scipy.io import loadmat, mmwrite, savemat

from models import ElasticBody, ReducedBody
from studies.benchmarks.damaged_files import ARGUMENTS, BELT, KINDS, Reader, run_file, store_file, tried
from toolbox import Scene, SceneError, Trajectory, sweep
from toolbox.calibration.recording import Recording
from toolbox.commands.command_line import main
from toolbox.files.journal import Journal
from toolbox.files.mat import read_mat
from toolbox.files.reading import opened
from toolbox.sweeps import Sweep


@pytest.fixture(scope="module")
def reader():
    with Reader() as child:
        yield child


@pytest.mark.parametrize("kind", KINDS)
def test_twenty_damaged_files_are_refused_by_name_or_right_and_kill_nothing(kind, tmp_path, reader):
    if kind == "store":
        pytest.importorskip("zarr")
    counts, faults = tried(kind, tmp_path, 20, 3, reader)
    assert not faults, "\n".join(faults)
    assert counts["refused"] > 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_five_hundred_damaged_files_are_refused_by_name_or_right_and_kill_nothing(kind, tmp_path, reader):
    if kind == "store":
        pytest.importorskip("zarr")
    counts, faults = tried(kind, tmp_path, 500, 4, reader)
    assert not faults, "\n".join(faults)
    print(json.dumps({kind: counts}))


def test_a_reader_that_dies_or_grows_is_a_fault(tmp_path, monkeypatch):
    for words, script in (("killed by signal 9", "import os; os.kill(os.getpid(), 9)"), ("MB", "x = b'x' * (600 * 2**20)")):
        patch = f"def read(path):\n    if 'kept' not in str(path): exec({script!r})\n"
        (tmp_path / "broken_reader.py").write_text(
            patch
            + "from studies.benchmarks import damaged_files\ndamaged_files.KINDS['CSV'] = (None, read, False)\ndamaged_files.child()\n"
        )
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
        monkeypatch.setattr("studies.benchmarks.damaged_files.MODULE", "broken_reader")
        (tmp_path / "kept").write_text("")
        with Reader() as child:
            came, told = child.display_units("CSV", tmp_path / "rig.csv", tmp_path / "kept")
        assert came == "fault" and words in told


def test_a_store_without_a_chunk_of_its_axis_is_refused_and_not_filled_in(tmp_path):
    pytest.importorskip("zarr")
    store = store_file(tmp_path)
    (store / "block.mass" / "c" / "0").unlink()
    with pytest.raises(SceneError, match="`.*block.mass/c/0` of the sweep is missing, and with it what was varied"):
        Sweep.load(store)


def test_a_measure_that_is_nan_everywhere_is_found_again(tmp_path):
    pytest.importorskip("zarr")
    found = sweep(BELT, {"block.mass": [1.0, 2.0]}, duration=5.0, checkpoint=tmp_path / "out")
    assert np.isnan(found["severity"]).all() and np.isnan(Sweep.load(tmp_path / "out")["severity"]).all()


def test_stores_of_format_2_and_of_other_codecs_are_refused_before_their_code_runs(tmp_path, monkeypatch):
    pytest.importorskip("zarr")
    import numcodecs.registry

    monkeypatch.setattr(numcodecs.registry, "get_codec", lambda config: pytest.fail(f"made {config}"))
    old = tmp_path / "old"
    (old / "status").mkdir(parents=True)
    (old / ".zgroup").write_text('{"zarr_format": 2}')
    codec = {"id": "pickle"}
    (old / "status" / ".zarray").write_text(
        json.dumps(
            {
                "zarr_format": 2,
                "shape": [1],
                "chunks": [1],
                "dtype": "|O",
                "filters": [codec],
                "compressor": None,
                "fill_value": None,
                "order": "C",
            }
        )
    )
    (old / "status" / "0").write_bytes(b"")
    with pytest.raises(SceneError, match="There is no sweep in"):
        Sweep.load(old)
    with pytest.raises(SceneError, match="must be an empty or new folder"):
        sweep(BELT, {"block.mass": [1.0]}, duration=1.0, checkpoint=old)
    store = store_file(tmp_path)
    for change in ({"codecs": [{"name": "numcodecs.pickle"}]}, {"zarr_format": 2}, {"data_type": "fixed_length_utf32"}):
        text = json.loads((store / "status" / "zarr.json").read_text())
        notes = json.loads((store / "zarr.json").read_text())
        notes["attributes"].pop("checksum", None)  # as one who means harm would
        inner = json.loads(notes["attributes"]["sweep"])
        inner.pop("digests", None)
        notes["attributes"]["sweep"] = json.dumps(inner)
        (store / "zarr.json").write_text(json.dumps(notes))
        (store / "status" / "zarr.json").write_text(json.dumps({**text, **change}))
        with pytest.raises(SceneError, match="status/zarr.json"):
            Sweep.load(store)
        (store / "status" / "zarr.json").write_text(json.dumps(text))
    assert Sweep.load(store).runs == 6  # notes without checksums are those of an early version


def test_a_journal_of_an_early_version_goes_on(tmp_path):
    path = tmp_path / "journal"
    lines = [
        {"format": "stickslip journal 1", "arguments": ARGUMENTS},
        {"numbers": [0.5, None], "result": {"values": [[1.0]], "failures": []}},
    ]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    journal = Journal(path, ARGUMENTS)
    journal.add((0.25, 1.0), {"values": [[2.0]], "failures": []})
    assert set(Journal(path, ARGUMENTS).known) == {(0.5, None), (0.25, 1.0)}


def test_hidden_and_foreign_folders_in_a_store_stay_and_end_nothing(tmp_path):
    pytest.importorskip("zarr")
    store = store_file(tmp_path)
    mine = [store / ".mine" / "a.txt", store / "status" / ".cache" / "b.txt", store / "notes" / "c.txt"]
    for path in mine:
        path.parent.mkdir()
        path.write_text("mine")
    assert store_file(tmp_path) == store and Sweep.load(store).runs == 6
    assert all(path.read_text() == "mine" for path in mine)
    with pytest.raises(SceneError, match="must not hide your own files, but `.*\\.mine` is not of a sweep"):
        Sweep.load(store).save(store)
    assert all(path.read_text() == "mine" for path in mine)
    (tmp_path / "folder.zarr").mkdir()
    (tmp_path / "folder.zarr" / "mine.txt").write_text("mine")
    with pytest.raises(SceneError, match="must not hide your own files"):
        Sweep.load(store).save(tmp_path / "folder.zarr")
    assert (tmp_path / "folder.zarr" / "mine.txt").read_text() == "mine"


@pytest.mark.filterwarnings("ignore:The default value for `spmatrix`:DeprecationWarning")  # of the reader of scipy that it is compared with
@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize("form", ["4", "5"])
def test_mat_files_are_read_as_scipy_reads_them(tmp_path, packed, form):
    draw = np.random.default_rng(1)
    sparse = scipy.sparse.random(6, 9, 0.4, random_state=1).tocsc()
    held = {
        "d": draw.normal(size=(4, 5)),
        "f": np.float32([[1, 2]]),
        "i": np.arange(6, dtype="i2").reshape(2, 3),
        "s": sparse,
        "t": "text",
        "x": 3.0,
    }
    if form == "5":
        held |= {
            "c": np.array([1 + 2j]),
            "st": {"a": 1.0},
            "n": draw.normal(size=(2, 3, 4)),
            "e": np.empty((0, 3)),
            "a_longer_name": np.uint64([[7]]),
        }
    savemat(tmp_path / "all.mat", held, format=form, do_compression=packed and form == "5")
    found, theirs = read_mat(tmp_path / "all.mat"), loadmat(tmp_path / "all.mat")
    assert set(found) == set(held) - {"t", "c", "st"}
    for name, each in found.items():
        ours, other = (one.toarray() if scipy.sparse.issparse(one) else one for one in (each, theirs[name]))
        assert np.array_equal(ours, other), name


def test_matrices_that_ended_the_process_are_refused(tmp_path):
    dense, path = np.eye(3), tmp_path / "mass.mtx"
    mmwrite(path, scipy.sparse.coo_array(dense))
    whole = path.read_bytes()
    assert (ElasticBody.from_files(path, path).mass.toarray() == dense).all()
    huge = whole.replace(b"3 3 3", b"3 3 99999999999999")
    wide = whole.replace(b"3 3 3", b"999999999 999999999 3")
    for content in (whole + bytes(5000), huge, wide, whole.replace(b"3 3 3", b"3 3 4"), whole.replace(b"\n3 3 ", b"\n4 3 "), b""):
        assert content != whole
        path.write_bytes(content)
        with pytest.raises(SceneError, match=r"mass\.mtx` is no sound Matrix Market file"):
            ElasticBody.from_files(path, path)
    packed = tmp_path / "mass.mtx.gz"
    for content in (gzip.compress(whole)[:-9], gzip.compress(whole)[:12] + b"\xff" * 20, gzip.compress(whole + bytes(2**20)), b""):
        packed.write_bytes(content)
        with pytest.raises(SceneError, match=r"mass\.mtx\.gz` is no sound Matrix Market file"):
            ElasticBody.from_files(packed, packed)
    packed.write_bytes(gzip.compress(whole.replace(b"3 3 3", b"3 3 3\n" + b"%" * 2**26)))
    with pytest.raises(SceneError, match="it unpacks to more than 32 MiB"):
        ElasticBody.from_files(packed, packed)
    path.write_bytes(b"%%MatrixMarket matrix array real symmetric\n2400 2400\n" + b"0\n" * (2400 * 2401 // 2))
    with pytest.raises(SceneError, match="its 2881200 entries take far more memory than their text"):
        ElasticBody.from_files(path, path)
    sparse = scipy.sparse.csc_array(dense)
    for indices, starts in (([0, 1, 7], [0, 1, 2, 3]), ([0, 1, -2], [0, 1, 2, 3]), ([0, 1, 2], [0, 9, 2, 3]), ([0, 1, 2], [0, 1, 2, 900])):
        sparse.indices[:], sparse.indptr[:] = indices, starts
        savemat(tmp_path / "mass.mat", {"M": sparse})
        with pytest.raises(SceneError, match="sparse matrix"):
            read_mat(tmp_path / "mass.mat")


@pytest.mark.parametrize("packed", [bytes(2**29), b"doubles"], ids=["zeros", "doubles of a byte"])
def test_a_mat_file_that_takes_far_more_memory_than_its_size_is_refused(tmp_path, packed):
    if packed == b"doubles":
        count = 2**26
        head = struct.pack("<IIIIIIiiHH4sII", 6, 8, 6, 0, 5, 8, 1, count, 1, 1, b"a", 2, count)
        packed = struct.pack("<II", 14, len(head) + count) + head + bytes(count)
    packed = zlib.compress(packed, 1)
    (tmp_path / "mass.mat").write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(packed)) + packed)
    tracemalloc.start()
    with pytest.raises(SceneError, match=r"mass\.mat` must be a MAT file, but .* more than \d+ MiB"):
        read_mat(tmp_path / "mass.mat")
    assert tracemalloc.get_traced_memory()[1] < 300 * 2**20
    tracemalloc.stop()


def test_an_archive_that_unpacks_to_far_more_than_its_size_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "run.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("time.npy", "w", force_zip64=True) as entry,
    ):
        np.lib.format.write_array_header_1_0(entry, {"descr": "<f8", "fortran_order": False, "shape": (300 * 2**17,)})
        for _ in range(300):
            entry.write(bytes(2**20))
    assert path.stat().st_size < 2 * 2**20
    tracemalloc.start()
    with pytest.raises(SceneError, match="unpacks to 300 MiB, and may to 256"):
        Trajectory.load(path)
    assert tracemalloc.get_traced_memory()[1] < 2**24
    tracemalloc.stop()


def test_the_header_of_an_array_is_compared_with_what_is_there_before_memory_is_taken(tmp_path):
    path = run_file(tmp_path)
    held = dict(np.load(path))
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in held.items():
            with archive.open(f"{name}.npy", "w") as entry:
                np.lib.format.write_array_header_1_0(
                    entry, {"descr": array.dtype.str, "fortran_order": False, "shape": (10**12,) if name == "time" else array.shape}
                )
                entry.write(np.ascontiguousarray(array).tobytes())
    with pytest.raises(SceneError, match="the header of an array does not fit to its content"):
        Trajectory.load(path)


@pytest.mark.skipif(os.name != "posix", reason="devices and pipes are those of POSIX")
@pytest.mark.parametrize("kind", ["a device", "a pipe", "a folder"])
@pytest.mark.parametrize("name", ["x.npz", "x.csv", "x.mat", "x.toml", "x.mtx", "x.mtx.gz", "x.journal", "body.npz"])
def test_only_regular_files_are_opened(tmp_path, name, kind):
    readers = {
        "x.npz": Trajectory.load, "body.npz": ReducedBody.load, "x.toml": Scene.load, "x.journal": lambda path: Journal(path, ARGUMENTS),
        "x.mtx": lambda path: ElasticBody.from_files(path, path), "x.mtx.gz": lambda path: ElasticBody.from_files(path, path),
    }  # fmt: skip
    path = tmp_path / name
    if kind == "a device":
        path.symlink_to("/dev/zero")
    elif kind == "a pipe":
        os.mkfifo(path)
    else:
        path.mkdir()
    with pytest.raises(SceneError, match=f"must be a regular file, but it is {kind}"):
        readers.get(name, lambda path: Recording.of(path, BELT))(path)


@pytest.mark.skipif(os.name != "posix", reason="symbolic links of POSIX")
def test_a_link_that_leads_to_nothing_says_where_it_leads(tmp_path):
    (tmp_path / "rig.csv").symlink_to("elsewhere.csv")
    (tmp_path / "round.csv").symlink_to("round.csv")
    with pytest.raises(SceneError, match=r"There is no file `.*rig\.csv`: it is a symbolic link to `elsewhere\.csv`, which is not there\."):
        Recording.of(tmp_path / "rig.csv", BELT)
    with pytest.raises(SceneError, match=r"`.*round\.csv` cannot be read: Too many levels of symbolic links"):
        Recording.of(tmp_path / "round.csv", BELT)


@pytest.mark.skipif(os.name != "posix", reason="pipes are those of POSIX")
def test_a_pipe_in_a_store_is_refused(tmp_path):
    pytest.importorskip("zarr")
    for name in ("zarr.json", "status/zarr.json", "severity/c/0/0", "block.mass/c/0"):
        place = tmp_path / name.replace("/", "_")
        place.mkdir()
        store = store_file(place)
        (store / name).unlink()
        os.mkfifo(store / name)
        with pytest.raises(SceneError, match="zarr"):
            Sweep.load(store)


def test_a_file_that_is_larger_than_it_may_be_is_not_read(tmp_path):
    with (tmp_path / "scene.toml").open("wb") as file:
        file.truncate(2**40)  # of which the disk holds nothing
    with pytest.raises(SceneError, match="must be of at most 4 MiB, but it is of 1048576 MiB"):
        Scene.load(tmp_path / "scene.toml")
    with pytest.raises(SceneError, match="must be of at most 4096 MiB"):
        opened(tmp_path / "scene.toml")


@pytest.mark.parametrize("text", ["a" + ".a" * 200_000 + " = 1", "[" + "a." * 200_000 + "a]", 'a."b c"' + " . 'd'" * 200_000 + " = 1"])
def test_a_scene_with_a_key_of_very_many_parts_is_refused(tmp_path, text):
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(SceneError, match="keys have at most a hundred parts"):
        Scene.load(tmp_path / "scene.toml")


def test_a_large_file_in_the_way_of_a_report_is_not_read(tmp_path, capsys):
    with (tmp_path / "page.html").open("wb") as file:
        file.truncate(2**31)
    assert main(["report", str(tmp_path), "--page", str(tmp_path / "page.html")]) == 2
    assert "is not an earlier report" in capsys.readouterr().err
