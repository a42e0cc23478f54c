"""The runs behind an onset.

At every value of the parameter one run starts from the steady state, disturbed a little along its least damped motion; how stick-slip and standstill are found
and carried on is told in `toolbox.onsets.inside`. Where a verdict changes between neighbours the border is halved down to the tolerance, each run beginning
where the one before it ended; then both sides are judged again by a longer and by a more accurate run.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from toolbox.errors import SimulationError
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.numbers import Number
from toolbox.modelling.steady_point import Equilibrium, function_of
from toolbox.onsets.report import STICKING, Border, Judged
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState
from toolbox.simulation.trajectory import Trajectory
from toolbox.steady_states.equilibria import EquilibriumBranch, flow_slopes, state_values
from toolbox.steady_states.poles import critical_pole


@dataclass
class OnsetSearch:
    """Runs of one closed loop with one free parameter, judged and counted.

    `silence` holds {parameter: zeros} that turn measurement noise off: with noise no motion is smooth, and nothing shows whether a disturbance grows. `led`
    holds {value: (verdict, end)} of smooth running that was lost into stick-slip or standstill.
    """

    base: Run
    free: Number
    followed: EquilibriumBranch
    element: str
    signal: str
    perturbation: float
    silence: dict[str, Any] = field(default_factory=dict)
    period: float = 1.0
    duration: float = 0.0
    runs: int = 0
    notes: list[str] = field(default_factory=list)
    led: dict[float, tuple[str, RunState]] = field(default_factory=dict)
    bar: Any = None

    def run(
        self, value: float, begin: RunState, others: Mapping[str, Any] | None = None, /, longer: float = 1.0, finer: float = 1.0
    ) -> tuple[Judged, RunState | None]:
        """One run at a value of the free parameter, and with other numbers, and where it ended."""
        changes: dict[str, Any] = {"start": begin, "accuracy": self.base.accuracy * finer}
        changes |= self.numbers(value, others)
        duration = longer * self.duration
        self.runs += 1
        if self.bar is not None:
            self.bar.update()
        for _ in range(3):
            try:
                run = self.base.again(duration=duration, longest_step=duration / 256, **changes)
            except SimulationError:
                return Judged("failed"), None
            judged = self.judged_run(run, value)
            if judged.verdict != "unclear":
                break
            duration *= 4  # a cycle so slow that too few stick phases fit: look at it for longer
        else:
            judged = dataclasses.replace(judged, verdict="stuck")
        return judged, run.last

    def plain(self, value: float, begin: RunState, duration: float) -> Trajectory | None:
        """A run that is only to settle, at an accuracy at which its cycle can be told; None where it fails."""
        changes: dict[str, Any] = {"start": begin, "accuracy": min(self.base.accuracy, 1e-9)}
        try:
            return self.base.again(duration=duration, longest_step=duration / 256, **changes, **self.numbers(value))
        except SimulationError:
            return None

    def numbers(self, value: float, others: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Changes of a run for a value of the free parameter, and for other numbers of the plant."""
        if self.free.is_input:
            return {"inputs": {**self.base.inputs, self.free.name: value}, "system": self.base.system.with_parameters(others or {})}
        return {"system": self.base.system.with_parameters({self.free.name: value, **(others or {})})}

    def walked(self, begin: RunState, origin: float, value: float) -> RunState:
        """Where the machine is after the free parameter went from one value to another in small steps: a jump at once would shake it out of its cycle."""
        if value == origin:
            return begin
        for k in range(1, STEPS):
            middle = origin + (value - origin) * k / STEPS
            try:
                run = self.base.again(start=begin, **self.numbers(middle), duration=2.3 * self.period, longest_step=self.period / 256)
            except SimulationError:
                return begin
            begin = run.last
        return begin

    def judged_run(self, run: Trajectory, value: float) -> Judged:
        """The verdict on the second half of a run."""
        from toolbox.measuring import measure

        half = run.begin + run.duration / 2
        shortest = max(10 * self.base.accuracy, 1e-6) * self.period
        sticks = [(a, b) for a, b in measure.stick_intervals(run, self.element, half) if b - a > shortest]
        longest = max((b - a for a, b in sticks), default=0.0)
        # whole cycles at the end say how large they are, also those that stick twice or three times
        last = min(max(len(sticks) - 1, 0) // 2 * 2, 6)
        whole = (sticks[-1 - last][0], sticks[-1][0]) if last else (max(half, run.end - 8 * self.period), None)
        found = measure.extent(run, self.signal, *whole)
        swing = found.maximum - found.minimum
        severity = swing / (2 * abs(found.mean)) if found.mean else math.inf if swing else math.nan
        if sticks:
            gap = max(np.diff([a for a, _ in sticks]), default=math.inf)
            if len(sticks) >= 3 and run.end - sticks[-1][1] <= 2 * gap:
                return Judged("stick-slip", severity, len(sticks), longest)
            if len(sticks) < 3 and (sticks[-1][1] >= run.end or run.end - sticks[-1][1] < sticks[-1][0] - half):
                return Judged("unclear", severity, len(sticks), longest)
        rest = self.followed(value)
        if rest is None:
            return Judged("swing" if swing else "smooth", severity, len(sticks), longest)
        target = float(np.ravel(rest[self.signal])[0])
        early = measure.extent(run, self.signal, run.begin, min(run.begin + 2 * self.period, half))
        first, late = (max(abs(e.maximum - target), abs(e.minimum - target)) for e in (early, found))
        calm = late < first or late <= 10 * self.base.accuracy * max(abs(target), abs(found.maximum), abs(found.minimum))
        return Judged("smooth" if calm else "swing", severity, len(sticks), longest)

    # ------------------------------------------------------------------------------------------------------------------- from smooth running
    def smooth(self, value: float, **changes: float) -> Judged:
        """The verdict from the disturbed steady state; where it ends in stick-slip, its end is kept to continue from."""
        rest = self.followed(value)
        if rest is None:
            return Judged("none")
        judged, end = self.run(value, self.disturbed(rest), self.silence, **changes)
        if judged.verdict in STICKING and end is not None:
            self.led.setdefault(value, (judged.verdict, end))
        return judged

    def is_smooth(self, value: float, origin: float, **changes: float) -> bool:
        """Whether smooth running is stable at a value."""
        return self.smooth(value, **changes).verdict == "smooth"

    def disturbed(self, rest: Equilibrium) -> RunState:
        """The steady state moved along its least damped motion, until the slip of the judged contact changes by the perturbation at most."""
        plant = rest.plant
        _, vector = critical_pole(rest)
        index = [element.name for element in plant.elements].index(self.element)
        slope = np.array(function_of(plant, ("slip_slope", self.element), lambda: [_slip_slope(plant, index)])(
            0.0, rest.states, rest.inputs, plant.values, mode_codes(rest))).ravel()  # fmt: skip
        slip = float(np.array(plant.slips(0.0, rest.states, rest.inputs, plant.values, mode_codes(rest))).ravel()[index])
        phase = slope @ vector
        if abs(phase) <= 1e-12 * np.linalg.norm(slope) * np.linalg.norm(vector):  # this motion does not move the contact
            motion = np.real(vector)
            x = rest.states + self.perturbation * np.abs(rest.states).max(initial=1.0) * motion / np.abs(motion).max()
        else:
            x = rest.states + self.perturbation * abs(slip or 1.0) * np.real(vector / phase)
        return self.begin(rest, x)

    def begin(self, rest: Equilibrium, x: np.ndarray) -> RunState:
        """A state of the continuous loop as the beginning of a run: states of sampled laws become their memory, what they drive is held."""
        system, known = self.base.system, state_values(rest.plant, x)
        for update in system.updates:
            unknown = [name for name in update.places if name not in known]
            note = f"the memory {', '.join(unknown)} of a sampled law is no state of its continuous form, and begins at zero"
            if unknown and note not in self.notes:
                self.notes.append(note)
            known |= {name: rest[name] for name in update.names}
        return RunState.begun(system, self.base.plant, self.base.clocks).with_values(known)

    # ---------------------------------------------------------------------------------------------------------------------------------- borders
    def borders(self, values: Sequence[float], safe: Sequence[bool], test: Callable[..., bool], tolerance: float) -> list[Border]:
        """The borders between neighbours of different verdict, halved to the tolerance and judged again by longer and by finer runs."""
        found = []
        for (a, safe_a), (b, safe_b) in itertools.pairwise(zip(values, safe, strict=True)):
            if safe_a == safe_b:
                continue
            good, bad = outer_good, outer_bad = (a, b) if safe_a else (b, a)
            longer, confirmed = 1.0, False
            for attempt in range(ROUNDS):
                while 1.5 * abs(good - bad) > tolerance:
                    middle = (good + bad) / 2
                    if test(middle, bad, longer=longer):
                        good = middle
                    else:
                        bad = middle
                wrong = self.contradicted(good, bad, test)
                confirmed = wrong is None
                if confirmed:
                    break
                if wrong in (outer_good, outer_bad) or attempt == ROUNDS - 1:
                    break
                # the verdict came too early: the search goes on between there and the neighbour, with longer runs
                longer = 5.0
                good, bad = (outer_good, good) if wrong == good else (bad, outer_bad)
            found.append(Border((good + bad) / 2, 1.5 * abs(good - bad), "above" if good > bad else "below", confirmed))
        return found

    @staticmethod
    def contradicted(good: float, bad: float, test: Callable[..., bool]) -> float | None:
        """The side of a border that longer or finer runs judge otherwise; None where both agree."""
        for changes in ({"longer": 5.0}, {"finer": 0.01}):
            if not test(good, bad, **changes):
                return good
            if test(bad, bad, **changes):
                return bad
        return None


STEPS = 12
"""Steps in which the parameter goes from one value to the next, with a little more than two periods at each."""

ROUNDS = 6
"""How often the search for a border is taken up again, with runs five times as long."""


def mode_codes(rest: Equilibrium) -> np.ndarray:
    """The modes of a steady state as numbers."""
    codes = [{word: float(code) for code, word in element.legend.items()} for element in rest.plant.elements]
    return np.array([code[rest.modes[element.name]] for code, element in zip(codes, rest.plant.elements, strict=True)])


def _slip_slope(plant: HybridSystem, index: int) -> Any:

    return ca.jacobian(plant.switching.slip[index], plant.x)


def swing_period(rest: Equilibrium) -> float:
    """Period of the least damped swing of a steady state [s], or the time constant of its slowest motion where nothing swings."""
    poles = np.linalg.eigvals(flow_slopes(rest))
    poles = poles[np.abs(poles) > 1e-9 * np.abs(poles).max(initial=0.0)]
    swinging = poles[poles.imag > 1e-6 * np.abs(poles)]
    if swinging.size:
        return float(2 * math.pi / swinging[int(np.argmax(swinging.real))].imag)
    return float(2 * math.pi / np.abs(poles).min(initial=1.0)) if poles.size else 1.0
