"""How wrong the model may be: the smallest joint error of several numbers that breaks a closed loop.

An error is measured in parts of given ranges: e = (e_1 ... e_n) with every e_i in [-1, 1] is the machine whose number i is at its nominal value for
e_i = 0, at the high end of its range for 1 and at the low end for -1, and its size is the largest |e_i|, so that all numbers are wrong at once by as much as
each of them wishes. Three sizes answer the question, each by its own means:

- that of the smallest error with which *the machine itself* fails, from given starts, judged as `worst_case` judges;
- that of the smallest error with which *smooth running* grows, by the exact rate of growth on the machine with this error. It is never smaller than it is
  for runs, which also fail in other ways;
- a size *below which no error* makes smooth running grow, to first order in the errors: with the linear loop q+ = S q, S = S_0 + sum e_i S_i, S_i = L_i R_i,

      M(w) = R (I - Lambda S_0)^-1 Lambda L,   Lambda = diag(1 / s, 1):   size >= 1 / max_w mu(M) >= 1 / max_w min_D |D M D^-1|

  where an error of the delay by d is a factor 1 + delta of every command with |delta| <= w d (K. Zhou, J. Doyle, K. Glover, Robust and Optimal Control,
  Prentice Hall 1996, chapter 11). As D scales knows nothing of errors being real, it may be a good deal lower than need be.

The search goes outwards through the corners and the axes of the box, all of one size side by side in lanes, halves the step in which the first fails, and
turns single numbers back where that fails at a smaller size. A search shows that an error breaks the loop, not that no smaller one does.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.arguments import mapping
from toolbox.errors import SceneError, SimulationError
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.unit_systems import asked_in, reading
from toolbox.files.units import NumberOrText, in_si
from toolbox.halving import halved
from toolbox.measuring.sticks import is_stick, stuck_ratio
from toolbox.measuring.verdict import growth_in_words
from toolbox.messages import sign_of_life
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.closing import all_described
from toolbox.modelling.laws import Sampled
from toolbox.onsets.coming_to import last_change, verdict_on
from toolbox.robustness.disk_margins import balancing, frequencies, peak
from toolbox.robustness.outcomes import Outcome
from toolbox.robustness.starts import OwnStickSlip, SmoothRunning, Start, Starts
from toolbox.robustness.worst_case import DELAY, Trials, declared_value
from toolbox.simulation.simulate import simulate
from toolbox.steady_states.linear_loop import NoDerivative
from toolbox.steady_states.steady_loop import linear_loop

SIZES = 8
"""Steps of the size of errors in which the search goes outwards."""

PRECISION = 0.01
"""What the size of the smallest error is found to, in parts of the ranges."""

EXACT = 1e-6
"""What the size at which smooth running grows is found to along its way, in parts of the ranges."""

MOST = 7
"""Numbers that may be wrong at once, at most: there are 2^n corners."""

ROUNDS = 3
"""How often single numbers are turned back."""

Error = tuple[float, ...]
"""An error in parts of the ranges."""


@dataclass(frozen=True)
class WrongNumber:
    """A number of a loop and the range of its error.

    Attributes
    ----------
    name, unit
        Its name, and its unit in SI.
    nominal, low, high
        Its nominal value and the ends of its range, in the unit.
    """

    name: str
    unit: str
    nominal: float
    low: float
    high: float

    def value(self, part: float) -> float:
        """Return the value of the number at an error, given as a fraction of the range."""
        return self.nominal + part * (self.high - self.nominal if part > 0 else self.nominal - self.low)


@dataclass(frozen=True)
class SmallestError(Told, Result):
    """Smallest joint error of several numbers with which a loop fails, the result of `smallest_error`. `print(found)`
    shows it beside the errors from the linear loop.

    Attributes
    ----------
    title
        The controllers and how they run.
    run_conditions
        Start of the runs, the judged contact, and time from which runs are judged.
    parameters
        The uncertain numbers, and their ranges.
    size
        Size of the smallest error with which a run was found to fail, as a fraction of the ranges [1]. inf if no run
        with an error within the ranges failed.
    error
        This smallest error, as a fraction of the range of each number, shape (numbers,). Empty if no run failed.
    why
        The behaviour of the machine with this error: the outcome of a separate run, from `judge`.
    largest_tolerated
        Largest size up to which every error that was tried succeeds [1].
    runs
        Number of runs of the search.
    linear_size, linear_error
        Size and error as above for the smallest error with which smooth running is unstable, from the exact growth rate
        of the linear loop. nan and empty if there is no growth rate.
    guaranteed_size
        Size below which no error makes smooth running unstable, if the loop changes linearly with the errors [1]. nan
        if there is no linear loop.
    display_units
        {SI unit: unit that was typed}: the units in which `print` answers.
    undetermined_reason
        Reason why `guaranteed_size` is nan. Empty if it is a number.
    situation
        The situation for which the verdict holds, in one line.
    own_stick_slip
        Description of the outcome of runs of the nominal plant from the loop's own stick-slip. Empty if the runs start
        from given values.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> from toolbox.robustness import smallest_error
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(SoftTorque(reference="60 rpm"), "10 ms", delay="30 ms"))
    >>> found = smallest_error(loop, {"bit.weight": 0.5}, "60 s")
    >>> print(f"the loop fails if the weight deviates by {found.size * 50:.0f} %")
    the loop fails if the weight deviates by 20 %
    """

    title: str
    run_conditions: str
    parameters: tuple[WrongNumber, ...]
    size: float
    error: tuple[float, ...]
    why: str
    largest_tolerated: float
    runs: int
    linear_size: float
    linear_error: tuple[float, ...]
    guaranteed_size: float
    display_units: Mapping[str, str]
    undetermined_reason: str = ""
    own_stick_slip: str = ""
    situation: str = ""

    @property
    def values(self) -> dict[str, float]:
        """{number: value in SI at the smallest error that makes the loop fail}. Empty if no run failed."""
        return {number.name: number.value(part) for number, part in zip(self.parameters, self.error, strict=bool(self.error))}

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The table as text: one line per number."""
        lines: list[tuple[str, ...]] = [("number", "nominal", "from", "to", "the machine breaks at", "smooth running grows at")]
        for i, number in enumerate(self.parameters):
            read = reading(number.unit, self.display_units)
            shown = [f"{value * read.factor:.4g}" for value in (number.nominal, number.low, number.high)]
            for parts in (self.error, self.linear_error):
                value = number.value(parts[i]) if parts else math.nan
                off = f" ({100 * (value / number.nominal - 1):+.3g} %)" if number.nominal else ""
                shown.append(f"{value * read.factor:.4g}{off}" if parts else "-")
            lines.append((number.name + (f" [{read.tail.strip()}]" if read.tail else ""), *shown))
        return lines

    def _told(self) -> list[str | Rows]:
        broken = f"{self.size:.3g} of the ranges, all at once: {self.why}" if self.error else "none within the ranges"
        lines: list[str | Rows] = [
            f"Smallest error that breaks {self.title}: {broken}",
            f"  {self.situation or self.run_conditions}",
            Rows(self.rows),
        ]
        lines.append(
            f"  with every error that was tried up to {self.largest_tolerated:.3g} of the ranges these runs are a success ({self.runs} runs)"
        )
        if self.own_stick_slip:
            lines.append(f"  {self.own_stick_slip}")
        if not math.isnan(self.linear_size):
            grows = "stays stable within them" if math.isinf(self.linear_size) else f"grows from {self.linear_size:.3g} on"
            lines.append(f"  smooth running {grows}")
        if not math.isnan(self.guaranteed_size):
            lines.append(f"  no error below {self.guaranteed_size:.3g} makes it grow, to first order (mu)")
        elif self.undetermined_reason:
            lines.append(f"  no size is guaranteed (mu): {self.undetermined_reason}")
        return lines

    def _table(self) -> HeadedRows:
        """One row per number."""
        headings = ["number", "unit", "nominal", "low", "high", "error", "value", "linear error", "linear value"]
        rows = []
        for i, number in enumerate(self.parameters):
            parts = [each[i] if each else math.nan for each in (self.error, self.linear_error)]
            found = [value for part in parts for value in (part, number.value(part))]
            rows.append([number.name, number.unit, number.nominal, number.low, number.high, *found])
        return headings, rows

    def plot(self, ax: Any = None) -> Any:
        """Draw the errors found in the range of each number (`toolbox.robustness.figures.error_diagram`), and return the axes.

        Parameters
        ----------
        ax
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.robustness.figures import error_diagram

        sizes = {"every run succeeds": self.largest_tolerated, "guaranteed (mu)": self.guaranteed_size}
        found = {"the machine breaks": self.error, "smooth running grows": self.linear_error}
        return error_diagram([number.name for number in self.parameters], found, sizes, ax=ax)


@sign_of_life("smallest_error is at work")
@takes_loop
def smallest_error(
    loop: ClosedLoop,
    uncertainty: Mapping[str, Any],
    duration: NumberOrText,
    *,
    starts: Start | Starts | None = None,
    after: NumberOrText | None = None,
    mean_within: float = 0.02,
    ripple_within: float = 0.05,
) -> SmallestError:
    """Find the smallest simultaneous error of several numbers with which a closed loop fails, as a fraction of the range of each number.

    Parameters
    ----------
    loop
        A loop. Its controllers are designed on the declared plant, and errors do not change their design.
    uncertainty
        {number of the loop: (low, high)}, in SI or text with units, with the declared value within. Or a fraction of
        the declared value to either side, such as 0.2. "delay" is the delay of the sampled controllers. At most 7
        numbers.
    duration
        Length of a run [s].
    starts
        Starts of the runs: `FromRest()`, `TakenOver(initial_controller)` (from the stick-slip of another controller),
        `OwnStickSlip()`, or start values {state or held command: value} of each run. By default `SmoothRunning()`,
        which needs constant inputs.
    after
        Time from which on a run is judged [s]. By default the last 30 % of the run.
    mean_within, ripple_within
        Allowed error of the mean speed as a fraction of the set-point [1], by default 0.02, and allowed ripple of a
        command as a fraction of its mean [1], by default 0.05.

    Returns
    -------
    SmallestError
        The error, the behaviour of the machine with it, and the result for the linear loop.

    Raises
    ------
    SceneError
        If a name is unknown, a range is empty, or the loop fails on the nominal plant.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> from toolbox.robustness import smallest_error
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(SoftTorque(reference="60 rpm"), "10 ms", delay="30 ms"))
    >>> found = smallest_error(loop, {"bit.weight": 0.5}, "60 s")
    >>> print(f"{found.size:.2f} of the range")
    0.39 of the range
    """
    numbers, asked = _wrong_numbers(loop, uncertainty)
    trials = Trials.of(loop, duration, starts=starts, after=after, allowed=(mean_within, ripple_within))
    search = _Search(numbers)

    def fail(errors: Sequence[Error]) -> list[bool]:
        cases = {str(error): _factors(numbers, error) for error in errors}
        return [not outcome.excess <= 1.0 for outcome in trials.of_cases(cases).by_error.values()]

    def grow(errors: Sequence[Error]) -> list[bool]:
        return [_rate(trials, numbers, error) > 0.0 for error in errors]

    nothing = (0.0,) * len(numbers)
    if fail([nothing])[0]:
        raise SceneError(f"Argument `loop` must be a success on the nominal plant, but it is not: {_alone(trials, numbers, nothing)}.")
    rate = _rate(trials, numbers, nothing)
    linear: Error = ()
    linear_size = math.nan
    if not math.isnan(rate):
        linear, linear_size, held = search(grow)
        if linear:  # a rate costs no run, so that its border is found as exactly as the rate is known
            direction = tuple(part / linear_size for part in linear)
            _, linear_size = halved(lambda size: grow([tuple(part * size for part in direction)])[0], held, linear_size, 0.0, EXACT)
            linear = tuple(part * linear_size for part in direction)
    before = search.tried
    error, size, held = search(fail)
    guaranteed, unknown = _guaranteed(trials, numbers)
    return SmallestError(
        title=all_described(loop.controllers),
        run_conditions=trials.way,
        parameters=numbers,
        size=size,
        error=error,
        why=_alone(trials, numbers, error) if error else "",
        largest_tolerated=held,
        runs=(search.tried - before + 1) * len(trials.starts(str(nothing), _factors(numbers, nothing)).values),
        linear_size=linear_size,
        linear_error=linear,
        guaranteed_size=guaranteed,
        undetermined_reason=unknown,
        display_units={**loop.display_units, **asked},
        situation=str(trials.situation("plants with errors of all these numbers at once")),
        own_stick_slip=_beside(trials) if isinstance(trials.start, SmoothRunning) else "",
    )


def _beside(trials: Trials) -> str:
    """What runs of the nominal plant come to that start from the loop's own stick-slip, in words."""
    own = OwnStickSlip()
    inside = dataclasses.replace(trials, start=own, begun={})
    found = own.on(trials.loop)
    if not found.values:
        return found.note
    inside.begun["nominal"] = found
    outcomes = inside.of_cases({"nominal": {}}).outcomes
    failed = sum(not outcome.excess <= 1.0 for outcome in outcomes)
    return (
        f"stick-slip exists beside smooth running, with a period of {found.period:.3g} s: begun from it, {failed} of {len(outcomes)} runs of the nominal "
        "plant fail, without any error"
    )


