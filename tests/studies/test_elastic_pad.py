"""The elastic pad of the study: its onset, its cycle with contacts that part, and what damping and dither do to both."""

import numpy as np
import pytest

from models import SquealingPad
from studies.questions import elastic_pad as study


def test_the_stiff_block_has_the_onset_of_the_closed_form_and_a_softer_one_another():
    exact = SquealingPad(damping=0.0).flutter_friction()
    assert study.stiff_block().flutter_friction(1.2) == pytest.approx(exact, rel=1e-3)
    assert abs(study.stiff_block(1e8).flutter_friction(1.2) / exact - 1) > 5e-3


@pytest.mark.slow
def test_below_its_onset_the_pad_settles_and_above_it_squeals_and_parts():
    onset = study.lining().flutter_friction()
    quiet, loud = (study.swing(study.squeal(study.lining(factor * onset))) for factor in (0.9, 1.25))
    assert quiet["swing"] < 1e-3
    assert quiet["open"] == 0.0
    assert loud["swing"] > 1.0
    assert loud["open"] > 0.2
    assert loud["lowest load"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
def test_damping_of_the_material_shrinks_the_cycle_although_it_lowers_the_onset():
    plain, damped = study.lining(0.5), study.lining(0.5, 8e-6)
    assert damped.flutter_friction() < plain.flutter_friction()
    assert study.swing(study.squeal(damped))["swing"] < 0.5 * study.swing(study.squeal(plain))["swing"]


def test_growth_of_a_run_is_that_of_the_poles():
    pad = study.lining(0.5)
    pole = pad.poles()[0]
    run = study.squeal(pad, 0.01)
    first = min((event.time for event in run.events), default=run.end)
    times = np.linspace(0.4 * first, 0.95 * first, 4001)
    moved = run.at(times)["pad.displacement"][:, 0] - pad.steady_sliding_displacement()[0]
    peaks = np.flatnonzero((moved[1:-1] > moved[:-2]) & (moved[1:-1] > moved[2:])) + 1
    assert len(peaks) > 4
    assert np.polyfit(times[peaks], np.log(moved[peaks]), 1)[0] == pytest.approx(pole.real, rel=0.1)
    assert 2 * np.pi / np.diff(times[peaks]).mean() == pytest.approx(abs(pole.imag), rel=0.01)
