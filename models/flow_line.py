"""Flow in a line by lumped elements: the mud line of a rig from the pump to the nozzles of the bit, or any hydraulic line with losses.

Form: M. Mirramezani, S. C. Shadden (2020), distributed lumped parameter model of flow: per segment a viscous resistance, an expansion loss, an inertance
and a compliance, and a resistor-capacitor-resistor (RCR) at the outlet. The coefficients of a round pipe are textbook.

Why set-valued, not tanh: drilling mud at rest forms a gel that carries a pressure until it breaks. A regularised yield stress lets it creep, and a
pump that should build up pressure until circulation breaks never has to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, quantity, state
from toolbox.authoring import NumberOrText, entries, number, whole
from toolbox.modelling import OptionalQuantities, Quantities


@dataclass(frozen=True)
class FlowLine(Component):
    """Hydraulic line as segments in a row from the inlet to the outlet.

        C_i p_i' = Q_(i-1) - Q_i,     L_i Q_i' = p_i - p_(i+1) - R_i Q_i - K_i Q_i |Q_i| - F_i

    The n segments are counted from the inlet, i = 0 to n-1. p_i is the pressure at the inlet of segment i, and Q_i the
    flow through the segment, positive towards the outlet. Q_(-1) is the flow into the line, and p_n the pressure at the
    outlet. n segments have 2 n states, `line.pressure` [Pa] and `line.flow` [m3/s].

    - Needs the signals `line.inlet_flow` Q_(-1) [m3/s] (default 0) and `line.outlet_pressure` p_n [Pa] (default 0).
    - Gives the signals `line.inlet_pressure` p_0 [Pa] and `line.outlet_flow` Q_(n-1) [m3/s].

    R, K, L and C are the fields `resistance` [Pa s/m3], `loss` [Pa s2/m6], `inertance` [Pa s2/m3] and `compliance`
    [m3/Pa], with one entry per segment. The loss of a nozzle at the end is part of the last K
    (`models.flow_line.nozzle_loss`).

    `gel` adds the yield pressure F_i [Pa] of a fluid that gels at rest, as dry friction with the contact `line.i`:

        at rest |F_i| <= P_i mu_s,     in flow F_i = P_i mu(|Q_i|) sgn(Q_i)

    P_i is the field `gel_pressure` [Pa] of the segment. mu_s and mu are the static and the kinetic coefficient of the
    friction law `gel` [1]. For a segment of a round pipe of length l and diameter d, P_i is 4 tau l / d, with the yield
    stress tau at the wall [Pa]. The gel has its full strength again as soon as the flow stops. A line of a single segment
    begins to flow at the full strength of its gel. A line of many segments begins to flow segment by segment from the
    pump on, at a lower pressure (see `studies/questions/networks.py`).

    Range of validity: one-dimensional flow, laminar if R is the resistance of Poiseuille; waves that are about ten
    segments long or longer. Pressures are relative to the surroundings. The default values are examples without a
    source.

    Examples
    --------
    >>> from models import FlowLine
    >>> from toolbox import compose
    >>> print(compose(FlowLine()))
    HybridSystem(FlowLine): 2 states (line.pressure, line.flow); contacts: none; inputs: line.inlet_flow [m3/s], line.outlet_pressure [Pa]
    """

    resistance: Quantities = quantity((1e7,), "Pa s/m3", "viscous resistance R of every segment", at_least=0)
    loss: Quantities = quantity((0.0,), "Pa s2/m6", "expansion or nozzle loss K of every segment", at_least=0)
    inertance: Quantities = quantity((1e8,), "Pa s2/m3", "inertance L of every segment", above=0)
    compliance: Quantities = quantity((1e-9,), "m3/Pa", "compliance C at the head of every segment", above=0)
    gel: FrictionLaw | None = None
    gel_pressure: OptionalQuantities = quantity(None, "Pa", "load of the law `gel` in every segment", at_least=0)

    @staticmethod
    def pipe(
        length: NumberOrText,
        diameter: NumberOrText,
        *,
        viscosity: NumberOrText,
        density: NumberOrText,
        bulk_modulus: NumberOrText,
        segments: int,
        end_loss: float = 0.0,
        gel: FrictionLaw | None = None,
    ) -> FlowLine:
        """Make the line of a uniform round pipe.

        Each segment of length l and area A has the resistance R of Poiseuille, L = density l / A and C = A l /
        bulk_modulus. K is 0, except `end_loss` in the last segment.

        Parameters
        ----------
        length, diameter
            Length and inner diameter of the pipe [m].
        viscosity
            Dynamic viscosity of the fluid [Pa s].
        density
            Density of the fluid [kg/m3].
        bulk_modulus
            Bulk modulus of fluid and wall [Pa].
        segments
            Number of segments.
        end_loss
            Loss K of the last segment [Pa s2/m6], by default 0.
        gel
            Friction law whose coefficients are the yield stress at the wall [Pa]: `gel_pressure` is then 4 l / diameter.
            None (default) for a fluid that does not gel.

        Returns
        -------
        FlowLine
            The line.

        Raises
        ------
        SceneError
            If the arguments do not describe a pipe.
        """
        segments = whole("segments", segments, 1)
        length, diameter = number("length", length, "m", above=0), number("diameter", diameter, "m", above=0)
        viscosity, density = number("viscosity", viscosity, "Pa s", above=0), number("density", density, "kg/m3", above=0)
        bulk_modulus = number("bulk_modulus", bulk_modulus, "Pa", above=0)
        area, part = math.pi * diameter**2 / 4, length / segments
        return FlowLine(
            resistance=(poiseuille_resistance(part, diameter, viscosity),) * segments,
            loss=(*(0.0,) * (segments - 1), end_loss),
            inertance=(density * part / area,) * segments,
            compliance=(area * part / bulk_modulus,) * segments,
            gel=gel,
            gel_pressure=None if gel is None else (4 * part / diameter,) * segments,
        )

    def check(self):
        n = len(self.resistance)
        if n < 1:
            raise SceneError("Argument `line.resistance` must hold at least one segment, but it is empty.")
        for name in ("loss", "inertance", "compliance", "gel_pressure"):
            entries(f"line.{name}", getattr(self, name), n, " like `line.resistance`")
        if (self.gel is None) != (self.gel_pressure is None):
            raise SceneError("Arguments `line.gel` and `line.gel_pressure` must be given together, but one is missing.")

    def equations(self, signal):
        n = len(self.resistance)
        p, q = state("line.pressure", "Pa", n), state("line.flow", "m3/s", n)
        inlet, outlet = signal("line.inlet_flow", "m3/s", default=0.0), signal("line.outlet_pressure", "Pa", default=0.0)
        resistance, loss, inertance, compliance = (ca.vertcat(*v) for v in (self.resistance, self.loss, self.inertance, self.compliance))
        before = ca.vertcat(inlet, *[q[i] for i in range(n - 1)])
        after = ca.vertcat(*[p[i] for i in range(1, n)], outlet)
        drop = resistance * q + loss * q * ca.fabs(q)
        losses = {"viscous": ca.dot(resistance, q**2), "expansion": ca.dot(loss, q**2 * ca.fabs(q))}
        contacts = []
        if self.gel is not None:
            contacts = [
                DryFriction(f"line.{i}", q[i], self.gel, load, slip_unit="m3/s", force_unit="Pa")
                for i, load in enumerate(self.gel_pressure)
            ]
            force = ca.vertcat(*[contact.force for contact in contacts])
            drop -= force
            losses["gel"] = -ca.dot(force, q)
        return Equations(
            flow={
                p: (before - q) / compliance,
                q: (p - after - drop) / inertance,
            },
            outputs={"line.inlet_pressure": (p[0], "Pa"), "line.outlet_flow": (q[-1], "m3/s")},
            elements=contacts,
            stored=ca.dot(compliance, p**2) / 2 + ca.dot(inertance, q**2) / 2,
            losses=losses,
            supplies={"pump": p[0] * inlet, "outlet": -outlet * q[-1]},
        )


@dataclass(frozen=True)
class OutletRCR(Component):
    """Three-element windkessel (resistor, capacitor, resistor) at the end of a line: p = R_p Q + p_d, C p_d' = Q - p_d / R_d.

    Symbols and their fields: R_p `proximal` and R_d `distal` [Pa s/m3], C `compliance` [m3/Pa].

    After a step of the flow Q the pressure is p = Q [R_p + R_d (1 - exp(-t / (R_d C)))].

    - Needs the signal `line.outlet_flow` Q [m3/s] (default 0).
    - Gives the signal `line.outlet_pressure` p [Pa].
    - State: `outlet.pressure` p_d [Pa].

    At the end of a mud line this part represents the annulus and the choke. The default values are examples without a
    source.

    Examples
    --------
    >>> from models import OutletRCR
    >>> from toolbox import compose
    >>> print(compose(OutletRCR()))
    HybridSystem(OutletRCR): 1 states (outlet.pressure); contacts: none; inputs: line.outlet_flow [m3/s]
    """

    proximal: Quantity = quantity(1e6, "Pa s/m3", "resistance R_p before the capacitor", at_least=0)
    distal: Quantity = quantity(1e7, "Pa s/m3", "resistance R_d after the capacitor", above=0)
    compliance: Quantity = quantity(1e-7, "m3/Pa", "compliance C", above=0)

    def equations(self, signal):
        p = state("outlet.pressure", "Pa")
        flow = signal("line.outlet_flow", "m3/s", default=0.0)
        pressure = self.proximal * flow + p
        return Equations(
            flow={p: (flow - p / self.distal) / self.compliance},
            outputs={"line.outlet_pressure": (pressure, "Pa")},
            stored=self.compliance * p**2 / 2,
            losses={"proximal": self.proximal * flow**2, "distal": p**2 / self.distal},
            supplies={"line": pressure * flow},
        )


def poiseuille_resistance(length: NumberOrText, diameter: NumberOrText, viscosity: NumberOrText) -> float:
    """Resistance of laminar flow in a round pipe, R = 128 mu l / (pi d^4) [Pa s/m3]. Raises SceneError for numbers that are not > 0."""
    length, diameter = number("length", length, "m", above=0), number("diameter", diameter, "m", above=0)
    viscosity = number("viscosity", viscosity, "Pa s", above=0)
    return 128 * viscosity * length / (math.pi * diameter**4)


def expansion_loss(density: NumberOrText, narrow: NumberOrText, wide: NumberOrText) -> float:
    """Loss of a sudden expansion, K = density (1/A_narrow - 1/A_wide)^2 / 2 [Pa s2/m6] (Borda, Carnot), areas in m2.

    Raises SceneError for numbers that are not > 0 and for a wide area below the narrow one.
    """
    density, narrow = number("density", density, "kg/m3", above=0), number("narrow", narrow, "m2", above=0)
    wide = number("wide", wide, "m2", at_least=narrow)
    return density * (1 / narrow - 1 / wide) ** 2 / 2


def nozzle_loss(density: NumberOrText, area: NumberOrText, discharge: float = 0.95) -> float:
    """Loss of the nozzles of a bit, K = density / (2 (c_d A)^2) [Pa s2/m6]: their pressure is K Q|Q|. area: all nozzles together [m2].

    discharge: coefficient c_d, 0.95 by custom. Raises SceneError for numbers that are not > 0.
    """
    density, area = number("density", density, "kg/m3", above=0), number("area", area, "m2", above=0)
    discharge = number("discharge", discharge, above=0)
    return density / (2 * (discharge * area) ** 2)
