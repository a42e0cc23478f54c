"""How does a stack of disks come to rest? Stick-slip of eight rotors, from a reconstruction after Larsson and Farhang.

    python -m studies disk_stack [FOLDER]            (default studies/figures)

Friction falls with speed, so below some speed of the wheel a disk in steady slip is pushed more than its mount damps it, and sticks at last. In the rhythm
that follows, slips last as long as the keys of the rotors swing, and sticks as long as the wheel takes to wind them up again: longer and longer.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from models import DiskStack
from studies.command_line import figure_folder
from studies.questions.disks import rest_of
from toolbox import compose, measure, plot, simulate
from toolbox.inputs import ramp
from toolbox.simulation.trajectory import Trajectory


def stack_stop(stack: DiskStack | None = None, speed: float = 3.0, clamping: float = 0.05, accuracy: float = 1e-10) -> Trajectory:
    """Stop of a stack from a wheel speed [rad/s] > 0: its actuator force rises from a twentieth to all of it in `clamping` seconds.

    Closed faces from the start: with no force on them at all, bounds and gaps would begin at zero together. The steady slip before
    stick-slip multiplies errors some million times, so that single cycles need an accuracy of 1e-10.
    """
    stack = stack or DiskStack()
    turning = np.where(np.arange(2 * stack.rotors + 1) % 2 == 1, speed, 0.0)
    start = {"stack.wheel_speed": speed, "stack.speed": turning, "stack.position": stack.static_positions(0.05 * stack.actuator_force)}
    force = ramp(0.05 * stack.actuator_force, stack.actuator_force, 0.0, clamping)
    return simulate(compose(stack), 0.8 * speed, start=start, inputs={"stack.actuator_force": force}, accuracy=accuracy)


def phases(run: Trajectory, transient: float = 0.15) -> dict[str, tuple[float, float]]:
    """(begin, end) [s] of the transient after clamping, of steady slip, and of stick-slip until the wheel rests."""
    captures = [event.time for event in run.events if event.after == "stick" and event.time > transient]
    first = captures[0] if captures else run.end
    return {"transient": (0.0, transient), "steady slip": (transient, first), "stick-slip": (first, rest_of(run, "stack.wheel_speed"))}


def spectrum(run: Trajectory, signal: str, begin: float, end: float, rate: float = 8192.0) -> tuple[np.ndarray, np.ndarray]:
    """(frequency [Hz], amplitude density [unit / sqrt(Hz)]) of a signal between two times, straight line taken off, Hann window, by scipy."""
    from scipy.signal import periodogram

    times = np.arange(begin, end, 1 / rate)
    frequency, density = periodogram(run.at(times)[signal], rate, window="hann", detrend="linear")
    return frequency, np.sqrt(density)


def draw_stack(run: Trajectory, stack: DiskStack) -> Any:
    """Stack: durations of slip and stick at three interfaces, and the spectrum of the brake torque in each phase with the axial modes."""
    import matplotlib.pyplot as plt

    with plt.rc_context(plot.PAPER):
        figure = plt.figure(figsize=(7.6, 4.2), layout="constrained")
        grid = figure.add_gridspec(3, 2, width_ratios=(1.0, 1.15))
        left, right = figure.add_subplot(grid[:, 0]), [figure.add_subplot(grid[row, 1]) for row in range(3)]
        for interface, marker in zip((0, 7, 15), "os^", strict=True):
            found = measure.cycles(run, f"stack.{interface}", until=rest_of(run, "stack.wheel_speed"))
            starts = [cycle.start for cycle in found]
            for kind, style, face in (("stick", plot.LINES[0], None), ("slip", plot.LINES[1], "white")):
                left.semilogy(starts, [1e3 * getattr(cycle, kind) for cycle in found], marker, markersize=2.6, color=style["color"],
                              markerfacecolor=face or style["color"], label=f"{kind}, interface {interface + 1}")  # fmt: skip
        left.set(
            xlabel="start of the cycle [s]", ylabel="duration [ms]", xlim=(phases(run)["stick-slip"][0] - 0.02, None), ylim=(0.05, 100)
        )
        left.legend(
            frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, columnspacing=0.6, handletextpad=0.0, borderaxespad=0.2
        )
        for panel, (name, (begin, end)) in zip(right, phases(run).items(), strict=True):
            frequency, density = spectrum(run, "stack.brake_torque", begin, end)
            shown = (frequency > 0) & (frequency < 760)
            for omega in stack.axial_frequencies():
                panel.axvline(omega / (2 * math.pi), color="0.75", linewidth=0.6, zorder=0)
            panel.semilogy(frequency[shown], density[shown], **{**plot.LINES[0], "linewidth": 0.9})
            panel.set(xlim=(0, 760))
            panel.set_title(f"{name}, {begin:.2f} to {end:.2f} s", loc="left", fontsize=8.0, pad=2.0)
            panel.tick_params(labelbottom=panel is right[-1])
        right[1].set_ylabel(r"brake torque [N m / $\sqrt{\mathrm{Hz}}$]")
        right[2].set_xlabel("frequency [Hz]; grey: axial modes")
    return figure


def main() -> None:
    """Print the tables and write the figure."""
    folder = figure_folder()
    run = stack_stop()
    print("Stack of eight rotors, stop from 3 rad/s; " + ", ".join(f"{name} {b:.3f} to {e:.3f} s" for name, (b, e) in phases(run).items()))
    print("  interface  cycles    slip [ms] early, late   stick [ms] early, late   final stick at [s]")
    for i in range(16):
        found = measure.cycles(run, f"stack.{i}", after=phases(run)["stick-slip"][0], until=rest_of(run, "stack.wheel_speed"))
        n = max(1, len(found) // 5)
        slip, stick = (1e3 * np.array([getattr(cycle, what) for cycle in found]) for what in ("slip", "stick"))
        print(f"{i:9d}{len(found):9d}{np.median(slip[:n]):14.2f}{np.median(slip[-n:]):9.2f}{np.median(stick[:n]):16.2f}{np.median(stick[-n:]):9.2f}"
              f"{found[-1].start + found[-1].period:21.3f}")  # fmt: skip
    load = run["stack.load"]
    print(f"  error {run.error_estimate:.0e}, load {load.min():.0f} to {load.max():.0f} N, {len(run.events)} events, {run.wall_time:.2f} s")
    draw_stack(run, DiskStack()).savefig(folder / "disk_stack.png")
    scaling()


def scaling() -> None:
    """Print what a stack costs as it grows to 64 interfaces; the first call composes and compiles, with an empty cache of object code."""
    import os
    import tempfile
    import time

    os.environ["STICKSLIP_CACHE_DIR"] = tempfile.mkdtemp()
    print("\nrotors  interfaces  states  first call [s]  0.1 s of stop [s]  steps")
    for rotors in (1, 2, 4, 8, 16, 32):
        stack = DiskStack(rotors=rotors)
        n = 2 * rotors + 1
        start = {"stack.wheel_speed": 2.0, "stack.speed": np.where(np.arange(n) % 2 == 1, 2.0, 0.0)}
        began = time.perf_counter()
        plant = compose(stack)
        simulate(plant, 1e-6, start=start)
        first = time.perf_counter() - began
        run = simulate(plant, 0.1, start=start)
        print(f"{rotors:6d}{2 * rotors:12d}{4 * n + 1:8d}{first:16.2f}{run.wall_time:19.4f}{run.steps[0]:7d}")


if __name__ == "__main__":
    main()
