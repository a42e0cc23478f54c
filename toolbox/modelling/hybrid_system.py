"""The normal form of a plant: symbols, tables and casadi functions, shared by all plants of one structure."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from toolbox.arguments import mapping, refuse
from toolbox.errors import SceneError, suggest
from toolbox.files.unit_systems import asked_units, reading
from toolbox.files.units import in_si
from toolbox.modelling.components import Component, checked, numbers_of, rebuilt
from toolbox.modelling.elements import Element
from toolbox.modelling.switching import Switching, switching
from toolbox.vocabulary import Renamed


class Parameter(NamedTuple):
    """One entry of the parameter table: `size` is None for a scalar; `offset` points into the parameter vector."""

    name: str
    unit: str
    meaning: str
    size: int | None
    offset: int
    bounds: Mapping[str, float | None]

    def typed(self, value: Any) -> Any:
        """Return a typed value as numbers in SI. SceneError is raised for text that is no quantity of the unit."""
        return in_si(value, self.unit, self.name)

    def check(self, values: Any) -> None:
        """Raise SceneError unless every value is finite and within the declared bounds."""
        for value in values if isinstance(values, (tuple, list, np.ndarray)) else (values,):
            refuse(f"Argument `{self.name}`", value, self.unit, self.bounds)


class Input(NamedTuple):
    """A signal that nobody gives: its symbol, unit, and default as an expression of the parameters."""

    name: str
    symbol: ca.SX
    unit: str
    default: ca.SX


class SampledUpdate(NamedTuple):
    """A sampled law of a composed plant: its memory, the next memory, its outputs, and their places in the vector `held`.

    Attributes
    ----------
    memory, following
        Symbols of its states, and their values after the sample.
    outputs, names
        Expressions of its outputs, behind which the memory is repeated, and the names of the outputs alone.
    places
        {state of the memory: (first row, size or None)}.
    first_held
        Row of the vector `held` at which its outputs begin.
    from_callable
        Whether a Python callable computes the outputs.
    noise, channels
        Symbols of the noise of a sample, and the measured signals that they belong to.
    """

    memory: ca.SX
    following: ca.SX
    outputs: ca.SX
    names: tuple[str, ...]
    places: dict[str, tuple[int, int | None]]
    first_held: int
    from_callable: bool
    noise: ca.SX
    channels: tuple[str, ...]


class HybridSystem(Renamed):
    """Plant that `compose` makes of its parts: states, signals, inputs, parameters, and equations as casadi expressions.

    Attributes
    ----------
    t, x, u, p, F, m
        Casadi symbols: time, states, inputs, parameters, forces and modes.
    flow
        Expression of x' in these symbols.
    states
        {name: (first row of x, size or None for a scalar, unit)}.
    signals
        {name: (expression, unit)}.
    inputs
        {name: Input}, with the fields `name`, `symbol`, `unit` and `default` of an input.
    parameters
        {name: Parameter}, with the fields `name`, `unit`, `meaning`, `size` (None for a scalar), `offset` (first row of p)
        and `bounds` of a parameter.
    elements
        The elements with a mode: contacts, relays and switches. Their order is the order of the forces F and modes m.
    modeless
        {contact whose friction law has a memory: name of this law}. Such a contact has no modes.
    begin
        Default start values of the states, shape (n,): 0, or the values that a law with memory declares.
    values
        Declared parameter values, shape (n_p,).
    shared_modes
        {friction: (other friction, sign)} for two frictions that act on the same slip. Both have one mode. The sign is
        -1 if the slips have opposite signs.
    owners
        {state or element: index of the part to which it belongs}.
    held
        Symbols of the signals that sampled controllers hold.
    updates
        The updates of the sampled controllers.
    redirected_signals
        {signal used by the controllers: signal to which they are connected instead}.
    cache
        Results that are computed or compiled once for all plants with the same equations.
    typed_units
        {SI unit: unit that was typed} in the scene of the plant. None without a scene.
    parameter_check
        Function that raises SceneError for parameter values with which the forces of the plant cannot act. None if
        there is no such condition.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> print(rig.x.numel(), "states, inputs", *rig.inputs)
    3 states, inputs top.torque bit.weight
    """

    parts: tuple[Component, ...]
    values: np.ndarray
    t: ca.SX
    x: ca.SX
    u: ca.SX
    p: ca.SX
    F: ca.SX
    m: ca.SX
    flow: ca.SX
    states: dict[str, tuple[int, int | None, str]]
    signals: dict[str, tuple[ca.SX, str]]
    inputs: dict[str, Input]
    parameters: dict[str, Parameter]
    elements: tuple[Element, ...]
    modeless: Mapping[str, str]
    shared_modes: Mapping[str, tuple[str, ca.SX]] = MappingProxyType({})
    begin: np.ndarray
    stored: dict[str, ca.SX]
    losses: dict[str, ca.SX]
    supplies: dict[str, ca.SX]
    owners: dict[str, int]
    held: ca.SX
    updates: tuple[SampledUpdate, ...]
    redirected_signals: dict[str, str]
    cache: dict[Any, Any]
    typed_units: Mapping[str, str] | None = None
    parameter_check: Callable[[HybridSystem], None] | None = None

    @cached_property
    def _typed(self) -> Mapping[str, str]:
        return asked_units(fields=self.parts)

    @property
    def display_units(self) -> Mapping[str, str]:
        """Units of results about the plant, as {SI unit: unit that was typed}: the units of its scene, else of the fields of its parts."""
        return self._typed if self.typed_units is None else self.typed_units

    def __repr__(self) -> str:
        parts = ", ".join(type(part).__name__ for part in self.parts)
        contacts = ", ".join([*(element.name for element in self.elements), *self.modeless]) or "none"
        free = ", ".join(f"{i.name} [{i.unit}]" for i in self.inputs.values()) or "none"
        return f"HybridSystem({parts}): {self.x.numel()} states ({', '.join(self.states)}); contacts: {contacts}; inputs: {free}"

    def _repr_html_(self) -> str:
        from toolbox.files.printing import table  # here, because only notebooks need it

        rows = []
        for name, entry in self.parameters.items():
            factor, unit = reading(entry.unit, self.display_units)
            rows.append((name, _shown(factor * self.parameter(name)), "" if unit == "1" else unit, entry.meaning))
        return table(repr(self), ("parameter", "value", "unit", "meaning"), rows)

    @property
    def switched_equations(self) -> Switching:
        """Equations of the plant for given modes, as expressions of the symbols t, x, u, p and m.

        The modes m are numbers, so one set of expressions holds for all modes. The result is a named tuple of casadi
        columns. The columns that most users need are these:

        - `field`: the rates dx/dt of the states, in the order of `states`, shape (n, 1).
        - `force`, `static`, `slip` and `slip_rate`: force, largest force in stick, slip and rate of the slip of the
          elements, in the order of `elements`, shape (n_elements, 1).
        - `guards`: expressions that stay positive while the modes do not change. The first 2 n_elements entries are two
          guards for each element, in the order of `elements`.
        """
        return self.once("switching", lambda: switching(self.t, self.x, self.flow, self.elements))

    @property
    def rhs(self) -> ca.Function:
        """Casadi Function (t, x, u, p, m) -> dx/dt of the plant.

        t is the time [s], x the states, u the inputs, p the parameters and m the mode of each element. All are columns, in
        SI, in the order of `states`, `inputs`, `parameters` and `elements`. Modes of a contact: 0 stick, 1 slip in positive
        and -1 slip in negative direction. `element_modes` gives the names of the modes of any element.
        """
        return self.function("rhs", self.switched_equations.field, "dx")

    @property
    def force_function(self) -> ca.Function:
        """Casadi Function (t, x, u, p, m) -> forces of the elements.

        t is the time, x the states, u the inputs, p the parameters and m the modes. All are columns in SI.
        """
        return self.function("forces", self.switched_equations.force, "F")

    @property
    def slip_function(self) -> ca.Function:
        """Casadi Function (t, x, u, p, m) -> slip speeds of the elements.

        t is the time, x the states, u the inputs, p the parameters and m the modes. All are columns in SI.
        """
        return self.function("slips", ca.densify(self.switched_equations.slip), "v")

    @property
    def input_defaults(self) -> ca.Function:
        """Casadi Function p -> default values of the inputs, with the parameters p. Both are columns in SI."""

        def made() -> ca.Function:
            defaults = ca.vertcat(ca.SX(0, 1), *[entry.default for entry in self.inputs.values()])
            return ca.Function("input_defaults", [self.p], [ca.densify(defaults)], ["p"], ["u"])

        return self.once("input_defaults", made)

    def function(self, name: str, expression: ca.SX, output: str) -> ca.Function:
        """Return the casadi Function (t, x, u, p, m) -> expression.

        The arguments are time, states, inputs, parameters and modes, as columns in SI. The Function is kept under its
        name: a second call with the same name, on this plant or on a plant with the same equations, returns the first
        Function.

        Parameters
        ----------
        name
            Name of the function.
        expression
            The expression in the symbols t, x, u, p and m.
        output
            Name of the output of the function.
        """
        symbols, names = [self.t, self.x, self.u, self.p, self.m], ["t", "x", "u", "p", "m"]
        return self.once(name, lambda: ca.Function(name, symbols, [ca.densify(expression)], names, [output]))

    def once(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return a result that is computed once and shared by all plants with the same equations.

        Parameters
        ----------
        key
            Key of the result in the cache.
        make
            Function without arguments that computes the result if it is not in the cache.
        """
        if key not in self.cache:
            self.cache[key] = make()
        return self.cache[key]

    def to_casadi(self) -> dict[str, ca.SX]:
        """Return the plant as a casadi description {"t", "x", "u", "p", "ode"} for other casadi tools.

        The entry "p" is a vector of the parameters followed by the modes of the elements.
        """
        return {"t": self.t, "x": self.x, "u": self.u, "p": ca.vertcat(self.p, self.m), "ode": self.switched_equations.field}

    def __copy__(self) -> HybridSystem:
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        return twin

    def state_index(self, name: str) -> tuple[int, int | None, str] | None:
        """Return (first row of x, size, unit) of a state, or of one entry of a vector state such as `chain.speed.0`.

        The size is the number of entries of a vector state. It is None for a scalar state and for one entry of a vector
        state. For a name that is neither a state nor an entry, return None in place of the tuple.

        Parameters
        ----------
        name
            Name of the state or entry.
        """
        if not isinstance(name, str):
            return None
        if name in self.states:
            return self.states[name]
        head, _, tail = name.rpartition(".")
        if head in self.states and tail.isdigit() and int(tail) < (self.states[head][1] or 0):
            return self.states[head][0] + int(tail), None, self.states[head][2]
        return None

    def has_signal(self, name: object) -> bool:
        """Return True if the name is a signal, an input, or one entry of a vector state.

        Parameters
        ----------
        name
            The name, such as "bit.speed".
        """
        return isinstance(name, str) and (name in self.signals or name in self.inputs or self.state_index(name) is not None)

    def has_parameter(self, name: str) -> bool:
        """Return True if the name is a parameter, or one entry of a tuple of parameters.

        Parameters
        ----------
        name
            The name, such as "bit.weight".
        """
        head, _, tail = name.rpartition(".")
        return name in self.parameters or (head in self.parameters and tail.isdigit() and int(tail) < (self.parameters[head].size or 0))

    def unit(self, name: str) -> str:
        """Return the SI unit of a signal, an input or a parameter.

        Raises SceneError if the name is unknown.

        Parameters
        ----------
        name
            The name, such as "bit.speed". Or one entry of a state that is a vector, such as "chain.speed.0", or of a
            parameter that is a tuple, such as "chain.inertia.0". Entries are counted from 0.

        Returns
        -------
        str
            The unit, such as "rad/s". "1" for a quantity without a unit.
        """
        if isinstance(name, str) and self.has_signal(name):
            return self.signal_unit(name)
        if not isinstance(name, str) or not self.has_parameter(name):
            raise SceneError(
                f"There is no signal and no parameter `{name}`: {suggest(str(name), [*self.signals, *self.inputs, *self.parameters])}"
            )
        return self._parameter(name).unit

    def element(self, name: str) -> Element:
        """Return the element with this name: a contact, relay or switch, as an object such as `DryFriction`.

        Raises SceneError if there is no such element.

        Parameters
        ----------
        name
            Name of the element, such as "bit".
        """
        found = next((element for element in self.elements if element.name == name), None)
        if found is None:
            raise self.unknown_element_error(name)
        return found

    def element_modes(self, name: str) -> tuple[int, Mapping[int, str]]:
        """Return (index, names) for the mode of an element.

        `index` is the position of the mode of this element in the argument m (modes) of `rhs`. It equals the position
        of the element in the list `elements`. Exception: two frictions on the same slip share one mode, and the index
        of both is the position of the first friction.

        `names` maps the number of a mode to its name, such as {0: "stick", 1: "slip+", -1: "slip-"}.

        Parameters
        ----------
        name
            Name of the element. Raises SceneError if the plant has no element of this name.
        """
        element = self.element(name)
        names = [each.name for each in self.elements]
        if name not in self.shared_modes:
            return names.index(name), element.mode_names
        leader, sign = self.shared_modes[name]
        side = float(ca.Function("side", [self.p], [sign])(self.values))
        return names.index(leader), {int(side * mode): word for mode, word in element.mode_names.items()}

    def unknown_element_error(self, name: str) -> SceneError:
        """Make the SceneError for a name that is no element of the plant.

        The method returns the error and does not raise it. An element is a contact, relay or switch with a mode, such as
        "stick" or "slip+". A contact whose friction law has a memory has no modes, so it is no element. The message of
        the error says this, or suggests similar names.

        Parameters
        ----------
        name
            The name that was given.

        Returns
        -------
        SceneError
            The error, for `raise`.
        """
        if name in self.modeless:
            return SceneError(
                f"`{name}` has no modes and never sticks exactly, because its friction law, {self.modeless[name]}, has a memory: judge the severity of a "
                "speed, by `measure.severity` or in a `sweep`, and find where smooth running is lost by `hopf_points`."
            )
        return SceneError(f"There is no element `{name}`: {suggest(name, [element.name for element in self.elements])}")

    def signal_unit(self, name: str) -> str:
        """Return the unit of a signal, an input, or one entry of a vector state. Raises SceneError for any other name.

        Parameters
        ----------
        name
            The name, such as "bit.speed".
        """
        rows = self.state_index(name)
        if rows is not None:
            return rows[2]
        return self.signals[name][1] if isinstance(name, str) and name in self.signals else self._input(name).unit

    def expression(self, name: str) -> ca.SX:
        """Return a signal, an input, or one entry of a vector state as an expression in the symbols t, x, u, p, F and m.

        Raises SceneError if the name is unknown.

        Parameters
        ----------
        name
            The name, such as "bit.speed".
        """
        if isinstance(name, str) and name in self.signals:
            return self.signals[name][0]
        rows = self.state_index(name)
        return self._input(name).symbol if rows is None else self.x[rows[0]]

    def substitute_forces(self, expression: ca.SX) -> ca.SX:
        """Return an expression in which the symbols F are replaced by the forces as functions of t, x, u, p and m.

        Parameters
        ----------
        expression
            Casadi expression in the symbols of the plant.
        """
        return ca.substitute(expression, self.F, self.switched_equations.force) if self.elements else expression

    def input(self, name: str) -> Input:
        """Return the description of an input of the plant: its symbol, unit and default.

        Raises SceneError if there is no such input.

        Parameters
        ----------
        name
            Name of the input, such as "top.torque".

        Returns
        -------
        Input
            Named tuple of `name`, `symbol` (casadi symbol, an entry of the column u), `unit` (SI unit, such as "N m") and
            `default` (casadi expression in the parameters p: the value if a run does not give the input).
        """
        if name in self.inputs:
            return self.inputs[name]
        if name in self.signals:
            raise SceneError(f"Argument `{name}` must not be an input: a part of the plant gives this signal.")
        raise SceneError(f"There is no input `{name}`: {suggest(name, self.inputs)}")

    def _input(self, name: str) -> Input:
        if not isinstance(name, str) or name not in self.inputs:
            raise SceneError(f"There is no signal `{name}`: {suggest(name, [*self.signals, *self.inputs])}")
        return self.inputs[name]

    def parameter(self, name: str) -> Any:
        """Return the declared value of a parameter in SI: a float, or an array for a tuple. Raises SceneError if the name is unknown.

        Parameters
        ----------
        name
            Name of the parameter, such as "bit.radius", or of a tuple of parameters, such as "chain.inertia".
        """
        entry = self._parameter(name)
        if entry.size is None:
            return float(self.values[entry.offset])
        return self.values[entry.offset : entry.offset + entry.size].copy()

    def _parameter(self, name: str) -> Parameter:
        if not isinstance(name, str):
            raise SceneError(f"The name of a parameter must be a string, but it is {name!r}.")
        entry = self.parameters.get(name)
        if entry is not None:
            return entry
        if self.has_parameter(name):
            head, _, tail = name.rpartition(".")
            whole = self.parameters[head]
            return whole._replace(name=name, size=None, offset=whole.offset + int(tail))
        raise SceneError(f"There is no parameter `{name}`: {suggest(name, self.parameters)}")

    def with_parameters(self, values: Mapping[str, Any]) -> HybridSystem:
        """Return a copy of the plant with other values of some parameters.

        Parameters are symbols in the equations. The copy therefore has the same equations, and nothing is compiled again:
        functions that were compiled for this plant are also used for the copy, with the other values as arguments.

        Parameters
        ----------
        values
            {parameter: value in SI, or text with a unit}. Parameters that are left out keep their values.

        Returns
        -------
        HybridSystem
            The copy. This plant does not change.

        Raises
        ------
        SceneError
            If a name is unknown or a value is out of its bounds.
        """
        changed = copy.copy(self)
        changed.values = self.values.copy()
        for name, value in mapping("parameters", values).items():
            entry = self._parameter(name)
            if isinstance(value, np.ndarray) and not value.ndim:
                value = value.item()
            value = entry.typed(value)
            entry.check(value)
            if entry.size is None:
                if np.ndim(value):
                    raise SceneError(f"Argument `{name}` must be one number in {entry.unit}, but it is {value!r}.")
                changed.values[entry.offset] = value
            else:
                array = np.asarray(value, float)
                if array.shape != (entry.size,):
                    raise SceneError(f"Argument `{name}` must have shape ({entry.size},), but it has {array.shape}.")
                changed.values[entry.offset : entry.offset + entry.size] = array
        changed.parts = tuple(rebuilt(part, changed.values, offset) for part, offset in zip(self.parts, self._offsets(), strict=True))
        for part in changed.parts:
            checked(part)
        if self.parameter_check is not None:
            self.parameter_check(changed)
        return changed

    def with_time_varying(self, names: Sequence[str]) -> HybridSystem:
        """Return the plant with some scalar parameters turned into inputs of the same names, for changes in time during a run.

        An example is rock that becomes harder with depth.

        Parameters
        ----------
        names
            Names of the parameters.

        Raises
        ------
        SceneError
            If a name is unknown or a tuple, or if the stored energy depends on the parameter. A spring or an inertia
            that changes in time does work that no part would account for.
        """
        if isinstance(names, str) or not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
            raise SceneError(f"Argument `names` must be names of parameters, but it is {names!r}.")
        released = copy.copy(self.once(("varying", *names), lambda: self._released([self._parameter(name) for name in names])))
        released.parts, released.values = self.parts, self.values
        return released

    def _released(self, entries: Sequence[Parameter]) -> HybridSystem:
        symbols = []
        for entry in entries:
            if entry.size is not None:
                raise SceneError(
                    f"Argument `{entry.name}` must be one number to vary in time, but it has {entry.size} entries: name one, `{entry.name}.0`."
                )
            for part, energy in self.stored.items():
                if ca.depends_on(energy, self.p[entry.offset]):
                    raise SceneError(f"Argument `{entry.name}` must not vary in time: the energy stored in `{part}` depends on it.")
            symbols.append(ca.SX.sym(entry.name))
        constants = [self.p[entry.offset] for entry in entries]

        def of_time(expression: ca.SX) -> ca.SX:
            return ca.substitute(expression, ca.vertcat(*constants), ca.vertcat(*symbols))

        twin = self.mapped(of_time)
        inputs = {entry.name: Input(entry.name, s, entry.unit, c) for entry, s, c in zip(entries, symbols, constants, strict=True)}
        twin.inputs = {**self.inputs, **inputs}
        twin.u = ca.vertcat(self.u, *symbols)
        twin.parameters = self.parameters | {entry.name: entry for entry in entries}
        return twin

    def mapped(self, change: Callable[[ca.SX], ca.SX]) -> HybridSystem:
        """Return a copy of the plant in which a function has changed every expression. The copy is not compiled.

        Parameters
        ----------
        change
            Function expression -> changed expression.
        """
        twin = copy.copy(self)
        twin.flow, twin.elements = change(self.flow), tuple(element.mapped(change) for element in self.elements)
        twin.signals = {name: (change(expression), unit) for name, (expression, unit) in self.signals.items()}
        for kind in ("stored", "losses", "supplies"):
            setattr(twin, kind, {name: change(expression) for name, expression in getattr(self, kind).items()})
        twin.updates = tuple(each._replace(following=change(each.following), outputs=change(each.outputs)) for each in self.updates)
        twin.cache, twin.parameter_check = {}, None
        return twin

    def _offsets(self) -> Iterator[int]:
        offset = 0
        for part in self.parts:
            yield offset
            offset += len(numbers_of(part))


def _shown(value: Any) -> Any:
    """The value of a parameter as a cell of a table; of a long row the ends."""
    if np.ndim(value) == 0:
        return value
    words = [f"{entry:.6g}" for entry in value]
    return ", ".join(words if len(words) <= 6 else [*words[:3], "...", words[-1]]) + (f" ({len(words)} values)" if len(words) > 6 else "")


def checked_plant(given: Any, argument: str = "plant") -> HybridSystem:
    """What is given as a plant; raises SceneError with the name of the argument for anything else. A `machine` could have been a Scene, too."""
    if not isinstance(given, HybridSystem):
        wanted = "a plant made by `compose`" + (" or a Scene" if argument == "machine" else "")
        kind = type(given).__name__
        hint = f": `compose({kind}(...))`" if isinstance(given, Component) else ""
        hint = ", which runs its cases itself: `scene.run(label)`" if hasattr(given, "cases") else hint
        raise SceneError(f"Argument `{argument}` must be {wanted}, but it is a {kind}{hint}.")
    return given
