"""Samples that are late by chance, and samples that are missed: against a simulation in numpy that shares no code with the loop."""

from __future__ import annotations

import dataclasses
import math
import sys
import zlib
from dataclasses import dataclass

import numpy as np
import pytest

from controllers import SoftTorque
from models import BitRock, wells
from studies.benchmarks.machines_in_c import COMPILER, CompiledMachine
from toolbox import (
    Component,
    Controller,
    Equations,
    Sampled,
    Scene,
    SceneError,
    Update,
    closed_loop,
    compose,
    export_c,
    hopf_points,
    limit_cycle,
    margins,
    quantity,
    sensitivity,
    simulate,
    state,
    stepper,
    sweep,
)
from toolbox.measuring import metrics
from toolbox.onsets.growth import SmoothBranch
from toolbox.scenes.situation import Situation
from toolbox.simulation.request import Request
from toolbox.steady_states import pole_locus
from toolbox.sweeps.batch import finished, runs_in_lanes
from toolbox.sweeps.designs import grid
from toolbox.sweeps.sweep import task_of as sweep_task

PERIOD, GAIN, END = 0.2, 2.5, 12.0
BITS = 2**64 - 1


@dataclass(frozen=True)
class Tank(Component):
    """A level that leaks: x' = u - x / 2."""

    def equations(self, signal):
        x = state("tank.level", "m")
        return Equations(flow={x: signal("tank.inflow", "m/s", default=0.0) - 0.5 * x})


@dataclass(frozen=True)
class Proportional(Controller):
    """u_k = gain (1 - x_k), and a count of the samples that it took."""

    measured_signals = ("tank.level",)
    actuated_signals = ("tank.inflow",)
    gain: float = quantity(GAIN, "1/s", "gain")

    def sampled(self, signal, period):
        count = state("proportional.count", "1")
        return Update({count: count + 1.0}, {"tank.inflow": (self.gain * (1.0 - signal("tank.level", "m")), "m/s")})


def in_python(t, y):
    return GAIN * (1.0 - y[0])


def scrambled(z):
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & BITS
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB & BITS
    return z ^ (z >> 31)


def uniform(seed, word, k):
    """The number between 0 and 1 of a sample, from the published splitmix64."""
    key = scrambled(scrambled(seed + 0x9E3779B97F4A7C15 & BITS) ^ zlib.crc32(word))
    return ((scrambled(key + (2 * k + 1) * 0x9E3779B97F4A7C15 & BITS) >> 11) + 0.5) * 2.0**-53


def by_numpy(jitter, missed, delay=0.0, seed=0, end=END):
    """(level, samples taken) at the end, from one instant to the next: samples read before outputs that arrive at the same instant."""
    instants = []
    for k in range(int(end / PERIOD) + 1):
        late = jitter * uniform(seed, b"lateness", k) if k else 0.0
        if k == 0 or uniform(seed, b"missed", k) >= missed:
            instants += [(k * PERIOD + late, 0, k), (k * PERIOD + late + delay, 1, k)]
    t, x, u, taken, computed = 0.0, 0.0, 0.0, 0, {}
    for instant, what, k in sorted(entry for entry in instants if entry[0] < end):
        x = 2.0 * u + (x - 2.0 * u) * math.exp(-0.5 * (instant - t))
        t = instant
        if what == 0:
            computed[k], taken = GAIN * (1.0 - x), taken + 1
        else:
            u = computed[k]
    return 2.0 * u + (x - 2.0 * u) * math.exp(-0.5 * (end - t)), taken


def tank(law=None, **clock):
    return closed_loop(compose(Tank()), Sampled(Proportional() if law is None else law, PERIOD, **clock))


CLOCKS = [
    {"jitter": 0.15}, {"missed_samples": 0.3}, {"jitter": 0.19, "missed_samples": 0.4}, {"jitter": 0.1, "delay": 0.07},
    {"jitter": 0.15, "missed_samples": 0.2, "delay": 0.5, "seed": 11}, {"jitter": 0.15, "seed": 3},
]  # fmt: skip
each_clock = pytest.mark.parametrize("clock", CLOCKS, ids=lambda clock: ", ".join(f"{word} {value:g}" for word, value in clock.items()))


@each_clock
def test_a_run_is_that_of_a_simulation_in_numpy_and_not_the_regular_one(clock):
    given = {"jitter": 0.0, "missed": 0.0} | {word.replace("missed_samples", "missed"): value for word, value in clock.items()}
    level, taken = by_numpy(**given)
    run = simulate(tank(**clock), END, accuracy=1e-12)
    assert run.states[-1, 0] == pytest.approx(level, abs=1e-11)
    assert run.last["proportional.count"] == taken
    regular = simulate(tank(delay=clock.get("delay", 0.0)), END, accuracy=1e-12)
    assert regular.states[-1, 0] == pytest.approx(by_numpy(0.0, 0.0, clock.get("delay", 0.0))[0], abs=1e-11)
    times = np.linspace(0.0, 4.0, 41)
    assert np.abs(run.at(times)["tank.level"] - regular.at(times)["tank.level"]).max() > 3e-3


