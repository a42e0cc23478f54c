"""stickslip schedule: the gains of a law over the depth of a well, checked at every depth and halfway between."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import cache
from typing import Any

from toolbox.arguments import number
from toolbox.commands.recording import answer
from toolbox.commands.starting import add_start, start_given
from toolbox.commands.terminal import common, plain
from toolbox.errors import SceneError

DRIVE = ("drive.c", "drive.h", "drive_depth.c")
"""The law in C, and its table."""


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip schedule`."""
    verb = commands.add_parser(
        "schedule",
        parents=[
            common("folder for report, table, figure, and C for a drive", controller="the law; the first one of the scene without"),
        ],
        description="Design a law at depths of a well, where the first section of the string is longer or shorter, interpolate its gains between them, and "
        "check it at every depth and halfway between: disk margin, growth of smooth running, and runs. A law that designs itself, such as SoftTorque, changes "
        "with depth; numbers that the scene gives stay.",
        epilog="example: stickslip schedule studies/scenes/deepening_well.toml --depths 1000m 2000m 3000m --start 'takeover:stiff PI' --out gains",
    )
    depths_of_well(verb)
    add_start(verb, "smooth running")
    verb.add_argument("--duration", metavar="T", help="of a run; that of the scene without")
    verb.set_defaults(action=run, spelled={"depths": "--depths"})


def depths_of_well(verb: argparse.ArgumentParser) -> None:
    """Declare the argument `--depths`."""
    verb.add_argument("--depths", nargs="+", required=True, metavar="DEPTH", help="depths of the bit: metres, or such as '2 km' or 9000ft")


def run(given: argparse.Namespace) -> int:
    """Make the schedule. Returns the exit code."""
    from toolbox.drilling.gain_schedule import schedule
    from toolbox.export.scheduled_c import export_schedule
    from toolbox.modelling.laws import Sampled

    scene, law, well = law_and_well(given)
    starts = start_given(given, scene)
    duration = scene.duration if given.duration is None else number("--duration", plain(given.duration), "s", above=0)
    found = schedule(well, given.depths, law, duration, starts=starts)
    drive = (lambda folder: export_schedule(found, well(found.depths[0]), folder / "drive")) if isinstance(law, Sampled) else None
    told = "Report, table, figure and C for the drive are" if drive else "There is no C of a continuous law. Report, table and figure are"
    return answer(given, "schedule", found, scene, "^Gains over depth", told, also=DRIVE, more=drive)


def law_of(scene: Any, label: str, must: str = "be one law to be looked at over depth") -> Any:
    """The one law of a controller of a scene. Raises SceneError, which says what it must be, for any other number of laws."""
    laws = scene[label].controllers
    if len(laws) != 1:
        raise SceneError(f"Controller `{label}` must {must}, but it has {len(laws)}.")
    return laws[0]


def law_and_well(given: argparse.Namespace) -> tuple[Any, Any, Callable[[float], Any]]:
    """(scene at the first depth, law, function depth -> machine without laws) of the arguments. Raises SceneError where the scene knows one depth only."""
    from toolbox.scenes.scene import Scene

    given.depths = [plain(text) for text in given.depths]
    scene = Scene.load(given.scene, depth=given.depths[0])
    label = scene.case(given.controller or next((each for each in scene.labels if scene[each].controllers), scene.labels[0])).label
    law = law_of(scene, label)
    moved = sorted(name for name in scene[label].inputs if name not in scene[label].without_controllers.inputs)
    if moved:
        raise SceneError(
            f"Argument `{moved[0]}` must be a number of the law itself to be looked at over depth, but it is an input of the scene."
        )

    @cache
    def well(depth: float) -> Any:
        return Scene.load(given.scene, depth=depth)[label].without_controllers

    return scene, law, well
