"""The fit of those numbers that recordings tell: each other number stays where the search left it, with a sentence and the experiment that tells it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.calibration.fit import fit
from toolbox.calibration.recording import Recording
from toolbox.calibration.results import Fit
from toolbox.errors import SceneError, SimulationError, Unidentifiable
from toolbox.modelling.composition import compose

SEARCHES = 6
"""Searches that follow one that ended at friction above every measured force."""

EXPERIMENTS = {
    "static": "raise the force slowly from rest until it moves, several times each way",
    "kinetic": "move at steady speeds over the whole range",
    "viscous": "move at steady speeds that differ by a factor of five or more",
    "stribeck_speed": "move at slow steady speeds, from creep to three times the Stribeck speed, around which friction falls from static to kinetic",
    "force_offset": "move both ways, by the same path",
    "torque_offset": "move both ways, by the same path",
    "mass": "accelerate by a measured force: steps, or a sine of the largest force",
    "inertia": "accelerate by a measured torque: steps, or a sine of the largest torque",
    "filter_time": "record steps, or the speed without its filter",
    "load_sensitivity": "repeat the test under two loads that differ much",
    "shift": "record a step of the force, which marks the clocks of both channels",
}
"""{last word of a number: experiment that tells it}."""


WIDE, WIDE_SPEED = 0.1, 0.3
"""Half-width of an interval, as a fraction of the estimate, from which on a mass is hardly told from friction, and a Stribeck speed hardly at all."""

TIED = 0.9
"""Correlation with a mass from which on a friction moves with it."""


def hardly_told(found: Fit, body: str) -> dict[str, str]:
    """Return {number: why its interval is wide, and which experiment makes it narrow}, of the mass and of Stribeck speeds. body: name of the mass."""
    told = {}
    for i, (name, value) in enumerate(zip(found.names, found.values.tolist(), strict=True)):
        word = name.rpartition(".")[2]
        width = found.interval_factor * float(found.standard_errors[i]) / abs(value) if value else math.inf
        if name == body and WIDE < width < 1.0:
            ties = {other: float(r) for other, r in zip(found.names, found.correlation[i], strict=True) if ".friction." in other}
            tied = max(ties, key=lambda other: abs(ties[other]), default="")
            if tied and abs(ties[tied]) > TIED:
                told[name] = (
                    f"its interval is +-{100 * width:.2g} %, because the recordings hardly tell {word} from friction: other values go with another `{tied}` "
                    f"(correlation {ties[tied]:+.2f}). To tell them apart, {EXPERIMENTS[word]}."
                )
        elif word == "stribeck_speed" and WIDE_SPEED < width < 1.0:
            told[name] = f"its interval is +-{100 * width:.2g} %. To tell it, {EXPERIMENTS[word]}."
    return told


def start_of(part: Any, name: str) -> str:
    """The number of a part from which it is looked for, with its unit."""
    system = compose(part)
    entry = system.parameters.get(name)
    return "its start" if entry is None else f"{float(system.values[entry.offset]):.4g} {entry.unit}"


def holds_nothing(found: Fit, name: str) -> bool:
    """Whether the interval of a number that is above zero holds zero, or means nothing."""
    place = found.names.index(name)
    return name in found.at_bounds or not found.interval_factor * found.standard_errors[place] < found.values[place]


def _released(part: Any, found: Fit, silent: Sequence[str]) -> Any:
    """The part with static frictions that the data do not feel where the motion is as it was measured: a little above the kinetic one, or far above."""
    misfit, numbers = found.misfit, dict(found.parameters)

    def left(factor: float) -> float:
        changed = found.values.copy()
        for name in silent:
            changed[found.names.index(name)] = factor * numbers[name.removesuffix("static") + "kinetic"]
        try:
            model = misfit.model(changed)
        except (SceneError, SimulationError):
            return float("inf")
        return sum(
            float(np.mean((model[name] - misfit.measured[name]) ** 2)) / float(np.var(misfit.measured[name])) for name in misfit.outputs
        )

    best = min((1.02, 1.1, 1.3, 1.6, 2.0), key=left)
    numbers |= {name: best * numbers[name.removesuffix("static") + "kinetic"] for name in silent}
    return misfit.loop.assembly.plant.with_parameters(
        {name: value for name, value in numbers.items() if misfit.loop.plant.has_parameter(name)}
    ).parts[0]


def told_fit(
    part: Any,
    recording: Recording,
    free: Sequence[str],
    untold: dict[str, str],
    astray: Callable[[Mapping[str, float]], bool],
    **options: Any,
) -> Fit:
    """The fit of those numbers that the data tell; of all others `untold` gets a sentence, and they stay where the search left them.

    astray: whether a search that ended at these numbers has lost its way, so that more searches follow.
    """
    free = list(free)

    def again(values: Mapping[str, float]) -> bool:
        if options["starts"].starts > 1 or not astray(values):
            return False
        options["starts"] = dataclasses.replace(options["starts"], starts=SEARCHES, growing=True)
        return True

    while True:
        windows = options.get("window")
        try:
            found = fit(compose(part), recording, free, **options)
            if again(dict(zip(found.names, found.values.tolist(), strict=True))):
                continue
            silent = [name for name in found.unidentifiable if name.endswith(".static")]
            if not silent:
                return found
            part = _released(part, found, silent)
            for name in silent:
                free.remove(name)
                untold[name] = f"every break-away falls on a jump of the force, which passes it. To tell it, {EXPERIMENTS['static']}."
        except Unidentifiable as error:
            if again(error.values):
                continue
            plain = [name.partition("[")[0] for name in error.names if name.partition("[")[0] in free]
            order = [
                name
                for word in ("mass", "inertia", "force_offset", "torque_offset", "static", "stribeck_speed", "viscous", "shift")
                for name in plain
                if name.endswith(f".{word}")
            ]
            lost = plain if error.mute else (order or plain)[:1]
            if not lost or len(lost) == len(free):
                raise
            for name in lost:
                word = name.rpartition(".")[2]
                if word in EXPERIMENTS:
                    why = (
                        "it changes none of the measured signals"
                        if error.mute
                        else f"it is not told apart from {', '.join(n for n in plain if n != name)}"
                    )
                    untold[name] = f"{why}; it stays at {start_of(part, name)}. To tell it, {EXPERIMENTS[word]}."
                free.remove(name)
                if windows:
                    options["window"] = windows = [
                        dataclasses.replace(w, own=[n for n in w.own if n != name], start={k: v for k, v in w.start.items() if k != name})
                        for w in windows
                    ]
