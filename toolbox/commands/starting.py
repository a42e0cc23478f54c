"""The option `--start`: where the judged runs of a command begin, as text."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from toolbox.arguments import whole
from toolbox.commands.terminal import plain
from toolbox.errors import SceneError, suggest

if TYPE_CHECKING:
    from toolbox.robustness.starts import Start

FORMS = ("smooth", "rest", "rest:30s", "own", "own:N", "takeover:LABEL", "takeover:LABEL:N", "connection")
"""What `--start` may say; N is the number of instants of a cycle."""

KINDS = ("smooth", "rest", "own", "takeover", "connection")
"""The words before the first colon."""


def add_start(verb: argparse.ArgumentParser, default: str) -> None:
    """Declare the option `--start`; default: where runs begin without it, in words."""
    verb.add_argument("--start", metavar="START", help=f"where the judged runs begin: {', '.join(FORMS)}; {default} without")


def start_given(given: argparse.Namespace, scene: Any) -> Start | None:
    """The start of the option `--start`, None without it. Raises SceneError for a text that is none, and for a label that the scene does not have."""
    if given.start is None:
        return None
    from toolbox.drilling.connection import AfterConnection
    from toolbox.robustness.starts import FromRest, OwnStickSlip, SmoothRunning, TakenOver

    kind, _, rest = given.start.partition(":")
    if kind == "takeover" and rest:
        label, _, count = rest.rpartition(":") if rest.rpartition(":")[2].isdigit() and ":" in rest else (rest, "", "")
        law = one_law(scene, "--start", label)
        return TakenOver(law, _phases(count)) if count else TakenOver(law)
    if kind == "rest":
        return FromRest(plain(rest) if rest else 0.0)
    if kind == "own":
        return OwnStickSlip(_phases(rest)) if rest else OwnStickSlip()
    if kind in ("smooth", "connection") and not rest:
        return SmoothRunning() if kind == "smooth" else AfterConnection()
    near = f"{suggest(kind, KINDS)}" if kind not in KINDS else f"it is one of {', '.join(FORMS)}."
    raise SceneError(f"Argument `--start` must say where runs begin, but it is `{given.start}`: {near}")


def _phases(text: str) -> int:
    """A number of instants of a cycle."""
    if not text.isdigit():
        raise SceneError(f"Argument `--start` must end in a number of instants, but it ends in `{text}`.")
    whole("--start", int(text), 1)
    return int(text)


def one_law(scene: Any, option: str, label: str) -> Any:
    """The one controller of a case whose stick-slip is taken over. Raises SceneError for another number of them."""
    laws = scene[scene.case(label).label].controllers
    if len(laws) != 1:
        raise SceneError(f"Argument `{option}` must name a case with one controller to be taken over, but `{label}` has {len(laws)}.")
    return laws[0]
