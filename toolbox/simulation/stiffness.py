"""Whether a run under way is held up by stability, and would cost less with the stiff method.

The rule, in numbers that do not depend on the machine, so that a run can be repeated: after 1000 steps, and then again and again after a fifth more, over
the second half of the steps so far,

    1. the explicit method needs at least 3e8 instructions for the rest of the run, about 0.1 s, and 1e5 for every instruction that the other step would be
       written in (else compiling it does not pay: of n states that all depend on each other its elimination takes 2/3 n^3 of them), or would need
       them if all contacts slipped from now on, where forces hold each other: while all rows of an elastic cube stick its fastest motion decays at
       5e5/s, when they slip at 4e8/s;
    2. its mean step is longer than 0.25/rho, rho the spectral radius of df/dx (else accuracy asks for these steps, and any method needs them);
    3. between two events lie at least 50 steps (else accuracy asks for most of them: after an event implicit steps begin as short, and are more);
    4. in a trial of 100 steps from the same point the stiff method needs at most half the instructions per simulated second.

At the first look the run then begins anew with the stiff method, so that it is stepped by this alone. Later it goes on from where it is: a chain of 1000
inertias that rub, whose contacts let go one after the other, is stepped as cheaply by explicit steps until all have, and then in a thousandth of the steps.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from toolbox.compilation import work_layout
from toolbox.compilation.program import Program, program_of
from toolbox.compilation.rosenbrock import RODAS5P
from toolbox.simulation.growth import attended

FIRST_LOOK = 1_000
"""Steps after which a run is looked at first."""

OFTEN = 4
"""Looks while the steps double."""

WORTH = 3e8
"""Remaining instructions below which it is left alone."""

COMPILING = 1e5
"""Instructions in the time that writing and optimising one takes, some 30 us."""

NEAR = 0.25
"""Mean step, in units of 1/rho, below which stability does not limit it (events cut some steps short; the limit itself is 3 to 6)."""

STABLE = 5.0
"""Longest stable step, in units of 1/rho."""

CROWDED = 50
"""Steps between two events below which implicit ones do not pay: on 300 to 3000 inertias that rub, which let go one after the other, they are 35 to 75."""

TRIAL = 100
"""Steps of the trial."""

FEW = 8
"""Rows of records without which the loop asks for more."""


def spectral_radius(program: Program, t: float, x: np.ndarray, p: np.ndarray, m: np.ndarray, iterations: int = 40) -> float:
    """Largest modulus of the eigenvalues of df/dx [1/s], by power iteration on differences of the compiled field; right to a few percent."""
    with np.errstate(over="ignore", invalid="ignore"):
        return _growth(slope_of(program, t, p, m), x, iterations)


def slope_of(program: Program, t: float, p: np.ndarray, m: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """The compiled field x -> x' at a time, for parameters and modes."""
    field = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_double, *[ctypes.c_void_p] * 5)(program.kernel.addresses[0])
    n = program.kernel.states
    out = np.zeros(2 * n + 2 * program.kernel.guards + 8)

    def slope(at: np.ndarray) -> np.ndarray:
        field(t, 0.0, at.ctypes.data, at.ctypes.data, p.ctypes.data, m.ctypes.data, out.ctypes.data)
        return out[n : 2 * n].copy()

    return slope


def change_steps(work: Any, other: Program) -> None:
    """Let a paused run go on with the steps of another program of the same equations."""
    places = list(work_layout.FORMULAS)
    work.ints[places] = other.ints[places]
    work.reals[work_layout.POWER] = other.formulas.power
    work.reals[[work_layout.STEP_OLD, work_layout.FOLLOWED]] = 0.0
    work.k[: work.x.size] = slope_of(other, float(work.reals[work_layout.TIME]), work.p, work.m)(work.x)


def _growth(slope: Callable[[np.ndarray], np.ndarray], x: np.ndarray, iterations: int) -> float:
    start, size = slope(x), 1e-7 * max(float(np.abs(x).max(initial=0.0)), 1e-6)
    direction = np.random.default_rng(0).standard_normal(x.size)
    growth = []
    for _ in range(iterations):
        length = float(np.linalg.norm(direction))
        if not 0.0 < length < np.inf:
            return 0.0
        direction = (slope(x + size * direction / length) - start) / size
        growth.append(float(np.linalg.norm(direction)))
    return float(np.exp(np.log(np.maximum(growth[-10:], 1e-300)).mean()))


def pays(run: Any, program: Program, work: Any, since: tuple[float, int, int]) -> bool:
    """Whether the rest of a paused run costs less with the stiff method, by the rule of this module.

    since: (time, steps, events) at the last look.
    """
    from toolbox.stepping.event_stepper import run_on  # here, because LLVM is slow to import

    t, steps, events = (now - then for now, then in zip(progress(work), since, strict=True))
    left = run.end - float(work.reals[work_layout.TIME])
    rest = left / t * steps * program.kernel.cost if t > 0.0 else 0.0
    if rest < WORTH:
        return False
    if steps < CROWDED * events or t / steps * spectral_radius(program, float(work.reals[work_layout.TIME]), work.x, work.p, work.m) < NEAR:
        return False
    size = COMPILING * stiff_size(program)
    coupled = program.form.balance.numel() > 0  # else slipping makes nothing stiffer
    if rest < size and not (coupled and left * _rate_of_sliding(program, work) / STABLE * program.kernel.cost >= size):
        return False
    other = program_of(run.system, run.kinds, RODAS5P)
    records = ("rec_t", "rec_x", "rec_m", "rec_p")  # of which the trial makes none
    trial = type(work)(*(array[:FEW].copy() if name in records else array.copy() for name, array in zip(work._fields, work, strict=True)))
    change_steps(trial, other)
    trial.ints[[work_layout.RECORDS, work_layout.EVENTS, work_layout.NODES]] = 0
    trial.ints[work_layout.OUTPUT] = trial.out_t.size
    trial.ints[work_layout.BUDGET] = TRIAL
    begin = progress(trial)
    if attended(run_on, other)(trial) not in (work_layout.PAUSED, work_layout.DONE, work_layout.EVENTS_FULL):
        return False
    t_trial, steps_trial, events_trial = (now - then for now, then in zip(progress(trial), begin, strict=True))
    explicit = program.kernel.cost * (steps + SEARCH * events) / t
    return other.kernel.cost * (steps_trial + SEARCH * events_trial) <= 0.5 * explicit * t_trial


def _rate_of_sliding(program: Program, work: Any) -> float:
    """The spectral radius [1/s] where the plant is now, if all its contacts slipped, roughly."""
    holds = np.array([element.slides for element in program.system.elements])
    modes = work.m.copy()
    modes[: holds.size][holds] = 1
    return spectral_radius(program, float(work.reals[work_layout.TIME]), work.x, work.p, modes, 12)


def stiff_size(program: Program) -> int:
    """Number of instructions that the linear algebra of a stiff step would be written in."""
    from toolbox.compilation.implicit_step import implicit_size

    system = program.system
    x = ca.vertcat(system.x, ca.SX.sym("hidden", program.kernel.states - system.x.numel()))
    return implicit_size(x, ca.vertcat(ca.SX(0, 1), *[element.multiplier for element in system.elements]), program.form)


SEARCH = 5
"""Steps that finding an event takes, about."""


def progress(work: Any) -> tuple[float, int, int]:
    """(time, steps, events) of a run so far."""
    ints = work.ints
    return float(work.reals[work_layout.TIME]), int(ints[work_layout.ACCEPTED] + ints[work_layout.REJECTED]), int(ints[work_layout.EVENTS])
