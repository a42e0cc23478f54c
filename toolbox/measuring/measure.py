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
from toolbox.measuring.energy import EnergyAudit, energy_audit, gauss
from toolbox.measuring.severity import Extent, check_definition, severity_of
from toolbox.measuring.sticks import stick_intervals, stuck_ratio
from toolbox.simulation.recorded import Recorded
from toolbox.simulation.samples import check_run, scalar, window

if TYPE_CHECKING:
    from toolbox.measuring.quintics import Steps

__all__ = [
    "Contact", "EnergyAudit", "StickSlipPeriod", "contact", "cycles", "energy_audit", "extent", "mean_square", "overshoot", "rubbing_speed", "settling",
    "severity", "standstill", "stick_intervals", "stuck_ratio",
]  # fmt: skip


# ------------------------------------------------------------------------------------------------------------------------------------------ cycles
@dataclass(frozen=True)
class StickSlipPeriod:
    """One cycle of stick-slip: slip from the release at `start` for the time `slip`, then stick for the time `stick` until the next release [s].

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, measure, simulate
    >>> cycle = measure.cycles(simulate(compose(BlockOnBelt()), "60 s"), "belt")[-1]
    >>> print(f"period {cycle.period:.2f} s")
    period 12.00 s
    """

    start: float
    slip: float
    stick: float

    @property
    def period(self) -> float:
        """Time from one release to the next [s]."""
        return self.slip + self.stick


