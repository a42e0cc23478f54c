"""What becomes of a machine with stick and slip at the edges of its numbers, here and in other tools?

Every case has an answer that is known without simulation: the arcs of a block on a belt with Coulomb friction, rest, a rigid body, the last bounce of
a ball. Each program gets it in a process of its own with 20 s (its compilation and imports not counted), and the table shows its error, the largest
difference of any state over 401 times relative to the size of that state; or how it ended.

    event            this toolbox as it is, accuracy 1e-6
    time stepping    this toolbox, Moreau-Jean, step from the accuracy 1e-3
    scipy, events    solve_ivp (DOP853, rtol 1e-8) from switch to switch, by hand: `studies/benchmarks/reference.py`
    scipy, tanh      solve_ivp (Radau, rtol 1e-8) with friction smeared over 1e-4 of the speed of the case
    casadi, tanh     CVODES with the same smeared law
    heyoka, tanh     Taylor integration with the same smeared law

    python -m studies extremes [--only CASE ...] [--programs NAME ...] [--out FILE.md]        (some minutes; heyoka where it is installed)
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import multiprocessing
import sys
import time as clock
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from models import BlockOnBelt, BlocksOnBelt, Coulomb, Exponential, TorsionalChain
from studies.benchmarks import reference
from toolbox import Component, Equations, HybridSystem, Quantity, UnilateralContact, compose, quantity, simulate, state
from toolbox.errors import UnusualValue
from toolbox.modelling import smoothed

PATIENCE = 20.0
"""Seconds that a program has."""
RIGHT = 1e-2
"""Error up to which an answer counts as right: ten times the loosest accuracy that is asked of a program here."""


@dataclass(frozen=True)
class Extreme:
    """A plant at an edge, with the states that it must have at given times, and a typical slip speed.

    truth: (times) -> states, shape (nt, n).
    """

    plant: HybridSystem
    duration: float
    truth: Callable[[np.ndarray], np.ndarray]
    speed: float = 1.0
    start: dict[str, Any] = field(default_factory=dict)
    inputs: dict[str, Any] = field(default_factory=dict)


def belt_arcs(
    times: np.ndarray, m: float, k: float, v_belt: float, F_s: float, F_k: float, x: float = 0.0, v: float | None = None
) -> np.ndarray:
    """Position and speed of a block on a belt with Coulomb friction and no damping: straight lines in stick, arcs of a circle in slip.

    slip s:  x = x_e + (R / w) sin(w t + phi), v = R cos(w t + phi), x_e = -s F_k / k,   until v = v_belt again
    """
    w = math.sqrt(k / m)
    v = v_belt if v is None else v
    out, t, asked = np.empty((times.size, 2)), 0.0, 0
    stuck = v == v_belt and abs(k * x) <= F_s
    s = 0 if stuck else (math.copysign(1, v - v_belt) if v != v_belt else -math.copysign(1, x))
    while asked < times.size:
        if not s:
            lasts = math.inf if v_belt == 0 else (math.copysign(F_s, v_belt) - k * x) / (k * v_belt)
            here = times[asked : np.searchsorted(times, t + lasts, "right")]
            out[asked : asked + here.size] = np.column_stack([x + v_belt * (here - t), np.full(here.size, v_belt)])
            asked, t, x = asked + here.size, t + lasts, math.copysign(F_s, v_belt) / k
            s, v = -math.copysign(1, v_belt), v_belt
            continue
        x_e = -s * F_k / k
        R, phi = math.hypot(v, w * (x - x_e)), math.atan2(w * (x - x_e), v)
        # slip speed has the sign s until v crosses the speed of the belt: cos(phi + w t) = v_belt / R
        edge = math.acos(max(-1.0, min(1.0, v_belt / R)))
        angle = (2 * math.pi - edge - phi) if s < 0 else (edge - phi)
        angle %= 2 * math.pi
        lasts = (angle or 2 * math.pi) / w
        sine, cosine = math.sin(phi), math.cos(phi)
        here = times[asked : np.searchsorted(times, t + lasts, "left")]
        turn = w * (here - t)
        out[asked : asked + here.size] = np.column_stack(
            [x_e + R / w * (sine * np.cos(turn) + cosine * np.sin(turn)), R * (cosine * np.cos(turn) - sine * np.sin(turn))]
        )
        x, v, t, asked = x_e + R / w * math.sin(phi + w * lasts), v_belt, t + lasts, asked + here.size
        s = 0 if abs(k * x) <= F_s else -math.copysign(1, x)
    return out


def belt(*, m=1.0, k=1.0, v_belt=0.2, F_s=1.0, F_k=0.5, x=0.0, periods=10.0, friction=None) -> Extreme:
    """A block on a belt that begins at rest on it."""
    plant = compose(BlockOnBelt(mass=m, stiffness=k, belt_speed=v_belt, load=1.0, friction=friction or Coulomb(static=F_s, kinetic=F_k)))
    duration = periods * 2 * math.pi * math.sqrt(m / k)
    start = {"block.position": x, "block.speed": v_belt}
    speed = max(abs(v_belt), (F_s - F_k) / math.sqrt(k * m)) or 1.0
    return Extreme(plant, duration, lambda t: belt_arcs(t, m, k, v_belt, F_s, F_k, x), speed, start)


@dataclass(frozen=True)
class Ball(Component):
    """A ball above a rigid floor: m v' = -m g + N."""

    mass: Quantity = quantity(1.0, "kg", "mass", above=0)
    restitution: Quantity = quantity(0.5, "1", "restitution", at_least=0, at_most=1)

    def equations(self, signal):
        z, v = state("ball.height", "m"), state("ball.speed", "m/s")
        floor = UnilateralContact("floor", closure=-z, rate=-v, restitution=self.restitution)
        return Equations(flow={z: v, v: -9.81 + floor.force / self.mass}, elements=[floor])


