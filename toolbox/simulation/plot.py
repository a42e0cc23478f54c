"""Pictures of runs: traces in time, phase planes, comparisons.

Every function draws into `ax` or makes a figure of its own, and returns the axes. Curves pass through every step and are sampled between
steps, because nodes are sparse and a polygon through them would cut the peaks off. Modes are shown twice where there is one contact: as a ribbon above
the panel and as grey bands behind the curve. Tones and line styles differ enough to be read without colour.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.legend import Legend
from matplotlib.patches import FancyArrowPatch, Patch, Rectangle
from matplotlib.transforms import ScaledTranslation, blended_transform_factory

from toolbox.arguments import short
from toolbox.errors import SceneError, suggest
from toolbox.figures import curves
from toolbox.figures.style import (
    BAND,
    LINES,
    MANY_EVENTS,
    PAPER,
    TONES,
    WIDTH,
    axis_words,
    drawn_on,
    in_words,
    legend_above,
    line_styles,
    name_axis,
    place_words,
)
from toolbox.files.units import NumberOrText
from toolbox.simulation.samples import Event, scalar, window


class Pictured(Protocol):
    """Attributes and methods of a run that the figures need: a `Trajectory`, or a run that `Trajectory.load` has read.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> run = simulate(compose(BlockOnBelt()), "60 s")
    >>> print(len(run.intervals("belt")), "phases of the contact, speed in", run.unit("block.speed"))
    12 phases of the contact, speed in m/s
    """

    time: np.ndarray
    end: float

    @property
    def events(self) -> list[Event]:
        """Every switch of every element, in order of time."""

    @property
    def contacts(self) -> list[str]:
        """Names of the elements with friction."""

    @property
    def main_signals(self) -> list[str]:
        """Names of the most important signals, which a plot shows by default."""

    @property
    def signal_limits(self) -> Mapping[str, tuple[float | None, float | None]]:
        """{signal: (lowest, highest)}: physical limits that drives and controllers enforce. None means no limit."""

    @property
    def display_units(self) -> Mapping[str, str]:
        """{SI unit: unit that was typed}: the units of figures."""

    @property
    def every_step(self) -> Any:
        """The run with every step recorded."""

    @property
    def modes(self) -> dict[str, np.ndarray]:
        """{element: mode at each recorded time, shape (nt,)}."""

    @property
    def names(self) -> list[str]:
        """Names of all signals."""

    def __getitem__(self, name: str) -> Any: ...

    def unit(self, name: str) -> str:
        """Return the unit of a signal.

        Parameters
        ----------
        name
            Name of the signal.
        """

    def intervals(self, element: str) -> list[tuple[float, float, str]]:
        """Return the phases of one element in order, as (begin [s], end [s], name of the mode).

        Parameters
        ----------
        element
            Name of the element, such as "bit".
        """


def traces(run: Pictured, *signals: str, ax: Any = None, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> Any:
    """Draw signals of a run against time.

    A ribbon above the curves shows the modes. Grey bands show stick if the plant has one contact. Thin lines show
    events.

    Parameters
    ----------
    run
        The run.
    signals
        Names of signals. For a vector state give its name to draw all entries, or the name of one entry such as
        "chain.speed.0". By default the main signals of the run: first speeds, then driving and resisting forces or
        torques.
    ax
        Axes to draw into. By default a new figure with one panel per unit.
    after, until
        Begin and end of the window [s]. By default the whole run.

    Returns
    -------
    axes
        `ax`, or an array with one entry per panel.

    Raises
    ------
    SceneError
        If a signal is unknown, signals of several units share one `ax`, or the window lies outside the run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, plot, simulate
    >>> run = simulate(compose(BlockOnBelt()), "60 s")
    >>> axes = plot.traces(run, "block.speed", "belt.force")
    >>> print(len(axes), "panels")
    2 panels
    """
    begin, end = window(run, after, until)
    names = list(signals) or run.main_signals
    units: dict[str, list[str]] = {}
    for name in names:
        units.setdefault(run.unit(name), []).append(name)
    if ax is not None and len(units) > 1:
        raise SceneError(
            f"Argument `ax` must take signals of one unit, but these are in {', '.join(units)}: leave `ax` out for one panel per unit."
        )
    samples = curves.sampled(run, begin, end)
    columns = samples.columns(names)
    elements = _shown_elements(run)
    contacts, looks = run.contacts, curves.part_colours(run)
    with plt.rc_context(PAPER):
        panels = [ax] if ax is not None else stacked_panels(len(units), 1.75 if len(units) > 1 else 2.3, 0.15 * len(elements))
        for panel, (unit, group) in zip(panels, units.items(), strict=True):
            shown = {name: columns[name] for name in group}
            lines = curves.draw_signals(panel, samples.time, shown, looks)
            panel.set_xlim(begin, end)
            curves.scale_robustly(panel, [(samples.time, values) for values in shown.values() if values.ndim == 1], unit, run.display_units)
            curves.draw_limits(panel, run.signal_limits, group, looks)
            name_axis(panel.yaxis, axis_words(group, unit), unit, run.display_units)
            top = panel is panels[0]
            if len(contacts) == 1:
                _bands(panel, run, contacts[0], begin, end)
            _event_lines(panel, run, begin, end, [name for name in elements if len(contacts) != 1 or name != contacts[0]])
            height = _ribbon(panel, {in_words(name): (run, name) for name in elements}, begin, end) if top else 0.0
            if lines > 1:
                legend_above(panel, height)
        return _over_time(panels, ax)


def phase_plane(
    run: Pictured,
    x_signal: str,
    y_signal: str,
    element: str | None = None,
    ax: Any = None,
    *,
    after: NumberOrText = 0.0,
    until: NumberOrText | None = None,
) -> Any:
    """Draw one signal of a run against another.

    The line is thick while `element` sticks, a ring marks the start, and arrows show the direction.

    Parameters
    ----------
    run
        The run.
    x_signal, y_signal
        Names of two scalar signals.
    element
        Name of the contact whose stick phases are thick. By default the first contact of the plant, if it has one.
    ax
        Axes to draw into. By default a new figure.
    after, until
        Begin and end of the window [s]. By default the whole run.

    Returns
    -------
    axes
        The axes.

    Raises
    ------
    SceneError
        If a signal is unknown or a vector, the element is unknown, or the window lies outside the run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, plot, simulate
    >>> run = simulate(compose(BlockOnBelt()), "60 s")
    >>> ax = plot.phase_plane(run, "block.position", "block.speed")
    >>> print(ax.get_xlabel(), "from", ax.get_xlim()[0].round(1))
    block position [m] from -0.6
    """
    begin, end = window(run, after, until)
    names = list(run.modes)
    if element is None and names:
        element = names[0]
    if element is not None and element not in names:
        raise SceneError(f"There is no element `{element}`: {suggest(element, names)}")
    samples = curves.sampled(run, begin, end)
    x, y = scalar(samples, x_signal), scalar(samples, y_signal)
    sticks = samples.mode[:, names.index(element)] == 0 if element is not None else np.zeros(x.size, bool)
    with drawn_on(ax, height=3.9, width=4.6) as ax:
        # a segment belongs to a mode when both of its ends do, so that the point of release is drawn in both
        points = np.stack([x, y], axis=1)
        both = sticks[:-1] & sticks[1:]
        color = curves.part_colours(run).get(y_signal.partition(".")[0], LINES[0])["color"]
        ax.add_collection(LineCollection(_stretches(points, ~both), colors=color, linewidths=1.0, capstyle="round", joinstyle="round"))
        if both.any():
            ax.add_collection(
                LineCollection(_stretches(points, both), colors="black", linewidths=3.4, capstyle="butt", joinstyle="round", zorder=3)
            )
            ax.plot([], [], color=color, linewidth=1.0, label="slip")
            ax.plot([], [], color="black", linewidth=3.4, label=f"stick ({in_words(str(element))})")
            ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, borderaxespad=0.2, handlelength=1.6)
        _arrows(ax, x, y, ~both, color)
        ax.plot(x[0], y[0], marker="o", markersize=5, markerfacecolor="white", markeredgecolor=color, zorder=4)
        ax.autoscale_view()
        ax.margins(0.06)
        name_axis(ax.xaxis, place_words(x_signal), run.unit(x_signal), run.display_units)
        name_axis(ax.yaxis, place_words(y_signal), run.unit(y_signal), run.display_units)
    return ax


def _stretches(points: np.ndarray, chosen: np.ndarray) -> list[np.ndarray]:
    """The chosen of the segments between points, those that follow each other as one curve: short pieces would leave gaps, and fill a file."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(int))).reshape(-1, 2)
    size = np.ptp(points, axis=0)
    size[size == 0.0] = 1.0
    return [curves.apart(points[i : j + 1], size) for i, j in edges]


