"""The planned start of a drill string from rest, with its numbers read from a loop."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from toolbox.arguments import number
from toolbox.errors import SceneError
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.inputs import Table
from toolbox.modelling.inputs import start_up as shape
from toolbox.modelling.laws import Sampled

CATCH = 0.7
"""Time in which the bit is caught, in periods of the string below a drive that holds its speed."""


def start_up(
    loop: ClosedLoop,
    end: NumberOrText,
    *,
    begin: NumberOrText = 0.0,
    wind_up: NumberOrText = 25.0,
    catch: NumberOrText | None = None,
) -> Table:
    """Return the set-point that starts a drill string from rest to a final speed without stick-slip.

    The numbers of `toolbox.inputs.start_up` are read from the plant and the controller of the loop: all inertias below
    the drive as one, all springs in series with their damping, the drag of drive and bit, the torque of the rock, the gains of a PI or soft
    torque controller, and its delay. Rock whose torque does not fall exponentially with speed is described by its torque
    at rest, at 100 rad/s and at 1 rad/s. For a controller without the fields `proportional` and `integral` the result is
    the speed of the top drive.

    Parameters
    ----------
    loop
        Closed loop with a chain of inertias, a contact `bit` and at most one controller.
    end
        Final speed [rad/s], or text with a unit, > 0.
    begin
        Time at which the start begins [s], by default 0.
    wind_up
        Time in which the string is wound up, until the bit breaks free [s], by default 25.
    catch
        Time in which the bit goes from its release to the final speed [s]. By default 0.7 periods of the string below
        a drive that holds its speed.

    Returns
    -------
    Table
        The set-point, for `inputs=` of `simulate` or `closed_loop`. Its attribute `numbers` holds the numbers for the
        key `start_up` of a scene file.

    Raises
    ------
    SceneError
        If the plant has no chain of inertias or no contact `bit`, or a number is out of its range.

    Examples
    --------
    >>> from controllers import StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, simulate
    >>> from toolbox.drilling import start_up
    >>> drive = Sampled(StiffPI(lowest_torque=0.0, highest_torque="20 kN m"), "10 ms", delay="30 ms")
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), drive)
    >>> for asked in ("7 rad/s", start_up(loop, "7 rad/s")):
    ...     run = simulate(loop, "150 s", inputs={"top.reference": asked})
    ...     print(f"{run.time_in('bit', 'stick', after=100.0):.1f} s in stick")
    16.9 s in stick
    0.0 s in stick
    """
    plant = loop.plant
    try:
        inertia, stiffness = (np.atleast_1d(plant.parameter(f"chain.{name}")) for name in ("inertia", "stiffness"))
    except SceneError as error:
        raise SceneError(f"A start-up is planned for a chain of inertias: {error}") from None
    below, spring = float(inertia[1:].sum()), 1.0 / float((1.0 / stiffness).sum())
    static, middle, kinetic = _rock(plant)
    falls = static > middle > kinetic
    damping = np.atleast_1d(plant.parameter("chain.damping"))
    law = loop.designed_controllers[0] if len(loop.designed_controllers) == 1 else None
    clock = loop.controllers[0] if loop.controllers and isinstance(loop.controllers[0], Sampled) else None
    period = 2.0 * math.pi * math.sqrt(below / spring)
    found: Table = shape(
        number("end", end, "rad/s", above=0),
        number("begin", begin, "s"),
        number("wind_up", wind_up, "s", above=0),
        CATCH * period if catch is None else number("catch", catch, "s", above=0),
        below,
        spring,
        static,
        min(kinetic, static),
        math.log((static - kinetic) / (middle - kinetic)) if falls else 1.0,
        float(plant.parameter("chain.bit_drag")),
        float(np.sum(damping * (spring / stiffness) ** 2)),
        float(inertia[0]),
        float(plant.parameter("chain.top_drag")),
        float(getattr(law, "proportional", None) or 0.0),
        float(getattr(law, "integral", None) or 0.0),
        0.0 if clock is None else clock.delay + 0.5 * clock.period,
    )
    return found


def _rock(plant: HybridSystem) -> tuple[float, float, float]:
    """Torque of the rock [N m] at rest, at 1 rad/s and at 100 rad/s. Raises SceneError for a plant without a contact `bit`."""
    element = next((each for each in plant.elements if each.name == "bit"), None)
    if element is None:
        raise SceneError("A start-up is planned for a bit on rock, but the plant has no contact `bit`.")
    row = np.array(ca.DM(ca.jacobian(element.slip, plant.x))).ravel()
    torques = ca.Function("rock", [plant.x, plant.u, plant.p, plant.m, plant.t], [element.static, element.kinetic])
    inputs, modes = plant.input_defaults(plant.values), np.ones(len(plant.elements))
    rest, slow, fast = (torques(speed * row, inputs, plant.values, modes, 0.0) for speed in (1e-9, 1.0, 100.0))
    return float(rest[0]), float(slow[1]), float(fast[1])
