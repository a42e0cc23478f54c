"""List the studies, or run one: `python -m studies`, `python -m studies drives --help`."""

from __future__ import annotations

import ast
import os
import runpy
import sys
from difflib import get_close_matches
from pathlib import Path

ROOMS = ("questions", "benchmarks")


def studies(room: str) -> dict[str, str]:
    """{name: what it asks} of the studies of a room that can be run."""
    found = {}
    for path in sorted((Path(__file__).parent / room).glob("[a-z]*.py")):
        text = path.read_text(encoding="utf-8")
        if '__name__ == "__main__"' in text:
            found[path.stem] = (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
    return found


def listing() -> str:
    """The studies of both rooms with what each asks."""
    rooms = {room: studies(room) for room in ROOMS}
    width = max(len(name) for names in rooms.values() for name in names)
    lines = ["Run one with: python -m studies NAME [--help]"]
    for room, names in rooms.items():
        lines += ["", room, *(f"  {name:<{width}}  {question}" for name, question in names.items())]
    return "\n".join([*lines, "", "The notebooks are built by: python -m studies.notebooks"])


def main(arguments: list[str]) -> int:
    """Run the study that is named first, with the other arguments as its own; without a name, list all."""
    if not arguments or arguments[0] in ("-h", "--help", "list"):
        print(listing())
        return 0
    name = arguments[0]
    where = {study: room for room in ROOMS for study in studies(room)}
    if name not in where:
        near = get_close_matches(name, where, 1)
        hint = f"did you mean {near[0]!r}?" if near else "`python -m studies` lists them."
        print(f"There is no study {name!r}: {hint}", file=sys.stderr)
        return 2
    text = (Path(__file__).parent / where[name] / f"{name}.py").read_text(encoding="utf-8")
    if {"-h", "--help"} & set(arguments[1:]) and "parser" not in text:  # a study without options of its own
        print(ast.get_docstring(ast.parse(text)))
        return 0
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded: see `toolbox.sweeps.executors.Workers`
    from toolbox.messages import write_log_to_stderr

    write_log_to_stderr()
    sys.argv = [name, *arguments[1:]]
    runpy.run_module(f"studies.{where[name]}.{name}", run_name="__main__", alter_sys=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
