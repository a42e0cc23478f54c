"""Natural frequencies of large and of small symmetric matrices."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

SAFE = 1e3
"""Shift of the eigenvalues, in parts of what is round-off of the largest, at which the matrix of a free body is not singular."""

DENSE = 600
"""Rows up to which all frequencies are computed at once."""


def natural_frequencies(mass: Any, stiffness: Any, band: float) -> np.ndarray:
    """Natural frequencies [Hz] up to `band` [Hz] of M u'' + K u = 0, in rising order; rigid-body motions are zeros.

    mass, stiffness: (n, n), dense or sparse. Those of a large body are found by Lanczos iteration about 0, twice as many until one is beyond the band.
    """
    from scipy.linalg import eigh

    n = mass.shape[0]
    # round-off of the largest eigenvalue: what is below it is a rigid motion
    floor = 1e-6 * math.sqrt(max(np.max(stiffness.diagonal() / mass.diagonal()), 0.0)) / (2 * math.pi)
    if n <= DENSE or isinstance(mass, np.ndarray):
        squares = eigh(_dense(stiffness), _dense(mass), eigvals_only=True)
        return _up_to(squares, band, floor)
    shift = -max(
        (2 * math.pi * band) ** 2 / 10, SAFE * (2 * math.pi * floor) ** 2
    )  # not an eigenvalue: the matrix of a free body can be factorised, too
    count, nearest = 16, modes_near(mass, stiffness, shift)
    while True:
        squares = np.sort(nearest(min(count, n - 2), return_eigenvectors=False))
        if squares[-1] > (2 * math.pi * band) ** 2 or count >= n - 2:
            return _up_to(squares, band, floor)
        count *= 2


def modes_near(mass: Any, stiffness: Any, shift: float) -> Callable[..., Any]:
    """Lanczos iteration about an eigenvalue, as scipy's `eigsh` of how many: the matrices are factorised once."""
    from scipy.sparse.linalg import LinearOperator, eigsh

    n = mass.shape[0]
    inverse = LinearOperator((n, n), matvec=solver(stiffness - shift * mass))
    return functools.partial(eigsh, stiffness, M=mass, sigma=shift, OPinv=inverse, v0=np.cos(np.arange(n)))


def solver(matrix: Any) -> Any:
    """The inverse of a sparse positive definite matrix, as a function of (n,) or (n, k) right sides."""
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    factor = splu(csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return factor.solve


def _dense(matrix: Any) -> np.ndarray:
    return matrix.toarray() if hasattr(matrix, "toarray") else np.asarray(matrix)


def _up_to(squares: np.ndarray, band: float, floor: float) -> np.ndarray:
    """Frequencies [Hz] of eigenvalues up to the band, 0 below the floor."""
    frequencies = np.sqrt(np.maximum(squares, 0.0)) / (2 * math.pi)
    frequencies[frequencies < floor] = 0.0
    return frequencies[frequencies <= band * (1 + 1e-12)]
