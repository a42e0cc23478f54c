"""Which drive law ends an existing stick-slip at the lowest set-point?

Plant: the two inertias of Jansen and van den Steen with the bit of Navarro-Lopez and Cortes at 97 347 N, as in `studies/scenes/jansen_2.toml`. Every law is
switched on cold (memories at their start values) at the end of a stick phase of the stiff PI drive at the same set-point, commands 0 to 20 kN m,
and is sampled every 10 ms for 300 s. It succeeds where, over the last 30 %, the bit does not stick, severity is below 0.05 (0.15 with noise) and the
mean speed is within 5 % of the set-point. Set-points are scanned from 14 rad/s downward in steps of 0.1 rad/s until the first failure; the table shows
the last success before it.

nominal: every signal that the law asks for is measured, at once and exactly.  real: only the top speed is measured, with 0.01 rad/s rms of white
noise; commands come 30 ms late; the weight on bit is 10 % more than the law was designed for; each set-point must succeed with five seeds of noise that
no tuning has seen. Laws that ask for more than the top speed then act on a Kalman filter.

Predictive laws are sampled every 0.1 s, plan 4 s, bring their own filter, and know that commands are late; nominal, they measure speeds and twist. A sample
of theirs costs a thousand times that of the others, so that between 14 and 5 rad/s only whole set-points are tried.

Settling (into 5 %, for good) and overshoot of the bit speed are nominal, at 8 rad/s. Step: 99th percentile of the processor time that one sample of the
law takes, its Kalman filter included.

    python -m studies drives [--out FOLDER] [--only LABEL ...] [--jobs N]        (some minutes; the table, drives.csv and drives.png)
"""

from __future__ import annotations

import argparse
import csv
import ctypes
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from controllers import (
    LQG,
    LQR,
    PI,
    ActiveDamping,
    HInfinity,
    ImpedanceSuperTwisting,
    ImplicitSlidingMode,
    LinearMPC,
    NonlinearMPC,
    OnEstimates,
    SlidingMode,
    SoftTorque,
    StiffPI,
    SuperTwisting,
    ZTorque,
)
from controllers.observers import Kalman
from models import BitRock, wells
from toolbox import Sampled, SimulationError, Trajectory, compose, simulate

WEIGHT = 97_347.0
PLANT = compose(wells.JANSEN_2, BitRock(weight=WEIGHT))
LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}
STATES: dict[str, Any] = {"sensors": ("top.speed", "bit.speed", "chain.twist.0"), "noise": (1e-3, 1e-3, 1e-3)}
DURATION, WINDOW = 300.0, 210.0
NOISE, DELAY, HEAVIER = 0.01, 0.03, 1.1
SEEDS = (101, 102, 103, 104, 105)
"""Seeds of the verdict; the numbers of the laws were chosen with the seeds 1 to 3."""
HIGHEST, STEP = 14.0, 0.1
GRID = np.arange(WINDOW, DURATION, 0.02)


@dataclass(frozen=True)
class Contender:
    """A row: what makes the law for a set-point [rad/s], with every signal measured and with the top speed alone, and its period [s].

    Both may return a Controller or a Python callable (t, y) -> torque; the second knows that commands are late by DELAY. Above `coarse` [rad/s] only
    whole set-points are tried.
    """

    label: str
    nominal: Callable[[float], Any]
    real: Callable[[float], Any]
    period: float = 0.01
    coarse: float = np.inf


def on_speed(label: str, law: Callable[..., Any], **numbers: float) -> Contender:
    """A law that asks for the top speed alone: the same with either information."""
    return Contender(
        label,
        lambda reference: law(reference=reference, **numbers, **LIMITS),
        lambda reference: law(reference=reference, **numbers, **LIMITS),
    )


def on_estimates(label: str, law: Callable[..., Any], **numbers: float) -> Contender:
    """A law that asks for more, and gets the estimates of a Kalman filter where the top speed is all there is."""

    def nominal(reference: float) -> Any:
        return law(reference=reference, **numbers, **LIMITS)

    return Contender(label, nominal, lambda reference: OnEstimates(nominal(reference), Kalman(speed_noise=NOISE), late=round(DELAY / 0.01)))


def predictive(label: str, law: Callable[..., Any]) -> Contender:
    """A predictive law on the plant, which estimates what it does not measure."""
    return Contender(
        label,
        lambda reference: law(reference=reference, **LIMITS, **STATES).design(PLANT),
        lambda reference: law(reference=reference, delay=DELAY, **LIMITS).design(PLANT),
        period=0.1,
        coarse=5.0,
    )


