"""Sliding mode for sampled drives without chatter: the sign is taken at the end of the sample, not at its beginning."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from controllers.sliding_mode import SlidingSurface
from toolbox import Quantity, Update, quantity, state


@dataclass(frozen=True)
class ImplicitSlidingMode(SlidingSurface):
    """Sliding-mode control for sampled drives, discretised implicitly so that the torque does not chatter.

        s_(k+1) = s_k - period eta sgn(s_(k+1)),   sgn(s_(k+1)) = clip(s_k / (eta period), -1, 1)
        u = u_eq + J_r (Om' - d) - J_r eta sgn(s_(k+1))
        d_(k+1) = d_k + adaptation_gain s_k / period      if sgn is inside its clip and the torque inside its limits

    u is the torque of the drive. J_r is the inertia of the drive, Om the set-point of the top speed and eta the field
    `reaching_rate`. The surface s and the torque u_eq that keeps it constant are

        s = (w_r - Om) + lam int (w_r - Om) dt + lam int (w_r - w_b) dt
        u_eq = c_r w_r + tau - J_r lam [(w_r - Om) + (w_r - w_b)]

    with the top speed w_r, the bit speed w_b, the torque tau of the string on the drive, the drag c_r of the drive, and
    lam, the field `surface_gain`. sgn is the set-valued sign.

    - The controller reaches s = 0 exactly in finitely many samples and then gives the equivalent control. An explicit
      discretisation of the sign would chatter with the amplitude eta times the period.
    - d is an estimate of an acceleration that the model does not contain, for example because the drag of the model is
      wrong. Without d, a missing acceleration a leaves the error s = period a, which is of first order in the period.
      With d the remaining error depends only on the change of a and is of second order.
    - Om' is the rate of the set-point, from its last two values. Om' and d are limited to eta.

    The controller runs sampled only.

    Source: V. Acary, B. Brogliato, Syst. Control Lett. 59 (2010) 284-293 (implicit Euler simulation and discretisation
    of sliding mode systems).

    The terms with d and Om' are choices of this toolbox.

    Examples
    --------
    >>> from controllers import ImplicitSlidingMode
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(ImplicitSlidingMode(reference="60 rpm"), "10 ms")))
    Closed loop: TorsionalChain, BitRock
      ImplicitSlidingMode, sampled every 10 ms: reference 60 rpm, surface_gain 0.2 1/s, reaching_rate 2 rad/s2, inertia
        2122 kg m2, drag 425 N m s/rad, adaptation_gain 0.2
    """

    adaptation_gain: Quantity = quantity(
        0.2, "1", "fraction of the remaining s that is attributed to an acceleration missing in the model", at_least=0, at_most=1
    )

    def sampled(self, signal, period):
        angle, lacked = state("slidingmode.angle", "rad"), state("slidingmode.acceleration", "rad/s2")
        before = state("slidingmode.reference", "rad/s")
        signal, sent = self.ahead(signal, period, lacked)
        rate, s, equivalent = self.terms(signal, angle)
        reference = signal("top.reference", "rad/s", default=self.reference)
        moving = ca.if_else(before == 0.0, 0.0, self._cut((reference - before) / period))
        sign = ca.fmin(ca.fmax(s / (self.reaching_rate * period), -1), 1)
        wanted = equivalent + self.inertia * (moving - lacked - self.reaching_rate * sign)
        command, memory = self.limited(wanted, period)
        inside = (ca.fabs(sign) < 1) * (1 if command is wanted else command == wanted)
        learned = self._cut(lacked + inside * self.adaptation_gain * s / period)
        update = Update(
            memory={
                angle: angle + period * self.taken_up(rate, wanted, command),
                lacked: learned,
                before: reference,
                **sent(command),
                **memory,
            },
            outputs={"top.torque": (command, "N m"), "slidingmode.surface": (s, "rad/s")},
        )
        return self.started(
            update, signal, {before: reference, angle: self.angle_at(signal, self.reaching_rate * period * self.lacking(signal))}
        )

    def _cut(self, acceleration):
        return ca.fmin(ca.fmax(acceleration, -self.reaching_rate), self.reaching_rate)
