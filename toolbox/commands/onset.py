"""stickslip onset: where stick-slip begins and where it ends over one parameter."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.arguments import number, whole
from toolbox.commands import figures
from toolbox.commands.interrupt import goes_on
from toolbox.commands.recording import answer, results
from toolbox.commands.starting import add_start, one_law, start_given
from toolbox.commands.terminal import (
    Ended,
    asked_otherwise,
    check_some,
    common,
    drawn_as,
    earlier,
    file_stems,
    loaded,
    numbers,
    plain,
    progress,
    ranges,
    show,
)
from toolbox.commands.uncertainty import add_uncertain, left_out, uncertain_of, with_numbers
from toolbox.errors import SceneError, SimulationError
from toolbox.files.unit_systems import asked_in

if TYPE_CHECKING:
    from toolbox.modelling.closed_loop import ClosedLoop
    from toolbox.onsets.comparison import Comparison
    from toolbox.scenes.scene import Scene

ONSET_FILES = ("onset.png", "onset.txt", "scene.toml")
TABLES = ("onset.csv", "borders.csv", "onset.npz")


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip onset`."""
    border = commands.add_parser(
        "onset",
        parents=[
            common("folder for figure, report and tables; an interrupted search goes on from it, results of an earlier one are replaced")
        ],
        description="Simulate every controller of a scene from smooth running and from inside stick-slip over one parameter or input, find both borders, "
        "and print them with the Hopf point and the margin at the working point. With --out, the folder gets a figure, the report, the scene, and "
        "per controller two tables (csv), runs and borders, and all arrays (npz): all of it, or nothing. Where numbers are known as distributions only "
        "(--uncertainty, --posterior), machines are drawn: printed is the border of stick-slip of each after a start, and from where 95 % of them are free.",
        epilog="example: stickslip onset studies/scenes/jansen_2.toml --range top.reference='10 rpm:150 rpm' --out borders",
    )
    border.add_argument(
        "--range",
        required=True,
        metavar="NAME=LOW:HIGH",
        help="an input, or a parameter of the plant or of a controller, and its range: SI, or '10 rpm:150 rpm'",
    )
    border.add_argument("--at", metavar="VALUE", help="working point whose margin is reported; the value of the scene without")
    border.add_argument("--values", type=int, default=13, metavar="N", help="values at which both branches are simulated (13)")
    border.add_argument("--tolerance", metavar="X", help="of the borders; a thousandth of the range without")
    border.add_argument(
        "--initial-controller",
        metavar="LABEL",
        help="the controller whose stick-slip is taken over where stick-slip exists beside smooth running; those from rest, kicks and others are tried without",
    )
    add_uncertain(border)
    border.add_argument("--draws", type=int, default=200, metavar="N", help="machines, where numbers are uncertain (200)")
    add_start(border, "with uncertain numbers, where the scene begins")
    asked_otherwise(border)
    border.set_defaults(action=run, spelled={"bounds": "--range"}, words=lambda given: goes_on(given.out))


