"""Friction laws with memory: how a law declares its states, what a contact makes of them, and what is said where modes are missing."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import pytest

from controllers import LinearMPC, SoftTorque
from models import (
    BitRock,
    Block,
    BlockOnBelt,
    Coulomb,
    Dahl,
    Exponential,
    GuideContact,
    HystereticBitRock,
    LuGre,
    StepFriction,
    WhirlingCollar,
    averaged_friction,
    tangential_dither,
    wells,
)
from toolbox import (
    Component,
    DryFriction,
    Equations,
    FrictionLaw,
    Quantity,
    SceneError,
    closed_loop,
    compose,
    energy_audit,
    equilibrium,
    hopf_points,
    limit_cycle,
    linearise,
    margins,
    measure,
    onset,
    quantity,
    sensitivity,
    simulate,
    state,
    sweep,
)
from toolbox.contacts import ContactProblem
from toolbox.measuring import metrics

HEAVY = Block(mass=1e12, stiffness=0.0)
BIT = LuGre(stiffness=200.0, damping=0.2, steady=Exponential(0.8, 0.5, 0.9))
RIG = compose(wells.JANSEN_2, BitRock(friction=BIT))
TWIN = compose(wells.JANSEN_2, BitRock(friction=Exponential(0.8, 0.5, 0.9)))


@dataclass(frozen=True)
class Squared(FrictionLaw):
    """Dahl's friction with the exponent 2: dF/dx = s (1 - F / F_k)^2, so that F = s x / (1 + s x / F_k) from rest."""

    stiffness: Quantity = quantity(50.0, "1/m", "stiffness before sliding", above=0)
    kinetic: Quantity = quantity(0.7, "1", "sliding friction", above=0)

    def memory(self, directions):
        return {"grip": ("1", (0.0,) * directions)}

    def evolution(self, slip, speed, load, memory):
        along = memory["grip"] / self.kinetic
        # (1 - along)^2 v for v > 0 and (1 + along)^2 v for v < 0
        return memory["grip"], {"grip": self.stiffness * (slip * (1 + along**2) - 2 * speed * along)}


@dataclass(frozen=True)
class Ageing(FrictionLaw):
    """Friction that grows from its start value 2 s with the time at rest: mu = 0.1 T, T' = 1 - v T / D."""

    distance: Quantity = quantity(0.5, "m", "distance D", above=0)

    def memory(self, directions):
        return {"age": ("s", 2.0)}

    def evolution(self, slip, speed, load, memory):
        return 0.1 * memory["age"] * slip / (speed + 1e-9), {"age": 1 - speed * memory["age"] / self.distance}


def test_a_law_of_the_user_with_memory_is_a_law():
    run = simulate(compose(HEAVY, GuideContact(load=3.0, friction=Squared())), 1.0, start={"block.speed": 0.2}, accuracy=1e-11)
    way = 0.2 * np.linspace(0, 1, 50)
    np.testing.assert_allclose(run.at(way / 0.2)["guide.drag"], 3 * 50 * way / (1 + 50 * way / 0.7), rtol=1e-9, atol=1e-10)
    assert energy_audit(run).relative < 1e-9


def test_a_law_with_memory_begins_with_its_start_value_unless_the_run_says_otherwise():
    plant = compose(HEAVY, GuideContact(friction=Ageing()))
    assert plant.begin.tolist() == [0.0, 0.0, 2.0]
    for start, first in (({}, 2.0), ({"guide.age": 1.0}, 1.0)):
        run = simulate(plant, 2.0, start={"block.speed": 0.5, **start}, accuracy=1e-11)
        times = np.linspace(0, 2, 20)
        np.testing.assert_allclose(run.at(times)["guide.age"], 1 + (first - 1) * np.exp(-times), atol=1e-9)


def test_runs_side_by_side_begin_with_the_start_value_too():
    plant = compose(HEAVY, GuideContact(friction=Ageing()))
    found = sweep(
        plant, {"guide.friction.distance": [0.25, 0.5, 1.0]}, 2.0,
        start=lambda point: {"block.speed": 0.5}, metrics={"age": metrics.final("guide.age")}, accuracy=1e-9,
    )  # fmt: skip
    limits = [0.5, 1.0, 2.0]  # D / v, approached at the rate v / D
    expected = [limit + (2.0 - limit) * math.exp(-2.0 / limit) for limit in limits]
    np.testing.assert_allclose(np.ravel(found["age"]), expected, rtol=1e-6)


def test_numbers_of_a_law_with_memory_bear_the_name_of_their_contact_and_the_units_of_its_slip():
    units = {name: entry.unit for name, entry in RIG.parameters.items() if "friction" in name}
    assert units == {
        "bit.friction.stiffness": "1/rad", "bit.friction.damping": "s/rad", "bit.friction.viscous": "s/rad", "bit.friction.steady.static": "1",
        "bit.friction.steady.kinetic": "1", "bit.friction.steady.decay": "s/rad",
    }  # fmt: skip
    assert RIG.states["bit.deflection"][2] == "rad"
    assert BitRock(friction=LuGre(stiffness="2 1/deg")).friction.stiffness == pytest.approx(360 / math.pi)
    twice = compose(GuideContact(friction=Dahl()), BlockOnBelt(friction=Dahl()))
    assert set(twice.modeless) == {"belt", "guide"} and {"belt.deflection", "guide.deflection"} <= set(twice.states)


