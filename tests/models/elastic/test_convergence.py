"""Convergence with mesh and with kept modes, against the closed form of a bar in a shrink fit and against bodies that are not reduced.

A bar of axial stiffness EA, held by friction f per length, is pulled at its end by P(t) that changes slowly. It slips over the length s = P / f from that
end, so   u = P^2 / (2 EA f)   when it is first loaded,   u = u* - (P* - P)^2 / (4 EA f)   when P comes down from P*, and a cycle between P* and -P* takes
2 P*^3 / (3 EA f).  With elements of length h the node i slips from P = (i + 1/2) f h on, so that m = P / (f h), rounded, elements are strained, and
u is less by (P - m f h)^2 / (2 EA f), which is f h^2 / (8 EA) at most.
"""

import itertools
import math

import numpy as np
import pytest

from models import Coulomb, ElasticBody, ElasticSlider, block_mesh, body_of_mesh
from toolbox import compose, simulate
from toolbox.contacts import ContactProblem, press_contacts, step_contacts
from toolbox.inputs import ramp

LENGTH, STIFFNESS, HOLD, MU = 0.5, 2.1e7, 400.0, 0.4
HOUR = 3600.0  # steps of minutes: nothing moves but by the pull


def bar(elements, density=1.0):
    """Mass and stiffness of the bar, and the length that each node stands for."""
    h, side = LENGTH / elements, np.ones(elements)
    inside = np.full(elements + 1, 2.0)
    inside[[0, -1]] = 1.0
    return density * h * np.diag(inside) / 2, STIFFNESS / h * (np.diag(inside) - np.diag(side, 1) - np.diag(side, -1)), h * inside / 2


def fitted(elements):
    """The bar with friction at every node, pulled at node 0."""
    mass, stiffness, share = bar(elements)
    unit = np.eye(elements + 1)
    return ContactProblem(
        mass, stiffness, unit[:, None, :], Coulomb(MU, MU), load=HOLD * share / MU, force_inputs={"pull": unit[0]}, outputs={"end": unit[0]}
    )


def test_a_bar_in_a_shrink_fit_moves_and_dissipates_as_the_closed_form_with_an_error_of_second_order_in_the_mesh():
    top = 0.8 * HOLD * LENGTH
    times, pulls = [0.0, HOUR, 3 * HOUR, 5 * HOUR], [0.0, top, -top, top]
    errors, losses = [], []
    for elements in (10, 20, 40):
        run = step_contacts(fitted(elements), 5 * HOUR, step=HOUR / 50, inputs={"pull": (times, pulls)})
        pull = np.interp(run.time, times, pulls)
        grain = HOLD * LENGTH / elements

        def loops(first, pull=pull, time=run.time):
            """First loading, down and up again, of a bar that moves by `first` when it is loaded by a force."""
            found = [first(pull), first(top) - 2 * first((top - pull) / 2), 2 * first((top + pull) / 2) - first(top)]
            return np.select([time <= HOUR, time <= 3 * HOUR], found[:2], found[2])

        def smooth(force):
            return force**2 / (2 * STIFFNESS * HOLD)

        def with_elements(force, grain=grain):
            return smooth(force) - smooth(force - grain * np.round(force / grain))

        np.testing.assert_allclose(run["end"], loops(with_elements), atol=1e-9 * smooth(top))
        errors.append(np.abs(run["end"] - loops(smooth)).max() / smooth(top))
        losses.append((run.friction_work[-1].sum() - run.friction_work[50].sum()) / (2 * top**3 / (3 * STIFFNESS * HOLD)) - 1)
        audit = run.audit()
        assert abs(audit["missing"]) < 1e-9 * audit["size"]
    assert errors[-1] < 1e-3
    for coarse, fine in (*itertools.pairwise(errors), *itertools.pairwise(losses)):
        assert math.log2(coarse / fine) == pytest.approx(2.0, abs=0.05)


def test_every_node_of_the_bar_lets_go_at_its_own_force_as_a_located_event():
    elements = 8
    mass, stiffness, share = bar(elements)
    body = ElasticBody(mass, stiffness, 1e-5 * stiffness).reduced({f"contact.{i}": row for i, row in enumerate(np.eye(elements + 1))})
    slider = ElasticSlider(body, tuple(HOLD * share / MU), support_port="contact.0", stiffness=0.0, damping=0.0, friction=Coulomb(MU, MU))
    whole = HOLD * LENGTH
    run = simulate(compose(slider), 1.0, inputs={"slider.pull": ramp(0.0, 0.99 * whole, 0.0, 1.0)}, method="stiff", accuracy=1e-8)
    first = {event.element: event.time for event in reversed(run.events) if event.before == "stick"}
    exact = {f"plate.{i}": (i + 0.5) / elements / 0.99 for i in range(elements)}
    # a node that has let go creeps after the pull, and damping carries its part: 1e-5 s of the second that it takes
    assert first == pytest.approx(exact, rel=1e-5)
    assert run["slider.position"][-1] == pytest.approx(
        whole**2 * 0.99**2 / (2 * STIFFNESS * HOLD), abs=HOLD * (LENGTH / elements) ** 2 / (8 * STIFFNESS)
    )


