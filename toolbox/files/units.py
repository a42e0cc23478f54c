"""Quantities with units at the border: `parse("97.3 kN", "N")` is 97300.0.

Why rad is more than a 1 here: as plain mathematics, 2 Hz and 2 rad/s are the same number, and the torque of a drill string set to one instead of the
other is wrong by 2 pi without any complaint. So an angle must be named wherever it decides the number; only beside a force, where
habit writes N m for N m/rad, it may be left out.

Why plain floats behind the border, and a table of common units before pint: pint would cost 170 ms at every start.
"""

from __future__ import annotations

import contextlib
import math
import os.path
import re
import reprlib
import sys
import unicodedata
import warnings
from decimal import Context, Decimal
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.errors import SceneError, UnusualValue, check_version, suggest
from toolbox.files.plain_units import plain

if TYPE_CHECKING:
    NumberOrText = float | Any  # to a type checker, because a function that has converted its argument goes on with a float of that name
else:
    NumberOrText = float | str
    """An argument that takes a number in SI or text with a unit."""

USUAL = (
    "1", "%", "rad", "deg", "s", "ms", "min", "h", "Hz", "kHz", "rad/s", "rad/s2", "deg/s", "rpm", "m", "mm", "km", "ft", "in", "m/s", "mm/s", "ft/s",
    "ft/h", "m/s2", "kg", "t", "lb", "N", "kN", "MN", "lbf", "klbf", "N/m", "kN/m", "N s/m", "N m", "kN m", "lbf ft", "klbf ft", "N m/rad", "kN m/rad",
    "N m/deg", "rad/m", "deg/30m", "deg/100ft", "N m s/rad", "kN m s/rad", "kg m2", "Pa", "kPa", "MPa", "bar", "psi", "s/rad", "s/m", "1/s",
    "J", "W", "kW", "hp", "K", "kg/m", "lb/ft", "kg/m3", "g/cm3", "lb/gal", "m3/s", "l/min", "gal/min",
)  # fmt: skip
"""Units that an error message may suggest."""

HABITS = {
    "1/min": "rpm", "min^-1": "rpm", "min-1": "rpm", "r/min": "rpm", "c/min": "rpm", "u/min": "rpm", "U/min": "rpm", "t": "t_force", "tonne": "t_force",
    "tonnes": "t_force", "lbf/ft": "lb/ft", "ppf": "lb/ft", "ppg": "lb/gal", "sg": "g/cm3", "gpm": "gal/min", "lpm": "l/min", "cfm": "ft3/min",
    "bpm": "bbl/min", '"': "in", "\N{RIGHT DOUBLE QUOTATION MARK}": "in", "\N{DOUBLE PRIME}": "in", "''": "in", "'": "ft",
    "\N{RIGHT SINGLE QUOTATION MARK}": "ft", "\N{PRIME}": "ft",
}  # fmt: skip
"""What drillers write for a speed of rotation, a force, the weight of a pipe or that of mud, a flow or a length, where that is what is wanted."""

OF_FORCE = (
    (r"\bk[ -](?=ft|lb)", "k"),  # k ft-lb
    (r"\b(k?ft)(?=lb)", r"\1 "),
    (r"\b(k?)lb[fs]?(?=ft\b)", r"\1lbf "),
    (r"\b(k?)lbs?\b", r"\1lbf"),
    (r"\bkg(?=\s*/\s*cm(?:2|²|\^2)$)", "kgf"),
)
"""Units of mass that habit writes for those of force, where only the force fits: 20 klb on the bit, 7400 ftlb, 210 kg/cm2."""

CASELESS = frozenset((
    "ft", "in", "inch", "inches", "kft", "lb", "lbs", "lbf", "lbm", "klb", "klbs", "klbf", "kip", "kips", "t", "tonne", "tonnes", "gal", "bbl", "bbls",
    "sec", "secs", "min", "hr", "hrs", "rev", "rpm", "psi", "ksi", "gpm", "lpm", "cfm", "bpm", "ppg", "ppf", "sg", "ftlb", "ftlbs", "ftlbf", "kftlb",
    "kftlbs", "kftlbf", "lbft", "lbfft", "klbft", "klbfft",
))  # fmt: skip
"""Words that are read in letters of any case, as no prefix in them has a meaning of its own in the other: unlike M and m."""

