"""A failure at any file operation of a command leaves the old result or the new one, whole, and the same call goes on to the same end."""

from __future__ import annotations

import builtins
import contextlib
import csv
import errno
import io
import json
import os
import random
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from toolbox.commands import figures
from toolbox.commands.command_line import main
from toolbox.files.atomic import _exchanged
from toolbox.files.origin import ORIGIN
from toolbox.onsets import verdicts
from toolbox.sweeps import Sweep

BELT = 'title = "TITLE"\nduration = 40\n[[plant]]\npart = "BlockOnBelt"\n[[controllers]]\nlabel = "one"\n'
RIG = """
title = "rig"
duration = 60
[verdict]
after = "30 s"
[inputs]
"top.reference" = 9.0
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
[[controllers]]
label = "stiff PI"
law = "StiffPI"
"""
RIG = RIG.replace('[inputs]\n"top.reference" = 9.0\n', "")

OPERATIONS = ("replace", "rename", "open", "mkdir", "rmdir", "unlink", "remove", "fsync")
KINDS = ("refused", "interrupted before", "interrupted after")


class Faults:
    """File operations below a folder, counted; the one of number `at` fails."""

    def __init__(self, patch, folder, at=-1, kind="refused"):
        self.folder, self.at, self.kind, self.count = str(folder), at, kind, 0
        for name in OPERATIONS:
            patch.setattr(os, name, self.counted(getattr(os, name), name))
        for module in (builtins, io):
            patch.setattr(module, "open", self.counted(module.open, "write"))

    def concerns(self, name, arguments, named):
        if name == "write" and not set(str(arguments[1] if len(arguments) > 1 else named.get("mode", "r"))) & set("wax+"):
            return False
        if name in ("fsync", "write") and isinstance(arguments[0], int):
            return name == "fsync"
        return self.folder in os.fsdecode(arguments[0]) or "dir_fd" in named

    def counted(self, operation, name):
        def called(*arguments, **named):
            if not self.concerns(name, arguments, named):
                return operation(*arguments, **named)
            number, self.count = self.count, self.count + 1
            main_thread = threading.current_thread() is threading.main_thread()
            if number == self.at and self.kind == "refused":
                raise OSError(errno.EIO, os.strerror(errno.EIO), str(arguments[0]))
            if number == self.at and self.kind == "interrupted before" and main_thread:
                raise KeyboardInterrupt
            result = operation(*arguments, **named)
            if number == self.at and self.kind == "interrupted after" and main_thread:
                if name in ("open", "write"):  # nobody has it yet who could close it
                    os.close(result) if name == "open" else result.close()
                raise KeyboardInterrupt
            return result

        return called


def attempt(folder, monkeypatch, arguments, at=-1, kind="refused"):
    """(exit code, operations) of a command of which one file operation fails."""
    with monkeypatch.context() as patch:
        faults = Faults(patch, folder, at, kind)
        code = main([str(word) for word in arguments])
    return code, faults.count


