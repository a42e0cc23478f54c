"""Parts of mechanisms: energy that is kept, closed forms of their friction, and the lossy gear of the Modelica Standard Library."""

import math

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from models import BacklashDrive, CrankSlider, GearNetwork, GearStage, OverrunningDrive, ScotchYoke, ShoeBrake, Tabulated, ValveSpool
from studies.benchmarks.mechanism_reference import Friction, Reference
from toolbox import Component, DryFriction, Equations, SceneError, closed_loop, compose, energy_audit, simulate, time
from toolbox.inputs import sine

CASES = {
    "crank": (CrankSlider(), {"crank.torque": sine(0.5, 1.5, 0.5)}, {"crank.speed": 5.0}, 5.0),
    "yoke": (ScotchYoke(), {}, {"crank.speed": 1.3}, 40.0),
    "spool": (ValveSpool(), {"spool.force": sine(0.0, 12.0, 1.4)}, {}, 3.0),
    "one-way clutch": (OverrunningDrive(), {"driver.torque": sine(0.5, 1.5, 0.16)}, {}, 20.0),
    "backlash": (BacklashDrive(), {"driver.force": sine(0.0, 4.0, 0.32)}, {}, 6.0),
    "shoes": (ShoeBrake(), {"drum.torque": sine(0.0, 20.0, 0.2), "drum.press": 100.0}, {"drum.speed": 3.0}, 10.0),
    "gears": (GearStage(), {"input.torque": sine(0.0, 10.0, 1.0), "output.torque": sine(-4.0, 1.0, 0.1)}, {}, 3.0),
}


@pytest.mark.parametrize("name", CASES)
def test_the_energy_of_a_mechanism_is_kept(name):
    part, inputs, start, duration = CASES[name]
    run = simulate(closed_loop(compose(part), inputs=inputs, start=start), duration, accuracy=1e-9)
    assert len(run.events) > 3
    assert energy_audit(run).relative < 1e-9


def test_a_crank_rests_where_friction_holds_it_and_never_at_a_dead_centre():
    """A yoke of 1 kg m2 slows down by J w^2 / 2 = F times the way of its pin: at rest at 4 pi + asin(0.45), as 1.3^2 / 2 = 0.1 (8 + 0.45)."""
    run = simulate(closed_loop(compose(ScotchYoke()), start={"crank.speed": 1.3}), 40.0)
    assert run["crank.angle"][-1] == pytest.approx(4 * math.pi + math.asin(0.45), rel=1e-7)
    assert run["crank.speed"][-1] == pytest.approx(0.0, abs=1e-30)
    assert [event.after for event in run.events].count("stick") == 1


@pytest.mark.parametrize("method", ["explicit", "taylor", "stiff"])
def test_a_crank_that_turns_ever_faster_passes_its_dead_centres_as_gauss_says(method):
    """1.5 N m for 2 s from 1 rad and 5 rad/s: 50 dead centres, and the end to 1e-7 of its values at the default accuracy."""
    part = CrankSlider()

    def reach(q):
        return math.sqrt(part.rod**2 - (part.crank * math.sin(q)) ** 2)

    def lever(q):
        return -part.crank * math.sin(q) * (1 + part.crank * math.cos(q) / reach(q))

    def slope(q):
        sine_, cosine, d, r = math.sin(q), math.cos(q), reach(q), part.crank
        return -r * cosine - r * r * ((cosine**2 - sine_**2) / d + (r * sine_ * cosine) ** 2 / d**3)

    right = Reference(
        lambda q: np.array([part.inertia + part.mass * lever(q[0]) ** 2]), lambda t, q, v: 1.5 - part.mass * lever(q[0]) * slope(q[0]) * v**2,
        [Friction("guide", lambda q: np.array([lever(q[0])]), 30.0, lambda s: 20.0)], [1.0], [5.0], 2.0,
    )  # fmt: skip
    run = simulate(compose(part), 2.0, start={"crank.angle": 1.0, "crank.speed": 5.0}, inputs={"crank.torque": 1.5}, method=method)
    assert len(run.events) == 50 == int(right.q[0] / math.pi)
    assert run["crank.angle"][-1] == pytest.approx(right.q[0], rel=1e-7)
    assert run["crank.speed"][-1] == pytest.approx(right.v[0], rel=1e-7)


def test_a_leading_shoe_and_a_trailing_one_hold_by_their_shoe_factors():
    """R P (mu / (1 - mu c) + mu / (1 + mu c)) + bearing = 0.15 100 (0.4 / 0.68 + 0.4 / 1.32) + 0.5, forwards and backwards alike."""
    holds = 0.15 * 100.0 * (0.4 / 0.68 + 0.4 / 1.32) + 0.5
    for sign in (1.0, -1.0):
        run = simulate(closed_loop(compose(ShoeBrake()), inputs={"drum.torque": sign * 2 * time, "drum.press": 100.0}), 8.0)
        assert run.events[0].time == pytest.approx(holds / 2, rel=1e-8)
    force = 100.0 * 0.3 / (1 - 0.3 * 0.8)
    assert run["leading.force"][-1] == pytest.approx(100.0 * 0.3 / (1 + 0.3 * 0.8))
    assert run["trailing.force"][-1] == pytest.approx(force)


