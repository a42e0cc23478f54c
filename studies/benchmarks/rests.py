"""Bodies that fall on a rigid floor and come to rest, in runs of any length, judged by closed forms.

    x' = v, m v' = -m g + N        impact: v+ = -e v-        rest at t_r = sqrt(2 h / g) (1 + e) / (1 - e)

The last body may slide, and rubs on the floor with the coefficient mu. Until t_r the floor has given it the vertical momentum m g t_r that gravity has taken.
Friction has slowed it by mu g t_r then, and slows it by mu g from then on: it stops at u / (mu g) if it slides until t_r.

Restitution is 0 to 0.995. Runs last 1.5 to 1e7 times t_r. Lengths, times and masses are scaled by up to ten to the power of +-6. A run, a run that goes on from
its end or an instant of it, a start from numbers, lanes, the stepper and the exported C say the same.

    python -m studies fuzz --section rests [--structures 300] [--seed 1] [--first N]
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from models import Coulomb
from studies.benchmarks.machines_in_c import COMPILER, CompiledMachine
from toolbox import (
    Component,
    DryFriction,
    Equations,
    Quantity,
    SceneError,
    SimulationError,
    UnilateralContact,
    closed_loop,
    compose,
    export_c,
    quantity,
    simulate,
    state,
    stepper,
)
from toolbox.lanes.lanes import Lanes
from toolbox.modelling import Quantities
from toolbox.simulation.request import Request

METHODS = ("event", "taylor", "explicit", "stiff")
EXACT = 1e-5
"""Largest error of an instant as a fraction of it: each bounce adds the error of a step, and bounces end below 1e-6 of the first speed."""


@dataclass(frozen=True)
class Fallers(Component):
    """Bodies over one floor, each with its own restitution; the last slides if `slides`."""

    mass: Quantities = quantity((1.0,), "kg", "masses", above=0)
    restitution: Quantities = quantity((0.5,), "1", "restitution of the floor", at_least=0, at_most=1)
    gravity: Quantity = quantity(9.81, "m/s^2", "acceleration of fall", above=0)
    floor: Quantity = quantity(0.0, "m", "height of the floor")
    rubbing: Quantity = quantity(0.3, "1", "coefficient of friction", at_least=0)
    slides: bool = False

    def equations(self, signal):
        n = len(self.mass)
        x, v = state("ball.height", "m", n), state("ball.speed", "m/s", n)
        floors = [UnilateralContact(f"floor{i}", self.floor - x[i], -v[i], restitution=self.restitution[i]) for i in range(n)]
        elements: list[Any] = list(floors)
        flow: dict[Any, Any] = {x: v, v: ca.vertcat(*[floors[i].force / self.mass[i] - self.gravity for i in range(n)])}
        if self.slides:
            u = state("ball.drift", "m/s")
            rub = DryFriction("rub", u, Coulomb(self.rubbing, self.rubbing), floors[-1].force)
            elements.append(rub)
            flow[u] = rub.force / self.mass[n - 1]
        return Equations(flow, elements=elements)


@dataclass(frozen=True)
class Trial:
    """A plant, how it starts, how long it runs and by what method, and the instants at which each element is at rest."""

    plant: Fallers
    start: dict[str, Any]
    duration: float
    method: str
    rests: dict[str, float]
    length: float


def trial(seed: int, number: int) -> Trial:
    """A random fall."""
    random = np.random.default_rng([seed, number])
    length, time, mass = 10.0 ** random.choice([-6.0, 0.0, 6.0], size=3) if number % 2 else np.ones(3)
    n = int(random.choice([1, 1, 2, 3]))
    slides = bool(random.integers(3) == 0)
    e = random.choice([0.0, 0.9, 0.99, 0.995, *random.uniform(0.0, 0.95, 6)], size=n)
    h = random.uniform(0.01, 5.0, n) * length
    g, floor = random.uniform(1.0, 10.0) * length / time**2, random.choice([0.0, 0.0, random.uniform(-3.0, 3.0)]) * length
    rests = np.sqrt(2.0 * h / g) * (1.0 + e) / (1.0 - e)
    duration = rests.max() * random.choice([1.5, random.uniform(2.0, 20.0), 1e2, 1e3, 1e4, 1e5, 1e6, 1e7])
    start: dict[str, Any] = {"ball.height": floor + h}
    at = {f"floor{i}": float(rests[i]) for i in range(n)}
    rubbing = 0.3
    if slides:
        stop = rests[-1] * random.uniform(1.05, 1.4)
        start["ball.drift"] = float(rubbing * g * stop)
        at["rub"] = float(stop)
    plant = Fallers(tuple(random.uniform(0.1, 10.0, n) * mass), tuple(e), float(g), float(floor), rubbing, slides)
    return Trial(plant, start, float(duration), METHODS[number // 2 % 4], at, float(length))


def examine(seed: int, number: int) -> Iterator[tuple[str, str]]:
    """(kind, words) of what comes of one fall: right, or findings."""
    given = trial(seed, number)
    plant = compose(given.plant)
    found = list(_of_run(given, plant))
    if number % 5 == 0:
        found += _of_others(given, plant, in_c=COMPILER is not None and number % 20 == 0)
    yield from found or [("right", "")]


def _of_run(given: Trial, plant: Any) -> Iterator[tuple[str, str]]:
    """What is wrong with a run and with those that go on from it."""
    words = f"{given.method} {given.duration:.6g} s, {given.plant}"
    try:
        run = simulate(plant, given.duration, start=given.start, method=given.method)
    except (SceneError, SimulationError) as error:
        yield type(error).__name__, f"{error} {words}"
        return
    yield from _judged(given, [(q.time, q.element, q.after) for q in run.events], words)
    height = np.atleast_1d(run["ball.height"][-1]) - given.plant.floor
    if not (np.abs(height) <= 1e-9 * given.length).all():
        yield "height", f"{height} m at the end, {words}"
    instant = float(0.5 * (max(given.rests.values()) * 1.001 + given.duration))
    numbers = {name: run.last[name] for name in plant.states}  # of which those that are round-off may still fall and bounce, for no time
    for name, start in (("last", run.last), ("at(end)", run.at(given.duration)), ("at(t)", run.at(instant)), ("numbers", numbers)):
        try:
            after = simulate(plant, given.duration, start=start, method=given.method)
        except (SceneError, SimulationError) as error:
            yield type(error).__name__, f"from {name}: {error} {words}"
            continue
        late = [q for q in after.events if name != "numbers" or q.time > 1e-4 * max(given.rests.values())]
        if late or not (np.abs(np.atleast_1d(after["ball.height"][-1]) - given.plant.floor) <= 1e-9 * given.length).all():
            yield "goes on", f"from {name}: {late[:2]} {after['ball.height'][-1]} {words}"


def _judged(given: Trial, events: list[tuple[float, str, str]], words: str) -> Iterator[tuple[str, str]]:
    """What is wrong with the switches of a run."""
    for element, instant in given.rests.items():
        own = [(t, after) for t, name, after in events if name == element]
        rests = [t for t, after in own if after in ("closed", "stick")]
        if len(rests) != 1 or own[-1][0] != rests[0]:
            yield "rests", f"{element} rests at {rests[:5]}, then {own[-1:]}, right is once at {instant!r}, {words}"
        elif abs(rests[0] - instant) > EXACT * instant:
            yield "instant", f"{element} rests at {rests[0]!r}, right is {instant!r} ({rests[0] / instant - 1.0:.2g}), {words}"


def _of_others(given: Trial, plant: Any, in_c: bool) -> Iterator[tuple[str, str]]:
    """What is wrong with lanes, the stepper and the exported C."""
    loop, words = closed_loop(plant, start=given.start), f"{given.duration:.6g} s, {given.plant}"
    elements = [element.name for element in plant.elements]
    try:
        run = Request(loop, given.duration).checked()
        lanes = Lanes(run, ()).run(run.system.values[None], run.start.states[None], most_events=20_000)
        count = int(lanes.switches[0])
        modes = [str(_after(plant, row)) for row in zip(lanes.event_elements[0, :count], lanes.event_modes[0, :count], strict=True)]
        rows = zip(lanes.event_times[0, :count], lanes.event_elements[0, :count], modes, strict=True)
        yield from _judged(given, [(float(t), elements[i], after) for t, i, after in rows], f"lanes {words}")
    except (SceneError, SimulationError) as error:
        yield type(error).__name__, f"lanes: {error} {words}"
    period = min(given.duration, 3.0 * max(given.rests.values())) / 50.0
    try:
        machine = stepper(loop, period, duration=given.duration)
        events = []
        for _ in range(50):
            machine.step()
            events += [(q.time, q.element, q.after) for q in machine.events]
        yield from _judged(given, events, f"stepper {words}")
    except (SceneError, SimulationError) as error:
        yield type(error).__name__, f"stepper: {error} {words}"
    if in_c:
        with tempfile.TemporaryDirectory() as folder:
            source, _ = export_c(loop, Path(folder) / "ball", duration=given.duration)
            machine_c = CompiledMachine(source)
            yield from _judged(given, [(t, name, after) for t, name, _, after in machine_c.run(50 * period, period)], f"C {words}")


def _after(plant: Any, row: Any) -> str:
    """The mode behind a switch in lanes."""
    element, modes = row
    return plant.elements[element].mode_names[int(np.ravel(modes)[-1])]
