"""Which law stops a car from 30 km/h without groan, in which distance, and what is left of that where friction is 20 % off?

Plant: `DiscBrake` with its defaults (a quarter of a car of 1600 kg on tyres of 300 mm, pads and caliper at 50 Hz), pressed by pistons of 2290 mm2 a pad: 1 bar
is 229 N. The disc is rough: 4 N more or less at 40 Hz on the pad. Every row has the same actuator, `BrakeActuator` with 10 ms, at most 8 kN (35 bar) and
20 kN/s (87 bar/s), commands 2 ms late, and the same sensors: 0.005 rad/s of noise on the speed, 2 N m on the torque, 5 mm/s on the pad. Dither goes through
that actuator as well. Rows whose name ends with "ideal actuator" have none: forces follow at once, without delay. Laws expect the friction 0.35 and are sampled
every millisecond, the predictive one every 30 ms.

Groan: two or more releases of the pad from stick while the car is faster than 0.03 m/s (12 mm/s at the pads); one release is not yet groan. Slower than that
every brake sticks a last time. Groan and stopping distance are columns of their own: a law may be silent and late, or loud and in time.

Columns:
    silent up to   highest deceleration [m/s2] of the grid 0.5, 0.6 ... 3 below the first one that groans; friction nominal, and 20 % higher
    releases       at 2.5 m/s2: the worst of two seeds of noise; friction 20 % lower, nominal, 20 % higher
    distance       longest stopping distance [m] at 2.5 m/s2 on the same three machines; planned are 13.9 m
    mean           mean deceleration [m/s2] until standstill, friction nominal
    jerk           largest jerk [m/s3] in the last metre and at the halt, of the deceleration averaged over 50 ms, friction nominal
    peak           highest pressure [bar], friction nominal

                                              silent to [m/s2]          releases            distance [m]   mean   jerk   peak
    friction                                   nominal   +20 %   -20 / 0 / +20 %         -20 / 0 / +20 %   m/s2   m/s3    bar
    -------------------------------------------------------------------------------------------------------------------------
    constant force                                 2.1     1.8         1 / 2 / 2   18.17 / 14.70 / 12.39   2.46   49.0   15.6
    constant force, eased                         >= 3    >= 3         0 / 0 / 0   19.66 / 15.89 / 13.38   1.28    2.4   15.6
    PI                                           < 0.5   < 0.5         9 / 7 / 7   15.55 / 14.16 / 13.18   2.52   53.8   17.0
    PI, eased                                     >= 3    >= 3         0 / 0 / 0   17.15 / 15.35 / 14.10   1.30    2.5   17.0
    sliding mode                                 < 0.5   < 0.5         8 / 9 / 9   14.02 / 13.95 / 13.91   2.52   44.4   19.2
    sliding mode, eased                           >= 3    >= 3         0 / 0 / 0   15.63 / 15.12 / 14.81   1.31    2.4   19.2
    MPC                                           >= 3    >= 3         0 / 0 / 0   15.01 / 14.61 / 14.37   1.34    2.6   31.8
    constant, sine dither                        < 0.5   < 0.5      16 / 14 / 12   19.52 / 16.05 / 13.72   2.34   54.8   15.7
    constant, phased dither                      < 0.5   < 0.5      30 / 27 / 25   18.22 / 14.76 / 12.47   2.42   50.2   16.1
    sliding mode, ideal actuator                   0.5     0.5         1 / 1 / 1   13.89 / 13.89 / 13.89   2.50   45.5   16.2
    constant, phased dither, ideal actuator       >= 3    >= 3         0 / 0 / 1   18.08 / 14.62 / 12.32   2.47   58.0   15.6

What comes out: behind one actuator only the laws that ease are silent at an ordinary stop, whatever friction is, up to the end of the scan. The price is
distance, 0.7 m (MPC) to 2 m (eased constant force) of 13.9 m, and 3 s of crawl. Feedback of the deceleration without ease feeds the groan; dither
through the actuator feeds it more. Phased dither is silent with an ideal actuator only. Where friction is 20 % lower, a constant force needs 3.5 m
more; the eased sliding mode and the MPC need half a metre more.

    Release on a slope of 8.5 % (100 N m a wheel), held by 4.8 bar
    releases, last one at [m/s]               0.25 s           0.5 s             1 s             2 s             4 s
    ----------------------------------------------------------------------------------------------------------------
    no dither                               15, 0.01        21, 0.05        39, 0.15        67, 0.26       103, 0.41
    sine dither                             37, 0.01        50, 0.01        64, 0.11        99, 0.27       160, 0.39
    phased dither                           19, 0.05        27, 0.08        47, 0.21        80, 0.37       129, 0.63
    phased dither, ideal actuator           10, 0.01        11, 0.01        17, 0.01        45, 0.01        90, 0.01

The sine makes a release louder, too. What dither can do is the third figure, for stops from 30 km/h and from 7 km/h, at which the pad already groans. Behind
the actuator the highest rate lets a triangle of rate / (4 f) through at most: 100 N at 50 Hz, 3 % of the force, whatever depth is commanded. Of 50 sines of
20 to 300 Hz none silences the stop from 7 km/h (5 to 12 releases, 8 without); from 30 km/h forty leave 1 to 3 releases, 2 without, five of them 1, and ten
near 30 Hz and 150 Hz, three times the frequency of the pad, make groan (7 to 14). The row of the table has 150 Hz. With an ideal actuator the sine is louder
at nearly every frequency and depth. Phased dither silences a stop only if it acts less than a millisecond late, a twentieth of the period of the pad.

The gains of PI and sliding mode were chosen for stops from 1.8 m/s, on the noise of other seeds, and not again for this table.

Where groan cannot be avoided: under a constant force the pad grows by exp(G) on its way through the speeds without damping,

    G = I / (2 m r^2) ln(mu_s / mu(r w_e)) - (what the caliper takes),   w_e the speed at which it loses its damping

(`models.closed_forms.groan_growth`). A larger force shortens the stop and strengthens the growth alike, so that braking harder does not outrun groan: G rises
to I / (2 m r^2) ln(mu_s / mu_k), 31 here. What remains is to let friction fall without the torque falling, which takes an actuator faster than the
pad, to take the force back before standstill, which takes distance, or to change the contact (`studies.questions.dither`).

    python -m studies brakes [--out FOLDER] [--only LABEL ...]        (some minutes of one processor; tables, brakes.csv, brakes.png, brakes_dither.png)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from controllers import BrakeForce, BrakeMPC, BrakePI, BrakeSlidingMode, NormalDither, PhasedDither
from controllers.dither import LoadDither
from models import BrakeActuator, DiscBrake
from models.closed_forms import groan_growth
from studies.command_line import folder, parser_of, write_rows
from toolbox import HybridSystem, Sampled, SimulationError, Trajectory, compose, simulate
from toolbox.inputs import ramp, sine

WHEEL, PISTON = 0.3, 2290e-6
BRAKE = DiscBrake(force=0.0, wheel_radius=WHEEL)
ACTUATOR = BrakeActuator(piston_area=PISTON)
START, SLOWEST, COMMON = 30.0 / 3.6, 0.03, 2.5
LOWEST, HIGHEST, STEP = 0.5, 3.0, 0.1
FRICTION = ("pad.friction.static", "pad.friction.kinetic")
OFF = {"-20 %": 0.8, "nominal": 1.0, "+20 %": 1.2}
NOISE = {"disc.speed": 0.005, "brake.torque": 2.0, "pad.speed": 0.005}
DELAY = 0.002
VERDICT_SEEDS = (2001, 2002)
EASED = 0.8
COMMONLY = {"friction": 0.35, "highest_force": 8000.0}
SOFT_PI = {"proportional": 0.1, "integral": 1.0}
SOFT_SLIDING = {"filter_time": 0.1, "reaching_rate": 0.3, "boundary_layer": 0.2, "surface_gain": 1.0}
PHASED = {"speed": "pad.speed", "unit": "m/s", "depth": 0.5, "speed_scale": -0.2}


@dataclass(frozen=True)
class Contender:
    """A row: what makes the law for a deceleration [m/s2], its period [s], the dither beside it, and whether its actuator is ideal."""

    label: str
    law: Callable[..., Any]
    period: float = 0.001
    dither: LoadDither | None = None
    ideal: bool = False


def contenders() -> list[Contender]:
    """All rows, in the order of the table."""
    force, pi = partial(BrakeForce, **COMMONLY), partial(BrakePI, **COMMONLY, **SOFT_PI)
    sliding, phased = partial(BrakeSlidingMode, **COMMONLY, **SOFT_SLIDING), PhasedDither(**PHASED)
    fast = partial(BrakeSlidingMode, **COMMONLY, force_rate=None)
    return [
        Contender("constant force", force),
        Contender("constant force, eased", partial(force, margin=EASED)),
        Contender("PI", pi),
        Contender("PI, eased", partial(pi, margin=EASED)),
        Contender("sliding mode", sliding),
        Contender("sliding mode, eased", partial(sliding, margin=EASED)),
        Contender("MPC", partial(BrakeMPC, margin=EASED, **COMMONLY), 0.03),
        Contender("constant, sine dither", force, dither=NormalDither(depth=0.9, frequency=150.0)),
        Contender("constant, phased dither", force, dither=phased),
        Contender("sliding mode, ideal actuator", fast, ideal=True),
        Contender("constant, phased dither, ideal actuator", force, dither=phased, ideal=True),
    ]


# --- one stop


@dataclass(frozen=True)
class Stop:
    """What became of a stop: releases above `SLOWEST`, time of standstill [s] (inf for none), distance [m], mean deceleration, jerk [m/s3], pressure [bar]."""

    releases: int
    standstill: float
    distance: float
    mean: float
    jerk: float
    peak: float

    @property
    def groans(self) -> bool:
        """Whether the pad lets go more than once before the slowest speed that counts."""
        return self.releases >= 2


def plant_of(contender: Contender) -> HybridSystem:
    """The brake of a row, behind the actuator or without one."""
    return compose(BRAKE) if contender.ideal else compose(BRAKE, ACTUATOR)


def controllers_of(contender: Contender, deceleration: float, seed: int) -> list[Any]:
    """The law of a row at its sensors and, if it has one, the dither on top of its command."""
    law = contender.law(car_deceleration=deceleration)
    late = 0.0 if contender.ideal else DELAY
    laws: list[Any] = [(law, contender.period)]
    if contender.dither is not None:
        load = "brake.disturbance" if contender.ideal else "actuator.dither"
        laws.append((replace(contender.dither, load=load, over="brake.force"), 0.001))
    found = []
    for each, period in laws:
        noise = {name: value for name, value in NOISE.items() if name in each.measured_signals}
        found.append(Sampled(each, period, delay=late, noise=noise, seed=seed))
    return found


def run_of(
    contender: Contender, deceleration: float, friction: float = 1.0, seed: int = VERDICT_SEEDS[0], *,
    parameters: Mapping[str, float] | None = None, phase: float = 0.0, start: float = START,
) -> Trajectory:  # fmt: skip
    """A stop of a row at a planned deceleration [m/s2].

    friction: factor of both coefficients;  parameters: others of the plant;  phase: of the roughness of the disc, in parts of its period;  start: speed of the
    car [m/s].
    """
    plant = plant_of(contender)
    changed = {name: friction * float(plant.parameter(name)) for name in FRICTION} | dict(parameters or {})
    rough = {"pad.attachment": sine(0.0, 4.0, 40.0, 2.0 * math.pi * phase)}
    duration = 1.5 * start / deceleration + 8.0
    return simulate(
        plant, duration, start={"disc.car_speed": start}, inputs=rough, controller=controllers_of(contender, deceleration, seed), parameters=changed
    )  # fmt: skip


def releases_of(run: Trajectory, until: float = math.inf) -> list[float]:
    """The times at which the pad lets go, after the first 50 ms."""
    return [event.time for event in run.events if event.element == "pad" and event.before == "stick" and 0.05 < event.time < until]


def stop_of(run: Trajectory) -> Stop:
    """The numbers of a stop, from samples every millisecond; the standstill is where the disc first ceases to turn."""
    times = np.arange(0.0, run.end, 1e-3)
    at = run.at(times)
    speed = at["disc.car_speed"]
    stands = np.flatnonzero(speed <= 0.0)
    end = int(stands[0]) if stands.size else times.size - 1
    turning = np.interp(releases_of(run, float(times[end])), times, speed)
    travelled = np.concatenate([[0.0], np.cumsum((speed[1 : end + 1] + speed[:end]) / 2.0) * 1e-3])
    last = int(np.searchsorted(travelled, travelled[-1] - 1.0))
    window = 50
    mean = (speed[:-window] - speed[window:]) / (1e-3 * window)
    jerk = np.abs(mean[window:] - mean[:-window]) / (1e-3 * window)
    judged = jerk[max(last - window, 0) : end + window]
    return Stop(
        releases=int((turning > SLOWEST).sum()),
        standstill=float(times[end]) if stands.size else math.inf,
        distance=float(travelled[-1]),
        mean=float(speed[0] / times[end]),
        jerk=float(judged.max(initial=0.0)),
        peak=float(at["brake.force"][: end + 1].max()) / PISTON / 1e5,
    )


def worst(contender: Contender, deceleration: float, friction: float) -> Stop:
    """The worst number of each kind over the seeds; the mean deceleration is the lowest."""
    found = [asdict(stop_of(run_of(contender, deceleration, friction, seed))) for seed in VERDICT_SEEDS]
    return Stop(**{name: (min if name == "mean" else max)(each[name] for each in found) for name in found[0]})


def silent(contender: Contender, friction: float, step: float = STEP) -> float:
    """Highest deceleration [m/s2] of the grid below the first one that groans (nan for none), with the first seed."""
    found = math.nan
    for k in range(round((HIGHEST - LOWEST) / step) + 1):
        deceleration = round(LOWEST + k * step, 3)
        try:
            if stop_of(run_of(contender, deceleration, friction)).groans:
                return found
        except SimulationError:
            return found
        found = deceleration
    return found


# --- the table


@dataclass(frozen=True)
class Row:
    """A line of the table: silent up to [m/s2] by friction, and the worst stops at 2.5 m/s2 by friction."""

    label: str
    silent: Mapping[str, float]
    stops: Mapping[str, Stop]

    def flat(self) -> dict[str, Any]:
        """The line as one level of names."""
        cells: dict[str, Any] = {f"silent up to [m/s2], friction {word}": value for word, value in self.silent.items()}
        for word, stop in self.stops.items():
            cells |= {f"{name}, friction {word}": value for name, value in asdict(stop).items()}
        return {"label": self.label} | cells


def row_of(contender: Contender) -> Row:
    """The line of one row."""
    borders = {word: silent(contender, OFF[word]) for word in ("nominal", "+20 %")}
    return Row(contender.label, borders, {word: worst(contender, COMMON, factor) for word, factor in OFF.items()})


def border_text(value: float) -> str:
    """A deceleration of the scan: below its first, or at least its last."""
    return f"< {LOWEST:g}" if math.isnan(value) else f">= {HIGHEST:g}" if value >= HIGHEST else f"{value:.1f}"


def table(rows: Sequence[Row]) -> str:
    """The rows as text."""
    head = f"{'':<40}{'silent to [m/s2]':>18}{'releases':>18}{'distance [m]':>24}{'mean':>7}{'jerk':>7}{'peak':>7}"
    names = f"{'friction':<40}{'nominal':>10}{'+20 %':>8}{'-20 / 0 / +20 %':>18}{'-20 / 0 / +20 %':>24}{'m/s2':>7}{'m/s3':>7}{'bar':>7}"
    lines = [head, names, "-" * len(names)]
    for row in rows:
        releases = " / ".join(f"{stop.releases:d}" for stop in row.stops.values())
        distance = " / ".join(f"{stop.distance:.2f}" if math.isfinite(stop.standstill) else "rolls" for stop in row.stops.values())
        own = row.stops["nominal"]
        borders = f"{border_text(row.silent['nominal']):>10}{border_text(row.silent['+20 %']):>8}"
        lines.append(f"{row.label:<40}{borders}{releases:>18}{distance:>24}{own.mean:>7.2f}{own.jerk:>7.1f}{own.peak:>7.1f}")
    return "\n".join(lines)


# --- creep

SLOPE = 100.0
"""Torque [N m] of the slope on one wheel: 1600 kg on 8.5 %, or of a torque converter that pushes."""
HELD = 1100.0
"""Force [N] of one pad that holds the car there."""
RELEASES = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Times [s] in which the brake is released."""


