"""Observer of a drill string by an ensemble of strings that stick and slip, whose inertias, stiffness and rock are learnt with the motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from toolbox import HybridSystem, Quantity, quantity
from toolbox.authoring import check_fields, whole
from toolbox.drilling import EnsembleFilter, Knowledge
from toolbox.modelling import Observer


@dataclass(frozen=True, kw_only=True)
class Ensemble(Observer):
    """Observer whose estimates are the means of an ensemble of simulated strings, which are corrected by the measured
    top speed.

    Estimates:

    - `bit.speed` [rad/s], `bit.torque` [N m], `top.speed` [rad/s];
    - `bit.friction_scale` [1]: strength of the rock as a multiple of the declared strength.

    Use it inside `ObserverBasedController` or `StringObserverController`, sampled at `period`. The observer runs in
    Python, and the run keeps the estimates in `run.controllers[0].estimates`. The observer assumes that commands act
    without delay.

    Examples
    --------
    >>> from controllers.observers import Ensemble
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> estimator = Ensemble(members=16).create_estimator(compose(wells.JANSEN_2, BitRock(weight="97 kN")))
    >>> print(f"{estimator.estimate([6.0])['bit.speed']:.1f} rad/s after one measured top speed of 6 rad/s")
    6.0 rad/s after one measured top speed of 6 rad/s
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("top.speed",)
    estimates: ClassVar[tuple[str, ...]] = ("top.speed", "bit.speed", "bit.torque", "bit.friction_scale")

    period: Quantity = quantity(0.01, "s", "sample time", above=0, typical_range=(1e-4, 5.0))
    members: int = 64
    seed: int = 0
    knowledge: Knowledge = field(default_factory=Knowledge)

    def check(self):
        whole("members", self.members, 8)
        whole("seed", self.seed, 0)
        check_fields(self.knowledge)

    def create_estimator(self, plant: HybridSystem) -> EnsembleEstimator:
        """Return the estimator for a plant: an object that computes estimates from the measured signals of each sample.

        Parameters
        ----------
        plant
            The plant whose signals are estimated.
        """
        return EnsembleEstimator(self, plant)


class EnsembleEstimator:
    """A designed `Ensemble`: `estimate(y)` at a sample, then `predict(command)`."""

    def __init__(self, observer: Ensemble, plant: HybridSystem):
        check_fields(observer)
        self.period, self.command = observer.period, float("nan")
        self.filter = EnsembleFilter(plant, observer.knowledge, members=observer.members, seed=observer.seed)

    def estimate(self, y: np.ndarray) -> Mapping[str, float]:
        """The estimates at a sample with measurement y, by name."""
        found = self.filter.step(self.period, self.command, float(y[0]))
        return {
            "top.speed": found.top_speed[0],
            "bit.speed": found.bit_speed[0],
            "bit.torque": found.bit_torque[0],
            "bit.friction_scale": found.rock_strength[0],
        }

    def predict(self, command: float) -> None:
        """Remember the command that acts until the next sample."""
        self.command = command

    def get_memory(self) -> np.ndarray:
        """All on which the next estimates depend; a command of nan is a first sample."""
        first = np.isnan(self.command)
        return np.concatenate([[first, 0.0 if first else self.command], self.filter.get_memory()])

    def set_memory(self, values: np.ndarray) -> None:
        """Remember what `get_memory` told."""
        self.command = float("nan") if values[0] else float(values[1])
        self.filter.set_memory(values[2:])
