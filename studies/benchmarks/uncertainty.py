"""What does accuracy change in a posterior and in a map of chances, what does it cost, and what does a basin cost beside a plain sweep?

The posterior: static and kinetic friction and weight of two inertias under a stiff PI, from 40 s of torque at the surface in means of 1 s. The map: 11 set-
points with 100 draws of weight and static friction, runs of 277 s. The basin: the friction oscillator of bSTAB, 5000 starts as there, and a sweep of the
same starts over the same time, which reads what the basin is decided by; in turn, so that other work on the machine falls on both.

    python -m studies uncertainty [--repeats 5] [--runs 5000]
"""

from __future__ import annotations

from typing import Any

import numpy as np

from controllers import StiffPI
from models import BitRock, BlockOnBelt, Exponential, wells
from studies.command_line import parser_of
from studies.timing import timed
from toolbox import closed_loop, compose, sweep
from toolbox.measuring import metrics
from toolbox.probability import Normal, Uniform, basin, chance, posterior
from toolbox.probability.chances import quarters
from toolbox.sweeps.designs import uniform

ACCURACIES = (1e-2, 1e-3, 1e-4, 1e-6)
RIG = closed_loop(compose(wells.JANSEN_2, BitRock(weight=80e3)), StiffPI(reference=6.0))
PRIORS = {"bit.friction.static": Uniform(0.65, 1.1), "bit.friction.kinetic": Uniform(0.3, 0.6), "bit.weight": Uniform("50 kN", "110 kN")}
READ = {f"torque {k}": metrics.mean("top.torque", float(k), k + 1.0) for k in range(40)}
NOISE = 200.0
UNCERTAIN = {"bit.weight": "97 kN +- 8 kN", "bit.friction.static": Uniform(0.7, 0.9)}
OVER = {"top.reference": np.linspace(4.0, 14.0, 11).tolist()}
BELT = closed_loop(compose(BlockOnBelt(belt_speed=1.55, damping=0.1, friction=Exponential(static=1.0, kinetic=0.5, decay=2.0))))
BOX = {"block.position": (-2.0, 2.0), "block.speed": (0.0, 2.0)}


def posteriors() -> None:
    """Print the posterior at each accuracy."""
    truth = sweep(RIG, [{"bit.weight": 80e3}], 40.0, metrics=READ, accuracy=1e-9)
    noise = NOISE * np.random.default_rng(1).standard_normal(len(READ))
    data = {name: Normal(float(truth[name][0]) + each, NOISE) for (name, each) in zip(READ, noise, strict=True)}
    print("posterior    accuracy     runs      time   " + "".join(f"{name.rpartition('.')[2]:>22}" for name in PRIORS) + "   log evidence")
    posterior(RIG, data, PRIORS, 40.0, metrics=READ, draws=32)  # compiled once
    for accuracy in ACCURACIES:
        found, seconds = timed(lambda a=accuracy: posterior(RIG, data, PRIORS, 40.0, metrics=READ, accuracy=a))  # type: ignore[misc]
        told = "".join(f"{found[name].mean():>12.5g} +- {found[name].std():<6.2g}" for name in PRIORS)
        print(f"{'':12}{accuracy:9.0e}{found.runs:9d}{seconds:8.1f} s  {told}{found.evidence:10.2f} +- {found.error:.2f}", flush=True)


def maps() -> None:
    """Print the map at each accuracy."""
    best = chance(RIG, OVER, UNCERTAIN, draws=100, accuracy=1e-8)
    print("map          accuracy  verdicts that differ  largest change of a chance      time")
    for accuracy in ACCURACIES:
        found, seconds = timed(lambda a=accuracy: chance(RIG, OVER, UNCERTAIN, draws=100, accuracy=a))  # type: ignore[misc]
        other = int((found.outcomes["as it is"] != best.outcomes["as it is"]).sum())
        change = np.abs(found.chances["as it is"] - best.chances["as it is"]).max()
        print(f"{'':12}{accuracy:9.0e}{other:12d} of {best.outcomes['as it is'].size}{change:28.3f}{seconds:10.1f} s", flush=True)


def basins(repeats: int, runs: int) -> None:
    """Print the cost of basins beside that of a sweep of the same starts over the same time, which reads what a basin is decided by."""
    for belt_speed in (1.1, 1.175, 1.4, 1.55, 1.7):
        loop = BELT.at("block.belt_speed", belt_speed)
        first = basin(loop, BOX, runs)
        starts = uniform(BOX, runs)
        read = quarters("belt", "belt.slip", 0.0, first.duration)

        def plain(loop: Any = loop, starts: Any = starts, duration: float = first.duration, read: Any = read) -> Any:
            return sweep(loop, starts, duration, metrics=read, accuracy=1e-4)

        plain()
        ratios = []
        for _ in range(repeats):
            _, one = timed(plain)
            _, other = timed(lambda loop=loop: basin(loop, BOX, runs))  # type: ignore[misc]
            ratios.append(other / one)
        print(
            f"basin        belt at {belt_speed:5g} m/s: {other:.3f} s, sweep {one:.3f} s, median ratio {np.median(ratios):.2f}; {runs} runs, "
            f"{first.judged_runs} of them by the judge",
            flush=True,
        )


def main() -> None:
    """Print the tables."""
    parser = parser_of(__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--runs", type=int, default=5000)
    given = parser.parse_args()
    basins(given.repeats, given.runs)
    maps()
    posteriors()


if __name__ == "__main__":
    main()
