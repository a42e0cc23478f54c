"""Which law brings a disc brake to standstill at the wanted deceleration, without groan?

Plant: `DiscBrake` with its defaults (a quarter of a car on the disc, pads and caliper at 50 Hz), from 6 rad/s (1.8 m/s at the tyre) to standstill,
forces between 100 N, which hold the wheel once it stands, and 5000 N, at most 20 kN/s. The disc is rough: 4 N more or less at 40 Hz on the pad, without
which it would come to the speed at which it loses its damping in a calm that no machine has. Laws are sampled every millisecond, the predictive one
every 30 ms; dither acts at once, by an actuator of its own.

Groan: two or more releases of the pad from stick while the disc still turns faster than 0.1 rad/s (12 mm/s at the pads); one release is not yet groan.
Slower than that every brake sticks a last time, because a pad that swings at all swings faster than the disc. A stop succeeds where there is no groan,
the disc stands, and its way is within 15 % of the planned one. Decelerations are scanned from 0.5 rad/s2 upward in steps of 0.1 until the first failure;
the table shows the last success before it, and what ended it: groan, the way, or the end of the scan.

nominal: the actuator follows at once, everything is measured at once and exactly.  real: an actuator of 10 ms, commands 2 ms late, 0.005 rad/s of
noise on the speed and 2 N m on the torque, friction 20 % higher (and so its fall), three seeds of noise. PI and sliding mode without ease then have
lower gains (`SOFT_PI`, `SOFT_SLIDING`), because with those of the nominal case they feed the noise to the pad; eased, they have them throughout.
These gains were chosen on the noise of `TUNING_SEEDS`; the table is judged on `VERDICT_SEEDS`, which were fixed before anything had been run on them,
and was run once:

                            highest, ended by [rad/s2]     real, at 2 rad/s2
                              nominal        real       groans     way     jolt
    constant force          2.2 groan   2.0 groan            1    -6 %     2.63
    constant force, eased     1.2 way     2.5 way            0    +6 %     0.56
    PI                      3.0 groan   0.8 groan           19    -3 %     2.24
    PI, eased                 1.7 way     2.5 way            0    +7 %     0.56
    sliding mode             5.0 scan   0.8 groan           22     0 %     2.03
    sliding mode, eased       1.9 way     2.4 way            0    +9 %     0.55
    MPC                       2.2 way     3.0 way            0    +6 %     0.50
    constant, sine dither < 0.5 groan < 0.5 groan           45    -6 %     0.73
    constant, phased dither   3.8 way    5.0 scan            0    -6 %     2.66

Laws that ease never groan here: what ends them is the way, which the ease makes longer; how long it has to be is asked by
`studies.questions.brake_margins`. 5.0 is the end of the scan.

At 2 rad/s2: times that the pad lets go, way beyond the planned one in parts of it (negative: shorter), rms of the speed error until the planned end,
peak force of a pad, and the jolt: the largest acceleration of the wheel backwards once it stands, as it swings on its caliper. Step: 99th
percentile of the time of one sample.

Where groan cannot be avoided: under a constant force the pad grows by exp(G) on its way through the speeds without damping,

    G = I / (2 m r^2) ln(mu_s / mu(r w_e)) - (what the caliper takes),   w_e the speed at which it loses its damping

(`models.closed_forms.groan_growth`). A larger force shortens the way and strengthens the growth alike, so that braking harder does not outrun groan: G rises
to I / (2 m r^2) ln(mu_s / mu_k), 31 here. What remains is to let friction fall without the torque falling, which takes an actuator faster than the
pad, to take the force back on the way to standstill, which takes way, or to change the contact (`studies.questions.dither`).

    python -m studies brakes [--out FOLDER] [--only LABEL ...]        (two and a half minutes of one processor; the table, brakes.csv and brakes.png)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from controllers import BrakeForce, BrakeMPC, BrakePI, BrakeSlidingMode, NormalDither, PhasedDither
from controllers.dither import LoadDither
from models import DiscBrake
from models.closed_forms import groan_growth
from studies.command_line import folder, parser_of, write_rows
from studies.questions.drives import update_times
from toolbox import HybridSystem, Sampled, SimulationError, Trajectory, compose, simulate
from toolbox.inputs import sine

BRAKE = DiscBrake(force=0.0)
START, SLOWEST, FARTHEST = 6.0, 0.1, 0.15
HIGHER = {"pad.friction.static": 0.54, "pad.friction.kinetic": 0.42}
NOISE = {"disc.speed": 0.005, "brake.torque": 2.0}
LAG, DELAY = 0.01, 0.002
TUNING_SEEDS = (11, 12, 13)
VERDICT_SEEDS = (2001, 2002, 2003)
COMMON, LOWEST, HIGHEST, STEP = 2.0, 0.5, 5.0, 0.1
EASED = 0.8
ON_FORCE = {"load": "brake.disturbance", "over": "brake.force"}
ON_PAD = {"speed": "pad.speed", "unit": "m/s"}
SOFT_PI = {"proportional": 0.1, "integral": 1.0}
SOFT_SLIDING = {"filter_time": 0.1, "reaching": 0.3, "width": 0.2, "surface": 1.0}


@dataclass(frozen=True)
class Contender:
    """A row: what makes the law for a deceleration [rad/s2], its period [s], other numbers of it under real conditions, the dither beside it."""

    label: str
    law: Callable[..., Any]
    period: float = 0.001
    real: dict[str, float] = field(default_factory=dict)
    dither: LoadDither | None = None


def contenders() -> list[Contender]:
    """All rows, in the order of the table."""
    return [
        Contender("constant force", BrakeForce),
        Contender("constant force, eased", partial(BrakeForce, margin=EASED)),
        Contender("PI", BrakePI, real=SOFT_PI),
        Contender("PI, eased", partial(BrakePI, margin=EASED, **SOFT_PI)),
        Contender("sliding mode", BrakeSlidingMode, real=SOFT_SLIDING),
        Contender("sliding mode, eased", partial(BrakeSlidingMode, margin=EASED, **SOFT_SLIDING)),
        Contender("MPC", partial(BrakeMPC, margin=EASED), 0.03),
        Contender("constant, sine dither", BrakeForce, dither=NormalDither(**ON_FORCE, depth=0.9, frequency=150.0)),
        Contender("constant, phased dither", BrakeForce, dither=PhasedDither(**ON_FORCE, **ON_PAD, depth=0.5, size=-0.2)),
    ]


# --- one stop


@dataclass(frozen=True)
class Stop:
    """What became of a stop, in SI: how often the pad lets go, time of standstill (inf for none), way and planned way [rad], rms error, peak force, jolt."""

    groans: int
    standstill: float
    way: float
    planned: float
    error: float
    peak: float
    jolt: float

    @property
    def excess(self) -> float:
        """Way beyond the planned one, in parts of it."""
        return self.way / self.planned - 1.0

    @property
    def fails(self) -> str:
        """What keeps the stop from success: `groan`, `stand` where the disc never does, `way` where that is off by more than 15 %; empty for one."""
        if self.groans >= 2:
            return "groan"
        return "stand" if not math.isfinite(self.standstill) else "way" if abs(self.excess) > FARTHEST else ""


def plant_of(lag: float | None) -> HybridSystem:
    """The brake behind an actuator of this time constant."""
    return compose(DiscBrake(force=0.0, lag=lag))


def run_of(
    contender: Contender, deceleration: float, real: bool, seed: int = 0, lag: float | None = None,
    parameters: Mapping[str, float] | None = None, phase: float = 0.0,
) -> Trajectory:  # fmt: skip
    """A stop of a contender.

    lag: of the actuator [s], parameters: of the machine, where they are not those of nominal or real;  phase: of the roughness of the disc,
    in parts of its period.
    """
    law = contender.law(deceleration=deceleration, **(contender.real if real else {}))
    lag = lag if lag is not None else LAG if real else None
    controllers: list[Any] = [Sampled(law, contender.period)]
    if real:
        noise = {name: value for name, value in NOISE.items() if name in law.measured_signals}
        controllers = [Sampled(law, contender.period, delay=DELAY, noise=noise, seed=seed)]
    if contender.dither is not None:
        controllers.append(replace(contender.dither, over="brake.normal_force" if lag else "brake.force"))
    duration = 2.0 * START / deceleration + 2.0
    if parameters is None:
        parameters = HIGHER if real else {}
    rough = {"pad.attachment": sine(0.0, 4.0, 40.0, 2.0 * math.pi * phase)}
    return simulate(plant_of(lag), duration, start={"disc.speed": START}, inputs=rough, controller=controllers, parameters=parameters)


def stop_of(run: Trajectory, deceleration: float) -> Stop:
    """The numbers of a stop, from samples every millisecond; the standstill is where the disc first ceases to turn."""
    times = np.arange(0.0, run.end, 1e-3)
    at = run.at(times)
    speed = at["disc.speed"]
    stands = np.flatnonzero(speed <= 0.0)
    end = int(stands[0]) if stands.size else times.size
    plan = np.maximum(START - deceleration * times, 0.0)
    releases = [event.time for event in run.events if event.element == "pad" and event.before == "stick" and event.time > 0.05]
    turning = np.interp(releases, times[:end], speed[:end], right=0.0) if releases else np.empty(0)
    backwards = -at["brake.torque"][end:] / BRAKE.inertia
    return Stop(
        groans=int((turning > SLOWEST).sum()),
        standstill=float(times[end]) if stands.size else math.inf,
        way=float(speed[:end].sum() * 1e-3),
        planned=START**2 / (2.0 * deceleration),
        error=float(np.sqrt(np.mean((speed - plan)[times <= START / deceleration] ** 2))),
        peak=float(at["brake.force"][:end].max()),
        jolt=float(backwards.max(initial=0.0)),
    )


def stops(contender: Contender, deceleration: float, real: bool) -> list[Stop]:
    """The stops of a contender: one, or one for each seed."""
    return [stop_of(run_of(contender, deceleration, real, seed), deceleration) for seed in (VERDICT_SEEDS if real else (0,))]


@dataclass(frozen=True)
class Border:
    """The last deceleration [rad/s2] that succeeds, nan where the first one fails, and what ends it at the next one: see `Stop.fails`, or `scan`, its end."""

    deceleration: float
    ended: str

    def __str__(self) -> str:
        return (f"{self.deceleration:.1f}" if self.deceleration == self.deceleration else f"< {LOWEST:g}") + f" {self.ended}"


def highest(contender: Contender, real: bool, lag: float | None = None, step: float = STEP) -> Border:
    """The border of the upward scan."""
    found = math.nan
    for k in range(round((HIGHEST - LOWEST) / step) + 1):
        deceleration = round(LOWEST + k * step, 2)
        try:
            for seed in VERDICT_SEEDS if real else (0,):
                failed = stop_of(run_of(contender, deceleration, real, seed, lag), deceleration).fails
                if failed:
                    return Border(found, failed)
        except SimulationError:
            return Border(found, "failed run")
        found = deceleration
    return Border(found, "scan")


# --- the table


@dataclass(frozen=True)
class Verdict:
    """A line of the table: highest decelerations and what ends them, then the worst of the real stops at 2 rad/s2, and the step time [s]."""

    label: str
    nominal: Border
    real: Border
    groans: int
    excess: float
    error: float
    peak: float
    jolt: float
    step: float


def verdict(contender: Contender) -> Verdict:
    """The line of one contender."""
    found = stops(contender, COMMON, True)
    way = max((stop.excess for stop in found), key=abs)
    worst = {name: max(getattr(stop, name) for stop in found) for name in ("groans", "error", "peak", "jolt")}
    return Verdict(contender.label, highest(contender, False), highest(contender, True), excess=way, step=step_time(contender), **worst)


def step_time(contender: Contender) -> float:
    """99th percentile [s] of the time of one sample."""
    runs = [run_of(contender, COMMON, True, seed) for seed in VERDICT_SEEDS]
    return min(
        run.controllers[0].record.p99 if run.controllers else float(np.percentile(update_times(run), 99)) for run in runs
    )  # the least disturbed


def _flat(row: Verdict) -> dict[str, Any]:
    """A line as one level of names."""
    borders = {word: getattr(row, word) for word in ("nominal", "real")}
    flat = {
        name: number for word, each in borders.items() for name, number in ((word, each.deceleration), (f"{word}, ended by", each.ended))
    }
    return {"label": row.label} | flat | {name: getattr(row, name) for name in ("groans", "excess", "error", "peak", "jolt", "step")}


def table(rows: Sequence[Verdict]) -> str:
    """The rows as text."""
    head = f"{'':<24}{'highest [rad/s2], ended by':>26}{'real, at 2 rad/s2':>50}"
    names = f"{'law':<24}{'nominal':>13}{'real':>13}{'groans':>9}{'way':>9}{'rms error':>13}{'peak':>9}{'jolt':>13}{'step p99':>12}"
    lines = [head, names, "-" * len(names)]
    for row in rows:
        lines.append(
            f"{row.label:<24}{row.nominal!s:>13}{row.real!s:>13}{row.groans:>9d}{100 * row.excess:>+7.0f} %{row.error:>7.3f} rad/s{row.peak:>7.0f} N"
            f"{row.jolt:>7.2f} rad/s2{1e6 * row.step:>9.1f} us"
        )
    return "\n".join(lines)


# --- the picture


def picture(path: Path) -> None:
    """Four stops, and how far each law keeps its way without groan behind a slower actuator."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    from toolbox import measure, plot

    every = {contender.label: contender for contender in contenders()}
    with pyplot.rc_context(plot.PAPER):
        figure = pyplot.figure(figsize=(10.5, 5.4), layout="constrained")
        grid = figure.add_gridspec(4, 2, width_ratios=(1.5, 1.0))
        for i, (label, lag) in enumerate((("constant force", LAG), ("sliding mode", 0.001), ("sliding mode", LAG), ("MPC", LAG))):
            run = run_of(every[label], 3.0, False, lag=lag)
            times = np.linspace(0.0, 4.6, 12_000)
            at = run.at(times)
            panel = figure.add_subplot(grid[i, 0])
            for begin, end in measure.stick_intervals(run, "pad"):
                panel.axvspan(begin, min(end, 4.6), facecolor="0.88", linewidth=0, zorder=0)
            panel.plot(times, 1e3 * at["pad.speed"], color="0.25", linewidth=0.6, label="pad")
            panel.plot(times, 120.0 * at["disc.speed"], color="black", linewidth=1.3, label="disc at the pads")
            panel.plot(times, np.maximum(720.0 - 360.0 * times, 0), color="0.5", linewidth=0.9, linestyle=":", label="plan")
            panel.set(ylabel="speed [mm/s]", xlim=(0, 4.6), ylim=(-420, 760))
            stop = stop_of(run, 3.0)
            ended = {"": "succeeds", "stand": "does not stand", "way": "fails"}.get(stop.fails, stop.fails)
            told = f"{ended}, way {100 * stop.excess:+.0f} %".replace("-", "\N{MINUS SIGN}")
            panel.set_title(f"{label}, actuator of {1e3 * lag:.0f} ms, 3 rad/s$^2$: {told}", loc="left", fontsize=9.0)
            if i == 0:
                panel.legend(frameon=False, fontsize=8.0, loc="upper right", ncols=3)
            if i < 3:
                panel.tick_params(labelbottom=False)
        panel.set_xlabel("time [s], grey where the pad sticks")
        right = figure.add_subplot(grid[:, 1])
        lags = (0.0005, 0.001, 0.002, 0.003, 0.005, 0.007, 0.01, 0.02, 0.03)
        styles: dict[str, dict[str, Any]] = {  # the constant force and the MPC may lie upon each other: one is wide, the other thin
            "constant force": {"color": "0.75", "marker": "s", "linewidth": 4.5, "markersize": 8},
            "PI": {"color": "0.35", "marker": "^"},
            "sliding mode": {"color": "black", "marker": "o"},
            "sliding mode, eased": {"color": "0.35", "marker": "v", "linestyle": "--"},
            "MPC": {"color": "black", "marker": "D", "markersize": 4},
        }
        for label, style in styles.items():
            borders = [highest(every[label], False, lag, 0.25) for lag in lags]
            found, at = np.nan_to_num([each.deceleration for each in borders]), 1e3 * np.array(lags)
            look = {"linewidth": 1.0, "markersize": 6} | style
            right.semilogx(at, found, **look, markevery=[each.ended == "groan" for each in borders], label=label)
            right.semilogx(
                at, found, **look | {"linewidth": 0}, markevery=[each.ended != "groan" for each in borders], markerfacecolor="white"
            )
            for x, y, each in zip(at, found, borders, strict=True):
                if each.ended not in ("groan", "way"):
                    right.annotate(each.ended, (x, y), (0, 5), textcoords="offset points", ha="center", fontsize=7.0)
        right.set(
            xlabel="time constant of the actuator [ms]",
            ylabel="highest deceleration without groan,\nway within 15 % [rad/s$^2$]",
            ylim=(0, None),
        )
        right.set_xticks([0.5, 1, 2, 5, 10, 20, 30], ["0.5", "1", "2", "5", "10", "20", "30"])
        right.minorticks_off()
        right.set_title("filled: ended by groan; open: by its way", loc="left", fontsize=9.0)
        right.legend(frameon=False, fontsize=8.0)
        right.spines[["top", "right"]].set_visible(False)
        figure.savefig(path, dpi=120)
        pyplot.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the table, and with --out its csv and picture."""
    labels = [contender.label for contender in contenders()]
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=folder, help="folder for brakes.csv and brakes.png")
    parser.add_argument("--only", nargs="+", choices=labels, default=labels, metavar="LABEL", help=f"some of: {', '.join(labels)}")
    given = parser.parse_args(arguments)
    rows = [verdict(contender) for contender in contenders() if contender.label in given.only]
    print(table(rows))
    print(
        "\nexponent G of the growth of the pad under constant force: "
        + ", ".join(f"{groan_growth(BRAKE, force):.1f} at {force} N" for force in (300, 750, 1500, 5000))
    )
    if given.out:
        write_rows([_flat(row) for row in rows], given.out / "brakes.csv")
        picture(given.out / "brakes.png")
        print(f"Table and picture are in {given.out}")


if __name__ == "__main__":
    main()
