"""Which contact a verdict looks at: the one that is named, the only one there is, and never one of several by chance."""

from __future__ import annotations

import dataclasses

import pytest

from controllers import StiffPI
from models import BitRock, Exponential, wells
from toolbox import Sampled, Scene, SceneError, closed_loop, compose, onset, severity_map, simulate, sweep, worst_case
from toolbox.robustness import cycle_phases
from toolbox.robustness.checks import Checks

LAW = Sampled(StiffPI(reference=4.0), 0.01)
WEIGHTS = {"bit.weight": (60e3, 90e3)}


@pytest.fixture(scope="module")
def rig():
    """A string that rubs in the hole, lightly: it turns on where the bit sticks."""
    return compose(
        dataclasses.replace(wells.NAVARRO_LOPEZ_4, friction=Exponential(), friction_load=(100.0, 100.0, 100.0)), BitRock(weight=97_347.0)
    )


@pytest.fixture(scope="module")
def run(rig):
    return simulate(rig, 100.0, controller=LAW)


VERDICTS = {
    "onset": lambda rig, run: onset(closed_loop(rig, LAW), "top.reference", (3.0, 14.0)),
    "severity map": lambda rig, run: severity_map(closed_loop(rig, LAW), {"top.reference": (3.0, 14.0), **WEIGHTS}),
    "worst case": lambda rig, run: worst_case(closed_loop(rig, LAW), 60.0),
    "sweep": lambda rig, run: sweep(closed_loop(rig, LAW), {"bit.weight": [60e3]}, 10.0),
    "scene": lambda rig, run: Scene.of(rig, 60.0, {"stiff PI": LAW}),
    "phases": lambda rig, run: cycle_phases(run, 2),
    "check": lambda rig, run: Checks("unused").no_stick_slip(run, 50.0),
}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_a_verdict_asks_which_of_several_contacts_it_is_about(rig, run, verdict):
    with pytest.raises(
        SceneError,
        match=r"Argument `(element|element` of `closed_loop|metrics)` must name the contact to be judged, because there are contacts `.*bit`",
    ):
        VERDICTS[verdict](rig, run)


def test_it_is_about_the_contact_that_is_named(rig):
    hole = next(element.name for element in rig.elements if element.name != "bit")
    phases = cycle_phases(simulate(closed_loop(rig, LAW, element="bit"), 100.0), 2)
    judged = {name: worst_case(closed_loop(rig, LAW, element=name), 60.0, starts=phases) for name in ("bit", hole)}
    assert not judged["bit"].survives and judged["bit"].worst.stuck > 0.2
    assert judged[hole].worst.stuck == 0.0
