"""Measures against closed forms: every number that a table prints is also known on paper."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from models import BitRock, BlockOnBelt, wells
from toolbox import Component, Equations, SceneError, SimulationError, compose, quantity, simulate, state
from toolbox import time as symbol_of_time
from toolbox.measuring import energy
from toolbox.measuring.measure import cycles, energy_audit, extent, overshoot, settling, severity, stick_intervals, stuck_ratio
from toolbox.modelling.inputs import sine, step


@dataclass(frozen=True)
class Oscillator(Component):
    """x'' + 2 zeta w x' + w^2 x = w^2 u, with its energy; `forgotten` leaves a loss out of the books."""

    frequency: float = quantity(2.0, "rad/s", "natural frequency w", above=0)
    damping: float = quantity(0.3, "1", "damping ratio zeta", at_least=0)
    forgotten: bool = False

    def equations(self, signal):
        x, v = state("mass.position", "m"), state("mass.speed", "m/s")
        u = signal("mass.target", "m", default=0.0)
        w, zeta = self.frequency, self.damping
        return Equations(
            flow={x: v, v: w**2 * (u - x) - 2 * zeta * w * v},
            stored=v**2 / 2 + w**2 * x**2 / 2,
            losses={} if self.forgotten else {"damping": 2 * zeta * w * v**2},
            supplies={"target": w**2 * u * v},
        )


@dataclass(frozen=True)
class Blowup(Component):
    """x' = x^2, which reaches infinity at t = 1/x(0)."""

    def equations(self, signal):
        x = state("blow.up", "1")
        return Equations(flow={x: x**2})


@pytest.fixture(scope="module")
def belt_run():
    return simulate(compose(BlockOnBelt()), 60.0, accuracy=1e-9)


@pytest.fixture(scope="module")
def rig_run():
    return simulate(compose(wells.JANSEN_2, BitRock()), 60.0, inputs={"top.torque": 10_000.0})


@pytest.fixture(scope="module")
def step_response():
    return simulate(compose(Oscillator()), 12.0, inputs={"mass.target": 1.0}, accuracy=1e-10)


# ------------------------------------------------------------------------------------------------------------------------------------ stick
def test_a_block_on_a_belt_sticks_until_the_spring_reaches_the_static_bound(belt_run):
    """Carried at the speed of the belt from x0, the block is released at x = F_s / k: (F_s / k - x0) / v_belt later."""
    stays = stick_intervals(belt_run, "belt", after=1.0, until=59.0)
    whole = [(begin, end) for begin, end in stays if begin > 1.0 and end < 59.0]
    assert len(whole) == 4
    for begin, end in whole:
        entry = belt_run.at(begin)["block.position"]
        assert end - begin == pytest.approx((1.0 - entry) / 0.2, rel=1e-10)


def test_stick_intervals_are_cut_to_the_window_and_add_up_to_the_time_in_stick(belt_run):
    begin, end = stick_intervals(belt_run, "belt", after=10.0, until=15.0)[0]
    assert (begin, end) == (10.0, 15.0)
    for window in ((0.0, 60.0), (7.3, 41.2)):
        total = sum(last - first for first, last in stick_intervals(belt_run, "belt", *window))
        assert total == pytest.approx(belt_run.time_in("belt", "stick", *window), rel=1e-14)
        assert stuck_ratio(belt_run, "belt", *window) == pytest.approx(total / (window[1] - window[0]), rel=1e-14)


def test_a_cycle_runs_from_release_to_release_and_a_last_stick_belongs_to_none(belt_run):
    stays = stick_intervals(belt_run, "belt")
    found = cycles(belt_run, "belt")
    releases = [end for _, end in stays if end < 60.0]
    np.testing.assert_array_equal([cycle.start for cycle in found], releases[:-1])
    np.testing.assert_allclose([cycle.period for cycle in found], np.diff(releases), rtol=1e-12)
    assert [cycle.stick for cycle in found] == [end - begin for begin, end in stays[1:] if end < 60.0]
    assert [cycle.slip + cycle.stick for cycle in found] == [cycle.period for cycle in found]
    inside = cycles(belt_run, "belt", after=found[0].start + 0.1, until=releases[-1] + 0.1)
    assert [cycle.start for cycle in inside] == [cycle.start for cycle in found[1:]]
    assert cycles(belt_run, "belt", until=releases[0]) == []
    # a window from a release to a release holds the cycle between them
    assert cycles(belt_run, "belt", after=releases[1], until=releases[2]) == [found[1]]
    assert cycles(belt_run, "belt", after=np.nextafter(releases[1], 60.0), until=releases[2]) == []
    assert cycles(belt_run, "belt", after=releases[1], until=np.nextafter(releases[2], 0.0)) == []


