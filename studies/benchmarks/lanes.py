"""How many scenarios a second does one core run, in lanes and one by one?

A drill string of two inertias with a PI drive, 60 s from rest at accuracy 1e-6, for 10 000 pairs of weight on bit and set-point; then seven other
plants, and laws sampled at 100 Hz on the drill string. One by one is the scalar loop, called from machine code for one scenario after another, with
nothing recorded and no `Trajectory` made: what the run itself costs. In lanes is the whole of `toolbox.lanes.lanes.Lanes`, by explicit steps and,
where no law is sampled, by Taylor series. Swept is what a run of a sweep costs that asks for the extrema and the mean of one signal, one by one and in
lanes. All are timed in turns, as processor time of one thread, and the least of five counts. Switches of the first scenarios are compared one by one;
errors are those of the last states, in parts of the largest of the same unit among all scenarios, against explicit lanes at a thousandth of the accuracy.

A second table compares explicit steps and Taylor series at an equal error: each at the loosest accuracy at which all scenarios but one in a hundred end
within it.

    python -m studies lanes [scenarios] [words in the name of a plant]
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controllers import IdealSlidingMode, SlidingMode, SoftTorque
from models import BitRock, BlocksOnBelt, DiscBrake, SquealingPad, wells
from studies.benchmarks.cases import DRIVE, cases
from studies.command_line import parser_of
from studies.questions.maps import string_map
from studies.timing import timed
from toolbox import Controller, HybridSystem, Sampled, closed_loop, compose
from toolbox.compilation import work_layout
from toolbox.compilation.program import program_of
from toolbox.lanes.lanes import Lanes, has_series
from toolbox.lanes.loop import begin
from toolbox.measuring import metrics
from toolbox.simulation.carry_out import formulas_of
from toolbox.simulation.methods import Explicit, TaylorSeries
from toolbox.simulation.request import Request
from toolbox.simulation.run import Run
from toolbox.simulation.work_arrays import work_arrays
from toolbox.stepping.event_stepper import loop_of
from toolbox.sweeps import batch
from toolbox.sweeps.batch import Task, finished, numbers_of_run
from toolbox.translation.compiled import Compiled

COMPARED = 1000
"""Scenarios whose switches are compared."""
SWEPT = 300
"""Scenarios that are swept and measured."""
TURNS = 5
"""Turns of which the fastest counts."""
ROOM = 2000
"""Switches of a scenario that are kept."""
TARGET = 3e-7
"""Error at which explicit steps and Taylor series are compared, of the worst but one in a hundred scenarios."""
SETTINGS = tuple(mantissa * 10.0**-power for power in range(4, 10) for mantissa in (1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15))
"""Accuracies that are tried for it, the loosest first."""


class Alone(NamedTuple):
    """Scenarios that run one after the other in the scalar loop, as `Scenarios` of `toolbox.lanes.layout` and the address in `code`, and what they come to."""

    code: np.ndarray
    parameters: np.ndarray
    starts: np.ndarray
    memories: np.ndarray
    keys: np.ndarray
    held: np.ndarray
    rest: np.ndarray
    statuses: np.ndarray
    switches: np.ndarray
    states: np.ndarray
    ev_t: np.ndarray


ALONE_KINDS = dict.fromkeys(Alone._fields, ("float64", 2)) | {
    "code": ("int64", 1), "keys": ("uint64", 2), "rest": ("float64", 1), "statuses": ("int64", 1), "switches": ("int64", 1),
}  # fmt: skip


def _one_by_one(given, w):  # type: ignore[no-untyped-def]
    """Run every scenario by the scalar loop."""
    for s in range(given.parameters.shape[0]):
        w.ints[work_layout.EVENTS] = 0
        given.statuses[s] = begin(given, given, w, s, 10_000_000)
        given.switches[s] = w.ints[work_layout.EVENTS]
        for i in range(given.states.shape[1]):
            given.states[s, i] = w.x[i]
        for e in range(min(given.switches[s], given.ev_t.shape[1])):
            given.ev_t[s, e] = w.ev_t[e]


one_by_one = Compiled(_one_by_one, ALONE_KINDS, work_layout.KINDS)


def scenarios(run: Run, spread: dict[str, tuple[float, float]], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of parameters, with those named spread evenly at random between their bounds, and of starts."""
    random = np.random.default_rng(1)
    system = run.system
    parameters = np.tile(system.values, (count, 1))
    for name, (low, high) in spread.items():
        entry = system.parameters[name]
        parameters[:, entry.offset : entry.offset + (entry.size or 1)] *= random.uniform(low, high, (count, entry.size or 1))
    return parameters, np.tile(run.start.states, (count, 1))