@pytest.fixture(scope="module")
def struck():
    """A free steel rod that rubs at one end and is struck at the other: run with all its elements, and a function that runs it reduced."""
    elements, area, modulus, density = 60, 1e-4, 2.1e11, 7800.0
    mass, stiffness, _ = bar(elements, density * area)
    stiffness *= modulus * area / STIFFNESS
    speed = math.sqrt(modulus / density)
    period, unit = 2 * LENGTH / speed, np.eye(elements + 1)
    body = ElasticBody(mass, stiffness, 2e-7 * stiffness)
    pulse = np.linspace(0.0, 1.0, 51)
    inputs = {"end": (period * pulse, 800.0 * np.sin(np.pi * pulse) ** 2)}

    def run(body):
        problem = ContactProblem(
            body.mass, body.stiffness, np.eye(body.size)[None, :1], Coulomb(0.3, 0.3), load=[1000.0], damping=body.damping,
            force_inputs={"end": np.eye(body.size)[1]}, outputs={"rubs": np.eye(body.size)[0]},
        )  # fmt: skip
        return step_contacts(problem, 3 * period, step=period / 200, inputs=inputs)

    order = np.r_[0, elements, 1:elements]  # both ends first, as in a reduced body
    whole = ElasticBody(*(matrix[np.ix_(order, order)] for matrix in (mass, stiffness, 2e-7 * stiffness)))
    ends = {"rubs": unit[0], "end": unit[-1]}

    def reduced(band):
        found = body.reduced(ends, band * speed / (2 * LENGTH))
        return run(found), found.modes

    return run(whole), reduced


def test_more_kept_modes_bring_a_rod_that_sticks_and_slips_to_that_of_all_its_elements(struck):
    whole, reduced = struck
    size = np.abs(whole["rubs"]).max()
    assert 0.2 < whole.share().mean() < 0.95
    errors, modes = [], []
    for band in (0.0, 2.2, 4.2, 8.2, 16.2):
        run, kept = reduced(band)
        errors.append(np.abs(run["rubs"] - whole["rubs"]).max() / size)
        modes.append(kept)
    assert modes == sorted(set(modes))
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 0.1  # statics alone know no wave
    assert errors[-1] < 2e-4
    # the force that strikes has a corner in its rate: the modes that are left out fall with their number to the power of two at least
    assert math.log(errors[1] / errors[-1]) / math.log(modes[-1] / modes[1]) > 2.0


@pytest.mark.slow
def test_a_block_that_is_pulled_slips_with_every_finer_mesh_closer_to_the_finest():
    runs = []
    for divisions in (4, 8, 16, 32):
        body = body_of_mesh(block_mesh((0.01, 0.01), (divisions, divisions)), density=7800.0, modulus=2.1e11)
        nodes = body.face_nodes("bottom")
        ports = {f"{axis}.{i}": body.point(node, axis) for axis in "xy" for i, node in enumerate(nodes)}
        reduced = body.reduced(ports | {"left": body.mean("left", "x"), "top": body.mean("top", "y")})
        problem = reduced.in_contact(Coulomb(0.35, 0.35), ("x",), "y", pushed=("left", "top"), areas=body.faces["bottom"][nodes])
        rest = press_contacts(problem, {"top": -1000.0})
        pulled = {"top": -1000.0, "left": ramp(0.0, 340.0, 0.0, 100 * HOUR)}
        runs.append(step_contacts(problem, 100 * HOUR, step=HOUR, inputs=pulled, start=rest))
    moved = [run["left"] - run["left"][0] for run in runs]
    displacement = [np.abs(each - moved[-1]).max() / moved[-1].max() for each in moved[:-1]]
    share = [np.abs(run.share() - runs[-1].share()).mean() for run in runs[:-1]]
    assert displacement[-1] < 0.01
    assert share[-1] < 0.02
    for found in (displacement, share):
        for coarse, fine in itertools.pairwise(found):
            assert coarse / fine > 1.8  # corners of the face make it of first order
