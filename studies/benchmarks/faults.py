"""Does the suite notice a deliberate fault? Comparisons, signs, operators and numbers are changed one at a time, drawn by a seed over all rooms.

Each fault is put into a copy of the tree; the tests of its room run first, then the whole quick suite, until one fails. Only lines that stand once are
changed, so that `--against` an earlier tree puts the same faults there: what that suite noticed and this one does not is an assertion lost.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGES = ("toolbox", "models", "controllers")
LONGEST = 3600.0
"""Seconds after which a suite hangs because of its fault."""
SWAPPED = {
    "<": ">",
    ">": "<",
    "<=": ">",
    ">=": "<",
    "==": "!=",
    "!=": "==",
    "+": "-",
    "-": "+",
    "*": "/",
    "/": "*",
    "and": "or",
    "or": "and",
}
SIGNS = {
    ast.Lt: "<", ast.Gt: ">", ast.LtE: "<=", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.And: "and", ast.Or: "or",
}  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """One changed line: the room and file where it was drawn, the line as it is and as it becomes."""

    room: str
    file: str
    line: str
    changed: str

    def put(self, tree: Path) -> bool:
        """Change the line where it stands in the tree; False where it does not stand there once."""
        places = [path for path in sources(tree) if self.line in map(str.strip, path.read_text(encoding="utf-8").splitlines())]
        if len(places) != 1:
            return False
        text = places[0].read_text(encoding="utf-8")
        places[0].write_text(text.replace(self.line, self.changed, 1), encoding="utf-8")
        return True


def sources(tree: Path) -> list[Path]:
    """The files of Python of the packages of a tree."""
    return sorted(path for package in PACKAGES for path in (tree / package).rglob("*.py"))


def changes(text: str) -> Iterator[tuple[int, int, int, str]]:
    """(line, column, end, what stands there then) of every change of one operator or number inside functions."""
    lines = text.splitlines()
    for function in (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)):
        for node in (inner for statement in function.body for inner in ast.walk(statement)):
            if isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.lineno == node.end_lineno:
                yield node.lineno, node.col_offset, node.end_col_offset or 0, f"{2 * node.value + 1!r}"
                continue
            if isinstance(node, ast.Compare):
                left, operator, right = node.left, node.ops[0], node.comparators[0]
            elif isinstance(node, ast.BinOp):
                left, operator, right = node.left, node.op, node.right
            elif isinstance(node, ast.BoolOp):
                left, operator, right = node.values[0], node.op, node.values[1]
            else:
                continue
            sign = SIGNS.get(type(operator))
            if sign is None or left.end_lineno != right.lineno or isinstance(left, ast.JoinedStr) or isinstance(right, ast.JoinedStr):
                continue
            begin = left.end_col_offset or 0
            between = lines[right.lineno - 1].encode()[begin : right.col_offset].decode()
            if between.strip() == sign:
                at = begin + between.index(sign)
                yield right.lineno, at, at + len(sign), SWAPPED[sign]


def drawn(trees: list[Path], count: int, seed: int) -> list[Fault]:
    """Faults over all rooms of the first tree, as many of each as can be, on lines that stand once in every tree."""
    often = [Counter(line.strip() for path in sources(tree) for line in path.read_text(encoding="utf-8").splitlines()) for tree in trees]
    found: dict[str, list[Fault]] = {}
    for path in sources(trees[0]):
        text = path.read_text(encoding="utf-8")
        own = path.relative_to(trees[0])
        room = own.parts[1] if own.parts[0] == "toolbox" and len(own.parts) > 2 else own.parts[0]
        for number, begin, end, then in changes(text):
            line = text.splitlines()[number - 1]
            raw = line.encode()
            changed = (raw[:begin] + then.encode() + raw[end:]).decode().strip()
            stands = all(lines[line.strip()] == 1 for lines in often)
            if stands and "raise" not in line and "Error(" not in line:
                found.setdefault(room, []).append(Fault(room, str(own), line.strip(), changed))
    dice = random.Random(seed)
    rooms = sorted(found)
    return [dice.choice(found[rooms[i % len(rooms)]]) for i in range(count)]


def caught(fault: Fault, tree: Path, workers: int) -> str:
    """The test that fails first in a copy of the tree with the fault; empty where none does."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "tree"
        shutil.copytree(tree, copy, ignore=shutil.ignore_patterns(".git", ".venv", "__pycache__", "results"))
        if not fault.put(copy):
            raise SystemExit(f"The line `{fault.line}` does not stand once in {tree}.")
        for tests in (f"tests/{fault.room}", "tests"):
            if not (copy / tests).is_dir():
                continue
            command = [
                sys.executable,
                "-m",
                "pytest",
                "-x",
                "-q",
                "--tb=no",
                "-m",
                "not slow",
                "-n",
                str(workers),
                "-p",
                "no:cacheprovider",
                tests,
            ]
            env = {**os.environ, "PYTHONPATH": str(copy)}
            with subprocess.Popen(
                command,
                cwd=copy,
                env=env,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                stdin=subprocess.DEVNULL,
                text=True,
                start_new_session=True,
            ) as tested:
                try:
                    printed = tested.communicate(timeout=LONGEST)[0]
                except subprocess.TimeoutExpired:
                    os.killpg(tested.pid, signal.SIGKILL)
                    return f"{tests}, which do not end"
            if tested.returncode:
                failed = [line for line in printed.splitlines() if line.startswith(("FAILED", "ERROR"))]
                return failed[0].split(" - ")[0].partition(" ")[2] if failed else "the import"
    return ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=50, help="number of faults (50); each takes one to ten minutes")
    parser.add_argument("--seed", type=int, default=0, help="of the draw (0)")
    parser.add_argument("--workers", type=int, default=2, help="processes of a test run (2)")
    parser.add_argument("--against", type=Path, help="an earlier tree, whose suite is asked about what this one misses")
    given = parser.parse_args()
    here = Path(__file__).resolve().parents[2]
    faults = drawn([here, *([given.against] if given.against else [])], given.count, given.seed)
    missed = lost = 0
    for number, fault in enumerate(faults, 1):
        by = caught(fault, here, given.workers)
        earlier = "" if by or given.against is None else caught(fault, given.against, given.workers)
        missed += not by
        lost += bool(earlier)
        end = by or (f"MISSED, though an earlier suite noticed it: {earlier}" if earlier else "missed")
        print(f"{number:3d}  {fault.file}\n     - {fault.line}\n     + {fault.changed}\n     {end}", flush=True)
    print(f"{len(faults) - missed} of {len(faults)} faults are noticed" + (f"; {lost} by the earlier suite alone" if given.against else ""))


if __name__ == "__main__":
    main()
