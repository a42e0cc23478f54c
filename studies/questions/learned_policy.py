"""What does a policy that has learned on the rig, in the environment of gymnasium, beside PI and LQG in the same table?

The rig of Jansen and van den Steen at 97 347 N, top speed measured and torque commanded every 50 ms, 0 to 20 kN m, set-point 8 rad/s. The policy is linear,
with two numbers of memory:

    u = 10 kN m s/rad (a e + b z + c y),     z' = e, held at the limits,     y' = (e - y) / 0.5 s,     e = 8 rad/s - top speed

Its gains a, b, c are found by CMA-ES (`pip install -e '.[learning]'`) from (0.3, 0.1, 0): the return is minus the mean square of the error of the bit speed,
over episodes of 40 s that begin at drawn speeds and twist. It is then judged on the rig at standstill and in stick-slip, not by what it was trained with.

    python -m studies learned_policy [--evaluations 400] [--seed 1]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from controllers import LQG, SoftTorque, StiffPI
from models import BitRock, wells
from studies.command_line import parser_of
from studies.timing import timed
from toolbox import Controller, Sampled, Scene, Update, compose, state
from toolbox.onsets.verdicts import verdict_row
from toolbox.scenes.verdict_table import table

PERIOD, REFERENCE, HIGHEST, UNIT, MEMORY = 0.05, 8.0, 20e3, 1e4, 0.5
RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
FIRST = (0.3, 0.1, 0.0)
STARTS = {"standstill": {}, "stick-slip": {"chain.speed": (6.0, 0.0), "chain.twist": (18.0,)}}
EPISODES = 4
"""Episodes of each evaluation: the same for all policies of one generation."""


def acts(gains: Sequence[float], error: Any, total: Any, slow: Any) -> tuple[Any, Any, Any]:
    """(torque, memories after it) of the policy, of numbers or of casadi symbols."""
    wanted = UNIT * (gains[0] * error + gains[1] * total + gains[2] * slow)
    torque = ca.fmin(ca.fmax(wanted, 0.0), HIGHEST)
    return torque, total + PERIOD * error * (torque == wanted), slow + PERIOD / MEMORY * (error - slow)


@dataclass(frozen=True)
class LearnedPolicy(Controller):
    """The policy as a sampled law of the toolbox."""

    gains: tuple[float, ...] = FIRST
    reference: float = REFERENCE

    def sampled(self, signal, period):
        total, slow = state("policy.total", "rad"), state("policy.slow", "rad/s")
        error = signal("top.reference", "rad/s", default=self.reference) - signal("top.speed", "rad/s")
        torque, after, slower = acts(self.gains, error, total, slow)
        return Update(memory={total: after, slow: slower}, outputs={"top.torque": (torque, "N m")})


def training() -> Any:
    """The environment of gymnasium."""
    from toolbox.export.environment import environment

    return environment(
        RIG, PERIOD, 40.0, actions={"top.torque": (0.0, HIGHEST)}, observations={"top.speed": (-50.0, 50.0), "bit.speed": (-50.0, 50.0)},
        reward=lambda signals, switches: -((signals["bit.speed"] - REFERENCE) ** 2),
        start=lambda draw: {"chain.speed.0": draw.uniform(0.0, 12.0), "chain.speed.1": 0.0, "chain.twist.0": draw.uniform(0.0, 25.0)},
    )  # fmt: skip


def cost(made: Any, gains: Sequence[float], seeds: Sequence[int]) -> float:
    """Mean square error of the bit speed [rad2/s2] over an episode of each seed; the policy sees the top speed alone."""
    total, steps = 0.0, 0
    for seed in seeds:
        seen, _ = made.reset(seed=seed)
        angle, slow, late = 0.0, 0.0, False
        while not late:
            torque, angle, slow = acts(gains, REFERENCE - seen[0], angle, slow)
            seen, gain, _, late, _ = made.step(np.array([float(torque)]))
            total, steps = total - gain, steps + 1
    return total / steps


def train(evaluations: int, seed: int) -> tuple[tuple[float, ...], float, float]:
    """(gains, their cost on episodes that were not trained on, that of the first gains). Raises ImportError without `cma`."""
    try:
        import cma
    except ImportError:
        raise ImportError("Training needs cma: pip install -e '.[learning]' in the folder of the toolbox") from None
    made, draw = training(), np.random.default_rng(seed)
    search = cma.CMAEvolutionStrategy(list(FIRST), 0.2, {"seed": seed, "maxfevals": evaluations, "verbose": -9})
    while not search.stop():
        seeds = [int(each) for each in draw.integers(2**31, size=EPISODES)]
        asked = search.ask()
        search.tell(asked, [cost(made, each, seeds) for each in asked])
    found = tuple(float(each) for each in search.result.xfavorite)
    others = range(10)
    return found, cost(made, found, others), cost(made, FIRST, others)


def verdicts(gains: Sequence[float]) -> dict[str, str]:
    """{start: verdict table} of the policy beside PI, soft torque and LQG at the same period, limits and set-point."""
    limits = {"reference": REFERENCE, "lowest_torque": 0.0, "highest_torque": HIGHEST}
    laws = {"stiff PI": StiffPI(**limits), "soft torque": SoftTorque(**limits), "LQG": LQG(**limits), "policy before training": LearnedPolicy(),
            "policy, trained": LearnedPolicy(tuple(gains))}  # fmt: skip
    found = {}
    for word, start in STARTS.items():
        scene = Scene.of(
            RIG, 120.0, {label: Sampled(law, PERIOD) for label, law in laws.items()}, title=f"From {word}", start=start, after=60.0
        )
        found[word] = table(scene, [verdict_row(scene, label)[0] for label in laws], times=False)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Train, and print the tables."""
    parser = parser_of(__doc__)
    parser.add_argument("--evaluations", type=int, default=400, help="evaluations of a policy, of four episodes each")
    parser.add_argument("--seed", type=int, default=1, help="of the search and of the episodes")
    given = parser.parse_args(arguments)
    (gains, trained, first), spent = timed(lambda: train(given.evaluations, given.seed))
    print(f"a, b, c = {', '.join(f'{each:.4g}' for each in gains)} after {spent:.0f} s of processor time;")
    print(f"mean square error of the bit speed on ten episodes that were not trained on: {trained:.3g} (before: {first:.3g}) rad2/s2")
    for text in verdicts(gains).values():
        print(f"\n{text}")


if __name__ == "__main__":
    main()
