"""Frictions in a ring, as two on the ground and one between their bodies: when they give way together, though nothing decides their shares at rest.

Some ways to move leave as many of the slips at rest as can be, as that of one body alone or of both together. In such a motion the frictions slip in fixed
ratios u_k. At rest the sum of u_k F_k follows from the balance of forces, whatever the shares are, and the bodies rest while for each of these motions

    |sum of u_k F_k| <= sum of |u_k| bound_k      (sums over the frictions that stick)

Every other motion is a sum of these, so that shares within all bounds exist if and only if this holds. A friction of a ring therefore gives way where the first
motion that it slips in does, not where its own share, which is one of many, reaches its bound.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence

import casadi as ca
import numpy as np

from toolbox.modelling.elements import Element
from toolbox.modelling.elimination import masked_solve
from toolbox.modelling.shared_holds import NO_MORE, dependent_holds

MOST_TRIED = 2000
"""Sets of slips held at rest that are searched for the motions of a ring."""

MOVES = 1e-9
"""Part of the largest slip of a motion below which a friction does not slip in it."""


def rings_of(elements: Sequence[Element], gain: ca.SX) -> list[list[int]]:
    """Return the rings, as the numbers of their frictions."""
    rubbing = [i for i, e in enumerate(elements) if e.slides and e.directions == 1 and not e.second and e.law is not None]
    return dependent_holds(elements, gain, rubbing)


def limits_of_rings(
    elements: Sequence[Element], gain: ca.SX, along: ca.SX, force: ca.SX, bound: ca.SX, sticks: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return the force and the bound that release each element. The frictions of a ring are released by the first motion with slip.

    Rings whose ratios of slips change with states or time, or that have too many motions, are left as they are.
    """
    force, bound = ca.SX(force), ca.SX(bound)
    for ring in rings_of(elements, gain):
        motions = motions_of(gain, ring, along)
        holds = [sticks[i] * bound[i] for i in ring]
        pulls = [sticks[i] * force[i] for i in ring]
        for k, i in enumerate(ring):
            ahead, back = [], []
            for motion in (motion for motion in motions if k in motion):
                ratios = {j: ratio / motion[k] for j, ratio in motion.items()}
                least = sum((ca.fabs(ratio) * holds[j] for j, ratio in ratios.items()), ca.SX(0))
                pull = sum((ratio * pulls[j] for j, ratio in ratios.items()), ca.SX(0))
                ahead.append(least - pull)
                back.append(least + pull)
            if ahead:
                up, down = functools.reduce(ca.fmin, ahead), functools.reduce(ca.fmin, back)
                force[i] = sticks[i] * (down - up) / 2 + (1 - sticks[i]) * force[i]
                bound[i] = sticks[i] * (down + up) / 2 + (1 - sticks[i]) * bound[i]
    return force, bound


def motions_of(gain: ca.SX, ring: Sequence[int], along: ca.SX) -> list[dict[int, ca.SX]]:
    """Return the motions of a ring that leave as many slips at rest as possible: {place in the ring: ratio of its slip}. Empty if the
    motions are not found.

    With slips H at rest the motion that a force along another slip j makes is A_j - A_H A_HH^-1 A_Hj.
    """
    part = gain[list(ring), list(ring)]
    if ca.depends_on(part, along):
        return []
    symbols = ca.symvar(part)
    random = np.random.default_rng(0)
    numbers = ca.Function("gain", symbols, [ca.densify(part)])
    matrix = np.array(numbers.call([ca.DM(0.5 + random.random(s.shape)) for s in symbols])[0]).reshape(len(ring), len(ring))
    size = np.sqrt(np.diag(matrix))
    matrix = matrix / np.outer(size, size)
    free = int((np.linalg.svd(matrix)[1] > NO_MORE).sum())
    if math.comb(len(ring), free - 1) > MOST_TRIED:
        return []
    found: dict[tuple[int, ...], dict[int, ca.SX]] = {}
    for chosen in itertools.combinations(range(len(ring)), free - 1):
        held = list(chosen)
        among = matrix[np.ix_(held, held)]
        if held and np.linalg.svd(among)[1].min() < NO_MORE:
            continue
        for j in (j for j in range(len(ring)) if j not in held):
            slips = matrix[:, j] - matrix[:, held] @ np.linalg.solve(among, matrix[held, j]) if held else matrix[:, j]
            if np.abs(slips).max() > MOVES:
                moving = tuple(np.flatnonzero(np.abs(slips) > MOVES * np.abs(slips).max()).tolist())
                if moving not in found:
                    found[moving] = _ratios(part, held, j, moving)
                break
    return list(found.values())


def _ratios(part: ca.SX, held: list[int], j: int, moving: Sequence[int]) -> dict[int, ca.SX]:
    """The slips of a motion, in parts of that of its first friction: numbers where they depend on no parameter, as those of bodies on one line."""
    slips = part[:, j] - (part[:, held] @ masked_solve(part[held, held], ca.densify(part[held, j])) if held else 0)
    ratios = ca.vertcat(*[slips[k] / slips[moving[0]] for k in moving])
    symbols = ca.symvar(ratios)
    numbers = ca.Function("ratios", symbols, [ratios])
    drawn = [
        np.array(numbers.call([ca.DM(0.5 + np.random.default_rng(seed).random(s.shape)) for s in symbols])[0]).ravel() for seed in range(3)
    ]
    if np.ptp(drawn, axis=0).max() < 1e-12 * np.abs(drawn).max():
        return {k: ca.SX(float(f"{value:.13g}")) for k, value in zip(moving, drawn[0], strict=True)}
    return {k: ratios[n] for n, k in enumerate(moving)}
