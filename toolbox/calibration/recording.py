"""Measured signals: read from a CSV or TOML table, a MAT file, a mapping or a run, under the names and in the units of a plant."""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import finite_array, mapping
from toolbox.errors import SceneError, suggest
from toolbox.files import tables as table
from toolbox.files.archives import understood
from toolbox.files.units import parse
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.simulation.saved_run import SavedRun
from toolbox.simulation.trajectory import Trajectory

NULLS = (-999.25, -999.0, -9999.0, -9999.25, -99999.0)
"""Numbers by which logs say that there is no value (the NULL of LAS files, and its relatives)."""

_NAMED = re.compile(r"\s*([^\[\]]*?)\s*(?:\[\s*([^\[\]]*?)\s*\])?\s*")


@dataclass(frozen=True)
class Recording:
    """Signals of a machine at measured times.

    Attributes
    ----------
    time
        Increasing times [s] from 0, shape (nt,).
    signals
        {name in the plant: values in its SI unit, shape (nt,)}.
    source
        Where they come from.
    """

    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    source: str

    @staticmethod
    def of(data: Any, plant: HybridSystem, columns: Mapping[str, str] | None = None) -> Recording:
        """Read a recording from a file, a mapping {name: values} or a run.

        Files are CSV or TOML, as `toolbox.files.tables` reads them, or MAT up to version 7. Times are shifted to begin at 0.

        Parameters
        ----------
        data
            Path of the file, the mapping, or the run.
        plant
            The plant whose signals are meant, if there is one.
        columns
            {signal of the plant, or "time": what it is called in the data}; without it the data use the names of the plant. Units stand in the headings of a
            table; in a MAT file, a mapping or a run numbers are SI unless `columns` says otherwise: {"bit.speed": "rpm_bit [rpm]"}. Columns that it does not
            name are not read.

        Raises
        ------
        SceneError
            If the file cannot be read, a column is unknown or missing, a unit does not fit, a number is not finite, times do not increase, or there are fewer
            than three samples.
        """
        if isinstance(data, Recording):
            return data
        columns = None if columns is None else mapping("columns", columns)
        if not all(isinstance(label, str) for label in (columns or {}).values()):
            raise SceneError(f"Argument `columns` must name the column of every signal, but it is {columns!r}.")
        for name in columns or {}:
            if name != "time":
                _scalar_unit(plant, name)
        if isinstance(data, (str, Path)):
            path = Path(data)
            if path.suffix.lower() == ".mat":
                values, source = _of_arrays(_mat(path), f"File `{path}`", plant, columns), path.name
            else:
                values, source = _of_table(path, plant, columns), path.name
        elif isinstance(data, (Trajectory, SavedRun)):
            values, source = _of_arrays(_recorded(data, plant if columns is None else None), "Argument `data`", plant, columns), "a run"
        elif hasattr(data, "keys") and hasattr(data, "__getitem__"):
            values, source = _of_arrays({str(key): data[key] for key in data.keys()}, "Argument `data`", plant, columns), "given data"  # noqa: SIM118
        else:
            raise SceneError(
                f"Argument `data` must be the path of a table or MAT file, a run, or a mapping of names to values, but it is {data!r}."
            )
        time = values.pop("time")
        if time.size < 3:
            raise SceneError(f"The data of {source} must hold at least three samples, but they hold {time.size}.")
        late = np.flatnonzero(np.diff(time) <= 0)
        if late.size:
            k = int(late[0]) + 1
            raise SceneError(
                f"The times of {source} must increase, but sample {k + 1} is at {time[k]:.9g} s and the one before at {time[k - 1]:.9g} s."
            )
        if not values:
            raise SceneError(f"The data of {source} must hold a signal beside the time, but there is none.")
        return Recording(time - time[0], values, source)

    def between(self, begin: float, end: float) -> Recording:
        """The samples between two times [s], whose clock then begins at 0."""
        keep = (self.time >= begin) & (self.time <= end)
        if keep.sum() < 3:
            raise SceneError(f"The window {begin:g} .. {end:g} s must hold at least three samples, but it holds {keep.sum()}.")
        return Recording(self.time[keep] - self.time[keep][0], {name: values[keep] for name, values in self.signals.items()}, self.source)


def _scalar_unit(plant: HybridSystem, name: str) -> str:
    """Unit of a scalar signal or input; raises SceneError for an unknown name and for a vector."""
    unit = plant.signal_unit(name)
    rows = plant.rows(name)
    size = rows[1] if rows is not None else None
    if size is not None or (rows is None and name in plant.signals and plant.signals[name][0].numel() > 1):
        raise SceneError(f"Argument `columns` must name scalars, but `{name}` has several entries: choose one, e.g. `{name}.0`.")
    return unit


def _known(plant: HybridSystem) -> list[str]:
    """Names that a column may have where none are given: scalar signals, entries of vector states and inputs."""
    names = [name for name, (expression, _) in plant.signals.items() if expression.numel() == 1]
    entries = [f"{name}.{i}" for name, (_, size, _) in plant.states.items() if size for i in range(size)]
    return [*names, *entries, *plant.inputs]


