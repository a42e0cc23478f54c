"""PID control of one signal by another, whatever the plant is."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca

from controllers.torque_limits import TorqueLimits, clipped
from toolbox import Controller, Equations, Quantity, SceneError, Update, quantity, state
from toolbox.authoring import NumberOrText, number
from toolbox.modelling import OptionalQuantity

SIGNALS = ("measured_signals", "actuated_signals")


@dataclass(frozen=True)
class PID(Controller):
    """PID control of any signal of a plant by any input, with limits and anti-windup.

        u = clip(bias + proportional e + integral int e dt - derivative y_f', lowest, highest),   e = reference - y

    y is the measured signal, u the actuated signal. y_f' is the derivative of y behind a first-order filter with the
    time constant `filter_time`. The derivative acts on y, not on e, so that a step of the set-point makes no jump of u.
    The gains are in SI units, in the unit of u per unit of y. The controller is continuous or sampled. The sampled form
    computes the integral by the forward and the filter by the backward Euler rule.

    The set-point is the signal `PART.reference`, with the PART of the measured signal, such as `block.reference` for
    `block.speed`; the field `reference` is its default. So `onset`, maps and sweeps can vary the set-point.

    Anti-windup: if a limit is given, the excess clip(u) - u is fed back to the integral with the time constant
    proportional / integral, or with the sample time if the sample time is longer (back-calculation).

    Start: the integral begins at 0. The filter of the derivative begins at 0 in the continuous form, at the first
    measurement in the sampled form.

    For a lead-lag element, state feedback or any other linear controller on any signals use `toolbox.from_control`.

    Source: K. J. Åström, T. Hägglund, Advanced PID Control, ISA 2006, chapter 3.

    Examples
    --------
    >>> from controllers import PID
    >>> from models import Joint
    >>> from toolbox import compose, simulate
    >>> drive = PID("joint.speed", "joint.torque", proportional=4.0, integral=20.0, reference="60 rpm", highest="8 N m")
    >>> run = simulate(compose(Joint()), "5 s", controller=drive)
    >>> print(f"{run['joint.speed'][-1]:.3f} rad/s")
    6.283 rad/s
    """

    measured_signals: str | tuple[str, ...] = field()  # type: ignore[misc, assignment]
    actuated_signals: str | tuple[str, ...] = field()  # type: ignore[misc, assignment]
    proportional: Quantity = quantity(1.0, "1", "proportional gain, in the unit of u per unit of y", at_least=0)
    integral: Quantity = quantity(0.0, "1/s", "integral gain, in the unit of u per unit of y and second", at_least=0)
    derivative: OptionalQuantity = quantity(
        None, "s", "derivative gain, in the unit of u per unit of y times second; None for none", at_least=0
    )
    filter_time: OptionalQuantity = quantity(None, "s", "time constant of the filter of the derivative", above=0)
    reference: NumberOrText = 0.0
    bias: NumberOrText = 0.0
    lowest: NumberOrText | None = None
    highest: NumberOrText | None = None
    units: tuple[str, str] | None = None
    """Units of y and u; `design` reads them from the plant."""

    def check(self):
        for word in SIGNALS:
            self._only(word)
        if (self.derivative is None) != (self.filter_time is None):
            raise SceneError("Arguments `derivative` and `filter_time` of PID must be given together, because the derivative is filtered.")
        if self.limited and not self.proportional:
            raise SceneError("Argument `proportional` of PID must be > 0 if there are limits, for its anti-windup, but it is 0.")

    def design(self, plant):
        y, u = (self._only(word) for word in SIGNALS)
        units = plant.signal_unit(y), plant.signal_unit(u)
        lowest, highest = (
            None if value is None else number(word, value, units[1]) for word, value in (("lowest", self.lowest), ("highest", self.highest))
        )
        if lowest is not None and highest is not None:
            number("highest", highest, units[1], above=lowest)
        return replace(
            self, measured_signals=(y,), actuated_signals=(u,), units=units, lowest=lowest, highest=highest,
            reference=number("reference", self.reference, units[0]), bias=number("bias", self.bias, units[1]),
        )  # fmt: skip

    @property
    def limited(self) -> bool:
        """Whether the output of the controller has a limit: True if `lowest` or `highest` is given."""
        return self.lowest is not None or self.highest is not None

    @property
    def signal_limits(self) -> dict[str, tuple[Any, Any]]:
        """Limits of the actuated signal, the output of the controller, as {signal: (lowest, highest)}. None means no
        limit. Figures of a run draw these limits.
        """
        return {self.actuated_signals[0]: (self.lowest, self.highest)}

    def continuous(self, signal):
        y, error = self._read(signal)
        integral, slow = state("pid.error_integral", "1"), state("pid.filtered", "1")
        rate = (y - slow) / self.filter_time if self.derivative is not None else 0.0
        wanted, u = self._command(error, integral, rate)
        flow = {integral: TorqueLimits.led_back(error, wanted, u, self.proportional)}
        return Equations(
            flow=flow | ({slow: rate} if self.derivative is not None else {}), outputs={self.actuated_signals[0]: (u, self.units[1])}
        )

    def sampled(self, signal, period):
        y, error = self._read(signal)
        integral, slow, started = state("pid.error_integral", "1"), state("pid.filtered", "1"), state("pid.started", "1")
        before = ca.if_else(started < 0.5, y, slow)
        rate = (y - before) / (self.filter_time + period) if self.derivative is not None else 0.0
        wanted, u = self._command(error, integral, rate)
        memory = {integral: integral + period * TorqueLimits.led_back(error, wanted, u, self.proportional, period * self.integral)}
        filters = {slow: before + period * rate, started: ca.SX(1)} if self.derivative is not None else {}
        return Update(memory=memory | filters, outputs={self.actuated_signals[0]: (u, self.units[1])})

    def _only(self, word: str) -> str:
        """The one signal that an argument names."""
        value = getattr(self, word)
        listed = value if isinstance(value, tuple) else (value,)
        if len(listed) != 1 or not isinstance(listed[0], str):
            raise SceneError(f'Argument `{word}` of PID must name one signal, such as "block.speed", but it is {value!r}.')
        return listed[0]

    def _read(self, signal: Any) -> tuple[Any, Any]:
        """The measured signal and the error."""
        name, (unit, _) = self.measured_signals[0], self.units or ("1", "1")
        y = signal(name, unit)
        return y, signal(f"{name.partition('.')[0]}.reference", unit, default=self.reference) - y

    def _command(self, error: Any, integral: Any, rate: Any) -> tuple[Any, Any]:
        """The command without limits, and the command."""
        wanted = self.bias + self.proportional * error + self.integral * integral
        if self.derivative is not None:
            wanted = wanted - self.derivative * rate
        return wanted, clipped(wanted, self.lowest, self.highest)