MISTAKEN = {
    "rad/s": ("rpm",), "rad": ("deg",), "m": ("mm", "in"), "N": ("kN", "klbf"), "N m": ("kN m", "klbf ft"), "N m/rad": ("kN m/rad",),
    "N m s/rad": ("kN m s/rad",), "kg m2": ("t m2",), "kg": ("t",), "Pa": ("MPa", "GPa"), "N/m": ("kN/m", "N/mm"), "s": ("ms",),
    "kg/m3": ("g/cm3",),
}  # fmt: skip
"""{unit of a field: units in which its number is often meant}; where none of them makes it usual, a warning names none."""

LONGEST = 400
"""Characters that a quantity may have: the longest number that is finite has 309 digits."""

_QUANTITY = re.compile(r"\s*([+-]?(?:[0-9][0-9_]*\.?[0-9_]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?)(?![0-9.])(.*)", re.DOTALL)
_FRACTION = re.compile(r"\s*([+-]?)(?:([0-9.]+)(?:\s+|\s*-\s*))?([0-9]+)/([0-9]+)(?![0-9.])(.*)", re.DOTALL)
"""A fraction, or a whole number and a fraction, and its unit: 7/8 in, 5 7/8 in, 5-7/8 in."""

_DOGLEG = re.compile(r"(deg|rad|°)\s*/\s*([1-9][0-9]{0,3})\s*(m|ft)")
"""An angle over so many metres or feet, as the severity of a dogleg is given."""

_UNIT = re.compile(r"[A-Za-zµμ°%_0-9\s*/^().·²³⁻¹-]*")
_SPELLINGS = [
    (r"(?<=[A-Za-zµμ°%²³0-9)])\s*\.\s*(?=[A-Za-zµμ°%(])", "*"),  # ft.lb, kg.m2
    (r"(?<=[A-Za-zµμ°%²³0-9)])\.(?=\s*(?:[/*·)]|$))", ""),  # in., ft./min
    (r"\b(?:tonnes?|t)[- ]force\b", "force_metric_ton"),
    (r"[·]", "*"),
    (r"²", "**2"),
    (r"³", "**3"),
    (r"°", "deg"),
    (r"(?<=[A-Za-z])\s*-\s*(?=[A-Za-z])", "*"),  # ft-lbf
    (r"\b(k|M|da)?Nm(?![A-Za-z])", r"\1N m"),  # pint reads Nm as something else
    (r"\b(k|M|da)?Nms(?![A-Za-z])", r"\1N m s"),
    (r"\bkgm(?![A-Za-z])", "kg m"),
    (r"\brevs?\b", "turn"),
    (r"\b(k?)lbm\b", r"\1lb"),  # pounds of mass, where those of force are lbf
    (r"\b(?:bbls?|barrels?)\b", "oil_barrel"),  # of 42 gal; pint reads one of 31.5 gal
    (r"(?<=[A-Za-z])\^?(-?\d)\b", r"**\1"),  # m2, s^-1
]
_STRAY_DOT = re.compile(r"\.(?![0-9])|[A-Za-z)]\s*\.")
"""A dot that is neither of a product, nor of an abbreviation, nor a decimal point."""


class TypedNumber(float):
    """A number in SI that was typed as text. It calculates as a float and keeps the typed unit for answers.

    unit: that of the number, as a part declares it, such as "rad/s";  asked: the one that was typed, in its usual spelling, such as "rpm".
    """

    unit: str
    display_units: str

    def __new__(cls, value: float, unit: str, display_units: str) -> TypedNumber:
        number = super().__new__(cls, value)
        number.unit, number.display_units = unit, display_units
        return number

    def __getnewargs__(self) -> tuple[float, str, str]:  # type: ignore[override]
        return float(self), self.unit, self.display_units


def parse(value: Any, unit: str, name: str = "value", instead: str | None = None) -> float:
    """Return the number of a quantity in a unit: a number passes unchanged, a text such as "97.3 kN" is converted, to a `TypedNumber`.

    Parameters
    ----------
    value
        A finite real number, or text of a number and its unit.
    unit
        The unit of the result, as a part declares it, for example "N m s/rad".
    name
        What error messages call the argument.
    instead
        Another unit that text may be in, whose number then stands for one in `unit`.

    Raises
    ------
    SceneError
        Where the value is no finite number, has no unit, an unknown unit, or one that does not fit.
    """
    if isinstance(value, str):
        if instead is not None:
            with contextlib.suppress(SceneError):
                return _converted(value, instead, name)
        return _converted(value, unit, name)
    if isinstance(value, TypedNumber):
        return value
    if not is_finite_number(value):
        raise SceneError(f"Argument `{name}` must be {_words(unit)}, but it is {_shown(value)}.")
    return float(value)


