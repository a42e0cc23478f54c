"""Hopf points of steady running, solved exactly.

A steady state with falling friction is stable while something else damps enough. It is lost where a pair of poles crosses the imaginary axis, the
Hopf point. `hopf_points` solves for it as one system of equations in state x, parameter q, frequency w and eigenvector v,

    f(x, q) = 0,     A(x, q) v = i w v,     <c, v> = 1,          A = df/dx at given modes,

with exact Jacobians of CasADi, so that its result is exact to round-off and no step of q limits it. At a kink of a friction law, as a table has them, the
poles jump across the axis, and no pair is on it: such a point is found by halving, and said to be abrupt.

Why this is not the whole answer: a linear criterion knows only small disturbances. Stick-slip that has begun lives on far beyond the Hopf point of
many machines; `toolbox.onset` looks for that border too, by simulation.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import numbers, whole
from toolbox.errors import NoSteadyState, SceneError
from toolbox.files.results import LEFT_OUT
from toolbox.files.unit_systems import asked_in, reading
from toolbox.files.units import NumberOrText
from toolbox.halving import halved, zero
from toolbox.messages import sign_of_life
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.numbers import Number
from toolbox.modelling.steady_point import Equilibrium, mode_numbers
from toolbox.steady_states.equilibria import EquilibriumBranch, flow_slopes, state_values
from toolbox.steady_states.linear import holding_elements, steady_state
from toolbox.steady_states.sampled_hopf import SampledBranch, check_slopes, refuse_modes
from toolbox.steady_states.zeros import NEARER, newton, searched
from toolbox.vocabulary import Renamed


@dataclass(frozen=True)
class HopfPoint(Renamed):
    """A point where a pair of poles +-i w crosses the imaginary axis while a parameter varies.

    Attributes
    ----------
    parameter, unit, value
        The parameter and its value there.
    frequency
        Frequency w [rad/s].
    point
        The steady state there.
    stable
        "above" or "below": the side on which the pair is damped.
    coefficient
        First Lyapunov coefficient [1/s] for an eigenvector of length one in the states. Negative: soft, a small swing grows out of the steady state.
        Positive: hard, the machine jumps to a large cycle, and both are stable on the safe side. nan where it does not exist, and for sampled loops.
    residual
        Residual of the equations, as a fraction of their terms; for an abrupt point the width of the last interval as a fraction of the value.
    display_units
        {unit: unit that was typed}: the units in which `print` answers.
    abrupt
        Whether the poles jump across the axis, at a kink of a friction law such as a point of a table; `frequency` is then that of the growing pair.
    """

    parameter: str
    unit: str
    value: float
    frequency: float
    point: Equilibrium = field(metadata=LEFT_OUT)
    stable: str
    coefficient: float
    residual: float
    display_units: Mapping[str, str] = field(default_factory=dict)
    abrupt: bool = False

    @property
    def period(self) -> float:
        """2 pi / w [s]."""
        return 2 * math.pi / self.frequency

    @property
    def kind(self) -> str:
        """ "soft" (supercritical), "hard" (subcritical), "abrupt" (at a kink of a friction law) or "unknown"."""
        return "abrupt" if self.abrupt else "soft" if self.coefficient < 0 else "hard" if self.coefficient > 0 else "unknown"

    def __str__(self) -> str:
        factor, unit = reading(self.unit, self.display_units)
        return (
            f"Hopf point at {self.parameter} = {self.value * factor:.6g} {unit}, stable {self.stable}; period {self.period:.4g} s; {self.kind} loss of "
            f"stability; residual {self.residual:.1e}"
        )


@sign_of_life("hopf_points is at work")
@takes_loop
def hopf_points(
    loop: ClosedLoop,
    parameter: str,
    bounds: tuple[NumberOrText, NumberOrText],
    *,
    mode: Mapping[str, str] | None = None,
    guess: Mapping[str, Any] | None = None,
    num_values: int = 33,
) -> list[HopfPoint]:
    """Find every Hopf point of smooth running in a range of one parameter or input.

    At a Hopf point a pair of poles crosses the imaginary axis, so smooth running begins or ceases to be stable. The
    points are in the order of the parameter and exact to round-off.

    - A controller keeps the design that it has on the nominal plant.
    - Values without a steady state are skipped. If smooth running ends inside the range, its end is examined as one
      more value.
    - A pair of poles whose frequency is below 1e-9 of the fastest pole counts as two real poles and gives no Hopf
      point. An example is a slow creep on rock. To find such a point, increase a mass that does not influence the
      border.

    Parameters
    ----------
    loop
        A loop with constant inputs, or a plant. A sampled controller must have a slope: its command must be a
        differentiable function of its measurements. Its sample time, hold and delay are taken into account exactly.
    parameter
        Name of a parameter of the plant or of a controller, of a sample time or a delay, or of an input. Examples are
        `top.reference`, `bit.weight`, `block.damping` and `chain.stiffness.0`.
    bounds
        Range (low, high) of the parameter, in SI or text with units.
    mode
        {contact or relay: mode} of the steady state. By default contacts slide in the direction in which they slide at
        the start.
    guess
        {state: value} near one steady state in the range, as a start of the search. By default None: the search starts
        without a guess. Needed if this search fails, for example under a drive with limits.
    num_values
        Number of values of the parameter that are examined, by default 33. Two Hopf points between neighbouring values
        are not found.

    Returns
    -------
    list of HopfPoint
        The points, with frequency and first Lyapunov coefficient.

    Raises
    ------
    SceneError
        If a name is unknown, the range is empty, or the plant has no steady state in the range.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, hopf_points
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> for point in hopf_points(loop, "top.reference", ("20 rpm", "120 rpm")):
    ...     print(f"{point.value:.3f} rad/s, frequency {point.frequency:.3f} rad/s")
    3.673 rad/s, frequency 0.954 rad/s
    """
    check_slopes(loop)
    free = loop.differentiable_number(parameter, "hopf_points", lambda number: number.kind.poles)
    if loop.is_sampled:
        refuse_modes(mode, "hopf_points")
        found = sampled_hopf_points(SampledBranch(loop, free, guess), free.span(bounds), whole("num_values", num_values, 2))
    else:
        inputs = loop.constant_inputs("steady running")
        found = hopf_points_of(
            loop.continuous_loop.system, free, free.span(bounds), inputs, mode, guess, whole("num_values", num_values, 2)
        )
    asked = {free.unit: asked_in(free.in_si("bounds", bounds), free.unit)}
    return [replace(point, display_units=asked) for point in found]


def hopf_points_of(
    closed: HybridSystem,
    free: Number,
    between: tuple[float, float],
    inputs: Mapping[str, float],
    mode: Mapping[str, str] | None = None,
    guess: Mapping[str, Any] | None = None,
    values: int = 33,
) -> list[HopfPoint]:
    """Return the Hopf points of a plant whose laws are parts of it, like `hopf_points`. NoSteadyState is raised if the range has no steady
    state."""
    low, high = between
    followed = EquilibriumBranch(closed, free, inputs, mode, guess)
    grid = np.linspace(low, high, values)
    for value in (*grid, *grid):  # twice: what fails alone may be reached from its neighbours
        followed(float(value))
    if not any(followed.known.values()):
        raise NoSteadyState(f"There is no steady running for `{free.name}` from {low:g} to {high:g} {free.unit}: {followed.reason}")
    found = []
    for a, b in itertools.pairwise(map(float, grid)):
        left, right = followed.growths(a), followed.growths(b)
        if left is None and right is not None:  # stability may be lost just before steady running ends
            a = followed.edge(b, a)
            left = followed.growths(a)
        elif right is None and left is not None:
            b = followed.edge(a, b)
            right = followed.growths(b)
        if left is None or right is None or not a < b:
            continue
        counts = [int((growths > 0).sum()) for growths in (left, right)]
        stable = "below" if counts[0] < counts[1] else "above"
        near = [at for k in range(min(counts), max(counts)) if (at := _crossing(followed, k, a, b)) is not None]
        found += [_solved(followed, at, stable) for at in near]
        if not near and counts[0] != counts[1] and (jump := _jump(followed, counts, a, b, stable)) is not None:
            found.append(jump)
    return sorted(found, key=lambda point: point.value)


@sign_of_life("hopf_curve is at work")
@takes_loop
def hopf_curve(
    loop: ClosedLoop,
    parameter: str,
    bounds: tuple[NumberOrText, NumberOrText],
    second_parameter: str,
    values: Sequence[NumberOrText],
    *,
    mode: Mapping[str, str] | None = None,
) -> np.ndarray:
    """Find the Hopf value of one parameter as a function of another parameter.

    Examples are the critical speed over the weight on bit, over damping, or over a gain.

    Parameters
    ----------
    loop
        A loop with constant inputs, or a plant. A sampled controller must have a slope: its command must be a
        differentiable function of its measurements.
    parameter, bounds
        The first parameter or input, and the range (low, high) in which its Hopf value is searched, in SI or text
        with units.
    second_parameter, values
        The other parameter or input, and its values.
    mode
        {contact or relay: mode} of the steady state. By default contacts slide in the direction in which they slide
        at the start.

    Returns
    -------
    array, shape (len(values),)
        The Hopf values of the first parameter, in SI. If the range contains several Hopf values for one value of the
        second parameter, the largest of them. nan if the range contains no Hopf value, or if there is no smooth running.

    Raises
    ------
    SceneError
        If a name is unknown, or the range is empty.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, hopf_curve
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> speeds = hopf_curve(loop, "top.reference", ("10 rpm", "120 rpm"), second_parameter="bit.weight", values=["80 kN", "97 kN"])
    >>> print(speeds.round(2), "rad/s")
    [3.46 3.67] rad/s
    """
    check_slopes(loop)
    other, free = (
        loop.differentiable_number(name, "hopf_curve", lambda number: number.kind.poles) for name in (second_parameter, parameter)
    )
    within, loop = free.span(bounds), loop if loop.is_sampled else loop.continuous_loop
    closed, inputs = loop.system, loop.constant_inputs("steady running")
    if loop.is_sampled:
        refuse_modes(mode, "hopf_curve")
    curve = []
    for value in numbers("values", other.in_si("values", values)):
        try:
            if loop.is_sampled:
                points = sampled_hopf_points(SampledBranch(other.put(loop, value), free), within)
            else:
                system, given = other.varied(closed, inputs, value)
                points = hopf_points_of(system, free, within, given, mode)
        except NoSteadyState:
            points = []
        curve.append(points[-1].value if points else math.nan)
    return np.array(curve)


def sampled_hopf_points(branch: SampledBranch, between: tuple[float, float], values: int = 33) -> list[HopfPoint]:
    """Return the Hopf points of a sampled loop, from its exact matrix. NoSteadyState is raised if the range has no steady running."""
    free, found = branch.free, []
    for value, exponent, stable in branch.hopf_values(*between, values):
        residual = abs(exponent.real) / abs(exponent.imag)
        found.append(HopfPoint(free.name, free.unit, value, exponent.imag, branch.equilibrium(value), stable, math.nan, residual))
    return found


def _crossing(followed: EquilibriumBranch, k: int, a: float, b: float) -> float | None:
    """A value near which the k-th pair crosses the axis between a and b, to a few digits; None where the pair ends there."""

    def growth(value: float) -> float:
        growths = followed.growths(value)
        return math.nan if growths is None else float(growths[k]) if k < growths.size else -1.0

    try:
        value = zero(growth, a, b, 1e-9 * (b - a))
    except ValueError:  # nan where there is no steady state
        return None
    growths = followed.growths(value)  # where a pair meets on the real axis it ends, with a jump of its real part
    return value if growths is not None and k < growths.size and abs(growths[k]) < 1e-4 * (abs(growth(a)) + abs(growth(b))) else None


def _jump(followed: EquilibriumBranch, counts: Sequence[int], a: float, b: float, stable: str) -> HopfPoint | None:
    """The place between a and b at which the slopes of the machine jump and with them the number of growing pairs; None where the slopes go on."""

    def growing(value: float) -> int:
        growths = followed.growths(value)
        return -1 if growths is None else int((growths > 0).sum())

    low, high = halved(lambda value: growing(value) == counts[1], a, b, 0.0, 1e-12 * (b - a))
    points = followed(low), followed(high)
    if points[0] is None or points[1] is None:
        return None
    slopes = [flow_slopes(point) for point in points if point is not None]
    if np.abs(slopes[1] - slopes[0]).max() <= 1e-6 * np.abs(slopes).max():  # a pair that ends on the real axis
        return None
    poles = np.linalg.eigvals(slopes[1] if stable == "below" else slopes[0])
    pairs = poles[poles.imag > 1e-9 * np.abs(poles).max()]
    frequency = float(pairs[np.argmax(pairs.real)].imag)
    value, width = 0.5 * (low + high), high - low
    point = points[0] if stable == "below" else points[1]  # the steady state on the stable side
    return HopfPoint(
        followed.free.name, followed.free.unit, value, frequency, point, stable, math.nan, width / max(abs(value), width), abrupt=True
    )


def _solved(followed: EquilibriumBranch, guess: float, stable: str) -> HopfPoint:
    """The Hopf point next to a value, from the extended system."""
    closed, free, inputs = followed.closed, followed.free, followed.inputs
    given = [name for name in inputs if name != free.name]
    near = followed(guess)
    assert near is not None  # `_crossing` has found it
    plant, m = near.plant, mode_numbers(near.plant, near.modes)
    poles, vectors = np.linalg.eig(flow_slopes(near))
    best = min(
        (i for i in range(poles.size) if poles[i].imag > 1e-9 * np.abs(poles).max()), key=lambda i: abs(poles[i].real) / poles[i].imag
    )
    n = plant.x.numel()
    size = np.maximum(np.abs(near.states), np.abs(near.states).max() * 1e-3 + 1e-300)
    v = vectors[:, best] / np.linalg.norm(vectors[:, best])
    c = np.concatenate([v.real, v.imag])
    sticking = np.flatnonzero((m == 0.0) & holding_elements(plant))
    residual, jacobian = _extended(plant, free, tuple(given), tuple(sticking.tolist()))
    scale = np.concatenate([size, [abs(guess) or 1.0, poles[best].imag], np.ones(2 * n)])
    z = np.concatenate([near.states, [guess, poles[best].imag], v.real, v.imag])

    def equations(y: np.ndarray) -> np.ndarray:
        return np.array(residual(y * scale, near.inputs, plant.values, m, c)).ravel() / rows

    def slopes(y: np.ndarray) -> np.ndarray:
        return np.array(jacobian(y * scale, near.inputs, plant.values, m, c)) * scale / rows[:, None]

    rows = np.ones(1)
    rows = np.abs(slopes(z / scale)).max(axis=1)
    rows[rows == 0.0] = 1.0
    y = z / scale if sticking.size else newton(equations, slopes, z / scale, 8, NEARER, alone=True)
    if not np.abs(equations(y)).max() < 1e-10:
        y = searched(equations, slopes, z / scale, "hybr" if not sticking.size else "lm")
    left = float(np.abs(equations(y)).max())
    z = y * scale
    if not left < 1e-8 or not z[n + 1] > 0:
        raise SceneError(
            f"The Hopf point near `{free.name}` = {guess:g} {free.unit} could not be solved: {left:.1e} of its equations is left."
        )
    value = float(z[n])
    point = steady_state(*free.varied(closed, inputs, value), state_values(closed, z[:n]), near.modes)
    vector = z[n + 2 : 2 * n + 2] + 1j * z[2 * n + 2 :]
    coefficient = _lyapunov_coefficient(point, m, float(z[n + 1]), vector) if not sticking.size else math.nan
    return HopfPoint(free.name, free.unit, value, float(z[n + 1]), point, stable, coefficient, left)


def _extended(plant: HybridSystem, free: Number, given: tuple[str, ...], sticking: tuple[int, ...]) -> tuple[ca.Function, ca.Function]:
    """Functions (z, u, p, m, c) -> residual of the extended system and its Jacobian by z = (x, q, w, Re v, Im v)."""
    key = ("hopf", free.name, free.is_input, given, sticking)
    found = plant.cache.get(key)
    if found is None:
        n = plant.x.numel()
        w, vr, vi, c = ca.SX.sym("w"), ca.SX.sym("vr", n), ca.SX.sym("vi", n), ca.SX.sym("c", 2 * n)
        field = plant.switched_equations.field
        slip = ca.vertcat(*[plant.switched_equations.slip[i] for i in sticking]) if sticking else ca.SX(0, 1)
        # an input that nobody gives follows the parameters, which the free parameter may be one of
        u = ca.vertcat(*[entry.symbol if name in given or name == free.name else entry.default for name, entry in plant.inputs.items()])
        if plant.inputs:
            field, slip = ca.substitute([field, slip], [plant.u], [u])
        a = ca.jacobian(field, plant.x)
        q = plant.inputs[free.name].symbol if free.is_input else plant.p[plant._parameter(free.name).offset]
        real = ca.mtimes(a, vr) + w * vi
        imaginary = ca.mtimes(a, vi) - w * vr
        norm = ca.vertcat(ca.dot(c[:n], vr) + ca.dot(c[n:], vi) - 1, ca.dot(c[:n], vi) - ca.dot(c[n:], vr))
        equations = ca.densify(ca.vertcat(field, real, imaginary, norm, slip))
        z = ca.vertcat(plant.x, q, w, vr, vi)
        jacobian = ca.densify(ca.jacobian(equations, z))
        z_in = ca.SX.sym("z", z.numel())
        equations, jacobian = ca.substitute([equations, jacobian], [z], [z_in])
        equations, jacobian = ca.substitute([equations, jacobian], [plant.t], [ca.SX(0)])
        symbols = [z_in, plant.u, plant.p, plant.m, c]
        found = plant.cache[key] = (ca.Function("extended", symbols, [equations]), ca.Function("slopes", symbols, [jacobian]))
    return found


def _lyapunov_coefficient(point: Equilibrium, m: np.ndarray, w: float, q: np.ndarray) -> float:
    """First Lyapunov coefficient at a Hopf point (Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, 3rd ed., eq. 5.39).

        l1 = Re[ <p, C(q, q, q*)> - 2 <p, B(q, A^-1 B(q, q*))> + <p, B(q*, (2 i w - A)^-1 B(q, q))> ] / (2 w)

    with A q = i w q, A' p = -i w p, <q, q> = <p, q> = 1, and B, C the second and third derivatives of the flow.
    """
    plant = point.plant
    n = plant.x.numel()

    def directional() -> ca.Function:
        d1, d2, d3 = (ca.SX.sym(f"d{i}", n) for i in (1, 2, 3))
        second = ca.jtimes(ca.jtimes(plant.switched_equations.field, plant.x, d1), plant.x, d2)
        symbols = [plant.x, plant.u, plant.p, plant.m, d1, d2, d3]
        forms = ca.substitute([ca.densify(second), ca.densify(ca.jtimes(second, plant.x, d3))], [plant.t], [ca.SX(0)])
        return ca.Function("directional", symbols, forms)

    function = plant.once("directional", directional)

    def form(*directions: np.ndarray) -> np.ndarray:
        """B or C at complex directions, by linearity from their real and imaginary parts."""
        total = np.zeros(n, complex)
        third = len(directions) == 3
        for parts in itertools.product((0, 1), repeat=len(directions)):
            real = [(d.real, d.imag)[part] for d, part in zip(directions, parts, strict=True)]
            padded = real if third else [*real, np.zeros(n)]
            value = function(point.states, point.inputs, plant.values, m, *padded)[1 if third else 0]
            total += 1j ** sum(parts) * np.array(value).ravel()
        return total

    a = flow_slopes(point)
    q = q / np.linalg.norm(q)
    values, vectors = np.linalg.eig(a.T)
    p = vectors[:, int(np.argmin(np.abs(values + 1j * w)))]
    p = p / np.conj(np.vdot(p, q))
    try:
        inner = np.linalg.solve(a, form(q, q.conj()))
        outer = np.linalg.solve(2j * w * np.eye(n) - a, form(q, q))
    except np.linalg.LinAlgError:
        return math.nan
    whole = np.vdot(p, form(q, q, q.conj())) - 2 * np.vdot(p, form(q, inner)) + np.vdot(p, form(q.conj(), outer))
    value = complex(whole).real / (2 * w)
    return value if cmath.isfinite(value) else math.nan
