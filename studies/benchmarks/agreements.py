"""Do two ways to the same answer agree on systems that nobody chose?

    cones     one to three masses on a table in springs, which couple through their masses and rub in two directions under one cone each, pushed by forces
              that turn: steps of Runge and Kutta against Taylor series,
              or implicit steps, at a hundredth of the accuracy
    faces     an elastic body on a plate in two to six contacts with cones, which open: the step against a quarter of it
    delays    drill strings under sampled laws with delays and noise: a run that is cut at a random instant and carried on against the whole
    lanes     belts, drill strings and chains: runs side by side in lanes against runs one by one
    borders   wells: what the borders of `onset` say at a random set-point, on both branches, against a run of two hundred swings from each

Wrong is what differs by more than both ways say of their own errors, ten times over, or, of borders, another verdict. Refused is what ends in an error of the
toolbox, which is told. A motion that is not computable, because its own error grows beyond a hundredth, decides nothing, and is counted.

    python -m studies agreements [--systems 600] [--seed 1] [--family cones]
"""

from __future__ import annotations

import math
import time as clock
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from controllers import PI, SoftTorque
from models import BitRock, Coulomb, Exponential, wells
from studies.benchmarks.random_plants import belt, chain, rig
from studies.benchmarks.random_wells import rested, well
from studies.command_line import parser_of
from toolbox import Component, DryFriction, Equations, SceneError, SimulationError, closed_loop, compose, onset, simulate, state, sweep
from toolbox.contacts import ContactProblem, step_contacts
from toolbox.inputs import sine
from toolbox.measuring import measure
from toolbox.modelling.laws import Sampled

AGREE, UNDECIDED = "agree", "not computable"
COMPUTABLE = 1e-2
"""Own error of a motion beyond which it decides nothing."""


@dataclass(frozen=True)
class Table(Component):
    """Masses on a table, each in two springs to ground and in springs to the next one, with mass between all: q'' = mobility (F - K q - C q' + T)."""

    mobility: tuple[tuple[float, ...], ...]
    spring: tuple[float, ...]
    between: tuple[float, ...]
    load: tuple[float, ...]
    friction: Any = field(default=Coulomb(0.4, 0.3))

    def equations(self, signal):
        """Two coordinates a mass."""
        n = len(self.spring)
        q, v = state("table.q", "m", 2 * n), state("table.v", "m/s", 2 * n)
        force = ca.vertcat(*(signal(f"table.push.{k}", "N", default=0.0) for k in range(2 * n)))
        contacts, rubbing = [], []
        for k in range(n):
            contacts.append(DryFriction(f"rub{k}", ca.vertcat(v[2 * k], v[2 * k + 1]), self.friction, self.load[k]))
            rubbing.append(contacts[-1].force)
        stiffness = ca.diag(ca.vertcat(*self.spring))
        for k in range(n - 1):
            pull = ca.DM.zeros(n, 1)
            pull[k], pull[k + 1] = 1.0, -1.0
            stiffness += self.between[k] * (pull @ pull.T)
        inverse = ca.vertcat(*(ca.horzcat(*row) for row in self.mobility))
        rate = ca.kron(inverse, ca.DM.eye(2)) @ (force + ca.vertcat(*rubbing) - ca.kron(stiffness, ca.DM.eye(2)) @ q - 0.2 * v)
        return Equations({q: v, v: rate}, elements=contacts)


def cones(draw: np.random.Generator) -> str:
    """Friction in two directions, coupled through masses."""
    n = int(draw.integers(1, 4))
    root = draw.uniform(-0.4, 0.4, (n, n)) + np.diag(draw.uniform(0.7, 1.5, n))
    table = Table(
        tuple(map(tuple, np.linalg.inv(root @ root.T))),
        tuple(draw.uniform(2.0, 40.0, n)), tuple(draw.uniform(2.0, 40.0, n - 1)), tuple(draw.uniform(5.0, 20.0, n)),
        Coulomb(0.4, 0.4) if draw.random() < 0.5 else Exponential(0.5, 0.3, draw.uniform(0.5, 3.0)),
    )  # fmt: skip
    inputs = {
        f"table.push.{k}": sine(draw.uniform(-2, 2), draw.uniform(0, 12), draw.uniform(0.1, 1.0), phase=draw.uniform(0, 6))
        for k in range(2 * n)
    }
    plant = compose(table)
    one = simulate(plant, 10.0, inputs=inputs, accuracy=1e-7, method="explicit")
    other = simulate(plant, 10.0, inputs=inputs, accuracy=1e-9, method="taylor" if n == 1 else "stiff")
    times = np.linspace(0.0, 10.0, 101)
    return within(one.at(times)["table.q"], other.at(times)["table.q"], one.error_estimate + other.error_estimate + 1e-7)


def faces(draw: np.random.Generator) -> str:
    """Contacts of an elastic body."""
    n = int(draw.integers(2, 7))
    size = 3 * n
    root = draw.normal(size=(size, size)) * 0.3
    stiffness = 200.0 * (root @ root.T + np.eye(size))
    axes = np.eye(size)
    problem = ContactProblem(
        np.diag(draw.uniform(0.5, 2.0, size)), stiffness, axes[: 2 * n].reshape(n, 2, size), Coulomb(0.35, 0.35), normal=-axes[2 * n :],
        damping=0.02 * stiffness, force_inputs={"press": -axes[2 * n :].sum(axis=0), "pull": axes[0 : 2 * n : 2].sum(axis=0)},
    )  # fmt: skip
    inputs = {"press": draw.uniform(5.0, 20.0), "pull": sine(0.0, draw.uniform(1.0, 20.0), draw.uniform(0.5, 2.0))}
    step = 1e-3
    one, other = (step_contacts(problem, 1.0, step=step / part, inputs=inputs) for part in (1, 4))
    return within(one.coordinates, other.coordinates[::4], one.error, 0.2)


