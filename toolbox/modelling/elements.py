"""Words for writing a part of a plant: states, quantities and set-valued contacts.

Why set-valued, not tanh: dry friction at rest is whatever force keeps the contact at rest, up to a bound. A regularised law creeps and lowers the break-away
force: a controller designed on it can park a bit that the real machine would have to break free. Here force alone decides when a contact leaves stick.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import casadi as ca
import numpy as np

from toolbox.errors import SceneError
from toolbox.files.printing import Declared
from toolbox.files.units import in_si, warn_unusual
from toolbox.vocabulary import Renamed, new_names_only

time = ca.SX.sym("time")
"""The symbol of time [s]: build input expressions from it, e.g. `10_000 + 500*casadi.sin(3*time)`."""


class State(ca.SX):
    """A named state of a part: a casadi symbol with a name, a unit and a size. `state` makes it.

    Examples
    --------
    >>> from toolbox import state
    >>> print(state("chain.speed", "rad/s", size=4).length)
    4
    """

    begin: Any = 0.0  # where a run starts unless it is told otherwise
    __hash__ = object.__hash__  # a vector SX has no hash of its own; a state is identified by itself

    def __init__(self, name: str, unit: str, size: int | None = None):
        super().__init__(ca.SX.sym(name, 1 if size is None else size))
        self.label = name
        self.unit = unit
        self.length = size


def state(name: str, unit: str, size: int | None = None) -> State:
    """Declare a state `part.quantity` of a part: a scalar, or a column of `size` entries.

    In a run, the name of a vector state gives an array of shape (nt, size).

    Parameters
    ----------
    name
        `part.quantity`, such as "block.speed".
    unit
        SI unit of the state.
    size
        Number of entries of a vector. By default None: a scalar.

    Returns
    -------
    State
        The state, for the `Equations` of a part.

    Examples
    --------
    >>> from toolbox import state
    >>> speed = state("chain.speed", "rad/s", size=4)
    >>> print(speed.label, speed.length, speed.unit)
    chain.speed 4 rad/s
    """
    return State(name, unit, size)


if TYPE_CHECKING:
    _Read = TypeVar("_Read", covariant=True)

    class _Field(Generic[_Read]):
        """A field that is read as one type and takes others, too, as a type checker understands it of the fields of a dataclass.

        What it takes is `Any` beside what it reads as: mypy reads a field that a frozen dataclass inherits as what it takes, so that `float | str` would make
        an error of every product with it.
        """

        def __get__(self, part: Any, kind: Any = None) -> _Read: ...
        def __set__(self, part: Any, value: _Read | Any) -> None: ...

else:

    class _Field:
        """At run time, what the field reads as."""

        def __class_getitem__(cls, read: Any) -> Any:
            return read


Quantity = _Field[float]
"""Annotation of a field declared with `quantity`: it takes a number in SI or text with a unit, and reads as a float."""

OptionalQuantity = _Field[float | None]
"""Annotation of a `Quantity` that may be None."""

Quantities = _Field[tuple[float, ...]]
"""Annotation of a field that takes a row of numbers or texts, and reads as a tuple of floats."""

OptionalQuantities = _Field[tuple[float, ...] | None]
"""Annotation of `Quantities` that may be None."""

_ANNOTATIONS = {
    "Quantity": "float", "OptionalQuantity": "float | None", "Quantities": "tuple[float, ...]", "OptionalQuantities": "tuple[float, ...] | None",
}  # fmt: skip


def declared_type(field: dataclasses.Field[Any]) -> str:
    """Return the annotation of a field as text, with the aliases above written out."""
    written = str(field.type)
    return _ANNOTATIONS.get(written.rpartition(".")[2], written)


@new_names_only
def quantity(
    default: Any = dataclasses.MISSING,
    unit: str = "1",
    meaning: str = "",
    *,
    at_least: float | None = None,
    above: float | None = None,
    at_most: float | None = None,
    typical_range: tuple[float, float] | None = None,
    source: str = "",
) -> Any:
    """Declare a numeric field of a part, in SI: `mass: Quantity = quantity(1.0, "kg", "mass of the block", above=0)`.

    The user of the part may also give text with a unit, such as "2 t". The text is converted when the part is made, and
    the field is then a float in SI. For type checkers annotate the field with `Quantity`, `OptionalQuantity` (or None),
    `Quantities` (a tuple) or `OptionalQuantities`. `float` is enough if text is never given.

    A float, or a tuple of floats, becomes a symbol of the compiled model, so a new value needs no new compilation. None
    means that the quantity is absent, which belongs to the structure of the model. The bounds hold for every entry of a
    tuple. They are checked when a plant is composed, and when a run overrides the value.

    Parameters
    ----------
    default
        The default value of the field. If it is left out, the user must give the field.
    unit
        The SI unit, such as "kg". By default "1" (no unit).
    meaning
        The meaning of the number, in words. By default empty.
    at_least, above, at_most
        Bounds of the value: value >= at_least, value > above and value <= at_most. By default None: no such bound.
    typical_range
        (low, high) in SI, which contains every plausible value except 0. `math.inf` for no upper end. By default None:
        no range. A part with a value outside this range warns once (`UnusualValue`), and names the unit that was
        perhaps meant. Choose the range so wide that no real machine is outside.
    source
        Publication that gives the default value. By default empty: the value is an example without a publication.

    Returns
    -------
    Any
        The field, for the body of a class that is a `Component`, a `Controller` or a `FrictionLaw`.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> print(BlockOnBelt(mass="2 t").mass, "kg")
    2000.0 kg
    """
    metadata = {
        "unit": unit,
        "meaning": meaning,
        "at_least": at_least,
        "above": above,
        "at_most": at_most,
        "usual": typical_range,
        "source": source,
    }
    return dataclasses.field(default=default, metadata=metadata)


def fields_in_si(part: Any, instead: Mapping[str, str] | None = None) -> None:
    """Convert the fields of a part from the typed form: text with a unit becomes a number in SI, lists and arrays become tuples.

    instead: {declared unit: another unit that text may be in}. Raises SceneError for text that is no quantity of the field.
    """
    for field in dataclasses.fields(part):
        given = value = getattr(part, field.name)
        if isinstance(value, (list, np.ndarray)) and declared_type(field).startswith("tuple"):
            value = tuple(value.tolist() if isinstance(value, np.ndarray) else value)
        unit = field.metadata.get("unit")
        if unit is not None:
            value = in_si(value, unit, f"{type(part).__name__}.{field.name}", (instead or {}).get(unit))
            if field.metadata.get("usual") is not None and not _below(value, field.metadata):
                warn_unusual(given, value, unit, field.metadata["usual"], f"{type(part).__name__}.{field.name}")
        if value is not given:
            object.__setattr__(part, field.name, value)


def _below(value: Any, bounds: Mapping[str, Any]) -> bool:
    """Whether numbers are below a bound, which is said of them when the plant is composed."""
    least = bounds.get("above") if bounds.get("at_least") is None else bounds["at_least"]
    numbers = value if isinstance(value, tuple) else (value,)
    return least is not None and any(isinstance(number, (int, float)) and number < least for number in numbers)


TURNED = {"s/rad": "s/m", "s/m": "s/rad", "m/s": "rad/s", "rad/s": "m/s", "m": "rad", "1/m": "1/rad"}
"""Friction laws serve turning and straight contacts alike: the slip unit of a law's parameters may be either."""


