"""Numbers of a loop that are known as distributions: normal, uniform, log-normal, or draws such as those of a posterior.

    sweep(loop, drawn(loop, {"bit.weight": "97 kN +- 8 kN", "bit.friction.static": Uniform(0.6, 0.9)}, 1000), 120.0)

A distribution is cut at the bounds of its number, so that no weight is negative. Each number has a stream of random numbers of its own, which its name and the
seed decide: a further number that is uncertain does not change the draws of the others.
"""

from __future__ import annotations

import dataclasses
import re
import zlib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray, checked_range, finite_array, number, short, whole
from toolbox.errors import SceneError
from toolbox.files.unit_systems import asked_in
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop, as_loop
from toolbox.modelling.numbers import Number
from toolbox.sweeps.designs import Variations
from toolbox.vocabulary import Renamed, new_names_only

LEAST_INSIDE = 0.5
"""Part of a distribution that must lie within the bounds of its number."""


class Distribution(ABC):
    """What is known of one number; `Normal`, `Uniform` and `LogNormal` are distributions."""

    @abstractmethod
    def frozen(self, name: str, unit: str) -> Any:
        """The distribution of scipy.stats in SI; name: of the number, for messages;  unit: of the number."""

    def display_units(self, unit: str) -> str:
        """The unit in which the first of its numbers was typed; empty where it was given in SI."""
        first = getattr(self, dataclasses.fields(self)[0].name)  # type: ignore[arg-type]
        return asked_in(number("unit", first, unit), "") if isinstance(first, str) else ""


@dataclass(frozen=True)
class Normal(Distribution):
    """Normal distribution.

    Parameters
    ----------
    mean
        Mean, in SI or text with a unit.
    deviation
        Standard deviation, in SI or text with a unit, > 0.

    Examples
    --------
    >>> from toolbox.probability import Normal
    >>> print(Normal("97 kN", "8 kN").mean)
    97 kN
    """

    mean: NumberOrText
    deviation: NumberOrText

    def frozen(self, name: str, unit: str) -> Any:
        from scipy import stats

        mean = number(f"mean` of `{name}", self.mean, unit)
        return stats.norm(mean, number(f"deviation` of `{name}", self.deviation, unit, above=0))


@dataclass(frozen=True)
class Uniform(Distribution):
    """Uniform distribution.

    Parameters
    ----------
    low, high
        Ends of the range, in SI or text with a unit.

    Examples
    --------
    >>> from toolbox.probability import Uniform
    >>> print(Uniform("80 kN", "110 kN").high)
    110 kN
    """

    low: NumberOrText
    high: NumberOrText

    def frozen(self, name: str, unit: str) -> Any:
        from scipy import stats

        low, high = checked_range((self.low, self.high), name, unit)
        return stats.uniform(low, high - low)


@dataclass(frozen=True)
class LogNormal(Distribution):
    """Log-normal distribution: the logarithm of the number is normal.

    Parameters
    ----------
    median
        Median, in SI or text with a unit, > 0.
    deviation
        Standard deviation of the natural logarithm [1], > 0. 0.1 is about 10 %.

    Examples
    --------
    >>> from toolbox.probability import LogNormal
    >>> print(LogNormal(50.0, 0.2).median)
    50.0
    """

    median: NumberOrText
    deviation: NumberOrText

    def frozen(self, name: str, unit: str) -> Any:
        from scipy import stats

        median = number(f"median` of `{name}", self.median, unit, above=0)
        return stats.lognorm(number(f"deviation` of `{name}", self.deviation, above=0), scale=median)


