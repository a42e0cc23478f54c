"""Do all ways to a border agree: Hopf points and folds, matrices and runs, `onset` and runs that are far longer, whole runs and runs that were cut?

For every law on the rig of Jansen and van den Steen, on wells that are drawn at random, on strings with three loads of dry friction along them, and on wells
from tables that rub along the whole of their holes:

- Loss of smooth running by `onset`, whose report names its way: poles, derivatives of the sampled map, or twin runs. Against it (exact) the Hopf point of
  `hopf_points`, or the matrix of the sampled loop where it has one; and (by runs) the growth that the extrema of one long run show after a kick, on both
  sides of the border, carried straight to where it is zero.
- End of stick-slip by `onset`. Against it the first bifurcation of the cycle by `follow` under a continuous law; and runs that are led from inside stick-slip
  to just below the end and just above it, and held there for an hour: those below still stick at last and those above do not. The bracket is how far below
  and above that is.
- A run that is cut into pieces, inside of a stick, at a sample, between a sample and its output and anywhere, each piece begun from `run.last`: the
  largest difference of a state to the whole run, in parts of the largest value of that state.

    python -m studies agreement [--only WORD ...] [--wells N] [--seed N]          (a table; ten minutes)
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq

from controllers import PI, ImplicitSlidingMode, Lifting, LinearMPC, SlidingMode, SoftTorque, StiffPI, SuperTwisting
from models import BitRock, Coulomb, DrillString, Section, Survey, TorsionalChain, inner_diameter, wells
from studies.command_line import parser_of
from studies.timing import timed
from toolbox import (
    ClosedLoop,
    HybridSystem,
    Sampled,
    SceneError,
    closed_loop,
    compose,
    follow,
    hopf_points,
    limit_cycle,
    measure,
    onset,
    simulate,
)
from toolbox.authoring import in_si
from toolbox.onsets.growth import SmoothBranch
from toolbox.onsets.motions import slip_rows
from toolbox.onsets.results import Onset
from toolbox.simulation.request import Request
from toolbox.simulation.run_state import RunState
from toolbox.steady_states.equilibria import EquilibriumBranch
from toolbox.steady_states.linear_loop import NoDerivative
from toolbox.steady_states.steady_loop import steady_loop

PARAMETER = "top.reference"
RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
AWAY, KICK, SWINGS = 0.01, 1e-4, 60
"""How far from the border of smooth running its growth is read from a run [rad/s], the kick in parts of the slip, and the swings of that run."""
GROWN = 1.5
"""The kick from which stick-slip begins, in the swing that grows."""
HELD = 3600.0
"""Seconds for which a set-point is held in runs against which the end of stick-slip is judged."""
BRACKETS = (0.005, 0.01, 0.02, 0.05)
"""How far below and above the end [rad/s] such runs are tried."""


class OwnPI:
    """A PI law as a user writes one: a Python object that begins with the torque that acts and tells its memory."""

    measured_signals, actuated_signals = ("top.speed",), ("top.torque",)

    def __init__(self, proportional: float, integral: float, period: float):
        self.defaults = {PARAMETER: (6.0, "rad/s"), "top.torque": (0.0, "N m")}
        self.proportional, self.integral, self.period = proportional, integral, period
        self.sum = math.nan

    def __call__(self, t: float, y: np.ndarray) -> float:
        """The torque of a sample."""
        error = float(y[1] - y[0])
        if math.isnan(self.sum):
            self.sum = (float(y[2]) - self.proportional * error) / self.integral if y[2] else 0.0
        torque = self.proportional * error + self.integral * self.sum
        self.sum += self.period * error
        return torque

    def get_memory(self) -> list[float]:
        """What the law remembers."""
        return [self.sum]

    def set_memory(self, values: Sequence[float]) -> None:
        """Remember what was remembered."""
        self.sum = float(values[0])


@dataclass(frozen=True)
class Case:
    """A law on a string.

    between, values: where its borders are looked for [rad/s], and at how many values;  relapses: whether it ends stick-slip by itself
    and falls back into it, so that every set-point is held from the start, for two hours;  start: the working point [rad/s].
    """

    label: str
    law: Any
    plant: HybridSystem = RIG
    between: tuple[float, float] = (3.0, 11.0)
    relapses: bool = False
    start: float = 6.0
    values: int = 4

    @cached_property
    def loop(self) -> ClosedLoop:
        """The law on its string."""
        return closed_loop(self.plant, self.law, inputs={PARAMETER: self.start}, element="bit")

    @cached_property
    def onset(self) -> Onset:
        """Both borders."""
        return onset(self.loop, PARAMETER, self.between, num_values=self.values)

    @cached_property
    def branch(self) -> SmoothBranch[float]:
        """Smooth running over the set-point."""
        loop, number = self.loop, self.loop.number(PARAMETER)
        try:
            followed = EquilibriumBranch(loop.continuous_loop.system, loop.continuous_loop.number(PARAMETER), {}, None)
        except SceneError:
            followed = None
        return SmoothBranch(Request(loop, 1.0).checked(), lambda value: [(number, value)], followed)

    @property
    def exact(self) -> float:
        """Loss by the Hopf point of a continuous loop, or by the matrix of a sampled one; nan where there is neither [rad/s]."""
        near = self.onset.loss
        if not self.loop.is_sampled:
            return min(
                (point.value for point in hopf_points(self.loop, PARAMETER, self.between)),
                key=lambda value: abs(value - near),
                default=math.nan,
            )

        def outside(value: float) -> float:
            loop = steady_loop(self.loop.at(PARAMETER, value)).loop()
            return float(np.abs(np.linalg.eigvals(loop.A + loop.B @ loop.C)).max()) - 1.0

        try:
            return float(brentq(outside, near - AWAY, near + AWAY, xtol=1e-11))
        except (NoDerivative, SceneError, ValueError):  # a law in Python, one without a slope, or a memory that does not act back
            return math.nan

    def kicked(self, value: float, part: float) -> RunState:
        """Smooth running at a value, kicked along the motion that grows by a part of the slip."""
        run, smooth = self.branch.at(value), self.branch(value)
        if smooth is None:
            raise SceneError(f"There is no smooth running of {self.label} at {value:g} rad/s.")
        state = smooth.state
        away = np.zeros(state.values.size)
        if smooth.growth.way == "twin runs":
            away[: state.states.size] = self.branch.shaken(run, state)
        else:
            rows = slip_rows(run.system, state.states, run.system.values)
            away = smooth.direction / np.max(np.abs(rows @ smooth.direction[: state.states.size]) / np.abs(rows @ state.states))
        return state.at_values(state.values + part * away)

    def growth(self, value: float) -> float:
        """Rate at which the swing of the bit grows in one run after a kick of smooth running [1/s]."""
        swing = self.branch(value).growth.period  # type: ignore[union-attr]
        shown = self.branch.at(value).again(
            start=self.kicked(value, KICK), duration=SWINGS * swing, accuracy=1e-11, output_times=None, longest_step=swing / 16
        )
        early, late = shown.begin + SWINGS * swing / 3, shown.end - 3 * swing
        first, last = (np.ptp(shown.at(np.linspace(at, min(at + 3 * swing, shown.end), 6001))["bit.speed"]) for at in (early, late))
        return math.log(last / first) / (late - early)

    @property
    def by_runs(self) -> float:
        """Loss by the growth of long runs on both sides [rad/s]."""
        low, high = (self.onset.loss + sign * AWAY for sign in (-1, 1))
        one, other = self.growth(low), self.growth(high)
        return low + (high - low) * one / (one - other)

    @property
    def followed(self) -> float:
        """The bifurcation of a followed cycle that is next to the end; nan under a sampled law [rad/s]."""
        if self.loop.is_sampled:
            return math.nan
        inside, found = self.onset.loss - 0.05, []
        for start in (None, self.kicked(inside, GROWN)):
            cycle = limit_cycle(simulate(self.loop.at(PARAMETER, inside), 600.0, start=start, accuracy=1e-9))
            ahead = follow(cycle, PARAMETER, (inside, 1.5 * self.onset.end), start_towards=1.5 * self.onset.end, points=200)
            found += [point.value for point in ahead.bifurcations]
        return min(found, key=lambda value: abs(value - self.onset.end), default=math.nan)

    def sticks(self, value: float) -> bool:
        """Whether the bit still sticks at the end of a run that is led from inside stick-slip to a set-point and held there.

        Stick-slip is begun below the loss of smooth running, from standstill and from the swing that grows there: each may be a cycle of its own.
        """
        if self.relapses:  # led in small steps from where it gave up, the law would stay so for 5 % of the set-point
            run = simulate(self.loop.at(PARAMETER, value), 2 * HELD)
            return any(end > HELD for _, end in measure.stick_intervals(run, "bit"))
        inside, near = min(self.onset.loss - 0.05, value - 0.2), value - 0.1
        # the last 0.1 rad/s in 1000 s: in 200 s they shake a cycle off whose stick has nearly shrunk to nothing (well 9: 0.01 too early)
        ramp = ([0.0, 300.0, 300.0 + 400.0 * (near - inside), 1300.0 + 400.0 * (near - inside)], [inside, inside, near, value])
        loop = closed_loop(self.loop, inputs={PARAMETER: ramp})
        for start in (None, self.kicked(inside, GROWN)):
            run = simulate(loop, ramp[0][-1] + HELD, start=start)
            if any(end > run.end - 100.0 for _, end in measure.stick_intervals(run, "bit")):
                return True
        return False

    @property
    def bracket(self) -> float:
        """The least distance from the end below which an hour still sticks at last, and above which none does [rad/s]; nan for none of those tried."""
        end = self.onset.end
        return next((each for each in BRACKETS if self.sticks(end - each) and not self.sticks(end + each)), math.nan)

    @property
    def cut(self) -> float:
        """Largest difference of a run in pieces to the whole one, in parts of the size of each state."""
        loop = closed_loop(
            self.loop.at(PARAMETER, min(np.nan_to_num([self.onset.loss, self.start], nan=self.start))), start={"bit.speed": 1.0}
        )
        whole = simulate(loop, 30.0, accuracy=1e-12)
        sticks = measure.stick_intervals(whole, "bit")
        cuts = sorted({*(0.5 * (begin + end) for begin, end in sticks[:1]), 7.0, 7.075, 12.345678, 30.0})
        size, worst, before, start = np.abs(whole.states).max(axis=0) + 1e-300, 0.0, 0.0, None
        for end in cuts:
            part = simulate(loop, end - before, start=start, accuracy=1e-12)
            at = np.linspace(part.begin, part.end, 400)[:-1]
            worst = max(worst, float((np.abs(part.at(at).states - whole.at(at).states) / size).max()))
            before, start = end, part.last
        return worst


LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}
OWN = PI().design(RIG)
LAWS = (
    Case("PI, continuous", PI()),
    Case("soft torque, continuous", SoftTorque(), between=(2.0, 16.0)),
    Case("sliding mode, continuous", SlidingMode(), between=(2.0, 16.0)),
    Case("PI, 100 Hz", Sampled(PI(), 0.01)),
    Case("PI, 100 Hz, 50 ms late", Sampled(PI(), 0.01, delay=0.05)),
    Case("super-twisting, 100 Hz", Sampled(SuperTwisting(), 0.01)),
    Case("implicit sliding mode, 100 Hz", Sampled(ImplicitSlidingMode(), 0.01)),
    Case("lifting around PI, 100 Hz", Sampled(Lifting(PI()), 0.01), between=(3.0, 6.0), relapses=True),
    Case("own PI in Python, 20 Hz", Sampled(OwnPI(OWN.proportional, OWN.integral, 0.05), 0.05), between=(3.5, 10.5)),
    Case("linear MPC, 10 Hz", Sampled(LinearMPC(reference=6.0, **LIMITS), 0.1), between=(2.0, 8.0)),
)


def drawn(count: int, seed: int) -> Iterator[Case]:
    """Wells of two to four inertias at random; every third has friction at three places of its string."""
    random = np.random.default_rng(seed)
    drives = (
        ("soft torque", SoftTorque(), 0.0),
        ("stiff PI, 100 Hz", StiffPI(), 0.01),
        ("implicit sliding mode, 50 Hz", ImplicitSlidingMode(), 0.02),
    )
    for k in range(count):
        along = k % 3 == 2
        size = 4 if along else int(random.integers(2, 5))
        chain = TorsionalChain(
            inertia=(random.uniform(1200.0, 3000.0), *random.uniform(200.0, 800.0, size - 1)),
            stiffness=tuple(random.uniform(400.0, 1600.0, size - 1)),
            damping=tuple(random.uniform(5.0, 30.0, size - 1)),
            top_drag=float(random.uniform(100.0, 500.0)),
            friction=Coulomb(static=0.3, kinetic=0.25) if along else None,
            friction_load=tuple(random.uniform(500.0, 3000.0, 3)) if along else None,
        )
        word, law, period = drives[int(random.integers(len(drives)))]
        label = f"well {k}: {size} inertias{', friction at 3' if along else ''}, {word}"
        weight = float(random.uniform(70e3, 120e3))
        yield Case(label, Sampled(law, period) if period else law, compose(chain, BitRock(weight=weight)), (1.5, 25.5), values=9)


def tabled() -> Iterator[Case]:
    """Wells from tables, of 4 to 16 inertias, whose strings rub along the whole of their holes."""
    tries = ((4, "1500 m", PI(), 0.0), (8, "2500 m", StiffPI(), 0.01), (16, "4000 m", SoftTorque(), 0.0))
    for size, depth, law, period in tries:
        length = in_si(depth, "m", "depth")
        sections = [Section(length - 200.0, "5 in", inner_diameter("5 in", "19.5 ppf")), Section(200.0, "6.75 in", "2.8125 in")]
        hole = Survey((0.0, 0.3 * length, 0.6 * length, length), (0.0, 0.0, math.radians(35.0), math.radians(35.0)), (0.0,) * 4)
        string = DrillString.from_tables(
            sections, hole, top_inertia=2000.0, elements=size - 1, friction=Coulomb(0.12, 0.1), on_bottom=True, mud_density=1200.0,
            drag_rate=0.1, internal_damping=0.005,
        )  # fmt: skip
        law = Sampled(law, period) if period else law
        yield Case(
            f"well from tables: {depth}, {size} inertias", law, compose(string, BitRock(weight=80e3)), (1.5, 25.5), values=7, start=12.0
        )


HEAD = ("law", "loss", "way", "exact", "by runs", "end", "follow", "held", "cut", "s")


def row(case: Case) -> dict[str, Any]:
    """What the ways come to: borders [rad/s], and how far the others are from those of `onset` (`held`: the bracket)."""
    found, seconds = timed(lambda: case.onset)
    lost, ends = math.isfinite(found.loss), math.isfinite(found.end)
    return {
        "law": case.label,
        "loss": found.loss,
        "way": found.losses[0].followed if lost else "-",
        "exact": abs(case.exact - found.loss) if lost else math.nan,
        "by runs": abs(case.by_runs - found.loss) if lost else math.nan,
        "end": found.end,
        "follow": abs(case.followed - found.end) if lost and ends else math.nan,
        "held": case.bracket if lost and ends else math.nan,
        "cut": case.cut,
        "s": seconds,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line per law and well."""
    parser = parser_of(__doc__)
    parser.add_argument("--only", nargs="+", metavar="WORD", help="only cases whose label contains one of these")
    parser.add_argument("--wells", type=int, default=9, help="wells drawn at random (9)")
    parser.add_argument("--seed", type=int, default=1, help="of what is drawn (1)")
    given = parser.parse_args(arguments)
    print(
        "Borders in rad/s; exact, by runs, follow: distance from `onset`; held: half the width of the bracket by runs of an hour; s: time of `onset`\n"
    )
    print(f"{HEAD[0]:<54}{HEAD[1]:>10}  {HEAD[2]:<12}" + "".join(f"{word:>10}" for word in HEAD[3:]))
    for case in (*LAWS, *drawn(given.wells, given.seed), *tabled()):
        if given.only and not any(word in case.label for word in given.only):
            continue
        found = row(case)
        cells = []
        for word in HEAD[1:]:
            if word == "way":
                cells.append(f"  {found['way']:<12}")
                continue
            form = (
                "10.5f"
                if word == "end"
                else "10.1f"
                if word == "s"
                else "10.1e"
                if word in ("exact", "by runs", "follow", "cut")
                else "10g"
            )
            cells.append(f"{'-':>10}" if math.isnan(found[word]) else f"{found[word]:>{form}}")
        print(f"{found['law']:<54}{''.join(cells)}", flush=True)


if __name__ == "__main__":
    main()
