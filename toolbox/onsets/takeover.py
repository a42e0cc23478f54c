"""Takeovers: states and commands at instants of a stick-slip cycle, from which another controller goes on without a jump of its command.

Sampled controllers read the held commands at their first sample (`controllers.bumpless`). Of a continuous controller with one state, such as an integral, that
state is chosen so that it gives the same command. Other continuous controllers begin with their start values.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any

from toolbox.arguments import whole
from toolbox.errors import SceneError, SimulationError
from toolbox.measuring.sticks import is_stick, releases, stuck_ratio
from toolbox.modelling.closed_loop import ClosedLoop, states_of, value_at
from toolbox.modelling.closing import described
from toolbox.modelling.laws import Controller
from toolbox.scenes.judged import judged_contact, judged_speed, set_point
from toolbox.simulation.simulate import simulate
from toolbox.simulation.trajectory import Trajectory
from toolbox.steady_states.steady_loop import smooth_points

PHASES = 8
"""Instants of the stick-slip of another controller at which it is taken over, by default."""

BEFORE = 200.0
"""Time for which that controller runs before, by default [s]."""

WIDER = (1.0, 10.0, 100.0, 1e3, 1e4, 1e5)
"""States of a controller to either side of 0 among which one is looked for that moves its command."""

HALVINGS, STRAIGHT = 60, 1e-9
"""How often they are halved, and the deviation from a straight line, as a fraction of the change, up to which a command is not limited."""


def cycle_phases(run: Trajectory, count: int = PHASES) -> list[dict[str, Any]]:
    """Return states and commands at equally spaced phases of the last stick-slip cycle of a run, as starts of other
    runs.

    A sampled controller that starts from these values takes over without a jump of its command.
    `toolbox.robustness.TakenOver` makes such starts on each plant that is judged.

    Parameters
    ----------
    run
        A run that sticks and slips to its end, such as the run of a stiff drive. Its loop gives the contact that is
        judged.
    count
        Number of phases, by default 8. The first is the release.

    Returns
    -------
    list of {state or command: value}
        `count` mappings, from release to release.

    Raises
    ------
    SceneError
        If the run has fewer than two releases, or the count is below 1.

    Examples
    --------
    >>> from controllers import StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, simulate
    >>> from toolbox.robustness import cycle_phases
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), StiffPI(reference="60 rpm"), sample_time="10 ms")
    >>> starts = cycle_phases(simulate(loop, "100 s"), count=4)
    >>> print([round(start["top.torque"]) for start in starts], "N m")
    [14391, 13530, 6864, 9676] N m
    """
    whole("count", count, 1)
    contact = judged_contact(run.run.loop)
    released = releases(run, contact)
    if len(released) < 2:
        raise SceneError(
            f"Argument `run` must stick and slip at `{contact}` at least twice to have phases, but it has {len(released)} release(s)."
        )
    first, last = released[-2:]
    return [acting_at(run, first + (last - first) * k / count) for k in range(count)]


def acting_at(run: Trajectory, time: float) -> dict[str, Any]:
    """States of the plant, and the commands of its controllers, at an instant of a run [s]."""
    point, plant = run.at(time), run.run.plant
    commands = [name for name in plant.inputs if name not in run.run.loop.system.inputs]
    return {name: value_at(point, name, size) for name, (_, size, _) in plant.states.items()} | {
        name: float(point[name]) for name in commands
    }


def taken_over(loop: ClosedLoop, start: Any) -> dict[str, Any]:
    """Start values of a loop that takes over at an instant: commands that it does not hold are given by the state of a continuous controller instead."""
    values = states_of(start, loop.plant)
    commands = {name: values.pop(name) for name in loop.plant.inputs if name in values}
    held = {name for update in loop.system.updates for name in update.names}
    values |= {name: value for name, value in commands.items() if name in held}
    own = [name for name, (_, size, _) in loop.system.states.items() if name not in loop.plant.states and size is None]
    wanted = [name for name in commands if name not in held and loop.system.has_signal(name)]
    if len(own) == len(wanted) == 1 and own[0] not in values:
        values |= _same_command(loop, values, own[0], wanted[0], float(commands[wanted[0]]))
    return values


def _same_command(loop: ClosedLoop, values: Mapping[str, Any], own: str, command: str, wanted: float) -> dict[str, float]:
    """{own: value} with which a continuous controller asks for a command at the start; empty if its state does not decide the command alone and linearly.

    A command beyond the limits of the controller is asked for as well, as by a sampled controller: it acts at its limit, and the state is not zero.
    """

    @cache
    def given(value: float) -> float:
        return float(simulate(loop.replace(start={**values, own: value}), 1e-9).at(0.0)[command])

    found = _between_limits(given)
    if found is None:
        return {}
    inside, slope = found
    value = inside + (wanted - given(inside)) / slope
    same = abs(given(value) - wanted) <= 1e-6 * max(abs(wanted), abs(slope))
    limited = given(value) == given(2.0 * value - inside) and (given(value) - given(inside)) * (wanted - given(value)) > 0.0
    return {own: value} if same or limited else {}


def _between_limits(given: Callable[[float], float]) -> tuple[float, float] | None:
    """(a state at which a command is not limited, slope of the command there); None if no state moves the command."""
    ends = next(((-size, size) for size in WIDER if given(-size) != given(size)), None)
    if ends is None:
        return None
    for _ in range(HALVINGS):
        low, high = ends
        middle = 0.5 * (low + high)
        change = given(high) - given(low)
        if abs(given(middle) - given(low) - 0.5 * change) <= STRAIGHT * abs(change):
            return middle, change / (high - low)
        ends = (low, middle) if abs(given(middle) - given(low)) > abs(given(high) - given(middle)) else (middle, high)
    return None


def under_held_commands(loop: ClosedLoop) -> Iterator[dict[str, Any]]:
    """Phases of the stick-slip of the plant whose commands are held at their values in smooth running; none if it does not stick and slip."""
    with contextlib.suppress(SceneError, SimulationError):
        commands = [name for name in loop.plant.inputs if name not in loop.system.inputs]
        points = smooth_points(loop, {})
        if commands and points:
            held = {name: float(points[0][name]) for name in commands}
            yield from cycle_phases(
                simulate(loop.without_controllers.replace(inputs={**loop.without_controllers.inputs, **held}, start={}), 200.0)
            )


def under_controller(loop: ClosedLoop, initial: Any, phases: int, duration: float) -> tuple[list[dict[str, Any]], str]:
    """Start values of a loop that takes over the stick-slip of another controller at phases of its cycle, and an empty note.

    Without stick-slip, return the last instant of the run and a note that says so. The other controller has the set-point of the loop.
    Raises SimulationError if its run cannot be finished.
    """
    contact = judged_contact(loop)
    aim = reference_of(loop, judged_speed(loop, contact))
    initial = initial if aim is None else at_set_point(initial, aim)
    alone = loop.without_controllers.replace(controllers=(initial,), inputs={}, start={})
    run = simulate(alone.replace(inputs={name: value for name, value in loop.inputs.items() if _takes(alone, name)}), duration)
    if len(releases(run, contact)) < 2 or not is_stick(stuck_ratio(run, contact, 0.8 * duration)):
        return [taken_over(loop, acting_at(run, run.end))], f"no stick-slip to end under {described(initial)}"
    return [taken_over(loop, start) for start in cycle_phases(run, phases)], ""


def _takes(loop: ClosedLoop, name: str) -> bool:
    """Whether a loop has an input, or a parameter that an input may take the place of."""
    return name in loop.system.inputs or loop.system.has_parameter(name) or loop.system.has_signal(name)


def at_set_point(law: Any, reference: float) -> Any:
    """Return a controller with this set-point [rad/s], also in the controllers inside of it. An object that is no dataclass is returned
    unchanged."""
    if not dataclasses.is_dataclass(law):
        return law
    changed = {each.name: at_set_point(getattr(law, each.name), reference) for each in dataclasses.fields(law) if each.init}
    changed = {name: value for name, value in changed.items() if isinstance(value, Controller) and value is not getattr(law, name)}
    if isinstance(law, Controller) and hasattr(law, "reference"):
        changed["reference"] = reference
    return dataclasses.replace(law, **changed) if changed else law


def reference_of(loop: ClosedLoop, speed: str) -> float | None:
    """The set-point of a loop, of its target or of the input that its controllers follow; None if there is none."""
    aim, own = loop.target(speed), set_point(loop.system, speed)
    return aim if aim is not None else None if own is None else float(loop.number(own).value)
