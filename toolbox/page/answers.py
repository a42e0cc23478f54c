"""What the page shows of one run: traces thinned for a screen, phase plane, spectrum, verdict with its reason, and what follows when nobody turns a number."""

from __future__ import annotations

import base64
import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray
from toolbox.errors import SceneError, SimulationError
from toolbox.files.unit_systems import reading_of
from toolbox.measuring.judge import Judged
from toolbox.measuring.measure import extent
from toolbox.measuring.metrics import distance
from toolbox.measuring.sticks import stick_intervals
from toolbox.measuring.verdict import Verdict, growth_in_words
from toolbox.messages import at_every_step
from toolbox.modelling.closed_loop import ClosedLoop, why_without_effect
from toolbox.modelling.inputs import Table
from toolbox.onsets.verdicts import verdict_metrics, words_of
from toolbox.scenes.judged import sticks_before_standstill
from toolbox.simulation.trajectory import Trajectory
from toolbox.steady_states.linear import equilibrium, linearise

POINTS = 900
"""Points of a trace."""

MANY = 20_000
"""Steps above which a trace shows the smallest and the largest value in each of many columns."""

FREQUENCIES = 2048
"""Samples of a spectrum."""

ROUNDS = 4
"""How often a tone must come within what is listened to: slower is how the run goes on, not its sound."""

LOOKING_ON = Verdict("not decided yet")
"""The verdict while the judge still follows the run."""


class Later(Exception):
    """The work takes too long for an answer now."""


def packed(values: FloatArray) -> str:
    """A row of numbers for the page: single precision in base64."""
    return base64.b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode()


def shown_signals(run: Trajectory, loop: ClosedLoop) -> list[str]:
    """Return the names of the signals of the traces: the judged signal and its effort first, then the main signals of the run."""
    return [name for name in dict.fromkeys([loop.signal, *run.main_signals, loop.effort]) if name is not None and name in run]


def answer(
    run: Trajectory,
    loop: ClosedLoop,
    names: Sequence[str],
    plane: Sequence[str],
    display_units: Mapping[str, str],
    step: Callable[[], None],
) -> dict[str, Any]:
    """What is shown at once.

    names: signals of the traces;  plane: the two of the phase plane;  asked: {unit: unit in which it is read};  step: called at every step of the judge; where
    it raises `Later`, the verdict follows.
    """
    found = verdict_metrics(loop, run)
    judged: Judged | None = None
    try:
        with at_every_step(step):
            words, judged = words_of(loop, run, found)
    except Later:
        words = LOOKING_ON
    after = loop.after or 0.0
    sticks = [] if loop.element is None or loop.element not in run.modes else stick_intervals(run, loop.element, run.begin)
    time, rows = traces(run, names, run.begin, run.end)
    late, both = _late(run, after, judged)
    at = run.at(late)
    seen = {name: max(float(np.nanmax(np.abs(row))), 1e-300) for name, row in rows.items()}
    read = {name: reading_of(run.unit(name), size, display_units) for name, size in seen.items()}
    corners = [np.asarray(at[name], float) for name in plane]
    corner_units = [
        reading_of(run.unit(name), float(np.abs(values).max()), display_units) for name, values in zip(plane, corners, strict=True)
    ]
    signals = []
    for name, row in rows.items():
        limits = run.signal_limits.get(name, (None, None))
        signals.append({"name": name, "unit": read[name].unit, "base": run.unit(name), "factor": read[name].factor, "values": packed(row * read[name].factor),
                        "limits": [None if end is None else end * read[name].factor for end in limits]})  # fmt: skip
    return {
        "verdict": words, "decided": words is not LOOKING_ON, "tone": words.tone,
        "reason": reason(loop, words, judged, found, run),
        "measures": measures_in_words(loop, found, run, display_units), "time": packed(time), "signals": signals, "end": run.end, "after": after,
        "sticks": [[float(a), float(b)] for a, b in sticks], "element": loop.element,
        "plane": [{"name": name, "unit": each.unit, "values": packed(values * each.factor)}
                  for name, each, values in zip(plane, corner_units, corners, strict=True)],
        "stuck": packed(_inside(late, sticks)), "spectrum": spectrum(run, *_listened(run, loop, after, found), display_units),
        "print": hashlib.sha256(np.ascontiguousarray(run.states).tobytes()).hexdigest()[:16], "milliseconds": 1e3 * run.wall_time,
        "period": both if math.isfinite(both) else None,
    }  # fmt: skip