def _wrong_numbers(loop: ClosedLoop, uncertainty: Mapping[str, Any]) -> tuple[tuple[WrongNumber, ...], dict[str, str]]:
    """The numbers with their ranges, and {unit: unit that was typed}. Raises SceneError for one that is none, or is not around the nominal value."""
    given = mapping("uncertainty", uncertainty)
    if not 1 <= len(given) <= MOST:
        raise SceneError(f"Argument `uncertainty` must hold 1 to {MOST} numbers, but it holds {len(given)}.")
    found: list[WrongNumber] = []
    asked: dict[str, str] = {}
    for name, between in given.items():
        if name == DELAY:
            late = [law.delay for law in loop.controllers if isinstance(law, Sampled)]
            if not late or len(set(late)) > 1 or not late[0] > 0.0:
                raise SceneError(
                    f"Argument `uncertainty` must hold `{DELAY}` only for sampled laws of one delay > 0 s, but theirs are {late}."
                )
            full, unit, nominal = DELAY, "s", float(late[0])
        else:
            number = loop.varied_number(name)
            full, unit, nominal = number.name, number.unit, declared_value(loop, name)
        if nominal == 0.0:
            raise SceneError(f"Argument `uncertainty` must hold numbers that are not 0, but `{full}` is.")
        if isinstance(between, int | float) and not isinstance(between, bool):
            between = tuple(sorted((nominal * (1.0 - between), nominal * (1.0 + between))))
        typed = in_si(tuple(between), unit, full) if isinstance(between, tuple | list) else ()
        ends = [float(each) for each in typed]
        if len(ends) != 2 or not ends[0] <= nominal <= ends[1] or not ends[0] < ends[1]:
            raise SceneError(
                f"Argument `uncertainty` must hold (low, high) around the nominal {nominal:g} {unit} of `{full}`, or a part of it, but it holds {between!r}."
            )
        for end in ends if name != DELAY else ():
            loop.number(full).check(end)
        if name == DELAY and ends[0] < 0.0:
            raise SceneError(f"Argument `uncertainty` must hold delays >= 0 s, but it holds {between!r}.")
        found.append(WrongNumber(full, unit, nominal, *ends))
        if unit != "s":
            asked.setdefault(unit, asked_in(typed, unit))
    return tuple(found), asked


