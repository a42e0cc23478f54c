"""Parts of a plant: what a component writes, and its fields as numbers, as structure and as symbols."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from toolbox.arguments import refuse, within
from toolbox.errors import SceneError
from toolbox.files.printing import Declared
from toolbox.modelling.elements import Element, FrictionLaw, State, declared_type, fields_in_si
from toolbox.modelling.opposing import check_opposing
from toolbox.vocabulary import Renamed


@dataclass
class Update(Renamed):
    """Update of a sampled controller at a sample: its next memory and its outputs. The method `sampled` of a `Controller` returns it.

    Attributes
    ----------
    memory
        {state of the controller: its next value}.
    outputs
        {signal name: (value that is held until the next sample, unit)}.
    from_callable
        Whether a Python callable computes the values.
    noise
        {measured signal: symbol of its standard normal noise}. The toolbox fills this field for sensors with noise.

    Examples
    --------
    >>> from toolbox import Update, state
    >>> angle = state("law.angle", "rad")
    >>> update = Update(memory={angle: angle + 0.1}, outputs={"top.torque": (2.0 * angle, "N m")})
    >>> print(len(update.memory), "value of memory,", len(update.outputs), "output")
    1 value of memory, 1 output
    """

    memory: Mapping[State, Any]
    outputs: Mapping[str, tuple[Any, str]]
    from_callable: bool = False
    noise: Mapping[str, ca.SX] = dataclasses.field(default_factory=dict)


@dataclass
class Equations(Renamed):
    """Equations that a part adds to a plant. The method `equations` of a `Component` returns them.

    Write energy and power from the physics, not from the flow, so that the energy audit can compare both. States are
    signals automatically.

    Attributes
    ----------
    flow
        {state: its time derivative}.
    outputs
        {signal name: (expression, unit)}.
    elements
        The set-valued elements whose forces appear in `flow`, such as a `DryFriction`.
    stored
        Stored energy [J], an expression. None if the part stores no energy.
    losses, supplies
        {name: dissipated power [W]} and {name: supplied power [W]}.
    update
        Update of a sampled controller at its samples. None for every other part.

    Examples
    --------
    >>> from toolbox import Equations, state
    >>> x, v = state("block.position", "m"), state("block.speed", "m/s")
    >>> equations = Equations(flow={x: v, v: -4.0 * x}, stored=(v**2 + 4.0 * x**2) / 2)
    >>> print(len(equations.flow), "states")
    2 states
    """

    flow: Mapping[State, Any] = dataclasses.field(default_factory=dict)
    outputs: Mapping[str, tuple[Any, str]] = dataclasses.field(default_factory=dict)
    elements: Sequence[Element] = ()
    stored: Any = None
    losses: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    supplies: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    update: Update | None = None


Signal = Callable[..., ca.SX]
"""`signal(name, unit, default=...)`: a signal the part needs, with the default it takes where nobody gives it."""


@dataclass(frozen=True)
class Component(Renamed, Declared):
    """Part of a plant. Write your own part as a frozen dataclass: declare its numbers with `quantity` and write `equations`.

    The names of its parameters begin with the prefix of its first state, or of its first output signal if it has no
    state. Two parts with the same prefix need the field `name`, which replaces the prefix.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from toolbox import Component, Equations, Quantity, compose, quantity, state
    >>> @dataclass(frozen=True)
    ... class Mass(Component):
    ...     mass: Quantity = quantity(2.0, "kg", "mass", above=0)
    ...
    ...     def equations(self, signal):
    ...         v = state("mass.speed", "m/s")
    ...         return Equations(flow={v: signal("mass.force", "N", default=0.0) / self.mass}, stored=self.mass * v**2 / 2)
    >>> plant = compose(Mass())
    >>> print(plant)
    HybridSystem(Mass): 1 states (mass.speed); contacts: none; inputs: mass.force [N]
    """

    holds_law: ClassVar[bool] = False

    name: str | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        fields_in_si(self)

    def equations(self, signal: Signal) -> Equations:
        """Return the equations of the part. In this method the numeric fields of `self` are casadi symbols.

        Parameters
        ----------
        signal
            Function `signal(name, unit, default=...)` that returns the expression of a signal that the part needs. If
            no other part gives the signal, it becomes an input with this default. Without a default such a signal is an
            error.

        Returns
        -------
        Equations
            Rates of the states, output signals, elements and energies.
        """
        raise SceneError(
            f"The part {type(self).__name__} must have a method `equations(self, signal)` that returns Equations, but it has none."
        )

    def check(self) -> None:
        """Raise SceneError if fields contradict each other. Bounds that are declared with `quantity` are checked without this method."""

    @property
    def signal_limits(self) -> Mapping[str, tuple[float | None, float | None]]:
        """Physical limits of signals that the part enforces, such as the torque limit of a motor, as {signal: (lowest, highest)} in SI.

        None means no limit in this direction. Figures of a run draw these limits as dotted lines.
        """
        return {}

    @property
    def redirected_signals(self) -> Mapping[str, str]:
        """Signals that this part redirects, as {signal in the controller: signal of the plant that is connected to the controller}.

        Empty for most parts. Example: {"top.torque": "drive.command"} inserts an actuator between controllers and
        string, and the controllers need no change.
        """
        return {}


class _Field(NamedTuple):
    """What a class declares about one of its fields."""

    name: str
    spec: dataclasses.Field[Any]
    numeric: bool
    tuples: bool
    law: bool
    optional: bool
    kind: str


_FIELDS: dict[type, tuple[_Field, ...]] = {}
_KINDS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "int": (lambda value: isinstance(value, (int, np.integer)) and not isinstance(value, bool), "an integer"),
    "str": (lambda value: isinstance(value, str), "a string"),
    "bool": (lambda value: isinstance(value, (bool, np.bool_)), "True or False"),
    "tuple[str, ...]": (lambda value: isinstance(value, tuple) and all(isinstance(word, str) for word in value), "a row of strings"),
}
"""Whether a value is of the kind that a field declares, and the words for it."""


def law_of(part: Component) -> Component:
    """The law for which a part stands, as a sampled one does; any other part itself, whatever it calls `law`."""
    return law_of(part.law) if getattr(part, "holds_law", False) else part  # type: ignore[attr-defined]


def holds_controller(part: Component) -> bool:
    """Whether a part has a controller as a field."""
    return dataclasses.is_dataclass(part) and any(hasattr(getattr(part, field.name), "actuated_signals") for field in fields_of(type(part)))


def own_word(law: Component, memory: Iterable[State]) -> str:
    """The first word of the labels of a controller's own states, which its word replaces; states of a controller that it holds have other ones."""
    heads = [variable.label.partition(".")[0] for variable in memory]
    return heads[0] if heads and not holds_controller(law) else type(law).__name__.lower()


