"""Linear-quadratic state feedback with integral action, around sliding at the set-point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from controllers.bumpless import acting, begun, over
from controllers.string_model import drilling_point
from controllers.torque_limits import TorqueLimits
from toolbox import Equations, Quantity, SceneError, Update, quantity, state
from toolbox.modelling import OptionalQuantities


@dataclass(frozen=True)
class LQR(TorqueLimits):
    """LQR state feedback of the string, with an integral of the error of the top speed.

        u = u_0 - K (x - x_0) - K_i z,   z' = w_top - reference
        K, K_i minimise  int (w_top - reference)^2 / top_speed_scale^2 + (w_bit - reference)^2 / bit_speed_scale^2
                             + z^2 / angle_scale^2 + (u - u_0)^2 / torque_scale^2  dt

    w_top and w_bit are the speeds of top and bit, u the torque of the drive, x the states of the string and z the
    integral of the error of the top speed.

    The scales follow Bryson's rule: a deviation by one scale costs the same for every quantity (A. E. Bryson, Y.-C. Ho,
    Applied Optimal Control, 1975).

    `design` linearises the plant with the bit sliding at `reference`. This operating point gives the states x_0 and the
    torque u_0, and the Riccati equation (solved by scipy) gives the gains K and K_i. If the set-point changes, x_0 and
    u_0 change with it by `operating_point_slope` per rad/s.

    Torque limits: if they are given, z has anti-windup by back-calculation. The term (wanted - command) / (K_i
    tracking_time) is added to z'. Here wanted is the torque u before the limits, and command the torque after the
    limits. In the sampled form the tracking time is at least one sample time.

    Start: in the sampled form z is initialised so that the first command equals the present torque (bumpless start,
    `controllers.bumpless`).

    The controller measures all states of the string.

    Range of validity: near the operating point. A stuck bit is freed slowly, because the state feedback K keeps the
    twist of the string near the twist x_0 of the operating point. Only the integral z increases the twist further,
    which takes tens of seconds at low set-points.

    Examples
    --------
    >>> from controllers import LQR
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), LQR(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      LQR, continuous: reference 60 rpm, top_speed_scale 19.1 rpm, bit_speed_scale 19.1 rpm, angle_scale 8 rad,
        torque_scale 3000 N m, tracking_time 5 s
    """

    @property
    def measured_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the measured signals: the top speed and, after the design, all states of the string."""
        return ("top.speed", *(self.states or ("bit.speed",)))

    reference: Quantity = quantity(8.0, "rad/s", "set-point of the speed", above=0, typical_range=(0.05, 40.0))
    top_speed_scale: Quantity = quantity(2.0, "rad/s", "scale of the deviation of the top speed in the cost", above=0)
    bit_speed_scale: Quantity = quantity(2.0, "rad/s", "scale of the deviation of the bit speed in the cost", above=0)
    angle_scale: Quantity = quantity(8.0, "rad", "scale of the integral in the cost", above=0)
    torque_scale: Quantity = quantity(3000.0, "N m", "scale of the deviation of the torque in the cost", above=0)
    tracking_time: Quantity = quantity(5.0, "s", "time constant of the anti-windup of the integral", above=0)
    states: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    gain: OptionalQuantities = quantity(None, "1", "K, then K_i; filled in by design")
    operating_point: OptionalQuantities = quantity(None, "1", "x_0, then u_0; filled in by design")
    operating_point_slope: OptionalQuantities = quantity(None, "1", "change of x_0 and u_0 per rad/s of set-point; filled in by design")

    def design(self, plant):
        """Return a copy of the controller with the fields `gain`, `operating_point` and `operating_point_slope` computed on the plant.

        If `gain` is given, the method returns this controller unchanged.

        Parameters
        ----------
        plant
            The plant on which the controller is designed.
        """
        if self.gain is not None:
            return self
        from scipy.linalg import solve_continuous_are

        model, x, u, A = drilling_point(plant, self.reference)
        n = x.size
        F, G = _with_integral(A, model.top), np.append(model.B, 0.0)[:, None]
        Q = np.zeros((n + 1, n + 1))
        Q[:n, :n] = np.outer(model.top, model.top) / self.top_speed_scale**2 + np.outer(model.bit, model.bit) / self.bit_speed_scale**2
        Q[n, n] = 1 / self.angle_scale**2
        P = solve_continuous_are(F, G, Q, np.array([[1 / self.torque_scale**2]]))
        gain = self.torque_scale**2 * (G.T @ P).ravel()
        poles = np.linalg.eigvals(F - G @ gain[None, :])
        if not poles.real.max() < -1e-12 * np.abs(poles).max():
            raise SceneError(
                f"LQR found no law that steers the whole string at {self.reference:g} rad/s: a pole is left at {poles.real.max():.3g} 1/s."
            )
        tangent = np.linalg.lstsq(
            np.vstack([np.column_stack([A, model.B]), np.append(model.top, 0.0)]), np.append(np.zeros(n), 1.0), rcond=1e-13
        )[0]
        return replace(
            self,
            states=model.states,
            units=model.units,
            gain=tuple(gain.tolist()),
            operating_point=(*x.tolist(), u),
            operating_point_slope=tuple(tangent.tolist()),
        )

    def _feedback(self, signal, angle) -> tuple[Any, Any]:
        """Torque wanted and deviation of the top speed."""
        if self.gain is None or self.operating_point is None or self.operating_point_slope is None:
            raise SceneError(
                "LQR needs the plant it acts on: call `design(plant)`, or give `gain`, `operating_point`, `operating_point_slope`, `states` and `units`."
            )
        reference = signal("top.reference", "rad/s", default=self.reference)
        target = [
            value + slope * (reference - self.reference)
            for value, slope in zip(self.operating_point, self.operating_point_slope, strict=True)
        ]
        x = [signal(name, unit) for name, unit in zip(self.states, self.units, strict=True)]
        wanted = target[-1] - self.gain[-1] * angle
        for gain, here, there in zip(self.gain, x, target[:-1], strict=False):
            wanted -= gain * (here - there)
        return wanted, signal("top.speed", "rad/s") - reference

    def continuous(self, signal):
        angle = state("lqr.angle", "rad")
        wanted, error = self._feedback(signal, angle)
        command, _ = self.limited(wanted)
        return Equations(flow={angle: self._rate(error, wanted, command)}, outputs={"top.torque": (command, "N m")})

    def sampled(self, signal, period):
        angle = state("lqr.angle", "rad")
        wanted, error = self._feedback(signal, angle)
        command, memory = self.limited(wanted, period)
        update = Update({angle: angle + period * self._rate(error, wanted, command, period), **memory}, {"top.torque": (command, "N m")})
        return begun(update, signal, "lqr", {angle: over(self._feedback(signal, 0.0)[0] - acting(signal), self.gain[-1])})

    def _rate(self, error, wanted, command, period=None):
        if command is wanted:
            return error
        tracking = self.tracking_time if period is None else ca.fmax(self.tracking_time, period)
        return error + (wanted - command) / (self.gain[-1] * tracking)


def _with_integral(A: np.ndarray, row: np.ndarray) -> np.ndarray:
    """A with one more state, the integral of row x."""
    n = A.shape[0]
    return np.block([[A, np.zeros((n, 1))], [row[None, :], np.zeros((1, 1))]])
