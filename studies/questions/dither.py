"""What does dither do to stick-slip, and what does it cost beside the other cures?

Three rigs, each deep in stick-slip without a cure:
    Leine's block      on its belt of 0.2 m/s; natural frequency 0.159 Hz; the load is the normal load
    disc brake         held at 1 rad/s by a heavy disc, 1 kN; pads and caliper at 50.3 Hz; the load is the force of the pads
    drill string       JANSEN_2 under a constant torque of 11 375 N m, at which smooth drilling at 8 rad/s and stick-slip are both stable, started
                       from rest; bit against table at 0.179 Hz; the load is the weight on bit, 97.3 kN

Cures: dither of the load by a sine in the band, by one below it at 0.8 of the natural frequency, by a square wave and by a sweep in the band, and phased
with the slip (depth 0.5 at a deviation of the mean slip), at once and late by a fifth of the natural period; dither along the slip at ten times the
natural frequency, 1.2 times the amplitude that `tangential_dither` asks for (from the averaged friction); and the cures of Popp and Rudolph and of
Maegawa and Itoigawa: damping of 1.2 times what the falling friction takes, excitation at three times the natural frequency with the velocity amplitude of
the tangential dither, an absorber of a tenth of the mass (brake: 2 %). In the band: at the frequency and depth that `dither_map` measured as best,
so that these rows are what dither can do, not what it does off-hand. On the string nothing reaches the bit along its slip but the torque of the
top drive, which excites at three times the natural frequency with a tenth of the torque; its damper is a drag of 100 N m s/rad more at the bit, its
absorber the active damping of Jansen and van den Steen.

Columns, over the last half of 160 natural periods:
    swing      range of the position (string: of the bit speed), in parts of that without a cure; above 1 the cure harms
    stuck      part of the time in stick
    ripple     rms of the speed of what slips about its mean, in parts of the mean slip
    load       rms of the dither in parts of the mean load; for forces along the slip, in parts of the mean friction
    power      mean power that dither or excitation puts in along the slip, in parts of that of the friction at steady sliding; normal dither moves nothing
               in these models, and what it costs an actuator is its stroke times the load, which a model with contact stiffness has
    wear       integral of N |v| over time (Archard), in parts of steady sliding

    python -m studies dither [--out FOLDER]       (some minutes; the table, dither.csv and dither.png)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from controllers import ActiveDamping, NormalDither, PhasedDither, SquareDither, SweptDither, dither_map
from controllers.dither import DitherMap
from models import Absorber, BitRock, Block, DiscBrake, oscillators, tangential_dither, wells
from studies.command_line import folder, parser_of, write_rows
from toolbox import HybridSystem, Sampled, compose, measure, simulate
from toolbox.inputs import sine

PERIODS = 160.0
BELOW = 0.8
RATIOS = np.geomspace(0.25, 12.0, 34)
DEPTHS = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
WEIGHT, TORQUE = 97_347.0, 11_375.0


@dataclass(frozen=True)
class Rig:
    """A plant in stick-slip: its load and contact, what swings, natural frequency [Hz], mean slip, mean friction, and what it is run with.

    over, offset: for a load that rides on a force given otherwise;  speed, reference, rising: of what slips, its value at the mean slip, and whether the slip
    rises (1) or falls (-1) with it;  push: input along the slip, "" for none.
    """

    label: str
    parts: tuple[Any, ...]
    load: str
    mean: float
    contact: str
    position: str
    speed: str
    unit: str
    natural: float
    slip: float
    friction: float
    push: str
    reference: float = 0.0
    rising: float = -1.0
    over: str | None = None
    drag: float = 0.0
    run: Mapping[str, Any] = field(default_factory=dict)

    @property
    def plant(self) -> HybridSystem:
        """The plant without a cure."""
        return compose(*self.parts)

    @property
    def offset(self) -> float:
        """The load that is there without dither, where the dither rides on it."""
        return 0.0 if self.over is None else self.mean


LEINE = Rig(
    "Leine's block", (oscillators.LEINE,), "block.load", 1.0, "belt", "block.position", "block.speed", "m/s", 1.0 / (2.0 * math.pi), 0.2,
    1.0 / 1.6, "block.force",
)  # fmt: skip
BRAKE = Rig(
    "disc brake", (DiscBrake(inertia=1e9),), "brake.disturbance", 1000.0, "pad", "pad.position", "pad.speed", "m/s", math.sqrt(1e5) / (2.0 * math.pi),
    0.12, 2000.0 * (0.35 + 0.1 * math.exp(-0.6)), "pad.attachment", over="brake.force", drag=200.0, run={"start": {"disc.speed": 1.0}},
)  # fmt: skip
STRING = Rig(
    "drill string", (wells.JANSEN_2, BitRock(weight=WEIGHT)), "bit.weight", WEIGHT, "bit", "bit.speed", "bit.speed", "rad/s",
    math.sqrt(473.0 / 374.0) / (2.0 * math.pi), 8.0, 0.155575 * WEIGHT * (0.5 + 0.3 * math.exp(-7.2)), "top.torque", reference=8.0, rising=1.0,
    run={"inputs": {"top.torque": TORQUE}},
)  # fmt: skip
RIGS = (LEINE, BRAKE, STRING)


@cache
def map_of(label: str) -> DitherMap:
    """The dither map of a rig."""
    rig = next(rig for rig in RIGS if rig.label == label)
    return dither_map(
        rig.plant, rig.load, rig.mean, rig.natural, contact=rig.contact, signal=rig.position, ratios=RATIOS, depths=DEPTHS, other_load=rig.offset, **rig.run
    )  # fmt: skip


def best(label: str) -> tuple[float, float]:
    """(frequency [Hz], depth) of the smallest swing on the map, averaged over neighbouring frequencies, so that one lucky run does not count."""
    found = map_of(label)
    smooth = (found.swing[:, :-2] + found.swing[:, 1:-1] + found.swing[:, 2:]) / 3.0
    depth, place = np.unravel_index(int(np.argmin(smooth)), smooth.shape)
    return float(found.frequency[place + 1]), float(found.depth[depth])


# --- one cure on one rig


@dataclass(frozen=True)
class Outcome:
    """A line of the table; the columns are those of the module."""

    rig: str
    cure: str
    swing: float
    stuck: float
    ripple: float
    load: float
    power: float
    wear: float


def judged(
    rig: Rig, cure: str, *, alone: float, law: Any = None, parts: tuple[Any, ...] = (), inputs: Mapping[str, Any] | None = None
) -> Outcome:
    """A cure on a rig: a law, parts that replace those of the rig, or inputs; `alone` is the swing without."""
    duration = PERIODS / rig.natural
    given = {name: value for name, value in rig.run.items() if name != "inputs"}
    driven = {**rig.run.get("inputs", {}), **(inputs or {})}
    if rig.push in (getattr(law, "actuated_signals", None) or ()):
        driven.pop(rig.push, None)
    run = simulate(compose(*(parts or rig.parts)), duration, controller=law, inputs=driven, **given)
    times = np.linspace(duration / 2, duration, 80_001)[:-1]
    at = run.at(times)
    slip = at[f"{rig.contact}.slip"]
    turning, load = np.abs(slip), at[rig.load] + rig.offset
    extent = measure.extent(run, rig.position, duration / 2)
    push = at[rig.push]
    moved = (push - push.mean()) if inputs and rig.push in inputs else np.zeros_like(push)
    along = at[rig.speed] if rig.push != "top.torque" else at["top.speed"]
    return Outcome(
        rig.label,
        cure,
        swing=(extent.maximum - extent.minimum) / alone,
        stuck=measure.stuck_ratio(run, rig.contact, duration / 2),
        ripple=float(at[rig.speed].std()) / rig.slip,
        load=float(load.std()) / rig.mean + float(moved.std()) / rig.friction,
        power=float((moved * along).mean()) / (rig.friction * rig.slip),
        wear=float((load * turning).mean()) / (rig.mean * rig.slip),
    )


def cures(rig: Rig) -> dict[str, dict[str, Any]]:
    """{cure: arguments of `judged`}."""
    frequency, depth = best(rig.label)
    common = {"load": rig.load, "over": rig.over, "depth": depth}
    steep = {"depth": 0.5, "speed": rig.speed, "unit": rig.unit, "reference": rig.reference, "speed_scale": rig.rising * rig.slip}
    period = 1.0 / (40.0 * frequency)
    found: dict[str, dict[str, Any]] = {
        "none": {},
        "sine in the band": {"law": NormalDither(**common, frequency=frequency)},
        "sine below the band": {"law": NormalDither(**common, frequency=BELOW * rig.natural)},
        "square in the band": {"law": Sampled(SquareDither(**common, frequency=frequency), period)},
        "sweep in the band": {
            "law": SweptDither(**common, frequency=frequency, frequency_deviation=0.25 * frequency, sweep_time=20.0 / frequency)
        },
        "phased with the slip": {"law": PhasedDither(**{**common, **steep})},
        "the same, T/5 late": {"law": Sampled(PhasedDither(**{**common, **steep}), 0.005 / rig.natural, delay=0.2 / rig.natural)},
    }
    if rig is STRING:
        excited = sine(TORQUE, 0.1 * TORQUE, 3.0 * rig.natural)
        drag = replace(wells.JANSEN_2, bit_drag=150.0)
        limits = {"lowest_torque": 0.0, "highest_torque": 20_000.0}
        return found | {
            "damping": {"parts": (drag, rig.parts[1])},
            "excitation": {"inputs": {rig.push: excited}},
            "absorber": {"law": ActiveDamping(reference=8.0, **limits)},
        }
    dither = tangential_dither(rig.plant, rig.contact, rig.slip, 10.0 * rig.natural, drag=rig.drag)
    body = rig.parts[0]
    mass = body.mass if rig is LEINE else body.pad_mass
    stiffness, omega = body.stiffness, 6.0 * math.pi * rig.natural
    excitation = 1.2 * dither.amplitude * abs(stiffness - mass * omega**2) / omega
    taken = falling(rig)
    absorber = replace(
        Absorber.tuned(Block(mass=mass, stiffness=stiffness), 0.1 if rig is LEINE else 0.02), attached_to=rig.position.partition(".")[0]
    )
    return found | {
        "tangential": {"inputs": {rig.push: sine(0.0, 1.2 * dither.force, dither.frequency)}},
        "damping": {"parts": (replace(body, damping=1.2 * taken),)},
        "excitation": {"inputs": {rig.push: sine(0.0, excitation, 3.0 * rig.natural)}},
        "absorber": {"parts": (body, absorber)},
    }


def falling(rig: Rig) -> float:
    """-N mu'(v) [N s/m] at the mean slip: the damping that the falling friction takes."""
    return 3.0 / 1.6**2 if rig is LEINE else 2000.0 * 0.1 * 5.0 * math.exp(-5.0 * rig.slip)


