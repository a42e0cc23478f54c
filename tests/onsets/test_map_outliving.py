"""A map follows the stick-slip that lives longest, also where another one was found first at the points beside it."""

from pathlib import Path

import numpy as np
import pytest

from controllers import SoftTorque
from toolbox import Sampled, Scene, closed_loop, severity_map, simulate

WELL = Path(__file__).parents[2] / "studies" / "scenes" / "deepening_well.toml"
RPM = np.pi / 30


@pytest.mark.slow
def test_stick_slip_that_a_slow_rise_of_the_set_point_keeps_is_bistable_in_the_map():
    plant = Scene.load(WELL, depth="1 km").plant()
    law = Sampled(SoftTorque(reference=120 * RPM), period=0.01, delay=0.03)
    # a driller's own way, with no map: stick-slip at 53 rpm, and the set-point raised over eight minutes
    reference = (np.array([0.0, 60.0, 540.0, 600.0]), np.array([53.0, 53.0, 160.0, 160.0]) * RPM)
    risen = simulate(plant, "600 s", controller=law, inputs={"top.reference": reference})
    assert risen.time_in("bit", "stick", after=560.0) > 3.0
    # beside it lives a round of three swings, which is found first at 100 rpm and ends at 128 rpm
    found = severity_map(closed_loop(plant, law), {"top.reference": ("40 rpm", "160 rpm"), "bit.weight": ("79 kN", "81 kN")}, shape=(7, 2))
    assert found.regions["bistable"][-1].all()
    assert found.border("sticking", 80e3).size == 0
