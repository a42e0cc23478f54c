"""Does every plant at every edge end with a right answer or with an error that says why?

Structures are drawn at random: networks of masses, springs, dry contacts, rigid and elastic walls; drill strings with every rock, drive and law,
continuous and sampled; the plants and laws of the shipped scenes. Each gets many draws of its numbers, every one of which may stay as it is,
become 0, become huge or tiny (ten to the power of +-9), or move by up to ten times; starts and inputs likewise. A finding is

    crash       an exception that is none of the toolbox's own, or a process that dies
    hang        a call that outlives its budget of 0.3 s by 10 s, in which it may compile the stiff method of its structure
    nan         a finished run with a state that is not finite
    slip        a contact that moves while it sticks
    bound       a contact that holds more than its static bound, by more than the resolution of its switch
    energy      an audit that does not close within a thousand times the accuracy asked, nor ten times better at a hundredth of it: states are as exact
                as asked, a force that depends on a slip far smaller than the speeds is not
    wrong       two methods that disagree by more than ten times the errors that they report

    python -m studies fuzz [--structures 300] [--draws 300] [--seed 1] [--jobs 2] [--first N]

With `--reference` other plants, at ordinary numbers, are compared with a reference that shares no code with the event loop (`studies.benchmarks.differential`):

    python -m studies fuzz --reference [--structures 3000] [--draws 3] [--seed 1] [--jobs 2] [--first N] [--log FOLDER]

With `--section` machines of one kind are judged by rules of their own (`studies.benchmarks.fuzz_sections`): levers that vanish, cones that hold each other,
controllers with numbers up to their bounds, bodies that come to rest, runs that are cut and go on:

    python -m studies fuzz --section levers [--structures 300] [--seed 1] [--jobs 2] [--first N]
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import subprocess
import sys
import tempfile
import time as clock
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import controllers
from models import (
    AxialChain,
    BitRock,
    Coulomb,
    CubicStribeck,
    DragBit,
    ElasticRock,
    Exponential,
    Hyperbolic,
    HystereticBitRock,
    SmoothBitRock,
    SmoothStepFriction,
    StepFriction,
    TopDrive,
    TorsionalChain,
    wells,
)
from studies.benchmarks import fuzz_sections
from studies.benchmarks.fuzz_sections import SECTIONS
from toolbox import (
    Budget,
    Component,
    DryFriction,
    Equations,
    FrictionLaw,
    HybridSystem,
    Quantity,
    Sampled,
    Scene,
    SceneError,
    SimulationError,
    Trajectory,
    UnilateralContact,
    compose,
    energy_audit,
    quantity,
    simulate,
    state,
)
from toolbox.inputs import sine, step
from toolbox.modelling import Quantities
from toolbox.simulation.methods import method_of

SCENES = Path(__file__).parents[1] / "scenes"
ACCURACY = 1e-6
BUDGET = Budget(steps=300_000, seconds=0.3)
CHECKED = 10
"""One draw in so many is looked at closely and run again by another method."""
LONGEST_CHECKED = 20_000
"""Steps."""
LARGEST = 1e100
"""Size of a state from which on a bound may be passed: the shortest step that time resolves moves a spring by more than any bound."""
LAWS: tuple[FrictionLaw, ...] = (
    Coulomb(static=0.5, kinetic=0.3),
    Coulomb(static=0.5, kinetic=0.5),
    Exponential(static=0.8, kinetic=0.5, decay=0.9),
    Hyperbolic(static=1.0, decay=3.0),
    CubicStribeck(),
    StepFriction(),
    SmoothStepFriction(),
)


@dataclass(frozen=True)
class Network(Component):
    """Masses in a row on springs, some rubbing on their neighbour or on a moving ground, some before a wall.

    m_i v_i' = forces of springs to both neighbours and to ground + contacts. rubs: for every mass "" (free), "ground" or "next" (the mass after it);
    walls: for every mass "" (none), "elastic" or "rigid".
    """

    mass: Quantities = quantity((1.0, 1.0), "kg", "masses", above=0)
    tie: Quantities = quantity((10.0,), "N/m", "springs between neighbours", at_least=0)
    ground: Quantities = quantity((1.0, 1.0), "N/m", "springs to ground", at_least=0)
    damping: Quantities = quantity((0.1, 0.1), "N s/m", "damping to ground", at_least=0)
    load: Quantities = quantity((1.0, 1.0), "N", "normal loads of the contacts", at_least=0)
    belt: Quantity = quantity(0.2, "m/s", "speed of the ground")
    gap: Quantity = quantity(1.0, "m", "distance of the walls", at_least=0)
    restitution: Quantity = quantity(0.5, "1", "restitution of rigid walls", at_least=0, at_most=1)
    friction: FrictionLaw = Coulomb()
    rubs: tuple[str, ...] = ("ground", "")
    walls: tuple[str, ...] = ("", "")

    def equations(self, signal):
        n = len(self.mass)
        x, v = state("net.position", "m", n), state("net.speed", "m/s", n)
        drive = signal("net.force", "N", default=0.0)
        force = [-self.ground[i] * x[i] - self.damping[i] * v[i] + (drive if i == 0 else 0.0) for i in range(n)]
        for i in range(n - 1):
            pull = self.tie[i] * (x[i + 1] - x[i])
            force[i] += pull
            force[i + 1] -= pull
        elements: list[Any] = []
        losses: dict[str, Any] = {"damping": sum(self.damping[i] * v[i] ** 2 for i in range(n))}
        supplies: dict[str, Any] = {"force": drive * v[0]}
        for i, kind in enumerate(self.rubs):
            if kind:
                other = v[i + 1] if kind == "next" else self.belt
                contact = DryFriction(f"net.rub{i}", slip=v[i] - other, load=self.load[i], law=self.friction)
                elements.append(contact)
                force[i] += contact.force
                if kind == "next":
                    force[i + 1] -= contact.force
                losses[f"rub{i}"] = -contact.force * (v[i] - other)
                if kind == "ground":
                    supplies[f"rub{i}"] = contact.force * other
        stored = sum(self.mass[i] * v[i] ** 2 + self.ground[i] * x[i] ** 2 for i in range(n)) / 2
        stored += sum(self.tie[i] * (x[i + 1] - x[i]) ** 2 for i in range(n - 1)) / 2
        for i, kind in enumerate(self.walls):
            if kind == "rigid":
                wall = UnilateralContact(f"net.wall{i}", closure=x[i] - self.gap, restitution=self.restitution, rate=v[i])
                elements.append(wall)
                force[i] -= wall.force
            elif kind == "elastic":
                wall = UnilateralContact(f"net.wall{i}", closure=x[i] - self.gap, stiffness=1e3, damping=1.0, rate=v[i])
                elements.append(wall)
                force[i] -= wall.force
        for wall in elements:
            if wall.has_gap:
                stored += wall.stored
                losses[wall.name] = wall.loss
        return Equations(
            flow={x: v, v: ca.vertcat(*[force[i] / self.mass[i] for i in range(n)])},
            elements=elements,
            stored=stored,
            losses=losses,
            supplies=supplies,
        )


@dataclass(frozen=True)
class Structure:
    """A plant with its law, start and inputs, whose numbers are to be drawn."""

    label: str
    plant: HybridSystem
    duration: float
    arguments: dict[str, Any]


def _network(random: np.random.Generator, label: str) -> Structure:
    n = int(random.integers(1, 7))
    rubs = tuple(str(random.choice(["", "ground", "next"] if i + 1 < n else ["", "ground"])) for i in range(n))
    walls = tuple(str(random.choice(["", "elastic", "rigid"], p=[0.7, 0.15, 0.15])) for _ in range(n))
    law = LAWS[random.integers(len(LAWS))]
    net = Network(
        mass=(1.0,) * n, tie=(10.0,) * (n - 1), ground=(1.0,) * n, damping=(0.1,) * n, load=(1.0,) * n, friction=law, rubs=rubs, walls=walls
    )
    force = [0.5, sine(0.5, 1.0, 0.3), step(0.0, 2.0, 5.0), ([0.0, 10.0], [0.0, 3.0])][random.integers(4)]
    return Structure(f"{label} network of {n}, {type(law).__name__}, {rubs}, {walls}", compose(net), 20.0, {"inputs": {"net.force": force}})


ROCKS: tuple[Component, ...] = (
    BitRock(weight=97_347.0),
    BitRock(weight=97_347.0, friction=StepFriction(static=0.8, kinetic=0.5)),
    BitRock(weight=97_347.0, friction=Coulomb(static=0.8, kinetic=0.5)),
    HystereticBitRock(weight=97_347.0),
    SmoothBitRock(weight=97_347.0),
)
DRIVES = (
    "PI", "StiffPI", "SoftTorque", "ZTorque", "ActiveDamping", "SlidingMode", "IdealSlidingMode", "ImplicitSlidingMode", "SuperTwisting",
    "ImpedanceSuperTwisting", "LQR",
)  # fmt: skip


def _string(random: np.random.Generator, label: str) -> Structure:
    n = int(random.integers(2, 9))
    kind = random.integers(4)
    if kind == 0:
        string: Component = [wells.JANSEN_2, wells.NAVARRO_LOPEZ_2, wells.NAVARRO_LOPEZ_4][random.integers(3)]
    else:
        along: dict[str, Any] = {}
        if kind == 2:
            along = {"friction": LAWS[random.integers(4)], "friction_load": (500.0,) * (n - 1)}
        string = TorsionalChain(
            inertia=(2000.0,) + (400.0,) * (n - 1), stiffness=(800.0,) * (n - 1), damping=(100.0,) * (n - 1), top_drag=425.0, **along
        )
    parts: list[Component] = [string, ROCKS[random.integers(len(ROCKS))]]
    if random.random() < 0.2:
        parts.append(TopDrive(torque_limit=2e4, rate_limit=1e5, drive_lag=0.005))
    if random.random() < 0.1 and isinstance(parts[1], BitRock):
        parts = [string, AxialChain(), DragBit()]
    elif random.random() < 0.1:
        parts = [AxialChain(), ElasticRock()]
    plant = compose(*parts)
    name = str(random.choice(["", *DRIVES]))
    if not name or "top.speed" not in plant.signals:
        inputs = {next(iter(plant.inputs)): [1e4, step(0.0, 1e4, 3.0), sine(8e3, 4e3, 0.2)][random.integers(3)]} if plant.inputs else {}
        return Structure(f"{label} {', '.join(type(p).__name__ for p in parts)}", plant, 30.0, {"inputs": inputs})
    law: Any = getattr(controllers, name)(reference=float(random.uniform(1.0, 14.0)))
    how = "continuous"
    if random.random() < 0.5 or name in ("ImplicitSlidingMode", "SuperTwisting", "ImpedanceSuperTwisting"):
        period = float(random.choice([0.005, 0.01, 0.1, 1.0]))
        law, how = Sampled(law, period, delay=float(random.choice([0.0, 0.3, 5.0])) * period), f"every {period:g} s"
    return Structure(f"{label} {', '.join(type(p).__name__ for p in parts)} under {name}, {how}", plant, 30.0, {"controller": law})


def _scene(random: np.random.Generator, label: str) -> Structure:
    path = sorted(SCENES.glob("*.toml"))[random.integers(len(list(SCENES.glob("*.toml"))))]
    scene = Scene.load(path)
    case = scene.cases[random.integers(len(scene.cases))]
    loop = scene[case.label]
    arguments = {"start": loop.start, "inputs": loop.inputs, "controller": loop.controllers or None}
    return Structure(f"{label} {path.stem}: {case.label}", loop.assembly.plant, min(scene.duration, 20.0), arguments)


def structure(seed: int, number: int) -> Structure:
    """One of the endless row of structures of a seed. Those that cannot be composed are drawn again."""
    for attempt in range(100):
        random = np.random.default_rng([seed, number, attempt])
        kind = [_network, _network, _string, _scene][number % 4]
        try:
            made = kind(random, f"{number}")
            simulate(made.plant, 0.0, **made.arguments)
        except (SceneError, SimulationError):
            continue
        return made
    raise RuntimeError(f"No structure {number} of seed {seed} can be composed.")


def bounded(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `simulate` with the accuracy and the budget of this search."""
    return {"accuracy": ACCURACY, **arguments, "method": replace(method_of(arguments.get("method", "event")), budget=BUDGET)}


