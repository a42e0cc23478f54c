"""What a sweep found, as arrays by name: printed, saved, loaded, handed to xarray."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray
from toolbox.errors import SceneError, no_array, optional, suggest
from toolbox.files.archives import Shape, check_notes, check_shapes, understood
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.unit_systems import reading
from toolbox.sweeps import store

_LEFT = (0, 3, 5)
"""Columns of the printed ranges that stand at the left."""


@dataclass(frozen=True)
class Sweep(Told, Result):
    """Result of a sweep: `found["severity"]` is an array with the shape of the design, nan for a failed run.

    Attributes
    ----------
    title
        Name of the loop.
    names, units
        The numbers that were varied.
    points
        Their values, shape (runs, names).
    shape, axes
        Shape of the results, and the values along each axis of a grid.
    metrics, metric_units
        {name: array of shape `shape`} and their units.
    failures
        Reasons why runs failed: {index of the run: message}.
    duration, accuracy
        Length [s] and accuracy of a run.
    seconds
        Computing time of the sweep (wall time) [s], without runs that were read from a checkpoint. 0 after loading,
        because files do not hold it.
    display_units
        {SI unit: unit that was typed}: the units of the report.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, sweep
    >>> found = sweep(compose(BlockOnBelt()), {"block.mass": [1.0, 2.0]}, "60 s", metrics="stuck_ratio")
    >>> print(found["stuck_ratio"].round(2))
    [0.6  0.58]
    """

    title: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    points: FloatArray
    shape: tuple[int, ...]
    axes: tuple[FloatArray, ...]
    metrics: dict[str, FloatArray]
    metric_units: dict[str, str]
    failures: dict[int, str] = field(default_factory=dict)
    duration: float = 0.0
    accuracy: float = 1e-6
    seconds: float = 0.0
    display_units: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> FloatArray:
        if name in self.metrics:
            return self.metrics[name]
        if name in self.names:
            return self.points[:, self.names.index(name)].reshape(self.shape)
        raise SceneError(f"There is no measure `{name}`: {suggest(name, [*self.metrics, *self.names])}")

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.points)

    def _told(self) -> list[str | Rows]:
        rate = f" in {self.seconds:.3g} s" if self.seconds else ""
        lines: list[str | Rows] = [f"Sweep of {self.title}: {self.runs} runs of {self.duration:g} s at accuracy {self.accuracy:g}{rate}"]
        kind = " x ".join(str(length) for length in self.shape) + " grid" if self.axes else "list"
        rows: list[tuple[str, ...]] = [(f"over ({kind})", "lowest", "highest", "unit")]
        for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            each = reading(unit, self.display_units)
            column = self.points[:, k] * each.factor
            rows.append((name, f"{column.min():.5g}", f"{column.max():.5g}", each.tail.strip()))
        lines.append(Rows(rows, _LEFT))
        rows = [("found", "smallest", "largest", "unit", "median", "largest at")]
        for name, values in self.metrics.items():
            factor, unit = reading(self.metric_units[name], self.display_units)
            flat = values.ravel() * factor
            known = np.flatnonzero(np.isfinite(flat))
            if not known.size:
                rows.append((name, "-", "-", "", "-", "no finite value"))
                continue
            low, high = known[np.argmin(flat[known])], known[np.argmax(flat[known])]
            rest = f"; {flat.size - known.size} not finite" if known.size < flat.size else ""
            median, shown = f"{np.median(flat[known]):.5g}", "" if unit == "1" else unit
            rows.append((name, f"{flat[low]:.5g}", f"{flat[high]:.5g}", shown, median, self._place(int(high)) + rest))
        lines.append(Rows(rows, _LEFT))
        if self.failures:
            lines.append(f"  {len(self.failures)} of {self.runs} runs failed")
            for index, text in list(self.failures.items())[:5]:
                lines.append(f"    {self._place(index)}: {text}")
            if len(self.failures) > 5:
                lines.append(f"    ... and {len(self.failures) - 5} more in `failures`")
        return lines

    __repr__ = Told.__str__

    def _place(self, index: int) -> str:
        rows = zip(self.names, self.units, self.points[index], strict=True)
        numbers = (f"{name} {value * reading(unit, self.display_units).factor:.5g}" for name, unit, value in rows)
        return ", ".join(numbers)

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        name = next(iter(self.metrics), "severity")
        no_array(self, f"take a measure, such as `found[{name!r}]`, or all of them, `found.to_pandas()` or `found.to_xarray()`")

    def to_pandas(self) -> Any:
        """Return all runs as a data frame. Needs the extra `pandas`.

        Returns
        -------
        pandas.DataFrame
            One row per run, in the order of `points`: the varied numbers, the metrics (nan if a run failed) and
            `error`, the reason of a failure or "". `attrs` contains "units", {column: unit}, and title, duration and
            accuracy of the sweep.
        """
        pandas = optional("pandas", "`to_pandas`", "pandas")
        columns: dict[str, Any] = {name: self.points[:, k] for k, name in enumerate(self.names)}
        columns |= {name: values.ravel() for name, values in self.metrics.items()}
        frame = pandas.DataFrame(columns | {"error": [self.failures.get(i, "") for i in range(self.runs)]})
        units = dict(zip(self.names, self.units, strict=True)) | self.metric_units
        frame.attrs |= {"units": units, "title": self.title, "duration": self.duration, "accuracy": self.accuracy}
        return frame

    def to_xarray(self) -> Any:
        """Return the metrics as an xarray Dataset, with the varied numbers as coordinates, units as attributes, and the
        reasons of failures. Needs the extra `batch`.
        """
        xarray = optional("xarray", "`to_xarray`", "batch")
        if self.axes:
            dims = self.names
            coordinates = {n: (n, axis, {"units": u}) for n, axis, u in zip(self.names, self.axes, self.units, strict=True)}
        else:
            dims = ("run",)
            coordinates = {n: ("run", self.points[:, k], {"units": u}) for k, (n, u) in enumerate(zip(self.names, self.units, strict=True))}
        data = {name: (dims, values, {"units": self.metric_units[name]}) for name, values in self.metrics.items()}
        texts = np.full(self.runs, "", dtype=object)
        for i, text in self.failures.items():
            texts[i] = text
        data["error"] = (dims, texts.reshape(self.shape), {})
        return xarray.Dataset(data, coordinates, {"title": self.title, "duration": self.duration, "accuracy": self.accuracy})

    def save(self, path: str | Path) -> Path:
        """Write the sweep to `path`, atomically.

        The format depends on the ending: a zarr store for .zarr (see `toolbox.sweeps.store`), a table for .csv, else
        npz without pickle. A table has one row per run in SI units with its error. It is for other programs: `load`
        does not read it.

        Parameters
        ----------
        path
            Path of the file, with the ending .zarr, .csv or .npz.
        """
        if Path(path).suffix == ".zarr":
            store.saved(self, Path(path))
            return Path(path)
        return super(Sweep, dataclasses.replace(self, seconds=0.0)).save(path)

    def _table(self) -> HeadedRows:
        """One row per run: what was varied, what was measured, and why it failed."""
        units = [*self.units, *self.metric_units.values()]
        headings = [*(f"{name} [{unit}]" for name, unit in zip((*self.names, *self.metrics), units, strict=True)), "error"]
        columns = [*self.points.T, *(values.ravel() for values in self.metrics.values())]
        return headings, [[*map(float, row), self.failures.get(i, "")] for i, row in enumerate(zip(*columns, strict=True))]

    @classmethod
    def load(cls, path: str | Path) -> Sweep:
        """Read a sweep from a file of `save`, or from the `checkpoint` folder of a finished sweep.

        Raises SceneError for any other file or folder, and for a sweep that is not finished.

        Parameters
        ----------
        path
            Path of the file or folder.
        """
        path = Path(path)
        if not path.is_dir():
            return super().load(path)
        with understood(path, "a sweep written by `Sweep.save`"):
            found = cls(**store.loaded(path))
            found.check_loaded()
            return found

    @classmethod
    def _earlier(cls, found: Mapping[str, np.ndarray]) -> Mapping[str, Any]:
        notes = json.loads(str(found["sweep"]))
        axes = [f"axis.{name}" for name in notes["names"]] if notes.pop("grid") else []
        shape = [found[axis].size for axis in axes] or [len(found["points"])]
        pairs = {name: [*notes.get(name, {}).items()] for name in ("measure_units", "asked")}
        metrics = [[name, f"measure.{name}"] for name in notes["measure_units"]]
        errors = [[int(i), text] for i, text in notes["errors"].items()]
        return {**notes, **pairs, "points": "points", "axes": axes, "shape": shape, "measures": metrics, "errors": errors}

    def check_loaded(self) -> None:
        """Raise ValueError or TypeError if the loaded arrays do not fit together."""
        kinds = {"title": "text", "names": "texts", "units": "texts", "metric_units": "by name", "display_units": "by name"}
        check_notes(self, {**kinds, **dict.fromkeys(("duration", "accuracy", "seconds"), "number")})
        shapes: dict[str, Shape] = {"points": ("f", self.runs, len(self.names))}
        shapes |= {f"axis {k}": ("f", length) for k, length in enumerate(self.shape if self.axes else ())}
        shapes |= dict.fromkeys(self.metric_units, ("f", *self.shape))
        check_shapes({"points": self.points, **{f"axis {k}": axis for k, axis in enumerate(self.axes)}, **self.metrics}, shapes)
        if (
            self.runs != math.prod(self.shape)
            or not self.runs
            or len(self.units) != len(self.names)
            or len(self.axes) not in (0, len(self.names))
        ):
            raise ValueError("its arrays do not fit to one another")
        if not all(0 <= index < self.runs and isinstance(text, str) for index, text in self.failures.items()):
            raise ValueError("it has an error of a run that it does not have")
