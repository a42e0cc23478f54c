"""What does the rock do to the bit? Laws of torque, cutting with its own memory, and bounce, each against its theory.

1. Why does a drag bit stick and slip on rock whose law knows no speed? Because it bobs: below the speed 2 pi/(n tau), tau = pi/sqrt(2 n zeta eps a/M), at
   which half a wave of the string on the rock fits between two blades, steady cutting is unstable; the bit sticks axially in every cycle,
   its wear flats unload then, and the slower it turns the more of the time they carry in full. The mean torque falls with speed.
2. What does hysteresis of the rock change? The torque runs round a loop, upper branch first, which takes energy from every swing.
3. When does a lobed surface throw the bit off bottom? Where k a (j w)^2/(W0^2 - (j w)^2) exceeds the weight, W0 = sqrt(k/M).

    python -m studies bit_rock [FOLDER]          (default studies/figures; writes bit_rock_laws.png, drag_bit.png, bit_bounce.png)
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import casadi as ca
import numpy as np

from controllers import StiffPI
from models import AxialChain, BitRock, DragBit, ElasticRock, HystereticBitRock, SmoothBitRock, TorsionalPendulum, wells
from models.drag_bit import radau
from models.smooth_bit_rock import smooth_torque
from studies.command_line import figure_folder
from toolbox import compose, measure, plot, simulate, use_units
from toolbox.figures.style import name_axis
from toolbox.simulation.trajectory import Trajectory

MASS, WEIGHT = 34_000.0, 40_000.0
BIT = DragBit(flat_length=3e-3, nodes=20)
STRING = AxialChain(mass=(MASS,), stiffness=(), damping=(), hook_load=MASS * 9.81 - WEIGHT)
WEIGHT_PER_CUT = BIT.cutter_inclination * BIT.specific_energy * BIT.radius  # [N/m]
FLATS = BIT.flat_length * BIT.radius * BIT.flat_stress  # [N]
DEPTH = (WEIGHT - FLATS) / WEIGHT_PER_CUT
STEADY = BIT.specific_energy * BIT.radius**2 * DEPTH / 2 + BIT.friction * BIT.bit_geometry_number * BIT.radius / 2 * FLATS
CRITICAL = 2 / BIT.blades * math.sqrt(2 * BIT.blades * WEIGHT_PER_CUT / MASS)
"""Speed above which steady cutting is stable [rad/s]."""

LOBES, HEIGHT, BOUNCE_WEIGHT, STIFFNESS = 3, 1e-3, 60_000.0, 5e7


def turned(speed: float) -> Trajectory:
    """The drag bit at a constant speed, for 80 blade angles from near steady cutting."""
    plant = compose(TorsionalPendulum(inertia=1e12, stiffness=0.0), STRING, BIT)
    start = {
        "bit.speed": speed,
        "bit.axial_speed": 0.8 * DEPTH * speed / (2 * math.pi),
        "bit.profile": DEPTH / BIT.blades * radau(BIT.nodes)[0][1:],
    }
    return simulate(plant, 80 * 2 * math.pi / BIT.blades / speed, start=start)


def cycle(speed: float) -> tuple[float, float, float]:
    """(mean torque [N m], share of time in axial stick, least cut [m]) of the second half of that run."""
    run = turned(speed)
    after = 0.5 * run.end
    return (
        measure.extent(run, "bit.torque", after=after).mean,
        measure.stuck_ratio(run, "bit.axial", after=after),
        measure.extent(run, "bit.cut_depth", after=after).minimum,
    )


def coupled() -> Trajectory:
    """The drag bit on a torsional pendulum whose table turns at 57 rpm."""
    plant = compose(TorsionalPendulum(damping=20.0, top_speed=57 * math.pi / 30), STRING, BIT)
    return simulate(plant, 30.0, start={"bit.speed": 6.0})


def loops() -> dict[str, Trajectory]:
    """The four-inertia rig under a stiff drive at 45 rpm, on each rock."""
    rocks = {
        "set-valued": BitRock(),
        "rate form": HystereticBitRock(hysteresis_fraction=0.1, hysteresis_steepness=0.2),
        "switched form": HystereticBitRock(hysteresis_fraction=0.1),
    }
    return {
        name: simulate(compose(wells.NAVARRO_LOPEZ_4, rock), 130.0, controller=StiffPI(reference=1.5 * math.pi))
        for name, rock in rocks.items()
    }


def bounce(speed: float) -> tuple[float, float]:
    """(share of time off bottom, largest weight [N]) on three lobes at a constant speed, settled."""
    string = dataclasses.replace(STRING, hook_load=MASS * 9.81 - BOUNCE_WEIGHT)
    rock = ElasticRock(stiffness=STIFFNESS, damping=1e5, lobe_height=HEIGHT, lobes=LOBES)
    plant = compose(TorsionalPendulum(inertia=1e12, stiffness=0.0), string, rock)
    swing = HEIGHT * (LOBES * speed) ** 2 / (STIFFNESS / MASS - (LOBES * speed) ** 2)  # of the closure in the steady state without damping
    calm = speed < bounce_onset()
    run = simulate(plant, 12.0, start={"bit.speed": speed, "bit.position": BOUNCE_WEIGHT / STIFFNESS - HEIGHT - (swing if calm else 0.0)})
    return run.time_in("bit.bottom", "open", after=6.0) / 6.0, measure.extent(run, "bit.weight", after=6.0).maximum


def bounce_onset() -> float:
    """Speed above which the undamped string leaves the bottom [rad/s]."""
    sag = BOUNCE_WEIGHT / STIFFNESS
    return math.sqrt(STIFFNESS / MASS) / LOBES * math.sqrt(sag / (HEIGHT + sag))


def _axes(columns: int, **options: Any) -> tuple[Any, Any]:
    import matplotlib.pyplot as plt

    return plt.subplots(1, columns, figsize=(9.0, 3.3), layout="constrained", **options)


def draw_laws() -> Any:
    """Torque against speed: the laws for steady turning, and what a stick-slip cycle makes of hysteresis."""
    figure, (left, right) = _axes(2, sharey=True)
    speeds = np.linspace(0.0, 12.0, 600)
    rock, smooth = BitRock(), SmoothBitRock()
    laws = {
        "set-valued, Navarro-Lopez": rock.weight * rock.radius * np.array(rock.friction.sliding(ca.DM(speeds))).ravel(),
        "smooth, Real et al.": np.array(smooth_torque(smooth, ca.DM(smooth.weight), ca.DM(speeds))).ravel(),
    }
    for (name, torque), line in zip(laws.items(), plot.LINES, strict=False):
        left.plot(speeds, torque / 1e3, label=name, **line)
        left.fill_between(speeds, 0.9 * torque / 1e3, 1.1 * torque / 1e3, color=line["color"], alpha=0.15, linewidth=0.0)
    left.plot([0, 0], [0, 0.8 * 97_347.0 * 0.155575 / 1e3], color=plot.LINES[0]["color"], linewidth=3.4)
    left.text(0.25, 13.6, "stick", fontsize=8.0)
    left.legend(frameon=False, loc="upper right")
    left.set(ylabel="bit torque [kN m]", xlim=(-0.3, 12.0), ylim=(0.0, 15.0))
    name_axis(left.xaxis, "bit speed", "rad/s")
    left.set_title("laws under 97.3 kN, with branches at ±10 %", loc="left", fontsize=9.0)
    for (name, run), line in zip(loops().items(), plot.LINES, strict=False):
        times = np.union1d(run.time[run.time > 100.0], np.linspace(100.0, 130.0, 6001))
        samples = run.at(times)
        right.plot(samples["bit.speed"], samples["bit.torque"] / 1e3, label=name, **line)
    right.legend(frameon=False, loc="upper right")
    name_axis(right.xaxis, "bit speed", "rad/s")
    right.set_title("stick-slip of four inertias under a stiff drive", loc="left", fontsize=9.0)
    return figure


def draw_drag_bit(speeds: Any = (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 13.0, 14.0, 14.6, 15.0, 15.4, 16.0, 18.0, 21.0, 25.0)) -> Any:
    """Left: torsional stick-slip with axial stick inside. Right: the mean torque that falls with speed."""
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(9.0, 4.2), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.7, 1.0))
    run, (begin, end) = coupled(), (20.0, 26.0)
    times = np.union1d(run.time[(run.time > begin) & (run.time < end)], np.linspace(begin, end, 3001))
    samples = run.at(times)
    rows = (("bit.speed", "", 1.0, "bit"), ("bit.axial_speed", "axial speed\n[mm/s]", 1e3, "bit.axial"),
            ("bit.cut_depth", "depth of cut\n[mm]", 1e3, "bit.axial"))  # fmt: skip
    panels = [figure.add_subplot(grid[row, 0]) for row in range(3)]
    for panel, (name, label, factor, element) in zip(panels, rows, strict=True):
        for first, last in measure.stick_intervals(run, element, begin, end):
            panel.axvspan(first, last, facecolor="0.85", edgecolor="none", zorder=0)
        panel.plot(times, factor * samples[name], **plot.LINES[0])
        panel.set(xlim=(begin, end), ylabel=label)
    name_axis(panels[0].yaxis, "bit speed\n", "rad/s")
    figure.align_ylabels(panels)
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
    panels[-1].set_xlabel("time [s]")
    panels[0].set_title("table at 57 rpm; grey: sticks in torsion (top), axially (below)", loc="left", fontsize=9.0)
    right = figure.add_subplot(grid[:, 1])
    torques = [cycle(speed)[0] for speed in speeds]
    right.plot(speeds, np.array(torques) / 1e3, marker="o", markersize=4, **plot.LINES[0], label="mean torque")
    right.axhline(STEADY / 1e3, **plot.LINES[2], label="steady cutting")
    right.axvline(CRITICAL, color="0.4", linewidth=1.0, linestyle=":")
    right.text(CRITICAL + 0.3, STEADY / 1e3 * 1.22, "steady cutting\nis stable", fontsize=8.0)
    name_axis(right.xaxis, "bit speed, imposed", "rad/s")
    right.set(ylabel="torque [kN m]", ylim=(STEADY / 1e3 * 0.97, None))
    right.set_title("falling torque from a law without speed", loc="left", fontsize=9.0)
    right.legend(frameon=False, loc="upper right")
    return figure


def draw_bounce() -> Any:
    """Share of time off bottom and largest weight against speed, with the onset in closed form."""
    figure, (left, right) = _axes(2)
    speeds = np.linspace(4.0, 18.0, 57)
    found = [bounce(float(speed)) for speed in speeds]
    rpm = speeds * 30 / math.pi
    left.plot(rpm, [100 * share for share, _ in found], **plot.LINES[0])
    left.set(xlabel="rotary speed [rpm]", ylabel="time off bottom [%]", ylim=(-1.5, None))
    right.plot(rpm, [weight / 1e3 for _, weight in found], **plot.LINES[0])
    right.axhline(BOUNCE_WEIGHT / 1e3, **plot.LINES[2])
    right.text(rpm[-1], BOUNCE_WEIGHT / 1e3 + 4, "static weight", fontsize=8.0, ha="right")
    right.set(xlabel="rotary speed [rpm]", ylabel="largest weight on bit [kN]", ylim=(0.0, None))
    for panel in (left, right):
        panel.axvline(bounce_onset() * 30 / math.pi, color="0.4", linewidth=1.0, linestyle=":")
    left.text(bounce_onset() * 30 / math.pi + 1.5, 2.0, "onset, closed form", fontsize=8.0)
    left.set_title("34 t on rock of 50 MN/m, three lobes of 1 mm, 60 kN", loc="left", fontsize=9.0)
    return figure


def main() -> None:
    """Print the numbers and write the figures."""
    import matplotlib.pyplot as plt

    folder = figure_folder()
    print(f"steady cutting is stable above {CRITICAL:.2f} rad/s, where its torque is {STEADY:.0f} N m")
    print("speed [rad/s]  mean torque [N m]  axial stick  least cut [mm]")
    for speed in (4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 25.0):
        torque, stuck, least = cycle(speed)
        print(f"{speed:13.1f}  {torque:17.0f}  {100 * stuck:9.1f} %  {1e3 * least:14.2f}")
    with plt.rc_context(plot.PAPER), use_units("metric"):  # what drillers read: rpm
        for name, figure in (("bit_rock_laws", draw_laws()), ("drag_bit", draw_drag_bit()), ("bit_bounce", draw_bounce())):
            figure.savefig(folder / f"{name}.png")
            print(folder / f"{name}.png")


if __name__ == "__main__":
    main()
