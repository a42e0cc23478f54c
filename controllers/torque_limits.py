"""What a law knows of the limits of the drive that carries out its command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from toolbox import Controller, SceneError, quantity, state
from toolbox.authoring import number
from toolbox.modelling import OptionalQuantity


def clipped(wanted: Any, lowest: Any, highest: Any) -> Any:
    """A command within its limits; None is no limit."""
    wanted = wanted if lowest is None else ca.fmax(wanted, lowest)
    return wanted if highest is None else ca.fmin(wanted, highest)


@dataclass(frozen=True, kw_only=True)
class TorqueLimits(Controller):
    """Base class of controllers that know the limits of torque and torque rate of the drive. None means no limit.

        u = clip(wanted, lowest_torque, highest_torque),   sampled also |u_k - u_(k-1)| <= torque_rate period

    A controller with an integral feeds command - wanted back to the integral, so that it does not wind up (anti-windup
    by back-calculation). A limit of the rate is possible only for sampled controllers.

    In the sampled form the time constant of the anti-windup is never shorter than the period T: the excess wanted -
    command is multiplied by 1 - T / max(T_t, T) from sample to sample, which is between 0 and 1. With 1 - T / T_t it
    would grow without bound for T > 2 T_t.

    Source: K. J. Åström, T. Hägglund, Advanced PID Control, ISA 2006, section 3.5 (back-calculation).
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("top.speed",)
    actuated_signals: ClassVar[tuple[str, ...]] = ("top.torque",)

    lowest_torque: OptionalQuantity = quantity(None, "N m", "lowest torque of the drive", typical_range=(100.0, 1e6))
    highest_torque: OptionalQuantity = quantity(None, "N m", "highest torque of the drive", typical_range=(100.0, 1e6))
    torque_rate: OptionalQuantity = quantity(None, "N m/s", "highest rate of the torque of the drive", above=0)

    def check(self):
        if self.lowest_torque is not None and self.highest_torque is not None:
            number("highest_torque", self.highest_torque, "N m", above=self.lowest_torque)

    @property
    def limits_known(self) -> bool:
        """Whether the law knows any limit."""
        return any(limit is not None for limit in self.limits.values())

    @property
    def limits(self) -> dict[str, float | None]:
        """The limits by name, for a law that designs another one."""
        return {"lowest_torque": self.lowest_torque, "highest_torque": self.highest_torque, "torque_rate": self.torque_rate}

    @property
    def signal_limits(self) -> dict[str, tuple[float | None, float | None]]:
        """The limits of the torque, for whoever draws it."""
        return {"top.torque": (self.lowest_torque, self.highest_torque)}

    @property
    def rate_limits(self) -> dict[str, float | None]:
        """The highest rate of the torque, for whoever tells when it was reached."""
        return {"top.torque": self.torque_rate}

    def clipped(self, wanted: Any) -> Any:
        """Return the wanted torque, limited to the torque of the drive."""
        return clipped(wanted, self.lowest_torque, self.highest_torque)

    def limited(self, wanted: Any, period: Any = None) -> tuple[Any, dict[Any, Any]]:
        """The command, and the memory that a rate limit needs; without a period (continuous) a rate limit is an error."""
        command = self.clipped(wanted)
        if self.torque_rate is None:
            return command, {}
        if period is None:
            raise SceneError("A rate limit acts on samples: give `sample_time`, or leave out `torque_rate`.")
        last = state(f"{type(self).__name__.lower()}.last_torque", "N m")
        step = self.torque_rate * period
        command = ca.fmin(ca.fmax(command, last - step), last + step)
        return command, {last: command}

    @staticmethod
    def led_back(error: Any, wanted: Any, command: Any, torque: Any, least: Any = None) -> Any:
        """Return the rate of the integral of an error [rad/s], led back by (command - wanted) / torque. `least` is a lower bound of
        `torque` [N m s/rad] for sampled laws."""
        if command is wanted:
            return error
        return error + (command - wanted) / (torque if least is None else ca.fmax(torque, least))
