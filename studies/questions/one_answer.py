"""Do the verdicts and borders that the toolbox prints stand in a simulation that shares nothing with it, on wells and controllers that nobody chose?

Forty wells are drawn: strings of two to six inertias, rock with an exponential or a Gaussian law, and a PI, a soft torque or a Z-torque, continuous or sampled
with a delay, with limits of the torque or without. Each is asked in three situations:

    rest       from rest, set-point in one step                             border: lowest set-point of `answers`, in steps of 0.1 rad/s
    taken      taken over from a stiff drive, at two phases of its cycle    border: lowest set-point of `answers`, in steps of 0.1 rad/s
    smooth     smooth running, with a small disturbance                     border: where smooth running is lost, from `onset`

`one_answer.c` has string, rock, controllers, takeover and judge once more, and the gains of a soft torque and a Z-torque are computed here from their
formulas. A border stands if every run 0.1 rad/s above it comes to smooth running, and one run 0.1 rad/s below it does not. Moreover no run may fail 0.5, 1, 2,
4 and 8 rad/s above it. Verdicts of `worst_case` at three set-points, drawn from half to one and a half times the border, are compared with the C as well. "Said
free but sticks" is the dangerous kind of mistake. A comparison of which either side says that it cannot decide is counted apart.

    python -m studies one_answer [--count 40] [--seed 0] [--first 0] [--situations rest taken smooth] [--out FOLDER]

With `--out` what is found stays in a folder, and the same command goes on where it was stopped. Needs a C compiler, `cc`.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from controllers import PI, SoftTorque, StiffPI, ZTorque
from models import BitRock, Exponential, GaussianStribeck, TorsionalChain
from studies.command_line import folder, parser_of
from toolbox import ClosedLoop, Sampled, closed_loop, compose, onset, worst_case
from toolbox.drilling.answer_table import Question
from toolbox.errors import SceneError, SimulationError
from toolbox.files.journal import Journal
from toolbox.robustness import FromRest, SmoothRunning, TakenOver

NAME, RANGE, STEP = "top.reference", (1.0, 20.0), 0.1
"""What is turned, from where to where, and in which steps [rad/s]."""

SITUATIONS = ("rest", "taken", "smooth")
ABOVE = (0.5, 1.0, 2.0, 4.0, 8.0)
"""How far above a border [rad/s] nothing may fail again."""

PHASES, BEFORE, LONG = 2, 200.0, 200.0
"""Phases of a takeover, and seconds of the stiff drive before it and of a run of the toolbox."""

FINE, WINDOW = 2e-3, 60.0
"""Step, and length of a window that the C judges [s]."""

UNDECIDED, FREE = 0, 1
WORDS = ("undecided", "free", "sticks", "stands", "swings", "grows")
"""What the C answers."""


@dataclass(frozen=True)
class Well:
    """Numbers of a string, its rock and its controller as they are drawn; neither side takes a number from the other."""

    inertia: tuple[float, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    top_drag: float
    bit_drag: float
    weight: float
    radius: float
    static: float
    kinetic: float
    speed: float
    gaussian: bool
    kind: str
    gains: tuple[float, float]
    period: float
    late: int
    limits: tuple[float, float]

    @property
    def label(self) -> str:
        """The well in words."""
        rhythm = f"every {1e3 * self.period:g} ms, {self.late} samples late" if self.period else "continuous"
        limited = ", limited" if math.isfinite(self.limits[1]) else ""
        return f"{len(self.inertia)} inertias, {'Gaussian' if self.gaussian else 'exponential'} rock, {self.kind}, {rhythm}{limited}"

    @property
    def loop(self) -> ClosedLoop:
        """The well as the toolbox has it."""
        law = (
            GaussianStribeck(self.static, self.kinetic, self.speed)
            if self.gaussian
            else Exponential(self.static, self.kinetic, 1.0 / self.speed)
        )
        chain = TorsionalChain(self.inertia, self.stiffness, self.damping, top_drag=self.top_drag, bit_drag=self.bit_drag)
        limits: dict[str, Any] = (
            {"lowest_torque": self.limits[0], "highest_torque": self.limits[1]} if math.isfinite(self.limits[1]) else {}
        )
        kinds: dict[str, Any] = {
            "PI": lambda: PI(*self.gains, **limits),
            "soft torque": lambda: SoftTorque(detuning=self.gains[0], **limits),
            "Z-torque": lambda: ZTorque(filter_time=self.gains[1], **limits),
        }
        drive = kinds[self.kind]()
        rock = BitRock(weight=self.weight, radius=self.radius, friction=law)
        return closed_loop(compose(chain, rock), Sampled(drive, self.period, self.period * self.late) if self.period else drive)

    @property
    def numbers(self) -> np.ndarray:
        """The machine as the C has it."""
        load = self.weight * self.radius
        rock = [load * self.static, load * self.kinetic, 1.0 / self.speed, 2.0 if self.gaussian else 1.0, self.top_drag, self.bit_drag]
        return np.array([*rock, *self.inertia, *self.stiffness, *self.damping])

    @property
    def drive(self) -> np.ndarray:
        """The controller as the C has it."""
        series, below = 1.0 / sum(1.0 / k for k in self.stiffness), sum(self.inertia[1:])
        p, i = self.gains
        compensated, filtered, back = 0.0, 1.0, p
        if self.kind == "soft torque":
            p, i = math.sqrt(series * below) / self.gains[0], series / below * self.inertia[0] / self.gains[0]
            back = p
        elif self.kind == "Z-torque":
            impedance, filtered, top = math.sqrt(series * below), self.gains[1], self.inertia[0]
            p, i, back = max(impedance - self.top_drag, 0.0), impedance * math.sqrt(series / below) / 5.0, impedance
            compensated = top * (1.0 - math.sqrt(min(max(impedance, self.top_drag) * filtered / top, 1.0))) ** 2
        return np.array([self.period, self.late, p, i, compensated, filtered, back, *self.limits])


STIFF = np.array([0.0, 0.0, 2e4, 2e3, 0.0, 1.0, 2e4, -math.inf, math.inf])
"""The drive whose stick-slip is taken over, as the C has it."""


def well(number: int, seed: int) -> Well:
    """One of the wells of a seed."""
    draw = np.random.default_rng((seed, number))
    n = int(draw.integers(2, 7))
    middle = draw.uniform(80.0, 400.0) * draw.dirichlet(np.full(n - 2, 20.0)) if n > 2 else ()
    inertia = (draw.uniform(1000.0, 3000.0), *middle, draw.uniform(150.0, 500.0))
    stiffness = draw.uniform(300.0, 900.0) / draw.dirichlet(np.full(n - 1, 20.0))
    damping = draw.uniform(10.0, 40.0) * (n - 1) * draw.uniform(0.7, 1.3, n - 1)
    weight, static = draw.uniform(40e3, 130e3), draw.uniform(0.6, 0.9)
    impedance = math.sqrt(sum(inertia[1:]) / sum(1.0 / stiffness))
    kind = str(draw.choice(["PI", "soft torque", "Z-torque"]))
    gains = {
        "PI": (impedance * draw.uniform(0.7, 5.0), impedance * draw.uniform(0.3, 2.5)),
        "soft torque": (draw.uniform(0.6, 1.6), 0.0),
        "Z-torque": (0.0, draw.uniform(0.03, 0.1)),
    }[kind]
    sampled = kind == "Z-torque" or draw.uniform() < 0.6
    late = int(draw.integers(0, 6)) if sampled else 0
    limited = draw.uniform() < 0.5
    limits = (0.0, 2.0 * static * weight * 0.155) if limited else (-math.inf, math.inf)
    return Well(
        *(tuple(map(float, each)) for each in (inertia, stiffness, damping)), draw.uniform(0.0, 100.0), draw.uniform(0.0, 30.0), weight, 0.155, static,
        static * draw.uniform(0.5, 0.8), draw.uniform(0.7, 2.5), bool(draw.uniform() < 0.4), kind, gains, 0.01 if sampled else 0.0, late, limits,
    )  # fmt: skip


@cache
def library() -> Any:
    """The C, compiled; raises RuntimeError without a compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        raise RuntimeError("A C compiler is needed, but there is no `cc`.")
    place = Path(tempfile.mkdtemp()) / "one_answer.so"
    source = Path(__file__).with_suffix(".c")
    subprocess.run([compiler, "-O2", "-ffp-contract=off", "-shared", "-fPIC", "-o", str(place), str(source), "-lm"], check=True)
    return ctypes.CDLL(str(place))


