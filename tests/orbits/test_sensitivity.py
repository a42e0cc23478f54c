"""Derivatives through stick, slip, impacts and switches against closed forms and central differences."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

from controllers import StiffPI
from models import Block, BlockOnBelt, BlocksOnBelt, Coulomb, Exponential, TwoDisks, wells
from tests.plants import BELT, RIG
from tests.refusals import refusals
from toolbox import Component, DryFriction, Equations, SceneError, UnilateralContact, compose, quantity, sensitivity, simulate, state
from toolbox.errors import GrazingError
from toolbox.inputs import sine, step
from toolbox.modelling import Hysteresis, Relay


def differenced(plant, duration, to, measured, *, start=None, parameters=None, inputs=None, relative=1e-6, **options):
    """Central differences (k, ...) of what `measured` takes from a run, and the run between them."""
    start, parameters, inputs = dict(start or {}), dict(parameters or {}), dict(inputs or {})

    def run(name=None, by=0.0):
        changed = {"start": dict(start), "parameters": dict(parameters), "inputs": dict(inputs)}
        if name in inputs:
            changed["inputs"][name] += by
        elif name in start:
            changed["start"][name] += by
        elif name is not None:
            changed["parameters"][name] = parameters.get(name, plant.parameter(name)) + by
        return simulate(plant, duration, accuracy=1e-12, **changed, **options)

    rows = []
    for name in to:
        value = inputs.get(name, start.get(name)) if name in inputs or name in start else plant.parameter(name)
        by = relative * (abs(value) or 1.0)
        rows.append((measured(run(name, by)) - measured(run(name, -by))) / (2 * by))
    return np.array(rows), run()


def agree(plant, duration, to, tolerance=1e-6, **options):
    """Compare states at the end and event times with differences, relative to the largest of each."""
    found, run = differenced(plant, duration, to, lambda r: np.concatenate([r.states[-1], [e.time for e in r.events]]), **options)
    exact = sensitivity(run, to)
    computed = np.concatenate([exact._tangent.end[:, exact._order], exact.event_times]).T
    for name, mine, theirs in zip(to, computed, found, strict=True):
        np.testing.assert_allclose(mine, theirs, atol=tolerance * np.abs(theirs).max(), err_msg=name)
    return run, exact


LINEAR = BlockOnBelt(damping=0.3, load=0.0, belt_speed=50.0)


def test_a_block_without_friction_has_the_derivative_of_its_matrix_exponential():
    from scipy.linalg import expm

    run = simulate(compose(LINEAR), 3.0, start={"block.position": 1.0, "block.speed": -0.4}, accuracy=1e-12)
    exact = sensitivity(run, ("block.position", "block.speed"))
    theory = expm(3.0 * np.array([[0.0, 1.0], [-1.0, -0.3]]))
    np.testing.assert_allclose(np.array([exact.end("block.position"), exact.end("block.speed")]), theory, atol=1e-10)
    np.testing.assert_allclose(exact.states[-1], theory, atol=1e-10)


@dataclass(frozen=True)
class Rotor(Component):
    """A rotor that coasts: inertia w' = -drag w - friction, one state."""

    inertia: float = quantity(1.0, "kg m2", "inertia", above=0)
    drag: float = quantity(0.01, "N m s/rad", "drag", at_least=0)
    friction: Coulomb = Coulomb(static=0.2, kinetic=0.2)

    def equations(self, signal):
        w = state("rotor.speed", "rad/s")
        bearing = DryFriction("bearing", w, self.friction, slip_unit="rad/s", force_unit="N m")
        return Equations(flow={w: (bearing.force - self.drag * w) / self.inertia}, elements=[bearing])


@pytest.mark.parametrize("names", [["rotor.inertia"], ["rotor.inertia", "rotor.drag"], ["rotor.speed", "rotor.drag", "rotor.inertia"]])
def test_a_plant_with_one_state_has_the_derivatives_of_its_closed_form(names):
    """w(t) = (1 + T / c) exp(-c t / J) - T / c, with J 1 kg m2, c 0.01 N m s/rad, T 0.2 N m, from 1 rad/s."""
    end, inertia, drag, torque = 3.0, 1.0, 0.01, 0.2
    decay, level = math.exp(-drag * end / inertia), torque / drag
    exact = {
        "rotor.inertia": (1.0 + level) * decay * drag * end / inertia**2,
        "rotor.drag": -(level / drag) * decay - (1.0 + level) * decay * end / inertia + level / drag,
        "rotor.speed": decay,
    }
    found = sensitivity(simulate(compose(Rotor()), end, start={"rotor.speed": 1.0}, accuracy=1e-10), names)
    assert np.asarray(found["rotor.speed"])[-1] == pytest.approx([exact[name] for name in names], rel=1e-7)


