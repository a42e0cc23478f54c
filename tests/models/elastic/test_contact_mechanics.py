"""Elastic contacts against the textbook: even pressure, Hertz, and partial slip after Cattaneo and Mindlin."""

import math

import numpy as np
import pytest

from models import Coulomb, block_mesh, body_of_mesh
from toolbox.contacts import ContactProblem, press_contacts, step_contacts

MODULUS, POISSON, MU = 2.1e11, 0.3, 0.4


def test_a_block_under_even_pressure_on_a_smooth_plate_presses_evenly():
    """The patch test of a contact: nodal forces are the pressure times the area of every node, to round-off."""
    body = body_of_mesh(block_mesh((0.01, 0.01, 0.005), (4, (0.0, 0.2, 0.3, 0.7, 1.0), 3)), density=7800.0, modulus=MODULUS)
    nodes = body.face_nodes("bottom")
    ports = {f"{axis}.{i}": body.point(node, axis) for axis in "xyz" for i, node in enumerate(nodes)} | {"top": body.mean("top", "z")}
    problem = body.reduced(ports).in_contact(Coulomb(MU, MU), ("x", "y"), "z", pushed=("top",), areas=body.faces["bottom"][nodes])
    rest = press_contacts(problem, {"top": -10.0}, frictionless=True)
    np.testing.assert_allclose(rest.pressure[0], 1e5, rtol=1e-8)


@pytest.fixture(scope="module")
def cylinders():
    """Two equal bodies, plane strain, face to face: c = 61 contacts on 1.3 mm, domain 40 x 20 mm; far sides held. The gap is that of cylinders of 1 m."""
    fine = np.arange(-30, 31) / 45.0  # places of the contacts [mm]
    beyond = fine[-1] + np.cumsum(np.diff(fine)[0] * 1.25 ** np.arange(1, 21))
    beyond = beyond[beyond < 18.0]
    x = np.concatenate([[-20.0], -beyond[::-1], fine, beyond, [20.0]])
    depth = np.cumsum(np.diff(fine)[0] * 1.25 ** np.arange(22))
    depth = np.concatenate([[0.0], depth[depth < 18.0], [20.0]])
    mesh = block_mesh((0.04, 0.02), ((x + 20.0) / 40.0, (20.0 - depth[::-1]) / 20.0))
    body = body_of_mesh(mesh, density=7800.0, modulus=MODULUS, poisson=POISSON).clamped("bottom")
    place = 1e3 * body.nodes[:, 0] - 20.0
    nodes = [node for node in body.face_nodes("top") if abs(place[node]) < 30.5 / 45.0]
    reduced = body.reduced({f"{axis}.{i}": body.point(node, axis) for axis in "xy" for i, node in enumerate(nodes)})
    return reduced, 1e-3 * place[nodes]


def pressed(cylinders, approach, radius=1.0):
    """Both bodies as one problem: the upper one is the mirror image of the lower, so its closure counts alike and its tangent the other way."""
    body, x = cylinders
    n, c = body.size, len(x)
    unit = np.eye(n)
    both = lambda matrix: np.kron(np.eye(2), matrix)  # noqa: E731
    closure = np.hstack([unit[body.indices("y")], unit[body.indices("y")]])
    tangent = np.hstack([unit[body.indices("x")], -unit[body.indices("x")]])
    return ContactProblem(
        both(body.mass), both(body.stiffness), tangent[:, None, :], Coulomb(MU, MU), normal=closure, gap=x**2 / (2 * radius) - approach,
        surface_velocity={"shift": np.ones((c, 1))}, contact_positions=x[:, None],
    )  # fmt: skip


def half_width(x, force, power):
    """Where force^power, linear in x^2, is zero, by a fit through the inner half of the places at which it acts."""
    inside = np.flatnonzero(force > 0.3 * force.max())
    slope, height = np.polyfit(x[inside] ** 2, force[inside] ** power, 1)
    return math.sqrt(-height / slope)


def test_the_half_width_and_the_peak_pressure_are_those_of_hertz(cylinders):
    spacing = np.diff(cylinders[1])[0]
    for approach in (0.2e-6, 0.5e-6, 0.8e-6):
        rest = press_contacts(pressed(cylinders, approach), frictionless=True)
        load = rest.normal[0].sum()
        modulus = MODULUS / (2 * (1 - POISSON**2))
        exact = math.sqrt(4 * load * 1.0 / (math.pi * modulus))
        assert half_width(cylinders[1], rest.normal[0], 2) == pytest.approx(exact, rel=0.02)
        assert rest.share("open")[0] > 0
        touching = (rest.contact_modes[0] != 2).sum() * spacing / 2
        assert touching == pytest.approx(exact, abs=1.01 * spacing)
        assert rest.normal[0].max() / spacing == pytest.approx(2 * load / (math.pi * exact), rel=0.02)


def test_equal_bodies_that_are_pressed_together_do_not_slip_with_friction(cylinders):
    rest = press_contacts(pressed(cylinders, 0.6e-6))
    smooth = press_contacts(pressed(cylinders, 0.6e-6), frictionless=True)
    np.testing.assert_allclose(rest.normal, smooth.normal, atol=1e-8 * smooth.normal.max())
    assert np.abs(rest.tangential).max() < 1e-8 * rest.normal.max()


def test_the_stick_zone_shrinks_as_cattaneo_and_mindlin_say(cylinders):
    """c / a = sqrt(1 - Q / (mu P)) at every step of a growing shift, until all slips."""
    problem = pressed(cylinders, 0.6e-6)
    rest = press_contacts(problem)
    spacing = np.diff(cylinders[1])[0]
    # steps of hours: nothing moves but by the shift
    run = step_contacts(problem, 20 * 3600.0, step=3600.0, inputs={"shift": 0.4e-6 / 72e3}, start=rest)
    load = run.normal.sum(axis=1)
    np.testing.assert_allclose(load, load[0], rtol=1e-6)
    a = half_width(cylinders[1], run.normal[0], 2)
    checked = 0
    for i in range(1, len(run.time)):
        pull = -run.tangential[i].sum() / (MU * load[i])
        if abs(pull) > 0.999:
            assert run.share()[i] == 0.0 or abs(pull) < 1 - 1e-9
            continue
        exact = a * math.sqrt(1 - abs(pull))
        stuck = run.contact_modes[i] == 0
        if stuck.sum() < 9:
            continue
        rest_of_cone = np.where(stuck, MU * run.normal[i] - np.abs(run.tangential[i, :, 0]), 0.0)
        assert half_width(cylinders[1], rest_of_cone, 2) == pytest.approx(exact, rel=0.02)
        assert stuck.sum() * spacing / 2 == pytest.approx(exact, abs=1.01 * spacing)
        checked += 1
    assert checked >= 6
    assert run.share()[-1] == 0.0
    audit = run.audit()
    assert abs(audit["missing"]) < 1e-9 * audit["size"]
