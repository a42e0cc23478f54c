"""Survey of a well: where the hole points at measured depths, and between them by minimum curvature."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolbox import SceneError
from toolbox.authoring import Column, NumberOrText, finite_array, in_si, number, read_table


@dataclass(frozen=True)
class Survey:
    """Survey of a borehole: measured depth, inclination from the vertical and azimuth at stations.

    Between two stations the borehole is an arc of a circle (minimum curvature): its tangent turns at a constant rate
    about one axis. Coordinates are north, east, down. In the methods `s` is an array of measured depths [m].

    Attributes
    ----------
    depth
        Measured depths of the stations [m], or text such as ("0 ft", "1 km"). The first is 0.
    inclination
        Inclinations from the vertical [rad].
    azimuth
        Azimuths [rad], from north (0) towards east (pi/2).

    Raises
    ------
    SceneError
        If there are fewer than two stations, the depths do not begin at 0 m or do not increase, or an inclination is
        outside 0 ... pi.

    Notes
    -----
    Source: textbook (minimum curvature method).

    Examples
    --------
    >>> from models import Survey
    >>> survey = Survey(depth=(0.0, 800.0, 1400.0), inclination=(0.0, 0.0, 1.0), azimuth=(0.0, 0.0, 0.0))
    >>> print(len(survey.depth), "stations")
    3 stations
    """

    depth: tuple[NumberOrText, ...]
    inclination: tuple[NumberOrText, ...]
    azimuth: tuple[NumberOrText, ...]

    def __post_init__(self) -> None:
        size = None
        for name, unit in (("depth", "m"), ("inclination", "rad"), ("azimuth", "rad")):
            given = getattr(self, name)
            values = in_si(given, unit, name) if isinstance(given, tuple | list) else given
            array = finite_array(values)
            if array is None or array.ndim != 1 or (size is not None and array.size != size):
                raise SceneError(
                    f"Argument `{name}` of Survey must be {'' if size is None else f'{size} '}finite numbers, but it is {values!r}."
                )
            size = array.size
            object.__setattr__(self, name, tuple(array.tolist()))
        fault = _fault(self.depth, self.inclination, self.azimuth)
        if fault:
            raise SceneError(f"Argument `{fault[1]}` of Survey, station {fault[0] + 1}: {fault[2]}")

    def tangent(self, s: np.ndarray) -> np.ndarray:
        """Return the unit vectors along the borehole at measured depths `s` [m], pointing downhole, shape (len(s), 3) (north, east, down).

        Parameters
        ----------
        s
            Measured depths [m], shape (n,).
        """
        _, first, last, angle, part = self._arcs(s)
        straight = angle < 1e-9  # sin ratios lose nothing down to there, and equal the linear ones
        safe = np.where(straight, 1.0, angle)
        left = np.where(straight, 1 - part, np.sin((1 - part) * safe) / np.sin(safe))
        right = np.where(straight, part, np.sin(part * safe) / np.sin(safe))
        return left[:, None] * first + right[:, None] * last

    def curvature(self, s: np.ndarray) -> np.ndarray:
        """Return the curvature vectors dt/ds [1/m] at measured depths `s` [m], towards the centre of the arc, shape (len(s), 3).

        t is the unit vector of `tangent`. The length of a curvature vector is the dogleg severity in rad/m.

        Parameters
        ----------
        s
            Measured depths [m], shape (n,).
        """
        i, first, last, angle, part = self._arcs(s)
        step = np.diff(self.depth)[i]
        straight = angle < 1e-9
        safe = np.where(straight, 1.0, angle)
        left = np.where(straight, -1.0, -safe * np.cos((1 - part) * safe) / np.sin(safe))
        right = np.where(straight, 1.0, safe * np.cos(part * safe) / np.sin(safe))
        return (left[:, None] * first + right[:, None] * last) / step[:, None]

    def inclination_at(self, s: np.ndarray) -> np.ndarray:
        """Return the inclination from the vertical [rad] at measured depths `s` [m], shape (len(s),).

        Parameters
        ----------
        s
            Measured depths [m], shape (n,).
        """
        t = self.tangent(s)
        return np.arctan2(np.hypot(t[:, 0], t[:, 1]), t[:, 2])

    def position(self, s: np.ndarray) -> np.ndarray:
        """Return the coordinates (north, east, down) [m] of the borehole at measured depths `s` [m], from its top, shape (len(s), 3).

        Parameters
        ----------
        s
            Measured depths [m], shape (n,).
        """
        s = np.atleast_1d(np.asarray(s, float))
        stations = np.asarray(self.depth)
        whole = np.vstack([np.zeros(3), np.cumsum(self._chord(stations[:-1], stations[1:]), axis=0)])
        i = self._index(s)
        return whole[i] + self._chord(stations[i], s)

    def plot(self, marks: float = 500.0) -> Any:
        """Draw the path of the well, to scale: its vertical section and its plan.

        The plane of the vertical section contains the azimuth from the wellhead to the end of the well.

        Parameters
        ----------
        marks
            Distance of the measured depths that are marked [m], by default 500.

        Returns
        -------
        numpy.ndarray
            The two axes.
        """
        from toolbox.authoring import line_styles, panels, paper

        marks = number("marks", marks, "m", above=0)
        end = self.depth[-1]
        s = np.union1d(np.linspace(0.0, end, 400), self.depth)
        marked = np.append(np.arange(0.0, end - 0.3 * marks, marks), end)
        north, east, down = self.position(s).T
        across = math.hypot(north[-1], east[-1])
        azimuth = math.atan2(east[-1], north[-1]) if across > 1e-9 * end else 0.0
        along = north * math.cos(azimuth) + east * math.sin(azimuth)
        with paper(**{"axes.titlesize": 9.0}):
            axes, look = panels(2, 3.8), line_styles(1)[0]
            for ax, x, y in ((axes[0], along, down), (axes[1], east, north)):
                ax.plot(x, y, **look)
                at = np.interp(marked, s, x), np.interp(marked, s, y)
                ax.plot(*at, marker="o", markersize=3.0, linestyle="none", color=look["color"])
                places: list[tuple[float, float]] = []
                room = 0.07 * max(np.ptp(x), np.ptp(y))
                for k in (-1, *range(marked.size - 1)):  # the end first: a label that would lie on another is left out
                    place = float(at[0][k]), float(at[1][k])
                    if all(math.dist(place, other) > room for other in places):
                        ax.annotate(f"{marked[k]:.0f} m", place, xytext=(5, 3), textcoords="offset points", fontsize=7.5, color="0.3")
                        places.append(place)
                ax.set_aspect("equal", adjustable="datalim")
                ax.margins(0.15)
            axes[0].invert_yaxis()
            axes[0].set(
                xlabel=f"along azimuth {math.degrees(azimuth) % 360:.0f}° [m]",
                ylabel="depth below the wellhead [m]",
                title="Vertical section",
            )
            axes[1].set(xlabel="east [m]", ylabel="north [m]", title="Plan")
        return axes

    def _chord(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Vectors between pairs of depths on one arc: length times tan(angle / 2) / angle times the sum of both tangents."""
        first, last = self.tangent(begin), self.tangent(end)
        angle = _angle(first, last)
        small = angle < 1e-4  # the next term of the series is 1e-18
        ratio = np.where(small, 0.5 + angle**2 / 24, np.tan(angle / 2) / np.where(small, 1.0, angle))
        return ((end - begin) * ratio)[:, None] * (first + last)

    def _index(self, s: np.ndarray) -> np.ndarray:
        return np.clip(np.searchsorted(self.depth, s, side="right") - 1, 0, len(self.depth) - 2)

    def _arcs(self, s: np.ndarray) -> tuple[np.ndarray, ...]:
        """For every depth: number of its arc, tangents at both ends, angle between them, and the part of the arc behind it."""
        s = np.atleast_1d(np.asarray(s, float))
        stations = np.asarray(self.depth)
        tangents = _tangents(self.inclination, self.azimuth)
        i = self._index(s)
        part = (s - stations[i]) / np.diff(stations)[i]
        return i, tangents[i], tangents[i + 1], _angle(tangents[i], tangents[i + 1]), part


