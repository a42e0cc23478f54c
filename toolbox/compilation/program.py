"""A closed system compiled for one kind of inputs."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from toolbox.compilation.moreau_jean import Theta
from toolbox.compilation.rosenbrock import RODAS5P, Rosenbrock
from toolbox.compilation.runge_kutta import DOP853, Pair
from toolbox.compilation.taylor import TOO_LONG, Taylor, peaks_in_time, series_of
from toolbox.modelling.elements import SecondDirection
from toolbox.modelling.elimination import calls, coupled_groups
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.inputs import Shape
from toolbox.modelling.switching import Switching, depending, switching
from toolbox.modelling.two_directions import resolution


@dataclass
class Program:
    """A closed system compiled for one kind of inputs: everything about a run but its numbers.

    layout of the parameter vector: values of the system, then coefficients of inputs, then, with friction in two slip directions, what it is resolved by
    (`toolbox.modelling.two_directions`), then what changes during a run (`first_held` on): held signals, then (value, slope, time) of every table.
    `excited` names the elements with hidden forces (see `toolbox.stepping.event_stepper`), `varying` those whose bound is not constant, `bounded` those of
    them whose bound is a guard, since nothing else keeps it from becoming negative, and `forced` says that time enters nonlinearly, so that steps must not
    outgrow what happens in it. `updates` holds (memory and noise, next memory, outputs) of every sampled law in terms of t, x, p and the modes.
    """

    system: HybridSystem
    pair: Pair | Rosenbrock | Theta | Taylor
    kernel: Any
    p_size: int
    coefficient_slot: dict[str, int]
    held_slot: int
    table_slot: dict[str, int]
    first_held: int
    excited: np.ndarray
    kind: np.ndarray
    initial: np.ndarray
    attached: np.ndarray
    loader: np.ndarray
    varying: list[int]
    bounded: list[int]
    forced: bool
    groups: np.ndarray
    group_count: int
    outputs: dict[Any, Any]
    updates: list[tuple[ca.SX, ca.SX, ca.SX]]
    expressions: tuple[ca.SX, ...]
    form: Switching

    def lacking(self, pair: Taylor, kinds: tuple[tuple[str, Any], ...]) -> str:
        """Why a run that asked for these series steps by the formulas of this program; empty where it steps by series."""
        return (
            ""
            if isinstance(self.pair, Taylor)
            else f"{self.pair.name}: {self.system.kernels.get(('lacking', ('program', kinds, pair.name)), TOO_LONG)}"
        )

    @cached_property
    def ints(self) -> np.ndarray:
        """What the compiled loops ask of a program: its sizes and addresses, at their places in `Work.ints`."""
        from toolbox.compilation import work_layout

        kernel, ints = self.kernel, np.zeros(work_layout.INTS, np.int64)
        ints[work_layout.N], ints[work_layout.NE], ints[work_layout.NG] = kernel.states, kernel.elements, kernel.guards
        ints[work_layout.COUPLED] = kernel.coupled
        ints[work_layout.BOUNDS] = len(self.bounded)
        ints[work_layout.FIRST_HELD] = self.first_held
        ints[list(work_layout.FORMULAS)] = *kernel.addresses, self.pair.order, self.pair is RODAS5P, bool(self.pair.error_low)
        return ints


def program_of(system: HybridSystem, kinds: tuple[tuple[str, Any], ...], pair: Pair | Rosenbrock | Theta | Taylor) -> Program:
    """The compiled program of a closed system for inputs of the given kinds (see `toolbox.simulate`); cached with the system's structure.

    Where Taylor series do not exist or would be too long, it is one of DOP853.
    """
    key = ("program", kinds, pair.name)
    if key in system.kernels:
        return system.kernels[key]
    from toolbox.compilation import work_layout
    from toolbox.compilation.kernel import equations, kernel_of

    u, coefficients, tables, coefficient_slot, table_slot = _placed_inputs(system, dict(kinds))
    if any(isinstance(element, SecondDirection) for element in system.elements):
        coefficients.append(resolution)
    first_held = system.p.numel() + sum(c.numel() for c in coefficients)
    held_size = system.held.numel()
    p = ca.vertcat(system.p, *coefficients, system.held, *tables)

    def closed(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, system.u, u) if system.inputs else expression

    elements = []
    for element in system.elements:
        twin = copy.copy(element)
        for kind in element.expressions:
            setattr(twin, kind, closed(getattr(element, kind)))
        elements.append(twin)
    flow = closed(system.flow)
    changing = ca.vertcat(system.t, system.x, system.held, *tables)
    rubbing = [i for i, e in enumerate(elements) if not e.unilateral]
    varying = [rubbing[k] for k in sorted(depending([elements[i].static for i in rubbing], changing))]
    own = ca.vertcat(system.m, *[e.multiplier for e in elements])
    bounded = [i for i in varying if not ca.depends_on(elements[i].static, own)]  # else what presses sees to it
    if isinstance(pair, Theta):
        bounded = []
    form = switching(system.t, system.x, flow, elements, bounded, resolution)
    x, excited = system.x, list[int]()
    if not isinstance(pair, Theta):  # its forces are means over a step
        x, excited, form = _with_hidden_forces(system, elements, form)
    series = series_of(pair, equations(system.t, x, p, system.m, form)) if isinstance(pair, Taylor) else None
    if isinstance(series, str):
        system.kernels["lacking", key] = series
        return system.kernels.setdefault(key, program_of(system, kinds, DOP853))
    updates = []
    for update in system.updates:
        following, outputs = (
            ca.substitute(closed(e), system.F, form.force) if system.elements else closed(e) for e in (update.following, update.outputs)
        )
        updates.append((ca.vertcat(update.memory, update.noise), following, outputs))
    units = [unit for _, size, unit in system.states.values() for _ in range(size or 1)]
    units += ["hidden force"] * len(excited)
    known = sorted(set(units))
    program = Program(
        system=system,
        pair=pair,
        kernel=kernel_of(system.t, x, p, elements, form, pair, updates, flow, series, _holds_expression(key)),
        excited=np.array(excited, np.int64),
        kind=np.array([_kind(element) for element in elements], np.int64),
        initial=np.array([e.initial for e in elements], float),
        attached=np.array(form.attached, np.int64),
        loader=np.array(
            [work_layout.SECOND if isinstance(e, SecondDirection) else j for e, j in zip(elements, form.loader, strict=True)], np.int64
        ),
        varying=varying,
        bounded=bounded,
        forced=(series is None or peaks_in_time(equations(system.t, x, p, system.m, form))) and _forced(system.t, form, elements),
        p_size=p.numel(),
        coefficient_slot=coefficient_slot,
        held_slot=first_held,
        table_slot={name: first_held + held_size + offset for name, offset in table_slot.items()},
        first_held=first_held,
        groups=np.array([known.index(unit) for unit in units], np.int64),
        group_count=len(known),
        outputs={},
        updates=updates,
        expressions=(p, u, form.force),
        form=form,
    )
    system.kernels[key] = program
    if _holds_expression(key):
        known = [other for other in list(system.kernels) if _holds_expression(other)]
        for old in known[:-EXPRESSIONS]:
            system.kernels.pop(old, None)
    return program


def _placed_inputs(
    system: HybridSystem, given: Mapping[str, Any]
) -> tuple[ca.SX, list[ca.SX], list[ca.SX], dict[str, int], dict[str, int]]:
    """The inputs as expressions; symbols of their numbers and of the pieces of their tables; and {input: its place} for numbers and for tables.

    Places of numbers are those in the vector of parameters, those of tables among the tables.
    """
    coefficients: list[ca.SX] = []
    tables: list[ca.SX] = []
    coefficient_slot: dict[str, int] = {}
    table_slot: dict[str, int] = {}
    inputs: list[ca.SX] = []
    for name, entry in system.inputs.items():
        kind = given.get(name)
        if kind is None:
            inputs.append(entry.default)
        elif kind == "table":
            table_slot[name] = 3 * len(tables)
            piece = ca.SX.sym(name, 3)
            tables.append(piece)
            inputs.append(piece[0] + piece[1] * (system.t - piece[2]))
        elif isinstance(kind, ExpressionKey):
            inputs.append(kind.expression)
        else:
            size = 1 if kind == "number" else kind[1]
            symbol = ca.SX.sym(name, size)
            coefficient_slot[name] = system.p.numel() + sum(c.numel() for c in coefficients)
            coefficients.append(symbol)
            inputs.append(symbol if kind == "number" else Shape(kind[0], ()).expression(system.t, symbol))
    return ca.vertcat(*inputs) if inputs else ca.SX(0, 1), coefficients, tables, coefficient_slot, table_slot


def _kind(element: Any) -> int:
    """The kind of an element in the loops; the second direction of a friction holds and slides with the first, and its own mode is that of a switch."""
    from toolbox.compilation import work_layout

    if isinstance(element, SecondDirection):
        return work_layout.SWITCH
    return work_layout.RIGID if element.unilateral else work_layout.FRICTION if element.holds else work_layout.SWITCH


EXPRESSIONS = 16
"""Programs of a plant that are kept for inputs given as expressions, the last ones: each takes a tenth of a megabyte."""


def _holds_expression(key: Any) -> bool:
    """Whether a key is that of a program some of whose inputs are expressions."""
    return isinstance(key, tuple) and key[0] == "program" and any(isinstance(kind, ExpressionKey) for _, kind in key[1])


def _forced(t: ca.SX, form: Switching, elements: list[Any]) -> bool:
    """Whether time enters nonlinearly."""
    if solved_in_calls(form):
        force = ca.vertcat(*[element.multiplier for element in elements])
        whole = ca.vertcat(form.open_field, form.balance, *[element.static for element in elements])
        return bool(ca.depends_on(ca.jacobian(whole, t), ca.vertcat(t, force)))
    return bool(ca.depends_on(ca.jacobian(ca.vertcat(form.field, form.force, form.static, form.guards), t), t))


def solved_in_calls(form: Switching) -> bool:
    """Whether forces are solved for in calls, whose derivatives seem to depend on all that the forces depend on."""
    return bool(form.balance.numel() and calls(ca.Function("forces", ca.symvar(form.force), [form.force])))


def _with_hidden_forces(system: HybridSystem, elements: list[Any], form: Switching) -> tuple[ca.SX, list[int], Switching]:
    """The states and field with one more state for every sticking force or bound that is nonlinear in states or time (see `toolbox.stepping.event_stepper`).

    Where all contacts stick states may move so evenly that they limit no step, while such a force rises and falls.
    """
    along, pace = ca.vertcat(system.x, system.t), ca.vertcat(form.field, 1)
    if solved_in_calls(form):
        excited, values = _nonlinear(form, elements, along)
        slopes = ca.densify(ca.jtimes(ca.vertcat(*values), along, pace)) if values else ca.SX(0, 1)
        rates = [form.sticks[i] * slopes[k] for k, i in enumerate(excited)]
    else:
        excited, values = _nonlinear_alone(form, elements, along)
        values = [_as_stuck(elements, i, value) for i, value in zip(excited, values, strict=True)]
        rates = [form.sticks[i] * ca.mtimes(ca.jacobian(value, along), pace) for i, value in zip(excited, values, strict=True)]
    if not rates:
        return system.x, [], form
    excited = [i - isinstance(elements[i], SecondDirection) for i in excited]  # both directions have the bound of the first
    hidden = ca.SX.sym("hidden", len(rates))
    impulse, n = form.impulse, system.x.numel()
    if impulse is not None:
        impulse = (*impulse[:2], ca.vertcat(impulse[2][:n], hidden, impulse[2][n:]))
    longer: dict[str, Any] = {
        name: ca.vertcat(getattr(form, name), *rates) for name in ("field", "open_field") if getattr(form, name).numel()
    }
    wider = form._replace(projected=ca.vertcat(form.projected, hidden), impulse=impulse, **longer)
    return ca.vertcat(system.x, hidden), excited, wider


def _as_stuck(elements: list[Any], i: int, value: ca.SX) -> ca.SX:
    """What counts only while element i sticks, without what its other modes make of it where that is much: with friction in two slip directions."""
    first = i - isinstance(elements[i], SecondDirection)
    if elements[first].directions == 1:
        return value
    return ca.substitute(value, ca.vertcat(elements[first].mode, elements[first + 1].mode), ca.SX.zeros(2))


def _nonlinear_alone(form: Switching, elements: list[Any], along: ca.SX) -> tuple[list[int], list[ca.SX]]:
    """What is nonlinear among the sticking forces and bounds: numbers of the elements, and expressions."""
    chosen = [(i, value) for i, element in enumerate(elements) if element.holds for value in _hiding(form, i, element)]
    if not chosen:
        return [], []
    (stuck,) = _stuck(elements, [ca.vertcat(*[value for _, value in chosen])])
    if len(chosen) > MANY:  # one by one takes a time that grows as the square
        bent = _bent(stuck, along)
        found = [pair for k, pair in enumerate(chosen) if k in bent]
        return [i for i, _ in found], [value for _, value in found]
    found = [(i, value) for k, (i, value) in enumerate(chosen) if ca.depends_on(ca.jacobian(stuck[k], along), along)]
    return [i for i, _ in found], [value for _, value in found]


def _nonlinear(form: Switching, elements: list[Any], along: ca.SX) -> tuple[list[int], list[ca.SX]]:
    """The same where forces are solved for in calls: nonlinear are those that one nonlinear equation of their balance, or another such force, concerns."""
    force = ca.vertcat(*[element.multiplier for element in elements])
    balance, bounds = _stuck(elements, [form.balance, ca.vertcat(*[element.static for element in elements])])
    everything = ca.vertcat(along, force)

    curved = _bent(balance, everything)
    forces = {i for group in coupled_groups(ca.jacobian_sparsity(balance, force)) if curved & set(group) for i in group}
    limits = _bent(bounds, everything) | {
        i for i, j in zip(*ca.jacobian_sparsity(ca.densify(bounds), force).get_triplet(), strict=True) if j in forces
    }
    found = []
    for i, element in enumerate(elements):
        if element.holds:
            hides = (i in forces,) if element.unilateral else (i in forces, i in limits)
            found += [(i, value) for value, hidden in zip(_hiding(form, i, element), hides, strict=True) if hidden]
    return [i for i, _ in found], [value for _, value in found]


def _bent(expressions: ca.SX, along: ca.SX) -> set[int]:
    """Rows that are nonlinear in these symbols."""
    slopes = ca.jacobian(expressions, along)
    curved = ca.jacobian_sparsity(slopes.nz[:], along).get_triplet()[0] if slopes.nnz() else []
    rows = slopes.sparsity().row()
    return {rows[k] for k in curved}


MANY = 100
"""Forces and bounds beyond which they are looked at together."""


def _stuck(elements: list[Any], expressions: list[ca.SX]) -> list[ca.SX]:
    """Expressions with all contacts sticking."""
    holding = [element.mode for element in elements if element.holds]
    return list(ca.substitute([ca.densify(e) for e in expressions], holding, [ca.SX(0)] * len(holding)))


def _hiding(form: Switching, i: int, element: Any) -> tuple[ca.SX, ...]:
    """What a contact hides from the states while it sticks: its force, and its bound where that is its own."""
    return (form.force[i],) if element.unilateral else (form.force[i], form.static[i])


@dataclass(frozen=True, eq=False)
class ExpressionKey:
    """A casadi expression of time as part of a program's key: equal where the expressions are."""

    expression: ca.SX

    def __hash__(self) -> int:
        return hash(str(self.expression))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ExpressionKey) and bool(ca.is_equal(self.expression, other.expression, 100))
