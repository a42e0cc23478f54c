"""The command `stickslip`: study a scene from file to verdict, figures and data; simulate it once; find where its stick-slip begins and ends; sweep it
over a grid, map its severity; find its chance of stick-slip, which disturbances tip it, its margins, and the lowest set-point of every drive; tune its
laws, over the depth of a well too, and find where they keep it smooth; fit it to data, or find what its numbers may be; measure what its accuracy costs;
write it as C; put results on one page; list the parts.

Exit codes: 0 done; 1 nothing could be simulated, tuned or fitted, or a file could not be written while it ran; 2 the scene or an argument is wrong, or
the folder cannot be written; 130 interrupted; 143 ended by SIGTERM.

Why argparse: it is there, starts at once, and its groups and errors say all that these commands need; a library of commands would be one more dependency.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import re
import shlex
import sys
import warnings
from collections.abc import Sequence
from contextlib import nullcontext, redirect_stdout
from functools import partial
from importlib import import_module
from itertools import pairwise
from typing import Any, NoReturn

from toolbox.commands.interrupt import INTERRUPTED, NOTHING, Watch
from toolbox.errors import SceneError, SimulationError, UnusualValue, suggest
from toolbox.files.interrupts import GATE
from toolbox.messages import complaint, sign_of_life, write_log_to_stderr
from toolbox.version import __version__
from toolbox.vocabulary import NOW

COMMANDS = {
    "study": ("study", "simulate every controller of a scene; table, figures and data"),
    "simulate": ("simulate", "simulate one controller of a scene, or all, by any method; report, figure and data"),
    "explore": ("explore", "open a local page: change a number of a scene, and see signals, verdict and map at once"),
    "compare": ("compare", "compare two saved runs by their metrics, or two scenes by their keys"),
    "onset": ("onset", "find the values of one parameter at which stick-slip begins and ends, for every controller of a scene"),
    "sweep": ("sweep", "simulate a scene for many values of its numbers, on all cores"),
    "map": ("sweep", "map the severity of stick-slip over two parameters, with the borders of stick-slip"),
    "chance": ("chance", "compute the probability of stick-slip over one or two numbers, if other numbers are uncertain"),
    "basin": ("basin", "find the fraction of disturbances from which an operating point recovers, and the smallest disturbance from which it does not"),
    "margins": ("margins", "compute disk, gain, phase and delay margin of every controller, and the model errors that it tolerates"),
    "answer": ("answer", "answer whether every controller of a scene ends stick-slip, from which starts, and above which set-point"),
    "setpoints": ("drives", "find the lowest set-point at which each controller of a drill string ends stick-slip, on this string and on similar strings"),
    "tune": ("tune", "find the best numbers of a controller for one scene, or for the worst of several scenes"),
    "schedule": ("schedule", "design the gains of a controller at several depths of a well, and check them there and halfway between"),
    "windows": ("windows", "find the set-points and weights on bit without stick-slip, at several depths of a well"),
    "fit": ("fit", "estimate parameters of a plant from measured signals, with confidence intervals"),
    "identify": ("identify", "estimate friction and mass of an axis or a joint from recordings, with the friction curve"),
    "posterior": ("posterior", "draw samples of the numbers of a machine that agree with a measurement, and compare friction laws by their evidence"),
    "estimate": ("estimate", "estimate speed and torque of the bit, severity and margin from a surface log, each with its uncertainty"),
    "torquedrag": ("torque_drag", "compute hook load, drag and torque of a drill string: rotating, picking up, slacking off, stuck"),
    "tradeoff": ("tradeoff", "compare error and computing time of all methods on a scene"),
    "export": ("export", "write a plant with its controller, or a controller alone, as C code or as an FMU"),
    "report": ("report", "write one page about folders of results: answers, plant, gains, figures, and how to repeat them"),
    "list": ("listing", "list wells, parts, controllers, observers and friction laws; with a name, its parameters and units"),
}  # fmt: skip
"""{command: (module of `toolbox.commands` that declares and runs it, its line in the help)}; a module is imported when its command is typed."""


def main(arguments: Sequence[str] | None = None, watch: Watch | None = None) -> int:
    """Run the command line and return its exit code; the errors of a user are one line on stderr. watch: of a process that is ended by an interrupt."""
    message, given = (lambda: NOTHING), argparse.Namespace()
    try:
        given = _parsed(arguments)
        from toolbox.commands import environment  # here, because `--version`, the help and the completion of a word need none of it
        from toolbox.commands.terminal import printing
        from toolbox.files.reading import noted
        from toolbox.files.unit_systems import use_units
        from toolbox.files.writable import check_folder

        given.line = shlex.join(["stickslip", *(sys.argv[1:] if arguments is None else arguments)])
        message = partial(given.words, given)
        environment.check()
        if getattr(given, "out", None) is not None:
            check_folder(given.out)
        if watch is not None:
            watch.message = message
        with (
            sign_of_life(f"{given.parser.prog.rpartition(' ')[2]} is at work"),
            noted() as given.read,
            nullcontext() if given.units is None else use_units(given.units),
        ):
            for path in given.load:
                from toolbox.scenes.catalogue import load_parts

                load_parts(path)
            if not (given.json or given.quiet):
                return given.action(given)
            with redirect_stdout(io.StringIO()):
                code: int = given.action(given)
            if given.json:
                from toolbox.files.results import as_data

                with printing():
                    print(json.dumps(as_data(given.found), indent=1, allow_nan=False))
            return code
    except SceneError as error:
        return complaint(_by_option(str(error), given), 2)
    except SimulationError as error:
        return complaint(str(error), 1)
    except BrokenPipeError:  # whoever read the output has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return complaint(f"{error.filename or getattr(given, 'out', None) or 'Output'}: {error.strerror or error}.", 1)
    except KeyboardInterrupt as interrupt:
        notes = getattr(interrupt, "__notes__", [])
        words = f"interrupted; {notes[0]}" if notes else message()
        if watch is not None:
            watch.interrupted(words)
        return complaint(words, INTERRUPTED)


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The arguments of a command line; one that its command does not have is an error with the usage of that command."""
    words = sys.argv[1:] if arguments is None else arguments
    parser = _parser(words)
    _refuse_former(words, parser)
    given, unknown = parser.parse_known_args(arguments)
    if unknown:
        given.parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    return given


