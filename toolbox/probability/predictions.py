"""What is predicted of a machine whose numbers are known as draws or distributions: bands on its signals over time, beside what was measured.

    found = predict(loop, known.drawn, {"top.speed": "0.2 rpm"}, recording=recording)
    print(found); found.plot()

Each draw is a machine that is run; at each time the band holds the middle part of the runs, each with the error of a sample. A model that is right covers
with a band of 95 % about 95 of 100 samples: one that covers fewer is wrong, or surer than it may be.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import mapping, number, whole
from toolbox.calibration.recording import Recording
from toolbox.errors import SceneError, SimulationError, suggest
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.unit_systems import reading
from toolbox.files.units import NumberOrText
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.numbers import put_all
from toolbox.probability.distributions import Draws, drawn
from toolbox.probability.pictures import picture
from toolbox.simulation.simulate import simulate

SHOWN = 501
"""Times of a prediction without a recording."""


@dataclass(frozen=True)
class Prediction(Told, Result):
    """Predicted bands of signals over time, the result of `predict`: `print(found)`, `found.coverage`, `found.plot()`.

    Attributes
    ----------
    title
        Name of the machine.
    time
        Times [s], shape (nt,).
    low, median, high
        {signal: lower end, median and upper end of the band in SI, shape (nt,)}.
    units
        {signal: unit}.
    measured_values
        {signal: measured values at the times `time`, shape (nt,), nan if there is no measured value}. Empty without a
        recording.
    draws
        Number of runs.
    confidence
        Fraction of the runs that lie within the band at each time.
    display_units
        {SI unit: unit that was typed}.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose
    >>> from toolbox.probability import predict
    >>> found = predict(compose(BlockOnBelt()), {"block.mass": "1 kg +- 0.1 kg"}, {"block.position": 0.0}, "10 s", draws=20)
    >>> width = found.high["block.position"] - found.low["block.position"]
    >>> print(f"the band is at most {width.max():.2f} m wide")
    the band is at most 0.51 m wide
    """

    title: str
    time: np.ndarray
    low: dict[str, np.ndarray]
    median: dict[str, np.ndarray]
    high: dict[str, np.ndarray]
    units: dict[str, str]
    measured_values: dict[str, np.ndarray]
    draws: int
    confidence: float
    display_units: Mapping[str, str] = field(default_factory=dict)

    @property
    def coverage(self) -> dict[str, float]:
        """Fraction of the measured samples that lie within the band, as {signal: fraction}. nan for a signal without measured samples."""
        found = {}
        for name, low in self.low.items():
            values = self.measured_values.get(name, np.empty(0))
            known = np.isfinite(values)
            inside = (values >= low) & (values <= self.high[name]) if known.size else known
            found[name] = float(inside[known].mean()) if known.any() else math.nan
        return found

    def _told(self) -> list[str | Rows]:
        title = f"Prediction of {self.title}: {self.draws} draws over {self.time[-1]:.4g} s, bands of {100 * self.confidence:g} %"
        rows: list[tuple[str, ...]] = [("signal", "unit", "lowest", "highest", "mean width", "measured", "cover")]
        for name, unit in self.units.items():
            factor, shown = reading(unit, self.display_units)[:2]
            low, high, cover = self.low[name] * factor, self.high[name] * factor, self.coverage[name]
            count = int(np.isfinite(self.measured_values.get(name, np.empty(0))).sum())
            told = (f"{each:.4g}" for each in (low.min(), high.max(), (high - low).mean()))
            rows.append((name, shown, *told, str(count) if count else "-", f"{cover:.3f}" if count else "-"))
        return [title, Rows(rows, left=(0, 1))]

    __repr__ = Told.__str__

    def _table(self) -> HeadedRows:
        """One row per time."""
        headings, values = ["time [s]"], [self.time]
        for name, unit in self.units.items():
            headings += [heading(f"{name} {word}", unit) for word in ("low", "median", "high")]
            values += [self.low[name], self.median[name], self.high[name]]
            if name in self.measured_values:
                headings.append(heading(f"{name} measured", unit))
                values.append(self.measured_values[name])
        return headings, np.stack(values, axis=1).tolist()

    plot = picture("prediction_diagram", "Draw the bands and the measured values, one panel per signal")

    def check_loaded(self) -> None:
        """Raise ValueError if the loaded arrays do not fit together."""
        rows = [*self.low.values(), *self.median.values(), *self.high.values(), *self.measured_values.values()]
        if {*self.low} != {*self.units} or {*self.high} != {*self.units} or any(each.shape != self.time.shape for each in rows):
            raise ValueError("its rows do not fit together")


@takes_loop
def predict(
    loop: ClosedLoop,
    known: Mapping[str, Any] | Draws,
    signals: Mapping[str, NumberOrText],
    duration: NumberOrText | None = None,
    *,
    recording: Recording | None = None,
    draws: int = 100,
    confidence: float = 0.95,
    accuracy: float = 1e-4,
    seed: int = 0,
) -> Prediction:
    """Predict bands of signals of a machine whose numbers are uncertain and known as draws or distributions.

    Parameters
    ----------
    loop
        A loop, or a plant, with the inputs of the machine.
    known
        The uncertain numbers of the machine: the draws of a posterior (`found.drawn`), or {name: distribution}, each
        `Normal`, `Uniform`, `LogNormal`, or text such as "97 kN +- 8 kN".
    signals
        {signal: standard deviation of one sample}, in SI or text with a unit. The standard deviation is the measurement
        noise that the bands include. With 0 they are bands of the signal without noise.
    duration
        Length of the runs [s], or text with a unit. By default the length of the recording, else the duration of the
        loop.
    recording
        A measurement that is compared with the bands, by default none. The prediction then has the times of this
        recording.
    draws
        Number of runs, >= 20, by default 100.
    confidence
        Fraction of the runs within the bands, by default 0.95.
    accuracy
        Target for the global error of the runs, between 1e-13 and 0.1, by default 0.0001.
    seed
        Seed of the random numbers, by default 0.

    Returns
    -------
    Prediction
        Bands over time, and the fraction of the measured samples within them.

    Raises
    ------
    SceneError
        If a name is unknown, or the recording has none of the signals.
    SimulationError
        If more than half of the draws give no run.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.probability import predict
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock()), inputs={"top.torque": "14 kN m"})
    >>> found = predict(loop, {"bit.weight": "97 kN +- 5 kN"}, {"top.speed": 0.0}, "30 s", draws=40)
    >>> print(found.median["top.speed"].shape == found.time.shape)
    True
    """
    whole("draws", draws, 20)
    confidence = number("confidence", confidence, above=0, below=1)
    deviations = {}
    for name, given in mapping("signals", signals).items():
        if not loop.system.has_signal(name):
            raise SceneError(f"Argument `signals` must name signals, but `{name}` is none: {suggest(name, loop.system.signals)}")
        deviations[name] = number(f"signals.{name}", given, loop.system.unit(name), at_least=0)
    if duration is None:
        duration = loop.duration if recording is None else float(recording.time[-1])
    length = number("duration", duration, "s", above=0)
    times = np.linspace(0.0, length, SHOWN) if recording is None else recording.time[recording.time <= length]
    measured = {} if recording is None else {n: recording.signals[n][: times.size].copy() for n in deviations if n in recording.signals}
    if recording is not None and not measured:
        raise SceneError(f"Argument `recording` must have one of the signals, but it has {', '.join(recording.signals)}.")
    design = drawn(loop, known, draws, seed)
    runs: dict[str, list[np.ndarray]] = {name: [] for name in deviations}
    failed: Exception | None = None
    with progress_bar(draws, "predict") as bar:
        for row in design.points:
            each = put_all(loop, dict(zip(design.names, row.tolist(), strict=True)))
            bar.update(1)
            try:
                run = simulate(each, length, accuracy=accuracy, output_times=times)
            except SimulationError as error:
                failed = error
                continue
            for name, rows in runs.items():
                rows.append(np.asarray(run[name], float))
    done = len(next(iter(runs.values())))
    if failed is not None and done < draws / 2:
        raise SimulationError(f"Only {done} of {draws} draws give a run: {failed}")
    rng, tail = np.random.default_rng([seed, 1]), (1.0 - confidence) / 2.0
    bands = {}
    for name, rows in runs.items():
        values = np.stack(rows)
        values += deviations[name] * rng.standard_normal(values.shape)
        bands[name] = np.quantile(values, (tail, 0.5, 1.0 - tail), axis=0)
    low, median, high = ({name: band[k] for name, band in bands.items()} for k in range(3))
    return Prediction(
        title=loop.title, time=times, low=low, median=median, high=high, units={name: loop.system.unit(name) for name in bands}, measured_values=measured,
        draws=done, confidence=confidence, display_units=dict(loop.display_units),
    )  # fmt: skip
