"""Mode coupling: the flutter boundary in closed form against poles and against runs."""

from __future__ import annotations

import csv
import dataclasses
import math

import numpy as np
import pytest

from models import Coulomb, SquealingPad
from toolbox import SceneError, SimulationError, compose, energy_audit, equilibrium, linearise, measure, simulate

PAD = SquealingPad()


def rubbing(mu, pad=PAD):
    return dataclasses.replace(pad, friction=Coulomb(static=mu, kinetic=mu))


def steady(mu, pad=PAD):
    """The plant and its steady sliding."""
    plant = compose(rubbing(mu, pad))
    return plant, equilibrium(plant, mode={"pad": "slip-"})


def test_a_pad_that_is_mirrored_flutters_on_a_disc_that_turns_the_other_way():
    angle = tuple(math.pi - each for each in PAD.angle)
    mirrored = dataclasses.replace(PAD, angle=angle, disc_speed=-PAD.disc_speed)
    assert mirrored.flutter_friction() == pytest.approx(PAD.flutter_friction(), rel=1e-14)
    assert dataclasses.replace(mirrored, disc_speed=PAD.disc_speed).flutter_friction() == math.inf


def test_springs_along_and_across_the_disc_couple_no_modes():
    assert dataclasses.replace(PAD, angle=(0.0, math.pi / 2)).flutter_friction() == math.inf  # cos(pi / 2) is 6e-17


@pytest.mark.parametrize("wrong", [{"stiffness": (-1.0, 2.0)}, {"stiffness": (1.0,)}, {"mass": 0.0}, {"damping": -1.0}])
def test_a_pad_with_a_number_out_of_bounds_has_no_modes(wrong):
    pad = dataclasses.replace(PAD, **wrong)
    for asked in (pad.flutter_friction, lambda: pad.modes((0.3,)), lambda: compose(pad)):
        with pytest.raises(SceneError, match=r"`(pad\.)?(stiffness|angle|mass|damping)`?.* must"):
            asked()


def test_the_default_pad_without_damping_flutters_beyond_three_quarters():
    # k_xx = k_yy = 2, k_xy = 1, k_c = 4/3: s^2 = -2 +- sqrt(1 - 4 mu / 3)
    bare = dataclasses.replace(PAD, damping=0.0)
    assert bare.flutter_friction() == pytest.approx(0.75, rel=1e-14)
    for mu in (0.0, 0.3, 0.7, 0.8, 1.0):
        expected = np.emath.sqrt(-2 + np.array([1, -1]) * np.emath.sqrt(1 - 4 * mu / 3))
        found = linearise(*steady(mu, bare)).poles()
        for pole in (*expected, *-expected):
            assert np.abs(found - pole).min() < 1e-8


@pytest.mark.parametrize(
    "pad",
    [
        PAD,
        dataclasses.replace(PAD, damping=0.4),
        SquealingPad(mass=2.0, stiffness=(30.0, 80.0), angle=(math.radians(140), math.radians(25)), contact_stiffness=40.0, damping=0.3),
        SquealingPad(stiffness=(3.0, 8.0, 2.0), angle=(2.4, 0.4, 1.2), contact_stiffness=5.0),
    ],
)
def test_poles_cross_the_axis_at_the_flutter_boundary(pad):
    border = pad.flutter_friction()
    assert linearise(*steady(0.999 * border, pad)).poles().real.max() < 0 < linearise(*steady(1.001 * border, pad)).poles().real.max()


def test_frequencies_meet_at_the_boundary():
    def apart(mu):
        found = linearise(*steady(mu, dataclasses.replace(PAD, damping=0.0))).poles()
        return np.ptp(found.imag[found.imag > 0])

    # sqrt(2 + d) - sqrt(2 - d), d = sqrt(1 - 4 mu / 3)
    for mu in (0.0, 0.5, 0.74):
        d = math.sqrt(1 - 4 * mu / 3)
        assert apart(mu) == pytest.approx(math.sqrt(2 + d) - math.sqrt(2 - d), rel=1e-6)
    assert apart(0.76) < 1e-6


def test_friction_in_the_other_direction_does_not_flutter():
    back = dataclasses.replace(PAD, disc_speed=-0.5)
    assert back.flutter_friction() == math.inf
    plant = compose(dataclasses.replace(back, friction=Coulomb(static=1.2, kinetic=1.2)))
    assert linearise(plant, equilibrium(plant, mode={"pad": "slip+"})).poles().real.max() < 0
    assert dataclasses.replace(PAD, contact_stiffness=0.0).flutter_friction() == math.inf


