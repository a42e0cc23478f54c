"""Figures that the commands write beside their tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from toolbox.scenes.scene import Scene
    from toolbox.simulation.trajectory import Trajectory


class Drawn(Protocol):
    """What draws itself: a run, or whatever a search, a measurement or a calibration found."""

    def plot(self) -> Any: ...


DPI = 150
"""Dots per inch of a figure in a file."""


def draw(scene: Scene, title: str, run: Trajectory, traces: Path, phase: Path) -> None:
    """Write the figures of one controller: time traces with the modes, and the phase plane of the judged speed, with what came before in grey."""
    from toolbox.simulation.main_signals import position_of

    plot = _plot()
    until = shown_until(scene, [run])
    _write(plot.traces(run, until=until), title, traces)
    position = position_of(scene.plant(), scene.signal)
    if position is not None:
        after = scene.after if scene.standstill_speed is None and scene.after < run.end else run.begin
        ax = plot.phase_plane(run, position, scene.signal, scene.judged_contact, after=after, until=until)
        if after > run.begin:
            _before(ax, run, position, scene.signal, after)
        _set_point(scene, [ax])
        _write(ax, title, phase)


def shown_until(scene: Scene, runs: Sequence[Trajectory]) -> float | None:
    """Return the time [s] until which runs are drawn: for a stop a little more than until the last one stands; None for whole runs.

    Parameters
    ----------
    scene
        The scene.
    runs
        Its runs.
    """
    if scene.standstill_speed is None:
        return None
    from toolbox.measuring.measure import standstill

    stands = max(standstill(run, scene.signal, scene.standstill_speed) for run in runs)
    end = max(run.end for run in runs)
    return end if stands <= 0.0 else min(1.1 * stands, end)


def draw_comparison(scene: Scene, runs: Mapping[str, Trajectory], path: Path) -> None:
    """Write the figure of the judged signal under every controller; runs: {title of its panel: run}."""
    panels = _plot().comparison(runs, scene.signal, scene.judged_contact, until=shown_until(scene, list(runs.values())))
    _set_point(scene, panels)
    _write(panels, scene.title, path)


def _set_point(scene: Scene, panels: Any) -> None:
    """A dashed line at the set-point of the judged speed, and its name in the legend of the first panel."""
    if not scene.reference:
        return
    for ax in panels:
        line = ax.axhline(scene.reference, color="0.35", linewidth=0.8, linestyle=(0, (5, 3)), zorder=1, label="set-point")
        if ax is panels[0]:
            from toolbox.figures.style import legend_with

            legend_with(ax, line)


def _before(ax: Any, run: Trajectory, x_signal: str, y_signal: str, until: float) -> None:
    """What led into the window of a phase plane, thin and grey behind it."""
    from toolbox.figures import curves
    from toolbox.figures.style import legend_with
    from toolbox.simulation.samples import scalar

    samples = curves.sampled(run, run.begin, until)
    before = ax.plot(
        scalar(samples, x_signal), scalar(samples, y_signal), color="0.75", linewidth=0.7, zorder=1, label=f"before {until:g} s"
    )
    legend_with(ax, *before)


def draw_overlay(runs: Mapping[str, Any], signals: Sequence[str], after: float, until: float | None, path: Path) -> None:
    """Write the figure of runs over one another."""
    _write(_plot().overlay(runs, *signals, after=after, until=until), None, path)


def draw_found(found: Drawn, title: str | None, path: Path) -> None:
    """Write the figure of a run, or of what a search, a map, a measurement or a calibration found; without a title where the figure has one of its own."""
    _plot()
    _write(found.plot(), title, path)


def _plot() -> Any:
    import matplotlib

    matplotlib.use("Agg")  # a study writes files and needs no screen
    from toolbox.simulation import plot

    return plot


def _write(axes: Any, title: str | None, path: Path) -> None:
    import textwrap

    import matplotlib.pyplot as plt
    import numpy as np

    figure = np.ravel(axes)[0].figure
    if title is not None:
        figure.suptitle(
            textwrap.fill(title.replace("`", ""), int(13 * figure.get_figwidth())), fontsize=10.0
        )  # letters of this size that fit into an inch
    figure.set_dpi(DPI)
    if (layout := figure.get_layout_engine()) is not None:  # `savefig` would draw everything once for the layout and once for the file
        layout.execute(figure)
        figure.set_layout_engine(None)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
