"""Whether data tell the numbers of a fit: the singular values of its scaled Jacobian."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from toolbox.errors import Unidentifiable

SINGULAR = 1e-6
"""Ratio of singular values, columns of the Jacobian scaled to length one, below which numbers cannot be told apart."""

MUTE = 1e-9
"""Change of the residuals, in parts of the signals, below which a number has no influence: for a change by its own size."""


def condition_of(names: Sequence[str], per_part: np.ndarray, at: Mapping[str, float]) -> float:
    """Condition of the scaled Jacobian; raises SceneError where it is singular, and names what is to blame."""
    if not names:
        raise Unidentifiable(
            "Argument `free` must hold numbers that the data depend on, but none of them changes a measured signal at the optimum.",
            [*at], True, at,
        )  # fmt: skip
    length = np.sqrt((per_part**2).mean(axis=0))
    mute = [name for name, size in zip(names, length, strict=True) if size < MUTE]
    if mute:
        words = " and ".join(f"`{name}`" for name in mute)
        raise Unidentifiable(
            f"Argument `free` must hold numbers that the data depend on, but {words} changes none of the measured signals.",
            [each for name in mute for each in name.split(" = ")], True, at,
        )  # fmt: skip
    square, directions = np.linalg.eigh(np.einsum("ni,nj->ij", per_part, per_part) / (length[:, None] * length * len(per_part)))
    singular = np.sqrt(np.maximum(square, 0.0))
    if singular[0] < SINGULAR * singular[-1]:
        direction = directions[:, 0] / length
        direction /= np.abs(direction).max()
        involved = [(name, part) for name, part in zip(names, direction, strict=True) if abs(part) > 0.05]
        words = " and ".join(f"`{name}`" for name, _ in involved)
        changes = ", ".join(f"{100 * part:+.3g} % of `{name}`" for name, part in involved)
        raise Unidentifiable(
            f"Argument `free` must hold numbers that the data can tell apart, but {words} cannot be: changes in the ratio {changes} "
            f"leave every residual as it is (singular values {singular[0]:.1e} : {singular[-1]:.1e}). Fix all of them but one.",
            [each for name, _ in involved for each in name.split(" = ")], False, at,
        )  # fmt: skip
    return float(singular[-1] / singular[0])
