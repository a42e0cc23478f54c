"""stickslip torquedrag: hook load, drag and torque of the drill string of a scene in the operations of a rig."""

from __future__ import annotations

import argparse
from typing import Any

from toolbox.commands.recording import answer
from toolbox.commands.terminal import common, plain
from toolbox.errors import SceneError, SimulationError
from toolbox.messages import complaint


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip torquedrag`."""
    verb = commands.add_parser(
        "torquedrag",
        parents=[common("folder for report, figure, table and data; those of an earlier call are replaced")],
        description="Compute torque and drag of the part of a scene that is made from a table of sections and a survey: rotating on and off bottom, picking "
        "up, slacking off, sliding with weight on bit, and with --overpull pulling on a stuck bit. Friction factors are those of the scene "
        "(`friction_factors`, or the kinetic coefficient of `friction`). The torque on bit is that of the scene at its set-point.",
        epilog="example: stickslip torquedrag well.toml --friction '2200 m=0.2' --friction '3800 m=0.3' --overpull '200 kN' --out torque_and_drag",
    )
    verb.add_argument(
        "--friction",
        action="append",
        default=[],
        metavar="DEPTH=FACTOR",
        help="friction factor down to a measured depth; may be repeated, top first",
    )
    verb.add_argument("--overpull", type=plain, default=0.0, metavar="F", help="tension at a stuck bit, such as '200 kN'")
    verb.add_argument("--bit-torque", type=plain, metavar="T", help="torque on bit on bottom; that of the scene at its set-point without")
    verb.set_defaults(action=run)


def run(given: argparse.Namespace) -> int:
    """Compute torque and drag. Returns the exit code."""
    from toolbox.commands.terminal import pairs
    from toolbox.scenes.scene import Scene
    from toolbox.scenes.scene_file import table_part

    scene = Scene.load(given.scene)
    try:
        part, tables = table_part(given.scene)
    except SceneError as error:
        raise SceneError(f"Scene `{given.scene}`: {error}") from None
    if not hasattr(part, "torque_and_drag"):
        raise SceneError(f"Scene `{given.scene}`: {part.__name__} has no torque and drag along a borehole; `DrillString` has.")
    asked: dict[str, Any] = {"overpull": given.overpull, "display_units": scene.display_units}
    factors = [(plain(depth), plain(factor)) for depth, factor in pairs("--friction", "DEPTH=FACTOR", given.friction)]
    if factors:
        asked["friction"] = factors
    asked["bit_torque"], note = (given.bit_torque, "") if given.bit_torque is not None else _bit_torque(scene)
    found = part.torque_and_drag(tables, **asked)
    if note:
        complaint(f"note: {note}", 0)
    return answer(given, "torquedrag", found, scene, "^Torque and drag", "Report, figure, table and data are")


def _bit_torque(scene: Any) -> tuple[float, str]:
    """(torque on bit at the set-point of a scene [N m], what to say of it)."""
    from toolbox.steady_states.linear import equilibrium

    try:
        return float(equilibrium(scene[scene.labels[0]])["bit.torque"]), ""
    except (SceneError, SimulationError, KeyError):
        return 0.0, "the torque on bit is taken as 0, because no steady running is known: give it as --bit-torque."
