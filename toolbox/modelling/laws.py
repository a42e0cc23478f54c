"""Control laws and how they meet a plant: continuous, sampled with a hold, delayed, or a Python callable.

Order at one instant: event, sample, update, hold. A sampled law reads the plant at t_k = k period, updates its own states, and its outputs are
held from t_k + delay on; delays may exceed the period, then several outputs are on their way at once. Its memory is recorded as signals, as the
law saw it when it computed the outputs that are held.

Why noise is a function and not a generator: the noise of a sample depends on (seed, name of the signal, number of the sample) and on nothing
else, so that the second run of `run.error_estimate`, a run interrupted and continued, and a run among thousands see the same measurements.
"""

from __future__ import annotations

import copy
import dataclasses
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import FunctionType
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from toolbox.arguments import finite_array, number, refuse, whole
from toolbox.errors import ControllerError, SceneError, suggest
from toolbox.files.units import in_si, warn_unusual
from toolbox.modelling.clocks import Clock
from toolbox.modelling.components import Component, Equations, Signal, Update, check_fields, own_word
from toolbox.modelling.drive import drive_of
from toolbox.modelling.elements import OptionalQuantities, Quantity, State, quantity, time
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.vocabulary import Renamed, new_field

SIGNALS = ("measured_signals", "actuated_signals")
"""Attributes of a controller that name the signals it reads and gives."""


@dataclass(frozen=True)
class Controller(Component):
    """Base class of controllers. Write your own controller as a frozen dataclass with the method `continuous`,
    `sampled` or both.

    The class attributes `measured_signals` and `actuated_signals` name the signals that the controller reads and the
    signals that it gives. A controller that declares no `measured_signals` may read any signal. In both methods the
    numeric fields of the controller are casadi symbols, so a changed gain needs no new compilation.

    The toolbox calls the method `design(plant)` once, with the parameter values of the plant. The method returns the
    controller that acts in the loop: a `Controller`, or a callable (t, y) -> u (time, measured signals -> outputs) if
    the controller cannot be written as a casadi expression.

    The names of all numbers and states of a controller begin with its `name`, or else with its class in lowercase:
    the field `gain` of the class `MyController` is `mycontroller.gain`. In the names of its states this word replaces
    the first word: `state("any.angle", "rad")` is `mycontroller.angle`.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from models import BitRock, wells
    >>> from toolbox import Controller, Equations, Quantity, compose, quantity, simulate
    >>> @dataclass(frozen=True)
    ... class Proportional(Controller):
    ...     measured_signals = ("top.speed",)
    ...     actuated_signals = ("top.torque",)
    ...     gain: Quantity = quantity(2000.0, "N m s/rad", "gain", above=0)
    ...     reference: Quantity = quantity(20.0, "rad/s", "set-point")
    ...
    ...     def continuous(self, signal):
    ...         error = self.reference - signal("top.speed", "rad/s")
    ...         return Equations(outputs={"top.torque": (self.gain * error, "N m")})
    >>> run = simulate(compose(wells.JANSEN_2, BitRock(weight="60 kN")), "60 s", controller=Proportional())
    >>> print(f"{run['top.speed'][-1]:.1f} rad/s")
    14.3 rad/s
    """

    measured_signals: ClassVar[tuple[str, ...]] = ()
    actuated_signals: ClassVar[tuple[str, ...]] = ()
    dt: ClassVar[float | None] = None
    """The only sample time [s] at which the law may run; None for any."""

    def design(self, plant: HybridSystem) -> Any:
        """Return the controller that acts in the loop, designed on the plant.

        A subclass overrides this method if some of its numbers, such as gains, follow from the plant: the method then
        returns a copy of the controller in which these numbers have values. Without an override, the method returns this
        controller unchanged.

        Parameters
        ----------
        plant
            The plant, with its declared values.

        Returns
        -------
        Controller, or callable (t, y) -> u
            The controller that is used in the loop.
        """
        return self

    def continuous(self, signal: Signal) -> Equations:
        """Return the continuous form of the controller: the differential equations of its states, and its outputs.

        Parameters
        ----------
        signal
            Function `signal(name, unit, default=...)` that returns the expression of a signal.

        Returns
        -------
        Equations
            Rates of the states of the controller (`flow`) and the signals that it gives (`outputs`).
        """
        raise SceneError(f"{type(self).__name__} has no continuous form: {self._instead('sampled', 'give `sample_time`')}.")

    def sampled(self, signal: Signal, period: ca.SX) -> Update:
        """Return the sampled form of the controller: the difference equations of its memory, and its outputs.

        Parameters
        ----------
        signal
            Function `signal(name, unit, default=...)` that returns the expression of a signal.
        period
            Symbol of the sample time [s].

        Returns
        -------
        Update
            The next value of each state of the controller (`memory`), and the values that it gives until the next
            sample (`outputs`), as expressions of the present states and signals.
        """
        raise SceneError(f"{type(self).__name__} has no sampled form: {self._instead('continuous', 'leave out `sample_time`')}.")

    def check_period(self, period: float) -> None:
        """Raise SceneError if the sampled form does not work with the given sample time. By default every sample time is allowed.

        Parameters
        ----------
        period
            Sample time [s].
        """

    def _instead(self, form: str, remedy: str) -> str:
        """What to do where one form is missing; form: the other one."""
        if getattr(type(self), form) is getattr(Controller, form):  # what all are derived from, as a default that must be replaced
            return f"it has no {form} form either, so give another one"
        return remedy

    def equations(self, signal: Signal) -> Equations:
        asked: dict[str, bool] = {}
        equations = self.continuous(_noting(signal, asked))
        if isinstance(equations, Equations):
            _check_driven(self, "continuous", equations.outputs)
        _check_measured(self, "continuous", asked)
        return equations


