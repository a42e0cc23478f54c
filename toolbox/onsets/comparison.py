"""Onsets of several controllers side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from toolbox.errors import SceneError, suggest
from toolbox.files.printing import columns, shown, table
from toolbox.files.results import HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.unit_systems import reading
from toolbox.onsets.results import Onset


@dataclass(frozen=True)
class Comparison(Result):
    """Onsets of several controllers over one parameter, side by side: `print(comparison)`, `comparison.plot()`, `comparison["soft torque"]`."""

    onsets: Mapping[str, Onset]
    failures: Mapping[str, str] = field(default_factory=dict)

    def _table(self) -> HeadedRows:
        """One row per controller: its borders next to the working point."""
        unit = next((heading(each.parameter, each.unit) for each in self.onsets.values()), "")
        rows = [[label, found.loss, found.end, found.breakaway, ""] for label, found in self.onsets.items()]
        headings = ["controller", f"smooth lost, {unit}", "stick-slip ends", "break-away", "failure"]
        return headings, [*rows, *([label, math.nan, math.nan, math.nan, why] for label, why in self.failures.items())]

    def __getitem__(self, label: str) -> Onset:
        if label not in self.onsets:
            raise SceneError(f"There is no onset of `{label}`: {suggest(label, self.onsets)}")
        return self.onsets[label]

    def plot(self) -> Any:
        """Draw the bifurcation diagram of every controller, one panel each, on common axes, and return the axes. SceneError is raised if
        the onset of every controller failed."""
        from toolbox.onsets.figures import onset_panels

        return onset_panels(self.onsets)

    @cached_property
    def rows(self) -> list[tuple[str, ...]]:
        """One line per controller as text: name, Hopf point, loss, end, break-away, bistable band, verdict at the working point and margin."""
        lines = [("controller", "Hopf point", "smooth lost", "stick-slip ends", "break-away", "bistable", "at", "there", "margin")]
        for label, found in self.onsets.items():
            factor = reading(found.unit, found.display_units).factor
            inside = found.values[0] <= found.at <= found.values[-1]
            borders = [
                min(row, key=lambda b: abs(b.value - found.at)).margin(found.at) for row in (found.losses, found.ends, found.stalls) if row
            ]
            lines.append(
                (
                    label,
                    shown(factor * min((p.value for p in found.hopf), key=lambda v: abs(v - found.at), default=math.nan)),
                    shown(factor * found.loss),
                    shown(factor * found.end),
                    shown(factor * found.breakaway),
                    ", ".join(f"{low * factor:.3g} .. {high * factor:.3g}" for low, high in found.bistable) or "-",
                    f"{found.at * factor:.4g}",
                    found.verdict(found.at) if inside else "outside",
                    f"{100 * min(borders):+.0f} %" if borders else "-",
                )
            )
        return lines + [(label, "failed", *[""] * 7) for label in self.failures]

    def __str__(self) -> str:
        lines = columns(self.rows, indent="")
        lines.insert(1, "-" * max(map(len, lines)))
        return "\n".join([*self._title, *lines, *(f"{label} failed: {reason}" for label, reason in self.failures.items())])

    @property
    def _title(self) -> list[str]:
        """What is compared, with the unit of its values; nothing where all failed."""
        return [f"Borders over {heading(each.parameter, each._read.unit)}" for each in self.onsets.values()][:1]

    def _repr_html_(self) -> str:
        failed = [f"{label} failed: {reason}" for label, reason in self.failures.items()]
        return table(", ".join(self._title) or "Onsets of stick-slip", self.rows[0], self.rows[1:], failed)
