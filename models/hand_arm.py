"""The hand and arm that hold a vibrating machine: a chain of masses from the handle to the ground, and the dose of vibration they take.

Form of the chain: ISO 10068 (mechanical impedance of the hand-arm system). Weighting and daily exposure: ISO 5349-1:2001, annex A and section 5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from toolbox import Component, Equations, SceneError, quantity, state
from toolbox.authoring import NumberOrText, entries, number, numbers
from toolbox.modelling import Quantities

BAND = (10.0**0.8, 10.0**3.1)
"""Limits of the band of the hand-arm weighting [Hz]: 6.310 and 1258.9."""

TRANSITION = 100.0 / (2 * math.pi)
"""Frequency [Hz], 15.915, above which the weighting follows velocity instead of acceleration."""

BAND_QUALITY, TRANSITION_QUALITY = math.sqrt(0.5), 0.64


@dataclass(frozen=True)
class HandArm(Component):
    """Hand and arm on a vibrating handle: masses in a row between the handle and the ground, joined by springs and dampers.

        m_i v_i' = f_i - f_(i+1),   f_i = k_i e_i + c_i e_i',   e_i' = v_(i-1) - v_i

    Symbols and their fields: m_i `mass` [kg], k_i `stiffness` [N/m], c_i `damping` [N s/m].

    The masses are i = 1 to n, counted from the handle. v_0 is the speed of the handle, and v_(n+1) = 0 is the ground.
    Speeds are positive from the handle towards the ground. n masses have n + 1 springs and dampers: `stiffness[0]` and
    `damping[0]` are k_1 and c_1, between handle and first mass, and the last entries are k_(n+1) and c_(n+1), between
    last mass and ground. e_i is the compression [m] and f_i the force [N] of spring and damper i, positive in
    compression.

    `attached_to` names the part that the hand holds. With "handle" (no other part):

    - Needs the signal `handle.speed` v_0 [m/s] (default 0).
    - Gives the signals `handle.force` = -f_1 [N], the force of the hand on the handle, and `hand.force` f_1 [N].
    - States: `hand.compression` e (n + 1) [m], `hand.speed` v (n) [m/s].

    With the name of another part, such as "block", the hand needs `block.speed` and gives `block.force`. The mass of
    tissue that moves with the handle belongs to the mass of this other part.

    Range of validity: small vibration in one direction, with a fixed posture and grip. Give your own numbers: the
    defaults (two masses) only have the order of magnitude of a hand and a forearm and have no source.

    Examples
    --------
    >>> from models import HandArm
    >>> from toolbox import compose
    >>> print(compose(HandArm()))
    HybridSystem(HandArm): 5 states (hand.compression, hand.speed); contacts: none; inputs: handle.speed [m/s]
    """

    mass: Quantities = quantity((0.5, 2.0), "kg", "masses, from the handle on", above=0)
    stiffness: Quantities = quantity((50e3, 3e3, 500.0), "N/m", "stiffness before every mass, and of the ground", at_least=0)
    damping: Quantities = quantity((150.0, 60.0, 100.0), "N s/m", "damping before every mass, and of the ground", at_least=0)
    attached_to: str = "handle"

    def check(self):
        n = len(self.mass)
        if n < 1:
            raise SceneError("Argument `hand.mass` must hold at least one mass, but it is empty.")
        for name in ("stiffness", "damping"):
            entries(f"hand.{name}", getattr(self, name), n + 1, ", one more than `hand.mass`")
        if not isinstance(self.attached_to, str) or not self.attached_to.isidentifier() or self.attached_to == "hand":
            raise SceneError(
                f"Argument `hand.attached_to` must be the first word of the signals of what is held, but it is {self.attached_to!r}."
            )

    def equations(self, signal):
        n = len(self.mass)
        compression, speed = state("hand.compression", "m", n + 1), state("hand.speed", "m/s", n)
        held = signal(f"{self.attached_to}.speed", "m/s", default=0.0)
        mass, stiffness, damping = ca.vertcat(*self.mass), ca.vertcat(*self.stiffness), ca.vertcat(*self.damping)
        rate = ca.vertcat(held, speed) - ca.vertcat(speed, 0)
        force = stiffness * compression + damping * rate
        return Equations(
            flow={compression: rate, speed: (force[:-1] - force[1:]) / mass},
            outputs={f"{self.attached_to}.force": (-force[0], "N"), "hand.force": (force[0], "N")},
            stored=ca.dot(mass, speed**2) / 2 + ca.dot(stiffness, compression**2) / 2,
            losses={"damping": ca.dot(damping, rate**2)},
            supplies={"handle": force[0] * held},
        )

    def impedance(self, frequency: ArrayLike) -> np.ndarray:
        """Compute the driving-point impedance Z = Z_1 = F / v at the handle, from the last mass n to the first.

            Z_i = 1 / (1 / (c_i + k_i / s) + 1 / (s m_i + Z_(i+1))),   Z_(n+1) = c_(n+1) + k_(n+1) / s,   s = j 2 pi f

        Here j is the imaginary unit, m_i the mass number i, and k_i and c_i are stiffness and damping of the spring and
        the damper before mass i. k_(n+1) and c_(n+1) connect the last mass with the ground.

        Parameters
        ----------
        frequency
            Frequencies f [Hz], > 0, a number or an array.

        Returns
        -------
        complex array, shape of `frequency`
            The impedance [N s/m].

        Raises
        ------
        SceneError
            If a frequency is not > 0, or the chain has invalid numbers.
        """
        self.check()
        s = 2j * math.pi * _frequencies(frequency)
        z = self.damping[-1] + self.stiffness[-1] / s
        for m, k, c in zip(self.mass[::-1], self.stiffness[-2::-1], self.damping[-2::-1], strict=True):
            z = 1 / (1 / (c + k / s) + 1 / (s * m + z))
        return z


def weighting(frequency: ArrayLike) -> np.ndarray:
    """Factor W_h of the hand-arm weighting of an acceleration [1], at frequencies > 0 [Hz]; same shape as `frequency`.

        W_h = |H_b H_w|,   H_b = s^2 w2^2 / ((s^2 + s w1 / Q1 + w1^2) (s^2 + s w2 / Q1 + w2^2)),   H_w = (s / w3 + 1) w3^2 / (s^2 + s w3 / Q2 + w3^2)

    with 6.310 Hz, 1258.9 Hz and Q1 = 1 / sqrt 2 for the band (second-order Butterworth), 15.915 Hz and Q2 = 0.64 for the transition from acceleration
    to velocity. Source: ISO 5349-1:2001, annex A. Raises SceneError for frequencies that are not > 0.
    """
    s = 2j * math.pi * _frequencies(frequency)
    w1, w2, w3 = (2 * math.pi * f for f in (*BAND, TRANSITION))
    band = s**2 * w2**2 / ((s**2 + s * w1 / BAND_QUALITY + w1**2) * (s**2 + s * w2 / BAND_QUALITY + w2**2))
    return np.abs(band * (s / w3 + 1) * w3**2 / (s**2 + s * w3 / TRANSITION_QUALITY + w3**2))


def weighted_acceleration(speed: ArrayLike, sample_time: NumberOrText) -> float:
    """Frequency-weighted rms acceleration a_hw [m/s2] of a handle, from its speed [m/s] sampled every `sample_time` [s].

    By Fourier transform under a Hann window, a = 2 pi i f v, weighted with `weighting`: the speed stays finite where friction makes the acceleration jump. The
    samples should cover many periods of a steady vibration at more than twice 1250 Hz. Raises SceneError for fewer than 16 samples, other than finite
    numbers and a sample time that is not > 0.
    """
    v = np.asarray(speed, float)
    if v.ndim != 1 or v.size < 16 or not np.isfinite(v).all():
        raise SceneError(f"Argument `speed` must be a row of at least 16 finite numbers, but its shape is {v.shape}.")
    sample_time = number("sample_time", sample_time, "s", above=0)
    window = np.hanning(v.size + 1)[:-1]
    spectrum = np.fft.rfft((v - v.mean()) * window)[1:]
    f = np.fft.rfftfreq(v.size, sample_time)[1:]
    power = np.abs(spectrum * 2 * math.pi * f * weighting(f)) ** 2
    if v.size % 2 == 0:
        power[-1] /= 2
    return float(math.sqrt(2 * power.sum() / (v.size * (window**2).sum())))


def daily_exposure(accelerations: Sequence[float], duration: NumberOrText) -> float:
    """Daily vibration exposure A(8) = a_hv sqrt(T / 8 h), a_hv = sqrt(sum a_hw^2) over the three directions [m/s2]; `duration` T in s.

    accelerations: weighted rms acceleration of one to three directions. A day of several tasks has A(8) = sqrt(sum A_i(8)^2). Source: ISO 5349-1:2001.
    Raises SceneError for negative numbers.
    """
    values = numbers("accelerations", np.atleast_1d(accelerations), "m/s2", at_least=0)
    if not 1 <= len(values) <= 3:
        raise SceneError(f"Argument `accelerations` must be of one to three directions, but it is {accelerations!r}.")
    duration = number("duration", duration, "s", at_least=0)
    return float(np.linalg.norm(values) * math.sqrt(duration / 28_800.0))


def _frequencies(frequency: ArrayLike) -> np.ndarray:
    f = np.asarray(frequency, float)
    numbers("frequency", f.ravel(), "Hz", above=0)
    return f