def check_sampled(law: Controller, period: float) -> None:
    """Raise SceneError if a designed law, or a law or an observer inside of it, cannot use a sample time [s]."""
    law.check_period(period)
    for each in dataclasses.fields(law):
        if isinstance(inside := getattr(law, each.name), Controller):
            check_sampled(inside, period)


def _noting(signal: Signal, display_units: dict[str, bool]) -> Signal:
    """The same `signal`, which notes {signal: whether it came with a default, as a set-point does}."""

    def noted(name: str, unit: str, default: Any = None) -> ca.SX:
        display_units[name] = display_units.get(name, False) or default is not None
        return signal(name, unit, default)

    return noted


def _check_measured(law: Controller, form: str, display_units: Mapping[str, bool]) -> None:
    """Raise SceneError where a law reads a signal without default that neither it nor a law that it holds declares to measure or to drive.

    Where one of these declares nothing that it measures, it may read any.
    """
    known = _declared(law)
    if known is None:
        return
    if extra := next((name for name, has_default in display_units.items() if not has_default and name not in known), None):
        measured = ", ".join(f"`{name}`" for name in names(law.measured_signals)) or "nothing"
        raise SceneError(
            f"{type(law).__name__} must declare `{extra}` in `measured_signals`, as `{form}` reads it, but it declares {measured}."
        )


def _declared(law: Controller) -> set[str] | None:
    """What a law, and those that it holds, declare to measure and to drive; None where one declares no measures, and holds no law."""
    held = [value for each in dataclasses.fields(law) if isinstance(value := getattr(law, each.name), Controller)]
    found = [_declared(each) for each in held]
    if None in found or not (found or names(law.measured_signals)):
        return None
    return {*names(law.measured_signals), *names(law.actuated_signals)}.union(*(each for each in found if each is not None))


def _check_driven(law: Controller, form: str, gives: Mapping[str, Any]) -> None:
    """Raise SceneError where a law does not give what it declares to drive."""
    lacking = next((name for name in names(law.actuated_signals) if name not in gives), None)
    if lacking is not None:
        given = f"gives only {', '.join(f'`{name}`' for name in gives)}" if gives else "gives nothing"
        raise SceneError(f"{type(law).__name__} must give `{lacking}`, which it declares in `actuated_signals`, but `{form}` {given}.")


