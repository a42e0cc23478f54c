"""Where a folder of results comes from: the command, its input files, the versions, and what it wrote.

Everything else that a command writes is the same for the same inputs; dates and measured times stand in `origin.json` alone.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import platform
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path

from toolbox.files.archives import understood
from toolbox.files.reading import TEXT, content

ORIGIN = "origin.json"
"""Name of the file in a folder of results."""

PACKAGES = ("stickslip-toolbox", "casadi", "control", "numpy", "scipy", "osqp", "matplotlib", "llvmlite")
"""Packages whose versions decide what a command computes."""


@dataclass(frozen=True)
class Origin:
    """Where a folder of results comes from.

    Attributes
    ----------
    command
        The line that was called.
    began
        Instant at which it was called, as ISO 8601 in UTC.
    seconds
        Time until the results were written [s].
    versions
        {package: version}, with those of Python and the machine.
    inputs
        {path as it was given: SHA-256} of the files that were read.
    files
        {name: SHA-256} of the files that were written beside this one.
    failures
        {controller: why} of those that have no answer.
    """

    command: str
    began: str
    seconds: float
    versions: Mapping[str, str]
    inputs: Mapping[str, str]
    files: Mapping[str, str]
    failures: Mapping[str, str] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Write it into a folder."""
        (folder / ORIGIN).write_text(json.dumps(dataclasses.asdict(self), indent=1) + "\n", encoding="utf-8")

    @staticmethod
    def read(folder: Path) -> Origin:
        """Return the origin of a folder of results. SceneError is raised if the origin is missing or damaged."""
        with understood(folder / ORIGIN, "the origin of a folder of results"):
            told = json.loads(content(folder / ORIGIN, TEXT))
            found = Origin(**{"failures": {}, **told})
            texts = [
                found.command,
                found.began,
                *(text for each in (found.versions, found.inputs, found.files, found.failures) for pair in each.items() for text in pair),
            ]
            if not all(isinstance(text, str) for text in texts) or not isinstance(found.seconds, float):
                raise ValueError("its entries are of other kinds")
        return found

    def changed(self, folder: Path) -> list[str]:
        """Names of the files in the folder that are no longer what was written, or are gone. A path or a link out of the folder is not followed."""
        own = {name: folder / name for name in self.files if Path(name).name == name and not (folder / name).is_symlink()}
        return [name for name, told in self.files.items() if name not in own or hashes([own[name]]).get(str(own[name])) != told]


def hashes(paths: Iterable[Path]) -> dict[str, str]:
    """{path: SHA-256 in hexadecimal digits} of the regular files among some paths."""
    found = {}
    for path in paths:
        if path.is_file():
            with path.open("rb") as file:
                found[str(path)] = hashlib.file_digest(file, "sha256").hexdigest()
    return found


def versions() -> dict[str, str]:
    """Return the versions of the installed packages and of Python, and the kind of machine."""
    return {"Python": platform.python_version(), "machine": f"{platform.system()} {platform.machine()}", **_installed()}


@cache
def _installed() -> dict[str, str]:
    """Versions of the packages that are installed: reading them takes a fifth of the time of writing a small folder of results."""
    found = {}
    for package in PACKAGES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[package] = metadata.version(package)
    return found