def draw(random: np.random.Generator, made: Structure) -> dict[str, Any]:
    """Arguments of `simulate` with other numbers: parameters, start, and a duration."""
    boldness = random.choice([0.1, 0.5, 1.0])
    arguments = dict(made.arguments)
    given = arguments.get("inputs") or {}
    parameters = {}
    for name, entry in made.plant.parameters.items():
        if name in given:
            continue
        values = np.atleast_1d(made.plant.parameter(name))
        drawn = np.array([_number(random, value, boldness) for value in values])
        low, high = entry.bounds.get("at_least"), entry.bounds.get("at_most")
        if random.random() < 0.98:  # now and then a number out of bounds, to be refused
            drawn = np.abs(drawn) if entry.bounds.get("above") == 0 else np.clip(drawn, low, high) if (low, high) != (None, None) else drawn
        parameters[name] = float(drawn[0]) if entry.size is None else drawn
    start = dict(arguments.get("start") or {})
    for name, (_, size, _) in made.plant.states.items():
        if random.random() < 0.3:
            values = np.array([_number(random, float(random.choice([0.0, 1.0])), 1.0) for _ in range(size or 1)])
            start[name] = float(values[0]) if size is None else values
    duration = made.duration * float(random.choice([0.0, 1e-6, 1.0, 1.0, 1.0, 1.0, 10.0]))
    return arguments | {"parameters": parameters, "start": start, "duration": duration}


