"""Steps of a run as quintics: signals and their first two derivatives at both ends of every step."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from toolbox.compilation.bodies import plain_body
from toolbox.compilation.emitter import compiled, function_text
from toolbox.compilation.notices import announced
from toolbox.compilation.program import Program
from toolbox.simulation.saved_run import SavedSteps
from toolbox.simulation.trajectory import Stepped, Trajectory


def signals_and_bounds(program: Program, signals: Sequence[str], bounds: Sequence[int]) -> ca.SX:
    """Signals, then the bounds of some elements, in terms of t, x, p and the modes."""
    system = program.system
    return program.closed(ca.vertcat(*map(system.expression, signals), *[system.elements[i].static for i in bounds]))


def _tolerance(accuracy: float) -> float:
    """Largest distance of the cubic from the quintic, in parts of the size of a signal; its power 3/2 over 6 is about the error of the quintic."""
    return min(10.0 * accuracy, 1e-5)


# ---------------------------------------------------------------------------------------------------------------------------------- step by step
@dataclass(frozen=True)
class Steps:
    """What a scalar signal does in every step of a run inside a window: arrays of shape (steps,).

    begin, end: of the steps, cut to the window [s];  row: of the node at which each begins;  lowest, highest: values, of quintics;  when_lowest,
    when_highest [s];  integral: over the step.
    """

    begin: np.ndarray
    end: np.ndarray
    row: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    when_lowest: np.ndarray
    when_highest: np.ndarray
    integral: np.ndarray


def steps_of(nodes: Trajectory | SavedSteps, signal: str, begin: float, end: float, cuts: tuple[float, ...] = ()) -> Steps:
    """The steps of a run with every step recorded, read as those of a `RunningMeasures` are; those of time stepping are straight from node to node, and
    those of a saved run the polynomials of its file. cuts: times at which a step is cut in two, as at the ends of windows."""
    if isinstance(nodes, SavedSteps):
        return _saved(nodes, signal, begin, end, cuts)
    row, left_t, right_t = _pieces(nodes.time, begin, end, cuts)
    lowest, highest, when_lowest, when_highest, integral = (np.full((row.size, 1), fill) for fill in (np.inf, -np.inf, np.nan, np.nan, 0.0))
    if isinstance(nodes, Stepped):
        left, right = np.asarray(nodes.at(left_t)[signal]), np.asarray(nodes.interpolated(row, right_t)[signal])
        for values, when in ((left, left_t), (right, right_t)):
            lower, higher = values < lowest[:, 0], values > highest[:, 0]
            lowest[lower, 0], when_lowest[lower, 0] = values[lower], when[lower]
            highest[higher, 0], when_highest[higher, 0] = values[higher], when[higher]
        integral[:, 0] = 0.5 * (left + right) * (right_t - left_t)
    elif row.size:
        from toolbox.measuring import measuring_loop

        announced("reader of measures", measuring_loop.read_steps)
        rows = slice(int(row[0]), int(row[-1]) + 2)
        recorded = {"time": nodes.time[rows], "state": nodes.states[rows], "mode": nodes.mode[rows], "held": nodes.held[rows]}
        work = measuring_loop.reading(
            nodes.program, _compiled(nodes.program, (signal,)), 1, _tolerance(nodes.accuracy), nodes.parameters.copy(),
            windows=np.column_stack([left_t, right_t]), lowest=lowest, highest=highest, when_lowest=when_lowest, when_highest=when_highest, integral=integral,
            **{name: np.ascontiguousarray(each) for name, each in recorded.items()},
        )  # fmt: skip
        measuring_loop.read_steps(work)
    known = np.isfinite(when_highest[:, 0])
    arrays = (left_t, right_t, row, *(each[:, 0] for each in (lowest, highest, when_lowest, when_highest, integral)))
    return Steps(*(array[known] for array in arrays))


def _pieces(time: np.ndarray, begin: float, end: float, cuts: Sequence[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(row of the node at which its step begins, begin, end) of the steps from node to node inside a window, cut at some times."""
    begin, end = max(begin, time[0]), min(end, time[-1])
    if not begin < end:
        return np.empty(0, np.int64), np.empty(0), np.empty(0)
    first, last = np.searchsorted(time, begin, side="right"), np.searchsorted(time, end, side="left")
    edges = np.unique(np.concatenate([[begin], time[first:last], [each for each in cuts if begin < each < end], [end]]))
    return np.searchsorted(time, edges[:-1], side="right") - 1, edges[:-1], edges[1:]


@functools.lru_cache(
    maxsize=4
)  # a comparison asks two runs for several measures of one signal, and reading a long file again takes seconds
def _saved(nodes: SavedSteps, signal: str, begin: float, end: float, cuts: tuple[float, ...]) -> Steps:
    """The steps of a saved run: extrema are looked for among 33 points, three times closer each time; integrals by Gauss's formula of order 18."""
    row, left, right = _pieces(nodes.time, begin, end, cuts)

    def values(low: np.ndarray, high: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(times, values), shape (steps, places)."""
        times = low[:, None] + (high - low)[:, None] * places
        times[:, -1] = np.where(places[-1] == 1.0, high, times[:, -1])
        found = np.asarray(nodes.interpolated(np.repeat(row, places.size), times.ravel())[signal])
        return times, found.reshape(times.shape)

    extrema = []
    for sign in (1.0, -1.0):
        low, high = left, right
        for _ in range(4):
            times, found = values(low, high, np.linspace(0.0, 1.0, 33))
            best = np.argmin(sign * found, axis=1)
            steps = np.arange(row.size)
            when, value = times[steps, best], found[steps, best]
            low, high = times[steps, np.maximum(best - 1, 0)], times[steps, np.minimum(best + 1, 32)]
        extrema.append((value, when))
    places, weights = np.polynomial.legendre.leggauss(9)
    integral = 0.5 * (right - left) * (values(left, right, 0.5 * (places + 1.0))[1] @ weights)
    (lowest, when_lowest), (highest, when_highest) = extrema
    return Steps(left, right, row, lowest, highest, when_lowest, when_highest, integral)


def _compiled(program: Program, signals: tuple[str, ...], bounds: Sequence[int] = ()) -> int:
    """Address of the function (t, x, p, m) -> signals and bounds of elements, then their first and second derivatives in time."""
    key = f"measures of {signals} and {list(bounds)}"
    found = program.outputs.get(key)
    if found is None:
        body = plain_body(with_derivatives(program, signals, bounds), 0)
        text = "\n".join([function_text("signals", body), *sorted(body.declarations)])
        found = program.outputs[key] = compiled(text, ["signals"], body.count)["signals"]
    return found


def with_derivatives(program: Program, signals: Sequence[str], bounds: Sequence[int]) -> ca.Function:
    """(t, x, p, m) -> signals and bounds of elements, then their first, then their second derivatives in time."""
    system, p = program.system, program.expressions[0]
    field = program.form.field[: system.x.numel()]
    terms = [signals_and_bounds(program, signals, bounds)]
    for _ in range(2):
        terms.append(ca.jtimes(terms[-1], system.x, field) + ca.jtimes(terms[-1], system.t, ca.SX(1)))
    return ca.Function("signals", [system.t, system.x, p, system.m], [ca.densify(ca.vertcat(*map(ca.densify, terms)))])
