"""Does every file that is damaged give the same, or an error that says so, and never end, fill or stop the process that reads it?

A file of each kind is damaged: cut, bits flipped, bytes overwritten, doubled, left out; and, where it holds arrays, the archive stays sound, but an array has
another shape or type, is missing, or a note says something else. Each copy is read, and what was read is used, in a child process of its own, forked from
one that has all modules. Its death, time and memory are looked at. What comes of it:

    same      what the whole file gives
    other     something else that can be used: what the damaged file says, where it carries no checksum, or where a sound archive holds other numbers
    refused   a SceneError that names the file

Everything else is a fault: another exception, a death, more than 10 s or 500 MB, `other` after a damage that a checksum must find, and `other` of a table or
a matrix in text where another reader, of a few lines, finds something else.

    python -m studies damaged_files [--mutations 295] [--seed 1] [--kind run]

Without arguments 5015 files are tried, 295 of each of 17 kinds.
"""

from __future__ import annotations

import argparse
import contextlib
import gzip
import importlib
import json
import os
import pickle
import random
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time as clock
import traceback
import zipfile
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from models import BitRock, BlockOnBelt, ElasticBody, ReducedBody, wells
from studies.command_line import parser_of
from toolbox import Scene, SceneError, Trajectory, compose, severity_map, simulate, sweep
from toolbox.calibration.recording import Recording
from toolbox.files.journal import Journal
from toolbox.onsets import SeverityMap
from toolbox.sweeps import Sweep

SECONDS, MEGABYTES = 10.0, 500.0
"""What the reading of one file may take."""

MODULE = "studies.benchmarks.damaged_files"
"""What the child runs."""

BELT = compose(BlockOnBelt())
ARGUMENTS = {"plant": "one", "law": "two"}

SCENE = """
title = "Two inertias"
duration = "60 s"
reference = "95 rpm"
[verdict]
after = "40 s"
[inputs]
"bit.weight" = { table = { times = [0, 10], values = ["90 kN", "97 kN"] } }
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
[[controllers]]
label = "stiff PI"
law = "StiffPI"
[[controllers]]
label = "soft torque, 100 Hz"
law = "SoftTorque"
sample_time = "10 ms"
"""


# ---------------------------------------------------------------------------------------------------------------------- writing and reading each kind
def run_file(folder: Path) -> Path:
    """A run of a block on a belt."""
    return simulate(BELT, 10.0, output_times=np.linspace(0.0, 10.0, 30)).save(folder / "run.npz")


def run_read(path: Path) -> Any:
    """All that a run says."""
    run = Trajectory.load(path)
    used = [
        str(run),
        run.time_in("belt", str(run.modes["belt"][0])) if run.time.size else 0.0,
        *(run.at(np.linspace(0.0, run.end, 7))[name].sum() for name in run.names),
    ]
    assert len(used) == 2 + len(run.names)
    values = {name: run[name].tobytes() for name in run.names}
    return run.time.tobytes(), values, run.events, {n: w.tolist() for n, w in run.modes.items()}, run.end


def sweep_file(folder: Path) -> Path:
    """A sweep in an archive."""
    return sweep(BELT, {"block.mass": [0.5, 1.0, 2.0], "belt.friction.decay": [2.0, 3.0]}, duration=20.0).save(folder / "sweep.npz")


def store_file(folder: Path) -> Path:
    """A sweep in a store of zarr."""
    sweep(BELT, {"block.mass": [0.5, 1.0, 2.0], "belt.friction.decay": [2.0, 3.0]}, duration=20.0, checkpoint=folder / "sweep.zarr")
    return folder / "sweep.zarr"


def sweep_read(path: Path) -> Any:
    """All that a sweep says."""
    found = Sweep.load(path)
    assert str(found)
    values = {name: each.tobytes() for name, each in found.metrics.items()}
    axes = tuple(axis.tobytes() for axis in found.axes)
    words = found.failures, found.names, found.units, found.metric_units, found.duration, found.accuracy, found.title
    return values, found.points.tobytes(), axes, *words


def map_file(folder: Path) -> Path:
    """A map of severity."""
    plant = compose(wells.JANSEN_2, BitRock())
    over = {"top.torque": (8e3, 20e3), "bit.weight": (60e3, 90e3)}
    return severity_map(plant, over, shape=(3, 3)).save(folder / "map.npz")


