"""The runs behind an onset: each is carried on until the judge can tell its regime, and where regimes of neighbours differ, the border is halved.

Smooth running needs no run where its growth is known: it is lost where the growth changes its sign. Where it grows, a run from a small disturbance tells
what it becomes. How stick-slip and standstill are found and carried on is told in `toolbox.onsets.inside`.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.errors import SimulationError
from toolbox.measuring import measure
from toolbox.measuring.judge import FAILED, NONE, SMOOTH, STANDS, STICKS, Judge, Judged
from toolbox.modelling.steady_point import function_of
from toolbox.onsets.growth import Smooth, SmoothBranch, slip_rows
from toolbox.onsets.report import Border
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState
from toolbox.simulation.trajectory import Trajectory

STEPS = 12
"""Steps in which the parameter goes from one value to the next, with a little more than two periods at each: a jump at once would shake a cycle off."""

FINER = 0.01
"""Part of the accuracy at which both sides of a border are judged again."""

WIDENINGS = 6
"""How often a border is widened where finer runs judge its sides otherwise."""

HALVINGS = 8
"""How often the way to a value at which the growth is not known is halved, to come between there and the border."""

NOISY = 32
"""Swings of smooth running over which the deviation that measurement noise makes is looked at; half as much again may come."""


@dataclass
class OnsetSearch:
    """Runs of one closed loop with one free parameter, judged and counted.

    branch: smooth running without measurement noise: with noise no motion is smooth, and nothing shows whether a disturbance grows. `led` holds
    {value: (regime, end)} of smooth running that was lost into stick-slip or standstill.
    """

    base: Run
    branch: SmoothBranch
    element: str
    signal: str
    perturbation: float
    period: float
    budget: float
    runs: int = 0
    notes: list[str] = field(default_factory=list)
    led: dict[float, tuple[str, RunState]] = field(default_factory=dict)
    bar: Any = None
    resting: dict[float, tuple[float, RunState | None]] = field(default_factory=dict)
    noises: dict[float, float] = field(default_factory=dict)

    def at(self, value: float) -> Run:
        """The run with the free parameter at a value."""
        return self.base.at(self.branch.free, value)

    # ------------------------------------------------------------------------------------------------------------------------------------- one run
    def run(self, value: float, begin: RunState, /, finer: float = 1.0, silent: bool = False) -> tuple[Judged, RunState | None]:
        """What a run at a value of the free parameter comes to, and where it ended; silent: without measurement noise."""
        run = dataclasses.replace(self.branch.at(value) if silent else self.at(value), accuracy=self.base.accuracy * finer)
        self.runs += 1
        if self.bar is not None:
            self.bar.update()

        def on(state: RunState, duration: float) -> Trajectory:
            return run.again(start=state, duration=duration, longest_step=duration / 256)

        try:
            return self.judge(value).carried(on, begin)
        except SimulationError:
            return Judged(FAILED), None

    def judge(self, value: float) -> Judge:
        """The judge of runs at a value."""
        smooth = self.branch(value)
        if smooth is None:
            return Judge(self.element, self.signal, self.period, budget=self.budget)
        target = self.steady(value, smooth)[0]
        return Judge(self.element, self.signal, self.period, target, smooth.growth.rate, self._noise(value, smooth), self.budget)

    def steady(self, value: float, smooth: Smooth) -> tuple[float, RunState | None]:
        """The judged signal in smooth running, and a state of it a moment later, which knows the modes; nan and None where no run goes on from it."""
        if value not in self.resting:
            run = self.branch.at(value)
            try:
                short = run.again(start=smooth.state, duration=self.period / 8, longest_step=self.period / 256)
                self.resting[value] = measure.extent(short, self.signal).mean, short.last
            except SimulationError:
                self.resting[value] = math.nan, None
        return self.resting[value]

    def _noise(self, value: float, smooth: Smooth) -> float:
        """Largest deviation of the judged signal that measurement noise makes in smooth running; 0 without noise, and where smooth running does not last."""
        if self.branch.run is self.base or not smooth.growth.rate < 0:
            return 0.0
        if value not in self.noises:
            run = self.at(value).again(start=smooth.state, duration=NOISY * self.period, longest_step=self.period / 32)
            found, target = measure.extent(run, self.signal, run.begin), self.steady(value, smooth)[0]
            self.noises[value] = 1.5 * max(found.maximum - target, target - found.minimum)
        return self.noises[value]

    def plain(self, value: float, begin: RunState, duration: float) -> Trajectory | None:
        """A run that is only to settle, at an accuracy at which its cycle can be told; None where it fails."""
        accuracy = min(self.base.accuracy, 1e-9)
        try:
            return self.at(value).again(start=begin, accuracy=accuracy, duration=duration, longest_step=duration / 256)
        except SimulationError:
            return None

    def walked(self, begin: RunState, origin: float, value: float) -> RunState:
        """Where the machine is after the free parameter went from one value to another in small steps."""
        if value == origin:
            return begin
        for k in range(1, STEPS):
            try:
                run = self.at(origin + (value - origin) * k / STEPS)
                begin = run.again(start=begin, duration=2.3 * self.period, longest_step=self.period / 256).last
            except SimulationError:
                return begin
        return begin

    # ----------------------------------------------------------------------------------------------------------------------- from smooth running
    def smooth(self, value: float, finer: float = 1.0) -> Judged:
        """What the least disturbance of smooth running comes to; where it ends in stick-slip or standstill, its end is kept to continue from."""
        found = self.branch(value)
        if found is None:
            return Judged(NONE)
        if found.growth.rate < 0:
            return Judged(SMOOTH, 0.0, rate=found.growth.rate)
        judged, end = self.run(value, self._disturbed(value, found), finer=finer, silent=True)
        if judged.regime in (STICKS, STANDS) and end is not None:
            self.led.setdefault(value, (judged.regime, end))
        return judged

    def _disturbed(self, value: float, found: Smooth) -> RunState:
        """Smooth running moved along its least damped motion, until the slip of the judged contact changes by the perturbation at most."""
        n, names = found.state.states.size, [element.name for element in self.base.system.elements]
        slope = slip_rows(self.base.system, found.state.states, self.at(value).system.values)[names.index(self.element)]
        moved, sizes = abs(float(slope @ found.direction[:n])), np.abs(slope) @ np.abs(found.direction[:n])
        if moved > 1e-9 * sizes:
            size = abs(self.steady(value, found)[0] or 1.0) / moved
        else:  # this motion does not move the contact
            size = np.abs(found.state.states).max(initial=1.0) / np.abs(found.direction).max(initial=1e-300)
        return found.state.at_values(found.state.values + self.perturbation * size * found.direction)

    def losses(self, values: Sequence[float], tolerance: float) -> list[Border]:
        """The borders of smooth running: where its growth changes its sign, else between neighbours of which one has no smooth running."""
        safe = [self.smooth(value).regime == SMOOTH for value in values]
        found = []
        for (a, safe_a), (b, safe_b) in itertools.pairwise(zip(values, safe, strict=True)):
            if safe_a == safe_b:
                continue
            try:
                found.append(self._where_growth_is_zero(a, b, tolerance))
            except SimulationError:
                found += self.borders((a, b), (safe_a, safe_b), self._is_smooth, tolerance)
        return found

    def _where_growth_is_zero(self, a: float, b: float, tolerance: float) -> Border:
        """The border of smooth running between two values; raises SimulationError where its growth is not known on both sides."""
        a, b, way = self._bracket(a, b)
        precision = 1e-9 * max(abs(a), abs(b)) if way != "twin runs" else tolerance / 10
        return Border(self.branch.loss(a, b, precision), precision, "above" if self.branch.rate(b) < 0 else "below", True, followed=way)

    def _bracket(self, a: float, b: float) -> tuple[float, float, str]:
        """Values between two at which the growth is known and has different signs, and how it is known; raises SimulationError where there are none nearby."""
        for _ in range(HALVINGS):
            rates = self.branch.rate(a), self.branch.rate(b)
            if rates[0] * rates[1] < 0:
                smooth = self.branch(a)
                return a, b, smooth.growth.way if smooth is not None else ""
            middle = (a + b) / 2
            rate = self.branch.rate(middle)
            if math.isnan(rates[0]) == math.isnan(rates[1]):
                break
            if math.isnan(rates[0]) == (math.isnan(rate) or rate * np.nansum(rates) < 0):
                a = middle
            else:
                b = middle
        raise SimulationError("The growth of smooth running is not known on both sides of its border.")

    def _is_smooth(self, value: float, origin: float, finer: float = 1.0) -> bool:
        return self.smooth(value, finer).regime == SMOOTH

    def stopped(self, value: float) -> RunState | None:
        """Smooth running whose judged contact is stopped at once, as by a stuck bit; None where there is no smooth running."""
        smooth = self.branch(value)
        if smooth is None:
            return None
        plant, last = self.at(value).plant, self.steady(value, smooth)[1]
        modes = (
            dict(zip([each.name for each in self.base.system.elements], last.modes, strict=True))
            if last is not None and last.modes is not None
            else {}
        )
        m = np.array([0.0 if each.name == self.element else modes.get(each.name, 1.0) for each in plant.elements])
        x = np.concatenate([np.atleast_1d(smooth.state[name]) for name in plant.states])
        u = np.array(plant.input_defaults(plant.values)).ravel()
        project = function_of(plant, ("project",), lambda: [plant.switching.projected])
        x = np.array(project(0.0, x, u, plant.values, m)).ravel()
        places = {name: (first, size) for name, (first, size, _) in plant.states.items()}
        return smooth.state.with_values({name: x[first : first + (size or 1)] for name, (first, size) in places.items()})

    # ---------------------------------------------------------------------------------------------------------------------------------- borders
    def borders(self, values: Sequence[float], safe: Sequence[bool], test: Callable[..., bool], tolerance: float) -> list[Border]:
        """The borders between neighbours of different verdict, halved to the tolerance, then judged again at a hundredth of the accuracy.

        What is judged otherwise there, since the border moves with the accuracy, is passed by ever longer steps, so that the border lies between what is sure.
        """
        found = []
        for (a, safe_a), (b, safe_b) in itertools.pairwise(zip(values, safe, strict=True)):
            if safe_a == safe_b:
                continue
            good, bad = outer_good, outer_bad = (a, b) if safe_a else (b, a)
            while 1.5 * abs(good - bad) > tolerance:
                middle = (good + bad) / 2
                if test(middle, bad):
                    good = middle
                else:
                    bad = middle
            confirmed = False
            for _ in range(WIDENINGS):
                wrong = next((each for each in (good, bad) if test(each, bad, finer=FINER) != (each == good)), None)
                confirmed = wrong is None
                if wrong in (None, outer_good, outer_bad):
                    break
                step = 2 * (bad - good)
                if wrong == good:
                    good = good - step if abs(good - step - bad) < abs(outer_good - bad) else outer_good
                else:
                    bad = bad + step if abs(bad + step - good) < abs(outer_bad - good) else outer_bad
            found.append(Border((good + bad) / 2, 1.5 * abs(good - bad), "above" if good > bad else "below", confirmed))
        return found