def delays(draw: np.random.Generator) -> str:
    """A sampled loop that is cut and carried on."""
    law = [PI(4000.0, 1500.0, reference=9.0), SoftTorque(reference=9.0)][int(draw.integers(2))]
    period = float(draw.choice([0.01, 0.02, 0.05]))
    plant = compose([wells.JANSEN_2, wells.NAVARRO_LOPEZ_4][int(draw.integers(2))], BitRock(weight=draw.uniform(3e4, 1e5)))
    sampled = Sampled(law, period, float(draw.uniform(0.0, 3.0)) * period, noise={"top.speed": 0.01}, seed=int(draw.integers(1000)))
    loop = closed_loop(plant, sampled)
    whole = simulate(loop, 40.0)
    cut = draw.uniform(5.0, 35.0)
    rest = simulate(loop, 40.0 - cut, start=simulate(loop, cut).last)
    return within(rest["bit.speed"][-1], whole["bit.speed"][-1], 1e-8)


def lanes(draw: np.random.Generator) -> str:
    """Runs side by side."""
    plant, duration, given = (belt, rig, chain)[int(draw.integers(3))](draw)
    law = given.pop("controller", None)
    loop = closed_loop(plant, law, element=plant.elements[-1].name, signal=speed_of(plant), **given)
    name = next(name for name in ("block.mass", "chain.inertia.0") if plant.has_parameter(name))
    values = loop.number(name).value * draw.uniform(0.8, 1.2, 4)
    values = np.sort(values)
    found = sweep(loop, {name: values}, duration=duration, metrics="severity")
    runs = [simulate(loop.at(name, value), duration) for value in values]
    alone = [sweep(loop, {name: [value]}, duration=duration, metrics="severity") for value in values]
    return within(
        np.ravel(found["severity"]),
        np.concatenate([np.ravel(each["severity"]) for each in alone]),
        max(run.error_estimate for run in runs) + 1e-6,
    )


def speed_of(plant: Any) -> str:
    """The speed that is judged."""
    return next(name for name in ("bit.speed", "belt.slip", "chain.speed.0") if plant.has_signal(name))


def borders(draw: np.random.Generator) -> str:
    """Verdicts at a random set-point."""
    drawn = well(int(draw.integers(10_000)), 7)
    found = onset(drawn.loop, "top.reference", (2.0, 14.0), num_values=3)
    value = draw.uniform(2.2, 13.8)
    near = min((abs(border.value - value) / value for _, border in found.borders), default=1.0)
    if near < 0.03:
        return "beside a border"
    loop = drawn.loop.at("top.reference", value)
    start = rested(drawn, value)
    start["chain.speed"] = np.append(start["chain.speed"][:-1], (1.0 + 1e-3) * start["chain.speed"][-1])
    calm = simulate(loop.replace(start=start), 200.0 * drawn.swing)
    sticks = bool(measure.stick_intervals(calm, "bit", 150.0 * drawn.swing))
    regimes = found.regimes(value)
    if sticks and "smooth" in regimes and "stick-slip" not in regimes:
        return "wrong: sticks where only smooth running is said to be"
    if not sticks and "smooth" not in regimes and math.isfinite(found.end):
        late = simulate(loop.replace(start=start), 1000.0 * drawn.swing)
        if not measure.stick_intervals(late, "bit", 800.0 * drawn.swing):
            return "wrong: smooth where smooth running is said to be lost"
    return AGREE


def within(one: np.ndarray, other: np.ndarray, error: float, computable: float = COMPUTABLE) -> str:
    """What two answers are, in parts of their size; computable: own error beyond which a motion decides nothing, larger for steps of first order."""
    if not error < computable:
        return UNDECIDED
    if not np.array_equal(np.isfinite(one), np.isfinite(other)):
        return "wrong: one of them says nothing"
    one, other = (np.nan_to_num(each, posinf=0.0, neginf=0.0) for each in (one, other))
    apart = float(np.abs(one - other).max()) / max(float(np.abs(other).max()), 1e-12)
    return AGREE if apart <= 10.0 * error else f"wrong: apart by {apart:.1e}, told {error:.1e}"


FAMILIES: Mapping[str, Callable[[np.random.Generator], str]] = {
    "cones": cones, "faces": faces, "delays": delays, "lanes": lanes, "borders": borders,
}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run it; returns 1 where something is wrong."""
    parser = parser_of(__doc__)
    parser.add_argument("--systems", type=int, default=600, help="systems of each family (600)")
    parser.add_argument("--family", choices=FAMILIES, action="append", help="only this one; may be repeated")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    bad = 0
    for family in given.family or FAMILIES:
        found: Counter[str] = Counter()
        began = clock.process_time()
        for number in range(given.systems):
            try:
                told = FAMILIES[family](np.random.default_rng([given.seed, number, sorted(FAMILIES).index(family)]))
            except (SceneError, SimulationError) as error:
                told = f"refused: {type(error).__name__}"
                print(f"  {family} {number}: {str(error)[:200]}", flush=True)
            if told.startswith("wrong"):
                print(f"  {family} {number}: {told}", flush=True)
                told, bad = "wrong", 1
            found[told] += 1
        words = ", ".join(f"{count} {word}" for word, count in found.most_common())
        print(f"{family:9}{words}; {clock.process_time() - began:.0f} s of the processor", flush=True)
    return bad


if __name__ == "__main__":
    raise SystemExit(main())
