"""The normal form of a system with set-valued forces, and the algebra of its modes.

    x' = f(t, x, u, p, F)      F, the forces of the elements, enters affinely
    v_i = slip_i(t, x, p)
    stick (m_i = 0):   v_i stays 0 and F_i is whatever keeps it there, while |F_i| <= static_i
    slip  (m_i = +-1): F_i = -m_i kinetic_i

The mode vector m is a numeric input of one set of expressions: with B = df/dF, A = dv/dx B and b the slip rate at F = 0, the forces solve

    m_i = 0:   sum_j A_ij F_j = -b_i            (slip rate zero)
    m_i != 0:  F_i + m_i K_i F = -m_i kinetic_i(F = 0)

so that no mode is ever enumerated or compiled on its own. A rigid unilateral contact is the same with its own bound: it holds while its multiplier pushes,
and is free (F_i = 0) in mode 1. A switch has no multiplier: its mode is a number in the expressions. At an impact, impulses P take the place of forces,

    sticking: sum_j A_ij P_j = -(1 + e_i) v_i        sliding:  P_i + m_i K_i P = 0

A lever may vanish, as that of a crank at its dead centre: slip = p(q) w with p = 0. There the slip passes through zero however fast the shaft turns, A is zero,
and no force can hold it. A contact is therefore put at zero slip only where its own force keeps it there, |F_i| <= static_i; elsewhere the state stays as it is
and force decides the mode, with which a slip that was positive goes on as a negative one.

A friction with two slip directions has two rows, which hold and slide together, and its force a direction (`toolbox.modelling.two_directions`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from toolbox.errors import SceneError
from toolbox.modelling.elements import Element
from toolbox.modelling.elimination import coupled_groups, masked_solve
from toolbox.modelling.passing_slips import passing_slips
from toolbox.modelling.rings import limits_of_rings
from toolbox.modelling.shared_holds import Sharing, sharing
from toolbox.modelling.singular_gains import depending, held_by_force, least_gains, opposed_contacts, vanishing_levers, with_play
from toolbox.modelling.two_directions import EXACT, Cones


class Switching(NamedTuple):
    """Expressions of a system with modes as numeric input; every field is a casadi SX column.

    Attributes
    ----------
    field
        dx/dt.
    force, static, slip, slip_rate
        Force, bound, slip and its time derivative, one per element. The bound of a rigid contact is the size of the forces that its own has to balance: a
        scale for what counts as zero.
    guards, guard_rates
        Two guards per element, then one per kink, all positive while the modes and the sides of the kinks hold, then the bounds that must not become
        negative; and their total time derivatives.
    projected
        The state with the slip of sticking elements set to exactly zero by an impulse along df/dF.
    gain
        The matrix A.
    burden
        Sum of |df/dF_i| times the terms that make F_i: the size of what the forces cancel.
    sticks
        1 for an element that holds its slip, else 0.
    impulse
        (sticking, elastic, [state, impulses, slips before, slips after, bounds of the impulses]) where a rigid contact can strike, else None. `sticking` marks
        the elements that do not slide through the impact; `elastic` is 1, or 0 for an impact without restitution.
    attached
        For every element the number of the rigid contact whose force bounds it, or -1.
    loader
        For every element the number of the unilateral contact without which it has no load, or -1.
    open_field, balance
        Where forces hold each other, dx/dt with the forces as symbols, and what these forces make zero; empty elsewhere.
    levers
        1 for every friction whose lever may vanish, else 0.
    floor
        What is added to the own gain of an element that holds, so that no balance of forces is without solution.
    probed
        What the loops decide modes by, [slip | slip rate | force | bound | pace] of all elements: pace is the slip rate that a force at its bound makes.
    shared
        How frictions share what others hold, too.
    passing
        Numbers of the elements whose slip passes through zero, whatever their force is: frictions on a prescribed motion, relays of higher degree.
    opposed
        Numbers of the rigid contacts that stand against another one, as the two stops of a body.
    """

    field: ca.SX
    force: ca.SX
    static: ca.SX
    slip: ca.SX
    slip_rate: ca.SX
    guards: ca.SX
    guard_rates: ca.SX
    projected: ca.SX
    gain: ca.SX
    burden: ca.SX
    sticks: ca.SX
    impulse: tuple[ca.SX, ca.SX, ca.SX] | None
    attached: tuple[int, ...]
    loader: tuple[int, ...]
    open_field: ca.SX
    balance: ca.SX
    levers: tuple[int, ...]
    floor: ca.SX
    probed: ca.SX
    shared: Sharing
    passing: tuple[int, ...]
    opposed: tuple[int, ...]


NEIGHBOURS = 4
"""From how many contacts away, each of which holds the next, the round-off of a force is counted: with every one it falls by half or more."""


def switching(t: ca.SX, x: ca.SX, flow: ca.SX, elements: Sequence[Element], bounded: Sequence[int] = (), times: ca.SX = EXACT) -> Switching:
    """Solve the masked force balance of `flow` for all elements at once (see the module's equations).

    `bounded` holds the numbers of the elements whose bounds are watched, so that none becomes negative; `times` is what friction in two slip directions is
    resolved by.
    Raises SceneError where a force enters nonlinearly, does not act on its own slip, or where bounds depend on each other in a cycle.
    """
    force, mode, slip, load, sliding, static = (
        ca.vertcat(*[getattr(e, name) for e in elements]) if elements else ca.SX(0, 1)
        for name in ("multiplier", "mode", "slip", "load", "sliding", "static")
    )
    loader = _loaders(elements)
    cones = Cones(elements, slip, loader, times)
    load, sliding = cones.shared(load), cones.shared(sliding)
    kinetic = load * sliding

    gain_of_force = ca.jacobian(flow, force)
    coupling = ca.jacobian(kinetic, force)
    slip_of_state = ca.jacobian(slip, x)
    gain = ca.sparsify(ca.mtimes(slip_of_state, gain_of_force))
    passing = passing_slips(elements, flow, x, force, slip, gain)
    holds = ca.vertcat(ca.SX(0, 1), *[float(e.holds and i not in passing) for i, e in enumerate(elements)])
    _check_forces(elements, force, static, gain_of_force, coupling, gain, passing)
    levers = vanishing_levers(elements, slip_of_state, gain_of_force, gain, ca.vertcat(t, x))
    opposed = opposed_contacts(elements, gain, ca.vertcat(t, x))
    shared = sharing(elements, gain, force, static)
    floor = least_gains(gain, levers, opposed, shared.rigid)
    free = ca.substitute(flow, force, ca.SX.zeros(force.shape))
    free_rate = ca.mtimes(slip_of_state, free) + ca.jacobian(slip, t)
    zero = ca.SX.zeros(force.shape)
    # the factors of the law are grouped so that all but the law itself is constant over a step
    free_load, free_sliding = ca.substitute(load, force, zero), ca.substitute(sliding, force, zero)
    solved_for = _solver(elements, slip_of_state) if cones.places else masked_solve

    def balanced(sticks: ca.SX, side: ca.SX, speeds: ca.SX, yielding: ca.SX | None = None) -> Balance:
        """Return the forces for given sticking elements, directions of the sliding elements, and slip speeds of those with two directions.

        yielding: slip rate of every sticking row as a fraction of minus its force, none by default.
        """
        laws = cones.at_speed(free_sliding, speeds)
        matrix = ca.sparsify(shared.of_impulse(gain, sticks, floor) + ca.diag(side) @ cones.at_speed(coupling, speeds))
        if yielding is not None:
            matrix = ca.sparsify(matrix + ca.diag(yielding))
        right = -(sticks * shared.weights * free_rate + side * free_load * laws)
        if matrix.sparsity().is_diag():
            pivot = ca.diag(matrix)
            return Balance(matrix, right, -(sticks / pivot) * free_rate - (side * free_load / pivot) * laws)
        return Balance(matrix, right, shared.held(solved_for, matrix, right, sticks))

    own_mode = cones.shared(mode)
    sticks, side, speeds = holds * (1 - own_mode * own_mode), mode, ca.SX(0, 1)
    if cones.places:
        trial = _trial(cones, balanced, solved_for, cones.trial(sticks, side), gain, free_load, free_sliding)
        side, speeds = cones.directed(trial.force, ca.substitute(static, force, trial.force), side, gain)
    matrix, right, solved = balanced(sticks, side, speeds)
    terms, open_field, balance = ca.fabs(solved), ca.SX(0, 1), ca.SX(0, 1)
    if not matrix.sparsity().is_diag():
        terms = _sizes(matrix, right, solved)
        open_field = _held_exactly(free + gain_of_force @ force, slip, slip_of_state, x, t, sticks)
        balance = matrix @ force - right
    if cones.places:
        terms = cones.rounded(terms, solved, trial.force, _sizes(*trial))
    bound = ca.substitute(static, force, solved)
    field = _held_exactly(free + gain_of_force @ solved, slip, slip_of_state, x, t, sticks)
    slip_rate = free_rate + gain @ solved

    let_go_at, least = limits_of_rings(elements, gain, ca.vertcat(t, x), solved, bound, sticks) if shared.members else (solved, bound)
    stuck, limit = sticks * let_go_at, sticks * least
    cones.moving_at(slip_rate)
    guards = cones.at_speed(_guards(elements, cones, stuck, limit), speeds)
    guards, opposing = with_play(guards, t, x, elements, gain, opposed), tuple(sorted({i for pair in opposed for i in pair}))
    watched = [cones.at_speed(getattr(e, e.event_field), speeds) for e in elements if e.event_field] + [least] * bool(shared.members)
    kinks = [arg for arg in kink_arguments(ca.vertcat(field, slip, bound, *watched)) if ca.depends_on(arg, ca.vertcat(t, x))]
    guards = ca.vertcat(guards, *kinks, *[bound[i] for i in bounded])
    guard_rates = ca.jtimes(guards, ca.vertcat(t, x), ca.vertcat(1, field)) if guards.numel() else ca.SX(0, 1)
    held = held_by_force(levers, sticks, solved, bound)
    of_impulse = shared.of_impulse(gain, held, floor)
    projected = _project(x, slip, slip_of_state, gain_of_force, of_impulse, held, shared)
    burden = ca.fabs(gain_of_force) @ terms
    attached, impulse = [-1] * len(elements), None
    rigid = [i for i, element in enumerate(elements) if element.rigid]
    if rigid:
        strength = ca.jacobian(static, force)
        attached = _attached(rigid, strength, coupling)
        cones.check_loads(attached)
        balanced_size = ca.fabs(slip_of_state) @ ca.fabs(free) + ca.fabs(ca.jacobian(slip, t))
        for j in rigid:
            bound[j] = least[j] = balanced_size[j] / gain[j, j]
        impulse = _impact(x, slip, gain_of_force, gain, coupling, strength, mode, elements, floor, shared)
    # of a rigid contact the pace is that of a force of 1
    pace = ca.diag(gain) * ca.vertcat(*[1 if e.rigid else bound[i] for i, e in enumerate(elements)])
    probed = ca.vertcat(*map(ca.densify, cones.probed(slip, slip_rate, let_go_at, least, pace)))
    return Switching(
        field, solved, bound, slip, slip_rate, guards, guard_rates, projected, gain, burden, sticks, impulse, tuple(attached), loader, open_field, balance,
        levers, floor, probed, shared, passing, opposing,
    )  # fmt: skip


def _solver(elements: Sequence[Element], slip_of_state: ca.SX) -> Callable[[ca.SX, ca.SX], ca.SX]:
    """`masked_solve` with the slips of the fewest states first.

    A contact with the ground takes what it holds before others see it: what is left for these is then zero, not round-off that turns their direction.
    """
    order = sorted(range(len(elements)), key=lambda i: slip_of_state[i - elements[i].second, :].nnz())
    return lambda matrix, right: masked_solve(matrix[order, order], right[order])[np.argsort(order).tolist()]


def _trial(
    cones: Cones,
    balanced: Callable[..., Balance],
    solved_for: Callable[[ca.SX, ca.SX], ca.SX],
    tried: tuple[ca.SX, ca.SX, ca.SX],
    gain: ca.SX,
    load: ca.SX,
    sliding: ca.SX,
) -> Balance:
    """The balance with contacts whose force follows the pull held, and lowered to kinetic friction where several hold each other."""
    trial, yielding, sweeps = balanced(*tried), None, cones.sweeps(gain)
    if sweeps:
        resisting = cones.resisting([solved_for(trial.matrix, ca.SX(ca.DM.eye(gain.shape[0])[:, i])) for i in cones.places])
    for _ in range(sweeps):
        yielding = cones.yielding(trial.force, yielding, load, sliding, resisting)
        trial = balanced(*tried, yielding)
    return trial


def _attached(rigid: Sequence[int], strength: ca.SX, coupling: ca.SX) -> list[int]:
    """For every element the number of the rigid contact whose force bounds it, or -1."""
    return [next((j for j in rigid if strength.has_nz(i, j) or coupling.has_nz(i, j)), -1) for i in range(strength.shape[0])]


def _sizes(matrix: ca.SX, right: ca.SX, solved: ca.SX) -> ca.SX:
    """How large the terms are of which a force is the rest.

    A force can be the small rest of large ones that hold each other, and its round-off is theirs, and that of what holds these.
    """
    pivot = ca.diag(matrix)
    own = ca.fabs(solved) + ca.fabs(right) / ca.fabs(pivot)
    others = ca.sparsify(ca.fabs(matrix - ca.diag(pivot)) / ca.repmat(ca.fabs(pivot), 1, solved.numel()))
    terms = own
    for _ in range(min(max(map(len, coupled_groups(matrix.sparsity()))) - 1, NEIGHBOURS)):
        terms = own + others @ terms
    return terms


def _guards(elements: Sequence[Element], cones: Cones, stuck: ca.SX, limit: ca.SX) -> ca.SX:
    """The guards of all elements, of which those of a cone share theirs."""
    found: list[ca.SX] = []
    for i, element in enumerate(elements):
        of_cone = cones.guards(i, stuck, limit)
        found += element.guards(stuck[i], limit[i]) if of_cone is None else of_cone
    return ca.vertcat(ca.SX(0, 1), *found)


def _check_forces(
    elements: Sequence[Element],
    force: ca.SX,
    static: ca.SX,
    gain_of_force: ca.SX,
    coupling: ca.SX,
    gain: ca.SX,
    passing: Sequence[int],
) -> None:
    """Raise SceneError as `switching` does."""
    if (
        ca.depends_on(gain_of_force, force)
        or ca.depends_on(coupling, force)
        or (ca.depends_on(static, force) and ca.depends_on(ca.jacobian(static, force), force))
    ):
        raise SceneError("The force of an element must enter the flow and the bounds of later elements affinely.")
    if coupling.nnz() and np.any(np.greater_equal(*np.array(coupling.sparsity().get_triplet())[::-1])):
        raise SceneError("The bound of an element may depend on forces of elements declared earlier only; here it closes a cycle.")
    for i, element in enumerate(elements):
        if element.holds and not gain.has_nz(i, i) and i not in passing:
            remedy = (
                "; one that acts through lags and may switch ever faster is declared with `higher_degree=True`"
                if element.law is None and element.slides
                else ""
            )
            raise SceneError(
                f"Element {element.title} cannot hold its slip: its force must act on the rate of its slip (relative degree one){remedy}."
            )


class Balance(NamedTuple):
    """matrix * force = right, and the forces that solve it."""

    matrix: ca.SX
    right: ca.SX
    force: ca.SX


def _loaders(elements: Sequence[Element]) -> tuple[int, ...]:
    """For every friction the unilateral contact that, when open, leaves it without any load; -1 for none."""
    contacts = [(j, e) for j, e in enumerate(elements) if e.has_gap]
    found = []
    for element in elements:
        symbols = [(j, ca.vertcat(e.multiplier, e.mode)) for j, e in contacts if element.law is not None]
        alone = [j for j, s in symbols if ca.depends_on(element.load, s) and ca.substitute(element.load, s, ca.vertcat(0, 1)).is_zero()]
        found.append(alone[0] if alone else -1)
    return tuple(found)


def _impact(
    x: ca.SX,
    slip: ca.SX,
    gain_of_force: ca.SX,
    gain: ca.SX,
    coupling: ca.SX,
    strength: ca.SX,
    mode: ca.SX,
    elements: Sequence[Element],
    floor: ca.SX,
    shared: Sharing,
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """State, impulses, slips before and after, and bounds of impulses at an impact in which the elements marked as sticking take part."""
    sticking, elastic = ca.SX.sym("sticking", len(elements)), ca.SX.sym("elastic")
    restitution = ca.vertcat(*[e.restitution for e in elements])
    rubbing = [i for i, element in enumerate(elements) if element.slides]
    # an impact may turn a slip, and then the mode is no longer the way it went before: a law knows no speed below zero
    coupling = ca.substitute(coupling, mode[rubbing], ca.sign(slip[rubbing])) if rubbing else coupling
    rows = sticking * shared.weights
    matrix = ca.sparsify(ca.diag(rows) @ gain + ca.diag(1 - sticking) + ca.diag((1 - sticking) * mode) @ coupling)
    matrix = ca.sparsify(matrix + ca.diag(sticking * (floor + shared.softness)))
    impulses = shared.held(masked_solve, matrix, -rows * (1 + elastic * restitution) * slip, sticking)
    results = (x + gain_of_force @ impulses, impulses, slip, slip + gain @ impulses, strength @ impulses)
    return sticking, elastic, ca.vertcat(*map(ca.densify, results))


def check_rates(t: ca.SX, x: ca.SX, others: ca.SX, flow: ca.SX, elements: Sequence[Element]) -> None:
    """Raise SceneError if the rate of a unilateral contact is not the time derivative of its closure. Both are compared at random
    points."""
    contacts = [element for element in elements if element.has_gap]
    if not contacts:
        return
    closure, rate = (ca.vertcat(*[getattr(e, name) for e in contacts]) for name in ("closure", "rate"))
    derivative = ca.jtimes(closure, ca.vertcat(t, x), ca.vertcat(1, ca.densify(flow)))
    size = ca.fabs(derivative) + ca.fabs(rate)
    compared = ca.Function("compared", [t, x, others], [ca.fabs(derivative - rate), size])
    random = np.random.default_rng(1)
    for _ in range(5):
        difference, scale = (
            np.array(v).ravel() for v in compared(random.random(), random.normal(size=x.numel()), 0.5 + random.random(others.numel()))
        )
        for i, element in enumerate(contacts):
            if difference[i] > 1e-6 * scale[i]:  # false where a number is not finite
                raise SceneError(f"The rate of `{element.name}` must be the time derivative of its closure, but they differ.")


def _held_exactly(field: ca.SX, slip: ca.SX, slip_of_state: ca.SX, x: ca.SX, t: ca.SX, sticks: ca.SX) -> ca.SX:
    """The field with the rate of a sticking slip that holds one state masked, not left to cancellation."""
    field, pace = ca.densify(field), ca.jacobian(slip, t)
    for i, j in _single(slip_of_state, x):
        field[j] = (1 - sticks[i]) * field[j] - sticks[i] * pace[i] / slip_of_state[i, j]
    return field


def _single(slip_of_state: ca.SX, x: ca.SX) -> list[tuple[int, int]]:
    """(slip, state) where a slip contains a single state, with a factor that no state changes."""
    columns: dict[int, list[int]] = {}
    for i, j in zip(*slip_of_state.sparsity().get_triplet(), strict=True):
        columns.setdefault(i, []).append(j)
    single = [(i, js[0]) for i, js in columns.items() if len(js) == 1]
    changed = depending([slip_of_state[i, j] for i, j in single], x)
    return [place for k, place in enumerate(single) if k not in changed]


def _project(x: ca.SX, slip: ca.SX, slip_of_state: ca.SX, gain_of_force: ca.SX, matrix: ca.SX, sticks: ca.SX, shared: Sharing) -> ca.SX:
    """Set the slip of sticking elements to zero by an impulse, then remove round-off exactly where a state enters a slip with factor +-1."""
    if not slip.numel():
        return x
    impulse = shared.held(masked_solve, matrix, -sticks * shared.weights * slip, sticks)
    projected = x + gain_of_force @ impulse
    alone = dict(_single(slip_of_state, x))
    states = x[list(set(alone.values()))]
    rests = (
        ca.substitute(slip[list(alone)], states, ca.SX.zeros(states.numel())) if alone else slip
    )  # at once: each has one of these states alone
    for k, (i, j) in enumerate(alone.items()):
        projected[j] = (1 - sticks[i]) * projected[j] - sticks[i] * rests[k] / slip_of_state[i, j]
    supports: list[dict[int, float]] = [{} for _ in range(slip.numel())]
    for k, (i, j) in enumerate(zip(*slip_of_state.sparsity().get_triplet(), strict=True)):
        entry = slip_of_state.nz[k]
        supports[i][j] = float(entry) if entry.is_constant() else 0.0
    for i, pivot in _exact_order(supports):
        if i in alone:
            continue
        support = list(supports[i])
        slip_now = ca.substitute(slip[i], x[support], projected[support])
        projected[pivot] = projected[pivot] - sticks[i] * slip_now * supports[i][pivot]
    return projected


def _exact_order(supports: list[dict[int, float]]) -> list[tuple[int, int]]:
    """Order in which slips can be zeroed one by one, each through a state of its own that no earlier slip of the list contains."""
    remaining = set(range(len(supports)))
    last_first: list[tuple[int, int]] = []
    users: dict[int, set[int]] = {}
    for i, support in enumerate(supports):
        for j in support:
            users.setdefault(j, set()).add(i)
    found = True
    while found:
        found = False
        for i in sorted(remaining):
            pivot = next((j for j, factor in supports[i].items() if abs(factor) == 1.0 and users[j] & remaining == {i}), None)
            if pivot is not None:
                last_first.append((i, pivot))
                remaining.discard(i)
                found = True
    return last_first[::-1]


def kink_arguments(expression: ca.SX) -> list[ca.SX]:
    """Arguments at whose sign change the expression has a kink: of fabs(a), a; of fmin(a, b) and fmax(a, b), a - b.

    Raises SceneError for sign, floor, comparisons and the like: a jump must be a declared element.
    """
    jumps = {ca.OP_SIGN: "sign", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil", ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==",
             ca.OP_NE: "!=", ca.OP_IF_ELSE_ZERO: "if_else", ca.OP_FMOD: "fmod", ca.OP_COPYSIGN: "copysign", ca.OP_REMAINDER: "remainder"}  # fmt: skip
    expression = ca.densify(expression)
    function = ca.Function("scan", ca.symvar(expression), [expression], {"max_io": 10**9}) if not expression.is_constant() else None
    sought = {*jumps, ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX}
    if function is None or sought.isdisjoint(map(function.instruction_id, range(function.n_instructions()))):
        return []
    found: dict[int, ca.SX] = {}
    seen: set[int] = set()
    stack = [expression.nz[k] for k in range(expression.nnz())]
    while stack:
        node = stack.pop()
        key = node.element_hash()
        if key in seen or node.is_constant() or node.is_symbolic():
            continue
        seen.add(key)
        op = node.op()
        if op in jumps:
            raise SceneError(
                f"The flow, a slip or a bound jumps (`{jumps[op]}`): a jump must be a declared element, such as Relay, or a table with a "
                "repeated time."
            )
        if op == ca.OP_FABS:
            argument = node.dep(0)
        elif op in (ca.OP_FMIN, ca.OP_FMAX):
            argument = node.dep(0) - node.dep(1)
        else:
            argument = None
        if argument is not None and not any(ca.is_equal(argument, other, 2) for other in found.values()):
            found[key] = argument
        stack.extend(node.dep(k) for k in range(node.n_dep()))
    return list(found.values())
