"""The shipped scenes of oscillators and brakes say what their comments say; every calm one has a twin that is not."""

from __future__ import annotations

import dataclasses
import math

import pytest

from models import BlockOnBelt, Dahl, GuideContact, LuGre
from toolbox import Scene, compose, measure
from toolbox.onsets.verdicts import verdict_row
from toolbox.scenes.verdict_table import table


def scene(root, name):
    return Scene.load(root / "studies" / "scenes" / f"{name}.toml")


def stuck(found, label="no controller"):
    """Seconds in stick in the window of the verdict, and the range of the judged signal."""
    run = found.run(label)
    extent = measure.extent(run, found.signal, found.after)
    return run.time_in(found.element, "stick", after=found.after), extent.maximum - extent.minimum


@pytest.mark.parametrize(
    "name", ["thomsen_fidlin", "veraszto_stepan", "two_blocks", "den_hartog", "alternating_load", "lugre_guide", "brake_stop", "squeal"]
)
def test_a_scene_of_stick_slip_shows_it(root, name):
    found = scene(root, name)
    seconds, _ = stuck(found)
    assert 0.02 * (found.duration - found.after) < seconds < 0.98 * (found.duration - found.after)


def test_veraszto_and_stepans_block_rests_in_the_same_scene_started_at_rest(root):
    found = dataclasses.replace(scene(root, "veraszto_stepan"), start={})
    assert stuck(found)[0] == 0.0


def test_the_absorber_of_the_scene_ends_what_its_twin_without_spring_shows(root):
    found = scene(root, "absorber")
    assert stuck(found)[0] == 0.0
    twin = dataclasses.replace(found, parameters={"absorber.stiffness": 0.0, "absorber.damping": 0.0})
    assert stuck(twin)[0] > 10.0


def test_the_cures_of_popp_and_rudolph_stand_beside_the_block_without(root):
    found = scene(root, "popp_rudolph")
    seconds, swing = stuck(found, "no cure")
    assert seconds > 50.0
    excited, shaken = stuck(found, "external excitation, 3 Hz")
    assert excited == 0.0 and shaken < 0.05 * swing
    assert stuck(found, "fluctuating load, 3 x natural")[1] < 0.35 * swing
    assert stuck(found, "the same at half the natural")[1] > 1.5 * swing
    assert stuck(scene(root, "block_on_belt"))[0] > 30.0
    assert stuck(scene(root, "popp_rudolph_damping"))[0] == 0.0


def test_the_friction_damper_of_the_scene_is_best_in_between(root):
    found = dataclasses.replace(scene(root, "friction_damper"), signal="block.position")
    free, best, held = (stuck(found, label)[1] for label in ("hardly pressed", "best load", "never slides"))
    assert best < 0.3 * min(free, held)


def test_creep_groan_ends_where_the_brake_is_released_and_shrinks_under_an_alternating_force(root):
    found = scene(root, "creep_groan")
    groan, swing = stuck(found, "constant force")
    assert groan > 0.1
    shaken, less = stuck(found, "alternating force, 150 Hz")
    assert shaken < 0.5 * groan and less < 0.5 * swing
    assert stuck(found, "released")[0] == 0.0


def test_the_guide_of_the_scene_is_the_bristle_of_forces_that_it_was(root):
    # s0 = 100 N/m, s1 = 10 N s/m under 0.2 N: 500 1/m and 50 s/m per unit of load
    guide = scene(root, "lugre_guide").parts[1]
    assert (guide.load, guide.friction) == (0.2, LuGre(500.0, 50.0))


def test_a_scene_without_modes_is_judged_by_the_severity_of_its_contact(tmp_path):
    path = tmp_path / "bit.toml"
    path.write_text(
        'title = "bit on bristles"\nduration = "40 s"\ninputs = {"top.torque" = "9 kN m"}\n[[plant]]\npart = "wells.JANSEN_2"\n'
        '[[plant]]\npart = "BitRock"\nfriction = {law = "LuGre", stiffness = "200 1/rad", damping = "0.2 s/rad", steady = {law = "Exponential"}}\n'
    )
    found = Scene.load(path)
    assert (found.element, found.signal) == (None, "bit.speed")
    row, run = verdict_row(found, found.labels[0])
    assert row.verdict == "no modes" and math.isnan(row.stuck)
    assert row.severity == measure.severity(run, "bit.speed", 20.0) > 0.5
    assert "no modes" in table(found, [row])
    again = Scene.of(found.plant(), 40.0, inputs=found.inputs)
    assert (again.element, again.signal) == (None, "bit.speed")
    both = Scene.of(compose(BlockOnBelt(), GuideContact(friction=Dahl())), 10.0)
    assert (both.element, both.signal) == ("belt", "belt.slip")
    assert Scene.of(compose(BlockOnBelt(), GuideContact(friction=Dahl())), 10.0, element="guide").signal == "guide.slip"
