"""The border of stick-slip where its cycle can be followed: the point at which it stops being stable, to about a millionth.

A run near the border of stick-slip takes as long to leave it as one likes, so that a border by runs alone depends on their length. The cycle does not: its
multipliers say where it stops attracting, in a fold, by doubling its period, by starting to beat, or where its sticks touch zero. Two questions remain that
multipliers do not answer, and runs do: whether stick-slip of another form goes on beyond that point, and whether the cycle that was followed is the one
that lasts longest.
"""

from __future__ import annotations

import dataclasses
import itertools

from toolbox.errors import SceneError, SimulationError
from toolbox.measuring.judge import STICKS
from toolbox.onsets.inside import Inside
from toolbox.onsets.results import Border
from toolbox.onsets.search import OnsetSearch
from toolbox.orbits.branch import Branch
from toolbox.orbits.continuation import follow
from toolbox.orbits.limit_cycle import limit_cycle
from toolbox.orbits.orbit import Cycle
from toolbox.simulation.run_state import RunState

SETTLED = 60
"""Periods for which a run settles before its cycle is looked for."""

SAME_PERIOD = 1e-3
"""What the periods of a cycle and of a branch may differ by, for the cycle to be on the branch."""

GOES_ON = ("period doubling", "Neimark-Sacker")
"""Bifurcations beyond which the cycle that is born may go on for a little: the border keeps the tolerance of its runs."""

NEAR = 0.01
"""How far from the border by runs, in parts of it, the end of the followed cycle may lie to be looked at."""


def exact(border: Border, inside: Inside, width: float) -> Border:
    """Return a border of stick-slip at the value that ends the stability of the followed cycle. If no cycle can be followed so far, the
    border is returned unchanged.

    A sampled law has none: its clock and its swing go by one another.

    `width` is that of the range: the scale of the steps in which the cycle is followed.
    """
    if inside.search.base.system.updates:
        return border
    sign = 1.0 if border.safe == "above" else -1.0
    reach = NEAR * abs(border.value)
    found, near = border, border.value - sign * max(3.0 * border.tolerance, 0.05 * reach)

    def origins() -> list[float]:
        """Values with stick-slip on the inner side of the border, the nearest first."""
        within = [value for value in inside.cycling if sign * (border.value - value) >= 0]
        return sorted(within, key=lambda value: abs(value - border.value))

    any(inside.led(origin, near) for origin in origins()[:2])  # the nearest may be on its way out
    apart = (0.0, abs(near - border.value), 0.2 * reach)
    tried = [next((value for value in origins() if abs(value - border.value) >= each), None) for each in reversed(apart)]
    branches: list[Branch] = []
    for origin in dict.fromkeys(value for value in tried if value is not None):
        cycle = settled(inside.search, inside.cycling[origin], origin)
        if cycle is None or not cycle.stable or any(_is_on(branch, origin, cycle) for branch in branches):
            continue
        branch = followed(inside.search, cycle, origin, border.value + sign * 2 * reach, width)
        branches.append(branch)
        lost = next((point for point in branch.bifurcations if point.kind != "Hopf"), None)
        if lost is None or abs(lost.value - border.value) > reach:
            continue
        value = float(lost.value)
        further = not found.followed or sign * (value - found.value) > 0
        if further and _lasts_only_to(value, border, branch, inside, sign):
            tolerance = border.tolerance if lost.kind in GOES_ON else 1e-6 * abs(value)
            found = dataclasses.replace(border, value=value, tolerance=tolerance, confirmed=True, followed=lost.kind)
    return found


def settled(search: OnsetSearch, begin: RunState, origin: float) -> Cycle | None:
    """Return the stick-slip cycle that a run at a value settles in. None if no cycle is found."""
    duration, accuracy = SETTLED * search.period, min(search.base.accuracy, 1e-9)  # at which a cycle can be told
    try:
        run = search.at(origin).again(start=begin, accuracy=accuracy, duration=duration, longest_step=duration / 256)
        return limit_cycle(run)
    except (SceneError, SimulationError):
        return None


def followed(search: OnsetSearch, cycle: Cycle, origin: float, goal: float, width: float) -> Branch:
    """The branch of a cycle at `origin` towards `goal`, up to its first bifurcation."""
    low, high = min(origin, goal), max(origin, goal)
    step = min(0.1, 0.02 * width / (high - low))
    return follow(cycle, search.free.name, (low, high), points=80, start_towards=goal, step=step, stop_at_bifurcation=True)


def _is_on(branch: Branch, value: float, cycle: Cycle) -> bool:
    """Whether a cycle at a value is one of a branch: what passes that value with its period."""
    pairs = itertools.pairwise(zip(branch.values, branch.cycles, strict=True))
    for (a, before), (b, after) in pairs:
        if min(a, b) <= value <= max(a, b):
            period = before.period + (after.period - before.period) * (value - a) / (b - a)
            return abs(period / cycle.period - 1.0) < SAME_PERIOD
    return False


def _lasts_only_to(value: float, border: Border, branch: Branch, inside: Inside, sign: float) -> bool:
    """Whether runs agree that stick-slip ends where the cycle that was followed stops being stable, and not where other runs have seen it end."""
    if abs(value - border.value) <= border.tolerance:
        return True
    middle, search = (value + border.value) / 2, inside.search
    if sign * (border.value - value) < 0:  # the cycle goes on where runs were shaken off
        near = min(range(len(branch.values)), key=lambda k: abs(branch.values[k] - middle))
        start = branch.cycles[near].run.run.start
        return search.run(branch.values[near], start)[0].regime == STICKS
    origin = max((v for v in inside.cycling if sign * (value - v) >= 0), key=lambda v: sign * v)
    return search.run(middle, search.walked(inside.cycling[origin], origin, middle))[0].regime != STICKS
