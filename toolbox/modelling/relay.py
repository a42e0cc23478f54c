"""An ideal switch, as sliding-mode laws have it."""

from __future__ import annotations

import casadi as ca

from toolbox.modelling.elements import Element


class Relay(Element):
    """Ideal switch u = -bound sgn(surface): -bound above the surface, +bound below it, and exact sliding on surface =
    0.

    `surface` is an expression of the states, `bound` the magnitude of the output. The output u is the attribute `force`
    of the relay, which the equations of a part use. While surface = 0 is held (sliding), the mode is "stick", and u is
    the equivalent control: the value between -bound and bound that keeps the surface at 0.

    The force must act directly on the rate of the surface, and a positive force must raise it (relative degree one,
    positive gain): (d surface / dx) (dx' / du) > 0, with the states x and their rates x'. Otherwise `compose` raises
    SceneError.

    With `higher_degree=True` the force may act on the surface through lags. The relay then switches each time the
    surface passes through zero, and never slides.

    The example does not write a relay. It uses the controller `IdealSlidingMode`, which contains a relay with the name
    `idealslidingmode`.

    Source: V. Utkin, Sliding Modes in Control and Optimization, Springer 1992.

    Examples
    --------
    >>> from controllers import IdealSlidingMode
    >>> from models import BitRock, wells
    >>> from toolbox import compose, simulate
    >>> run = simulate(compose(wells.JANSEN_2, BitRock(weight="60 kN")), "60 s", controller=IdealSlidingMode(reference="60 rpm"))
    >>> print(f"on the surface for {run.time_in('idealslidingmode', 'stick', after=30.0):.1f} s of the last 30 s")
    on the surface for 30.0 s of the last 30 s
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
