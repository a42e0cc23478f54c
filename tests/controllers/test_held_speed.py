"""The bench that holds the speed of a disc: its poles, and the border at which the pad loses its damping, in closed form."""

from __future__ import annotations

import csv
import math

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from controllers import HeldSpeed, groan_border
from models import BlockOnBelt, BrakeActuator, DiscBrake, Tabulated
from toolbox import SceneError, closed_loop, compose, linearise, severity_map, simulate
from toolbox.onsets import SeverityMap


def test_a_disc_without_brake_has_the_poles_that_were_asked_for():
    loop = closed_loop(compose(DiscBrake(force=0.0)), HeldSpeed(reference=2.0, frequency=0.4, damping=0.6))
    om = 2 * math.pi * 0.4
    poles = np.linalg.eigvals(np.asarray(linearise(loop, at={"disc.speed": 2.0}, mode={"pad": "slip+"}).A))
    asked = om * complex(-0.6, math.sqrt(1 - 0.36))
    assert np.abs(poles - asked).min() < 1e-6 * om
    run = simulate(loop, 20.0)
    assert run.at(20.0)["disc.speed"] == pytest.approx(2.0, abs=1e-6)


BRAKE = DiscBrake(force=0.0)


@pytest.fixture(scope="module")
def groan():
    over = {"disc.reference": (0.5, 5.0), "brake.force": (200.0, 3000.0)}
    return severity_map(closed_loop(compose(BRAKE), HeldSpeed(), inputs={"brake.force": 1000.0}), over, shape=(4, 4))


def test_smooth_running_is_lost_where_the_pad_loses_its_damping(groan):
    """2 N (mu_s - mu_k) decay exp(-decay r w) = c; an inertia 250 times that of the pad hardly moves it."""
    brake, found = BRAKE, groan
    for force in found.axes[1][1:].tolist():
        speed = math.log(2 * force * (brake.friction.static - brake.friction.kinetic) * brake.friction.decay / brake.damping)
        assert found.border("smooth", force)[-1] == pytest.approx(speed / (brake.friction.decay * brake.radius), rel=0.02)


TABLE = Tabulated(speeds=(0.0, 0.05, 0.15, 0.4, 1.0, 3.0), coefficients=(0.45, 0.444, 0.43, 0.405, 0.39, 0.385), static=0.45)
PISTONS, CAR = 2290e-6, 0.3


@pytest.fixture(scope="module")
def pressures():
    """A map of a measured table over the speed of the car and the pressure, spaced by logarithm."""
    bench = closed_loop(compose(DiscBrake(force=0.0, friction=TABLE, wheel_radius=CAR), BrakeActuator(piston_area=PISTONS)), HeldSpeed())
    ranges = {"car.reference": ("0.2 km/h", "6 km/h"), "actuator.pressure": ("1 bar", "26 bar")}
    return severity_map(bench, ranges, shape=(5, 4), halvings=2, logarithmic=["actuator.pressure"])


def test_the_border_of_groan_of_a_measured_table_is_asked_for_as_points_with_their_errors(pressures):
    """Along a row of one speed N = c / (2 s) of the table; along one pressure the speed at which the border steps over it, 3.6 km/h and so on.

    The disc, on which pad and drive act, moves by the ratio of the inertias of pad and disc: 0.004 of a swing, which shifts the border by 4e-6 of itself.
    """
    lost, border = pressures.border_points("smooth"), groan_border(compose(DiscBrake(friction=TABLE)))
    assert len(lost.points) > 4 and lost.line.tolist() == [0] * len(lost.points)
    for (speed, pressure), (off_speed, off_pressure) in zip(lost.points, lost.errors, strict=True):
        if off_speed == 0.0:
            assert pressure * PISTONS == pytest.approx(border.at(speed / CAR), rel=1e-5) and off_pressure < 1e-9 * pressure
        else:
            step = CAR * np.array(border.speeds)
            assert np.abs(step - speed).min() < 1e-9 * speed and off_speed < 1e-9 * speed