def ball_flights(times: np.ndarray, height: float = 1.0, e: float = 0.5) -> np.ndarray:
    """Height and speed of a ball dropped from `height`, every bounce e times as fast as the one before, at rest after infinitely many."""
    g = 9.81
    out = np.zeros((times.size, 2))
    t, z, v = 0.0, height, 0.0
    for _ in range(60):
        lasts = (v + math.sqrt(v * v + 2 * g * z)) / g
        here = (times >= t) & (times < t + lasts)
        late = times[here] - t
        out[here] = np.column_stack([z + v * late - g * late**2 / 2, v - g * late])
        t, z, v = t + lasts, 0.0, -e * (v - g * lasts)
    return out


def rigid_string(times: np.ndarray, J: float, c: float, T: float, T_k: float) -> np.ndarray:
    """Twist, top speed and bit speed of a string so stiff that it turns as one body: J w' = T - T_k - c w from rest."""
    w = (T - T_k) / c * -np.expm1(-c / J * times)
    return np.column_stack([np.zeros(times.size), w, w])


def many_blocks(n: int = 1000) -> Extreme:
    """Blocks on one belt that do not know each other, each begun elsewhere."""
    offsets = np.linspace(-0.9, 0.9, n)
    ones, zeros = (1.0,) * n, (0.0,) * n
    blocks = BlocksOnBelt(
        mass=ones, stiffness=ones, damping=zeros, tie=zeros[1:], load=ones, belt_speed=0.2, friction=Coulomb(static=1.0, kinetic=0.5)
    )

    def truth(times: np.ndarray) -> np.ndarray:
        each = np.stack([belt_arcs(times, 1.0, 1.0, 0.2, 1.0, 0.5, float(x)) for x in offsets])
        return np.concatenate([each[:, :, 0].T, each[:, :, 1].T], axis=1)

    return Extreme(compose(blocks), 20.0, truth, 0.5, {"blocks.position": offsets, "blocks.speed": np.full(n, 0.2)})