def _factors(numbers: Sequence[WrongNumber], error: Error) -> dict[str, float]:
    return {number.name: number.value(part) / number.nominal for number, part in zip(numbers, error, strict=True)}


def _rate(trials: Trials, numbers: Sequence[WrongNumber], error: Error) -> float:
    """Rate at which a small disturbance of smooth running grows on the machine with an error [1/s]; nan where it is not known."""
    settled = trials.settled(str(error), trials.machine(_factors(numbers, error)))
    return math.nan if settled is None else settled.rate


def _alone(trials: Trials, numbers: Sequence[WrongNumber], error: Error) -> str:
    """What the machine with an error does from the start that is the worst, in words: one run outside of the lanes, and the judge."""
    worst: Outcome = trials.of_cases({str(error): _factors(numbers, error)}).worst
    factors = _factors(numbers, error)
    loop = trials.starts(str(error), factors).loops(trials.machine(factors, worst.seed))[worst.start]
    begun = last_change(loop)
    try:
        run = simulate(loop, begun + trials.duration)
    except SimulationError as failure:
        return str(failure)
    verdict, judged = verdict_on(run, trials.contact, trials.speed, begun + trials.window)
    words = [str(verdict)]
    if judged is not None and judged.rate > 0.0:
        words.append(f"smooth running {growth_in_words(judged.rate)}")
    share = stuck_ratio(run, trials.contact, begun + trials.window)
    if is_stick(share):
        words.append(f"{100.0 * share:.2g} % of the window stuck")
    if not math.isnan(worst.ripple):
        words.append(f"ripple {100.0 * worst.ripple:.2g} % ({100.0 * trials.allowed[1]:.2g} % allowed)")
    return ", ".join(words)


