"""The best disk margin and the lowest peak of the sensitivity that any linear law can have on what is measured, with its sampling and delay.

Whatever stabilises a loop of one command has S = 0, T = 1 at every unstable pole of the plant and S = 1, T = 0 at every zero of it outside the stable region;
in samples the infinite z is such a zero, as often as the plant is late by a sample: a delay is nothing else. So E = S - T is analytic in the unstable region
with E = -1 at the poles and E = +1 at the zeros, and the smallest maximum that such a function can have is given by Nevanlinna and Pick. With every
point mapped to one of the unit disk, L the matrix with these points as its eigenvalues (a Jordan block for the infinite z), and the values in b where
the function 1 has a,

    P_a - L P_a L* = a a*,   P_b - L P_b L* = b b*:      min max |E| = sqrt(largest eigenvalue of P_a^-1 P_b) = gamma,   disk margin = 2 / gamma

and likewise for S. It is a limit that laws come as near to as one likes, of any order, without noise and without limits of torque. Several measured signals
count by the zeros that they have in common: with more than one there are few. Sources: P. Seiler, A. Packard, P. Gahinet (2020) for the disk margin;
J. C. Doyle, B. A. Francis, A. Tannenbaum, Feedback Control Theory, Macmillan 1992, chapter 9; J. A. Ball, I. Gohberg, L. Rodman, Interpolation of Rational
Matrix Functions, Birkhauser 1990.

Why exact in samples and not with a delay of exp(-s tau): with it the bound on max |T| is the same problem with values scaled by exp(p tau), but those on S
and S - T are not, because the delay then stands inside a sum. In samples every delay, also a part of a period, is a finite number of conditions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from toolbox.arguments import number
from toolbox.errors import SceneError
from toolbox.files.unit_systems import reading
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.drive import drive_of
from toolbox.modelling.laws import names
from toolbox.steady_states.linear import linearise
from toolbox.steady_states.linear_loop import zero_order_hold
from toolbox.steady_states.running import running

ON_THE_BORDER = 1e-9
"""A pole or zero this near to the border of stability, as a part of its size, asks for nothing: margins near it are limits, too."""


@dataclass(frozen=True)
class PerformanceLimit:
    """Limits that no linear law can surpass at an operating point: `print(found)` shows them.

    Attributes
    ----------
    disk_margin
        The largest disk margin alpha there can be [1], at most 2; 0 where no law stabilises the plant.
    peak_sensitivity
        The smallest peak sensitivity M_s there can be [1], at least 1.
    poles
        Unstable poles of the plant, as rates in 1/s, complex.
    zeros
        Its zeros in the unstable region, as rates in 1/s, complex; those of samples beyond the sampling rate have large imaginary parts.
    samples
        Number of samples by which a command reaches what is measured late: the multiplicity of the zero at infinity; 0 for continuous laws.
    period, delay
        Sample time and delay as given [s].
    signals, units
        {name: value} of the working point, and its units.
    display_units
        {unit: unit that was typed}: the units in which `print` answers.
    """

    disk_margin: float
    peak_sensitivity: float
    poles: np.ndarray
    zeros: np.ndarray
    samples: int
    period: float | None
    delay: float
    signals: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    display_units: Mapping[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        read = {name: reading(unit, self.display_units) for name, unit in self.units.items()}
        at = ", ".join(f"{name} = {value * read[name].factor:.4g}{read[name].tail}" for name, value in self.signals.items())
        how = "continuous laws" if self.period is None else f"laws sampled every {self.period:g} s with a delay of {self.delay:g} s"
        rates = [", ".join(f"{rate:.3g}" for rate in row[row.imag >= 0]) or "none" for row in (self.poles, self.zeros)]
        return (
            f"Limits of {how} at {at}\n"
            f"  disk margin <= {self.disk_margin:.3g}, M_s >= {self.peak_sensitivity:.3g}\n"
            f"  unstable poles [1/s]: {rates[0]};  zeros [1/s]: {rates[1]}"
        )


@takes_loop
def performance_limit(
    loop: ClosedLoop,
    at: Mapping[str, NumberOrText],
    *,
    measured_signals: str | Sequence[str] | None = None,
    actuated_signals: str | None = None,
    period: NumberOrText | None = None,
    delay: NumberOrText = 0.0,
) -> PerformanceLimit:
    """Compute the largest disk margin and the smallest peak sensitivity that any linear controller can reach at a
    set-point, for given measured signals and delay.

    Parameters
    ----------
    loop
        A plant, or a loop without the controller whose limit is computed, with constant inputs.
    at
        {signal: value} of the steady state, such as {"top.speed": 3.0}, in SI or text with units.
    measured_signals
        Signals that the controller may measure. By default the speed of the drive.
    actuated_signals
        The one input that the controller gives. By default the force or torque of the drive. A part between controller
        and plant, such as a drive with lags, is taken into account.
    period
        Sample time [s]. By default None: continuous controllers.
    delay
        Delay of the commands [s], for sampled controllers only, by default 0.

    Returns
    -------
    PerformanceLimit
        The limits at the operating point. `print` shows them.

    Raises
    ------
    SceneError
        If there is no smooth running, more than one input is driven, or a delay is given without a period.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.robustness import performance_limit
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> print(performance_limit(rig, {"top.speed": "60 rpm"}, period="10 ms", delay="30 ms"))
    Limits of laws sampled every 0.01 s with a delay of 0.03 s at top.speed = 60 rpm, top.torque = 1.055e+04 N m
      disk margin <= 2, M_s >= 1
      unstable poles [1/s]: none;  zeros [1/s]: none
    """
    plant = loop.unsampled().system
    measured_signals = drive_of(plant)[0] if measured_signals is None else measured_signals
    actuated_signals = drive_of(plant)[1] if actuated_signals is None else actuated_signals
    if not isinstance(actuated_signals, str):
        raise SceneError(
            f"Argument `actuated_signals` must be the name of one input, but it is {actuated_signals!r}: with several the limits are not known in this form."
        )
    period, delay = None if period is None else number("period", period, "s", above=0), number("delay", delay, "s", at_least=0)
    if delay > 0 and period is None:
        raise SceneError(f"Argument `delay` must be 0 without a `period`, but it is {delay!r}.")
    actuated_signals, seen = (
        plant.redirected_signals.get(actuated_signals, actuated_signals),
        [plant.redirected_signals.get(name, name) for name in names(measured_signals)],
    )
    point = running(loop, at, actuated_signals)
    linear = linearise(point.plant, point, inputs=actuated_signals, outputs=seen)
    A, B, C, D = (np.asarray(each, float) for each in (linear.A, linear.B, linear.C, linear.D))
    late = 0
    if period is not None:
        late = math.floor(delay / period * (1.0 + 1e-12))
        A, B, C, D = sampled_plant(A, B, C, D, period, max(delay - late * period, 0.0))
    poles = unstable_poles(A, B, C, period)
    signals = {name: float(point[name]) for name in (*at, actuated_signals)}
    working = signals, {name: plant.signal_unit(name) for name in signals}, point.display_units
    if poles is None:
        return PerformanceLimit(0.0, math.inf, np.empty(0), np.empty(0), 0, period, delay, *working)
    zeros, degree = common_zeros(A, B, C, D, period)
    infinite = 0 if period is None else degree + late
    disk, sensitivity = (max(1.0, smallest_peak(poles, zeros, infinite, period, value)) for value in (-1.0, 0.0))
    if not poles.size:
        disk = sensitivity = 1.0

    def rates(values: np.ndarray) -> np.ndarray:
        return values if period is None else np.log(values.astype(complex)) / period

    return PerformanceLimit(2.0 / disk, sensitivity, rates(poles), rates(zeros), infinite, period, float(delay), *working)


def sampled_plant(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, period: float, fraction: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the plant from sample to sample under a held command that is late by a fraction of a period. If it is late, the command of the
    last sample is an additional state.

    A sample reads what was held before it, so that a direct part D is late by a sample, too.
    """
    n, k = A.shape[0], B.shape[1]
    step, whole = zero_order_hold(A, B, period)
    now = zero_order_hold(A, B, period - fraction)[1]
    if fraction == 0.0 and not D.any():
        return step, whole, C, D
    wide = np.zeros((n + k, n + k))
    wide[:n, :n], wide[:n, n:] = step, whole - now
    return wide, np.vstack([now, np.eye(k)]), np.hstack([C, D]), np.zeros_like(D)


