"""The describing function of a contact: which stick-slip the first harmonic predicts, beside the cycle that there is.

The machine is parted at one contact. What is left is linear around steady running: a force of the contact of frequency w moves its slip by G(i w). The
slip is taken to be a mean and one harmonic, v = v_0 + A cos(w t). The friction F(v) answers to that with a mean F_0 and a first harmonic of gain N:

    F_0(A, v_0) = 1 / (2 pi) int F(v_0 + A cos a) da,      N(A, v_0) = 1 / (pi A) int F(v_0 + A cos a) cos a da

    v_0 = v_s + G(0) (F_0 - F(v_s)),      1 = G(i w) N(A, v_0)

v_s is the slip of steady running. Without memory friction is in phase with slip, so that N is real: the frequencies are those at which G is real, and at
each of them N(A) = 1 / G. Seen by its own amplitude, a cycle holds where N falls with A and the imaginary part of G falls with w there, or both rise, and is
unstable otherwise (the criterion of Loeb). That is necessary, not enough: of the other poles of the machine with the gain N in place of the contact, none may
grow, or another swing takes over. For A > v_0 the harmonic runs backwards for a while, where the contact itself sticks: such a cycle is stick-slip.

Higher harmonics are left out. A string is a filter that passes little of them, and how much they change is told by the cycle itself; so is for sure whether
it attracts, by the multipliers of `limit_cycle`.

Source: A. Gelb, W. E. Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design, McGraw-Hill 1968, chapters 2, 3 and 6.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

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

AMPLITUDES, SMALL, LOWEST = 300, 12, 1e-4
"""Amplitudes at which N is looked at before its crossings are sought: so many in equal steps up to the highest one, and below the first of them so many in
equal ratios from this part of the highest one on, for the small cycles beside a Hopf point."""


@dataclass(frozen=True)
class PredictedCycle:
    """A cycle of the first harmonic.

    Attributes
    ----------
    frequency
        Its frequency [rad/s].
    amplitude, mean
        Amplitude and mean of the slip, in the unit of the slip.
    stable
        Whether it attracts. An unstable one on which nothing else grows is the border between smooth running and stick-slip.
    growing
        Frequency of another swing [rad/s] that grows while this cycle runs, the fastest of them, 0 for growth without a swing; None where nothing else grows.
    """

    frequency: float
    amplitude: float
    mean: float
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
    """The describing function of a contact and the cycles it predicts: `print(found)` shows them, `found.plot()` draws both curves.

    Attributes
    ----------
    title
        The laws of the loop.
    contact
        The contact.
    units
        Units of its slip and of its force, in SI.
    slip
        Slip of steady running, in its unit.
    omega, response
        Frequencies [rad/s], and G(i w) at them: slip over force, complex.
    amplitude, gain
        Amplitudes of the slip, and N at them: force over slip.
    cycles
        The cycles that are predicted, by frequency and amplitude.
    exact
        (period [s], lowest slip, highest slip) of the cycle that was given; empty without one.
    asked
        {unit: unit that was typed}: the units in which `print` answers.
    """

    title: str
    contact: str
    units: tuple[str, str]
    slip: float
    omega: FloatArray
    response: np.ndarray
    amplitude: FloatArray
    gain: FloatArray
    cycles: tuple[PredictedCycle, ...]
    exact: tuple[float, ...]
    asked: Mapping[str, str]

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The table as text: a row for every cycle."""
        read = reading(self.units[0], self.asked)
        lines: list[tuple[str, ...]] = [
            ("", "period [s]", f"lowest {self.contact}.slip [{read.tail.strip() or '1'}]", "highest", "by its first harmonic")
        ]
        for each in self.cycles:
            low, high = sorted((each.mean - each.amplitude, each.mean + each.amplitude))
            lines.append(("predicted", f"{each.period:.4g}", f"{low * read.factor:.4g}", f"{high * read.factor:.4g}", each.words))
        if self.exact:
            period, low, high = self.exact
            lines.append(("exact", f"{period:.4g}", f"{low * read.factor:.4g}", f"{high * read.factor:.4g}", ""))
        return lines

    def __str__(self) -> str:
        read = reading(self.units[0], self.asked)
        head = f"Describing function of `{self.contact}`, {self.title}, around {self.slip * read.factor:.4g}{read.tail}"
        if not self.cycles:
            head += ": no cycle is predicted"
        return "\n".join([head, *(columns(self.rows, (0, 4)) if self.cycles or self.exact else [])])

    def _table(self) -> HeadedRows:
        """One row per amplitude: the describing function."""
        slip, force = self.units
        return [f"amplitude [{slip}]", f"gain [{force}/({slip})]"], np.column_stack([self.amplitude, self.gain]).tolist()

    def plot(self, axes: Any = None) -> Any:
        """N over amplitude with the predicted cycles, and G in the complex plane; returns both axes."""
        from toolbox.robustness.response_figures import describing_diagram

        return describing_diagram(self, axes)


