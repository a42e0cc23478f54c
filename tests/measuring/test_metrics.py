"""The one list of measures: every verb knows each of them, and finds the same number on the same run."""

from __future__ import annotations

import dataclasses
import math
import pickle

import numpy as np
import pytest

from controllers import SoftTorque, StiffPI
from models import BitRock, Block, DiscBrake, wells
from toolbox import Sampled, Scene, SceneError, Trajectory, closed_loop, compare, compose, measure, simulate, sweep, tune, worst_case
from toolbox.commands.command_line import main
from toolbox.measuring import metrics
from toolbox.measuring.metrics import METRICS, metrics_of
from toolbox.onsets.verdicts import COLUMNS, verdict_row
from toolbox.scenes.verdict_table import table

RIG = compose(wells.JANSEN_2, BitRock())
WEIGHT = 97_347.0
SCENE = Scene.of(
    RIG, 60.0, {"stiff": Sampled(StiffPI(reference=9.9), 0.01), "soft": SoftTorque(reference=9.9)}, after=0.5, inputs={"bit.weight": WEIGHT}
)
"""The stiff drive sticks and slips; under the other one the bit, at rest at first, sticks once and settles."""
COMPILED = [name for name, each in METRICS.items() if each.compiled]
OTHERS = [name for name in METRICS if name not in COMPILED]


@pytest.fixture(scope="module", params=SCENE.labels)
def label(request):
    return request.param


@pytest.fixture(scope="module")
def run(label):
    return SCENE.run(label)


@pytest.fixture(scope="module")
def expected(label, run):
    """{name: number}, by the functions of `toolbox.measure`."""
    bit, top = measure.extent(run, "bit.speed", 0.5), measure.extent(run, "top.torque")
    sticks = measure.stick_intervals(run, "bit", 0.5)
    every = measure.stick_intervals(run, "bit")
    speed = run.at(np.linspace(0.5, 60.0, 59_501))["bit.speed"]
    return {
        "severity": measure.severity(run, after=0.5), "minimum": bit.minimum, "maximum": bit.maximum, "mean": bit.mean,
        "final": float(run.at(60.0)["bit.speed"]), "stuck": run.time_in("bit", "stick", after=0.5), "stuck_ratio": measure.stuck_ratio(run, "bit", 0.5),
        "sticks": len(sticks), "longest_stick": max(last - first for first, last in sticks), "last_stick": every[-1][1],
        "events": sum(event.element == "bit" for event in run.events), "settling": measure.settling(run, "bit.speed", 9.9),
        "overshoot": measure.overshoot(run, "bit.speed", 9.9), "standstill": measure.standstill(run, "bit.speed", after=0.5),
        "peak": max(abs(top.minimum), abs(top.maximum)), "releases": sum(last < 60.0 for _, last in sticks),
        "distance": 60.0 * measure.extent(run, "bit.speed").mean, "jerk": np.abs(speed[100:] - 2.0 * speed[50:-50] + speed[:-100]).max() / 0.05**2,
    }  # fmt: skip


def test_the_runs_have_what_is_measured(label, expected):
    assert set(expected) == set(METRICS)
    assert expected["stuck"] > 1.0 and expected["overshoot"] > 0.1
    assert expected["settling"] == math.inf if label == "stiff" else 10.0 < expected["settling"] < 60.0


def swept(label, names):
    found = sweep(SCENE[label], {"bit.weight": [WEIGHT]}, metrics=names)
    return {name: found[name][0] for name in names}


def tuned(label, names):
    number = {"stiff": "stiffpi.integral", "soft": "softtorque.detuning"}[label]
    given = SCENE[label].number(number).value
    found = tune(SCENE, label, names, {number: (0.99 * given, 1.01 * given)}, runs=10)
    return dict(zip(found.objectives, found.before.values[0], strict=True))


def worst(label, names):
    found = worst_case(SCENE[label], 60.0, starts=[{}], after=0.5, metrics=names)
    return found.outcomes[0].more


