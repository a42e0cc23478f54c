"""stickslip compare: two saved runs by their measures, or two scenes by their keys."""

from __future__ import annotations

import argparse
import contextlib
from pathlib import Path
from typing import Any

from toolbox.commands import figures
from toolbox.commands.recording import results
from toolbox.commands.terminal import drawn_as, earlier, figure_format, plain, show
from toolbox.errors import SceneError
from toolbox.files.units import parse

COMPARE_FILES = ("compare.txt", "compare.png")
SCENES = ("first.toml", "second.toml")
BEGINNING = "Comparison of "


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip compare`."""
    comparison = commands.add_parser(
        "compare",
        description="Compare two runs that were saved (.npz, as simulate and study write them, or a folder that holds one such file): how long and how often "
        "they stick, and the extrema, mean and severity of their signals. Or compare two scenes (.toml): the keys whose values differ. With --out, the folder "
        "gets the report and both scenes, or, for runs, a figure with both over one another.",
        epilog="example: stickslip compare out/01_stiff_pi.npz out/02_soft_torque.npz --after '40 s'",
    )
    comparison.add_argument("first", type=Path, metavar="FIRST", help="a saved run, a folder that holds one, or a scene")
    comparison.add_argument("second", type=Path, metavar="SECOND", help="another of the same kind")
    comparison.add_argument(
        "--signal", action="append", metavar="NAME", help="a signal of the runs; may be repeated; without, what a plot shows"
    )
    comparison.add_argument(
        "--measure",
        action="append",
        default=[],
        metavar="NAME",
        help="a further measure of the runs, of `stickslip list measures`; may be repeated",
    )
    comparison.add_argument("--after", type=plain, default=0.0, metavar="T", help="measure from this time on: seconds, or with a unit (0)")
    comparison.add_argument("--until", type=plain, metavar="T", help="measure up to this time; the end of the shorter run without")
    comparison.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for report and figure; those of an earlier comparison are replaced"
    )
    figure_format(comparison)
    comparison.set_defaults(action=run, spelled={"signals": "--signal", "measures": "--measure", "first": "FIRST", "second": "SECOND"})


def run(given: argparse.Namespace) -> int:
    """Compare two files. Returns the exit code."""
    from toolbox.scenes.differences import compare
    from toolbox.scenes.scene import Scene
    from toolbox.simulation.saved_run import SavedRun

    paths = _run_of(given.first), _run_of(given.second)
    kinds = {path.suffix.lower() for path in paths}
    if kinds not in ({".toml"}, {".npz"}):
        raise SceneError(
            f"Arguments `FIRST` and `SECOND` must be two runs (.npz) or two scenes (.toml), but they are `{paths[0]}` and `{paths[1]}`."
        )
    scenes = kinds == {".toml"}
    labels = tuple(path.stem if paths[0].stem != paths[1].stem else str(path) for path in paths)
    after = parse(given.after, "s", "--after")
    until = None if given.until is None else parse(given.until, "s", "--until")
    first, second = (Scene.load(path) if scenes else SavedRun.read(path) for path in paths)
    found = compare(first, second, signals=given.signal, metrics=given.measure, after=after, until=until, labels=labels)  # type: ignore[arg-type]
    given.found = found
    files = [*COMPARE_FILES[:1], *SCENES] if scenes else drawn_as(COMPARE_FILES, given.format)
    with results(given, files, earlier("compare.txt", f"^{BEGINNING}", [*COMPARE_FILES, *SCENES])) as folder:
        if folder is not None:
            (folder / "compare.txt").write_text(f"{BEGINNING}{paths[0]} and {paths[1]}\n\n{found}\n", encoding="utf-8")
            for name, scene in zip(SCENES, (first, second), strict=True) if scenes else ():
                scene.save(folder / name)  # type: ignore[union-attr]
            if not scenes:
                figures.draw_overlay(
                    dict(zip(labels, (first, second), strict=True)), given.signal or (), after, until, folder / f"compare.{given.format}"
                )
    show(str(found))
    if given.out:
        print(f"\n{'Report and scenes are' if scenes else 'Report and figure are'} in {given.out}")
    return 0


def _run_of(path: Path) -> Path:
    """The file that is meant: the one run of a folder, or the path itself. Raises SceneError for a folder that holds none or several."""
    from toolbox.simulation.saved_run import SavedRun

    if not path.is_dir():
        return path
    runs = []
    for file in sorted(path.glob("*.npz")):
        with contextlib.suppress(SceneError):  # of what other commands found
            SavedRun.read(file)
            runs.append(file)
    if len(runs) != 1:
        held = f"{len(runs)}: give one of {', '.join(f'`{file}`' for file in runs)}" if runs else "none"
        raise SceneError(f"Folder `{path}` must hold one run (.npz), as simulate and study write it, but it holds {held}.")
    return runs[0]
