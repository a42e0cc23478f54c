"""The shipped scenes of mechanisms: each runs, keeps its energy, and does what its title says."""

from __future__ import annotations

import numpy as np
import pytest

from toolbox import Scene, measure

STICKS = {
    "backlash": None,
    "crank_slider": {"rocked": True, "driven": False},  # a torque to and fro does not turn it over; a steady one does
    "gear_stage": {"rocked": False},
    "scotch_yoke": None,
    "shoe_brake": {"rocked": True},
    "valve_spool": {"driven": True, "dithered": False},  # dither keeps the seal from sticking
}


@pytest.mark.parametrize("name", ["backlash", "crank_slider", "gear_stage", "scotch_yoke", "shoe_brake", "valve_spool"])
def test_a_scene_of_a_mechanism_keeps_its_energy_and_sticks_where_it_should(root, name):
    scene = Scene.load(root / "studies" / "scenes" / f"{name}.toml")
    for label in scene.labels:
        run = scene.run(label)
        assert measure.energy_audit(run).relative < 1e-5, label
        stuck = run.time_in(scene.judged_contact, "stick", after=scene.after)
        assert np.isfinite(run.states).all()
        if STICKS[name] is not None:
            assert (stuck > 0.05) == STICKS[name][label], (label, stuck)
