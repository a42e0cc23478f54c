"""Rate and state: friction that depends on the slip speed and on how long the present contacts have been there."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from toolbox import FrictionLaw, Quantity, quantity


@dataclass(frozen=True)
class RateAndState(FrictionLaw):
    """Rate-and-state friction of Dieterich and Ruina: mu = mu_0 + a ln(v / v_0) + b psi, with psi = ln(v_0 theta / D_c).

        ageing:  theta' = 1 - v theta / D_c            psi' = (v_0 exp(-psi) - v) / D_c
        slip:    theta' = -(v theta / D_c) ln(v theta / D_c)    psi' = -(v / D_c) (ln(v / v_0) + psi)

    mu is the coefficient of friction, theta the age of the contacts [s] and v the slip speed [m/s]. If the speed
    changes suddenly by a factor r, mu changes by a ln r at once and by -b ln r over the distance D_c.

    Steady friction is mu_0 + (a - b) ln(v / v_0). It falls with the speed if b > a. Sliding of a mass m on a spring of
    stiffness k is then stable if k > N (b - a) / D_c (1 + m v^2 / (N a D_c)).

    Near rest the logarithm is not valid. It is replaced by mu = a asinh(v / (2 v_0) exp((mu_0 + b psi) / a)), the sum
    of forward and backward jumps over a barrier. Both formulas are equal to round-off for v far above v_0 exp(-mu_0 /
    a). Consequences:

    - Nothing sticks exactly: a contact at rest creeps.
    - On rock the speed v_0 exp(-mu_0 / a) is below 1e-30 m/s, which a computation cannot pass from rest. Below the
      speed `regularisation_speed` (floor) friction is therefore viscous: the friction at the speed sqrt(v^2 + floor^2),
      multiplied by v / sqrt(v^2 + floor^2).

    The state of a contact `pad` is `pad.age` psi. It begins at 0, which is steady sliding at v_0.

    Symbols and their fields: mu_0 `base` [1], a `direct` [1], b `evolving` [1], D_c `distance` [m], v_0 `speed` [m/s].
    `ageing` chooses between the equations "ageing" (True, default) and "slip" (False).

    Range of validity: b psi > -mu_0. The default values are examples of the size measured on rock.

    Sources: A. Ruina, J. Geophys. Res. 88 (1983) 10359-10370; J. R. Rice, A. L. Ruina, J. Appl. Mech. 50 (1983) 343-349
    (stability, with mass); J. R. Rice, Y. Ben-Zion, PNAS 93 (1996) 3811-3818, and N. Lapusta et al., J. Geophys. Res.
    105 (2000) 23765-23789 (near rest).

    Examples
    --------
    >>> from models import RateAndState
    >>> law = RateAndState()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [0.542, 0.531, 0.519]
    """

    base: Quantity = quantity(0.6, "1", "coefficient mu_0 of steady sliding at v_0", above=0)
    direct: Quantity = quantity(0.010, "1", "a, of the direct effect of the speed", above=0)
    evolving: Quantity = quantity(0.015, "1", "b, of the effect of the age", at_least=0)
    distance: Quantity = quantity(1e-5, "m", "slip D_c over which contacts are renewed (rad for rotation)", above=0)
    speed: Quantity = quantity(1e-6, "m/s", "reference speed v_0 (rad/s for rotation)", above=0)
    regularisation_speed: Quantity = quantity(1e-12, "m/s", "speed below which friction is viscous (rad/s for rotation)", above=0)
    ageing: bool = True

    def memory(self, directions):
        return {"age": ("1", 0.0)}

    def sliding(self, speed):
        return self.direct * ca.asinh(speed / (2 * self.speed) * ca.exp((self.base - self.evolving * self._log(speed)) / self.direct))

    def breakaway(self):
        return ca.SX(0)

    def evolution(self, slip, speed, load, memory):
        psi = memory["age"]
        moved = ca.sqrt(ca.sumsqr(slip) + self.regularisation_speed**2)
        friction = self.direct * ca.asinh(moved / (2 * self.speed) * ca.exp((self.base + self.evolving * psi) / self.direct)) * slip / moved
        speed = ca.sqrt(ca.sumsqr(slip) + (1e-15 * self.speed) ** 2)  # without a kink, which what creeps to and fro would pass for ever
        renewed = self.speed * ca.exp(-psi) - speed if self.ageing else -speed * (self._log(speed) + psi)
        return friction, {"age": renewed / self.distance}

    def _log(self, speed):
        return ca.log(speed / self.speed + 1e-300)
