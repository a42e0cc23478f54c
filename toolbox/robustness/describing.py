"""The describing function of a contact: which stick-slip the first harmonic predicts, beside the cycle that there is.

The machine is parted at one contact. What is left is linear around steady running: a force of the contact of frequency w moves its slip by G(i w). The
slip is taken to be a mean and one harmonic, v = v_0 + A cos(w t). The friction F(v) answers to that with a mean F_0 and a first harmonic of gain N:

    F_0(A, v_0) = 1 / (2 pi) int F(v_0 + A cos a) da,      N(A, v_0) = 1 / (pi A) int F(v_0 + A cos a) cos a da

    v_0 = v_s + G(0) (F_0 - F(v_s)),      1 = G(i w) N(A, v_0)

v_s is the slip of steady running. Without memory friction is in phase with slip, so that N is real: the frequencies are those at which G is real, and at
each of them N(A, v_0) = 1 / G. Under a constant torque several means v_0 may balance one amplitude, so both equations are solved together, along the line on
which the means are balanced. Seen by its own amplitude, a cycle holds where N falls with A and the imaginary part of G falls with w there, or both rise, and
is unstable otherwise (the criterion of Loeb). That is necessary, not enough: of the other poles of the machine with the gain N in place of the contact, none
may grow, or another swing takes over, and a change of the mean may not drive itself. For A > v_0 the harmonic runs backwards for a while, where the contact
itself sticks: such a cycle is stick-slip.

Higher harmonics are left out. A string is a filter that passes little of them, and how much they change is told by the cycle itself; so is for sure whether
it attracts, by the multipliers of `limit_cycle`.

Source: A. Gelb, W. E. Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, McGraw-Hill 1968, chapters 2, 3 and 6.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import casadi as ca
import numpy as np

from toolbox.arguments import FloatArray, number
from toolbox.errors import SceneError
from toolbox.files.printing import columns
from toolbox.files.results import HeadedRows, Result
from toolbox.files.unit_systems import reading
from toolbox.halving import zero
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.closing import all_described
from toolbox.modelling.steady_point import Equilibrium, function_of, mode_numbers
from toolbox.orbits.orbit import Cycle
from toolbox.scenes.judged import judged_contact
from toolbox.steady_states.linear import equilibrium
from toolbox.steady_states.linear_loop import STABLE, LinearLoop

ANGLES = 48
"""Angles of Gauss and Legendre at which friction is averaged over each part of half a turn in which the slip has one sign."""

AMPLITUDES, SMALL, LOWEST = 200, 12, 1e-4
"""Amplitudes at which N is looked at before its crossings are sought: so many in equal steps up to the highest one, and below the first of them so many in
equal ratios from this part of the highest one on, for the small cycles beside a Hopf point."""

EVEN, FINE, NEAREST = 70, 25, 1e-7
"""Differences between mean and amplitude at which the balance of constant forces is looked at: so many in equal steps, and so many in equal ratios on each
side of zero, where the contact begins to stick, from this part of the highest amplitude on."""


@dataclass(frozen=True)
class PredictedCycle:
    """A cycle of the first harmonic.

    Attributes
    ----------
    frequency
        Its frequency [rad/s].
    amplitude, mean
        Amplitude and mean of the slip, in the unit of the slip.
    gain
        N of the contact at both, which is 1 / G at the frequency: force over slip.
    stable
        Whether it attracts. An unstable one on which nothing else grows is the border between smooth running and stick-slip.
    growing
        Frequency of another swing [rad/s] that grows while this cycle runs, the fastest of them, 0 for growth without a swing; None where nothing else grows.
    """

    frequency: float
    amplitude: float
    mean: float
    gain: float
    stable: bool
    growing: float | None = None

    @property
    def period(self) -> float:
        """Its period [s]."""
        return 2.0 * math.pi / self.frequency

    @property
    def sticks(self) -> bool:
        """Whether the slip reaches zero."""
        return self.amplitude >= abs(self.mean)

    @property
    def words(self) -> str:
        """What a table says of it."""
        found = ("attracts" if self.stable else "unstable") + (", sticks" if self.sticks else "")
        if self.growing is None:
            return found
        return found + (f", a swing of {2.0 * math.pi / self.growing:.4g} s grows" if self.growing > 0.0 else ", drifts away")


@dataclass(frozen=True)
class DescribingFunction(Result):
    """Describing function of a contact and the cycles that it predicts, the result of `describing_function`:
    `print(found)` shows them, `found.plot()` draws both curves.

    Attributes
    ----------
    title
        The controllers of the loop.
    contact
        Name of the contact.
    units
        SI units of the slip and of the force of the contact.
    steady_slip
        Slip speed of the contact at smooth running, in SI.
    omega, linear_response
        Frequencies [rad/s], and the frequency response G(i w) of the loop from the force at the contact to its slip,
        complex, shape (n,).
    amplitude, gain
        Amplitudes of the slip, and the describing function N of the contact at these amplitudes: first harmonic of the
        force divided by the amplitude. N depends on the mean slip, which under a constant torque may have several
        values at one amplitude. Each of them is a branch. The branch from smooth running comes first, and nan separates
        the branches.
    cycles
        The predicted cycles, each with its frequency and its amplitude.
    given_cycle
        (period [s], lowest slip, highest slip) of the simulated cycle that was given as argument. Empty if no cycle was
        given.
    display_units
        {SI unit: unit that was typed}: the units in which `print` answers.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.robustness import describing_function
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> found = describing_function(loop)
    >>> print(f"{len(found.cycles)} cycles, slip of {found.steady_slip:.1f} rad/s at smooth running")
    2 cycles, slip of 6.3 rad/s at smooth running
    """

    title: str
    contact: str
    units: tuple[str, str]
    steady_slip: float
    omega: FloatArray
    linear_response: np.ndarray
    amplitude: FloatArray
    gain: FloatArray
    cycles: tuple[PredictedCycle, ...]
    given_cycle: tuple[float, ...]
    display_units: Mapping[str, str]

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The table as text: a row for every cycle."""
        read = reading(self.units[0], self.display_units)
        lines: list[tuple[str, ...]] = [
            ("", "period [s]", f"lowest {self.contact}.slip [{read.tail.strip() or '1'}]", "highest", "by its first harmonic")
        ]
        for each in self.cycles:
            low, high = sorted((each.mean - each.amplitude, each.mean + each.amplitude))
            lines.append(("predicted", f"{each.period:.4g}", f"{low * read.factor:.4g}", f"{high * read.factor:.4g}", each.words))
        if self.given_cycle:
            period, low, high = self.given_cycle
            lines.append(("exact", f"{period:.4g}", f"{low * read.factor:.4g}", f"{high * read.factor:.4g}", ""))
        return lines

    def __str__(self) -> str:
        read = reading(self.units[0], self.display_units)
        head = f"Describing function of `{self.contact}`, {self.title}, around {self.steady_slip * read.factor:.4g}{read.tail}"
        if not self.cycles:
            head += ": no cycle is predicted"
        return "\n".join([head, *(columns(self.rows, (0, 4)) if self.cycles or self.given_cycle else [])])

    def _table(self) -> HeadedRows:
        """One row per amplitude: the describing function."""
        slip, force = self.units
        known = np.isfinite(self.gain)
        return [f"amplitude [{slip}]", f"gain [{force}/({slip})]"], np.column_stack([self.amplitude, self.gain])[known].tolist()

    def plot(self, axes: Any = None) -> Any:
        """Draw the describing function N over the amplitude with the predicted cycles, and G in the complex plane. Return both axes.

        Parameters
        ----------
        axes
            Two matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.robustness.response_figures import describing_diagram

        return describing_diagram(self, axes)


@takes_loop
def describing_function(loop: ClosedLoop, cycle: Cycle | None = None, *, highest: Any = None) -> DescribingFunction:
    """Predict stick-slip by the describing function of a contact, and compare the prediction with a simulated cycle.

    Controllers take part in their continuous form.

    Parameters
    ----------
    loop
        A loop with constant inputs and smooth running, in which the judged contact slides. If there are several
        contacts, `closed_loop(..., element=...)` names it.
    cycle
        A cycle of this loop, found by `limit_cycle`, which is shown beside the prediction. By default none.
    highest
        Highest amplitude of the slip that is examined, in the unit of the slip. By default three times the slip of
        smooth running. Cycles with an amplitude below 1/10000 of `highest` are not found.

    Returns
    -------
    DescribingFunction
        The curves and the cycles.

    Raises
    ------
    NoSteadyState
        If the loop has no smooth running.
    SceneError
        If the contact does not slide, its friction law has a memory or breaks, or an argument is wrong.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.robustness import describing_function
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> for cycle in describing_function(loop).cycles:
    ...     print(f"amplitude {cycle.amplitude:.1f} rad/s")
    amplitude 5.7 rad/s
    amplitude 6.3 rad/s
    """
    loop = loop.continuous_loop
    contact = judged_contact(loop)
    if cycle is not None and not isinstance(cycle, Cycle):
        raise SceneError(f"Argument `cycle` must be a cycle that `limit_cycle` found, but it is a {type(cycle).__name__}.")
    rest = equilibrium(loop)
    plant = rest.plant
    at = next(i for i, each in enumerate(plant.elements) if each.name == contact)
    element = plant.elements[at]
    if element.directions > 1 or element.breaks:
        what = "slips in two directions" if element.directions > 1 else "has a friction law with breaks"
        raise SceneError(f"Argument `loop` must have a contact with one slip and a law without breaks, but `{contact}` {what}.")
    remainder, force, slip, reach = _parted(rest, at)
    if slip == 0.0:
        raise SceneError(f"Argument `loop` must let `{contact}` slide at steady running, but it sticks.")
    top = 3.0 * abs(slip) if highest is None else number("highest", highest, element.slip_unit, above=0)

    def answer(w: FloatArray) -> np.ndarray:
        return -remainder.transfer(w)[:, 0, 0]  # of negative feedback

    def response_at(w: float) -> complex:
        return complex(answer(np.array([w]))[0])

    still, steady = float(response_at(1e-6 * reach[0]).real), float(force(np.array([slip]))[0])
    balance = _Balance(_MeanForce(force), slip, steady, still)
    branches = _branches(balance, top)
    omega = np.geomspace(*reach, 2000)
    response = answer(omega)
    scale = float(np.median(np.abs(response)))
    found: list[PredictedCycle] = []
    for w in _crossings(omega, response.imag, lambda w: response_at(w).imag):
        there = response_at(w)
        if abs(there) < 1e-9 * scale:  # the rest stands still at this frequency, whatever the contact does
            continue
        needed = (1.0 / there).real  # 0 where the rest swings undamped
        falls, growing = bool(response.imag[np.searchsorted(omega, w)] < 0.0), _growing(remainder, needed, w)
        for branch in branches:
            for mean, size, rising in branch.at_gain(needed):
                step = 1e-6 * (abs(mean) + size)
                beside = balance.imbalance(np.array([mean - step, mean + step]), np.array([size, size]))
                unsteady = 0.0 if growing is None and beside[1] < beside[0] else growing  # a change of the mean drives itself further
                found.append(PredictedCycle(w, size, mean, needed, rising != falls and unsteady is None, unsteady))
    apart = np.cumsum([len(branch.gain) for branch in branches])[:-1]  # a nan between two branches, so that a plot does not join them
    amplitude = np.insert(np.concatenate([branch.places[:, 1] for branch in branches]), apart, math.nan)
    gain = np.insert(np.concatenate([branch.gain for branch in branches]), apart, math.nan)
    exact = () if cycle is None else (cycle.period, *cycle.extremes(f"{contact}.slip"))
    return DescribingFunction(
        title=all_described(loop.controllers),
        contact=contact,
        units=(element.slip_unit, element.force_unit),
        steady_slip=slip,
        omega=omega,
        linear_response=response,
        amplitude=amplitude,
        gain=gain,
        cycles=tuple(sorted(found, key=lambda each: (each.frequency, each.amplitude))),
        given_cycle=exact,
        display_units=loop.display_units,
    )


class _MeanForce:
    """Mean and first harmonic of the force of a contact whose slip is a mean and one harmonic."""

    def __init__(self, force: Callable[[np.ndarray], np.ndarray]) -> None:
        self.force = force
        self.nodes, self.weights = np.polynomial.legendre.leggauss(ANGLES)

    def harmonics(self, mean: FloatArray, amplitude: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (F_0, N) at means and amplitudes of the same shape (k,). Each half turn is divided at the change of sign of the slip,
        because the force jumps there."""
        turn = np.arccos(np.clip(-mean / amplitude, -1.0, 1.0))[:, None]
        ends = ((np.zeros_like(turn), turn), (turn, np.full_like(turn, math.pi)))
        angles = np.cos(np.concatenate([(a + b) / 2 + (b - a) / 2 * self.nodes for a, b in ends], axis=1))
        shares = np.concatenate([(b - a) / 2 * self.weights for a, b in ends], axis=1) / math.pi
        values = self.force((mean[:, None] + amplitude[:, None] * angles).ravel()).reshape(angles.shape)
        swing = values - self.force(mean)[:, None]  # a constant has no first harmonic, but would have the round-off of one
        return (shares * values).sum(axis=1), 2.0 * (shares * swing * angles).sum(axis=1) / amplitude


