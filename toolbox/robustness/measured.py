"""Margins of the machine itself: the gain, the delay and the inertia at which the closed loop stops running smoothly, found by simulation.

They are for laws that no linear loop describes, relays and ideal sliding modes for instance, and say of any law what its linear margins leave out: limits,
and the contact itself. A law whose memory at steady running is known starts with it, two percent below its speed; any other starts cold there and
must take over before it must hold.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from toolbox.errors import SceneError, SimulationError, suggest
from toolbox.halving import halved
from toolbox.measuring import measure
from toolbox.measuring.sticks import is_stick, stuck_ratio
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.components import Equations, Signal, Update
from toolbox.modelling.elements import Quantity, quantity
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled, designed, law_word
from toolbox.scenes.judged import judged_speed
from toolbox.simulation.budget import Budget
from toolbox.simulation.methods import EventExact
from toolbox.simulation.simulate import simulate
from toolbox.simulation.trajectory import Trajectory

FACTORS = (1.05, 1.1, 1.2, 1.35, 1.6, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0)
"""Factors that are tried one after the other until one fails; then the last interval is halved."""
RIPPLE = 0.05
"""Part of its mean by which a command may swing to either side; twice what it does on the machine as it is, where that is more."""
SEVERE = 0.05
"""Severity above which a run is carried on."""

PIECES, SAME, UNSEEN = 8, 1.01, 1e-6
"""How often a run is carried on that is not calm, what a swing may grow by from one quarter of it to the next, and the severity below which nothing swings."""
LIMITS = EventExact(budget=Budget(steps=2_000_000))
"""What a run may take: steps, which every machine takes alike."""
CLOSE = 0.01
"""Part of its value to which a margin is measured."""


@dataclass(frozen=True)
class MeasuredMargins:
    """Simulated margins of a machine, to 1 %: factors and a delay [s] at which it fails. 0 or infinity if no failure was found, nan if not
    searched.

    - lowest_gain, highest_gain: factors of all commands at once;
    - delay: additional delay of all commands [s], nan for continuous laws;
    - lowest_inertia, highest_inertia: factors of the inertia that was named.
    """

    lowest_gain: float = math.nan
    highest_gain: float = math.nan
    delay: float = math.nan
    lowest_inertia: float = math.nan
    highest_inertia: float = math.nan


@dataclass(frozen=True)
class Amplified(Controller):
    """A law whose commands are multiplied by a factor on their way to the plant. The law does not know the factor."""

    holds_law: ClassVar[bool] = True

    law: Controller = dataclasses.field(default_factory=Controller)
    factor: Quantity = quantity(1.0, "1", "factor of the commands")

    @property
    def actuated_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """What the law drives."""
        return self.law.actuated_signals

    def design(self, plant: HybridSystem) -> Amplified:
        """The law designed on the plant, without the factor."""
        return dataclasses.replace(self, law=designed(self.law, plant))

    def continuous(self, signal: Signal) -> Equations:
        equations = self.law.continuous(signal)
        return dataclasses.replace(equations, outputs=self._amplified(equations.outputs))

    def sampled(self, signal: Signal, period: Any) -> Update:
        update = self.law.sampled(signal, period)
        return dataclasses.replace(update, outputs=self._amplified(update.outputs))

    def _amplified(self, given: Mapping[str, tuple[Any, str]]) -> dict[str, tuple[Any, str]]:
        return {name: (self.factor * value if name in self.law.actuated_signals else value, unit) for name, (value, unit) in given.items()}


class AmplifiedCallable:
    """A Python law (t, y) -> u whose commands are multiplied by a factor."""

    def __init__(self, law: Callable[..., Any], factor: float):
        self.law, self.factor = law, factor
        for name in ("measured_signals", "actuated_signals", "defaults"):
            if hasattr(law, name):
                setattr(self, name, getattr(law, name))

    def __call__(self, t: float, y: Any) -> Any:
        return self.factor * np.asarray(self.law(t, y), float)


def with_gain(law: Any, factor: float) -> Any:
    """A law, `Sampled` or not, with its commands multiplied by a factor."""
    if isinstance(law, Sampled):
        return dataclasses.replace(law, law=with_gain(law.law, factor))
    return Amplified(law, factor, name=law_word(law)) if isinstance(law, Controller) else AmplifiedCallable(law, factor)


def with_delay(law: Any, delay: float) -> Any:
    """A `Sampled` law whose commands come some delay [s] later."""
    return dataclasses.replace(law, delay=law.delay + delay) if isinstance(law, Sampled) else law


def measured_margins(loop: ClosedLoop, *, duration: float, inertia: str | None = None) -> MeasuredMargins:
    """Return the gain, delay and inertia at which a closed loop fails after a start from smooth running.

    A run fails where it cannot be finished, or where in its second half a contact sticks. Where the severity in that half is above SEVERE, or grows within
    it, the run is carried on by as much again, up to PIECES times, because a law may lift the set-point for a while, and a loop may grow slowly; it fails
    if it never calms down, or where a command swings by more than RIPPLE then.

    - loop: its start is smooth running, of the plant and of the memory of laws;
    - duration [s] of a run;  inertia: name of a parameter that is one number.

    Raises SceneError for an unknown `inertia` and for a plant without a contact.
    """
    plant, system = loop.plant, loop.system
    made = zip(loop.controllers, loop.designed_controllers, strict=True)
    laws = [dataclasses.replace(given, law=law) if isinstance(given, Sampled) else law for given, law in made]
    contacts = [element.name for element in plant.elements if element.law is not None]
    if not contacts and not plant.modeless:
        raise SceneError("The plant must have a contact with dry friction to be judged, but it has none.")
    if inertia is not None and (
        not plant.has_parameter(inertia) or (inertia in plant.parameters and plant.parameters[inertia].size is not None)
    ):
        raise SceneError(
            f"Argument `inertia` must name one number of the plant, but it is {inertia!r}: {suggest(str(inertia), plant.parameters)}"
        )
    speeds = [judged_speed(plant, name) for name in [*contacts, *plant.modeless]]

    def changed(gain: float, delay: float, factor: float) -> ClosedLoop:
        changed = dataclasses.replace(loop, controllers=tuple(with_delay(with_gain(law, gain), delay) for law in laws))
        if inertia is not None and factor != 1.0:
            changed = changed.with_parameters({inertia: factor * float(system.parameter(inertia))})
        return changed

    def calm(done: Trajectory) -> bool:
        """Whether the second half of a run swings little, and less and less."""
        quarters = [done.begin + part * duration for part in (0.5, 0.75, 1.0)]
        pairs = [[measure.severity(done, speed, a, until=b) for a, b in itertools.pairwise(quarters)] for speed in speeds]
        return all(late < SEVERE and early < SEVERE and (late <= SAME * early or late < UNSEEN) for early, late in pairs)

    swings: list[np.ndarray] = []

    def fails(gain: float = 1.0, delay: float = 0.0, factor: float = 1.0) -> bool:
        own, start = changed(gain, delay, factor), None
        for _ in range(PIECES):
            try:
                done = simulate(own, duration, start=start, method=LIMITS)
            except SimulationError:
                return True
            after, start = done.begin + duration / 2, done.last
            if any(is_stick(stuck_ratio(done, name, after)) for name in contacts):
                return True
            if calm(done):
                break
        else:
            return True
        swings.append(np.array([measure.severity(done, name, after) for name in plant.inputs if name not in system.inputs]))
        return bool((swings[-1] > np.maximum(RIPPLE, 2.0 * swings[0])).any())

    if fails():
        none = 1.0 if inertia is not None else math.nan
        return MeasuredMargins(1.0, 1.0, 0.0, none, none)
    sampled = [law for law in laws if isinstance(law, Sampled)]
    delay = math.nan
    if len(sampled) == len(laws):
        unit = min(law.period for law in sampled)
        delay = border(lambda late: fails(delay=late), [0.0, *(unit * 2.0**k for k in range(-1, 12) if unit * 2.0**k < duration / 4)])
    return MeasuredMargins(
        lowest_gain=1.0 / border(lambda k: fails(gain=1.0 / k), [1.0, *FACTORS]),
        highest_gain=border(lambda k: fails(gain=k), [1.0, *FACTORS]),
        delay=delay,
        lowest_inertia=math.nan if inertia is None else 1.0 / border(lambda k: fails(factor=1.0 / k), [1.0, *FACTORS]),
        highest_inertia=math.nan if inertia is None else border(lambda k: fails(factor=k), [1.0, *FACTORS]),
    )


def border(fails: Callable[[float], bool], values: Sequence[float]) -> float:
    """Return the first of increasing values at which `fails` is true, refined to `CLOSE` by halving; infinity if no value fails."""
    for low, high in itertools.pairwise(values):
        if fails(high):
            return 0.5 * sum(halved(fails, low, high, CLOSE))
    return math.inf
