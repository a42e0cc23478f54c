"""Units that are products and quotients of everyday ones, such as `N m s/rad`, `klbf ft` and `rpm`: read without the registry of all units.

The registry takes half a second to load, and most scenes need nothing of it. `toolbox.files.units` asks here first; whatever is not read here the
registry reads, and it says the same of what is.
"""

from __future__ import annotations

import re
from decimal import Decimal

Powers = dict[str, Decimal]
"""{base unit: power}."""

_MASS, _LENGTH, _TIME, _ANGLE = ("gram", 1), ("meter", 1), ("second", 1), ("radian", 1)
_FORCE = (_MASS, _LENGTH, ("second", -2))
_PRESSURE = (_MASS, ("meter", -1), ("second", -2))
_ENERGY = (_MASS, ("meter", 2), ("second", -2))
_POWER = (_MASS, ("meter", 2), ("second", -3))

_PREFIXED = {
    "g": ("1", (_MASS,)), "m": ("1", (_LENGTH,)), "s": ("1", (_TIME,)), "rad": ("1", (_ANGLE,)), "Hz": ("1", (("second", -1),)),
    "N": ("1E3", _FORCE), "Pa": ("1E3", _PRESSURE), "J": ("1E3", _ENERGY), "W": ("1E3", _POWER), "lbf": ("4448.2216152605", _FORCE),
}  # fmt: skip
"""{unit: (factor to base units, their powers)} of those that may have one of the prefixes."""

_WHOLE = {
    "%": ("0.01", ()), "K": ("1", (("kelvin", 1),)), "min": ("60", (_TIME,)), "h": ("3600", (_TIME,)), "deg": ("0.01745329251994329576923690768", (_ANGLE,)),
    "turn": ("6.283185307179586476925286766", (_ANGLE,)), "rpm": ("0.1047197551196597746154214461", (_ANGLE, ("second", -1))),
    "ft": ("0.3048", (_LENGTH,)), "in": ("0.0254", (_LENGTH,)), "t": ("1E6", (_MASS,)), "lb": ("453.59237", (_MASS,)), "t_force": ("9.80665E6", _FORCE),
    "bar": ("1E8", _PRESSURE), "psi": ("6894757.293168361336722673443", _PRESSURE), "hp": ("745699.87158227022", _POWER),
    "gal": ("0.003785411784", (("meter", 3),)), "l": ("0.001", (("meter", 3),)), "oil_barrel": ("0.158987294928", (("meter", 3),)),
    "kft": ("304.8", (_LENGTH,)), "klb": ("453592.37", (_MASS,)),
}  # fmt: skip

_SIZES = {"": 0, "m": -3, "c": -2, "k": 3, "M": 6, "G": 9}
"""Powers of ten of the prefixes."""

_KNOWN = {
    f"{prefix}{name}": (Decimal(factor).scaleb(size), powers)
    for name, (factor, powers) in _PREFIXED.items()
    for prefix, size in _SIZES.items()
} | {name: (Decimal(factor), powers) for name, (factor, powers) in _WHOLE.items()}

_PART = re.compile(r"(\s*/\s*|\s*\*\s*|\s+|)([A-Za-z_]+|%)(?:\*\*(-?[0-9]))?")


def plain(text: str) -> tuple[Decimal, Powers] | None:
    """(factor to base units, powers of these) of a product of everyday units; None for any other text."""
    factor, powers = Decimal(1), dict[str, Decimal]()
    one = text == "1" or text.startswith("1/")
    rest, first = (text[1:], False) if one else (text, True)
    while rest or first:
        part = _PART.match(rest)
        if part is None or part[2] not in _KNOWN or bool(part[1]) == first:
            return None
        sign = -1 if "/" in part[1] else 1
        size, bases = _KNOWN[part[2]]
        power = sign * int(part[3] or 1)
        factor *= size**power
        for base, exponent in bases:
            powers[base] = powers.get(base, Decimal(0)) + power * exponent
        rest, first = rest[part.end() :], False
    return factor, {base: power for base, power in powers.items() if power}
