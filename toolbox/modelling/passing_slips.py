"""Slips that no force of their own element holds: friction on a prescribed motion, and relays that act through lags.

The force of a friction whose slip is given in time is -kinetic sgn(v), whatever moves the machine. While the given slip stands still it may be any force up
to the bound, and nothing decides which: a run ends there with an error. A relay of higher degree switches with the sign of its surface, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from toolbox.modelling.elements import Element


def passing_slips(
    elements: Sequence[Element], flow: ca.SX, x: ca.SX, force: ca.SX, slip: ca.SX, gain: ca.SX
) -> tuple[int, ...]:
    """Return the numbers of the frictions whose slip none of their force ever reaches, and of the relays that are declared as of higher degree."""
    tried = [i for i, e in enumerate(elements) if e.slides and e.directions == 1 and not e.second and not gain.has_nz(i, i)]
    tried = [i for i in tried if elements[i].higher_degree or (elements[i].law is not None and elements[i].slip.nnz())]
    if not tried:
        return ()
    acts, moves, reads = ca.jacobian_sparsity(flow, force), ca.jacobian_sparsity(flow, x), ca.jacobian_sparsity(slip, x)
    following: dict[int, set[int]] = {}
    for row, column in zip(*moves.get_triplet(), strict=True):
        following.setdefault(column, set()).add(row)
    found = []
    for i in tried:
        reached: set[int] = set()
        left = {row for row, column in zip(*acts.get_triplet(), strict=True) if column == i}
        while left:
            reached |= left
            left = {row for column in left for row in following.get(column, ())} - reached
        read = {column for row, column in zip(*reads.get_triplet(), strict=True) if row == i}
        if elements[i].higher_degree or not read & reached:
            found.append(i)
    return tuple(found)
