"""What happens in the last second of a stop? Stick-slip of two disks, from a reconstruction after Larsson and Farhang (2016).

    python -m studies disks [FOLDER]            (default studies/figures)

Two disks.  The stator rubs on a heavy rotor that friction brings to rest. Where a rotor is driven at speed W and friction has constant
torques T_s, T_k, an undamped stator repeats a cycle that is known in closed form: with w_n = sqrt(k / I_2), z = (T_s - T_k) w_n / (k W),

    t_slip = (2 / w_n)(pi - arctan z) ,   t_stick = 2 z / w_n ,   T / T_n = 1 + (z - arctan z) / pi .

z grows without bound as W falls, so the period starts near that of the stator, and friction of any kind makes it grow. It ends because the rotor no
longer has the energy to wind the stator up from where it caught it, th_c = (2 T_k - T_s) / k, to where it lets go, th_s = T_s / k. In stick both swing
as one inertia at w_L = sqrt(k / (I_1 + I_2)); the last whole cycle leaves stick with a speed between nothing and the one that just fails
the next time, and therefore lasts, with r = th_c / th_s,

    between (asin a - asin(a r)) / (2 pi) and acos r / (2 pi) times sqrt((I_1 + I_2) / I_2) , a = 1 / sqrt(2 - r^2) ,   plus the slip, half of T_n.

The end "near 3" is thus a property of the set: of the ratio of the inertias and of how far friction drops.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from models import Coulomb, PressedDisks, TwoDisks
from studies.command_line import figure_folder
from studies.questions.critical_curve import critical_curve
from toolbox import compose, measure, plot, simulate
from toolbox.inputs import ramp
from toolbox.measuring.measure import StickSlipPeriod
from toolbox.simulation.trajectory import Trajectory


# -------------------------------------------------------------------------------------------------------------------------------- closed forms
def driven_cycle(z: float) -> tuple[float, float, float]:
    """(t_slip / T_n, t_stick / T_n, T / T_n) of an undamped stator under a driven rotor, z = (T_s - T_k) w_n / (k W) >= 0.

    Source: textbook, see the head of this file.
    """
    return 1 - math.atan(z) / math.pi, z / math.pi, 1 + (z - math.atan(z)) / math.pi


def last_period_range(rotor_inertia: float, stator_inertia: float, static: float, kinetic: float) -> tuple[float, float]:
    """Smallest and largest period of the last whole cycle of a stop, over T_n: Coulomb friction, undamped stator, heavy rotor.

    The equations are those at the head of this file. Range: sqrt(I_1 / I_2) >> 1, kinetic < static <= 2 kinetic or so.
    """
    caught = 2 * kinetic / static - 1
    amplitude = 1 / math.sqrt(2 - caught**2)
    slow = math.sqrt((rotor_inertia + stator_inertia) / stator_inertia) / (2 * math.pi)
    shortest = slow * (math.asin(amplitude) - math.asin(amplitude * caught))
    return shortest + 0.5, slow * math.acos(caught) + 0.5


def critical_drop(damping_ratio: float) -> float:
    """z = (T_s - T_k) w_n / (k W) below which a damped stator under a driven rotor is not caught again (Coulomb friction).

    Released at x = z (1 - 2 zeta / z) from equilibrium, in units of W / w_n, with speed 1, the stator swings as exp(-zeta t) (..). It is
    caught if its speed comes back to 1. Solved by scipy.
    """
    from scipy.optimize import brentq, minimize_scalar

    zeta, w_d = damping_ratio, math.sqrt(1 - damping_ratio**2)

    def highest(z: float) -> float:
        offset = z - 2 * zeta  # the damper carries 2 zeta of the static torque at release

        def speed(t: float) -> float:
            # y'' + 2 zeta y' + y = 0 from y = offset, y' = 1
            return math.exp(-zeta * t) * (math.cos(w_d * t) - (offset + zeta) / w_d * math.sin(w_d * t))

        found = minimize_scalar(lambda t: -speed(t), bounds=(math.pi / w_d, 2 * math.pi / w_d), method="bounded", options={"xatol": 1e-12})
        return -found.fun

    return brentq(lambda z: highest(z) - 1, 1e-9, 100.0, xtol=1e-12)


# ------------------------------------------------------------------------------------------------------------------------------- report of a stop
@dataclass(frozen=True)
class Stop:
    """A braking stop: its whole cycles while the rotor turns forward, and the period T_n [s] that they are compared with."""

    run: Trajectory
    cycles: list[StickSlipPeriod]
    component_period: float

    @property
    def ratios(self) -> np.ndarray:
        """Period of each cycle over T_n."""
        return np.array([cycle.period for cycle in self.cycles]) / self.component_period

    @property
    def onset(self) -> float:
        """Ratio of the first cycle; nan without one."""
        return float(self.ratios[0]) if self.cycles else math.nan

    @property
    def termination(self) -> float:
        """Ratio of the last whole cycle; nan without one."""
        return float(self.ratios[-1]) if self.cycles else math.nan

    def __str__(self) -> str:
        lines = ["  start [s]  period [ms]  slip [ms]  stick [ms]  period / T_n"]
        for cycle, ratio in zip(self.cycles, self.ratios, strict=True):
            lines.append(f"{cycle.start:11.4f}{1e3 * cycle.period:13.3f}{1e3 * cycle.slip:11.3f}{1e3 * cycle.stick:12.3f}{ratio:14.3f}")
        return "\n".join(lines)


def rest_of(run: Trajectory, speed: str) -> float:
    """First time [s] at which a speed is no longer positive; the end of the run if it stays positive."""
    stopped = np.flatnonzero(run.every_step[speed] <= 0)
    return float(run.every_step.time[stopped[0]]) if stopped.size else run.end


def report(run: Trajectory, element: str, speed: str, component_period: float) -> Stop:
    """The cycles of an element up to the first rest of `speed` [rad/s], compared with the period of the highest component frequency [s]."""
    return Stop(run, measure.cycles(run, element, until=rest_of(run, speed)), component_period)


def stop_of(disks: TwoDisks, speed: float, accuracy: float = 1e-9) -> Stop:
    """Stop of two disks from a rotor speed [rad/s] > 0, run for 1.3 times as long as friction at its lowest would need."""
    kinetic = disks.friction.kinetic  # type: ignore[attr-defined]
    duration = 1.3 * disks.rotor_inertia * speed / (kinetic * disks.normal_force * disks.radius)
    run = simulate(compose(disks), duration, start={"disks.rotor_speed": speed}, accuracy=accuracy)
    return report(run, "disks", "disks.rotor_speed", 2 * math.pi / math.sqrt(disks.stiffness / disks.stator_inertia))


def pressed_stop(speed: float, accuracy: float = 1e-9) -> Stop:
    """Stop of two disks from a rotor speed [rad/s] > 0 by an actuator that closes their gap and rises to its full force in 50 ms."""
    disks = PressedDisks()
    force = ramp(0.0, disks.actuator_force, 0.0, 0.05)
    run = simulate(
        compose(disks), 0.2 + 0.17 * speed, start={"disks.rotor_speed": speed}, inputs={"disks.actuator_force": force}, accuracy=accuracy
    )
    return report(run, "disks", "disks.rotor_speed", 2 * math.pi / math.sqrt(disks.stiffness / disks.stator_inertia))


# ------------------------------------------------------------------------------------------------------------------------------- critical curves
def driven(stiffness: float, damping: float, z: float) -> float:
    """Number of catches (0 or 1) of a stator of 0.02 kg m2 under a rotor driven at 1 rad/s, in two periods after its release."""
    inertia, kinetic = 0.02, 30.0
    w_n = math.sqrt(stiffness / inertia)
    static = kinetic + z * stiffness / w_n
    disks = TwoDisks(rotor_inertia=1e12, stator_inertia=inertia, stiffness=stiffness, damping=damping, normal_force=1.0, radius=1.0,
                     friction=Coulomb(static=static, kinetic=kinetic))  # fmt: skip
    # at the instant of release, just inside of stick
    start = {"disks.rotor_speed": 1.0, "disks.stator_speed": 1.0, "disks.stator_angle": (static * (1 - 1e-9) - damping) / stiffness}
    run = simulate(compose(disks), 4 * math.pi / w_n, start=start)
    return float(sum(event.after == "stick" for event in run.events))


# --------------------------------------------------------------------------------------------------------------------------------------- pictures
SPEEDS = (1.0, 2.0, 3.0, 4.0)


def draw_stops(stops: dict[float, Stop]) -> Any:
    """Two disks: speeds of one stop, its slip and stick, and the period of every cycle of all stops over that of the stator."""
    import matplotlib.pyplot as plt

    shown = stops[2.0]
    with plt.rc_context(plot.PAPER):
        figure, panels = plt.subplots(2, 2, figsize=(7.6, 5.0), layout="constrained")
        run, times = shown.run, np.linspace(0, shown.run.end, 6000)
        _speeds(panels[0, 0], run, times)
        panels[0, 0].set_title("stop from 2 rad/s", loc="left", fontsize=9.0)
        last = shown.cycles[-1]
        _speeds(panels[0, 1], run, np.linspace(last.start - 0.12, min(last.start + last.period + 0.04, run.end), 2000))
        panels[0, 1].set_title("its last cycles, grey: stick", loc="left", fontsize=9.0)
        for begin, end in measure.stick_intervals(run, "disks"):
            panels[0, 1].axvspan(begin, end, facecolor=plot.BAND, edgecolor="0.6", linewidth=0.5, zorder=0)
        starts = [cycle.start for cycle in shown.cycles]
        panels[1, 0].plot(starts, [1e3 * cycle.stick for cycle in shown.cycles], "o", markersize=3, color="black", label="stick")
        panels[1, 0].plot(
            starts, [1e3 * cycle.slip for cycle in shown.cycles], "o", markersize=3, markerfacecolor="white", color="black", label="slip"
        )
        panels[1, 0].set(xlabel="start of the cycle [s]", ylabel="duration [ms]")
        panels[1, 0].legend(frameon=False)
        for style, (speed, stop) in zip(plot.LINES, stops.items(), strict=False):
            end = stop.cycles[-1].start + stop.cycles[-1].period
            panels[1, 1].plot([cycle.start - end for cycle in stop.cycles], stop.ratios, label=f"from {speed:g} rad/s", **style)
        panels[1, 1].set(xlabel="time before the last release [s]", ylabel="period / period of the stator", ylim=(0.8, None))
        panels[1, 1].axhline(1.0, color="0.7", linewidth=0.6, zorder=0)
        panels[1, 1].axhline(3.0, color="0.7", linewidth=0.6, zorder=0)
        panels[1, 1].legend(frameon=False)
    return figure


def _speeds(panel: Any, run: Trajectory, times: np.ndarray) -> None:
    samples = run.at(times)
    panel.plot(times, samples["disks.stator_speed"], label="stator", **{**plot.LINES[1], "linewidth": 0.9})
    panel.plot(times, samples["disks.rotor_speed"], label="rotor", **plot.LINES[0])
    panel.set(xlabel="time [s]", ylabel="speed [rad/s]", xlim=(times[0], times[-1]))
    panel.legend(loc="lower right", framealpha=1.0, edgecolor="none")


def draw_pressed(stops: dict[float, Stop]) -> Any:
    """Disks across a gap: normal force and closure while they meet, and the period of every cycle of all stops over that of the stator."""
    import matplotlib.pyplot as plt

    run = next(iter(stops.values())).run
    with plt.rc_context(plot.PAPER):
        figure = plt.figure(figsize=(7.6, 3.4), layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=(1.1, 1.0))
        closure, force, periods = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[:, 1])
        times = np.linspace(0, 0.06, 6000)
        samples = run.at(times)
        closure.plot(1e3 * times, 1e6 * samples["disks.faces.closure"], **plot.LINES[0])
        closure.set(ylabel=r"closure [$\mu$m]", xlim=(0, 60), ylim=(-520, 150))
        closure.tick_params(labelbottom=False)
        force.plot(1e3 * times, samples["disks.actuator_force"], label="actuator", **plot.LINES[1])
        force.plot(1e3 * times, samples["disks.normal_force"], label="faces", **plot.LINES[0])
        force.set(xlabel="time [ms]", ylabel="force [N]", xlim=(0, 60))
        force.legend(frameon=False, loc="lower right")
        for begin, end, mode in run.intervals("disks.faces"):
            if mode == "closed":
                for panel in (closure, force):
                    panel.axvspan(1e3 * begin, min(1e3 * end, 60), color=plot.BAND, zorder=0)
        for style, mark, (speed, stop) in zip(plot.LINES, "os^D", stops.items(), strict=False):
            end = stop.cycles[-1].start + stop.cycles[-1].period
            periods.plot([cycle.start - end for cycle in stop.cycles], stop.ratios, marker=mark, markersize=3.5, label=f"from {speed:g} rad/s",
                         **style | {"linewidth": 1.0})  # fmt: skip
        for ratio in (1.0, 3.0):
            periods.axhline(ratio, color="0.7", linewidth=0.6, zorder=0)
        periods.set(xlabel="time before the last release [s]", ylabel="period / period of the stator", ylim=(0.8, None))
        periods.legend(framealpha=1.0, edgecolor="none", loc="upper left")
    return figure


def draw_critical(ratios: np.ndarray, computed: np.ndarray, loads: np.ndarray, dampings: np.ndarray) -> Any:
    """Critical curves: of the driven rotor against theory, and of the braking stop in the plane of normal force and damping."""
    import matplotlib.pyplot as plt

    with plt.rc_context(plot.PAPER):
        figure, (left, right) = plt.subplots(1, 2, figsize=(7.6, 3.2), layout="constrained")
        fine = np.linspace(ratios[0], ratios[-1], 200)
        left.plot(fine, [critical_drop(zeta) for zeta in fine], label="theory", **plot.LINES[0])
        left.plot(ratios, computed, "o", markersize=4, markerfacecolor="white", color="black", label="bisection of runs")
        left.set(
            xlabel="damping ratio of the stator",
            ylabel=r"drop of friction $(T_s - T_k)\,\omega_n / (k\,\Omega)$",
            xlim=(0, None),
            ylim=(0, 8),
        )
        left.fill_between(fine, [critical_drop(zeta) for zeta in fine], 8.0, color=plot.BAND, zorder=0)
        left.text(0.3, 0.85, "stick-slip", transform=left.transAxes, ha="center")
        left.text(0.75, 0.15, "none", transform=left.transAxes, ha="center")
        left.set_title("driven rotor", loc="left", fontsize=9.0)
        left.legend(frameon=False, loc="center left")
        right.plot(loads, dampings, "o-", markersize=4, markerfacecolor="white", color="black", linewidth=1.2, label="bisection of stops")
        law = TwoDisks()
        slope = law.radius * (law.friction.static - law.friction.kinetic) * law.friction.decay  # type: ignore[attr-defined]
        right.plot(loads, slope * loads, label="steepest fall of friction", **plot.LINES[2])
        right.set(xlabel="normal force [N]", ylabel="damping of the mount [N m s/rad]", xlim=(0, None), ylim=(0, None))
        right.fill_between(loads, dampings, color=plot.BAND, zorder=0)
        right.text(0.6, 0.06, "stick-slip", transform=right.transAxes, ha="center")
        right.text(0.75, 0.35, "none", transform=right.transAxes, ha="center")
        right.set_title("stop from 2 rad/s", loc="left", fontsize=9.0)
        right.legend(frameon=False, loc="upper left")
    return figure


# -------------------------------------------------------------------------------------------------------------------------------------- the study
def dependence() -> list[tuple[str, float, Stop]]:
    """(what is changed, initial speed [rad/s], its stop) for the shipped set and for changes of it."""
    base = TwoDisks()
    friction = base.friction
    changes: dict[str, dict[str, Any]] = {
        "shipped set": {},
        "rotor 5 kg m2": {"rotor_inertia": 5.0},
        "rotor 80 kg m2": {"rotor_inertia": 80.0},
        "static 0.35": {"friction": replace(friction, static=0.35)},  # type: ignore[call-arg]
        "static 0.5": {"friction": replace(friction, static=0.5)},  # type: ignore[call-arg]
        "decay 1 s/rad": {"friction": replace(friction, decay=1.0)},  # type: ignore[call-arg]
        "decay 4 s/rad": {"friction": replace(friction, decay=4.0)},  # type: ignore[call-arg]
        "damping 0.25 N m s/rad": {"damping": 0.25},
        "damping 1 N m s/rad": {"damping": 1.0},
        "normal force 2000 N": {"normal_force": 2000.0},
    }
    found = [(name, 2.0, stop_of(replace(base, **change), 2.0)) for name, change in changes.items()]
    return found + [("shipped set", speed, stop_of(base, speed)) for speed in (0.5, 1.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0)]


def braking_decision(load: float, damping: float) -> float:
    """Number of whole cycles in the second half of a stop of the shipped set from 2 rad/s with another normal force and damping.

    The first half is left to what the sudden start stirs up.
    """
    stop = stop_of(TwoDisks(normal_force=load, damping=damping), 2.0, accuracy=1e-6)
    return float(sum(cycle.start > rest_of(stop.run, "disks.rotor_speed") / 2 for cycle in stop.cycles))


def main() -> None:
    """Print the tables and write the figures."""
    folder = figure_folder()

    stops = {speed: stop_of(TwoDisks(), speed) for speed in SPEEDS}
    print("Two disks, stop from 2 rad/s, every cycle\n" + str(stops[2.0]))
    draw_stops(stops).savefig(folder / "two_disks.png")

    print("\nPeriod of the first and of the last cycle over that of the stator\n")
    print(f"{'':24} from [rad/s]  cycles  onset  termination    error")
    for name, speed, stop in dependence():
        print(f"{name:24}{speed:13g}{len(stop.cycles):8d}{stop.onset:7.2f}{stop.termination:13.2f}{stop.run.error_estimate:9.0e}")
    low, high = last_period_range(20.0, 0.02, 0.4, 0.3)
    print(f"last cycle by theory for Coulomb friction 0.4 / 0.3, no damping: {low:.2f} to {high:.2f}")

    print("\nDisks pressed together across a gap: from [rad/s], cycles, onset, termination, error, opens again at [s]")
    pressed = {speed: pressed_stop(speed) for speed in (3.0, 5.0, 8.0, 10.0)}
    for speed, stop in pressed.items():
        opens = [f"{event.time:.5f}" for event in stop.run.events if event.after == "open"]
        print(f"{speed:6g}{len(stop.cycles):6d}{stop.onset:8.2f}{stop.termination:8.2f}{stop.run.error_estimate:9.0e}  {', '.join(opens)}")
    draw_pressed(pressed).savefig(folder / "pressed_disks.png")

    ratios = np.linspace(0.02, 0.4, 9)
    inertia, stiffness = 0.02, 2000.0
    computed = critical_curve(lambda zeta, z: driven(stiffness, 2 * zeta * math.sqrt(stiffness * inertia), z), ratios, (0.01, 10.0))
    print("\nCritical drop of friction, driven rotor: damping ratio, bisection, theory")
    for zeta, z in zip(ratios, computed, strict=True):
        print(f"{zeta:8.4f}{z:10.5f}{critical_drop(zeta):10.5f}")
    loads = np.linspace(200.0, 2000.0, 7)
    dampings = critical_curve(braking_decision, loads, (0.1, 100.0), tolerance=1e-2)
    print("\nCritical damping of the mount in a stop: normal force [N], damping [N m s/rad]")
    for load, damping in zip(loads, dampings, strict=True):
        print(f"{load:8.0f}{damping:10.3f}")
    draw_critical(ratios, computed, loads, dampings).savefig(folder / "two_disks_critical.png")


if __name__ == "__main__":
    main()
