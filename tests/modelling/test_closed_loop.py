"""A closed loop is one value: it prints what its laws took, compares by what it holds, travels, and gives changed loops by the name of a number."""

import dataclasses
import math
import pickle

import numpy as np
import pytest

import toolbox
from controllers import (
    LQG,
    LQR,
    PI,
    Lifting,
    LinearMPC,
    SoftTorque,
    StiffPI,
    SuperTwisting,
)
from models import BitRock, BlockOnBelt, wells
from tests.plants import RIG
from tests.refusals import refusals
from toolbox import Sampled, SceneError, closed_loop, compose, equilibrium, simulate
from toolbox.inputs import sine, step
from toolbox.modelling.clocks import Clock
from toolbox.modelling.closed_loop import as_loop
from toolbox.modelling.numbers import put_all

LOOP = closed_loop(RIG, SoftTorque(reference="45 rpm"), sample_time="10 ms", label="soft torque")


def proportional(t, y):
    """A law in Python that can be pickled by its name."""
    return 900.0 * (5.0 - y[0])


def test_a_loop_prints_the_gains_that_one_types_into_the_drive():
    k, below, top = 473.0, 374.0, 2122.0
    text = str(LOOP)
    assert f"proportional {math.sqrt(k * below):.4g} N m s/rad" in text
    assert f"integral {k / below * top:.4g} N m/rad" in text
    assert "reference 45 rpm" in text and "every 10 ms" in text and "'soft torque'" in text
    assert "proportional 900 N m s/rad" in str(LOOP.at("softtorque.proportional", 900.0))


def test_numbers_of_numpy_are_those_of_python_everywhere():
    own, same = (
        closed_loop(
            compose(wells.JANSEN_2, BitRock(weight=of(97_347))),
            PI(reference=of(8), proportional=of(500)),
            inputs={"bit.weight": of(90_000)},
            parameters={"chain.inertia.1": of(400)},
            start={"bit.speed": of(2)},
        )
        for of in (int, np.int64)
    )
    assert own == same and str(own) == str(same) and "bit.weight 90000 N" in str(same)
    runs = simulate(own, 2), simulate(same, np.int64(2))
    assert runs[0].end == runs[1].end and runs[0]["bit.speed"].tolist() == runs[1]["bit.speed"].tolist()


def test_loops_are_equal_where_plant_laws_and_numbers_are():
    assert (
        closed_loop(
            compose(wells.JANSEN_2, BitRock(weight=97_347.0)), SoftTorque(reference="45 rpm"), sample_time=0.01, label="soft torque"
        )
        == LOOP
    )
    assert hash(pickle.loads(pickle.dumps(LOOP))) == hash(LOOP)
    others = [
        closed_loop(LOOP, SoftTorque(reference="46 rpm"), sample_time=0.01), closed_loop(LOOP, SoftTorque(reference="45 rpm"), sample_time=0.02),
        closed_loop(LOOP, inputs={"bit.weight": 9e4}), closed_loop(LOOP, parameters={"bit.friction.static": 0.7}), closed_loop(LOOP, start={"bit.speed": 1.0}),
        closed_loop(LOOP, label="other"), closed_loop(RIG),
    ]  # fmt: skip
    assert all(other != LOOP for other in others) and LOOP != "soft torque"
    lambdas = [lambda t, y: 0.0 for _ in range(2)]
    assert (
        closed_loop(RIG, lambdas[0], sample_time=0.1)
        == closed_loop(RIG, lambdas[0], sample_time=0.1)
        != closed_loop(RIG, lambdas[1], sample_time=0.1)
    )
    for given in (sine("8 kN m", 500.0, 0.1), step(8e3, 9e3, 10.0), 9e3 + 10 * toolbox.time):
        assert closed_loop(RIG, inputs={"top.torque": given}) == closed_loop(RIG, inputs={"top.torque": given})
    assert closed_loop(RIG, inputs={"top.torque": "8 kN m"}) == closed_loop(RIG, inputs={"top.torque": 8e3})


def test_a_loop_travels_or_says_what_of_it_cannot():
    for loop in (
        LOOP,
        closed_loop(RIG, proportional, sample_time=0.1),
        closed_loop(RIG, inputs={"top.torque": sine("8 kN m", 500.0, 0.1)}),
    ):
        assert pickle.loads(pickle.dumps(loop)) == loop
    with pytest.raises(pickle.PicklingError, match=r"The law .*lambda.* of the loop cannot be pickled"):
        pickle.dumps(closed_loop(RIG, lambda t, y: 0.0, sample_time=0.1))