def map_read(path: Path) -> Any:
    """All that a map says."""
    found = SeverityMap.load(path)
    branches = [{name: value.tobytes() for name, value in vars(each).items()} for each in (found.smooth, found.sticking)]
    regions = {name: each.tobytes() for name, each in found.regions.items()}
    return (
        branches,
        [axis.tobytes() for axis in found.axes],
        {name: each.tobytes() for name, each in found.borders.items()},
        regions,
        str(found),
    )


def body_file(folder: Path) -> Path:
    """A reduced body."""
    frequencies, errors = np.array([1.0, 2.0]), np.array([0.0, 1e-3])
    return ReducedBody(("a", "b"), np.diag([1.0, 2.0, 3.0]), np.eye(3) * 0.1, np.eye(3), 3.0, frequencies, errors, 1).save(
        folder / "body.npz"
    )


def body_read(path: Path) -> Any:
    """All that a body says."""
    body = ReducedBody.load(path)
    arrays = [np.asarray(each).tobytes() for each in (body.mass, body.damping, body.stiffness, body.frequencies, body.frequency_errors)]
    return (
        body.ports,
        arrays,
        body.cutoff_frequency,
        body.rigid_body_modes,
        body.contact_positions,
        body.contact_areas,
        [body.index(port) for port in body.ports],
    )


def mat_file(folder: Path) -> Path:
    """A packed log."""
    return _log(folder, True)


def _log(folder: Path, packed: bool) -> Path:
    from scipy.io import savemat

    time = np.linspace(0.0, 10.0, 200)
    savemat(folder / "rig.mat", {"time": time, "block.speed": np.sin(time), "block.position": np.cos(time)}, do_compression=packed)
    return folder / "rig.mat"


def mat_read(path: Path) -> Any:
    """All that a recording says."""
    found = Recording.of(path, BELT)
    return found.time.tobytes(), {name: each.tobytes() for name, each in found.signals.items()}


def csv_file(folder: Path) -> Path:
    """A log as a table."""
    rows = [f"{k / 10:.1f},{np.sin(k / 10):.6f},{np.cos(k / 10):.6f}" for k in range(100)]
    (folder / "rig.csv").write_text("\n".join(["# made of sines", "time [s],block.speed [m/s],block.position [mm]", *rows]) + "\n")
    return folder / "rig.csv"


LONG = 9000
"""Rows of a long log."""


def _long(rows: int = LONG) -> dict[str, np.ndarray]:
    time = np.arange(rows) / 10
    return {"time [s]": time, "block.speed [m/s]": np.sin(time).round(6), "block.position [mm]": np.cos(time).round(6)}


def long_csv_file(folder: Path) -> Path:
    """A log as a table of more than 128 kB, beyond which the library takes no cell."""
    held = _long()
    rows = [",".join(f"{value:.6f}" for value in row) for row in zip(*held.values(), strict=True)]
    (folder / "long.csv").write_text("\n".join([",".join(held), *rows]) + "\n")
    assert (folder / "long.csv").stat().st_size > 131_072
    return folder / "long.csv"


def sheet_file(folder: Path) -> Path:
    """A log as a sheet."""
    from pandas import DataFrame

    DataFrame(_long(200)).to_excel(folder / "rig.xlsx", index=False)
    return folder / "rig.xlsx"


def parquet_file(folder: Path) -> Path:
    """A log as parquet."""
    from pandas import DataFrame

    DataFrame(_long(2000)).to_parquet(folder / "rig.parquet")
    return folder / "rig.parquet"


def hdf_file(folder: Path) -> Path:
    """A log as a MAT file of version 7.3, which is one of HDF5."""
    import h5py

    with h5py.File(folder / "rig73.mat", "w", userblock_size=512) as file:
        for name, values in _long(500).items():
            data = file.create_dataset(name.partition(" ")[0], data=values.reshape(1, -1), compression="gzip", fletcher32=True)
            data.attrs["MATLAB_class"] = np.bytes_("double")
    with (folder / "rig73.mat").open("r+b") as both:
        both.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return folder / "rig73.mat"