def _without(law: Any, method: str, what: str) -> SceneError:
    return SceneError(f"The friction law {type(law).__name__} must have a method `{method}` that returns {what}, but it has none.")


def _expression(law: Any, method: str, given: Any) -> ca.SX:
    """What a law returns as an expression; raises SceneError for anything else."""
    try:
        found = ca.SX(given)
    except NotImplementedError:
        found = ca.SX(0, 0)
    if not found.is_scalar():
        raise SceneError(f"The friction law {type(law).__name__} must return one expression from `{method}`, but it returned {given!r}.")
    return found


@dataclass(frozen=True)
class FrictionLaw(Renamed, Declared):
    """Friction law: the coefficient of dry friction per unit of load, as a function of the slip speed.

    Write your own law as a frozen dataclass that is a subclass. Declare its numeric fields with `quantity`, and write
    the methods `sliding` and `breakaway`. The law must be a smooth function of positive slip speeds. Two exceptions are
    allowed: kinks of casadi's fabs, fmin and fmax, and jumps at the speeds that the method `break_speeds` returns.

    A law with memory declares its internal states in `memory` and writes `evolution`. `sliding` is then the friction at
    constant slip speed. The force is a function of these states and of the slip, as for bristles (Dahl 1968) and
    rate-and-state friction (Rice, Ben-Zion 1996). A contact with such a law has no modes, and creeps instead of
    sticking.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from toolbox import FrictionLaw, Quantity, quantity
    >>> @dataclass(frozen=True)
    ... class Falling(FrictionLaw):
    ...     static: Quantity = quantity(0.5, "1", "static coefficient", above=0)
    ...
    ...     def sliding(self, speed):
    ...         return self.static / (1 + speed)
    ...
    ...     def breakaway(self):
    ...         return self.static
    >>> print(Falling().sliding(1.0), "at a slip speed of 1")
    0.25 at a slip speed of 1
    """

    def __post_init__(self) -> None:
        fields_in_si(self, TURNED)

    def memory(self, directions: int) -> Mapping[str, tuple[str, Any]]:
        """Return the internal states as {name: (unit, start value)}. Empty for a law without memory.

        A start value is a number. For a state with one entry per direction, such as a deflection, it is `(0.0,) *
        directions`.

        Parameters
        ----------
        directions
            Number of directions in which the contact slips.
        """
        return {}

    def evolution(self, slip: ca.SX, speed: ca.SX, load: ca.SX, memory: Mapping[str, ca.SX]) -> tuple[ca.SX, Mapping[str, Any]]:
        """Return (friction per unit of load, {internal state: its rate of change}) of a law with memory.

        The force of the contact is -load times the friction, so in steady sliding the friction has the sign of the slip. It
        is a casadi expression without a unit, a column if the contact slips in two directions. The rate of an internal
        state has its unit per second.

        Parameters
        ----------
        slip
            Slip velocity [m/s or rad/s], a column with one entry for each direction.
        speed
            Slip speed, the magnitude |slip| of the slip velocity.
        load
            Normal load of the contact [N].
        memory
            {internal state: its value}.
        """
        raise _without(self, "evolution", "friction per unit of load and the rates of its states")

    def energies(self, slip: ca.SX, speed: ca.SX, load: ca.SX, memory: Mapping[str, ca.SX]) -> tuple[Any, Mapping[str, Any]]:
        """Return the stored energy and {name: dissipated power} of a law with memory, per unit of load.

        Both are divided by the load of the contact, with which the toolbox multiplies them: the energy is in m, and each
        power in m/s. For rotation, with a load in N m, the units are rad and rad/s. Without an override, the stored energy
        is 0, and the whole power of the friction is dissipated.

        Parameters
        ----------
        slip
            Slip velocity [m/s or rad/s], a column with one entry for each direction.
        speed
            Slip speed, the magnitude |slip| of the slip velocity.
        load
            Normal load of the contact [N, or N m for rotation]. Only a law whose friction is not proportional to the load
            needs this argument.
        memory
            {internal state: its value}.
        """
        return 0.0, {"memory": ca.dot(self.evolution(slip, speed, load, memory)[0], slip)}

    def sliding(self, speed: ca.SX, *beyond: ca.SX) -> ca.SX:
        """Return the kinetic friction per unit of load (the coefficient of friction) at a slip speed.

        Parameters
        ----------
        speed
            Slip speed >= 0 [m/s or rad/s].
        beyond
            Only for a law that jumps at certain speeds, which its method `break_speeds` returns: for each of these
            speeds a number, 0 while the slip speed is below it, 1 above it. The toolbox passes these numbers, so that
            the law need not compare speeds. For any other law this argument is empty.
        """
        raise _without(self, "sliding", "kinetic friction per unit of load")

    def break_speeds(self) -> tuple[Any, ...]:
        """Return the slip speeds > 0 at which the friction coefficient jumps. By default none.

        In a run, each passage of such a speed is located as an event of the element `<contact>.break`.
        """
        return ()

    def reverse(self) -> FrictionLaw:
        """Return the friction law that holds for negative slip speeds. Without an override, the method returns this law: friction
        is then the same in both directions.
        """
        return self

    def breakaway(self) -> ca.SX:
        """Return the static friction per unit of load, the largest friction at rest."""
        raise _without(self, "breakaway", "the static bound per unit of load")

    def check(self) -> None:
        """Raise SceneError if fields contradict each other."""


