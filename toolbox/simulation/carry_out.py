"""Carries a run out: calls the compiled loop until it is done, and between its calls grows arrays, asks laws in Python, and looks at the clock."""

from __future__ import annotations

import contextlib
import dataclasses
import time as clock
from typing import Any

import casadi as ca
import numpy as np

from toolbox.compilation import work_layout
from toolbox.compilation.moreau_jean import Theta
from toolbox.compilation.notices import announced
from toolbox.compilation.program import Program, program_of
from toolbox.compilation.taylor import Taylor
from toolbox.errors import SimulationError
from toolbox.messages import LOG, progress_bar
from toolbox.modelling.laws import External, fresh
from toolbox.modelling.regularisation import SmoothSystem, smoothed
from toolbox.simulation.deadline import OutOfTime, until
from toolbox.simulation.failures import exhausted, failure, trajectory_so_far
from toolbox.simulation.growth import attended
from toolbox.simulation.method_choice import cheapest_method
from toolbox.simulation.methods import Automatic, EventExact, Explicit, Implicit, Smoothing, TaylorSeries
from toolbox.simulation.refinement import refined, tolerance
from toolbox.simulation.run import Run
from toolbox.simulation.stiffness import FIRST_LOOK, pays, progress
from toolbox.simulation.trajectory import Stepped, Trajectory
from toolbox.simulation.work_arrays import grown, work_arrays

_LOADED: list[Any] = []


def compiled_loop(run: Run, program: Program) -> Any:
    """The loop that steps with this program: loaded by a run of no duration in each process.

    Says so on stderr where this machine has to compile it first.
    """
    run_on: Any
    if isinstance(program.pair, Theta):
        from toolbox.stepping.time_stepper import advance  # here, because numba is slow to import

        name, run_on = "loop of time stepping", advance
    else:
        from toolbox.stepping.event_stepper import advance, run_on

        name = "event loop"
    key = (advance, isinstance(program.pair, Taylor))  # steps of Taylor series have machine code of their own
    if key not in _LOADED:
        _LOADED.append(key)
        announced(name, advance)
        run_on(work_arrays(dataclasses.replace(run, duration=0.0, output_times=None), program))
    return attended(run_on, program)


def _told(run: Run, why: str) -> None:
    """Warn once for a plant where a method that was asked for by its name was not taken; of one that the toolbox chose, `run.why` tells alone."""
    told = ("told", why.partition(" at t = ")[0])
    if why and isinstance(run.method, TaylorSeries) and told not in run.system.kernels:
        run.system.kernels[told] = True
        LOG.warning("method='taylor' was not taken: %s", why)


def _undecided(run: Run) -> bool:
    """Whether the run may turn out to be stiff; a law in Python is asked once per sample, so that its runs do not begin anew."""
    return isinstance(run.method, EventExact) and not run.laws


def formulas_of(run: Run) -> Any:
    """The formulas that a run steps with."""
    return run.method.formulas(run.accuracy, bool(run.system.updates))


