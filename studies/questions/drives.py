"""Which drive law ends an existing stick-slip at the lowest set-point, and what is left of that on a rig that is not the declared one?

Every law is judged by `studies.protocol`: it takes over from a stiff PI drive that has the rig in stick-slip, at eight phases of the cycle, on the declared
rig and on others, with seeds of the noise that no tuning has seen. All measure the top speed alone, know that commands come 30 ms late, give 0 to 20 kN m and
are sampled every 10 ms; those that ask for more act on a Kalman filter. Predictive laws are sampled every 0.1 s, plan 4 s and bring their own filter. A run
of the nonlinear one takes a second, hundreds of times that of others, so that its set-points are searched in steps of 0.5 rad/s, with two phases and one seed.

Laws with "tuned" in their label have the gains of `studies/data/gains.json`, each with its budget; those of the others are as they are delivered.
Laws with "lifting" in it lift their own set-point where an observer shows that the bit sticks and slips (`controllers.Lifting`).

Columns: lowest set-points [rad/s] on the groups of rigs, takeover / ramp, each kept for half an hour on machines whose smooth running is stable
(nonlinear predictive law: for 80 s);  settling (into 5 %, for good) and overshoot of the bit speed from the takeover at 8 rad/s on the declared rig,
and there the standard deviation of the torque over its mean under noise;  disk margin of the declared rig and of the worst rig of `one_at_a_time`, each at the
set-point of its group ('-' for laws without a slope);  what a takeover costs at the set-point of the declared rig: seconds more than 10 % above it,
and the highest speed of the bit over it;  99th percentile of the processor time of a sample.

    python -m studies drives [--out FOLDER] [--only LABEL ...] [--groups NAME ...] [--margin M] [--jobs N]
        (the table, drives.csv and drives.png; goes on where it was stopped)
    python -m studies drives --draw --out FOLDER                       (drives.png alone, of the best rows that stand in the docs)
    python -m studies drives --tune FAMILY ... [--runs N] [--jobs N] [--out FOLDER] [--keep]      (the gains, see `studies.gains`)
"""

from __future__ import annotations

import csv
import ctypes
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
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
    Lifting,
    LinearMPC,
    NonlinearMPC,
    SlidingMode,
    SoftTorque,
    StiffPI,
    StringObserverController,
    SuperTwisting,
    ZTorque,
)
from controllers.observers import Kalman
from studies import gains
from studies.command_line import folder, parser_of, write_rows
from studies.protocol import CORNERS, DELAY, GROUPS, HIGHEST, LIMITS, LOWEST, NOISE, PLANT, WEIGHT, rock_torques, trial
from toolbox import Controller, Sampled, Trajectory, plot, simulate, use_units
from toolbox.drilling.groups import Group, Machine
from toolbox.drilling.lowest_set_point import Cells, SetPointLimit, borders
from toolbox.drilling.set_points import PROTOCOLS, Trial
from toolbox.figures.style import name_axis
from toolbox.modelling.laws import designed
from toolbox.sweeps.executors import Workers

__all__ = ["DELAY", "LIMITS", "NOISE", "PLANT", "WEIGHT", "Row", "laws", "row", "step_time", "table"]

COMMON = 8.0
"""Set-point [rad/s] of settling, overshoot, ripple and time per sample."""
EXAMPLE = 4.2
"""Set-point of the picture [rad/s]."""
SHOWN = ("soft torque", "LQG, tuned", "LQG, between, lifting")
"""Laws of the picture."""
LATE = round(DELAY / 0.01)
PREDICTIVE = ("linear MPC", "nonlinear MPC")
KINDS = (
    "stiff PI", "PI", "active damping", "soft torque", "impedance", "Z-torque", "sliding mode", "implicit sliding mode", "super-twisting",
    "impedance super-twisting", "LQR on a Kalman filter", "H-infinity", "LQG", *PREDICTIVE,
)  # fmt: skip
"""Laws in the order of the table."""
BETWEEN, PLACES = 0.25, 5
"""Where the row "LQG, between, lifting" stands between the gains that are tuned without a lift and with it: of so many places that were tried, the one that
leaves the largest least of `gains.margins_at`."""
GENTLE = {"first_factor": 1.6, "raise_rate": 0.3, "speed_limit_factor": 1.7, "min_speed_limit": 6.8}
"""Numbers of its lift, by which the top stays below twice what is asked from 4 rad/s on."""
TABLE = Path(__file__).parents[2] / "docs" / "drives.csv"
"""The rows that stand in the docs."""
FULL, BRIEF = "all phases and seeds, half an hour", "2 phases, 1 seed, 80 s, steps of 0.5 rad/s"
"""What a row is judged by."""


