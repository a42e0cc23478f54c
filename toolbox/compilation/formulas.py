"""The formulas of a step, as values: what the loops, the lanes and the choice of a method must know of them they answer, and they write their own step.

Each kind stands in a file of its own: `explicit_step`, `implicit_step`, `moreau_jean` and `taylor`. Nobody asks which kind formulas are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, NamedTuple

import casadi as ca

from toolbox.compilation.emitter import Body
from toolbox.modelling.elements import Element
from toolbox.modelling.switching import Switching


@dataclass(frozen=True, eq=False)
class ClosedEquations:
    """The equations of a closed system, whose only symbols are t, x, p and the modes."""

    t: ca.SX
    x: ca.SX
    p: ca.SX
    elements: Sequence[Element]
    form: Switching
    flow: ca.SX | None = None  # dx/dt with the multipliers as symbols, which steps with implicit forces need
    written: dict[str, Body] = field(default_factory=dict)  # long functions that are written already, for the code of another step

    @cached_property
    def m(self) -> ca.SX:
        """The modes."""
        return ca.vertcat(*[e.mode for e in self.elements]) if self.elements else ca.SX(0, 1)

    @cached_property
    def force(self) -> ca.SX:
        """The multipliers."""
        return ca.vertcat(*[e.multiplier for e in self.elements]) if self.elements else ca.SX(0, 1)

    def function(self, name: str, *results: ca.SX) -> ca.Function:
        """A function (t, x, p, m) -> results."""
        return ca.Function(name, [self.t, self.x, self.p, self.m], list(results))

    @cached_property
    def rhs(self) -> ca.Function:
        """The slopes dx/dt."""
        return self.function("rhs", ca.densify(self.form.field))

    @cached_property
    def field(self) -> ca.Function:
        """Casadi Function for the slopes, guards and guard rates, in a single column."""
        return self.function("field", ca.vertcat(*map(ca.densify, (self.form.field, self.form.guards, self.form.guard_rates))))

    @cached_property
    def with_guards(self) -> ca.Function:
        """The slopes, and the guards."""
        return self.function("equations", ca.densify(self.form.field), ca.densify(self.form.guards))


class StepCode(NamedTuple):
    """The machine code of a step before it is compiled."""

    bodies: dict[str, Body]  # of `step`, and of `series` where the coefficients of a step are computed first
    texts: tuple[str, ...]  # the functions that they call
    cost: int  # number of instructions of one step
    slopes: int  # size of `Work.k`, what a step takes as slopes


@dataclass(frozen=True)
class Formulas:
    """Formulas of a step, which are implicit, explicit or a series, or of fixed length."""

    name: str
    order: int  # of the error at the end of a run
    power: float  # exponent of the step-size rule, for the error per unit step

    explicit: ClassVar[bool] = False  # a step is made of explicit stages, whose numbers are those of `RungeKutta`
    implicit: ClassVar[bool] = False  # fast modes that have died limit no step
    series: ClassVar[bool] = False  # a step is one polynomial in time for states and guards, so that none is rejected
    locates: ClassVar[bool] = True  # steps end on switches; else a switch is known to a step, and forces are means over it

    @property
    def two_errors(self) -> bool:
        """Whether a step has two estimates of its error."""
        return False

    @property
    def interpolates(self) -> bool:
        """Whether states inside a step are known as exactly as at its end."""
        return False

    @property
    def steps(self) -> str:
        """The kind of steps, in words."""
        return "explicit steps"

    @property
    def instead(self) -> Formulas:
        """Formulas for a plant that these formulas cannot step."""
        return self

    def step(self, equations: ClosedEquations) -> StepCode | str:
        """Write the step; or say why the plant has none, and `instead` is to be taken."""
        raise NotImplementedError

    def may_miss_peaks(self, equations: ClosedEquations) -> bool:
        """Return whether a step without a bound on its length may pass over a short peak in time."""
        return True
