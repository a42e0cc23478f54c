"""Does a command that is killed, or has no room, no rights or company, leave whole what was there, and does the same call end as if nothing had been?

Each command writes into a folder that holds a file of the user's and the results of an earlier call with other numbers. At a random instant it is killed
(SIGKILL) or ended (SIGTERM). Then the file of the user's must be there as it was, and the results must be those of before or those of the new call, whole; the
same call again must end with exactly the new ones, and nothing that is hidden may be left. What a sweep, a map, a tuning, an answer and a search of set-points
keep of their work so far is looked at through their results. Then the same under other conditions:

    full        a disk on which there is room for a random part of the results (as root, where the system can mount one)
    forbidden   folders in which nothing can be written
    together    two commands at once that find no machine code: both end, with the same results
    optimised   python -O, and a locale with decimal commas where the system has one

    python -m studies kills [--times 300] [--seed 1] [--command study] [--conditions 50]
"""

from __future__ import annotations

import math
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time as clock
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from studies.command_line import parser_of
from toolbox.files.origin import ORIGIN
from toolbox.onsets import SeverityMap
from toolbox.sweeps import Sweep
from toolbox.tuning.results import Tuned

ROOT = Path(__file__).parents[2]

RIG = """
title = "{title}"
duration = "{duration} s"
[verdict]
after = "10 s"
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
[[controllers]]
label = "stiff PI"
law = "StiffPI"
reference = "95 rpm"
[[controllers]]
label = "sampled"
law = "StiffPI"
reference = "95 rpm"
sample_time = "10 ms"
"""

COMMANDS: Mapping[str, tuple[str, ...]] = {
    "study": ("study", "rig.toml"),
    "simulate": ("simulate", "rig.toml"),
    "sweep": ("sweep", "rig.toml", "--range", "bit.weight=60kN:100kN:4", "--metric", "severity", "--controller", "stiff PI"),
    "map": ("map", "rig.toml", "--range", "top.reference=9:14", "--range", "bit.weight=60kN:100kN", "--shape", "3x3", "--controller", "stiff PI"),
    "tune": (
        "tune", "rig.toml", "--controller", "stiff PI", "--range", "stiffpi.integral=500:5000", "--objective", "severity", "--runs", "10",
        "--checkpoint", "journal",
    ),
    "export": ("export", "rig.toml", "--part", "law", "--controller", "sampled"),
    "answer": (
        "answer", "rig.toml", "--initial-controller", "stiff PI", "--controller", "sampled", "--phases", "1", "--duration", "30 s",
    ),
    "setpoints": (
        "setpoints", "rig.toml", "--initial-controller", "stiff PI", "--controller", "sampled", "--group", "nominal", "--protocol", "takeover",
        "--range", "top.reference=130 rpm:140 rpm", "--step", "10 rpm",
    ),
    "estimate": ("estimate", "rig.toml", "log.csv", "--controller", "stiff PI", "--members", "8"),
}  # fmt: skip
"""Calls, to which `--out out` is added."""

KEEPS = ("sweep", "map", "tune", "answer", "setpoints")
"""Commands that keep their work so far beside their results."""

KEPT = ("answer.jsonl", "cells.jsonl")
"""Files of that work, in which a line may be cut."""


def prepared(folder: Path, title: str, duration: int) -> None:
    """Write what the commands read: a scene, and the log of a top drive that swings in time with the string."""
    (folder / "rig.toml").write_text(RIG.format(title=title, duration=duration))
    rows = (f"{t},{9.9 + math.sin(1.3 * t)},{9000.0 + 4000.0 * math.sin(1.3 * t + 1.0)}" for t in (k / 10 for k in range(10 * duration)))
    (folder / "log.csv").write_text("\n".join(["time [s],top.speed [rad/s],top.torque [N m]", *rows]) + "\n")


def environment(**more: str) -> dict[str, str]:
    """What a command sees of the system."""
    found = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]), "MPLBACKEND": "Agg"} | more
    return {name: value for name, value in found.items() if value}


OWNER = ("setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-dac_override,-dac_read_search")
"""What takes from root the right to write everywhere."""


