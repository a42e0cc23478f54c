"""Which signal, contact and effort of a plant a verdict looks at where nobody says."""

from __future__ import annotations

import casadi as ca

from toolbox.errors import SceneError, suggest
from toolbox.modelling.hybrid_system import HybridSystem


def judged_signal(plant: HybridSystem, element: str) -> str:
    """The signal whose severity is judged where nobody names one: the speed of what rubs, else its slip."""
    return f"{element}.speed" if f"{element}.speed" in plant.signals else f"{element}.slip"


def judged_effort(plant: HybridSystem, signal: str) -> str:
    """The input whose peak is reported where nobody names one: the torque of a top drive, else the first input, else the judged signal."""
    return "top.torque" if "top.torque" in plant.inputs else next(iter(plant.inputs), signal)


def judged_contact(closed: HybridSystem, element: str | None) -> str:
    """The contact whose sticking is judged: the one named, else the first. Raises SceneError where there is none."""
    contacts = [each.name for each in closed.elements if each.law is not None]
    if not contacts:
        raise SceneError("The plant must have a contact with dry friction for stick-slip to exist, but it has none.")
    if element is not None and element not in contacts:
        raise SceneError(f"There is no contact `{element}` to be judged: {suggest(element, contacts)}")
    return element or contacts[0]


def judged_speed(closed: HybridSystem, contact: str) -> str:
    """The speed of what rubs where that is its slip, as at a bit; else the slip, whose mean is not zero."""

    speed, slip = f"{contact}.speed", next(each.slip for each in closed.elements if each.name == contact)
    return speed if speed in closed.signals and ca.is_equal(ca.SX(closed.signals[speed][0]), slip, 4) else f"{contact}.slip"
