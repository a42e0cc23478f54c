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
    """Stick-slip of an undamped block on a belt under Coulomb friction with a static bound above the kinetic one.

        z = N (mu_s - mu_k) w_n / (k v),   t_slip = (2 / w_n)(pi - arctan z),   t_stick = 2 z / w_n,   w_n = sqrt(k / m)

    Exact. Raises SceneError for another law, damping, drag, a belt at rest or no spring. Source: textbook.
    """
    law = _law("block", block, Coulomb)
    fall = block.load * (law.static - law.kinetic)
    return _cycle("block", block, ("damping", "drag"), block.mass, fall, block.belt_speed)


def driven_disks_cycle(disks: TwoDisks, rotor_speed: float) -> StickSlipPeriod:
    """Stick-slip of an undamped stator under a rotor that is driven at constant speed W [rad/s], Coulomb friction with T_s > T_k.

        z = (T_s - T_k) w_n / (k_t W),   t_slip = (2 / w_n)(pi - arctan z),   t_stick = 2 z / w_n,   w_n = sqrt(k_t / I_2)

    so that period / T_n = 1 + (z - arctan z) / pi. Exact for an infinitely heavy rotor. Raises SceneError as `belt_cycle` does.
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
    """Belt speed v_b0 = sqrt(4/5) v_b1 below which a block under the cubic law sticks and slips, to first order (Thomsen, Fidlin 2003).

    Between v_b0 and the Hopf speed v_b1 it swings without stick, see `slip_amplitude`. Range: weak damping and weak friction. Raises SceneError
    for other laws. Source: J. J. Thomsen, A. Fidlin, Int. J. Non-Linear Mechanics 38 (2003) 389-403, doi:10.1016/S0020-7462(01)00073-7.
    """
    _law("block", block, CubicStribeck)
    return math.sqrt(4 / 5) * hopf_speed(block)


def slip_amplitude(block: BlockOnBelt) -> float:
    """Amplitude A = 2 sqrt(v_b1^2 - v_b^2) / w_n [m] of the swing without stick at the block's belt speed, to first order; 0.0 above v_b1.

    Range: v_b0 < v_b < v_b1. Raises SceneError for other laws and below v_b0. Source: as `stick_slip_speed`.
    """
    _law("block", block, CubicStribeck)
    low, high = stick_slip_speed(block), hopf_speed(block)
    if block.belt_speed < low:
        raise SceneError(
            f"Argument `block.belt_speed` must be >= {low:.6g} m/s, below which the block sticks, but it is {block.belt_speed!r}."
        )
    return 2 * math.sqrt(max(0.0, high**2 - block.belt_speed**2) * block.mass / block.stiffness)


def den_hartog_amplitude(block: BlockOnBelt, force: float, frequency: float) -> float:
    """Amplitude [m] of a block under Coulomb friction F and the force P cos(w t), while its motion has no stops.

        x_0 = (P / k) sqrt(V^2 - (F / P)^2 U^2),   V = 1 / (1 - r^2),   U = tan(pi / (2 r)) / r,   r = w / w_n

    force: P [N];  frequency: w [rad/s]. Range: undamped, one law for rest and motion, and F / P below `den_hartog_bound`. At r = 1/2, 1/4, ... friction
    does not damp the free swing of twice, four times the frequency, and motions that are not symmetric go on beside this one. Raises SceneError outside
    of the range and at resonance. Source: J. P. Den Hartog (1931).
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
    """Largest friction by force, F / P, at which the motion has no stops: sqrt(V^2 / (U^2 + 1 / r^4)), 0 at r = 1/3, 1/5, ... up to round-off.

    Range and source: `den_hartog_amplitude`.
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
    """Negative damping d [N m s/rad] at the bit of two inertias at which steady rotation becomes unstable.

        held (the drive keeps the top speed constant):  d = c + c_b
        free (the drive gives a constant torque):       a_2 a_1 = a_0 of s^3 + a_2 s^2 + a_1 s + a_0, with e = c_b - d:
            a_2 = (c + c_r) / J_r + (c + e) / J_b,   a_1 = (k J_r + k J_b + c c_r + c e + c_r e) / (J_r J_b),   a_0 = k (c_r + e) / (J_r J_b)

    The root of the quadratic in e that is met first, from high e down. Rotation is lost by growing swings unless c_r + e reaches zero before, where it runs
    away. Raises SceneError for another number of inertias. Source: Hurwitz's criterion.
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
    """Speed [rad/s] above which two inertias turn steadily and below which they do not, w = ln(W R_b (mu_s - mu_c) decay / d) / decay.

    d is `bearable_fall`: of a drive with constant torque, or of one that holds the top speed. 0.0 where the string turns steadily at every
    speed. Raises SceneError for another law than the exponential one, and where d is not positive.
    """
    law = _law("bit", rock, Exponential)
    steepest = rock.weight * rock.radius * (law.static - law.kinetic) * law.decay
    bearable = bearable_fall(chain, held=held)
    if not bearable > 0:
        raise SceneError(f"The string must bear some falling friction for a Hopf speed to exist, but it bears {bearable:.6g} N m s/rad.")
    return math.log(steepest / bearable) / law.decay if steepest > bearable else 0.0


def groan_growth(brake: DiscBrake, force: float, until: float = 0.0) -> float:
    """Exponent G by which the pad of a disc brake grows while a constant force [N] slows the disc down to the speed `until` [rad/s].

        G = int (2 N |mu'| - c) / (2 m) dt  from the speed w_e at which the pad loses its damping, 2 N |mu'(r w_e)| = c, with dt = -I dw / (2 r N mu(r w))
          = I / (2 m r^2) ln(mu(r w) / mu(r w_e)) - c I / (4 m r N q mu_k) ln((mu_k e^(q w_e) + D) / (mu_k e^(q w) + D)),   q = decay r,  D = mu_s - mu_k

    Exponential friction, no drive. G rises with the force to I / (2 m r^2) ln(mu_s / mu_k): braking harder does not outrun groan. 0 where the disc is not
    slower than w_e. Range: a speed that changes little within a period of the pad; swings too small to stick. Raises SceneError for other laws and
    for a force <= 0.
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
