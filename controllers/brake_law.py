"""What laws that stop a disc brake share: the plan of the stop, the limits of the actuator, and the force above which the pad groans.

The border of groan. The pad keeps its damping at the disc speed w while 2 N s(r w) < c, with s(v) = -mu'(v) the fall of the friction at the slip speed v and c
the damping of the caliper, so that the border is N(w) = c / (2 s(r w)):

    exponential friction     N(w) = N_0 exp(q w),  N_0 = c / (2 (mu_s - mu_k) decay),  q = decay r
    a table                  constant between two speeds of the table, c / (2 s) with s the slope of that row; no border if friction does not fall there
    any other law            the lowest border within each of `CELLS` cells of speed: never above the true border
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from toolbox import Controller, HybridSystem, Quantity, SceneError, quantity, state
from toolbox.authoring import State, number
from toolbox.modelling import OptionalQuantities, OptionalQuantity

CELLS = 48
"""Cells of speed on which the border of a friction law is found that is neither exponential nor a table."""
UNBOUNDED = 1e9
"""Force [N] that stands for no border in a control law."""


@dataclass(frozen=True, kw_only=True)
class BrakeLaw(Controller):
    """Base class of sampled brake controllers, which command the force of the pads so that the disc follows w_p' = -deceleration to standstill.

        I w' = -T,   T = 2 mu r N,   N_p = I deceleration / (2 r friction)  is the force of the plan

    The plan begins at the speed of the first sample and ends at 0.

    Limits of the command:

    - It stays between `lowest_force`, which holds the wheel at standstill, and `highest_force`.
    - It changes by at most `force_rate` times the period (None: no limit).
    - It is held after the wheel has stopped.
    - With a `margin` it stays below `margin` times the border of groan, the force above which the pad loses its damping
      (`groan_border`). The brake is then released before standstill, as a chauffeur does, and the stop becomes longer.
    - With a `jerk` (or `car_jerk`) beside the margin, the force falls before the car reaches a speed below which the
      border is lower, so that the deceleration a falls along a^2 = a_0^2 + 2 jerk (w - w_0). Here w_0 is this speed and
      a_0 the deceleration at the lower border. Without a `jerk` the force falls in a step at w_0, as fast as `force_rate`
      allows. Only a border in pieces, such as the border of a table, has such speeds.

    The border of groan is either `border` with an exponential growth, or `border_forces`, each of which holds from its
    speed in `border_speeds` up to the next speed. The inertia I, the radius r and the border are read from the plant if
    they are not given.
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("disc.speed",)
    actuated_signals: ClassVar[tuple[str, ...]] = ("brake.force",)

    deceleration: Quantity = quantity(2.0, "rad/s2", "wanted deceleration of the disc", above=0)
    car_deceleration: OptionalQuantity = quantity(None, "m/s2", "wanted deceleration of the car, in place of `deceleration`", above=0)
    friction: Quantity = quantity(0.4, "1", "expected coefficient of friction", above=0)
    margin: OptionalQuantity = quantity(None, "1", "allowed force as a fraction of the border of groan", above=0)
    lowest_force: Quantity = quantity(100.0, "N", "lowest force of one pad", at_least=0)
    highest_force: Quantity = quantity(5000.0, "N", "highest force of one pad", above=0, typical_range=(1.0, 1e6))
    jerk: OptionalQuantity = quantity(
        None, "rad/s3", "largest jerk of the disc while the force falls to a lower border; in the MPC also while it rises", above=0
    )
    car_jerk: OptionalQuantity = quantity(None, "m/s3", "largest jerk of the car, in place of `jerk`", above=0)
    force_rate: OptionalQuantity = quantity(20_000.0, "N/s", "highest rate of the force", above=0)
    inertia: OptionalQuantity = quantity(None, "kg m2", "inertia I on the disc", above=0)
    radius: OptionalQuantity = quantity(None, "m", "effective radius r of the pads", above=0, typical_range=(0.01, 1.0))
    border: OptionalQuantity = quantity(None, "N", "force N_0 above which the pad groans at standstill", above=0)
    border_growth: OptionalQuantity = quantity(None, "s/rad", "growth q of the border of groan with the disc speed", at_least=0)
    border_speeds: OptionalQuantities = quantity(None, "rad/s", "disc speeds, from 0 upwards, at which the border changes", at_least=0)
    border_forces: OptionalQuantities = quantity(None, "N", "border from each of `border_speeds` up to the next one", above=0)

    def check(self):
        number("highest_force", self.highest_force, "N", above=self.lowest_force)
        if (self.border_speeds is None) != (self.border_forces is None):
            raise SceneError("Arguments `border_speeds` and `border_forces` must be given together, but one is missing.")
        if self.border_speeds is not None and self.border is not None:
            raise SceneError("Arguments `border` and `border_forces` must not be given together: both are the border of groan.")
        if self.border_speeds is not None:
            speeds = tuple(self.border_speeds)
            if len(speeds) != len(self.border_forces):
                raise SceneError(
                    f"Arguments `border_speeds` and `border_forces` must have one length, but it is {len(speeds)} and {len(self.border_forces)}."
                )
            if speeds[:1] != (0.0,) or any(not u < w for u, w in pairwise(speeds)):
                raise SceneError(f"Argument `border_speeds` must begin at 0 and increase, but it is {speeds!r}.")

    def design(self, plant: HybridSystem) -> Any:
        """Return a copy of the controller in which the fields that are None have values from the plant.

        `inertia` and `radius` are read from the disc, and `deceleration` and `jerk` follow from `car_deceleration` and
        `car_jerk`. If there is a `margin`, the border of groan is computed by `groan_border`.
        """
        found: dict[str, Any] = {}
        try:
            found = {name: plant.parameter(f"disc.{name}") for name in ("inertia", "radius") if getattr(self, name) is None}
        except SceneError:
            raise SceneError(
                f"{type(self).__name__} needs `inertia` and `radius` of a disc: give both, or a plant with a `DiscBrake`."
            ) from None
        if self.margin is not None and self.border_forces is None and (self.border is None or self.border_growth is None):
            border = groan_border(plant)
            if border.border_growth > 0.0:
                first, growth = border.forces[0], border.border_growth
                found |= {
                    "border": first if self.border is None else self.border,
                    "border_growth": growth if self.border_growth is None else self.border_growth,
                }
            elif self.border is not None or self.border_growth is not None:
                missing = "border_growth" if self.border_growth is None else "border"
                raise SceneError(
                    f"Arguments `border` and `border_growth` must be given together on friction that is not exponential, but `{missing}` is missing."
                )
            else:
                found |= {"border_speeds": border.speeds, "border_forces": tuple(min(force, UNBOUNDED) for force in border.forces)}
        for name in ("deceleration", "jerk"):
            of_car = getattr(self, f"car_{name}")
            if of_car is not None:
                try:
                    found[name] = of_car / plant.parameter("disc.wheel_radius")
                except SceneError as error:
                    raise SceneError(f"Argument `car_{name}` needs a DiscBrake with a `wheel_radius`: {error}") from None
        return replace(self, **found)

    def border_at(self, speed: Any) -> Any:
        """Return the force [N] above which the pad groans at a disc speed [rad/s] >= 0, an expression or numbers of any shape."""
        if self.border_forces is None or self.border_speeds is None:
            return self.border * (ca if isinstance(speed, ca.SX) else np).exp(self.border_growth * speed)
        if not isinstance(speed, ca.SX):
            return np.asarray(self.border_forces)[np.searchsorted(self.border_speeds, speed, side="right") - 1]
        force: Any = self.border_forces[0]
        for begin, beyond in zip(self.border_speeds[1:], self.border_forces[1:], strict=True):
            force = ca.if_else(speed >= begin, beyond, force)
        return force

    def highest_eased(self, speed: Any) -> Any:
        """Return `margin` times the border [N] at a disc speed [rad/s] >= 0, reduced before each lower piece so that the jerk stays below `jerk`."""
        margin = 1.0 if self.margin is None else self.margin
        force = margin * self.border_at(speed)
        if self.jerk is None or self.border_forces is None or self.border_speeds is None:
            return force
        symbolic = isinstance(speed, ca.SX)
        least, choice, root = (ca.fmin, ca.if_else, ca.sqrt) if symbolic else (np.minimum, np.where, np.sqrt)
        growth = 2.0 * self.jerk * self.force_for(1.0) ** 2  # of the squared force with the speed
        for below, begin in zip(self.border_forces[:-1], self.border_speeds[1:], strict=True):
            ahead = (ca.fmax if symbolic else np.maximum)(speed - begin, 0.0)
            force = least(force, choice(speed >= begin, root((margin * below) ** 2 + growth * ahead), UNBOUNDED))
        return force

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

    @property
    def rate_limits(self) -> dict[str, float | None]:
        """The highest rate of the force, for whoever tells when it was reached."""
        return {"brake.force": self.force_rate}

    def limited(self, wanted, speed, period, last):
        """The command, given the last one."""
        if self.margin is not None:
            wanted = ca.fmin(wanted, self.highest_eased(ca.fmax(speed, 0.0)))
        command = ca.fmin(ca.fmax(wanted, self.lowest_force), self.highest_force)
        if self.force_rate is not None:
            step = self.force_rate * period
            command = ca.fmin(ca.fmax(command, last - step), last + step)
        return ca.if_else(speed > 0.0, command, last)


