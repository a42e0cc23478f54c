"""Gains over depth: a law designed at some depths of a well, interpolated between them, and checked there and halfway.

A string gets longer while it drills, and the law that fits it at 1000 m is not the one that fits it at 5000 m. A drive takes a table: depth against gains,
linear between its rows and constant outside. What such a table does between its rows is no design, so it is checked there: at every depth of the table and
halfway between, on the machine of that depth, by the margins of the linear loop, by the growth of smooth running, and by runs that are judged as
`worst_case` judges them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from toolbox.arguments import count_of, number, numbers
from toolbox.drilling.depth_windows import closed_at
from toolbox.errors import SceneError
from toolbox.files.printing import Rows, Told, shown
from toolbox.files.results import LEFT_OUT, HeadedRows, Result
from toolbox.files.unit_systems import asked_in, reading
from toolbox.files.units import NumberOrText, in_si
from toolbox.measuring.verdict import growth_in_words
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.closing import described
from toolbox.modelling.components import numbers_of, rebuilt
from toolbox.modelling.laws import Controller, Sampled
from toolbox.robustness.margins import disk_margin
from toolbox.robustness.outcomes import percent
from toolbox.robustness.starts import Start
from toolbox.robustness.worst_case import Trials
from toolbox.vocabulary import new_names_only


@dataclass(frozen=True)
class CheckedDepth:
    """Result of the gains of a depth on the machine of the same depth.

    Attributes
    ----------
    depth
        Depth [m].
    designed
        Whether the table has a row there; else its gains are interpolated.
    disk_margin
        Of the whole loop [1]; nan where there is no linear loop.
    rate
        Rate at which a small disturbance of smooth running grows [1/s]; nan where it is not known.
    failed, runs
        Runs that are no success, and all of them.
    stuck, mean_error, ripple
        Of the worst run, as in `worst_case` [1].
    """

    depth: float
    designed: bool
    disk_margin: float
    rate: float
    failed: int
    runs: int
    stuck: float
    mean_error: float
    ripple: float


@dataclass(frozen=True)
class Schedule(Told, Result):
    """Gains over depth with the results of their checks, the result of `schedule`: `print(found)` shows the table,
    `found.to_csv(path)` writes the gains.

    Attributes
    ----------
    title
        The controller and how it runs.
    run_conditions
        Start of the runs, and time from which they are judged.
    depths
        Depths of the table [m].
    names, units
        The numbers of the controller that change with depth, and their units in SI.
    gains
        Values of these numbers, shape (depths, numbers).
    checked
        Results of the checks at every depth of the table, and halfway between neighbouring depths.
    display_units
        {SI unit: unit that was typed}: the units in which `print` answers.
    controller
        The sampled controller with all its numbers, at the first depth. None after loading.
    situation
        The situation for which the verdict holds, in one line.
    all_gains
        All numbers of the controller at the depths of the table, including those that do not change. None after
        loading.

    Examples
    --------
    >>> import numpy as np
    >>> from toolbox.drilling import Schedule
    >>> table = {"depths": (1500.0, 2500.0), "names": ("softtorque.proportional",), "units": ("N m s/rad",), "gains": np.array([[486.0], [376.0]])}
    >>> found = Schedule("soft torque", "100 s", **table, checked=(), display_units={})
    >>> print(found.gains_at("2000 m"))
    {'softtorque.proportional': 431.0}
    """

    title: str
    run_conditions: str
    depths: tuple[float, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    gains: np.ndarray
    checked: tuple[CheckedDepth, ...]
    display_units: Mapping[str, str]
    controller: Any = field(default=None, repr=False, compare=False, metadata=LEFT_OUT)
    all_gains: Any = field(default=None, repr=False, compare=False, metadata=LEFT_OUT)
    situation: str = ""

    @property
    def holds(self) -> bool:
        """Whether every run succeeds, at every depth that was checked."""
        return not any(each.failed for each in self.checked)

    def gains_at(self, depth: NumberOrText) -> dict[str, float]:
        """Return {number: value in SI} at a depth [m]: linear between the rows of the table, constant outside the table.

        Parameters
        ----------
        depth
            Measured depth [m], or text with a unit.
        """
        depth = number("depth", depth, "m", at_least=0)
        return {name: float(np.interp(depth, self.depths, self.gains[:, k])) for k, name in enumerate(self.names)}

    def law_at(self, depth: NumberOrText) -> Any:
        """Return the controller with its numbers at a depth [m], for a loop. Raises SceneError after loading, because a file holds no controller.

        Parameters
        ----------
        depth
            Measured depth [m], or text with a unit.
        """
        if self.controller is None:
            raise SceneError(
                "A schedule that was loaded has no law, which belongs to the machine: make it again by `schedule`, or take `gains_at`."
            )
        return _law_at(self.controller, self.depths, self.all_gains, number("depth", depth, "m", at_least=0))

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The table as text: one line per depth that was checked."""
        read = {unit: reading(unit, self.display_units) for unit in ("m", *self.units)}
        heads = [f"{name} [{read[unit].tail.strip() or '1'}]" for name, unit in zip(self.names, self.units, strict=True)]
        lines: list[tuple[str, ...]] = [
            (f"depth [{read['m'].tail.strip()}]", "", *heads, "disk margin", "a disturbance", "failed", "stuck", "mean error", "ripple")
        ]
        for each in self.checked:
            gains = [f"{value * read[unit].factor:.4g}" for value, unit in zip(self.gains_at(each.depth).values(), self.units, strict=True)]
            parts = [percent(value) for value in (each.stuck, each.mean_error, each.ripple)]
            lines.append(
                (
                    f"{each.depth * read['m'].factor:.5g}", "designed" if each.designed else "between", *gains,
                    shown(each.disk_margin), growth_in_words(each.rate), f"{each.failed} of {each.runs}", *parts,
                )
            )  # fmt: skip
        return lines

    def _told(self) -> list[str | Rows]:
        bad = [f"{each.depth * reading('m', self.display_units).factor:.5g}" for each in self.checked if each.failed]
        verdict = (
            "every run succeeds at every depth" if self.holds else f"runs fail at {', '.join(bad)}{reading('m', self.display_units).tail}"
        )
        return [
            f"Gains over depth of {self.title}: {verdict}",
            f"  {self.situation or self.run_conditions}",
            Rows(self.rows, (1,)),
        ]

    def _table(self) -> HeadedRows:
        """The table for the drive, one row per depth."""
        headings = ["depth [m]", *(f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True))]
        return headings, [[depth, *row.tolist()] for depth, row in zip(self.depths, self.gains, strict=True)]

    def plot(self, axes: Any = None) -> Any:
        """Draw gains and disk margin over depth (`toolbox.drilling.figures.schedule_diagram`), and return the axes.

        Parameters
        ----------
        axes
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.drilling.figures import schedule_diagram

        deep, *read = (reading(unit, self.display_units) for unit in ("m", *self.units))
        labels = [f"{name} [{each.unit}]" for name, each in zip(self.names, read, strict=True)]
        found = [(each.depth * deep.factor, each.designed, each.disk_margin, not each.failed) for each in self.checked]
        gains = self.gains * np.array([each.factor for each in read])
        return schedule_diagram(labels, np.array(self.depths) * deep.factor, gains, found, axes, deep.unit)


@new_names_only
def schedule(
    well: Callable[[float], Any],
    depths: Iterable[NumberOrText],
    controller: Controller | Sampled | Callable[[float], Controller | Sampled],
    duration: NumberOrText,
    *,
    starts: Start | None = None,
    after: NumberOrText | None = None,
    mean_within: float = 0.02,
    ripple_within: float = 0.05,
) -> Schedule:
    """Design a controller at several depths of a well, interpolate its gains over depth, and check the interpolated
    controller at these depths and halfway between them.

    Parameters
    ----------
    well
        A function depth [m] -> plant, or loop without controllers, such as a function that cuts a string to this
        length.
    depths
        At least two depths, in metres or text with units, in rising order.
    controller
        A controller that designs itself on the plant of each depth. Or a function depth [m] -> controller, such as a
        function that tunes it there. All numbers of the controller are interpolated, so every depth must have the same
        numbers.
    duration
        Length of a run [s].
    starts
        Starts of the runs on the plant of each depth: `SmoothRunning()`, `FromRest(ramp)`,
        `TakenOver(initial_controller)` (from the stick-slip of another controller), such as `TakenOver(StiffPI(),
        phases=4)`, or `OwnStickSlip()`. By default `SmoothRunning()`.
    after
        Time from which on a run is judged [s]. By default the last 30 % of the run.
    mean_within, ripple_within
        Allowed error of the mean speed as a fraction of the set-point [1], by default 0.02, and allowed ripple of a
        command as a fraction of its mean [1], by default 0.05.

    Returns
    -------
    Schedule
        The table of gains, and the behaviour at every depth.

    Raises
    ------
    SceneError
        If the depths do not rise, or the controller has other numbers at one depth than at another.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, TorsionalChain
    >>> from toolbox import Sampled, compose
    >>> from toolbox.drilling import schedule
    >>> def well(depth):
    ...     string = TorsionalChain(inertia=(2122.0, 374.0), stiffness=(473.0 * 2000.0 / depth,), damping=(23.2,), top_drag=425.0, bit_drag=50.0)
    ...     return compose(string, BitRock(weight="60 kN"))
    >>> found = schedule(well, [1500.0, 2500.0], Sampled(SoftTorque(reference="120 rpm"), "10 ms"), "100 s")
    >>> print(found.names, found.gains.round(0).tolist())
    ('softtorque.proportional', 'softtorque.integral') [[486.0, 3578.0], [376.0, 2147.0]]
    """
    typed = in_si(list(depths), "m", "depths") if not isinstance(depths, str) else depths
    places = numbers("depths", typed, "m", at_least=0)
    if len(places) < 2 or any(b <= a for a, b in pairwise(places)):
        raise SceneError(
            f"Argument `depths` must hold at least two rising depths, but it holds {', '.join(f'{each:g}' for each in places)} m."
        )
    duration = number("duration", duration, "s", above=0)
    loops = [_designed(well, depth, controller) for depth in places]
    counted = [len(numbers_of(loop.designed_controllers[0])) for loop in loops]
    kinds = {type(loop.designed_controllers[0]).__name__ for loop in loops}
    if len(set(counted)) > 1 or len(kinds) > 1:
        raise SceneError(
            f"Argument `controller` must have as many numbers at every depth to be interpolated, but it has {', '.join(map(str, counted))}: "
            "let `well` give plants of one size, or take a law whose design does not grow with the plant."
        )
    every = np.array([numbers_of(loop.designed_controllers[0]) for loop in loops])
    given, first = loops[0].controllers[0], loops[0].designed_controllers[0]
    base = dataclasses.replace(given, law=first) if isinstance(given, Sampled) else first
    moves = np.flatnonzero(np.ptp(every, axis=0) > 0.0)
    named = _named(loops[0])
    found, way, situation = [], "", ""
    for depth in sorted({*places, *((a + b) / 2 for a, b in pairwise(places))}):
        loop = closed_at(well, depth)
        closed = loop.replace(controllers=(_law_at(base, places, every, depth),))
        trials = Trials.of(closed, duration, starts=starts, after=after, allowed=(mean_within, ripple_within))
        outcomes = trials.of_cases({"nominal": {}})
        worst, way = outcomes.worst, trials.way
        there = trials.situation("")
        situation = str(
            dataclasses.replace(there, plants="the nominal plant at each depth", design="numbers of the controller between those of depths")
        )
        failed = sum(outcome.excess > 1.0 or math.isnan(outcome.excess) for outcome in outcomes.outcomes)
        settled = trials.known.get("nominal")
        found.append(
            CheckedDepth(
                depth, depth in places, disk_margin(closed), math.nan if settled is None else settled.rate, failed,
                len(outcomes.outcomes), worst.stuck, worst.mean_error, worst.ripple,
            )
        )  # fmt: skip
    return Schedule(
        described(given), way, tuple(places), tuple(named[k][0] for k in moves), tuple(named[k][1] for k in moves), every[:, moves], tuple(found),
        {**loops[0].display_units, "m": asked_in(typed, "m")}, base, every, situation,
    )  # fmt: skip


def _designed(well: Callable[[float], Any], depth: float, law: Any) -> ClosedLoop:
    """The loop of a depth with the law that is designed there."""
    here = law if isinstance(law, (Controller, Sampled)) else law(depth) if callable(law) else None
    if not isinstance(here.law if isinstance(here, Sampled) else here, Controller):
        raise SceneError(f"Argument `controller` must be a Controller, Sampled with one, or a function depth -> law, but it is {law!r}.")
    return closed_at(well, depth).replace(controllers=(here,))


def _law_at(law: Any, depths: Sequence[float], every: np.ndarray, depth: float) -> Any:
    """The law with its numbers between those of depths."""
    here = np.array([np.interp(depth, depths, column) for column in every.T])
    return dataclasses.replace(law, law=rebuilt(law.law, here, 0)) if isinstance(law, Sampled) else rebuilt(law, here, 0)


def _named(loop: ClosedLoop) -> list[tuple[str, str]]:
    """(name, unit) of every number of the designed law, in the order of `numbers_of`."""
    first = sum(len(numbers_of(part)) for part in loop.plant.parts)
    entries = sorted(loop.system.parameters.values(), key=lambda entry: entry.offset)
    own = [entry for entry in entries if first <= entry.offset < first + len(numbers_of(loop.designed_controllers[0]))]
    return [(entry.name if entry.size is None else f"{entry.name}.{i}", entry.unit) for entry in own for i in range(count_of(entry.size))]
