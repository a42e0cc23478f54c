"""Errors that a caller may want to catch."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NoReturn


def check_version(package: str) -> None:
    """Check that an installed package is at least as new as the version that the toolbox declares.

    Parameters
    ----------
    package
        Name of the package.

    Raises
    ------
    ImportError
        If the package is older; the message gives the version that works.

    Examples
    --------
    >>> from toolbox.errors import check_version
    >>> print(check_version("numpy") is None)
    True
    """
    import re
    from importlib.metadata import PackageNotFoundError, requires, version

    try:
        declared, installed = requires("stickslip-toolbox") or [], version(package)
    except PackageNotFoundError:  # a source tree that is not installed declares nothing
        return
    least = next((found[1] for line in declared if (found := re.match(rf"{package}>=([0-9.]+)", line))), "0")
    if _release(installed) < _release(least):
        raise ImportError(f"{package} {installed} does not work with the toolbox: pip install '{package}>={least}'.")


def optional(package: str, what: str, extra: str) -> Any:
    """Import a package that only an extra installs.

    Parameters
    ----------
    package
        Name of the package.
    what
        Subject of the message: the feature that needs the package.
    extra
        The extra of the toolbox that installs it.

    Returns
    -------
    module
        The package.

    Raises
    ------
    ImportError
        If the package is not installed; the message gives the command that installs it.

    Examples
    --------
    >>> from toolbox.errors import optional
    >>> print(optional("math", "This example", "none").sqrt(4.0))
    2.0
    """
    from importlib import import_module

    try:
        return import_module(package)
    except ImportError:
        raise ImportError(f"{what} needs {package}: pip install -e '.[{extra}]' in the folder of the toolbox.") from None


def no_array(value: Any, instead: str) -> NoReturn:
    """Raise TypeError for an object that numpy would otherwise turn into an array without shape.

    Parameters
    ----------
    value
        The object.
    instead
        Advice: which arrays the object holds.

    Raises
    ------
    TypeError
        Always.

    Examples
    --------
    >>> from toolbox.errors import no_array
    >>> try:
    ...     no_array({"a": 1}, "take the array of one of its 1 names")
    ... except TypeError as error:
    ...     print(error)
    A dict is not one array: take the array of one of its 1 names.
    """
    raise TypeError(f"A {type(value).__name__} is not one array: {instead}.")


def _release(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".")[:3] if part.isdigit())


class SceneError(ValueError):
    """Error in a plant, a scene or an argument that makes the computation impossible. The message names the argument and the violated condition.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import SceneError, compose
    >>> try:
    ...     compose(BlockOnBelt(mass=-1.0))
    ... except SceneError as error:
    ...     print(error)
    Argument `block.mass` must be > 0 kg, but it is -1.0.
    """


class Unidentifiable(SceneError):
    """Error for numbers that the data do not determine.

    `names` are the names of these numbers, and `values` is {name: value} at the end of the search. `mute` is True if
    the numbers change no measured signal.

    Examples
    --------
    >>> from toolbox.errors import Unidentifiable
    >>> error = Unidentifiable("The data do not determine `bit.weight`.", ["bit.weight"], values={"bit.weight": 97e3})
    >>> print(error.names, error.values)
    ('bit.weight',) {'bit.weight': 97000.0}
    """

    def __init__(self, message: str, names: Iterable[str] = (), mute: bool = False, values: Any = None):
        super().__init__(message)
        self.names, self.mute, self.values = tuple(names), mute, dict(values or {})


class NoSteadyState(SceneError):
    """Error for a plant that has no steady state at the given numbers, or whose steady state was not found.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, equilibrium
    >>> from toolbox.errors import NoSteadyState
    >>> try:
    ...     equilibrium(closed_loop(compose(wells.JANSEN_2, BitRock()), inputs={"top.torque": 1.0}), mode={"bit": "slip+"})
    ... except NoSteadyState as error:
    ...     print(len(str(error)) > 20)
    True
    """


class UnusualValue(UserWarning):
    """Warning about a number outside the typical range of its field, for example because another unit was meant.

    The message names the value in the declared unit and in the unit that was perhaps meant. If the value is intended,
    use `warnings.simplefilter("ignore", UnusualValue)`.

    Examples
    --------
    >>> import warnings
    >>> from models import BitRock
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     rock = BitRock(weight=96.04)
    >>> print(rock.weight, "N,", len(caught), "warning")
    96.04 N, 1 warning
    """


class SimulationError(RuntimeError):
    """Error in a run that could not be finished. `run` is the trajectory up to the failure, or None if nothing was computed.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import Budget, SimulationError, compose, simulate
    >>> from toolbox.simulation import EventExact
    >>> try:
    ...     simulate(compose(BlockOnBelt()), "60 s", method=EventExact(budget=Budget(events=4)))
    ... except SimulationError as error:
    ...     print(f"{type(error).__name__} after {len(error.run.events)} events")
    BudgetError after 4 events
    """

    def __init__(self, message: str, run: Any = None):
        super().__init__(message)
        self.run = run

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.run)


class ZenoError(SimulationError):
    """Error for a run with so many events in a short time that the run cannot resolve them (Zeno behaviour). `run` is the trajectory so far.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from toolbox import Component, Equations, compose, simulate, state
    >>> from toolbox.errors import ZenoError
    >>> from toolbox.modelling import Hysteresis
    >>> @dataclass(frozen=True)
    ... class Tank(Component):
    ...     def equations(self, signal):
    ...         level = state("tank.level", "m")
    ...         drain = Hysteresis("drain", level, low=1.0, high=1.0, signal_unit="m")
    ...         return Equations(flow={level: 0.5 - drain.output}, elements=[drain])
    >>> try:
    ...     simulate(compose(Tank()), "5 s")
    ... except ZenoError as error:
    ...     print(error)
    Element `drain` switches without end at t = 2 s.
    """


class NoModes(SimulationError):
    """Error for a run that reaches an instant without any combination of modes consistent with the forces. `run` is the trajectory so far.

    Examples
    --------
    Two bodies meet their stops at 1 s. A lever doubles the force of each stop and pushes the other body into its own stop.

    >>> from toolbox import Component, Equations, UnilateralContact, compose, simulate, state
    >>> from toolbox.errors import NoModes
    >>> class Levers(Component):
    ...     def equations(self, signal):
    ...         x, y = state("left.position", "m"), state("right.position", "m")
    ...         v, w = state("left.speed", "m/s"), state("right.speed", "m/s")
    ...         a, b = UnilateralContact("a", x, v, restitution=0.0), UnilateralContact("b", y, w, restitution=0.0)
    ...         accelerations = {v: 1.0 - a.force + 2.0 * b.force, w: 1.0 - b.force + 2.0 * a.force}
    ...         return Equations(flow={x: v, y: w, **accelerations}, elements=[a, b])
    >>> try:
    ...     simulate(compose(Levers()), "2 s", start={"left.position": -0.5, "right.position": -0.5})
    ... except NoModes as error:
    ...     print(f"{error.run.end:.2f} s")
    1.00 s
    """


class ControllerError(SimulationError):
    """Error for a controller whose command or memory is not a finite number. The message names controller, signal and
    time. `run` is the trajectory so far.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> from toolbox.errors import ControllerError
    >>> try:
    ...     simulate(compose(BlockOnBelt()), "1 s", controller=lambda t, y: 0.0 if t < 0.45 else float("nan"), sample_time="0.1 s")
    ... except ControllerError as error:
    ...     print(f"{error.run.end:.1f} s")
    0.5 s
    """


class BudgetError(SimulationError):
    """Error for a run that used up its `Budget` of steps, events or seconds. `run` is the trajectory so far.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import Budget, compose, simulate
    >>> from toolbox.errors import BudgetError
    >>> from toolbox.simulation import EventExact
    >>> try:
    ...     simulate(compose(BlockOnBelt()), "60 s", method=EventExact(budget=Budget(events=4)))
    ... except BudgetError as error:
    ...     print(f"{len(error.run.events)} events in {error.run.end:.1f} s")
    4 events in 21.4 s
    """


class AccuracyError(SimulationError):
    """Error for a method that cannot reach the requested accuracy. `run` is the best run, and `run.error_estimate` its error.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> from toolbox.errors import AccuracyError
    >>> try:
    ...     simulate(compose(BlockOnBelt()), "20 s", method="time-stepping", accuracy=1e-9)
    ... except AccuracyError as error:
    ...     print(error.run.error_estimate > 1e-9, f"{error.run.end:.0f} s")
    True 20 s
    """


class GrazingError(SimulationError):
    """Error for a run without derivative, because one event of the run has no derivative.

    At such an event a guard (switching function) touches zero without crossing it, or two guards reach zero at the same
    instant.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from toolbox import Component, Equations, compose, sensitivity, simulate, state
    >>> from toolbox.errors import GrazingError
    >>> from toolbox.modelling import Hysteresis
    >>> @dataclass(frozen=True)
    ... class Swing(Component):
    ...     def equations(self, signal):
    ...         x, v = state("swing.position", "m"), state("swing.speed", "m/s")
    ...         switch = Hysteresis("switch", x, low=0.0, high=1.0 - 1e-15)
    ...         return Equations(flow={x: v, v: -x}, elements=[switch])
    >>> run = simulate(compose(Swing()), "2 s", start={"swing.speed": 1.0}, accuracy=1e-12)
    >>> try:
    ...     sensitivity(run, "swing.speed")
    ... except GrazingError as error:
    ...     print(str(error)[:14])
    At t = 1.57079
    """


def joined(names: Iterable[str], most: int = 30) -> str:
    """Return names between backquotes as text for an error message, at most a given number of names.

    Parameters
    ----------
    names
        The names. A name of more than a hundred characters is cut.
    most
        Largest number of names in the text, by default 30.

    Returns
    -------
    str
        The first names, and the number of names that are left out.

    Examples
    --------
    >>> from toolbox.errors import joined
    >>> print(joined(["time", "bit.speed", "top.speed"], most=2))
    `time`, `bit.speed` and 1 more
    """
    names = list(names)
    told = ", ".join(f"`{name if len(name) <= 100 else name[:100] + '...'}`" for name in names[:most])
    return told + (f" and {len(names) - most} more" if len(names) > most else "")


def suggest(name: str, known: Iterable[str]) -> str:
    """Return the end of an error message about an unknown name: the most similar known names.

    Parameters
    ----------
    name
        The unknown name.
    known
        The known names.

    Returns
    -------
    str
        A question with the most similar names, or a list of the known names.

    Examples
    --------
    >>> from toolbox.authoring import suggest
    >>> print(suggest("bit.sped", ["bit.speed", "top.speed", "bit.torque_2"]))
    did you mean `bit.speed` or `top.speed` or `bit.torque_2`?
    """
    import difflib  # here, because few programs need it

    known = sorted(set(known))
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.5) if isinstance(name, str) else []
    if near:
        return "did you mean " + " or ".join(f"`{word}`" for word in near) + "?"
    if not known:
        return "none is known."
    return f"known are {joined(known)}."
