"""Axial motion of a drill string: a row of masses between the hook and the bit."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca

from toolbox import Component, Equations, Quantity, SceneError, quantity, state
from toolbox.authoring import entries
from toolbox.modelling import OptionalQuantity, Quantities


@dataclass(frozen=True)
class AxialChain(Component):
    """Axial drill string: masses in a row from the hook (first) to the bit (last), joined by springs and dampers.

        m_i v_i' = N_i - N_(i-1) - drag m_i v_i,   N_i = k_i stretch_i + c_i (v_(i+1) - v_i),   stretch_i' = v_(i+1) - v_i

    The masses are i = 1 to n, top first. v_i is the speed of mass i, and N_i the force between the masses i and i+1,
    positive in tension. Symbols and their fields: m_i `mass` [kg], k_i `stiffness` [N/m], c_i `damping` [N s/m], `drag`
    [1/s], gravity `gravity` [m/s2], H `hook_load` [N].

    Speeds are positive downwards. Stretches and forces are counted from the string that hangs freely, where all of them
    are zero. So the weight appears only at the hook: N_0 = H - G at the first mass and N_n = -W at the last mass. H is
    the hook load, G = gravity sum m_i the weight and W the weight on bit. One mass is a rigid string.

    There are two kinds of top end:

    - With `hook_load` the hook load H is imposed. n masses have n-1 springs and 2n-1 states. The entry `stiffness[0]` is
      k_1, the spring between the first two masses, and `stiffness[n-2]` is k_(n-1).
    - Without `hook_load` the hook moves at a given speed and carries the string with hoisting lines. n masses then have
      n springs and 2n states. The entry `stiffness[0]` is k_0, the hoisting lines, and `stiffness[n-1]` is k_(n-1). The
      stretch of the hoisting lines gives N_0 = k_0 stretch_0 + c_0 stretch_0', with the hook speed as speed v_0 above
      the lines.

    The fields `mass`, `stiffness` and `damping` are tuples, whose entries are counted from 0. `damping` and the state
    `axial.stretch` have the same order as `stiffness`. The states are `axial.stretch` [m], one entry for each spring, and
    `axial.speed` (n) [m/s].

    - Needs the signals `hook.load` [N] (default: the field `hook_load`) or `hook.speed` [m/s], positive downwards
      (default 0), and `bit.weight` W [N] (default 0: off bottom).
    - Gives the signals `bit.axial_speed` [m/s] and, without `hook_load`, `hook.load` [N].

    A model of the contact between bit and rock gives the weight on bit: `ElasticRock`, `DragBit`.

    Source: textbook.

    The default values are examples without a source: they have the size of a 1000 m string on ten lines.

    Examples
    --------
    >>> from models import AxialChain
    >>> from toolbox import compose
    >>> print(compose(AxialChain()))
    HybridSystem(AxialChain): 2 states (axial.stretch, axial.speed); contacts: none; inputs: bit.weight [N], hook.speed [m/s]
    """

    mass: Quantities = quantity((34_000.0,), "kg", "masses, top first", above=0, typical_range=(1e-3, math.inf))
    stiffness: Quantities = quantity((4e6,), "N/m", "stiffness of the hoisting lines, if any, then between neighbours", at_least=0)
    damping: Quantities = quantity((4e4,), "N s/m", "damping beside every stiffness", at_least=0)
    drag: Quantity = quantity(0.0, "1/s", "viscous drag per mass", at_least=0)
    gravity: Quantity = quantity(9.81, "m/s2", "gravity, minus buoyancy if this matters", at_least=0)
    hook_load: OptionalQuantity = quantity(
        None, "N", "imposed load on the hook; none behind hoisting lines", at_least=0, typical_range=(500.0, 1e8)
    )

    def check(self):
        n = len(self.mass)
        if not n:
            raise SceneError("Argument `axial.mass` must hold at least 1 mass, but it is empty.")
        springs = n if self.hook_load is None else n - 1
        reason = "one per mass, the hoisting lines first" if self.hook_load is None else "one less than masses where `hook_load` is imposed"
        for name in ("stiffness", "damping"):
            entries(f"axial.{name}", getattr(self, name), springs, f", {reason}")

    def equations(self, signal):
        n, springs = len(self.mass), len(self.stiffness)
        speed = state("axial.speed", "m/s", n)
        stretch = state("axial.stretch", "m", springs) if springs else ca.SX(0, 1)
        weight_on_bit = signal("bit.weight", "N", default=0.0)
        mass, stiffness, damping = (ca.vertcat(ca.SX(0, 1), *values) for values in (self.mass, self.stiffness, self.damping))
        free_weight = self.gravity * ca.sum1(mass)
        lines = self.hook_load is None
        hook = signal("hook.speed", "m/s", default=0.0) if lines else signal("hook.load", "N", default=self.hook_load)
        ends = [*([hook] if lines else []), *(speed[i] for i in range(n))]
        rate = ca.vertcat(ca.SX(0, 1), *(below - above for above, below in pairwise(ends)))
        tension = stiffness * stretch + damping * rate
        pulls = [*([] if lines else [hook - free_weight]), *(tension[i] for i in range(springs)), -weight_on_bit]
        force = ca.vertcat(*(below - above for above, below in pairwise(pulls))) - self.drag * mass * speed
        gives = {"bit.axial_speed": (speed[-1], "m/s")}
        if lines:
            gives["hook.load"] = (free_weight + tension[0], "N")
        return Equations(
            flow={**({stretch: rate} if springs else {}), speed: force / mass},
            outputs=gives,
            stored=ca.dot(mass, speed**2) / 2 + ca.dot(stiffness, stretch**2) / 2,
            losses={"damping": ca.dot(damping, rate**2), "drag": self.drag * ca.dot(mass, speed**2)},
            supplies={"hook": -pulls[0] * ends[0], "bit weight": -weight_on_bit * speed[-1]},
        )