def laws() -> dict[str, Trial]:
    """All rows, in the order of the table, by label."""

    def on_estimates(kind: Callable[..., Any]) -> StringObserverController:
        return StringObserverController(kind(**LIMITS), Kalman(speed_noise=NOISE), delay_samples=LATE)

    rows = {
        "stiff PI": StiffPI(**LIMITS),
        "PI": PI(**LIMITS),
        "active damping": ActiveDamping(**LIMITS),
        "soft torque": SoftTorque(**LIMITS),
        "Z-torque": ZTorque(filter_time=0.02, **LIMITS),
        "sliding mode": on_estimates(SlidingMode),
        "implicit sliding mode": on_estimates(ImplicitSlidingMode),
        "super-twisting": on_estimates(SuperTwisting),
        "impedance super-twisting": on_estimates(ImpedanceSuperTwisting),
        "LQR on a Kalman filter": on_estimates(LQR),
        "H-infinity": HInfinity(**LIMITS),
        "LQG": LQG(delay_samples=LATE, speed_noise=NOISE, **LIMITS),
        "soft torque, lifting": Lifting(SoftTorque(**LIMITS)),
        "LQG, between, lifting": replace(gains.FAMILIES["LQG, lifting"].of(gains.between("LQG", "LQG, lifting", BETWEEN)), **GENTLE),
    }
    found = {label: trial(label, law) for label, law in rows.items()}
    for label, kind in zip(PREDICTIVE, (LinearMPC, NonlinearMPC), strict=True):
        found[label] = trial(label, kind(delay=DELAY, **LIMITS), 0.1)
    for family in gains.known():
        label, planned = gains.label_of(family), gains.FAMILIES[family].planned
        found[label] = trial(label, gains.tuned(family), 0.1 if planned else 0.01)
    return dict(sorted(found.items(), key=lambda pair: _place(pair[0])))


def _place(label: str) -> tuple[bool, bool, int, str]:
    """Where a row stands: predictive laws last, those that lift before them, kinds in one order, tuned ones after those as they are."""
    kind = label.partition(",")[0]
    return kind in PREDICTIVE, label.endswith("lifting"), KINDS.index(kind) if kind in KINDS else len(KINDS), label


def predictive(label: str) -> bool:
    """Whether a law is one of `PREDICTIVE`, as it is or tuned."""
    return label.partition(",")[0] in PREDICTIVE


def briefly(label: str) -> bool:
    """Whether a law is judged by few runs: the nonlinear predictive law, of which one takes a second."""
    return label.partition(",")[0] == PREDICTIVE[1]


def groups_of(law: Trial) -> dict[str, Group]:
    """The groups of rigs for a law, with fewer phases and seeds where it is judged briefly."""
    if not briefly(law.label):
        return GROUPS
    return {name: replace(group, takeover_phases=group.takeover_phases[::4], seeds=group.seeds[:1]) for name, group in GROUPS.items()}


@dataclass(frozen=True)
class Row:
    """A line of the table: set-points [rad/s] by group and way (nan for none), settling [s] (inf for never), overshoot and ripple as parts, step [s].

    margins: disk margins of the declared machine and of the worst of `one_at_a_time`, each at the set-point of its group (nan for none).
    recovery, fastest: what the takeover costs on the declared machine at its set-point: seconds above it, and highest bit speed over it.
    """

    label: str
    lowest: Mapping[str, tuple[float, float]]
    settling: float
    overshoot: float
    ripple: float
    step: float
    margins: tuple[float, float]
    recovery: float = np.nan
    fastest: float = np.nan


