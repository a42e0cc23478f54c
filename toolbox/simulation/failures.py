"""What a run says that cannot be finished: the trajectory so far, and a cause in words of the plant."""

from __future__ import annotations

import itertools
import time as clock
from collections.abc import Iterable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import count_of
from toolbox.compilation import work_layout
from toolbox.compilation.program import Program
from toolbox.errors import BudgetError, ControllerError, NoModes, SimulationError, ZenoError
from toolbox.modelling.components import law_of
from toolbox.modelling.elimination import dependent_rows, must_be_independent
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, External, ZeroOrderHold
from toolbox.simulation.bottleneck import bottleneck
from toolbox.simulation.run import Run
from toolbox.simulation.samples import output_function
from toolbox.simulation.stiffness import progress
from toolbox.simulation.trajectory import Records, Smoothed, Stepped, Trajectory
from toolbox.simulation.work_arrays import first_rows, state_of


def trajectory_so_far(run: Run, program: Program, work: Any, began: float, answers: list[list[np.ndarray]]) -> Trajectory:
    """The result of a run as far as it came."""
    wall_time = clock.perf_counter() - began  # what follows copies what the loop has written
    r, e = int(work.ints[work_layout.RECORDS]), int(work.ints[work_layout.EVENTS])
    kind = Smoothed if run.method.smooths else Trajectory if run.method.locates else Stepped
    records = Records(
        time=first_rows(work.rec_t, r),
        states=first_rows(work.rec_x, r),
        mode=first_rows(work.rec_m, r),
        held=first_rows(work.rec_p, r),
        parameters=work.p,
        event_arrays=(work.ev_t[:e].copy(), work.ev_i[:e].copy(), work.ev_m[:e].copy()),
        last_mode=work.m,
        end=float(work.reals[work_layout.TIME]),
        answers=answers,
        last=state_of(run, program, work),
        steps=(int(work.ints[work_layout.ACCEPTED]), int(work.ints[work_layout.REJECTED])),
        merged=int(work.ints[work_layout.MERGED]),
        wall_time=wall_time,
    )
    return kind(run=run, program=program, records=records)


def exhausted(
    run: Run, program: Program, work: Any, began: float, answers: list[list[np.ndarray]], switches: np.ndarray | None = None
) -> BudgetError:
    """Return the error of a run that has used its budget, with the used amount and the main cause.

    `switches` is the number of those of each element, before the ones that `work` holds.
    """
    so_far = trajectory_so_far(run, program, work, began, answers)
    t, steps, events = progress(work)
    before = 0 if switches is None else int(switches.sum())
    names = [element.name for element in program.system.elements]
    often = np.bincount(work.ev_i[:events], minlength=len(names)) + (0 if switches is None else switches)
    spent = f"{steps} steps" if steps >= run.budget.steps else f"{so_far.wall_time:.3g} s" if so_far.wall_time > run.budget.seconds else ""
    if spent:
        cause = bottleneck(run, program, work, often)
    else:
        spent = f"its {int(run.budget.events)} events"
        cause = f"most of them are of `{names[int(np.argmax(often))]}`"
    if before + events > run.budget.events:
        so_far.end_before(int(run.budget.events) - before)
    return BudgetError(f"The run used {spent} and reached t = {t:.9g} s of {run.end:g} s: {cause}.", so_far)


def _rising_friction(program: Program, places: Iterable[int], point: Any, work: Any, so_far: Trajectory) -> SimulationError | None:
    """The error of the first of these elements whose kinetic friction at no slip is above its static friction, or None."""
    t = float(work.reals[work_layout.TIME])
    for i in places:
        element = program.system.elements[i]
        if not element.slides or element.second:
            continue
        at_rest = element.kinetic if element.directions == 1 else ca.substitute(element.kinetic, element.speed, 0)
        sizes = output_function(program, ca.vertcat(at_rest, element.static))
        kinetic, static = np.array(sizes(t, point.states.T, work.p[: program.first_held], work.p[program.first_held :], work.m)).ravel()
        if kinetic > (1.0 + 1e-9) * static:
            return SimulationError(
                f"The kinetic friction of `{element.name}` must be <= its static friction, but it is {kinetic:.6g} against {static:.6g} at t = {t:.9g} s, "
                "where it leaves or enters stick.", so_far,
            )  # fmt: skip
    return None


