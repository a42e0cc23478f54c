"""Time stepping: order one over switches and two between them, exact stick, accumulating impacts, many contacts, and a refinement that tells the truth."""

import math
import pickle
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

from controllers import PI
from models import BitRock, Coulomb, TorsionalChain, wells
from studies.benchmarks import reference
from tests.mechanisms import Ball
from tests.plants import BELT
from toolbox import (
    Component,
    DryFriction,
    Equations,
    Sampled,
    SceneError,
    UnilateralContact,
    compose,
    energy_audit,
    quantity,
    simulate,
    state,
    time,
)
from toolbox.errors import AccuracyError, ZenoError
from toolbox.inputs import sine
from toolbox.modelling import Hysteresis, Relay
from toolbox.simulation import TimeStepping  # fmt: skip

RIG = compose(wells.JANSEN_2, BitRock(weight=97_000.0))
DRIVE = PI(proportional=4000.0, integral=1500.0, reference=8.0)


@dataclass(frozen=True)
class Oscillator(Component):
    """x'' + 2 d x' + x = sin(t), without any contact."""

    damping: float = quantity(0.1, "1/s")

    def equations(self, signal):
        x, v = state("mass.position", "m"), state("mass.speed", "m/s")
        return Equations(flow={x: v, v: -x - 2 * self.damping * v + ca.sin(time)})


def slope(steps, errors):
    """Order of convergence by least squares."""
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def test_between_switches_the_error_falls_with_the_square_of_the_step():
    plant, duration = compose(Oscillator()), 10.0
    exact = simulate(plant, duration, start={"mass.position": 1.0}, accuracy=1e-12)
    steps = [0.1, 0.05, 0.025, 0.0125]
    errors = [simulate(plant, duration, start={"mass.position": 1.0}, method=TimeStepping(h))["mass.position"][-1] for h in steps]
    assert slope(steps, np.abs(np.array(errors) - exact["mass.position"][-1])) == pytest.approx(2.0, abs=0.05)


def test_at_switches_the_error_falls_with_the_step_and_away_from_them_with_its_square_against_a_solution_that_shares_no_code():
    switches = reference.belt(100.0, rtol=1e-11).switches
    instants = np.array([s.time for s in switches])
    between = 0.5 * (instants[1:] + instants[:-1])
    at_switches, away = (reference.belt(100.0, rtol=1e-11, output_times=times).states for times in (instants, between))
    steps = [100.0 / n for n in (2_000, 4_100, 8_300, 17_000, 33_000, 67_000, 128_000)]
    runs = [simulate(BELT, 100.0, method=TimeStepping(h)) for h in steps]
    assert slope(steps, [np.abs(run.at(instants).states - at_switches).max() for run in runs]) == pytest.approx(1.0, abs=0.15)
    # the momentum of a step with a switch is right, so that its error is not carried along
    assert slope(steps, [np.abs(run.at(between).states - away).max() for run in runs]) == pytest.approx(2.0, abs=0.3)
    for run, h in zip(runs, steps, strict=True):
        assert [(e.element, e.before, e.after) for e in run.events] == [(s.contact, s.before, s.after) for s in switches]
        assert np.abs(np.array([e.time for e in run.events]) - instants).max() < 2.0 * h


def test_a_sticking_contact_does_not_creep():
    run = simulate(BELT, 100.0, method=TimeStepping(0.01))
    sticking = run.modes["belt"] == "stick"
    assert sticking.sum() > 1000
    assert (run["block.speed"][sticking] == 0.2).all()  # the speed of the belt, to the last bit