@pytest.mark.parametrize(
    ("part", "word"), [(CrankSlider(rod=0.04), "rod"), (ShoeBrake(lever=3.0), "lever"), (ShoeBrake(kinetic=0.5), "kinetic")]
)
def test_dimensions_that_make_no_mechanism_are_refused(part, word):
    with pytest.raises(SceneError, match=f"Argument `{word}`"):
        compose(part)


class _Bearing(Component):
    """The bearing of the lossy gear examples: 0.5 at rest, 0.5 + 0.5 |w| beyond."""

    def equations(self, signal):
        speed = signal("in.speed", "rad/s")
        law = Tabulated(speeds=(0.0, 100.0), coefficients=(0.5, 50.5), static=0.5)
        bearing = DryFriction("bearing", speed, law, slip_unit="rad/s", force_unit="N m")
        return Equations(outputs={"in.torque": (bearing.force + 10 * ca.sin(2 * ca.pi * time), "N m")}, elements=[bearing])


def test_the_lossy_gear_with_a_bearing_switches_as_the_modelica_library_publishes():
    """LossyGearDemo2: i 2, efficiency 0.5, J 1 and 1.5, 10 sin 2 pi t and -10 + 2.5 t; switches of its rigid limit, which stiff teeth come to."""
    from dataclasses import dataclass

    bearing = dataclass(frozen=True)(type("Bearing", (_Bearing,), {}))()
    gears = GearNetwork(
        nodes=("in", "out"), inertia=(1.0, 1.5), trains=(("in", "out", "ground"),), ratio=(2.0,), mesh_stiffness=(1e8,), mesh_damping=(1e4,),
        efficiency=(0.5,), idle_torque=(1e-6,),
    )  # fmt: skip
    run = simulate(closed_loop(compose(gears, bearing), inputs={"out.torque": -10.0 + 2.5 * time}), 0.5)
    found = [(event.time, event.after) for event in run.events if event.element == "bearing"]
    published = [(0.0, "slip-"), (0.0635910958, "stick"), (0.230374016, "slip+"), (0.308306857, "stick"), (0.472738311, "slip-")]
    assert [word for _, word in found] == [word for _, word in published]
    assert np.subtract([t for t, _ in found], [t for t, _ in published]) == pytest.approx(0.0, abs=1e-4)
    assert run["gears.speed"][-1, 1] == pytest.approx(-0.009624279, abs=1e-4)


def test_the_lossy_gear_alone_sticks_and_moves_as_its_rigid_limit_in_closed_form():
    """LossyGearDemo1: the gear of the other example without its bearing. Rigid teeth pass i eta T1 on ahead and i / eta T1 backwards, by

    (J2 + q i J1) w2' = T2 + q T1,   q = i eta while w2 > 0,   i / eta while w2 < 0,   at rest while neither sign of w2 can begin
    """
    ratio, efficiency, first, second = 2.0, 0.5, 1.0, 1.5
    ahead, back = ratio * efficiency, ratio / efficiency

    def pull(q, t):
        return -10.0 + 2.5 * t + q * 10.0 * math.sin(2 * math.pi * t)

    def impulse(q, a, b):
        return -10.0 * (b - a) + 1.25 * (b * b - a * a) + q * 10.0 * (math.cos(2 * math.pi * a) - math.cos(2 * math.pi * b)) / (2 * math.pi)

    rests = brentq(lambda t: impulse(back, 0.0, t), 0.03, 0.2)
    moves = brentq(lambda t: pull(ahead, t), 0.1, 0.25)
    rests_again = brentq(lambda t: impulse(ahead, moves, t), 0.27, 0.45)
    turns = brentq(lambda t: pull(back, t), 0.4, 0.5)
    assert pull(back, rests) > 0 > pull(ahead, rests) and pull(back, rests_again) > 0 > pull(ahead, rests_again)  # it rests there
    gears = GearNetwork(
        nodes=("in", "out"), inertia=(first, second), trains=(("in", "out", "ground"),), ratio=(ratio,), mesh_stiffness=(1e7,), mesh_damping=(3e3,),
        efficiency=(efficiency,), idle_torque=(1e-6,),
    )  # fmt: skip
    torques = {"in.torque": 10.0 * ca.sin(2 * math.pi * time), "out.torque": -10.0 + 2.5 * time}
    run = simulate(closed_loop(compose(gears), inputs=torques), 0.5)
    assert [event.after for event in run.events] == ["slip-", "stick", "slip+", "stick", "slip-"]
    assert [event.time for event in run.events] == pytest.approx([0.0, rests, moves, rests_again, turns], abs=1e-5)
    assert run["gears.speed"][-1, 1] == pytest.approx(impulse(back, turns, 0.5) / (second + back * ratio * first), abs=1e-5)
