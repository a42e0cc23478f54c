"""stickslip estimate: what the bit did, by what was measured at the surface."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from toolbox.arguments import number
from toolbox.commands.recording import answer
from toolbox.commands.terminal import common, log_arguments, pairs, plain


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip estimate`."""
    verb = commands.add_parser(
        "estimate",
        parents=[
            common(
                "folder for report, table and figure; those of an earlier call are replaced",
                scene="the drill string",
                controller="the controller whose border of smooth running the margin is taken to; the last one of the scene without",
            )
        ],
        description="Follow a log of surface torque, top speed and, where it is there, weight on bit with an ensemble of strings that stick and slip. "
        "Printed are the estimates, and when there was stick-slip; the table has them at every sample, from that sample and those before it.",
        epilog="example: stickslip estimate studies/scenes/jansen_2.toml rig.csv --column top.torque='drive torque' --column top.speed='table speed' "
        "--controller 'stiff PI' --out estimated",
    )
    verb.add_argument("data", type=Path, metavar="LOG", help="measured signals: CSV, WITSML, LAS, MAT, TOML or a sheet")
    log_arguments(verb)
    verb.add_argument(
        "--speed-noise", default="0.01 rad/s", metavar="X", help="standard deviation of the measured top speed ('0.01 rad/s')"
    )
    verb.add_argument("--torque-noise", default="20 N m", metavar="X", help="standard deviation of the measured torque ('20 N m')")
    verb.add_argument("--members", type=int, default=64, metavar="N", help="strings of the ensemble (64)")
    verb.add_argument("--seed", type=int, default=0, metavar="S", help="of the random numbers (0)")
    verb.set_defaults(action=run, spelled={"data": "LOG", "columns": "--column", "accepted_flaws": "--accept-flaw", "loop": "SCENE.toml"})


def run(given: argparse.Namespace) -> int:
    """Estimate over a log. Returns the exit code."""
    from toolbox.calibration.recording import Recording
    from toolbox.drilling.ensemble import Knowledge
    from toolbox.drilling.estimates import estimate
    from toolbox.scenes.scene import Scene

    scene = Scene.load(given.scene)
    loop = scene[given.controller or scene.labels[-1]]
    noises = {
        "speed_noise": number("--speed-noise", plain(given.speed_noise), "rad/s", above=0),
        "torque_noise": number("--torque-noise", plain(given.torque_noise), "N m", at_least=0),
    }
    columns = dict(pairs("--column", "SIGNAL=HEADING", given.column))
    recording = Recording.of(given.data, loop.plant, columns or None, accepted_flaws=given.accept_flaw)
    found = estimate(loop, recording, knowledge=Knowledge(**noises), members=given.members, seed=given.seed)
    return answer(given, "estimate", dataclasses.replace(found, title=scene.title), scene, "^Estimates of ", "Report, table and figure are")
