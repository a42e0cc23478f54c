"""The bench that holds the speed of a disc: its poles, and the border at which the pad loses its damping, in closed form."""

from __future__ import annotations

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from controllers import HeldSpeed
from models import BlockOnBelt, DiscBrake
from toolbox import SceneError, closed_loop, compose, linearise, severity_map, simulate


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
