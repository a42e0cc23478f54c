"""stickslip export: a case of a scene for elsewhere, as C or as an FMU."""

from __future__ import annotations

import argparse
import contextlib
import re
from typing import Any

from toolbox.commands.terminal import common, plain
from toolbox.errors import SceneError


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip export`."""
    out = commands.add_parser(
        "export",
        parents=[
            common(
                "folder for what is written; files of the same name are replaced",
                required=True,
                controller="which case; the first without",
                drawn=False,
            )
        ],
        description="Write one case of a scene for other programs: the machine with its laws as C99 that locates every switch (a folder with sources, example, "
        "CMakeLists.txt and README.md), the law alone as C for a controller (NAME.c and NAME.h), or either as an FMU.",
        epilog="example: stickslip export studies/scenes/jansen_2.toml --controller 'softer PI, 100 Hz' --to c --out exported;   ... --to fmu --version 3.0;   "
        "... --to fmu --part law",
    )
    out.add_argument("--to", choices=("c", "fmu"), default="c", help="what is written (c)")
    out.add_argument(
        "--part", choices=("loop", "law"), help="the machine with its laws (which is what is written without), or the law alone"
    )
    out.add_argument("--version", choices=("2.0", "3.0"), help="version of FMI of a machine (2.0)")
    out.add_argument("--name", metavar="NAME", help="name of the files and functions, letters, digits and _; that of the scene without")
    out.add_argument(
        "--duration", type=plain, metavar="T", help="time over which the accuracy of a loop is promised; that of the scene without"
    )
    out.set_defaults(action=run)


def run(given: argparse.Namespace) -> int:
    """Write a case of a scene. Returns the exit code."""
    from toolbox.export.c_code import export_c
    from toolbox.export.fmu import export_fmu
    from toolbox.scenes.scene import Scene
    from toolbox.sweeps.store import folder_of

    part = given.part or "loop"
    if given.version is not None and (given.to, part) != ("fmu", "loop"):
        raise SceneError("Argument `--version` belongs to the fmu of a loop, but something else is written.")
    if part == "law" and given.duration is not None:
        raise SceneError("Argument `--duration` belongs to a loop, but a law is written, which has none.")
    scene = Scene.load(given.scene)
    loop = scene[scene.case(given.controller or scene.labels[0]).label]
    new = not given.out.exists()
    folder_of(given.out)
    path = given.out / (given.name or re.sub(r"\W", "_", given.scene.stem, flags=re.ASCII))
    try:
        if given.to == "fmu":
            unit = path.with_suffix(".fmu")
            written = [export_fmu(loop, unit, part=part, duration=given.duration, version=given.version or "2.0", resources=[given.scene])]
        elif part == "law":
            written = list(export_c(loop, path, part="law"))
        else:
            source, _ = export_c(loop, path, part="loop", duration=given.duration)
            written = sorted(each for each in source.parent.iterdir() if each.is_file())
    except SceneError:
        if new:
            with contextlib.suppress(OSError):  # what an export that failed on its way had written stays
                given.out.rmdir()
        raise
    given.found = {"title": loop.title, "files": [str(each) for each in written]}
    print(f"{loop.title}: {part} as {given.to}")
    for each in written:
        print(f"  {each}")
    return 0
