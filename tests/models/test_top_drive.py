"""A top drive between a control law and the string: lags, limits, gearbox and motor against linear theory, and what they change in closed loop."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.linalg import expm

from controllers import PI, IdealSlidingMode, SlidingMode, SoftTorque, StiffPI
from models import BitRock, TopDrive, wells
from toolbox import Component, Equations, SceneError, compose, energy_audit, linearise, measure, quantity, simulate, state

ROCK = BitRock(weight=97_347.0)
DIRECT = TopDrive(drive_lag=None, encoder_lag=None)
MOTOR = {"motor_inertia": 10.0, "stiffness": 1e6, "damping": 2e3, "ratio": 10.0}
GEARS = {"efficiency": 0.95, "idle_torque": 20.0}


@dataclasses.dataclass(frozen=True)
class Wheel(Component):
    """A wheel on the shaft of a top drive: J w' = T - c w."""

    inertia: float = quantity(100.0, "kg m2", "inertia", above=0)
    drag: float = quantity(50.0, "N m s/rad", "viscous drag", at_least=0)

    def equations(self, signal):
        w = state("top.speed", "rad/s")
        torque = signal("top.torque", "N m")
        return Equations(
            flow={w: (torque - self.drag * w) / self.inertia},
            stored=self.inertia * w**2 / 2,
            losses={"drag": self.drag * w**2},
            supplies={"torque": torque * w},
        )


@pytest.mark.parametrize(
    ("drive", "states", "contacts"),
    [
        (DIRECT, 0, 0),
        (TopDrive(encoder_lag=None), 1, 0),
        (TopDrive(drive_lag=None), 1, 0),
        (TopDrive(), 2, 0),
        (TopDrive(torque_limit=1000.0, rate_limit=1000.0), 2, 0),
        (TopDrive(**GEARS), 2, 1),
        (TopDrive(**MOTOR), 4, 0),
        (TopDrive(**MOTOR, **GEARS, torque_limit=1000.0, rate_limit=1000.0), 4, 1),
    ],
)
def test_a_top_drive_has_the_states_and_contacts_that_were_asked_for_and_no_others(drive, states, contacts):
    alone, driven = compose(wells.JANSEN_2, ROCK), compose(wells.JANSEN_2, ROCK, drive)
    assert driven.x.numel() - alone.x.numel() == states
    assert len(driven.elements) - len(alone.elements) == contacts


def test_a_drive_without_anything_is_the_torque_itself():
    times = np.linspace(0.0, 30.0, 100)
    alone = simulate(compose(wells.JANSEN_2, ROCK), 30.0, controller=StiffPI(), accuracy=1e-9).at(times)
    driven = simulate(compose(wells.JANSEN_2, ROCK, DIRECT), 30.0, controller=StiffPI(), accuracy=1e-9).at(times)
    np.testing.assert_allclose(driven["bit.speed"], alone["bit.speed"], atol=1e-7)
    np.testing.assert_allclose(driven["drive.command"], alone["top.torque"], rtol=1e-7)


def test_command_and_encoder_lag_as_first_orders_do():
    plant = compose(Wheel(), TopDrive(drive_lag=0.2, encoder_lag=0.05, ratio=4.0))
    system = linearise(plant, inputs="drive.command", outputs=["drive.torque", "top.torque", "top.speed", "drive.speed"])
    for w in (0.1, 3.0, 40.0):
        s = 1j * w
        torque = 1 / (0.2 * s + 1)
        speed = torque / (100.0 * s + 50.0)
        expected = [torque / 4.0, torque, speed, speed / (0.05 * s + 1)]
        np.testing.assert_allclose(np.ravel(system(s)), expected, rtol=1e-12)


@pytest.mark.parametrize("way", ["continuous", "sampled", "callable"])
def test_every_law_meets_the_drive_without_being_changed(way):
    # J w' + c w = T, drive lag, encoder lag, u = k (r - w_measured): linear, so the matrix exponential knows the motion
    plant = compose(Wheel(), TopDrive(drive_lag=0.05, encoder_lag=0.02))
    gain, target = 400.0, 5.0
    matrix = np.array([[-0.5, 0.01, 0.0], [0.0, -20.0, 0.0], [50.0, 0.0, -50.0]])
    push, read = np.array([0.0, 20.0, 0.0]), np.array([0.0, 0.0, 1.0])
    if way == "continuous":
        run = simulate(plant, 2.0, controller=PI(proportional=gain, integral=0.0, reference=target), accuracy=1e-10)
        x = np.linalg.solve(matrix - gain * np.outer(push, read), -gain * target * push)
        x = x - expm(2.0 * (matrix - gain * np.outer(push, read))) @ x
    else:
        law = PI(proportional=gain, integral=0.0, reference=target) if way == "sampled" else (lambda t, y: gain * (target - y[0]))
        run = simulate(plant, 2.0, controller=law, sample_time=0.1, accuracy=1e-10)
        step = expm(0.1 * np.block([[matrix, push[:, None]], [np.zeros((1, 4))]]))
        x = np.zeros(3)
        for _ in range(20):
            x = (step @ np.append(x, gain * (target - read @ x)))[:3]
    end = run.at(2.0)
    np.testing.assert_allclose([end["top.speed"], end["drive.torque"], end["drive.speed"]], x, rtol=1e-8)
    assert "drive.command" in run


