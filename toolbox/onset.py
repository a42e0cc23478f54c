"""Onset of stick-slip: where smooth running is lost, where stick-slip that has begun ends, and how far a working point is from both.

Two borders belong to every machine that sticks and slips, because it remembers. From smooth running, a small disturbance grows only beyond the Hopf
point. From inside stick-slip, the cycle lives on until it can no longer reach zero slip, and that is often far away: on a two-inertia drill
string under a stiff drive at three times the speed. Between the two, the machine runs smoothly until something disturbs it, and then sticks and slips for
ever. A margin to the Hopf point alone therefore understates the danger, and `onset` never reports one border without the other.

How: at every value of the parameter one run starts from the steady state, disturbed a little along its least damped motion; and in sweeps
up and down each run continues from the end of the run before it while that one still stuck and slipped. Where the verdict changes between
neighbours the border is halved down to the tolerance, then both sides are judged again by a longer and by a more accurate run.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.closed_loop import Sampled
from toolbox.elements import is_finite_number
from toolbox.errors import SceneError, SimulationError, suggest
from toolbox.hybrid import HybridSystem, checked_plant
from toolbox.linear import Equilibrium, function_of, input_values, state_labels
from toolbox.parts import law_of
from toolbox.simulate import Run, again, checked_run
from toolbox.stability import Followed, HopfPoint, Knob, checked_range, continuous_loop, critical_pole, hopf_points, state_values
from toolbox.trajectory import Trajectory

if TYPE_CHECKING:
    from toolbox.scene import Scene

STICKING = ("stick-slip", "stuck")
"""Verdicts from which a machine must be freed."""

PERIODS = 100
"""Periods of the least damped motion that a run lasts; stick phases are counted in the second half."""


@dataclass(frozen=True)
class Judged:
    """What a run came to.

    verdict: "smooth" (the disturbance dies), "swing" (it grows or lasts, without stick), "stick-slip" (stick phases that come back until the end),
    "stuck" (rest for good), "failed", or "none" (there is no steady state to start from);  severity: half-range of the judged
    signal by its mean;  sticks: resolved stick phases in the second half;  longest: the longest of them [s].
    """

    verdict: str
    severity: float = math.nan
    sticks: int = 0
    longest: float = 0.0


@dataclass(frozen=True)
class Border:
    """A border between two verdicts: `value` +- `tolerance`; safe: "above" or "below", the side without stick-slip or with stable running.

    tolerance: one and a half of the last interval, because each step of the parameter shakes the machine by as much again.
    confirmed: whether runs of five times the duration, and runs at a hundredth of the accuracy, gave the same verdicts on both sides.
    """

    value: float
    tolerance: float
    safe: str
    confirmed: bool

    def margin(self, at: float) -> float:
        """Distance of a working point to the border in parts of the border, positive on the safe side."""
        distance = at - self.value if self.safe == "above" else self.value - at
        return distance / abs(self.value) if self.value else math.copysign(math.inf, distance)


@dataclass(frozen=True)
class Onset:
    """Both branches of a machine over one parameter: `print(onset)` for the report, `onset.plot()` for the picture.

    values: of the parameter, shape (n,), in `unit`;  smooth, sticking: verdicts from the disturbed steady state, and from inside stick-slip;  hopf: Hopf
    points of the linear system, exact;  losses: borders of smooth running, by simulation;  ends: borders of existing stick-slip;  at: the
    working point, `at_smooth` and `at_sticking` its verdicts (None outside of the range);  period: of the least damped motion [s];  duration: of a run
    [s];  runs: how many;  notes: what was not done, or not confirmed.
    """

    title: str
    parameter: str
    unit: str
    element: str
    signal: str
    values: np.ndarray
    smooth: tuple[Judged, ...]
    sticking: tuple[Judged, ...]
    hopf: tuple[HopfPoint, ...]
    losses: tuple[Border, ...]
    ends: tuple[Border, ...]
    at: float
    period: float
    duration: float
    accuracy: float
    perturbation: float
    runs: int
    notes: tuple[str, ...] = ()

    @property
    def loss(self) -> float:
        """Border of smooth running, by simulation: that nearest to the working point; nan where there is none in the range."""
        return self._nearest(self.losses)

    @property
    def end(self) -> float:
        """Border of existing stick-slip: that nearest to the working point; nan where there is none in the range."""
        return self._nearest(self.ends)

    def _nearest(self, borders: Sequence[Border]) -> float:
        return min((border.value for border in borders), key=lambda value: abs(value - self.at), default=math.nan)

    @property
    def bistable(self) -> list[tuple[float, float]]:
        """(low, high) of the bands in which smooth running is stable and stick-slip, once begun, stays."""
        edges = sorted({float(self.values[0]), float(self.values[-1]), *(border.value for border in (*self.losses, *self.ends))})
        bands: list[tuple[float, float]] = []
        for low, high in itertools.pairwise(edges):
            inside = [i for i, value in enumerate(self.values) if low < value < high] or [
                int(np.argmin(np.abs(self.values - (low + high) / 2)))
            ]
            middle = inside[len(inside) // 2]
            safe = self._side(self.losses, (low + high) / 2, self.smooth[middle].verdict == "smooth")
            sticks = not self._side(self.ends, (low + high) / 2, self.sticking[middle].verdict not in STICKING)
            if safe and sticks:
                if bands and bands[-1][1] == low:
                    low = bands.pop()[0]
                bands.append((low, high))
        return bands

    @staticmethod
    def _side(borders: Sequence[Border], value: float, otherwise: bool) -> bool:
        """Whether a value is on the safe side of the border nearest to it; `otherwise` where there is none."""
        if not borders:
            return otherwise
        nearest = min(borders, key=lambda border: abs(border.value - value))
        return (value > nearest.value) == (nearest.safe == "above")

    def verdict(self, value: float) -> str:
        """What the machine does at a value of the parameter within the range: "free", "bistable", "swing", "stick-slip" or "stuck".

        By the nearest value that was simulated on the same side of all borders. Raises SceneError outside of the range.
        """
        if not is_finite_number(value) or not self.values[0] <= value <= self.values[-1]:
            raise SceneError(
                f"Argument `value` must be between {self.values[0]:g} and {self.values[-1]:g} {self.unit}, but it is {value!r}."
            )
        cuts = [border.value for border in (*self.losses, *self.ends)]
        apart = [sum(min(v, value) < cut <= max(v, value) for cut in cuts) for v in self.values]
        near = min(range(self.values.size), key=lambda i: (apart[i], abs(self.values[i] - value)))
        smooth = self._side(self.losses, value, self.smooth[near].verdict == "smooth")
        sticks = not self._side(self.ends, value, self.sticking[near].verdict not in STICKING)
        if sticks:
            return "bistable" if smooth else self.sticking[near].verdict if self.sticking[near].verdict in STICKING else "stick-slip"
        return "free" if smooth else self.smooth[near].verdict

    @property
    def advice(self) -> str:
        """The working point in one sentence, with its margins to both borders."""
        shown = f"{self.at:.6g} {self.unit}"
        if not self.values[0] <= self.at <= self.values[-1]:
            return f"The working point {shown} is outside of the range."
        words = {
            "free": "is free: a disturbance dies, and stick-slip that has begun ends.",
            "bistable": "is bistable: smooth until something disturbs it, and stick-slip or standstill that has begun never ends by itself.",
            "stick-slip": "sticks and slips: the least disturbance grows into it.",
            "swing": "swings without stick: the least disturbance grows, and stick-slip that has begun turns into it.",
            "stuck": "comes to rest for good, and does not break away.",
        }
        verdict = self.verdict(self.at)
        margins = []
        for name, borders in (("loss of smooth running", self.losses), ("end of stick-slip", self.ends)):
            if borders:
                border = min(borders, key=lambda border: abs(border.value - self.at))
                margins.append(f"{100 * border.margin(self.at):+.1f} % to the {name}")
        return f"The working point {shown} {words.get(verdict, f'has no steady running ({verdict}).')}" + (
            f" Margin {' and '.join(margins)}." if margins else ""
        )

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        lines = [
            f"Onset of stick-slip: {self.title}",
            f"{self.parameter} from {self.values[0]:g} to {self.values[-1]:g}{unit}, judged by `{self.element}` and `{self.signal}`",
            "",
        ]
        rows = [
            (f"Hopf point, {p.kind} loss", f"{p.value:.6g}", f"period {p.period:.3g} s, stable {p.stable}, residual {p.residual:.0e}")
            for p in self.hopf
        ]
        for name, borders in (("smooth running is lost", self.losses), ("existing stick-slip ends", self.ends)):
            rows += [
                (
                    name,
                    f"{b.value:.6g}",
                    f"+- {b.tolerance:.2g}, safe {b.safe}" + ("" if b.confirmed else ", NOT confirmed by longer and finer runs"),
                )
                for b in borders
            ]
            if not borders:
                rows.append((name, "-", self._nowhere(name)))
        rows += [("bistable", f"{low:.6g} .. {high:.6g}", "smooth only until disturbed") for low, high in self.bistable]
        widths = [max(len(row[i]) for row in rows) for i in (0, 1)]
        lines += [f"  {name:<{widths[0]}}  {value:>{widths[1]}}{unit}  {note}" for name, value, note in rows]
        lines += ["", self.advice, ""]
        head = (f"{self.parameter}", "from smooth running", "severity", "from stick-slip", "severity", "longest stick")
        cells = [head]
        for value, a, b in zip(self.values, self.smooth, self.sticking, strict=True):
            cells.append(
                (f"{value:.5g}", a.verdict, _shown(a.severity), b.verdict, _shown(b.severity), f"{b.longest:.3g} s" if b.longest else "-")
            )
        widths = [max(len(row[i]) for row in cells) for i in range(6)]
        lines += ["  " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
        checked = (
            f"Checked: {self.runs} runs of {self.duration:.4g} s ({PERIODS} periods of {self.period:.3g} s) at accuracy {self.accuracy:g}; smooth running "
            f"disturbed by {self.perturbation:g} of the slip; both sides of each border again with five times the duration and a hundredth of the accuracy."
        )
        return "\n".join([*lines, "", checked, *(f"Note: {note}" for note in self.notes)])

    def _nowhere(self, name: str) -> str:
        branch, calm = (self.smooth, "smooth") if name.startswith("smooth") else (self.sticking, "stick-slip")
        same = {judged.verdict in (STICKING if calm == "stick-slip" else (calm,)) for judged in branch}
        everywhere = same == {True}
        if calm == "smooth":
            return (
                "nowhere in the range: smooth running is stable in all of it"
                if everywhere
                else "smooth running is stable nowhere in the range"
            )
        return "nowhere in the range: stick-slip lasts in all of it" if everywhere else "no stick-slip was found in the range"

    def plot(self, ax: Any = None) -> Any:
        """Severity over the parameter, both branches and the borders; see `toolbox.diagram.onset_diagram`."""
        from toolbox.diagram import onset_diagram

        return onset_diagram(self, ax=ax)

    def save(self, path: str | Path) -> Path:
        """Write one row per value as csv, whole or not at all: value, verdict, severity and sticks of both branches."""
        import csv
        import io

        from toolbox.files import replaced

        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow([f"{self.parameter} [{self.unit}]", *(f"{branch} {name}" for branch in ("smooth", "sticking") for name in COLUMNS)])
        for value, *branches in zip(self.values, self.smooth, self.sticking, strict=True):
            cells = [getattr(judged, name) for judged in branches for name in COLUMNS]
            table.writerow([float(value), *("" if cell != cell else cell for cell in cells)])
        with replaced(Path(path)) as file:
            file.write(text.getvalue().encode())
        return Path(path)


COLUMNS = ("verdict", "severity", "sticks", "longest")


def _shown(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3g}"


def onset(
    machine: HybridSystem | Scene,
    parameter: str,
    between: tuple[float, float],
    *,
    controller: Any = None,
    sample_time: float | None = None,
    inputs: Mapping[str, float] | None = None,
    parameters: Mapping[str, Any] | None = None,
    mode: Mapping[str, str] | None = None,
    guess: Mapping[str, Any] | None = None,
    element: str | None = None,
    signal: str | None = None,
    values: int = 13,
    tolerance: float | None = None,
    at: float | None = None,
    duration: float | None = None,
    perturbation: float = 1e-3,
    accuracy: float | None = None,
) -> Onset:
    """Where stick-slip begins and where it ends over one parameter or input: both branches, the Hopf points and the margin at a working point.

    machine: a plant, or a scene whose controller is named by `controller` (its first one without).  parameter, between: what is varied and its range
    in SI; any input, any parameter of the plant or the law.  controller, sample_time, parameters: as in `simulate`; a sampled law also needs its
    continuous form, for the steady state.  inputs: numbers.  mode: of the steady state, as in `equilibrium`.  guess: {state: value} near
    the steady state at the working point, where none is found without, as under a drive with limits.  element, signal: the contact and
    the speed to judge; without, those of the scene, or the first contact and its speed.  values: how many values both branches are simulated at.
    tolerance: of the borders; a thousandth of the range without.  at: the working point; the declared value without.  duration: of a run [s];
    without, 100 periods of the least damped motion.  perturbation: of smooth running, in parts of the steady slip.

    A law keeps its design on the declared plant while a parameter of the plant varies. Stick-slip means at least three stick phases longer
    than can be resolved in the second half of a run that keep coming until its end. Raises SceneError for unknown names, a range that is none,
    inputs that vary in time, and laws without a continuous form.
    """
    from toolbox.scene import Scene

    title = ""
    if isinstance(machine, Scene):
        scene = machine
        case = scene.case(controller) if controller is not None else scene.cases[0]
        given = {**scene.inputs, **case.inputs, **(inputs or {})}
        moving = next((name for name, value in given.items() if not is_finite_number(value)), None)
        if moving is not None:
            raise SceneError(f"Argument `{moving}` must be a number for an onset to exist, but the scene varies it in time.")
        inputs, parameters = {name: float(value) for name, value in given.items()}, {**scene.parameters, **(parameters or {})}  # type: ignore[arg-type]
        plant, law, title = scene.plant(), case.controller, case.label
        element, signal = element or scene.element, signal or scene.signal
        accuracy = scene.accuracy if accuracy is None else accuracy
    else:
        plant, law = checked_plant(machine, "machine"), controller
        if law is not None and sample_time is not None:
            law = [
                each if isinstance(each, Sampled) else Sampled(each, sample_time)
                for each in (law if isinstance(law, (list, tuple)) else [law])
            ]
    low, high = checked_range(between)
    if not isinstance(values, int) or values < 3:
        raise SceneError(f"Argument `values` must be an integer >= 3, but it is {values!r}.")
    for word, number in (("tolerance", tolerance), ("duration", duration), ("perturbation", perturbation), ("at", at)):
        if number is None and word != "perturbation":
            continue
        if number is None or not is_finite_number(number) or (word != "at" and number <= 0):
            raise SceneError(f"Argument `{word}` must be {'finite' if word == 'at' else '> 0'}, but it is {number!r}.")
    closed = continuous_loop(plant, law, inputs=inputs, parameters=parameters)
    knob = Knob.of(closed, parameter)
    input_values(closed, inputs or {})
    contact = judged_contact(closed, element)
    speed = signal or judged_speed(closed, contact)
    closed.unit(speed)
    at = knob.declared(closed, inputs or {}) if at is None else float(at)
    grid = np.linspace(low, high, values)
    if low < at < high and not np.isclose(grid, at, rtol=0, atol=1e-9 * (high - low)).any():
        grid = np.sort(np.append(grid, at))
    laws = law if isinstance(law, (list, tuple)) or law is None else [law]
    search = _Search(
        base=checked_run(
            plant, 0.0, inputs={**(inputs or {}), **({parameter: low} if knob.is_input else {})}, parameters=parameters, controller=laws,
            accuracy=1e-6 if accuracy is None else accuracy,
        ),
        knob=knob,
        followed=Followed(closed, knob, inputs or {}, mode, guess),
        element=contact,
        signal=speed,
        perturbation=float(perturbation),
    )  # fmt: skip
    if low <= at <= high:
        search.followed(at)  # first, because a guess is near this one
    steady = [point for point in (search.followed(float(value)) for value in grid) if point is not None]
    if not steady:
        raise SceneError(f"There is no steady running for `{parameter}` from {low:g} to {high:g} {knob.unit}: {search.followed.reason}")
    try:
        hopf = hopf_points(
            closed, parameter, (low, high), inputs=inputs, mode=mode, guess=None if not steady else state_values(closed, steady[-1].states)
        )
    except SceneError as error:
        hopf = []
        search.notes.append(f"no Hopf point: {error}")
    search.period = max(point.period for point in hopf) if hopf else float(np.median([_period(point) for point in steady]))
    search.duration = PERIODS * search.period if duration is None else float(duration)
    tolerance = 1e-3 * (high - low) if tolerance is None else float(tolerance)
    numbers = [float(value) for value in grid]
    smooth = [search.smooth(value) for value in numbers]
    losses = search.borders(numbers, [judged.verdict == "smooth" for judged in smooth], search.is_smooth, tolerance)
    for _ in numbers:
        for value in [v for v, judged in search.found.items() if judged.verdict not in STICKING and search.inside.get(v)]:
            del search.found[value]
        sticking = search.sweep(numbers)
        ends = search.borders(numbers, [judged.verdict not in STICKING for judged in sticking], search.is_free, tolerance)
        if all(judged.verdict in STICKING for value, judged in zip(numbers, sticking, strict=True) if search.inside.get(value)):
            break  # else the search for a border arrived in stick-slip where a larger step of the sweep had lost it
    if laws and any(isinstance(each, Sampled) for each in laws):
        search.notes.append("Hopf points are those of the continuous form of the law; the borders are of the law as it runs, sampled.")
    return Onset(
        title=title or ", ".join(type(law_of(part)).__name__ for part in search.base.system.parts),
        parameter=parameter,
        unit=knob.unit,
        element=contact,
        signal=speed,
        values=np.array(numbers),
        smooth=tuple(smooth),
        sticking=tuple(sticking),
        hopf=tuple(hopf),
        losses=tuple(losses),
        ends=tuple(ends),
        at=at,
        period=search.period,
        duration=search.duration,
        accuracy=search.base.accuracy,
        perturbation=float(perturbation),
        runs=search.runs,
        notes=tuple(search.notes),
    )


# -------------------------------------------------------------------------------------------------------------------------------------- the search
@dataclass
class _End:
    """Where a run ended, for the next one to begin there."""

    start: dict[str, Any]
    resume: tuple[np.ndarray, np.ndarray] | None


@dataclass
class _Search:
    """Runs of one closed loop with one knob, judged and counted."""

    base: Run
    knob: Knob
    followed: Followed
    element: str
    signal: str
    perturbation: float
    period: float = 1.0
    duration: float = 0.0
    runs: int = 0
    notes: list[str] = field(default_factory=list)
    inside: dict[float, dict[str, _End]] = field(default_factory=dict)
    found: dict[float, Judged] = field(default_factory=dict)

    def run(self, value: float, begin: _End, longer: float = 1.0, finer: float = 1.0) -> tuple[Judged, _End | None]:
        """One run at a value of the knob, and where it ended."""
        changes: dict[str, Any] = {"start": begin.start, "resume": begin.resume, "accuracy": self.base.accuracy * finer}
        if self.knob.is_input:
            changes["inputs"] = {**self.base.inputs, self.knob.name: value}
        else:
            changes["system"] = self.base.system.with_parameters({self.knob.name: value})
        duration = longer * self.duration
        self.runs += 1
        for _ in range(3):
            try:
                run = again(self.base, duration=duration, longest_step=duration / 256, **changes)
            except SimulationError:
                return Judged("failed"), None
            judged = self.judged(run, value)
            if judged.verdict != "unclear":
                break
            duration *= 4  # a cycle so slow that too few stick phases fit: look at it for longer
        else:
            judged = dataclasses.replace(judged, verdict="stuck")
        return judged, _End(state_values(run.program.system, run.states[-1]), _held(run))

    def walked(self, begin: _End, origin: float, value: float) -> _End:
        """Where the machine is after the knob went from one value to another in small steps: a jump at once would shake it out of its cycle."""
        if value == origin:
            return begin
        for k in range(1, STEPS):
            middle = origin + (value - origin) * k / STEPS
            changes: dict[str, Any] = {"start": begin.start, "resume": begin.resume}
            if self.knob.is_input:
                changes["inputs"] = {**self.base.inputs, self.knob.name: middle}
            else:
                changes["system"] = self.base.system.with_parameters({self.knob.name: middle})
            try:
                run = again(self.base, duration=2.3 * self.period, longest_step=self.period / 256, **changes)
            except SimulationError:
                return begin
            begin = _End(state_values(run.program.system, run.states[-1]), _held(run))
        return begin

    def judged(self, run: Trajectory, value: float) -> Judged:
        """The verdict on the second half of a run."""
        from toolbox import measure

        half = run.end / 2
        shortest = max(10 * self.base.accuracy, 1e-6) * self.period
        sticks = [(a, b) for a, b in measure.stick_intervals(run, self.element, half) if b - a > shortest]
        longest = max((b - a for a, b in sticks), default=0.0)
        # whole cycles at the end say how large they are
        whole = (sticks[-4][0], sticks[-1][0]) if len(sticks) > 3 else (max(half, run.end - 8 * self.period), None)
        found = measure.extent(run, self.signal, *whole)
        swing = found.maximum - found.minimum
        severity = swing / (2 * abs(found.mean)) if found.mean else math.inf if swing else math.nan
        if sticks:
            gap = max(np.diff([a for a, _ in sticks]), default=math.inf)
            if len(sticks) >= 3 and run.end - sticks[-1][1] <= 2 * gap:
                return Judged("stick-slip", severity, len(sticks), longest)
            if len(sticks) < 3 and (sticks[-1][1] >= run.end or run.end - sticks[-1][1] < sticks[-1][0] - half):
                return Judged("unclear", severity, len(sticks), longest)
        rest = self.followed(value)
        if rest is None:
            return Judged("swing" if swing else "smooth", severity, len(sticks), longest)
        target = float(np.ravel(rest[self.signal])[0])
        early = measure.extent(run, self.signal, 0.0, min(2 * self.period, half))
        first, last = (max(abs(e.maximum - target), abs(e.minimum - target)) for e in (early, found))
        calm = last < first or last <= 10 * self.base.accuracy * max(abs(target), abs(found.maximum), abs(found.minimum))
        return Judged("smooth" if calm else "swing", severity, len(sticks), longest)

    # ------------------------------------------------------------------------------------------------------------------- from smooth running
    def smooth(self, value: float, **changes: float) -> Judged:
        """The verdict from the disturbed steady state; where it ends in stick-slip, its end is kept to continue from."""
        rest = self.followed(value)
        if rest is None:
            return Judged("none")
        judged, end = self.run(value, self.disturbed(rest), **changes)
        if judged.verdict in STICKING and end is not None:
            self.inside.setdefault(value, {}).setdefault(judged.verdict, end)
        return judged

    def is_smooth(self, value: float, origin: float, **changes: float) -> bool:
        """Whether smooth running is stable at a value."""
        return self.smooth(value, **changes).verdict == "smooth"

    def disturbed(self, rest: Equilibrium) -> _End:
        """The steady state moved along its least damped motion, until the slip of the judged contact changes by the perturbation at most."""
        plant = rest.plant
        _, vector = critical_pole(rest)
        index = [element.name for element in plant.elements].index(self.element)
        slope = np.array(function_of(plant, ("slip_slope", self.element), lambda: [_slip_slope(plant, index)])(
            0.0, rest.states, rest.inputs, plant.values, _modes(rest))).ravel()  # fmt: skip
        slip = float(np.array(plant.slips(0.0, rest.states, rest.inputs, plant.values, _modes(rest))).ravel()[index])
        phase = slope @ vector
        if abs(phase) <= 1e-12 * np.linalg.norm(slope) * np.linalg.norm(vector):  # this motion does not move the contact
            motion = np.real(vector)
            x = rest.states + self.perturbation * np.abs(rest.states).max(initial=1.0) * motion / np.abs(motion).max()
        else:
            x = rest.states + self.perturbation * abs(slip or 1.0) * np.real(vector / phase)
        return self.begin(rest, x)

    def begin(self, rest: Equilibrium, x: np.ndarray) -> _End:
        """A state of the continuous loop as the beginning of a run: states of sampled laws become their memory, what they drive is held."""
        system = self.base.system
        named = dict(zip([name for name, _ in state_labels(rest.plant)], x.tolist(), strict=True))
        start = {name: value for name, value in state_values(rest.plant, x).items() if name in system.states}
        if not system.updates:
            return _End(start, None)
        memory, held = [], np.zeros(system.held.numel())
        for update in system.updates:
            symbols = [update.memory[i].name() for i in range(update.memory.numel())]
            unknown = [name for name in symbols if name not in named]
            note = f"the memory {', '.join(unknown)} of a sampled law is no state of its continuous form, and begins at zero"
            if unknown and note not in self.notes:
                self.notes.append(note)
            memory += [*(named.get(name, 0.0) for name in symbols), *[0.0] * len(update.channels)]
            for i, name in enumerate(update.names):
                held[update.first_held + i] = rest[name]
        return _End(start, (np.array(memory, float), held))

    # ---------------------------------------------------------------------------------------------------------------- from inside stick-slip
    def sweep(self, values: Sequence[float]) -> list[Judged]:
        """Verdicts from inside stick-slip: sweeps up and down, each run from the end of the one before while that stuck and slipped."""
        found = self.found
        for row in (values, values[::-1]):
            before: dict[str, _End] = {}
            last = row[0]
            for value in row:
                own = self.inside.setdefault(value, {})
                first = value not in found
                # standstill and stick-slip may both last: each is continued, the others are tried until stick-slip is found
                begins = [self.walked(begin, last, value) for verdict, begin in before.items() if verdict not in own]
                for begin in [*begins, *((*own.values(), *self.stuck(value)) if first else ())]:
                    judged, end = self.run(value, begin)
                    if value not in found or _worse(judged, found[value]):
                        found[value] = judged
                    if judged.verdict in STICKING and end is not None:
                        own[judged.verdict] = end
                    if judged.verdict == "stick-slip" and not any(begin is one for one in begins[:-1]):  # all of the neighbour's are tried
                        break
                found.setdefault(value, Judged("none"))
                before, last = dict(own), value
        return [found[value] for value in values]

    def stuck(self, value: float) -> list[_End]:
        """Beginnings from which stick-slip may start: the steady state with the contact stuck, and the whole machine at rest."""
        rest = self.followed(value)
        begins = []
        if rest is not None:
            plant, m = rest.plant, _modes(rest)
            m[[element.name for element in plant.elements].index(self.element)] = 0.0
            project = function_of(plant, ("project",), lambda: [plant.switching.projected])
            begins.append(self.begin(rest, np.array(project(0.0, rest.states, rest.inputs, plant.values, m)).ravel()))
        return [*begins, _End(dict(self.base.start), None)]

    def is_free(self, value: float, origin: float, **changes: float) -> bool:
        """Whether stick-slip, continued from where it was found, ends at a value."""
        free = True
        for begin in list(self.inside[origin].values()):
            judged, end = self.run(value, self.walked(begin, origin, value), **changes)
            if judged.verdict in STICKING and end is not None:
                self.inside.setdefault(value, {}).setdefault(judged.verdict, end)
                free = False
        return free

    # ---------------------------------------------------------------------------------------------------------------------------------- borders
    def borders(self, values: Sequence[float], safe: Sequence[bool], test: Callable[..., bool], tolerance: float) -> list[Border]:
        """The borders between neighbours of different verdict, halved to the tolerance and judged again by longer and by finer runs."""
        found = []
        for (a, safe_a), (b, safe_b) in itertools.pairwise(zip(values, safe, strict=True)):
            if safe_a == safe_b:
                continue
            good, bad = outer_good, outer_bad = (a, b) if safe_a else (b, a)
            longer, confirmed = 1.0, False
            for attempt in range(ROUNDS):
                while 1.5 * abs(good - bad) > tolerance:
                    middle = (good + bad) / 2
                    if test(middle, bad, longer=longer):
                        good = middle
                    else:
                        bad = middle
                wrong = self.contradicted(good, bad, test)
                confirmed = wrong is None
                if confirmed:
                    break
                if wrong in (outer_good, outer_bad) or attempt == ROUNDS - 1:
                    break
                # the verdict came too early: the search goes on between there and the neighbour, with longer runs
                longer = 5.0
                good, bad = (outer_good, good) if wrong == good else (bad, outer_bad)
            found.append(Border((good + bad) / 2, 1.5 * abs(good - bad), "above" if good > bad else "below", confirmed))
        return found

    @staticmethod
    def contradicted(good: float, bad: float, test: Callable[..., bool]) -> float | None:
        """The side of a border that longer or finer runs judge otherwise; None where both agree."""
        for changes in ({"longer": 5.0}, {"finer": 0.01}):
            if not test(good, bad, **changes):
                return good
            if test(bad, bad, **changes):
                return bad
        return None


STEPS = 12
"""Steps in which the parameter goes from one value to the next, with a little more than two periods at each."""

ROUNDS = 6
"""How often the search for a border is taken up again, with runs five times as long."""


def _worse(judged: Judged, other: Judged) -> bool:
    """Whether a verdict is more of a stick-slip than another."""
    rank = ("none", "failed", "smooth", "swing", "stuck", "stick-slip")
    return rank.index(judged.verdict) > rank.index(other.verdict)


def _held(run: Trajectory) -> tuple[np.ndarray, np.ndarray] | None:
    if not run.program.system.updates or run.memory is None:
        return None
    first = run.program.held_slot - run.program.first_held
    return run.memory, run.held[-1][first : first + run.program.system.held.numel()].copy()


def _modes(rest: Equilibrium) -> np.ndarray:
    codes = [{word: float(code) for code, word in element.legend.items()} for element in rest.plant.elements]
    return np.array([code[rest.modes[element.name]] for code, element in zip(codes, rest.plant.elements, strict=True)])


def _slip_slope(plant: HybridSystem, index: int) -> Any:
    import casadi as ca

    return ca.jacobian(plant.switching.slip[index], plant.x)


def _period(rest: Equilibrium) -> float:
    """Period of the least damped swing of a steady state [s], or the time constant of its slowest motion where nothing swings."""
    from toolbox.stability import flow_slopes

    poles = np.linalg.eigvals(flow_slopes(rest))
    poles = poles[np.abs(poles) > 1e-9 * np.abs(poles).max(initial=0.0)]
    swinging = poles[poles.imag > 1e-6 * np.abs(poles)]
    if swinging.size:
        return float(2 * math.pi / swinging[int(np.argmax(swinging.real))].imag)
    return float(2 * math.pi / np.abs(poles).min(initial=1.0)) if poles.size else 1.0


def judged_contact(closed: HybridSystem, element: str | None) -> str:
    """The contact whose sticking is judged: the one named, else the first. Raises SceneError where there is none."""
    contacts = [each.name for each in closed.elements if each.law is not None]
    if not contacts:
        raise SceneError("The plant must have a contact with dry friction for stick-slip to exist, but it has none.")
    if element is not None and element not in contacts:
        raise SceneError(f"There is no contact `{element}` to be judged: {suggest(element, contacts)}")
    return element or contacts[0]


def judged_speed(closed: HybridSystem, contact: str) -> str:
    """The speed of what rubs where that is its slip, as at a bit; else the slip, whose mean is not zero."""
    import casadi as ca

    speed, slip = f"{contact}.speed", next(each.slip for each in closed.elements if each.name == contact)
    return speed if speed in closed.signals and ca.is_equal(ca.SX(closed.signals[speed][0]), slip, 4) else f"{contact}.slip"


@dataclass(frozen=True)
class Comparison:
    """Onsets of several controllers over one parameter, side by side: `print(comparison)`, `comparison["soft torque"]`."""

    onsets: Mapping[str, Onset]
    failures: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, label: str) -> Onset:
        if label not in self.onsets:
            raise SceneError(f"There is no onset of `{label}`: {suggest(label, self.onsets)}")
        return self.onsets[label]

    @cached_property
    def rows(self) -> list[tuple[str, ...]]:
        """One line per controller as text: name, Hopf point, loss, end, bistable band, verdict at the working point and margin."""
        lines = [("controller", "Hopf point", "smooth lost", "stick-slip ends", "bistable", "at", "there", "margin")]
        for label, found in self.onsets.items():
            inside = found.values[0] <= found.at <= found.values[-1]
            borders = [min(row, key=lambda b: abs(b.value - found.at)).margin(found.at) for row in (found.losses, found.ends) if row]
            lines.append(
                (
                    label,
                    _shown(min((p.value for p in found.hopf), key=lambda v: abs(v - found.at), default=math.nan)),
                    _shown(found.loss),
                    _shown(found.end),
                    ", ".join(f"{low:.3g} .. {high:.3g}" for low, high in found.bistable) or "-",
                    f"{found.at:.4g}",
                    found.verdict(found.at) if inside else "outside",
                    f"{100 * min(borders):+.0f} %" if borders else "-",
                )
            )
        return lines + [(label, "failed", *[""] * 6) for label in self.failures]

    def __str__(self) -> str:
        widths = [max(len(row[i]) for row in self.rows) for i in range(8)]
        lines = [
            "  ".join(cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))).rstrip()
            for row in self.rows
        ]
        lines.insert(1, "-" * max(map(len, lines)))
        return "\n".join([*lines, *(f"{label} failed: {reason}" for label, reason in self.failures.items())])