def designed(law: Any, plant: HybridSystem) -> Any:
    """The law designed on the declared plant; a law without a `design` of its own is returned as it is.

    Raises SceneError for a law whose numbers are out of bounds, and for one that linear algebra finds no gains for.
    """
    if not hasattr(law, "design"):
        raise SceneError(f"A control law must be a Controller, but it is {law!r}.")
    if type(law).design is Controller.design:
        return law
    if dataclasses.is_dataclass(law):  # else one that is designed as a callable
        check_fields(law)
    try:
        with np.errstate(all="ignore"):  # what is not finite is an error here or, as a gain, in the table of parameters
            made = law.design(plant)
    except (SceneError, NotImplementedError):
        raise
    except (ArithmeticError, ValueError) as error:  # of numpy and scipy
        raise SceneError(f"{type(law).__name__} cannot be designed on this plant with these numbers: {error}") from error
    if not callable(made) and not isinstance(made, Controller):
        raise SceneError(f"`{type(law).__name__}.design` must return a control law, but it returned {made!r}.")
    if isinstance(made, Controller) and made.name is None and type(made) is not type(law):
        return dataclasses.replace(made, name=law_word(law))
    return made


def law_word(law: Any) -> str:
    """The first word of all names of a declared law, as `first_word` reads it from its part; of a function its own name."""
    named = getattr(law, "name", None)
    return named if isinstance(law, Controller) and named else getattr(law, "__name__", type(law).__name__).strip("<>").lower()


@dataclass(frozen=True)
class Sensors(Component):
    """What stands between the signals of a plant and a sampled law: white noise, then the steps of an encoder.

        y = step round((signal + noise n_k) / step),   n_k standard normal, independent of one another

    Attributes
    ----------
    noisy, noise
        Names of the signals that are measured with noise, and the standard deviation of each, in its unit.
    coarse, resolution
        Names of the signals that pass an encoder, and the step of each, in its unit.
    """

    noisy: tuple[str, ...] = ()
    noise: OptionalQuantities = quantity(None, "1", "standard deviations of the measurement noise", at_least=0)
    coarse: tuple[str, ...] = ()
    resolution: OptionalQuantities = quantity(None, "1", "steps of the measured values", above=0)

    @staticmethod
    def of(noise: Mapping[str, float], resolution: Mapping[str, float]) -> Sensors:
        """Sensors with these standard deviations and steps by name of the signal."""
        return Sensors(tuple(noise), tuple(noise.values()) or None, tuple(resolution), tuple(resolution.values()) or None)

    def reading(self, name: str, value: Any, noise: Any) -> Any:
        """Return the measured value of a signal from its value and its standard normal noise. All are numbers, or casadi expressions."""
        if self.noise is not None and name in self.noisy:
            value = value + self.noise[self.noisy.index(name)] * noise
        if self.resolution is not None and name in self.coarse:
            step = self.resolution[self.coarse.index(name)]
            value = step * ca.floor(value / step + 0.5)
        return value


USUAL_TIMES = (1e-7, 5.0)
"""Usual sample times, delays and jitters [s]: a larger number was perhaps meant in ms."""