def in_c(one: Well, situation: str, value: float, step: float = FINE) -> int:
    """What the C says of a set-point: of several phases the first that is not free."""
    numbers, drive, stiff, found = one.numbers, one.drive, STIFF, np.zeros(2)
    m, law, initial, out = (each.ctypes.data_as(ctypes.c_void_p) for each in (numbers, drive, stiff, found))
    real = ctypes.c_double
    starts = {"smooth": (0,), "rest": (1,), "taken": tuple(range(2, 2 + PHASES))}[situation]
    said = FREE
    for start in starts:
        said = library().told(len(one.inertia), m, law, initial, real(value), start, PHASES, real(BEFORE), real(step), real(WINDOW), out)
        if said != FREE:
            break
    return int(said)


def start_of(situation: str) -> Any:
    """The start of a situation as the toolbox has it."""
    return {"smooth": SmoothRunning(), "rest": FromRest(), "taken": TakenOver(StiffPI(), PHASES, BEFORE)}[situation]


def said(loop: ClosedLoop, situation: str, value: float) -> bool | None:
    """Whether the toolbox says that the loop is free at a set-point; None if it says that it cannot decide."""
    found = worst_case(loop.at(NAME, value), LONG, starts=start_of(situation), after=0.7 * LONG)
    failed = [each for each in found.outcomes if each.verdict.failed]
    return None if any("not decided" in each.verdict for each in failed) else not failed