def test_a_loop_that_is_stable_in_time_is_lost_by_missed_samples():
    # x_(k+1) = (e^(-T/2) - 2 gain (1 - e^(-T/2))) (x_k - x_s): a factor of -0.95 with a gain of 9.74, and beyond -1 over two periods
    part = math.exp(-0.5 * PERIOD)
    gain = (0.95 + part) / (2.0 * (1.0 - part))
    regular, missing = (
        simulate(closed_loop(compose(Tank()), Sampled(Proportional(gain), PERIOD, missed_samples=missed)), 60.0)["tank.level"]
        for missed in (0.0, 0.3)
    )
    steady = 2.0 * gain / (1.0 + 2.0 * gain)
    assert abs(regular[-1] - steady) < 1e-4 and abs(missing[-1] - steady) > 1.0


@each_clock
def test_a_law_in_python_has_the_same_samples(clock):
    found = simulate(tank(in_python, measured_signals="tank.level", actuated_signals="tank.inflow", **clock), END, accuracy=1e-12)
    assert found.states[-1, 0] == pytest.approx(simulate(tank(**clock), END, accuracy=1e-12).states[-1, 0], abs=1e-12)


@each_clock
def test_a_run_in_two_pieces_is_the_whole_run(clock):
    loop = tank(**clock)
    first = simulate(loop, 5.1, accuracy=1e-12)
    whole, rest = simulate(loop, END, accuracy=1e-12), simulate(loop, END - 5.1, start=first.last, accuracy=1e-12)
    assert rest.states[-1, 0] == pytest.approx(whole.states[-1, 0], abs=1e-12)
    assert rest.last["proportional.count"] == whole.last["proportional.count"]


def test_samples_are_as_late_and_as_often_missed_as_declared():
    late = np.array([uniform(0, b"lateness", k) for k in range(20_000)])
    assert late.mean() == pytest.approx(0.5, abs=0.01) and late.std() == pytest.approx(12.0**-0.5, abs=0.01)
    assert abs(np.corrcoef(late[1:], late[:-1])[0, 1]) < 0.02
    run = simulate(tank(missed_samples=0.3), 2000.0)
    assert run.last["proportional.count"] == pytest.approx(0.7 * 2000.0 / PERIOD, rel=0.02)


def test_a_sweep_varies_them_as_runs_alone_do_and_takes_no_lanes():
    values = {"proportional.jitter": [0.0, 0.05, 0.15], "proportional.missed_samples": [0.0, 0.3]}
    asked = {"end": metrics.final("tank.level"), "alone": lambda run: float(run.states[-1, 0])}
    found = sweep(tank(), values, END, metrics=asked, accuracy=1e-12)
    in_loops = sweep(tank(), values, END, metrics={"end": asked["end"]}, accuracy=1e-12)
    for i, jitter in enumerate(values["proportional.jitter"]):
        for j, missed in enumerate(values["proportional.missed_samples"]):
            right = by_numpy(jitter, missed)[0]
            assert [found["end"][i, j], found["alone"][i, j], in_loops["end"][i, j]] == pytest.approx([right] * 3, abs=1e-9)
    for name, lanes in (("proportional.delay", True), ("proportional.jitter", False)):
        task, *_ = sweep_task(
            tank(), grid({name: [0.0, 0.1]}), END, start=None, metrics={"end": asked["end"]}, method="explicit", accuracy=1e-9
        )
        assert runs_in_lanes(task) == lanes


def test_other_seeds_in_a_task_are_other_samples():
    loop = tank(jitter=0.15, missed_samples=0.2)
    asked = {"end": metrics.final("tank.level")}
    task, *_ = sweep_task(
        loop, grid({"proportional.gain": [GAIN, GAIN]}), END, start=None, metrics=asked, method="explicit", accuracy=1e-12
    )
    found = finished(dataclasses.replace(task, seeds=np.array([[0], [11]])))
    assert found.values[:, 0] == pytest.approx([by_numpy(0.15, 0.2, seed=seed)[0] for seed in (0, 11)], abs=1e-9)


COMPILED = pytest.mark.skipif(COMPILER is None or sys.platform != "linux", reason="a machine in C is compiled with `cc`, which is not here")


