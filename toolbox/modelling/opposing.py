"""Whether a friction law opposes its slip: one that falls below zero at some speed would drive the machine there."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from toolbox.errors import SceneError
from toolbox.halving import halved
from toolbox.modelling.elements import FrictionLaw

SPEEDS = np.concatenate([[0.0], np.logspace(-4.0, 3.0, 71)])
"""Slip speeds at which a law is asked [m/s or rad/s]: ten in each decade."""

ROUND_OFF = 1e-9
"""Part of the largest friction below which a negative one is round-off."""

ROWS = 10_000
"""Laws that are asked at once: all of a large sweep would take its memory."""


def check_opposing(law: FrictionLaw) -> None:
    """Raise SceneError for a law whose friction at a steady slip speed is below zero at some speed; it names the lowest such speed.

    Of a law with memory that is its friction at a steady slip speed too: what its memory gives back for a while is its own affair.
    """
    try:
        found = _negative(law)
    except TypeError:  # of a law that cannot be hashed
        found = _negative.__wrapped__(law)
    if found is not None:
        speed, friction = found
        raise SceneError(
            f"The friction law {type(law).__name__} must not fall below zero, where it would drive the machine, but beyond a slip speed of {speed:.4g} it "
            f"does, and is {friction:.3g} per unit of load at its lowest up to {SPEEDS[-1]:g}: end it, as `casadi.fmax(0, ...)` in `sliding` does."
        )


@lru_cache(maxsize=1024)
def _negative(law: FrictionLaw) -> tuple[float, float] | None:
    """(the lowest slip speed from which on the friction of a law is negative, the lowest friction); None where it never is."""
    friction = _sliding(law, SPEEDS)
    below = np.flatnonzero(_below(friction[:, None])[:, 0])
    if not below.size:
        return None
    first = int(below[0])
    speed = 0.0
    if first:
        _, speed = halved(lambda v: bool(_sliding(law, np.array([v]))[0] < 0.0), float(SPEEDS[first - 1]), float(SPEEDS[first]), 1e-6)
    return speed, float(friction[below].min())


def driving_of(law: FrictionLaw, numbers: ca.SX) -> Callable[[np.ndarray], np.ndarray]:
    """A function that says of rows of numbers, shape (n, k), whether the friction of a law with them is below zero at some speed, shape (n,).

    law: with symbols for its numbers;  numbers: these, shape (k,). It says False where numbers do not tell it.
    """
    try:
        speeds = ca.SX(SPEEDS)
        friction = ca.Function("friction", [numbers], [law.sliding(speeds, *(speeds >= ca.SX(place) for place in law.break_speeds()))])
    except Exception:  # whatever the code of a user does with symbols, which composing a plant tells in its own words
        return lambda rows: np.zeros(len(rows), bool)

    def drives(rows: np.ndarray) -> np.ndarray:
        parts = np.split(rows, range(ROWS, len(rows), ROWS))
        return np.concatenate([_below(np.array(friction(part.T))).any(axis=0) for part in parts])

    return drives


def _below(friction: np.ndarray) -> np.ndarray:
    """Where columns of friction at the speeds above are below zero by more than round-off."""
    with np.errstate(invalid="ignore"):
        return friction < -ROUND_OFF * np.nanmax(np.abs(friction), axis=0, initial=0.0)


def _sliding(law: Any, speeds: np.ndarray) -> np.ndarray:
    """Friction per unit of load at slip speeds, shape (n,); nan where numbers do not tell it, which composing a plant does in its own words."""
    try:
        beyond = [ca.DM((speeds >= float(place)) * 1.0) for place in law.break_speeds()]
        found = np.array(ca.evalf(ca.SX(law.sliding(ca.DM(speeds), *beyond)))).ravel()
    except Exception:  # whatever the code of a user does with numbers in place of symbols
        return np.full(speeds.size, np.nan)
    return np.broadcast_to(found, speeds.shape) if found.size == 1 else found if found.size == speeds.size else np.full(speeds.size, np.nan)