@pytest.mark.parametrize(("ratio", "squeals"), [(0.9, False), (1.15, True)])
def test_a_disturbed_pad_squeals_beyond_the_boundary_though_friction_is_constant_and_comes_to_rest_below(ratio, squeals):
    plant, rest = steady(ratio * PAD.flutter_friction())
    start = {"pad.position": rest["pad.position"] + 0.05, "pad.approach": rest["pad.approach"]}
    run = simulate(plant, 600.0, start=start)
    found = measure.extent(run, "pad.position", 550.0)
    assert (run.time_in("pad", "stick", after=550.0) > 1.0) is squeals
    assert (found.maximum - found.minimum > 0.1) is squeals
    assert measure.extent(run, "pad.normal_force").minimum > 0  # within the range of the model


def test_every_joule_of_a_squealing_pad_is_accounted_for():
    run = simulate(compose(PAD), 100.0, accuracy=1e-9)
    assert len(run.events) > 10
    audit = energy_audit(run)
    assert audit.relative < 1e-8
    assert audit.supplies["pad.disc drive"] > audit.losses["pad.friction"] > 0  # what is left feeds the vibration


def test_a_pad_that_would_lift_off_is_refused():
    # hardly pressed and fluttering: the normal force passes zero, which this model cannot say
    with pytest.raises(SimulationError, match=r"must be >= 0.*`ElasticPad` models"):
        simulate(compose(dataclasses.replace(PAD, preload=1.0, disc_speed=2.0)), 300.0, start={"pad.speed": 0.5})


def test_springs_without_angles_are_refused():
    with pytest.raises(SceneError, match=r"pad\.angle"):
        compose(dataclasses.replace(PAD, angle=(1.0,)))


@pytest.mark.parametrize(
    "pad", [PAD, dataclasses.replace(PAD, damping=0.0), dataclasses.replace(PAD, mass=3.0, contact_stiffness=2.0, disc_speed=-1.0)]
)
def test_the_table_of_eigenvalues_has_the_poles_of_steady_sliding(pad):
    frictions = np.linspace(0.0, 1.2, 7)
    found = pad.modes(frictions)
    mode = "slip-" if pad.disc_speed > 0 else "slip+"
    for mu, frequency, growth in zip(frictions, found.frequency, found.growth, strict=True):
        plant = compose(rubbing(mu, pad))
        poles = linearise(plant, equilibrium(plant, mode={"pad": mode})).poles()
        for root in growth + 2j * math.pi * frequency:
            assert np.abs(poles - root).min() < 1e-7


def test_the_table_says_where_the_pad_squeals_and_draws_it():
    border = PAD.flutter_friction()
    found = PAD.modes((0.999 * border, 1.001 * border))
    assert found.squeals.tolist() == [False, True] and found.flutter == border
    assert [line.endswith("squeals") for line in str(found).splitlines()[2:4]] == [False, True]
    upper, lower = PAD.modes(np.linspace(0.0, 1.0, 41)).plot()
    np.testing.assert_array_equal(lower.lines[0].get_xdata(), np.linspace(0.0, 1.0, 41))
    assert [text.get_text() for text in upper.get_legend().get_texts()] == ["mode 1", "mode 2", "squeals"]
    assert "No friction" in str(dataclasses.replace(PAD, disc_speed=-0.5).modes((0.3,)))
    with pytest.raises(SceneError, match="frictions"):
        PAD.modes((-0.1,))


def test_the_table_of_modes_is_written_with_what_is_printed(tmp_path):
    found = PAD.modes((0.2, 0.8))
    with found.to_csv(tmp_path / "squeal.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["friction"]) for row in rows] == [0.2, 0.8]
    assert [[float(row[f"mode {mode} frequency [Hz]"]) for mode in (1, 2)] for row in rows] == found.frequency.tolist()
    assert [[float(row[f"mode {mode} growth [1/s]"]) for mode in (1, 2)] for row in rows] == found.growth.tolist()
    assert [row["squeals"] == "yes" for row in rows] == found.squeals.tolist()
    assert str(type(found).load(found.save(tmp_path / "squeal.npz"))) == str(found)
