"""The law of one contact against measured force at measured slip, sample by sample: in stick friction is whatever the machine asks for and says nothing,
except at its end, where the force at break-away is the static bound."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.calibration.break_away import RISE, SLIPS, break_away
from toolbox.calibration.columnwise import Columnwise
from toolbox.calibration.loop_law import LoopLaw, jumps
from toolbox.calibration.misfit import ContactMisfit
from toolbox.calibration.panels import Panel
from toolbox.calibration.recording import Recording
from toolbox.calibration.shifts import Shift, moved
from toolbox.errors import SceneError, suggest
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.numbers import Number
from toolbox.modelling.start import place_start
from toolbox.modelling.two_directions import check_one_direction

TRIAL = 500
"""Samples of a loop, about, with which the searches from different starts are done."""


class MeasuredLoop(ContactMisfit):
    """The friction law of one contact against measured force at measured slip.

    output: the measured signal that holds the force;  slip: at every sample;  still: slip speed up to which the contact counts as at rest;  rows: indices of
    the samples that count;  released: True for those of them at break-away.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        recording: Recording,
        numbers: Sequence[Number],
        contact: str,
        still: float | None,
        shifts: Sequence[Shift] = (),
        begin: np.ndarray | None = None,
    ):
        plant, inputs, names = loop.assembly.plant, loop.input_values, [number.name for number in numbers]
        elements = [element.name for element in plant.elements]
        if contact not in elements or plant.elements[elements.index(contact)].law is None:
            raise SceneError(f"There is no contact with dry friction `{contact}`: {suggest(contact, elements)}")
        check_one_direction(plant.elements, "Measured friction", "fit the motion instead")
        self.plant, self.recording, self.names, self.place = plant, recording, names, elements.index(contact)
        self.loop, self.numbers, self.contact, self.shifts = loop, numbers, contact, tuple(shifts)
        self.given_still = still
        element: Any = plant.elements[self.place]
        self.output = self._force_signal(recording, plant.F[self.place])
        self._measured = recording
        if begin is not None:  # the samples that count are those that slip on the clock of the force
            self.recording = recording = dataclasses.replace(recording, signals=moved(recording, shifts, begin, self.output))
        self._driven = [name for name in plant.inputs if name in recording.signals]
        parameters = [number.name for number in numbers if number.is_parameter]
        law = self._law = LoopLaw.of(plant, self.place, self.output, inputs, self._driven, parameters)
        self._complain_about_missing(law)
        self._switches = [elements.index(twin.name) for twin in element.breaks]

        self._last: tuple[bytes, np.ndarray] = (b"", plant.values)
        self._late = np.full(len(shifts), np.nan)
        self._chosen: Any = slice(None)
        self._side = np.zeros(recording.time.size)
        known = np.all([np.isfinite(values) for values in recording.signals.values()], axis=0)
        self.slip = np.broadcast_to(self._of(law.law, plant.values)[0][0], recording.time.size)
        self.still = 0.01 * float(np.abs(self.slip[known]).max(initial=0.0)) if still is None else still
        moving = known & (np.abs(self.slip) > self.still)
        if begin is not None:
            moving &= self._slips_around(begin)
        if not moving.any():
            raise SceneError(
                f"The data must hold samples in which `{contact}` slips faster than {self.still:g} {element.slip_unit}, but there are none."
            )
        self._side = np.sign(np.where(moving, self.slip, np.append(self.slip[1:], 0.0)))
        values, deviations = recording.signals[self.output].copy(), np.full(self._side.size, np.nan)
        cut = ~known | np.insert(recording.gaps, 0, False)  # no stick phase reaches over it
        toward = np.broadcast_to(np.sign(self._of(law.law, plant.values)[3][0]), values.size)
        for k in np.flatnonzero(moving[1:] & ~moving[:-1] & ~cut[1:]) if jumps(law, plant) else []:
            first = 1 + int(np.max(np.flatnonzero((moving | ~known)[: k + 1]), initial=-1))
            first = max(first, int(np.max(np.flatnonzero(cut[: k + 1] & known[: k + 1]), initial=0)))
            if k + 1 - first >= RISE:  # a shorter one is noise where slip begins or ends
                ends = np.flatnonzero((~moving | cut)[k + 1 : k + 1 + SLIPS])
                phase = slice(first, k + 1 + (int(ends[0]) if ends.size else SLIPS))
                found = break_away(recording.time[phase], values[phase], self.slip[phase], int(k) - first, float(toward[k]))
                top = first + found.sample
                values[top], deviations[top], self._side[top] = found.force, found.deviation, self._side[k]
        away = np.isfinite(deviations)
        rows = np.flatnonzero(moving | away)
        self.rows, self.released, self._deviations = rows, away[rows], deviations[rows]
        self._forces, self._slopes = law.with_release if self.released.any() else (law.forces, law.slopes)
        self.outputs = [self.output]
        self.time, self.measured = {self.output: recording.time[rows]}, {self.output: values[rows]}

    def _slips_around(self, values: np.ndarray) -> np.ndarray:
        """Where the contact slips at both samples around the time of a force: between one at rest and one that slips the line would be taken for slip."""
        slip = np.broadcast_to(self._of(self._law.law, self.plant.values, self._laid(self._measured.signals))[0][0], self._side.size)
        slips = (np.abs(slip) > self.still) * 1.0
        time, around = self.recording.time, np.ones(slip.size, bool)
        late = {name: float(values[shift.place]) for shift in self.shifts for name in shift.channels}
        for ahead in {late.get(name, 0.0) - late.get(self.output, 0.0) for name, rows in self._states.items() if rows.size}:
            for edge in (-0.5, 0.0, 0.5):  # and where a fit may move it
                around &= np.interp(time + ahead + edge * self.recording.interval, time, slips) == 1.0
        return around

    @property
    def how(self) -> str:
        """What was fitted, in words."""
        return f"law of `{self.plant.elements[self.place].name}` against the measured loop"

    def deviations(self, output: str) -> np.ndarray:
        """Standard deviations of the forces at break-away, which no sample holds; nan of the samples in slip."""
        return self._deviations

    def panels(self, left: Mapping[str, np.ndarray], _: np.ndarray) -> tuple[Panel, ...]:
        """What was measured beside the law; left: law less measured."""
        name, element = self.output, self.plant.elements[self.place]
        measured = self.measured[name]
        rests = np.isfinite(self.slip + self.recording.signals[name])
        rests[self.rows] = False
        still = np.flatnonzero(rests)
        resting = np.stack([self.slip[still], self.recording.signals[name][still]])
        over = f"slip of {element.name} [{element.slip_unit}]"
        return (Panel(name, self.plant.unit(name), over, self.slip[self.rows], measured, measured + left[name], self.released, resting),)

    def begun(self, values: np.ndarray) -> MeasuredLoop:
        """The misfit with the samples that slip at these numbers, where its search begins."""
        numbers = [dataclasses.replace(number, value=float(value)) for number, value in zip(self.numbers, values, strict=True)]
        return MeasuredLoop(self.loop, self._measured, numbers, self.contact, self.given_still, self.shifts, values)

    def thinned(self) -> None:
        """None: a loop asks for its inputs at the samples only."""
        return

    def trial(self) -> MeasuredLoop:
        """The misfit of at most about `TRIAL` samples, all break-aways among them: enough to find what is then fitted to all."""
        if self.rows.size <= 2 * TRIAL:
            return self
        chosen = self.released.copy()
        chosen[:: self.rows.size // TRIAL] = True
        few, kept = copy.copy(self), self.rows[chosen]
        few._x, few._u, few._side, few._chosen = self._x[:, kept], self._u[:, kept], self._side[kept], kept
        few.__dict__.pop("_known", None)
        few.rows, few.released, few._deviations = np.arange(kept.size), self.released[chosen], self._deviations[chosen]
        few.time, few.measured = ({name: values[chosen] for name, values in each.items()} for each in (self.time, self.measured))
        return few

    def _complain_about_missing(self, law: LoopLaw) -> None:
        """Find the place of every measured state; raises SceneError where the law needs another."""
        self._states: dict[str, np.ndarray] = {}
        for name in self.recording.signals:
            mark = np.zeros(self.plant.x.numel())
            with contextlib.suppress(SceneError):  # a signal that is computed from states
                place_start(self.plant, mark, name, 1.0)
            self._states[name] = np.flatnonzero(mark == 1.0)
        there = {int(row) for rows in self._states.values() for row in rows}
        self._x, self._u = self._laid(self.recording.signals)
        row = next((row for row in law.needs if row not in there), None)
        if row is not None:
            raise self._missing(row)

    def _laid(self, signals: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """The states and the measured inputs at all samples."""
        size = self.recording.time.size
        x = np.zeros((self.plant.x.numel(), size))
        for name, rows in self._states.items():
            x[rows] = signals[name]
        return x, np.array([signals[name] for name in self._driven]).reshape(len(self._driven), size)

    def _of(self, function: Columnwise, p: np.ndarray, laid: tuple[np.ndarray, np.ndarray] | None = None) -> list[list[Any]]:
        """Entries of the results of a function of the law, each a number or an array of all samples; a law with breaks is beyond those that slip exceeds."""
        count = self._side.size
        m: list[Any] = [0.0] * self.plant.m.numel()
        m[self.place] = self._side
        x, u = laid or (self._x, self._u)
        given = (list(x), list(u), p.tolist(), m, [self._side])
        if self._switches:
            (slip,), *_, places = self._law.law(*given, count=count)
            for at, place in zip(self._switches, places, strict=True):
                m[at] = 1.0 * (self._side * slip >= place)
        return function(*given, count=count)

    def _counted(self, sliding: Any, release: Any = None) -> np.ndarray:
        """A quantity at the samples that count: at break-away that of release."""
        found = np.full(self.rows.size, sliding) if np.ndim(sliding) == 0 else sliding[self.rows]
        if release is not None:
            found[self.released] = release if np.ndim(release) == 0 else release[self.rows[self.released]]
        return found

    def _force_at(self, values: np.ndarray) -> np.ndarray:
        """The force of the law at the measured slip, and with the static bound at break-away."""
        self._place(values)
        found = self._of(self._forces, self._numbers(values))
        return self._counted(*(each for (each,) in found))

    def _slopes_at(self, values: np.ndarray) -> np.ndarray:
        self._place(values)
        both = self._of(self._slopes, self._numbers(values))
        found = np.empty((values.size, self.rows.size)).T  # column by column, as it is filled and used
        places = [i for i, number in enumerate(self.numbers) if number.is_parameter]
        for i, each in zip(places, zip(*both, strict=True), strict=True):
            found[:, i] = self._counted(*each)
        return found

    def _place(self, values: np.ndarray) -> None:
        """Take slip and inputs on the clock of the force."""
        late = values[[shift.place for shift in self.shifts]]
        if not self.shifts or np.array_equal(late, self._late):
            return
        signals = moved(self._measured, self.shifts, values, self.output)
        x, u = self._laid(signals)
        self._x, self._u, self._late = x[:, self._chosen], u[:, self._chosen], late
