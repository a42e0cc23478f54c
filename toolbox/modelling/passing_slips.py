"""Slips that no force of their own element holds: friction on a prescribed motion, and relays that act through lags.

The force of a friction whose slip is given in time is -kinetic sgn(v), whatever moves the machine. While the given slip stands still it may be any force up
to the bound, and nothing decides which: a run ends there with an error. A relay of higher degree switches with the sign of its surface, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from toolbox.modelling.elements import Element


def passing_slips(elements: Sequence[Element], flow: ca.SX, x: ca.SX, force: ca.SX, slip: ca.SX, gain: ca.SX) -> tuple[int, ...]:
    """Return the numbers of the frictions whose slip no force ever reaches, and of the relays that are declared as of higher degree."""
    tried = [i for i, e in enumerate(elements) if e.slides and e.directions == 1 and not e.second and not gain.has_nz(i, i)]
    rubbing = [i for i in tried if elements[i].law is not None and elements[i].slip.nnz()]
    found = [i for i in tried if elements[i].higher_degree]
    if rubbing:
        moved = _moved(flow, x, force)
        reads: dict[int, set[int]] = {i: set() for i in rubbing}
        for row, column in zip(*ca.jacobian_sparsity(slip, x).get_triplet(), strict=True):
            reads.setdefault(row, set()).add(column)
        found += [i for i in rubbing if not reads[i] & moved]
    return tuple(sorted(found))


def _moved(flow: ca.SX, x: ca.SX, force: ca.SX) -> set[int]:
    """The states that forces move, at once or through others."""
    following: dict[int, set[int]] = {}
    for row, column in zip(*ca.jacobian_sparsity(flow, x).get_triplet(), strict=True):
        following.setdefault(column, set()).add(row)
    reached: set[int] = set()
    left = set(ca.jacobian_sparsity(flow, force).row())
    while left:
        reached |= left
        left = {row for column in left for row in following.get(column, ())} - reached
    return reached
