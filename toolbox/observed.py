"""Observers, and laws that act on their estimates instead of on measurements.

An observer is written like a law: it reads what is measured and what is commanded, has states, and gives its estimates under the names of the
signals they stand for. `Observed(law, observer)` closes the loop: wherever the law asks for a signal that the observer estimates, it gets the
estimate of the same sample, and wherever the observer asks for a signal that the law drives, it gets the command.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca

from toolbox.closed_loop import Controller
from toolbox.elements import State, state
from toolbox.errors import SceneError
from toolbox.hybrid import HybridSystem
from toolbox.parts import Equations, Signal, Update


@dataclass(frozen=True)
class Observer(Controller):
    """An observer: `sampled` and `continuous` as of a law, whose outputs are estimates under the names of the signals they stand for.

    measures: what it reads;  estimates: what it gives. Estimates must depend on measurements and states only, not on the command of the same
    instant. For use inside `Observed`.
    """

    estimates: ClassVar[tuple[str, ...]] = ()

    def design(self, plant: HybridSystem) -> Observer:
        """The observer with what it knows of the plant filled in; by default itself."""
        return self


@dataclass(frozen=True)
class Observed(Controller):
    """A law on the estimates of an observer; the estimates are recorded as `estimate.<signal>`.

    late: number of samples by which a command reaches the plant later, as the observer knows it (delay / period); sampled only. `design`
    designs both. Raises SceneError where units of estimates and signals differ or an estimate depends on the command.
    """

    law: Controller = field(default_factory=Controller)
    observer: Observer = field(default_factory=Observer)
    late: int = 0

    @property
    def drives(self) -> tuple[str, ...]:  # type: ignore[override]
        """What the law drives."""
        return self.law.drives

    def design(self, plant: HybridSystem) -> Observed:
        """The law and the observer designed on the plant."""
        return dataclasses.replace(self, law=self.law.design(plant), observer=self.observer.design(plant))

    def continuous(self, signal: Signal) -> Equations:
        if self.late:
            raise SceneError("An observer of late commands has no continuous form: give `sample_time`.")
        commands, known = _commands(self.law, signal)
        seen = self.observer.continuous(known)
        acts = self.law.continuous(_estimated(signal, seen.gives, commands))
        flow = _with_commands({**seen.flow}, commands, acts.gives)
        gives = {**acts.gives, **{f"estimate.{name}": value for name, value in seen.gives.items()}}
        return Equations(flow={**acts.flow, **flow}, gives=gives, elements=acts.elements)

    def sampled(self, signal: Signal, period: ca.SX) -> Update:
        commands, known = _commands(self.law, signal)
        seen = self.observer.sampled(known, period)
        acts = self.law.sampled(_estimated(signal, seen.outputs, commands), period)
        arriving = dict(acts.outputs)
        waiting: dict[State, Any] = {}
        for name in commands if self.late else ():
            unit = acts.outputs[name][1]
            line = [state(f"waiting{k}.{name}", unit) for k in range(self.late)]
            waiting |= dict(zip(line, [*line[1:], acts.outputs[name][0]], strict=True))
            arriving[name] = (line[0], unit)
        memory = _with_commands({**seen.memory}, commands, arriving)
        outputs = {**acts.outputs, **{f"estimate.{name}": value for name, value in seen.outputs.items()}}
        return Update({**acts.memory, **memory, **waiting}, outputs)


def _commands(law: Controller, signal: Signal) -> tuple[dict[str, ca.SX], Signal]:
    """What the observer may ask for: the signals of the plant, and symbols for the commands of the law, collected in the mapping."""
    commands: dict[str, ca.SX] = {}

    def known(name: str, unit: str, default: Any = None) -> ca.SX:
        if name in law.drives:
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
