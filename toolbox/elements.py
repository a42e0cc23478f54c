"""Words for writing a part of a plant: states, quantities and set-valued contacts.

Why set-valued, not tanh: dry friction at rest is whatever force keeps the contact at rest, up to a bound. A regularised law creeps instead of
sticking and lowers the break-away force, so a controller designed on it can park a bit that the real machine would have to break free.
Here a contact carries one integer mode, and force alone decides when it leaves stick.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

time = ca.SX.sym("time")
"""The symbol of time [s]: build input expressions from it, e.g. `10_000 + 500*casadi.sin(3*time)`."""


class State(ca.SX):
    """A named state of a part: a casadi symbol that remembers its name, unit and size."""

    __hash__ = object.__hash__  # a vector SX has no hash of its own; a state is identified by itself

    def __init__(self, name: str, unit: str, size: int | None = None):
        super().__init__(ca.SX.sym(name, 1 if size is None else size))
        self.label = name
        self.unit = unit
        self.length = size


def state(name: str, unit: str, size: int | None = None) -> State:
    """A state `part.quantity` in the given unit: a scalar, or a column of `size` entries.

    The name of a vector state refers to an array of shape (nt, size) in a result.
    """
    return State(name, unit, size)


def quantity(
    default: Any = dataclasses.MISSING,
    unit: str = "1",
    meaning: str = "",
    *,
    at_least: float | None = None,
    above: float | None = None,
    at_most: float | None = None,
) -> Any:
    """A numeric field of a part, in SI: `mass: float = quantity(1.0, "kg", "mass of the block", above=0)`.

    A float, or a tuple of floats, becomes a symbol of the compiled model, so that a new value never recompiles. `None` means that the quantity is
    absent, which is structure. The bounds `at_least`, `above` and `at_most` hold for every entry and are checked on numbers when a
    plant is composed and when a run overrides them.
    """
    metadata = {"unit": unit, "meaning": meaning, "at_least": at_least, "above": above, "at_most": at_most}
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True)
class FrictionLaw:
    """Coefficient of dry friction per unit of load, as a function of the slip speed.

    A law is a frozen dataclass whose numeric fields are declared with `quantity`. It must be smooth for positive slip speeds.
    """

    def sliding(self, speed: ca.SX) -> ca.SX:
        """Kinetic friction per unit of load at slip speed `speed` >= 0."""
        raise NotImplementedError

    def breakaway(self) -> ca.SX:
        """Static bound per unit of load."""
        raise NotImplementedError

    def check(self) -> None:
        """Raise SceneError where fields contradict each other."""


class Element:
    """A set-valued element with one integer mode: 0 holds `slip` at zero, +1 and -1 apply `-mode * kinetic`, kinetic = load * sliding.

    `force` is a casadi symbol to be used, affinely, in the flow of the part that owns the element.
    """

    legend: ClassVar[dict[int, str]] = {0: "stick", 1: "slip+", -1: "slip-"}
    law: FrictionLaw | None = None

    def __init__(self, name: str, slip: ca.SX, slip_unit: str, force_unit: str):
        self.name = name
        self.slip = ca.SX(slip)
        self.slip_unit = slip_unit
        self.force_unit = force_unit
        self.force = ca.SX.sym(f"{name}.force")
        self.mode = ca.SX.sym(f"{name}.mode")
        self.static: ca.SX
        self.load: ca.SX
        self.sliding: ca.SX


    @property
    def kinetic(self) -> ca.SX:
        """Magnitude of the force while sliding."""
        return self.load * self.sliding


class DryFriction(Element):
    """Dry friction with slip speed `slip`, a law, and a normal load (default 1, for laws that are forces themselves).

        stick:  slip = 0 and |force| <= static = load * law.breakaway()
        slip:   force = -sgn(slip) * load * law.sliding(|slip|)

    `slip` may depend on states, parameters and time, not on a sampled input. Negative loads are the caller's error: give a load that is >= 0.
    """

    def __init__(
        self,
        name: str,
        slip: ca.SX,
        law: FrictionLaw,
        load: ca.SX | float = 1.0,
        *,
        slip_unit: str = "m/s",
        force_unit: str = "N",
    ):
        super().__init__(name, slip, slip_unit, force_unit)
        self.law = law
        self.load = ca.SX(load)
        # |slip| = mode * slip while the mode holds; the product continues the law smoothly past the switching surface, where a step looks ahead
        self.sliding = ca.SX(law.sliding(self.mode * self.slip))
        self.static = self.load * law.breakaway()


class Relay(Element):
    """An ideal switch u = -bound * sgn(surface), with true sliding on surface = 0.

    Sliding is the mode "stick": the force is then the equivalent control, inside [-bound, bound]. The surface must have relative
    degree one with a positive gain, d(surface)/dx * d(flow)/d(force) > 0; anything else is a SceneError when the plant is composed.
    Source: V. Utkin, Sliding Modes in Control and Optimization, Springer 1992.
    """

    def __init__(
        self, name: str, surface: ca.SX, bound: ca.SX | float, *, surface_unit: str = "1", force_unit: str = "1"
    ):
        super().__init__(name, surface, surface_unit, force_unit)
        self.static = ca.SX(bound)
        self.load = ca.SX(bound)
        self.sliding = ca.SX(1)


def is_finite_number(value: Any) -> bool:
    """True for a finite real number that is not a bool."""
    if isinstance(value, (bool, np.bool_, str, bytes)):
        return False
    try:
        return math.isfinite(value)
    except (TypeError, ValueError, OverflowError, NotImplementedError, RuntimeError):
        return False


def finite_array(value: Any) -> np.ndarray | None:
    """Numbers as a float array, or None where they are not finite real numbers."""
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "iuf":
            return None
        array = np.array(raw, float)
    except (TypeError, ValueError, OverflowError, NotImplementedError, RuntimeError):
        return None
    return array if np.isfinite(array).all() else None
