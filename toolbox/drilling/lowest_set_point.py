"""The lowest set-point that a law of a drill string holds: on the nominal plant, on others, under a weight that varies, for half an hour.

How a law is tried at a set-point is told in `toolbox.drilling.set_points`, on which machines in `toolbox.drilling.groups`.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import itertools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from toolbox.arguments import checked_range, number, numbers
from toolbox.drilling.groups import LASTING, NAMES, Group, machine_groups
from toolbox.drilling.set_points import PROTOCOLS, SETTLING, Outcome, Trial
from toolbox.errors import SceneError
from toolbox.files.printing import columns, shown
from toolbox.files.results import HeadedRows, Result
from toolbox.files.unit_systems import asked_units, reading
from toolbox.files.units import NumberOrText
from toolbox.measuring.verdict import growth_in_words
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.laws import Controller
from toolbox.scenes.situation import Situation
from toolbox.sweeps.executors import check_executor
from toolbox.vocabulary import NOW, Renamed, new_field, now_or_near

ABOVE = (0.3, 0.8, 2.0)
"""How far above a border [rad/s] it is confirmed."""
UNTRIED = "not tried below"
"""What is said of a border below which nothing was tried."""
APART = 1.0
"""How far apart set-points [rad/s] are tried, from the highest down, where that does not hold."""
HELP = 0.5
"""How far below the border of the nominal plant [rad/s] those of others are looked for."""


ANSWERING = (0, 1, 2, 3, 4, 7, 13, 14)
"""Columns of a table of lowest set-points that answer."""


class Cells:
    """Known outcomes, kept in a file of JSON lines, so that a stopped search continues.

    path: of the file, or None for none.  A line that was not finished is left out. The machine and the numbers of the laws are part of the key: another law of
    the same label is judged anew.  say: called with a line of text, behind `place`, for each new outcome;  asked: {unit: unit in which it tells}.
    """

    def __init__(self, path: Path | None = None, say: Callable[[str], None] | None = None, display_units: Mapping[str, str] | None = None):
        self.path, self.say, self.display_units = path, say, display_units
        self.place = ""
        self.known: dict[str, Outcome] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    row = json.loads(line)
                    key = row.pop("key")
                    self.known[key] = Outcome(**{new_field(Outcome, name): value for name, value in row.items()})
                except (json.JSONDecodeError, KeyError, TypeError, AttributeError):
                    continue

    def outcome(self, trial: Trial, group: Group, reference: float, way: str) -> Outcome:
        """The outcome at a set-point, known or new."""
        key = _key(trial, group, reference, way)
        if key not in self.known:
            found = trial.outcome(group, reference, way)
            self.known[key] = found
            if self.path is not None:
                with self.path.open("a", encoding="utf-8") as file:
                    file.write("\n" + json.dumps({"key": key, **dataclasses.asdict(found)}))
            if self.say is not None:
                lasts = f" for {group.judged_time:g} s" if group.judged_time >= LASTING else ""
                said = f"holds{lasts}" if found.passed else f"fails: {found.why}"
                factor, unit = reading("rad/s", self.display_units)
                self.say(f"{self.place}{trial.label}, {group.name}, {way}, {reference * factor:.4g} {unit}: {said}")
        return self.known[key]

    def grows(self, trial: Trial, group: Group, reference: float, way: str) -> bool:
        """Whether a small disturbance of smooth running grows on a machine of a group, for which no run is needed."""
        known = self.known.get(_key(trial, group, reference, way))
        return (known.growth_rate if known is not None else trial.growth(group.machines, reference)[0]) > 0.0


def _key(trial: Trial, group: Group, reference: float, way: str) -> str:
    return json.dumps([trial.key(reference), repr(group), way, reference])


@dataclass(frozen=True)
class SetPointLimit(Renamed):
    """Lowest set-point of a controller that ends stick-slip on a group of plants, and cost of the recovery at this set-point.

    Attributes
    ----------
    lowest_set_point
        Lowest successful set-point [rad/s]. nan if no set-point is successful.
    why
        The run that fails one step below it, or at the highest set-point if no set-point is successful.
    highest_set_point
        Highest successful set-point [rad/s]. nan if the controller is successful up to the end of the searched range.
    time_above_setpoint
        Largest fraction of half an hour after the recovery in which the top is more than 10 % above the set-point [1].
    recovery_time
        Longest time before this half hour in which the top is more than 10 % above the set-point [s]. For a controller
        that raises its set-point, this time includes the raising.
    max_bit_speed, max_torque
        Highest speed of the bit [rad/s] and highest torque of the drive [N m] after the takeover.
    max_lifts, relapses_per_hour
        For a controller that raises its set-point: largest number of raises from the takeover on, and largest number of
        raises per hour after the recovery.
    max_weight_relief
        For a controller that reduces the weight on bit: largest mean fraction of the weight that is removed [1].
    growth_rate
        Largest growth rate of a small disturbance of smooth running on any plant [1/s]. Negative if the disturbance
        decays.
    disk_margin, disk_margin_nominal
        Smallest disk margin at this set-point over the plants of the group, and disk margin of the nominal plant [1].
        nan for a controller whose command is no differentiable function of its measurements.
    weakest_plant
        The plant with the smallest disk margin.

    Examples
    --------
    >>> from toolbox.drilling import SetPointLimit
    >>> limit = SetPointLimit(9.5, "at 9.0 rad/s the bit sticks", recovery_time=12.0)
    >>> print(limit.range, "rad/s")
    (9.5,) rad/s
    """

    lowest_set_point: float
    why: str
    highest_set_point: float = math.nan
    time_above_setpoint: float = math.nan
    recovery_time: float = math.nan
    max_bit_speed: float = math.nan
    max_torque: float = math.nan
    max_lifts: float = math.nan
    relapses_per_hour: float = math.nan
    max_weight_relief: float = math.nan
    growth_rate: float = math.nan
    disk_margin: float = math.nan
    disk_margin_nominal: float = math.nan
    weakest_plant: str = ""

    @property
    def range(self) -> tuple[float, ...]:
        """The lowest successful set-point and, if it is not nan, the highest successful set-point [rad/s]."""
        return (self.lowest_set_point,) if math.isnan(self.highest_set_point) else (self.lowest_set_point, self.highest_set_point)


def lowest(
    trial: Trial,
    group: Group,
    way: str = "takeover",
    cells: Cells | None = None,
    lower: float = 1.5,
    higher: float = 14.0,
    step: float = 0.1,
    lasts: bool = True,
) -> SetPointLimit:
    """The lowest set-point by bisection between `lower` and `higher`, confirmed at three above it and, with `lasts`, for half an hour.

    `lower` is taken to fail, and tried only where nothing above it does. Where `higher` fails, the next lower one that holds is looked for in steps of `APART`,
    and the highest that does takes its place: a window. With `lasts`, smooth running that is not stable confirms nothing either. Where one of
    these fails, or the border leaves a smaller disk margin than the group wants, the search goes on above it: what is given is the lowest from which on
    nothing that was tried failed. All in rad/s.
    """
    cells = cells or Cells()

    def fails(k: int, chosen: Group = group) -> str:
        found = cells.outcome(trial, chosen, round(k * step, 6), way)
        return "" if found.passed else found.why

    low, high = round(lower / step), round(higher / step)
    until, below = math.nan, UNTRIED
    if why := fails(high):
        apart = max(round(APART / step), 1)
        holds = next((k for k in range(high - apart, low, -apart) if not fails(k)), None)
        if holds is None:
            return SetPointLimit(math.nan, why)
        high, _, _ = _halved(lambda k: "" if fails(k) else "it holds", holds, holds + apart, "it holds")
        until = round(high * step, 6)
    top = high
    while True:
        low, high, below = _halved(fails, low, high, below)
        speed = round(high * step, 6)
        grows = lasts and cells.grows(trial, group.lasting, speed, way)
        short = fails(high, group.lasting) if lasts else ""  # before what is above, which need not be tried where this fails
        if short and not grows:
            short += " within half an hour"
        if not short:
            above = sorted({min(high + round(each / step), top) for each in ABOVE})
            broken = [(k, said) for k in above if (said := fails(k))]
            if broken:
                low, below = broken[-1]
                high = top
                continue
            declared, margin, weakest = trial.disk_margins(group.machines, speed)
            if not min(declared, margin) < group.min_disk_margin:
                found = dataclasses.asdict(cells.outcome(trial, group.lasting if lasts else group, speed, way))
                for name in ("passed", "why", "runs"):
                    del found[name]
                return SetPointLimit(speed, below, until, **found, disk_margin=margin, disk_margin_nominal=declared, weakest_plant=weakest)
            short = f"{weakest if margin <= declared else 'nominal'}: disk margin {min(declared, margin):.3f}"
        low, below = high, short
        if high == top:
            return SetPointLimit(math.nan, below)
        high += 1
        while high < top and (said := fails(high)):
            low, below, high = high, said, high + 1


def _halved(fails: Callable[[int], str], low: int, high: int, below: str) -> tuple[int, int, str]:
    """(what fails, one above, why) by bisection between what fails and what does not; where nothing failed, `low` itself is tried."""
    while high - low > 1:
        middle = (low + high) // 2
        said = fails(middle)
        low, high, below = (middle, high, said) if said else (low, middle, below)
    if below != UNTRIED or low <= 0:
        return low, high, below
    said = fails(low)
    return (low, high, said) if said else (low - 1, low, below)


def borders(
    trial: Trial, groups: Sequence[Group], ways: Sequence[str] = PROTOCOLS, cells: Cells | None = None, lower: float = 1.5, **searched: Any
) -> dict[tuple[str, str], SetPointLimit]:
    """{(group, way): the lowest set-point}; noise and errors are not expected to help by more than `HELP`. searched: further arguments of `lowest`."""
    found: dict[tuple[str, str], SetPointLimit] = {}
    cells = cells or Cells()
    for k, (group, way) in enumerate(itertools.product(groups, ways), 1):
        cells.place = f"cell {k} of {len(groups) * len(ways)}: "
        known = found["nominal", way].lowest_set_point if ("nominal", way) in found else math.nan
        low = lower if math.isnan(known) else max(known - HELP, lower)
        found[group.name, way] = lowest(trial, group, way, cells, low, **searched)
    return found


@dataclass(frozen=True)
class LowestSetPoints(Result):
    """Lowest set-points of controllers on groups of plants, the result of `lowest_set_point`.

    `print(found)` shows the table, `found["soft torque", "one_at_a_time"].lowest_set_point` is a single set-point.

    Attributes
    ----------
    initial_controller
        The controller whose stick-slip the judged controllers take over.
    entries
        {(label of the controller, name of the group, protocol): `SetPointLimit`}.
    bounds, step
        Range of set-points that was searched, and its step [rad/s].
    display_units
        {SI unit: unit that was typed}.
    situation
        The situation for which the verdict holds, in one line.

    Examples
    --------
    >>> from toolbox.drilling import LowestSetPoints, SetPointLimit
    >>> entries = {("soft torque", "nominal", "takeover"): SetPointLimit(9.5, "at 9.0 rad/s the bit sticks")}
    >>> found = LowestSetPoints("StiffPI", entries, bounds=(1.5, 14.0), step=0.5)
    >>> print(found["soft torque", "nominal"].lowest_set_point, "rad/s")
    9.5 rad/s
    """

    initial_controller: str
    entries: dict[tuple[str, ...], SetPointLimit]
    bounds: tuple[float, float]
    step: float
    display_units: Mapping[str, str] = field(default_factory=dict)
    situation: str = ""

    def check_loaded(self) -> None:
        """Rename groups and protocols of a file of an earlier version to the present names."""
        places = (("group", 1), ("protocol", 2))
        for key in list(self.entries):
            entry = self.entries.pop(key)
            now = {place: NOW.get((word, key[place]), key[place]) for word, place in places}
            self.entries[key[0], now[1], now[2]] = entry

    def __getitem__(self, key: tuple[str, ...]) -> SetPointLimit:
        """The entry of (label, group) or (label, group, protocol); the protocol is `takeover` if none is given."""
        key = key if len(key) == 3 else (*key, PROTOCOLS[0])
        for word, each, place in zip(("controller", "group", "protocol"), key, range(3), strict=True):
            known = list(dict.fromkeys(name[place] for name in self.entries))
            if each not in known:
                raise SceneError(f"There is no {word} `{each}` in this result: {now_or_near(word, each, known)}")
        return self.entries[key]

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The table as text, one row per controller, group and protocol."""
        speed, torque = reading("rad/s", self.display_units), reading("N m", self.display_units)
        heads = (
            "controller",
            "group",
            "protocol",
            f"lowest [{speed.unit}]",
            "disk margin",
            "of nominal",
            "above",
            "recovery",
            f"bit [{speed.unit}]",
        )
        price = (f"torque [{torque.unit}]", "lifts", "lifts / h", "weight off", "disturbance", "what fails below")
        lines: list[tuple[str, ...]] = [(*heads, *price)]
        for key, each in self.entries.items():
            said = [
                "none" if math.isnan(each.lowest_set_point) else " to ".join(f"{value * speed.factor:.3g}" for value in each.range),
                shown(each.disk_margin, ".2f"), shown(each.disk_margin_nominal, ".2f"),
                shown(100.0 * each.time_above_setpoint, ".1f", " %"), shown(each.recovery_time, ".0f", " s"), shown(each.max_bit_speed * speed.factor, ".3g"),
                shown(each.max_torque * torque.factor, ".3g"), shown(each.max_lifts, ".0f"), shown(each.relapses_per_hour, ".0f"),
                shown(100.0 * each.max_weight_relief, ".1f", " %"), growth_in_words(each.growth_rate),
            ]  # fmt: skip
            at_top = f"at {self.bounds[1] * speed.factor:.3g} {speed.unit}: " if math.isnan(each.lowest_set_point) else ""
            lines.append((*key, *said, at_top + each.why))
        return lines

    @property
    def answer_rows(self) -> list[tuple[str, ...]]:
        """The most important columns of `rows`: set-point and margin, recovery time, and the failure below the set-point."""
        told = [k for k in ANSWERING if k < 3 or {row[k] for row in self.rows[1:]} != {"-"}]
        return [tuple(row[k] for k in told) for row in self.rows]

    @property
    def title(self) -> str:
        """Sentence that describes the search."""
        factor, unit = reading("rad/s", self.display_units)
        low, high, step = (f"{value * factor:.3g}" for value in (*self.bounds, self.step))
        return f"Lowest set-points at which a controller ends the stick-slip under {self.initial_controller} ({low} to {high} {unit}, steps of {step} {unit})"

    def __str__(self) -> str:
        lines = self.rows
        told = [
            k for k, column in enumerate(zip(*lines[1:], strict=True)) if set(column) != {"-"}
        ]  # such as no lifts of laws that do not lift
        left = [told.index(k) for k in (0, 1, 2, len(lines[0]) - 1)]
        return "\n".join(
            [self.title, *([self.situation] if self.situation else []), *columns([tuple(row[k] for k in told) for row in lines], left=left)]
        )

    def _table(self) -> HeadedRows:
        """One row for every controller, group and protocol."""
        names = [each.name for each in dataclasses.fields(SetPointLimit)]
        return ["controller", "group", "protocol", *names], [[*key, *map(vars(each).get, names)] for key, each in self.entries.items()]

    def plot(self, ax: Any = None) -> Any:
        """Draw the lowest set-points of every controller on every group, and return the axes.

        Points of the protocol `takeover` are filled, points of `ramp` are open.

        Parameters
        ----------
        ax
            Axes to draw into. By default a new figure.
        """
        from toolbox.drilling.figures import set_point_diagram

        factor, unit = reading("rad/s", self.display_units)
        rows = [
            (label, group, way, each.lowest_set_point * factor, each.highest_set_point * factor)
            for (label, group, way), each in self.entries.items()
        ]
        return set_point_diagram(rows, self.bounds[1] * factor, unit, ax)

    def joined(self, other: LowestSetPoints) -> LowestSetPoints:
        """Return one result with the entries of this result and then of the other result.

        Parameters
        ----------
        other
            The other result, for the same loop with other groups or protocols.
        """
        return dataclasses.replace(self, entries={**self.entries, **other.entries})


