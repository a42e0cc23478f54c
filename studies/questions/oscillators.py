"""Do the small machines do what theory says, and what calms them?

Prints closed forms beside simulated values, then draws
    oscillators_belt.png     amplitude against belt speed: Thomsen-Fidlin's three ranges, Veraszto-Stepan's two stable motions
    oscillators_load.png     Leine's block under an alternating load: band of suppression, return map, largest Lyapunov exponent
    oscillators_cures.png    tuned absorber, friction damper, friction averaged by dither
    oscillators_brake.png    a stop with groan, and the flutter boundary of squeal

    python -m studies oscillators [FOLDER]       (default studies/figures; about two minutes)
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from models import (
    Absorber,
    Block,
    BlockOnBelt,
    Coulomb,
    Dahl,
    DiscBrake,
    Exponential,
    FrictionDamper,
    GuideContact,
    SquealingPad,
    averaged_friction,
    oscillators,
)
from studies.command_line import figure_folder
from studies.questions.lyapunov import lyapunov
from toolbox import HybridSystem, Trajectory, compose, energy_audit, equilibrium, linearise, measure, simulate
from toolbox.inputs import sine

FALLING = BlockOnBelt(damping=0.05, friction=Exponential(static=1.0, kinetic=0.5, decay=3.0))
RATIO = 0.1  # mass of the absorber in parts of the block's


# --- answers


def swing(run: Trajectory, signal: str, after: float) -> float:
    """Half of the range of a signal after the transient."""
    found = measure.extent(run, signal, after)
    return (found.maximum - found.minimum) / 2


def on_belt(block: BlockOnBelt, speed: float, duration: float, start: dict[str, float], *parts: Any) -> tuple[float, float]:
    """(amplitude of the position, part of the time in stick) over the last tenth of a run."""
    run = simulate(compose(dataclasses.replace(block, belt_speed=speed), *parts), duration, start=start)
    return swing(run, "block.position", 0.9 * duration), measure.stuck_ratio(run, "belt", 0.9 * duration)


def resting(block: BlockOnBelt, speed: float) -> float:
    """Position of steady sliding."""
    return equilibrium(compose(dataclasses.replace(block, belt_speed=speed)), mode={"belt": "slip-"})["block.position"]


def damper_loss(load: float) -> float:
    """Friction energy per slow cycle of amplitude 1 m, of a damper of 1 N/m on a block too stiff to notice it."""
    damper = FrictionDamper(stiffness=1.0, damping=0.02, slider_mass=1e-4, load=load, friction=Coulomb(static=1.0, kinetic=1.0))
    plant, w = compose(Block(stiffness=1e4), damper), 2 * math.pi / 20
    inputs = {"block.force": sine(0.0, 1e4 - w**2, 0.05)}
    lost = [energy_audit(simulate(plant, n * 20.0, start={"block.speed": w}, inputs=inputs)).losses["damper.friction"] for n in (2, 3)]
    return lost[1] - lost[0]


def highest_resonance(load: float) -> float:
    """Largest amplitude over frequency of a block forced with 0.1 N, with a friction damper as stiff as its own spring."""
    plant = compose(Block(damping=0.02), FrictionDamper(load=load, friction=Coulomb(static=1.0, kinetic=1.0)))
    amplitudes = []
    for w in np.linspace(0.95, 1.5, 12):
        run = simulate(plant, 500.0, inputs={"block.force": sine(0.0, 0.1, w / (2 * math.pi))})
        amplitudes.append(swing(run, "block.position", 450.0))
    return max(amplitudes)


def dithered(speed: float, amplitude: float = 0.5, w: float = 60.0) -> float:
    """Friction that the spring of a block carries on average while a force shakes it along the belt."""
    block = BlockOnBelt(damping=0.5, belt_speed=speed, friction=Coulomb(static=0.3, kinetic=0.3))
    run = simulate(compose(block), 120.0, inputs={"block.force": sine(0.0, w * amplitude, w / (2 * math.pi), math.pi / 2)})
    return measure.extent(run, "block.position", 60.0, 60.0 + 500 * 2 * math.pi / w).mean


def largest_pole(plant: HybridSystem, element: str) -> float:
    """Largest real part of the poles of steady sliding."""
    return float(linearise(plant, equilibrium(plant, mode={element: "slip-"})).poles().real.max())


def crossing(grows: Any, low: float, high: float) -> float:
    """Where the largest pole changes sign."""
    from scipy.optimize import brentq

    return brentq(grows, low, high, xtol=1e-12)


def checks() -> list[tuple[str, float, float]]:
    """(quantity, closed form, as simulated or from the poles of the linearised plant)."""
    rows = []
    for name in ("THOMSEN_FIDLIN", "VERASZTO_STEPAN"):
        block = getattr(oscillators, name)
        hopf = oscillators.hopf_speed(block)
        found = crossing(lambda v, b=block: largest_pole(compose(dataclasses.replace(b, belt_speed=v)), "belt"), 0.8 * hopf, 1.2 * hopf)
        rows.append((f"Hopf speed of {name} [m/s]", hopf, found))
    fidlin = oscillators.THOMSEN_FIDLIN
    hopf = oscillators.hopf_speed(fidlin)
    for ratio in (0.95, 0.98):
        amplitude, _ = on_belt(fidlin, ratio * hopf, 4000.0, {"block.position": resting(fidlin, ratio * hopf) + 0.1})
        rows.append((f"amplitude at {ratio} of it (first order) [m]", 2 * hopf * math.sqrt(1 - ratio**2), amplitude))
    r, share = 1.3, 0.5
    v, u = 1 / (1 - r * r), math.sin(math.pi / r) / (r * (1 + math.cos(math.pi / r)))
    den_hartog = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=share, kinetic=share)))
    run = simulate(den_hartog, 200 * 2 * math.pi / r, inputs={"block.force": sine(0.0, 1.0, r / (2 * math.pi))})
    rows.append(("Den Hartog, F/P = 0.5, r = 1.3 [m]", math.sqrt(v * v - share**2 * u * u), swing(run, "block.position", 0.9 * run.end)))
    bearable = 2 * Absorber.max_negative_damping(RATIO)
    tuned = Absorber.tuned(FALLING, RATIO)
    onset = math.log(1.5 / (0.05 + bearable)) / 3
    found = crossing(lambda v: largest_pole(compose(dataclasses.replace(FALLING, belt_speed=v), tuned), "belt"), 0.7 * onset, 1.3 * onset)
    rows.append(("onset with tuned absorber [m/s]", onset, found))
    rows.append(("onset without [m/s]", math.log(1.5 / 0.05) / 3, crossing(
        lambda v: largest_pole(compose(dataclasses.replace(FALLING, belt_speed=v)), "belt"), 0.8, 1.5)))  # fmt: skip
    rows.append(("friction under dither, v = B/2 [N]", 0.3 * 2 / math.pi * math.asin(0.5), dithered(0.25)))
    rows.append(("Jenkins element, loss of a cycle at half load [J]", 1.0, damper_loss(0.5)))
    sliding = simulate(
        compose(Block(mass=1e12, stiffness=0.0), GuideContact(friction=Dahl(stiffness=40.0, kinetic=0.8))), 0.1, start={"block.speed": 0.25}
    )
    rows.append(("Dahl's force after 25 mm [N]", 0.8 * -math.expm1(-40 * 0.025 / 0.8), sliding.at(0.1)["guide.drag"]))
    pad = SquealingPad()
    found = crossing(lambda mu: largest_pole(compose(dataclasses.replace(pad, friction=Coulomb(static=mu, kinetic=mu))), "pad"), 0.5, 1.0)
    rows.append(("flutter of the squealing pad [1]", pad.flutter_friction(), found))
    brake = DiscBrake(friction=Coulomb(static=0.4, kinetic=0.4))
    stop = simulate(compose(brake), 3.0, start={"disc.speed": 4.0})
    rows.append(("time to standstill from 4 rad/s, mu 0.4 [s]", 4 * 36 / (2 * 0.4 * 1000 * 0.12), stop.intervals("pad")[-1][0]))
    exponent, _ = lyapunov(compose(Block(mass=2.0, stiffness=8.0, damping=0.4)), {"block.force": sine(0.0, 1.0, 0.2)}, 5.0, 60, skip=2)
    rows.append(("Lyapunov exponent of a damped oscillator [1/s]", -0.1, exponent))
    return rows


# --- figures


def draw_belt(plt: Any) -> Any:
    """Amplitude against belt speed of two published oscillators."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.4), layout="constrained")
    block = oscillators.THOMSEN_FIDLIN
    hopf = oscillators.hopf_speed(block)
    low = math.sqrt(0.8) * hopf
    speeds = np.concatenate([np.linspace(0.02, 1.0, 22) * low, low + np.linspace(0.1, 1.2, 9) * (hopf - low)])
    found = [on_belt(block, speed, 3000.0, {"block.position": resting(block, speed) + 0.1}) for speed in speeds]
    _branch(left, speeds, found, "simulated")
    fine = np.linspace(low, hopf, 100)
    left.plot(fine, 2 * np.sqrt(hopf**2 - fine**2), color="black", linewidth=1.0, label=r"first order, $2\sqrt{v_{b1}^2 - v_b^2}$")
    for speed, label in ((low, r"$v_{b0}$"), (hopf, r"$v_{b1}$")):
        left.axvline(speed, color="0.5", linewidth=0.7, linestyle=":")
        left.annotate(label, (speed, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2), textcoords="offset points", ha="center")
    left.set(xlabel="belt speed [m/s]", ylabel="amplitude of the position [m]", ylim=(-0.008, None), xlim=(0, None))
    left.set_title("Thomsen and Fidlin", loc="left", fontsize=9.0, pad=12.0)
    left.legend(frameon=False, fontsize=8.0, loc="lower right", bbox_to_anchor=(0.84, 0.02))
    block = oscillators.VERASZTO_STEPAN
    hopf = oscillators.hopf_speed(block)
    speeds = np.linspace(0.1, 0.36, 40)
    stuck = [on_belt(block, speed, 60.0, {"block.speed": speed}) for speed in speeds]
    near = [on_belt(block, speed, 60.0, {"block.position": resting(block, speed) + 2e-5}) for speed in speeds]
    _branch(right, speeds, [(1e3 * a, s) for a, s in stuck], "started in stick")
    right.plot(speeds, [1e3 * a for a, _ in near], "+", color="0.45", markersize=7, label="started near rest")
    right.axvline(hopf, color="0.5", linewidth=0.7, linestyle=":")
    right.annotate("Hopf", (hopf, 0.95), xycoords=("data", "axes fraction"), xytext=(-3, 0), textcoords="offset points", ha="right")
    right.set(xlabel="belt speed [m/s]", ylabel="amplitude of the position [mm]", ylim=(-0.05, None))
    right.set_title("Veraszto and Stepan", loc="left", fontsize=9.0, pad=12.0)
    right.legend(frameon=False, fontsize=8.0, loc="lower right", bbox_to_anchor=(1.0, 0.12))
    return figure