def scene_file(folder: Path) -> Path:
    """A scene in TOML."""
    (folder / "scene.toml").write_text(SCENE)
    return folder / "scene.toml"


def scene_read(path: Path) -> Any:
    """All keys of a scene, which it has again when it is saved and loaded."""
    scene = Scene.load(path)
    again = Scene.load(scene.save(path.with_name("again.toml")))
    assert repr(again.settings()) == repr(scene.settings())
    return repr(scene.settings())


def journal_file(folder: Path) -> Path:
    """A journal of a search."""
    journal = Journal(folder / "journal", ARGUMENTS)
    draw = random.Random(1)
    for _ in range(20):
        journal.add((draw.random(), draw.random()), {"values": [[draw.random()]], "failures": [""]})
    return folder / "journal"


def journal_read(path: Path) -> Any:
    """What a journal knows."""
    return Journal(path, ARGUMENTS).known


def mtx_file(folder: Path) -> Path:
    """A sparse matrix as text."""
    _write_matrix(folder / "mass.mtx")
    return folder / "mass.mtx"


def _write_matrix(path: Path) -> None:
    from scipy.io import mmwrite
    from scipy.sparse import diags_array

    mmwrite(path, diags_array([np.full(19, -0.1), np.arange(1.0, 21.0), np.full(19, -0.1)], offsets=[-1, 0, 1]), symmetry="symmetric")


def packed_mtx_file(folder: Path) -> Path:
    """A sparse matrix as packed text."""
    _write_matrix(folder / "plain.mtx")
    (folder / "mass.mtx.gz").write_bytes(gzip.compress((folder / "plain.mtx").read_bytes()))
    return folder / "mass.mtx.gz"


def sparse_mat_file(folder: Path) -> Path:
    """A sparse matrix in a MAT file without checksums."""
    from scipy.io import savemat
    from scipy.sparse import diags_array

    savemat(
        folder / "mass.mat", {"M": diags_array([np.full(19, -0.1), np.arange(1.0, 21.0), np.full(19, -0.1)], offsets=[-1, 0, 1]).tocsc()}
    )
    return folder / "mass.mat"


def matrix_read(path: Path) -> Any:
    """The mass of a body of that file."""
    return ElasticBody.from_files(path, path).mass.toarray().tobytes()


def csv_said(path: Path) -> Any:
    """What the rows of the table say, read in another way; nan for a cell that is no number."""

    def number(cell: str) -> float:
        try:
            return float(cell)
        except ValueError:
            return np.nan

    held = path.read_bytes()
    try:
        text = held.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = held.decode("cp1252", errors="replace")
    lines = [line for line in text.splitlines() if line.strip(" \t,;") and not line.lstrip().startswith("#")]
    while len(lines) > 1 and max(map(lines[0].count, ",;\t")) == 0:  # a broken remark above the headings
        lines.pop(0)
    headings, *rows = ([cell.strip() for cell in line.split(max(",;\t", key=lines[0].count))] for line in lines)
    rows = [row for row in rows if len(row) == len(headings)]
    found = {}
    for heading, column in zip(headings, np.array([[number(cell) for cell in row] for row in rows]).T, strict=True):
        name, _, unit = heading.rstrip("] ").partition("[")
        found[name.strip().casefold()] = column * {"m/s": 1.0, "mm": 1e-3, "m": 1.0, "s": 1.0}.get(unit.strip(), np.nan)
    return found.pop("time"), found


def mtx_said(path: Path) -> Any:
    """What the text of a matrix says, read in another way."""
    head, *lines = path.read_text("latin-1").split("\n")
    lines = [line for line in lines if line.strip() and not line.lstrip().startswith("%")]
    found = np.zeros([int(word) for word in lines[0].split()[:2]])
    for line in lines[1:]:
        row, column, value = map(float, line.split())
        found[int(row) - 1, int(column) - 1] += value
        if row != column and "general" not in head.lower():
            found[int(column) - 1, int(row) - 1] += value
    return found.tobytes()


