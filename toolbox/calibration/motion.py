"""Runs of one body in recordings: its speed and acceleration by smoothing, the numbers at which a search begins, and the friction in the data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from toolbox.calibration.recording import Recording
from toolbox.calibration.trust import scatter
from toolbox.errors import SceneError

SMOOTH = 0.01
"""Part of a run over which a polynomial is laid for the derivative at its middle."""

SLOW = 0.05
"""Part of the largest speed below which friction is not looked at: it may be rest."""

DIGITS = 1e-12
"""Noise of samples, at least, as a fraction of the largest: their last digits."""

STILL = 5.0
"""Speed, in deviations of its noise, up to which a body counts as at rest."""

STEADY = 0.02
"""Deviation of the speed, as a fraction of its mean, below which it is one speed."""

REST = 5
"""Samples at the begin of a run that are equal if it begins at rest."""

BINS = 80
"""Points of friction in a picture, at most."""

SHARE = 1e-6
"""Part of the impulse of a force, at most, that friction cannot explain where the force does not tell the mass."""

CLEAR = 9.0
"""F-value from which on the impulse of the force is seen in the speed: three deviations."""

TRIED = 16
"""Stribeck speeds that are tried."""

SHARP = 5e-4
"""Noise of the speed, as a fraction of the largest speed, that is small."""

NEAR = 0.98
"""Part of its largest value up to which a mass that the data do not tell may be held."""


@dataclass(frozen=True)
class Run:
    """A stretch of a recording without a gap.

    recording: its samples, from time 0;  time, speed, acceleration, force: smoothed motion and measured force, shapes (n,), with force 0 where none was
    measured;  starts: {state: value at the begin};  noise: deviation of the smoothed speed;  values: measured speed or position at these times;  order: of
    the derivative of the values that is the speed.
    """

    recording: Recording
    time: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    force: np.ndarray
    starts: dict[str, float]
    noise: float
    values: np.ndarray
    order: int

    @property
    def span(self) -> float:
        """Duration [s]."""
        return float(self.recording.time[-1])

    @cached_property
    def stretches(self) -> list[slice]:
        """Samples during which the body moves, without pauses, away from the ends of the run."""
        return _stretches(_moving(self))

    @property
    def departures(self) -> set[float]:
        """Directions in which the body leaves rest, or turns round: the force overcomes static friction there."""
        ways = [float(np.sign(self.speed[each].mean())) for each in self.stretches]
        before = [ways[0] if self.stretches[0].start == _edge(self) else 0.0, *ways[:-1]] if ways else []
        return {way for way, last in zip(ways, before, strict=True) if way != last}


@dataclass(frozen=True)
class Guess:
    """Numbers at which a search begins.

    mass, level, viscous, offset: mass or inertia, dry and viscous friction, and constant force;  speed: a Stribeck speed;  told: whether the data tell the
    mass;  most: the largest mass with which friction is not negative, where they do not;  one_speed: whether all motion is at one speed.
    """

    mass: float
    level: float
    viscous: float
    offset: float
    speed: float
    told: bool = True
    most: float = math.inf
    one_speed: bool = False


@dataclass(frozen=True)
class Curve:
    """Numbers at which the search of a Stribeck curve begins.

    about: mass, constant force, and Stribeck speed;  sides: static, kinetic and viscous friction, each way;  gain: by how much the log-likelihood of the
    regression is greater than without the friction that falls with speed.
    """

    about: Guess
    sides: list[tuple[float, float, float]]
    gain: float


def _width(samples: int) -> int:
    """Samples of a run over which a polynomial is laid."""
    return min(max(7, 2 * round(0.5 * SMOOTH * samples) + 1), 2 * ((samples - 1) // 2) + 1)


def _derivative(time: np.ndarray, values: np.ndarray, order: int) -> np.ndarray:
    """Derivative of samples by cubic polynomials around each, at even times."""
    from scipy.signal import savgol_filter  # here, because it is slow to import

    step, width = (time[-1] - time[0]) / (time.size - 1), _width(time.size)
    found: np.ndarray = savgol_filter(values, width, min(3, width - 1), deriv=order, delta=step)
    return found


def _weights(time: np.ndarray, order: int) -> np.ndarray:
    """Weights of the samples in such a derivative."""
    from scipy.signal import savgol_coeffs  # here, because it is slow to import

    step, width = (time[-1] - time[0]) / (time.size - 1), _width(time.size)
    found: np.ndarray = savgol_coeffs(width, min(3, width - 1), deriv=order, delta=step)
    return found


def _noise(values: np.ndarray) -> float:
    """Deviation of the noise of samples, by what two neighbours do not say of a sample, and by their smallest step."""
    changes = np.abs(np.diff(values))
    step = float(changes[changes > 0.0].min(initial=math.inf))
    return max(scatter(values), step / math.sqrt(12.0) if math.isfinite(step) else 0.0, DIGITS * float(np.abs(values).max()))


def runs_of(recording: Recording, part: Any) -> list[Run]:
    """The runs of a recording of a part, parted by the gaps of its force, or of all that was measured where there is none.

    Raises SceneError where neither speed nor position was measured.
    """
    place, speed, force = (f"{part.signal_prefix}.{name}" for name in (part.position_name, "speed", part.force_name))
    filtered = f"{part.signal_prefix}.filtered_speed"
    seen = next((name for name in (place, speed, filtered) if name in recording.signals), None)
    if seen is None:
        raise SceneError(f"The data must hold `{place}` or `{speed}`, but they hold {', '.join(recording.signals)}.")
    driven = force in recording.signals
    found = []
    for begin, end in recording.windows([force] if driven else [seen]):
        own = recording.between(begin, end)
        good = np.isfinite(own.signals[seen]) & (np.isfinite(own.signals[force]) if driven else True)
        time, values = own.time[good], own.signals[seen][good]
        if time.size < 10:
            continue
        even = np.linspace(time[0], time[-1], time.size)
        values = np.interp(even, time, values)
        shift = 1 if seen == place else 0
        rate = _derivative(even, values, 1)
        v, a = (rate, _derivative(even, values, 2)) if shift else (_derivative(even, values, 0), rate)
        starts = {}
        rests = bool(np.ptp(own.signals[seen][good][:REST]) == 0.0) if shift else own.signals[seen][good][0] == 0.0
        if place in own.signals:
            starts[place] = float(np.polynomial.polynomial.polyfit(time[:9] - time[0], own.signals[place][good][:9], 2)[0])
        starts[speed] = 0.0 if rests else float(v[0])
        if part.has_speed_filter:
            starts[filtered] = float(values[0])
        drive = np.interp(even, time, own.signals[force][good]) if driven else np.zeros(even.size)
        noise = _noise(own.signals[seen][good]) * float(np.linalg.norm(_weights(even, shift)))
        found.append(Run(own, even, v, a, drive, starts, noise, values, shift))
    if not found:
        raise SceneError(f"The data of {recording.source} must hold a stretch of ten samples without a gap, but there is none.")
    return found


def together(runs: Sequence[Run], part: Any) -> tuple[Recording, list[float]]:
    """One recording of all runs behind each other, and the time at which each begins; an input that was not measured in some is its default there."""
    inputs = {f"{part.signal_prefix}.{part.force_name}", f"{part.signal_prefix}.load"}
    names = list(dict.fromkeys(name for run in runs for name in run.recording.signals))
    apart = 100.0 * max(run.span for run in runs)
    begins, end = [], 0.0
    for run in runs:
        begins.append(end)
        end += run.span + apart
    signals = {
        name: np.concatenate(
            [run.recording.signals.get(name, np.full(run.recording.time.size, 0.0 if name in inputs else np.nan)) for run in runs]
        )
        for name in names
    }
    first = runs[0].recording
    held = (
        None
        if any(run.recording.held is None for run in runs)
        else tuple(dict.fromkeys(n for run in runs for n in run.recording.held or ()))
    )
    time = np.concatenate([run.recording.time + begin for run, begin in zip(runs, begins, strict=True)])
    sources = ", ".join(dict.fromkeys(run.recording.source for run in runs))
    return Recording(time, signals, sources, first.units, held=held, display_units=first.display_units), begins


def _edge(run: Run) -> int:
    """Samples at each end of a run whose smoothed motion is not looked at."""
    return max(2, round(0.5 * SMOOTH * run.time.size))


def _moving(run: Run) -> np.ndarray:
    """Where a run moves, away from its ends."""
    moves: np.ndarray = np.abs(run.speed) > max(SLOW * float(np.abs(run.speed).max(initial=0.0)), STILL * run.noise)
    moves[: _edge(run)] = moves[-_edge(run) :] = False
    return moves


def first_guess(runs: Sequence[Run], body: float, *, free: bool, seen: bool, offset: bool, directions: bool) -> Guess:
    """Return numbers at which a search begins, by linear regression, and whether the data tell the mass.

        v - v_0 = (I_F - level I_sign - viscous I_v - offset I_1) / m            I: impulses since the begin of each stretch of motion

    The impulse of the force is needed for the mass: where it is a sum of those of friction, as for no force or a constant one, any mass goes with friction in
    proportion. Then the mass is held at `body`, or at half its largest value, if friction would be negative with `body`.

    Parameters
    ----------
    runs
        The runs.
    body
        The mass that the part declares.
    free
        Whether the mass is looked for.
    seen
        Whether the mass may be told; False after a fit that did not tell it.
    offset
        Whether a constant force is looked for.
    directions
        Whether friction is looked for each way by itself.
    """
    speeds, forces, rows, shapes, own = [], [], [], [], 0.0
    top = max(float(np.abs(run.speed).max()) for run in runs)
    for run in runs:
        for part in run.stretches:
            own += (part.stop - part.start) / _width(run.time.size)
            v, side = run.speed[part], np.sign(run.speed[part])
            fall = side * np.exp(-((v / (0.1 * top)) ** 2))
            columns = [side, v, *([np.ones(v.size)] if offset or directions else []), *([np.abs(v)] if directions else []), fall]
            impulses = [_centred(_impulse(run.time[part], each)) for each in (run.force[part], *columns)]
            speeds.append(_centred(v))
            forces.append(impulses[0])
            rows.append(np.stack(impulses[1:-1], axis=1))
            shapes.append(np.stack(impulses[1:], axis=1))
    if not speeds:
        raise SceneError(f"The data of {runs[0].recording.source} must hold motion, but there is none: raise the force until it moves.")
    speed, force, basis, shape = (np.concatenate(each) for each in (speeds, forces, rows, shapes))
    one_speed = is_one_speed(np.concatenate([run.speed[part] for run in runs for part in run.stretches]))
    if one_speed:
        basis[:, 1] = 0.0
    told = free and seen and _seen(speed, force, shape, own)
    if told:
        inverse, *rest = np.linalg.lstsq(np.column_stack([force, -basis]), speed, rcond=None)[0].tolist()
        told = inverse > 0.0
    most, mass = math.inf, body
    if told:
        mass = 1.0 / inverse
        level, slope = mass * rest[0], mass * rest[1]
        constant = mass * rest[2] if offset else 0.0
    else:
        of_force, of_speed = (np.linalg.lstsq(basis, each, rcond=None)[0] for each in (force, speed))
        if of_speed[0] > 0.0 and of_force[0] > 0.0:
            most = float(of_force[0] / of_speed[0])
        if free and mass > NEAR * most:
            mass = 0.5 * most
        level, slope, *constants = (of_force - mass * of_speed).tolist()
        constant = constants[0] if offset else 0.0
    size = max(float(max(np.abs(run.force).max() for run in runs)), abs(level), 1e-9)
    slope = 0.0 if one_speed else max(slope, 1e-3 * size / top)
    return Guess(mass, max(level, 0.02 * size), slope, constant, 0.1 * top, told, most, one_speed)


def stribeck_guess(runs: Sequence[Run], about: Guess, *, free: bool, offset: bool, directions: bool) -> Curve | None:
    """Return numbers at which the search of a Stribeck curve begins, by the regression of `first_guess` with its curve at many Stribeck speeds.

    None if nothing moves. The speed is smoothed less than for `first_guess`, because a Stribeck curve is short.
    """
    top = max(float(np.abs(run.speed).max()) for run in runs)
    stretches = []
    for run in runs:
        sharp, noise = _sharp(run, top)
        stretches += [(run.time[part], run.force[part], sharp[part]) for part in _stretches(np.abs(sharp) > STILL * noise)]
    ways = (1.0, -1.0) if directions else (0.0,)
    if not stretches:
        return None
    best: tuple[float, np.ndarray, float] = (math.inf, np.zeros(0), 0.0)
    for speed in (top * np.geomspace(0.005, 0.6, TRIED)).tolist():
        rows = []
        for time, force, v in stretches:
            side = np.sign(v)
            curves = [side, v, side * np.exp(-((v / speed) ** 2))]
            columns = [np.where((side == way) | (way == 0.0), each, 0.0) for way in ways for each in curves] + [np.ones(v.size)] * offset
            rows.append(np.stack([_centred(each) for each in (v, *(_impulse(time, one) for one in (force, *columns)))], axis=1))
        v, force, basis = np.split(np.concatenate(rows), [1, 2], axis=1)
        known, given = (np.hstack([force, -basis]), v) if free and about.told else (basis, force - about.mass * v)
        numbers = np.linalg.lstsq(known, given, rcond=None)[0][:, 0]
        away = known @ numbers[:, None] - given
        left = float(np.sum(away**2))
        if left < best[0]:
            best, rest, plain = (
                (left, numbers, speed),
                away[:, 0],
                [i for i in range(known.shape[1]) if i not in _falls(len(ways), known.shape[1], offset)],
            )
            without = given - known[:, plain] @ np.linalg.lstsq(known[:, plain], given, rcond=None)[0]
    left, numbers, speed = best
    mass = about.mass
    if free and about.told and numbers[0] > 0.0:
        mass = 1.0 / float(numbers[0])
        numbers = mass * numbers[1:]
    elif free and about.told:
        numbers = numbers[1:]
    sides = []
    for level, slope, more in numbers[: 3 * len(ways)].reshape(-1, 3).tolist():
        kinetic = max(level, 0.1 * about.level)
        sides.append((kinetic + max(more, 0.05 * kinetic), kinetic, max(slope, 0.1 * about.viscous)))
    constant = float(numbers[-1]) if offset else about.offset
    alike = min(max(float(np.einsum("n,n->", rest[1:], rest[:-1])) / left, 0.0), 1.0) if left else 0.0
    gain = 0.5 * rest.size * (1.0 - alike) / (1.0 + alike) * math.log(max(float(np.sum(without**2)), 1e-300) / max(left, 1e-300))
    return Curve(replace(about, mass=mass, offset=constant, speed=speed), sides, gain)


def _falls(ways: int, columns: int, offset: bool) -> list[int]:
    """Columns of such a regression with the friction that falls with speed."""
    return [columns - offset - 1 - 3 * way for way in range(ways)]


def _sharp(run: Run, top: float) -> tuple[np.ndarray, float]:
    """Speed of a run by the shortest polynomials whose noise is small against the largest speed, at most as long as those of `speed`, and this noise."""
    from scipy.signal import savgol_coeffs, savgol_filter  # here, because it is slow to import

    step, longest, noise = (run.time[-1] - run.time[0]) / (run.time.size - 1), _width(run.time.size), _noise(run.values)
    for width in range(5, longest + 1, 2):
        own = noise * float(np.linalg.norm(savgol_coeffs(width, 3, deriv=run.order, delta=step)))
        if own < SHARP * top:
            return savgol_filter(run.values, width, 3, deriv=run.order, delta=step), own
    return run.speed, run.noise


def _stretches(moves: np.ndarray) -> list[slice]:
    """Stretches of more than three samples that move, without pauses."""
    edges = np.flatnonzero(np.diff(moves.astype(int), prepend=0, append=0))
    return [slice(begin, end) for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True) if end - begin > 3]


def is_one_speed(speed: np.ndarray) -> bool:
    """Whether speeds differ by so little that dry and viscous friction cannot be told apart."""
    sizes = np.abs(speed)
    return bool(np.std(sizes) < STEADY * np.mean(sizes))


def _seen(speed: np.ndarray, force: np.ndarray, basis: np.ndarray, samples: float) -> bool:
    """Whether the impulse of the force explains speed that friction does not; samples: how many of them count, of those that smoothing made alike."""
    alone = force - basis @ np.linalg.lstsq(basis, force, rcond=None)[0]
    power = float(alone @ alone)
    if power <= SHARE**2 * float(force @ force):
        return False
    left = speed - basis @ np.linalg.lstsq(basis, speed, rcond=None)[0]
    pull = float(alone @ left)
    without, more = float(left @ left), pull * pull / power
    rest = max(without - more, 1e-24 * float(speed @ speed))
    return pull > 0.0 and more * max(samples - basis.shape[1] - 1, 1.0) > CLEAR * rest


def _impulse(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integral of samples over time, from 0."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])


def _centred(values: np.ndarray) -> np.ndarray:
    centred: np.ndarray = values - values.mean()
    return centred


def friction_points(runs: Sequence[Run], body: float, offset: float) -> np.ndarray:
    """(speed, friction) in the data, shape (2, points): force less inertia and offset, medians over ranges of speed."""
    pairs = []
    for run in runs:
        there = _moving(run)
        pairs.append(np.stack([run.speed[there], run.force[there] - body * run.acceleration[there] - offset]))
    speed, force = np.concatenate(pairs, axis=1)
    if not speed.size:
        return np.zeros((2, 0))
    order = np.argsort(speed)
    groups = np.array_split(order, min(BINS, order.size))
    return np.array([[np.median(speed[group]) for group in groups], [np.median(force[group]) for group in groups]])
