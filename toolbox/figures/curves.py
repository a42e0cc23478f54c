"""Curves in time: sampled inside the steps, in the colours of their parts, on axes that one peak does not flatten, with the limits of the drive."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.figures.style import LINES, REPEATED, RESOLUTION, in_words, line_styles, reading_of

PEAK = 2.0
"""How many times as high as all but a hundredth of the time a signal may be before its axis leaves the rest out and says how far it goes."""


def sampled(run: Any, begin: float, end: float) -> Any:
    """Signals at both sides of every step and at enough points inside; a jump is two samples at one time."""
    nodes = run.every_step
    long = np.flatnonzero((np.diff(nodes.time) > 0) & (nodes.time[1:] > begin) & (nodes.time[:-1] < end))
    left, right = np.maximum(nodes.time[long], begin), np.minimum(nodes.time[long + 1], end)
    parts = np.maximum(1, np.ceil((right - left) / (end - begin) * RESOLUTION)).astype(int)
    # corners of a cycle need points even where the whole picture is coarse
    parts = np.maximum(parts, 1 if long.size > RESOLUTION else 6)
    row = np.repeat(np.arange(long.size), parts)
    index = np.arange(row.size) - np.repeat(np.cumsum(parts) - parts, parts)
    times = left[row] + (right - left)[row] * (index / parts[row])
    # the end of each step with the modes and held signals of that step: `at` would give what follows
    order = np.argsort(np.concatenate([2 * row, 2 * np.arange(long.size) + 1]), kind="stable")
    return nodes.interpolated(long[np.concatenate([row, np.arange(long.size)])[order]], np.concatenate([times, right])[order])


def thinned(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The curve, or for very many points its smallest and largest value in each of many columns, which looks the same."""
    columns = 2 * RESOLUTION
    if time.size <= 8 * columns:
        return time, values
    edges = np.searchsorted(time, np.linspace(time[0], time[-1], columns + 1)[:-1])
    edges = np.unique(edges)
    centre = np.repeat(time[edges], 2)
    both = np.empty(2 * edges.size)
    both[::2], both[1::2] = np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)
    return centre, both


def apart(points: np.ndarray, size: np.ndarray) -> np.ndarray:
    """A curve (n, 2) in a picture of a size, without the points that lie on the one before them as far as a page shows it."""
    cells = np.rint(points * (2 * RESOLUTION / size))
    moved = np.append(True, (np.diff(cells, axis=0) != 0).any(axis=1))
    moved[-1] = True
    return points[moved]


def part_colours(run: Any) -> dict[str, dict[str, Any]]:
    """{part: look of its curves}, the same in every picture of a run: the parts of the main signals come first."""
    parts = dict.fromkeys(name.partition(".")[0] for name in (*run.main_signals, *run.names))
    return dict(zip(parts, itertools.cycle(LINES), strict=False))


def draw_signals(ax: Any, time: np.ndarray, signals: Mapping[str, np.ndarray], looks: Mapping[str, dict[str, Any]]) -> int:
    """Draw signals {name: values} in the colours of their parts, several of one part with different dashes, and entries of vectors one by one in shades.

    Returns how many curves there are.
    """
    curves: list[tuple[str, np.ndarray, dict[str, Any]]] = []
    seen: dict[str, int] = {}
    for name, values in signals.items():
        part = name.partition(".")[0]
        if values.ndim == 1:
            again = seen[part] = seen.get(part, -1) + 1
            look = dict(looks.get(part, LINES[0]))
            curves.append((in_words(name), values, look | ({"linestyle": REPEATED[again % len(REPEATED)]} if again else {})))
        else:
            shades = line_styles(values.shape[1])
            curves += [(f"{in_words(name)} {i}", values[:, i], shades[i]) for i in range(values.shape[1])]
    many = len(curves) > 8  # then the first and the last name the row of shades between them
    if many:
        looks_of_all = line_styles(len(curves))
        curves = [
            (label, values, look | {"linestyle": "-", "linewidth": 0.9})
            for (label, values, _), look in zip(curves, looks_of_all, strict=True)
        ]
    for i, (label, values, look) in enumerate(curves):
        named = not many or i in (0, len(curves) - 1)
        draw_line(ax, time, values, label if named else "_" + label, look)
    return len(curves)


