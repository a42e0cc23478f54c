"""Observers, and laws that act on their estimates instead of on measurements.

An observer is written like a law: it reads what is measured and what is commanded, has states, and gives its estimates under the names of the
signals they stand for. `ObserverBasedController(law, observer)` closes the loop: wherever the law asks for a signal that the observer estimates, it gets the
estimate of the same sample, and wherever the observer asks for a signal that the law drives, it gets the command.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import casadi as ca
import numpy as np

from toolbox.arguments import whole
from toolbox.errors import SceneError
from toolbox.modelling.components import Equations, Signal, Update, check_fields
from toolbox.modelling.elements import State, state
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.law_in_python import LawInPython
from toolbox.modelling.laws import Controller, designed
from toolbox.modelling.remembering import Stateful


class Estimator(Protocol):
    """An observer in Python, sampled at `period` [s]."""

    period: float

    def estimate(self, y: np.ndarray) -> Mapping[str, float]:
        """The estimates at a sample with measurement y, by the names of the signals they stand for."""

    def predict(self, command: float) -> None:
        """Go to the next sample with the command of this one."""

    def get_memory(self) -> np.ndarray:
        """All on which the next estimates depend."""

    def set_memory(self, values: np.ndarray) -> None:
        """Remember what `get_memory` told."""


@dataclass(frozen=True)
class Observer(Controller):
    """Observer that estimates signals, for use inside `ObserverBasedController`. Write `sampled`, `continuous` or both, as for a `Controller`.

    The outputs of these methods are estimates, under the names of the signals that they estimate. `measured_signals`
    names the signals that the observer reads, and `estimates` the signals that it estimates. Estimates must depend only
    on measurements and states, not on the command of the same instant.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from controllers import PI
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, Update, closed_loop, compose
    >>> from toolbox.modelling import Observer, ObserverBasedController
    >>> @dataclass(frozen=True)
    ... class RigidString(Observer):
    ...     measured_signals = ("top.speed",)
    ...     estimates = ("bit.speed",)
    ...
    ...     def sampled(self, signal, period):
    ...         return Update(memory={}, outputs={"bit.speed": (signal("top.speed", "rad/s"), "rad/s")})
    >>> law = ObserverBasedController(PI(reference="60 rpm"), RigidString())
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(law, "10 ms"))
    >>> print(loop.controller_names[0].partition(" (")[0])
    ObserverBasedController, sampled every 10 ms: law PI
    """

    estimates: ClassVar[tuple[str, ...]] = ()

    def create_estimator(self, plant: HybridSystem) -> Estimator | None:
        """Return the estimator of an observer that cannot be written as a casadi expression, such as an optimising observer.

        The estimator is a Python object. Without an override, the method returns None, and `sampled` or `continuous` is
        used.

        Parameters
        ----------
        plant
            The plant whose signals are estimated.
        """
        return None

    def design(self, plant: HybridSystem) -> Observer:
        """Return the observer that acts in the loop, designed on the plant.

        A subclass overrides this method if some of its numbers, such as gains, follow from the plant: the method then
        returns a copy of the observer in which these numbers have values. Without an override, the method returns this
        observer unchanged.

        Parameters
        ----------
        plant
            The plant, with its declared values.

        Returns
        -------
        Observer
            The observer that is used in the loop.
        """
        return self


MOST_LATE = 1000
"""Commands on their way that an observer can remember."""


@dataclass(frozen=True)
class ObserverBasedController(Controller):
    """Controller that acts on the estimates of an observer. The estimates are recorded as `estimate.<signal>`.

    `design` designs both the controller and the observer.

    Parameters
    ----------
    law
        The controller. For a signal that the observer estimates it reads the estimate, for any other signal the signal
        itself.
    observer
        The observer.
    name
        Name of the part.
    delay_samples
        Delay of a command on its way to the plant that the observer assumes, in samples (delay / period), by default 0.
        For sampled controllers only.

    Raises
    ------
    SceneError
        If the units of estimates and signals differ, or an estimate depends on the command of the same instant.

    Examples
    --------
    >>> from controllers import PI
    >>> from controllers.observers import DisturbanceObserver
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> from toolbox.modelling import ObserverBasedController
    >>> law = ObserverBasedController(PI(reference="60 rpm"), DisturbanceObserver())
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(law, "10 ms"))
    >>> print(loop.controller_names[0].partition(" (")[0])
    ObserverBasedController, sampled every 10 ms: law PI
    """

    law: Controller = field(default_factory=Controller)
    observer: Observer = field(default_factory=Observer)
    delay_samples: int = 0

    def check(self) -> None:
        whole("delay_samples", self.delay_samples, 0, MOST_LATE)

    @property
    def actuated_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the outputs: the outputs of the inner controller `law`."""
        return self.law.actuated_signals

    def design(self, plant: HybridSystem) -> Any:
        """Return the controller with its inner controller `law` and its observer designed on the plant.

        Parameters
        ----------
        plant
            The plant on which the controller is designed.

        Returns
        -------
        ObserverBasedController, or callable (t, y) -> u
            Usually a copy of this controller that contains the designed `law` and the designed observer. For an observer
            that makes an estimator in Python (`Observer.create_estimator`), a Python callable that the loop calls once
            per sample of the estimator. Its arguments are the time t [s] and the array y of measurements, in SI and in
            the order of its attributes `measured_signals` and `defaults`. Its result u is the command, a float in the SI
            unit of the signal in `actuated_signals`.

        Raises
        ------
        SceneError
            If `delay_samples` is not 0 although the observer makes an estimator in Python.
        """
        check_fields(self.observer)
        estimator = self.observer.create_estimator(plant)
        if estimator is not None:
            if self.delay_samples:
                raise SceneError(
                    f"Argument `delay_samples` must be 0, but it is {self.delay_samples}: {type(self.observer).__name__} has a delay of its own."
                )
            return EstimatedLaw(LawInPython(designed(self.law, plant), plant, estimator.period), estimator, self.observer.measured_signals)
        return dataclasses.replace(self, law=designed(self.law, plant), observer=designed(self.observer, plant))

    def continuous(self, signal: Signal) -> Equations:
        if self.delay_samples:
            raise SceneError("An observer of late commands has no continuous form: give `sample_time`.")
        commands, known = _commands(self.law, signal)
        seen = self.observer.continuous(known)
        acts = self.law.continuous(_estimated(signal, seen.outputs, commands))
        flow = _with_commands({**seen.flow}, commands, acts.outputs)
        gives = {**acts.outputs, **{f"estimate.{name}": value for name, value in seen.outputs.items()}}
        return Equations(flow={**acts.flow, **flow}, outputs=gives, elements=acts.elements)

    def sampled(self, signal: Signal, period: ca.SX) -> Update:
        commands, known = _commands(self.law, signal)
        seen = self.observer.sampled(known, period)
        acts = self.law.sampled(_estimated(signal, seen.outputs, commands), period)
        arriving = dict(acts.outputs)
        waiting: dict[State, Any] = {}
        for name in commands if self.delay_samples else ():
            unit = acts.outputs[name][1]
            line = [state(f"waiting{k}.{name}", unit) for k in range(self.delay_samples)]
            waiting |= dict(zip(line, [*line[1:], acts.outputs[name][0]], strict=True))
            arriving[name] = (line[0], unit)
        memory = _with_commands({**seen.memory}, commands, arriving)
        outputs = {**acts.outputs, **{f"estimate.{name}": value for name, value in seen.outputs.items()}}
        return Update({**acts.memory, **memory, **waiting}, outputs)


