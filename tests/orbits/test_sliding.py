"""The sliding bifurcations of a driven block on a belt, against the piecewise linear boundary value problem that each of them solves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import fsolve

from models import BlockOnBelt, Coulomb
from toolbox import closed_loop, compose, follow, limit_cycle
from toolbox.inputs import sine
from toolbox.orbits.sliding import segments, sliding_kind

# m x'' + c x' + k x = A sin(om t) + R,  |R| <= 1 on a belt at speed V: static friction as kinetic, a Filippov system
C, K, OM, V = 0.1, 1.0, 0.5, 0.5
PERIOD = 2 * np.pi / OM


def slipped(x, v, begin, end, A, R):
    """Position and speed at `end` of a block that slips under the friction force R from `begin` on: a sine, a constant, and a decaying rotation."""

    def driven(t):
        z = A * np.exp(1j * OM * t) / (K - OM**2 + 1j * C * OM)
        return z.imag + R / K, (1j * OM * z).imag

    root = -C / 2 + 1j * np.sqrt(K - C**2 / 4)
    x0, v0 = np.array([x, v]) - driven(begin)
    b = complex(x0, (C / 2 * x0 + v0) / -root.imag) * np.exp(root * (end - begin))  # x = Re b, with b' = root b
    x1, v1 = driven(end)
    return x1 + b.real, v1 + (root * b).real


def bifurcation(modes, touch, z):
    """(A, position at the first switch, times of the switches, ...) of the motion of period 2 pi / om with these modes that fulfils `touch` besides.

    Every segment begins on the belt's speed. A stick ends where it needs the friction that its slip will have, a slip on the belt's speed.
    touch: (z, A, times, positions) -> what is zero besides: one number, or two where z has an unknown more.
    """

    def equations(z):
        A, x = z[:2]
        times = np.append(z[2 : 2 + len(modes)], z[2] + PERIOD)
        positions, wrong = [x], []
        for k, mode in enumerate(modes):
            begin, end = times[k], times[k + 1]
            if mode == 0:
                x = x + V * (end - begin)
                wrong.append(needed(A, end, x) + modes[(k + 1) % len(modes)])
            else:
                x, v = slipped(x, V, begin, end, A, -mode)
                wrong.append(v - V)
            positions.append(x)
        return [*wrong, x - positions[0], *np.atleast_1d(touch(z, A, times, positions))]

    found, _, ok, why = fsolve(equations, z, xtol=1e-13, full_output=True)
    assert ok == 1 or np.abs(equations(found)).max() < 1e-10, why
    return found


def needed(A, t, x):
    """Friction that keeps the block on the belt."""
    return K * x + C * V - A * np.sin(OM * t)


def stick_at_its_bound(z, A, times, positions):
    """In the stick, segment 0, the friction needed touches -1 at the time z[-1]."""
    t = z[-1]
    return needed(A, t, positions[0] + V * (t - times[0])) + 1, K * V - A * OM * np.cos(OM * t)


def slip_at_the_belts_speed(z, A, times, positions):
    """In the slip of segment 0, whose friction is -1, the speed touches that of the belt at the time z[-1], and the acceleration is zero."""
    t = z[-1]
    x, v = slipped(positions[0], V, times[0], t, A, -1.0)
    return v - V, needed(A, t, x) + 1.0


def at_the_bound(event, bound):
    """At a switch the friction that would keep the block on the belt is as large as the bound."""
    return lambda z, A, times, positions: needed(A, times[event], positions[event]) - bound


# the modes on one side of each point, what holds there besides, about where to look for the solution, and the modes on both sides
THEORY = {
    "adding-sliding": ([0, -1], stick_at_its_bound, (1.5, -1.9, -2.3, 5.1, 1.7), ([0, -1], [0, 1, 0, -1])),
    "crossing-sliding": ([1, -1, 0], at_the_bound(1, 1.0), (3.54, -4.2, -2.1, 3.2, 9.6), ([1, 0, -1, 0], [1, -1, 0])),
    "switching-sliding": ([1, -1, 0], at_the_bound(2, -1.0), (3.61, -4.3, -2.2, 3.2, 9.6), ([1, -1, 0], [1, -1, 1, 0])),
    "grazing-sliding": ([1, -1], slip_at_the_belts_speed, (3.77, -5.0, -2.9, 3.2, -2.4), ([1, -1, 1, 0], [1, -1])),
}


@pytest.fixture(scope="module")
def branch():
    plant = compose(BlockOnBelt(mass=1.0, stiffness=K, damping=C, belt_speed=V, friction=Coulomb(static=1.0, kinetic=1.0)))
    cycle = limit_cycle(closed_loop(plant, inputs={"block.force": sine(0.0, 1.3, 1 / PERIOD)}), 20 * PERIOD)
    return follow(cycle, "block.force.amplitude", (1.0, 4.5), points=300)


def modes(run):
    return [mode for mode, _ in segments(run, 0)]


def around(sequence):
    """A sequence of modes in a form that does not depend on where it begins."""
    return min(sequence[i:] + sequence[:i] for i in range(len(sequence)))


def test_one_branch_of_a_driven_block_passes_all_four_sliding_bifurcations(branch):
    assert [point.kind for point in branch.bifurcations] == list(THEORY)
    assert branch.stable.all()


@pytest.mark.parametrize("kind", THEORY)
def test_a_sliding_bifurcation_lies_where_its_boundary_value_problem_says(branch, kind):
    sequence, touch, guess, _ = THEORY[kind]
    exact = bifurcation(sequence, touch, guess)[0]
    (found,) = [point.value for point in branch.bifurcations if point.kind == kind]
    assert found == pytest.approx(exact, abs=1e-7 * 3.5)  # of the span


@pytest.mark.parametrize("kind", THEORY)
def test_the_modes_on_both_sides_of_a_sliding_bifurcation_are_those_of_its_definition(branch, kind):
    exact = next(point.value for point in branch.bifurcations if point.kind == kind)
    below = max(i for i, value in enumerate(branch.values) if value < exact)
    one, other = branch.cycles[below].run, branch.cycles[below + 1].run
    assert (around(modes(one)), around(modes(other))) == tuple(map(around, THEORY[kind][3]))
    assert sliding_kind(one, other) == sliding_kind(other, one) == kind


@pytest.mark.slow
def test_a_slipping_block_grazes_where_its_linear_response_is_as_fast_as_the_belt():
    # slip alone is the response of a linear oscillator: speed amplitude A om / |k - om^2 + i c om|
    force = 2.0
    exact = force * OM / abs(K - OM**2 + 1j * C * OM)
    plant = compose(BlockOnBelt(mass=1.0, stiffness=K, damping=C, belt_speed=1.2 * exact, friction=Coulomb(static=1.0, kinetic=1.0)))
    slipping = limit_cycle(closed_loop(plant, inputs={"block.force": sine(0.0, force, 1 / PERIOD)}), 40 * PERIOD)
    assert modes(slipping.run) == [-1]
    (point,) = follow(slipping, "block.belt_speed", (0.9 * exact, 1.3 * exact), start_towards=0.9 * exact).bifurcations
    assert point.kind == "grazing-sliding"
    assert point.value == pytest.approx(exact, rel=1e-7)


def test_a_symmetric_motion_gains_both_its_stops_at_one_crossing_sliding():
    # on a belt at rest both reversals are alike: without stops x0 at the reversal solves x(pi / om) = -x0, v = 0; stops begin at |needed| = 1
    plant = compose(BlockOnBelt(mass=1.0, stiffness=K, damping=C, belt_speed=0.0, friction=Coulomb(static=1.0, kinetic=1.0)))
    cycle = limit_cycle(closed_loop(plant, inputs={"block.force": sine(0.0, 4.5, 1 / PERIOD)}), 20 * PERIOD)
    assert around(modes(cycle.run)) == [-1, 1]

    def equations(z):
        A, x0, t = z
        x, v = slipped(x0, 0.0, t, t + PERIOD / 2, A, 1.0)
        return x + x0, v, K * x0 - A * np.sin(OM * t) - 1.0

    exact = fsolve(equations, (3.5, 4.5, 3.2), xtol=1e-13)[0]
    (point,) = follow(cycle, "block.force.amplitude", (3.2, 4.6), start_towards=3.2).bifurcations
    assert point.kind == "crossing-sliding"
    assert point.value == pytest.approx(exact, rel=1e-6)
