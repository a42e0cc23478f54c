"""An axis that slides and a joint that turns: one body under a measured force, with friction, for identification from recordings.

    m v' = F - F_0 - R(v)                    R: friction of the law, times 1 + q |P| under a load P that is transmitted

F_0 is a constant force beside friction: the zero of a sensor or an amplifier, or a weight. A recorder may see the speed behind a filter, T y' = v - y. At
steady speed the force is the resistance R + F_0, which is a signal of its own. Source: textbook; the form is that of A. Janot, P.-O. Vandanjon, M. Gautier,
Control Eng. Practice 21 (2013) 1191-1204.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from models.friction import Coulomb, Viscous
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, quantity, state


def _moved(signal, part, length):
    """The equations of a body with friction. length: unit of its position."""
    (speed, force), body, offset = part.units, getattr(part, part.body_field), getattr(part, part.offset_field)
    x, v = state(f"{part.signal_prefix}.{part.position_name}", length), state(f"{part.signal_prefix}.speed", speed)
    drive = signal(f"{part.signal_prefix}.{part.force_name}", force, default=0.0)
    load = 1.0
    if part.has_load:
        load = 1.0 + part.load_sensitivity * ca.fabs(signal(f"{part.signal_prefix}.load", force, default=0.0))
    rub = DryFriction(part.contact_name, v, part.friction, load, slip_unit=speed, force_unit=force)
    flow = {x: v, v: (drive - offset + rub.force) / body}
    gives = {f"{part.signal_prefix}.resistance": (offset - rub.force, force)}
    if part.has_speed_filter:
        y = state(f"{part.signal_prefix}.filtered_speed", speed)
        flow[y] = (v - y) / part.filter_time
    return Equations(
        flow=flow,
        outputs=gives,
        elements=[rub],
        stored=body * v**2 / 2,
        losses={"friction": -rub.force * v},
        supplies={"force": drive * v, "offset": -offset * v},
    )


@dataclass(frozen=True)
class Axis(Component):
    """Axis that moves along a line under a force, with dry and viscous friction.

        m v' = F - F_0 - R(v)

    Symbols and their fields: m `mass` [kg], F_0 `force_offset` [N], R friction law `friction`.

    F is the force, F_0 a constant force (an offset of the sensor or the amplifier, or a weight) and R the friction.
    `identify` uses this plant for recordings in m and N.

    - Needs the signal `axis.force` F [N] (default 0). If `has_load` is True, the axis also needs `axis.load` P [N]
      (default 0), and R is multiplied by 1 + q |P|, with q the field `load_sensitivity`.
    - Gives the signals `axis.position` [m], `axis.speed` v [m/s] and `axis.resistance` [N], the force R + F_0 that
      keeps the speed v constant. If `has_speed_filter` is True, it also gives `axis.filtered_speed` [m/s], the speed
      after the filter of a recorder.
    - Contact: `rail`.

    The default values are examples without a source. Source of the equation: textbook, in the form of A. Janot, P.-O.
    Vandanjon, M. Gautier, Control Eng. Practice 21 (2013) 1191-1204.

    Examples
    --------
    >>> from models import Axis
    >>> from toolbox import compose
    >>> print(compose(Axis()))
    HybridSystem(Axis): 2 states (axis.position, axis.speed); contacts: rail; inputs: axis.force [N]
    """

    mass: Quantity = quantity(1.0, "kg", "moving mass", above=0)
    force_offset: Quantity = quantity(0.0, "N", "constant force against positive motion")
    load_sensitivity: Quantity = quantity(0.0, "1/N", "relative increase of friction per N of load", at_least=0)
    filter_time: Quantity = quantity(0.01, "s", "time constant of the filter of the measured speed", above=0)
    friction: FrictionLaw = Viscous(Coulomb(1.0, 1.0), 1.0)
    has_load: bool = False
    has_speed_filter: bool = False
    signal_prefix, contact_name, position_name, force_name, units = "axis", "rail", "position", "force", ("m/s", "N")
    body_field, offset_field = "mass", "force_offset"

    def equations(self, signal):
        return _moved(signal, self, "m")


@dataclass(frozen=True)
class Joint(Component):
    """Joint that rotates under a torque, with dry and viscous friction.

        J w' = T - T_0 - R(w)

    Symbols and their fields: J `inertia` [kg m2], T_0 `torque_offset` [N m], R friction law `friction`.

    w is the speed, T the torque, T_0 a constant torque (an offset of the sensor or the amplifier, or a weight on a lever)
    and R the friction. `identify` uses this plant for recordings in rad and N m.

    - Needs the signal `joint.torque` [N m] (default 0). If `has_load` is True, the joint also needs `joint.load` P [N
      m] (default 0), and the friction is multiplied by 1 + q |P|, with q the field `load_sensitivity`.
    - Gives the signals `joint.angle` [rad], `joint.speed` [rad/s] and `joint.resistance` [N m], the torque that keeps
      the speed constant. If `has_speed_filter` is True, it also gives `joint.filtered_speed` [rad/s], the speed after
      the filter of a recorder.
    - Contact: `bearing`.

    The default values are examples without a source. Source of the equation: textbook, in the form of A. Janot, P.-O.
    Vandanjon, M. Gautier, Control Eng. Practice 21 (2013) 1191-1204.

    Examples
    --------
    >>> from models import Joint
    >>> from toolbox import compose
    >>> print(compose(Joint()))
    HybridSystem(Joint): 2 states (joint.angle, joint.speed); contacts: bearing; inputs: joint.torque [N m]
    """

    inertia: Quantity = quantity(0.1, "kg m2", "rotating inertia", above=0)
    torque_offset: Quantity = quantity(0.0, "N m", "constant torque against positive motion")
    load_sensitivity: Quantity = quantity(0.0, "1/(N m)", "relative increase of friction per N m of load", at_least=0)
    filter_time: Quantity = quantity(0.01, "s", "time constant of the filter of the measured speed", above=0)
    friction: FrictionLaw = Viscous(Coulomb(0.1, 0.1), 0.1)
    has_load: bool = False
    has_speed_filter: bool = False
    signal_prefix, contact_name, position_name, force_name, units = "joint", "bearing", "angle", "torque", ("rad/s", "N m")
    body_field, offset_field = "inertia", "torque_offset"

    def equations(self, signal):
        return _moved(signal, self, "rad")
