"""The lowest set-point at which an ideal absorber in place of the drive keeps running smooth: what is to be had by absorbing waves at the top at all.

    u = - c w - k_f int w dt - m w'      without delay, sampling, noise and limits; c, k_f >= 0, inertia of the drive and m together > 0

Below that speed friction feeds the string more than a spring, a damper and an inertia at its top can take; a law that goes lower needs an active
form of higher order, or must see the bit. Closed form, two inertias without drags: an inertia like that of the bit and a damper bear a friction that
falls with the slope d = sqrt(2 k J_b); a damper alone, matched to the string, d = sqrt(k J_b), which is the impedance of the string.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from toolbox.arguments import checked_range
from toolbox.errors import SceneError
from toolbox.files.unit_systems import asked_in, reading
from toolbox.files.units import NumberOrText
from toolbox.halving import halved
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.drive import drive_of
from toolbox.steady_states.linear import linearise
from toolbox.steady_states.running import running

UNITS = {"rad/s": ("N m s/rad", "N m/rad", "kg m2"), "m/s": ("N s/m", "N/m", "kg")}
"""{unit of a speed: units of the damping, stiffness and inertia of an absorber on it}."""


@dataclass(frozen=True)
class Absorber:
    """The best absorber and how far down it reaches: `print(found)` shows it.

    Attributes
    ----------
    signal, unit
        The speed and its unit.
    speed
        Lowest stable set-point; nan where there is none in the range, the low end where all of it is stable.
    damping, stiffness, inertia
        Of the absorber at that set-point; the inertia of the drive is included.
    display_units
        {unit: unit that was typed}: the units in which `print` answers.
    """

    signal: str
    unit: str
    speed: float
    damping: float
    stiffness: float
    inertia: float
    display_units: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        units = UNITS.get(self.unit, ("1", "1", "1"))

        def shown(value: float, unit: str) -> str:
            factor, _ = read = reading(unit, self.display_units)
            return f"{value * factor:.4g}{read.tail}"

        taken = ", ".join(
            f"{word} {shown(getattr(self, word), unit)}" for word, unit in zip(("damping", "stiffness", "inertia"), units, strict=True)
        )
        return f"An ideal absorber keeps `{self.signal}` smooth down to {shown(self.speed, self.unit)}: {taken}"


@takes_loop
def absorber_limit(
    loop: ClosedLoop,
    bounds: tuple[NumberOrText, NumberOrText],
    *,
    keep_inertia: bool = False,
) -> Absorber:
    """Find the lowest set-point at which a drive that acts as spring, damper and inertia can keep smooth running
    stable, with the best tuning of the three.

    The relative error of the result is at most 0.001.

    Parameters
    ----------
    loop
        A plant, or a loop without the controller of the top drive, with constant inputs.
    bounds
        Range (low, high) of the set-point, in SI or text such as ("10 rpm", "120 rpm"). On the way from high to low
        set-points stability is assumed to be lost once.
    keep_inertia
        Whether the inertia of the drive keeps its value, and only spring and damper are tuned. By default False.

    Returns
    -------
    Absorber
        The lowest stable set-point, and stiffness, damping and inertia at this set-point. `print` shows them.

    Raises
    ------
    SceneError
        If there is no smooth running, or the drive has no inertia.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.robustness import absorber_limit
    >>> found = absorber_limit(compose(wells.JANSEN_2, BitRock(weight="97 kN")), ("5 rpm", "120 rpm"))
    >>> print(str(found).partition(":")[0])
    An ideal absorber keeps `top.speed` smooth down to 19.4 rpm
    """
    signal, effort = drive_of(loop.plant)
    unit = loop.unsampled().system.signal_unit(signal)
    bounds = low, high = checked_range(bounds, "bounds", unit)

    calm: list[np.ndarray] = []  # the absorbers of the speeds that are smooth, of which each is lower than the one before
    units = {unit: asked_in(bounds, unit)}

    def smooth(speed: float) -> bool:
        point = running(loop, {signal: speed}, effort)
        linear = linearise(point.plant, point, inputs=effort, outputs=signal)
        growth, numbers = tuned(np.asarray(linear.A), np.asarray(linear.B)[:, 0], np.asarray(linear.C)[0], keep_inertia)
        for each, asked in point.display_units.items():
            units.setdefault(each, asked)
        if growth < 0.0:
            calm.append(numbers)
        return growth < 0.0

    if not smooth(high):
        return Absorber(signal, unit, math.nan, math.nan, math.nan, math.nan, units)
    speed = low if smooth(low) else halved(smooth, low, high, 1e-3)[1]
    damping, stiffness, inertia = calm[-1].tolist()
    return Absorber(signal, unit, speed, damping, stiffness, inertia, units)


def tuned(A: np.ndarray, B: np.ndarray, C: np.ndarray, keep_inertia: bool) -> tuple[float, np.ndarray]:
    """Return the growth [1/s] and the numbers (c, k_f, inertia) of a stable absorber, or of the absorber nearest to stability."""
    from scipy.optimize import differential_evolution

    reach = float(C @ B)
    if reach <= 0.0:
        raise SceneError("Argument `loop` must have a drive whose force or torque acts on an inertia at the same place, but it has none.")
    own = 1.0 / reach
    poles = np.abs(np.linalg.eigvals(A))
    pace = float(np.median(poles[poles > 1e-6 * poles.max()]))
    n = A.shape[0]

    def absorber(logs: np.ndarray) -> np.ndarray:
        inertia = own if keep_inertia else own * math.exp(logs[2])
        return np.array([own * pace * math.exp(logs[0]), own * pace**2 * math.exp(logs[1]), inertia])

    def growth(logs: np.ndarray) -> float:
        c, k, inertia = absorber(logs)
        m = inertia - own
        # (1 + m C B) u = -(c C + m C A) x - k_f int w
        row = -np.append(c * C + m * C @ A, k) * own / inertia
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[n, :n] = A, C
        whole[:n] += np.outer(B, row)
        return float(np.linalg.eigvals(whole).real.max())

    bounds = [(-7.0, 4.0), (-12.0, 4.0), (-7.0, 3.0)][: 2 if keep_inertia else 3]
    found = differential_evolution(
        growth,
        bounds,
        rng=1,
        popsize=12,
        maxiter=60,
        tol=1e-8,
        polish=False,
        callback=lambda intermediate_result: intermediate_result.fun < -1e-9,
    )
    return float(found.fun), absorber(found.x)
