"""Where in a plane of two numbers does a machine stick, slip, or strike the wall? Maps with their borders, against theory.

Drill string.  The two-inertia rig of Jansen and van den Steen under a stiff drive, over speed and weight on bit: a disturbance of smooth running dies
beyond the Hopf curve, but stick-slip that has begun lives on to two or three times that speed. Sampling the drive at 100 Hz changes neither border.

Two disks.  Under a driven rotor an undamped stator is caught again at every release, a damped one only where friction drops by more than
`studies.questions.disks.critical_drop`. In a stop from 2 rad/s, normal force and damping decide.

Dither.  A force F cos(W t) shakes an undamped block on a belt (Leine et al. 1998), whose steady sliding is unstable at every belt speed v_b. Averaged over
fast dither of velocity amplitude a = F/(m W), its friction falls with slip speed while a < v_b and rises for a > v_b:

    d/dv <mu sgn> = 2 mu_s/(pi sqrt(a^2 - v_b^2)) [a > v_b] - <mu_s d/(1 + d |v_b + a sin|)^2>

so that stick-slip is suppressed above the line F = m W v_b. Far above it the rise becomes so small, as a^-3, that the swing with which
the dither itself begins is not gone after 200 s: at low frequencies dither works in a band of amplitudes only.

Collar.  Steady synchronous whirl meets the wall at `WhirlingCollar.contact_speed`; rolling backward along the wall, once begun, lasts down to
`rolling_speed` or a little less, because a moment of slip does not end it. Between the two the collar does what it was last disturbed into,
like the bit between its borders.

    python -m studies maps [FOLDER]          table, studies/figures/map_*.png (about a minute of processor time)
"""

from __future__ import annotations

import math
import time as clock
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from controllers import StiffPI
from models import BitRock, Coulomb, TwoDisks, WhirlingCollar, wells
from models.oscillators import LEINE
from studies.command_line import figure_folder
from studies.questions.disks import braking_decision, critical_drop
from toolbox import Component, Equations, HybridSystem, Quantity, Sampled, closed_loop, compose, plot, quantity, sweep, time, use_units
from toolbox.figures.style import name_axis
from toolbox.measuring import metrics
from toolbox.onsets.borders import border
from toolbox.onsets.severity_map import SeverityMap, severity_map
from toolbox.sweeps import Sweep, Variations

SPEEDS, WEIGHTS = (3.0, 14.0), (50e3, 110e3)  # [rad/s], [N]


# ---------------------------------------------------------------------------------------------------------------------------------- drill string
def string_map(shape: tuple[int, int] = (50, 50), sampled: bool = True, halvings: int = 3) -> SeverityMap:
    """Severity over speed and weight of the two-inertia rig (bit drag 50 N m s/rad) under the stiff drive, sampled at 100 Hz or continuous."""
    plant = compose(wells.JANSEN_2, BitRock())
    law: Any = Sampled(StiffPI(), 0.01) if sampled else StiffPI()
    return severity_map(closed_loop(plant, law), {"top.reference": SPEEDS, "bit.weight": WEIGHTS}, shape=shape, halvings=halvings)


# --------------------------------------------------------------------------------------------------------------------------------------- two disks
def caught(points: np.ndarray) -> np.ndarray:
    """Whether the stator of a driven rotor is caught again after its release; points: (damping ratio, drop of friction z)."""
    inertia, stiffness, kinetic = 0.02, 2000.0, 30.0
    w_n = math.sqrt(stiffness / inertia)
    damping, static = 2 * points[:, 0] * math.sqrt(stiffness * inertia), kinetic + points[:, 1] * stiffness / w_n
    disks = TwoDisks(rotor_inertia=1e12, stator_inertia=inertia, stiffness=stiffness, normal_force=1.0, radius=1.0,
                     friction=Coulomb(static=40.0, kinetic=kinetic))  # fmt: skip

    def released(row: Any) -> dict[str, float]:
        angle = (row["disks.friction.static"] * (1 - 1e-9) - row["disks.damping"]) / stiffness
        return {"disks.rotor_speed": 1.0, "disks.stator_speed": 1.0, "disks.stator_angle": angle}

    rows = Variations(("disks.damping", "disks.friction.static"), np.stack([damping, static], axis=1), (len(points),))
    found = sweep(compose(disks), rows, duration=4 * math.pi / w_n, start=released, metrics={"sticks": metrics.stays("disks")})
    return found["sticks"] > 1


