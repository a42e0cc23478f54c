"""Control laws and how they meet a plant: continuous, sampled with a hold, delayed, or a Python callable.

Order at one instant: event, sample, update, hold. A sampled law reads the plant at t_k = k period, updates its own states, and its outputs are
held from t_k + delay on; delays may exceed the period, then several outputs are on their way at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca

from toolbox.elements import is_finite_number, quantity
from toolbox.errors import SceneError
from toolbox.hybrid import HybridSystem
from toolbox.parts import Component, Equations, Signal, Update


@dataclass(frozen=True)
class Controller(Component):
    """A control law: subclass it as a frozen dataclass and write `continuous`, `sampled` or both.

    measures, drives: names of the signals it reads and gives;  its numeric fields are casadi symbols inside both methods, so that
    another gain never recompiles. `design(plant)` is called once on the plant's declared values and returns the law to be used: a
    Controller, or for laws that no casadi expression holds a callable (t, y) -> u (see `Sampled`).
    """

    measures: ClassVar[tuple[str, ...]] = ()
    drives: ClassVar[tuple[str, ...]] = ()

    def design(self, plant: HybridSystem) -> Any:
        """The law with gains filled in from the plant; by default itself."""
        return self

    def continuous(self, signal: Signal) -> Equations:
        """The law as equations of a part."""
        raise SceneError(f"{type(self).__name__} has no continuous form: give `sample_time`.")

    def sampled(self, signal: Signal, period: ca.SX) -> Update:
        """The law as an update at every sample; `period` [s] is a symbol."""
        raise SceneError(f"{type(self).__name__} has no sampled form: leave out `sample_time`.")

    def equations(self, signal: Signal) -> Equations:
        return self.continuous(signal)


@dataclass(frozen=True)
class Sampled:
    """A law with a period and delay of its own: `controller=[Sampled(outer, 0.1), Sampled(inner, 0.01, delay=0.003)]`.

    law: a Controller, or any callable (t, y) -> u with attributes `measures` and `drives`, y in the order of `measures`, u a number
    or a sequence in the order of `drives`;  period, delay in s. A callable object is copied for every run, so that each starts from the
    state it was given in; a plain function is called as it is and should keep no state.
    """

    law: Controller | Callable[[float, Any], Any]
    period: float
    delay: float = 0.0

    def check(self) -> None:
        """Raise SceneError unless period > 0 and delay >= 0."""
        if not is_finite_number(self.period) or self.period <= 0:
            raise SceneError(f"Argument `sample_time` must be > 0 s, but it is {self.period!r}.")
        if not is_finite_number(self.delay) or self.delay < 0:
            raise SceneError(f"Argument `delay` must be >= 0 s, but it is {self.delay!r}.")


@dataclass(frozen=True)
class Held(Component):
    """A sampled law as a part of the plant: its outputs are held signals."""

    law: Controller = field(default_factory=Controller)
    period: Any = quantity(0.01, "s", "sample time", above=0)

    def equations(self, signal: Signal) -> Equations:
        return Equations(update=self.law.sampled(signal, self.period))


@dataclass(frozen=True)
class External(Component):
    """The signals that a Python callable drives, as held signals without an update."""

    measures: tuple[str, ...] = ()
    drives: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def equations(self, signal: Signal) -> Equations:
        outputs = {name: (ca.SX(0), unit) for name, unit in zip(self.drives, self.units, strict=True)}
        return Equations(update=Update({}, outputs, external=True))


def names(value: str | Sequence[str]) -> tuple[str, ...]:
    """A tuple of names from one name or several."""
    return (value,) if isinstance(value, str) else tuple(value)


def callable_law(law: Callable[..., Any], plant: HybridSystem) -> External:
    """The part that stands for a Python callable; raises SceneError where its signals are unknown."""
    measures = names(getattr(law, "measures", ("top.speed",)))
    drives = names(getattr(law, "drives", ("top.torque",)))
    for name in measures:
        if not plant.has_signal(name) or (name in plant.states and plant.states[name][1] is not None):
            raise SceneError(f"The controller measures `{name}`, which the plant does not give; set its attribute `measures`.")
    for name in drives:
        if name not in plant.inputs:
            raise SceneError(f"The controller drives `{name}`, which is no input of the plant; set its attribute `drives`.")
    return External(measures=measures, drives=drives, units=tuple(plant.inputs[name].unit for name in drives))

