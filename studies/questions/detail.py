"""How much detail does a drill string need, and what does detail cost?

The inclined well of Aarsnes and Shor (2018), off bottom under its published drive, is lumped into 2 to 50 elements (or more), with dry friction along the
string or, as in many models, all of it at the bit. For each level: the band of frequencies that is right within one per cent against the exact stepped
shaft; first motion from rest, period, severity and stuck time of the bit and the swing of the torque at the top, at 60 rpm; and the lowest set-point from
which on the drive ends a stick-slip that exists (a run begins at 40 rpm, where every level sticks and slips, and ramps to the set-point; steps of 10 rpm).
Cost is the processor time of the run at 60 rpm against that of two elements with friction along the string. A last level adds the sideways motion of the
lowest collar.

    python -m studies detail [ELEMENTS ...]      (default 2 4 10 17 33 50, three minutes; writes studies/figures/detail.png; 200 takes far longer)

Answer, with friction along the string and fifty elements as the measure: the period is within 4 per cent from two elements on. The first motion from rest needs
30 elements (2 Hz, the default of `DrillString.from_tables`): with 10 or 17 a wave that friction swallows in finer strings moves the bit at 1.1 s instead of
2.57 s, though only for an instant. The price of 33 elements against 17 is twice the steps with twice the states, three times the time. Two elements
understate severity by a sixth and the torque swing by a third, and ask for 150 rpm to end the stick-slip where finer strings need 100 to 110. Ten are
within 5 per cent in period, severity and swing (stuck time: 25 against 28 per cent). With all friction at the bit, ten and more elements overstate the swing by
up to 21 per cent. The cycles are irregular: the set-points of neighbouring levels differ by 10 rpm for no better reason, and by up to 30 rpm with all friction
at the bit.
Two hundred elements switch 63 000 times in 120 s, where fifty switch 6500 times, and one run takes most of a minute.
The sideways motion of the collar stays off the wall here: it changes period, severity and swing by 3 per cent at most, and costs ten times two
elements, or twice ten; where the collar strikes, see studies/questions/whirl.py.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np

from controllers import PI
from models import DrillString, Section, SmoothStepFriction, WhirlingCollar, read_sections, shaft_frequencies
from models.shaft import chain_frequencies
from studies.timing import timed
from toolbox import compose, measure, simulate
from toolbox.simulation.trajectory import Trajectory

LEVELS = (2, 4, 10, 17, 33, 50)
RPM = math.pi / 30
DRIVE = PI(proportional=38e3, integral=100e3)
DURATION, SETTLED = 120.0, 20.0  # [s]
PATH = Path(__file__).parents[1] / "figures" / "detail.png"


def well(elements: int, along: bool = True) -> tuple[DrillString, tuple[Section, ...]]:
    """The string in so many elements, with its friction along it or all at the bit, and its sections."""
    with as_file(files("models") / "tables") as folder:
        sections = read_sections(folder / "aarsnes_shor_sections.csv")
        string = DrillString.from_tables(
            sections,
            folder / "aarsnes_shor_survey.csv",
            top_inertia=2900.0,
            drag_rate=0.1,
            friction=SmoothStepFriction(),
            elements=elements,
        )
    if not along:
        string = dataclasses.replace(string, friction_load=(math.fsum(string.friction_load or ()),), friction_at=(elements,))
    return string, sections


def trusted_band(string: DrillString, sections: tuple[Section, ...]) -> float:
    """Frequency [Hz] of the last mode, from the lowest on, that the chain has within one per cent; 0 for none. The top is held, as by a stiff drive."""
    lumped = chain_frequencies(string.inertia, string.stiffness, top_held=True)
    exact = shaft_frequencies(sections, len(lumped), top_inertia=math.inf)
    wrong = np.abs(lumped / exact - 1) > 0.01
    right = int(np.argmax(wrong)) if wrong.any() else len(exact)
    return float(exact[right - 1]) if right else 0.0


def period(run: Trajectory, element: str, level: float, after: float) -> float:
    """Mean time [s] between the first rises of the bit through `level` [rad/s] after a stay in stick; nan for fewer than two."""
    times = np.arange(after, run.end, 0.01)
    speed = run.at(times)["bit.speed"]
    rises = times[1:][(speed[:-1] < level) & (speed[1:] >= level)]
    ends = [end for _, end in measure.stick_intervals(run, element, after)]
    firsts = sorted({float(rises[rises >= end][0]) for end in ends if (rises >= end).any()})
    return float(np.mean(np.diff(firsts))) if len(firsts) > 1 else math.nan


def lowest_free_speed(plant: Any, element: str, begin: float = 40.0, high: float = 200.0, step: float = 10.0) -> float:
    """Lowest set-point [rpm] of a grid from which on the bit no longer sticks after a ramp from stick-slip at `begin`; inf where `high` keeps it.

    The grid is walked downwards, because near its end a long stick-slip is irregular: one set-point may end it and a higher one keep it.
    """
    for rpm in np.arange(high, begin, -step):
        reference = ((0.0, 30.0, 45.0, 90.0), (begin * RPM, begin * RPM, rpm * RPM, rpm * RPM))
        run = simulate(plant, 90.0, controller=DRIVE, inputs={"top.reference": reference})
        if not measure.stick_intervals(run, element, 15.0, 30.0):
            raise RuntimeError(f"There must be stick-slip at {begin:g} rpm to leave, but there is none.")
        if measure.stick_intervals(run, element, 70.0):
            return float(rpm + step) if rpm < high else math.inf
    return begin


@dataclass(frozen=True)
class Answers:
    """What one level of detail says; `run` is that at 60 rpm, `seconds` the best of its processor times."""

    elements: int
    along: bool
    collar: bool
    band: float
    first: float
    period: float
    severity: float
    stuck: float
    swing: float
    free_from: float
    seconds: float
    run: Trajectory


def answers(elements: int, along: bool = True, collar: bool = False) -> Answers:
    """All answers of a level; collar: with the sideways motion of the lowest collar between its stabilisers."""
    string, sections = well(elements, along)
    sideways = (WhirlingCollar(weight=0.0),) if collar else ()  # off bottom
    plant = compose(dataclasses.replace(string, collar_index=elements if collar else None), *sideways)
    element = f"chain.{elements}"
    spent: list[float] = []
    while len(spent) < 2 or (len(spent) < 9 and sum(spent) < 2.0):  # the first one compiles
        run, seconds = timed(lambda: simulate(plant, DURATION, controller=DRIVE, inputs={"top.reference": 60 * RPM}))
        spent.append(seconds)
    torque = measure.extent(run, "top.load", SETTLED)
    return Answers(
        elements,
        along,
        collar,
        trusted_band(string, sections),
        next((event.time for event in run.events if event.element == element), math.nan),
        period(run, element, 60 * RPM, SETTLED),
        measure.severity(run, "bit.speed", after=SETTLED),
        measure.stuck_ratio(run, element, SETTLED),
        torque.maximum - torque.minimum,
        lowest_free_speed(plant, element),
        min(spent),
        run,
    )


def draw(found: list[Answers]) -> Any:
    """The figure: bit speed at three levels, lowest free set-point, and cost; returns a matplotlib figure."""
    import matplotlib.pyplot as plt

    from toolbox import plot

    along, bit = ([a for a in found if a.along is side and not a.collar] for side in (True, False))
    shown = [a for a in along if a.elements in (2, 10, 50)] or along[:3]
    with plt.rc_context(plot.PAPER):
        figure = plt.figure(figsize=(9.0, 4.2), layout="constrained")
        grid = figure.add_gridspec(len(shown), 3, width_ratios=(1.9, 1.0, 1.0))
        times = np.linspace(40.0, 60.0, 4001)
        for row, level in enumerate(shown):
            panel = figure.add_subplot(grid[row, 0])
            for begin, end in measure.stick_intervals(level.run, f"chain.{level.elements}", 40.0, 60.0):
                panel.axvspan(begin, end, facecolor=plot.BAND, edgecolor="none", zorder=0)
            panel.plot(times, level.run.at(times)["bit.speed"] / RPM, **plot.LINES[0])
            panel.axhline(60.0, color="0.5", linewidth=0.7, linestyle=":")
            panel.set(xlim=(40.0, 60.0), ylim=(-10.0, 190.0))
            panel.set_title(f"{level.elements} elements", loc="left", fontsize=9.0, pad=3.0)
            panel.tick_params(labelbottom=row == len(shown) - 1)
            if row == len(shown) // 2:
                panel.set_ylabel("bit speed [rpm], grey: stuck, dotted: set-point")
        panel.set_xlabel("time [s]")
        free, cost = figure.add_subplot(grid[:, 1]), figure.add_subplot(grid[:, 2])
        unit = along[0].seconds
        for levels, label, style, marker in (
            (along, "friction along the string", plot.LINES[0], "o"),
            (bit, "all friction at the bit", plot.LINES[1], "s"),
        ):
            number = [a.elements for a in levels]
            free.plot(number, [a.free_from for a in levels], marker=marker, markersize=4.0, label=label, **style)
            cost.plot(number, [a.seconds / unit for a in levels], marker=marker, markersize=4.0, label=label, **style)
        for panel in (free, cost):
            panel.set_xscale("log")
            panel.set_xticks([a.elements for a in along], [str(a.elements) for a in along])
            panel.minorticks_off()
            panel.set_xlabel("elements")
        free.set(ylim=(0.0, None), ylabel="set-point from which stick-slip ends [rpm]")
        cost.set(yscale="log", ylabel=f"processor time / that of {along[0].elements} elements")
        free.legend(frameon=False, loc="lower right", fontsize=7.5)
    return figure


def main() -> None:
    """Print the table and write the figure."""
    import matplotlib

    matplotlib.use("Agg")
    levels = tuple(int(word) for word in sys.argv[1:]) or LEVELS
    print("friction   elements  contacts  band 1 %  first  period  severity  stuck  swing      free from  events  cost")
    print("                               [Hz]    [s]     [s]               [%]    [kN m]     [rpm]               ratio")
    found: list[Answers] = []
    for name, along, collar in (("along", True, False), ("at bit", False, False), ("collar", True, True)):
        for elements in levels:
            if collar and elements not in (2, 10):
                continue
            a = answers(elements, along, collar)
            found.append(a)
            print(
                f"{name:<9} {elements:9d} {len(a.run.modes):9d} {a.band:9.2f} {a.first:6.2f} {a.period:7.2f} {a.severity:9.2f} {100 * a.stuck:6.1f} "
                f"{a.swing / 1e3:9.2f} {a.free_from:11.0f} {len(a.run.events):8d} {a.seconds / found[0].seconds:7.1f}",
                flush=True,
            )
    PATH.parent.mkdir(parents=True, exist_ok=True)
    draw(found).savefig(PATH)
    print(PATH)


if __name__ == "__main__":
    main()