def test_the_lags_change_a_closed_loop_in_proportion_to_their_size():
    law = PI(proportional=4000.0, integral=1500.0, reference=8.0)
    start = {"top.speed": 8.0, "bit.speed": 8.0, "chain.twist": 15.0}
    exact = simulate(compose(wells.JANSEN_2, ROCK), 3.0, start=start, controller=law, accuracy=1e-11).at(3.0)["top.speed"]
    off = []
    for lag in (4e-3, 2e-3, 1e-3):
        drive = TopDrive(drive_lag=lag, encoder_lag=lag)
        run = simulate(compose(wells.JANSEN_2, ROCK, drive), 3.0, start=start | {"drive.speed": 8.0}, controller=law, accuracy=1e-11)
        off.append(abs(run.at(3.0)["top.speed"] - exact))
    assert off[0] / off[1] == pytest.approx(2.0, rel=0.05) and off[1] / off[2] == pytest.approx(2.0, rel=0.05)


def test_the_start_torque_of_a_stiff_drive_is_cut_to_what_the_motor_has():
    law = StiffPI(reference=9.95)
    free = simulate(compose(wells.JANSEN_2, ROCK, TopDrive()), 60.0, controller=law)
    limited = simulate(compose(wells.JANSEN_2, ROCK, TopDrive(torque_limit=3500.0, ratio=10.0)), 60.0, controller=law)
    # the law asks for proportional * reference at once; without a limit the lag alone rounds it off
    assert free["drive.command"][0] == limited["drive.command"][0] == 2e4 * 9.95
    assert measure.extent(free, "top.torque").maximum > 170_000.0
    assert measure.extent(limited, "top.torque").maximum == pytest.approx(35_000.0, rel=1e-6)
    # it is no cure: the stick-slip is the same
    stuck = [run.time_in("bit", "stick", after=30.0) for run in (free, limited)]
    assert stuck[0] > 5.0 and stuck[1] == pytest.approx(stuck[0], rel=0.01)


def test_a_limited_motor_winds_up_the_torque_at_its_rate():
    # far from the command T' = R, then an exponential from the torque at which (u - T) / lag = R
    drive = TopDrive(drive_lag=0.1, encoder_lag=None, rate_limit=1000.0, torque_limit=800.0)
    run = simulate(compose(Wheel(), drive), 3.0, inputs={"drive.command": 5000.0}, accuracy=1e-10)
    bend = (800.0 - 0.1 * 1000.0) / 1000.0
    for t in (0.2, 0.5, bend, 1.0, 2.0):
        expected = 1000.0 * t if t <= bend else 800.0 - 100.0 * math.exp(-(t - bend) / 0.1)
        assert run.at(t)["drive.torque"] == pytest.approx(expected, rel=1e-8)
    down = simulate(compose(Wheel(), drive), 3.0, inputs={"drive.command": -5000.0}, accuracy=1e-10)
    np.testing.assert_allclose(down.at(run.time)["drive.torque"], -run["drive.torque"], rtol=1e-8)


@pytest.mark.parametrize(("brake", "factor"), [(0.0, 0.9), (-2000.0, 1 / 0.9)])
def test_a_gearbox_loses_on_the_side_from_which_power_comes(brake, factor):
    # J w' = n T eta^s - c w: driving it takes from the torque, braking it helps to brake
    drive = dataclasses.replace(DIRECT, ratio=5.0, efficiency=0.9, idle_torque=1e-9)
    command = 1000.0 + brake
    run = simulate(compose(Wheel(), drive), 0.5, start={"top.speed": 40.0}, inputs={"drive.command": command}, accuracy=1e-10)
    final = command * factor / 50.0
    assert run.at(0.5)["top.speed"] == pytest.approx(final + (40.0 - final) * math.exp(-0.25), rel=1e-8)
    assert energy_audit(run).losses["drive.teeth"] > 0


def test_a_motor_on_an_elastic_shaft_swings_against_the_wheel_as_two_inertias():
    # w^2 = k (1 / (n^2 J_m) + 1 / J)
    drive = dataclasses.replace(DIRECT, **(MOTOR | {"damping": 0.0}))
    poles = np.linalg.eigvals(linearise(compose(Wheel(drag=0.0), drive)).A)
    assert max(poles.imag) == pytest.approx(math.sqrt(1e6 * (1 / 1000.0 + 1 / 100.0)), rel=1e-9)
    # and turns it up to speed as one: (n^2 J_m + J) w' = n T
    run = simulate(compose(Wheel(drag=0.0), dataclasses.replace(DIRECT, **MOTOR)), 2.0, inputs={"drive.command": 550.0}, accuracy=1e-9)
    assert run.at(2.0)["top.speed"] - run.at(1.0)["top.speed"] == pytest.approx(550.0 / 1100.0, rel=1e-6)
    assert run.at(2.0)["drive.motor_speed"] == pytest.approx(10.0 * run.at(2.0)["drive.speed"], rel=1e-12)


