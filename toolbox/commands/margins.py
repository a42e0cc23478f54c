"""stickslip margins: what every controller of a scene bears at its working point, and how wrong its model may be."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.arguments import number
from toolbox.commands import figures
from toolbox.commands.recording import results
from toolbox.commands.starting import add_start, start_given
from toolbox.commands.terminal import (
    asked_otherwise,
    check_known,
    check_some,
    common,
    drawn_as,
    earlier,
    file_stems,
    loaded,
    pairs,
    plain,
    progress,
    ranges,
    share,
    show,
)
from toolbox.errors import SceneError, SimulationError

if TYPE_CHECKING:
    from toolbox.scenes.scene import Scene

FILES = ("margins.txt", "scene.toml")
EACH = ("margins.npz", "margins.csv", "margins.png", "error.npz", "error.csv", "error.png")

DURATION = "60 s"
"""Length of the runs that the search for the smallest error takes, where nobody says."""


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip margins`."""
    verb = commands.add_parser(
        "margins",
        parents=[common("folder for report, tables, figures and data; those of an earlier call are replaced")],
        description="Linearise every controller of a scene where it runs steadily and print its margins. With --uncertainty, also find the smallest "
        "joint error of these numbers with which the machine itself fails, in parts of their ranges, beside the bound by mu.",
        epilog="example: stickslip margins studies/scenes/jansen_2.toml --controller 'soft torque' --uncertainty bit.weight=20% "
        "--uncertainty chain.inertia.0=30% --out robust",
    )
    verb.add_argument(
        "--uncertainty",
        action="append",
        default=[],
        metavar="NAME=RANGE",
        help="a number that may be wrong, by a part NAME=20%% or within NAME=LOW:HIGH; `delay` is that of sampled laws; may be repeated",
    )
    verb.add_argument("--duration", metavar="T", help=f"of the runs with --uncertainty ({DURATION})")
    add_start(verb, "smooth running, with the loop's own stick-slip told beside")
    asked_otherwise(verb)
    verb.set_defaults(action=run, spelled={"uncertainty": "--uncertainty"})


def run(given: argparse.Namespace) -> int:
    """Find margins, and the smallest errors where they are asked for. Returns the exit code."""
    from toolbox.robustness.joint_errors import smallest_error
    from toolbox.robustness.margins import margins

    scene = loaded(given)
    labels = [scene.case(label).label for label in given.controller or [each for each in scene.labels if scene[each].controllers]]
    if not labels:
        raise SceneError(
            "Argument `SCENE.toml` must have a controller, because margins are those of a control law, but none of its cases has one."
        )
    wrong = wrong_numbers("--uncertainty", given.uncertainty)
    check_known(scene, labels, wrong)
    for option, text in (("--duration", given.duration), ("--start", given.start)):
        if text and not wrong:
            raise SceneError(f"Argument `{option}` must stand beside `--uncertainty`: margins need no run of it.")
    starts = start_given(given, scene)
    duration = number("--duration", plain(given.duration or DURATION), "s", above=0)
    found: dict[str, dict[str, Any]] = {}
    failures: dict[str, Exception] = {}
    with progress(len(labels)) as reached:
        for i, label in enumerate(labels):
            reached(i, label)
            try:
                found[label] = {"margins": margins(scene[label])}
                if wrong:
                    found[label]["error"] = smallest_error(scene[label], wrong, duration, starts=starts)
            except (SceneError, SimulationError) as error:
                failures[label] = error
    check_some(failures, labels)
    given.failures = {label: str(error) for label, error in failures.items()}
    given.found = {"title": scene.title, **found, "failed": given.failures}
    told = ["\n".join([label, *map(str, parts.values())]) for label, parts in found.items() if parts]
    text = "\n\n".join([scene.title, *told, *(f"{label}: {error}" for label, error in failures.items())]) + "\n"
    stems = dict(zip(scene.labels, file_stems(scene.labels), strict=True))
    names = [*FILES, *(f"{stem}_{each}" for stem in stems.values() for each in EACH)]
    left = earlier("margins.txt", "Margins of ", [*FILES, *(f"[0-9][0-9]_*_{each}" for each in EACH)])
    with results(given, drawn_as(names, given.format), left) as folder:
        if folder is not None:
            (folder / "margins.txt").write_text(text, encoding="utf-8")
            _save(scene, found, stems, folder, given.format)
    show(text.rstrip("\n"))
    if given.out:
        print(f"\n{'Report, tables and figures are' if any(found.values()) else 'The report is'} in {given.out}")
    return 0 if any(found.values()) else 1


def wrong_numbers(option: str, texts: Sequence[str]) -> dict[str, Any]:
    """{number: part, or (low, high)} of texts NAME=20% and NAME=LOW:HIGH; raises SceneError for other forms, and for a name that is there twice."""
    found: dict[str, Any] = {}
    for name, what in pairs(option, "NAME=20% or NAME=LOW:HIGH", texts):
        if name in found:
            raise SceneError(f"Argument `{option}` must name every number once, but `{name}` is there twice.")
        if ":" in what:
            found[name] = ranges(option, [f"{name}={what}"])[name]
        else:
            found[name] = share(option, what)
    return found


def _save(scene: Scene, found: Mapping[str, Mapping[str, Any]], stems: Mapping[str, str], folder: Path, picture: str) -> None:
    """Write data, table and figure of what was found of every label, and the scene."""
    for label, parts in found.items():
        for name, each in parts.items():
            path = folder / f"{stems[label]}_{name}"
            each.save(path.with_suffix(".npz"))
            each.save(path.with_suffix(".csv"))
            if name == "error" or each.linear_loop is not None:
                figures.draw_found(each, f"{scene.title}: {label}", path.with_suffix(f".{picture}"))
    scene.save(folder / "scene.toml")
