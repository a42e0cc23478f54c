"""How long does a sample of predictive control take, and how does it compare with do-mpc on the same problem?

Two inertias (JANSEN_2) with a bit 10 % heavier than the laws know, N = 40, period 0.1 s, 60 s of closed loop from the end of a stick phase of the stiff PI
drive at 4 rad/s. Linear: limits of torque, rate, speed and twist, of which some are active. Nonlinear: real-time iteration on exact modes, and on
friction regularised with matched peak (width 0.2 rad/s). do-mpc: the same regularised plant, cost and limits of torque, its defaults
otherwise (collocation, IPOPT), its own closed loop of 60 samples from the same state. Every law measures all states.

Times are those of the processor (`time.thread_time`), so that other work on the machine does not count; one run, one thread.

    python -m studies mpc_speed                        (pip install do-mpc for the comparison; it is left out where that is absent)
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import contextlib
import importlib.util
import io
import time
import warnings
from typing import Any

import casadi as ca
import numpy as np

from controllers import LinearMPC, NonlinearMPC, StiffPI
from controllers.quadratic_program import SOLVERS
from models import BitRock, wells
from toolbox import compose, simulate
from toolbox.modelling.regularisation import regularised

SPEED, WEIGHT = 4.0, 97_347.0
PLANT = compose(wells.JANSEN_2, BitRock(weight=WEIGHT))
HEAVIER = {"bit.weight": 1.1 * WEIGHT}
STATES = {"sensors": ("top.speed", "bit.speed", "chain.twist.0"), "sensor_noise": (1e-3, 1e-3, 1e-3)}
LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}


def stick_phase_end() -> dict[str, Any]:
    """The states at the end of a stick phase of the stiff PI drive."""
    run = simulate(PLANT, 100.0, controller=StiffPI(reference=SPEED), sample_time=0.01, inputs=HEAVIER)
    point = run.at([event.time for event in run.events if event.before == "stick"][-1])
    return {name: np.squeeze(point[name]) if size is None else np.ravel(point[name]) for name, (_, size, _) in PLANT.states.items()}


def timed(law: Any, start: dict[str, Any]) -> tuple[list[float], int, float]:
    """Seconds of every sample but the first of a closed loop of 60 s, fallbacks, and seconds of sticking after 30 s."""
    designed = law.design(PLANT)
    seconds: list[float] = []

    def watched(t: float, y: Any) -> float:
        began = time.thread_time()
        u = designed(t, y)
        seconds.append(time.thread_time() - began)
        return u

    watched.measured_signals, watched.actuated_signals = designed.measured_signals, designed.actuated_signals  # type: ignore[attr-defined]
    run = simulate(PLANT, 60.0, controller=watched, sample_time=0.1, start=start, inputs=HEAVIER)
    return seconds[1:], len(designed.record.fallbacks), run.time_in("bit", "stick", after=30.0)


def do_mpc_times(start: dict[str, Any], samples: int = 60) -> list[float]:
    """Seconds of every sample but the first of do-mpc on the same nonlinear problem."""
    warnings.simplefilter("ignore")
    import do_mpc

    law = NonlinearMPC(reference=SPEED, width=0.2, **LIMITS, **STATES)
    designed = law.design(PLANT)
    rock = PLANT.elements[0]
    twin_law = PLANT.parts[1].friction  # type: ignore[attr-defined]
    element = type("Contact", (), {"law": twin_law, "slip": rock.slip, "load": rock.load, "name": rock.name})()
    flow = ca.substitute(PLANT.flow, PLANT.F[0], regularised(0.2)(element))
    u_default = np.array(PLANT.input_defaults(PLANT.values)).ravel()
    place = list(PLANT.inputs).index("top.torque")
    symbol = ca.SX.sym("torque")
    inputs = ca.SX(u_default)
    inputs[place] = 20_000.0 * symbol
    right = ca.Function("right", [PLANT.x, symbol], [ca.substitute(ca.substitute(flow, PLANT.u, inputs), PLANT.p, ca.DM(PLANT.values))])

    model = do_mpc.model.Model("continuous", "SX")
    x = model.set_variable("_x", "x", shape=(3, 1))
    u = model.set_variable("_u", "u")
    model.set_rhs("x", right(x, u))
    model.setup()
    control = do_mpc.controller.MPC(model)
    control.settings.n_horizon, control.settings.t_step = 40, 0.1
    control.settings.store_full_solution = False
    control.settings.supress_ipopt_output()
    target = designed.target @ (SPEED, designed._rock_torque(SPEED))
    e = x - target[:3]
    stage = ca.sumsqr(designed.Q_rows @ e) / 2 + ((20_000.0 * u - target[3]) / law.torque_scale) ** 2 / 2
    end = ca.sumsqr(designed.P_rows[:, :3] @ e) / 2
    control.set_objective(mterm=end, lterm=stage)
    control.set_rterm(u=0.5 * (20_000.0 / law.torque_step_scale) ** 2)
    control.bounds["lower", "_u", "u"], control.bounds["upper", "_u", "u"] = 0.0, 1.0
    control.setup()
    simulator = do_mpc.simulator.Simulator(model)
    simulator.set_param(t_step=0.1)
    simulator.setup()
    state = np.concatenate([np.ravel(start[name]) for name in PLANT.states])[:, None]
    control.x0 = simulator.x0 = state
    control.set_initial_guess()
    seconds = []
    with contextlib.redirect_stdout(io.StringIO()):
        for _ in range(samples):
            began = time.thread_time()
            torque = control.make_step(state)
            seconds.append(time.thread_time() - began)
            state = simulator.make_step(torque)
    return seconds[1:]


def line(label: str, seconds: list[float], more: str = "") -> str:
    """A row of the table."""
    values = [1e3 * value for value in (np.median(seconds), np.percentile(seconds, 99), np.max(seconds))]
    return f"{label:<34}" + "".join(f"{value:>10.3f}" for value in values) + f"   {more}"


def main() -> None:
    """Print the table."""
    start = stick_phase_end()
    print(f"{'processor time per sample [ms]':<34}{'median':>10}{'p99':>10}{'longest':>10}   fallbacks, stuck after 30 s")
    limits = LIMITS | {"torque_rate": 40_000.0, "highest_speed": 8.0, "highest_twist": 32.0}
    for solver in SOLVERS[:-1]:  # qrqp fails on these programs, slowly
        seconds, fallbacks, stuck = timed(LinearMPC(reference=SPEED, solver=solver, **limits, **STATES), start)
        print(line(f"linear, {solver}", seconds, f"{fallbacks}, {stuck:.1f} s"), flush=True)
    ours: dict[str, list[float]] = {}
    for label, width in (("nonlinear, exact modes", None), ("nonlinear, matched peak", 0.2)):
        seconds, fallbacks, stuck = timed(NonlinearMPC(reference=SPEED, width=width, **LIMITS, **STATES), start)
        ours[label] = seconds
        print(line(label, seconds, f"{fallbacks}, {stuck:.1f} s"), flush=True)
    if importlib.util.find_spec("do_mpc") is None:
        print("do-mpc is not installed: no comparison (pip install do-mpc)")
        return
    theirs = do_mpc_times(start)
    print(line("do-mpc (IPOPT)", theirs))
    for label, seconds in ours.items():
        ratio, tail = np.median(theirs) / np.median(seconds), np.percentile(seconds, 99) / np.median(seconds)
        print(f"{label}: median {ratio:.0f} times faster than do-mpc; p99 is {tail:.1f} times the median")


if __name__ == "__main__":
    main()
