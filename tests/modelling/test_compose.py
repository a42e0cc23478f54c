"""Putting parts together: names, signals, units, defaults, parameters, and what cannot be composed."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import pytest

from controllers import PI, SoftTorque
from models import BitRock, BlockOnBelt, Coulomb, Exponential, Hyperbolic, TorsionalChain, TwoDisks, wells
from tests.plants import BELT, RIG
from tests.refusals import each_of, refusals
from toolbox import Component, Controller, DryFriction, Equations, FrictionLaw, SceneError, Update, compose, quantity, simulate, state, time
from toolbox.compilation import emitter as emit

BAD_NUMBERS = pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, "1.0", True, None, [1.0], {}, 1j], ids=repr)


def part(make, **fields):
    """A throw-away component whose equations are `make(self, signal)`; fields are quantities."""
    space = {name: field(default=value, metadata={"unit": "1"}) for name, value in fields.items()}
    space["__annotations__"] = dict.fromkeys(fields, "float")
    space["equations"] = make
    return dataclass(frozen=True)(type("Part", (Component,), space))


def lag(name, source=None, unit="1", default=None):
    """x' = source - x, a part `name` with the state `name.x`."""

    def equations(self, signal):
        x = state(f"{name}.x", "1")
        return Equations(flow={x: (signal(source, unit, default=default) if source else 0) - x})

    return part(equations)()


# --- names


def test_a_plant_of_two_blocks_needs_names_and_has_them_everywhere():
    with pytest.raises(SceneError, match="name="):
        compose(BlockOnBelt(), BlockOnBelt())
    plant = compose(BlockOnBelt(name="left"), BlockOnBelt(name="right", mass=2.0))
    assert {"left.position", "left.speed", "right.position", "right.speed"} <= set(plant.states)
    assert plant.parameter("left.mass") == 1.0 and plant.parameter("right.mass") == 2.0
    assert [element.name for element in plant.elements] == ["left.belt", "right.belt"]
    assert plant.parameter("right.belt.friction.decay") == 3.0
    assert set(plant.inputs) == {f"{side}.{tail}" for side in ("left", "right") for tail in ("force", "load", "attachment")}
    # one named and one not is enough
    assert "block.mass" in compose(BlockOnBelt(), BlockOnBelt(name="other")).parameters


def test_a_part_gives_no_signal_of_the_name_of_its_field():
    """Both would be read by one name, in a run, a sweep and an exported model."""

    def holding(self, signal):
        x = state("x.gain", "1")
        return Equations(flow={x: -self.gain * x})

    def giving(self, signal):
        x = state("x.place", "1")
        return Equations(flow={x: -self.gain * x}, outputs={"x.gain": (x, "1")})

    for make in (holding, giving):
        with pytest.raises(SceneError, match="The name `x.gain` must stand for one thing, but a field of Part and a signal"):
            compose(part(make, gain=2.0)())


def test_two_equal_parts_move_alike_and_independently():
    plant = compose(BlockOnBelt(name="left"), BlockOnBelt(name="right"))
    alone = simulate(compose(BlockOnBelt()), 30.0, accuracy=1e-9)
    run = simulate(plant, 30.0, inputs={"right.force": 0.1}, accuracy=1e-9)
    left = [event.time for event in run.events if event.element == "left.belt"]
    np.testing.assert_allclose(left, [event.time for event in alone.events], atol=1e-7)
    right = [event.time for event in run.events if event.element == "right.belt"]
    assert abs(right[0] - left[0]) > 1e-3 or abs(right[1] - left[1]) > 1e-3


def test_a_plant_says_what_it_is():
    text = repr(compose(wells.JANSEN_2, BitRock()))
    for word in ("TorsionalChain", "BitRock", "chain.twist", "chain.speed", "bit", "top.torque", "bit.weight"):
        assert word in text


# --- signals


def test_a_signal_that_a_part_gives_reaches_the_parts_that_need_it_in_any_order():
    source = part(lambda self, signal: Equations(outputs={"source.value": (3.0 + 0 * time, "1")}))()
    for parts in ((source, lag("lag", "source.value")), (lag("lag", "source.value"), source)):
        run = simulate(compose(*parts), 20.0, accuracy=1e-9)
        assert run.at(20.0)["lag.x"] == pytest.approx(3.0, rel=1e-8)
        assert run.at(20.0)["source.value"] == 3.0


