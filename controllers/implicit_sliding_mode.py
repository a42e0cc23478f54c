"""Sliding mode for sampled drives without chatter: the sign is taken at the end of the sample, not at its beginning."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from controllers.bumpless import begun
from controllers.sliding_mode import SlidingSurface
from toolbox import Update, state


@dataclass(frozen=True)
class ImplicitSlidingMode(SlidingSurface):
    """The sliding mode of `SlidingMode` discretised implicitly: s_(k+1) = s_k - period eta sgn(s_(k+1)), sgn the set-valued sign.

        sgn(s_(k+1)) = clip(s_k / (eta period), -1, 1)

    reaches s = 0 exactly in finitely many samples and then gives the equivalent control, so that what is left of s is what the model of one
    sample lacks, of second order in the period; the explicit sign chatters with eta times the period. Sampled only. Source: V. Acary, B.
    Brogliato, Syst. Control Lett. 59 (2010) 284-293 (implicit Euler simulation and discretisation of sliding mode systems).
    """

    def sampled(self, signal, period):
        angle = state("slidingmode.angle", "rad")
        rate, s, equivalent = self.terms(signal, angle)
        sign = ca.fmin(ca.fmax(s / (self.reaching * period), -1), 1)
        wanted = equivalent - self.inertia * self.reaching * sign
        command, memory = self.limited(wanted, period)
        update = Update(
            memory={angle: angle + period * self.taken_up(rate, wanted, command), **memory},
            outputs={"top.torque": (command, "N m"), "slidingmode.surface": (s, "rad/s")},
        )
        return begun(update, signal, "slidingmode", {angle: self.angle_at(signal, self.reaching * period * self.lacking(signal))})
