"""What does accuracy cost, here and elsewhere?

Two machines with stick-slip: the two inertias of Jansen and van den Steen with a PI at 8 rad/s over 100 s (33 switches), and the block on a belt over 100 s
(17). Every method of the toolbox with every setting, and programs that users would reach for, measured in the same run on the same machine:

    scipy             solve_ivp (DOP853) with its events, mode by mode (`studies/benchmarks/reference.py`); Python right-hand sides
    CVODE, events     SUNDIALS through scikit-sundae, Adams, mode by mode with its root finding; Python right-hand sides
    CVODE, smoothed   SUNDIALS through casadi.integrator, BDF, on the smoothed law; compiled expressions in casadi's virtual machine
    heyoka            Taylor series with events, compiled by LLVM

Error: largest difference of a state to the truth at 2001 times, in parts of the size of that state. The truth is computed by the explicit method, by the
stiff one and by scipy, which shares no code with either; the largest of their differences is stated, and bounds what is known. Times are the least of
several runs without output, without compilation and start-up.

    python -m studies tradeoff [--out FOLDER]        (a minute; the table, and work_precision.png; heyoka and scikit-sundae where installed)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import casadi as ca
import numpy as np

from studies.benchmarks import reference
from studies.benchmarks.cases import Case, cases
from studies.command_line import folder, parser_of
from studies.timing import timed
from toolbox import simulate, work_precision
from toolbox.modelling import smoothed
from toolbox.scenes import WorkPrecision
from toolbox.scenes.work_precision import Point
from toolbox.simulation.refinement import slips
from toolbox.simulation.request import Request

TOLERANCES = tuple(10.0**-k for k in range(3, 12))
SHARES = tuple(10.0**-k for k in range(1, 7))


def sundae(plant: reference.Plant, duration: float, rtol: float, output_times: np.ndarray | None = None) -> reference.Reference:
    """The motion of a plant with one contact by CVODE (Adams) with its root finding, started again after every switch."""
    from sksundae.cvode import CVODE

    mode = [0]

    def rate(t: float, y: np.ndarray, yp: np.ndarray) -> None:
        yp[:] = plant.rate(t, y, mode)

    def margin(t: float, y: np.ndarray, events: np.ndarray) -> None:
        s = mode[0]
        events[0] = s * plant.slip(y)[0] if s else plant.static[0] - abs(plant.hold(t, y)[0])

    margin.terminal, margin.direction = [True], [-1]  # type: ignore[attr-defined]

    def at_rest(t: float, y: np.ndarray, may_stick: bool = True) -> int:
        force = plant.hold(t, y)[0]
        return 0 if may_stick and abs(force) <= plant.static[0] else (-1 if force > 0 else 1)

    solver = CVODE(
        rate,
        method="Adams",
        rtol=rtol,
        atol=rtol * plant.size,
        eventsfn=margin,
        num_events=1,
        max_num_steps=100_000,
        max_step=plant.max_step,
    )
    wanted = np.array([duration]) if output_times is None else np.asarray(output_times, float)
    rows = np.empty((wanted.size, len(plant.start)))
    switches: list[reference.Switch] = []
    began = perf_counter()
    t, y = 0.0, np.array(plant.start, float)
    mode[0] = int(np.sign(plant.slip(y)[0])) or at_rest(t, y)
    filled = 0
    while t < duration:
        ahead = wanted[(wanted > t + 1e-12) & (wanted < duration)]
        span = np.concatenate([[t], ahead, [duration]])
        run = solver.solve(span, y)
        times, states = np.asarray(run.t), np.asarray(run.y)
        while filled < wanted.size and wanted[filled] <= times[-1]:
            rows[filled] = states[min(int(np.searchsorted(times, wanted[filled])), times.size - 1)]
            filled += 1
        t, y = float(times[-1]), states[-1].copy()
        if t >= duration:
            break
        before = mode[0]
        plant.stop(y, 0)
        mode[0] = at_rest(t, y, before != 0)
        switches.append(reference.Switch(t, plant.contacts[0], reference.MODES[before], reference.MODES[mode[0]]))
        if before == 0 and mode[0]:  # deaf, as in `reference`: a step by hand away from the root
            nudge = 1e-9
            y = y + nudge * np.array(plant.rate(t, y, mode))
            t += nudge
    return reference.Reference(wanted, rows, tuple(switches), perf_counter() - began)


def cvodes(case: Case, share: float, tolerance: float) -> Callable[[np.ndarray], tuple[np.ndarray, float]]:
    """Times -> (states, seconds) by casadi.integrator on the smoothed law."""
    run = Request(case.loop, case.duration).checked()
    plant = smoothed(run.system, {name: share * size for name, size in slips(run).items()})
    form = plant.to_casadi()
    problem = {"t": form["t"], "x": form["x"], "p": ca.vertcat(form["p"], form["u"]), "ode": form["ode"]}
    numbers = np.concatenate([plant.values, np.zeros(plant.m.numel()), np.array(plant.input_defaults(plant.values)).ravel()])
    options = {"reltol": tolerance, "abstol": tolerance * 1e-3, "max_num_steps": 10_000_000}
    zero = np.zeros(plant.x.numel())

    def solve(times: np.ndarray) -> tuple[np.ndarray, float]:
        solver = ca.integrator("solver", "cvodes", problem, 0.0, times, options)
        found, seconds = timed(lambda: solver(x0=zero, p=numbers)["xf"], clock=perf_counter)
        return np.array(found).T, seconds

    return solve


def measured(name: str, case: Case) -> WorkPrecision:
    """The trade of one case with its peers."""
    grid = np.linspace(0.0, case.duration, 2001)
    signals = tuple(case.loop.system.states)
    trade = work_precision(case.loop, case.duration, signals=signals)
    truth = simulate(case.loop, case.duration, accuracy=1e-12, method="explicit").at(grid)
    rows = [truth.program.system.state_index(signal)[:2] for signal in signals]

    def error(states: np.ndarray) -> float:
        worst = 0.0
        for first, size in rows:
            columns = slice(first, first + (size or 1))
            worst = max(worst, np.abs(states[:, columns] - truth.states[:, columns]).max() / np.abs(truth.states[:, columns]).max())
        return worst

    independent = case.reference(case.duration, rtol=1e-12, output_times=grid)
    disagreement = max(trade.reference_error, error(independent.states))
    points = list(trade.points)

    def peer(method: str, varied: str, setting: float, made: Callable[[], tuple[np.ndarray, Callable[[], float]]], repeats: int) -> None:
        try:
            states, seconds = made()
            points.append(Point(method, "", varied, setting, error(states), min(seconds() for _ in range(repeats)), 0))
        except Exception as failed:  # whatever a peer raises is its result
            points.append(Point(method, "", varied, setting, math.nan, math.nan, 0, f"{type(failed).__name__}: {failed}"))

    for rtol in TOLERANCES:
        peer("scipy, events", "rtol", rtol, lambda rtol=rtol: (
            case.reference(case.duration, rtol=rtol, output_times=grid).states, lambda: case.reference(case.duration, rtol=rtol).wall_time), 2)  # fmt: skip
    if installed("sksundae"):
        for rtol in TOLERANCES:
            peer("CVODE, events", "rtol", rtol, lambda rtol=rtol: (
                case.reference(case.duration, rtol=rtol, output_times=grid, integrate=sundae).states,
                lambda: case.reference(case.duration, rtol=rtol, integrate=sundae).wall_time), 2)  # fmt: skip
    for share in SHARES:
        solve = cvodes(case, share, min(1e-3, 0.03 * share))
        peer("CVODE, smoothed", "width", share, lambda solve=solve: (solve(grid)[0], lambda: solve(grid[-1:])[1]), 2)
    if installed("heyoka"):
        make = {"belt": reference.heyoka_belt, "rig": reference.heyoka_rig}[name]
        for tolerance in TOLERANCES:
            run = make(tolerance)
            peer("heyoka", "tol", tolerance, lambda run=run: (
                run(case.duration, grid).states, lambda: run(case.duration).wall_time), 20)  # fmt: skip
    return replace(
        trade, title=case.title, points=tuple(points), reference_error=disagreement, references=("explicit, stiff", "scipy, each at 1e-12,")
    )


def installed(package: str) -> bool:
    """Whether a peer can be imported."""
    from importlib.util import find_spec

    return find_spec(package) is not None


def picture(trades: Sequence[WorkPrecision], path: Path) -> None:
    """One panel per case."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    from toolbox.figures.style import PAPER

    with pyplot.rc_context(PAPER):
        figure, axes = pyplot.subplots(1, len(trades), figsize=(10.5, 4.6), sharey=True, layout="constrained")
        for ax, trade in zip(axes, trades, strict=True):
            trade.plot(ax=ax)
            ax.set_title(f"{trade.title}, {trade.duration:g} s", loc="left", fontsize=9.0)
            ax.get_legend().remove()
        axes[1].set_ylabel("")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower center", ncols=-(-len(labels) // 2), frameon=False, columnspacing=1.2, handlelength=2.4
        )
        figure.savefig(path, dpi=110)
        pyplot.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables, and with --out make the picture."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=folder, help="folder for work_precision.png")
    given = parser.parse_args(arguments)
    chosen = cases()
    trades = [measured(name, chosen[name]) for name in ("rig", "belt")]
    print("\n\n".join(map(str, trades)))
    for trade in trades:
        print(f"\n{trade.title}: the least time for an error of")
        for error in (1e-2, 1e-4, 1e-6, 1e-8):
            best = {}
            for point in trade.points:
                if not point.failed and point.error <= error and point.seconds < best.get(point.method, math.inf):
                    best[point.method] = point.seconds
            print(
                f"  {error:.0e}: "
                + ", ".join(f"{method} {1e3 * seconds:.3g} ms" for method, seconds in sorted(best.items(), key=lambda one: one[1]))
            )
    if given.out:
        picture(trades, given.out / "work_precision.png")
        print(f"\nThe picture is in {given.out}")


if __name__ == "__main__":
    main()