@pytest.mark.parametrize(
    "law, word",
    [
        (LuGre(stiffness=-1.0), "stiffness.*must be >"),
        (LuGre(steady=Dahl()), "`steady` must be a law without memory"),
        (LuGre(steady=StepFriction()), "`steady` must be a law without memory and without jumps"),
        (LuGre(steady=Coulomb(0.0, 0.0)), "`steady` must have a static friction > 0"),
        (LuGre(steady=Coulomb(0.2, 0.3)), "`kinetic` must be <= the static"),
    ],
)
def test_a_law_with_memory_refuses_numbers_that_make_no_sense(law, word):
    with pytest.raises(SceneError, match=word):
        compose(BlockOnBelt(friction=law))


def test_every_state_of_a_law_needs_its_rate():
    class Still(Squared):
        def evolution(self, slip, speed, load, memory):
            return memory["grip"], {}

    with pytest.raises(SceneError, match="`belt` must give a rate for grip, but it gives none"):
        compose(BlockOnBelt(friction=Still()))


@pytest.mark.parametrize(
    "ask, word",
    [
        (lambda: compose(wells.JANSEN_2, HystereticBitRock(friction=Dahl())), "`friction` must be a law without memory"),
        (
            lambda: simulate(RIG, 1.0, controller=LinearMPC(reference=8.0)),
            "the law of `bit`, LuGre, has a memory: give the rock its steady curve",
        ),
        (lambda: averaged_friction(LuGre(), 0.1, 1.0), "`law` must be without memory"),
        (lambda: tangential_dither(RIG, "bit", 1.0, 50.0), "`bit` has no modes"),
        (lambda: ContactProblem(np.eye(1), np.eye(1), np.ones((1, 1, 1)), LuGre(), load=[1.0]), "`friction` must be .* without memory"),
    ],
)
def test_what_rests_on_a_law_of_the_slip_alone_refuses_one_with_memory(ask, word):
    with pytest.raises(SceneError, match=word):
        ask()


def test_a_rigid_wall_does_not_carry_a_law_with_memory_and_an_elastic_one_does():
    with pytest.raises(SceneError, match="`rub` must not come from a rigid contact, as its law has a memory: make that elastic"):
        compose(dataclasses.replace(wells.JANSEN_2, collar_index=0), WhirlingCollar(restitution=0.5, weight=0.0, friction=Dahl()))
    assert compose(dataclasses.replace(wells.JANSEN_2, collar_index=0), WhirlingCollar(weight=0.0, friction=Dahl())).modeless == {
        "rub": "Dahl"
    }


def test_a_contact_of_the_users_part_and_a_law_with_memory_agree_without_a_word():
    @dataclass(frozen=True)
    class Sledge(Component):
        friction: FrictionLaw = Coulomb(0.5, 0.4)

        def equations(self, signal):
            v = state("sledge.speed", "m/s")
            snow = DryFriction("snow", v, self.friction, load=9.81)
            return Equations(flow={v: snow.force}, elements=[snow], stored=v**2 / 2, losses={"snow": -snow.force * v})

    run = simulate(compose(Sledge(friction=Dahl(5000.0, 0.4))), 1.0, start={"sledge.speed": 10.0}, accuracy=1e-10)
    assert run.at(1.0)["sledge.speed"] == pytest.approx(10.0 - 0.4 * 9.81, abs=1e-4)
    assert energy_audit(run).relative < 1e-8


# --- what needs modes says so; what needs none works


@pytest.fixture(scope="module")
def running():
    return simulate(RIG, 300.0, controller=SoftTorque(reference=2.0))


@pytest.mark.parametrize(
    "ask",
    [
        lambda run: run.modes["bit"],
        lambda run: run.at(1.0).modes["bit"],
        lambda run: run.time_in("bit", "stick"),
        lambda run: measure.stick_intervals(run, "bit"),
        lambda run: measure.cycles(run, "bit"),
        lambda run: equilibrium(closed_loop(RIG, SoftTorque(reference=8.0)), mode={"bit": "slip+"}),
        lambda run: onset(closed_loop(RIG, SoftTorque(reference=8.0)), "top.reference", (1.0, 12.0)),
        lambda run: sweep(
            closed_loop(RIG, SoftTorque(reference=2.0)), {"bit.weight": [5e4]}, 10.0, metrics={"s": metrics.stuck_ratio("bit")}
        ),
    ],
)
def test_what_needs_modes_says_that_the_contact_has_none_and_what_does_instead(running, ask):
    with pytest.raises(SceneError, match=r"`bit` has no modes and never sticks exactly, because its friction law, LuGre, has a memory"):
        ask(running)


