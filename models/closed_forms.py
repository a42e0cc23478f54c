"""What theory says about machines that stick and slip: periods, amplitudes and borders in closed form, to check simulations against.

The border of steady sliding of a block on a belt is `oscillators.hopf_speed`.
"""

from __future__ import annotations

import math
from typing import Any, TypeVar

from models.belt import BlockOnBelt
from models.bit_rock import BitRock
from models.disc_brake import DiscBrake
from models.disks import TwoDisks
from models.drill_string import TorsionalChain
from models.friction import Coulomb, CubicStribeck, Exponential
from models.oscillators import hopf_speed
from toolbox import FrictionLaw, SceneError
from toolbox.authoring import number
from toolbox.measure import StickSlipPeriod

Law = TypeVar("Law", bound=FrictionLaw)


def belt_cycle(block: BlockOnBelt) -> StickSlipPeriod:
    """Compute the stick-slip cycle of an undamped block on a belt, under Coulomb friction with a static bound above the
    kinetic one.

        z = N (mu_s - mu_k) w_n / (k v),   t_slip = (2 / w_n)(pi - arctan z),   t_stick = 2 z / w_n,   w_n = sqrt(k / m)

    N is the load, v the belt speed, mu_s and mu_k the static and kinetic coefficients, k and m stiffness and mass. The
    result is exact. Source: textbook.

    Parameters
    ----------
    block
        The block, with `Coulomb` friction, without damping and drag.

    Returns
    -------
    StickSlipPeriod
        Slip time and stick time [s].

    Raises
    ------
    SceneError
        If the friction law is not `Coulomb`, there is damping, drag or no spring, or the belt is at rest.

    Examples
    --------
    >>> from models import BlockOnBelt, Coulomb
    >>> from models.closed_forms import belt_cycle
    >>> cycle = belt_cycle(BlockOnBelt(friction=Coulomb(static=0.5, kinetic=0.3), damping=0.0, drag=0.0))
    >>> print(f"slips for {cycle.slip:.3f} s, sticks for {cycle.stick:.3f} s")
    slips for 4.712 s, sticks for 2.000 s
    """
    law = _law("block", block, Coulomb)
    fall = block.load * (law.static - law.kinetic)
    return _cycle("block", block, ("damping", "drag"), block.mass, fall, block.belt_speed)


def driven_disks_cycle(disks: TwoDisks, rotor_speed: float) -> StickSlipPeriod:
    """Compute the stick-slip cycle of an undamped stator under a rotor of constant speed W, under Coulomb friction with
    T_s > T_k.

        z = (T_s - T_k) w_n / (k_t W),   t_slip = (2 / w_n)(pi - arctan z),   t_stick = 2 z / w_n,   w_n = sqrt(k_t / I_2)

    T_s and T_k are the static and kinetic friction torques, k_t and I_2 stiffness and inertia of the stator. The cycle
    lasts T_n (1 + (z - arctan z) / pi), with the natural period T_n of the stator. The result is exact for an
    infinitely heavy rotor.

    Parameters
    ----------
    disks
        The two disks, with `Coulomb` friction, without damping.
    rotor_speed
        Speed W of the rotor [rad/s].

    Returns
    -------
    StickSlipPeriod
        Slip time and stick time [s].

    Raises
    ------
    SceneError
        If the friction law is not `Coulomb`, there is damping or no spring, or the rotor is at rest.

    Examples
    --------
    >>> from models import Coulomb, TwoDisks
    >>> from models.closed_forms import driven_disks_cycle
    >>> disks = TwoDisks(friction=Coulomb(static=0.5, kinetic=0.3), damping=0.0)
    >>> print(f"{driven_disks_cycle(disks, rotor_speed=1.0).period:.3f} s")
    0.032 s
    """
    law = _law("disks", disks, Coulomb)
    fall = disks.normal_force * disks.radius * (law.static - law.kinetic)
    return _cycle("disks", disks, ("damping",), disks.stator_inertia, fall, rotor_speed)


def _law(name: str, part: Any, kind: type[Law], words: str = " for this closed form") -> Law:
    """The law of a part, refused unless it is of a kind."""
    if not isinstance(part.friction, kind):
        raise SceneError(f"Argument `{name}.friction` must be {kind.__name__}{words}, but it is {part.friction!r}.")
    return part.friction


