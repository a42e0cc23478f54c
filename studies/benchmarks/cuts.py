"""Runs that are cut and go on: the pieces equal the whole, for every kind of element, wherever they are cut.

A machine is drawn of one or two parts, each with elements of one kind: a body that a push lifts off a rigid or an elastic floor, on which it may rub; a block
on a belt, by a law with or without memory; a slide in two directions; a relay; a thermostat. A sampled controller may hold one of the forces. The machine runs
as a whole and in pieces. The cuts lie at random instants, at the exact instants of switches, beside these by the resolution of time, and at samples and jumps
of inputs. Each piece begins with the state that the one before left, which may have gone through a text.

Right is: the same switches in the same order, each once over the pieces together, at the same instants, and the same states at the end. Where nothing depends
on time, runs from instants of the whole end as it does. What another accuracy makes otherwise as well, as bounces of a shaken body, is left out. Lengths,
times and masses are scaled by up to ten to the power of +-6.

    python -m studies fuzz --section cuts [--structures 300] [--seed 1] [--first N]
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from models import Coulomb, Exponential, LuGre
from toolbox import (
    Component,
    Controller,
    DryFriction,
    Equations,
    Quantity,
    Sampled,
    SceneError,
    SimulationError,
    Trajectory,
    UnilateralContact,
    Update,
    compose,
    quantity,
    simulate,
    state,
)
from toolbox.inputs import sine
from toolbox.modelling import Hysteresis, Relay
from toolbox.simulation import Event
from toolbox.simulation.run_state import RunState

METHODS = ("event", "taylor", "explicit", "stiff")
ACCURACY = 1e-9
EXACT = 1e-5
"""Largest distance of pieces from the whole, in parts of the duration or of the size of a state."""


@dataclass(frozen=True)
class Scales(Component):
    """A part whose length, time and mass have units of their own."""

    length: Quantity = quantity(1.0, "m", "unit of length", above=0)
    time: Quantity = quantity(1.0, "s", "unit of time", above=0)
    mass: Quantity = quantity(1.0, "kg", "unit of mass", above=0)

    @property
    def newton(self) -> Any:
        """Unit of force."""
        return self.mass * self.length / self.time**2


@dataclass(frozen=True)
class Ball(Scales):
    """A body under gravity on a floor, pushed up now and then."""

    restitution: Quantity = quantity(0.5, "1", "restitution", at_least=0, at_most=1)
    elastic: bool = False
    rubs: bool = False

    def equations(self, signal):
        x, v = state("ball.height", "m"), state("ball.speed", "m/s")
        push = signal("ball.push", "N", default=0.0)
        if self.elastic:
            floor = UnilateralContact(
                "floor", -x, -v, stiffness=1e3 * self.newton / self.length, damping=3.0 * self.newton / self.length * self.time
            )
        else:
            floor = UnilateralContact("floor", -x, -v, restitution=self.restitution)
        flow = {x: v, v: (push + floor.force) / self.mass - 5.0 * self.length / self.time**2}
        elements: list[Any] = [floor]
        if self.rubs:
            y, u = state("ball.way", "m"), state("ball.drift", "m/s")
            rub = DryFriction("rub", u, Coulomb(0.4, 0.3), floor.force)
            flow |= {y: u, u: (rub.force + 0.7 * push - self.newton / self.length * y) / self.mass}
            elements.append(rub)
        return Equations(flow, elements=elements)


@dataclass(frozen=True)
class Belt(Scales):
    """A block on a belt, held by a spring."""

    memory: bool = False
    static: Quantity = quantity(1.0, "1", "static friction", above=0)

    def equations(self, signal):
        x, v = state("block.position", "m"), state("block.speed", "m/s")
        speed = self.length / self.time
        slip = v - 0.3 * speed
        if self.memory:
            law = LuGre(100.0 / self.length, 0.0, 0.0, Exponential(self.static, 0.7 * self.static, 3.0 / speed))
            belt = DryFriction("belt", slip, law, self.newton)
        else:
            belt = DryFriction("belt", slip, Exponential(self.static, 0.6 * self.static, 1.0 / speed), self.newton)
        pull = signal("block.force", "N", default=0.0)
        flow = {x: v, v: (pull + belt.force - self.newton / self.length * x) / self.mass}
        return Equations(flow, elements=[belt])


@dataclass(frozen=True)
class Slider(Scales):
    """A body that rubs in a plane, pulled along one axis and tied along the other."""

    def equations(self, signal):
        x, v = state("slider.position", "m", 2), state("slider.speed", "m/s", 2)
        rub = DryFriction("plane", v, Coulomb(0.6, 0.6), self.newton)
        pull = signal("slider.force", "N", default=0.0)
        spring = self.newton / self.length * x
        return Equations({x: v, v: (ca.vertcat(pull, 0.4 * pull) - spring + rub.force) / self.mass}, elements=[rub])


@dataclass(frozen=True)
class Sliding(Scales):
    """A body that a relay leads to a sliding surface, and a push drives off it."""

    def equations(self, signal):
        x, v = state("led.position", "m"), state("led.speed", "m/s")
        relay = Relay("relay", x / self.time + v, self.newton)
        push = signal("led.push", "N", default=0.0)
        return Equations({x: v, v: (relay.force + push) / self.mass}, elements=[relay])


@dataclass(frozen=True)
class Thermostat(Scales):
    """A tank that a switch warms."""

    def equations(self, signal):
        level = state("tank.level", "m")
        switch = Hysteresis("switch", level, 0.9 * self.length, 1.1 * self.length, signal_unit="m")
        return Equations({level: (1.6 * self.length * (1.0 - switch.output) - level + 0.4 * self.length) / self.time}, elements=[switch])


@dataclass(frozen=True)
class Trial:
    """A machine, the arguments of its run, and the duration."""

    plant: Any
    arguments: dict[str, Any]
    duration: float
    period: float | None
    words: str


@dataclass(frozen=True)
class Stairs(Controller):
    """A force that goes up and down from sample to sample, u_k = size sin(0.7 k)."""

    measured_signals = ()
    signal_driven: str = "block.force"
    size: Quantity = quantity(1.0, "N", "largest force")

    @property
    def actuated_signals(self) -> tuple[str, ...]:
        return (self.signal_driven,)

    def sampled(self, signal, period):
        phase = state("stairs.phase", "rad")
        return Update(memory={phase: phase + 0.7}, outputs={self.signal_driven: (self.size * ca.sin(phase), "N")})


def trial(seed: int, number: int) -> Trial:
    """A random machine."""
    random = np.random.default_rng([seed, number])
    length, time, mass = 10.0 ** random.choice([-6.0, 0.0, 6.0], size=3) if number % 3 == 2 else np.ones(3)
    newton = mass * length / time**2
    units = {"length": float(length), "time": float(time), "mass": float(mass)}
    parts: list[Any] = []
    inputs: dict[str, Any] = {}
    start: dict[str, Any] = {}

    def shape(size: float) -> Any:
        mean, swing = random.uniform(-0.3, 0.3) * size * newton, size * newton * random.uniform(0.7, 1.5)
        kind = random.integers(3)
        if kind == 0:
            return float(mean + 0.5 * swing)
        if kind == 1:
            return sine(mean, swing, random.uniform(0.1, 0.4) / time, random.uniform(0.0, 6.0))
        times = np.sort(random.choice(np.arange(1, 24) * 0.5, 4, replace=False)) * time
        return np.repeat([0.0, *times], 2)[1:], (mean + swing * random.uniform(-1, 1, 9)[np.repeat(np.arange(5), 2)[:9]])

    arguments: dict[str, Any] = {"inputs": inputs, "start": start, "method": METHODS[number // 2 % 4], "accuracy": ACCURACY}
    kinds = list(random.choice(["ball", "ball", "belt", "slider", "relay", "tank"], size=int(random.integers(1, 3))))
    if number % 2 == 0 and "ball" not in kinds:
        kinds[0] = "ball"
    for kind in dict.fromkeys(kinds):
        if kind == "ball":
            e = float(random.choice([0.0, 0.3, 0.6, random.uniform(0.0, 0.8)]))
            parts.append(Ball(restitution=e, elastic=bool(random.integers(4) == 0), rubs=bool(random.integers(3) == 0), **units))
            inputs["ball.push"] = shape(6.0)
            start["ball.height"] = float(random.choice([0.0, random.uniform(0.1, 2.0)]) * length)
        elif kind == "belt":
            parts.append(Belt(memory=bool(random.integers(3) == 0), **units))
            inputs["block.force"] = shape(0.5)
        elif kind == "slider":
            parts.append(Slider(**units))
            inputs["slider.force"] = shape(1.5)
            start["slider.speed"] = random.uniform(-1.0, 1.0, 2) * length / time
        elif kind == "relay":
            parts.append(Sliding(**units))
            inputs["led.push"] = shape(1.0)
            start["led.position"] = float(random.uniform(-2.0, 2.0) * length)
        else:
            parts.append(Thermostat(**units))
    period = None
    if inputs and random.integers(3) == 0:
        driven = next(iter(inputs))
        del inputs[driven]
        period = float(random.uniform(0.2, 1.0) * time)
        size = float((9.0 if driven == "ball.push" else 1.5) * newton)
        late = float(random.choice([0.0, 0.4, 1.7]) * period)
        arguments["controller"] = Sampled(Stairs(driven, size), period, delay=late)
    words = f"{arguments['method']}, {parts}, {inputs}, {start}, {arguments.get('controller')}"
    return Trial(compose(*parts), arguments, float(random.uniform(6.0, 12.0) * time), period, words)


def instants(given: Trial, whole: Trajectory, random: np.random.Generator) -> list[float]:
    """Cuts: random ones, at and beside switches, and at samples and jumps."""
    events = np.unique([event.time for event in whole.events])
    found = list(random.uniform(0.0, given.duration, 5))
    for t in random.permutation(events)[:6]:
        found += [t, float(np.nextafter(t, np.inf)), float(np.nextafter(t, 0.0)), t * (1.0 + 1e-10), t * (1.0 - 1e-10)]
    if given.period:
        found += list(given.period * random.integers(1, 6, 2))
    tables = [value[0] for value in given.arguments["inputs"].values() if isinstance(value, tuple)]
    found += [float(t) for times in tables for t in times[1:3]]
    return [float(t) for t in found if 0.0 < t < given.duration]


def examine(seed: int, number: int) -> Iterator[tuple[str, str]]:
    """(kind, words) of what comes of one machine: right, left out, or findings."""
    given = trial(seed, number)
    random = np.random.default_rng([seed, number, 1])
    try:
        whole = simulate(given.plant, given.duration, **given.arguments)
    except (SceneError, SimulationError) as error:
        yield type(error).__name__, f"{error} {given.words}"
        return
    found = []
    cuts = instants(given, whole, random)
    for row in [[cut] for cut in cuts] + [sorted(set(cuts))[:20]]:
        words = f"cut at {row}" if len(row) < 3 else f"{len(row)} cuts"
        try:
            wrong = apart(whole, pieces(given, row, told=bool(random.integers(2))), given)
        except (SceneError, SimulationError) as error:
            found.append((type(error).__name__, f"{words}: {error} {given.words}"))
            continue
        if wrong:
            found.append(("pieces", f"{words}: {wrong} {given.words}"))
    if given.period is None and all(isinstance(value, float) for value in given.arguments["inputs"].values()):
        for at in random.uniform(0.0, given.duration, 3):  # whose time begins anew, so that nothing may depend on it
            try:
                after = simulate(given.plant, given.duration - at, **(given.arguments | {"start": whole.at(float(at))}))
            except (SceneError, SimulationError) as error:
                found.append((type(error).__name__, f"from {at} on: {error} {given.words}"))
                continue
            wrong = _ends(whole, after)
            if wrong:
                found.append(("pieces", f"from {at} on: {wrong} {given.words}"))
    if found:
        other = simulate(given.plant, given.duration, **(given.arguments | {"accuracy": 1e-3 * ACCURACY, "method": "explicit"}))
        if all(kind == "pieces" for kind, _ in found) and apart(whole, [other], given, 0.1 * EXACT):
            found = [("left out", "another accuracy makes another motion")]
    yield from found or [("right", "")]


def pieces(given: Trial, cuts: list[float], told: bool) -> list[Trajectory]:
    """Runs from each cut to the next, each from the state that the one before left, which may have gone through a text."""
    found: list[Trajectory] = []
    arguments = dict(given.arguments)
    for cut in [*cuts, given.duration]:
        begin = 0.0
        if found:
            last: RunState = found[-1].last
            arguments["start"] = last.as_told(json.loads(json.dumps(last.told()))) if told else last
            begin = last.time
        found.append(simulate(given.plant, cut - begin, **arguments))
    return found


def _resolved(events: Sequence[Event], duration: float) -> list[tuple[float, str, str, str]]:
    """Switches but for bounces that last less than the exactness: steps of another size may make one more or less of the last of them."""
    found, following = [], dict[str, float]()
    for event in reversed(events):
        if not (event.before == event.after and following.get(event.element, np.inf) - event.time < EXACT * duration):
            found.append((event.time, event.element, event.before, event.after))
        following[event.element] = event.time
    return found[::-1]


def apart(whole: Trajectory, parts: list[Trajectory], given: Trial, exact: float = EXACT) -> str:
    """What pieces do otherwise than the whole, in words."""
    there, here = (_resolved(events, given.duration) for events in (whole.events, [q for part in parts for q in part.events]))
    for k in range(max(len(there), len(here))):
        if k >= min(len(there), len(here)) or there[k][1:] != here[k][1:]:
            return f"{len(here)} switches, whole {len(there)}: {here[max(k - 1, 0) : k + 2]}, whole {there[max(k - 1, 0) : k + 2]}"
        if abs(there[k][0] - here[k][0]) > exact * given.duration:
            return f"switch at {here[k]}, whole at {there[k]}"
    return _ends(whole, parts[-1], exact)


def _ends(whole: Trajectory, part: Trajectory, exact: float = EXACT) -> str:
    """Where the last piece ends otherwise than the whole, in words."""
    size = np.abs(whole.states).max(axis=0)
    off = np.abs(part.last.states - whole.last.states)
    if (off > exact * size).any():
        return f"ends at {part.last.states}, whole at {whole.last.states}"
    if (part.last.modes != whole.last.modes).any():
        return f"ends in modes {part.last.modes}, whole in {whole.last.modes}"
    return ""