def begun(command: str, folder: Path, *flags: str, as_owner: bool = False, **more: str) -> subprocess.Popen[bytes]:
    """The process of a command in a folder; as_owner: with the rights of who owns the folder, no more."""
    words = [
        *(OWNER if as_owner and os.geteuid() == 0 else ()),
        sys.executable,
        *flags,
        "-m",
        "toolbox",
        *COMMANDS[command],
        "--out",
        "out",
    ]
    return subprocess.Popen(words, cwd=folder, env=environment(**more), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def done(process: subprocess.Popen[bytes]) -> tuple[int, str]:
    """(exit code, last line on stderr) of a process."""
    _, errors = process.communicate()
    return process.returncode, (errors.decode(errors="replace").strip().splitlines() or [""])[-1]


def results(command: str, folder: Path) -> Any:
    """What a call has left in its folder, without dates and times; None where there is nothing."""
    out = folder / "out"
    if not out.is_dir():
        return None
    if command == "sweep":
        return {str(path.relative_to(out)): _values(Sweep.load(path)) for path in sorted(out.rglob("sweep.zarr"))}
    if command == "map":
        return {str(path.relative_to(out)): SeverityMap.load(path).smooth.severity.tobytes() for path in sorted(out.rglob("map.npz"))}
    files = [path for path in sorted(out.rglob("*")) if path.is_file() and path.name not in (ORIGIN, "mine.txt", *KEPT)]
    return {str(path.relative_to(out)): _text(path) for path in files}


def _values(found: Sweep) -> tuple[bytes, ...]:
    return found.points.tobytes(), *(values.tobytes() for values in found.metrics.values())


def _text(path: Path) -> bytes:
    """What is in a file, without how many points a journal had already."""
    if path.name == "tune.npz":
        return repr(replace(Tuned.load(path), simulated_runs=0)).encode()
    lines = path.read_bytes()
    if path.name != "tune.txt":
        return lines
    return b"\n".join(line for line in lines.splitlines() if b"simulated" not in line and b"journal" not in line)


def hidden(folder: Path) -> list[str]:
    """Temporary names that are left behind."""
    return [path.name for path in folder.rglob(".*.part")]


def whole(command: str, parent: Path, title: str, duration: int) -> tuple[Path, Any, float]:
    """A folder with the results of one call that nobody disturbs, these results, and the time that it took."""
    folder = parent / f"{command}_{title}"
    folder.mkdir()
    prepared(folder, title, duration)
    began = clock.perf_counter()
    code, error = done(begun(command, folder))
    if code != 0:
        raise RuntimeError(f"`{command}` ended with {code}: {error}")
    return folder, results(command, folder), clock.perf_counter() - began


# ------------------------------------------------------------------------------------------------------------------------------------------ kills
def kills(command: str, parent: Path, times: int, draw: random.Random) -> Counter[str]:
    """Kill a command so many times. Counts what came of it; raises AssertionError for a fault."""
    before, old, _ = whole(command, parent, "before", 20)
    _, new, took = whole(command, parent, "new", 21)
    assert old != new or command in (*KEEPS, "export")
    found: Counter[str] = Counter()
    for k in range(times):
        folder = parent / f"{command}_{k}"
        shutil.copytree(before, folder)
        (folder / "journal").unlink(missing_ok=True)
        if command in KEEPS:
            shutil.rmtree(folder / "out")
            (folder / "out").mkdir()
        (folder / "out" / "mine.txt").write_text("mine")
        prepared(folder, "new", 21)
        process = begun(command, folder)
        clock.sleep(draw.uniform(0.02, 1.0) * took)
        process.send_signal(number := draw.choice((signal.SIGKILL, signal.SIGTERM)))
        code, error = done(process)
        found["ended before" if code == 0 else f"by {number.name}"] += 1
        assert code in (0, -number, 128 + number), (command, code, error)
        assert (folder / "out" / "mine.txt").read_text() == "mine"
        assert not hidden(folder) or number == signal.SIGKILL, (command, number, hidden(folder))
        if command not in KEEPS:
            assert results(command, folder) in (old, new), (command, "neither the old results nor the new")
        assert done(begun(command, folder))[0] == 0
        assert results(command, folder) == new, (command, "the same call ends otherwise")
        assert (folder / "out" / "mine.txt").read_text() == "mine"
        shutil.rmtree(folder)
    return found


# ------------------------------------------------------------------------------------------------------------------------------------- conditions
@contextmanager
def small_disk(place: Path, size: int) -> Any:
    """A file system of so many bytes."""
    place.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)], check=True, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def full(parent: Path, times: int, draw: random.Random) -> str:
    """Disks on which there is no room for everything."""
    refused = 0
    sizes = {}
    for command in ("study", "simulate", "tune"):
        folder, _, _ = whole(command, parent, "full", 20)
        sizes[command] = sum(path.stat().st_size for path in (folder / "out").rglob("*") if path.is_file())
    for k in range(times):
        command = draw.choice([*sizes])
        place = parent / f"disk_{k}"
        try:
            with small_disk(place, int(65536 + draw.uniform(0.0, 1.0) * sizes[command])):
                prepared(place, "full", 20)
                (place / "mine.txt").write_text("mine")
                code, error = done(begun(command, place))
                assert code in (0, 1, 2) and "Traceback" not in error, (command, code, error)
                assert code == 0 or (error.startswith("stickslip: ") and not (place / "out").exists()), (command, error)
                assert (place / "mine.txt").read_text() == "mine" and not hidden(place)
                refused += code != 0
        except (subprocess.CalledProcessError, FileNotFoundError):
            return "not tried: this user cannot mount a small disk"
    return f"{refused} of {times} refused in one line, nothing half-written"


