"""stickslip chance: the chance of stick-slip over one or two numbers, where other numbers are known as distributions only."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any

from toolbox.arguments import numbers
from toolbox.commands.interrupt import goes_on
from toolbox.commands.recording import answer
from toolbox.commands.starting import add_start, start_given
from toolbox.commands.terminal import asked_otherwise, common, loaded, plain, ranges
from toolbox.commands.uncertainty import add_uncertain, left_out, uncertain_of, with_numbers
from toolbox.errors import SceneError
from toolbox.files.unit_systems import asked_in


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip chance`."""
    verb = commands.add_parser(
        "chance",
        parents=[common("folder for table, figure and data; that of an interrupted search is continued")],
        description="Simulate every controller of a scene at all points with the same draws of what is uncertain, and print the chance of stick-slip with its "
        "bounds by Clopper and Pearson, and the lowest set-point that is free with 95 %. Every run begins where the scene begins, or as --start says.",
        epilog="example: stickslip chance studies/scenes/jansen_2.toml --range top.reference='40 rpm:140 rpm:11' --uncertainty bit.weight='97 kN +- 8 kN' "
        "--uncertainty bit.friction.static=0.7:0.9 --controller 'stiff PI' --draws 200 --out chances",
    )
    verb.add_argument(
        "--range",
        action="append",
        required=True,
        metavar="NAME=LOW:HIGH:N",
        help="what varies, with its number of values; once or twice, the set-point first",
    )
    add_uncertain(verb)
    asked_otherwise(verb)
    verb.add_argument("--draws", type=int, default=200, metavar="N", help="machines at every point (200)")
    verb.add_argument("--duration", type=plain, metavar="T", help="of a run; forty swings after the start without")
    add_start(verb, "where the scene begins")
    verb.add_argument("--accuracy", type=float, default=1e-4, metavar="X", help="of the runs (1e-4)")
    verb.add_argument("--confidence", type=float, default=0.95, metavar="P", help="of the bounds (0.95)")
    verb.add_argument("--seed", type=int, default=0, metavar="S", help="of the draws (0)")
    verb.set_defaults(
        action=run,
        spelled={"uncertainty": "--uncertainty", "others": "--uncertainty"},
        words=lambda given: goes_on(given.out),
    )


def run(given: argparse.Namespace) -> int:
    """Find the chances. Returns the exit code."""
    import numpy as np

    from toolbox.probability.chances import chance

    scene = loaded(given)
    varied = ranges("--range", given.range, counted=True)
    loops, failures = with_numbers(scene, [scene.case(each).label for each in given.controller or scene.labels], [*varied])
    left_out(failures)
    first = next(iter(loops.values()))
    over: dict[str, Any] = {}
    asked: dict[str, str] = {}
    for name, (low, high, count) in varied.items():
        ends = numbers(name, (low, high), first.number(name).unit)
        if not ends[0] < ends[1] and count > 1:
            raise SceneError(f"Argument `{name}` must be a range LOW:HIGH with LOW < HIGH, but it is {low}:{high}.")
        over[name] = np.linspace(ends[0], ends[1], count).tolist()
        if unit := asked_in(ends, ""):
            asked[first.number(name).unit] = unit
    found = chance(
        loops,
        over,
        uncertain_of(given),
        draws=given.draws,
        duration=given.duration,
        starts=start_given(given, scene),
        accuracy=given.accuracy,
        confidence=given.confidence,
        seed=given.seed,
        checkpoint=given.out,
    )
    found = dataclasses.replace(found, title=scene.title, display_units={**found.display_units, **asked})
    return answer(given, "chance", found, scene, "^Chance of stick-slip: ", "Table, figure and data are", last=False)