@dataclass(frozen=True)
class Ways:
    """Ways to do the same scenarios: seconds of one, the least of several turns; switches of the first alone, and what the first came to in lanes.

    alone, lanes, series: one by one, and in lanes by explicit steps and by Taylor series (nan where there are none), with nothing measured;  swept, measured,
    measured_series: the same with the extrema and mean of a signal.
    """

    seconds: dict[str, float]
    switches: np.ndarray
    same: np.ndarray
    late: float
    errors: dict[str, float]


def first_scenarios(run: Run, parameters: np.ndarray, starts: np.ndarray) -> tuple[Callable[[], None], tuple[np.ndarray, ...]]:
    """A call that runs scenarios one by one in the scalar loop, and the arrays (status, switches, states, times of events) that it fills."""
    work = work_arrays(run, program_of(run.system, run.kinds, formulas_of(run)))._replace(
        out_t=np.array([run.duration]), ev_t=np.empty(100_000), ev_i=np.empty(100_000, np.int32), ev_m=np.zeros((100_000, 3), np.int8)
    )
    work.ints[work_layout.NODES] = 0
    few = len(parameters)
    results = np.zeros(few, np.int64), np.zeros(few, np.int64), np.zeros_like(starts), np.zeros((few, ROOM))
    code = np.array([0, 0, 0, 0, loop_of(work).address])
    memories, keys, held = np.tile(work.memory, (few, 1)), np.tile(work.keys, (few, 1)), np.zeros((few, 0))
    given = Alone(code, np.ascontiguousarray(parameters), np.ascontiguousarray(starts), memories, keys, held, work.p.copy(), *results)
    one_by_one(given._replace(parameters=given.parameters[:1]), work)
    return lambda: one_by_one(given, work), results


def error(run: Run, states: np.ndarray, exact: np.ndarray) -> float:
    """Error of the last states of the worst but one in a hundred scenarios, in parts of the largest state of the same unit among all.

    A state alone has no size where it has died out by then.
    """
    size, largest = np.abs(exact).max(axis=0), {}
    for first, length, unit in run.system.states.values():
        own = size[first : first + (length or 1)]
        largest[unit] = max(largest.get(unit, 0.0), own.max())
    for first, length, unit in run.system.states.values():
        size[first : first + (length or 1)] = largest[unit]
    return float(np.quantile((np.abs(states - exact) / size).max(axis=1), 0.99))


def compared(run: Run, spread: dict[str, tuple[float, float]], count: int) -> Ways:
    """All ways, in turns."""
    parameters, starts = scenarios(run, spread, count)
    run = dataclasses.replace(run, method=Explicit())
    by_series = dataclasses.replace(run, method=TaylorSeries()) if has_series(run) else None
    few = min(COMPARED, count)
    alone, (statuses, switches, _, times) = first_scenarios(run, parameters[:few], starts[:few])
    alone()
    state, (_, size, _) = next(iter(run.system.states.items()))
    signal = "bit.speed" if "bit.speed" in run.system.signals else state if size is None else f"{state}.0"
    asked = (metrics.minimum(signal), metrics.maximum(signal), metrics.mean(signal))
    numbers = np.tile(numbers_of_run(run), (min(SWEPT, count), 1))
    numbers[:, : parameters.shape[1]] = parameters[: len(numbers)]
    task = Task(run, numbers, asked, starts[: len(numbers)])
    ways: dict[str, tuple[Callable[[], object], int]] = {
        "alone": (alone, few),
        "lanes": (lambda: Lanes(run).run(parameters, starts), count),
        "swept": (lambda: finished(task), len(numbers)),
        "measured": (lambda: finished(dataclasses.replace(task, lanes=True)), len(numbers)),
    }
    if by_series is not None:
        ways["series"] = lambda: Lanes(by_series).run(parameters, starts), count
        ways["measured_series"] = lambda: finished(dataclasses.replace(task, run=by_series, lanes=True)), len(numbers)
    seconds = dict.fromkeys(("alone", "lanes", "series", "swept", "measured", "measured_series"), math.nan)
    for turn in range(TURNS + 1):
        for name, (way, runs) in ways.items():
            began = time.thread_time()
            way()
            spent = (time.thread_time() - began) / runs
            seconds[name] = min(spent, seconds[name]) if turn > 1 else spent  # the first turn compiles
    exact = Lanes(dataclasses.replace(run, accuracy=run.accuracy / 1000)).run(parameters[:few], starts[:few]).states
    same, late, errors = np.ones(few, bool), 0.0, {"lanes": math.nan, "series": math.nan}
    for name, method in (("lanes", run), ("series", by_series)):
        if method is None:
            continue
        found = Lanes(method).run(parameters[:few], starts[:few], most_events=ROOM)
        errors[name] = error(run, found.states, exact)
        same &= (found.switches == switches) & (found.statuses == statuses)
        for s in np.flatnonzero(same):
            late = max(late, float(np.abs(found.event_times[s, : switches[s]] - times[s, : switches[s]]).max(initial=0.0)))
    return Ways(seconds, switches, same, late, errors)


