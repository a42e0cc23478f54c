"""Runs in files: what is written of a run, and the run that is read back.

A file holds data only, and needs neither the plant nor code to be read. Between its nodes every signal is a polynomial through its values at the
Chebyshev-Lobatto points of the step, of the lowest degree from 1 to 32 that agrees with the run at points between to 2e-11 of the size of the signal, or to
2e-5 of the accuracy of the run where that is less, down to 1e-12 (J.-P. Berrut and L. N. Trefethen (2004), doi:10.1137/S0036144502417715). Therefore a run
that is read back answers at any time, and is plotted, measured and compared like the run itself.

Keys of the npz file: `time` [s], `begin` [s] and `end` [s]; one array per signal, named by it, at the recorded times; `<element>.mode` with 1, 0, -1 for
slip+, stick, slip-, or what `modes.element`, `modes.number`, `modes.word` say, row by row; `modes.last`, a word for each element; `event.time`,
`event.element`, `event.before`, `event.after`; `unit.names` and `unit.values`, the unit of each signal. `step.time` [s] and `step.mode`: nodes, of which each
begins a step with its modes; `step.degree`: of the polynomials in it, 0 where the step is an instant; `step.<signal>`: their values at degree + 1 points per
step, or one value per step for a signal that changes in none, such as a command that is held. `contacts`, `main`: names of the elements with friction and of
the signals that a plot shows; `limit.names`, `limit.values`: what the drive keeps signals within, nan for no limit; `approach.<element>`: speeds at the
impacts of a unilateral contact [m/s]; `asked.units`, `asked.typed`: the units in which the run was asked for, and answers; `report`: lines about the run;
`error`: what `run.error_estimate` said, nan where it was not asked; `accuracy`: that of the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, Generic, overload

import numpy as np

from toolbox.arguments import FloatArray
from toolbox.errors import SceneError, suggest
from toolbox.files.archives import Shape, arrays, check_shapes, understood
from toolbox.files.atomic import replaced
from toolbox.messages import LOG
from toolbox.simulation.recorded import Recorded
from toolbox.simulation.samples import Event, Modes, Read

DEGREES = (1, 2, 4, 8, 16, 32)
"""Degrees of the polynomials: the points of one are every second point of the next."""

SAME, FINEST = (2e-11, 2e-5), 1e-12
"""How far polynomials may be from the run at the points between: parts of the size of a signal and of the accuracy of the run, whichever is less, and the
least. What is read back is the same run, not another within its accuracy; at 1e-12 a well of 16 inertias under a sampled drive takes 1.5 times the time."""

CHUNK = 512
"""Steps that are sampled together."""

SILENT = 2.0
"""Seconds after which a word says how far saving is."""


def write(run: Any, target: Path, names: Sequence[str] | None = None) -> Path:
    """Write a trajectory with the signals of these names, or with all, whole or not at all."""
    names = list(run.names if names is None else names)
    written: dict[str, np.ndarray] = {"time": run.time, "begin": np.array(run.begin), "end": np.array(run.end)}
    written |= run.columns(names)
    elements = list(run.modes)
    written |= {f"{name}.mode": run.mode[:, i] for i, name in enumerate(elements)}
    legend = [(name, mode, word) for name, words in run._legends.items() for mode, word in words.items()]
    written["modes.element"] = np.array([name for name, _, _ in legend], dtype=np.str_)
    written["modes.number"] = np.array([mode for _, mode, _ in legend], dtype=np.int8)
    written["modes.word"] = np.array([word for _, _, word in legend], dtype=np.str_)
    written["modes.last"] = np.array([run._at_last(name) for name in elements], dtype=np.str_)
    written["event.time"] = np.array([event.time for event in run.events])
    for field in ("element", "before", "after"):
        written[f"event.{field}"] = np.array([getattr(event, field) for event in run.events], dtype=np.str_)
    written["unit.names"] = np.array(names, dtype=np.str_)
    written["unit.values"] = np.array([run.unit(name) for name in names], dtype=np.str_)
    degree, values = polynomials(run, names)
    written |= {"step.time": run.every_step.time, "step.mode": run.every_step.mode, "step.degree": degree}
    written |= {f"step.{name}": points for name, points in values.items()}
    written["contacts"] = np.array(run.contacts, dtype=np.str_)
    written["main"] = np.array([name for name in run.main_signals if name in names], dtype=np.str_)
    limits = {name: [np.nan if end is None else end for end in ends] for name, ends in run.signal_limits.items()}
    written["limit.names"] = np.array(list(limits), dtype=np.str_)
    written["limit.values"] = np.array(list(limits.values())).reshape(-1, 2)
    for element in run.program.system.elements:
        if element.has_gap:
            written[f"approach.{element.name}"] = run.impact_speeds(element.name)
    written |= {
        "asked.units": np.array(list(run.display_units), dtype=np.str_),
        "asked.typed": np.array(list(run.display_units.values()), dtype=np.str_),
    }
    written["report"] = np.array(run._headlines, dtype=np.str_)
    written["error"] = np.array(vars(run).get("error_estimate", np.nan))
    written["accuracy"] = np.array(run.accuracy)
    with replaced(target) as file:
        np.savez(file, **written)  # type: ignore[arg-type]  # packed it would be half as long, and take ten times the time of all the rest
    return target


def points(degree: int) -> np.ndarray:
    """Chebyshev-Lobatto points between 0 and 1, in increasing order, shape (degree + 1,)."""
    return 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / max(degree, 1))


def interpolated(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The polynomials through `values` (steps, degree + 1, ...) at the points `degree`, at the places `at` (steps,) between 0 and 1: shape (steps, ...)."""
    degree = values.shape[1] - 1
    if degree == 0:
        return values[:, 0]
    weights = np.where(np.arange(degree + 1) % 2, -1.0, 1.0)
    weights[[0, -1]] *= 0.5
    distance = at[:, None] - points(degree)
    hit = distance == 0.0
    parts = np.where(hit.any(axis=1)[:, None], hit, weights / np.where(hit, 1.0, distance))
    parts /= parts.sum(axis=1, keepdims=True)
    return np.einsum("sk,sk...->s...", parts, values)


