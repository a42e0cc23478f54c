"""Whether the forces of a composed plant act as they must: against their slips and gaps, and independently of one another."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from toolbox.errors import SceneError
from toolbox.modelling.elements import Element
from toolbox.modelling.elimination import dependent_rows, must_be_independent
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.rings import motions_of, rings_of
from toolbox.modelling.shared_holds import check_loads, dependent_holds


def check_numbers(system: HybridSystem) -> None:
    """Raise SceneError if the forces of a plant cannot act correctly with its numbers. The check is repeated after every change of the
    numbers."""
    check_gain(system)
    check_rings(system)
    check_wedges(system)
    check_push(system)


def check_push(system: HybridSystem) -> None:
    """Raise SceneError unless the force of every elastic contact acts against its closure. A contact is checked if its force enters the
    rate of its gap and three states agree on the sign.

    Closing adds a N to the rate d'', N being proportional to d + (c / k) d': a must not be positive, or the contact would pull what it should stop.
    """
    elastic: dict[int, Any] = {i: element for i, element in enumerate(system.elements) if element.has_gap and not element.rigid}
    if not elastic:
        return

    def shares_of_rates() -> ca.Function:
        shares = []
        for i, element in elastic.items():
            grows = ca.jtimes(element.rate, system.x, system.flow)
            closed, opened = (ca.substitute(grows, system.m[i], mode) for mode in (0, 1))
            shares.append((closed - opened) / (element.closure + element.relaxation * element.rate))
        symbols = [system.t, system.x, system.u, system.p, system.F, system.m, system.held]
        return ca.Function("push", symbols, [ca.densify(ca.vertcat(*shares))])

    found, n = system.once("push", shares_of_rates), system.x.numel()
    tried = [np.cos(np.arange(1, n + 1) * k) * 1e-3 for k in (1.0, 2.3, 3.7)]
    seen = np.column_stack([np.array(found(0.0, x, 0.0, system.values, 0.0, 1.0, 0.0)).ravel() for x in tried])
    for element, row in zip(elastic.values(), seen, strict=True):
        if (row > 0.0).all() and np.ptp(row) < 1e-6 * row.max():
            raise SceneError(
                f"The force of `{element.name}` must act against its closure, but in the flow it stands with the sign that closes the gap further."
            )


YIELDS = 1e-3
"""What is added to the gain of a contact that may hold what others hold, where the rest is asked for dependence."""


def check_gain(system: HybridSystem) -> None:
    """Raise SceneError unless every force pulls its own slip towards zero and no slip is a combination of others. If the gain varies with
    the state, only frictions with two directions are checked."""
    gain = system.switched_equations.gain
    varies = bool(system.elements) and system.once("gain varies", lambda: ca.depends_on(gain, ca.vertcat(system.t, system.x, system.u)))
    if not system.elements or varies:
        _check_cones(system)
        return
    symbols = [system.t, system.x, system.u, system.p, system.m]
    found = system.once("gain", lambda: ca.Function("gain", symbols, [gain]))  # with its zeros it would grow as the square of a chain
    matrix = found(0.0, 0.0, 0.0, system.values, 0.0)
    held = [i for i, element in enumerate(system.elements) if element.holds and i not in system.switched_equations.passing]
    holding = [system.elements[i] for i in held]
    for element, entry in zip(holding, np.array(ca.diag(matrix)).ravel()[held], strict=True):
        if not entry > 0:
            raise SceneError(
                f"Element {element.title} must oppose its slip (d slip_rate/d force > 0, relative degree one), but the gain is {entry:g}."
            )
    if gain.sparsity().is_diag() or not held:
        return
    matrix = matrix.full()[np.ix_(held, held)]
    size = np.sqrt(np.diag(matrix))
    matrix = matrix / np.outer(size, size)
    # two stops of one body are never closed together: only one of them counts
    opposed = [
        j for j, b in enumerate(holding) if b.rigid and any(a.rigid and matrix[i, j] < -1 + 1e-12 for i, a in enumerate(holding[:j]))
    ]
    kept = [i for i in range(len(holding)) if i not in opposed]
    matrix, holding = matrix[np.ix_(kept, kept)], [holding[i] for i in kept]
    for i in (*system.switched_equations.shared.members, *system.switched_equations.shared.rigid):
        k = next((k for k, element in enumerate(holding) if element is system.elements[i]), None)
        if k is not None:
            matrix[k, k] += YIELDS
    dependent = dependent_rows(matrix)
    if dependent:
        raise SceneError(
            f"{must_be_independent([holding[i].title for i in dependent])} Their slips depend on each other for these values of the parameters only, such as "
            "for one gear ratio: change a value, or make one of the frictions a bristle (`Dahl`, `LuGre`)."
        )


def _rings(system: HybridSystem) -> list[list[int]]:
    """The rings of frictions of a plant, by the numbers of their elements."""
    form = system.switched_equations
    return system.once("rings", lambda: rings_of(system.elements, form.gain)) if form.shared.members else []


def has_rings(system: HybridSystem) -> bool:
    """Whether frictions of a plant hold each other's slips in a ring, so that `check_rings` depends on its numbers."""
    return bool(_rings(system))


