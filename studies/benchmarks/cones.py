"""Random bodies that rub on the ground and on each other in two directions, under loads and pulls that change in time: two or three cones that couple.

    m v' = pull(t) - c v + sum of forces        stick: v_rel = 0, |F| <= static        slip: F = - kinetic v_rel / |v_rel|

No closed form exists. What is asked of a run is that it ends within a number of steps, obeys the law of the cone at every node, and that its energies close. A
slip below what two cones are told apart by has no direction yet and is left out. Lengths, times and masses are scaled by up to ten to the power of +-6.

    python -m studies fuzz --section cones [--structures 300] [--seed 1] [--first N]
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from models import Coulomb
from toolbox import (
    Component,
    DryFriction,
    Equations,
    Quantity,
    SceneError,
    SimulationError,
    compose,
    energy_audit,
    quantity,
    simulate,
    state,
)
from toolbox.inputs import sine
from toolbox.modelling import Quantities

METHODS = ("event", "explicit", "stiff")
MOST_STEPS = 20_000
"""Steps that a run of some ten switches may take: a break-away that creeps takes some hundred explicit ones."""
CREEPS = 1e-3
"""Slip below this part of the largest may still be led to its direction."""


@dataclass(frozen=True)
class Sliders(Component):
    """Bodies in a plane; `rubs` names for each contact its body and what it rubs on: another body, or -1 for the ground."""

    mass: Quantities = quantity((0.5, 0.7), "kg", "masses", above=0)
    damping: Quantity = quantity(0.0, "N s/m", "viscous drag of every body", at_least=0)
    static: Quantities = quantity((1.0, 0.73), "1", "coefficients at rest", above=0)
    kinetic: Quantities = quantity((1.0, 0.73), "1", "coefficients while sliding", above=0)
    direction: Quantities = quantity((0.0, 1.5), "rad", "directions of the pulls")
    rubs: tuple[tuple[int, int], ...] = ((0, -1), (1, 0))

    def equations(self, signal):
        bodies, flow, elements = [], {}, []
        losses: dict[str, Any] = {}
        supplies: dict[str, Any] = {}
        for i, mass in enumerate(self.mass):
            v = state(f"plane.v{i}", "m/s", 2)
            pull = signal(f"plane.pull{i}", "N", default=0.0) * ca.vertcat(ca.cos(self.direction[i]), ca.sin(self.direction[i]))
            bodies.append([v, mass, pull - self.damping * v])
            losses[f"drag{i}"] = self.damping * ca.sumsqr(v)
            supplies[f"pull{i}"] = ca.dot(pull, v)
        for k, (body, other) in enumerate(self.rubs):
            slip = bodies[body][0] - (bodies[other][0] if other >= 0 else 0.0)
            law = Coulomb(self.static[k], self.kinetic[k])
            contact = DryFriction(f"rub{k}", slip, law, signal(f"plane.load{k}", "N", default=1.0))
            elements.append(contact)
            bodies[body][2] += contact.force
            if other >= 0:
                bodies[other][2] -= contact.force
            losses[f"rub{k}"] = -ca.dot(contact.force, slip)
        for v, mass, force in bodies:
            flow[v] = force / mass
        return Equations(
            flow, elements=elements, stored=sum(mass * ca.sumsqr(v) for v, mass, _ in bodies) / 2, losses=losses, supplies=supplies
        )


def trial(seed: int, number: int) -> tuple[Sliders, dict[str, Any], float]:
    """A random plant, the arguments of its run, and the duration."""
    random = np.random.default_rng([seed, number])
    contacts = int(random.integers(2, 4))
    shapes: tuple[tuple[tuple[int, int], ...], ...] = (((0, -1), (1, 0)), ((1, 0), (0, -1)), ((0, -1), (1, -1)))
    if contacts == 3:
        shapes = (((0, -1), (1, 0), (2, 1)), ((2, 1), (1, 0), (0, -1)), ((0, -1), (1, 0), (2, 0)))
    rubs = shapes[random.integers(len(shapes))]
    bodies = 1 + max(max(pair) for pair in rubs)
    length, time, mass = 10.0 ** random.choice([-6, 0, 6], size=3) if random.integers(4) == 0 else np.ones(3)
    newton = mass * length / time**2
    kinetic = random.uniform(0.2, 1.0, contacts)
    square = random.integers(2) == 0  # along the axes, where components are exactly zero
    plant = Sliders(
        tuple(random.uniform(0.3, 2.0, bodies) * mass), random.uniform(0, 1) * random.integers(2) * mass / time,
        tuple(kinetic * random.choice([1.0, random.uniform(1.0, 1.8)])), tuple(kinetic),
        tuple(random.integers(4, size=bodies) * np.pi / 2 if square else random.uniform(0, 6, bodies)), rubs,
    )  # fmt: skip
    inputs: dict[str, Any] = {}
    for k in range(contacts):
        mean = random.uniform(0.5, 4.0) * random.choice([1.0, 10.0])
        inputs[f"plane.load{k}"] = sine(
            mean * newton, mean * random.uniform(0, 0.9) * newton, random.uniform(0.2, 2) / time, random.uniform(0, 6)
        )
    for i in range(bodies):
        mean, amplitude = random.uniform(0, 2), random.uniform(0.2, 4) * random.integers(3) / 2
        inputs[f"plane.pull{i}"] = sine(mean * newton, amplitude * newton, random.uniform(0.2, 1.5) / time, random.uniform(0, 6))
    start = {f"plane.v{i}": tuple(random.normal(size=2) * length / time * random.integers(2)) for i in range(bodies)}
    return plant, {"inputs": inputs, "start": start, "method": METHODS[number % 3]}, float(random.uniform(1.0, 4.0) * time)


def examine(seed: int, number: int) -> Iterator[tuple[str, str]]:
    """(kind, words) of what comes of one plant: right, or findings."""
    plant, arguments, duration = trial(seed, number)
    composed = compose(plant)
    try:
        run = simulate(composed, duration, **arguments)
    except (SceneError, SimulationError) as error:
        yield type(error).__name__, str(error)
        return
    found = list(_findings(run, lambda **changes: simulate(composed, duration, **(arguments | changes))))
    yield from found or [("right", "")]


def _findings(run: Any, again: Any) -> Iterator[tuple[str, str]]:
    """What is wrong with a run."""
    if not np.isfinite(run.states).all():
        yield "nan", "a state is not finite"
        return
    if sum(run.steps) > MOST_STEPS:
        yield "slow", f"{run.steps} steps"
    elements = run.program.system.elements
    for i, element in enumerate(elements):
        if element.directions < 2:
            continue
        second = elements[i + 1]
        slip, force = (run.computed(ca.vertcat(a, b)) for a, b in ((element.slip, second.slip), (element.multiplier, second.multiplier)))
        bound, rubs = run.computed(ca.SX(element.static)), np.hypot(*force.T)
        size, fast = np.hypot(*slip.T), run.mode[:, i] == 1
        if (rubs > bound * (1 + 1e-6) + 1e-9 * bound.max()).any():
            yield "bound", f"`{element.name}` carries {float((rubs / bound).max()):.9g} times its bound"
        if (size[~fast] > 1e-9 * max(np.abs(run.states).max(), 1e-300)).any():
            yield "slip", f"`{element.name}` sticks at slip {float(size[~fast].max()):.3g}"
        fast &= size > CREEPS * size.max()
        turned = (slip[fast] * force[fast]).sum(axis=1) + size[fast] * rubs[fast]
        if fast.any() and (turned > 1e-6 * size[fast] * rubs[fast]).any():
            yield "direction", f"force of `{element.name}` is off by {float((turned / (size[fast] * rubs[fast])).max()):.3g} (1 - cosine)"
    audit = energy_audit(run)
    if audit.relative > 1e-4:
        better = energy_audit(again(accuracy=1e-8)).relative
        if better > 0.1 * audit.relative:
            yield "energy", f"audit closes to {audit.relative:.2g} of {audit.turnover:.3g} J; at accuracy 1e-8 to {better:.2g}"
