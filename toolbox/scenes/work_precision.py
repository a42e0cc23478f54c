"""What accuracy costs: error against time for methods, tolerances, steps, widths and levels of detail, in one table and one figure.

The truth is computed twice, by the explicit method of order 8 and by the linearly implicit one, each with located events at the tightest accuracy that it
finishes. They share the model and the search for events but no step, and their disagreement, which is stated, bounds what any error below it means.

Errors are those of `Trajectory.difference`: the largest difference of a state, relative to its size over the run. Times are the least of several
runs, in seconds spent in the compiled loop: on a machine that does other things the others measure these.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from toolbox.arguments import number, numbers, whole
from toolbox.errors import SceneError, SimulationError
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.units import NumberOrText
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop, as_loop, refuse_former
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import names
from toolbox.simulation.methods import METHODS, Smoothing, TimeStepping
from toolbox.simulation.request import Request
from toolbox.simulation.run import Run
from toolbox.simulation.trajectory import Trajectory

ACCURACIES = tuple(10.0**-k for k in range(2, 12))
WIDTHS = tuple(10.0**-k for k in range(1, 9))
COUNTS = (1_000, 4_000, 16_000, 64_000, 256_000, 1_024_000)


@dataclass(frozen=True)
class Point:
    """A run of the comparison: the varied quantity ("accuracy", "step" or "width") and its setting (an accuracy, a step [s], or a width as
    a fraction of the largest slip).

    error: [1];  seconds, steps: what it took;  failed: why there is no error, or "".
    """

    method: str
    plant: str
    varied: str
    setting: float
    error: float
    seconds: float
    steps: int
    failed: str = ""


@dataclass(frozen=True)
class WorkPrecision(Told, Result):
    """Error over computing time of several methods for one loop, the result of `work_precision`. `print` shows the
    table, `plot` draws it and `save` writes it.

    Attributes
    ----------
    title, duration
        Name of the loop, and length of the runs [s].
    points
        The runs (`Point`), in order of method and setting.
    reference_error
        Largest difference between the two reference solutions, as a fraction of the size of the state.
    references
        Methods of the two reference solutions.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, work_precision
    >>> found = work_precision(compose(BlockOnBelt()), "20 s", methods=["taylor"], accuracies=[1e-3, 1e-6], repeats=1)
    >>> print(f"{len(found.points)} runs, reference known to 1e-9: {found.reference_error < 1e-9}")
    2 runs, reference known to 1e-9: True
    """

    title: str
    duration: float
    points: tuple[Point, ...]
    reference_error: float
    references: tuple[str, str]

    def cheapest(self, error: float) -> Point | None:
        """Return the fastest run whose error is at most `error`. Return None if no run has such a small error.

        Raises SceneError if `error` is below `reference_error`, because smaller errors of a run are not known.

        Parameters
        ----------
        error
            Largest allowed error [1].
        """
        if not error >= self.reference_error:
            raise SceneError(
                f"Argument `error` must be >= {self.reference_error:.1e}, below which the truth is not known, but it is {error!r}."
            )
        found = [point for point in self.points if not point.failed and point.error <= error]
        return min(found, key=lambda point: point.seconds, default=None)

    def _told(self) -> list[str | Rows]:
        rows = [("method", "setting", "error", "time", "steps")]
        several = len({point.plant for point in self.points}) > 1
        for point in self.points:
            name, setting = f"{point.method}, {point.plant}" if several else point.method, f"{point.varied} {point.setting:.2g}"
            error = f"{point.error:.1e}" if point.error > 2 * self.reference_error else f"<{2 * self.reference_error:.0e}"
            done = (error, f"{1e3 * point.seconds:.3f} ms", str(point.steps))
            rows.append((name, setting, *((point.failed.split(".")[0], "", "") if point.failed else done)))
        truth = f"{self.duration:g} s; truth: {self.references[0]} and {self.references[1]} differ by {self.reference_error:.1e}"
        return [self.title, truth, Rows(rows, indent="")]

    def plot(self, ax: Any = None) -> Any:
        """Draw computing time against error on logarithmic axes, one line per method and plant.

        Errors in the grey band are below the uncertainty of the reference. Return the axes.

        Parameters
        ----------
        ax
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.scenes.figures import work_precision

        return work_precision(self, ax=ax)

    def _table(self) -> HeadedRows:
        """One row per point."""
        names = [field.name for field in fields(Point)]
        return names, [[getattr(point, name) for name in names] for point in self.points]


