"""stickslip tune: the numbers of a control law that do best."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from toolbox.arguments import whole
from toolbox.commands import figures
from toolbox.commands.interrupt import NOTHING
from toolbox.commands.recording import results
from toolbox.commands.starting import add_start, start_given
from toolbox.commands.terminal import drawn_as, earlier, figure_format, ranges, show, side_by_side
from toolbox.errors import SceneError
from toolbox.messages import complaint

TUNE_FILES = ("tune.txt", "tune.png", "tune.npz", "trials.csv", "scene.toml")


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip tune`."""
    tuning = commands.add_parser(
        "tune",
        description="Search the free numbers of one control law for the smallest objective on all scenes, or for the front of several objectives, and print "
        "the numbers with the law as given beside them. The folder gets the report, a figure, every point tried (csv, npz), and each scene with "
        "the law as given and the tuned one, ready for `stickslip study`; that of the first is scene.toml, too: all of it, or nothing.",
        epilog="example: stickslip tune studies/scenes/jansen_2.toml --controller 'stiff PI' --range stiffpi.proportional=500:50e3 "
        "--range stiffpi.integral=50:20e3 --objective settling --out tuned",
    )
    tuning.add_argument("scenes", type=Path, nargs="+", metavar="SCENE.toml", help="one scene, or several that the law must do well on")
    tuning.add_argument(
        "--controller", required=True, metavar="LABEL", help="label of the controller whose numbers are tuned; every scene has it"
    )
    tuning.add_argument(
        "--range",
        action="append",
        required=True,
        metavar="NAME=LOW:HIGH",
        help="a number of the law and its range: SI, or with units, such as 'pi.proportional=500:50e3' or 'pi.integral=0.05:20 kN m/rad'; may be repeated",
    )
    tuning.add_argument(
        "--objective",
        action="append",
        required=True,
        metavar="NAME",
        help="what is made small, of `stickslip list metrics`, judged as the scene says; several give a front",
    )
    add_start(tuning, "where each scene begins")
    tuning.add_argument("--aggregate", choices=("worst", "mean"), default="worst", help="what counts of several scenes (worst)")
    tuning.add_argument("--runs", type=int, default=200, metavar="N", help="most points tried, one run per scene each (200)")
    tuning.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the search; the same seed gives the same result (0)")
    tuning.add_argument("--processes", type=int, default=1, metavar="N", help="how many simulate side by side; the result is the same (1)")
    tuning.add_argument(
        "--checkpoint", type=Path, metavar="FILE", help="keeps every point, so that a tuning that was stopped goes on where it was"
    )
    tuning.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for the results; those of an earlier tuning are replaced"
    )
    figure_format(tuning)
    tuning.set_defaults(action=run, spelled={"ranges": "--range", "controller": "--controller", "objective": "--objective"}, words=_words)


def run(given: argparse.Namespace) -> int:
    """Tune a law. Returns the exit code."""
    import statistics

    from toolbox.scenes.scene import Scene
    from toolbox.tuning.tune import tune

    scenes = {path: Scene.load(path) for path in given.scenes}
    if len(scenes) < len(given.scenes):
        raise SceneError("Argument `SCENE.toml` must name every scene once, but one is there twice.")
    bounds = ranges("--range", given.range)
    names = {
        path: f"tuned_{path.name}" if len({p.name for p in scenes}) == len(scenes) else f"tuned_{i}_{path.name}"
        for i, path in enumerate(scenes, 1)
    }
    whole("--processes", given.processes, 1)
    with (
        results(
            given,
            [*drawn_as(TUNE_FILES, given.format), *names.values()],
            earlier("tune.txt", "^Tuning of ", [*TUNE_FILES, "tuned_*.toml"]),
        ) as folder,
        side_by_side(given.processes) as executor,
    ):
        found = tune(
            list(scenes.values()), given.controller, list(given.objective), bounds,
            aggregate=statistics.fmean if given.aggregate == "mean" else max, runs=given.runs, seed=given.seed, checkpoint=given.checkpoint,
            executor=executor, starts=start_given(given, next(iter(scenes.values()))),
        )  # fmt: skip
        given.found = found
        (folder / "tune.txt").write_text(f"{found}\n", encoding="utf-8")
        found.save(folder / "trials.csv")
        found.save(folder / "tune.npz")
        if found.front:
            figures.draw_found(found, found.title, folder / f"tune.{given.format}")
            for path, scene in scenes.items():
                found.applied(scene, given.controller).save(folder / names[path])
        first = next(iter(scenes.values()))
        (found.applied(first, given.controller) if found.front else first).save(folder / "scene.toml")
    show(str(found))
    if not found.front:
        return complaint(f"the tuning found nothing; the points it tried are in {given.out}.", 1)
    print(f"\nReport, figure, points and tuned scenes are in {given.out}")
    return 0


def _words(given: argparse.Namespace) -> str:
    """What is said when it is interrupted."""
    return NOTHING if given.checkpoint is None else f"interrupted; the same command goes on from `{given.checkpoint}`."
