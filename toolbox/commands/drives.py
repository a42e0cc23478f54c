"""stickslip setpoints: the lowest set-point at which every law of a scene ends stick-slip, on the declared machine and on others."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from toolbox.arguments import number, whole
from toolbox.commands import figures
from toolbox.commands.interrupt import goes_on
from toolbox.commands.recording import results
from toolbox.commands.schedule import law_of
from toolbox.commands.terminal import check_some, common, drawn_as, earlier, plain, ranges, show, side_by_side
from toolbox.commands.uncertainty import add_uncertain, uncertain_of
from toolbox.errors import SceneError, SimulationError

FILES = ("setpoints.txt", "setpoints.csv", "setpoints.npz", "setpoints.png", "scene.toml")

TAKES_PART = "be one law of `top.torque` to take part"
"""What a controller must."""

SET_POINT = "top.reference"
"""The number whose range is searched."""


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip setpoints`."""
    from toolbox.drilling.groups import NAMES
    from toolbox.drilling.set_points import PROTOCOLS

    table = commands.add_parser(
        "setpoints",
        parents=[common("folder for table, figure and what is known of single set-points; that of an interrupted search is continued")],
        description="One controller of a scene has the string in stick-slip; every other one takes over from it, on the declared machine, with noise, with "
        "errors of the model, with other rocks and under a weight that varies. Printed is the lowest set-point at which it ends the stick-slip and keeps it "
        "ended for half an hour, with the disk margin there, what the recovery costs, and what fails below. A controller, a group and a protocol "
        "take from seconds to minutes, which grow with the machine: a long search wants --out, with which the same call goes on where it was stopped. "
        "Where numbers are known as distributions only (--uncertainty, --posterior), a group of machines is drawn: a set-point that frees all 72 is "
        "free with 95 %.",
        epilog="example: stickslip setpoints studies/scenes/jansen_2.toml --initial-controller 'stiff PI' --controller 'soft torque' --group nominal "
        "--group one_at_a_time --range top.reference='15 rpm:120 rpm' --step '1 rpm' --out drives",
    )
    table.add_argument(
        "--initial-controller", metavar="LABEL", help="the controller whose stick-slip is taken over; the first law of the scene without"
    )
    table.add_argument(
        "--group", action="append", choices=NAMES, metavar="NAME", help=f"only this one of: {', '.join(NAMES)}; may be repeated"
    )
    add_uncertain(table)
    table.add_argument(
        "--draws",
        type=int,
        default=72,
        metavar="N",
        help="machines of the group `drawn`, where numbers are uncertain (72: all free show 95 %%)",
    )
    table.add_argument(
        "--protocol", action="append", choices=PROTOCOLS, metavar="NAME", help=f"only this one of: {', '.join(PROTOCOLS)}; may be repeated"
    )
    table.add_argument(
        "--range",
        default=f"{SET_POINT}=1.5:14",
        metavar="NAME=LOW:HIGH",
        help=f"set-points that are searched: rad/s, or such as '{SET_POINT}=15 rpm:120 rpm' ({SET_POINT}=1.5:14)",
    )
    table.add_argument(
        "--step",
        default="0.1",
        metavar="X",
        help="distance of the set-points; about ten are tried for a controller, a group and a protocol (0.1)",
    )
    table.add_argument(
        "--margin", default="0", metavar="M", help="disk margin that a border has to leave on every machine of its group, such as 0.05 (0)"
    )
    table.add_argument(
        "--processes",
        type=int,
        default=1,
        metavar="N",
        help="how many laws are searched side by side, of which each takes a core; the result is the same (1)",
    )
    table.add_argument("--sample-time", default="10 ms", metavar="T", help="of controllers for which the scene says none ('10 ms')")
    table.add_argument("--delay", default="30 ms", metavar="T", help="of these ('30 ms')")
    table.set_defaults(action=run, spelled={"bounds": "--range"}, words=lambda given: goes_on(given.out))


def run(given: argparse.Namespace) -> int:
    """Find the lowest set-points. Returns the exit code."""
    from toolbox.modelling.laws import Sampled
    from toolbox.scenes.scene import Scene
    from toolbox.sweeps.store import folder_of

    scene = Scene.load(given.scene)
    first = scene.case(
        given.initial_controller or next((each for each in scene.labels if len(scene[each].controllers) == 1), scene.labels[0])
    ).label
    labels = [scene.case(label).label for label in given.controller or [each for each in scene.labels if each != first]]
    margin = number("--margin", plain(given.margin), at_least=0, below=2)
    whole("--processes", given.processes, 1)
    if not labels:
        raise SceneError(f"The scene must have a controller beside `{first}`, whose stick-slip is taken over, but it has no other.")
    period, delay = number("--sample-time", plain(given.sample_time), "s", above=0), number("--delay", plain(given.delay), "s", at_least=0)

    drive = law_of(scene, first, TAKES_PART)
    before: Any = drive.law if isinstance(drive, Sampled) else drive
    groups = _groups(given, scene[first])
    failures: dict[str, Exception] = {}
    if given.out:
        folder_of(given.out)
    loops = _taking_part(scene, labels, period, delay, failures)
    if not given.quiet:
        for label, error in failures.items():
            _tell(f"{label} takes no part: ", str(error))
    found = _searched(given, loops, before, groups, margin, failures)
    if found is not None:
        found = replace(found, initial_controller=first)
    check_some(failures, labels)
    given.failures = {label: str(error) for label, error in failures.items()}
    given.found = {"table": found, "failed": given.failures}
    text = "\n".join([scene.title, *([str(found)] if found else []), *(f"{label}: {error}" for label, error in failures.items())]) + "\n"
    if given.out and found is not None:
        with results(
            given, drawn_as(FILES, given.format), earlier("setpoints.txt", "Lowest set-points at which", FILES), last=False
        ) as made:
            (made / "setpoints.txt").write_text(text, encoding="utf-8")
            found.save(made / "setpoints.csv")
            found.save(made / "setpoints.npz")
            scene.save(made / "scene.toml")
            figures.draw_found(found, scene.title, made / f"setpoints.{given.format}")
    show(text.rstrip("\n"))
    if given.out and found is not None:
        print(f"\nTable, figure and what is known of single set-points are in {given.out}")
    return 0 if found is not None else 1


