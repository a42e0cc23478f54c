"""stickslip chance: the chance of stick-slip over one or two numbers, where other numbers are known as distributions only."""

from __future__ import annotations

import argparse
import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.arguments import numbers
from toolbox.commands.recording import answer
from toolbox.commands.terminal import asked_otherwise, check_known, common, loaded, pairs, plain, ranges
from toolbox.errors import SceneError
from toolbox.files.unit_systems import asked_in
from toolbox.messages import complaint

if TYPE_CHECKING:
    from toolbox.modelling.closed_loop import ClosedLoop
    from toolbox.probability.distributions import Draws
    from toolbox.scenes.scene import Scene


GOES_ON = "interrupted; the same call goes on from here."

DISTRIBUTIONS = "a normal distribution NAME='97 kN +- 8 kN' or NAME='97 kN +- 8 %%', or a uniform one NAME=LOW:HIGH"


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip chance`."""
    verb = commands.add_parser(
        "chance",
        parents=[common("folder for table, figure and data; that of an interrupted search is continued")],
        description="Simulate every controller of a scene at all points with the same draws of what is uncertain, and print the chance of stick-slip with its "
        "bounds by Clopper and Pearson, and the lowest set-point that is free with 95 %. Every run begins where the scene begins.",
        epilog="example: stickslip chance studies/scenes/jansen_2.toml --over top.reference='40 rpm:140 rpm:11' --uncertain bit.weight='97 kN +- 8 kN' "
        "--uncertain bit.friction.static=0.7:0.9 --controller 'stiff PI' --draws 200 --out chances",
    )
    verb.add_argument(
        "--over",
        action="append",
        required=True,
        metavar="NAME=LOW:HIGH:N",
        help="what varies, with its number of values; once or twice, the set-point first",
    )
    add_uncertain(verb)
    asked_otherwise(verb)
    verb.add_argument("--draws", type=int, default=200, metavar="N", help="machines at every point (200)")
    verb.add_argument("--duration", type=plain, metavar="T", help="of a run; forty swings after the start without")
    verb.add_argument("--accuracy", type=float, default=1e-4, metavar="X", help="of the runs (1e-4)")
    verb.add_argument("--confidence", type=float, default=0.95, metavar="P", help="of the bounds (0.95)")
    verb.add_argument("--seed", type=int, default=0, metavar="S", help="of the draws (0)")
    verb.set_defaults(
        action=run,
        spelled={"uncertain": "--uncertain", "others": "--uncertain"},
        words=lambda given: GOES_ON if given.out else "interrupted.",
    )


def add_uncertain(verb: argparse.ArgumentParser) -> None:
    """Declare the arguments that say what is not known."""
    verb.add_argument(
        "--uncertain", action="append", default=[], metavar="NAME=WHAT", help=f"what is not known: {DISTRIBUTIONS}; may be repeated"
    )
    verb.add_argument(
        "--posterior",
        type=Path,
        metavar="FILE.npz",
        help="what `stickslip posterior` found of numbers; --uncertain says what is known of others",
    )


def distributions(option: str, texts: Sequence[str]) -> dict[str, Any]:
    """{name: distribution} of texts NAME=MEAN +- DEVIATION and NAME=LOW:HIGH; raises SceneError for other forms, and for a name that is there twice."""
    from toolbox.probability.distributions import Uniform, distribution

    found: dict[str, Any] = {}
    for name, what in pairs(option, "NAME='97 kN +- 8 kN' or NAME=LOW:HIGH", texts):
        if name in found:
            raise SceneError(f"Argument `{option}` must name every number once, but `{name}` is there twice.")
        if re.search(r"\+-|\+/-|±", what):
            found[name] = distribution(name, what)
        else:
            found[name] = Uniform(*ranges(option, [f"{name}={what}"])[name])
    return found


def run(given: argparse.Namespace) -> int:
    """Find the chances. Returns the exit code."""
    import numpy as np

    from toolbox.probability.chances import chance

    scene = loaded(given)
    varied = ranges("--over", given.over, counted=True)
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
        accuracy=given.accuracy,
        confidence=given.confidence,
        seed=given.seed,
        checkpoint=given.out,
    )
    found = dataclasses.replace(found, title=scene.title, display_units={**found.display_units, **asked})
    return answer(given, "chance", found, scene, "^Chance of stick-slip: ", "Table, figure and data are", last=False)


def with_numbers(
    scene: Scene, labels: Sequence[str], names: Sequence[str], verb: str | None = None
) -> tuple[dict[str, ClosedLoop], dict[str, Exception]]:
    """The loops of a scene that have numbers, and why the other labels do not; raises SceneError where none has them.

    verb: for which the numbers must act; None where they need not.
    """
    loops: dict[str, ClosedLoop] = {}
    failures: dict[str, Exception] = {}
    check_known(scene, labels, names)
    for label in labels:
        try:
            loop = scene[label]
            for name in names:
                if verb is None:
                    loop.number(name)
                else:
                    loop.acting(name, verb)
            loops[label] = loop
        except SceneError as error:
            failures[label] = error
    if not loops:
        raise failures[labels[0]]
    return loops, failures


def left_out(failures: Mapping[str, Exception]) -> None:
    """Say which controllers of a scene have no part in an answer, and why."""
    for label, error in failures.items():
        complaint(f"warning: `{label}` is left out: {error}", 0)


def uncertain_of(given: argparse.Namespace) -> dict[str, Any] | Draws:
    """What is not known, as `drawn` takes it."""
    from toolbox.probability.posteriors import Posterior

    if not given.uncertain and not given.posterior:
        raise SceneError("Argument `--uncertain` must be given, or `--posterior`, because without them every run at a point is the same.")
    apart = distributions("--uncertain", given.uncertain)
    return Posterior.load(given.posterior).drawn.also(apart) if given.posterior else apart
