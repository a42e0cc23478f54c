"""An ideal switch, as sliding-mode laws have it."""

from __future__ import annotations

import casadi as ca

from toolbox.modelling.elements import Element


class Relay(Element):
    """An ideal switch u = -bound * sgn(surface), with true sliding on surface = 0.

    Sliding is the mode "stick": the force is then the equivalent control, inside [-bound, bound]. The surface must have relative
    degree one with a positive gain, d(surface)/dx * d(flow)/d(force) > 0; anything else is a SceneError when the plant is composed.
    With `higher_degree=True` its force may reach the surface through lags: it switches each time the surface passes through zero, and never slides.
    Source: V. Utkin, Sliding Modes in Control and Optimization, Springer 1992.
    """

    def __init__(
        self,
        name: str,
        surface: ca.SX,
        bound: ca.SX | float,
        *,
        surface_unit: str = "1",
        force_unit: str = "1",
        higher_degree: bool = False,
    ):
        super().__init__(name, surface, surface_unit, force_unit)
        self.higher_degree = higher_degree
        self.static = ca.SX(bound)
        self.load = ca.SX(bound)
        self.sliding = ca.SX(1)
