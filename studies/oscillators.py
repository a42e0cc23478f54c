"""placeholder"""
from __future__ import annotations

import math
from typing import Any

import numpy as np

from toolbox import HybridSystem, simulate


def lyapunov(
    plant: HybridSystem, inputs: dict[str, Any], period: float, cycles: int, *, skip: int = 50, start: Any = None, distance: float = 1e-7
) -> float:
    """Largest Lyapunov exponent [1/s] of a plant under inputs of the given period [s], from two neighbours that are brought back together
    after every period (Benettin's method).

    The exponent is the mean of ln(d / distance) over `cycles` periods, after `skip` periods on the way to the attractor. Neighbours are apart by `distance`
    in the plain norm of the states, so states should be of one size. Two neighbours that a stick has made equal count as ln(1e-12) and are parted again.
    """
    names, size = list(plant.states), plant.x.numel()

    def onwards(x: np.ndarray) -> np.ndarray:
        rows = {name: x[first] if n is None else x[first : first + n] for name, (first, n, _) in plant.states.items()}
        return simulate(plant, period, start=rows, inputs=inputs, accuracy=1e-10).states[-1, :size]

    assert names
    x = np.zeros(size) if start is None else np.asarray(start, float)
    for _ in range(skip):
        x = onwards(x)
    apart = np.zeros(size)
    apart[0] = distance
    growth = 0.0
    for _ in range(cycles):
        near = onwards(x + apart)
        x = onwards(x)
        gap = near - x
        factor = max(float(np.linalg.norm(gap)) / distance, 1e-12)
        growth += math.log(factor)
        apart = gap / factor if factor > 1e-12 else apart
    return growth / (cycles * period)
