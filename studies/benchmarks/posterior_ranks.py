"""Does a posterior say what it claims? Simulation-based calibration: the ranks of true numbers among the draws of their posteriors.

Numbers are drawn from the prior, a machine with them is measured with noise, and the posterior of that measurement is drawn. If the sampler is right, the
rank of each true number among independent draws is uniform over many repetitions: S. Talts and others (2018), arXiv 1804.06788. Posteriors that are too
narrow put too many ranks at both ends, a posterior that is shifted gives them a trend.

The machine: two inertias of Jansen and van den Steen under a stiff PI, whose torque at the surface is measured for 10 s, in means of 1 s with 200 N m of
noise; static and kinetic friction and weight are unknown, so that weight and friction trade against each other along a ridge. Settings of the sampler are
the defaults.

    python -m studies posterior_ranks [FOLDER] [--repetitions 400]        (goes on where an earlier call with the same folder was interrupted)
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from controllers import StiffPI
from models import BitRock, wells
from studies.command_line import parser_of
from toolbox import closed_loop, compose, sweep
from toolbox.files.journal import Journal
from toolbox.measuring import metrics
from toolbox.messages import progress_bar
from toolbox.probability import Normal, Uniform, drawn, posterior

LOOP = closed_loop(compose(wells.JANSEN_2, BitRock(weight=80e3)), StiffPI(reference=6.0))
PRIORS = {"bit.friction.static": Uniform(0.65, 1.1), "bit.friction.kinetic": Uniform(0.3, 0.6), "bit.weight": Uniform("50 kN", "110 kN")}
DURATION, NOISE, DRAWS = 10.0, 200.0, 256
READ = {f"torque {k}": metrics.mean("top.torque", float(k), k + 1.0) for k in range(int(DURATION))}

BINS = 20
"""Places of a rank; the ranks are among one draw less, chosen out of all, because particles that came from one particle are alike."""

SURE = 0.99
"""Probability with which uniform ranks lie in the bands."""


def ranked(k: int) -> tuple[list[int], int]:
    """(rank of the truth of each unknown among `BINS` - 1 draws of its posterior, number of runs) of repetition k."""
    truth = drawn(LOOP, PRIORS, 1, seed=10_000 + k)
    rng = np.random.default_rng([1, k])
    told = sweep(LOOP, truth, DURATION, metrics=READ)
    data = {name: Normal(float(told[name][0]) + NOISE * rng.standard_normal(), NOISE) for name in READ}
    found = posterior(LOOP, data, PRIORS, DURATION, metrics=READ, draws=DRAWS, seed=k)
    some = found.samples[rng.permutation(DRAWS)[: BINS - 1]]
    return (some < truth.points[0]).sum(axis=0).tolist(), found.runs


def bands(repetitions: int, draws: int = 20_000) -> tuple[int, int, float]:
    """(least, most) of a bin that all bins of a uniform histogram keep with 99 %, and the largest mean of normal scores of the ranks likewise."""
    rng = np.random.default_rng(0)
    counts = rng.multinomial(repetitions, np.full(BINS, 1.0 / BINS), size=draws)
    least, most = counts.min(axis=1), counts.max(axis=1)
    low, high = int(np.quantile(least, (1 - SURE) / 2)), int(np.quantile(most, 1 - (1 - SURE) / 2))
    trends = counts @ scores() / repetitions
    return low, high, float(np.quantile(np.abs(trends), SURE))


def scores() -> Any:
    """Normal scores of the ranks."""
    from scipy.special import ndtri

    return ndtri((np.arange(BINS) + 0.5) / BINS)


def judged(ranks: np.ndarray) -> list[dict[str, Any]]:
    """For each unknown its histogram, whether it lies within its bands, and how wide the scores are (1 where uniform, above it where posteriors are narrow)."""
    low, high, most = bands(len(ranks))
    wide = float(np.sqrt(np.mean(scores() ** 2)))
    found = []
    for name, row in zip(PRIORS, ranks.T, strict=True):
        counts = np.bincount(row, minlength=BINS)
        trend = float(counts @ scores() / len(ranks))
        found.append({
            "unknown": name, "counts": counts, "inside": bool(low <= counts.min() and counts.max() <= high and abs(trend) <= most),
            "trend": trend, "width": float(np.sqrt(counts @ scores() ** 2 / len(ranks))) / wide,
        })  # fmt: skip
    return found


def main() -> None:
    """Print the ranks of each unknown with their bands."""
    parser = parser_of(__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("posterior_ranks"))
    parser.add_argument("--repetitions", type=int, default=400)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    journal = Journal(
        given.folder / "ranks.jsonl",
        {"priors": str(PRIORS), "duration": str(DURATION), "noise": str(NOISE), "draws": str(DRAWS)},
        word="folder",
    )
    with progress_bar(given.repetitions, "posteriors") as bar:
        for k in range(given.repetitions):
            if (k,) not in journal.known:
                journal.add((k,), ranked(k))
            bar.update(1)
    ranks = np.array([journal.known[k,][0] for k in range(given.repetitions)])
    runs = np.array([journal.known[k,][1] for k in range(given.repetitions)])
    low, high, most = bands(given.repetitions)
    print(
        f"{given.repetitions} posteriors by {runs.mean():.0f} runs each; bands of {100 * SURE:g} %: {low} .. {high} in a bin, trend within {most:.3f}"
    )
    for each in judged(ranks):
        words = "inside" if each["inside"] else "OUTSIDE"
        print(f"{each['unknown']:24}{words:8} trend {each['trend']:+.3f}, width {each['width']:.3f}, {' '.join(map(str, each['counts']))}")


if __name__ == "__main__":
    main()
