"""The signals of a run that say most, which a plot shows where nobody names any."""

from __future__ import annotations

from typing import Any

import numpy as np

from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.simulation.samples import Samples


def main_signals(run: Any) -> list[str]:
    """Names of speeds, then of torques and forces, then of positions: at most three of a unit, none twice, none that only stands still.

    Speeds of two units that are proportional, as those of a wheel and its car, are one signal.
    """
    system, nodes = run.program.system, run.every_step
    step = max(1, nodes.time.size // 400)
    some: Samples[Any] = Samples(
        nodes.program, nodes.time[::step], nodes.states[::step], nodes.mode[::step], nodes.held[::step], nodes.parameters, False
    )
    ranks = {"rad/s": 0, "m/s": 0, "N m": 1, "N": 1, "m": 2, "rad": 3}
    own = {f"{element.name}.{tail}" for element in system.elements for tail in element.signals()}
    # what a part gives comes before the force and slip of its contact, which often repeat it
    names = [name for name in _of_the_machine(run) if name not in own] + sorted(own)
    columns = some.columns(names)
    seen: list[np.ndarray] = []
    groups: dict[str, list[str]] = {}
    speeds: list[tuple[str, np.ndarray]] = []
    for name in names:
        unit = run.unit(name)
        values = columns[name]
        if unit not in ranks or values.ndim != 1:
            continue
        size = np.abs(values).max(initial=0.0)
        if size == 0.0 or any(np.abs(np.abs(values) - other).max() <= 1e-9 * size for other in seen):
            continue
        relative = values / size
        if ranks[unit] == 0 and any(other != unit and np.abs(np.abs(relative) - np.abs(speed)).max() <= 1e-9 for other, speed in speeds):
            continue
        if name in own and groups.get(unit):
            if np.ptp(values) == 0 or any(np.ptp(columns[other]) > 0 for other in groups[unit]):
                continue
            groups[unit] = []  # a load that stands still makes room for what it presses
        if len(groups.get(unit, [])) < 3:
            seen.append(np.abs(values))
            groups.setdefault(unit, []).append(name)
            speeds += [(unit, relative)] if ranks[unit] == 0 else []
    moving = {unit: group for unit, group in groups.items() if any(np.ptp(columns[name]) > 0 for name in group)}
    chosen = sorted(moving or groups, key=lambda unit: ranks[unit])[:3]
    found = [name for unit in chosen for name in groups[unit]]
    return found or [next(iter(system.states))]


def _of_the_machine(run: Any) -> list[str]:
    """Names of the signals and inputs of the machine, not of its laws."""
    system, plant = run.program.system, run.run.plant
    # a part with states but no energy, beside parts that have some, is a control law: its inside is not what the machine does
    laws = {name.partition(".")[0] for name in system.states} - set(system.stored) if system.stored else set()
    # what a sampled law remembers, and says of itself, is not what the machine does
    parts = {name.partition(".")[0] for name in (*plant.signals, *plant.inputs)} - laws
    remembered = {name for update in system.updates for name in update.places}
    return [name for name in (*system.signals, *system.inputs) if name.partition(".")[0] in parts and name not in remembered]


def position_of(system: HybridSystem, speed: str) -> str | None:
    """Return the last state whose unit is the unit of the speed times a second: the twist above a bit, the position of a block."""
    unit = system.unit(speed)
    for name, (_, size, own) in reversed(system.states.items()):
        if f"{own}/s" == unit:
            return name if size is None else f"{name}.{size - 1}"
    return None
