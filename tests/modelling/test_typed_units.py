"""Text with units wherever a quantity is typed in Python: the same bits as the number in SI, and an error that names the field where it does not fit."""

from __future__ import annotations

import math
import runpy
import tempfile
from pathlib import Path

import numpy as np
import pytest

import toolbox
from controllers import PI, ImpedanceSuperTwisting, Lifting, ZTorque
from models import BitRock, Exponential, GaussianStribeck, TorsionalChain
from tests.plants import BELT, RIG
from toolbox import Budget, Sampled, SceneError, closed_loop, equilibrium, inputs, onset, severity_map, simulate, sweep
from toolbox.inputs import ramp, sine
from toolbox.modelling.inputs import Table
from toolbox.simulation import EventExact

RPM = math.pi / 30


def test_a_field_holds_its_number_in_si_whatever_text_it_was_given_as():
    assert BitRock(weight="97.347 kN") == BitRock(weight=97_347.0)
    assert PI(reference="60 rpm").reference == pytest.approx(2 * math.pi, rel=1e-15)
    chain = TorsionalChain(inertia=("2122 kg m2", 374.0), stiffness=["0.473 kN m/rad"])
    assert chain.inertia == (2122.0, 374.0) and chain.stiffness == (473.0,)
    assert ZTorque(reference="95 rpm", highest_torque="20 kN m").highest_torque == 20_000.0
    assert Lifting(law=ZTorque(reference="95 rpm"), reference="95 rpm").reference == pytest.approx(95 * RPM, rel=1e-15)
    assert ImpedanceSuperTwisting(reference="120 RPM").reference == pytest.approx(4 * math.pi, rel=1e-15)


def test_a_friction_law_takes_the_slip_of_a_turning_contact_and_of_a_straight_one():
    assert Exponential(decay="0.9 s/rad") == Exponential(decay="0.9 s/m") == Exponential(decay=0.9)
    assert GaussianStribeck(stribeck_speed="12 rpm").stribeck_speed == pytest.approx(12 * RPM, rel=1e-15)
    with pytest.raises(SceneError, match=r"`GaussianStribeck.stribeck_speed` must be in .*but `3 N` is in N"):
        GaussianStribeck(stribeck_speed="3 N")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: BitRock(weight="97 rpm"), "Argument `BitRock.weight` must be in N, but `97 rpm` is in rpm"),
        (lambda: BitRock(weight="97"), "Argument `BitRock.weight` must be in N, but `97` has no unit"),
        (lambda: BitRock(weight="97 kilo"), "Argument `BitRock.weight` must be in N, but `97 kilo` has the unknown unit"),
        (lambda: TorsionalChain(inertia=(1.0, "2 N")), "Argument `TorsionalChain.inertia.1` must be in kg m2, but `2 N` is in N"),
        (lambda: Sampled(PI(reference=9.0), "10 mm"), "Argument `period` must be in s, but `10 mm` is in mm"),
        (lambda: Budget(seconds="1 N"), "Argument `budget.seconds` must be in s"),
        (lambda: ramp(0.0, 1.0, "1 m", 2.0), "Argument `begin` must be in s, but `1 m` is in m"),
    ],
)  # fmt: skip
def test_text_that_is_no_quantity_of_the_field_is_refused_where_it_is_typed(make, words):
    with pytest.raises(SceneError, match=words.replace("(", r"\(")):
        make()


