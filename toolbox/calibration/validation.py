"""Validation: what was measured beside what a machine with known numbers does under the inputs that were measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.calibration.fit import simulated
from toolbox.calibration.panels import Panel
from toolbox.calibration.trust import Residual, begins_apart, residual_of
from toolbox.calibration.windows import Window
from toolbox.files.results import HeadedRows, Result
from toolbox.files.tables import write
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop


@dataclass(frozen=True)
class Validation(Result):
    """Comparison of simulation and measurement, the result of `validate`: `print(found)`, `found.plot()`, `found.save("comparison.npz")`.

    Attributes
    ----------
    residuals
        Deviation of each signal, simulation minus measurement, in order.
    panels
        Measured and simulated values, a `Panel` for each signal and window.
    data_description
        Description of the data.
    display_units
        {SI unit: unit that was typed}: the units of report and figure.
    initial_mismatch
        {signal: deviation of its first samples from the simulation}, if the simulation begins at another state than the
        machine.

    Examples
    --------
    >>> import numpy as np
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> from toolbox.calibration import validate
    >>> time = np.linspace(0.0, 10.0, 101)
    >>> run = simulate(compose(BlockOnBelt()), 10.0, output_times=time)
    >>> found = validate(compose(BlockOnBelt()), {"time": time, "block.position": run["block.position"] + 0.01})
    >>> print(f"{found.residuals[0].rms:.3f} m rms")
    0.010 m rms
    """

    residuals: tuple[Residual, ...]
    panels: tuple[Panel, ...] = field(repr=False)
    data_description: str
    display_units: Mapping[str, str] = field(default_factory=dict)
    initial_mismatch: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        lines = [line for each in self.residuals for line in each.deviation(self.display_units)]
        return "\n".join(
            [
                self.data_description,
                *lines,
                *begins_apart(self.residuals, self.initial_mismatch, self.display_units, "give the loop the `start` that it had"),
            ]
        )

    def _table(self) -> HeadedRows:
        """One row per signal: its unit, the root mean square of its deviation, and that in parts of the measured range."""
        return ["signal", "unit", "rms", "part of its range"], [[each.signal, each.unit, each.rms, each.part] for each in self.residuals]

    def plot(self) -> Any:
        """Draw measured and simulated signals, and their difference below. Returns the axes."""
        from toolbox.calibration.figures import fitted  # here, because matplotlib is slow to import

        return fitted(self.panels, self.display_units)


@takes_loop
def validate(
    loop: ClosedLoop,
    data: Any,
    columns: Mapping[str, str] | None = None,
    window: tuple[NumberOrText, NumberOrText] | Window | Sequence[Window | tuple[NumberOrText, NumberOrText]] | None = None,
    accuracy: float = 1e-8,
) -> Validation:
    """Simulate a machine under its measured inputs, and compare its outputs with the measured outputs.

    Parameters
    ----------
    loop
        A loop, or a plant. Measured inputs replace the inputs of the loop.
    data
        The measurement: a path of a log, a mapping {column: samples}, a table, a run, or a `Recording`.
    columns
        {signal: column of the log}. By default columns have the names of signals. `Recording.of` describes the forms.
    window
        Times (begin, end) [s] of the data, or several windows. Each window is simulated from the start of the loop
        on. By default all data.
    accuracy
        Target for the global error of the runs, between 1e-13 and 0.1, by default 1e-8.

    Returns
    -------
    Validation
        Deviations of all signals that are no inputs.

    Raises
    ------
    SceneError
        If the data are bad, or hold no signal that can be compared.
    SimulationError
        If the machine cannot be simulated.

    Examples
    --------
    >>> import numpy as np
    >>> from models import BitRock, wells
    >>> from toolbox import compose, simulate
    >>> from toolbox.calibration import validate
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> time = np.linspace(0.0, 30.0, 601)
    >>> run = simulate(rig, 30.0, inputs={"top.torque": "12 kN m"}, output_times=time)
    >>> log = {"time": time, "top.torque": np.full(time.size, 12e3), "bit.speed": run["bit.speed"] + 0.1}
    >>> found = validate(rig, log)
    >>> print(found)
    Simulated beside 601 measured values over 30 s (given data)
      bit.speed: rms deviation 0.1 rad/s, 0.53 % of its range
    """
    misfit = simulated(loop, data, columns, window, accuracy)
    nothing = np.zeros(0)
    model = misfit.model(nothing)
    left = {name: model[name] - misfit.measured[name] for name in misfit.outputs}
    residuals = tuple(residual_of(name, misfit.plant.unit(name), left[name], misfit.measured[name]) for name in misfit.outputs)
    compared = f"Simulated beside {sum(each.size for each in left.values())} measured values over {misfit.span:g} s ({misfit.source})"
    return Validation(residuals, misfit.panels(left, nothing), compared, loop.display_units, misfit.apart(nothing))


def write_deviations(found: Mapping[str, Validation], path: Path) -> None:
    """Write the deviations of several machines {label: validation} as a table (csv)."""
    tables = {label: each._table() for label, each in found.items()}
    head = next(iter(tables.values()))[0]
    write(path, ["controller", *head], [[label, *row] for label, (_, rows) in tables.items() for row in rows])
