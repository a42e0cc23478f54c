"""How loud a signal swings at which frequency, over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from toolbox.arguments import number
from toolbox.errors import SceneError, suggest
from toolbox.figures.style import drawn_on, in_words
from toolbox.files.units import NumberOrText

SAMPLES, HOPS = 256, 8
"""Samples of a piece of a signal, and the pieces that begin within its length."""

QUIET = -60.0
"""Amplitude [dB of the loudest] below which nothing is shown."""


def spectrogram(run: Any, signal: str | None = None, window: NumberOrText | None = None, ax: Any = None) -> Any:
    """Draw the amplitude of a signal over time and frequency, in decibels below the largest amplitude.

    The signal is cut into pieces. Each piece is weighted by a Hann window, and its mean is removed. A bit that sticks
    and slips shows as a comb of lines, the lowest at the stick-slip frequency. Source: textbook (short-time Fourier
    transform).

    Parameters
    ----------
    run
        A run.
    signal
        Name of a scalar signal. By default the speed at a contact, such as the speed of the bit.
    window
        Length of the pieces [s], or text with a unit. By default a sixth of the run. Two lines cannot be distinguished
        if the difference of their frequencies [Hz] is below two divided by this length.
    ax
        Axes to draw into. By default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. Their first collection holds the decibels.

    Raises
    ------
    SceneError
        If the signal is unknown or is a vector, or the window is longer than half the run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> from toolbox.figures import spectrogram
    >>> ax = spectrogram(simulate(compose(BlockOnBelt()), "120 s"), "block.speed")
    >>> print(len(ax.collections), ax.get_ylabel())
    1 frequency of block speed [Hz]
    """
    from scipy.signal import ShortTimeFFT

    parts = [each.partition(".")[0] for each in run.contacts]
    name = next((each for each in run.main_signals if each.partition(".")[0] in parts), run.main_signals[0]) if signal is None else signal
    if name not in run:
        raise SceneError(f"Argument `signal` must name a signal of the run, but it is {name!r}: {suggest(name, run.names)}")
    begin, length = float(run.time[0]), float(run.end - run.time[0])
    long = length / 6 if window is None else number("window", window, "s", above=0, at_most=length / 2)
    step, hop = long / SAMPLES, SAMPLES // HOPS
    times = begin + step * np.arange(int(length / step))
    values = np.asarray(run.at(times)[name], float)
    if values.ndim != 1:
        raise SceneError(f"Argument `signal` must name one number, but `{name}` is a vector: name an entry, `{name}.0`.")
    transform = ShortTimeFFT(np.hanning(SAMPLES), hop, 1.0 / step, scale_to="magnitude")
    first, last = -(-SAMPLES // 2 // hop), (times.size - SAMPLES // 2) // hop + 1  # pieces that lie within the run
    loud = np.abs(transform.stft_detrend(values, "constant", p0=first, p1=last))
    decibels = 20.0 * np.log10(np.maximum(loud / max(float(loud.max()), 1e-300), 10.0 ** (QUIET / 20.0)))
    seen = np.flatnonzero((decibels > 0.8 * QUIET).any(axis=1))
    rows = min(max(12, int(1.2 * seen[-1])) if seen.size else 12, decibels.shape[0])
    with drawn_on(ax, height=2.8) as ax:
        at = begin + step * hop * np.arange(first, last)
        image = ax.pcolormesh(
            at, transform.f[:rows], decibels[:rows], cmap="cividis", vmin=QUIET, vmax=0.0, shading="nearest", rasterized=True
        )
        ax.figure.colorbar(image, ax=ax, label="power of the loudest [dB]")
        ax.set(xlabel="time [s]", ylabel=f"frequency of {in_words(name)} [Hz]", xlim=(begin, run.end))
    return ax
