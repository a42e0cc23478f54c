"""A drag bit that cuts: every blade removes what the blade before it left, and the wear flats rub.

The depth of cut is the distance between the bit and the rock that the blade ahead cut one blade angle earlier, so the equations have a delay
that depends on the motion. Here the rock between two blades is carried along as states: q(s) is the height of the rock above the blade tip, s = 0
just behind a blade, s = 1 at the face of the next. Rock that the bit passes at speed w and leaves behind at axial speed v obeys

    q_t + w/(2 pi/n) q_s = v,   q(0) = min(0, q(1))

The boundary says that a blade leaves the rock at its own depth where it cuts, and as it was where it passes above it. q is a polynomial through
the Radau points of (0, 1], which include s = 1: no history, no interpolation, and no state that grows with the depth of the hole.

Why Radau points, not Chebyshev's: both converge spectrally where the rock is smooth. While the bit is off bottom the boundary closes the interval
to a ring, on which Chebyshev's extrema let some waves grow (7e-3 per blade angle at 24 points); Radau points let none grow, and their largest
eigenvalue on bottom, which limits the steps, is less than half.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from models.friction import Coulomb
from toolbox import Component, DryFriction, Equations, Quantity, quantity, state
from toolbox.authoring import whole


def radau(n: int) -> tuple[np.ndarray, np.ndarray]:
    """The point 0 and the n Radau points of (0, 1], shape (n+1,), and the matrix that takes values there to slopes there, (n+1, n+1)."""
    legendre = np.zeros(n + 1)
    legendre[n - 1 :] = -1.0, 1.0
    roots = np.polynomial.legendre.legroots(legendre).real  # all are real, but some versions of numpy return them as complex numbers
    points = np.append(0.0, (np.sort(roots) + 1) / 2)
    points[-1] = 1.0
    distance = points[:, None] - points + np.eye(n + 1)
    products = distance.prod(axis=1)
    slopes = products[:, None] / products / distance
    np.fill_diagonal(slopes, 0.0)
    return points, slopes - np.diag(slopes.sum(axis=1))


@dataclass(frozen=True)
class DragBit(Component):
    """Drag bit with n blades, which cuts and rubs (model of Richard, Germay and Detournay).

        T = eps a^2 d/2 + mu gamma (a/2) W_f,   W = zeta eps a d + W_f,   d = n q(1) on bottom, 0 off bottom

    T is the torque, W the weight on bit and d the depth of cut per revolution. Symbols and their fields: a `radius` [m]
    of the bit, eps `specific_energy` [Pa] of the rock, mu `friction` [1] at the wear flats, gamma `bit_geometry_number`
    [1], zeta `cutter_inclination` [1], the ratio of axial to tangential cutting force, l `flat_length` [m] of the wear
    flats, sigma `flat_stress` [Pa] under the wear flats, n `blades`. q is the height of the rock above the blade tip
    between two blades: q(s) = height at the fraction s of the blade angle, so q(1) is the height at the face of the
    next blade.

    Contacts:

    - `bit.axial`: the wear flats carry the weight W_f = l a sigma while the bit moves down, nothing while it moves up,
      and any value between 0 and l a sigma at rest. Below a depth of cut of `engagement_depth` the wear flats carry a
      proportional part, so that the force does not jump at touchdown.
    - `bit`: both parts of the torque resist forward rotation. Only the wear flats resist backward rotation. At rest the
      bit holds any torque between the torques of backward and forward rotation.

    Signals:

    - Needs `bit.speed` w [rad/s] and `bit.axial_speed` v [m/s], positive downwards.
    - Gives `bit.torque` T [N m], `bit.weight` W [N] and `bit.cut_depth` d [m], which is negative off bottom.
    - States: `bit.profile` q (nodes) [m].

    With `has_prescribed_speed` the speed of rotation is the input `bit.speed` (default 10 rad/s), which must not be
    negative. The bit then has no contact `bit`.

    `nodes`: use eight nodes per axial oscillation between two blades. With too few nodes the bit may lift off for
    numerical reasons.

    Source: T. Richard, C. Germay, E. Detournay, J. Sound Vib. 305 (2007).

    Assumptions: all default values have the size of the values in the source. `engagement_depth` and equal blades are
    assumptions. Backward rotation is not part of the source: here the rock ahead waits until the blades move forward
    again, and rock is not cut twice.

    Range of validity: rotation with |v| < a w/(2 zeta). In this range the rock only dissipates energy. A bit that is
    thrown off bottom and lands again leaves this range: the cutting force does not depend on the direction of v, so it
    acts like a spring and throws the bit up again, and higher. Treat a run with negative `bit.cut_depth` as a warning,
    not as a prediction.

    A bit at rest needs some torque in the string. With zero torque, while the wear flats carry nothing, the bit is
    exactly at the limit of the torque that it can hold.

    Examples
    --------
    >>> from models import AxialChain, DragBit, TorsionalPendulum
    >>> from toolbox import compose
    >>> plant = compose(AxialChain(), TorsionalPendulum(), DragBit())
    >>> print(plant.x.numel(), "states,", len(plant.elements), "contacts")
    20 states, 2 contacts
    """

    radius: Quantity = quantity(0.108, "m", "radius a of the bit", above=0, typical_range=(0.01, 1.0))
    specific_energy: Quantity = quantity(60e6, "Pa", "energy eps per volume of rock cut", at_least=0, typical_range=(1e5, 1e10))
    cutter_inclination: Quantity = quantity(0.6, "1", "ratio zeta of axial to tangential cutting force", at_least=0)
    friction: Quantity = quantity(0.6, "1", "coefficient mu of friction at the wear flats", at_least=0)
    bit_geometry_number: Quantity = quantity(1.0, "1", "bit geometry number gamma", at_least=0)
    flat_length: Quantity = quantity(1.2e-3, "m", "length l of the wear flats of all blades", at_least=0, typical_range=(1e-5, 0.1))
    flat_stress: Quantity = quantity(60e6, "Pa", "contact stress sigma under the wear flats", at_least=0, typical_range=(1e5, 1e10))
    engagement_depth: Quantity = quantity(1e-5, "m", "depth of cut above which the wear flats carry their full load (assumed)", above=0)
    blades: int = 4
    nodes: int = 16
    has_prescribed_speed: bool = False

    def check(self):
        for name in ("blades", "nodes"):
            whole(f"bit.{name}", getattr(self, name), 1)

    def equations(self, signal):
        speed = signal("bit.speed", "rad/s", default=10.0) if self.has_prescribed_speed else signal("bit.speed", "rad/s")
        axial_speed = signal("bit.axial_speed", "m/s")
        profile = state("bit.profile", "m", self.nodes)
        depth = self.blades * profile[-1]
        cut = ca.fmax(depth, 0)
        share = ca.fmin(cut / self.engagement_depth, 1)
        cutting_torque = self.specific_energy * self.radius**2 * cut / 2

        # a force between 0 and 2 b is b plus dry friction of bound b
        half = share * self.flat_length * self.radius * self.flat_stress / 2
        flats = DryFriction("bit.axial", axial_speed, Coulomb(1.0, 1.0), half)
        flat_weight = half - flats.force
        flat_torque = self.friction * self.bit_geometry_number * self.radius / 2 * flat_weight
        turns = speed * self.blades / (2 * math.pi)
        if self.has_prescribed_speed:
            elements, torque, passing = [flats], cutting_torque + flat_torque, ca.fmax(turns, 0)
        else:
            bit = DryFriction("bit", speed, Coulomb(1.0, 1.0), cutting_torque / 2 + flat_torque, slip_unit="rad/s", force_unit="N m")
            elements, torque = [flats, bit], cutting_torque / 2 - bit.force
            passing = bit.mode * (1 + bit.mode) / 2 * turns  # blade angles per second, while the bit turns forward
        _, slopes = radau(self.nodes)
        along = ca.DM(slopes[1:, 1:]) @ profile + ca.DM(slopes[1:, 0]) * ca.fmin(profile[-1], 0)
        return Equations(
            flow={profile: axial_speed - passing * along},
            outputs={
                "bit.torque": (torque, "N m"),
                "bit.weight": (self.cutter_inclination * self.specific_energy * self.radius * cut + flat_weight, "N"),
                "bit.cut_depth": (depth, "m"),
            },
            elements=elements,
            stored=0.0,  # what it takes is cut or rubbed away
        )
