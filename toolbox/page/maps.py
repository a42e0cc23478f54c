"""The map around the working point: speed over load with both borders, coarse at first and then finer, until nobody looks any more."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.errors import SceneError, SimulationError
from toolbox.halving import halved
from toolbox.messages import at_every_step
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.onsets.map_loop import STICK_SLIP
from toolbox.onsets.regions import outlines
from toolbox.onsets.severity_map import SeverityMap, severity_map
from toolbox.page.controls import Control
from toolbox.simulation.request import Request, accuracy_of

STAGES = ((5, 1), (9, 1), (17, 2), (33, 2))
"""(points along both axes, halvings of the edges across a border) of the maps, one after the other."""

MARGIN = 0.08
"""Lowest value of an axis that begins at zero, in parts of its highest one."""


def axes_of(controls: Sequence[Control]) -> list[str]:
    """Names of the numbers of a map: a set-point or a speed, and a load; the first of each kind, fewer than two where there are none."""
    able = [control for control in controls if control.number.kind.borders and control.number.overridden is None]
    found: list[str] = []
    for kinds in (("rad/s", "m/s"), ("N",), ("N m",), ("1",)):
        some = [each.number.name for each in able if each.number.unit in kinds and each.number.value != 0.0 and not each.of_law]
        found += some[:1]
    return found[:2]


def drawn(
    loop: ClosedLoop,
    over: Mapping[str, tuple[float, float]],
    readings: Mapping[str, tuple[float, str]],
    stage: tuple[int, int],
    step: Callable[[], None],
) -> dict[str, Any]:
    """The map of a loop over two ranges, in SI, as the page draws it, or the error why there is none.

    readings: {name: (factor, unit)} of the answer;  stage: one of `STAGES`;  step: called at every run; what it raises ends the work.
    """
    points, halvings = stage
    try:
        with at_every_step(step):
            found = severity_map(loop, over, shape=(points, points), halvings=halvings)
    except (SceneError, SimulationError) as refusal:
        return {"error": str(refusal)}
    return told(found, readings) | {"points": points, "last": stage == STAGES[-1]}


def told(found: SeverityMap, readings: Mapping[str, tuple[float, str]]) -> dict[str, Any]:
    """Return a map for the page: the region of each point, the borders, and two areas as polygons up to the borders, for lasting stick-slip
    and for lost smooth running."""
    factors = [readings[name][0] for name in found.names]
    regions = found.regions
    names = [*regions]
    where = np.zeros(found.growth.shape, int)
    for k, name in enumerate(names):
        where[regions[name]] = k
    segments = {name: rows[np.isfinite(rows).all(axis=(1, 2))] for name, rows in found.borders.items()}
    lasting, lost = found.sticking.verdict == STICK_SLIP, found.smooth.verdict == STICK_SLIP
    areas = {"bistable": (lasting | lost, segments["sticking"]), "stick-slip": (lost, segments["smooth"])}
    return {
        "names": [*found.names], "units": [readings[name][1] for name in found.names],
        "axes": [_rounded(axis * factor) for axis, factor in zip(found.axes, factors, strict=True)],
        "regions": names, "where": where.tolist(), "borders": {name: _rounded(rows * factors) for name, rows in segments.items()},
        "areas": {name: [_rounded(each * factors) for each in outlines(found.axes, inside, border)] for name, (inside, border) in areas.items()},
        "notes": [*found.notes],
    }  # fmt: skip


def _rounded(values: Any) -> list[Any]:
    """Numbers to seven digits of the largest, which is more than a screen shows."""
    values = np.asarray(values, float)
    digits = 7 - int(np.ceil(np.log10(np.abs(values).max(initial=1e-300))))
    return np.round(values, digits).tolist()


def ranges(controls: Mapping[str, Control], names: Sequence[str], loop: ClosedLoop) -> dict[str, tuple[float, float]]:
    """Return the ranges of a map in SI: the ranges of the sliders, without zero, at which no machine runs smoothly, and within the values
    that the plant accepts.

    loop: the setting, from whose values on an end counts that the machine bears, such as a kinetic friction below the static one.
    """
    found = {}
    for name in names:
        control = controls[name]
        low, high = control.low / control.read.factor, control.high / control.read.factor
        ends = (max(low, MARGIN * high) if low >= 0.0 else low, high if high > 0.0 else min(high, MARGIN * low))
        found[name] = (_borne(loop, name, ends[0]), _borne(loop, name, ends[1]))
    return found


def _borne(loop: ClosedLoop, name: str, end: float) -> float:
    """The end of a range, or where the machine does not bear it, the value next to it that it bears, to a hundredth of its way from the setting."""
    value = loop.number(name).value
    if not math.isfinite(value) or _bears(loop, name, end):
        return end
    part, _ = halved(lambda part: not _bears(loop, name, value + part * (end - value)), 0.0, 1.0, 0.0, 0.01)
    return value + part * (end - value)


def _bears(loop: ClosedLoop, name: str, value: float) -> bool:
    try:
        Request(loop.at(name, value), 0.0, accuracy=accuracy_of(loop)).checked()
    except SceneError:
        return False
    return True
