"""Ctrl-C at any instant of a command: 130, one line, nothing half-written, soon, also where Python loses the exception or cannot raise it."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.commands.conftest import BELT

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals")

ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])}
NOTHING = "stickslip: interrupted, and nothing was written."

COMMAND = """
import os, signal, sys, threading, time
from toolbox.commands import command_line, figures
from toolbox.onsets import verdicts

def interrupt():
    os.kill(os.getpid(), signal.SIGINT)

figures.draw = lambda scene, label, run, *paths: [path.touch() for path in paths]
figures.draw_comparison = lambda scene, runs, path: path.touch()
{patch}
sys.argv = ["stickslip", *sys.argv[1:]]
command_line.script()
"""

IN_A_CALLBACK = """
import ctypes
inner = verdicts.verdict_row
@ctypes.CFUNCTYPE(None)
def callback():  # what is raised in it, nobody catches
    interrupt()
    time.sleep(0.01)
def verdict_row(*arguments):
    callback()
    return inner(*arguments)
verdicts.verdict_row = verdict_row
"""

LOST = """
inner = verdicts.verdict_row
def verdict_row(*arguments):
    try:
        interrupt()
        time.sleep(0.01)
    except KeyboardInterrupt:
        pass
    return inner(*arguments)
verdicts.verdict_row = verdict_row
"""

IN_MACHINE_CODE = """
import hashlib
def verdict_row(*arguments):
    threading.Timer(0.1, interrupt).start()
    hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)
verdicts.verdict_row = verdict_row
"""

IN_A_HARD_FINALLY = """
def verdict_row(*arguments):
    try:
        interrupt()
        time.sleep(100)
    finally:
        time.sleep(100)
verdicts.verdict_row = verdict_row
"""

TWICE = """
def verdict_row(*arguments):
    try:
        interrupt()
        time.sleep(100)
    finally:
        interrupt()
        time.sleep(0.05)
verdicts.verdict_row = verdict_row
"""

WHILE_PLACING = """
inner = os.rename
def rename(*arguments):
    interrupt()
    time.sleep(0.01)
    return inner(*arguments)
os.rename = rename
"""


def started(tmp_path, *arguments, patch="", **options):
    (tmp_path / "belt.toml").write_text(BELT)
    program = [sys.executable, "-c", COMMAND.format(patch=patch), *map(str, arguments)]
    return subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, env=ENVIRONMENT, **options)


def ended(process, seconds=120):
    out, errors = process.communicate(timeout=seconds)
    return process.returncode, [line for line in errors.splitlines() if "once per machine" not in line], out


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The folder of a study that was not interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    assert ended(started(folder, "study", "belt.toml", "--out", folder / "out"))[0] == 0
    return folder / "out"


@pytest.mark.parametrize(
    ("patch", "exists"),  # only where nobody may clean up could earlier results be at risk
    [
        (IN_A_CALLBACK, False),
        (LOST, False),
        (IN_MACHINE_CODE, False),
        (IN_A_HARD_FINALLY, False),
        (IN_A_HARD_FINALLY, True),
        (TWICE, False),
    ],
    ids=[
        "in a callback of machine code",
        "caught by somebody",
        "in machine code",
        "before a long cleaning up",
        "beside earlier results",
        "twice",
    ],
)
def test_an_interrupt_ends_the_study_wherever_it_arrives(tmp_path, patch, exists, results):
    out = tmp_path / "out"
    (tmp_path / "belt.toml").write_text(BELT)
    if exists:
        shutil.copytree(results, out)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    began = time.monotonic()
    assert ended(started(tmp_path, "study", "belt.toml", "--out", out, patch=patch))[:2] == (130, [NOTHING])
    assert time.monotonic() - began < 60.0  # and not the 100 s of what holds it up
    after = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert after == (before if exists else {tmp_path / "belt.toml": BELT.encode()})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["belt.toml", *(["out"] if exists else [])]


WHILE_IMPORTING = """
import os, signal, sys, time

class Interrupts:
    def find_spec(self, name, *arguments):
        if name == "toolbox.commands.listing":  # long before its first line the command is at work
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(10)

