"""Carries a run out: calls the compiled loop until it is done, and between its calls grows arrays, asks laws in Python, and looks at the clock."""

from __future__ import annotations

import contextlib
import dataclasses
import time as clock
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from toolbox.compilation import work_layout
from toolbox.compilation.formulas import Formulas
from toolbox.compilation.notices import announced
from toolbox.compilation.program import Program, program_of
from toolbox.errors import BudgetError, SimulationError
from toolbox.messages import LOG, progress_bar, step_here
from toolbox.modelling.laws import External
from toolbox.modelling.regularisation import SmoothSystem
from toolbox.simulation.deadline import OutOfTime, until
from toolbox.simulation.failures import exhausted, failure, trajectory_so_far
from toolbox.simulation.growth import attended
from toolbox.simulation.method_choice import reason
from toolbox.simulation.methods import Explicit, Implicit, Method
from toolbox.simulation.refinement import refined, with_tolerance
from toolbox.simulation.run import Run
from toolbox.simulation.samples import read_signals
from toolbox.simulation.stiffness import FIRST_LOOK, OFTEN, change_steps, pays, progress
from toolbox.simulation.thin_records import ThinRecords
from toolbox.simulation.trajectory import Stepped, Trajectory
from toolbox.simulation.work_arrays import grown, work_arrays


def compiled_loop(run: Run, program: Program) -> Any:
    """The loop that steps with this program, loaded.

    Says so on stderr where this machine has to compile it first.
    """
    run_on: Any
    if program.formulas.locates:
        from toolbox.stepping.event_stepper import advance_plain, advance_series, run_on  # here, because LLVM is slow to import

        name, loop = ("event loop of Taylor series", advance_series) if program.formulas.series else ("event loop", advance_plain)
    else:
        from toolbox.stepping.time_stepper import advance

        name, loop, run_on = "loop of time stepping", advance, advance
    announced(name, loop)
    loop.ready()
    return attended(run_on, program)


def formulas_of(run: Run) -> Formulas:
    """The formulas that a run steps with."""
    return run.method.formulas(run.accuracy, run.system)


def carry_out(run: Run) -> Trajectory:
    """The trajectory of checked arguments; raises SimulationError and its kinds as `simulate` does."""
    if run.method.refines:
        return refined(run)
    if run.method.smooths and not isinstance(run.system, SmoothSystem):
        run = with_tolerance(run)
    course = Course(run)
    try:
        return course.to_the_end()
    except OutOfTime:
        if course.seconds < run.budget.seconds:
            raise  # it is that of a run whose law carries out this one
        stopped = course.exhausted()
        stopped.run.controllers = tuple(course.controllers)
        raise stopped from None
    except BaseException as error:  # an exception of the user's law or an interrupt: what was computed is not lost
        if getattr(error, "run", None) is None:
            with contextlib.suppress(AttributeError):
                error.run = course.so_far()  # type: ignore[attr-defined]
        if getattr(error, "run", None) is not None:
            error.run.controllers = tuple(course.controllers)  # type: ignore[attr-defined]
        raise
    finally:
        if course.bar is not None:
            course.bar.close()


AnySimulationError = TypeVar("AnySimulationError", bound=SimulationError)