# --------------------------------------------------------------------------------------------------------------------------------------- the search
@dataclass
class _Search:
    """The smallest error that is broken, by a function [error] -> [whether it is] that answers many at once. tried: errors asked about so far."""

    numbers: Sequence[WrongNumber]
    tried: int = 0

    def __call__(self, broken: Callable[[Sequence[Error]], list[bool]]) -> tuple[Error, float, float]:
        """(error, its size, largest size at which all that was tried held); an empty error of infinite size where there is none."""
        low, high, left = 0.0, 1.0, self._directions()
        for k in range(1, SIZES + 1):
            high = k / SIZES
            failed = self._broken(broken, left, high)
            if failed:
                break
            low = high
        else:
            return (), math.inf, 1.0
        best, low, high = self._nearest(broken, failed, low, high)
        for _ in range(ROUNDS):
            inner = [
                (*best[:i], part, *best[i + 1 :])
                for i, number in enumerate(self.numbers)
                for part in (-1.0, -0.5, 0.0, 0.5, 1.0)
                if part != best[i] and (part >= 0.0 or number.low < number.nominal) and (part <= 0.0 or number.high > number.nominal)
            ]
            inner = [direction for direction in inner if max(map(abs, direction)) == 1.0]
            failed = self._broken(broken, inner, high - PRECISION) if inner and high > PRECISION else []
            if not failed:
                break
            best, low, high = self._nearest(broken, failed, 0.0, high - PRECISION)
        return tuple(part * high for part in best), high, low

    def _nearest(
        self, broken: Callable[[Sequence[Error]], list[bool]], failed: list[Error], low: float, high: float
    ) -> tuple[Error, float, float]:
        """(direction, size at which nothing breaks, size at which it does) of the first of directions that are broken at `high`; all are halved at once."""
        left = [failed]

        def breaks(size: float) -> bool:
            inner = self._broken(broken, left[-1], size)
            left.extend([inner] if inner else [])
            return bool(inner)

        low, high = halved(breaks, low, high, 0.0, PRECISION)
        return left[-1][0], low, high

    def _broken(self, broken: Callable[[Sequence[Error]], list[bool]], directions: Sequence[Error], size: float) -> list[Error]:
        self.tried += len(directions)
        failed = broken([tuple(part * size for part in direction) for direction in directions])
        return [direction for direction, each in zip(directions, failed, strict=True) if each]

    def _directions(self) -> list[Error]:
        """The corners and the axes of the box; a side without a range has none."""
        sides = [
            tuple(({-1.0} if each.low < each.nominal else set()) | ({1.0} if each.high > each.nominal else set())) for each in self.numbers
        ]
        n = len(sides)
        axes = [tuple(part if i == j else 0.0 for j in range(n)) for i, parts in enumerate(sides) for part in sorted(parts)]
        return list(dict.fromkeys([*itertools.product(*map(sorted, sides)), *axes]))


