"""What does the fit of a friction law to a measured loop cost beside scipy's `curve_fit` of the same law to the same samples?

Static and kinetic friction and decay of a block on a belt, whose slip swings, with noise of 0.02 N in its force. `curve_fit` begins at the same numbers and
is given the samples that slip. `fit` searches from four starts, leaves out samples that break the law, and says what its numbers are worth. It is measured on
data, of which it looks for flaws, and on a `Recording` that was read before; processor time, in turn.

    python -m studies loop_fits [--repeats 9]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import curve_fit

from models import BlockOnBelt, Exponential
from studies.command_line import parser_of
from studies.timing import timed
from toolbox import compose, fit
from toolbox.calibration import Recording

NAMES = ("belt.friction.static", "belt.friction.kinetic", "belt.friction.decay")
FIRST = (1.2, 0.5, 2.0)
GUESS = compose(BlockOnBelt(belt_speed=0.0, friction=Exponential(static=FIRST[0], kinetic=FIRST[1], decay=FIRST[2])))
SAMPLES = (1000, 10_000, 100_000)


def law(slip: np.ndarray, static: float, kinetic: float, decay: float) -> np.ndarray:
    """The force of the law at a slip."""
    force: np.ndarray = -np.sign(slip) * (kinetic + (static - kinetic) * np.exp(-decay * np.abs(slip)))
    return force


def logged(samples: int) -> dict[str, np.ndarray]:
    """A log of the loop."""
    at = np.linspace(0.0, 20.0, samples)
    slip = 1.5 * np.sin(2 * np.pi * 0.3 * at) + 0.2
    return {
        "time": at,
        "block.speed": slip,
        "belt.force": law(slip, 1.0, 0.6, 3.0) + 0.02 * np.random.default_rng(0).standard_normal(samples),
    }


def main() -> None:
    """Print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--repeats", type=int, default=9)
    given = parser.parse_args()
    print("samples   curve_fit   fit of a recording   ratio   of data   ratio   largest difference of a number")
    for samples in SAMPLES:
        data = logged(samples)
        slips = np.abs(data["block.speed"]) > 0.01 * np.abs(data["block.speed"]).max()
        slip, force, recording = data["block.speed"][slips], data["belt.force"][slips], Recording.of(data, GUESS)
        calls: tuple[Callable[[], Any], ...] = (
            lambda slip=slip, force=force: curve_fit(law, slip, force, p0=FIRST)[0],
            lambda recording=recording: fit(GUESS, recording, NAMES, contact="belt").values,
            lambda data=data: fit(GUESS, data, NAMES, contact="belt").values,
        )
        found = [call() for call in calls]
        times = np.array([[timed(call)[1] for call in calls] for _ in range(given.repeats)])
        one, recorded, raw = np.median(times, axis=0)
        ratios = np.median(times[:, 1:] / times[:, :1], axis=0)
        apart = np.abs(found[2] / found[0] - 1.0).max()
        print(
            f"{samples:7d}{one * 1e3:9.2f} ms{recorded * 1e3:18.2f} ms{ratios[0]:8.1f}{raw * 1e3:7.2f} ms{ratios[1]:8.1f}{apart:20.1e}",
            flush=True,
        )


if __name__ == "__main__":
    main()
