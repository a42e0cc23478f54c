"""Several models of a machine against one measurement: by their evidence, and by how well they predict windows that they have not seen.

    found = compare_models({"exponential": one, "Gaussian": other}, data, priors, 20.0, left_out=more, metrics=read)

The evidence is the mean likelihood under the prior: a law with numbers that the data do not need pays for them. It hangs on the prior, though, and data that
were left out do not: their score is the logarithm of what the posterior gave them, window by window, as A. Vehtari, A. Gelman, J. Gabry (2017),
doi:10.1007/s11222-016-9696-4, sum it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray, short
from toolbox.errors import SceneError
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop, as_loop
from toolbox.probability.pictures import picture
from toolbox.probability.posteriors import Measured, Posterior, posterior
from toolbox.vocabulary import new_names_only


@dataclass(frozen=True)
class ModelComparison(Told, Result):
    """Comparison of models on one measurement, the result of `compare_models`: `print(found)`, `found.posteriors["Gaussian"]`, `found.plot()`.

    Attributes
    ----------
    posteriors
        {label of the model: posterior of its numbers, with its evidence}.
    log_scores
        {label of the model: logarithm of the predictive density of each metric in `left_out`, shape (metrics,)}.
    left_out
        Names of the metrics that no posterior used.

    Examples
    --------
    >>> from models import BitRock, Coulomb, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.probability import Uniform, compare_models
    >>> strings = {"falling": BitRock(), "constant": BitRock(friction=Coulomb(static=0.8, kinetic=0.5))}
    >>> loops = {label: closed_loop(compose(wells.JANSEN_2, bit), inputs={"top.torque": "12 kN m"}) for label, bit in strings.items()}
    >>> priors = {label: {"bit.friction.static": Uniform(0.6, 1.0)} for label in loops}
    >>> found = compare_models(loops, {"severity": "1.1 +- 0.1"}, priors, "60 s", draws=32)
    >>> print(f"probability of the falling friction law: {found.probabilities['falling']:.1f}")
    probability of the falling friction law: 0.9
    """

    posteriors: dict[str, Posterior]
    log_scores: dict[str, np.ndarray]
    left_out: tuple[str, ...]

    @property
    def probabilities(self) -> dict[str, float]:
        """Posterior probabilities of the models as {label: probability}, with equal prior probabilities."""
        logs = np.array([each.log_evidence for each in self.posteriors.values()])
        weights = np.exp(logs - logs.max())
        return dict(zip(self.posteriors, (weights / weights.sum()).tolist(), strict=True))

    def behind(self, label: str) -> tuple[float, float]:
        """Return (loss, standard error) of a model in the prediction of the metrics in `left_out`, relative to the best model.

        The loss is a difference of logarithms of predictive densities. It is (0, 0) for the best model.

        Parameters
        ----------
        label
            Label of the model.
        """
        best = max(self.log_scores, key=lambda each: float(self.log_scores[each].sum()))
        apart = self.log_scores[best] - self.log_scores[label]
        error = math.sqrt(apart.size) * float(apart.std(ddof=1)) if apart.size > 1 else math.nan
        return float(apart.sum()), 0.0 if label == best else error

    def _told(self) -> list[str | Rows]:
        rows: list[tuple[str, ...]] = [("model", "unknowns", "log evidence", "probability", "left out: score", "behind the best", "runs")]
        for label, found in self.posteriors.items():
            score, (behind, error) = self.log_scores[label], self.behind(label)
            told = (f"{score.sum():.2f}", f"{behind:.2f} +- {error:.2f}") if score.size else ("-", "-")
            evidence = f"{found.log_evidence:.2f} +- {found.log_evidence_error:.2f}"
            rows.append((label, str(len(found.names)), evidence, f"{self.probabilities[label]:.3g}", *told, str(found.runs)))
        return [f"{len(self.posteriors)} models of one measurement, {len(self.left_out)} windows left out", Rows(rows)]

    __repr__ = Told.__str__

    def _table(self) -> HeadedRows:
        """One row per model."""
        rows = []
        for label, found in self.posteriors.items():
            rows.append(
                [
                    label,
                    found.log_evidence,
                    found.log_evidence_error,
                    self.probabilities[label],
                    float(self.log_scores[label].sum()),
                    *self.behind(label),
                ]
            )
        return ["model", "log evidence", "error", "probability", "score left out", "behind", "error of that"], rows

    plot = picture("comparison_diagram", "Draw evidence and score of each model relative to the best model")

    def check_loaded(self) -> None:
        """Raise ValueError if the loaded arrays do not fit together."""
        for each in self.posteriors.values():
            each.check_loaded()
        if {*self.log_scores} != {*self.posteriors} or any(each.shape != (len(self.left_out),) for each in self.log_scores.values()):
            raise ValueError("its scores do not fit to its models")


@new_names_only
def compare_models(
    models: Mapping[str, Any],
    data: Mapping[str, Any],
    priors: Mapping[str, Mapping[str, Any]],
    duration: NumberOrText | None = None,
    *,
    left_out: Mapping[str, Any] | None = None,
    metrics: Mapping[str, Any] | None = None,
    draws: int = 256,
    accuracy: float = 1e-4,
    seed: int = 0,
    checkpoint: str | Path | None = None,
) -> ModelComparison:
    """Compare models of a machine, such as friction laws, by measurements of the machine.

    Parameters
    ----------
    models
        {label: loop or plant, with the inputs of the measurement}.
    data
        {metric: its normal distribution}, as text "0.31 +- 0.02" or `Normal`, the same for all models. The standard
        deviation holds the errors of measurement and model.
    priors
        {label: {name: distribution}}, the unknowns of each model.
    duration
        Length of the runs [s], or text with a unit. By default the duration of each loop.
    left_out
        {metric: its normal distribution} of additional data that no posterior uses, by default none. The posterior of
        each model predicts them, and their likelihood is the score of the model.
    metrics
        {name in `data`: metric}, for names in `data` that are not names of metrics of the toolbox, such as a metric in
        a window of time. By default none.
    draws
        Number of draws of each posterior, >= 32, by default 256.
    accuracy
        Target for the global error of the runs, between 1e-13 and 0.1, by default 0.0001.
    seed
        Seed of the random numbers, by default 0.
    checkpoint
        Folder that keeps the likelihoods. The same call after an interruption continues from this folder. By default
        None: nothing is stored.

    Returns
    -------
    ModelComparison
        Evidences, scores of the left-out data, and the posteriors.

    Raises
    ------
    SceneError
        If the labels of models and priors differ, a name is unknown, a value is no distribution, something is both in
        the data and left out, or `checkpoint` holds another search.
    SimulationError
        If no draw of a prior gives a run with the measured metrics.

    Examples
    --------
    >>> from models import BitRock, Coulomb, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.probability import Uniform, compare_models
    >>> strings = {"falling": BitRock(), "constant": BitRock(friction=Coulomb(static=0.8, kinetic=0.5))}
    >>> loops = {label: closed_loop(compose(wells.JANSEN_2, bit), inputs={"top.torque": "12 kN m"}) for label, bit in strings.items()}
    >>> priors = {label: {"bit.friction.static": Uniform(0.6, 1.0)} for label in loops}
    >>> found = compare_models(loops, {"severity": "1.1 +- 0.1"}, priors, "60 s", draws=32)
    >>> print({label: round(float(value), 1) for label, value in found.probabilities.items()})
    {'falling': 0.9, 'constant': 0.1}
    """
    if not isinstance(models, Mapping) or len(models) < 2:
        raise SceneError(f"Argument `models` must map at least two labels to loops, but it is {short(models)}.")
    if not isinstance(priors, Mapping) or {*priors} != {*models}:
        raise SceneError(f"Argument `priors` must have the labels of the models, {', '.join(models)}, but it is {short(priors)}.")
    left_out = left_out or {}
    if twice := [name for name in left_out if name in data]:
        raise SceneError(f"Argument `left_out` must hold no data that are used, but `{twice[0]}` is in both.")
    found, scores = {}, {}
    for k, (label, model) in enumerate(models.items()):
        loop = as_loop(model)
        folder = None if checkpoint is None else Path(checkpoint) / f"model_{k + 1:02d}"
        known = posterior(
            loop, data, priors[label], duration, metrics=metrics, draws=draws, accuracy=accuracy, seed=seed, checkpoint=folder
        )
        found[label] = known
        scores[label] = (
            _scores(loop, known, Measured.of(loop, left_out, duration, metrics, "left_out"), accuracy) if left_out else np.empty(0)
        )
    return ModelComparison(found, scores, tuple(left_out))


def _scores(loop: ClosedLoop, known: Posterior, left_out: Measured, accuracy: float) -> FloatArray:
    """Logarithm of the mean density of each datum that was left out over the draws of a posterior; -inf where no draw gives it."""
    from scipy.special import logsumexp

    logs = left_out.log_likelihoods(loop, known.names, known.samples, accuracy)
    found: FloatArray = logsumexp(logs, axis=0) - math.log(len(logs))
    return found