@dataclass(frozen=True)
class Sampled(Renamed):
    """Controller with its own sample time, delay and sensors.

    In a cascade each controller has its own sample time: `controller=[Sampled(outer, 0.1), Sampled(inner, 0.01,
    delay=0.003)]`. Controllers that sample at the same instant read the values that were held before this instant,
    whatever their order in the list. The inner controller therefore uses a new set-point of the outer controller one of
    its own samples later.

    Period, delay, noise and resolution may be text with a unit: `Sampled(law, "10 ms", delay="30 ms")`.

    Parameters
    ----------
    law
        A `Controller`, or any callable (t, y) -> u. t is the time [s], y the array of the measured signals in order,
        and u a number, or the sequence of the actuated signals in order.

        A callable may have an attribute `defaults` {signal: (value, unit)}, for example for `top.reference`. In y these
        signals follow after the measured signals. They are inputs of the loop with this value as default.

        A callable object is copied (`copy.deepcopy`) for every run, so that each run starts from the same state. A
        plain function is called as it is and should keep no state.

        A callable object may have the methods `get_memory() -> array of numbers` and `set_memory(array)`. The array
        must hold everything on which the next outputs depend, including the number of samples if it matters. `run.last`
        then holds this array instead of a copy of the object, and the growth of a disturbance can be computed from
        differences.
    period
        Sample time [s], > 0.
    delay
        Time from a sample until its outputs take effect [s], >= 0, by default 0. The delay may exceed the period.
    noise
        {measured signal: standard deviation of white noise}, in the unit of the signal. By default no noise.
    resolution
        {measured signal: step of its encoder}, in the unit of the signal. By default the measurement has no steps. The
        noise is added before the encoder.
    seed
        Seed of noise, jitter and missed samples, an integer >= 0, by default 0. Two controllers with the same seed get
        the same noise on the same signal. Their samples with the same number are late by the same time, and the same
        samples are missed.
    jitter
        Largest lateness of a sample [s], >= 0 and less than the period, by default 0. Sample k is taken at the time k
        period + jitter u_k. The numbers u_k are independent and uniform between 0 and 1. The delay counts from this
        time.
    missed_samples
        Probability that a sample is missed, >= 0 and < 1, by default 0. At a missed sample the controller neither reads
        nor computes: its memory and its outputs stay as they are.

        The first sample, at t = 0, is always taken, and on time. Lateness and misses follow from `seed` and the number
        of the sample, so a repeated run has the same lateness and misses.
    measured_signals, actuated_signals
        Names of the signals that a callable reads and gives. By default its own attributes of these names. If it has
        none: the first force or torque that the plant takes, and the speed at the same place, such as `top.torque` and
        `top.speed`.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, compose, simulate
    >>> drive = Sampled(SoftTorque(reference="60 rpm"), "10 ms", delay="30 ms", noise={"top.speed": 0.01})
    >>> run = simulate(compose(wells.JANSEN_2, BitRock(weight="60 kN")), "60 s", controller=drive)
    >>> print(f"{run['bit.speed'][-1]:.1f} rad/s")
    6.3 rad/s
    """

    law: Controller | Callable[[float, Any], Any]
    period: Quantity = quantity(unit="s", meaning="sample time")
    delay: Quantity = quantity(0.0, "s", "time from a sample until its outputs take effect")
    noise: Mapping[str, Any] = field(default_factory=dict)
    resolution: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    measured_signals: str | Sequence[str] | None = None
    actuated_signals: str | Sequence[str] | None = None
    jitter: Quantity = quantity(0.0, "s", "largest lateness of a sample")
    missed_samples: float = 0.0

    def __post_init__(self) -> None:
        for word in ("period", "delay", "jitter"):
            typed = getattr(self, word)
            object.__setattr__(self, word, in_si(typed, "s", word))
            warn_unusual(typed, getattr(self, word), "s", USUAL_TIMES, word)

    @property
    def clock(self) -> Clock:
        """Sample time, delay, jitter and missed samples as one value."""
        return Clock(*(float(getattr(self, name)) for name in Clock._fields))

    def with_sensor_units(self, unit: Callable[[str], str]) -> Sampled:
        """Return the same controller, with noise and resolution converted from text with units to numbers in SI.

        Parameters
        ----------
        unit
            Function that returns the SI unit of a signal from its name.
        """
        sensors: dict[str, Any] = {}
        for word in ("noise", "resolution"):
            given = getattr(self, word)
            if isinstance(given, Mapping) and any(isinstance(value, str) for value in given.values()):
                sensors[word] = {name: in_si(value, unit(name), f"{word}.{name}") for name, value in given.items()}
        return dataclasses.replace(self, **sensors) if sensors else self

    def check(self) -> None:
        """Raise SceneError if a number is out of range.

        Conditions: period > 0, delay >= 0, 0 <= jitter < period, 0 <= missed_samples < 1, noise >= 0, resolution > 0,
        and seed an integer >= 0. `measured_signals` and `actuated_signals` may be given only if `law` is a callable (t,
        y) -> u, because a `Controller` declares its own signals.
        """
        for word in SIGNALS:
            told = getattr(self, word)
            if told is None:
                continue
            if isinstance(self.law, Controller):
                raise SceneError(f"Argument `{word}` must be left to a callable: {type(self.law).__name__} declares its own.")
            if not isinstance(told, (str, list, tuple)) or not told or not all(isinstance(name, str) for name in told):
                raise SceneError(f"Argument `{word}` must be the name of a signal, or several, but it is {told!r}.")
        number("sample_time", self.period, "s", above=0)
        number("delay", self.delay, "s", at_least=0)
        number("jitter", self.jitter, "s", at_least=0)
        if self.jitter >= self.period:
            raise SceneError(f"Argument `jitter` must be less than the sample time of {self.period:g} s, but it is {self.jitter:g} s.")
        number("missed_samples", self.missed_samples, at_least=0, below=1)
        whole("seed", self.seed, 0, 2**63 - 1)
        for word, given, bounds in (("noise", self.noise, {"at_least": 0.0}), ("resolution", self.resolution, {"above": 0.0})):
            if not isinstance(given, Mapping) or not all(isinstance(name, str) for name in given):
                raise SceneError(f"Argument `{word}` must map names of signals to numbers, but it is {given!r}.")
            for name, value in given.items():
                refuse(f"Argument `{word}` of `{name}`", value, "1", bounds)

    def sensors(self, measured: Sequence[str]) -> Sensors:
        """Return the sensors of this controller: a `Sensors` object with the names and values of `noise` and
        `resolution`.

        Raises SceneError if `noise` or `resolution` names a signal that is not measured.

        Parameters
        ----------
        measured
            Names of the signals that the controller measures.
        """
        for word, given in (("noise", self.noise), ("resolution", self.resolution)):
            for name in given:
                if name not in measured:
                    raise SceneError(
                        f"Argument `{word}` must name signals that the law measures, but `{name}` is none: {suggest(name, measured)}"
                    )
        numbers = [{name: float(value) for name, value in given.items()} for given in (self.noise, self.resolution)]
        return Sensors.of(*numbers)


