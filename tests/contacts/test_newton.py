"""The contact problem of one step: every solution fulfils the laws of contact, also where bodies are 1e8 times stiffer than what holds them."""

import numpy as np
import pytest

from models import Coulomb
from toolbox import SimulationError
from toolbox.contacts import ContactProblem, press_contacts, step_contacts
from toolbox.contacts.newton import ContactSolver, Given


def random_problem(seed, contacts, directions, opens, soft=1e-8):
    """A stiffness of contacts that interact, in which one motion is `soft` times less stiff than the others."""
    random = np.random.default_rng(seed)
    m = contacts * (directions + opens)
    places = np.linspace(0, 1, m)
    matrix = 1e8 * (np.diag(2.0 + random.random(m)) - np.exp(-8 * np.abs(places[:, None] - places)) * 0.9)
    matrix = matrix @ matrix / 1e8
    for rigid in np.eye(directions + opens):  # the whole body moved along an axis
        shape = np.concatenate([np.tile(rigid[:1], contacts), np.tile(rigid[1:], contacts)]) if opens else np.tile(rigid, contacts)
        shape /= np.linalg.norm(shape)
        pull = matrix @ shape
        matrix = matrix - np.outer(pull, pull) / (shape @ pull) + soft * 1e8 * np.outer(shape, shape)
    right = 10.0 * random.normal(size=m)
    if opens:
        right[:contacts] = 5.0 + 10.0 * random.normal(size=contacts)
    held = 1e-8 * random.normal(size=(contacts, directions))
    gap = 1e-7 * random.random(contacts) * (random.random(contacts) > 0.5)
    return (matrix + matrix.T) / 2, Given(right, gap, held, 0.1 + 0.5 * random.random(contacts), 10.0 * random.random(contacts))


@pytest.mark.parametrize("directions", [1, 2])
@pytest.mark.parametrize("opens", [False, True])
@pytest.mark.parametrize("contacts", [1, 6, 40])
def test_solutions_fulfil_signorini_and_coulomb(contacts, directions, opens):
    solved = 0
    for seed in range(8):
        matrix, given = random_problem(seed, contacts, directions, opens)
        found = ContactSolver(matrix, contacts, directions).solve(given, None)
        if found is None:
            continue
        solved += 1
        size = np.abs(given.right).max()
        force = matrix @ found.moved - given.right
        first = contacts if opens else 0
        traction = force[first:].reshape(contacts, directions)
        slip = found.moved[first:].reshape(contacts, directions) - given.held
        load = -force[:first] if opens else given.load
        tiny = 1e-8 * size + 1e-13 * (np.abs(matrix) @ np.abs(found.moved)).max()  # what round-off leaves
        if opens:
            gap = given.gap - found.moved[:contacts]
            assert (load >= -tiny).all()
            assert (gap * np.diag(matrix)[:contacts] >= -tiny).all()
            assert np.abs(np.minimum(load, gap * np.diag(matrix)[:contacts])).max() <= tiny
        assert (np.linalg.norm(traction, axis=1) <= given.friction * load + tiny).all()
        distance = np.linalg.norm(slip, axis=1)
        slides = distance * np.diag(matrix)[first::directions][:contacts] > 1e-6 * size + 10 * tiny
        against = -(traction * slip).sum(axis=1)
        np.testing.assert_allclose(against[slides] / distance[slides], (given.friction * load)[slides], atol=1e-6 * size + tiny)
        assert set(np.flatnonzero(slides)) <= set(np.flatnonzero(~found.sticks))
    assert solved == 8


def test_a_contact_whose_guess_is_wrong_everywhere_is_solved_too():
    matrix, given = random_problem(3, 12, 2, True)
    solver = ContactSolver(matrix, 12, 2)
    right = solver.solve(given, None)
    wrong = solver.solve(random_problem(3, 12, 2, True, soft=1e-2)[1], None)
    wrong.is_open, wrong.sticks = ~right.is_open, ~right.sticks & right.is_open
    found = solver.solve(given, wrong)
    np.testing.assert_allclose(found.moved, right.moved, atol=1e-9 * np.abs(right.moved).max())
    assert (found.is_open == right.is_open).all()
    assert (found.sticks == right.sticks).all()