def test_the_release_of_a_block_on_a_belt_moves_with_static_friction_as_the_closed_form_says():
    # from x = 0 at belt speed v the block sticks until k x = F_s: t = F_s / (k v)
    plant = compose(BlockOnBelt(belt_speed=0.5, stiffness=2.0, friction=Coulomb(static=1.0, kinetic=0.6)))
    run = simulate(plant, 2.0, start={"block.speed": 0.5}, accuracy=1e-12)
    exact = sensitivity(run, ("belt.friction.static", "block.stiffness", "block.belt_speed", "block.position"))
    np.testing.assert_allclose(run.events[0].time, 1.0, rtol=1e-11)
    np.testing.assert_allclose(exact.event_times[0], [1.0, -0.5, -2.0, -2.0], rtol=1e-9)


def test_stick_forgets_the_speed_with_which_it_was_entered():
    plant = compose(BlockOnBelt(belt_speed=0.5, friction=Coulomb(static=1.0, kinetic=0.6)))
    run = simulate(plant, 1.5, start={"block.speed": 0.2}, accuracy=1e-12)
    assert run.modes["belt"][-1] == "stick"
    exact = sensitivity(run, ("block.speed", "block.belt_speed"))
    np.testing.assert_allclose(exact.end("block.speed"), [0.0, 1.0], atol=1e-12)


def test_derivatives_of_leines_oscillator_through_four_events_agree_with_differences():
    plant = compose(BlockOnBelt(damping=0.02, friction=Exponential(static=1.0, kinetic=0.4, decay=3.0)))
    to = (
        "block.mass",
        "block.stiffness",
        "block.belt_speed",
        "belt.friction.static",
        "belt.friction.decay",
        "block.position",
        "block.speed",
    )
    run, exact = agree(plant, 21.0, to, start={"block.position": 0.1, "block.speed": 0.05})
    assert len(run.events) >= 4
    found, _ = differenced(plant, 21.0, to, lambda r: r.time_in("belt", "stick"), start={"block.position": 0.1, "block.speed": 0.05})
    np.testing.assert_allclose(exact.time_in("belt", "stick"), found, atol=1e-6 * np.abs(found).max())


def test_derivatives_of_a_drill_string_under_a_stiff_drive_agree_with_differences():
    start = {"chain.speed.0": 9.0, "chain.speed.1": 5.0}
    to = ("bit.weight", "chain.stiffness.0", "chain.bit_drag", "chain.speed.1")
    run, exact = agree(RIG, 16.0, to, start=start, controller=StiffPI(reference=9.9))
    assert len(run.events) >= 3
    found, _ = differenced(RIG, 16.0, to, lambda r: r["bit.torque"][-1], start=start, controller=StiffPI(reference=9.9))
    np.testing.assert_allclose(exact.end("bit.torque"), found, atol=1e-6 * np.abs(found).max())


def test_the_peak_of_a_signal_has_the_derivative_that_differences_show():
    to = ("bit.weight", "top.torque")

    def peak(run):
        times = np.linspace(0.0, 12.0, 4001)
        best = times[np.argmax(run.at(times)["bit.speed"])]
        for _ in range(30):
            rate = (run.at(best + 1e-5)["bit.speed"] - run.at(best - 1e-5)["bit.speed"]) / 2e-5
            bend = (run.at(best + 1e-2)["bit.speed"] - 2 * run.at(best)["bit.speed"] + run.at(best - 1e-2)["bit.speed"]) / 1e-4
            best -= rate / bend
        return run.at(best)["bit.speed"]

    found, run = differenced(RIG, 12.0, to, peak, inputs={"top.torque": 12_300.0}, relative=1e-5)
    np.testing.assert_allclose(sensitivity(run, to).peak("bit.speed"), found, rtol=1e-6)