def carry_out(run: Run) -> Trajectory:
    """The trajectory of checked arguments; raises SimulationError and its kinds as `simulate` does."""
    if isinstance(run.method, Automatic):
        return cheapest_method(run)
    if run.method.refines:
        return refined(run)
    if isinstance(run.method, Smoothing) and not isinstance(run.system, SmoothSystem):
        sharp = Smoothing(run.method.width, run.method.tolerance or tolerance(run))
        run = dataclasses.replace(run, system=smoothed(run.system, sharp.width or {}), method=sharp)
    program = program_of(run.system, run.kinds, formulas_of(run))
    advance = compiled_loop(run, program)
    work = work_arrays(run, program)
    began = clock.perf_counter()
    laws = [fresh(law) for law in run.laws]
    answers: list[list[np.ndarray]] = [[] for _ in laws]
    bar: Any = None
    look = progress(work)
    following = FIRST_LOOK if _undecided(run) else run.budget.steps
    chunk = 200_000 if run.budget.seconds == np.inf else 100
    try:
        while True:
            tried = progress(work)[1]
            work.ints[work_layout.BUDGET] = min(following - tried, run.budget.steps - tried, chunk)
            status = advance(work)
            spent = clock.perf_counter() - began
            if spent > run.budget.seconds and status != work_layout.DONE:
                raise exhausted(run, program, work, began, answers)
            if status == work_layout.DONE:
                done = trajectory_so_far(run, program, work, began, answers)
                done.laws = tuple(laws)
                if isinstance(formulas := formulas_of(run), Taylor):
                    done.why = program.lacking(formulas, run.kinds)
                _told(run, done.why)
                return _sound(done, program) if isinstance(done, Stepped) else done
            if status == work_layout.EVENTS_FULL and work.ints[work_layout.EVENTS] > run.budget.events:
                raise exhausted(run, program, work, began, answers)
            if status == work_layout.RECORDS_FULL or status == work_layout.EVENTS_FULL:
                work = grown(work, program, status == work_layout.RECORDS_FULL, run.budget)
            elif status == work_layout.SAMPLE_DUE:
                _sample(run, program, work, laws, answers, began)
            elif status == work_layout.PAUSED:
                if progress(work)[1] >= run.budget.steps:
                    raise exhausted(run, program, work, began, answers)
                if run.budget.seconds < np.inf:  # as many steps as take a tenth of a second at most
                    chunk = max(1, min(2 * chunk, int(0.1 * progress(work)[1] / spent)))
                if progress(work)[1] >= following:
                    if pays(run, program, work, look):
                        LOG.debug("the plant is stiff: stepped implicitly from the start")
                        left = dataclasses.replace(run.budget, seconds=run.budget.seconds - spent)
                        return carry_out(dataclasses.replace(run, method=Implicit(), budget=left))
                    look = progress(work)
                    following = 2 * look[1]
                if bar is None and spent > 1.0:
                    bar = progress_bar(run.duration, "simulate", unit="s", unit_scale=True, delay=0.0)
                if bar is not None:
                    bar.update(float(work.reals[work_layout.TIME]) - bar.n)
            elif isinstance(program.pair, Taylor) and status in (work_layout.NO_SERIES, work_layout.UNDERFLOW) and not run.laws:
                left = dataclasses.replace(run.budget, seconds=run.budget.seconds - spent)
                again = carry_out(dataclasses.replace(run, method=Explicit(), budget=left))
                again.why = f"explicit: no Taylor series at t = {float(work.reals[work_layout.TIME]):.9g} s"
                _told(run, again.why)
                return again
            else:
                raise failure(status, run, program, work, began, answers)
    except OutOfTime:
        if clock.perf_counter() - began < run.budget.seconds:
            raise  # it is that of a run whose law carries out this one
        stopped = exhausted(run, program, work, began, answers)
        stopped.run.laws = tuple(laws)
        raise stopped from None
    except BaseException as error:  # an exception of the user's law or an interrupt: what was computed is not lost
        if getattr(error, "run", None) is None:
            with contextlib.suppress(AttributeError):
                error.run = trajectory_so_far(run, program, work, began, answers)  # type: ignore[attr-defined]
        if getattr(error, "run", None) is not None:
            error.run.laws = tuple(laws)  # type: ignore[attr-defined]
        raise
    finally:
        if bar is not None:
            bar.close()


def _sound(run: Trajectory, program: Program) -> Trajectory:
    """The run, unless a bound that varies in time was negative at a recorded time: friction would have driven the machine.

    A step sees a contact open at its end, and takes no friction until then.
    """
    if program.varying:
        names = [program.system.elements[i].name for i in program.varying]
        expression = ca.vertcat(*[program.system.elements[i].static for i in program.varying])
        bounds = np.atleast_2d(run.computed("varying bounds", expression).T)
        wrong = bounds < -1e-9 * np.abs(bounds).max(axis=1, keepdims=True)
        wrong[:, 2:] = wrong[:, 2:] & wrong[:, 1:-1] & wrong[:, :-2]
        wrong[:, :2] = False
        if wrong.any():
            i, k = np.unravel_index(np.argmin(bounds), bounds.shape)
            raise SimulationError(
                f"The bound of `{names[i]}` must be >= 0, but it is {bounds[i, k]:.6g} at t = {run.time[k]:.9g} s: is its load negative?",
                run,
            )
    return run


def _sample(run: Run, program: Program, work: Any, laws: list[Any], answers: list[list[np.ndarray]], began: float) -> None:
    """Evaluate a Python controller at the current instant and queue its outputs."""

    from toolbox.stepping.noise import normal  # here, because numba is slow to import

    c = int(work.ints[work_layout.CULPRIT])
    row = work.samplers[c]
    index = [i for i, update in enumerate(program.system.updates) if update.external].index(c)
    part = [part for part in run.system.parts if isinstance(part, External)][index]
    point = Trajectory.point(run, program, work.reals[work_layout.TIME], work.x, work.m, work.p)
    first = row[work_layout.FIRST_STATE] + row[work_layout.STATES]
    channels = program.system.updates[c].channels
    noise = {name: normal(work.keys[first + i], row[work_layout.TAKEN]) for i, name in enumerate(channels)}
    with until(began + run.budget.seconds):
        u = part.answer(laws[index], float(work.reals[work_layout.TIME]), (point[place] for place in part.measures), noise)
    work.queue[c, row[work_layout.TAKEN] % work.queue.shape[1], : u.size] = u
    answers[index].append(u)
    row[work_layout.TAKEN] += 1