sys.meta_path.insert(0, Interrupts())
from toolbox.__main__ import script
script()
"""


def test_an_interrupt_while_the_command_is_imported_ends_it_with_the_same_words(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", WHILE_IMPORTING, "list"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, env=ENVIRONMENT
    )  # fmt: skip
    assert ended(process)[:2] == (130, [NOTHING])


def test_an_interrupt_while_the_result_takes_its_place_comes_too_late(tmp_path):
    out = tmp_path / "out"
    for _ in range(2):  # in a new folder, and in one with results
        assert ended(started(tmp_path, "study", "belt.toml", "--out", out, patch=WHILE_PLACING))[:2] == (0, [])
        assert len(list(out.iterdir())) == 11 and all(not path.name.startswith(".") for path in out.iterdir())


TUNE = (
    "tune",
    "rig.toml",
    "again.toml",
    "--controller",
    "pi",
    "--range",
    "pi.integral=100:4000",
    "--objective",
    "severity",
    "--processes",
    "2",
    "--out",
    "out",
)
RIG = """
title = "rig"
duration = 20
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
[[controllers]]
label = "pi"
law = "PI"
reference = 9.0
"""
ASLEEP = """
import pathlib, os, time
def trial_objectives(*arguments, **named):
    pathlib.Path(f"at-work-{os.getpid()}").touch()
    time.sleep(1000)
"""
WORKERS_ASLEEP = """
import multiprocessing.process
import asleep
from toolbox.tuning import search
search.trial_objectives = asleep.trial_objectives
inner = multiprocessing.process.BaseProcess.start
def start(self):
    inner(self)
    open(f"begun-{self.pid}", "w").close()
multiprocessing.process.BaseProcess.start = start
"""


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("mark", ["begun", "at-work"], ids=["as workers start", "as workers work"])
@pytest.mark.parametrize("how", ["ctrl-c", "terminate", "kill"])
def test_workers_go_with_the_command_and_say_nothing(tmp_path, mark, how):
    for name in ("rig.toml", "again.toml"):
        (tmp_path / name).write_text(RIG)
    (tmp_path / "asleep.py").write_text(ASLEEP)
    process = started(tmp_path, *TUNE, patch=WORKERS_ASLEEP, start_new_session=True)
    patience = time.monotonic() + 100
    while len(list(tmp_path.glob(f"{mark}-*"))) < 2 and process.poll() is None and time.monotonic() < patience:
        time.sleep(0.005)
    assert process.poll() is None
    workers = [int(path.name.rpartition("-")[2]) for path in tmp_path.glob(f"{mark}-*")]
    assert len(workers) == 2 and all(map(alive, workers))
    if how != "kill":
        number = signal.SIGINT if how == "ctrl-c" else signal.SIGTERM
        os.killpg(process.pid, number)  # as a terminal does, or a queue of jobs
        assert ended(process)[:2] == (128 + number, [NOTHING])
        ours = {"rig.toml", "again.toml", "belt.toml", "asleep.py", "__pycache__"}
        assert not [path.name for path in tmp_path.iterdir() if path.name not in ours and not path.name.startswith(("begun-", "at-work-"))]
    else:
        process.kill()
        ended(process)
    patience = time.monotonic() + 60
    while any(map(alive, workers)) and time.monotonic() < patience:
        time.sleep(0.02)
    assert not any(map(alive, workers))


BEGUN = """
inner = command_line.main
def main(*arguments, **named):
    open("begun", "w").close()
    return inner(*arguments, **named)
command_line.main = main
"""

LOADING = """
from toolbox.translation.compiled import Compiled
inner = Compiled.ready
def ready(self):
    open("begun", "w").close()
    return inner(self)