def first_word(part: Component) -> str:
    """The word with which the names of all numbers, states and signals of a controller begin: its `name`, else its class in lowercase."""
    return part.name or type(law_of(part)).__name__.lower()


def remembered(label: str, prefix: str, word: str) -> str:
    """The name of a state of a controller, whose word stands in place of the prefix of its own states, and before those of a controller that it holds."""
    return word + label.removeprefix(prefix) if label.partition(".")[0] == prefix else f"{word}.{label}"


def fields_of(kind: type) -> tuple[_Field, ...]:
    """The declared fields of a part or law; looked up for every run, and therefore kept."""
    known = _FIELDS.get(kind)
    if known is not None:
        return known
    found = []
    for spec in dataclasses.fields(kind):
        declared = declared_type(spec)
        tuples = declared.startswith("tuple[float")
        numeric = spec.name != "name" and ("unit" in spec.metadata or tuples or declared.startswith(("float", "<class 'float'>")))
        optional = spec.default is None or "None" in declared
        word = "" if numeric else declared.removesuffix(" | None").removeprefix("<class '").removesuffix("'>")
        found.append(_Field(spec.name, spec, numeric, tuples, "FrictionLaw" in declared, optional, word))
    return _FIELDS.setdefault(kind, tuple(found))


def is_nested(value: Any) -> bool:
    """True for a field that is a law or a part with fields of its own."""
    return isinstance(value, (FrictionLaw, Component))


def checked(part: Any, opposing: bool = True) -> None:
    """Call `check` of a part, of its law and of the friction laws among its fields. A `check` is called only if the numbers are finite and
    within bounds.

    Where they are not, the parameter table of the composed plant knows the full name to complain about. opposing: friction is to oppose its slip, too.
    """
    for field in fields_of(type(part)):
        value = getattr(part, field.name)
        if is_nested(value):
            try:
                checked(value, opposing)
            except SceneError as error:
                raise SceneError(f"Field `{field.name}` of {type(part).__name__}: {error}") from None
    if all(within(number, field.spec.metadata) for field, number in _numbers(part)):
        part.check()
        if opposing and isinstance(part, FrictionLaw):
            check_opposing(part)


