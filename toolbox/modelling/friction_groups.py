"""Frictions on one slip, as those of a bearing and a brake on one shaft: they stick, break away and slide together, as one friction of the equations.

With slips v_k = c_k v, constants c_k, and forces F_k that act along them, only T = sum c_k F_k moves the bodies:

    slip:   F_k = -sgn(v_k) kinetic_k, each by its own law
    stick:  v = 0 while |T| <= W = sum |c_k| static_k;  F_k = sgn(c_k) static_k T / W, so that all reach their bounds at once

The motion does not depend on the shares at rest: whichever friction carries more, the shaft holds up to W. The equations therefore have one friction, the
leader, with bound W and force T. The others follow: their modes are its mode, their forces the shares above, and each bound must stay >= 0 by itself.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from toolbox.errors import SceneError
from toolbox.modelling.elements import Element, FrictionLaw

SAME = 1e-12
"""Part of its size below which a difference at random points is round-off."""


class Groups(NamedTuple):
    """Elements with a single friction for all frictions on the same slip, and the expressions that replace their symbols.

    elements: as many as before; `flow` and `loads` are expressions of the leaders' forces;  old, new: symbols of forces and modes, and what signals, powers
    and the laws of others read in their place;  leaders: {follower: (leader, sign of its slip against that of the leader)}.
    """

    elements: list[Element]
    flow: ca.SX
    old: list[ca.SX]
    new: list[ca.SX]
    leaders: dict[str, tuple[str, ca.SX]]


@dataclass(frozen=True)
class GroupLaw(FrictionLaw):
    """The law of several frictions on one slip: the sum of their laws, each at its own speed, loads among the coefficients."""

    parts: tuple[tuple[ca.SX, FrictionLaw, ca.SX], ...] = ()  # size of c_k, law, load

    def _each(self, speed: ca.SX, beyond: Sequence[ca.SX]) -> list[ca.SX]:
        left, found = list(beyond), []
        for size, law, load in self.parts:
            own = [left.pop(0) for _ in law.break_speeds()]
            found.append(size * load * law.sliding(size * speed, *own))
        return found

    def sliding(self, speed: ca.SX, *beyond: ca.SX) -> ca.SX:
        return sum(self._each(speed, beyond), ca.SX(0))

    def reverse(self) -> FrictionLaw:
        if all(law.reverse() is law for _, law, _ in self.parts):
            return self
        return GroupLaw(tuple((size, law.reverse(), load) for size, law, load in self.parts))

    def break_speeds(self) -> tuple[ca.SX, ...]:
        return tuple(place / size for size, law, _ in self.parts for place in law.break_speeds())

    def breakaway(self) -> ca.SX:
        return sum((size * load * law.breakaway() for size, law, load in self.parts), ca.SX(0))


class Follower(Element):
    """A friction that shares the slip and the mode of another friction. Only the bound is its own."""

    holds = False

    def __init__(self, of: Element):
        super().__init__(of.name, 0, of.slip_unit, of.force_unit)
        self.multiplier, self.mode, self.static = of.multiplier, of.mode, of.static

    def guards(self, multiplier: ca.SX, bound: ca.SX) -> tuple[ca.SX, ca.SX]:
        return ca.SX(1), ca.SX(1)


def grouped(t: ca.SX, x: ca.SX, flow: ca.SX, elements: Sequence[Element]) -> Groups | None:
    """Return the elements and the flow with one friction in place of all on one slip; None if no two frictions share one.

    Slips that are multiples of each other for certain values of parameters only, as with a gear ratio of 1, do not share one.
    Raises SceneError for a load that reads the force of one friction of a group: at rest nothing decides it.
    """
    members = _on_one_slip(t, x, flow, elements)
    if not members:
        return None
    found = Groups(list(elements), flow, [], [], {})
    for group in members:
        found = _merged(found, group)
    return found


def _on_one_slip(t: ca.SX, x: ca.SX, flow: ca.SX, elements: Sequence[Element]) -> list[list[tuple[int, ca.SX]]]:
    """The groups: numbers of their elements, the leader first, with the constants c."""
    rubbing = [i for i, e in enumerate(elements) if e.law is not None and e.slides and e.directions == 1 and not e.second]
    if len(rubbing) < 2:
        return []
    rows = ca.jacobian(ca.vertcat(*[elements[i].slip for i in rubbing]), x)
    alike: dict[tuple[int, ...], list[int]] = {}
    columns: dict[int, list[int]] = {}
    for r, column in zip(*rows.sparsity().get_triplet(), strict=True):
        columns.setdefault(r, []).append(column)
    for r, i in enumerate(rubbing):
        if r in columns:
            alike.setdefault(tuple(columns[r]), []).append(i)
    groups = []
    for support, candidates in alike.items():
        left = candidates
        while len(left) > 1:
            first, *others = left
            group, left = [(first, ca.SX(1))], []
            for i in others:
                c = rows[rubbing.index(i), support[0]] / rows[rubbing.index(first), support[0]]
                alone = not ca.depends_on(c, ca.vertcat(t, x)) or _is_constant(c, ca.vertcat(t, x))
                if alone and _acts_alike(flow, elements, first, i, _at_numbers(c, t, x)):
                    group.append((i, _at_numbers(c, t, x)))
                else:
                    left.append(i)
            if len(group) > 1:
                groups.append(group)
    return groups


def _at_numbers(c: ca.SX, t: ca.SX, x: ca.SX) -> ca.SX:
    """A constant that is written with states, without them."""
    along = ca.vertcat(t, x)
    return ca.substitute(c, along, ca.SX(np.linspace(0.6, 1.4, along.numel()))) if ca.depends_on(c, along) else c


def _is_constant(value: ca.SX, along: ca.SX) -> bool:
    return _vanishes(ca.sumsqr(ca.densify(ca.jacobian(value, along))), value**2)


def _acts_alike(flow: ca.SX, elements: Sequence[Element], first: int, i: int, c: ca.SX) -> bool:
    """Whether slip i is c times the slip of the first, and its force acts as that of the first, times c."""
    both = [elements[first], elements[i]]
    if not _vanishes((both[1].slip - c * both[0].slip) ** 2, both[1].slip ** 2):
        return False
    effect = ca.jacobian(flow, ca.vertcat(*[e.multiplier for e in both]))
    return _vanishes(ca.sumsqr(ca.densify(effect[:, 1] - c * effect[:, 0])), ca.sumsqr(ca.densify(effect[:, 1])))


def _vanishes(square: ca.SX, size: ca.SX) -> bool:
    """Whether a square is zero at random points beside the square of its size."""
    symbols = ca.symvar(ca.vertcat(square, size))
    values = ca.Function("values", symbols, [square, size])
    for seed in range(4):
        random = np.random.default_rng(seed)
        found, least = map(float, values.call([ca.DM(0.5 + random.random(s.shape)) for s in symbols]))
        if not abs(found) <= SAME**2 * least:
            return False
    return True


def _merged(so_far: Groups, group: Sequence[tuple[int, ca.SX]]) -> Groups:
    """The elements with one friction in place of those of a group."""
    elements = list(so_far.elements)
    own = [elements[i] for i, _ in group]
    first = own[0]
    sizes = [ca.SX(1) if k == 0 else ca.fabs(c) for k, (_, c) in enumerate(group)]
    signs = [ca.SX(1) if k == 0 else c / ca.fabs(c) for k, (_, c) in enumerate(group)]
    followed, mode = [e.mode for e in own[1:]], [sign * first.mode for sign in signs[1:]]

    def by_leader(expression: ca.SX) -> ca.SX:
        return ca.substitute([ca.SX(expression)], followed, mode)[0]

    rubs = [by_leader(e.load * e.sliding) for e in own]
    bounds = [by_leader(e.static) for e in own]
    leader = _leading(own, sizes, by_leader, bounds)
    members = {i for i, _ in group}
    _check_readers(elements, own, sizes, signs)
    total = first.multiplier
    shares = [
        sign * ((1 - first.mode**2) * bound / (leader.static + first.mode**2 + 1e-300) * total - first.mode * rub)
        for sign, bound, rub in zip(signs, bounds, rubs, strict=True)
    ]
    others = [e.multiplier for e in own[1:]]
    nothing = [ca.SX(0)] * len(others)

    def by_sum(expression: ca.SX) -> ca.SX:
        return by_leader(ca.substitute([ca.SX(expression)], others, nothing)[0])

    elements = [e.mapped(by_sum) for e in elements]
    where = _place(elements, group, leader)
    slots = sorted(members)
    slots.remove(where)
    elements[where] = leader
    for i, e in zip(slots, own[1:], strict=True):
        elements[i] = Follower(e)
        elements[i].static = by_leader(e.static)
    leaders = so_far.leaders | {e.name: (first.name, sign) for e, sign in zip(own[1:], signs[1:], strict=True)}
    old, new = [total, *others, *followed], [*shares, *mode]
    return Groups(elements, by_sum(so_far.flow), [*so_far.old, *old], [*so_far.new, *new], leaders)


def _leading(own: Sequence[Element], sizes: Sequence[ca.SX], by_leader: Callable[[ca.SX], ca.SX], bounds: Sequence[ca.SX]) -> Element:
    """The friction that stands for those of a group."""
    first = own[0]
    leader = copy.copy(first)
    one_load = all(ca.is_equal(e.load, first.load, 10) for e in own)
    leader.load = first.load if one_load else ca.SX(1)
    parts = [e.sliding if one_load else e.load * e.sliding for e in own]
    leader.sliding = sum((size * by_leader(part) for size, part in zip(sizes, parts, strict=True)), ca.SX(0))
    leader.static = sum((size * bound for size, bound in zip(sizes, bounds, strict=True)), ca.SX(0))
    leader.companions = [twin for e in own for twin in e.companions]
    loads = [ca.SX(1) if one_load else e.load for e in own]
    leader.law = GroupLaw(tuple((s, e.law, load) for s, e, load in zip(sizes, own, loads, strict=True) if e.law is not None))
    return leader


def _check_readers(elements: Sequence[Element], own: Sequence[Element], sizes: Sequence[ca.SX], signs: Sequence[ca.SX]) -> None:
    """Raise SceneError for a load that reads the force of one friction of a group."""
    forces = ca.vertcat(*[e.multiplier for e in own])
    for other in elements:
        reads = ca.vertcat(other.static, other.load * other.sliding)
        if ca.depends_on(reads, forces) and not _reads_the_sum(reads, own, sizes, signs):
            among = ", ".join(f"`{e.name}`" for e in own)
            raise SceneError(
                f"The load of `{other.name}` must not be the force of one of the frictions {among}: they share one slip, so that at rest nothing decides "
                "which of them carries how much. Let the load be their sum, or make one of them a bristle (`Dahl`, `LuGre`)."
            )


def _place(elements: Sequence[Element], group: Sequence[tuple[int, ca.SX]], leader: Element) -> int:
    """Where the leader stands: at the place of its first friction behind all whose forces its bound reads."""
    read = ca.vertcat(leader.static, leader.load * leader.sliding)
    last = max((j for j, e in enumerate(elements) if ca.depends_on(read, e.multiplier)), default=-1)
    return next((i for i, _ in sorted(group, key=lambda pair: pair[0]) if i > last), max(i for i, _ in group))


def _reads_the_sum(reads: ca.SX, own: Sequence[Element], sizes: Sequence[ca.SX], signs: Sequence[ca.SX]) -> bool:
    """Whether what reads forces of a group reads no more than their sum, each times its c."""
    slopes = ca.jacobian(reads, ca.vertcat(*[e.multiplier for e in own]))
    for k in range(1, len(own)):
        apart = slopes[:, k] - sizes[k] * signs[k] * slopes[:, 0]
        if not _vanishes(ca.sumsqr(ca.densify(apart)), ca.sumsqr(ca.densify(slopes[:, k]))):
            return False
    return True
