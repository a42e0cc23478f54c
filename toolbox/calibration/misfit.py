"""What misfits have in common: where their data come from, and of the law of a contact its numbers and the signals that it takes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, reduce
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import count_of, within
from toolbox.calibration.recording import Recording
from toolbox.calibration.shifts import Shift
from toolbox.errors import SceneError
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.components import numbers_of
from toolbox.modelling.hybrid_system import HybridSystem, Parameter
from toolbox.modelling.numbers import Number
from toolbox.sweeps.variants import driving, passing


def _both(passes: Callable[[Sequence[float]], bool], actuated_signals: Callable[[np.ndarray], np.ndarray]) -> Callable[[list[float]], bool]:
    """Whether a part passes its checks with some numbers and none of its friction laws drives."""
    return lambda values: passes(values) and not actuated_signals(np.array([values]))[0]


class Misfit:
    """A misfit to one window of a recording."""

    loop: ClosedLoop
    recording: Recording
    numbers: Sequence[Number]
    measured: dict[str, np.ndarray]

    def at(self, values: np.ndarray) -> ClosedLoop:
        """The loop with the free numbers at given values; raises SceneError where numbers contradict each other."""
        free = zip(self.numbers, values.tolist(), strict=True)
        return reduce(lambda loop, pair: pair[0].put(loop, pair[1]), (pair for pair in free if not pair[0].is_shift), self.loop)

    @property
    def span(self) -> float:
        """Time that was measured [s]."""
        return float(self.recording.time[-1])

    @property
    def source(self) -> str:
        """Where the data come from."""
        return self.recording.source

    def deviations(self, output: str) -> np.ndarray:
        """Standard deviations of samples of an output that are known in another way than by measuring them; nan of all others."""
        return np.full(self.measured[output].size, np.nan)

    def blocks(self, output: str) -> list[int]:
        """Number of samples of an output in each recording, in their order."""
        return [self.measured[output].size]

    def apart(self, values: np.ndarray) -> dict[str, float]:
        """{output: how far from the model its first samples are}, of those that begin elsewhere; none where nothing is simulated from a start."""
        return {}


class ContactMisfit(Misfit):
    """A misfit of the law of a contact, without simulation.

    _last: the free values of which the numbers of the plant were asked last, and these numbers.
    """

    plant: HybridSystem
    contact: str
    output: str
    shifts: Sequence[Shift]
    _last: tuple[bytes, np.ndarray]
    steps = 1
    exact, by_samples = True, True

    def _force_at(self, values: np.ndarray) -> np.ndarray:
        """The force of the law at the samples that count."""
        raise NotImplementedError

    def _slopes_at(self, values: np.ndarray) -> np.ndarray:
        """Its derivatives with respect to the free numbers, shape (nt, k); those of shifts are left open."""
        raise NotImplementedError

    def model(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """The force of the law at the measured slip."""
        return self._once("model", values, self._force_at)

    def slopes(self, values: np.ndarray, sizes: np.ndarray) -> dict[str, np.ndarray]:
        """Derivatives of `model` with respect to the free numbers, shape (nt, k): exact, those of a shift by central differences."""
        return self._once("slopes", values, self._all_slopes_at)

    def _all_slopes_at(self, values: np.ndarray) -> np.ndarray:
        found = self._slopes_at(values)
        for shift in self.shifts:
            step = np.zeros(values.size)
            step[shift.place] = 0.1 * self.recording.interval
            ahead, back = (self._force_at(values + sign * step) for sign in (1.0, -1.0))
            found[:, shift.place] = (ahead - back) / (2.0 * step[shift.place])
        return found

    def horizons(self) -> list[Any]:
        """The misfit itself: samples of a loop do not know of each other, and what a law remembers fades."""
        return [self]

    def _once(self, what: str, values: np.ndarray, find: Callable[[np.ndarray], np.ndarray]) -> dict[str, np.ndarray]:
        """{output: what is found at some values}, kept until it is asked for at others: a search asks more than once where it begins."""
        key = values.tobytes(), self.steps
        kept: dict[str, tuple[Any, np.ndarray]] = self.__dict__.setdefault("_known", {})
        if what not in kept or kept[what][0] != key:
            kept[what] = key, find(values)
        return {self.output: kept[what][1]}

    def allowed(self, values: np.ndarray) -> None:
        """Raise SceneError where the numbers contradict each other."""
        self._numbers(values)

    def _of_plant(self, values: np.ndarray) -> dict[str, float]:
        """{parameter: value} of those that are free."""
        free = zip(self.numbers, values.tolist(), strict=True)
        return {number.name: value for number, value in free if number.is_parameter}

    def _numbers(self, values: np.ndarray) -> np.ndarray:
        """All numbers of the plant; raises SceneError where they contradict each other. Kept for the slopes at the same place."""
        key = values.tobytes()
        if self._last[0] != key:
            free = self._of_plant(values)
            entries, checks = self._entries
            at = list(free.values())
            good = all(within(value, entry.bounds) for value, entry in zip(at, entries, strict=True))
            if good and all(passes([at[i] for i in own]) for own, passes in checks):
                found = self.plant.values.copy()
                found[[entry.offset for entry in entries]] = at
            else:  # which finds the words for it
                found = self.plant.with_parameters(free).values
            self._last = (key, found)
        return self._last[1]

    @cached_property
    def _entries(self) -> tuple[list[Parameter], list[tuple[list[int], Callable[[list[float]], bool]]]]:
        """The parameters that are free, and for every part that has some of them their places among these and whether it passes its checks with others,
        of which one is that its friction laws oppose their slip.
        """
        entries = [self.plant._parameter(number.name) for number in self.numbers if number.is_parameter]
        checks = []
        for part, first in zip(self.plant.parts, self.plant._offsets(), strict=True):
            last = first + len(numbers_of(part))
            own = [i for i, entry in enumerate(entries) if first <= entry.offset < last]
            if own:
                given = part, self.plant.values, first, [entries[i].offset for i in own]
                checks.append((own, _both(passing(*given), driving(*given))))
        return entries, checks

    def _force_signal(self, recording: Recording, symbols: ca.SX) -> str:
        """The measured signal that holds the force; symbols: what that force depends on, and no other signal that is no state."""
        able = [
            name
            for name, (expression, _) in self.plant.signals.items()
            if expression.numel() == 1 and ca.depends_on(expression, symbols) and self.plant.state_index(name) is None
        ]
        there = [name for name in recording.signals if name in able]
        if len(there) != 1:
            raise SceneError(
                f"The data must hold exactly one signal with the force of `{self.contact}`, such as {' or '.join(f'`{name}`' for name in able)}, but "
                f"they hold {' and '.join(f'`{name}`' for name in there) or 'none'}."
            )
        return there[0]

    def _missing(self, row: int) -> SceneError:
        """The error that a state on which the friction depends was not measured."""
        symbol, held = self.plant.x[row], ", ".join(f"`{name}`" for name in self.recording.signals)
        own = [
            name if size is None else f"{name}.{row - first}"
            for name, (first, size, _) in self.plant.states.items()
            if first <= row < first + count_of(size)
        ]
        alias = [name for name, (e, _) in self.plant.signals.items() if e.numel() == 1 and ca.is_equal(e, symbol)]
        label: Any = (alias or own)[0]
        return SceneError(f"The data must hold `{label}`, which the friction of `{self.contact}` depends on, but they hold only {held}.")
