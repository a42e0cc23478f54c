"""Sliding-mode observer of a drill string."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from controllers.observers.linear import StringObserver, placed
from toolbox import Quantity, quantity


@dataclass(frozen=True)
class SlidingObserver(StringObserver):
    """Sliding-mode observer of the string with a boundary layer: a switching injection makes the estimate follow the top speed.

        x_hat' = A x_hat + B u + g v,   v = size clip(e / layer, -1, 1) + reaching e,   e = w_top - w_top_hat

    A and B are the matrices of the string with the bit torque as last state, and u is the torque of the drive. size,
    layer and reaching are the fields `switching_gain`, `boundary_layer` and `reaching`.

    The entry of g for the top speed is 1. While e = 0, the other estimation errors decay with all poles at -bandwidth,
    for any injection v. Estimates: all states of the string by name, `top.speed` and `bit.speed` [rad/s], `top.load`
    and `bit.torque` [N m].

    - `switching_gain` must be larger than the influence of the estimation errors on the acceleration of the top.
    - The linear term `reaching` e reduces large errors. Without this term the injection would be bounded, and the
      estimates could diverge.

    Source: V. Utkin, Sliding Modes in Control and Optimization, Springer 1992 (chapter on observers).

    The gains are computed by pole placement.

    Examples
    --------
    >>> from controllers.observers import SlidingObserver
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> observer = SlidingObserver(bandwidth=3.0).design(compose(wells.JANSEN_2, BitRock(weight="97 kN")))
    >>> print(dict(zip((*observer.states, "bit.torque"), [round(gain, 1) for gain in observer.gain])))
    {'chain.twist.0': -34.4, 'chain.speed.0': 1.0, 'chain.speed.1': 104.9, 'bit.torque': -45302.2}
    """

    bandwidth: Quantity = quantity(3.0, "rad/s", "distance of the poles on the sliding surface from zero", above=0)
    switching_gain: Quantity = quantity(5.0, "rad/s2", "injection at the edge of the layer", above=0)
    reaching: Quantity = quantity(20.0, "1/s", "gain on large errors", at_least=0)
    boundary_layer: Quantity = quantity(0.1, "rad/s", "half-width of the boundary layer", above=0)

    def injection(self, error):
        """Return the injection v [rad/s2] for an error e = w_top - w_top_hat [rad/s], as a casadi expression.

        Parameters
        ----------
        error
            Error e = w_top - w_top_hat of the estimated top speed [rad/s].
        """
        return self.switching_gain * ca.fmin(ca.fmax(error / self.boundary_layer, -1), 1) + self.reaching * error

    def slope(self):
        """Return the slope dv/de of the injection for large errors [1/s], beyond which the switching part is constant."""
        return self.reaching

    def gains(self, A, B, row):
        """Compute g such that row g = 1 and the zeros of row (s - A)^-1 g, which are the poles in sliding, are all at -bandwidth.

        A (n, n) and B (n,) are the matrices of the string with the bit torque as last state, and `row` (n,) gives the
        top speed. The result has the shape (n,).

        Parameters
        ----------
        A
            Matrix of the string with the bit torque as last state, shape (n, n).
        B
            Effect of the torque of the drive on these states, shape (n,).
        row
            Row that gives the top speed from these states, shape (n,).
        """
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