VERBS = {
    "sweep": lambda label, run, path: swept(label, COMPILED) | swept(label, OTHERS),
    "tune": lambda label, run, path: tuned(label, list(METRICS)),
    "compare": lambda label, run, path: {row.name: row.second for row in compare(run, run, after=0.5, metrics=list(METRICS)).rows},
    "compare with a file": lambda label, run, path: {
        row.name: row.second for row in compare(run, Trajectory.load(run.save(path / "run.npz")), after=0.5, metrics=list(METRICS)).rows
    },
    "worst case": lambda label, run, path: worst(label, list(METRICS)),
    "verdict": lambda label, run, path: verdict_row(SCENE, label, metrics=list(METRICS))[0].more,
    "columns of the verdict": lambda label, run, path: {name: getattr(verdict_row(SCENE, label)[0], name) for name in COLUMNS},
}


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_finds_the_same_numbers(verb, label, run, expected, tmp_path):
    found = VERBS[verb](label, run, tmp_path)
    for name in COLUMNS if verb.startswith("columns") else METRICS:
        # steps as quintics, and as polynomials, are read to the accuracy of the run
        reader = (verb == "sweep" and name in COMPILED) or verb.endswith("file")
        assert found[name] == pytest.approx(expected[name], rel=1e-5 if reader else 1e-12, abs=1e-5 if reader else 1e-12), name


def test_a_measure_is_asked_by_its_name_as_a_value_or_as_a_function(run):
    assert metrics_of(measure.settling) == metrics_of("settling") == metrics_of([metrics.settling]) == {"settling": metrics.settling}
    assert metrics_of({"late": "final"}) == {"late": metrics.final}
    own = metrics_of(len)["len"]
    assert (own.name, own.unit, own.in_loops) == ("len", "1", False)
    asked = metrics.maximum("top.torque", "20 s", 40.0)
    assert asked.heading == "top.torque, maximum" and asked.unit_in(RIG) == "N m"
    assert asked.read(run) == measure.extent(run, "top.torque", 20.0, 40.0).maximum
    assert metrics.time_in("bit", mode="slip+").heading == "bit, time in slip+"
    assert pickle.loads(pickle.dumps(asked)) == asked
    with pytest.raises(TypeError, match="unexpected keyword argument 'bnd'"):
        metrics.settling("bit.speed", bnd=0.1)
    with pytest.raises(SceneError, match=r"must say of which speed it is, as in `metrics.maximum\(...\)`"):
        metrics.maximum.read(run)


def test_what_settles_is_seen_against_the_set_point_of_each_run():
    loop, speeds = closed_loop(RIG, SoftTorque()), [9.0, 11.0]
    for given in (loop, SCENE["soft"]):
        found = sweep(given, {"top.reference": speeds}, 60.0, metrics=("settling", "overshoot"))
        for i, speed in enumerate(speeds):
            alone = simulate(given.at("top.reference", speed), 60.0)
            assert 0.0 < found["settling"][i] < 60.0
            assert found["settling"][i] == pytest.approx(measure.settling(alone, "bit.speed", speed), rel=1e-9)
            assert found["overshoot"][i] == pytest.approx(measure.overshoot(alone, "bit.speed", speed), rel=1e-9)
    other = dataclasses.replace(SCENE, reference=9.0)["soft"]  # the scene judges by another one than the law has
    fixed = sweep(other, {"bit.weight": [WEIGHT]}, metrics="overshoot")["overshoot"][0]
    assert fixed == pytest.approx(measure.overshoot(simulate(other), "bit.speed", 9.0), rel=1e-9)
    with pytest.raises(SceneError, match="must not ask for `settling` where there is no set-point of `bit.speed`"):
        sweep(closed_loop(RIG, inputs={"top.torque": 8e3}), {"bit.weight": [WEIGHT]}, 60.0, metrics="settling")
    with pytest.raises(SceneError, match="must have a contact with dry friction"):
        sweep(compose(Block()), {"block.mass": [1.0]}, 1.0, metrics="stuck")


def test_a_stop_is_measured_until_it_stands_by_every_verb():
    stop = Scene.of(
        compose(DiscBrake()), 1.0, signal="disc.speed", effort="brake.force", after=0.2, standstill_speed=0.1, start={"disc.speed": 2.0},
        inputs={"brake.force": 1000.0},
    )  # fmt: skip
    (label,) = stop.labels
    row, run = verdict_row(stop, label, metrics=["standstill"])
    assert list(row.more) == ["releases", "distance", "jerk", "standstill"]
    assert 0.2 < row.settling < 1.0 and 0.0 < row.stuck < run.time_in("pad", "stick", after=0.2)  # the last stick is that of rest
    assert measure.standstill(run, "disc.speed", 0.1, after=0.2) == row.settling
    found = sweep(stop[label], {"brake.force": [1000.0]}, metrics=("stuck", "settling"))
    assert found["stuck"][0] == pytest.approx(row.stuck, rel=1e-9) and found["settling"][0] == pytest.approx(row.settling, rel=1e-9)


