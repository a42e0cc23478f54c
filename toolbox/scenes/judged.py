"""Which signal, contact and effort of a plant a verdict looks at where nobody says."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from toolbox.errors import SceneError, suggest
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.hybrid_system import HybridSystem


def judged_signal(plant: HybridSystem, element: str) -> str:
    """The signal whose severity is judged where nobody names one: the speed of what rubs, else its slip."""
    return f"{element}.speed" if f"{element}.speed" in plant.signals else f"{element}.slip"


def judged_effort(plant: HybridSystem, signal: str) -> str:
    """The input whose peak is reported where nobody names one: the torque of a top drive, else the first input, else the judged signal."""
    return "top.torque" if "top.torque" in plant.inputs else next(iter(plant.inputs), signal)


def judged_element(names: Sequence[str], element: str | None, argument: str = "element") -> str | None:
    """The contact that is named, or the only one there is, None where there is none. `argument` is where the user says it.

    Raises SceneError for another name, and where there are several and none is named: a string may hang in its hole while the bit turns, and the reverse.
    """
    if element is not None and element not in names:
        raise SceneError(f"There is no contact `{element}` to be judged: {suggest(element, names)}")
    if element is None and len(names) > 1:
        known = f"{len(names)} contacts, among them " if len(names) > 4 else "contacts "
        raise SceneError(
            f"Argument `{argument}` must name the contact to be judged, because there are {known}{', '.join(f'`{name}`' for name in names[-4:])}."
        )
    return element or next(iter(names), None)


def judged_contact(closed: ClosedLoop | HybridSystem, element: str | None = None, argument: str = "element", sticks: bool = True) -> str:
    """The contact with dry friction whose sticking is judged: the one named, here or by the loop, or the only one. Raises SceneError for any other case.

    sticks: False for what is judged by a speed alone, which a contact without modes has, too.
    """
    system = closed.system if isinstance(closed, ClosedLoop) else closed
    element = element or closed.element if isinstance(closed, ClosedLoop) else element
    names = [each.name for each in system.elements if each.law is not None]
    found = judged_element([*system.modeless] if element in system.modeless else names or [*system.modeless], element, argument)
    if found is None:
        raise SceneError("The plant must have a contact with dry friction for stick-slip to exist, but it has none.")
    if sticks and found in system.modeless:
        raise system.no_element(found)
    return found


def judged_speed(closed: ClosedLoop | HybridSystem, contact: str) -> str:
    """The speed that a loop names to be judged, else that of what rubs where that is its slip, as at a bit; else the slip, whose mean is not zero.

    Raises SceneError where a loop names a signal that there is not.
    """
    if isinstance(closed, ClosedLoop):
        if closed.signal is not None:
            closed.system.signal_unit(closed.signal)
            return closed.signal
        closed = closed.system
    slips = {each.name: each.slip for each in closed.elements}
    speed, slip = f"{contact}.speed", slips[contact] if contact in slips else closed.expression(f"{contact}.slip")
    return speed if speed in closed.signals and ca.is_equal(ca.SX(closed.signals[speed][0]), slip, 4) else f"{contact}.slip"