def test_the_peak_is_the_highest_one_whichever_node_is_the_largest():
    # x_max = v_0 / w exp(-z acos(z) / sqrt(1 - z^2)), z = c / (2 m w), is the first peak; those that follow are lower by 3e-6 each, nodes miss them by more
    damping = 1e-6
    run = simulate(compose(Block()), 60.0, parameters={"block.damping": damping}, start={"block.speed": 1.0}, accuracy=1e-10)
    slopes = sensitivity(run, ("block.damping", "block.speed")).peak("block.position")
    np.testing.assert_allclose(slopes, (-math.pi / 4, 1.0 - damping * math.pi / 4), rtol=3e-6)


def test_guards_that_depend_on_time_and_input_jumps_are_differentiated():
    plant = compose(BlockOnBelt(belt_speed=0.0, damping=0.05, friction=Coulomb(static=0.5, kinetic=0.3)))
    run = simulate(plant, 11.0, start={"block.position": 0.2}, inputs={"block.force": sine(0.0, 1.2, 0.11)}, accuracy=1e-12)
    assert {"stick", "slip+", "slip-"} <= set(run.modes["belt"])
    exact = sensitivity(run, ("block.force.amplitude", "block.force.frequency", "block.mass", "block.position"))
    for j, change in enumerate(({"amplitude": 1.0}, {"frequency": 1.0}, {"mass": 1.0}, {"x": 1.0})):
        by, ends = 1e-6, []
        for sign in (1.0, -1.0):
            d = {key: sign * by * value for key, value in change.items()}
            other = simulate(
                plant, 11.0, start={"block.position": 0.2 + d.get("x", 0.0)}, parameters={"block.mass": 1.0 + d.get("mass", 0.0)},
                inputs={"block.force": sine(0.0, 1.2 + d.get("amplitude", 0.0), 0.11 + d.get("frequency", 0.0))}, accuracy=1e-12,
            )  # fmt: skip
            ends.append(np.concatenate([other.states[-1], [e.time for e in other.events]]))
        found = (ends[0] - ends[1]) / (2 * by)
        mine = np.concatenate([exact.states[-1][:, j], exact.event_times[:, j]])
        np.testing.assert_allclose(mine, found, atol=1e-6 * np.abs(found).max())
    jumping = {"block.force": step(0.0, 0.9, 2.0)}
    ends = []
    for sign in (1.0, -1.0):
        ends.append(simulate(plant, 6.0, inputs=jumping, parameters={"block.mass": 1.0 + sign * 1e-6}, accuracy=1e-12).states[-1])
    run = simulate(plant, 6.0, inputs=jumping, accuracy=1e-12)
    assert run.events[0].time == 2.0
    np.testing.assert_allclose(sensitivity(run, "block.mass").states[-1][:, 0], (ends[0] - ends[1]) / 2e-6, atol=1e-6)


def test_two_contacts_that_stick_in_turn_are_differentiated():
    plant = compose(BlocksOnBelt(damping=(0.05, 0.05)))
    to = ("blocks.mass.0", "blocks.tie.0", "blocks.position.0", "blocks.speed.1")
    run, _ = agree(plant, 25.0, to, start={"blocks.position.0": 0.3, "blocks.position.1": -0.2, "blocks.speed.1": 0.1})
    assert {e.element for e in run.events} == {"belt.0", "belt.1"}


def test_contacts_that_do_not_act_on_one_state_alone_are_differentiated():
    plant = compose(TwoDisks(rotor_inertia=20.0, friction=Exponential(0.4, 0.3, 2.0)))
    run, _ = agree(plant, 0.4, ("disks.rotor_inertia", "disks.stiffness", "disks.rotor_speed"), start={"disks.rotor_speed": 2.0}, tolerance=2e-6,
                   inputs={"disks.torque": 40.0, "disks.normal_force": 1000.0})  # fmt: skip
    assert run.events


