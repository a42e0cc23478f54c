"""The machine of a report: a sketch of its string, its numbers with units and sources, and the laws with the gains that one types into the drive."""

from __future__ import annotations

import contextlib
import html
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.files.printing import table
from toolbox.files.unit_systems import chosen, reading_of, use_units
from toolbox.modelling.closed_loop import ClosedLoop

LABELLED = 8
"""Inertias that a sketch names; of more it names the first, the last and the count."""


def usual_units(loop: ClosedLoop | None) -> contextlib.AbstractContextManager[Any]:
    """Return a context with the usual units of a page, if none were chosen: metric units (rpm, kN, kN m) for a string driven at the top and
    for a page without a machine, else the typed units or SI."""
    driven = loop is None or loop.plant.has_signal("top.speed")
    return use_units("metric") if chosen() is None and driven else contextlib.nullcontext()


def machine(loop: ClosedLoop) -> str:
    """Sketch and table of the machine of a loop."""
    with usual_units(loop):
        return _machine(loop)


def _machine(loop: ClosedLoop) -> str:
    rows = [row for row in _rows(loop) if row is not None]
    sources = sorted({source for number in loop.variable_numbers().values() if (source := number.bounds.get("source"))})
    notes = [f"Sources: {'; '.join(map(str, sources))}."] if sources else []
    drawn = sketch(loop)
    numbers = table("Numbers of the machine", ("number", "value", "unit", "meaning"), rows, notes)
    return f'<div class="machine">{drawn}{numbers}</div>' if drawn else numbers


def laws(loops: Iterable[tuple[str, ClosedLoop]]) -> str:
    """Table of the laws and the numbers that they took on this machine."""
    told: dict[str, list[str]] = {}
    for label, loop in loops:
        with usual_units(loop):
            lines = [line.strip() for line in str(loop).splitlines()[1:]]
        told[label] = lines if loop.controllers else ["no law", *lines]
    shared = [line for line in next(iter(told.values()), []) if len(told) > 1 and all(line in lines for lines in told.values())]
    each = {label: [line for line in lines if line not in shared] for label, lines in told.items()} | (
        {"all of them": shared} if shared else {}
    )
    rows = [(label if i == 0 else "", line) for label, lines in each.items() for i, line in enumerate(lines)]
    return table("Laws, with the numbers to type into the drive", ("controller", "its numbers"), rows)


def _rows(loop: ClosedLoop) -> list[tuple[str, str, str, str]]:
    """One row a number of the plant; entries of one vector share theirs."""
    names = set(loop.plant.inputs) | {name for name, number in loop.variable_numbers().items() if number.kind.has_slope}
    own = {name: number for name, number in loop.variable_numbers().items() if name in names and _of_plant(loop, name)}
    groups: dict[str, list[str]] = {}
    for name in own:
        groups.setdefault(re.sub(r"\.\d+$", "", name), []).append(name)
    rows = []
    for name, members in groups.items():
        number = own[members[0]]
        read = reading_of(number.unit, max(abs(own[member].value) for member in members), loop.display_units)
        values = [own[member].value * read.factor for member in members]
        meaning = number.meaning if number.overridden is None else f"{number.meaning} (without effect: the input {number.overridden} acts)"
        rows.append((name, _joined(values), "" if read.unit == "1" else read.unit, meaning))
    return rows


def _of_plant(loop: ClosedLoop, name: str) -> bool:
    return name in loop.plant.inputs or loop.plant.has_parameter(name)


def _joined(values: Sequence[float]) -> str:
    texts = ["in time" if np.isnan(value) else f"{value:.6g}" for value in values]
    if len(texts) > 1 and len(set(texts)) == 1:
        return f"{len(texts)} times {texts[0]}"
    return ", ".join(texts)


# ----------------------------------------------------------------------------------------------------------------------------------------- sketch
def sketch(loop: ClosedLoop) -> str:
    """Return the string as an SVG. Its inertias stand from the top to the bit, wider for a larger inertia. Empty if the plant has no
    string."""
    heavy = _inertias(loop)
    if len(heavy) < 2:
        return ""
    step = 190.0 / (len(heavy) - 1)
    widest, height = max(heavy), min(22.0, 0.6 * step)
    parts = [f'<line x1="60" y1="25" x2="60" y2="{25 + step * (len(heavy) - 1):.1f}" class="shaft"/>']
    for i, value in enumerate(heavy):
        half = 6.0 + 34.0 * np.sqrt(value / widest)
        y = 25 + i * step
        parts.append(f'<rect x="{60 - half:.1f}" y="{y - height / 2:.1f}" width="{2 * half:.1f}" height="{height:.1f}" class="mass"/>')
        if i in (0, len(heavy) - 1) or len(heavy) <= LABELLED:
            parts.append(f'<text x="108" y="{y + 4:.1f}">{value:.4g} kg m&#178;{_end(i, len(heavy))}</text>')
    if len(heavy) > LABELLED:
        parts.append(f'<text x="108" y="125">{len(heavy)} inertias</text>')
    contacts = ", ".join(each.name for each in loop.plant.elements)
    bottom = 25 + 190 + height / 2
    parts.append(f'<path d="M48 {bottom:.1f} L60 {bottom + 14:.1f} L72 {bottom:.1f} Z" class="mass"/>')
    parts.append(f'<text x="108" y="{bottom + 14:.1f}">friction: {html.escape(contacts) or "none"}</text>')
    return f'<svg class="sketch" viewBox="0 0 260 262" role="img" aria-label="The string from the top to the bit">{"".join(parts)}</svg>'


def _end(index: int, count: int) -> str:
    return {0: ", top", count - 1: ", bit"}.get(index, "")


def _inertias(loop: ClosedLoop) -> list[float]:
    """Inertias of the first string of the plant [kg m2]."""
    found: Mapping[str, float] = {
        name: number.value
        for name, number in loop.variable_numbers().items()
        if re.fullmatch(r"\w+\.inertia\.\d+", name) and number.unit == "kg m2"
    }
    first = next((name.partition(".")[0] for name in found), "")
    return [value for name, value in found.items() if name.startswith(f"{first}.")]