@dataclass(frozen=True)
class ZeroOrderHold(Component):
    """A sampled law as a part of the plant: it reads the signals through its sensors, and its outputs are held signals."""

    holds_law: ClassVar[bool] = True

    law: Controller = field(default_factory=Controller)
    sensors: Sensors = field(default_factory=Sensors)
    sample_time: Any = quantity(0.01, "s", "sample time", above=0)

    def equations(self, signal: Signal) -> Equations:
        noise: dict[str, ca.SX] = {}

        def sensed(name: str, unit: str, default: Any = None) -> ca.SX:
            if name in self.sensors.noisy:
                noise.setdefault(name, ca.SX.sym(f"noise of {name}"))
            return self.sensors.reading(name, signal(name, unit, default), noise.get(name))

        asked: dict[str, bool] = {}
        update, title = self.law.sampled(_noting(sensed, asked), self.sample_time), type(self.law).__name__
        if not isinstance(update, Update):
            raise SceneError(f"`{title}.sampled` must return Update, but it returned {type(update).__name__}.")
        for variable in update.memory:
            if not isinstance(variable, State):
                raise SceneError(
                    f"The memory of {title} must map states made with `state(...)` to their next values, but a key is {variable!r}."
                )
        _check_driven(self.law, "sampled", update.outputs)
        _check_measured(self.law, "sampled", asked)
        return Equations(update=dataclasses.replace(update, noise=noise))


@dataclass(frozen=True)
class External(Component):
    """The signals that a Python callable drives, as held signals without an update.

    Attributes
    ----------
    display_units
        What the callable measures, by the names that it uses; its sensors know these.
    measured_signals
        Names of the same signals in the plant; those with a default stand last.
    actuated_signals, units
        Signals that it drives, and their units.
    wanted, defaults
        Units and values of the signals with a default.
    sensors
        What stands between these signals and the callable.
    """

    display_units: tuple[str, ...] = ()
    measured_signals: tuple[str, ...] = ()
    actuated_signals: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    wanted: tuple[str, ...] = ()
    defaults: OptionalQuantities = quantity(None, "1", "defaults of the last measured signals")
    sensors: Sensors = field(default_factory=Sensors)

    def equations(self, signal: Signal) -> Equations:
        if self.defaults is not None:
            for name, unit, value in zip(self.measured_signals[-len(self.wanted) :], self.wanted, self.defaults, strict=True):
                signal(name, unit, default=value)
        outputs = {name: (ca.SX(0), unit) for name, unit in zip(self.actuated_signals, self.units, strict=True)}
        return Equations(update=Update({}, outputs, from_callable=True, noise={name: ca.SX.sym(name) for name in self.sensors.noisy}))

    def answer(self, law: Any, time: float, values: Iterable[float], noise: Mapping[str, float]) -> np.ndarray:
        """What the callable drives at a sample, given the values of `measured_signals` and standard normal noise by channel.

        Raises ControllerError where it returns something else than one finite number for each of `actuated_signals`.
        """
        y = np.array(
            [self.sensors.reading(name, value, noise.get(name, 0.0)) for name, value in zip(self.display_units, values, strict=True)]
        )
        title = getattr(law, "__name__", type(law).__name__)
        try:
            answer = law(time, y)
        except OverflowError as error:  # of Python, where numpy has an infinite number
            raise ControllerError(
                f"The controller must compute finite numbers, but at t = {time:g} s `{title}` overflows: {error}."
            ) from error
        found = finite_array(answer)
        if found is None or found.size != len(self.actuated_signals):
            wanted = f"{len(self.actuated_signals)} finite value(s) for {', '.join(self.actuated_signals)}"
            raise ControllerError(f"The controller must return {wanted}, but at t = {time:g} s `{title}` returned {answer!r}.")
        return found.ravel()


