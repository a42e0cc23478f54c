"""The wave impedance of a pipe, which drives are tuned to."""

from __future__ import annotations

import numpy as np

from toolbox.authoring import NumberOrText, number


def pipe_impedance(outer: NumberOrText, inner: NumberOrText, shear_modulus: NumberOrText, density: NumberOrText) -> float:
    """Compute the torsional wave impedance of a pipe, zeta = I_p sqrt(G rho), with I_p = pi (outer^4 - inner^4) / 32.

    `toolbox.impedance` computes the impedance of a drive, and `toolbox.steady_states.reflection` the fraction of a
    wave that the drive reflects. Source: textbook; used for drill strings by U. J. F. Aarsnes, F. Di Meglio, R. J.
    Shor, J. Sound Vib. 424 (2018).

    Parameters
    ----------
    outer, inner
        Outer and inner diameter of the pipe [m].
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

    Examples
    --------
    >>> from controllers import pipe_impedance
    >>> print(f"{pipe_impedance('5 in', '4.276 in', shear_modulus='79.3 GPa', density=7850.0):.0f} N m s/rad")
    296 N m s/rad
    """
    outer = number("outer", outer, "m", above=0)
    inner = number("inner", inner, "m", at_least=0, below=outer)
    shear_modulus, density = number("shear_modulus", shear_modulus, "Pa", above=0), number("density", density, "kg/m3", above=0)
    return float(np.pi / 32 * (outer**4 - inner**4) * np.sqrt(shear_modulus * density))
