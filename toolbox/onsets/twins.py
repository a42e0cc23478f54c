"""Twin runs: the growth of what is between two runs that begin on both sides of smooth running, for laws whose map has no derivatives."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from toolbox.arguments import FloatArray
from toolbox.errors import SimulationError
from toolbox.onsets.motions import Growth, slip_rows
from toolbox.onsets.sampled_map import AGREES, EXACT
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState

KICKS = ((1e-4, 1e-3), (1e-5, 1e-4), (1e-6, 1e-5))
"""Parts of the slip by which two pairs of twin runs begin apart, which must agree; the first lie above the chatter of most laws."""

TWIN_SWINGS, LONGEST_TWIN, SAMPLES = 2, 40, 32
"""Swings of a piece of twin runs, the most pieces, and the instants in a swing at which they are compared."""


def twin_growth(run: Run, state: RunState, away: FloatArray, swing: float) -> Growth | None:
    """Return the growth of the difference of two runs that begin on opposite sides of smooth running. None if the growths for two sizes of
    the difference never agree.

    It counts once it stays the same from piece to piece and what is between the runs is in proportion to how far apart they began: it is neither the chatter of
    a law nor so large that it grows otherwise.

    away: a disturbance of the states as large as they are, small parts of which begin.  swing: about the period of the slowest swing of the machine [s].
    """
    rows = slip_rows(run.system, state.states, run.system.values)
    rows = rows / (np.abs(rows) @ np.abs(state.states) + 1e-300)[:, None]
    for kicks in KICKS:
        twins = [
            Twins(run, [dataclasses.replace(state, states=state.states + sign * kick * away) for sign in (1.0, -1.0)], rows)
            for kick in kicks
        ]
        found: list[complex] = []
        apart = math.inf
        try:
            for _ in range(LONGEST_TWIN):
                exponents, sizes = zip(*[each.on(swing) for each in twins], strict=True)
                near = max(AGREES * 2 * math.pi / swing, 0.05 * abs(exponents[0].real))
                linear = abs(sizes[1] * kicks[0] - sizes[0] * kicks[1]) < 0.1 * sizes[0] * kicks[1]
                if not linear or sizes[1] > 0.1 or not abs(exponents[0].real - exponents[1].real) <= near:
                    break
                found.append(exponents[0])
                apart = abs(exponents[0].real - exponents[1].real)
                if len(found) > 2 and np.ptp([each.real for each in found[-3:]]) < max(
                    0.05 * AGREES * 2 * math.pi / swing, 1e-3 * abs(found[-1].real)
                ):
                    break
        except SimulationError:
            return None
        if len(found) > 1 and abs(found[-1].real - found[-2].real) < max(AGREES * 2 * math.pi / swing, 0.1 * abs(found[-1].real)):
            spread = float(np.ptp([each.real for each in found[-3:]]))
            return Growth.of(found[-1], "twin runs", spread + apart)
    return None


@dataclass
class Twins:
    """Two runs that began near one another; rows: slips of the contacts, in parts of their size, from the states."""

    run: Run
    ends: list[RunState]
    rows: FloatArray

    def on(self, swing: float) -> tuple[complex, float]:
        """Continue both runs by a few swings, and return the exponent and the largest size of their difference."""
        duration = TWIN_SWINGS * swing
        both = [
            self.run.again(start=end, duration=duration, accuracy=EXACT, output_times=None, longest_step=swing / 16) for end in self.ends
        ]
        self.ends = [each.last for each in both]
        times = np.linspace(both[0].begin, both[0].end, SAMPLES * TWIN_SWINGS + 1)
        apart = (both[0].at(times).states - both[1].at(times).states) @ self.rows.T
        return _exponent(apart, swing / SAMPLES), float(np.abs(apart).max())


def _exponent(rows: FloatArray, step: float) -> complex:
    """The exponent of the two slowest motions in samples of signals (rows), by the linear map of rank two from each to a later one that fits best.

    The map over a quarter of a swing tells it best, but for whole turns of a fast swing, which the map over a sixteenth counts. Not a number where the two runs
    came together to the last digit: what was between them is lost.
    """
    late = SAMPLES // 4
    columns = np.hstack([rows[k : len(rows) - 2 * late + k] for k in (0, late, 2 * late)])
    multipliers = [_slowest(columns, lag) for lag in (late, late // 4)]
    if 0.0 in multipliers:
        return complex(math.nan, math.nan)
    best, rough = (complex(np.log(each)) / (lag * step) for each, lag in zip(multipliers, (late, late // 4), strict=True))
    turns = 2 * math.pi / (late * step)
    same = (sign * best.imag + turns * round((rough.imag - sign * best.imag) / turns) for sign in (1, -1))
    return complex(best.real, min(same, key=lambda each: abs(each - rough.imag)))


def _slowest(columns: FloatArray, lag: int) -> complex:
    """The largest multiplier of the map from each row to a later one; 0 where nothing is left in either."""
    now, following = columns[:-lag].T, columns[lag:].T
    u, s, v = np.linalg.svd(now, full_matrices=False)
    kept = min(2, int((s > 1e-10 * s[0]).sum()))
    multipliers = np.linalg.eigvals(u[:, :kept].T @ following @ v[:kept].T / s[:kept])
    return complex(max([0.0, *multipliers.astype(complex)], key=lambda each: (abs(each), each.imag)))
