"""Figures of a report: which ones a section shows, in which order, and their captions.

A folder shows every figure that its command wrote: the one of its kind beside the answer, all others in the appendix. A result in Python shows what its
`plot` draws. Nothing is drawn here: the figures of a subject stand in the `figures.py` of its room.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolbox.files.reading import TEXT, content

KINDS = {".png": "image/png", ".svg": "image/svg+xml"}
"""Figures that a page can hold."""

SHOWN = {"_phase": "phase plane", "_margins": "margins", "_error": "smallest error that breaks it"}
"""{end of the name of a figure of one controller: what it shows}; others show traces."""


@dataclass(frozen=True)
class Picture:
    """A figure of a page: its bytes, their kind, and its caption."""

    content: bytes
    kind: str
    caption: str


def figures_of_result(result: Any, caption: str) -> tuple[Picture, ...]:
    """The figures of a result in Python; none if it does not plot itself."""
    if not hasattr(result, "plot"):
        return ()
    import matplotlib.pyplot as plt
    import numpy as np

    figure = np.ravel(np.asarray(result.plot(), dtype=object))[0].figure
    file = io.BytesIO()
    figure.savefig(file, dpi=150, format="png", metadata={"Software": None})
    plt.close(figure)
    return (Picture(file.getvalue(), "image/png", caption),)


def figures_of_folder(
    folder: Path, main: str, caption: str, labels: Sequence[str], beside: Sequence[str] = ()
) -> tuple[tuple[Picture, ...], tuple[Picture, ...]]:
    """(figures beside the answer, figures of the appendix) of a folder of results.

    main: name of the figure beside the answer, without its ending;  caption: its caption;  labels: of the controllers, in the order of their numbers;
    beside: names of other figures beside the answer.
    """
    first = {
        folder / f"{name}{suffix}": caption if name == main else caption_of(Path(name), labels)
        for name in (main, *beside)
        for suffix in KINDS
    }
    shown = [_picture(path, words) for path, words in first.items()]
    others = [_picture(path, caption_of(path, labels)) for path in sorted(folder.iterdir()) if path not in first]
    return tuple(each for each in shown if each), tuple(each for each in others if each)


def caption_of(path: Path, labels: Sequence[str]) -> str:
    """The caption of a figure of one controller, by the number that its name begins with."""
    number = path.stem[:2]
    if not number.isdigit() or not 0 < int(number) <= len(labels):
        return path.stem.replace("_", " ")
    return labels[int(number) - 1] + next((f", {words}" for end, words in SHOWN.items() if path.stem.endswith(end)), "")


def _picture(path: Path, caption: str) -> Picture | None:
    """The figure of a file; None where there is none that a page can hold, or a symbolic link."""
    if path.suffix not in KINDS or path.is_symlink() or not path.is_file():
        return None
    return Picture(content(path, TEXT, "figure"), KINDS[path.suffix], caption)
