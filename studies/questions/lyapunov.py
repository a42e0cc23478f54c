"""The largest Lyapunov exponent of a plant under periodic inputs: does a small difference grow, and how fast?"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from toolbox import HybridSystem, simulate


def lyapunov(
    plant: HybridSystem, inputs: Mapping[str, Any], period: float, cycles: int, *, skip: int = 50, distance: float = 1e-7
) -> tuple[float, np.ndarray]:
    """Largest Lyapunov exponent [1/s], and the states at the end of every period, shape (cycles, n), under inputs of the given period [s].

    Two neighbours run side by side and are brought back to `distance` after every period (Benettin's method); the exponent is the mean of
    ln(gap / distance) / period over `cycles` periods, after `skip` periods from rest to reach the attractor. The gap is measured in the plain norm of the
    states, so these should be of one size. Neighbours that a stick has made equal count as ln(1e-12) and are parted anew. Positive and settled in
    `cycles`: chaos. Source: G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn (1980).
    """
    size = plant.x.numel()

    def onwards(x: np.ndarray) -> np.ndarray:
        start = {name: x[first] if entries is None else x[first : first + entries] for name, (first, entries, _) in plant.states.items()}
        return simulate(plant, period, start=start, inputs=inputs, accuracy=1e-10).states[-1, :size]

    x = np.zeros(size)
    for _ in range(skip):
        x = onwards(x)
    parted = np.eye(size)[0] * distance
    apart, growth, section = parted, 0.0, np.empty((cycles, size))
    for i in range(cycles):
        near, x = onwards(x + apart), onwards(x)
        factor = float(np.linalg.norm(near - x)) / distance
        growth += math.log(max(factor, 1e-12))
        apart = (near - x) / factor if factor > 1e-12 else parted
        section[i] = x
    return growth / (cycles * period), section