def test_a_bit_that_never_breaks_free_sticks_for_the_whole_run():
    run = simulate(compose(wells.JANSEN_2, BitRock()), 5.0, inputs={"top.torque": 100.0})
    assert stick_intervals(run, "bit") == [(0.0, 5.0)]
    assert stuck_ratio(run, "bit") == 1.0
    assert math.isnan(severity(run, "bit.speed"))


# --------------------------------------------------------------------------------------------------------------------- extrema, mean, severity
def test_extrema_and_mean_of_a_free_oscillation_are_those_of_the_cosine():
    run = simulate(compose(Oscillator(frequency=2.0, damping=0.0)), 9.0, start={"mass.position": 1.0}, accuracy=1e-11)
    found = extent(run, "mass.position", after=0.7, until=8.3)
    assert found.maximum == pytest.approx(1.0, abs=1e-10)
    assert found.minimum == pytest.approx(-1.0, abs=1e-10)
    assert found.mean == pytest.approx((math.sin(16.6) - math.sin(1.4)) / 2 / 7.6, abs=1e-10)
    # a peak is flat: a value to 1e-14 fixes its time to 1e-7
    assert min(abs(found.time_of_maximum - k * math.pi) for k in (1, 2)) < 1e-5
    assert min(abs(found.time_of_minimum - (k + 0.5) * math.pi) for k in (0, 1, 2)) < 1e-5
    assert found.maximum - run["mass.position"][run.time > 0.7].max() > 1e-7  # the nodes alone miss it


def test_extrema_at_the_border_of_the_window_are_taken_there(step_response):
    rise = extent(step_response, "mass.position", until=0.5)
    assert rise.minimum == 0.0 and rise.time_of_minimum == 0.0
    assert rise.maximum == step_response.at(0.5)["mass.position"] and rise.time_of_maximum == 0.5


def test_both_sides_of_a_jump_count_as_values(belt_run):
    """The friction force reaches F_s = 1 just before the block is caught, and jumps to k x there."""
    found = extent(belt_run, "belt.force", after=6.0, until=16.0)
    caught = stick_intervals(belt_run, "belt", after=6.0)[0][0]
    assert found.maximum == pytest.approx(1.0, abs=1e-8) and found.time_of_maximum == caught
    assert found.minimum == pytest.approx(belt_run.at(caught)["block.position"], rel=1e-12)


def test_a_sine_has_the_severity_of_its_amplitude_over_its_mean():
    plant = compose(Oscillator())
    run = simulate(plant, 10.0, inputs={"mass.target": sine(5.0, 2.0, 0.4)}, method="explicit")  # of short steps
    window = {"after": 2.5, "until": 7.5}  # two periods
    assert severity(run, "mass.target", **window) == pytest.approx(0.4, rel=1e-13)
    assert severity(run, "mass.target", definition="range", **window) == pytest.approx(0.8, rel=1e-13)
    assert severity(run, "mass.target", definition="peak", **window) == pytest.approx(0.4, rel=1e-13)
    assert severity(run, "mass.target", definition="reference", reference=-8.0, **window) == pytest.approx(0.25, rel=1e-13)
    mirrored = simulate(plant, 10.0, inputs={"mass.target": sine(-5.0, 2.0, 0.4)}, method="explicit")
    assert severity(mirrored, "mass.target", **window) == pytest.approx(0.4, rel=1e-13)
    assert severity(mirrored, "mass.target", definition="peak", **window) == pytest.approx(0.4, rel=1e-13)