def test_releases_distance_and_jerk_of_a_stop_follow_from_its_events_and_its_speed():
    stop = Scene.of(
        compose(DiscBrake(wheel_radius="300 mm")), 4.0, signal="disc.car_speed", effort="brake.force", after=0.2, standstill_speed=0.03,
        start={"disc.car_speed": 1.0}, inputs={"brake.force": 1000.0},
    )  # fmt: skip
    row, run = verdict_row(stop, stop.labels[0])
    assert math.isfinite(row.settling)
    releases = [
        event.time for event in run.events if event.element == "pad" and event.before == "stick" and 0.2 < event.time < row.settling
    ]
    assert row.more["releases"] == len(releases) > 1
    times = np.linspace(0.0, row.settling, 100_001)
    assert row.more["distance"] == pytest.approx(np.trapezoid(run.at(times)["disc.car_speed"], times), rel=1e-7)
    times = np.arange(0.2, row.settling + 0.1, 1e-4)
    speed = run.at(times)["disc.car_speed"]
    assert row.more["jerk"] == pytest.approx(np.abs(speed[1000:] - 2.0 * speed[500:-500] + speed[:-1000]).max() / 0.05**2, rel=1e-2)
    assert "releases  distance [m]  jerk [m/s3]" in table(stop, [row]) and "severity" not in table(stop, [row])
    rolls, _ = verdict_row(dataclasses.replace(stop, duration=0.5), stop.labels[0])
    assert rolls.verdict == "does not stand" and rolls.more["distance"] == math.inf


def test_distance_and_jerk_have_the_unit_of_their_signal_times_seconds():
    block = compose(Block())
    assert (metrics.distance("block.speed").unit_in(block), metrics.jerk("block.speed").unit_in(block)) == ("m", "m/s3")
    assert (metrics.distance("bit.speed").unit_in(RIG), metrics.jerk("bit.speed").unit_in(RIG)) == ("rad", "rad/s3")


def test_a_measure_without_a_compiled_form_does_not_change_the_others():
    alone = sweep(SCENE["soft"], {"bit.weight": [80e3, WEIGHT]}, metrics="maximum")["maximum"]
    both = sweep(SCENE["soft"], {"bit.weight": [80e3, WEIGHT]}, metrics=("maximum", "settling"))["maximum"]
    np.testing.assert_allclose(both, alone, rtol=1e-6)


def test_the_page_lists_every_measure(root):
    page = (root / "docs" / "concepts" / "analysis.md").read_text(encoding="utf-8")
    listed = [
        name
        for line in page.splitlines()
        if line.startswith("| `")
        for name in line.split("|")[1].replace("`", "").replace(" ", "").split(",")
    ]
    assert set(METRICS) == {name for name in listed if name in METRICS}


def test_the_commands_know_every_measure(tmp_path, capsys):
    assert main(["list", "metrics"]) == 0
    printed = capsys.readouterr().out
    assert all(f"  {name} " in printed for name in METRICS)
    short = dataclasses.replace(SCENE, duration=1.0, cases=SCENE.cases[:1])
    path = str(short.run("stiff").save(tmp_path / "run.npz"))
    assert main(["compare", path, path, "--metric", "settling", "--metric", "peak"]) == 0
    printed = capsys.readouterr().out
    assert "settling" in printed and "peak" in printed
    scene = str(short.save(tmp_path / "scene.toml"))
    assert main(["study", scene, "--metric", "longest_stick", "--out", str(tmp_path / "out")]) == 0
    assert "longest_stick" in capsys.readouterr().out
    heads = (tmp_path / "out" / "table.csv").read_text().splitlines()[0]
    assert heads.endswith(",files,failure,remark,start,regime,tone,failed,reason,longest_stick")
    assert main(["study", scene, "--out", str(tmp_path / "out")]) == 0  # replaces its own
    assert main(["study", scene, "--metric", "longest", "--out", str(tmp_path / "out")]) == 2
    assert "did you mean `longest_stick`" in capsys.readouterr().err
