"""Columns of a log as channels of a plant: which column is which signal, its numbers, and its times."""

from __future__ import annotations

import datetime
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.errors import SceneError, joined, suggest
from toolbox.logs.cells import UNITLESS, epoch, factor, plain_number, quantity_of
from toolbox.logs.dates import DAY, UNDERSTOOD, are_clock_digits, digits_of, has_clock, has_date, is_format, is_time, seconds_of
from toolbox.logs.grids import NONE, Column, Source, named
from toolbox.logs.sources import from_file, from_frame, from_mapping
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.simulation.saved_run import SavedRun
from toolbox.simulation.trajectory import Trajectory

TIMES = (
    "time",
    "t",
    "timestamp",
    "datetime",
    "date time",
    "date_time",
    "date/time",
    "date-time",
    "time stamp",
    "zeit",
    "time index",
    "utc",
    "time_utc",
    "etim",
    "tim",
    "epoch",
    "elapsed",
)
"""Names, in small letters, by which a column is the time where none is said to be."""


def scalar_unit(plant: HybridSystem, name: str) -> str:
    """Unit of a scalar signal or input; raises SceneError for an unknown name and for a vector."""
    unit = plant.signal_unit(name)
    rows = plant.state_index(name)
    size = rows[1] if rows is not None else None
    if size is not None or (rows is None and name in plant.signals and plant.signals[name][0].numel() > 1):
        raise SceneError(f"Argument `columns` must name scalars, but `{name}` has several entries: choose one, e.g. `{name}.0`.")
    return unit


def _names(plant: HybridSystem) -> list[str]:
    """Names that a column may have where none are given: scalar signals, entries of vector states and inputs."""
    names = [name for name, (expression, _) in plant.signals.items() if expression.numel() == 1]
    entries = [f"{name}.{i}" for name, (_, size, _) in plant.states.items() if size for i in range(size)]
    return [*names, *entries, *plant.inputs]


def source_of(data: Any, plant: HybridSystem, columns: Mapping[str, str] | None, decimal: str | None) -> tuple[Source, str, str]:
    """(columns, what errors call the data, what the recording calls them)."""
    if isinstance(data, (str, Path)):
        path = Path(data)
        if path.suffix.lower() == ".toml":
            return _of_toml(path, plant, columns), f"Table `{path}`", path.name
        source = from_file(path, decimal, [named(label)[0] for label in (columns or {}).values()])
        return source, f"File `{path}`" if path.suffix.lower() == ".mat" else f"Table `{path}`", path.name
    if isinstance(data, (Trajectory, SavedRun)):
        source = from_mapping(_recorded(data, plant if columns is None else None))
        source.what = "run"
        return source, "Argument `data`", "a run"
    if hasattr(data, "columns") and hasattr(data, "index"):
        return from_frame(data, bare=True), "Argument `data`", "a table of pandas"
    if hasattr(data, "keys") and hasattr(data, "__getitem__"):
        return from_mapping({str(key): data[key] for key in data.keys()}), "Argument `data`", "given data"  # noqa: SIM118
    raise SceneError(f"Argument `data` must be the path of a log, a run, or a mapping of names to values, but it is {data!r}.")