def as_held_part(sampled: Sampled, law: Controller) -> ZeroOrderHold:
    """The part that stands for a sampled law; raises SceneError for sensors of signals that it does not measure."""
    asked: list[str] = []

    def signal(name: str, unit: str, default: Any = None) -> ca.SX:
        asked.append(name)
        return ca.SX.sym(name)

    if sampled.noise or sampled.resolution:
        law.sampled(signal, ca.SX.sym("period"))
    return ZeroOrderHold(law, sampled.sensors(asked), float(sampled.period), name=law.name)


def names(value: str | Sequence[str]) -> tuple[str, ...]:
    """A tuple of names from one name or several. Raises SceneError for anything else."""
    listed = (value,) if isinstance(value, str) else tuple(value) if isinstance(value, Iterable) else (value,)
    if not all(isinstance(name, str) for name in listed):
        raise SceneError(f"A name, or several, must be given as strings, but it is {value!r}.")
    return listed


def callable_law(sampled: Sampled, plant: HybridSystem, word: str) -> External:
    """The part that stands for a Python callable, word: the first of its names; raises SceneError where its signals are unknown."""
    law = sampled.law
    former = next((word for word in ("measures", "drives") if hasattr(law, word) and not isinstance(law, Renamed)), None)
    if former is not None:
        raise SceneError(f"Attribute `{former}` of a controller is now `{new_field(Controller, former)}`.")
    try:
        inspect.signature(law).bind(0.0, None)  # type: ignore[arg-type]
    except ValueError:  # something compiled, which does not tell
        pass
    except TypeError as error:
        raise SceneError(f"Argument `controller` must be callable as (t, y), y what it measures in order, but: {error}.") from None
    own = [getattr(law, word, None) if getattr(sampled, word) is None else getattr(sampled, word) for word in SIGNALS]
    asked, driven = (names(drive_of(plant)[k] if each is None else each) for k, each in enumerate(own))
    measures, drives = (tuple(plant.redirected_signals.get(name, name) for name in each) for each in (asked, driven))
    for name in measures:
        if not plant.has_signal(name):
            raise SceneError(
                f"The controller measures `{name}`, which the plant does not give: {_told(name, plant.signals, sampled, plant)}"
            )
        if name in plant.states and plant.states[name][1] is not None:
            raise SceneError(
                f"The controller measures `{name}`, which is a vector: name its entries in `measured_signals`, `{name}.0` and so on."
            )
    for name in drives:
        if name not in plant.inputs:
            raise SceneError(f"The controller drives `{name}`, which is no input of the plant: {_told(name, plant.inputs, sampled, plant)}")
    units = tuple(plant.inputs[name].unit for name in drives)
    if hasattr(law, "stand_ins"):
        raise SceneError("The attribute `stand_ins` of a callable controller is named `defaults` now: {signal: (value, unit)}.")
    more: dict[str, tuple[float, str]] = dict(getattr(law, "defaults", {}))
    places = measures + tuple(plant.redirected_signals.get(name, name) for name in more)
    return External(
        display_units=asked + tuple(more),
        measured_signals=places,
        actuated_signals=drives,
        units=units,
        wanted=tuple(unit for _, unit in more.values()),
        defaults=tuple(float(value) for value, _ in more.values()) or None,
        sensors=sampled.sensors(asked),
        name=word,
    )


