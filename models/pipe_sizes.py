"""Drill pipes by what is painted on them: outer diameter and nominal weight, which stand for an inner diameter.

The nominal weight is a name: it is that of an older pipe with threads and couplings, neither that of the tube nor that of a joint as it hangs. Sizes:
API Specification 5DP and Recommended Practice 7G.
"""

from __future__ import annotations

from toolbox import SceneError
from toolbox.authoring import NumberOrText, number

INCH, POUND_PER_FOOT = 0.0254, 0.45359237 / 0.3048

SIZES = {
    2.375: {4.85: 1.995, 6.65: 1.815},
    2.875: {6.85: 2.441, 10.40: 2.151},
    3.5: {9.50: 2.992, 13.30: 2.764, 15.50: 2.602},
    4.0: {11.85: 3.476, 14.00: 3.340, 15.70: 3.240},
    4.5: {13.75: 3.958, 16.60: 3.826, 20.00: 3.640},
    5.0: {16.25: 4.408, 19.50: 4.276, 25.60: 4.000},
    5.5: {19.20: 4.892, 21.90: 4.778, 24.70: 4.670},
    6.625: {25.20: 5.965, 27.70: 5.901},
}
"""{outer diameter [in]: {nominal weight [lb/ft]: inner diameter [in]}}."""

NEAR = 5e-3
"""What a diameter or a weight may be off a size, in parts of it: 127 mm is 5 in, 29 kg/m is 19.5 lb/ft."""


def inner_diameter(outer: NumberOrText, nominal_weight: NumberOrText) -> float:
    """Return the inner diameter [m] of an API drill pipe.

    Parameters
    ----------
    outer
        Outer diameter [m], such as "5 in".
    nominal_weight
        Nominal weight [kg/m], such as "19.5 lb/ft" or "19.5 ppf".

    Returns
    -------
    float
        Inner diameter [m].

    Raises
    ------
    SceneError
        If there is no pipe of this size; the message lists the pipes that exist.

    Examples
    --------
    >>> from models import inner_diameter
    >>> print(f"{inner_diameter('5 in', '19.5 lb/ft') * 1e3:.1f} mm")
    108.6 mm
    """
    size = number("outer", outer, "m", above=0) / INCH
    weight = number("nominal_weight", nominal_weight, "kg/m", above=0) / POUND_PER_FOOT
    known = next((by_weight for each, by_weight in SIZES.items() if abs(each - size) <= NEAR * size), None)
    if known is None:
        sizes = ", ".join(f"{each:g}" for each in SIZES)
        raise SceneError(
            f"Argument `outer` must be the size of an API drill pipe to go with a nominal weight, in inches {sizes}, but it is {size:.4g} in: "
            "give the inner diameter."
        )
    found = next((inner for each, inner in known.items() if abs(each - weight) <= NEAR * weight), None)
    if found is None:
        there = ", ".join(f"{each:g}" for each in known)
        raise SceneError(
            f"Argument `nominal_weight` must be that of an API drill pipe of {size:.4g} in, in lb/ft {there}, but it is {weight:.4g} lb/ft: "
            "give the inner diameter."
        )
    return found * INCH
