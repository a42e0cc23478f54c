"""Torque and drag: what the wall of a hole takes from a drill string that is pulled, lowered or turned, and how far down a string moves that is held.

A soft string with tension T and torque M lies on its hole with the side force per length n of `models.soft_string`. It moves along the hole at v,
downwards, and turns at w; friction is against both under one cone:

    dT/ds = -weight d.t + mu n v / u ,    dM/ds = -mu n R (R w) / u ,    u = sqrt(v^2 + (R w)^2)

R is the radius that rubs. Where less is applied at the top than the whole string needs, its upper part slides, with all its friction, and the lower part
stays as it lay. Source: C. A. Johancsik, D. B. Friesen, R. Dawson, J. Petroleum Technology 36 (1984) 987-992; range: no buckling, no clearance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from models.friction_factors import FrictionFactors
from models.sections import Section, sections_of
from models.survey import Survey, hole_of
from toolbox import SceneError
from toolbox.authoring import NumberOrText, Result, columns, html_table, new_names_only, number, reading, suggest

STEP = 5.0
"""Longest step over depth [m]."""


@dataclass(frozen=True)
class TorqueDrag(Result):
    """Tension and torque along a drill string in its borehole, from the top down: the result of `torque_drag`. The
    method `plot` draws both.

    Attributes
    ----------
    depth
        Measured depths [m], shape (n,).
    tension
        Effective tension [N], shape (n,), negative in compression. The first value is the hook load without the weight of
        hook and block.
    frictionless_tension
        Effective tension [N] without friction along the borehole, shape (n,).
    torque
        Torque in the string [N m], shape (n,). The first value is the torque of the top drive.
    side_force
        Force between string and borehole [N/m], shape (n,).
    sliding_front
        Measured depth above which the string moves against the borehole, and below which friction holds it at rest [m].
        The length of the string if the whole string moves.
    twist
        Angle by which the top is ahead of the bit [rad].
    bit_static
        Whether the whole string above the bit moves, but the bit does not turn, because the torque that reaches the bit
        is below the torque of the rock.

    Examples
    --------
    >>> from models import Section, Survey, torque_drag
    >>> pipe = Section(length="2000 m", outer="5 in", inner="4.276 in")
    >>> survey = Survey(depth=(0.0, 800.0, 1400.0, 2000.0), inclination=(0.0, 0.0, 1.0, 1.0), azimuth=(0.0, 0.0, 0.0, 0.0))
    >>> found = torque_drag([pipe], survey, friction=0.25, axial_speed=-0.2)
    >>> print(f"drag {found.drag / 1e3:.0f} kN, the whole string moves: {found.is_moving}")
    drag 62 kN, the whole string moves: True
    """

    depth: np.ndarray
    tension: np.ndarray
    frictionless_tension: np.ndarray
    torque: np.ndarray
    side_force: np.ndarray
    sliding_front: float
    twist: float
    bit_static: bool = False

    @property
    def is_moving(self) -> bool:
        """Whether the whole string moves, including the bit."""
        return self.sliding_front >= float(self.depth[-1]) and not self.bit_static

    @property
    def is_sliding(self) -> np.ndarray:
        """For each entry of `depth`: True if the string moves against the borehole there, False if friction holds it at rest there. Shape (n,)."""
        return self.depth <= self.sliding_front

    @property
    def neutral_point(self) -> float:
        """Neutral point: measured depth below which the string is in compression down to the bit [m]. The length of the string if there is no
        compression.
        """
        pulled = np.flatnonzero(self.tension >= 0.0)
        return float(self.depth[pulled[-1]]) if pulled.size else 0.0

    @property
    def drag(self) -> float:
        """Drag: contribution of friction along the borehole to the hook load [N]. It is negative while the string is lowered."""
        return float(self.tension[0] - self.frictionless_tension[0])

    def __str__(self) -> str:
        moving = "all of it slides" if self.is_moving else f"it slides above {self.sliding_front:.4g} m and is stuck below"
        if self.bit_static:
            moving = "it slides down to the bit, which the rock holds"
        rows = [
            ("at the top", "", ""),
            ("hook load", f"{self.tension[0] / 1e3:.4g}", "kN"),
            ("of which drag", f"{self.drag / 1e3:.4g}", "kN"),
            ("torque", f"{self.torque[0] / 1e3:.4g}", "kN m"),
            ("turns ahead of the bit", f"{self.twist / (2.0 * math.pi):.3g}", ""),
        ]
        return "\n".join([f"String of {self.depth[-1]:.5g} m: {moving}", *columns(rows)])

    __repr__ = __str__

    def _table(self) -> tuple[Sequence[str], Sequence[Sequence[Any]]]:
        """One row per depth."""
        heads = ["depth [m]", "tension [N]", "frictionless tension [N]", "torque [N m]", "side force [N/m]", "is sliding"]
        rows = zip(self.depth, self.tension, self.frictionless_tension, self.torque, self.side_force, self.is_sliding, strict=True)
        return heads, [[*map(float, row[:-1]), int(row[-1])] for row in rows]

    def plot(self, label: str = "", axes: Any = None) -> Any:
        """Draw tension and torque over depth, and shade the part of the string that is at rest.

        Parameters
        ----------
        label
            Name of the motion of the string, for the legend, by default empty.
        axes
            The two axes of an earlier figure, to which another motion of the same string is added. By default None: a
            new figure.

        Returns
        -------
        numpy.ndarray
            The two axes: tension and torque. An axis has no curve of this motion if the tension is the same as without
            friction, or if the torque is 0 everywhere.
        """
        from toolbox.authoring import line_styles, name_axis, panels, paper

        with paper():
            if axes is None:
                axes = panels(2, 4.0, sharey=True)
                axes[0].plot(self.frictionless_tension, self.depth, color="0.6", linewidth=1.0, label="without drag")
                axes[0].set(ylim=(self.depth[-1], 0.0), ylabel="measured depth [m]")
                for ax in axes:
                    ax.axvline(0.0, color="0.85", linewidth=0.7, zorder=0)
            drawn = len({line.get_label() for ax in axes for line in ax.get_lines() if line.get_gid() == "motion"})
            look = line_styles(5)[drawn % 5]
            parts = ((axes[0], self.tension, self.tension - self.frictionless_tension), (axes[1], self.torque, self.torque))
            for ax, values, of_motion in parts:
                if not of_motion.any():
                    continue
                ax.plot(values, self.depth, label=label or "this motion", gid="motion", **look)
                if self.sliding_front < self.depth[-1]:
                    ax.axhspan(
                        self.sliding_front, self.depth[-1], facecolor="0.90", zorder=-1, label=f"stuck, {label}" if label else "stuck"
                    )
            name_axis(axes[0].xaxis, "effective tension", "N")
            name_axis(axes[1].xaxis, "torque", "N m")
            handles = {label: each for ax in axes for each, label in zip(*ax.get_legend_handles_labels(), strict=True)}
            legend = axes[0].figure.legends
            if legend:
                legend[0].remove()
            axes[0].figure.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=4, frameon=False)
        return axes


@new_names_only
def torque_drag(
    sections: Path | str | Sequence[Section],
    survey: Path | str | Survey,
    friction: float | Sequence[Sequence[NumberOrText]],
    *,
    axial_speed: Annotated[NumberOrText, "m/s"] = 0.0,
    turning_speed: Annotated[NumberOrText, "rad/s"] = 0.0,
    load_at_top: NumberOrText | None = None,
    mud_density: Annotated[NumberOrText, "kg/m3"] = 0.0,
    weight_on_bit: Annotated[NumberOrText, "N"] = 0.0,
    bit_torque: Annotated[NumberOrText, "N m"] = 0.0,
    overpull: Annotated[NumberOrText, "N"] = 0.0,
) -> TorqueDrag:
    """Compute torque and drag of a drill string that moves in its borehole.

    Under a given load at the top, only the upper part of the string may move.

    Parameters
    ----------
    sections
        Sections of the string, top first, or the path of a table that `read_sections` reads.
    survey
        Survey of the borehole, or the path of a table that `read_survey` reads.
    friction
        Friction factor: coefficient of friction mu between string and borehole [1], >= 0. Or pairs (depth, factor) from
        the top, if it differs over depth: each factor holds down to its measured depth [m]. The last depth must reach
        the end of the string: `[("2200 m", 0.2), ("3800 m", 0.3)]` for a casing above an open hole.
    axial_speed
        Speed along the borehole [m/s], positive downwards, negative while the string is pulled, by default 0.
    turning_speed
        Speed of rotation [rad/s], by default 0. Only the ratio of both speeds matters.
    load_at_top
        Hook load [N], or torque [N m] for rotation, that acts at the top of a string that was at rest before and either
        slides or rotates. If this load is too small to move the whole string, only the part above some depth moves. By
        default the whole string moves.
    mud_density
        Density of the mud for buoyancy [kg/m3], by default 0.
    weight_on_bit
        Weight on bit [N], by default 0.
    bit_torque
        Torque on bit [N m], if the whole string turns, by default 0.
    overpull
        Tension at the bit of a string that is stuck there and pulled [N], by default 0.

    Returns
    -------
    TorqueDrag
        Tension and torque over depth, integrated in steps of at most 5 m with a method of fourth order.

    Raises
    ------
    SceneError
        If a table is bad, an argument is out of range, `axial_speed` and `turning_speed` are both 0, or `load_at_top` is
        given with both speeds or acts in the other direction than the speed.

    Examples
    --------
    >>> from models import Section, Survey, torque_drag
    >>> pipe = Section(length="2000 m", outer="5 in", inner="4.276 in")
    >>> survey = Survey(depth=(0.0, 800.0, 1400.0, 2000.0), inclination=(0.0, 0.0, 1.0, 1.0), azimuth=(0.0, 0.0, 0.0, 0.0))
    >>> found = torque_drag([pipe], survey, friction=0.25, axial_speed=-0.2)
    >>> print(f"hook load while pulling {found.tension[0] / 1e3:.0f} kN")
    hook load while pulling 489 kN
    """
    pipes = sections_of(sections)
    length = sum(section.length for section in pipes)
    hole = hole_of(survey, length)
    profile = FrictionFactors.of("friction", friction, length)
    v, w = number("axial_speed", axial_speed, "m/s"), number("turning_speed", turning_speed, "rad/s")
    if v == 0 and w == 0:
        raise SceneError("Arguments `axial_speed` and `turning_speed` must not both be 0: at rest friction is whatever holds.")
    mud = number("mud_density", mud_density, "kg/m3", at_least=0, at_most=min(section.density for section in pipes))
    load = number("weight_on_bit", weight_on_bit, "N", at_least=0)
    rock = number("bit_torque", bit_torque, "N m", at_least=0)
    pulled = number("overpull", overpull, "N", at_least=0)
    if load and pulled:
        raise SceneError(
            f"Arguments `weight_on_bit` and `overpull` must not both be given, because a bit is pushed or pulled, but they are {load:g} N and {pulled:g} N."
        )
    load -= pulled
    string = LoadedString(pipes, hole, mud, profile.depths)
    factors = profile.at(0.5 * (string.depth[:-1] + string.depth[1:]))
    hanging = string.moved(0.0, v, w, load, 0.0)[0]  # by the same steps, so that a drag of nothing is 0
    pulls, torques = string.moved(factors, v, w, load, math.copysign(rock, w) if w else 0.0)
    front, needed = length, float(torques[-1])
    if load_at_top is not None:
        pulls, torques, front = _partly(string, hanging, pulls, torques, factors, v, w, load_at_top)
    side = string.side_force(pulls)
    rigidity = string.along([section.torsional_rigidity for section in pipes])
    twist = float(np.sum(np.diff(string.depth) * 0.5 * (torques[1:] + torques[:-1]) / rigidity))
    held = front == length and abs(float(torques[-1])) < abs(needed)
    return TorqueDrag(string.depth, pulls, hanging, torques, side, front, twist, held)


def _partly(
    string: LoadedString,
    hanging: np.ndarray,
    pulls: np.ndarray,
    torques: np.ndarray,
    friction: np.ndarray,
    v: float,
    w: float,
    load_at_top: NumberOrText,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Tension, torque and front of a string of which only the part moves that what is applied at the top can move."""
    if v and w:
        raise SceneError("Argument `load_at_top` must come with one motion, along the hole or around it, but both are given.")
    name, unit, lay, moved = ("hook load", "N", hanging, pulls) if v else ("torque", "N m", np.zeros(string.depth.size), torques)
    applied = number("load_at_top", load_at_top, unit)
    way = math.copysign(1.0, moved[0] - lay[0]) if moved[0] != lay[0] else (math.copysign(1.0, -v) if v else math.copysign(1.0, w))
    if way * (applied - lay[0]) < 0:
        side = "above" if way > 0 else "below"
        raise SceneError(
            f"Argument `load_at_top` must be a {name} {side} {lay[0]:.6g} {unit}, that of the string at rest, but it is {applied:g} {unit}."
        )
    if way * (applied - moved[0]) >= 0:
        return pulls, torques, float(string.depth[-1])
    found, front = string.from_the_top(friction, v, w, applied, lay, hanging, way)
    return (found, torques * 0.0, front) if v else (hanging, found, front)


