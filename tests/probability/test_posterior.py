"""Posteriors by tempered sequential Monte Carlo: against closed forms, against dynesty, and of a machine."""

import numpy as np
import pytest
from scipy import stats

from controllers import StiffPI
from models import BitRock, wells
from toolbox import SceneError, SimulationError, closed_loop, compose, simulate, sweep
from toolbox.measuring import metrics
from toolbox.probability import Normal, Posterior, Uniform, chance, posterior, windowed
from toolbox.probability.distributions import told
from toolbox.probability.tempering import tempered

DEVIATION = 0.2


def gaussian(data):
    """Logarithm of the likelihood of data around standard normal unknowns."""
    return lambda points: stats.norm(0.0, DEVIATION).logpdf(data - points).sum(axis=1)


def test_the_posterior_of_a_gaussian_is_the_closed_form():
    data, deviation = np.array([1.0, -1.5]), DEVIATION / np.hypot(1.0, DEVIATION)
    found = tempered(gaussian(data), 2, 2000, np.random.default_rng(1))
    assert found.evidence == pytest.approx(stats.norm(0.0, np.hypot(1.0, DEVIATION)).logpdf(data).sum(), abs=4 * found.error)
    assert found.points.mean(axis=0) == pytest.approx(data / (1.0 + DEVIATION**2), abs=4 * deviation / np.sqrt(500))
    assert found.points.std(axis=0) == pytest.approx(np.full(2, deviation), rel=0.1)


def test_two_peaks_keep_their_parts_of_the_posterior():
    def likelihood(points):
        return np.logaddexp(
            np.log(0.3) + stats.norm(-1.5, 0.1).logpdf(points[:, 0]), np.log(0.7) + stats.norm(1.5, 0.1).logpdf(points[:, 0])
        )

    found = [tempered(likelihood, 1, 1000, np.random.default_rng(k)) for k in range(4)]
    assert np.mean([(each.points[:, 0] > 0).mean() for each in found]) == pytest.approx(0.7, abs=0.06)


@pytest.mark.slow
def test_ranks_of_400_repetitions_are_uniform():
    """Simulation-based calibration, Talts and others (2018): the rank of the truth among independent draws is uniform."""
    ranks = []
    for k in range(400):
        rng = np.random.default_rng([7, k])
        truth = rng.standard_normal(2)
        data = truth + DEVIATION * rng.standard_normal(2)
        found = tempered(gaussian(data), 2, 128, rng)
        some = found.points[rng.permutation(128)[:19]]
        ranks.append((some < truth).sum(axis=0))
    for row in np.array(ranks).T:
        counts = np.bincount(row, minlength=20)
        assert stats.chisquare(counts.reshape(10, 2).sum(axis=1)).pvalue > 0.01
        assert abs(stats.norm.ppf((row + 0.5) / 20).mean()) < 2.58 / np.sqrt(400) * 1.1  # no trend


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["gaussian", "banana", "two peaks"])
def test_the_evidence_is_that_of_dynesty(kind):
    dynesty = pytest.importorskip("dynesty")
    likelihood = {
        "gaussian": gaussian(np.array([1.0, -1.5])),
        "banana": lambda z: stats.norm(0.5, 0.2).logpdf(z[:, 1] + z[:, 0] ** 2) + stats.norm(0.3, 0.5).logpdf(z[:, 0]),
        "two peaks": lambda z: np.logaddexp(*(stats.norm(m, 0.2).logpdf(z).sum(axis=1) for m in (-1.0, 1.0))),
    }[kind]
    ours = tempered(likelihood, 2, 1000, np.random.default_rng(2))
    sampler = dynesty.NestedSampler(lambda z: float(likelihood(z[None])[0]), stats.norm.ppf, 2, nlive=300, rstate=np.random.default_rng(3))
    sampler.run_nested(print_progress=False)
    theirs = sampler.results
    print(f"{kind}: {ours.evidence:.3f} +- {ours.error:.3f}, dynesty {theirs.logz[-1]:.3f} +- {theirs.logzerr[-1]:.3f}")
    assert abs(ours.evidence - theirs.logz[-1]) < 3 * np.hypot(ours.error, theirs.logzerr[-1])


@pytest.fixture(scope="module")
def loop():
    return closed_loop(compose(wells.JANSEN_2, BitRock(weight=80e3)), StiffPI(reference=6.0))


