"""Sliding-mode observer of a drill string."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from controllers.observers.linear import StringObserver, placed
from toolbox import Quantity, quantity


@dataclass(frozen=True)
class SlidingObserver(StringObserver):
    """Sliding-mode observer with a boundary layer: the top speed is followed by a switching injection, whose mean value drives the rest.

        x_hat' = A x_hat + B u + g v,   v = size clip(e / layer, -1, 1) + reaching e,   e = w_top - w_top_hat

    g has 1 for the top speed, so that on e = 0 the remaining errors decay with all poles at -bandwidth, whatever the injection. `switching_gain` must
    exceed what the errors can do to the top speed; `reaching` brings large errors back, where a bounded injection alone would wind the estimates
    up. Source: V. Utkin, Sliding Modes in Control and Optimization, Springer 1992 (chapter on observers); gains by pole placement.
    """

    bandwidth: Quantity = quantity(3.0, "rad/s", "distance of the poles on the sliding surface from zero", above=0)
    switching_gain: Quantity = quantity(5.0, "rad/s2", "injection at the edge of the layer", above=0)
    reaching: Quantity = quantity(20.0, "1/s", "gain on large errors", at_least=0)
    boundary_layer: Quantity = quantity(0.1, "rad/s", "half-width of the boundary layer", above=0)

    def injection(self, error):
        """The switching injection [rad/s2]."""
        return self.switching_gain * ca.fmin(ca.fmax(error / self.boundary_layer, -1), 1) + self.reaching * error

    def slope(self):
        """Return the slope of the correction for large errors, at which the switching part is bounded."""
        return self.reaching

    def gains(self, A, B, row):
        """g with row g = 1 and zeros of row (s - A)^-1 g, the poles in sliding, all at -bandwidth."""
        n = A.shape[0]
        # in sliding x' = (1 - g row) A x: its poles are 0 and the zeros; as L -> infinity, L = l g places n - 1 poles there
        reduced, coupling = _split(A, row)
        inner = placed(reduced, coupling, np.poly(np.full(n - 1, -self.bandwidth)))
        basis = _basis(row)
        return basis[:, 0] + basis[:, 1:] @ inner


def _basis(row: np.ndarray) -> np.ndarray:
    """Columns: a vector with row v = 1, then a basis of the kernel of row."""
    pivot = int(np.argmax(np.abs(row)))
    columns = np.eye(row.size)
    first = columns[:, pivot] / row[pivot]
    others = [columns[:, j] - row[j] * first for j in range(row.size) if j != pivot]
    return np.column_stack([first, *others])


def _split(A: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """In the basis above: the block of the kernel, and how the kernel acts on the measured speed."""
    basis = _basis(row)
    inside = np.linalg.solve(basis, A @ basis)
    return inside[1:, 1:], inside[0, 1:]