def _taking_part(scene: Any, labels: list[str], period: float, delay: float, failures: dict[str, Exception]) -> dict[str, Any]:
    """The loops of controllers by label; those that take no part are told among the failures."""
    loops = {}
    for label in labels:
        try:
            loops[label] = _sampled(scene, label, period, delay)
        except SceneError as error:
            failures[label] = error
    return loops


def _tell(place: str, line: str) -> None:
    print(f"{place}{line}", file=sys.stderr, flush=True)


def _sampled(scene: Any, label: str, period: float, delay: float) -> Any:
    """The loop of a controller of a scene whose one law is sampled, as the scene says or so. Raises SceneError for one that takes no part."""
    from toolbox.modelling.laws import Controller, Sampled, designed

    law = law_of(scene, label, TAKES_PART)
    given = law if isinstance(law, Sampled) else Sampled(law, period, delay)
    made = designed(given.law, scene[label].plant)
    if isinstance(made, Controller) and type(made).sampled is Controller.sampled:
        raise SceneError(f"Controller `{label}` must have a sampled form to take part, but {type(made).__name__} has none.")
    return replace(scene[label].with_controllers([given]), label=label)


def _searched(
    given: argparse.Namespace, loops: dict[str, Any], before: Any, groups: list[Any], margin: float, failures: dict[str, Exception]
) -> Any:
    """The lowest set-points of all laws, or None where each fails; why they do is told among the failures."""
    from toolbox.drilling.lowest_set_point import LowestSetPoints
    from toolbox.drilling.set_points import PROTOCOLS
    from toolbox.sweeps.executors import travelling

    found: LowestSetPoints | None = None
    places = [f"law {k} of {len(loops)}, " if len(loops) > 1 else "" for k in range(1, len(loops) + 1)]
    asked = {"protocols": given.protocol or PROTOCOLS, "bounds": _bounds(given.range), "step": plain(given.step)}
    search = partial(_of_one, before=before, groups=groups, margin=margin, out=given.out, quiet=given.quiet, **asked)
    with side_by_side(min(given.processes, len(loops))) as pool, travelling(search, loops) if pool is not None else nullcontext():
        for label, one in zip(loops, (map if pool is None else pool.map)(search, places, loops.values()), strict=True):
            if isinstance(one, Exception):
                failures[label] = one
            else:
                found = one if found is None else found.joined(one)
    return found


def _bounds(text: str) -> tuple[Any, ...]:
    """The ends of the range of set-points. Raises SceneError for a range of anything else."""
    ((name, ends),) = ranges("--range", [text]).items()
    if name != SET_POINT:
        raise SceneError(f"Argument `--range` must be {SET_POINT}=LOW:HIGH, but it is `{text}`.")
    return ends


def _of_one(place: str, loop: Any, *, before: Any, groups: list[Any], margin: float, out: Path | None, quiet: bool, **asked: Any) -> Any:
    """The lowest set-points of one law, in this process or another one, or the error why there are none."""
    from toolbox.drilling.lowest_set_point import chosen_groups, lowest_set_point
    from toolbox.drilling.set_points import Trial

    known, say = (out / "cells.jsonl" if out else None), (None if quiet else partial(_tell, place))
    try:
        with _keeping(out):
            return lowest_set_point(
                loop, before, chosen_groups(Trial(loop, before), groups, margin=margin), checkpoint=known, callback=say, **asked
            )
    except (SceneError, SimulationError) as error:
        return type(error)(str(error))


@contextmanager
def _keeping(out: Path | None) -> Iterator[None]:
    """Leave out what the runs of one set-point say of an interrupt where whole set-points are kept, of which they do not know."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        if out:
            interrupt.__notes__ = []
        raise


def _groups(given: argparse.Namespace, loop: Any) -> list[Any]:
    """The groups of machines that are asked for, by name, and that of those that are drawn."""
    from toolbox.drilling.groups import NAMES, drawn_group

    if given.uncertainty or given.posterior:
        return [*(given.group or ()), drawn_group(loop, uncertain_of(given), given.draws)]
    return list(given.group or NAMES)
