"""Several contacts: who sticks and who slips when they decide together, against closed forms and two independent methods."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from models import Coulomb, Hyperbolic
from toolbox import Component, DryFriction, Equations, FrictionLaw, SceneError, compose, quantity, simulate, state, time


@dataclass(frozen=True)
class Row(Component):
    """n equal blocks on one belt, neighbours joined by springs, each held by a spring to ground: contacts `row.0` to `row.n-1`."""

    count: int = 2
    coupling: float = quantity(0.5, "N/m", "stiffness between neighbours")
    belt_speed: float = quantity(0.2, "m/s", "speed of the belt")
    friction: FrictionLaw = Coulomb(static=1.0, kinetic=0.7)

    def equations(self, signal):
        n = self.count
        x, v = state("row.position", "m", n), state("row.speed", "m/s", n)
        contacts = [DryFriction(f"row.{i}", v[i] - self.belt_speed, self.friction) for i in range(n)]
        stretch = x[1:] - x[:-1]
        pull = self.coupling * (ca.vertcat(stretch, 0) - ca.vertcat(0, stretch)) if n > 1 else 0
        return Equations(flow={x: v, v: pull - x + ca.vertcat(*[contact.force for contact in contacts])}, elements=contacts)


@dataclass(frozen=True)
class Stack(Component):
    """Disks on one axis, friction between neighbours: slip w_i - w_(i+1), so that the gain matrix is tridiagonal.

    Torque on every disk is a signal `disk.i`; the last disk may be held by a spring.
    """

    inertia: tuple[float, ...] = quantity((1.0, 1.0, 1.0), "kg m2", "inertias", above=0)
    load: tuple[float, ...] = quantity((1.0, 1.0), "N m", "friction torque of the interfaces at coefficient 1", at_least=0)
    stiffness: float = quantity(0.0, "N m/rad", "spring that holds the last disk")
    friction: FrictionLaw = Coulomb(static=1.0, kinetic=1.0)

    def equations(self, signal):
        n = len(self.inertia)
        w, angle = state("stack.speed", "rad/s", n), state("stack.angle", "rad")
        contacts = [
            DryFriction(f"stack.{i}", w[i] - w[i + 1], self.friction, self.load[i], slip_unit="rad/s", force_unit="N m")
            for i in range(n - 1)
        ]
        rates = []
        for i in range(n):
            torque = signal(f"disk.{i}", "N m", default=0.0)
            torque += contacts[i].force if i < n - 1 else -self.stiffness * angle
            torque -= contacts[i - 1].force if i > 0 else 0
            rates.append(torque / self.inertia[i])
        return Equations(flow={angle: w[n - 1], w: ca.vertcat(*rates)}, elements=contacts)


def mode_is_consistent(run, static, kinetic):
    """At every recorded node: stick has zero slip and |F| <= static; slip has F = -m kinetic and m slip >= 0."""
    for i, element in enumerate(run.program.system.elements):
        slip, force, mode = run[f"{element.name}.slip"], run[f"{element.name}.force"], run.mode[:, i]
        stuck = mode == 0
        assert np.all(slip[stuck] == 0.0)
        assert np.all(np.abs(force[stuck]) <= static[i] * (1 + 1e-9))
        size = np.abs(slip).max() if slip.any() else 1.0
        assert np.all(mode * slip >= -1.1 * max(1e-5 * run.accuracy, 1e-13) * size)  # what an event is located to
        np.testing.assert_allclose(force[~stuck], (-mode * kinetic[i])[~stuck], rtol=1e-12)


# --- blocks of one belt


@pytest.mark.parametrize("count", [2, 3])
def test_blocks_that_start_alike_move_alike_and_switch_at_the_same_instants(count):
    # by symmetry the coupling springs of two equal blocks never stretch: each is the single block. Of three, too.
    run = simulate(compose(Row(count=count)), 40.0, accuracy=1e-10)
    alone = simulate(compose(Row(count=1)), 40.0, accuracy=1e-10)
    assert np.ptp(run["row.position"], axis=1).max() == 0.0
    assert np.ptp(run["row.speed"], axis=1).max() == 0.0
    for i in range(count):
        mine = [(event.time, event.before, event.after) for event in run.events if event.element == f"row.{i}"]
        np.testing.assert_allclose([t for t, *_ in mine], [event.time for event in alone.events], atol=1e-8)
        assert [modes for _, *modes in mine] == [[event.before, event.after] for event in alone.events]
    by_instant = [list(group) for _, group in itertools.groupby(run.events, key=lambda event: event.time)]
    assert all(len(group) == count for group in by_instant)
    mode_is_consistent(run, [1.0] * count, [0.7] * count)


def test_blocks_in_antiphase_switch_in_turn_and_mirror_each_other():
    # a belt at rest, mirrored starts: x_1 = -x_0 for ever, so the coupling adds 2 * coupling to the stiffness
    plant = compose(Row(count=2, belt_speed=0.0, friction=Coulomb(static=0.02, kinetic=0.02)))
    run = simulate(plant, 30.0, start={"row.position": (1.0, -1.0)}, accuracy=1e-10)
    np.testing.assert_array_equal(run["row.position.0"], -run["row.position.1"])
    turns = [event.time for event in run.events if event.element == "row.0"][:10]
    np.testing.assert_allclose(turns, np.arange(1, len(turns) + 1) * math.pi / math.sqrt(2.0), rtol=1e-8)
    n = np.arange(1, len(turns) + 1)
    np.testing.assert_allclose(run.at(turns)["row.position.0"], (-1.0) ** n * (1 - 2 * n * 0.02 / 2.0), atol=1e-9)


def test_a_released_block_pulls_its_neighbour_free_only_when_the_spring_does():
    # block 0 is 0.3 m ahead: it lets go first; until then both ride, and their distance cannot change
    plant = compose(Row(count=2, friction=Hyperbolic(static=1.0, decay=3.0)))
    run = simulate(plant, 40.0, start={"row.position": (0.3, 0.0), "row.speed": 0.2}, accuracy=1e-10)
    first = run.events[0]
    # the spring to ground pulls with x_0, the coupling with 0.15: x_0 + 0.15 = 1
    assert (first.element, first.after) == ("row.0", "slip-")
    assert first.time == pytest.approx((0.85 - 0.3) / 0.2, abs=1e-8)
    before = run.at(np.linspace(0, first.time * 0.999, 30))
    np.testing.assert_allclose(before["row.position.0"] - before["row.position.1"], 0.3, atol=1e-12)
    assert np.all(before["row.0.slip"] == 0.0)


# --- disks in a stack: piecewise constant torques on Coulomb interfaces give straight lines


def test_a_stack_pushed_gently_moves_as_one():
    # 3 N m on three equal disks: interfaces carry 2 and 1 N m, both below their bounds
    run = simulate(compose(Stack(load=(2.5, 1.5))), 2.0, inputs={"disk.0": 3.0}, accuracy=1e-10)
    assert run.events == []
    np.testing.assert_allclose(run.at(2.0)["stack.speed"], [2.0] * 3, rtol=1e-12)
    assert run.at(1.0)["stack.0.force"] == pytest.approx(-2.0, rel=1e-12)
    assert run.at(1.0)["stack.1.force"] == pytest.approx(-1.0, rel=1e-12)


def test_the_first_interface_slips_where_its_bound_is_below_what_the_rest_needs():
    # 6 N m: interface 0 (bound 2.5) slips: disk 0 gets 3.5; the others share 2.5 and stick, for interface 1 needs 1.25 <= 1.5
    run = simulate(compose(Stack(load=(2.5, 1.5))), 2.0, inputs={"disk.0": 6.0}, accuracy=1e-10)
    np.testing.assert_allclose(run.at(2.0)["stack.speed"], [7.0, 2.5, 2.5], rtol=1e-9)
    assert run.time_in("stack.1", "stick") == 2.0
    # with a weaker second interface both slip: 3.5, 2.5 - 1, 1
    run = simulate(compose(Stack(load=(2.5, 1.0))), 2.0, inputs={"disk.0": 6.0}, accuracy=1e-10)
    np.testing.assert_allclose(run.at(2.0)["stack.speed"], [7.0, 3.0, 2.0], rtol=1e-9)


def test_slip_of_one_interface_can_hold_another_that_would_slip_alone():
    # torque on the middle disk: both interfaces are loaded alike from it; 4.5 N m split by equal inertias needs 1.5 N m in each
    for bound, sticks in ((1.6, True), (1.4, False)):
        run = simulate(compose(Stack(load=(bound, bound))), 1.0, inputs={"disk.1": 4.5}, accuracy=1e-10)
        assert (run.time_in("stack.0", "stick") == 1.0) is sticks
        assert (run.time_in("stack.1", "stick") == 1.0) is sticks
        outer = 1.5 if sticks else 1.4
        np.testing.assert_allclose(run.at(1.0)["stack.speed"], [outer, 4.5 - 2 * outer, outer], rtol=1e-9)
    # with a strong interface 1 and a weak interface 0 the last two move together: (4.5 - 1.4) / 2 = 1.55
    run = simulate(compose(Stack(load=(1.4, 1.6))), 1.0, inputs={"disk.1": 4.5}, accuracy=1e-10)
    np.testing.assert_allclose(run.at(1.0)["stack.speed"], [1.4, 1.55, 1.55], rtol=1e-9)
    assert run.time_in("stack.1", "stick") == 1.0


def test_spinning_disks_lock_one_after_the_other_at_the_times_of_straight_lines():
    # w = (6, 1, 0), no torque, interfaces 2 and 1: w' = (-2, +2 - 1, +1): slip 0 falls with 3 from 5, slip 1 stays 1 until t = 5/3;
    # then 0 and 1 are one disk of inertia 2 against disk 2: w' = -1/2 and 1, slip 1 falls with 3/2 from 1: t = 5/3 + 2/3
    run = simulate(compose(Stack(load=(2.0, 1.0))), 4.0, start={"stack.speed": (6.0, 1.0, 0.0)}, accuracy=1e-10)
    assert [(event.element, event.before, event.after) for event in run.events] == [
        ("stack.0", "slip+", "stick"),
        ("stack.1", "slip+", "stick"),
    ]
    np.testing.assert_allclose([event.time for event in run.events], [5 / 3, 7 / 3], rtol=1e-9)
    np.testing.assert_allclose(run.at(4.0)["stack.speed"], [7 / 3] * 3, rtol=1e-9)  # angular momentum 7 over 3 kg m2
    mode_is_consistent(run, [2.0, 1.0], [2.0, 1.0])


def test_two_interfaces_that_reach_zero_slip_at_one_instant_lock_together():
    # w = (1, 0, -1): both slips fall with the rate 1.5 from 1 for loads 1... w' = (-1, 0, 1): slip rates -1
    run = simulate(compose(Stack()), 3.0, start={"stack.speed": (1.0, 0.0, -1.0)}, accuracy=1e-10)
    assert {event.element for event in run.events} == {"stack.0", "stack.1"}
    assert len(run.events) == 2
    assert run.events[0].time == run.events[1].time == pytest.approx(1.0, rel=1e-9)
    assert np.abs(run.at(3.0)["stack.speed"]).max() < 1e-9


def test_a_symmetric_stack_is_released_at_both_interfaces_together():
    # a ramp of torque on the middle disk: each interface carries a third of it, bound 1 is met at 3 N m
    run = simulate(compose(Stack()), 2.0, inputs={"disk.1": ((0.0, 2.0), (0.0, 6.0))}, accuracy=1e-10)
    assert len(run.events) == 2
    assert run.events[0].time == run.events[1].time == pytest.approx(1.0, rel=1e-9)
    assert {(event.element, event.after) for event in run.events} == {("stack.0", "slip-"), ("stack.1", "slip+")}
    speed = run["stack.speed"]
    np.testing.assert_array_equal(speed[:, 0], speed[:, 2])
    # from then on: outer disks 1 rad/s2, the middle 3 t - 2
    np.testing.assert_allclose(run.at(2.0)["stack.speed"], [1.5, 0.5 + 4.5 - 2.0, 1.5], rtol=1e-8)


@pytest.mark.parametrize("kinetic", [1.0, 0.8, 0.3])
def test_a_symmetric_release_stays_symmetric_whatever_the_drop_of_friction(kinetic):
    run = simulate(
        compose(Stack(friction=Coulomb(static=1.0, kinetic=kinetic))), 2.0, inputs={"disk.1": ((0.0, 2.0), (0.0, 6.0))}, accuracy=1e-10
    )
    assert [event.time for event in run.events] == pytest.approx([1.0, 1.0], rel=1e-9)
    np.testing.assert_allclose(run.at(2.0)["stack.speed"], [0.5 + kinetic, 0.5 + 4.5 - 2 * kinetic, 0.5 + kinetic], rtol=1e-8)


def test_a_contact_that_can_hold_is_not_torn_loose_by_the_reversal_of_its_neighbour():
    # w = (1, 0, 0), -6 N m on disk 0, loads 1 and 0.4, kinetic 0.7: interface 0 slips forward, then backward; the disks behind need
    # -0.35 and then +0.35 N m of interface 1, always within 0.4. (If all stuck it would need 2 N m, but they do not all stick.)
    plant = compose(Stack(load=(1.0, 0.4), friction=Coulomb(static=1.0, kinetic=0.7)))
    run = simulate(plant, 1.0, start={"stack.speed": (1.0, 0.0, 0.0)}, inputs={"disk.0": -6.0}, accuracy=1e-10)
    assert [(event.element, event.before, event.after) for event in run.events] == [("stack.0", "slip+", "slip-")]
    reversal = 1 / 7.05
    assert run.events[0].time == pytest.approx(reversal, rel=1e-9)
    np.testing.assert_allclose(run.at(1.0)["stack.speed"][1:], 0.35 * reversal - 0.35 * (1 - reversal), rtol=1e-9)


def test_one_interface_locks_while_the_other_goes_on_slipping_and_momentum_is_kept():
    run = simulate(compose(Stack(inertia=(2.0, 1.0, 3.0), load=(4.0, 0.5))), 6.0, start={"stack.speed": (3.0, -1.0, 0.0)}, accuracy=1e-10)
    momentum = run["stack.speed"] @ [2.0, 1.0, 3.0]
    np.testing.assert_allclose(momentum, 5.0, rtol=1e-12)
    energy = run["stack.speed"] ** 2 @ [1.0, 0.5, 1.5]
    assert np.all(np.diff(energy) <= 1e-12)  # friction only takes
    # what friction took: kinetic torque times the angle slipped, by the trapezoidal rule on straight lines between nodes
    power = sum(np.abs(run[f"stack.{i}.slip"]) * (4.0, 0.5)[i] for i in range(2))
    lost = np.sum(np.diff(run.time) * (power[1:] + power[:-1]) / 2)
    assert energy[0] - energy[-1] == pytest.approx(lost, rel=1e-9)


# --- an independent method: all modes enumerated, motion in closed form between switches


class Enumerated:
    """Disks with slips J w and Coulomb bounds under torques a sin(b t + c), piece by piece in closed form.

    In given modes forces and accelerations are affine in the torque, so that speeds follow from the impulse of the torque, without any
    integration; the first guard to fall is found on a grid of 1 ms and by bisection. Contacts at zero slip take the consistent set of
    modes with the most sticking, out of all 3^n.
    """

    def __init__(self, inertia, jacobian, load, sines, static, kinetic):
        self.inverse, self.jacobian = 1 / np.array(inertia), np.array(jacobian, float)
        self.static, self.kinetic = static * np.array(load), kinetic * np.array(load)
        self.size, self.rate, self.phase = np.array(sines).T
        self.gain = (self.jacobian * self.inverse) @ self.jacobian.T

    def torque(self, t):
        return self.size * np.sin(np.multiply.outer(t, self.rate) + self.phase)

    def impulse(self, t):
        return -self.size / self.rate * np.cos(np.multiply.outer(t, self.rate) + self.phase)

    def force(self, modes):
        """F = G torque + f."""
        n, disks = self.jacobian.shape
        g, f = np.zeros((n, disks)), -np.array(modes) * self.kinetic
        stuck = [i for i, m in enumerate(modes) if m == 0]
        if stuck:
            block = self.gain[np.ix_(stuck, stuck)]
            g[stuck] = -np.linalg.solve(block, (self.jacobian * self.inverse)[stuck])
            f[stuck] = -np.linalg.solve(block, (self.gain @ f)[stuck])
        return g, f

    def acceleration(self, modes):
        """w' = Q torque + q."""
        g, f = self.force(modes)
        return self.inverse[:, None] * (np.eye(len(self.inverse)) + self.jacobian.T @ g), self.inverse * (self.jacobian.T @ f)

    def decide(self, t, modes, free):
        found = []
        for trial in itertools.product((0, 1, -1), repeat=len(free)):
            candidate = np.array(modes, int)
            candidate[free] = trial
            (g, f), (q, q0) = self.force(candidate), self.acceleration(candidate)
            force, rate = g @ self.torque(t) + f, self.jacobian @ (q @ self.torque(t) + q0)
            if all(abs(force[i]) <= self.static[i] if m == 0 else m * rate[i] > 0 for i, m in zip(free, trial, strict=True)):
                found.append(candidate)
        return min(found, key=lambda candidate: np.abs(candidate[free]).sum())

    def run(self, duration, w):
        t, w, soon = 0.0, np.array(w, float), 1e-6  # modes are decided by the forces a moment later
        modes = np.sign(self.jacobian @ w).astype(int)
        modes, switches = self.decide(soon, modes, [i for i, m in enumerate(modes) if m == 0]), []
        while True:
            (g, f), (q, q0) = self.force(modes), self.acceleration(modes)

            def speed(s, q=q, q0=q0, t=t, w=w):
                return w + (self.impulse(s) - self.impulse(t)) @ q.T + np.multiply.outer(s - t, q0)

            def guards(s, g=g, f=f, modes=modes, speed=speed):
                held = self.static - np.abs(self.torque(s) @ g.T + f)
                return np.where(modes == 0, held, modes * (speed(s) @ self.jacobian.T))

            grid = np.append(np.arange(t + soon, duration, 1e-3), duration)
            below = np.flatnonzero((guards(grid) < 0).any(axis=1))
            if not below.size:
                return switches, speed(duration)
            low, high = (grid[below[0] - 1] if below[0] else t), grid[below[0]]
            when = brentq(lambda s, guards=guards: guards(s).min(), low, high, xtol=1e-14) if below[0] else high
            w = speed(when)
            free = [i for i, m in enumerate(modes) if m == 0 or abs(guards(when)[i]) < 1e-9]
            rows = self.jacobian[free]
            w = w - (self.inverse[:, None] * rows.T) @ np.linalg.solve((rows * self.inverse) @ rows.T, rows @ w)
            after = self.decide(when + soon, modes, free)
            switches += [(when, i, int(x), int(y)) for i, (x, y) in enumerate(zip(modes, after, strict=True)) if x != y]
            t, modes = when, after


