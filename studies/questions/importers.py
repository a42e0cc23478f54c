"""Does a machine switch in other people's simulators as it does in `simulate`?

Every shipped scene that can be exported, its first case, against `simulate` at an accuracy of 1e-10: by model exchange in FMPy with CVODE and in a master of
our own (`studies.benchmarks.fmu_masters`), at several tolerances; by co-simulation in FMPy at several communication steps. A cell says the largest error of
a switching time and the processor time that the master took; where the switches are not the same, how many there are, and how many of each element are the
same before its first that is not.

    python -m studies importers [SCENE ...] [--by cvode own co-simulation] [--tolerances 1e-4 1e-6 1e-8]

An importer can count as `simulate` does only where its own error does not grow: `error` is what `simulate` estimates for itself at its accuracy; above 1 a
scene is chaotic. A row takes from a second to a minute.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from studies.benchmarks.fmu_masters import Switches, by_co_simulation, by_cvode, by_own_master, compared, switches_of
from toolbox import Scene, SceneError, export_fmu, simulate
from toolbox.modelling.closed_loop import ClosedLoop

SCENES = Path("studies/scenes")
TOLERANCES = (1e-4, 1e-6, 1e-8)
PERIODS = (1.0, 0.1, 1e-3)
WAYS: dict[str, tuple[str, Callable[[Path, float, float], Switches]]] = {
    "cvode": ("2.0", by_cvode),
    "own": ("2.0", by_own_master),
    "co-simulation": ("3.0", by_co_simulation),
}
"""{way: (version of FMI, master)}."""


def cell(way: str, path: Path, duration: float, setting: float, wanted: Switches) -> str:
    """The answer of one master."""
    begin = time.process_time()
    try:
        found, all_, same, error = compared(WAYS[way][1](path, duration, setting), wanted)
    except Exception as failure:  # whatever an importer raises
        return "failed: " + " ".join(str(failure).split())[-40:]
    if found == all_ == same:
        return f"{error:.1e}, {time.process_time() - begin:.2f} s"
    return f"{found} for {all_}, {same} same"


def row(loop: ClosedLoop, folder: Path, ways: Sequence[str], settings: Sequence[Sequence[float]]) -> list[str]:
    """The cells of a loop: its switches, how an error grows in it, and what each master finds. Raises SceneError for one that cannot be exported."""
    versions = {WAYS[way][0] for way in ways}
    units = {version: export_fmu(loop, folder / f"unit{version[0]}.fmu", part="loop", version=version) for version in sorted(versions)}
    run, plain = simulate(loop, method="explicit", accuracy=1e-10), simulate(loop, method="explicit")
    wanted, duration = switches_of(run), float(run.duration)
    cells = [str(sum(map(len, wanted.values()))), f"{plain.error or 0.0:.0e}"]
    for way, chosen in zip(ways, settings, strict=True):
        cells += [cell(way, units[WAYS[way][0]], duration, setting, wanted) for setting in chosen]
    return cells


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, row by row."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    every = sorted(path.stem for path in SCENES.glob("*.toml"))
    parser.add_argument("scenes", nargs="*", default=every, metavar="SCENE", help="some of the shipped scenes; all without")
    parser.add_argument("--by", nargs="+", default=["cvode", "co-simulation"], choices=list(WAYS), help="masters")
    parser.add_argument("--tolerances", nargs="+", type=float, default=TOLERANCES, help="of those that integrate")
    parser.add_argument("--periods", nargs="+", type=float, default=PERIODS, help="communication steps [s]")
    given = parser.parse_args(arguments)
    settings = [given.periods if way == "co-simulation" else given.tolerances for way in given.by]
    heads = [f"{way} {setting:g}" for way, chosen in zip(given.by, settings, strict=True) for setting in chosen]
    print("  ".join([f"{'scene':<22}", "switches", "  error", *(f"{head:>24}" for head in heads)]), flush=True)
    for name in given.scenes:
        try:
            scene = Scene.load(SCENES / f"{name}.toml")
            with tempfile.TemporaryDirectory() as folder:
                cells = row(scene[scene.labels[0]], Path(folder), given.by, settings)
            print("  ".join([f"{name:<22}", f"{cells[0]:>8}", f"{cells[1]:>7}", *(f"{each:>24}" for each in cells[2:])]), flush=True)
        except SceneError as error:
            print(f"{name:<22}  {str(error)[:140]}", flush=True)


if __name__ == "__main__":
    main()