def _number(random: np.random.Generator, value: float, boldness: float) -> float:
    if random.random() > boldness:
        return value
    kind = random.random()
    if kind < 0.05:
        return 0.0
    if kind < 0.06:
        return -value
    if kind < 0.2:
        return value * 10.0 ** random.uniform(-9, 9)
    if kind < 0.22:
        return float(random.choice([1e-12, 1e4, 1e9, 1e300, 1e-300]))
    return value * 10.0 ** random.uniform(-1, 1)


def findings(run: Trajectory, again: Any) -> Iterator[tuple[str, str]]:
    """(kind, words) of everything wrong with a finished run; `again(...)` runs it with other arguments."""
    if not np.isfinite(run.states).all():
        yield "nan", "a state is not finite"
        return
    if run.error_estimate > 0.1:
        return  # the run says that it cannot be computed
    system = run.program.system
    for i, element in enumerate(system.elements):
        if not element.slides:
            continue
        stuck = run.mode[:, i] == 0
        if not stuck.any():
            continue
        slip, speeds = (
            run.computed(ca.SX(element.slip)),
            run.computed(_terms(element.slip)),
        )
        size = np.abs(speeds).max(axis=-1) if speeds.ndim > 1 else np.abs(speeds)
        # contacts that hold each other, as a wall and a row of bodies that rub, leave the round-off of the speeds that they end
        if (np.abs(slip[stuck]) > np.maximum(1e-9 * size[stuck], np.finfo(float).eps * size.max())).any():
            worst = float(np.abs(slip[stuck]).max())
            yield "slip", f"`{element.name}` sticks at slip {worst:.3g}, its speeds being {float(size[stuck].max()):.3g}"
        force, bound = (
            run.computed(ca.SX(element.multiplier)),
            run.computed(ca.SX(element.static)),
        )
        over = np.abs(force[stuck]) - bound[stuck]
        # a switch counts as reached within 1e-9 of the largest bound so far; of a load that vanishes at once with it that is more than its last force
        allowed = 1e-5 * np.maximum(np.abs(bound[stuck]), np.abs(force).max() * 1e-3) + 1e-9 * np.abs(bound).max() + 1e-30
        if (over > allowed).any() and np.abs(run.states).max() < LARGEST:
            yield "bound", f"`{element.name}` holds {float(over.max()):.3g} more than its bound"
    audit = energy_audit(run)
    if system.stored and 1e-30 < audit.turnover < 1e30 and audit.relative > 1e3 * ACCURACY and run.error_estimate < 10 * ACCURACY:
        better = energy_audit(again(accuracy=ACCURACY / 100)).relative
        if better > 0.1 * audit.relative:
            yield (
                "energy",
                f"audit closes to {audit.relative:.2g} of {audit.turnover:.3g} J, error {run.error_estimate:.2g}; at accuracy/100 to {better:.2g}",
            )
    other = again(method="stiff")
    apart = run.difference(other)
    if apart > 10 * ACCURACY and apart > 10 * (run.error_estimate + other.error_estimate):
        yield "wrong", f"event and stiff differ by {apart:.2g}, errors said {run.error_estimate:.2g} and {other.error_estimate:.2g}"


