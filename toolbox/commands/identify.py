"""stickslip identify: friction and mass of an axis or a joint from recordings."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from toolbox.arguments import number
from toolbox.commands import figures
from toolbox.commands.recording import results
from toolbox.commands.terminal import drawn_as, earlier, figure_format, held_of, hold_argument, log_arguments, pairs, plain, show
from toolbox.errors import SceneError

FILES = ("identify.txt", "identify.csv", "identify.npz", "scene.toml", "friction.png", "residuals.png")


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip identify`."""
    verb = commands.add_parser(
        "identify",
        description="Identify mass (or inertia), friction and offset of an axis or a joint from recordings of force (or torque) and position or speed: steps, "
        "sines, coast-downs, steady speeds. Several files are fitted together. A table without times holds steady points. Printed are the numbers with "
        "intervals of 95 %, the residuals, and which numbers the data do not tell, with the experiment that would.",
        epilog="example: stickslip identify steps.csv coast_down.csv --plant Joint --column time='t [s]' --column joint.speed='speed [rpm]' "
        "--column joint.torque='torque [N m]' --out identified",
    )
    verb.add_argument("data", type=Path, nargs="+", metavar="FILE", help="recordings: CSV, MAT, TOML, sheets")
    verb.add_argument("--plant", default="Axis", choices=("Axis", "Joint"), help="what moves: Axis (m, N) or Joint (rad, N m) (Axis)")
    verb.add_argument(
        "--number",
        metavar="FIELD=VALUE",
        action="append",
        default=[],
        help="a number that is known, such as mass='2.5 kg'; may be repeated",
    )
    verb.add_argument(
        "--shift",
        metavar="SIGNAL",
        action="append",
        default=[],
        help="a signal whose clock may be off; its delay is found; may be repeated",
    )
    verb.add_argument("--directions", action="store_true", help="find friction forwards and backwards apart")
    log_arguments(verb)
    hold_argument(verb)
    verb.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for report, table, arrays, scene to simulate, friction curve and residuals"
    )
    figure_format(verb)
    verb.set_defaults(
        action=run,
        spelled={
            "data": "FILE",
            "columns": "--column",
            "accepted_flaws": "--accept-flaw",
            "zero_order_hold": "--zero-order-hold",
            "fixed": "--number",
            "delayed_signals": "--shift",
        },
    )


def run(given: argparse.Namespace) -> int:
    """Identify a part. Returns the exit code."""
    from toolbox.calibration.identification import identify
    from toolbox.scenes.catalogue import part

    kind = part(given.plant)
    units = {each.name: each.metadata.get("unit", "") for each in dataclasses.fields(kind)}
    values = {}
    for name, text in pairs("--number", "FIELD=VALUE", given.number):
        if not units.get(name):
            raise SceneError(
                f"Argument `--number` must name a number of {given.plant}: {', '.join(n for n in units if units[n])}; but it is `{name}`."
            )
        values[name] = number(f"--number {name}", plain(text), units[name])
    columns: dict[str, list[str]] = {}
    for signal, heading in pairs("--column", "SIGNAL=HEADING", given.column):
        columns.setdefault(signal, []).append(heading)
    with results(given, drawn_as(FILES, given.format), earlier("identify.txt", "^Fit of ", FILES)) as folder:
        found = identify(
            [*given.data],
            kind(**values),
            columns=columns or None,
            fixed=[f"{kind.signal_prefix}.{name}" for name in values],
            delayed_signals=given.shift,
            directions=given.directions,
            zero_order_hold=held_of(given),
            accepted_flaws=given.accept_flaw,
        )
        given.found = found
        if folder is not None:
            (folder / "identify.txt").write_text(f"{found}\n", encoding="utf-8")
            found.save(folder / "identify.csv")
            found.save(folder / "identify.npz")
            found.scene().save(folder / "scene.toml")
            figures.draw_found(found, "Friction over speed", folder / f"friction.{given.format}")
            figures.draw_found(_Residuals(found), "Measured and model", folder / f"residuals.{given.format}")
    show(str(found))
    if given.out:
        print(f"\nReport, table, friction curve and residuals are in {given.out}")
        print(f"The identified plant is in {given.out / 'scene.toml'}: stickslip simulate {given.out / 'scene.toml'}")
    return 0


@dataclasses.dataclass(frozen=True)
class _Residuals:
    """The second picture of an identification."""

    found: Any

    def plot(self) -> Any:
        return self.found.plot_residuals()
