"""Is stick-slip found in a log that is slow, and under a model that is wrong; and how often is it found in smooth running?

    python -m studies slow_logs [--full] [--hours 6]        (without --full: 8 of the 40 logs and a quarter of an hour; with it some ten minutes)

Forty surface logs of one string, a sample every 0.1 to 15 s, are estimated with four machines: that of the log, inertia of the string 20 % more and less, and,
for a log of a string with friction along the hole, one without it. In every log the bit sticks and slips between two known times, in which the weight on bit
is raised at 45 rpm. It must be found there where the log has five samples in a period of the string, else the log must be called too slow; and not before
those times. Smooth running has weight, set-point and torque that vary.
"""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from controllers import SoftTorque, StiffPI
from models import BitRock, TorsionalChain, wells
from models.friction import Coulomb
from studies.command_line import parser_of
from toolbox import ClosedLoop, closed_loop, compose, simulate
from toolbox.drilling import Estimates, estimate
from toolbox.drilling.torque_swing import ENOUGH

BEGIN, END, DURATION = 120.0, 420.0, 540.0
"""Between the first two times [s] of a log of that duration the weight is high."""

LOW, HIGH = 20e3, 97e3
"""Weight on bit [N]."""

INTERVALS = (0.1, 0.2, 0.5, 0.8, 1.0, 2.0, 4.0, 5.0, 10.0, 15.0)
"""Time between samples [s] of the logs."""

MODELS = ("exact", "inertia +20 %", "inertia -20 %", "no friction along the hole")
"""How the machine of the scene differs from that of the log."""

_ALONG = TorsionalChain(
    inertia=(2122.0, 60.0, 60.0, 60.0, 60.0, 294.0), stiffness=(2365.0,) * 5, damping=(116.0,) * 5, top_drag=425.0, bit_drag=50.0
)
"""The string of `wells.JANSEN_2`, with the inertia of its pipe along it."""


def strings(model: str) -> tuple[TorsionalChain, TorsionalChain]:
    """Strings of the log and of the scene."""
    if model == MODELS[3]:
        friction = {"friction": Coulomb(static=0.3, kinetic=0.25), "friction_load": (2000.0,) * 4, "friction_at": (1, 2, 3, 4)}
        return dataclasses.replace(_ALONG, **friction), _ALONG
    factor = {"exact": 1.0, "inertia +20 %": 1.2, "inertia -20 %": 0.8}[model]
    top, *below = wells.JANSEN_2.inertia
    return wells.JANSEN_2, dataclasses.replace(wells.JANSEN_2, inertia=(top, *(factor * each for each in below)))


@cache
def _run(string: TorsionalChain) -> Any:
    weight = ([0.0, BEGIN, BEGIN + 1.0, END, END + 1.0, DURATION], [LOW, LOW, HIGH, HIGH, LOW, LOW])
    return simulate(compose(string, BitRock()), DURATION, controller=StiffPI(reference="45 rpm"), inputs={"bit.weight": weight})


def logged(run: Any, interval: float, seed: int = 0) -> dict[str, np.ndarray]:
    """What is written every interval [s] of a run: torque, speed and weight with noise."""
    time = np.arange(0.0, run.time[-1] - 1e-9, interval)
    at, rng = run.at(time), np.random.default_rng(seed)
    noise = rng.standard_normal((3, time.size))
    return {
        "time": time,
        "top.torque": at["top.torque"] + 20.0 * noise[0],
        "top.speed": at["top.speed"] + 0.002 * noise[1],
        "bit.weight": np.maximum(np.asarray(at["bit.weight"]) * (1.0 + 0.01 * noise[2]), 0.0),
    }


@dataclass(frozen=True)
class Outcome:
    """One log: samples in a period of its string, shares of the times with and without stick-slip in which it was told, and of both that were too slow."""

    model: str
    interval: float
    samples: float
    found: float
    false: float
    slow: float
    notes: tuple[str, ...]

    @property
    def right(self) -> bool:
        """Whether stick-slip was found, and nowhere else, where the log is fast enough; and the log called too slow only where it is not."""
        if self.slow > 0.0:
            return self.slow == 1.0 and self.samples < ENOUGH and self.found == self.false == 0.0
        return self.found > 0.9 and self.false == 0.0


def scene(model: str) -> ClosedLoop:
    """The loop with which the log of a model is estimated."""
    return closed_loop(compose(strings(model)[1], BitRock()), StiffPI(reference="45 rpm"))