def test_a_chain_of_signals_is_resolved_through_parts_without_states():
    double = part(lambda self, signal: Equations(outputs={"double.out": (2 * signal("first.x", "1"), "1")}))()
    shift = part(lambda self, signal: Equations(outputs={"shift.out": (1 + signal("double.out", "1"), "1")}))()
    plant = compose(lag("second", "shift.out"), shift, double, lag("first", "first.in", default=1.0))
    run = simulate(plant, 40.0, accuracy=1e-9)
    assert run.at(40.0)["second.x"] == pytest.approx(3.0, rel=1e-7)


def test_a_signal_that_nobody_gives_takes_its_default():
    plant = compose(lag("lag", "lag.in", default=2.5))
    assert simulate(plant, 40.0).at(40.0)["lag.x"] == pytest.approx(2.5, rel=1e-5)
    assert simulate(plant, 40.0, parameters={"lag.in": -1.0}).at(40.0)["lag.x"] == pytest.approx(-1.0, rel=1e-5)
    assert simulate(plant, 40.0, inputs={"lag.in": 4.0}).at(40.0)["lag.x"] == pytest.approx(4.0, rel=1e-5)


def test_a_plant_knows_the_units_of_its_signals_inputs_and_parameters():
    units = {"bit.torque": "N m", "bit.weight": "N", "chain.speed.1": "rad/s", "chain.stiffness": "N m/rad", "chain.inertia.0": "kg m2"}
    assert {name: RIG.unit(name) for name in units} == units
    with pytest.raises(SceneError, match=r"no signal and no parameter `chain.stifness`: did you mean `chain.stiffness`"):
        RIG.unit("chain.stifness")
    with pytest.raises(SceneError, match="There is no signal `chain.stiffness`"):  # a run has signals only
        simulate(RIG, 0.0).unit("chain.stiffness")


def test_units_must_agree_between_giver_and_taker_and_between_takers():
    with pytest.raises(SceneError, match="rad/s.*rpm"):
        compose(wells.JANSEN_2, lag("lag", "bit.speed", unit="rpm"))
    with pytest.raises(SceneError, match="units must agree"):
        compose(lag("one", "common.in", unit="N", default=0.0), lag("two", "common.in", unit="kN", default=0.0))

    def undecided(self, signal):
        x = state("undecided.x", "1")
        return Equations(flow={x: signal("common.in", "N", default=0.0) + signal("common.in", "kN", default=0.0)})

    with pytest.raises(SceneError, match="units must agree"):
        compose(part(undecided)())


def test_a_signal_needed_by_many_is_one_input():
    plant = compose(lag("one", "common.in", default=1.0), lag("two", "common.in", default=1.0), lag("three", "common.in"))
    assert set(plant.inputs) == {"common.in"}
    run = simulate(plant, 5.0, inputs={"common.in": 2.0}, accuracy=1e-9)
    for name in ("one", "two", "three"):
        assert run.at(5.0)[f"{name}.x"] == pytest.approx(2 * (1 - math.exp(-5)), rel=1e-7)


def test_two_laws_with_a_set_point_of_their_own_follow_that_of_a_part_that_gives_it():
    @dataclass(frozen=True)
    class Hoist(Controller):
        measured_signals, actuated_signals = ("top.speed",), ("bit.weight",)
        reference: float = quantity(8.0, "rad/s", "set-point")

        def continuous(self, signal):
            error = signal("top.reference", "rad/s", default=self.reference) - signal("top.speed", "rad/s")
            return Equations(outputs={"bit.weight": (90e3 - 3e3 * error, "N")})

    @dataclass(frozen=True)
    class SetPoint(Component):
        speed: float = quantity(9.0, "rad/s", "set-point")

        def equations(self, signal):
            return Equations(outputs={"top.reference": (self.speed, "rad/s")})

    laws = [PI(reference=8.0), Hoist()]
    with pytest.raises(SceneError, match="defaults of their own .* `top.reference`: compose a part that gives it"):
        simulate(compose(wells.JANSEN_2, BitRock()), 1.0, controller=laws, inputs={"top.reference": 9.0})
    run = simulate(compose(wells.JANSEN_2, BitRock(), SetPoint()), 60.0, controller=laws)
    assert run["top.reference"][-1] == 9.0 and run["top.speed"][-1] == pytest.approx(9.0, abs=0.1)