def fresh(law: Any) -> Any:
    """Return a copy of a law that may have a state, so that every run starts in the same way. A function, and a law that cannot be copied,
    is returned unchanged."""
    if isinstance(law, FunctionType):
        return law
    try:
        return copy.deepcopy(law)
    except Exception:  # whatever an object that holds a lock or a solver raises
        return law


def _told(name: str, known: Iterable[str], sampled: Sampled, plant: HybridSystem) -> str:
    """How to tell a callable its signals, with signals of the plant."""
    scalars = [each for each, (expression, _) in plant.signals.items() if expression.numel() == 1] or ["..."]
    measured = next((each for each in scalars if each.endswith(".speed")), scalars[0])
    driven = next(iter(plant.inputs), "...")
    call = f'Sampled(law, {sampled.period:g}, measured_signals="{measured}", actuated_signals="{driven}")'
    return f"write `{call}`, with a tuple of names for several; {suggest(name, known)}"


@dataclass(frozen=True)
class Takeover(Controller):
    """Two sampled controllers in one run: `before` acts until the time `at`, `after` acts from this time on, like a drive that is switched on.

    Until the takeover the memory of `after` (its states, such as an integral) keeps its start values. After the
    takeover the memory of `before` stays constant. A run records the memory of `before` under the names
    `takeover.before.<name>`. Signals that only one of the two controllers gives are recorded during the whole run. A takeover
    has no continuous form.

    The design of some controllers, such as the predictive controllers, is a Python callable. If `before` or `after` is
    such a controller, the takeover becomes a callable, too. After a run, the list `run.controllers[0].inside` then
    holds these callables: of `before`, of `after`, or of both.

    Parameters
    ----------
    before, after
        The controllers. A signal that only `after` gives has, before the takeover, the value that `after` gives with
        the start values of its memory.
    at
        Time of the takeover [s].
    name
        Name of the part.

    Raises
    ------
    SceneError
        If `before` gives a signal that `after` does not give.

    Examples
    --------
    >>> from controllers import SoftTorque, StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, compose, simulate
    >>> from toolbox.modelling import Takeover
    >>> law = Takeover(StiffPI(reference="120 rpm"), SoftTorque(reference="120 rpm"), at="60 s")
    >>> run = simulate(compose(wells.JANSEN_2, BitRock(weight="80 kN")), "120 s", controller=Sampled(law, "10 ms"))
    >>> print(f"{run.time_in('bit', 'stick', until=60.0):.0f} s in stick before, {run.time_in('bit', 'stick', after=90.0):.0f} s at the end")
    2 s in stick before, 0 s at the end
    """

    before: Controller = field(default_factory=Controller)
    after: Controller = field(default_factory=Controller)
    at: Quantity = quantity(0.0, "s", "time of the takeover", at_least=0)

    @property
    def actuated_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the outputs: the outputs of the controller `after`. The controller `before` gives all or some of these signals."""
        return self.after.actuated_signals

    def design(self, plant: HybridSystem) -> Controller:
        """Return the takeover with both controllers designed on the plant.

        Parameters
        ----------
        plant
            The plant on which both controllers are designed.
        """
        return dataclasses.replace(self, before=designed(self.before, plant), after=designed(self.after, plant))

    def sampled(self, signal: Signal, period: ca.SX) -> Update:
        if not set(self.before.actuated_signals) <= set(self.after.actuated_signals):
            driven = [", ".join(law.actuated_signals) or "nothing" for law in (self.before, self.after)]
            raise SceneError(
                f"The second law of a takeover must drive what the first one does, but they drive {driven[0]} and {driven[1]}."
            )
        first, second = self.before.sampled(signal, period), self.after.sampled(signal, period)
        own = own_word(self.before, first.memory)
        for variable in first.memory:
            variable.label = f"before.{variable.label.removeprefix(f'{own}.')}"
        now = time >= self.at
        memory = {variable: ca.if_else(now, value, variable) for variable, value in second.memory.items()}
        memory |= {variable: ca.if_else(now, variable, value) for variable, value in first.memory.items()}
        outputs = {**first.outputs, **second.outputs}
        for name in {*first.outputs} & {*second.outputs}:
            outputs[name] = (ca.if_else(now, second.outputs[name][0], first.outputs[name][0]), outputs[name][1])
        return Update(memory, outputs)