@dataclass(frozen=True)
class Ball(Component):
    """A ball over a floor: h' = v, v' = -g + N / m, with friction of the floor against its sideways speed w."""

    gravity: float = quantity(9.81, "m/s2", "gravity")
    restitution: float = quantity(0.8, "1", "restitution")
    friction: float = quantity(0.1, "1", "friction")
    stiffness: float = quantity(4000.0, "N/m", "stiffness of the floor")
    damping: float = quantity(3.0, "N s/m", "damping of the floor")
    rigid: bool = True

    def equations(self, signal):
        h, v, w = state("ball.height", "m"), state("ball.speed", "m/s"), state("ball.sideways", "m/s")
        if self.rigid:
            floor = UnilateralContact("floor", -h, -v, restitution=self.restitution)
        else:
            floor = UnilateralContact("floor", -h, -v, stiffness=self.stiffness, damping=self.damping)
        rub = DryFriction("rub", w, Coulomb(static=0.1, kinetic=0.1), floor.force)
        return Equations(flow={h: v, v: floor.force - self.gravity, w: rub.force}, elements=[floor, rub])


@pytest.mark.parametrize("rigid", [True, False])
def test_bounces_with_friction_are_differentiated(rigid):
    plant = compose(Ball(rigid=rigid))
    start = {"ball.height": 1.0, "ball.speed": 0.0, "ball.sideways": 5.0}
    to = ("ball.gravity", "ball.height", "ball.sideways", "ball.restitution" if rigid else "ball.stiffness")
    run, exact = agree(plant, 1.6, to, start=start)
    assert sum(e.element == "floor" for e in run.events) >= 2
    fall = math.sqrt(2 / 9.81)
    np.testing.assert_allclose(exact.event_times[0, :2], [-fall / (2 * 9.81), fall / 2], rtol=1e-9)


@dataclass(frozen=True)
class Thermostat(Component):
    """Heating that is on below `low` and off above `high`, and a pump held on its set-point by an ideal relay."""

    power: float = quantity(2.0, "K/s", "heating")
    loss: float = quantity(0.5, "1/s", "loss")
    band: float = quantity(0.2, "K", "half of the band")
    pump: float = quantity(1.0, "1/s", "bound of the relay")

    def equations(self, signal):
        warm, flow = state("room.warm", "K"), state("room.flow", "1")
        switch = Hysteresis("switch", warm, 1.0 - self.band, 1.0 + self.band)
        relay = Relay("relay", flow - 0.3 * warm, self.pump)
        heat = self.power * (1 - switch.output)
        return Equations(flow={warm: heat - self.loss * warm * (1 + flow), flow: relay.force - 0.1 * flow}, elements=[switch, relay])


def test_a_thermostat_and_an_ideal_relay_are_differentiated():
    plant = compose(Thermostat())
    run, _ = agree(plant, 4.0, ("room.power", "room.band", "room.loss", "room.warm"), start={"room.warm": 0.4, "room.flow": 0.7})
    assert {"switch", "relay"} <= {e.element for e in run.events}


@dataclass(frozen=True)
class Clipped(Component):
    """A mass with a saturated spring: v' = -min(k x, limit) - 0.2 |v|."""

    stiffness: float = quantity(3.0, "N/m", "stiffness")
    limit: float = quantity(1.0, "N", "largest force")

    def equations(self, signal):
        x, v = state("mass.position", "m"), state("mass.speed", "m/s")
        return Equations(flow={x: v, v: -ca.fmin(self.stiffness * x, self.limit) - 0.2 * ca.fabs(v)})


def test_a_kink_passes_derivatives_on_without_a_jump_in_time():
    plant = compose(Clipped())
    agree(plant, 6.0, ("mass.stiffness", "mass.limit", "mass.position", "mass.speed"), start={"mass.position": 1.0, "mass.speed": 0.3})


def test_output_times_give_the_derivatives_of_the_same_instants():
    options = {"inputs": {"top.torque": 12_300.0}, "accuracy": 1e-10}
    times = np.linspace(0.0, 10.0, 21)
    whole = sensitivity(simulate(RIG, 10.0, **options), "top.torque")
    some = sensitivity(simulate(RIG, 10.0, output_times=times, **options), "top.torque")
    assert some["bit.speed"].shape == (21, 1) and some["chain.speed"].shape == (21, 2, 1)
    np.testing.assert_allclose(some["bit.speed"][-1], whole["bit.speed"][-1], rtol=1e-9)
    before, after = (
        simulate(RIG, 10.0, inputs={"top.torque": 12_300.0 + by}, accuracy=1e-12, output_times=times)["bit.speed"] for by in (-0.01, 0.01)
    )
    np.testing.assert_allclose(some["bit.speed"][:, 0], (after - before) / 0.02, atol=1e-6 * np.abs(some["bit.speed"]).max())


