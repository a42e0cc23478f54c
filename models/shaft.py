"""Torsional natural frequencies: exact ones of a stepped shaft, and those of a chain of inertias."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from models.sections import Section
from toolbox import SceneError
from toolbox.authoring import whole


def shaft_frequencies(sections: Sequence[Section], count: int, *, top_inertia: float = 0.0, bit_inertia: float = 0.0) -> np.ndarray:
    """Compute the first natural frequencies of a shaft of uniform sections with a rigid inertia at each end.

    The rigid rotation of the whole shaft is not included.

    Method: the vector y = (angle, torque / (zeta w)) rotates by w L / c along a section of length L, wave speed c and
    impedance zeta. At the end of a section, where zeta changes, angle and torque are continuous. The angle of y begins
    at atan(w J_top / zeta) and grows with w. w is a natural frequency if

        angle(w) + atan(w J_bit / zeta) = k pi

    for a whole number k. This condition is equivalent to the transcendental equation of the stepped shaft, but no root
    can be missed, because its left side grows with w. Accuracy: round-off.

    Source: textbook (transfer matrices in the phase form of Pruefer).

    Parameters
    ----------
    sections
        The sections, top first.
    count
        Number of frequencies.
    top_inertia, bit_inertia
        Inertias at the ends [kg m2], by default 0. An infinite inertia is a clamped end.

    Returns
    -------
    array, shape (count,)
        Natural frequencies [Hz].

    Raises
    ------
    SceneError
        If there is no section, the count is not an integer, or an inertia is below 0.

    Examples
    --------
    >>> from models import Section, shaft_frequencies
    >>> pipe = Section(length="2000 m", outer="5 in", inner="4.276 in")
    >>> print(shaft_frequencies([pipe], 3, top_inertia=float("inf")).round(3), "Hz")
    [0.397 1.192 1.986] Hz
    """
    from scipy.optimize import brentq

    if not sections:
        raise SceneError("Argument `sections` must hold at least one section, but it is empty.")
    count = whole("count", count, 0)
    for name, inertia in (("top_inertia", top_inertia), ("bit_inertia", bit_inertia)):
        if not inertia >= 0:
            raise SceneError(f"Argument `{name}` must be >= 0 kg m2, but it is {inertia!r}.")

    def phase(w: float) -> float:
        angle, before = _end(w, top_inertia, sections[0].impedance), sections[0].impedance
        for section in sections:
            turns = round(angle / math.pi)
            rest = angle - turns * math.pi
            angle = turns * math.pi + math.atan2(before * math.sin(rest), section.impedance * math.cos(rest))
            angle += w * section.length / section.wave_speed
            before = section.impedance
        return angle + _end(w, bit_inertia, before)

    held = sum(math.isinf(inertia) for inertia in (top_inertia, bit_inertia))
    first = 2 if held == 2 else 1
    guess = math.pi / sum(section.length / section.wave_speed for section in sections)
    found, low = [], 0.0
    for k in range(first, first + count):
        high = low + guess
        while phase(high) <= k * math.pi:
            high += guess
        low = float(brentq(lambda w, turn=k * math.pi: phase(w) - turn, low, high, xtol=1e-14 * guess, rtol=1e-14))
        found.append(low)
    return np.array(found) / (2 * math.pi)


def _end(w: float, inertia: float, impedance: float) -> float:
    return math.pi / 2 if math.isinf(inertia) else math.atan(w * inertia / impedance)


def chain_frequencies(
    inertia: Sequence[float], stiffness: Sequence[float], *, top_held: bool = False, bit_held: bool = False
) -> np.ndarray:
    """The natural frequencies [Hz] above 0 of a chain of inertias [kg m2] joined by stiffnesses [N m/rad], undamped, in rising order.

    A held end does not turn, so its inertia does not count. Masses [kg] joined by stiffnesses [N/m] have theirs.
    """
    from scipy.linalg import eigh_tridiagonal

    j, k = np.asarray(inertia, float), np.asarray(stiffness, float)
    diagonal = np.concatenate([[0.0], k]) + np.concatenate([k, [0.0]])
    turning = slice(1 if top_held else 0, len(j) - 1 if bit_held else len(j))
    j, diagonal = j[turning], diagonal[turning]
    beside = k[turning.start : turning.stop - 1]
    squares = eigh_tridiagonal(diagonal / j, -beside / np.sqrt(j[:-1] * j[1:]), eigvals_only=True)
    rigid = 0 if top_held or bit_held else 1
    return np.sqrt(np.maximum(squares[rigid:], 0.0)) / (2 * math.pi)