def _of_toml(path: Path, plant: HybridSystem, columns: Mapping[str, str] | None) -> Source:
    """A table in TOML, whose numbers are in SI already."""
    from toolbox.files import tables as table

    wanted = [table.Column("time", "s", ((columns or {}).get("time", "time"),))]
    if columns is None:
        wanted += [table.Column(name, plant.unit(name), required=False) for name in _names(plant)]
    else:
        wanted += [table.Column(name, plant.signal_unit(name), (heading,)) for name, heading in columns.items() if name != "time"]
    found = table.read(path, wanted, others=columns is not None)
    return Source(
        [Column((columns or {}).get(name, name), None, [row[name] for row in found.rows]) for name in found.rows[0]], "table", bare=True
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


def chosen(source: Source, where: str, plant: HybridSystem, columns: Mapping[str, str] | None) -> dict[str, tuple[Column, str | None]]:
    """{signal, or "time": (its column, unit)}; raises SceneError for names that are not there."""
    known: dict[str, Column] = {}
    spelled: dict[str, Column] = {}
    for column in source.columns:
        known.setdefault(_plain(column.name), column)
        spelled.setdefault(column.name, column)
    for column in source.columns:  # brackets that hold an unknown unit are part of the name, which may be asked for without them
        if (match := re.fullmatch(r"(.+?)\s*[\[(]([^\[\]()]+)[\])]", column.name)) is not None:
            bare = Column(column.name, column.unit or match[2].strip(), column.cells, column.nulls)
            known.setdefault(_plain(match[1]), bare)
            spelled.setdefault(match[1], bare)
    labels = list((columns or {}).values())
    found: dict[str, tuple[Column, str | None]] = {}
    time = (columns or {}).get("time")
    if time is None:
        heading = _plain(source.index) if source.index is not None else next((each for each in TIMES if each in known), None)
        if heading is None or heading not in known:
            raise SceneError(
                f"Argument `columns` must say which column is `time`, because no column of {_small(where)} is called so: {_listed(source)}."
            )
        found["time"] = (known[heading], known[heading].unit)
    else:
        found["time"] = _looked_up(spelled, time, where, "s", labels)
    others = {
        name: _looked_up(spelled, heading, where, plant.signal_unit(name), labels)
        for name, heading in (columns or {}).items()
        if name != "time"
    }
    found["time"] = _with_dates(source, *found["time"], {column.name for column, _ in others.values()})
    if columns is not None:
        return found | others
    mine = {_plain(name): name for name in _names(plant)}
    taken = found["time"][0].name.split(" + ")
    for word, column in known.items():
        if column.name in taken or column.name.startswith("#"):
            continue
        if word not in mine:
            name = column.name
            if plant.has_signal(name):
                scalar_unit(plant, name)
            remedy = (
                f"name the column of each signal, `columns={{signal: {name!r}}}` (`--column SIGNAL={name}`), and all others are left out"
            )
            raise SceneError(f"{where} has the unknown column `{name}`: {suggest(name, _names(plant)).rstrip('.')}; {remedy}.")
        found[mine[word]] = (column, column.unit)
    return found


def _with_dates(source: Source, time: Column, unit: str | None, taken: set[str]) -> tuple[Column, str | None]:
    """The time of day with the dates of the column beside it, where one of the two is meant to be the time.

    Dates that stand still while the time of day passes midnight are those of something else, and are left out.
    """
    cells = np.ravel(np.asarray(time.cells, object)) if np.asarray(time.cells).dtype.kind in "OUS" else np.zeros(0)
    some = [cell for cell in cells[:50].tolist() if _heading_of(cell)]
    is_clock, is_date = bool(some) and all(map(has_clock, some)), bool(some) and all(map(has_date, some))
    if not is_clock and not is_date:
        return time, unit
    place = next((k for k, column in enumerate(source.columns) if column.name == time.name), 0)
    for k, column in enumerate(source.columns):
        word = _plain(column.name)
        if column.name == time.name or column.name in taken or np.asarray(column.cells).dtype.kind not in "OUS":
            continue
        if abs(k - place) > 1 and word not in ("date", "datum", "time", "zeit"):
            continue
        other = [cell for cell in list(column.cells)[:50] if _heading_of(cell)]
        if not other or not all(map(has_date if is_clock else has_clock, other)):
            continue
        days, clocks = (column, time) if is_clock else (time, column)
        both = [f"{_day(a)} {b}" for a, b in zip(days.cells, clocks.cells, strict=True)]
        clock = seconds_of(list(clocks.cells), "")[0]
        still = len({_day(cell) for cell in days.cells}) == 1
        if still and (np.nanmax(clock) >= DAY or np.nanmin(clock) < 0.0):
            source.notes.append(f"`{days.name}` stands still past midnight, and is left out of the time")
            return (clocks, clocks.unit) if is_clock else (time, unit)
        return Column(f"{days.name} + {clocks.name}", None, both), unit if is_format(unit) and "y" in str(unit).lower() else days.unit
    return time, unit


def _heading_of(cell: Any) -> str:
    return "" if cell is None or cell != cell else str(cell).strip()


def _day(cell: Any) -> str:
    return cell.date().isoformat() if isinstance(cell, datetime.datetime) else str(cell)


def _plain(name: str) -> str:
    return " ".join(name.split()).casefold()


def _small(where: str) -> str:
    return where[0].lower() + where[1:]


def _listed(source: Source) -> str:
    return joined(column.name for column in source.columns)


def heading_for(label: str, headings: Sequence[str], labels: Sequence[str]) -> str | None:
    """Return the heading that a label means: the same text, or else the same but for capitals, unless another label has that text; None if there is none.

    `t` and `T` beside each other are two columns. A label may have a unit behind the heading. Raises SceneError if several headings differ from the label by
    capitals alone.
    """
    texts = {" ".join(heading.split()): heading for heading in reversed(headings)}
    others = {" ".join(text.split()) for each in labels for text in (each, named(each)[0])}
    for name in dict.fromkeys([" ".join(label.split()), named(label)[0]]):
        if name in texts:
            return texts[name]
        found = [text for text in texts if text.casefold() == name.casefold() and text not in others]
        if len(found) > 1:
            raise SceneError(f"`{label}` must be spelled as the heading of a column, but {joined(found)} differ from it by capitals alone.")
        if found:
            return texts[found[0]]
    return None


def _looked_up(known: Mapping[str, Column], label: str, where: str, wanted: str, labels: Sequence[str]) -> tuple[Column, str | None]:
    """(column, its unit) of a label among all labels; a unit in the label counts where the heading has none that fits to the signal."""
    heading = heading_for(label, list(known), labels)
    whole = heading is not None and _plain(heading) == _plain(label)
    name, unit = (label, None) if whole else named(label)
    column = None if heading is None else known[heading]
    if column is None:
        raise SceneError(f"{where} must have `{name}`, but it is not there: {suggest(name, [each.name for each in known.values()])}")
    if unit is not None and column.unit is not None and not is_format(unit) and digits_of(unit) is None:
        sizes = [_size(each, wanted) for each in (column.unit, unit)]
        if sizes[0] is not None and sizes[0] != sizes[1]:
            raise SceneError(
                f"{where} must have `{name}` in {unit}, as was asked, but its heading says {column.unit}: ask for `{column.name}` without a unit."
            )
    return column, unit if unit is not None else column.unit


def _size(unit: str, wanted: str) -> float | None:
    try:
        return factor(unit, wanted, "unit")
    except SceneError:
        return None


def size_of(unit: str, wanted: str, column: str, signal: str, here: str) -> float:
    """Return how many of the wanted unit one of a column's is; the error of an unknown, doubtful or unfit one says how to mend the column."""
    try:
        return factor(unit, wanted, column)
    except SceneError as error:
        head = f"{here} must have a unit of {wanted}, but it has `{unit}`"
        where = f"where you say which column is `{signal}`, as in"
        faces = "(in Python `columns`, on the command line --column)"
        measured, own = quantity_of(unit), quantity_of(wanted)
        if measured:
            raise SceneError(
                f"{head}, a unit of {measured}. {_conversion(measured, own, wanted, signal)} Only if the heading is wrong, give the right unit {where} "
                f"`{column} [{'rev/s' if (measured, own) == ('frequency', 'angular speed') else wanted}]` {faces}."
            ) from None
        raise SceneError(
            f"{head}. {error} Say which unit it is {where} `{column} [{'t' if wanted == 'N' and 'ton' in unit.lower() else wanted}]` {faces}."
        ) from None


def _conversion(measured: str, own: str, wanted: str, signal: str) -> str:
    """The sentence on a column that measures another quantity than its signal: how to get the signal from it."""
    if measured == "current" and own in ("torque", "force"):
        return f"A current is no {own}: multiply it by the {own} constant [{wanted}/A] first, and write the product in {wanted}."
    if (measured, own) == ("frequency", "angular speed"):
        return "An angular speed is in rad/s or rpm, and 1 Hz is 60 rpm: multiply it by 60, and write the product in rpm."
    return f"It cannot be converted to {wanted} without another number: choose another column for `{signal}`, or write the converted samples in {wanted}."


def numbers_of(cells: Any, mark: str, where: str) -> tuple[np.ndarray, str]:
    """(numbers, nan where a cell has none, and what was passed over in words)."""
    try:
        array = np.atleast_1d(np.squeeze(np.asarray(cells)))
    except (TypeError, ValueError):
        array = np.empty(0, object)
    if array.ndim != 1 or array.dtype.kind not in "iufOUS":
        raise SceneError(f"{where} must be one row of numbers, but it is an array of shape {array.shape} and kind {array.dtype}.")
    if array.dtype.kind in "iuf":
        return array.astype(float), ""
    numbers = np.array([plain_number(cell, mark) for cell in array.tolist()])
    words = [str(cell).strip() for cell, value in zip(array.tolist(), numbers, strict=True) if value != value and isinstance(cell, str)]
    odd = sorted({word for word in words if word.lower() not in NONE})
    if array.size and len([word for word in words if word.lower() not in NONE]) > 0.5 * array.size:
        raise SceneError(f"{where} must be one row of numbers, but it holds text such as `{odd[0]}`.")
    return numbers, f"text such as `{odd[0]}` is none" if odd else ""


def times_of(source: Source, column: Column, unit: str | None, where: str) -> tuple[np.ndarray, list[str]]:
    """(times [s], how they were read)."""
    here = f"{where}, column `{column.name}`,"
    cells = column.cells
    array = np.asarray(cells)
    if unit is not None and (unit in ("", "-", "1") or unit.lower() in UNITLESS):
        unit = None
    if array.dtype.kind == "M":
        return np.where(np.isnat(array), np.nan, array.astype("datetime64[ns]").astype(np.int64) / 1e9), ["time: dates"]
    if array.dtype.kind in "OUS" or digits_of(unit) is not None:
        cells = array.ravel().tolist()
        given = [cell for cell in cells if cell is not None and cell == cell and str(cell).strip()]
        if digits_of(unit) is not None:
            shown = [f"{cell:.10g}" if isinstance(cell, float) and cell == cell else cell for cell in cells]
            found, words = seconds_of(shown, here, unit)
            return found, [f"time: {words}"]
        if given and np.mean([is_time(cell) for cell in given[:50]]) > 0.5:
            found, words = seconds_of(cells, here, unit)
            return found, [f"time: {words}"]
        if given and all(plain_number(cell, source.mark) != plain_number(cell, source.mark) for cell in given[:50]):
            raise SceneError(
                f"{here} must hold times, but it holds `{given[0]}`. Understood are numbers with a unit and {UNDERSTOOD}: write them so, or say which column "
                "is `time` (in Python `columns`, on the command line --column)."
            )
    numbers, said = numbers_of(array if array.dtype.kind in "OUS" else cells, source.mark, here)
    numbers = np.where(np.abs(np.nan_to_num(numbers)) >= 1e29, np.nan, numbers)
    numbers = np.where(np.isin(numbers, (-999.25, -32768.0, *source.nulls, *column.nulls)), np.nan, numbers)
    notes = [f"time: {said}"] if said else []
    count = epoch(numbers) if unit is None or "epoch" in unit.lower() or is_format(unit) else None
    if count is not None and not (source.bare and count == 1.0 and np.nanmax(numbers) < 1e8):
        return numbers * count, [*notes, f"time: epoch in {({1.0: 's', 1e-3: 'ms', 1e-6: 'us', 1e-9: 'ns'})[count]}"]
    if unit is None and not source.bare:
        raise SceneError(
            f"{here} must name its unit, such as `{column.name} [s]`, or `{column.name} [HHMMSS]` for a time of day in digits: write so there, or where you "
            "say which column is `time` (in Python `columns`, on the command line --column)."
        )
    size = 1.0 if unit is None else size_of(unit, "s", column.name, "time", here)
    if size == 1.0 and array.dtype.kind in "OUS" and are_clock_digits([str(cell).strip() for cell in given]):
        raise SceneError(
            f"{here} must hold seconds, but it holds `{given[0]}` and others whose last two pairs of digits stay below 60 while minutes pass: say "
            f"`{column.name} [HHMMSS]` where you say which column is `time` (in Python `columns`, on the command line --column) if they are times of day, or "
            f"write seconds with a decimal, such as `{given[0]}.0`."
        )
    return numbers * size, notes
