"""The command `stickslip`: study a scene from file to verdict, figures and data; find where its stick-slip begins and ends; fit it to data; list the parts.

Exit codes: 0 done; 1 no controller could be simulated; 2 the scene or an argument is wrong, or the folder cannot be written; 130 interrupted.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import os
import re
import secrets
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from toolbox.errors import SceneError

COMMON_FILES = ("scene.toml", "table.csv", "comparison.png")
INTERRUPTED = 130
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
        return _complaint("interrupted, and nothing was written.", INTERRUPTED)


def script() -> None:
    """Run the command line as a process."""
    code = main()
    if code == INTERRUPTED:
        # an interrupt that reached Python inside an exec of text ends the process as killed even where it was caught (3.11 to 3.13)
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _complaint(text: str, code: int) -> int:
    print(f"stickslip: {' '.join(text.split())}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="stickslip", description="Simulate stick-slip of drill strings and brakes, and compare controllers that end it."
    )
    parser.add_argument("--version", action="version", version=f"stickslip-toolbox {_version()}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    study = commands.add_parser(
        "study",
        help="simulate every controller of a scene; table, figures and data",
        description="Simulate every controller of a scene and print a table. The folder gets one figure with time traces, one phase plane and the "
        "trajectory (npz) per controller, a comparison, the table (csv, SI units) and the scene with every parameter in SI: all of it, or nothing.",
        epilog="example: stickslip study studies/scenes/navarro_lopez_4.toml --out results",
    )
    study.add_argument(
        "scene", type=Path, metavar="SCENE.toml", help="what to simulate; see `toolbox/scene_file.py` and studies/scenes for the keys"
    )
    study.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder for the results; an earlier study in it is replaced, other files stay",
    )
    study.set_defaults(action=_study)
    border = commands.add_parser(
        "onset",
        help="where stick-slip begins and where it ends over one parameter, for every controller of a scene",
        description="Simulate every controller of a scene from smooth running and from inside stick-slip over one parameter or input, find both borders, "
        "and print them with the Hopf point and the margin at the working point. With --out, the folder gets a figure, the report and one table (csv) "
        "per controller: all of it, or nothing.",
        epilog="example: stickslip onset studies/scenes/jansen_2.toml --parameter top.reference --from '10 rpm' --to '150 rpm' --out borders",
    )
    border.add_argument("scene", type=Path, metavar="SCENE.toml", help="the machine and its controllers")
    border.add_argument("--parameter", required=True, metavar="NAME", help="what varies: an input, or a parameter of the plant or of a law")
    border.add_argument("--from", dest="low", required=True, metavar="LOW", help="begin of its range: SI, or with a unit such as '10 rpm'")
    border.add_argument("--to", dest="high", required=True, metavar="HIGH", help="end of its range")
    border.add_argument("--at", metavar="VALUE", help="working point whose margin is reported; the value of the scene without")
    border.add_argument("--controller", metavar="LABEL", action="append", help="only this one; may be repeated")
    border.add_argument("--values", type=int, default=13, metavar="N", help="values at which both branches are simulated (13)")
    border.add_argument("--tolerance", metavar="X", help="of the borders; a thousandth of the range without")
    border.add_argument("--out", type=Path, metavar="DIR", help="folder for figure, report and tables; those of an earlier search are replaced")
    border.set_defaults(action=_onset)
    calibration = commands.add_parser(
        "fit",
        help="parameters of a scene's plant from measured signals, with confidence intervals",
        description="Fit parameters to measured signals: by simulation, driven by the measured inputs, or with --contact the friction law of one contact "
        "directly to measured torque over measured slip. The folder gets the report, the estimates (csv), a figure of model and data, and the "
        "calibrated scene: all of it, or nothing.",
        epilog="example: stickslip fit studies/scenes/jansen_2.toml studies/data/rig.csv --free bit.friction.static=0.6:1 "
        "--free bit.friction.kinetic=0.3:0.6 --out fitted",
    )
    calibration.add_argument("scene", type=Path, metavar="SCENE.toml", help="the machine; its inputs and start hold where nothing is measured")
    calibration.add_argument("data", type=Path, metavar="DATA", help="measured signals: CSV or TOML with units in headings, or MAT")
    calibration.add_argument("--free", required=True, metavar="NAME[=LOW:HIGH]", action="append", help="what to fit, with bounds; may be repeated")
    calibration.add_argument("--column", metavar="SIGNAL=HEADING", action="append", default=[], help="what a signal, or time, is called in the data")
    calibration.add_argument("--contact", metavar="NAME", help="fit the law of this contact to the measured loop, without simulation")
    calibration.add_argument("--controller", metavar="LABEL", help="the controller of the scene that was running; the plant alone without")
    calibration.add_argument("--starts", type=int, default=4, metavar="N", help="searches from different values (4)")
    calibration.add_argument("--out", type=Path, metavar="DIR", help="folder for report, table, figure and scene; those of an earlier fit are replaced")
    calibration.set_defaults(action=_fit)
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
        if given.name is None:
            raise SceneError("No package offers parts: install stickslip-toolbox (pip install .) to register its own.")
        catalogue.part(given.name)  # raises the error that says why
    for kind in catalogue.KINDS:
        if any(entry.kind == kind for entry in entries):
            print(f"{kind.capitalize()}s")
        for entry in entries:
            if entry.kind == kind:
                print(f"  {entry.name}: {entry.summary}")
                for name, unit, value, meaning in entry.parameters:
                    shown = "required" if value is dataclasses.MISSING else _shown(value)
                    print("    " + " ".join(filter(None, [f"{name:<16} {shown}", "" if unit == "1" or value is None else unit, meaning and f" {meaning}"])))
    return 0


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_shown, value)) + "]"
    if isinstance(value, float):
        return f"{value:.10g}"
    if dataclasses.is_dataclass(value):
        return f"{type(value).__name__}({', '.join(f'{spec.name}={_shown(getattr(value, spec.name))}' for spec in dataclasses.fields(value))})"
    return "none" if value is None else str(value)


# --- stickslip study


def _study(given: argparse.Namespace) -> int:
    from toolbox import study
    from toolbox.scene import Scene

    scene = Scene.load(given.scene)
    stems = _stems(scene.labels)
    with whole_folder(given.out, [*COMMON_FILES, *(stem + tail for stem in stems for tail in CASE_FILES)]) as folder:
        rows, runs = [], {}
        with _progress(len(scene.cases)) as reached:
            for i, (label, stem) in enumerate(zip(scene.labels, stems, strict=True)):
                reached(i, label)
                row, run = study.judged(scene, label, stem)
                rows.append(row)
                if run is not None and run.time.size > 1:
                    reached(i + 0.5, f"{label}: figures")
                    run.save(folder / f"{stem}.npz")
                    study.draw(scene, label, run, folder / f"{stem}.png", folder / f"{stem}_phase.png")
                    runs[label] = run
            if runs:
                reached(len(scene.cases) - 0.1, "comparison")
                study.draw_comparison(scene, runs, folder / "comparison.png")
        study.write_table(rows, folder / "table.csv")
        scene.save(folder / "scene.toml")
    print(study.table(scene, rows))
    if warning := scene.needs().warning:
        print(f"\n{warning}")
    print(f"\nFigures, trajectories, table and scene are in {given.out}")
    return 1 if all(row.failed for row in rows) else 0


# --- stickslip onset


def _onset(given: argparse.Namespace) -> int:
    from toolbox.errors import SimulationError
    from toolbox.onset import Comparison, onset
    from toolbox.scene import Scene
    from toolbox.units import parse

    scene = Scene.load(given.scene)
    labels = [scene.case(label).label for label in given.controller or scene.labels]
    units = {label: _unit(scene, label, given.parameter) for label in labels}
    unit = next((word for word in units.values() if word is not None), None)
    if unit is None:
        _unit(scene, labels[0], given.parameter, complain=True)
    number = {
        word: None if text is None else parse(_plain(text), str(unit), f"--{word}")
        for word, text in (("from", given.low), ("to", given.high), ("at", given.at), ("tolerance", given.tolerance))
    }
    onsets, failures = {}, {}
    stems = _stems(labels)
    names = [*ONSET_FILES, *(f"{stem}_onset.csv" for stem in stems)]
    with whole_folder(given.out, names, _earlier_onset) if given.out else nullcontext() as folder:
        with _progress(len(labels)) as reached:
            for i, label in enumerate(labels):
                reached(i, label)
                if units[label] is None:
                    failures[label] = f"it has no parameter or input `{given.parameter}`."
                    continue
                try:
                    onsets[label] = onset(
                        scene, given.parameter, (number["from"], number["to"]), controller=label,  # type: ignore[arg-type]
                        values=given.values, tolerance=number["tolerance"], at=number["at"],
                    )  # fmt: skip
                except (SceneError, SimulationError) as error:
                    if "Argument" in str(error):
                        raise
                    failures[label] = str(error)
        found = Comparison(onsets, failures)
        text = "\n\n".join([scene.title, *(str(each) for each in onsets.values()), str(found)]) + "\n"
        if folder is not None:
            (folder / "onset.txt").write_text(text, encoding="utf-8")
            for label, stem in zip(labels, stems, strict=True):
                if label in onsets:
                    onsets[label].save(folder / f"{stem}_onset.csv")
            if onsets:
                from toolbox import study

                study.draw_onsets(scene, onsets, folder / "onset.png")
    print(text, end="")
    if given.out:
        print(f"\nFigure, report and tables are in {given.out}")
    return 0 if onsets else 1


# --- stickslip fit


def _fit(given: argparse.Namespace) -> int:
    from toolbox.errors import SimulationError
    from toolbox.fit import fit
    from toolbox.scene import Scene

    scene = Scene.load(given.scene)
    plant = scene.plant()
    bounds = {}
    names = []
    for text in given.free:
        name, equals, limits = text.partition("=")
        names.append(name)
        if equals:
            low, colon, high = limits.partition(":")
            if not colon:
                raise SceneError(f"Argument `--free` must be NAME or NAME=LOW:HIGH, but it is `{text}`.")
            bounds[name] = (_in_unit(plant, name, low), _in_unit(plant, name, high))
    columns = {}
    for text in given.column:
        signal_name, equals, heading = text.partition("=")
        if not equals:
            raise SceneError(f"Argument `--column` must be SIGNAL=HEADING, but it is `{text}`.")
        columns[signal_name] = heading
    with whole_folder(given.out, FIT_FILES, _earlier_fit) if given.out else nullcontext() as folder:
        try:
            found = fit(
                scene, given.data, names, bounds, columns=columns or None, controller=given.controller, contact=given.contact, starts=given.starts
            )
        except SimulationError as error:
            return _complaint(str(error), 1)
        text = f"{scene.title}\n\n{found}\n"
        if folder is not None:
            from toolbox import study

            (folder / "fit.txt").write_text(text, encoding="utf-8")
            found.save(folder / "fit.csv")
            study.draw_fit(scene, found, folder / "fit.png")
            dataclasses.replace(scene, parts=found.plant.parts, parameters={}).save(folder / "scene.toml")
    print(text, end="")
    if given.out:
        print(f"\nReport, table, figure and the calibrated scene are in {given.out}")
    return 0


FIT_FILES = ("fit.txt", "fit.csv", "fit.png", "scene.toml")


def _in_unit(plant: Any, name: str, text: str) -> float:
    """A bound of a free number, SI or text with a unit."""
    from toolbox.units import parse

    try:
        unit = plant._parameter(name).unit
    except SceneError:
        if not plant.has_signal(name):
            raise
        unit = plant.unit(name)
    return parse(_plain(text), unit, f"--free {name}")


def _earlier_fit(path: Path) -> set[str]:
    """Names of the files that an earlier fit left in a folder, as its report tells."""
    try:
        if "\nFit of " not in (path / "fit.txt").read_text(encoding="utf-8"):
            return set()
    except (OSError, ValueError):
        return set()
    return {name for name in FIT_FILES if (path / name).is_file()}


ONSET_FILES = ("onset.png", "onset.txt")


def _plain(text: str) -> Any:
    """A number, or text with a unit for `units.parse`."""
    try:
        return float(text)
    except ValueError:
        return text


def _unit(scene: Any, label: str, parameter: str, complain: bool = False) -> str | None:
    """Unit of what varies under one controller; None where it has no such parameter or law, or the error that says why."""
    from toolbox.stability import Knob, continuous_loop

    try:
        return Knob.of(continuous_loop(scene.plant(), scene.case(label).controller), parameter).unit
    except SceneError:
        if complain:
            raise
        return None


def _earlier_onset(path: Path) -> set[str]:
    """Names of the files that an earlier search for borders left in a folder, as its report tells."""
    try:
        if "Onset of stick-slip" not in (path / "onset.txt").read_text(encoding="utf-8"):
            return set()
    except (OSError, ValueError):
        return set()
    return {file.name for file in [*path.glob("[0-9][0-9]_*_onset.csv"), *(path / name for name in ONSET_FILES)] if file.is_file()}


def _stems(labels: Sequence[str]) -> list[str]:
    """Beginnings of file names: numbered, so that they differ and keep the order of the scene."""
    plain = [re.sub(r"[^a-z0-9]+", "_", label.lower()).strip("_")[:40] for label in labels]
    return [f"{i:02d}_{word}".rstrip("_") for i, word in enumerate(plain, 1)]


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
def whole_folder(path: Path, names: Sequence[str], left_by: Callable[[Path], set[str]] | None = None) -> Iterator[Path]:
    """A temporary folder whose files `names` appear in `path` together when the block ends well, and vanish otherwise.

    Files of an earlier study in `path` are replaced, other files stay; left_by: function that names those of an earlier one.
    Raises SceneError, before the block runs, where `path` cannot be written and where a file in the way is not from an earlier study.
    """
    path = path.absolute()
    if os.path.lexists(path) and not path.is_dir():
        raise SceneError(f"Argument `--out` must be a folder, but `{path}` is something else.")
    exists = path.is_dir()
    earlier = (left_by or _earlier_study)(path) if exists else set()
    for name in names:
        if exists and (path / name).exists() and name not in earlier:
            raise SceneError(f"Argument `--out` must not hide your own files, but `{path / name}` is not from an earlier study.")
    ground = path if exists else next(parent for parent in path.parents if parent.exists())
    shelter = ground / f".stickslip-{secrets.token_hex(8)}"  # named before it exists, so that an interrupt leaves nothing behind
    folder = shelter / "study"
    try:
        try:
            shelter.mkdir(mode=0o700)
            folder.mkdir()
        except OSError as error:
            raise SceneError(f"Argument `--out` must be a folder that can be written, but `{path}` cannot: {error.strerror}.") from None
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
    from toolbox.study import Row

    try:
        with (path / "table.csv").open(newline="", encoding="utf-8") as file:
            table = csv.DictReader(file)
            if table.fieldnames != [field.name for field in dataclasses.fields(Row)]:
                return set()
            stems = [row["files"] for row in table if row["files"]]
    except (OSError, ValueError, csv.Error):
        return set()
    names = {*COMMON_FILES, *(stem + tail for stem in stems if stem == Path(stem).name for tail in CASE_FILES)}
    return {name for name in names if (path / name).is_file()}


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C has no effect on the block (where signals can be handled at all)."""
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:  # not the main thread
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
