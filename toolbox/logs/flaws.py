"""What is wrong with samples of a log: found by rules that a machine which sticks and slips does not meet, told, and marked.

    null        a number that means none (-999.25, -32768, 1e30, those declared), an empty cell, text
    stray       a time a million times farther from the others than they last
    repeated    a time that was there already;  backward: a time before those that were there
    gap         neighbours farther apart than the samples are
    clipped     the largest or smallest value of a channel that else never repeats, several times in a row
    drop-out    a few samples of exactly zero between values that are far from it and alike: no standstill, which lasts, and no level of an input
    reversed    a value whose opposite fits between its neighbours, and which does not itself
    outlier     a few values far from both sides
    below zero  a value below zero of what cannot be, such as the weight of a bit that is off bottom: noise around zero counts as 0, others are left out

Zeros are data unless what surrounds them says otherwise: a machine that stands, a drive that is off and the pause between two pulses are all exactly zero. The
same holds for a channel of levels, such as steps, pulses or a set point: whatever value it has more than once is a level of it.

Why no filter by size alone: speed in stick-slip leaves the mean by many of its deviations, and friction jumps. A jump keeps one side and a slip takes many
samples, which a median over neighbours tells from what stands alone.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field

import numpy as np

from toolbox.errors import SceneError

NULLS = (-999.25, 999.25, -999.0, -9999.0, 9999.0, -9999.25, -99999.0, -32768.0, 32767.0)
"""Numbers by which logs say that there is no value (the NULL of LAS files, and its relatives)."""

HUGE = 1e29
"""Numbers from here on mean none, as 1e30 does."""

FEW = 0.05
"""Rules for single samples mark at most this part of a channel: beyond it the channel is not understood, and stands as it is."""

SATURATED = 0.25
"""A channel that is at its end for longer is a machine at rest, or is no measurement at all: only a part of it can be clipped."""

FAR = 1e6
"""A time that lies farther from all others than so many times their span is none of the log."""

ALONE = 5
"""Samples in a row, at most, that may be outliers or reversed."""

NEAR_ZERO = 0.1
"""Part of the size of a channel that cannot be below zero to which a value there is taken as noise around zero."""

NEARBY = 20
"""Steps on either side of a step whose rate counts for it."""

LEVELS = 0.5
"""Part of the steps of a channel of levels, at least, that are exactly zero."""

STEP = 0.1
"""Usual step of a channel of levels that is not zero, at least, as a fraction of the range of the channel: those of a coarse sensor are smaller."""

EVEN = 0.2
"""Pauses that follow each other as evenly as this, by the deviation of their distances as a fraction of the mean, are those of pulses."""

KINDS = ("null", "clipped", "drop-out", "reversed", "outlier")
"""Kinds of values that are marked."""


@dataclass(frozen=True)
class Flaw:
    """Samples of one channel that are no data.

    Attributes
    ----------
    channel
        The channel, or "time".
    kind
        What is wrong with them.
    times, values
        When, and what stood there, shapes (n,); values of a gap are how long it lasts [s].
    """

    channel: str
    kind: str
    times: np.ndarray = field(repr=False)
    values: np.ndarray = field(repr=False)

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self.times.size)


def is_null(numbers: np.ndarray, nulls: tuple[float, ...] = (), known: tuple[float, ...] = NULLS) -> np.ndarray:
    """Where numbers, in the unit of the log, mean that there is none."""
    marked = ~(np.abs(numbers) < HUGE)  # so is nan
    numbers = np.where(marked, np.nan, numbers)  # a signalling nan would warn
    for null in (*known, *nulls):
        marked |= np.abs(numbers - null) <= 1e-9 * abs(null)
    return marked


def increasing(times: np.ndarray) -> np.ndarray:
    """Places of the most samples whose times increase; those before and after a wrong time stay."""
    places = np.flatnonzero(np.isfinite(times))
    if (np.diff(times[places]) > 0).all():
        return places
    ends: list[float] = []
    last: list[int] = []
    before = np.full(times.size, -1)
    for k in places.tolist():
        at = bisect_left(ends, times[k])
        before[k] = last[at - 1] if at else -1
        if at == len(ends):
            ends.append(float(times[k]))
            last.append(k)
        elif times[k] < ends[at]:
            ends[at], last[at] = float(times[k]), k
    kept, k = [], last[-1] if last else -1
    while k >= 0:
        kept.append(k)
        k = int(before[k])
    return np.array(kept[::-1], int)


def without_strays(times: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Places of increasing times without a few at either end that lie `FAR` times farther away than all others last: numbers that are no times."""
    few = max(1, int(FEW * places.size))
    while places.size > 3:
        kept = times[places]
        widest = int(np.argmax(np.diff(kept))) + 1
        before, after = places[:widest], places[widest:]
        more, less = (before, after) if before.size > after.size else (after, before)
        if less.size > few or kept[widest] - kept[widest - 1] <= FAR * (times[more[-1]] - times[more[0]]):
            break
        places = more
    return places