@COMPILED
def test_a_machine_in_c_takes_the_same_samples(tmp_path):
    loop = tank(jitter=0.15, missed_samples=0.2, delay=0.5, seed=11)
    found = CompiledMachine(export_c(loop, tmp_path / "tank", part="loop", duration=END)[0])
    found.run(END)
    assert found.output("tank.level") == pytest.approx(by_numpy(0.15, 0.2, 0.5, 11)[0], abs=1e-6)


def test_a_stepper_takes_the_same_samples_with_every_seed():
    machine = stepper(tank(jitter=0.15, missed_samples=0.2), 1.0, outputs="tank.level", duration=END)
    for seed in (0, 11):
        machine.reset(seed=seed)
        levels = [machine.step()[0] for _ in range(int(END))]
        assert levels[-1] == pytest.approx(by_numpy(0.15, 0.2, seed=seed)[0], abs=1e-5)


RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
CLOCK = {"jitter": "4 ms", "missed_samples": 0.1}


def test_a_scene_keeps_them(tmp_path):
    scene = Scene.of(RIG, 20.0, {"late": Sampled(SoftTorque(reference=9.0), "10 ms", seed=3, **CLOCK)})
    scene.save(tmp_path / "rig.toml")
    law = Scene.load(tmp_path / "rig.toml")["late"].controllers[0]
    assert (law.jitter, law.missed_samples, law.seed) == (0.004, 0.1, 3)
    (tmp_path / "typed.toml").write_text((tmp_path / "rig.toml").read_text().replace("jitter = 0.004", 'jitter = "4 ms"'))
    assert Scene.load(tmp_path / "typed.toml")["late"] == scene["late"]


def test_results_and_loops_name_them():
    loop = closed_loop(RIG, Sampled(SoftTorque(reference=9.0), "10 ms", **CLOCK))
    assert "sampled every 10 ms, late by up to 4 ms, 10 % missed" in str(loop)
    words = str(Situation.of(loop, "rest", "60 s"))
    assert "samples late by up to 4 ms and 10 % of the samples missed" in words
    both = Situation.of(loop, "rest", "60 s", cases={"a": loop, "b": closed_loop(RIG, SoftTorque(), sample_time=0.01)})
    assert "no noise, samples late by up to 4 ms and 10 % of the samples missed under `a`;" in str(both)
    assert "late" not in str(Situation.of(closed_loop(RIG, SoftTorque(), sample_time=0.01), "rest", "60 s"))


def test_smooth_running_is_lost_near_the_regular_border_where_few_samples_are_late():
    """The growth is that of two runs with the same samples: no matrix brings such a loop round."""
    law = SoftTorque(reference=9.0)
    [branch, regular] = [smooth_branch(Sampled(law, 0.01, **clock)) for clock in (CLOCK, {})]
    assert regular(9.0).growth.way == "matrices" and branch(9.0).growth.way == "twin runs"
    assert branch.rate(9.0) == pytest.approx(regular.rate(9.0), rel=0.1) and branch.rate(9.0) != regular.rate(9.0)


def smooth_branch(law):
    loop = closed_loop(RIG, law)
    return SmoothBranch(Request(loop, 1.0).checked(), lambda value: [(loop.number("top.reference"), value)], None)


IRREGULAR = closed_loop(RIG, Sampled(SoftTorque(reference=9.0), 0.01, jitter=0.004))


@pytest.mark.parametrize(
    "question",
    [
        lambda: hopf_points(IRREGULAR, "top.reference", (3.0, 9.0)), lambda: pole_locus(IRREGULAR, "top.reference", [9.0]),
        lambda: margins(IRREGULAR), lambda: limit_cycle(IRREGULAR, "60 s"), lambda: sensitivity(simulate(IRREGULAR, 1.0), "bit.weight"),
    ],
    ids=["hopf_points", "pole_locus", "margins", "limit_cycle", "sensitivity"],
)  # fmt: skip
def test_what_needs_a_period_refuses_them(question):
    with pytest.raises(SceneError, match="`jitter` and `missed_samples` must be left out for .*judge its runs"):
        question()


@pytest.mark.parametrize(
    ("clock", "words"),
    [
        ({"jitter": 0.2}, "`jitter` must be less than the sample time of 0.2 s"), ({"jitter": -0.1}, "jitter"), ({"jitter": math.nan}, "jitter"),
        ({"missed_samples": 1.0}, "missed_samples"), ({"missed_samples": -0.1}, "missed_samples"),
    ],
)  # fmt: skip
def test_wrong_numbers_are_refused(clock, words):
    with pytest.raises(SceneError, match=words):
        simulate(tank(**clock), 1.0)
    [name] = clock
    with pytest.raises(SceneError, match=words):
        sweep(tank(), {f"proportional.{name}": [0.0, *clock.values()]}, 1.0, metrics={"end": metrics.final("tank.level")})
