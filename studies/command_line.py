"""What studies read from their command line, and where they write and draw."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from toolbox.files import tables


def parser_of(text: str | None) -> argparse.ArgumentParser:
    """A parser whose help begins with the first line of the text of a study, which is its question."""
    return argparse.ArgumentParser(prog=f"python -m studies {Path(sys.argv[0]).stem}", description=(text or "").partition("\n")[0])


def folder(text: str) -> Path:
    """A folder that is named on the command line; it is made where it is not there."""
    path = Path(text)
    path.mkdir(parents=True, exist_ok=True)
    return path


def figure_folder() -> Path:
    """The folder that the command line names, else `studies/figures`; from here on figures are drawn without a screen."""
    import matplotlib

    matplotlib.use("Agg")
    return folder(sys.argv[1] if len(sys.argv) > 1 else str(Path(__file__).with_name("figures")))


def write_rows(rows: Sequence[Any], path: Path) -> None:
    """Write rows of a table, dataclasses or mappings of one kind, as csv."""
    made = [each if isinstance(each, dict) else asdict(each) for each in rows]
    tables.write(path, list(made[0]), [list(each.values()) for each in made])
