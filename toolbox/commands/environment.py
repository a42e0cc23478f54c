"""Variables of the environment that other packages read, and on which they fail far from the command that was typed."""

from __future__ import annotations

import os

from toolbox.errors import SceneError

LATEST = 253_402_300_799
"""The last second of the year 9999, in seconds since 1970: calendars end there."""


NUMBERS = {
    "SOURCE_DATE_EPOCH": (0, LATEST, "be a whole number of seconds since 1970"),
}
"""{variable: lowest and highest number, what it must be}."""


def check() -> None:
    """Raise SceneError for a variable with which nothing can be simulated or drawn."""
    for name, (low, high, must) in NUMBERS.items():
        text = os.environ.get(name)
        try:
            fits = text is None or low <= int(text) <= high
        except ValueError:
            fits = False
        if not fits:
            raise SceneError(f"Variable `{name}` of the environment must {must}, but it is `{text}`.")
    backend = os.environ.get("MPLBACKEND")
    if backend:
        try:
            import matplotlib  # noqa: F401, which looks at it
        except Exception:
            raise SceneError(
                f"Variable `MPLBACKEND` of the environment must name a backend of matplotlib, but it is `{backend}`."
            ) from None
