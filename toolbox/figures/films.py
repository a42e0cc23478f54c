"""A run as a film: its rotors turn, its blocks move, in step with the curves."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse, Rectangle

from toolbox.arguments import number
from toolbox.errors import SceneError
from toolbox.figures.style import BAND, LINES, PAPER, WIDTH, in_words, name_axis
from toolbox.files.atomic import replaced
from toolbox.files.units import NumberOrText

RATE = 20
"""Pictures in a second of the film."""

MOST = 4
"""Rotors and blocks that are shown at most."""

SIGNS = {
    "fa fa-minus": "&minus;", "fa fa-fast-backward": "&#9198;", "fa fa-step-backward": "&lsaquo;", "fa fa-play fa-flip-horizontal": "&#9664;",
    "fa fa-pause": "&#9208;", "fa fa-play": "&#9654;", "fa fa-step-forward": "&rsaquo;", "fa fa-fast-forward": "&#9197;", "fa fa-plus": "+",
}  # fmt: skip
"""What stands on the buttons of a page for the icons that matplotlib would fetch from elsewhere."""

HELD = "#c2583b"
"""Colour of what is held."""


def film(run: Any, path: str | Path, seconds: NumberOrText = 8.0) -> Path:
    """Write a run as an animated film.

    Discs turn or blocks move on the left, red while their contact sticks. On the right their curves are drawn, with a
    line that moves with time.

    Parameters
    ----------
    run
        A run with speeds of rotation [rad/s] or positions [m] among its main signals.
    path
        A path that ends with `.gif`, or with `.html`: one page with buttons to stop and to step, which needs no other
        file.
    seconds
        Length of the film [s], at most 60, by default 8. The run is shown slower or faster so that it fits.

    Returns
    -------
    Path
        The same path.

    Raises
    ------
    SceneError
        If nothing turns or moves, or the path ends with something else.

    Examples
    --------
    >>> from PIL import Image
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> from toolbox.figures import film
    >>> path = film(simulate(compose(BlockOnBelt()), "20 s"), "block.gif", seconds=0.2)
    >>> with Image.open(path) as picture:
    ...     print(path.name, picture.n_frames, "frames")
    block.gif 4 frames
    """
    from matplotlib.animation import FuncAnimation
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    path = Path(path)
    if path.suffix not in (".gif", ".html"):
        raise SceneError(f"Argument `path` must end with .gif or .html, but it is {str(path)!r}.")
    frames = max(2, int(RATE * number("seconds", seconds, "s", above=0, at_most=60)))
    turning, moving = _actors(run)
    with plt.rc_context(PAPER | {"animation.embed_limit": 100.0, "savefig.dpi": 90}):
        figure, draw = _stage(run, np.linspace(float(run.time[0]), run.end, frames), turning, moving)
        try:
            if path.suffix == ".html":
                text = FuncAnimation(figure, draw, frames=frames, blit=False).to_jshtml(fps=RATE)
                for icon, sign in SIGNS.items():
                    text = text.replace(f'<i class="{icon}"></i>', sign)
                with replaced(path) as file:
                    file.write(re.sub(r'<link rel="stylesheet"\s+href="https?:[^>]*>', "", text).encode())
                return path
            canvas, pictures = FigureCanvasAgg(figure), []
            for k in range(frames):
                draw(k)
                canvas.draw()
                pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy()).quantize(48))
        finally:
            plt.close(figure)
    with replaced(path) as file:
        pictures[0].save(file, format="GIF", save_all=True, append_images=pictures[1:], duration=1000 // RATE, loop=0)
    return path


def _actors(run: Any) -> tuple[list[str], list[str]]:
    """Names of the speeds of rotors, the first at the top, and of the positions of blocks. Raises SceneError where there are none."""
    known = [name for name in dict.fromkeys([*run.main_signals, *run.names]) if np.ndim(run[name]) == 1]
    main = [name for name in run.main_signals if name in known and not name.endswith((".reference", ".slip"))]
    turning = sorted((name for name in main if run.unit(name) == "rad/s"), key=lambda name: not name.startswith("top"))[:MOST]
    moving = [name for name in known if run.unit(name) == "m" and np.ptp(run[name]) > 0][: MOST - len(turning)]
    if not turning and not moving:
        raise SceneError("There is nothing to film: no speed of rotation and no position is a signal of this run.")
    return turning, moving


def _stage(run: Any, times: np.ndarray, turning: list[str], moving: list[str]) -> tuple[Any, Callable[[int], Any]]:
    """The figure, and the function that puts it to the time of a number."""
    fine = np.linspace(times[0], times[-1], 20 * times.size)
    at = run.at(fine)
    rows = {name: np.asarray(at[name], float) for name in (*turning, *moving)}
    step = np.diff(fine, prepend=fine[0])
    angles = {name: np.cumsum(rows[name] * step) for name in turning}
    figure, (stage, curve) = plt.subplots(1, 2, figsize=(WIDTH, 3.2), dpi=90, layout="constrained", width_ratios=(1.0, 1.6))
    names = turning or moving
    for k, name in enumerate(names):
        curve.plot(fine, rows[name], label=in_words(name), **LINES[k])
    element = run.contacts[0] if run.contacts else None
    sticks = [] if element is None else [(a, b) for a, b, mode in run.intervals(element) if mode == "stick"]
    for begin, end in sticks:
        curve.axvspan(begin, end, color=BAND, zorder=0, linewidth=0)
    line = curve.axvline(times[0], color="black", linewidth=1.0)
    curve.set(xlabel="time [s]", xlim=(times[0], times[-1]))
    curve.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    name_axis(curve.yaxis, "speed" if turning else "position", run.unit(names[0]), run.display_units)
    stage.set(xlim=(-1.5, 3.0), ylim=(-0.6, 1.4 * len(rows)), aspect="equal")
    stage.axis("off")
    pointers, blocks, clock = {}, {}, stage.text(-1.4, 1.4 * len(rows), "", va="top")
    for k, name in enumerate(rows):
        y = 1.4 * (len(rows) - 1 - k)
        stage.text(1.3, y, in_words(name), va="center")
        if name in angles:
            disc = Ellipse((0.0, y), 2.0, 0.8, facecolor="white", edgecolor="black")
            stage.add_patch(disc)
            pointers[name] = disc, stage.plot([], [], color="black", linewidth=2.0)[0], y
        else:
            block = Rectangle((0.0, y - 0.25), 0.5, 0.5, facecolor="white", edgecolor="black")
            stage.add_patch(block)
            stage.plot([-1.4, 1.2], [y - 0.27, y - 0.27], color="0.5", linewidth=1.0)
            blocks[name] = block, (rows[name].min(), max(float(np.ptp(rows[name])), 1e-300))
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # which would place the panels anew in every picture
    part = "" if element is None else element.partition(".")[0]
    holds = next((name for name in rows if name.partition(".")[0] == part), [*rows][-1])

    def draw(k: int) -> Any:
        i = int(np.searchsorted(fine, times[k]).clip(0, fine.size - 1))
        stuck = any(begin <= times[k] <= end for begin, end in sticks)
        for name, (disc, pointer, y) in pointers.items():
            angle = angles[name][i]
            pointer.set_data([0.0, np.sin(angle)], [y, y - 0.4 * np.cos(angle)])
            disc.set_facecolor(HELD if stuck and name == holds else "white")
        for name, (block, (low, span)) in blocks.items():
            block.set_x(-1.4 + 2.0 * (rows[name][i] - low) / span)
            block.set_facecolor(HELD if stuck and name == holds else "white")
        line.set_xdata([times[k], times[k]])
        clock.set_text(f"{times[k]:.4g} s" + (f", {in_words(str(element))} sticks" if stuck else ""))
        return [line]

    return figure, draw
