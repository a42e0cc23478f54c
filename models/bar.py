"""An oscillator that rubs on an elastic bar: two periods of stick-slip, a long one from the oscillator and a short one from the bar."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from models.friction import Exponential
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, quantity, state
from toolbox.authoring import number, whole


@dataclass(frozen=True)
class OscillatorOnBar(Component):
    """Mass on a spring that rubs on an elastic bar, whose two clamped ends move with the speed V.

        m v' = f - k x - c v + F,     F dry friction with slip speed v - V - u_t(a, t)
            (rho A L / 2) (q_j'' + 2 zeta w_j q_j' + w_j^2 q_j) = -F sin(j pi a / L)
        u(y, t) = sum q_j sin(j pi y / L),     w_j = (j pi / L) sqrt(E / rho)

    Symbols and their fields: m `mass` [kg], k `stiffness` [N/m], c `damping` [N s/m], V `bar_speed` [m/s], L `length`
    [m], A `area` [m2], E `modulus` [Pa], rho `density` [kg/m3], zeta `loss` [1]. w_j is the natural frequency of mode j
    [rad/s].

    The sum contains the first `modes` axial modes j of the bar. The contact is at a = `contact_position` L.

    - Needs the signal `oscillator.force` f [N] (default 0).
    - Gives the signal `oscillator.surface_speed` u_t(a) [m/s].
    - States: `oscillator.position` x [m], `oscillator.speed` v [m/s], `oscillator.amplitude` q [m] and
      `oscillator.rate` q' [m/s], with one entry per mode.
    - Contact: `bar`.

    The energy of the bar is computed in a frame of reference that moves with its clamps.

    This model is a reconstruction of the oscillator of Hong et al. on a clamped-clamped axial bar. Only their statement
    about the two periods of the motion was available. The default values are examples without a source.

    Range of validity:

    - small strain;
    - motion of the mass much shorter than the bar, because the contact stays at one point of the bar;
    - periods longer than the period of the highest mode. A mode that has a node at the contact never moves.

    Examples
    --------
    >>> from models import OscillatorOnBar
    >>> from toolbox import compose
    >>> plant = compose(OscillatorOnBar())
    >>> print(plant.x.numel(), "states,", len(plant.elements), "contacts")
    8 states, 1 contacts
    """

    mass: Quantity = quantity(0.1, "kg", "mass m of the oscillator", above=0)
    stiffness: Quantity = quantity(4000.0, "N/m", "stiffness k of its spring", at_least=0)
    damping: Quantity = quantity(0.5, "N s/m", "viscous damping c to ground", at_least=0)
    load: Quantity = quantity(10.0, "N", "normal load", at_least=0)
    bar_speed: Quantity = quantity(0.05, "m/s", "speed V of the clamps")
    length: Quantity = quantity(0.5, "m", "length L of the bar", above=0)
    area: Quantity = quantity(1e-4, "m2", "cross-section A of the bar", above=0)
    modulus: Quantity = quantity(3e9, "Pa", "modulus E of the bar", above=0, typical_range=(1e5, 1e13))
    density: Quantity = quantity(1200.0, "kg/m3", "density rho of the bar", above=0, typical_range=(10.0, 30_000.0))
    loss: Quantity = quantity(0.02, "1", "damping ratio zeta of every mode", at_least=0)
    contact_position: Quantity = quantity(0.4, "1", "position of the contact as a fraction of the length", above=0, at_most=1)
    friction: FrictionLaw = Exponential(static=0.4, kinetic=0.25, decay=10.0)
    modes: int = 3

    def check(self):
        whole("oscillator.modes", self.modes, 1)
        number("oscillator.contact_position", self.contact_position, below=1)

    def equations(self, signal):
        x, v = state("oscillator.position", "m"), state("oscillator.speed", "m/s")
        q, r = state("oscillator.amplitude", "m", self.modes), state("oscillator.rate", "m/s", self.modes)
        wave = ca.vertcat(*range(1, self.modes + 1)) * math.pi
        shape = ca.sin(wave * self.contact_position)
        w = wave / self.length * ca.sqrt(self.modulus / self.density)
        modal_mass = self.density * self.area * self.length / 2
        surface = ca.dot(shape, r)
        push = signal("oscillator.force", "N", default=0.0)
        bar = DryFriction("bar", v - self.bar_speed - surface, self.friction, self.load)
        return Equations(
            flow={
                x: v,
                v: (push - self.stiffness * x - self.damping * v + bar.force) / self.mass,
                q: r,
                r: -(2 * self.loss * w * r + w**2 * q) - bar.force * shape / modal_mass,
            },
            outputs={"oscillator.surface_speed": (surface, "m/s")},
            elements=[bar],
            stored=self.mass * v**2 / 2 + self.stiffness * x**2 / 2 + modal_mass * (ca.dot(r, r) + ca.dot(w**2, q**2)) / 2,
            losses={
                "friction": -bar.force * (v - self.bar_speed - surface),
                "damping": self.damping * v**2,
                "bar": modal_mass * ca.dot(2 * self.loss * w, r**2),
            },
            supplies={"clamps": bar.force * self.bar_speed, "force": push * v},
        )
