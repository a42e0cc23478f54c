"""What an identification found: numbers of an axis or a joint with the friction curve, the data in it, and what the data do not tell."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray
from toolbox.calibration.panels import TIME, Panel
from toolbox.calibration.results import Fit
from toolbox.calibration.windows import own_name
from toolbox.files.printing import Rows
from toolbox.modelling.inputs import Table
from toolbox.scenes.cases import Waveform
from toolbox.scenes.scene import Scene

POINTS = 60
"""Points of a friction curve."""

STEADY_RUN = 5.0
"""Duration [s] of the scene of an identification from steady points."""


@dataclass(frozen=True)
class Identification(Fit):
    """Friction and mass of an axis or a joint, the result of `identify`: a `Fit` with its friction curve.

    `print(found)`, `found.plot()` and `found.plot_residuals()` show the result. `found.plant` is the identified plant, for
    `simulate` and `ClosedLoop`, and `found.scene()` a scene with it. The plant has the estimates, and each number that was kept as `found.untold` says.

    A coast-down without a driving force determines only the ratio of friction and inertia (or mass). The inertia then
    keeps its value in the part, and only the ratio of the estimated friction and this inertia is meaningful.

    Attributes
    ----------
    names, units, values, standard_errors, covariance, confidence, interval_factor
        Names and SI units of the estimates, their values and standard errors, shape (k,), and covariance, shape (k, k).
        The confidence interval is value +- interval_factor * standard error, at the confidence level `confidence`.
    residuals, panels, misfit, data_description, outliers, initial_mismatch, held, stepped
        Deviation of each measured output from the model; measured and fitted values; the model itself; a description of
        the data; samples that were left out as outliers; deviation of the first samples; inputs with zero-order hold;
        and inputs that jump between lines.
    condition_number, at_bounds, fixed_by, unidentifiable, indistinguishable_friction, sampling_errors
        Condition number of the scaled Jacobian; estimates at a bound; reasons why numbers cannot reach their optimum;
        numbers without influence; friction law whose static and kinetic friction the data cannot distinguish; and
        errors due to the sampling of measured inputs.
    agreeing_starts, starts, exact_derivatives
        Number of searches that ended at this optimum, number of all searches, and whether the derivatives of the model
        are exact.
    display_units
        {SI unit: unit that was typed}: the units of report and figure.
    untold
        {number that the recordings do not determine: the reason, and an experiment that would determine the number}.
    points
        Friction in the data: speed and force, shape (2, points).
    curve
        Friction of the fitted law: speed, force and both ends of its confidence interval, shape (4, points).
    curve_units
        Units of speed and force of `points` and `curve`.
    recordings
        Description of the recordings as text.
    runs
        Recording of each run: run 1 is the first. A gap in a recording makes two runs. Empty for steady points.
    force_noise
        Sentences about noise of the measured force, if it explains a good part of residuals that are not white.

    Examples
    --------
    >>> import numpy as np
    >>> from toolbox import identify, simulate
    >>> speed = np.linspace(0.05, 0.6, 12)
    >>> found = identify({"axis.speed": speed, "axis.force": 5.0 + 35.0 * speed}, fixed="axis.force_offset")
    >>> print(f"{found['rail.friction.viscous']:.2f} from {found.points.shape[1]} points")
    35.00 from 12 points
    >>> run = simulate(found.plant, 5.0, inputs={"axis.force": 12.0})
    >>> print(f"{run['axis.speed'][-1]:.2f} m/s")
    0.20 m/s
    """

    untold: Mapping[str, str] = field(default_factory=dict)
    points: FloatArray = field(default_factory=lambda: np.zeros((2, 0)))
    curve: FloatArray = field(default_factory=lambda: np.zeros((4, 0)))
    curve_units: tuple[str, str] = ("m/s", "N")
    recordings: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    force_noise: tuple[str, ...] = ()

    def _remarks(self) -> list[str]:
        return [*super()._remarks(), *self.force_noise]

    def _told(self) -> list[str | Rows]:
        lines = [*super()._told()]
        if self.untold:
            lines += ["", "What the data do not tell:", *(f"  {name}: {why}" for name, why in self.untold.items())]
        return [*lines, "", *self.recordings]

    def _extent(self, name: str) -> str:
        """The recordings in which the start of a signal has no influence, in words; a run of its own has the number of the run behind the name."""
        signal, _, number = name.removesuffix("]").partition("[")
        if number and self.runs:
            return f"in run {number} ({self.runs[int(number) - 1]})"
        without = [source for k, source in enumerate(self.runs, 1) if own_name(signal, k) not in self.names]
        return f"in {', '.join(dict.fromkeys(without))}" if 0 < len(without) < len(self.runs) else super()._extent(name)

    def plot(self) -> Any:
        """Draw friction over speed: the points of the data, the friction law, and its confidence interval. Return the axes."""
        from toolbox.calibration.figures import friction_curve  # here, because matplotlib is slow to import

        return friction_curve(self)

    def scene(self) -> Scene:
        """Return a scene with the identified plant that repeats the first recording with a measured force.

        `scene().save("scene.toml")` writes a file for `stickslip simulate`. The scene has the measured force (or torque)
        of the recording, and the state at its begin. Steady points have no time: their scene has the largest force of the
        points, from rest, for 5 s.

        Returns
        -------
        Scene
            The scene, without a controller.

        Raises
        ------
        SceneError
            If the identification was read from a file, which holds no plant.

        Examples
        --------
        >>> import numpy as np
        >>> from toolbox import identify
        >>> speed = np.linspace(0.05, 0.6, 12)
        >>> found = identify({"axis.speed": speed, "axis.force": 5.0 + 35.0 * speed}, fixed="axis.force_offset")
        >>> run = found.scene().run("no controller")
        >>> print(f"{run['axis.speed'][-1]:.2f} m/s")
        0.60 m/s
        """
        machine, part = self._machine, fitted_part(self)
        force, speed = f"{part.signal_prefix}.{part.force_name}", f"{part.signal_prefix}.speed"
        inputs: Mapping[str, Any] = {force: float(np.max(self.points[1], initial=0.0)) + float(getattr(part, part.offset_field))}
        span, start = STEADY_RUN, dict[str, float]()
        if not machine.by_samples:
            windows = [(each, self.values[places]) for each, places in zip(machine.each, machine.places, strict=True)]
            window, values = next(
                (pair for pair in windows if np.ptp(getattr(pair[0].loop.input_values.get(force), "values", 0.0))), windows[0]
            )
            loop = window.at(values)
            inputs, span, start = {name: _as_input(value) for name, value in loop.input_values.items()}, window.span, dict(loop.start)
        told = f"{type(part).__name__} identified from {', '.join(dict.fromkeys(self.runs)) or 'steady points'}"
        return Scene.of(self.plant, span, title=told, signal=speed, effort=force, inputs=inputs, start=start)

    def plot_residuals(self) -> Any:
        """Draw measurement and model, and the residuals, each run over its own time. Return the axes."""
        return Fit.plot(dataclasses.replace(self, panels=tuple(_from_zero(panel) for panel in self.panels)))


def _as_input(value: Any) -> Any:
    """An input of a run as a scene file has it."""
    if not isinstance(value, Table):
        return value
    return Waveform("table", {"times": tuple(value.times.tolist()), "values": tuple(value.values.tolist())})


def _from_zero(panel: Panel) -> Panel:
    """The panel of a run with its time from 0, and its number in words: "joint.angle, run 2" for "joint.angle[2]"."""
    if panel.over != TIME or not panel.x.size:
        return panel
    signal, _, run = panel.name.removesuffix("]").partition("[")
    begin = float(panel.x[0])
    return dataclasses.replace(panel, name=f"{signal}, run {run}" if run else signal, x=panel.x - begin, sticks=panel.sticks - begin)


def drag_unit(force: str, speed: str) -> str:
    """The unit of viscous friction: "N s/m" of "N" and "m/s", "N m/rpm" of "N m" and "rpm"."""
    place, over, _ = speed.partition("/s")
    return f"{force} s/{place}" if over else f"{force}/{speed}"


def with_derived(typed: Mapping[str, str], speed: str, force: str) -> dict[str, str]:
    """Typed units with those that follow from them: of the speed, if the log holds the position alone, and of viscous friction."""
    found, place = dict(typed), speed.removesuffix("/s")
    if place in found:
        found.setdefault(speed, f"{found[place]}/s")
    if speed in found or force in found:
        found.setdefault(drag_unit(force, speed), drag_unit(found.get(force, force), found.get(speed, speed)))
    return found


def fitted_part(found: Fit) -> Any:
    """The axis or joint with the numbers that were found."""
    return found.misfit.loop.assembly.plant.with_parameters(found.parameters).parts[0]


def friction_over_speed(found: Fit, points: np.ndarray) -> np.ndarray:
    """Speed, friction of the law, and both ends of its interval, over the speeds of the data."""
    numbers = [(i, name) for i, name in enumerate(found.names) if name in found.parameters]
    high, low = max(float(points[0].max(initial=0.0)), 0.0), min(float(points[0].min(initial=0.0)), 0.0)
    speeds = np.concatenate(
        [side * np.geomspace(1e-3, 1.0, POINTS // 2)[:: int(side)] * abs(end) for side, end in ((-1.0, low), (1.0, high)) if end]
    )

    def friction(values: np.ndarray) -> np.ndarray:
        plant = found.misfit.loop.assembly.plant.with_parameters({name: float(values[i]) for i, name in numbers})
        law = plant.parts[0].friction
        back = law.reverse()
        return np.array([float(np.sign(v)) * float((law if v > 0 else back).sliding(abs(float(v)))) for v in speeds])

    middle, slopes = friction(found.values), []
    for i, _ in numbers:
        step = np.zeros(found.values.size)
        step[i] = 1e-4 * max(abs(found.values[i]), 1e-9)
        word = found.names[i].rpartition(".")[2]
        sign = (
            -1.0 if word == "kinetic" and found.values[i] >= step[i] else 1.0
        )  # a kinetic friction is at most the static one, and at least 0
        slopes.append((friction(found.values + sign * step) - middle) / (sign * step[i]))
    places = [i for i, _ in numbers]
    covariance = np.where(np.isfinite(found.covariance), found.covariance, 0.0)[np.ix_(places, places)]
    wide = found.interval_factor * np.sqrt(np.maximum(np.einsum("in,ij,jn->n", np.array(slopes), covariance, np.array(slopes)), 0.0))
    return np.stack([speeds, middle, middle - wide, middle + wide])