def test_an_algebraic_loop_is_refused_and_named():
    a = part(lambda self, signal: Equations(outputs={"a.out": (1 + signal("b.out", "1"), "1")}))()
    b = part(lambda self, signal: Equations(outputs={"b.out": (2 * signal("a.out", "1"), "1")}))()
    with pytest.raises(SceneError, match=r"a\.out.*b\.out.*algebraic loop"):
        compose(a, b, lag("lag", "a.out"))
    own = part(lambda self, signal: Equations(outputs={"own.out": (0.5 * signal("own.out", "1"), "1")}))()
    with pytest.raises(SceneError, match=r"own\.out.*algebraic loop"):
        compose(own, lag("lag", "own.out"))


def test_a_loop_through_a_state_is_no_algebraic_loop():
    compose(lag("one", "two.x"), lag("two", "one.x"))


def test_a_default_that_depends_on_another_signal_is_resolved_or_refused():
    def equations(self, signal):
        x = state("follow.x", "1")
        return Equations(flow={x: signal("follow.in", "1", default=2 * signal("lag.x", "1")) - x})

    try:
        run = simulate(compose(lag("lag", "lag.in", default=1.0), part(equations)()), 60.0)
    except SceneError as error:
        assert "follow.in" in str(error) or "default" in str(error)
    else:
        assert run.at(60.0)["follow.x"] == pytest.approx(2.0, rel=1e-5)


# --- what is not a plant


def test_a_derivative_must_have_the_shape_of_its_state():
    def equations(self, signal):
        x = state("vector.x", "1", 3)
        return Equations(flow={x: ca.vertcat(x[0], x[1])})

    with pytest.raises(SceneError, match=r"vector\.x.*shape"):
        compose(part(equations)())


def with_constant(place, constant):
    """A part that holds `constant`, a number or a symbol, in one place of its equations."""

    def equations(self, signal):
        x = state("lag.x", "1")
        pad = DryFriction("pad", x - (constant if place == "slip" else 0), Coulomb(), constant if place == "load" else 1.0)
        return Equations(
            flow={x: (constant if place == "flow" else 0) * x + pad.force},
            outputs={"lag.out": (x * (constant if place == "gives" else 1), "1")},
            elements=[pad],
            stored=x**2 * (constant if place == "stored" else 1),
            losses={"pad": -pad.force * x * (constant if place == "losses" else 1)},
            update=Update({}, {"lag.held": (x * constant, "1")}) if place == "update" else None,
        )

    return part(equations)()


PLACES = pytest.mark.parametrize("place", ["flow", "gives", "slip", "load", "stored", "losses", "update"])


@PLACES
def test_a_symbol_that_nobody_declared_is_refused_and_named(place):
    with pytest.raises(SceneError, match="stranger"):
        compose(with_constant(place, ca.SX.sym("stranger")))


def test_a_force_of_an_element_that_was_not_handed_over_is_refused():
    def equations(self, signal):
        x = state("lag.x", "1")
        pad = DryFriction("pad", x, Coulomb())
        return Equations(flow={x: pad.force})  # elements forgotten

    with pytest.raises(SceneError, match="element `pad` must be in `elements`"):
        compose(part(equations)())


@PLACES
def test_a_nan_constant_is_refused_with_the_name_of_the_part(place):
    with pytest.raises(SceneError, match="Part.*NaN|NaN.*Part"):
        compose(with_constant(place, math.nan))


def test_python_mathematics_on_a_parameter_is_refused():
    # math.sqrt of a casadi symbol is a NaN without a word, or an error of casadi; either way it must not become a plant
    @dataclass(frozen=True)
    class Rooted(Component):
        stiffness: float = quantity(4.0, "1/s2", "stiffness")

        def equations(self, signal):
            x = state("rooted.x", "1")
            return Equations(flow={x: -math.sqrt(self.stiffness) * x})

    with pytest.raises((SceneError, TypeError, NotImplementedError, RuntimeError)):
        compose(Rooted())


def test_infinite_constants_are_refused_where_they_enter_the_flow():
    def equations(self, signal):
        x = state("lag.x", "1")
        return Equations(flow={x: math.inf - x})

    with pytest.raises(Exception, match="lag"):
        simulate(compose(part(equations)()), 1.0)


# --- numbers


@BAD_NUMBERS
@pytest.mark.parametrize("name", ["mass", "stiffness", "belt_speed", "load"])
def test_a_field_that_is_no_finite_number_is_refused_by_name(name, bad):
    with pytest.raises(SceneError, match=name):
        compose(BlockOnBelt(**{name: bad}))