def _cycle(name: str, part: Any, losses: tuple[str, ...], inertia: float, fall: float, speed: float) -> StickSlipPeriod:
    for loss in losses:
        if getattr(part, loss) != 0:
            raise SceneError(f"Argument `{name}.{loss}` must be 0 for this closed form, but it is {getattr(part, loss)!r}.")
    number(f"{name}.stiffness", part.stiffness, above=0)
    if number("speed", speed) == 0:
        raise SceneError("Argument `speed` of the driver must not be 0.")
    w = math.sqrt(part.stiffness / inertia)
    z = fall * w / (part.stiffness * abs(speed))
    return StickSlipPeriod(start=0.0, slip=2 / w * (math.pi - math.atan(z)), stick=2 * z / w)


def stick_slip_speed(block: BlockOnBelt) -> float:
    """Compute the belt speed v_b0 = sqrt(4/5) v_b1 below which a block under the cubic friction law sticks and slips, to
    first order.

    Between v_b0 and the Hopf speed v_b1 the block oscillates without stick; `slip_amplitude` gives the amplitude.
    Range: weak damping and weak friction. Source: J. J. Thomsen, A. Fidlin, Int. J. Non-Linear Mechanics 38 (2003)
    389-403, doi:10.1016/S0020-7462(01)00073-7.

    Parameters
    ----------
    block
        The block, with `CubicStribeck` friction.

    Returns
    -------
    float
        The speed v_b0 [m/s].

    Raises
    ------
    SceneError
        If the friction law is not `CubicStribeck`.

    Examples
    --------
    >>> from models import oscillators
    >>> from models.closed_forms import stick_slip_speed
    >>> print(f"{stick_slip_speed(oscillators.THOMSEN_FIDLIN):.4f} m/s")
    0.3944 m/s
    """
    _law("block", block, CubicStribeck)
    return math.sqrt(4 / 5) * hopf_speed(block)


def slip_amplitude(block: BlockOnBelt) -> float:
    """Compute the amplitude A = 2 sqrt(v_b1^2 - v_b^2) / w_n of the oscillation without stick at the belt speed of the
    block, to first order.

    v_b is the belt speed and w_n the natural frequency of the block. v_b1 is the Hopf speed, below which the block
    oscillates, and v_b0 = sqrt(4/5) v_b1 the speed below which the block sticks and slips. Range: v_b0 < v_b < v_b1.
    Source: J. J. Thomsen, A. Fidlin, Int. J. Non-Linear Mechanics 38 (2003) 389-403.

    Parameters
    ----------
    block
        The block, with `CubicStribeck` friction.

    Returns
    -------
    float
        The amplitude [m]. 0.0 above v_b1.

    Raises
    ------
    SceneError
        If the friction law is not `CubicStribeck`, or the belt is slower than v_b0.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from models import oscillators
    >>> from models.closed_forms import slip_amplitude
    >>> from models.oscillators import hopf_speed
    >>> speed = 0.95 * hopf_speed(oscillators.THOMSEN_FIDLIN)
    >>> print(f"{slip_amplitude(replace(oscillators.THOMSEN_FIDLIN, belt_speed=speed)):.4f} m")
    0.2754 m
    """
    _law("block", block, CubicStribeck)
    low, high = stick_slip_speed(block), hopf_speed(block)
    if block.belt_speed < low:
        raise SceneError(
            f"Argument `block.belt_speed` must be >= {low:.6g} m/s, below which the block sticks, but it is {block.belt_speed!r}."
        )
    return 2 * math.sqrt(max(0.0, high**2 - block.belt_speed**2) * block.mass / block.stiffness)


def den_hartog_amplitude(block: BlockOnBelt, force: float, frequency: float) -> float:
    """Compute the amplitude of a block under Coulomb friction F and the force P cos(w t), for motion without stops.

        x_0 = (P / k) sqrt(V^2 - (F / P)^2 U^2),   V = 1 / (1 - r^2),   U = tan(pi / (2 r)) / r,   r = w / w_n

    Range: undamped, equal static and kinetic friction, and F / P below `den_hartog_bound`. At r = 1/2, 1/4, ...
    friction does not damp the free oscillation with 2, 4, ... times the frequency w. There are then also motions that
    are not symmetric. Source: J. P. Den Hartog (1931).

    Parameters
    ----------
    block
        The block, with `Coulomb` friction, without damping and drag, on a belt at rest.
    force
        Amplitude P of the force [N].
    frequency
        Frequency w [rad/s].

    Returns
    -------
    float
        The amplitude [m].

    Raises
    ------
    SceneError
        If the block or the force is outside of the range, or w is the natural frequency of the block.

    Examples
    --------
    >>> from models import BlockOnBelt, Coulomb
    >>> from models.closed_forms import den_hartog_amplitude
    >>> block = BlockOnBelt(friction=Coulomb(static=0.3, kinetic=0.3), damping=0.0, drag=0.0, belt_speed=0.0)
    >>> print(f"{den_hartog_amplitude(block, force=1.0, frequency=0.8):.4f} m")
    2.6261 m
    """
    law = block.friction
    if not isinstance(law, Coulomb) or law.static != law.kinetic:
        raise SceneError(f"Argument `block.friction` must be Coulomb with static = kinetic for this closed form, but it is {law!r}.")
    ratio, bound = block.load * law.kinetic / number("force", force, "N", above=0), den_hartog_bound(block, frequency)
    if not ratio <= bound:
        least = block.load * law.kinetic / bound
        raise SceneError(f"Argument `force` must be >= {least:.6g} N for a motion without stops, but it is {force!r}.")
    v, u, _ = _den_hartog(block, frequency)
    return force / block.stiffness * math.sqrt(v * v - (ratio * u) ** 2)


