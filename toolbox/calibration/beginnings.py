"""Where the search for a richer friction law begins: at the fit of a simpler one."""

from __future__ import annotations

from typing import Any

from toolbox.calibration.motion import Guess
from toolbox.calibration.results import Fit
from toolbox.calibration.told_fit import holds_nothing

NOTHING = 0.1
"""Part of the first guess of friction, at least, at which the search for a richer law begins: none begins at a bound."""


def is_hardly_told(found: Fit) -> bool:
    """Whether the Stribeck speed or the friction that falls with speed is not told, so that a simpler law may do."""
    known = [name for name in found.names if name.endswith(".stribeck_speed")]
    return bool(found.indistinguishable_friction or found.at_bounds or not known or any(holds_nothing(found, name) for name in known))


def levels_of(near: Fit | None, about: Guess) -> list[tuple[float, float]]:
    """Dry and viscous friction at which a search begins, each way if the simpler law has them each way."""
    if near is None:
        return [(about.level, about.viscous)]
    found, levels = near.parameters, []
    for name in found:
        if name.endswith(".static"):
            head = name.removesuffix("static")
            slope = found.get(f"{head.removesuffix('dry.')}viscous", 0.0)
            level = found.get(f"{head}kinetic", found[name])
            levels.append((max(level, NOTHING * about.level), max(slope, NOTHING * about.viscous)))
    return levels or [(about.level, about.viscous)]


def body_of(part: Any, near: Fit | None) -> dict[str, float]:
    """Mass and constant force of the fit of a simpler law; empty without one."""
    found = {} if near is None else near.parameters
    fields = {name: f"{part.signal_prefix}.{name}" for name in (part.body_field, part.offset_field)}
    return {name: found[full] for name, full in fields.items() if full in found}
