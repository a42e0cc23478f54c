"""Every verb with every kind of number: it varies it, or says that it cannot and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from controllers import LinearMPC, NormalDither, SoftTorque
from tests.plants import BELT, RIG
from toolbox import (
    Sampled,
    SceneError,
    closed_loop,
    fit,
    follow,
    hopf_curve,
    hopf_points,
    limit_cycle,
    margins,
    onset,
    sensitivity,
    severity_map,
    simulate,
    sweep,
    tune,
    worst_case,
)
from toolbox.commands.command_line import main
from toolbox.inputs import sine, step
from toolbox.inputs import sweep as swept_sine

TURNING = {"chain.speed": (8.0, 8.0), "chain.twist": 18.0}
LAW = SoftTorque(reference=8.0)
CONTINUOUS = closed_loop(RIG, LAW, start=TURNING)
SAMPLED = closed_loop(RIG, LAW, sample_time=0.01, start=TURNING)
NOISY = closed_loop(RIG, Sampled(LAW, 0.01, noise={"top.speed": 0.01}, resolution={"top.speed": 0.01}), start=TURNING)
SHAPED = closed_loop(RIG, inputs={"top.torque": sine(9e3, 500.0, 0.2), "bit.weight": ([0.0, 10.0], [9e4, 8e4])}, start=TURNING)
SWEPT = closed_loop(RIG, inputs={"top.torque": swept_sine(9e3, 500.0, 0.1, 0.4, 10.0), "bit.weight": step(9e4, 8e4, 1.0)}, start=TURNING)


@dataclass(frozen=True)
class Varied:
    """A number of a loop, two values of it, and what verbs refuse of it: {verb: words of the sentence}."""

    loop: Any
    name: str
    kind: str
    values: tuple[float, float]
    refuses: dict[str, str] = field(default_factory=dict)


STEADY = ("hopf_points", "onset", "severity_map")
DESIGN = dict.fromkeys(
    ("sensitivity", *STEADY), "only the design of a controller uses it, so the equations of the loop have no derivative by it"
)
SHAPE = dict.fromkeys(("hopf_points", "severity_map"), "it shapes an input in time") | {
    "onset": "`top.torque` must be a number for an onset", "margins": "must contain a controller",
}  # fmt: skip
NODE = dict.fromkeys(("sensitivity", "hopf_points", "severity_map"), "a number of a table in time, by which no derivative is computed")
NODE |= {"onset": SHAPE["onset"], "margins": SHAPE["margins"]}
NODE |= dict.fromkeys(("sweep", "worst_case"), "`bit.weight` is a table, which is the same in all runs")
MOVING = {**dict.fromkeys(("sensitivity", "hopf_points", "severity_map", "worst_case"), "varies in time"), "onset": SHAPE["onset"]}
START = dict.fromkeys(STEADY, "it is a start value, which has no influence on steady running and cycles: vary it with `sweep`") | {
    "worst_case": "give `starts`"
}
CLOCK = {"sensitivity": "by which a run has no derivative"}
NOISE = {"hopf_points": "because they are computed without noise"}
RESOLUTION = {
    "hopf_points": "by which the equations of the loop have no derivative",
    "sensitivity": "a rounded measurement has the derivative 0",
}
OVERRIDDEN = dict.fromkeys(("sensitivity", "sweep", "worst_case", *STEADY), "the input `top.reference` overrides it")

NUMBERS = [
    Varied(CONTINUOUS, "top.reference", "input", (8.0, 9.0)),
    Varied(CONTINUOUS.at("top.reference", 8.0), "top.reference", "input", (8.0, 9.0)),
    Varied(CONTINUOUS, "bit.weight", "input", (9e4, 9.5e4)),
    Varied(CONTINUOUS, "bit.friction.kinetic", "parameter", (0.35, 0.4)),
    Varied(CONTINUOUS, "chain.inertia.0", "parameter", (2000.0, 2100.0)),
    Varied(CONTINUOUS, "softtorque.proportional", "parameter", (450.0, 500.0)),
    Varied(CONTINUOUS, "softtorque.detuning", "design", (1.1, 1.2), DESIGN),
    Varied(SHAPED, "top.torque.amplitude", "shape", (400.0, 600.0), SHAPE),
    Varied(SWEPT, "top.torque.end", "shape", (0.3, 0.5), SHAPE),
    Varied(SHAPED, "bit.weight.values.1", "node", (8e4, 8.5e4), NODE),
    Varied(SWEPT, "bit.weight.at", "node", (1.0, 1.5), NODE),
    Varied(SHAPED, "top.torque", "input", (9e3, 9.5e3), MOVING | {"margins": SHAPE["margins"]}),
    Varied(CONTINUOUS, "bit.speed", "start", (7.0, 9.0), START),
    Varied(SAMPLED, "softtorque.sample_time", "sample time", (0.01, 0.02), CLOCK),
    Varied(SAMPLED, "softtorque.delay", "delay", (0.01, 0.02), CLOCK),
    Varied(NOISY, "softtorque.sensors.noise.0", "noise", (0.01, 0.02), NOISE | {"sensitivity": RESOLUTION["sensitivity"]}),
    Varied(NOISY, "softtorque.sensors.resolution.0", "resolution", (0.01, 0.02), RESOLUTION),
    Varied(SAMPLED, "softtorque.angle", "start", (5.0, 6.0), START),
    Varied(CONTINUOUS.at("top.reference", 8.0), "softtorque.reference", "parameter", (7.0, 9.0), OVERRIDDEN),
]
each_number = pytest.mark.parametrize("number", NUMBERS, ids=[f"{each.name}-{k}" for k, each in enumerate(NUMBERS)])


def speeds(loop, name, values):
    """The bit speed after 2 s at each value."""
    return [float(simulate(loop.at(name, value), 2.0, accuracy=1e-9).at(2.0)["bit.speed"]) for value in values]


def answered(number, verb, question):
    """What a verb answers of a number; None where it refuses, in the words expected."""
    words = number.refuses.get(verb)
    if words is None:
        return question()
    with pytest.raises(SceneError, match=words):
        question()
    return None


@each_number
def test_simulate_varies_it(number):
    assert str(number.loop.number(number.name).kind) == number.kind
    assert (len(set(speeds(number.loop, number.name, number.values))) == 1) == (number.refuses == OVERRIDDEN)


@each_number
def test_a_sweep_varies_it_as_simulate_does(number):
    measure = {"end": lambda run: float(run.at(2.0)["bit.speed"])}
    found = answered(number, "sweep", lambda: sweep(number.loop, {number.name: number.values}, 2.0, metrics=measure, accuracy=1e-9))
    if found is not None:
        np.testing.assert_allclose(found["end"], speeds(number.loop, number.name, number.values), rtol=1e-6)


@each_number
def test_sensitivity_is_the_slope_of_simulate(number):
    value = number.loop.number(number.name).value
    found = answered(
        number, "sensitivity", lambda: sensitivity(simulate(number.loop, 2.0, accuracy=1e-11), number.name).end("bit.speed")[0]
    )
    if found is not None:
        size = 1e-5 * (abs(value) or 1.0)
        low, high = (
            float(simulate(number.loop.at(number.name, value + side), 2.0, accuracy=1e-12).at(2.0)["bit.speed"]) for side in (-size, size)
        )
        assert found == pytest.approx((high - low) / (2 * size), rel=2e-4, abs=1e-9)


@each_number
def test_margins_are_those_of_the_loop_with_it(number):
    def question():
        return [margins(number.loop.at(number.name, value), by_simulation=False).disk_margin for value in number.values]

    found = answered(number, "margins", question)
    assert found is None or all(value > 0.1 for value in found)


@each_number
def test_worst_case_takes_it_as_an_error(number):
    found = answered(number, "worst_case", lambda: worst_case(number.loop, 2.0, uncertainty={number.name: 1.01}, starts=[TURNING]))
    assert found is None or [*found.by_error] == ["nominal", f"{number.name} +1 %"]


@each_number
def test_hopf_points_over_it(number):
    found = answered(number, "hopf_points", lambda: hopf_points(number.loop, number.name, number.values, num_values=2))
    assert found is None or all(number.values[0] <= point.value <= number.values[1] for point in found)


@pytest.mark.parametrize("verb", ["onset", "severity_map"])
@pytest.mark.parametrize("number", [each for each in NUMBERS if "onset" in each.refuses], ids=lambda number: number.name)
def test_what_onset_and_severity_map_cannot_vary_they_say(number, verb):
    def question():
        if verb == "onset":
            return onset(number.loop, number.name, number.values, num_values=3)
        return severity_map(number.loop, {number.name: number.values, "bit.friction.static": (0.7, 0.8)}, shape=(2, 2))

    assert answered(number, verb, question) is None


@pytest.mark.slow
@pytest.mark.parametrize("number", [each for each in NUMBERS if "onset" not in each.refuses], ids=lambda number: number.name)
def test_onset_and_severity_map_vary_all_others(number):
    assert onset(number.loop, number.name, number.values, num_values=3).parameter == number.name
    found = severity_map(number.loop, {number.name: number.values, "bit.friction.static": (0.7, 0.8)}, shape=(2, 2))
    assert number.name in str(found)


def test_cycles_are_followed_through_every_number_that_has_a_slope():
    free = limit_cycle(closed_loop(BELT, start={"block.position": 1.2}), 60.0)
    names = [name for name, number in free.loop.variable_numbers().items() if number.kind.has_slope and number.value > 0.0]
    assert {"block.belt_speed", "block.stiffness"} <= {*names}
    for name in names:
        value = free.loop.number(name).value
        branch = follow(free, name, (0.98 * value, 1.02 * value), points=2)
        assert branch.parameter == name and len(branch.values) == 2 and branch.loop.number(name).value == pytest.approx(value)
        assert branch.cycles[1].loop.number(name).value == pytest.approx(branch.values[1], rel=1e-12) != value
    with pytest.raises(SceneError, match="it is a start value, which has no influence on steady running and cycles: vary it with `sweep`"):
        follow(free, "block.position", (1.0, 2.0))


def test_what_a_law_drives_has_no_effect_and_is_said():
    loop = closed_loop(RIG, [LAW, NormalDither(depth=0.1)], sample_time=0.01)
    assert loop.number("bit.weight").overridden == "bit.weight"
    for verb in (
        lambda: sweep(loop, {"bit.weight": [9e4, 8e4]}, 1.0),
        lambda: worst_case(loop, 1.0, uncertainty={"bit.weight": 1.1}, starts=[{}]),
    ):
        with pytest.raises(
            SceneError, match="`bit.weight` must have an effect to be varied, but a controller gives the signal `bit.weight`"
        ):
            verb()


def test_a_curve_of_hopf_points_and_a_law_in_python_say_so_too():
    with pytest.raises(SceneError, match="only the design of a controller uses it"):
        hopf_curve(CONTINUOUS, "top.reference", (3.0, 6.0), "softtorque.detuning", [1.0])
    planned = closed_loop(RIG, LinearMPC(reference=8.0), sample_time=0.1, start=TURNING)
    with pytest.raises(SceneError, match="the design of this controller is a Python callable, which is the same in all runs"):
        sweep(planned, {"linearmpc.torque_scale": [1e4, 2e4]}, 1.0)


NUMERIC = [each for each in NUMBERS if math.isfinite(each.loop.number(each.name).value)]
FITTED = [
    each
    for each in NUMERIC
    if each.kind not in ("sample time", "delay", "noise", "resolution", "design") and each.refuses is not OVERRIDDEN
]


@pytest.mark.parametrize("number", FITTED, ids=lambda number: number.name)
def test_fit_finds_every_number_that_a_run_depends_on(number):
    truth = number.values[1]
    run = simulate(number.loop.at(number.name, truth), 3.0, output_times=np.linspace(0.0, 3.0, 61), accuracy=1e-10)
    data = {"time": run.time, "top.speed": run["top.speed"], "bit.speed": run["bit.speed"]}
    found = fit(number.loop, data, number.name, starts=1)
    assert found.values[0] == pytest.approx(truth, rel=1e-3)


def test_fit_refuses_what_has_no_effect_and_what_varies_in_time():
    times = np.linspace(0.0, 2.0, 21)
    data = {"time": times, "bit.speed": np.full(21, 8.0)}
    with pytest.raises(SceneError, match="`softtorque.reference`"):
        fit(CONTINUOUS.at("top.reference", 8.0), data, "softtorque.reference", starts=1)
    with pytest.raises(SceneError, match="`top.torque` varies in time or is measured"):
        fit(SHAPED, data, "top.torque", starts=1)


def test_tune_takes_the_numbers_of_its_law_and_names_them_for_any_other():
    found = tune(RIG, LAW, lambda run: -float(run.at(2.0)["top.speed"]), {"softtorque.detuning": (1.0, 1.5)}, duration=2.0, runs=10)
    assert "softtorque.detuning" in str(found)
    with pytest.raises(SceneError, match="bit.weight"):
        tune(RIG, LAW, "severity", {"bit.weight": (8e4, 9e4)}, duration=2.0, runs=10)


SCENE = """
title = "Two inertias"
duration = "2 s"
reference = 8.0
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
[[controllers]]
label = "soft torque"
law = "SoftTorque"
sample_time = "10 ms"
"""


@pytest.mark.parametrize(
    "name",
    [
        "top.reference",
        "bit.weight",
        "bit.friction.kinetic",
        "chain.inertia.0",
        "softtorque.proportional",
        "softtorque.detuning",
        "softtorque.sample_time",
        "bit.speed",
    ],
)
def test_the_command_line_sweeps_it(name, tmp_path, capsys):
    (tmp_path / "rig.toml").write_text(SCENE)
    value = {"bit.speed": 2.0}.get(name) or SAMPLED.number(name).value
    given = ["sweep", str(tmp_path / "rig.toml"), "--range", f"{name}={0.98 * value}:{value}:2", "--out", str(tmp_path / "out")]
    assert main(given) == 0 and name in capsys.readouterr().out


def test_the_command_line_says_what_it_cannot_sweep(tmp_path, capsys):
    (tmp_path / "rig.toml").write_text(SCENE)
    given = ["sweep", str(tmp_path / "rig.toml"), "--range", "pi.period=0.01:0.02:2", "--out", str(tmp_path / "out")]
    assert main(given) == 2 and "`pi.period` is named `softtorque.sample_time` now" in capsys.readouterr().err


def test_a_number_that_stands_nowhere_among_the_parameters_of_a_program_is_told_so():
    loop = closed_loop(RIG, SoftTorque(), sample_time="10 ms", inputs={"top.reference": ([0.0, 1.0], [1.0, 2.0])})
    program = simulate(loop, 0.0).program
    for name, why in (
        ("softtorque.detuning", "only the design"),
        ("softtorque.sample_time", "it is a sample time"),
        ("bit.speed", "it is a start value"),
        ("top.reference.values.1", "it is a number of a table"),
        ("bit.weight", "must be given to the loop"),
    ):
        with pytest.raises(SceneError, match=rf"`{name}` .*{why}"):
            program.place(loop.number(name), loop.input_values)