def test_a_loop_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        LOOP.label = "other"


def test_the_short_form_of_simulate_is_the_loop():
    short = simulate(RIG, "5 s", controller=SoftTorque(reference="45 rpm"), sample_time="10 ms", inputs={"bit.weight": 9e4})
    long = simulate(closed_loop(LOOP, inputs={"bit.weight": 9e4}), "5 s")
    np.testing.assert_array_equal(short.states, long.states)
    assert simulate(LOOP, "1 s").run.loop is LOOP
    with pytest.raises(SceneError, match="`duration` must be given"):
        simulate(LOOP)


def test_a_loop_of_a_loop_keeps_what_is_not_given_anew():
    first = closed_loop(RIG, PI(), inputs={"bit.weight": 9e4}, parameters={"bit.friction.static": 0.7}, start={"bit.speed": 2.0})
    second = closed_loop(first, StiffPI(), parameters={"bit.friction.kinetic": 0.4})
    assert isinstance(second.controllers[0], StiffPI) and second.inputs == first.inputs and second.start == first.start
    assert second.parameters == {"bit.friction.static": 0.7, "bit.friction.kinetic": 0.4}
    assert closed_loop(first, parameters={"bit.weight": 8e4}).number("bit.weight").value == 8e4


# name, kind, unit, and another value of every kind of number
KINDS = [
    ("bit.weight", "input", "N", 9e4), ("top.reference", "input", "rad/s", 6.0), ("bit.friction.static", "parameter", "1", 0.7),
    ("chain.inertia.0", "parameter", "kg m2", 2000.0), ("softtorque.proportional", "parameter", "N m s/rad", 900.0),
    ("softtorque.detuning", "design", "1", 2.0),
    ("softtorque.sample_time", "sample time", "s", 0.02), ("softtorque.delay", "delay", "s", 0.02),
    ("bit.speed", "start", "rad/s", 3.0), ("softtorque.angle", "start", "rad", 2.0),
]  # fmt: skip


@pytest.mark.parametrize(("name", "kind", "unit", "value"), KINDS, ids=[row[0] for row in KINDS])
def test_every_kind_of_number_has_name_unit_and_value_and_can_be_put(name, kind, unit, value):
    number = LOOP.variable_numbers()[name]
    assert (number.name, str(number.kind), number.unit) == (name, kind, unit) and number == LOOP.number(name) and number.value != value
    changed = LOOP.at(name, value)
    assert changed.number(name).value == value and changed != LOOP and LOOP.number(name) == number
    assert changed.at(name, number.value).number(name).value == number.value


def test_numbers_of_shapes_and_tables_are_numbers_of_the_loop():
    loop = closed_loop(RIG, inputs={"top.torque": sine("8 kN m", 500.0, 0.1), "bit.weight": ([0.0, 10.0], [9e4, 8e4])})
    assert loop.number("top.torque.amplitude").unit == "N m" and loop.number("top.torque.frequency").unit == "Hz"
    assert loop.at("top.torque.amplitude", "1 kN m") == closed_loop(loop, inputs={"top.torque": sine("8 kN m", 1000.0, 0.1)})
    assert loop.at("bit.weight.values.1", "85 kN") == closed_loop(loop, inputs={"bit.weight": ([0.0, 10.0], [9e4, 85e3])})
    assert math.isnan(loop.number("top.torque").value) and loop.at("top.torque", 9e3).number("top.torque").value == 9e3


def test_two_names_of_one_state_may_not_say_different_start_values():
    with pytest.raises(SceneError, match="`bit.speed` and `chain.speed.1` must agree"):
        simulate(RIG, 0.0, start={"bit.speed": 3.0, "chain.speed.1": 2.0})
    assert simulate(RIG, 0.0, start={"bit.speed": 3.0, "chain.speed.1": 3.0})["bit.speed"][0] == 3.0
    for start in ({"bit.speed": 3.0, "chain.speed": 2.0}, {"chain.speed": 2.0, "bit.speed": 3.0}):  # an entry beside its vector wins
        assert simulate(RIG, 0.0, start=start).at(0.0)["chain.speed"].tolist() == [2.0, 3.0]
        assert closed_loop(RIG, start=start).number("bit.speed").value == 3.0
    put = closed_loop(RIG, start={"chain.speed.1": 2.0}).at("bit.speed", 5.0)
    assert put.start == {"bit.speed": 5.0} and put.number("chain.speed.1").value == 5.0


