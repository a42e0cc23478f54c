"""Signals measured on steps that samples cut short: what `toolbox.measuring.metrics` reads off a step, in lanes.

A signal is the quintic with its values, slopes and curvatures at both ends of a step. Where that is far from the cubic with values and slopes alone, the
step was too long for what the signal does in it, and is refused. A signal that is constant but for jumps, such as a flag, has no slope anywhere: a step that
holds a jump is refused until it is too short to matter in the mean.
"""

from __future__ import annotations

import casadi as ca

from toolbox.lanes.extrema import add_step, so_far, steps_inside
from toolbox.lanes.vectors import Truth, Value, called, largest, smallest, when_any, where_any

SHORTEST = 2.0**-12
"""Part of the longest step below which no step is refused for a signal: its lane is doubtful then."""
JUMP = 0.01
"""How closely a jump is placed, in parts of the tolerance of a signal times the duration: hundreds of them still do not matter in a mean."""


def measure_quintics(
    signals: ca.Function,
    ends: tuple[tuple[Value, list[Value]], tuple[Value, list[Value]]],
    others: list[list[Value]],
    moves: Truth,
    windows: list[tuple[Value, Value]],
    rows: dict[str, int],
    numbers: dict[str, Value],
) -> Truth:
    """Add a step to the extrema and integrals in the rows `measured` of the moving lanes. Return the lanes in which the step was too long
    for this measurement.

    signals: (t, x, p, m) -> values, slopes, curvatures;  ends: (t, x) where the step begins and ends;  others: p and m during the step. A step belongs to
    the windows (after, until) in which it begins.
    """
    (t, _), (t_end, _) = ends
    body = t.body
    count = signals.numel_out(0) // 3
    jumps = _without_slope(signals, count)
    h = t_end - t
    inside, somewhere = steps_inside(windows, t, moves)

    def measured() -> tuple[Truth]:
        own = signals.numel_in(1)
        left, right = (called(signals, at, state[:own], *others) for at, state in ends)
        tolerance = smallest(10.0 * numbers["rtol"], 1e-5)
        places = [[rows["measured"] + 3 * (q * len(windows) + w) for w in range(len(windows))] for q in range(count)]
        before = [[so_far(body, place) for place in of_signal] for of_signal in places]
        misfit = moves & (t < t)
        doubtful = misfit
        pieces = []
        for q in range(count):
            (f0, d0, c0), (f1, d1, c1) = ([side[q], h * side[count + q], h * h * side[2 * count + q]] for side in (left, right))
            rise = f1 - f0
            off = abs(c0 - (6.0 * rise - 4.0 * d0 - 2.0 * d1)) + abs(c1 - (-6.0 * rise + 2.0 * d0 + 4.0 * d1))
            size = largest(abs(f0), abs(f1))
            for lowest, highest, _ in before[q]:
                size = (lowest <= highest).choose(largest(size, largest(abs(lowest), abs(highest))), size)
            far = ~(0.0173 * off <= tolerance * size)
            if jumps[q]:
                misfit |= far & (h > JUMP * tolerance * numbers["end"])
            else:
                misfit |= far & (off < 1e300) & (h > SHORTEST * numbers["longest"])
                doubtful |= far
            pieces.append((f0, d0, c0, f1, d1, c1))
        misfit &= somewhere
        sound = [each & ~misfit for each in inside]
        for piece, of_signal, earlier in zip(pieces, places, before, strict=True):
            f0, d0, c0, f1, d1, c1 = piece
            integral = h * (0.5 * (f0 + f1) + 0.1 * (d0 - d1) + (c0 + c1) * (1 / 120.0))
            for within, place, old in zip(sound, of_signal, earlier, strict=True):
                add_step(within, place, old, smallest(f0, f1), largest(f0, f1), integral)
            for which, sign in ((0, -1.0), (1, 1.0)):
                _raise_to_peak(tuple(sign * value for value in piece), sign, sound, [place + which for place in of_signal])
        doubt = Value(body, body.load("%lanes", rows["doubt"]))
        body.store((somewhere & doubtful & ~misfit).choose(1.0, doubt).name, "%lanes", rows["doubt"])
        return (misfit,)

    (too_long,) = where_any(somewhere, measured)
    return too_long


def _without_slope(signals: ca.Function, count: int) -> list[bool]:
    """Which of the signals are constant but for jumps: slopes and curvatures are zero whatever they depend on."""
    found = signals(*signals.sx_in())
    return [bool(found[count + q].is_zero() and found[2 * count + q].is_zero()) for q in range(count)]


def _raise_to_peak(piece: tuple[Value, ...], sign: float, inside: list[Truth], places: list[int]) -> None:
    """Where a quintic may rise above the extrema so far (times sign) between its ends, write its highest value to the rows at `places`."""
    f0, d0, c0, f1, d1, c1 = piece
    body = f0.body
    bernstein = (f0, f0 + 0.2 * d0, f0 + 0.4 * d0 + 0.05 * c0, f1 - 0.4 * d1 + 0.05 * c1, f1 - 0.2 * d1, f1)
    hull = bernstein[1]
    for value in bernstein[2:5]:
        hull = largest(value, hull)
    best = [sign * Value(body, body.load("%lanes", place)) for place in places]
    may = inside[0] & (hull > best[0])
    for within, highest in zip(inside[1:], best[1:], strict=True):
        may |= within & (hull > highest)

    def write() -> None:
        rise = f1 - f0
        a3 = 10.0 * rise - 6.0 * d0 - 4.0 * d1 + 0.5 * c1 - 1.5 * c0
        a4 = -15.0 * rise + 8.0 * d0 + 7.0 * d1 - c1 + 1.5 * c0
        a5 = 6.0 * rise - 3.0 * (d0 + d1) + 0.5 * (c1 - c0)
        a2 = 0.5 * c0

        def value(s: Value) -> Value:
            return f0 + s * (d0 + s * (a2 + s * (a3 + s * (a4 + s * a5))))

        zero = f0 * 0.0
        top, place = zero - 1e308, zero
        for i in range(1, 8):
            at = zero + i / 8
            here = value(at)
            top, place = (here > top).choose(here, top), (here > top).choose(at, place)
        low, high = place - 0.125, place + 0.125
        for _ in range(4):  # Newton, kept next to the highest of the points
            slope = d0 + place * (2.0 * a2 + place * (3.0 * a3 + place * (4.0 * a4 + place * (5.0 * a5))))
            bend = 2.0 * a2 + place * (6.0 * a3 + place * (12.0 * a4 + place * (20.0 * a5)))
            place = largest(smallest(place - slope / bend, high), low)
            here = value(place)
            top = (here > top).choose(here, top)
        for within, highest, row in zip(inside, best, places, strict=True):  # not of a lane that is here for its neighbours' sake
            body.store((sign * (within & may & (top > highest)).choose(top, highest)).name, "%lanes", row)

    when_any(may, write)