def check_fields(part: Any) -> None:
    """Check the numbers of a part before it is composed.

    Parameters
    ----------
    part
        The part.

    Raises
    ------
    SceneError
        If a number is of the wrong kind or out of bounds, or the method `check` of the part refuses it.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox.authoring import check_fields
    >>> part = BlockOnBelt(mass="2 kg")
    >>> check_fields(part)
    >>> print(part.mass)
    2.0
    """
    structure_of(part)
    bounds_checked(part)
    checked(part)


def bounds_checked(part: Any) -> None:
    """Raise SceneError for the first numeric field of a part, or of its laws, that is not finite or out of bounds."""
    for field in fields_of(type(part)):
        if is_nested(getattr(part, field.name)):
            bounds_checked(getattr(part, field.name))
    for field, number in _numbers(part):
        metadata = field.spec.metadata
        refuse(f"Argument `{field.name}` of {type(part).__name__}", number, metadata.get("unit", "1"), metadata)


def _numbers(part: Any) -> Iterator[tuple[_Field, Any]]:
    """(field, number) of every numeric field of a part itself, of a row each number."""
    for field in fields_of(type(part)):
        value = getattr(part, field.name)
        if field.numeric and value is not None and not is_nested(value):
            for number in value if isinstance(value, tuple) else (value,):
                yield field, number


def numbers_of(part: Any) -> list[float]:
    """Numeric fields of a part and of its laws, flattened in the order of the parameter vector."""
    out: list[float] = []
    for field in fields_of(type(part)):
        value = getattr(part, field.name)
        if is_nested(value):
            out.extend(numbers_of(value))
        elif field.numeric and value is not None:
            out.extend(value if isinstance(value, tuple) else (value,))
    return out


def _check_kind(part: Any, field: _Field, value: Any) -> None:
    """Raise SceneError where a field holds another kind of thing than it declares."""
    where = f"Argument `{field.name}` of {type(part).__name__}"
    if field.name == "name" and value is not None and not (isinstance(value, str) and value.isidentifier()):
        raise SceneError(f"{where} must be a word without dots, but it is {value!r}.")
    if value is None and field.optional:
        return
    if field.law and not isinstance(value, FrictionLaw):
        raise SceneError(f"{where} must be a friction law such as Coulomb(), but it is {value!r}.")
    holds, words = _KINDS.get(field.kind, (None, ""))
    if holds is not None and not holds(value):
        raise SceneError(f"{where} must be {words}, but it is {value!r}.")
    if not field.numeric:
        return
    if field.tuples and not isinstance(value, tuple):
        raise SceneError(f"{where} must be a row of numbers, but it is {value!r}.")
    if isinstance(value, tuple) and not field.tuples:
        raise SceneError(f"{where} must be one number in {field.spec.metadata.get('unit', '1')}, but it is {value!r}.")
    for number in value if isinstance(value, tuple) else (value,):
        if isinstance(number, bool) or not isinstance(number, (float, int, np.floating, np.integer)):
            raise SceneError(f"{where} must be a number in {field.spec.metadata.get('unit', '1')}, but it is {number!r}.")


def structure_of(part: Any) -> Any:
    """Everything about a part but its numbers, as a hashable key."""
    key: list[Any] = [type(part)]
    for field in fields_of(type(part)):
        value = getattr(part, field.name)
        _check_kind(part, field, value)
        if is_nested(value):
            key.append(structure_of(value))
        elif field.numeric and value is not None:
            key.append(len(value) if isinstance(value, tuple) else "number")
        else:
            key.append(value)
    try:
        hash(tuple(key))
    except TypeError:
        raise SceneError(f"The fields of {type(part).__name__} must be hashable: use tuples and frozen dataclasses.") from None
    return tuple(key)


def rebuilt(part: Any, values: Any, offset: int, number: Callable[[Any], Any] = float) -> Any:
    """Return the part with its numbers read from the parameter vector. number: function that turns an entry of the vector into a number."""

    def rebuild(node: Any) -> Any:
        nonlocal offset
        changes: dict[str, Any] = {}
        for field in fields_of(type(node)):
            value = getattr(node, field.name)
            if is_nested(value):
                changes[field.name] = rebuild(value)
            elif field.numeric and value is not None:
                if isinstance(value, tuple):
                    changes[field.name] = tuple(number(v) for v in values[offset : offset + len(value)])
                    offset += len(value)
                else:
                    changes[field.name] = number(values[offset])
                    offset += 1
        clone = copy.copy(node)  # not made anew: nobody typed these numbers, and nothing is left to convert
        for name, value in changes.items():
            object.__setattr__(clone, name, value)
        return clone

    return rebuild(part)


