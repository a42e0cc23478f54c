"""A closed system compiled for one kind of inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import count_of
from toolbox.compilation.formulas import ClosedEquations, Formulas
from toolbox.errors import SceneError
from toolbox.modelling.clamps import passing_nan
from toolbox.modelling.elements import FRICTION, RIGID, SWITCH, Element
from toolbox.modelling.elimination import calls, coupled_groups
from toolbox.modelling.garbage import uncollected
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.input_kinds import ExpressionKey
from toolbox.modelling.inputs import Shape
from toolbox.modelling.numbers import Number
from toolbox.modelling.singular_gains import depending
from toolbox.modelling.switching import Switching, switching
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
    formulas: Formulas
    kernel: Any
    p_size: int
    coefficient_slot: dict[str, int]
    held_slot: int
    table_slot: dict[str, int]
    first_held: int
    excited: np.ndarray
    kind: np.ndarray
    rigid: np.ndarray
    initial: np.ndarray
    attached: np.ndarray
    loader: np.ndarray
    varying: list[int]
    bounded: list[int]
    forced: bool
    groups: np.ndarray
    group_count: int
    outputs: dict[Any, Any]
    signals: dict[str | tuple[str, ...] | ExpressionKey, Any]
    updates: list[tuple[ca.SX, ca.SX, ca.SX]]
    expressions: tuple[ca.SX, ...]
    form: Switching
    equations: ClosedEquations

    @cached_property
    def lever(self) -> np.ndarray:
        """1 for every friction whose lever may vanish, OPPOSED for every rigid contact that stands against another one, else 0."""
        from toolbox.compilation import work_layout

        found = np.array(self.form.levers, np.int64)
        found[list(self.form.opposed)] = work_layout.OPPOSED
        return found

    @cached_property
    def bound(self) -> np.ndarray:
        """Cause of a change of the bound of each element during a run, as an integer of `work_layout`."""
        from toolbox.compilation import work_layout

        found = np.full(len(self.kind), work_layout.BY_NUMBERS, np.int64)
        for i in self.varying:
            found[i] = work_layout.BY_STATES if i in self.bounded else work_layout.BY_CONTACT
        return found

    @cached_property
    def unguarded(self) -> list[int]:
        """Numbers of the elements whose bound varies and has no guard, so that it is looked at when measures are read.

        A polynomial through a step dips below zero at the kink of a bound such as |load|, while a guard is evaluated itself.
        """
        return [i for i in self.varying if i not in self.bounded]

    def lacking(self, formulas: Formulas, kinds: tuple[tuple[str, Any], ...]) -> str:
        """Return the reason why a run uses the formulas of this program instead of the formulas that it asked for. Empty if they are the
        same."""
        if self.formulas == formulas:
            return ""
        return f"{self.formulas.steps}: {self.system.cache['lacking', ('program', kinds, formulas.name)]}"

    def place(self, number: Number, inputs: Mapping[str, Any]) -> int:
        """Where a parameter, an input that is given as a number, or a number of a shape stands in the vector of parameters.

        Raises SceneError for a number that stands nowhere in it, and for the seed of a noise, which is in all of its numbers.
        """
        if number.is_parameter:
            return self.system._parameter(number.name).offset
        if not (number.is_input or number.is_shape):
            raise SceneError(f"Argument `{number.name}` must stand among the parameters of a program, but {number.kind.why}.")
        name, key = (number.name, "") if number.is_input else number.in_input(inputs)
        if key == "seed":
            raise SceneError(
                f"Argument `{number.name}` must stay within a sweep, because another seed is another realisation: give one to each loop."
            )
        if name not in self.coefficient_slot:
            raise SceneError(
                f"Argument `{name}` must be given to the loop, because a default stands among no parameters: `loop.at({name!r}, value)`."
            )
        return self.coefficient_slot[name] + (list(inputs[name].numbers).index(key) if key else 0)

    def closed(self, expression: ca.SX) -> ca.SX:
        """An expression in the symbols of the system with its forces and inputs as they follow from t, x, p and the modes."""
        _, u, force = self.expressions
        closed = ca.substitute(expression, self.system.F, force) if self.system.elements else expression
        return ca.substitute(closed, self.system.u, u) if self.system.inputs else closed

    @cached_property
    def ints(self) -> np.ndarray:
        """Sizes and addresses for the compiled loops, at their places in `Work.ints`."""
        from toolbox.compilation import work_layout

        kernel, ints = self.kernel, np.zeros(work_layout.INTS, np.int64)
        ints[work_layout.N], ints[work_layout.NE], ints[work_layout.NG] = kernel.states, kernel.elements, kernel.guards
        ints[work_layout.COUPLED] = kernel.coupled
        ints[work_layout.BOUNDS] = len(self.bounded)
        ints[work_layout.LEVERS] = sum(self.form.levers)
        ints[work_layout.FIRST_HELD] = self.first_held
        ints[list(work_layout.FORMULAS)] = *kernel.addresses, self.formulas.order, self.formulas.implicit, self.formulas.two_errors
        return ints


def program_of(system: HybridSystem, kinds: tuple[tuple[str, Any], ...], formulas: Formulas) -> Program:
    """The compiled program of a closed system for inputs of the given kinds (see `toolbox.simulate`); cached with the system's structure.

    Where the formulas have no step for the system, it is that of those that they name `instead`.
    """
    key = ("program", kinds, formulas.name)
    if key not in system.cache:
        with uncollected():
            _programmed(system, kinds, formulas, _closed(system, kinds, formulas.locates))
        if _holds_expression(key):
            for old in [other for other in list(system.cache) if _holds_expression(other)][:-EXPRESSIONS]:
                system.cache.pop(old, None)
    return system.cache[key]


def _programmed(system: HybridSystem, kinds: tuple[tuple[str, Any], ...], formulas: Formulas, closed: Mapping[str, Any]) -> Program:
    """The program of equations that are `closed`, or that of the formulas `instead`, put into the cache."""
    from toolbox.compilation.kernel import kernel_of

    key = ("program", kinds, formulas.name)
    if key in system.cache:
        return system.cache[key]
    step = formulas.step(closed["equations"])
    if isinstance(step, str):
        system.cache["lacking", key] = step
        return system.cache.setdefault(key, _programmed(system, kinds, formulas.instead, closed))
    kernel = kernel_of(closed["equations"], formulas, step, closed["updates"], _holds_expression(key))
    forced = formulas.may_miss_peaks(closed["equations"]) and _forced(system.t, closed["form"], closed["equations"].elements)
    program = Program(system=system, formulas=formulas, kernel=kernel, forced=forced, outputs={}, signals={}, **closed)
    return system.cache.setdefault(key, program)


SHARED = (
    "equations", "form", "updates", "expressions", "excited", "kind", "rigid", "initial", "attached", "loader",
    "varying", "bounded", "p_size", "coefficient_slot", "held_slot", "table_slot", "first_held", "groups", "group_count",
)  # fmt: skip
"""Attributes that programs of one system and one kind of inputs have in common."""


def _closed(system: HybridSystem, kinds: tuple[tuple[str, Any], ...], locates: bool) -> Mapping[str, Any]:
    """What programs of one system and one kind of inputs share: their closed equations, and the places of numbers in them.

    Those of a program that is there are taken, because of a long chain they take as long as the code of a step.
    """
    for key, known in list(system.cache.items()):
        if key[:2] == ("program", kinds) and known.formulas.locates == locates:
            return {name: getattr(known, name) for name in SHARED}
    from toolbox.compilation import work_layout

    u, coefficients, tables, coefficient_slot, table_slot = _placed_inputs(system, dict(kinds))
    if any(element.second for element in system.elements):
        coefficients.append(resolution)
    first_held = system.p.numel() + sum(c.numel() for c in coefficients)
    held_size = system.held.numel()
    p = ca.vertcat(system.p, *coefficients, system.held, *tables)

    def closed(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, system.u, u) if system.inputs else expression

    elements, flow = [element.mapped(closed) for element in system.elements], closed(system.flow)
    rubbing = [e.multiplier for e in elements if e.kind == FRICTION]
    varying = _varying(elements, ca.vertcat(system.t, system.x, system.held, *tables, *rubbing))
    pressing = ca.vertcat(system.m, *[e.multiplier for e in elements if e.kind != FRICTION])
    bounded = [i for i in varying if locates and not ca.depends_on(elements[i].static, pressing)]  # else what presses sees to it
    form = switching(system.t, system.x, flow, elements, bounded, resolution)
    x, excited = system.x, list[int]()
    if locates:
        x, excited, form = _with_hidden_forces(system, elements, form)
    equations = ClosedEquations(system.t, x, p, elements, form, flow)

    def of_states(expression: ca.SX) -> ca.SX:
        return ca.substitute(closed(expression), system.F, form.force) if system.elements else closed(expression)

    constants = ca.vertcat(system.t, p[:first_held])
    updates = [
        (ca.vertcat(u.memory, u.noise), *passing_nan([of_states(u.following), of_states(u.outputs)], constants)) for u in system.updates
    ]
    groups, group_count = _by_unit(system, len(excited))
    return {
        "equations": equations,
        "form": form,
        "updates": updates,
        "excited": np.array(excited, np.int64),
        "kind": np.array([element.kind for element in elements], np.int64),
        "rigid": np.flatnonzero([element.kind == RIGID for element in elements]),
        "initial": np.array([e.initial if e.kind == SWITCH else work_layout.UNDECIDED for e in elements], float),
        "attached": np.array(form.attached, np.int64),
        "loader": np.array([_loader(i, e, form) for i, e in enumerate(elements)], np.int64),
        "varying": varying,
        "bounded": bounded,
        "p_size": p.numel(),
        "coefficient_slot": coefficient_slot,
        "held_slot": first_held,
        "table_slot": {name: first_held + held_size + offset for name, offset in table_slot.items()},
        "first_held": first_held,
        "groups": groups,
        "group_count": group_count,
        "expressions": (p, u, form.force),
    }


def _loader(i: int, element: Element, form: Switching) -> int:
    """What stands for element i in `Work.loader`."""
    from toolbox.compilation import work_layout

    if i in form.passing:
        return work_layout.PASSES
    return work_layout.SECOND if element.second else work_layout.ONE_WAY if element.is_unilateral else form.loader[i]


def _by_unit(system: HybridSystem, hidden: int) -> tuple[np.ndarray, int]:
    """The number of the unit of every state and of so many hidden forces, and how many units there are."""
    units = [unit for _, size, unit in system.states.values() for _ in range(count_of(size))] + ["hidden force"] * hidden
    known = sorted(set(units))
    return np.array([known.index(unit) for unit in units], np.int64), len(known)


def _varying(elements: list[Element], changing: ca.SX) -> list[int]:
    """Numbers of the elements that slide or switch and whose bound depends on what changes during a run."""
    places = [i for i, element in enumerate(elements) if not element.rigid]
    return [places[k] for k in sorted(depending([elements[i].static for i in places], changing))]


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


EXPRESSIONS = 16
"""Programs of a plant that are kept for inputs given as expressions, the last ones: each takes a tenth of a megabyte."""


def _holds_expression(key: Any) -> bool:
    """Whether a key is that of a program some of whose inputs are expressions."""
    return isinstance(key, tuple) and key[0] == "program" and any(isinstance(kind, ExpressionKey) for _, kind in key[1])


def _forced(t: ca.SX, form: Switching, elements: Sequence[Element]) -> bool:
    """Whether time enters nonlinearly."""
    if solved_in_calls(form):
        force = ca.vertcat(*[element.multiplier for element in elements])
        equations = ca.vertcat(form.open_field, form.balance, *[element.static for element in elements])
        return bool(ca.depends_on(ca.jacobian(equations, t), ca.vertcat(t, force)))
    return bool(ca.depends_on(ca.jacobian(ca.vertcat(form.field, form.force, form.static, form.guards), t), t))


def solved_in_calls(form: Switching) -> bool:
    """Whether forces are solved for in calls, whose derivatives seem to depend on all that the forces depend on."""
    return bool(form.balance.numel() and calls(ca.Function("forces", ca.symvar(form.force), [form.force])))


def _with_hidden_forces(system: HybridSystem, elements: list[Element], form: Switching) -> tuple[ca.SX, list[int], Switching]:
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
    excited = [i - elements[i].second for i in excited]  # both directions have the bound of the first
    hidden = ca.SX.sym("hidden", len(rates))
    impulse, n = form.impulse, system.x.numel()
    if impulse is not None:
        impulse = (*impulse[:2], ca.vertcat(impulse[2][:n], hidden, impulse[2][n:]))
    longer: dict[str, Any] = {
        name: ca.vertcat(getattr(form, name), *rates) for name in ("field", "open_field") if getattr(form, name).numel()
    }
    wider = form._replace(projected=ca.vertcat(form.projected, hidden), impulse=impulse, **longer)
    return ca.vertcat(system.x, hidden), excited, wider


def _as_stuck(elements: list[Element], i: int, value: ca.SX) -> ca.SX:
    """What counts only while element i sticks, without what its other modes make of it where that is much: with friction in two slip directions."""
    first = i - elements[i].second
    if elements[first].directions == 1:
        return value
    return ca.substitute(value, ca.vertcat(elements[first].mode, elements[first + 1].mode), ca.SX.zeros(2))


def _nonlinear_alone(form: Switching, elements: list[Element], along: ca.SX) -> tuple[list[int], list[ca.SX]]:
    """What is nonlinear among the sticking forces and bounds: numbers of the elements, and expressions."""
    chosen = [(i, value) for i, element in enumerate(elements) if element.holds for value in _hiding(form, i, element)]
    if not chosen:
        return [], []
    (stuck,) = _stuck(elements, [ca.vertcat(*[value for _, value in chosen])])
    if len(chosen) > MANY:  # one by one takes a time that grows as the square
        bent = _bent(stuck, along)
        found = [each for k, each in enumerate(chosen) if k in bent]
        return [i for i, _ in found], [value for _, value in found]
    # a stop that is closed relieves a friction, whose force shows only while it is open
    tried = [stuck, *_stuck(elements, [ca.vertcat(*[value for _, value in chosen])], form.shared.rigid)] if form.shared.rigid else [stuck]
    found = [(i, value) for k, (i, value) in enumerate(chosen) if any(ca.depends_on(ca.jacobian(each[k], along), along) for each in tried)]
    return [i for i, _ in found], [value for _, value in found]


def _nonlinear(form: Switching, elements: list[Element], along: ca.SX) -> tuple[list[int], list[ca.SX]]:
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
            hides = (i in forces,) if element.rigid else (i in forces, i in limits)
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


def _stuck(elements: list[Element], expressions: list[ca.SX], opened: Sequence[int] = ()) -> list[ca.SX]:
    """Expressions with all contacts sticking, but for the rigid ones that are opened."""
    holding = [element.mode for element in elements if element.holds]
    modes = [ca.SX(float(i in opened)) for i, element in enumerate(elements) if element.holds]
    return list(ca.substitute([ca.densify(e) for e in expressions], holding, modes))


def _hiding(form: Switching, i: int, element: Element) -> tuple[ca.SX, ...]:
    """What a contact hides from the states while it sticks: its force, and its bound where that is its own."""
    return (form.force[i],) if element.rigid else (form.force[i], form.static[i])