def stops(points: np.ndarray) -> np.ndarray:
    """Whether a stop of the shipped disks from 2 rad/s sticks and slips in its second half; points: (normal force [N], damping [N m s/rad])."""
    return np.array([braking_decision(load, damping) > 0 for load, damping in points])


# ------------------------------------------------------------------------------------------------------------------------------------------ dither
@dataclass(frozen=True)
class Dither(Component):
    """A force F cos(W t) on a block."""

    amplitude: Quantity = quantity(1.0, "N", "amplitude F", at_least=0)
    frequency: Quantity = quantity(20.0, "rad/s", "frequency W", above=0)

    def equations(self, signal):
        force = self.amplitude * ca.cos(self.frequency * time)
        return Equations(outputs={"dither.force": (force, "N"), "block.force": (force, "N")})


def averaged_slope(velocity: float, belt_speed: float) -> float:
    """Slope of the averaged friction of the block over slip speed [N s/m] under dither of a velocity amplitude [m/s], by quadrature."""
    law, angle = LEINE.friction, np.linspace(0.0, 2 * np.pi, 100_001)[:-1]
    slip = np.abs(belt_speed + velocity * np.sin(angle))
    falling = np.mean(law.static * law.decay / (1 + law.decay * slip) ** 2)  # type: ignore[attr-defined]
    rising = 2 * law.static / (np.pi * np.sqrt(velocity**2 - belt_speed**2)) if velocity > belt_speed else 0.0  # type: ignore[attr-defined]
    return float(rising - falling)


def dithered(variations: Any) -> Sweep:
    """Sweep of the dithered block over `dither.frequency` [rad/s] and `dither.amplitude` [N]: its swing after 200 s [m]."""
    plant = compose(LEINE, Dither())
    asked = {"low": metrics.minimum("block.position", 200.0), "high": metrics.maximum("block.position", 200.0)}
    return sweep(plant, variations, duration=230.0, metrics=asked, accuracy=1e-5)


def slow_swing(found: Sweep) -> np.ndarray:
    """Half of the swing of the block beyond that without friction, F/|k - m W^2| [m]."""
    own = found["dither.amplitude"] / np.abs(LEINE.stiffness - LEINE.mass * found["dither.frequency"] ** 2)
    return (found["high"] - found["low"]) / 2 - own


# ------------------------------------------------------------------------------------------------------------------------------------------ collar
@dataclass(frozen=True)
class Turning(Component):
    """A string that turns at a given speed."""

    speed: Quantity = quantity(10.0, "rad/s", "speed", above=0)

    def equations(self, signal):
        speed = ca.SX(self.speed)
        return Equations(outputs={"string.turning": (speed, "rad/s"), "collar.speed": (speed, "rad/s")})


COLLAR = WhirlingCollar(weight=100e3, restitution=0.3)
TURNS = 60.0  # [s]


def collar() -> HybridSystem:
    """The collar between its stabilisers in a string at constant speed, with a rigid wall."""
    return compose(Turning(), COLLAR)


def synchronous(row: Any) -> dict[str, Any]:
    """Steady forward whirl without drag, or nine tenths of the gap where that is more."""
    speed = row["string.speed"]
    radius = min(COLLAR.synchronous_radius(speed, row["collar.weight"]), 0.9 * COLLAR.gap)
    return {"collar.displacement": (radius, 0.0), "collar.velocity": (0.0, (radius + COLLAR.eccentricity) * speed)}


def rolling(row: Any) -> dict[str, Any]:
    """On the wall, rolling backward without slip."""
    return {
        "collar.displacement": (COLLAR.gap, 0.0),
        "collar.velocity": (0.0, (COLLAR.eccentricity - COLLAR.outer_radius) * row["string.speed"]),
    }


def touching(points: np.ndarray, start: Any) -> np.ndarray:
    """Part of the second half of a run that the collar spends on the wall; points: (speed [rad/s], weight [N])."""
    rows = Variations(("string.speed", "collar.weight"), points, (len(points),))
    found = sweep(
        collar(),
        rows,
        duration=TURNS,
        start=start,
        metrics={"wall": metrics.time_in("wall", TURNS / 2, mode="closed"), "hits": metrics.stays("wall", TURNS / 2, mode="closed")},
    )
    failed = np.isnan(found["wall"])
    if failed.any():
        print(f"  {failed.sum()} runs of the collar failed: {next(iter(found.failures.values()))}")
    return np.where(found["hits"] > 0, np.maximum(found["wall"] / (TURNS / 2), 1e-9), 0.0)


