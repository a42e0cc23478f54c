"""Where does a machine under an alternating load or set-point leave its rhythm? Neimark-Sacker bifurcations of forced cycles, and the tori beyond.

Block.  Thomsen and Fidlin's block on its belt under a dithered normal load N (1 + depth sin W t), m x'' + c x' + k x = N(t) mu(v_b - x'). While it slides,
its monodromy matrix M over a period T obeys Liouville:

    det M = exp(-int_0^T (c + N(t) mu'(v_b - x')) / m dt)

so that a pair of complex multipliers passes the unit circle where damping and falling friction balance over a period. Dither moves that speed by little
from the Hopf speed of the block alone. Below it the motion goes round on a torus: struck once a period, it draws a closed curve and never returns.
    Two consequences of det M for a block alone.  Undamped under falling friction, as Leine's, det M > 1: no cycle in pure slip attracts, at any frequency
and depth, and none has a Neimark-Sacker point. What calms the block in the band of `studies.questions.dither` is no such cycle.  A cycle that sticks
forgets a direction, det M = 0: the multiplier that is left is real. A torus that is born from cycles with stick needs more than one mass.

Drill string.  It has more: Jansen's rig sticks and slips in step with a set-point that swings enough, once in its period of 5.4 s, under soft torque sampled
at 10 Hz. Where the swing is too small the bit leaves the rhythm by a Neimark-Sacker bifurcation of a cycle that sticks in every period. This one is hard:
no torus attracts beyond it, and the bit spirals away to a rhythm of three periods, which is there before the bifurcation, too.

    python -m studies torus [FOLDER]          (default studies/figures; writes torus.png, some seconds)
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from controllers import SoftTorque
from models import BitRock, oscillators, wells
from studies.command_line import figure_folder
from toolbox import ClosedLoop, closed_loop, compose, follow, limit_cycle, plot, simulate
from toolbox.inputs import sine
from toolbox.orbits import Branch, Cycle

BLOCK = oscillators.THOMSEN_FIDLIN
DEPTH, RATIO = 0.5, math.sqrt(8.0)
PERIOD = 2 * math.pi / RATIO
"""Of the dither [s]; the natural frequency of the block is 1 rad/s."""

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
SWING_PERIOD, SAMPLE = 5.4, 0.1


def load(depth: float = DEPTH) -> Any:
    """The dithered normal load."""
    return sine(BLOCK.load, depth * BLOCK.load, 1 / PERIOD)


def dithered(speed: float = 0.5, depth: float = DEPTH) -> Cycle:
    """The cycle of the block in pure slip at a belt speed [m/s] at which it attracts."""
    return limit_cycle(
        closed_loop(
            compose(BLOCK), inputs={"block.load": load(depth)}, parameters={"block.belt_speed": speed}, start={"block.position": 0.3}
        ),
        400.0,
    )


def slowing(cycle: Cycle) -> Branch:
    """That cycle as the belt slows down."""
    return follow(cycle, "block.belt_speed", (0.3, 0.6), points=60, start_towards=0.3)


def struck(speed: float, settle: int = 2000, count: int = 400) -> np.ndarray:
    """Position and speed of the block once a period of the dither, shape (count, 2)."""
    times = PERIOD * np.arange(settle, settle + count)
    run = simulate(compose(BLOCK), times[-1], parameters={"block.belt_speed": speed}, inputs={"block.load": load()}, start={"block.position": 0.3},
                   output_times=times, accuracy=1e-9)  # fmt: skip
    return run.states


def swung(amplitude: float) -> ClosedLoop:
    """The drill string with a set-point that swings so much [rad/s]."""
    return closed_loop(RIG, SoftTorque(), sample_time=SAMPLE, inputs={"top.reference": sine(6.0, amplitude, 1 / SWING_PERIOD)})


def entrained(amplitude: float = 2.0) -> Cycle:
    """The stick-slip cycle of the drill string in step with its set-point."""
    return limit_cycle(swung(amplitude), 80 * SWING_PERIOD)


def loosening(cycle: Cycle, points: int = 45) -> Branch:
    """That cycle as the swing of the set-point gets smaller."""
    return follow(cycle, "top.reference.amplitude", (0.3, 3.5), points=points, start_towards=0.3)


def strobed(cycle: Cycle, amplitude: float, count: int = 600) -> np.ndarray:
    """States of the drill string once a period, shape (count, 3), from a thousandth beside a cycle."""
    x = cycle.start
    start = {"chain.twist": x[:1], "chain.speed": x[1:3] * (1.0, 1.001), "softtorque.angle": float(cycle.memory[0])}
    times = SWING_PERIOD * np.arange(count)
    return simulate(swung(amplitude), times[-1], start=start, output_times=times, accuracy=1e-9).states


def draw(block: Branch, string: Branch) -> Any:
    """Multipliers along both branches, and what is struck once a period on both sides of the bifurcation."""
    import matplotlib.pyplot as plt

    figure, grid = plt.subplots(2, 2, figsize=(plot.WIDTH, 6.4), layout="constrained")
    panels = grid.ravel()
    angle = np.linspace(0.0, 2 * np.pi, 200)
    for panel, branch, title in ((panels[0], block, "Dithered block, belt at"), (panels[2], string, "Drill string, swing of")):
        panel.plot(np.cos(angle), np.sin(angle), color="0.6", linewidth=0.8)
        for cycle in branch.cycles:
            inside = np.abs(cycle.multipliers) < 1.4
            mark = {"marker": "o", "markersize": 2.6, "linestyle": "none", "color": "0.1" if cycle.stable else "0.65"}
            panel.plot(cycle.multipliers.real[inside], cycle.multipliers.imag[inside], **mark)
        panel.plot([], [], "o", color="0.1", markersize=3.5, label="stable")
        panel.plot([], [], "o", color="0.65", markersize=3.5, label="unstable")
        point = next(p for p in branch.bifurcations if p.kind == "Neimark-Sacker")
        pair = point.cycle.multipliers[np.abs(point.cycle.multipliers.imag) > 1e-6]
        panel.plot(pair.real, pair.imag, "D", color=plot.LINES[1]["color"], markersize=6, markeredgecolor="0.1", markeredgewidth=0.6,
                   label="leaves the circle")  # fmt: skip
        if branch is block:
            panel.legend(frameon=False, fontsize=8.0, loc="center right", bbox_to_anchor=(0.9, 0.5))
        panel.set(xlabel="multiplier, real part", ylabel="imaginary part", aspect="equal", xlim=(-1.3, 1.3), ylim=(-1.3, 1.3))
        panel.set_title(f"{title} {point.value:.4g} {branch.unit}", loc="left", fontsize=9.0)
    for speed, shade in ((0.445, "0.1"), (0.43, "0.35"), (0.41, "0.6")):
        points = struck(speed)
        panels[1].plot(*points.T, ".", markersize=2.5 if speed < 0.44 else 8.0, color=shade, label=f"belt {speed:g} m/s")
    panels[1].set(xlabel="position once a period [m]", ylabel="speed [m/s]")
    begin = next(p for p in string.bifurcations if p.kind == "Neimark-Sacker").cycle
    for amplitude, marker in ((1.295, "o"), (1.28, ".")):
        points = strobed(begin, amplitude)
        panels[3].plot(points[:, 0], points[:, 2], marker, markersize=3.5, color="0.1" if marker == "o" else "0.5", linestyle="none",
                       label=f"swing {amplitude:g} rad/s", zorder=3 if marker == "o" else 2)  # fmt: skip
    panels[3].plot(*strobed(begin, 1.28)[-3:, [0, 2]].T, "s", color=plot.LINES[1]["color"], markersize=5, label="its end: three periods")
    panels[3].set(xlabel="twist once a period [rad]", ylabel="bit speed [rad/s]")
    for panel in (panels[1], panels[3]):
        low, high = panel.get_ylim()
        panel.set_ylim(low, high + 0.35 * (high - low))
        panel.legend(frameon=False, fontsize=8.0, loc="upper left")
    return figure


def main() -> None:
    """Print the numbers and write the figure."""
    import matplotlib.pyplot as plt

    folder = figure_folder()
    block, string = slowing(dithered()), loosening(entrained())
    print(block)
    print(f"Hopf speed of the block without dither: {oscillators.hopf_speed(BLOCK):.6f} m/s")
    print(string)
    torus = string.bifurcations[0]
    print(
        f"at {torus.value:.6g} rad/s the bit sticks for {100 * torus.cycle.stick_share('bit'):.1f} % of the period, multipliers {torus.cycle.multipliers}"
    )
    for amplitude in (1.295, 1.28):
        points = strobed(torus.cycle, amplitude)
        away, thrice = (np.abs(points[-1] - points[-1 - k]).max() for k in (1, 3))
        print(
            f"from beside that cycle with a swing of {amplitude:g} rad/s: in the end {away:.1e} away after a period, {thrice:.1e} after three"
        )
    with plt.rc_context(plot.PAPER):
        draw(block, string).savefig(folder / "torus.png", dpi=120)
        print(folder / "torus.png")


if __name__ == "__main__":
    main()