def work_precision(
    loop: ClosedLoop | HybridSystem | Mapping[str, ClosedLoop | HybridSystem],
    duration: NumberOrText | None = None,
    *,
    methods: Sequence[str] = ("taylor", "explicit", "stiff", "time-stepping", "smoothed"),
    accuracies: Iterable[float] = ACCURACIES,
    steps: Iterable[float] | None = None,
    widths: Iterable[float] = WIDTHS,
    signals: Sequence[str] = (),
    repeats: int = 5,
    **former_names: Any,
) -> WorkPrecision:
    """Measure error and computing time of a run for several methods, and for several settings of each method.

    The error [1] is the largest difference from a reference solution, over all times and all states (or `signals`). The
    difference of a state is divided by the largest magnitude of this state in the reference solution. The reference
    solution is computed by two methods, so that its own error is known. The computing time [s] is the time of the
    integration, without compilation.

    Parameters
    ----------
    loop
        A loop or a plant. Or {label: loop} for several models of one machine. The first model gives the reference
        solution.
    duration
        Length of the runs [s]. By default the duration of the scene, for a loop from a scene.
    methods
        Names of the methods, by default "taylor", "explicit", "stiff", "time-stepping" and "smoothed". "taylor" fails
        if a plant, or a point that a run reaches, has no Taylor series.
    accuracies
        Accuracies for the methods that locate events, by default 1e-2, 1e-3 and so on to 1e-12.
    steps
        Steps [s] for time stepping. By default from 1e3 to 1e6 steps in the run.
    widths
        Widths for regularised friction, as fractions of the largest slip speed, by default 0.1, 0.01 and so on to 1e-8.
    signals
        Names of the signals whose difference counts. By default all states. Needed for several plants.
    repeats
        Number of runs with each setting, by default 5. The shortest computing time counts.

    Returns
    -------
    WorkPrecision
        One `Point` for each method and setting. `print` shows them as a table with the columns method, setting, error
        [1], computing time [ms] and number of steps. `plot` draws the time over the error. `save` writes a table with
        the fields of `Point`, and the time in s.

    Raises
    ------
    SceneError
        If a method, a signal or a plant does not fit, or a number is out of its bounds.
    SimulationError
        If no reference solution can be computed.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, work_precision
    >>> found = work_precision(compose(BlockOnBelt()), "20 s", methods=["taylor"], accuracies=[1e-3, 1e-6], repeats=1)
    >>> print(len(found.points), "settings")
    2 settings
    """
    refuse_former("work_precision", loop, list(former_names))
    if former_names:
        raise TypeError(f"work_precision() got an unexpected keyword argument {next(iter(former_names))!r}")
    loops = {label: as_loop(each) for label, each in (loop if isinstance(loop, Mapping) else {"": loop}).items()}
    if not loops:
        raise SceneError("Argument `loop` must hold at least one level of detail, but it is empty.")
    first = next(iter(loops.values()))
    duration = number("duration", first.duration if duration is None else duration, "s", above=0)
    if len(loops) > 1 and not signals:
        raise SceneError("Argument `signals` must name what the levels of detail have in common, but it is empty.")
    for method in names(methods):
        if method not in METHODS:
            raise SceneError(f"Argument `methods` must be among {', '.join(map(repr, METHODS))}, but one is {method!r}.")
    whole("repeats", repeats, 1)
    given = numbers("accuracies", accuracies, at_least=1e-13, at_most=0.1)
    lengths = numbers("steps", steps) if steps is not None else [duration / count for count in COUNTS]
    shares = numbers("widths", widths)
    signals = names(signals)
    for name in signals:
        for each in loops.values():
            each.system.signal_unit(name)
    runs = {label: Request(each, duration).checked() for label, each in loops.items()}
    true = next(iter(runs.values()))
    truth, used = _truth(true, "explicit")
    second, other = _truth(true, "stiff")
    disagreement = _difference(second, truth, signals)
    settings = [
        (run, label, method, varied, setting, changes)
        for label, run in runs.items()
        for method in methods
        for varied, setting, changes in _settings(run, method, given, lengths, shares)
    ]
    points = []
    with progress_bar(len(settings), "work and precision") as bar:
        for run, label, method, varied, setting, changes in settings:
            points.append(_point(run, label, method, varied, setting, changes, truth, signals, repeats))
            bar.update()
    return WorkPrecision(first.title, duration, tuple(points), disagreement, (used, other))


def _truth(run: Run, method: str) -> tuple[Trajectory, str]:
    """The run at the tightest accuracy that the method finishes."""
    for accuracy in (1e-12, 1e-11, 1e-10, 1e-9):
        try:
            done = run.again(method=method, accuracy=accuracy, output_times=None)
        except SimulationError as error:
            failed = error
            continue
        return done, f"{method} at {accuracy:g}"
    raise SimulationError(f"No truth can be computed by method={method!r}: {failed}", failed.run)


def _settings(
    run: Run, method: str, accuracies: list[float], steps: list[float], widths: list[float]
) -> Iterable[tuple[str, float, dict[str, Any]]]:
    """(varied, setting, changes of the run) of every run of a method."""
    if method == "time-stepping":
        return [("step", step, {"method": TimeStepping(step)}) for step in steps]
    if method == "smoothed":
        from toolbox.simulation.refinement import SHARE, slips

        sizes = slips(run)
        return [
            (
                "width",
                share,
                {"method": Smoothing({name: share * size for name, size in sizes.items()}, max(min(1e-3, SHARE * share), 1e-13))},
            )
            for share in widths
        ]
    return [("accuracy", accuracy, {"accuracy": accuracy, "method": METHODS[method]}) for accuracy in accuracies]


def _point(
    run: Run,
    label: str,
    method: str,
    varied: str,
    setting: float,
    changes: dict[str, Any],
    truth: Trajectory,
    signals: Sequence[str],
    repeats: int,
) -> Point:
    try:
        done = run.again(output_times=None, **changes)
        if method == "taylor" and not done.program.formulas.series:  # other steps have stood in for them
            return Point(method, label, varied, setting, math.nan, math.nan, 0, done.why)
        error = _difference(done, truth, signals)
        times = [done.wall_time, *(run.again(output_times=None, **changes).wall_time for _ in range(repeats - 1))]
    except (SimulationError, SceneError) as failed:
        return Point(method, label, varied, setting, math.nan, math.nan, 0, str(failed))
    return Point(method, label, varied, setting, error, min(times), sum(done.steps))


def _difference(run: Trajectory, truth: Trajectory, signals: Sequence[str]) -> float:
    """The difference of states, or of the named signals at 2001 times."""
    if not signals:
        return run.difference(truth)
    times = np.linspace(0.0, min(run.end, truth.end), 2001)
    mine, theirs = run.at(times), truth.at(times)
    return max(float(np.abs(mine[name] - theirs[name]).max() / max(np.abs(theirs[name]).max(), 1e-300)) for name in signals)
