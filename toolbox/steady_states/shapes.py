"""The modes of a machine at steady running: frequencies, damping, and how every part of it moves in each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray
from toolbox.errors import SceneError
from toolbox.files.printing import columns
from toolbox.files.results import HeadedRows, Result
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.steady_states.equilibria import flow_slopes
from toolbox.steady_states.linear import equilibrium


@dataclass(frozen=True)
class ModeShapes(Result):
    """Vibration modes of a machine, the result of `mode_shapes`, in the order of their frequencies. `found.plot()` draws them.

    Attributes
    ----------
    state
        The state of inertias or masses whose motion the shapes describe, such as `chain.speed`.
    poles
        The pole of each mode with a positive imaginary part [1/s], shape (modes,).
    shapes
        Motion of every entry of the state, shape (modes, entries), real, normalised to the largest value 1: the
        displacements at the instant at which the entry with the largest amplitude is at its maximum.
    depth
        Measured depth of every entry [m]. None if the part has no `depth`.
    display_units
        {SI unit: unit that was typed}.

    Examples
    --------
    >>> from controllers import StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.steady_states import mode_shapes
    >>> found = mode_shapes(closed_loop(compose(wells.NAVARRO_LOPEZ_4, BitRock()), StiffPI(reference="120 rpm")))
    >>> print(found.damping.round(3))
    [0.1   0.122 0.202]
    """

    state: str
    poles: np.ndarray
    shapes: FloatArray
    depth: FloatArray | None = None
    display_units: Mapping[str, str] = field(default_factory=dict)

    @property
    def frequencies(self) -> FloatArray:
        """Frequencies of the modes [Hz]."""
        return self.poles.imag / (2.0 * math.pi)

    @property
    def damping(self) -> FloatArray:
        """Damping ratios [1], negative for an unstable mode."""
        return -self.poles.real / np.abs(self.poles)

    def __str__(self) -> str:
        rows = [("mode", "Hz", "damping ratio", "grows [1/s]")]
        rows += [
            (f"{k + 1}", f"{hertz:.4g}", f"{ratio:.3g}", f"{pole.real:.3g}")
            for k, (hertz, ratio, pole) in enumerate(zip(self.frequencies, self.damping, self.poles, strict=True))
        ]
        return "\n".join([f"Modes of `{self.state}`, {self.shapes.shape[1]} entries", *columns(rows)])

    __repr__ = __str__

    def _table(self) -> HeadedRows:
        """One row per mode: frequency, growth, shape."""
        heads = ["frequency [Hz]", "growth [1/s]", *(f"{self.state}.{i}" for i in range(self.shapes.shape[1]))]
        return heads, np.column_stack([self.frequencies, self.poles.real, self.shapes]).tolist()

    def plot(self, most: int = 5, ax: Any = None) -> Any:
        """Draw the modes of the lowest frequencies over depth, or over the entries of the state if the depth is not known. Return the axes.

        Parameters
        ----------
        most
            Largest number of modes that are drawn, by default 5.
        ax
            Axes to draw into. By default a new figure.
        """
        from toolbox.figures.style import LINES, WIDTH, drawn_on, in_words, name_axis

        count = self.shapes.shape[1]
        place = np.arange(1.0, count + 1.0) if self.depth is None else self.depth
        with drawn_on(ax, height=3.8, width=0.75 * WIDTH) as ax:
            for k, (shape, hertz, ratio) in enumerate(zip(self.shapes[:most], self.frequencies, self.damping, strict=False)):
                mark = {"marker": "o", "markersize": 3.5} if count <= 30 else {}
                ax.plot(shape, place, label=f"{hertz:.3g} Hz, damping {100 * ratio:.2g} %", **LINES[k % len(LINES)], **mark)
            ax.axvline(0.0, color="0.7", linewidth=0.7, zorder=0)
            margin = 0.3 if self.depth is None else 0.015 * np.ptp(place)
            ax.set(xlim=(-1.1, 1.1), ylim=(place[-1] + margin, place[0] - margin), xlabel="motion, the largest 1 [1]")
            if self.depth is None:
                ax.set_ylabel(f"entry of {in_words(self.state)}, from the top")
                ax.yaxis.get_major_locator().set_params(integer=True)
            else:
                name_axis(ax.yaxis, "measured depth", "m", self.display_units)
            ax.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
        return ax


@takes_loop
def mode_shapes(loop: ClosedLoop, state: str | None = None, *, mode: Mapping[str, str] | None = None) -> ModeShapes:
    """Compute poles and shapes of the natural vibrations around smooth running.

    Controllers take part in their continuous form.

    Parameters
    ----------
    loop
        A loop with constant inputs, or a plant.
    state
        Vector of speeds whose shapes are returned, such as "chain.speed". By default the longest vector with a unit
        of speed.
    mode
        {contact: "slip+", "slip-" or "stick"}. With {"bit": "stick"} the result is the vibrations of a string whose
        bit is held. By default contacts slide in the direction in which they slide at the start.

    Returns
    -------
    ModeShapes
        Poles and shapes of all modes that oscillate, in the order of their frequencies.

    Raises
    ------
    SceneError
        If the state is no vector of the plant, or no mode oscillates.
    NoSteadyState
        If there is no smooth running.

    Examples
    --------
    >>> from controllers import StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.steady_states import mode_shapes
    >>> loop = closed_loop(compose(wells.NAVARRO_LOPEZ_4, BitRock()), StiffPI(reference="120 rpm"))
    >>> print((abs(mode_shapes(loop).poles) / 6.2832).round(3), "Hz")
    [0.063 0.166 0.316] Hz
    """
    point = equilibrium(loop, mode=mode)
    plant = point.plant
    vectors = {name: size for name, (_, size, unit) in plant.states.items() if size is not None and unit in ("rad/s", "m/s")}
    if state is None:
        if not vectors:
            raise SceneError("This plant has no vector of speeds, so that there are no shapes to show.")
        state = max(vectors, key=lambda name: vectors[name])
    if state not in vectors:
        raise SceneError(
            f"Argument `state` must name a vector of speeds, {', '.join(vectors) or 'of which there is none'}, but it is {state!r}."
        )
    first = plant.states[state][0]
    values, motions = np.linalg.eig(flow_slopes(point))
    swings = [k for k in np.argsort(np.abs(values)) if values[k].imag > 1e-6 * abs(values[k]) and abs(values[k]) > 1e-9]
    rows = motions[first : first + vectors[state]].T
    swings = [k for k in swings if np.abs(rows[k]).max() > 1e-9]
    if not swings:
        raise SceneError("Nothing swings around this steady state: no pole has an imaginary part.")
    shapes = []
    for k in swings:
        largest = rows[k][np.argmax(np.abs(rows[k]))]
        shapes.append((rows[k] / largest).real)
    depth = f"{state.rpartition('.')[0]}.depth"
    known = depth in plant.parameters and plant.parameters[depth].size == vectors[state]
    return ModeShapes(state, values[swings], np.array(shapes), plant.parameter(depth) if known else None, loop.display_units)
