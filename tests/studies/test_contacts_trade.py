"""The trade of modes and steps on the smallest face: a slow drive needs no modes, a fast one does, and the error falls with the step."""

import itertools

import numpy as np
import pytest

from studies.benchmarks import contacts as study


@pytest.fixture(scope="module")
def face():
    return study.rows(200e3)


def test_a_slow_drive_needs_no_modes_and_a_fast_one_does(face):
    most = face.body.modes
    assert most > 5
    for drive, step, low, high in ((study.slow, 4e-3, 0.0, 1e-8), (study.struck, 2.5e-7, 1e-2, 0.5)):
        assert low <= study.failures(drive(face, 0, step), drive(face, most, step))[0] < high


def test_the_error_of_the_force_falls_with_the_step_and_the_table_says_so(face):
    lines = list(study.trade(study.struck, face, [(face.body.modes, 2e-6 / 2**k) for k in range(6)]))
    assert all(line.count("|") == study.HEAD.partition("\n")[0].count("|") for line in lines)
    found = [float(line.split("|")[4]) for line in lines[1:-2]]
    for coarse, fine in itertools.pairwise(found):
        assert coarse / fine > 1.5
    assert lines[-1].split("|")[4].strip() == "-"


def test_time_stepping_of_an_elastic_body_in_waves_converges_to_the_run_with_located_events_with_first_order(face):
    """Two engines that share neither formulas nor coordinates."""
    times = np.linspace(0.0, 80e-6, 241)[1:]
    exact = study.located(face, 1e-8)
    assert len([event for event in exact.events if event.before == "stick"]) >= 11
    force = exact.at(times)["plate.drag"]
    wrong = [
        np.abs(study.force(study.struck(face, face.body.modes, step), times) - force).max() / np.abs(force).max()
        for step in (5e-7, 2.5e-7, 1.25e-7)
    ]
    assert wrong[-1] < 0.05
    for coarse, fine in itertools.pairwise(wrong):
        assert coarse / fine == pytest.approx(2.0, rel=0.2)


def test_a_struck_cube_slips_as_a_whole_and_sticks_again(face):
    run = study.struck(face, face.body.modes, 5e-7)
    assert run.share().min() == 0.0
    assert run.share()[[0, -1]] == pytest.approx(1.0)
    audit = run.audit()
    assert abs(audit["missing"]) < 1e-9 * audit["size"]
