"""Arguments of the verbs: each is returned as it is used, or refused by a SceneError that names it and says what it must be."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping, Sequence, Sized
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.errors import SceneError
from toolbox.files.units import TypedNumber, in_si
from toolbox.files.units import is_finite_number as is_finite_number

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    BoolArray = NDArray[np.bool_]
else:
    FloatArray = BoolArray = np.ndarray
    """What results hold: arrays of floats and of truths, as a type checker sees them."""


def count_of(size: int | None) -> int:
    """Return how many numbers a parameter or state has: 1 if its size is None (a scalar), else its size, which may be 0 for an empty tuple."""
    return 1 if size is None else size


def mapping(word: str, given: Any) -> dict[str, Any]:
    """A mapping of names to values as a dictionary, empty for None."""
    if given is not None and not (isinstance(given, Mapping) and all(isinstance(name, str) for name in given)):
        raise SceneError(f"Argument `{word}` must map names to values, but it is {given!r}.")
    return dict(given or {})


def number(
    word: str,
    given: Any,
    unit: str = "1",
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
) -> float:
    """Return a finite number within bounds.

    Parameters
    ----------
    word
        What the argument is called in messages.
    given
        A number in the unit, of Python or of numpy, or text with a unit that fits, such as "220 rpm".
    unit
        The unit of the result, such as "rad/s".
    above, at_least, below, at_most
        Bounds in that unit: >, >=, < and <=; None for none.

    Raises
    ------
    SceneError
        Where the argument is no finite number, out of bounds, or in a unit that does not fit.
    """
    value = in_si(given, unit, word)
    refuse(f"Argument `{word}`", value, unit, {"above": above, "at_least": at_least, "below": below, "at_most": at_most})
    return _plain(value)


def _plain(value: Any) -> float:
    """A number as a float, which remembers its unit where it was typed."""
    return value if isinstance(value, TypedNumber) else float(value)


def numbers(word: str, given: Any, unit: str = "1", **bounds: float) -> list[float]:
    """A row of numbers, each as `number` takes it."""
    if not isinstance(given, Iterable) or isinstance(given, (str, bytes, Mapping)):
        raise SceneError(f"Argument `{word}` must be a row of finite numbers, but it is {short(given)}.")
    return [number(word, value, unit, **bounds) for value in given]


def whole(word: str, given: Any, at_least: int, at_most: int | None = None) -> int:
    """An integer within bounds, of Python or of numpy."""
    counted = isinstance(given, (int, np.integer)) and not isinstance(given, bool)
    if not counted or given < at_least or (at_most is not None and given > at_most):
        raise SceneError(
            f"Argument `{word}` must be an integer >= {at_least}{'' if at_most is None else f' and <= {at_most}'}, but it is {short(given)}."
        )
    return int(given)


def entries(word: str, given: Sized | None, size: int, each: str) -> None:
    """Raise SceneError unless a row that is given has `size` entries; `each` says in the message which, as in ", one per spring"."""
    if given is not None and len(given) != size:
        raise SceneError(f"Argument `{word}` must have {size} entries{each}, but it has {len(given)}.")


_BOUNDS = {"above": (operator.gt, ">"), "at_least": (operator.ge, ">="), "below": (operator.lt, "<"), "at_most": (operator.le, "<=")}


def within(value: Any, bounds: Mapping[str, Any]) -> bool:
    """Whether a value is a finite number within {"above", "at_least", "below" or "at_most": bound or None}, as a `quantity` declares them."""
    return is_finite_number(value) and all(holds(value, bounds[key]) for key, (holds, _) in _BOUNDS.items() if bounds.get(key) is not None)


def refuse(subject: str, value: Any, unit: str, bounds: Mapping[str, Any]) -> None:
    """Raise SceneError, in which the subject begins the sentence, unless a value is a finite number `within` bounds in this unit."""
    if within(value, bounds):
        return
    words = " and ".join(f"{sign} {bounds[key]:.6g}" for key, (_, sign) in _BOUNDS.items() if bounds.get(key) is not None)
    must = words if words and is_finite_number(value) else f"a finite number {words}".strip()
    of_unit = "" if unit == "1" else f" {unit}" if words else f" in {unit}"
    raise SceneError(f"{subject} must be {must}{of_unit}, but it is {short(value.item() if isinstance(value, np.generic) else value)}.")


def finite_array(value: Any) -> np.ndarray | None:
    """Numbers as a float array, or None where they are not finite real numbers."""
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "iuf":
            return None
        array = np.array(raw, float)
    except (TypeError, ValueError, OverflowError, NotImplementedError, RuntimeError):
        return None
    return array if np.isfinite(array).all() else None


def array(word: str, given: Any, shape: Sequence[int | range | None], at_least: float | None = None) -> np.ndarray:
    """Finite numbers of a shape, in which a range is what a length may be and None any length, dense or sparse; each at least a bound."""
    found = finite_array(given.toarray() if hasattr(given, "toarray") else given)
    lengths = () if found is None else found.shape
    fits = len(lengths) == len(shape) and all(
        must is None or n == must or (isinstance(must, range) and n in must) for n, must in zip(lengths, shape, strict=True)
    )
    if found is None or not fits or (at_least is not None and (found < at_least).any()):
        words = ["any" if must is None else f"{must[0]} to {must[-1]}" if isinstance(must, range) else str(must) for must in shape]
        bound = "" if at_least is None else f" >= {at_least:g}"
        has = "entries that are not finite numbers" if found is None else f"one of {found.min():g}" if fits else f"the shape {found.shape}"
        raise SceneError(
            f"Argument `{word}` must be finite numbers{bound} of the shape ({', '.join(words)}{',' * (len(words) == 1)}), but it has {has}."
        )
    return found


def symmetric(word: str, matrix: np.ndarray) -> np.ndarray:
    """A square matrix that is symmetric but for round-off."""
    if np.abs(matrix - matrix.T).max() > 1e-9 * np.abs(matrix).max():
        raise SceneError(f"Argument `{word}` must be symmetric, but entries differ by {np.abs(matrix - matrix.T).max():.2g}.")
    return matrix


def checked_range(bounds: Any, word: str = "bounds", unit: str = "1") -> tuple[float, float]:
    """(low, high) of a range, numbers or text in the unit; raises SceneError unless it is two finite numbers in that order."""
    ends = in_si(bounds, unit, word)
    try:
        low, high = ends
    except (TypeError, ValueError):
        low, high = None, None
    if not is_finite_number(low) or not is_finite_number(high) or not low < high:
        raise SceneError(f"Argument `{word}` must be two finite numbers (low, high) with low < high, but it is {short(bounds)}.")
    return _plain(low), _plain(high)


def short(value: Any) -> str:
    """A value as it stands in an error message, cut where it is long."""
    text = repr(value)
    return text if len(text) < 60 else text[:56] + " ..."