@takes_loop
def describing_function(loop: ClosedLoop, cycle: Cycle | None = None, *, highest: Any = None) -> DescribingFunction:
    """Predict stick-slip by the describing function of a contact, and show it beside the cycle that there is.

    Laws take part in their continuous form, as in `equilibrium`.

    Parameters
    ----------
    loop
        A loop with constant inputs and steady running, on which the judged contact slides. With several contacts, `closed_loop(..., element=...)` names it.
    cycle
        A cycle of this loop, found by `limit_cycle`, to be shown beside the predicted ones.
    highest
        Highest amplitude of the slip that is looked at, in its unit; by default three times the slip of steady running. Cycles below a ten-thousandth of it are
        not found.

    Returns
    -------
    DescribingFunction
        The curves and the cycles.

    Raises
    ------
    NoSteadyState
        If the loop has no steady running.
    SceneError
        If the contact does not slide there, its law has a memory or breaks, or an argument is wrong.
    """
    loop = loop.continuous
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
    nodes, weights = np.polynomial.legendre.leggauss(ANGLES)

    def harmonics(mean: float, amplitude: float) -> tuple[float, float]:
        """(F_0, A N): mean and first harmonic of the force, with its jump where the slip changes its sign."""
        turn = math.acos(min(max(-mean / amplitude, -1.0), 1.0))
        parts = [(a, b) for a, b in ((0.0, turn), (turn, math.pi)) if b > a]
        angles = np.concatenate([(a + b) / 2 + (b - a) / 2 * nodes for a, b in parts])
        shares = np.concatenate([(b - a) / 2 * weights for a, b in parts]) / math.pi
        values = shares * force(mean + amplitude * np.cos(angles))
        swing = values - shares * force(np.array([mean]))  # a constant has no first harmonic, but would have the round-off of one
        return float(values.sum()), float(2.0 * (swing * np.cos(angles)).sum())

    def mean_at(amplitude: float) -> float:
        """The mean slip under a harmonic of an amplitude."""

        def off(mean: float) -> float:
            return mean - slip - still * (harmonics(mean, amplitude)[0] - steady)

        if abs(off(slip)) <= 1e-9 * abs(slip):
            return slip
        width = abs(off(slip))
        for _ in range(60):
            if off(slip - width) * off(slip + width) < 0.0:
                return zero(off, slip - width, slip + width, 1e-12 * abs(slip))
            width *= 1.3
        return math.nan

    def gain_at(amplitude: float) -> float:
        return harmonics(mean_at(amplitude), amplitude)[1] / amplitude

    def missing(needed: float, amplitude: float) -> float:
        return gain_at(amplitude) - needed

    omega = np.geomspace(*reach, 2000)
    response = answer(omega)
    amplitude = np.append(top * np.geomspace(LOWEST, 1.0 / AMPLITUDES, SMALL + 1)[:-1], np.linspace(0.0, top, AMPLITUDES + 1)[1:])
    gain = np.array([gain_at(each) for each in amplitude])
    scale = float(np.median(np.abs(response)))
    found = []
    for w in _crossings(omega, response.imag, lambda w: response_at(w).imag):
        there = response_at(w)
        if abs(there) < 1e-9 * scale:  # the rest stands still at this frequency, whatever the contact does
            continue
        needed = (1.0 / there).real  # 0 where the rest swings undamped
        falls, growing = bool(response.imag[np.searchsorted(omega, w)] < 0.0), _growing(remainder, needed, w)
        off = np.where(
            np.abs(gain - needed) > 1e-12 * np.nanmax(np.abs(gain)), gain - needed, 0.0
        )  # what is 0 but for rounding crosses nothing
        for size in _crossings(amplitude, off, partial(missing, needed)):
            rising = bool(gain[np.searchsorted(amplitude, size)] > needed)
            found.append(PredictedCycle(w, size, mean_at(size), rising != falls and growing is None, growing))
    exact = () if cycle is None else (cycle.period, *cycle.extremes(f"{contact}.slip"))
    return DescribingFunction(
        title=all_described(loop.laws),
        contact=contact,
        units=(element.slip_unit, element.force_unit),
        slip=slip,
        omega=omega,
        response=response,
        amplitude=amplitude,
        gain=gain,
        cycles=tuple(sorted(found, key=lambda each: (each.frequency, each.amplitude))),
        exact=exact,
        asked=loop.asked,
    )


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
        law = plant.switching
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

    forces = function_of(plant, (f"force{at}",), lambda: [plant.switching.force[at]])

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