@pytest.mark.parametrize("row", [[2122.0, 374.0], np.array([2122.0, 374.0]), np.array([2122, 374])], ids=repr)
def test_a_row_of_numbers_may_be_a_list_or_an_array(row):
    chain = TorsionalChain(inertia=row)
    assert chain == TorsionalChain(inertia=(2122.0, 374.0)) and isinstance(chain.inertia, tuple)
    np.testing.assert_array_equal(compose(chain).parameter("chain.inertia"), [2122.0, 374.0])


def test_dry_friction_takes_a_law_and_no_number():
    def equations(self, signal):
        v = state("lag.x", "1")
        pad = DryFriction("pad", v, 0.3)
        return Equations(flow={v: pad.force}, elements=[pad])

    with pytest.raises(SceneError, match="`law` of `pad` must be a friction law"):
        compose(part(equations)())


def test_numpy_numbers_are_numbers():
    plant = compose(BlockOnBelt(mass=np.float64(2.0), stiffness=np.int64(3), belt_speed=np.float32(0.5)))
    assert plant.parameter("block.mass") == 2.0 and plant.parameter("block.stiffness") == 3.0


# --- parameters


@BAD_NUMBERS
def test_an_override_that_is_no_finite_number_is_refused_by_name(bad):
    with pytest.raises(SceneError, match=r"block\.mass"):
        BELT.with_parameters({"block.mass": bad})
    with pytest.raises(SceneError, match=r"block\.mass"):
        simulate(BELT, 1.0, parameters={"block.mass": bad})


def test_an_array_without_dimensions_is_one_number():
    assert BELT.with_parameters({"block.mass": np.array(3.0)}).parameter("block.mass") == 3.0
    assert BELT.with_parameters({"block.mass": np.float64(3.0)}).parameter("block.mass") == 3.0


test_wrong_uses_are_refused_in_these_words = refusals(
    *each_of(lambda name: compose(BlockOnBelt(name=name)), "name", ["", "a.b", ".", 5]),
    (lambda: compose(wells.JANSEN_2, lag("lag", "bit.sped", unit="rad/s")), r"bit\.sped.*bit\.speed"),
    (lambda: compose(BitRock()), r"bit\.speed"),
    (lambda: compose(lag("one", "common.in", default=1.0), lag("two", "common.in", default=2.0)), r"common\.in"),
    (lambda: compose(part(lambda self, signal: Equations(outputs={"source.value": (ca.SX(1), "1")}))(),
     part(lambda self, signal: Equations(outputs={"source.value": (ca.SX(1), "1")}))(), lag("lag", "source.value")), r"source\.value"),
    *each_of(lambda default: compose(lag("lag", "lag.in", default=default)), r"lag\.in", [math.nan, math.inf, "1", True, [1.0]]),
    # only components make a plant
    *each_of(lambda parts: compose(*parts), "", [(), (5,), (BlockOnBelt,), ("block",), (None,), (BlockOnBelt(), None), ([BlockOnBelt()],)]),
    (lambda: compose(part(lambda self, signal: Equations(outputs={"source.value": (ca.SX(1), "1")}))()), "state"),
    (lambda: compose(part(lambda self, signal: Equations())()), "state"),
    (lambda: compose(PI()), "plant"),
    *each_of(lambda answer: compose(part(lambda self, signal: answer)()), "Equations", [None, {}, 5, (), "x"]),
    # equations that were never written are an error that says so
    (lambda: compose(dataclass(frozen=True)(type("Empty", (Component,), {}))()), "", (SceneError, NotImplementedError)),
    (lambda: compose(part(lambda self, signal: Equations(flow={"x": ca.SX(1)}))()), "state"),
    (lambda: compose(part(lambda self, signal: Equations(flow={ca.SX.sym("x"): ca.SX(1)}))()), "state"),
    (lambda: compose(lag("lag"), lag("lag")), r"lag\.x|name="),
    *[(lambda name=name, bad=bad: compose(BlockOnBelt(**{name: bad})), f"block\\.{name}.*must be >.*{bad!r}") for name,
     bad in [("mass", 0.0), ("mass", -1.0), ("stiffness", -1e-300), ("load", -0.1), ("damping", -1.0)]],
    (lambda: compose(wells.JANSEN_2, BitRock(weight=-97_000.0)), r"Argument `bit\.weight` must be >= 0 N, but it is -97000\.0\."),
    *each_of(lambda bad: compose(BlockOnBelt(friction=bad)), "friction", [None, "Coulomb", Coulomb, 0.3, BlockOnBelt()]),
    *each_of(lambda bad: compose(TorsionalChain(inertia=bad)), "inertia", [2122.0, "2122", (2122.0, "374"), [2122.0, "374"], (2122.0, True), (),
     np.ones((2, 1))]),
    *[(lambda bad=bad: compose(bad), remedy) for bad, remedy in ((BlockOnBelt, r"`BlockOnBelt\(\)`"), ([wells.JANSEN_2, BitRock()],
     r"compose\(\*parts\)"), (5, "a int"))],
    (lambda: compose(wells.JANSEN_2, BitRock(friction=Coulomb(static=0.3, kinetic=0.5))), "`friction` of BitRock.*`kinetic` must be <= the static"),
    (lambda: compose(BlockOnBelt(mass=10**400)), "mass"),
    *each_of(lambda bad: RIG.with_parameters({"chain.inertia": bad}), r"chain\.inertia", [(1.0,), (1.0, 2.0, 3.0), (1.0, math.nan), (1.0, -2.0), 5.0,
     "ab", ((1.0, 2.0),), np.ones((1, 2)), None]),
    *[(lambda wrong=wrong: compose(BlockOnBelt()).with_parameters({wrong: 1.0}), f"{wrong}.*{right}") for wrong, right in [("block.mas",
     "block.mass"), ("belt.friction.statc", "belt.friction.static"), ("Block.mass", "block.mass"), ("mass", "block.mass")]],
    *[(lambda wrong=wrong: compose(BlockOnBelt()).parameter(wrong), f"{wrong}.*{right}") for wrong, right in [("block.mas", "block.mass"),
     ("belt.friction.statc", "belt.friction.static"), ("Block.mass", "block.mass"), ("mass", "block.mass")]],
    *each_of(lambda index: compose(wells.JANSEN_2, BitRock()).with_parameters({f"chain.inertia.{index}": 1.0}), r"chain\.inertia",
     ["2", "-1", "1.0", "x", ""]),
)  # fmt: skip


