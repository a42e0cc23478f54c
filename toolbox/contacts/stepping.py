"""Time stepping of a body with many contacts: implicit Euler for the body, all contact forces at the end of the step.

    (M / h^2 + C / h + K) (q_1 - q_0) = f_1 + M v_0 / h - K q_0 + forces of the contacts ,   v_1 = (q_1 - q_0) / h

The contacts hold at the end of every step: gaps and slips exactly, so nothing drifts. What the formula takes from oscillations it cannot follow is
v' M v' / 2 + d' K d' / 2 of the changes v' of speed and d' of displacement in every step, and the audit of a run counts it by itself. The error falls with
the first power of the step. The coefficient of friction of a step is that at the slip speed of the step before; a contact that stuck begins at the static one.
A force of the inputs acts over a whole step as it is at its end, f_1; a counter-surface moves by h times the mean of its speeds at the begin and at the
end; where an input jumps between two steps each has the side that is its own. What a law drives is held.
"""

from __future__ import annotations

import math
import time as clock
import warnings
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from toolbox.arguments import number, short
from toolbox.contacts.contact_run import ContactRun, Energies
from toolbox.contacts.newton import ContactSolver, Given, Solution
from toolbox.contacts.problem import OPEN, SLIP, STICK, ContactProblem
from toolbox.contacts.sampled_laws import Acting, constants
from toolbox.errors import SceneError, SimulationError
from toolbox.files.units import NumberOrText

MOST_STEPS = 1_000_000


def step_contacts(
    problem: ContactProblem,
    duration: NumberOrText,
    *,
    step: NumberOrText,
    inputs: Mapping[str, Any] | None = None,
    controller: Any = None,
    sample_time: NumberOrText | None = None,
    start: ContactRun | None = None,
) -> ContactRun:
    """Simulate a body with many contacts in time steps of equal length.

    Controllers measure `<output>.position` and `<output>.speed` of the outputs of the problem, and drive its inputs.
    With an output `top` that is an angle and an input `top.torque`, a controller that measures `top.speed` and drives
    `top.torque` runs without change. A controller samples at the end of a step, and its commands are held over the
    steps that follow.

    Parameters
    ----------
    problem
        The body with its contacts, forces and moving surfaces.
    duration
        Length of the run [s], > 0.
    step
        Length of a step [s], > 0. It is shortened so that a whole number of steps makes the duration.
    inputs
        {name in `problem.forces` or `problem.surface`, or set-point of a controller such as `top.reference`: value}.
        A value is a number, text with a unit, a table (times, values), a shape of `toolbox.inputs` or an expression
        of `toolbox.time`. Inputs that are left out are 0, set-points the default of the controller. Over a step a
        force acts with its value at the end of the step, and a surface moves with the mean of its speeds at both
        ends.
    controller
        One controller or several, each a `Controller`, a `Sampled` with its own period, delay and sensors, or a
        callable (t, y) -> u. By default none.
    sample_time
        Sample time [s] of controllers that are not `Sampled`, by default None. Periods and delays must be whole numbers
        of steps.
    start
        A run of a problem with the same numbers of coordinates and contacts, such as the result of `press_contacts`.
        The new run begins at the end of this run. By default the body begins at rest with q = 0.

    Returns
    -------
    ContactRun
        States and forces at the start and at the end of every step.

    Raises
    ------
    SceneError
        If an argument is out of range, a name is unknown, a unit does not fit, or a controller is not sampled.
    SimulationError
        If no set of open, sticking and sliding contacts solves a step. Its `run` ends before this step.

    Examples
    --------
    >>> from models import AxialChain, Coulomb, TorsionalChain, string_on_wall
    >>> from toolbox.contacts import step_contacts
    >>> axial = AxialChain(mass=(5000.0,), stiffness=(4e6,), damping=(2e5,))
    >>> torsional = TorsionalChain(inertia=(2000.0, 100.0), stiffness=(2000.0,), damping=(80.0,))
    >>> string = string_on_wall(axial, torsional, radius=0.1, loads=(5000.0,), friction=Coulomb(0.3, 0.3))
    >>> run = step_contacts(string, "10 s", step=0.02, inputs={"hook.speed": -0.1})
    >>> print(f"drag {4e6 * run['axial.0'][-1]:.0f} N")
    drag 1500 N
    """
    _check_problem(problem)
    if sample_time is not None and controller is None:
        raise SceneError("Argument `sample_time` must come with a `controller`, but there is none.")
    begin = _checked_start(problem, start)
    times, h = instants(duration, step, 0.0 if begin is None else begin.end)
    begun = clock.perf_counter()
    run = _Stepping(problem, h, Acting(problem, inputs, times, controller, sample_time), begin).through()
    run.wall_time = clock.perf_counter() - begun
    run._finer = partial(
        step_contacts, problem, duration, step=h / 2, inputs=inputs, controller=controller, sample_time=sample_time, start=start
    )
    return run