def _below_zero(names: Sequence[str], pressing: int) -> str:
    """Why a bound may be below zero, in words; pressing: number of the rigid contact that gives the load, or -1."""
    if pressing < 0:
        return "is its load negative?"
    return f"no force of the rigid contact `{names[pressing]}` agrees with this slip (Painleve's paradox); with a `stiffness` it has one."


JAMMED = 1e-4
"""Part of what a contact yields under its own force alone, below which its force with the friction that it presses has no bound to speak of."""


def _paradox(program: Program, point: Any, work: Any, t: float, otherwise: str = ".") -> str:
    """The end of a sentence where closed rigid contacts would have to pull, or to push without bound, while frictions that they press slide as they do, or are
    about to. otherwise: the end where they would not.
    """
    elements, mode = program.system.elements, work.m
    closed = [i for i, element in enumerate(elements) if element.rigid and mode[i] == 0.0]
    pressed = [i for i, element in enumerate(elements) if element.slides and not element.second and int(program.attached[i]) in closed]
    if not pressed:
        return otherwise
    wanted = ca.densify(ca.horzcat(program.system.switched_equations.gain, ca.vertcat(*[element.sliding for element in elements])))
    found = np.array(output_function(program, wanted)(t, point.states.T, work.p[: program.first_held], work.p[program.first_held :], mode))
    gain, coefficients = found[:, :-1], found[:, -1]
    alone = gain[np.ix_(closed, closed)]
    yields = alone.copy()  # of the contacts to their forces, with the friction that goes with these
    for i in pressed:
        contact, force = int(program.attached[i]), float(np.ravel(point[f"{elements[i].name}.force"])[0])
        slides = mode[i] or -np.sign(force) * (
            abs(force) >= 0.99 * coefficients[i] * float(np.ravel(point[f"{elements[contact].name}.force"])[0])
        )
        yields[:, closed.index(contact)] += slides * coefficients[i] * gain[closed, i]
    if not np.linalg.det(yields) <= JAMMED * np.linalg.det(alone):
        return otherwise
    worst = closed[int(np.argmin(np.diag(yields) / np.diag(alone)))]
    return (
        f": the machine jams (Painleve's paradox). With the friction that it presses no force of the rigid contact `{elements[worst].name}` agrees with the "
        "slip, or only one without bound; with a `stiffness` it has one."
    )


def controllers_of(system: HybridSystem) -> list[str]:
    """Names of the sampled controllers of a closed system, in the order of its updates."""
    return [type(law_of(part)).__name__ for part in system.parts if isinstance(part, (ZeroOrderHold, External))]


def values_of(system: HybridSystem, c: int) -> list[str]:
    """Names of the values that sampled controller c gives at a sample, in their order in `z` of the compiled loop: its memory, then its outputs."""
    update = system.updates[c]
    memory = [[name] if size is None else [f"{name}.{i}" for i in range(size)] for name, (_, size) in update.places.items()]
    return [*itertools.chain(*memory), *update.names]


def not_finite(system: HybridSystem, c: int, t: float, values: np.ndarray) -> str:
    """Which of the values that sampled controller c gives at time t is no finite number, as a sentence; values: as `values_of` names them."""
    name, value = next(pair for pair in zip(values_of(system, c), values, strict=False) if not np.isfinite(pair[1]))
    return f"Controller `{controllers_of(system)[c]}` must give finite numbers, but `{name}` is {value:g} at t = {t:.9g} s."


def _state_error(words: str, name: str, program: Program, so_far: Trajectory) -> SimulationError:
    """The error of a state that is no finite number; of a continuous controller it names that."""
    system = program.system
    owner = system.owners.get(name, system.owners.get(name.rpartition(".")[0], -1))
    law = law_of(system.parts[owner]) if 0 <= owner < len(system.parts) else None
    if isinstance(law, Controller):
        return ControllerError(f"Controller `{type(law).__name__}` must give finite numbers: {words[0].lower()}{words[1:]}", so_far)
    return SimulationError(words, so_far)