def is_finite_number(value: Any) -> bool:
    """Return whether a value is a finite real number and no bool.

    Parameters
    ----------
    value
        Any object.

    Returns
    -------
    bool
        True for a finite real number.

    Examples
    --------
    >>> from toolbox.authoring import is_finite_number
    >>> print(sum(map(is_finite_number, [1.5, True, float("nan"), "2"])), "of 4")
    1 of 4
    """
    if isinstance(value, (bool, np.bool_, str, bytes)):
        return False
    try:
        return math.isfinite(value)
    except (TypeError, ValueError, OverflowError, NotImplementedError, RuntimeError):
        return False


def in_si(value: Any, unit: str, name: str, instead: str | None = None) -> Any:
    """Return a value, or a row of values, with every text converted to its number in the given SI unit.

    Numbers of numpy become numbers of Python. A value of any other type is returned unchanged.

    Parameters
    ----------
    value
        A number, a text with a unit, or a sequence of numbers and texts.
    unit
        The SI unit.
    name
        Name of the value in messages.
    instead
        Another unit that a text may have; its numbers are then returned in this unit. By default none.

    Returns
    -------
    Any
        The value in SI.

    Raises
    ------
    SceneError
        If a text is no number with a unit that fits.

    Examples
    --------
    >>> from toolbox.authoring import in_si
    >>> print(in_si(["2 t", 3.5], "kg", "mass"))
    [2000.0, 3.5]
    """
    if isinstance(value, str):
        return parse(value, unit, name, instead)
    if isinstance(value, np.number):
        return value.item()
    if isinstance(value, (tuple, list)) and any(isinstance(entry, np.number) for entry in value):
        value = type(value)(in_si(entry, unit, name) if isinstance(entry, np.number) else entry for entry in value)
    if isinstance(value, (tuple, list)) and any(isinstance(entry, str) for entry in value):
        return type(value)(parse(entry, unit, f"{name}.{i}", instead) for i, entry in enumerate(value))
    return value


def warn_unusual(given: Any, value: Any, unit: str, usual: tuple[float, float], name: str) -> None:
    """Warn once about each number whose size is neither 0 nor within the usual range. `given` is the typed value; symbols are ignored."""
    low, high = usual
    field = name.rpartition(".")[2]
    for typed, number in zip(given, value, strict=True) if isinstance(value, tuple) else ((given, value),):
        if (
            not isinstance(number, (int, float))
            or isinstance(number, bool)
            or not math.isfinite(number)
            or number == 0
            or low <= abs(number) <= high
        ):
            continue
        if (field, float(number)) in _WARNED:
            continue
        _WARNED.add((field, float(number)))
        warnings.warn(_unusual(typed, number, unit, usual, name), UnusualValue, stacklevel=_outside())


_WARNED: set[tuple[str, float]] = set()
"""Numbers of which a warning was given; a law hands its own to the one that it designs."""


def _unusual(typed: Any, number: float, unit: str, usual: tuple[float, float], name: str) -> str:
    low, high = usual
    others = MISTAKEN.get(unit, ())
    sizes = {other: parse(f"1 {other}", unit) for other in others}
    first = sizes[others[0]] if others else 1.0
    told = f"`{typed}` = {number:.4g} {unit}" if isinstance(typed, str) else f"{number:.4g} {unit}"
    if others and not isinstance(typed, str):
        told += f", which is {number / first:.3g} {others[0]}"
    known = f"{low:g} to {high:g}" if high < math.inf else f"at least {low:g}"
    bounds = f"{known} {unit}" + (f" ({low / first:.3g} to {high / first:.3g} {others[0]})" if others and high < math.inf else "")
    meant = [other for other in others if low <= abs(number) * sizes[other] <= high and not isinstance(typed, str)]
    asked = " or ".join(f"`{number:.4g} {other}` = {number * sizes[other]:.3g} {unit}" for other in meant)
    return f"Argument `{name}` is {told}; usual is {bounds}" + (f". Did you mean {asked}?" if meant else ".")


def _outside() -> int:
    """How many calls lie between `warn_unusual` and the line of the user that made the part."""
    frame, level = sys._getframe(1), 1
    while frame.f_back is not None:
        file = frame.f_code.co_filename
        if (
            not file.startswith(_OURS)
            and not (file == "<string>" and frame.f_code.co_name == "__init__")
            and os.path.basename(file) != "dataclasses.py"
        ):
            break
        frame, level = frame.f_back, level + 1
    return level