def last_force() -> State:
    """The command of the sample before, as a state of the law."""
    return state("brake.last_force", "N")


class GroanBorder(NamedTuple):
    """Border of groan of a disc brake: the force of one pad above which the pad groans, as a function of the disc speed.

    Attributes
    ----------
    speeds
        Disc speeds at which the pieces of the border begin [rad/s], ascending, the first 0.
    forces
        Force of each piece [N]. inf if the pad does not groan at any force.
    border_growth
        Growth q of the border with the disc speed [s/rad]. The border is forces[i] exp(border_growth w) for disc speeds w from
        speeds[i] to speeds[i + 1].

    Examples
    --------
    >>> from controllers import groan_border
    >>> from models import DiscBrake
    >>> from toolbox import compose
    >>> border = groan_border(compose(DiscBrake()))
    >>> print(f"{border.at(0.0):.0f} N at standstill, {border.at(2.0):.0f} N at 2 rad/s")
    200 N at standstill, 664 N at 2 rad/s
    """

    speeds: tuple[float, ...]
    forces: tuple[float, ...]
    border_growth: float = 0.0

    def at(self, speed: float) -> float:
        """Return the border [N] at a disc speed [rad/s] >= 0. If two pieces of the border meet at this speed, the
        result belongs to the piece of the higher speeds.

        Parameters
        ----------
        speed
            Disc speed [rad/s], >= 0.
        """
        piece = int(np.searchsorted(self.speeds, number("speed", speed, "rad/s", at_least=0), side="right")) - 1
        return self.forces[piece] * math.exp(self.border_growth * speed)  # growth is 0 where a piece has no border

    def __str__(self) -> str:
        ends = (*self.speeds[1:], math.inf)
        grows = f" x exp({self.border_growth:g} s/rad x disc speed)" if self.border_growth else ""
        told = (f"{force:.1f} N" if math.isfinite(force) else "no border" for force in self.forces)
        rows = zip(self.speeds, ends, told, strict=True)
        return "\n".join(["Border of groan, force of one pad", *(f"  {u:8.3f} to {w:8.3f} rad/s  {force}{grows}" for u, w, force in rows)])


