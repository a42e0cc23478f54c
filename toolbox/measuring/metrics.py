"""What is measured of a run: one list of measures, which every verb knows by the same names.

    sweep(loop, vary, metrics="settling")      tune(scene, law, ["severity", maximum("top.torque")], bounds)      compare(one, other, metrics=["peak", mine])

A measure is asked by its name, as a `Measure` of this file, or as a function of a run. By its name it looks at what the loop judges; the same measure of
another signal, from 20 s on, is `maximum("top.torque", 20.0)`. Runs by the thousand are measured inside compiled loops where the measure has such a form
(`toolbox.measuring.readings`), else each from its run, with the same result to the accuracy of the run.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import number
from toolbox.errors import SceneError, suggest
from toolbox.files.units import NumberOrText, in_si
from toolbox.measuring import measure, sticks
from toolbox.measuring.severity import check_definition
from toolbox.modelling.closing import kind_of
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.simulation.recorded import Recorded
from toolbox.simulation.samples import window


@dataclass(frozen=True)
class Metric:
    """One number of a run.

    Attributes
    ----------
    name
        Its name, by which every verb knows it.
    title
        What it is, in words; {mode} stands for the mode of an element.
    looks_at
        "speed", "contact" or "effort": what the loop judges, where `of` does not say another; empty for a function of the whole run.
    unit
        Its unit; empty for the unit of its signal.
    order
        Seconds in its unit beside the unit of its signal: 1 for an integral over time, -2 for a second derivative.
    function
        What reads it from a run: (run, of, after=, until=, and the settings) -> number; of the whole run, (run) -> number.
    compiled
        What it is among the readings of compiled loops; empty where it is read from runs, which takes longer.
    whole
        Whether it is of the whole run where nothing else is said, and not from the judged time on.
    of
        The signal or element; empty for what the loop judges.
    after, until
        Its window [s]; None for the judged time, and for the end of the run.
    settings
        ((word, value), ...): further arguments of the function.
    """

    name: str
    title: str
    looks_at: str
    unit: str
    function: Callable[..., float] = field(repr=False)
    compiled: str = ""
    whole: bool = False
    settings: tuple[tuple[str, Any], ...] = ()
    of: str = ""
    after: float | None = None
    until: float | None = None
    order: int = 0

    def __call__(self, of: str, after: NumberOrText = 0.0, until: NumberOrText | None = None, **settings: Any) -> Metric:
        """The same measure of a signal or an element, between `after` and `until` [s] (the end of the run); settings as its function takes them."""
        known = dict(self.settings)
        unknown = next((word for word in settings if word not in known), None)
        if unknown is not None:
            raise TypeError(f"{self.name}() got an unexpected keyword argument {unknown!r}")
        window = {"after": in_si(after, "s", "after"), "until": in_si(until, "s", "until")}
        return dataclasses.replace(self, of=of, settings=tuple({**known, **settings}.items()), **window)

    @property
    def mode(self) -> str:
        """The mode that is looked for, of a measure of an element."""
        return str(dict(self.settings).get("mode", sticks.STICK))

    @property
    def in_loops(self) -> bool:
        """Whether compiled loops can read it as it is asked."""
        return bool(self.compiled) and not (self.compiled == "ends" and self.until is not None)

    @property
    def heading(self) -> str:
        """Name of the metric and its signal or element, in words."""
        return f"{self.of}, {self.title.format(mode=self.mode)}" if self.of else self.title

    def unit_in(self, machine: HybridSystem | Recorded) -> str:
        """Unit of the number, of a system or a run."""
        return self.unit or times_seconds(machine.unit(self.of), self.order)

    def read(self, run: Recorded) -> float:
        """Return the metric of a run. SceneError is raised if the run lacks the signal or element of the metric, or if the metric names
        none."""
        if not self.looks_at:
            return float(self.function(run))
        if not self.of:
            raise SceneError(
                f"Argument `measure` must say of which {self.looks_at} it is, as in `metrics.{self.name}(...)`, but it does not."
            )
        return float(self.function(run, self.of, after=self.after or 0.0, until=self.until, **dict(self.settings)))

    def check(self, system: HybridSystem, end: float) -> None:
        """Raise SceneError unless the signal or element exists, the window lies before the end of the run [s], and the settings are known."""
        if not self.looks_at:
            return
        after = number("after", self.after, "s", at_least=0, below=end)
        if self.until is not None:
            number("until", self.until, "s", above=after, at_most=end)
        if self.looks_at == "contact":
            words = system.element(self.of).mode_names.values()
            if "mode" in dict(self.settings) and self.mode not in words:
                raise SceneError(f"There is no mode `{self.mode}` of `{self.of}`: {suggest(self.mode, words)}")
            return
        system.signal_unit(self.of)
        rows = system.state_index(self.of)
        if rows[1] is not None if rows else system.expression(self.of).numel() != 1:
            raise SceneError(f"Argument `signal` must be a scalar, but `{self.of}` has several entries: name one, e.g. `{self.of}.0`.")
        if self.name == "severity":
            check_definition(*(dict(self.settings)[word] for word in ("definition", "reference")))


def times_seconds(unit: str, order: int) -> str:
    """Return a unit times a power of the second.

    Parameters
    ----------
    unit
        The unit, such as "m/s".
    order
        The power of the second.

    Examples
    --------
    >>> from toolbox.measuring.metrics import times_seconds
    >>> times_seconds("m/s", 1), times_seconds("m/s", -2), times_seconds("N", 1)
    ('m', 'm/s3', 'N s')
    """
    found = re.fullmatch(r"(.+)/s(\d*)", unit)
    base, power = (found[1], order - int(found[2] or 1)) if found else (unit, order)
    size = "" if abs(power) == 1 else str(abs(power))
    return base if power == 0 else f"{base}/s{size}" if power < 0 else f"{base} s{size}"


# ---------------------------------------------------------------------------------------------------------------------- what reads them from a run
def _minimum(run: Recorded, of: str, after: float, until: float | None) -> float:
    return measure.extent(run, of, after, until).minimum


def _maximum(run: Recorded, of: str, after: float, until: float | None) -> float:
    return measure.extent(run, of, after, until).maximum


def _mean(run: Recorded, of: str, after: float, until: float | None) -> float:
    return measure.extent(run, of, after, until).mean


def _peak(run: Recorded, of: str, after: float, until: float | None) -> float:
    found = measure.extent(run, of, after, until)
    return max(abs(found.minimum), abs(found.maximum))


def _final(run: Recorded, of: str, after: float, until: float | None) -> float:
    return float(run.at(run.end if until is None else until)[of])


def _time_in(run: Recorded, of: str, after: float, until: float | None, mode: str) -> float:
    return sticks.stick_time(run, of, after, until, mode=mode)


def _stays(run: Recorded, of: str, after: float, until: float | None, mode: str) -> float:
    return len(sticks.stick_intervals(run, of, after, until, mode=mode))


def _last_stay(run: Recorded, of: str, after: float, until: float | None, mode: str) -> float:
    found = sticks.stick_intervals(run, of, after, until, mode=mode)
    return found[-1][1] if found else math.nan


def _longest_stay(run: Recorded, of: str, after: float, until: float | None, mode: str) -> float:
    return max((end - begin for begin, end in sticks.stick_intervals(run, of, after, until, mode=mode)), default=0.0)


def _events(run: Recorded, of: str, after: float, until: float | None) -> float:
    begin, end = window(run, after, until)
    return sum(event.element == of and begin <= event.time <= end for event in run.events)


def _releases(run: Recorded, of: str, after: float, until: float | None) -> float:
    return len(sticks.releases(run, of, after, until))


def _distance(run: Recorded, of: str, after: float, until: float | None) -> float:
    begin, end = window(run, after, until)
    return measure.extent(run, of, begin, end).mean * (end - begin)


def _jerk(run: Recorded, of: str, after: float, until: float | None, average: float) -> float:
    begin, end = window(run, after, until)
    if end - begin < 2.0 * average:
        return math.nan
    count = math.ceil(PER_AVERAGE * (end - begin) / average)
    speed = run.at(np.linspace(begin, end, count + 1))[of]
    step, width = (end - begin) / count, PER_AVERAGE
    mean = (speed[width:] - speed[:-width]) / (width * step)
    return float(np.abs(mean[width:] - mean[:-width]).max()) / (width * step)


PER_AVERAGE = 50
"""Samples in the time over which an acceleration is averaged for its jerk."""


# ------------------------------------------------------------------------------------------------------------------------------------- the list
_STICK = (("mode", sticks.STICK),)

severity = Metric(
    "severity", "severity", "speed", "1", measure.severity, "severity", settings=(("definition", "half-range"), ("reference", None))
)
minimum = Metric("minimum", "minimum", "speed", "", _minimum, "lowest")
maximum = Metric("maximum", "maximum", "speed", "", _maximum, "highest")
mean = Metric("mean", "mean", "speed", "", _mean, "mean")
final = Metric("final", "value at the end", "speed", "", _final, "ends", True)
time_in = Metric("stuck", "time in {mode}", "contact", "s", _time_in, "spent", settings=_STICK)
stuck_ratio = Metric("stuck_ratio", "part of the time in stick", "contact", "1", sticks.stuck_ratio, "ratio")
stays = Metric("sticks", "{mode} phases", "contact", "1", _stays, "number", settings=_STICK)
longest_stay = Metric("longest_stick", "longest {mode}", "contact", "s", _longest_stay, settings=_STICK)
last_stay = Metric("last_stick", "end of the last {mode}", "contact", "s", _last_stay, "latest", True, _STICK)
events = Metric("events", "switches", "contact", "1", _events, "switches", True)
settling = Metric("settling", "settling time", "speed", "s", measure.settling, "", True, (("target", None), ("band", 0.02), ("size", None)))
overshoot = Metric("overshoot", "overshoot", "speed", "1", measure.overshoot, "", True, (("target", None), ("size", None)))
standstill = Metric("standstill", "time of standstill", "speed", "s", measure.standstill, settings=(("speed", 0.0),))
releases = Metric("releases", "releases from stick", "contact", "1", _releases)
distance = Metric("distance", "distance", "speed", "", _distance, whole=True, order=1)
jerk = Metric("jerk", "largest jerk", "speed", "", _jerk, order=-2, settings=(("average", 0.05),))
peak = Metric("peak", "largest size", "effort", "", _peak, "peak", True)

METRICS: Mapping[str, Metric] = {
    each.name: each
    for each in (
        severity, minimum, maximum, mean, final, time_in, stuck_ratio, stays, longest_stay, last_stay, events, settling, overshoot, standstill,
        releases, distance, jerk, peak,
    )
}  # fmt: skip
"""Every measure by its name."""


# --------------------------------------------------------------------------------------------------------------------------------- what is asked
def metrics_of(given: Any, argument: str = "metrics") -> dict[str, Metric]:
    """Return {name: metric} of an argument: the name of a metric, a `Metric`, a function of a run, several of these, or a mapping of names
    to these.

    Raises SceneError for what is none of these, for an unknown name, and where nothing is asked or one name twice.
    """
    if not isinstance(given, Mapping):
        several = [given] if isinstance(given, str) or callable(given) else given
        if not isinstance(several, Sequence):
            raise SceneError(f"Argument `{argument}` must be a measure, a function of a run, or several, but it is {given!r}.")
        asked = [_measure_of(each, argument) for each in several]
        names = [each.name for each in asked]
        if len(set(names)) < len(names):
            raise SceneError(
                f"Argument `{argument}` must hold every measure once, or name them in a mapping, but it holds {', '.join(names)}."
            )
        given = dict(zip(names, asked, strict=True))
    if not given:
        raise SceneError(f"Argument `{argument}` must hold at least one measure, but it is empty.")
    return {str(name): _measure_of(each, argument) for name, each in given.items()}


def _measure_of(given: Any, argument: str) -> Metric:
    if isinstance(given, str):
        if given not in METRICS:
            raise SceneError(f"There is no measure `{given}`: {suggest(given, METRICS)}")
        return METRICS[given]
    if isinstance(given, Metric):
        return given
    if not callable(given):
        raise SceneError(f"Argument `{argument}` must hold names of measures, measures or functions of a run, but one is {given!r}.")
    name = kind_of(given)
    return next((each for each in METRICS.values() if each.function is given), Metric(name, name, "", "1", given))