def _branch(ax: Any, speeds: np.ndarray, found: list[tuple[float, float]], label: str) -> None:
    """Points of a branch, filled where the motion sticks."""
    amplitude, stuck = np.array(found).T
    ax.plot(speeds[stuck > 0], amplitude[stuck > 0], "o", color="black", markersize=4, label=f"{label}, with stick")
    ax.plot(speeds[stuck == 0], amplitude[stuck == 0], "o", color="black", markersize=4, fillstyle="none", label=f"{label}, only slip")


def draw_load(plt: Any) -> Any:
    """Swing, return map and largest exponent of Leine's block against the frequency of its load."""
    plant = compose(oscillators.LEINE)
    figure, panels = plt.subplots(3, 1, figsize=(7.0, 6.6), sharex=True, layout="constrained", height_ratios=(1, 1.1, 0.8))
    ratios = np.geomspace(0.3, 12.0, 150)
    alone = swing(simulate(plant, 500.0), "block.position", 300.0)
    for depth, style in ((0.5, {"color": "0.55", "linewidth": 1.0}), (0.95, {"color": "black", "linewidth": 1.2})):
        found = [swing(simulate(plant, 500.0, inputs=_load(depth, ratio)), "block.position", 300.0) for ratio in ratios]
        panels[0].plot(ratios, found, label=f"load 1 + {depth:g} sin", **style)
    panels[0].axhline(alone, color="black", linewidth=0.8, linestyle="--", label="steady load")
    panels[0].set(ylabel="amplitude [m]", ylim=(0, None))
    panels[0].legend(frameon=False, fontsize=8.0, loc="upper right")
    exponents = []
    for ratio in ratios:
        period = 2 * math.pi / ratio
        exponent, section = lyapunov(plant, _load(0.95, ratio), period, max(80, round(300 / period)), skip=max(40, round(200 / period)))
        exponents.append(exponent)
        panels[1].plot(np.full(80, ratio), section[-80:, 0], ".", color="black", markersize=1.2, markeredgewidth=0)
    panels[1].set(ylabel="position once\nper period [m]")
    panels[2].plot(ratios, exponents, color="black", linewidth=1.0)
    panels[2].axhline(0, color="0.5", linewidth=0.7)
    panels[2].set(
        ylabel="largest Lyapunov\nexponent [1/s]", xlabel="frequency of the load / natural frequency", xscale="log", ylim=(-0.7, 0.4)
    )
    panels[2].set_xticks([0.3, 0.5, 1, 2, 3, 5, 10], ["0.3", "0.5", "1", "2", "3", "5", "10"])
    panels[2].minorticks_off()
    panels[2].set_xlim(ratios[0], ratios[-1])
    for panel in panels:
        panel.axvspan(2, 5, facecolor="0.92", zorder=0)
    panels[0].annotate("band of suppression", (math.sqrt(10), 0.03), xycoords=("data", "axes fraction"), ha="center", fontsize=8.0)
    return figure


