"""stickslip fit: parameters of a scene's plant from measured signals."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from toolbox.arguments import number, numbers, whole
from toolbox.commands import figures
from toolbox.commands.recording import results
from toolbox.commands.terminal import common, drawn_as, earlier, held_of, hold_argument, log_arguments, pairs, plain, ranges, show, span
from toolbox.errors import SceneError

FIT_FILES = ("fit.txt", "fit.csv", "fit.npz", "fit.png", "scene.toml")


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip fit`."""
    calibration = commands.add_parser(
        "fit",
        parents=[
            common(
                "folder for report, table, figure and scene; those of an earlier fit are replaced",
                scene="the machine; its inputs and start hold where nothing is measured",
                controller="the controller of the scene that was running; the plant alone without",
            )
        ],
        description="Fit parameters to measured signals: by simulation, driven by the measured inputs, or with --contact the friction law of one contact "
        "directly to measured torque over measured slip. The folder gets the report, the estimates (csv), all arrays (npz), a figure of model and "
        "data, and the calibrated scene: all of it, or nothing.",
        epilog="example: stickslip fit studies/scenes/jansen_2.toml studies/data/rig.csv --column 'top.torque=drive torque' "
        "--column 'bit.weight=weight on bit' --column 'top.speed=table speed' --column 'bit.speed=downhole speed' "
        "--column 'bit.torque=downhole torque' --range bit.friction.static=0.6:1 --range bit.friction.kinetic=0.3:0.6 --out fitted",
    )
    calibration.add_argument(
        "data", type=Path, metavar="DATA", help="measured signals: CSV as it comes, TOML, MAT; with the extra data also xlsx, parquet, LAS"
    )
    calibration.add_argument(
        "--free",
        metavar="NAME",
        action="append",
        default=[],
        help="a number to fit, within the bounds that its part declares; SIGNAL.shift is how much later a signal was written than it was; may be repeated",
    )
    calibration.add_argument(
        "--range", metavar="NAME=LOW:HIGH", action="append", default=[], help="a number to fit, between two values; may be repeated"
    )
    log_arguments(calibration)
    hold_argument(calibration)
    calibration.add_argument("--contact", metavar="NAME", help="fit the law of this contact to the measured loop, without simulation")
    calibration.add_argument(
        "--window", metavar="BEGIN:END", action="append", default=[], help="times [s] of the data that are used; may be repeated"
    )
    calibration.add_argument(
        "--own",
        metavar="NAME",
        action="append",
        default=[],
        help="a free number that has a value of its own in every window; may be repeated",
    )
    calibration.add_argument(
        "--shift",
        metavar="SIGNAL=TIME",
        action="append",
        default=[],
        help="how much later a signal was written than it was, where it is known; may be repeated",
    )
    calibration.add_argument(
        "--robust",
        metavar="DEVIATIONS",
        default="5",
        help="samples farther from the law than so many deviations are left out; off keeps all (5)",
    )
    calibration.add_argument("--starts", type=int, default=4, metavar="N", help="searches from different values (4)")
    calibration.set_defaults(
        action=run,
        spelled={
            "free": "--free",
            "ranges": "--range",
            "columns": "--column",
            "accepted_flaws": "--accept-flaw",
            "zero_order_hold": "--zero-order-hold",
            "data": "DATA",
        },
    )


def _free(bare: Sequence[str], ranged: Mapping[str, tuple[Any, ...]]) -> dict[str, tuple[Any, ...]]:
    """{name: (low, high)} of what is fitted, empty for the bounds that a part declares. Raises SceneError where nothing is, and for a range in `--free`."""
    for text in bare:
        if "=" in text:
            raise SceneError(f"Argument `--free` must be a name, but it is `{text}`: write `--range '{text}'`.")
        if bare.count(text) > 1:
            raise SceneError(f"Argument `--free` must name every number once, but `{text}` is there twice.")
    if not bare and not ranged:
        raise SceneError("Argument `--free` must be given, or `--range`, which names a number with its range.")
    return dict.fromkeys(bare, ()) | dict(ranged)


def run(given: argparse.Namespace) -> int:
    """Fit parameters to measured signals. Returns the exit code."""
    from toolbox.calibration.fit import fit
    from toolbox.calibration.recording import Recording
    from toolbox.calibration.shifts import is_shift
    from toolbox.calibration.windows import Search, Window
    from toolbox.scenes.scene import Scene

    scene = Scene.load(given.scene)
    loop = scene[given.controller or scene.labels[0]]
    if given.controller is None:  # the plant alone, driven by what was measured
        loop = dataclasses.replace(loop, controllers=(), inputs={name: v for name, v in loop.inputs.items() if name in scene.inputs})
    free = _free(given.free, ranges("--range", given.range))
    units = {name: "s" if is_shift(loop, name) else loop.number(name).unit for name in free}
    spans = {name: numbers(f"--range {name}", ends, units[name]) for name, ends in free.items() if ends}
    bounds = {name: (low, high) for name, (low, high) in spans.items()}
    columns = dict(pairs("--column", "SIGNAL=HEADING", given.column))
    shifts = {name: plain(late) for name, late in pairs("--shift", "SIGNAL=TIME", given.shift)}
    windows = [Window(*span("--window", text), own=given.own) for text in given.window]
    if given.own and not windows:
        raise SceneError("Argument `--own` must come with windows, by `--window`, but there is none.")
    robust = None if given.robust == "off" else number("--robust", given.robust, "1", above=1)
    starts = whole("--starts", given.starts, 1)
    recording = Recording.of(
        given.data,
        loop.without_controllers.system if given.contact else dataclasses.replace(loop, inputs={}).system,
        columns or None,
        accepted_flaws=given.accept_flaw,
    )
    recording = recording.shifted(shifts) if shifts else recording
    with results(given, drawn_as(FIT_FILES, given.format), earlier("fit.txt", "\nFit of ", FIT_FILES)) as folder:
        found = fit(
            loop,
            recording,
            list(free),
            bounds,
            window=windows or None,
            contact=given.contact,
            starts=Search(starts, robust=robust),
            zero_order_hold=held_of(given),
        )
        given.found = found
        text = f"{scene.title}\n\n{found}\n\n{recording}\n"
        if folder is not None:
            (folder / "fit.txt").write_text(text, encoding="utf-8")
            found.save(folder / "fit.csv")
            found.save(folder / "fit.npz")
            figures.draw_found(found, scene.title, folder / f"fit.{given.format}")
            dataclasses.replace(scene, parts=found.plant.parts, parameters={}).save(folder / "scene.toml")
    show(text.rstrip("\n"))
    if given.out:
        print(f"\nReport, table, figure and the calibrated scene are in {given.out}")
    return 0
