"""A designed `LinearMPC` as C: filter, program, check, fallback drive and limits in one step, around a solver that OSQP writes for this program.

    estimate z = z- + L (y - C z-);  theta = (x at arrival, last torque, T, reference);  min 1/2 w'w + g(theta)' w, low(theta) <= A w <= high(theta)
    u = first torque of the plan where its KKT residual is below 1e-6, else that of the soft drive;  within limits;  z- of the next sample

The step is the one of `PlannedLinear`, written once more as casadi expressions, and a test holds the two against each other. Why OSQP: it writes its own C with
all memory static and ships the sources, so that nothing is loaded while building. It is a first-order method, here run to 1e-8, mostly some 25 iterations and
hundreds where many limits bind (see `controllers.quadratic_program`); where the plan does not pass its check after `iterations`, the soft drive acts. The
solver's state is global: link one law of a name, and call it from one thread. Source: B. Stellato et al., Math. Prog. Comp. 12 (2020).
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from controllers.watchdog import MEMORY
from toolbox import SceneError
from toolbox.authoring import Declared, written

FAR = 1e30
"""What OSQP takes for infinity."""
TOLERANCE = 1e-6
"""Largest KKT residual of a plan that is used, as for the active-set solver in Python."""


def export(law: Any, c: Path, h: Path, period: float, iterations: int = 20000) -> Declared:
    """Write a `PlannedLinear` as NAME.c, NAME.h and the folder NAME_osqp of the solver; compile NAME.c with every .c of the folder and of its `src`.

    Raises SceneError for another period than that of the law.
    """
    numbers, name = law.law, c.stem
    if abs(period - numbers.period) > 1e-12 * period:
        raise SceneError(f"Argument `period` must be {numbers.period:g} s, the `period` of the law, but it is {period!r}.")
    before, after = _steps(law, name)
    _solver(law, c.parent, name, iterations)
    units = dict(zip(law.model.states, law.model.units, strict=True)) | {"top.speed": "rad/s", "bit.speed": "rad/s", "top.load": "N m"}
    reads: list[tuple[str, str, float | None]] = [(signal, units.get(signal, "1"), None) for signal in numbers.sensors]
    states = [(f"estimate.{signal}", unit) for signal, unit in zip(law.model.states, law.model.units, strict=True)]
    memory = [
        *states,
        ("estimate.bit.torque", "N m"),
        *[(f"torque sent {k} periods ago" if k > 1 else "last torque", "N m") for k in range(law.filter.periods + 1, 0, -1)],
        ("torque of the soft drive", "N m"),
        *[(f"watchdog: {what}", unit) for what, unit in MEMORY],
        ("the first sample is over", "1"),
        ("soft drive acts", "1"),
    ]
    declared = Declared(
        "LinearMPC", name, period,
        [*reads, ("top.torque.held", "N m", 0.0), ("top.reference", "rad/s", numbers.reference)],
        memory, [("top.torque", "N m")],
        note=f"The solver in {name}_osqp (OSQP, Apache 2.0) keeps its last answer to start from in static memory: one law, one thread.\n"
        f"Compile with all .c files of {name}_osqp and of {name}_osqp/src, and -I {name}_osqp -I {name}_osqp/inc/public -I {name}_osqp/inc/private.\n"
        "The last entry of the memory is 1 while the soft drive acts: the plan did not pass its check, or the watchdog found no motion.",
    )  # fmt: skip
    return written(c, h, declared, [before, after], _orchestration(name, law, before, after))


def _steps(law: Any, name: str) -> tuple[ca.Function, ca.Function]:
    """Functions (y, memory) -> (g, low, high), and (y, memory, primal, dual, solved) -> (u, next memory, sound).

    y: the sensors, the torque that is held at the top, the set-point.  memory: z-, the commands on their way with the last one at the end, the torque of the
    soft drive, what the watchdog remembers, whether the first sample is over, and whether the soft drive acts.
    """
    numbers, observer = law.law, law.filter
    n, sensors, waits = law.model.A.shape[0] + 1, len(numbers.sensors), observer.periods + 1
    watched = len(MEMORY)
    y, memory = ca.MX.sym("y", sensors + 2), ca.MX.sym("memory", n + waits + watched + 3)
    places = [0, n, n + waits, n + waits + 1, n + waits + 1 + watched, memory.numel() - 1, memory.numel()]
    prior, waiting, offset, watch, started, acting = ca.vertsplit(memory, places)
    first = ca.logic_and(started < 0.5, y[sensors] != 0.0)
    begun_string = ca.DM(law.steady_string) @ y[: sensors + 1]
    prior, waiting = ca.if_else(first, begun_string, prior), ca.if_else(first, y[sensors] * ca.DM.ones(waits), waiting)
    moving = ca.vertcat(*[ca.DM(row[None, :]) @ begun_string[:-1] for row in (law.top, law.model.load)], watch[2:])
    watch = ca.if_else(first, moving, watch)
    last = waiting[-1]
    reference = y[sensors + 1]
    z = prior + ca.DM(observer.gain) @ (y[:sensors] - ca.DM(observer.rows) @ prior)
    begun_period = ca.DM(observer.first) @ z + ca.DM(observer.first_drive) * waiting[0]
    arrival = begun_period
    for k in range(1, waits):
        arrival = ca.DM(observer.whole) @ arrival + ca.DM(observer.whole_drive) * waiting[k]
    theta = ca.vertcat(arrival[:-1], last, arrival[-1], reference)
    width = law.back.shape[0]
    moved = ca.DM(law.given) @ theta + ca.DM(law.constant)
    g, shift = moved[:width], moved[width:]
    low, high = (ca.fmin(ca.fmax(ca.DM(np.clip(bound, -FAR, FAR)) - shift, -FAR), FAR) for bound in law.bounds[:, width:])
    before = ca.Function(f"{name}_before", [y, memory], [g, low, high], ["y", "memory"], ["g", "low", "high"])

    # the check of `controllers.quadratic_program.residuals`
    A = ca.DM(law.program.A)
    w, dual, solved = ca.MX.sym("primal", width), ca.MX.sym("dual", A.shape[0]), ca.MX.sym("solved")
    pushed = A.T @ dual
    size = 1.0 + ca.fmax(ca.fmax(ca.mmax(ca.fabs(w)), ca.mmax(ca.fabs(g))), ca.mmax(ca.fabs(pushed)))
    value = A @ w
    reach = 1.0 + ca.fabs(value)
    below, above = value - low, high - value
    outside = ca.fmax(-ca.fmin(below, above), 0.0) / reach
    distance = ca.fabs(ca.if_else(dual > 0.0, above, below))
    standing = ca.fabs(dual) / size * ca.if_else(distance < FAR / 10, distance / reach, 1.0)
    residual = ca.fmax(ca.fmax(ca.mmax(ca.fabs(w + g + pushed)) / size, ca.mmax(outside)), ca.mmax(standing))
    sound = ca.logic_and(solved > 0.5, residual <= TOLERANCE)
    speed, load = (ca.DM(row[None, :]) @ z[:-1] for row in (law.top, law.model.load))
    watch_next, stopped = law.watchdog.expressions(watch, speed, load, last, reference)
    trusted = ca.logic_and(sound, ca.logic_not(stopped))

    error = reference - speed
    begun = ca.if_else(acting > 0.5, offset, last - law.drive.proportional * error) + law.drive.integral * numbers.period * error
    wanted = ca.if_else(trusted, ca.DM(law.back[:1]) @ w * numbers.torque_scale, begun + law.drive.proportional * error)
    if np.isfinite(law.rate):
        wanted = ca.fmin(ca.fmax(wanted, last - law.rate), last + law.rate)
    command = ca.fmin(ca.fmax(wanted, max(law.lowest, -FAR)), min(law.highest, FAR))
    sent = ca.vertcat(*[waiting[k] for k in range(1, observer.periods + 1)], command)
    following = ca.DM(observer.rest) @ begun_period + ca.DM(observer.rest_drive) * sent[0]
    memory_next = ca.vertcat(following, sent, ca.if_else(trusted, 0.0, begun), watch_next, 1.0, 1.0 - trusted)
    after = ca.Function(
        f"{name}_after",
        [y, memory, w, dual, solved],
        [command, memory_next, sound],
        ["y", "memory", "primal", "dual", "solved"],
        ["u", "next", "sound"],
    )
    return before, after


def _solver(law: Any, folder: Path, name: str, iterations: int) -> None:
    """The sources of a solver for the program, in NAME_osqp."""
    import osqp
    from scipy.sparse import csc_matrix, eye

    A = law.program.A
    many, n = A.shape
    program = osqp.OSQP()
    program.setup(
        eye(n, format="csc"), np.zeros(n), csc_matrix(A), np.full(many, -1.0), np.full(many, 1.0), verbose=False, eps_abs=1e-8, eps_rel=1e-9,
        max_iter=iterations, adaptive_rho_interval=50,
    )  # fmt: skip
    target = folder / f"{name}_osqp"
    if target.exists() and not (target / "osqp_configure.h").exists():
        raise SceneError(f"Argument `path` must not hide your own files, but `{target}` is not from an earlier export.")
    with tempfile.TemporaryDirectory() as made:
        program.codegen(made, parameters="matrices", force_rewrite=True, extension_name=name, compile=False, prefix=f"{name}_")
        for needless in ("CMakeLists.txt", "Makefile", "bindings.cpp", "emosqp.c", "setup.py"):
            (Path(made) / needless).unlink(missing_ok=True)
        try:
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree(made, target)
        except OSError as error:
            raise SceneError(f"Cannot write `{target}`: {error.strerror}.") from None


def _orchestration(name: str, law: Any, before: ca.Function, after: ca.Function) -> str:
    """The step around the solver."""
    many, width = law.program.A.shape
    memory = after.size1_out("next")
    work = [max(getattr(before, word)(), getattr(after, word)(), 1) for word in ("sz_arg", "sz_res", "sz_iw", "sz_w")]
    warm = "" if law.program.warm else f"  osqp_cold_start(&{name}_solver);\n"
    return f"""#include "{name}_osqp/{name}_workspace.h"
