"""States between the nodes of a run: a node as the point from which a step goes on, what the step begins with, and where it leads.

The arrays `w` hold the nodes (state, mode, held), a point (x, m, p) with what a step from it needs (k, y, new), and the sizes and addresses of a program.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from toolbox.compilation import work_layout as layout
from toolbox.translation.words import call


def room_of(kernel: Any) -> dict[str, np.ndarray]:
    """Space for a point, and for a step from it."""
    n, guards = kernel.states, kernel.guards
    sizes = {"x": n, "new": n, "k": kernel.slopes, "m": kernel.elements + 1, "y": max(4 * n + 2 * guards, 3 * n + 4 * guards) + 4}
    return {name: np.zeros(size) for name, size in sizes.items()}


def load_node(w, r):
    """Load the node r of a run as the point of the next steps: its state, modes and held values."""
    for i in range(w.state.shape[1]):
        w.x[i] = w.state[r, i]
    for i in range(w.ints[layout.NE]):
        w.m[i] = w.mode[r, i]
    for i in range(w.held.shape[1]):
        w.p[w.ints[layout.FIRST_HELD] + i] = w.held[r, i]


def open_step(w, t, length):
    """Put what a step from the point at time t begins with: its slopes, or the table of a Taylor series over a length."""
    if w.ints[layout.SERIES] != 0:
        call(w.ints[layout.SERIES], t, length, w.x, w.k, w.p, w.m, w.k)
        return
    call(w.ints[layout.FIELD], t, 0.0, w.x, w.k, w.p, w.m, w.y)
    for i in range(w.ints[layout.N]):
        w.k[i] = w.y[w.ints[layout.N] + i]


def step_between(w, t, h):
    """Leave in `y` the state a step h after the point at time t. The slip of sticking contacts is zero there."""
    call(w.ints[layout.STEP], t, h, w.x, w.k, w.p, w.m, w.y)
    for i in range(w.ints[layout.NE]):
        if w.m[i] == 0.0:
            for j in range(w.ints[layout.N]):
                w.new[j] = w.y[j]
            call(w.ints[layout.PROJECT], t + h, 0.0, w.new, w.k, w.p, w.m, w.y)
            return
