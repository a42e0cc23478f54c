"""Numbers measured on a run: stick intervals, cycles, severity, settling, overshoot, and the energy audit.

Why not from the recorded nodes: a step of order eight is long, a quarter of a second on a drill string, so the largest node value misses the peak and the
mean of the nodes weighs fast phases too much; on JANSEN_2 in stick-slip the severity is then wrong by 4 %. Here every step is read as
`toolbox.measuring.readings` reads it, with the derivatives of the signal: means are integrals of these quintics, the step of an extremum or a crossing is
found on them, and its value is that of `run.at`.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from toolbox.arguments import number
from toolbox.errors import SceneError
from toolbox.files.units import NumberOrText, in_si
from toolbox.halving import zero
from toolbox.measuring.energy import EnergyAudit as EnergyAudit
from toolbox.measuring.energy import energy_audit as energy_audit
from toolbox.measuring.energy import gauss
from toolbox.measuring.severity import Extent, check_definition, severity_of
from toolbox.simulation.recorded import Recorded
from toolbox.simulation.samples import scalar, window

if TYPE_CHECKING:
    from toolbox.measuring.quintics import Steps


# ------------------------------------------------------------------------------------------------------------------------- intervals of stick
def stick_intervals(
    run: Recorded, element: str, after: NumberOrText = 0.0, until: NumberOrText | None = None, *, mode: str = "stick"
) -> list[tuple[float, float]]:
    """Return (begin, end) [s] of every stay in stick, or in another mode, cut to the window.

    Begin and end are located events, not nodes.

    Parameters
    ----------
    run
        The trajectory.
    element
        Name of the contact.
    after, until
        Window [s]; by default the whole run.
    mode
        The mode that counts, such as "closed" of a wall.

    Raises
    ------
    SceneError
        If the element is unknown, or the window lies outside the run.
    """
    begin, end = window(run, after, until)
    found: list[tuple[float, float]] = []
    for first, last, word in run.intervals(element):
        first, last = max(first, begin), min(last, end)
        if word != mode or first >= last:
            continue
        if found and found[-1][1] == first:  # a release that is taken back at the same instant does not part two stays
            found[-1] = (found[-1][0], last)
        else:
            found.append((first, last))
    return found


def stuck_ratio(run: Recorded, element: str, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> float:
    """Measure the part of the window that an element spends in stick, from 0 to 1.

    Takes what `stick_intervals` takes, and raises SceneError as it does.
    """
    begin, end = window(run, after, until)
    return run.time_in(element, "stick", begin, end) / (end - begin)


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


def cycles(run: Recorded, element: str, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> list[StickSlipPeriod]:
    """Find every cycle of stick-slip of an element, from release to release, that lies whole in the window, its ends included.

    A final stick that nothing ends belongs to no cycle; slip in both directions counts as slip.

    Parameters
    ----------
    run
        The trajectory.
    element
        Name of the contact.
    after, until
        Window [s]; by default the whole run.

    Returns
    -------
    list of StickSlipPeriod
        Start of each cycle, and how long it slips and sticks [s].

    Raises
    ------
    SceneError
        If the element is unknown, or the window lies outside the run.
    """
    begin, end = window(run, after, until)
    return [
        StickSlipPeriod(start=release, slip=caught - release, stick=leaves - caught)
        for (_, release), (caught, leaves) in itertools.pairwise(stick_intervals(run, element))
        if begin <= release and leaves <= end and leaves < run.end
    ]


def extent(run: Recorded, signal: str, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> Extent:
    """Measure the extrema and the time mean of a scalar signal, as accurately as the run.

    The mean is the Gauss-Legendre integral over every step, divided by the length of the window; at a jump both sides count as values.

    Parameters
    ----------
    run
        The trajectory.
    signal
        Name of a scalar signal.
    after, until
        Window [s]; by default the whole run.

    Raises
    ------
    SceneError
        If the signal is unknown or a vector, or the window lies outside the run.
    """
    begin, end = window(run, after, until)
    steps = _steps(run, signal, begin, end)
    last = _value(run, signal, end)  # the far side of a jump there
    ends: list[tuple[float, float]] = []
    for values, times, sign in ((steps.lowest, steps.when_lowest, -1.0), (steps.highest, steps.when_highest, 1.0)):
        i = int(np.argmax(sign * values))
        value = scalar(
            run.nodes.inside(steps.row[i : i + 1], times[i : i + 1]), signal
        )  # at the end of a step that on the near side of a jump
        found = (float(value[0]), float(times[i]))
        ends.append(max(found, (last, end), key=lambda pair: sign * pair[0]))
    (low, when_low), (high, when_high) = ends
    mean = math.fsum(steps.integral) / (end - begin)
    return Extent(low, high, min(max(mean, low), high), when_low, when_high)


def mean_square(run: Recorded, signal: str, target: float = 0.0, *, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> float:
    """Measure the time mean of (signal - target)^2, in the unit of the signal squared.

    It is the Gauss-Legendre integral over every step; its derivatives are those of `Sensitivity.mean_square`.

    Parameters
    ----------
    run
        The trajectory.
    signal
        Name of a scalar signal.
    target
        The target, in the unit of the signal.
    after, until
        Window [s]; by default the whole run.

    Raises
    ------
    SceneError
        If the signal is unknown or a vector, or the window lies outside the run.
    """
    begin, end = window(run, after, until)
    target = number("target", target, run.unit(signal))
    return sum(float(weights @ (scalar(samples, signal) - target) ** 2) for weights, samples in gauss(run, begin, end)) / (end - begin)


def rubbing_speed(run: Recorded, contact: str | None = None) -> str:
    """The speed of what rubs at a contact, by default at the only one, else the slip there. Raises SceneError if there are several contacts, or none."""
    if contact is None:
        if len(run.contacts) != 1:
            known = ", ".join(f"`{name}`" for name in run.contacts) or "none"
            raise SceneError(f"Argument `signal` must be given unless the run has one contact, but its contacts are: {known}.")
        (contact,) = run.contacts
    return f"{contact}.speed" if f"{contact}.speed" in run else f"{contact}.slip"


def severity(
    run: Recorded,
    signal: str | None = None,
    after: NumberOrText = 0.0,
    definition: str = "half-range",
    *,
    until: NumberOrText | None = None,
    reference: NumberOrText | None = None,
) -> float:
    """Measure the severity of stick-slip [1]: how far a speed swings, as a part of its mean or of a set-point.

        "half-range"   (max - min) / (2 mean)          1 where the bit just stops; the usual field index, and the default
        "range"        (max - min) / mean
        "peak"         max / mean - 1                   overspeed alone
        "reference"    (max - min) / (2 reference)      against the set-point `reference`

    Extrema and time mean are those of `extent`: choose `after` beyond the transient, and a window of many periods. The sign of the divisor is ignored. For
    time instead of speed see `stuck_ratio`.

    Parameters
    ----------
    run
        The trajectory.
    signal
        Name of a scalar signal, usually a speed; by default that of what rubs at the only contact, else the slip there.
    after, until
        Window [s]; by default the whole run.
    definition
        One of the four definitions above.
    reference
        The set-point, in the unit of the signal; for "reference" only.

    Returns
    -------
    float
        The severity; inf for a swing about zero, nan for a signal that stays exactly 0.

    Raises
    ------
    SceneError
        If the definition or the signal is unknown, or the reference is missing or not needed.
    """
    signal = rubbing_speed(run) if signal is None else signal
    reference = in_si(reference, run.unit(signal), "reference") if isinstance(reference, str) else reference
    check_definition(definition, reference)
    return severity_of(extent(run, signal, after, until), definition, reference)


# ------------------------------------------------------------------------------------------------------------------------ step-response measures
def settling(
    run: Recorded,
    signal: str,
    target: NumberOrText,
    band: float = 0.02,
    *,
    after: NumberOrText = 0.0,
    until: NumberOrText | None = None,
    size: NumberOrText | None = None,
) -> float:
    """Measure how long a signal takes to stay within |y - target| <= band * size for the rest of the window.

    The last crossing is located to round-off in time.

    Parameters
    ----------
    run
        The trajectory.
    signal
        Name of a scalar signal.
    target
        The target, in the unit of the signal, or the name of a signal that ends there, such as "top.reference".
    band
        Half-width of the band, as a part of `size`.
    after, until
        Window [s]; by default the whole run.
    size
        The change that counts as 1, in the unit of the signal; by default |target|.

    Returns
    -------
    float
        Seconds from `after` on: 0.0 if the signal never leaves the band, inf if it never comes to stay in it.

    Raises
    ------
    SceneError
        If the target is 0 and there is no size, the band is outside (0, 1), or the signal is unknown or a vector.
    """
    begin, end = window(run, after, until)
    target, size = _aimed(run, signal, target, size, end)
    band = number("band", band, above=0, below=1)
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


def standstill(run: Recorded, signal: str, speed: float = 0.0, *, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> float:
    """Find the time [s] at which a signal that is above `speed` first falls to it.

    The time is located to round-off.

    Parameters
    ----------
    run
        The trajectory.
    signal
        Name of a scalar signal.
    speed
        The value that counts as standing, in the unit of the signal.
    after, until
        Window [s]; by default the whole run.

    Returns
    -------
    float
        The time; inf if the signal never falls so far, `after` if it is there already.

    Raises
    ------
    SceneError
        If the speed is not finite, the signal is unknown or a vector, or the window lies outside the run.
    """
    begin, end = window(run, after, until)
    speed = number("speed", speed, run.unit(signal))
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
    return zero(excess, start, there, 1e-14 * max(1.0, end))


def overshoot(
    run: Recorded,
    signal: str,
    target: NumberOrText,
    *,
    after: NumberOrText = 0.0,
    until: NumberOrText | None = None,
    size: NumberOrText | None = None,
) -> float:
    """Measure the largest excursion of a signal beyond its target, as a part of `size`.

    "Beyond" is seen from where the signal is at `after`.

    Parameters
    ----------
    run
        The trajectory.
    signal
        Name of a scalar signal.
    target
        As in `settling`.
    after, until
        Window [s]; by default the whole run.
    size
        The change that counts as 1; by default |target|.

    Returns
    -------
    float
        The overshoot [1]; 0.0 if there is none.

    Raises
    ------
    SceneError
        If the target is 0 and there is no size, the signal is unknown or a vector, or the window lies outside the run.
    """
    begin, end = window(run, after, until)
    target, size = _aimed(run, signal, target, size, end)
    start = _value(run, signal, begin)
    found = extent(run, signal, begin, end)
    beyond = found.maximum - target if start < target else target - found.minimum
    if start == target:
        beyond = max(found.maximum - target, target - found.minimum)
    return max(0.0, beyond) / size


def _aimed(run: Recorded, signal: str, target: NumberOrText, size: NumberOrText | None, end: float) -> tuple[float, float]:
    """The target, where it names a signal its value at the end, and the change that counts as 1; raises SceneError where nothing says how large that is."""
    given = _value(run, target, end) if isinstance(target, str) and target in run else target
    aim = number("target", given, run.unit(signal))
    if size is not None:
        return aim, number("size", size, run.unit(signal), above=0)
    if aim == 0:
        raise SceneError("Argument `size` must be given where `target` is 0, because nothing else says how large a deviation is.")
    return aim, abs(aim)


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


def contact(run: Recorded, element: str, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> Contact:
    """Measure impacts, closed time, largest force and largest speed of approach of a `UnilateralContact`.

    An impact is a closing, or a bounce of a rigid contact.

    Parameters
    ----------
    run
        The trajectory.
    element
        Name of the unilateral contact.
    after, until
        Window [s]; by default the whole run.

    Raises
    ------
    SceneError
        If the element is no unilateral contact, or the window lies outside the run.
    """
    begin, end = window(run, after, until)
    speeds = run.approach(element)
    times = np.array([e.time for e in run.events if e.element == element and e.before == "open"])
    speeds = speeds[(times >= begin) & (times <= end)] if times.size else speeds
    closed = run.time_in(element, "closed", begin, end)
    force = extent(run, f"{element}.force", begin, end).maximum if closed else 0.0
    return Contact(speeds.size, closed, force, float(speeds.max(initial=0.0)))


# -------------------------------------------------------------------------------------------------------------------------------------- energy


def _steps(run: Recorded, signal: str, begin: float, end: float) -> Steps:
    """What a scalar signal does in every step; raises SceneError for an unknown name or a vector."""
    from toolbox.measuring.quintics import steps_of

    scalar(run.nodes.at(np.array([begin])), signal)
    return steps_of(run.nodes, signal, begin, end)


def _value(run: Recorded, signal: str, t: float) -> float:
    """Value of a scalar signal, on the far side of a jump."""
    return float(scalar(run.nodes.at(np.array([t])), signal)[0])