def _tangents(inclination: tuple[float, ...], azimuth: tuple[float, ...]) -> np.ndarray:
    inc, azi = np.asarray(inclination), np.asarray(azimuth)
    return np.column_stack([np.sin(inc) * np.cos(azi), np.sin(inc) * np.sin(azi), np.cos(inc)])


def _angle(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Angle between unit vectors, accurate for small ones too."""
    return 2 * np.arctan2(np.linalg.norm(last - first, axis=1), np.linalg.norm(last + first, axis=1))


def _fault(depth: tuple[float, ...], inclination: tuple[float, ...], azimuth: tuple[float, ...]) -> tuple[int, str, str] | None:
    """(station, field, what it must be) of the first mistake."""
    for i, (s, inc) in enumerate(zip(depth, inclination, strict=True)):
        if i == 0 and s != 0:
            return i, "depth", f"the first station must be at 0 m, but it is at {s:g} m."
        if i and s <= depth[i - 1]:
            return i, "depth", f"it must be > {depth[i - 1]:g} m, the station before, but it is {s:g} m."
        if not 0 <= inc <= math.pi:
            return i, "inclination", f"it must be between 0 and 180 deg, but it is {math.degrees(inc):g} deg."
    if len(depth) < 2:
        return 0, "depth", "there must be at least two stations, but there is one."
    tangents = _tangents(inclination, azimuth)
    for i, angle in enumerate(_angle(tangents[:-1], tangents[1:]), 1):
        if angle > math.pi * (1 - 1e-6):
            return i, "inclination", "it must not turn the hole back by 180 deg, because no single arc does that."
    return None


COLUMNS = (
    Column("depth", "m", ("measured depth", "MD")),
    Column("inclination", "rad", ("inc",)),
    Column("azimuth", "rad", ("azi",)),
)
"""What a table of a survey must have."""


def read_survey(path: str | Path) -> Survey:
    r"""Read the survey of a borehole from a CSV or TOML table.

    The columns are `depth [m]` (or `MD`), `inclination [deg]` and `azimuth [deg]`. Units may differ, and the order of
    columns is free.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Survey
        The survey.

    Raises
    ------
    SceneError
        If the table cannot be read; the message names file, row and column.

    Examples
    --------
    >>> from pathlib import Path
    >>> from models import read_survey
    >>> path = Path("survey.csv")
    >>> _ = path.write_text("MD [m],Inc [deg],Azi [deg]\n0,0,0\n1000,0,45\n1600,60,45\n")
    >>> print([round(angle, 3) for angle in read_survey(path).inclination], "rad")
    [0.0, 0.0, 1.047] rad
    """
    table = read_table(path, COLUMNS)
    columns = [tuple(row[column.name] for row in table) for column in COLUMNS]
    fault = _fault(*columns)
    if fault:
        raise table.error(*fault)
    return Survey(*columns)


def hole_of(given: Path | str | Survey, bottom: float) -> Survey:
    """Return the survey, given as a value or as the path of its table. SceneError is raised for anything else, and for a survey that ends
    above the bottom [m]."""
    survey = read_survey(given) if isinstance(given, (str, Path)) else given
    if not isinstance(survey, Survey):
        raise SceneError(f"Argument `survey` must be the path of a table or a Survey, but it is {given!r}.")
    if survey.depth[-1] < bottom - 1e-6 * bottom:
        where = f" `{given}`" if isinstance(given, (str, Path)) else ""
        raise SceneError(
            f"Argument `survey`{where} must reach the end of the string at {bottom:g} m, but its last station is at {survey.depth[-1]:g} m."
        )
    return survey
