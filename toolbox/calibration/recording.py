"""Measured signals under the names and in the units of a plant, read from logs as they come, with everything told that is wrong with them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from toolbox.arguments import mapping, number
from toolbox.calibration.channels import chosen, numbers_of, scalar_unit, size_of, source_of, times_of
from toolbox.errors import SceneError, suggest
from toolbox.files.printing import columns as lines_of
from toolbox.files.results import HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.units import NumberOrText
from toolbox.logs.flaws import KINDS, NULLS, Flaw, below_zero, increasing, is_null, local_spacing, marked, spacing, without_strays
from toolbox.logs.grids import Source
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import names as names_of

JUMP, LEAST_JUMP = 10.0, 0.02
"""Change from one sample to the next, at least, that is a jump: as a multiple of the usual change, and as a fraction of the range."""

BESIDE = 0.3
"""Change before and after a jump, at most, as a fraction of the jump."""


def jumps(values: np.ndarray) -> np.ndarray:
    """Return for each sample but the last whether a channel, which else changes little from sample to sample, jumps before the next one, shape (n - 1,)."""
    changes = np.abs(np.diff(values))
    neighbours = np.maximum(np.append(changes[1:], 0.0), np.insert(changes[:-1], 0, 0.0))
    far = changes > np.maximum(JUMP * np.median(changes), LEAST_JUMP * np.ptp(values))
    there: np.ndarray = far & (neighbours < BESIDE * changes)
    return there


@dataclass(frozen=True)
class Recording(Result):
    """Signals of a machine at measured times.

    `print(recording)` lists flaws, `recording.plot()` draws the signals, and `recording.save("log.npz")` writes them.

    Attributes
    ----------
    time
        Increasing times [s] from 0, shape (nt,).
    signals
        {name of the signal in the plant: values in the SI unit of the signal, shape (nt,)}. nan for samples that are no
        valid data.
    source
        Origin of the signals.
    units
        {name: unit}.
    flaws
        Flaws that were found and left out.
    notes
        Description of how the log was read.
    begin
        If this is a part of a recording: the time [s] in the whole recording at which the part begins. Otherwise 0.
    held
        Inputs that keep the value of a sample until the next one (zero-order hold), such as the commands of a digital
        drive. All other signals are interpolated linearly. None: not declared, so that `fit` estimates which inputs are
        held.
    stepped
        Inputs that jump at the sample behind a jump, and are straight lines between all other samples.
    display_units
        {SI unit: unit of the log}, for results in the units of the log.

    Examples
    --------
    >>> import numpy as np
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.calibration import Recording
    >>> time = np.linspace(0.0, 20.0, 401)
    >>> log = Recording.of({"time": time, "top.speed": 6.0 + np.sin(time)}, compose(wells.JANSEN_2, BitRock()))
    >>> print(log.time.size, "samples every", round(log.interval, 3), "s")
    401 samples every 0.05 s
    """

    time: np.ndarray
    signals: Mapping[str, np.ndarray]
    source: str
    units: Mapping[str, str] = field(default_factory=dict)
    flaws: tuple[Flaw, ...] = ()
    notes: tuple[str, ...] = ()
    begin: float = 0.0
    held: tuple[str, ...] | None = None
    stepped: tuple[str, ...] = ()
    display_units: Mapping[str, str] = field(default_factory=dict)

    def _table(self) -> HeadedRows:
        """One row per sample, with the units in the headings, as `of` reads it."""
        heads = [heading("time", "s"), *(heading(name, self.units.get(name, "1")) for name in self.signals)]
        return heads, np.column_stack([self.time, *self.signals.values()]).tolist()

    def check_loaded(self) -> None:
        """Raise ValueError if the loaded arrays do not fit together."""
        if any(values.shape != self.time.shape for values in self.signals.values()):
            raise ValueError("its signals do not have as many samples as its times")

    @staticmethod
    def of(
        data: Any,
        plant: HybridSystem,
        columns: Mapping[str, str] | None = None,
        *,
        nulls: Sequence[float] = (),
        accepted_flaws: Sequence[str] = (),
        decimal: str | None = None,
        zero_order_hold: str | Sequence[str] | None = None,
    ) -> Recording:
        """Read a recording from a file, a table of pandas, a mapping {name: values} or a run.

        Formats:

        - Text, separated by commas, semicolons, tabulators or spaces, is read in any form: decimal commas, thousands
          separators, lines above the headings, units in brackets or in their own line, dates and epochs.
        - WITSML logs, TOML tables and MAT files.
        - With the extra `data` also spreadsheets (xlsx), parquet, LAS and MAT 7.3.

        Times are shifted to begin at 0. Samples that are no data are marked and reported, and never interpolated.

        Parameters
        ----------
        data
            Path of the file, the table, the mapping, or the run.
        plant
            The plant to which the signals belong.
        columns
            {signal of the plant, or "time": name in the data}. By default the data use the names of the plant. Columns
            that the mapping does not name are not read.

            If the data give no unit, add it: {"bit.speed": "rpm_bit [rpm]"}. Add a format of dates in the same way:
            {"time": "Time [DD/MM/YYYY]"}, {"time": "Time [HHMMSS]"}. In a MAT file, a mapping, a table of pandas or a
            run, numbers without a unit are SI.
        nulls
            Further numbers that mean "no value", in the unit of the log, by default none.
        accepted_flaws
            Kinds of flaws that are valid data in this recording, such as "clipped" for a drive at its limit, by default
            none. The kinds are null, clipped, drop-out, reversed, outlier.
        decimal
            Decimal separator "," or ".", if the log is ambiguous. By default the numbers of the log decide.
        zero_order_hold
            Inputs that keep the value of a sample until the next one, such as the commands of a digital drive; () for
            none. By default `fit` estimates which inputs are held.

        Returns
        -------
        Recording
            The recording.

        Raises
        ------
        SceneError
            If the file cannot be read, a column is unknown or missing, a unit is missing or does not fit, or there are
            fewer than three samples.
        ImportError
            If the library of a format is missing; the message names the extra.
        """
        if isinstance(data, Recording):
            return data
        columns = None if columns is None else mapping("columns", columns)
        if not all(isinstance(label, str) for label in (columns or {}).values()):
            raise SceneError(f"Argument `columns` must name the column of every signal, but it is {columns!r}.")
        for name in columns or {}:
            if name != "time":
                scalar_unit(plant, name)
        if unknown := [kind for kind in accepted_flaws if kind not in KINDS]:
            raise SceneError(f"Argument `accepted_flaws` must hold kinds of flaws, but it has `{unknown[0]}`: {suggest(unknown[0], KINDS)}")
        if decimal not in (None, ",", "."):
            raise SceneError(f'Argument `decimal` must be "," or ".", but it is {decimal!r}.')
        read = read_channels(source_of(data, plant, columns, decimal), plant, columns, tuple(map(float, nulls)), accepted_flaws)
        return read if zero_order_hold is None else read.holding(zero_order_hold)

    def holding(self, inputs: str | Sequence[str]) -> Recording:
        """Return the recording with these inputs, and no others, held between samples (zero-order hold).

        Raises SceneError for a channel that is not there.

        Parameters
        ----------
        inputs
            Names of the inputs that are held; () for none.
        """
        return replace(self, held=tuple(self._known(name) for name in names_of(inputs)))

    def stepping(self, inputs: Sequence[str]) -> Recording:
        """Return the recording with jumps of these inputs at the sample behind them, and straight lines between all other samples.

        Parameters
        ----------
        inputs
            Names of the inputs that jump.
        """
        return replace(self, held=(), stepped=tuple(inputs))

    def between(self, begin: NumberOrText, end: NumberOrText) -> Recording:
        """Return the samples between two times [s]. The time of the result begins at 0.

        Parameters
        ----------
        begin
            First time [s], or text with a unit.
        end
            Last time [s], or text with a unit.
        """
        begin, end = number("begin", begin, "s"), number("end", end, "s")
        inside = (self.time >= begin) & (self.time <= end)
        if inside.sum() < 3:
            raise SceneError(f"The window {begin:g} .. {end:g} s must hold at least three samples, but it holds {inside.sum()}.")
        first = self.time[inside][0]
        flaws = []
        for flaw in self.flaws:
            there = (flaw.times >= begin) & (flaw.times <= end)
            if there.any():
                flaws.append(Flaw(flaw.channel, flaw.kind, flaw.times[there] - first, flaw.values[there]))
        signals = {name: values[inside] for name, values in self.signals.items()}
        return replace(self, time=self.time[inside] - first, signals=signals, flaws=tuple(flaws), begin=self.begin + float(first))

    def windows(self, names: Sequence[str] | None = None, max_gap: int = 2) -> list[tuple[float, float]]:
        """Return the time ranges (begin, end) [s] in which the named signals have no gap.

        Parameters
        ----------
        names
            The signals. By default all.
        max_gap
            Number of consecutive samples that may be missing, by default 2.
        """
        usual, longest = local_spacing(self.time)
        good = np.all([np.isfinite(self.signals[self._known(name)]) for name in (self.signals if names is None else names)], axis=0)
        places = np.flatnonzero(good)
        at = places[:-1]
        apart = np.flatnonzero(np.diff(self.time[places]) > np.maximum((max_gap + 1.5) * usual[at], longest[at]))
        edges = [0, *(apart + 1).tolist(), places.size]
        return [(float(self.time[places[a]]), float(self.time[places[b - 1]])) for a, b in itertools.pairwise(edges) if b - a >= 3]

    def driving(self, plant: HybridSystem, max_gap: int | None = None) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Return the measured inputs of a plant, as {input: (times, values)} without flawed samples. A held input jumps at each sample.

        Parameters
        ----------
        plant
            The plant.
        max_gap
            Largest number of consecutive samples that may be missing, by default 2.

        Raises
        ------
        SceneError
            If more consecutive samples are missing. The message names the windows without such a gap.
        """
        measured = [name for name in self.signals if name in plant.inputs]
        if not measured:
            return {}
        words = f"what drives the machine, {' and '.join(f'`{name}`' for name in measured)},"
        remedy = "" if max_gap is None else f", or say by `hole` that more than {max_gap} samples in a row may be missing"
        self.unbroken(measured, words, 2 if max_gap is None else max_gap, remedy)
        good = {name: np.isfinite(self.signals[name]) for name in measured}
        tables = {name: (self.time[good[name]], self.signals[name][good[name]]) for name in measured}
        for name, (t, v) in tables.items():
            if name in (self.held or ()):
                tables[name] = np.repeat(t, 2)[1:], np.repeat(v, 2)[:-1]
            elif name in self.stepped:
                before = np.flatnonzero(jumps(v))
                tables[name] = np.insert(t, before + 1, t[before + 1]), np.insert(v, before + 1, v[before])
        return tables

    def unbroken(self, names: Sequence[str], what: str, max_gap: int = 2, remedy: str = "") -> None:
        """Raise SceneError if the named signals have a gap of more than `max_gap` samples.

        The message names the windows without a gap, in times of the whole recording. `what` is the description of the
        signals in the message, and `remedy` an advice at its end.

        Parameters
        ----------
        names
            Names of the signals.
        what
            Description of the signals in the message.
        max_gap
            Largest allowed gap in samples, by default 2.
        remedy
            Advice at the end of the message, by default empty.
        """
        stretches = self.windows(names, max_gap)
        if len(stretches) != 1:
            found = ", ".join(f"{self.begin + begin:.6g} .. {self.begin + end:.6g} s" for begin, end in stretches[:8])
            lost = ", ".join(f"{self._told(name)} of `{name}`" for name in names if self._told(name))
            kept = f" Left out were {lost}: {self._remedy(names)}." if lost and self._remedy(names) else ""
            raise SceneError(
                f"The data must hold {what} without gaps, but it is there in {len(stretches)} stretches: choose among the windows {found}{remedy}.{kept}"
            )

    @property
    def interval(self) -> float:
        """Typical time between samples [s]."""
        return spacing(self.time)[0]

    @property
    def gap(self) -> float:
        """Time between neighbouring samples that counts as a gap [s], computed from the time between samples of the whole recording."""
        return spacing(self.time)[1]

    @property
    def gaps(self) -> np.ndarray:
        """For each sample but the last: whether there is a gap between this sample and the next, judged by the sampling
        rate around it. Shape (nt - 1,).
        """
        return np.diff(self.time) > local_spacing(self.time)[1]

    def resampled(self, interval: NumberOrText) -> Recording:
        """Return the recording at equidistant times.

        If the samples are denser than the new times, each value is the mean of the samples around the new time.
        Otherwise it is interpolated linearly between the neighbouring samples. Inside gaps it is nan.

        Parameters
        ----------
        interval
            Time between samples [s].
        """
        interval = number("interval", interval, "s", above=0)
        times = np.arange(0.0, self.time[-1] + 0.5 * interval, interval)
        dense = interval > 1.5 * self.interval
        signals = {}
        for name, values in self.signals.items():
            good = np.isfinite(values)
            if dense:
                place = np.rint(self.time[good] / interval).astype(int)
                inside = place < times.size
                count = np.bincount(place[inside], minlength=times.size)
                total = np.bincount(place[inside], values[good][inside], minlength=times.size)
                signals[name] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
            else:
                signals[name] = _at(times, self.time, values)
        return replace(self, time=times, signals=signals, notes=(*self.notes, f"resampled every {interval:g} s"))

    def shift(self, name: str, against: str, max_lag: NumberOrText = 5.0) -> float:
        """Return the delay of one channel relative to another [s].

        The delay is the shift with the highest correlation of the changes of both channels, interpolated between
        samples by a parabola. If both channels measure the same quantity, the delay is the difference of their clocks.
        If one channel measures the cause of the other, the delay also contains the delay of the machine.

        Parameters
        ----------
        name, against
            The channels.
        max_lag
            Largest shift [s], by default 5.

        Raises
        ------
        SceneError
            If the channels have too few changes in common.
        """
        max_lag = number("max_lag", max_lag, "s", above=0)
        step = self.interval
        times = np.arange(0.0, self.time[-1], step)
        one, two = (_at(times, self.time, self.signals[self._known(each)]) for each in (name, against))
        one, two = np.diff(one), np.diff(two)
        lags = np.arange(-int(max_lag / step), int(max_lag / step) + 1)
        found = []
        for lag in lags.tolist():
            a, b = (one[lag:], two[: one.size - lag]) if lag >= 0 else (one[:lag], two[-lag:])
            both = np.isfinite(a) & np.isfinite(b)
            deviation = a[both].std() * b[both].std() if both.sum() > 10 else 0.0
            found.append(np.mean((a[both] - a[both].mean()) * (b[both] - b[both].mean())) / deviation if deviation else 0.0)
        strength = np.abs(found)
        best = int(np.argmax(strength))
        if strength[best] < 0.2 or best in (0, lags.size - 1):
            raise SceneError(
                f"The channels `{name}` and `{against}` must change together to tell their shift, but their changes correlate by {strength[best]:.2f} "
                f"at most within {max_lag:g} s: name channels that follow the same thing."
            )
        left, top, right = strength[best - 1 : best + 2]
        bend = left - 2.0 * top + right
        return float(step * (lags[best] + (0.5 * (left - right) / bend if bend else 0.0)))

    def shifted(self, shifts: Mapping[str, NumberOrText]) -> Recording:
        """Return the recording with some channels moved to earlier times by their shifts, {channel: shift [s]}.

        The times of the recording stay the same. A value is nan if its channel has no measurement at the shifted time.

        Parameters
        ----------
        shifts
            {channel: shift [s], or text with a unit}.
        """
        signals = dict(self.signals)
        for name, value in shifts.items():
            seconds = number(f"shifts.{name}", value, "s")
            signals[self._known(name)] = _at(self.time, self.time - seconds, self.signals[name])
        words = ", ".join(f"{name} by {number(name, value, 's'):g} s" for name, value in shifts.items())
        return replace(self, signals=signals, notes=(*self.notes, f"moved earlier: {words}"))

    def _known(self, name: str) -> str:
        if name not in self.signals:
            raise SceneError(f"There is no channel `{name}`: {suggest(name, self.signals)}")
        return name

    def __str__(self) -> str:
        usual = self.interval
        lines = [
            f"Recording of {self.source}: {self.time.size} samples over {self.time[-1]:.6g} s, usually every {usual:.4g} s ({1 / usual:.4g} Hz)"
        ]
        lines += [f"  {note}" for note in self.notes]
        rows: list[list[str]] = [["channel", "unit", "samples", "lowest", "highest", "left out"]]
        for name, values in self.signals.items():
            good = values[np.isfinite(values)]
            ends = [f"{good.min():.5g}", f"{good.max():.5g}"] if good.size else ["-", "-"]
            rows.append([name, self.units.get(name, ""), f"{good.size}", *ends, self._told(name) or "none"])
        lines += lines_of(rows, left=(0, 1, 5))
        told = self._told("time")
        lines.append(f"  time: {told}" if told else "  time: increases, no gaps")
        return "\n".join(lines + ([f"  {self._remedy()}"] if self._remedy() else []))

    __repr__ = __str__

    def _remedy(self, channels: Sequence[str] | None = None) -> str:
        """How samples that were left out of channels, by default of all, are kept where they are data; empty if none were that can be kept."""
        kinds = {flaw.kind for flaw in self.flaws if flaw.channel != "time" and flaw.channel in (channels or self.signals)}
        asked = [kind for kind in KINDS if kind in kinds]
        if not asked:
            return ""
        options = " ".join(f"--accept-flaw {kind}" for kind in asked)
        return f"samples that were left out are kept, where they are data, by {options} (in Python Recording.of(..., accepted_flaws={asked!r}))"

    def _told(self, channel: str) -> str:
        words = []
        for flaw in self.flaws:
            if flaw.channel == channel:
                lasting = f" of {flaw.values.min():.4g} to {flaw.values.max():.4g} s" if flaw.kind == "gap" else ""
                words.append(f"{flaw.count} {flaw.kind}{lasting} (first at {flaw.times[0]:.4g} s)")
        return ", ".join(words)

    def found(self, channel: str) -> dict[str, int]:
        """Return {kind of flaw: number of samples} of a channel, or of "time".

        Parameters
        ----------
        channel
            Name of the channel, or "time".
        """
        return {flaw.kind: flaw.count for flaw in self.flaws if flaw.channel == channel}

    def plot(self) -> Any:
        """Draw every channel over time, with the samples that were left out. Returns the axes."""
        from toolbox.calibration.figures import recorded  # here, because matplotlib is slow to import

        return recorded(self)