def den_hartog_bound(block: BlockOnBelt, frequency: float) -> float:
    """Compute the largest ratio of friction to force, F / P, at which the motion of `den_hartog_amplitude` has no stops:
    sqrt(V^2 / (U^2 + 1 / r^4)).

    Here V = 1 / (1 - r^2) and U = tan(pi / (2 r)) / r, with r = w / w_n and the natural frequency w_n of the block. The
    ratio is 0 at r = 1/3, 1/5, ... up to round-off. Source: J. P. Den Hartog (1931).

    Parameters
    ----------
    block
        The block, without damping and drag, on a belt at rest.
    frequency
        Frequency w of the force [rad/s].

    Returns
    -------
    float
        The ratio F / P [1].

    Raises
    ------
    SceneError
        If the block has damping or drag, the belt moves, or the frequency is not > 0 or is the natural frequency of
        the block.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from models.closed_forms import den_hartog_bound
    >>> print(f"{den_hartog_bound(BlockOnBelt(damping=0.0, drag=0.0, belt_speed=0.0), frequency=0.8):.4f}")
    0.8174
    """
    v, u, r = _den_hartog(block, frequency)
    return abs(v) / math.sqrt(u * u + 1 / r**4)


def _den_hartog(block: BlockOnBelt, frequency: float) -> tuple[float, float, float]:
    if block.damping != 0 or block.drag != 0 or block.belt_speed != 0:
        raise SceneError("Arguments `block.damping`, `block.drag` and `block.belt_speed` must be 0 for this closed form.")
    r = frequency / math.sqrt(block.stiffness / block.mass)
    if not (math.isfinite(r) and r > 0 and r != 1):
        raise SceneError(f"Argument `frequency` must be > 0 rad/s and not that of the block, but it is {frequency!r}.")
    return 1 / (1 - r * r), math.tan(math.pi / (2 * r)) / r, r


def bearable_fall(chain: TorsionalChain, *, held: bool = False) -> float:
    """Compute the negative damping d at the bit of a string of two inertias at which steady rotation becomes unstable.

    d is the amount by which the torque of the rock may fall per rise of the bit speed, -dT/dw [N m s/rad], as a positive
    number.

        held (the drive keeps the top speed constant):  d = c + c_b
        free (the drive gives a constant torque):       a_2 a_1 = a_0 of s^3 + a_2 s^2 + a_1 s + a_0, with e = c_b - d:
            a_2 = (c + c_r) / J_r + (c + e) / J_b,   a_1 = (k J_r + k J_b + c c_r + c e + c_r e) / (J_r J_b),   a_0 = k (c_r + e) / (J_r J_b)

    J_r and J_b are the inertias of drive and bit [kg m2], c_r and c_b their drags [N m s/rad], and k and c stiffness [N
    m/rad] and damping [N m s/rad] of the string. The first equation of the free drive is quadratic in e, and its largest
    root gives d. If c_r + e reaches zero at a larger e than this root, the speed runs away before oscillations grow. This
    case is not computed. Source: Hurwitz's criterion.

    Parameters
    ----------
    chain
        The string, with two inertias.
    held
        Whether the drive keeps the top speed constant. By default the drive gives a constant torque.

    Returns
    -------
    float
        The negative damping d [N m s/rad].

    Raises
    ------
    SceneError
        If the string does not have two inertias, or if steady rotation becomes unstable at no value of d.

    Examples
    --------
    >>> from models import wells
    >>> from models.closed_forms import bearable_fall
    >>> print(f"{bearable_fall(wells.JANSEN_2):.1f} N m s/rad")
    94.7 N m s/rad
    """
    if len(chain.inertia) != 2:
        raise SceneError(f"Argument `chain.inertia` must hold 2 inertias for this closed form, but it has {len(chain.inertia)}.")
    (j_r, j_b), (k,), (c,) = chain.inertia, chain.stiffness, chain.damping
    c_r, c_b = chain.top_drag, chain.bit_drag
    if held:
        return c + c_b
    # (alpha + e / J_b)(beta + (c + c_r) e) = k (c_r + e)
    alpha, beta = (c + c_r) / j_r + c / j_b, k * (j_r + j_b) + c * c_r
    square, linear, constant = (c + c_r) / j_b, alpha * (c + c_r) + beta / j_b - k, alpha * beta - k * c_r
    root = linear**2 - 4 * square * constant
    if root < 0:
        raise SceneError("Two inertias with these numbers swing at no damping of the bit: nothing crosses the axis.")
    swing = (-linear + math.sqrt(root)) / (2 * square) if square else -constant / linear
    return c_b - swing


