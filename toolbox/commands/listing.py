"""stickslip list: wells, models, control laws, observers and friction laws with their parameters and units, keys of a scene file, and measures."""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import re
import types
import typing
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from toolbox.commands.terminal import show
from toolbox.errors import SceneError
from toolbox.files.printing import columns


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip list`."""
    listing = commands.add_parser(
        "list",
        description="List what scene files can name, a line each: ready-made parts such as wells, models, control laws, observers and friction laws. With a "
        "name, its parameters, their values, units and meaning; for models made from tables, what those take. `stickslip list scene` lists the keys of a "
        "scene file, `stickslip list metrics` what every command can measure.",
        epilog="example: stickslip list BitRock",
    )
    listing.add_argument(
        "name",
        nargs="?",
        metavar="NAME",
        help="show the entry of this name, or those whose name or kind contains it, and name those that speak of it, else show these, and keys and "
        "measures; `scene`: the keys of a scene file; `measures`: what is measured",
    )
    listing.set_defaults(action=run)


def run(given: argparse.Namespace) -> int:
    """Print what there is. Returns the exit code."""
    from toolbox.scenes import catalogue

    if given.name in OTHERS:
        given.found = OTHERS[given.name]()
        return 0
    entries = catalogue.parts()
    if not entries:
        raise SceneError("No package offers parts: pip install -e . in the folder of the toolbox registers its own.")
    speaking: list[Any] = []
    if given.name is not None:
        entries, speaking = _sought(given.name.lower(), entries)
        if not entries and (other := {title: rows for title, rows in _others(given.name.lower()).items() if rows}):
            given.found = {title: [row[0] for row in rows] for title, rows in other.items()}
            for title, rows in other.items():
                print(title)
                _print(rows, "  ")
            return 0
    if not entries:
        catalogue.part(given.name)  # raises the error that says why
    given.found = [
        {"name": entry.name, "kind": entry.kind, "summary": entry.summary, "parameters": [_described(*each) for each in entry.parameters]}
        for entry in entries
    ]
    _print_parts(entries, given.name is not None)
    if given.name is None:
        show(
            "`stickslip list NAME` shows the parameters of an entry, `stickslip list scene` the keys of a scene file, `stickslip list metrics` all measures."
        )
    if speaking:
        show(f"Others that speak of it: {', '.join(entry.name for entry in speaking)}")
    return 0


def _print_parts(entries: Sequence[Any], in_full: bool) -> None:
    """Print entries under the headings of their kinds; in_full: with their parameters."""
    groups: dict[str, list[Any]] = {}
    for entry in entries:
        groups.setdefault(_heading(entry), []).append(entry)
    ready = [heading for heading in groups if heading not in HEADINGS]
    for heading in [*sorted(ready, reverse=True), *(heading for heading in HEADINGS if heading in groups)]:
        print(heading)
        for entry in groups[heading]:
            show(f"  {entry.name}: {entry.summary}")
            if not in_full:
                continue
            _print(_row(name, value, unit, meaning) for name, unit, value, meaning in entry.parameters)
            if isinstance(entry.item, type) and hasattr(entry.item, "from_tables"):
                print("    or made from tables, with")
                meanings = _meanings(entry.item.from_tables)
                _print(
                    _row(name, value, unit, "path of a table" if unit is None else meanings.get(name, ""))
                    for name, (unit, value) in _made_of(entry.item).items()
                )


def _key_rows() -> dict[str, list[tuple[str, str, str]]]:
    """{table of a scene file: (key with its unit, default, meaning) of its keys}."""
    from toolbox.scenes import keys

    return {
        "At its head" if table == "scene" else table: [
            (f"{key.name} [{key.unit}]" if key.unit else key.name, key.default, key.meaning) for key in entries_of
        ]
        for table, entries_of in keys.KEYS.items()
    }


def _measure_rows() -> list[tuple[str, str, str]]:
    """(name, what it looks at, what it is) of all measures."""
    from toolbox.measuring.metrics import METRICS

    return [
        (name, each.looks_at, each.heading + (f" [{each.unit}]" if each.unit not in ("", "1") else "")) for name, each in METRICS.items()
    ]


def _print_keys() -> Any:
    from toolbox.scenes import keys

    print("Keys of a scene file; numbers are SI or text with a unit")
    for table, rows in _key_rows().items():
        print(table)
        _print(rows, "  ")
    return keys.KEYS


def _print_measures() -> Any:
    from toolbox.measuring.metrics import METRICS

    print("Measures, of what a scene judges")
    _print(_measure_rows(), "  ")
    return {name: {"looks at": each.looks_at, "heading": each.heading, "unit": each.unit} for name, each in METRICS.items()}


OTHERS: dict[str, Callable[[], Any]] = {"scene": _print_keys, "metrics": _print_measures}
"""What is listed besides parts, by its name: it prints it and returns it."""


def _sought(words: str, entries: Sequence[Any]) -> tuple[list[Any], list[Any]]:
    """The entry of that very name, or those with the words in their names, then those of such a kind; and the others that have them or speak of them.

    The latter come first where there are no such names and kinds. Names are the same with blanks and hyphens, as in "soft torque".
    """
    whole = re.sub(r"[\s_-]", "", words)

    def speaks(entry: Any) -> bool:
        text = " ".join([entry.summary, *(each[3] for each in entry.parameters)]).lower()
        return all(word in text for word in words.split())

    named = [entry for entry in entries if whole in entry.name.lower()]
    named.sort(key=lambda entry: not entry.name.lower().startswith(whole))
    named += [entry for entry in entries if entry not in named and words in _heading(entry).lower()]
    speaking = [entry for entry in entries if entry not in named and speaks(entry)]
    if exact := [entry for entry in named if entry.name.lower() == whole]:
        return exact, [entry for entry in named if entry not in exact] + speaking
    return (named, speaking) if named else (speaking, [])


def _others(words: str) -> dict[str, list[tuple[str, str, str]]]:
    """{what it is: rows} of keys of a scene file and of measures that speak of the words."""
    listed = {f"Keys of a scene file, {table}": rows for table, rows in _key_rows().items()} | {"Measures": _measure_rows()}
    return {title: [row for row in rows if words in " ".join(map(str, row)).lower()] for title, rows in listed.items()}


def _described(name: str, unit: str, value: Any, meaning: str) -> dict[str, Any]:
    return {"name": name, "unit": unit, "value": None if value is dataclasses.MISSING else value, "meaning": meaning}


HEADINGS = ("Models", "Bodies with many contacts", "Control laws", "Observers", "Friction laws")
"""Headings of what is a class; ready-made parts stand before them, under the name of their module."""


def _heading(entry: Any) -> str:
    from toolbox.modelling.observers import Observer

    if not isinstance(entry.item, type):
        return entry.name.rpartition(".")[0].capitalize() or "Ready-made parts"
    if issubclass(entry.item, Observer):
        return "Observers"
    return {"part": "Models", "contact body": "Bodies with many contacts", "control law": "Control laws", "friction law": "Friction laws"}[
        entry.kind
    ]


def _row(name: str, value: Any, unit: str | None, meaning: str) -> tuple[str, str]:
    shown = "required" if value is dataclasses.MISSING else _shown(value)
    known = "" if unit in (None, "", "1") or value is None else unit
    return name, " ".join(filter(None, [shown, known, meaning and f" {meaning}"]))


def _print(rows: Iterable[Sequence[str]], indent: str = "    ") -> None:
    for line in columns(list(rows), range(3), indent):
        show(line)


def _made_of(item: Any) -> dict[str, tuple[str | None, Any]]:
    """{argument of `from_tables`: (unit, default)}: the unit None for the path of a table, the default MISSING where it is required."""
    hints = typing.get_type_hints(item.from_tables, include_extras=True)
    found: dict[str, tuple[str | None, Any]] = {}
    for name, argument in inspect.signature(item.from_tables).parameters.items():
        hint = hints[name]
        unit: str | None = hint.__metadata__[0] if typing.get_origin(hint) is typing.Annotated else ""
        if Path in (typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)):
            unit = None
        if name != "name":
            found[name] = (unit, dataclasses.MISSING if argument.default is inspect.Parameter.empty else argument.default)
    return found


def _meanings(function: Any) -> dict[str, str]:
    """{parameter: what its docstring says of it, up to the end of the first clause and without the unit, which stands beside}."""
    _, _, told = (inspect.getdoc(function) or "").partition("Parameters\n----------\n")
    found: dict[str, str] = {}
    for names, text in re.findall(r"^(\w+(?:, \w+)*)\n((?:    .*\n?)+)", told.partition("\n\n")[0], re.MULTILINE):
        clause = re.sub(r" \[[^]]*\]", "", re.split(r"[.;:](?: |$)", " ".join(text.split()))[0])
        found |= dict.fromkeys(names.split(", "), clause[:1].lower() + clause[1:])
    return found


LONGEST = 8
"""Most entries of a row that are shown one by one."""


def _shown(value: Any) -> str:
    from toolbox.modelling.laws import Controller
    from toolbox.modelling.observers import Observer

    if isinstance(value, tuple):
        shown = [*map(_shown, value)]
        return f"[{', '.join(shown)}]" if len(shown) <= LONGEST else f"[{shown[0]}, {shown[1]}, ... {shown[-1]}] ({len(shown)} values)"
    if isinstance(value, float):
        return f"{value:.10g}"
    if type(value) in (Controller, Observer):
        return "the controller under `law`" if type(value) is Controller else "required"
    if isinstance(value, Controller):
        return type(value).__name__
    if dataclasses.is_dataclass(value):
        return (
            f"{type(value).__name__}({', '.join(f'{spec.name}={_shown(getattr(value, spec.name))}' for spec in dataclasses.fields(value))})"
        )
    return "none" if value is None else str(value)
