"""A whirling collar against closed forms, energy, an independent integration, and the string that it leaves as it was."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from models import BitRock, Coulomb, TorsionalChain, WhirlingCollar, wells, whirl_ratio
from studies.questions import whirl
from toolbox import SceneError, compose, energy_audit, measure, simulate

FREE = Coulomb(static=0.0, kinetic=0.0)
FLYWHEEL = TorsionalChain(inertia=(1e9, 1e9), stiffness=(0.0,), damping=(0.0,), collar_index=-1)  # turns at the speed it starts with
WEIGHT = 100_000.0
COLLAR = WhirlingCollar(weight=WEIGHT)
STRING = dataclasses.replace(wells.UFRJ_2, collar_index=-1)


def turning(speed, radius=0.0):
    """Start on a steady synchronous whirl of that radius (negative: the light side outwards), mass centre on the axis of y."""
    return {
        "chain.speed": (speed, speed),
        "collar.displacement": (radius, 0.0),
        "collar.velocity": (0.0, (radius + COLLAR.eccentricity) * speed),
    }


# ------------------------------------------------------------------------------------------------------------------------------ what the table says
def test_the_numbers_of_the_span_follow_from_the_published_table():
    steel, mud = 7800 * math.pi / 4 * (0.171**2 - 0.071**2), 1500 * math.pi / 4 * (0.071**2 + 1.7 * 0.171**2)
    inertia = math.pi / 64 * (0.171**4 - 0.071**4)
    assert COLLAR.modal_mass == pytest.approx(8.55 * (steel + mud) / 2, rel=1e-12)
    assert COLLAR.quadratic_drag == pytest.approx(2 * 1500 * 0.171 * 8.55 / (3 * math.pi), rel=1e-12)
    stiffness = 220e9 * inertia * math.pi**4 / (2 * 8.55**3) - 5e3 * math.pi**3 / (2 * 8.55**2) - 1e5 * math.pi**2 / (2 * 8.55)
    assert COLLAR.stiffness(1e5, 5e3) == pytest.approx(stiffness, rel=1e-12)
    assert COLLAR.gap == pytest.approx(0.0225)
    # a beam pinned at both ends buckles at pi^2 E I_a/L^2, where the stiffness of its mode is zero
    assert COLLAR.stiffness(math.pi**2 * 220e9 * inertia / 8.55**2) == pytest.approx(0.0, abs=1e-9 * stiffness)


def test_the_string_of_two_inertias_follows_from_the_published_table():
    def polar(outer, inner):
        return math.pi / 32 * (outer**4 - inner**4)

    pipe = polar(0.140, 0.119)
    inertia = 7800 * (pipe * 4733.6 / 3 + polar(0.140, 0.076) * 171.3 + polar(0.171, 0.071) * 294.9)
    stiffness = 85.3e9 * pipe / 4733.6
    chain = wells.UFRJ_2
    assert chain.inertia[1] == pytest.approx(inertia, rel=1e-6)
    assert chain.stiffness[0] == pytest.approx(stiffness, rel=1e-6)
    assert chain.damping[0] == pytest.approx(0.35 * inertia + 0.06 * stiffness, rel=1e-6)


# ------------------------------------------------------------------------------------------------------------------------- states, contacts, signals
@pytest.mark.parametrize(("n", "rock", "collar"), [(n, r, c) for n in (2, 4) for r in (False, True) for c in (False, True)])
def test_a_plant_has_the_states_and_contacts_of_its_parts_and_no_others(n, rock, collar):
    chain = TorsionalChain(
        inertia=(1000.0,) * n, stiffness=(500.0,) * (n - 1), damping=(10.0,) * (n - 1), collar_index=-1 if collar else None
    )
    parts = [chain] + [BitRock()] * rock + [WhirlingCollar(weight=None if rock else 0.0)] * collar
    plant = compose(*parts)
    assert plant.x.numel() == 2 * n - 1 + 5 * collar  # the angle of the bit, and y, z with their rates
    assert [element.name for element in plant.elements] == ["bit"] * rock + ["wall", "rub"] * collar
    assert ("collar.torque" in plant.signals) is collar and ("collar.speed" in plant.signals) is collar
    assert "collar.torque" not in plant.inputs


def test_without_a_collar_the_string_turns_bit_for_bit_as_it_did():
    rock, torque = BitRock(weight=60_000.0), {"top.torque": 9_000.0}
    never = simulate(compose(wells.UFRJ_2, rock), 60.0, inputs=torque)
    whirling = compose(STRING, rock, WhirlingCollar())
    removed = compose(*[dataclasses.replace(part, collar_index=None) if part is STRING else part for part in whirling.parts[:2]])
    assert not any("collar" in name for name in (*removed.signals, *removed.inputs, *removed.parameters, *removed.supplies))
    again = simulate(removed, 60.0, inputs=torque)
    assert never.events and never.events == again.events
    np.testing.assert_array_equal(never.states, again.states)
    # a string that stays ready for a collar has one more input, which is zero
    ready = simulate(compose(STRING, rock), 60.0, inputs=torque)
    np.testing.assert_allclose(ready.at(60.0)["chain.speed"], never.at(60.0)["chain.speed"], rtol=1e-6)  # other steps


def test_a_collar_balanced_in_the_middle_of_its_hole_leaves_the_string_as_it_was_and_stays_there():
    rock, torque = BitRock(weight=60_000.0), {"top.torque": 9_000.0}
    plain = simulate(compose(wells.UFRJ_2, rock), 60.0, inputs=torque, accuracy=1e-8)
    whirling = simulate(compose(STRING, rock, WhirlingCollar(eccentricity=0.0)), 60.0, inputs=torque, accuracy=1e-8)
    times = np.linspace(0, 60, 301)
    np.testing.assert_allclose(whirling.at(times)["bit.speed"], plain.at(times)["bit.speed"], atol=1e-6)
    assert np.all(whirling["collar.radius"] <= 1e-14)
    assert whirling.time_in("wall", "open") == 60.0


def test_a_collar_that_cannot_be_built_or_connected_is_refused_by_name():
    with pytest.raises(SceneError, match="`chain.collar_index` must be an integer >= -2 and <= 1"):
        compose(dataclasses.replace(STRING, collar_index=2))
    with pytest.raises(SceneError, match="`inner_diameter`, `outer_diameter` and `hole_diameter` must increase"):
        compose(FLYWHEEL, dataclasses.replace(COLLAR, hole_diameter=0.17))
    with pytest.raises(SceneError, match=r"collar.speed"):
        compose(dataclasses.replace(FLYWHEEL, collar_index=None), COLLAR)
    with pytest.raises(SceneError, match=r"bit.weight"):
        compose(FLYWHEEL, WhirlingCollar())


# ------------------------------------------------------------------------------------------------------------------------------ synchronous whirl
def dragged_radius(collar, speed):
    """Radius of synchronous whirl with drag, which acts across: (k - m w^2)^2 r^2 + (c_h w^2 r^2)^2 = (m e w^2)^2."""
    k = collar.stiffness(WEIGHT) - collar.modal_mass * speed**2
    square = np.roots([(collar.quadratic_drag * speed**2) ** 2, k**2, -((collar.modal_mass * collar.eccentricity * speed**2) ** 2)])
    return math.sqrt(max(square.real))


@pytest.mark.parametrize("speed", [5.0, 15.0, 20.0])
def test_synchronous_whirl_without_drag_has_the_radius_of_the_closed_form(speed):
    collar = dataclasses.replace(COLLAR, mud_density=0.0, friction=FREE)
    radius = collar.synchronous_radius(speed, WEIGHT)
    assert radius < collar.gap
    run = simulate(compose(FLYWHEEL, collar), 20.0, start=turning(speed, radius), accuracy=1e-9)
    np.testing.assert_allclose(run["collar.radius"], radius, rtol=1e-6)
    assert whirl_ratio(run, 1.0) == pytest.approx(1.0, abs=1e-7)


def test_above_the_critical_speed_the_light_side_whirls_outwards_with_the_radius_of_the_closed_form():
    speed = 45.0
    collar = dataclasses.replace(COLLAR, mud_density=0.0, friction=FREE, hole_diameter=0.3)
    radius = collar.synchronous_radius(speed, WEIGHT)
    run = simulate(compose(FLYWHEEL, collar), 2.0, start=turning(speed, -radius), accuracy=1e-10)
    np.testing.assert_allclose(run["collar.radius"], radius, rtol=1e-5)


def test_drag_lets_every_start_end_in_synchronous_whirl():
    speed = 12.0
    collar = dataclasses.replace(COLLAR, drag_coefficient=60.0)
    run = simulate(compose(FLYWHEEL, collar), 120.0, start={"chain.speed": (speed, speed)})
    assert run.time_in("wall", "closed") == 0.0
    assert run["collar.radius"][-1] == pytest.approx(dragged_radius(collar, speed), rel=1e-4)
    assert whirl_ratio(run, 100.0) == pytest.approx(1.0, abs=1e-4)


def test_the_wall_is_reached_at_the_contact_speed_and_not_below():
    collar = dataclasses.replace(COLLAR, mud_density=0.0)
    contact = collar.contact_speed(WEIGHT)
    assert collar.synchronous_radius(contact, WEIGHT) == pytest.approx(collar.gap, rel=1e-12)
    for factor, touches in ((0.995, False), (1.005, True)):
        speed = factor * contact
        radius = min(collar.synchronous_radius(speed, WEIGHT), collar.gap)
        run = simulate(compose(FLYWHEEL, collar), 5.0, start=turning(speed, radius * (1 - 1e-6)))
        assert (run.time_in("wall", "closed") > 0.0) is touches


def test_a_slow_spin_up_first_meets_the_wall_where_the_radius_of_the_whirl_is_the_gap():
    # the drive has so much inertia that the collar cannot slow it; light drag lets the motion follow the speed
    collar = dataclasses.replace(COLLAR, drag_coefficient=10.0)
    chain = dataclasses.replace(FLYWHEEL, inertia=(1e8, 1e8), stiffness=(1e10,), damping=(1e9,))
    contact = brentq(lambda w: dragged_radius(collar, w) - collar.gap, 15.0, 26.0)
    assert contact == pytest.approx(collar.contact_speed(WEIGHT), rel=0.01)
    begin = contact - 2.0
    start = turning(begin, dragged_radius(collar, begin))
    run = simulate(compose(chain, collar), 60.0, start=start, inputs={"top.torque": 0.05 * 2e8}, accuracy=1e-5)
    first = next(event.time for event in run.events if event.element == "wall")
    # the free motion left over from the start, and the lag of the radius behind the speed, make it meet the wall a little early
    assert float(run.at(first)["collar.speed"]) == pytest.approx(contact, rel=0.01)


# --------------------------------------------------------------------------------------------------------------------------------- backward whirl
def rolling(collar, speed):
    """Start rolling backward along the wall at a radius of the gap."""
    e, backward = collar.eccentricity, speed * collar.rolling_ratio()
    return {
        "chain.speed": (speed, speed),
        "collar.displacement": (collar.gap, 0.0),
        "collar.velocity": (0.0, collar.gap * backward + e * speed),
    }


@pytest.mark.parametrize("wall", [{"restitution": 0.0}, {"wall_stiffness": 1e9, "wall_damping": 2e6}], ids=["rigid", "elastic"])
def test_backward_whirl_lasts_above_the_rolling_speed_and_dies_below(wall):
    collar = dataclasses.replace(COLLAR, **wall)
    threshold = collar.rolling_speed(WEIGHT)
    assert 6.0 < threshold < 8.0
    above = simulate(compose(FLYWHEEL, collar), 10.0, start=rolling(collar, 1.05 * threshold))
    assert whirl_ratio(above, 5.0) == pytest.approx(collar.rolling_ratio(), rel=1e-3 if "wall_stiffness" in wall else 1e-6)
    assert above.time_in("wall", "closed", after=1.0) == pytest.approx(9.0)
    below = simulate(compose(FLYWHEEL, collar), 10.0, start=rolling(collar, 0.8 * threshold))
    assert below.time_in("rub", "stick") < 1.0
    assert below.time_in("wall", "closed", after=5.0) == 0.0  # it slipped, and left the wall


def test_rolling_needs_the_friction_that_the_closed_form_says():
    collar = dataclasses.replace(COLLAR, restitution=0.0)
    run = simulate(compose(FLYWHEEL, collar), 6.0, start=rolling(collar, 10.0), accuracy=1e-8)
    assert run.time_in("rub", "stick") == pytest.approx(6.0)
    samples = run.at(np.linspace(0.1, 6.0, 2000))
    theta = np.arctan2(samples["collar.z"], samples["collar.y"])
    psi = samples["collar.angle"] - theta
    m, g, e, w = collar.modal_mass, collar.gap, collar.eccentricity, 10.0
    backward = w * collar.rolling_ratio()
    normal = m * g * backward**2 + m * e * w**2 * np.cos(psi) - collar.stiffness(WEIGHT) * g
    along = -m * e * w**2 * np.sin(psi) - collar.quadratic_drag * (g * backward) ** 2
    np.testing.assert_allclose(samples["wall.force"], normal, rtol=1e-6)
    np.testing.assert_allclose(samples["rub.force"], along, atol=1e-6 * np.abs(along).max())


def test_without_friction_no_wall_contact_turns_the_whirl_backward():
    speed = 24.0
    slippery = dataclasses.replace(COLLAR, wall_damping=1e5, friction=FREE)
    assert slippery.contact_speed(WEIGHT) < speed
    forward = simulate(compose(FLYWHEEL, slippery), 20.0, start={"chain.speed": (speed, speed)})
    assert forward.time_in("wall", "closed", after=10.0) > 0.0
    assert whirl_ratio(forward, 10.0) > 0.0
    rough = simulate(
        compose(FLYWHEEL, dataclasses.replace(slippery, friction=COLLAR.friction)), 20.0, start={"chain.speed": (speed, speed)}
    )
    # it rolls on a wall that it dents by N/k_s = 0.2 mm
    assert whirl_ratio(rough, 10.0) == pytest.approx(-COLLAR.outer_radius / measure.extent(rough, "collar.radius", 10.0).mean, rel=1e-4)


# --------------------------------------------------------------------------------------------------------------------------------------- energy
def test_without_friction_and_drag_energy_and_the_drives_momentum_are_kept():
    collar = dataclasses.replace(COLLAR, drag_coefficient=0.0, wall_damping=0.0, friction=FREE, weight=0.0)
    chain = TorsionalChain(inertia=(2000.0, 500.0), stiffness=(300.0,), damping=(0.0,), collar_index=-1)
    start = {"chain.speed": (30.0, 25.0), "collar.velocity": (0.3, -0.2)}
    run = simulate(compose(chain, collar), 5.0, start=start, accuracy=1e-9)
    assert sum(event.after == "closed" for event in run.events) > 20
    audit = energy_audit(run)
    assert audit.impacts == pytest.approx(0.0, abs=1e-4)
    assert audit.relative < 1e-8
    growth = sum(end - begin for begin, end in audit.stored.values())
    assert abs(growth) < 1e-8 * audit.turnover  # the weight, the only supply, is zero

    # about the middle of the hole: spin of both inertias and the orbit of the mass centre, with central forces only
    e = collar.eccentricity
    displacement, velocity, phi = run["collar.displacement"], run["collar.velocity"], run["collar.angle"]
    place = displacement + np.array([e, 0.0])
    momentum = run["chain.speed"] @ [2000.0, 500.0] + collar.modal_mass * (place[:, 0] * velocity[:, 1] - place[:, 1] * velocity[:, 0])
    np.testing.assert_allclose(momentum, momentum[0], rtol=1e-8)
    assert phi[-1] > 50.0


@pytest.mark.parametrize("rigid", [False, True], ids=["elastic", "rigid"])
def test_the_power_balance_closes_on_random_starts(rigid):
    plant = compose(STRING, BitRock(weight=80_000.0), WhirlingCollar(restitution=0.6 if rigid else None))
    random = np.random.default_rng(7)
    impacts = 0
    for _ in range(8):
        start = {
            "chain.speed": random.uniform(0, 35, 2), "chain.twist": random.uniform(0, 10), "collar.angle": random.uniform(0, 6),
            "collar.velocity": random.normal(size=2) * 0.4,
        }  # fmt: skip
        numbers = {
            "collar.eccentricity": random.uniform(0, 0.02), "rub.friction.static": (mu := random.uniform(0, 0.8)),
            "rub.friction.kinetic": 0.9 * mu,
        }  # fmt: skip
        if not rigid:
            numbers["collar.wall_damping"] = 10 ** random.uniform(2, 6)
        # the angle turns the eccentricity; where that puts the centre, so much must the mass centre be moved
        e, phi = numbers["collar.eccentricity"], start["collar.angle"]
        start["collar.displacement"] = (e * (math.cos(phi) - 1), e * math.sin(phi))
        run = simulate(plant, 3.0, start=start, parameters=numbers, inputs={"top.torque": 8_000.0}, accuracy=1e-8)
        audit = energy_audit(run)
        assert audit.relative < 1e-7
        assert audit.impacts > -1e-9 * audit.turnover
        impacts += measure.contact(run, "wall").impacts
        assert run["collar.radius"].max() < 0.0225 + (1e-8 if rigid else 2e-3)
    assert impacts > 30


# --------------------------------------------------------------------------------------------------------------------- an independent integration
def reference(collar, speed0, inertia, duration):
    """Closing and opening times and end state by scipy: geometric centre and angle with their 3 x 3 mass matrix, elastic wall, sliding friction."""
    m, e, k, c = collar.modal_mass, collar.eccentricity, collar.stiffness(WEIGHT), collar.quadratic_drag
    gap, rim, ks, cs, mu = collar.gap, collar.outer_radius, collar.wall_stiffness, collar.wall_damping, collar.friction.kinetic

    def slope(t, s, closed):
        y, z, phi, vy, vz, w = s
        r = math.hypot(y, z)
        n, tangent = np.array([y, z]) / r, np.array([-z, y]) / r
        v = np.array([vy, vz])
        normal = ks * (r - gap) + cs * v @ n if closed else 0.0
        slip = rim * w + v @ tangent
        force = -k * np.array([y, z]) - c * np.linalg.norm(v) * v - normal * n - mu * normal * np.sign(slip) * tangent
        # m (y + e cos phi)'' = Y, m (z + e sin phi)'' = Z, I phi'' = M
        matrix = np.array([[m, 0, -m * e * math.sin(phi)], [0, m, m * e * math.cos(phi)], [0, 0, inertia]])
        moment = -rim * mu * normal * np.sign(slip) + e * (force[0] * math.sin(phi) - force[1] * math.cos(phi))
        right = [force[0] + m * e * w**2 * math.cos(phi), force[1] + m * e * w**2 * math.sin(phi), moment]
        return np.concatenate([[vy, vz, w], np.linalg.solve(matrix, right)])

    def shuts(t, s, closed):
        return math.hypot(s[0], s[1]) - gap

    def parts(t, s, closed):
        r = math.hypot(s[0], s[1])
        return ks * (r - gap) + cs * (s[0] * s[3] + s[1] * s[4]) / r

    shuts.terminal = parts.terminal = True
    shuts.direction, parts.direction = 1, -1
    # the centre rests in the middle; a hair beside it, where its direction is defined
    t, s, closed, times = 0.0, np.array([1e-9, 0.0, 0.0, 0.0, -e * speed0, speed0]), False, []
    while t < duration:
        run = solve_ivp(slope, (t, duration), s, method="DOP853", rtol=1e-12, atol=1e-13, events=parts if closed else shuts, args=(closed,))
        t, s = run.t[-1], run.y[:, -1]
        if run.status == 1:
            times.append(t)
            closed = not closed
            s = s.copy()
    return np.array(times), s


def test_impacts_agree_with_an_independent_integration_of_centre_and_angle():
    collar = dataclasses.replace(COLLAR, wall_stiffness=1e8, friction=Coulomb(static=0.1, kinetic=0.1))
    chain = TorsionalChain(inertia=(1.0, 455.0), stiffness=(0.0,), damping=(0.0,), collar_index=-1)
    times, end = reference(collar, 26.0, 455.0, 0.3)
    assert len(times) >= 6
    gaps = []
    for accuracy in (1e-5, 1e-7, 1e-9):
        start = {"chain.speed": (0.0, 26.0), "collar.displacement": (1e-9, 0.0), "collar.velocity": (0.0, 0.0)}
        run = simulate(compose(chain, collar), 0.3, start=start, accuracy=accuracy)
        mine = np.array([event.time for event in run.events if event.element == "wall"])
        assert mine.size == times.size and run.time_in("rub", "slip+") == pytest.approx(0.3)  # the reference knows no stick
        last = run.at(0.3)
        found = np.array([last["collar.y"], last["collar.z"], last["collar.angle"], last["collar.speed"]])
        gaps.append(np.max(np.abs(found - end[[0, 1, 2, 5]]) / [0.0225, 0.0225, end[2], end[5]]))
    assert gaps[1] < 0.2 * gaps[0] and gaps[2] < 0.2 * gaps[1]
    assert gaps[-1] < 1e-7
    np.testing.assert_allclose(mine, times, atol=1e-8)


def test_while_the_wall_is_not_met_the_motion_is_linear_and_knows_no_wall():
    # turning evenly and without mud, y + i z = forced circle + free ellipse
    collar, speed = dataclasses.replace(COLLAR, mud_density=0.0), 8.0
    run = simulate(compose(FLYWHEEL, collar), 30.0, start={"chain.speed": (speed, speed)}, accuracy=1e-9)
    assert run.time_in("wall", "open") == 30.0
    w2 = collar.stiffness(WEIGHT) / collar.modal_mass
    forced, w = collar.eccentricity * speed**2 / (w2 - speed**2), math.sqrt(w2)
    for t in (0.3, 7.0, 30.0):
        # the centre starts in the middle, and moves at -i e speed, because the mass centre is at rest
        free = (-1j * (collar.eccentricity + forced) * speed / w) * np.sin(w * t) - forced * np.cos(w * t)
        expected = forced * np.exp(1j * speed * t) + free
        state = run.at(t)
        assert abs(state["collar.y"] + 1j * state["collar.z"] - expected) < 1e-7 * collar.gap


def test_a_stiff_wall_tends_to_the_rigid_one():
    start = {"chain.speed": (26.0, 26.0)}
    collar = dataclasses.replace(COLLAR, wall_damping=0.0)
    rigid = simulate(compose(FLYWHEEL, dataclasses.replace(collar, restitution=1.0)), 0.3, start=start, accuracy=1e-9)
    assert measure.contact(rigid, "wall").impacts >= 2
    gaps = []
    for stiffness in (1e9, 1e11, 1e13):
        run = simulate(compose(FLYWHEEL, dataclasses.replace(collar, wall_stiffness=stiffness)), 0.3, start=start, accuracy=1e-9)
        gaps.append(np.linalg.norm(run.at(0.3)["collar.displacement"] - rigid.at(0.3)["collar.displacement"]))
    assert gaps[0] > 5 * gaps[1] > 25 * gaps[2]  # as 1 / sqrt(stiffness), the duration of an impact


def test_a_heavy_weight_bends_the_collar_to_the_wall():
    buckling = COLLAR.bending_stiffness * 2 * COLLAR.span / math.pi**2
    collar = dataclasses.replace(COLLAR, weight=1.2 * buckling, restitution=0.3, drag_coefficient=50.0)
    assert collar.stiffness(collar.weight) < 0
    run = simulate(compose(FLYWHEEL, collar), 20.0, start={"collar.displacement": (1e-3, 0.0)})
    assert run.modes["wall"][-1] == "closed"
    assert run.at(20.0)["wall.force"] == pytest.approx(-collar.stiffness(collar.weight) * collar.gap, rel=1e-9)
    light = dataclasses.replace(collar, weight=0.8 * buckling)
    twin = simulate(compose(FLYWHEEL, light), 20.0, start={"collar.displacement": (1e-3, 0.0)})
    assert twin.time_in("wall", "open") == 20.0


# -------------------------------------------------------------------------------------------------------------------------------------- measures
def test_the_turns_of_a_whirl_are_counted_forward_and_backward():
    collar = dataclasses.replace(COLLAR, eccentricity=0.0, mud_density=0.0, restitution=1.0)
    w = math.sqrt(collar.stiffness(WEIGHT) / collar.modal_mass)
    for sense in (1.0, -1.0):
        start = {"chain.speed": (2.0, 2.0), "collar.displacement": (0.01, 0.0), "collar.velocity": (0.0, sense * 0.01 * w)}
        assert whirl_ratio(simulate(compose(FLYWHEEL, collar), 10.0, start=start), 1.0, 9.0) == pytest.approx(sense * w / 2.0, rel=1e-6)
    still = simulate(compose(FLYWHEEL, collar), 1.0, start={"collar.displacement": (0.01, 0.0)})
    assert math.isnan(whirl_ratio(still))


def test_friction_in_flight_neither_sticks_nor_stops_the_string():
    # at rest in the middle of the hole both the bit and the friction of the wall have no slip; the bit alone holds the string
    plant = compose(STRING, BitRock(weight=60_000.0), WhirlingCollar())
    run = simulate(plant, 5.0, inputs={"top.torque": 4_000.0})
    assert run.time_in("bit", "stick") == 5.0 and run.events == []
    assert run.time_in("rub", "stick") == 0.0
    released = simulate(plant, 20.0, inputs={"top.torque": 8_500.0})
    around = [event for event in released.events if event.time <= released.events[0].time + 1e-6]
    assert [(event.element, event.before) for event in around if event.element == "bit"] == [("bit", "stick")]


def test_a_collar_hit_by_its_drive_alternates_between_open_and_closed():
    run = simulate(compose(FLYWHEEL, COLLAR), 3.0, start={"chain.speed": (26.0, 26.0)})
    wall = [event for event in run.events if event.element == "wall"]
    assert all(first.after == second.before for first, second in itertools.pairwise(wall))
    record = measure.contact(run, "wall")
    assert record.impacts == sum(event.after == "closed" for event in wall)
    assert record.time == pytest.approx(run.time_in("wall", "closed"), rel=1e-12)
    # an undamped bounce stores m v^2/2 in k d^2/2: the force is at least v sqrt(k m) with the mass that the friction leaves at the contact
    assert 0.3 * record.speed * math.sqrt(1e9 * COLLAR.modal_mass) < record.force < 2 * record.speed * math.sqrt(1e9 * COLLAR.modal_mass)


@pytest.mark.parametrize(("restitution", "whirls"), [(0.9, "backward"), (0.5, "forward"), (0.0, "forward")])
def test_bounces_that_die_out_on_a_rough_rigid_wall_end_in_contact(restitution, whirls):
    collar = dataclasses.replace(COLLAR, restitution=restitution)
    run = simulate(compose(FLYWHEEL, collar), 2.0, start={"chain.speed": (24.0, 24.0)})
    assert run.modes["wall"][-1] == "closed"
    # the friction of many hard impacts turns the whirl; a collar that soon stops bouncing only rubs
    ratio = collar.rolling_ratio() if whirls == "backward" else 1.0
    assert whirl_ratio(run, 1.5) == pytest.approx(ratio, rel=1e-5)
    assert energy_audit(run).relative < 1e-5


# ------------------------------------------------------------------------------------------------------------------------------------ the study
STEP, SHORT, LONG, *INSIDE = whirl.WAYS


@pytest.mark.slow
def test_a_step_from_rest_strikes_at_some_gains_and_a_ramp_of_a_minute_at_none():
    stiff = whirl.row(whirl.driven(None))
    assert (
        stiff["severity"] > 1.0 and stiff["stuck"] > 1.0 and stiff["impacts"] > 500
    )  # without a sliding mode it sticks, slips and strikes
    gains = (0.05, 0.1, 0.2, 0.4, 0.6, 0.8)
    ramped, stepped = whirl.outcomes(gains, (LONG, STEP)).T
    assert (ramped == 0).all() and stepped.tolist() == [1, 0, 0, 1, 1, 1]
    # the wall is reached because the bit runs ahead, beyond the speed of the closed form
    contact = WhirlingCollar().contact_speed(whirl.WEIGHT, whirl.SLIDING)
    assert whirl.row(whirl.driven(0.2, STEP))["peak"] < contact < whirl.row(whirl.driven(0.6, STEP))["peak"]


@pytest.mark.slow
def test_inside_stick_slip_every_gain_strikes_and_the_one_that_a_step_calls_good_leaves_the_collar_rolling():
    phases = INSIDE[::2]
    gentle, praised, larger = whirl.outcomes((0.1, 0.2, 0.3), phases)
    assert (gentle == 1).all()  # it comes off the wall
    # which phases end on the wall depends on every digit, that there are such phases does not
    assert (praised >= 1).all() and 2 in praised and (larger >= 1).all() and (larger == 2).sum() >= 2
    phase = phases[int(np.flatnonzero(praised == 2)[0])]
    found = whirl.row(whirl.driven(0.2, phase))
    assert found["severity"] < 0.02 and found["stuck"] == 0.0  # the bit tells nothing of it
    assert found["late contact"] == pytest.approx(whirl.DURATION - whirl.SETTLED, rel=1e-6)
    assert found["whirl"] == pytest.approx(WhirlingCollar().rolling_ratio(), rel=0.01)
    # rolling lasts because the set-point lies above the speed of the closed form, and below that at which the wall is reached
    assert (
        WhirlingCollar().rolling_speed(whirl.WEIGHT, whirl.SLIDING)
        < whirl.REFERENCE
        < WhirlingCollar().contact_speed(whirl.WEIGHT, whirl.SLIDING)
    )


@pytest.mark.slow
def test_the_outcome_from_inside_is_that_of_other_phases_and_another_weight():
    for gain, weight in ((0.1, 155_000.0), (0.1, 165_000.0), (0.05, 165_000.0), (0.8, 160_000.0)):
        assert {whirl.outcome(whirl.driven(gain, way, weight)) for way in INSIDE[::2]} <= {0, 1}
    assert 2 in {whirl.outcome(whirl.driven(0.3, way, 155_000.0)) for way in INSIDE[:4]}
    assert {whirl.outcome(whirl.driven(1.3, way)) for way in (STEP, LONG, INSIDE[0])} == {3}


def test_the_pictures_of_the_study_are_drawn():
    run = simulate(whirl.rig(), 12.0, controller=None, inputs={"top.torque": 11_000.0})
    assert len(whirl.draw({"short": (run, 4.0), "again": (run, 6.0)}).axes) == 6
    found, gains, ways = np.array([[0, 1], [2, 3]]), (0.1, 0.2), (STEP, INSIDE[3])
    assert len(whirl.draw_outcomes(found, gains, ways).axes) == 1
    text = whirl.map_text(found, gains, ways)
    assert (
        "1 strikes, comes off" in text.splitlines()[1] and "1 stick-slip" in text.splitlines()[2] and "inside stick-slip, 1 phases" in text
    )
    assert "gain 0.1" in whirl.table({"gain 0.1": whirl.row(whirl.driven(0.1))})