def test_a_run_that_is_asked_for_in_field_units_has_the_bits_of_one_in_si():
    typed = simulate(
        RIG, "0.5 min", start={"top.speed": "20 rpm"}, parameters={"chain.stiffness": ("473 N m/rad",)}, method=EventExact(budget=Budget(seconds="1 min")),
        controller=Sampled(PI(reference="60 rpm"), "10 ms", delay="30 ms", noise={"top.speed": "0.1 rpm"}, resolution={"top.speed": "0.01 rpm"}),
        inputs={"top.reference": ramp("35 rpm", "60 rpm", "10 s", 20.0), "bit.weight": ([0.0, "5 s"], ["97.347 kN", 98_000.0])},
    )  # fmt: skip
    plain = simulate(
        RIG, 30.0, start={"top.speed": 20 * RPM}, parameters={"chain.stiffness": (473.0,)},
        controller=Sampled(PI(reference=60 * RPM), 0.01, delay=0.03, noise={"top.speed": 0.1 * RPM}, resolution={"top.speed": 0.01 * RPM}),
        inputs={"top.reference": ramp(35 * RPM, 60 * RPM, 10.0, 20.0), "bit.weight": ([0.0, 5.0], [97_347.0, 98_000.0])},
    )  # fmt: skip
    assert np.allclose(typed.states[-1], plain.states[-1], rtol=1e-9)  # a factor of pint and ours may differ by the last digit
    held = simulate(RIG, 30.0, inputs={"top.torque": "8 kN m"}, sample_time=None)
    assert np.array_equal(held.states, simulate(RIG, 30.0, inputs={"top.torque": 8000.0}).states)


