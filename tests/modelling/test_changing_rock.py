"""Parameters that change during a run: the rock gets harder, its friction falls, on the way."""

import numpy as np
import pytest

from controllers import StiffPI
from models import BitRock, BlockOnBelt, wells
from models.friction import Coulomb
from toolbox import Scene, SceneError, compose, energy_audit, simulate
from toolbox.inputs import sine, step

WEIGHT = 97_347.0
RIG = compose(wells.JANSEN_2, BitRock(weight=WEIGHT))
HARDER = {"bit.friction.static": step(0.8, 0.96, 30.0), "bit.friction.kinetic": step(0.5, 0.6, 30.0)}


@pytest.mark.parametrize("drive", [{"inputs": {"top.torque": 12_000.0}}, {"controller": StiffPI(reference=14.0), "sample_time": 0.01}])
def test_rock_with_a_fifth_more_friction_is_as_hard_as_a_fifth_more_weight(drive):
    """The torque of the rock is W R mu(w): it cannot tell W from mu."""
    inputs = drive.get("inputs", {})
    rock = simulate(RIG, 60.0, **(drive | {"inputs": {**inputs, **HARDER}}), accuracy=1e-9)
    weight = simulate(RIG, 60.0, **(drive | {"inputs": {**inputs, "bit.weight": step(WEIGHT, 1.2 * WEIGHT, 30.0)}}), accuracy=1e-9)
    same = simulate(RIG, 60.0, **drive, accuracy=1e-9)
    assert [(e.element, e.after) for e in rock.events] == [(e.element, e.after) for e in weight.events]
    assert rock.at(60.0)["bit.speed"] == pytest.approx(weight.at(60.0)["bit.speed"], abs=1e-7)
    assert abs(rock.at(60.0)["bit.speed"] - same.at(60.0)["bit.speed"]) > 1e-3  # without the change of rock it ends elsewhere


def test_a_block_breaks_away_when_its_static_friction_has_fallen_to_its_load():
    """Belt at rest, load 0.5 N, static bound 1 - t / 10: it lets go at t = 5 s and swings by 2 (0.5 - 0.1) / k within half a period."""
    plant = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=1.0, kinetic=0.1)))
    run = simulate(plant, 9.0, inputs={"block.force": 0.5, "belt.friction.static": ([0.0, 5.5], [1.0, 0.45])}, accuracy=1e-10)
    assert [event.time for event in run.events] == pytest.approx([5.0, 5.0 + np.pi], abs=1e-9)
    assert run.at(9.0)["block.position"] == pytest.approx(0.8, abs=1e-9)
    assert energy_audit(run).residual < 1e-9
    stays = simulate(plant, 9.0, inputs={"block.force": 0.5})
    assert not stays.events  # with constant friction it never moves


def test_a_parameter_may_vary_as_a_formula_and_is_shown_in_the_result():
    run = simulate(RIG, 10.0, inputs={"top.torque": 9000.0, "bit.friction.kinetic": sine(0.5, 0.1, 0.2)}, accuracy=1e-8)
    assert run["bit.friction.kinetic"] == pytest.approx(0.5 + 0.1 * np.sin(2 * np.pi * 0.2 * run.time))
    assert run.error_estimate < 1e-7


def test_what_cannot_change_in_time_is_refused_by_name():
    with pytest.raises(SceneError, match="`chain.stiffness.0` must not vary in time: the energy stored in `chain`"):
        simulate(RIG, 1.0, inputs={"chain.stiffness.0": step(473.0, 500.0, 0.5)})
    with pytest.raises(SceneError, match="`chain.inertia` must be one number to vary in time"):
        simulate(RIG, 1.0, inputs={"chain.inertia": step(473.0, 500.0, 0.5)})
    with pytest.raises(SceneError, match="`bit.friction.kinetic` must be >= 0"):
        simulate(RIG, 1.0, inputs={"bit.friction.kinetic": step(0.5, -0.5, 0.5)})
    with pytest.raises(SceneError, match="static"):
        simulate(RIG, 1.0, inputs={"bit.friction.static": step(0.8, 0.4, 0.5)})
    with pytest.raises(SceneError, match="both"):
        simulate(RIG, 1.0, inputs={"bit.friction.static": 0.9}, parameters={"bit.friction.static": 0.8})
    assert not RIG.inputs.keys() & {"bit.friction.static"}  # the plant itself is as it was


def test_rock_that_changes_is_data_in_a_scene(tmp_path):
    text = """
        title = "a harder stringer"
        duration = 40
        [[plant]]
        part = "wells.JANSEN_2"
        [[plant]]
        part = "BitRock"
        weight = "97.347 kN"
        [[controllers]]
        label = "constant torque"
        inputs = { "top.torque" = "9 kN m" }
        [inputs]
        "bit.friction.static" = { step = { before = 0.8, after = 0.96, at = "30 s" } }
        """
    (tmp_path / "scene.toml").write_text(text)
    scene = Scene.load(tmp_path / "scene.toml")
    run = scene.run("constant torque")
    assert (run.at(20.0)["bit.friction.static"], run.at(35.0)["bit.friction.static"]) == (0.8, 0.96)
    scene.save(tmp_path / "again.toml")
    assert Scene.load(tmp_path / "again.toml").inputs == scene.inputs
