"""What all commands say on the terminal, and how they name their files."""

from __future__ import annotations

import argparse
import dataclasses
import re
import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain, groupby, pairwise
from pathlib import Path
from typing import Any

from toolbox.arguments import number, numbers
from toolbox.errors import NoSteadyState, SceneError, SimulationError, suggest
from toolbox.files.reading import text_of
from toolbox.messages import progress_bar
from toolbox.modelling.number_kinds import former_name


def common(
    out: str, *, required: bool = False, scene: str = "the machine and its controllers", controller: str | None = "", drawn: bool = True
) -> argparse.ArgumentParser:
    """The arguments that most commands share, as a parent of their parsers: the scene, `--controller` and `--out`.

    out: what the folder gets;  required: whether it must be given;  scene: what the scene is to the command;  controller: what one label is, any number of
    labels where it is empty, and none where it is None;  drawn: whether the command writes figures.
    """
    parent = argparse.ArgumentParser(add_help=False)
    parent.add_argument("scene", type=Path, metavar="SCENE.toml", help=scene)
    if controller:
        parent.add_argument("--controller", metavar="LABEL", help=controller)
    elif controller is not None:
        parent.add_argument("--controller", metavar="LABEL", action="append", help="only this one; may be repeated")
    parent.add_argument("--out", type=Path, required=required, metavar="DIR", help=out)
    if drawn:
        figure_format(parent)
    return parent


SENTENCE = 2
"""Most gaps of two spaces in a line of names and words, which can be broken."""

FORMATS = ("png", "pdf", "svg")
"""Formats of figures; the names of files below have the first."""


def figure_format(parser: argparse.ArgumentParser) -> None:
    """Declare the argument `--format` of a command that writes figures."""
    parser.add_argument(
        "--format", choices=FORMATS, default=FORMATS[0], metavar="KIND", help=f"format of figures: {', '.join(FORMATS)} ({FORMATS[0]})"
    )


def log_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments `--column` and `--accept-flaw` of a command that reads a log."""
    parser.add_argument(
        "--column",
        metavar="SIGNAL=HEADING",
        action="append",
        default=[],
        help="what a signal, or time, is called in the data; with a unit or a format of dates where the data have none, as in 'time=Time [DD/MM/YYYY]'; may be "
        "repeated",
    )
    parser.add_argument(
        "--accept-flaw",
        metavar="KIND",
        action="append",
        default=[],
        help="a kind of flaw whose samples are data here: null, clipped, drop-out, reversed or outlier; may be repeated",
    )


def hold_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the argument `--zero-order-hold` of a command that fits to a log."""
    parser.add_argument(
        "--zero-order-hold",
        metavar="SIGNAL",
        action="append",
        help="a measured input that keeps each value until the next sample, as the commands of a drive do, or none; by default the data say which; "
        "may be repeated",
    )


def held_of(given: argparse.Namespace) -> list[str] | None:
    """Return the inputs of `--zero-order-hold`: None if the data are to say, and none of them for `--zero-order-hold none`."""
    return [] if given.zero_order_hold == ["none"] else given.zero_order_hold


