"""Reports, tables and plots that a run and one read from a file have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.arguments import FloatArray, finite_array, short
from toolbox.errors import SceneError, no_array, optional
from toolbox.files.printing import columns, table
from toolbox.files.unit_systems import reading
from toolbox.files.units import NumberOrText, in_si
from toolbox.simulation.samples import Stays


class Recorded(Stays):
    """Common base of a run and of a run read from a file: durations of modes, reports and tables."""

    time: FloatArray

    if TYPE_CHECKING:

        @property
        def names(self) -> list[str]: ...
        @property
        def modes(self) -> dict[str, np.ndarray]: ...
        @property
        def every_step(self) -> Any: ...
        @property
        def restart_nodes(self) -> Any: ...
        @property
        def contacts(self) -> list[str]: ...
        @property
        def main_signals(self) -> list[str]: ...
        @property
        def signal_limits(self) -> dict[str, tuple[float | None, float | None]]: ...
        @property
        def display_units(self) -> Mapping[str, str]: ...

        def impact_speeds(self, element: str) -> FloatArray: ...

        def __contains__(self, name: object) -> bool: ...

        def __getitem__(self, name: str) -> FloatArray: ...

        def columns(self, names: Sequence[str]) -> dict[str, np.ndarray]: ...

        def unit(self, name: str) -> str: ...

    @property
    def _headlines(self) -> list[str]:
        """What the run is, and what it cost."""
        raise NotImplementedError

    def _ranges(self) -> list[tuple[str, float, float, float, str]]:
        """(signal, smallest value, largest value, last value, unit) of the scalar signals at the recorded times."""
        rows = []
        for name, values in self.columns(self.names).items() if self.time.size else ():
            if values.ndim == 1:
                values = np.where(np.abs(values) < 1e-9 * np.abs(values).max(), 0.0, values)
                factor, unit = reading(self.unit(name), self.display_units)
                low, high, last = (factor * float(value) for value in (values.min(), values.max(), values[-1]))
                rows.append((name, low, high, last, unit))
        return rows

    def __str__(self) -> str:
        title, *others = self._headlines
        lines = [title, *(f"  {line}" for line in others)]
        for element, words in self._legends.items():
            spent = {mode: self.time_in(element, mode) for mode in words.values()}
            parts = [f"{mode} {seconds:.4g} s" for mode, seconds in spent.items() if seconds > 0]
            lines.append(f"  {element}: {', '.join(parts) or 'no time'}")
        rows = [(name, f"{low:.5g}", f".. {high:.5g}", f"end {last:.5g} {unit}") for name, low, high, last, unit in self._ranges()]
        lines += ["  at the recorded times", *columns(rows, (0, 2, 3), "    ")] if self.time.size else []
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        title, *others = self._headlines
        stays = [(element, mode, self.time_in(element, mode)) for element, words in self._legends.items() for mode in words.values()]
        modes = [
            (element, mode, seconds, f"{100 * seconds / ((self.end - self.begin) or 1.0):.1f}")
            for element, mode, seconds in stays
            if seconds > 0
        ]
        tables = (
            [table(title, ("element", "mode", "time [s]", "part of the run [%]"), modes, others)]
            if modes
            else [table(title, (), (), others)]
        )
        headings = ("signal", "smallest", "largest", "at the end", "unit")
        return "".join([*tables, table("Signals at the recorded times", headings, self._ranges())])

    def at(self, time: NumberOrText | Sequence[NumberOrText] | np.ndarray) -> Any:
        """Signals at any time(s) within the run, with the full accuracy of a step; right-hand limits at events."""
        numbers = finite_array(in_si(time, "s", "time"))
        times = np.atleast_1d(numbers) if numbers is not None else np.empty(0)
        if numbers is None or times.ndim != 1 or (times < self.begin).any() or (times > self.end).any():
            raise SceneError(
                f"Argument `time` must be a number or a row of numbers between {self.begin:g} and {self.end:g} s, but it is {short(time)}."
            )
        nodes = self.restart_nodes
        row = np.maximum(np.searchsorted(nodes.time, times, side="right") - 1, 0)
        return nodes.interpolated(row, times, np.ndim(time) == 0)

    def plot(self, *signals: str, ax: Any = None) -> Any:
        """Time traces with a ribbon of modes; see `toolbox.plot.traces`."""
        from toolbox.simulation.plot import traces

        return traces(self, *signals, ax=ax)

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        signal = next(iter([*self.main_signals, *self.names]), "...")
        no_array(self, f"take a signal, such as `run[{signal!r}]`, or all of them, `run.to_pandas()` or `run.to_xarray()`")

    def to_pandas(self) -> Any:
        """Return all signals and modes as a data frame; needs the extra `pandas`.

        Returns
        -------
        pandas.DataFrame
            A row per recorded time, by which it is indexed, two at an event that is recorded on both sides. Entries of a vector are columns of their own
            (`chain.speed.0`), modes are words (`bit.mode`). `attrs["units"]` is {column: unit} of the signals and of `time`.
        """
        pandas = optional("pandas", "`to_pandas`", "pandas")
        columns: dict[str, np.ndarray] = {}
        for name, values in self.columns(self.names).items():
            if values.ndim == 1:
                columns[name] = values
            else:
                columns |= {f"{name}.{i}": values[:, i] for i in range(values.shape[1])}
        units = {name: self.unit(name) for name in columns}
        columns |= {f"{name}.mode": mode for name, mode in self.modes.items()}
        frame = pandas.DataFrame(columns, index=pandas.Index(self.time, name="time"))
        frame.attrs["units"] = {"time": "s", **units}
        return frame

    def to_xarray(self) -> Any:
        """Return all signals and modes as a data set; needs the extra `batch`.

        Returns
        -------
        xarray.Dataset
            Signals over the coordinate `time`, two values at an event that is recorded on both sides, with the attribute `units`. A vector has its entries
            along a dimension of its own (`chain.speed.entry`), modes are words (`bit.mode`).
        """
        xarray = optional("xarray", "`to_xarray`", "batch")
        data: dict[str, Any] = {}
        for name, values in self.columns(self.names).items():
            data[name] = (("time", f"{name}.entry")[: values.ndim], values, {"units": self.unit(name)})
        data |= {f"{name}.mode": ("time", mode) for name, mode in self.modes.items()}
        return xarray.Dataset(data, {"time": ("time", self.time, {"units": "s"})})

    def to_csv(self, path: str | Path) -> Path:
        """Write all signals as CSV in SI, units in the headings (`bit.speed [rad/s]`), one row per recorded time, whole or not at all.

        Entries of a vector are columns of their own (`chain.speed.0`). Where an event is recorded on both sides, the row is its right-hand limit, so
        that times increase; `save` keeps both sides, and the modes.
        """
        from toolbox.files import tables

        columns: dict[tuple[str, str], np.ndarray] = {("time", "s"): self.time}
        for name, values in self.columns(self.names).items():
            unit = self.unit(name)
            columns |= {(name, unit): values} if values.ndim == 1 else {(f"{name}.{i}", unit): values[:, i] for i in range(values.shape[1])}
        once = np.append(np.diff(self.time) > 0.0, True)[: self.time.size]
        headings = [tables.heading(name, unit) for name, unit in columns]
        return tables.write(path, headings, np.column_stack(list(columns.values()))[once].tolist())