class Slot(NamedTuple):
    """A numeric field on its way into the parameter table."""

    owner: Any
    field_path: str
    spec: dataclasses.Field[Any]
    symbol: ca.SX
    size: int | None


def symbolic_copy(part: Any, path: str, slots: list[Slot]) -> Any:
    """A copy of a part (or law) whose numeric fields are symbols; fills `slots` in the order of the parameter vector."""
    clone = copy.copy(part)
    for field in fields_of(type(part)):
        value = getattr(part, field.name)
        here = f"{path}{field.name}"
        if is_nested(value):
            object.__setattr__(clone, field.name, symbolic_copy(value, here + ".", slots))
        elif field.numeric and value is not None:
            if isinstance(value, tuple):
                symbol = ca.SX.sym(here, len(value))
                slots.append(Slot(clone, here, field.spec, symbol, len(value)))
                object.__setattr__(clone, field.name, tuple(symbol[i] for i in range(len(value))))
            else:
                symbol = ca.SX.sym(here)
                slots.append(Slot(clone, here, field.spec, symbol, None))
                object.__setattr__(clone, field.name, symbol)
    return clone


def equations_of(symbolic: Component, signal: Callable[..., ca.SX], title: str) -> Equations:
    """Return the equations of a component on symbols. SceneError is raised if the equations decide or compute on numbers, or if a flow
    belongs to no state."""
    mode = ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(-1)  # numpy's sin of a symbol is casadi's, without a word about what may change
    try:
        equations = symbolic.equations(signal)
    except RecursionError as error:
        if not any("casadi" in frame.filename for frame in _last_frames(error, 20)):
            raise
        raise SceneError(
            f"The equations of {title} call a numpy function that is none of symbols (such as clip, dot, sum): use casadi's (fmin and fmax, mtimes, sum1)."
        ) from error
    except RuntimeError as error:
        if _last_frames(error, 1)[-1].name != "__bool__":
            raise
        raise SceneError(
            f"The equations of {title} decide in Python (`if`, `and`, `max`) on a number that is a symbol there: use fmin, fmax or an element, "
            "or declare what they decide on as int, str or bool."
        ) from error
    finally:
        ca.GlobalOptions.setNumpyMode(mode)
    if not isinstance(equations, Equations):
        raise SceneError(f"`{title}.equations` must return Equations, but it returned {type(equations).__name__}.")
    for variable in equations.flow:
        if not isinstance(variable, State):
            raise SceneError(f"The flow of {title} must map states made with `state(...)` to derivatives, but a key is {variable!r}.")
    for name, given in equations.outputs.items():
        if not (isinstance(given, tuple) and len(given) == 2 and isinstance(given[1], str)):
            raise SceneError(f"The signal `{name}` that {title} gives must be (expression, unit), but it is {given!r}.")
    return equations


def _last_frames(error: BaseException, count: int) -> Sequence[Any]:
    """Where an error came from, the innermost frame last."""
    import traceback  # here, because few programs need it

    return traceback.extract_tb(error.__traceback__, -count)


def governed(law: Any, owner: Any) -> bool:
    """Whether a law is this one, or has it as a field."""
    return law is owner or (
        dataclasses.is_dataclass(law) and any(governed(getattr(law, field.name), owner) for field in dataclasses.fields(law))
    )


def unit_at(element: Element, unit: str) -> str:
    """Return the unit of a field of a friction law in the element that uses the law. Laws are declared for one kind of motion and serve
    both."""
    if unit in ("m/s", "rad/s"):
        return element.slip_unit
    if unit in ("m", "1/m"):
        return unit.replace("m", element.slip_unit.removesuffix("/s"))
    if unit in ("s/m", "s/rad"):
        return {"m/s": "s/m", "rad/s": "s/rad"}.get(element.slip_unit, unit)
    if unit == "s2/m2" and element.slip_unit == "rad/s":
        return "s2/rad2"
    if unit in ("N", "N m"):  # of a law that is a force by itself, where the load is 1; under one that is computed it is a coefficient
        load = ca.SX(getattr(element, "load", 1.0))
        return element.force_unit if load.is_symbolic() or load.is_constant() else "1"
    return unit