# ---------------------------------------------------------------------------------------------------------------------------------------- the bound
STEP = 0.02
"""Part of the range over which the slope of the linear loop by an error is taken."""


def _guaranteed(trials: Trials, numbers: Sequence[WrongNumber]) -> tuple[float, str]:
    """The size below which no error makes smooth running grow, to first order; nan where there is no linear loop, and then why."""
    try:
        linear = linear_loop(trials.loop)
        if not linear.stable:
            return 0.0, ""
        n, k = linear.B.shape
        left, right, whole = [np.zeros((n + k, 0))], [np.zeros((0, n + k))], np.block([[linear.A, linear.B], [linear.C, linear.D]])
        for i, number in enumerate(numbers):
            if number.name == DELAY:
                continue
            slopes = []
            for part in (STEP, -STEP):
                near = tuple(part if j == i else 0.0 for j in range(len(numbers)))
                if number.value(part) != number.nominal:
                    there = linear_loop(trials.machine(_factors(numbers, near)))
                    slopes.append((np.block([[there.A, there.B], [there.C, there.D]]) - whole) / STEP)
            slope = max(slopes, key=lambda each: float(np.linalg.norm(each)))
            u, sizes, v = np.linalg.svd(slope)
            rank = int((sizes > 1e-4 * sizes[0]).sum()) if sizes[0] > 0.0 else 0
            left.append(u[:, :rank] * sizes[:rank])
            right.append(v[:rank])
    except (NoDerivative, SceneError) as error:
        return math.nan, str(error).rstrip(".")
    L, R = np.hstack(left), np.vstack(right)
    late = next((max(each.high - each.nominal, each.nominal - each.low) for each in numbers if each.name == DELAY), 0.0)

    def bound(w: np.ndarray) -> np.ndarray:
        point = 1j * w if linear.period is None else np.exp(1j * w * linear.period)
        return np.array([_scaled(_seen(whole, L, R, n, z, f * late)) for z, f in zip(point, w, strict=True)])

    largest, _ = peak(bound, frequencies(linear))
    return (1.0 / largest if largest > 0.0 else math.inf), ""


def _seen(whole: np.ndarray, L: np.ndarray, R: np.ndarray, n: int, z: complex, late: float) -> np.ndarray:
    """M at a point z: from what errors put in to what they act on; late: largest |delta| of the delay, 0 where it is exact."""
    size = whole.shape[0]
    inverse = np.concatenate([np.full(n, 1.0 / z), np.ones(size - n)])
    entering = inverse[:, None] * L
    leaving = R
    if late > 0.0:  # w = v - p is what the delay acts on
        one = np.eye(size, dtype=complex)[:, n:]
        entering, leaving = np.hstack([entering, late * one]), np.vstack([R, one.T])
    seen: np.ndarray = leaving @ np.linalg.solve(np.eye(size) - inverse[:, None] * whole, entering)
    if late > 0.0:
        seen[R.shape[0] :, L.shape[1] :] -= late * np.eye(size - n)
    return seen


def _scaled(matrix: np.ndarray) -> float:
    """The largest singular value of D M D^-1 with a D that balances M: an upper bound of mu for every D."""
    d = balancing(matrix)
    return float(np.linalg.norm(d[:, None] * matrix / d, 2))
