"""The simulation that confirms the drive table: it is right by itself, and the table stands in it."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from controllers import PI, StiffPI
from studies.protocol import DELAY, GROUPS, LIMITS, PLANT, trial
from studies.questions import confirmation as study
from studies.questions import drives
from toolbox import Sampled, simulate
from toolbox.drilling.groups import Machine, Varying
from toolbox.drilling.set_points import SETTLING
from toolbox.modelling import Takeover

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="the C of a law is compiled with `cc`, which is not here")
QUIET = np.zeros(80_000)
DITHERED = "impedance and dither of the weight, tuned"
REPEATED = ("impedance, tuned, lifting", "Z-torque, tuned, lifting", "LQG, between, lifting", "LQG, tuned", DITHERED)


def of(reference):
    return PI(reference=reference, proportional=4000.0, integral=1500.0, **LIMITS)


@pytest.mark.parametrize(("reference", "stuck"), [(13.0, False), (3.0, True)])
def test_numbers_of_a_run_are_those_of_the_event_loop_and_do_not_depend_on_the_step(tmp_path, reference, stuck):
    made = study.machine(trial("PI", of(8.0)), reference, tmp_path)
    found = made.numbers(Machine("nominal"), "takeover", 0.0, QUIET)
    finer = made.numbers(Machine("nominal"), "takeover", 0.0, QUIET, step=5e-4)
    begin = study.BEGUN + 2.0 * made.law.cycle(reference).period + 1.0 + SETTLING
    both = Takeover(StiffPI(reference=reference, **LIMITS), of(reference), at=study.BEGUN)
    run = simulate(PLANT, begin + 80.0, controller=Sampled(both, 0.01, delay=DELAY))
    assert (found["stuck"] > 0.0) == stuck
    assert found["stuck"] == pytest.approx(run.time_in("bit", "stick", after=begin), abs=0.05)
    speed = run.at(np.arange(begin, run.end, 0.01))["bit.speed"].mean()
    assert found["speed"] == pytest.approx(speed, rel=2e-3)
    for name, value in finer.items():
        assert found[name] == pytest.approx(value, rel=2e-3, abs=1e-9)


def test_a_machine_below_its_set_point_fails_and_says_which_run(tmp_path):
    made = study.machine(trial("PI", of(8.0)), 3.0, tmp_path)
    assert "stuck" in next(why for why, _ in study.runs(made, GROUPS["nominal"], "takeover") if why)


def test_the_gaussian_rock_is_that_of_the_event_loop(tmp_path):
    gaussian = next(rig for rig in GROUPS["other_rocks"].machines if rig.plant is not None)
    made = study.machine(trial("PI", of(8.0)), 3.0, tmp_path)
    found = made.numbers(gaussian, "takeover", 0.0, QUIET)
    begin = study.BEGUN + 2.0 * made.law.cycle(3.0).period + 1.0 + SETTLING
    both = Takeover(StiffPI(reference=3.0, **LIMITS), of(3.0), at=study.BEGUN)
    run = simulate(gaussian.plant, begin + 80.0, controller=Sampled(both, 0.01, delay=DELAY))
    stuck = run.time_in("bit", "stick", after=begin)
    assert stuck > 1.0 and found["stuck"] == pytest.approx(stuck, abs=0.05)
    assert abs(found["stuck"] - made.numbers(Machine("nominal"), "takeover", 0.0, QUIET)["stuck"]) > 0.5


def test_a_weight_that_varies_has_its_mean_its_size_and_its_corner_and_another_seed_another_course():
    noise, other = (study.varied(Varying(0.05, 0.2, noise=True), 120_000, 0.01, [seed]) for seed in (1, 2))
    assert noise.mean() == pytest.approx(1.0, abs=0.005) and noise.std() == pytest.approx(0.05, rel=0.1)
    power = np.abs(np.fft.rfft(noise - 1.0)) ** 2
    below = np.fft.rfftfreq(noise.size, 0.01) < 0.2
    assert power[below].sum() / power.sum() == pytest.approx(0.25 * np.pi / np.arctan(5.0), abs=0.1)
    assert np.abs(noise - other).max() > 0.05
    sine = study.varied(Varying(0.1, 0.1), 3000, 0.01, [1])
    assert sine.min() == pytest.approx(0.9, abs=1e-5) and sine.max() == pytest.approx(1.1, abs=1e-5)
    assert (study.varied(None, 5, 0.01, [1]) == 1.0).all()


def test_a_weight_that_a_law_moves_calms_the_bit_where_the_hoist_follows_and_not_where_it_is_too_slow(tmp_path):
    made = study.machine(drives.laws()[DITHERED], 2.4, tmp_path)
    free = made.numbers(Machine("nominal"), "takeover", 0.0, QUIET)
    assert free["stuck"] == 0.0 and free["swing"] < 0.001 < 0.2 < free["rate"]
    slow = made.numbers(Machine("nominal"), "takeover", 0.0, QUIET, hoist=(0.0, 0.01))
    assert slow["rate"] == pytest.approx(0.01) and slow["stuck"] > 0.0
    late = made.numbers(Machine("nominal"), "takeover", 0.0, QUIET, hoist=(3.0, np.inf))
    assert late["stuck"] > 0.0


def test_the_cells_that_are_confirmed_are_those_of_the_table_that_hold_a_set_point():
    cells = study.confirmed()
    assert cells[DITHERED]["nominal", "takeover"] < cells["soft torque"]["nominal", "takeover"]
    assert not {"linear MPC", "nonlinear MPC", "LQG, between, lifting, margin 0.05"} & cells.keys()
    assert ("one_at_a_time", "takeover") not in cells["sliding mode"] and all(
        speed > 0.0 for each in cells.values() for speed in each.values()
    )


@pytest.mark.slow
@pytest.mark.parametrize("label", REPEATED)
def test_the_table_stands(label):
    for group in ("nominal", "one_at_a_time"):
        found = study.row(label, group, "ramp")
        speed = study.confirmed()[label][group, "ramp"]
        assert speed <= found.border <= speed + 0.1001
        assert len(found.failed) <= 0.02 * GROUPS[group].runs
        assert found.below <= 0.2 and found.why
