"""The situation that a verdict holds for, in one line: plant, start, design of the controllers, surroundings and duration.

Two verdicts on one loop may differ because they judge different situations. So each result says its own: which plants were judged, how the runs started,
whether the controllers were designed once, what acted from outside, and for how long.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from toolbox.errors import SceneError, joined
from toolbox.files.unit_systems import reading
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled
from toolbox.scenes.judged import judged_contact, judged_speed, set_point


@dataclass(frozen=True)
class Situation:
    """The situation of a verdict; `str(situation)` is one line.

    Attributes
    ----------
    plants
        The plants that were judged, such as "the nominal plant".
    start
        How the runs start.
    design
        How the controllers were designed; empty without controllers.
    surroundings
        Inputs that vary, noise of the sensors, and samples that are late or missed.
    duration
        How long the runs last, and from when on they are judged.
    """

    plants: str
    start: str
    design: str
    surroundings: str
    duration: str

    def __str__(self) -> str:
        return f"Holds for: {'; '.join(part for part in vars(self).values() if part)}."

    @classmethod
    def of(
        cls,
        loop: ClosedLoop,
        start: str,
        duration: str,
        *,
        plants: str = "the nominal plant",
        design: str = "",
        cases: Mapping[str, ClosedLoop] | None = None,
    ) -> Situation:
        """Return the situation of verdicts on a loop.

        Parameters
        ----------
        loop
            The loop.
        start, duration
            How its runs start, and how long they last, in words.
        plants
            The plants that were judged, in words.
        design
            How the controllers were designed, in words; by default once, at the set-point of the loop.
        cases
            {label: loop} of all loops that were judged, whose inputs and noise may differ; by default only this loop.
        """
        changed = [name for name in loop.parameters if loop.plant.has_parameter(name)]
        designed_for = "" if not changed else f" with other values of {joined(changed, most=4)}"
        if changed and any(each.controllers for each in (cases or {"": loop}).values()):
            designed_for += " than its controllers are designed for"
        plant = plants + designed_for + "".join(f" ({words})" for words in mode_summaries(loop.plant))
        return cls(plant, f"started from {start}", design or _design(loop), _surroundings(cases or {"": loop}), duration)


def mode_summaries(plant: HybridSystem) -> list[str]:
    """Number of elements and first modes of each part that is lumped, in words."""
    return [words for part in plant.parts if (words := getattr(part, "mode_summary", ""))]


def start_in_words(loop: ClosedLoop) -> str:
    """How a run of a loop starts, in words."""
    name = _set_point_of(loop)
    step = (
        ""
        if name is None
        else ", set-point in one step"
        if isinstance(loop.input_values.get(name, 0.0), (int, float))
        else ", set-point over time"
    )
    if not loop.start:
        return f"rest{step}"
    return f"given start values{step}"


def _set_point_of(loop: ClosedLoop) -> str | None:
    """The name of the set-point of a loop; None if it has none, or nothing that sticks."""
    with contextlib.suppress(SceneError):
        return set_point(loop.system, judged_speed(loop, judged_contact(loop))) if loop.plant.elements else None
    return None


def _design(loop: ClosedLoop) -> str:
    """How the controllers of a loop were designed, in words."""
    laws: list[Any] = [law.law if isinstance(law, Sampled) else law for law in loop.controllers]
    if not any(isinstance(law, Controller) and type(law).design is not Controller.design for law in laws):
        return "controller with fixed numbers" if laws else "no controller"
    name = _set_point_of(loop)
    number = None if name is None else loop.number(name)
    if number is None or math.isnan(number.value):
        return "controller designed once, for this plant"
    read = reading(number.unit, loop.display_units)
    return f"controller designed once, for this plant at {number.name} = {number.value * read.factor:.4g}{read.tail}"


def _surroundings(cases: Mapping[str, ClosedLoop]) -> str:
    """Inputs that vary, noise of the sensors, and samples that are late or missed, in words.

    With the labels of the cases that have the noise, or the samples, unless all have the same.
    """
    varying = dict.fromkeys(
        name for loop in cases.values() for name, value in loop.input_values.items() if not isinstance(value, (int, float))
    )
    words = [f"{', '.join(varying)} over time" if varying else "constant inputs"]
    noise = {
        label: ", ".join(sorted({name for update in loop.system.updates for name in update.channels})) for label, loop in cases.items()
    }
    words += _each_once({label: f"noise on {names}" if names else "" for label, names in noise.items()}) or ["no noise"]
    return ", ".join([*words, *_each_once({label: _samples(loop) for label, loop in cases.items()})])


def _each_once(words: Mapping[str, str]) -> list[str]:
    """Words of labelled cases, each once, with its labels unless all cases have the same words; cases without words are left out."""
    labels: dict[str, list[str]] = {}
    for label, each in words.items():
        labels.setdefault(each, []).append(label)
    return [
        each + (f" under {', '.join(f'`{label}`' for label in under)}" if len(labels) > 1 else "") for each, under in labels.items() if each
    ]


def _samples(loop: ClosedLoop) -> str:
    """Lateness and misses of the samples of a loop, in words; empty for a loop that takes every sample in time."""
    late = max((clock.jitter for clock in loop.assembly.clocks), default=0.0)
    missed = max((clock.missed_samples for clock in loop.assembly.clocks), default=0.0)
    words = [
        f"samples late by up to {1e3 * late:.4g} ms" if late else "",
        f"{100.0 * missed:.3g} % of the samples missed" if missed else "",
    ]
    return " and ".join(filter(None, words))
