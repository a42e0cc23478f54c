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
    """Check an argument that is a number, and return it as a float.

    Parameters
    ----------
    word
        Name of the argument in messages.
    given
        A number in the unit, of Python or of numpy, or text with a unit that fits, such as "220 rpm".
    unit
        Unit of the result, such as "rad/s", by default "1".
    above, at_least, below, at_most
        Bounds in this unit: >, >=, < and <=. By default None: no bound.

    Returns
    -------
    float
        The number in the unit.

    Raises
    ------
    SceneError
        If the argument is no finite number, is out of bounds, or has a unit that does not fit.

    Examples
    --------
    >>> from toolbox.authoring import number
    >>> print(f"{number('reference', '60 rpm', 'rad/s', above=0.0):.4f}")
    6.2832
    """
    value = in_si(given, unit, word)
    refuse(f"Argument `{word}`", value, unit, {"above": above, "at_least": at_least, "below": below, "at_most": at_most})
    return _plain(value)


def _plain(value: Any) -> float:
    """A number as a float, which remembers its unit where it was typed."""
    return value if isinstance(value, TypedNumber) else float(value)


def numbers(word: str, given: Any, unit: str = "1", **bounds: float) -> list[float]:
    """Check an argument that is a row of numbers, and return it as floats.

    Parameters
    ----------
    word
        Name of the argument in messages.
    given
        A row of numbers in the unit, or of texts with a unit that fits.
    unit
        Unit of the result, by default "1".
    bounds
        Bounds `above`, `at_least`, `below` and `at_most` of every number, in this unit.

    Returns
    -------
    list of float
        The numbers in the unit.

    Raises
    ------
    SceneError
        If the argument is no row of finite numbers within the bounds.

    Examples
    --------
    >>> from toolbox.authoring import numbers
    >>> print(numbers("depths", ["1 km", 1500.0], "m", above=0.0))
    [1000.0, 1500.0]
    """
    if not isinstance(given, Iterable) or isinstance(given, (str, bytes, Mapping)):
        raise SceneError(f"Argument `{word}` must be a list of finite numbers, such as [1.0, 2.0], but it is {short(given)}.")
    return [number(word, value, unit, **bounds) for value in given]


def whole(word: str, given: Any, at_least: int, at_most: int | None = None) -> int:
    """Check an argument that is an integer, of Python or of numpy, and return it as an int.

    Parameters
    ----------
    word
        Name of the argument in messages.
    given
        The integer.
    at_least, at_most
        Bounds: >= and <=. By default None: no upper bound.

    Returns
    -------
    int
        The integer.

    Raises
    ------
    SceneError
        If the argument is no integer, or out of bounds.

    Examples
    --------
    >>> from toolbox.authoring import whole
    >>> print(whole("phases", 4, at_least=1))
    4
    """
    counted = isinstance(given, (int, np.integer)) and not isinstance(given, bool)
    if not counted or given < at_least or (at_most is not None and given > at_most):
        raise SceneError(
            f"Argument `{word}` must be an integer >= {at_least}{'' if at_most is None else f' and <= {at_most}'}, but it is {short(given)}."
        )
    return int(given)


def entries(word: str, given: Sized | None, size: int, each: str) -> None:
    """Check that a row has `size` entries.

    Parameters
    ----------
    word
        Name of the argument in messages.
    given
        The row. None is accepted.
    size
        Expected number of entries.
    each
        Text that the message adds after the expected number of entries, such as ", one per spring".

    Raises
    ------
    SceneError
        If the row has another number of entries.

    Examples
    --------
    >>> from toolbox import SceneError
    >>> from toolbox.authoring import entries
    >>> try:
    ...     entries("damping", [1.0, 2.0], 3, ", one per spring")
    ... except SceneError as error:
    ...     print(error)
    Argument `damping` must have 3 entries, one per spring, but it has 2.
    """
    if given is not None and len(given) != size:
        raise SceneError(f"Argument `{word}` must have {size} entries{each}, but it has {len(given)}.")


_BOUNDS = {"above": (operator.gt, ">"), "at_least": (operator.ge, ">="), "below": (operator.lt, "<"), "at_most": (operator.le, "<=")}


def within(value: Any, bounds: Mapping[str, Any]) -> bool:
    """Whether a value is a finite number within {"above", "at_least", "below" or "at_most": bound or None}, as a `quantity` declares them."""
    return is_finite_number(value) and all(holds(value, bounds[key]) for key, (holds, _) in _BOUNDS.items() if bounds.get(key) is not None)


def refuse(subject: str, value: Any, unit: str, bounds: Mapping[str, Any]) -> None:
    """Raise SceneError unless a value is a finite number `within` bounds in this unit. The message begins with the subject."""
    if within(value, bounds):
        return
    words = " and ".join(f"{sign} {bounds[key]:.6g}" for key, (_, sign) in _BOUNDS.items() if bounds.get(key) is not None)
    must = words if words and is_finite_number(value) else f"a finite number {words}".strip()
    of_unit = "" if unit == "1" else f" {unit}" if words else f" in {unit}"
    raise SceneError(f"{subject} must be {must}{of_unit}, but it is {short(value.item() if isinstance(value, np.generic) else value)}.")


def finite_array(value: Any) -> np.ndarray | None:
    """Return numbers as a float array, or None if they are not finite real numbers.

    Parameters
    ----------
    value
        Any object.

    Returns
    -------
    array or None
        The numbers. None if the object does not consist of finite real numbers.

    Examples
    --------
    >>> from toolbox.authoring import finite_array
    >>> print(finite_array([1, 2.5]), finite_array([1, "a"]))
    [1.  2.5] None
    """
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "iuf":
            return None
        array = np.array(raw, float)
    except (TypeError, ValueError, OverflowError, NotImplementedError, RuntimeError):
        return None
    return array if np.isfinite(array).all() else None


def array(word: str, given: Any, shape: Sequence[int | range | None], at_least: float | None = None) -> np.ndarray:
    """Check an argument that is an array, dense or sparse, and return it as floats.

    Parameters
    ----------
    word
        Name of the argument in messages.
    given
        The array.
    shape
        Expected shape. An entry may be a length, a range of lengths, or None for any length.
    at_least
        Lower bound of all entries. By default None: no bound.

    Returns
    -------
    array
        The array, with finite entries.

    Raises
    ------
    SceneError
        If the array does not have the expected shape, or an entry is not finite or below the bound.

    Examples
    --------
    >>> from toolbox.authoring import array
    >>> print(array("gains", [1, 2, 3], (3,), at_least=0.0))
    [1. 2. 3.]
    """
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
    """Check that a square matrix is symmetric up to round-off.

    Parameters
    ----------
    word
        Name of the argument in messages.
    matrix
        The matrix.

    Returns
    -------
    array
        The matrix.

    Raises
    ------
    SceneError
        If two mirrored entries differ by more than 1e-9 of the largest entry.

    Examples
    --------
    >>> import numpy as np
    >>> from toolbox.authoring import symmetric
    >>> print(symmetric("mass", np.array([[2.0, 1.0], [1.0, 2.0]])).shape)
    (2, 2)
    """
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
    """Return the text of a value for an error message. A long text is cut."""
    text = repr(value)
    return text if len(text) < 60 else text[:56] + " ..."