def groan_border(plant: HybridSystem) -> GroanBorder:
    """Find the force of one pad above which a disc brake groans, because the pad loses its damping, as a function of
    the disc speed.

    The pad keeps its damping while 2 N s(r w) < c. Here s is the decrease of the friction coefficient per unit of slip
    speed, r the effective radius, w the disc speed and c the damping of the caliper.

    - For exponential friction and for tables the border is exact.
    - For any other friction law without breaks, and for two pads with different friction, the result is the lowest
      border within each cell of a grid of speeds up to 30 rad/s.

    Parameters
    ----------
    plant
        A plant with a `DiscBrake`.

    Returns
    -------
    GroanBorder
        Speeds [rad/s] at which the border changes, and the border [N] from each of these speeds on.

    Raises
    ------
    SceneError
        If the plant has no pad, its friction law has breaks or a memory, or friction nowhere falls with speed.

    Examples
    --------
    >>> from controllers import groan_border
    >>> from models import DiscBrake, Tabulated
    >>> from toolbox import compose
    >>> table = Tabulated(speeds=(0.0, 0.24, 0.6), coefficients=(0.45, 0.42, 0.38), static=0.45)
    >>> print(groan_border(compose(DiscBrake(friction=table))))
    Border of groan, force of one pad
         0.000 to    2.000 rad/s  800.0 N
         2.000 to    5.000 rad/s  900.0 N
         5.000 to      inf rad/s  no border
    """
    try:
        law = plant.element("pad").law
        radius, damping = plant.parameter("disc.radius"), plant.parameter("disc.damping")
    except SceneError as error:
        raise SceneError(
            "A law with `margin` knows the force above which the pad groans only for a DiscBrake: give it `border_speeds` [rad/s] and `border_forces` [N], "
            f"because: {error}"
        ) from None
    laws = [part for _, part, _ in getattr(law, "parts", ())] or [law]  # two pads on one disc are one friction
    if law is None or law.break_speeds() or law.memory(1):
        raise SceneError(
            "A law with `margin` needs friction without breaks and without memory to find the force above which the pad groans: give it "
            f"`border_speeds` [rad/s] and `border_forces` [N], because the law of the pad is {type(law).__name__}."
        )
    known = {name.rpartition(".")[2]: plant.parameter(name) for name in plant.parameters if name.startswith("pad.friction.")}
    if len(laws) > 1:
        (speeds, falls), growth = _sampled_falls(plant, laws, radius), 0.0
    elif set(known) == {"static", "kinetic", "decay"} and _is_exponential(law):
        speeds, falls, growth = np.zeros(1), np.array([(known["static"] - known["kinetic"]) * known["decay"]]), known["decay"] * radius
    elif set(known) == {"static", "speeds", "coefficients"}:
        speeds, growth = known["speeds"] / radius, 0.0
        falls = np.append(-np.diff(known["coefficients"]) / np.diff(known["speeds"]), 0.0)
    else:
        (speeds, falls), growth = _sampled_falls(plant, laws, radius), 0.0
    if not falls.max() > 0.0:
        raise SceneError("The friction of the pad does not fall with speed: no force makes it groan.")
    forces = [damping / (2.0 * fall) if fall > 0.0 else math.inf for fall in falls]
    return GroanBorder(tuple(map(float, speeds)), tuple(map(float, forces)), float(growth))