def contenders() -> list[Contender]:
    """All rows, in the order of the table."""
    return [
        on_speed("stiff PI", StiffPI),
        on_speed("PI", PI),
        on_speed("active damping", ActiveDamping),
        on_speed("soft torque", SoftTorque),
        on_speed("Z-torque", ZTorque, filter_time=0.02),
        on_estimates("sliding mode", SlidingMode),
        on_estimates("implicit sliding mode", ImplicitSlidingMode),
        on_estimates("super-twisting", SuperTwisting),
        on_estimates("impedance super-twisting", ImpedanceSuperTwisting),
        on_speed("H-infinity", HInfinity),
        Contender(
            "LQR, LQG",
            lambda reference: LQR(reference=reference, **LIMITS),
            lambda reference: LQG(reference=reference, late=round(DELAY / 0.01), speed_noise=NOISE, **LIMITS),
        ),
        predictive("linear MPC", LinearMPC),
        predictive("nonlinear MPC", NonlinearMPC),
    ]


# --- one attempt


@cache
def stick_phase_end(reference: float, real: bool) -> dict[str, Any]:
    """The states at the end of a stick phase of the stiff PI drive; where it leaves none, after 200 s."""
    run = simulate(PLANT, 200.0, controller=StiffPI(reference=reference, **LIMITS), sample_time=0.01, inputs=_weight(real))
    releases = [event.time for event in run.events if event.before == "stick"]
    point = run.at(releases[-1] if releases else 200.0)
    return {name: point[name] for name in PLANT.states}


def _weight(real: bool) -> dict[str, float]:
    return {"bit.weight": HEAVIER * WEIGHT} if real else {}


def run_of(contender: Contender, reference: float, real: bool, seed: int = 0, output_times: Any = GRID, law: Any = None) -> Trajectory:
    """A contender at a set-point, from the end of a stick phase. Raises SimulationError where the run cannot be finished."""
    law = law if law is not None else (contender.real if real else contender.nominal)(reference)
    measured = (
        Sampled(law, contender.period, delay=DELAY, noise={"top.speed": NOISE}, seed=seed) if real else Sampled(law, contender.period)
    )
    return simulate(
        PLANT, DURATION, controller=measured, start=stick_phase_end(reference, real), inputs=_weight(real), output_times=output_times
    )


def succeeds(run: Trajectory, reference: float, real: bool) -> bool:
    """Whether the bit is free, steady and at its set-point over the last 30 % of a run recorded at GRID."""
    speed = run["bit.speed"]
    mean = float(speed.mean())
    if run.time_in("bit", "stick", after=WINDOW) > 0.0 or abs(mean / reference - 1.0) > 0.05:
        return False
    return float(np.ptp(speed)) / (2.0 * mean) < (0.15 if real else 0.05)


def lowest(contender: Contender, real: bool, highest: float = HIGHEST) -> float:
    """The last set-point [rad/s] of the downward scan that succeeds; nan where the first one fails."""
    found = np.nan
    for reference in _downward(highest, contender.coarse):
        for seed in SEEDS if real else (0,):
            try:
                if not succeeds(run_of(contender, reference, real, seed), reference, real):
                    return found
            except SimulationError:
                return found
        found = reference
    return found


def _downward(highest: float, coarse: float = np.inf) -> Iterator[float]:
    for k in range(round(highest / STEP) - 4):
        reference = round(highest - k * STEP, 1)
        if reference <= coarse or reference.is_integer():
            yield reference


# --- the table


@dataclass(frozen=True)
class Verdict:
    """A line of the table: set-points in rad/s (nan for none), settling in s (inf for never), overshoot in parts of the set-point, step in s."""

    label: str
    nominal: float
    real: float
    settling: float
    overshoot: float
    step: float


PARTS = ("nominal", "real", "common")
"""What a line is made of: two scans, and one run."""


def part_of(label: str, part: str) -> tuple[float, ...]:
    """Numbers of one of PARTS of the line of a contender, by its label, so that it can be made in another process."""
    contender = next(c for c in contenders() if c.label == label)
    if part != "common":
        return (lowest(contender, part == "real"),)
    common = 8.0
    run = run_of(contender, common, False, output_times=np.arange(0.0, DURATION, 0.02))
    speed = run["bit.speed"]
    outside = np.flatnonzero(np.abs(speed / common - 1.0) > 0.05)
    settling = 0.0 if not outside.size else np.inf if outside[-1] == speed.size - 1 else float(run.time[outside[-1] + 1])
    return settling, float(speed.max() / common - 1.0), step_time(contender, common)


def step_time(contender: Contender, reference: float) -> float:
    """99th percentile [s] of the time of one sample of the law that knows the top speed alone; of the processor, where that can be resolved."""
    law = contender.real(reference)
    times: list[int] = []
    if not hasattr(law, "sampled"):  # a Python callable: timed where it is called

        def timed(t: float, y: Any) -> Any:
            began = time.thread_time_ns()
            answer = law(t, y)
            times.append(time.thread_time_ns() - began)
            return answer

        timed.measures, timed.drives = getattr(law, "measures", ("top.speed",)), getattr(law, "drives", ("top.torque",))  # type: ignore[attr-defined]
        run_of(contender, reference, True, SEEDS[0], law=timed)
    else:
        return float(np.percentile(update_times(run_of(contender, reference, True, SEEDS[0])), 99))
    return float(np.percentile(times, 99)) * 1e-9


