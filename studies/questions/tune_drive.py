"""What does tuning a drive give, and what does it cost? Copy this script and put your own rig, law and objectives in.

One run asks both questions. First the machine starts from rest, and the time in which the bit settles at its set-point is measured. Then the set-point falls
until the bit sticks and rises in steps, with every set-point held for 40 s: the lowest speed at which the drive ends an existing stick-slip is the
first set-point from which on the bit does not stick in the second half of any. A slow ramp in place of the steps tells another number: it passes the
threshold while the string is still swinging, and what it reads constant set-points do not keep. What is good for one question is not good
for the other: `tune` gives the front.

    drill string   JANSEN_2 under 90, 97 and 107 kN, designed for 97 kN, the worst counts; top speed measured with noise, commands 30 ms late, every 10 ms.
                   A PI drive that starts from the gains of soft torque, and the LQG drive with its weights as they are delivered.
    collar         the whirling collar of `studies.questions.whirl`: weight and rate of a sliding mode; in place of the settling time the impacts of
    the collar on
                   the wall of the hole while the machine starts.

The law as given is tried first and stands in every table: the twin without tuning.

Answer (40 points for each drive, 20 for the collar). Two gains of a PI drive: soft torque as designed ends stick-slip down to 8.5 rad/s and settles in 30.9 s;
the front goes from 5.5 rad/s and 21.8 s to 7 rad/s and 19.0 s. LQG from 4 rad/s and 16.5 s to 2.5 rad/s and 14.1 s, or 3 rad/s and 11.9 s. On the
collar there is no trade: one weight, near 0.26 1/s, has the lowest set-point (7 instead of 8 rad/s) and no impact in place of 364. None of this
says what is left on a rig whose inertias are off: `python -m studies drives` does.

    python -m studies tune_drive [--out FOLDER] [--runs N] [--journals FOLDER]      (some minutes; the tables and tune_drive.png)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from controllers import LQG, PI, SlidingMode, SoftTorque
from models import BitRock, WhirlingCollar, wells
from studies.command_line import parser_of
from studies.questions import whirl
from studies.questions.drives import DELAY, LIMITS, NOISE, WEIGHT
from toolbox import Sampled, Scene, Trajectory, compose, measure, tune
from toolbox.scenes.cases import Waveform
from toolbox.tuning import Tuned

SET_POINT = 8.0
STARTED = 60.0
"""When the start is over and the set-point falls [s]."""
LEVELS = tuple(np.arange(1.5, 9.01, 0.5).tolist())
"""Set-points [rad/s] that are held, one after the other."""
HELD = 40.0
"""How long each is held [s], with half a second to rise to it."""
LOW = 0.5
"""Set-point [rad/s] at which every bit sticks."""
FIGURES = Path(__file__).parents[1] / "figures"


def set_points(first: float) -> Waveform:
    """The set-point over time: constant for the start, down to where every bit sticks, and up again in steps."""
    times, values = [0.0, STARTED, STARTED + 10.0, STARTED + 30.0], [first, first, LOW, LOW]
    for k, level in enumerate(LEVELS):
        times += [begin_of(k) + 0.5, begin_of(k + 1)]
        values += [level, level]
    return Waveform("table", {"times": tuple(times), "values": tuple(values)})


def begin_of(level: int) -> float:
    """When the set-point rises to one of `LEVELS` [s]."""
    return STARTED + 30.0 + HELD * level


def settling(run: Trajectory) -> float:
    """Seconds in which the bit settles within 5 % of the set-point from rest; inf where it does not."""
    return measure.settling(run, "bit.speed", SET_POINT, band=0.05, until=STARTED)


def lowest_set_point(run: Trajectory) -> float:
    """The lowest of `LEVELS` [rad/s] from which on the bit does not stick in the second half of any; inf where it sticks in the last."""
    sticks = measure.stick_intervals(run, "bit", after=STARTED)
    kept = float("inf")
    for k in reversed(range(len(LEVELS))):
        begin, end = begin_of(k) + HELD / 2, begin_of(k + 1)
        if any(first < end and last > begin for first, last in sticks):
            break
        kept = LEVELS[k]
    return kept


def impacts(run: Trajectory) -> float:
    """How often the collar strikes the wall while the machine starts."""
    return measure.contact(run, "wall", until=STARTED).impacts


def drill_strings() -> dict[str, Scene]:
    """The drill string under three weights; laws are designed for the one in the middle."""
    parts = (wells.JANSEN_2, BitRock(weight=WEIGHT))
    return {f"{weight / 1e3:.0f} kN": _scene("JANSEN_2", parts, SET_POINT, {"bit.weight": weight}) for weight in (90e3, WEIGHT, 107e3)}


def collar() -> Scene:
    """The string with a collar that may whirl against the wall."""
    return _scene("Whirling collar", whirl.rig().parts, whirl.REFERENCE, {})


def _scene(title: str, parts: Any, first: float, parameters: Mapping[str, float]) -> Scene:
    end = begin_of(len(LEVELS))
    return Scene(
        title, parts, (), end, "bit", "bit.speed", "top.torque", STARTED, inputs={"top.reference": set_points(first)}, parameters=parameters
    )


def measured(law: Any) -> Sampled:
    """A law as it runs on a rig: every 10 ms, on a noisy top speed, 30 ms late."""
    return Sampled(law, 0.01, delay=DELAY, noise={"top.speed": NOISE})


def tuned_pi(runs: int, journal: Path | None = None) -> Tuned:
    """Front of a PI drive that starts from the gains of soft torque."""
    given: PI = SoftTorque(reference=SET_POINT, **LIMITS).design(compose(wells.JANSEN_2, BitRock(weight=WEIGHT)))
    bounds = {"pi.proportional": (300.0, 5000.0), "pi.integral": (50.0, 3000.0)}
    return tune(drill_strings(), measured(given), OBJECTIVES, bounds, runs=runs, checkpoint=journal)


def tuned_lqg(runs: int, journal: Path | None = None) -> Tuned:
    """Front of the LQG drive over the sizes that count in its objective."""
    given = LQG(reference=SET_POINT, delay_samples=round(DELAY / 0.01), speed_noise=NOISE, **LIMITS)
    bounds = {"lqg.top_speed_scale": (0.3, 30.0), "lqg.bit_speed_scale": (0.3, 30.0), "lqg.angle_scale": (1.0, 100.0)}
    return tune(drill_strings(), measured(given), OBJECTIVES, bounds, runs=runs, checkpoint=journal)


def tuned_sliding_mode(runs: int, journal: Path | None = None) -> Tuned:
    """Front of a sliding mode on the whirling collar, from a gain that ends stick-slip and strikes the wall."""
    given = SlidingMode(reference=whirl.REFERENCE, surface_gain=0.6, reaching_rate=1.0)
    objectives = {"lowest set-point [rad/s]": lowest_set_point, "impacts": impacts}
    return tune(
        collar(),
        given,
        objectives,
        {"slidingmode.surface_gain": (0.02, 1.6), "slidingmode.reaching_rate": (0.1, 4.0)},
        runs=runs,
        checkpoint=journal,
    )


OBJECTIVES = {"lowest set-point [rad/s]": lowest_set_point, "settling [s]": settling}


def picture(string: Mapping[str, Tuned], rig: Tuned) -> Any:
    """The fronts of both drives of the drill string, and that of the collar; returns a matplotlib figure."""
    import matplotlib.pyplot as plt

    from toolbox import plot, use_units
    from toolbox.figures.style import name_axis

    looks = [(plot.LINES[0], "o"), (plot.LINES[1], "s")]
    with plt.rc_context(plot.PAPER):
        figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.3), layout="constrained")
        for (label, found), (style, marker) in zip(string.items(), looks, strict=True):
            _front(left, found, label, style, marker)
        left.set(ylabel="settling from rest [s]")
        left.set_title("drill string, worst of 90, 97 and 107 kN", loc="left", fontsize=9.0)
        left.legend(frameon=False, fontsize=7.5)
        _front(right, rig, "sliding mode", *looks[0])
        right.set_yscale("symlog", linthresh=1.0)
        right.set(ylabel="impacts on the wall [1]", ylim=(-0.3, None))
        right.set_title("whirling collar", loc="left", fontsize=9.0)
        right.legend(frameon=False, fontsize=7.5)
        with use_units("metric"):  # what drillers read: rpm
            for ax in (left, right):
                name_axis(ax.xaxis, "lowest set-point that ends stick-slip", "rad/s")
    return figure


def _front(ax: Any, found: Tuned, label: str, style: dict[str, Any], marker: str) -> None:
    values = np.array([found.counted(trial) for trial in found.trials])
    front = np.array([found.counted(trial) for trial in found.front])
    ax.plot(values[:, 0], values[:, 1], marker=marker, markersize=2.2, color=style["color"], alpha=0.45, markeredgewidth=0.0, linestyle="none",
            label=f"{label}, tried", zorder=1)  # fmt: skip
    ax.step(front[:, 0], front[:, 1], where="post", zorder=2, **style)
    ax.plot(
        front[:, 0], front[:, 1], marker=marker, markersize=3.5, color=style["color"], linestyle="none", label=f"{label}, front", zorder=3
    )
    if np.isfinite(values[0]).all():
        ax.plot(
            *values[0],
            marker=marker,
            markersize=8,
            markerfacecolor="white",
            color=style["color"],
            linestyle="none",
            label=f"{label}, as given",
            zorder=4,
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Tune, print the tables and write the figure."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=Path, default=FIGURES, help="folder for tune_drive.png")
    parser.add_argument("--runs", type=int, default=40, help="most points tried of each law (40)")
    parser.add_argument("--journals", type=Path, help="folder that keeps every point, so that the script goes on where it was stopped")
    given = parser.parse_args(arguments)
    if given.journals:
        given.journals.mkdir(parents=True, exist_ok=True)
    journal = {name: given.journals / f"{name}.jsonl" if given.journals else None for name in ("pi", "lqg", "collar")}
    string = {"PI": tuned_pi(given.runs, journal["pi"]), "LQG": tuned_lqg(given.runs, journal["lqg"])}
    rig = tuned_sliding_mode(given.runs // 2, journal["collar"])
    for found in (*string.values(), rig):
        print(found, end="\n\n")
    import matplotlib

    matplotlib.use("Agg")
    given.out.mkdir(parents=True, exist_ok=True)
    picture(string, rig).savefig(given.out / "tune_drive.png", dpi=150)
    print(
        f"Figure is in {given.out}; synchronous whirl reaches the wall at {WhirlingCollar().contact_speed(whirl.WEIGHT, whirl.SLIDING):.1f} rad/s."
    )


if __name__ == "__main__":
    main()