# ---------------------------------------------------------------------------------------------------------------------------------------- pictures
def region(ax: Any, axes: Any, segments: np.ndarray, beyond: str, label: str, style: int = 0, shade: str = plot.BAND) -> None:
    """The border of a region, and the region in grey: all that lies "right" of it, "above" or "below"."""
    from matplotlib.collections import LineCollection

    from toolbox.onsets.borders import lines_of

    x, y = axes
    lines = lines_of(segments)
    for line in lines:
        if beyond == "right":
            ax.fill_betweenx(line[:, 1], line[:, 0], x[-1], color=shade, linewidth=0, zorder=0)
        else:
            ax.fill_between(line[:, 0], line[:, 1], y[-1] if beyond == "above" else y[0], color=shade, linewidth=0, zorder=0)
    look = dict(plot.LINES[style])
    ax.add_collection(LineCollection(lines, colors=look["color"], linestyles=look["linestyle"], linewidths=1.8, label=label, zorder=3))
    ax.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))


THEORY = {"color": "black", "linestyle": (0, (1.2, 1.2)), "linewidth": 1.3, "zorder": 4}


def main() -> None:
    """Print the tables and write the figures."""
    import matplotlib.pyplot as plt

    folder = figure_folder()

    def timed(label: str, function: Any, *arguments: Any) -> Any:
        wall, cpu = clock.perf_counter(), clock.process_time()
        found = function(*arguments)
        print(f"[{label}: {clock.perf_counter() - wall:.1f} s, {clock.process_time() - cpu:.1f} s of processor time]\n", flush=True)
        return found

    string_map((2, 2))  # compiles
    for sampled, name in ((False, "continuous"), (True, "100 Hz")):
        found = timed(f"50 x 50 map, {name}", string_map, (50, 50), sampled)
        print(f"{found}\n")
    with use_units("metric"):  # what drillers read: rpm
        axes = found.plot()
    axes[0].figure.savefig(folder / "map_string.png", dpi=110)

    def draw_disks() -> Any:
        with plt.rc_context(plot.PAPER):
            figure, (left, right) = plt.subplots(1, 2, figsize=(7.6, 3.2), layout="constrained")
            grid = np.linspace(0.02, 0.4, 41), np.linspace(0.2, 8.0, 41)
            _, segments = border(grid, caught, 6)
            region(left, grid, segments, "above", "bisection of runs")
            left.plot(grid[0], [critical_drop(zeta) for zeta in grid[0]], label="theory", **THEORY)
            off = max(abs(z / critical_drop(zeta) - 1) for zeta, z in segments.reshape(-1, 2))
            print(f"Two disks, driven rotor: border of {len(segments)} pieces, largest deviation from theory {100 * off:.2f} %")
            left.set(xlabel="damping ratio of the stator [1]", ylabel=r"drop of friction $(T_s - T_k)\,\omega_n / (k\,\Omega)$ [1]")
            left.set_title("driven rotor: caught again", loc="left", fontsize=9.0)
            left.legend(loc="upper left", frameon=False)
            grid = np.linspace(200.0, 2000.0, 10), np.linspace(0.5, 20.0, 14)
            _, segments = border(grid, stops, 3)
            region(right, grid, segments, "below", "bisection of stops")
            disks = TwoDisks()
            fall = disks.radius * (disks.friction.static - disks.friction.kinetic) * disks.friction.decay  # type: ignore[attr-defined]
            right.plot(grid[0], fall * grid[0], label="steepest fall of friction", **THEORY)
            right.set(xlabel="normal force [N]", ylabel="damping of the mount [N m s/rad]", ylim=(grid[1][0], grid[1][-1]))
            right.set_title("stop from 2 rad/s: stick-slip", loc="left", fontsize=9.0)
            right.legend(loc="center right", frameon=False)
            figure.savefig(folder / "map_disks.png", dpi=110)

    timed("two disks", draw_disks)

    def draw_dither() -> Any:
        alone = slow_swing(dithered([{"dither.frequency": 20.0, "dither.amplitude": 0.0}]))[0]
        grid = np.linspace(3.0, 60.0, 25), np.linspace(0.25, 15.0, 25)
        found = dithered({"dither.frequency": grid[0], "dither.amplitude": grid[1]})
        swing = slow_swing(found) / alone
        limit = 0.02

        def calm(points: np.ndarray) -> np.ndarray:
            rows = Variations(("dither.frequency", "dither.amplitude"), points, (len(points),))
            return slow_swing(dithered(rows)) < limit * alone

        _, segments = border(grid, calm, 3)
        fast = segments.reshape(-1, 2)
        fast = fast[fast[:, 0] > 20.0]
        ratio = fast[:, 1] / (LEINE.mass * fast[:, 0] * LEINE.belt_speed)
        print(
            f"Dither: swing without {alone:.4g} m; beyond 20 rad/s the border is at F/(m W v_b) = {ratio.min():.3f} .. {ratio.max():.3f}, theory 1"
        )
        v = LEINE.belt_speed
        print(
            "  slope of averaged friction at a/v_b = 0.5, 0.99, 1.01, 2, 10 [N s/m]: "
            + ", ".join(f"{averaged_slope(k * v, v):.3g}" for k in (0.5, 0.99, 1.01, 2, 10))
        )
        with plt.rc_context(plot.PAPER):
            from matplotlib.collections import LineCollection

            from toolbox.onsets.borders import lines_of

            figure, ax = plt.subplots(figsize=(5.4, 3.5), layout="constrained")
            shade = ax.pcolormesh(*grid, np.clip(swing, 0, None).T, cmap="Greys", vmin=0.0, vmax=1.5, shading="nearest", rasterized=True)
            ax.add_collection(
                LineCollection(lines_of(segments), colors="#8fb4dc", linewidths=3.2, label="suppressed above (2 % of the swing)", zorder=3)
            )
            ax.plot(grid[0], LEINE.mass * grid[0] * v, label=r"theory, $F = m\,W\,v_b$", **THEORY)
            ax.set(
                xlabel="frequency of the dither W [rad/s]",
                ylabel="amplitude of the dither F [N]",
                xlim=(grid[0][0], grid[0][-1]),
                ylim=(grid[1][0], grid[1][-1]),
            )
            figure.colorbar(shade, label="slow swing as a fraction of\nthe swing without dither", extend="max")
            handles, labels = ax.get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
            figure.savefig(folder / "map_dither.png", dpi=110)

    timed("dither", draw_dither)

    def draw_collar() -> Any:
        grid = np.linspace(2.0, 30.0, 29), np.linspace(20e3, 200e3, 13)
        with plt.rc_context(plot.PAPER):
            figure, ax = plt.subplots(figsize=(5.4, 3.6), layout="constrained")
            shown = grid[0], grid[1] / 1e3
            _, segments = border(grid, lambda points: touching(points, rolling) > 0.99, 4)
            region(ax, shown, segments / [1.0, 1e3], "right", "rolling backward lasts above", 1, "0.93")
            off = max(abs(w / COLLAR.rolling_speed(load) - 1) for w, load in segments.reshape(-1, 2))
            print(f"Collar: rolling lasts, largest deviation from `rolling_speed` {100 * off:.1f} %")
            _, segments = border(grid, lambda points: touching(points, synchronous) > 0.0, 4)
            region(ax, shown, segments / [1.0, 1e3], "right", "synchronous whirl meets the wall above", 0, "0.80")
            off = max(abs(w / COLLAR.contact_speed(load) - 1) for w, load in segments.reshape(-1, 2))
            print(f"Collar: first contact, largest deviation from `contact_speed` {100 * off:.1f} %")
            loads = np.linspace(*grid[1][[0, -1]], 200)
            ax.plot([COLLAR.contact_speed(load) for load in loads], loads / 1e3, label="closed forms", **THEORY)
            ax.plot([COLLAR.rolling_speed(load) for load in loads], loads / 1e3, **THEORY)
            ax.set(ylabel="weight on bit [kN]")
            with use_units("metric"):
                name_axis(ax.xaxis, "speed of the string", "rad/s")
            for at, text in ((4.0, "free"), (14.0, "rolls on\nonce disturbed"), (26.0, "strikes")):
                ax.text(at, 40.0, text, ha="center", va="center", fontsize=8.0)
            figure.legend(loc="outside lower center", ncols=2, frameon=False)
            figure.savefig(folder / "map_collar.png", dpi=110)

    timed("collar", draw_collar)
    print(f"Figures are in {folder}")


if __name__ == "__main__":
    main()
