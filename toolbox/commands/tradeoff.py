"""stickslip tradeoff: error against time for every method and setting on a scene."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any

from toolbox.commands import figures
from toolbox.commands.recording import results
from toolbox.commands.terminal import common, drawn_as, earlier, heading, plain, show
from toolbox.files.units import parse

TRADE_FILES = ("tradeoff.txt", "tradeoff.png", "tradeoff.csv", "tradeoff.npz", "scene.toml")


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip tradeoff`."""
    trade = commands.add_parser(
        "tradeoff",
        parents=[
            common("folder for figure and table; those of an earlier measurement are replaced", controller="which case; the first without")
        ],
        description="Run one case of a scene with every method and setting, against a truth computed twice, and print error and time of each. With --out, the "
        "folder gets the report, the figure, table (csv), data (npz) and scene: all of it, or nothing.",
        epilog="example: stickslip tradeoff studies/scenes/jansen_2.toml --out trade",
    )
    trade.add_argument(
        "--duration", type=plain, metavar="T", help="what to simulate: seconds, or with a unit such as '2 min'; that of the scene without"
    )
    trade.set_defaults(action=run)


def run(given: argparse.Namespace) -> int:
    """Measure error against time. Returns the exit code."""
    from toolbox.scenes.scene import Scene
    from toolbox.scenes.work_precision import Point, work_precision

    scene = Scene.load(given.scene)
    loop = scene[given.controller or scene.labels[0]]
    left_by = earlier("tradeoff.csv", heading(Point), TRADE_FILES)
    with results(given, drawn_as(TRADE_FILES, given.format), left_by) as folder:
        duration = None if given.duration is None else parse(given.duration, "s", "--duration")
        found = dataclasses.replace(work_precision(loop, duration), title=f"{scene.title}: {loop.label}")
        given.found = found
        if folder is not None:
            (folder / "tradeoff.txt").write_text(f"{found}\n", encoding="utf-8")
            found.save(folder / "tradeoff.csv")
            found.save(folder / "tradeoff.npz")
            figures.draw_found(found, None, folder / f"tradeoff.{given.format}")
            scene.save(folder / "scene.toml")
    show(str(found))
    if given.out:
        print(f"\nReport, figure and table are in {given.out}")
    return 0