Compiled.ready = ready
"""


def interrupted_at(tmp_path, patch, latest, times, seed, cache=None):
    """Interrupt a study at random instants after a mark until so many were ended. Returns how many were done before, and the longest end [s].

    latest: of the first instant [s]; a study that was done before its interrupt came shortens it, so that fast and slow machines are interrupted alike;
    cache: folder of machine code that is emptied before each study, and holds nothing unfinished after.
    """
    draw, done, ended_by, longest, out = random.Random(seed), 0, 0, 0.0, tmp_path / "out"
    while ended_by < times:
        shutil.rmtree(out, ignore_errors=True)
        for path in cache.iterdir() if cache else ():
            shutil.rmtree(path)
        (tmp_path / "begun").unlink(missing_ok=True)
        process = started(tmp_path, "study", "belt.toml", "--out", out, patch=patch)
        while not (tmp_path / "begun").exists() and process.poll() is None:
            time.sleep(0.001)
        time.sleep(draw.uniform(0.0, latest))
        began, number = time.monotonic(), draw.choice((signal.SIGINT, signal.SIGTERM))
        process.send_signal(number)
        code, errors, _ = ended(process)
        took = time.monotonic() - began
        left = sorted(path.name for path in tmp_path.iterdir() if path.name != "begun")
        assert cache is None or not list(cache.rglob("*.part"))
        if code == 0:  # it came when the result was in place
            assert errors == [] and left == ["belt.toml", "out"] and len(list(out.iterdir())) == 11
            done, latest = done + 1, 0.9 * latest
            assert done < 5 * times + 20, "an interrupt never comes in time"
        else:
            assert (code, errors) == (128 + number, [NOTHING]) and left == ["belt.toml"]
            ended_by, longest = ended_by + 1, max(longest, took)
    return done, longest


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    ("patch", "latest", "times"), [(BEGUN, 1.2, 100), (LOADING, 0.15, 30)], ids=["any instant", "while the event loop is loaded"]
)
def test_an_interrupt_at_random_instants_ends_the_study(tmp_path, patch, latest, times, exhaustive):
    times = times if exhaustive else times // 10
    done, longest = interrupted_at(tmp_path, patch, latest, times, seed=5)
    print(f"{times} ended by an interrupt, {done} were done before; at most {longest:.2f} s")


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_an_interrupt_while_the_event_loop_is_compiled_ends_the_study(tmp_path, tmp_path_factory, monkeypatch, exhaustive):
    cache = tmp_path_factory.mktemp("machine_code")
    monkeypatch.setitem(ENVIRONMENT, "STICKSLIP_CACHE_DIR", str(cache))
    done, longest = interrupted_at(tmp_path, LOADING, 3.0, 10 if exhaustive else 2, seed=6, cache=cache)
    print(f"all ended while compiling, {done} were done before; after at most {longest:.2f} s")


def test_interrupted_drives_whose_set_points_are_kept_do_not_say_that_runs_are_lost(tmp_path, monkeypatch, capsys):
    from toolbox.commands.command_line import main
    from toolbox.drilling import lowest_set_point as searched

    keeps = True

    def interrupted(*arguments, **options):
        if options["checkpoint"] is not None:
            options["checkpoint"].write_text('{"arguments": {}}\n' + keeps * '{"key": [6.0]}\n')
        interrupt = KeyboardInterrupt()
        interrupt.add_note("6 of 8 runs are lost; with `out` they are kept.")  # as a sweep without a folder of its own says
        raise interrupt

    monkeypatch.setattr(searched, "lowest_set_point", interrupted)
    scene = Path(__file__).parents[2] / "studies" / "scenes" / "jansen_2.toml"
    assert main(["setpoints", str(scene), "--out", str(tmp_path / "out")]) == 130
    assert "lost" not in (said := capsys.readouterr().err) and "goes on from here" in said
    keeps = False
    assert main(["setpoints", str(scene), "--out", str(tmp_path / "out")]) == 130
    assert "lost" not in (said := capsys.readouterr().err) and "nothing was written" in said
    assert main(["setpoints", str(scene)]) == 130
    assert "6 of 8 runs are lost" in capsys.readouterr().err


@pytest.mark.parametrize("keeps", [True, False])
def test_an_interrupted_map_says_that_it_goes_on_only_if_a_run_is_kept(keeps, tmp_path, monkeypatch, capsys):
    from toolbox.commands.command_line import main

    def interrupted(loop, ranges, shape, checkpoint, **options):
        checkpoint.mkdir(parents=True)
        (checkpoint / "runs.jsonl").write_text('{"arguments": {}}\n' + keeps * '{"key": [0.0, 1.0]}\n')
        raise KeyboardInterrupt

    monkeypatch.setattr("toolbox.onsets.severity_map.severity_map", interrupted)
    scene = Path(__file__).parents[2] / "studies" / "scenes" / "brake_stop.toml"
    ranges = ["--range", "disc.reference=0.2:5", "--range", "brake.force=0.2kN:3kN"]
    assert main(["map", str(scene), "--law", "HeldSpeed", *ranges, "--out", str(tmp_path / "out")]) == 130
    assert ("the same call goes on" in (said := capsys.readouterr().err)) == keeps
    assert ("nothing was written" in said) != keeps


def test_a_sweep_without_a_finished_run_does_not_say_that_runs_are_kept(tmp_path, monkeypatch):
    from models import BlockOnBelt
    from toolbox import closed_loop, compose, sweep
    from toolbox.sweeps import executors

    def stopped(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(executors, "_next", stopped)
    monkeypatch.setattr(executors, "_kept", lambda *arguments: None)
    loop = closed_loop(compose(BlockOnBelt()))
    with pytest.raises(KeyboardInterrupt) as interrupt:
        sweep(loop, {"block.force": [0.0, 0.1]}, metrics="severity", duration=1.0)
    assert interrupt.value.__notes__ == ["no run was finished."]
