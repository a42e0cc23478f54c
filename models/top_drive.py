"""A top drive between a controller and the string: what a motor makes of the torque that a control law asks for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from models.gears import tooth_friction
from toolbox import Component, Equations, Quantity, SceneError, quantity, state
from toolbox.modelling import OptionalQuantity


@dataclass(frozen=True)
class TopDrive(Component):
    """Motor, gearbox and encoder of a top drive, with their limits and lags.

        command u:      u_m = clip(u / n, +-T_max)                          n gear ratio, T_max torque limit of the motor
        drive:          T_m' = clip((u_m - T_m) / t_drive, +-R)             R rate limit; without lag T_m = u_m
        gearbox, rigid: T_top = n T_m eta^s                                 s = sgn(T_m w_top): set-valued friction of the teeth, and an idle torque
        with inertia:   J_m w_m' = T_m - (T_top / n) eta^-s,  twist' = w_m / n - w_top,  T_top = k twist + c twist'
        encoder:        w' = (w_m / n - w) / t_encoder                      without lag w = w_m / n; rigid: w_m = n w_top

    Symbols and their fields: n `ratio` [1], T_max `torque_limit` [N m], t_drive `drive_lag` [s], R `rate_limit` [N
    m/s], eta `efficiency` [1], J_m `motor_inertia` [kg m2], k `stiffness` [N m/rad], c `damping` [N m s/rad], t_encoder
    `encoder_lag` [s].

    In a plant, the top drive is connected between the controllers and the string. The controllers need no change:

    - A controller that gives `top.torque` gives `drive.command` instead. The command is the torque that the controller
      wants at the top if the drive had no losses.
    - A controller that measures `top.speed` measures `drive.speed` instead.

    Signals:

    - Needs `drive.command` u [N m] (default 0) and `top.speed` w_top [rad/s].
    - Gives `top.torque` T_top [N m], `drive.torque` T_m [N m] and `drive.speed` w [rad/s].
    - Contact, with an efficiency: `drive`.

    Optional features (None: off):

    - A lag adds one state.
    - `motor_inertia`, with stiffness and damping of its shaft as seen from the top, adds two states. If `motor_inertia`
      is None, the first inertia of the string includes the inertia of the motor, as in published parameter sets.
    - An efficiency, with an idle torque, adds one contact.
    - A limit adds one kink. The rate limit needs the lag, because without a lag it would be a relay.

    An ideal sliding mode needs a drive without lags, limits and efficiency, because no motor can switch its torque
    instantly.

    Defaults: lags of 5 ms and 2 ms, which are typical but have no source.

    Examples
    --------
    >>> from models import BitRock, TopDrive, wells
    >>> from toolbox import compose
    >>> print(compose(wells.JANSEN_2, BitRock(), TopDrive(torque_limit="20 kN m")))
    HybridSystem(TorsionalChain, BitRock, TopDrive): 5 states (chain.twist, chain.speed, drive.torque, drive.speed); contacts: bit; inputs:
      bit.weight [N], drive.command [N m]
    """

    drive_lag: OptionalQuantity = quantity(0.005, "s", "time constant from command to motor torque", above=0)
    encoder_lag: OptionalQuantity = quantity(0.002, "s", "time constant of the measured speed", above=0)
    torque_limit: OptionalQuantity = quantity(None, "N m", "largest torque of the motor T_max", above=0, typical_range=(100.0, 1e6))
    rate_limit: OptionalQuantity = quantity(None, "N m/s", "largest rate of the motor torque R", above=0)
    ratio: Quantity = quantity(1.0, "1", "gear ratio n, motor speed by top speed", above=0)
    efficiency: OptionalQuantity = quantity(None, "1", "efficiency eta of the gearbox", above=0, at_most=1)
    idle_torque: OptionalQuantity = quantity(None, "N m", "friction of the gearbox without load, at the top", above=0)
    motor_inertia: OptionalQuantity = quantity(None, "kg m2", "inertia J_m of the motor", above=0, typical_range=(1e-3, math.inf))
    stiffness: OptionalQuantity = quantity(
        None, "N m/rad", "stiffness k between gearbox and string", above=0, typical_range=(1.0, math.inf)
    )
    damping: OptionalQuantity = quantity(None, "N m s/rad", "damping c between gearbox and string", at_least=0)

    def check(self):
        if self.rate_limit is not None and self.drive_lag is None:
            raise SceneError("Argument `drive.rate_limit` must come with `drive.drive_lag`, but there is none.")
        if (self.efficiency is None) != (self.idle_torque is None):
            raise SceneError("Arguments `drive.efficiency` and `drive.idle_torque` must be given together, but one is missing.")
        shaft = {"motor_inertia": self.motor_inertia, "stiffness": self.stiffness, "damping": self.damping}
        missing = [name for name, value in shaft.items() if value is None]
        if 0 < len(missing) < len(shaft):
            raise SceneError(
                f"Arguments `drive.motor_inertia`, `drive.stiffness` and `drive.damping` must be given together, but `{missing[0]}` is missing."
            )

    @property
    def redirected_signals(self):
        """{"top.torque": "drive.command", "top.speed": "drive.speed"}: a controller that uses the first signal is connected to the second signal."""
        own = self.name or "drive"
        return {"top.torque": f"{own}.command", "top.speed": f"{own}.speed"}

    @property
    def signal_limits(self):
        """Physical limits of the motor torque, as {signal: (lowest, highest)} [N m]. Empty without a torque limit.
        Figures of a run draw these limits.

        Limits of `top.torque` are included if this torque is proportional to the motor torque (no motor inertia and no
        efficiency).
        """
        if self.torque_limit is None:
            return {}
        motor = (-self.torque_limit, self.torque_limit)
        direct = self.motor_inertia is None and self.efficiency is None
        return {f"{self.name or 'drive'}.torque": motor} | (
            {"top.torque": (self.ratio * motor[0], self.ratio * motor[1])} if direct else {}
        )

    def equations(self, signal):
        top_speed = signal("top.speed", "rad/s")
        flow, elements, losses, stored = {}, [], {}, None

        wanted = signal("drive.command", "N m", default=0.0) / self.ratio
        if self.torque_limit is not None:
            wanted = _clipped(wanted, self.torque_limit)
        torque = wanted
        if self.drive_lag is not None:
            torque = state("drive.torque", "N m")
            rate = (wanted - torque) / self.drive_lag
            flow[torque] = rate if self.rate_limit is None else _clipped(rate, self.rate_limit)

        if self.motor_inertia is None:
            speed = top_speed  # all speeds as seen from the top
            delivered = self.ratio * torque
            if self.efficiency is not None:
                # the same friction as in `tooth_friction`, seen from the driven side: n T_m is what the teeth receive
                delivered, friction = tooth_friction("drive", speed, delivered, self.efficiency, self.idle_torque)
                elements.append(friction)
                delivered = delivered + friction.force
                losses["teeth"] = (self.ratio * torque - delivered) * speed
        else:
            motor, twist = state("drive.motor_speed", "rad/s"), state("drive.twist", "rad")
            speed = motor / self.ratio
            slip = speed - top_speed
            delivered = self.stiffness * twist + self.damping * slip
            needed = delivered
            if self.efficiency is not None:
                needed, friction = tooth_friction("drive", speed, delivered, self.efficiency, self.idle_torque)
                elements.append(friction)
                needed = needed - friction.force
                losses["teeth"] = (needed - delivered) * speed
            flow |= {motor: (torque - needed / self.ratio) / self.motor_inertia, twist: slip}
            stored = self.motor_inertia * motor**2 / 2 + self.stiffness * twist**2 / 2
            losses["shaft"] = self.damping * slip**2

        measured = speed
        if self.encoder_lag is not None:
            measured = state("drive.speed", "rad/s")
            flow[measured] = (speed - measured) / self.encoder_lag
        gives = {"top.torque": (delivered, "N m")}
        if self.drive_lag is None:
            gives = {"drive.torque": (torque, "N m")} | gives
        if self.encoder_lag is None:
            gives = {"drive.speed": (measured, "rad/s")} | gives
        return Equations(
            flow=flow,
            outputs=gives,
            elements=elements,
            stored=stored,
            losses=losses,
            supplies={"motor": self.ratio * torque * speed, "string": -delivered * top_speed},
        )


def _clipped(value: ca.SX, limit: ca.SX) -> ca.SX:
    return ca.fmin(ca.fmax(value, -limit), limit)