def run(given: argparse.Namespace) -> int:
    """Find the borders of stick-slip. Returns the exit code."""
    from toolbox.files.journal import OtherSearch
    from toolbox.onsets.comparison import Comparison
    from toolbox.onsets.onset import onset
    from toolbox.sweeps.store import folder_of

    scene = loaded(given)
    labels = [scene.case(label).label for label in given.controller or scene.labels]
    ((parameter, typed),) = ranges("--range", [given.range]).items()
    loops, failures = with_numbers(scene, labels, [parameter], "onset")
    unit = next(iter(loops.values())).number(parameter).unit
    low, high = numbers("--range", typed, unit)
    at = None if given.at is None else number("--at", plain(given.at), unit)
    tolerance = None if given.tolerance is None else number("--tolerance", plain(given.tolerance), unit, above=0.0)
    if not low < high:
        raise SceneError(f"Argument `--range` must be {parameter}=LOW:HIGH with LOW < HIGH, but it is `{given.range}`.")
    whole("--values", given.values, 3)
    if given.uncertainty or given.posterior:
        left_out(failures)
        return _uncertain(given, scene, loops, parameter, (low, high), tolerance)
    if given.start is not None:
        raise SceneError("Argument `--start` must stand beside `--uncertainty` or `--posterior`: without, both branches are followed.")
    initial = None if given.initial_controller is None else one_law(scene, "--initial-controller", given.initial_controller)
    onsets = {}
    stems = file_stems(labels)
    names = [*drawn_as(ONSET_FILES, given.format), *(f"{stem}_{table}" for stem in stems for table in TABLES)]
    left = [*ONSET_FILES, *(f"[0-9][0-9]_*_{table}" for table in TABLES)]
    if given.out is not None:
        folder_of(given.out)
    kept = {
        label: None if given.out is None else Path(given.out) / f"{stem}_onset.jsonl" for label, stem in zip(labels, stems, strict=True)
    }
    tell = None if given.quiet else Ended(list(loops))
    with results(given, names, earlier("onset.txt", "Onset of stick-slip", left)) as folder:
        with progress(len(labels)) as reached:
            for i, label in enumerate(labels):
                reached(i, label)
                if label not in loops:
                    continue
                try:
                    loop = loops[label] if at is None else loops[label].at(parameter, at)
                    onsets[label] = onset(
                        loop, parameter, (low, high), num_values=given.values, tolerance=tolerance, initial_controller=initial,
                        checkpoint=kept[label],
                    )  # fmt: skip
                    if tell is not None:
                        tell(label)
                except OtherSearch:
                    raise
                except (SceneError, SimulationError) as error:
                    failures[label] = error
        check_some(failures, labels)
        found = Comparison(onsets, {label: str(failures[label]) for label in labels if label in failures})
        given.found = {"title": scene.title, "onsets": onsets, "failed": found.failures}
        given.failures = found.failures
        text = "\n\n".join([scene.title, *(str(each) for each in onsets.values()), str(found)]) + "\n"
        if folder is not None:
            (folder / "onset.txt").write_text(text, encoding="utf-8")
            _save(scene, found, dict(zip(labels, stems, strict=True)), folder, given.format)
    for path in kept.values():
        if path is not None:
            path.unlink(missing_ok=True)
    show(text.rstrip("\n"))
    if given.out:
        print(f"\n{'Figure, report and tables are' if onsets else 'The report is'} in {given.out}")
    return 0 if onsets else 1


def _uncertain(
    given: argparse.Namespace,
    scene: Scene,
    loops: dict[str, ClosedLoop],
    parameter: str,
    bounds: tuple[float, float],
    tolerance: float | None,
) -> int:
    """Find the borders of machines whose numbers are drawn. Returns the exit code."""
    from toolbox.probability.drawn_borders import uncertain_onset

    if given.at is not None:
        raise SceneError(
            "Argument `--at` must not be given with `--uncertainty` or `--posterior`, because the margin of draws is not told."
        )
    found = uncertain_onset(
        loops,
        parameter,
        bounds,
        uncertain_of(given),
        draws=given.draws,
        num_values=given.values,
        tolerance=tolerance,
        starts=start_given(given, scene),
    )
    unit = loops[next(iter(loops))].number(parameter).unit
    typed = numbers("--range", ranges("--range", [given.range])[parameter], unit)
    asked = {unit: shown} if (shown := asked_in(typed, "")) else {}
    found = dataclasses.replace(found, title=scene.title, display_units={**found.display_units, **asked})
    return answer(given, "drawn_onset", found, scene, "Onset of stick-slip over", "Report, figure and tables are")


def _save(scene: Scene, borders: Comparison, stems: Mapping[str, str], folder: Path, picture: str) -> None:
    """Write the results of every label, the scene, and the figure in the format `picture`."""
    for label, found in borders.onsets.items():
        found.save(folder / f"{stems[label]}_onset.npz")
        found.save(folder / f"{stems[label]}_onset.csv")
        found.save_borders(folder / f"{stems[label]}_borders.csv")
    scene.save(folder / "scene.toml")
    if borders.onsets:
        figures.draw_found(borders, scene.title, folder / f"onset.{picture}")
