"""Shipped controllers with numbers up to their bounds: no run passes in which a command or a memory is no finite number.

A machine is a plant under one of the shipped controllers, sampled or continuous, whose numbers are its defaults, up to ten or to 1e9 times more or less, 0, the
bound itself or the next number inside, or as large as numbers are. Right is

    in Python   a refusal, an error of the toolbox that says why, or a run in which every value of the controller is finite at all times
    in lanes    the same for ten draws side by side: what fails alone fails in its lane, and what ends there has finite measures
    as C        numbers are refused if and only if Python refuses them; then a status that is not DONE, or finite outputs
    as FMU      the same, of all numbers in one call

Findings: `nan` (a run that passed), `crash` (an exception of another kind), `refusal` (Python and C disagree), `lane` (a lane and a run alone disagree).

    python -m studies fuzz --section controllers [--structures 300] [--seed 1] [--jobs 2] [--first N]
"""

from __future__ import annotations

import dataclasses
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import controllers
from controllers import observers
from models import BitRock, DiscBrake, wells
from studies.benchmarks.machines_in_c import COMPILER, DONE, OVERRUN, CompiledMachine
from toolbox import (
    Budget,
    ClosedLoop,
    Controller,
    Sampled,
    SceneError,
    SimulationError,
    closed_loop,
    compose,
    export_c,
    export_fmu,
    simulate,
)
from toolbox.lanes.lanes import Lanes
from toolbox.measuring import metrics
from toolbox.modelling.components import fields_of
from toolbox.modelling.number_kinds import PARAMETER
from toolbox.simulation.methods import EventExact
from toolbox.sweeps.designs import listed
from toolbox.sweeps.variants import shared_run, varied_numbers

RIG, BRAKE = compose(wells.JANSEN_2, BitRock(weight=80e3)), compose(DiscBrake())
HARD = {"brake": 30.0}
BUDGET = Budget(steps=100_000, events=20_000, seconds=5.0)
LANES = 10

ON_BRAKES = ("BrakeForce", "BrakePI", "BrakeSlidingMode", "BrakeMPC", "HeldSpeed")
SLOW = ("BrakeMPC", "LinearMPC", "NonlinearMPC")
"""Solve a program at every sample: drawn less often."""


def shipped() -> dict[str, Any]:
    """{name: class} of all controllers that the package ships."""
    found = {name: getattr(controllers, name) for name in controllers.__all__}
    return {
        name: kind
        for name, kind in found.items()
        if isinstance(kind, type) and issubclass(kind, Controller) and name != "StringObserverController"
    }


def plain(name: str) -> Any:
    """A shipped controller with its defaults, and limits where it knows any."""
    kind = shipped()[name]
    fields = {each.name for each in fields_of(kind)}
    limits = {"lowest_torque": 0.0, "highest_torque": 2e4} if "lowest_torque" in fields and name != "IdealSlidingMode" else {}
    inside = {
        "Lifting": {"law": controllers.PI(lowest_torque=0.0, highest_torque=2e4)},
        "PID": {"measured_signals": "top.speed", "actuated_signals": "top.torque", "reference": 8.0, "highest": 2e4},
    }.get(name, {})
    return kind(**limits, **inside)


def number(random: np.random.Generator, value: float, bounds: Mapping[str, Any]) -> float:
    """A number within its bounds, which are reached now and then."""
    low, high = (next((float(bounds[word]) for word in words if bounds.get(word) is not None), end)
                 for words, end in ((("at_least", "above"), -np.inf), (("at_most", "below"), np.inf)))  # fmt: skip
    how = random.random()
    if how < 0.45:
        found = value * 10.0 ** random.uniform(-1.0, 1.0)
    elif how < 0.7:
        found = value * 10.0 ** random.uniform(-9.0, 9.0)
    elif how < 0.8:
        found = low if np.isfinite(low) else -value
    elif how < 0.9:
        found = np.nextafter(low, np.inf) if np.isfinite(low) else 0.0
    else:
        found = high if np.isfinite(high) else random.choice([1e12, 1e150, 1e300, sys.float_info.max])
    return float(found)


def drawn(random: np.random.Generator, law: Any) -> Any:
    """A controller with other numbers, some of which it may refuse."""
    changes: dict[str, Any] = {}
    for each in fields_of(type(law)):
        value = getattr(law, each.name)
        if isinstance(value, Controller) and random.random() < 0.7:
            changes[each.name] = drawn(random, value)
        elif each.numeric and isinstance(value, (int, float)) and random.random() < 0.35:
            changes[each.name] = number(random, float(value), each.spec.metadata)
        elif each.name == "torque_rate" and random.random() < 0.3:
            changes[each.name] = number(random, 1e5, each.spec.metadata)
    return dataclasses.replace(law, **changes)


