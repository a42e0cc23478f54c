"""Periodic motions of a machine that sticks and slips: the cycle itself, its period, and whether it attracts.

A cycle is a start state x and a period T with x(T; x) = x, solved by Newton's method with the monodromy matrix M = dx(T)/dx, which the saltation matrices
of `toolbox.orbits.variational` make exact. A free cycle fixes its phase by f(x_0) . (x - x_0) = 0; that of a driven machine has the phase and period
of its forcing.
The cycle starts where the fewest elements stick, midway between two events, so that no start lies on a switching surface. Each element that sticks somewhere
makes M singular, which is a Floquet multiplier of exactly zero and no trouble: the equations hold M - I. States that only add up others, such as the angle of
a free shaft, need not return and are left out.

What a sampled law remembers returns with the states, and so does a held signal that a law reads before it holds it anew, or that acts on while the next
one is on its way (a delay shorter than the sample time). Its clock makes the machine a driven
one: the period must be a whole multiple of every sample time, and a free cycle, whose period is what it is, comes round with its clock by chance only.
"""

from __future__ import annotations

import itertools
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import number
from toolbox.errors import SceneError
from toolbox.files.units import NumberOrText
from toolbox.messages import sign_of_life
from toolbox.modelling.clocks import check_regular
from toolbox.modelling.closed_loop import ClosedLoop, as_loop, refuse_former
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.inputs import Shape
from toolbox.orbits.orbit import Cycle, CycleError, Orbit
from toolbox.orbits.sampled_memory import check_laws
from toolbox.simulation.run import Run
from toolbox.simulation.simulate import simulate
from toolbox.simulation.trajectory import Trajectory

CROSSED = 20
"""Halvings of a sample's time in which a run crosses its mid-level: long runs are sampled coarsely."""

LAST_ROUNDS = 25
"""Crossings of mid-level among which the last round is looked for."""

FEW_STEPS = 1500
"""Steps of a run that 6000 instants resolve: a machine may swing within a few."""


@sign_of_life("limit_cycle is at work")
def limit_cycle(
    loop: ClosedLoop | HybridSystem | Trajectory,
    settle: NumberOrText | None = None,
    *,
    period: NumberOrText | None = None,
    accuracy: float = 1e-11,
    **former_names: Any,
) -> Cycle:
    """Find the periodic motion near the end of a run, stable or unstable, to 1e-10 of its size.

    Parameters
    ----------
    loop
        A loop or a plant, which is first simulated for `settle` seconds. Or a run that has settled, such as
        `scene.run(label)`.
    settle
        Length of the first run of a loop [s]. By default None, for a run that has settled already.
    period
        Period of the motion [s], depending on the machine:

        - With periodic inputs: the period of its forcing, or a multiple of it. By default the period of its sines.
        - Without periodic inputs: a guess of the period. By default the time after which the run returns to its state.
          If this guess and start values of the loop are given, `settle` is not needed, and unstable cycles can be
          found, too.
        - With a sampled controller: the period of the alternating reference or load, an integer multiple of the sample
          time.
    accuracy
        Target for the global error of the runs inside the search, by default 1e-11.

    Returns
    -------
    Cycle
        One period of the motion with its Floquet multipliers.

    Raises
    ------
    CycleError
        If no periodic motion is found.
    GrazingError
        If the cycle touches a switching surface (the limit at which a contact changes its mode) without crossing it.
    SceneError
        If an argument is out of its bounds, or does not fit the loop.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, limit_cycle
    >>> cycle = limit_cycle(compose(BlockOnBelt()), settle="60 s")
    >>> print(f"{cycle.period:.4f} s, stable: {cycle.stable}")
    12.0010 s, stable: True
    """
    refuse_former("limit_cycle", loop, former_names)
    settle = None if settle is None else number("settle", settle, "s", above=0)
    period = None if period is None else number("period", period, "s", above=0)
    accuracy = number("accuracy", accuracy, at_least=1e-13, at_most=0.1)
    if isinstance(loop, Trajectory):
        if settle is not None:
            raise SceneError("Argument `settle` must be left out for a trajectory, which has settled.")
        check_laws(loop.run.system)
        check_regular(loop.run.clocks, "for a motion to be periodic")
        run = loop
    else:
        length = period if settle is None else settle
        if length is None:
            raise SceneError(
                "Argument `settle` must be given for a loop: the seconds in which its motion settles, some tens of periods, as in "
                "`limit_cycle(loop, 200.0)`; or a guess of the `period`, with a start of the loop near the cycle."
            )
        check_laws(as_loop(loop).system)
        check_regular(as_loop(loop).assembly.clocks, "for a motion to be periodic")
        run = simulate(as_loop(loop), length, accuracy=1e-8)
    orbit = Orbit.of(run, None, accuracy, period)
    if orbit.forced:
        given = forcing_period(orbit.run) if period is None else period
        if given is None and orbit.clocked and not orbit.variational.forced:
            raise SceneError(
                "The laws of the loop must act continuously for a free cycle: a sampled law comes round with it only where the period is a whole multiple of "
                "the sample time. Give `loop.continuous_loop`, if the law has a continuous form; or such a `period`, where the machine is driven or its "
                "cycle has locked to the clock."
            )
        if given is None:
            why = "that depends on time by itself" if _depends_on_time(orbit.run) else "whose inputs are not sines of one frequency"
            raise SceneError(f"Argument `period` must be given for a driven machine {why}.")
        given = orbit.whole(given)
        rounds = np.floor(run.end / given * (1 + 1e-12)) if settle is not None or run is loop else 0.0
        if orbit.clocked and rounds * given > run.end * (1 - 1e-9):
            rounds -= 1.0  # at its end a run takes no sample
        return orbit.solved(orbit.within(run, max(rounds, 0.0) * given), given)
    guessed = period is not None and settle is None and run is not loop
    try:
        begin, length = (0.0, float(period)) if guessed and period is not None else _round(run, orbit, period)
        anchor = anchored(run, begin, begin + length, orbit)
        return orbit.solved(run.at(anchor).states[0], length)
    except CycleError as error:
        if not guessed and _dies_out(run, orbit):
            raise CycleError(
                "The run comes to rest, so that there is no cycle at its end: its swing dies out without a switch. Where stick-slip lives beside smooth "
                "running, start inside of it, such as with a bit at rest under a turning string, or `follow` a cycle of another parameter value.",
                run,
            ) from error
        raise


