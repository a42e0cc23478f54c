"""Pictures of onsets and severity maps.

Every function draws into `ax` or makes a figure of its own, and returns the axes; the looks are those of `toolbox.plot`. What is drawn is declared here by
its attributes, so that results can draw themselves and pictures need not know them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from toolbox.errors import SceneError
from toolbox.figures.curves import nearest_known
from toolbox.figures.style import LINES, PAPER, WIDTH, drawn_on, in_words, name_axis, reading_of
from toolbox.measuring.judge import SMOOTH, STICKS, SWINGS
from toolbox.onsets.borders import coordinates, lines_of
from toolbox.onsets.regions import MEANINGS, outlines


def onset_diagram(found: Any, ax: Any = None) -> Any:
    """The bifurcation diagram: the judged speed in smooth running, its highest and lowest value in stick-slip, the borders, the working point.

    Raises SceneError for an onset that an earlier version saved, which kept no speeds.
    """
    if not len(found.steady):
        raise SceneError("This onset was saved by an earlier version, which kept no speeds: find it again for its picture.")
    with drawn_on(ax, height=3.0) as ax:
        for low, high in found.bistable:
            ax.axvspan(low, high, color="0.90", linewidth=0, zorder=0, label="bistable")
        for point in found.hopf:
            ax.axvline(point.value, color="0.2", linewidth=1.0, linestyle=(0, (4, 2)), label="Hopf point", zorder=1)
        for border in found.ends:
            ax.axvline(border.value, color=LINES[1]["color"], linewidth=1.0, linestyle=(0, (1.2, 1.2)), label="stick-slip ends", zorder=1)
        for border in found.stalls:
            ax.axvline(
                border.value, color=LINES[1]["color"], linewidth=1.0, linestyle=(0, (5, 1.5, 1, 1.5)), label="stick-slip stalls", zorder=1
            )
        for border in found.breakaways:
            ax.axvline(border.value, color="0.45", linewidth=1.6, label="break-away", zorder=1)
        _standstill(found, ax)
        if found.values[0] <= found.at <= found.values[-1]:
            ax.plot([found.at], [0.0], marker="^", color="black", markersize=7, linestyle="none", clip_on=False, zorder=4, label="working point",
                    transform=ax.get_xaxis_transform())  # fmt: skip
        _motions(found, ax)
        name_axis(ax.xaxis, in_words(found.parameter), found.unit, found.display_units)
        name_axis(ax.yaxis, in_words(found.signal), found.signal_unit, found.display_units)
        ax.set_xlim(found.values[0], found.values[-1])
        ax.margins(y=0.08)
        handles, labels = ax.get_legend_handles_labels()
        once = dict(zip(labels, handles, strict=True))
        ax.legend(once.values(), once.keys(), loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False, borderaxespad=0.2)
    return ax


def _motions(found: Any, ax: Any) -> None:
    """What runs come to: a line of smooth running, and a band from the lowest to the highest speed of what swings or sticks."""
    inside = sorted([*zip(map(float, found.values), found.sticking, strict=True), *found.cycle_runs], key=lambda each: each[0])
    moving = [(value, judged) for value, judged in inside if judged.regime in (STICKS, SWINGS)]
    edges = [float(found.values[0]), *sorted(border.value for border in (*found.ends, *found.stalls)), float(found.values[-1])]
    for low, high in itertools.pairwise(edges):
        rows = [(value, judged.lowest, judged.highest) for value, judged in moving if low <= value <= high]
        if rows:
            x, lowest, highest = np.array(rows).T
            ax.fill_between(x, lowest, highest, color=LINES[1]["color"], alpha=0.16, linewidth=0, zorder=1.5)
            ax.plot(x, highest, label="stick-slip, highest and lowest", zorder=3, **LINES[1])
            ax.plot(x, lowest, zorder=3, **LINES[1])
    measured = [(value, edge) for value, judged in moving if value in found.values for edge in (judged.lowest, judged.highest)]
    if measured:
        ax.plot(
            *np.array(measured).T,
            "s",
            markersize=4.0,
            markerfacecolor="white",
            markeredgecolor=LINES[1]["color"],
            zorder=3.5,
            clip_on=False,
        )
    _smooth(found, ax)


def _smooth(found: Any, ax: Any) -> None:
    """The line of smooth running, dashed where the least disturbance grows."""
    known = np.isfinite(found.steady)
    if not known.any():
        return
    borders = [border.value for border in found.losses if found.values[known][0] < border.value < found.values[known][-1]]
    x = np.sort(np.concatenate([found.values[known], borders]))
    y = np.interp(x, found.values[known], found.steady[known])
    edges = [x[0], *sorted(borders), x[-1]]
    for low, high in itertools.pairwise(edges):
        there = (x >= low) & (x <= high)
        inner = [each.regime == SMOOTH for value, each in zip(found.values, found.smooth, strict=True) if low < value < high]
        stable = sum(inner) > 0.5 * len(inner) if inner else False
        look = LINES[0] if stable else LINES[0] | {"linestyle": (0, (3, 2)), "linewidth": 1.0}
        ax.plot(x[there], y[there], label="smooth running" if stable else "smooth running, lost when disturbed", zorder=3, **look)


def _standstill(found: Any, ax: Any) -> None:
    """A hatched strip along the axis where standstill lasts."""
    edges = sorted({float(found.values[0]), float(found.values[-1]), *(border.value for border in found.breakaways)})
    for low, high in itertools.pairwise(edges):
        if "standstill" in found.regimes((low + high) / 2):
            ax.axvspan(low, high, ymax=0.05, facecolor="none", edgecolor="0.45", hatch="////", linewidth=0, zorder=2, label="standstill")


def onset_panels(onsets: Mapping[str, Any]) -> Any:
    """One bifurcation diagram per controller, on common axes. Returns the axes; raises SceneError for none."""
    if not onsets:
        raise SceneError("Argument `onsets` must hold at least one onset, but it is empty.")
    with plt.rc_context(PAPER):
        _, axes = plt.subplots(
            len(onsets), 1, sharex=True, sharey=True, squeeze=False, figsize=(WIDTH, 0.9 + 1.7 * len(onsets)), layout="constrained"
        )
        panels, shown = axes[:, 0], dict[str, Any]()
        for i, (ax, (label, found)) in enumerate(zip(panels, onsets.items(), strict=True)):
            onset_diagram(found, ax=ax)
            legend = ax.get_legend()
            shown.update(zip((text.get_text() for text in legend.get_texts()), legend.legend_handles, strict=True))
            legend.remove()
            ax.set_title(label, loc="left", fontsize=9.0)  # inside it would hide a branch that ends there
            if i < len(onsets) - 1:
                ax.set_xlabel("")
        panels[0].figure.legend([*shown.values()], [*shown], loc="outside lower center", ncols=3, frameon=False)
    return panels


TINTS = {
    "free": "#eef6ee", "bistable": "#f0c27b", "smooth or stuck": "#cfd8e6", "stick-slip": "0.8", "swing": "#c3a8dc", "stuck": "#7489ad", "none": "#f3e3d3",
}  # fmt: skip
"""Colours of the regions, apart by their lightness as well; where motion sticks and slips, that of a severity of 0."""
DARKEST = {"bistable": "#7a4a0b", "stick-slip": "0.2"}
"""Colours of the largest severity within these regions."""

BORDERS: dict[str, tuple[str, dict[str, Any]]] = {
    "smooth": ("smooth running is lost", {"colors": "#3f78b5", "linestyles": "-", "linewidths": 2.6}),
    "sticking": ("stick-slip ends", {"colors": LINES[1]["color"], "linestyles": (0, (5, 1.5)), "linewidths": 1.8}),
}


def severity_panels(found: Any, axes: Any = None) -> Any:
    """Severity over two numbers on both branches, with the loss of smooth running and the end of stick-slip. Returns both axes.

    Regions have the colours of the legend and reach up to their borders, not to cells of the grid; where motion sticks and slips they are the darker the more
    severe it is. The legend says what each region means for who runs the machine.
    """
    with drawn_on(axes, 1, 2, height=4.4, width=1.25 * WIDTH, sharex=True, sharey=True) as axes:
        scales = [
            reading_of(unit, float(np.abs(axis).max()), found.display_units) for axis, unit in zip(found.axes, found.units, strict=True)
        ]
        divisors = np.array([1.0 / factor for factor, _ in scales])
        grid = (found.axes[0] / divisors[0], found.axes[1] / divisors[1])
        borders = {name: found.borders[name] / divisors for name in BORDERS}
        regions = found.regions
        lasting = {"smooth": found.smooth.verdict > 0, "sticking": regions["bistable"] | regions["stick-slip"]}
        lasting["smooth"] &= ~regions["none"]
        values = np.concatenate([found.smooth.severity[lasting["smooth"]], found.sticking.severity[lasting["sticking"]]])
        top = float(np.quantile(values[np.isfinite(values)], 0.99)) if np.isfinite(values).any() else 1.0
        shade = None
        titles = {"smooth": "from smooth running", "sticking": "from inside stick-slip"}
        for ax, (name, branch) in zip(axes, (("smooth", found.smooth), ("sticking", found.sticking)), strict=True):
            ax.set_facecolor(TINTS["free"])
            for region in ("smooth or stuck", "stuck", "swing", "none"):
                _filled(ax, grid, regions[region], np.concatenate([borders["sticking"], borders["smooth"]]), TINTS[region], 1.2)
            if name == "smooth":
                _filled(ax, grid, lasting["sticking"], borders["sticking"], TINTS["bistable"])
            # the severity of the nearest point where there is one reaches up to the border
            shown = nearest_known(np.where(lasting[name], branch.severity, np.nan))
            drawn = {"stick-slip": "smooth"} if name == "smooth" else {"bistable": "sticking", "stick-slip": "smooth"}
            for region, edge in drawn.items():  # stick-slip lies on top of what is bistable
                colours = LinearSegmentedColormap.from_list(region, [TINTS[region], DARKEST[region]])
                shade = ax.pcolormesh(*grid, shown.T, cmap=colours, vmin=0.0, vmax=top, shading="gouraud", rasterized=True, zorder=1)
                shade.set_clip_path(_path(outlines(grid, lasting[edge], borders[edge])), ax.transData)
            for border, (label, look) in BORDERS.items():
                ax.add_collection(LineCollection(lines_of(borders[border]), label=label, zorder=3, **look))
            if all(axis[0] <= value <= axis[-1] for axis, value in zip(found.axes, found.nominal_point, strict=True)):
                ax.plot(*(np.array(found.nominal_point) / divisors), marker="^", color="black", markeredgecolor="white", markersize=8, linestyle="none",
                        clip_on=False, zorder=4, label="working point")  # fmt: skip
            ax.set_title(titles[name], loc="left", fontsize=9.0)
            ax.set(xlim=grid[0][[0, -1]], ylim=grid[1][[0, -1]])
            for axis, scale, spaced in zip((ax.xaxis, ax.yaxis), ("xscale", "yscale"), found.logarithmic, strict=True):
                if spaced:
                    ax.set(**{scale: "log"})
                    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                    axis.set_major_formatter("{x:g}")
                    axis.set_minor_locator(NullLocator())
            ax.set_xlabel(f"{in_words(found.names[0])} [{scales[0][1]}]")
        _words(axes[0], grid, regions, found.nominal_point / divisors, found.logarithmic)
        axes[0].set_ylabel(f"{in_words(found.names[1])} [{scales[1][1]}]")
        figure = axes[0].figure
        bar = figure.colorbar(
            shade, ax=list(axes), label=f"severity of {in_words(found.signal)} [1]", boundaries=np.linspace(0.0, top, 129), extend="max"
        )
        bar.set_ticks([tick for tick in MaxNLocator(6).tick_values(0.0, top) if tick <= top])
        patches = [Patch(facecolor=TINTS[name], edgecolor="0.5", linewidth=0.5, label=f"{'smooth' if name == 'free' else name}: {MEANINGS[name]}")
                   for name, where in regions.items() if where.any() or name == "free"]  # fmt: skip
        lines = axes[0].get_legend_handles_labels()[0]
        figure.legend(handles=[*patches, *lines], loc="outside lower center", ncols=2, frameon=False)
    return axes


WRITTEN = 0.03
"""Smallest share of a map that a region needs for its name to be written into it."""


NARROW = 0.09
"""Distance of a name from the border of its region, in parts of the map, below which it stands upright."""

CLEAR = 0.12
"""Distance from the working point, in parts of the map, within which no name is written."""


def _words(
    ax: Any,
    grid: tuple[np.ndarray, np.ndarray],
    regions: Mapping[str, np.ndarray],
    avoided: np.ndarray,
    logarithmic: tuple[bool, bool] = (False, False),
) -> None:
    """The names of the regions where these are widest, so that nobody needs their colours; avoided: a point that stays free of letters."""
    from scipy.ndimage import distance_transform_edt

    even = [np.log(values) if spaced else values for values, spaced in zip(grid, logarithmic, strict=True)]
    with np.errstate(divide="ignore", invalid="ignore"):
        avoided = coordinates(avoided, logarithmic)
    for name, where in regions.items():
        if where.mean() < WRITTEN:
            continue
        depth = distance_transform_edt(np.pad(where, 1, mode="edge"), sampling=(1.0 / len(grid[0]), 1.0 / len(grid[1])))[1:-1, 1:-1]
        places = [(values - values[0]) / (values[-1] - values[0]) for values in even]
        across, up = (np.minimum(place, 1.0 - place) for place in places)  # letters need room to both sides
        depth = np.minimum(depth, np.minimum.outer(across, up))
        if np.isfinite(avoided).all():
            away = [
                place - (value - values[0]) / (values[-1] - values[0]) for place, value, values in zip(places, avoided, even, strict=True)
            ]
            depth = np.where(np.hypot(away[0][:, None], away[1][None, :]) > CLEAR, depth, 0.0)
        if not depth.any():  # a region of a coarse map that lies at its edge
            depth = where.astype(float)
        i, j = np.unravel_index(np.argmax(depth), where.shape)
        word = "smooth" if name == "free" else name
        upright = depth[i, j] < NARROW  # beside a border, or the axis, there is no room for it to lie
        across_it = {0: "left", len(grid[0]) - 1: "right"}.get(int(i), "center")
        up_it = {0: "bottom", len(grid[1]) - 1: "top"}.get(int(j), "center")
        ax.text(grid[0][i], grid[1][j], word, ha=across_it, va=up_it, fontsize=8.5, zorder=5, rotation=90.0 if upright else 0.0,
                bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1.5})  # fmt: skip


def _path(polygons: Sequence[np.ndarray]) -> Path:
    """All polygons as one path; an empty one hides everything."""
    closed = [Path(np.vstack([polygon, polygon[:1]]), closed=True) for polygon in polygons]
    return Path.make_compound_path(*closed) if closed else Path(np.zeros((3, 2)))


def _filled(
    ax: Any, grid: tuple[np.ndarray, np.ndarray], where: np.ndarray, segments: np.ndarray, colour: str, zorder: float = 0.5
) -> None:
    """Fill a region up to its border; of several such the last lies on top. zorder: above 1 for what lies on top of the severity."""
    polygons = outlines(grid, where, segments)
    if polygons:  # without seams between the cells
        ax.add_patch(PathPatch(_path(polygons), facecolor=colour, edgecolor=colour, linewidth=0.3, zorder=zorder))