def trial(seed: int, index: int) -> tuple[str, Any, Any, float | None, float]:
    """(name, plant, controller with its defaults, sample time or None, duration) of a machine."""
    random = np.random.default_rng([seed, index])
    names = sorted(shipped())
    name = names[index % len(names)]
    if name in SLOW and (index // len(names)) % 10:
        name = str(random.choice([each for each in names if each not in SLOW]))
    law = plain(name)
    if name in ("LQR", "SlidingMode", "SuperTwisting") and random.random() < 0.3:
        law = controllers.StringObserverController(law, observers.Kalman(), delay_samples=int(random.integers(3)))
    continuous = type(law).continuous is not Controller.continuous and random.random() < 0.25
    period = None if continuous else float(random.choice([0.001, 0.01, 0.1, 1.0]))
    if name in SLOW:
        period = getattr(law, "period", 0.01)
    return name, BRAKE if name in ON_BRAKES else RIG, law, period, 0.5 if name in SLOW else 30.0 * (period or 0.1)


def not_finite(run: Any) -> str:
    """The first signal of a controller of a run that is not finite at all times; empty where none is."""
    system = run.program.system
    held = [name for update in system.updates for name in (*update.names, *update.places)]
    laws = [name for name in (*held, *system.states, "top.torque", "disc.torque", "brake.force") if name in run.names]
    return next((name for name in laws if not np.isfinite(run[name]).all()), "")


def loop_of(plant: Any, law: Any, period: float | None, delay: float = 0.0) -> ClosedLoop:
    """The plant under the controller, from a start in motion."""
    start = {"disc.speed": HARD["brake"]} if plant is BRAKE else {}
    return closed_loop(plant, law if period is None else Sampled(law, period, delay=delay), start=start)


def examine(seed: int, index: int) -> Iterator[tuple[str, str]]:
    """The outcomes of one machine: five draws in Python, ten in lanes and as C, and every tenth machine as an FMU."""
    name, plant, law, period, duration = trial(seed, index)
    random = np.random.default_rng([seed, index, 1])
    for _ in range(5):
        other = drawn(random, law)
        delay = float(random.choice([0.0, 0.3, 2.5])) * (period or 0.0)
        yield in_python(other, lambda other=other, delay=delay: simulate(  # type: ignore[misc]
            loop_of(plant, other, period, delay), duration, method=EventExact(budget=BUDGET)))  # fmt: skip
    if period is None or name in SLOW:
        return
    try:
        loop = loop_of(plant, law, period)
        run = simulate(loop, duration, method=EventExact(budget=BUDGET))
    except (SceneError, SimulationError):
        return  # such as a sample time that the defaults do not bear
    rows = [row for row in (gains(random, loop) for _ in range(LANES)) if row]
    if not rows:
        return
    yield from in_lanes(loop, duration, rows, random)
    if COMPILER is not None and sys.platform == "linux" and "stiff" not in run.why and (index // len(shipped())) % 4 == 0:
        yield from outside(loop, duration, rows, fmu=index % 10 == 0)


def in_python(law: Any, carried_out: Any) -> tuple[str, str]:
    """The outcome of a run of a controller."""
    try:
        run = carried_out()
    except (SceneError, SimulationError) as error:
        return "right", type(error).__name__
    except Exception as error:
        return "crash", f"{type(error).__name__}: {error}; {law!r}"
    bad = not_finite(run)
    return ("nan", f"`{bad}` of {law!r}") if bad else ("right", "done")


def gains(random: np.random.Generator, loop: ClosedLoop) -> dict[str, float]:
    """Other numbers of the controller of a loop, by name."""
    values, known = loop.assembly.system, loop.variable_numbers()
    names = [entry for entry in values.parameters.values() if not loop.plant.has_parameter(entry.name) and entry.size is None]
    # no sample time, and nothing that a design reads
    names = [entry for entry in names if entry.name in known and known[entry.name].kind is PARAMETER]
    chosen = [entry for entry in names if random.random() < 0.4]
    return {entry.name: number(random, float(values.parameter(entry.name)), entry.bounds) for entry in chosen}


def accepted(loop: ClosedLoop, row: Mapping[str, float]) -> bool:
    """Whether Python accepts the numbers, as numbers of a loop that is designed already."""
    try:
        loop.replace(parameters=dict(row)).assembly  # noqa: B018
    except SceneError:
        return False
    return True


def in_lanes(loop: ClosedLoop, duration: float, rows: list[dict[str, float]], random: np.random.Generator) -> Iterator[tuple[str, str]]:
    """Lanes of one controller with other numbers each, against runs alone."""
    names = sorted({name for row in rows for name in row})
    system = loop.assembly.system
    table = [{name: row.get(name, float(system.parameter(name))) for name in names} for row in rows]
    table = [row for row in table if accepted(loop, row)]
    if not table:
        return
    try:
        run = shared_run(loop, listed(table), duration, method="explicit")
        made = Lanes(run, [metrics.maximum(name) for update in system.updates for name in update.names])
        numbers, broken = varied_numbers(run, listed(table))
    except SceneError as error:
        yield "left out", str(error)
        return
    batch = made.run(numbers, np.tile(made.work.x[: system.x.numel()], (len(table), 1)))
    for i, row in enumerate(table):
        if i in broken:
            yield "right", "refused"
            continue
        good = batch.statuses[i] == 0
        if good and not (np.isfinite(batch.states[i]).all() and np.isfinite(batch.values[i]).all()):
            yield "nan", f"lane of {row}"
        elif random.random() < 0.2:
            try:
                simulate(loop.replace(parameters=row), duration, method="explicit")
                alone = True
            except SimulationError:
                alone = False
            yield ("right", "lane") if alone == good else ("lane", f"status {batch.statuses[i]} in a lane, done alone: {alone}; {row}")
        else:
            yield "right", "lane"


def outside(loop: ClosedLoop, duration: float, rows: list[dict[str, float]], fmu: bool) -> Iterator[tuple[str, str]]:
    """The same numbers given to the C of the loop, and to its FMU."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            machine = CompiledMachine(export_c(loop, Path(folder) / "made", part="loop", duration=duration)[0], ["-std=c99", "-O1"])
            unit = export_fmu(loop, Path(folder) / "made.fmu", part="loop", duration=duration) if fmu else None
        except SceneError as error:
            yield "left out", str(error)
            return
        for row in rows:
            machine.start()
            known = {name: value for name, value in row.items() if f"MADE_PARAMETER_{name.replace('.', '_')}" in machine.macros}
            alone = {name: value for name, value in known.items() if accepted(loop, {name: value})}
            taken = {name for name, value in known.items() if _set_alone(machine, name, value)}
            if taken != set(alone):
                yield "refusal", f"C takes {sorted(taken)}, Python {sorted(alone)} of {known}"
                continue
            if not accepted(loop, known):
                yield "right", "refused"
                continue
            machine.start()
            waiting = dict(known)
            for _ in range(len(known) + 1):  # pairs of limits go one after the other
                waiting = {name: value for name, value in waiting.items() if machine.set("PARAMETER", name, value) != DONE}
            if waiting:
                yield "left out", f"no order in which {sorted(waiting)} can be set"
                continue
            status, calls = OVERRUN, 0
            while status == OVERRUN and calls < 50:
                status, calls = machine.step(duration), calls + 1
            finite = np.isfinite(machine.outputs()).all()
            yield ("right", "C") if status != DONE or finite else ("nan", f"C with {known}")
            if unit is not None:
                yield _in_fmu(unit, known, duration)


def _set_alone(machine: CompiledMachine, name: str, value: float) -> bool:
    """Whether a machine at its start takes a number; it is at its start again then."""
    taken = machine.set("PARAMETER", name, value) == DONE
    machine.start()
    return taken


def _in_fmu(path: Path, known: Mapping[str, float], duration: float) -> tuple[str, str]:
    """The outcome of a communication step of a unit with these numbers."""
    import fmpy
    from fmpy.fmi2 import FMU2Slave

    about, folder = fmpy.read_model_description(str(path)), fmpy.extract(str(path))
    references = {each.name: each.valueReference for each in about.modelVariables}
    unit = FMU2Slave(guid=about.guid, unzipDirectory=folder, modelIdentifier="made", instanceName="made")
    try:
        unit.instantiate()
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        unit.setReal([references[name] for name in known], list(known.values()))
        unit.exitInitializationMode()
        unit.doStep(0.0, duration)
        outputs = [each for each in about.modelVariables if each.causality == "output" and each.type == "Real"]
        values = np.array(unit.getReal([each.valueReference for each in outputs]))
    except fmpy.fmi1.FMICallException:
        return "right", "FMU refuses"
    finally:
        unit.freeInstance()
        shutil.rmtree(folder, ignore_errors=True)
    return ("right", "FMU") if np.isfinite(values).all() else ("nan", f"FMU with {known}")