FRICTION, RIGID, SWITCH = range(3)
"""Kinds of elements in the compiled steps: friction and relays hold or slide; a rigid contact holds (0) or is free (1); a switch is in mode 0 or 1."""


class Element(Renamed):
    """A set-valued or switching element with one integer mode.

    Elements that hold (`DryFriction`, `Relay`, rigid `UnilateralContact`) keep `slip` at zero in mode 0, by whatever multiplier that takes; else
    the multiplier is -mode * kinetic, kinetic = load * sliding. Switches (`Hysteresis`, elastic `UnilateralContact`, a break of a law) have mode 0 or 1 and
    no multiplier. `force` is an expression to be used, affinely, in the flow of the part that owns the element. One with a `flow`, {state: rate}, has no mode.

    What an element can do it answers; nobody asks for its class.
    """

    mode_names: Mapping[int, str] = {0: "stick", 1: "slip+", -1: "slip-"}
    expression_fields: ClassVar[tuple[str, ...]] = ("slip", "static", "load", "sliding")  # names of what may hold symbols of the equations
    event_field: ClassVar[str] = ""  # name of the expression that switches it, where forces and slip do not
    holds: bool = True
    rigid: bool = False  # holds a gap closed, and strikes
    has_gap: ClassVar[bool] = False
    is_unilateral: ClassVar[bool] = False  # holds a slip, as a gap is held, by a force of one sign
    higher_degree: bool = False  # a relay whose surface its force reaches through lags
    second: ClassVar[bool] = False  # the second slip direction of the friction before it
    initial: int = 0
    law: FrictionLaw | None = None
    lift_off: str = ""  # the part that models what happens where its load would be negative
    companions: Sequence[Element] = ()  # what comes with it, and stands behind it
    directions: int = 1
    speed: ca.SX = ca.SX(0, 1)
    closure: ca.SX = ca.SX(0)
    restitution: ca.SX = ca.SX(0)
    flow: Mapping[State, ca.SX] = MappingProxyType({})
    powers: Sequence[Mapping[str, ca.SX]] = ()  # losses and supplies of one with a flow

    def __init__(self, name: str, slip: ca.SX | float, slip_unit: str, force_unit: str):
        self.name = name
        self.slip = ca.SX(slip)
        self.slip_unit = slip_unit
        self.force_unit = force_unit
        self.multiplier = ca.SX.sym(f"{name}.multiplier")
        self.force: ca.SX = self.multiplier
        self.mode = ca.SX.sym(f"{name}.mode")
        self.static, self.load, self.sliding = ca.SX(0), ca.SX(0), ca.SX(0)

    @property
    def kinetic(self) -> ca.SX:
        """Magnitude of the force while sliding."""
        return self.load * self.sliding

    @property
    def slides(self) -> bool:
        """Whether it holds its slip, or slides with a force that is bounded both ways; else a guard alone tells its mode, 0 or 1."""
        return self.holds and not self.rigid

    @property
    def kind(self) -> int:
        """FRICTION, RIGID or SWITCH, as which a second direction has its mode: it holds and slides with the first."""
        return RIGID if self.rigid else FRICTION if self.holds and not self.second else SWITCH

    @property
    def breaks(self) -> list[Element]:
        """Companion elements that detect the jumps of the friction law."""
        return [each for each in self.companions if not each.second]

    def mapped(self, change: Callable[[ca.SX], ca.SX]) -> Element:
        """A copy with all its expressions changed."""
        twin = copy.copy(self)
        for name in self.expression_fields:
            setattr(twin, name, change(getattr(self, name)))
        return twin

    def guards(self, multiplier: ca.SX, bound: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Two expressions that are positive while the mode holds; multiplier and bound are zero unless the element holds."""
        return bound - multiplier + self.mode * self.slip, bound + multiplier + self.mode**2

    @property
    def title(self) -> str:
        """What errors call it."""
        return f"`{self.name}`"

    def negative_bound(self, what: str, why: str = "is its load negative?") -> str:
        """Return the message of the error for a negative bound, with a condition and a cause."""
        hint = f" The contact lifts off, which `{self.lift_off}` models." if self.lift_off else ""
        return f"The bound of `{self.name}` must be >= 0, but it {what}: {why}{hint}"

    def signals(self) -> dict[str, tuple[ca.SX, str]]:
        """What the element shows in a result: {last word of the name: (expression, unit)}."""
        return {"force": (self.force, self.force_unit), "slip": (self.mode**2 * self.slip, self.slip_unit)}


class DryFriction(Element):
    """Dry friction at a contact with slip speed `slip`, a friction law `law`, and a normal load `load`.

        stick:  slip = 0 and |force| <= static = load * law.breakaway()
        slip:   force = -sgn(slip) * load * law.sliding(|slip|)

    - `slip` may depend on states, parameters and time, but not on a signal that a sampled controller gives.
    - `load` is 1 by default, for friction laws whose coefficient is a force. A negative load raises an error during the
      run. A load that cannot become negative is, for example, the `force` of a `UnilateralContact`.
    - `lift_off` is the name of a part that models the loss of contact. The error for a negative load mentions this
      name.
    - Each speed at which the law jumps is a separate element, `name.break`, with the modes "below" and "beyond".

    Slip in two directions: `slip` is a column of two slips with one unit, `casadi.vertcat(axial, radius * turning)`,
    and `force` is a column of two. Both directions share one friction cone: |force| is limited, so motion in one
    direction reduces the friction in the other:

        stick:  slip = 0 and |force| <= static, with the length of both columns
        slip:   force = -slip / |slip| * load * law.sliding(|slip|)

    The modes are then "stick" and "slip", and the signals `name.force` and `name.slip` are the lengths of the columns.
    The direction of the force is a separate element, `name.direction`. Its mode is "pull" from the break-away until the
    contact moves, then "slip". The load must not come from a rigid contact.

    Friction law with memory: the contact has no modes, and force = -load * friction(slip, memory). Its internal states
    are signals such as `pad.deflection`. The energy audit then contains three more terms for the contact: the supplied
    power (supply `pad.slip`), the power that the memory returns (`pad.memory`), and the losses.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from models import Coulomb
    >>> from toolbox import Component, DryFriction, Equations, compose, state
    >>> @dataclass(frozen=True)
    ... class Block(Component):
    ...     def equations(self, signal):
    ...         v = state("block.speed", "m/s")
    ...         ground = DryFriction("ground", v, Coulomb(0.5, 0.3), load=10.0)
    ...         return Equations(flow={v: signal("block.force", "N", default=0.0) + ground.force}, elements=[ground])
    >>> print(compose(Block()))
    HybridSystem(Block): 1 states (block.speed); contacts: ground; inputs: block.force [N]
    """

    def __init__(
        self,
        name: str,
        slip: ca.SX,
        law: FrictionLaw,
        load: ca.SX | float = 1.0,
        *,
        slip_unit: str = "m/s",
        force_unit: str = "N",
        lift_off: str = "",
    ):
        if isinstance(slip, (list, tuple)):
            words = f"one expression or a column of two, `casadi.vertcat(a, b)`, but it is a {type(slip).__name__}"
            raise SceneError(f"Argument `slip` of `{name}` must be {words}.")
        slips = ca.densify(ca.SX(slip))
        if slips.shape not in ((1, 1), (2, 1)):
            raise SceneError(f"Argument `slip` of `{name}` must be one expression or a column of two, but its shape is {slips.shape}.")
        super().__init__(name, slips[0], slip_unit, force_unit)
        if not isinstance(law, FrictionLaw):
            raise SceneError(f"Argument `law` of `{name}` must be a friction law such as Coulomb(), but it is {law!r}.")
        self.law = law
        self.lift_off = lift_off
        self.load = ca.SX(load)
        if not self.load.is_scalar():
            raise SceneError(f"Argument `load` of `{name}` must be one normal force, but its shape is {self.load.shape}.")
        self.directions = slips.numel()
        if law.memory(self.directions):
            self._remember(slips, law)
            return
        # |slip| = mode * slip while the mode holds; the product continues the law smoothly past the switching surface, where a step looks ahead
        speed = self.mode * self.slip
        second = []
        if self.directions == 2:
            self.mode_names = {0: "stick", 1: "slip"}
            self.speed = speed = ca.SX.sym(f"{name}.speed")
            second = [SecondDirection(f"{name}.direction", slips[1], slip_unit, force_unit)]
            self.force = ca.vertcat(self.multiplier, second[0].multiplier)
        back = law.reverse()
        if back is not law:
            self._two_way(law, back, speed)
            return
        jumps = _jumps(name, law.break_speeds(), speed)
        self.companions = [*second, *jumps]
        self.sliding = _expression(law, "sliding", law.sliding(speed, *[jump.mode for jump in jumps]))
        self.static = self.load * _expression(law, "breakaway", law.breakaway())

    def _two_way(self, law: FrictionLaw, back: FrictionLaw, speed: ca.SX) -> None:
        """Take a law for each direction: with half the difference of their bounds in the force, the rest of it has one bound both ways."""
        if self.directions != 1:
            raise SceneError(
                f"The law of `{self.name}` must be one for both directions, as it slips in a plane, but {type(law).__name__} has two."
            )
        jumps = _jumps(self.name, [*law.break_speeds(), *back.break_speeds()], speed)
        self.companions, beyond = jumps, [jump.mode for jump in jumps]
        ahead, behind = (_expression(each, "breakaway", each.breakaway()) for each in (law, back))
        shift = (behind - ahead) / 2
        slides = _expression(law, "sliding", law.sliding(speed, *beyond[: len(law.break_speeds())])) + shift
        returns = _expression(back, "sliding", back.sliding(speed, *beyond[len(law.break_speeds()) :])) - shift
        self.sliding = (slides + returns) / 2 + self.mode * (slides - returns) / 2
        self.static = self.load * (ahead + behind) / 2
        self.force = self.multiplier + self.load * shift

    def _remember(self, slips: ca.SX, law: FrictionLaw) -> None:
        """Take force, states and powers from a law; what is stored is booked as a power, as a load that changes makes it worth more or less."""
        states = {}
        for word, (unit, start) in law.memory(self.directions).items():
            states[word] = state(word, unit, np.size(start) if np.size(start) > 1 else None)
            states[word].begin = start
        told = (slips, ca.fabs(slips) if slips.is_scalar() else length(slips), self.load, states)
        friction, rates = law.evolution(*told)
        if set(rates) != set(states):
            given = ", ".join(rates) or "none"
            raise SceneError(f"The law of `{self.name}` must give a rate for {', '.join(states)}, but it gives {given}.")
        stored, losses = law.energies(*told)
        self.slip, self.force, self.mode = slips, -self.load * friction, ca.SX(1)
        self.flow = {states[word]: ca.SX(rate) for word, rate in rates.items()}
        growth = ca.jtimes(ca.SX(stored), ca.vertcat(*self.flow), ca.vertcat(*self.flow.values()))
        supplies = {"slip": -ca.dot(self.force, slips), "memory": -self.load * growth}
        self.powers = ({word: self.load * power for word, power in losses.items()}, supplies)

    def signals(self) -> dict[str, tuple[ca.SX, str]]:
        if self.directions == 1:
            return super().signals()
        slips = self.slip if self.flow else ca.vertcat(self.slip, self.companions[0].slip)
        force, slip = (ca.sumsqr(column) / length(column) for column in (self.force, slips))  # exactly zero at zero
        return {"force": (force, self.force_unit), "slip": (self.mode**2 * slip, self.slip_unit)}


class SecondDirection(Element):
    """The second direction of the `DryFriction` before it: its slip and its multiplier, and whose direction the force of both has."""

    mode_names: Mapping[int, str] = {0: "pull", 1: "slip"}
    second: ClassVar[bool] = True

    @property
    def title(self) -> str:
        return f"`{self.name.removesuffix('.direction')}` (second slip)"

    def signals(self) -> dict[str, tuple[ca.SX, str]]:
        return {}


def length(column: ca.SX, beside: ca.SX | float = 0.0) -> ca.SX:
    """Length of a column, which has a derivative at zero, too; sqrt(length^2 + beside) with a second argument."""
    return ca.sqrt(ca.sumsqr(column) + beside + 1e-300)


class Hysteresis(Element):
    """Switch with two positions and memory: `output` becomes 1 when `signal` rises to `high`, and 0 when it falls to `low`.

    Between `low` and `high` the output keeps its last value. At the start the position is `start` ("low" or "high").
    `low` must be <= `high`. If low = high and each position of the switch drives the signal back to the threshold, the
    switch chatters. Use a `Relay` for this case.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from toolbox import Component, Equations, compose, state
    >>> from toolbox.modelling import Hysteresis
    >>> @dataclass(frozen=True)
    ... class Tank(Component):
    ...     def equations(self, signal):
    ...         level = state("tank.level", "m")
    ...         drain = Hysteresis("drain", level, low=1.0, high=2.0, signal_unit="m")
    ...         return Equations(flow={level: 0.5 - drain.output}, elements=[drain])
    >>> print(compose(Tank()))
    HybridSystem(Tank): 1 states (tank.level); contacts: drain; inputs: none
    """

    mode_names: Mapping[int, str] = {0: "low", 1: "high"}
    expression_fields: ClassVar[tuple[str, ...]] = (*Element.expression_fields, "signal", "low", "high")
    event_field: ClassVar[str] = "signal"
    holds = False

    def __init__(self, name: str, signal: ca.SX, low: ca.SX | float, high: ca.SX | float, *, start: str = "low", signal_unit: str = "1"):
        super().__init__(name, 0, signal_unit, "1")
        if start not in ("low", "high"):
            raise SceneError(f"Argument `start` of `{name}` must be low or high, but it is {start!r}.")
        self.initial = 1 if start == "high" else 0
        self.signal, self.low, self.high = ca.SX(signal), ca.SX(low), ca.SX(high)
        if self.low.is_constant() and self.high.is_constant() and not float(self.low) <= float(self.high):
            raise SceneError(f"Argument `low` of `{name}` must be <= `high`, but they are {self.low} and {self.high}.")

    @property
    def output(self) -> ca.SX:
        """Output of the switch as an expression: 0 or 1."""
        return self.mode

    def guards(self, multiplier: ca.SX, bound: ca.SX) -> tuple[ca.SX, ca.SX]:
        return (1 - self.mode) * (self.high - self.signal) + self.mode * (self.signal - self.low), ca.SX(1)

    def signals(self) -> dict[str, tuple[ca.SX, str]]:
        return {"output": (self.mode, "1")}


class _Break(Hysteresis):
    """Whether a slip speed is below or beyond a break of its law."""

    mode_names: Mapping[int, str] = {0: "below", 1: "beyond"}

    def __init__(self, name: str, speed: ca.SX, place: ca.SX | float):
        super().__init__(name, speed, place, place, start="low")

    def signals(self) -> dict[str, tuple[ca.SX, str]]:
        return {}


def _jumps(name: str, breaks: Sequence[Any], speed: ca.SX) -> list[_Break]:
    return [_Break(f"{name}.break" + (f".{i}" if len(breaks) > 1 else ""), speed, place) for i, place in enumerate(breaks)]
