"""Impacts of several rigid contacts at once, against all ways of them enumerated."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
import pytest

from models import Coulomb
from toolbox import Component, DryFriction, Equations, UnilateralContact, compose, quantity, simulate, state

SIZE = 6
GAP = 1e-3


@dataclass(frozen=True)
class Corner(Component):
    """A point of mass 1 in six dimensions that slides along all of its walls but the first, which it meets."""

    normals: tuple[float, ...] = quantity(tuple(np.eye(6)[:3].ravel().tolist()), "1", "of the walls, one after the other")
    tangents: tuple[float, ...] = quantity(tuple(np.eye(6)[3:].ravel().tolist()), "1", "ways along which they rub")
    push: tuple[float, ...] = quantity((0.0,) * SIZE, "m/s2", "what holds the point at the walls")
    friction: tuple[float, ...] = quantity((0.0,) * 3, "1")
    restitution: float = quantity(0.5, "1")
    walls: int = 3
    rough: bool = True

    def equations(self, signal):
        x, v = state("point.x", "m", SIZE), state("point.v", "m/s", SIZE)
        rate, elements = ca.vertcat(*self.push), []
        for i in range(self.walls):
            normal, tangent = (ca.vertcat(*given[SIZE * i : SIZE * (i + 1)]) for given in (self.normals, self.tangents))
            wall = UnilateralContact(f"wall{i}", ca.dot(normal, x) - GAP * (i == 0), ca.dot(normal, v), restitution=self.restitution)
            elements.append(wall)
            rate -= normal * wall.force
            if self.rough:
                rub = DryFriction(
                    f"rub{i}", ca.dot(tangent, v), Coulomb(static=self.friction[i], kinetic=self.friction[i]), load=wall.force
                )
                elements.append(rub)
                rate += tangent * rub.force
        return Equations(flow={x: v, v: rate}, elements=elements)


@cache
def corner(walls, rough):
    return compose(Corner(walls=walls, rough=rough))


def agree(normals, tangents, friction, before, after, wanted, close=1e-9):
    """Whether a point has after an impact a speed that Coulomb's law and a restitution allow; wanted: slowest speeds into the walls.

    The impulses follow from the change of speed, as normals and tangents are independent.
    """
    found = np.linalg.lstsq(np.hstack([-normals.T, tangents.T]), after - before, rcond=None)[0]
    push, rub = np.split(found, [len(normals)])
    into, slip = normals @ after, tangents @ after
    good = (push > -close).all() and (into < wanted + close).all() and (np.abs(push * (into - wanted)) < close).all()
    if len(tangents):
        slides = (rub * slip < close) & (np.abs(rub) > friction * push - close)
        good &= bool(((np.abs(rub) < friction * push + close) & ((np.abs(slip) < close) | slides)).all())
    return good and np.allclose(before + np.hstack([-normals.T, tangents.T]) @ found, after, atol=close)


def solutions(normals, tangents, friction, before, wanted):
    """All speeds after an impact that agree: every wall held or let go, its friction holding or sliding one way or the other."""
    found = []
    for ways in itertools.product(("free", 0, 1, -1) if len(tangents) else ("free", 0), repeat=len(normals)):
        held = [i for i, way in enumerate(ways) if way != "free"]
        stuck = [i for i in held if ways[i] == 0] if len(tangents) else []
        columns = [-normals[i] - (ways[i] * friction[i] * tangents[i] if ways[i] else 0.0) for i in held] + [tangents[i] for i in stuck]
        after = before
        if held:
            rows, acting = np.array([normals[i] for i in held] + [tangents[i] for i in stuck]), np.array(columns).T
            right = np.array([wanted[i] for i in held] + [0.0] * len(stuck)) - rows @ before
            after = before + acting @ np.linalg.solve(rows @ acting, right)
        if agree(normals, tangents, friction, before, after, wanted, 1e-8):
            found.append(after)
    return found


def impacts(count, walls, rough, seed):
    """(normals, tangents, friction, restitution, speed before, speed after) of impacts at random, of which every second one is in a narrow corner."""
    random = np.random.default_rng(seed)
    while count:
        both = random.standard_normal((2, 3, SIZE)) + random.standard_normal(SIZE) * (count % 2)
        both[0, 1:, 2:] = 0.0  # so that a point without speed in the first two dimensions slides along these walls, without round-off
        normals, tangents = both / np.linalg.norm(both, axis=2)[:, :, None]
        if abs(np.linalg.det(normals[1:, :2])) < 0.3:  # so near to parallel that friction may jam the point between them
            continue
        friction, restitution = random.uniform(0, 0.3, 3), random.choice([0.0, random.uniform(0, 1)])
        now = normals[:walls]
        speed = random.standard_normal(SIZE)
        speed[:2] = 0.0
        speed += normals[0] * (np.arange(SIZE) > 1) * (1.0 - normals[0] @ speed) / (normals[0, 2:] @ normals[0, 2:])
        numbers = {
            "point.normals": normals.ravel(), "point.tangents": tangents.ravel(), "point.restitution": restitution, "point.friction": friction,
            "point.push": np.linalg.pinv(now) @ (0.5 - 0.5 * np.eye(walls)[0]),
        }  # fmt: skip
        run = simulate(corner(walls, rough), 4 * GAP, start={"point.v": speed}, parameters=numbers, accuracy=1e-10)
        jumps = [i for i in np.flatnonzero(np.diff(run.time) == 0.0) if np.abs(run["point.v"][i + 1] - run["point.v"][i]).max() > 1e-6]
        before, after = run["point.v"][jumps[0]], run["point.v"][jumps[0] + 1]
        if not np.abs((now @ before)[1:]).max() < 1e-9:  # friction has taken the point off a wall
            continue
        count -= 1
        yield now, tangents[: walls if rough else 0], friction[:walls], restitution, before, after


@pytest.mark.parametrize("walls", [2, 3])
@pytest.mark.parametrize("rough", [False, True])
def test_impulses_agree_with_all_contacts_as_one_of_all_ways_does(walls, rough):
    for normals, tangents, friction, restitution, before, after in impacts(75, walls, rough, seed=walls):
        into = np.maximum(normals @ before, 0.0) * (np.arange(walls) == 0)
        elastic, plastic = (
            [each for each in solutions(normals, tangents, friction, before, wanted) if each @ each <= before @ before * (1 + 1e-9)]
            for wanted in (-restitution * into, 0.0 * into)
        )
        assert any(np.allclose(after, each, atol=1e-7) for each in elastic or plastic)
        assert rough or len(elastic) == 1


@dataclass(frozen=True)
class Row(Component):
    """Bodies above one another that meet their neighbours, the lowest also the floor where there is one."""

    masses: tuple[float, ...] = quantity((1.0,) * 3, "kg")
    restitution: float = quantity(0.5, "1")
    gravity: float = quantity(0.0, "m/s2")
    count: int = 3
    floor: bool = True

    def equations(self, signal):
        x, v = state("row.x", "m", self.count), state("row.v", "m/s", self.count)
        forces, elements = [-mass * self.gravity for mass in ca.vertsplit(ca.vertcat(*self.masses))], []
        for i in range(0 if self.floor else 1, self.count):
            below, slower = (x[i - 1], v[i - 1]) if i else (0.0, 0.0)
            meets = UnilateralContact(f"contact{i}", below - x[i], slower - v[i], restitution=self.restitution)
            elements.append(meets)
            forces[i] += meets.force
            if i:
                forces[i - 1] -= meets.force
        return Equations(flow={x: v, v: ca.vertcat(*forces) / ca.vertcat(*self.masses)}, elements=elements)


@cache
def row(count, floor=True):
    return compose(Row(masses=(1.0,) * count, count=count, floor=floor))


@pytest.mark.parametrize("restitution", [0.01, 0.05, 0.0715, 0.08, 0.2])
def test_three_bodies_end_together_where_restitution_is_too_low_to_part_them(restitution):
    # of three equal bodies the middle one is struck without end below 7 - 4 sqrt(3), and some times above (McNamara and Young, 1992)
    speeds = np.array([3.0, 0.5, -2.4])
    run = simulate(row(3, floor=False), 3.0, start={"row.x": (1.0, 2.0, 3.0), "row.v": speeds}, parameters={"row.restitution": restitution})
    apart = np.ptp(run["row.v"][-1])
    assert (apart < 1e-9) == (restitution < 7.0 - 4.0 * np.sqrt(3.0))
    assert run["row.v"][-1].mean() == pytest.approx(speeds.mean(), rel=1e-9)


def test_bodies_that_collapse_onto_the_floor_lie_there_and_never_gain_energy():
    random, rested = np.random.default_rng(0), 0
    for _ in range(60):
        count, restitution = int(random.integers(2, 6)), random.uniform(0.0, 0.9)
        masses, start = 10 ** random.uniform(-1.5, 1.5, count), np.sort(random.uniform(0.5, 9.5, count))
        numbers = {"row.masses": masses, "row.restitution": restitution, "row.gravity": 9.81}
        run = simulate(row(count), 12.0, start={"row.x": start, "row.v": 3.0 * random.standard_normal(count)}, parameters=numbers)
        x, v = run["row.x"], run["row.v"]
        energy = (0.5 * masses * v**2 + 9.81 * masses * x).sum(axis=1)
        assert np.diff(energy).max() < 1e-9 * energy[0]
        assert x[:, 0].min() > -1e-9 and np.diff(x, axis=1).min() > -1e-9
        rested += bool((v[-1] == 0.0).all())
    assert rested >= 40


@dataclass(frozen=True)
class Wagons(Component):
    """A row of wagons without springs; the first is braked by a constant force."""

    masses: tuple[float, float, float] = quantity((1.0, 1.0, 1.0), "kg")
    gaps: tuple[float, float] = quantity((1.0, 1.0), "m", "between the wagons where all positions are zero")
    brake: float = quantity(1.0, "N", "against the motion of the first wagon")
    restitution: float = quantity(0.0, "1")

    def equations(self, signal):
        x, v = state("row.x", "m", 3), state("row.v", "m/s", 3)
        buffers = [
            UnilateralContact(f"buffer{i}", x[i] - x[i + 1] - self.gaps[i], v[i] - v[i + 1], restitution=self.restitution) for i in range(2)
        ]
        first, second = (buffer.force for buffer in buffers)
        force = ca.vertcat(-self.brake - first, first - second, second)
        return Equations(flow={x: v, v: force / ca.vertcat(*self.masses)}, elements=buffers)


@cache
def wagons():
    return compose(Wagons())


@pytest.mark.parametrize("method", ["taylor", "explicit", "stiff"])
@pytest.mark.parametrize("later", [0.0, 1e-11, 4e-9, 1e-7, 1e-4])
def test_a_wagon_that_is_hit_right_after_it_was_pushed_hits_the_first_one_again(later, method):
    """The first wagon runs into the second; the third hits the second `later`, when the brake has hardly opened the gap to the first.

    Without restitution and with no force but the brake, all three then have the speed that their momentum gives. The brake parts the first from the others,
    which go on at that speed.
    """
    for seed in range(4):
        random = np.random.default_rng(seed)
        masses, brake, gap = random.uniform(1, 3, 3), random.uniform(1, 3), random.uniform(0.05, 0.2)
        before, duration = np.array([*random.uniform(1.0, 1.3, 1), 0.2, -1.5]), 3.0
        slows = brake / masses[0]
        falls = before[0] - before[1]  # the gap to the second falls at first at this speed, and by `slows` less
        first = 2 * gap / (falls + np.sqrt(falls**2 - 2 * slows * gap))
        common = (masses[0] * (before[0] - slows * first) + masses[1] * before[1]) / (masses[0] + masses[1])
        second = first + later
        positions = np.array([gap + before[1] * first, before[1] * first + common * later, before[2] * second])
        run = simulate(
            wagons(),
            duration,
            start={"row.v": before},
            parameters={"row.masses": masses, "row.gaps": [gap, positions[1] - positions[2]], "row.brake": brake},
            method=method,
        )
        after = (masses @ before - brake * second) / masses.sum()
        # between both impacts the brake has parted the first wagon from the second, by what it catches up in at most
        catches_up = slows * later**2
        close = 1e-7 + 10 * catches_up
        left = duration - second
        np.testing.assert_allclose(run["row.v"][-1], [after - slows * left, after, after], atol=close)
        np.testing.assert_allclose(run["row.x"][-1, 1], positions[1] + after * left, atol=close * left)
        assert max(run["buffer0.closure"].max(), run["buffer1.closure"].max()) < 1e-9
        assert {event.element for event in run.events} == {"buffer0", "buffer1"}