@pytest.mark.parametrize("command", [20_000.0, 30_000.0, 33_000.0, 35_000.0, 40_000.0])
def test_a_motor_held_by_its_gearbox_starts_whatever_is_commanded(command):
    # the torque of the teeth is exactly 0 when the gearbox lets go, on the kink of its magnitude
    drive = TopDrive(**MOTOR, **GEARS, encoder_lag=None)
    run = simulate(compose(wells.JANSEN_2, ROCK, drive), 2.0, inputs={"drive.command": command})
    first = run.events[0]
    assert (first.element, first.after) == ("drive", "slip+")
    assert first.time == pytest.approx(-0.005 * math.log1p(-20.0 / command), rel=1e-9)  # command (1 - exp(-t / lag)) = idle torque


@pytest.mark.parametrize(
    "drive",
    [TopDrive(), TopDrive(torque_limit=35e3, rate_limit=2e5), TopDrive(**GEARS), TopDrive(**MOTOR, **GEARS, torque_limit=3500.0)],
    ids=["lags", "limits", "gears", "all"],
)
def test_every_joule_of_a_driven_string_is_accounted_for(drive):
    run = simulate(compose(wells.JANSEN_2, ROCK, drive), 40.0, controller=StiffPI(reference=6.0), accuracy=1e-8)
    audit = energy_audit(run)
    assert audit.relative < 1e-8
    assert all(value >= -1e-9 * audit.turnover for value in audit.losses.values())


def test_soft_torque_through_a_real_drive_still_ends_the_stick_slip_that_a_stiff_drive_leaves():
    plant = compose(wells.JANSEN_2, ROCK, TopDrive(torque_limit=35e3, rate_limit=2e5, **GEARS))
    stiff = simulate(plant, 90.0, controller=StiffPI(reference=9.95))
    soft = simulate(plant, 90.0, controller=SoftTorque(reference=9.95), sample_time=0.01)
    assert stiff.time_in("bit", "stick", after=60.0) > 5.0
    assert soft.time_in("bit", "stick", after=60.0) == 0.0


def test_an_ideal_sliding_mode_is_refused_by_a_motor_with_lags_and_one_with_a_boundary_layer_is_not():
    lagging = compose(wells.JANSEN_2, ROCK, TopDrive())
    with pytest.raises(SceneError, match="relative degree one"):
        simulate(lagging, 1.0, controller=IdealSlidingMode())
    assert simulate(compose(wells.JANSEN_2, ROCK, DIRECT), 1.0, controller=IdealSlidingMode())["top.speed"][-1] > 0
    assert simulate(lagging, 1.0, controller=SlidingMode(), sample_time=0.01)["top.speed"][-1] > 0


def test_a_drive_of_another_name_is_found_by_the_laws_and_two_of_them_are_refused():
    plant = compose(Wheel(), TopDrive(name="motor"))
    run = simulate(plant, 1.0, controller=PI(reference=1.0))
    assert "motor.command" in run and run["motor.speed"][-1] > 0
    with pytest.raises(SceneError, match=r"stand between.*top\.torque"):
        compose(Wheel(), TopDrive(), TopDrive(name="motor"))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"rate_limit": 1.0, "drive_lag": None}, "drive_lag"),
        ({"efficiency": 1.5, "idle_torque": 1.0}, "efficiency"),
        ({"efficiency": 0.9}, "idle_torque"),
        ({"motor_inertia": 1.0}, "stiffness"),
    ],
)
def test_a_drive_that_cannot_be_built_is_refused_by_name(change, word):
    with pytest.raises(SceneError, match=word):
        compose(wells.JANSEN_2, TopDrive(**change))


@dataclasses.dataclass(frozen=True)
class NamedLaw(PI):
    """A PI that calls one of its own methods `law`."""

    def law(self):
        return "proportional and integral"


@pytest.mark.parametrize("sample_time", [None, 0.01])
def test_a_law_may_call_a_method_of_its_own_law_and_still_acts_through_the_drive(sample_time):
    plant = compose(wells.JANSEN_2, ROCK, TopDrive(torque_limit=9000.0))
    gains = {"reference": 9.0, "proportional": 5000.0, "integral": 500.0}
    own = simulate(plant, 20.0, controller=NamedLaw(**gains), sample_time=sample_time)
    same = simulate(plant, 20.0, controller=PI(**gains), sample_time=sample_time)
    assert np.array_equal(own["bit.speed"], same["bit.speed"])
    assert "NamedLaw" in str(own) and own["top.torque"].max() <= 9000.0 * (1 + 1e-9)
    direct = simulate(compose(wells.JANSEN_2, ROCK), 20.0, controller=PI(**gains), sample_time=sample_time)
    assert direct["top.torque"].max() > 20_000.0  # without the drive nothing limits the law
