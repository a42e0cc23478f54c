"""stickslip report: folders of results on one page."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from toolbox.errors import SceneError
from toolbox.files.reading import opened

MARK = 'content="stickslip report"'
"""What a page of an earlier call holds."""


def add(commands: Any) -> None:
    """Declare the arguments of `stickslip report`."""
    page = commands.add_parser(
        "report",
        description="Write one page (HTML, one file, for screen and paper) about folders that other commands wrote with --out. For a study and for answers it "
        "begins with at most five sentences and one table. Then come the answers, the laws with the gains to type into the drive, the machine, all figures, "
        "what was printed, and how to get the same again. Without --units drill strings read in rpm, kN and kN m, other machines in the units that were typed.",
        epilog="example: stickslip report results borders --page report.html",
    )
    page.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="folder that a command wrote with --out; may be repeated")
    page.add_argument(
        "--page",
        type=Path,
        default=Path("report.html"),
        metavar="FILE.html",
        help="the file to write (report.html); that of an earlier report is replaced",
    )
    page.add_argument("--title", metavar="TEXT", help="what stands on top; the title of the first scene without")
    page.add_argument("--pdf", action="store_true", help="write a PDF beside it, by Chromium or by WeasyPrint")
    page.set_defaults(action=run, spelled={"results": "DIR", "path": "--page"})


def run(given: argparse.Namespace) -> int:
    """Write the page. Returns the exit code."""
    from toolbox.reports.writing import report

    if given.page.exists() and (not given.page.is_file() or MARK not in _beginning(given.page)):
        raise SceneError(f"Argument `--page` must not hide your own files, but `{given.page}` is not an earlier report.")
    path = report(*given.folders, path=given.page, title=given.title, pdf=given.pdf)
    given.found = {"page": str(path), "pdf": str(path.with_suffix(".pdf")) if given.pdf else None}
    beside = f" and {path.with_suffix('.pdf')}" if given.pdf else ""
    count = f"{len(given.folders)} folder{'s' * (len(given.folders) > 1)}"
    print(f"Report of {count} is in {path}{beside} ({path.stat().st_size / 1e6:.1f} MB)")
    return 0


def _beginning(page: Path) -> str:
    """The first 2000 bytes of a page, as text."""
    with opened(page, apart=True) as file:
        return file.read(2000).decode("utf-8", errors="replace")