def same_table(found: Any, said: Any) -> bool:
    """Whether every sample that a recording holds stands in the table at its time; what it left out may be any."""
    there, columns = said
    time, kept = np.frombuffer(found[0]), {name: np.frombuffer(values) for name, values in found[1].items()}

    def stands(t: float, k: int) -> bool:
        rows = np.abs(there - t) < 1e-9  # several where a time is repeated
        return all(np.isnan(v[k]) or np.isclose(columns[name][rows], v[k], rtol=1e-12, atol=1e-300).any() for name, v in kept.items())

    begins = there[np.isfinite(there)]  # one of them was the first that was kept
    return any(all(stands(begin + t, k) for k, t in enumerate(time)) for begin in begins)


SAID: dict[str, Callable[[Path, Any], bool]] = {
    "CSV": lambda path, found: same_table(found, csv_said(path)),
    "mtx": lambda path, found: bool(found == mtx_said(path)),
}
"""{kind of plain text: whether what was read is what stands there}."""

Read = Callable[[Path], Any]
KINDS: dict[str, tuple[Callable[[Path], Path], Read, bool]] = {
    "run": (run_file, run_read, True), "sweep": (sweep_file, sweep_read, True), "store": (store_file, sweep_read, True), "map": (map_file, map_read, True),
    "body": (body_file, body_read, True), "MAT": (mat_file, mat_read, True), "journal": (journal_file, journal_read, True),
    "CSV": (csv_file, mat_read, False), "TOML": (scene_file, scene_read, False), "mtx": (mtx_file, matrix_read, False),
    "mtx.gz": (packed_mtx_file, matrix_read, True), "sparse MAT": (sparse_mat_file, matrix_read, False),
    "long CSV": (long_csv_file, mat_read, False), "xlsx": (sheet_file, mat_read, False), "parquet": (parquet_file, mat_read, False),
    "MAT 7.3": (hdf_file, mat_read, False),
    "plain MAT": (lambda folder: _log(folder, False), mat_read, False),
}  # fmt: skip
"""{kind: how it is written, how it is read, whether it carries checksums}."""


# ------------------------------------------------------------------------------------------------------------------------------------------- damage
def damaged(content: bytes, draw: random.Random) -> bytes:
    """Bytes that are cut, flipped in one bit, overwritten by zeros or noise, doubled or gone."""
    at = draw.randrange(len(content)) if content else 0
    length = draw.choice((1, 4, 64, 512))
    how = draw.randrange(8)
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
    if how == 6:
        return content[:at] + draw.choice((bytes(length), b"9" * min(length, 40), b"-1", b"nan", b"[" * length, b"\n")) + content[at:]
    return content[:at] + content[at + length :]


def rewritten(path: Path, draw: random.Random) -> None:
    """Leave an npz file sound, but for one of its arrays: of another shape or type, or missing, or with other notes."""
    with np.load(path) as data:
        held = {name: data[name] for name in data.files}
    name = draw.choice(sorted(held))
    array = held[name]
    if array.ndim == 0 and array.dtype.kind == "U":
        notes = json.loads(str(array))
        key = draw.choice(sorted(notes))
        notes[key] = draw.choice((None, 3, "text", [], {}, [1, 2], {"a": 1}, -1e300, [["smooth", 99, 99, "x"]], {"99": "x"}))
        if draw.randrange(5) == 0:
            del notes[key]
        held[name] = np.array(json.dumps(notes))
    else:
        flat = np.ravel(array)
        changes: list[Callable[[], Any]] = [
            lambda: flat[:-1], lambda: np.append(flat, flat[:1]), lambda: array[..., None], lambda: np.zeros((0, *array.shape[1:]), array.dtype),
            lambda: array.T, lambda: np.array(["x"] * flat.size).reshape(array.shape), lambda: np.zeros(array.shape, complex), lambda: np.array(3.0),
            lambda: np.full(array.shape, 99, array.dtype) if array.dtype.kind in "if" else flat[:1], lambda: flat.reshape(1, -1),
            lambda: np.full(array.shape, np.nan), lambda: array[::-1], lambda: np.zeros(array.shape, np.uint8),
        ]  # fmt: skip
        try:
            held[name] = draw.choice(changes)()
        except (ValueError, IndexError):  # a scalar has no ends
            del held[name]
    if draw.randrange(12) == 0:
        held.pop(name, None)
    np.savez_compressed(path, **held)