def test_three_passes_suffice_from_a_neighbouring_solution_whatever_the_ratio_of_stiffnesses():
    for soft in (1e-2, 1e-5, 1e-8):
        matrix, given = random_problem(1, 40, 2, True, soft)
        solver = ContactSolver(matrix, 40, 2)
        first = solver.solve(given, None)
        given.right = given.right * (1 + 1e-4)
        assert solver.solve(given, first).passes <= 4


def half_plane_under_a_cylinder(cells):
    """An elastic half-plane without mass (Flamant's compliance of cells under even pressure) and a rigid cylinder that nothing but friction holds.

    Returns the problem, the force at which the contact is 5 mm to either side by Hertz, and the positions of the cells.
    """
    modulus, radius, half, friction = 2e11, 1.0, 5e-3, 0.3
    x = np.linspace(-2 * half, 2 * half, cells)
    width = x[1] - x[0]
    ends = np.abs(x[:, None] - x) + width * np.array([0.5, -0.5])[:, None, None]
    from_zero = ends * (np.log(np.abs(ends) / (100 * half)) - 1)
    face = np.linalg.inv(-2 / (np.pi * modulus * width) * (from_zero[0] - from_zero[1]))
    stiffness = np.zeros((2 * cells + 2, 2 * cells + 2))
    stiffness[:cells, :cells] = stiffness[cells:-2, cells:-2] = (face + face.T) / 2
    unit = np.eye(2 * cells + 2)
    problem = ContactProblem(
        np.zeros_like(stiffness), stiffness, (unit[-1] - unit[cells:-2])[:, None], Coulomb(friction, friction), normal=unit[-2] - unit[:cells],
        gap=x**2 / (2 * radius), force_inputs={"press": unit[-2], "pull": unit[-1]}, contact_areas=np.full(cells, width),
    )  # fmt: skip
    return problem, np.pi * half**2 * modulus / (4 * radius), x / half


def test_a_motion_that_friction_alone_holds_is_found_stuck_and_not_lost_in_round_off():
    """With everything slipping the equations are singular: Newton's passes came out there, 1e9 m away, with tractions 446 times the friction."""
    problem, press, x = half_plane_under_a_cylinder(321)
    rest = press_contacts(problem, {"press": press})
    np.testing.assert_allclose(rest.normal[0].sum(), press, rtol=1e-9)
    assert (np.abs(x[rest.contact_modes[0] == 0]) < 1.01).all() and (rest.normal[0][rest.contact_modes[0] == 2] == 0.0).all()
    pull = 0.6 * 0.3 * press
    run = step_contacts(problem, 2.0, step=0.05, inputs={"press": press, "pull": ([0.0, 1.0, 2.0], [0.0, pull, -pull])}, start=rest)
    for i, slipped in ((20, pull), (30, pull / 2), (40, pull)):  # Cattaneo and Mindlin: forth, half way back (half as far counts), and back
        stuck = np.abs(x[run.contact_modes[i] == 0]).max()
        assert stuck == pytest.approx(np.sqrt(1 - slipped / (0.3 * press)), abs=2 / 80)
    assert run.audit()["missing"] == pytest.approx(0.0, abs=1e-9 * run.audit()["size"])
    assert (np.linalg.norm(run.tangential, axis=2) <= 0.3 * run.normal * (1 + 1e-6) + 1e-9 * press).all()


def test_what_nothing_holds_has_no_solution_without_mass():
    problem, press, _ = half_plane_under_a_cylinder(81)
    rest = press_contacts(problem, {"press": press})
    with pytest.raises(SimulationError, match="at rest under these inputs: contacts, friction and springs must hold"):
        press_contacts(problem, {"press": press, "pull": 0.36 * press})
    with pytest.raises(SimulationError, match=r"solves the step at 0\.85 s") as caught:
        step_contacts(problem, 1.0, step=0.05, inputs={"press": press, "pull": ([0.0, 1.0], [0.0, 0.36 * press])}, start=rest)
    assert caught.value.run.end == pytest.approx(0.8)
