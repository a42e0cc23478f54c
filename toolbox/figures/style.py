"""The looks that all pictures share: lines, tones, sizes of type, words for names, and empty panels."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FuncFormatter, MaxNLocator
from matplotlib.transforms import ScaledTranslation, blended_transform_factory

from toolbox.files.unit_systems import reading_of

# loaded here, because loaded inside `rc_context` it would lose its interactive mode when that ends: a notebook would show the first figure only
plt.switch_backend(matplotlib.get_backend())

RESOLUTION = 1600
"""Points along the time axis between which a curve is drawn straight."""

LINES: Sequence[dict[str, Any]] = (
    {"color": "#12355b", "linestyle": "-", "linewidth": 1.5},
    {"color": "#e07a1f", "linestyle": "-", "linewidth": 1.3},
    {"color": "#4f9d8f", "linestyle": (0, (5, 1.5)), "linewidth": 1.4},
    {"color": "#a23b72", "linestyle": (0, (1.2, 1.2)), "linewidth": 1.6},
    {"color": "#6b6b6b", "linestyle": (0, (6, 1.5, 1.2, 1.5)), "linewidth": 1.3},
)

REPEATED: Sequence[Any] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
"""Dashes of the first, second, ... curve of one part in a panel."""

TONES: dict[str, dict[str, Any]] = {
    "stick": {"facecolor": "0.25", "edgecolor": "0.25"},
    "slip": {"facecolor": "0.88", "edgecolor": "0.88"},
    "slip+": {"facecolor": "0.88", "edgecolor": "0.88"},
    "slip-": {"facecolor": "0.66", "edgecolor": "0.95", "hatch": "/////"},
    "closed": {"facecolor": "0.25", "edgecolor": "0.25"},
    "open": {"facecolor": "0.94", "edgecolor": "0.94"},
    "locked": {"facecolor": "0.25", "edgecolor": "0.25"},
    "free": {"facecolor": "0.94", "edgecolor": "0.94"},
    "high": {"facecolor": "0.45", "edgecolor": "0.45"},
    "low": {"facecolor": "0.90", "edgecolor": "0.90"},
    "beyond": {"facecolor": "0.45", "edgecolor": "0.45"},
    "below": {"facecolor": "0.90", "edgecolor": "0.90"},
}
BAND = "0.90"
MANY_EVENTS = 60
"""Events in a picture above which their lines grow fainter; above ten times as many they are left out."""

PAPER = {
    "font.size": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "axes.linewidth": 0.7,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "hatch.linewidth": 0.7,
    "figure.dpi": 110,
    "savefig.dpi": 200,
}
WIDTH = 7.2
"""Width of a figure [inch]: the text width of an A4 report."""


def paper(**kind: Any) -> Any:
    """Return the context in which figures have the fonts and lines of all figures of the toolbox: `with paper(): ...`.

    Parameters
    ----------
    kind
        Other settings of matplotlib (rcParams).

    Returns
    -------
    context manager
        The context.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> from toolbox.authoring import paper
    >>> with paper():
    ...     print(plt.rcParams["savefig.dpi"])
    200.0
    """
    return plt.rc_context(PAPER | kind)


@contextlib.contextmanager
def drawn_on(axes: Any, rows: int = 1, columns: int = 1, *, height: float, width: float = WIDTH, **kind: Any) -> Iterator[Any]:
    """Yield the given axes, or the axes of a new figure, in the context of `paper`.

    Parameters
    ----------
    axes
        Axes to draw into, or None for new ones.
    rows, columns
        How many axes a new figure has.
    height, width
        Its size [inch].
    kind
        Further arguments of `matplotlib.pyplot.subplots`.
    """
    with paper():
        yield plt.subplots(rows, columns, figsize=(width, height), layout="constrained", **kind)[1] if axes is None else axes


def panels(columns: int, height: float, **kind: Any) -> Any:
    """Make a figure as wide as a page with axes side by side, and return the axes.

    Parameters
    ----------
    columns
        Number of axes.
    height
        Height of the figure [inch].
    kind
        Other arguments of `matplotlib.pyplot.subplots`.

    Returns
    -------
    axes, or array of axes
        The axes.

    Examples
    --------
    >>> from toolbox.authoring import panels
    >>> print(len(panels(2, height=2.5)), "axes")
    2 axes
    """
    return plt.subplots(1, columns, figsize=(WIDTH, height), layout="constrained", **kind)[1]


def in_words(name: str) -> str:
    """The name of a signal as a reader says it."""
    return name.replace(".", " ").replace("_", " ")


def place_words(name: str) -> str:
    """The name of a signal as a reader says it, with an entry of a vector by its place: `chain twist, 3rd from the top`."""
    words, _, last = name.rpartition(".")
    if not last.isdigit():
        return in_words(name)
    count = int(last) + 1
    ending = {1: "st", 2: "nd", 3: "rd"}.get(count % 10 if count % 100 not in (11, 12, 13) else 0, "th")
    return f"{in_words(words)}, {count}{ending} from the top"


def axis_words(names: Sequence[str], unit: str) -> str:
    """Return the name of an axis: `bit speed` for a single signal, the shared word for several, such as `speed`."""
    if len(names) == 1:
        return in_words(names[0])
    tails = {name.rpartition(".")[2] for name in names}
    kind = {"N m": "torque", "N": "force", "rad/s": "speed", "m/s": "speed"}.get(unit, "")
    return tails.pop() if len(tails) == 1 and not next(iter(tails)).isdigit() else kind


def name_axis(axis: Any, words: str, unit: str, display_units: Mapping[str, str] | None = None) -> None:
    """Label an axis of matplotlib with a quantity and its unit.

    `reading_of` chooses the unit. The data stay in SI, and the ticks are at round numbers of the chosen unit. If
    several axes are shared, they all have the unit of the axis that was labelled first.

    Parameters
    ----------
    axis
        `ax.xaxis` or `ax.yaxis`.
    words
        Name of the quantity.
    unit
        Its SI unit.
    display_units
        {SI unit: unit in which values are shown}. By default the unit of the system that was chosen.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> from toolbox.authoring import name_axis
    >>> ax = plt.figure().add_subplot()
    >>> name_axis(ax.yaxis, "bit speed", "rad/s", {"rad/s": "rpm"})
    >>> print(ax.get_ylabel(), "over", ax.get_ylim()[1], "rad/s")
    bit speed [rpm] over 1.0 rad/s
    """
    told = getattr(axis.get_major_locator(), "told", None)
    if told is not None and told[0] == unit:
        axis.set_label_text(f"{words} [{told[1]}]".strip())
        return
    factor, shown = reading_of(unit, float(np.abs(axis.get_view_interval()).max()), display_units)
    axis.set_label_text(f"{words} [{shown}]".strip())
    if shown == unit:
        axis.get_major_locator().told = (unit, shown)
        return

    class Places(MaxNLocator):
        """Round numbers of the other unit."""

        told = (unit, shown)

        def tick_values(self, vmin: float, vmax: float) -> Any:
            return np.asarray(super().tick_values(vmin * factor, vmax * factor)) / factor

    axis.set_major_locator(Places(nbins="auto", steps=[1, 2, 2.5, 5, 10]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value * factor:.6g}"))


def line_styles(count: int) -> list[dict[str, Any]]:
    """Return styles for several lines, which differ in colour and in most cases in the pattern of the line.

    Parameters
    ----------
    count
        Number of lines.

    Returns
    -------
    list of dict
        Keyword arguments of `matplotlib.axes.Axes.plot`, one dict per line.

    Examples
    --------
    >>> from toolbox.authoring import line_styles
    >>> print(len(line_styles(12)))
    12
    """
    if count <= len(LINES):
        return list(LINES[:count])
    shades = plt.get_cmap("viridis")(np.linspace(0.0, 0.85, count))
    return [{"color": tuple(shade), "linestyle": LINES[i % len(LINES)]["linestyle"], "linewidth": 1.2} for i, shade in enumerate(shades)]


def legend_above(ax: Any, above: float) -> None:
    """The names of the curves over the left of a panel, above a ribbon of the given height [inch]."""
    place = blended_transform_factory(ax.transAxes, ax.figure.dpi_scale_trans + ScaledTranslation(0, 1, ax.transAxes))
    ax.legend(
        loc="lower left", bbox_to_anchor=(0.0, above), bbox_transform=place, ncols=4, frameon=False, borderaxespad=0.1, handlelength=2.2,
        columnspacing=1.2,
    )  # fmt: skip
    for handle in ax.get_legend().get_lines():
        handle.set_linewidth(max(handle.get_linewidth(), 1.3))  # of a curve that is thin because it swings


def legend_with(ax: Any, *more: Any) -> None:
    """Draw the legend above a panel, with further entries after the existing entries."""
    legend = ax.get_legend()
    handles = [*(legend.legend_handles if legend else []), *more]
    words = [*(text.get_text() for text in (legend.get_texts() if legend else [])), *(str(each.get_label()) for each in more)]
    ax.legend(
        handles,
        words, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(handles), frameon=False, borderaxespad=0.1, handlelength=1.6,
        columnspacing=1.2, fontsize=8.0,
    )  # fmt: skip
