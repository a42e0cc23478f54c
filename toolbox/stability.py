"""Where steady running loses stability: all steady states, the slope of friction there, and Hopf points solved exactly.

A steady state with falling friction is stable while something else damps enough. It is lost where a pair of poles crosses the imaginary axis, the
Hopf point. `hopf_points` solves for it as one system of equations in state x, parameter q, frequency w and eigenvector v,

    f(x, q) = 0,     A(x, q) v = i w v,     <c, v> = 1,          A = df/dx at given modes,

with exact Jacobians of CasADi, so that its result is exact to round-off and no step of q limits it.

Why this is not the whole answer: a linear criterion knows only small disturbances. Stick-slip that has begun lives on far beyond the Hopf point of
many machines; `toolbox.onset` looks for that border too, by simulation.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import mapping, numbers, whole
from toolbox.closed_loop import Controller, Sampled
from toolbox.elements import is_finite_number
from toolbox.errors import SceneError, suggest
from toolbox.hybrid import HybridSystem
from toolbox.linear import (
    Equilibrium,
    _free,
    _frictionless,
    _modes_at,
    equilibrium,
    function_of,
    holding_elements,
    input_values,
    linearise,
    mode_numbers,
    residual_functions,
)
from toolbox.simulate import checked_run
from toolbox.work_arrays import place_starts

MANY_MODES = 81
"""Combinations of modes above which `equilibria` tries only those in which all contacts do the same."""


# ------------------------------------------------------------------------------------------------------------------------------- the closed loop
def continuous_loop(
    plant: HybridSystem,
    controller: Any = None,
    *,
    inputs: Mapping[str, float] | None = None,
    parameters: Mapping[str, Any] | None = None,
) -> HybridSystem:
    """The plant with its controllers as parts, each in its continuous form, also where it will run sampled.

    controller, parameters: as in `simulate`; a law is designed on the declared plant. Raises SceneError for a law without a continuous form, such
    as a Python callable.
    """
    laws = []
    for given in [] if controller is None else controller if isinstance(controller, (list, tuple)) else [controller]:
        law = given.law if isinstance(given, Sampled) else given
        if not isinstance(law, Controller):
            raise SceneError(f"Argument `controller` must be a Controller with a continuous form, but it is {law!r}.")
        laws.append(law)
    return checked_run(plant, 0.0, inputs=inputs, parameters=parameters, controller=laws or None).system


@dataclass(frozen=True)
class Knob:
    """A number of a plant that is varied: an input, or a parameter of the plant or its law."""

    name: str
    unit: str
    is_input: bool

    @staticmethod
    def of(plant: HybridSystem, name: str) -> Knob:
        """The knob of that name; raises SceneError where there is neither such an input nor such a parameter, or it is a vector."""
        if isinstance(name, str) and name in plant.inputs:
            return Knob(name, plant.inputs[name].unit, True)
        try:
            entry = plant._parameter(name)
        except SceneError:
            raise SceneError(f"There is no parameter or input `{name}`: {suggest(str(name), [*plant.parameters, *plant.inputs])}") from None
        if entry.size is not None:
            raise SceneError(f"Argument `parameter` must be one number, but `{name}` has {entry.size} entries: name one, e.g. `{name}.0`.")
        return Knob(name, entry.unit, False)

    def declared(self, plant: HybridSystem, inputs: Mapping[str, float]) -> float:
        """Its value as declared, or as given among the inputs."""
        if not self.is_input:
            return float(plant.parameter(self.name))
        if self.name in inputs:
            return float(inputs[self.name])
        return float(np.array(plant.input_defaults(plant.values)).ravel()[list(plant.inputs).index(self.name)])

    def arguments(self, value: float, inputs: Mapping[str, float]) -> dict[str, Any]:
        """`inputs` and `parameters` of `equilibrium` with the knob at a value."""
        if self.is_input:
            return {"inputs": {**inputs, self.name: value}, "parameters": None}
        return {"inputs": dict(inputs), "parameters": {self.name: value}}


def checked_range(between: Any) -> tuple[float, float]:
    """(low, high) of a range; raises SceneError unless it is two finite numbers in that order."""
    try:
        low, high = between
    except (TypeError, ValueError):
        low, high = None, None
    if not is_finite_number(low) or not is_finite_number(high) or not low < high:
        raise SceneError(f"Argument `between` must be two finite numbers (low, high) with low < high, but it is {between!r}.")
    return float(low), float(high)


# --------------------------------------------------------------------------------------------------------------------------------- steady states
def equilibria(
    plant: HybridSystem,
    *,
    inputs: Mapping[str, float] | None = None,
    parameters: Mapping[str, Any] | None = None,
    controller: Any = None,
) -> list[Equilibrium]:
    """Every steady state that is found over the modes of all contacts and a row of guesses, slipping ones first.

    Guesses are the state that the plant would have without friction, scaled by 1, 1/2, ... 1/64 and 0, so that the slow steady states of falling
    friction are found beside the fast one. Modes are tried in all combinations up to 81 of them, beyond that only all alike. A contact that
    may rest anywhere in a range is represented by one state of it. Nothing proves that no other exists. Raises SceneError for arguments
    as `equilibrium` does, never for an empty result.
    """
    plant = continuous_loop(plant, controller, parameters=parameters)
    holding = [element.name for element in plant.elements if element.holds and element.law is not None]
    words = ("slip+", "slip-", "stick")
    alike = 3 ** len(holding) > MANY_MODES
    combinations = [(word,) * len(holding) for word in words] if alike else list(itertools.product(words, repeat=len(holding)))
    smooth = _frictionless(plant, _free(plant), input_values(plant, inputs or {}))
    found: list[Equilibrium] = []
    for combination in combinations:
        for factor in (1.0, 0.5, 0.25, 0.125, 1 / 16, 1 / 32, 1 / 64, 0.0):
            start = state_values(plant, factor * smooth)
            try:
                point = equilibrium(plant, inputs=inputs, start=start, mode=dict(zip(holding, combination, strict=True)))
            except SceneError:
                continue
            if not any(_same(point, other) for other in found):
                found.append(point)
            if "stick" in combination:  # one of a continuum
                break
    return sorted(found, key=lambda point: list(point.modes.values()).count("stick"))


def _same(a: Equilibrium, b: Equilibrium) -> bool:
    size = np.maximum(np.abs(a.states), np.abs(b.states)).max(initial=0.0)
    return bool(np.abs(a.states - b.states).max(initial=0.0) <= 1e-6 * size) and a.modes == b.modes


def state_values(plant: HybridSystem, x: np.ndarray) -> dict[str, Any]:
    """A state vector as {name: value} for `start`."""
    return {name: float(x[first]) if size is None else x[first : first + size] for name, (first, size, _) in plant.states.items()}


def friction_slopes(point: Equilibrium) -> dict[str, float]:
    """How steeply the friction of every sliding contact rises with slip speed at a steady state, load * d mu / d|v|.

    In the force unit over the slip unit (N s/m, N m s/rad): where it is negative it acts as negative damping of that size, and steady sliding is
    stable only if the rest of the machine damps more. Contacts that stick are left out.
    """
    plant = point.plant
    m = mode_numbers(plant, point.modes)
    slopes = {}
    for element, mode in zip(plant.elements, m, strict=True):
        if element.law is None or mode == 0.0:
            continue
        companions = [plant.m[[e.name for e in plant.elements].index(twin.name)] for twin in element.companions]

        def expression(element: Any = element, companions: Any = companions) -> list[ca.SX]:
            speed = ca.SX.sym("speed")
            slope = ca.jacobian(ca.SX(element.law.sliding(speed, *companions)), speed)
            slope = ca.substitute(element.load * slope, speed, element.mode * element.slip)
            return [ca.substitute(slope, plant.F, plant.switching.force)]

        function = function_of(plant, ("slope", element.name), expression)
        slopes[element.name] = float(function(0.0, point.states, point.inputs, plant.values, m))
    return slopes


def critical_pole(point: Equilibrium) -> tuple[complex, np.ndarray]:
    """The pole with the largest real part (of a pair the one with positive imaginary part), and its eigenvector over all states of the plant.

    The poles that sticking contacts and relays on their surface put at zero do not count.
    """
    plant, m = point.plant, mode_numbers(point.plant, point.modes)
    values, vectors = np.linalg.eig(flow_slopes(point))
    constraints = int(((m == 0.0) & holding_elements(plant)).sum())
    order = np.argsort(np.abs(values))
    keep = np.sort(order[constraints:])
    values, vectors = values[keep], vectors[:, keep]
    best = max(range(values.size), key=lambda i: (values[i].real, values[i].imag))
    return complex(values[best]), vectors[:, best]


def flow_slopes(point: Equilibrium) -> np.ndarray:
    """df/dx over all states at a steady state, in its modes."""
    plant = point.plant
    return np.array(residual_functions(plant)[1](0.0, point.states, point.inputs, plant.values, mode_numbers(plant, point.modes))[0])


# ------------------------------------------------------------------------------------------------------------------------------------- Hopf points
@dataclass(frozen=True)
class HopfPoint:
    """Where a pair of poles +-i w crosses the imaginary axis as a parameter varies.

    value: of the parameter, in `unit`;  frequency: w [rad/s];  point: the steady state there;  stable: "above" or "below", the side on which the pair
    is damped;  coefficient: first Lyapunov coefficient [1/s] for an eigenvector of length one in the states; negative: soft, a small
    swing grows out of the steady state; positive: hard, the machine jumps to a large cycle, and both are stable on the safe side;
    nan where it does not exist;  residual: what is left of the equations, in parts of their terms.
    """

    parameter: str
    unit: str
    value: float
    frequency: float
    point: Equilibrium
    stable: str
    coefficient: float
    residual: float

    @property
    def period(self) -> float:
        """2 pi / w [s]."""
        return 2 * math.pi / self.frequency

    @property
    def kind(self) -> str:
        """ "soft" (supercritical), "hard" (subcritical) or "unknown"."""
        return "soft" if self.coefficient < 0 else "hard" if self.coefficient > 0 else "unknown"

    def __str__(self) -> str:
        return (
            f"Hopf point at {self.parameter} = {self.value:.6g} {self.unit}, stable {self.stable}; period {self.period:.4g} s; {self.kind} loss of "
            f"stability; residual {self.residual:.1e}"
        )


def hopf_points(
    plant: HybridSystem,
    parameter: str,
    between: tuple[float, float],
    *,
    controller: Any = None,
    inputs: Mapping[str, float] | None = None,
    parameters: Mapping[str, Any] | None = None,
    mode: Mapping[str, str] | None = None,
    guess: Mapping[str, Any] | None = None,
    values: int = 33,
) -> list[HopfPoint]:
    """Every Hopf point of steady running in a range of one parameter or input, in order; exact to round-off.

    parameter: of the plant or of its law, or an input, such as `top.reference`, `bit.weight`, `block.damping` or `chain.stiffness.0`.  controller: laws in
    their continuous form.  mode: modes of the steady state, as in `equilibrium`.  guess: {state: value} of one steady state in the range, where
    none is found without, as under a drive whose limits hide it.  values: how many values of the parameter are looked at; two crossings
    between neighbours are missed. A law keeps the design it has on the declared plant. Values without a steady state are
    passed over; where steady running ends in the range, that end is one more value that is looked at. Raises SceneError for unknown names, a range
    that is none, and a plant without any steady state in the range.
    """
    low, high = checked_range(between)
    closed = continuous_loop(plant, controller, inputs=inputs, parameters=parameters)
    knob = Knob.of(closed, parameter)
    followed = Followed(closed, knob, inputs or {}, mode, guess)
    grid = np.linspace(low, high, whole("values", values, 2))
    for value in (*grid, *grid):  # twice: what fails alone may be reached from its neighbours
        followed(float(value))
    if not any(followed.known.values()):
        raise SceneError(f"There is no steady running for `{parameter}` from {low:g} to {high:g} {knob.unit}: {followed.reason}")
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
        for k in range(min(counts), max(counts)):
            near = _crossing(followed, k, a, b)
            if near is not None:
                found.append(_solved(followed, near, "below" if counts[0] < counts[1] else "above"))
    return sorted(found, key=lambda point: point.value)


def hopf_curve(
    plant: HybridSystem,
    parameter: str,
    between: tuple[float, float],
    over: str,
    values: Sequence[float],
    *,
    controller: Any = None,
    inputs: Mapping[str, float] | None = None,
    parameters: Mapping[str, Any] | None = None,
    mode: Mapping[str, str] | None = None,
) -> np.ndarray:
    """Hopf value of one parameter as a function of another, shape (len(values),): the critical speed over weight on bit, over damping, over a gain.

    between: where the first one is looked for;  over, values: the other parameter or input and its values. The outermost Hopf point is given
    where there are several; nan where there is none in the range, or no steady running. Raises SceneError as `hopf_points` does.
    """
    closed = continuous_loop(plant, controller, inputs=inputs, parameters=parameters)
    other, _ = Knob.of(closed, over), Knob.of(closed, parameter)
    checked_range(between)
    curve = []
    for value in numbers("values", values):
        arguments = other.arguments(value, inputs or {})
        try:
            points = hopf_points(closed, parameter, between, mode=mode, **arguments)
        except SceneError as error:
            if "no steady running" not in str(error):
                raise
            points = []
        curve.append(points[-1].value if points else math.nan)
    return np.array(curve)


def pole_locus(
    plant: HybridSystem,
    parameter: str,
    values: Sequence[float],
    *,
    controller: Any = None,
    inputs: Mapping[str, float] | None = None,
    parameters: Mapping[str, Any] | None = None,
    mode: Mapping[str, str] | None = None,
) -> np.ndarray:
    """Poles of steady running while a parameter varies, complex, shape (len(values), number of poles); a row of nan where there is no steady state.

    Columns follow their pole from row to row. For the locus over a loop gain, or a Bode diagram, give what `linearise` returns to `control`.
    """
    from scipy.optimize import linear_sum_assignment

    closed = continuous_loop(plant, controller, inputs=inputs, parameters=parameters)
    followed = Followed(closed, Knob.of(closed, parameter), inputs or {}, mode)
    rows: list[np.ndarray | None] = []
    before: np.ndarray | None = None
    for value in numbers("values", values):
        point = followed(value)
        if point is None:
            rows.append(None)
            continue
        poles = np.sort_complex(np.asarray(linearise(point.plant, point).poles(), complex))
        if before is not None and before.size == poles.size:
            poles = poles[linear_sum_assignment(np.abs(before[:, None] - poles[None, :]))[1]]
        rows.append(poles)
        before = poles
    width = max((row.size for row in rows if row is not None), default=0)
    return np.array([np.full(width, complex(math.nan, math.nan)) if row is None else row for row in rows])


class Followed:
    """The steady states of a closed loop over one knob, each found once, from its neighbour where it is not found by itself."""

    def __init__(
        self,
        closed: HybridSystem,
        knob: Knob,
        inputs: Mapping[str, float],
        mode: Mapping[str, str] | None,
        guess: Mapping[str, Any] | None = None,
    ):
        self.closed, self.knob, self.inputs, self.mode = closed, knob, inputs, mode
        self.guess: np.ndarray | None = None
        if guess:
            self.guess = np.zeros(closed.x.numel())
            place_starts(closed, self.guess, mapping("guess", guess))
        self.known: dict[float, Equilibrium | None] = {}
        self.alone: set[float] = set()
        self.reason = ""

    def __call__(self, value: float) -> Equilibrium | None:
        """The steady state at a value of the knob; None where none is found (`reason` then says why)."""
        if value not in self.known or (value in self.alone and any(self.known.values())):
            self.alone.discard(value)
            if not any(self.known.values()):
                self.alone.add(value)  # to be tried again once a neighbour is known
            self.known[value] = self._found(value, None) or self._approached(value)
            if self.known[value] is not None:
                self.alone.discard(value)
        return self.known[value]

    def _found(self, value: float, start: np.ndarray | None) -> Equilibrium | None:
        begin = None if start is None else state_values(self.closed, start)
        try:
            return equilibrium(self.closed, start=begin, mode=self.mode, **self.knob.arguments(value, self.inputs))
        except SceneError as error:
            if "no steady state" not in str(error):
                raise
            self.reason = str(error)
            return None

    def _approached(self, value: float) -> Equilibrium | None:
        """From the nearest known steady state in ever smaller steps, or by letting the machine relax where none is known."""
        known = [(abs(v - value), v, point) for v, point in self.known.items() if point is not None]
        if not known:
            found = self._found(value, self.guess) if self.guess is not None else None
            return found or self._found(value, self._relaxed(value))
        _, near, point = min(known, key=lambda entry: entry[0])
        for steps in (1, 4, 16, 64):
            reached: Equilibrium | None = point
            for k in range(1, steps + 1):
                reached = self._found(near + (value - near) * k / steps, reached.states) if reached is not None else None
            if reached is not None:
                return reached
        return None

    def _relaxed(self, value: float) -> np.ndarray:
        """Where implicit Euler steps of growing length lead from rest with all contacts in slip: limits and layers of a law do not stop them."""
        arguments = self.knob.arguments(value, self.inputs)
        plant = self.closed.with_parameters(arguments["parameters"]) if arguments["parameters"] else self.closed
        u = input_values(plant, arguments["inputs"])
        residual, slopes = residual_functions(plant)
        x = np.zeros(plant.x.numel())
        m = _modes_at(plant, x, u, self.mode, resting=True)
        a = np.array(slopes(0.0, x, u, plant.values, m)[0])
        step = 0.1 / max(float(np.abs(np.linalg.eigvals(a)).max(initial=0.0)), 1e-9) if np.isfinite(a).all() else 1e-3
        for _ in range(300):
            flow, a = np.array(residual(0.0, x, u, plant.values, m)[0]).ravel(), np.array(slopes(0.0, x, u, plant.values, m)[0])
            if not (np.isfinite(flow).all() and np.isfinite(a).all()):
                break
            x = x + np.linalg.lstsq(np.eye(x.size) / step - a, flow, rcond=None)[0]
            step *= 1.08
        return np.nan_to_num(x)

    def edge(self, there: float, gone: float) -> float:
        """The last value on the way from one with a steady state to one without at which a steady state is found, to a part in 1e7 of the way."""
        point = self(there)
        assert point is not None
        for _ in range(24):
            middle = 0.5 * (there + gone)
            found = self._found(middle, point.states)
            if found is None:
                gone = middle
            else:
                there, point = middle, found
                self.known[middle] = found
        return there

    def growths(self, value: float) -> np.ndarray | None:
        """Real parts of all pairs of poles at a value [1/s], largest first; None without a steady state."""
        point = self(value)
        if point is None:
            return None
        poles = np.linalg.eigvals(flow_slopes(point))
        return np.sort(poles[poles.imag > 1e-9 * np.abs(poles).max(initial=0.0)].real)[::-1]


def _crossing(followed: Followed, k: int, a: float, b: float) -> float | None:
    """A value near which the k-th pair crosses the axis between a and b, to a few digits; None where the pair ends there."""
    from scipy.optimize import brentq

    def growth(value: float) -> float:
        growths = followed.growths(value)
        return math.nan if growths is None else float(growths[k]) if k < growths.size else -1.0

    try:
        value = float(brentq(growth, a, b, xtol=1e-9 * (b - a)))
    except ValueError:  # nan where there is no steady state
        return None
    growths = followed.growths(value)  # where a pair meets on the real axis it ends, with a jump of its real part
    return value if growths is not None and k < growths.size and abs(growths[k]) < 1e-4 * (abs(growth(a)) + abs(growth(b))) else None


def _solved(followed: Followed, guess: float, stable: str) -> HopfPoint:
    """The Hopf point next to a value, from the extended system."""
    from scipy.optimize import root

    closed, knob, inputs = followed.closed, followed.knob, followed.inputs
    given = [name for name in inputs if name != knob.name]
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
    residual, jacobian = _extended(plant, knob, tuple(given), tuple(sticking.tolist()))
    scale = np.concatenate([size, [abs(guess) or 1.0, poles[best].imag], np.ones(2 * n)])
    z = np.concatenate([near.states, [guess, poles[best].imag], v.real, v.imag])

    def equations(y: np.ndarray) -> np.ndarray:
        return np.array(residual(y * scale, near.inputs, plant.values, m, c)).ravel() / rows

    def slopes(y: np.ndarray) -> np.ndarray:
        return np.array(jacobian(y * scale, near.inputs, plant.values, m, c)) * scale / rows[:, None]

    rows = np.ones(1)
    rows = np.abs(slopes(z / scale)).max(axis=1)
    rows[rows == 0.0] = 1.0
    y = root(equations, z / scale, jac=slopes, method="hybr" if not sticking.size else "lm", options={"xtol": 1e-14}).x
    for _ in range(4):
        step = np.linalg.lstsq(slopes(y), -equations(y), rcond=1e-13)[0]
        if np.isfinite(step).all() and np.abs(equations(y + step)).sum() < np.abs(equations(y)).sum():
            y = y + step
    left = float(np.abs(equations(y)).max())
    z = y * scale
    if not left < 1e-8 or not z[n + 1] > 0:
        raise SceneError(
            f"The Hopf point near `{knob.name}` = {guess:g} {knob.unit} could not be solved: {left:.1e} of its equations is left."
        )
    value = float(z[n])
    point = equilibrium(closed, start=state_values(closed, z[:n]), mode=near.modes, **knob.arguments(value, inputs))
    vector = z[n + 2 : 2 * n + 2] + 1j * z[2 * n + 2 :]
    coefficient = _lyapunov_coefficient(point, m, float(z[n + 1]), vector) if not sticking.size else math.nan
    return HopfPoint(knob.name, knob.unit, value, float(z[n + 1]), point, stable, coefficient, left)


def _extended(plant: HybridSystem, knob: Knob, given: tuple[str, ...], sticking: tuple[int, ...]) -> tuple[ca.Function, ca.Function]:
    """Functions (z, u, p, m, c) -> residual of the extended system and its Jacobian by z = (x, q, w, Re v, Im v)."""
    key = ("hopf", knob.name, knob.is_input, given, sticking)
    found = plant.kernels.get(key)
    if found is None:
        n = plant.x.numel()
        w, vr, vi, c = ca.SX.sym("w"), ca.SX.sym("vr", n), ca.SX.sym("vi", n), ca.SX.sym("c", 2 * n)
        field = plant.switching.field
        slip = ca.vertcat(*[plant.switching.slip[i] for i in sticking]) if sticking else ca.SX(0, 1)
        # an input that nobody gives follows the parameters, which the knob may be one of
        u = ca.vertcat(*[entry.symbol if name in given or name == knob.name else entry.default for name, entry in plant.inputs.items()])
        if plant.inputs:
            field, slip = ca.substitute([field, slip], [plant.u], [u])
        a = ca.jacobian(field, plant.x)
        q = plant.inputs[knob.name].symbol if knob.is_input else plant.p[plant._parameter(knob.name).offset]
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
        found = plant.kernels[key] = (ca.Function("extended", symbols, [equations]), ca.Function("slopes", symbols, [jacobian]))
    return found


def _lyapunov_coefficient(point: Equilibrium, m: np.ndarray, w: float, q: np.ndarray) -> float:
    """First Lyapunov coefficient at a Hopf point (Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, 3rd ed., eq. 5.39).

        l1 = Re[ <p, C(q, q, q*)> - 2 <p, B(q, A^-1 B(q, q*))> + <p, B(q*, (2 i w - A)^-1 B(q, q))> ] / (2 w)

    with A q = i w q, A' p = -i w p, <q, q> = <p, q> = 1, and B, C the second and third derivatives of the flow.
    """
    plant = point.plant
    n = plant.x.numel()

    function = plant.kernels.get("directional")
    if function is None:
        d1, d2, d3 = (ca.SX.sym(f"d{i}", n) for i in (1, 2, 3))
        second = ca.jtimes(ca.jtimes(plant.switching.field, plant.x, d1), plant.x, d2)
        symbols = [plant.x, plant.u, plant.p, plant.m, d1, d2, d3]
        forms = ca.substitute([ca.densify(second), ca.densify(ca.jtimes(second, plant.x, d3))], [plant.t], [ca.SX(0)])
        function = plant.kernels["directional"] = ca.Function("directional", symbols, forms)

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
