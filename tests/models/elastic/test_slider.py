"""The elastic slider: rows that let go one by one as events, the last with the rigid slider."""

import numpy as np
import pytest

from models import Coulomb, ElasticBody, ElasticSlider, PlateContact, Slider, block_mesh, body_of_mesh
from toolbox import SceneError, compose, energy_audit, simulate
from toolbox.inputs import ramp

DRIVE = {"plate.speed": ramp(0.0, 0.01, 0.0, 4.0)}


def row_of_masses(contacts=4, stiffness=1e8, damping_time=1e-5):
    """Masses in a row, joined by springs, a contact under each; the first is held."""
    matrix = stiffness * (np.diag([1.0, *[2.0] * (contacts - 2), 1.0]) - np.eye(contacts, k=1) - np.eye(contacts, k=-1))
    body = ElasticBody(0.01 * np.eye(contacts), matrix, damping_time * matrix)
    ports = {f"contact.{i}": np.eye(contacts)[i] for i in range(contacts)}
    return body.reduced(ports)


def slider(**options):
    fields = {"body": row_of_masses(), "loads": (2.5,) * 4, "support_port": "contact.0", "damping": 500.0}
    return ElasticSlider(**fields | options)


def test_contacts_let_go_one_by_one_and_the_last_with_the_rigid_slider():
    run = simulate(compose(slider()), 0.6, inputs=DRIVE, method="stiff", accuracy=1e-7)
    rigid = simulate(compose(Slider(mass=0.04, damping=500.0), PlateContact()), 0.6, inputs=DRIVE, accuracy=1e-9)
    released = [event for event in run.events if event.before == "stick"]
    assert [event.element for event in released[:4]] == [f"plate.{i}" for i in range(4)]
    assert released[3].time == pytest.approx(rigid.events[0].time, rel=1e-3)
    assert released[0].time < 0.9 * released[3].time


def test_its_energy_is_accounted_for():
    soft = slider(body=row_of_masses(stiffness=1e6, damping_time=1e-3))
    run = simulate(compose(soft), 0.6, inputs=DRIVE, method="stiff", accuracy=1e-8)
    audit = energy_audit(run)
    assert abs(audit.residual) < 1e-5 * audit.turnover
    assert run["plate.stuck"][0] == 1.0
    assert run["plate.stuck"][-1] == 0.0


def test_a_slider_rides_on_a_plate_for_metres_and_its_strains_stay_exact():
    """Nothing but friction holds it: it is carried off by the plate, and what accelerates it is all that its contacts carry."""
    body = row_of_masses(stiffness=1e8)
    free = ElasticSlider(body, (2.5,) * 4, support_port="contact.1", stiffness=0.0, damping=0.0)
    run = simulate(compose(free), 4.0, inputs={"plate.speed": ramp(0.0, 4.0, 0.0, 2.0)}, method="stiff", accuracy=1e-6)
    assert run["plate.stuck"].min() == 1.0
    assert run["slider.position"][-1] == pytest.approx(12.0, rel=1e-9)
    assert run.at(1.0)["plate.drag"] == pytest.approx(4 * 0.01 * 2.0, rel=1e-9)
    assert len(run.time) < 3000
    assert abs(run.at(3.0)["plate.drag"]) < 1e-9
    relative = run["slider.displacement"][:, [0, 2, 3]]
    assert np.abs(relative).max() < 1e-8
    audit = energy_audit(run)
    assert abs(audit.residual) < 1e-6 * audit.turnover


def test_which_contact_is_held_counts_for_the_mount_alone():
    """A port beside the contacts, held as one of them: the same motion, in other coordinates."""
    matrix = 1e6 * (np.diag([1.0, 2.0, 2.0, 1.0]) - np.eye(4, k=1) - np.eye(4, k=-1))
    body = ElasticBody(0.01 * np.eye(4), matrix, 1e-4 * matrix)
    ports = {f"contact.{i}": np.eye(4)[i] for i in range(4)}
    beside = ElasticSlider(
        body.reduced({f"contact.{i}": np.eye(4)[i + 1] for i in range(3)} | {"end": np.eye(4)[0]}),
        (2.5,) * 3,
        support_port="end",
        damping=500.0,
    )
    loaded = ElasticSlider(body.reduced(ports), (0.0, 2.5, 2.5, 2.5), support_port="contact.0", damping=500.0)
    runs = [simulate(compose(part), 0.5, inputs=DRIVE, method="stiff", accuracy=1e-8) for part in (beside, loaded)]
    times = np.linspace(0, 0.5, 101)
    for name in ("slider.position", "plate.drag"):
        first, second = (run.at(times)[name] for run in runs)
        np.testing.assert_allclose(first, second, atol=1e-6 * np.abs(first).max())


@pytest.mark.slow
def test_the_last_row_of_the_published_cube_slips_with_the_rigid_slider():
    body = body_of_mesh(block_mesh((0.01,) * 3, (10, 4, 4)), density=7800.0, modulus=2.1e11, damping_time=1e-6).clamped("bottom", "yz")
    rows = body.node_row_ports("bottom", "x", "x")
    ports = {f"contact.{i}": row for i, row in enumerate(rows)} | {"held": body.mean("left", "x")}
    elastic = ElasticSlider(body.reduced(ports), tuple(1e5 * body.node_row_areas("bottom", "x")))
    run = simulate(compose(elastic), 0.24, inputs=DRIVE, method="stiff", accuracy=1e-5)
    rigid = simulate(compose(Slider(), PlateContact()), 0.24, inputs=DRIVE, accuracy=1e-9)
    first = {event.element: event.time for event in reversed(run.events) if event.before == "stick"}
    assert len(first) == 11
    assert max(first.values()) == pytest.approx(rigid.events[0].time, rel=1e-3)
    assert min(first.values()) < 0.5 * max(first.values())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"loads": (1.0, 2.0)}, "4 entries"),
        ({"support_port": "back"}, "no port `back`"),
        ({"body": None}, "ReducedBody"),
        ({"loads": (-1.0, 1.0, 1.0, 1.0)}, ">= 0"),
        ({"friction": Coulomb(0.1, 0.2)}, "kinetic"),
    ],
)
def test_sliders_that_are_none_are_refused(changes, words):
    with pytest.raises(SceneError, match=words):
        compose(slider(**changes))
