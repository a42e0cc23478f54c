"""Is the accuracy asked kept on plants that nobody chose?

Random belts, drill strings with and without drives, and chains with dry friction at every inertia are run at accuracy 1e-6 with their error measured. Where
motion is chaotic or grazes, errors grow beyond the accuracy asked, and the error that a run reports has to say so. Two disks are left out: from high
speed the first cycles of their stick-slip are not computable (see `models.TwoDisks`).

    python -m studies random_plants [seed] [runs]
"""

from __future__ import annotations

import sys

import numpy as np

from controllers import PI, IdealSlidingMode, SoftTorque, StiffPI
from models import BitRock, BlockOnBelt, Coulomb, Exponential, Hyperbolic, TorsionalChain, wells
from toolbox import HybridSystem, compose, simulate
from toolbox.inputs import sine

ACCURACY = 1e-6


def belt(random: np.random.Generator) -> tuple[HybridSystem, float, dict]:
    """A block on a belt, under a sine half of the time."""
    laws = [
        Coulomb(static=random.uniform(0.3, 1.5), kinetic=0.25),
        Hyperbolic(static=random.uniform(0.3, 2.0), decay=10 ** random.uniform(-1, 2)),
        Exponential(static=random.uniform(0.5, 1.5), kinetic=0.4, decay=10 ** random.uniform(-1, 2)),
    ]
    plant = compose(
        BlockOnBelt(
            mass=10 ** random.uniform(-1, 1), stiffness=10 ** random.uniform(-1, 2), damping=float(random.choice([0.0, 0.1, 1.0])),
            belt_speed=float(random.choice([0.0, 0.05, 0.2, 1.0])), friction=laws[random.integers(3)],
        )
    )  # fmt: skip
    force = sine(random.uniform(-0.5, 0.5), random.uniform(0.0, 2.0), 10 ** random.uniform(-1, 0.7))
    return (
        plant,
        60.0,
        {"start": {"block.position": random.uniform(-2, 2)}, "inputs": {"block.force": force} if random.random() < 0.5 else None},
    )


def rig(random: np.random.Generator) -> tuple[HybridSystem, float, dict]:
    """A published drill string under a random weight, torque or drive."""
    well = [wells.JANSEN_2, wells.NAVARRO_LOPEZ_2, wells.NAVARRO_LOPEZ_4][random.integers(3)]
    plant = compose(well, BitRock(weight=random.uniform(2e4, 1.2e5)))
    law = [None, PI, StiffPI, SoftTorque, IdealSlidingMode][random.integers(5)]
    if law is None:
        return plant, 100.0, {"inputs": {"top.torque": random.uniform(3e3, 2e4)}}
    return plant, 100.0, {"controller": law(reference=random.uniform(1.0, 14.0))}


def chain(random: np.random.Generator) -> tuple[HybridSystem, float, dict]:
    """Three to eight inertias with dry friction at each, under a sine of torque."""
    n = int(random.integers(3, 9))
    plant = compose(
        TorsionalChain(
            inertia=tuple(random.uniform(50, 2000, n)), stiffness=tuple(random.uniform(300, 5000, n - 1)),
            damping=tuple(random.uniform(0, 200, n - 1)), top_drag=300.0,
            friction=Coulomb(static=1.0, kinetic=random.uniform(0.6, 1.0)), friction_load=tuple(random.uniform(50, 3000, n)),
        )
    )  # fmt: skip
    return plant, 40.0, {"inputs": {"top.torque": sine(random.uniform(0, 8e3), random.uniform(0, 8e3), random.uniform(0.05, 0.5))}}


def main(seed: int = 1, runs: int = 1000) -> None:
    """Print how the errors of every kind of plant compare with the accuracy asked."""
    random = np.random.default_rng(seed)
    print(f"{'plant':<8}{'runs':>7}{'median':>10}{'90 %':>10}{'largest':>10}   error / accuracy, and how many kept it within ten")
    for kind in (belt, rig, chain):
        ratios = []
        for _ in range(runs):
            plant, duration, arguments = kind(random)
            ratios.append(simulate(plant, duration, accuracy=ACCURACY, **arguments).error_estimate / ACCURACY)
        kept = np.mean(np.array(ratios) <= 10.0)
        print(
            f"{kind.__name__:<8}{runs:7d}{np.median(ratios):10.2g}{np.quantile(ratios, 0.9):10.2g}{max(ratios):10.2g}   {100 * kept:.1f} %"
        )


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:3]))
