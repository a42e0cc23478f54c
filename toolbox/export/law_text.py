"""The C of a law by itself: its header, its step, and what it returns."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca

from toolbox.compilation.work_layout import NOT_FINITE
from toolbox.errors import SceneError
from toolbox.export.casadi_text import casadi_text
from toolbox.export.refusals import Refusals
from toolbox.files.atomic import replaced

OUTSIDE = 12
"""What a step of a law returns for gains that are refused; `NOT_FINITE` is that of a machine."""


@dataclass(frozen=True)
class Declared:
    """Contents of the header of a controller in C: its signals, its memory and its gains.

    Attributes
    ----------
    title, name, period
        Title of the header, NAME of the functions, and sample time [s].
    reads
        (signal, unit, default or None) of every signal that the controller reads.
    memory
        (name, unit) of every value of its memory.
    actuated_signals
        (signal, unit) of every signal that it gives.
    note
        Text that is added to the header.
    gains, refusals
        (name, unit, value) of every gain, and the conditions that gains must meet.

    Examples
    --------
    >>> from toolbox.authoring import Declared
    >>> declared = Declared("A damper", "damper", 0.01, [("top.speed", "rad/s", None)], [], [("top.torque", "N m")])
    >>> print(declared.name, len(declared.reads), "input,", len(declared.actuated_signals), "output")
    damper 1 input, 1 output
    """

    title: str
    name: str
    period: float
    reads: list[tuple[str, str, float | None]]
    memory: list[tuple[str, str]]
    actuated_signals: list[tuple[str, str]]
    note: str = ""
    gains: Sequence[tuple[str, str, float]] = ()
    refusals: Refusals | None = None


def written(c: Path, h: Path, declared: Declared, functions: Sequence[ca.Function], step: str | None = None) -> Declared:
    """Write a controller as a pair of C files: casadi functions, and the C code of NAME_step that calls them.

    `export_c` uses this function. A controller with its own method `export_c` calls it, too.

    Parameters
    ----------
    c, h
        Paths of both files.
    declared
        Contents of the header.
    functions
        The casadi functions.
    step
        C code of NAME_step. By default there is one function, (y, memory, gains) -> (u, next memory), and the step
        calls it.

    Returns
    -------
    Declared
        `declared`, as it was written.

    Examples
    --------
    >>> from pathlib import Path
    >>> import casadi as ca
    >>> from toolbox.authoring import Declared, written
    >>> y, memory, gains = ca.SX.sym("y", 1), ca.SX.sym("memory", 0), ca.SX.sym("gains", 0)
    >>> law = ca.Function("damper_law", [y, memory, gains], [-400.0 * y, memory])
    >>> declared = Declared("A damper", "damper", 0.01, [("top.speed", "rad/s", None)], [], [("top.torque", "N m")])
    >>> _ = written(Path("damper.c"), Path("damper.h"), declared, [law])
    >>> print("int damper_step(" in Path("damper.h").read_text())
    True
    """
    texts = (_header(declared), _source(declared, functions, step or _step(declared, functions[0])))
    replaced_together(dict(zip((h, c), texts, strict=True)))
    return declared


def replaced_together(texts: Mapping[Path, str]) -> None:
    """Write several text files in place of existing files, all or none. SceneError is raised if a file cannot be written."""
    with contextlib.ExitStack() as places:
        for path, text in texts.items():
            file = places.enter_context(replaced(path))
            file.write(text.encode())
            file.flush()  # a full disk shows before the first one takes its place


def c_paths(path: str | Path) -> tuple[Path, Path]:
    """The .c and .h file of an export; raises SceneError where the name is no name in C."""
    path = Path(path)
    bare = path.with_suffix("") if path.suffix in (".c", ".h") else path
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", bare.name):
        raise SceneError(f"Argument `path` must end in a name of C, letters, digits and _, but it is `{path}`.")
    return bare.with_name(bare.name + ".c"), bare.with_name(bare.name + ".h")


def _header(law: Declared) -> str:
    name, upper = law.name, law.name.upper()
    told = "{!r} before the first call", "set-point, {!r} unless it moves"

    def entries(symbol: str, rows: Sequence[tuple[str, str, str]]) -> list[str]:
        return [f" *   {symbol}[{i}]  {label} [{unit}]" + (f"  {note}" if note else "") for i, (label, unit, note) in enumerate(rows)] or [
            " *   none"
        ]

    lines = [
        f"/* {law.title}: a control law exported by stickslip-toolbox. SI units, angles in rad.",
        " *",
        f" * Call {name}_step once every {law.period!r} s, {name}_start before the first call. Nothing is allocated.",
        f" * Returns 0 for success. {upper}_NOT_FINITE: a command, or a value to be remembered, is no finite number; memory and commands stay as they were.",
        *(
            [f" * {upper}_OUTSIDE: a gain is no finite number, out of its bounds, or not allowed beside the others; nothing is computed."]
            if law.gains
            else []
        ),
        *([f" * {line}" for line in law.note.splitlines()] if law.note else []),
        " *",
        " * Reads:",
        *entries("y", [(n, unit, "" if value is None else told[n.endswith(".reference")].format(value)) for n, unit, value in law.reads]),
        " * Drives, held until the next call:",
        *entries("u", [(n, unit, "") for n, unit in law.actuated_signals]),
        " * Memory, which starts at 0:",
        *entries("memory", [(n, unit, "") for n, unit in law.memory]),
        *([" * Gains:", *entries("gains", [(n, unit, f"{value!r}") for n, unit, value in law.gains])] if law.gains else []),
        " */",
        f"#ifndef {upper}_H",
        f"#define {upper}_H",
        "",
        f"#define {upper}_READS {len(law.reads)}",
        f"#define {upper}_MEMORY {len(law.memory)}",
        f"#define {upper}_DRIVES {len(law.actuated_signals)}",
        f"#define {upper}_GAINS {len(law.gains)}",
        f"#define {upper}_PERIOD {float(law.period)!r}",
        f"#define {upper}_NOT_FINITE {NOT_FINITE}",
        f"#define {upper}_OUTSIDE {OUTSIDE}",
        "",
        "#ifdef __cplusplus",
        'extern "C" {',
        "#endif",
        "",
        f"void {name}_start(double *memory);",
        f"int {name}_step(const double *y, double *memory, double *u);",
        *(
            [
                f"void {name}_gains(double *gains);",
                f"int {name}_allowed(const double *gains); /* 0 for gains that {name}_step_with refuses */",
                f"int {name}_step_with(const double *gains, const double *y, double *memory, double *u);",
            ]
            if law.gains
            else []
        ),
        "",
        "#ifdef __cplusplus",
        "}",
        "#endif",
        "",
        f"#endif /* {upper}_H */",
        "",
    ]
    return "\n".join(lines)


def _source(law: Declared, functions: Sequence[ca.Function], step: str) -> str:
    """The functions as casadi writes them, and the two that are called; whatever is global begins with the name."""
    name = law.name
    body = casadi_text(name, functions)
    begin = [
        f"void {name}_start(double *memory) {{",
        *([f"  int i;\n  for (i = 0; i < {len(law.memory)}; ++i) memory[i] = 0.0;"] if law.memory else ["  (void)memory;"]),
        "}",
        "",
        "/* Keeps what a sample gives where all of it is finite. */",
        f"static int {name}_keep(const double *given, const double *next, double *memory, double *u) {{",
        "  int i;",
        f"  for (i = 0; i < {len(law.actuated_signals)}; ++i) if (!isfinite(given[i])) return {name.upper()}_NOT_FINITE;",
        f"  for (i = 0; i < {len(law.memory)}; ++i) if (!isfinite(next[i])) return {name.upper()}_NOT_FINITE;",
        f"  for (i = 0; i < {len(law.actuated_signals)}; ++i) u[i] = given[i];",
        f"  for (i = 0; i < {len(law.memory)}; ++i) memory[i] = next[i];",
        "  return 0;",
        "}",
    ]
    return f'#include "{name}.h"\n\n#include <math.h>\n\n{body}\n\n' + "\n".join(begin) + f"\n\n{step}"


def _step(law: Declared, function: ca.Function) -> str:
    name, many, gains = law.name, len(law.memory), len(law.gains)
    entry = f"static int {name}_sample(const double *gains, " if gains else f"int {name}_step("
    lines = [
        f"{entry}const double *y, double *memory, double *u) {{",
        f"  double given[{max(len(law.actuated_signals), 1)}], next[{max(many, 1)}], w[{max(function.sz_w(), 1)}];",
        f"  int iw[{max(function.sz_iw(), 1)}], failed;",
        f"  const double *arg[{max(function.sz_arg(), 3)}];",
        f"  double *res[{max(function.sz_res(), 2)}];",
        "  arg[0] = y;",
        "  arg[1] = memory;",
        f"  arg[2] = {'gains' if gains else '0'};",
        "  res[0] = given;",
        "  res[1] = next;",
        f"  failed = {function.name()}(arg, res, iw, w, 0);",
        f"  return failed ? failed : {name}_keep(given, next, memory, u);",
        "}",
        "",
    ]
    if gains:
        assert law.refusals is not None
        values = ", ".join(repr(float(value)) for _, _, value in law.gains)
        lines += [
            f"static const double {name}_values[{gains}] = {{{values}}};",
            "",
            law.refusals.text(name, ""),
            "",
            f"void {name}_gains(double *gains) {{",
            "  int i;",
            f"  for (i = 0; i < {gains}; ++i) gains[i] = {name}_values[i];",
            "}",
            "",
            f"int {name}_step(const double *y, double *memory, double *u) {{",
            f"  return {name}_sample({name}_values, y, memory, u);",
            "}",
            "",
            f"int {name}_step_with(const double *gains, const double *y, double *memory, double *u) {{",
            f"  return {name}_allowed(gains) ? {name}_sample(gains, y, memory, u) : {name.upper()}_OUTSIDE;",
            "}",
            "",
        ]
    return "\n".join(lines)