def instants(duration: NumberOrText, step: NumberOrText, begin: float = 0.0) -> tuple[np.ndarray, float]:
    """The instants of a run [s], and the length of its steps. Raises SceneError for arguments out of range."""
    duration, step = number("duration", duration, "s", above=0), number("step", step, "s", above=0)
    if duration / step > MOST_STEPS:
        raise SceneError(f"Argument `step` must be at least {duration / MOST_STEPS:g} s, {MOST_STEPS} steps, but it is {step!r}.")
    count = max(1, math.ceil(duration / step * (1 - 1e-9)))
    return begin + duration / count * np.arange(count + 1), duration / count


def press_contacts(problem: ContactProblem, inputs: Mapping[str, float] | None = None, *, frictionless: bool = False) -> ContactRun:
    """Compute the state of rest of a body under constant inputs, by one static step from q = 0.

    Use this function to compute normal loads from statics, and the start of a run. Tangential forces follow Coulomb's
    law for loading in one step from the unloaded state. The contacts must hold all rigid motions that the stiffness
    leaves free: a body that can escape along a motion of zero stiffness has no state of rest.

    Parameters
    ----------
    problem
        The body with its contacts.
    inputs
        {input: constant value}. Inputs that are left out are 0, by default all.
    frictionless
        Whether friction is left out, for example while a body settles before it is pulled, by default False. Contacts
        then count as slipping and carry no tangential force.

    Returns
    -------
    ContactRun
        The state of rest.

    Raises
    ------
    SceneError
        If a name is unknown, or the body can escape.
    SimulationError
        If no set of contacts is at rest.

    Examples
    --------
    >>> import numpy as np
    >>> from models import Coulomb
    >>> from toolbox.contacts import ContactProblem, press_contacts
    >>> down, along = np.array([[1.0, 0.0]]), np.array([[[0.0, 1.0]]])
    >>> block = ContactProblem(np.eye(2), np.diag([0.0, 100.0]), along, Coulomb(0.5, 0.5), normal=down, force_inputs={"press": down[0]})
    >>> print(press_contacts(block, {"press": 20.0}).normal[0], "N")
    [20.] N
    """
    _check_problem(problem)
    return _Stepping(problem, math.inf, constants(problem, inputs), None, 0.0 if frictionless else 1.0).through()