READ = {
    "torque": metrics.mean("top.torque", 40.0, 60.0),
    "peak": metrics.maximum("top.torque", 30.0, 60.0),
    "stuck": metrics.stuck_ratio("bit", 30.0, 60.0),
}
PRIORS = {"bit.weight": Uniform("50 kN", "110 kN"), "bit.friction.static": Uniform(0.55, 1.1)}


@pytest.fixture(scope="module")
def found(loop):
    told = sweep(loop, [{"bit.weight": 80e3}], 60.0, metrics=READ)
    data = {name: Normal(float(told[name][0]), size) for name, size in zip(READ, (100.0, 200.0, 0.01), strict=True)}
    return posterior(loop, data, PRIORS, 60.0, metrics=READ, draws=64)


def test_a_measurement_narrows_the_numbers_of_a_machine_around_the_truth(found):
    for name, truth, before in (("bit.weight", 80e3, 60e3 / np.sqrt(12)), ("bit.friction.static", 0.8, 0.55 / np.sqrt(12))):
        assert found[name].std() < 0.25 * before and abs(found[name].mean() - truth) < 4 * found[name].std()


def test_draws_of_a_posterior_are_what_a_chance_takes(loop, found):
    chances = chance(loop, {"top.reference": [4.0, 30.0]}, found.drawn, draws=12).chances["as it is"]
    assert chances[0] == 1.0 and chances[1] == 0.0


def test_a_posterior_goes_to_a_file_and_comes_back(found, tmp_path):
    again = Posterior.load(found.save(tmp_path / "posterior.npz"))
    assert str(again) == str(found) and np.array_equal(again.samples, found.samples)


def test_arviz_can_read_the_draws(found):
    pytest.importorskip("xarray")
    data = found.to_xarray()
    assert data["bit.weight"].dims == ("chain", "draw") and data["bit.weight"].shape == (1, 64)


def test_the_picture_has_a_panel_for_each_pair(found):
    axes = found.plot()
    assert axes.shape == (2, 2) and not axes[0, 1].get_visible() and axes[1, 0].get_ylabel() == "bit friction static [1]"


def test_a_measurement_that_no_draw_gives_is_told(loop):
    with pytest.raises(SimulationError, match="No draw of the prior"):
        never = {"last": metrics.last_stay("bit", 8.0)}  # under so little weight nothing sticks after the start
        posterior(loop, {"last": "9 s +- 1 s"}, {"bit.weight": Uniform(10.0, 20.0)}, 10.0, metrics=never, draws=32)


@pytest.mark.parametrize(
    "data, priors, words",
    [
        ({}, PRIORS, "`data` must map at least one name"),
        ({"severity": 1.0}, PRIORS, "`severity` must be a distribution"),
        ({"severity": Uniform(0.0, 1.0)}, PRIORS, "must be normal"),
        ({"severty": "1.0 +- 0.1"}, PRIORS, "severity"),
        ({"severity": "1.0 +- 0.1"}, {"bit.weight": 8e4}, "`bit.weight` must be a distribution"),
    ],
)
def test_what_makes_no_sense_is_refused(loop, data, priors, words):
    with pytest.raises(SceneError, match=words):
        posterior(loop, data, priors, 60.0, draws=32)


def test_windows_of_a_trace_are_data_and_gaps_are_left_out(loop):
    times = np.arange(0.0, 20.0, 0.05)
    run = simulate(loop, 20.0, output_times=times)
    values = run["top.torque"].copy()
    values[100:200] = np.nan  # 5 s to 10 s
    data, read = windowed("top.torque", times, values, 200.0, "1 s")
    assert len(data) == len(read) == 15 and "top.torque from 7 s" not in data
    found = posterior(loop, data, {"bit.weight": Uniform("50 kN", "110 kN")}, 20.0, metrics=read, draws=64)
    assert found["bit.weight"].mean() == pytest.approx(80e3, abs=4 * found["bit.weight"].std() + 200) and found["bit.weight"].std() < 3e3


def test_a_trace_whose_rows_differ_is_refused():
    with pytest.raises(SceneError, match="one number for each of the times"):
        windowed("top.torque", [0.0, 1.0], [1.0], 1.0, 1.0)
    with pytest.raises(SceneError, match="at least one finite sample"):
        windowed("top.torque", [0.0], [np.nan], 1.0, 1.0)


def test_what_was_measured_is_told_with_its_unit():
    assert told("bit.speed", Normal(3.0, 0.5), "rad/s") == "3 +- 0.5 rad/s"
    assert told("bit.speed", Normal("30 rpm", "5 rpm"), "rad/s") == "30 rpm +- 5 rpm" and told("severity", Normal(3.0, 0.5)) == "3 +- 0.5"