def _of_table(path: Path, plant: HybridSystem, columns: Mapping[str, str] | None) -> dict[str, np.ndarray]:
    wanted = [table.Column("time", "s", ((columns or {}).get("time", "time"),))]
    if columns is None:
        wanted += [table.Column(name, plant.unit(name), required=False) for name in _known(plant)]
    else:
        for name, heading in columns.items():
            if name != "time":
                wanted.append(table.Column(name, plant.signal_unit(name), (heading,)))
    found = table.read(path, wanted, others=columns is not None)
    values = {name: np.array([row[name] for row in found.rows]) for name in found.rows[0]}
    for name, array in values.items():
        match = _NAMED.fullmatch(found.headings[name])
        factor = parse(f"1 {match[2]}", "s" if name == "time" else plant.unit(name), name) if match and match[2] else 1.0
        _check_nulls(array / factor, f"Table `{path}`, column `{found.headings[name]}`,")
    return values


def _check_nulls(numbers: np.ndarray, where: str) -> None:
    """Raise SceneError for the numbers by which logs say that they have none."""
    for null in NULLS:
        places = np.flatnonzero(np.isclose(numbers, null, rtol=1e-12, atol=0.0))
        if places.size:
            raise SceneError(
                f"{where} must hold measured numbers, but {places.size} are {null:g}, the sign of logs for none, the first in sample {int(places[0]) + 1}: "
                "leave those samples out."
            )


def _recorded(run: Trajectory | SavedRun, plant: HybridSystem | None) -> dict[str, np.ndarray]:
    """The recorded signals of a run, those that a plant knows where one is given, as `Trajectory.to_csv` writes them: right-hand limits at events."""
    once = np.append(np.diff(run.time) > 0.0, True)[: run.time.size]
    found = {"time": run.time[once]}
    for name in run.names:
        values = run[name][once]
        entries = {name: values} if values.ndim == 1 else {f"{name}.{i}": column for i, column in enumerate(values.T)}
        found |= {each: array for each, array in entries.items() if plant is None or plant.has_signal(each)}
    return found


def _mat(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    if not path.is_file():
        beside = [other.name for other in path.parent.glob("*.mat")] if path.parent.is_dir() else []
        raise SceneError(f"There is no file `{path}`" + (f": {suggest(path.name, beside)}" if beside else "."))
    with understood(path, "a MAT file"):
        content = path.read_bytes()
        try:
            found = loadmat(io.BytesIO(content), squeeze_me=True)
        except NotImplementedError:
            raise SceneError(f"File `{path}` must be a MAT file up to version 7, but it is of version 7.3: save it with `-v7`.") from None
        _check_compressed(content)
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _check_compressed(content: bytes) -> None:
    """Unpack every compressed element of a MAT file of version 5 to its end, where its checksum is looked at: scipy stops before. Raises zlib.error."""
    little = content[126:128] == b"IM"
    if not little and content[126:128] != b"MI":
        return  # version 4, which has neither
    at = 128
    while at + 8 <= len(content):
        kind, size = struct.unpack_from("<II" if little else ">II", content, at)
        if kind == 15:
            zlib.decompress(content[at + 8 : at + 8 + size])
        at += 8 + (size if kind == 15 else -(-size // 8) * 8)


def _of_arrays(given: Mapping[str, Any], where: str, plant: HybridSystem, columns: Mapping[str, str] | None) -> dict[str, np.ndarray]:
    asked = {"time": "time", **(columns if columns is not None else {name: name for name in given})}
    values: dict[str, np.ndarray] = {}
    for name, label in asked.items():
        match = _NAMED.fullmatch(label)
        column, unit = (match[1], match[2]) if match else (label, None)
        if column not in given:
            raise SceneError(f"{where} must have `{column}`, but it is not there: {suggest(column, given)}")
        if name != "time" and columns is None and not plant.has_signal(name):
            raise SceneError(f"{where} has the unknown column `{name}`: {suggest(name, _known(plant))}")
        own = "s" if name == "time" else _scalar_unit(plant, name)
        numbers = _numbers(given[column], f"{where}, column `{column}`,")
        _check_nulls(numbers, f"{where}, column `{column}`,")
        values[name] = numbers * (1.0 if unit is None else parse(f"1 {unit}", own, column))
    sizes = {name: array.size for name, array in values.items()}
    for name, size in sizes.items():
        if size != sizes["time"]:
            raise SceneError(
                f"{where} must have columns of one length, but `{asked[name]}` has {size} samples and the time {sizes['time']}."
            )
    return values


def _numbers(value: Any, where: str) -> np.ndarray:
    try:
        array = np.squeeze(np.asarray(value))
    except (TypeError, ValueError):
        array = np.empty(0, object)
    if array.ndim != 1 or array.dtype.kind not in "iuf":
        raise SceneError(f"{where} must be one row of numbers, but it is an array of shape {array.shape} and kind {array.dtype}.")
    numbers = finite_array(array)
    if numbers is None:
        bad = np.flatnonzero(~np.isfinite(array))
        raise SceneError(f"{where} must hold finite numbers, but {bad.size} are not, the first in sample {int(bad[0]) + 1}.")
    return numbers