def comparison(
    runs: Mapping[str, Pictured],
    signal: str,
    element: str | None = None,
    ax: Any = None,
    *,
    after: NumberOrText = 0.0,
    until: NumberOrText | None = None,
) -> Any:
    """Draw one signal of several runs, one panel per run on common axes, with grey bands of stick.

    If `ax` is given, all curves are drawn into it, as `overlay` does.

    Parameters
    ----------
    runs
        {label: run}.
    signal
        Name of a scalar signal.
    element
        Name of the contact whose stick phases are grey. By default the first contact, if the run has one.
    ax
        Axes for all curves. By default a new figure with one panel per run.
    after, until
        Begin and end of the window [s]. By default from the start to the end of the longest run.

    Returns
    -------
    axes
        `ax`, or an array with one entry per run.

    Raises
    ------
    SceneError
        If no run is given, the signal is unknown or a vector, the element is unknown, or the window lies outside the
        longest run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, plot, simulate
    >>> plant = compose(BlockOnBelt())
    >>> runs = {f"{mass:g} kg": simulate(plant, "60 s", parameters={"block.mass": mass}) for mass in (1.0, 2.0)}
    >>> print(len(plot.comparison(runs, "block.speed")), "panels")
    2 panels
    """
    if ax is not None:
        return overlay(runs, signal, element=element, ax=ax, after=after, until=until)
    longest, begin, end, shown = _together(runs, element, after, until)
    look = curves.part_colours(longest).get(signal.partition(".")[0], LINES[0]) | {"linestyle": "-"}
    with plt.rc_context(PAPER):
        panels = stacked_panels(len(runs), 1.25 if len(runs) > 1 else 2.3, 0.0, sharey=True)
        for panel, (label, run) in zip(panels, runs.items(), strict=True):
            last = min(end, float(run.every_step.time[-1]))
            if last > begin:
                samples = curves.sampled(run, begin, last)
                curves.draw_line(panel, samples.time, scalar(samples, signal), label, look)
            contact = shown[label]
            if contact is not None:
                _bands(panel, run, contact, begin, last)
            _event_lines(panel, run, begin, last, [name for name in _shown_elements(run) if name != contact])
            panel.set_title(label, loc="left", fontsize=9.0, pad=3.0)
            panel.set_xlim(begin, end)
            name_axis(panel.yaxis, in_words(signal), longest.unit(signal), longest.display_units)
        panels[0].figure.supylabel(panels[0].get_ylabel(), fontsize=9.0)
        plt.setp(panels, ylabel="")
        if any(contact is not None for contact in shown.values()):
            band = Patch(facecolor=BAND, edgecolor="0.6", linewidth=0.5, label="stick")
            panels[0].legend(handles=[band], loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, borderaxespad=0.1)
        panels[-1].set_xlabel("time [s]")
    return np.array(panels)