def _is_exponential(law: Any) -> bool:
    """Whether the law falls as mu_k + (mu_s - mu_k) exp(-decay v)."""
    speed = ca.SX.sym("speed")
    found = law.sliding(speed)
    expected = law.kinetic + (law.static - law.kinetic) * ca.exp(-law.decay * speed)
    return bool(ca.is_equal(ca.SX(found), ca.SX(expected), 6))


def _sampled_falls(plant: HybridSystem, laws: list[Any], radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Beginnings of cells of disc speed [rad/s], and the steepest fall of the mean friction of the pads at seventeen speeds within each of them."""
    speed = ca.SX.sym("speed")
    mean = sum(ca.SX(law.sliding(speed)) for law in laws) / len(laws)
    fall = ca.substitute(-ca.jacobian(mean, speed), plant.p, ca.SX(plant.values))
    slopes = ca.Function("fall", [speed], [ca.densify(fall)])
    edges = np.append(0.0, np.geomspace(0.01, 30.0, CELLS))
    found = [float(np.max(np.asarray(slopes(radius * np.linspace(low, high, 17)[None, :])))) for low, high in pairwise(edges)]
    last = float(slopes(radius * edges[-1]))
    return edges, np.append(found, last)


def groan_force(plant: HybridSystem) -> tuple[float, float]:
    """Find (N_0 [N], q [s/rad]) of the force N = N_0 exp(q w) above which the pad of a disc brake with exponential friction loses its damping.

    Under N_0 the pad keeps its damping down to standstill. Raises SceneError for a plant whose pad has another law of friction: see `groan_border`.
    """
    border = groan_border(plant)
    if border.border_growth == 0.0:
        raise SceneError("The border grows exponentially with speed only for exponential friction: use `groan_border`.")
    return border.forces[0], border.border_growth
