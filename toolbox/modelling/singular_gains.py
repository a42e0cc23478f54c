"""Where the own gain of an element vanishes, or the gains of two hold one motion: levers at their dead centres, and stops that stand against each other.

With the lever p of a slip p(q) w the own gain is p^2 / M. Where p is zero no force holds the slip: the one that would has no bound. Two rigid contacts
of one body have A_ij^2 = A_ii A_jj: both closed, as on a body without play, their balance is singular.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from toolbox.modelling.elements import Element

VANISHING = 1e-60
"""What is added to the gain of a lever that may vanish: the force that would hold its slip there is then too large, not undefined."""

YIELDING = 1e-13
"""What is added, in parts of their own gain, to that of rigid contacts which stand against each other: where a body has no play both are closed, and their
balance has no solution of its own. The one that would pull is then let go; the other carries its force to this part of it."""

HELD = 1e-6
"""By what part of its bound the force of a contact whose lever may vanish may exceed it where the contact is put at zero slip: events are located so far."""


def vanishing_levers(elements: Sequence[Element], slip_of_state: ca.SX, gain_of_force: ca.SX, gain: ca.SX, along: ca.SX) -> tuple[int, ...]:
    """Return 1 for every friction whose gain on its own slip can vanish, else 0. The gain can vanish if all levers of the friction change
    with the states or time.

    They cannot where the gain does not change with them, as that of a wall around a shaft, whose levers are a cosine and a sine. A relay has no law and is
    none: at a surface that its switch does not reach it must not hold by force what it cannot.
    """
    found = []
    for i, element in enumerate(elements):
        alone = element.law is not None and element.slides and element.directions == 1 and not element.second
        columns = [j for j in slip_of_state[i, :].sparsity().get_col() if gain_of_force.has_nz(j, i)] if alone else []
        turns = bool(columns) and len(depending([slip_of_state[i, j] for j in columns], along)) == len(columns)
        found.append(int(turns and _changes(gain[i, i], along)))
    return tuple(found)


def _changes(value: ca.SX, along: ca.SX) -> bool:
    """Whether a value differs between points, by more than its round-off."""
    others = [symbol for symbol in ca.symvar(value) if not ca.depends_on(along, symbol)]
    numbers = ca.Function("value", [along, ca.vertcat(ca.SX(0, 1), *others)], [value])
    found = np.array([float(numbers(ca.DM(np.random.default_rng(seed).normal(size=along.numel())), 0.7)) for seed in range(4)])
    return not np.ptp(found) <= 1e-12 * np.abs(found).max()


def least_gains(gain: ca.SX, levers: Sequence[int], opposed: set[tuple[int, int]], dependent: Sequence[int] = ()) -> ca.SX:
    """Return the amount added to the own gain of every holding element, so that no pivot is zero. The amount is zero for most elements.

    dependent: rigid contacts whose slips others can hold.
    """
    floor = ca.SX(len(levers), 1)
    for i in np.flatnonzero(levers).tolist():
        floor[i] = VANISHING
    for i in {i for pair in opposed for i in pair} | set(dependent):
        floor[i] = YIELDING * gain[i, i]
    return floor


def opposed_contacts(elements: Sequence[Element], gain: ca.SX, along: ca.SX) -> set[tuple[int, int]]:
    """Pairs of rigid contacts that stand against each other, as two stops of one body: one closes as fast as the other opens, so that both hold one motion."""
    rigid = [i for i, element in enumerate(elements) if element.rigid]
    pairs = [(i, j) for k, i in enumerate(rigid) for j in rigid[:k] if gain.has_nz(i, j)]
    if not pairs:
        return set()
    both = ca.vertcat(*[gain[i, i] * gain[j, j] for i, j in pairs])
    shared = ca.vertcat(*[gain[i, j] * ca.fabs(gain[j, i]) for i, j in pairs])
    symbols = ca.symvar(ca.vertcat(both, shared))
    compared = ca.Function("compared", symbols, [both, shared], {"max_io": 10**9})
    found = set(pairs)
    for seed in range(2):
        random = np.random.default_rng(seed)
        a, b = (np.array(value).ravel() for value in compared.call([ca.DM(0.5 + random.random(symbol.shape)) for symbol in symbols]))
        found &= {pair for pair, one, other in zip(pairs, a, b, strict=True) if abs(one + other) <= 1e-12 * abs(one)}
    return {(i, j) for i, j in found if not depending([gain[i, j], gain[i, i], gain[j, j]], along)}


def _play(t: ca.SX, x: ca.SX, elements: Sequence[Element], gain: ca.SX, i: int, j: int) -> ca.SX:
    """The gap of contact i while contact j, which stands against it, is closed: the play of both, a number that no state changes.

    The gap itself also holds what the closure of j has drifted by, which is no depth of i.
    """
    play = elements[i].closure - gain[i, j] / gain[j, j] * elements[j].closure
    return ca.sqrt(ca.substitute(play, ca.vertcat(t, x), ca.SX.zeros(1 + x.numel())) ** 2 + 1e-300)


def with_play(guards: ca.SX, t: ca.SX, x: ca.SX, elements: Sequence[Element], gain: ca.SX, opposed: set[tuple[int, int]]) -> ca.SX:
    """Return the guards with the gap of a contact replaced by the play, as long as the opposite contact is closed."""
    for pair in opposed:
        for i, j in (pair, pair[::-1]):
            still = (1 - elements[j].mode) * elements[i].mode
            guards[2 * i] = (1 - still) * guards[2 * i] + still * _play(t, x, elements, gain, i, j)
    return guards


def held_by_force(levers: Sequence[int], sticks: ca.SX, force: ca.SX, bound: ca.SX) -> ca.SX:
    """1 for elements that are put at zero slip: all that stick, but of those whose lever may vanish the ones whose own force stays within its bound."""
    held = ca.SX(sticks)
    for i in np.flatnonzero(levers).tolist():  # squares, since a size would be a kink
        held[i] = sticks[i] * (force[i] ** 2 <= ((1 + HELD) * bound[i]) ** 2)
    return held


def depending(values: Sequence[ca.SX], symbols: ca.SX) -> set[int]:
    """Which of many scalar expressions depend on any of the symbols."""
    return set(ca.jacobian_sparsity(ca.vertcat(*values), symbols).row()) if values else set()