def overlay(
    runs: Mapping[str, Pictured],
    *signals: str,
    element: str | None = None,
    ax: Any = None,
    after: NumberOrText = 0.0,
    until: NumberOrText | None = None,
) -> Any:
    """Draw signals of several runs over one another, with one panel per signal and one colour per run.

    A ribbon of modes stands above the panels for every run.

    Parameters
    ----------
    runs
        {label: run}. A run may be a result of `simulate` or read from a file.
    signals
        Names of scalar signals. By default the signals that a plot of the first run shows and that all runs have,
        without signals that are the same constant in all runs.
    element
        Name of the contact whose modes are shown. By default the first contact, if the run has one.
    ax
        Axes for one signal. By default a new figure with one panel per signal.
    after, until
        Begin and end of the window [s]. By default from the start to the end of the longest run.

    Returns
    -------
    axes
        `ax`, or an array with one entry per signal.

    Raises
    ------
    SceneError
        If no run is given, a signal is unknown or a vector, several signals share one `ax`, the element is unknown,
        or the window lies outside the longest run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, plot, simulate
    >>> plant = compose(BlockOnBelt())
    >>> runs = {f"{mass:g} kg": simulate(plant, "60 s", parameters={"block.mass": mass}) for mass in (1.0, 2.0)}
    >>> print(len(plot.overlay(runs, "block.position", "block.speed")), "panels")
    2 panels
    """
    longest, begin, end, shown = _together(runs, element, after, until)
    names = list(signals)
    if not names:
        known = [name for name in next(iter(runs.values())).main_signals if all(name in run.names for run in runs.values())]
        names = [name for name in known if not _constant(runs.values(), name)] or known
    if not names or (ax is not None and len(names) > 1):
        raise SceneError(
            f"Argument `signals` must name {'one signal for one `ax`' if names else 'a signal that all runs have'}, but it is {signals}."
        )
    with plt.rc_context(PAPER):
        height = 2.3 if len(names) == 1 else 1.75 if len(names) < 4 else 1.3
        panels = [ax] if ax is not None else stacked_panels(len(names), height, 0.15 * len(runs))
        lasting = {
            label: curves.sampled(run, begin, last)
            for label, run in runs.items()
            if (last := min(end, float(run.every_step.time[-1]))) > begin
        }
        styles = dict(zip(runs, line_styles(len(runs)), strict=True))
        for panel, name in zip(panels, names, strict=True):
            drawn = {label: (samples.time, scalar(samples, name)) for label, samples in lasting.items()}
            for label, (time, values) in drawn.items():
                curves.draw_line(panel, time, values, label, styles[label])
            panel.set_xlim(begin, end)
            curves.scale_robustly(panel, list(drawn.values()), longest.unit(name), longest.display_units)
            name_axis(panel.yaxis, in_words(name), longest.unit(name), longest.display_units)
        rows = {label: (run, contact) for (label, run), contact in zip(runs.items(), shown.values(), strict=True) if contact is not None}
        legend_above(panels[0], _ribbon(panels[0], rows, begin, end))
        return _over_time(panels, ax)


