"""Four questions about what surrounds a machine that sticks and slips, in one picture.

Top drive: what does a motor make of the start torque of a stiff drive? The law asks for proportional gain times set-point at once; the motor gives what it
has, as fast as it can, and the stick-slip that follows is the same.
Gears: what does a differential lose? Teeth lose only what they transmit as seen from the carrier: nothing where the train turns as a block, and the full
1 - eta where the carrier stands and all power goes from motor to motor through them.
Hand and arm: on which belt does a hand-held block shake the hand? Where it sticks and slips; the dose is highest just below the speed that ends it.
Flow line: how high must a slow pump go before gelled mud moves? To the strength of the gel, 4 tau l / d, if all of it broke at once. It is compressible
and breaks from the pump on: the finer the line is resolved, the less the pump feels beyond the yield stress of what flows already.

    python -m studies networks [PATH]            (default studies/figures/networks.png)
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Any

import numpy as np

from models import Coulomb, FlowLine
from models.flow_line import nozzle_loss
from models.gears import Train, steady_gears
from models.hand_arm import daily_exposure, weighted_acceleration
from toolbox import Scene, compose, measure, plot, simulate
from toolbox.simulation.trajectory import Trajectory

SCENES = Path(__file__).parents[1] / "scenes"
PATH = Path(__file__).parents[1] / "figures" / "networks.png"
BELT_SPEEDS = np.linspace(0.02, 0.1, 33)  # [m/s]
RING_SPEEDS = np.linspace(-20.0, 40.0, 241)  # [rad/s]
HOUR = 3600.0  # [s]
LENGTH, BORE = 2500.0, 0.123  # [m]
STRENGTH, YIELD = 20.0, 8.0  # stress at the wall at rest and in flow [Pa]


def start_up() -> dict[str, Trajectory]:
    """The stiff drive of the scene `top_drive` behind the real motor and behind one that has everything but limits."""
    scene = Scene.load(SCENES / "top_drive.toml")
    chain, rock, drive = scene.parts
    ideal = dataclasses.replace(drive, torque_limit=None, rate_limit=None)
    law = scene.case("stiff PI").law
    return {
        "limits of the motor": simulate(compose(chain, rock, drive), 30.0, controller=law),
        "no limits": simulate(compose(chain, rock, ideal), 30.0, controller=law),
    }


def differential(eta: float) -> np.ndarray:
    """Efficiency of a differential (i0 = -3) that lifts a load with 20 rad/s on its sun, over the speeds of its ring; nan where no power flows in."""
    train = [Train("sun", "ring", "carrier", -3.0, eta)]
    return np.array([steady_gears(train, {"sun": 20.0, "ring": ring}, {"carrier": -100.0}).efficiency for ring in RING_SPEEDS])


def exposures() -> tuple[np.ndarray, np.ndarray]:
    """(A(8) [m/s2] of an hour a day, part of the time in stick) of the hand in the scene `hand_held_block`, over the speeds of the belt."""
    plant = Scene.load(SCENES / "hand_held_block.toml").plant()
    times = 4.0 + 1e-4 * np.arange(40_000)
    dose, stuck = [], []
    for speed in BELT_SPEEDS:
        run = simulate(plant, 8.0, parameters={"block.belt_speed": float(speed)}, accuracy=1e-7)
        dose.append(daily_exposure([weighted_acceleration(run.at(times)["block.speed"], 1e-4)], HOUR))
        stuck.append(measure.stuck_ratio(run, "belt", after=4.0))
    return np.array(dose), np.array(stuck)


def circulation() -> dict[int, Trajectory]:
    """A pump of 1 l/s on the gelled line of the scene `breaking_circulation`, by number of segments."""
    gel = Coulomb(static=STRENGTH, kinetic=YIELD)
    mud = {"viscosity": 0.03, "density": 1500.0, "bulk_modulus": 1.5e9, "gel": gel, "end_loss": nozzle_loss(1500.0, 4e-4)}
    lines = {n: FlowLine.pipe(LENGTH, BORE, segments=n, **mud) for n in (1, 6, 24)}
    return {n: simulate(compose(line), 40.0, inputs={"line.inlet_flow": 1e-3}) for n, line in lines.items()}


def draw() -> Any:
    """The figure; returns a matplotlib figure."""
    import matplotlib.pyplot as plt

    with plt.rc_context(plot.PAPER):
        figure, ((torque, loss), (hand, mud)) = plt.subplots(2, 2, figsize=(9.0, 6.2), layout="constrained")
        times = np.linspace(0.0, 4.0, 2001)
        for style, (label, run) in zip(plot.LINES, start_up().items(), strict=False):
            torque.plot(times, run.at(times)["top.torque"] / 1e3, label=label, **style)
        torque.set(xlabel="time [s]", ylabel="torque at the top [kN m]", xlim=(0.0, 4.0))
        torque.set_title("Start of a stiff drive", loc="left", fontsize=9.0)
        torque.legend(frameon=False)

        for style, eta in zip(plot.LINES, (0.98, 0.95, 0.9), strict=False):
            loss.plot(RING_SPEEDS, 100.0 * differential(eta), label=f"teeth {100 * eta:.0f} %", **style)
        loss.axvline(20.0, color="0.7", linewidth=0.8, zorder=0)
        for speed, words in ((-20.0 / 3, "carrier stands"), (0.0, "ring stands"), (20.0, "turns as a block")):
            loss.axvline(speed, color="0.7", linewidth=0.8, zorder=0)
            loss.text(speed + 0.5, 84.3, words, fontsize=8.0, color="0.35", rotation=90, va="bottom")
        loss.set(xlabel="speed of the ring [rad/s]", ylabel="efficiency [%]", ylim=(84.0, 100.5), xlim=(RING_SPEEDS[0], RING_SPEEDS[-1]))
        loss.set_title("Differential, sun at 20 rad/s, carrier loaded", loc="left", fontsize=9.0)
        loss.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.12))

        dose, stuck = exposures()
        hand.fill_between(
            1e3 * BELT_SPEEDS, 0.0, 1.0, where=stuck > 0, transform=hand.get_xaxis_transform(), color=plot.BAND, label="stick-slip"
        )
        hand.plot(1e3 * BELT_SPEEDS, dose, label="A(8), 1 h a day", **plot.LINES[0])
        hand.set(
            xlabel="speed of the belt [mm/s]",
            ylabel="daily exposure [m/s$^2$]",
            xlim=(1e3 * BELT_SPEEDS[0], 1e3 * BELT_SPEEDS[-1]),
            ylim=(0.0, None),
        )
        hand.set_title("Hand that holds a rubbing block", loc="left", fontsize=9.0)
        hand.legend(frameon=False, loc="upper right", handlelength=1.5)

        times = np.linspace(0.0, 40.0, 4001)
        for style, (n, run) in zip(plot.LINES, circulation().items(), strict=False):
            mud.plot(times, run.at(times)["line.inlet_pressure"] / 1e5, label="one segment" if n == 1 else f"{n} segments", **style)
        for stress, words in ((STRENGTH, "gel\nstrength"), (YIELD, "yield\nstress")):
            level = 4 * stress * LENGTH / BORE / 1e5
            mud.axhline(level, color="0.6", linewidth=0.8, zorder=0)
            mud.annotate(words, (1.01, level), xycoords=("axes fraction", "data"), fontsize=8.0, color="0.35", va="center")
        mud.set(xlabel="time [s]", ylabel="pump pressure [bar]", xlim=(0.0, 40.0), ylim=(0.0, 20.0))
        mud.set_title("2500 m of gelled mud, pump at 1 l/s", loc="left", fontsize=9.0)
        mud.legend(frameon=False, ncols=3, loc="upper left")
    return figure


def main() -> None:
    """Write the figure."""
    import matplotlib

    matplotlib.use("Agg")
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else PATH
    path.parent.mkdir(parents=True, exist_ok=True)
    draw().savefig(path)
    print(path)


if __name__ == "__main__":
    main()
