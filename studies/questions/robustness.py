"""How much gain, phase and delay does each drive law bear, and how much could any law?

Plant: the two inertias of Jansen and van den Steen with the bit of Navarro-Lopez and Cortes at 97 347 N. Every law measures the top speed alone, is sampled
every 10 ms, and its torque comes 30 ms late. At each set-point the loop is linearised where it runs steadily, with its sampling and delay, and broken at
the torque.

disk margin: the size of the disk of factors of the torque, complex and free to change with frequency, that leave the loop stable; 0.5 is a gain of 0.6 to
1.67 or 28 degrees; 0 is a loop that is not stable.
limit: the largest that any linear law can have, by Nevanlinna-Pick interpolation. Below 4.2 rad/s steady drilling is unstable by itself, and below 4.5 rad/s
the top speed has zeros beside these poles: the top hardly shows what must be stopped. A law that sees the bit speed, too, has another limit.
absorber: the set-point down to which the best spring, damper and inertia at the top keep drilling smooth, without delay.

worst: the smallest over one error of the rig at a time: inertia of the drive 10 and 20 % off, inertia of the bit, stiffness and weight 20 % off, 60 ms late.
Laws with "tuned" in their label have the gains of the drive study.

What comes out: where drilling is stable by itself, plain PI laws bear most, which says nothing about whether they end a stick-slip that exists; those
that reach low set-points, LQG, Z-torque and H-infinity, bear 6 to 46 percent more gain at 6.5 rad/s and less at low ones, far below what is to be had. Tuned
on rigs that are not the declared one, LQG keeps 0.23 at 4 rad/s and 0.05 on the worst of them, impedance 0.49 and 0.33. On a
filter and 30 ms late the sliding modes have no smooth running at all: the motor swings for ever, by 5 kN m.

Laws without a linear loop (super-twisting has no slope at its surface) have '-', and the gain and delay at which the machine itself fails.

    python -m studies robustness [--out FOLDER] [--quick]        (four minutes; the tables, robustness.csv and robustness.png)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from controllers import LQG, PI, ActiveDamping, HInfinity, ImplicitSlidingMode, SlidingMode, SoftTorque, StiffPI, SuperTwisting, ZTorque
from controllers.observers import Kalman
from studies import gains
from studies.command_line import folder, parser_of
from studies.protocol import DELAY, PLANT, SINGLES, trial
from toolbox import Sampled, closed_loop, margins, plot, use_units
from toolbox.figures.style import name_axis
from toolbox.files import tables
from toolbox.files.printing import shown
from toolbox.modelling import ObserverBasedController
from toolbox.robustness import Margins, absorber_limit, performance_limit
from toolbox.robustness.starts import at_set_point

PERIOD = 0.01
LATE = round(DELAY / PERIOD)
SPEEDS = (3.0, 3.5, 4.0, 5.0, 6.5, 8.0)
TUNED = ("impedance", "Z-torque", "H-infinity", "LQG", "impedance, lifting", "Z-torque, lifting", "LQG, lifting")
"""Families with a slope whose stored gains are shown."""
WORKING = 6.5
"""Set-point at which all margins are shown [rad/s]."""


def on_estimates(law: Callable[..., Any]) -> Any:
    """A law that asks for more than the top speed, on a Kalman filter."""
    return ObserverBasedController(law(), Kalman(speed_noise=0.01), delay_samples=LATE)


LAWS: dict[str, Any] = {
    "stiff PI": StiffPI(),
    "PI": PI(),
    "active damping": ActiveDamping(),
    "soft torque": SoftTorque(),
    "Z-torque": ZTorque(filter_time=0.02),
    "H-infinity": HInfinity(),
    "LQG": LQG(delay_samples=LATE, speed_noise=0.01),
    **{gains.label_of(family): gains.tuned(family) for family in TUNED},
    "sliding mode, filter": on_estimates(SlidingMode),
    "implicit sliding mode, filter": on_estimates(ImplicitSlidingMode),
    "super-twisting, filter": on_estimates(SuperTwisting),
}


def found_at(label: str, speed: float, **arguments: Any) -> Margins:
    """The margins of a law at a set-point [rad/s]; arguments as of `margins`."""
    return margins(closed_loop(PLANT, Sampled(at_set_point(LAWS[label], speed), PERIOD, DELAY)), **arguments)


def worst_at(label: str, speed: float) -> tuple[float, str]:
    """The smallest disk margin of a law at a set-point [rad/s] over one error of the rig at a time, and which: the robust rigs of `studies.protocol`."""
    return trial(label, LAWS[label], PERIOD).disk_margins(SINGLES, speed)[1:]


def worst_table(speeds: Sequence[float] = SPEEDS) -> str:
    """The smallest disk margins of the tuned laws as text, each with the error that sets it at 6.5 rad/s."""
    lines = [f"{'worst of one error at a time':<32}" + "".join(f"{speed:>8g}" for speed in speeds) + f"   set at {WORKING:g} by"]
    lines.append("-" * len(lines[0]))
    for family in TUNED:
        label = gains.label_of(family)
        found = {speed: worst_at(label, speed) for speed in (*speeds, WORKING)}
        lines.append(f"{label:<32}" + "".join(f"{shown(found[speed][0]):>8}" for speed in speeds) + f"   {found[WORKING][1]}")
    return "\n".join(lines)


def limit_at(speed: float, measured_signals: Any = "top.speed") -> float:
    """The largest disk margin that any linear law on these measurements can have."""
    return performance_limit(PLANT, {"top.speed": speed}, measured_signals=measured_signals, period=PERIOD, delay=DELAY).disk_margin


def disk_table(speeds: Sequence[float] = SPEEDS) -> dict[str, list[float]]:
    """{law: disk margins over the set-points}, then the limits."""
    found = {label: [found_at(label, speed, by_simulation=False).disk_margin for speed in speeds] for label in LAWS}
    found["limit, top speed"] = [limit_at(speed) for speed in speeds]
    found["limit, top and bit speed"] = [limit_at(speed, ("top.speed", "bit.speed")) for speed in speeds]
    return found


def table(found: dict[str, list[float]], speeds: Sequence[float] = SPEEDS) -> str:
    """The disk margins as text; 0 is an unstable loop."""
    lines = [f"{'disk margin at [rad/s]':<32}" + "".join(f"{speed:>8g}" for speed in speeds)]
    lines.append("-" * len(lines[0]))
    for label, row in found.items():
        lines += ["-" * len(lines[0])] if label == "limit, top speed" else []
        lines.append(f"{label:<32}" + "".join(f"{shown(value):>8}" for value in row))
    return "\n".join(lines)


def working_table(speed: float = WORKING) -> str:
    """All margins of every law at one set-point, as text, those measured for a law without a linear loop."""
    head = f"{f'at {speed:g} rad/s':<32}{'disk':>8}{'M_s':>8}{'gain':>16}{'phase':>10}{'delay':>10}"
    lines = [head, "-" * len(head)]
    for label in LAWS:
        found = found_at(label, speed)
        row = found.loop_margins[0] if found.simulated_margins is None else found.simulated_margins
        delay = row.delay_margin if found.simulated_margins is None else row.delay
        phase = math.degrees(found.loop_margins[0].phase_margin)
        gain = f"{shown(row.lowest_gain)} .. {shown(row.highest_gain)}"
        cells = [shown(found.disk_margin), shown(found.peak_sensitivity), gain, shown(phase, unit=" deg"), shown(1e3 * delay, unit=" ms")]
        lines.append(
            f"{label:<32}{cells[0]:>8}{cells[1]:>8}{cells[2]:>16}{cells[3]:>10}{cells[4]:>10}"
            + (" measured" if found.simulated_margins else "")
        )
    return "\n".join(lines)


def absorbers() -> tuple[float, float]:
    """Set-points [rad/s] down to which an ideal absorber reaches: one of any inertia, and one on the inertia of the drive."""
    free, own = (absorber_limit(PLANT, (1.0, 8.0), keep_inertia=own).speed for own in (False, True))
    return free, own


def picture(path: Path, absorbing: tuple[float, float], points: int = 25) -> None:
    """Disk margins over the set-point, below the limits of all laws."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    speeds = np.linspace(2.2, 9.0, points)
    fine = np.linspace(2.0, 9.0, 141)
    pyplot.rcParams.update(plot.PAPER)
    figure, ax = pyplot.subplots(figsize=(plot.WIDTH, 4.4), layout="constrained")
    top = np.array([limit_at(speed) for speed in fine])
    both = np.array([limit_at(speed, ("top.speed", "bit.speed")) for speed in fine])
    ax.fill_between(fine, top, 2.1, color=plot.BAND, linewidth=0, label="no linear law on the top speed")
    ax.plot(fine, top, color="black", lw=1.6)
    ax.plot(fine, both, color="black", lw=1.0, ls=(0, (5, 2)), label="limit with the bit speed measured")
    marks, ends = "osD^vPX*", {}  # a line is known by its mark and by its name at its end, not by its colour alone
    lifting = (gains.label_of(family) for family in TUNED if gains.FAMILIES[family].lifts)
    drawn = ("stiff PI", "soft torque", "LQG", "LQG, tuned", "impedance, tuned", *lifting)
    for k, label in enumerate(drawn):
        values = [found_at(label, speed, by_simulation=False).disk_margin for speed in speeds]
        look = plot.LINES[k % len(plot.LINES)]
        ax.plot(
            speeds, values, **look, marker=marks[k], ms=4.5, markevery=(k % 3, 3), mfc="white" if k >= len(plot.LINES) else look["color"]
        )
        ends[label] = (values[-1], look["color"], marks[k])
    place = -1.0
    for label, (value, colour, _) in sorted(ends.items(), key=lambda each: each[1][0]):
        place = max(value, place + 0.07)
        ax.annotate(label, (9.0, value), xytext=(9.12, place), va="center", color=colour, fontsize=8.0, annotation_clip=False)
    for value, text in zip(absorbing, ("absorber", "absorber\non the\ndrive"), strict=True):
        ax.axvline(value, color="0.3", lw=0.8, ls=":")
        ax.text(value + 0.05, 1.3, text, fontsize=8.0, va="top")
    ax.set(xlim=(2.0, 9.0), ylim=(0.0, 2.05), ylabel="disk margin [1]")
    with use_units("metric"):  # what drillers read: rpm
        name_axis(ax.xaxis, "set-point", "rad/s")
    ax.set_title("sampled every 10 ms, torque 30 ms late", fontsize=9, loc="left")
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(loc="upper right", bbox_to_anchor=(1.0, 0.96), frameon=False)
    figure.savefig(path, dpi=150)
    pyplot.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the tables, and with --out the csv and the picture."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=folder, help="folder for robustness.csv and robustness.png")
    parser.add_argument("--quick", action="store_true", help="the table of disk margins alone")
    given = parser.parse_args(arguments)
    found = disk_table()
    print(table(found))
    if not given.quick:
        print(f"\n{worst_table()}")
        print(f"\n{working_table()}")
    absorbing = absorbers()
    print(
        f"\nAn ideal absorber at the top reaches down to {absorbing[0]:.2f} rad/s, on the inertia of the drive to {absorbing[1]:.2f} rad/s."
    )
    if given.out:
        headings = ["law", *(f"disk margin at {speed:g} rad/s" for speed in SPEEDS)]
        tables.write(given.out / "robustness.csv", headings, [[label, *row] for label, row in found.items()])
        picture(given.out / "robustness.png", absorbing)
        print(f"\nTable and picture are in {given.out}")


if __name__ == "__main__":
    main()