def _constant(runs: Iterable[Pictured], name: str) -> bool:
    """Whether a signal is the same number in all runs all the time, but for its last digits."""
    values = np.concatenate([np.ravel(run[name]) for run in runs])
    return bool(np.ptp(values) <= 1e-9 * np.abs(values).max())


def _shown_elements(run: Pictured) -> list[str]:
    """The elements of a run without those that say whose direction the force of a contact with two slips has: an instant of its break-away."""
    return [name for name in run.modes if name.removesuffix(".direction") == name or name.removesuffix(".direction") not in run.modes]


def _over_time(panels: list[Any], ax: Any) -> Any:
    """The finished panels as a plot returns them: with time below the last."""
    panels[-1].set_xlabel("time [s]")
    if len(panels) > 1:
        panels[0].figure.align_ylabels(panels)
    return ax if ax is not None else np.array(panels)


def _together(
    runs: Mapping[str, Pictured], element: str | None, after: NumberOrText, until: NumberOrText | None
) -> tuple[Pictured, float, float, dict[str, str | None]]:
    """(the longest run, begin and end of the window, {label: contact to be shown}); raises SceneError."""
    if not isinstance(runs, Mapping) or not runs:
        raise SceneError(f"Argument `runs` must hold at least one run as {{label: run}}, but it is {short(runs)}.")
    longest = max(runs.values(), key=lambda run: float(run.every_step.time[-1]))
    begin, end = window(longest, after, until)
    shown: dict[str, str | None] = {}
    for label, run in runs.items():
        names = list(run.modes)
        if element is not None and element not in names:
            raise SceneError(f'There is no element `{element}` in the run "{label}": {suggest(element, names)}')
        shown[label] = element or (names[0] if names else None)
    return longest, begin, end, shown


def stacked_panels(rows: int, height: float, extra: float, sharey: bool = False) -> list[Any]:
    """Make a figure with empty panels one above the other, over a common horizontal axis.

    Parameters
    ----------
    rows
        Number of panels, >= 1.
    height
        Height of one panel [inch].
    extra
        Height that is added to the heights of the panels [inch], for title and labels.
    sharey
        Whether the panels share their vertical axis, too, by default False.

    Returns
    -------
    list of axes
        The panels, top first.

    Examples
    --------
    >>> from toolbox import plot
    >>> print(len(plot.stacked_panels(3, height=1.2, extra=0.5)), "panels")
    3 panels
    """
    _, panels = plt.subplots(
        rows, 1, sharex=True, sharey=sharey, squeeze=False, figsize=(WIDTH, 0.75 + height * rows + extra), layout="constrained"
    )
    return list(panels[:, 0])


def _bands(ax: Any, run: Pictured, element: str, begin: float, end: float) -> None:
    """Grey bands behind a panel while an element sticks."""
    pieces = [(max(b, begin), min(e, end)) for b, e, mode in run.intervals(element) if mode == "stick" and b < end and e > begin]
    ax.broken_barh(
        [(b, e - b) for b, e in pieces], (0, 1), transform=ax.get_xaxis_transform(), facecolor=BAND, edgecolor="none", linewidth=0, zorder=0
    )