def polynomials(run: Any, names: Sequence[str]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """(degree of each node, {signal: values at the points of all nodes in order, or at the nodes}), as a file holds them."""
    nodes = run.every_step
    at_nodes = nodes.columns(names)
    size = np.maximum(np.abs(np.column_stack(list(at_nodes.values()))).max(axis=0, initial=0.0), 1e-300)
    apart = size * max(min(SAME[0], SAME[1] * run.accuracy), FINEST)
    long = np.append(np.diff(nodes.time) > 0, False)[: nodes.time.size]
    degree = np.zeros(nodes.time.size, np.int8)
    kept: list[tuple[np.ndarray, np.ndarray]] = []
    began, silent = perf_counter(), True
    for first in range(0, nodes.time.size, CHUNK):
        rows = np.arange(first, min(first + CHUNK, nodes.time.size))
        found = _instants(nodes, rows[~long[rows]], names) + _lowest(nodes, rows[long[rows]], names, apart)
        for chosen, values in found:
            degree[chosen] = values.shape[1] - 1
        kept += found
        if silent and perf_counter() - began > SILENT and rows[-1] + 1 < degree.size:
            LOG.info("saving %d steps: %d are done after %.0f s ...", degree.size, rows[-1] + 1, perf_counter() - began)
            silent = False
    ends = np.cumsum([values[:1].size if values.ndim > 1 else 1 for values in at_nodes.values()])
    return degree, {name: _together(degree, kept, end, values) for (name, values), end in zip(at_nodes.items(), ends.tolist(), strict=True)}


def _together(degree: np.ndarray, kept: Sequence[tuple[np.ndarray, np.ndarray]], end: int, at_nodes: np.ndarray) -> np.ndarray:
    """The values of a signal, the scalars before `end`, at the points of all nodes in order; those at the nodes where it changes in no step."""
    own = slice(end - at_nodes[:1].size, end)
    if all((values[:, 1:, own] == values[:, :1, own]).all() for _, values in kept):
        return at_nodes
    first = np.cumsum(degree + 1, dtype=int) - (degree + 1)
    found = np.empty((int((degree + 1).sum(dtype=int)), own.stop - own.start))
    for chosen, values in kept:
        found[first[chosen][:, None] + np.arange(values.shape[1])] = values[:, :, own]
    return found.reshape(-1, *at_nodes.shape[1:])


def _instants(nodes: Any, rows: np.ndarray, names: Sequence[str]) -> list[tuple[np.ndarray, np.ndarray]]:
    """The nodes `rows`, which begin no step, with their values as polynomials of degree 0."""
    return [(rows, _sampled(nodes, rows, points(0), names))] if rows.size else []


def _lowest(nodes: Any, rows: np.ndarray, names: Sequence[str], apart: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Those of the steps that begin at `rows` which have one degree, with their values (steps, degree + 1, scalars): the lowest degree that agrees."""
    found: list[tuple[np.ndarray, np.ndarray]] = []
    values = _sampled(nodes, rows, points(4), names) if rows.size else np.empty(0)
    for fine in DEGREES[2:]:
        # the first comparison has the degrees 1 and 2 on the points of 4, so that nothing passes by chance at one point
        for coarse in (1, 2) if fine == 4 else (fine // 2,):
            if rows.size:
                fits = _agrees(values, coarse, fine, apart)
                found.append((rows[fits], values[fits][:, :: fine // coarse]))
                rows, values = rows[~fits], values[~fits]
        if rows.size and fine < DEGREES[-1]:
            finer = np.empty((rows.size, 2 * fine + 1, apart.size))
            finer[:, ::2], finer[:, 1::2] = values, _sampled(nodes, rows, points(2 * fine)[1::2], names)
            values = finer
    return [*found, (rows, values)] if rows.size else found


def _sampled(nodes: Any, rows: np.ndarray, places: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Values (steps, places, scalars) of signals at places between 0 and 1 in the steps that begin at `rows`."""
    end = nodes.time[np.minimum(rows + 1, nodes.time.size - 1)]
    times = nodes.time[rows][:, None] + (end - nodes.time[rows])[:, None] * places
    times[:, places == 1.0] = end[:, None]
    columns = nodes.interpolated(np.repeat(rows, places.size), times.ravel()).columns(names)
    return np.column_stack(list(columns.values())).reshape(rows.size, places.size, -1)


def _agrees(values: np.ndarray, coarse: int, fine: int, apart: np.ndarray) -> np.ndarray:
    """In which steps the polynomials of the coarse degree are so little apart from those of the fine one, scalar by scalar."""
    between = [k for k in range(fine + 1) if k % (fine // coarse)]
    basis = interpolated(np.broadcast_to(np.eye(coarse + 1), (len(between), coarse + 1, coarse + 1)), points(fine)[between])
    return (np.abs(basis @ values[:, :: fine // coarse] - values[:, between]) <= apart).all(axis=(1, 2))


class SavedSamples(Generic[Read]):
    """Signals of a saved run at given times: `samples["bit.speed"]`, an array of shape (nt,), or (nt, n) for a vector state; floats at a single time."""

    def __init__(self, steps: SavedSteps, row: np.ndarray, time: np.ndarray, single: bool):
        self.steps = steps
        self.row = row
        self.time = time
        self.mode = steps.mode[row]
        self._single = single

    def __getitem__(self, name: str) -> Read:
        values = self.steps.values(name, self.row, self.time)
        return (float(values[0]) if values.ndim == 1 else values[0]) if self._single else values  # type: ignore[return-value]

    def columns(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """{signal: its values at all times}; raises SceneError for an unknown name."""
        return {name: self.steps.values(name, self.row, self.time) for name in names}

    @property
    def modes(self) -> dict[str, np.ndarray]:
        """Mode of each element, as words."""
        return Modes(
            {
                name: np.array([words[mode] for mode in self.mode[:, i].tolist()], np.str_)
                for i, (name, words) in enumerate(self.steps.words.items())
            }
        )


def _completed(found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of a file; one of a version that wrote records alone has straight lines between these, and says so."""
    if "step.time" in found:
        return found
    names, elements = found["unit.names"].tolist(), found["modes.element"].tolist()
    degree = np.append(np.diff(found["time"]) > 0, False)[: found["time"].size].astype(np.int8)
    places = np.repeat(np.arange(degree.size), degree + 1)
    places[1:] += places[1:] == places[:-1]  # the second point of a step is the next record
    turning = [name for name in names if name.endswith(".speed")]
    sticking = [name for name, word in zip(elements, found["modes.word"].tolist(), strict=True) if word == "stick"]
    mode = [found[f"{name}.mode"] for name in dict.fromkeys(elements)]
    steps = {
        "step.time": found["time"],
        "step.mode": np.stack(mode, 1) if mode else np.empty((degree.size, 0), np.int8),
        "step.degree": degree,
    }
    steps |= {f"step.{name}": found[name][places] for name in names}
    steps |= {"contacts": np.array(sticking, np.str_), "main": np.array((turning or names)[:4], np.str_)}
    steps |= {
        "limit.names": np.empty(0, np.str_),
        "limit.values": np.empty((0, 2)),
        "error": np.array(np.nan),
        "accuracy": np.array(np.nan),
    }
    return found | steps | {"report": np.array(["saved by an older version: straight lines between its records"])}


def _check(found: dict[str, np.ndarray]) -> None:
    """Raise ValueError or KeyError where the arrays of a file do not fit to one another."""
    text = ("U", "rows")
    for table in (
        "unit.names unit.values",
        "modes.element modes.word",
        "event.element event.before event.after",
        "contacts",
        "main",
        "report",
    ):
        check_shapes(found, dict.fromkeys(table.split(), text))
    elements, degree = list(dict.fromkeys(found["modes.element"].tolist())), found["step.degree"]
    check_shapes(found, {"step.degree": ("i", "nodes")})
    lengths = {"elements": len(elements), "points": int(degree.astype(int).sum() + degree.size), "events": len(found["event.element"])}
    shapes: dict[str, Shape] = {
        "time": ("f", "records"), "end": ("f",), "error": ("f",), "accuracy": ("f",), "event.time": ("f", "events"), "modes.last": ("U", "elements"),
        "modes.number": ("iu", len(found["modes.word"])), "step.time": ("f", "nodes"), "step.degree": ("i", "nodes"), "step.mode": ("i", "nodes", "elements"),
        "limit.values": ("f", len(found["limit.names"]), 2),
    }  # fmt: skip
    for name in found["unit.names"].tolist():
        width = found[name].shape[1:]
        often = "nodes" if found[f"step.{name}"].shape[:1] == degree.shape else "points"
        shapes |= {name: ("f", "records", *width), f"step.{name}": ("f", often, *width)}
    shapes |= {f"{name}.mode": ("i", "records") for name in elements}
    shapes |= {f"approach.{name}": ("f", f"impacts of {name}") for name in elements if f"approach.{name}" in found}
    check_shapes(found, shapes, lengths)
    begin = np.ravel(found.get("begin", 0.0))
    rows = [np.concatenate([begin, found[name], found["end"][None]]) for name in ("time", "step.time")]
    if begin.size != 1 or not all((np.diff(each) >= 0).all() and np.isfinite(each).all() for each in rows):
        raise ValueError("its times do not rise")
    if not set(degree.tolist()) <= {0, *DEGREES} or (degree.size == 0) != (found["time"].size == 0):
        raise ValueError("its steps do not fit to one another")
    known = set(zip(found["modes.element"].tolist(), found["modes.number"].tolist(), strict=True))
    for k, name in enumerate(elements):
        if not {(name, mode) for mode in {*found[f"{name}.mode"].tolist(), *found["step.mode"][:, k].tolist()}} <= known:
            raise ValueError(f"its `{name}.mode` has a mode without a word")
    named = {*found["contacts"].tolist(), *found["event.element"].tolist()} - set(elements)
    if named or not set(found["main"].tolist()) <= set(found["unit.names"].tolist()):
        raise ValueError("it names elements or signals that it does not have")


class SavedSteps:
    """The steps of a saved run: `time` and `mode` of the nodes that begin them, and a polynomial of each signal in each.

    `words` holds {element: {mode: its word}}, and `signals` {name: values at the points of all steps in order, or one value per step}.
    """

    def __init__(
        self, time: np.ndarray, mode: np.ndarray, degree: np.ndarray, words: dict[str, dict[int, str]], signals: dict[str, np.ndarray]
    ):
        self.time = time
        self.mode = mode.reshape(time.size, len(words))
        self.words = words
        self._degree = degree.astype(int)
        self._first = np.cumsum(self._degree + 1) - (self._degree + 1)
        self._signals = signals
        count = int((self._degree + 1).sum())
        if self._degree.shape != time.shape or any(len(each) not in (count, time.size) for each in signals.values()):
            raise ValueError("its steps do not fit to one another")

    def interpolated(self, row: np.ndarray, times: np.ndarray, single: bool = False) -> SavedSamples[Any]:
        """Return the signals at times within the steps that begin at the nodes `row`. At the end of a step, the values before any switch
        are returned."""
        return SavedSamples(self, row, times, single)

    def at(self, times: np.ndarray) -> SavedSamples[FloatArray]:
        """Signals at any times within the run; right-hand limits at events."""
        return self.interpolated(np.maximum(np.searchsorted(self.time, times, side="right") - 1, 0), times)

    def values(self, name: str, row: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Values of a signal at times within the steps that begin at the nodes `row`."""
        if name not in self._signals:
            head, _, tail = name.rpartition(".")
            whole = self.values(head, row, times) if head in self._signals else np.empty((0, 0))
            if whole.ndim != 2 or not tail.isdigit() or int(tail) >= whole.shape[1]:
                raise SceneError(f"There is no signal `{name}`: {suggest(name, self._signals)}")
            return whole[:, int(tail)]
        points = self._signals[name]
        if len(points) == self.time.size:
            return points[row]
        found = np.empty((row.size, *points.shape[1:]))
        length = self.time[np.minimum(row + 1, self.time.size - 1)] - self.time[row]
        place = (times - self.time[row]) / np.where(length > 0, length, 1.0)
        place[times == self.time[row] + length] = 1.0
        degrees = self._degree[row]
        for degree in np.unique(degrees):
            chosen = np.flatnonzero(degrees == degree)
            index = self._first[row[chosen]][:, None] + np.arange(degree + 1)
            found[chosen] = interpolated(points[index], place[chosen])
        return found


class SavedRun(Recorded):
    """A run as `Trajectory.save` wrote it: it is read, plotted, measured, compared and tabled like the run itself.

    A file holds no plant, so that what simulates again, or needs the equations, raises SceneError; `pickle.dumps(run)` keeps a run whole.

    Attributes
    ----------
    time
        The recorded times [s], shape (nt,).
    end
        Time reached [s].
    names
        Names of all signals.
    every_step
        The steps of the run.
    contacts, main_signals
        Names of the elements with friction, and of the signals that a plot shows.
    signal_limits
        {signal: (lowest, highest)} that the drive and the laws keep signals within.
    display_units
        {unit: unit that was typed}: the units in which reports and figures of the run answer.
    accuracy
        Accuracy of the run; nan where an older version saved it, between whose records there are straight lines.
    """

    if TYPE_CHECKING:

        @overload
        def at(self, time: float | str) -> SavedSamples[float | Any]: ...  # type: ignore[overload-overlap]
        @overload
        def at(self, time: Sequence[float | str] | FloatArray) -> SavedSamples[FloatArray]: ...
        def at(self, time: Any) -> Any: ...

    def __init__(self, path: Path, arrays: dict[str, np.ndarray]):
        self.path = path
        self.time = arrays["time"]
        self.begin = float(arrays.get("begin", 0.0))
        self.end = float(arrays["end"])
        self._units = dict(zip(arrays["unit.names"].tolist(), arrays["unit.values"].tolist(), strict=True))
        self._signals = {name: arrays[name] for name in self._units}
        self._words: dict[str, dict[int, str]] = {}
        for name, mode, word in zip(*(arrays[f"modes.{each}"].tolist() for each in ("element", "number", "word")), strict=True):
            self._words.setdefault(name, {})[mode] = word
        self._last = dict(zip(self._words, arrays["modes.last"].tolist(), strict=True))
        self.modes: dict[str, np.ndarray] = Modes(
            {name: np.array([words[mode] for mode in arrays[f"{name}.mode"].tolist()], np.str_) for name, words in self._words.items()}
        )
        self.events = [Event(*row) for row in zip(*(arrays[f"event.{field}"].tolist() for field in Event._fields), strict=True)]
        polynomials = {name: arrays[f"step.{name}"] for name in self._units}
        steps = SavedSteps(arrays["step.time"], arrays["step.mode"], arrays["step.degree"], self._words, polynomials)
        self.every_step = self.restart_nodes = steps  # type: ignore[misc]
        self.contacts: list[str] = arrays["contacts"].tolist()
        self.main_signals: list[str] = arrays["main"].tolist()
        self.signal_limits: dict[str, tuple[float | None, float | None]] = {
            name: (None if np.isnan(low) else low, None if np.isnan(high) else high)
            for name, (low, high) in zip(arrays["limit.names"].tolist(), arrays["limit.values"].tolist(), strict=True)
        }
        asked = (arrays[f"asked.{word}"].tolist() if f"asked.{word}" in arrays else [] for word in ("units", "typed"))
        self.display_units: dict[str, str] = dict(zip(*asked, strict=True))
        self.accuracy = float(arrays["accuracy"])
        self._report: list[str] = arrays["report"].tolist()
        self._error = float(arrays["error"])
        self._approach = {name: arrays[f"approach.{name}"] for name in self._words if f"approach.{name}" in arrays}

    @staticmethod
    def read(path: Path) -> SavedRun:
        """Return the run in a file. SceneError is raised if the file contains no run."""
        what = "a run written by `Trajectory.save`"
        with understood(path, what):
            found = _completed(arrays(path, what))
            _check(found)
            return SavedRun(path, found)

    @property
    def names(self) -> list[str]:
        """Names of all signals."""
        return list(self._signals)

    def __contains__(self, name: object) -> bool:
        return name in self._signals

    def __iter__(self) -> Any:
        return iter(self._signals)

    def __getitem__(self, name: str) -> FloatArray:
        if name in self._signals:
            return self._signals[name]
        self.unit(name)
        head, _, tail = name.rpartition(".")
        return self._signals[head][:, int(tail)]

    def columns(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """{signal: its values at the recorded times}; raises SceneError for an unknown name."""
        return {name: self[name] for name in names}

    def unit(self, name: str) -> str:
        """Unit of a signal, or of one entry of a vector (`chain.speed.0`); raises SceneError for an unknown name."""
        if name in self._units:
            return self._units[name]
        head, _, tail = str(name).rpartition(".")
        vector = self._signals.get(head)
        if vector is None or vector.ndim != 2 or not tail.isdigit() or int(tail) >= vector.shape[1]:
            raise SceneError(f"There is no signal `{name}`: {suggest(str(name), self._units)}")
        return self._units[head]

    def impact_speeds(self, element: str) -> FloatArray:
        """Speeds of approach at the impacts of a unilateral contact, in the order of its events [m/s]; raises SceneError for any other element."""
        if element not in self._approach:
            raise SceneError(f"There is no unilateral contact `{element}`: {suggest(element, self._approach)}")
        return self._approach[element]

    @property
    def _legends(self) -> dict[str, dict[int, str]]:
        return self._words

    def _at_last(self, element: str) -> str:
        return self._last[element]

    @property
    def error_estimate(self) -> float:
        """`run.error_estimate` at the time of saving. SceneError is raised if it had not been computed, because a second run is needed for
        it."""
        if np.isnan(self._error):
            raise SceneError(
                f"The run read from `{self.path}` does not say its error: `error_estimate` needs the plant; ask it before `save`, or `pickle` the run."
            )
        return self._error

    @property
    def last(self) -> Any:
        """Raise SceneError: a file does not contain the state that continues a run. `pickle.dumps(run.last)` saves this state."""
        raise SceneError(
            f"The run read from `{self.path}` cannot be carried on: `last` needs the plant; `pickle` the `run.last` of the run itself."
        )

    @property
    def _headlines(self) -> list[str]:
        return [*self._report, f"read from {self.path}"]

    def __repr__(self) -> str:
        return f"SavedRun({str(self.path)!r}: {self.time.size} times to {self.end:g} s, {len(self.events)} events)"
