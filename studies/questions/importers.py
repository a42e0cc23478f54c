"""Does a machine switch in other people's simulators as it does in `simulate`?

Every shipped scene that can be exported, its first case, against `simulate` at an accuracy of 1e-10: by model exchange in FMPy with CVODE and in a master of
our own (`studies.benchmarks.fmu_masters`), at several tolerances; by co-simulation in FMPy at several communication steps. A cell says the largest error of
a switching time and the processor time that the master took; where the switches are not the same, how many there are, and how many of each element are the
same before its first that is not, and beneath the row, for CVODE, how near to zero a guard turns there (`studies.benchmarks.fmu_grazes`). ecos and
libcosim look at modes at communication points only, and are compared with what `simulate` shows there.

    python -m studies importers [SCENE ...] [--by cvode own co-simulation ecos libcosim] [--tolerances 1e-4 1e-6 1e-8]

An importer can count as `simulate` does only where its own error does not grow: `error` is what `simulate` estimates for itself at its accuracy; above 1 a
scene is chaotic. And only where no switch hangs on a hair: `stands` is the largest of some relative changes, made to every number of the machine at random,
under which `simulate` itself goes on to switch the same in all of some runs. Behind the errors of CVODE stands the change that would shift the switches of
`simulate` as far as its own errors do, before the first switch that is not the same: `acts as`. Where that is above `stands`, a switch may be another one.
A row takes from a second to some minutes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from studies.benchmarks.fmu_grazes import graze
from studies.benchmarks.fmu_masters import (
    Switches,
    by_co_simulation,
    by_cvode,
    by_ecos,
    by_libcosim,
    by_own_master,
    compared,
    parted,
    seen_at_points,
    shift,
    switches_of,
)
from studies.command_line import parser_of
from studies.timing import timed
from toolbox import Scene, SceneError, export_fmu, simulate
from toolbox.modelling.closed_loop import ClosedLoop

SCENES = Path("studies/scenes")
TOLERANCES = (1e-4, 1e-6, 1e-8)
PERIODS = (1.0, 0.1, 1e-3)
WAYS: dict[str, tuple[str, Callable[[Path, float, float], Switches]]] = {
    "cvode": ("2.0", by_cvode),
    "own": ("2.0", by_own_master),
    "co-simulation": ("3.0", by_co_simulation),
    "ecos": ("2.0", by_ecos),
    "libcosim": ("2.0", by_libcosim),
}
"""{way: (version of FMI, master)}."""
AT_POINTS = ("ecos", "libcosim")
"""Ways that see modes at communication points only."""
CHANGES, DRAWS = (1e-5, 1e-6, 1e-7, 1e-8), 6
"""By what shares every number is changed, and how often, to see on what a scene's switches hang."""
BEGIN = 1e-6
"""Share of a run before which switches are not looked at: a contact that begins at zero slip may begin otherwise with any other number."""


def cell(
    way: str, path: Path, duration: float, setting: float, wanted: Switches, changed: Sequence[Switches] = (), change: float = 0.0
) -> tuple[str, str]:
    """The answer of one master, with what its errors act as if there are runs of `simulate` under such a change, and where CVODE parts, if it does."""
    try:
        switches, spent = timed(lambda: WAYS[way][1](path, duration, setting))
    except Exception as failure:  # whatever an importer raises
        return "failed: " + " ".join(str(failure).split())[-40:], ""
    found, all_, same, error = compared(switches, wanted)
    end = min([parted(switches, wanted), *(parted(each, wanted) for each in changed)])
    moved = np.median([shift(each, wanted, end) for each in changed]) if changed else 0.0
    words = f", as {change * shift(switches, wanted, end) / moved:.0e}" if moved else ""
    where = graze(path, duration, setting, switches, wanted) if way == "cvode" else None
    told = f"cvode {setting:g}: {where}" if where is not None else ""
    return (f"{error:.1e}, {spent:.2f} s" if found == all_ == same else f"{found} for {all_}, {same} same") + words, told


