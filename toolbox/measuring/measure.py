"""Numbers read off a run: stick intervals, cycles, severity, settling, overshoot, and the audit of its energy.

Why not from the recorded nodes: a step of order eight is long, a quarter of a second on a drill string, so the largest node value misses the peak
and the mean of the nodes weighs fast phases too much; on JANSEN_2 in stick-slip the severity is then wrong by 4 %. Here every step is read as
`toolbox.measuring.measures`
reads it, with the derivatives of the signal; means are integrals of these quintics, the step of an extremum or a crossing is found on them, and its
value is that of `run.at`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from toolbox.arguments import is_finite_number
from toolbox.errors import SceneError, suggest
from toolbox.measuring.severity import SEVERITIES, Extent, severity_of
from toolbox.modelling.elements import UnilateralContact
from toolbox.simulation.samples import Samples, check_run, output_function, scalar, window
from toolbox.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from toolbox.measuring.quintics import Steps

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(8)
POINTS, WEIGHTS = 0.5 * (POINTS + 1.0), 0.5 * WEIGHTS
CHUNK = 4096
"""Steps sampled together, so that the audit of a very long run needs no more memory than that of a short one."""


# ------------------------------------------------------------------------------------------------------------------------- intervals of stick
def stick_intervals(run: Trajectory, element: str, after: float = 0.0, until: float | None = None) -> list[tuple[float, float]]:
    """(begin, end) [s] of every stay in stick, cut to the window from `after` to `until` [s] (the end of the run).

    Begin and end are located events, not nodes. Raises SceneError for an unknown element or a window outside the run.
    """
    begin, end = window(run, after, until)
    found: list[tuple[float, float]] = []
    for first, last, mode in run.intervals(element):
        first, last = max(first, begin), min(last, end)
        if mode != "stick" or first >= last:
            continue
        if found and found[-1][1] == first:  # a release that is taken back at the same instant does not part two stays
            found[-1] = (found[-1][0], last)
        else:
            found.append((first, last))
    return found


def stuck_ratio(run: Trajectory, element: str, after: float = 0.0, until: float | None = None) -> float:
    """Part of the window that an element spends in stick, 0 to 1. Raises SceneError as `stick_intervals` does."""
    begin, end = window(run, after, until)
    return sum(last - first for first, last in stick_intervals(run, element, begin, end)) / (end - begin)


@dataclass(frozen=True)
class StickSlipPeriod:
    """One cycle of stick-slip [s]: it slips from the release at `start` for `slip`, then sticks for `stick`, until the next release."""

    start: float
    slip: float
    stick: float

    @property
    def period(self) -> float:
        """From release to release [s]."""
        return self.slip + self.stick


def cycles(run: Trajectory, element: str, after: float = 0.0, until: float | None = None) -> list[StickSlipPeriod]:
    """Every whole cycle of stick-slip of an element between `after` and `until` [s] (the end of the run), from release to release.

    A final stick that nothing ends belongs to no cycle; slip in both directions counts as slip. Raises SceneError as `stick_intervals` does.
    """
    begin, end = window(run, after, until)
    stays = stick_intervals(run, element, begin, end)
    return [
        StickSlipPeriod(start=release, slip=caught - release, stick=leaves - caught)
        for (_, release), (caught, leaves) in itertools.pairwise(stays)
        if leaves < end
    ]




def extent(run: Trajectory, signal: str, after: float = 0.0, until: float | None = None) -> Extent:
    """Extrema and time mean of a scalar signal between `after` and `until` [s] (the end of the run), as accurate as the run.

    The mean is the Gauss-Legendre integral over every step divided by the length of the window; at a jump both sides count as values.
    Raises SceneError for an unknown or vector signal and for a window outside the run.
    """
    begin, end = window(run, after, until)
    steps = _steps(run, signal, begin, end)
    last = _value(run, signal, end)  # the far side of a jump there
    ends: list[tuple[float, float]] = []
    for values, times, sign in ((steps.lowest, steps.when_lowest, -1.0), (steps.highest, steps.when_highest, 1.0)):
        i = int(np.argmax(sign * values))
        found = (_value_in(run, signal, steps, i, float(times[i])), float(times[i]))
        ends.append(max(found, (last, end), key=lambda pair: sign * pair[0]))
    (low, when_low), (high, when_high) = ends
    mean = math.fsum(steps.integral) / (end - begin)
    return Extent(low, high, min(max(mean, low), high), when_low, when_high)


def mean_square(run: Trajectory, signal: str, target: float = 0.0, *, after: float = 0.0, until: float | None = None) -> float:
    """Time mean of (signal - target)^2 between `after` and `until` [s] (the end of the run), in the unit of the signal squared.

    The Gauss-Legendre integral over every step; its derivatives are those of `Sensitivity.mean_square`. Raises SceneError as `extent` does.
    """
    begin, end = window(run, after, until)
    if not is_finite_number(target):
        raise SceneError(f"Argument `target` must be a finite number, but it is {target!r}.")
    return sum(float(weights @ (scalar(samples, signal) - target) ** 2) for weights, samples in gauss(run, begin, end)) / (end - begin)


def severity(
    run: Trajectory,
    signal: str = "bit.speed",
    after: float = 0.0,
    definition: str = "half-range",
    *,
    until: float | None = None,
    reference: float | None = None,
) -> float:
    """Severity of stick-slip [1]: how far a speed swings, in parts of its mean or of a set-point.

        "half-range"   (max - min) / (2 mean)          1 where the bit just stops; the usual field index, and the default
        "range"        (max - min) / mean
        "peak"         max / mean - 1                   overspeed alone
        "reference"    (max - min) / (2 reference)      against the set-point `reference`, in the unit of the signal

    For time instead of speed see `stuck_ratio`. Extrema and time mean are those of `extent` over `after` to `until` [s]: choose
    `after` beyond the transient and a window of many periods. The sign of the divisor is ignored; a swing about zero is infinitely severe,
    a signal that stays exactly 0 has no severity: nan. Raises SceneError for an unknown definition or signal, and for a missing
    or needless reference.
    """
    if not isinstance(definition, str) or definition not in SEVERITIES:
        raise SceneError(f"There is no definition of severity `{definition}`: {suggest(definition, SEVERITIES)}")
    if definition == "reference":
        if not is_finite_number(reference) or reference == 0:
            raise SceneError(f"Argument `reference` must be a finite set-point other than 0, but it is {reference!r}.")
    elif reference is not None:
        raise SceneError(f'Argument `reference` must come with definition "reference", but the definition is "{definition}".')
    return severity_of(extent(run, signal, after, until), definition, reference)






# ------------------------------------------------------------------------------------------------------------------------ step-response measures
def settling(
    run: Trajectory,
    signal: str,
    target: float,
    band: float = 0.02,
    *,
    after: float = 0.0,
    until: float | None = None,
    size: float | None = None,
) -> float:
    """Seconds from `after` until a signal stays within |y - target| <= band * size for the rest of the window; inf if it never does.

    size: the change that counts as whole, in the unit of the signal; |target| without. 0.0 where it never leaves the band. The last
    crossing is located to round-off in time. Raises SceneError for a target of 0 without size, a band outside (0, 1), an unknown or vector signal.
    """
    begin, end = window(run, after, until)
    size = _size(target, size)
    if not is_finite_number(band) or not 0 < band < 1:
        raise SceneError(f"Argument `band` must be between 0 and 1, but it is {band!r}.")
    width = band * size
    steps = _steps(run, signal, begin, end)
    if abs(_value(run, signal, end) - target) > width:
        return math.inf
    outside = np.flatnonzero((steps.highest - target > width) | (target - steps.lowest > width))
    if not outside.size:
        return 0.0
    last = int(outside[-1])  # what leaves the band in it is the later of its extrema that do, or a later point yet
    extrema = ((steps.when_highest[last], steps.highest[last] - target), (steps.when_lowest[last], target - steps.lowest[last]))
    low, high = max(float(when) for when, beyond in extrema if beyond > width), float(steps.end[last])
    while high - low > 2e-16 * max(high, begin):
        grid = np.linspace(low, high, 34)[1:-1]
        left = np.flatnonzero(np.abs(scalar(run.nodes.at(grid), signal) - target) > width)
        at = int(left[-1]) if left.size else -1
        step = (float(grid[at]) if at >= 0 else low, float(grid[at + 1]) if at + 1 < grid.size else high)
        if step == (low, high):
            break
        low, high = step
    return high - begin


def standstill(run: Trajectory, signal: str, speed: float = 0.0, *, after: float = 0.0) -> float:
    """Time [s] at which a signal that is above `speed` first falls to it, from `after` on; inf if it never does, `after` where it is there already.

    Located to round-off in time. Raises SceneError for a speed that is not finite, an unknown or vector signal and a window outside the run.
    """
    from scipy.optimize import brentq

    begin, end = window(run, after, None)
    if not is_finite_number(speed):
        raise SceneError(f"Argument `speed` must be a finite number, but it is {speed!r}.")
    steps = _steps(run, signal, begin, end)
    below = np.flatnonzero(steps.lowest <= speed)
    if not below.size:
        return end if _value(run, signal, end) <= speed else math.inf
    first = int(below[0])
    start, there = float(steps.begin[first]), float(steps.when_lowest[first])
    if _value(run, signal, start) <= speed:
        return start

    def excess(t: float) -> float:
        return _value(run, signal, t) - speed

    if excess(there) > 0.0:  # by round-off, or because it jumps
        return there
    return float(brentq(excess, start, there, xtol=1e-14 * max(1.0, end)))


def overshoot(
    run: Trajectory, signal: str, target: float, *, after: float = 0.0, until: float | None = None, size: float | None = None
) -> float:
    """Largest excursion beyond the target, seen from where the signal is at `after`, in parts of `size` (|target| without); 0.0 for none.

    Raises SceneError for a target of 0 without size, an unknown or vector signal, and a window outside the run.
    """
    begin, end = window(run, after, until)
    size = _size(target, size)
    start = _value(run, signal, begin)
    found = extent(run, signal, begin, end)
    beyond = found.maximum - target if start < target else target - found.minimum
    if start == target:
        beyond = max(found.maximum - target, target - found.minimum)
    return max(0.0, beyond) / size


def _size(target: float, size: float | None) -> float:
    if not is_finite_number(target):
        raise SceneError(f"Argument `target` must be a finite number, but it is {target!r}.")
    if size is None:
        if target == 0:
            raise SceneError("Argument `size` must be given where `target` is 0, because nothing else says how large a deviation is.")
        return abs(target)
    if not is_finite_number(size) or size <= 0:
        raise SceneError(f"Argument `size` must be > 0, but it is {size!r}.")
    return float(size)


# ------------------------------------------------------------------------------------------------------------------------- unilateral contacts
@dataclass(frozen=True)
class Contact:
    """What a unilateral contact went through: number of impacts, time closed [s], largest force [N] and largest speed of approach [m/s].

    A rigid contact takes an impact in an instant, so that its force is that while it is closed.
    """

    impacts: int
    time: float
    force: float
    speed: float


def contact(run: Trajectory, element: str, after: float = 0.0, until: float | None = None) -> Contact:
    """Impacts, closed time, largest force and speed of approach of a `UnilateralContact` between `after` and `until` [s] (the end of the run).

    An impact is a closing, or a bounce of a rigid contact. Raises SceneError for another element or a window outside the run.
    """
    begin, end = window(run, after, until)
    found = next((e for e in run.program.system.elements if e.name == element), None)
    if not isinstance(found, UnilateralContact):
        contacts = [e.name for e in run.program.system.elements if isinstance(e, UnilateralContact)]
        raise SceneError(f"There is no unilateral contact `{element}`: {suggest(element, contacts)}")
    times = np.array([e.time for e in run.events if e.element == element and e.before == "open" and begin <= e.time <= end])
    nodes = run.nodes
    before = np.searchsorted(nodes.time, times, side="left")  # of the two nodes at an event the first is what was
    approach = _rows(nodes, before).computed(f"{element}.rate", found.rate) if times.size else np.zeros(1)
    closed = run.time_in(element, "closed", begin, end)
    return Contact(times.size, closed, extent(run, f"{element}.force", begin, end).maximum if closed else 0.0, float(approach.max()))


# -------------------------------------------------------------------------------------------------------------------------------------- energy
@dataclass(frozen=True)
class EnergyAudit:
    """Where the energy of a run went: end - start of what is stored must equal supplies - losses. All in J; print it for the table.

    stored: {part: (at the start, at the end)};  losses, supplies: {term: integral of its power over the run};  impacts: what unilateral contacts
    took at the instants at which they opened, closed or bounced;  turnover: the largest amount that one term moved, both directions counted, or
    that one part stores at the start or the end.
    """

    duration: float
    stored: dict[str, tuple[float, float]]
    losses: dict[str, float]
    supplies: dict[str, float]
    impacts: float
    turnover: float

    @property
    def residual(self) -> float:
        """Supplies - losses - impacts - growth of the stored energy [J]; 0 for a model whose energy is declared as its flow has it."""
        growth = math.fsum(end - start for start, end in self.stored.values())
        return math.fsum([*self.supplies.values(), *(-value for value in self.losses.values()), -self.impacts, -growth])

    @property
    def relative(self) -> float:
        """|residual| / turnover [1]; 0.0 where nothing moves."""
        return abs(self.residual) / self.turnover if self.turnover > 0 else 0.0

    def __str__(self) -> str:
        rows = [(f"stored in {name}", end - start, f"{start:.6g} -> {end:.6g}") for name, (start, end) in self.stored.items()]
        rows += [(f"supply {name}", value, "") for name, value in self.supplies.items()]
        rows += [(f"loss {name}", 0.0 - value, "") for name, value in self.losses.items()]
        rows += [("impacts", 0.0 - self.impacts, "")] if self.impacts else []
        width = max([len(name) for name, _, _ in rows] + [len("residual")])
        lines = [f"Energy over {self.duration:g} s [J]"]
        lines += [f"  {name:<{width}} {value:>15.8g}  {note}".rstrip() for name, value, note in rows]
        lines.append(f"  {'residual':<{width}} {self.residual:>15.3g}  {self.relative:.1e} of {self.turnover:.6g} turned over")
        return "\n".join(lines)


def energy_audit(run: Trajectory) -> EnergyAudit:
    """Integrate every declared loss and supply over a run and compare with the energy stored.

    Energies and powers are the expressions that the parts declare beside their flow, so a residual above the accuracy of the run shows a model
    whose physics and equations disagree, or a part that exchanges power without saying so. Integrals are Gauss-Legendre with 8 points on every
    step (order 16, so that the quadrature adds nothing to the error of the run), with the modes and held signals of that step.
    """
    check_run(run)
    nodes = run.nodes
    system = nodes.program.system
    terms = [*system.losses.values(), *system.supplies.values()]
    power = output_function(nodes.program, "audit of power", ca.vertcat(*terms)) if terms else None
    energy = output_function(nodes.program, "audit of energy", ca.vertcat(*system.stored.values())) if system.stored else None
    total, moved = np.zeros(len(terms)), np.zeros(len(terms))
    begin, end = window(run, 0.0, None) if nodes.time[-1] > 0 else (0.0, 0.0)
    if power is not None:
        for weights, samples in gauss(run, begin, end):
            values = _evaluated(power, samples)
            total += values @ weights
            moved += np.abs(values) @ weights
    ends = np.zeros(nodes.time.size, bool)
    ends[[0, -1]] = True
    stored = _evaluated(energy, _rows(nodes, ends)) if energy is not None else np.zeros((0, 2))
    first = len(system.losses)
    return EnergyAudit(
        duration=end - begin,
        stored={name: (float(row[0]), float(row[-1])) for name, row in zip(system.stored, stored, strict=True)},
        losses=dict(zip(system.losses, total[:first].tolist(), strict=True)),
        supplies=dict(zip(system.supplies, total[first:].tolist(), strict=True)),
        impacts=_taken_by_impacts(run, energy) if energy is not None else 0.0,
        turnover=float(max(np.max(moved, initial=0.0), np.max(np.abs(stored), initial=0.0))),
    )


def _taken_by_impacts(run: Trajectory, energy: ca.Function) -> float:
    """Fall of the stored energy at the instants at which unilateral contacts switched [J]."""
    contacts = {e.name for e in run.program.system.elements if isinstance(e, UnilateralContact)}
    times = np.unique([event.time for event in run.events if event.element in contacts])
    if not times.size:
        return 0.0
    nodes = run.nodes
    first, last = np.searchsorted(nodes.time, times, side="left"), np.searchsorted(nodes.time, times, side="right") - 1
    fall = _evaluated(energy, _rows(nodes, first)) - _evaluated(energy, _rows(nodes, last))
    return math.fsum(fall.ravel()) if np.isfinite(fall).all() else math.nan  # of a motion that overflows






def _borders(run: Trajectory, begin: float, end: float) -> np.ndarray:
    nodes = run.nodes.time
    return np.unique(np.concatenate([[begin], nodes[(nodes > begin) & (nodes < end)], [end]]))


def gauss(run: Trajectory, begin: float, end: float) -> Iterator[tuple[np.ndarray, Samples]]:
    """(weights [s], signals) at the Gauss points of every step between begin and end, in portions."""
    borders = _borders(run, begin, end)
    for first in range(0, borders.size - 1, CHUNK):
        piece = borders[first : first + CHUNK + 1]
        width = np.diff(piece)
        times = piece[:-1, None] + width[:, None] * POINTS
        yield (width[:, None] * WEIGHTS).ravel(), run.nodes.at(times.ravel())


def _steps(run: Trajectory, signal: str, begin: float, end: float) -> Steps:
    """What a scalar signal does in every step; raises SceneError for an unknown name or a vector."""
    from toolbox.measuring.quintics import steps_of

    scalar(run.nodes.at(np.array([begin])), signal)
    return steps_of(run.nodes, signal, begin, end)


def _value(run: Trajectory, signal: str, t: float) -> float:
    """Value of a scalar signal, on the far side of a jump."""
    return float(scalar(run.nodes.at(np.array([t])), signal)[0])


def _value_in(run: Trajectory, signal: str, steps: Steps, i: int, t: float) -> float:
    """Value of a signal in step i; at its end that on the near side of a jump."""
    nodes, row = run.nodes, int(steps.row[i])
    if t < steps.end[i]:
        return _value(run, signal, t)
    states = nodes.states[row + 1 : row + 2] if t == nodes.time[row + 1] else nodes.at(np.array([t])).states
    sides = Samples(nodes.program, np.array([t]), states, nodes.mode[row : row + 1], nodes.held[row : row + 1], nodes.parameters, False)
    return float(scalar(sides, signal)[0])


def _rows(nodes: Trajectory, chosen: np.ndarray) -> Samples:
    """The signals at some of the nodes, each with the modes and held signals recorded there."""
    return Samples(nodes.program, nodes.time[chosen], nodes.states[chosen], nodes.mode[chosen], nodes.held[chosen], nodes.parameters, False)




def _evaluated(function: ca.Function, samples: Samples) -> np.ndarray:
    """A function of `output_function` at all samples, shape (rows of the function, nt)."""
    constants = samples._constants
    return np.array(function(samples.time[None, :], samples.states.T, constants, samples.held.T, samples.mode.T.astype(float)))