def forcing_period(run: Run) -> float | None:
    """The period of the sines among the inputs if they have one frequency and nothing else varies, as the plant by itself may; else None."""
    if _depends_on_time(run):
        return None
    shapes = [value for value in run.inputs.values() if isinstance(value, Shape)]
    if not shapes or any(s.kind != "sine" for s in shapes) or len({s.coefficients[2] for s in shapes}) > 1 or not shapes[0].coefficients[2]:
        return None
    return 1.0 / abs(shapes[0].coefficients[2])


def _depends_on_time(run: Run) -> bool:
    """Whether time enters the equations of the plant, its loads and its contacts, and not by its inputs alone."""
    form = run.system.switched_equations
    return bool(ca.depends_on(ca.vertcat(form.field, form.guards), run.system.t))


def anchored(run: Trajectory, begin: float, end: float, orbit: Orbit) -> float:
    """A time between begin and end midway between two events: where switches are as a run starts them, the fewest elements stick, and for the longest time."""
    times = [begin, *(e.time for e in run.events if begin < e.time < end), end]
    if len(times) == 2:
        return begin
    holding = np.array([element.slides for element in run.program.system.elements])
    initial = np.array([element.initial for element in run.program.system.elements])
    pieces = []
    for a, b in itertools.pairwise(times):
        if b - a > 1e-6 * (end - begin):
            mode = run.at((a + b) / 2).mode[0]
            turned = int(((mode != initial) & ~holding).sum())
            pieces.append((turned, int(((mode == 0) & holding).sum()), -(b - a), (a + b) / 2))
    return min(pieces)[3]


def _dies_out(run: Trajectory, orbit: Orbit) -> bool:
    """Whether the last two thirds of a run shrink to nothing, without a switch: what is left of the swing, extrapolated from its three thirds, is less than
    half of the last (Aitken; exactly 0 for a geometric decay, and 0.8 of it where 1/sqrt(t) is on its way to a cycle born at a Hopf point); or has shrunk below
    what the run resolves."""
    begin = run.begin + (run.end - run.begin) / 3
    if any(event.time > begin for event in run.events):
        return False
    states = run.at(np.linspace(begin, run.end, 6000)).states[:, orbit.returning] / orbit.scale[orbit.returning]
    a, b, c = (float(np.ptp(part, axis=0).max(initial=0.0)) for part in np.split(states, 3))
    return c < 1e-8 or (a > b > c and c - b > b - a and c - (c - b) ** 2 / ((c - b) - (b - a)) < c / 2)


def _round(run: Trajectory, orbit: Orbit, guess: float | None) -> tuple[float, float]:
    """Begin and length of the last round that a settled run makes: between crossings of mid-level by the state that swings most."""
    # instants farther apart than the steps of the run may miss rounds, so that some of them pass for one: as long as the end alone has rounds enough, it tells
    whole = (run.end - run.begin) * 2 / 3
    length = whole if guess is not None else min(whole, FEW_STEPS * (run.end - run.begin) / max(run.steps[0], 1))
    while True:
        times = np.linspace(run.end - length, run.end, 6000)
        states = run.at(times).states[:, orbit.returning]
        swing = np.ptp(states, axis=0)
        size = np.abs(states).max(axis=0) + 1e-300
        best = int(np.argmax(np.where(size > 1e-9 * size.max(), swing / size, 0.0)))
        level = (states[:, best].max() + states[:, best].min()) / 2
        y = states[:, best] - level
        up = np.flatnonzero((y[:-1] <= 0) & (y[1:] > 0))[-LAST_ROUNDS:]
        if length >= whole or up.size >= LAST_ROUNDS:
            break
        length = min(4.0 * length, whole)
    if not (swing > 1e-6 * size).any():
        raise CycleError("The run comes to rest, so that there is no cycle at its end.", run)
    if up.size < 2:
        raise CycleError(
            "The run must come round at least twice in its last two thirds for a cycle to be seen: it comes to rest, or must settle longer.",
            run,
        )
    low, high = times[up], times[up + 1]
    for _ in range(CROSSED):
        middle = (low + high) / 2
        below = run.at(middle).states[:, orbit.returning][:, best] <= level
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    points = run.at(high).states[:, orbit.returning] / np.where(swing > 0, swing, 1.0)
    crossings = high
    away = [np.inf, *(float(np.abs(points[-1] - points[-1 - k]).max()) for k in range(1, up.size))]
    if guess is not None:
        k = 1 + int(np.argmin([abs(crossings[-1] - crossings[-1 - k] - guess) for k in range(1, len(away))]))
    else:
        k = next(k for k in range(1, len(away)) if away[k] <= 3 * min(away) + 1e-4)
    return float(crossings[-1 - k]), float(crossings[-1] - crossings[-1 - k])