def content(folder):
    """{name: bytes} of what is the same for the same call: all but its date and the time that it took; None where there is no folder."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != ORIGIN]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files} if folder.exists() else None


@pytest.fixture
def quick(monkeypatch):
    """Runs that are there already, and figures as empty files: what is tried here is how they are written."""
    runs = {}
    verdict_row = verdicts.verdict_row

    def known(scene, label, stem="", metrics=(), loop=None):
        if scene.title not in runs:
            runs[scene.title] = verdict_row(scene, label, stem)
        return runs[scene.title]

    monkeypatch.setattr(verdicts, "verdict_row", known)
    monkeypatch.setattr(figures, "draw", lambda scene, label, run, *paths: [path.touch() for path in paths])
    for name in ("draw_comparison", "draw_found"):
        monkeypatch.setattr(figures, name, lambda *arguments: arguments[-1].touch())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("exists", "exchange"),
    [(False, True), (True, True), (True, False)],  # nothing is exchanged where nothing is
    ids=["new", "in place of an earlier one", "in place of an earlier one, no exchange of folders"],
)
def test_a_study_with_a_failing_file_operation_leaves_the_old_or_the_new(tmp_path, monkeypatch, quick, capsys, kind, exists, exchange):
    monkeypatch.setattr("toolbox.files.atomic._exchanged", (lambda *paths: False) if not exchange else _exchanged)
    scene, out = tmp_path / "belt.toml", tmp_path / "above" / "out"

    def studied(title, at=-1):
        scene.write_text(BELT.replace("TITLE", title))
        return attempt(tmp_path / "above", monkeypatch, ["study", scene, "--out", out], at, kind)

    (tmp_path / "above").mkdir()
    studied("old")
    old = {**content(out), "mine.txt": b"mine"} if exists else None
    studied("new")
    new = {**content(out), "mine.txt": b"mine"} if exists else content(out)
    at, count, failed = -1, 0, 0
    while count > at:  # the operation of this number came, so that there may be another
        at += 1
        shutil.rmtree(tmp_path / "above")
        (out if exists else out.parent).mkdir(parents=True)
        for name, text in (old or {}).items():
            (out / name).write_bytes(text)
        code, count = studied("new", at)
        assert code in (0, 1, 2, 130)
        failed += code != 0
        assert content(out) in ([new] if code == 0 else [old, new]), at
        assert not list(out.parent.rglob(".*")), at
    assert at >= 10 and failed >= 5


def numbers(store):
    """What a finished sweep holds, without the time that it took."""
    found = Sweep.load(store)
    return {name: values.tobytes() for name, values in found.metrics.items()}, found.points.tobytes(), found.failures


def rows(path):
    with path.open(newline="") as file:
        return list(csv.reader(file))


def sweep_arguments(folder):
    (folder / "belt.toml").write_text(BELT.replace("TITLE", "belt"))
    return ["sweep", folder / "belt.toml", "--range", "block.mass=0.5:2:4", "--metric", "severity", "--out", folder / "out"]


def tune_arguments(folder):
    (folder / "rig.toml").write_text(RIG)
    return [
        "tune", folder / "rig.toml", "--controller", "stiff PI", "--range", "stiffpi.integral=500:5000", "--objective", "severity", "--runs", "10",
        "--checkpoint", folder / "journal", "--out", folder / "out",
    ]  # fmt: skip


def map_arguments(folder):
    (folder / "rig.toml").write_text(RIG.replace("duration = 60", "duration = 20").replace("30 s", "10 s"))
    return [
        "map",
        folder / "rig.toml",
        "--range",
        "top.reference=4:12",
        "--range",
        "bit.weight=60kN:100kN",
        "--shape",
        "3x3",
        "--out",
        folder / "out",
    ]


def swept(folder):
    return numbers(folder / "out" / "01_one" / "sweep.zarr"), rows(folder / "out" / "01_one" / "sweep.csv")


def tuned(folder):
    texts = content(folder / "out")
    texts["tune.txt"] = b"\n".join(
        line for line in texts["tune.txt"].splitlines() if b"simulated" not in line and b"checkpoint" not in line
    )
    with np.load(folder / "out" / "tune.npz") as data:
        kept = json.loads(str(data["result"]))
    del kept["fields"]["simulated_runs"]  # how many runs were this call's, and not the journal's
    texts["tune.npz"] = kept
    return texts


def mapped(folder):
    with np.load(folder / "out" / "01_stiff_pi" / "map.npz") as data:
        return {name: data[name].tobytes() for name in data.files}


CASES = {"sweep": (sweep_arguments, swept), "tune": (tune_arguments, tuned), "map": (map_arguments, mapped)}


def tried(command, tmp_path, monkeypatch, every):
    """Let every so many-th file operation of a command fail, in each way, and call it again. Returns how many failed."""
    arguments, result = CASES[command]
    (tmp_path / "whole").mkdir()
    whole_arguments = arguments(tmp_path / "whole")
    code, total = attempt(tmp_path / "whole", monkeypatch, whole_arguments)
    assert code == 0
    expected, failed = result(tmp_path / "whole"), 0
    for kind in KINDS:
        for at in range(KINDS.index(kind), total, every):
            folder = tmp_path / f"{kind.replace(' ', '_')}_{at}"
            folder.mkdir()
            code, _ = attempt(folder, monkeypatch, arguments(folder), at, kind)
            failed += code != 0
            assert code in (0, 1, 2, 130)
            if code == 0:
                assert result(folder) == expected
            assert main([str(word) for word in arguments(folder)]) == 0, (kind, at)
            assert result(folder) == expected, (kind, at)
            assert not list(folder.rglob(".*")), (kind, at)
    return failed


@pytest.mark.filterwarnings("ignore:coroutine:RuntimeWarning")  # which zarr leaves where an interrupt is put into it
@pytest.mark.timeout(7200)
@pytest.mark.parametrize(("command", "every"), [("sweep", 29), ("tune", 13), pytest.param("map", 97, marks=pytest.mark.slow)])
def test_the_same_call_goes_on_after_a_failing_file_operation(command, every, tmp_path, monkeypatch, quick, exhaustive):
    pytest.importorskip("zarr")
    assert tried(command, tmp_path, monkeypatch, 1 if exhaustive else every) >= 3


def killed(command, tmp_path, times, seed):
    """Kill a command at random instants, again and again, until it ends, so many times; the results must be those of one call. Returns how many died."""
    arguments, result = CASES[command]
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")]), "MPLBACKEND": "Agg"}

    def started(folder):
        words = [str(word) for word in arguments(folder)]
        return subprocess.Popen([sys.executable, "-m", "toolbox", *words], env=environment, stdout=subprocess.DEVNULL)

    (tmp_path / "whole").mkdir()
    began = time.monotonic()
    assert started(tmp_path / "whole").wait() == 0
    length = time.monotonic() - began
    expected, draw, died, folder, count = result(tmp_path / "whole"), random.Random(seed), 0, None, 0
    while died < times:
        if folder is None:
            count += 1
            (folder := tmp_path / f"after_{count}").mkdir()
        process = started(folder)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(draw.uniform(0.3, 1.0) * length)
        process.kill()
        died += process.wait() != 0
        if process.returncode == 0:
            assert result(folder) == expected
            assert all(path.suffix == ".part" for path in folder.rglob(".*"))
            folder = None
    if folder is not None:
        assert started(folder).wait() == 0
        assert result(folder) == expected
    return died


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("command", CASES)
def test_a_command_killed_many_times_goes_on_to_the_same_end(command, tmp_path, exhaustive):
    pytest.importorskip("zarr")
    print(json.dumps({command: killed(command, tmp_path, 34 if exhaustive else 2, seed=2)}))
