"""Identification: the friction of an axis, a joint or a valve from recordings of its motion, with what they tell and what they do not.

    m v' = F - F_0 - R(v)

Several recordings are fitted together by `fit`: coast-downs, steps, sines, steady speeds. Each stretch without a gap is a run of its own, which begins where
the samples say. The search begins at the numbers of a regression of the force over speed and acceleration, so that nobody has to guess. Friction is the
simplest law that the data do not contradict: one level and viscous friction; then with a static friction above it; then with a Stribeck curve. The next one
counts where it is better by odds of 150 to 1 and more.
A table without times holds steady points: the force is then the friction itself, and needs no simulation.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np

from toolbox.calibration.beginnings import body_of, is_hardly_told, levels_of
from toolbox.calibration.channels import TIMES, heading_for, source_of
from toolbox.calibration.force_noise import force_noise
from toolbox.calibration.holds import EVIDENCE, fitted_evidence
from toolbox.calibration.identified import Identification, drag_unit, fitted_part, friction_over_speed, with_derived
from toolbox.calibration.motion import Curve, Guess, Run, first_guess, friction_points, is_one_speed, runs_of, stribeck_guess, together
from toolbox.calibration.recording import Recording, read_channels
from toolbox.calibration.results import Fit
from toolbox.calibration.told_fit import EXPERIMENTS, hardly_told, holds_nothing, told_fit
from toolbox.calibration.windows import MeasuredContact, Search, Window, own_name
from toolbox.errors import SceneError, SimulationError, joined
from toolbox.logs.grids import Column
from toolbox.messages import LOG, progress_bar
from toolbox.modelling.components import Component
from toolbox.modelling.composition import compose
from toolbox.modelling.laws import names as names_of
from toolbox.scenes.catalogue import part as offered
from toolbox.vocabulary import new_names_only

EVERY_KIND = ("clipped", "drop-out", "reversed", "outlier")
"""Flaws of samples over time, which steady points have not."""

STRIBECK = "a Stribeck curve"
"""Name of the richest law."""

CLEAR = 10.0
"""Difference of the log-likelihoods of regressions from which on a Stribeck curve is fitted first."""

SLOW = 3.0
"""Time [s] after which an identification says what it fits."""


@new_names_only
def identify(
    data: Any,
    plant: Any = "Axis",
    *,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    fixed: str | Sequence[str] = (),
    delayed_signals: str | Sequence[str] = (),
    friction: Any = None,
    directions: bool = False,
    zero_order_hold: str | Sequence[str] | None = None,
    accepted_flaws: Sequence[str] = (),
    confidence: float = 0.95,
) -> Identification:
    """Identify friction and mass of an axis or a joint from recordings, with confidence intervals and the friction curve.

    Parameters
    ----------
    data
        One or several recordings. Each is the path of a log file, a mapping {column: samples}, or a pandas table.
        Several recordings are fitted together. A table without times is read as steady points of speed and force.
    plant
        "Axis" (default; m and N) or "Joint" (rad and N m). Or an `Axis` or `Joint` of `models` with your own numbers,
        at which the search begins.
    columns
        {signal: column} for all recordings, such as {"time": "t", "axis.position": "pos [mm]", "axis.force": "F [N]"}.
        If recordings have different headings, give several headings of a signal, such as {"axis.force": ("F [N]",
        "Kraft [N]")}. From each recording the column with the first heading that exists is read. A signal without a
        column is left out, and a force without a column is 0. By default columns have the names of signals.
    fixed
        Names of numbers of the part that are not estimated, but keep their value in `plant`, such as "axis.mass". By
        default none.
    delayed_signals
        Signals with a time shift that is estimated, such as "axis.force", by default none. The estimate is the time by
        which the signal was recorded too late.
    friction
        Friction law. By default the simplest law that the data do not contradict.
    directions
        Whether friction is estimated separately for both directions, by default False. If True, a constant force is not
        estimated: it cannot be distinguished from different friction in both directions.
    zero_order_hold
        Names of inputs that keep the value of a sample until the next sample (zero-order hold); () for none. All other
        inputs are interpolated linearly. By default the data decide: an input is held if the outputs support this with
        odds of at least 150 to 1.
    accepted_flaws
        Kinds of data flaws that are treated as valid data, such as "clipped" for a drive at its limit. By default none:
        every flaw is an error, whose message names the kind.
    confidence
        Confidence level of the intervals, by default 0.95.

    Returns
    -------
    Identification
        Numbers with confidence intervals, residuals, the friction curve, and an explanation for each number that the
        data do not determine.

    Raises
    ------
    SceneError
        If a recording cannot be read, or contains neither speed nor position.
    SimulationError
        If the motion cannot be simulated.

    Examples
    --------
    >>> import numpy as np
    >>> from toolbox import identify
    >>> speed = np.linspace(0.05, 0.6, 12)
    >>> found = identify({"axis.speed": speed, "axis.force": 5.0 + 35.0 * speed}, fixed="axis.force_offset")
    >>> print(round(found["rail.friction.viscous"], 3))
    35.0
    """
    part = offered(plant)() if isinstance(plant, str) else plant
    if not (isinstance(part, Component) and hasattr(part, "friction") and hasattr(part, "signal_prefix")):
        raise SceneError(f'Argument `plant` must be "Axis", "Joint" or such a part, but it is {plant!r}: for any other plant use `fit`.')
    given = list(data) if isinstance(data, (list, tuple)) else [data]
    chosen = dict(columns or {})
    changes: dict[str, Any] = {
        name: f"{part.signal_prefix}.{signal}" in chosen for name, signal in (("has_speed_filter", "filtered_speed"), ("has_load", "load"))
    }
    part = dataclasses.replace(part, **{name: there for name, there in changes.items() if there})
    system = compose(part)
    read = [_read(each, system, part, columns, accepted_flaws) for each in given]
    steady = [recording for recording, is_steady in read if is_steady]
    moving = [recording if zero_order_hold is None else recording.holding([name for name in names_of(zero_order_hold) if name in recording.signals])
              for recording, is_steady in read if not is_steady]  # fmt: skip
    if steady and moving:
        raise SceneError(
            "Argument `data` must hold steady points or recordings over time, but it holds both: identify one after the other."
        )
    work = _Steady(part, steady) if steady else _Moving(part, moving, zero_order_hold, delayed_signals)
    found = work.simplest(friction, directions, names_of(fixed), confidence)
    units = {key: unit for recording, _ in read for key, unit in recording.display_units.items() if key != "s"}
    return dataclasses.replace(
        found,
        display_units=with_derived({**found.display_units, **units}, *found.curve_units),
        recordings=tuple(_described(recording, part) for recording, _ in read),
        runs=tuple(run.recording.source for run in work.runs) if isinstance(work, _Moving) else (),
    )


def _described(recording: Recording, part: Any) -> str:
    """The description of a recording, with a sentence if no force was measured."""
    force, steady = (f"{part.signal_prefix}.{name}" for name in (part.force_name, "resistance"))
    without = f"\n  it has no `{force}`, which counts as 0 in it"
    return f"{recording}{'' if force in recording.signals or steady in recording.signals else without}"


def _read(
    data: Any, system: Any, part: Any, columns: Mapping[str, str | Sequence[str]] | None, keep: Sequence[str]
) -> tuple[Recording, bool]:
    """(recording, whether it holds steady points). Of the columns that are named those count that the recording has."""
    if isinstance(data, Recording):
        return data, False
    typed = {signal: names_of(labels) for signal, labels in (columns or {}).items()}
    source, where, name = source_of(data, system, {signal: labels[0] for signal, labels in typed.items()} or None, None)
    headings = [column.name for column in source.columns]
    heads = {" ".join(each.split()).casefold() for each in headings}
    labels = [label for own in typed.values() for label in own]
    found = {signal: [label for label in own if heading_for(label, headings, labels) is not None] for signal, own in typed.items()}
    there = {signal: own[0] for signal, own in found.items() if own}
    if typed and not there:
        raise SceneError(f"{where} must have a column that `columns` names, but it has {joined(headings)}.")
    timed = "time" in there or source.index is not None or any(each in heads for each in TIMES)
    if timed:
        return read_channels((source, where, name), system, there or None if columns else None, (), keep), False
    force, resistance = f"{part.signal_prefix}.{part.force_name}", f"{part.signal_prefix}.resistance"
    label = there.pop(force, None)
    there |= {} if label is None else {resistance: label}
    for k, column in enumerate(source.columns):
        if not columns and column.name == force:
            source.columns[k] = dataclasses.replace(column, name=resistance)
    size = int(np.size(source.columns[0].cells))
    source.columns.append(Column("time", "s", list(range(size))))
    return read_channels((source, where, name), system, {**there, "time": "time"} if columns else None, (), EVERY_KIND), True


class _Work:
    """Fits of one part to what was read, law by law."""

    def __init__(self, part: Any):
        self.part = part
        self.body_lost = False  # whether a fit showed that the data do not tell the mass
        self.retries = True  # whether more searches follow one that lost its way; none where a richer law is found already

    def fitted(self, part: Any, fixed: Sequence[str], confidence: float, untold: dict[str, str], near: Fit | None, search: Search) -> Fit:
        """The fit of a part with all numbers free that are not fixed; `untold` gets a sentence for each that the data do not tell.

        near: the fit of a simpler law, which tells where runs begin and which inputs are held.
        """
        raise NotImplementedError

    @property
    def samples(self) -> int:
        """Number of samples."""
        raise NotImplementedError

    def both_ways(self) -> bool:
        """Whether there is motion in both directions."""
        raise NotImplementedError

    def untold_body(self, about: Guess) -> str:
        """Why the data do not tell the mass, and which experiment would."""
        raise NotImplementedError

    def points(self, found: Fit) -> np.ndarray:
        """Friction in the data."""
        raise NotImplementedError

    def force_noise(self, found: Fit) -> list[str]:
        """Return what a report says of the noise of the force."""
        return []

    def guess(self, free: bool, offset: bool, directions: bool) -> Guess:
        """Return numbers at which a search begins: whether the mass, a constant force, and friction each way are looked for."""
        raise NotImplementedError

    def curve(self, about: Guess, free: bool, offset: bool, directions: bool) -> Curve | None:
        """Return numbers at which the search of a Stribeck curve begins; None if the fit of a simpler law is as good a begin."""
        return None

    def evidence(self, simple: Fit, rich: Fit) -> float:
        """By how much the log-likelihood of the richer law is greater."""
        return fitted_evidence(simple, rich.misfit, rich.values)

    def _is_better(self, simple: Fit, rich: Fit) -> bool:
        """Whether the data need the richer law."""
        return self.evidence(simple, rich) > EVIDENCE + (rich.values.size - simple.values.size)

    def simplest(self, friction: Any, directions: bool, fixed: Sequence[str], confidence: float) -> Identification:
        """The simplest law that the data do not contradict, with its curve."""
        part, untold, given = self.part, dict[str, str](), fixed
        body, constant = (f"{part.signal_prefix}.{name}" for name in (part.body_field, part.offset_field))
        about = self.guess(body not in fixed, constant not in fixed and self.both_ways() and not directions, directions)
        start = {part.body_field: about.mass} if body not in fixed else {}
        if not about.told and body not in fixed:
            fixed, untold[body] = [*fixed, body], self.untold_body(about)
        if constant not in fixed:
            start[part.offset_field] = 0.0 if directions or not self.both_ways() else about.offset
        if directions or not self.both_ways():
            fixed = [*fixed, constant]
            untold[constant] = (
                "a constant force beside friction cannot be told from friction that differs by direction; it is part of that here" if self.both_ways()
                else f"it cannot be told from friction in motion one way; it is part of that here. To tell it, {EXPERIMENTS[part.offset_field]}."
            )  # fmt: skip
        part = dataclasses.replace(part, **start)
        viscous, one, coulomb, stribeck, two = (
            offered(name) for name in ("Viscous", "Hyperbolic", "Coulomb", "GaussianStribeck", "TwoWay")
        )

        curve = (
            None
            if friction is not None or about.one_speed
            else self.curve(about, body not in fixed, bool(start.get(part.offset_field)), directions)
        )

        def each_way(sides: Sequence[Any]) -> Any:
            """The law of these sides."""
            return two(sides[0], sides[-1]) if directions else sides[0]

        def near(dry: Callable[[float], Any]) -> Callable[[Fit | None], list[Any]]:
            """Parts with this dry friction at which a search begins: at the fit of the simpler law."""
            return lambda simple: [
                dataclasses.replace(
                    part,
                    friction=each_way([viscous(dry(level), slope) for level, slope in levels_of(simple, about)]),
                    **body_of(part, simple),
                )
            ]

        def curved(simple: Fit | None) -> list[Any]:
            """Parts with a Stribeck curve, of which the second counts where the first does not lead to a better law."""
            if curve is None:
                return [*old(simple)]
            fields = {
                name: value
                for name, value in ((part.body_field, curve.about.mass), (part.offset_field, curve.about.offset))
                if name in start
            }
            sides = [viscous(stribeck(static, kinetic, curve.about.speed), slope) for static, kinetic, slope in curve.sides]
            return [dataclasses.replace(part, friction=each_way(sides), **fields), *old(simple)]

        old = near(lambda level: stribeck(1.6 * level, level, about.speed))
        laws: dict[str, Callable[[Fit | None], list[Any]]] = {
            "dry and viscous friction": near(lambda level: one(level, 0.0))
            if friction is None
            else lambda _: [dataclasses.replace(part, friction=friction)],
            "static friction above kinetic friction": near(lambda level: coulomb(1.05 * level, level)),
            STRIBECK: curved,
        }
        if about.one_speed or friction is not None:
            laws = dict(list(laws.items())[:1])
        if about.one_speed and friction is None:
            alike = [
                name
                for (begin,) in [laws["dry and viscous friction"](None)]
                for name in compose(begin).parameters
                if name.endswith(".viscous")
            ]
            fixed = [*fixed, *alike]
            untold |= dict.fromkeys(
                alike, f"all motion is at one speed, so all friction is dry here. To tell it, {EXPERIMENTS['viscous']}."
            )
        rich = None
        if curve is not None and curve.gain > CLEAR:
            with contextlib.suppress(SceneError, SimulationError):
                rich = self._searched({STRIBECK: lambda simple: curved(simple)[:1]}, body, fixed, confidence)
        if rich is None:
            found = self._searched(laws, body, fixed, confidence)
        elif self.body_lost or not is_hardly_told(rich[0]):
            found = rich
        else:
            self.retries = False
            found = self._searched({name: law for name, law in laws.items() if name != STRIBECK}, body, fixed, confidence)
            self.retries = True
            levels, self.body_lost = old(found[0]), self.body_lost and not self._is_better(found[0], rich[0])
            if not (self.body_lost or found[0].white):  # another begin, which may lead to a better Stribeck curve
                best = rich if self._is_better(found[0], rich[0]) else found
                found = self._searched({STRIBECK: lambda _: levels}, body, fixed, confidence, best)
        if self.body_lost and body not in fixed:
            return self.simplest(friction, directions, given, confidence)
        return self._result(found[0], {**untold, **found[1]})

    def _searched(
        self,
        laws: Mapping[str, Callable[[Fit | None], list[Any]]],
        body: str,
        fixed: Sequence[str],
        confidence: float,
        simplest: tuple[Fit | None, dict[str, str]] = (None, {}),
    ) -> tuple[Fit, dict[str, str]]:
        """The fit of the first law that a richer one is not clearly better than, and why numbers are not told.

        laws: {name: parts at which a search begins};  simplest: the fit of a simpler law, and why numbers are not told there.
        """
        (best, untold), began = simplest, perf_counter()
        with progress_bar(len(laws), "identify", unit="law") as bar:
            for name, beginnings in laws.items():
                bar.set_postfix_str(name)
                if (seconds := perf_counter() - began) > SLOW:
                    LOG.info("identify: %d samples, after %.0f s: %s is fitted ...", self.samples, seconds, name)
                simple = best
                search = Search(1, growing=best is None and len(laws) + (name != STRIBECK) > 1, fits_held=name == [*laws][-1])
                for begin in beginnings(simple):
                    own = dict[str, str]()
                    try:
                        found = self.fitted(begin, fixed, confidence, own, simple, search)
                    except (SceneError, SimulationError):
                        if best is None:
                            raise
                        continue
                    if body in found.names and holds_nothing(found, body):
                        self.body_lost = True
                        return found, own
                    if best is None or self._is_better(best, found):
                        best, untold = found, own
                        break
                if best is not None and best.white:
                    break  # nothing is left that a richer law could explain
                bar.update()
        assert best is not None
        return best, untold

    def _result(self, found: Fit, untold: dict[str, str]) -> Identification:
        """The fit with its curve and with the numbers that it hardly tells."""
        for name, value, error in zip(found.names, found.values, found.standard_errors, strict=True):
            word = name.rpartition(".")[2]
            if (
                name in found.parameters
                and word not in ("force_offset", "torque_offset", "load_sensitivity")
                and np.isfinite(error)
                and found.interval_factor * error > abs(value)
            ):
                untold.setdefault(name, f"its interval holds 0. To tell it, {EXPERIMENTS[word]}.")
        for name in found.parameters:
            if name.endswith(".static") and f"{name.removesuffix('static')}kinetic" not in found.misfit.loop.plant.parameters:
                untold[name] = (
                    f"it stands for static and kinetic friction, which the data do not tell apart. To tell them, {EXPERIMENTS['static']}."
                )
        if found.indistinguishable_friction:
            untold[f"{found.indistinguishable_friction}static"] = (
                f"it is not told from the kinetic friction. To tell it, {EXPERIMENTS['static']}."
            )
        untold |= hardly_told(found, f"{self.part.signal_prefix}.{self.part.body_field}") | untold
        own = {each.name: getattr(found, each.name) for each in dataclasses.fields(Fit)}
        points = self.points(found)
        own["units"] = tuple(self._unit(name, unit) for name, unit in zip(found.names, found.units, strict=True))
        curve = friction_over_speed(found, points)
        return Identification(
            **own, untold=untold, points=points, curve=curve, curve_units=self.part.units, force_noise=tuple(self.force_noise(found))
        )

    def _unit(self, name: str, unit: str) -> str:
        """The unit of a number of the part: its friction law is a force, and no coefficient of a load."""
        speed, force = self.part.units
        if not name.startswith(f"{self.part.contact_name}.friction."):
            return unit
        return {"1": force, "s/m": drag_unit(force, speed), "s/rad": drag_unit(force, speed)}.get(unit, unit)

    def _asked(self, part: Any, fixed: Sequence[str]) -> list[str]:
        """Numbers of a part that are free."""
        idle = {
            f"{part.signal_prefix}.{name}"
            for name, used in (("load_sensitivity", part.has_load), ("filter_time", part.has_speed_filter))
            if not used
        }
        system = compose(part)
        idle |= {name for name in system.parameters if name.endswith(".decay") and not float(system.values[system.parameters[name].offset])}
        return [name for name in system.parameters if name not in idle | {*fixed} and name not in system.inputs]


class _Steady(_Work):
    """Steady points: friction itself, without simulation."""

    def __init__(self, part: Any, recordings: Sequence[Recording]):
        super().__init__(part)
        prefix = part.signal_prefix
        for recording in recordings:
            for name in (f"{prefix}.speed", f"{prefix}.resistance"):
                if name not in recording.signals:
                    raise SceneError(
                        f"Steady points must hold speed and force, but `{name}` is missing: they hold {', '.join(recording.signals)}."
                    )
        self.data = {
            name: np.concatenate([each.signals[name] for each in recordings]) for name in (f"{prefix}.speed", f"{prefix}.resistance")
        }
        self.speed, self.force = self.data.values()

    @property
    def samples(self) -> int:
        return int(self.speed.size)

    def both_ways(self) -> bool:
        return bool((self.speed > 0).any() and (self.speed < 0).any())

    def guess(self, free: bool, offset: bool, directions: bool) -> Guess:
        side = np.sign(self.speed)
        basis = np.stack([side, (not is_one_speed(self.speed)) * self.speed, *([np.ones(side.size)] if self.both_ways() else [])], axis=1)
        level, slope, *constant = np.linalg.lstsq(basis, self.force, rcond=None)[0].tolist()
        size = float(np.abs(self.force).max())
        slow = float(np.quantile(np.abs(self.speed), 0.2))
        one_speed = is_one_speed(self.speed)
        viscous = 0.0 if one_speed else max(slope, 0.01 * size / float(np.abs(self.speed).max()))
        body = getattr(self.part, self.part.body_field)
        return Guess(body, max(level, 0.1 * size), viscous, constant[0] if constant else 0.0, slow, told=False, one_speed=one_speed)

    def untold_body(self, about: Guess) -> str:
        return f"steady speeds do not depend on it. To tell it, {EXPERIMENTS[self.part.body_field]}."

    def evidence(self, simple: Fit, rich: Fit) -> float:
        """By how much the log-likelihood of the richer law is greater: each point is a measurement of its own, so neighbours count in full."""
        least = 1e-9 * float(np.abs(self.force).max())
        powers = [max(each.residuals[0].rms, least) for each in (simple, rich)]
        return self.force.size * math.log(powers[0] / powers[1])

    def fitted(self, part: Any, fixed: Sequence[str], confidence: float, untold: dict[str, str], near: Fit | None, search: Search) -> Fit:
        free = [name for name in self._asked(part, fixed) if name != f"{part.signal_prefix}.{part.body_field}"]
        data = {"time": np.arange(self.speed.size, dtype=float), **self.data}
        recording = Recording.of(data, compose(part), accepted_flaws=EVERY_KIND)
        still = 0.5 * float(np.abs(self.speed[self.speed != 0.0]).min())
        return told_fit(
            part,
            recording,
            free,
            untold,
            lambda _: False,
            contact=MeasuredContact(part.contact_name, standstill_speed=still),
            starts=Search(8),
            confidence=confidence,
        )

    def points(self, found: Fit) -> np.ndarray:
        fitted = fitted_part(found)
        return np.stack([self.speed, self.force - float(getattr(fitted, fitted.offset_field))])


class _Moving(_Work):
    """Recordings over time, by simulation."""

    def __init__(self, part: Any, recordings: Sequence[Recording], held: Any, shifts: str | Sequence[str]):
        super().__init__(part)
        self.held, self.shifts = held, [f"{name}.shift" for name in names_of(shifts)]
        self.runs: list[Run] = [run for recording in recordings for run in runs_of(recording, part)]
        self.recording, self.begins = together(self.runs, part)

    @property
    def samples(self) -> int:
        return int(self.recording.time.size)

    def both_ways(self) -> bool:
        top = max(float(np.abs(run.speed).max()) for run in self.runs)
        return any((run.speed > 0.1 * top).any() for run in self.runs) and any((run.speed < -0.1 * top).any() for run in self.runs)

    def guess(self, free: bool, offset: bool, directions: bool) -> Guess:
        body = getattr(self.part, self.part.body_field)
        return first_guess(self.runs, body, free=free, seen=not self.body_lost, offset=offset, directions=directions)

    def curve(self, about: Guess, free: bool, offset: bool, directions: bool) -> Curve | None:
        return stribeck_guess(self.runs, about, free=free, offset=offset, directions=directions)

    def untold_body(self, about: Guess) -> str:
        part = self.part
        unit = next(each.metadata["unit"] for each in dataclasses.fields(part) if each.name == part.body_field)
        at = f"so it stays at {about.mass:.4g} {unit}, and all friction is in proportion to it."
        if any(run.force.any() for run in self.runs):
            most = f" (it is at most {about.most:.4g} {unit}, at which no dry friction is left)" if math.isfinite(about.most) else ""
            at = f"so it stays at {about.mass:.4g} {unit}{most}. The difference of friction from this {part.force_name} is in proportion to it."
            why = f"the {part.force_name} changes no more than friction does while it moves"
        else:
            why = f"no {part.force_name} acts"
        return f"{why}, which tells only friction over {part.body_field}, {at} To tell it, {EXPERIMENTS[part.body_field]}."

    def fitted(self, part: Any, fixed: Sequence[str], confidence: float, untold: dict[str, str], near: Fit | None, search: Search) -> Fit:
        free = self._asked(part, fixed)
        before = {} if near is None else dict(zip(near.names, near.values.tolist(), strict=True))
        windows = [
            Window(
                begin,
                begin + run.span,
                own=list(run.starts),
                start={name: before.get(own_name(name, i), value) for name, value in run.starts.items()},
            )
            for i, (run, begin) in enumerate(zip(self.runs, self.begins, strict=True), 1)
        ]
        held = tuple(near.held) if near is not None and near.held else () if near is not None and near.stepped else self.held
        recording = self.recording.stepping(tuple(near.stepped)) if near is not None and near.stepped else self.recording
        starts = list(dict.fromkeys(name for run in self.runs for name in run.starts))
        found = told_fit(
            part,
            recording,
            [*free, *starts, *self.shifts],
            untold,
            self._rests if self.retries else lambda _: False,
            window=windows,
            starts=search,
            confidence=confidence,
            zero_order_hold=held,
        )
        return (
            found if near is None or not (near.held or near.stepped) else dataclasses.replace(found, held=near.held, stepped=near.stepped)
        )

    def force_noise(self, found: Fit) -> list[str]:
        return force_noise(found, f"{self.part.signal_prefix}.{self.part.force_name}", self.part.units[1])

    def _rests(self, values: Mapping[str, float]) -> bool:
        """Whether no measured force would move the body as it moved, both ways or one: a search finds no slope that leads back from there."""
        offset = values.get(f"{self.part.signal_prefix}.{self.part.offset_field}", 0.0)
        bounds = [value for name, value in values.items() if name.endswith(".static")]
        tops = [float((way * (run.force - offset)).max()) for run in self.runs if run.force.any() for way in run.departures]
        return bool(bounds and tops) and min(bounds) >= min(tops)

    def points(self, found: Fit) -> np.ndarray:
        fitted = fitted_part(found)
        return friction_points(self.runs, float(getattr(fitted, fitted.body_field)), float(getattr(fitted, fitted.offset_field)))
