"""Friction factors of a borehole over depth: a casing and the open hole below it have one each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from toolbox import SceneError
from toolbox.authoring import number


class FrictionFactors(NamedTuple):
    """Coefficients of friction between string and borehole, each from the depth above on.

    Attributes
    ----------
    depths
        Measured depths at which each ends [m], increasing.
    factors
        Coefficients [1].
    """

    depths: tuple[float, ...]
    factors: tuple[float, ...]

    @classmethod
    def of(cls, argument: str, given: Any, end: float) -> FrictionFactors:
        """Return the factors of an argument: one number, or pairs (depth, factor). Raises SceneError if it is neither, or ends above `end` [m]."""
        if not isinstance(given, Sequence) or isinstance(given, str):
            return cls((end,), (float(number(argument, given, at_least=0)),))
        pairs = [pair for pair in given if isinstance(pair, Sequence) and not isinstance(pair, str) and len(pair) == 2]
        if not pairs or len(pairs) < len(given):
            raise SceneError(
                f'Argument `{argument}` must be a number, or pairs such as [("2200 m", 0.2), ("3800 m", 0.3)], but it is {given!r}.'
            )
        depths, factors = [0.0], []
        for i, (depth, factor) in enumerate(pairs):
            depths.append(float(number(f"{argument}.{i}.depth", depth, "m", above=depths[-1])))
            factors.append(float(number(f"{argument}.{i}.factor", factor, at_least=0)))
        if depths[-1] < end * (1.0 - 1e-6):
            raise SceneError(
                f"Argument `{argument}` must reach the end of the string at {end:g} m, but its last depth is {depths[-1]:g} m."
            )
        return cls(tuple(depths[1:]), tuple(factors))

    def at(self, depth: np.ndarray) -> np.ndarray:
        """Return the factor at every depth [m] above the last."""
        last = len(self.factors) - 1
        return np.asarray(self.factors)[np.minimum(np.searchsorted(self.depths, depth, side="left"), last)]
