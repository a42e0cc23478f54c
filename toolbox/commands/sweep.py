"""stickslip sweep and stickslip map: a scene over grids of its numbers."""

from __future__ import annotations

import argparse
import dataclasses
import textwrap
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.arguments import numbers
from toolbox.commands import figures
from toolbox.commands.interrupt import goes_on
from toolbox.commands.recording import results
from toolbox.commands.terminal import (
    asked_otherwise,
    check_known,
    check_some,
    common,
    drawn_as,
    earlier,
    file_stems,
    loaded,
    ranges,
    share,
    show,
)
from toolbox.errors import SceneError, SimulationError
from toolbox.files.printing import columns
from toolbox.files.unit_systems import asked_in
from toolbox.messages import LOG

if TYPE_CHECKING:
    from toolbox.sweeps.designs import Variations

SAMPLINGS = ("grid", "random", "latin-hypercube", "sobol")

SWEEP_FILES = ("sweep.txt", "sweep.csv", "scene.toml")
MAP_FILES = ("map.txt", "map.png", "map.csv", "borders.csv", "scene.toml")


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip sweep` and `stickslip map`."""
    many = commands.add_parser(
        "sweep",
        parents=[common("folder for the results; that of an interrupted sweep is continued", required=True, drawn=False)],
        description="Simulate every controller of a scene over a grid, a design or a table of inputs and parameters. The folder gets one folder per controller "
        "with the result (sweep.zarr, written as runs finish, and sweep.csv in SI units); an interrupted sweep that is called again goes on where it was.",
        epilog="example: stickslip sweep studies/scenes/jansen_2.toml --range bit.weight=50kN:110kN:20 --range top.reference=3:14:50 "
        "--controller 'stiff PI' --metric severity --out swept;   ... --range bit.weight=50kN:110kN --range top.reference=3:14 --sampling sobol "
        "--runs 1024;   ... --rows runs.csv, with headings such as `bit.weight [kN]`",
    )
    many.add_argument(
        "--range",
        action="append",
        default=[],
        metavar="NAME=LOW:HIGH[:N]",
        help="range of an input or parameter, for a grid with its number of values; SI, or with units (50kN:110kN:20); may be repeated",
    )
    many.add_argument("--sampling", choices=SAMPLINGS, default="grid", help="where in the ranges of --range the runs lie (grid)")
    many.add_argument("--runs", type=int, metavar="N", help="how many, where the sampling is no grid; a power of two for sobol")
    many.add_argument("--seed", type=int, default=0, metavar="S", help="of a sampling with random numbers (0)")
    many.add_argument(
        "--rows",
        type=Path,
        metavar="FILE.csv",
        help="a run for every row of a table whose headings are names with units, in place of --range",
    )
    many.add_argument(
        "--metric",
        action="append",
        metavar="NAME",
        help="what is measured, of `stickslip list metrics` (severity, stuck_ratio); may be repeated",
    )
    asked_otherwise(many)
    many.set_defaults(action=run, spelled={"metrics": "--metric", "ranges": "--range"}, words=lambda given: goes_on(given.out))
    chart = commands.add_parser(
        "map",
        parents=[common("folder for the results; that of an interrupted map is continued", required=True)],
        description="Simulate every controller of a scene over two inputs or parameters, from smooth running and from inside stick-slip, find the linear and "
        "both simulated borders, print and draw them. The folder gets one folder per controller with figure, report and data (map.npz, "
        "map.csv, borders.csv); an interrupted map that is called again goes on where it was.",
        epilog="example: stickslip map studies/scenes/jansen_2.toml --range top.reference=3:14 --range bit.weight=50kN:110kN --controller 'stiff PI' "
        "--out mapped;   groan of a brake: stickslip map studies/scenes/brake_stop.toml --law HeldSpeed "
        "--range disc.reference=0.05:5 --range brake.force=0.1kN:4kN --uncertainty pad.friction.static,pad.friction.kinetic=20% --out groan",
    )
    two_ranges(chart, "what varies along the first axis, then along the second one; SI, or with units (50kN:110kN)")
    chart.add_argument("--shape", default="50x50", metavar="NxM", help="points along both axes (50x50)")
    chart.add_argument(
        "--logarithmic",
        action="append",
        default=[],
        metavar="NAME",
        help="number of --range whose values are spaced by their logarithm; may be repeated",
    )
    asked_otherwise(chart)
    chart.add_argument(
        "--uncertainty",
        metavar="NAME[,NAME...]=PART",
        help="numbers that are lower and higher by this part together (20%%), on two more maps, and what is left of the declared one",
    )
    chart.set_defaults(
        action=run_map, spelled={"ranges": "--range", "logarithmic": "--logarithmic"}, words=lambda given: goes_on(given.out)
    )


def two_ranges(verb: argparse.ArgumentParser, what: str) -> None:
    """Declare the ranges of two numbers."""
    verb.add_argument("--range", action="append", required=True, metavar="NAME=LOW:HIGH", help=f"{what}; twice")


def run(given: argparse.Namespace) -> int:
    """Sweep a scene over a grid, a design or a table. Returns the exit code."""
    from toolbox.sweeps.sweep import sweep

    scene = loaded(given)
    labels = [scene.case(label).label for label in given.controller or scene.labels]
    goes_on = _goes_on()
    given.found = {}
    failed = 0
    for label, stem in zip(labels, file_stems(labels), strict=True):
        variations, folder = _variations(given, scene, label), given.out / stem
        store = folder / "sweep.zarr" if goes_on else None
        found = sweep(scene[label], variations, metrics=given.metric or ("severity", "stuck_ratio"), checkpoint=store)
        with results(given, [*SWEEP_FILES, *(["sweep.npz"] if store is None else [])], _left, folder, last=False) as made:
            if store is None:
                found.save(made / "sweep.npz")
            found.save(made / "sweep.csv")
            (made / "sweep.txt").write_text(f"{dataclasses.replace(found, seconds=0.0)}\n", encoding="utf-8")
            scene.save(made / "scene.toml")
        given.found[label] = found
        failed += len(found.failures) == found.runs
        show(f"{found}\n")
    print(f"Results are in {given.out}")
    return 1 if failed == len(labels) else 0


def _left(folder: Path) -> set[str]:
    """Names of the files that an earlier sweep left in a folder, beside what holds its runs."""
    if not any((folder / name).exists() for name in ("sweep.zarr", "sweep.npz")):
        return set()
    return {name for name in (*SWEEP_FILES, "sweep.npz") if (folder / name).is_file()}


def _goes_on() -> bool:
    """Whether results can be written as they come; says so where they cannot."""
    from importlib.util import find_spec

    found = all(find_spec(name) for name in ("zarr", "xarray"))
    if not found:
        LOG.warning("without zarr an interrupted call starts again from nothing: pip install -e '.[batch]' in the folder of the toolbox")
    return found


def _variations(given: argparse.Namespace, scene: Any, label: str) -> Variations:
    """What the arguments of `stickslip sweep` vary, under one controller; raises SceneError for arguments that make no sense."""
    import numpy as np

    from toolbox.sweeps import designs

    if bool(given.range) == bool(given.rows):
        raise SceneError(
            "Argument `--range` must be given, or `--rows`, but not both."
            if given.rows
            else "Argument `--range` must be given, or `--rows`."
        )
    if given.sampling == "grid" and given.runs is not None:
        raise SceneError("Argument `--runs` must come with a `--sampling` other than grid, whose ranges say how many.")
    if given.sampling != "grid" and (given.runs is None or given.rows):
        raise SceneError(
            f"Argument `--sampling` must come with {'`--range`, not `--rows`' if given.rows else '`--runs`'}, but it is {given.sampling}."
        )
    if given.rows:
        return _rows(given.rows, scene, label)
    counted = given.sampling == "grid"
    parts = ranges("--range", given.range, counted=counted)
    check_known(scene, scene.labels, parts)
    spans = {name: numbers(name, ends[:2], scene[label].number(name).unit) for name, ends in parts.items()}
    if counted:
        for name, (low, high) in spans.items():
            if not low < high and parts[name][2] > 1:
                raise SceneError(
                    f"Argument `{name}` must be a range LOW:HIGH with LOW < HIGH, but it is {parts[name][0]}:{parts[name][1]}."
                )
        made = designs.grid({name: np.linspace(low, high, parts[name][2]) for name, (low, high) in spans.items()})
        return dataclasses.replace(made, display_units={name: unit for name, ends in spans.items() if (unit := asked_in(ends, ""))})
    design = {"random": designs.uniform, "latin-hypercube": designs.latin_hypercube, "sobol": designs.sobol}[given.sampling]
    return design({name: (low, high) for name, (low, high) in spans.items()}, given.runs, given.seed)


def _rows(path: Path, scene: Any, label: str) -> Variations:
    """The rows of a table of numbers that vary."""
    from toolbox.files.tables import Column, read
    from toolbox.sweeps import designs

    known = scene[label].variable_numbers().values()
    return designs.listed(read(path, [Column(number.name, number.unit, required=False) for number in known]))


def shape_of(text: str) -> tuple[int, int]:
    """The points along both axes of `--shape`, written as 50x50. Raises SceneError for another form."""
    words = text.split("x")
    if len(words) != 2 or not all(word.isdigit() and int(word) >= 2 for word in words):
        raise SceneError(f"Argument `--shape` must be two numbers >= 2 such as 50x50, but it is `{text}`.")
    return int(words[0]), int(words[1])


def run_map(given: argparse.Namespace) -> int:
    """Map the severity of stick-slip over two numbers. Returns the exit code."""
    from toolbox.onsets.severity_map import severity_map
    from toolbox.sweeps.store import folder_of

    scene = loaded(given)
    labels = [scene.case(label).label for label in given.controller or scene.labels]
    shape = shape_of(given.shape)
    over = ranges("--range", given.range, exactly=2)
    check_known(scene, labels, over)
    failures: dict[str, Exception] = {}
    given.found = {}
    new = not given.out.exists()
    folder_of(given.out)  # before a controller without these numbers is told in its place
    for label, stem in zip(labels, file_stems(labels), strict=True):
        machines: dict[str, Any] = {}
        try:
            names_off, loops = _machines(scene[label], given.uncertainty)
            several = f"{len(names_off)} numbers" if len(names_off) > 2 else ", ".join(names_off)
            for words, loop in loops.items():
                folder = given.out / (stem if not words else f"{stem}_{words.split()[0].replace('-', 'less').replace('+', 'more')}")
                name = f"{label}, {several} {words}" if words else label
                found = severity_map(loop, over, shape=shape, logarithmic=given.logarithmic, checkpoint=folder)
                told = "\n\n".join([str(found), *(str(found.border_points(border)) for border in found.borders)])
                machines[words] = given.found[name] = found
                names = drawn_as(MAP_FILES, given.format)
                left = earlier("map.txt", "^Severity map of ", MAP_FILES)
                with results(given, names, left, folder, last=False, beside=("map.npz",)) as made:
                    (made / "map.txt").write_text(f"{told}\n", encoding="utf-8")
                    found.to_csv(made / "map.csv")
                    found.save_borders(made / "borders.csv")
                    scene.save(made / "scene.toml")
                    figures.draw_found(found, f"{scene.title}: {name}", made / f"map.{given.format}")
                show(f"{told}\n" if not words else f"{several} {words}\n{told}\n")
        except (SceneError, SimulationError) as error:
            failures[label] = error
            continue
        if given.uncertainty:
            show(_left_of(machines, names_off) + "\n")
    if new and not given.found:
        with suppress(OSError):
            given.out.rmdir()  # where it is empty
    check_some(failures, labels)
    for label, failure in failures.items():
        print(f"{label}: {failure}\n")
    if given.found:
        print(f"Figures, reports and data are in {given.out}")
    return 1 if len(failures) == len(labels) else 0


def _machines(loop: Any, off: str | None) -> tuple[list[str], dict[str, Any]]:
    """The numbers of `--uncertainty`, and {words: loop}: the declared machine without words, and those where they are lower and higher."""
    if off is None:
        return [], {"": loop}
    listed, _, text = off.partition("=")
    names = [name.strip() for name in listed.split(",") if name.strip()]
    text = text.strip()
    if not names or not text:
        raise SceneError(f"Argument `--uncertainty` must be NAME[,NAME...]=PART such as pad.friction.static=20%, but it is `{off}`.")
    from toolbox.modelling.numbers import put_all

    off_by, found = share("--uncertainty", text), {"": loop}
    for sign in (-1.0, 1.0):
        changed = {name: loop.varied_number(name).value * (1.0 + sign * off_by) for name in names}
        found[f"{100.0 * sign * off_by:+g} %"] = put_all(loop, changed)
    return names, found


def _left_of(machines: dict[str, Any], names: Sequence[str]) -> str:
    """How much of the map is free on every machine, and on all of them, as text. names: the numbers that are off."""
    import numpy as np

    free = {words or "nominal": found.regions["free"] for words, found in machines.items()}
    rows = [(words, f"{100.0 * where.mean():.1f} %") for words, where in free.items()]
    rows.append(("on all of them", f"{100.0 * np.logical_and.reduce(list(free.values())).mean():.1f} %"))
    told = textwrap.wrap("Off together: " + ", ".join(names), 100, break_on_hyphens=False)
    return "\n".join(["Share of the map that is free", *columns(rows), *told])