@dataclass(frozen=True)
class Draws(Renamed):
    """Draws of the joint distribution of several numbers, such as the draws of a posterior.

    Parameters
    ----------
    values
        {name: draws in SI}, rows of equal length. Values at the same place belong to the same draw.
    independent
        {name: distribution} of additional numbers that are independent of these draws.

    Examples
    --------
    >>> from toolbox.probability import Draws
    >>> draws = Draws({"bit.weight": [95e3, 97e3, 99e3], "bit.friction.static": [0.82, 0.80, 0.78]})
    >>> print(len(draws.values["bit.weight"]), "draws of", len(draws.values), "numbers")
    3 draws of 2 numbers
    """

    values: Mapping[str, Sequence[float]]
    independent: Mapping[str, Any] = field(default_factory=dict)

    def also(self, others: Mapping[str, Any]) -> Draws:
        """Return these draws together with additional independent numbers {name: distribution}.

        Parameters
        ----------
        others
            {name: distribution} of the additional numbers.
        """
        return Draws(self.values, {**self.independent, **others})


def distribution(name: str, given: Any) -> Distribution:
    """What an argument says of a number: a distribution as it is, and text such as "97 kN +- 8 kN" or "97 kN +- 8 %" as a normal one.

    Raises SceneError for anything else.
    """
    if isinstance(given, Distribution):
        return given
    parts = re.split(r"\s*(?:\+-|\+/-|±)\s*", given) if isinstance(given, str) else []
    if len(parts) != 2:
        raise SceneError(f"Argument `{name}` must be a distribution, or text such as `97 kN +- 8 kN`, but it is {short(given)}.")
    mean, deviation = parts
    unit = re.sub(r"^[-+]?[0-9_.]+(?:[eE][-+]?[0-9]+)?\s*", "", deviation).strip()
    bare = re.fullmatch(r"[-+]?[0-9_.]+(?:[eE][-+]?[0-9]+)?", mean.strip())
    if bare and unit and unit != "%":
        mean = f"{mean} {unit}"
    if not bare and not unit:
        raise SceneError(
            f"Argument `{name}` must say the unit of its deviation, as in `97 kN +- 8 kN` or `97 +- 8 kN`, but it is `{given}`."
        )
    if unit == "%":
        size = re.match(r"[-+]?[0-9_.]+(?:[eE][-+]?[0-9]+)?", mean.strip())
        if size is not None:
            part = number(f"deviation` of `{name}", deviation, "1", above=0)
            deviation = f"{abs(float(size[0])) * part!r}{mean.strip()[size.end() :]}"
    return Normal(_plain(mean), _plain(deviation))


@new_names_only
def drawn(loop: ClosedLoop | Any, uncertainty: Mapping[str, Any] | Draws, runs: int, seed: int = 0) -> Variations:
    """Draw uncertain numbers at random, as a design of experiments for `sweep`.

    Parameters
    ----------
    loop
        A loop, or a plant, with these numbers.
    uncertainty
        {name: distribution} of independent numbers, each `Normal`, `Uniform`, `LogNormal`, or text such as "97 kN +- 8
        kN" with the standard deviation of a normal distribution. Or `Draws` of numbers that are known together, such as
        `found.drawn` of a posterior. `found.drawn.also({"bit.weight": "97 kN +- 8 kN"})` adds independent numbers. A
        distribution is cut at the bounds of its number.
    runs
        Number of draws, >= 1.
    seed
        Seed of the random numbers, by default 0.

    Returns
    -------
    Variations
        One row per draw.

    Raises
    ------
    SceneError
        If a name is unknown or a sample time, a value is no distribution, or more than half of a distribution is out
        of the bounds of its number.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.probability import drawn
    >>> design = drawn(compose(wells.JANSEN_2, BitRock()), {"bit.weight": "97 kN +- 8 kN"}, runs=1000)
    >>> print(f"{design.points.mean() / 1e3:.0f} kN")
    97 kN
    """
    loop = as_loop(loop)
    whole("runs", runs, 1)
    whole("seed", seed, 0)
    if isinstance(uncertainty, Draws):
        made = _resampled(loop, uncertainty, runs, seed)
        if not uncertainty.independent:
            return made
        more = drawn(loop, uncertainty.independent, runs, seed)
        if twice := [name for name in more.names if name in made.names]:
            raise SceneError(f"Argument `independent` of `Draws` must name other numbers than the draws, but it has `{twice[0]}`.")
        return Variations((*made.names, *more.names), np.hstack([made.points, more.points]), (runs,), display_units=more.display_units)
    if not isinstance(uncertainty, Mapping) or not uncertainty:
        raise SceneError(f"Argument `uncertainty` must map at least one name to a distribution, but it is {short(uncertainty)}.")
    numbers = [loop.number(name) for name in uncertainty]
    if len({each.name for each in numbers}) < len(numbers):
        raise SceneError("Argument `uncertainty` must name every number once.")
    columns, asked = [], {}
    for each, given in zip(numbers, uncertainty.values(), strict=True):
        known = distribution(each.name, given)
        uniform = np.random.default_rng([seed, zlib.crc32(each.name.encode())]).random(runs)
        columns.append(quantiles(each, known, uniform))
        if unit := known.display_units(each.unit):
            asked[each.name] = unit
    return Variations(tuple(each.name for each in numbers), np.stack(columns, axis=1), (runs,), display_units=asked)


