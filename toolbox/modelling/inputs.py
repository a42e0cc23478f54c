"""Inputs in time: tables and named shapes. Every number may be text with a unit: `ramp("35 rpm", "60 rpm", "60 s", "80 s")`.

They are imported from `toolbox.inputs`. The swept sine is `toolbox.inputs.sweep`; `toolbox.sweep` is another thing and varies the numbers of a machine.
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import finite_array, number, whole
from toolbox.errors import SceneError
from toolbox.files.units import TypedNumber, parse
from toolbox.modelling import start_up as planned

UNITS: dict[str, dict[str, str]] = {
    "step": {"before": "", "after": "", "at": "s"},
    "ramp": {"start": "", "end": "", "begin": "s", "finish": "s"},
    "sine": {"mean": "", "amplitude": "", "frequency": "Hz", "phase": "rad"},
    "square": {"mean": "", "amplitude": "", "frequency": "Hz", "until": "s"},
    "triangle": {"mean": "", "amplitude": "", "frequency": "Hz", "until": "s"},
    "sweep": {"mean": "", "amplitude": "", "start": "Hz", "end": "Hz", "duration": "s"},
    "noise": {"mean": "", "deviation": "", "corner": "Hz", "seed": "1"},
    "start_up": {
        "end": "", "begin": "s", "wind_up": "s", "catch": "s", "inertia": "kg m2", "stiffness": "N m/rad", "static": "N m", "kinetic": "N m",
        "decay": "s/rad", "drag": "N m s/rad", "damping": "N m s/rad", "drive_inertia": "kg m2", "drive_drag": "N m s/rad", "proportional": "N m s/rad",
        "integral": "N m/rad", "delay": "s",
    },
}  # fmt: skip
"""Units of the numbers of each shape; empty for the unit of the signal."""

OPTIONAL = {"sine": ("phase",), "start_up": ("drag", "damping", "drive_inertia", "drive_drag", "proportional", "integral", "delay")}
"""Numbers of a shape that may be left out."""


@dataclass(frozen=True)
class Table:
    """Input given by a table: linear between nodes, constant outside. A repeated time is a jump.

    Attributes
    ----------
    times, values
        Nodes. The times [s] do not decrease.
    typed
        Values that were typed with units, such as "60 rpm". Empty if none were.
    shape, numbers
        The function of this module that made the table, and its numbers by name. Empty for a table that was given
        directly.

    Examples
    --------
    >>> from models import Block
    >>> from toolbox import compose, simulate
    >>> run = simulate(compose(Block()), "10 s", inputs={"block.force": ([0.0, 5.0, 10.0], [0.0, 2.0, 0.0])})
    >>> print(f"{run.at(2.5)['block.force']:.1f} N")
    1.0 N
    """

    times: np.ndarray
    values: np.ndarray
    typed: tuple[Any, ...] = field(default=(), compare=False, repr=False)
    shape: str = field(default="", compare=False, repr=False)
    numbers: Mapping[str, float] = field(default_factory=dict, compare=False, repr=False)

    @staticmethod
    def of(name: str, times: Sequence[float] | np.ndarray, values: Sequence[float] | np.ndarray) -> Table:
        """Return a table of the nodes `times` [s] and `values` for the input `name`, after a check. Raises a SceneError that names the input.

        Parameters
        ----------
        name
            Name of the input, for error messages.
        times
            Times of the nodes [s], increasing, shape (n,).
        values
            Values at these times in the SI unit of the input, shape (n,).
        """
        t, v = finite_array(times), finite_array(values)
        if t is None or v is None:
            raise SceneError(f"Argument `{name}` must be (times, values) of finite numbers, but it is ({times!r}, {values!r}).")
        if t.ndim != 1 or t.shape != v.shape or not t.size:
            raise SceneError(f"Argument `{name}` must have as many times as values, but it has shapes {t.shape} and {v.shape}.")
        if (np.diff(t) < 0).any():
            raise SceneError(f"Argument `{name}` must have non-decreasing times.")
        return Table(t, v)

    def segments(self) -> np.ndarray:
        """Return the linear pieces of the table, shape (pieces, 4), with the columns begin [s], value, slope, and time
        at which the piece has this value [s].

        The first piece begins at -infinity.
        """
        width = np.append(np.diff(self.times), np.inf)
        rise = np.append(np.diff(self.values), 0.0)
        kept = width > 0.0  # of a time that is repeated the last value holds
        pieces = np.stack([self.times[kept], self.values[kept], rise[kept] / width[kept], self.times[kept]], axis=1)
        return np.vstack([[-np.inf, self.values[0], 0.0, 0.0], pieces])


@dataclass(frozen=True)
class Shape:
    """Input given by a formula of time with coefficients. `sine`, `sweep` and `noise` make it. Other coefficients need no new compilation.

    Attributes
    ----------
    kind
        Name of the formula.
    coefficients
        Coefficients of the formula.
    typed, shape, numbers
        The same as for a `Table`.

    Examples
    --------
    >>> from toolbox.inputs import sine
    >>> load = sine(10.0, 2.0, frequency=0.5)
    >>> print(load.range())
    (8.0, 12.0)
    """

    kind: str
    coefficients: tuple[float, ...]
    typed: tuple[Any, ...] = field(default=(), compare=False, repr=False)
    shape: str = field(default="", compare=False, repr=False)
    numbers: Mapping[str, float] = field(default_factory=dict, compare=False, repr=False)

    def expression(self, t: ca.SX, c: ca.SX) -> ca.SX:
        """Return the formula as an expression of the symbols of time and coefficients.

        Parameters
        ----------
        t
            Casadi symbol of the time.
        c
            Column of casadi symbols of the coefficients.
        """
        return _FORMULAS[self.kind](t, c)

    def range(self) -> tuple[float, float]:
        """Return the smallest and the largest value of the input (for noise, bounds of them)."""
        most = abs(self.coefficients[1]) * (math.sqrt(2.0 * WAVES) if self.kind == "noise" else 1.0)
        return self.coefficients[0] - most, self.coefficients[0] + most


@dataclass(frozen=True)
class Typed:
    """Input whose values were typed with units, such as `ramp("35 rpm", "60 rpm", "60 s", "80 s")`.

    The values are converted to SI when the input is connected to a signal.

    Examples
    --------
    >>> from toolbox.inputs import ramp
    >>> print(ramp("30 rpm", "60 rpm", "60 s", "80 s").made("top.reference", "rad/s").values.round(2), "rad/s")
    [3.14 6.28] rad/s
    """

    shape: Callable[..., Any]
    numbers: Mapping[str, Any]

    def made(self, name: str, unit: str) -> Table | Shape:
        """Return the shape as input of a signal in its unit. Raises SceneError if a value does not fit.

        Parameters
        ----------
        name
            Name of the signal.
        unit
            SI unit of the signal.
        """
        units = UNITS[self.shape.__name__]
        return _made(self.shape, {key: parse(value, units[key] or unit, f"{name}.{key}") for key, value in self.numbers.items()})


def _made(shape: Callable[..., Any], numbers: Mapping[str, Any]) -> Any:
    """A shape that remembers its numbers, and which of its values were typed."""
    units = UNITS[shape.__name__]
    typed = tuple(value for key, value in numbers.items() if isinstance(value, TypedNumber) and not units[key])
    return replace(shape(**numbers), typed=typed, shape=shape.__name__, numbers=dict(numbers))


def _typed(shape: Callable[..., Any]) -> Callable[..., Any]:
    """A shape that takes text with units, too."""
    signature, units = inspect.signature(shape), UNITS[shape.__name__]

    @functools.wraps(shape)
    def made(*given: Any, **named: Any) -> Any:
        bound = signature.bind(*given, **named)
        bound.apply_defaults()
        arguments = bound.arguments.items()
        numbers = {key: parse(value, units[key], key) if isinstance(value, str) and units[key] else value for key, value in arguments}
        return Typed(shape, numbers) if any(isinstance(value, str) for value in numbers.values()) else _made(shape, numbers)

    return made


WAVES, HIGHEST = 24, 5.0
"""Sines of a noise, and its highest frequency by its corner."""


def _waves(t: ca.SX, c: ca.SX) -> ca.SX:
    """The noise of (mean, deviation, corner, seed, frequencies by the corner, phases); the seed is in the last two."""
    frequencies, phases = c[2] * c[4 : 4 + WAVES], c[4 + WAVES : 4 + 2 * WAVES]
    return c[0] + c[1] * math.sqrt(2.0 / WAVES) * ca.sum1(ca.sin(2.0 * math.pi * (frequencies * t + phases)))


_FORMULAS: dict[str, Callable[[ca.SX, ca.SX], ca.SX]] = {
    "sine": lambda t, c: c[0] + c[1] * ca.sin(2 * ca.pi * c[2] * t + c[3]),
    "noise": _waves,
    "sweep": lambda t, c: c[0] + c[1] * ca.sin(2 * ca.pi * (c[2] + (c[3] - c[2]) * t / (2 * c[4])) * t),
}


@_typed
def step(before: float, after: float, at: float) -> Table:
    """Return an input that jumps from `before` to `after` at the time `at`.

    Parameters
    ----------
    before, after
        Values before and after the jump, in the SI unit of the input.
    at
        Time of the jump [s].

    Returns
    -------
    Table
        The input, for `inputs=` of `simulate` or `closed_loop`.

    Examples
    --------
    >>> from models import Block
    >>> from toolbox import compose, simulate
    >>> from toolbox.inputs import step
    >>> run = simulate(compose(Block(damping=1.0)), "20 s", inputs={"block.force": step(0.0, 2.0, at=5.0)})
    >>> print(f"{run.at(5.0)['block.position']:.2f} m, then {run.at(20.0)['block.position']:.2f} m")
    0.00 m, then 2.00 m
    """
    return Table.of("step", (at, at), (before, after))


@_typed
def ramp(start: float, end: float, begin: float, finish: float) -> Table:
    """Return an input that rises linearly from `start` to `end` and is constant before and after.

    Parameters
    ----------
    start, end
        Values before and after the ramp, in the SI unit of the input.
    begin, finish
        Times at which the ramp begins and ends [s].

    Returns
    -------
    Table
        The input, for `inputs=` of `simulate` or `closed_loop`.

    Examples
    --------
    >>> from models import Block
    >>> from toolbox import compose, simulate
    >>> from toolbox.inputs import ramp
    >>> run = simulate(compose(Block()), "10 s", inputs={"block.force": ramp(0.0, 4.0, begin=2.0, finish=10.0)})
    >>> print(f"{run.at(6.0)['block.force']:.2f} N")
    2.00 N
    """
    return Table.of("ramp", (begin, finish), (start, end))


@_typed
def sine(mean: float, amplitude: float, frequency: float, phase: float = 0.0) -> Shape:
    """Return a sine: mean + amplitude sin(2 pi frequency t + phase).

    Parameters
    ----------
    mean, amplitude
        Mean and amplitude, in the SI unit of the input.
    frequency
        Frequency [Hz].
    phase
        Phase at the time 0 [rad], by default 0.

    Returns
    -------
    Shape
        The input, for `inputs=` of `simulate` or `closed_loop`.

    Examples
    --------
    >>> from models import Block
    >>> from toolbox import compose, simulate
    >>> from toolbox.inputs import sine
    >>> run = simulate(compose(Block()), "10 s", inputs={"block.force": sine(1.0, 0.5, frequency=0.1)})
    >>> print(f"{run.at(2.5)['block.force']:.2f} N")
    1.50 N
    """
    return Shape("sine", _checked("sine", mean, amplitude, frequency, phase))


@_typed
def sweep(mean: float, amplitude: float, start: float, end: float, duration: float) -> Shape:
    """Return a swept sine around `mean`, whose frequency grows linearly in time.

    After `duration` the frequency continues to grow at the same rate.

    Parameters
    ----------
    mean, amplitude
        Mean and amplitude, in the SI unit of the input.
    start, end
        Frequency at the time 0 and at the time `duration` [Hz].
    duration
        Time in which the frequency grows from `start` to `end` [s].

    Returns
    -------
    Shape
        The input, for `inputs=` of `simulate` or `closed_loop`.

    Examples
    --------
    >>> from models import Block
    >>> from toolbox import compose, inputs, measure, simulate
    >>> chirp = inputs.sweep(0.0, 0.1, start=0.05, end=0.25, duration=200.0)
    >>> run = simulate(compose(Block(damping=0.1)), "200 s", inputs={"block.force": chirp})
    >>> print(f"{measure.extent(run, 'block.position').maximum:.2f} m at resonance")
    0.78 m at resonance
    """
    number("duration", duration, "s", above=0)
    return Shape("sweep", _checked("sweep", mean, amplitude, start, end, duration))


@_typed
def noise(mean: float, deviation: float, corner: float, seed: float = 0) -> Shape:
    """Return coloured noise with the spectrum of a first-order low-pass filter, as a smooth sum of sines.

    The spectrum is cut at five times the corner frequency.

        mean + deviation sqrt(2 / n) sum over k of sin(2 pi f_k t + phase_k),   n = 24,   f_k drawn in the k-th of n bands of equal power

    Source: the sum of S. O. Rice, Bell System Tech. J. 23 (1944) 282-332.

    Parameters
    ----------
    mean, deviation
        Mean and standard deviation (at least 0), in the SI unit of the input. No value is further from the mean than
        7 standard deviations.
    corner
        Corner frequency [Hz], > 0. 57 % of the power lies below the corner frequency, and none above five times the
        corner frequency.
    seed
        Whole number from 0 to a million, by default 0. Another seed gives another realisation.

    Returns
    -------
    Shape
        The input, for `inputs=` of `simulate` or `closed_loop`.

    Examples
    --------
    >>> from models import Block
    >>> from toolbox import compose, measure, simulate
    >>> from toolbox.inputs import noise
    >>> run = simulate(compose(Block()), "500 s", inputs={"block.force": noise(2.0, 0.3, corner=0.5)})
    >>> print(f"{measure.mean_square(run, 'block.force', target=2.0) ** 0.5:.2f} N")
    0.30 N
    """
    number("corner", corner, "Hz", above=0)
    whole("seed", int(seed) if seed == round(seed) else seed, 0, 10**6)
    drawn = np.random.default_rng(int(seed)).random((2, WAVES))
    frequencies = np.tan(math.atan(HIGHEST) * (np.arange(WAVES) + 0.25 + 0.5 * drawn[0]) / WAVES)
    given = _checked("noise", mean, deviation, corner, seed)
    number("deviation", deviation, at_least=0)
    return Shape("noise", (*given, *frequencies.tolist(), *drawn[1].tolist()))


@_typed
def square(mean: float, amplitude: float, frequency: float, until: float) -> Table:
    """Return a square wave: mean + amplitude in the first half of every period, mean - amplitude in the second half.

    Parameters
    ----------
    mean, amplitude
        Mean and amplitude, in the SI unit of the input.
    frequency
        Frequency [Hz].
    until
        Time after which the input is constant [s].

    Returns
    -------
    Table
        The input, for `inputs=` of `simulate` or `closed_loop`.

    Examples
    --------
    >>> from models import Block
    >>> from toolbox import compose, simulate
    >>> from toolbox.inputs import square
    >>> run = simulate(compose(Block()), "10 s", inputs={"block.force": square(1.0, 0.5, frequency=0.2, until=10.0)})
    >>> print(f"{run.at(1.0)['block.force']:.1f} N, {run.at(4.0)['block.force']:.1f} N")
    1.5 N, 0.5 N
    """
    half = _half_periods("square", mean, amplitude, frequency, until)
    times = np.repeat(half, 2)[1:-1]
    sides = np.where(np.arange(half.size - 1) % 2 == 0, 1.0, -1.0)
    return Table.of("square", times, mean + amplitude * np.repeat(sides, 2))


@_typed
def triangle(mean: float, amplitude: float, frequency: float, until: float) -> Table:
    """Return a triangle wave: in every period from the mean up to mean + amplitude, down to mean - amplitude and back.

    Parameters
    ----------
    mean, amplitude
        Mean and amplitude, in the SI unit of the input.
    frequency
        Frequency [Hz].
    until
        Time after which the input is constant [s].

    Returns
    -------
    Table
        The input, for `inputs=` of `simulate` or `closed_loop`.

    Examples
    --------
    >>> from models import Block
    >>> from toolbox import compose, simulate
    >>> from toolbox.inputs import triangle
    >>> run = simulate(compose(Block()), "10 s", inputs={"block.force": triangle(1.0, 0.5, frequency=0.2, until=10.0)})
    >>> print(f"{run.at(1.25)['block.force']:.2f} N")
    1.50 N
    """
    half = _half_periods("triangle", mean, amplitude, frequency, until)
    peaks = 0.5 * (half[1:] + half[:-1])
    sides = np.where(np.arange(peaks.size) % 2 == 0, 1.0, -1.0)
    return Table.of("triangle", np.append(0.0, peaks), mean + amplitude * np.append(0.0, sides))


@_typed
def start_up(
    end: float,
    begin: float,
    wind_up: float,
    catch: float,
    inertia: float,
    stiffness: float,
    static: float,
    kinetic: float,
    decay: float,
    drag: float = 0.0,
    damping: float = 0.0,
    drive_inertia: float = 0.0,
    drive_drag: float = 0.0,
    proportional: float = 0.0,
    integral: float = 0.0,
    delay: float = 0.0,
) -> Table:
    """Return the set-point that starts a string with a bit on rock from rest, so that no stick-slip follows.

    The string is wound up until the bit breaks free. The bit is then caught: its speed goes to the final speed within
    the time `catch`, and the twist of the string goes to the twist that the rock needs at this speed. A step or a ramp
    of the set-point leaves the string with too much twist, and the bit may stick and slip permanently.

    The string is one spring between a drive and an inertia, with J y' = T - F(y) - drag y at the bit and

        F(y) = kinetic + (static - kinetic) exp(-decay y)

    Without `proportional` the result is the speed of the top. With the gains of a PI controller it is the set-point
    with which this controller gives the top this speed. `toolbox.drilling.start_up` reads all numbers from a loop.

    The idea of a planned start: U. J. F. Aarsnes, F. Di Meglio, R. J. Shor, J. Process Control 70 (2018) 24-35. The
    motion and its formulas are choices of this toolbox.

    Parameters
    ----------
    end
        Final speed [rad/s], > 0.
    begin
        Time at which the start begins [s].
    wind_up
        Time in which the string is wound up, until the bit breaks free [s], > 0.
    catch
        Time in which the bit goes from its release to the final speed [s], > 0. 0.7 periods of the string below a
        drive that holds its speed suit drives with torque limits.
    inertia
        Inertia J below the drive [kg m2].
    stiffness
        Stiffness of the string [N m/rad].
    static, kinetic
        Torque of the rock at rest and at high speed [N m].
    decay
        Decay of the torque of the rock with the bit speed [s/rad].
    drag
        Viscous drag of the bit [N m s/rad], by default 0.
    damping
        Damping of the string between drive and inertia [N m s/rad], by default 0.
    drive_inertia, drive_drag
        Inertia [kg m2] and viscous drag [N m s/rad] of the drive, by default 0. Used with `proportional`.
    proportional, integral
        Gains of the PI controller [N m s/rad, N m/rad], by default 0: the result is the speed of the top.
    delay
        Time from a measurement to its effect, with half a sample time [s], by default 0.

    Returns
    -------
    Table
        The input, for `inputs=` of `simulate` or `closed_loop`.

    Raises
    ------
    SceneError
        If a number is out of its range.

    Examples
    --------
    >>> from toolbox.inputs import start_up
    >>> top = start_up("60 rpm", "0 s", "25 s", "4 s", 374.0, 473.0, static=12.1e3, kinetic=7.6e3, decay=0.9)
    >>> print(f"{top.made('top.speed', 'rad/s').values[-1]:.2f} rad/s")
    6.28 rad/s
    """
    for name, value in {
        "end": end,
        "wind_up": wind_up,
        "catch": catch,
        "inertia": inertia,
        "stiffness": stiffness,
        "static": static,
        "decay": decay,
    }.items():
        number(name, value, above=0)
    number("kinetic", kinetic, above=0, at_most=static)
    rest = {
        "drag": drag,
        "damping": damping,
        "drive_inertia": drive_inertia,
        "drive_drag": drive_drag,
        "proportional": proportional,
        "integral": integral,
        "delay": delay,
    }
    for name, value in rest.items():
        number(name, value, at_least=0)
    found = planned.motion(end, wind_up, catch, inertia, stiffness, static, kinetic, decay, drag, damping)
    values = found.top if not proportional else planned.commanded(found, drive_inertia, drive_drag, proportional, integral, delay)
    nodes = np.append(np.arange(0, values.size - 1, planned.COARSE), values.size - 1)
    return Table.of("start_up", np.append(begin, begin + planned.STEP * (nodes + 1)), np.append(0.0, values[nodes]))


def _half_periods(kind: str, mean: float, amplitude: float, frequency: float, until: float) -> np.ndarray:
    """Begins of all half periods up to the first one not before `until`."""
    _checked(kind, mean, amplitude, frequency, until)
    number("frequency", frequency, "Hz", above=0)
    number("until", until, "s", above=0)
    if frequency * until > 1e6:
        raise SceneError(f"Argument `until` of a {kind} must leave at most 1e6 periods, but there are {frequency * until:g}.")
    return np.arange(int(np.ceil(2 * frequency * until * (1 - 1e-12))) + 1) / (2 * frequency)


def _checked(kind: str, *numbers: Any) -> tuple[float, ...]:
    return tuple(number(f"number of a {kind}", each) for each in numbers)