def _terms(slip: ca.SX) -> ca.SX:
    """The variables that a slip is made of."""
    return ca.vertcat(*ca.symvar(slip)) if ca.symvar(slip) else slip


def examine(seed: int, number: int, draws: int, log: Path) -> None:
    """All draws of one structure; what it meets goes to a file, line by line, so that nothing is lost where the process dies."""
    made = structure(seed, number)
    with log.open("a") as file:

        def say(**words: Any) -> None:
            file.write(json.dumps(words) + "\n")
            file.flush()

        say(structure=made.label)
        for k in range(draws):
            random = np.random.default_rng([seed, number, 1000, k])
            say(begin=k)
            faulthandler.dump_traceback_later(10 * BUDGET.seconds + 30, exit=True)
            arguments = draw(random, made)
            duration = arguments.pop("duration")
            began = clock.process_time()  # of this process alone, however busy the machine
            try:
                run = simulate(made.plant, duration, **bounded(arguments))
            except (SceneError, SimulationError) as error:
                spent = clock.process_time() - began
                say(draw=k, end=type(error).__name__, words=str(error))
            except Exception as error:
                spent = clock.process_time() - began
                say(draw=k, end="crash", words=f"{type(error).__name__}: {error}")
            else:
                say(draw=k, end="done", seconds=run.wall_time)
                spent = clock.process_time() - began
                if k % CHECKED == 0 and run.steps[0] < LONGEST_CHECKED:
                    faulthandler.dump_traceback_later(300, exit=True)
                    try:
                        for kind, words in findings(run, lambda **changes: simulate(
                            made.plant, duration, **bounded(arguments | changes))):  # noqa: B023  # fmt: skip
                            say(draw=k, end=kind, words=words)
                    except (SceneError, SimulationError) as error:
                        say(draw=k, end="unchecked", words=str(error))
                    except Exception as error:
                        say(draw=k, end="crash", words=f"while checking, {type(error).__name__}: {error}")
            if spent > BUDGET.seconds + 10:
                say(draw=k, end="hang", words=f"{spent:.1f} s")
        faulthandler.cancel_dump_traceback_later()