def row(title: str, run: Run, spread: dict[str, tuple[float, float]], count: int) -> str:
    """One line of the table."""
    ways = compared(run, spread, count)
    own = ways.seconds
    plain, read = np.fmin(own["lanes"], own["series"]), np.fmin(own["measured"], own["measured_series"])
    return (
        f"{title:<30}{1e6 * own['alone']:9.1f}{1e6 * own['lanes']:9.1f}{1e6 * own['series']:9.1f}{own['lanes'] / own['series']:8.2f}"
        f"{own['alone'] / plain:8.2f}{ways.switches.mean():9.1f}{ways.same.sum():7d} of {ways.same.size}{ways.late:11.1e}"
        f"{ways.standard_errors['lanes']:10.1e}{ways.standard_errors['series']:9.1e}"
        f"{1e6 * own['swept']:10.1f}{1e6 * own['measured']:9.1f}{1e6 * own['measured_series']:9.1f}{own['swept'] / read:8.2f}"
    )


def equal_row(title: str, run: Run, spread: dict[str, tuple[float, float]], count: int) -> str:
    """One line of the second table: both methods at the loosest accuracy whose error is at most `TARGET`, timed in turns."""
    parameters, starts = scenarios(run, spread, count)
    few = min(COMPARED, count)
    first = parameters[:few], starts[:few]
    exact = Lanes(dataclasses.replace(run, method=Explicit(), accuracy=1e-10)).run(*first).states
    ways: list[tuple[Run, float]] = []
    for method in (Explicit(), TaylorSeries()):
        for accuracy in SETTINGS:
            way = dataclasses.replace(run, method=method, accuracy=accuracy)
            own = error(run, Lanes(way).run(*first).states, exact)
            if own <= TARGET:
                ways.append((way, own))
                break
        else:
            return f"{title:<30}  no accuracy of {method} has an error <= {TARGET:g}"
    seconds = [math.inf, math.inf]
    for _ in range(2 * TURNS):
        for i, (way, _) in enumerate(ways):
            began = time.thread_time()
            Lanes(way).run(parameters, starts)
            seconds[i] = min(seconds[i], (time.thread_time() - began) / count)
    cells = "".join(f"{way.accuracy:11.1e}{own:10.1e}{1e6 * spent:9.1f}" for (way, own), spent in zip(ways, seconds, strict=True))
    return f"{title:<30}{cells}{seconds[0] / seconds[1]:8.2f}"