def string(stiffness: float, inertia: tuple[float, float]) -> Extreme:
    """Two inertias on a shaft that is far too stiff to twist, dragged by friction at the first."""
    chain = TorsionalChain(
        inertia=inertia,
        stiffness=(stiffness,),
        damping=(0.0,),
        top_drag=100.0,
        friction=Coulomb(static=0.3, kinetic=0.3),
        friction_load=(1000.0, 0.0),
    )
    return Extreme(compose(chain), 60.0, lambda t: rigid_string(t, sum(inertia), 100.0, 1000.0, 300.0), 7.0, {}, {"top.torque": 1000.0})


EXTREMES: dict[str, Callable[[], Extreme]] = {
    "static friction 100 times kinetic": lambda: belt(F_k=0.01),
    "static friction as kinetic": lambda: belt(F_k=1.0, x=0.3),
    "friction falls within 1e-6 m/s": lambda: belt(friction=Exponential(static=1.0, kinetic=0.5, decay=1e6)),
    "belt stands, pulled with 90 % of the bound": lambda: belt(v_belt=0.0, x=0.9, periods=100.0),
    "belt creeps at 1e-12 m/s, at 95 % of the bound": lambda: belt(v_belt=1e-12, x=0.95, periods=100.0),
    "belt at 1e4 m/s": lambda: belt(v_belt=1e4),
    "no load": lambda: belt(F_s=0.0, F_k=0.0),
    "load 1e9 N": lambda: belt(k=1e9, m=1e9, F_s=1e9, F_k=5e8),
    "a period of 6e-6 s": lambda: belt(m=1e-6, k=1e6),
    "a period of 6e6 s": lambda: belt(m=1e6, k=1e-6, v_belt=0.2e-6),
    "10 000 periods": lambda: belt(periods=10_000.0),
    "inertias 1e6 apart": lambda: string(1e6, (2000.0, 2e-3)),
    "a shaft 1e9 times too stiff": lambda: string(1e12, (2000.0, 400.0)),
    "1000 contacts": many_blocks,
    "a ball comes to rest": lambda: Extreme(compose(Ball()), 3.0, ball_flights, 1.0, {"ball.height": 1.0}),
}


# --- the programs


def scaled(states: np.ndarray, truth: np.ndarray) -> float:
    """Largest difference of any state relative to its size; states that are zero throughout are compared with the largest one."""
    size = np.abs(truth).max(axis=0)
    size[size < 1e-9 * max(size.max(), 1e-30)] = size.max() or 1.0
    return float((np.abs(states - truth).max(axis=0) / size).max())


def toolbox_run(case: Extreme, times: np.ndarray, method: str = "event", accuracy: float = 1e-6) -> np.ndarray:
    return simulate(
        case.plant, case.duration, start=case.start, inputs=case.inputs, method=method, accuracy=accuracy, output_times=times
    ).states


def _numbers(case: Extreme) -> tuple[np.ndarray, np.ndarray]:
    """Start and inputs of a case as vectors, the second with defaults where nothing is given."""
    begin = simulate(case.plant, 0.0, start=case.start, inputs=case.inputs)
    u = np.array(case.plant.input_defaults(case.plant.values)).ravel()
    for i, name in enumerate(case.plant.inputs):
        u[i] = case.inputs.get(name, u[i])
    return begin.states[0], u


def scipy_events(case: Extreme, times: np.ndarray) -> np.ndarray:
    plant, p = case.plant, case.plant.values
    start, u = _numbers(case)
    bounds = plant.function("static_bounds", plant.switched_equations.static, "static")
    if any(e.rigid for e in plant.elements):
        raise NotImplementedError("no impacts")
    zero = [0] * len(plant.elements)
    project = plant.function("projected", plant.switched_equations.projected, "stopped")

    def stop(y: np.ndarray, i: int) -> None:
        modes = [1] * len(plant.elements)
        modes[i] = 0
        y[:] = np.array(project(0.0, y, u, p, modes)).ravel()

    machine = reference.Plant(
        rate=lambda t, y, modes: np.array(plant.rhs(t, y, u, p, modes)).ravel(),
        slip=lambda y: np.array(plant.slip_function(0.0, y, u, p, zero)).ravel().tolist(),
        hold=lambda t, y: np.array(plant.force_function(t, y, u, p, zero)).ravel().tolist(),
        static=np.array(bounds(0.0, start, u, p, zero)).ravel().tolist(),
        stop=stop, contacts=[e.name for e in plant.elements], size=np.maximum(np.abs(start), case.speed), max_step=case.duration / 50, start=start.tolist(),
    )  # fmt: skip
    return reference.simulate(machine, case.duration, 1e-8, times).states