def _no_modes(program: Program, point: Any, work: Any, t: float, so_far: Trajectory) -> SimulationError:
    """The error of a run at whose instant no modes agree with the forces."""
    names = [element.name for element in program.system.elements]
    inside = (
        [
            e
            for e in program.system.elements
            if e.rigid and float(np.ravel(point[f"{e.name}.{'slip' if e.is_unilateral else 'closure'}"])[0]) > 0.0
        ]
        if not work.ints[work_layout.STARTED]
        else []
    )
    if inside and inside[0].is_unilateral:
        return SimulationError(
            f"The slip of the one-way clutch `{inside[0].name}` must be <= 0 {inside[0].slip_unit} at the start, but it is "
            f"{float(np.ravel(point[inside[0].name + '.slip'])[0]):g}: its driving side must not be faster than the side that it drives.",
            so_far,
        )
    if inside:
        return SimulationError(f"The closure of the rigid contact `{inside[0].name}` must be <= 0 at the start, but it is inside.", so_far)
    still = [i for i in program.form.passing if work.m[i] == 0.0]
    if still:
        return SimulationError(
            f"The slip of `{names[still[0]]}` is prescribed and stands still from t = {t:.9g} s on: nothing decides the force of a friction at rest "
            "between motions that are given. Let the motion pass through zero, or move it by a force.",
            so_far,
        )
    if (wrong := _rising_friction(program, range(len(names)), point, work, so_far)) is not None:
        return wrong
    words = f"No modes of the elements {', '.join(names)} are consistent with the forces at t = {t:.9g} s" + _paradox(
        program, point, work, t
    )
    return NoModes(words + _sharing(program, point, work, t), so_far)


def failure(status: int, run: Run, program: Program, work: Any, began: float, answers: list[list[np.ndarray]]) -> SimulationError:
    """The error of a run that the loop gave up, in words of the plant."""
    so_far = trajectory_so_far(run, program, work, began, answers)
    t = float(work.reals[work_layout.TIME])
    if status == work_layout.NOT_FINITE:
        return ControllerError(not_finite(program.system, int(work.ints[work_layout.CULPRIT]), t, work.z), so_far)
    names = [element.name for element in program.system.elements]
    point = Trajectory.at_instant(run, program, t, work.x, work.m, work.p)
    if status in (work_layout.INCONSISTENT, work_layout.ENDLESS, work_layout.NEGATIVE_BOUND):
        bounds = np.array(output_function(program, ca.vertcat(*[e.static for e in program.system.elements]))(
            t, point.states.T, work.p[: program.first_held], work.p[program.first_held :], work.m)).ravel()  # fmt: skip
        i = int(work.ints[work_layout.CULPRIT]) if status == work_layout.NEGATIVE_BOUND else int(np.argmin(bounds))
        sizes = work.guard_scale[program.kernel.guards - len(program.bounded) : program.kernel.guards]
        there = bounds[i] < (-1e-9 * sizes.max(initial=0.0) if status == work_layout.NEGATIVE_BOUND else 0.0)
        if there or status == work_layout.NEGATIVE_BOUND:
            now = f"is {bounds[i]:.6g}" if there else "falls below 0"
            why = _below_zero(names, int(program.attached[i]))
            return SimulationError(program.system.elements[i].negative_bound(f"{now} at t = {t:.9g} s", why), so_far)
    if status == work_layout.ENDLESS:
        i = int(work.ints[work_layout.CULPRIT])
        if i >= len(names):
            return ZenoError(
                f"A kink of the equations, of fabs, fmin or fmax, is passed without end at t = {t:.9g} s{_resolution(t)}.", so_far
            )
        i -= program.system.elements[i].second
        if (wrong := _rising_friction(program, [i], point, work, so_far)) is not None:
            return wrong
        return ZenoError(
            f"Element `{names[i]}` switches without end at t = {t:.9g} s{_resolution(t)}" + _paradox(program, point, work, t), so_far
        )
    if status == work_layout.INCONSISTENT:
        return _no_modes(program, point, work, t, so_far)
    labels = _labels(program)
    if status == work_layout.STATE_NOT_FINITE:
        name = labels[int(np.argmin(np.isfinite(work.x[: len(labels)])))]
        return SimulationError(f"The state `{name}` is not finite at t = {t:.9g} s." + _sharing(program, point, work, t), so_far)
    if status == work_layout.STALLED:
        cause = bottleneck(run, program, work, np.bincount(work.ev_i[: int(work.ints[work_layout.EVENTS])], minlength=len(names)))
        return SimulationError(
            f"The run makes no progress at t = {t:.9g} s: a million steps have moved it by less than a millionth of that; {cause}.", so_far
        )
    finite = np.isfinite(work.k[: len(labels)])
    if not finite.all():
        name = labels[int(np.argmin(finite))]
        return _state_error(
            f"The rate of `{name}` is not finite at t = {t:.9g} s." + _sharing(program, point, work, t), name, program, so_far
        )
    if not np.isfinite(work.y[: len(labels)]).all():
        name = labels[int(np.argmin(np.isfinite(work.y[: len(labels)])))]
        words = f"No step from t = {t:.9g} s gives a finite `{name}`: its equations, and friction laws a little beyond zero slip, must be smooth."
        return _state_error(words, name, program, so_far)
    largest = int(np.argmax(np.abs(work.x[: len(labels)])))
    if abs(work.x[largest]) > 1e12:
        return _state_error(
            f"The run diverges: `{labels[largest]}` is {work.x[largest]:.3g} at t = {t:.9g} s.", labels[largest], program, so_far
        )
    words = f"The step size fell below what double precision resolves at t = {t:.9g} s{_resolution(t)}"
    words += _paradox(program, point, work, t, _too_fast(program, point, work, t, labels))
    return SimulationError(words + _sharing(program, point, work, t), so_far)


