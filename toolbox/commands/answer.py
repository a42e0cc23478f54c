"""stickslip answer: does each controller of a scene end stick-slip, from which start and from which set-point on?"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from toolbox.arguments import number
from toolbox.commands.interrupt import goes_on
from toolbox.commands.margins import wrong_numbers
from toolbox.commands.recording import answer
from toolbox.commands.terminal import Ended, common, plain, ranges
from toolbox.errors import SceneError


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip answer`."""
    verb = commands.add_parser(
        "answer",
        parents=[
            common(
                "folder for tables, data and figure, and what is known of single set-points; that of an interrupted search is continued",
                scene="the plant and its controllers; see `stickslip list scene` for the keys",
            )
        ],
        description="Print for every controller of a scene whether it ends the stick-slip of another controller, whether stick-slip comes back after a start "
        "from rest and after a connection, whether it keeps a stick-slip of its own, whether it bears a number that is off, and what the takeover costs. With "
        "--range the lowest set-point that holds is searched for each of these starts. Every column names its start; all are judged alike.",
        epilog="example: stickslip answer studies/scenes/jansen_2.toml --initial-controller 'stiff PI' --controller 'soft torque' "
        "--range top.reference=60rpm:140rpm --out answered",
    )
    verb.add_argument(
        "--initial-controller",
        metavar="LABEL",
        help="the controller whose stick-slip is taken over; the first one of the scene without",
    )
    verb.add_argument(
        "--range", dest="knob", metavar="NAME=LOW:HIGH", help="the set-point and the range in which its lowest value that holds is searched"
    )
    verb.add_argument("--step", metavar="X", help="distance of the set-points that are tried; 1/40 of the range without")
    verb.add_argument("--phases", type=int, default=4, metavar="N", help="instants of the cycle at which a controller takes over (4)")
    verb.add_argument(
        "--uncertainty",
        action="append",
        default=[],
        metavar="NAME=20%",
        help="a number that may be off, one at a time; may be repeated; 10 %% of the weight without",
    )
    verb.add_argument("--duration", default="200 s", metavar="T", help="time for which a run lasts at least ('200 s')")
    verb.set_defaults(action=run, spelled={"bounds": "--range"}, words=lambda given: goes_on(given.out))


def run(given: argparse.Namespace) -> int:
    """Answer for every controller. Returns the exit code."""
    from toolbox.drilling.answer_results import Answers
    from toolbox.drilling.answer_table import answers, knob_of
    from toolbox.scenes.scene import Scene
    from toolbox.sweeps.store import folder_of

    scene = Scene.load(given.scene)
    having = [each for each in scene.labels if scene[each].controllers]
    if not having:
        raise SceneError("Argument `SCENE.toml` must have a controller to be asked about, but none of its cases has one.")
    first = scene.case(given.initial_controller or having[0]).label
    if len(scene[first].controllers) != 1:
        raise SceneError(
            f"Argument `--initial-controller` must name a case with one controller, but `{first}` has {len(scene[first].controllers)}."
        )
    labels = [scene.case(label).label for label in given.controller or [each for each in having if each != first] or having]
    bounds = None
    if given.knob is not None:
        ((name, bounds),) = ranges("--range", [given.knob]).items()
        knob, own = knob_of(scene[labels[0]]), scene[labels[0]].number(name).name
        if own != knob:
            raise SceneError(f"Argument `--range` must give the range of the set-point `{knob}`, but it gives that of `{own}`.")
    shares = wrong_numbers("--uncertainty", given.uncertainty)
    whole = next((name for name, share in shares.items() if isinstance(share, tuple)), None)
    if whole is not None:
        raise SceneError(f"Argument `--uncertainty` must give a share such as `{whole}=20%`, but it gives a range.")
    if given.out is not None:
        folder_of(given.out)

    ended = None if given.quiet else Ended(labels)

    def tell(found: Answers) -> None:
        if ended is not None and found.results:
            ended(list(found.results)[-1])

    found = answers(
        {label: scene[label] for label in labels},
        scene[first].controllers[0],
        bounds=bounds,
        step=None if given.step is None else plain(given.step),
        uncertainty={name: (1.0 - share, 1.0 + share) for name, share in shares.items()} or None,
        phases=given.phases,
        duration=number("--duration", plain(given.duration), "s", above=0),
        title=scene.title,
        checkpoint=None if given.out is None else Path(given.out) / "answer.jsonl",
        callback=tell,
    )
    return answer(given, "answer", found, scene, "^Stick-slip of ", "Tables, data and figure are", last=False)
