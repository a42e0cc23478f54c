"""Which runs a sweep makes: grids, lists of one's own, random, Latin hypercube and Sobol designs over several numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import checked_range, finite_array, whole
from toolbox.errors import SceneError
from toolbox.files.unit_systems import asked_in
from toolbox.vocabulary import new_names_only


@dataclass(frozen=True)
class Variations:
    """Design of experiments for `sweep`: values of several numbers, one row per run. `grid`, `listed`, `uniform`,
    `latin_hypercube` and `sobol` make it.

    Attributes
    ----------
    names
        Names of the numbers.
    points
        Their values, shape (runs, names).
    shape
        Shape of the results: the lengths of the axes for a grid, else (runs,).
    axes
        Values along each axis of a grid.
    display_units
        {name: unit in which its values were typed}.

    Examples
    --------
    >>> from toolbox.sweeps import grid
    >>> design = grid({"bit.weight": [90e3, 100e3], "top.reference": [8.0, 10.0, 12.0]})
    >>> print(design.names, design.points.shape)
    ('bit.weight', 'top.reference') (6, 2)
    """

    names: tuple[str, ...]
    points: np.ndarray
    shape: tuple[int, ...]
    axes: tuple[np.ndarray, ...] = ()
    display_units: Mapping[str, str] = field(default_factory=dict)


def grid(axes: Mapping[str, Any]) -> Variations:
    """Return every combination of the values of all names, as a design of experiments for `sweep`.

    Parameters
    ----------
    axes
        {name: values}. The first name varies slowest.

    Returns
    -------
    Variations
        One row per combination.

    Raises
    ------
    SceneError
        If the values of a name are no row of numbers.

    Examples
    --------
    >>> from toolbox.sweeps import grid
    >>> design = grid({"bit.weight": [90e3, 100e3, 110e3], "top.reference": [8.0, 10.0]})
    >>> print(design.points.shape)
    (6, 2)
    """
    values = []
    for name, row in axes.items():
        array = finite_array(row)
        if array is None or array.ndim != 1 or not array.size:
            raise SceneError(f"Argument `{name}` must be a list of finite numbers, such as [1.0, 2.0], but it is {row!r}.")
        values.append(array)
    if not values:
        raise SceneError("Argument `ranges` must name at least one number, but it is empty.")
    mesh = np.meshgrid(*values, indexing="ij")
    return Variations(tuple(axes), np.stack([each.ravel() for each in mesh], axis=1), mesh[0].shape, tuple(values), _asked(axes))


def listed(rows: Any) -> Variations:
    """Return a design of experiments for `sweep` with one run per row of a table.

    Parameters
    ----------
    rows
        A sequence of {name: value}, all with the same names. Or a table with named columns (pandas).

    Returns
    -------
    Variations
        One row per run.

    Examples
    --------
    >>> from toolbox.sweeps import listed
    >>> design = listed([{"bit.weight": 90e3, "top.reference": 8.0}, {"bit.weight": 110e3, "top.reference": 10.0}])
    >>> print(design.points.shape)
    (2, 2)
    """
    if hasattr(rows, "to_dict") and hasattr(rows, "columns"):
        rows = rows.to_dict("records")
    rows = list(rows)
    if not rows or not all(isinstance(row, Mapping) and row.keys() == rows[0].keys() and row for row in rows):
        raise SceneError("Argument `ranges` must be rows that all give numbers to the same names, but it is not.")
    names = tuple(rows[0])
    points = finite_array([[row[name] for name in names] for row in rows])
    if points is None or points.ndim != 2:
        raise SceneError("Argument `ranges` must hold finite numbers only, but it does not.")
    return Variations(names, points, (len(rows),), display_units=_asked({name: [row[name] for row in rows] for name in names}))


@new_names_only
def uniform(ranges: Mapping[str, tuple[float, float]], runs: int, seed: int = 0) -> Variations:
    """Return independent uniform random numbers as a design of experiments for `sweep`.

    Parameters
    ----------
    ranges
        {name: (low, high)} of the numbers that vary.
    runs
        Number of runs.
    seed
        Seed of the random numbers, by default 0.

    Returns
    -------
    Variations
        One row per run.

    Examples
    --------
    >>> from toolbox.sweeps import uniform
    >>> design = uniform({"bit.weight": (90e3, 110e3)}, runs=5)
    >>> print(design.points.shape, bool((design.points >= 90e3).all()))
    (5, 1) True
    """
    return _scaled(ranges, runs, seed, lambda: np.random.default_rng(seed).random((runs, len(ranges))))


@new_names_only
def latin_hypercube(ranges: Mapping[str, tuple[float, float]], runs: int, seed: int = 0) -> Variations:
    """Return a Latin hypercube as a design of experiments for `sweep`.

    Every range is divided into `runs` equal parts, and each part holds exactly one value (scipy.stats.qmc).

    Parameters
    ----------
    ranges
        {name: (low, high)} of the numbers that vary.
    runs
        Number of runs.
    seed
        Seed of the random numbers, by default 0.

    Returns
    -------
    Variations
        One row per run.

    Examples
    --------
    >>> from toolbox.sweeps import latin_hypercube
    >>> design = latin_hypercube({"bit.weight": (90e3, 110e3), "top.reference": (8.0, 12.0)}, runs=10)
    >>> print(design.points.shape, sorted((design.points[:, 1] - 8.0) // 0.4) == list(range(10)))
    (10, 2) True
    """

    def unit() -> np.ndarray:
        from scipy.stats import qmc

        return qmc.LatinHypercube(len(ranges), rng=seed).random(runs)

    return _scaled(ranges, runs, seed, unit)


@new_names_only
def sobol(ranges: Mapping[str, tuple[float, float]], runs: int, seed: int = 0) -> Variations:
    """Return a scrambled Sobol sequence as a design of experiments for `sweep` (scipy.stats.qmc).

    Parameters
    ----------
    ranges
        {name: (low, high)} of the numbers that vary.
    runs
        Number of runs. The sequence is balanced only if this number is a power of two.
    seed
        Seed of the scrambling, by default 0.

    Returns
    -------
    Variations
        One row per run.

    Examples
    --------
    >>> from toolbox.sweeps import sobol
    >>> design = sobol({"bit.weight": (90e3, 110e3), "top.reference": (8.0, 12.0)}, runs=16)
    >>> print(f"{design.points[:, 1].mean():.1f} rad/s")
    10.0 rad/s
    """

    def unit() -> np.ndarray:
        from scipy.stats import qmc

        if runs & (runs - 1):
            raise SceneError(f"Argument `runs` must be a power of two for a Sobol sequence, but it is {runs}.")
        return qmc.Sobol(len(ranges), rng=seed).random(runs)

    return _scaled(ranges, runs, seed, unit)


def _scaled(bounds: Any, runs: int, seed: int, unit: Callable[[], np.ndarray]) -> Variations:
    """Points of the unit cube between bounds, once all arguments are sound."""
    if not isinstance(bounds, Mapping) or not bounds:
        raise SceneError(f"Argument `ranges` must map at least one name to (low, high), but it is {bounds!r}.")
    whole("runs", runs, 1)
    whole("seed", seed, 0)
    low, high = np.array([checked_range(pair, name) for name, pair in bounds.items()]).T
    return Variations(tuple(bounds), low + (high - low) * unit(), (runs,), display_units=_asked(bounds))


def _asked(values: Mapping[str, Any]) -> dict[str, str]:
    """{name: unit that was typed} of values {name: row}."""
    return {name: unit for name, row in values.items() if (unit := asked_in(row, ""))}


def variations_of(vary: Any) -> Variations:
    """Return the argument as variations: a design is unchanged, {name: values} becomes a grid, anything else is taken as rows."""
    if isinstance(vary, Variations):
        return vary
    if isinstance(vary, Mapping):
        return grid(vary)
    if isinstance(vary, str) or not isinstance(vary, Iterable):
        raise SceneError(f"Argument `ranges` must map names to values, or be rows or `Variations`, but it is {vary!r}.")
    return listed(vary)
