"""One contact under its own normal force, which opens and closes: located events against time stepping, which converges to them with first order.

Rows of one contact that rub in one direction, and a cone in two directions, need no more than the elements of a plant.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

from models import Coulomb
from toolbox import Component, DryFriction, Equations, UnilateralContact, compose, energy_audit, simulate, state
from toolbox.contacts import ContactProblem, step_contacts
from toolbox.inputs import sine

MASS, LATERAL, LINING, DRAG, MU = 1.0, 40.0, 1000.0, 8.0, 0.4
"""Mass [kg], spring along the belt [N/m], stiffness of the contact [N/m], damping of all motions [N s/m], coefficient of friction."""
PUSH = {"body.push": sine(10.0, 15.0, 1.3)}  # the contact parts in every period


@dataclass(frozen=True)
class PressedBlock(Component):
    """A block on a belt, pressed by a force that varies: m x'' = - k x - c x' + T, m y'' = push - c y' - N, |T| <= mu N, N = k_c y where closed."""

    def equations(self, signal):
        x, v = state("body.along", "m"), state("body.speed", "m/s")
        y, w = state("body.into", "m"), state("body.approach", "m/s")
        push, belt_speed = signal("body.push", "N", default=0.0), signal("belt.speed", "m/s", default=0.5)
        touch = UnilateralContact("touch", y, w, stiffness=LINING)
        belt = DryFriction("belt", v - belt_speed, Coulomb(MU, MU), touch.force)
        flow = {x: v, v: (belt.force - LATERAL * x - DRAG * v) / MASS, y: w, w: (push - DRAG * w - touch.force) / MASS}
        stored = (MASS * (v**2 + w**2) + LATERAL * x**2) / 2 + touch.stored
        losses = {"damping": DRAG * (v**2 + w**2), "friction": -belt.force * (v - belt_speed), "contact": touch.loss}
        return Equations(
            flow, elements=[touch, belt], stored=stored, losses=losses, supplies={"push": push * w, "belt": belt.force * belt_speed}
        )


@dataclass(frozen=True)
class TurnedString(Component):
    """A string that slides down and turns, u its rim, in one cone: slip (x', u') under the load N, in two directions."""

    def equations(self, signal):
        x, v = state("body.along", "m"), state("body.speed", "m/s")
        u, r = state("body.rim", "m"), state("body.turning", "m/s")
        y, w = state("body.into", "m"), state("body.approach", "m/s")
        push, hook, drive = (signal(f"body.{word}", "N", default=0.0) for word in ("push", "hook", "drive"))
        touch = UnilateralContact("touch", y, w, stiffness=LINING)
        slip = ca.vertcat(v, r)
        wall = DryFriction("wall", slip, Coulomb(MU, MU), touch.force)
        flow = {
            x: v, v: (hook - LATERAL * x - DRAG * v + wall.force[0]) / MASS,
            u: r, r: (drive - DRAG * r + wall.force[1]) / MASS,
            y: w, w: (push - DRAG * w - touch.force) / MASS,
        }  # fmt: skip
        stored = (MASS * (v**2 + r**2 + w**2) + LATERAL * x**2) / 2 + touch.stored
        losses = {"damping": DRAG * (v**2 + r**2 + w**2), "friction": -ca.dot(wall.force, slip), "contact": touch.loss}
        return Equations(flow, elements=[touch, wall], stored=stored, losses=losses, supplies={"pull": push * w + hook * v + drive * r})


def stepped_problem(directions):
    """The same body for `step_contacts`: (x, [u,] y, y of the contact), a place without mass that the lining joins to the body."""
    n = directions + 2
    mass, damping, stiffness = np.diag([MASS] * (n - 1) + [0.0]), np.diag([DRAG] * (n - 1) + [0.0]), np.zeros((n, n))
    stiffness[0, 0] = LATERAL
    stiffness[-2:, -2:] = LINING * np.array([[1.0, -1.0], [-1.0, 1.0]])
    unit = np.eye(n)
    forces = {"body.push": unit[-2]} | ({"body.hook": unit[0], "body.drive": unit[1]} if directions == 2 else {})
    belt = {"belt.speed": np.array([[1.0]])} if directions == 1 else {}
    return ContactProblem(
        mass, stiffness, unit[None, :directions], Coulomb(MU, MU), normal=unit[-1:], damping=damping, force_inputs=forces, surface_velocity=belt,
        outputs={"along": unit[0], "into": unit[-2]},
    )  # fmt: skip


def errors_of_steps(plant, start, problem, inputs, duration, steps):
    """The exact run, and the largest errors of time stepping along and into the counter-surface, in parts of the motion: one row for each step,
    each half of the one before, and a last one for what the last two extrapolate to."""
    exact = simulate(plant, duration, inputs=inputs, start=start, accuracy=1e-10)
    assert sum(event.element == "touch" and event.after == "open" for event in exact.events) >= 2
    runs = [step_contacts(problem, duration, step=step, inputs=inputs) for step in steps]
    truth = exact.at(runs[0].time)

    def error(word, found):
        return np.abs(found - truth[f"body.{word}"]).max() / np.abs(truth[f"body.{word}"]).max()

    words = ("along", "into")
    rows = [[error(word, run[word][:: 2**i]) for word in words] for i, run in enumerate(runs)]
    last = len(runs) - 1
    limit = [error(word, 2 * runs[-1][word][:: 2**last] - runs[-2][word][:: 2 ** (last - 1)]) for word in words]
    return exact, np.array([*rows, limit])


def test_a_block_that_parts_and_sticks_under_its_own_force_is_the_limit_of_time_stepping_with_first_order():
    inputs = PUSH | {"belt.speed": 0.5}
    exact, errors = errors_of_steps(compose(PressedBlock()), {}, stepped_problem(1), inputs, 2.0, (4e-3, 2e-3, 1e-3))
    assert {event.after for event in exact.events if event.element == "belt"} >= {"stick", "slip-"}
    assert np.diff(np.log2(errors[:-1]), axis=0) == pytest.approx(-1.0, abs=0.25)
    assert (errors[-1] < errors[-2] / 3).all()
    audit = energy_audit(exact)
    assert abs(audit.residual) < 1e-8 * audit.turnover


def test_a_string_that_slides_and_turns_in_one_cone_and_parts_is_the_limit_of_time_stepping_with_first_order():
    inputs = PUSH | {"body.hook": 12.0, "body.drive": sine(20.0, 8.0, 0.7)}
    _, errors = errors_of_steps(compose(TurnedString()), {}, stepped_problem(2), inputs, 2.0, (4e-3, 2e-3, 1e-3))
    assert np.diff(np.log2(errors[:-1]), axis=0) == pytest.approx(-1.0, abs=0.25)
    assert (errors[-1] < errors[-2] / 3).all()


@pytest.mark.slow
def test_a_string_that_sticks_slips_and_parts_in_two_directions_is_the_limit_of_time_stepping_with_first_order():
    """The pull runs around an ellipse, the wall lets go and comes back: stick follows slip and slip follows stick in every round."""
    inputs = PUSH | {"body.hook": sine(0.0, 9.0, 0.9), "body.drive": sine(0.0, 8.0, 0.7)}
    exact, errors = errors_of_steps(compose(TurnedString()), {}, stepped_problem(2), inputs, 2.0, (2e-3, 1e-3, 5e-4))
    assert [event.after for event in exact.events if event.element == "wall"].count("stick") >= 3
    assert np.diff(np.log2(errors[:-1]), axis=0) == pytest.approx(-1.0, abs=0.25)
    assert (errors[-1] < errors[-2] / 3).all()
    audit = energy_audit(exact)
    assert abs(audit.residual) < 1e-8 * audit.turnover


def test_turning_takes_the_drag_along_the_string_away():
    inputs = {"body.push": 10.0, "body.hook": 3.0, "body.drive": 84.0}
    last = simulate(compose(TurnedString()), 40.0, inputs=inputs, accuracy=1e-9).at(40.0)
    assert last["body.turning"] == pytest.approx((84.0 - MU * 10.0) / DRAG, rel=1e-6)  # the rim carries all friction,
    assert LATERAL * last["body.along"] == pytest.approx(3.0, rel=1e-6)  # and the spring all of the hook
    pulled = {"body.push": 10.0, "body.hook": ([0.0, 20.0], [0.0, 3.0])}
    held = simulate(compose(TurnedString()), 40.0, inputs=pulled, start={"body.into": 10.0 / LINING}, accuracy=1e-9)
    assert (held["body.along"] == 0.0).all() and held.time_in("wall", "stick") == 40.0  # at rest mu N = 4 N holds it
    stepped = step_contacts(stepped_problem(2), 40.0, step=0.01, inputs=pulled)
    assert LATERAL * stepped["along"][-1] < 0.01 * 3.0
