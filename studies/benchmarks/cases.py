"""The benchmark cases in the language of the toolbox; `studies/benchmarks/reference.py` has the same cases without it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from controllers import PI
from models import BitRock, BlockOnBelt, Coulomb, TorsionalChain, TwoDisks, wells
from studies.benchmarks import reference
from toolbox import ClosedLoop, closed_loop, compose
from toolbox.inputs import sine

DRIVE = PI(proportional=4000.0, integral=1500.0, reference=8.0)
TEN = {
    "inertia": (2122.0, *(100.0,) * 8, 374.0),
    "stiffness": (473.0 * 9,) * 9,
    "damping": (23.2 * 9,) * 9,
    "top_drag": 425.0,
    "bit_drag": 50.0,
}


@dataclass(frozen=True)
class Case:
    """A loop with the length of its run, and the reference that integrates the same equations."""

    title: str
    loop: ClosedLoop
    duration: float
    reference: Callable[..., reference.Reference]


def cases() -> dict[str, Case]:
    """All cases by name."""
    rock = BitRock(weight=97_000.0)
    dry = TorsionalChain(**TEN, friction=Coulomb(static=1.0, kinetic=1.0), friction_load=(3000.0, *(300.0,) * 8, 6000.0))
    drive = {"top.torque": sine(8000.0, 8000.0, 0.8 / (2 * math.pi))}
    return {
        "belt": Case("block on belt", closed_loop(compose(BlockOnBelt())), 100.0, reference.belt),
        "rig": Case("JANSEN_2 with PI", closed_loop(compose(wells.JANSEN_2, rock, DRIVE)), 100.0, reference.rig),
        "disks": Case("two-disk stop", closed_loop(compose(TwoDisks()), start={"disks.rotor_speed": 2.0}), 3.0, reference.two_disks),
        "bit": Case(
            "ten inertias, bit",
            closed_loop(compose(TorsionalChain(**TEN), rock), inputs={"top.torque": 12_000.0}),
            60.0,
            reference.chain_bit,
        ),
        "all": Case("ten inertias, friction on all", closed_loop(compose(dry), inputs=drive), 60.0, reference.chain_all),
        "sampled": Case(
            "sampled PI at 100 Hz", closed_loop(compose(wells.JANSEN_2, rock), DRIVE, sample_time=0.01), 120.0, reference.sampled_rig
        ),
    }
