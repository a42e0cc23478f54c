"""Published oscillators with dry friction, as ready-made blocks on a belt.

LEINE: R. I. Leine, D. H. van Campen, A. de Kraker, L. van den Steen, Nonlinear Dynamics 16 (1998) 41-54, doi:10.1023/A:1008289604683. Without
damping, steady sliding is unstable at every belt speed.
THOMSEN_FIDLIN: J. J. Thomsen, A. Fidlin, Int. J. Non-Linear Mechanics 38 (2003) 389-403, doi:10.1016/S0020-7462(01)00073-7; dimensionless, beta =
0.05, g2 = 1. Three ranges of belt speed: see `hopf_speed`.
VERASZTO_STEPAN: numbers of Veraszto and Stepan (2017); beyond its Hopf speed of 0.1906 m/s, rest and stick-slip are both stable.
"""

from __future__ import annotations

import math

from models.belt import BlockOnBelt
from models.friction import CubicStribeck, Exponential
from toolbox import SceneError

LEINE = BlockOnBelt()

THOMSEN_FIDLIN = BlockOnBelt(damping=0.1, belt_speed=0.4, friction=CubicStribeck(static=0.4, minimum=0.25, minimum_speed=0.5))

VERASZTO_STEPAN = BlockOnBelt(
    mass=0.538, stiffness=6957.0, damping=5.746, drag=0.2, belt_speed=0.21, friction=Exponential(static=6.0, kinetic=2.0, decay=10.0)
)


def hopf_speed(block: BlockOnBelt) -> float:
    """Compute the belt speed above which the vibration of a sliding block decays and below which it grows: c + d = -N mu'(v).

        exponential law   v = ln(N (mu_s - mu_k) decay / (c + d)) / decay              (Veraszto-Stepan 2017)
        cubic law         v = v_m sqrt(1 - 2 (c + d) v_m / (3 N (mu_s - mu_m)))        (v_b1 of Thomsen-Fidlin 2003)

    With the cubic law the block slips between v_b0 = sqrt(4/5) v_b1 and v_b1, with amplitude 2 sqrt(v_b1^2 - v_b^2)
    in units of 1 / w_n, and sticks and slips below v_b0, to first order.

    Parameters
    ----------
    block
        The block, with `Exponential` or `CubicStribeck` friction.

    Returns
    -------
    float
        The speed v [m/s]. 0.0 if the vibration decays at every speed.

    Raises
    ------
    SceneError
        If the friction law is neither `Exponential` nor `CubicStribeck`. Also if c + d = 0 with the exponential law:
        the vibration then grows at every speed.

    Examples
    --------
    >>> from models.oscillators import THOMSEN_FIDLIN, hopf_speed
    >>> print(f"{hopf_speed(THOMSEN_FIDLIN):.4f} m/s")
    0.4410 m/s
    """
    law, drag = block.friction, block.damping + block.drag
    if isinstance(law, Exponential):
        steepest = block.load * (law.static - law.kinetic) * law.decay
        if drag == 0 and steepest > 0:
            raise SceneError("Argument `block.damping` must be > 0 N s/m for a Hopf speed to exist under an exponential law, but it is 0.")
        return math.log(steepest / drag) / law.decay if steepest > drag else 0.0
    if isinstance(law, CubicStribeck):
        fall = 3 * block.load * (law.static - law.minimum)
        return law.minimum_speed * math.sqrt(max(0.0, 1 - 2 * drag * law.minimum_speed / fall)) if fall > 0 else 0.0
    raise SceneError(f"Argument `block.friction` must be Exponential or CubicStribeck, but it is {law!r}.")
