"""How much of two finite-element studies of sliders can lumped models repeat? A table that says so, and where bristles go further.

    python -m studies sliders [FOLDER]            (default studies/figures)

Slider on a plate.  Spring k, damper c and mass m adhere to a plate with acceleration a until k a t^2 / 2 + c a t + m a = mu_s N.
Slider on an incline.  From rest it moves if and only if tan(angle) > mu.
Row of bristles.  A rounded contact of tangential stiffness k under N that is drawn by x sticks within |s| < a = sqrt(1 - q), q = 2 k x / (3 mu N):
    F = k x a + mu N [1 - (3 a - a^3) / 2]   for q < 1, mu N beyond; reversals follow Masing's rule.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from models import BristleContact, Coulomb, InclinedSlider, PlateContact, Slider
from studies.command_line import figure_folder
from studies.questions.critical_curve import critical_curve
from toolbox import compose, plot, simulate
from toolbox.inputs import ramp, sine
from toolbox.simulation.trajectory import Trajectory

ACCELERATION = 0.01 / 4.0
"""Of the plate [m/s2]: 0 to 10 mm/s in 4 s."""


# ---------------------------------------------------------------------------------------------------------------------------------- closed forms
def adhesion_time(slider: Slider, contact: PlateContact, acceleration: float) -> float:
    """Time [s] for which a slider adheres to a plate that speeds up evenly from rest: k a t^2 / 2 + c a t + m a = mu_s N."""
    static = contact.friction.static * contact.load  # type: ignore[attr-defined]
    spare = 2 * slider.stiffness * (static - slider.mass * acceleration) / acceleration
    return (-slider.damping + math.sqrt(slider.damping**2 + spare)) / slider.stiffness


def partial_slip(x: float, stiffness: float, bound: float) -> float:
    """Force [N] of a rounded contact drawn by x >= 0 [m] from rest; bound = mu N [N]; see the head of this file. Source: textbook."""
    q = 2 * stiffness * x / (3 * bound)
    a = math.sqrt(1 - q) if q < 1 else 0.0
    return stiffness * x * a + bound * (1 - (3 * a - a**3) / 2)


# ------------------------------------------------------------------------------------------------------------------------------------------ runs
def adhesion_run(slider: Slider | None = None, contact: PlateContact | None = None, duration: float = 0.6) -> Trajectory:
    """The slider on a plate whose speed rises to 10 mm/s over 4 s; the first `duration` seconds of it."""
    plant = compose(slider or Slider(), contact or PlateContact())
    return simulate(plant, duration, inputs={"plate.speed": ramp(0.0, 4.0 * ACCELERATION, 0.0, 4.0)}, accuracy=1e-8)


def critical_angle(mu: float) -> float:
    """Angle [rad] at which a slider on an incline starts to move, by bisection of runs."""
    friction = Coulomb(static=mu, kinetic=mu)

    def slides(_: float, angle: float) -> float:
        run = simulate(compose(InclinedSlider(angle=angle, friction=friction)), 0.01)
        return run.end - run.time_in("slope", "stick") - 1e-9

    return float(critical_curve(slides, [0.0], (0.01, 1.5), tolerance=1e-9)[0])


def loops(bristles: int, swings: tuple[float, ...]) -> list[Trajectory]:
    """One run per swing [m] of the plate under a resting slider: one and a half periods of 1 s, from rest."""
    plant = compose(BristleContact(bristles))
    return [
        simulate(plant, 1.5, inputs={"plate.speed": sine(0.0, -2 * math.pi * swing, 1.0, math.pi / 2)}, accuracy=1e-9) for swing in swings
    ]


def bristle_error(bristles: int) -> float:
    """Largest error of the force of a rounded contact drawn from rest to full slip and beyond, in parts of mu N."""
    model = BristleContact(bristles)
    bound = model.friction * model.load
    distance = 2.0 * bound / model.stiffness
    run = simulate(compose(model), 1.0, inputs={"plate.speed": distance}, accuracy=1e-9)
    times = np.linspace(0, 1, 2001)
    exact = np.array([partial_slip(distance * t, model.stiffness, bound) for t in times])
    return float(np.abs(run.at(times)["plate.drag"] - exact).max() / bound)


def regional_run(bristles: int = 64, pull: float = 4.5) -> Trajectory:
    """A slider on bristles on a fixed plate, pulled to and fro with an amplitude [N] at 20 Hz; its mass and springs are chosen to move."""
    plant = compose(Slider(mass=0.1, stiffness=1e4, damping=20.0), BristleContact(bristles))
    return simulate(plant, 0.2, inputs={"slider.pull": sine(0.0, pull, 20.0)}, accuracy=1e-8)


# ----------------------------------------------------------------------------------------------------------------------------------------- table
def table() -> list[tuple[str, str, str, str, str]]:
    """(paper, number or trend, paper's value, ours, verdict and why) for everything that the two papers report and that is known here."""
    slider, contact = Slider(), PlateContact()
    run = adhesion_run()
    release = run.events[0].time
    speed = 1e3 * run.at(release)["plate.speed"]
    exact = ACCELERATION * 0.225 * (slider.stiffness * 0.225 / 2 + slider.damping) + slider.mass * ACCELERATION
    load = exact / contact.friction.static  # type: ignore[attr-defined]
    incline = simulate(compose(InclinedSlider()), 12.0)
    own = math.sqrt(slider.stiffness / slider.mass)
    ratio = slider.damping / (2 * slider.mass * own)
    bristle = math.sqrt(BristleContact().stiffness / slider.mass) / (2 * math.pi)
    elastic = "no elastic body"
    hit = f"closed form; a load of {load:.2f} N, not 10 N, would hit it"
    return [
        ("plate", "adhesion ends at", "0.225 s", f"{release:.4f} s", f"reproduced within {100 * (release / 0.225 - 1):.1f} %: {hit}"),
        ("plate", "plate speed there", "0.5625 mm/s", f"{speed:.4f} mm/s", "reproduced alike: it is the adhesion time times 2.5 mm/s2"),
        (
            "plate",
            "slips as a whole, or by regions",
            "by regions",
            "as a whole",
            "not by one contact; a row of bristles of assumed stiffness does",
        ),
        ("plate", "contact stresses", "fields", "-", f"not reproduced: {elastic}; bristles give the share of each region only"),
        (
            "plate",
            "bands 0-75, 80-150, 1300-1600 Hz",
            "3 bands",
            "none",
            f"not reproduced: {elastic}; spring and damper: {ratio:.0f} times critical",
        ),
        ("plate", "a frequency of the contact", "-", f"{bristle:.0f} Hz", "of 7.8 g on bristles of 1e6 N/m: a choice, not a prediction"),
        ("incline", "moves if and only if tan a > mu", "19.29 deg", f"{math.degrees(critical_angle(0.35)):.3f} deg", "reproduced: exact"),
        (
            "incline",
            "at 45 deg",
            "slides",
            f"to {1e3 * incline.at(12.0)['slider.position']:.3f} mm",
            "reproduced: creeps to F (sin a - mu cos a) / k",
        ),
        ("incline", "contact stresses", "fields", "-", f"not reproduced: {elastic}"),
    ]


def trends() -> list[tuple[str, list[tuple[float, float, float]]]]:
    """(parameter, [(factor, adhesion time by a run, by the closed form)]) for every number that enters the adhesion time."""
    slider, contact = Slider(), PlateContact()

    def changed(name: str, factor: float) -> tuple[Slider, PlateContact]:
        if name in ("stiffness", "damping", "mass"):
            return replace(slider, **{name: factor * getattr(slider, name)}), contact
        if name == "load":
            return slider, replace(contact, load=factor * contact.load)
        law = contact.friction
        low = min(law.kinetic, factor * law.static)  # type: ignore[attr-defined]
        return slider, replace(contact, friction=replace(law, static=factor * law.static, kinetic=low))  # type: ignore[attr-defined,call-arg]

    found = []
    for name in ("stiffness", "damping", "mass", "load", "static friction"):
        rows = []
        for factor in (0.5, 1.0, 2.0):
            parts = changed(name, factor)
            expected = adhesion_time(*parts, ACCELERATION)
            run = adhesion_run(*parts, duration=1.01 * expected)
            rows.append((factor, run.events[0].time, expected))
        found.append((name, rows))
    return found


# --------------------------------------------------------------------------------------------------------------------------------------- pictures
def draw_adhesion(run: Trajectory) -> Any:
    """The dragged slider: speeds of plate and slider, and the friction that it takes, with the end of adhesion."""
    import matplotlib.pyplot as plt

    release = run.events[0].time
    with plt.rc_context(plot.PAPER):
        figure, (left, right) = plt.subplots(1, 2, figsize=(7.6, 2.8), layout="constrained")
        times = np.union1d(np.linspace(0, run.end, 3000), release + np.linspace(-1e-4, 1e-4, 201))
        samples = run.at(times)
        left.plot(times, 1e3 * samples["plate.speed"], label="plate", **plot.LINES[1])
        left.plot(times, 1e3 * samples["slider.speed"], label="slider", **plot.LINES[0])
        left.set(xlabel="time [s]", ylabel="speed [mm/s]", xlim=(0, run.end), ylim=(0, None))
        left.axvspan(0, release, color=plot.BAND, zorder=0)
        left.text(release / 2, 0.9, "adheres", transform=left.get_xaxis_transform(), ha="center", fontsize=8)
        left.plot([0.225], [0.5625], "o", markerfacecolor="white", color="black", markersize=5, label="end in the paper")
        left.legend(frameon=False, loc="upper left", bbox_to_anchor=(0.02, 0.86))
        right.plot(times, samples["plate.drag"], **plot.LINES[0])
        right.axvspan(0, release, color=plot.BAND, zorder=0)
        right.set(xlabel="time [s]", ylabel="drag of the plate [N]", xlim=(0, run.end), ylim=(0, 3.8))
    return figure


def draw_bristles(runs: list[Trajectory], regional: Trajectory) -> Any:
    """Hysteresis loops of a rounded contact, and where a slider on bristles sticks and slips over time."""
    import matplotlib.pyplot as plt

    with plt.rc_context(plot.PAPER):
        figure = plt.figure(figsize=(7.6, 3.9), layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.25), height_ratios=(2.0, 1.0))
        left, region, share = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1]), figure.add_subplot(grid[1, 1])
        model = BristleContact()
        bound = model.friction * model.load
        for run, style in zip(runs, plot.LINES, strict=False):
            times = np.linspace(0, run.end, 3000)
            samples = run.at(times)
            speed = samples["plate.speed"]
            x = np.concatenate([[0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(times))])
            swing = rf"swing of {1e6 * np.abs(x).max():.2g} $\mu$m"
            left.plot(-1e6 * x, -samples["plate.drag"], label=swing, **{**style, "linewidth": 1.1})
        x = np.linspace(0, 9e-6, 200)
        left.plot(
            1e6 * x,
            [partial_slip(d, model.stiffness, bound) for d in x],
            color="black",
            linestyle=(0, (1, 2)),
            linewidth=1.4,
            label="theory, loading",
        )
        left.set(xlabel=r"displacement of the slider [$\mu$m]", ylabel="force on it [N]", ylim=(None, 6.2))
        left.legend(frameon=False, loc="upper left")
        n = len([name for name in regional.modes if name.startswith("plate.")])
        times = np.linspace(0.1, regional.end, 1200)
        modes = regional.at(times).modes
        slips = np.array([modes[f"plate.{i}"] == "slip" for i in range(n)])
        direction = np.sign(regional.at(times)["slider.speed"])
        region.imshow(np.where(slips, np.where(direction > 0, 0.85, 0.6), 0.15), aspect="auto", cmap="gray", vmin=0, vmax=1,
                      extent=(times[0], times[-1], -1, 1), interpolation="nearest", origin="lower")  # fmt: skip
        region.set(ylabel="place in the contact,\nparts of its half-width")
        region.set_title("dark: stick, grey: slip (light: forward)", loc="left", fontsize=8.5)
        region.tick_params(labelbottom=False)
        share.plot(times, 1 - slips.mean(axis=0), **plot.LINES[0])
        share.set(xlabel="time [s]", ylabel="part stuck", xlim=(times[0], times[-1]), ylim=(-0.05, 1.05))
    return figure


def main() -> None:
    """Print the tables and write the figures."""
    folder = figure_folder()

    for paper, what, theirs, ours, verdict in table():
        print(f"{paper:8} {what:36} {theirs:12} {ours:14} {verdict}")
    print("\nAdhesion time [s] where one number is halved, kept, doubled: run (closed form)\n")
    for name, rows in trends():
        print(f"{name:16}" + "   ".join(f"{found:.5f} ({expected:.5f})" for _, found, expected in rows))
    print(
        "\nBristles: largest error of the force on the way to full slip, in parts of mu N; events and time of 0.2 s of the pulled slider\n"
    )
    for n in (1, 4, 8, 16, 32, 64, 128):
        run = regional_run(n)
        print(f"{n:5d}{bristle_error(n):12.1e}{len(run.events):8d}{1e3 * run.wall_time:10.2f} ms")
    draw_adhesion(adhesion_run()).savefig(folder / "slider_adhesion.png")
    draw_bristles(loops(64, (1.5e-6, 3.5e-6, 7e-6)), regional_run()).savefig(folder / "bristle_contact.png")


if __name__ == "__main__":
    main()
