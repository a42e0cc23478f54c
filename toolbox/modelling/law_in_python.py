"""A law with a sampled form as a callable, and laws in Python inside of it.

`Takeover`, `Lifting` and other laws hold laws. Where one that they hold is designed as a Python callable, as a predictive law is, no expression holds the
whole. The outer law stays written as it is: what it asks the law inside for are expressions, what that one answers is a symbol, and a sample evaluates the
first, calls the law and fills in the second.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import FloatArray
from toolbox.errors import ControllerError, SceneError
from toolbox.modelling.clamps import passing_nan
from toolbox.modelling.components import Signal, Update, fields_of, is_nested
from toolbox.modelling.drive import drive_of
from toolbox.modelling.elements import state, time
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, names
from toolbox.modelling.numeric import NumericFunction
from toolbox.modelling.remembering import offers_memory


class Answer:
    """A Python law inside of another law, with a symbol as its answer. The law counts its samples, because it is not called if the outer
    law keeps its memory."""

    def __init__(self, law: Any, plant: HybridSystem):
        self.law, self.plant = law, plant
        self.actuated_signals = names(getattr(law, "actuated_signals", None) or drive_of(plant)[1])
        self.given = [ca.SX.sym(name) for name in self.actuated_signals]
        self.count = state("answers", "1")
        self.asked: list[Any] = []

    def sampled(self, signal: Signal, period: ca.SX) -> Update:
        """What a sample asks for and gives."""
        measures, defaults = (
            names(getattr(self.law, "measured_signals", None) or drive_of(self.plant)[0]),
            getattr(self.law, "defaults", {}),
        )
        self.asked = [signal(name, self.plant.signal_unit(name)) for name in measures]
        self.asked += [signal(name, unit, default=value) for name, (value, unit) in defaults.items()]
        outputs = {name: (symbol, self.plant.signal_unit(name)) for name, symbol in zip(self.actuated_signals, self.given, strict=True)}
        return Update({self.count: self.count + 1}, outputs)


class LawInPython:
    """A designed law with a sampled form as a callable (t, y) -> u with a memory; `inside` are the laws in Python that it holds.

    - period: sample time [s]; by default the `dt` of the laws inside.

    Raises SceneError where nothing says the sample time, or two laws say different ones.
    """

    def __init__(self, law: Any, plant: HybridSystem, period: float | None = None):
        inside: list[Answer] = []
        outer, kind = _opened(law, plant, inside), type(law).__name__
        self.name = kind
        told = [period, *(getattr(each.law, "dt", None) for each in inside)]
        periods = {float(each) for each in told if each is not None}
        if len(periods) != 1:
            but = f"they say {sorted(periods)} s" if periods else "none says any: give the callable an attribute `dt`"
            raise SceneError(f"The laws in Python inside of {kind} must say one sample time, but {but}.")
        (self.dt,) = periods
        self.inside, self.sizes = [each.law for each in inside], [len(each.given) for each in inside]
        self.actuated_signals: tuple[str, ...] = outer.actuated_signals
        self.defaults: dict[str, tuple[float, str]] = {}
        asked: dict[str, ca.SX] = {}

        def signal(name: str, unit: str, default: Any = None) -> ca.SX:
            if default is None and name in self.actuated_signals:
                default = 0.0  # what is held before the first sample
            if default is not None:
                self.defaults.setdefault(name, (float(default), unit))
            return asked.setdefault(name, ca.SX.sym(name))

        update = outer.sampled(signal, ca.SX(self.dt))
        self.measured_signals = tuple(name for name in asked if name not in self.defaults)
        memory, following = (ca.vertcat(ca.SX(0, 1), *map(ca.SX, rows)) for rows in (update.memory, update.memory.values()))
        answers = ca.vertcat(ca.SX(0, 1), *(symbol for each in inside for symbol in each.given))
        symbols = [time, memory, ca.vertcat(ca.SX(0, 1), *(asked[name] for name in (*self.measured_signals, *self.defaults))), answers]

        def function(name: str, *results: ca.SX) -> NumericFunction:
            return NumericFunction(ca.Function(name, symbols, list(map(ca.densify, results))))

        self.asks = [function("asks", ca.vertcat(*map(ca.SX, each.asked)), update.memory[each.count] - each.count) for each in inside]
        commands = ca.vertcat(*(ca.SX(update.outputs[name][0]) for name in self.actuated_signals))
        self.step = function("step", *passing_nan([following, commands], time))
        self.memory, self.answers = np.zeros(memory.numel()), np.zeros(answers.numel())
        if not all(offers_memory(each) for each in self.inside):
            self.get_memory = None  # type: ignore[assignment, method-assign]

    def __call__(self, t: float, y: Any) -> FloatArray:
        first = 0
        for law, size, ask in zip(self.inside, self.sizes, self.asks, strict=True):
            wanted, samples = ask(t, self.memory, y, self.answers)
            if samples.item() > 0.5:
                self.answers[first : first + size] = np.ravel(law(t, wanted.ravel()))
            first += size
        memory, commands = self.step(t, self.memory, y, self.answers)
        if not np.isfinite(memory).all():
            raise ControllerError(f"Controller `{self.name}` must remember finite numbers, but at t = {t:g} s these are {memory.ravel()}.")
        self.memory = memory.ravel()
        return commands.ravel()

    def get_memory(self) -> FloatArray:
        """What it and the laws inside remember."""
        return np.concatenate([self.memory, *(law.get_memory() for law in self.inside)])

    def set_memory(self, values: FloatArray) -> None:
        """Remember what `get_memory` told."""
        sizes = [self.memory.size, *(law.get_memory().size for law in self.inside)]
        self.memory, *others = (np.array(part, float) for part in np.split(values, np.cumsum(sizes)[:-1]))
        for law, part in zip(self.inside, others, strict=True):
            law.set_memory(part)


def _opened(law: Any, plant: HybridSystem, inside: list[Answer]) -> Any:
    """The law with an `Answer` in place of each callable that it holds."""
    changed = {}
    for each in fields_of(type(law)):
        value = getattr(law, each.name)
        if in_python(value):
            inside.append(Answer(value, plant))
            changed[each.name] = inside[-1]
        elif isinstance(value, Controller):
            changed[each.name] = _opened(value, plant, inside)
    return dataclasses.replace(law, **changed)


def in_python(value: Any) -> bool:
    """Return whether the value of a field is a designed law in Python."""
    return callable(value) and not is_nested(value)


def holds_python(law: Any) -> bool:
    """Whether a designed law holds one in Python, itself or in a law that it holds."""
    held = [getattr(law, each.name) for each in fields_of(type(law))] if isinstance(law, Controller) else []
    return any(in_python(value) or holds_python(value) for value in held)