def smeared(case: Extreme) -> tuple[ca.Function, np.ndarray]:
    """(t, x) -> x' with friction tanh(v / 1e-4 of the speed), and the start."""
    if any(e.rigid for e in case.plant.elements):
        raise NotImplementedError("no impacts")
    plant = smoothed(case.plant, 1e-4 * case.speed, match_static_peak=False)
    start, u = _numbers(case)
    field = ca.substitute(
        plant.switched_equations.field, ca.vertcat(plant.u, plant.p, plant.m), ca.vertcat(u, plant.values, np.ones(plant.m.numel()))
    )
    return ca.Function("rate", [plant.t, plant.x], [field]), start


def scipy_tanh(case: Extreme, times: np.ndarray) -> np.ndarray:
    from scipy.integrate import solve_ivp

    rate, start = smeared(case)
    t, x = rate.sx_in()
    slope = ca.Function("slope", [t, x], [ca.jacobian(rate(t, x), x)])
    done = solve_ivp(
        lambda t, y: np.array(rate(t, y)).ravel(), (0, case.duration), start, method="Radau", rtol=1e-8, atol=1e-8 * case.speed, t_eval=times,
        jac=lambda t, y: np.array(slope(t, y)),
    )  # fmt: skip
    if done.status:
        raise RuntimeError(done.message)
    return done.y.T


def casadi_tanh(case: Extreme, times: np.ndarray) -> np.ndarray:
    rate, start = smeared(case)
    t, x = rate.sx_in()
    options = {"reltol": 1e-8, "abstol": 1e-8 * case.speed, "max_num_steps": 10_000_000}
    solver = ca.integrator("solver", "cvodes", {"t": t, "x": x, "ode": rate(t, x)}, 0.0, times[1:], options)
    return np.vstack([start, np.array(solver(x0=start)["xf"]).T])


def heyoka_tanh(case: Extreme, times: np.ndarray) -> np.ndarray:
    import heyoka

    rate, start = smeared(case)
    names = heyoka.make_vars(*[f"x{i}" for i in range(len(start))])
    names = [names] if len(start) == 1 else list(names)
    taylor = heyoka.taylor_adaptive(
        list(zip(names, _heyoka(rate, names), strict=True)), list(start), tol=1e-8, compact_mode=len(start) > 10
    )
    outcome = taylor.propagate_grid(list(times))
    states = outcome[-1]
    if states.shape[0] < times.size:
        raise RuntimeError(str(outcome[0]))
    return states


def _heyoka(rate: ca.Function, x: list[Any]) -> list[Any]:
    """The right-hand sides of a casadi function as heyoka expressions."""
    import heyoka

    made: dict[int, Any] = {}
    out: dict[int, Any] = {}
    one = {ca.OP_NEG: lambda a: -a, ca.OP_SQ: lambda a: a * a, ca.OP_EXP: heyoka.exp, ca.OP_TANH: heyoka.tanh, ca.OP_SQRT: heyoka.sqrt,
           ca.OP_TWICE: lambda a: 2.0 * a, ca.OP_INV: lambda a: 1.0 / a, ca.OP_ASSIGN: lambda a: a}  # fmt: skip
    two = {ca.OP_ADD: lambda a, b: a + b, ca.OP_SUB: lambda a, b: a - b, ca.OP_MUL: lambda a, b: a * b, ca.OP_DIV: lambda a, b: a / b}
    for k in range(rate.n_instructions()):
        code, i, o = rate.instruction_id(k), rate.instruction_input(k), rate.instruction_output(k)
        if code == ca.OP_CONST:
            made[o[0]] = heyoka.expression(rate.instruction_constant(k))
        elif code == ca.OP_INPUT:
            made[o[0]] = x[i[1]] if i[0] == 1 else heyoka.time
        elif code == ca.OP_OUTPUT:
            out[o[1]] = made[i[0]]
        elif code in one:
            made[o[0]] = one[code](made[i[0]])
        elif code in two:
            made[o[0]] = two[code](made[i[0]], made[i[1]])
        else:
            raise NotImplementedError(f"casadi operation {code}")
    return [out.get(row, heyoka.expression(0.0)) for row in range(rate.size1_out(0))]


