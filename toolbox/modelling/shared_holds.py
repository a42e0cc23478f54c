"""Frictions that hold what others hold already: a seal beside a stop that is closed, wagons that touch, backlash with friction on both sides.

At rest the motion says what such contacts carry together, not the share of each, and their balance of forces is singular. Frictions among them therefore
yield a little, the more the lower their bound is,

    w_i (A F + b)_i + s_i F_i = 0,      w_i = n bound_i / sum bound,   s_i in proportion to 1e-5 |c_i| where all slip together, at c_i v

so that those that are loaded most reach their bounds at one time, and a rigid contact, which does not yield, takes what it can. Three more solutions with what
the first leaves of the slip rates as right sides take the yield out of the motion again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from toolbox.errors import SceneError
from toolbox.modelling.elements import Element
from toolbox.modelling.elimination import coupled_groups, masked_solve

SOFT = 1e-5
"""How far a friction yields whose slip is held by others, too, in parts of the gain."""

REPEATED = 3
"""Solutions after the first: each takes all but about this part of the yield out of the motion."""

SMALL = 12
"""Contacts that hold each other, beyond which all of a group are taken to slip at one speed where they slip together, as wagons do."""

LOOSE = 1e-9
"""How far a rigid contact yields, in parts of its own gain, where the softness of frictions is asked for."""

LEAST = 1e-6
"""Part of the gain below which closed contacts leave a friction no motion of its own: it yields as one that nothing else holds."""

MANY = 200
"""Elements that hold each other, of which no more are searched for shared holds."""

NO_MORE = 1e-11
"""Singular value of a matrix with ones on its diagonal below which its rows depend on each other."""


@dataclass(frozen=True)
class Sharing:
    """Frictions and rigid contacts that hold the same slips as other elements, with the weights and the softness of the rows of all
    elements."""

    members: tuple[int, ...]
    rigid: tuple[int, ...]
    weights: ca.SX
    softness: ca.SX

    def of_impulse(self, gain: ca.SX, held: ca.SX, floor: ca.SX) -> ca.SX:
        """The matrix of impulses: held rows as for forces, the others give no impulse."""
        matrix = ca.sparsify(ca.diag(held * self.weights) @ gain + ca.diag(1 - held))
        return ca.sparsify(matrix + ca.diag(held * (floor + self.softness)))

    def held(self, solved: Callable[[ca.SX, ca.SX], ca.SX], matrix: ca.SX, right: ca.SX, sticks: ca.SX) -> ca.SX:
        """Solve matrix * F = right with soft rows of the members. The solution is repeated until the slip rates of the members are zero in
        spite of the softness.

        sticks: 1 for rows that hold.
        """
        found = solved(matrix, right)
        for _ in range(REPEATED if self.members else 0):
            rest = ca.SX.zeros(right.numel())
            for i in self.members:
                rest[i] = sticks[i] * self.softness[i] * found[i]
            found = found + solved(matrix, self._left(matrix, right, found, rest))
        return found

    def _left(self, matrix: ca.SX, right: ca.SX, found: ca.SX, rest: ca.SX) -> ca.SX:
        """What the members' rows lack of zero slip rate; the other rows are solved already."""
        left = ca.SX.zeros(right.numel())
        for i in self.members:
            left[i] = right[i] - matrix[i, :] @ found + rest[i]
        return left


def sharing(elements: Sequence[Element], gain: ca.SX, force: ca.SX, static: ca.SX) -> Sharing:
    """Return the frictions that yield because other elements hold their slips too.

    Raises SceneError for a load that reads the force of one of these contacts: nothing decides it, and then the motion is not unique.
    """
    n = len(elements)
    weights, softness = ca.SX.ones(n), ca.SX(n, 1)
    members: list[int] = []
    stops = [i for i, e in enumerate(elements) if e.rigid]
    rigid = [i for together in dependent_holds(elements, gain, stops) for i in together]
    for together in dependent_holds(elements, gain):
        rubbing = [i for i in together if _rubs(elements[i])]
        if rubbing:
            check_loads(elements, together, rubbing[0])
        members += rubbing
        for i, soft in zip(rubbing, _softness(elements, gain, together, rubbing), strict=True):
            softness[i] = soft
    alone = [i for i in members if not ca.depends_on(static[i], force)]
    total = sum((static[i] for i in alone), ca.SX(0))
    for i in alone:
        weights[i] = (len(alone) * static[i] + 1e-300) / (total + 1e-300)
    return Sharing(tuple(sorted(members)), tuple(sorted(rigid)), weights, softness)