def row(law: Trial, names: Sequence[str] = tuple(GROUPS), cells: Cells | None = None, margin: float = 0.0) -> Row:
    """The line of a law with some of the groups; margin: disk margin that its set-points have to leave."""
    brief = briefly(law.label)
    groups = [replace(groups_of(law)[name], min_disk_margin=margin) for name in names]
    found = borders(law, groups, cells=cells, lower=LOWEST, higher=HIGHEST, step=0.5 if brief else 0.1, lasts=not brief)
    quiet = law.run(Machine("nominal"), COMMON, noise=0.0)
    speed = quiet.at(np.arange(law.takeover(COMMON), quiet.end, 0.02))["bit.speed"]
    outside = np.flatnonzero(np.abs(speed / COMMON - 1.0) > 0.05)
    settling = 0.0 if not outside.size else np.inf if outside[-1] == speed.size - 1 else 0.02 * float(outside[-1] + 1)
    noisy = law.run(Machine("nominal"), COMMON)
    torque = noisy.at(np.arange(noisy.end - 60.0, noisy.end, law.period) + law.period / 2)["top.torque"]
    ripple = float(torque.std() / torque.mean())
    declared, robust = (found.get((name, "takeover"), SetPointLimit(np.nan, "")) for name in ("nominal", "one_at_a_time"))
    speeds = {name: (found[name, "takeover"].lowest_set_point, found[name, "ramp"].lowest_set_point) for name in names}
    overshoot = float(speed.max() / COMMON - 1.0)
    held, price = (declared.disk_margin, robust.disk_margin), (declared.recovery_time, declared.max_bit_speed / declared.lowest_set_point)
    return Row(law.label, speeds, settling, overshoot, ripple, step_time(law, COMMON), held, *price)


def judged_rows(labels: Sequence[str], names: Sequence[str], path: Path | None, jobs: int, margin: float = 0.0) -> list[Row]:
    """The lines of some laws, judged in so many processes, those that take longest first; each writes its cells to one file as it knows them."""
    ordered = sorted(labels, key=lambda label: not predictive(label))
    with Workers(jobs) as workers:
        found = dict(
            zip(ordered, workers.map(_row_of, ordered, [names] * len(labels), [path] * len(labels), [margin] * len(labels)), strict=True)
        )
    return [found[label] for label in labels]


def _row_of(label: str, names: Sequence[str], path: Path | None, margin: float) -> Row:
    return row(laws()[label], names, Cells(path, lambda line: print(line, file=sys.stderr, flush=True)), margin)


def step_time(law: Trial, reference: float) -> float:
    """99th percentile [s] of the time of one sample of a law: of its record where it is predictive, else of its compiled update."""
    made, noise = designed(law.of(reference), PLANT), {"top.speed": NOISE}
    if isinstance(made, Controller):
        return float(np.percentile(update_times(simulate(PLANT, 20.0, controller=Sampled(made, law.period, noise=noise))), 99))
    times: list[int] = []

    class Timed:
        """The law, timed where it is called."""

        measured_signals, actuated_signals, defaults = made.measured_signals, made.actuated_signals, made.defaults

        def __call__(self, t: float, y: Any) -> float:
            began = time.thread_time_ns()
            answer = float(made(t, y))
            times.append(time.thread_time_ns() - began)
            return answer

    simulate(PLANT, 180.0, controller=Sampled(Timed(), law.period, law.clock.delay, noise))
    return float(np.percentile(times, 99)) * 1e-9


def update_times(run: Trajectory) -> list[float]:
    """How long [s] the compiled update of the first sampled law of a run takes, 20 000 times at its last state."""
    update, machine = run.run.system.updates[0], run.program.kernel
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


def table(rows: Sequence[Row]) -> str:
    """The rows as text."""
    names = list(rows[0].lowest)
    head = f"{'controller':<26}" + "".join(f"{name:>16}" for name in names) + f"{'settling':>11}{'overshoot':>11}{'ripple':>9}"
    head += f"{'disk margin':>18}{'recovery':>11}{'fastest':>9}{'step p99':>11}"
    under = f"{'':<26}" + f"{'takeover/ramp':>16}" * len(names) + f"{'at 8 rad/s':>31}{'nominal / one':>18}{'at the lowest':>20}"
    lines = [head, under, "-" * len(head)]
    for each in rows:
        speeds = [" / ".join(f"{value:.1f}" if value == value else "none" for value in each.lowest[name]) for name in names]
        margins = " / ".join("-" if np.isnan(value) else f"{value:.2f}" for value in each.margins)
        settling = f"{each.settling:.1f} s" if np.isfinite(each.settling) else "never"
        lines.append(
            f"{each.label:<26}" + "".join(f"{text:>16}" for text in speeds)
            + f"{settling:>11}{100 * each.overshoot:>9.0f} %{100 * each.ripple:>7.1f} %{margins:>18}{each.recovery:>9.0f} s{each.fastest:>7.1f} x"
            + f"{1e6 * each.step:>8.1f} us"
        )  # fmt: skip
    return "\n".join(lines)