def _refuse_former(words: Sequence[str], parser: argparse.ArgumentParser) -> None:
    """End with an error for an unknown command, and for the former name of a command or of one of its options."""
    typed = next((word for word in words if not word.startswith("-")), "")
    parts = [part for word in words for part in (word.split("=", 1) if word.startswith("--") else [word])]
    options = [(f"stickslip-{typed}", part) for part in parts]
    options += [(option.removeprefix("--"), value) for option, value in pairwise(parts) if option in VALUES]
    if typed and typed not in COMMANDS and ("stickslip", typed) not in NOW:
        parser.error(f"there is no command `{typed}`: {suggest(typed, COMMANDS)}")
    for place, word in (("stickslip", typed), *options):
        if (place, word) in NOW:
            parser.error(f"`{word}`{f' of `stickslip {typed}`' if word != typed else ''} is now `{NOW[place, word]}`")


VALUES = ("--group", "--protocol")
"""Options whose values have former names."""


def _by_option(text: str, given: argparse.Namespace) -> str:
    """An error in which an argument of a Python function goes by the option that gave it; what the scene gave keeps the name of its key."""
    found = re.match(r"Arguments? `([a-z_]+)`", text)
    if found is None or "parser" not in given:
        return text
    spelled = given.spelled.get(found[1]) or ("--out" if found[1] == "checkpoint" and "out" in given else None)
    name = found[1]
    if spelled is None and name in given and getattr(given, name) != given.parser.get_default(name):
        spelled = "--" + name.replace("_", "-")
    return text if spelled is None else text[: found.start(1)] + spelled + text[found.end(1) :]


def script(watch: Watch | None = None) -> NoReturn:
    """Run the command line as a process. watch: what looks after its interrupts already."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by who began the process; its number would go to the first file that is opened
            setattr(sys, name, open(os.devnull, "r+", encoding="utf-8"))  # noqa: SIM115 (for as long as the process lives)
    if "_ARGCOMPLETE" in os.environ:  # a shell asks what could be typed next
        import argcomplete

        before = os.environ.get("COMP_LINE", "")[: int(os.environ.get("COMP_POINT", "0"))]
        argcomplete.autocomplete(_parser(before.split()[1 : None if before[-1:].isspace() else -1]))
    write_log_to_stderr()
    looked_after = watch or Watch()
    elsewhere = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        if issubclass(category, UnusualValue):  # the scene is at fault, not a line of code
            complaint(f"warning: {message}", 0)
        else:
            elsewhere(message, category, *where, **more)

    warnings.showwarning = show
    try:
        if watch is None:
            looked_after.begin()
        try:
            code = main(watch=looked_after)
        except SystemExit as end:  # of the help, and of arguments that are wrong
            code = end.code if isinstance(end.code, int) else 0
        looked_after.over(code)
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt) or GATE.interrupted:
            looked_after.interrupted()
        raise


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of a command line that begins with these words, with the arguments of the command that they name; of the other commands only their names."""
    parser = argparse.ArgumentParser(
        prog="stickslip",
        description="Simulate stick-slip of drill strings and brakes, and compare controllers that end it.",
        epilog="exit codes: 0 done; 1 nothing could be simulated, tuned or fitted; 2 a scene or an argument is wrong; 130 interrupted",
    )
    parser.set_defaults(words=lambda given: NOTHING, spelled={}, found=None)
    parser.add_argument("--version", action="version", version=f"stickslip-toolbox {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    typed = next((word for word in words if word != "--"), "")
    module = COMMANDS[typed][0] if typed in COMMANDS else ""
    for name, (other, line) in COMMANDS.items():
        if other != module:
            commands.add_parser(name, help=line, add_help=False)
    if module:
        import_module(f"toolbox.commands.{module}").add(commands)
        _declare_common(commands.choices[typed])
    return parser


def _declare_common(verb: argparse.ArgumentParser) -> None:
    """Declare the arguments that every command has."""
    from toolbox.files.unit_systems import SYSTEMS

    verb.add_argument(
        "--load",
        action="append",
        default=[],
        metavar="FILE.py",
        help="a Python file with parts or laws of your own, which is run; may be repeated",
    )
    said = verb.add_mutually_exclusive_group()
    said.add_argument("--json", action="store_true", help="print what was found as JSON, numbers in SI, in place of text")
    said.add_argument("--quiet", action="store_true", help="print nothing but errors")
    verb.set_defaults(parser=verb)
    verb.add_argument(
        "--units", choices=tuple(SYSTEMS), help="of what is printed and drawn; without, those that were typed, else SI; files stay SI"
    )