def creep_of(dither: LoadDither | None, ideal: bool, duration: float) -> tuple[int, float]:
    """(releases, speed of the car [m/s] at the last one) while the brake is released against the slope in a time [s]."""
    row = Contender("release", BrakeForce, dither=dither, ideal=ideal)
    force = ramp(HELD, 0.02 * HELD, 0.5, 0.5 + duration)  # a dither that is late would pull on a pad without force
    controllers, inputs = controllers_of(row, COMMON, VERDICT_SEEDS[0])[1:], {"disc.torque": SLOPE, "pad.attachment": sine(0.0, 4.0, 40.0)}
    inputs["brake.force" if ideal else "actuator.command"] = force
    run = simulate(plant_of(row), 1.0 + duration, controller=controllers or None, inputs=inputs)
    found = releases_of(run)
    return len(found), float(run.at(found[-1])["disc.car_speed"]) if found else 0.0


def creep_table() -> str:
    """Releases of the pad, and the speed at the last one, over the time in which the brake is released."""
    kinds: dict[str, tuple[LoadDither | None, bool]] = {
        "no dither": (None, False),
        "sine dither": (NormalDither(depth=0.9, frequency=150.0), False),
        "phased dither": (PhasedDither(**PHASED), False),
        "phased dither, ideal actuator": (PhasedDither(**PHASED), True),
    }
    head = f"{'releases, last one at [m/s]':<32}" + "".join(f"{f'{time:g} s':>16}" for time in RELEASES)
    lines = [f"Release on a slope of 8.5 % ({SLOPE:g} N m a wheel), held by {HELD / PISTON / 1e5:.1f} bar", head, "-" * len(head)]
    for word, (dither, ideal) in kinds.items():
        cells = [creep_of(dither, ideal, time) for time in RELEASES]
        lines.append(f"{word:<32}" + "".join(f"{f'{count:d}, {speed:.2f}':>16}" for count, speed in cells))
    return "\n".join(lines)