def test_a_block_under_a_force_below_its_bound_never_moves_and_above_it_does():
    still = simulate(BELT, 5.0, inputs={"block.force": 0.0}, parameters={"block.belt_speed": 0.0}, method=TimeStepping(0.01))
    assert (still.states == 0.0).all()
    for force, moves in ((0.999, False), (1.001, True)):
        run = simulate(BELT, 5.0, inputs={"block.force": force}, parameters={"block.belt_speed": 0.0}, method=TimeStepping(0.01))
        assert (np.abs(run["block.speed"]).max() > 0.0) == moves


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9])
def test_endlessly_many_bounces_end_at_the_time_of_the_geometric_series(restitution):
    fall = math.sqrt(2 / 10.0)
    rest = fall * (1 + restitution) / (1 - restitution)
    duration = 1.5 * rest
    late = []
    for n in (4_000, 64_000):
        run = simulate(compose(Ball(restitution)), duration, start={"ball.height": 1.0}, method=TimeStepping(duration / n))
        assert run.modes["floor"][-1] == "closed"
        assert abs(run["ball.speed"][-1]) == 0.0
        late.append(abs(run.events[-1].time - rest) / (duration / n))
    assert max(late) < 40.0  # steps; with e = 0.9 each of 40 visible bounces may add a part of one


@dataclass(frozen=True)
class Heated(Component):
    """A room with a thermostat without hysteresis: on below 20 K, off above, both leading back."""

    def equations(self, signal):
        temperature = state("room.temperature", "K")
        off = Hysteresis("thermostat", temperature, 20.0, 20.0, signal_unit="K")
        return Equations(flow={temperature: (30.0 * (1 - off.output) - temperature) / 10.0}, elements=[off])


def test_switching_that_has_no_end_is_passed():
    plant, start = compose(Heated()), {"room.temperature": 18.0}
    with pytest.raises(ZenoError, match=r"`thermostat` switches without end at t = 1\.8"):  # 10 ln(12 / 10) s
        simulate(plant, 10.0, start=start)
    run = simulate(plant, 10.0, start=start, method="time-stepping", accuracy=1e-3)
    assert np.abs(run["room.temperature"][run.time > 2.0] - 20.0).max() < 20.0 * 1e-3
    share = run.time_in("thermostat", "low", after=2.0) / 8.0
    assert share == pytest.approx(2 / 3, abs=0.01)  # of the heating, in the mean, holds 20 K against 30 K


def test_a_ball_that_keeps_its_energy_bounces_to_its_height_again():
    run = simulate(compose(Ball(1.0)), 2.5, start={"ball.height": 1.0}, method=TimeStepping(1e-4))
    flight = 2 * math.sqrt(0.2)
    assert len(run.events) == 3
    assert run.at(flight)["ball.height"] == pytest.approx(1.0, abs=2e-3)


def test_a_wedge_of_friction_at_an_impact_takes_the_coulomb_impulse():
    @dataclass(frozen=True)
    class Slider(Component):
        friction: Coulomb = Coulomb(static=0.3, kinetic=0.3)

        def equations(self, signal):
            a, b = state("slider.along", "m"), state("slider.height", "m")
            u, v = state("slider.u", "m/s"), state("slider.v", "m/s")
            floor = UnilateralContact("floor", -b, -v, restitution=0.5)
            drag = DryFriction("drag", u, self.friction, load=floor.force)
            return Equations(flow={a: u, b: v, u: drag.force, v: floor.force - 10.0}, elements=[floor, drag])

    start = {"slider.height": 1.0, "slider.u": 3.0}
    run = simulate(compose(Slider()), 0.6, start=start, method=TimeStepping(1e-4))
    v = math.sqrt(20.0)
    assert run["slider.u"][-1] == pytest.approx(3.0 - 0.3 * 1.5 * v, abs=2e-3)  # u+ = u - mu (1 + e) v
    exact = simulate(compose(Slider()), 0.6, start=start)
    assert exact["slider.u"][-1] == pytest.approx(3.0 - 0.3 * 1.5 * v, rel=1e-9)