def plants() -> dict[str, tuple[Run, dict[str, tuple[float, float]], int]]:
    """Runs with what varies and how many scenarios of them are run, as parts of the first."""

    def case(name: str) -> Run:
        found = cases()[name]
        return Request(found.loop, found.duration).checked()

    def asked(plant: HybridSystem, duration: float, law: Any = None, **others: Any) -> Run:
        return Request(closed_loop(plant, law, **others), duration).checked()

    rig = compose(wells.JANSEN_2, BitRock(weight=97_000.0))

    def sampled(law: Controller, **arguments: Any) -> Run:
        return asked(rig, 60.0, Sampled(law, 0.01, **arguments))

    weights = {"bit.weight": (0.5, 1.5)}
    brake = dataclasses.replace(DiscBrake(), force=1000.0)
    blocks = BlocksOnBelt(mass=(1.0, 1.2, 0.9, 1.1, 1.05), stiffness=(1.0,) * 5, damping=(0.0,) * 5, tie=(0.5,) * 4, load=(1.0,) * 5)
    return {
        "JANSEN_2 with PI, 60 s": (
            asked(rig, 60.0, DRIVE),
            {"bit.weight": (0.5, 1.5), "pi.reference": (0.5, 2.0)},
            1,
        ),
        "block on belt": (case("belt"), {"block.mass": (0.8, 1.2), "block.belt_speed": (0.5, 1.5)}, 2),
        "five tied blocks on belt": (asked(compose(blocks), 60.0), {"blocks.mass": (0.8, 1.2)}, 10),
        "ideal sliding mode": (asked(rig, 60.0, IdealSlidingMode(reference=12.0)), {"bit.weight": (0.5, 1.0)}, 2),
        "squealing pad": (asked(compose(SquealingPad()), 60.0), {"pad.disc_speed": (0.5, 1.5)}, 2),
        "disc brake": (asked(compose(brake), 2.0, start={"disc.speed": 2.0}), {"disc.force": (0.8, 1.2)}, 4),
        "ten inertias, bit": (case("bit"), {"bit.weight": (0.8, 1.2)}, 4),
        "ten inertias, friction on all": (case("all"), {"chain.friction_load": (0.8, 1.2)}, 10),
        "PI at 100 Hz, 120 s": (case("sampled"), {**weights, "pi.reference": (0.5, 2.0)}, 5),
        "soft torque at 100 Hz": (sampled(SoftTorque(reference=6.0)), weights, 5),
        "its delay 3 ms, noise": (sampled(SoftTorque(reference=6.0), delay=0.003, noise={"top.speed": 0.05}), weights, 5),
        "sliding mode at 100 Hz": (sampled(SlidingMode(reference=12.0)), weights, 5),
    }


def map_row(shape: tuple[int, int] = (50, 50)) -> str:
    """What the severity map of `studies.questions.maps`, its drive sampled at 100 Hz, costs as a whole, one run after the other and in lanes."""
    found, seconds, usual = {}, {}, batch.LANES_WORK
    try:
        for work in (math.inf, usual, math.inf, usual):  # where lanes never pay, and where they do
            batch.LANES_WORK = work
            found[work], spent = timed(lambda: string_map(shape))
            seconds[work] = min(spent, seconds.get(work, math.inf))
    finally:
        batch.LANES_WORK = usual
    differ = sum(
        int((getattr(found[math.inf], name).verdict != getattr(found[usual], name).verdict).sum()) for name in ("smooth", "sticking")
    )
    return (
        f"severity map, {shape[0]} x {shape[1]} points twice and its borders, {found[usual].runs} runs of 120 s at 100 Hz: {seconds[math.inf]:.1f} s of the "
        f"processors one by one, {seconds[usual]:.1f} s in lanes, ratio {seconds[math.inf] / seconds[usual]:.2f}; verdicts that differ: {differ}"
    )


def main() -> None:
    """Print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("count", nargs="?", type=int, default=10_000, help="scenarios of a machine (10000)")
    parser.add_argument("words", nargs="*", help="only machines in whose title one of these stands")
    given = parser.parse_args()
    count, words = given.count, given.words
    print(f"{'':<30}{'nothing measured':^43}{'switches':^36}{'error, 99 %':^20}{'swept':^36}")
    print(
        f"{'':<30}{'alone':>9}{'DOP853':>9}{'Taylor':>9}{'over it':>8}{'ratio':>8}{'a run':>9}{'same':>15}{'apart':>10}"
        f"{'DOP853':>10}{'Taylor':>9}{'alone':>10}{'DOP853':>9}{'Taylor':>9}{'ratio':>8}"
    )
    print(f"{'':<30}{'[us]':>9}{'[us]':>9}{'[us]':>9}{'':>16}{'':>24}{'[s]':>10}{'':>19}{'[us]':>10}{'[us]':>9}{'[us]':>9}")
    for title, (run, spread, part) in plants().items():
        if not words or any(word in title for word in words):
            print(row(title, run, spread, count // part), flush=True)
    chosen = {
        title: plant for title, plant in plants().items() if (not words or any(word in title for word in words)) and has_series(plant[0])
    }
    if chosen:
        print(f"\nat an error of {TARGET:g}:")
        print(f"{'':<30}{'DOP853':^30}{'Taylor':^30}")
        print(f"{'':<30}" + 2 * f"{'accuracy':>11}{'error':>10}{'[us]':>9}" + f"{'ratio':>8}")
    for title, (run, spread, part) in chosen.items():
        print(equal_row(title, run, spread, count // part), flush=True)
    if not words:
        print(f"\n{map_row()}")


if __name__ == "__main__":
    main()
