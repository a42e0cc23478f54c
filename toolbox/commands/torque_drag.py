"""stickslip torquedrag: hook load, drag and torque of the drill string of a scene in the operations of a rig."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from toolbox.commands import figures
from toolbox.commands.recording import answer
from toolbox.commands.terminal import common, plain, share, show
from toolbox.errors import SceneError, SimulationError
from toolbox.messages import complaint


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip torquedrag`."""
    verb = commands.add_parser(
        "torquedrag",
        parents=[common("folder for report, figure, table and data; those of an earlier call are replaced")],
        description="Compute torque and drag of the part of a scene that is made from a table of sections and a survey: rotating on and off bottom, picking "
        "up, slacking off, sliding with weight on bit, and with --overpull pulling on a stuck bit. Friction factors are those of the scene "
        "(`friction_factors`, or the kinetic coefficient of `friction`), or with --measured those of measured hook loads and torques. The torque on "
        "bit is that of the scene at its set-point.",
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
    verb.add_argument(
        "--measured",
        type=Path,
        metavar="FILE",
        help="table of measured hook loads and torques over the depth of the bit, from which friction factors are found; columns: `depth [m]`, "
        "`picking up [kN]`, `slacking off [kN]`, `rotating off bottom [kN]`, `torque off bottom [kN m]`",
    )
    verb.add_argument(
        "--friction-depth",
        type=plain,
        action="append",
        metavar="DEPTH",
        help="with --measured: measured depth at which a friction factor ends, such as the casing shoe; may be repeated, top first",
    )
    verb.add_argument(
        "--hook-weight",
        type=plain,
        metavar="F",
        help="with --measured: weight of hook and block in the hook loads; it is found, too, without",
    )
    verb.add_argument(
        "--change", metavar="PART", help="also change each number by this part, such as 10%%, and draw how much hook load and torque change"
    )
    verb.set_defaults(action=run)


def run(given: argparse.Namespace) -> int:
    """Compute torque and drag, with friction factors from measurements and effects of numbers if asked. Returns the exit code."""
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
    units = {"display_units": scene.display_units}
    asked: dict[str, Any] = dict(units)
    others: dict[str, Any] = {}
    factors = [(plain(depth), plain(factor)) for depth, factor in pairs("--friction", "DEPTH=FACTOR", given.friction)]
    if factors:
        asked["friction"] = factors
    if given.measured is None:
        for option, value in (("--friction-depth", given.friction_depth), ("--hook-weight", given.hook_weight)):
            if value is not None:
                raise SceneError(
                    f"Argument `{option}` must come with `--measured`, because it describes the measurements, but there are none."
                )
    else:
        if factors:
            raise SceneError(
                "Arguments `--friction` and `--measured` must not both be given, because friction factors are found from measurements."
            )
        calibrated = part.calibrated_friction(tables, given.measured, given.friction_depth, hook_weight=given.hook_weight, **units)
        others["friction_factors"] = calibrated
        show(f"{calibrated}\n")
        asked["friction"] = calibrated.friction
    asked["bit_torque"], note = (given.bit_torque, "") if given.bit_torque is not None else _bit_torque(scene)
    found = part.torque_and_drag(tables, overpull=given.overpull, **asked)
    if given.change is not None:
        others["effects"] = part.torque_and_drag_effects(tables, change=share("--change", given.change), **asked)
        show(f"{others['effects']}\n")
    if note:
        complaint(f"note: {note}", 0)

    def more(folder: Path) -> None:
        for name, each in others.items():
            (folder / f"{name}.txt").write_text(f"{each}\n", encoding="utf-8")
            each.save(folder / f"{name}.csv")
            each.save(folder / f"{name}.npz")
            figures.draw_found(each, scene.title, folder / f"{name}.{given.format}")

    also = [f"{name}.{ending}" for name in part.torque_drag_results for ending in ("txt", "csv", "npz", "png")]
    code = answer(given, "torquedrag", found, scene, "^Torque and drag", "Report, figure, table and data are", also=also, more=more)
    if others:
        given.found = {"torquedrag": found, **others}
    return code


def _bit_torque(scene: Any) -> tuple[float, str]:
    """(torque on bit at the set-point of a scene [N m], what to say of it)."""
    from toolbox.steady_states.linear import equilibrium

    try:
        return float(equilibrium(scene[scene.labels[0]])["bit.torque"]), ""
    except (SceneError, SimulationError, KeyError):
        return 0.0, "the torque on bit is taken as 0, because no steady running is known: give it as --bit-torque."
