"""Static condensation and component modes: a large elastic body in the displacements of its ports and a few modes.

With W = (w_1 ... w_p) the displacement is written as

    u = Psi s + Phi r ,   s = W^T u ,   W^T Psi = 1 ,   W^T Phi = 0

Psi: shapes of least strain energy for given displacements s of the ports, so statics under forces on ports are exact.  Phi: modes with all ports held,
K Phi = M Phi diag(omega^2) + W (...), from the lowest up; without them the reduction is static (Guyan). As K Psi = W (...), the stiffness is
diag(K_ss, omega^2): no term couples s and r. Where the ports do not hold all rigid-body motions, what they leave free are modes of frequency zero, and
Psi is sought in their complement. Ports that are single entries of u are the classical case of Craig and Bampton.

Why checked and not estimated: natural frequencies of a reduced body are too high, never too low (Rayleigh and Ritz), by an amount that depends on the
ports. They are compared with those of the whole body, and modes are added until the band is right.
Source: R. R. Craig, M. C. C. Bampton, AIAA Journal 6 (1968) 1313-1319, doi:10.2514/3.4741.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from models.elastic.reduced_body import ReducedBody
from models.elastic.spectrum import DENSE, modes_near, natural_frequencies, solver
from toolbox import SceneError
from toolbox.authoring import array, number


def reduce_body(mass: Any, damping: Any, stiffness: Any, ports: Mapping[str, Any], band: float, tolerance: float) -> ReducedBody:
    """See `ElasticBody.reduced`."""
    tolerance = number("tolerance", tolerance, above=0, below=1)
    weights = _weights(ports, mass.shape[0])
    whole = natural_frequencies(mass, stiffness, band) if band else np.zeros(0)
    rigid = rigid_shapes(mass, stiffness).shape[1]
    frequencies = whole[whole > 0]
    held = _Held(mass, stiffness, weights)
    edge = 1.5 * band
    while True:
        modes = held.modes(edge)
        matrices = held.reduced(modes, damping)
        found = natural_frequencies(matrices[0], matrices[2], math.inf)[rigid:][: frequencies.size] if frequencies.size else frequencies
        errors = np.maximum(found / frequencies - 1, 0.0) if found.size == frequencies.size else np.full(frequencies.size, np.inf)
        if not frequencies.size or errors.max() <= tolerance:
            return ReducedBody(tuple(ports), *matrices, band, frequencies, errors, rigid)
        if modes.shape[1] + weights.shape[1] >= mass.shape[0]:
            raise SceneError(f"Argument `tolerance` must be above round-off, but it is {tolerance!r}.")
        edge *= 1.5


def _weights(ports: Mapping[str, Any], n: int) -> np.ndarray:
    """(n, p) weights of the ports, checked."""
    if not isinstance(ports, Mapping) or not ports:
        raise SceneError(f"Argument `ports` must be {{name: weights}} with at least one port, but it is {ports!r}.")
    columns = []
    for name, given in ports.items():
        columns.append(array(f"ports.{name}", given, (n,)))
        if not columns[-1].any():
            raise SceneError(f"Argument `ports` must give `{name}` weights that are not all 0.")
    return np.column_stack(columns)


class _Held:
    """The body with held ports, in the coordinates u = Y s + Z y with W^T Y = 1 and W^T Z = 0; Z keeps the sparsity of finite elements."""

    def __init__(self, mass: Any, stiffness: Any, weights: np.ndarray):
        from scipy.linalg import qr
        from scipy.sparse import csc_matrix, identity, vstack

        n, p = weights.shape
        if p > n:
            raise SceneError(f"Argument `ports` must be at most {n} ports, one for each entry of the displacement, but there are {p}.")
        # every port gives up one entry of u, which its displacement and the other entries then decide
        upper, order = qr(weights.T, mode="r", pivoting=True)
        pivots = np.abs(np.diag(upper[:, :p]))
        if pivots.min() <= 1e-10 * pivots.max():
            raise SceneError("Argument `ports` must be independent of each other, but one is a combination of others.")
        given_up, others = order[:p], np.sort(order[p:])
        back = np.argsort(np.concatenate([given_up, others]))
        by_others = -np.linalg.solve(weights[given_up].T, weights[others].T)
        self.y = vstack([csc_matrix(np.linalg.inv(weights[given_up].T)), csc_matrix((n - p, p))]).tocsr()[back]
        self.z = vstack([csc_matrix(by_others), identity(n - p)]).tocsr()[back]
        self.mass, self.stiffness = mass, stiffness
        self.inner_mass, self.inner_stiffness = (csc_matrix(self.z.T @ matrix @ self.z) for matrix in (mass, stiffness))
        self.free = self._free_motions(weights)[others]
        self.shapes = self._shapes()

    def _free_motions(self, weights: np.ndarray) -> np.ndarray:
        """(n, r) motions without strain that the ports do not hold, normalised to mass 1."""
        from scipy.linalg import null_space

        rigid = rigid_shapes(self.mass, self.stiffness)
        moved = weights.T @ rigid
        if not rigid.shape[1]:
            return rigid
        loose = rigid @ null_space(moved / np.linalg.norm(weights, axis=0)[:, None], rcond=1e-9)
        return loose @ np.linalg.inv(np.linalg.cholesky(loose.T @ (self.mass @ loose))).T if loose.shape[1] else loose

    def _shapes(self) -> np.ndarray:
        """(n, p) shapes of least strain energy for a displacement 1 of each port; entries that free motions leave open are pinned."""
        from scipy.linalg import qr

        load = (self.z.T @ self.stiffness @ self.y).toarray()
        kept = np.ones(len(self.free), bool)
        if self.free.shape[1]:
            kept[qr(self.free.T, mode="r", pivoting=True)[1][: self.free.shape[1]]] = False
        inner = np.zeros(load.shape)
        if kept.any():
            inner[kept] = -solver(self.inner_stiffness[kept][:, kept])(load[kept])
        return self.y @ np.eye(load.shape[1]) + self.z @ inner

    def modes(self, edge: float) -> np.ndarray:
        """(n, r) modes with held ports and frequencies up to `edge` [Hz], those of frequency zero first, normalised to mass 1."""
        from scipy.linalg import eigh

        size, free = self.inner_mass.shape[0], self.free.shape[1]
        limit = (2 * math.pi * edge) ** 2
        if edge <= 0 or not size:
            return self.z @ self.free
        if size <= DENSE:
            squares, shapes = eigh(self.inner_stiffness.toarray(), self.inner_mass.toarray())
        else:
            fastest = np.max(self.inner_stiffness.diagonal() / self.inner_mass.diagonal())
            shift = -max(limit / 10, 1e-9 * fastest) if free else 0.0
            count, squares, nearest = 16 + free, np.zeros(1), modes_near(self.inner_mass, self.inner_stiffness, shift)
            while squares.max() <= limit and count <= size // 2:
                squares, shapes = nearest(count)
                count *= 2
            if squares.max() <= limit:
                raise SceneError(f"Argument `band` must be lower, because modes up to {edge:g} Hz are more than half of all.")
        order = np.argsort(squares)[free:]
        return self.z @ np.hstack([self.free, shapes[:, order[squares[order] <= limit]]])

    def reduced(self, modes: np.ndarray, damping: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Mass, damping and stiffness in the coordinates (ports, modes), symmetric to the last bit."""
        basis = np.hstack([self.shapes, modes])
        mass, damped, stiffness = (
            (found + found.T) / 2 for found in (basis.T @ (matrix @ basis) for matrix in (self.mass, damping, self.stiffness))
        )
        p, free = self.shapes.shape[1], self.free.shape[1]
        stiffness[:p, p:] = stiffness[p:, :p] = 0.0
        stiffness[p:, p:] = np.diag(np.diag(stiffness[p:, p:]))
        stiffness[p : p + free, p : p + free] = 0.0
        return mass, damped, stiffness


def rigid_shapes(mass: Any, stiffness: Any) -> np.ndarray:
    """(n, r) orthonormal motions without strain of a body, r from 0 to 6."""
    from scipy.linalg import eigh

    fastest = np.max(stiffness.diagonal() / mass.diagonal())
    if mass.shape[0] <= DENSE:
        squares, shapes = eigh(stiffness.toarray(), mass.toarray())
    else:
        squares, shapes = modes_near(mass, stiffness, -1e-6 * fastest)(8)
    return np.linalg.qr(shapes[:, squares < 1e-12 * fastest])[0]
