"""Motions of a machine about steady running: how they grow, what shows of them in the contacts, and the swings among them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from toolbox.arguments import FloatArray, count_of
from toolbox.measuring.verdict import growth_in_words
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.steady_point import Equilibrium, function_of
from toolbox.simulation.run_state import RunState
from toolbox.steady_states.equilibria import flow_slopes

ALIKE = 0.1
"""What the damping of two swings may differ by, in its parts, to be alike."""

VISIBLE = 1e-8
"""Part of a motion that must show in the slips of the contacts for it to act back on the machine."""


@dataclass(frozen=True)
class Growth:
    """How a small disturbance of smooth running goes on: as exp(rate t), in swings of a period.

    Attributes
    ----------
    rate
        Rate of the least damped motion [1/s], > 0 where it grows.
    period
        Period of its swing [s]; inf where it does not swing.
    way
        How it is known: "poles", "matrices", "differences" or "twin runs"; "runs" where none of them tells and the rate is nan, so that only runs can.
    error
        How far the rate may be from the true one [1/s].
    """

    rate: float
    period: float
    way: str
    error: float = 0.0

    @staticmethod
    def of(exponent: complex, way: str, error: float = 0.0) -> Growth:
        """The growth of a motion that goes as exp(exponent t)."""
        return Growth(float(exponent.real), 2 * math.pi / abs(exponent.imag) if exponent.imag else math.inf, way, error)

    def __str__(self) -> str:
        return f"{growth_in_words(self.rate)}, by {self.way}"


@dataclass(frozen=True)
class Smooth:
    """Smooth running at a value: its state, the growth of a disturbance, and the direction of the growing disturbance in the entries of
    `RunState.values`.

    The direction is at the phase at which a contact moves most.
    """

    state: RunState
    growth: Growth
    direction: FloatArray


def swing_period(rest: Equilibrium) -> float:
    """Return the period of the least damped swing of a steady state [s]. If no motion swings, the time constant of the slowest motion is
    returned.

    Of several that are damped alike, as all are where drag is spread along a string, it is the slowest.
    """
    poles = np.linalg.eigvals(flow_slopes(rest))
    poles = poles[np.abs(poles) > 1e-9 * np.abs(poles).max(initial=0.0)]
    swinging = poles[poles.imag > 1e-6 * np.abs(poles)]
    if swinging.size:
        least = float(swinging.real.max())
        return float(2 * math.pi / swinging.imag[swinging.real >= least - ALIKE * abs(least)].min())
    return float(2 * math.pi / np.abs(poles).min(initial=1.0)) if poles.size else 1.0


def swings(point: Equilibrium, row: FloatArray, real: bool = True) -> Iterator[tuple[complex, np.ndarray]]:
    """(exponent, motion) of every swing of a steady state that shows in the slip of a contact, moved by 1; row: derivatives of the slip by the states.

    real: at the phase at which it moves the slip most; else the complex motion.
    """
    exponents, motions = np.linalg.eig(flow_slopes(point))
    for exponent, motion in zip(exponents, motions.T, strict=True):
        if exponent.imag > 0.0 and abs(row @ motion) > 1e-6 * (np.abs(row) @ np.abs(motion)):
            scaled = motion / (row @ motion)
            yield exponent, np.real(scaled) if real else scaled


def moved(state: RunState, plant: HybridSystem, motion: FloatArray) -> RunState:
    """The state with a motion of the plant added to it."""
    places = {name: slice(first, first + count_of(size)) for name, (first, size, _) in plant.states.items()}
    return state.with_values({name: np.atleast_1d(state[name]) + motion[place] for name, place in places.items()})


def slip_rows(system: HybridSystem, states: FloatArray, values: FloatArray) -> FloatArray:
    """Derivatives of the slips of all contacts by the states, shape (elements, states)."""
    function = function_of(system, ("slip_rows",), lambda: [ca.jacobian(system.switched_equations.slip, system.x)])
    return np.array(function(0.0, states, np.zeros(len(system.inputs)), values, np.ones(len(system.elements))))


def least_damped(exponents: np.ndarray, motions: np.ndarray, rows: np.ndarray) -> int:
    """Return the index of the motion (column) that grows fastest among the motions visible in the slips of the contacts. Of a pair the
    motion with positive frequency is taken."""
    seen = np.abs(rows @ motions).max(axis=0, initial=0.0) > VISIBLE * np.abs(motions).max(axis=0)
    chosen = np.flatnonzero(seen) if seen.any() else np.arange(exponents.size)
    return int(max(chosen, key=lambda k: (round(float(exponents[k].real), 12), float(exponents[k].imag))))


def in_phase(motion: np.ndarray, rows: FloatArray) -> FloatArray:
    """Return the real direction of a motion at the phase of largest displacement of the contact (row) that the motion moves most."""
    moved = rows @ motion
    most = moved[np.argmax(np.abs(moved))] if moved.size else 0.0
    return np.real(motion / most * abs(most)) if most else np.real(motion)
