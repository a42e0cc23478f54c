"""A page as PDF, by a program or a package that is installed anyway."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from toolbox.errors import SceneError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
"""Programs that print a page, of which the first that is found does it."""

PATIENCE = 300.0
"""Seconds that a browser may take."""


def printed(page: str) -> bytes:
    """Return a page as PDF. SceneError is raised if no program for PDF is installed, or if it fails."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is not None:
        return _by_browser(browser, page)
    try:
        from weasyprint import HTML
    except (ImportError, OSError):  # OSError where its own libraries are missing
        raise SceneError(
            "A PDF needs Chromium, Chrome or Edge, or the package weasyprint, none of which is here: install one, or print the page from a browser."
        ) from None
    made: bytes = HTML(string=page).write_pdf()
    return made


def _by_browser(browser: str, page: str) -> bytes:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        source, target = Path(folder, "page.html"), Path(folder, "page.pdf")
        source.write_text(page, encoding="utf-8")
        words = [
            browser, "--headless", "--disable-gpu", "--no-sandbox", "--no-pdf-header-footer", f"--user-data-dir={folder}/profile",
            f"--print-to-pdf={target}", source.as_uri(),
        ]  # fmt: skip
        try:
            done = subprocess.run(words, capture_output=True, timeout=PATIENCE, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SceneError(f"`{browser}` could not print the page: {error}") from None
        if not target.is_file():
            last = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
            raise SceneError(f"`{browser}` could not print the page: {' '.join(last) or f'it ended with code {done.returncode}'}")
        return target.read_bytes()
