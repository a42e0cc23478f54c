"""Which signal, contact and effort of a plant a verdict looks at where nobody says, and with them what a measure is that is asked by its name."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import casadi as ca

from toolbox.errors import SceneError, suggest
from toolbox.measuring import measure
from toolbox.measuring.metrics import Metric, distance, jerk, metrics_of, releases, settling, standstill, time_in
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.drive import EFFORTS, drive_among
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.simulation.recorded import Recorded
from toolbox.simulation.trajectory import Trajectory


def judged_effort(plant: HybridSystem, signal: str) -> str:
    """Return the default input whose peak is reported: the first force or torque, else the first input, else the judged signal."""
    return next((name for name in plant.inputs if name.endswith(EFFORTS)), next(iter(plant.inputs), signal))


def judged_element(names: Sequence[str], element: str | None, argument: str = "element") -> str | None:
    """Return the named contact, or by default the only contact; None if there is no contact. `argument` is the argument that names the
    contact.

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
    if isinstance(closed, ClosedLoop):
        element, argument = element or closed.element, "element` of `closed_loop" if argument == "element" else argument
    names = [each.name for each in system.elements if each.law is not None]
    found = judged_element([*system.modeless] if element in system.modeless else names or [*system.modeless], element, argument)
    if found is None:
        raise SceneError("The plant must have a contact with dry friction for stick-slip to exist, but it has none.")
    if sticks and found in system.modeless:
        raise system.unknown_element_error(found)
    return found


def judged_speed(closed: ClosedLoop | HybridSystem, contact: str) -> str:
    """Return the judged speed that the loop names. The default is the speed of the rubbing body if its slip is equal, as at a bit, else the
    slip, whose mean is not zero.

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


def judged_measures(
    given: Any, loop: ClosedLoop, begin: float, end: float, argument: str = "metrics", after: float | None = None
) -> dict[str, Metric]:
    """Return {name: metric} for the runs of a loop from `begin` to `end` [s]. Everything that the argument leaves out is taken from the
    loop.

    A measure that names no signal or element looks at what the loop judges, from `after` on, by default from the judged time; a target that is not given is
    the set-point: the one that a scene says, or where the loop is of none, that of the law. Raises SceneError for what is no measure, and for one that the
    loop has not.
    """
    if after is None:
        after = begin + (end - begin) / 2 if loop.after is None or loop.after >= end else loop.after
    found = {name: _judged(each, loop, after, argument) for name, each in metrics_of(given, argument).items()}
    for each in found.values():
        each.check(loop.system, end)
    return found


def judged_in(given: Any, run: Recorded, begin: float, end: float) -> dict[str, Metric]:
    """Return {name: metric} for a run between `begin` and `end` [s]. Everything left out is taken from the loop of the run, or from the
    names in a run from a file."""
    if isinstance(run, Trajectory):
        found = judged_measures(given, run.run.loop, run.begin, end, after=begin)
    else:
        found = {name: _judged(each, run, begin, "metrics") for name, each in metrics_of(given).items()}
    return {name: each if each.until is not None else dataclasses.replace(each, until=end) for name, each in found.items()}


def _judged(display_units: Metric, judge: ClosedLoop | Recorded, after: float, argument: str) -> Metric:
    if not display_units.looks_at:
        return display_units
    of, settings = display_units.of or _looked_at(display_units.looks_at, judge, argument), dict(display_units.settings)
    scene = judge if isinstance(judge, ClosedLoop) and judge.after is not None else None
    stops = None if scene is None or display_units.of else scene.standstill_speed
    if scene is not None and stops is not None and display_units.name == time_in.name:
        settings |= {"signal": scene.signal, "speed": stops}
        display_units = dataclasses.replace(display_units, function=_stuck_before_standstill, compiled="")
    elif stops is not None and display_units.name == settling.name:
        settings = {"speed": stops}
        display_units = dataclasses.replace(standstill, name=display_units.name)
    elif scene is not None and stops is not None and display_units.name in STOPPED:
        before = partial(_before_standstill, display_units.function, scene.signal or of, stops)
        display_units = dataclasses.replace(display_units, function=before)
    elif "target" in settings and settings["target"] is None:
        machine = judge.system if isinstance(judge, ClosedLoop) else judge
        settings["target"] = scene.reference if scene is not None and of == scene.signal else set_point(machine, of)
        if settings["target"] is None:
            raise SceneError(
                f"Argument `{argument}` must not ask for `{display_units.name}` where there is no set-point of `{of}`: give a target, "
                f'`measures.{display_units.name}("{of}", target=...)`.'
            )
    at = display_units.after if display_units.after is not None else 0.0 if display_units.whole else after
    return dataclasses.replace(display_units, of=of, after=at, settings=tuple(settings.items()))


def _looked_at(what: str, judge: ClosedLoop | Recorded, argument: str) -> str:
    """The contact, the speed or the effort that is judged."""
    if isinstance(judge, ClosedLoop):
        if what == "contact":
            return judge.element or judged_contact(judge, argument=argument)
        speed = judge.signal or judged_speed(judge, judged_contact(judge, argument=argument, sticks=False))
        return speed if what == "speed" else judge.effort or judged_effort(judge.plant, speed)
    contact = judged_element(judge.contacts, None, argument)
    if contact is None:
        raise SceneError(
            f"Argument `{argument}` must say of what it is, because the run has no contact: `metrics.maximum(...)`, for example."
        )
    speed = measure.rubbing_speed(judge, contact)
    if what != "effort":
        return contact if what == "contact" else speed
    drive = drive_among((name for name in judge.names if name.rpartition(".")[0] not in judge.contacts), judge.__contains__)
    return speed if drive is None else drive[1]


def set_point(machine: HybridSystem | Recorded, signal: str) -> str | None:
    """The set-point of a signal: the only input, of a run the only signal, whose name ends so in the unit of the signal; None for none."""
    names = machine.inputs if isinstance(machine, HybridSystem) else machine.names
    found = [name for name in names if name.endswith(".reference") and machine.unit(name) == machine.unit(signal)]
    return found[0] if len(found) == 1 else None


def sticks_before_standstill(
    run: Recorded, element: str, signal: str, speed: float, after: float, stands: float | None = None
) -> list[tuple[float, float]]:
    """Return (begin, end) [s] of the sticks during a stop that let go before the signal falls to `speed`. stands: time of standstill, if it
    is known."""
    if stands is None:
        stands = measure.standstill(run, signal, speed, after=after)
    sticks = measure.stick_intervals(run, element, after, min(stands, run.end)) if stands > after else []
    return sticks[:-1] if sticks and sticks[-1][1] >= stands else sticks


STOPPED = (releases.name, distance.name, jerk.name)
"""Metrics of a stop that end with its standstill."""


def _before_standstill(
    function: Any, signal: str, speed: float, run: Recorded, of: str, after: float, until: float | None, **settings: float
) -> float:
    """A metric of a stop until a signal falls to `speed`; with the jerk of the halt itself. A distance is inf if the signal never falls so far."""
    stands = measure.standstill(run, signal, speed, after=run.begin)
    if stands == math.inf and function is distance.function:
        return math.inf
    last = min(stands + 2.0 * settings.get("average", 0.0), run.end if until is None else until)
    return float(function(run, of, after=after, until=last, **settings)) if last > after else math.nan


def _stuck_before_standstill(run: Recorded, of: str, after: float, until: float | None, mode: str, signal: str, speed: float) -> float:
    return sum(last - first for first, last in sticks_before_standstill(run, of, signal, speed, after))
