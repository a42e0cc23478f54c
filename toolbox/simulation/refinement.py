"""Step or width refinement (Richardson): divide by 4 until two runs differ by less than the accuracy.

The error of such a method is about c k^q with its setting k, q = 1 for a step, 2/3 for a width. Of two runs with settings k and k/r the finer one has the error

    e = |x_k - x_(k/r)| / (r^q - 1)

scaled as `run.error_estimate` is. The setting is divided by four, twice at least, until e <= accuracy. Once e falls with k, it tells what the accuracy will
cost, and a price beyond the budget ends in an AccuracyError at once, with the best run.

Two widths may agree and both be wrong: contacts that should stick creep at a speed w, and as long as that is far above what the bodies between them do, all
widths share the load in the same way, which is not that of contacts at rest. So a width is also compared with the set-valued law, by time stepping with two
steps: what they differ by beyond the error of the stepping is an error of the width.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import casadi as ca
import numpy as np

from toolbox.errors import AccuracyError, SimulationError
from toolbox.modelling.regularisation import smoothed
from toolbox.simulation.methods import Smoothing, TimeStepping
from toolbox.simulation.run import Run
from toolbox.simulation.trajectory import Trajectory

FIRST_STEPS = 1_000
"""Steps of the first run."""

MOST_STEPS = 8_000_000
"""Steps of the last run that is tried."""


MOST_STIFF_STEPS = 400_000
"""The same for steps of the stiff method, which cost more."""


def refined(run: Run) -> Trajectory:
    """Return the run with a step or a width that meets its accuracy. AccuracyError is raised if too many steps are needed."""
    stepping = not run.method.locates
    order, most = (1.0, MOST_STEPS) if stepping else (2.0 / 3.0, MOST_STIFF_STEPS)
    if stepping:
        setting = min([max(run.duration, 1e-9) / FIRST_STEPS, *(clock.period for clock in run.clocks)])
        sizes = {}
    else:
        stepped = _stepped(run)
        setting, sizes, doubt = 0.03, slips(run, stepped), stepped.difference(_stepped(run, 4))

    left = run.budget.seconds

    def attempt(setting: float, output_times: Any = None) -> Trajectory:
        nonlocal left
        budget = dataclasses.replace(run.budget, seconds=max(left, 1e-9))
        if stepping:
            done = run.again(method=TimeStepping(setting), output_times=output_times, budget=budget)
        else:
            widths = {name: setting * size for name, size in sizes.items()}
            method = Smoothing(widths, max(min(run.accuracy / 10, SHARE * setting), 1e-13))
            done = run.again(method=method, output_times=output_times, budget=budget)
        left -= done.wall_time
        return done

    coarse, error, price, falls, before = attempt(setting), math.inf, 0.0, 1.0, 4.0
    if run.duration == 0.0:
        return coarse
    for trial in range(40):
        ratio = 4.0
        if trial >= 2:
            missing = (1.3 * error / run.accuracy) ** (1.0 / order)
            steps = coarse.steps[0]
            dearer = math.log(max(steps / price, 1.01), before)
            wanted = steps * max(missing, 1.0) ** dearer
            ratio = min(max(missing, 2.0), 16.0) if falls > 0.3 else 4.0
            if (stepping and wanted > most and falls > 0.3 and error < 0.1 and trial >= 3) or steps * ratio**dearer > most:
                coarse.__dict__["error_estimate"] = error
                raise AccuracyError(_dear(run, coarse, error, setting, wanted), coarse)
        before, price = ratio, coarse.steps[0]
        try:
            fine = attempt(setting / ratio)
        except SimulationError as failed:
            coarse.__dict__["error_estimate"] = error
            raise AccuracyError(f"{_dear(run, coarse, error, setting, math.inf)} A finer run failed: {failed}", coarse) from None
        found = coarse.difference(fine) / (ratio**order - 1.0)
        if not stepping:
            found = max(found, fine.difference(stepped) - doubt)
        if error < math.inf:
            found = max(found, min(error, 1.0) / ratio ** (1.5 * order))  # two runs may agree by chance
        falls = math.log(error / found, ratio) if found > 0.0 and 0.0 < error < math.inf else 1.0
        setting, coarse, error = setting / ratio, fine, found
        if trial >= 1 and error <= run.accuracy:
            break
    else:
        coarse.__dict__["error_estimate"] = error
        raise AccuracyError(_dear(run, coarse, error, setting, math.inf), coarse)
    if run.output_times is not None:
        coarse = attempt(setting, run.output_times)
    coarse.__dict__["error_estimate"] = error
    return coarse


SHARE = 0.1
"""Tolerance in parts of the width: with one above the width a step jumps over the peak of a law and breaks a contact free that should stick."""


def with_tolerance(run: Run) -> Run:
    """The run of given widths on the smooth plant, with a tolerance that resolves them unless it has one."""
    method: Any = run.method
    if not method.tolerance:
        sizes = slips(run)
        finest = min([run.accuracy, *(SHARE * width / sizes[name] for name, width in method.width.items())])
        method = dataclasses.replace(method, tolerance=max(finest, 1e-13))
    return dataclasses.replace(run, system=smoothed(run.system, method.width), method=method)


def _stepped(run: Run, longer: int = 1) -> Trajectory:
    """The run with set-valued friction by time stepping, in steps so many times longer than the finest."""
    return run.again(method=TimeStepping(max(run.duration, 1e-9) * longer / (16 * FIRST_STEPS)), output_times=None)


def slips(run: Run, stepped: Trajectory | None = None) -> dict[str, float]:
    """Return the largest slip of every friction and relay over a stepped run, and 1 for an element that never slips."""
    stepped = _stepped(run) if stepped is None else stepped
    names = [element.name for element in run.system.elements if element.holds]
    slips = ca.SX(ca.vertcat(*[element.slip for element in run.system.elements if element.holds]))
    values = np.abs(np.atleast_2d(stepped.computed(slips).T)).max(axis=1)
    largest = values.max(initial=0.0)
    return {name: float(value) if value > 1e-9 * largest else 1.0 for name, value in zip(names, values, strict=True)}


def _dear(run: Run, best: Trajectory, error: float, setting: float, steps: float) -> str:
    what = (
        f"{best.steps[0]} steps of {setting:.3g} s"
        if not run.method.locates
        else f"widths of {setting:.1e} of the slips and {best.steps[0]} steps"
    )
    price = f"it would take about {steps:.1e} steps" if math.isfinite(steps) else "no finer run tells more"
    return (
        f"method={run.method.text!r} cannot meet the accuracy {run.accuracy:g}: {what} leave an error of {error:.1e}, and {price}. "
        f"Ask for less, give {run.method.finer}, or use method='event'."
    )