def test_an_entry_of_a_vector_can_be_changed_alone():
    plant = compose(wells.JANSEN_2, BitRock()).with_parameters({"chain.inertia.1": 500.0})
    np.testing.assert_array_equal(plant.parameter("chain.inertia"), [2122.0, 500.0])
    assert plant.parts[0].inertia == (2122.0, 500.0)


def test_changing_parameters_leaves_the_plant_it_came_from_as_it_was():
    other = BELT.with_parameters({"block.mass": 5.0, "belt.friction.decay": 7.0})
    assert BELT.parameter("block.mass") == 1.0 and other.parameter("block.mass") == 5.0
    assert BELT.parts[0].mass == 1.0 and other.parts[0].mass == 5.0
    assert other.parts[0].friction == Hyperbolic(static=1.0, decay=7.0)


def test_every_parameter_has_a_unit_and_a_meaning():
    for plant in (compose(BlockOnBelt()), compose(wells.NAVARRO_LOPEZ_4, BitRock()), compose(TwoDisks())):
        for entry in plant.parameters.values():
            assert entry.unit and entry.meaning


# --- nothing is compiled twice


@pytest.fixture
def no_compiler(monkeypatch):
    """From now on, compiling anything is a failure."""

    def start():
        monkeypatch.setattr("toolbox.compilation.kernel.compiled_for", lambda *_: pytest.fail("compiled again"))
        monkeypatch.setattr(emit, "object_code", lambda *_: pytest.fail("compiled again"))

    return start


