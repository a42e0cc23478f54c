"""stickslip basin: from which part of a box of disturbances a working point comes back, and the smallest that tips it."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any

from toolbox.commands.recording import answer
from toolbox.commands.terminal import asked_otherwise, common, loaded, plain, ranges


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip basin`."""
    verb = commands.add_parser(
        "basin",
        parents=[
            common(
                "folder for report, table and figure; those of an earlier call are replaced",
                controller="the controller whose working point is disturbed; the first one of the scene without",
            )
        ],
        description="Disturb states of the steady running of a scene, drawn evenly from a box, and count from which it comes back, with bounds by Clopper and "
        "Pearson. A short bump of torque is a jump of a speed: its impulse over the inertia.",
        epilog="example: stickslip basin studies/scenes/jansen_2.toml --controller 'stiff PI' --box bit.speed='0 rpm:290 rpm' --runs 500 --out basin",
    )
    verb.add_argument(
        "--box", action="append", required=True, metavar="STATE=LOW:HIGH", help="a state that is disturbed, and its range; may be repeated"
    )
    asked_otherwise(verb)
    verb.add_argument("--runs", type=int, default=1000, metavar="N", help="disturbances (1000)")
    verb.add_argument("--duration", type=plain, metavar="T", help="of a run; forty swings without")
    verb.add_argument("--accuracy", type=float, default=1e-4, metavar="X", help="of the runs (1e-4)")
    verb.add_argument("--confidence", type=float, default=0.95, metavar="P", help="of the bounds (0.95)")
    verb.add_argument("--seed", type=int, default=0, metavar="S", help="of the draws (0)")
    verb.set_defaults(action=run, spelled={"box": "--box"})


def run(given: argparse.Namespace) -> int:
    """Find the basin. Returns the exit code."""
    from toolbox.probability.basins import basin

    scene = loaded(given)
    loop = scene[given.controller or scene.labels[0]]
    box = ranges("--box", given.ranges)
    found = basin(loop, box, given.runs, duration=given.duration, accuracy=given.accuracy, confidence=given.confidence, seed=given.seed)
    return answer(given, "basin", dataclasses.replace(found, title=scene.title), scene, "^Basin of ", "Report, table and figure are")
