"""The frequency response of a loop that is broken at its commands, drawn as Bode, Nyquist or Nichols diagram."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray, numbers
from toolbox.errors import SceneError
from toolbox.files.results import HeadedRows, Result
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.robustness.disk_margins import frequencies
from toolbox.robustness.margins import Margins, margins


@dataclass(frozen=True)
class FrequencyResponse(Result):
    """Frequency response L(i w) of an open loop, the result of `frequency_response`, with the sign for negative feedback.

    The loop is broken at one command at a time, while the loops of all other commands are closed.

    Attributes
    ----------
    omega
        Frequencies [rad/s], increasing.
    values
        {command: complex L at the frequencies}.
    margins
        The `Margins` of the loop.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> from toolbox.robustness import frequency_response
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> loop = closed_loop(rig, Sampled(SoftTorque(reference="60 rpm"), "10 ms", delay="30 ms"))
    >>> found = frequency_response(loop, omega=[0.5, 1.0, 2.0])
    >>> print(found.omega.round(2), f"disk margin {found.margins.disk_margin:.2f}")
    [0.5 1.  2. ] disk margin 0.38
    """

    omega: FloatArray
    values: Mapping[str, np.ndarray]
    margins: Margins

    def __str__(self) -> str:
        return f"Frequency response from {self.omega[0]:.4g} to {self.omega[-1]:.4g} rad/s, {self.omega.size} frequencies\n{self.margins}"

    def _table(self) -> HeadedRows:
        """One row per frequency: gain and phase of every command."""
        heads = ["frequency [rad/s]", *(f"{word} of {name}" for name in self.values for word in ("gain", "phase [rad]"))]
        columns = [self.omega, *(row for value in self.values.values() for row in (np.abs(value), np.unwrap(np.angle(value))))]
        return heads, np.column_stack(columns).tolist()

    def plot(self, axes: Any = None) -> Any:
        """Draw the response as the Bode diagram of `bode`; `nyquist` and `nichols` are its other views. Returns both axes.

        Parameters
        ----------
        axes
            Two matplotlib axes to draw on. By default None: a new figure.
        """
        return self.bode(axes)

    def bode(self, axes: Any = None) -> Any:
        """Draw gain and phase over frequency, with gain and phase margin; returns both axes.

        Parameters
        ----------
        axes
            Two matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.robustness.response_figures import bode_diagram

        return bode_diagram(self, axes)

    def nyquist(self, ax: Any = None) -> Any:
        """Draw the response in the complex plane, with the disk around -1 that the disk margin keeps free; returns the axes.

        Parameters
        ----------
        ax
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.robustness.response_figures import nyquist_diagram

        return nyquist_diagram(self, ax)

    def nichols(self, ax: Any = None) -> Any:
        """Draw gain over phase, with lines on which the closed loop has the same gain; returns the axes.

        Parameters
        ----------
        ax
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.robustness.response_figures import nichols_diagram

        return nichols_diagram(self, ax)


@takes_loop
def frequency_response(loop: ClosedLoop, omega: Sequence[NumberOrText] | None = None) -> FrequencyResponse:
    """Compute the frequency response of a loop at smooth running, with the loop broken at the commands of its controllers.

    Sampling, hold and delay are taken into account. The response of a sampled controller ends at half its sampling
    frequency.

    Parameters
    ----------
    loop
        A loop with at least one controller and constant inputs.
    omega
        Frequencies [rad/s], or text with a unit of angular speed ("12 rpm"), positive and increasing. By default frequencies over all
        time scales of the loop, with small distances near its poles.

    Returns
    -------
    FrequencyResponse
        The response of every command. It has the figures `plot` or `bode`, `nyquist` and `nichols`.

    Raises
    ------
    SceneError
        If controllers have different periods, an input varies in time, there is no linear loop, or frequencies are
        not positive and increasing.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> from toolbox.robustness import frequency_response
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> loop = closed_loop(rig, Sampled(SoftTorque(reference="60 rpm"), "10 ms", delay="30 ms"))
    >>> found = frequency_response(loop, omega=[0.5, 1.0, 2.0])
    >>> print(abs(found.values["top.torque"]).round(2))
    [3.91 0.75 0.36]
    """
    found = margins(loop, by_simulation=False)
    if found.linear_loop is None:
        raise SceneError(f"There is no linear loop, and so no frequency response: {found.reason}.")
    alone = {name: found.linear_loop.alone(i) for i, name in enumerate(found.linear_loop.actuated_signals)}
    if omega is None:
        w = np.unique(np.concatenate([frequencies(each) for each in alone.values()]))
    else:
        w = np.asarray(numbers("omega", omega, "rad/s"), float)
        if w.size < 2 or w[0] <= 0.0 or (np.diff(w) <= 0.0).any():
            raise SceneError("Argument `omega` must hold at least two positive, increasing frequencies, but it does not.")
        if found.linear_loop.period is not None and w[-1] > np.pi / found.linear_loop.period * (1 + 1e-9):
            raise SceneError(
                f"Argument `omega` must end at half the sampling frequency, {np.pi / found.linear_loop.period:.4g} rad/s, but it ends at {w[-1]:.4g} rad/s."
            )
    return FrequencyResponse(w, {name: each.transfer(w)[:, 0, 0] for name, each in alone.items()}, found)