def test_new_numbers_never_compile_and_do_change_the_answer(no_compiler):
    def period(plant, **settings):
        left = [event.time for event in simulate(plant, 60.0, **settings).events if event.before == "stick"]
        return left[2] - left[1]

    belt = compose(BlockOnBelt())  # its structure is the one that was composed last: only some are kept
    for accuracy in (1e-3, 1e-8):
        base = period(belt, accuracy=accuracy)
        simulate(belt, 1.0, inputs={"block.force": 0.0}, accuracy=accuracy)
        simulate(belt, 1.0, inputs={"block.force": ((0.0, 1.0), (0.0, 0.0))}, accuracy=accuracy)
    no_compiler()
    for accuracy in (1e-3, 1e-8):
        base = period(belt, accuracy=accuracy)
        assert period(compose(BlockOnBelt(mass=2.0)), accuracy=accuracy) != pytest.approx(base, rel=1e-2)
        assert period(belt.with_parameters({"block.mass": 2.0}), accuracy=accuracy) == period(
            compose(BlockOnBelt(mass=2.0)), accuracy=accuracy
        )
        assert period(belt, parameters={"block.mass": 2.0}, accuracy=accuracy) == period(compose(BlockOnBelt(mass=2.0)), accuracy=accuracy)
        assert period(compose(BlockOnBelt(friction=Hyperbolic(static=2.0))), accuracy=accuracy) != pytest.approx(base, rel=1e-2)
        shifted = simulate(belt, 30.0, inputs={"block.force": 0.3}, accuracy=accuracy).events[0].time
        assert simulate(belt, 30.0, inputs={"block.force": -0.3}, accuracy=accuracy).events[0].time != pytest.approx(shifted, rel=1e-3)
        simulate(belt, 5.0, inputs={"block.force": ((0.0, 1.0, 1.5, 3.0), (0.0, 0.2, -0.3, 0.1))}, accuracy=accuracy)
        assert period(belt, accuracy=accuracy) == base


def test_plants_of_one_structure_live_side_by_side():
    # the numbers of one must not leak into another, whatever the order of use
    plants = [compose(BlockOnBelt(belt_speed=speed, friction=Coulomb(static=1.0, kinetic=0.6))) for speed in (0.1, 0.2, 0.4)]
    runs = [simulate(plant, 80.0, accuracy=1e-9) for plant in plants]
    for again in (plants, plants[::-1]):
        for plant in again:
            run = runs[plants.index(plant)]
            repeated = simulate(plant, 80.0, accuracy=1e-9)
            assert repeated.events == run.events
    for run, speed in zip(runs, (0.1, 0.2, 0.4), strict=True):
        z = 0.4 / speed
        period = 2 * math.pi * (1 + (z - math.atan(z)) / math.pi)
        left = [event.time for event in run.events if event.before == "stick"]
        np.testing.assert_allclose(np.diff(left), period, rtol=1e-7)
        # a result computes its signals with its own numbers, also after other runs
        assert run.at(1.0)["belt.slip"] == run.at(1.0)["block.speed"] - speed
        assert run.error_estimate < 1e-7


def test_runs_in_threads_do_not_disturb_each_other():
    # the event loop gives up the interpreter lock; plants of one structure share machine code and nothing else
    plants = [compose(BlockOnBelt(belt_speed=0.1 + 0.02 * i)) for i in range(12)]
    alone = [simulate(plant, 200.0).events for plant in plants]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda plant: simulate(plant, 200.0).events, plants * 3))
    assert together == alone * 3


def test_controllers_of_one_class_with_other_gains_do_not_share_them(no_compiler):
    laws = [PI(reference=5.0), PI(reference=12.0), PI(proportional=900.0, integral=100.0)]
    for sample_time in (None, 0.02):
        first = simulate(RIG, 20.0, controller=laws[0], sample_time=sample_time)
    no_compiler()
    for sample_time in (None, 0.02):
        runs = [simulate(RIG, 20.0, controller=law, sample_time=sample_time) for law in laws]
        for law, run in list(zip(laws, runs, strict=True))[::-1]:
            np.testing.assert_array_equal(simulate(RIG, 20.0, controller=law, sample_time=sample_time)["bit.speed"], run["bit.speed"])
        assert np.abs(runs[0].at(15.0)["top.speed"] - runs[1].at(15.0)["top.speed"]) > 0.5
        slow = simulate(RIG, 20.0, controller=laws[0], sample_time=0.05 if sample_time else None)
        assert (slow.at(15.0)["top.speed"] == runs[0].at(15.0)["top.speed"]) is (sample_time is None)
    del first


