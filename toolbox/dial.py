"""From the accuracy asked to the step of a method of order one: refine until two runs agree.

With a knob k (a step, a width) the error of such a method is about c k. Of two runs with knobs k and k/r the finer one has the error

    e = |x_k - x_(k/r)| / (r - 1)

scaled as `run.error` is. The knob is divided by four, twice at least, until e <= accuracy; as soon as e falls in proportion to k it tells what the accuracy
will cost, and a price beyond the budget ends in an AccuracyError at once, with the best run.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

from toolbox.errors import AccuracyError

if TYPE_CHECKING:
    from toolbox.simulate import Run
    from toolbox.trajectory import Trajectory

FIRST_STEPS = 1_000
"""Steps of the first run."""

MOST_STEPS = 8_000_000
"""Steps of the last run that is tried."""


def refined(run: Run) -> Trajectory:
    """The run with a step that meets its accuracy; raises AccuracyError where that costs more than `MOST_STEPS` steps."""
    from toolbox.simulate import again

    def attempt(step: float) -> Trajectory:
        return again(run, step=step, output_times=None)

    if run.duration == 0.0:
        return again(run, step=1.0)
    step = min([run.duration / FIRST_STEPS, *(period for period, _ in run.clocks)])
    coarse, error, rate = attempt(step), math.inf, 0.0
    for trial in range(30):
        ratio = 4.0
        if trial >= 2 and rate > 0.5 and math.isfinite(error):
            ratio = min(max(1.3 * error / run.accuracy, 2.0), 16.0)
        price = run.duration / step * (max(1.0, error / run.accuracy) if trial >= 2 and math.isfinite(error) else ratio)
        if price > MOST_STEPS and (trial >= 3 or run.duration / step * ratio > MOST_STEPS):
            coarse.__dict__["error"] = error
            raise AccuracyError(
                f"method='time-stepping' cannot meet the accuracy {run.accuracy:g}: {coarse.steps[0]} steps of {step:.3g} s leave an error of {error:.1e}, and it "
                f"would take about {price:.1e} steps. Ask for less, give a `step`, or use method='event'.",
                coarse,
            )
        fine = attempt(step / ratio)
        found = coarse.difference(fine) / (ratio - 1.0)
        rate = math.log(error / found, ratio) if found > 0.0 and error > 0.0 and math.isfinite(error) else 0.0
        step, coarse, error = step / ratio, fine, found
        if trial >= 1 and error <= run.accuracy:
            break
    if run.output_times is not None:
        coarse = again(dataclasses.replace(run, step=step))
    coarse.__dict__["error"] = error
    return coarse
