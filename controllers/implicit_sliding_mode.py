"""Sliding mode for sampled drives without chatter: the sign is taken at the end of the sample, not at its beginning."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from controllers.sliding_mode import SlidingSurface
from toolbox import Quantity, Update, quantity, state


@dataclass(frozen=True)
class ImplicitSlidingMode(SlidingSurface):
    """The sliding mode of `SlidingMode` discretised implicitly: s_(k+1) = s_k - period eta sgn(s_(k+1)), sgn the set-valued sign.

        u = u_eq + J_r (Om' - d) - J_r eta sgn,   sgn(s_(k+1)) = clip(s_k / (eta period), -1, 1)
        d_(k+1) = d_k + learning s_k / period      while the sign is inside its clip and the torque inside its limits

    reaches s = 0 exactly in finitely many samples and then gives the equivalent control; the explicit sign chatters with eta times the period. Without d, an
    acceleration that the model lacks, such as that of a wrong drag, leaves s at the period times it, of first order. d learns it, so that what is left
    is its change, of second order. The rate Om' of the set-point is taken from its last two values; both are cut at eta. Sampled only. Source: V. Acary, B.
    Brogliato, Syst. Control Lett. 59 (2010) 284-293 (implicit Euler simulation and discretisation of sliding mode systems); d and Om' are choices of this
    file.

    Examples
    --------
    >>> from controllers import ImplicitSlidingMode
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(ImplicitSlidingMode(reference="60 rpm"), "10 ms")))
    Closed loop: TorsionalChain, BitRock
      ImplicitSlidingMode, sampled every 10 ms: reference 60 rpm, surface 0.2 1/s, reaching 2 rad/s2, inertia 2122 kg m2, drag 425 N m s/rad, learning 0.2
    """

    adaptation_gain: Quantity = quantity(
        0.2, "1", "part of what is left of s that is taken for an acceleration that the model lacks", at_least=0, at_most=1
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