def _event_lines(ax: Any, run: Pictured, begin: float, end: float, elements: Sequence[str]) -> None:
    """Dotted hairlines at the events of elements, each with dots of its own; fainter where there are many, none where they would only darken the picture.

    Those of the contact whose stick is shaded are the edges of its bands.
    """
    inside = {element: np.unique([e.time for e in run.events if e.element == element and begin <= e.time <= end]) for element in elements}
    count = sum(times.size for times in inside.values())
    strength = 0.7 * min(1.0, MANY_EVENTS / max(count, 1))
    for i, times in enumerate(inside.values() if count <= 10 * MANY_EVENTS else ()):
        if times.size:
            dots = (0, (1 + 2 * (i % 4), 2))
            ax.vlines(
                times, 0, 1, transform=ax.get_xaxis_transform(), colors="0.35", linewidth=0.5, linestyles=[dots], alpha=strength, zorder=0.5
            )


def _ribbon(ax: Any, rows: Mapping[str, tuple[Pictured, str]], begin: float, end: float) -> float:
    """One strip of modes per row above a panel, named at its left, with a legend of the tones; returns its height [inch].

    The strip is measured in inches above the panel, so that it looks the same on a panel of any height.
    """
    if not rows:
        return 0.0
    figure = ax.figure
    many = len(rows) > 12
    pitch, thick = (0.055, 0.055) if many else (0.13, 0.09)
    inches = figure.dpi_scale_trans + ScaledTranslation(0, 1, ax.transAxes)
    in_time, in_panel = (blended_transform_factory(x, inches) for x in (ax.transData, ax.transAxes))
    height = 0.05 + pitch * len(rows)
    frame = Rectangle((0, 0), 1, height, transform=in_panel)
    present: list[str] = []
    for i, (label, (run, element)) in enumerate(rows.items()):
        bottom = height - pitch * (i + 1)
        for mode, tone in TONES.items():
            pieces = [(max(b, begin), min(e, end)) for b, e, word in run.intervals(element) if word == mode and b < end and e > begin]
            if not pieces:
                continue
            if mode not in present:
                present.append(mode)
            dense = len(pieces) > 100  # a hatch or an edge would outweigh the tone
            look = {"facecolor": tone["facecolor"], "edgecolor": "none"} if dense else tone
            bars = ax.broken_barh([(b, e - b) for b, e in pieces], (bottom, thick), transform=in_time, linewidth=0, **look)
            bars.set_clip_path(frame)
        if not many or i in (0, len(rows) - 1):
            place = bottom + thick / 2 if not many else (height - 0.03 if i == 0 else 0.08)
            ax.text(-0.008, place, label, transform=in_panel, ha="right", va="center", fontsize=7.0)
    ax.set_xlim(begin, end)
    handles = [Patch(label=mode, linewidth=0, **TONES[mode]) for mode in TONES if mode in present]
    legend = Legend(
        ax, handles, [str(handle.get_label()) for handle in handles], loc="lower right", bbox_to_anchor=(1.0, height), bbox_transform=in_panel,
        ncols=max(len(handles), 1), frameon=False, borderaxespad=0.1, handlelength=1.6, handleheight=0.8, columnspacing=1.2, fontsize=8.0,
    )  # fmt: skip
    ax.add_artist(legend)
    legend.set_clip_on(False)  # otherwise the layout makes no room for it
    return height


def _arrows(ax: Any, x: np.ndarray, y: np.ndarray, slides: np.ndarray, color: str) -> None:
    """Two arrow heads at thirds of one of the last stretches of slip (the longest of three), measured on paper."""
    width, height = np.ptp(x) or 1.0, np.ptp(y) or 1.0
    step = np.hypot(np.diff(x) / width, np.diff(y) / height)
    length = np.concatenate([[0.0], np.cumsum(step)])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], slides, [False]]).astype(int)))
    stretches = [(length[b], length[e]) for b, e in edges.reshape(-1, 2)][-3:]
    if not stretches:
        return
    begin, end = max(stretches, key=lambda stretch: stretch[1] - stretch[0])
    begin = max(begin, end - 6.0)  # a spiral without stick: its last turns
    for part in (1 / 3, 2 / 3):
        i, j = np.searchsorted(length, begin + part * (end - begin) + np.array([0.0, 0.03]))
        if 0 < i < j < x.size:
            ax.add_patch(
                FancyArrowPatch(
                    (x[i], y[i]),
                    (x[j], y[j]),
                    arrowstyle="-|>",
                    color=color,
                    linewidth=0.0,
                    mutation_scale=16,
                    shrinkA=0,
                    shrinkB=0,
                    zorder=3,
                )
            )
