"""The closed loop: a plant, the laws that act on it, and what acts on both. Every verb takes one.

    loop = closed_loop(rig, SoftTorque(reference="45 rpm"), sample_time="10 ms", inputs={...}, parameters={...}, start={...})
    simulate(loop, "200 s");  onset(loop, "top.reference", ("30 rpm", "130 rpm"));  margins(loop);  print(loop)

A law is designed once, on the nominal plant; parameters and perturbations change the plant only, so that robustness is real. A loop never changes: `at`
and `closed_loop(loop, ...)` give another one.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import pickle
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Concatenate, ParamSpec, TypeVar

import casadi as ca
import numpy as np

from toolbox.arguments import mapping, number
from toolbox.errors import SceneError, suggest
from toolbox.files.printing import Printed
from toolbox.files.unit_systems import asked_units
from toolbox.files.units import NumberOrText, in_si
from toolbox.modelling.closing import Closed, closed_system, described, designed_laws, laws_of
from toolbox.modelling.components import law_of, structure_of
from toolbox.modelling.hybrid_system import HybridSystem, checked_plant
from toolbox.modelling.input_kinds import ExpressionKey, extremes, input_kinds
from toolbox.modelling.inputs import Table
from toolbox.modelling.laws import Controller, Sampled
from toolbox.modelling.number_kinds import former_name
from toolbox.modelling.numbers import Number, number_of, numbers_in
from toolbox.modelling.numbers_in_words import given_as, numbers_of
from toolbox.modelling.regularisation import SmoothSystem, smoothed
from toolbox.modelling.steady_point import Equilibrium
from toolbox.vocabulary import new_names_only, refuse_former_names


@dataclass(frozen=True, eq=False)
class ClosedLoop(Printed):
    """Plant with its controllers, inputs, parameters and start values.

    The function `closed_loop` makes a loop. All functions that simulate or analyse take a loop, and `print` shows the
    numbers of its controllers. Two loops are equal if their plants, controllers and numbers are equal. A Python
    function in a loop, such as a callable controller, equals only itself.

    Attributes
    ----------
    plant
        The declared plant, on which the controllers are designed.
    controllers
        The controllers in the given order. A `Controller` acts continuously. A `Sampled` has its own period, delay,
        sensors and seed.
    inputs
        {input, or parameter of the plant that changes in time: number, table, shape or expression of time}.
    parameters
        {parameter of the plant or of a controller: value}.
    start
        {state: start value}. All other states start at 0.
    label
        Name of the loop in tables and figures.
    element, signal
        Names of the contact whose stick phases are counted, and of the speed that is measured. None means the only
        contact of the plant and its speed.
    duration, after, accuracy
        Length of a run [s], time from which on a run is judged [s], and target for the global error of a run [1]. None
        for a loop that does not come from a scene file.
    effort
        Name of the input whose peak is reported. None for a loop that does not come from a scene file.
    reference
        Set-point of `signal`: a number, or the name of the input that gives the set-point. None: the set-point of the
        controller, if there is one.
    standstill_speed
        For a machine that is stopped, the value of `signal` at which it counts as standing. None for no stop.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> print(loop.number("bit.weight").value, "N")
    97000.0 N
    """

    plant: HybridSystem
    controllers: tuple[Any, ...] = ()
    inputs: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    start: Mapping[str, Any] = field(default_factory=dict)
    label: str = ""
    element: str | None = None
    signal: str | None = None
    duration: float | None = None
    after: float | None = None
    accuracy: float | None = None
    effort: str | None = None
    reference: float | str | None = None
    standstill_speed: float | None = None

    # ------------------------------------------------------------------------------------------------------------------------------ what it becomes
    @cached_property
    def assembly(self) -> Closed:
        """Plant and controllers joined to one system, with the sample times of the controllers.

        Raises SceneError for numbers out of bounds, unknown names, and controllers that do not fit the plant.
        """
        own = {name: value for name, value in self.parameters.items() if self.plant.has_parameter(name)}
        both = next((name for name in self.parameters if name in self.inputs), None)
        if both is not None:
            raise SceneError(f"Argument `{both}` must be given in `inputs` or in `parameters`, but it is in both.")
        plant = self.plant.with_parameters(own) if own else self.plant
        declared, sharp = (each.sharp if isinstance(each, SmoothSystem) else each for each in (self.plant, plant))
        found = closed_system(declared, sharp, self.controllers, self.designed_controllers)
        system = found.system
        if len(own) < len(self.parameters):
            system = system.with_parameters({name: value for name, value in self.parameters.items() if name not in own})
        changing = [name for name in self.inputs if not system.has_signal(name) and declared.has_parameter(name)]
        return found._replace(system=system.with_time_varying(changing) if changing else system, plant=plant)

    @cached_property
    def designed_controllers(self) -> list[Any]:
        """The controllers as designed on the declared plant, in the order of `controllers`."""
        return designed_laws(self.plant, self.controllers)

    def replace(self, **changes: Any) -> ClosedLoop:
        """Return a loop with other values of some fields. A controller that is not replaced keeps its design.

        Parameters
        ----------
        changes
            {field: new value}. The field is an attribute of `ClosedLoop`, such as `inputs`.
        """
        other = dataclasses.replace(self, **changes)
        if "designed_controllers" in self.__dict__ and not {"plant", "controllers"} & changes.keys():
            other.__dict__["designed_controllers"] = self.designed_controllers
        return other

    @cached_property
    def _given(self) -> tuple[tuple[tuple[str, Any], ...], dict[str, Any], dict[str, Any]]:
        kinds, values, typed = input_kinds(self.assembly.system, self.inputs)
        changing = [name for name in values if self.plant.has_parameter(name) and not self.plant.has_signal(name)]
        for extreme in (min, max):  # what parts demand of their fields must hold where all are lowest, and where all are highest
            ends = {name: extreme(extremes(values[name])) for name in changing if extremes(values[name])}
            if ends:
                self.assembly.plant.with_parameters(ends)
        return kinds, values, typed

    @property
    def input_kinds(self) -> tuple[tuple[str, Any], ...]:
        """Kinds of the inputs, as pairs (name of the input, kind), in the order of the names.

        A kind is "number", "table" for a table (times, values), (name, number of coefficients) for a `Shape` such as
        `toolbox.sine(...)`, or a key of the expression for an expression of time. If the kind of an input changes, the loop
        is compiled again. A new value of the same kind needs no compilation.
        """
        return self._given[0]

    @property
    def input_values(self) -> dict[str, Any]:
        """Checked values of the inputs as {input: value}. A value is a float, a `Table`, a `Shape` or an expression of time."""
        return self._given[1]

    @cached_property
    def system(self) -> HybridSystem:
        """The plant with its controllers as parts, in the form that is simulated.

        A sampled controller has its memory and its held signals. A plant made by `smoothed` has its regularised
        friction.
        """
        system, plant = self.assembly.system, self.assembly.plant
        return smoothed(system, plant.widths, match_static_peak=plant.match_static_peak) if isinstance(plant, SmoothSystem) else system

    @cached_property
    def continuous_loop(self) -> ClosedLoop:
        """Return the same loop with every controller in its continuous form, also if it runs sampled.

        Raises SceneError for a controller without a continuous form, such as a Python callable.
        """
        inner = tuple(law.law if isinstance(law, Sampled) else law for law in self.controllers)
        for law in inner:
            if not isinstance(law, Controller):
                raise SceneError(f"Argument `controller` must be a Controller with a continuous form, but it is {law!r}.")
        return self if inner == self.controllers else self.with_controllers(inner)

    def unsampled(self) -> ClosedLoop:
        """Return the loop itself if no controller is sampled.

        Raises SceneError if a controller is sampled, because its sample time would be ignored in the continuous form.
        """
        if self.is_sampled:
            raise SceneError(
                "Argument `loop` must have continuous controllers, but one is sampled, and its sample time and delay would be left out: "
                "give `loop.continuous_loop` for the limit of fast sampling, or use `onset` or `margins`, which include sampling."
            )
        return self.continuous_loop

    def with_controllers(self, controllers: Iterable[Any]) -> ClosedLoop:
        """Return the loop with its controllers in another form, such as sampled or with sensors. The controllers are not designed again.

        Parameters
        ----------
        controllers
            The controllers in their new form, in the order of the present controllers.
        """
        other = dataclasses.replace(self, controllers=tuple(controllers))
        other.__dict__["designed_controllers"] = self.designed_controllers
        return other

    @property
    def without_controllers(self) -> ClosedLoop:
        """The loop without its controllers, with the inputs and parameters that belong to the plant."""
        own = {name: value for name, value in self.parameters.items() if self.plant.has_parameter(name)}
        inputs = {name: value for name, value in self.inputs.items() if name in self.plant.inputs or self.plant.has_parameter(name)}
        return dataclasses.replace(self, controllers=(), parameters=own, inputs=inputs)

    @property
    def is_sampled(self) -> bool:
        """Whether a controller of the loop is sampled."""
        return any(isinstance(law, Sampled) for law in self.controllers)

    @property
    def depends_on_time(self) -> bool:
        """Whether time appears explicitly in the equations of the plant or of a controller, apart from the inputs.

        For a controller written in Python this cannot be determined, so such a controller is ignored.
        """
        laws = [each for update in self.system.updates for each in (update.following, update.outputs)]
        return bool(ca.depends_on(ca.vertcat(self.system.switched_equations.field, *laws), self.system.t))

    def constant_inputs(self, function: str) -> dict[str, float]:
        """Return the inputs as {input: number}.

        Parameters
        ----------
        function
            Name of the function that needs constant inputs, for the error message.

        Raises
        ------
        SceneError
            If an input varies in time.
        """
        moving = next((name for name, value in self.input_values.items() if not isinstance(value, float)), None)
        if moving is not None:
            raise SceneError(
                f"Argument `{moving}` must be a number for {function}, but the loop varies it in time: give `loop.at({moving!r}, value)`, "
                f"or on the command line `--hold {moving}=VALUE`."
            )
        return dict(self.input_values)

    def target(self, signal: str) -> float | None:
        """Return the set-point of a signal in SI, from the field `reference`. Returns None if `reference` is None.

        Parameters
        ----------
        signal
            Name of the signal, such as "top.speed". If the set-point was given as text, its unit must fit the unit of
            this signal.
        """
        if isinstance(self.reference, str) and self.reference in self.variable_numbers():
            return self.number(self.reference).value
        return None if self.reference is None else number("reference", self.reference, self.system.signal_unit(signal))

    @cached_property
    def display_units(self) -> Mapping[str, str]:
        """{SI unit: unit that was typed}: the units of reports and figures about this loop."""
        return {**self.plant.display_units, **asked_units(self.inputs, self.parameters, fields=(self.controllers,))}

    @property
    def title(self) -> str:
        """Label of the loop, or the classes of its parts if it has no label."""
        kinds = [type(law_of(part)).__name__ for part in self.plant.parts]
        return self.label or ", ".join([*kinds, *(described(law).partition(",")[0] for law in self.controllers)])

    # -------------------------------------------------------------------------------------------------------------------------------------- numbers
    def variable_numbers(self) -> dict[str, Number]:
        """Return all numbers of the loop whose values can be changed, as {name: number}.

        These are the parameters of plant and controllers, inputs, start values, and sample time and delay of sampled
        controllers. A number has a unit, bounds and a value and, if an input overrides it, the name of this input.
        """
        return numbers_in(self)

    @cached_property
    def overriding_inputs(self) -> dict[str, str]:
        """{parameter that has no effect: input that overrides this parameter}."""
        scalars = [name for name, entry in self.system.parameters.items() if entry.size is None]
        known = [(name, number_of(self, name)) for name in scalars]
        return {name: number.overridden for name, number in known if number is not None and number.overridden is not None}

    def number(self, name: str) -> Number:
        """Return the description (value, unit, bounds) of one number of the loop, such as a parameter, an input or a
        start value.

        The result is a `Number` with the attributes `name`, `unit` (SI), `value` (in SI, nan for an input that varies in
        time), `meaning`, `bounds` and `typical_range`. `overridden` is the name of the input that replaces the number, so
        that the number has no effect, else None.

        Parameters
        ----------
        name
            Name of the number. The end of the name is enough if no other name has the same end: `proportional` for
            `pi.proportional`.

        Raises
        ------
        SceneError
            If the name is unknown; the message lists the most similar names. Also if several names have this end.
        """
        found = number_of(self, name)
        if found is not None:
            return found
        if not isinstance(name, str):
            raise SceneError(f"Argument `parameter` must be the name of a number of the loop, but it is {name!r}.")
        if (now := former_name(self, name)) is not None:
            raise SceneError(f"The number `{name}` is named `{now}` now.")
        known = self.variable_numbers()
        ending = [each for each in known if each.endswith(f".{name}")]
        if len(ending) == 1:
            return known[ending[0]]
        if ending:
            raise SceneError(f"Argument `{name}` must name one number, but {', '.join(f'`{each}`' for each in ending)} end so.")
        if name.endswith(".reference") and not any(each.endswith(".reference") for each in known):
            raise SceneError(
                f"There is no number `{name}`: a set-point belongs to a control law, and there is none: give one (a scene: `[[controllers]]`, `--law`)."
            )
        listed = [each for each in known if each.startswith(f"{name}.") and each[len(name) + 1 :].isdigit()]
        if listed:
            raise SceneError(f"Argument `{name}` must be one number, but it has {len(listed)} entries: name one, e.g. `{listed[0]}`.")
        raise SceneError(f"There is no number `{name}` in this loop: {suggest(name, known)}")

    def varied_number(self, name: str) -> Number:
        """Return a number that is to be varied, with its value, unit and bounds. SceneError is raised if the number has no effect.

        Parameters
        ----------
        name
            Name of the number, such as "bit.weight". The end of the name is enough if no other name has the same end:
            `proportional` for `pi.proportional`.

        Raises
        ------
        SceneError
            If the name is unknown, or if an input overrides the number, so that a change would have no effect.
        """
        number = self.number(name)
        if number.overridden is not None:
            raise SceneError(f"Argument `{name}` must have an effect to be varied, but {why_without_effect(self, number.overridden)}.")
        return number

    def differentiable_number(self, name: str, function: str, allowed: Callable[[Number], bool] = lambda number: False) -> Number:
        """Return the description of one number (value, unit, bounds) for a function that needs derivatives.

        Such a number is an input, or a parameter of the equations.

        Parameters
        ----------
        name
            Name of the number, such as "bit.weight". The end of the name is enough if no other name has the same end:
            `proportional` for `pi.proportional`.
        function
            Name of the function that needs derivatives, for the error message.
        allowed
            Function number -> bool. Numbers of other kinds are allowed, too, if this function returns True for them. By
            default no other kind is allowed.

        Raises
        ------
        SceneError
            If the number is neither an input nor a parameter of the equations, and `allowed` returns False for it.
        """
        number = self.varied_number(name)
        if not (number.kind.has_slope or allowed(number)):
            raise SceneError(f"Argument `{name}` must be an input or a parameter for `{function}`, but {number.kind.why}.")
        if np.isnan(number.value):
            raise SceneError(
                f"Argument `{name}` must be a constant input for `{function}`, but it varies in time: give `loop.at({name!r}, value)` or name a number of it."
            )
        return number

    def at(self, name: str, value: NumberOrText) -> ClosedLoop:
        """Return the loop with another value of one number.

        The value is changed where the number acts in the loop, and designed gains stay as they are. If only the design
        of a controller uses the number, this controller is designed again.

        Parameters
        ----------
        name
            Name of the number, such as "bit.weight": a key of `variable_numbers()`.
        value
            Its value in SI, or text with a unit.

        Raises
        ------
        SceneError
            If there is no such number, or the value is out of its bounds.
        """
        return self.number(name).put(self, value)

    def with_parameters(self, given: Mapping[str, Any] | None) -> ClosedLoop:
        """Return the loop with other values of parameters.

        Parameters
        ----------
        given
            {parameter: value in SI, or text with a unit}. A key may name a whole tuple, such as "chain.inertia": its
            value is then the tuple of all entries, such as (2122, 374). A key may also name a field that only the
            design of a controller uses.

        Raises
        ------
        SceneError
            If a name is unknown, or a value is out of its bounds.
        """
        loop, values = self, dict(self.parameters)
        for name, value in mapping("parameters", given).items():
            number = None if self.plant.has_parameter(name) else number_of(self, name)
            if number is None and (now := former_name(self, name)) is not None:
                raise SceneError(f"The number `{name}` is named `{now}` now.")
            if number is not None and number.kind.redesigns:
                loop = number.put(loop, value)
            else:
                # a law may take the place of an input and its default
                owner = self.plant if self.plant.has_parameter(name) else self.system
                values[name] = in_si(value, owner._parameter(name).unit, name)
        return loop.replace(parameters=values)

    # --------------------------------------------------------------------------------------------------------------------------------- as a value
    @cached_property
    def _key(self) -> tuple[Any, ...]:
        plant = self.plant.sharp if isinstance(self.plant, SmoothSystem) else self.plant
        smooth = (tuple(self.plant.widths.items()), self.plant.match_static_peak) if isinstance(self.plant, SmoothSystem) else None
        inputs = tuple(sorted((name, _plain(value)) for name, value in self.input_values.items()))
        numbers = tuple(tuple(sorted((name, _plain(value)) for name, value in given.items())) for given in (self.parameters, self.start))
        named = tuple(getattr(self, each.name) for each in dataclasses.fields(self)[5:])  # what a scene says
        return tuple(map(structure_of, plant.parts)), plant.values.tobytes(), smooth, self.controllers, inputs, numbers, named

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, ClosedLoop) and self._key == other._key)

    def __hash__(self) -> int:
        return hash((self._key[:3], self._key[4:]))

    def __getstate__(self) -> dict[str, Any]:
        state = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        for words, things in (("law", self.controllers), ("input", self.inputs.items()), ("start value", self.start.items())):
            for thing in things:
                try:
                    pickle.dumps(thing)
                except Exception as error:  # whatever an object that holds a lock, a lambda or a casadi expression raises
                    raise pickle.PicklingError(f"The {words} {thing!r} of the loop cannot be pickled: {error}") from None
        return state

    def __str__(self) -> str:
        plant = ", ".join(type(law_of(part)).__name__ for part in self.plant.parts)
        lines = [f"Closed loop{' ' + repr(self.label) if self.label else ''}: {plant}" + ("" if self.controllers else ", no law")]
        lines += [f"  {each}" for each in self.controller_names]
        for word, given in (("inputs", self.inputs), ("parameters", self.parameters), ("start", self.start)):
            if given:
                lines.append(f"  {word}: " + ", ".join(f"{name} {self._read(name, value)}" for name, value in given.items()))
        without_effect = {name: why_without_effect(self, taking).replace("`", "") for name, taking in self.overriding_inputs.items()}
        lines += [f"  the parameter {name} has no effect: {why}" for name, why in without_effect.items()]
        return "\n".join(lines)

    __repr__ = __str__

    @property
    def controller_names(self) -> list[str]:
        """Description of each controller as text: its sample time and its numbers as designed on this plant, in the units that were typed."""
        laws = zip(self.controllers, map(law_of, self.assembly.system.parts[len(self.assembly.plant.parts) :]), strict=True)
        known = [
            (given, law if isinstance(law, Controller) else getattr(given, "law", None)) for given, law in laws
        ]  # in Python: as it was given
        return [
            described(given) + (f": {numbers_of(law, self.display_units)}" if isinstance(law, Controller) else "") for given, law in known
        ]

    def _read(self, name: str, value: Any) -> str:
        told = given_as(value, self.system.unit(name), self.display_units)
        return told or ("in time" if name in self.inputs else str(value))


def why_without_effect(loop: ClosedLoop, overriding: str) -> str:
    """Return the reason why a parameter has no effect, and its remedy: an input of this name overrides it, or a controller gives this signal."""
    if overriding in loop.system.inputs:
        return f"the input `{overriding}` overrides it (vary `{overriding}`)"
    return f"a controller gives the signal `{overriding}` (vary a number of the controller)"


@new_names_only
def closed_loop(
    plant: HybridSystem | ClosedLoop,
    controller: Any = None,
    *,
    sample_time: NumberOrText | None = None,
    inputs: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    start: Mapping[str, Any] | Equilibrium | None = None,
    element: str | None = None,
    signal: str | None = None,
    reference: NumberOrText | None = None,
    label: str | None = None,
) -> ClosedLoop:
    """Join a plant with its controllers, inputs, parameters and start values to a closed loop.

    All functions that simulate or analyse take this loop.

    Parameters
    ----------
    plant
        A plant made by `compose`. Or a loop: the new loop keeps everything of this loop that no argument replaces.
    controller
        A `Controller`, a callable (t, y) -> u, `Sampled(controller, period, delay)`, or a sequence of them. By default
        the loop has no controller: the inputs alone drive the plant.
    sample_time
        Sample time [s] of controllers that are not `Sampled` themselves. By default a `Controller` acts continuously.
    inputs
        {signal, or parameter of the plant that changes in time: value}. A value is a number, text with a unit, a table
        (times, values), a shape such as `toolbox.sine(...)`, or a casadi expression of `toolbox.time`. By default every
        input has the default value of its part.
    parameters
        {parameter of the plant, or number of a controller: value}, by default none. Controllers keep the design that
        they have on the plant with its own values.
    start
        {state, or signal that is a state: start value}. All other states start at 0 (by default all states). Or an
        `Equilibrium`, whose states are used.
    element, signal
        Names of the contact whose stick phases are counted, and of the speed that is measured. By default the only
        contact and its speed.
    reference
        Value that the speed `signal` is to reach, a number in SI, text with a unit, or the name of an input. By default
        the set-point of the controller.
    label
        Name of the loop in tables and figures. By default the classes of its parts.

    Returns
    -------
    ClosedLoop
        The loop. `print` shows it.

    Raises
    ------
    SceneError
        If a name is unknown, a number is out of bounds, or a controller does not fit the plant.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> print(closed_loop(rig, Sampled(SoftTorque(reference="60 rpm"), "10 ms", delay="30 ms")))
    Closed loop: TorsionalChain, BitRock
      SoftTorque, sampled every 10 ms with a delay of 30 ms: proportional 420.6 N m s/rad, integral 2684 N m/rad, reference 60 rpm
    """
    base = as_loop(plant, "plant")
    named = {"element": element, "signal": signal, "reference": reference, "label": label}
    changes: dict[str, Any] = {word: given for word, given in named.items() if given is not None}
    if controller is not None or sample_time is not None:
        changes["controllers"] = laws_of(controller if controller is not None else base.controllers, in_si(sample_time, "s", "sample_time"))
    if start is not None:
        changes["start"] = states_of(start, base.plant)
    if inputs is not None or parameters is not None:
        others = mapping("parameters", parameters)
        changes["inputs"] = {name: value for name, value in base.inputs.items() if name not in others} | mapping("inputs", inputs)
    loop = base.replace(**changes).with_parameters(parameters)
    return loop.replace(inputs=loop._given[2])  # what is wrong is said here


def as_loop(given: Any, argument: str = "loop") -> ClosedLoop:
    """What is given as a loop, or as a bare plant; raises SceneError with the name of the argument for anything else."""
    return given if isinstance(given, ClosedLoop) else ClosedLoop(checked_plant(given, argument))


Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

FORMER = (
    {"controller": "law"}
    | {word: f"{word}=..." for word in ("sample_time", "inputs", "parameters", "start", "element", "signal")}
    | {"target": "reference=..."}
)
"""{argument that verbs took before they took a loop: how `closed_loop` takes it}."""


def takes_loop(
    verb: Callable[Concatenate[ClosedLoop, Arguments], Result],
) -> Callable[Concatenate[ClosedLoop | HybridSystem, Arguments], Result]:
    """Let a verb take a bare plant in place of a loop, and say how a call is written whose arguments belong to the loop."""
    own = inspect.signature(verb).parameters
    first = next(iter(own))

    @functools.wraps(verb)
    def taking(machine: ClosedLoop | HybridSystem, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        refuse_former(verb.__name__, machine, [word for word in kwargs if word not in own])
        return verb(as_loop(machine, first), *args, **kwargs)

    return taking


def refuse_former(verb: str, machine: Any, words: Iterable[str]) -> None:
    """Raise the error of a call whose arguments belong to the loop, or that gives a scene or a law in its place, with the line to write.

    Raises TypeError for arguments that nobody knows.
    """
    given = set(words)
    refuse_former_names(verb, given)
    unknown = next((word for word in given if word not in FORMER), None)
    if unknown is not None:
        raise TypeError(f"{verb}() got an unexpected keyword argument {unknown!r}")
    if hasattr(machine, "cases"):
        loop = 'scene["label of a case"]'
    elif isinstance(machine, (Controller, Sampled)):
        loop = "closed_loop(plant, law, sample_time=...)"
    elif given:
        loop = f"closed_loop(plant, {', '.join(now for word, now in FORMER.items() if word in given)})"
    else:
        return
    raise SceneError(f"`{verb}` takes a closed loop: write `{verb}({loop}, ...)`.")


def states_of(start: Any, plant: HybridSystem, word: str = "start") -> dict[str, Any]:
    """Start values by state, of a mapping, of an equilibrium, or of one instant of a run, of which the states of the plant are taken; word: the argument."""
    if isinstance(start, Equilibrium):
        return {name: start[name] for name in start.plant.states}
    if not hasattr(start, "program"):
        return mapping(word, start)
    if start.time.size != 1:
        raise SceneError(f"Argument `{word}` must be one instant of a run, such as `run.at(12.5)`, but it holds {start.time.size} times.")
    lacking = next((name for name in plant.states if name not in start), None)
    if lacking is not None:
        raise SceneError(f"Argument `{word}` must hold the state `{lacking}`, but the run it comes from has none.")
    return {name: value_at(start, name, size) for name, (_, size, _) in plant.states.items()}


def value_at(instant: Any, name: str, size: int | None) -> Any:
    """A state at one instant of a run, as a start value."""
    return np.squeeze(instant[name]) if size is None else np.ravel(instant[name])


def _plain(value: Any) -> Any:
    """A value that compares and hashes by what it holds."""
    if isinstance(value, Table):
        return "table", value.times.tobytes(), value.values.tobytes()
    if isinstance(value, ca.SX):
        return ExpressionKey(value)
    return tuple(np.ravel(value).tolist()) if isinstance(value, (np.ndarray, list, tuple)) else value