def test_errors_of_points_from_runs_are_half_of_what_the_halvings_leave(pressures):
    ends = pressures.border_points("sticking")
    cell = (pressures.axes[0][1] - pressures.axes[0][0], math.log(26.0) / 3)
    for (_, pressure), (off_speed, off_pressure) in zip(ends.points, ends.errors, strict=True):
        if off_pressure == 0.0:
            assert off_speed == pytest.approx(0.5 * 0.25 * cell[0])
        else:
            assert off_speed == 0.0 and off_pressure == pytest.approx(pressure * math.sinh(0.5 * 0.25 * cell[1]))


def test_a_map_answers_in_the_units_typed_and_is_drawn_spaced_by_logarithm(pressures, tmp_path):
    assert pressures.axes[1].tolist() == pytest.approx((1e5 * 26.0 ** (np.arange(4) / 3)).tolist()) and pressures.axes[1][-1] == 26e5
    assert "actuator.pressure from 1 to 26 bar, 4 values, spaced by logarithm" in str(pressures)
    back = SeverityMap.load(pressures.save(tmp_path / "map.npz"))
    assert str(back) == str(pressures) and str(back.border_points("smooth")) == str(pressures.border_points("smooth"))
    with pressures.to_csv(tmp_path / "map.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["actuator.pressure [bar]"] for row in rows} > {"1.0", "26.0"} and {row["car.reference [km/h]"] for row in rows} > {
        "0.2",
        "6.0",
    }
    with pressures.save_borders(tmp_path / "borders.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    points = [pressures.border_points(name) for name in pressures.borders]
    assert [float(row["actuator.pressure [bar]"]) for row in rows] == pytest.approx(
        np.concatenate([each.points[:, 1] for each in points]) / 1e5
    )
    assert [float(row["+- car.reference [km/h]"]) for row in rows] == pytest.approx(
        3.6 * np.concatenate([each.errors[:, 0] for each in points])
    )
    axes = pressures.plot()
    assert [ax.get_yscale() for ax in axes] == ["log"] * 2 and axes[0].get_xscale() == "linear"
    assert axes[0].get_ylabel() == "actuator pressure [bar]" and axes[0].get_xlabel() == "car reference [km/h]"
    axes[0].figure.canvas.draw()
    assert {"2", "5", "10", "20"} <= {tick.get_text() for tick in axes[0].get_yticklabels()}
    plt.close(axes[0].figure)
    (across,) = pressures.border("smooth", float(pressures.axes[1][2]))
    assert across == pytest.approx(1.0)  # 3.6 km/h
    with pytest.raises(SceneError, match="There is no border `hopf`"):
        pressures.border_points("hopf")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["disc.speed"], "Argument `logarithmic` must list names of `ranges`, but it is .'disc.speed'."),
        ("brake.force", "Argument `logarithmic` must list names of `ranges`, but it is 'brake.force'"),
        (["brake.force"], "Argument `brake.force` must be > 0 N to be spaced by its logarithm, but it begins at 0"),
    ],
)
def test_what_cannot_be_spaced_by_its_logarithm_is_refused(given, message):
    bench = closed_loop(compose(BRAKE), HeldSpeed(), inputs={"brake.force": 1000.0})
    with pytest.raises(SceneError, match=message):
        severity_map(bench, {"disc.reference": (0.5, 5.0), "brake.force": (0.0, 3000.0)}, shape=(2, 2), logarithmic=given)


def test_a_map_of_groan_has_its_regions_in_the_colours_of_its_legend_though_the_disc_hardly_swings(groan):
    smooth, sticking = groan.plot()
    legend = {
        patch.get_label().partition(":")[0]: patch.get_facecolor()
        for patch in smooth.figure.legends[0].legend_handles
        if hasattr(patch, "get_height")
    }
    for ax, regions in ((smooth, ["stick-slip"]), (sticking, ["bistable", "stick-slip"])):
        meshes = [each for each in ax.collections if isinstance(each, QuadMesh)]
        assert [mesh.cmap.name for mesh in meshes] == regions
        for mesh in meshes:
            assert mesh.cmap(0.0) == pytest.approx(legend[mesh.cmap.name]) != pytest.approx((1.0, 1.0, 1.0, 1.0))
    plt.close(smooth.figure)


def test_a_plant_without_a_disc_is_told():
    with pytest.raises(SceneError, match="designed on a brake with a disc, or needs its field `inertia`"):
        simulate(closed_loop(compose(BlockOnBelt()), HeldSpeed()), 1.0)