def test_severity_of_a_limit_cycle_agrees_with_dense_sampling_of_a_run_at_1e_12(belt_run, rig_run):
    for run, signal in ((belt_run, "block.position"), (rig_run, "bit.speed"), (rig_run, "top.speed")):
        exact = simulate(run.run.plant, 60.0, inputs=run.run.inputs, accuracy=1e-12)
        t = np.linspace(20.0, 60.0, 400_001)
        y = exact.at(t)[signal]
        reference = (y.max() - y.min()) / (2 * abs(np.trapezoid(y, t) / 40.0))
        assert severity(run, signal, after=20.0) == pytest.approx(reference, rel=5 * max(run.accuracy, 1e-8))


def test_the_nodes_alone_would_give_another_severity(rig_run):
    late = rig_run.time > 20.0
    y = rig_run["bit.speed"][late]
    assert abs((y.max() - y.min()) / (2 * y.mean()) / severity(rig_run, after=20.0) - 1) > 0.02


def test_a_swing_about_zero_is_infinitely_severe_and_a_constant_is_not_severe_at_all():
    run = simulate(compose(Oscillator()), 1.0, inputs={"mass.target": 3.0})
    assert severity(run, "mass.target") == 0.0
    about_zero = simulate(compose(Oscillator()), 4.0, inputs={"mass.target": ([0, 1, 1, 3, 3], [-1.0, -1.0, 1.0, 1.0, -1.0])})
    assert severity(about_zero, "mass.target", until=2.0) == math.inf


# ---------------------------------------------------------------------------------------------------------------------------------- step response
def second_order(t, w=2.0, zeta=0.3):
    """Unit step response of x'' + 2 zeta w x' + w^2 x = w^2."""
    damped = w * math.sqrt(1 - zeta**2)
    return 1 - math.exp(-zeta * w * t) * (math.cos(damped * t) + zeta * w / damped * math.sin(damped * t))


@pytest.mark.parametrize("band", [0.3, 0.1, 0.05, 0.02, 0.002])
def test_a_second_order_lag_settles_when_its_closed_form_last_crosses_the_band(step_response, band):
    t = np.linspace(0.0, 12.0, 120_001)
    excess = np.array([abs(second_order(s) - 1) - band for s in t])
    last = int(np.flatnonzero(excess > 0)[-1])
    expected = brentq(lambda s: abs(second_order(s) - 1) - band, t[last], t[last + 1], xtol=1e-14)
    assert settling(step_response, "mass.position", 1.0, band) == pytest.approx(expected, abs=1e-7 * expected)


def test_overshoot_of_a_second_order_lag_is_exp_of_minus_pi_zeta_over_the_root(step_response):
    expected = math.exp(-math.pi * 0.3 / math.sqrt(1 - 0.3**2))
    assert overshoot(step_response, "mass.position", 1.0) == pytest.approx(expected, rel=1e-9)
    assert overshoot(step_response, "mass.position", 1.0, size=2.0) == pytest.approx(expected / 2, rel=1e-9)
    assert overshoot(step_response, "mass.position", 2.0) == 0.0


def test_a_step_from_one_set_point_down_to_another_overshoots_downwards():
    run = simulate(compose(Oscillator()), 40.0, inputs={"mass.target": step(2.0, 1.0, 20.0)}, accuracy=1e-10)
    expected = math.exp(-math.pi * 0.3 / math.sqrt(1 - 0.3**2))
    assert overshoot(run, "mass.position", 1.0, after=20.0) == pytest.approx(expected, rel=4e-5)  # of the first step e^-12 is left
    first, second = settling(run, "mass.position", 2.0, until=20.0), settling(run, "mass.position", 1.0, 0.02, after=20.0)
    assert first == pytest.approx(second, rel=1e-4)


def test_a_peak_that_leaves_the_band_by_a_hair_between_two_samples_is_seen(step_response):
    height = math.exp(-math.pi * 0.3 / math.sqrt(1 - 0.3**2))
    peak = math.pi / (2.0 * math.sqrt(1 - 0.3**2))
    above = settling(step_response, "mass.position", 1.0, height * (1 - 1e-7))
    below = settling(step_response, "mass.position", 1.0, height * (1 + 1e-7))
    assert peak < above < peak + 1e-3
    assert below < 1.0 < peak  # only the rise is left


