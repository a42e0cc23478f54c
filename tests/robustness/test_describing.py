"""The describing function of a contact against closed forms, balances of torque, and the unstable cycle of the machine itself."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve

from controllers import SlidingMode, SoftTorque, StiffPI
from models import BitRock, BlockOnBelt, TorsionalChain, oscillators, wells
from models.friction import Coulomb, Exponential
from toolbox import Component, DryFriction, Equations, SceneError, closed_loop, compose, equilibrium, limit_cycle, simulate, state
from toolbox.robustness import describing_function

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
SOFT = closed_loop(RIG, SoftTorque(reference="40 rpm"))


def test_coulomb_friction_on_a_moving_belt_is_a_relay_with_a_bias():
    found = describing_function(
        closed_loop(compose(BlockOnBelt(friction=Coulomb(static=2.0, kinetic=2.0), load=1.0, belt_speed=0.5, damping=0.1)))
    )
    a = found.amplitude
    over = a > 0.5
    assert found.steady_slip == pytest.approx(-0.5, rel=1e-9) and 50 < over.sum() < a.size
    assert found.gain[~over] == pytest.approx(0.0, abs=1e-12)
    assert found.gain[over] == pytest.approx(-4 * 2.0 / (np.pi * a[over]) * np.sqrt(1 - (0.5 / a[over]) ** 2), rel=1e-9)
    assert not found.cycles and "no cycle is predicted" in str(found)


@pytest.mark.parametrize("static", [1.0, 2.0])
def test_a_rest_that_swings_undamped_cycles_where_friction_gives_and_takes_the_same(static):
    """G is infinite at sqrt(k / m), so that N(A) = 0 there: none for constant friction, whose N is 0 for all small A, and one for a law that falls."""
    constant = Coulomb(static=static, kinetic=1.0)
    assert not describing_function(closed_loop(compose(BlockOnBelt(mass=2.0, stiffness=8.0, friction=constant)))).cycles
    falling = Exponential(static=static, kinetic=0.5, decay=3.0)
    (cycle,) = describing_function(closed_loop(compose(BlockOnBelt(mass=2.0, stiffness=8.0, friction=falling)))).cycles
    angle = np.linspace(0.0, 2 * np.pi, 400_001)[:-1]
    slip = cycle.mean + cycle.amplitude * np.cos(angle)
    force = -np.sign(slip) * (0.5 + (static - 0.5) * np.exp(-3.0 * np.abs(slip)))
    assert cycle.period == pytest.approx(np.pi, rel=1e-9) and abs(np.mean(force * np.cos(angle))) < 1e-5


def test_what_is_left_is_the_machine_without_the_contact():
    found = describing_function(
        closed_loop(
            compose(BlockOnBelt(mass=2.0, stiffness=8.0, damping=0.3, friction=Coulomb(static=2.0, kinetic=2.0), load=1.0, belt_speed=0.5))
        )
    )
    s = 1j * found.omega
    assert found.linear_response == pytest.approx(s / (2.0 * s**2 + 0.3 * s + 8.0), rel=1e-9)


def test_a_small_harmonic_sees_the_slope_of_friction():
    found = describing_function(SOFT, highest=1e-3)
    rock = 97_347.0 * 0.155575
    speed = equilibrium(SOFT)["bit.speed"]
    slope = rock * (0.8 - 0.5) * 0.9 * np.exp(-0.9 * speed)  # of T = rock (0.5 + 0.3 exp(-0.9 w)), which falls
    assert found.gain[0] == pytest.approx(slope, rel=1e-6) and found.steady_slip == pytest.approx(speed)


def test_the_unstable_cycle_of_the_machine_is_the_one_that_is_predicted():
    found = describing_function(SOFT)
    unstable, stuck = found.cycles
    assert not unstable.stable and not unstable.sticks and stuck.stable and stuck.sticks
    still = equilibrium(SOFT)
    begin = {name: still[name] for name in still.plant.states} | {"chain.speed.1": still["bit.speed"] + 0.8 * unstable.amplitude}
    cycle = limit_cycle(SOFT.replace(start=begin), period=unstable.period)
    low, high = cycle.extremes("bit.speed")
    assert not cycle.stable and low > 0.0
    assert unstable.period == pytest.approx(cycle.period, rel=0.03)
    assert unstable.amplitude == pytest.approx((high - low) / 2, rel=0.02)


@pytest.mark.parametrize(("law", "attracts", "other"), [(StiffPI, 15.8, 6.053), (SlidingMode, 5.955, 19.49)])
def test_a_cycle_on_which_another_swing_grows_does_not_attract(law, attracts, other):
    """Two swings of this string meet the friction where its gain falls; a run that ends in stick-slip ends in the other one."""
    loop = closed_loop(compose(wells.NAVARRO_LOPEZ_4, BitRock(weight=97_347.0)), law(reference=4.0))
    found = describing_function(loop)
    stuck = {float(f"{each.period:.4g}"): each for each in found.cycles if each.sticks}
    goes, stays = stuck[other], stuck[attracts]
    assert stays.stable and stays.growing is None
    assert not goes.stable and 2 * np.pi / goes.growing == pytest.approx(attracts, rel=0.02)
    assert f"unstable, sticks, a swing of {2 * np.pi / goes.growing:.4g} s grows" in str(found)
    still = equilibrium(loop)
    begin = {name: still[name] for name in still.plant.states} | {"chain.speed.3": 0.0}
    cycle = limit_cycle(loop.replace(start=begin), 400.0)
    assert cycle.stable and abs(cycle.period - attracts) < 0.1 * attracts


@dataclass(frozen=True)
class NeedsFallingFriction(Component):
    """Slip over force s (s^2 - 2.4 s + 4) / D(s), with D + 0.1 times the numerator stable: what friction takes at large amplitudes makes this swing grow."""

    numerator: ClassVar[np.ndarray] = np.array([1.0, -2.4, 4.0, 0.0])
    denominator: ClassVar[np.ndarray] = np.polyadd(np.polymul([1.0, 0.02, 2.0], [1.0, 2.0, 6.0]), 0.1 * numerator)

    def equations(self, signal):
        x = [state(f"x{i}", "m/s") for i in range(4)]
        slip = sum(n * each for n, each in zip(self.numerator[::-1], x, strict=True)) - 1.0
        contact = DryFriction("contact", slip, Exponential(static=1.0, kinetic=0.5, decay=1.0), 1.0)
        last = contact.force - sum(d * each for d, each in zip(self.denominator[:0:-1], x, strict=True))
        return Equations(flow=dict(zip(x, [*x[1:], last], strict=True)), elements=[contact])


def test_a_falling_gain_does_not_hold_a_swing_that_friction_drives():
    loop = closed_loop(compose(NeedsFallingFriction()))
    (cycle,) = describing_function(loop).cycles
    assert not cycle.stable and cycle.growing is None
    w, still = cycle.frequency, equilibrium(loop)
    harmonic = cycle.amplitude / abs(np.polyval(NeedsFallingFriction.numerator, 1j * w))
    swings = []
    for part in (0.7, 1.4):
        begin = {f"x{i}": still[f"x{i}"] + part * harmonic * (1j * w) ** i for i in range(4)}
        run = simulate(loop.replace(start={name: value.real for name, value in begin.items()}), "200 s")
        late = run["contact.slip"][run.time > 190.0]
        swings.append((late.max() - late.min()) / 2.0)
    assert swings[0] < 0.5 * cycle.amplitude < 2.0 * cycle.amplitude < swings[1]


def test_without_integral_action_the_mean_moves_with_the_swing():
    torque = 9_700.0
    found = describing_function(closed_loop(RIG, inputs={"top.torque": torque}))
    assert found.cycles and "without a law" in str(found)
    angles = 2 * np.pi * (np.arange(200_000) + 0.5) / 200_000
    for each in found.cycles:
        speeds = each.mean + each.amplitude * np.cos(angles)
        rock = 97_347.0 * 0.155575 * np.mean(np.sign(speeds) * (0.5 + 0.3 * np.exp(-0.9 * np.abs(speeds))))
        assert torque == pytest.approx((425.0 + 50.0) * each.mean + rock, rel=1e-4)


def test_the_cycle_that_there_is_stands_beside_it_and_both_are_drawn():
    cycle = limit_cycle(SOFT, 200.0)
    found = describing_function(SOFT, cycle)
    assert found.given_cycle == (cycle.period, *cycle.extremes("bit.slip"))
    text = str(found)
    assert "attracts, sticks" in text and text.splitlines()[-1].split()[:2] == ["exact", f"{cycle.period:.4g}"] and "[rpm]" in text
    gains, plane = found.plot()
    assert len(gains.lines) == 5 and len(plane.lines) == 4


def test_what_has_no_describing_function_is_refused():
    with pytest.raises(SceneError, match="must be a cycle that `limit_cycle` found, but it is a dict"):
        describing_function(SOFT, {})
    with pytest.raises(SceneError, match="Argument `highest`"):
        describing_function(SOFT, highest=0.0)
    stuck = compose(BlockOnBelt(friction=Exponential(static=0.8, kinetic=0.5, decay=0.9), belt_speed=0.0))
    with pytest.raises(SceneError, match="must let `belt` slide at steady running, but it sticks"):
        describing_function(closed_loop(stuck))


@pytest.mark.parametrize("belt_speed", [0.41, 0.44, 0.440955, 0.4409585])
def test_the_cycle_beside_a_hopf_point_is_that_of_averaging_however_small(belt_speed):
    """J. J. Thomsen, A. Fidlin (2003), first order: A = 2 sqrt(v_1^2 - v^2) below the Hopf speed v_1, which a cubic law has exactly in its first harmonic."""
    hopf = 0.5 * np.sqrt(1.0 - 4.0 * 0.05 * 0.5 / (3.0 * 0.15))
    (cycle,) = describing_function(closed_loop(compose(replace(oscillators.THOMSEN_FIDLIN, belt_speed=belt_speed)))).cycles
    assert cycle.amplitude == pytest.approx(2.0 * np.sqrt(hopf**2 - belt_speed**2), rel=1e-6)
    assert cycle.period == pytest.approx(2.0 * np.pi, rel=1e-9) and cycle.stable and not cycle.sticks


class Rig:
    """Two inertias under a constant torque, with the two equations of a first harmonic written out."""

    def __init__(self, draw):
        self.top, self.bit, self.stiffness, self.damping = draw(800, 2500), draw(150, 500), draw(200, 900), draw(5, 60)
        self.drag, self.bit_drag, self.rock = draw(50, 500), draw(10, 80), draw(6e4, 1.3e5) * 0.155575
        speed = draw(1.0, 9.0)
        self.torque = (self.drag + self.bit_drag) * speed + self.rock * (0.5 + 0.3 * np.exp(-0.9 * speed))
        self.nodes, self.weights = np.polynomial.legendre.leggauss(200)

    @property
    def loop(self):
        chain = TorsionalChain((self.top, self.bit), (self.stiffness,), (self.damping,), top_drag=self.drag, bit_drag=self.bit_drag)
        return closed_loop(compose(chain, BitRock(weight=self.rock / 0.155575)), inputs={"top.torque": self.torque})

    def friction(self, speed):
        return self.rock * np.sign(speed) * (0.5 + 0.3 * np.exp(-0.9 * np.abs(speed)))

    def dynamic_stiffness(self, s):
        """Torque of the rock that turns the bit by exp(s t), with the sign of a load."""
        spring = self.damping + self.stiffness / s
        return -(self.bit * s + self.bit_drag + spring - spring**2 / (self.top * s + self.drag + spring))

    def equations(self, mean, amplitude, frequency):
        """(mean torque that is missing, N - 1/G), with the half turn parted where the bit turns back."""
        turn = np.arccos(np.clip(-mean / amplitude, -1.0, 1.0))
        constant = harmonic = 0.0
        for a, b in ((0.0, turn), (turn, np.pi)):
            angle = (a + b) / 2 + (b - a) / 2 * self.nodes
            torque = self.friction(mean + amplitude * np.cos(angle)) * self.weights * (b - a) / 2 / np.pi
            constant, harmonic = constant + torque.sum(), harmonic + 2.0 * (torque * np.cos(angle)).sum() / amplitude
        return (self.drag + self.bit_drag) * mean + constant - self.torque, harmonic - self.dynamic_stiffness(1j * frequency).real

    def dense(self, frequency, highest):
        """All (mean, amplitude) that a mesh finds on which both equations change their signs."""
        mean, amplitude, angle = np.linspace(-12.0, 20.0, 501), np.linspace(0.02, highest, 200), np.pi * (np.arange(80) + 0.5) / 80
        planes = np.empty((2, amplitude.size, mean.size))
        for i, size in enumerate(amplitude):
            torque = self.friction(mean[:, None] + size * np.cos(angle))
            planes[0, i] = (self.drag + self.bit_drag) * mean + torque.mean(axis=1) - self.torque
            planes[1, i] = 2.0 * (torque * np.cos(angle)).mean(axis=1) / size - self.dynamic_stiffness(1j * frequency).real
        corners = np.stack([planes[:, :-1, :-1], planes[:, 1:, :-1], planes[:, :-1, 1:], planes[:, 1:, 1:]])
        found = []
        for i, j in np.argwhere(((corners.max(axis=0) > 0) & (corners.min(axis=0) < 0)).all(axis=0)):
            place, _, solved, _ = fsolve(lambda x: self.equations(*x, frequency), [mean[j], amplitude[i]], full_output=True, epsfcn=1e-8)
            torque, gain = self.equations(*place, frequency)
            right = solved == 1 and abs(torque) < 1e-6 * self.torque and abs(gain) < 1e-4 * self.rock
            if right and 0.02 < place[1] < highest and all(np.hypot(*(place - other)) > 0.01 for other in found):
                found.append(place)
        return found


def solves_both_equations(rig, cycle):
    torque, gain = rig.equations(cycle.mean, cycle.amplitude, cycle.frequency)
    stiffness = rig.dynamic_stiffness(1j * cycle.frequency)
    return abs(torque) < 1e-7 * rig.torque and abs(gain) < 1e-5 * abs(stiffness) and abs(stiffness.imag) < 1e-6 * abs(stiffness)


def test_where_the_mean_slip_has_three_values_no_cycle_is_predicted_that_solves_only_one_equation():
    """At one amplitude three mean slips balance this torque; a search from amplitude to amplitude jumped between them and called the jump a cycle."""
    chain = TorsionalChain(inertia=(1200, 270), stiffness=(420,), damping=(11,), top_drag=130, bit_drag=20)
    found = describing_function(closed_loop(compose(chain, BitRock(weight=89e3)), inputs={"top.torque": 7630.0}))
    branches = np.split(found.amplitude, np.flatnonzero(np.isnan(found.amplitude)))
    assert not found.cycles and len(branches) == 2 and np.diff(branches[0]).min() < 0.0 < np.diff(branches[0]).max()


def test_every_cycle_solves_both_equations():
    draw = np.random.default_rng(5).uniform
    cycles = [solves_both_equations(rig, each) for rig in (Rig(draw) for _ in range(2)) for each in describing_function(rig.loop).cycles]
    assert len(cycles) > 3 and all(cycles)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 8])
def test_a_dense_search_finds_no_other_cycle(seed):
    draw = np.random.default_rng(seed).uniform
    number = 0
    for _ in range(6):
        rig = Rig(draw)
        found = describing_function(rig.loop)
        assert all(solves_both_equations(rig, each) for each in found.cycles)
        crossing = np.flatnonzero(found.linear_response.imag[:-1] * found.linear_response.imag[1:] < 0.0)
        for low, high in zip(found.omega[crossing], found.omega[crossing + 1], strict=True):
            frequency = brentq(lambda w, rig=rig: rig.dynamic_stiffness(1j * w).imag, low, high, xtol=1e-15)
            near = [(each.mean, each.amplitude) for each in found.cycles if low < each.frequency < high]
            for place in rig.dense(frequency, 2.9 * found.steady_slip):
                assert min(np.hypot(*(np.reshape(near, (-1, 2)) - place).T), default=np.inf) < 1e-3
                number += 1
    assert number > 8