@dataclass(frozen=True)
class _Balance:
    """The balance of the constant forces, in the plane of amplitude and (mean - amplitude), both in the direction of steady running.

    A contact begins to stick where mean and amplitude are equal. The forces change fast beside that line, so that it is an axis of the plane.

    Attributes
    ----------
    force
        Mean and first harmonic of the force of the contact.
    slip, steady
        Slip and force of steady running.
    still
        Constant change of the slip that a constant force of one unit makes.
    """

    force: _MeanForce
    slip: float
    steady: float
    still: float

    def mean(self, place: FloatArray) -> FloatArray:
        """Return the mean slip at places, shape (..., 2): mean less amplitude, amplitude."""
        return math.copysign(1.0, self.slip) * (place[..., 0] + place[..., 1])

    def imbalance(self, mean: FloatArray, amplitude: FloatArray) -> FloatArray:
        """Return the mean slip less the slip that the mean force makes, at means and amplitudes of one shape (k,)."""
        return mean - self.slip - self.still * (self.force.harmonics(mean, amplitude)[0] - self.steady)

    def at(self, less: float, amplitude: float) -> float:
        """Return the imbalance at one place."""
        place = np.array([[less, amplitude]])
        return float(self.imbalance(self.mean(place), place[:, 1])[0])

    def gain(self, places: FloatArray) -> FloatArray:
        """Return N at places, shape (k, 2)."""
        return self.force.harmonics(self.mean(places), places[:, 1])[1]

    def reach(self, top: float) -> tuple[float, float]:
        """Return the lowest and the highest mean slip, in the direction of steady running: the mean force is one that the contact has at some slip."""
        low = high = self.slip
        for _ in range(20):
            forces = self.force.force(np.linspace(low - top, high + top, 2001))
            ends = self.slip + self.still * (np.array([forces.min(), forces.max()]) - self.steady)
            new = min(low, *ends), max(high, *ends)
            if max(low - new[0], new[1] - high) <= 1e-3 * (high - low):
                break
            low, high = new
        return (low, high) if self.slip > 0.0 else (-high, -low)

    def between(self, low: float, high: float) -> FloatArray:
        """Return slips that lie between two neighbours of steady running each, and beside them, in its direction: columns of a mesh that parts them."""
        slips = np.linspace(low, high, 4001)
        turned = math.copysign(1.0, self.slip) * slips
        rise = np.diff(turned - self.still * self.force.force(turned))
        extremes = slips[1:-1][np.sign(rise[1:]) != np.sign(rise[:-1])]
        return np.concatenate([extremes, (extremes + abs(self.slip)) / 2.0])


