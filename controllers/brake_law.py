"""What laws that stop a disc brake share: the plan of the stop, the limits of the actuator, and the force above which the pad groans."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca

from toolbox import Controller, HybridSystem, Quantity, SceneError, quantity, state
from toolbox.authoring import State, number
from toolbox.modelling import OptionalQuantity


@dataclass(frozen=True, kw_only=True)
class BrakeLaw(Controller):
    """A sampled law that commands the force of the pads so that the disc follows w_p' = -deceleration to standstill.

        I w' = -T,   T = 2 mu r N,   so that  N_p = I deceleration / (2 r friction)  is the force of the plan

    The plan begins at the speed of the first sample and ends at 0. Commands stay between `lowest_force`, which holds the wheel once it stands, and
    `highest_force`, change by at most `force_rate` times the period (None is no limit), and are held once the wheel has stopped. With a `margin`
    they also stay below margin N_0 exp(q w), the force above which the pad loses its damping (`groan_force`): the brake is eased towards
    standstill, as a chauffeur does, and the stop gets longer. `inertia` I, `radius` r, `border` N_0 and `growth` q are read from the plant unless
    given.
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("disc.speed",)
    actuated_signals: ClassVar[tuple[str, ...]] = ("brake.force",)

    deceleration: Quantity = quantity(2.0, "rad/s2", "wanted deceleration", above=0)
    friction: Quantity = quantity(0.4, "1", "coefficient of friction that the law expects", above=0)
    margin: OptionalQuantity = quantity(None, "1", "part of the border force that the law allows itself", above=0)
    lowest_force: Quantity = quantity(100.0, "N", "lowest force of one pad", at_least=0)
    highest_force: Quantity = quantity(5000.0, "N", "highest force of one pad", above=0, typical_range=(1.0, 1e6))
    force_rate: OptionalQuantity = quantity(20_000.0, "N/s", "highest rate of the force", above=0)
    inertia: OptionalQuantity = quantity(None, "kg m2", "inertia I on the disc", above=0)
    radius: OptionalQuantity = quantity(None, "m", "effective radius r of the pads", above=0, typical_range=(0.01, 1.0))
    border: OptionalQuantity = quantity(None, "N", "force N_0 above which the pad groans at standstill", above=0)
    growth: OptionalQuantity = quantity(None, "s/rad", "growth q of that force with the disc speed", at_least=0)

    def check(self):
        number("highest_force", self.highest_force, "N", above=self.lowest_force)

    def design(self, plant: HybridSystem) -> Any:
        """The law with the numbers read from the plant that are not given; border and growth only where a `margin` asks for them."""
        found: dict[str, Any] = {}
        try:
            found = {name: plant.parameter(f"disc.{name}") for name in ("inertia", "radius") if getattr(self, name) is None}
        except SceneError as error:
            raise SceneError(f"{type(self).__name__} needs `inertia` and `radius` of the disc: {error}") from None
        if self.margin is not None and (self.border is None or self.growth is None):
            border, growth = groan_force(plant)
            found |= {"border": border if self.border is None else self.border, "growth": growth if self.growth is None else self.growth}
        return replace(self, **found)

    def force_for(self, deceleration, friction=None):
        """The force of one pad that brakes with a deceleration [rad/s2], under the expected friction or another."""
        return self.inertia * deceleration / (2.0 * self.radius * (self.friction if friction is None else friction))

    def planned(self, speed: Any, period: Any) -> tuple[Any, dict[Any, Any]]:
        """The planned speed at this sample and the memory that it needs."""
        begun, following = state("brake.begun", "1"), state("brake.planned", "rad/s")
        now = ca.if_else(begun > 0.5, following, speed)
        return now, {begun: 1.0, following: ca.fmax(now - self.deceleration * period, 0.0)}

    @property
    def signal_limits(self) -> dict[str, tuple[float | None, float | None]]:
        """The limits of the force, for whoever draws it."""
        return {"brake.force": (self.lowest_force, self.highest_force)}

    def limited(self, wanted, speed, period, last):
        """The command, given the last one."""
        if self.margin is not None:
            wanted = ca.fmin(wanted, self.margin * self.border * ca.exp(self.growth * ca.fmax(speed, 0.0)))
        command = ca.fmin(ca.fmax(wanted, self.lowest_force), self.highest_force)
        if self.force_rate is not None:
            step = self.force_rate * period
            command = ca.fmin(ca.fmax(command, last - step), last + step)
        return ca.if_else(speed > 0.0, command, last)


def last_force() -> State:
    """The command of the sample before, as a state of the law."""
    return state("brake.last_force", "N")


def groan_force(plant: HybridSystem) -> tuple[float, float]:
    """(N_0 [N], q [s/rad]) of the force N = N_0 exp(q w) above which the pad of a disc brake loses its damping at the disc speed w.

    From 2 N (mu_s - mu_k) decay exp(-decay r w) = c, exponential friction: N_0 = c / (2 (mu_s - mu_k) decay), q = decay r. Under N_0 the pad keeps its
    damping down to standstill. Raises SceneError for a plant whose pad has another law of friction.
    """
    try:
        static, kinetic, decay = (plant.parameter(f"pad.friction.{word}") for word in ("static", "kinetic", "decay"))
        radius, damping = plant.parameter("disc.radius"), plant.parameter("disc.damping")
    except SceneError as error:
        raise SceneError(
            "A law with `margin` knows the force above which the pad groans only for a DiscBrake with exponential friction: give it `border` [N] and "
            "`growth` [s/rad] (on the safe side border = c / (2 s), c the damping of the caliper, s the steepest fall of the friction with "
            f"slip speed, and growth = 0), because: {error}"
        ) from None
    fall = 2.0 * (static - kinetic) * decay
    if not fall > 0:
        raise SceneError("The friction of the pad does not fall with speed: no force makes it groan.")
    return damping / fall, decay * radius
