"""The posterior of numbers of a machine, from what was measured of its runs, and the evidence of a law of friction.

    found = posterior(loop, {"stuck_ratio": "0.31 +- 0.02", "severity": "1.32 +- 0.05"}, {"bit.friction.static": Uniform(0.5, 1.0)}, 120.0)
    chance(loop, over, found.drawn)

What was measured is said in the same words as what is known of a number: a measure and its normal distribution. A measure is read inside of the compiled loop,
so that no trajectory is built. The sampler is that of `toolbox.probability.tempering`.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray, mapping, number, short, whole
from toolbox.calibration.recording import Recording
from toolbox.errors import SceneError, optional
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.unit_systems import reading
from toolbox.files.units import NumberOrText
from toolbox.measuring.metrics import Metric, mean
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop, as_loop, closed_loop, takes_loop
from toolbox.probability.distributions import Draws, Normal, distribution, quantiles, told
from toolbox.probability.pictures import picture
from toolbox.probability.tempering import tempered
from toolbox.scenes.judged import judged_measures
from toolbox.sweeps.designs import Variations
from toolbox.sweeps.store import journal_in
from toolbox.sweeps.sweep import sweep
from toolbox.vocabulary import new_names_only

STANDARD = math.log(2.0 * math.pi) / 2.0

SHOWN = 8
"""Lines of data that are printed."""


@dataclass(frozen=True)
class Posterior(Told, Result):
    """Posterior distribution of unknown numbers after a measurement, the result of `posterior`: `print(found)`,
    `found["bit.weight"]`, `found.plot()`.

    Attributes
    ----------
    title
        Name of the machine.
    names, units
        Names and units of the unknowns.
    samples
        Draws in SI, shape (draws, unknowns).
    likelihoods
        Logarithms of the likelihoods of the draws, shape (draws,).
    log_evidence, log_evidence_error
        Logarithm of the mean likelihood under the prior, and its standard error.
    data
        {metric: description of the measurement}.
    priors
        {unknown: description of the prior}.
    runs, tempering_stages
        Number of runs, and number of tempering stages.
    display_units
        {SI unit: unit that was typed}.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.probability import Uniform, posterior
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock()), inputs={"top.torque": "12 kN m"})
    >>> found = posterior(loop, {"severity": "1.1 +- 0.1"}, {"bit.friction.static": Uniform(0.6, 1.0)}, "60 s", draws=32)
    >>> print(f"{found['bit.friction.static'].mean():.1f}, from {len(found.samples)} draws")
    0.8, from 32 draws
    """

    title: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    samples: np.ndarray
    likelihoods: np.ndarray
    log_evidence: float
    log_evidence_error: float
    data: dict[str, str]
    priors: dict[str, str]
    runs: int
    tempering_stages: int
    display_units: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> FloatArray:
        """The draws of an unknown in SI."""
        if name not in self.names:
            raise SceneError(f"There is no unknown `{name}`: it is one of {', '.join(self.names)}.")
        draws: FloatArray = self.samples[:, self.names.index(name)]
        return draws

    @property
    def drawn(self) -> Draws:
        """The draws as a joint distribution of the unknowns, for `chance`, `predict` and the function `drawn`."""
        return Draws({name: self[name].tolist() for name in self.names})

    def _told(self) -> list[str | Rows]:
        lines: list[str | Rows] = [
            f"Posterior of {self.title}: {len(self.samples)} draws by {self.runs} runs in {self.tempering_stages} stages"
        ]
        told = [f"  measured {name}: {words}" for name, words in self.data.items()]
        lines += told if len(told) <= SHOWN else [*told[: SHOWN - 2], f"  ... {len(told) - SHOWN + 1} more", told[-1]]
        rows: list[tuple[str, ...]] = [("unknown", "unit", "mean", "deviation", "5 %", "95 %", "before")]
        for name, unit in zip(self.names, self.units, strict=True):
            factor, shown = reading(unit, self.display_units)
            values = self[name] * factor
            told_values = (f"{each:.5g}" for each in (values.mean(), values.std(), *np.quantile(values, (0.05, 0.95))))
            rows.append((name, shown, *told_values, self.priors[name]))
        return [*lines, Rows(rows, left=(0, 1, 6)), f"  evidence: exp({self.log_evidence:.2f} +- {self.log_evidence_error:.2f})"]

    __repr__ = Told.__str__

    def _table(self) -> HeadedRows:
        """One row per draw."""
        headings = [heading(name, unit) for name, unit in zip(self.names, self.units, strict=True)]
        return headings, self.samples.tolist()

    def to_xarray(self) -> Any:
        """Return the draws as an xarray Dataset with the dimensions "chain" and "draw", in the form that arviz reads. Needs the extra `batch`."""
        xarray = optional("xarray", "`to_xarray`", "batch")
        data = {name: (("chain", "draw"), self[name][None, :], {"units": unit}) for name, unit in zip(self.names, self.units, strict=True)}
        return xarray.Dataset(data, attrs={"title": self.title, "evidence": self.log_evidence, "evidence_error": self.log_evidence_error})

    plot = picture("corner_diagram", "Draw the distribution of each unknown, and the draws of each pair of unknowns")

    def check_loaded(self) -> None:
        """Raise ValueError if the loaded arrays do not fit together."""
        if self.samples.shape != (len(self.likelihoods), len(self.names)) or {*self.priors} != {*self.names}:
            raise ValueError("its draws do not fit to its unknowns")


@takes_loop
def posterior(
    loop: ClosedLoop,
    data: Mapping[str, Any],
    priors: Mapping[str, Any],
    duration: NumberOrText | None = None,
    *,
    metrics: Mapping[str, Any] | None = None,
    draws: int = 256,
    accuracy: float = 1e-4,
    seed: int = 0,
    checkpoint: str | Path | None = None,
) -> Posterior:
    """Estimate the joint distribution of unknown numbers of a machine from measurements of its runs.

    The runs begin at the start of the loop. The errors of the measured metrics are assumed to be independent and
    normally distributed around the metrics of the run.

    Parameters
    ----------
    loop
        A loop, or a plant, with the inputs of the measurement.
    data
        {metric: its normal distribution}, as text "0.31 +- 0.02" or `Normal`, in the unit of the metric if the text
        has one. The standard deviation holds the errors of measurement and model.
    priors
        {name: distribution} of each unknown without the measurement, each `Normal`, `Uniform`, `LogNormal`, or text
        such as "97 kN +- 8 kN".
    duration
        Length of the runs [s], or text with a unit. By default the duration of the loop.
    metrics
        {name in `data`: metric} for those names in `data` that are not names of metrics of the toolbox, such as a
        metric in a window of time. By default none.
    draws
        Number of draws of the posterior, >= 32, by default 256.
    accuracy
        Target for the global error of the runs, between 1e-13 and 0.1, by default 0.0001.
    seed
        Seed of the random numbers, by default 0.
    checkpoint
        Folder in which every likelihood is stored as soon as it is computed. The same call after an interruption
        continues from this folder. By default None: nothing is stored.

    Returns
    -------
    Posterior
        Draws, evidence and their table. The difference of two evidences is the logarithm of the Bayes factor of two
        models.

    Raises
    ------
    SceneError
        If a name is unknown, a value is no distribution, or `checkpoint` holds another search.
    SimulationError
        If no draw of the prior gives a run with the measured metrics.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.probability import Uniform, posterior
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock()), inputs={"top.torque": "12 kN m"})
    >>> found = posterior(loop, {"severity": "1.1 +- 0.1"}, {"bit.friction.static": Uniform(0.6, 1.0)}, "60 s", draws=32)
    >>> print(found.names, found.samples.shape)
    ('bit.friction.static',) (32, 1)
    """
    for word, given in (("data", data), ("priors", priors)):
        if not isinstance(given, Mapping) or not given:
            raise SceneError(f"Argument `{word}` must map at least one name to a distribution, but it is {short(given)}.")
    whole("draws", draws, 32)
    whole("seed", seed, 0)
    measured = Measured.of(loop, data, duration, metrics)
    length = measured.length
    unknowns = [loop.number(name) for name in priors]
    names = tuple(each.name for each in unknowns)
    known = [distribution(each.name, given) for each, given in zip(unknowns, priors.values(), strict=True)]

    def numbers_at(points: FloatArray) -> FloatArray:
        from scipy.special import ndtr

        cumulative = ndtr(points)
        return np.stack([quantiles(each, k, cumulative[:, i]) for i, (each, k) in enumerate(zip(unknowns, known, strict=True))], axis=1)

    journal = None if checkpoint is None else journal_in(
        Path(checkpoint), "posterior.jsonl", loop, Variations(names, numbers_at(np.zeros((1, len(names)))), (1,)), length, accuracy,
        measured=[measured.values.tolist(), measured.deviations.tolist(), str(list(measured.chosen.items()))], priors=[str(known)], draws=[draws], seed=[seed],
    )  # fmt: skip
    calls = itertools.count()

    def likelihood(points: FloatArray) -> FloatArray:
        call = next(calls)  # the sampler asks the same each time, so that the place among its questions tells which one it is
        if journal is not None and (call,) in journal.known:
            return np.array([-math.inf if each is None else each for each in journal.known[call,]])
        logs = measured.log_likelihoods(loop, names, numbers_at(points), accuracy).sum(axis=1)
        if journal is not None:
            journal.add((call,), [each if math.isfinite(each) else None for each in logs.tolist()])
        return logs

    with progress_bar(1.0, "posterior", unit="likelihood") as bar:
        sampled = tempered(likelihood, len(names), draws, np.random.default_rng(seed), lambda exponent: bar.update(exponent - bar.n))
    return Posterior(
        title=loop.title, names=names, units=tuple(each.unit for each in unknowns), samples=numbers_at(sampled.points), likelihoods=sampled.likelihoods,
        log_evidence=sampled.evidence, log_evidence_error=sampled.error, data={name: told(name, data[name], measured.units[name]) for name in data},
        priors={each.name: told(each.name, given) for each, given in zip(unknowns, priors.values(), strict=True)}, runs=sampled.runs,
        tempering_stages=sampled.stages, display_units={each.unit: unit for each, k in zip(unknowns, known, strict=True)
        if (unit := k.display_units(each.unit))},
    )  # fmt: skip


@dataclass(frozen=True)
class Measured:
    """What was measured of runs of a length [s]: measures, and values and standard deviations in SI; asked: the measures as `sweep` takes them."""

    display_units: dict[str, Any]
    chosen: dict[str, Metric]
    units: dict[str, str]
    values: FloatArray
    deviations: FloatArray
    length: float

    @classmethod
    def of(
        cls, loop: ClosedLoop, data: Mapping[str, Any], duration: Any, metrics: Mapping[str, Any] | None, word: str = "data"
    ) -> Measured:
        """What `posterior` is given; raises SceneError for what is no normal distribution of a measure. word: the argument with the data."""
        length = number("duration", loop.duration if duration is None else duration, "s", above=0)
        asked = {name: (metrics or {}).get(name, name) for name in data}
        chosen = judged_measures(asked, loop, 0.0, length, argument=word)
        units = {name: each.unit_in(loop.system) for name, each in chosen.items()}
        pairs = []
        for name, given in data.items():
            known = distribution(name, given)
            if not isinstance(known, Normal):
                raise SceneError(f"Argument `{name}` of `{word}` must be normal, as in `0.31 +- 0.02`, but it is {short(given)}.")
            frozen = known.frozen(name, units[name])
            pairs.append((float(frozen.mean()), float(frozen.std())))
        values, deviations = np.array(pairs).T
        return cls(asked, chosen, units, values, deviations, length)

    def log_likelihoods(self, loop: ClosedLoop, names: Sequence[str], points: FloatArray, accuracy: float) -> FloatArray:
        """Logarithms of the likelihoods of each datum, shape (points, data), by runs with these numbers; -inf where a run tells nothing."""
        runs = sweep(loop, Variations(tuple(names), points, (len(points),)), self.length, metrics=self.display_units, accuracy=accuracy)
        apart = (np.stack([runs[name] for name in self.display_units], axis=1) - self.values) / self.deviations
        logs = -(0.5 * apart**2 + np.log(self.deviations) + STANDARD)
        return np.where(np.isfinite(logs), logs, -np.inf)


def windowed(signal: str, times: Any, values: Any, deviation: float, length: NumberOrText) -> tuple[dict[str, Normal], dict[str, Metric]]:
    """Turn a measured time series of a signal into data and metrics for `posterior`: means of the signal in windows of equal length.

    Parameters
    ----------
    signal
        Name of the signal in the loop.
    times, values
        Samples of the measurement, in seconds of the run and in SI. Samples that are nan and windows without samples
        are left out.
    deviation
        Standard deviation of the mean in a window, in SI, > 0.
    length
        Length of a window [s], or text with a unit. The last window ends with the last sample.

    Returns
    -------
    data, metrics
        The arguments `data` and `metrics` of `posterior`.

    Raises
    ------
    SceneError
        If times and values do not fit, or no window holds a sample.

    Examples
    --------
    >>> import numpy as np
    >>> from toolbox.probability import windowed
    >>> time = np.linspace(0.0, 20.0, 401)
    >>> data, metrics = windowed("top.speed", time, 6.0 + np.sin(time), deviation=0.05, length="2 s")
    >>> print(len(data), "means")
    10 means
    """
    length = number("length", length, "s", above=0)
    deviation = number("deviation", deviation, "1", above=0)
    t, y = np.asarray(times, float), np.asarray(values, float)
    if t.ndim != 1 or t.shape != y.shape:
        raise SceneError(f"Argument `values` must hold one number for each of the times, but its shape is {y.shape} and theirs {t.shape}.")
    use = np.isfinite(t) & np.isfinite(y) & (t >= 0)
    place = np.floor(t[use] / length).astype(int)
    last = float(t[use].max()) if use.any() else 0.0
    data, read = {}, {}
    for k in np.unique(place).tolist():
        if k * length >= last:
            continue  # a window of one instant
        name = f"{signal} from {k * length:.6g} s"
        data[name] = Normal(float(y[use][place == k].mean()), deviation)
        read[name] = mean(signal, k * length, min((k + 1) * length, last))
    if not data:
        raise SceneError("Argument `values` must hold at least one finite sample at a time >= 0 s, but it holds none.")
    return data, read


@new_names_only
def from_recording(
    loop: ClosedLoop | Any, recording: Recording, compare: Mapping[str, NumberOrText], length: NumberOrText = 1.0, *, max_gap: int = 2
) -> tuple[ClosedLoop, dict[str, Normal], dict[str, Metric]]:
    """Turn a recording into a loop, data and metrics, which are arguments of `posterior` and `compare_models`.

    Signals of the recording that are inputs of the plant become inputs of the loop, linear between samples. The signals
    in `compare` are compared by their means in windows of time.

    Parameters
    ----------
    loop
        A loop, or a plant, which begins like the recording. By default it begins at rest.
    recording
        The measurement. Samples that are nan are left out.
    compare
        {signal: standard deviation of the mean in a window}, in SI or text with a unit. The standard deviation
        includes errors of the model.
    length
        Length of a window [s], or text with a unit, by default 1.
    max_gap
        Largest number of samples in a row that may be missing in an input, by default 2. The line between their
        neighbours replaces them.

    Returns
    -------
    loop, data, metrics
        The loop with the measured inputs, and the arguments `data` and `metrics` of `posterior`.

    Raises
    ------
    SceneError
        If a compared signal is not measured or is an input, or an input has a gap.

    Examples
    --------
    >>> import numpy as np
    >>> from models import BitRock, wells
    >>> from toolbox import compose, simulate
    >>> from toolbox.calibration import Recording
    >>> from toolbox.probability import from_recording
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> time = np.linspace(0.0, 20.0, 401)
    >>> run = simulate(rig, 20.0, inputs={"top.torque": "12 kN m"}, output_times=time)
    >>> log = {"time": time, "top.torque": run["top.torque"], "top.speed": run["top.speed"]}
    >>> loop, data, metrics = from_recording(rig, Recording.of(log, rig), {"top.speed": "0.05 rad/s"}, length="2 s")
    >>> print(len(data), "means")
    10 means
    """
    bare = dataclasses.replace(as_loop(loop), inputs={})  # what drives an input of the plant in closed loop is an output of the loop
    driving = recording.driving(bare.system, max_gap)
    data: dict[str, Normal] = {}
    measures: dict[str, Metric] = {}
    for name, given in mapping("compare", compare).items():
        if name not in recording.signals or name in driving:
            others = ", ".join(each for each in recording.signals if each not in driving)
            raise SceneError(
                f"Argument `compare` must name measured signals that drive nothing, but it names `{name}`; there are: {others}."
            )
        size = number(f"compare.{name}", given, bare.system.unit(name), above=0)
        more, read = windowed(name, recording.time, recording.signals[name], size, length)
        data |= more
        measures |= read
    return closed_loop(loop, inputs=driving), data, measures
