"""The impedance that a drive law shows to the string, and how much of a torsional wave it sends back.

A string ends in the top drive, J w' = u - tau. A wave that comes up the string meets Z, tau = -Z w, and the part r of it returns:

    Z(i om) = i om J + c - C(i om),   C(i om) = du/dw of the law,   r = (zeta - Z) / (zeta + Z),   zeta = I_p sqrt(G rho)

|r| = 1 for a drive that holds its speed or its torque, 0 for one that matches. Source of the matching of a drill string's drive: U. J. F. Aarsnes,
F. Di Meglio, R. J. Shor, J. Sound Vib. 424 (2018).
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from toolbox import Controller, SceneError


def pipe_impedance(outer: float, inner: float, shear_modulus: float, density: float) -> float:
    """Torsional wave impedance of a pipe [N m s/rad]: zeta = I_p sqrt(G rho), I_p = pi (outer^4 - inner^4) / 32; diameters in m, G in Pa, rho in kg/m3.

    Raises SceneError unless 0 <= inner < outer and G, rho > 0.
    """
    if not 0 <= inner < outer:
        raise SceneError(f"Argument `inner` must be >= 0 m and below the outer diameter {outer:g} m, but it is {inner!r}.")
    for name, value in (("shear_modulus", shear_modulus), ("density", density)):
        if not value > 0:
            raise SceneError(f"Argument `{name}` must be > 0, but it is {value!r}.")
    return float(np.pi / 32 * (outer**4 - inner**4) * np.sqrt(shear_modulus * density))


def impedance(law: Controller, frequency: Any, inertia: float = 0.0, drag: float = 0.0) -> np.ndarray:
    """Z(i om) [N m s/rad] of a designed, continuous law behind the top inertia J and drag c, at angular frequencies om > 0 [rad/s].

    The law is linearised at rest. Raises SceneError for a law that needs more than the top speed and its set-point.
    """
    speed = ca.SX.sym("top.speed")

    def signal(name: str, unit: str, default: Any = None) -> Any:
        if name == "top.speed":
            return speed
        if default is None:
            raise SceneError(f"The impedance is that of a law on the top speed alone, but {type(law).__name__} needs `{name}`.")
        return default

    equations = law.continuous(signal)
    x = ca.vertcat(*equations.flow) if equations.flow else ca.SX(0, 1)
    rate = ca.vertcat(*equations.flow.values()) if equations.flow else ca.SX(0, 1)
    torque = ca.SX(equations.gives["top.torque"][0])
    slopes = [ca.densify(ca.jacobian(a, b)) for a in (rate, torque) for b in (x, speed)]
    A, B, C, D = (np.array(m) for m in ca.Function("slopes", [x, speed], slopes)(0, 0))
    om = np.atleast_1d(np.asarray(frequency, float))
    response = [(C @ np.linalg.solve(1j * w * np.eye(A.shape[0]) - A, B) + D).item() for w in om]
    return 1j * om * inertia + drag - np.array(response)


def reflection(law: Controller, frequency: Any, string_impedance: float, inertia: float = 0.0, drag: float = 0.0) -> np.ndarray:
    """Reflection coefficient r(i om) [1] of a law at the top of a string of impedance zeta [N m s/rad]; see the module."""
    Z = impedance(law, frequency, inertia, drag)
    return (string_impedance - Z) / (string_impedance + Z)