def test_a_signal_that_ends_outside_never_settles_and_one_that_stays_inside_settles_at_once(rig_run, step_response):
    assert settling(rig_run, "bit.speed", 8.0) == math.inf
    assert settling(step_response, "mass.position", 1.0, 0.5, after=5.0) == 0.0


# ---------------------------------------------------------------------------------------------------------------------------------------- energy
@pytest.mark.parametrize(
    "inputs",
    [{}, {"block.force": 0.3 * ca.sin(symbol_of_time)}, {"block.force": ([0, 10, 10, 30], [0.0, 0.5, -0.5, 0.2])}],
    ids=["free", "sine", "table"],
)
def test_the_energy_of_a_block_on_a_belt_closes(inputs):
    audit = energy_audit(simulate(compose(BlockOnBelt(damping=0.05)), 60.0, inputs=inputs, accuracy=1e-10))
    assert audit.relative < 1e-11
    assert audit.losses["block.damping"] > 0 and audit.losses["block.friction"] > 0


@pytest.mark.parametrize("well", [wells.JANSEN_2, wells.NAVARRO_LOPEZ_4], ids=["two inertias", "four inertias"])
@pytest.mark.parametrize(
    "inputs",
    [
        {"top.torque": 10_000.0},
        {"top.torque": 10_000 + 500 * ca.sin(3 * symbol_of_time), "bit.weight": sine(90_000.0, 8_000.0, 0.7)},
        {"top.torque": ([0, 10, 10, 30], [9000, 12_000, 8000, 11_000]), "bit.weight": ([0, 5, 50], [5e4, 9e4, 1.1e5])},
    ],
    ids=["constant", "expressions", "tables"],
)
def test_the_energy_of_a_drill_string_closes(well, inputs):
    audit = energy_audit(simulate(compose(well, BitRock()), 60.0, inputs=inputs, accuracy=1e-10))
    assert audit.relative < 1e-11
    assert audit.turnover > 1e5


def test_the_energy_closes_under_a_sampled_controller():
    def law(t, y):
        return 6000.0 + 800.0 * (8.0 - y[0])

    audit = energy_audit(simulate(compose(wells.JANSEN_2, BitRock()), 20.0, controller=law, sample_time=0.05, accuracy=1e-10))
    assert audit.relative < 1e-11


def test_a_damped_mass_loses_what_it_stored():
    run = simulate(compose(Oscillator(damping=1.5)), 60.0, start={"mass.position": 1.0}, accuracy=1e-10)
    audit = energy_audit(run)
    assert audit.stored["mass"][0] == 2.0  # w^2 x^2 / 2
    assert audit.losses["mass.damping"] == pytest.approx(2.0, rel=1e-9)
    assert audit.residual == pytest.approx(0.0, abs=1e-10)


def test_the_audit_finds_a_loss_that_a_part_forgot_to_declare():
    run = simulate(compose(Oscillator(forgotten=True)), 10.0, start={"mass.position": 1.0})
    honest = energy_audit(simulate(compose(Oscillator()), 10.0, start={"mass.position": 1.0}))
    audit = energy_audit(run)
    assert audit.residual == pytest.approx(honest.losses["mass.damping"], rel=1e-6)
    assert audit.relative > 0.5


def test_the_audit_prints_a_table_with_every_term_and_the_residual(rig_run):
    text = str(energy_audit(rig_run))
    for word in ("stored in chain", "supply chain.top torque", "loss chain.top drag", "residual", "60 s [J]"):
        assert word in text


def test_a_plant_at_rest_or_without_energy_has_nothing_to_close():
    still = energy_audit(simulate(compose(Oscillator()), 1.0))
    assert still.turnover == 0.0 and still.relative == 0.0
    nothing = energy_audit(simulate(compose(Blowup()), 1.0))
    assert nothing.stored == {} and nothing.residual == 0.0 and "residual" in str(nothing)


def test_portions_of_steps_add_up_to_the_whole(rig_run, monkeypatch):
    whole, audit = extent(rig_run, "bit.speed"), energy_audit(rig_run)
    monkeypatch.setattr(energy, "CHUNK", 7)
    assert extent(rig_run, "bit.speed").mean == pytest.approx(whole.mean, rel=1e-13)
    assert energy_audit(rig_run).turnover == pytest.approx(audit.turnover, rel=1e-13)