class LoadedString:
    """What does not depend on the motion, at nodes over depth and at the middle of every step: tangent, curvature, weight, radius."""

    def __init__(self, pipes: Sequence[Section], hole: Survey, mud: float, breaks: Sequence[float] = (), step: float = STEP):
        ends = np.cumsum([0.0, *(section.length for section in pipes)])
        corners = np.unique(np.concatenate([ends, [each for each in (*hole.depth, *breaks) if each < ends[-1]]]))
        parts = np.maximum(1, np.ceil(np.diff(corners) / step)).astype(int)
        self.depth = np.concatenate(
            [*(np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(corners, corners[1:], parts, strict=False)), corners[-1:]]
        )
        above, below = self.depth[:-1], self.depth[1:]
        self.of = np.searchsorted(ends, above, side="right") - 1  # the section of every step
        inside = np.stack([above, 0.5 * (above + below), np.nextafter(below, above)])  # a step ends before what changes at its end
        self.tangent = np.stack([hole.tangent(s) for s in inside])
        self.curvature = np.stack([hole.curvature(s) for s in inside])
        self.weight = self.along([section.weight(mud) for section in pipes])
        self.radius = self.along([section.contact_radius for section in pipes])
        self.across = self.weight[:, None] * (np.array([0.0, 0.0, 1.0]) - self.tangent[..., 2:] * self.tangent)

    def at_the_top(self, profile: FrictionFactors, v: float, w: float) -> tuple[float, float]:
        """Return hook load [N] and torque [N m] of the string off bottom that moves along the hole at v and turns at w."""
        pulls, torques = self.moved(profile.at(0.5 * (self.depth[:-1] + self.depth[1:])), v, w, 0.0, 0.0)
        return float(pulls[0]), float(torques[0])

    def along(self, values: Sequence[float]) -> np.ndarray:
        """The value of the section of every step."""
        return np.asarray(values, float)[self.of]

    def side_force(self, pulls: np.ndarray) -> np.ndarray:
        """Force per length between string and hole at every node, that of the step below it [N/m]."""
        force = np.linalg.norm(self.across[0] + pulls[:-1, None] * self.curvature[0], axis=1)
        last = np.linalg.norm(self.across[2, -1] + pulls[-1] * self.curvature[2, -1])
        return np.append(force, last)

    def _slope(self, friction: float | np.ndarray, v: float, w: float) -> Callable[[int, int, float], tuple[float, float]]:
        """(place in the step, step, tension) -> dT/ds and dM/ds."""
        speed = np.hypot(v, self.radius * w)
        along, around = (friction * v / speed).tolist(), (friction * self.radius * (self.radius * w) / speed).tolist()
        down = (self.weight * self.tangent[..., 2]).tolist()
        first, second, third = (np.einsum("psk,psk->ps", a, b).tolist() for a, b in
                                ((self.across, self.across), (self.across, self.curvature), (self.curvature, self.curvature)))  # fmt: skip

        def slope(place: int, k: int, pull: float) -> tuple[float, float]:
            side = math.sqrt(max(first[place][k] + 2.0 * pull * second[place][k] + pull * pull * third[place][k], 0.0))
            return -down[place][k] + along[k] * side, -around[k] * side

        return slope

    def moved(self, friction: float | np.ndarray, v: float, w: float, load: float, rock: float) -> tuple[np.ndarray, np.ndarray]:
        """Tension and torque of the string that moves as a whole, from the bit upwards."""
        slope = self._slope(friction, v, w)
        pulls, torques = [-load], [rock]
        for k in reversed(range(self.depth.size - 1)):
            pull, torque = _stepped(slope, k, pulls[-1], float(self.depth[k] - self.depth[k + 1]))
            pulls.append(pull)
            torques.append(torques[-1] + torque)
        return np.array(pulls[::-1]), np.array(torques[::-1])

    def from_the_top(
        self, friction: np.ndarray, v: float, w: float, applied: float, lay: np.ndarray, hanging: np.ndarray, way: float
    ) -> tuple[np.ndarray, float]:
        """What is applied at the top, less the friction above, down to the front where it is what the string had when it lay; and that front."""
        slope = self._slope(friction, v, w)
        found, value = lay.copy(), applied
        for k in range(self.depth.size - 1):
            found[k] = value
            step = float(self.depth[k + 1] - self.depth[k])
            pull, torque = _stepped(slope, k, value if v else float(hanging[k]), step)
            after = pull if v else value + torque
            if way * (after - lay[k + 1]) <= 0:
                excess = way * (value - lay[k]), way * (after - lay[k + 1])
                return found, float(self.depth[k]) + step * excess[0] / max(excess[0] - excess[1], 1e-300)
            value = after
        found[-1] = value
        return found, float(self.depth[-1])


