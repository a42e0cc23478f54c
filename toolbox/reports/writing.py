"""`report`: what was found, on one page: the answers first, then the machine, the laws and everything else that was written."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from toolbox.errors import SceneError
from toolbox.files.atomic import replaced
from toolbox.reports.folders import of_folder
from toolbox.reports.page import page
from toolbox.reports.sections import Section, of_result
from toolbox.reports.to_pdf import printed


def report(*results: Any, path: str | os.PathLike[str], title: str | None = None, pdf: bool = False) -> Path:
    """Write one HTML page about results: answers first, then plant, controllers with their gains, figures, and how to
    repeat the results.

    For a study and for answers the page begins with at most five sentences and one table: which controllers succeed, in
    which situation, at what price, how sure this is, and what to try next.

    The page is one file with all of its figures. It needs no network, runs no script, and prints well. If no system
    of units was chosen by `toolbox.use_units`, a drill string is shown in rpm, kN and kN m, and another machine in the
    units that were typed, else SI.

    Parameters
    ----------
    results
        Folders that a command wrote (`stickslip study ... --out results`), and results in Python that can be printed
        and plotted: runs, onsets, maps, margins, tunings, fits and so on. A folder that contains such folders, as
        `stickslip map` writes it, counts as all of them.
    path
        The file to write. It ends with .html.
    title
        Title of the page. By default the title of the first result.
    pdf
        Whether a PDF is written beside the page, by Chromium or by WeasyPrint, one of which must be installed. By
        default False. The HTML page is written first.

    Returns
    -------
    Path
        The path of the page.

    Raises
    ------
    SceneError
        If no results are given, a folder was not written by a command or is damaged, or the file cannot be written.
        Also if the PDF cannot be made. The HTML page is written then.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> from toolbox.reports import report
    >>> page = report(simulate(compose(BlockOnBelt()), "60 s"), path="block.html", title="A block on a belt")
    >>> print(page.read_text().count("A block on a belt") > 0)
    True
    """
    path = Path(path)
    if path.suffix != ".html":
        raise SceneError(f"Argument `path` must end with .html, but it is `{path}`.")
    if not results:
        raise SceneError("Argument `results` must be folders of results or results, but there are none.")
    sections: list[Section] = []
    for each in results:
        sections += of_folder(Path(each)) if isinstance(each, str | os.PathLike) else [of_result(each)]
    text = page(title or sections[0].title, sections)
    with replaced(path) as file:
        file.write(text.encode())
    if pdf:
        try:
            made = printed(text)
        except SceneError as error:
            raise SceneError(f"The page is in `{path}`, but its PDF was not written. {error}") from None
        with replaced(path.with_suffix(".pdf")) as file:
            file.write(made)
    return path