def forbidden(parent: Path, times: int, draw: random.Random) -> str:
    """Folders in which nothing can be written."""
    if os.geteuid() == 0 and shutil.which("setpriv") is None:
        return "not tried: nothing takes the rights of root away"
    for k in range(times):
        command = draw.choice(["study", "simulate", "export", "tune"])
        folder = parent / f"forbidden_{k}"
        folder.mkdir()
        prepared(folder, "forbidden", 20)
        os.chmod(folder, 0o555)
        code, error = done(begun(command, folder, as_owner=True))
        assert code == 2 and error.startswith("stickslip: ") and "cannot" in error, (command, code, error)
        assert {path.name for path in folder.iterdir()} == {"rig.toml", "log.csv"}
        os.chmod(folder, 0o755)
    return f"{times} refused in one line, nothing written"


def together(parent: Path, times: int, _: random.Random) -> str:
    """Two commands at once that find no machine code."""
    for k in range(times):
        folders = [parent / f"together_{k}_{n}" for n in (0, 1)]
        for folder in folders:
            folder.mkdir()
            prepared(folder, "together", 20)
        cache = parent / f"machine_code_{k}"
        cache.mkdir(mode=0o700)
        for process in [begun("simulate", folder, STICKSLIP_CACHE_DIR=str(cache)) for folder in folders]:
            code, error = done(process)
            assert code == 0, error
        assert results("simulate", folders[0]) == results("simulate", folders[1])
        assert not [path for path in cache.rglob("*") if path.name.endswith(".part")]
        shutil.rmtree(cache)
    return f"{times} pairs ended alike"


def optimised(parent: Path, _: int, __: random.Random) -> str:
    """Without assertions, and with decimal commas."""
    _, expected, _ = whole("study", parent, "optimised", 20)
    known = subprocess.run(["locale", "-a"], capture_output=True, text=True, check=False).stdout.split()
    commas = next((name for name in known if name.lower().startswith(("de_", "fr_", "nl_")) and "utf" in name.lower()), None)
    asked = {"python -O": (["-O"], {}), **({f"LC_ALL={commas}": ([], {"LC_ALL": commas})} if commas else {})}
    for n, (flags, more) in enumerate(asked.values()):
        folder = parent / f"optimised_{n}"
        folder.mkdir()
        prepared(folder, "optimised", 20)
        code, error = done(begun("study", folder, *flags, **more))
        assert code == 0, error
        assert results("study", folder) == expected
    return f"the same bytes under {' and '.join(asked)}" + ("" if commas else "; no locale with decimal commas is here")


CONDITIONS: Mapping[str, Callable[[Path, int, random.Random], str]] = {
    "full": full, "forbidden": forbidden, "together": together, "optimised": optimised,
}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Run it."""
    parser = parser_of(__doc__)
    parser.add_argument("--times", type=int, default=300, help="kills of all commands together (300)")
    parser.add_argument("--conditions", type=int, default=50, help="tries of each other condition (50)")
    parser.add_argument("--command", choices=COMMANDS, action="append", help="only this one; may be repeated")
    parser.add_argument("--condition", choices=CONDITIONS, action="append", help="only this one; may be repeated")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    draw = random.Random(given.seed)
    commands = given.command or ([] if given.condition else [*COMMANDS])
    with tempfile.TemporaryDirectory() as name:
        parent = Path(name)
        parent.chmod(0o755)
        total: Counter[str] = Counter()
        for command in commands:
            found = kills(command, parent, max(given.times // len(COMMANDS), 1), draw)
            total += found
            print(f"{command:10}{', '.join(f'{count} {word}' for word, count in sorted(found.items()))}", flush=True)
        if commands:
            print(
                f"{sum(total.values())} in all: {', '.join(f'{count} {word}' for word, count in sorted(total.items()))}; every file and result whole"
            )
        for condition in given.condition or ([] if given.command else [*CONDITIONS]):
            print(f"{condition:10}{CONDITIONS[condition](parent, given.conditions, draw)}", flush=True)


if __name__ == "__main__":
    main()
