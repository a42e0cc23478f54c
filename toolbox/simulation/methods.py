"""Methods of simulation: values with their own options, each with a plain string as its short form.

"event"          EventExact()       adaptive steps that end on every switch, of the kind that is the fastest (`toolbox.simulation.method_choice`)
"explicit"       Explicit()         the same with explicit steps only
"taylor"         TaylorSeries()     the same with Taylor series of high order
"stiff"          Implicit()         the same with linearly implicit steps only
"time-stepping"  TimeStepping()     fixed steps (Moreau and Jean), refined until the accuracy is met unless `step` is given
"smoothed"       Smoothing()        regularised friction, refined until the accuracy is met unless `width` is given
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from toolbox.arguments import number, whole
from toolbox.compilation.formulas import Formulas
from toolbox.compilation.moreau_jean import MOREAU_JEAN
from toolbox.compilation.rosenbrock import RODAS5P
from toolbox.compilation.runge_kutta import DOP853, DOPRI5
from toolbox.compilation.taylor import Taylor
from toolbox.errors import SceneError
from toolbox.files.units import in_si
from toolbox.modelling.elements import OptionalQuantity, quantity
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.simulation.budget import UNHURRIED, Budget
from toolbox.simulation.method_choice import without_series


@dataclass(frozen=True)
class Method:
    """Method and budget of a run. A method is a value: two methods of the same kind and options are equal.

    Parameters
    ----------
    budget
        What a run may spend at most, an option of every method: `EventExact(budget=Budget(seconds=60))`.
    """

    text: ClassVar[str]  # the short form
    locates: ClassVar[bool] = True  # steps end on switches
    watches_stiffness: ClassVar[bool] = False  # a run that stability holds up changes to implicit steps
    in_lanes: ClassVar[bool] = False  # many runs may step side by side
    chooses: ClassVar[bool] = False  # the kind of steps follows from the run, which says why
    smooths: ClassVar[bool] = False  # friction is regularised
    finer: ClassVar[str] = ""  # how the option is written that refines a run
    budget: Budget = field(default=UNHURRIED, kw_only=True)

    def check(self, duration: float) -> None:
        """Raise SceneError for options with which a run of `duration` [s] cannot be stepped within the budget."""
        if not isinstance(self.budget, Budget):
            raise SceneError(f"Argument `budget` must be a Budget, such as Budget(seconds=60), but it is {self.budget!r}.")
        self.budget.check()

    def formulas(self, accuracy: float, system: HybridSystem) -> Formulas:
        """The formulas of a step of a closed system for an accuracy."""
        if system.updates:
            return DOP853 if accuracy < 1e-9 else DOPRI5
        return DOPRI5 if accuracy > 1e-5 else DOP853

    @property
    def refines(self) -> bool:
        """Whether runs are repeated with a finer option until two agree to the accuracy."""
        return False

    @property
    def alone(self) -> bool:
        """Whether every run has to be prepared by itself, so that it cannot follow another one in the same arrays."""
        return self.smooths or not self.locates

    def unwatched(self, accuracy: float, system: HybridSystem) -> Method:
        """The method for many runs of a closed system that are known not to be stiff."""
        return self

    @property
    def unhurried(self) -> Method:
        """The method without its budget."""
        return self if self.budget == UNHURRIED else dataclasses.replace(self, budget=UNHURRIED)

    @property
    def fixed_step(self) -> float | None:
        """Length of every step [s]; None if the accuracy determines it."""
        return None

    @property
    def own_tolerance(self) -> float | None:
        """Tolerance of the integrator; None if the accuracy of the run is used."""
        return None

    def __str__(self) -> str:
        given = {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if getattr(self, field.name) != field.default}
        options = ", ".join(f"{name}={value!r}" for name, value in given.items())
        return f"{self.text} ({options})" if options else self.text


@dataclass(frozen=True)
class EventExact(Method):
    """Adaptive steps that end exactly on every switch, of the kind that is fastest for the run.

    The kinds of steps are:

    - Taylor series or explicit formulas (`toolbox.simulation.method_choice` chooses between them);
    - linearly implicit formulas, if they are faster than explicit ones because the plant is stiff
      (`toolbox.simulation.stiffness`).

    `run.why` names the kind that was used and the reason.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import Budget, compose, simulate
    >>> from toolbox.simulation import EventExact
    >>> run = simulate(compose(BlockOnBelt()), "60 s", method=EventExact(budget=Budget(seconds=60)))
    >>> print(len(run.events), "events")
    11 events
    """

    text: ClassVar[str] = "event"
    watches_stiffness: ClassVar[bool] = True
    chooses: ClassVar[bool] = True

    def formulas(self, accuracy: float, system: HybridSystem) -> Formulas:
        """Return the formulas of a step for this accuracy and plant: Taylor series, or explicit formulas if a series is impossible.

        Parameters
        ----------
        accuracy
            Target for the global error of the run [1].
        system
            The plant with its controllers.
        """
        return self.unwatched(accuracy, system).formulas(accuracy, system)

    def unwatched(self, accuracy: float, system: HybridSystem) -> Method:
        """Return the method that is used while the plant is not stiff: Taylor series, or explicit formulas if a series is impossible.

        Parameters
        ----------
        accuracy
            Target for the global error of the run [1].
        system
            The plant with its controllers.
        """
        return Explicit() if without_series(accuracy, system) else TaylorSeries()


@dataclass(frozen=True)
class Explicit(Method):
    """Adaptive explicit steps that end exactly on every switch.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> from toolbox.simulation import EventExact, Explicit
    >>> print(len(simulate(compose(BlockOnBelt()), "60 s", method=Explicit()).events), "events")
    11 events
    """

    text: ClassVar[str] = "explicit"
    in_lanes: ClassVar[bool] = True


@dataclass(frozen=True)
class TaylorSeries(Method):
    """Taylor series of high order, in steps that end exactly on every switch (`toolbox.compilation.taylor`).

    In three cases the run uses other steps than Taylor series, and `run.why` names the case:

    - an operation of the plant has no series: explicit formulas, with a warning;
    - the series would be too long: explicit formulas, with a warning;
    - implicit steps are cheaper for reasons of stability: implicit steps.

    Parameters
    ----------
    order
        Order of the series, from 6 to 30. By default the order follows from the accuracy.
    budget
        Limits on the cost of a run, a `Budget`.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> from toolbox.simulation import TaylorSeries
    >>> print(len(simulate(compose(BlockOnBelt()), "60 s", method=TaylorSeries()).events), "events")
    11 events
    """

    text: ClassVar[str] = "taylor"
    watches_stiffness: ClassVar[bool] = True
    in_lanes: ClassVar[bool] = True
    order: int | None = None

    def check(self, duration: float) -> None:
        """Raise SceneError unless the order is a whole number from 6 to 30.

        Parameters
        ----------
        duration
            Length of the run [s].
        """
        super().check(duration)
        if self.order is not None:
            whole("order", self.order, 6, 30)

    def formulas(self, accuracy: float, system: HybridSystem) -> Formulas:
        """Return a Taylor series of the given order, or of the order that follows from the accuracy.

        Parameters
        ----------
        accuracy
            Target for the global error of the run [1].
        system
            The plant with its controllers.
        """
        return Taylor(self.order or 16)


@dataclass(frozen=True)
class Implicit(Method):
    """Adaptive linearly implicit steps that end exactly on every switch, for stiff plants.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> from toolbox.simulation import Implicit
    >>> print(len(simulate(compose(BlockOnBelt()), "60 s", method=Implicit()).events), "events")
    11 events
    """

    text: ClassVar[str] = "stiff"

    def formulas(self, accuracy: float, system: HybridSystem) -> Formulas:
        """Return RODAS5P, a linearly implicit method of order 5.

        Parameters
        ----------
        accuracy
            Target for the global error of the run [1].
        system
            The plant with its controllers.
        """
        return RODAS5P


@dataclass(frozen=True)
class TimeStepping(Method):
    """Constant time steps with implicit contact forces. No switch is located.

    Parameters
    ----------
    step
        Length of a step [s], or text with a unit. None (default) refines the step until the accuracy is met.
    budget
        Limits on the cost of a run, a `Budget`.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> from toolbox.simulation import TimeStepping
    >>> run = simulate(compose(BlockOnBelt()), "10 s", method=TimeStepping(step=1e-3))
    >>> print(run.time.size, "times")
    10001 times
    """

    text: ClassVar[str] = "time-stepping"
    locates: ClassVar[bool] = False
    finer: ClassVar[str] = "TimeStepping(step=...)"
    step: OptionalQuantity = quantity(None, "s", "length of a step")

    def __post_init__(self) -> None:
        object.__setattr__(self, "step", in_si(self.step, "s", "step"))

    def check(self, duration: float) -> None:
        """Raise SceneError unless the step is a positive number and long enough for the budget.

        Parameters
        ----------
        duration
            Length of the run [s].
        """
        super().check(duration)
        if self.step is not None:
            number("step", self.step, "s", above=0)
            number("step", self.step, "s", at_least=duration / self.budget.steps)

    def formulas(self, accuracy: float, system: HybridSystem) -> Formulas:
        """Return the theta method of Moreau and Jean.

        Parameters
        ----------
        accuracy
            Target for the global error of the run [1].
        system
            The plant with its controllers.
        """
        return MOREAU_JEAN

    @property
    def refines(self) -> bool:
        """Whether the run refines the step until the accuracy is met: True if no step is given."""
        return self.step is None

    @property
    def fixed_step(self) -> float | None:
        """The given length of a step [s]. None if the run refines the step."""
        return self.step


@dataclass(frozen=True)
class Smoothing(Method):
    """Dry friction replaced by a smooth function of the slip speed, integrated with a linearly implicit method.

    Parameters
    ----------
    width
        Slip speed, or {element: slip speed}, within which friction rises to its peak. None (default) refines the width
        until the accuracy is met.
    tolerance
        Tolerance of the integrator. By default a tolerance that resolves the width.
    budget
        Limits on the cost of a run, a `Budget`.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, measure, simulate
    >>> from toolbox.simulation import Smoothing
    >>> run = simulate(compose(BlockOnBelt()), "40 s", method=Smoothing(width=1e-3))
    >>> print(f"{measure.extent(run, 'block.position', after='20 s').maximum:.3f} m")
    1.129 m
    """

    text: ClassVar[str] = "smoothed"
    smooths: ClassVar[bool] = True
    finer: ClassVar[str] = "Smoothing(width=...)"
    width: float | Mapping[str, float] | None = None
    tolerance: float | None = None

    def formulas(self, accuracy: float, system: HybridSystem) -> Formulas:
        """Return RODAS5P, a linearly implicit method, because regularised friction is stiff.

        Parameters
        ----------
        accuracy
            Target for the global error of the run [1].
        system
            The plant with its controllers.
        """
        return RODAS5P

    @property
    def refines(self) -> bool:
        """Whether the run refines the width until the accuracy is met: True if no width is given."""
        return self.width is None

    @property
    def own_tolerance(self) -> float | None:
        """The given tolerance of the integrator. None if it follows from the width."""
        return self.tolerance


METHODS: dict[str, Method] = {kind.text: kind() for kind in (EventExact, Explicit, TaylorSeries, Implicit, TimeStepping, Smoothing)}
"""{short form: method with its default options}."""


def method_of(given: Any) -> Method:
    """A method from a value or its short form; raises SceneError for anything else."""
    if isinstance(given, Method):
        return given
    if isinstance(given, str) and given in METHODS:
        return METHODS[given]
    known = ", ".join(map(repr, METHODS))
    raise SceneError(f"Argument `method` must be one of {known}, or a value such as TimeStepping(step=1e-3), but it is {given!r}.")