def test_a_number_that_only_the_design_knows_designs_the_law_anew():
    detuned = LOOP.at("softtorque.detuning", 2.0)
    assert detuned == closed_loop(LOOP, SoftTorque(reference="45 rpm", detuning=2.0), sample_time="10 ms")
    assert detuned.number("softtorque.proportional").value == pytest.approx(LOOP.number("softtorque.proportional").value / 2, rel=1e-14)
    assert closed_loop(LOOP, parameters={"softtorque.detuning": 2.0}) == detuned
    with pytest.raises(SceneError, match=r"`softtorque.detuning` must be an input or a parameter for `hopf_points`, but only the design"):
        LOOP.differentiable_number("softtorque.detuning", "hopf_points")


def test_a_sample_time_is_a_number_by_which_the_law_is_sampled():
    """Both the clock and the formulas of the law know it."""
    slower = LOOP.at("softtorque.sample_time", "20 ms")
    assert slower.assembly.clocks == [Clock(0.02)] and slower.system.parameter("softtorque.sample_time") == 0.02
    assert (
        slower
        == closed_loop(LOOP, SoftTorque(reference="45 rpm"), sample_time="20 ms")
        == closed_loop(LOOP, parameters={"softtorque.sample_time": "20 ms"})
    )
    np.testing.assert_array_equal(
        simulate(slower, 1.0).states, simulate(closed_loop(LOOP, SoftTorque(reference="45 rpm"), sample_time=0.02), 1.0).states
    )


def test_a_gain_is_changed_where_it_acts_and_the_design_stays():
    loop = closed_loop(RIG, LQR(reference=8.0))
    gains = [name for name, number in loop.variable_numbers().items() if number.is_parameter and name.startswith("lqr.")]
    changed = loop.at("bit.weight", 5e4)
    assert gains and all(changed.number(name).value == loop.number(name).value for name in gains)


def test_a_parameter_that_an_input_overrides_says_so():
    loop = closed_loop(RIG, PI(reference=8.0))
    assert loop.number("pi.reference").overridden is None
    given = loop.at("top.reference", 6.0)
    assert given.number("pi.reference").overridden == "top.reference" and given.overriding_inputs == {"pi.reference": "top.reference"}
    assert "the parameter pi.reference has no effect: the input top.reference overrides it" in str(given) and "no effect" not in str(loop)
    for verb in (lambda: given.varied_number("pi.reference"), lambda: toolbox.sweep(given, {"pi.reference": [5.0, 6.0]}, 1.0)):
        with pytest.raises(
            SceneError, match=r"`pi.reference` must have an effect to be varied, but the input `top.reference` overrides it"
        ):
            verb()


def test_a_loop_may_stand_for_its_limit_of_fast_sampling():
    assert not LOOP.continuous_loop.is_sampled and LOOP.is_sampled and LOOP.continuous_loop.controllers == (LOOP.controllers[0].law,)
    rest = equilibrium(LOOP)
    assert rest["top.speed"] == pytest.approx(45 * math.pi / 30, rel=1e-9)
    with pytest.raises(SceneError, match="must have continuous controllers"):
        LOOP.unsampled()
    with pytest.raises(SceneError, match="continuous form"):
        _ = closed_loop(RIG, proportional, sample_time=0.1).continuous_loop


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: LOOP.at("bit.weight", -5.0), r"`bit.weight` must be >= 0 N, but it is -5"),
    (lambda: LOOP.at("bit.wheight", 5.0), r"There is no number `bit.wheight` in this loop: did you mean `bit.weight`"),
    (lambda: LOOP.number("chain.inertia"), r"`chain.inertia` must be one number, but it has 2 entries: name one, e.g. `chain.inertia.0`"),
    (lambda: closed_loop(RIG).number("top.reference"), "a set-point belongs to a control law"),
    (lambda: LOOP.at("bit.weight", "5 m"), r"`bit.weight` must be in N"),
    (lambda: as_loop(BlockOnBelt()), r"Argument `loop` must be a plant made by `compose`.*`compose\(BlockOnBelt\(...\)\)`"),
    (lambda: equilibrium(RIG, controller=PI(), inputs={"bit.weight": 9e4}), r"write `equilibrium\(closed_loop\(plant, law, inputs=...\), ...\)`"),
    (lambda: closed_loop(RIG, lambda t, y: 0.0), "sample_time"),
    (lambda: closed_loop(RIG, Sampled(PI(), 0.01), sample_time=0.02), "every controller is Sampled"),
    (lambda: closed_loop(RIG, inputs={"bit.weight": 9e4}, parameters={"bit.weight": 8e4}), "in `inputs` or in `parameters`"),
)  # fmt: skip