def chosen_groups(trial: Trial, groups: Sequence[str | Group], margin: float | None = None) -> list[Group]:
    """Return the groups of a trial by their names, with the noise of its loop. Groups that the machine does not have are left out; groups
    given as values are kept.

    margin: disk margin that their borders have to leave.
    """
    every = machine_groups(trial.loop, dict(trial.clock.noise).get("top.speed", 0.01))
    chosen = []
    for each in groups:
        if isinstance(each, str) and each not in NAMES:
            raise SceneError(f"There is no group `{each}`: {now_or_near('group', each, NAMES)}")
        chosen += [each] if isinstance(each, Group) else [every[each]] if each in every else []
    return chosen if margin is None else [dataclasses.replace(each, min_disk_margin=margin) for each in chosen]


@takes_loop
def lowest_set_point(
    loop: ClosedLoop,
    initial_controller: Controller,
    groups: Sequence[str | Group] = NAMES,
    *,
    protocols: Sequence[str] = PROTOCOLS,
    bounds: tuple[NumberOrText, NumberOrText] = (1.5, 14.0),
    step: NumberOrText = 0.1,
    long_run: bool = True,
    checkpoint: str | Path | None = None,
    callback: Callable[[str], None] | None = None,
    executor: concurrent.futures.Executor | None = None,
) -> LowestSetPoints:
    """Find the lowest set-point at which a controller ends existing stick-slip, on the nominal drill string and on groups of other strings.

    Each test begins in the stick-slip that the initial controller has on the nominal plant at the set-point. The
    controller of the loop takes over at 8 phases of this cycle. If the nominal plant has no stick-slip at a set-point,
    the tests of all groups begin in smooth running there: use `worst_case` with `TakenOver` for a plant that still sticks.

    - Protocol `takeover`: the set-point stays constant.
    - Protocol `ramp`: the set-point is raised to 12 rad/s and lowered again.

    A test succeeds if, 80 s later, three conditions hold: the bit does not stick, the mean speed is within 2 % of the
    set-point, and the torque neither oscillates nor stays at a limit.

    The border is found by bisection and confirmed at three set-points above it. At the border it is also confirmed by a
    run of half an hour, and smooth running must be stable on every plant of the group.

    Parameters
    ----------
    loop
        A drill string with a chain of inertias and a rock, and one sampled controller of `top.torque`. The controller
        is designed again at every set-point.
    initial_controller
        The controller whose stick-slip is taken over, such as `StiffPI()`. Its `reference` follows the set-point.
    groups
        Groups of drill strings on which the controller is tested: names, or `Group` objects of your own. By default all
        six names:

        - `nominal`: the plant of the loop, without noise.
        - `noisy`: weight on bit increased by 10 %, 20 seeds of the measurement noise.
        - `one_at_a_time`: on each plant one number deviates from its declared value: the inertia of the drive by 10 or
          20 %, the inertia below the drive, the stiffness or the weight by 20 %. On one plant the commands are delayed
          instead.
        - `combined`: on each plant the inertia of the drive, the inertia below the drive and the stiffness deviate by
          20 % at once.
        - `other_rocks`: half the decay of the friction with speed. This group is left out if the friction law of the
          rock has no number `decay`.
        - `varying_weight`: noise of 2 and 5 %, a sine of 5 % at 0.17 Hz, and a heave of 10 % at 0.1 Hz, with ten time
          series each.

        The noise is the noise that the loop declares on `top.speed`, otherwise 0.01 rad/s. The additional delay on one
        plant of `one_at_a_time` is 30 ms. `toolbox.drilling.machine_groups(loop, delay=...)` gives the groups with a
        different delay.
    protocols
        "takeover", "ramp" or both. By default both.
    bounds
        Range (low, high) of set-points [rad/s], by default (1.5, 14).
    step
        Distance of neighbouring set-points [rad/s], by default 0.1. If the test fails at the highest set-point, lower
        set-points are tried in steps of 1 rad/s. So a window of successful set-points is found if it is wider than 1
        rad/s.
    long_run
        Whether a border is confirmed by a run of half an hour, by default True.
    checkpoint
        Path of a file (JSON lines) for the outcomes of single set-points. A search that was stopped continues from this
        file. By default None: no file.
    callback
        Function that is called with a line of text for every new outcome. By default none.
    executor
        Any `concurrent.futures.Executor`, such as the executor of a Dask client (`client.get_executor()`), which
        computes the runs at a set-point in parallel. By default one thread per core. For a controller in Python, by
        default one run after the other.

    Returns
    -------
    LowestSetPoints
        The border of each group and protocol, the reason for failure below it, the disk margins at it, and the cost of
        the recovery.

    Raises
    ------
    SceneError
        If the loop is not a drill string with one sampled controller, a group or a protocol is unknown, a number is not
        finite or out of range, or a controller cannot be sent to an executor.

    Notes
    -----
    The results hold for the nominal plant, noise and seeds. For a controller in Python the runs begin at
    rest, and the search is hundreds of times slower.

    Examples
    --------
    >>> from controllers import SoftTorque, StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, lowest_set_point
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(SoftTorque(reference="60 rpm"), "10 ms", delay="30 ms"))
    >>> found = lowest_set_point(loop, StiffPI(), ["nominal"], protocols=["takeover"], bounds=(4.0, 14.0), step=2.0, long_run=False)
    >>> print({key[1:]: round(limit.lowest_set_point, 1) for key, limit in found.entries.items()})
    {('nominal', 'takeover'): 10.0}
    """
    check_executor(executor)
    trial = Trial(loop, initial_controller, executor)
    typed = numbers("bounds", bounds, "rad/s")
    low, high = checked_range(typed, "bounds", "rad/s")
    asked = {**loop.display_units, **asked_units(typed)}
    grid = number("step", step, "rad/s", above=0)
    chosen = chosen_groups(trial, groups)
    for way in protocols:
        if way not in PROTOCOLS:
            raise SceneError(f"There is no protocol `{way}`: {now_or_near('protocol', way, PROTOCOLS)}")
    cells = Cells(None if checkpoint is None else Path(checkpoint), callback, asked)
    found = borders(trial, chosen, protocols, cells, low, higher=high, step=grid, lasts=long_run)
    entries: dict[tuple[str, ...], SetPointLimit] = {(trial.label, *key): each for key, each in found.items()}
    count = len(chosen[0].takeover_phases) if chosen else 0
    start = f"{count} phases of the stick-slip of the nominal plant under {type(initial_controller).__name__}, which is taken over without a jump"
    situation = Situation(
        "the plants of each group", f"started from {start}", "controller designed at each set-point", "surroundings of each group",
        f"judged from {SETTLING:g} s after the takeover on" + (", and at each border for half an hour" if long_run else ""),
    )  # fmt: skip
    return LowestSetPoints(type(initial_controller).__name__, entries, (low, high), grid, asked, str(situation))