class _Stepping:
    """One run: matrices that all steps share, and the state."""

    def __init__(self, problem: ContactProblem, h: float, acting: Acting, start: ContactRun | None, friction: float = 1.0):
        self.problem, self.h, self.start, self.acting = problem, h, start, acting
        self.times, self.values = acting.times, acting.values
        moves = problem.displacements()
        still = math.isinf(h)
        matrix = problem.stiffness if still else problem.mass / h**2 + problem.damping / h + problem.stiffness
        self.flexibility, self.shapes, condensed = _condensed(matrix, moves)
        if not still:
            _check_held(condensed, h)
        self.solver = ContactSolver(condensed, problem.contacts, problem.directions)
        self.moves, self.factor = moves, friction
        self.static, self.sliding = problem.coefficients()
        c, k, n, rows = problem.contacts, problem.directions, problem.size, self.times.size
        self.q, self.v = np.zeros((rows, n)), np.zeros((rows, n))
        self.normal, self.tangential, self.slip = np.zeros((rows, c)), np.zeros((rows, c, k)), np.zeros((rows, c, k))
        self.modes = np.zeros((rows, c), np.int8)
        self.rubbed, self.passes = np.zeros((rows, c)), np.zeros(rows, int)
        self.energy = Energies(rows, tuple(problem.force_inputs))
        self.load = np.zeros(c) if problem.load is None else problem.load
        self.speed = np.zeros((c, k))
        self.last: Solution | None = None

    def through(self) -> ContactRun:
        """All steps."""
        problem, h = self.problem, self.h
        if self.start is not None:
            self._begin(self.start)
        else:
            self.modes[0] = (
                np.where(problem.gap > 0, OPEN, STICK) if problem.normal is not None else np.where(problem.load > 0, STICK, SLIP)
            )
        if math.isinf(h):
            force = sum(
                (self.values[name][0] * problem.force_inputs[name] for name in self.values if name in problem.force_inputs),
                np.zeros(problem.size),
            )
            found = self._solved(force, np.zeros((problem.contacts, problem.directions)), 0)
            if found is None:
                words = "No set of open, sticking and sliding contacts is at rest under these inputs: contacts, friction and springs must hold what acts."
                raise SimulationError(words)
            self._keep(0, self.q[0] + self.shapes @ found.moved + self.flexibility @ force, found)
            if np.abs(self.q[0]).max() * np.abs(problem.stiffness).max() > 1e13 * max(np.abs(force).max(), found.normal.max(), 1e-300):
                raise SceneError("Argument `problem` must have contacts that hold all rigid motions, but under these inputs one is free.")
            return self._run(1)
        for i in range(1, self.times.size):
            try:
                self.acting.hold(i - 1, self.q[i - 1], self.v[i - 1])
            except BaseException as error:  # of the user's law, or an interrupt: what was computed is not lost
                error.run = self._run(i)  # type: ignore[attr-defined]
                raise
            if not self._step(i):
                raise SimulationError(
                    f"No set of open, sticking and sliding contacts solves the step at {self.times[i]:.6g} s. A shorter `step` than {h:.3g} s may help.",
                    self._run(i),
                )
        return self._run(self.times.size)

    def _step(self, i: int) -> bool:
        """The step that ends at times[i]; False where it has no solution."""
        problem, h = self.problem, self.h
        sides = {name: self.acting.over(name, i) for name in self.values}
        acting = {name: end * problem.force_inputs[name] for name, (_, end) in sides.items() if name in problem.force_inputs}
        force = sum(acting.values(), np.zeros(problem.size))
        drive = force + problem.mass @ self.v[i - 1] / h - problem.stiffness @ self.q[i - 1]
        surface = np.zeros((problem.contacts, problem.directions))
        for name in problem.surface_velocity.keys() & sides.keys():
            surface += h * sum(sides[name]) / 2 * problem.surface_velocity[name]
        found = self._solved(drive, surface, i)
        if found is None:
            return False
        moved = self.shapes @ found.moved + self.flexibility @ drive
        q, v = self.q[i - 1] + moved, moved / h
        self.v[i] = v
        self._keep(i, q, found)
        self.speed = found.slip / h
        self.slip[i] = self.slip[i - 1] + found.slip
        self.rubbed[i] = self.rubbed[i - 1] - (found.tangential * found.slip).sum(axis=1)
        change = v - self.v[i - 1]
        before, energy = self.energy, self.energy
        energy.kinetic[i] = v @ problem.mass @ v / 2
        energy.elastic[i] = q @ problem.stiffness @ q / 2
        energy.damping[i] = before.damping[i - 1] + h * (v @ problem.damping @ v)
        energy.stepping[i] = before.stepping[i - 1] + (change @ problem.mass @ change + moved @ problem.stiffness @ moved) / 2
        energy.surface[i] = before.surface[i - 1] + (found.tangential * surface).sum()
        if problem.normal is not None:
            taken, shared = self._impacts(i, found, moved, surface)
            energy.impacts[i] = before.impacts[i - 1] + taken
            energy.stepping[i] -= shared
        for name in problem.force_inputs:
            work = acting[name] @ moved if name in acting else 0.0
            energy.work[name][i] = energy.work[name][i - 1] + work
        return True

    def _impacts(self, i: int, found: Solution, moved: np.ndarray, surface: np.ndarray) -> tuple[float, float]:
        """What closing contacts take in a step, and the part of it that the change of speed over the step has taken.

        A contact that was closed before does not strike: what its speed is above zero is round-off.
        By Kelvin's theorem an impulse takes itself times the mean of the speeds before and after it: a step that ends at rest takes it all, however it falls.
        """
        first, last = self.h * (self.problem.normal @ self.v[i - 1]), self.problem.normal @ moved
        was_open = (self.modes[max(i - 2, 0) : i] == OPEN).any(
            axis=0
        )  # the step after that which closes the gap takes the rest of the speed
        if i == 1:  # a run may begin with a closed contact that is thrown at the counter-surface
            was_open |= first > 1e-9 * self.h * (np.abs(self.problem.normal) @ np.abs(self.v[0]))
        strikes = was_open & (first > 0) & (found.normal > 0)
        slip = self.h * (self.problem.tangent @ self.v[i - 1]) - surface
        rest = (found.tangential * (found.slip - slip)).sum(axis=1) @ strikes / 2  # of the impulse of friction, beside what it rubs
        pressed = found.normal * strikes
        shared = float(pressed @ (first - last) / 2 + rest)
        return float(pressed @ last) + shared, shared

    def _solved(self, drive: np.ndarray, surface: np.ndarray, i: int) -> Solution | None:
        """Displacements of the contacts over the step, and their forces, under what drives the body."""
        problem = self.problem
        gap = problem.gap - problem.normal @ self.q[max(i - 1, 0)] if problem.normal is not None else problem.gap
        speed = np.linalg.norm(self.speed, axis=1)
        kinetic = np.array(self.sliding.map(problem.contacts)(speed[None])).ravel()
        friction = self.factor * np.where(speed > 0, kinetic, self.static)
        found = self.solver.solve(Given(self.shapes.T @ drive, gap, surface, friction, self.load), self.last)
        if found is not None:
            self.passes[i], self.last = found.passes, found
        return found

    def _keep(self, i: int, q: np.ndarray, found: Solution) -> None:
        self.q[i], self.tangential[i] = q, found.tangential
        self.normal[i] = found.normal
        self.modes[i] = np.where(found.is_open, OPEN if self.problem.normal is not None else SLIP, np.where(found.sticks, STICK, SLIP))
        if math.isinf(self.h):
            self.energy.elastic[i] = q @ self.problem.stiffness @ q / 2

    def _begin(self, start: ContactRun) -> None:
        """The state at the end of another run."""
        problem = self.problem
        for mine, other in (
            ("q", "coordinates"),
            ("v", "rates"),
            ("normal", "normal"),
            ("tangential", "tangential"),
            ("slip", "slip"),
            ("modes", "contact_modes"),
        ):
            getattr(self, mine)[0] = getattr(start, other)[-1]
        self.energy.kinetic[0] = self.v[0] @ problem.mass @ self.v[0] / 2
        self.energy.elastic[0] = self.q[0] @ problem.stiffness @ self.q[0] / 2
        self.rubbed[0] = 0.0
        is_open = self.modes[0] == OPEN if problem.normal is not None else np.zeros(problem.contacts, bool)
        self.last = Solution(np.zeros(0), self.normal[0], self.tangential[0], 0 * self.slip[0], is_open, self.modes[0] == STICK, 0)
        if len(start.time) > 1:
            self.speed = (start.slip[-1] - start.slip[-2]) / (start.time[-1] - start.time[-2])

    def _run(self, rows: int) -> ContactRun:
        return ContactRun(
            self.problem, self.times[:rows], self.q[:rows], self.v[:rows], self.modes[:rows], self.normal[:rows], self.tangential[:rows],
            self.slip[:rows], self.rubbed[:rows], self.energy.cut(rows), self.passes[:rows],
            {name: values[:rows] for name, values in self.values.items()},
        )  # fmt: skip