# --- dither over frequency and depth

FREQUENCIES = (20.0, 30.0, 40.0, 60.0, 80.0, 100.0, 125.0, 150.0, 200.0, 300.0)
DEPTHS = (0.1, 0.3, 0.5, 0.7, 0.9)
LATE = (0.0, 0.001, 0.002, 0.003, 0.005, 0.0075, 0.01, 0.015)
SHORT = 2.0
"""Speed of the car [m/s] at which the second stops of the dither figure begin: the force rises at a speed at which the pad already groans."""
NEEDED = 36.0 * COMMON / WHEEL / (2 * 0.12 * 0.35)
"""Force of one pad [N] for a stop at 2.5 m/s2."""


def dithered(frequency: float, depth: float, ideal: bool, start: float = START) -> int:
    """Releases of a stop at 2.5 m/s2 under a sine dither; frequency [Hz], 0 for none; start: speed of the car [m/s]."""
    dither = NormalDither(depth=depth, frequency=frequency) if frequency else None
    row = Contender("sine", partial(BrakeForce, **COMMONLY), dither=dither, ideal=ideal)
    return stop_of(run_of(row, COMMON, start=start)).releases


def phased_late(late: float, depth: float = 0.5, start: float = START) -> int:
    """Releases of a stop at 2.5 m/s2 under a phased dither with a dead time [s] before an otherwise ideal actuator."""
    row = Contender("phased", partial(BrakeForce, **COMMONLY), dither=PhasedDither(**{**PHASED, "depth": depth}), ideal=True)
    law, dither = controllers_of(row, COMMON, VERDICT_SEEDS[0])
    rough = {"pad.attachment": sine(0.0, 4.0, 40.0)}
    controllers = [law, replace(dither, delay=late)]
    duration = 1.5 * start / COMMON + 8.0
    return stop_of(simulate(plant_of(row), duration, start={"disc.car_speed": start}, inputs=rough, controller=controllers)).releases


