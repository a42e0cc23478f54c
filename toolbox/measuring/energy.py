"""The energy audit of a run, and the Gauss points at which time integrals are taken."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from toolbox.errors import SceneError
from toolbox.files.printing import Printed, columns
from toolbox.files.unit_systems import reading
from toolbox.simulation.recorded import Recorded
from toolbox.simulation.samples import Samples, check_run, output_function, window
from toolbox.simulation.trajectory import Trajectory

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(8)
POINTS, WEIGHTS = 0.5 * (POINTS + 1.0), 0.5 * WEIGHTS
CHUNK = 4096
"""Steps sampled together, so that the audit of a very long run needs no more memory than that of a short one."""


@dataclass(frozen=True)
class EnergyAudit(Printed):
    """Energy balance of a run [J]: what is stored at the end minus the start must equal supplies minus losses. Print it for the table.

    Attributes
    ----------
    duration
        Length of the run [s].
    stored
        {part: (energy at the start, at the end)}.
    losses, supplies
        {term: integral of its power over the run}.
    impacts
        Energy that unilateral contacts took at the instants at which they opened, closed or bounced.
    turnover
        Largest amount that one term moved, both directions counted, or that one part stores at the start or the end.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, energy_audit, simulate
    >>> audit = energy_audit(simulate(compose(BlockOnBelt()), "10 s"))
    >>> print(f"{sum(audit.losses.values()):.3f} J lost, balanced: {audit.relative < 1e-6}")
    0.778 J lost, balanced: True
    """

    duration: float
    stored: dict[str, tuple[float, float]]
    losses: dict[str, float]
    supplies: dict[str, float]
    impacts: float
    turnover: float

    @property
    def residual(self) -> float:
        """Supplies - losses - impacts - growth of the stored energy [J]; 0 for a model whose energy is declared as its flow has it."""
        growth = math.fsum(end - start for start, end in self.stored.values())
        return math.fsum([*self.supplies.values(), *(-value for value in self.losses.values()), -self.impacts, -growth])

    @property
    def relative(self) -> float:
        """|residual| / turnover [1]; 0.0 if nothing moves."""
        return abs(self.residual) / self.turnover if self.turnover > 0 else 0.0

    def __str__(self) -> str:
        factor, unit = reading("J")
        rows = [
            (f"stored in {name}", end - start, f"{start * factor:.6g} -> {end * factor:.6g}") for name, (start, end) in self.stored.items()
        ]
        rows += [(f"supply {name}", value, "") for name, value in self.supplies.items()]
        rows += [(f"loss {name}", 0.0 - value, "") for name, value in self.losses.items()]
        rows += [("impacts", 0.0 - self.impacts, "")] if self.impacts else []
        told = [(name, f"{value * factor:.8g}", note) for name, value, note in rows]
        told.append(("residual", f"{self.residual * factor:.3g}", f"{self.relative:.1e} of {self.turnover * factor:.6g} turned over"))
        return "\n".join([f"Energy over {self.duration:g} s [{unit}]", *columns(told, (0, 2))])


def energy_audit(run: Trajectory) -> EnergyAudit:
    """Compare the stored energy of a run with the integrals of all declared losses and supplies of power.

    Energies and powers are expressions that the parts declare beside their equations. A residual above the accuracy of
    the run therefore means that the energies and the equations of a model disagree, or that a part exchanges power
    without declaring it.

    The integrals use Gauss-Legendre quadrature with 8 points on every step, with the modes and held signals of the
    step. Its order is 16, so the quadrature adds nothing to the error of the run.

    Parameters
    ----------
    run
        The run.

    Returns
    -------
    EnergyAudit
        The balance [J]. `print` shows the table.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, energy_audit, simulate
    >>> audit = energy_audit(simulate(compose(BlockOnBelt()), "20 s"))
    >>> print(abs(audit.residual) < 1e-6)
    True
    """
    check_run(run)
    if not isinstance(run, Trajectory):
        raise SceneError(
            "Argument `run` must be a trajectory with its plant, whose energies are integrated, but it was read from a file: simulate again."
        )
    nodes = run.every_step
    system = nodes.program.system
    terms = [*system.losses.values(), *system.supplies.values()]
    power = output_function(nodes.program, ca.vertcat(*terms)) if terms else None
    energy = output_function(nodes.program, ca.vertcat(*system.stored.values())) if system.stored else None
    total, moved = np.zeros(len(terms)), np.zeros(len(terms))
    begin, end = window(run, 0.0, None) if nodes.time[-1] > run.begin else (0.0, 0.0)
    if power is not None:
        for weights, samples in gauss(run, begin, end):
            values = _evaluated(power, samples)
            total += values @ weights
            moved += np.abs(values) @ weights
    ends = np.zeros(nodes.time.size, bool)
    ends[[0, -1]] = True
    stored = _evaluated(energy, nodes_at(nodes, ends)) if energy is not None else np.zeros((0, 2))
    first = len(system.losses)
    return EnergyAudit(
        duration=end - begin,
        stored={name: (float(row[0]), float(row[-1])) for name, row in zip(system.stored, stored, strict=True)},
        losses=dict(zip(system.losses, total[:first].tolist(), strict=True)),
        supplies=dict(zip(system.supplies, total[first:].tolist(), strict=True)),
        impacts=_taken_by_impacts(run, energy) if energy is not None else 0.0,
        turnover=float(max(np.max(moved, initial=0.0), np.max(np.abs(stored), initial=0.0))),
    )


def _taken_by_impacts(run: Trajectory, energy: ca.Function) -> float:
    """Fall of the stored energy at the instants at which unilateral contacts switched [J]."""
    contacts = {e.name for e in run.program.system.elements if e.has_gap}
    times = np.unique([event.time for event in run.events if event.element in contacts])
    if not times.size:
        return 0.0
    nodes = run.every_step
    first, last = np.searchsorted(nodes.time, times, side="left"), np.searchsorted(nodes.time, times, side="right") - 1
    fall = _evaluated(energy, nodes_at(nodes, first)) - _evaluated(energy, nodes_at(nodes, last))
    return math.fsum(fall.ravel()) if np.isfinite(fall).all() else math.nan  # of a motion that overflows


def gauss(run: Recorded, begin: float, end: float) -> Iterator[tuple[np.ndarray, Any]]:
    """Yield (weights [s], signals) at the Gauss points of every step between `begin` and `end`, in portions."""
    nodes = run.every_step.time
    borders = np.unique(np.concatenate([[begin], nodes[(nodes > begin) & (nodes < end)], [end]]))
    for first in range(0, borders.size - 1, CHUNK):
        piece = borders[first : first + CHUNK + 1]
        width = np.diff(piece)
        times = piece[:-1, None] + width[:, None] * POINTS
        yield (width[:, None] * WEIGHTS).ravel(), run.every_step.at(times.ravel())


def nodes_at(nodes: Trajectory, chosen: np.ndarray) -> Samples:
    """The signals at some of the nodes, each with the modes and held signals recorded there."""
    return Samples(nodes.program, nodes.time[chosen], nodes.states[chosen], nodes.mode[chosen], nodes.held[chosen], nodes.parameters, False)


def _evaluated(function: ca.Function, samples: Samples) -> np.ndarray:
    """A function of `output_function` at all samples, shape (rows of the function, nt)."""
    constants = samples._constants
    return np.array(function(samples.time[None, :], samples.states.T, constants, samples.held.T, samples.mode.T.astype(float)))
