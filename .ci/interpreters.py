"""Print an interpreter of this machine: `lowest`, of the version that pyproject.toml asks for at least, or `newest`, of the newest release after it.

Looked for in PATH and among the versions of pyenv; CPython only, no pre-releases and no builds without the global lock, for which few packages are made.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"

ASK = """
import platform, sys, sysconfig
whole = platform.python_implementation() == "CPython" and sys.version_info[3] == "final" and not sysconfig.get_config_var("Py_GIL_DISABLED")
print("%d.%d.%d" % sys.version_info[:3] if whole else "")
"""


def least() -> tuple[int, int]:
    """Return the version that pyproject.toml asks for at least, such as (3, 11)."""
    major, minor = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]["requires-python"].removeprefix(">=").split(".")[:2]
    return int(major), int(minor)


def candidates(surroundings: Mapping[str, str]) -> Iterator[Path]:
    """Yield the files that are named like an interpreter of Python 3: in PATH, then among the versions of pyenv."""
    pyenv = Path(surroundings.get("PYENV_ROOT") or Path(surroundings.get("HOME") or "/nonexistent") / ".pyenv")
    folders = [Path(folder) for folder in surroundings.get("PATH", "").split(os.pathsep) if folder]
    for folder in [*folders, *sorted(pyenv.glob("versions/*/bin"))]:
        yield from (path for path in sorted(folder.glob("python3*")) if re.fullmatch(r"python3(\.\d+)?(\.exe)?", path.name))


def found(surroundings: Mapping[str, str]) -> dict[tuple[int, ...], Path]:
    """Return {version: interpreter}, for each version the first that answers."""
    known: dict[tuple[int, ...], Path] = {}
    asked: set[Path] = set()
    for path in candidates(surroundings):
        if path.resolve() in asked:
            continue
        asked.add(path.resolve())
        try:
            answer = subprocess.run([str(path), "-c", ASK], capture_output=True, text=True, timeout=60, check=True).stdout.strip()
        except (OSError, subprocess.SubprocessError):  # a shim of a version that is not installed
            continue
        if answer:
            known.setdefault(tuple(int(part) for part in answer.split(".")), path)
    return known


def main(which: str, surroundings: Mapping[str, str] = os.environ) -> None:
    """Print the interpreter that is asked for; exit with a sentence where there is none."""
    floor, known = least(), found(surroundings)
    name = ".".join(map(str, floor))
    if which == "lowest":
        fitting = [version for version in known if version[:2] == floor]
        missing = f"Python {name}"
    else:
        fitting = [version for version in known if version[:2] > floor]
        missing = f"a Python newer than {name}"
    if not fitting:
        there = ", ".join(".".join(map(str, version)) for version in sorted(known)) or "none"
        sys.exit(f"The checks need {missing}, in PATH or among the versions of pyenv, but there are: {there}.")
    print(known[max(fitting)])


if __name__ == "__main__":
    main(sys.argv[1])
