"""Pictures of frequency responses and of margins over two gains: Bode, Nyquist, Nichols, stability chart, describing function.

Every function takes the value that it draws, a `FrequencyResponse`, a `StabilityChart` or a `DescribingFunction`.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from toolbox.figures.curves import nearest_known
from toolbox.figures.style import LINES, WIDTH, drawn_on, in_words, name_axis


def bode_diagram(found: Any, axes: Any = None) -> Any:
    """Gain and phase over frequency, with the margins as arrows from the response to the border; returns both axes."""
    with drawn_on(axes, 2, 1, height=4.4, sharex=True) as axes:
        gains, phases = axes
        for i, (name, value) in enumerate(found.values.items()):
            style, gain, phase = LINES[i % len(LINES)], np.abs(value), _phase(value)
            gains.loglog(found.omega, gain, label=in_words(name), **style)
            phases.semilogx(found.omega, phase, **style)
            crossings = _gain_crossings(found.omega, gain, phase)
            for at, distance in sorted(crossings, key=lambda each: abs(each[1][1] - each[1][0]))[:1]:
                phases.annotate("", (at, distance[0]), (at, distance[1]), arrowprops={"arrowstyle": "<->", "color": style["color"]})
                phases.annotate(f" {abs(distance[1] - distance[0]):.3g}°", (at, sum(distance) / 2), fontsize=8.0)
            sizes = sorted(_phase_crossings(found.omega, gain, phase), key=lambda each: abs(math.log(each[1])))
            for at, size in [*[each for each in sizes if each[1] < 1.0][:1], *[each for each in sizes if each[1] > 1.0][:1]]:
                gains.annotate("", (at, size), (at, 1.0), arrowprops={"arrowstyle": "<->", "color": style["color"]})
                gains.annotate(f" × {1 / size:.3g}", (at, math.sqrt(size)), fontsize=8.0)
        near = [at for value in found.values.values() for at in found.omega[(np.abs(value) > 0.03) & (np.abs(value) < 30.0)]]
        if near:
            gains.set_xlim(max(0.5 * min(near), found.omega[0]), min(2.0 * max(near), found.omega[-1]))
        gains.axhline(1.0, color="0.6", linewidth=0.7, zorder=0)
        shown = [
            _phase(value)[(found.omega >= gains.get_xlim()[0]) & (found.omega <= gains.get_xlim()[1])] for value in found.values.values()
        ]
        low, high = min(-225.0, *(each.min() - 20.0 for each in shown)), max(0.0, *(each.max() + 20.0 for each in shown))
        phases.set(
            ylim=(max(low, -1000.0), high), yticks=np.arange(math.ceil(max(low, -1000.0) / 90.0), math.floor(high / 90.0) + 1) * 90.0
        )
        for turn in range(math.ceil((low + 180.0) / 360.0), math.floor((high + 180.0) / 360.0) + 1):
            phases.axhline(360.0 * turn - 180.0, color="0.6", linewidth=0.7, zorder=0)
        gains.set(ylabel="gain of $L$ [1]", ylim=(0.01, 100.0))
        phases.set(xlabel="frequency [rad/s]", ylabel="phase of $L$ [deg]")
        gains.legend(frameon=False, loc="upper right")
        gains.set_title(_words(found), fontsize=8.5, loc="left")
    return axes


def nyquist_diagram(found: Any, ax: Any = None) -> Any:
    """The response in the complex plane and the disk around -1 that it does not enter; returns the axes."""
    with drawn_on(ax, height=0.65 * WIDTH, width=0.65 * WIDTH) as ax:
        reach = 2.5
        for i, (name, value) in enumerate(found.values.items()):
            style, row = LINES[i % len(LINES)], found.margins[name]
            ax.plot(value.real, value.imag, label=in_words(name), **style)
            ax.plot(value.real, -value.imag, **{**style, "linewidth": 0.5})
            if 0.0 < row.disk_margin < 2.0:
                low, high = row.disk_gains
                reach = max(reach, min(1.3 * high, 8.0))
                disk = plt.Circle(
                    (-(low + high) / 2, 0.0), (high - low) / 2, facecolor="0.88", edgecolor=style["color"], linewidth=0.8, zorder=0
                )
                ax.add_patch(disk)
        ax.plot([-1.0], [0.0], marker="+", color="black", markersize=9, markeredgewidth=1.3, linestyle="none", zorder=4)
        ax.axhline(0.0, color="0.7", linewidth=0.5, zorder=0)
        ax.axvline(0.0, color="0.7", linewidth=0.5, zorder=0)
        ax.set(
            xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="real part of $L$ [1]", ylabel="imaginary part of $L$ [1]"
        )
        ax.legend(frameon=False, loc="upper right")
        ax.set_title(_words(found), fontsize=8.5, loc="left")
    return ax


def nichols_diagram(found: Any, ax: Any = None) -> Any:
    """Gain over phase, with lines on which the closed loop |L / (1 + L)| has the same gain; returns the axes."""
    with drawn_on(ax, height=0.65 * WIDTH, width=0.8 * WIDTH) as ax:
        curves = [(name, _phase(value), np.abs(value)) for name, value in found.values.items()]
        low = min(float(phase.min()) for _, phase, _ in curves)
        left, right = max(min(low - 20.0, -225.0), -740.0), max(float(phase.max()) for *_, phase, _ in curves) + 20.0
        angle, gain = np.meshgrid(np.linspace(left, right, 400), np.geomspace(1e-2, 1e2, 300))
        value = gain * np.exp(1j * np.radians(angle))
        with np.errstate(divide="ignore"):
            closed = np.abs(value / (1.0 + value))
        lines = ax.contour(angle, gain, closed, levels=[0.5, 0.8, 1.25, 2.0, 5.0], colors="0.5", linewidths=0.6)
        ax.clabel(lines, fmt=lambda level: f"|T| = {level:g}", fontsize=6.5)
        for i, (name, phase, size) in enumerate(curves):
            ax.semilogy(phase, size, label=in_words(name), **LINES[i % len(LINES)])
        for turn in range(math.floor((left + 180) / 360), math.ceil((right + 180) / 360) + 1):
            if left < 360.0 * turn - 180.0 < right:
                ax.plot(
                    [360.0 * turn - 180.0], [1.0], marker="+", color="black", markersize=9, markeredgewidth=1.3, linestyle="none", zorder=4
                )
        ax.set(yscale="log", xlim=(left, right), ylim=(1e-2, 1e2), xlabel="phase of $L$ [deg]", ylabel="gain of $L$ [1]")
        ax.legend(frameon=False, loc="upper left")
        ax.set_title(_words(found), fontsize=8.5, loc="left")
    return ax


def stability_diagram(found: Any, ax: Any = None) -> Any:
    """Where the loop is stable over two numbers, with lines of equal disk margin and the working point; returns the axes."""
    with drawn_on(ax, height=0.62 * WIDTH, width=0.8 * WIDTH) as ax:
        x, y, growth, disk = _finer(found)
        held = np.ma.masked_invalid(growth.T)
        if held.min() < 0.0:  # shaded no further than was looked at
            ax.contourf(x, y, held, levels=[min(-1.0, held.min()) * 2, 0.0], colors=["#d7ebf7"])
        if held.min() < 0.0 < held.max():
            ax.contour(x, y, held, levels=[0.0], colors="black", linewidths=1.6)
        margin = np.ma.masked_invalid(disk.T)
        levels = [level for level in (0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.5, 1.8) if level < np.nanmax(found.disk_margin)]
        if levels:
            lines = ax.contour(x, y, margin, levels=levels, colors="#12355b", linewidths=0.9)
            ax.clabel(lines, fmt=lambda level: f"α = {level:g}", fontsize=7.0)
        ax.plot(*found.nominal_point, marker="o", color="#e07a1f", markeredgecolor="black", markersize=6, linestyle="none", clip_on=False)
        known = np.isfinite(
            found.growth_rate
        )  # where there is no steady running at the set-point, as without integral gain, nothing is to be seen
        across, up = found.axes[0][known.any(axis=1)], found.axes[1][known.any(axis=0)]
        for each, values, place in ((ax.set_xlim, across, found.nominal_point[0]), (ax.set_ylim, up, found.nominal_point[1])):
            each(min([*values, place]), max([*values, place]))
        if not (found.growth_rate < 0.0).any():
            ax.text(0.5, 0.6, "stable nowhere", transform=ax.transAxes, ha="center")
        for axis, name, unit in zip((ax.xaxis, ax.yaxis), found.names, found.units, strict=True):
            name_axis(axis, in_words(name), unit, found.display_units)
        ax.set_title("shaded: stable; α: disk margin; point: as declared", fontsize=8.5, loc="left")
    return ax


FINER = 8
"""Into so many parts the distance between two points of a chart is divided for its lines."""


def _finer(found: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(across, up, growth, disk margin) of a chart between its points: by cubics through these (H. Akima, J. ACM 17 (1970) 589-602), which do not swing.

    Straight pieces between points would be taken for a result. Where the loop is unstable the margin goes on below zero as the growth does, so that its lines
    close to the border follow it. A point that is not known leaves out the cells around it.
    """
    from scipy.interpolate import Akima1DInterpolator

    known = np.isfinite(found.growth_rate)
    inside = np.ix_(known.any(axis=1), known.any(axis=0))
    known, growth, disk = known[inside], found.growth_rate[inside], found.disk_margin[inside]
    axes = [axis[places.ravel()] for axis, places in zip(found.axes, inside, strict=True)]
    rows = [np.interp(np.arange((each.size - 1) * FINER + 1) / FINER, np.arange(each.size), each) for each in axes]
    gone = np.zeros([each.size for each in rows], bool)
    for i, j in np.argwhere(~known):
        gone[max(FINER * (i - 1) + 1, 0) : FINER * (i + 1), max(FINER * (j - 1) + 1, 0) : FINER * (j + 1)] = True
    with np.errstate(divide="ignore", invalid="ignore"):
        per_growth = nearest_known(np.where(growth < 0.0, disk / growth, math.nan))
    values = []
    for value in (growth, np.where(growth < 0.0, disk, growth * per_growth)):
        value = nearest_known(value)
        for axis in (0, 1):
            value = Akima1DInterpolator(axes[axis], value, axis=axis)(rows[axis]) if axes[axis].size > 1 else value
        values.append(np.where(gone, math.nan, value))
    return rows[0], rows[1], values[0], values[1]


