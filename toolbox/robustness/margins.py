"""What a closed loop bears at its working point: the margins of its linear loop, or, where it has none, those measured on the machine."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from toolbox.arguments import mapping, number
from toolbox.errors import SceneError
from toolbox.files.printing import Rows, Told, shown
from toolbox.files.results import HeadedRows, Result
from toolbox.files.unit_systems import reading
from toolbox.files.units import NumberOrText
from toolbox.messages import sign_of_life
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.closing import all_described
from toolbox.robustness.disk_margins import JointMargins, LoopMargins, frequencies, joint_margins, largest_disk, loop_margins
from toolbox.robustness.measured import MeasuredMargins, measured_margins
from toolbox.steady_states.linear import input_values
from toolbox.steady_states.linear_loop import LinearLoop, NoDerivative
from toolbox.steady_states.steady_loop import smooth_start, steady_loop


@dataclass(frozen=True)
class Margins(Told, Result):
    """Stability margins of a closed loop at smooth running, the result of `margins`: `print(found)` shows them,
    `found.plot()` draws the Nyquist curve and the sensitivity.

    Attributes
    ----------
    title
        The controllers and how they run.
    stable
        Whether the linear loop is stable. False if there is no linear loop.
    loop_margins
        `LoopMargins` of every command, while the loops of all other commands are closed.
    multiloop
        `JointMargins` of all commands together. None if there is only one command.
    operating_point, units
        {name: value in SI} of set-points, commands and scalar states at the operating point, and {name: unit} of the
        set-points and commands.
    reason
        Reason why there is no linear loop. Empty if there is one.
    simulated_margins
        Margins found by simulation. None if they were not requested.
    linear_loop
        The linear loop, for other tools.
    display_units
        {SI unit: unit that was typed}: the units in which `print` answers.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, margins
    >>> found = margins(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm")))
    >>> print(f"{found.disk_margin:.2f}")
    0.41
    """

    title: str
    stable: bool
    loop_margins: tuple[LoopMargins, ...]
    multiloop: JointMargins | None = None
    operating_point: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    reason: str = ""
    simulated_margins: MeasuredMargins | None = None
    linear_loop: LinearLoop | None = field(default=None, repr=False)
    display_units: Mapping[str, str] = field(default_factory=dict)

    def _table(self) -> HeadedRows:
        """One row per command."""
        names = [each.name for each in dataclasses.fields(LoopMargins)]
        return names, [[getattr(row, name) for name in names] for row in self.loop_margins]

    def __getitem__(self, command: str) -> LoopMargins:
        """The margins of one command; raises SceneError for a name that is none."""
        for row in self.loop_margins:
            if row.command == command:
                return row
        raise SceneError(f"There are no margins of `{command}`: the commands are {', '.join(row.command for row in self.loop_margins)}.")

    @property
    def disk_margin(self) -> float:
        """Disk margin alpha of all commands together [1]. 0 if the loop is unstable, nan if there is no linear loop."""
        return self.multiloop.disk_margin if self.multiloop is not None else self.loop_margins[0].disk_margin

    @property
    def peak_sensitivity(self) -> float:
        """Largest gain of the sensitivity, M_s [1]."""
        return self.multiloop.peak_sensitivity if self.multiloop is not None else self.loop_margins[0].peak_sensitivity

    @property
    def delay_margin(self) -> float:
        """Smallest additional delay of a single command that makes the loop unstable [s]."""
        return min(row.delay_margin for row in self.loop_margins)

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The table as text: one line per command, and one for all together."""
        lines: list[tuple[str, ...]] = [("command", "disk margin", "at [rad/s]", "M_s", "gain", "phase", "delay")]
        for row in self.loop_margins:
            lines.append(
                (
                    row.command, shown(row.disk_margin), shown(row.disk_frequency), shown(row.peak_sensitivity),
                    _range(row.lowest_gain, row.highest_gain), shown(math.degrees(row.phase_margin), unit=" deg"),
                    _time(row.delay_margin),
                )
            )  # fmt: skip
        if self.multiloop is not None:
            joint = self.multiloop
            for label, value in (("all, each its own", joint.disk_margin), ("all, mixed", joint.unstructured_margin)):
                lines.append((label, shown(value), shown(joint.disk_frequency), shown(joint.peak_sensitivity), "", "", ""))
        if self.simulated_margins is not None:
            found = self.simulated_margins
            lines.append(("measured", "-", "-", "-", _range(found.lowest_gain, found.highest_gain), "-", _time(found.delay)))
        return lines

    def _told(self) -> list[str | Rows]:
        read = {name: reading(unit, self.display_units) for name, unit in self.units.items()}
        at = ", ".join(f"{name} = {self.operating_point[name] * each.factor:.4g}{each.tail}" for name, each in read.items())
        lines: list[str | Rows] = [f"Margins of {self.title}" + (f" at {at}" if at else ""), Rows(self.rows)]
        if self.simulated_margins is not None and not math.isnan(self.simulated_margins.highest_inertia):
            lines.append(
                f"  measured: the inertia may be {_range(self.simulated_margins.lowest_inertia, self.simulated_margins.highest_inertia)} times what it is"
            )
        if self.reason:
            lines.append(f"  There is no linear loop: {self.reason}.")
        elif not self.stable:
            lines.append("  The linear loop is unstable.")
        return lines

    def plot(self, axes: Any = None) -> Any:
        """Draw the Nyquist curve with the disk of the disk margin, and the sensitivities. Return both axes.

        Raises SceneError if there is no linear loop.

        Parameters
        ----------
        axes
            Two matplotlib axes to draw on. By default None: a new figure.
        """
        if self.linear_loop is None:
            raise SceneError(f"There is no linear loop to be drawn: {self.reason}.")
        from toolbox.robustness.figures import margins_diagram

        return margins_diagram(self.linear_loop, self.loop_margins, axes=axes)


@sign_of_life("margins is at work")
@takes_loop
def margins(
    loop: ClosedLoop,
    *,
    guess: Mapping[str, Any] | None = None,
    by_simulation: bool | None = None,
    inertia_parameter: str | None = None,
    simulation_duration: NumberOrText = 60.0,
) -> Margins:
    """Compute disk margin, peak sensitivity, gain margin, phase margin and delay margin of a closed loop at smooth running.

    The plant is linearised at the steady state of the closed loop. A sampled controller is linearised as difference
    equations. Sampling, hold and delay are taken into account. The loop is broken at every input that a controller
    drives (`toolbox.steady_states.steady_loop`). `toolbox.robustness.disk_margins` defines each margin. Noise and
    encoder steps of `Sampled` are left out.

    Parameters
    ----------
    loop
        A loop with at least one controller and constant inputs.
    guess
        {state: value} near smooth running, from which the search for the steady state starts. By default None: the
        search starts from the set-points of the controllers. If it fails, an error asks for a guess.
    by_simulation
        Whether the gain, the delay and the inertia from which on smooth running is lost are also found by simulation (a
        few seconds). By default only if there is no linear loop: for relays, ideal sliding modes, an active limit, and
        controllers in Python.
    inertia_parameter
        Name of the inertia that is varied in these simulations, such as "chain.inertia.0". By default None: no inertia
        is varied.
    simulation_duration
        Length of each run of these simulations [s], by default 60.

    Returns
    -------
    Margins
        The margins of every command alone and of all together.

    Raises
    ------
    SceneError
        If an argument is wrong, or controllers have different periods. Also if measured margins are needed but no
        smooth running is known: give `guess`.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, margins
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> print(margins(closed_loop(rig, Sampled(SoftTorque(reference="60 rpm"), "10 ms", delay="30 ms"))))
    Margins of SoftTorque, sampled every 10 ms with a delay of 30 ms at top.reference = 60 rpm, top.torque = 1.055e+04 N m
      command     disk margin  at [rad/s]   M_s      gain     phase   delay
      top.torque        0.377         0.9  2.66  0 .. 207  21.6 deg  412 ms
    """
    simulation_duration = number("simulation_duration", simulation_duration, "s", above=0)
    plant, system, title = loop.plant, loop.system, all_described(loop.controllers)
    reason, found = "", None
    try:
        found = steady_loop(loop, guess)
        linear = found.loop(0.0)
    except NoDerivative as none:
        reason = str(none)
    if found is None:
        drives = [name for name in plant.inputs if name not in system.inputs]
        result = Margins(title, False, tuple(LoopMargins(name) for name in drives), reason=reason, display_units=loop.display_units)
    else:
        late = found.loop if linear.period is not None else None
        rows = tuple(
            loop_margins(linear.alone(i), None if late is None else (lambda delay, i=i: late(delay, only=i).alone(i)))  # type: ignore[misc]
            for i in range(len(linear.actuated_signals))
        )
        joint = joint_margins(linear) if len(rows) > 1 else None
        set_points = _set_points(loop)
        units = {name: system.signal_unit(name) for name in (*set_points, *linear.actuated_signals)}
        result = Margins(title, linear.stable, rows, joint, {**set_points, **found.signals}, units, "", None, linear, loop.display_units)
    if by_simulation is None:
        by_simulation = found is None
    if not by_simulation:
        return result
    begin = dict(found.start) if found is not None else mapping("guess", guess) or smooth_start(loop)
    bears = measured_margins(loop.replace(start=begin), duration=float(simulation_duration), inertia=inertia_parameter)
    return Margins(**{**result.__dict__, "simulated_margins": bears})


def disk_margin(loop: ClosedLoop) -> float:
    """`margins(loop, by_simulation=False).disk_margin` alone, in about a third of the time."""
    try:
        linear = steady_loop(loop, None).loop(0.0)
    except NoDerivative:
        return math.nan
    if len(linear.actuated_signals) > 1:
        return joint_margins(linear).disk_margin
    alone = linear.alone(0)
    return 1 / largest_disk(alone, frequencies(alone))[0] if alone.stable else 0.0


def _set_points(loop: ClosedLoop) -> dict[str, float]:
    """{signal: value} of what laws are asked to keep, as it is given, or as the laws declare it."""
    values = zip(loop.system.inputs, input_values(loop.system, loop.input_values).tolist(), strict=True)
    return {name: value for name, value in values if name.endswith(".reference")}


def _range(low: float, high: float) -> str:
    return "-" if math.isnan(low) and math.isnan(high) else f"{shown(low)} .. {shown(high)}"


def _time(value: float) -> str:
    if math.isnan(value) or math.isinf(value):
        return shown(value)
    return f"{value:.3g} s" if value >= 1.0 else f"{1e3 * value:.3g} ms"