def _softness(elements: Sequence[Element], gain: ca.SX, together: Sequence[int], rubbing: Sequence[int]) -> list[ca.SX]:
    """How far each of these frictions yields: in proportion to how fast it slips where all of them slip together, so that all are loaded as their weights say.

    With gains G that closed contacts leave, a motion c_i v has G_ii in proportion to c_i^2.
    """
    closed = [i for i in together if elements[i].rigid]
    size = sum((gain[i, i] for i in rubbing), ca.SX(0)) / len(rubbing)
    if not closed or len(together) > SMALL:
        return [SOFT * size for _ in rubbing]
    holds = ca.vertcat(*[1 - elements[i].mode ** 2 for i in closed])
    among, own = gain[closed, closed], ca.diag(gain[closed, closed])
    matrix = ca.sparsify(ca.diag(holds) @ among + ca.diag((1 - holds) + holds * LOOSE * own))
    found = []
    for i in rubbing:
        left = (gain[i, i] - gain[i, closed] @ masked_solve(matrix, ca.densify(holds * gain[closed, i]))) / size
        found.append(SOFT * size * (ca.sqrt(left + LOOSE**2) + (LEAST / (left + LEAST)) ** 2))
    return found


def _rubs(element: Element) -> bool:
    return element.slides and element.directions == 1 and not element.second


def check_loads(elements: Sequence[Element], together: Sequence[int], friction: int) -> None:
    """Raise SceneError if a load reads the force of a contact whose slip another contact holds too."""
    for element in elements:
        read = ca.vertcat(element.static, element.load, element.sliding)
        held = next((j for j in together if ca.depends_on(read, elements[j].multiplier)), None)
        if held is not None:
            rubs = elements[friction] if friction != held else elements[next(j for j in together if j != held)]
            remedy = (
                f"give `{elements[held].name}` a `stiffness` in place of its restitution"
                if elements[held].rigid
                else (f"make `{elements[held].name}` a bristle (`Dahl`, `LuGre`)")
            )
            raise SceneError(
                f"The load of `{element.name}` must not be the force of `{elements[held].name}`: `{rubs.name}` can hold the same slip, so that at rest "
                f"nothing decides how much of the force each carries, and the motion is not unique. To decide it, {remedy}."
            )


def dependent_holds(elements: Sequence[Element], gain: ca.SX, among: Sequence[int] | None = None) -> list[list[int]]:
    """Return groups of elements whose slips depend on each other at every state, by their indices. A slip that an element of a group holds
    can be held by others. among: elements to look at, all by default."""
    held = [i for i, e in enumerate(elements) if e.holds and (among is None or i in among)]
    if not 1 < len(held) <= MANY or gain.sparsity().is_diag():
        return []
    part = gain[held, held]
    symbols = ca.symvar(part)
    numbers = ca.Function("gain", symbols, [ca.densify(part)])
    shared = np.ones((len(held), len(held)), bool)
    for seed in range(3):
        random = np.random.default_rng(seed)
        matrix = np.array(numbers.call([ca.DM(0.5 + random.random(s.shape)) for s in symbols])[0]).reshape(len(held), len(held))
        size = np.sqrt(np.abs(np.diag(matrix)))
        if not np.isfinite(matrix).all() or not size.all():
            return []
        _, values, vectors = np.linalg.svd(matrix / np.outer(size, size))
        null = vectors[values < NO_MORE]
        shared &= np.abs(null.T @ null) > 1e-9
    groups = coupled_groups(ca.sparsify(ca.DM(shared * 1.0)).sparsity()) if shared.any() else []
    return [[held[k] for k in group] for group in groups if len(group) > 1]
