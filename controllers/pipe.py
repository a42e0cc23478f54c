"""The wave impedance of a pipe, which drives are tuned to."""

from __future__ import annotations

import numpy as np

from toolbox import SceneError


def pipe_impedance(outer: float, inner: float, shear_modulus: float, density: float) -> float:
    """Compute the torsional wave impedance of a pipe, zeta = I_p sqrt(G rho), with I_p = pi (outer^4 - inner^4) / 32.

    `toolbox.impedance` is that of a drive, and `toolbox.steady_states.reflection` tells what part of a wave the drive sends back.
    Source: textbook; used for drill strings by U. J. F. Aarsnes, F. Di Meglio, R. J. Shor, J. Sound Vib. 424 (2018).

    Parameters
    ----------
    outer, inner
        Diameters of the pipe [m].
    shear_modulus
        Shear modulus G [Pa].
    density
        Density rho [kg/m3].

    Returns
    -------
    float
        Impedance zeta [N m s/rad].

    Raises
    ------
    SceneError
        Unless 0 <= inner < outer, and G and rho are > 0.
    """
    if not 0 <= inner < outer:
        raise SceneError(f"Argument `inner` must be >= 0 m and below the outer diameter {outer:g} m, but it is {inner!r}.")
    for name, value in (("shear_modulus", shear_modulus), ("density", density)):
        if not value > 0:
            raise SceneError(f"Argument `{name}` must be > 0, but it is {value!r}.")
    return float(np.pi / 32 * (outer**4 - inner**4) * np.sqrt(shear_modulus * density))