def hopf_speed_of_string(chain: TorsionalChain, rock: BitRock, *, held: bool = False) -> float:
    """Compute the bit speed above which steady rotation of a string of two inertias is stable and below which it is unstable.

        w = ln(W R_b (mu_s - mu_c) decay / d) / decay

    W is the weight on bit, R_b the radius and mu_s, mu_c and decay the friction of the rock. `bearable_fall` gives d,
    for a drive with constant torque or for a drive that holds the top speed.

    Parameters
    ----------
    chain
        The string, with two inertias.
    rock
        Bit and rock, with `Exponential` friction.
    held
        Whether the drive keeps the top speed constant. By default the drive gives a constant torque.

    Returns
    -------
    float
        The speed w [rad/s]. 0.0 if steady rotation is stable at every speed.

    Raises
    ------
    SceneError
        If the friction law is not `Exponential`, or d is not positive.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from models.closed_forms import hopf_speed_of_string
    >>> print(f"{hopf_speed_of_string(wells.JANSEN_2, BitRock(weight='97 kN')):.3f} rad/s")
    4.180 rad/s
    """
    law = _law("bit", rock, Exponential)
    steepest = rock.weight * rock.radius * (law.static - law.kinetic) * law.decay
    bearable = bearable_fall(chain, held=held)
    if not bearable > 0:
        raise SceneError(f"The string must bear some falling friction for a Hopf speed to exist, but it bears {bearable:.6g} N m s/rad.")
    return math.log(steepest / bearable) / law.decay if steepest > bearable else 0.0


def groan_growth(brake: DiscBrake, force: float, until: float = 0.0) -> float:
    """Compute the exponent G by which the vibration of a brake pad grows while a constant force slows the disc down.

        G = int (2 N |mu'| - c) / (2 m) dt  from the speed w_e at which the pad loses its damping, 2 N |mu'(r w_e)| = c, with dt = -I dw / (2 r N mu(r w))
          = I / (2 m r^2) ln(mu(r w) / mu(r w_e)) - c I / (4 m r N q mu_k) ln((mu_k e^(q w_e) + D) / (mu_k e^(q w) + D)),   q = decay r,  D = mu_s - mu_k

    N is the force, r the effective radius, I the inertia of the disc, m and c mass and damping of the pad, and w the
    final speed `until`. The friction is exponential, and no torque acts on the disc. G rises with the force to I / (2 m
    r^2) ln(mu_s / mu_k), so braking with a larger force does not avoid groan. Range: the speed changes little within a
    period of the pad, and the vibration is so small that the pad does not stick.

    Parameters
    ----------
    brake
        The brake, with `Exponential` friction.
    force
        Constant normal force on the pad [N], > 0.
    until
        Speed of the disc at which the growth ends [rad/s], by default 0.

    Returns
    -------
    float
        The exponent G. 0.0 if the disc is not slower than w_e.

    Raises
    ------
    SceneError
        If the friction law is not `Exponential`, or the force is not > 0.

    Examples
    --------
    >>> from models import DiscBrake
    >>> from models.closed_forms import groan_growth
    >>> print(f"{groan_growth(DiscBrake(), force=1000.0):.1f}")
    14.4
    """
    law = _law("brake", brake, Exponential, "")
    number("force", force, "N", above=0)
    drop, rate = law.static - law.kinetic, law.decay * brake.radius
    fed = 2.0 * force * drop * law.decay
    if fed <= brake.damping * math.exp(rate * until):
        return 0.0
    edge = math.log(fed / brake.damping) / rate
    ratio = (law.kinetic + drop * math.exp(-rate * until)) / (law.kinetic + drop * math.exp(-rate * edge))
    taken = math.log((law.kinetic * math.exp(rate * edge) + drop) / (law.kinetic * math.exp(rate * until) + drop))
    grown = brake.inertia / (2.0 * brake.pad_mass * brake.radius**2) * math.log(ratio)
    return grown - brake.damping * brake.inertia / (4.0 * brake.pad_mass * brake.radius * force * rate * law.kinetic) * taken