def _at(times: np.ndarray, own: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values on the line between neighbours, nan where they are farther apart than a gap, and outside."""
    good = np.isfinite(values)
    if good.sum() < 2:
        return np.full(times.size, np.nan)
    t, v = own[good], values[good]
    found = np.interp(times, t, v, left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(t, times), 1, t.size - 1)
    exact = np.isclose(t[after], times, rtol=0, atol=1e-9) | np.isclose(t[after - 1], times, rtol=0, atol=1e-9)
    longest = local_spacing(own)[1][np.flatnonzero(good)[after - 1]]
    return np.where((t[after] - t[after - 1] <= longest) | exact, found, np.nan)


def read_channels(
    data: tuple[Source, str, str], plant: HybridSystem, columns: Mapping[str, str] | None, nulls: tuple[float, ...], keep: Sequence[str]
) -> Recording:
    """Return the recording of columns that were read: (columns, what errors call them, what the recording calls them)."""
    source, where, name = data
    kinds = () if source.what == "run" else tuple(k for k in KINDS if k not in keep)
    columns_of = chosen(source, where, plant, columns)
    time_column, time_unit = columns_of.pop("time")
    size = int(np.size(time_column.cells))
    time, notes = times_of(source, time_column, time_unit, where)
    if not columns_of:
        raise SceneError(f"The data of {name} must hold a signal beside the time, but there is none.")
    if size < 3:
        raise SceneError(f"The data of {name} must hold at least three samples, but they hold {size}.")
    nulls = (*nulls, *source.nulls)
    turned = _newest_first(time)
    if turned:
        time = time[::-1]
        notes.append("the newest row stands first: turned")
    order = increasing(time)
    if order.size < 3 or order.size < 0.5 * np.isfinite(time).sum():
        raise SceneError(
            f"The times of {name} must increase, but only {order.size} of {time.size} do: where several samples have one time, write times with more digits; "
            "where dates and times of day stand in two columns, say which column is `time` by the one of times of day."
        )
    increases, order = order, without_strays(time, order)
    flaws = _time_flaws(time, order, np.setdiff1d(increases, order))
    own = time[order] - time[order[0]]
    signals, units, typed = {}, {}, {}
    for signal, (column, unit) in columns_of.items():
        wanted = scalar_unit(plant, signal)
        here = f"{where}, column `{column.name}`,"
        if np.size(column.cells) != size:
            raise SceneError(
                f"{where} must have columns of one length, but `{column.name}` has {np.size(column.cells)} samples and the time {size}."
            )
        raw, said = numbers_of(column.cells, source.mark, here)
        if said:
            notes.append(f"`{column.name}`: {said}")
        raw = raw[::-1] if turned else raw
        none = is_null(raw, (*nulls, *column.nulls), () if "null" in keep else NULLS)
        if unit is None and not source.bare and wanted != "1":
            raise SceneError(
                f"{here} must name its unit, such as `{column.name} [{wanted}]`: write so there, or where you say which column is `{signal}`."
            )
        scale = 1.0 if unit is None or (unit == "1" and wanted == "1") else size_of(unit, wanted, column.name, signal, here)
        if unit is not None and unit != wanted:
            typed[wanted] = unit
        values = (np.where(none, np.nan, raw) * scale)[order]
        if np.isfinite(values).sum() < 3:
            raise SceneError(f"{here} must hold at least three values, but {int(none.sum())} of {size} samples are none.")
        flaws += _flaws_of(signal, own, values, np.where(none, raw, np.nan)[order], none[order], kinds)
        entry = plant.parameters.get(signal)
        if signal in plant.inputs and entry is not None and entry.bounds.get("at_least") == 0 and source.what != "run":
            low, words = below_zero(values, signal, own, wanted)
            flaws += low
            notes += words
        signals[signal], units[signal] = values, wanted
    if source.what == "run":
        flaws = [flaw for flaw in flaws if flaw.kind != "gap"]
    return Recording(own, signals, name, units, tuple(flaws), tuple(source.notes + notes), display_units=typed)


def _newest_first(time: np.ndarray) -> bool:
    """Whether nearly all times go down from row to row."""
    steps = np.diff(time[np.isfinite(time)])
    return bool(np.count_nonzero(steps < 0) > 0.9 * np.count_nonzero(steps) > 1.8)


def _time_flaws(time: np.ndarray, order: np.ndarray, stray: np.ndarray) -> list[Flaw]:
    flaws = []
    kept = time[order]
    begin = kept[0]
    good = np.isfinite(time)
    none = np.flatnonzero(~good)
    good[order] = good[stray] = False
    lost = np.flatnonzero(good)
    again = np.isin(time[lost], kept) if lost.size else np.zeros(0, bool)
    for kind, places in (("stray", stray), ("repeated", lost[again]), ("backward", lost[~again])):
        if places.size:
            flaws.append(Flaw("time", kind, time[places] - begin, time[places] - begin))
    if none.size:
        beside = kept[np.clip(np.searchsorted(order, none), 0, order.size - 1)]
        flaws.append(Flaw("time", "null", beside - begin, np.full(none.size, np.nan)))
    steps = np.diff(kept)
    apart = np.flatnonzero(steps > local_spacing(kept)[1])
    if apart.size:
        flaws.append(Flaw("time", "gap", kept[apart] - begin, steps[apart]))
    return flaws


def _flaws_of(signal: str, time: np.ndarray, values: np.ndarray, raw: np.ndarray, none: np.ndarray, kinds: tuple[str, ...]) -> list[Flaw]:
    """The flaws of a channel, whose values become nan there."""
    flaws = [Flaw(signal, "null", time[none], raw[none])] if none.any() else []
    for kind, places in marked(values, kinds).items():
        flaws.append(Flaw(signal, kind, time[places], values[places].copy()))
        values[places] = np.nan
    return flaws
