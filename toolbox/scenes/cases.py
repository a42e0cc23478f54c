"""Cases of a scene: one controller with its numbers, inputs and reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from toolbox.errors import SceneError, suggest
from toolbox.files.printing import Printed
from toolbox.modelling import inputs as shapes
from toolbox.modelling.laws import Controller, Sampled

Number = float | tuple[float, ...]


def _reference(law: Controller | None, unit: str) -> float | None:
    """The set-point that a law declares in this unit; None without one."""
    declared = {each.name: each.metadata.get("unit") for each in fields(law)} if law is not None else {}
    return getattr(law, "reference", None) if declared.get("reference") == unit else None


@dataclass(frozen=True)
class Waveform:
    """An input in time as data: a shape of `toolbox.inputs` or "table", and its numbers by name in SI."""

    shape: str
    numbers: Mapping[str, Number]

    def build(self) -> Any:
        """What `simulate` takes as this input."""
        if self.shape == "table":
            return self.numbers["times"], self.numbers["values"]
        return getattr(shapes, self.shape)(**self.numbers)


@dataclass(frozen=True)
class Measured:
    """Measured data of the machine of a scene.

    Attributes
    ----------
    file
        Path of the log.
    columns
        {signal, or "time": what it is called there}; empty where it uses the names of the plant.
    windows
        Stretches (begin, end) of the log [s]; empty for all of it.
    """

    file: Path
    columns: Mapping[str, str] = field(default_factory=dict)
    windows: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Case:
    """One controller of a scene.

    Attributes
    ----------
    label
        Its name in tables and pictures.
    law
        The law; None leaves the plant to its inputs.
    sample_time, delay
        Sample time and delay [s]; without a sample time the law is continuous.
    inputs
        Inputs of this case, which win over those of the scene.
    noise, resolution, seed
        {measured signal: standard deviation}, {measured signal: step} and seed of the noise of a sampled law, as in `Sampled`.
    jitter, missed_samples
        Largest lateness of a sample [s] and probability that a sample is missed, as in `Sampled`.
    """

    label: str
    law: Controller | None = None
    sample_time: float | None = None
    delay: float = 0.0
    inputs: Mapping[str, float | Waveform] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    resolution: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    jitter: float = 0.0
    missed_samples: float = 0.0

    @property
    def controller(self) -> Any:
        """What `simulate` takes as controller."""
        if self.law is None or self.sample_time is None:
            return self.law
        return Sampled(
            self.law, self.sample_time, self.delay, self.noise, self.resolution, self.seed, jitter=self.jitter, missed_samples=self.missed_samples
        )  # fmt: skip

    @staticmethod
    def of(label: str, controller: Controller | Sampled | None) -> Case:
        """The case of a continuous law, of a sampled one, or of none. Raises SceneError for anything else, a Python function too."""
        if controller is None or isinstance(controller, Controller):
            return Case(label, controller)
        if isinstance(controller, Sampled) and isinstance(controller.law, Controller):
            c = controller
            law: Controller = controller.law
            return Case(
                label, law, float(c.period), float(c.delay), noise=c.noise, resolution=c.resolution, seed=c.seed,
                jitter=float(c.jitter), missed_samples=c.missed_samples,
            )  # fmt: skip
        raise SceneError(f"Argument `controller` must be a Controller, or Sampled with one, but it is {controller!r}.")


class Labelled(Printed):
    """Cases of a scene by their labels, for scenes of every kind."""

    cases: tuple[Case, ...]

    @property
    def labels(self) -> list[str]:
        """Labels of the cases, in order."""
        return [case.label for case in self.cases]

    def case(self, label: str) -> Case:
        """Return the case with a label. SceneError is raised if there is no such case."""
        for case in self.cases:
            if case.label == label:
                return case
        raise SceneError(f"There is no controller `{label}`: {suggest(label, self.labels)}")

    def _check_cases(self) -> None:
        """Raise SceneError unless there is a case, and no two have one label."""
        if not self.cases:
            raise SceneError("Argument `cases` must hold at least one case, but it is empty.")
        twice = [label for label in self.labels if self.labels.count(label) > 1]
        if twice:
            raise SceneError(f"The labels of controllers must differ, but `{twice[0]}` is there {self.labels.count(twice[0])} times.")