def rocks() -> str:
    """How far the torques of the rocks are apart at set-points, as text."""
    lines = [f"{'torque of the rock [kN m]':<26}" + "".join(f"{name:>18}" for name in rock_torques(COMMON))]
    for reference in (0.001, 3.0, 4.0, 6.0, 8.0):
        lines.append(f"{reference:>10.0f} rad/s{'':<10}" + "".join(f"{value / 1e3:>18.2f}" for value in rock_torques(reference).values()))
    return "\n".join(lines)


def published() -> dict[str, dict[tuple[str, str], float]]:
    """{label: {(group, way): set-point [rad/s], nan for none}} of the cells of the table in the docs that were judged."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        rows = {row["label"]: row for row in csv.DictReader(file)}
    return {
        label: {(name, way): float(text) for name in GROUPS for way in PROTOCOLS if (text := row[f"{name} {way}"])}
        for label, row in rows.items()
    }


def best(rows: Mapping[str, Mapping[str, float]]) -> dict[str, Mapping[str, float]]:
    """Of {label: {group: set-point}} the row of each kind of law, with a lift and without, that is lowest on `one_at_a_time`, then on the nominal rig."""
    kinds: dict[tuple[str, bool], tuple[tuple[float, ...], str]] = {}
    for label, lowest in rows.items():
        rank = tuple(math.inf if math.isnan(value := lowest.get(name, math.nan)) else value for name in ("one_at_a_time", "nominal"))
        kind = label.partition(",")[0], "lifting" in label
        kinds[kind] = min(kinds.get(kind, (rank, label)), (rank, label))
    chosen = {label for _, label in kinds.values()}
    return {label: lowest for label, lowest in rows.items() if label in chosen}


def picture(rows: Mapping[str, Mapping[str, float]], path: Path, shown: Sequence[str] = SHOWN) -> None:
    """Lowest set-points of a takeover, {label: {group: [rad/s]}}, as marks, and the bit under some of the laws on the heavy, stiff corner of the rigs at
    4.2 rad/s."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    marks = {
        "nominal": {"marker": "o", "markersize": 5.0, "markerfacecolor": "white", "markeredgecolor": "black"},
        "one_at_a_time": {"marker": "o", "markersize": 4.0, "color": "black"},
        "combined": {"marker": "s", "markersize": 7.5, "markerfacecolor": "none", "markeredgewidth": 1.4, "markeredgecolor": plot.LINES[1]["color"]},
    }  # fmt: skip
    with pyplot.rc_context(plot.PAPER):
        figure, (left, right) = pyplot.subplots(
            1, 2, figsize=(10.0, max(0.19 * len(rows) + 1.1, 3.4)), layout="constrained", width_ratios=(1.25, 1.0)
        )
        for k, lowest in enumerate(rows.values()):
            speeds = {name: lowest[name] for name in marks if name in lowest}
            known = [value for value in speeds.values() if value == value]
            left.plot([min(known, default=HIGHEST), max(known, default=HIGHEST)], [k, k], color="0.75", linewidth=1.0, zorder=1)
            for place, (name, value) in enumerate(speeds.items()):
                at = value if value == value else HIGHEST + 1.0 + 0.8 * place
                left.plot(at, k, linestyle="", zorder=2, **marks[name])
        some = any(lowest[name] != lowest[name] for lowest in rows.values() for name in marks if name in lowest)
        if some:
            left.axvspan(HIGHEST + 0.5, HIGHEST + 3.1, facecolor=plot.BAND, linewidth=0, zorder=0)
            left.text(HIGHEST + 1.8, -1.3, f"not even at\n{HIGHEST * 30 / math.pi:.0f} rpm", ha="center", va="bottom", fontsize=8.0)
        for name, style in marks.items():
            left.plot([], [], linestyle="", label=name, **style)
        left.set(
            xlim=(LOWEST, HIGHEST + 3.1 if some else 12.5),
            ylim=(len(rows) - 0.3, -1.0),
            xlabel="lowest set-point of a takeover [rpm]",
        )  # what drillers read
        left.set_xticks([rpm * math.pi / 30 for rpm in range(20, 121, 20)], range(20, 121, 20))
        left.set_yticks(range(len(rows)), list(rows))
        left.legend(loc="lower right", bbox_to_anchor=(0.83 if some else 1.0, 0.0), frameon=False, fontsize=8.0)
        for label, style in zip(shown, plot.LINES, strict=False):
            run = laws()[label].run(CORNERS[1], EXAMPLE, seed=101)
            at = laws()[label].takeover(EXAMPLE)
            times = np.linspace(0.0, min(run.end, at + 110.0), 3000)
            right.plot(times - at, run.at(times)["bit.speed"], label=label, **style)
        right.axvline(0.0, color="0.5", linewidth=0.8, linestyle=":")
        right.axhline(EXAMPLE, color="0.5", linewidth=0.8, linestyle=":")
        right.set(xlabel="time since the law took over [s]")
        with use_units("metric"):
            name_axis(right.yaxis, "bit speed", "rad/s")
        right.set_title(
            f"set-point {EXAMPLE * 30 / math.pi:.0f} rpm; parts of the declared rig:\n{CORNERS[1].name}", fontsize=9.0, loc="left"
        )
        right.set_ylim(top=1.4 * right.get_ylim()[1])
        right.legend(frameon=False, fontsize=8.0, loc="upper right")
        figure.savefig(path, dpi=180)
        pyplot.close(figure)