def test_a_shape_with_units_is_made_where_the_unit_of_its_signal_is_known():
    assert isinstance(ramp(0.0, 1.0, "1 s", "2 min"), Table)
    assert ramp(0.0, 1.0, "1 s", "2 min").times.tolist() == [1.0, 120.0]
    assert sine("1 kN", "500 N", "2 Hz").made("block.force", "N") == sine(1000.0, 500.0, 2.0)
    assert inputs.square("1 kN", "0.5 kN", 2.0, "3 s").made("a", "N").times.size == inputs.square(1000.0, 500.0, 2.0, 3.0).times.size
    with pytest.raises(SceneError, match=r"Argument `top.torque.start` must be in N m, but `1 rpm` is in rpm"):
        simulate(RIG, 1.0, inputs={"top.torque": ramp("1 rpm", "2 rpm", 0.0, 1.0)})


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"duration": "2 rpm"}, "`duration` must be in s"),
        ({"duration": 1.0, "inputs": {"top.torque": "10 kN"}}, "`top.torque` must be in N m, but `10 kN` is in kN"),
        ({"duration": 1.0, "start": {"bit.speed": "3 m/s"}}, "`bit.speed` must be in rad/s"),
        ({"duration": 1.0, "parameters": {"chain.stiffness": ("473 N",)}}, r"`chain.stiffness.0` must be in N m/rad"),
        ({"duration": 1.0, "inputs": {"top.torque": ([0.0, "1 N"], [0.0, 1.0])}}, r"`top.torque.times.1` must be in s"),
        ({"duration": 1.0, "controller": Sampled(PI(reference=9.0), 0.01, noise={"top.speed": "1 N"})}, r"`noise.top.speed` must be in rad/s"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named_with_its_unit(given, words):
    with pytest.raises(SceneError, match=words):
        simulate(RIG, **given)


def test_steady_states_and_onsets_are_asked_for_in_field_units():
    typed, plain = (equilibrium(closed_loop(RIG, inputs={"top.torque": torque})) for torque in ("20 kN m", 20_000.0))
    assert typed["bit.speed"] == plain["bit.speed"]
    with pytest.raises(SceneError, match=r"`bounds.1` must be in m/s, but `2 N` is in N"):
        onset(BELT, "block.belt_speed", (0.1, "2 N"))


SCRIPT = Path(__file__).parents[1] / "examples" / "typed_units.py"


@pytest.mark.slow
def test_a_type_checker_has_nothing_to_say_about_text_with_units_where_it_is_taken(tmp_path):
    api = pytest.importorskip("mypy.api")
    root = SCRIPT.parents[2]
    wrong = tmp_path / "wrong.py"
    wrong.write_text("from controllers import PI\nspeed: str = PI(reference='60 rpm').reference\n")
    words = ["--config-file", str(root / "pyproject.toml"), "--cache-dir", str(tmp_path)]
    said, _, code = api.run([*words, str(SCRIPT), str(wrong)])
    assert 'expression has type "float", variable has type "str"' in said and said.count("error:") == 1 and code == 1, said


@pytest.mark.slow
def test_a_strict_type_checker_knows_what_results_hold():
    api = pytest.importorskip("mypy.api")
    script = SCRIPT.with_name("typed_results.py")  # it asserts the type of everything that it reads
    wrong = script.read_text().replace("assert_type(found.end, float)", "assert_type(found.end, str)")
    with tempfile.TemporaryDirectory() as folder:
        other = Path(folder) / "wrong.py"
        other.write_text(wrong)
        # as of an installed toolbox, whose own errors a checker does not show
        words = ["--strict", "--follow-imports=silent", "--ignore-missing-imports", "--cache-dir", f"{folder}/cache"]
        said, _, code = api.run([*words, str(script), str(other)])
    assert 'Expression is of type "float", not "str"' in said and said.count("error:") == 1 and code == 1, said


@pytest.mark.slow
def test_the_script_that_reads_results_runs():
    found = runpy.run_path(str(SCRIPT.with_name("typed_results.py")))
    assert found["fitted"]["bit.weight"] == pytest.approx(97_347.0, rel=1e-3) and len(found["branch"].values) == 3


@pytest.mark.slow
def test_every_verb_takes_text_with_units_and_means_what_the_number_means():
    found = runpy.run_path(str(SCRIPT))
    assert found["speed"] == pytest.approx(95 * RPM, rel=1e-15) and found["first"] == 4244.0
    assert np.allclose(found["charted"].axes, [[60 * RPM, 140 * RPM], [50e3, 110e3]], rtol=1e-14, atol=0)
    assert np.allclose([found["found"].values[0], found["found"].at], [60 * RPM, 120 * RPM], rtol=1e-14, atol=0)
    assert found["swept"].points.ravel().tolist() == [50e3, 60e3] and np.allclose(
        found["listed"].points, [[50e3, 60 * RPM]], rtol=1e-14, atol=0
    )
    rig, stiff = found["rig"], found["stiff"]
    plain = sweep(closed_loop(rig, stiff, sample_time=0.01), {"bit.weight": [50e3, 60e3]}, 5.0)
    assert all(np.array_equal(plain[name], found["swept"][name], equal_nan=True) for name in plain.metrics)
    assert found["stuck"] == found["run"].time_in("bit", "stick", after=2.0, until=10.0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: severity_map(RIG, {"bit.weight": ("50 rpm", "9 kN"), "top.torque": (1e3, 2e3)}), r"`bit.weight.0` must be in N, but `50 rpm` is in rpm"),
        (lambda: sweep(RIG, {"bit.weight": ["50 m"]}, 1.0), r"`bit.weight.0` must be in N, but `50 m`"),
        (lambda: sweep(RIG, {"bit.wheight": ["50 kN"]}, 1.0), r"`bit.wheight` in this loop: did you mean `bit.weight`"),
        (lambda: simulate(RIG, 1.0).time_in("bit", "stick", after="1 N"), r"`after` must be in s"),
        (lambda: simulate(RIG, 1.0).at("1 N"), r"`time` must be in s"),
        (lambda: toolbox.measure.overshoot(simulate(RIG, 1.0), "top.speed", "3 N"), r"`target` must be in rad/s"),
        (lambda: toolbox.steady_states.pole_locus(RIG, "top.torque", ["3 N"]), r"`values.0` must be in N m"),
        (lambda: toolbox.robustness.performance_limit(RIG, {"top.speed": "3 N"}), r"`top.speed` must be in rad/s"),
    ],
)  # fmt: skip
def test_a_wrong_unit_is_refused_by_every_verb(call, words):
    with pytest.raises(SceneError, match=words):
        call()