def _labels(program: Program) -> list[str]:
    """The name of every entry of the states."""
    return [name if size is None else f"{name}.{i}" for name, (_, size, _) in program.system.states.items() for i in range(count_of(size))]


TOLD_APART = 1e-5
"""Distance of times, in time constants of a state, from which on its motion cannot be followed."""


def _too_fast(program: Program, point: Any, work: Any, t: float, labels: list[str]) -> str:
    """The end of a sentence on steps that are too small: the state that moves faster than times can tell apart, where one does."""
    rates = output_function(program, ca.densify(ca.diag(ca.jacobian(program.system.switched_equations.field, program.system.x))))
    found = np.abs(np.array(rates(t, point.states.T, work.p[: program.first_held], work.p[program.first_held :], work.m)).ravel())
    fastest = int(np.argmax(found))
    if not found[fastest] * np.spacing(t) > TOLD_APART:
        return "; lower the accuracy asked."
    return (
        f": `{labels[fastest]}` moves with a time constant of {1.0 / found[fastest]:.2g} s there, and times are {np.spacing(t):.2g} s apart. Make it slower, "
        "such as by a larger inertia."
    )


def _sharing(program: Program, point: Any, work: Any, t: float) -> str:
    """What to add where the slip of one element follows from those of others at this state; plants whose gain is constant were asked when composed."""
    elements = program.system.elements
    sliding = [i for i, element in enumerate(elements) if element.slides]
    gain = output_function(program, ca.densify(program.system.switched_equations.gain))
    matrix = np.array(gain(t, point.states.T, work.p[: program.first_held], work.p[program.first_held :], work.m))[np.ix_(sliding, sliding)]
    size = np.sqrt(np.abs(np.diag(matrix)))
    if not (np.isfinite(matrix).all() and size.all()):
        return ""
    dependent = dependent_rows(matrix / np.outer(size, size)) if sliding else []
    return f" {must_be_independent([elements[sliding[i]].title for i in dependent])}" if dependent else ""


def _resolution(t: float) -> str:
    """How far times are apart that a number can tell, where that is more than a run of ordinary length would notice."""
    return f", where times are {np.spacing(t):.2g} s apart" if t > 1e3 else ""