# -------------------------------------------------------------------------------------------------------------------------------------- borders
def test_output_times_do_not_change_a_measure(rig_run):
    coarse = simulate(rig_run.run.plant, 60.0, inputs={"top.torque": 10_000.0}, output_times=[0.0, 30.0, 60.0])
    assert severity(coarse, after=20.0) == severity(rig_run, after=20.0)
    assert energy_audit(coarse).residual == energy_audit(rig_run).residual


def test_a_run_that_failed_is_measured_up_to_its_last_step():
    with pytest.raises(SimulationError) as failure:
        simulate(compose(Blowup()), 2.0, start={"blow.up": 1.0})
    run = failure.value.run
    last = run.time[-1]
    assert 0.9 < last < 1.0 + 1e-6
    assert extent(run, "blow.up", until=0.5).maximum == pytest.approx(2.0, rel=1e-5)  # 1 / (1 - t)
    with pytest.raises(SceneError, match="`until` must be"):
        extent(run, "blow.up", until=1.5)


def test_bad_arguments_are_refused_by_name(rig_run, belt_run):
    refused = [
        (lambda: severity(rig_run, "bit.sped"), r"did you mean `bit\.speed`"),
        (lambda: severity(rig_run, "chain.speed"), r"must be a scalar, but `chain\.speed` has 2 entries"),
        (lambda: severity(rig_run, definition="half"), "There is no definition of severity `half`"),
        (lambda: severity(rig_run, definition="reference"), "Argument `reference` must be a finite set-point other than 0, but it is None"),
        (lambda: severity(rig_run, definition="reference", reference=0.0), "Argument `reference` must be a finite set-point"),
        (lambda: severity(rig_run, reference=8.0), 'must come with definition "reference"'),
        (lambda: severity(rig_run, after=60.0), "Argument `after` must be"),
        (lambda: severity(rig_run, after=math.nan), "Argument `after` must be"),
        (lambda: severity(rig_run, after=-1.0), "Argument `after` must be"),
        (lambda: extent(rig_run, "bit.speed", 20.0, 20.0), "Argument `until` must be"),
        (lambda: extent(rig_run, "bit.speed", 20.0, 61.0), "Argument `until` must be"),
        (lambda: stick_intervals(belt_run, "bellt"), "did you mean `belt`"),
        (lambda: stuck_ratio(belt_run, "belt", after=70.0), "Argument `after` must be"),
        (lambda: settling(rig_run, "bit.speed", 0.0), "Argument `size` must be given"),
        (lambda: settling(rig_run, "bit.speed", math.inf), "Argument `target` must be"),
        (lambda: settling(rig_run, "bit.speed", 8.0, band=0.0), "Argument `band` must be > 0 and < 1"),
        (lambda: overshoot(rig_run, "bit.speed", 8.0, size=-1.0), "Argument `size` must be > 0"),
    ]
    for call, message in refused:
        with pytest.raises(SceneError, match=message):
            call()


def test_settling_around_zero_takes_its_size_from_the_caller():
    run = simulate(compose(Oscillator(damping=2.0)), 30.0, start={"mass.position": 1.0}, accuracy=1e-10)
    # overdamped: the slow pole w (zeta - sqrt(zeta^2 - 1)) decides
    slow, fast = (2.0 * (2.0 - sign * math.sqrt(3.0)) for sign in (1, -1))
    position = lambda t: (fast * math.exp(-slow * t) - slow * math.exp(-fast * t)) / (fast - slow)  # noqa: E731
    expected = brentq(lambda t: position(t) - 0.02, 1.0, 30.0, xtol=1e-14)
    assert settling(run, "mass.position", 0.0, size=1.0) == pytest.approx(expected, rel=1e-8)