_OURS = os.path.dirname(os.path.dirname(__file__))


def _shown(value: Any) -> str:
    try:
        return reprlib.repr(value)
    except ValueError:  # Python writes no integer of more than some thousand digits
        return f"an integer of {value.bit_length()} bits"


def _words(unit: str) -> str:
    return "a finite number" if unit == "1" else f"a finite number in {unit}, or text such as `1.5 {unit}`"


def _converted(text: str, unit: str, name: str) -> float:
    if len(text) > LONGEST:
        raise SceneError(f"Argument `{name}` must be {_words(unit)}, but it is a text of {len(text)} characters, `{text[:20]}...`.")
    number, given = _parted(text, unit, name)
    if re.match(r",\s?[0-9]", given):
        raise SceneError(
            f"Argument `{name}` must be {_words(unit)}, but `{text}` has a comma: a decimal point is written `.`, thousands without a mark."
        )
    if not given and unit != "1":
        missing = "in" if unit == "m" and "/" in text else unit
        raise SceneError(
            f"Argument `{name}` must be in {unit}, but `{text}` has no unit: write a plain number, or `{text.strip()} {missing}`."
        )
    if re.fullmatch("tons?f?", given, re.IGNORECASE):
        raise SceneError(
            f"Argument `{name}` is `{text}`, and tons are of three sizes: write `t` (1000 kg), or `lb` (a short ton is 2000 of these, a long one 2240)."
        )
    if re.match("MM?(lb|ft)", given):
        raise SceneError(
            f"Argument `{name}` is `{text}`, and M is a thousand to some and a million to others: write k for a thousand, as in `klbf`."
        )
    try:
        (target, _), wanted = _roots(unit)
    except _UnknownUnit:
        raise SceneError(f"Argument `{name}` must be a plain number: its part declares the unknown unit `{unit}`.") from None
    try:
        meant = _meant(given or "1", wanted)
        (factor, offset), roots = _roots(meant)
    except _UnknownUnit as unknown:
        fitting = [word for word in USUAL if _fit(_roots(word)[1], wanted)]
        raise SceneError(
            f"Argument `{name}` must be in {unit}, but `{text}` has the unknown unit `{unknown}`: {suggest(given, fitting or [unit])}"
        ) from None
    if not _fit(roots, wanted):
        must = "a plain number" if unit == "1" else f"in {unit}"
        end = _cased(given, wanted) or f"{_advice(roots, wanted)}."
        raise SceneError(f"Argument `{name}` must be {must}, but `{text}` is in {given}{end}")
    try:
        result = float((number * factor + offset) / target)
    except ArithmeticError:
        result = math.inf
    if not math.isfinite(result):
        raise SceneError(f"Argument `{name}` must be finite, but it is `{text}`.")
    return result if unit == "1" or offset else TypedNumber(result, unit, unit if factor == target else _usual(meant))


def _parted(text: str, unit: str, name: str) -> tuple[Decimal, str]:
    """(number, what stands behind it) of a text, whose number may be a fraction."""
    written = text.replace("\N{MINUS SIGN}", "-")  # as text that was copied from a page has it
    written = re.sub("[¼-¾⅐-⅞]", lambda sign: " " + unicodedata.normalize("NFKC", sign[0]), written).replace("\N{FRACTION SLASH}", "/")
    if (match := _FRACTION.fullmatch(written)) is not None:
        sign, whole, upper, lower, given = match.groups()
        if int(lower) == 0 or (whole is not None and ("." in whole or int(upper) >= int(lower))):
            raise SceneError(
                f"Argument `{name}` must be {_words(unit)}, but `{text}` has no fraction such as the one of `5 7/8 in`: a whole number and a part of 1."
            )
        size = Decimal(whole or 0) + Decimal(upper) / Decimal(lower)
        return (-size if sign == "-" else size), given.strip()
    if (match := _QUANTITY.fullmatch(written)) is None:
        raise SceneError(f"Argument `{name}` must be {_words(unit)}, but it is `{text}`.")
    return Decimal(match[1].replace("_", "")), match[2].strip()


@cache
def _usual(given: str) -> str:
    """The usual spelling of a unit: that of the first of `USUAL` that is the same; a tonne of force is a tonne, as who typed it says."""
    known = next((word for word in USUAL if _roots(word) == _roots(given)), given)
    return "t" if _roots(known) == _roots("t_force") else known