def delivered(frequency: float, depth: float, force: float = NEEDED) -> float:
    """Depth that the pads receive through the actuator: half the range of the force as a fraction of its mean, from the last of 40 periods or more."""
    duration = max(40.0 / frequency, 1.0)
    last = np.linspace(duration - 5.0 / frequency, duration, 2001)
    wave = {"actuator.command": force, "actuator.dither": sine(0.0, depth * force, frequency)}
    run = simulate(compose(BRAKE, ACTUATOR), duration, start={"disc.car_speed": 100.0, "actuator.force": force}, inputs=wave)
    return float(np.ptp(run.at(last)["brake.force"])) / (2.0 * force)


def triangle(frequency: float, force: float = NEEDED) -> float:
    """Depth of the triangle that rises and falls at the highest rate of the actuator: no larger one reaches the pads."""
    return float(ACTUATOR.rate_limit or math.inf) / (4.0 * frequency * force)


def dither_table() -> str:
    """Depth that reaches the pads of the brake over frequency and commanded depth, as text."""
    head = f"{'depth at the pads, commanded':<32}" + "".join(f"{f'{frequency:g} Hz':>9}" for frequency in FREQUENCIES)
    rows = [f"{depth:<32g}" + "".join(f"{delivered(frequency, depth):>9.3f}" for frequency in FREQUENCIES) for depth in DEPTHS]
    return "\n".join([head, "-" * len(head), *rows])


