"""How does a sampled sliding mode chatter, and which discretisation does not?

The two inertias of Jansen and van den Steen at 8 rad/s, started near their drilling point, under a weight on bit that sways by 5 kN at 0.3 Hz; the law has the
drag of the drive wrong by a fifth, so that it has something to hold against. Three laws share the surface s and a reaching rate eta of 2 rad/s2:

    explicit        u = u_eq - J eta sgn(s_k)                             s changes by eta h per sample and a little more, u jumps by 2 J eta, for ever
    implicit        u = u_eq - J eta sgn(s_(k+1)), set-valued             reaches s = 0; what is left is what one sample of the model lacks, O(h^2)
    super-twisting  u = u_eq - J (1.5 (L |s|)^(1/2) sgn(s) - v), ...      continuous torque, |s| = O(h^2), L = 1 rad/s3

Over the last 5 s of 40 s: largest change of s and of the torque from one sample to the next.

Commands that come some samples late make the implicit sign chatter as well: it takes back what is already on its way. A law that knows how many are on their
way (field `late`) acts on the speed at which its command will arrive, and varies its torque as it does without delay. A set-point that rises belongs to the
equivalent control; without its rate what is left of s is of first order in the period.

    python -m studies chatter [--out FOLDER]        (seconds; the table, and chatter.png)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from controllers import ImplicitSlidingMode, SlidingMode, SuperTwisting
from controllers.sliding_mode import SlidingSurface
from models import BitRock, wells
from studies.command_line import folder, parser_of
from toolbox import Sampled, compose, simulate
from toolbox.inputs import sine

REACHING, INERTIA, DRAG = 2.0, 2122.0, 340.0
LATE = (0, 1, 2, 3)
PERIODS = (0.08, 0.04, 0.02, 0.01, 0.005)
PLANT = compose(wells.JANSEN_2, BitRock())


def laws() -> dict[str, SlidingSurface]:
    """The laws by name; a boundary layer of 1e-9 rad/s is a sign."""
    shared = {"reference": 8.0, "reaching_rate": REACHING, "inertia": INERTIA, "drag": DRAG}
    return {
        "explicit": SlidingMode(boundary_layer=1e-9, **shared),
        "implicit": ImplicitSlidingMode(**shared),
        "super-twisting": SuperTwisting(disturbance_rate=1.0, **shared),
    }


def held(law: SlidingSurface, period: float, late: int = 0, rising: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], s [rad/s] and torque [N m] of the samples of the last 5 s; commands `late` samples late, the set-point rising by so much [rad/s2]."""
    run = simulate(
        PLANT, 40.0, controller=Sampled(law, period, delay=late * period), start={"chain.speed": (8.0, 8.0), "chain.twist": 17.0},
        inputs={"bit.weight": sine(97_347.0, 5000.0, 0.3), "top.reference": ((0.0, 40.0), (8.0, 8.0 + 40.0 * rising))},
    )  # fmt: skip
    times = np.arange(35.0, 40.0 - period, period)
    point = run.at(times + period / 2)
    return times, point[f"{type(law).__name__.lower()}.surface"], point["top.torque"]


def changes() -> dict[str, np.ndarray]:
    """{law: rows (largest change of s [rad/s], of the torque [N m]) for every period}."""
    found = {}
    for name, law in laws().items():
        rows = [held(law, period)[1:] for period in PERIODS]
        found[name] = np.array([[np.abs(np.diff(values)).max() for values in row] for row in rows])
    return found


def late_torques() -> dict[str, np.ndarray]:
    """{law: rows for commands `LATE` samples of 10 ms late: change of the torque [N m/s] of a law that does not know it, and of one that does}."""
    found = {}
    for name, law in laws().items():
        pairs = [
            [np.abs(np.diff(held(replace(law, delay_samples=known), 0.01, late)[2])).sum() / 5.0 for known in (0, late)] for late in LATE
        ]
        found[name] = np.array(pairs)
    return found


def late_table(found: dict[str, np.ndarray]) -> str:
    """The changes of the torque under late commands as text."""
    lines = [
        f"{'torque, kN m/s':<18}" + "".join(f"{name:>28}" for name in found),
        f"{'samples late':<18}" + f"{'not known':>18}{'known':>10}" * len(found),
    ]
    for i, late in enumerate(LATE):
        lines.append(f"{late:>6}{'':<12}" + "".join(f"{rows[i, 0] / 1e3:>18.2f}{rows[i, 1] / 1e3:>10.2f}" for rows in found.values()))
    return "\n".join(lines)


def table(found: dict[str, np.ndarray]) -> str:
    """The changes as text."""
    lines = [
        f"{'change per sample':<18}" + "".join(f"{name:>28}" for name in found),
        f"{'period':<18}" + f"{'s [rad/s]':>16}{'torque':>12}" * len(found),
    ]
    for i, period in enumerate(PERIODS):
        cells = "".join(f"{rows[i, 0]:>16.2e}{rows[i, 1]:>8.0f} N m" for rows in found.values())
        lines.append(f"{1000 * period:>6.0f} ms{'':<9}" + cells)
    return "\n".join(lines)


def picture(found: dict[str, np.ndarray], path: Path) -> None:
    """Change of s against the period, and the torque at 20 ms."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    from toolbox import plot

    with pyplot.rc_context(plot.PAPER):
        pyplot.close(_drawn(found, path))


def _drawn(found: dict[str, np.ndarray], path: Path) -> Any:
    """Draw it and return the figure."""
    from matplotlib import pyplot

    from toolbox import plot

    figure, (orders, torques) = pyplot.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    marks = dict(zip(("explicit", "implicit", "super-twisting"), "os^", strict=True))
    styles = dict(zip(marks, ({"color": "0.65", "linewidth": 1.3}, *plot.LINES[:2]), strict=True))
    for name, rows in found.items():
        orders.loglog(1000 * np.array(PERIODS), rows[:, 0], marker=marks[name], markersize=4, label=name, **styles[name])
    guide = np.array(PERIODS[:: len(PERIODS) - 1])
    orders.loglog(1000 * guide, REACHING * guide, ":", color="0.4", lw=0.9)
    orders.text(1000 * guide[1] * 1.1, REACHING * guide[1] * 0.5, r"$\eta h$", fontsize=8, color="0.3")
    orders.set(xlabel="sample time h [ms]", ylabel="largest change of s per sample [rad/s]")
    orders.set_xticks([1000 * period for period in PERIODS], [f"{1000 * period:g}" for period in PERIODS])
    orders.minorticks_off()
    orders.legend(frameon=False, loc="lower right")
    for name, law in laws().items():
        times, _, torque = held(law, 0.02)
        thin = {"linewidth": 0.8} if name == "explicit" else {"linewidth": 3.0} if name == "implicit" else {}  # two lie upon each other
        torques.step(times, torque / 1000, where="post", label=name, **styles[name] | thin)
    torques.set(xlabel="time [s]", ylabel="top torque [kN m]", xlim=(36.0, 38.0), ylim=(None, 18.0))
    torques.set_title("sample time 20 ms", loc="left", fontsize=9.0)
    torques.legend(frameon=False, ncols=3, loc="upper left")
    figure.savefig(path, dpi=150)
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and with --out make the picture."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=folder, help="folder for chatter.png")
    given = parser.parse_args(arguments)
    found = changes()
    print(table(found))
    print(f"\n{late_table(late_torques())}")
    if given.out:
        picture(found, given.out / "chatter.png")
        print(f"\nThe picture is in {given.out}")


if __name__ == "__main__":
    main()
