"""What does the stiff method cost on long damped chains, against the explicit one?

A string of pipe cut into N elements has stiffness k N, damping c N and inertia J / N per element: the fastest mode dies at the rate
4 c N^2 / J, and an explicit method has to follow it. Four cases of 60 s from rest, with dry friction at the bit only or at every element;
every method at its fastest setting whose error stays below the target and that finds the same switches. The error is the largest difference of a
state to the explicit method at 1e-10, over 401 times, relative to the size of that state. Times are the shorter processor time of two whole
calls of `simulate`, with caches warm; "event" is the default, with what it chose. Then cost per step and time to compile against N.

    python -m studies stiff
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from models import BitRock, TorsionalChain
from models.friction import Exponential
from studies.benchmarks.speed import scaled_error
from studies.timing import timed
from toolbox import HybridSystem, Trajectory, compose, simulate

SETTINGS = {
    "explicit": (1e-2, 1e-3, 1e-6),
    "stiff": (3e-2, 1e-2, 3e-3, 1e-4, 3e-5, 1e-5),
    "event": (1e-2, 3e-5, 1e-5),
}
TARGETS = (1e-3, 1e-6)


def uniform(n: int, everywhere: bool = False) -> HybridSystem:
    """The string of Jansen and van den Steen (1995) as a chain of n equal elements between its table and its collars: k 473 N m/rad, c 23.2 N m s/rad,
    and 374 kg m2 of pipe as much as of collars; with friction everywhere 20 N m per 12.5 m."""
    inertia = np.full(n, 374.0 / n)
    inertia[0] += 2122.0
    inertia[-1] += 374.0
    return _plant(inertia, 473.0 * n, 23.2 * n, np.full(n - 1, 4000.0 / n) if everywhere else None)


def deviated(n: int, everywhere: bool = False) -> HybridSystem:
    """The 2500 m of pipe of Aarsnes and Shor (J. Sound Vib. 2018) as n elements: G J / L, rho J L and mu sin(inclination) rho g A r per metre, inclined from
    1500 m to 60 deg at 2100 m; damping proportional to stiffness, 0.02 s, and collars of 400 kg m2 are assumed."""
    shear, density, length, outer, inner = 61e9, 7850.0, 2500.0, 0.146529, 0.123024
    polar = np.pi / 32 * (outer**4 - inner**4)
    inertia = np.full(n, density * polar * length / n)
    inertia[0] += 2900.0
    inertia[-1] += 400.0
    stiffness = shear * polar / length * n
    depth = (np.arange(n - 1) + 0.5) * length / n
    inclination = np.radians(60) * np.clip((depth - 1500) / 600, 0.02, 1)
    weight = density * 9.81 * np.pi / 4 * (outer**2 - inner**2)
    return _plant(inertia, stiffness, 0.02 * stiffness, 0.3 * np.sin(inclination) * weight * outer / 2 * length / n if everywhere else None)


def _plant(inertia: np.ndarray, stiffness: float, damping: float, load: np.ndarray | None) -> HybridSystem:
    n = inertia.size
    friction = {} if load is None else {"friction": Exponential(static=1.0, kinetic=0.65, decay=1.0), "friction_load": tuple(load)}
    chain = TorsionalChain(
        inertia=tuple(inertia), stiffness=(stiffness,) * (n - 1), damping=(damping,) * (n - 1), top_drag=425.0, bit_drag=50.0, **friction
    )
    return compose(chain, BitRock(weight=97_347.0 if load is None else 60_000.0))


@dataclass(frozen=True)
class Case:
    """A plant and what drives it."""

    title: str
    plant: HybridSystem
    duration: float = 60.0

    def run(self, method: str, accuracy: float) -> Trajectory:
        return simulate(self.plant, self.duration, inputs={"top.torque": 10_000.0}, method=method, accuracy=accuracy)


def cases(n: int = 200) -> Iterator[Case]:
    """The four cases of the table."""
    for title, plant in (("uniform", uniform), ("deviated", deviated)):
        yield Case(f"{title}, friction at the bit", plant(n))
        yield Case(f"{title}, friction everywhere", plant(n, everywhere=True))


def table(case: Case) -> None:
    """Print time and error of every method at the targets 1e-3 and 1e-6."""
    grid = np.linspace(0.0, case.duration, 401)
    truth = case.run("explicit", 1e-10)
    states, switches = truth.at(grid).states, [(e.element, e.after) for e in truth.events]
    print(f"\n{case.title}: {len(switches)} switches")
    best: dict[tuple[str, float], tuple[float, float, float, str]] = {}
    for method, settings in SETTINGS.items():
        for accuracy in settings:
            run = case.run(method, accuracy)
            error = scaled_error(run.at(grid).states, states)
            if error > TARGETS[0] or [(e.element, e.after) for e in run.events] != switches:
                continue
            _, cost = timed(lambda a=accuracy, m=method: case.run(m, a), 2)
            for target in TARGETS:
                if error <= target and cost < best.get((method, target), (np.inf,))[0]:
                    best[method, target] = cost, error, accuracy, run.run.method.text
    for target in TARGETS:
        for method in SETTINGS:
            if (method, target) in best:
                cost, error, accuracy, chosen = best[method, target]
                ratio = best["explicit", target][0] / cost
                print(
                    f"  error <= {target:<6g} {method:<9}{chosen:<9}{cost:8.3f} s   error {error:.1e} asked {accuracy:<6g} ratio {ratio:6.1f}",
                    flush=True,
                )


def growth() -> None:
    """Print cost per step and time to compile against the number of elements."""
    print(f"\n{'N':>6}{'method':>10}{'friction':>12}{'compile [s]':>13}{'step [us]':>11}")
    for n in (10, 50, 200, 1000):
        for everywhere in (False, True):
            plant = deviated(n, everywhere)
            for method in ("explicit", "stiff"):
                with tempfile.TemporaryDirectory() as empty:
                    os.environ["STICKSLIP_CACHE_DIR"] = empty
                    _, compiling = timed(lambda p=plant, m=method: simulate(p, 0.0, method=m))
                    del os.environ["STICKSLIP_CACHE_DIR"]
                arguments = {"inputs": {"top.torque": 10_000.0}, "method": method, "accuracy": 1e-3, "output_times": [0.5]}
                run = simulate(plant, 0.5, **arguments)
                each = timed(lambda p=plant, a=arguments: simulate(p, 0.5, **a), 3)[1] / (sum(run.steps) + 5 * len(run.events))
                print(f"{n:>6}{method:>10}{'everywhere' if everywhere else 'bit':>12}{compiling:>13.2f}{1e6 * each:>11.1f}", flush=True)


def main() -> None:
    """Print both tables."""
    for case in cases():
        table(case)
    growth()


if __name__ == "__main__":
    main()