# --------------------------------------------------------------------------------------------------------------- as accurate as the run, and its error
@pytest.mark.parametrize("signal", ["bit.speed", "bit.torque", "chain.twist.0"])
@pytest.mark.parametrize("accuracy", [1e-4, 1e-6, 1e-9])
def test_mean_and_extrema_miss_those_of_the_run_by_less_than_a_tenth_of_its_accuracy(accuracy, signal):
    """Gauss-Legendre integrals of order 16 and 200 samples of every step, through `run.at`, are what they are compared with."""
    run = simulate(compose(wells.JANSEN_2, BitRock()), 60.0, inputs={"top.torque": 10_000.0}, accuracy=accuracy)
    found = extent(run, signal, 20.0)
    borders = np.unique(np.concatenate([[20.0], run.time[run.time > 20.0]]))
    points, weights = np.polynomial.legendre.leggauss(8)
    width = np.diff(borders)[:, None]
    mean = (
        float(
            (run.at((borders[:-1, None] + 0.5 * width * (1 + points)).ravel())[signal].reshape(width.size, -1) @ (0.5 * weights))
            @ width[:, 0]
        )
        / 40.0
    )
    dense = run.at((borders[:-1, None] + width * np.linspace(0.0, 1.0, 200, endpoint=False)).ravel())[signal]
    size = np.abs(dense).max()
    assert abs(found.mean - mean) < 0.1 * accuracy * size
    for value, best, sign in ((found.maximum, dense.max(), 1.0), (found.minimum, dense.min(), -1.0)):
        assert sign * (value - best) > -1e-13 * size  # no sample lies beyond
        assert sign * (value - best) < 1e-4 * size
    for value, when in ((found.maximum, found.time_of_maximum), (found.minimum, found.time_of_minimum)):
        sides = np.append(run.at(when)[signal], run[signal][run.time == when])
        assert np.abs(sides - value).min() <= 1e-15 * size  # they are values of the run


@dataclass(frozen=True)
class Falling(Component):
    """x' = -1, with sqrt(max(x, 0)) as a signal, whose slope is infinite where x = 0."""

    def equations(self, signal):
        x = state("water.height", "m")
        return Equations(flow={x: ca.SX(-1.0)}, outputs={"water.outflow": (ca.sqrt(ca.fmax(x, 0.0)), "m/s")})


def test_a_signal_whose_slope_is_infinite_has_the_mean_of_its_closed_form():
    run = simulate(compose(Falling()), 3.0, start={"water.height": 1.0})
    found = extent(run, "water.outflow")
    assert found.mean == pytest.approx(2.0 / 9.0, rel=1e-3)
    assert (found.minimum, found.maximum) == (0.0, 1.0)


@dataclass(frozen=True)
class Neighbours(Component):
    """A swinging mass, and a beam that it pushes with forces that cancel, but for their round-off."""

    left: float = quantity(0.1, "1/s^2", "push from the left")
    right: float = quantity(0.2, "1/s^2", "push from the right")
    back: float = quantity(0.3, "1/s^2", "push back")

    def equations(self, signal):
        x, v = state("mass.position", "m"), state("mass.speed", "m/s")
        z, w = state("beam.position", "m"), state("beam.speed", "m/s")
        return Equations(flow={x: v, v: -4.0 * x, z: w, w: self.left * x + self.right * x - self.back * x})


@pytest.mark.parametrize("method", ["explicit", "taylor"])
@pytest.mark.parametrize("accuracy", [1e-5, 1e-6, 1e-9])
def test_a_state_that_is_zero_but_for_round_off_does_not_spoil_the_error(accuracy, method):
    run = simulate(compose(Neighbours()), 30.0, start={"mass.position": 1.0}, accuracy=accuracy, method=method)
    assert 0.0 < np.abs(run["beam.position"]).max() < 1e-12
    truth = np.abs(run["mass.position"] - np.cos(2.0 * run.time)).max()
    assert run.error_estimate < max(10.0 * truth, 1e-11) and run.error_estimate < accuracy


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e-9])
def test_an_honest_small_state_keeps_its_own_scale(size):
    """A beam at rest a metre away does not hide the error of a mass that swings by a nanometre."""
    start = {"mass.position": size, "beam.position": 1.0}
    plant = compose(Neighbours(left=0.0, right=0.0, back=0.0))
    run = simulate(plant, 30.0, start=start, accuracy=1e-4)
    truth = np.abs(run["mass.position"] / size - np.cos(2.0 * run.time)).max()
    assert truth > 1e-8
    assert run.error_estimate == pytest.approx(truth, rel=0.7)