def outcomes(rig: Rig) -> list[Outcome]:
    """All lines of a rig."""
    run = simulate(rig.plant, PERIODS / rig.natural, **rig.run)
    extent = measure.extent(run, rig.position, run.end / 2)
    return [judged(rig, cure, alone=extent.maximum - extent.minimum, **how) for cure, how in cures(rig).items()]


# --- table and picture


def table(rows: Sequence[Outcome]) -> str:
    """The rows as text, a block for each rig, under its band."""
    lines = []
    for rig in RIGS:
        found, (frequency, depth) = map_of(rig.label), best(rig.label)
        low, high = found.band(depth)
        band = f"swing below a half from {low / rig.natural:.2g} to {high / rig.natural:.2g}" if low == low else "no band below a half"
        lines.append(f"{rig.label}: best at {frequency / rig.natural:.2g} x natural, depth {depth:g}; {band} x natural there")
        head = f"  {'cure':<22}{'swing':>8}{'stuck':>9}{'ripple':>9}{'load':>8}{'power':>9}{'wear':>8}"
        lines += [head, "  " + "-" * (len(head) - 2)]
        for row in rows:
            if row.rig == rig.label:
                lines.append(
                    f"  {row.cure:<22}{row.swing:>8.3f}{100 * row.stuck:>7.1f} %{row.ripple:>9.3f}{row.load:>8.2f}{row.power:>9.3f}{row.wear:>8.2f}"
                )
        lines.append("")
    return "\n".join(lines)