def update_times(run: Trajectory) -> list[float]:
    """How long [s] the compiled update of the first sampled law of a run takes, 20 000 times at its last state."""
    update, machine = run.run.system.updates[0], run.program.machine
    size = update.memory.numel() + update.noise.numel()
    function = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_double, *[ctypes.c_void_p] * 5)(machine.updates[0])
    x, k, m = run.states[-1].copy(), np.zeros(size + 1), np.ones(machine.elements)
    y = np.zeros(update.memory.numel() + update.outputs.numel() + 1)
    pointers = [array.ctypes.data for array in (x, k, run.parameters, m, y)]
    times = []
    for _ in range(20_000):
        began = time.perf_counter_ns()
        function(0.0, 0.0, *pointers)
        times.append(1e-9 * (time.perf_counter_ns() - began))
    return times


def table(rows: Sequence[Verdict]) -> str:
    """The rows as text."""
    head = f"{'controller':<26}{'lowest set-point':>20}{'settling':>12}{'overshoot':>12}{'step p99':>12}"
    lines = [head, f"{'':<26}{'nominal':>10}{'real':>10}{'at 8 rad/s':>24}", "-" * len(head)]
    for row in rows:
        speeds = [f"{value:.1f}" if value == value else f"> {HIGHEST:g}" for value in (row.nominal, row.real)]
        settling = f"{row.settling:.1f} s" if np.isfinite(row.settling) else "never"
        lines.append(f"{row.label:<26}{speeds[0]:>10}{speeds[1]:>10}{settling:>12}{100 * row.overshoot:>10.0f} %{1e6 * row.step:>9.1f} us")
    return "\n".join(lines)


def picture(rows: Sequence[Verdict], path: Path) -> None:
    """Lowest set-points of all laws, and what three of them do with a bit in stick-slip at 3 rad/s under real conditions."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (bars, traces) = pyplot.subplots(1, 2, figsize=(12, 4.6), layout="constrained", gridspec_kw={"width_ratios": [1, 1.25]})
    place = np.arange(len(rows))[::-1]
    for offset, attribute, colour in ((0.2, "nominal", "0.72"), (-0.2, "real", "0.25")):
        values = [getattr(row, attribute) for row in rows]
        bars.barh(place + offset, np.nan_to_num(values, nan=HIGHEST), 0.38, color=colour, label=attribute)
        for y, value in zip(place + offset, values, strict=True):
            bars.text(
                np.nan_to_num(value, nan=HIGHEST) + 0.15, y, f"{value:.1f}" if value == value else f"> {HIGHEST:g}", va="center", fontsize=7
            )
    bars.set_yticks(place, [row.label for row in rows], fontsize=8)
    bars.set_xlabel("lowest set-point at which stick-slip ends [rad/s]")
    bars.legend(loc="lower right", fontsize=8)
    bars.spines[["top", "right"]].set_visible(False)
    every = {c.label: c for c in contenders()}
    styles = {"soft torque": ("0.6", "-"), "Z-torque": ("tab:blue", "--"), "LQR, LQG": ("black", "-")}
    for label, (colour, line) in styles.items():
        run = run_of(every[label], 3.0, True, SEEDS[0], output_times=np.arange(0.0, 80.0, 0.02))
        traces.plot(run.time, run["bit.speed"], line, color=colour, lw=1.2, label=label if label != "LQR, LQG" else "LQG")
    traces.axhline(3.0, color="0.5", lw=0.7, ls=":")
    traces.set(xlabel="time since the law was switched on [s]", ylabel="bit speed [rad/s]", xlim=(0, 80))
    traces.set_title("top speed measured with noise, 30 ms late, weight + 10 %", fontsize=9)
    traces.legend(fontsize=8, loc="upper right")
    traces.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)
    pyplot.close(figure)


def write_rows(rows: Sequence[Any], path: Path) -> None:
    """Write rows of a verdict, dataclasses of one kind, as csv."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(asdict(rows[0])))
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the table, and with --out its csv and picture."""
    labels = [contender.label for contender in contenders()]
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, help="folder for drives.csv and drives.png")
    parser.add_argument("--only", nargs="+", choices=labels, default=labels, metavar="LABEL", help=f"some of: {', '.join(labels)}")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    given = parser.parse_args(arguments)
    tasks = sorted(((label, part) for label in given.only for part in PARTS), key=lambda task: ("MPC" not in task[0], task[1] != "real"))
    with ProcessPoolExecutor(given.jobs) as pool:  # the longest first, so that none is left alone at the end
        found = dict(zip(tasks, pool.map(part_of, *zip(*tasks, strict=True)), strict=True))
    rows = [Verdict(label, *(value for part in PARTS for value in found[label, part])) for label in given.only]
    print(table(rows))
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
        write_rows(rows, given.out / "drives.csv")
        picture(rows, given.out / "drives.png")
        print(f"\nTable and picture are in {given.out}")


if __name__ == "__main__":
    main()