def cycles(run: Recorded, element: str, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> list[StickSlipPeriod]:
    """Return every stick-slip cycle of a contact, from release to release.

    A cycle is listed if the whole cycle lies in the window. Its ends may be the ends of the window. A last stick phase
    that does not end is not part of a cycle. Slip in either direction counts as slip.

    Parameters
    ----------
    run
        The run.
    element
        Name of the contact, such as "bit".
    after, until
        Begin and end of the window [s]. By default the whole run.

    Returns
    -------
    list of StickSlipPeriod
        Start of each cycle [s], and the times in slip and in stick of the cycle [s].

    Raises
    ------
    SceneError
        If the element is unknown, or the window lies outside the run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(BlockOnBelt()), "60 s")
    >>> cycles = measure.cycles(run, "belt")
    >>> print(f"{len(cycles)} cycles, the last slips for {cycles[-1].slip:.2f} s and sticks for {cycles[-1].stick:.2f} s")
    4 cycles, the last slips for 4.30 s and sticks for 7.71 s
    """
    begin, end = window(run, after, until)
    return [
        StickSlipPeriod(start=release, slip=caught - release, stick=leaves - caught)
        for (_, release), (caught, leaves) in itertools.pairwise(stick_intervals(run, element))
        if begin <= release and leaves <= end and leaves < run.end
    ]


def extent(run: Recorded, signal: str, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> Extent:
    """Measure minimum, maximum and time mean of a scalar signal, as accurately as the run.

    The mean is the Gauss-Legendre integral over every step, divided by the length of the window. At a jump both
    values count.

    Parameters
    ----------
    run
        The run.
    signal
        Name of a scalar signal, such as "bit.speed".
    after, until
        Begin and end of the window [s]. By default the whole run.

    Returns
    -------
    Extent
        The fields `minimum`, `maximum` and `mean`, in the SI unit of the signal.

    Raises
    ------
    SceneError
        If the signal is unknown or a vector, or the window lies outside the run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(BlockOnBelt()), "60 s")
    >>> speed = measure.extent(run, "block.speed", after=20.0)
    >>> print(f"{speed.minimum:.3f} to {speed.maximum:.3f} m/s")
    -0.840 to 0.200 m/s
    """
    begin, end = window(run, after, until)
    steps = _steps(run, signal, begin, end)
    last = _value(run, signal, end)  # the far side of a jump there
    ends: list[tuple[float, float]] = []
    for values, times, sign in ((steps.lowest, steps.when_lowest, -1.0), (steps.highest, steps.when_highest, 1.0)):
        i = int(np.argmax(sign * values))
        value = scalar(
            run.every_step.interpolated(steps.row[i : i + 1], times[i : i + 1]), signal
        )  # at the end of a step that on the near side of a jump
        found = (float(value[0]), float(times[i]))
        ends.append(max(found, (last, end), key=lambda pair: sign * pair[0]))
    (low, when_low), (high, when_high) = ends
    mean = math.fsum(steps.integral) / (end - begin)
    return Extent(low, high, min(max(mean, low), high), when_low, when_high)


def mean_square(run: Recorded, signal: str, target: float = 0.0, *, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> float:
    """Measure the time mean of (signal - target)^2.

    The mean is the Gauss-Legendre integral over every step. `Sensitivity.mean_square` gives its derivatives.

    Parameters
    ----------
    run
        The run.
    signal
        Name of a scalar signal, such as "bit.speed".
    target
        The target, in the SI unit of the signal, by default 0.
    after, until
        Begin and end of the window [s]. By default the whole run.

    Returns
    -------
    float
        The mean square, in the SI unit of the signal squared.

    Raises
    ------
    SceneError
        If the signal is unknown or a vector, or the window lies outside the run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(BlockOnBelt()), "60 s")
    >>> print(f"{measure.mean_square(run, 'block.speed', target=0.2, after=20.0):.4f} m2/s2")
    0.1631 m2/s2
    """
    begin, end = window(run, after, until)
    target = number("target", target, run.unit(signal))
    return sum(float(weights @ (scalar(samples, signal) - target) ** 2) for weights, samples in gauss(run, begin, end)) / (end - begin)


def rubbing_speed(run: Recorded, contact: str | None = None) -> str:
    """Return the name of the speed signal of a contact, such as "bit.speed".

    If the plant has no signal of this name, return the name of the slip of the contact, such as "bit.slip".

    Parameters
    ----------
    run
        The run.
    contact
        Name of the contact. By default the only contact of the run.

    Returns
    -------
    str
        Name of the signal.

    Raises
    ------
    SceneError
        If no contact is given, and the run has none or several.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(wells.JANSEN_2, BitRock()), "10 s", inputs={"top.torque": "11 kN m"})
    >>> print(f"{measure.rubbing_speed(run)} ends at {run[measure.rubbing_speed(run)][-1]:.2f} rad/s")
    bit.speed ends at 0.00 rad/s
    """
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
    """Measure the severity of stick-slip [1]: the swing of a speed as a fraction of its mean or of a set-point.

        "half-range"   (max - min) / (2 mean)          1 if the bit just comes to rest; the usual index in the field, and the default
        "range"        (max - min) / mean
        "peak"         max / mean - 1                   overspeed alone
        "reference"    (max - min) / (2 reference)      relative to the set-point `reference`

    `extent` computes minimum (min), maximum (max) and time mean (mean). Choose `after` beyond the transient, and a
    window of many periods. The sign of the divisor is ignored. `stuck_ratio` measures the time in stick.

    Parameters
    ----------
    run
        The run.
    signal
        Name of a scalar signal, usually a speed; by default the speed at the only contact of the plant, such as
        `bit.speed`. If the plant has no such signal, the slip of the contact.
    after, until
        Begin and end of the window [s]. By default the whole run.
    definition
        One of the four definitions in the table above, by default "half-range".
    reference
        The set-point, in the SI unit of the signal or as text with a unit. Only for the definition "reference", by
        default None.

    Returns
    -------
    float
        The severity. It is inf for a swing about zero, and nan for a signal that stays exactly 0.

    Raises
    ------
    SceneError
        If the definition or the signal is unknown, the reference is missing, or a reference is given that is not
        needed.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(wells.JANSEN_2, BitRock()), "100 s", inputs={"top.torque": "11 kN m"})
    >>> print(f"{measure.severity(run, 'bit.speed', after=60.0):.2f}")
    1.35
    """
    check_run(run)
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
    """Measure the time until a signal enters a band around its target and stays in it.

    The band is |signal - target| <= band * size. The last crossing of the band is located to round-off in time.

    Parameters
    ----------
    run
        The run.
    signal
        Name of a scalar signal, such as "top.speed".
    target
        The target, in the SI unit of the signal or as text with a unit. Or the name of a signal, such as
        "top.reference": its value at the end of the window is the target.
    band
        Half-width of the band, as a fraction of `size`, by default 0.02.
    after, until
        Begin and end of the window [s]. By default the whole run.
    size
        Reference value of the band, in the unit of the signal. By default |target|.

    Returns
    -------
    float
        Seconds from `after` on. 0.0 if the signal never leaves the band, inf if it does not stay in the band.

    Raises
    ------
    SceneError
        If the target is 0 and no size is given, the band is outside (0, 1), or the signal is unknown or a vector.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, measure, simulate
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock()), SoftTorque(reference="120 rpm"))
    >>> run = simulate(loop, "60 s")
    >>> print(f"{measure.settling(run, 'top.speed', '120 rpm'):.1f} s")
    25.8 s
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
        left = np.flatnonzero(np.abs(scalar(run.every_step.at(grid), signal) - target) > width)
        at = int(left[-1]) if left.size else -1
        step = (float(grid[at]) if at >= 0 else low, float(grid[at + 1]) if at + 1 < grid.size else high)
        if step == (low, high):
            break
        low, high = step
    return high - begin


def standstill(run: Recorded, signal: str, speed: float = 0.0, *, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> float:
    """Find the time [s] at which a signal first falls to `speed`.

    The time is located to round-off.

    Parameters
    ----------
    run
        The run.
    signal
        Name of a scalar signal, such as "disc.speed".
    speed
        The value that counts as standstill, in the SI unit of the signal, by default 0.
    after, until
        Begin and end of the window [s]. By default the whole run.

    Returns
    -------
    float
        The time [s]. inf if the signal does not fall to `speed`, and `after` if the signal is at or below `speed` at
        this time.

    Raises
    ------
    SceneError
        If the speed is not finite, the signal is unknown or a vector, or the window lies outside the run.

    Examples
    --------
    >>> from models import DiscBrake
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(DiscBrake()), "10 s", start={"disc.speed": 6.0})
    >>> print(f"{measure.standstill(run, 'disc.speed', speed=0.1):.2f} s")
    2.37 s
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
    """Measure the largest excursion of a signal beyond its target, as a fraction of `size`.

    "Beyond" is the side opposite to the value of the signal at `after`.

    Parameters
    ----------
    run
        The run.
    signal
        Name of a scalar signal, such as "top.speed".
    target
        The target, in the SI unit of the signal or as text with a unit. Or the name of a signal, such as
        "top.reference": its value at the end of the window is the target.
    after, until
        Begin and end of the window [s]. By default the whole run.
    size
        Reference value of the overshoot, in the unit of the signal. By default |target|.

    Returns
    -------
    float
        The overshoot [1]. 0.0 if the signal does not pass its target.

    Raises
    ------
    SceneError
        If the target is 0 and no size is given, the signal is unknown or a vector, or the window lies outside the
        run.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, measure, simulate
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock()), SoftTorque(reference="120 rpm"))
    >>> print(f"{measure.overshoot(simulate(loop, '60 s'), 'bit.speed', '120 rpm'):.2f}")
    1.27
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
    """Metrics of a unilateral contact, the result of `contact`: `impacts`, `time` closed [s], largest `force` [N] and largest approach `speed` [m/s].

    For a rigid contact, which takes an impact in an instant, the force is the force while the contact is closed.

    Examples
    --------
    >>> from models import BacklashDrive
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(BacklashDrive()), "20 s", inputs={"driver.force": 2.0})
    >>> metrics = measure.contact(run, "push")
    >>> print(f"{metrics.impacts} impacts, at most {metrics.speed:.2f} m/s")
    17 impacts, at most 0.40 m/s
    """

    impacts: int
    time: float
    force: float
    speed: float


def contact(run: Recorded, element: str, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> Contact:
    """Measure impacts, closed time, largest force and largest approach speed of a contact that can open.

    An impact is a closing of the contact, or a bounce of a rigid contact.

    Parameters
    ----------
    run
        The run.
    element
        Name of a `UnilateralContact`.
    after, until
        Begin and end of the window [s]. By default the whole run.

    Returns
    -------
    Contact
        Number of impacts, time in contact, largest force and largest approach speed.

    Raises
    ------
    SceneError
        If the element is no unilateral contact, or the window lies outside the run.

    Examples
    --------
    >>> from models import BacklashDrive
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(BacklashDrive()), "20 s", inputs={"driver.force": 2.0})
    >>> print(measure.contact(run, "push").impacts)
    17
    """
    begin, end = window(run, after, until)
    speeds = run.impact_speeds(element)
    times = np.array([e.time for e in run.events if e.element == element and e.before == "open"])
    speeds = speeds[(times >= begin) & (times <= end)] if times.size else speeds
    closed = run.time_in(element, "closed", begin, end)
    force = extent(run, f"{element}.force", begin, end).maximum if closed else 0.0
    return Contact(speeds.size, closed, force, float(speeds.max(initial=0.0)))


# -------------------------------------------------------------------------------------------------------------------------------------- energy


def _steps(run: Recorded, signal: str, begin: float, end: float) -> Steps:
    """What a scalar signal does in every step; raises SceneError for an unknown name or a vector."""
    from toolbox.measuring.quintics import steps_of

    scalar(run.every_step.at(np.array([begin])), signal)
    return steps_of(run.every_step, signal, begin, end)


def _value(run: Recorded, signal: str, t: float) -> float:
    """Value of a scalar signal, on the far side of a jump."""
    return float(scalar(run.every_step.at(np.array([t])), signal)[0])