def picture(path: Path) -> None:
    """The maps of the three rigs: swing over frequency and depth."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.colors import BoundaryNorm

    from toolbox import plot

    levels = [0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0]
    with pyplot.rc_context(plot.PAPER):
        figure, panels = pyplot.subplots(1, 3, figsize=(11.0, 3.4), sharey=True, layout="constrained")
        for panel, rig in zip(panels, RIGS, strict=True):
            found = map_of(rig.label)
            shades = panel.pcolormesh(
                RATIOS, found.depth, found.swing, norm=BoundaryNorm(levels, 256), cmap="YlOrBr", shading="nearest", rasterized=True
            )
            panel.contour(RATIOS, found.depth, found.swing, levels=[0.5], colors="black", linewidths=1.0)
            panel.set(xscale="log", xlabel="frequency / natural frequency")
            panel.set_xticks([0.3, 0.5, 1, 2, 3, 5, 10], ["0.3", "0.5", "1", "2", "3", "5", "10"])
            panel.minorticks_off()
            panel.set_title(rig.label, loc="left", fontsize=9.5)
        panels[0].set_ylabel("depth of the dither")
        bar = figure.colorbar(shades, ax=panels, ticks=levels)
        bar.set_label("swing as a fraction of the swing without dither\n(line: one half)")
        figure.savefig(path, dpi=110)
        pyplot.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and with --out write its csv and picture."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=folder, help="folder for dither.csv and dither.png")
    given = parser.parse_args(arguments)
    rows = [row for rig in RIGS for row in outcomes(rig)]
    print(table(rows))
    if given.out:
        write_rows(rows, given.out / "dither.csv")
        picture(given.out / "dither.png")
        print(f"Table and picture are in {given.out}")


if __name__ == "__main__":
    main()