class EstimatedLaw(Stateful):
    """A law with a sampled form on the estimates of an `Estimator`: a callable (t, y) -> u; `estimates` are those of every sample so far."""

    memory_fields: ClassVar[tuple[str, ...]] = ("estimator", "law")

    def __init__(self, law: LawInPython, estimator: Estimator, measured_signals: tuple[str, ...]):
        self.law, self.estimator, self.actuated_signals, self.dt, self.own = (
            law,
            estimator,
            law.actuated_signals,
            estimator.period,
            len(measured_signals),
        )
        known = tuple(estimator.estimate(np.zeros(len(measured_signals))))
        self.measured_signals = (*measured_signals, *(name for name in law.measured_signals if name not in known))
        self.defaults = {name: default for name, default in law.defaults.items() if name not in known}
        self.estimates = list[Mapping[str, float]]()

    def __call__(self, t: float, y: np.ndarray) -> float:
        found = self.estimator.estimate(y[: self.own])
        given = dict(zip((*self.measured_signals, *self.defaults), y, strict=True)) | dict(found)
        (command,) = self.law(t, np.array([given[name] for name in (*self.law.measured_signals, *self.law.defaults)]))
        self.estimator.predict(command)
        self.estimates.append(found)
        return float(command)


def _commands(law: Controller, signal: Signal) -> tuple[dict[str, ca.SX], Signal]:
    """What the observer may ask for: the signals of the plant, and symbols for the commands of the law, collected in the mapping."""
    commands: dict[str, ca.SX] = {}

    def known(name: str, unit: str, default: Any = None) -> ca.SX:
        if name in law.actuated_signals:
            return commands.setdefault(name, ca.SX.sym(name))
        return signal(name, unit, default)

    return commands, known


def _estimated(signal: Signal, estimates: Mapping[str, tuple[Any, str]], commands: Mapping[str, ca.SX]) -> Signal:
    """What the law may ask for: estimates where there are any, else the signals of the plant."""
    for name, (value, _) in estimates.items():
        if commands and ca.depends_on(ca.SX(value), ca.vertcat(*commands.values())):
            raise SceneError(f"The estimate of `{name}` must not depend on the command of the same instant.")

    def estimated(name: str, unit: str, default: Any = None) -> ca.SX:
        if name not in estimates:
            return signal(name, unit, default)
        value, given = estimates[name]
        if given != unit:
            raise SceneError(f"The estimate of `{name}` is given in {given} but needed in {unit}: units must agree.")
        return ca.SX(value)

    return estimated


def _with_commands(memory: Mapping[State, Any], commands: Mapping[str, ca.SX], values: Mapping[str, tuple[Any, str]]) -> dict[State, Any]:
    """Rates or next values of the observer with its command symbols replaced by what reaches the plant."""
    if not commands or not memory:
        return dict(memory)
    old = [commands[name] for name in commands]
    new = [ca.SX(values[name][0]) for name in commands]
    return dict(zip(memory, ca.substitute([ca.SX(value) for value in memory.values()], old, new), strict=True))