def sticks_between(run: Any) -> tuple[float, float]:
    """First and last time [s] at which the bit sticks after the start."""
    time = np.arange(60.0, DURATION, 0.01)
    still = time[run.at(time)["bit.speed"] == 0.0]
    return float(still[0]), float(still[-1])


def outcome(model: str, interval: float, members: int = 64) -> Outcome:
    """Estimate one log, and compare what is told with what was."""
    string, _ = strings(model)
    run = _run(string)
    found = estimate(scene(model), logged(run, interval), members=members)
    begin, end = sticks_between(run)
    period = string_period(string)
    inside = (found.time > begin + 4.0 * period) & (found.time < end)  # three periods are needed to tell a swing
    outside = ((found.time > 60.0) & (found.time < begin - period)) | (found.time > end + 6.0 * period)  # it rings on
    shares = [float(found.stick_slip[part].mean()) for part in (inside, outside)]
    return Outcome(model, interval, period / interval, *shares, float(found.sampling_too_slow.mean()), found.notes)


def string_period(string: TorsionalChain) -> float:
    """Period [s] of the bit under a top drive that holds its speed, of the string as two inertias."""
    return float(2.0 * np.pi * np.sqrt(sum(string.inertia[1:]) * sum(1.0 / each for each in string.stiffness)))


def smooth(seed: int, interval: float, duration: float = 900.0) -> tuple[float, Estimates]:
    """(hours after the start, estimates) of smooth running whose weight varies by 5 %, with steps of the weight by half, and a drive that is stiff or soft."""
    law = (StiffPI, SoftTorque)[seed % 2]
    rng = np.random.default_rng(seed)
    levels = rng.uniform(40e3, 80e3, 5)
    times = np.linspace(0.0, duration, 6)
    nodes = np.sort(np.concatenate([times[:-1], times[1:] - 2.0]))
    loop = closed_loop(compose(wells.JANSEN_2, BitRock()), law(reference=12.0 + seed % 3))
    weight = (np.linspace(0.0, duration, int(duration) + 1), _varied(duration, nodes, levels, rng))
    run = simulate(closed_loop(loop, inputs={"bit.weight": weight}), duration)
    if (run.at(np.arange(60.0, duration, 0.05))["bit.speed"] == 0.0).any():
        raise ValueError(f"The bit sticks in the smooth run of seed {seed}.")
    found = estimate(loop, logged(run, interval, seed))
    return (duration - 60.0) / 3600.0, found


def _varied(duration: float, nodes: np.ndarray, levels: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Weights [N] every second: steps, each within 2 s, and noise of 5 % that lasts for some seconds."""
    seconds = np.arange(int(duration) + 1)
    noise = np.zeros(seconds.size)
    for k in range(1, seconds.size):
        noise[k] = 0.8 * noise[k - 1] + 0.6 * rng.standard_normal()
    values: np.ndarray = np.interp(seconds, nodes, np.repeat(levels, 2)) * (1.0 + 0.05 * noise)
    return values


def main() -> int:
    """Print the answers. Returns the number of logs that are not as they must be."""
    parser = parser_of(__doc__)
    parser.add_argument("--full", action="store_true", help="all 40 logs")
    parser.add_argument("--hours", type=float, default=0.25, metavar="H", help="hours of smooth running (0.25)")
    given = parser.parse_args()
    intervals = INTERVALS if given.full else (1.0, 5.0)
    bad = 0
    print("model                        interval  samples/period  found  false  too slow")
    for model in MODELS:
        for interval in intervals:
            told = outcome(model, interval)
            bad += not told.right
            print(
                f"{model:<28} {interval:7.1f} s {told.samples:15.2f}  {told.found:5.2f}  {told.false:5.2f}  {told.slow:8.2f}{'' if told.right else '  wrong'}",
                flush=True,
            )
    hours, alarms, seed = 0.0, 0, 0
    while hours < given.hours - 1e-9:
        interval = (0.2, 1.0)[seed // 2 % 2]
        more, found = smooth(seed, interval)
        hours, seed = hours + more, seed + 1
        began = [begin for begin, _ in found.spells if begin > 60.0]
        alarms += len(began)
        print(f"smooth {seed}: {len(began)} alarms, largest index {np.nanmax(found.torque_swing[found.time > 60.0]):.3f}", flush=True)
    print(
        f"{len(MODELS) * len(intervals) - bad} of {len(MODELS) * len(intervals)} logs are right; {alarms} false alarms in {hours:.2f} h of smooth logs"
    )
    return bad


if __name__ == "__main__":
    sys.exit(main())
