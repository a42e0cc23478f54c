"""Whether a controller loses smooth running by its own sample time and delay, in a sentence."""

from __future__ import annotations

import math

from toolbox.errors import SceneError
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.laws import Controller, Sampled
from toolbox.steady_states.linear_loop import NoDerivative
from toolbox.steady_states.steady_loop import linear_loop


def instability(loop: ClosedLoop) -> str:
    """Say that smooth running of a loop is unstable, and whether its sample times and delays are the reason.

    Parameters
    ----------
    loop
        A loop with controllers, at the set-point and under the constant inputs that it has.

    Returns
    -------
    str
        One sentence if a small swing about smooth running grows. Empty if it decays, and if nothing is known: no controller, a controller in Python, inputs
        that vary in time, no smooth running.

    Examples
    --------
    >>> from controllers import ZTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> from toolbox.steady_states.instability import instability
    >>> plant = compose(wells.JANSEN_2, BitRock())
    >>> fast = closed_loop(plant, Sampled(ZTorque(reference=8.0), "10 ms", delay="30 ms"), inputs={"bit.weight": "97 kN"})
    >>> instability(fast)
    ''
    >>> instability(fast.at("ztorque.delay", 0.12))[:62]
    'Smooth running is unstable with these sample times and delays:'
    """
    growth = _growth(loop) if loop.controllers else None
    if growth is None or growth <= 0.0:
        return ""
    size = f"a small swing doubles every {math.log(2.0) / growth:.3g} s"
    if not loop.is_sampled:
        return f"Smooth running is unstable: {size}."
    undelayed = [law.law for law in loop.controllers if isinstance(law, Sampled) and isinstance(law.law, Controller)]
    ideal = _growth(loop.with_controllers(tuple(undelayed))) if len(undelayed) == len(loop.controllers) else None
    if ideal is not None and ideal <= 0.0:
        return f"Smooth running is unstable with these sample times and delays: {size}. The same controller without them is stable."
    return f"Smooth running is unstable: {size}."


def _growth(loop: ClosedLoop) -> float | None:
    """Growth of the least damped small motion [1/s]; None where it is not known, 0 where it is within round-off."""
    try:
        found = linear_loop(loop)
    except (SceneError, NoDerivative):
        return None
    return 0.0 if found.stable else found.growth()
