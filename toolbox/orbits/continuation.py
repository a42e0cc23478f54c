"""Cycles followed through a parameter, stable and unstable alike, with the points at which their kind changes.

Pseudo-arclength continuation of the equations of `toolbox.orbits.limit_cycle`: unknowns are the start state, the period of a free cycle and the
parameter; the next point
is predicted along the tangent and corrected in the plane across it, so that folds are passed like any other point. Along it are located, the first three by
Brent's method to 1e-9:

    fold               the tangent has no part along the parameter (a multiplier passes 1)
    period doubling    det(M + I) = 0 (a multiplier passes -1)
    Neimark-Sacker     a pair of complex multipliers passes the unit circle, prod (mu_i mu_j - 1) = 0
    ...-sliding        the sticks of a period change: grazing-, crossing-, adding- or switching-sliding, see `toolbox.orbits.sliding`
    grazing            other switches of a period change: a contact is touched
    Hopf               the cycle shrinks to a steady state, where the branch ends

Where switches change, the point is bisected if the branch goes on; at a corner, and where the branch just ends, it is extrapolated from the rates
at which the last two cycles meet the event; either way to about 1e-7 of the span. A Hopf point is solved by Newton's method from there, on the steady
state and its pair of poles.
At a grazing point the monodromy matrix jumps and the branch may turn on the spot (a nonsmooth fold), where no tangent points along it; there the branch is
taken up on the other side along the tangent of the cycles with other switches, which runs started nearby show.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from toolbox.arguments import number, whole
from toolbox.errors import SceneError, SimulationError
from toolbox.files.unit_systems import asked_in
from toolbox.files.units import NumberOrText
from toolbox.messages import sign_of_life
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.orbits.arclength import ArcWalk
from toolbox.orbits.branch import Bifurcation, Branch
from toolbox.orbits.orbit import Cycle, signature_of
from toolbox.orbits.sensitivity import placed
from toolbox.steady_states.hopf import hopf_points
from toolbox.vocabulary import new_names_only


@new_names_only
@sign_of_life("follow is at work")
def follow(
    cycle: Cycle,
    parameter: str,
    bounds: tuple[NumberOrText, NumberOrText],
    *,
    points: int = 100,
    step: float = 0.02,
    start_towards: NumberOrText | None = None,
    stop_at_bifurcation: bool = False,
) -> Branch:
    """Follow a branch of limit cycles while a parameter changes, by pseudo-arclength continuation.

    Use this function to find the range of the parameter in which stick-slip exists. Folds, period doublings and
    grazings of the branch are located.

    If the parameter is the frequency of an input that is a sine, such as "block.force.frequency", the period of the
    cycle changes with the frequency. A frequency that is a parameter of a part does not have this effect: the search
    then keeps the period constant.

    The branch ends when the parameter reaches one of its `bounds`, after `points` cycles, at a Hopf point, or if no
    further cycle is found. `stop_reason` of the result gives the reason.

    Parameters
    ----------
    cycle
        A cycle at which the branch begins, as `limit_cycle` returns it.
    parameter
        Name of a parameter of the plant or of a controller, such as "block.belt_speed", or of a constant input. For an
        input that is a sine, amplitude, frequency and so on have names such as "block.force.amplitude".
    bounds
        Range (low, high) of the parameter, in SI or text with units.
    points
        Largest number of cycles, by default 100.
    step
        Largest step of the arclength, as a fraction of the range and of the size of the states, by default 0.02.
    start_towards
        The end of the range (low or high) towards which the branch is followed first. By default the end that is
        farther away.
    stop_at_bifurcation
        Whether the branch ends at the first bifurcation, by default False.

    Returns
    -------
    Branch
        The cycles, their stability, and the bifurcations between them.

    Raises
    ------
    SceneError
        If `parameter` is not such a name, the range is empty, or an argument is out of its bounds.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, follow, limit_cycle
    >>> cycle = limit_cycle(compose(BlockOnBelt()), settle="60 s")
    >>> branch = follow(cycle, "block.belt_speed", (0.1, 0.4), points=20)
    >>> print(len(branch.cycles) > 2, branch.stop_reason)
    True all 20 points asked for
    """
    if not isinstance(cycle, Cycle):
        raise SceneError(f"Argument `cycle` must be a cycle found by `limit_cycle`, but it is {cycle!r}.")
    free = cycle.run.run.loop.differentiable_number(parameter, "follow", lambda number: number.is_shape)
    asked = {free.unit: asked_in(free.in_si("bounds", bounds), free.unit)}
    bounds = free.span(bounds, "bounds")
    step = number("step", step, above=0)
    walk = ArcWalk(dataclasses.replace(cycle, run=placed(cycle.run, [free])), free, bounds)
    if abs(min(max(walk.here.value, bounds[0]), bounds[1]) - walk.here.value) > 1e-14 * abs(walk.here.value):
        raise SceneError(f"Argument `bounds` must hold the value {walk.here.value:g} of `{parameter}`, but it is {bounds!r}.")
    whole("points", points, 1)
    goal = (
        number("start_towards", start_towards, free.unit)
        if start_towards is not None
        else max(bounds, key=lambda end: abs(end - walk.here.value))
    )
    walk.head_for(1.0 if goal > walk.here.value else -1.0)
    ended = f"all {points} points asked for"
    branch = Branch(parameter, free.unit, [walk.here.value], [walk.cycle(walk.here)], [], ended, asked)
    size, turned = step / 4, 0
    left: Any = None  # the switches of the cycles from which the last corner led away
    while len(branch.values) < points:
        point = walk.step(size)
        if point is not None and left is not None and signature_of(point.run) == left:
            point = None  # back across the corner
        if point is None:
            size /= 2
            if size > 1e-5 * step:
                continue
            if _shrunk(branch, _at_rest(branch, walk.kept)):
                break
            here = branch.cycles[-1].signature
            if stop_at_bifurcation:
                next(walk.look_beyond(left), None)
            point = walk.around(left) if turned < 2 and not stop_at_bifurcation else None
            touched = walk.touched()
            if point is None and touched is None:
                branch.stop_reason = "no further cycle is found"
                break
            branch.bifurcations.append(Bifurcation(walk.corner(), branch.values[-1] if touched is None else touched, branch.cycles[-1]))
            if point is None:
                branch.stop_reason = "the switches of the cycle touch zero, and none is found beyond"
                break
            turned, left = turned + 1, here
            size = min(step / 16, 10 * float(np.linalg.norm(point.u - walk.here.u)))
        else:
            turned, left = 0, None
            if _shrunk(branch, walk.vanishing(point, size)):
                break
            branch.bifurcations += walk.changes(walk.here, point, size)
        if not bounds[0] <= point.value <= bounds[1] or (stop_at_bifurcation and branch.bifurcations):
            branch.stop_reason = _reached(bounds, point.value)
            break
        walk.move_to(point)
        branch.values.append(point.value)
        branch.cycles.append(walk.cycle(point))
        size = min(step, size * (1.5 if point.iterations <= 4 else 0.7 if point.iterations > 6 else 1.0))
    return branch


def _reached(bounds: tuple[float, float], value: float) -> str:
    """Why a branch ends at a value: the end of the span, else its first bifurcation."""
    if bounds[0] <= value <= bounds[1]:
        return "the first bifurcation"
    return f"the end of the span at {bounds[0] if value < bounds[0] else bounds[1]:g}"


def _shrunk(branch: Branch, rest: float | None) -> bool:
    """Whether the branch ends in the steady state that was found near `rest`: it then says so."""
    if rest is None:
        return False
    branch.bifurcations.append(Bifurcation("Hopf", _solved(branch, rest), branch.cycles[-1]))
    branch.stop_reason = "the cycle shrinks to a steady state"
    return True


def _at_rest(branch: Branch, kept: np.ndarray) -> float | None:
    """The parameter to which the square of the swing, linear in it near a Hopf point, vanishes from the last two cycles; None where they are not small."""
    if len(branch.values) < 2 or branch.cycles[-1].forced:
        return None
    swing = np.array([np.ptp(cycle.run.states[:, kept], axis=0) for cycle in branch.cycles])
    size = (swing / (swing.max(axis=0) + 1e-300)).max(axis=1) ** 2
    if size[-1] > 0.05**2 or size[-1] >= size[-2]:
        return None
    a, b = branch.values[-2:]
    return float(b + (b - a) * size[-1] / (size[-2] - size[-1]))


def _solved(branch: Branch, near: float) -> float:
    """The parameter of the Hopf point next to the one to which a branch was extrapolated; that one where the steady state has none so near."""
    cycle = branch.cycles[-1]
    run = cycle.run.run
    away = 2.0 * abs(near - branch.values[-1]) + 1e-6 * abs(near)
    middle = {name: np.mean(cycle.run[name], axis=0) for name in run.system.states}
    try:
        found = hopf_points(
            ClosedLoop(run.system, inputs=run.inputs), branch.parameter, (near - away, near + away), guess=middle, num_values=5
        )
    except (SceneError, SimulationError):
        return near
    return min((point.value for point in found), key=lambda value: abs(value - near), default=near)
