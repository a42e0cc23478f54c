"""Pictures of a face: which contacts stick, slip and are open, and fields over it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from toolbox.arguments import number, whole
from toolbox.contacts.problem import LEGEND, OPEN, SLIP, STICK
from toolbox.errors import SceneError
from toolbox.figures.style import LINES, PAPER, WIDTH, name_axis
from toolbox.files.atomic import replaced

MARKS: dict[int, dict[str, Any]] = {
    STICK: {"marker": "s", "facecolor": "0.15", "edgecolor": "0.15"},
    SLIP: {"marker": "o", "facecolor": "0.75", "edgecolor": "0.35"},
    OPEN: {"marker": "o", "facecolor": "none", "edgecolor": "0.35"},
}
"""Marks of a contact in each mode, told apart in greyscale."""


def draw_shares(times: np.ndarray, shares: Mapping[str, np.ndarray], ax: Any = None) -> Any:
    """Shares (t,) of the area in each mode over time; those that are never taken are left out."""
    ax = ax or plt.subplots(layout="constrained")[1]
    for (word, share), style in zip(shares.items(), LINES, strict=False):
        if share.any():
            ax.step(times, share, where="post", label=word, **style)
    ax.set(xlabel="time [s]", ylabel="share of the area [1]", ylim=(-0.03, 1.03), xlim=(times[0], times[-1]))
    ax.legend(frameon=False)
    return ax


def draw_forces(times: np.ndarray, forces: Mapping[str, np.ndarray], ax: Any = None) -> Any:
    """Forces (t,) [N] over time; those that are never there are left out."""
    ax = ax or plt.subplots(layout="constrained")[1]
    largest = max(np.abs(force).max() for force in forces.values())
    for (word, force), style in zip(forces.items(), LINES, strict=False):
        if np.abs(force).max() > 1e-6 * largest:
            ax.plot(times, force, label=word, **style)
    name_axis(ax.yaxis, "sum of forces", "N")
    ax.set(xlabel="time [s]", xlim=(times[0], times[-1]))
    ax.legend(frameon=False)
    return ax


def draw_run(run: Any) -> Any:
    """Shares and forces over time above the face of a `ContactRun` at four instants, and fields over it; no face where no places are known."""
    with plt.rc_context(PAPER | {"font.size": 8.0}):
        if run.problem.contact_positions is None:
            _, (top, bottom) = plt.subplots(2, 1, figsize=(WIDTH, 4.2), layout="constrained")
            return np.array([run.plot_share(top), run.plot_forces(bottom)])
        changes = np.append(0, np.cumsum(np.diff(run.contact_modes, axis=0).astype(bool).sum(axis=1)))
        if changes[-1]:
            chosen = np.searchsorted(changes, changes[-1] * np.array([0.2, 0.4, 0.6, 0.8]))
        else:
            chosen = np.linspace(0, len(run.time) - 1, 5).round().astype(int)[1:]
        rows = [["share"] * 4, ["forces"] * 4, ["0", "1", "2", "3"], ["pressure", "traction", "friction_work", "legend"]]
        _, axes = plt.subplot_mosaic(rows, figsize=(WIDTH, 7.2), layout="constrained", height_ratios=[1.2, 0.9, 1.0, 1.0])
        run.plot_share(axes["share"]).set_xlabel("")
        run.plot_forces(axes["forces"])
        marks: dict[str, Any] = {}
        for k, i in enumerate(chosen):
            ax = axes[str(k)]
            for over_time in (axes["share"], axes["forces"]):
                over_time.axvline(run.time[i], color="0.7", linewidth=0.8, zorder=0)
            run.plot_map(run.time[i], "mode", ax)
            marks |= dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
            ax.get_legend().remove()
            ax.set_title(f"{run.time[i]:.4g} s: {run.share()[i]:.0%} stick", fontsize=7)
        for word, i in (("pressure", chosen[-1]), ("traction", chosen[-1]), ("friction_work", -1)):
            run.plot_map(run.time[i], word, axes[word])
            axes[word].set_title(f"{run.time[i]:.4g} s", fontsize=8)
        for word, ax in axes.items():
            if word in ("1", "2", "3", "traction", "friction_work"):
                ax.set(ylabel="")
                ax.tick_params(labelleft=False)
            if word.isdigit():
                ax.set(xlabel="")
        axes["legend"].axis("off")
        axes["legend"].legend(marks.values(), marks.keys(), frameon=False, loc="center")
    return np.array(list(axes.values()))


def draw_modes(places: np.ndarray, modes: np.ndarray, ax: Any = None) -> Any:
    """The modes (c,) of contacts at places (c, 2) [m]: squares stick, full circles slip, empty ones are open."""
    ax = ax or plt.subplots(layout="constrained")[1]
    for mode, look in MARKS.items():
        chosen = modes == mode
        if chosen.any():
            ax.scatter(*(1e3 * places[chosen].T), s=_size(places, ax), label=LEGEND[mode], linewidths=0.8, **look)
    return _framed(ax, places)


def draw_field(places: np.ndarray, values: np.ndarray, label: str, ax: Any = None) -> Any:
    """Values (c,) of contacts at places (c, 2) [m], with a bar of tones."""
    ax = ax or plt.subplots(layout="constrained")[1]
    same = np.ptp(values) <= 1e-6 * np.abs(values).max()  # then the tones would show round-off
    low, high = (min(values[0], 0.0), max(values[0], 0.0)) if same else (values.min(), values.max())
    drawn = ax.scatter(*(1e3 * places.T), c=values, cmap="viridis", vmin=low, vmax=high, marker="s", s=1.6 * _size(places, ax))
    ax.figure.colorbar(drawn, ax=ax, label=label, shrink=0.8, location="bottom")
    return _framed(ax, places)


def write_animation(path: Any, run: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], frames: int, seconds: float) -> None:
    """Write a .gif of a run given by times (t,), places (c, 2), modes (t, c) and the share (t,) that sticks."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    path = Path(path)
    if path.suffix.lower() != ".gif":
        raise SceneError(f"Argument `path` must end in .gif, but it is `{path}`.")
    whole("frames", frames, 2)
    seconds = number("seconds", seconds, "s", above=0)
    times, places, modes, share = run
    shown = np.searchsorted(times, np.linspace(times[0], times[-1], frames)).clip(0, len(times) - 1)
    pictures = []
    with plt.rc_context(PAPER):
        figure, (face, curve) = plt.subplots(1, 2, figsize=(6.4, 3.0), dpi=90, layout="constrained")
        canvas = FigureCanvasAgg(figure)
        curve.plot(times, share, **LINES[0])
        curve.set(xlabel="time [s]", ylabel="share that sticks [1]", ylim=(-0.03, 1.03), xlim=(times[0], times[-1]))
        (point,) = curve.plot([], [], "o", color="black", markersize=5)
        for i in shown:
            face.clear()
            draw_modes(places, modes[i], face)
            face.text(1.0, 1.02, f"{times[i]:.4g} s", transform=face.transAxes, ha="right", va="bottom", fontsize=8)
            point.set_data([times[i]], [share[i]])
            canvas.draw()
            pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy()).quantize(32))
        plt.close(figure)
    with replaced(path) as file:
        pictures[0].save(file, format="GIF", save_all=True, append_images=pictures[1:], duration=round(1000 * seconds / frames), loop=0)


def _across(places: np.ndarray) -> list[int]:
    """How many contacts the face has along x and along y."""
    return [np.unique(np.round(places[:, i], 12)).size for i in (0, 1)]


def _size(places: np.ndarray, ax: Any) -> float:
    """Area of a mark [points^2], so that marks of neighbours do not touch."""
    across = max(_across(places))
    box = ax.get_window_extent().width * 72 / ax.figure.dpi
    return float(np.clip((0.55 * box / across) ** 2, 4.0, 120.0))


def _framed(ax: Any, places: np.ndarray) -> Any:
    sizes = np.ptp(places, axis=0)
    ax.set_aspect("equal" if sizes.all() else "auto")
    for axis, size, place in zip((ax.xaxis, ax.yaxis), sizes, places[0], strict=True):
        if not size:  # contacts on a line
            axis.set_ticks([1e3 * place])
    ax.set(xlabel="x [mm]", ylabel="y [mm]")
    ax.margins(*(max(0.05, 0.6 / max(count - 1, 2)) for count in _across(places)))  # the marks of a coarse face are large, and at its rim
    if ax.get_legend_handles_labels()[1]:
        ax.legend(
            frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1, handletextpad=0.2, columnspacing=0.8
        )
    return ax
