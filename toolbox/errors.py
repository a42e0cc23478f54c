"""Errors that a caller may want to catch."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NoReturn


def check_version(package: str) -> None:
    """Raise ImportError, with the version that works, where a package is older than the one that the toolbox declares to need; it breaks in its own words."""
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
    """Import a package that only an extra installs; raises ImportError that says how to get it."""
    from importlib import import_module

    try:
        return import_module(package)
    except ImportError:
        raise ImportError(f"{what} needs {package}: pip install -e '.[{extra}]' in the folder of the toolbox.") from None


def no_array(value: Any, instead: str) -> NoReturn:
    """Raise TypeError for a value of which numpy would make an array without shape that holds nothing but it."""
    raise TypeError(f"A {type(value).__name__} is not one array: {instead}.")


def _release(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".")[:3] if part.isdigit())


class SceneError(ValueError):
    """A plant, a scene or an argument that cannot be simulated as it stands; the message names the argument and what must hold."""


class NoSteadyState(SceneError):
    """A plant that has no steady state at the numbers asked, or none that was found."""


class UnusualValue(UserWarning):
    """A number that is outside of what its field calls usual, as where it was meant in another unit; the message names both readings.

    `warnings.simplefilter("ignore", UnusualValue)` is for those who mean it.
    """


class SimulationError(RuntimeError):
    """A run that could not be finished. `run` is the trajectory up to the failure (None where nothing was computed)."""

    def __init__(self, message: str, run: Any = None):
        super().__init__(message)
        self.run = run

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.run)


class ZenoError(SimulationError):
    """Endlessly many events in a time too short to resolve."""


class NoModes(SimulationError):
    """An instant at which no modes of the elements are consistent with the forces."""


class ControllerError(SimulationError):
    """A controller whose command, or whose memory, is not a finite number; the message names the controller, the signal and the time."""


class BudgetError(SimulationError):
    """A run that used up its `Budget` of steps, events or seconds."""


class AccuracyError(SimulationError):
    """A method that cannot reach the accuracy asked; `run` is the best it did, and its `error` says how good that is."""


class GrazingError(SimulationError):
    """An event at which a run has no derivative: a guard that touches zero without crossing it, or two that reach zero at one instant."""


def listed(names: Iterable[str], most: int = 30) -> str:
    """Return names between marks for a message, at most so many, and each in at most a hundred characters: a file may hold any number of any length."""
    names = list(names)
    told = ", ".join(f"`{name if len(name) <= 100 else name[:100] + '...'}`" for name in names[:most])
    return told + (f" and {len(names) - most} more" if len(names) > most else "")


def suggest(name: str, known: Iterable[str]) -> str:
    """Return the end of an error message about an unknown name: the nearest known names."""
    import difflib  # here, because few programs need it

    known = sorted(set(known))
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.5) if isinstance(name, str) else []
    if near:
        return "did you mean " + " or ".join(f"`{word}`" for word in near) + "?"
    if not known:
        return "none is known."
    return f"known are {listed(known)}."