def unstable_poles(A: np.ndarray, B: np.ndarray, C: np.ndarray, period: float | None) -> np.ndarray | None:
    """Return the unstable poles. None if the command does not reach such a pole, or if the measured signals do not show it."""
    poles = np.linalg.eigvals(A).astype(complex)
    size = np.maximum(np.abs(poles), 1e-12)
    outside = poles.real > ON_THE_BORDER * size.max(initial=1.0) if period is None else np.abs(poles) > 1.0 + ON_THE_BORDER
    n = A.shape[0]
    scale = np.abs(A).max()
    for pole in poles[outside]:
        inner = pole * np.eye(n) - A
        reach = np.linalg.svd(np.hstack([inner, B * scale / max(np.abs(B).max(), 1e-300)]), compute_uv=False)[-1]
        sight = np.linalg.svd(np.vstack([inner, C * scale / max(np.abs(C).max(), 1e-300)]), compute_uv=False)[-1]
        if min(reach, sight) < 1e-12 * scale:
            return None
    return poles[outside]


def common_zeros(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, period: float | None) -> tuple[np.ndarray, int]:
    """(zeros in the unstable region that all outputs have in common, multiplicity of the zero at infinity)."""
    from scipy.linalg import eigvals

    n = A.shape[0]
    degrees, found = [], []
    for row, direct in zip(C, D, strict=True):
        degree, power = 0, B[:, 0]
        size = np.abs(row) @ np.abs(B[:, 0]) + np.abs(direct[0])
        value = direct[0]
        while abs(value) <= 1e-9 * size and degree <= n:
            degree, value = degree + 1, row @ power
            size, power = np.abs(row) @ np.abs(power), A @ power
        degrees.append(degree)
        top = np.vstack([np.hstack([A, B]), np.append(row, direct)])
        right = np.diag(np.append(np.ones(n), 0.0))
        values = eigvals(top, right)
        values = values[np.isfinite(values)]
        found.append(values[np.argsort(np.abs(values))][: n - degree] if degree <= n else np.empty(0, complex))
    degree = min(degrees)
    if degree > n:
        raise SceneError("Argument `measured_signals` must answer to the command that is driven, but it does not.")
    first = next(values for values, each in zip(found, degrees, strict=True) if each == degree)
    outside = (
        first[first.real > ON_THE_BORDER * np.abs(first).max(initial=1.0)] if period is None else first[np.abs(first) > 1.0 + ON_THE_BORDER]
    )
    shared = [
        zero for zero in outside
        if all(values.size and np.abs(values - zero).min() <= 1e-7 * max(abs(zero), np.abs(A).max()) for values in found)
    ]  # fmt: skip
    return np.array(shared, complex), degree


