"""The verdict on a run as one value, and the only place in which it is decided from which amount on a contact sticks and slips.

Four kinds of evidence exist, and each has its function here:

- what the judge found, who carries a run on until it can be told (`of_judged`): the verdict of every verb that can ask the judge;
- the sticks in a window of a run that no judge can tell, because its inputs go on changing (`of_sticks`);
- numbers of the third and the last quarter of many runs side by side (`of_quarters`), which decide the clear ones, and leave the others to the judge;
- the range of the bit speed and the members of an ensemble that estimates it from a log (`stick_slip_begins`, `stick_slip_ends`).

Which sticks count, and whether a contact stands, is decided in `toolbox.measuring.sticks`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.arguments import BoolArray
from toolbox.measuring import metrics
from toolbox.measuring.judge import (
    FAILED,
    NOT_DECIDED,
    SMOOTH,
    STANDS,
    STICKS,
    SWINGS,
    Judged,
)
from toolbox.measuring.metrics import Metric
from toolbox.measuring.sticks import stands

SAME_STICK = 0.9
"""Mean stick of the last quarter, in parts of that of the quarter before, from which on sticks are taken to last; sticks that shorten are judged."""

SAME_SWING = 0.999
"""Severity in the last quarter, in parts of that before, from which on sticks last that take as much of its time: a stick that an edge cuts counts as one, so
that the mean stick of ten differs by a tenth where all are the same."""

FALLS = 0.8
"""Severity in the last quarter, in parts of that before, up to which a swing without a stick is taken to fall."""

KEEPS = 0.95
"""Mean slip of the last quarter, in parts of that before, from which on a run keeps its speed; one that slows down more may stand later."""

DIED_OUT = 10.0
"""Severity in the last quarter, in accuracies of the run, up to which a swing has died out: from a start far away only a run that comes back gets there."""

SEVERE, CALM = 0.85, 0.6
"""Severity from which on a bit that has stuck is evidence of stick-slip, below which it is over: half-range over the mean, 1 where it just stops."""

STUCK_MEMBERS = 0.5
"""Share of the members of an ensemble that must have stuck."""


class Verdict(str):
    """The verdict on a run: a text with its regime, how it is coloured, whether it is a failure, and why.

    Attributes
    ----------
    regime
        One of `toolbox.measuring.judge.REGIMES`, or "failed".
    tone
        "good", "fair" or "bad".
    failed
        Whether the run does not come to smooth running, as far as it can be told.
    reason
        The reason in words.
    """

    regime: str
    tone: str
    failed: bool
    reason: str

    def __new__(cls, word: str, regime: str = NOT_DECIDED, tone: str = "fair", failed: bool = False, reason: str = "") -> Verdict:
        verdict = super().__new__(cls, word)
        verdict.regime, verdict.tone, verdict.failed, verdict.reason = regime, tone, failed, reason
        return verdict

    @property
    def word(self) -> str:
        """The verdict in one or a few words."""
        return str(self)

    @property
    def stick_slip(self) -> bool:
        """Whether the contact sticks at last: again and again, or for good."""
        return self.regime in (STICKS, STANDS)

    def because(self, reason: str) -> Verdict:
        """Return the verdict with another reason."""
        return Verdict(self.word, self.regime, self.tone, self.failed, reason)


FREE = Verdict("free", SMOOTH, "good")
NO_STICK = Verdict("no stick", NOT_DECIDED, "good")
RECOVERED = Verdict("recovered", SMOOTH, "good")
RECOVERED_ONCE = Verdict("recovered after 1 stick", SMOOTH)
SWING = Verdict("swing", SWINGS, failed=True)
NO_MODES = Verdict("no modes")
STANDS_AT_ONCE = Verdict("stands at once")
DOES_NOT_STAND = Verdict("does not stand", failed=True)
STICK_SLIP = Verdict("stick-slip", STICKS, "bad", True)
STICK_SLIP_LATER = Verdict("stick-slip later", STICKS, "bad", True)
STICKS_AT_THE_END = Verdict("sticks at the end", STICKS, "bad", True)
STICKS_IN_WINDOW = Verdict("sticks in the window", STICKS, "bad", True)
STUCK = Verdict("stuck", STANDS, "bad", True)
STUCK_LATER = Verdict("stuck later", STANDS, "bad", True)
RUN_FAILED = Verdict("failed", FAILED, "bad", True)
UNDECIDED = Verdict("not decided", failed=True)


def of_judged(judged: Judged, count: int) -> Verdict:
    """Return the verdict on a run that the judge has decided.

    "free", "stick-slip", "swing" and "stuck" for its regime at last; "recovered after 1 stick" and "recovered" if it is free after one stick or several;
    "stick-slip" also if sticks go on and never repeat: whether a chaotic motion seems to repeat depends on the last bits of a processor. "stick-slip later"
    and "stuck later" if sticks begin only after the time that was looked at. If nothing decides, the time constant is told with which a small disturbance of
    smooth running grows; "no stick" if this growth is not known either, as under a controller that chatters, and nothing has stuck.

    Parameters
    ----------
    judged
        What the judge found.
    count
        Number of sticks in the time that was looked at, in which the run is as it is.
    """
    why = reason_of(judged)
    if judged.regime == SMOOTH:
        return {0: FREE, 1: RECOVERED_ONCE}.get(count, RECOVERED).because(why)
    if judged.regime in (STICKS, STANDS):
        now, later = (STICK_SLIP, STICK_SLIP_LATER) if judged.regime == STICKS else (STUCK, STUCK_LATER)
        return now.because(why) if count else later.because(f"no stick in the time that was looked at; carried on, {why}")
    if judged.regime == SWINGS:
        return SWING.because(why)
    if judged.regime == NOT_DECIDED:
        if judged.sticks:
            return STICK_SLIP.because(why)
        if judged.rate > 0:
            return growing(judged.rate, why)
        return UNDECIDED.because(why) if count or not math.isnan(judged.rate) else NO_STICK.because(why)
    return Verdict(judged.regime, judged.regime, failed=True)


def growth_in_words(rate: float) -> str:
    """Return how a small disturbance that goes as exp(rate t) goes on; "-" if the rate [1/s] is not known or zero."""
    return f"{'grows' if rate > 0 else 'dies'} in {1 / abs(rate):.3g} s" if rate and math.isfinite(rate) else "-"


def growing(rate: float, reason: str) -> Verdict:
    """Return the verdict on a run if only the growth of a small disturbance of smooth running is known, with its rate [1/s]."""
    return Verdict(growth_in_words(rate), failed=True, reason=reason)


def reason_of(judged: Judged) -> str:
    """Return the reason of a verdict of the judge, in words."""
    if judged.regime == SMOOTH:
        return f"a small disturbance {growth_in_words(judged.rate)}" if judged.rate < 0 else "the deviation from smooth running falls"
    if judged.regime == STICKS:
        return f"the same stick comes back every {judged.interval:.3g} s" if math.isfinite(judged.interval) else "sticks come back"
    if judged.regime == STANDS:
        return "the contact stands, with forces that rest or come and go by the same"
    if judged.regime == SWINGS:
        return "the same swing comes back without a stick"
    if judged.regime == NOT_DECIDED and judged.sticks:
        return "sticks go on and never repeat"
    grows = f": a small disturbance of smooth running {growth_in_words(judged.rate)}" if judged.rate > 0 else ""
    return f"nothing decides before the run is given up{grows}"


def of_sticks(intervals: Sequence[tuple[float, float]], after: float, end: float) -> Verdict:
    """Return the verdict on a run that no judge can tell, by its sticks.

    "free" for none; "stuck" if the last one goes on at the end and fills more than half of the time; "stick-slip" for two or more; for a single shorter one
    "recovered after 1 stick", or "sticks at the end" if it goes on there.

    Parameters
    ----------
    intervals
        (begin, end) of the sticks [s], in order.
    after, end
        Begin and end of the time that is looked at [s].
    """
    if not intervals:
        return FREE.because(f"no stick from {after:g} s to {end:g} s")
    begin, last = intervals[-1]
    total = sum(until - since for since, until in intervals)
    why = f"{len(intervals)} stick(s) of {total:.3g} s in all from {after:g} s to {end:g} s"
    if last >= end and last - begin > 0.5 * (end - after):
        return STUCK.because(why)
    if len(intervals) > 1:
        return STICK_SLIP.because(why)
    return (STICKS_AT_THE_END if last >= end else RECOVERED_ONCE).because(why)


def quarters(element: str, signal: str, begin: float, end: float) -> dict[str, Metric]:
    """Return the metrics by which `of_quarters` decides runs from `begin` to `end` [s]: sticks, time in stick, severity and mean slip of two quarters."""
    edges = [begin + part * (end - begin) for part in (0.5, 0.75, 1.0)]
    asked = {}
    for k, (after, until) in enumerate(itertools.pairwise(edges)):
        asked[f"sticks_{k}"] = metrics.stays(element, after, until)
        asked[f"stuck_{k}"] = metrics.time_in(element, after, until)
        asked[f"severity_{k}"] = metrics.severity(signal, after, until)
        asked[f"mean_{k}"] = metrics.mean(f"{element}.slip", after, until)
    return asked


def of_quarters(found: Mapping[str, Any], quarter: float, accuracy: float) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Return which of many runs clearly fall towards smooth running, which stick and slip, and which stand; all others are left to the judge.

    Parameters
    ----------
    found
        {name: values} of the metrics of `quarters`, shape (runs,) each.
    quarter
        Length of a quarter [s].
    accuracy
        Accuracy of the runs.
    """
    count = [found[f"sticks_{k}"] for k in range(2)]
    stuck = [found[f"stuck_{k}"] for k in range(2)]
    severity = [found[f"severity_{k}"] for k in range(2)]
    mean = [np.abs(found[f"mean_{k}"]) for k in range(2)]
    with np.errstate(invalid="ignore", divide="ignore"):
        standing = stands(stuck[0] / quarter) & stands(stuck[1] / quarter)
        last = stuck[1] / count[1] >= SAME_STICK * stuck[0] / count[0]
        last |= (stuck[1] >= SAME_STICK * stuck[0]) & (severity[1] >= SAME_SWING * severity[0])
        slipping = (np.minimum(*count) >= 2) & last & ~standing
        falling = (np.maximum(*count) == 0) & (severity[1] <= np.maximum(FALLS * severity[0], DIED_OUT * accuracy))
        falling &= mean[1] >= KEEPS * mean[0]
    return falling, slipping, standing


def stick_slip_begins(severity: float, probability: float) -> bool:
    """Return whether an estimated severity, and the share of an ensemble that has stuck, begin stick-slip."""
    return severity >= SEVERE and probability >= STUCK_MEMBERS


def stick_slip_ends(severity: float) -> bool:
    """Return whether an estimated severity ends stick-slip; nan does not."""
    return severity < CALM