def _load(depth: float, ratio: float) -> dict[str, Any]:
    return {"block.load": sine(1.0, depth, ratio / (2 * math.pi))}


def draw_cures(plt: Any) -> Any:
    """Absorber, friction damper and dither."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(10.5, 3.3), layout="constrained")
    speeds = np.linspace(0.1, 1.4, 27)
    tuned = Absorber.tuned(FALLING, RATIO)
    for parts, word, marker in (((), "alone", "o"), ((tuned,), "absorber", "s")):
        stuck = [on_belt(FALLING, speed, 800.0, {}, *parts)[1] for speed in speeds]
        fill = "full" if not parts else "none"
        left.plot(speeds, stuck, marker, color="black", markersize=4, fillstyle=fill, label=word)
    for negative, word in ((0.0, "poles, alone"), (2 * Absorber.max_negative_damping(RATIO), "poles, absorber")):
        onset = math.log(1.5 / (0.05 + negative)) / 3
        left.axvline(onset, color="0.4", linewidth=0.8, linestyle=":")
        left.annotate(word, (onset, 0.97), xycoords=("data", "axes fraction"), xytext=(-2, 0), textcoords="offset points", rotation=90, va="top", ha="right",
                      fontsize=7.5)  # fmt: skip
    left.set(xlabel="belt speed [m/s]", ylabel="part of the time in stick", ylim=(-0.02, None))
    left.legend(frameon=False, fontsize=8.0, loc="upper center", bbox_to_anchor=(0.56, 1.0))
    left.set_title("tuned absorber, a tenth of the mass", loc="left", fontsize=9.0)
    loads = np.geomspace(0.01, 1.5, 25)
    middle.semilogx(loads, [highest_resonance(load) for load in loads], color="black", label="highest resonance [m]")
    slow = np.geomspace(0.01, 1.5, 16)
    middle.plot(slow, [damper_loss(load) for load in slow], "o", color="0.4", markersize=4, label="loss of a slow cycle [J]")
    fine = np.geomspace(0.01, 1.0, 100)
    middle.plot(fine, 4 * fine * (1 - fine), color="0.4", linewidth=0.9, linestyle="--", label=r"$4 F (X - F/k)$ [J]")
    middle.set(xlabel="load of the damper [N]", ylabel="resonance [m], loss of a cycle [J]")
    middle.set_title("friction damper", loc="left", fontsize=9.0)
    middle.legend(frameon=False, fontsize=7.5, loc="upper right")
    middle.set_ylim(-0.06, 3.8)
    mean = np.linspace(0.0, 0.8, 17)
    right.plot(mean, [dithered(speed) for speed in mean], "o", color="black", markersize=4, label="simulated")
    fine = np.linspace(0, 0.8, 200)
    right.plot(
        fine,
        [averaged_friction(Coulomb(static=0.3, kinetic=0.3), v, 0.5) for v in fine],
        color="0.4",
        label=r"$\frac{2}{\pi}\mu\,\arcsin(v/B)$, $\mu$ beyond",
    )
    right.plot(fine, np.full_like(fine, 0.3), color="0.4", linestyle=":", label="without dither")
    right.set(xlabel="speed of the belt [m/s]", ylabel="mean friction [N]", ylim=(-0.006, 0.36))
    right.set_title("dither along the belt, B = 0.5 m/s", loc="left", fontsize=9.0)
    right.legend(frameon=False, fontsize=8.0, loc="lower right")
    return figure


def draw_brake(plt: Any) -> Any:
    """A stop with groan, and poles and growth of a squealing pad."""
    figure = plt.figure(figsize=(10.0, 4.2), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.5, 1.0), wspace=0.05)
    run = simulate(compose(DiscBrake()), 0.85, start={"disc.speed": 2.0})
    times = np.union1d(run.time, np.linspace(0, run.end, 6001))
    samples = run.at(times)
    rows = (
        ("rim and pad\nspeed [m/s]", None),
        ("pad\nposition [mm]", 1e3 * samples["pad.position"]),
        ("brake torque\n[N m]", samples["brake.torque"]),
    )
    for i, (label, values) in enumerate(rows):
        panel = figure.add_subplot(grid[i, 0])
        for begin, end in measure.stick_intervals(run, "pad"):
            panel.axvspan(begin, end, facecolor="0.88", linewidth=0, zorder=0)
        if values is None:
            panel.plot(times, samples["pad.speed"], color="black", linewidth=0.8, label="pad")
            panel.plot(times, 0.12 * samples["disc.speed"], color="0.45", linewidth=1.4, label="disc at the pad")
            panel.legend(frameon=False, fontsize=8.0, loc="upper right", ncols=2)
            panel.set_ylim(None, 0.42)
            panel.set_title("stop from 2 rad/s under 1 kN, grey where the pad sticks", loc="left", fontsize=9.0)
        else:
            panel.plot(times, values, color="black", linewidth=0.8)
        panel.set(ylabel=label, xlim=(0, run.end))
        if i < 2:
            panel.tick_params(labelbottom=False)
    panel.set_xlabel("time [s]")
    pad = dataclasses.replace(SquealingPad(), damping=0.0)
    coefficients = np.linspace(0, 1.2, 241)
    poles = []
    for mu in coefficients:
        plant = compose(dataclasses.replace(pad, friction=Coulomb(static=mu, kinetic=mu)))
        found = linearise(plant, equilibrium(plant, mode={"pad": "slip-"})).poles()
        poles.append(sorted(found[found.imag > 0], key=lambda pole: (round(pole.imag, 9), pole.real)))
    poles = np.array(poles)
    top, bottom = figure.add_subplot(grid[:2, 1]), figure.add_subplot(grid[2, 1])
    top.plot(coefficients, poles.imag, color="black", linewidth=1.1)
    top.set(ylabel="frequencies [rad/s]")
    top.tick_params(labelbottom=False)
    top.set_title("squeal: two frequencies meet", loc="left", fontsize=9.0)
    bottom.plot(coefficients, poles.real, color="black", linewidth=1.1)
    bottom.set(ylabel="growth [1/s]", xlabel="coefficient of friction")
    for panel in (top, bottom):
        panel.axvline(pad.flutter_friction(), color="0.5", linewidth=0.8, linestyle=":")
        panel.set_xlim(0, 1.2)
    top.annotate(
        "closed form",
        (pad.flutter_friction(), 0.02),
        xycoords=("data", "axes fraction"),
        xytext=(3, 0),
        textcoords="offset points",
        fontsize=8.0,
    )
    return figure


def main() -> None:
    """Print the checks and write the figures."""
    import matplotlib.pyplot as plt

    from toolbox import plot

    print(f"{'':<52}{'closed form':>14}{'found':>14}{'difference':>13}")
    for name, theory, found in checks():
        print(f"{name:<52}{theory:>14.6g}{found:>14.6g}{found / theory - 1:>13.1e}")
    folder = figure_folder()
    for name, draw in (("belt", draw_belt), ("load", draw_load), ("cures", draw_cures), ("brake", draw_brake)):
        with plt.rc_context(plot.PAPER):
            figure = draw(plt)
            figure.savefig(folder / f"oscillators_{name}.png")
            plt.close(figure)
        print(folder / f"oscillators_{name}.png")


if __name__ == "__main__":
    main()
