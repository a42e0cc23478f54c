"""Do `onset`, `severity_map` and `follow` agree on where stick-slip ends, and with a slow ramp by a simulation that shares nothing with them?

Wells of two and four inertias under a torque that does not yield, under stiff and soft drives and under a sliding mode, continuous and sampled. The border by
`onset` is asked for in three ranges each: a wide one, one that begins a little below the border, and one that reaches far beyond it. `severity_map` takes
half a percent of weight on bit to either side as its second number. `follow` takes the cycle to where it stops being stable; a sampled law has no cycle, and
there the ramp alone is the measure. The ramp of `studies.questions.slow_ramp` moves by 3e-6 of the border per second; a cycle that is lost slowly, as by
period doubling, outlives its border by some 0.2 % of it even so, and by 0.1 % at a third of that rate.

    python -m studies borders          (a table; three minutes)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from controllers import SlidingMode, SoftTorque, StiffPI
from models import BitRock, Exponential, TorsionalChain, wells
from studies.questions.slow_ramp import String, ramp
from toolbox import HybridSystem, Sampled, closed_loop, compose, follow, limit_cycle, onset, severity_map, simulate

ROCK = BitRock(weight=97_347.0)
HARD_ROCK = BitRock(weight=160_000.0, radius=0.0239, friction=Exponential(static=2.5, kinetic=1.1, decay=0.4))
RATE = 3e-6
"""Of the ramps, in parts of the border per second."""


@dataclass(frozen=True)
class Case:
    """A well with its drive; sticks: a value that certainly sticks and slips; ranges: in which the border is asked for; stalls: towards standstill."""

    label: str
    well: TorsionalChain
    law: Any
    sticks: float
    ranges: tuple[tuple[float, float], ...]
    sample_time: float = 0.0
    rock: BitRock = ROCK
    stalls: bool = False

    @property
    def plant(self) -> HybridSystem:
        """The well with its bit."""
        return compose(self.well, self.rock)

    @property
    def parameter(self) -> str:
        """What varies: the set-point, or the torque where there is no law."""
        return "top.torque" if self.law is None else "top.reference"

    @property
    def controller(self) -> Any:
        """The law as it runs."""
        return Sampled(self.law, self.sample_time) if self.sample_time else self.law


CASES = (
    Case("4 inertias, torque, end", wells.NAVARRO_LOPEZ_4, None, 10_300.0, ((9000.0, 12_000.0), (10_550.0, 13_000.0), (6000.0, 20_000.0))),
    Case(
        "4 inertias, torque, stall",
        wells.NAVARRO_LOPEZ_4,
        None,
        10_300.0,
        ((9000.0, 12_000.0), (9900.0, 10_500.0), (8000.0, 10_400.0)),
        stalls=True,
    ),
    Case("Jansen, stiff PI", wells.JANSEN_2, StiffPI(), 10.0, ((2.0, 16.0), (12.0, 13.0), (11.0, 30.0))),
    Case("Jansen, soft torque", wells.JANSEN_2, SoftTorque(), 6.0, ((2.0, 16.0), (8.0, 9.0), (7.0, 30.0))),
    Case("Jansen, sliding mode", wells.JANSEN_2, SlidingMode(), 6.0, ((2.0, 16.0), (7.5, 9.0), (7.0, 20.0))),
    Case("4 inertias, stiff PI", wells.NAVARRO_LOPEZ_4, StiffPI(), 5.0, ((2.0, 16.0), (6.5, 7.5), (6.0, 20.0))),
    Case("4 inertias, soft torque", wells.NAVARRO_LOPEZ_4, SoftTorque(), 3.0, ((2.0, 16.0), (4.5, 5.5), (4.0, 12.0))),
    Case("2 inertias, soft torque", wells.NAVARRO_LOPEZ_2, SoftTorque(), 4.0, ((2.0, 16.0), (5.2, 7.5), (5.0, 12.0))),
    Case("UFRJ, sliding mode", wells.UFRJ_2, SlidingMode(), 6.0, ((3.0, 20.0), (6.9, 9.0), (6.0, 25.0)), rock=HARD_ROCK),
    Case("Jansen, soft torque, 10 Hz", wells.JANSEN_2, SoftTorque(), 6.0, ((2.0, 16.0), (8.0, 10.0), (7.0, 25.0)), 0.1),
)


@cache
def by_onset(case: Case, between: tuple[float, float]) -> float:
    """The end of stick-slip as `onset` finds it in a range, with the working point inside of stick-slip."""
    at = min(max(case.sticks, between[0]), between[1])
    found = onset(closed_loop(case.plant, case.controller, inputs={case.parameter: at}), case.parameter, between, num_values=9)
    return found.stall if case.stalls else found.end


@cache
def by_map(case: Case) -> float:
    """The same from a map over the parameter and the weight on bit."""
    border, weight = by_onset(case, case.ranges[0]), case.rock.weight
    low, high = sorted((case.sticks, 2 * border - case.sticks))
    over = {case.parameter: (low, high), "bit.weight": (0.995 * weight, 1.005 * weight)}
    found = severity_map(closed_loop(case.plant, case.controller), over, shape=(8, 3), halvings=7).border("sticking", weight)
    return float(found[np.argmin(np.abs(found - border))]) if found.size else math.nan


@cache
def by_follow(case: Case) -> float:
    """Where the cycle, followed, stops being stable; nan under a sampled law."""
    if case.sample_time:
        return math.nan
    cycle = limit_cycle(simulate(case.plant, 400.0, controller=case.law, inputs={case.parameter: case.sticks}, accuracy=1e-9))
    goal = case.sticks * (0.5 if case.stalls else 3.0)
    branch = follow(cycle, case.parameter, (min(case.sticks, goal), max(case.sticks, goal)), start_towards=goal, points=300)
    folds = [point.value for point in branch.bifurcations]
    if case.stalls:  # folds on the way, past which the branch attracts again, are not where stick-slip ends
        return float(min(value for value, stable in zip(branch.values, branch.stable, strict=True) if stable))
    return float(folds[0])


@cache
def by_ramp(case: Case) -> float:
    """The border of a slow ramp from inside, by fixed steps and sticking of its own."""
    law = case.law.design(case.plant) if case.law is not None else None
    border = by_onset(case, case.ranges[0])
    near, beyond = border + 0.02 * (case.sticks - border) / abs(case.sticks - border) * abs(border), border
    beyond += 0.015 * (border - case.sticks) / abs(case.sticks - border) * abs(border)
    string = String.of(case.well, case.rock, law, sample_time=case.sample_time)
    return ramp(string, (case.sticks, near, beyond), (1e-4 * abs(border), RATE * abs(border))).border


def row(case: Case) -> tuple[list[float], float, float, float]:
    """(border by `onset` in each range, by the map, by `follow`, by the ramp)."""
    return [by_onset(case, between) for between in case.ranges], by_map(case), by_follow(case), by_ramp(case)


def main() -> None:
    """Print the table."""
    print("Where stick-slip ends, four ways; deviation: the largest from `follow`, or from the ramp where no cycle can be followed\n")
    print(f"{'well and drive':<36}{'onset, three ranges':>30}{'map':>11}{'follow':>12}{'slow ramp':>12}{'deviation':>11}{'ramp':>9}")
    for case in CASES:
        borders, mapped, followed, ramped = row(case)
        measure = ramped if math.isnan(followed) else followed
        worst = max(abs(value / measure - 1) for value in (*borders, mapped))
        cells = "  ".join(f"{value:.5g}" for value in borders)
        print(
            f"{case.label:<36}{cells:>30}{mapped:>11.5g}{'-' if math.isnan(followed) else f'{followed:.6g}':>12}{ramped:>12.6g}"
            f"{100 * worst:>9.3f} %{100 * abs(ramped / measure - 1):>7.2f} %", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
