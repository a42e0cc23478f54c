"""Least squares from several starts, without the few samples that break the law, and what the Jacobian at the end says of the numbers."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import number
from toolbox.calibration.identifiable import MUTE, condition_of
from toolbox.calibration.residuals import residuals
from toolbox.calibration.resting import Resting, resting
from toolbox.calibration.results import Fit
from toolbox.calibration.trust import correlated, deviation, is_white, memory, residual_of, sampling_error, step_of
from toolbox.calibration.weights import alike, repeats_of, rows_of, trusted
from toolbox.errors import SceneError, SimulationError
from toolbox.messages import progress_bar

NOTHING = 1e-60
"""Slope of the residuals, in parts of the noise and for a change of a number by its own size, that is no slope: the search scales a number by it, and the
fourth power of less overflows."""

ROUNDS = 10
"""Fits, at most, after each of which other samples are left out, or weigh otherwise."""

CLEAR = 1e3
"""F-value by the slopes from which on static and kinetic friction are told apart without a fit that takes them for one."""

BALANCES = 4
"""Fits, at most, between which recordings get other shares."""

SAME = 0.1
"""Relative difference of the shares of a recording that is none."""

DRAWS = 10
"""Starts that are drawn for every one that is wanted, because some contradict themselves or cannot be simulated."""


def _product(tall: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """tall @ ways, without the threads of @, which wait for each other for longer than so thin a product takes."""
    return np.einsum("ni,ij->nj", tall, ways)


def _inverse(jacobian: np.ndarray) -> np.ndarray:
    """(J^T J)^-1, its columns scaled to length one before. Raises LinAlgError if J^T J is singular."""
    lengths = np.sqrt(np.einsum("ni,ni->i", jacobian, jacobian))
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    scaled = jacobian / lengths
    found: np.ndarray = np.linalg.inv(np.einsum("ni,nj->ij", scaled, scaled)) / np.outer(lengths, lengths)
    return found


def _tolerances(roughly: bool) -> dict[str, Any]:
    """Where a search ends: of a thousandth of a standard error, or where few digits will do."""
    return (
        {"xtol": 1e-4, "ftol": 1e-4, "gtol": 1e-12, "max_nfev": 30}
        if roughly
        else {"xtol": 1e-10, "ftol": 1e-10, "gtol": 1e-12, "max_nfev": 100}
    )


@dataclass
class LeastSquares:
    """Least squares from several starts, and what the Jacobian at the end says."""

    misfit: Any
    names: tuple[str, ...]
    units: tuple[str, ...]
    first: np.ndarray
    low: np.ndarray
    high: np.ndarray
    noise: Mapping[str, float] | None
    robust: float | None
    starts: int
    seed: int
    confidence: float
    growing: bool = True
    weights: dict[str, np.ndarray] = field(default_factory=dict, init=False)
    repeats: dict[str, np.ndarray] = field(default_factory=dict, init=False)
    shares: dict[str, np.ndarray] = field(default_factory=dict, init=False)

    def fit(self) -> Fit:
        misfit = self.misfit
        sizes = self._sizes()
        values, scales, agreement = self._approached(roughly=self._has_several_scales())
        if self._has_several_scales():
            values = self._descend(values, scales, [misfit]).x
        values, scales = self._without_strays(values, scales, sizes)
        size = self._size(values)
        jacobian, left = self._weighed(misfit.slopes(values, size), scales), self._left(values)
        rest = resting(misfit, values, size, jacobian, self._weighed(left, scales), self.low, self.high)
        equal = (
            self._rising_by_chance(rest, values, jacobian, self._weighed(left, scales))
            if rest.why
            else self._equal(values, scales, jacobian, left)
        )
        if equal:
            values, rest = self._as_one(values, equal, scales)
        elif rest.why:
            values = self._along(rest.values, rest.directions, scales) if rest.together else rest.values
        if equal or rest.why:
            jacobian, left = self._weighed(misfit.slopes(values, self._size(values)), scales), self._left(values)
        return self._result(values, scales, rest, equal, (jacobian, left), agreement)

    def near(self) -> np.ndarray:
        """Numbers near the optimum, with few digits."""
        return self._approached(roughly=True)[0]

    def _approached(self, roughly: bool) -> tuple[np.ndarray, dict[str, float], tuple[int, int]]:
        """(numbers near the optimum, scales there, (searches that ended there, all)); roughly: whether few digits will do."""
        misfit = self.misfit
        self.repeats = self._repeats_of_samples()
        self.shares = self.repeats
        scales = self._given_noise(self._sizes())
        trial = misfit.trial()
        found = self._from_all_starts(trial, scales)
        best = min(found, key=lambda each: each.cost)
        agreement = int(sum(each.cost <= best.cost * (1 + 1e-3) + 1e-12 for each in found)), len(found)
        values = best.x if trial is misfit else self._descend(best.x, scales, [misfit], roughly=roughly).x
        if self._has_several_scales():
            values, scales = self._rebalanced(values, scales, self._sizes())
        return values, scales, agreement

    def _sizes(self) -> dict[str, float]:
        """Standard deviation of each signal, 1 of one that is constant."""
        return {name: float(np.std(values)) or 1.0 for name, values in self.misfit.measured.items()}

    def _repeats_of_samples(self) -> dict[str, np.ndarray]:
        """Weights of samples that repeat each other, of a fit by simulation."""
        misfit = self.misfit
        return {} if misfit.by_samples else {name: repeats_of(misfit.measured[name], misfit.blocks(name)) for name in misfit.outputs}

    def _has_several_scales(self) -> bool:
        """Whether signals or recordings have weights of their own by their residuals; that of one alone changes nothing."""
        return self.noise is None and sum(len(self.misfit.blocks(name)) for name in self.misfit.outputs) > 1

    def _rebalanced(self, values: np.ndarray, scales: dict[str, float], sizes: Mapping[str, float]) -> tuple[np.ndarray, dict[str, float]]:
        """Numbers, with few digits, where the weights are those of their residuals; and the scales there."""
        for _ in range(BALANCES):
            before = self.shares
            scales = self._balanced(values, sizes)
            if before is not self.repeats and all(np.allclose(self.shares[name], before[name], rtol=SAME) for name in before):
                break
            values = self._descend(values, scales, [self.misfit], roughly=True).x
        return values, scales

    def _result(
        self,
        values: np.ndarray,
        scales: Mapping[str, float],
        rest: Resting,
        equal: str,
        end: tuple[np.ndarray, dict[str, np.ndarray]],
        agreement: tuple[int, int],
    ) -> Fit:
        """What slopes and residuals at the end say of the numbers. end: both;  agreement: searches that ended there, and all."""
        from scipy.special import stdtrit

        misfit, size, ways, (jacobian, left) = self.misfit, self._size(values), rest.directions, end
        sizes = self._sizes()
        weights = np.concatenate([np.full(left[name].size, scales[name] / sizes[name]) for name in left])
        per_part = _product(jacobian * weights[:, None], size[:, None] * ways)
        heard = np.sqrt((per_part**2).mean(axis=0)) >= MUTE
        if not (rest.why or equal):  # the start of a run that begins at rest has no influence, which is no fault of the others
            start = np.array([number.is_start for number in misfit.numbers])
            heard |= (ways[~start] != 0.0).any(axis=0)
        labels = [" = ".join(name for name, part in zip(self.names, way, strict=True) if part) for way in ways.T[heard]]
        condition = condition_of(labels, per_part[:, heard], dict(zip(self.names, values.tolist(), strict=True)))
        ways, mute = ways[:, heard], np.asarray(ways[:, ~heard].any(axis=1))
        jacobian = _product(jacobian, ways)
        n, k = self._samples(), jacobian.shape[1]
        if n <= k:
            raise SceneError(f"The data must hold more values than there are free numbers, but they hold {n:g} for {k}.")
        left_of = [
            residual_of(name, misfit.plant.unit(name), (left[name] * own)[own > 0.0], misfit.measured[name][own > 0.0])
            for name, own in self._all_weights().items()
        ]
        weighed = self._weighed(left, scales)
        inverse = _inverse(jacobian)
        middle = self._middle(jacobian, weighed, scales, n / (n - k))
        covariance = ways @ inverse @ middle @ inverse @ ways.T
        variances = np.diag(covariance)
        np.fill_diagonal(covariance, np.where(mute | ~(variances >= 0.0), math.inf, variances))
        factor = float(stdtrit(n - k, 0.5 + self.confidence / 2))
        span = np.where(np.isfinite(self.high - self.low), self.high - self.low, self._size(values))
        edge = np.minimum(values - self.low, self.high - values) < 1e-6 * span
        count = sum(each.size for each in misfit.measured.values())
        measured = f"{count} measured values over {misfit.span:g} s ({misfit.source}), {misfit.how}"
        return Fit(
            self.names, self.units, values, np.sqrt(np.diag(covariance)), covariance, self.confidence, factor,
            tuple(left_of), condition,
            tuple(name for i, name in enumerate(self.names) if edge[i] or i in rest.why), *agreement, measured,
            misfit.exact, misfit.panels(left, values), misfit,
            {self.names[i]: words for i, words in rest.why.items()}, tuple(name for name, silent in zip(self.names, mute.tolist(), strict=True) if silent),
            ways @ sampling_error(misfit, values, jacobian, scales),
            outliers={name: own == 0.0 for name, own in self.weights.items() if not own.all()}, indistinguishable_friction=equal,
            initial_mismatch=misfit.apart(values),
        )  # fmt: skip

    def _middle(self, jacobian: np.ndarray, weighed: np.ndarray, scales: Mapping[str, float], lost: float) -> np.ndarray:
        """J^T G J of all recordings, G: covariance of their residuals; lost: samples as a multiple of those that the free numbers leave."""
        middle, begin, misfit = np.zeros((jacobian.shape[1],) * 2), 0, self.misfit
        for name, own in self._all_weights().items():
            repeats = self.repeats.get(name, np.ones(own.size))
            shares = self.shares.get(name, repeats)
            for rows in rows_of(misfit.blocks(name)):
                place = slice(begin, begin := begin + rows.stop - rows.start)
                good = own[rows] > 0.0
                if not good.any():
                    continue
                share = float((shares[rows] / repeats[rows]).max())
                variance = float(np.sum(weighed[place] ** 2) / np.sum(repeats[rows][good] ** 2))
                least = share * step_of(misfit.measured[name][rows], repeats[rows]) / (scales[name] * math.sqrt(12.0))
                left = weighed[place] / np.where(good, shares[rows], 1.0)
                middle += correlated(jacobian[place], weighed[place], max(variance, least**2) * lost, not is_white(left[good]))
        return middle

    def _all_weights(self) -> dict[str, np.ndarray]:
        """{signal: weights of its samples}, 0 of one that does not count."""
        return {name: self.weights.get(name, np.ones(self.misfit.measured[name].size)) for name in self.misfit.outputs}

    def _without_strays(
        self, values: np.ndarray, scales: dict[str, float], sizes: Mapping[str, float]
    ) -> tuple[np.ndarray, dict[str, float]]:
        """The optimum without the few samples that break the law, found anew until no other samples do; and the scales then."""
        if self.robust is None and not any(np.isfinite(self.misfit.deviations(name)).any() for name in self.misfit.outputs):
            return values, scales
        for _ in range(ROUNDS):
            left = self._left(values)
            weights = {name: trusted(self.misfit, name, each, sizes[name], self.robust, self.noise) for name, each in left.items()}
            if all(alike(weights[name], each) for name, each in self._all_weights().items()):
                break
            self.weights = weights
            if self._has_several_scales():
                scales = self._balanced(values, sizes)
            values = self._descend(values, scales, [self.misfit]).x
        return values, scales

    def _balanced(self, values: np.ndarray, sizes: Mapping[str, float]) -> dict[str, float]:
        """Scales of all signals by their residuals, and with them the share of each recording: by how many of its samples tell anything new.

        Residuals that repeat each other, as by noise of the force, would else outweigh the few independent samples of another recording.
        """
        scales, shares, left = {}, {}, self._left(values)
        for name, own in self._all_weights().items():
            repeats = self.repeats.get(name, np.ones(own.size))
            parts, least = [], 1e-9 * sizes[name]
            for rows in rows_of(self.misfit.blocks(name)):
                good = own[rows] > 0.0
                rms = max(deviation(left[name][rows][good], repeats[rows][good], self.misfit.measured[name][rows]), least)
                parts.append(np.full(good.size, rms * (memory(left[name][rows][good]) if self.repeats else 1.0)))
            each = np.concatenate(parts)
            scales[name] = float(each.min())
            shares[name] = repeats * scales[name] / each
        if self.repeats:
            self.shares = shares
        return scales

    def _samples(self) -> float:
        """Number of samples that count, one for all that repeat one value of an encoder."""
        return sum(
            float(np.sum(self.repeats[name][own > 0.0] ** 2)) if self.repeats else float(np.count_nonzero(own))
            for name, own in self._all_weights().items()
        )

    def _equal(self, values: np.ndarray, scales: Mapping[str, float], jacobian: np.ndarray, left: Mapping[str, np.ndarray]) -> str:
        """The law whose static friction the data cannot tell from the kinetic one; none where they can, or only one is free."""
        from scipy.stats import f as fisher

        laws = [
            name.removesuffix("static")
            for name in self.names
            if name.endswith(".static") and name.removesuffix("static") + "kinetic" in self.names
        ]
        square = float((self._weighed(left, scales) ** 2).sum()) / max(len(jacobian) - len(self.names), 1)
        for law in laws:
            pair = np.array([(each == f"{law}static") * 1.0 - (each == f"{law}kinetic") for each in self.names])
            told = (jacobian != 0.0).any(axis=0)  # the start of a run at rest has no influence
            with contextlib.suppress(np.linalg.LinAlgError):
                variance = square * float(pair[told] @ _inverse(jacobian[:, told]) @ pair[told])
                if told[pair != 0.0].all() and 0.0 < CLEAR * variance < float(pair @ values) ** 2:
                    continue
            mute = not (jacobian[:, self.names.index(f"{law}static")] != 0.0).any()
            try:
                one, rest = self._as_one(values, law, scales, values[self.names.index(f"{law}kinetic")] if mute else None, roughly=True)
            except (SceneError, SimulationError):
                continue
            squares = [float((self._weighed(self._left(each), scales) ** 2).sum()) for each in (values, one)]
            n = self._samples()
            ways = self._weighed(self.misfit.slopes(one, self._size(one)), scales) @ rest.directions
            fewer = len(self.names) - int((ways != 0).any(axis=0).sum())
            if fewer < 1 or n <= len(self.names) or squares[0] <= 0.0:
                continue
            ratio = max(squares[1] - squares[0], 0.0) / fewer / (squares[0] / (n - len(self.names)))
            if fisher.sf(ratio, fewer, n - len(self.names)) > 0.05:
                return law
        return ""

    def _rising_by_chance(self, rest: Resting, values: np.ndarray, jacobian: np.ndarray, left: np.ndarray) -> str:
        """The law whose static friction rests on the kinetic one where friction that rises with speed would describe the data no better than chance."""
        from scipy.stats import f as fisher

        law = self.names[rest.together[0]].rpartition(".")[0] + "." if len(rest.together) == 2 else ""
        if {self.names[i] for i in rest.together} != {law + "static", law + "kinetic"}:
            return ""
        apart, one = jacobian[:, list(rest.together)], jacobian[:, list(rest.together)].sum(axis=1, keepdims=True)
        squares = [float(((left - each @ np.linalg.lstsq(each, left, rcond=None)[0]) ** 2).sum()) for each in (apart, one)]
        n = int((left != 0.0).sum())
        ratio = (squares[1] - squares[0]) * (n - 2) / squares[0] if n > 2 and squares[0] > 0.0 else math.inf
        return law if fisher.sf(ratio, 1, n - 2) > 0.05 else ""

    def _as_one(
        self, values: np.ndarray, law: str, scales: Mapping[str, float], first: float | None = None, roughly: bool = False
    ) -> tuple[np.ndarray, Resting]:
        """The optimum with static friction equal to kinetic, and how the numbers move there.

        first: where it is searched from, their mean by default;  roughly: whether few digits will do.
        """
        pair = tuple(self.names.index(f"{law}{word}") for word in ("static", "kinetic"))
        level = values.copy()
        level[list(pair)] = np.clip(
            values[list(pair)].mean() if first is None else first, self.low[list(pair)].max(), self.high[list(pair)].min()
        )
        rest = Resting({}, level, pair)
        ways = rest.directions
        heard = np.asarray((self._weighed(self.misfit.slopes(level, self._size(level)), scales) @ ways != 0).any(axis=0))
        return self._along(level, ways[:, heard], scales, roughly), rest

    def _along(self, values: np.ndarray, ways: np.ndarray, scales: Mapping[str, float], roughly: bool = False) -> np.ndarray:
        """Where least squares end in these directions, in which numbers that rest on each other move as one; roughly: whether few digits will do."""
        from scipy.optimize import least_squares

        size = self._size(values)
        length = np.array([size[way != 0].max() for way in ways.T])
        low = np.array([np.max((self.low - values)[way != 0]) for way in ways.T]) / length
        high = np.array([np.min((self.high - values)[way != 0]) for way in ways.T]) / length

        def slopes(z: np.ndarray) -> np.ndarray:
            return self._weighed(self.misfit.slopes(values + ways @ (z * length), size), scales) @ ways * length

        found = least_squares(
            lambda z: self._heard(residuals(self.misfit, values + ways @ (z * length), scales)), np.zeros(ways.shape[1]), slopes,
            bounds=(np.minimum(low, -1e-15), np.maximum(high, 1e-15)), **_tolerances(roughly),
        )  # fmt: skip
        moved: np.ndarray = values + ways @ (found.x * length)
        return moved

    def _from_all_starts(self, trial: Any, scales: Mapping[str, float]) -> list[Any]:
        """What every start comes to that can be simulated; raises the first error where none can."""
        found: list[Any] = []
        reason: Exception | None = None
        evaluations = itertools.count(1)
        parts = trial.horizons() if self.growing else [trial]
        with progress_bar(self.starts, "fit", unit="start") as bar:
            for begin in self._begins():
                if len(found) == self.starts:
                    break
                try:
                    found.append(self._descend(begin, scales, parts, lambda: bar.set_postfix_str(f"{next(evaluations)} evaluations")))
                    bar.update()
                except (SceneError, SimulationError) as error:  # numbers that contradict each other, or cannot be simulated
                    reason = reason or error
        if not found:
            raise reason or SimulationError("No start of the fit could be simulated.")
        return found

    def _weighed(self, found: Mapping[str, np.ndarray], scales: Mapping[str, float]) -> np.ndarray:
        """All signals in a row, in parts of their noise; nothing where a sample does not count."""
        return self._heard(np.concatenate([found[name] / scales[name] for name in self.misfit.outputs]))

    def _heard(self, row: np.ndarray) -> np.ndarray:
        """What stands in a row of all signals, each sample by its weight."""
        for each in (self.weights, self.shares):
            if each:
                weights = np.concatenate([each[name] for name in self.misfit.outputs])
                row *= weights if row.ndim == 1 else weights[:, None]
        return row

    def _given_noise(self, sizes: Mapping[str, float]) -> dict[str, float]:
        if self.noise is None:
            return dict(sizes)
        return {name: number(f"noise.{name}", self.noise.get(name), above=0) for name in self.misfit.outputs}

    def _size(self, values: np.ndarray) -> np.ndarray:
        """What a number is measured by: its value, or the declared one, or the width of its bounds where both are zero."""
        width = np.where(np.isfinite(self.high - self.low), self.high - self.low, 1.0)
        size = np.maximum(np.abs(values), np.abs(self.first))
        return np.where(size > 0, size, width)

    def _begins(self) -> list[np.ndarray]:
        size = self._size(self.first)
        around = (self.first - 0.5 * size, self.first + size)  # half and twice
        low = np.where(np.isfinite(self.high - self.low), self.low, np.maximum(around[0], self.low))
        high = np.where(np.isfinite(self.high - self.low), self.high, np.minimum(around[1], self.high))
        inside = np.clip(self.first, self.low + 1e-6 * (high - low), self.high - 1e-6 * (high - low))
        if self.starts == 1:
            return [inside]
        from scipy.stats import qmc  # here, because it is slow to import

        drawn = qmc.LatinHypercube(len(self.names), rng=self.seed).random(DRAWS * (self.starts - 1))
        return [inside, *(low + drawn * (high - low))]

    def _descend(
        self,
        begin: np.ndarray,
        scales: Mapping[str, float],
        horizons: Sequence[Any],
        tell: Callable[[], object] = lambda: None,
        roughly: bool = False,
    ) -> Any:
        """Where least squares end from some numbers, over longer and longer parts of the data.

        tell: called after each evaluation of the model;  roughly: whether few digits will do, because a search with other weights follows.
        """
        from scipy.optimize import least_squares

        size = self._size(self.first)
        values = begin
        for misfit in horizons:
            values = self._nearer(misfit, values, begin, scales)
            ways, low, high = self._rising(values) if not misfit.by_samples else (np.eye(values.size), self.low, self.high)
            back = np.linalg.inv(ways)

            def slopes(q: np.ndarray, misfit: Any = misfit, ways: np.ndarray = ways) -> np.ndarray:
                at = ways @ (q * size)
                found = misfit.slopes(at, self._size(at))
                row = np.concatenate([_product(found[name] / scales[name], ways * size) for name in misfit.outputs])
                row[:, np.abs(row).max(axis=0) < NOTHING] = 0.0
                return self._heard(row) if misfit is self.misfit else row

            def left(q: np.ndarray, misfit: Any = misfit, ways: np.ndarray = ways) -> np.ndarray:
                tell()
                row = residuals(misfit, ways @ (q * size), scales)
                return self._heard(row) if misfit is self.misfit else row

            whole = misfit is self.misfit and not roughly
            given: dict[str, Any] = {"fun": left, "jac": slopes, "x0": np.clip(back @ values, low, high) / size}
            given |= {
                "x_scale": "jac",
                **_tolerances(not whole),
            }
            found: Any = self._unbounded(given, size) if misfit.by_samples else None
            found = found or least_squares(**given, bounds=(low / size, high / size))
            values = np.clip(ways @ (found.x * size), self.low, self.high)
        found.x = values
        return found

    def _nearer(self, misfit: Any, values: np.ndarray, begin: np.ndarray, scales: Mapping[str, float]) -> np.ndarray:
        """The numbers at which a search goes on: those of the shorter data, unless its begin is nearer to the longer data, of which the shorter ones did not
        tell all. Raises the error that says why the begin cannot be simulated.
        """
        if values is begin:
            misfit.model(values)
            return values
        costs = [float(np.nansum(row**2)) if np.isfinite(row).all() else math.inf for row in
                 (residuals(misfit, each, scales) for each in (values, begin))]  # fmt: skip
        if not math.isfinite(min(costs)):
            misfit.model(values)
        return values if costs[0] <= costs[1] else begin

    def _rising(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the directions of a search by simulation, and its bounds: static friction as kinetic friction and what it is above that, at least 0.

        A static friction that the data hardly feel would else be a wall for the kinetic one, which must not exceed it.
        """
        ways, low, high = np.eye(values.size), self.low.copy(), self.high.copy()
        for i, name in enumerate(self.names):
            if name.endswith(".static") and (below := name.removesuffix("static") + "kinetic") in self.names:
                k = self.names.index(below)
                if values[i] >= values[k]:
                    ways[i, k], low[i], high[i] = 1.0, 0.0, max(self.high[i] - self.low[k], 0.0) or math.inf
        return ways, low, high

    def _unbounded(self, given: Mapping[str, Any], size: np.ndarray) -> Any:
        """Where the method of Levenberg and Marquardt ends, which takes a third of the time for long data; None where a bound is or comes near."""
        from scipy.optimize import OptimizeResult, leastsq

        low, high = self.low / size + 1e-3, self.high / size - 1e-3
        # the covariance that scipy adds is not used, and of a number without influence it overflows
        with contextlib.suppress(SceneError, SimulationError), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            if np.all(given["x0"] > low) and np.all(given["x0"] < high):
                tolerances = {name: given[name] for name in ("xtol", "ftol", "gtol")}
                x, _, told, _, status = leastsq(
                    given["fun"],
                    given["x0"],
                    Dfun=lambda q: given["jac"](q).T,
                    col_deriv=True,
                    full_output=True,
                    maxfev=given["max_nfev"],
                    **tolerances,
                )
                if status in (1, 2, 3, 4) and np.all(x > low) and np.all(x < high):
                    return OptimizeResult(x=x, cost=0.5 * float(np.einsum("i,i->", told["fvec"], told["fvec"])))
        return None

    def _left(self, values: np.ndarray) -> dict[str, np.ndarray]:
        model = self.misfit.model(values)
        return {name: model[name] - self.misfit.measured[name] for name in self.misfit.outputs}
