"""Synthetic measurements of a rig whose numbers are known, to try a calibration on. Nothing here was measured on a machine.

    python -m studies synthetic [FOLDER]       (default studies/data)

`rig.csv`: the rig of Jansen and van den Steen with a bit law of its own (`TRUTH`), from rest under a drive torque that rises and then sways, at a weight on bit
that sways, as a recorder with 25 samples per second would give it: names and units of the field, white noise of sensors from a seed.

`dirty_rig.csv`: the same recording as the field leaves it, with drop-outs to zero, nulls, a gap, a downhole clock that is late, a drift of downhole torque and
reversed speeds; `dirty_rig.toml`: its truth, rows counted from 0 in `rig.csv`.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from models import BitRock, Exponential, wells
from toolbox import HybridSystem, compose, simulate

FOLDER = Path(__file__).parents[1] / "data"
TRUTH = {"bit.friction.static": 0.74, "bit.friction.kinetic": 0.46, "bit.friction.decay": 1.15}
NOISE = {"top.speed": 0.02, "bit.speed": 0.04, "bit.torque": 200.0}
"""Standard deviations in rad/s and N m."""

COLUMNS = {
    "time": "time",
    "top.torque": "drive torque",
    "bit.weight": "weight on bit",
    "top.speed": "table speed",
    "bit.speed": "downhole speed",
    "bit.torque": "downhole torque",
}
"""What the recorder calls the signals."""

UNITS = {"time": ("s", 1.0), "torque": ("kN m", 1e-3), "weight": ("kN", 1e-3), "speed": ("rpm", 30 / math.pi)}


def true_rig() -> HybridSystem:
    """The rig behind the data."""
    return compose(wells.JANSEN_2, BitRock(friction=Exponential())).with_parameters(TRUTH)


def recording(seed: int = 1, duration: float = 40.0, noise: float = 1.0) -> dict[str, np.ndarray]:
    """{signal: values in SI} of a simulation of the true rig at 25 Hz, with `noise` times the noise of the sensors."""
    time = np.round(np.arange(0.0, duration + 0.02, 0.04), 2)
    torque = np.round(np.minimum(time / 4.0, 1.0) * (10_500.0 + 1500.0 * np.sin(0.25 * time)))
    weight = np.round(95_000.0 + 4000.0 * np.sin(0.4 * time), -1)
    run = simulate(
        true_rig(), time[-1], inputs={"top.torque": (time, torque), "bit.weight": (time, weight)}, accuracy=1e-9, output_times=time
    )
    random = np.random.default_rng(seed)
    outputs = {name: run[name] + noise * deviation * random.standard_normal(time.size) for name, deviation in NOISE.items()}
    return {"time": time, "top.torque": torque, "bit.weight": weight, **outputs}


def write(path: Path) -> None:
    """Write the recording as the table of a recorder."""
    signals = recording()
    kinds = {name: UNITS[name.rpartition(".")[2]] for name in COLUMNS}
    lines = ["# synthetic: simulated with python -m studies synthetic, seeded noise; not measured on any machine"]
    lines.append(",".join(f"{heading} [{kinds[name][0]}]" for name, heading in COLUMNS.items()))
    columns = [signals[name] * kinds[name][1] for name in COLUMNS]
    lines += [",".join(f"{value:.6g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


DIRT: dict[str, Any] = {
    "null": [120, 121, 122, 610],
    "dropped": [200, 201, 202, 700],
    "reversed": [333, 456, 828, 932],
    "gap": [500, 560],
    "shift": 0.4,
    "drift": 5.0,
}
"""Rows of nulls in the weight, of drop-outs in the drive torque, of reversed downhole speed; first row and one past the last of the gap; how late the downhole
channels are [s], and by how much their torque drifts [N m/s]."""


def dirty() -> dict[str, np.ndarray]:
    """{signal: values in SI} of the recording with its dirt; nan for a null."""
    signals = {name: values.copy() for name, values in recording().items()}
    time = signals["time"]
    signals["bit.torque"] += DIRT["drift"] * time
    for name in ("bit.speed", "bit.torque"):
        signals[name] = np.interp(time - DIRT["shift"], time, signals[name])
    signals["bit.speed"][DIRT["reversed"]] *= -1.0
    signals["bit.weight"][DIRT["null"]] = np.nan
    signals["top.torque"][DIRT["dropped"]] = 0.0
    return {name: np.delete(values, np.arange(*DIRT["gap"])) for name, values in signals.items()}


def write_dirty(folder: Path) -> None:
    """Write the dirty recording and its truth."""
    signals = dirty()
    units = [UNITS[name.rpartition(".")[2]] for name in COLUMNS]
    lines = [
        "Synthetic: python -m studies synthetic; not measured on any machine",
        ";".join(COLUMNS.values()),
        ";".join(unit for unit, _ in units),
    ]
    columns = [np.nan_to_num(signals[name] * unit[1], nan=-999.25) for name, unit in zip(COLUMNS, units, strict=True)]
    lines += [";".join(f"{value:.6g}" for value in row).replace(".", ",") for row in zip(*columns, strict=True)]
    (folder / "dirty_rig.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    truth = [f'"{name}" = {value}' for name, value in TRUTH.items()]
    dirt = [f"{name} = {value}" for name, value in DIRT.items()]
    (folder / "dirty_rig.toml").write_text("\n".join(["[numbers]", *truth, "", "[dirt]", *dirt]) + "\n", encoding="utf-8")


def main() -> None:
    """Write the tables."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    write(folder / "rig.csv")
    write_dirty(folder)


if __name__ == "__main__":
    main()