def traces(run: Trajectory, names: Sequence[str], begin: float, end: float) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return times and signals for a screen: even points and every event, or the extremes per column of the screen for a run of many
    steps."""
    nodes = run.every_step
    first, last = np.searchsorted(nodes.time, [begin, end])
    inside = nodes.time[first:last]
    if inside.size <= MANY:
        events = inside[:-1][np.diff(inside) == 0.0]
        times = np.unique(np.concatenate([np.linspace(begin, end, POINTS), events[:POINTS]]))
        at = run.at(times)
        return times, {name: np.asarray(at[name], float) for name in names}
    edges = np.unique(np.searchsorted(inside, np.linspace(begin, end, POINTS // 2 + 1)[:-1]))
    times = np.repeat(inside[edges], 2)
    times[1::2] += 0.5 * (np.append(times[2::2], end) - times[::2])
    rows = {}
    for name, values in nodes.columns(list(names)).items():
        values = values[first:last]
        rows[name] = np.column_stack([np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)]).ravel()
    return times, rows


def closer(run: Trajectory, names: Sequence[str], window: tuple[float, float], display_units: Mapping[str, str]) -> dict[str, Any]:
    """Return the traces of a window of time, in the units of the whole run. SceneError is raised for an empty window."""
    if not window[0] < window[1]:
        raise SceneError("Argument `begin` must be before `end`, within the run, but it is not.")
    time, rows = traces(run, names, *window)
    whole = traces(run, names, run.begin, run.end)[1]
    factors = {
        name: reading_of(run.unit(name), max(float(np.nanmax(np.abs(row))), 1e-300), display_units).factor for name, row in whole.items()
    }
    return {"time": packed(time), "values": {name: packed(row * factors[name]) for name, row in rows.items()}}


def _late(run: Trajectory, after: float, judged: Judged | None) -> tuple[FloatArray, float]:
    """Times of the last rounds for the phase plane, and the time after which the motion comes back [s], nan where none is known."""
    period = judged.interval if judged is not None else math.nan
    begin = max(after, run.end - 3 * period) if math.isfinite(period) else after
    begin = min(begin, run.end)
    return np.linspace(begin, run.end, POINTS), period


def _inside(times: FloatArray, intervals: Sequence[tuple[float, float]]) -> FloatArray:
    """1 at the times within intervals, else 0."""
    found = np.zeros(times.size)
    for begin, end in intervals:
        found[(times >= begin) & (times <= end)] = 1.0
    return found


def _listened(run: Trajectory, loop: ClosedLoop, after: float, found: Mapping[str, float]) -> tuple[str | None, float, float]:
    """(signal, begin, end) of a spectrum: the judged one after the start-up, and of a stop the slip of its contact until it stands, which is what groans."""
    slip = f"{loop.element}.slip"
    if loop.standstill_speed is None or loop.signal is None or slip not in run:
        return loop.signal, after, run.end
    return slip, after, min(found.get("settling", run.end), run.end)


def spectrum(run: Trajectory, signal: str | None, begin: float, end: float, display_units: Mapping[str, str]) -> dict[str, Any] | None:
    """Amplitude of a signal over frequency between two times, its straight line taken off, as far as it is not nothing."""
    if signal is None or not end > begin:
        return None
    times = np.linspace(begin, end, FREQUENCIES, endpoint=False)
    values = np.asarray(run.at(times)[signal], float)
    values = values - np.polynomial.Polynomial.fit(times, values, 1)(times)
    window = np.hanning(FREQUENCIES)
    amplitude = 2.0 * np.abs(np.fft.rfft(values * window)) / window.sum()
    frequency = np.fft.rfftfreq(FREQUENCIES, times[1] - times[0])
    loud = np.flatnonzero(amplitude > 0.01 * amplitude.max(initial=0.0))
    last = min(max(40, int(1.3 * loud[-1]) if loud.size else 0), frequency.size)
    read = reading_of(run.unit(signal), float(np.abs(run[signal]).max()), display_units)
    return {
        "when": f"after {begin:g} s" if end == run.end else f"from {begin:g} s until it stands",
        "tone": tone_of(frequency, amplitude),
        "frequency": packed(frequency[1:last]),
        "amplitude": packed(amplitude[1:last] * read.factor),
        "unit": read.unit,
        "signal": signal,
    }


def tone_of(frequency: FloatArray, amplitude: FloatArray) -> float | None:
    """Return the frequency of the highest peak of a spectrum [Hz]. A peak counts only from a least number of periods on; None if there is
    no peak.

    frequency, amplitude: of even steps from zero on, seen through a Hann window.
    """
    inner = amplitude[1:-1]
    peaks = 1 + np.flatnonzero((inner > amplitude[:-2]) & (inner >= amplitude[2:]))
    peaks = peaks[peaks >= ROUNDS]
    if not peaks.size:
        return None
    k = int(peaks[np.argmax(amplitude[peaks])])
    left, here, right = np.log(amplitude[k - 1 : k + 2] + 1e-300)
    return float(
        frequency[k] + 0.5 * (left - right) / (left - 2.0 * here + right) * frequency[1]
    )  # the top of a parabola through three points


# ------------------------------------------------------------------------------------------------------------------------------------ in words
def reason(loop: ClosedLoop, words: str, judged: Judged | None, found: Mapping[str, float], run: Trajectory) -> str:
    """Return the reason of the verdict, in a sentence or two."""
    who, after = f"`{loop.element}`" if loop.element else "The contact", loop.after or 0.0
    sticks: Sequence[tuple[float, float]] = []
    if loop.element is not None and loop.element in run.modes:
        sticks = stick_intervals(run, loop.element, after)
        if loop.standstill_speed is not None and loop.signal is not None:  # afterwards it only rests
            sticks = sticks_before_standstill(run, loop.element, loop.signal, loop.standstill_speed, after, found.get("settling"))
    longest = max((b - a for a, b in sticks), default=0.0)
    seen = (
        f"{who} sticks {len(sticks)} times after {after:g} s, {longest:.3g} s at the longest"
        if sticks
        else f"{who} does not stick after {after:g} s"
    )
    parts = [f"{seen}."]
    if loop.standstill_speed is not None:
        stands = found.get("settling", math.nan)
        return f"{'It never stands.' if stands == math.inf else f'It stands at {stands:.3g} s.'} {parts[0]}"
    if words == LOOKING_ON:
        parts.append("Whether that stays so is being looked at.")
    elif judged is not None:
        if math.isfinite(judged.interval):
            what = "the same stick comes back" if judged.sticks else "the same swing comes back"
            later = "Carried on, " if judged.sticks and not sticks else ""
            parts.append(f"{later}{what if later else what.capitalize()} every {judged.interval:.3g} s.")
        if math.isfinite(judged.rate) and judged.rate != 0.0:
            steady = "dies" if judged.rate < 0 else "grows"
            parts.append(f"A small disturbance of smooth running {steady} (time constant {1 / abs(judged.rate):.3g} s).")
        if words.startswith("stick-slip") and judged.rate < 0:
            parts.append("Smooth running would last, too, if the machine were led to it.")
    elif words != "no modes":
        parts.append("The judge sees no more than this run: it is too short, or its inputs go on changing.")
    return " ".join(parts)


def measures_in_words(loop: ClosedLoop, found: Mapping[str, float], run: Trajectory, display_units: Mapping[str, str]) -> list[list[str]]:
    """Return [name, number with unit] for each metric of the verdict."""
    rows = []
    for name, value in found.items():
        if math.isnan(value):
            continue
        if name == "peak":
            assert loop.effort is not None
            factor, unit = reading_of(run.unit(loop.effort), abs(value), display_units)
            rows.append([f"peak of {loop.effort}", f"{value * factor:.4g} {unit}{_of_limit(run, loop.effort, value)}"])
        elif name in ("stuck", "settling"):
            settles = "settling" if loop.standstill_speed is None else "stands at"
            rows.append([{"stuck": "time stuck", "settling": settles}[name], "never" if value == math.inf else f"{value:.3g} s"])
        elif name == "severity":
            rows.append([name, f"{100 * value:.3g} % of the mean"])
        elif not (name == "overshoot" and found.get("settling") == math.inf):
            rows.append([name, f"{100 * value:.3g} %"])
    rows += _held_within(loop, run, display_units)
    return rows + [
        row for row in (_stop(loop, found, run) if loop.standstill_speed is not None else _swing(loop, run, display_units),) if row
    ]


def _of_limit(run: Trajectory, effort: str, peak: float) -> str:
    """The largest effort in parts of the limit of the drive or the law, as words behind a number; empty where there is none."""
    ends = [abs(end) for end in run.signal_limits.get(effort, ()) if end]
    return f", {100.0 * abs(peak) / max(ends):.3g} % of its limit" if ends else ""


def _held_within(loop: ClosedLoop, run: Trajectory, display_units: Mapping[str, str]) -> list[list[str]]:
    """The peaks of signals other than the effort that have a limit, such as the torque of a motor before its gear."""
    rows = []
    for name, ends in run.signal_limits.items():
        if name == loop.effort or name not in run or not any(ends) or np.ndim(run[name]) != 1:
            continue
        seen = extent(run, name)
        peak = max(abs(seen.minimum), abs(seen.maximum))
        factor, unit = reading_of(run.unit(name), peak, display_units)
        rows.append([f"peak of {name}", f"{peak * factor:.4g} {unit}{_of_limit(run, name, peak)}"])
    return rows


def _stop(loop: ClosedLoop, found: Mapping[str, float], run: Trajectory) -> list[str]:
    """The stopping distance and the mean deceleration of a stop; empty if it never stands, or if the judged signal is no speed."""
    unit, stands = run.unit(loop.signal or ""), found.get("settling", math.inf)
    if unit not in ("rad/s", "m/s") or not math.isfinite(stands):
        return []
    travelled = distance(loop.signal or "", run.begin, stands).read(run)
    turns = f" ({travelled / (2.0 * math.pi):.3g} turns)" if unit == "rad/s" else ""
    slowed = abs(float(run.at(run.begin)[loop.signal or ""])) / (stands - run.begin)
    return ["stopping distance", f"{travelled:.4g} {unit.removesuffix('/s')}{turns}, {slowed:.3g} {unit}2 in the mean"]


def _swing(loop: ClosedLoop, run: Trajectory, display_units: Mapping[str, str]) -> list[str]:
    """From where to where the judged signal goes after the start-up."""
    if loop.signal is None or not run.end > (loop.after or 0.0):
        return []
    seen = extent(run, loop.signal, loop.after or 0.0)
    factor, unit = reading_of(run.unit(loop.signal), max(abs(seen.minimum), abs(seen.maximum)), display_units)
    return [loop.signal, f"{seen.minimum * factor:z.3g} to {seen.maximum * factor:z.3g} {unit}"]


# ------------------------------------------------------------------------------------------------------------------------- what may follow
def further(run: Trajectory, loop: ClosedLoop) -> dict[str, Any]:
    """What follows when nobody turns a number: error of the run, poles of steady running, numbers of the drive, values of all, and those without effect."""
    told: dict[str, Any] = {
        "values": {name: number.value for name, number in loop.variable_numbers().items() if math.isfinite(number.value)}
    }
    told["drive"] = loop.controller_names
    told["without"] = {name: f"No effect: {why_without_effect(loop, taking)}." for name, taking in loop.overriding_inputs.items()}
    try:
        told["inexact"] = run.error_estimate
    except SimulationError as failure:
        told["error_words"] = str(failure)
    told["poles"], told["poles_words"] = [], ""
    if loop.standstill_speed is not None:
        return told | {"poles_words": "What comes to a standstill has no steady running, and so no poles."}
    try:
        steady = loop.replace(inputs={name: at_last(value) for name, value in loop.input_values.items()})
        point = equilibrium(steady.continuous_loop)
        poles = np.asarray(linearise(point.plant, point).poles(), complex)
        told["poles"] = [[float(pole.real), float(pole.imag)] for pole in poles if np.isfinite(pole)]
        worst = max((pole.real for pole in poles if abs(pole) > 1e-9), default=math.nan)
        told["poles_words"] = (
            f"Steady running is {'stable' if worst < 0 else 'unstable'}: its slowest motion {growth_in_words(worst)}.{_swings(poles)}"
        )
        if loop.is_sampled:
            told["poles_words"] += " Of the continuous form of the law; the verdict counts its samples."
    except (SceneError, SimulationError) as refusal:
        told["poles_words"] = f"No poles: {refusal}"
    return told


def _swings(poles: np.ndarray) -> str:
    """The natural frequencies and damping ratios of the slowest swings among poles, as a sentence behind another; empty where nothing swings."""
    swings = sorted((pole for pole in poles if np.isfinite(pole) and pole.imag > 1e-9), key=abs)[:3]
    told = [
        f"{abs(pole) / (2.0 * math.pi):.3g} Hz ({abs(pole):.3g} rad/s), damping {-100.0 * pole.real / abs(pole):.2g} %" for pole in swings
    ]
    return f" It swings at {'; '.join(told)}." if told else ""


def at_last(value: Any) -> Any:
    """Return the last value of a table; any other input is returned unchanged."""
    return float(value.values[-1]) if isinstance(value, Table) else value


def plane_of(run: Trajectory, loop: ClosedLoop) -> tuple[str, str]:
    """The two signals of the phase plane: a twist or a position, else the effort, and a speed."""
    judged = loop.signal or run.main_signals[0]
    moving = [name for name in dict.fromkeys([*run.main_signals, *run.names]) if np.ndim(run[name]) == 1 and np.ptp(run[name]) > 0]
    part = judged.partition(".")[0]
    if run.unit(judged) in ("m", "rad"):
        return judged, next((name for name in moving if run.unit(name) == f"{run.unit(judged)}/s" and name != judged), judged)
    wanted = (f"{part}.position", "twist", "twist.0", "position")
    found = (name for tail in wanted for name in moving if name == tail or name.endswith(f".{tail}"))
    others = (name for name in (loop.effort, f"{loop.element}.force", *moving) if name in moving and name != judged)
    return next(found, None) or next(others, None) or judged, judged