def _meant(given: str, wanted: dict[str, Decimal]) -> str:
    """The unit that habit means by a spelling: 1/min of a speed of rotation, lb of a force, and letters of the wrong case where only one unit fits."""
    small = re.sub(r"[A-Za-z]+", lambda word: word[0].lower() if word[0].lower() in CASELESS else word[0], given)
    for spelled in (given, small):
        of_force = spelled
        for mass, force in OF_FORCE:
            of_force = re.sub(mass, force, of_force)
        for meant in (HABITS.get(spelled.replace(" ", ""), spelled), spelled, of_force):
            with contextlib.suppress(_UnknownUnit):
                if _fit(_roots(meant)[1], wanted):
                    return meant
    with contextlib.suppress(_UnknownUnit):
        _roots(given)
        return given
    if (habit := HABITS.get(small.replace(" ", ""))) is not None:  # known, of something else
        return habit
    alike = [word for word in USUAL if word.lower().replace(" ", "") == given.lower().replace(" ", "") and _fit(_roots(word)[1], wanted)]
    return given if len(alike) != 1 or _prefix_doubtful(alike[0], wanted) else alike[0]


def _prefix_doubtful(word: str, wanted: dict[str, Decimal]) -> bool:
    """Whether the first letter of a unit in the other case is another unit of the same quantity: MN and mN."""
    with contextlib.suppress(_UnknownUnit):
        return _fit(_roots(word[0].swapcase() + word[1:])[1], wanted)
    return False


def _fit(given: dict[str, Decimal], wanted: dict[str, Decimal]) -> bool:
    """Whether units with these powers of base units measure the same thing."""
    beside_force = wanted.get("gram", Decimal(0)) != 0
    powers = [{base: power for base, power in roots.items() if not (beside_force and base == "radian")} for roots in (given, wanted)]
    return powers[0] == powers[1]


def _cased(given: str, wanted: dict[str, Decimal]) -> str:
    """A unit that differs from the given one only in its capitals, and fits, such as kN for kn (a knot)."""
    near = [word for word in USUAL if word != given and word.casefold() == given.casefold() and _fit(_roots(word)[1], wanted)]
    return f": did you mean `{near[0]}`?" if near else ""


def _advice(given: dict[str, Decimal], wanted: dict[str, Decimal]) -> str:
    rate = {"second": Decimal(-1)}
    if given == rate and wanted == rate | {"radian": Decimal(1)}:
        return "; an angular speed is in rad/s or rpm, and 1 Hz is 60 rpm"
    if wanted == rate and given == rate | {"radian": Decimal(1)}:
        return "; a frequency is in Hz, and 60 rpm is 1 Hz"
    return ""


class _UnknownUnit(Exception):
    pass


_DIGITS = Context(prec=24)
"""To so many digits factors are kept, whose last ones depend on the order in which they were multiplied."""


@cache
def _registry() -> Any:
    check_version("pint")
    import pint  # here, because it takes half a second, and only rare units need it

    return pint.UnitRegistry(non_int_type=Decimal)  # decimals: 97.3 kN is 97300 N to the last digit


@cache
def _roots(unit: str) -> tuple[tuple[Decimal, Decimal], dict[str, Decimal]]:
    """(factor, offset) to base units, and the powers of the base units, rad among them."""
    text = unit.strip()
    if not _UNIT.fullmatch(text):
        raise _UnknownUnit(unit)
    if (dogleg := _DOGLEG.fullmatch(text)) is not None:
        (factor, _), powers = _roots(f"{dogleg[1]}/{dogleg[3]}")
        return ((factor / int(dogleg[2])).normalize(_DIGITS), Decimal(0)), powers
    for pattern, replacement in _SPELLINGS:
        text = re.sub(pattern, replacement, text)
    if _STRAY_DOT.search(text):  # some versions of pint read one as a product
        raise _UnknownUnit(unit)
    known = plain(text)
    if known is not None:
        return (known[0].normalize(_DIGITS), Decimal(0)), known[1]
    registry = _registry()
    try:
        parsed = registry.parse_units("" if text == "1" else text)
        zero = registry.Quantity(Decimal(0), parsed).to_root_units()
        one = registry.Quantity(Decimal(1), parsed).to_root_units()
    except Exception:  # pint has no common base for what its parser raises
        raise _UnknownUnit(unit) from None
    return ((one.magnitude - zero.magnitude).normalize(_DIGITS), zero.magnitude), {
        str(base): Decimal(power) for base, power in one._units.items()
    }
