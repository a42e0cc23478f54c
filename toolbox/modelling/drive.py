"""The drive of a plant: the force or torque that controllers give, and the speed at the same place, where nobody names signals."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from toolbox.errors import SceneError
from toolbox.modelling.hybrid_system import HybridSystem

EFFORTS = (".torque", ".force")
"""How the name of a signal ends by which a place is driven; a torque or force P.torque acts where the speed is P.speed."""


def drive_among(efforts: Iterable[str], known: Callable[[str], bool]) -> tuple[str, str] | None:
    """(speed, effort) of the first force or torque with a known speed at its place; None if there is none."""
    pairs = ((f"{name.rpartition('.')[0]}.speed", name) for name in efforts if name.endswith(EFFORTS))
    return next(((speed, effort) for speed, effort in pairs if known(speed)), None)


def drive_of(plant: HybridSystem) -> tuple[str, str]:
    """(speed, effort) that controllers of a plant measure and give if they name none: its first input that is a force or torque with a speed at its place.

    Raises SceneError if there is none.
    """
    found = drive_among((*plant.redirected_signals, *plant.inputs), lambda name: name in plant.redirected_signals or plant.has_signal(name))
    if found is None:
        scalars = [name for name, (expression, _) in plant.signals.items() if expression.numel() == 1] or ["..."]
        speed = next((name for name in scalars if name.endswith(".speed")), scalars[0])
        raise SceneError(
            "Arguments `measured_signals` and `actuated_signals` must be given for a plant that takes no force or torque where it has a speed: "
            f'write `measured_signals="{speed}", actuated_signals="{next(iter(plant.inputs), "...")}"`, with a tuple of names for several.'
        )
    return found
