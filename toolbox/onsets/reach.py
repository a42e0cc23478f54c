"""Starts from which the stick-slip beside smooth running is reached at one place: rest, a stopped contact, stick-slip under constant commands, kicks.

Where smooth running is stable, a loop may keep a stick-slip that hardly any start leads to. A verdict must not say of it that stick-slip never ends by itself:
that holds once the loop is in it, and not for the stick-slip under another controller. So runs from many starts are counted.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from toolbox.errors import SceneError, SimulationError
from toolbox.measuring.judge import STICKS
from toolbox.modelling.closing import described
from toolbox.onsets.carried import DAMPED, Carried, JudgedRuns, Place
from toolbox.onsets.motions import moved, slip_rows, swings
from toolbox.onsets.results import Reached
from toolbox.onsets.takeover import BEFORE, PHASES, taken_over, under_controller, under_held_commands
from toolbox.simulation.request import Request
from toolbox.simulation.run_state import RunState
from toolbox.steady_states.running import at_set_points

KICKS = 20
"""Kicks of smooth running that are tried."""

HARDEST = 4.0
"""The hardest kick, in multiples of the speed of the contact in smooth running."""

HELD, KICKED = "the stick-slip under constant commands", f"a kick of up to {HARDEST:g} times the speed"
"""Starts of several runs."""


def reached_from(carried: Carried[Place], value: Place, initial: Any = None) -> tuple[Reached, ...]:
    """Return how many runs from each kind of start end in stick-slip at a place that has smooth running; empty if it has none.

    initial: another controller, whose stick-slip is taken over as well.
    """
    if carried.search.steady(value)[1] is None:
        return ()
    counted: dict[str, list[tuple[bool, float]]] = {}
    for begun, size, begin in itertools.chain(_present(carried, value, initial), _starts(carried, value)):
        judged = carried.tried(value, begin, begun=begun, known=carried.known(value))
        counted.setdefault(begun, []).append((judged.regime == STICKS, size))
    return tuple(
        Reached(begun, sum(sticks for sticks, _ in runs), len(runs), min((size for sticks, size in runs if sticks), default=math.nan))
        for begun, runs in counted.items()
    )


def _present(carried: Carried[Place], value: Place, initial: Any) -> Iterator[tuple[str, float, RunState]]:
    """The phases of the stick-slip of another controller; none without one, and where it does not stick and slip."""
    if initial is None:
        return
    loop = carried.search.at(value).loop
    with contextlib.suppress(SceneError, SimulationError):
        starts, note = under_controller(loop, initial, PHASES, BEFORE)
        for start in [] if note else starts:
            begin = Request(loop.replace(start=start), 0.0, accuracy=carried.search.base.accuracy).checked().start
            yield f"the stick-slip under {described(initial)}", math.nan, begin


def _starts(carried: Carried[Place], value: Place) -> Iterator[tuple[str, float, RunState]]:
    """(what it is, size of the kick or nan, state) of every start at a place."""
    search = carried.search
    yield from ((begun, math.nan, begin) for begun, begin in carried.still_starts(value))
    yield from ((HELD, math.nan, begin) for begin in held_starts(carried.search, value))
    smooth = search.branch(value)
    if smooth is None:
        return
    with contextlib.suppress(SceneError):
        point = at_set_points(search.at(value).loop)
        row = slip_rows(point.plant, point.states, point.plant.values)[[each.name for each in point.plant.elements].index(search.element)]
        motions = [motion for exponent, motion in swings(point, row, real=False) if -exponent.real <= DAMPED * abs(exponent)]
        random = np.random.default_rng(0)
        for _ in range(KICKS if motions else 0):
            size, shares = random.uniform(0.0, HARDEST), random.dirichlet(np.ones(len(motions)))
            turned = np.exp(2j * math.pi * random.random(len(motions)))
            motion = sum(share * np.real(turn * each) for share, turn, each in zip(shares, turned, motions, strict=True))
            yield KICKED, size, moved(smooth.state, point.plant, size * abs(search.steady(value)[0]) * motion)


def held_starts(search: JudgedRuns[Place], value: Place) -> Iterator[RunState]:
    """Yield states of stick-slip of the plant under constant commands, with the values of smooth running. From each state the controllers
    take over."""
    loop = search.at(value).loop
    with contextlib.suppress(SceneError, SimulationError):
        for start in under_held_commands(loop):
            yield Request(loop.replace(start=taken_over(loop, start)), 0.0, accuracy=search.base.accuracy).checked().start