def draw_line(ax: Any, time: np.ndarray, values: np.ndarray, label: str, style: dict[str, Any]) -> None:
    """Draw a curve against time. The line is thinner for a fast oscillation, so that its strokes do not merge."""
    size = max(float(np.ptp(values)), 1e-6 * float(np.abs(values).max(initial=0.0)), 1e-300)
    rounded = np.rint(values * (100.0 / size))  # what cannot be seen does not count as a swing
    turns = int(np.count_nonzero(np.diff(np.sign(rounded[1:] - rounded[:-1])[rounded[1:] != rounded[:-1]])))
    width = style["linewidth"] * min(1.0, max(0.25, 60 / max(turns, 1)))
    ax.plot(*thinned(time, values), label=label, solid_joinstyle="round", **(style | {"linewidth": width}))


def scale_robustly(ax: Any, curves: Sequence[tuple[np.ndarray, np.ndarray]], unit: str, display_units: Mapping[str, str]) -> None:
    """Scale an axis to the curves (times, values) without a hundredth of their time, if a short peak would flatten the rest. The height of
    the peak is written at the axis."""
    usual = []
    for time, values in curves:
        duration = np.diff(time)
        middle = 0.5 * (values[1:] + values[:-1])
        order = np.argsort(middle, kind="stable")
        share = np.cumsum(duration[order]) / duration.sum()
        usual += [middle[order[min(int(np.searchsorted(share, part)), order.size - 1)]] for part in (0.005, 0.995)]
    low, span = min(usual, default=0.0), max(usual, default=0.0) - min(usual, default=0.0)
    if not span > 0:
        return
    ends, flat = {-1.0: low, 1.0: low + span}, False  # of the axis, downwards and upwards
    for sign, end in ends.items():
        time, values = max(curves, key=lambda curve: float((sign * curve[1]).max()))
        at = int(np.argmax(sign * values))
        beyond = sign * (float(values[at]) - end)
        if beyond <= PEAK * span:
            ends[sign] = end + sign * (max(beyond, 0.0) + 0.05 * span)
            continue
        place = ends[sign] = end + sign * 0.35 * span
        factor, shown = reading_of(unit, abs(place), display_units)
        when, right = float(time[at]), time[at] > 0.5 * (time[0] + time[-1])
        ax.plot(
            [when],
            [place],
            marker="^" if sign > 0 else "v",
            color="0.2",
            markersize=4,
            linestyle="none",
            clip_on=False,
            zorder=4,
            label="_peak",
        )
        ax.annotate(
            f"{values[at] * factor:.3g} {shown}", (when, place), xytext=(-5 if right else 5, -2 * sign), textcoords="offset points", fontsize=7.5,
            color="0.2", ha="right" if right else "left", va="top" if sign > 0 else "bottom",
        )  # fmt: skip
        flat = True
    if flat:
        ax.set_ylim(*ends.values())


def draw_limits(
    ax: Any, limits: Mapping[str, tuple[float | None, float | None]], names: Sequence[str], looks: Mapping[str, dict[str, Any]]
) -> None:
    """Draw the limits of the drive on signals as dotted lines, if they are near enough to be seen. The axis is enlarged for them."""
    bottom, top = ax.get_ylim()
    reach = 0.6 * (top - bottom)
    for name in names:
        for value in limits.get(name, ()):
            if value is not None and bottom - reach <= value <= top + reach:
                room = 0.04 * (top - bottom)
                ax.set_ylim(min(ax.get_ylim()[0], value - room), max(ax.get_ylim()[1], value + room))
                colour = looks.get(name.partition(".")[0], LINES[0])["color"]
                ax.axhline(value, color=colour, linewidth=0.9, linestyle=(0, (1, 2)), zorder=1, label="_limit")
                ax.annotate(
                    "limit", (1.0, value), xycoords=ax.get_yaxis_transform(), xytext=(-2, 1.5), textcoords="offset points", fontsize=7.0, color=colour,
                    ha="right", va="bottom",
                )  # fmt: skip


def nearest_known(values: np.ndarray) -> np.ndarray:
    """Return a grid with every nan replaced by the nearest number; zeros if all are nan."""
    from scipy.ndimage import distance_transform_edt

    unknown = ~np.isfinite(values)
    if unknown.all():
        return np.zeros(values.shape)
    places = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    return values[tuple(places)]