DEFECTS = ("crash", "hang", "nan", "slip", "bound", "energy", "wrong")


def main(structures: int, draws: int, seed: int, jobs: int, first: int) -> int:
    """Examine structures in processes of their own and print what was found; the number of findings."""
    numbers = range(first, first + structures)
    counts: Counter[str] = Counter()
    found: list[tuple[int, str, dict[str, Any]]] = []
    began = clock.perf_counter()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:

        def one(number: int) -> tuple[int, Path, int]:
            log = Path(folder) / f"{number}.jsonl"
            command = [sys.executable, "-m", "studies.benchmarks.fuzz", "--worker", str(seed), str(number), str(draws), str(log)]
            done = subprocess.run(command, env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True, text=True, check=False)
            if done.returncode:
                with log.open("a") as file:
                    file.write(json.dumps({"end": "crash", "words": f"the process died: {done.stderr[-600:]}"}) + "\n")
            return number, log, done.returncode

        for number, log, _ in pool.map(one, numbers):
            lines = [json.loads(line) for line in log.read_text().splitlines()]
            label = next((line["structure"] for line in lines if "structure" in line), f"{number}")
            last = max((line["begin"] for line in lines if "begin" in line), default=-1)
            for line in lines:
                if "end" in line:
                    counts[line["end"]] += 1
                    if line["end"] in DEFECTS:
                        line.setdefault("draw", last)
                        found.append((number, label, line))
                        print(f"  {label}, draw {line['draw']}: {line['end']}: {line['words']}", flush=True)
    total = sum(count for kind, count in counts.items() if kind in ("done", "SceneError", "SimulationError", "ZenoError", "BudgetError"))
    print(f"\n{len(numbers)} structures, {total} runs in {clock.perf_counter() - began:.0f} s")
    for kind, count in counts.most_common():
        print(f"  {kind:<16}{count:8d}")
    return len(found)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--worker"]:
        examine(int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), Path(sys.argv[5]))
    else:
        parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("--structures", type=int, default=300)
        parser.add_argument("--draws", type=int, help="of every structure: 300, or 3 with --reference")
        parser.add_argument("--seed", type=int, default=1)
        parser.add_argument("--jobs", type=int, default=2)
        parser.add_argument(
            "--first", type=int, default=0, metavar="N", help="number of the first structure, to go on where a search was stopped"
        )
        parser.add_argument("--reference", action="store_true", help="compare with explicit modes and scipy")
        parser.add_argument("--section", choices=SECTIONS, help="machines of one kind, judged by rules of their own")
        parser.add_argument("--log", metavar="FOLDER", help="with --reference: keep what is found, and go on from there")
        words = vars(parser.parse_args())
        if (section := words.pop("section")) is not None:
            del words["draws"], words["reference"], words["log"]
            sys.exit(1 if fuzz_sections.main(section, **words) else 0)
        compare, log = words.pop("reference"), words.pop("log")
        words["draws"] = words["draws"] or (3 if compare else 300)
        if compare:
            from studies.benchmarks import differential

            sys.exit(1 if differential.main(**words, log=log) else 0)
        sys.exit(1 if main(**words) else 0)