PROGRAMS: dict[str, Callable[[Extreme, np.ndarray], np.ndarray]] = {
    "event": toolbox_run,
    "time stepping": lambda case, times: toolbox_run(case, times, "time-stepping", 1e-3),
    "scipy, events": scipy_events,
    "scipy, tanh": scipy_tanh,
    "casadi, tanh": casadi_tanh,
    "heyoka, tanh": heyoka_tanh,
}


def attempt(title: str, program: str, answer: Any) -> None:
    """One cell, in a process of its own: sends ("begin",), then (error, seconds) or words."""
    warnings.simplefilter("ignore")
    case = EXTREMES[title]()
    times = np.linspace(0.0, case.duration, 401)
    try:
        begin = dataclasses.replace(case, duration=0.0)
        answer.send("ready")
        if program in ("event", "time stepping"):  # compiles what the run needs
            PROGRAMS[program](begin, np.array([0.0]))
            answer.send("ready")
        began = clock.perf_counter()
        states = PROGRAMS[program](case, times)
        spent = clock.perf_counter() - began
        if not np.isfinite(states).all():
            answer.send("not finite")
        else:
            answer.send((scaled(states, case.truth(times)), spent))
    except ModuleNotFoundError:
        answer.send("not installed")
    except NotImplementedError:
        answer.send("-")
    except Exception as error:  # whatever another program raises is its answer
        answer.send(f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"[:200])


def cell(title: str, program: str) -> Any:
    """(error, seconds), or the words of how it ended."""
    context = multiprocessing.get_context("spawn")
    receive, send = context.Pipe(duplex=False)
    process = context.Process(target=attempt, args=(title, program, send), daemon=True)
    process.start()
    send.close()
    found: Any = f"> {PATIENCE:g} s"
    deadline = clock.perf_counter() + 600.0
    try:
        while receive.poll(max(0.0, deadline - clock.perf_counter())):
            found = receive.recv()
            if found != "ready":
                break
            found, deadline = f"> {PATIENCE:g} s", clock.perf_counter() + PATIENCE
    except EOFError:
        found = "died"
    process.kill()
    process.join()
    return found


def shown(found: Any) -> str:
    """A cell as text: the error, marked where it is wrong."""
    if isinstance(found, tuple):
        error, seconds = found
        time = f"{1e3 * seconds:.2g} ms" if seconds < 1 else f"{seconds:.2g} s"
        return f"{error:.0e}, {time}" + ("" if error <= RIGHT else " WRONG")
    return found if len(found) < 24 else "stops"


def main(only: Sequence[str] | None = None, programs: Sequence[str] | None = None, out: str | None = None) -> None:
    """Print the table, as markdown."""
    warnings.simplefilter("ignore", UnusualValue)  # no machines, but numbers that a formula must survive
    chosen = [title for title in EXTREMES if not only or any(word in title for word in only)]
    names = list(programs or PROGRAMS)
    lines = ["| case | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    print("\n".join(lines), flush=True)
    for title in chosen:
        found = {name: cell(title, name) for name in names}
        lines.append(f"| {title} | " + " | ".join(shown(value) for value in found.values()) + " |")
        print(lines[-1], flush=True)
        for name, value in found.items():
            if isinstance(value, str) and len(value) >= 24:
                print(f"    {name}: {value}", file=sys.stderr)
    if out:
        with open(out, "w", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", metavar="WORD", help="cases whose title contains one of these")
    parser.add_argument("--programs", nargs="+", choices=list(PROGRAMS))
    parser.add_argument("--out", metavar="FILE.md")
    main(**vars(parser.parse_args()))
