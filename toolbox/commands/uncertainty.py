"""What several commands share about numbers that are known as distributions: their options, their text, and the controllers that have them."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.commands.terminal import check_known, pairs, ranges
from toolbox.errors import SceneError
from toolbox.messages import complaint

if TYPE_CHECKING:
    from toolbox.modelling.closed_loop import ClosedLoop
    from toolbox.probability.distributions import Draws
    from toolbox.scenes.scene import Scene


DISTRIBUTIONS = "a normal distribution NAME='97 kN +- 8 kN' or NAME='97 kN +- 8 %%', or a uniform one NAME=LOW:HIGH"


def add_uncertain(verb: argparse.ArgumentParser) -> None:
    """Declare the arguments that say what is not known."""
    verb.add_argument(
        "--uncertainty", action="append", default=[], metavar="NAME=WHAT", help=f"what is not known: {DISTRIBUTIONS}; may be repeated"
    )
    verb.add_argument(
        "--posterior",
        type=Path,
        metavar="FILE.npz",
        help="what `stickslip posterior` found of numbers; --uncertainty says what is known of others",
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
                    loop.differentiable_number(name, verb)
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

    if not given.uncertainty and not given.posterior:
        raise SceneError("Argument `--uncertainty` must be given, or `--posterior`, because without them every run at a point is the same.")
    apart = distributions("--uncertainty", given.uncertainty)
    return Posterior.load(given.posterior).drawn.also(apart) if given.posterior else apart
