"""The elastic pad: equal to the minimal model of squeal where it is a rigid mass, and that model's limit where it is stiff."""

import math
from dataclasses import replace

import numpy as np
import pytest

from models import Coulomb, ElasticBody, ElasticPad, SquealingPad, block_mesh, body_of_mesh
from tests.refusals import refusals
from toolbox import Scene, compose, energy_audit, linearise, simulate

MINIMAL = SquealingPad()


def springs(pad=MINIMAL):
    """k_xx, k_xy, k_yy of the inclined springs of the minimal model, without its contact."""
    k, a = np.array(pad.stiffness), np.array(pad.angle)
    return (k * np.cos(a) ** 2).sum(), (k * np.sin(a) * np.cos(a)).sum(), (k * np.sin(a) ** 2).sum()


def point_pad(damping=MINIMAL.damping, preload=MINIMAL.preload, friction=0.9, **options):
    """The minimal model as a body of one node. Its rest is that of the minimal model: there the springs carry the preload."""
    k_xx, k_xy, k_yy = springs()
    body = ElasticBody(np.eye(2), [[k_xx, k_xy], [k_xy, k_yy]], damping * np.eye(2), dof_map=[[0, 1]])
    reduced = body.reduced({"along.0": body.point(0, "x"), "into.0": body.point(0, "y")})
    kc = MINIMAL.contact_stiffness
    rest = np.linalg.solve([[k_xx, k_xy], [k_xy, k_yy]], [0.0, -preload])  # pressed, without friction
    return ElasticPad(
        reduced,
        (preload / kc - rest[1],),
        contact_stiffness=kc,
        disc_speed=MINIMAL.disc_speed,
        friction=Coulomb(friction, friction),
        **options,
    )


@pytest.mark.parametrize("damping", [0.0, 0.05, 0.15])
def test_a_rigid_mass_on_two_springs_flutters_where_the_closed_form_says(damping):
    exact = SquealingPad(damping=damping).flutter_friction()
    assert point_pad(damping).flutter_friction() == pytest.approx(exact, rel=1e-4)


def test_its_poles_are_those_of_the_linearised_plant():
    pad = point_pad(friction=0.9)
    plant = compose(pad)
    start = {"pad.displacement": pad.steady_sliding_displacement()}
    modes = {"touch.0": "closed", "pad.0": "slip-"}
    system = linearise(plant, at=start | {"pad.rate": np.zeros(2)}, mode=modes)
    np.testing.assert_allclose(np.sort_complex(system.poles()), np.sort_complex(pad.poles()), atol=1e-6)


def test_while_it_does_not_part_it_moves_as_the_minimal_model():
    """The minimal model counts from the pressed state without friction, this one from the unloaded pad."""
    pad = point_pad()
    rest = pad.steady_sliding_displacement(friction=0.0)
    assert MINIMAL.contact_stiffness * (rest[1] + pad.initial_approach[0]) == pytest.approx(MINIMAL.preload)
    minimal = simulate(compose(MINIMAL), 7.0, start={"pad.position": 0.1}, accuracy=1e-9)
    run = simulate(compose(pad), 7.0, start={"pad.displacement": rest + np.array([0.1, 0.0])}, accuracy=1e-9)
    times = np.linspace(0, 7, 201)
    np.testing.assert_allclose(run.at(times)["pad.displacement"][:, 0] - rest[0], minimal.at(times)["pad.position"], atol=1e-6)
    np.testing.assert_allclose(run.at(times)["pad.normal_force"], minimal.at(times)["pad.normal_force"], atol=1e-6)


def test_its_energy_is_accounted_for_while_it_parts():
    pad = point_pad(damping=0.02, preload=2.0)
    run = simulate(compose(pad), 120.0, start={"pad.displacement": pad.steady_sliding_displacement() + np.array([0.3, 0.0])}, accuracy=1e-9)
    assert any(event.element == "touch.0" for event in run.events)
    audit = energy_audit(run)
    assert abs(audit.residual) < 1e-5 * audit.turnover


def test_a_stiff_block_on_inclined_springs_flutters_where_the_rigid_one_does_and_a_soft_one_elsewhere():
    """Two-mode limit: rotation is held by springs far stiffer than those of the two translations."""
    k_xx, k_xy, k_yy = springs()
    scale = 1e6
    exact = SquealingPad(damping=0.0).flutter_friction()
    onsets = []
    for modulus in (1e13, 1e11, 1e9, 3e7):
        body = body_of_mesh(block_mesh((0.05, 0.02), (2, 1)), density=1000.0, modulus=modulus)
        face = body.face_nodes("bottom")
        ports = {f"along.{i}": body.point(node, "x") for i, node in enumerate(face)} | {
            f"into.{i}": -body.point(node, "y") for i, node in enumerate(face)
        }
        turned = body.mean("left", "y") - body.mean("right", "y")
        reduced = body.reduced(ports | {"x": body.mean("top", "x"), "y": -body.mean("top", "y"), "turn": turned}, 0.0)
        x, y, turn = (np.eye(reduced.size)[reduced.index(port)] for port in ("x", "y", "turn"))
        stiffness = reduced.stiffness + scale * (k_xx * np.outer(x, x) + k_xy * (np.outer(x, y) + np.outer(y, x)) + k_yy * np.outer(y, y))
        stiffness += 1e4 * scale * np.outer(turn, turn)
        mounted = replace(reduced, stiffness=stiffness)
        pad = ElasticPad(mounted, (1e-5,) * len(face), contact_stiffness=scale * MINIMAL.contact_stiffness / len(face))
        onsets.append(pad.flutter_friction(up_to=1.2))
    assert onsets[0] == pytest.approx(exact, rel=2e-3)
    distance = [abs(found - exact) for found in onsets]
    assert distance == sorted(distance)
    assert distance[-1] > 0.01


def test_a_pad_in_a_scene_is_saved_with_its_body_and_runs_alike(tmp_path):
    pad = point_pad()
    scene = Scene.of(compose(pad), 5.0, element="pad.0", start={"pad.displacement": tuple(1.1 * pad.steady_sliding_displacement())})
    again = Scene.load(scene.save(tmp_path / "pad.toml"))
    assert again.parts == scene.parts
    first, second = (each.run("no controller") for each in (scene, again))
    assert first["pad.rate"][-1] == pytest.approx(second["pad.rate"][-1], rel=1e-12)
    assert first["pad.normal_force"].max() > 0


test_wrong_uses_are_refused_in_these_words = refusals(
    *[(lambda changes=changes: compose(replace(point_pad(), **changes)), words) for changes, words in [({"initial_approach": (1.0, 2.0)},
     "one entry for each contact"), ({"body": 3}, "ReducedBody"), ({"force_ports": "top"}, "no port `top`")]],
)  # fmt: skip


def test_a_pad_that_nothing_presses_hangs_free_and_does_not_flutter():
    pad = point_pad(preload=-1.0)
    assert (pad.steady_sliding_displacement() == 0).all()
    assert math.isinf(pad.flutter_friction(up_to=0.5))
