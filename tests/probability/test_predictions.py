"""What draws predict beside what was measured, and models of one measurement: by closed forms, and on a block whose law is known."""

import functools
import math

import numpy as np
import pytest

from models import BlockOnBelt, Coulomb, Exponential, GaussianStribeck
from toolbox import SceneError, closed_loop, compose, simulate, sweep
from toolbox.calibration import Recording
from toolbox.measuring.metrics import mean
from toolbox.probability import ModelComparison, Normal, Prediction, Uniform, compare_models, from_recording, posterior, predict

TRUE = compose(BlockOnBelt(belt_speed=1.0, friction=Exponential(static=1.0, kinetic=0.5, decay=2.0)))
TIMES = np.arange(0.0, 12.0, 0.05)
NOISE = 0.05


@functools.cache
def measured():
    """A recording of the position of the block, with noise and a gap."""
    run, rng = simulate(TRUE, TIMES[-1], output_times=TIMES), np.random.default_rng(1)
    values = run["block.position"] + NOISE * rng.standard_normal(TIMES.size)
    values[60:80] = math.nan
    return Recording.of({"time": TIMES, "block.position": values}, TRUE)


def test_a_band_of_95_percent_covers_about_95_of_100_samples_where_the_model_is_right_and_fewer_where_it_is_not():
    exact = {"belt.friction.static": Normal(1.0, 1e-6)}
    right = predict(closed_loop(TRUE), exact, {"block.position": NOISE}, recording=measured(), draws=400)
    known = int(np.isfinite(measured().signals["block.position"]).sum())
    assert abs(right.coverage["block.position"] - 0.95) < 4 * math.sqrt(0.95 * 0.05 / known)
    wrong = predict(closed_loop(TRUE), {"belt.friction.static": Normal(0.8, 1e-6)}, {"block.position": NOISE}, recording=measured())
    assert wrong.coverage["block.position"] < 0.7


def test_the_band_of_the_motion_is_that_of_its_quantiles():
    found = predict(closed_loop(TRUE), {"block.position": Uniform(0.0, 0.2)}, {"block.position": 0.0}, 1.0, draws=400, confidence=0.8)
    assert found.low["block.position"][0] == pytest.approx(0.02, abs=0.01)
    assert found.median["block.position"][0] == pytest.approx(0.1, abs=0.015)
    assert found.high["block.position"][0] == pytest.approx(0.18, abs=0.01)
    assert math.isnan(found.coverage["block.position"]) and found.time.size == 501


def test_a_prediction_prints_draws_and_goes_to_a_file(tmp_path):
    found = predict(
        closed_loop(TRUE), {"belt.friction.static": "1 +- 0.1"}, {"block.position": NOISE, "block.speed": 0.0}, recording=measured()
    )
    again = Prediction.load(found.save(tmp_path / "found.npz"))
    assert str(again) == str(found) and "220" in str(found)
    assert found.save(tmp_path / "found.csv").read_text().startswith("time [s],block.position low [m],")
    assert found.plot().shape == (2, 1)


def test_what_cannot_be_predicted_is_refused():
    with pytest.raises(SceneError, match="must name signals, but `block.positon`"):
        predict(closed_loop(TRUE), {"belt.friction.static": "1 +- 0.1"}, {"block.positon": 0.1}, 1.0)
    with pytest.raises(SceneError, match="must have one of the signals"):
        predict(closed_loop(TRUE), {"belt.friction.static": "1 +- 0.1"}, {"block.speed": 0.1}, recording=measured())


def test_a_recording_is_loop_data_and_measures_with_its_gap_left_out():
    loop, data, read = from_recording(TRUE, measured(), {"block.position": NOISE / math.sqrt(20)}, "1 s")
    assert len(data) == len(read) == 11 and "block.position from 3 s" not in data
    found = posterior(loop, data, {"belt.friction.static": Uniform(0.7, 1.3)}, float(TIMES[-1]), metrics=read, draws=64)
    assert abs(found["belt.friction.static"].mean() - 1.0) < 4 * found["belt.friction.static"].std() < 0.2
    with pytest.raises(SceneError, match="must name measured signals that drive nothing, but it names `block.speed`"):
        from_recording(TRUE, measured(), {"block.speed": 0.1})


def test_long_holes_in_what_drives_a_machine_are_bridged_only_where_that_is_said():
    plant = compose(BlockOnBelt())
    name = next(iter(plant.inputs))
    values = np.linspace(1.0, 1.1, TIMES.size)
    values[10:14] = math.nan
    told = Recording.of({"time": TIMES, name: values, "block.position": np.sin(TIMES)}, plant)
    with pytest.raises(SceneError, match="choose among the windows"):
        told.driving(plant)
    times, found = told.driving(plant, 4)[name]
    assert times.size == TIMES.size - 4 and np.isfinite(found).all()