def check_rings(system: HybridSystem) -> None:
    """Frictions must not hold each other's slips in a ring that no stop explains, as two on the ground and one between their bodies do.

    With static friction above kinetic the motion is not unique there. Where both are equal it is, and the ring may stay if its slips keep their ratios.
    """
    form = system.switched_equations
    for ring in _rings(system):
        if not _can_rest(system, ring):
            continue
        words = f"The frictions {', '.join(f'`{system.elements[i].name}`' for i in ring)} hold each other in a ring"
        remedy = "make one of them a bristle (`Dahl`, `LuGre`), or carry it by a spring."
        weaker = [system.elements[i].name for i in ring if _weakens(system, system.elements[i])]
        if weaker:
            raise SceneError(
                f"{words}, and the static friction of `{weaker[0]}` is above its kinetic friction: nothing decides how they share a force at rest, and which "
                f"of them gives way first, so that the motion is not unique. Let static and kinetic friction of each be equal, {remedy}"
            )
        if not system.once(("motions", *ring), partial(motions_of, form.gain, ring, ca.vertcat(system.t, system.x))):
            raise SceneError(
                f"{words} whose slips have too many motions, or change their ratios with the states: the toolbox does not follow such a ring. Instead, {remedy}"
            )


def _weakens(system: HybridSystem, friction: Element) -> bool:
    """Whether the static friction of a law is not its kinetic friction where slip begins, either way."""
    law = friction.law
    if law is None:
        return False

    def falls() -> ca.Function:
        laws = {id(each): each for each in (law, law.reverse())}.values()
        ends = [each.breakaway() - each.sliding(ca.SX(0), *[ca.SX(0)] * len(each.break_speeds())) for each in laws]
        return ca.Function("falls", [system.p], [ca.vertcat(*ends), ca.vertcat(*[each.breakaway() for each in laws])])

    found, bounds = system.once(("falls", friction.name), falls)(system.values)
    return bool((np.abs(np.array(found)) > 1e-9 * np.abs(np.array(bounds))).any())


def _can_rest(system: HybridSystem, ring: Sequence[int]) -> bool:
    """Whether slips that depend on each other can all be zero at once: those of one body against surfaces of different speeds never are."""

    def slips_and_gain() -> ca.Function:
        read = ca.vertcat(*[system.elements[i].slip for i in ring])
        symbols = [system.t, system.x, system.u, system.p, system.m]
        return ca.Function("slips", symbols, [ca.densify(read), ca.densify(system.switched_equations.gain[list(ring), list(ring)])])

    slips = system.once(("slips", *ring), slips_and_gain)
    x = np.cos(np.arange(1, system.x.numel() + 1))
    found, gain = (np.array(value) for value in slips(0.3, x, system.input_defaults(system.values), system.values, 0.0))
    size = np.sqrt(np.diag(gain))
    _, values, vectors = np.linalg.svd(gain / np.outer(size, size))
    apart = vectors[values < 1e-9] @ (found.ravel() / size)
    return bool((np.abs(apart) <= 1e-9 * np.abs(found.ravel() / size).max()).any())


def check_wedges(system: HybridSystem) -> None:
    """No load may read the force of a stop of a body without play: both stops may press on it, and nothing decides how strongly."""
    rigid = [e for e in system.elements if e.rigid and not e.is_unilateral]
    if len(rigid) < 2 or not any(ca.depends_on(e.static, ca.vertcat(*[r.multiplier for r in rigid])) for e in system.elements):
        return
    rows = system.once("wedges", lambda: dependent_holds(system.elements, system.switched_equations.gain))
    for together in rows:
        read = ca.vertcat(*[system.elements[i].closure for i in together])
        closures = ca.Function("closures", [system.t, system.x, system.u, system.p, system.held], [read])
        found = np.array(closures(0.0, 0.0, system.input_defaults(system.values), system.values, 0.0)).ravel()
        if all(system.elements[i].rigid for i in together) and not found.any():
            check_loads(system.elements, together, together[0])


def _check_cones(system: HybridSystem) -> None:
    """Frictions in two directions whose gain varies must not hold more than their bodies can move, as two points of one rigid disc do at every state."""
    cones = [i for i, element in enumerate(system.elements) if element.directions > 1]
    if len(cones) < 2:
        return
    rows = sorted(cones + [i + 1 for i in cones])
    found = system.function("gain", system.switched_equations.gain, "A")
    dependent: list[int] = []
    for k in (1.0, 2.3, 3.7):
        x = np.cos(np.arange(1, system.x.numel() + 1) * k)
        matrix = np.array(found(0.1 * k, x, k, system.values, k))[np.ix_(rows, rows)]
        size = np.sqrt(np.abs(np.diag(matrix)))
        if not np.isfinite(matrix).all() or not size.all():
            return
        dependent = dependent_rows(matrix / np.outer(size, size))
        if not dependent:
            return
    names = dict.fromkeys(f"`{system.elements[rows[k] if rows[k] in cones else rows[k] - 1].name}`" for k in dependent)
    raise SceneError(
        f"{must_be_independent(list(names))} A rigid body that rubs at several points needs another model: carry each contact by a small mass on a spring "
        "of its own, so that the springs share the force, or let the body rub at one point."
    )