def test_a_name_that_is_no_contact_at_all_is_still_unknown(running):
    with pytest.raises(SceneError, match="There is no element `bat`"):
        running.time_in("bat", "stick")


def test_the_severity_on_bristles_is_that_of_the_set_valued_contact(running, root):
    # stiff bristles: 0.8 / 200 rad of presliding beside the turns of a stick-slip cycle
    twin = simulate(TWIN, 300.0, controller=SoftTorque(reference=2.0))
    assert twin.time_in("bit", "stick", after=100.0) > 10.0
    assert measure.severity(running, "bit.speed", 100.0) == pytest.approx(measure.severity(twin, "bit.speed", 100.0), rel=0.01)
    found = [measure.severity(run, "bit.speed", 100.0) for run in (twin, running)]
    page = " ".join((root / "docs" / "friction.md").read_text().split())
    assert f"prints a severity of {found[0]:.2f} for `Exponential` and {found[1]:.2f} for `LuGre`" in page
    assert "below 3.6771 rad/s with `Exponential` and below 3.6770 rad/s with `LuGre`" in page
    assert 50 < sum(running.steps) / sum(twin.steps) < 200 and "needs a hundred times as many steps" in page
    swept = sweep(closed_loop(RIG, SoftTorque(reference=2.0)), {"bit.weight": [97_347.0]}, 300.0, metrics=["severity"])
    assert float(np.ravel(swept["severity"])[0]) == pytest.approx(measure.severity(running, "bit.speed", 150.0), rel=1e-6)


def test_the_hopf_point_on_stiff_bristles_is_that_of_the_stribeck_curve():
    # the lag of the bristle, g / (s0 v), moves it by the first power of 1 / s0
    def found(plant):
        (point,) = hopf_points(closed_loop(plant, SoftTorque(reference=8.0)), "top.reference", (1.0, 12.0))
        return point.value

    exact = found(TWIN)
    assert exact == pytest.approx(3.677134, rel=1e-6)
    errors = []
    for stiffness in (200.0, 400.0, 800.0):
        errors.append(found(compose(wells.JANSEN_2, BitRock(friction=dataclasses.replace(BIT, stiffness=stiffness, damping=0.0)))) - exact)
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.02) and errors[1] / errors[2] == pytest.approx(2.0, rel=0.01)


def test_margins_and_poles_of_a_loop_on_bristles_are_near_those_of_the_stribeck_curve():
    law = SoftTorque(reference=8.0)
    disks = [margins(closed_loop(plant, law)).disk_margin for plant in (RIG, TWIN)]
    assert disks[0] == pytest.approx(disks[1], rel=1e-3)
    at = {"chain.speed": (8.0, 8.0), "bit.deflection": float(BIT.steady.sliding(8.0)) / 200.0}
    slow = np.sort_complex(linearise(RIG, at=at).poles())[1:]
    exact = np.sort_complex(linearise(TWIN, at={"chain.speed": (8.0, 8.0)}).poles())
    np.testing.assert_allclose(slow, exact, rtol=2e-3)


def test_a_limit_cycle_on_bristles_returns_and_attracts():
    # soft bristles: the whole cycle is smooth but for the kinks of |v|
    block = BlockOnBelt(damping=0.05, friction=LuGre(stiffness=50.0, damping=2.0, steady=Exponential(1.0, 0.6, 3.0)))
    cycle = limit_cycle(compose(block), 100.0)
    run = simulate(compose(block), 200.0, accuracy=1e-9)
    swings = measure.extent(run, "block.position", 150.0)
    again = cycle.run
    found = measure.extent(again, "block.position")
    assert found.maximum - found.minimum == pytest.approx(swings.maximum - swings.minimum, rel=1e-5)
    assert max(abs(np.delete(cycle.multipliers, np.argmin(abs(cycle.multipliers - 1))))) < 1


def test_the_sensitivity_to_the_stiffness_of_bristles_is_the_difference_of_runs():
    def run(stiffness):
        block = BlockOnBelt(friction=LuGre(stiffness=stiffness, steady=Exponential(1.0, 0.6, 3.0)))
        return simulate(compose(block), 5.0, accuracy=1e-12)

    slope = sensitivity(run(100.0), "belt.friction.stiffness")["block.position"][-1]
    across = (run(100.1).at(5.0)["block.position"] - run(99.9).at(5.0)["block.position"]) / 0.2
    assert float(np.ravel(slope)[-1]) == pytest.approx(across, rel=1e-5)


@pytest.mark.parametrize("method", ["stiff", "taylor", "time-stepping", "smoothed"])
def test_methods_agree_on_a_contact_without_modes(method):
    plant = compose(BlockOnBelt(friction=LuGre(steady=Exponential(1.0, 0.6, 3.0))))
    exact = simulate(plant, 10.0, accuracy=1e-10).at(10.0)["block.position"]
    assert simulate(plant, 10.0, method=method).at(10.0)["block.position"] == pytest.approx(exact, abs=2e-4)