@functools.cache
def compared():
    laws = {
        "exponential": Exponential(static=1.0, kinetic=0.6, decay=2.0),
        "Gaussian": GaussianStribeck(static=1.0, kinetic=0.6, stribeck_speed=0.5),
        "Coulomb": Coulomb(static=1.0, kinetic=0.6),
    }
    models, data, read = {}, {}, {}
    for label, law in laws.items():
        models[label], data, read = from_recording(
            compose(BlockOnBelt(belt_speed=1.0, friction=law)), measured(), {"block.position": NOISE / math.sqrt(10)}, "0.5 s"
        )
    common = {"belt.friction.static": Uniform(0.8, 1.2), "belt.friction.kinetic": Uniform(0.3, 0.8)}
    priors = {"exponential": {**common, "belt.friction.decay": Uniform(0.5, 5.0)}, "Coulomb": common}
    priors["Gaussian"] = {**common, "belt.friction.stribeck_speed": Uniform(0.2, 2.0)}
    left = {name: data.pop(name) for name in list(data)[1::3]}
    return compare_models(models, data, priors, float(TIMES[-1]), left_out=left, metrics=read, draws=64)


@pytest.mark.slow
def test_the_law_behind_the_data_has_the_evidence_and_predicts_what_was_left_out():
    found = compared()
    assert max(found.probabilities, key=found.probabilities.get) == "exponential" and sum(found.probabilities.values()) == pytest.approx(
        1.0
    )
    assert found.probabilities["Gaussian"] < 0.01
    behind, error = found.behind("exponential")
    assert behind <= 3.0 * error and found.behind("Coulomb")[0] > 100.0  # bent laws predict alike, a constant one does not
    known = found.posteriors["exponential"]
    for name, truth in (("static", 1.0), ("kinetic", 0.5), ("decay", 2.0)):
        values = known[f"belt.friction.{name}"]
        assert abs(values.mean() - truth) < 4 * values.std()


@pytest.mark.slow
def test_a_comparison_prints_draws_and_goes_to_a_file(tmp_path):
    found = compared()
    again = ModelComparison.load(found.save(tmp_path / "found.npz"))
    assert str(again) == str(found) and "7 windows left out" in str(found)
    assert len(found.save(tmp_path / "found.csv").read_text().splitlines()) == 4
    assert [ax.get_xlabel() for ax in found.plot()] == ["behind the best in evidence [nats]", "behind the best in windows left out [nats]"]


def test_a_datum_that_was_left_out_is_scored_by_the_mean_density_of_the_draws():
    loop = closed_loop(TRUE)
    read = {name: mean("block.position", a, a + 1.0) for name, a in (("first", 1.0), ("second", 2.0))}
    data, left = {"first": Normal(0.5, 0.2)}, {"second": Normal(0.6, 0.3)}
    prior = {"belt.friction.static": Uniform(0.8, 1.2)}
    models = {"one": loop, "same": loop}
    found = compare_models(models, data, dict.fromkeys(models, prior), 3.0, left_out=left, metrics=read, draws=32)
    rows = [{"belt.friction.static": value} for value in found.posteriors["one"]["belt.friction.static"].tolist()]
    told = sweep(loop, rows, 3.0, metrics=read, accuracy=1e-8)["second"]
    density = np.exp(-0.5 * ((told - 0.6) / 0.3) ** 2) / (0.3 * math.sqrt(2 * math.pi))
    assert found.log_scores["one"][0] == pytest.approx(math.log(density.mean()), abs=1e-4)
    assert np.array_equal(found.log_scores["one"], found.log_scores["same"]) and found.behind("one") == (0.0, 0.0)


def test_models_without_priors_of_their_own_are_refused():
    loop = closed_loop(TRUE)
    with pytest.raises(SceneError, match="must map at least two labels"):
        compare_models({"one": loop}, {"severity": "1 +- 0.1"}, {"one": {}})
    with pytest.raises(SceneError, match="must have the labels of the models"):
        compare_models({"one": loop, "two": loop}, {"severity": "1 +- 0.1"}, {"one": {}})
    with pytest.raises(SceneError, match="`severity` is in both"):
        compare_models({"one": loop, "two": loop}, {"severity": "1 +- 0.1"}, {"one": {}, "two": {}}, left_out={"severity": "1 +- 0.1"})