def under_changes(loop: ClosedLoop, change: float, duration: float) -> list[Switches]:
    """Switches of `simulate` when its numbers are changed at random by up to a share; equal ones are changed alike, as bounds may ask it."""
    system, draw, found = loop.system, np.random.default_rng(1), []
    values = {
        name: float(system.values[entry.offset])
        for name, entry in system.parameters.items()
        if entry.size is None and name not in loop.inputs
    }
    for _ in range(DRAWS):
        factors = {value: 1.0 + change * draw.uniform(-1.0, 1.0) for value in sorted({abs(value) for value in values.values() if value})}
        changed = {name: value * factors[abs(value)] for name, value in values.items() if value}
        try:
            run = simulate(loop.replace(parameters=dict(loop.parameters) | changed), method="explicit", accuracy=1e-10)
        except SceneError:  # a number that is whole, or at its bound
            continue
        found.append(after_begin(switches_of(run), duration))
    return found


def after_begin(switches: Switches, duration: float) -> Switches:
    """The switches behind the very begin."""
    return {element: [each for each in listed if each[0] > BEGIN * duration] for element, listed in switches.items()}


def stands(loop: ClosedLoop, wanted: Switches, duration: float) -> tuple[float, list[Switches]]:
    """The largest of CHANGES under which every run switches the same, and these runs; 0 and none where there is none."""
    kept = after_begin(wanted, duration)
    for change in CHANGES:
        found = under_changes(loop, change, duration)
        if found and all(count == all_ == same for count, all_, same, _ in (compared(each, kept) for each in found)):
            return change, found
    return 0.0, []


def row(loop: ClosedLoop, folder: Path, ways: Sequence[str], settings: Sequence[Sequence[float]]) -> tuple[list[str], list[str]]:
    """The cells of a loop: its switches, how an error grows in it, on what they hang, and what each master finds; and where CVODE parts.

    SceneError for one that cannot go.
    """
    versions = {WAYS[way][0] for way in ways}
    units = {version: export_fmu(loop, folder / f"unit{version[0]}.fmu", part="loop", version=version) for version in sorted(versions)}
    run, plain = simulate(loop, method="explicit", accuracy=1e-10), simulate(loop, method="explicit")
    wanted, duration = switches_of(run), float(run.duration)
    change, changed = stands(loop, wanted, duration)
    cells, notes = [str(sum(map(len, wanted.values()))), f"{plain.error_estimate or 0.0:.0e}", f"{change:.0e}"], []
    for way, chosen in zip(ways, settings, strict=True):
        for setting in chosen:
            there = seen_at_points(run, setting) if way in AT_POINTS else wanted
            known = (changed, change) if way == "cvode" else ()
            text, told = cell(way, units[WAYS[way][0]], duration, setting, there, *known)
            cells.append(text)
            notes += [told] if told else []
    return cells, notes


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, row by row."""
    parser = parser_of(__doc__)
    every = sorted(path.stem for path in SCENES.glob("*.toml"))
    parser.add_argument("scenes", nargs="*", default=every, metavar="SCENE", help="some of the shipped scenes; all without")
    parser.add_argument("--by", nargs="+", default=["cvode", "co-simulation"], choices=list(WAYS), help="masters")
    parser.add_argument("--tolerances", nargs="+", type=float, default=TOLERANCES, help="of those that integrate")
    parser.add_argument("--periods", nargs="+", type=float, default=PERIODS, help="communication steps [s]")
    given = parser.parse_args(arguments)
    settings = [given.periods if way in ("co-simulation", *AT_POINTS) else given.tolerances for way in given.by]
    heads = [f"{way} {setting:g}" for way, chosen in zip(given.by, settings, strict=True) for setting in chosen]
    print("  ".join([f"{'scene':<22}", "switches", "  error", "stands", *(f"{head:>38}" for head in heads)]), flush=True)
    for name in given.scenes:
        try:
            scene = Scene.load(SCENES / f"{name}.toml")
            with tempfile.TemporaryDirectory() as folder:
                cells, notes = row(scene[scene.labels[0]], Path(folder), given.by, settings)
            line = [f"{name:<22}", f"{cells[0]:>8}", f"{cells[1]:>7}", f"{cells[2]:>6}", *(f"{each:>38}" for each in cells[3:])]
            print("\n".join(["  ".join(line), *(f"{'':<24}{note}" for note in notes)]), flush=True)
        except SceneError as error:
            print(f"{name:<22}  {str(error)[:140]}", flush=True)


if __name__ == "__main__":
    main()
