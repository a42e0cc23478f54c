"""The contact problem of one step: every solution fulfils the laws of contact, also where bodies are 1e8 times stiffer than what holds them."""

import numpy as np
import pytest

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