def _condensed(matrix: np.ndarray, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """G (n, n), P (n, m), K_c (m, m) of q = P s + G f and forces on the contacts K_c s - P^T f, where A q = f + W^T forces and s = W q.

    The matrix may be singular where the contacts hold what it leaves free.
    """
    from scipy.linalg import LinAlgError, LinAlgWarning, inv

    n, m = len(matrix), len(moves)
    rows = np.linalg.norm(moves, axis=1)
    if not rows.all():
        raise SceneError("Arguments `normal` and `tangent` must move something in every row, but one is all zero: that of a clamped place?")
    scale = (np.abs(np.diag(matrix)).mean() or 1.0) / rows[:, None]  # of a body without stiffness at rest anything does
    bordered = np.block([[matrix, (scale * moves).T], [scale * moves, np.zeros((m, m))]])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LinAlgWarning)  # whether it is an inverse is checked below
            inverse = inv(bordered, check_finite=False)
    except LinAlgError:
        inverse = None
    shapes = None if inverse is None else inverse[:n, n:] * scale.T
    if inverse is None or shapes is None or not np.abs(moves @ shapes - np.eye(m)).max() < 1e-6:
        raise SceneError(
            "Arguments `normal` and `tangent` must be independent displacements that, when held, leave no motion free of forces."
        )
    condensed = -inverse[n:, n:] * scale * scale.T
    flexibility = inverse[:n, :n]
    return (flexibility + flexibility.T) / 2, shapes, (condensed + condensed.T) / 2


def _check_held(condensed: np.ndarray, h: float) -> None:
    """Raise SceneError where a push on the contacts moves them against it: then nothing says which of several answers a step has."""
    try:
        np.linalg.cholesky(condensed + 1e-9 * np.abs(condensed).max() * np.eye(len(condensed)))
    except np.linalg.LinAlgError:
        least = np.linalg.eigvalsh(condensed)[0]
        raise SceneError(
            f"Arguments `mass`, `damping` and `stiffness` of the problem must hold its contacts against every push, but over a step of {h:.3g} s "
            f"one of {least:.3g} N/m pushes on: is a sign wrong, or the step too long for a body that is unstable?"
        ) from None


def _check_problem(problem: Any) -> None:
    if not isinstance(problem, ContactProblem):
        raise SceneError(
            f"Argument `problem` must be a ContactProblem, such as `ReducedBody.in_contact` makes, but it is {short(problem)}."
        )


def _checked_start(problem: ContactProblem, start: Any) -> ContactRun | None:
    if start is None:
        return None
    if not isinstance(start, ContactRun):
        raise SceneError(f"Argument `start` must be a ContactRun, but it is {start!r}.")
    other = start.problem
    if (other.size, other.contacts, other.directions) != (problem.size, problem.contacts, problem.directions):
        raise SceneError("Argument `start` must be a run of a problem with as many coordinates, contacts and directions, but it is not.")
    return start