@dataclass(frozen=True)
class _Branch:
    """A line of the plane on which the constant forces are balanced.

    Attributes
    ----------
    places
        Points of the line in order, shape (k, 2): mean less amplitude, amplitude.
    gain
        N at the points, shape (k,).
    balance
        The balance, which holds on the line.
    """

    places: np.ndarray
    gain: np.ndarray
    balance: _Balance

    def at_gain(self, needed: float) -> list[tuple[float, float, bool]]:
        """Return [(mean, amplitude, whether N rises with the amplitude)] of the points of the line at which N is `needed`."""
        off = np.where(np.abs(self.gain - needed) > 1e-12 * np.abs(self.gain).max(), self.gain - needed, 0.0)  # round-off crosses nothing
        found = []
        for i in map(int, np.flatnonzero(np.sign(off[:-1]) * np.sign(off[1:]) < 0.0)):
            place = self._between(i, zero(partial(self._missing, i, needed), 0.0, 1.0, 1e-13))
            mean, size = float(self.balance.mean(place)), float(place[1])
            if abs(self._gain(place) - needed) > 1e-6 * np.abs(off[i : i + 2]).max() or abs(self.balance.at(*place)) > 1e-9 * (
                abs(mean) + size
            ):
                continue  # N jumps past `needed` there: a jump solves no equation
            found.append((mean, size, bool((off[i + 1] > off[i]) == (self.places[i + 1, 1] > self.places[i, 1]))))
        return found

    def _missing(self, i: int, needed: float, share: float) -> float:
        return self._gain(self._between(i, share)) - needed

    def _gain(self, place: np.ndarray) -> float:
        return float(self.balance.gain(place[None])[0])

    def _between(self, i: int, share: float) -> np.ndarray:
        """Return the point of the line beside a point of the straight piece behind point i, across that piece."""
        along = self.places[i + 1] - self.places[i]
        base, across = self.places[i] + share * along, np.array([-along[1], along[0]])
        here = self.balance.at(*base)
        for width in 2.0 ** np.arange(-20.0, 3.0):
            for side in (width, -width):
                end = base + side * across
                if end[1] > 0.0 and self.balance.at(*end) * here <= 0.0:
                    return base + zero(lambda s: self.balance.at(*(base + s * across)), 0.0, side, 1e-15) * across
        return base