def quantiles(each: Number, known: Distribution, uniform: FloatArray) -> FloatArray:
    """Draws of a number, by its cumulative distribution between its bounds."""
    frozen = known.frozen(each.name, each.unit)
    floors = [bound for key in ("above", "at_least") if (bound := each.bounds.get(key)) is not None]
    roofs = [bound for key in ("below", "at_most") if (bound := each.bounds.get(key)) is not None]
    low = float(frozen.cdf(max(floors))) if floors else 0.0
    high = float(frozen.cdf(min(roofs))) if roofs else 1.0
    if high - low < LEAST_INSIDE:
        raise SceneError(
            f"Argument `{each.name}` must have a distribution within the bounds of the number, but {100 * (1 - high + low):.3g} % of it lie outside."
        )
    found: FloatArray = frozen.ppf(low + (high - low) * np.clip(uniform, 1e-12, 1 - 1e-12))
    return found


def _resampled(loop: ClosedLoop, known: Draws, runs: int, seed: int) -> Variations:
    """Draws with replacement out of draws."""
    values = {loop.number(name).name: finite_array(row) for name, row in dict(known.values).items()}
    rows = [row for row in values.values() if row is not None and row.ndim == 1 and row.size]
    if not values or len(rows) < len(values) or len({row.size for row in rows}) > 1:
        raise SceneError("Argument `values` of `Draws` must map names to rows of finite numbers of equal length, but it does not.")
    table = np.stack(rows, axis=1)
    place = np.random.default_rng([seed, zlib.crc32(b"draws")]).integers(len(table), size=runs)
    return Variations(tuple(values), table[place], (runs,))


def told(name: str, given: Any, unit: str = "1") -> str:
    """What is known of a number, in words; unit: that of what was given as numbers, where nothing beside the words says it."""
    known = distribution(name, given)
    if isinstance(known, Normal):
        tail = "" if unit == "1" or isinstance(known.deviation, str) else f" {unit}"
        return f"{_short(known.mean)} +- {_short(known.deviation)}{tail}"
    if isinstance(known, Uniform):
        return f"{_short(known.low)} to {_short(known.high)}"
    return ", ".join(f"{each.name} {_short(getattr(known, each.name))}" for each in dataclasses.fields(known))  # type: ignore[arg-type]


def known_as(uncertain: Mapping[str, Any] | Draws, names: Sequence[str], draws: int) -> dict[str, str]:
    """{name: what is known of it, in words} of what `drawn` takes."""
    apart = uncertain.independent if isinstance(uncertain, Draws) else uncertain
    told_of = {name: told(name, each) for name, each in apart.items()}
    joint = names[: len(uncertain.values)] if isinstance(uncertain, Draws) else ()
    return dict.fromkeys(joint, f"{draws} draws") | told_of


def _short(given: NumberOrText) -> str:
    """A number in six digits, and text as it is."""
    return given if isinstance(given, str) else f"{given:.6g}"


def _plain(text: str) -> NumberOrText:
    """A number where text is one, so that it is taken in SI."""
    try:
        return float(text)
    except ValueError:
        return text