def test_fifty_contacts_in_a_row_stick_and_slip_as_with_located_events():
    n = 50
    dry = TorsionalChain(
        inertia=(2122.0, *(800.0 / (n - 2),) * (n - 2), 374.0), stiffness=(473.0 * (n - 1),) * (n - 1), damping=(23.2 * (n - 1),) * (n - 1),
        top_drag=425.0, bit_drag=50.0, friction=Coulomb(static=1.0, kinetic=1.0), friction_load=(3000.0, *(2400.0 / (n - 2),) * (n - 2), 6000.0),
    )  # fmt: skip
    arguments = {"inputs": {"top.torque": sine(8000.0, 8000.0, 0.8 / (2 * math.pi))}}
    plant = compose(dry)
    exact = simulate(plant, 20.0, accuracy=1e-7, **arguments)
    errors = []
    steps = [20.0 / k for k in (4_000, 16_000)]
    for h in steps:
        run = simulate(plant, 20.0, method=TimeStepping(h), **arguments)
        errors.append(run.difference(exact))
        for i in (0, 25, 49):
            assert run.time_in(f"chain.{i}", "stick") == pytest.approx(exact.time_in(f"chain.{i}", "stick"), abs=60 * h)
    assert errors[1] < 0.4 * errors[0] < 0.02


def test_coupled_contacts_agree_with_the_event_method():
    @dataclass(frozen=True)
    class Stack(Component):
        """Three plates on each other; the lowest is pulled. The slips share the plates, so that forces couple."""

        friction: Coulomb = Coulomb(static=0.5, kinetic=0.4)

        def equations(self, signal):
            x, v = state("stack.x", "m", 3), state("stack.v", "m/s", 3)
            pull = 12.0 * ca.sin(2 * time)
            a = DryFriction("floor", v[0], self.friction, load=30.0)
            b = DryFriction("middle", v[1] - v[0], self.friction, load=20.0)
            c = DryFriction("top", v[2] - v[1], self.friction, load=10.0)
            forces = ca.vertcat(a.force - b.force + 2.2 * pull, b.force - c.force, c.force)
            return Equations(flow={x: v, v: forces}, elements=[a, b, c])

    exact = simulate(compose(Stack()), 10.0, accuracy=1e-9)
    assert len(exact.events) > 10
    steps = [10.0 / n for n in (2_000, 8_000, 32_000)]
    errors = [simulate(compose(Stack()), 10.0, method=TimeStepping(h)).difference(exact) for h in steps]
    assert slope(steps, errors) == pytest.approx(1.0, abs=0.3)


@dataclass(frozen=True)
class SuperTwist(Component):
    """s' = d(t) - k sqrt|s| sgn(s) + v, v' = -K sgn(s), one sgn for both: continuous super-twisting against d = sin t."""

    gain: float = quantity(2.0, "1")
    integral: float = quantity(3.0, "1")

    def equations(self, signal):
        s, v = state("twist.s", "1"), state("twist.v", "1/s")
        sign = Relay("sign", s, 1.0)
        # the root is kept away from zero, where it has no slope, by less than a step can see
        return Equations(
            flow={s: ca.sin(time) + self.gain * ca.sqrt(ca.sqrt(s**2 + 1e-28)) * sign.force + v, v: self.integral * sign.force},
            elements=[sign],
        )


def test_continuous_super_twisting_slides_on_its_surface():
    free = simulate(compose(SuperTwist(gain=1e-9, integral=1e-9)), 10.0, start={"twist.s": 1.0}, method=TimeStepping(1e-3))
    assert np.abs(free["twist.s"][-5000:]).max() > 0.1  # without the law the disturbance drives s about
    errors = []
    for h in (4e-3, 1e-3):
        run = simulate(compose(SuperTwist()), 10.0, start={"twist.s": 1.0}, method=TimeStepping(h))
        late = run.time > 5.0
        assert np.abs(run["twist.s"][late]).max() < 1e-12
        errors.append(np.abs(run["twist.v"] + np.sin(run.time))[late].max())
    assert errors[1] < 0.3 * errors[0] < 0.002  # v is -d, at order one


def test_a_sampled_law_acts_at_the_same_instants_with_the_same_noise():
    controller = Sampled(DRIVE, 0.05, noise={"top.speed": 0.05}, seed=3)
    exact = simulate(RIG, 10.0, controller=controller, accuracy=1e-9)
    run = simulate(RIG, 10.0, controller=controller, method=TimeStepping(1e-3))
    assert run.difference(exact) < 2e-3
    times = np.arange(0.0, 10.0, 0.05)
    changes = run.time[1:][np.diff(run["top.torque"]) != 0.0]
    assert np.abs(changes[:, None] - times[None, :]).min(axis=1).max() < 1e-12