def test_a_law_is_designed_once_per_loop(monkeypatch):
    count = 0
    design = LinearMPC.design

    def counted(self, plant):
        nonlocal count
        count += 1
        return design(self, plant)

    monkeypatch.setattr(LinearMPC, "design", counted)
    loop = closed_loop(RIG, LinearMPC(reference=8.0), sample_time=0.1)
    loop.at("bit.weight", 9e4).at("bit.speed", 1.0).system  # noqa: B018
    assert count == 1


def test_several_numbers_are_put_together():
    assert put_all(LOOP, {"bit.weight": "90 kN", "bit.speed": 1.0}) == LOOP.at("bit.weight", 9e4).at("bit.speed", 1.0)
    assert put_all(LOOP, {}) == LOOP
    for factor in (0.5, 2.0):  # one after the other the static friction would fall below the kinetic one, or this rise above it
        names = ("bit.friction.kinetic", "bit.friction.static") if factor > 1 else ("bit.friction.static", "bit.friction.kinetic")
        scaled = put_all(LOOP, {name: factor * LOOP.number(name).value for name in names})
        assert [scaled.number(name).value for name in names] == [factor * LOOP.number(name).value for name in names]
    with pytest.raises(SceneError, match="bit.weight"):
        put_all(LOOP, {"bit.wheight": 5.0})


def test_the_name_of_a_controller_is_the_first_word_of_all_its_numbers():
    loop = closed_loop(RIG, Sampled(SoftTorque(name="top"), 0.01, noise={"top.speed": 0.01}))
    own = {*loop.variable_numbers()} - {*closed_loop(RIG).variable_numbers(), "top.reference"}
    words = ("proportional", "detuning", "angle", "sample_time", "delay", "jitter", "missed_samples", "sensors.noise.0")
    assert {f"top.{word}" for word in words} <= own and {name.partition(".")[0] for name in own} == {"top"}


def test_a_field_of_the_declared_controller_keeps_a_name_beside_that_of_the_controller_which_its_design_makes():
    """`softtorque.reference` is the set-point of the PI where it acts; under `softtorque.design.reference` the controller is designed again."""
    loop = closed_loop(RIG, SoftTorque(reference="45 rpm", highest_torque=2e4))
    assert loop.number("softtorque.highest_torque").is_parameter and loop.number("softtorque.design.highest_torque").is_design
    again = loop.at("softtorque.design.highest_torque", 3e4)
    assert again == closed_loop(RIG, SoftTorque(reference="45 rpm", highest_torque=3e4))
    there = loop.at("softtorque.highest_torque", 3e4)
    assert there != again and there.number("softtorque.highest_torque").value == again.number("softtorque.highest_torque").value == 3e4
    given = loop.at("top.reference", 5.0)
    assert given.number("softtorque.reference").overridden == "top.reference"


@pytest.mark.parametrize(
    ("law", "former", "now"),
    [
        (SoftTorque(), "pi.proportional", "softtorque.proportional"), (SoftTorque(), "pi.period", "softtorque.sample_time"),
        (SoftTorque(), "pi.angle", "softtorque.angle"), (SoftTorque(), "pi.sensors.noise.0", "softtorque.sensors.noise.0"),
        (SoftTorque(), "softtorque.period", "softtorque.sample_time"), (StiffPI(), "pi.integral", "stiffpi.integral"),
        (SuperTwisting(), "slidingmode.surface_gain", "supertwisting.surface_gain"), (LQG(), "lqr.law.gain.0", "lqg.law.gain.0"),
        (LQG(), "observer.state.0", "lqg.observer.state.0"), (Lifting(SoftTorque()), "pi.angle", "lifting.pi.angle"),
        (Lifting(SoftTorque()), "pi.first_factor", "lifting.first_factor"), (proportional, "external.sensors.noise.0", "proportional.sensors.noise.0"),
    ],
)  # fmt: skip
def test_a_former_name_of_a_number_is_refused_with_the_name_now(law, former, now):
    loop = closed_loop(RIG, Sampled(law, 0.01, noise={"top.speed": 0.01}))
    loop.number(now)
    for question in (lambda: loop.number(former), lambda: loop.with_parameters({former: 1.0}), lambda: loop.at(former, 1.0)):
        with pytest.raises(SceneError, match=f"The number `{former}` is named `{now}` now"):
            question()
