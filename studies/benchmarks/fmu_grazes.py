"""Why an importer switches otherwise than `simulate`: the guard that turns beside zero, on one side of it here and on the other there.

Where the switches of an importer part from those of `simulate`, both runs are taken just behind their last common switch, and are continued by the master of
our own at a tolerance of 1e-10, in the modes that they have, through zero. What a guard is where it turns back, in both, tells whether the importer passed
over a crossing (then its own state crosses, too), or came by with a state that is a little another one.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import fmpy
import numpy as np
from scipy.optimize import minimize_scalar

from studies.benchmarks.fmu_masters import INSIDE, Master, Switches, by_cvode, exchanged

EXACT = 1e-10
"""Tolerance of the continued runs."""
SHALLOW = 0.01
"""A guard grazes zero where it turns back within this share of its size."""


class Graze(NamedTuple):
    """A guard where the switches of an importer part from those of `simulate`.

    exact, found: what it is where it turns back, as a share of its largest magnitude in that mode before: below zero where it has crossed.
    Infinite where it does not turn, minus infinite where it crosses by more than SHALLOW.
    """

    element: str
    time: float
    exact: float
    found: float

    def __str__(self) -> str:
        sides = [_side(self.exact), f"{_side(self.found)} in the importer's run"]
        kind = "graze" if max(abs(self.exact), abs(self.found)) <= SHALLOW else "no graze"
        return f"{kind}: `{self.element}` at {self.time:.7g} s, whose guard {', '.join(sides)}"


def _side(turn: float) -> str:
    if np.isinf(turn):
        return "does not turn" if turn > 0.0 else f"crosses by more than {SHALLOW:g} of its size"
    return f"turns {abs(turn):.1e} of its size {'behind' if turn < 0.0 else 'before'} zero"


class Turns(Master):
    """A master that keeps the size of every guard, and can look how far one goes if nothing switches."""

    def __init__(self, unit: Any, description: Any, tolerance: float):
        super().__init__(unit, description, tolerance)
        self.sizes: dict[tuple[int, bool], float] = {}

    def look(self, t: float) -> None:
        """Take the modes as they are."""
        self.watch.look(t, self.unit.getInteger(list(self.watch.elements.values())))

    def key(self, j: int) -> tuple[int, bool]:
        """A guard, and whether its element is in mode 0: there it is something else."""
        return j, self.watch.modes[j // 2] == 0

    def indicator(self, t: float, x: np.ndarray) -> np.ndarray:
        """Event indicators, whose sizes are kept."""
        found = super().indicator(t, x)
        for j in range(2 * len(self.watch.modes)):
            self.sizes[self.key(j)] = max(self.sizes.get(self.key(j), 0.0), abs(found[j]))
        return found

    def turn(self, t: float, span: float, j: int, size: float) -> float:
        """The lowest value at which a guard turns back within a span, as a share of its size, if nothing switches; infinite where it does not."""
        x, lowest = self.state(), np.inf
        self.unit.getNominalsOfContinuousStates(self._point(self.nominal), self.states)
        method = self._method(t, x, t + span)
        seen = [(t, self._value(j, t, x))]
        while method.status == "running":
            old = method.t
            with np.errstate(all="ignore"):  # of a step that is far too long
                method.step()
            if method.status == "failed":
                break
            inside = method.dense_output()
            for share in INSIDE:
                at = old + share * (method.t - old)
                seen.append((at, self._value(j, at, inside(at))))
                if seen[-1][1] < -SHALLOW * size:
                    lowest = -np.inf
                if len(seen) > 2 and seen[-3][1] > seen[-2][1] < seen[-1][1]:
                    begin = max(seen[-3][0], old)
                    best = minimize_scalar(
                        lambda s, f=inside: self._value(j, s, f(s)), bounds=(begin, at), method="bounded", options={"xatol": 1e-12 * at}
                    )
                    lowest = min(lowest, seen[-2][1], float(best.fun))
            if np.isinf(lowest) and lowest < 0.0:
                break
        self.go(t, x)
        return lowest / size

    def _value(self, j: int, t: float, x: np.ndarray) -> float:
        return float(Master.indicator(self, t, x)[j])


def first_other(found: Switches, wanted: Switches) -> tuple[float, str]:
    """(time [s], element) of the first switch that only one of two runs has, infinite and without a name where there is none.

    Switches come and go in pairs: one is missing where that of the other run is nearer to the one after the next.
    """
    first = (np.inf, "")
    for element in wanted.keys() | found.keys():
        mine, theirs = found.get(element, []), wanted.get(element, [])
        for i, (one, other) in enumerate(zip(mine, theirs, strict=False)):
            apart = abs(one[0] - other[0])
            lost = i + 2 < len(theirs) and abs(one[0] - theirs[i + 2][0]) < apart
            added = i + 2 < len(mine) and abs(mine[i + 2][0] - other[0]) < apart
            if one[1] != other[1] or lost or added:
                first = min(first, (min(one[0], other[0]), element))
                break
        else:
            common = min(len(mine), len(theirs))
            first = min([first, *((time, element) for time, _ in mine[common:] + theirs[common:])])
    return first


def graze(path: Path, duration: float, tolerance: float, found: Switches, wanted: Switches) -> Graze | None:
    """The guard at which FMPy's CVODE first switches otherwise than `simulate`; None where it does not.

    path: unit of FMI 2.0 for model exchange.  duration [s], tolerance, found: of the run in CVODE.  wanted: the switches of `simulate`.
    """
    parting, element = first_other(found, wanted)
    if not element:
        return None
    pairs = [
        pair for name in wanted for pair in zip(wanted[name], found.get(name, []), strict=False) if max(pair[0][0], pair[1][0]) < parting
    ]
    last, theirs = max(((here[0], there[0]) for here, there in pairs if here[1] == there[1]), default=(0.0, 0.0))
    half = 0.5 * (parting - last)
    description = fmpy.read_model_description(str(path))
    with exchanged(path, EXACT) as plain:
        master = Turns(plain.unit, description, EXACT)
        master.run(last + half, 0.0)
        i = list(master.watch.elements).index(element)
        sizes = {j: master.sizes.get(master.key(j), 0.0) or 1.0 for j in (2 * i, 2 * i + 1)}
        exact = {j: master.turn(last + half, 4.0 * half, j, size) for j, size in sizes.items()}
    there = _turns_in_cvode(path, duration, tolerance, (theirs, theirs + half), 4.0 * half, sizes)
    j = min(sizes, key=lambda each: ((exact[each] > 0.0) == (there[each] > 0.0), abs(exact[each])))  # the one that is on two sides
    return Graze(element, parting, exact[j], there[j])


def _turns_in_cvode(
    path: Path, duration: float, tolerance: float, between: tuple[float, float], span: float, sizes: dict[int, float]
) -> dict[int, float]:
    """Where guards turn in CVODE, from its last point between two times on."""
    description = fmpy.read_model_description(str(path))
    point: list[Any] = []
    turns: dict[int, float] = {}

    def look(time: float, recorder: Any) -> bool:
        if point and time > between[1]:
            recorder.fmu.setFMUState(point[1])
            master = Turns(recorder.fmu, description, EXACT)
            master.look(point[0])
            turns.update({j: master.turn(point[0], span, j, size) for j, size in sizes.items()})
            return False
        if time >= between[0]:
            if point:
                recorder.fmu.freeFMUState(point[1])
            point[:] = [time, recorder.fmu.getFMUState()]
        return True

    by_cvode(path, duration, tolerance, look)
    return turns
