"""stickslip simulate: one controller of a scene, or all, run once, with the error that each run measures of itself."""

from __future__ import annotations

import argparse
import dataclasses
import glob
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.commands import figures
from toolbox.commands.recording import results, untimed
from toolbox.commands.starting import add_start, begun, start_given
from toolbox.commands.terminal import asked_otherwise, common, drawn_as, earlier, file_stems, otherwise, plain, progress, show
from toolbox.errors import SceneError, SimulationError
from toolbox.files.units import parse
from toolbox.messages import LOG
from toolbox.simulation.methods import METHODS

if TYPE_CHECKING:
    from toolbox.robustness.starts import Start

REPORT, SCENE = "simulate.txt", "scene.toml"
RUN_FILES = (".npz", ".csv", ".png")


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip simulate`."""
    single = commands.add_parser(
        "simulate",
        parents=[common("folder for report, figures and data; those of an earlier simulation are replaced")],
        description="Simulate one controller of a scene, or all, and print each run with its measured error. With --out, the folder gets the report, the scene "
        "and, for each run, all signals (npz), the table of its scalar signals in SI with units in the headings (csv) and a figure with time traces: all "
        "of it, or nothing.",
        epilog="example: stickslip simulate studies/scenes/jansen_2.toml --controller 'soft torque' --duration 60 --out run",
    )
    single.add_argument(
        "--duration", type=plain, metavar="T", help="what to simulate: seconds, or with a unit such as '2 min'; that of the scene without"
    )
    single.add_argument(
        "--method",
        choices=METHODS,
        metavar="M",
        help=f"{', '.join(METHODS)} (event); none for a body with many contacts",
    )
    single.add_argument(
        "--accuracy", type=float, metavar="A", help="target for the error of a state in parts of its size; that of the scene without"
    )
    add_start(single, "where the scene begins")
    asked_otherwise(single)
    single.set_defaults(action=run)


def run(given: argparse.Namespace) -> int:
    """Simulate cases of a scene. Returns the exit code."""
    scene, simulated, starts = _asked(given)
    labels = [*simulated]
    stems = file_stems(labels)
    declared = hasattr(scene, "save") and scene.duration > 0  # a body with many contacts has arrays that no scene holds
    head = [scene.title if starts is None else f"{scene.title}\nstarted from {starts.words}"]
    printed, texts = [*head], [*head]
    given.found, given.failures = {"title": scene.title, "runs": {}}, {}
    drawn = False
    with (
        results(
            given,
            [REPORT, *([SCENE] if declared else []), *(stem + tail for stem in stems for tail in drawn_as(RUN_FILES, given.format))],
            earlier(REPORT, "^Simulation of ", _left),
        ) as folder,
        progress(len(labels)) as reached,
    ):
        for i, (label, stem) in enumerate(zip(labels, stems, strict=True)):
            reached(i, label)
            complaint = ""
            try:
                found = simulated[label]()
            except SimulationError as failure:
                found, complaint = failure.run, f"failed: {failure}"
                given.failures[label] = str(failure)
            else:
                try:
                    found.error_estimate  # noqa: B018  measured here, so that the report has it
                except SimulationError as failure:  # the run to compare with may fail alone
                    complaint = f"its error could not be measured: {failure}"
            given.found["runs"][label] = {"failed": complaint} if found is None else {"failed": complaint, **_numbers(found)}
            before, after = [label, *([complaint] if complaint else [])], []
            if folder is not None and found is not None and found.time.size > 1:
                reached(i + 0.5, f"{label}: figure")
                untimed(found).save(folder / f"{stem}.npz")
                found.to_csv(folder / f"{stem}.csv")
                title = scene.title if len(scene.labels) == len(labels) == 1 else f"{scene.title}: {label}"
                figures.draw_found(found, title, folder / f"{stem}.{given.format}")
                drawn = True
                after.append(f"  files {stem}: npz, csv, {given.format}")
            printed.append("\n".join([*before, *([] if found is None else [str(found)]), *after]))
            texts.append("\n".join([*before, *([] if found is None else [str(untimed(found))]), *after]))
        if folder is not None:
            if declared:
                scene.save(folder / SCENE)
            (folder / REPORT).write_text(f"Simulation of {_joined(texts)}\n", encoding="utf-8")
    show(_joined(printed))
    if given.out:
        print(f"\n{'Report, figures and data are' if drawn else 'The report is'} in {given.out}")
    return 1 if len(given.failures) == len(labels) else 0


def _asked(given: argparse.Namespace) -> tuple[Any, dict[str, Callable[[], Any]], Start | None]:
    """The scene with the duration and accuracy that were asked for, {label: what runs it} of the runs, and their start if another one was asked for."""
    from toolbox.scenes.contact_scene import ContactScene, load_scene
    from toolbox.simulation.simulate import simulate

    scene = load_scene(given.scene)
    duration = None if given.duration is None else parse(given.duration, "s", "--duration")
    changes: dict[str, Any] = {name: value for name, value in (("duration", duration), ("accuracy", given.accuracy)) if value is not None}
    if isinstance(scene, ContactScene):
        for option in ("method", "accuracy", "law", "hold", "start"):
            if getattr(given, option) not in (None, []):
                raise SceneError(f"Argument --{option} must be left out, because the contacts of this scene are stepped by its `step`.")
        stepped = dataclasses.replace(scene, **changes)
        if changes:
            stepped.check()
        return stepped, {each: partial(stepped.run, each) for each in _labels(given, stepped)}, None
    scene = otherwise(scene, given)
    if duration is not None and duration <= scene.after:
        changes["after"] = duration / 2  # that a scene must judge from within its duration on, and the folder holds it
    scene = dataclasses.replace(scene, **changes)
    starts = start_given(given, scene, 1)
    loops, refused = begun(scene, _labels(given, scene), starts)
    for label, error in refused.items():
        LOG.warning("controller `%s` is not run: %s", label, error)
    return scene, {label: partial(simulate, loop, method=given.method or "event") for label, loop in loops.items()}, starts


def _labels(given: argparse.Namespace, scene: Any) -> list[str]:
    """Labels of the cases that are simulated, in full."""
    return [scene.case(label).label for label in given.controller or scene.labels]


def _left(report: str) -> list[str]:
    """Names of the files of a simulation, as its report tells."""
    stems = re.findall(r"^  files (\d\d\S*): npz, csv, \w{3}$", report, re.MULTILINE)
    return [REPORT, SCENE, *(glob.escape(stem) + tail for stem in stems if stem == Path(stem).name for tail in RUN_FILES)]


def _numbers(run: Any) -> dict[str, Any]:
    """What a run is, in numbers in SI; of a body with many contacts its time, its steps and how they stick at the end."""
    if not hasattr(run, "main_signals"):
        return {"end": run.end, "steps": len(run.time) - 1, "share": {word: run.share(word)[-1] for word in ("stick", "slip", "open")}}
    values = {name: run[name] for name in run.names}
    return {
        "end": run.end,
        "steps": run.steps[0],
        "events": len(run.events),
        "error": run.__dict__.get("error_estimate"),
        "signals": {name: {"lowest": v.min(), "highest": v.max(), "last": v[-1]} for name, v in values.items() if v.ndim == 1 and v.size},
    }


def _joined(texts: Sequence[str]) -> str:
    return "\n\n".join(texts)