NAMES = {0: "stick", 1: "slip+", -1: "slip-"}


@pytest.mark.parametrize("load", [(1.0, 1.0), (1.0, 0.6), (0.5, 1.2)])
@pytest.mark.parametrize("kinetic", [1.0, 0.7])
def test_a_stack_of_three_agrees_with_the_enumeration_of_all_modes(load, kinetic):
    inertia, sines = (1.0, 0.7, 1.5), [(2.5, 2.0, 0.0), (1.5, 3.1, 1.0), (1.0, 1.7, 4.0)]
    switches, end = Enumerated(inertia, [[1, -1, 0], [0, 1, -1]], load, sines, 1.0, kinetic).run(8.0, [0.0, 0.0, 0.0])
    inputs = {f"disk.{i}": a * ca.sin(b * time + c) for i, (a, b, c) in enumerate(sines)}
    plant = compose(Stack(inertia=inertia, load=load, friction=Coulomb(static=1.0, kinetic=kinetic)))
    run = simulate(plant, 8.0, inputs=inputs, accuracy=1e-10)
    mode_is_consistent(run, load, kinetic * np.array(load))
    expected = [(f"stack.{i}", NAMES[a], NAMES[b]) for _, i, a, b in switches]
    assert [(event.element, event.before, event.after) for event in run.events] == expected
    assert len(expected) >= 6
    np.testing.assert_allclose([event.time for event in run.events], [t for t, *_ in switches], atol=1e-7)
    np.testing.assert_allclose(run.at(8.0)["stack.speed"], end, atol=1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_a_stack_of_five_under_random_sines_agrees_with_the_enumeration_of_all_modes(seed):
    n, rng = 5, np.random.default_rng(seed)
    inertia, load, kinetic = rng.uniform(0.5, 2.0, n), rng.uniform(0.3, 1.2, n - 1), rng.uniform(0.5, 1.0)
    sines = np.column_stack([rng.uniform(-3, 3, n), rng.uniform(1, 4, n), rng.uniform(0, 6, n)])
    jacobian = np.eye(n)[:-1] - np.eye(n)[1:]
    switches, end = Enumerated(inertia, jacobian, load, sines, 1.0, kinetic).run(5.0, np.zeros(n))
    inputs = {f"disk.{i}": a * ca.sin(b * time + c) for i, (a, b, c) in enumerate(sines)}
    plant = compose(Stack(inertia=tuple(inertia), load=tuple(load), friction=Coulomb(static=1.0, kinetic=kinetic)))
    run = simulate(plant, 5.0, inputs=inputs, accuracy=1e-10)
    mode_is_consistent(run, load, kinetic * load)
    assert [(event.element, event.before, event.after) for event in run.events] == [
        (f"stack.{i}", NAMES[a], NAMES[b]) for _, i, a, b in switches
    ]
    assert len(switches) >= 6
    np.testing.assert_allclose([event.time for event in run.events], [t for t, *_ in switches], atol=1e-6)
    np.testing.assert_allclose(run.at(5.0)["stack.speed"], end, atol=1e-6)


# --- another: Moreau's time stepping with projected Gauss-Seidel


def moreau_jean(mass, jacobian, bound, torque, duration, v, steps):
    """Speeds at the end by v+ = v + M^-1 (h torque + J^T p), |p_i| <= h bound_i, p_i against (J v+)_i."""
    h, v = duration / steps, np.array(v, float)
    jacobian, inverse = np.array(jacobian, float), 1 / np.array(mass)
    delassus = (jacobian * inverse) @ jacobian.T
    p = np.zeros(len(bound))
    for k in range(steps):
        free = jacobian @ (v + h * inverse * torque((k + 0.5) * h))
        for _ in range(60):
            before = p.copy()
            for i in range(len(p)):
                p[i] = min(max(p[i] - (free[i] + delassus[i] @ p) / delassus[i, i], -h * bound[i]), h * bound[i])
            if np.abs(p - before).max() < 1e-13 * h:
                break
        v = v + inverse * (h * torque((k + 0.5) * h) + jacobian.T @ p)
    return v


@pytest.mark.parametrize("load", [(1.0, 1.0), (1.0, 0.4)])
def test_a_stack_of_three_agrees_with_moreaus_time_stepping_in_the_limit(load):
    inertia, jacobian = (1.0, 0.7, 1.5), [[1, -1, 0], [0, 1, -1]]

    def torque(t):
        return np.array([2.5 * math.sin(2 * t), 0.0, -1.5 * math.sin(1.3 * t)])

    run = simulate(compose(Stack(inertia=inertia, load=load)), 4.0, accuracy=1e-9,
                   inputs={"disk.0": 2.5 * ca.sin(2 * time), "disk.2": -1.5 * ca.sin(1.3 * time)})  # fmt: skip
    exact = run.at(4.0)["stack.speed"]
    errors = [np.abs(moreau_jean(inertia, jacobian, load, torque, 4.0, [0, 0, 0], steps) - exact).max() for steps in (400, 1600)]
    # each switch inside a step costs up to the step times a change of acceleration; the mean shrinks with the step
    assert errors[1] < 5e-3
    assert errors[1] < errors[0]


def test_a_stack_of_ten_under_random_torques_is_consistent_everywhere_and_agrees_with_time_stepping():
    n = 10
    rng = np.random.default_rng(5)
    inertia, load = rng.uniform(0.5, 2.0, n), rng.uniform(0.2, 1.0, n - 1)
    size, rate, phase = rng.uniform(-2, 2, n), rng.uniform(1, 4, n), rng.uniform(0, 6, n)
    plant = compose(Stack(inertia=tuple(inertia), load=tuple(load)))
    inputs = {f"disk.{i}": size[i] * ca.sin(rate[i] * time + phase[i]) for i in range(n)}
    run = simulate(plant, 4.0, inputs=inputs, accuracy=1e-8)
    mode_is_consistent(run, load, load)
    assert len(run.events) > 20
    jacobian = np.eye(n)[:-1] - np.eye(n)[1:]
    end = moreau_jean(inertia, jacobian, load, lambda t: size * np.sin(rate * t + phase), 4.0, np.zeros(n), 2000)
    np.testing.assert_allclose(run.at(4.0)["stack.speed"], end, atol=0.02)


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
def test_no_switch_of_a_stack_is_lost_at_loose_accuracy(accuracy):
    # distinct loads and smooth torques: the sequence of modes belongs to the machine, not to the tolerance
    inputs = {"disk.0": 2.5 * ca.sin(2 * time), "disk.2": -1.5 * ca.sin(1.3 * time)}
    plant = compose(Stack(inertia=(1.0, 0.7, 1.5), load=(1.0, 0.6)))
    run, best = (simulate(plant, 6.0, inputs=inputs, accuracy=a) for a in (accuracy, 1e-11))
    assert [(e.element, e.before, e.after) for e in run.events] == [(e.element, e.before, e.after) for e in best.events]


def test_energy_and_work_balance_across_the_events_of_a_sprung_stack():
    # kinetic energy plus spring energy plus friction work = work of the torque, with constant kinetic torques
    plant = compose(Stack(inertia=(1.0, 0.5, 0.8), load=(0.8, 0.5), stiffness=20.0, friction=Coulomb(static=1.0, kinetic=0.6)))
    run = simulate(plant, 6.0, start={"stack.speed": (1.0, 0.0, 0.0)}, inputs={"disk.0": 1.5 * ca.cos(3 * time)}, accuracy=1e-11)
    assert len(run.events) > 5
    grid = np.unique(np.concatenate([np.linspace(a, b, 41) for a, b in itertools.pairwise(run.time) if b > a]))
    at = run.at(grid)
    speed, angle = at["stack.speed"], at["stack.angle"]
    energy = speed**2 @ [0.5, 0.25, 0.4] + 10 * angle**2
    power = 1.5 * np.cos(3 * grid) * speed[:, 0]
    for i, load in enumerate((0.8, 0.5)):
        power = power - 0.6 * load * np.abs(speed[:, i] - speed[:, i + 1])  # zero in stick
    work = np.cumsum(np.diff(grid) * (power[1:] + power[:-1]) / 2)
    # the trapezoidal rule on 40 pieces a step
    np.testing.assert_allclose(energy[1:] - energy[0], work, atol=1e-4 * np.abs(energy).max())


# --- structure


def test_forces_of_a_stuck_stack_solve_the_tridiagonal_balance():
    # all stuck: every disk has the acceleration of the whole, interface i carries what the disks behind it need
    inertia, torque = np.array([1.0, 2.0, 0.5, 3.0, 1.5]), np.array([0.3, -0.2, 0.5, 0.1, -0.4])
    plant = compose(Stack(inertia=tuple(inertia), load=(5.0,) * 4))
    run = simulate(plant, 1.0, inputs={f"disk.{i}": torque[i] for i in range(5)})
    together = torque.sum() / inertia.sum()
    for i in range(4):
        behind = (inertia[i + 1 :] * together - torque[i + 1 :]).sum()
        assert run.at(0.5)[f"stack.{i}.force"] == pytest.approx(-behind, rel=1e-12)
    np.testing.assert_allclose(run.at(1.0)["stack.speed"], together, rtol=1e-13)


def test_a_contact_whose_force_cannot_act_on_its_slip_is_refused():
    class Idle(Component):
        def equations(self, signal):
            x, v = state("idle.x", "m"), state("idle.v", "m/s")
            pad = DryFriction("idle", x, Coulomb())  # relative degree two
            return Equations(flow={x: v, v: pad.force}, elements=[pad])

    with pytest.raises(SceneError, match="idle"):
        compose(Idle())


def test_a_contact_whose_force_drives_its_slip_is_refused():
    class Wrong(Component):
        def equations(self, signal):
            v = state("wrong.v", "m/s")
            pad = DryFriction("wrong", v, Coulomb())
            return Equations(flow={v: -pad.force}, elements=[pad])

    with pytest.raises(SceneError, match="wrong"):
        compose(Wrong())


def test_a_force_that_enters_nonlinearly_is_refused():
    class Squared(Component):
        def equations(self, signal):
            v = state("squared.v", "m/s")
            pad = DryFriction("squared", v, Coulomb())
            return Equations(flow={v: pad.force + 0.1 * pad.force**2}, elements=[pad])

    with pytest.raises(SceneError, match="affine"):
        compose(Squared())


def test_two_contacts_on_one_slip_are_refused_or_share_the_force():
    # parallel contacts of one slip have a singular balance when both stick; nobody can say who carries what
    class Twin(Component):
        def equations(self, signal):
            v = state("twin.v", "m/s")
            pads = [DryFriction(f"twin.{i}", v, Coulomb(static=1.0, kinetic=0.8)) for i in range(2)]
            force = signal("twin.force", "N", default=0.0)
            return Equations(flow={v: force + pads[0].force + pads[1].force}, elements=pads)

    try:
        run = simulate(compose(Twin()), 3.0, start={"twin.v": 0.8}, inputs={"twin.force": 1.0})
    except (SceneError, RuntimeError):
        return
    assert np.isfinite(run["twin.v"]).all()
    assert run.at(3.0)["twin.v"] == 0.0  # 1 - 1.6 brakes it, and 1 <= 2 holds it


def test_a_normal_load_may_be_the_force_of_an_earlier_contact():
    # a wedge: the second contact is pressed by the friction of the first, 0.5 |F_1|... here by 2 - F_1, affine and positive
    class Pressed(Component):
        def equations(self, signal):
            a, b = state("pressed.a", "m/s"), state("pressed.b", "m/s")
            first = DryFriction("first", a, Coulomb(static=1.0, kinetic=0.8))
            second = DryFriction("second", b, Coulomb(static=0.5, kinetic=0.4), 2 - first.force)
            return Equations(flow={a: signal("push.a", "N", default=0.0) + first.force, b: signal("push.b", "N", default=0.0) + second.force},
                             elements=[first, second])  # fmt: skip

    # a slides forward: F_1 = -0.8, load 2.8, kinetic 1.12: b loses 1.12 m/s per second
    run = simulate(compose(Pressed()), 1.0, start={"pressed.a": 2.0, "pressed.b": 2.0}, accuracy=1e-10)
    assert run.at(1.0)["pressed.b"] == pytest.approx(2.0 - 1.12, rel=1e-9)
    assert run.at(1.0)["pressed.a"] == pytest.approx(1.2, rel=1e-9)
    # a held by F_1 = -0.6: bound of the second is 0.5 * 2.6 = 1.3
    plant = compose(Pressed())
    assert simulate(plant, 1.0, inputs={"push.a": 0.6, "push.b": 1.29}).time_in("second", "stick") == 1.0
    assert simulate(plant, 1.0, inputs={"push.a": 0.6, "push.b": 1.31}).time_in("second", "stick") == 0.0
