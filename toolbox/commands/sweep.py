"""stickslip sweep and stickslip map: a scene over grids of its numbers."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from toolbox.commands.terminal import file_stems, plain
from toolbox.errors import SceneError

GOES_ON = "interrupted; the same call goes on from here."


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip sweep` and `stickslip map`."""
    many = commands.add_parser(
        "sweep",
        help="simulate a scene over a grid of parameters, on all cores",
        description="Simulate every controller of a scene over a grid of inputs and parameters. The folder gets one folder per controller with the "
        "result (sweep.npz, and sweep.csv in SI units); an interrupted sweep that is called again goes on where it was.",
        epilog="example: stickslip sweep studies/scenes/jansen_2.toml --vary bit.weight=50kN:110kN:20 --vary top.reference=3:14:50 "
        "--controller 'stiff PI' --measure severity --out swept",
    )
    many.add_argument("scene", type=Path, metavar="SCENE.toml", help="the machine and its controllers")
    many.add_argument(
        "--vary",
        action="append",
        required=True,
        metavar="NAME=LOW:HIGH:N",
        help="N values of an input or parameter; SI, or with units (50kN:110kN:20)",
    )
    many.add_argument("--measure", action="append", metavar="NAME", help="what is measured (severity, stuck_ratio); may be repeated")
    many.add_argument("--controller", metavar="LABEL", action="append", help="only this one; may be repeated")
    many.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for the results; that of an interrupted sweep is continued"
    )
    many.set_defaults(action=run, interrupted=GOES_ON)
    chart = commands.add_parser(
        "map",
        help="severity of stick-slip over two parameters, with its borders",
        description="Simulate every controller of a scene over two inputs or parameters, from smooth running and from inside stick-slip, find the linear and "
        "both simulated borders, print and draw them. The folder gets one folder per controller with figure, report and data (map.npz); an interrupted map "
        "that is called again goes on where it was.",
        epilog="example: stickslip map studies/scenes/jansen_2.toml --x top.reference=3:14 --y bit.weight=50kN:110kN --controller 'stiff PI' --out mapped",
    )
    chart.add_argument("scene", type=Path, metavar="SCENE.toml", help="the machine and its controllers")
    chart.add_argument(
        "--x", required=True, metavar="NAME=LOW:HIGH", help="what varies along the first axis; SI, or with units (50kN:110kN)"
    )
    chart.add_argument("--y", required=True, metavar="NAME=LOW:HIGH", help="what varies along the second axis")
    chart.add_argument("--shape", default="50x50", metavar="NxM", help="points along both axes (50x50)")
    chart.add_argument("--controller", metavar="LABEL", action="append", help="only this one; may be repeated")
    chart.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for the results; that of an interrupted map is continued"
    )
    chart.set_defaults(action=run_map, interrupted=GOES_ON)


def run(given: argparse.Namespace) -> int:
    """Sweep a scene over a grid. Returns the exit code."""
    import numpy as np

    from toolbox.scene import Scene
    from toolbox.sweep import sweep

    scene = Scene.load(given.scene)
    labels = [scene.case(label).label for label in given.controller or scene.labels]
    failed = 0
    for label, stem in zip(labels, file_stems(labels), strict=True):
        axes = {}
        for text in given.vary:
            name, _, span = text.partition("=")
            ends = span.split(":")
            if len(ends) != 3 or not ends[2].strip().isdigit() or int(ends[2]) < 1:
                raise SceneError(f"Argument `--vary` must be NAME=LOW:HIGH:N, but it is `{text}`.")
            low, high = _ends(scene, label, name, ends[:2])
            axes[name] = np.linspace(low, high, int(ends[2]))
        found = sweep(scene, axes, controller=label, measures=given.measure or ("severity", "stuck_ratio"), out=given.out / stem)
        found.save(given.out / stem / "sweep.csv")
        failed += len(found.errors) == found.runs
        print(f"{found}\n")
    print(f"Results are in {given.out}")
    return 1 if failed == len(labels) else 0


def run_map(given: argparse.Namespace) -> int:
    """Map the severity of stick-slip over two numbers. Returns the exit code."""
    from toolbox import study
    from toolbox.scene import Scene
    from toolbox.severity_map import severity_map

    scene = Scene.load(given.scene)
    labels = [scene.case(label).label for label in given.controller or scene.labels]
    shape = given.shape.split("x")
    if len(shape) != 2 or not all(word.isdigit() for word in shape):
        raise SceneError(f"Argument `--shape` must be two numbers such as 50x50, but it is `{given.shape}`.")
    failures: dict[str, str] = {}
    unknown = []
    for label, stem in zip(labels, file_stems(labels), strict=True):
        over = {}
        for word, text in (("x", given.x), ("y", given.y)):
            name, _, span = text.partition("=")
            ends = span.split(":")
            if len(ends) != 2:
                raise SceneError(f"Argument `--{word}` must be NAME=LOW:HIGH, but it is `{text}`.")
            try:
                over[name] = _ends(scene, label, name, ends)
            except SceneError as error:
                unknown.append(error)
                if "There is no parameter" not in str(error) or len(unknown) == len(labels):
                    raise
                failures[label] = str(error)
                break
        if label in failures:
            continue
        folder = given.out / stem
        try:
            found = severity_map(scene, over, shape=(int(shape[0]), int(shape[1])), controller=label, out=folder)
        except SceneError as error:
            if "Argument" in str(error):
                raise
            failures[label] = str(error)
            continue
        (folder / "map.txt").write_text(f"{found}\n", encoding="utf-8")
        study.draw_found(found, found.title, folder / "map.png")
        print(f"{found}\n")
    for label, text in failures.items():
        print(f"{label}: {text}\n")
    print(f"Figures, reports and data are in {given.out}")
    return 1 if len(failures) == len(labels) else 0


def _ends(scene: Any, label: str, name: str, ends: Sequence[str]) -> tuple[float, float]:
    """Both ends of the range of what varies under one controller, in SI; raises SceneError for an unknown name or unit."""
    from toolbox.knob import Knob
    from toolbox.simulate import checked_run
    from toolbox.units import parse

    closed = checked_run(scene.plant(), scene.duration, **scene.arguments(scene.case(label))).system
    unit = Knob.of(closed, name).unit
    low, high = (parse(plain(end.strip()), unit, name) for end in ends)
    return low, high