def _searched(families: Sequence[str], points: int, kept: Path | None, jobs: int) -> Iterator[gains.Found]:
    """The searches of some families in so many processes; each keeps its points in a file of a folder."""
    paths = [kept / f"{family.replace(', ', '_').replace(' ', '_')}.jsonl" if kept else None for family in families]
    with Workers(jobs) as workers:
        yield from workers.map(gains.searched, families, [points] * len(families), [1] * len(families), paths)


def points(label: str) -> int:
    """How many points were tried for the gains of a row; 0 for a law as it is delivered."""
    if "between" not in label:
        return gains.points(label)
    return PLACES + gains.points("LQG, tuned") + gains.points("LQG, tuned, lifting")


def flat(each: Row) -> dict[str, Any]:
    """A row as one level of names, with what it was judged and tuned by."""
    speeds = {f"{name} {way}": value for name, pair in each.lowest.items() for way, value in zip(PROTOCOLS, pair, strict=True)}
    return {"label": each.label, **speeds, "settling": each.settling, "overshoot": each.overshoot, "ripple": each.ripple, "step": each.step,
            "disk margin": each.margins[0], "disk margin, one_at_a_time": each.margins[1], "recovery": each.recovery, "fastest": each.fastest,
            "points tuned": points(each.label), "judged": BRIEF if briefly(each.label) else FULL}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the table, and with --out its csv; or tune."""
    every = laws()
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=folder, help="folder for drives.csv and for what is known of the cells")
    parser.add_argument("--only", nargs="+", choices=list(every), default=list(every), metavar="LABEL", help=f"some of: {', '.join(every)}")
    parser.add_argument(
        "--groups", nargs="+", choices=list(GROUPS), default=list(GROUPS), metavar="NAME", help=f"some of: {', '.join(GROUPS)}"
    )
    parser.add_argument(
        "--tune", nargs="+", choices=list(gains.FAMILIES), metavar="FAMILY", help=f"search gains of: {', '.join(gains.FAMILIES)}"
    )
    parser.add_argument("--keep", action="store_true", help='put the gains found in the place of those that laws called "tuned" have')
    parser.add_argument(
        "--draw",
        action="store_true",
        help="draw the picture of the best row of each kind of law that stands in the docs, and judge nothing",
    )
    parser.add_argument("--runs", type=int, default=60, help="points that a search tries (60)")
    parser.add_argument("--margin", type=float, default=0.0, help="disk margin that a set-point has to leave on every rig of its group (0)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes that judge laws side by side (one a core)")
    given = parser.parse_args(arguments)
    for label, found in zip(given.tune or (), _searched(given.tune or (), given.runs, given.out, given.jobs), strict=True):
        if given.out or given.keep:
            gains.store(label, found, gains.STORE if given.keep else given.out / "gains.json")
        print(f"{label}: {found.numbers}, {found.score}, {len(found.points)} points in {found.seconds:.0f} s of the processor")
    if given.draw:
        kept = {label: {name: value for (name, way), value in cells.items() if way == "takeover"} for label, cells in published().items()}
        picture(best(kept), (given.out or Path()) / "drives.png")
    if given.tune or given.draw:
        return
    began = time.monotonic()
    rows = judged_rows(given.only, given.groups, given.out / "drives.jsonl" if given.out else None, given.jobs, given.margin)
    print(f"{table(rows)}\n{time.monotonic() - began:.0f} s with {given.jobs} processes")
    print(f"\n{rocks()}")
    if given.out:
        write_rows([flat(each) for each in rows], given.out / "drives.csv")
        picture({each.label: {name: pair[0] for name, pair in each.lowest.items()} for each in rows}, given.out / "drives.png")
        print(f"\nThe table and its picture are in {given.out}")


if __name__ == "__main__":
    main()
