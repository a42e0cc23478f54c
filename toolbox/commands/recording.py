"""Folders of results: written whole, with the origin of what is in them."""

from __future__ import annotations

import argparse
import copy
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

from toolbox.commands import figures
from toolbox.commands.terminal import drawn_as, earlier, show
from toolbox.files.atomic import whole_folder
from toolbox.files.origin import ORIGIN, Origin, hashes, versions

Timed = TypeVar("Timed")

WRITTEN = ("out", "checkpoint")
"""Arguments whose files a command writes, not reads."""


@contextmanager
def results(
    given: argparse.Namespace,
    names: Sequence[str],
    left_by: Callable[[Path], set[str]],
    out: Path | None = None,
    last: bool = True,
    beside: Sequence[str] = (),
) -> Iterator[Any]:
    """The folder of `--out` for the results of a command, with their origin, as `toolbox.files.atomic.whole_folder`; None where there is no `--out`.

    names: files that will be written;  left_by: function of a folder that names those of an earlier call;  out: another folder than that of `--out`;
    last: whether the command has nothing to do after it;  beside: names of results that stand in the folder already.
    """
    place = given.out if out is None else out
    if place is None:
        yield None
        return

    def left(path: Path) -> set[str]:
        found = left_by(path)
        return found | {ORIGIN} if found else found

    began, clock = datetime.now(UTC), time.perf_counter()
    read = _read(given, {})
    with whole_folder(place, [*names, ORIGIN], left, last) as folder:
        yield folder
        written = sorted([*folder.iterdir(), *(place / name for name in beside)], key=lambda path: path.name)
        files = {Path(path).name: told for path, told in hashes(written).items()}
        read = _read(given, read)
        seconds = round(time.perf_counter() - clock, 3)
        Origin(given.line, began.isoformat(timespec="seconds"), seconds, versions(), read, files, getattr(given, "failures", {})).write(
            folder
        )


def answer(
    given: argparse.Namespace,
    name: str,
    found: Any,
    scene: Any,
    mark: str,
    told: str,
    *,
    also: Sequence[str] = (),
    more: Callable[[Path], object] | None = None,
    last: bool = True,
) -> int:
    """Write what a command found into its folder, as text, table, data and figure of one name, with the scene; print it, and say where it is. Returns 0.

    mark: regular expression of what an earlier report holds;  told: what stands before "in" and the folder;  also: names of files that a call may have
    beside these, and more: function of the folder that writes them, where this one has them;  last: whether the command has nothing to do after it.
    """
    given.found = found
    files = (*(f"{name}.{ending}" for ending in ("txt", "csv", "npz", "png")), "scene.toml")
    names = drawn_as((*files, *(also if more else ())), given.format)
    with results(given, names, earlier(f"{name}.txt", mark, (*files, *also)), last=last) as folder:
        if folder is not None:
            (folder / f"{name}.txt").write_text(f"{found}\n", encoding="utf-8")
            found.save(folder / f"{name}.csv")
            found.save(folder / f"{name}.npz")
            figures.draw_found(found, scene.title, folder / f"{name}.{given.format}")
            scene.save(folder / "scene.toml")
            if more:
                more(folder)
    show(str(found))
    if given.out:
        print(f"\n{told} in {given.out}")
    return 0


def untimed(run: Timed) -> Timed:
    """A run without the time that it took, so that its file is the same each time."""
    found = copy.copy(run)
    found.wall_time = float("nan")  # type: ignore[attr-defined]
    return found


def _read(given: argparse.Namespace, known: Mapping[str, str]) -> dict[str, str]:
    """{path: SHA-256} of the files that a command was given or has read so far; known: those of before, which count as they were then."""
    typed = [path for name, value in vars(given).items() if name not in WRITTEN for path in _paths(value)]
    found = hashes(path for path in {*typed, *given.read} if str(path) not in known) | dict(known)
    return dict(sorted(found.items()))


def _paths(value: Any) -> list[Path]:
    return [each for each in (value if isinstance(value, list) else [value]) if isinstance(each, Path)]
