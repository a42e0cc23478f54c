"""A sweep under several courses of noise: the same variations once for every seed, all in one batch, so that lanes are full."""

from __future__ import annotations

import concurrent.futures
import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.compilation.program import program_of
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.simulation.carry_out import formulas_of
from toolbox.simulation.request import accuracy_of
from toolbox.sweeps.batch import LANES_WORK, Task, lanes_of, runs_in_lanes, work_alone
from toolbox.sweeps.designs import variations_of
from toolbox.sweeps.executors import Manner, evaluated, probed
from toolbox.sweeps.sweep import task_of


@dataclasses.dataclass(frozen=True)
class Courses:
    """Runs of a loop: each row of varied numbers under every seed, with a duration, and metrics by name.

    loop: its numbers;  rows: {full name of a number: value} of each;  seeds: of the measurement noise;  inputs: {name of an input: a shape for every run},
    seed by seed, of the kind that the loop has there;  duration [s];  measures: {name: measure}.
    """

    loop: ClosedLoop
    rows: Sequence[Mapping[str, float]]
    seeds: Sequence[int]
    duration: float
    metrics: Mapping[str, Any]
    inputs: Mapping[str, Sequence[Any]] = dataclasses.field(default_factory=dict)

    def task(self) -> tuple[Task, dict[int, str]]:
        """Return the task of all runs, seed by seed, and {index: reason} of the runs with contradictory numbers."""
        variations = variations_of(list(self.rows))
        one, broken, _ = task_of(
            self.loop, variations, self.duration, start=None, metrics=dict(self.metrics), accuracy=accuracy_of(self.loop)
        )
        count, times = len(one.numbers), len(self.seeds)
        numbers = np.tile(np.asarray(one.numbers), (times, 1))
        slots = program_of(one.run.system, one.run.kinds, formulas_of(one.run)).coefficient_slot
        for name, shapes in self.inputs.items():
            coefficients = np.array([shape.coefficients for shape in shapes])
            numbers[:, slots[name] : slots[name] + coefficients.shape[1]] = coefficients
        tiled: dict[str, Any] = {
            name: None if (array := getattr(one, name)) is None else np.tile(array, (times, 1)) for name in ("starts", "memories", "held")
        }
        seeds = np.repeat(np.array(self.seeds)[:, None], count, axis=0) * np.ones(len(one.run.seeds), np.int64)
        again = {count * time + i: why for time in range(times) for i, why in broken.items()}
        return dataclasses.replace(one, numbers=numbers, seeds=seeds, **tiled), again

    def manner(self) -> Manner:
        """How such runs are done alone: by a method that the middle one chooses."""
        return probed(self.task()[0])

    def measured(self, manner: Manner, runs: int, steps: int, executor: concurrent.futures.Executor | None = None) -> dict[str, np.ndarray]:
        """Return {name of a metric: its values in all runs, nan for a failed run}.

        manner: of such runs;  runs, steps: of all that are to come of the same kind, and in each, by which it is decided whether lanes pay. They do not for so
        few runs at a time that most lanes stand empty.  executor: as of `sweep`.
        """
        task, broken = self.task()
        task = dataclasses.replace(task, run=dataclasses.replace(task.run, method=manner.method))
        lanes = runs_in_lanes(task) and 2 * len(task.numbers) >= lanes_of(task) and runs * work_alone(task, steps) > LANES_WORK
        values, _, _ = evaluated(task, broken, executor, manner=dataclasses.replace(manner, lanes=lanes))
        return dict(zip(self.metrics, values.T, strict=True))