def _branches(balance: _Balance, top: float) -> list[_Branch]:
    """Return the lines on which the constant forces are balanced, the one that begins at steady running first.

    Under a constant torque one amplitude may have several means, so that the balance is not solved for the mean at an amplitude: its zero line is drawn in the
    plane of both, and each of its points is refined on the edge of the mesh that it crosses.
    """
    amplitude = np.append(top * np.geomspace(LOWEST, 1.0 / AMPLITUDES, SMALL + 1)[:-1], np.linspace(0.0, top, AMPLITUDES + 1)[1:])
    low, high = balance.reach(top)
    slip = abs(balance.slip)
    if high - low <= 1e-9 * slip:  # integral action holds the mean
        lines = [np.column_stack([slip - amplitude, amplitude])]
    else:
        from contourpy import contour_generator

        # steady running is no line of the mesh: the line that begins there would run along an edge and cross none
        even = np.linspace(low - top - 0.0137 * slip, high + 0.0171 * slip, EVEN)
        fine = top * np.geomspace(NEAREST, 0.3, FINE)
        less = np.unique(np.concatenate([even, -fine, [0.0], fine, balance.between(low, high)]))
        rows = [np.column_stack([less, np.full(less.size, size)]) for size in amplitude]
        plane = np.array([balance.imbalance(balance.mean(row), row[:, 1]) for row in rows])
        rough = cast("list[np.ndarray]", contour_generator(z=plane).lines(0.0))
        lines = [np.array([_on_edge(balance.at, place, less, amplitude) for place in line]) for line in rough]
    begin, span = np.array([slip, 0.0]), np.array([high - low + top, top])

    def away(place: np.ndarray) -> float:
        return float(np.abs((place - begin) / span).max())

    lines = [line if away(line[0]) <= away(line[-1]) else line[::-1] for line in lines]
    lines.sort(key=lambda line: away(line[0]))
    return [_Branch(line, balance.gain(line), balance) for line in lines]


