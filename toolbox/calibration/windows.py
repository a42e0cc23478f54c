"""Parts of a log that are fitted together, with numbers of their own beside common ones, and how the optimum is searched for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from toolbox.arguments import number, whole
from toolbox.calibration.panels import TIME, Panel
from toolbox.errors import SceneError
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import names
from toolbox.modelling.numbers import Number
from toolbox.vocabulary import Renamed


@dataclass(frozen=True)
class Window:
    """Part of a log for `fit`. Some free numbers may have a separate value in each part.

    Attributes
    ----------
    begin, end
        Times of the log [s].
    own
        Names of free numbers with their own value in this window, such as the weight on bit of a stand, or a start
        value. In the fit, the number of the second window is called `bit.weight[2]`. All other numbers are common to
        all windows.
    start
        {own free number: value at which the search begins}, in SI. By default the value in the loop.

    Examples
    --------
    >>> from toolbox.calibration import Window
    >>> print(Window(0.5, 8.0, own="belt.deflection").end)
    8.0
    """

    begin: NumberOrText
    end: NumberOrText
    own: str | Sequence[str] = ()
    start: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        begin, end = number("begin", self.begin, "s"), number("end", self.end, "s")
        if not begin < end:
            raise SceneError(f"Argument `end` must be > begin = {begin:g} s, but it is {end:g} s.")
        object.__setattr__(self, "begin", begin)
        object.__setattr__(self, "end", end)
        object.__setattr__(self, "own", names(self.own))


@dataclass(frozen=True)
class Search:
    """Settings of the search of a fit.

    Attributes
    ----------
    starts, seed
        Number of searches, and seed of their starts. The first search begins at the declared values. The others begin
        at random values between the bounds, or between half and twice the declared value.
    robust
        Limit for outliers, as a multiple of the robust standard deviation (from the median). Samples beyond this limit
        are left out and reported, if they are at most 1/20 of the samples of a signal. Reason: a few samples with the
        wrong sign would move an estimate by many times its confidence interval. None keeps all samples.
    accuracy
        Target for the global error of the runs, between 1e-13 and 0.1.
    growing
        Whether a search by simulation goes over a quarter of the data first, then half, then all. False begins with all
        data, for start values near the optimum.
    fits_held
        Whether a fit is repeated with inputs held between samples if its residuals are no noise and the residuals do
        not tell whether they are held.

    Examples
    --------
    >>> from toolbox.calibration import Search
    >>> print(Search(starts=8, seed=1).starts, "starts")
    8 starts
    """

    starts: int = 4
    seed: int = 0
    robust: float | None = 5.0
    accuracy: float = 1e-8
    growing: bool = True
    fits_held: bool = True

    def __post_init__(self) -> None:
        whole("starts", self.starts, 1)
        whole("seed", self.seed, 0)
        if self.robust is not None:
            number("robust", self.robust, above=1)


@dataclass(frozen=True)
class MeasuredContact(Renamed):
    """A contact whose friction law is fitted to measured force over measured slip, without simulation, for `fit`.

    Attributes
    ----------
    name
        Name of the contact.
    standstill_speed
        Slip speeds up to this value count as stick. By default 1/100 of the largest measured slip speed.

    Examples
    --------
    >>> from toolbox.calibration import MeasuredContact
    >>> print(MeasuredContact("bit", standstill_speed=0.05).standstill_speed)
    0.05
    """

    name: str
    standstill_speed: float | None = None

    def __post_init__(self) -> None:
        if self.standstill_speed is not None:
            number("standstill_speed", self.standstill_speed, above=0)


def windows_of(given: Any) -> list[Window]:
    """What was given as windows: none, two times, a window, or several of both. Raises SceneError for anything else."""
    if given is None:
        return []
    if isinstance(given, Window):
        return [given]
    if isinstance(given, Sequence) and not isinstance(given, str) and given:
        if all(isinstance(each, Window) or (isinstance(each, (tuple, list)) and len(each) == 2) for each in given):
            return [each if isinstance(each, Window) else Window(*each) for each in given]
        if len(given) == 2 and not any(isinstance(each, (Window, tuple, list)) for each in given):
            return [Window(*given)]
    raise SceneError(f"Argument `window` must be two times (begin, end), a `Window`, or several of them, but it is {given!r}.")


def own_name(name: str, window: int) -> str:
    """What a number that a window owns is called; windows are counted from 1."""
    return f"{name}[{window}]"


def shared(free: Sequence[str], windows: Sequence[Window]) -> list[tuple[str, ...]]:
    """What every free number is called in the fit, window by window. Raises SceneError for an own number that is not free."""
    called = []
    for i, window in enumerate(windows, 1):
        unknown = next((name for name in window.own if name not in free), None)
        if unknown is not None:
            raise SceneError(f"Argument `free` must hold `{unknown}`, which window {i} has for its own, but it holds {', '.join(free)}.")
        called.append(tuple(own_name(name, i) if name in window.own else name for name in free))
    return called


class Together:
    """Several windows as one misfit, in which numbers of one name are one number.

    Parameters
    ----------
    each
        The misfits of the windows, whose free numbers come in one order.
    called
        What the free numbers are called in each window.
    begins
        Times of the log at which the windows begin.
    """

    def __init__(self, each: Sequence[Any], called: Sequence[tuple[str, ...]], begins: Sequence[float]):
        self.each, self.called, self.begins = list(each), list(called), list(begins)
        self.names = list(dict.fromkeys(name for names in called for name in names))
        self.places = [np.array([self.names.index(name) for name in names], int) for names in called]
        self.outputs = list(dict.fromkeys(name for misfit in each for name in misfit.outputs))
        self.measured = self._joined([misfit.measured for misfit in each])
        self.by_samples = all(misfit.by_samples for misfit in each)

    def _joined(self, parts: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
        """What the windows have of each signal, one after another."""
        return {name: np.concatenate([part[name] for part in parts if name in part]) for name in self.outputs}

    def deviations(self, output: str) -> np.ndarray:
        """Standard deviations of samples of an output that are known in another way than by measuring them, window by window."""
        return np.concatenate([misfit.deviations(output) for misfit in self.each if output in misfit.outputs])

    def blocks(self, output: str) -> list[int]:
        """Number of samples of an output in each window that has it."""
        return [size for misfit in self.each if output in misfit.outputs for size in misfit.blocks(output)]

    @property
    def numbers(self) -> list[Number]:
        """The free numbers, as the windows have them at the start."""
        found: dict[str, Number] = {}
        for misfit, called in zip(self.each, self.called, strict=True):
            for own, name in zip(misfit.numbers, called, strict=True):
                found.setdefault(name, replace(own, name=name))
        return [found[name] for name in self.names]

    @property
    def exact(self) -> bool:
        """Whether slopes are exact in every window."""
        return all(misfit.exact for misfit in self.each)

    @property
    def plant(self) -> HybridSystem:
        """The plant."""
        system: HybridSystem = self.each[0].plant
        return system

    @property
    def loop(self) -> ClosedLoop:
        """The loop of the first window."""
        first: ClosedLoop = self.each[0].loop
        return first

    @property
    def how(self) -> str:
        """What was fitted, in words."""
        return f"{self.each[0].how}, {len(self.each)} windows together"

    @property
    def span(self) -> float:
        """Time that was measured [s]."""
        return float(sum(misfit.span for misfit in self.each))

    @property
    def source(self) -> str:
        """Where the data come from."""
        return str(self.each[0].source)

    def at(self, values: np.ndarray) -> ClosedLoop:
        """The loop of the first window with its numbers."""
        loop: ClosedLoop = self.each[0].at(values[self.places[0]])
        return loop

    def allowed(self, values: np.ndarray) -> None:
        """Raise SceneError where the numbers of a window contradict each other."""
        for misfit, places in zip(self.each, self.places, strict=True):
            misfit.allowed(values[places])

    def model(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """What the model makes of all windows."""
        return self._joined([misfit.model(values[places]) for misfit, places in zip(self.each, self.places, strict=True)])

    def apart(self, values: np.ndarray) -> dict[str, float]:
        """{output: how far from the model its first samples are}, the farthest of all windows that begin elsewhere than the model."""
        found: dict[str, float] = {}
        for misfit, places in zip(self.each, self.places, strict=True):
            for name, far in misfit.apart(values[places]).items():
                found[name] = max(far, found.get(name, 0.0))
        return found

    def slopes(self, values: np.ndarray, sizes: np.ndarray) -> dict[str, np.ndarray]:
        """Derivatives of `model` with respect to the free numbers, shape (nt, k)."""
        parts = []
        for misfit, places in zip(self.each, self.places, strict=True):
            found = {}
            for name, own in misfit.slopes(values[places], sizes[places]).items():
                found[name] = np.zeros((len(own), values.size))
                found[name][:, places] = own
            parts.append(found)
        return self._joined(parts)

    def start_slopes(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """Return derivatives of `model` with respect to the start of every state in every window, shape (nt, windows times states)."""
        parts = [misfit.start_slopes(values[places]) for misfit, places in zip(self.each, self.places, strict=True)]
        sizes = [next(iter(part.values())).shape[1] for part in parts]
        ends = np.cumsum([0, *sizes])
        for part, first in zip(parts, ends[:-1], strict=True):
            for name, own in part.items():
                part[name] = np.pad(own, ((0, 0), (int(first), int(ends[-1] - first) - own.shape[1])))
        return self._joined(parts)

    def panels(self, left: Mapping[str, np.ndarray], values: np.ndarray) -> tuple[Panel, ...]:
        """What was measured beside the model, window by window on the clock of the log; values: the free numbers."""
        taken, found = dict.fromkeys(self.outputs, 0), []
        for i, (misfit, begin, places) in enumerate(zip(self.each, self.begins, self.places, strict=True), 1):
            own = {}
            for name in misfit.outputs:
                first, taken[name] = taken[name], taken[name] + misfit.measured[name].size
                own[name] = left[name][first : taken[name]]
            for panel in misfit.panels(own, values[places]):
                later = panel.x + begin if panel.over == TIME else panel.x
                found.append(replace(panel, name=own_name(panel.name, i), x=later, sticks=panel.sticks + begin))
        return tuple(found)

    def horizons(self) -> list[Together]:
        """The misfits of longer and longer parts of every window, where all have as many."""
        steps = [misfit.horizons() for misfit in self.each]
        if len({len(own) for own in steps}) > 1:
            return [self]
        shorter = [self._of(list(own)) for own in zip(*[own[:-1] for own in steps], strict=True)]
        return [*shorter, self]

    def trial(self) -> Together:
        """The misfit with which searches are done."""
        few = [misfit.trial() for misfit in self.each]
        return self if all(one is two for one, two in zip(few, self.each, strict=True)) else self._of(few)

    def thinned(self) -> Together | None:
        """The misfit with every other sample of measured inputs left out; None where no input is measured."""
        fewer = [misfit.thinned() for misfit in self.each]
        return None if any(each is None for each in fewer) else self._of(fewer)

    def _of(self, each: Sequence[Any]) -> Together:
        return Together(each, self.called, self.begins)
