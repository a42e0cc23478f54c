"""Noise of a measured force that drives a simulation: how far it alone moves the model, beside what the residuals are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from toolbox.calibration.results import Fit
from toolbox.calibration.trust import scatter
from toolbox.errors import SceneError, SimulationError
from toolbox.files.unit_systems import reading

SHARE = 0.3
"""Motion of the model by the noise of the force, at least, as a fraction of the residuals, that is worth a remark."""


def force_noise(found: Fit, force: str, unit: str) -> list[str]:
    """Return what a report says of the noise of a measured force, if it alone explains a good part of residuals that are not white.

    The force is simulated once more with as much noise again as it has, from sample to sample.

    Parameters
    ----------
    found
        The fit, of several windows together.
    force
        Name of the measured force.
    unit
        Its SI unit.
    """
    structured = {each.signal: each for each in found.residuals if each.whiteness < 0.05}
    moved: dict[str, list[np.ndarray]] = {name: [] for name in structured}
    noise = 0.0
    for window, places in zip(found.misfit.each, found.misfit.places, strict=True):
        samples = window.recording.signals.get(force, np.zeros(3))
        size = scatter(samples[np.isfinite(samples)])
        if not size or not structured.keys() & {*window.outputs}:
            continue
        noise = max(noise, size)
        for name, away in _moved(window, found.values[places], force, size).items():
            if name in moved:
                moved[name].append(away)
    found_lines = []
    for name, parts in moved.items():
        far = float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) if parts else 0.0
        if far > SHARE * structured[name].rms:
            read, of_force = reading(structured[name].unit, found.display_units), reading(unit, found.display_units)
            found_lines.append(
                f"  {force} scatters by about {noise * of_force.factor:.2g}{of_force.tail} from sample to sample. If this is noise of a sensor, and no force "
                f"that acts, it alone moves the simulated {name} by about {far * read.factor:.2g}{read.tail} (residual "
                f"{structured[name].rms * read.factor:.2g}{read.tail}). This is why neighbouring residuals are alike. Remedy: record the command of the "
                "drive, or average several recordings of the same motion."
            )
    return found_lines


def _moved(window: Any, values: np.ndarray, force: str, size: float) -> dict[str, np.ndarray]:
    """{output: by how much noise of this deviation moves the model of a window}; empty if it cannot be simulated."""
    recording = window.recording
    samples = recording.signals[force]
    noisy = replace(
        recording, signals={**recording.signals, force: samples + size * np.random.default_rng(0).standard_normal(samples.size)}
    )
    driven = replace(window, loop=window.loop.replace(inputs={**window.loop.inputs, **noisy.driving(window.loop.plant)}))
    try:
        models: Sequence[dict[str, np.ndarray]] = [each.model(values) for each in (window, driven)]
    except (SceneError, SimulationError):
        return {}
    return {name: models[1][name] - models[0][name] for name in models[0]}