def describing_diagram(found: Any, axes: Any = None) -> Any:
    """The describing function over the amplitude with the cycles it predicts, and the response of the rest in the complex plane; returns both axes."""
    with drawn_on(axes, 1, 2, height=0.46 * WIDTH) as axes:
        gains, plane = axes
        slip, force = found.units
        gains.plot(found.amplitude, found.gain, label="describing function $N$", **LINES[0])
        plane.plot(found.linear_response.real, found.linear_response.imag, label="$G$, slip over force", **LINES[0])
        needed = {each.frequency: each.gain for each in found.cycles}
        largest = float(np.nanmax(found.gain))
        if largest > 0.0:
            plane.plot(
                [1.0 / largest, 1.2 * max(np.abs(found.linear_response).max(), 1.0 / largest)],
                [0.0, 0.0],
                color="0.6",
                linewidth=3.0,
                label="1/$N$",
            )
        for style, (frequency, level) in zip(itertools.cycle(LINES[1:]), needed.items(), strict=False):
            gains.axhline(level, label=f"1/$G$ at {frequency:.3g} rad/s", **style)
            plane.plot([1.0 / level], [0.0], "o", color=style["color"], label=f"{frequency:.3g} rad/s", zorder=4)
        for each in found.cycles:
            inside = "black" if each.stable else "white"
            gains.plot([each.amplitude], [needed[each.frequency]], "o", color=inside, markeredgecolor="black", zorder=4)
        if found.given_cycle:
            gains.axvline(
                (found.given_cycle[2] - found.given_cycle[1]) / 2,
                color="0.4",
                linestyle=":",
                linewidth=1.2,
                label="half the swing of the cycle",
            )
        top = max(largest, *needed.values(), 0.0)
        gains.set(ylim=(-0.5 * top, 2.1 * top), xlim=(0.0, np.nanmax(found.amplitude)))
        name_axis(gains.xaxis, "amplitude of the slip", slip, found.display_units)
        gains.set_ylabel(f"force over slip [{force} s/{slip.removesuffix('/s')}]")
        plane.axhline(0.0, color="0.7", linewidth=0.5, zorder=0)
        plane.set(xlabel=f"real part [{slip.removesuffix('/s')}/({force} s)]", ylabel="imaginary part")
        plane.ticklabel_format(scilimits=(-2, 3))
        gains.legend(framealpha=1.0, edgecolor="none", loc="upper right", fontsize=7.5)
        plane.legend(frameon=False, loc="lower right", fontsize=7.5)
        gains.set_title("filled: attracts; open: unstable", fontsize=8.5, loc="left")
    return axes