def repacked(path: Path, draw: random.Random) -> None:
    """Leave the archive of a sheet sound, but for the text of one of its parts, or without it."""
    with zipfile.ZipFile(path) as archive:
        held = {name: archive.read(name) for name in archive.namelist()}
    name = draw.choice(sorted(held))
    held[name] = damaged(held[name], draw)
    if draw.randrange(8) == 0:
        del held[name]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in held.items():
            archive.writestr(name, content)


def mutated(whole: Path, copy: Path, draw: random.Random) -> bool:
    """Make a damaged copy of a file or folder. Returns whether the damage is one that a checksum must find."""
    copy.parent.mkdir()
    victim = copy
    if whole.is_dir():
        shutil.copytree(whole, copy)
        victim = draw.choice(sorted(path for path in copy.rglob("*") if path.is_file()))
        if draw.randrange(8) == 0:
            victim.unlink()
            return True
    else:
        shutil.copy(whole, copy)
        if whole.suffix == ".npz" and draw.randrange(2) == 0:
            rewritten(copy, draw)
            return False
        if whole.suffix == ".xlsx" and draw.randrange(2) == 0:
            repacked(copy, draw)
            return False
    content = victim.read_bytes()
    for _ in range(draw.choice((1, 1, 1, 3))):
        content = damaged(content, draw)
    victim.write_bytes(content)
    return True


# ------------------------------------------------------------------------------------------------------------------------------------------ children
class Reader:
    """A child process that reads files one after the other; a new one takes the place of one that died, hangs or has grown."""

    def __init__(self) -> None:
        self.child: subprocess.Popen[str] | None = None

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *failure: object) -> None:
        if self.child is not None:
            self.child.kill()
            self.child.communicate()
            self.child = None

    def display_units(self, kind: str, path: Path, whole: Path) -> tuple[str, str]:
        """(what came of reading a file: same, other, refused or a fault; words)."""
        if self.child is None:
            root = Path(__file__).parents[2]
            paths = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
            self.child = subprocess.Popen(
                [sys.executable, "-m", MODULE, "--child"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1,
                env={**os.environ, "PYTHONPATH": paths},
            )  # fmt: skip
            assert self.child.stdout is not None
            self.child.stdout.readline()  # it is ready
        assert self.child.stdin is not None and self.child.stdout is not None
        self.child.stdin.write(json.dumps([kind, str(path), str(whole)]) + "\n")
        self.child.stdin.flush()
        ready, _, _ = select.select([self.child.stdout], [], [], 6 * SECONDS)
        answer = self.child.stdout.readline() if ready else ""
        if not answer:
            words = f"killed by signal {-self.child.wait()}" if ready else "does not end"
            self.__exit__()
            return "fault", words
        came, words, seconds, megabytes = json.loads(answer)
        if seconds > SECONDS or megabytes > MEGABYTES:
            self.__exit__()
            return "fault", f"{came} took {seconds:.1f} s of processor time and {megabytes:.0f} MB"
        return came, words


def child() -> None:
    """Read the files that come in on stdin, each in a forked child, and answer by a line: what came of it, words, seconds of processor time, megabytes."""
    answers, sys.stdout = sys.stdout, sys.stderr
    for name in ("h5py", "openpyxl", "pandas", "pyarrow.parquet", "pymatreader", "scipy.io", "zarr"):
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    expected: dict[str, Any] = {}
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        kind, path, whole = json.loads(line)
        if kind not in expected:
            expected[kind] = _forked(partial(_compared, KINDS[kind][1], Path(whole)))
        print(json.dumps(_forked(partial(_measured, kind, Path(path), expected[kind]))), file=answers, flush=True)


def _forked(work: Callable[[], Any]) -> Any:
    """What a function returns in a child process that is killed where it does not end; for one that dies the fault."""
    ours, theirs = os.pipe()
    number = os.fork()
    if number == 0:
        code = 1
        try:
            os.close(ours)
            with os.fdopen(theirs, "wb") as file:
                file.write(pickle.dumps(work()))
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
    os.close(theirs)
    with os.fdopen(ours, "rb") as file:
        ready, _, _ = select.select([file], [], [], 5 * SECONDS)
        if not ready:
            os.kill(number, signal.SIGKILL)
        found = file.read()
    code = os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])
    if not ready or code != 0:
        return "fault", "does not end" if not ready else f"killed by signal {-code}" if code < 0 else f"ended with {code}", 0.0, 0.0
    return pickle.loads(found)


