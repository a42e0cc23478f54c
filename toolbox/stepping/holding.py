"""Whether a force holds a contact: one rule for single runs and for lanes."""

from __future__ import annotations

from typing import Any


def holds(force: Any, static: Any, scale: Any) -> Any:
    """True where a force is within the static bound of a contact, but for round-off.

    scale: size of the distance to that bound; it counts for a bound that falls to zero, or an ulp below, with the normal force that makes it.
    """
    return abs(force) <= static * (1.0 + 1e-9) + 1e-12 * scale
