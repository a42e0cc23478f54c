"""The elastic sliders of two studies: rows that end with the rigid slider, nodes that repeat an independent model, an incline at its angle."""

import math

import numpy as np
import pytest

from studies.questions import elastic_sliders as study


@pytest.fixture(scope="module")
def coarse():
    return study.face_run(study.face_problem(5), 2e-3)


def test_the_last_row_lets_go_with_the_rigid_slider_and_the_first_long_before():
    slips = study.first_slips(study.row_run())
    assert len(slips) == 11
    assert slips.max() == pytest.approx(study.Pull().rigid_time(), rel=1e-3)
    assert slips.min() < 0.5 * slips.max()


@pytest.mark.slow
def test_nodes_with_cone_and_opening_repeat_the_shared_area_of_an_independent_model():
    run = study.face_run(study.face_problem(10), 1e-3)
    found = study.measures(run)
    assert found["share at 0.16 s"] == pytest.approx(0.57, abs=0.05)
    assert found["share at 0.20 s"] == pytest.approx(0.26, abs=0.05)
    assert found["no node sticks from [s]"] == pytest.approx(0.2175, abs=0.005)
    assert 0.2275 <= found["full friction from [s]"] <= 0.230
    assert found["largest pressure at rest [MPa]"] == pytest.approx(0.173, abs=0.001)
    assert found["largest share open"] > 0
    audit = run.audit()
    assert abs(audit["missing"]) < 1e-9 * audit["size"]
    assert audit["stepping"] < 2e-3 * audit["size"]


def test_a_coarse_face_lets_go_before_the_rigid_slider_and_carries_its_load_then(coarse):
    rigid = study.Pull().rigid_time()
    assert coarse.last("stick") < rigid
    assert study.full_friction(coarse) == pytest.approx(rigid, abs=0.004)
    assert coarse.normal.sum(axis=1) == pytest.approx(np.full(len(coarse.time), 10.0), rel=1e-6)
    share = coarse.share()
    assert share[coarse.time > 0.03].max() > 0.7
    assert share[-1] == 0.0


def test_slip_grows_from_the_edges_of_the_face(coarse):
    first = np.array([coarse.time[np.flatnonzero(coarse.contact_modes[5:, i] != 0)[0] + 5] for i in range(36)])
    x, y = coarse.problem.contact_positions[:, 0], coarse.problem.contact_positions[:, 1]
    middle = (np.abs(x - 0.005) < 0.002) & (np.abs(y - 0.005) < 0.002)
    assert first[x < 1e-9].max() < first[middle].min()


def test_an_incline_lets_the_cube_go_at_the_angle_of_friction():
    run = study.incline_run(3)
    assert math.radians(22.0) * study.full_friction(run) == pytest.approx(math.atan(study.MU), abs=math.radians(0.1))
    assert run.last("stick") < study.full_friction(run)


@pytest.mark.slow
def test_trends_are_those_of_the_rigid_slider():
    found = {(name, factor): last for name, factor, last, _ in study.trends(2)}
    for name, way in (("load", 1), ("friction", 1), ("damping", -1), ("acceleration", -1)):
        times = [found[name, factor] for factor in (0.5, 1.0, 2.0)]
        assert (np.diff(times) * way > 0).all()


def test_what_is_no_target_is_said_with_its_arithmetic():
    text = " ".join(study.contradictions())
    for number in ("0.0632", "2.47", "0.0945", "148 kHz"):
        assert number in text
