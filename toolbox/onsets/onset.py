"""Onset of stick-slip: where smooth running is lost, where stick-slip that has begun ends, where standstill does, and how far a working point is from each.

Two borders belong to every machine that sticks and slips, because it remembers. From smooth running, a small disturbance grows only beyond the Hopf
point. From inside stick-slip, the cycle lives on until it can no longer reach zero slip, and that is often far away: on a two-inertia drill
string under a stiff drive at three times the speed. Between the two, the machine runs smoothly until something disturbs it, and then sticks and slips for
ever. A margin to the Hopf point alone therefore understates the danger, and `onset` never reports one border without the other.

A third regime is none of the two: a machine that stands for good. Under a torque that does not yield it lasts up to the break-away torque, which has
nothing to do with where stick-slip ends; towards low torques stick-slip itself may turn into it. Every border has its own name: smooth running is lost,
stick-slip ends (the machine turns on) or stalls (it stands), standstill breaks away.

Smooth running is lost where its growth changes its sign (`toolbox.onsets.growth`); how runs find the other borders is told in `search` and `inside`, and how
cycles that are followed make them exact in `cycles`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import number, whole
from toolbox.errors import NoSteadyState, SceneError
from toolbox.files.journal import Journal, fingerprint
from toolbox.files.unit_systems import asked_in
from toolbox.files.units import NumberOrText
from toolbox.measuring.judge import BUDGET, NOT_DECIDED, STANDS, STICKS
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.laws import Controller, Sampled
from toolbox.modelling.numbers import Number
from toolbox.modelling.two_directions import check_one_direction
from toolbox.onsets.carried import is_run
from toolbox.onsets.coexisting import coexisting
from toolbox.onsets.cycles import exact
from toolbox.onsets.growth import SmoothBranch, check_autonomous
from toolbox.onsets.inside import Inside, outward
from toolbox.onsets.reach import reached_from
from toolbox.onsets.results import Onset
from toolbox.onsets.search import OnsetSearch
from toolbox.scenes.judged import judged_contact, judged_speed
from toolbox.scenes.situation import Situation
from toolbox.simulation.request import Request, accuracy_of
from toolbox.steady_states.equilibria import EquilibriumBranch, state_values
from toolbox.steady_states.hopf import HopfPoint, hopf_points_of, sampled_hopf_points
from toolbox.steady_states.sampled_hopf import SampledBranch
from toolbox.sweeps.variants import fingerprints

SURE = 9
"""Number of values below which a report says that a cycle may live between them: with four, one of twelve wells drawn at random had one."""


@takes_loop
def onset(
    loop: ClosedLoop,
    parameter: str,
    bounds: tuple[NumberOrText, NumberOrText],
    *,
    mode: Mapping[str, str] | None = None,
    guess: Mapping[str, Any] | None = None,
    num_values: int = 13,
    tolerance: NumberOrText | None = None,
    duration: NumberOrText | None = None,
    perturbation: float = 1e-3,
    accuracy: float | None = None,
    initial_controller: Controller | Sampled | None = None,
    checkpoint: str | Path | None = None,
) -> Onset:
    """Find the values of one parameter or input at which smooth running, stick-slip and standstill begin and end.

    Use it to find, for example, the lowest set-point or the highest weight on bit at which a machine runs smoothly, and
    the margin of the operating point to this border. The result also contains the Hopf points of smooth running. This
    works for every kind of controller.

    Definitions:

    - Smooth running is lost at the value at which small disturbances of the running loop begin to grow.
    - Stick-slip is a motion in which the same stick phase is repeated periodically, with any period.
    - Standstill is a stick phase that never ends (`toolbox.measuring.judge`).

    Method: the limit cycle of stick-slip is followed to the value at which it is no longer stable. For a loop with a
    sampled controller, or if no cycle is found, the borders come from runs that begin in stick-slip and follow the
    parameter in small steps. Stick-slip is also searched outside both ends of the range. So the result depends neither
    on the range nor on one start.

    If a parameter of the plant varies, a controller keeps the design that it has on the declared plant.

    Parameters
    ----------
    loop
        A loop with constant inputs, or a plant. The present value of the parameter in the loop is the operating point.
    parameter
        Name of an input, or of a parameter of the plant or of a controller.
    bounds
        Range (low, high) of the parameter, in SI or text with units. With ("20 rpm", "120 rpm") report and figure are
        in rpm.
    mode
        {contact or relay: mode} of the steady state, such as {"bit": "slip+"}. By default contacts slide in the
        direction in which they slide at the start.
    guess
        {state: value} near the steady state at the operating point, as a start of the search. By default None: the
        search starts without a guess. Needed if this search fails, for example under a drive with limits.
    num_values
        Number of values of the parameter at which smooth running and stick-slip are simulated, by default 13.
    tolerance
        Tolerance of borders that are found by runs, in the SI unit of the parameter. By default 1/5000 of the range.
    duration
        Longest time for which a run is continued until its regime (smooth running, stick-slip or standstill) is decided
        [s]. By default 2000 periods of the least damped motion.
    perturbation
        Disturbance of smooth running at the start of a run, as a fraction of the steady slip speed, by default 0.001.
    accuracy
        Target for the global error of the runs. By default the accuracy of the scene, else 1e-6.
    initial_controller
        A controller with which the machine sticks and slips, such as `StiffPI()`. If stick-slip exists beside smooth
        running at the operating point, the controller of the loop then takes over this stick-slip at 8 phases. The
        result says how many of these 8 runs end in stick-slip. By default None: no takeover is simulated.
    checkpoint
        File for the outcome of each run (JSON lines). A search that was interrupted continues from this file. By
        default nothing is kept.

    Returns
    -------
    Onset
        The borders, with Hopf points and the margins of the operating point. `print` and `plot` show them. `loss` is
        the value at which smooth running is lost, `end` the value at which stick-slip ends in rotation, `stall` the
        value at which stick-slip ends in standstill, and `breakaway` the value at which standstill ends.

    Raises
    ------
    SceneError
        If a name is unknown, the range is empty, an input or a controller varies in time, or there is no smooth running
        in the range, or if `checkpoint` holds another search.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, onset
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> found = onset(loop, "top.reference", ("20 rpm", "120 rpm"), num_values=5)
    >>> print(f"smooth running is lost at {found.loss:.2f} rad/s, stick-slip ends at {found.end:.1f} rad/s")
    smooth running is lost at 3.67 rad/s, stick-slip ends at 8.3 rad/s
    """
    inputs, continuous = loop.constant_inputs("an onset to exist"), _continuous_form(loop)
    check_autonomous(loop, "an onset to exist")
    check_one_direction(loop.system.elements, "`onset`", "judge runs of it, by `sweep`")
    free = loop.differentiable_number(parameter, "onset", lambda number: number.kind.borders)
    if continuous is not None and free.kind.has_slope:
        free = continuous.differentiable_number(parameter, "onset")
    low, high = free.span(bounds)
    asked_unit = asked_in(tuple(free.in_si("bounds", tuple(bounds))), free.unit)
    whole("num_values", num_values, 3)
    tolerance = (high - low) / 5000 if tolerance is None else number("tolerance", tolerance, free.unit, above=0)
    longest = None if duration is None else number("duration", duration, "s", above=0)
    perturbation, at = number("perturbation", perturbation, above=0), free.value
    contact = judged_contact(loop)
    speed = judged_speed(loop, contact)
    grid = np.linspace(low, high, num_values)
    if low < at < high and not np.isclose(grid, at, rtol=0, atol=1e-9 * (high - low)).any():
        grid = np.sort(np.append(grid, at))
    base = Request(loop.at(parameter, low) if free.is_input else loop, 0.0, accuracy=accuracy_of(loop, accuracy)).checked()
    followed = EquilibriumBranch(continuous.system, free, inputs, mode, guess) if continuous is not None else None
    branch = SmoothBranch(base, lambda value: [(free, value)], followed)
    if followed is not None and low <= at <= high:
        followed(at)  # first, because a guess is near this one
    notes: list[str] = []
    hopf = _sampled_hopf_points(loop, free, branch, grid) if loop.is_sampled else _hopf_points(continuous, followed, grid, notes)
    steady = [value for value in map(float, grid) if branch(value) is not None]
    if not steady:
        reason = f": {followed.reason}" if followed is not None else ", at the set-points of the laws or elsewhere."
        raise NoSteadyState(f"There is no steady running for `{parameter}` from {low:g} to {high:g} {free.unit}{reason}")
    period = max(point.period for point in hopf) if hopf else float(np.nanmedian([branch.swing(value) for value in steady]))
    search = OnsetSearch(
        base=base, branch=branch, element=contact, signal=speed, perturbation=perturbation, period=period,
        budget=BUDGET if longest is None else longest / period, notes=notes, free=free, followed=followed,
    )  # fmt: skip
    if checkpoint is not None:
        asked = {
            "bounds": [low, high], "values": grid.tolist(), "at": at, "tolerance": tolerance, "duration": search.budget, "mode": mode, "guess": guess,
            "perturbation": perturbation, "initial controller": fingerprint(initial_controller),
        }  # fmt: skip
        search.journal = Journal(checkpoint, fingerprints(base, [parameter], **asked), is_run)
    with progress_bar(None, "onset") as search.bar:
        found = _both_branches(search, loop, [float(value) for value in grid], at, hopf, tolerance, initial_controller)
    return replace(found, display_units={**loop.display_units, free.unit: asked_unit})


def _continuous_form(loop: ClosedLoop) -> ClosedLoop | None:
    """The loop with its laws in their continuous form; None for a sampled loop with a law that has none."""
    try:
        found = loop.continuous_loop
        return found if found.system else None
    except SceneError:
        if not loop.is_sampled:
            raise
        return None


def _hopf_points(continuous: ClosedLoop | None, followed: EquilibriumBranch | None, grid: np.ndarray, notes: list[str]) -> list[HopfPoint]:
    """The Hopf points of the continuous form in the range of the grid; none where there is no such form."""
    if continuous is None or followed is None:
        return []
    steady = [point for point in map(followed, map(float, grid)) if point is not None]
    if not steady:
        return []
    near = state_values(continuous.system, steady[-1].states)
    try:
        return hopf_points_of(continuous.system, followed.free, (float(grid[0]), float(grid[-1])), followed.inputs, followed.mode, near)
    except SceneError as error:
        notes.append(f"no Hopf point: {error}")
        return []


def _sampled_hopf_points(loop: ClosedLoop, free: Number, branch: SmoothBranch[float], grid: np.ndarray) -> list[HopfPoint]:
    """The Hopf points of a sampled loop in the range of the grid, from its exact matrix; none where a controller has no slope."""
    if branch.exact is None or not free.kind.poles:
        return []
    try:
        return sampled_hopf_points(SampledBranch(loop, free), (float(grid[0]), float(grid[-1])))
    except SceneError:
        return []


def _between(numbers: Sequence[float], hopf: Sequence[HopfPoint]) -> list[float]:
    """A value between each two Hopf points, or a Hopf point and an edge, that have no value of the grid between them."""
    cuts = sorted({numbers[0], numbers[-1], *(point.value for point in hopf)})
    return [(a + b) / 2 for a, b in itertools.pairwise(cuts) if hopf and not any(a <= value <= b for value in numbers)]


def _of_sampling(search: OnsetSearch, loop: ClosedLoop, hopf: Sequence[HopfPoint]) -> Iterator[str]:
    """What a report says of a loop that is sampled or measures with noise."""
    if loop.is_sampled:
        what = "Hopf points and borders" if hopf else "The borders"
        yield f"{what} are of the controller as it runs, sampled."
    if search.branch.run is not search.base:
        yield "Smooth running is judged without measurement noise and steps of encoders, stick-slip with them."


def _both_branches(
    search: OnsetSearch, loop: ClosedLoop, numbers: list[float], at: float, hopf: Sequence[HopfPoint], tolerance: float, initial: Any = None
) -> Onset:
    """Runs from smooth running and from inside stick-slip at all values, and the borders between what they come to."""
    width = numbers[-1] - numbers[0]
    smooth = [search.smooth(value) for value in numbers]
    losses = search.losses(sorted({*numbers, *_between(numbers, hopf)}), tolerance)
    undecided = [value for value, judged in zip(numbers, smooth, strict=True) if judged.regime == NOT_DECIDED]
    inside = Inside.of(search)
    for edge, sign in ((numbers[0], -1.0), (numbers[-1], 1.0)):
        inside.outside(edge, outward(edge, sign, width))
    inside.sweep(numbers)
    several = coexisting(inside, numbers, at)
    lasting = sorted({*numbers, *(edge for each in several for edge in (each.low, each.high))})  # one may outlive what is carried along
    cycles = [exact(border, inside, width) for border in inside.ends(lasting, tolerance)]
    sticking = [inside.found[value] for value in numbers]
    undecided += [value for value, judged in inside.found.items() if judged.regime == NOT_DECIDED]
    breakaways = inside.breakaways(numbers, tolerance)
    beside = at in inside.found and inside.found[at].regime == STICKS and search.branch(at) is not None and search.branch.rate(at) < 0.0
    reached = reached_from(inside, at, initial) if beside else ()
    search.notes.extend(_of_sampling(search, loop, hopf))
    if len(numbers) < SURE and any(judged.regime == STICKS for judged in sticking):
        search.notes.append(
            f"Stick-slip was begun at {len(numbers)} values only: of several cycles the one that lives longest may be missed."
        )
    others = {
        value: judged
        for value, judged in inside.found.items()
        if judged.regime == STICKS and value not in numbers and numbers[0] < value < numbers[-1]
    }
    return Onset(
        title=loop.title,
        parameter=search.free.name,
        unit=search.free.unit,
        element=search.element,
        signal=search.signal,
        values=np.array(numbers),
        smooth=tuple(smooth),
        sticking=tuple(sticking),
        hopf=tuple(hopf),
        losses=tuple(losses),
        ends=tuple(border for border in cycles if border.beyond != STANDS),
        stalls=tuple(border for border in cycles if border.beyond == STANDS),
        breakaways=tuple(breakaways),
        coexisting=several,
        reached=reached,
        situation=str(
            Situation.of(
                loop,
                "smooth running with a small disturbance, and from stick-slip of the loop itself, led along the parameter",
                "until the regime is decided",
            )
        ),
        cycle_runs=tuple(sorted(others.items())),
        steady=np.array([search.steady(value)[0] for value in numbers]),
        signal_unit=loop.system.signal_unit(search.signal),
        cycling=np.array([value in inside.cycling for value in numbers]),
        standing=np.array([value in inside.standing for value in numbers]),
        at=at,
        period=search.period,
        duration=search.budget * search.period,
        accuracy=search.base.accuracy,
        perturbation=search.perturbation,
        runs=search.runs,
        undecided=tuple(undecided),
        notes=tuple(search.notes),
    )
