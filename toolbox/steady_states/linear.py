"""A plant as a linear system around a steady state: `equilibrium` finds the state, `linearise` the matrices.

The right-hand side with the modes as numbers is one smooth expression per set of modes, so its Jacobians are exact; nothing is differenced.

Why sticking takes states away: an element in stick adds the constraint slip = 0 and the force that keeps it. The full Jacobian then has a
zero row and a pole at 0 that no input moves and no output sees move. That pole belongs to no motion of the machine, so `linearise` solves the
constraint for one state per sticking element and leaves that state out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from toolbox.arguments import mapping, number
from toolbox.errors import NoSteadyState, SceneError, suggest
from toolbox.modelling.clamps import opened
from toolbox.modelling.closed_loop import ClosedLoop, states_of, takes_loop
from toolbox.modelling.components import structure_of
from toolbox.modelling.design_fields import motion_of
from toolbox.modelling.hybrid_system import HybridSystem, checked_plant
from toolbox.modelling.laws import names as names_of
from toolbox.modelling.numeric import NumericFunction
from toolbox.modelling.start import place_start, place_starts
from toolbox.modelling.steady_point import Equilibrium, _code, closed_signal, function_of
from toolbox.simulation.samples import Samples
from toolbox.steady_states.zeros import CONTRACTION, newton, past_limits, searched, vanishes

if TYPE_CHECKING:
    import control


@takes_loop
def equilibrium(loop: ClosedLoop, *, guess: Mapping[str, Any] | None = None, mode: Mapping[str, str] | None = None) -> Equilibrium:
    """Find the steady state dx/dt = 0 for constant inputs and given modes of the contacts.

    A state on which no equation depends may change at a constant rate, such as the angle of a shaft that turns: it
    keeps its start value in the result. Every sliding contact slides in the direction of its mode. Controllers take part in their continuous form. If the
    plant depends on time, the time is 0.

    Parameters
    ----------
    loop
        A loop with constant inputs, or a plant.
    guess
        Start of the search: {state, or signal that is a state: value}. By default the search begins at the steady state
        that the plant would have without friction. If friction that falls with speed gives several steady states, this
        start leads to the steady state of the highest speed.
    mode
        {contact or relay: mode}, such as {"bit": "stick"}. Modes of a contact are "slip+", "slip-" and "stick". By
        default contacts slide in the direction in which they slide at the start ("slip+" at zero slip), and relays
        are on their surface.

    Returns
    -------
    Equilibrium
        The steady state. `rest["bit.speed"]` reads a signal.

    Raises
    ------
    NoSteadyState
        If no steady state is found, or the steady state contradicts its modes.
    SceneError
        If the argument is neither a loop nor a plant, an input varies in time, or a name is unknown.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, equilibrium
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> rest = equilibrium(loop)
    >>> print(f"{rest['top.torque']:.0f} N m at {rest['bit.speed']:.2f} rad/s")
    10546 N m at 6.28 rad/s
    """
    loop = loop.continuous_loop
    return steady_state(loop.system, loop.constant_inputs("a steady state"), guess, mode, loop.display_units)


def steady_state(
    plant: HybridSystem,
    inputs: Mapping[str, Any] | None = None,
    guess: Mapping[str, Any] | None = None,
    mode: Mapping[str, str] | None = None,
    display_units: Mapping[str, str] | None = None,
) -> Equilibrium:
    """Find the steady state of a plant that holds its controllers as parts.

    `equilibrium` does the same for a loop.

    Parameters
    ----------
    plant
        A plant, with its controllers among its parts.
    inputs
        {input: constant value}. Inputs that are left out keep their defaults.
    guess
        Start of the search: {state: value}.
    mode
        {contact: mode}. By default the modes that the contacts have at the guess.
    display_units
        {SI unit: unit in which the result is shown}.

    Returns
    -------
    Equilibrium
        The steady state.

    Raises
    ------
    NoSteadyState
        If no steady state is found, or the steady state contradicts its modes.
    SceneError
        If a name is unknown, or an input varies in time.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.steady_states.linear import steady_state
    >>> rest = steady_state(compose(wells.JANSEN_2, BitRock(weight="97 kN")), {"top.torque": 12e3})
    >>> print(f"{rest['bit.speed']:.2f} rad/s")
    9.38 rad/s
    """
    plant = _checked(plant)
    u = input_values(plant, inputs or {})
    given = plant.begin.copy()
    place_starts(plant, given, mapping("guess", guess))
    free = _free(plant)
    reason = ""
    for begin, limits in _begins(plant, u, given, bool(guess)):
        m = _modes_at(plant, begin, u, mode, resting=True)
        sticking = (m == 0.0) & holding_elements(plant)
        equations, slopes = _rows(*residual_functions(plant), plant, u, m, given)
        method = "lm" if sticking.any() else "hybr"
        if limits is not None:
            wide = _rows(limits.residual, limits.jacobian, plant, u, m, given)
            begin = past_limits(*wide, partial(_held_back, limits, plant, u, m), limits.count, begin, method)

        def terms(x: np.ndarray, equations: Any = equations, slopes: Any = slopes) -> np.ndarray:
            """Return the sizes of the terms that cancel in the equations. Their round-off limits the accuracy; a sticking force may cancel
            all others."""
            load, slope = (np.array(v) for v in free(0.0, x, u, plant.values, 1.0))
            size = np.abs(slopes(x)) @ np.abs(x) + np.abs(equations(plant.begin)) + 1e-300
            size[: x.size] += np.abs(load).ravel() + np.abs(slope) @ np.abs(x)
            return size

        x = newton(equations, slopes, begin, 12, CONTRACTION)  # from near a zero, as along a branch, a search from afar costs more
        if not vanishes(equations(x), terms(x), slopes(x), x.size):
            x = searched(equations, slopes, begin, method)
        clean = np.where(np.abs(x) > 1e-13 * np.abs(x).max(initial=0.0), x, 0.0)  # what should be zero shows as zero
        if np.abs(equations(clean)).sum() <= np.abs(equations(x)).sum() + 1e-300:
            x = clean
        found = equations(x)
        size = terms(x)
        if not vanishes(found, size, slopes(x), x.size):
            parts = np.abs(found[: x.size]) / size[: x.size]
            worst = int(np.argmax(np.where(np.isnan(parts), -1.0, parts)))  # near the largest numbers all of them may be nan
            label, unit = state_labels(plant)[worst]
            if limits is None:
                reason = f"the search stops where `{label}` still changes by {found[worst]:.3g} {unit} per second"
            continue
        contradiction = _contradiction(plant, x, u, m)
        if contradiction:
            reason = f"the only state found contradicts its mode: {contradiction}"
            continue
        modes = {element.name: element.mode_names[int(v)] for element, v in zip(plant.elements, m, strict=True)}
        return Equilibrium(plant, x, u, modes, plant.display_units if display_units is None else display_units)
    given_inputs = ", ".join(f"{name} = {value:g}" for name, value in zip(plant.inputs, u, strict=True)) or "no inputs"
    tried = [f"`{e.name}` in {e.mode_names[int(v)]}" for e, v in zip(plant.elements, m, strict=True) if e.law is not None]
    tried = tried if len(tried) <= 3 else [f"{len(tried)} contacts in their modes"]
    words = f" with {', '.join(tried)}" if tried else ""
    raise NoSteadyState(
        f"There is no steady state for {given_inputs}{words}: {reason}. Give other `inputs`, a `mode`, or a `guess` nearer to it."
    )


def _begins(plant: HybridSystem, u: np.ndarray, given: np.ndarray, guessed: bool) -> Iterator[tuple[np.ndarray, OpenLimits | None]]:
    """Where a search begins, and the limits that it passes: none at first, then those of the plant where nothing has been found."""
    if not guessed:
        yield _frictionless(_free(plant), plant, u), None
    yield given, None
    limits = open_limits(plant)
    if limits is not None:
        if not guessed:
            yield _frictionless(limits.free, plant, u, np.ones(limits.count)), limits
        yield given, limits


Rows = Callable[..., np.ndarray]
"""A function of the states, and of the shares of open limits."""


def _rows(
    residual: NumericFunction, jacobian: NumericFunction, plant: HybridSystem, u: np.ndarray, m: np.ndarray, given: np.ndarray
) -> tuple[Rows, Rows]:
    """The equations of a steady state, which are the flow and the slips of the contacts in stick, and their slopes by the states.

    given: values that integrals on which nothing depends keep.
    """
    sticking, kept = (m == 0.0) & holding_elements(plant), np.diag(integrals_of(plant).astype(float))

    def equations(x: np.ndarray, *share: np.ndarray) -> np.ndarray:
        flow, slip = residual(0.0, x, u, plant.values, m, *share)
        return np.concatenate([np.array(flow).ravel() + kept @ (x - given), np.array(slip).ravel()[sticking]])

    def slopes(x: np.ndarray, *share: np.ndarray) -> np.ndarray:
        of_flow, of_slip = jacobian(0.0, x, u, plant.values, m, *share)
        return np.vstack([np.array(of_flow) + kept, np.array(of_slip)[sticking]])

    return equations, slopes


@dataclass(frozen=True)
class OpenLimits:
    """Functions (t, x, u, p, m, shares) of a plant with limits that let shares of their signals pass (`toolbox.modelling.clamps.opened`).

    count: number of limits;  residual, jacobian: as those of `residual_functions`;  free: as `_free`;  held_back: what the limits hold back.
    """

    count: int
    residual: NumericFunction
    jacobian: NumericFunction
    free: NumericFunction
    held_back: NumericFunction


def _held_back(limits: OpenLimits, plant: HybridSystem, u: np.ndarray, m: np.ndarray, x: np.ndarray, share: np.ndarray) -> np.ndarray:
    """What the limits hold back at a place."""
    return limits.held_back(0.0, x, u, plant.values, m, share).ravel()


def open_limits(plant: HybridSystem) -> OpenLimits | None:
    """The functions of a plant with open limits; None for a plant without limits."""

    def functions() -> OpenLimits | None:
        equations = plant.switched_equations
        values, shares, held_back = opened([at_rest(plant, equations.field), equations.slip, _free_flow(plant)], plant.x)
        if not shares.numel():
            return None
        arguments = [plant.t, plant.x, plant.u, plant.p, plant.m, shares]
        slopes = [ca.jacobian(value, plant.x) for value in values]
        results = [values[:2], slopes[:2], [values[2], slopes[2]], [held_back]]
        made = [NumericFunction(ca.Function("limits", arguments, [ca.densify(each) for each in result])) for result in results]
        return OpenLimits(shares.numel(), *made)

    return plant.once(("open limits",), functions)


@takes_loop
def linearise(
    loop: ClosedLoop,
    at: Mapping[str, Any] | Equilibrium | Samples | None = None,
    mode: Mapping[str, str] | None = None,
    inputs: str | Sequence[str] | None = None,
    outputs: str | Sequence[str] | None = None,
) -> control.StateSpace:
    """Linearise a plant or a closed loop around a point.

    The result is a `control.StateSpace` with named states, inputs and outputs, computed from exact Jacobians.

    - The point need not be a steady state. At any other point the matrices describe small deviations from the motion
      through this point, with the time held constant.
    - One state per sticking contact is left out of the result, because stick makes it a function of the other states:
      the state with the largest coefficient in the slip of the contact, and among equal coefficients the last state. For
      a bit in stick on a chain of two inertias, this is `chain.speed.1`, the speed of the bit. At the point, such a state
      has the value for which the slip is zero, unless `at` gives the state.
    - Names have "_" in place of ".", because python-control reserves the dot: `sys["bit_speed", "top_torque"]`, states
      `chain_speed[0]`.

    Parameters
    ----------
    loop
        A plant, or a loop whose controllers take part in their continuous form.
    at
        The point: an `Equilibrium`, one instant of a run (`run.at(12.5)`), or {state, signal that is a state, or input:
        value}. States that the mapping leaves out have their default start value, usually 0. Inputs that it leaves out
        have their value in the loop, else their default. If `at` is the steady state of a loop around this plant, only
        the plant is linearised there.
    mode
        {contact or relay: mode}, such as {"bit": "stick"}. By default the modes of `at`. If `at` has no modes, each mode
        follows from the slip v of the contact, or from the value v of the switching surface of the relay, at the point:
        "slip+" for v > 0 and "slip-" for v < 0. At v = 0 a contact is in "slip+" (in "stick" if it slips in two
        directions), and a relay in "stick": it keeps its surface at zero.
    inputs
        Names of the inputs to keep. By default all.
    outputs
        Names of the signals to keep. By default all scalar signals.

    Returns
    -------
    control.StateSpace
        The linear system.

    Raises
    ------
    SceneError
        If the plant has sampled controllers, a name is unknown, the modes contradict the point, or an input moves the
        slip of a sticking contact.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, equilibrium, linearise
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), inputs={"top.torque": "12 kN m"})
    >>> system = linearise(loop, equilibrium(loop), inputs="top.torque", outputs="bit.speed")
    >>> print(f"{system.dcgain().item():.2e} rad/s per N m")
    2.11e-03 rad/s per N m
    """
    import control

    if isinstance(inputs, Mapping):
        raise SceneError(
            "Argument `inputs` must name the inputs to keep; their values belong to the loop: `closed_loop(plant, inputs={...})`."
        )
    plant, constant = loop.unsampled().system, loop.constant_inputs("a linear system")
    if isinstance(at, Equilibrium) and plant is not at.plant and not loop.parameters:
        plant = _with_numbers_of(plant, at.plant)
    plant = _checked(plant)
    t, x, u, m = _point(plant, at, mode, constant)
    kept_inputs = _kept(plant, inputs, list(plant.inputs), "input")
    scalar = [name for name, (expression, _) in plant.signals.items() if expression.numel() == 1]
    kept_outputs = _kept(plant, outputs, scalar, "signal", known=[*plant.signals, *plant.inputs])

    def jacobians() -> list[ca.SX]:
        y = ca.vertcat(*[closed_signal(plant, name) for name in kept_outputs])
        return [ca.jacobian(a, b) for a in (plant.switched_equations.field, y, plant.switched_equations.slip) for b in (plant.x, plant.u)]

    function = function_of(plant, ("jacobians", *kept_outputs), jacobians)
    a, b, c, d, slip_x, slip_u = (np.array(matrix) for matrix in function(t, x, u, plant.values, m))
    if not all(np.isfinite(matrix).all() for matrix in (a, b, c, d)):
        raise SceneError("The plant has no finite slope at this point: move `at` away from the kink or pole of its equations.")

    sticking = np.flatnonzero((m == 0.0) & holding_elements(plant))
    # an input that shifts the constraint acts through its rate, which a state space cannot say
    movers = {
        name: i for i in sticking[::-1] for name, moved in zip(plant.inputs, slip_u[i], strict=True) if moved != 0.0 and name in kept_inputs
    }
    if movers and inputs is not None:
        name, i = min(movers.items(), key=lambda each: each[1])
        raise SceneError(f"Argument `inputs` must not hold `{name}`, because it moves the slip of the sticking `{plant.elements[i].name}`.")
    kept_inputs = [name for name in kept_inputs if name not in movers]
    columns = [list(plant.inputs).index(name) for name in kept_inputs]
    free, lift = _constrained(slip_x[sticking])
    labels = [name for name, _ in state_labels(plant, control_names=True)]
    return control.ss(
        (a @ lift)[free],
        b[free][:, columns],
        c @ lift,
        d[:, columns],
        name="linearised",
        states=[labels[i] for i in free],
        inputs=[control_name(name) for name in kept_inputs],
        outputs=[label for name in kept_outputs for label in _control_labels(plant, name)],
        remove_useless_states=False,
    )


# ---------------------------------------------------------------------------------------------------------------------------- points and modes
def _with_numbers_of(plant: HybridSystem, other: HybridSystem) -> HybridSystem:
    """A plant with the numbers of another of its structure, or of a loop that holds it; raises SceneError for any other."""
    if plant.cache is other.cache:
        return other
    if {structure_of(part) for part in plant.parts} <= {structure_of(part) for part in other.parts}:
        return plant.with_parameters({name: other.parameter(name) for name in plant.parameters if other.has_parameter(name)})
    raise SceneError("Argument `at` must be a steady state of `plant`, or of a loop with it, but it belongs to another plant.")


def _checked(plant: HybridSystem) -> HybridSystem:
    checked_plant(plant)
    if plant.updates:
        raise SceneError("Argument `plant` must not hold sampled laws: compose their continuous form to linearise the loop.")
    return plant


def input_values(plant: HybridSystem, given: Mapping[str, Any]) -> np.ndarray:
    """Return the values of all inputs of a plant, with defaults for inputs that are left out.

    Parameters
    ----------
    plant
        The plant.
    given
        {input: number}, in SI.

    Returns
    -------
    array, shape (inputs,)
        The values in the order of `plant.inputs`.

    Raises
    ------
    SceneError
        If a name is unknown, or a number is not finite.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.steady_states.linear import input_values
    >>> print(input_values(compose(wells.JANSEN_2, BitRock(weight="97 kN")), {"top.torque": 12e3}))
    [12000. 97000.]
    """
    u = np.array(plant.input_defaults(plant.values)).ravel()
    for name, value in mapping("inputs", given).items():
        value = number(name, value, plant.input(name).unit)
        if name in plant.parameters:
            plant.parameters[name].check(value)
        u[list(plant.inputs).index(name)] = value
    return u


def _modes_at(
    plant: HybridSystem, x: np.ndarray, u: np.ndarray, mode: Mapping[str, str] | None, t: float = 0.0, resting: bool = False
) -> np.ndarray:
    """Modes as given, else from the direction of slip at a point. At zero slip contacts slide forwards and relays stay on their surface.

    resting: a steady state is sought, and then a relay is on its surface wherever the search begins.
    """
    names = [element.name for element in plant.elements]
    for name, word in mapping("mode", mode).items():
        _code(plant.element(name), word)
    probe = function_of(plant, ("probe",), lambda: [plant.switched_equations.probed])
    slips = np.array(probe(t, x, u, plant.values, np.ones(len(names)))).ravel()[: len(names)]
    zero = 1e-12 * float(np.abs(x).max(initial=0.0))
    modes = np.where(slips < 0, -1.0, 1.0)
    for i, element in enumerate(plant.elements):
        if mode and element.name in mode:
            modes[i] = _code(element, mode[element.name])
        elif not element.slides:
            modes[i] = element.initial
        elif (element.law is None and (resting or abs(slips[i]) <= zero)) or (
            element.directions > 1 and slips[i] <= zero
        ):  # slip without a direction
            modes[i] = 0.0
    for i, element in enumerate(plant.elements):
        if element.second:
            modes[i] = modes[i - 1]
    chosen = set(mode or {})
    for _ in range(2 * len(names)):  # a contact or switch whose mode is not given is where its guard is positive
        guards = _guards(plant, t, x, u, modes)
        wrong = [i for i, e in enumerate(plant.elements) if not e.slides and e.name not in chosen and guards[i] < 0.0]
        if not wrong:
            break
        for i in wrong:
            modes[i] = 1.0 - modes[i]
    return modes


def holding_elements(plant: HybridSystem) -> np.ndarray:
    """Return for every contact and relay whether its mode 0 holds its slip.

    Parameters
    ----------
    plant
        The plant.

    Returns
    -------
    array of bool, shape (elements,)
        True for a contact with dry friction, for example.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.steady_states.linear import holding_elements
    >>> print(holding_elements(compose(wells.JANSEN_2, BitRock())))
    [ True]
    """
    return np.array([element.holds for element in plant.elements], bool)


def _guards(plant: HybridSystem, t: float, x: np.ndarray, u: np.ndarray, m: np.ndarray) -> np.ndarray:
    """The first guard of every element, positive while its mode holds."""
    if not plant.elements:
        return np.empty(0)
    function = function_of(plant, ("guards",), lambda: [plant.switched_equations.guards])
    return np.array(function(t, x, u, plant.values, m)).ravel()[: 2 * len(plant.elements) : 2]


def _contradiction(plant: HybridSystem, x: np.ndarray, u: np.ndarray, m: np.ndarray, t: float = 0.0) -> str:
    """What speaks against the modes at a point; empty where nothing does."""
    probe = function_of(plant, ("probe",), lambda: [plant.switched_equations.probed])
    slips, _, forces, bounds, _ = np.array(probe(t, x, u, plant.values, m)).reshape(5, len(plant.elements))
    size = float(np.abs(x).max(initial=0.0))
    guards = _guards(plant, t, x, u, m)
    for element, mode, slip, force, bound, guard in zip(plant.elements, m, slips, forces, bounds, guards, strict=True):
        if element.second:
            continue
        if not element.slides:
            scale = bound if element.rigid and mode == 0.0 else size
            if guard < -1e-9 * scale or (element.rigid and mode == 0.0 and abs(slip) > 1e-9 * size):
                return f"`{element.name}` is not {element.mode_names[int(mode)]} there"
            continue
        if mode * slip < -1e-9 * size or (element.directions > 1 and mode and slip <= 1e-12 * size):
            return f"`{element.name}` in {element.mode_names[int(mode)]} has the slip {_with_unit(slip, element.slip_unit)}"
        if mode == 0.0 and abs(slip) > 1e-9 * size:
            return f"`{element.name}` in stick has the slip {_with_unit(slip, element.slip_unit)}"
        if mode == 0.0 and not abs(force) <= bound * (1.0 + 1e-9):
            needed = _with_unit(abs(force), element.force_unit)
            return f"`{element.name}` in stick needs a force of {needed}, but its bound is {_with_unit(bound, element.force_unit)}"
    return ""


def _point(
    plant: HybridSystem, at: Any, mode: Mapping[str, str] | None, values: Mapping[str, float]
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """(t, x, u, m) of `linearise`."""
    x = plant.begin.copy()
    t, own, given = 0.0, mapping("mode", mode), dict(values)
    placed = np.zeros(x.size, bool)
    if isinstance(at, Equilibrium) and at.plant.cache is not plant.cache:
        for name in plant.states:
            place_start(plant, x, name, at[name])
        placed[:] = True
        own = {element.name: at.modes[element.name] for element in plant.elements} | own
        given = {name: float(at[name]) for name in plant.inputs} | given
    elif isinstance(at, Equilibrium):
        x[:] = at.states
        placed[:] = True
        own = dict(at.modes) | own
        given = dict(zip(plant.inputs, at.inputs.tolist(), strict=True)) | given
    elif isinstance(at, Samples):
        place_starts(plant, x, states_of(at, plant, "at"))
        t, placed[:] = float(at.time[0]), True
        ran = [element.name for element in at.program.system.elements]
        own = {e.name: e.mode_names[int(at.mode[0, ran.index(e.name)])] for e in plant.elements if e.name in ran} | own
        given = {name: float(np.ravel(at[name])[0]) for name in plant.inputs if name in at} | given
    elif isinstance(at, Mapping):
        mark = np.full(x.size, np.nan)
        place_starts(plant, mark, {name: value for name, value in at.items() if name not in plant.inputs})
        placed = ~np.isnan(mark)
        x[placed] = mark[placed]
        given = {name: value for name, value in at.items() if name in plant.inputs} | given
    elif at is not None:
        raise SceneError(f"Argument `at` must be a mapping, an equilibrium or one instant of a run, but it is {at!r}.")
    u = input_values(plant, given)
    m = _modes_at(plant, x, u, own, t)
    if (m == 0.0).any():
        project = function_of(plant, ("project",), lambda: [plant.switched_equations.projected])
        stuck = np.array(project(t, x, u, plant.values, m)).ravel()
        x = np.where(placed, x, stuck)
    contradiction = _contradiction(plant, x, u, m, t)
    if contradiction:
        raise SceneError(f"Argument `mode` must agree with the point, but {contradiction}.")
    return t, x, u, m


def _free(plant: HybridSystem) -> NumericFunction:
    """Function (t, x, u, p, m) -> flow without the forces of the elements, and its Jacobian by x."""

    def expressions() -> list[ca.SX]:
        flow = _free_flow(plant)
        return [flow, ca.jacobian(flow, plant.x)]

    return function_of(plant, ("free",), expressions)


def _free_flow(plant: HybridSystem) -> ca.SX:
    return at_rest(plant, ca.substitute(plant.flow, plant.F, ca.SX.zeros(plant.F.shape)) if plant.elements else plant.flow)


def integrals_of(plant: HybridSystem) -> np.ndarray:
    """Whether each state is an integral on which no equation depends, as the angle of a shaft may be; shape (states,)."""

    read = plant.once(("read states",), lambda: np.array(ca.DM(ca.jacobian(motion_of(plant), plant.x).sparsity())).any(axis=0))
    return np.array(~read)


def at_rest(plant: HybridSystem, flow: ca.SX) -> ca.SX:
    """Return the flow of all states that must vanish in a steady state. An integral may keep growing if nothing depends on it."""
    integrals = integrals_of(plant)
    return flow * ca.SX(ca.DM(np.where(integrals, 0.0, 1.0))) if integrals.any() else flow


def _frictionless(free: NumericFunction, plant: HybridSystem, u: np.ndarray, *share: np.ndarray) -> np.ndarray:
    """Where the plant would rest without the forces of its elements: a few Newton steps from zero. free: function of `_free`, or of a share, too."""
    x = plant.begin.copy()
    for _ in range(8):
        value, slope = (np.array(v) for v in free(0.0, x, u, plant.values, 1.0, *share))
        if not (np.isfinite(value).all() and np.isfinite(slope).all()):
            return np.zeros_like(x)
        step = np.linalg.lstsq(slope, -value.ravel(), rcond=1e-12)[0]
        x = x + step
        if np.abs(step).max(initial=0.0) <= 1e-12 * np.abs(x).max(initial=0.0):
            return x
    return _descended(free, plant, u, *share)


def _descended(free: NumericFunction, plant: HybridSystem, u: np.ndarray, *share: np.ndarray) -> np.ndarray:
    """Where it would rest by steps that only go down: a law that cuts its command throws full Newton steps from one limit to the other."""
    from scipy.optimize import least_squares

    def values(x: np.ndarray, of: int = 0) -> np.ndarray:
        return np.array(free(0.0, x, u, plant.values, 1.0, *share)[of])

    try:
        return least_squares(lambda x: values(x).ravel(), plant.begin, lambda x: values(x, 1), x_scale="jac", method="trf").x
    except ValueError:  # rates that are not finite somewhere
        return plant.begin.copy()


def residual_functions(plant: HybridSystem) -> tuple[NumericFunction, NumericFunction]:
    """Return the functions whose zero is a steady state, and their Jacobians.

    Parameters
    ----------
    plant
        The plant.

    Returns
    -------
    function, function
        (t, x, u, p, m) -> (flow, slip), and (t, x, u, p, m) -> their Jacobians by x.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.steady_states.linear import residual_functions
    >>> print(len(residual_functions(compose(wells.JANSEN_2, BitRock()))))
    2
    """
    values = [at_rest(plant, plant.switched_equations.field), plant.switched_equations.slip]
    slopes = function_of(plant, ("slopes",), lambda: [ca.jacobian(value, plant.x) for value in values])
    return function_of(plant, ("residual",), lambda: values), slopes


def _constrained(slope: np.ndarray) -> tuple[list[int], np.ndarray]:
    """States that stay free under slope @ x = 0, and the matrix that gives all states from them.

    Each constraint is solved for the state it holds with the largest factor, the last one among equals, by elimination.
    """
    n = slope.shape[1]
    rows = slope.copy()
    pivots: list[int] = []
    for i in range(rows.shape[0]):
        size = np.abs(rows[i])
        pivot = n - 1 - int(np.argmax(size[::-1]))
        rows[i] /= rows[i, pivot]
        for other in range(rows.shape[0]):
            if other != i:
                rows[other] -= rows[other, pivot] * rows[i]
        pivots.append(pivot)
    free = [i for i in range(n) if i not in pivots]
    lift = np.zeros((n, len(free)))
    lift[free, range(len(free))] = 1.0
    for i, pivot in enumerate(pivots):
        lift[pivot] = -rows[i, free]
    return free, lift


# ----------------------------------------------------------------------------------------------------------------------------------------- names
def _kept(plant: HybridSystem, wanted: Any, everything: list[str], kind: str, known: Sequence[str] | None = None) -> list[str]:
    if wanted is None or isinstance(wanted, Mapping):
        return everything
    names = list(names_of(wanted))
    if not names:
        raise SceneError(f"There must be at least one {kind}, but none is named.")
    for name in names:
        if name not in (known or everything):
            raise SceneError(f"There is no {kind} `{name}`: {suggest(str(name), known or everything)}")
    return names


def state_labels(plant: HybridSystem, control_names: bool = False) -> list[tuple[str, str]]:
    """Return name and unit of every entry of the state.

    Parameters
    ----------
    plant
        The plant.
    control_names
        Whether names have "_" in place of ".", as python-control needs.

    Returns
    -------
    list of (str, str)
        Name and unit of each entry.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.steady_states.linear import state_labels
    >>> for name, unit in state_labels(compose(wells.JANSEN_2, BitRock())):
    ...     print(f"{name} [{unit}]")
    chain.twist.0 [rad]
    chain.speed.0 [rad/s]
    chain.speed.1 [rad/s]
    """
    out = []
    for name, (_, size, unit) in plant.states.items():
        labels = _control_labels(plant, name) if control_names else [name] if size is None else [f"{name}.{i}" for i in range(size)]
        out += [(label, unit) for label in labels]
    return out


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.5g}" if unit == "1" else f"{value:.5g} {unit}"


def control_name(name: str) -> str:
    """Return a name of the toolbox in the form that python-control takes, with "_" for every dot.

    Parameters
    ----------
    name
        Name of a signal, such as "bit.speed".

    Returns
    -------
    str
        The name without dots.

    Examples
    --------
    >>> from toolbox.steady_states.linear import control_name
    >>> print(control_name("chain.speed.0"))
    chain_speed_0
    """
    return name.replace(".", "_")


def _control_labels(plant: HybridSystem, name: str) -> list[str]:
    size = plant.states[name][1] if name in plant.states else None
    if size is None and name in plant.signals and plant.signals[name][0].numel() > 1:
        size = plant.signals[name][0].numel()
    return [control_name(name)] if size is None else [f"{control_name(name)}[{i}]" for i in range(size)]
