"""The command `stickslip`: study a scene from file to verdict, figures and data; list the parts that scenes can name.

Exit codes: 0 done; 1 no controller could be simulated, or a file could not be written; 2 the scene or an argument is wrong; 130 interrupted.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import math
import os
import re
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.errors import SceneError, SimulationError

if TYPE_CHECKING:
    from toolbox.scene import Case, Scene
    from toolbox.trajectory import Trajectory

COMMON_FILES = ("scene.toml", "table.csv", "comparison.png")
CASE_FILES = (".npz", ".png", "_phase.png")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; the errors of a user are one line on stderr."""
    given = _parser().parse_args(arguments)
    try:
        return given.action(given)
    except SceneError as error:
        return _complaint(str(error), 2)
    except BrokenPipeError:  # whoever read the output has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _complaint(f"{error.filename or 'Output'}: {error.strerror or error}.", 1)
    except KeyboardInterrupt:
        return _complaint("interrupted, and nothing was written.", 130)


def _complaint(text: str, code: int) -> int:
    print(f"stickslip: {' '.join(text.split())}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="stickslip", description="Simulate stick-slip of drill strings and brakes, and compare controllers that end it.")
    parser.add_argument("--version", action="version", version=f"stickslip-toolbox {_version()}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    study = commands.add_parser(
        "study",
        help="simulate every controller of a scene; table, figures and data",
        description="Simulate every controller of a scene and print a table. The folder gets one figure with time traces, one phase plane and the "
        "trajectory (npz) per controller, a comparison, the table (csv, SI units) and the scene with every parameter in SI: all of it, or nothing.",
        epilog="example: stickslip study studies/scenes/navarro_lopez_4.toml --out results",
    )
    study.add_argument("scene", type=Path, metavar="SCENE.toml", help="what to simulate; `toolbox/scene.py` and the shipped scenes explain the keys")
    study.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for the results; an earlier study in it is replaced, other files stay"
    )
    study.set_defaults(action=_study)
    listing = commands.add_parser("list", help="list parts, control laws and friction laws with their parameters and units")
    listing.add_argument("name", nargs="?", help="show only the entries whose name contains this")
    listing.set_defaults(action=_list)
    return parser


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("stickslip-toolbox")
    except PackageNotFoundError:
        return "(not installed)"


# --- stickslip list


def _list(given: argparse.Namespace) -> int:
    from toolbox import catalogue

    entries = [entry for entry in catalogue.parts() if given.name is None or given.name.lower() in entry.name.lower()]
    if not entries:
        catalogue.part(given.name or "any")  # raises the error that says why
    for kind in catalogue.KINDS:
        if any(entry.kind == kind for entry in entries):
            print(f"{kind.capitalize()}s")
        for entry in entries:
            if entry.kind == kind:
                print(f"  {entry.name}: {entry.summary}")
                for name, unit, value, meaning in entry.parameters:
                    shown = "required" if value is dataclasses.MISSING else _shown(value)
                    print(f"    {name:<16} {shown} {'' if unit == '1' else unit}{'  ' + meaning if meaning else ''}")
    return 0


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_shown, value)) + "]"
    if isinstance(value, float):
        return f"{value:.10g}"
    return type(value).__name__ if dataclasses.is_dataclass(value) else str(value).lower() if value is None else str(value)


# --- stickslip study


@dataclass(frozen=True)
class Row:
    """One line of the table, in SI; nan where a number does not exist, inf for what never settles.

    stuck: seconds of sticking after the settle time;  peak: largest |effort|;  error: largest scaled state error;  wall_time: of the event
    loop;  files: what the files of this controller begin with.
    """

    controller: str
    verdict: str
    stuck: float = math.nan
    severity: float = math.nan
    settling: float = math.nan
    overshoot: float = math.nan
    peak: float = math.nan
    error: float = math.nan
    wall_time: float = math.nan
    files: str = ""