def test_a_law_in_python_is_asked_once_per_sample():
    asked = []

    def law(t, y):
        asked.append(t)
        return 4000.0 * (8.0 - y[0])

    law.measured_signals, law.actuated_signals = ("top.speed",), ("top.torque",)
    run = simulate(RIG, 2.0, controller=law, sample_time=0.1, method=TimeStepping(1e-3))
    np.testing.assert_allclose(asked, np.arange(20) * 0.1, atol=1e-12)
    exact = simulate(RIG, 2.0, controller=law, sample_time=0.1)
    assert run.difference(exact) < 1e-2


def test_output_times_are_those_asked_for_and_agree_with_the_nodes():
    grid = np.linspace(0.0, 20.0, 77)
    run = simulate(BELT, 20.0, method=TimeStepping(0.013), output_times=grid)
    assert (run.time == grid).all()
    whole = simulate(BELT, 20.0, method=TimeStepping(0.013))
    np.testing.assert_allclose(run["block.position"], whole.at(grid)["block.position"], rtol=1e-12, atol=1e-14)
    assert run.events == whole.events


def test_a_run_travels():
    run = simulate(BELT, 20.0, method=TimeStepping(0.01))
    twin = pickle.loads(pickle.dumps(run))
    assert type(twin) is type(run)
    assert (twin.at(3.33).states == run.at(3.33).states).all()
    assert twin.step == 0.01
    assert "time stepping, steps of 0.01 s" in str(run)


def test_energy_is_balanced_as_far_as_the_order_goes():
    missing = [energy_audit(simulate(BELT, 20.0, method=TimeStepping(h))).relative for h in (2e-2, 5e-3)]
    assert missing[1] < 0.5 * missing[0] < 0.05


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3])
def test_the_dial_meets_what_is_asked_and_reports_the_error_that_was_made(accuracy):
    exact = simulate(RIG, 100.0, controller=DRIVE, accuracy=1e-10)
    run = simulate(RIG, 100.0, controller=DRIVE, method="time-stepping", accuracy=accuracy)
    made = run.difference(exact)
    assert made < accuracy
    assert made / 10 < run.error_estimate < 10 * made
    given = simulate(RIG, 100.0, controller=DRIVE, method=TimeStepping(run.step))
    assert made / 10 < given.error_estimate < 10 * made


def test_an_accuracy_out_of_reach_is_an_error_with_the_best_run():
    with pytest.raises(AccuracyError, match="cannot meet the accuracy 1e-08: .* steps .* use method='event'") as caught:
        simulate(BELT, 100.0, method="time-stepping", accuracy=1e-8)
    best = caught.value.run
    assert best.difference(simulate(BELT, 100.0, accuracy=1e-10)) < 10 * best.error_estimate


def test_a_step_is_refused_where_it_means_nothing():
    for bad in (0.0, -1.0, math.nan, "short", 1e-12):
        with pytest.raises(SceneError, match="Argument `step` must be (a finite number|> 0 s|>= 5e-08 s)"):
            simulate(BELT, 1.0, method=TimeStepping(bad))


def test_a_run_of_no_duration_shows_the_start():
    run = simulate(BELT, 0.0, method="time-stepping", accuracy=1e-3)
    assert run.time.tolist() == [0.0]


def test_a_run_with_a_step_can_be_made_again_with_located_events():

    run = simulate(BELT, 20.0, method=TimeStepping(1e-5))
    exact = run.run.again(method="explicit")
    assert (exact.states == simulate(BELT, 20.0, method="explicit").states).all()


def test_a_long_run_of_short_steps_records_some_of_them_and_all_switches():
    run = simulate(BELT, 20.0, method=TimeStepping(1e-5))
    assert run.steps[0] > 1_900_000 > 500_000 > run.time.size
    nodes = set(run.time.tolist())
    assert all(event.time in nodes for event in run.events)