def _compared(read: Read, path: Path) -> Any:
    """What a file gives, such that it can be compared in another process."""
    found = read(path)
    return found if isinstance(found, dict) else repr(found)


def _measured(kind: str, path: Path, expected: Any) -> tuple[str, str, float, float]:
    """(what came of reading a file, words, seconds of processor time, megabytes more than before); no more than twice the memory is given."""
    import resource

    held, before = _peak(anew=True), resource.getrusage(resource.RUSAGE_SELF)
    most = int(2 * MEGABYTES * 2**20) + 4096 * int(Path("/proc/self/statm").read_text().split()[0]) if sys.platform == "linux" else -1
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    came, words = _outcome(kind, path, expected)
    after = resource.getrusage(resource.RUSAGE_SELF)
    return came, words, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, _peak() - held


def _peak(anew: bool = False) -> float:
    """The most memory [MB] that the process has held, since it began or was asked `anew`: of the system's count for all, a child inherits its parent's."""
    try:
        if anew:
            Path("/proc/self/clear_refs").write_text("5")
        return float(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 1024
    except (OSError, IndexError):
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _outcome(kind: str, path: Path, expected: Any) -> tuple[str, str]:
    try:
        found = KINDS[kind][1](path)
    except SceneError as error:
        return ("refused", str(error)) if path.name in str(error) else ("fault", f"does not name the file: {error}")
    except BaseException as error:
        return "fault", f"{type(error).__name__}: {error}"
    if isinstance(found, dict):  # of a journal, a line that was being written when the process was killed is dropped
        return ("same", "") if found.items() <= expected.items() else ("other", "")
    if repr(found) == expected:
        return "same", ""
    return ("other", "") if SAID.get(kind, lambda path, found: True)(path, found) else ("fault", "is not what the file says")


def tried(kind: str, folder: Path, mutations: int, seed: int, reader: Reader) -> tuple[Counter[str], list[str]]:
    """(how often what came of so many damaged copies, the faults)."""
    write, _, checked = KINDS[kind]
    (folder / "whole").mkdir()
    whole = write(folder / "whole")
    kept = folder / "kept"
    kept.mkdir()
    intact = shutil.copytree(whole, kept / whole.name) if whole.is_dir() else Path(shutil.copy(whole, kept / whole.name))
    counts: Counter[str] = Counter()
    faults = []
    came, words = reader.display_units(kind, Path(intact), Path(intact))
    if came != "same":
        faults.append(f"{kind}: the whole file is not read: {came} {words}")
    for number in range(mutations):
        draw = random.Random(f"{kind} {seed} {number}")
        copy = folder / f"{number}" / whole.name
        must_be_found = mutated(whole, copy, draw) and checked
        came, words = reader.display_units(kind, copy, Path(intact))
        if came == "other" and must_be_found:
            came, words = "fault", "other data are taken for the same"
        counts[came] += 1
        if came == "fault":
            faults.append(f"{kind} {number} of seed {seed}: {words}")
        shutil.rmtree(copy.parent)
    return counts, faults


def main() -> int:
    """Try all kinds and print a table. Returns the exit code."""
    parser = parser_of(__doc__)
    parser.add_argument("--mutations", type=int, default=295)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", choices=tuple(KINDS), action="append")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        child()
        return 0
    began, all_faults = clock.perf_counter(), []
    print(f"{'kind':<12}{'same':>8}{'other':>8}{'refused':>9}{'faults':>8}")
    with Reader() as reader:
        for kind in given.kind or KINDS:
            with tempfile.TemporaryDirectory() as folder:
                counts, faults = tried(kind, Path(folder), given.mutations, given.seed, reader)
            print(f"{kind:<12}{counts['same']:>8}{counts['other']:>8}{counts['refused']:>9}{counts['fault']:>8}", flush=True)
            all_faults += faults
    print("\n".join([f"{clock.perf_counter() - began:.0f} s", *all_faults]))
    return 1 if all_faults else 0


if __name__ == "__main__":
    sys.exit(main())
