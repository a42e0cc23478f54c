"""A damaged file is an error that names it, or the same data: never other data, and never another exception."""

from __future__ import annotations

import json
import random
import shutil

import numpy as np
import pytest
from scipy.io import savemat

from models import BitRock, BlockOnBelt, wells
from toolbox import SceneError, Trajectory, compose, severity_map, simulate, sweep
from toolbox.calibration.recording import Recording
from toolbox.onsets import SeverityMap
from toolbox.sweeps import Sweep
from toolbox.tuning.journal import Journal

pytestmark = pytest.mark.timeout(600)

BELT = compose(BlockOnBelt())
ARGUMENTS = {"plant": "one", "law": "two"}


def run_file(folder):
    return simulate(BELT, 10.0, output_times=np.linspace(0.0, 10.0, 30)).save(folder / "run.npz")


def run_read(path):
    run = Trajectory.load(path)
    return (
        run.time.tobytes(),
        {name: run[name].tobytes() for name in run.names},
        run.events,
        {n: w.tolist() for n, w in run.modes.items()},
        run.end,
    )


def sweep_file(folder):
    return sweep(BELT, {"block.mass": [0.5, 1.0, 2.0], "belt.friction.decay": [2.0, 3.0]}, duration=20.0).save(folder / "sweep.npz")


def store_file(folder):
    sweep(BELT, {"block.mass": [0.5, 1.0, 2.0], "belt.friction.decay": [2.0, 3.0]}, duration=20.0, out=folder / "sweep.zarr")
    return folder / "sweep.zarr"


def sweep_read(path):
    found = Sweep.load(path)
    values = {name: each.tobytes() for name, each in found.measures.items()}
    axes = tuple(axis.tobytes() for axis in found.axes)
    return (
        values,
        found.points.tobytes(),
        axes,
        found.errors,
        found.names,
        found.units,
        found.measure_units,
        found.duration,
        found.accuracy,
        found.title,
    )


def map_file(folder):
    plant = compose(wells.JANSEN_2, BitRock())
    over = {"top.torque": (8e3, 20e3), "bit.weight": (60e3, 90e3)}
    return severity_map(plant, over, shape=(3, 3), duration=20.0).save(folder / "map.npz")


def map_read(path):
    found = SeverityMap.load(path)
    branches = [{name: value.tobytes() for name, value in vars(each).items()} for each in (found.smooth, found.sticking)]
    return branches, [axis.tobytes() for axis in found.axes], {name: each.tobytes() for name, each in found.borders.items()}, str(found)


def mat_file(folder):
    time = np.linspace(0.0, 10.0, 200)
    savemat(folder / "rig.mat", {"time": time, "block.speed": np.sin(time), "block.position": np.cos(time)}, do_compression=True)
    return folder / "rig.mat"


def mat_read(path):
    found = Recording.of(path, BELT)
    return found.time.tobytes(), {name: each.tobytes() for name, each in found.signals.items()}


def journal_file(folder):
    journal = Journal(folder / "journal", ARGUMENTS)
    draw = random.Random(1)
    for _ in range(20):
        journal.add((draw.random(), draw.random()), {"values": [[draw.random()]], "failures": []})
    return folder / "journal"


def journal_read(path):
    return Journal(path, ARGUMENTS).known


KINDS = {
    "run": (run_file, run_read), "sweep": (sweep_file, sweep_read), "store": (store_file, sweep_read), "map": (map_file, map_read),
    "MAT": (mat_file, mat_read), "journal": (journal_file, journal_read),
}  # fmt: skip


def damaged(content, draw):
    """Bytes that are cut, flipped in one bit, overwritten by zeros or noise, doubled or gone."""
    at = draw.randrange(len(content)) if content else 0
    length = draw.choice((1, 4, 64, 512))
    how = draw.randrange(7)
    if how == 0:
        return content[:at]
    if how in (1, 2) and content:
        return content[:at] + bytes([content[at] ^ 1 << draw.randrange(8)]) + content[at + 1 :]
    if how == 3:
        return content[:at] + bytes(len(content[at : at + length])) + content[at + length :]
    if how == 4:
        return content[:at] + draw.randbytes(len(content[at : at + length])) + content[at + length :]
    if how == 5:
        return content[:at] + content[at : at + length] + content[at:]
    return content[:at] + content[at + length :]


def tried(kind, folder, copies, seed):
    """Read so many damaged copies. Returns how many were errors, and how many the same data."""
    write, read = KINDS[kind]
    (folder / "whole").mkdir()
    whole = write(folder / "whole")
    expected, draw, refused = read(whole), random.Random(seed), 0
    for number in range(copies):
        copy = folder / f"{number}" / whole.name
        copy.parent.mkdir()
        if whole.is_dir():
            shutil.copytree(whole, copy)
            victim = draw.choice(sorted(path for path in copy.rglob("*") if path.is_file()))
        else:
            victim = shutil.copy(whole, copy)
        before = victim.read_bytes()
        if whole.is_dir() and draw.randrange(8) == 0:
            victim.unlink()
        else:
            victim.write_bytes(damaged(before, draw))
        try:
            found = read(copy)
        except SceneError as error:
            refused += 1
            assert str(copy) in str(error), (number, error)
        else:
            if kind == "journal":  # a line that was being written when the process was killed is dropped
                assert (
                    found.items() <= expected.items()
                    and len(found) >= sum(line in before.splitlines() for line in victim.read_bytes().splitlines()) - 2
                )
            else:
                assert found == expected, number
        shutil.rmtree(copy.parent)
    return refused, copies - refused


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_are_refused_by_name_or_hold_the_same(kind, tmp_path):
    if kind == "store":
        pytest.importorskip("zarr")
    refused, _ = tried(kind, tmp_path, 40, seed=3)
    assert refused > 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_three_hundred_damaged_files_are_refused_by_name_or_hold_the_same(kind, tmp_path):
    if kind == "store":
        pytest.importorskip("zarr")
    print(json.dumps({kind: tried(kind, tmp_path, 300, seed=4)}))


def test_a_store_without_a_chunk_of_its_axis_is_refused_and_not_filled_in(tmp_path):
    pytest.importorskip("zarr")
    store = store_file(tmp_path)
    (store / "block.mass" / "c" / "0").unlink()
    with pytest.raises(SceneError, match="`.*block.mass/c/0` of the sweep is missing, and with it what was varied"):
        Sweep.load(store)


def test_a_measure_that_is_nan_everywhere_is_found_again(tmp_path):
    pytest.importorskip("zarr")
    found = sweep(BELT, {"block.mass": [1.0, 2.0]}, duration=5.0, out=tmp_path / "out")
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
        sweep(BELT, {"block.mass": [1.0]}, duration=1.0, out=old)
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