#include "osqp.h"

int {name}_step(const double *y, double *memory, double *u) {{
  static double g[{width}], low[{many}], high[{many}], primal[{width}], dual[{many}], next[{memory}], w[{work[3]}];
  static int iw[{work[2]}];
  const double *arg[{work[0]}];
  double *res[{work[1]}], solved, sound, given;
  int i, failed;
  arg[0] = y;
  arg[1] = memory;
  res[0] = g;
  res[1] = low;
  res[2] = high;
  failed = {name}_before(arg, res, iw, w, 0);
  if (failed) return failed;
{warm}  failed = (int)osqp_update_data_vec(&{name}_solver, g, low, high);
  if (!failed) failed = (int)osqp_solve(&{name}_solver);
  solved = failed ? 0.0 : 1.0;
  for (i = 0; i < {width}; ++i) {{
    primal[i] = {name}_solver.solution->x[i];
    if (!(fabs(primal[i]) < 1e30)) solved = 0.0;
  }}
  for (i = 0; i < {many}; ++i) {{
    dual[i] = {name}_solver.solution->y[i];
    if (!(fabs(dual[i]) < 1e30)) solved = 0.0;
  }}
  if (solved == 0.0) {{
    for (i = 0; i < {width}; ++i) primal[i] = 0.0;
    for (i = 0; i < {many}; ++i) dual[i] = 0.0;
  }}
  arg[0] = y;
  arg[1] = memory;
  arg[2] = primal;
  arg[3] = dual;
  arg[4] = &solved;
  res[0] = &given;
  res[1] = next;
  res[2] = &sound;
  failed = {name}_after(arg, res, iw, w, 0);
  if (failed) return failed;
  if (sound == 0.0) osqp_cold_start(&{name}_solver);
  return {name}_keep(&given, next, memory, u);
}}
"""