def smallest_peak(poles: np.ndarray, zeros: np.ndarray, infinite: int, period: float | None, value: float) -> float:
    """min max |f| over functions without poles in the unstable region that are `value` at these poles and 1 at these zeros, `infinite` times at infinity."""
    from scipy.linalg import eigh

    points, a, b = interpolation(poles, zeros, infinite, period, value)
    if not a.size:
        return 0.0
    ones, values = gramian(points, a), gramian(points, b)
    scale = 1.0 / np.sqrt(np.abs(np.diag(ones)))
    return float(math.sqrt(max(eigh(values * np.outer(scale, scale), ones * np.outer(scale, scale), eigvals_only=True)[-1], 0.0)))


def interpolation(
    poles: np.ndarray, zeros: np.ndarray, infinite: int, period: float | None, value: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (L, a, b): the points in the unit disk as a matrix, and the values of the functions 1 and f at these points."""
    nodes = np.concatenate([poles, zeros]).astype(complex)
    if period is None:
        middle = float(np.exp(np.log(np.abs(nodes)).mean())) if nodes.size else 1.0
        places = (nodes - middle) / (nodes + middle)
    else:
        places = 1.0 / nodes
    n = nodes.size
    points = np.zeros((n + infinite, n + infinite), complex)
    points[range(n), range(n)] = places
    points[range(n + 1, n + infinite), range(n, n + infinite - 1)] = 1.0
    a, b = np.zeros(n + infinite, complex), np.zeros(n + infinite, complex)
    a[:n], b[: poles.size], b[poles.size : n] = 1.0, value, 1.0
    if infinite:
        a[n] = b[n] = 1.0
    return points, a, b


def gramian(points: np.ndarray, column: np.ndarray) -> np.ndarray:
    """P with P - L P L* = c c*."""
    from scipy.linalg import solve_discrete_lyapunov

    found = solve_discrete_lyapunov(points, np.outer(column, column.conj()))
    return (found + found.conj().T) / 2
