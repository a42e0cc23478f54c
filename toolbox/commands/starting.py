"""The option `--start`: where the judged runs of a command begin, as text."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from toolbox.arguments import whole
from toolbox.commands.terminal import check_some, plain
from toolbox.errors import SceneError, SimulationError, suggest
from toolbox.messages import LOG

if TYPE_CHECKING:
    from toolbox.modelling.closed_loop import ClosedLoop
    from toolbox.robustness.starts import Start

FORMS = ("smooth", "rest", "rest:30s", "own", "own:N", "takeover:LABEL", "takeover:LABEL:N", "connection")
"""What `--start` may say; N is the number of instants of a cycle."""

KINDS = ("smooth", "rest", "own", "takeover", "connection")
"""The words before the first colon."""


def add_start(verb: argparse.ArgumentParser, default: str) -> None:
    """Declare the option `--start`; default: where runs begin without it, in words."""
    verb.add_argument("--start", metavar="START", help=f"where the judged runs begin: {', '.join(FORMS)}; {default} without")


def start_given(given: argparse.Namespace, scene: Any, phases: int | None = None) -> Start | None:
    """The start of the option `--start`, None without it; phases: instants of a cycle if the text says none, by default those of the start.

    Raises SceneError for a text that is none, and for a label that the scene does not have.
    """
    if given.start is None:
        return None
    from toolbox.drilling.connection import AfterConnection
    from toolbox.robustness.starts import FromRest, OwnStickSlip, SmoothRunning, TakenOver

    kind, _, rest = given.start.partition(":")
    if kind == "takeover" and rest:
        label, _, count = rest.rpartition(":") if rest.rpartition(":")[2].isdigit() and ":" in rest else (rest, "", "")
        law, instants = one_law(scene, "--start", label), _phases(count) if count else phases
        return TakenOver(law) if instants is None else TakenOver(law, instants)
    if kind == "rest":
        return FromRest(plain(rest) if rest else 0.0)
    if kind == "own":
        instants = _phases(rest) if rest else phases
        return OwnStickSlip() if instants is None else OwnStickSlip(instants)
    if kind in ("smooth", "connection") and not rest:
        return SmoothRunning() if kind == "smooth" else AfterConnection()
    near = f"{suggest(kind, KINDS)}" if kind not in KINDS else f"it is one of {', '.join(FORMS)}."
    raise SceneError(f"Argument `--start` must say where runs begin, but it is `{given.start}`: {near}")


def begun(scene: Any, labels: Sequence[str], starts: Start | None) -> tuple[dict[str, ClosedLoop], dict[str, SceneError | SimulationError]]:
    """({label: loop} of single runs of cases of a scene, {label: why there is none}).

    A case with several runs, such as at several instants of a cycle, has a label for each run.  Raises SceneError where every case is refused.
    """
    if starts is None:
        return {label: scene[label] for label in labels}, {}
    loops: dict[str, ClosedLoop] = {}
    refused: dict[str, SceneError | SimulationError] = {}
    for label in labels:
        try:
            found = starts.on(scene[label])
        except (SceneError, SimulationError) as error:
            refused[label] = error
            continue
        runs = found.loops(scene[label])
        if not runs:
            refused[label] = SimulationError(found.note)
        elif found.note:
            LOG.warning("controller `%s`: %s", label, found.note)
        loops |= {label if len(runs) == 1 else f"{label}, start {k} of {len(runs)}": run for k, run in enumerate(runs, 1)}
    check_some(refused, labels)
    return loops, refused


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