def asked_otherwise(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments `--law` and `--hold` of a command that looks at a machine under another law, or under other inputs, than those of its scene."""
    parser.add_argument(
        "--law",
        metavar="NAME",
        help="a law of `stickslip list` with its own numbers in place of the controllers of the scene, such as HeldSpeed for a brake",
    )
    parser.add_argument(
        "--hold",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="an input that is constant here, where it varies in time in the scene",
    )


def loaded(given: argparse.Namespace) -> Any:
    """The scene of a command, as its arguments `--law` and `--hold` ask for it."""
    from toolbox.scenes.scene import Scene

    return otherwise(Scene.load(given.scene), given)


def otherwise(scene: Any, given: argparse.Namespace) -> Any:
    """A scene with the law of `--law` in place of its controllers, at the set-point of the scene, and the inputs of `--hold` in every case."""
    from toolbox.scenes.judged import set_point
    from toolbox.scenes.scene_file import inputs_of, named_case

    if given.law is not None:
        case = named_case(given.law, scene.plant(), scene.reference)
        others = {key: value for key, value in scene.inputs.items() if case.law is None or key not in case.law.actuated_signals}
        scene = dataclasses.replace(scene, inputs=others, cases=(case,))
        if set_point(scene[case.label].system, scene.signal) is not None:  # a speed that is held has steady running in place of a stop
            scene = dataclasses.replace(scene, standstill_speed=None)
    texts = {name: plain(value) for name, value in pairs("--hold", "NAME=VALUE", given.hold)}
    if not texts:
        return scene
    inputs = inputs_of(texts, "--hold", scene.plant(), scene.cases)
    own = ({name: value for name, value in case.inputs.items() if name not in inputs} for case in scene.cases)
    cases = tuple(dataclasses.replace(case, inputs=each) for case, each in zip(scene.cases, own, strict=True))
    return dataclasses.replace(scene, inputs={**scene.inputs, **inputs}, cases=cases)


def drawn_as(names: Sequence[str], *formats: str) -> list[str]:
    """Names of files, figures once in each of the formats."""
    return [
        name.removesuffix(".png") + f".{kind}" if name.endswith(".png") else name
        for name in names
        for kind in (formats if name.endswith(".png") else "-")
    ]


def earlier(report: str, mark: str, names: Sequence[str] | Callable[[str], Iterable[str]]) -> Callable[[Path], set[str]]:
    """A function of a folder: the names of the files that an earlier call of a command left there, as its report tells; none where there is no such report.

    mark: regular expression of what the report holds;  names: patterns of its files, or a function of the text of the report that gives them.
    """

    def left(path: Path) -> set[str]:
        try:
            text = text_of(path / report, apart=True)
        except SceneError:
            return set()
        told = [*(names(text) if callable(names) else names)] if re.search(mark, text) else []
        return {file.name for name in drawn_as(told, *FORMATS) for file in path.glob(name) if file.is_file()}

    return left


def heading(row: type) -> str:
    """The expression that the table of rows of this kind begins with."""
    return f"^{','.join(field.name for field in dataclasses.fields(row))}\n"


def file_stems(labels: Sequence[str]) -> list[str]:
    """Beginnings of file names: numbered, so that they differ and keep the order of the scene."""
    plain = [re.sub(r"[^a-z0-9]+", "_", label.lower()).strip("_")[:40] for label in labels]
    return [f"{i:02d}_{word}".rstrip("_") for i, word in enumerate(plain, 1)]


@contextmanager
def printing() -> Iterator[None]:
    """The block prints: an error of that, such as of a full disk, names the output, and none of the files that are written beside it."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OSError(error.errno, error.strerror, "Output") from None


def show(text: str) -> None:
    """Print a text; on a terminal, tables that are wider than it come in parts, each with the first column, and longer lines are broken between words.

    A broken line goes on under the column in which its last one begins.
    """
    if not sys.stdout.isatty():
        with printing():
            print(text)
        return
    width = shutil.get_terminal_size().columns
    blocks = (list(lines) for _, lines in groupby(text.split("\n"), key=bool))
    for line in chain.from_iterable(_folded(block, width) if max(map(len, block)) > width else block for block in blocks):
        if len(line) <= width:
            print(line)
            continue
        gaps = [match.end() for match in re.finditer(r"(?:^| ) +", line)]  # two spaces part columns
        indent = max((end for end in gaps if end < width // 2), default=0)
        if len(gaps) > SENTENCE + line.startswith(" "):
            print(line)  # a row of numbers, which the terminal breaks
        else:
            print(
                textwrap.fill(
                    line, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False, drop_whitespace=True
                )
            )


def _folded(lines: Sequence[str], width: int) -> Sequence[str]:
    """The lines of a table in parts that are no wider than the terminal, each with the first column; other lines, and what cannot be parted, as they are."""
    rows = [line for line in lines if line.strip("-")]  # without rules
    size = max(map(len, rows), default=0)
    inked = "".join(" " if all(row[k : k + 1] in ("", " ") for row in rows) else "x" for k in range(size))
    spans = [
        *pairwise([0, *(gap.end() for gap in re.finditer(r"(?<=x) {2,}(?=x)", inked)), size])
    ]  # of the columns, which two blanks part in every row
    if len(rows) < 2 or len(spans) < 3 or max(end - begin for begin, end in spans[1:]) > width - spans[0][1]:
        return lines
    parts = [[spans[0]]]
    for span in spans[1:]:
        if sum(end - begin for begin, end in (*parts[-1], span)) > width:
            parts.append([spans[0]])
        parts[-1].append(span)
    found: list[str] = []
    for part in parts:
        cut = ["".join(line[begin:end].ljust(end - begin) for begin, end in part).rstrip() if line.strip("-") else "" for line in lines]
        found += ["", *(line or "-" * max(map(len, cut)) for line in cut)]
    return found[1:]


@contextmanager
def progress(total: int) -> Iterator[Any]:
    """A bar on stderr, where that is a terminal, that appears after a second; yields a function of (cases done, what is going on)."""
    with progress_bar(total, "", bar_format="{desc} |{bar:30}| {percentage:3.0f}% {elapsed}") as bar:

        def reached(done: float, text: str) -> None:
            bar.set_description_str(text, refresh=False)
            bar.update(done - bar.n)

        yield reached


class Ended:
    """Tells on stderr, one line each, which controllers have ended, after how long, and how long the rest takes if each takes as long as those before.

    A line and no bar: it stands in a log file, too.
    """

    def __init__(self, labels: Sequence[str]):
        self._left, self._count, self._began = list(labels), len(labels), time.monotonic()

    def __call__(self, label: str) -> None:
        """Tell that a controller has ended; a second time nothing is told."""
        if label not in self._left:
            return
        self._left.remove(label)
        done, passed = self._count - len(self._left), time.monotonic() - self._began
        rest = f", about {passed / done * len(self._left):.0f} s left" if self._left else ""
        print(f"{label}: {done} of {self._count} controllers ended after {passed:.0f} s{rest}", file=sys.stderr, flush=True)


def plain(text: str) -> Any:
    """A number, or text with a unit for `units.parse`."""
    try:
        return float(text)
    except ValueError:
        return text


def share(option: str, text: str) -> float:
    """A part above 0 and below 1, of text such as 20% or 0.2; raises SceneError for any other."""
    return numbers(option, [text if text.endswith("%") else plain(text)], "1", above=0, below=1)[0]


def pairs(option: str, form: str, texts: Iterable[str]) -> list[tuple[str, str]]:
    """(name, what stands behind it) of texts NAME=WHAT; raises SceneError for another form, of which `form` tells."""
    found = []
    for text in texts:
        name, _, what = (part.strip() for part in text.partition("="))
        if not name or not what:
            raise SceneError(f"Argument `{option}` must be {form}, but it is `{text}`.")
        found.append((name, what))
    return found


def ranges(option: str, texts: Iterable[str], counted: bool = False, exactly: int | None = None) -> dict[str, tuple[Any, ...]]:
    """{name: (low, high)} of texts NAME=LOW:HIGH, with numbers as `plain` gives them; a unit behind HIGH is that of LOW, too, where it has none.

    counted: a third part, NAME=LOW:HIGH:N, says how many values;  exactly: how many there must be.
    Raises SceneError for another form, and for a name that is there twice.
    """
    form = "NAME=LOW:HIGH" + ":N" * counted
    found: dict[str, tuple[Any, ...]] = {}
    for text in texts:
        match = re.fullmatch(r"\s*([^=\s]+)\s*=\s*([^:]+?)\s*:\s*([^:]+?)\s*" + r":\s*([1-9][0-9]*)\s*" * counted, text)
        if match is None:
            raise SceneError(f"Argument `{option}` must be {form}, but it is `{text}`.")
        name, *ends = match.groups()
        if name in found:
            raise SceneError(f"Argument `{option}` must name every number once, but `{name}` is there twice.")
        if ends and isinstance(plain(ends[0]), float) and not isinstance(plain(ends[1]), float):
            ends[0] += re.sub(r"^[-+0-9.eE_]+", "", ends[1])
        found[name] = (*map(plain, ends[:2]), *map(int, ends[2:]))
    if exactly is not None and len(found) != exactly:
        raise SceneError(f"Argument `{option}` must be given {exactly} times, but it is {len(found)} time(s).")
    return found


def span(option: str, text: str) -> tuple[float, float]:
    """(begin, end) [s] of a text BEGIN:END, in seconds or with units. Raises SceneError for another form."""
    begin, colon, end = text.partition(":")
    if not colon:
        raise SceneError(f"Argument `{option}` must be BEGIN:END, but it is `{text}`.")
    first, last = (number(option, part if part.strip()[-1:].isalpha() else f"{part} s", "s") for part in (begin, end))
    return first, last


def check_known(scene: Any, labels: Sequence[str], names: Iterable[str]) -> None:
    """Raise SceneError for the first name that is a number of no case of a scene, with the nearest names of all cases.

    The case that has the nearest name need not be the first: a scene may begin with a constant torque, which has no set-point.
    """
    for name in names:
        known: set[str] = set()
        renamed = False
        refused: list[SceneError] = []
        for label in labels:
            try:
                loop = scene[label]
                known |= loop.variable_numbers().keys()
                renamed |= former_name(loop, name) is not None
                loop.number(name)
                break
            except SceneError as error:
                refused.append(error)
        else:
            if known and not renamed and not any(each.endswith(f".{name}") or each.startswith(f"{name}.") for each in known):
                raise SceneError(f"There is no number `{name}`: {suggest(name, known)}")
            raise refused[-1]


def check_some(refused: Mapping[str, Exception], cases: Sequence[str]) -> None:
    """Raise the first error where every case was refused, so that the call as it stands asks for nothing that there is.

    A case without steady running, or whose simulation failed, is an answer, not a refusal.
    """
    if len(refused) == len(cases) and not any(isinstance(error, (NoSteadyState, SimulationError)) for error in refused.values()):
        raise refused[cases[0]]


@contextmanager
def side_by_side(processes: int) -> Iterator[Any]:
    """An executor of so many processes, which begins nothing more when the block is left by an error; none for one, which is this one."""
    if processes <= 1:
        yield None
        return
    from toolbox.sweeps.executors import Workers

    pool = Workers(processes)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    pool.shutdown()