def _stepped(slope: Callable[[int, int, float], tuple[float, float]], k: int, pull: float, step: float) -> tuple[float, float]:
    """Tension behind a step of fourth order, downwards or with a negative length upwards, and what the torque changes by."""
    begin, end = (0, 2) if step > 0 else (2, 0)
    first = slope(begin, k, pull)
    second = slope(1, k, pull + 0.5 * step * first[0])
    third = slope(1, k, pull + 0.5 * step * second[0])
    fourth = slope(end, k, pull + step * third[0])
    pulled, turned = (step * (a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(first, second, third, fourth, strict=True))
    return pull + pulled, turned


@dataclass(frozen=True)
class TorqueDragOperations(Result):
    """Torque and drag of one string in the usual operations of a rig.

    The function `torque_drag_operations` returns such a result. With the name `found` for it, `found["picking up"]` is
    the `TorqueDrag` of the operation "picking up".

    Attributes
    ----------
    operations
        {operation: torque and drag along the string}.
    friction
        Friction factors as pairs (measured depth [m], factor). Each factor holds from the previous depth down to its
        depth.
    display_units
        {SI unit: unit in which the input was given}.

    Examples
    --------
    >>> from models import Section, Survey, torque_drag_operations
    >>> pipe = Section(1000.0, "5 in", "4.276 in")
    >>> found = torque_drag_operations([pipe], Survey((0.0, 1000.0), (0.5, 0.5), (0.0, 0.0)), friction=0.3)
    >>> print(f"{found['picking up'].drag / 1e3:.1f} kN of drag while picking up")
    37.7 kN of drag while picking up
    """

    operations: Mapping[str, TorqueDrag]
    friction: tuple[tuple[float, float], ...]
    display_units: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> TorqueDrag:
        if name not in self.operations:
            raise SceneError(f"There is no operation `{name}`: {suggest(name, self.operations)}")
        return self.operations[name]

    def _rows(self) -> tuple[str, list[tuple[str, ...]]]:
        """(friction factors in a sentence, rows of the table of operations with its heads first)."""
        units = {"N": "kN", "N m": "kN m", **self.display_units}
        force, torque, length = (reading(unit, units) for unit in ("N", "N m", "m"))
        heads = ("operation", f"hook load [{force.unit}]", f"drag [{force.unit}]", f"torque at the top [{torque.unit}]", "string")
        rows: list[tuple[str, ...]] = [heads]
        for name, each in self.operations.items():
            moves = "moves" if each.is_moving else f"moves above {each.sliding_front * length.factor:.4g} {length.unit}"
            if each.tension.min() < 0.0 and name != "rotating on bottom":
                moves += f", in compression below {each.neutral_point * length.factor:.4g} {length.unit}"
            rows.append(
                (
                    name,
                    f"{each.tension[0] * force.factor:.4g}",
                    f"{each.drag * force.factor:.4g}",
                    f"{each.torque[0] * torque.factor:.4g}",
                    moves,
                )
            )
        above, spans = 0.0, []
        for depth, factor in self.friction:
            spans.append(f"{factor:.4g} from {above * length.factor:.4g} to {depth * length.factor:.4g} {length.unit}")
            above = depth
        return f"Friction factor {', '.join(spans)}; hook load without the weight of hook and block; no buckling.", rows

    def __str__(self) -> str:
        note, rows = self._rows()
        return "\n".join(["Torque and drag", f"  {note}", *columns(rows, left=(0, 4))])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        note, (heads, *rows) = self._rows()
        return html_table("Torque and drag", heads, rows, [note])

    def _table(self) -> tuple[Sequence[str], Sequence[Sequence[Any]]]:
        """One row per operation and depth."""
        rows: list[Sequence[Any]] = []
        heads: Sequence[str] = ()
        for name, each in self.operations.items():
            heads, own = each._table()
            rows += [[name, *row] for row in own]
        return ["operation", *heads], rows

    def plot(self) -> Any:
        """Draw tension and torque of all operations over depth, and return the two axes."""
        from toolbox.authoring import line_styles, name_axis, panels, paper

        with paper():
            axes = panels(2, 4.3, sharey=True)
            looks = [*line_styles(5), {**line_styles(5)[2], "linestyle": (0, (6, 1, 1, 1, 1, 1))}]
            for (name, each), look in zip(self.operations.items(), looks, strict=False):
                axes[0].plot(each.tension, each.depth, label=name, **look)
                if each.torque.any():
                    axes[1].plot(each.torque, each.depth, **look)
            depth = next(iter(self.operations.values())).depth
            axes[0].set(ylim=(depth[-1], 0.0))
            for ax in axes:
                ax.axvline(0.0, color="0.85", linewidth=0.7, zorder=0)
                for end, _ in self.friction[:-1]:
                    ax.axhline(end, color="0.6", linewidth=0.7, linestyle=(0, (1, 2)), zorder=0)
            name_axis(axes[0].yaxis, "measured depth", "m", self.display_units)
            name_axis(axes[0].xaxis, "effective tension", "N", self.display_units)
            name_axis(axes[1].xaxis, "torque", "N m", self.display_units)
            handles, labels = axes[0].get_legend_handles_labels()
            axes[0].figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
        return axes


def torque_drag_operations(
    sections: Path | str | Sequence[Section],
    survey: Path | str | Survey,
    friction: float | Sequence[Sequence[NumberOrText]],
    *,
    mud_density: Annotated[NumberOrText, "kg/m3"] = 0.0,
    weight_on_bit: Annotated[NumberOrText, "N"] = 0.0,
    bit_torque: Annotated[NumberOrText, "N m"] = 0.0,
    overpull: Annotated[NumberOrText, "N"] = 0.0,
    display_units: Mapping[str, str] | None = None,
) -> TorqueDragOperations:
    """Compute torque and drag of a string in the usual operations of a rig.

    In each operation the whole string moves along the borehole, or rotates in it, and friction acts against this motion:

    - "rotating on bottom", if a weight or a torque on bit is given, and "rotating off bottom";
    - "picking up" (the string moves upwards) and "slacking off" (downwards);
    - "sliding with weight on bit" (downwards without rotation), if a weight on bit is given;
    - "pulling on a stuck bit" (upwards), if an overpull is given.

    Parameters
    ----------
    sections
        Sections of the string, top first, or the path of a table that `read_sections` reads.
    survey
        Survey of the borehole, or the path of a table that `read_survey` reads.
    friction
        Friction factor: coefficient of friction between string and borehole [1], >= 0. Or pairs (depth, factor) from
        the top: each factor holds down to its measured depth [m], and the last depth must reach the end of the string.
    mud_density
        Density of the mud for buoyancy [kg/m3], by default 0.
    weight_on_bit
        Weight on bit on bottom [N], by default 0.
    bit_torque
        Torque on bit on bottom [N m], by default 0.
    overpull
        Tension at a stuck bit [N]. By default 0: this operation is left out.
    display_units
        {SI unit: unit in which tables show the quantity}, such as {"N": "klbf"}. By default the units in which the
        input was given.

    Returns
    -------
    TorqueDragOperations
        The operations by name: `found["picking up"]` is a `TorqueDrag`, with the hook load `tension[0]` [N], the
        contribution `drag` of the friction to it [N], and the torque at the top `torque[0]` [N m]. `plot()` draws tension
        and torque over depth.

    Raises
    ------
    SceneError
        If a table is bad, the survey or the friction factors end above the lower end of the string, or an argument is
        out of range.

    Examples
    --------
    >>> from models import Section, Survey
    >>> from models.torque_and_drag import torque_drag_operations
    >>> survey = Survey(depth=(0.0, 800.0, 1400.0, 2000.0), inclination=(0.0, 0.0, 1.0, 1.0), azimuth=(0.0, 0.0, 0.0, 0.0))
    >>> pipe = Section(length="2000 m", outer="5 in", inner="4.276 in")
    >>> found = torque_drag_operations([pipe], survey, [("1200 m", 0.2), ("2000 m", 0.3)])
    >>> print(f"{found['picking up'].tension[0] / 1e3:.0f} kN")
    491 kN
    """
    load = number("weight_on_bit", weight_on_bit, "N", at_least=0)
    rock = number("bit_torque", bit_torque, "N m", at_least=0)
    on_bottom = {"rotating on bottom": {"turning_speed": 1.0, "weight_on_bit": load, "bit_torque": rock}}
    asked: dict[str, dict[str, Any]] = (on_bottom if load or rock else {}) | {
        "rotating off bottom": {"turning_speed": 1.0},
        "picking up": {"axial_speed": -1.0},
        "slacking off": {"axial_speed": 1.0},
    }
    if load:
        asked["sliding with weight on bit"] = {"axial_speed": 1.0, "weight_on_bit": load}
    if number("overpull", overpull, "N", at_least=0):
        asked["pulling on a stuck bit"] = {"axial_speed": -1.0, "overpull": overpull}
    pipes = sections_of(sections)
    length = sum(section.length for section in pipes)
    hole = hole_of(survey, length)
    found = {name: torque_drag(pipes, hole, friction, mud_density=mud_density, **each) for name, each in asked.items()}
    profile = FrictionFactors.of("friction", friction, length)
    spans = tuple(zip((*profile.depths[:-1], length), profile.factors, strict=True))
    return TorqueDragOperations(found, spans, dict(display_units or {}))
