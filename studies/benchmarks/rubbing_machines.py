"""Random machines that rub, switch and are thrown about: what `studies.benchmarks.differential` runs against a reference.

A machine is a row of masses on springs with dry contacts (on ground, on a belt, on each other; under a constant load, one that varies in time, or the force
of an elastic wall), relays, elastic walls and switches with memory. Its structure is drawn by number, its numbers by draw: one compilation serves all draws.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models import Coulomb, Exponential, StepFriction
from toolbox import Component, Controller, DryFriction, Equations, Quantity, UnilateralContact, Update, quantity, state
from toolbox.inputs import sine
from toolbox.modelling import Hysteresis, OptionalQuantities, Quantities, Relay

KINDS = ("relays", "breaks and switches", "rubbing pairs", "loaded by walls", "loads in time", "samples", "everything")


@dataclass(frozen=True)
class Machine(Component):
    """Masses in a row on springs, with contacts.

    m_i v_i' = -k_i x_i - d_i v_i + springs to both neighbours + push_i + contacts.  Every contact is a row of words:
    rubs     "body against law load": against is ground, belt or a body; law is Coulomb, Exponential or StepFriction; load is one, input or the number of a wall
    relays   "body against": on the surface v + lean x of the body, relative to another one unless that is ground
    walls    "body against": closes where x of the body, less that of another one, exceeds the gap
    switches "read body pushed": memory of a speed, a position or the input `machine.signal`; the body `pushed` gets a kick while it is on
    """

    mass: Quantities = quantity((1.0,), "kg", "masses", above=0)
    ground: Quantities = quantity((1.0,), "N/m", "springs to ground", at_least=0)
    damping: Quantities = quantity((0.1,), "N s/m", "damping to ground", at_least=0)
    tie: OptionalQuantities = quantity(None, "N/m", "springs between neighbours", at_least=0)
    static: OptionalQuantities = quantity(None, "N", "static bounds at load 1", at_least=0)
    kinetic: OptionalQuantities = quantity(None, "N", "kinetic friction at load 1", at_least=0)
    speed: OptionalQuantities = quantity(None, "m/s", "speeds of the laws: of their break or of their decay", above=0)
    bound: OptionalQuantities = quantity(None, "N", "bounds of the relays", at_least=0)
    lean: OptionalQuantities = quantity(None, "1/s", "slopes of the surfaces of the relays", at_least=0)
    gap: OptionalQuantities = quantity(None, "m", "gaps of the walls", at_least=0)
    stiffness: OptionalQuantities = quantity(None, "N/m", "stiffness of the walls", above=0)
    drag: OptionalQuantities = quantity(None, "N s/m", "damping of the walls", at_least=0)
    low: OptionalQuantities = quantity(None, "1", "lower thresholds of the switches")
    high: OptionalQuantities = quantity(None, "1", "upper thresholds of the switches")
    kick: OptionalQuantities = quantity(None, "N", "forces of the switches")
    rubs: tuple[str, ...] = ()
    relays: tuple[str, ...] = ()
    walls: tuple[str, ...] = ()
    switches: tuple[str, ...] = ()

    def equations(self, signal):
        n = len(self.mass)
        x = [state(f"machine.x{i}", "m") for i in range(n)]
        v = [state(f"machine.v{i}", "m/s") for i in range(n)]
        force = [signal(f"machine.push{i}", "N", default=0.0) - self.ground[i] * x[i] - self.damping[i] * v[i] for i in range(n)]
        force[0] += signal("machine.servo", "N", default=0.0)
        belt = signal("machine.belt", "m/s", default=0.0)
        for i in range(n - 1):
            force[i] += self.tie[i] * (x[i + 1] - x[i])
            force[i + 1] -= self.tie[i] * (x[i + 1] - x[i])
        elements: list[Any] = []

        def act(body: str, against: str, pull: Any) -> None:
            force[int(body)] += pull
            if against.isdigit():
                force[int(against)] -= pull

        def relative(of: list[Any], body: str, against: str) -> Any:
            return of[int(body)] - (of[int(against)] if against.isdigit() else 0)

        for i, words in enumerate(self.walls):
            body, against = words.split()
            closure = relative(x, body, against) - self.gap[i]
            wall = UnilateralContact(
                f"machine.wall{i}", closure, relative(v, body, against), stiffness=self.stiffness[i], damping=self.drag[i]
            )
            elements.append(wall)
            act(body, against, -wall.force)
        for i, words in enumerate(self.switches):
            read, body, pushed = words.split()
            seen = {"speed": v[int(body)], "position": x[int(body)], "input": signal("machine.signal", "1", default=0.0)}[read]
            switch = Hysteresis(f"machine.switch{i}", seen, self.low[i], self.high[i])
            elements.append(switch)
            force[int(pushed)] += self.kick[i] * switch.output
        for i, words in enumerate(self.relays):
            body, against = words.split()
            relay = Relay(f"machine.relay{i}", relative(v, body, against) + self.lean[i] * relative(x, body, against), self.bound[i])
            elements.append(relay)
            act(body, against, relay.force)
        for i, words in enumerate(self.rubs):
            body, against, law, load = words.split()
            laws = {
                "Coulomb": lambda i: Coulomb(static=self.static[i], kinetic=self.kinetic[i]),
                "Exponential": lambda i: Exponential(static=self.static[i], kinetic=self.kinetic[i], decay=1.0 / self.speed[i]),
                "StepFriction": lambda i: StepFriction(static=self.static[i], kinetic=self.kinetic[i], drop_speed=self.speed[i]),
            }
            pressed = (
                elements[int(load)].force if load.isdigit() else signal(f"machine.load{i}", "1", default=1.0) if load == "input" else 1.0
            )
            rub = DryFriction(f"machine.rub{i}", relative(v, body, against) - (belt if against == "belt" else 0), laws[law](i), pressed)
            elements.append(rub)
            act(body, against, rub.force)
        flow = {x[i]: v[i] for i in range(n)} | {v[i]: force[i] / self.mass[i] for i in range(n)}
        return Equations(flow=flow, elements=elements)


@dataclass(frozen=True)
class Servo(Controller):
    """u = stiffness (place - x) - damping v of the first mass."""

    stiffness: Quantity = quantity(1.0, "N/m", "gain on the position")
    damping: Quantity = quantity(0.5, "N s/m", "gain on the speed")
    place: Quantity = quantity(0.0, "m", "set-point")
    actuated_signals = ("machine.servo",)

    def sampled(self, signal, period):
        command = self.stiffness * (self.place - signal("machine.x0", "m")) - self.damping * signal("machine.v0", "m/s")
        return Update(memory={}, outputs={"machine.servo": (command, "N")})


@dataclass(frozen=True)
class Table:
    """An input that is linear between its times and jumps where one is repeated; constant outside."""

    times: tuple[float, ...]
    values: tuple[float, ...]


@dataclass(frozen=True)
class Sine:
    """mean + amplitude sin(2 pi frequency t + phase)."""

    mean: float
    amplitude: float
    frequency: float
    phase: float


@dataclass(frozen=True)
class Trial:
    """A machine with what is done to it.  inputs: {name: number, Table or Sine};  law: None or (Servo, period, delay)."""

    machine: Machine
    start: dict[str, float]
    inputs: dict[str, Any] = field(default_factory=dict)
    law: tuple[Servo, float, float] | None = None
    duration: float = 10.0


def given(inputs: dict[str, Any]) -> dict[str, Any]:
    """Inputs in the words of `simulate`."""
    words: dict[str, Any] = {}
    for name, value in inputs.items():
        if isinstance(value, Table):
            words[name] = (list(value.times), list(value.values))
        elif isinstance(value, Sine):
            words[name] = sine(value.mean, value.amplitude, value.frequency, value.phase)
        else:
            words[name] = value
    return words


def layout(seed: int, number: int) -> dict[str, tuple[str, ...]]:
    """The structure of a machine by number, as fields of `Machine` with `bodies` as a row of their numbers; its kind is KINDS[number % 7]."""
    random = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    n = int(random.integers(2, 4)) if kind in ("relays", "rubbing pairs", "everything") else int(random.integers(1, 4))
    all_laws = ["Coulomb", "Exponential", "StepFriction"]

    def body() -> int:
        return int(random.integers(n))

    def pair() -> str:
        first = int(random.integers(n - 1)) if n > 1 else 0
        return f"{first + 1} {first}" if n > 1 else "0 ground"

    rubs, relays, walls, switches = [], [], [], []
    some = kind == "everything"
    if kind == "relays" or (some and random.random() < 0.5):
        relays = [f"{body()} ground" if random.random() < 0.7 else pair()]
        rubs += [f"{pair()} Coulomb one"]
        if random.random() < 0.5:
            rubs += [f"{body()} {random.choice(['ground', 'belt'])} {random.choice(all_laws)} one"]
    if kind == "breaks and switches" or (some and random.random() < 0.5):
        rubs += [f"{body()} belt StepFriction one"]
        switches = [
            f"{read} {body()} {body()}" for read in random.choice(["input", "speed", "position"], size=random.integers(1, 3), replace=False)
        ]
    if kind == "rubbing pairs":
        rubs += [f"{i} {random.choice(['ground', 'belt'])} {random.choice(all_laws)} one" for i in range(int(random.integers(1, n + 1)))]
        rubs += [f"{i + 1} {i} {random.choice(all_laws)} one" for i in range(n - 1)]
    if kind == "loaded by walls" or (some and random.random() < 0.5):
        walls = [f"{body()} ground"] if n == 1 or random.random() < 0.6 else [pair()]
        rubs += [f"{body()} {random.choice(['ground', 'belt'])} {random.choice(all_laws)} 0"]
        if random.random() < 0.5:
            rubs += [f"{pair()} {random.choice(all_laws)} one" if n > 1 else "0 belt Coulomb one"]
    if kind == "loads in time" or (some and random.random() < 0.5):
        rubs += [f"{body()} {random.choice(['ground', 'belt'])} {random.choice(all_laws)} input"]
        if n > 1:
            rubs += [f"{pair()} {random.choice(all_laws)} input"]
    if kind == "samples" or not rubs:
        rubs += [f"{body()} {random.choice(['ground', 'belt'])} {random.choice(all_laws)} one"]
        if n > 1 and random.random() < 0.5:
            rubs += [f"{pair()} {random.choice(all_laws)} one"]
    kept: list[str] = []
    for words in rubs[:4]:  # no contact whose slip the slips of others give: no force tells which of them holds
        if np.linalg.matrix_rank([_span(n, *one.split()[:2]) for one in [*relays, *kept, words]]) == len(relays) + len(kept) + 1:
            kept.append(words)
    return {
        "bodies": tuple(map(str, range(n))),
        "rubs": tuple(kept),
        "relays": tuple(relays),
        "walls": tuple(walls),
        "switches": tuple(switches),
    }


def _span(n: int, body: str, against: str) -> list[int]:
    """Which bodies make a slip."""
    return [(i == int(body)) - (against == str(i)) for i in range(n)]


def _push(random: np.random.Generator, kind: int, size: float, duration: float) -> Any:
    """A force, speed or signal of about a size: a number (0), a sine (1), steps (2) or ramps (3)."""
    if kind == 0:
        return float(random.normal() * size)
    if kind == 1:
        return Sine(
            float(random.normal() * size / 2),
            float(random.uniform(0.3, 1.5) * size),
            float(random.uniform(0.1, 1.0)),
            float(random.uniform(0, 6)),
        )
    nodes = np.sort(random.uniform(0.05, 0.95, int(random.integers(2, 6)))) * duration
    if kind == 2 and random.random() < 0.5:  # pulses shorter than a step
        nodes = np.sort(np.concatenate([nodes, nodes + random.uniform(1e-3, 2e-2, nodes.size)]))
    if kind == 2:  # steps
        values = random.normal(size=nodes.size + 1) * size
        return Table(tuple(np.repeat(nodes, 2).tolist()), tuple(np.repeat(values, 2)[1:-1].tolist()))
    return Table(tuple(nodes.tolist()), tuple((random.normal(size=nodes.size) * size).tolist()))


def _load(random: np.random.Generator, kind: int, duration: float) -> Any:
    """A load that is never negative."""
    value = _push(random, kind, 1.0, duration)
    if isinstance(value, Table):
        return Table(value.times, tuple(abs(one) + 0.02 for one in value.values))
    if isinstance(value, Sine):
        return Sine(1.0, float(random.uniform(0.2, 0.98)), value.frequency, value.phase)
    return abs(value) + 0.02


def trial(seed: int, number: int, draw: int) -> Trial:
    """The numbers of one draw of the machine with this number."""
    made = layout(seed, number)
    random = np.random.default_rng([seed, number, draw + 1])
    n, duration = len(made["bodies"]), float(random.uniform(3.0, 8.0))

    def row(size: int, low: float, high: float) -> tuple[float, ...] | None:
        return tuple(random.uniform(low, high, size).tolist()) if size else None

    static = row(len(made["rubs"]), 0.3, 1.5)
    kinetic = None
    if static is not None:  # where contacts hold each other, static friction far above kinetic leaves the motion open
        coupled = len(made["rubs"]) + len(made["relays"]) > 1
        lowest = 0.97 if coupled and random.random() < 0.9 else 0.3
        kinetic = tuple(
            s
            if law == "Coulomb" and coupled and random.random() < 0.8
            else s * float(random.uniform(lowest if law == "Coulomb" else 0.3, 1.0))
            for s, law in zip(static, (words.split()[2] for words in made["rubs"]), strict=True)
        )
    low = row(len(made["switches"]), -0.8, 0.2)
    machine = Machine(
        mass=row(n, 0.5, 3.0), ground=row(n, 0.0, 4.0 * (random.random() < 0.8)), damping=row(n, 0.0, 0.3), tie=row(n - 1, 0.0, 10.0),
        static=static, kinetic=kinetic, speed=row(len(made["rubs"]), 0.1, 0.6),
        bound=row(len(made["relays"]), 0.5, 2.5), lean=row(len(made["relays"]), 0.0, 2.5),
        gap=row(len(made["walls"]), 0.0, 0.5), stiffness=row(len(made["walls"]), 10.0, 300.0), drag=row(len(made["walls"]), 0.0, 3.0),
        low=low, high=None if low is None else tuple(one + float(random.uniform(0.2, 0.8)) for one in low), kick=row(len(made["switches"]), -2.0, 2.0),
        **{name: words for name, words in made.items() if name != "bodies"},
    )  # fmt: skip
    resting = random.random() < 0.4
    start = {f"machine.{kind}{i}": 0.0 if resting else float(random.normal() * 0.7) for i in range(n) for kind in "xv"}
    if machine.walls:
        start |= {f"machine.x{i}": 0.0 if i else -0.1 - abs(start["machine.x0"]) for i in range(n)}
        start |= {f"machine.x{words.split()[0]}": -0.2 for words in machine.walls}
    strength = float(random.choice([0.3, 1.0, 2.0, 4.0]))  # N: far within the bounds of the contacts to far above
    how = np.random.default_rng([seed, number, 0])  # what an input is, is structure
    inputs = {
        f"machine.push{i}": _push(random, int(how.integers(4)), strength, duration) for i in range(n) if i == n - 1 or how.random() < 0.5
    }
    if any(" belt " in words for words in machine.rubs):
        inputs["machine.belt"] = _push(random, int(how.integers(4)), 0.4, duration)
    if any(words.startswith("input") for words in machine.switches):
        inputs["machine.signal"] = _push(random, int(how.integers(4)), 1.0, duration)
    inputs |= {
        f"machine.load{i}": _load(random, int(how.integers(4)), duration) for i, words in enumerate(machine.rubs) if words.endswith("input")
    }
    law = None
    if KINDS[number % len(KINDS)] in ("samples", "everything"):
        period = float(random.choice([0.02, 0.1, 0.13, 0.5]))
        servo = Servo(float(random.uniform(0.0, 6.0)), float(random.uniform(0.0, 2.0)), float(random.normal()))
        law = servo, period, float(random.choice([0.0, 0.4, 1.0, 2.3])) * period
    return Trial(machine, start, inputs, law, duration)
