"""stickslip posterior: what numbers of a machine may be, given what was measured of it."""

from __future__ import annotations

import argparse
import dataclasses
import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.arguments import whole
from toolbox.commands import figures
from toolbox.commands.interrupt import goes_on
from toolbox.commands.recording import answer
from toolbox.commands.terminal import common, log_arguments, pairs, plain, show, span
from toolbox.commands.uncertainty import DISTRIBUTIONS, distributions
from toolbox.errors import SceneError

if TYPE_CHECKING:
    from toolbox.calibration.recording import Recording
    from toolbox.modelling.closed_loop import ClosedLoop
    from toolbox.probability.predictions import Prediction

BANDS = ("bands.csv", "bands.png")
"""What is written beside them where signals are compared: what the draws predict of these."""


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip posterior`."""
    verb = commands.add_parser(
        "posterior",
        parents=[
            common(
                "folder for report, draws and figure; that of an interrupted search is continued",
                scene="the machine; its inputs and start hold where nothing is measured",
                controller="the controller of the scene that was running; the plant alone without, where signals are compared",
            )
        ],
        description="Sample the posterior of numbers of a scene. Signals of the data that are inputs of the machine drive the runs; means of other "
        "signals are compared with them (--compare), or measures of a run with their values (--measured), without data. The draws (posterior.npz) are what "
        "`stickslip chance --posterior` takes.",
        epilog="example: stickslip posterior studies/scenes/jansen_2.toml rig.csv --prior bit.friction.static=0.6:1 --prior bit.weight='80 kN +- 15 kN' "
        "--compare bit.speed='0.5 rad/s' --mean '1 s' --out known;   stickslip posterior studies/scenes/jansen_2.toml --controller 'stiff PI' "
        "--prior bit.weight=50kN:110kN --measured stuck_ratio='0.31 +- 0.02' --measured severity='1.9 +- 0.1'",
    )
    verb.add_argument("data", type=Path, nargs="?", metavar="DATA", help="measured signals: CSV or TOML with units in headings, or MAT")
    verb.add_argument(
        "--prior",
        action="append",
        required=True,
        metavar="NAME=WHAT",
        help=f"an unknown and what is known of it before: {DISTRIBUTIONS}; may be repeated",
    )
    verb.add_argument(
        "--compare",
        action="append",
        default=[],
        metavar="SIGNAL=DEVIATION",
        help="a measured signal, and the standard deviation of each mean, errors of the model included; may be repeated",
    )
    verb.add_argument(
        "--measured",
        action="append",
        default=[],
        metavar="MEASURE=WHAT",
        help="a measure of `stickslip list metrics` and its value, such as severity='1.9 +- 0.1'; may be repeated",
    )
    verb.add_argument("--mean", default="1 s", metavar="T", help="time over which each mean is taken ('1 s')")
    verb.add_argument(
        "--window",
        "--part",  # its earlier name
        metavar="BEGIN:END",
        help="times [s] of the data that are used; at the first the machine stands as the scene says",
    )
    verb.add_argument(
        "--max-gap", type=int, default=2, metavar="N", help="samples that may be missing in a row in what drives the machine (2)"
    )
    log_arguments(verb)
    verb.add_argument("--duration", metavar="T", help="of the runs; by default that of the data, else of the scene")
    verb.add_argument("--draws", type=int, default=256, metavar="N", help="of the posterior (256)")
    verb.add_argument("--accuracy", type=float, default=1e-4, metavar="X", help="of the runs (1e-4)")
    verb.add_argument("--seed", type=int, default=0, metavar="S", help="of the random numbers (0)")
    verb.set_defaults(
        action=run,
        spelled={
            "priors": "--prior",
            "data": "--measured",
            "columns": "--column",
            "accepted_flaws": "--accept-flaw",
            "compare": "--compare",
            "length": "--mean",
        },
        words=lambda given: goes_on(given.out),
    )


def run(given: argparse.Namespace) -> int:
    """Sample the posterior. Returns the exit code."""
    from toolbox.probability.posteriors import posterior
    from toolbox.probability.predictions import predict
    from toolbox.scenes.scene import Scene

    scene = Scene.load(given.scene)
    loop = scene[given.controller or scene.labels[0]]
    if bool(given.compare) == bool(given.measured) or bool(given.compare) != bool(given.data):
        raise SceneError("Argument `--compare` must be given with DATA, or `--measured` without, but not both.")
    if given.compare:
        if given.controller is None:
            loop = dataclasses.replace(loop, controllers=(), inputs={name: v for name, v in loop.inputs.items() if name in scene.inputs})
        loop, data, measures, recording = _compared(given, loop)
        length = float(recording.time[-1])
    else:
        data, measures, length, recording = distributions("--measured", given.measured), {}, None, None
    found = posterior(
        loop,
        data,
        distributions("--prior", given.prior),
        length if given.duration is None else plain(given.duration),
        metrics=measures,
        draws=given.draws,
        accuracy=given.accuracy,
        seed=given.seed,
        checkpoint=given.out,
    )
    found = dataclasses.replace(found, title=scene.title)
    more = None
    if recording is not None:
        signals = {name: 0.0 for name, _ in pairs("--compare", "SIGNAL=DEVIATION", given.compare)}
        bands = predict(loop, found.drawn, signals, recording=recording, accuracy=given.accuracy, seed=given.seed)
        more = functools.partial(_write_bands, bands, scene.title, given.format)
    told = "Report, draws and figures are"
    return answer(given, "posterior", found, scene, "^Posterior of ", told, also=BANDS, more=more, last=False)


def _write_bands(bands: Prediction, title: str, ending: str, folder: Path) -> None:
    """Write table and figure of the bands around what was measured."""
    bands.save(folder / "bands.csv")
    figures.draw_found(bands, title, folder / f"bands.{ending}")


def _compared(given: argparse.Namespace, loop: ClosedLoop) -> tuple[ClosedLoop, dict[str, Any], dict[str, Any], Recording]:
    """(loop driven as it was measured, data, measures, recording) of a call with DATA."""
    from toolbox.calibration.recording import Recording
    from toolbox.probability.posteriors import from_recording

    columns = dict(pairs("--column", "SIGNAL=HEADING", given.column))
    recording = Recording.of(given.data, dataclasses.replace(loop, inputs={}).system, columns or None, accepted_flaws=given.accept_flaw)
    if given.window is not None:
        recording = recording.between(*span("--window", given.window))
    show(str(recording))
    compare = {name: plain(size) for name, size in pairs("--compare", "SIGNAL=DEVIATION", given.compare)}
    return *from_recording(loop, recording, compare, plain(given.mean), max_gap=whole("--max-gap", given.max_gap, 0)), recording
