"""Hopf points of sampled loops, against numbers that were found beside this project by matrix exponentials (`scipy.linalg.expm`) of the linearised string."""

from __future__ import annotations

from pathlib import Path

import pytest

from controllers import SoftTorque
from models import BitRock, wells
from toolbox import Scene, closed_loop, compose, hopf_points

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


@pytest.mark.parametrize(
    ("scene", "label", "value"),
    [
        ("jansen_2", "softer PI, 100 Hz", 3.99009874967), ("drives", "stiff PI", 4.45158734342),
        ("top_drive", "sliding mode, 100 Hz", 3.72714412882),
    ],
    ids=["softer PI", "stiff PI with a delay", "sliding mode"],
)  # fmt: skip
def test_hopf_points_of_shipped_scenes(scene, label, value):
    [point] = hopf_points(Scene.load(SCENES / f"{scene}.toml")[label], "top.reference", (3.0, 5.0), num_values=3)
    assert point.value == pytest.approx(value, abs=1e-9)


LOOP = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97.347 kN")), SoftTorque(reference="95 rpm"), sample_time="10 ms")


@pytest.mark.parametrize(("name", "value"), [("softtorque.sample_time", 0.4814230717), ("softtorque.delay", 0.4744877823)])
def test_smooth_running_is_lost_over_sample_time_and_delay(name, value):
    first = hopf_points(LOOP, name, (0.1, 0.6), num_values=11)[0]
    assert first.value == pytest.approx(value, abs=1e-10) and first.stable == "below"
