"""A gain schedule as C: the law itself, and the table of its gains over depth with linear interpolation."""

from __future__ import annotations

from pathlib import Path

from toolbox.drilling.gain_schedule import Schedule
from toolbox.errors import SceneError
from toolbox.export.c_code import export_c, only_law, opened
from toolbox.files.atomic import replaced
from toolbox.modelling.closed_loop import ClosedLoop, as_loop
from toolbox.modelling.hybrid_system import HybridSystem


def export_schedule(found: Schedule, machine: ClosedLoop | HybridSystem, path: str | Path) -> tuple[Path, Path, Path]:
    """Write the law of a schedule as C99, as `export_c` does, and its table: NAME.c, NAME.h and NAME_depth.c.

        void NAME_gains_at(double depth, double *gains);     depth in m, constant outside of the table

    A program calls it now and then with the depth of the bit and steps the law with `NAME_step_with(gains, y, memory, u)`, which keeps its memory.

    Parameters
    ----------
    found
        A schedule of a sampled law.
    machine
        The machine at any depth, which tells what the law reads; its own laws are left out.
    path
        Path of the law, without suffix or with that of either file.

    Returns
    -------
    tuple of Path
        The three files.

    Raises
    ------
    SceneError
        If the law is continuous, or has no form in C, or the schedule was loaded.
    """
    bare, rows = as_loop(machine).without_controllers, []
    for depth in found.depths:
        made, period = only_law(bare.replace(controllers=(found.law_at(depth),)))
        if period is None or hasattr(made, "export_c"):
            raise SceneError(
                "Argument `found` must be the schedule of a sampled law whose gains are numbers in C: give `Sampled` with one to `schedule`."
            )
        rows.append([value for _, _, value, _ in opened(made, period, gains=True).gains])
    c, h = export_c(bare.replace(controllers=(found.law_at(found.depths[0]),)), path)
    name, many, depths = c.stem, len(rows[0]), len(rows)
    table = c.with_name(f"{name}_depth.c")
    text = "\n".join(
        [
            f"/* Gains over depth of {found.title}: linear between the rows, constant outside. C99. */",
            f'#include "{h.name}"',
            "",
            f"void {name}_gains_at(double depth, double *gains);",
            "",
            f"static const double depths[{depths}] = {{{', '.join(map(repr, found.depths))}}}; /* m */",
            f"static const double table[{depths}][{many}] = {{",
            *(f"  {{{', '.join(repr(float(value)) for value in row)}}}," for row in rows),
            "};",
            "",
            f"void {name}_gains_at(double depth, double *gains) {{",
            "  int i = 0, k;",
            "  double part;",
            f"  while (i < {depths - 2} && depth > depths[i + 1]) ++i;",
            "  part = (depth - depths[i]) / (depths[i + 1] - depths[i]);",
            "  part = part > 0.0 ? part < 1.0 ? part : 1.0 : 0.0;",
            f"  for (k = 0; k < {many}; ++k) gains[k] = (1.0 - part) * table[i][k] + part * table[i + 1][k];",
            "}",
            "",
        ]
    )
    with replaced(table) as file:
        file.write(text.encode())
    return c, h, table
