"""What all commands say on the terminal, and how they name their files."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any


def complaint(text: str, code: int) -> int:
    """Say what went wrong on stderr, in one line, and return the exit code."""
    print(f"stickslip: {' '.join(text.split())}", file=sys.stderr)
    return code


def file_stems(labels: Sequence[str]) -> list[str]:
    """Beginnings of file names: numbered, so that they differ and keep the order of the scene."""
    plain = [re.sub(r"[^a-z0-9]+", "_", label.lower()).strip("_")[:40] for label in labels]
    return [f"{i:02d}_{word}".rstrip("_") for i, word in enumerate(plain, 1)]


@contextmanager
def progress(total: int) -> Iterator[Any]:
    """A bar on stderr, where that is a terminal, that appears after a second; yields a function of (cases done, what is going on)."""
    from tqdm import tqdm

    with tqdm(total=total, delay=1.0, leave=False, disable=None, bar_format="{desc} |{bar:30}| {percentage:3.0f}% {elapsed}") as bar:

        def reached(done: float, text: str) -> None:
            bar.set_description_str(text, refresh=False)
            bar.update(done - bar.n)

        yield reached


def plain(text: str) -> Any:
    """A number, or text with a unit for `units.parse`."""
    try:
        return float(text)
    except ValueError:
        return text