def _study(given: argparse.Namespace) -> int:
    from toolbox.scene import Scene

    scene = Scene.load(given.scene)
    stems = _stems(scene.labels)
    with whole_folder(given.out, [*COMMON_FILES, *(stem + tail for stem in stems for tail in CASE_FILES)]) as folder:
        _warm_up(scene)
        rows, runs = [], {}
        with _progress(len(scene.cases)) as reached:
            for i, (case, stem) in enumerate(zip(scene.cases, stems, strict=True)):
                reached(i, case.label)
                row, run = _row(scene, case, stem)
                rows.append(row)
                if run is not None and run.time.size > 1:
                    reached(i + 0.5, f"{case.label}: figures")
                    run.save(folder / f"{stem}.npz")
                    _figures(scene, run, case.label, folder, stem)
                    runs[case.label] = run
            if runs:
                reached(len(scene.cases) - 0.1, "comparison")
                _comparison(scene, runs, folder)
        _write_table(rows, folder / "table.csv")
        scene.save(folder / "scene.toml")
    print(_table(scene, rows))
    print(f"\nFigures, trajectories, table and scene are in {given.out}")
    return 0 if any(not row.verdict.startswith("failed") for row in rows) else 1


def _row(scene: Scene, case: Case, stem: str) -> tuple[Row, Trajectory | None]:
    """The numbers of one controller; a run that fails is a row as well."""
    from toolbox import measure

    try:
        run = scene.run(case.label)
    except SimulationError as error:
        return Row(case.label, f"failed: {error}", files=stem), error.run
    try:
        error = run.error
    except SimulationError:  # the run for comparison, at a hundredth of the accuracy
        error = math.nan
    target = scene.reference
    peak = measure.extent(run, scene.effort)
    return Row(
        controller=case.label,
        verdict=verdict(measure.stick_intervals(run, scene.element, scene.after), scene.after, scene.duration),
        stuck=run.time_in(scene.element, "stick", after=scene.after),
        severity=measure.severity(run, scene.signal, after=scene.after),
        settling=measure.settling(run, scene.signal, target) if target else math.nan,
        overshoot=measure.overshoot(run, scene.signal, target) if target else math.nan,
        peak=max(abs(peak.minimum), abs(peak.maximum)),
        error=error,
        wall_time=run.wall_time,
        files=stem,
    ), run


def verdict(sticks: Sequence[tuple[float, float]], after: float, end: float) -> str:
    """What the stick intervals between `after` and `end` [s] amount to.

    "free" for none; "stuck" where the last one lasts to the end and longer than half of the window; "stick-slip" for two or more;
    "sticks once" for a single one that ends.
    """
    if not sticks:
        return "free"
    if sticks[-1][1] >= end and sticks[-1][1] - sticks[-1][0] > 0.5 * (end - after):
        return "stuck"
    return "stick-slip" if len(sticks) > 1 else "sticks once"


def _stems(labels: Sequence[str]) -> list[str]:
    """Beginnings of file names: numbered, so that they differ and keep the order of the scene."""
    plain = [re.sub(r"[^a-z0-9]+", "_", label.lower()).strip("_")[:40] for label in labels]
    return [f"{i:02d}_{word}".rstrip("_") for i, word in enumerate(plain, 1)]


# --- the first run and progress


def _warm_up(scene: Scene) -> None:
    """Load the event loop, or compile it on its first use, so that the wall times of the table are those of simulating."""
    still = dataclasses.replace(scene, duration=0.0)
    for label in scene.labels:
        try:
            still.run(label)
            return
        except SimulationError:
            continue


@contextmanager
def _progress(total: int) -> Iterator[Any]:
    """A bar on stderr that appears after a second; yields a function of (cases done, what is going on)."""
    from tqdm import tqdm

    with tqdm(total=total, delay=1.0, leave=False, file=sys.stderr, bar_format="{desc} |{bar:30}| {percentage:3.0f}% {elapsed}") as bar:

        def reached(done: float, text: str) -> None:
            bar.set_description_str(text, refresh=False)
            bar.update(done - bar.n)

        yield reached


# --- what is written


@contextmanager
def whole_folder(path: Path, names: Sequence[str]) -> Iterator[Path]:
    """A temporary folder whose files `names` appear in `path` together when the block ends well, and vanish otherwise.

    Files of an earlier study in `path` are replaced, other files stay. Raises SceneError, before the block runs, where `path` cannot be
    written and where a file in the way is not from an earlier study.
    """
    path = path.absolute()
    if path.exists() and not path.is_dir():
        raise SceneError(f"Argument `--out` must be a folder, but `{path}` is a file.")
    exists = path.is_dir()
    earlier = _earlier_study(path) if exists else set()
    for name in names:
        if exists and (path / name).exists() and name not in earlier:
            raise SceneError(f"Argument `--out` must not hide your own files, but `{path / name}` is not from an earlier study.")
    ground = path if exists else next(parent for parent in path.parents if parent.exists())
    try:
        shelter = Path(tempfile.mkdtemp(dir=ground, prefix=".stickslip-"))
    except OSError as error:
        raise SceneError(f"Argument `--out` must be a folder that can be written, but `{path}` cannot: {error.strerror}.") from None
    try:
        folder = shelter / "study"
        folder.mkdir()
        yield folder
        with _uninterrupted():
            if not exists:
                path.parent.mkdir(parents=True, exist_ok=True)
                folder.rename(path)
            else:
                for name in earlier:
                    (path / name).unlink(missing_ok=True)
                for file in folder.iterdir():
                    file.replace(path / file.name)
    finally:
        shutil.rmtree(shelter, ignore_errors=True)


