"""stickslip windows: at which speed and weight a law keeps a well smooth, over the depth of the well."""

from __future__ import annotations

import argparse
from typing import Any

from toolbox.commands.interrupt import goes_on
from toolbox.commands.recording import answer
from toolbox.commands.schedule import depths_of_well, law_and_well
from toolbox.commands.sweep import shape_of, two_ranges
from toolbox.commands.terminal import common, plain, ranges


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip windows`."""
    verb = commands.add_parser(
        "windows",
        parents=[
            common(
                "folder for report, table, data and figure, and the map of each depth; interrupted windows are continued",
                controller="the law; the first one of the scene without",
            )
        ],
        description="Map both branches of a machine at depths of a well, where the first section of the string is longer or shorter, and print from which "
        "value of the first number on the machine is smooth, from which on stick-slip ends as well, and how far the working point is from both.",
        epilog="example: stickslip windows studies/scenes/deepening_well.toml --controller 'soft torque' --depths 1000m 2000m "
        "--range 'top.reference=40 rpm:200 rpm' --range 'bit.weight=60 kN:100 kN' --out windows",
    )
    depths_of_well(verb)
    two_ranges(verb, "the number whose lowest value is asked for, such as the set-point, then another one, such as the weight")
    verb.add_argument(
        "--along", nargs="+", metavar="VALUE", help="values of the second number at which windows are read; five over its range"
    )
    verb.add_argument("--shape", default="13x7", metavar="NxM", help="points of the map of a depth along both (13x7)")
    verb.set_defaults(action=run, spelled={"depths": "--depths", "along": "--along"}, words=lambda given: goes_on(given.out))


def run(given: argparse.Namespace) -> int:
    """Find the windows. Returns the exit code."""
    from toolbox.drilling.depth_windows import windows
    from toolbox.sweeps.store import folder_of

    over = ranges("--range", given.range, exactly=2)
    shape = shape_of(given.shape)
    scene, law, well = law_and_well(given)
    along = None if given.along is None else [plain(value) for value in given.along]
    if given.out:
        folder_of(given.out)
    found = windows(well, given.depths, law, over, second_values=along, shape=shape, checkpoint=given.out)
    told = "Report, table, data, figure and the maps of all depths are"
    return answer(given, "windows", found, scene, "^Windows over depth", told, last=False)
