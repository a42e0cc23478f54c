"""How well does an ensemble beside the rig know what the bit does, when does it tell stick-slip, and what does it cost?

Machines of the robust set (one error of 10 or 20 % each in drive, string, stiffness, weight, or commands 30 ms late), 100 Hz, noise of 0.01 rad/s and 30 N
m, a weight that varies and is measured with 2 %. Three questions: the error of the bit speed in stick-slip and in smooth running, in parts of that of the
best linear observer of one setting, with the cover of the bands of 95 %; the time from the first stick to the alarm on machines whose weight rises; alarms
in hours without a stick.

    python -m studies beside_the_rig [--seeds 20] [--onsets 59] [--hours 6]        (all three: about half an hour of processor time)

Seeds are from 100 on: those below were used to choose the defaults of `Knowledge`.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from controllers import SoftTorque, StiffPI
from controllers.observers import DisturbanceObserver, Kalman
from models import BitRock, wells
from studies.command_line import parser_of
from studies.timing import timed
from toolbox import Sampled, closed_loop, compose, simulate
from toolbox.drilling import Detector, EnsembleFilter, Estimate
from toolbox.drilling.groups import Machine, machine_groups
from toolbox.measuring.measure import stick_intervals
from toolbox.modelling import inputs as shapes

RIG = compose(wells.JANSEN_2, BitRock(weight=97e3))
PERIOD = 0.01
ROBUST = machine_groups(RIG)["one_at_a_time"].machines
REGIMES: dict[str, tuple[Any, float]] = {"stick-slip": (StiffPI, 8.0), "smooth": (SoftTorque, 11.0)}
FIRST = 100
"""Seeds from here on were not used to choose anything."""

STARTED = 30.0
"""Time [s] after which an alarm is no matter of the start from rest, in which the bit sticks."""


def surface(
    law: Any, reference: float, seed: int, duration: float, weight: Any, varies: float = 0.02, machine: Machine | None = None
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], Any]:
    """(times, what is measured, the truth) of a machine of the robust set in stick-slip or smooth running, at 100 Hz with noise."""
    machine = ROBUST[seed % len(ROBUST)] if machine is None else machine
    loop = closed_loop(
        RIG,
        Sampled(law(reference=reference), PERIOD, machine.delay, noise={"top.speed": 0.01}, seed=seed),
        inputs={"top.reference": reference},
    )
    for name, factor in machine.parameter_factors:
        loop = loop.at(name, loop.number(name).value * factor)
    part = loop.number("bit.weight").value / 97e3
    given = shapes.noise(weight * part, varies * weight * part, 0.2, seed=seed + 7) if varies else weight(part)
    run = simulate(closed_loop(loop, inputs={"bit.weight": given}), duration, accuracy=1e-6)
    times = np.arange(0.0, duration + 1e-9, PERIOD)
    at, rng = run.at(times), np.random.default_rng(seed)
    noise = rng.standard_normal((3, times.size))
    told = {
        "time": times,
        "top.speed": at["top.speed"] + 0.01 * noise[0],
        "top.torque": at["top.torque"] + 30.0 * noise[1],
        "bit.weight": np.asarray(at["bit.weight"]) * (1.0 + 0.02 * noise[2]),
    }
    return told, {name: np.asarray(at[name]) for name in ("bit.speed", "bit.torque")}, run


@functools.cache
def case(regime: str, seed: int = 3, duration: float = 60.0) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], Any]:
    """`surface` of a regime, kept."""
    law, reference = REGIMES[regime]
    return surface(law, reference, seed, duration, 97e3)


def stream(made: EnsembleFilter, told: Mapping[str, np.ndarray], until: int | None = None) -> Iterator[Estimate]:
    """Estimates of a stream, one after the other."""
    made.reset()
    torque = told["top.torque"]
    between = 0.5 * (torque + np.concatenate([torque[:1], torque[:-1]]))
    for each in zip(between[:until], told["top.speed"][:until], told["bit.weight"][:until], strict=True):
        yield made.step(PERIOD, *each)


def followed(made: EnsembleFilter, told: Mapping[str, np.ndarray], until: int | None = None) -> list[Estimate]:
    """Estimates of a stream."""
    return list(stream(made, told, until))


def by_observer(observer: Any, told: Mapping[str, np.ndarray]) -> np.ndarray:
    """Bit speed by a linear observer with the best begin, under torque and speed that are held for a sample."""
    from scipy.linalg import expm

    made = observer.design(RIG)
    n = len(made.gain)
    stacked = np.zeros((n + 4) * n)
    stacked[list(made.model_indices)] = made.model
    stacked = stacked.reshape(n + 4, n)
    gain = np.array(made.gain)
    rates = np.column_stack([stacked[:n] - np.outer(gain, stacked[n + 1]), stacked[n], gain])
    moved = expm(np.vstack([rates, np.zeros((2, n + 2))]) * PERIOD)
    steady = np.array(made.initial_state_map).reshape(2, n)
    z, found = steady[0] * told["top.torque"][0] + steady[1] * told["top.speed"][0], np.empty(told["time"].size)
    for k, u in enumerate(zip(told["top.torque"], told["top.speed"], strict=True)):
        found[k] = stacked[n + 2] @ z
        z = moved[:n, :n] @ z + moved[:n, n:] @ u
    return found


def scores(seeds: Sequence[int], duration: float) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """{regime: (RMS errors of the ensemble, cover of its bands, RMS errors by observer setting)}."""
    settings = [Kalman(torque_process_noise=walk) for walk in (500, 1000, 2000, 4000, 8000)] + [
        DisturbanceObserver(bandwidth=b) for b in (3, 4, 6)
    ]
    made, found = EnsembleFilter(RIG), {}
    for regime in REGIMES:
        errors, cover, others = [], [], []
        for seed in seeds:
            told, truth, _ = case(regime, seed, duration)
            late = told["time"] > 20.0
            mean, deviation = np.array([each.bit_speed for each in followed(made, told)]).T
            error = (mean - truth["bit.speed"])[late]
            errors.append(np.sqrt(np.mean(error**2)))
            cover.append((np.abs(error) <= 1.96 * deviation[late] + 1e-9).mean())
            others.append([np.sqrt(np.mean((by_observer(each, told) - truth["bit.speed"])[late] ** 2)) for each in settings])
        found[regime] = np.array(errors), np.array(cover), np.array(others)
    return found


def judged(found: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]) -> dict[str, tuple[float, float, float]]:
    """{regime: (mean, worst) ratio to the one observer setting with the smallest mean over both regimes, mean cover}."""
    best = np.argmin(np.mean([others.mean(axis=0) for _, _, others in found.values()], axis=0))
    ratios = {regime: errors / others[:, best] for regime, (errors, _, others) in found.items()}
    return {regime: (float(each.mean()), float(each.max()), float(found[regime][1].mean())) for regime, each in ratios.items()}


def onset_of(seed: int) -> tuple[float, np.ndarray, float]:
    """(first stick after the weight rose [s], times of alarms [s], period of the string [s]) of a machine whose weight rises at 60 s."""
    reference = 8.0 + seed % 3
    told, _, run = surface(
        StiffPI,
        reference,
        seed,
        110.0,
        lambda part: ([0.0, 60.0, 62.0, 110.0], [30e3 * part, 30e3 * part, 110e3 * part, 110e3 * part]),
        varies=0.0,
    )
    made, detector = EnsembleFilter(RIG, seed=seed), Detector()
    weight = np.interp(told["time"], [60.0, 62.0], [30e3, 110e3]) * (
        1 + 0.02 * np.random.default_rng(seed).standard_normal(told["time"].size)
    )
    alarms = [detector(made.step(PERIOD, *each)) for each in zip(told["top.torque"], told["top.speed"], weight, strict=True)]
    first = next(begin for begin, end in stick_intervals(run, "bit", 40.0) if end - begin > 0.01)
    return first, told["time"][np.flatnonzero(np.diff(np.array(alarms, int), prepend=0) == 1)], made.period


def false_alarms(seed: int, duration: float = 600.0) -> tuple[float, int] | None:
    """(seconds, alarms) of smooth running with a weight that varies by 2, 5 or 10 %, after the start; None where the bit sticks."""
    law, reference = REGIMES["smooth"]
    told, _, run = surface(law, reference, seed, duration, 97e3, varies=(0.02, 0.05, 0.1)[seed % 3])
    if any(end > STARTED for _, end in stick_intervals(run, "bit", 0.0)):
        return None
    made, detector = EnsembleFilter(RIG, seed=seed), Detector()
    alarms = np.array([detector(each) for each in stream(made, told)], int)
    began = told["time"][np.flatnonzero(np.diff(alarms, prepend=0) == 1)]
    return duration - STARTED, int((began > STARTED).sum())


def main() -> None:
    """Print the answers."""
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--onsets", type=int, default=59)
    parser.add_argument("--hours", type=float, default=6.0)
    given = parser.parse_args()
    if given.seeds:
        for regime, (mean, worst, cover) in judged(scores(range(FIRST, FIRST + given.seeds), 60.0)).items():
            print(f"{regime}: error over that of the best observer: mean {mean:.3f}, worst {worst:.3f}; cover {cover:.4f}", flush=True)
        told = case("stick-slip", FIRST)[0]
        made = EnsembleFilter(RIG)
        followed(made, told, 100)
        spent = timed(lambda: followed(made, told, 3000))[1] / 3000
        print(f"a sample takes {1e3 * spent:.3f} ms of processor time, {spent / PERIOD:.3f} of a core at 100 Hz", flush=True)
    late = []
    for seed in range(FIRST, FIRST + given.onsets):
        first, alarms, period = onset_of(seed)
        after = alarms[alarms > STARTED]
        late.append((float(after[0]) - first) / period if after.size else np.inf)
        if not -1.0 <= late[-1] <= 3.0:
            print(f"  seed {seed}: first stick at {first:.2f} s, alarms at {after}", flush=True)
    if late:
        good = sum(-1.0 <= each <= 3.0 for each in late)
        print(
            f"{good} of {len(late)} onsets told within three periods; {min(late):.2f} to {max(late):.2f} periods after the first stick",
            flush=True,
        )
    seconds, alarms_of, seed = 0.0, 0, FIRST
    while seconds < 3600.0 * given.hours:
        found = false_alarms(seed)
        if found is None:
            print(f"  seed {seed} sticks", flush=True)
        else:
            seconds, alarms_of = seconds + found[0], alarms_of + found[1]
            if found[1]:
                print(f"  seed {seed}: {found[1]} alarms", flush=True)
        seed += 1
    if given.hours:
        print(f"{alarms_of} false alarms in {seconds / 3600:.2f} hours")


if __name__ == "__main__":
    main()