def test_a_plant_of_other_numbers_keeps_them_under_a_controller():
    light, heavy = compose(wells.JANSEN_2, BitRock(weight=30_000.0)), compose(wells.JANSEN_2, BitRock(weight=97_347.0))
    law = PI()
    expected = {plant: simulate(plant, 10.0, controller=law)["bit.torque"].max() for plant in (light, heavy)}
    assert expected[light] == pytest.approx(0.8 * 30_000.0 * 0.155575, rel=1e-6)
    assert expected[heavy] == pytest.approx(0.8 * 97_347.0 * 0.155575, rel=1e-6)
    for plant in (light, heavy, light):
        assert simulate(plant, 10.0, controller=law)["bit.torque"].max() == expected[plant]
    overridden = simulate(light, 10.0, controller=law, parameters={"bit.weight": 60_000.0})
    assert overridden["bit.torque"].max() == pytest.approx(0.8 * 60_000.0 * 0.155575, rel=1e-6)
    assert simulate(light, 10.0, controller=law)["bit.torque"].max() == expected[light]


def test_a_law_is_checked_again_for_other_numbers_of_the_same_structure():
    @dataclass(frozen=True)
    class Limited(Controller):
        actuated_signals = ("top.torque",)
        low: float = quantity(0.0, "N m", "lower limit")
        high: float = quantity(1.0, "N m", "upper limit")

        def check(self):
            if self.low > self.high:
                raise SceneError("Argument `low` must be <= `high`.")

        def continuous(self, signal):
            return Equations(outputs={"top.torque": (self.low + 0 * self.high, "N m")})

        def sampled(self, signal, period):
            return Update({}, {"top.torque": (self.low + 0 * self.high, "N m")})

    for sample_time in (None, 0.1):
        simulate(RIG, 1.0, controller=Limited(0.0, 1.0), sample_time=sample_time)
        with pytest.raises(SceneError, match="low"):
            simulate(RIG, 1.0, controller=Limited(2.0, 1.0), sample_time=sample_time)


def test_structure_is_part_of_the_plant():
    # an int, a str or the class of a law is structure: plants that differ in it must not be confused
    assert (
        simulate(compose(BlockOnBelt(friction=Exponential())), 10.0).events
        != simulate(compose(BlockOnBelt(friction=Hyperbolic())), 10.0).events
    )
    assert compose(TorsionalChain()).x.numel() == 3
    assert compose(wells.NAVARRO_LOPEZ_4).x.numel() == 7


def test_classes_of_one_name_and_shape_are_different_parts():
    def make(rate):
        @dataclass(frozen=True)
        class Decay(Component):
            def equations(self, signal):
                x = state("decay.x", "1")
                return Equations(flow={x: -rate * x})

        return Decay()

    for rate in (1.0, 2.0, 1.0):
        run = simulate(compose(make(rate)), 1.0, start={"decay.x": 1.0}, accuracy=1e-9)
        assert run.at(1.0)["decay.x"] == pytest.approx(math.exp(-rate), rel=1e-8)


def test_a_law_of_the_user_is_a_law():
    @dataclass(frozen=True)
    class Linear(FrictionLaw):
        slope: float = quantity(0.1, "s/m", "rise with speed", at_least=0)

        def sliding(self, speed):
            return 1 + self.slope * speed

        def breakaway(self):
            return ca.SX(1)

    run = simulate(
        compose(BlockOnBelt(belt_speed=0.0, stiffness=0.0, friction=Linear(slope=0.5))), 1.0, start={"block.speed": 2.0}, accuracy=1e-10
    )
    # v' = -1 - v / 2: v = 4 exp(-t / 2) - 2
    assert run.at(1.0)["block.speed"] == pytest.approx(4 * math.exp(-0.5) - 2, rel=1e-9)


def test_a_composed_controller_is_designed_on_the_plant_it_joins():
    plant = compose(wells.JANSEN_2, BitRock(), SoftTorque())
    assert plant.parameter("softtorque.proportional") == pytest.approx(math.sqrt(473.0 * 374.0), rel=1e-12)


def test_equations_that_decide_in_python_on_a_number_are_refused_with_the_name_of_the_part():
    @dataclass(frozen=True)
    class Branching(Component):
        rate: float = quantity(1.0, "1/s", "rate")

        def equations(self, signal):
            x = state("decay.x", "m")
            return Equations(flow={x: -x if self.rate > 2 else -self.rate * x})

    with pytest.raises(SceneError, match="The equations of Branching decide in Python"):
        compose(Branching())


