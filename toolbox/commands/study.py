"""stickslip study: every controller of a scene simulated, judged, tabled and drawn."""

from __future__ import annotations

import argparse
import csv
import dataclasses
import glob
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.commands import figures
from toolbox.commands.recording import results, untimed
from toolbox.commands.starting import add_start, begun, start_given
from toolbox.commands.terminal import asked_otherwise, common, drawn_as, earlier, file_stems, loaded, otherwise, progress, show
from toolbox.errors import SceneError

if TYPE_CHECKING:
    from toolbox.modelling.closed_loop import ClosedLoop
    from toolbox.scenes.scene import Scene
    from toolbox.scenes.verdict_table import Row

COMMON_FILES = ("scene.toml", "study.txt", "table.csv", "comparison.png", "measured.csv")
MANY = 60
"""Columns of a run, an array of n values counting n, from which on a study writes those of its figures and its verdict alone."""
CASE_FILES = (".npz", ".png", "_phase.png", "_measured.png")


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip study`."""
    study = commands.add_parser(
        "study",
        parents=[
            common(
                "folder for the results; an earlier study in it is replaced, other files stay",
                required=True,
                controller=None,
                scene="what to simulate; see `stickslip list scene` for the keys, and studies/scenes",
            )
        ],
        description="Simulate every controller of a scene and print a table. The folder gets one figure with time traces, one phase plane and the "
        "trajectory (npz) per controller, a comparison, the table (csv, SI units) and the scene with every parameter in SI: all of it, or nothing. Where "
        "the scene names a log under [measured], also a figure per controller of what was measured beside what is simulated, and the deviations (csv).",
        epilog="example: stickslip study studies/scenes/navarro_lopez_4.toml --out results",
    )
    study.add_argument(
        "--metric",
        action="append",
        default=[],
        metavar="NAME",
        help="another column of the table: a name of `stickslip list metrics`; may be repeated",
    )
    study.add_argument(
        "--all-signals",
        action="store_true",
        help=f"write every signal of every run; without, a run of more than {MANY} columns leaves out arrays and the contacts that are not judged",
    )
    study.add_argument(
        "--refined",
        action="store_true",
        help="repeat every verdict with twice as many elements of a string that is lumped from tables, and print both side by side",
    )
    add_start(study, "where the scene begins")
    asked_otherwise(study)
    study.set_defaults(action=run, spelled={"metrics": "--metric"})


def run(given: argparse.Namespace) -> int:
    """Study a scene. Returns the exit code."""
    from toolbox.onsets import verdicts
    from toolbox.scenes.scene import Scene
    from toolbox.scenes.verdict_table import table, write_table
    from toolbox.steady_states.instability import instability

    scene = loaded(given)
    finer = otherwise(Scene.load(given.scene, refined=True), given) if given.refined else None
    starts = start_given(given, scene, 1)
    if starts is not None and scene.measured is not None:
        raise SceneError(
            "Argument `--start` must be left out for a scene with a log under `[measured]`, whose windows begin where the log does."
        )
    loops, refused = begun(scene, scene.labels, starts)
    again = {} if finer is None else begun(finer, finer.labels, starts)[0]
    begins = "" if starts is None else starts.words
    begins += ", after which both times begin" if any(loop.duration != scene.duration for loop in loops.values()) else ""
    stems = file_stems([*loops])
    names = drawn_as([*COMMON_FILES, *(stem + tail for stem in stems for tail in CASE_FILES)], given.format)
    with results(given, names, earlier("table.csv", "^controller,verdict,stuck,", _left)) as folder:
        rows, runs, left_out = [], {}, set[str]()
        with progress(len(loops)) as reached:
            for i, ((label, loop), stem) in enumerate(zip(loops.items(), stems, strict=True)):
                reached(i, label)
                row, run = verdicts.verdict_row(scene, label, stem, given.metric, loop if starts else None)
                rows.append(dataclasses.replace(row, start=begins))
                if run is not None and run.time.size > 1:
                    reached(i + 0.5, f"{label}: figures")
                    signals = None if given.all_signals else drawn_signals(run, scene.judged_contact)
                    if signals is not None:
                        left_out |= set(run.names) - set(signals)
                    untimed(run).save(folder / f"{stem}.npz", signals)
                    title = f"{label}: {row.verdict}"
                    figures.draw(scene, title, run, folder / f"{stem}.{given.format}", folder / f"{stem}_phase.{given.format}")
                    runs[title] = run
            if runs:
                reached(len(loops) - 0.1, "comparison")
                figures.draw_comparison(scene, runs, folder / f"comparison.{given.format}")
            notes = _beside_measured(scene, stems, folder, given.format) if scene.measured is not None else []
        given.found = {"title": scene.title, "rows": rows}
        write_table(rows, folder / "table.csv")
        scene.save(folder / "scene.toml")
        if left_out:
            size = sum(each.stat().st_size for each in folder.glob("*.npz")) / 1e6
            notes.append(
                f"Trajectories take {size:.3g} MB without {len(left_out)} signals of contacts that are not judged, which `--all-signals` writes, too."
            )
        warning = scene.dependencies().warning
        notes += [warning] if warning else []
        notes += [f"{label} not run: {error}" for label, error in refused.items()]
        notes += [_refined(finer, again, rows)] if finer is not None else []
        notes += [f"{label}: {unstable}" for label in scene.labels if (unstable := instability(scene[label]))]
        (folder / "study.txt").write_text("\n\n".join([table(scene, rows, times=False), *notes]) + "\n", encoding="utf-8")
    show("\n\n".join([table(scene, rows), *notes]))
    print(f"\n{'Figures, trajectories, table and scene' if runs else 'Table and scene'} are in {given.out}")
    return 1 if all(row.failed for row in rows) else 0


def _refined(finer: Scene, loops: Mapping[str, ClosedLoop], rows: Sequence[Row]) -> str:
    """The verdicts on the scene with twice as many elements, beside those of its own number; loops: of its runs."""
    from toolbox.files.printing import columns
    from toolbox.onsets import verdicts
    from toolbox.scenes.situation import mode_summaries

    again = {label: verdicts.verdict_row(finer, label, loop=loop)[0] for label, loop in loops.items()}
    pairs = [(row, again[row.controller]) for row in rows if row.controller in again]
    cells = [("controller", "verdict", "with twice the elements", "stuck", "with twice the elements")]
    cells += [(a.controller, a.verdict, b.verdict, f"{a.stuck:.3g} s", f"{b.stuck:.3g} s") for a, b in pairs]
    other = [a.controller for a, b in pairs if a.verdict != b.verdict]
    told = (
        f"The verdict on {', '.join(other)} depends on the number of elements."
        if other
        else "No verdict depends on the number of elements."
    )
    if missing := [row.controller for row in rows if row.controller not in again]:
        told += f" With twice as many elements, {', '.join(missing)} cannot start so."
    return "\n".join([f"With twice as many elements ({'; '.join(mode_summaries(finer.plant()))}):", *columns(cells, left=(0, 1, 2)), told])


def _beside_measured(scene: Any, stems: list[str], folder: Path, ending: str) -> list[str]:
    """Write what was measured beside what is simulated, for every controller; returns what to say of it."""
    from toolbox.calibration.validation import validate, write_deviations

    log, found = scene.measured, {}
    for label, stem in zip(scene.labels, stems, strict=True):
        found[label] = validate(scene[label], log.file, log.columns or None, list(log.windows) or None)
        figures.draw_found(found[label], f"{label}: measured and simulated", folder / f"{stem}_measured.{ending}")
    write_deviations(found, folder / "measured.csv")
    return [f"{label}: {each}" for label, each in found.items()]


def drawn_signals(run: Any, judged: str | None) -> list[str] | None:
    """Signals of a run with many columns that figures and verdict need: no arrays, no contacts but the judged one. None for all of a run with few."""
    import numpy as np  # here, because the help of the command needs none of it

    begin = run.at(run.begin)
    sizes = {name: np.size(begin[name]) for name in run.names}
    if sum(sizes.values()) <= MANY:
        return None
    others = tuple(f"{contact}." for contact in run.modes if contact != judged)
    kept = [name for name, size in sizes.items() if size == 1 and not name.startswith(others)]
    return list(dict.fromkeys([*kept, *(name for name in run.main_signals if name in sizes)]))


def _left(table: str) -> list[str]:
    """Names of the files of a study, as its table tells."""
    stems = [row["files"] for row in csv.DictReader(io.StringIO(table)) if row["files"]]
    return [*COMMON_FILES, *(glob.escape(stem) + tail for stem in stems if stem == Path(stem).name for tail in CASE_FILES)]
