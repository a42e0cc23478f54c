"""Friction as a slow motion feels it under fast dither along the slip, and the dither that makes it rise with speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from toolbox import FrictionLaw, HybridSystem, SceneError
from toolbox.authoring import halved, number


def averaged_friction(law: FrictionLaw, speed: float, amplitude: float) -> float:
    """Compute the mean coefficient of friction of a contact under fast dither.

    The slip speed is v + B sin t, with the mean slip speed v. The result is the mean of the coefficient over a period,
    (1 / 2 pi) int mu(v + B sin t) dt, with the sign of v.

    If the slip changes direction in every period, dry friction acts like viscous drag on the mean motion. For Coulomb
    friction the result is mu_k (2 / pi) arcsin(v / B) if |v| < B, else mu_k. The static friction does not influence the
    result.

    Range of validity: the dither is so fast that v hardly changes in a period, and the contact does not rest when the
    slip changes direction.

    Accuracy: the integral is computed by Gauss-Legendre quadrature between the changes of direction.

    - Constant friction: exact to round-off.
    - Exponential decays up to about 30 / B: relative error below 1e-8.
    - Tables with kinks: relative error below 1e-4.

    Source: textbook; J. J. Thomsen, A. Fidlin (2003).

    Parameters
    ----------
    law
        The friction law.
    speed
        Mean slip speed v, in the unit of the slip of the contact [m/s or rad/s], positive or negative.
    amplitude
        Velocity amplitude B >= 0 of the dither, in the unit of v.

    Returns
    -------
    float
        The mean coefficient of friction [1].

    Raises
    ------
    SceneError
        If a number is not finite, B < 0, or the law has a memory.

    Examples
    --------
    >>> from models import Coulomb, averaged_friction
    >>> print(f"{averaged_friction(Coulomb(static=0.5, kinetic=0.3), speed=0.1, amplitude=0.2):.3f}")
    0.100
    """
    if law.memory(1):
        raise SceneError(f"Argument `law` must be without memory, because bristles follow a dither that is small, but it is {law!r}.")
    speed, amplitude = number("speed", speed), number("amplitude", amplitude, at_least=0)
    # sin takes every value of a period twice between -pi/2 and pi/2; the slip turns at the phase between
    turn = -math.asin(min(1.0, max(-1.0, speed / amplitude))) if amplitude > 0 else -math.copysign(math.pi / 2, speed)
    points, weights = np.polynomial.legendre.leggauss(64)
    total = 0.0
    for begin, end, sign in ((-math.pi / 2, turn, -1.0), (turn, math.pi / 2, 1.0)):
        phase = begin + (end - begin) * (points + 1) / 2
        slip = np.abs(speed + amplitude * np.sin(phase))
        coefficient = np.array(ca.evalf(ca.SX(law.sliding(ca.SX(slip))))).ravel()
        total += sign * (end - begin) / 2 * float(np.sum(weights * coefficient))
    return total / math.pi


class TangentialDither(NamedTuple):
    """A dither along the slip: velocity amplitude B (unit of the slip), frequency [Hz], amplitude of the force (or torque) that makes it at the contact."""

    amplitude: float
    frequency: float
    force: float


def tangential_dither(plant: HybridSystem, contact: str, slip: float, frequency: float, *, drag: float = 0.0) -> TangentialDither:
    """Find the smallest dither in the direction of slip that removes the fall of the mean friction with speed.

        N d mu_eff/dv (v; B) + drag >= 0,    mu_eff = averaged_friction(law, v, B),    force = 2 pi frequency B / A

    v is the mean slip speed and B the velocity amplitude of the dither. N is the load of the contact at rest and with
    the default inputs. A is the acceleration of the slip per unit of force.

    - Constant kinetic friction needs no dither: B = 0.
    - For falling friction B is close to v, because the slip must change direction in every cycle.

    B is found with a relative error of 1e-3, between 0.01 v and 100 v.

    Parameters
    ----------
    plant
        The plant.
    contact
        Name of the contact.
    slip
        Mean slip speed v > 0, in the unit of the slip of the contact.
    frequency
        Frequency of the dither [Hz], far above the frequencies to which the plant responds.
    drag
        Viscous drag that acts in addition to the friction [force of the contact per unit of slip speed], by default 0.

    Returns
    -------
    TangentialDither
        Velocity amplitude B and force of the dither.

    Raises
    ------
    SceneError
        If the contact is unknown, v <= 0, or no B between 0.01 v and 100 v is large enough.

    Examples
    --------
    >>> from models import BlockOnBelt, Exponential, tangential_dither
    >>> from toolbox import compose
    >>> block = compose(BlockOnBelt(friction=Exponential(static=1.0, kinetic=0.5, decay=3.0)))
    >>> found = tangential_dither(block, "belt", slip=0.2, frequency=10.0)
    >>> print(f"velocity amplitude {found.amplitude:.2f} m/s, force {found.force:.1f} N")
    velocity amplitude 0.20 m/s, force 12.6 N
    """
    element = plant.element(contact)
    slip, frequency = number("slip", slip, above=0), number("frequency", frequency, "Hz", above=0)
    place = plant.elements.index(element)
    if element.law is None or element.law.break_speeds():
        raise SceneError(f"Argument `contact` must have a friction law without breaks, but `{contact}` has {element.law!r}.")
    speed = ca.SX.sym("speed")
    declared: list[Any] = [plant.p, plant.u, plant.x, plant.t]
    numbers: list[Any] = [plant.values, np.array(plant.input_defaults(plant.values)).ravel(), np.zeros(plant.x.numel()), 0.0]
    load, gain = (
        float(
            ca.Function("number", [*declared, plant.m, plant.F], [ca.densify(ca.SX(value))])(
                *numbers, np.ones(len(plant.elements)), np.zeros(len(plant.elements))
            )
        )
        for value in (element.load, plant.switched_equations.gain[place, place])
    )
    law = _AtNumbers(speed, ca.substitute(ca.SX(element.law.sliding(speed)), plant.p, ca.SX(plant.values)))

    def slope(amplitude: float) -> float:
        # at B = v the slip begins to turn round, and the slope jumps: a difference across that would see it too early
        width = min(1e-3 * slip, max(abs(amplitude - slip) / 2.0, 1e-6 * slip))
        rise = averaged_friction(law, slip + width, amplitude) - averaged_friction(law, slip - width, amplitude)
        return load * rise / (2.0 * width) + drag

    if slope(0.0) >= -1e-12 * load / slip:
        return TangentialDither(0.0, frequency, 0.0)
    grid = slip * np.geomspace(0.01, 100.0, 161)
    enough = next((i for i, amplitude in enumerate(grid) if slope(amplitude) >= 0.0), None)
    if enough is None:
        raise SceneError(f"No dither up to {grid[-1]:g} makes the friction of `{contact}` rise with speed at the slip {slip:g}.")
    _, high = halved(lambda amplitude: slope(amplitude) >= 0.0, grid[max(enough - 1, 0)], grid[enough], 1e-3)
    return TangentialDither(float(high), frequency, 2.0 * math.pi * frequency * float(high) / gain)


@dataclass(frozen=True)
class _AtNumbers(FrictionLaw):
    """A law of a plant with the plant's numbers in it."""

    symbol: ca.SX
    coefficient: ca.SX

    def sliding(self, speed):
        return ca.Function("law", [self.symbol], [self.coefficient])(speed.T).T