class Course:
    """A run in progress: its arrays, its laws and their answers, and the budget used so far."""

    def __init__(self, run: Run):
        self.run, self.formulas = run, formulas_of(run)
        self.program = program_of(run.system, run.kinds, self.formulas)
        self.advance = compiled_loop(run, self.program)
        self.work = work_arrays(run, self.program)
        self.records = ThinRecords()
        self.controllers = run.start.continued(run.controllers)
        self.answers: list[list[np.ndarray]] = [[] for _ in self.controllers]
        asked = [c for c, update in enumerate(run.system.updates) if update.from_callable]
        self.externals = dict(zip(asked, enumerate(part for part in run.system.parts if isinstance(part, External)), strict=True))
        self.bar: Any = None
        self.looks = [progress(self.work)]
        self.before: tuple[float, Program] | None = None  # whose code samples of laws are still taken by
        undecided = (
            run.method.watches_stiffness and not run.controllers
        )  # a law in Python is asked once per sample: its runs do not begin anew
        self.next_look = FIRST_LOOK if undecided else run.budget.steps
        self.step = step_here()
        self.hurried = run.budget.seconds < np.inf or self.step is not None
        self.chunk = 100 if self.hurried else 200_000
        self.began = clock.perf_counter()

    @property
    def seconds(self) -> float:
        """Time spent [s]."""
        return clock.perf_counter() - self.began

    def so_far(self) -> Trajectory:
        """The trajectory up to now."""
        return self._completed(trajectory_so_far(self.run, self.program, self.work, self.began, self.answers))

    def exhausted(self) -> BudgetError:
        """The error of a run that has spent its budget."""
        return self._told(exhausted(self.run, self.program, self.work, self.began, self.answers))

    def _told(self, error: AnySimulationError) -> AnySimulationError:
        """The error of this run, whose trajectory so far knows the steps that are not recorded."""
        self._completed(error.run)
        return error

    def _completed(self, run: Any) -> Any:
        """The trajectory so far, which knows the steps that are not recorded, and those that were others at first."""
        run.before = None if self.before is None else (self.before[0], self.before[1].formulas)
        return self.records.told(run)

    def to_the_end(self) -> Trajectory:
        """Call the compiled loop until the run is done; raises as `carry_out`."""
        budget = self.run.budget
        while True:
            if self.step is not None:
                self.step()
            work, tried, series = self.work, progress(self.work)[1], self.program.formulas.series
            work.ints[work_layout.BUDGET] = min(self.next_look - tried, budget.steps - tried, self.chunk)
            status = self.advance(work)
            spent = self.seconds
            if spent > budget.seconds and status != work_layout.DONE:
                raise self.exhausted()
            if status == work_layout.DONE:
                return self._done()
            if status == work_layout.EVENTS_FULL and work.ints[work_layout.EVENTS] > budget.events:
                raise self.exhausted()
            if status == work_layout.RECORDS_FULL and self.run.method.locates and self.records.thinned(work):
                continue
            if status == work_layout.RECORDS_FULL or status == work_layout.EVENTS_FULL:
                self.work = grown(work, self.program, status == work_layout.RECORDS_FULL, budget)
            elif status == work_layout.SAMPLE_DUE:
                self._sample()
            elif status == work_layout.PAUSED:
                if self._is_stiff(spent):
                    if len(self.looks) > 1:
                        self._go_on()
                        continue
                    LOG.debug("the plant is stiff: stepped implicitly from the start")
                    again = self._again(Implicit(), spent)
                    again.why = again.program.formulas.steps
                    return again
            elif series and status in (work_layout.NO_SERIES, work_layout.UNDERFLOW) and not self.run.controllers:
                again, t = self._again(Explicit(), spent), float(work.reals[work_layout.TIME])
                LOG.debug("no Taylor series at t = %g s: stepped explicitly", t)
                again.why = f"explicit steps: no Taylor series at t = {t:.9g} s"
                return again
            else:
                raise self._told(failure(status, self.run, self.program, work, self.began, self.answers))

    def _done(self) -> Trajectory:
        done = self.so_far()
        done.controllers = tuple(self.controllers)
        run, program = self.run, self.program
        if self.before is not None:
            done.why = f"{program.formulas.steps} at t = {self.before[0]:.9g} s and later: before that {self.before[1].formulas.steps}"
            return done
        done.why = program.lacking(self.formulas, run.kinds)
        if run.method.chooses and not done.why:
            done.why = f"{program.formulas.steps}: {reason(run.accuracy, run.system)}"
        return _sound(done, program) if isinstance(done, Stepped) else done

    def _again(self, method: Method, spent: float) -> Trajectory:
        """The run from its start by another method, in the time that is left."""
        left = dataclasses.replace(self.run.budget, seconds=self.run.budget.seconds - spent)
        return carry_out(dataclasses.replace(self.run, method=method, budget=left))

    def _go_on(self) -> None:
        """Take implicit steps from here on."""
        time = float(self.work.reals[work_layout.TIME])
        LOG.debug("the plant is stiff: stepped implicitly from t = %g s on", time)
        self.before = time, self.program
        self.records.stay = time
        self.program = program_of(self.run.system, self.run.kinds, Implicit().formulas(self.run.accuracy, self.run.system))
        self.advance = compiled_loop(self.run, self.program)
        change_steps(self.work, self.program)
        self.next_look = self.run.budget.steps

    def _is_stiff(self, spent: float) -> bool:
        """Whether a run that has paused is to take implicit steps; else shows how far it is and sets when it is looked at again."""
        steps, budget = progress(self.work)[1], self.run.budget
        if steps >= budget.steps:
            raise self.exhausted()
        if self.hurried:  # as many steps as take a tenth of a second at most
            self.chunk = max(1, min(2 * self.chunk, int(0.1 * steps / spent)))
        if steps >= self.next_look:
            if pays(self.run, self.program, self.work, self.looks[0]):
                return True
            self.looks = [*self.looks, progress(self.work)][-OFTEN:]
            self.next_look = int(steps * 2 ** (1 / OFTEN)) + 1
        if self.bar is None and spent > 1.0:
            self.bar = progress_bar(self.run.duration, "simulate", unit="s", unit_scale=True, delay=0.0)
        if self.bar is not None:
            self.bar.update(float(self.work.reals[work_layout.TIME]) - self.run.start.time - self.bar.n)
        return False

    def _sample(self) -> None:
        """Evaluate a Python controller at the current instant and queue its outputs."""
        from toolbox.stepping.noise import normal  # here, because LLVM is slow to import

        run, program, work = self.run, self.program, self.work
        c, t = int(work.ints[work_layout.CULPRIT]), float(work.reals[work_layout.TIME])
        row = work.samplers[c]
        index, part = self.externals[c]
        first = row[work_layout.FIRST_STATE] + row[work_layout.STATES]
        channels = program.system.updates[c].channels
        noise = {name: normal(work.keys[first + i], row[work_layout.TAKEN]) for i, name in enumerate(channels)}
        with until(self.began + run.budget.seconds):
            u = part.answer(self.controllers[index], t, read_signals(program, part.measured_signals, t, work), noise)
        work.queue[c, row[work_layout.TAKEN] % work.queue.shape[1], : u.size] = u
        self.answers[index].append(u)
        row[work_layout.TAKEN] += 1


def _sound(run: Trajectory, program: Program) -> Trajectory:
    """The run, unless a bound that varies in time was negative at a recorded time: friction would have driven the machine.

    A step sees a contact open at its end, and takes no friction until then.
    """
    if program.varying:
        expression = ca.vertcat(*[program.system.elements[i].static for i in program.varying])
        bounds = np.atleast_2d(run.computed(expression).T)
        wrong = bounds < -1e-9 * np.abs(bounds).max(axis=1, keepdims=True)
        wrong[:, 2:] = wrong[:, 2:] & wrong[:, 1:-1] & wrong[:, :-2]
        wrong[:, :2] = False
        if wrong.any():
            i, k = np.unravel_index(np.argmin(bounds), bounds.shape)
            element = program.system.elements[program.varying[i]]
            raise SimulationError(element.negative_bound(f"is {bounds[i, k]:.6g} at t = {run.time[k]:.9g} s"), run)
    return run
