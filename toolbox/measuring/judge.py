"""What a machine does: it stands, sticks and slips, swings, or runs smoothly; one judge for all who ask.

No window of fixed length can tell. A loop that relapses every ten minutes shows minutes without a stick, and one whose disturbance grows with four minutes
looks calm for one. So a verdict rests on what comes back, and on how a small disturbance of smooth running grows:

- it *stands* if it sticks and the forces of all contacts are at rest, or come and go by the same without a release;
- it *sticks and slips* if the same stick comes back: with the lengths and intervals of one round like those of the round before, or drawing near to such a
  round faster than they would lose the stick, or anew after a lull;
- it *swings* if the same extremum comes back without a stick, or, where nothing decides until the budget is spent, if its extrema have risen and fallen
  without a stick and without growing, as they do where the motion is chaotic;
- it is *smooth* if the deviation from smooth running falls at the rate at which a small one does;
- else it is *not decided*, and the judge carries the run on until it can tell or its budget is spent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from toolbox.arguments import FloatArray
from toolbox.measuring.quintics import steps_of
from toolbox.measuring.sticks import joined, shortest_stick, stick_intervals
from toolbox.simulation.run_state import RunState
from toolbox.simulation.samples import Samples
from toolbox.simulation.trajectory import Trajectory

STANDS, STICKS, SWINGS, SMOOTH, NOT_DECIDED = "stands", "sticks and slips", "swings", "smooth", "not decided"
REGIMES = (STANDS, STICKS, SWINGS, SMOOTH, NOT_DECIDED)
"""The regimes, by their names in every report."""

NONE, FAILED = "none", "failed"
"""What stands in place of a regime where there is no smooth running to begin from, and where a run fails."""

SWINGS_OF_A_PIECE = 8
"""Swings that the judge looks at together, at least."""

LONGER = 8
"""Pieces after which they grow: each is no longer than this part of what was seen before, because it is looked at as a whole."""

WINDOW = 2
"""Swings of a window in which the largest deviation from smooth running counts."""

BUDGET = 2_000
"""Swings after which a run that nothing decides is given up."""

SAME = 1e-5
"""What two rounds may differ by, in parts of their size, to be the same."""

MOST_STICKS = 12
"""Sticks of the longest round that is looked for."""

LULL = 4
"""Swings without a stick that part one group of sticks from the next."""

COMPARED = 6
"""Rounds of which each is compared with the one before."""

FALLING = 4
"""Windows over which the mean fall of a deviation is told, twice in a row."""

ROUNDS = 30
"""Rounds that never repeat exactly, by noise, by the clock of a law or by chaos, after which their means tell."""

TURNS = 3
"""Changes between rising and falling below which a sequence is a curve and no scatter."""

FLOOR = 1e-6
"""Severity below which nothing swings."""

NEAR = 0.01
"""What three rounds in a row may differ by from a known one, in parts of its time, to come to it."""

CALM = 1e-3
"""Deviation, in parts of the target, that is small where it falls and small ones die."""


@dataclass(frozen=True)
class Judged:
    """What a run came to.

    Attributes
    ----------
    regime
        One of `REGIMES`, `NONE` or `FAILED`.
    severity
        Half of the range of the judged signal over what comes back, in parts of its mean.
    sticks
        Number of sticks in what comes back.
    longest
        Length of the longest of them [s].
    interval
        Time after which it comes back [s]; nan where nothing does.
    rate
        Rate at which a small disturbance of smooth running grows [1/s]; nan where it is not known.
    lowest, highest
        Range of the judged signal over what comes back; nan where it was not looked at.
    """

    regime: str
    severity: float = math.nan
    sticks: int = 0
    longest: float = 0.0
    interval: float = math.nan
    rate: float = math.nan
    lowest: float = math.nan
    highest: float = math.nan


@dataclass
class Record:
    """Observations of the judge: the sticks of a contact, and the motion of a signal.

    sticks: (begin, end) of each, shape (sticks, 2);  steps: (begin, end, lowest value, highest value, integral) of the steps of each piece, cut where windows
    of a length end, which divides that of a piece;  windows: lowest and highest value in each, shape (windows, 2);
    recent: 65 samples of the second half of each of the last three pieces, whose forces are looked at where the contact stays.
    """

    element: str
    signal: str
    shortest: float
    length: float
    sticks: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    steps: list[FloatArray] = field(default_factory=list)
    windows: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    first: float = math.nan
    now: float = math.nan
    recent: list[Samples[FloatArray]] = field(default_factory=list)

    def add(self, run: Trajectory) -> None:
        """Add a run that begins at the end of the previous run."""
        if math.isnan(self.first):
            self.first = run.begin
        sticks = joined([*self.sticks[-1:].tolist(), *stick_intervals(run, self.element)])  # the last one may go on
        self.sticks = np.concatenate([self.sticks[:-1], np.array(sticks).reshape(-1, 2)])
        edges = np.linspace(run.begin, run.end, max(round((run.end - run.begin) / self.length), 1) + 1)
        found = steps_of(run.every_step, self.signal, run.begin, run.end, tuple(edges[1:-1].tolist()))
        self.steps.append(np.stack([found.begin, found.end, found.lowest, found.highest, found.integral]))
        first = np.searchsorted(found.begin, edges[:-1])
        window = np.minimum.reduceat(found.lowest, first), np.maximum.reduceat(found.highest, first)
        self.windows = np.concatenate([self.windows, np.column_stack(window)])
        self.now = run.end
        late = run.every_step.at(np.linspace(0.5 * (run.begin + run.end), run.end, 65))  # not the run, whose steps may take 90 MB
        self.recent = [*self.recent[-2:], late]

    def _span(self, late: Samples[FloatArray]) -> FloatArray:
        """Range of the force of every contact over the second half of a piece, in parts of its largest value."""
        forces = [ca.SX(each.force) for each in late.program.system.elements if each.holds or each.name == self.element]
        force = late.computed(ca.vertcat(*forces)).reshape(65, -1)
        return np.asarray(np.ptp(force, axis=0) / np.maximum(np.abs(force).max(axis=0), 1e-300))

    @property
    def pieces_to_stand(self) -> float:
        """Number of pieces that a stick must last to count as standstill: 1 if the forces rest, 3 if they vary equally in three pieces,
        else inf.

        Of all contacts: that of a bit may rest for seconds while the string above it sticks to its hole, too, and the drive winds up the rest of it.
        """
        spans = np.array([self._span(run) for run in self.recent])
        if (spans[-1] < SAME).all():
            return 1.0
        most = spans.max(axis=0)
        again = (most < SAME) | (np.ptp(spans, axis=0) < 1e-3 * most)
        return 3.0 if len(spans) == 3 and again.all() else math.inf

    @property
    def resolved(self) -> FloatArray:
        """(begin, end) of the sticks that last, in order, shape (sticks, 2)."""
        return self.sticks[self.sticks[:, 1] - self.sticks[:, 0] > self.shortest]

    def table(self, begin: float) -> FloatArray:
        """(begin, end, lowest, highest, integral) of the steps whose middle lies behind a time, shape (5, steps)."""
        columns: list[FloatArray] = []
        for each in reversed(self.steps):
            if each.size and each[1, -1] <= begin:
                break
            if each.size:
                columns.insert(0, each)
        table = np.concatenate(columns, axis=1) if columns else np.empty((5, 0))
        return table[:, table[0] + table[1] > 2.0 * begin]

    def swing(self, begin: float, end: float) -> tuple[float, float, float]:
        """(severity, lowest, highest) of the signal between two times: half of its range in parts of its mean, and the range."""
        table = self.table(begin)
        table = table[:, table[0] + table[1] < 2.0 * end]
        if not table.size:
            return math.nan, math.nan, math.nan
        low, high, mean = float(table[2].min()), float(table[3].max()), float(table[4].sum() / (table[1, -1] - table[0, 0]))
        return (high - low) / (2.0 * abs(mean)) if mean else math.inf if high > low else math.nan, low, high

    def deviations(self, target: float, begin: float) -> FloatArray:
        """Largest deviation of the signal from a value in each window that begins after a time, the last one last."""
        count = min(int((self.now - begin) / self.length * (1.0 + 1e-9)), len(self.windows))
        low, high = self.windows[len(self.windows) - count :].T
        return np.maximum(high - target, target - low)


@dataclass(frozen=True)
class Judge:
    """The judge of one machine at one value of its numbers.

    Parameters
    ----------
    element, signal
        The contact whose sticks count, and the signal whose severity is told.
    swing
        Period of the least damped swing of the machine [s]: its scale of time.
    target
        Value of the signal in smooth running; nan where there is none.
    rate
        Rate at which a small disturbance of smooth running grows [1/s]; nan where it is not known.
    noise
        Largest deviation of the signal from its target that measurement noise makes in smooth running.
    budget
        Swings after which a run that nothing decides is given up.
    known
        What other runs with the same numbers came to: a round of a single stick is what a run comes to that has drawn near to it, and smooth running is what
        one comes to that falls towards it, in the mean over many swings, as a small deviation does.
    """

    element: str
    signal: str
    swing: float
    target: float = math.nan
    rate: float = math.nan
    noise: float = 0.0
    budget: float = BUDGET
    known: Sequence[Judged] = ()

    def carried(self, run_on: Callable[[RunState, float], Trajectory], begin: RunState) -> tuple[Judged, RunState]:
        """Carry a run on until it is decided, or the budget is spent; run_on: (state, duration) -> run. Returns the verdict and where the run ended.

        Raises SimulationError as the run does.
        """
        record, state = None, begin
        piece = SWINGS_OF_A_PIECE * self.swing
        while True:
            run = run_on(state, self._ahead(record) * piece)
            state = run.last
            record = record or self._record(run)
            record.add(run)
            judged = self.decided(record)
            if judged is not None or record.now - record.first >= self.budget * self.swing:
                late = max(record.first, record.now - 2 * piece)
                regime = SWINGS if self._wanders(record) else NOT_DECIDED
                return judged or self._verdict(regime, record, late, record.resolved[record.resolved[:, 0] > late]), state

    def _record(self, run: Trajectory) -> Record:
        """An empty record of the machine of a run."""
        return Record(self.element, self.signal, shortest_stick(self.swing, run.accuracy), WINDOW * self.swing)

    def _ahead(self, record: Record | None) -> int:
        """How many pieces of the least length are looked at next: more, the longer nothing has decided, but none behind the budget."""
        if record is None:
            return 1
        seen, left = record.now - record.first, self.budget * self.swing - (record.now - record.first)
        piece = SWINGS_OF_A_PIECE * self.swing
        return max(min(int(seen / piece + 0.5) // LONGER, math.ceil(left / piece - 1e-9)), 1)

    def of_run(self, run: Trajectory, after: float) -> Judged:
        """Return the verdict on a run from a time on [s], without continuing the run. The verdict is undecided if the run is too short."""
        record = self._record(run)
        record.add(run)
        record.sticks = np.maximum(record.sticks[record.sticks[:, 1] > after], after)
        record.first = max(record.first, after)
        return self.decided(record) or self._verdict(NOT_DECIDED, record, record.first)

    def decided(self, record: Record) -> Judged | None:
        """Return the verdict on the record if the record decides it, else None."""
        sticks = record.resolved
        if len(sticks) and sticks[-1][1] >= record.now:  # it sticks now
            lasting = record.now - max(sticks[-1][0], record.first)
            if lasting > SWINGS_OF_A_PIECE * self.swing * record.pieces_to_stand:
                return self._verdict(STANDS, record, sticks[-1][0], sticks[-1:])
            sticks = sticks[:-1]
            if lasting > LULL * self.swing:  # how it goes on is not told by what was before
                return None
        if len(sticks) and record.now - sticks[-1][1] < 2.0 * LULL * self.swing:
            return self._stick_slip(record, sticks)
        return self._after_lulls(record, sticks) or self._without_stick(record, sticks)

    def _verdict(self, regime: str, record: Record, begin: float, sticks: FloatArray | None = None, interval: float = math.nan) -> Judged:
        """A verdict, with its severity from a time on."""
        own = np.empty((0, 2)) if sticks is None else sticks
        end = begin + interval if math.isfinite(interval) else record.now
        longest = float((own[:, 1] - own[:, 0]).max(initial=0.0))
        severity, low, high = record.swing(begin, end)
        return Judged(regime, severity, len(own), longest, interval, self.rate, low, high)

    # ------------------------------------------------------------------------------------------------------------------------------ sticks come back
    def _stick_slip(self, record: Record, sticks: FloatArray) -> Judged | None:
        """Whether the same stick comes back, from round to round."""
        found = self._after_lulls(record, sticks)
        begins, ends = sticks.T
        lull = np.flatnonzero(begins[1:] - ends[:-1] > LULL * self.swing)
        first = int(lull[-1]) + 1 if lull.size else 0  # what was before the last lull is another story
        rows = np.column_stack([np.diff(begins[first:]), (ends - begins)[first:-1]])
        if found is not None or len(rows) < 3:
            return found
        if any(each.sticks == 1 and np.abs(rows[-3:] - (each.interval, each.longest)).max() <= NEAR * each.interval for each in self.known):
            return self._round(record, sticks, 1)
        most = min(MOST_STICKS, len(rows) // 3)
        parted = [math.inf, *[float(np.abs(rows[-p:] - rows[-2 * p : -p]).max()) for p in range(1, most + 1)]]
        for p in range(1, most + 1):
            if self._comes_back(rows, p, parted):
                return self._round(record, sticks, p)
        return None

    def _round(self, record: Record, sticks: FloatArray, p: int) -> Judged:
        """The verdict over the last round of p sticks."""
        begin, interval = float(sticks[-1 - p, 0]), float(sticks[-1, 0] - sticks[-1 - p, 0])
        return self._verdict(STICKS, record, begin, sticks[-1 - p : -1], interval)

    def _comes_back(self, rows: FloatArray, p: int, parted: Sequence[float]) -> bool:
        """Whether rounds of p sticks, rows (interval, length), are the same, or come to be so before a stick is lost.

        parted: largest difference of the last round of 0, 1, 2 ... sticks to the one before.
        """
        size = rows[-p:, 0].sum()
        # a round of several sticks must be more than shorter rounds that slowly part: they differ by far more than from round to round
        within = min((parted[q] for q in range(1, p) if p % q == 0), default=math.inf) / size
        if parted[p] / size > 1e-3 * within:
            return False
        count = len(rows) // p
        rounds = rows[len(rows) - min(count, COMPARED) * p :].reshape(-1, p, 2)
        apart = np.abs(np.diff(rounds, axis=0)).max(axis=(1, 2)) / size
        if apart[-1] < SAME and apart[-2] < 10 * SAME and apart[-1] <= max(apart[-2], 0.01 * SAME):
            return True  # what grows, if slowly, is on its way out
        margin = rounds[-1, :, 1].min() / size
        if len(rounds) == COMPARED and self._settles(rounds[:, :, 1] / size, margin):
            return True
        return count >= ROUNDS and p == 1 and _steady(rows[:, 1] / size, margin)

    @staticmethod
    def _settles(lengths: FloatArray, margin: float) -> bool:
        """Whether the lengths of the sticks draw near to limits, and these stay, long before they are zero.

        The limit is that of a geometric sequence (Aitken). On the way past a cycle that is not there any more, the limit moves on as fast as the lengths do.
        """
        last = lengths[-5:]
        steps = np.diff(last, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = steps[1:] / steps[:-1]
            limits = last[2:] + steps[1:] * ratios / (1.0 - ratios)
        moved = np.abs(steps[-1])
        settled = moved < SAME
        calm = (np.abs(ratios) < 0.98).all(axis=0) & (np.abs(np.diff(limits, axis=0)) < 0.1 * moved).all(axis=0)
        left = np.abs(limits[-1] - last[-1])
        return bool((settled | (calm & (left < 0.5 * margin))).all())

    def _after_lulls(self, record: Record, sticks: FloatArray) -> Judged | None:
        """Whether sticks have come back after two lulls: what was before is forgotten then, so that it goes on so."""
        if len(sticks) < 3:
            return None
        begins, ends = sticks.T
        groups = np.flatnonzero(np.append(True, begins[1:] - ends[:-1] > LULL * self.swing))
        if groups.size < 4:
            return None
        heads = begins[groups]
        intervals = np.diff(heads)[-2:]
        if abs(intervals[1] / intervals[0] - 1.0) > 0.2:
            return None
        own = sticks[int(groups[-2]) : int(groups[-1])]
        return self._verdict(STICKS, record, float(heads[-2]), own, float(intervals[1]))

    # ------------------------------------------------------------------------------------------------------------------------------- without sticks
    def _without_stick(self, record: Record, sticks: FloatArray) -> Judged | None:
        """Whether the deviation from smooth running falls as a small one does, or the same extremum comes back."""
        begin = max(record.first, sticks[-1][1] + LULL * self.swing if len(sticks) else record.first)
        length, late = record.length, record.now - record.length
        target = self.target
        if math.isnan(target):
            table = record.table(late)
            target = float(table[4].sum() / (table[1, -1] - table[0, 0]))
        away, size = record.deviations(target, begin), max(abs(target), 1e-300)
        if away.size < 4:
            return None
        with np.errstate(divide="ignore", invalid="ignore"):
            rates = np.diff(np.log(away[-4:])) / length
            as_small = (
                np.abs(rates / self.rate - 1.0).max() < 0.25 if math.isfinite(self.rate) else np.ptp(rates) < 0.25 * abs(rates.mean())
            )
        if not as_small and away.size > 2 * FALLING and any(each.regime == SMOOTH for each in self.known):
            means = -np.diff(np.log(away[[-1, -1 - FALLING, -1 - 2 * FALLING]])) / (FALLING * length)  # two swings that beat fall by turns
            as_small = np.abs(means / self.rate - 1.0).max() < 0.25
        dies = self.rate < 0 or (math.isnan(self.rate) and bool((rates < 0).all()))
        small = away[-3:].max() <= max(self.noise, CALM * size) and (away[-1] < away[-3] or away[-1] <= max(self.noise, FLOOR * size))
        if dies and (small or as_small):
            return self._verdict(SMOOTH, record, late)
        still = np.abs(rates).max() * length < 10 * SAME or (away.size >= ROUNDS and _steady(away, float(away[-1])))
        if still and not as_small and away[-1] > max(self.noise, FLOOR * size):
            return self._verdict(SWINGS, record, late, interval=length)
        return None

    def _wanders(self, record: Record) -> bool:
        """Whether extrema far from an unstable smooth running have risen and fallen for two thirds of what was seen, without a stick and without growing."""
        if not self.rate > 0:
            return False
        _, middle, last = np.array_split(record.deviations(self.target, record.first), 3)
        away = np.concatenate([middle, last])
        calm_since = record.now - away.size * record.length
        sticks = len(record.resolved) and record.resolved[-1][1] > calm_since
        falls = bool((np.diff(away) < -0.1 * away[:-1]).any() and (np.diff(away) > 0.1 * away[:-1]).any())
        return falls and not sticks and away.min() > CALM * abs(self.target) and last.max() < 2.0 * middle.max()


def _steady(values: FloatArray, margin: float) -> bool:
    """Whether the mean of a sequence that never repeats stays: its last third is like the one before, as far as its scatter tells, or draws near to it.

    A scatter that grows from third to third tells nothing yet.
    """
    thirds = np.array_split(values, 3)
    scatters = [float(np.std(each)) for each in thirds]
    if scatters[0] < scatters[1] < scatters[2]:
        return False
    means = np.array([each.mean() for each in thirds])
    scatter = max(float(np.std(each)) / math.sqrt(len(each)) for each in thirds[1:])
    steps = np.diff(np.concatenate(thirds[1:]))
    if (
        np.count_nonzero(steps[1:] * steps[:-1] < 0) < TURNS
    ):  # a curve, which scatters about nothing, and may have turned from what it will not come to
        steps = np.diff(thirds[2])
        one_way = bool((steps >= 0).all() or (steps <= 0).all())
        before, after = (abs(each.mean()) for each in np.array_split(steps, 2))  # windows begin anywhere in a swing
        if not one_way or after > 0.9 * before:
            return False
    first, last = abs(means[1] - means[0]), abs(means[2] - means[1])
    return bool(last < 0.02 * margin and (last <= 2.0 * scatter or last < 0.5 * first))
