"""A run read back from a file: what was recorded, and nothing that needs the plant."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from toolbox.errors import SceneError, suggest
from toolbox.files.archives import arrays, understood
from toolbox.simulation.samples import Event, Modes, Recorded


class SavedRun(Recorded):
    """A run as `Trajectory.save` wrote it: `saved.time`, `saved["bit.speed"]`, `saved.modes["bit"]`, `saved.events`, `saved.unit(name)`, `saved.time_in`.

    time: the recorded times, shape (nt,), s;  end: time reached [s];  names: of all signals. A file holds no plant, so that `at`, `error` and whatever else
    simulates again raise SceneError; `pickle.dumps(run)` keeps a run whole.
    """

    def __init__(self, path: Path, arrays: dict[str, np.ndarray]):
        self.path = path
        self.time = arrays["time"]
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

    @staticmethod
    def read(path: Path) -> SavedRun:
        """The run in a file; raises SceneError where there is none."""
        what = "a run written by `Trajectory.save`"
        with understood(path, what):
            return SavedRun(path, arrays(path, what))

    @property
    def names(self) -> list[str]:
        """Names of all signals."""
        return list(self._signals)

    def __contains__(self, name: object) -> bool:
        return name in self._signals

    def __iter__(self) -> Iterator[str]:
        return iter(self._signals)

    def __getitem__(self, name: str) -> np.ndarray:
        self.unit(name)
        return self._signals[name]

    def unit(self, name: str) -> str:
        """Unit of a signal; raises SceneError for an unknown name."""
        if name not in self._units:
            raise SceneError(f"There is no signal `{name}`: {suggest(name, self._units)}")
        return self._units[name]

    @property
    def _legends(self) -> dict[str, dict[int, str]]:
        return self._words

    def _at_last(self, element: str) -> str:
        return self._last[element]

    def at(self, time: Any) -> NoReturn:
        """Raises SceneError: between records only the run itself knows its signals."""
        raise SceneError(f"A run read from `{self.path}` has its records only: `at` needs the plant; simulate again, or `pickle` the run.")

    @property
    def error(self) -> NoReturn:
        """Raises SceneError: the error is measured by a second run."""
        raise SceneError(f"A run read from `{self.path}` has its records only: `error` needs the plant; ask it before `save`, or `pickle` the run.")

    @property
    def _headlines(self) -> list[str]:
        return [f"Run read from {self.path}", f"{self.end:g} s: {self.time.size} recorded times, {len(self.events)} events"]

    def __repr__(self) -> str:
        return f"SavedRun({str(self.path)!r}: {self.time.size} times to {self.end:g} s, {len(self.events)} events)"
