"""Results of a long search kept in a file, one line each, so that a killed search goes on where it was.

Why a line at a time and not a file at the end: each result is appended by one write and forced to disk, so that a kill costs at most the line
being written, which is recognised by its missing end and dropped. The first line holds the arguments of the search: results of other arguments are not used.
"""

from __future__ import annotations

import errno
import functools
import hashlib
import json
import os
import re
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from toolbox.errors import SceneError
from toolbox.files.interrupts import undivided
from toolbox.files.reading import TEXT, content

FORMAT = "stickslip journal 2"

_HASH = re.compile("[0-9a-f]{16}")
"""What stands for a value in arguments, and says nothing to people."""

EARLIER = "stickslip journal 1"
"""Without checksums."""


class OtherSearch(SceneError):
    """A file holds the results of a search with other arguments."""


class Journal:
    """A file of results, each under a list of numbers as its key; numbers and results survive unchanged to the last bit.

    arguments: {name: text} of the search. An existing file must be a journal of the same arguments, or SceneError names the one that differs.
    fits: whether a result is one of this search; without it any is. word: the argument that names the file.
    """

    def __init__(
        self, path: str | Path, arguments: Mapping[str, str], fits: Callable[[Any], bool] = lambda result: True, word: str = "checkpoint"
    ):
        self.path, self._fits, self._word = Path(path), fits, word
        self.known: dict[tuple[float | None, ...], Any] = {}
        self.checked = True
        header = {"format": FORMAT, "arguments": dict(arguments)}
        try:
            there = content(self.path, TEXT, "journal", apart=True) if self.path.exists() else b""
            whole = there[: there.rfind(b"\n") + 1]
            if there and not whole and not _line(header).startswith(there):
                raise SceneError(f"Argument `{self._word}` must be a journal of an earlier search, but `{self.path}` is something else.")
            if len(whole) < len(there):
                with self.path.open("r+b") as file:
                    file.truncate(len(whole))
            if whole:
                self._read(whole.decode("utf-8", "replace").splitlines(), header)
            else:
                self._append(header)
        except OSError as error:
            raise SceneError(
                f"Argument `{self._word}` must be a file that can be written, but `{self.path}` cannot: {error.strerror}."
            ) from None

    def _read(self, lines: list[str], header: dict[str, Any]) -> None:
        found = _parsed(lines[0])
        if not isinstance(found, dict) or found.get("format") not in (FORMAT, EARLIER) or not isinstance(found.get("arguments"), dict):
            raise SceneError(
                f"Argument `{self._word}` must be a journal of an earlier search, but `{self.path}` is something else, or damaged in line 1."
            )
        theirs, ours = found["arguments"], header["arguments"]
        self.checked = found["format"] == FORMAT
        for name in {**ours, **theirs}:
            if theirs.get(name) != ours.get(name):
                old, new = (_shortened(each.get(name)) for each in (theirs, ours))
                told = "" if _HASH.fullmatch(old) and _HASH.fullmatch(new) else f": {old} there, {new} here"
                raise OtherSearch(
                    f"Argument `{self._word}` must come from a search with the same arguments, but `{self.path}` is of another `{name}`{told}. "
                    "Name another, or remove that one."
                )
        for number, line in enumerate(lines[1:], 2):
            entry = _parsed(line)
            whole = (
                isinstance(entry, dict)
                and isinstance(entry.get("numbers"), list)
                and "result" in entry
                and ("check" in entry) == self.checked
                and self._fits(entry["result"])
            )
            if not whole or not all(value is None or isinstance(value, (int, float)) for value in entry["numbers"]):
                raise SceneError(
                    f"Argument `{self._word}` must hold one result a line, but line {number} of `{self.path}` is none, or damaged: delete it, and the point is "
                    "tried again."
                )
            self.known[tuple(entry["numbers"])] = entry["result"]

    def add(self, numbers: tuple[float | None, ...], result: Any) -> None:
        """Keep a result; it is on the disk when this returns."""
        self._append({"numbers": numbers, "result": result})
        self.known[numbers] = result

    def _append(self, entry: dict[str, Any]) -> None:
        line = _line(entry, self.checked)
        handle = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            with undivided():
                written = os.write(handle, line)
                if written < len(line):
                    os.ftruncate(handle, os.fstat(handle).st_size - written)
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))
                os.fsync(handle)
        finally:
            os.close(handle)


def fingerprint(thing: Any) -> str:
    """Return a text that is the same for equal arguments in every process. Data is represented by `repr`, a function by its name, its code
    and the values that it encloses.

    What a function reads from its module is not part of it.
    """
    if isinstance(thing, functools.partial):
        return f"partial({fingerprint(thing.func)}, {[fingerprint(a) for a in thing.args]}, { {k: fingerprint(v) for k, v in thing.keywords.items()} })"
    code = getattr(thing, "__code__", None)
    if code is None:
        return re.sub(r" at 0x[0-9a-fA-F]+", "", repr(thing))
    digest = hashlib.sha256()
    waiting = [code]
    while waiting:
        each = waiting.pop()
        digest.update(each.co_code + repr((each.co_names, each.co_varnames)).encode())
        for constant in each.co_consts:
            if hasattr(constant, "co_code"):
                waiting.append(constant)
            elif isinstance(constant, frozenset):
                digest.update(repr(sorted(constant, key=repr)).encode())
            else:
                digest.update(repr(constant).encode())
    enclosed = [fingerprint(cell.cell_contents) for cell in thing.__closure__ or ()]
    enclosed += [fingerprint(value) for value in (*(thing.__defaults__ or ()), *(thing.__kwdefaults__ or {}).values())]
    digest.update(repr(enclosed).encode())
    return f"{thing.__module__}.{thing.__qualname__} {digest.hexdigest()[:16]}"


def _line(entry: dict[str, Any], checked: bool = True) -> bytes:
    """One line of a journal, with the checksum of its text."""
    text = json.dumps(entry)
    if checked:
        text = f'{text[:-1]}, "check": "{zlib.crc32(text.encode()):08x}"}}'
    return text.encode() + b"\n"


def _parsed(line: str) -> Any:
    """What a line holds; None where it is no JSON, or not what was written."""
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if isinstance(entry, dict) and "check" in entry:
        text = line[: line.rindex(', "check"')] + "}" if ', "check"' in line else ""
        if entry["check"] != f"{zlib.crc32(text.encode()):08x}":
            return None
    return entry


def _shortened(text: Any) -> str:
    words = "nothing" if text is None else str(text)
    return words if len(words) <= 200 else words[:160] + f"... ({hashlib.sha256(words.encode()).hexdigest()[:8]})"
