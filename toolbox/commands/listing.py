"""stickslip list: parts, control laws and friction laws with their parameters and units."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any

from toolbox.errors import SceneError


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip list`."""
    listing = commands.add_parser("list", help="list parts, control laws and friction laws with their parameters and units")
    listing.add_argument("name", nargs="?", help="show only the entries whose name contains this")
    listing.set_defaults(action=run)


def run(given: argparse.Namespace) -> int:
    """Print what there is. Returns the exit code."""
    from toolbox import catalogue

    entries = [entry for entry in catalogue.parts() if given.name is None or given.name.lower() in entry.name.lower()]
    if not entries:
        if given.name is None:
            raise SceneError("No package offers parts: install stickslip-toolbox (pip install .) to register its own.")
        catalogue.part(given.name)  # raises the error that says why
    for kind in catalogue.KINDS:
        if any(entry.kind == kind for entry in entries):
            print(f"{kind.capitalize()}s")
        for entry in entries:
            if entry.kind == kind:
                print(f"  {entry.name}: {entry.summary}")
                for name, unit, value, meaning in entry.parameters:
                    shown = "required" if value is dataclasses.MISSING else _shown(value)
                    print(
                        "    "
                        + " ".join(
                            filter(None, [f"{name:<16} {shown}", "" if unit == "1" or value is None else unit, meaning and f" {meaning}"])
                        )
                    )
    return 0


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_shown, value)) + "]"
    if isinstance(value, float):
        return f"{value:.10g}"
    if dataclasses.is_dataclass(value):
        return (
            f"{type(value).__name__}({', '.join(f'{spec.name}={_shown(getattr(value, spec.name))}' for spec in dataclasses.fields(value))})"
        )
    return "none" if value is None else str(value)