def spacing(times: np.ndarray) -> tuple[float, float]:
    """(usual interval [s], what neighbours are at most apart without a gap): of even samples less than two intervals."""
    steps = np.diff(times)
    usual = float(np.median(steps))
    if np.mean(np.abs(steps - usual) < 0.3 * usual) > 0.7:
        return usual, 1.75 * usual
    return usual, 10.0 * float(np.quantile(steps, 0.95))


def local_spacing(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the usual interval [s] around each step, and the longest step [s] there without a gap; both have shape (n - 1,).

    A log may change its rate: what counts is the rate before a step or after it, whichever is slower. Where the samples are not even nearby, the spacing of
    the whole log counts.
    """
    steps = np.diff(times)
    usual, longest = spacing(times)
    if steps.size < 2 * NEARBY:
        return np.full(steps.size, usual), np.full(steps.size, longest)
    rows = np.lib.stride_tricks.sliding_window_view(steps, NEARBY)
    middle = np.median(rows, axis=1)
    even = np.mean(np.abs(rows - middle[:, None]) < 0.3 * middle[:, None], axis=1) > 0.7
    rate = np.where(even, middle, 0.0)
    first = np.full(steps.size, np.nan)
    first[NEARBY - 1 :] = rate  # of the steps up to each
    after = np.full(steps.size, np.nan)
    after[: rate.size] = rate  # of the steps from each on
    near = np.fmax(first, after)
    if np.mean(near > 0.0) < 0.95:
        return np.full(steps.size, usual), np.full(steps.size, longest)
    known = near > 0.0
    return np.where(known, near, usual), np.where(known, 1.75 * near, longest)


def marked(values: np.ndarray, kinds: tuple[str, ...] = KINDS) -> dict[str, np.ndarray]:
    """Return {kind: mask} of the flawed samples of a channel with nan for its nulls. A sample has a single kind."""
    found: dict[str, np.ndarray] = {}
    values, levels = values.copy(), of_levels(values)
    kept = np.zeros(values.size, bool)
    for kind, rule in (("clipped", _clipped), ("drop-out", _dropped), ("reversed", _reversed), ("outlier", _outliers)) if kinds else ():
        there = rule(values) if not levels or kind == "clipped" else _only_once(values, rule(values))
        if kind not in kinds:
            kept |= there  # a drop-out that is data is no outlier
            continue
        there &= ~kept
        if there.any() and (kind in ("clipped", "drop-out") or there.mean() <= FEW):
            found[kind] = there
            values[there] = np.nan
    return found


def below_zero(values: np.ndarray, name: str, time: np.ndarray, unit: str) -> tuple[list[Flaw], list[str]]:
    """Mark values below zero in a channel that cannot be there; those as small as noise become 0, others nan.

    Parameters
    ----------
    values
        Values of the channel, shape (n,), which are changed.
    name, time, unit
        Name of the channel, times [s] of its samples, shape (n,), and its unit.

    Returns
    -------
    flaws
        The flaw, or none.
    notes
        What was done, and what the user can do.
    """
    low = values < 0.0
    if not low.any():
        return [], []
    found = Flaw(name, "below zero", time[low], values[low].copy())
    high = float(np.nanquantile(np.abs(values), 0.98))
    far = values < -NEAR_ZERO * high
    lost, down = int(np.count_nonzero(far)), f"down to {found.values.min():.5g} {unit}, first at {found.times[0]:.4g} s"
    if lost > 0.5 * np.count_nonzero(np.isfinite(values)):
        raise SceneError(
            f"Channel `{name}` must be >= 0 {unit}, but it is below in {found.count} of {values.size} samples, {down}: turn its sign in the log, or "
            "subtract the reading of a sensor that was not set to zero."
        )
    values[low] = np.where(far[low], np.nan, 0.0)
    return [found], [
        f"`{name}`: {found.count} samples below zero, {down}: {found.count - lost} taken as noise around 0"
        + (f", {lost} farther below left out" if lost else "")
        + "; set the sensor to zero off bottom, or take a window (--window, in Python `between`) after the bit is on bottom"
    ]


def _groups(mask: np.ndarray) -> list[tuple[int, int]]:
    """(first, one past the last) of each row of neighbours."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _clipped(values: np.ndarray) -> np.ndarray:
    """Three or more of the largest or smallest value in a row, in a channel whose other neighbours differ."""
    out = np.zeros(values.size, bool)
    finite = values[np.isfinite(values)]
    if finite.size < 10:
        return out
    for extreme in (finite.max(), finite.min()):
        at = values == extreme
        if extreme == 0 or np.count_nonzero(at) < 3:
            continue
        steps = np.diff(finite)
        same, typical = steps == 0, 0.5 * float(np.median(np.abs(steps)))
        groups = [(a, b) for a, b in _groups(at) if b - a >= 3 and _met_abruptly(values, a, b, typical)]
        inside = (finite[1:] == extreme) & (finite[:-1] == extreme)
        others = same[~inside]
        if not groups or at.all() or (others.size and others.mean() > 0.02) or others.size < 5:
            continue
        if len(groups) >= 2 or max(b - a for a, b in groups) >= 5:
            out |= at
    return out if out.mean() <= SATURATED else np.zeros(values.size, bool)


def _met_abruptly(values: np.ndarray, first: int, end: int, typical: float) -> bool:
    """Whether a row of equal samples is met at the usual rate, and not by a rounded top that levels off."""
    sides = [abs(values[k] - values[first]) for k in (first - 1, end) if 0 <= k < values.size and np.isfinite(values[k])]
    return bool(sides) and float(np.mean(sides)) > typical


def _span(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    low, high = np.quantile(finite, (0.02, 0.98)) if finite.size else (0.0, 0.0)
    return float(high - low)


def of_levels(values: np.ndarray) -> bool:
    """Return whether a channel moves from level to level, like steps, pulses and set-points: most steps are exactly zero, and the others
    are large."""
    finite = values[np.isfinite(values)]
    steps = np.abs(np.diff(finite))
    if not steps.any():
        return True
    return bool(np.mean(steps == 0.0) >= LEVELS and np.median(steps[steps > 0.0]) >= STEP * np.ptp(finite))


def _only_once(values: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Those of the samples whose value the channel has once: of a channel of levels every other value is a level."""
    known, count = np.unique(values[np.isfinite(values)], return_counts=True)
    there = there.copy()
    there[there] = count[np.searchsorted(known, values[there])] == 1
    return there


def _dropped(values: np.ndarray) -> np.ndarray:
    """A few zeros in a row between values that are far from zero and alike; none where they are many, or follow each other as evenly as pulses."""
    out = np.zeros(values.size, bool)
    good = np.flatnonzero(np.isfinite(values))
    kept = values[good]
    zero = kept == 0.0
    if not zero.any() or zero.all():
        return out
    steps = np.abs(np.diff(kept))[~zero[1:] & ~zero[:-1]]
    typical = float(np.quantile(steps, 0.995)) if steps.size else 0.0
    least = max(3.0 * typical, 0.1 * float(np.median(np.abs(kept[~zero]))))
    dropped = [
        (a, b)
        for a, b in _groups(zero)
        if a > 0 and b < kept.size and b - a <= ALONE
        and min(abs(kept[a - 1]), abs(kept[b])) > least
        and abs(kept[b] - kept[a - 1]) < 0.5 * min(abs(kept[a - 1]), abs(kept[b]))
    ]  # fmt: skip
    apart = np.diff([a for a, _ in dropped])
    if apart.size >= ALONE and np.std(apart) <= EVEN * np.mean(apart):
        return out
    for a, b in dropped:
        out[good[a:b]] = True
    return out if out.mean() <= SATURATED else np.zeros(values.size, bool)


def _between(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """What the neighbours that are not marked say of the marked samples: a straight line between them."""
    if not mask.any():
        return values
    good = np.isfinite(values) & ~mask
    out = values.copy()
    places = np.arange(values.size)
    if good.sum() >= 2:
        out[mask] = np.interp(places[mask], places[good], values[good])
    return out


def _standing_apart(values: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """(where a few samples jump away and back by more than `least`, and what their neighbours say of them)."""
    good = np.flatnonzero(np.isfinite(values))
    kept = values[good]
    away = np.zeros(kept.size, bool)
    jumps = np.diff(kept)
    big = np.flatnonzero(np.abs(jumps) > least)
    for i, first in enumerate(big.tolist()):
        for last in big[i + 1 : i + 1 + ALONE].tolist():
            inside = last - first
            if inside > ALONE:
                break
            before, after = kept[first], kept[last + 1]
            apart = kept[first + 1 : last + 1]
            if (
                jumps[first] * jumps[last] < 0
                and abs(after - before) < 0.5 * min(abs(jumps[first]), abs(jumps[last]))
                and np.all(np.abs(apart - 0.5 * (before + after)) > least)
            ):
                away[first + 1 : last + 1] = True
                break
    out = np.zeros(values.size, bool)
    out[good[away]] = True
    return out, _between(values, out)


def _reversed(values: np.ndarray) -> np.ndarray:
    """Samples that stand apart from their neighbours, and whose opposite does not."""
    away, meant = _standing_apart(values, max(4.0 * _noise(values), 0.05 * float(np.nanmax(np.abs(values), initial=0.0))))
    closeness = np.abs(values + meant)
    return away & (values * meant < 0) & (closeness < 0.25 * np.abs(values - meant))


def _outliers(values: np.ndarray) -> np.ndarray:
    span = _span(values)
    if not span:
        return np.zeros(values.size, bool)
    away, _ = _standing_apart(values, max(8.0 * _noise(values), 0.6 * span))
    return away


def _noise(values: np.ndarray) -> float:
    """Deviation of the samples from the line between their neighbours, by its median."""
    finite = values[np.isfinite(values)]
    second = np.abs(finite[1:-1] - 0.5 * (finite[2:] + finite[:-2]))
    return float(1.4826 * np.median(second)) if second.size else 0.0
