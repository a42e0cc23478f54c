"""What does it cost to keep a run, beside making it?

A well of 49 inertias with friction at the bit and at 12 of them, under a PI, for 20 s and 120 s: the least processor time of three calls of `simulate`, `save`,
`load`, `to_csv` and `str`, and the length of the file beside that of the arrays in it.

    python -m studies keeping
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from controllers import PI
from models import BitRock, TorsionalChain
from models.friction import Exponential
from studies.timing import timed
from toolbox import HybridSystem, Trajectory, compose, simulate


def well() -> HybridSystem:
    """The string of Jansen and van den Steen (1995) with pipe three times as heavy, as 49 inertias, every fourth of which lies on the wall."""
    inertia = np.full(49, 3 * 374.0 / 49)
    inertia[0] += 2122.0
    inertia[-1] += 374.0
    chain = TorsionalChain(
        inertia=tuple(inertia), stiffness=(473.0 * 48,) * 48, damping=(23.2 * 48,) * 48, top_drag=425.0, bit_drag=50.0,
        friction=Exponential(static=1.0, kinetic=0.65, decay=1.0), friction_load=(400.0,) * 12, friction_at=tuple(range(2, 48, 4)),
    )  # fmt: skip
    return compose(chain, BitRock(weight=97_347.0), PI(proportional=900.0, integral=400.0, reference=8.0))


def main() -> None:
    """Print the table."""
    plant = well()
    print(f"{'duration':>9}{'simulate':>10}{'save':>8}{'load':>8}{'to_csv':>8}{'str':>8}{'file':>10}{'/ arrays':>10}")
    for duration in (20.0, 120.0):
        run = simulate(plant, duration)
        with tempfile.TemporaryDirectory() as folder:
            path = run.save(Path(folder) / "run.npz")
            calls: list[Callable[[], object]] = [
                lambda d=duration: simulate(plant, d),
                lambda r=run, p=path: r.save(p),
                lambda p=path: Trajectory.load(p),
                lambda r=run, p=path: r.to_csv(p.with_suffix(".csv")),
                lambda r=run: str(r),
            ]
            times = [timed(call, 3)[1] for call in calls]
            with np.load(path) as arrays:
                held = sum(arrays[name].nbytes for name in arrays.files)
            size = path.stat().st_size
        row = f"{times[0]:8.3f} s{times[1]:6.2f} s" + "".join(f"{each:6.2f} s" for each in times[2:])
        print(f"{duration:7.0f} s{row}{size / 1e6:7.1f} MB{size / held:10.3f}", flush=True)


if __name__ == "__main__":
    main()
