"""A contact that slips region by region: a row of bristles, each a spring in series with a dry slider (Jenkins elements, an Iwan model).

Why a play operator and no bristle mass: the slider of a bristle has no mass and sits behind a spring, so its friction force is the state of
the spring, and no force of its own acts on its slip. What can be chosen at the bound is its slip: z' = v - w with |z| <= z_b, where w is zero inside, and
whatever keeps z at the bound as long as v points outward. That is a relay in s = (q - 1) / (q + 1), q = (z / z_b)^2, with w = z u, u >= 0: its
"sliding mode" s = 0 is the bristle slipping at its bound, and it ends exactly where v turns round. A small mass at each tip would make
the bristle a `DryFriction`, at the price of a fast oscillation per bristle that the physics does not have and an explicit method must follow; a parallel damper
would add a viscous force and the same stiffness. The play is exact and has no time constant at all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from toolbox import Component, Equations, Quantity, SceneError, quantity, state
from toolbox.authoring import entries, whole
from toolbox.modelling import OptionalQuantities, Relay


def parabolic_shares(n: int) -> tuple[float, ...]:
    """Compute the fractions of the load that strips of equal width of a rounded (parabolic) contact carry.

    The fractions are in order across the contact and add up to 1. The pressure 3/4 (1 - s^2), -1 <= s <= 1, is
    integrated over each strip. Source: textbook, Winkler foundation under a parabolic punch.

    Parameters
    ----------
    n
        Number of strips, >= 1.

    Returns
    -------
    tuple of float
        The fractions, shape (n,).

    Raises
    ------
    SceneError
        If n < 1.

    Examples
    --------
    >>> from models import parabolic_shares
    >>> print([round(share, 3) for share in parabolic_shares(5)])
    [0.104, 0.248, 0.296, 0.248, 0.104]
    """
    whole("n", n, 1)

    def below(i: int) -> float:
        s = 2 * i / n - 1
        return (3 * s - s**3) / 4

    return tuple(below(i + 1) - below(i) for i in range(n))


FASTEST = 1e4
"""How fast a bound may shrink, in parts of itself per second, without a bristle left beyond it."""


class _Bristle(Relay):
    """The relay of one bristle under the names of what it does: it slips where the relay slides."""

    mode_names: Mapping[int, str] = {0: "slip", -1: "stick", 1: "beyond"}


@dataclass(frozen=True)
class BristleContact(Component):
    """Contact of a slider on a plate as n bristles without inertia, which share the load and stick and slip independently.

        z_i' = v - v_plate - w_i ,   F = -sum k/n z_i ,   |k/n z_i| <= mu N share_i ,   w_i = 0 unless at the bound

    Symbols and their fields: k `stiffness` [N/m], mu `friction` [1], share_i `shares` [1], n `n`.

    z_i is the deflection and w_i the slip speed of bristle i. k is the stiffness of the whole row, N the load and
    share_i the fraction of the load on bristle i. Under loading from rest F(x) = sum min(k x / n, mu N share_i), and
    reversals follow Masing's rule.

    - Needs the signals `slider.speed` v [m/s] (default 0), `plate.speed` v_plate [m/s] (default 0), `plate.load` N [N]
      (default: the field `load`).
    - Gives the signals `plate.drag` F [N], the force on the slider, and `plate.stuck` [1], the fraction of the bristles
      below their bound.
    - State: `plate.stretch` z (n) [m], which begins at 0.
    - Elements: `plate.i` with the modes "stick" and "slip" and the signals `plate.i.force` [N] and `plate.i.slip` w_i
      [m/s].

    Range of validity:

    - A varying load must stay above 0. If its relative rate of fall -N' / N exceeds 1e4 1/s, the spring force of a
      bristle may stay above its bound (mode "beyond").
    - Static and kinetic friction have the same coefficient mu. With a lower kinetic coefficient, a bristle without
      inertia would jump.

    Source: textbook (Jenkins element, Iwan model).

    The default stiffness is an assumption.

    Examples
    --------
    >>> from models import BristleContact
    >>> from toolbox import compose
    >>> plant = compose(BristleContact())
    >>> print(plant.x.numel(), "states,", len(plant.elements), "contacts")
    16 states, 16 contacts
    """

    n: int = 16
    shares: OptionalQuantities = quantity(None, "1", "fractions of the load, one per bristle; None for a parabolic contact", above=0)
    load: Quantity = quantity(10.0, "N", "normal load", above=0)
    stiffness: Quantity = quantity(1e6, "N/m", "tangential stiffness of all bristles (assumed)", above=0)
    friction: Quantity = quantity(0.35, "1", "coefficient of friction", above=0)

    def check(self):
        expected = len(parabolic_shares(self.n))
        if self.shares is None:
            return
        entries("plate.shares", self.shares, expected, ", one per bristle")
        if abs(sum(self.shares) - 1) > 1e-9:
            raise SceneError(f"Argument `plate.shares` must add up to 1, but the sum is {sum(self.shares):.12g}.")

    def equations(self, signal):
        n, shares = self.n, parabolic_shares(self.n) if self.shares is None else self.shares
        z = state("plate.stretch", "m", n)
        v, plate_speed = signal("slider.speed", "m/s", default=0.0), signal("plate.speed", "m/s", default=0.0)
        load = signal("plate.load", "N", default=self.load)
        slip = v - plate_speed
        bound = self.friction * load * ca.vertcat(*shares) * n / self.stiffness
        relays, excess = [], []
        for i in range(n):
            # any ceiling above what slipping takes will do, for then only the turn of the slip ends it
            ceiling = 2 * ca.sqrt((slip / bound[i]) ** 2 + FASTEST**2)
            q = (z[i] / bound[i]) ** 2
            relays.append(_Bristle(f"plate.{i}", (q - 1) / (q + 1), ceiling, force_unit="1/s"))
            excess.append((ceiling - relays[-1].force) / 2)
        slider_slip = ca.vertcat(*excess) * z
        force = -self.stiffness / n * z
        drag = ca.sum1(force)
        each = {f"plate.{i}.force": (force[i], "N") for i in range(n)} | {f"plate.{i}.slip": (slider_slip[i], "m/s") for i in range(n)}
        return Equations(
            flow={z: slip - slider_slip},
            outputs={"plate.drag": (drag, "N"), "plate.stuck": (sum(relay.mode**2 for relay in relays) / n, "1")} | each,
            elements=relays,
            stored=self.stiffness / n * ca.sumsqr(z) / 2,
            losses={"friction": -ca.dot(force, slider_slip)},
            supplies={"plate drive": drag * plate_speed, "slider": -drag * v},
        )