def _on_edge(function: Callable[[float, float], float], place: np.ndarray, columns: np.ndarray, rows: np.ndarray) -> tuple[float, float]:
    """Return the zero of a function on an edge of a mesh, from a place on the edge in numbers of columns and rows."""
    column, row = (float(each) for each in place)
    if abs(row - round(row)) < abs(column - round(column)):
        y = float(rows[round(row)])
        return zero(lambda x: function(x, y), columns[math.floor(column)], columns[math.ceil(column)], 0.0), y
    x = float(columns[round(column)])
    return x, zero(lambda y: function(x, y), rows[math.floor(row)], rows[math.ceil(row)], 0.0)


def _growing(remainder: LinearLoop, gain: float, frequency: float) -> float | None:
    """The frequency of the fastest growing pole with a gain in place of the contact, beside the pair that swings at `frequency`; None where none grows."""
    poles = remainder.poles(gain)
    poles = poles[poles.imag >= 0.0]
    others = np.delete(poles, np.abs(poles - 1j * frequency).argmin())
    fastest = max(others, key=lambda pole: pole.real, default=0.0)
    return float(fastest.imag) if fastest.real > STABLE * np.abs(poles).max() else None


def _parted(rest: Equilibrium, at: int) -> tuple[LinearLoop, Callable[[np.ndarray], np.ndarray], float, tuple[float, float]]:
    """A plant parted at element `at`: (what is left, force of slips, slip of steady running, (lowest, highest) frequency of the loop)."""
    plant = rest.plant
    modes = mode_numbers(plant, rest.modes)

    def expressions() -> list[ca.SX]:
        law = plant.switched_equations
        states = [ca.jacobian(each, plant.x) for each in (law.field, law.force[at], law.slip[at])]
        return [*states, ca.jacobian(plant.flow, plant.F)[:, at], law.slip[at]]

    parts = function_of(plant, (f"parted{at}",), expressions)

    whole, slope, slides, push, slip = (np.array(each) for each in parts(0.0, rest.states, rest.inputs, plant.values, modes))
    without = whole - push @ slope
    poles = np.abs(np.concatenate([np.linalg.eigvals(whole), np.linalg.eigvals(without)]))
    poles = poles[poles > 1e-9 * poles.max(initial=0.0)]
    reach = (0.1 * float(poles.min()), 3.0 * float(poles.max()))
    direction = np.ravel(slides) / float((slides @ slides.T).item())
    remainder = LinearLoop(without, push, slides, np.zeros((1, 1)), (plant.elements[at].name,))

    forces = function_of(plant, (f"force{at}",), lambda: [plant.switched_equations.force[at]])

    def force(slips: np.ndarray) -> np.ndarray:
        """What the contact does at slips of both signs, all else as at steady running."""
        places = rest.states[:, None] + direction[:, None] * (slips - slip.item())
        signs = np.tile(modes[:, None], slips.size)
        signs[at] = np.where(slips < 0.0, -1.0, 1.0)
        return np.ravel(forces(0.0, places, rest.inputs, plant.values, signs))

    return remainder, force, slip.item() if modes[at] else 0.0, reach


def _crossings(places: np.ndarray, values: np.ndarray, value_at: Callable[[float], float]) -> list[float]:
    """Where a function crosses zero, from its values at places."""
    between = np.flatnonzero(np.isfinite(values[:-1]) & np.isfinite(values[1:]) & (np.sign(values[:-1]) * np.sign(values[1:]) < 0.0))
    return [zero(value_at, float(places[i]), float(places[i + 1]), 1e-12 * float(places[i])) for i in between]
