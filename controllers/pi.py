"""Proportional-integral control of the top-drive speed."""

from __future__ import annotations

from dataclasses import dataclass

from toolbox import Controller, Equations, Update, quantity, state


@dataclass(frozen=True)
class PI(Controller):
    """PI speed control: u = proportional e + integral int e dt, e = reference - top speed.

    Continuous, or sampled with u_k = proportional e_k + integral z_k, z_(k+1) = z_k + period e_k. The field `reference` is the stand-in of
    the signal `top.reference` [rad/s].
    """

    measures = ("top.speed",)
    drives = ("top.torque",)

    proportional: float = quantity(4000.0, "N m s/rad", "proportional gain", at_least=0)
    integral: float = quantity(1500.0, "N m/rad", "integral gain", at_least=0)
    reference: float = quantity(8.0, "rad/s", "set-point of the top-drive speed")

    def continuous(self, signal):
        angle = state("pi.angle", "rad")
        error = signal("top.reference", "rad/s", default=self.reference) - signal("top.speed", "rad/s")
        return Equations(
            flow={angle: error},
            gives={"top.torque": (self.proportional * error + self.integral * angle, "N m")},
        )

    def sampled(self, signal, period):
        angle = state("pi.angle", "rad")
        error = signal("top.reference", "rad/s", default=self.reference) - signal("top.speed", "rad/s")
        return Update(
            memory={angle: angle + period * error},
            outputs={"top.torque": (self.proportional * error + self.integral * angle, "N m")},
        )


@dataclass(frozen=True)
class StiffPI(PI):
    """PI speed control as stiff as drives are delivered: it holds the top speed and reflects torsional waves.

    The gains are chosen for a two-inertia rig (table of 2122 kg m2); they are the usual starting point that shows stick-slip.
    """

    proportional: float = quantity(2e4, "N m s/rad", "proportional gain", at_least=0)
    integral: float = quantity(2e3, "N m/rad", "integral gain", at_least=0)