def test_a_grazing_run_is_refused_and_names_element_and_time():
    # frictionless swing between walls of speed: x = sin t reaches the switch at its very top, and touches it
    @dataclass(frozen=True)
    class Touch(Component):
        def equations(self, signal):
            x, v = state("swing.position", "m"), state("swing.speed", "m/s")
            switch = Hysteresis("switch", x, 0.0, 1.0 - 1e-15)
            return Equations(flow={x: v, v: -x}, elements=[switch])

    run = simulate(compose(Touch()), 2.0, start={"swing.speed": 1.0}, accuracy=1e-12)
    assert run.events
    with pytest.raises(GrazingError, match="switch"):
        sensitivity(run, "swing.speed")


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: sensitivity(simulate(compose(BlocksOnBelt(mass=(1.0, 1.0), tie=(0.0,), stiffness=(1.0, 1.0))), 7.0, start={"blocks.position.0": 0.5,
     "blocks.position.1": 0.5}, accuracy=1e-10), ("blocks.position.0", "blocks.position.1")), "one instant", GrazingError),
    (lambda: sensitivity(simulate(BELT, 1.0), "block.mas"), r"block\.mass"),
    (lambda: sensitivity(simulate(compose(wells.JANSEN_2), 1.0), "chain.inertia"), "one number, but it has 2 entries"),
    (lambda: sensitivity(simulate(BELT, 1.0, inputs={"block.force": step(0, 1, 0.5)}), "block.force"), "varies in time"),
    (lambda: sensitivity(simulate(compose(wells.JANSEN_2), 1.0, controller=StiffPI(), inputs={"top.reference": 8.0}), "stiffpi.reference"),
     r"`stiffpi\.reference` must have an effect to be varied, but the input `top\.reference` overrides it"),
    (lambda: sensitivity(simulate(BELT, 1.0, inputs={"block.force": step(0, 1, 0.5)}), "block.force.at"),
     "a number of a table in time, by which no derivative is computed"),
)  # fmt: skip


def test_an_input_that_nobody_gives_has_the_derivatives_of_its_default():
    drilled = simulate(RIG, 3.0, controller=StiffPI())
    found = sensitivity(drilled, ("top.reference", "bit.weight")).end("top.speed")
    assert found[0] == pytest.approx(sensitivity(drilled, "stiffpi.reference").end("top.speed")[0], rel=1e-9) and found[0] > 0.1
    given = simulate(RIG, 3.0, controller=StiffPI(), inputs={"bit.weight": drilled.run.loop.number("bit.weight").value})
    assert found[1] == pytest.approx(sensitivity(given, "bit.weight").end("top.speed")[0], rel=1e-9)
    with pytest.raises(SceneError, match=r"the input `top\.reference` overrides it"):
        sensitivity(drilled, ("top.reference", "stiffpi.reference"))


def test_derivatives_print_themselves_and_refuse_a_peak_at_the_end():
    run = simulate(compose(BlockOnBelt()), 1.0, start={"block.position": 0.1, "block.speed": 0.2}, accuracy=1e-10)
    exact = sensitivity(run, ("block.mass", "block.belt_speed"))
    assert "with respect to block.mass, block.belt_speed" in str(exact)
    assert exact.end("block.speed").tolist() == [0.0, 1.0]  # it still sticks
    with pytest.raises(SceneError, match="largest at its end"):
        exact.peak("block.position")


def test_a_run_that_stepped_implicitly_is_differentiated_along_explicit_steps():
    stiff, explicit = (simulate(BELT, 5.0, method=method, accuracy=1e-9) for method in ("stiff", "explicit"))
    np.testing.assert_allclose(
        sensitivity(stiff, "block.stiffness").end("block.position"),
        sensitivity(explicit, "block.stiffness").end("block.position"),
        rtol=1e-9,
    )