@pytest.mark.parametrize("numpys, casadis", [(np.sin, ca.sin), (np.tanh, ca.tanh), (lambda x: np.maximum(x, 0), lambda x: ca.fmax(x, 0))])
def test_equations_in_numpys_words_are_those_in_casadis_and_warn_of_nothing(numpys, casadis):
    # a warning would be an error here
    @dataclass(frozen=True)
    class Falling(Component):
        function: str

        def equations(self, signal):
            x, v = state("pendulum.angle", "rad"), state("pendulum.speed", "rad/s")
            return Equations(flow={x: v, v: -(numpys if self.function == "numpy" else casadis)(x)})

    ends = [simulate(compose(Falling(word)), 2.0, start={"pendulum.angle": 1.0}).states[-1] for word in ("numpy", "casadi")]
    np.testing.assert_array_equal(*ends)
    assert ca.GlobalOptions.getNumpyMode() == 0  # as it was


@pytest.mark.parametrize("function", [lambda x: np.clip(x, -1, 1), np.sum, lambda x: np.dot(np.eye(1), x)])
def test_a_numpy_function_that_symbols_have_not_is_refused_with_the_name_of_the_part(function):
    @dataclass(frozen=True)
    class Clipped(Component):
        def equations(self, signal):
            x = state("clipped.x", "m")
            return Equations(flow={x: -function(x)})

    with pytest.raises(SceneError, match="The equations of Clipped call a numpy function"):
        compose(Clipped())


def test_a_state_without_a_flow_is_named():
    @dataclass(frozen=True)
    class Half(Component):
        def equations(self, signal):
            return Equations(flow={state("half.x", "m"): state("half.v", "m/s")})

    with pytest.raises(SceneError, match="half.v; a state must be a key of `flow`"):
        compose(Half())


# --- casadi front doors


def test_the_casadi_functions_of_a_plant_agree_with_its_runs():
    run = simulate(RIG, 30.0, inputs={"top.torque": 12_000.0}, accuracy=1e-9)
    for k in range(0, run.time.size, 7):
        mode = run.mode[k].astype(float)
        u = np.array(RIG.input_defaults(RIG.values)).ravel()
        u[list(RIG.inputs).index("top.torque")] = 12_000.0
        force = float(RIG.force_function(run.time[k], run.states[k], u, RIG.values, mode))
        assert force == pytest.approx(run["bit.force"][k], rel=1e-12)
        assert float(RIG.slip_function(run.time[k], run.states[k], u, RIG.values, mode)) == run["bit.slip"][k]
        if mode[0] == 0:
            assert abs(np.array(RIG.rhs(run.time[k], run.states[k], u, RIG.values, mode)).ravel()[-1]) < 1e-13


@dataclass(frozen=True)
class Stops(Component):
    """A mass whose stops may be none: an empty tuple between two others, and an empty row of states."""

    mass: tuple[float, ...] = quantity((1.5,), "kg", "mass", above=0)
    restitution: tuple[float, ...] = quantity((), "1", "restitution of each stop", at_least=0, at_most=1)
    stiffness: tuple[float, ...] = quantity((6.0,), "N/m", "stiffness", at_least=0)

    def equations(self, signal):
        x, v, play = state("mass.position", "m"), state("mass.speed", "m/s"), state("stop.play", "m", len(self.restitution))
        flow = {x: v, v: -self.stiffness[0] * x / self.mass[0]}
        return Equations(flow={**flow, play: 0.0 * play} if self.restitution else flow)


def test_a_parameter_that_is_an_empty_tuple_is_checked_as_itself():
    """sqrt(6 / 1.5) = 2 rad/s; the stiffness behind the empty tuple is beyond the bounds of the restitution."""
    plant = compose(Stops())
    run = simulate(plant, 1.0, start={"mass.position": 1.0})
    assert run["mass.position"][-1] == pytest.approx(np.cos(2.0), rel=1e-6)
    assert plant.parameter("mass.restitution").size == 0 and plant.parameter("mass.stiffness").tolist() == [6.0]
    assert plant.with_parameters({"mass.restitution": []}).parameter("mass.mass").tolist() == [1.5]
    with pytest.raises(SceneError, match=r"Argument `mass.restitution` must be >= 0 and <= 1, but it is 2"):
        compose(Stops(restitution=(0.5, 2.0)))
    with pytest.raises(SceneError, match=r"Argument `mass.stiffness` must be >= 0 N/m, but it is -1"):
        compose(Stops(stiffness=(-1.0,)))
    with pytest.raises(SceneError, match=r"`mass.restitution` must have shape \(0,\)"):
        plant.with_parameters({"mass.restitution": [0.5]})