def dither_picture(path: Path) -> None:
    """Releases of two stops under sine dither with the actuator and with an ideal one, phased dither with a dead time, and depth at the pads."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    from toolbox import plot

    starts = {"30 km/h": START, "7 km/h": SHORT}
    with pyplot.rc_context(plot.PAPER):
        figure, panels = pyplot.subplots(2, 3, figsize=(11.0, 6.6), layout="constrained", gridspec_kw={"width_ratios": (1.0, 1.0, 0.95)})
        for line, (word, start) in zip(panels, starts.items(), strict=True):
            for panel, ideal in zip(line[:2], (False, True), strict=True):
                alone = dithered(0.0, 0.0, ideal, start)
                counts = np.array([[dithered(frequency, depth, ideal, start) for frequency in FREQUENCIES] for depth in DEPTHS])
                panel.imshow(np.log2((counts + 1.0) / (alone + 1.0)), origin="lower", aspect="auto", cmap="YlOrBr", vmin=-1.0, vmax=4.0)
                for (i, j), count in np.ndenumerate(counts):
                    panel.text(j, i, f"{count:d}", ha="center", va="center", fontsize=7.5, color="white" if count > 6 * alone else "black",
                               fontweight="bold" if count < alone else "normal")  # fmt: skip
                panel.set_xticks(range(len(FREQUENCIES)), [f"{each:g}" for each in FREQUENCIES])
                panel.set_yticks(range(len(DEPTHS)), [f"{each:g}" for each in DEPTHS])
                kind = "ideal actuator" if ideal else "real actuator"
                panel.set_title(f"{kind}, from {word}: {alone} without dither", loc="left", fontsize=9.0)
        for panel in panels[:, 0]:
            panel.set_ylabel("depth of the command, fraction of the force")
        for panel in panels[1, :2]:
            panel.set_xlabel("frequency of the sine [Hz]")
        phased, depths = panels[:, 2]
        for (word, start), look in zip(starts.items(), ({"color": "black", "marker": "o"}, {"color": "0.5", "marker": "s"}), strict=True):
            phased.plot(1e3 * np.array(LATE), [phased_late(late, start=start) for late in LATE], label=f"from {word}", **look)
            phased.axhline(dithered(0.0, 0.0, True, start), color=look["color"], linestyle="--", linewidth=1.0)
        phased.axvline(5.0, color="0.6", linestyle=":", linewidth=1.0)
        phased.annotate("quarter period\nof the pad", (5.0, 0.1), (4, 0), textcoords="offset points", fontsize=7.5, color="0.35")
        phased.set_yscale("symlog", linthresh=2.0)
        phased.set_yticks([0, 1, 2, 5, 10, 20, 50, 100, 200], ["0", "1", "2", "5", "10", "20", "50", "100", "200"])
        phased.minorticks_off()
        phased.set(xlabel="dead time, no lag and no limits [ms]", ylabel="releases of the pad", ylim=(0, 300))
        phased.legend(frameon=False, fontsize=8.0, title="dashed: without dither", title_fontsize=8.0, loc=(0.52, 0.24))
        phased.set_title("phased dither of depth 0.5", loc="left", fontsize=9.0)
        grid = np.geomspace(FREQUENCIES[0], FREQUENCIES[-1], 200)
        depths.loglog(grid, [100.0 * triangle(each) for each in grid], color="black", linewidth=1.0, label="triangle at 20 kN/s")
        for depth, look in ((0.9, "black"), (0.1, "0.5")):
            depths.loglog(
                FREQUENCIES,
                [100.0 * delivered(each, depth) for each in FREQUENCIES],
                "o",
                color=look,
                label=f"command of {100 * depth:g} %",
            )
        depths.axvline(50.3, color="0.6", linestyle=":", linewidth=1.0)
        depths.annotate(
            "natural frequency\nof the pad", (50.3, 0.5), (-3, 0), textcoords="offset points", fontsize=7.5, color="0.35", ha="right"
        )
        depths.set_xticks([20, 50, 100, 200], ["20", "50", "100", "200"])
        depths.set_yticks([0.5, 1, 2, 5, 10], ["0.5", "1", "2", "5", "10"])
        depths.minorticks_off()
        depths.set(xlabel="frequency of the sine [Hz]", ylabel="amplitude at the pads [% of the force]")
        depths.legend(frameon=False, fontsize=8.0)
        depths.set_title("sine behind the real actuator", loc="left", fontsize=9.0)
        figure.suptitle(
            "Releases of the pad in stops at 2.5 m/s$^2$ (bold: fewer than without dither). Real actuator: lag 10 ms, 20 kN/s, delay 2 ms",
            fontsize=10.0,
        )
        figure.savefig(path, dpi=120)
        pyplot.close(figure)


# --- the picture


def picture(rows: Sequence[Row], path: Path) -> None:
    """The last metre of four stops, and every row with friction 20 % off: releases and stopping distance."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    from toolbox import plot

    every = {contender.label: contender for contender in contenders()}
    shown = ("constant force", "sliding mode, eased", "MPC", "constant, phased dither")
    with pyplot.rc_context(plot.PAPER):
        figure = pyplot.figure(figsize=(11.0, 6.9), layout="constrained")
        grid = figure.add_gridspec(4, 3, width_ratios=(1.5, 0.8, 0.8), height_ratios=(1.6, 1.0, 1.0, 1.0))
        for i, label in enumerate(shown):
            run = run_of(every[label], COMMON)
            stop = stop_of(run)
            times = np.arange(0.0, min(stop.standstill, run.end), 2e-4)
            at = run.at(times)
            gone = np.concatenate([[0.0], np.cumsum((at["disc.car_speed"][1:] + at["disc.car_speed"][:-1]) / 2.0) * 2e-4])
            left = gone[-1] - gone
            near = left <= 1.0
            panel = figure.add_subplot(grid[i, 0])
            panel.plot(left[near], at["pad.speed"][near], color="0.5", linewidth=0.5, label="pad")
            panel.plot(left[near], BRAKE.radius * at["disc.speed"][near], color="black", linewidth=1.3, label="disc at the pads")
            panel.set(xlim=(1.0, 0.0), ylabel="speed [m/s]", ylim=(-0.75, 0.95))
            other = panel.twinx()
            other.plot(
                left[near], at["brake.force"][near] / PISTON / 1e5, color="tab:blue", linewidth=1.0, linestyle="--", label="pressure"
            )
            other.set(ylim=(0, 20))
            other.set_ylabel("pressure [bar]", color="tab:blue")
            panel.set_title(f"{label}: {stop.releases} releases, {stop.distance:.1f} m", loc="left", fontsize=9.0)
            if i == 0:
                lines = [*panel.lines, *other.lines]
                figure.legend(lines, [str(line.get_label()) for line in lines], frameon=False, fontsize=8.0, loc="upper left", ncols=3)
                closer = panel.inset_axes((0.05, 0.18, 0.44, 0.27))
                last = left <= 0.02
                closer.plot(1e3 * left[last], at["pad.speed"][last], color="0.5", linewidth=0.7)
                closer.plot(1e3 * left[last], BRAKE.radius * at["disc.speed"][last], color="black", linewidth=1.3)
                closer.set(xlim=(20.0, 0.0), yticks=[])
                closer.tick_params(labelsize=7.0)
                closer.text(0.03, 0.06, "the last 20 mm", fontsize=7.0, transform=closer.transAxes)
            if i < len(shown) - 1:
                panel.tick_params(labelbottom=False)
        panel.set_xlabel("distance to the place of standstill [m]")
        marks = {
            "-20 %": {"marker": "v", "color": "0.6"},
            "nominal": {"marker": "o", "color": "black"},
            "+20 %": {"marker": "^", "color": "0.35"},
        }
        columns = (("releases", "releases of the pad"), ("distance", "stopping distance [m]"))
        places = np.arange(len(rows))[::-1]
        for j, (name, label) in enumerate(columns, 1):
            panel = figure.add_subplot(grid[:, j])
            for row, place in zip(rows, places, strict=True):
                values = [getattr(stop, name) for stop in row.stops.values()]
                panel.plot([min(values), max(values)], [place, place], color="0.85", linewidth=3.0, zorder=1)
            for word, look in marks.items():
                values = [getattr(row.stops[word], name) for row in rows]
                panel.plot(values, places, linestyle="none", markersize=6, markerfacecolor=look["color"] if word == "nominal" else "white",
                           markeredgecolor=look["color"], marker=look["marker"], label=f"friction {word}".replace("-", "\N{MINUS SIGN}"), zorder=2)  # fmt: skip
            panel.set(xlabel=label, ylim=(-0.6, len(rows) - 0.4))
            if name == "releases":
                panel.set_xscale("symlog", linthresh=2.0)
                panel.axvspan(-0.2, 1.5, color="0.95", zorder=0)
                panel.text(0.6, len(rows) - 0.45, "silent", ha="center", va="bottom", fontsize=8.0)
                panel.set_xticks([0, 1, 2, 5, 10, 20, 50, 100], ["0", "1", "2", "5", "10", "20", "50", "100"])
                panel.minorticks_off()
                panel.set_yticks(
                    places, [row.label.replace(", ideal", ",\nideal").replace(", phased", ",\nphased") for row in rows], fontsize=8.0
                )
            else:
                panel.axvline(START**2 / (2.0 * COMMON), color="0.5", linestyle=":", linewidth=1.0)
                panel.set_yticks(places, [""] * len(rows))
                panel.legend(frameon=False, fontsize=8.0, loc="lower left", bbox_to_anchor=(0.0, 1.0))
            panel.spines[["top", "right"]].set_visible(False)
        figure.savefig(path, dpi=120)
        pyplot.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the tables, and with --out the csv and the pictures."""
    labels = [contender.label for contender in contenders()]
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=folder, help="folder for brakes.csv, brakes.png and brakes_dither.png")
    parser.add_argument("--only", nargs="+", choices=labels, default=labels, metavar="LABEL", help=f"some of: {', '.join(labels)}")
    given = parser.parse_args(arguments)
    rows = [row_of(contender) for contender in contenders() if contender.label in given.only]
    print(table(rows), flush=True)
    print(f"\n{creep_table()}", flush=True)
    print(f"\n{dither_table()}", flush=True)
    print(
        "\nexponent G of the growth of the pad under constant force: "
        + ", ".join(f"{groan_growth(BRAKE, force):.1f} at {force} N" for force in (300, 750, 1500, 5000))
    )
    if given.out:
        write_rows([row.flat() for row in rows], given.out / "brakes.csv")
        picture(rows, given.out / "brakes.png")
        dither_picture(given.out / "brakes_dither.png")
        print(f"Table and pictures are in {given.out}")


if __name__ == "__main__":
    main()