def border_of(loop: ClosedLoop, situation: str) -> tuple[float, bool]:
    """The border [rad/s] that the toolbox prints, nan for none, and whether the loop is free above it."""
    if situation == "smooth":
        losses = onset(loop.at(NAME, 8.0), NAME, RANGE, num_values=5).losses
        return (losses[0].value, losses[0].safe == "above") if losses else (math.nan, True)
    question = Question(loop, NAME, StiffPI(), PHASES, LONG)
    value = question.lowest_from("step" if situation == "rest" else "takeover", *RANGE, STEP)
    return (math.nan if value < RANGE[0] + STEP else value), True


def examined(number: int, seed: int, situation: str) -> dict[str, Any]:
    """The border, its two sides in C, three verdicts of both, and seconds of the processor of both."""
    one = well(number, seed)
    loop, draw = one.loop, np.random.default_rng([seed, number, *situation.encode()])
    seconds, began = [0.0, 0.0], process_time()

    def spent(k: int) -> None:
        nonlocal began
        now = process_time()
        seconds[k], began = seconds[k] + now - began, now

    try:
        border, above = border_of(loop, situation)
        spent(0)
        sides = [] if math.isnan(border) else [in_c(one, situation, border + side) for side in ((STEP, -STEP) if above else (-STEP, STEP))]
        higher = [border + each for each in ABOVE if above and border + each <= RANGE[1]]
        again = next((value for value in higher if in_c(one, situation, value) not in (FREE, UNDECIDED)), None)
        spent(1)
        verdicts = []
        for value in np.round((8.0 if math.isnan(border) else border) * draw.uniform(0.5, 1.5, 3), 3).tolist():
            ours = said(loop, situation, value)
            spent(0)
            verdicts.append([value, ours, in_c(one, situation, value)])
            spent(1)
    except (SceneError, SimulationError) as error:
        return {"refused": str(error)}
    return {"border": None if math.isnan(border) else border, "sides": sides, "again": again, "verdicts": verdicts, "seconds": seconds}