def _earlier_study(path: Path) -> set[str]:
    """Names of the files that an earlier study left in a folder, as its table tells."""
    try:
        with (path / "table.csv").open(newline="", encoding="utf-8") as file:
            table = csv.DictReader(file)
            stems = [row["files"] for row in table] if table.fieldnames == [field.name for field in dataclasses.fields(Row)] else None
    except (OSError, ValueError, csv.Error):
        return set()
    if stems is None:
        return set()
    names = {*COMMON_FILES, *(stem + tail for stem in stems if stem == Path(stem).name for tail in CASE_FILES)}
    return {name for name in names if (path / name).is_file()}


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C waits until the block is done (where signals can be handled at all)."""
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:  # not the main thread
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _figures(scene: Scene, run: Trajectory, label: str, folder: Path, stem: str) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from toolbox import plot

    _write_figure(plot.traces(run), label, folder / f"{stem}.png")
    position = _position(run, scene.signal)
    if position is not None:
        _write_figure(plot.phase_plane(run, position, scene.signal, scene.element), label, folder / f"{stem}_phase.png")


def _comparison(scene: Scene, runs: Mapping[str, Trajectory], folder: Path) -> None:
    from toolbox import plot

    _write_figure(plot.comparison(dict(runs), scene.signal, scene.element), scene.title, folder / "comparison.png")


def _position(run: Trajectory, speed: str) -> str | None:
    """The last state whose unit is that of a speed times a second: the twist at the bit, the position of a block."""
    for name, (_, size, unit) in reversed(run.program.system.states.items()):
        if f"{unit}/s" == run.unit(speed):
            return name if size is None else f"{name}.{size - 1}"
    return None


def _write_figure(axes: Any, title: str, path: Path) -> None:
    import matplotlib.pyplot as plt
    import numpy as np

    figure = np.ravel(axes)[0].figure
    figure.suptitle(title)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def _write_table(rows: Sequence[Row], path: Path) -> None:
    names = [field.name for field in dataclasses.fields(Row)]
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, names)
        table.writeheader()
        table.writerows({name: value for name, value in dataclasses.asdict(row).items() if value == value} for row in rows)


def _table(scene: Scene, rows: Sequence[Row]) -> str:
    """The table as text, with the reasons of failures below it."""
    unit = scene.plant().inputs.get(scene.effort)
    head = ["controller", "verdict", "stuck [s]", "severity", "settling [s]", "overshoot", f"peak {scene.effort}", "error", "wall time"]
    lines = [head]
    for row in rows:
        settling = "never" if row.settling == math.inf else _text(row.settling, "{:.1f}")
        lines.append(
            [
                row.controller,
                row.verdict.partition(":")[0],
                _text(row.stuck, "{:.2f}"),
                _text(row.severity, "{:.3f}"),
                settling,
                _text(100 * row.overshoot, "{:.1f} %"),
                _text(row.peak, "{:.5g}" + (f" {unit.unit}" if unit else "")),
                _text(row.error, "{:.0e}"),
                _text(1e3 * row.wall_time, "{:.2g} ms"),
            ]
        )
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    text = [
        "  ".join(cell.ljust(width) if i < 2 else cell.rjust(width) for i, (cell, width) in enumerate(zip(line, widths, strict=True))).rstrip()
        for line in lines
    ]
    text.insert(1, "-" * max(map(len, text)))
    judged = f"`{scene.element}` and `{scene.signal}` are judged from {scene.after:g} s to {scene.duration:g} s"
    text += [f"{row.controller}: {row.verdict}" for row in rows if row.verdict.startswith("failed")]
    return "\n".join([scene.title, judged + (f"; set-point {scene.reference:.4g}" if scene.reference else "") + ".", "", *text])


def _text(value: float, form: str) -> str:
    return "-" if math.isnan(value) else form.format(value)
