"""Soft-string model: tension and side force of a string without bending stiffness that lies in its hole.

With tangent t downhole, curvature dt/ds, weight per length w and the direction d of gravity, equilibrium of the string is

    dT/ds = -w d.t,    side force per length  |T dt/ds + w (d - (d.t) t)|

Where the hole is straight this is w sin(inc). Axial friction is left out: T is the tension of a string that rotates and does not move along the hole, which
takes all friction. Source: C. A. Johancsik, D. B. Friesen, R. Dawson, J. Petroleum Technology 36 (1984) 987-992; range: no buckling, no clearance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.sections import Section
from models.survey import Survey


def tension(
    sections: Sequence[Section], survey: Survey, s: np.ndarray, *, mud_density: float = 0.0, weight_on_bit: float = 0.0
) -> np.ndarray:
    """Effective tension [N] at measured depths s [m]: weight in mud of the string below, along the hole, less the weight on bit [N]."""
    ends = np.concatenate([[0.0], np.cumsum([section.length for section in sections])])
    s = np.atleast_1d(np.asarray(s, float))
    below = np.clip(s[:, None], ends[:-1], ends[1:])  # where the part of each section below s begins
    down = survey.position(below.ravel())[:, 2].reshape(below.shape)
    drop = survey.position(ends[1:])[:, 2] - down
    return drop @ np.array([section.weight(mud_density) for section in sections]) - weight_on_bit


def side_force(
    sections: Sequence[Section],
    survey: Survey,
    s: np.ndarray,
    *,
    mud_density: float = 0.0,
    weight_on_bit: float = 0.0,
    doglegs: bool = True,
) -> np.ndarray:
    """Force per length between string and hole [N/m] at measured depths s [m]; without doglegs only w sin(inc)."""
    s = np.atleast_1d(np.asarray(s, float))
    ends = np.cumsum([section.length for section in sections])
    weight = np.array([section.weight(mud_density) for section in sections])[np.clip(np.searchsorted(ends, s), 0, len(sections) - 1)]
    t = survey.tangent(s)
    across = weight[:, None] * (np.array([0.0, 0.0, 1.0]) - t[:, 2:] * t)
    if doglegs:
        pull = tension(sections, survey, s, mud_density=mud_density, weight_on_bit=weight_on_bit)
        across = across + pull[:, None] * survey.curvature(s)
    return np.linalg.norm(across, axis=1)