def told_of(found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """(what is compared, how it stands) of each comparison of a well in a situation."""
    if "refused" in found:
        yield "well", "refused"
        return
    if found["border"] is None:
        yield "border", "no border in the range"
    else:
        good, bad = found["sides"]
        stands = "undecided" if UNDECIDED in (good, bad) else "within 0.1 rad/s" if good == FREE != bad else ""
        yield "border", stands or ("said free but sticks" if good != FREE else "said sticks but free")
        yield "above", "nothing fails again" if found["again"] is None else "said free but sticks"
    for _, ours, theirs in found["verdicts"]:
        if ours is None or theirs == UNDECIDED:
            yield "verdict", "undecided"
        else:
            yield "verdict", "same" if ours == (theirs == FREE) else "said free but sticks" if ours else "said sticks but free"


def line(number: int, situation: str, found: dict[str, Any]) -> str:
    """A well in a situation as a line of text."""
    if "refused" in found:
        return f"{number:>4}  {situation:<8}refused: {found['refused']}"
    border = "-" if found["border"] is None else f"{found['border']:.3f}"
    sides = ", ".join(WORDS[each] for each in found["sides"]) or "-"
    asked = "; ".join(
        f"{value:g}: {({None: 'undecided', True: 'free', False: 'fails'})[ours]}, {WORDS[theirs]}"
        for value, ours, theirs in found["verdicts"]
    )
    asked += "" if found["again"] is None else f"; fails again at {found['again']:g}"
    wrong = any("but" in stands for _, stands in told_of(found))
    return f"{number:>4}  {situation:<8}{border:>8}   {sides:<18}{asked}{'   <--' if wrong else ''}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each well and situation, and the counts."""
    parser = parser_of(__doc__)
    parser.add_argument("--count", type=int, default=40, help="how many wells (40)")
    parser.add_argument("--first", type=int, default=0, help="the first of them (0)")
    parser.add_argument("--seed", type=int, default=0, help="what draws them (0)")
    parser.add_argument(
        "--situations", nargs="+", choices=SITUATIONS, default=SITUATIONS, metavar="NAME", help="some of: rest, taken, smooth"
    )
    parser.add_argument("--out", type=folder, metavar="FOLDER", help="folder that keeps what is found, from which a stopped call goes on")
    given = parser.parse_args(arguments)
    kept = (
        None
        if given.out is None
        else Journal(given.out / "one_answer.jsonl", {"seed": str(given.seed)}, lambda result: isinstance(result, dict))
    )
    counts: Counter[tuple[str, str, str]] = Counter()
    seconds = np.zeros(2)
    numbers = range(given.first, given.first + given.count)
    for number in numbers:
        print(f"{number:>4}  {well(number, given.seed).label}")
    for situation in given.situations:
        k = SITUATIONS.index(situation)
        print(flush=True)
        for number in numbers:
            known = None if kept is None else kept.known.get((number, k))
            found = known or examined(number, given.seed, situation)
            if kept is not None and known is None:
                kept.add((number, k), found)
            counts.update((situation, *each) for each in told_of(found))
            seconds += found.get("seconds", np.zeros(2))
            print(line(number, situation, found), flush=True)
    print()
    for (situation, what, stands), count in sorted(counts.items()):
        print(f"{situation:<8}{what:<9}{stands:<24}{count:>5}")
    print(f"\nSeconds of the processor: {seconds[0]:.0f} of the toolbox, {seconds[1]:.0f} of the C")


if __name__ == "__main__":
    main()