def _words(found: Any) -> str:
    margin = found.margins.disk_margin
    return f"{found.margins.title}: " + (f"disk margin {margin:.3g}" if found.margins.stable else "the closed loop is unstable")


def _phase(value: np.ndarray) -> np.ndarray:
    """Phase [deg] without jumps, which begins between -270 and 90 degrees."""
    phase = np.degrees(np.unwrap(np.angle(value)))
    return phase - 360.0 * math.floor((phase[0] + 270.0) / 360.0)


def _gain_crossings(omega: np.ndarray, gain: np.ndarray, phase: np.ndarray) -> list[tuple[float, tuple[float, float]]]:
    """(frequency, (phase there, nearest odd multiple of 180 degrees)) where the gain is 1."""
    found = []
    for i in np.flatnonzero(np.diff(np.sign(np.log(gain))) != 0):
        part = math.log(gain[i]) / (math.log(gain[i]) - math.log(gain[i + 1]))
        here = float(phase[i] + part * (phase[i + 1] - phase[i]))
        at = float(omega[i] * (omega[i + 1] / omega[i]) ** part)
        found.append((at, (here, 360.0 * round((here - 180.0) / 360.0) + 180.0)))
    return found


def _phase_crossings(omega: np.ndarray, gain: np.ndarray, phase: np.ndarray) -> list[tuple[float, float]]:
    """(frequency, gain there) where the phase is an odd multiple of 180 degrees and the gain is no further from 1 than a factor of 1000."""
    turns = np.floor((phase - 180.0) / 360.0)
    found = []
    for i in np.flatnonzero(np.diff(turns) != 0):
        level = 360.0 * max(turns[i], turns[i + 1]) + 180.0
        part = (level - phase[i]) / (phase[i + 1] - phase[i])
        size = float(gain[i] * (gain[i + 1] / gain[i]) ** part)
        if 1e-3 < size < 1e3:
            found.append((float(omega[i] * (omega[i + 1] / omega[i]) ** part), size))
    return found
