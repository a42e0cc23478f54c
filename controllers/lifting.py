"""A law that lifts its own set-point once there is evidence that the bit stops, and lowers it again, as drillers do by hand."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from controllers.bumpless import acting, begun
from controllers.dither import declared_load
from controllers.observers import Kalman
from controllers.observers.linear import StringObserver
from controllers.string_model import lumped_string
from toolbox import Controller, HybridSystem, Quantity, SceneError, Update, quantity, state
from toolbox.modelling import OptionalQuantity

SLOW, FAST = 0.35, 0.5
"""Bit speeds in parts of the set-point: below the first it dips, above the second the next dip counts as another one."""
SWING, STILL = 0.8, 0.5
"""Amplitudes of the string's torque over its impedance, in parts of the set-point: from the first on a dip may be a stick, below the second the bit is calm."""
APART, STUCK, CALM, WATCHED, VAIN = 20.0, 1.0, 0.5, 54.0, 36.0
"""Periods of the string: between two dips that are one evidence, of a dip that is one by itself, of calm until the set-point comes down, until a relapse is a
new event, and for which the set-point may be lifted or bit or top stand beyond the time that they do not."""
BRAKE = 8.0
"""What is taken off the torque above a limit of the speed, in impedances of the string times what the speed is above it."""
CHANGED = 0.05
"""Change of the set-point that counts as new, in parts of it."""


@dataclass(frozen=True)
class Lifting(Controller):
    """Controller that raises the set-point of another controller while the bit sticks and slips, as drillers do by hand.

    In this description L is the raised set-point [rad/s], and zeta the torsional wave impedance of the string [N m
    s/rad]. A period is the natural period of the string below a drive that holds its speed (the field `string_period`
    [s]). A Kalman filter estimates the bit speed and the string torque from the top speed and the torque command.

    1. Detection. A dip is a bit speed below 0.35 L while sqrt(2 var(string torque)) > 0.8 L zeta, after a bit speed
       above 0.5 L. The variance is taken over one period. Stick-slip is detected after two dips within 20 periods, or
       after one dip that lasts a period.
    2. Raise. L rises at `raise_rate` to `first_factor` times the set-point. If stick-slip is detected again at this L,
       `factor_step` times the set-point is added, up to `max_factor` times the set-point.
    3. Return. When the amplitude of the string torque has stayed below 0.5 L zeta for half a period, L returns to the
       set-point at `lower_rate`.
    4. Relapse. If stick-slip is detected during the return, or within 54 periods after it, L rises to the value at
       which stick-slip ended before. After n relapses L returns 1 + n^2 / 2 times more slowly.
    5. Give up. L returns, and is not raised again until the set-point changes by 5 %, or until `retry_time` has passed.
       The controller gives up in these cases:

    - at relapse number `max_attempts`, if L had reached the set-point again before it;
    - at relapse number `max_attempts` + 1 in any case;
    - if stick-slip is detected while L is at `max_factor` times the set-point;
    - if the time with a raised set-point, or with bit or top at a standstill, is 36 periods longer than the remaining
      time.

    Not detected as stick-slip:

    - a varying weight on bit, because it does not cause dips with such large torque amplitudes;
    - a step of the set-point, because L follows it at `raise_rate` and `lower_rate`;
    - dips while the string is to stop or to reverse.

    Rotation to the left is treated in the same way.

    Why it works: stick-slip that coexists with smooth running at one set-point does not exist at a higher set-point,
    where the friction of the rock falls less steeply with speed. The cost: while the set-point is raised the top turns
    at two or more times the set-point, for 30 to 60 s (`python -m studies recovery`). The method helps if the inner
    controller holds smooth running at the set-point and damps the string. A stiff drive leaves the string swinging for
    minutes, and the controller gives up.

    Limit of the top speed, with `speed_limit_factor`: the torque of the inner controller is reduced, at most to zero,
    while the top turns faster than L, `speed_limit_factor` times the set-point and `min_speed_limit`. Without this
    limit a controller that follows a released bit accelerates the top to more than twice the set-point. `first_factor`
    must be below `speed_limit_factor`, and a slower `raise_rate` helps. The cost: the string swings longer, and a weak
    inner controller needs a higher L. Smooth running is not affected. `min_speed_limit` is needed at low set-points: a
    bit that breaks free turns equally fast at low and high set-points, and the top must be allowed to follow it in
    order to calm it.

    Weight relief, with `weight_relief`: while L is raised the weight on bit is reduced by this fraction at
    `unload_rate`. Afterwards it returns at `reload_rate`. A smaller and slower raise is then enough, for example
    `first_factor=1.3, factor_step=0.25, raise_rate=0.2, weight_relief=0.4`. The cost is less weight for two minutes.
    The controller then gives `bit.weight` and reads the full weight from `weight.reference` (default: the field
    `weight`).

    The inner controller `law` gets the signal `top.reference` with the value L. The field `reference` is the default of
    this signal and the set-point for which the inner controller is designed.

    Recorded signals:

    - `lifting.reference`: L [rad/s].
    - `lifting.lifts`: number of raises.
    - `lifting.gave_up`: magnitude of the set-point at which the controller gave up [rad/s], else 0.
    - `lifting.held`: L minus the set-point at the last time at which the stick-slip ended [rad/s].
    - `lifting.relief`: removed fraction of the weight (with `weight_relief`).

    Sampled only. If the inner controller is designed as a Python callable (for example a predictive controller), the
    whole controller becomes a callable, and after a run `run.controllers[0].inside` holds the inner controller.

    Source: the practice of raising the rotary speed against stick-slip; the rules and their numbers are choices of this
    toolbox.

    Examples
    --------
    >>> from controllers import Lifting, SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, compose, simulate
    >>> drive = Lifting(SoftTorque(reference="60 rpm"), reference="60 rpm")
    >>> run = simulate(compose(wells.JANSEN_2, BitRock(weight="97 kN")), "120 s", controller=Sampled(drive, "10 ms"))
    >>> print(f"the bit sticks for {run.time_in('bit', 'stick', after=60.0):.1f} s of the last 60 s")
    the bit sticks for 0.0 s of the last 60 s
    """

    law: Controller = field(default_factory=Controller)
    reference: Quantity = quantity(8.0, "rad/s", "set-point of the speed", above=0, typical_range=(0.05, 40.0))
    first_factor: Quantity = quantity(2.0, "1", "first raised set-point as a multiple of the set-point", above=1)
    factor_step: Quantity = quantity(
        0.5, "1", "increase of the raised set-point if stick-slip persists, as a multiple of the set-point", above=0
    )
    max_factor: Quantity = quantity(4.0, "1", "highest raised set-point as a multiple of the set-point", above=1)
    raise_rate: Quantity = quantity(0.5, "rad/s2", "rate at which the set-point is raised", above=0)
    lower_rate: Quantity = quantity(0.3, "rad/s2", "rate at which the raised set-point is lowered", above=0)
    max_attempts: Quantity = quantity(2.0, "1", "number of relapses until the controller gives up", at_least=0)
    retry_time: OptionalQuantity = quantity(
        None, "s", "time after giving up at which the set-point may be raised again; never unless given", above=0
    )
    speed_limit_factor: OptionalQuantity = quantity(
        None, "1", "top speed above which the torque is reduced, as a multiple of the set-point; no limit unless given", above=1
    )
    min_speed_limit: Quantity = quantity(0.0, "rad/s", "top speed below which the torque is never reduced", at_least=0)
    weight_relief: OptionalQuantity = quantity(None, "1", "fraction of the weight that is removed; none unless given", above=0, at_most=1)
    unload_rate: Quantity = quantity(0.05, "1/s", "rate at which weight is removed, as a fraction of the weight", above=0)
    reload_rate: Quantity = quantity(0.01, "1/s", "rate at which the weight returns, as a fraction of the weight", above=0)
    weight: OptionalQuantity = quantity(None, "N", "weight without relief, default of `weight.reference`; filled in by design", at_least=0)
    string_period: OptionalQuantity = quantity(
        None, "s", "period of the string below a drive that does not swing; filled in by design", above=0
    )
    string_impedance: OptionalQuantity = quantity(None, "N m s/rad", "sqrt(stiffness inertia) of the string; filled in by design", above=0)
    observer: StringObserver = field(default_factory=lambda: Kalman(torque_process_noise=2000.0))

    def check(self):
        for name, kind in (("law", Controller), ("observer", StringObserver)):
            if not isinstance(getattr(self, name), kind):
                raise SceneError(f"Argument `{name}` must be a {kind.__name__}, but it is {getattr(self, name)!r}.")

    @property
    def actuated_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the outputs: the outputs of the inner controller `law` and, with `weight_relief`, the weight on bit."""
        return self.law.actuated_signals if self.weight_relief is None else (*self.law.actuated_signals, "bit.weight")

    def design(self, plant: HybridSystem) -> Controller:
        """Return the controller with its inner controller `law` and its observer designed on the plant.

        Fields that are None are computed from the plant:

        - `string_period`: natural period of the string below a drive that does not swing [s];
        - `string_impedance`: torsional impedance of the string [N m s/rad];
        - `weight`, with `weight_relief`: declared weight on bit [N].

        Parameters
        ----------
        plant
            The plant on which the controller is designed.
        """
        filled: dict[str, Any] = {}
        if self.string_period is None or self.string_impedance is None:
            string = lumped_string(plant, "Lifting", "`string_period` and `string_impedance`")
            filled = {"string_period": 2.0 * math.pi / string.frequency, "string_impedance": string.impedance}
            filled = {name: value for name, value in filled.items() if getattr(self, name) is None}
        if self.weight_relief is not None and self.weight is None:
            filled["weight"] = declared_load(plant, "bit.weight")
        return dataclasses.replace(self, law=self.law.design(plant), observer=self.observer.design(plant), **filled)

    def sampled(self, signal, period):
        wanted, asked = signal("top.reference", "rad/s", default=self.reference), state("lifting.asked", "rad/s")
        speed, torque = signal("top.speed", "rad/s"), acting(signal)
        x = state("lifting.string", "1", len(self.observer.gain or ()))
        mean, square = state("lifting.mean", "rad/s"), state("lifting.square", "rad2/s2")
        armed = state("lifting.armed", "1")  # 1 for the next dip; below, minus the periods for which a dip has lasted
        left, calm, watch, vain = (state(f"lifting.{name}", "s") for name in ("left", "calm", "watch", "vain"))
        extra, level, held, gave_up = (state(f"lifting.{name}", "rad/s") for name in ("speed", "level", "held", "gave_up"))
        relapses, lifts = state("lifting.relapses", "1"), state("lifting.lifts", "1")
        turn = ca.if_else(
            ca.if_else(asked == 0.0, wanted, asked) < 0.0, -1.0, 1.0
        )  # what follows is in sizes, so that a string that turns to the left is lifted too
        size, nothing = turn * asked, 1e-3 * self.reference
        lifted = size + extra

        def higher(name, unit, default=None):
            return turn * lifted if name == "top.reference" else signal(name, unit, default)

        inside = self.law.sampled(higher, period)
        estimates = self.observer.seen(x)
        bit, swing = turn * estimates["bit.speed"][0], estimates["top.load"][0] / self.string_impedance
        share = ca.fmin(period / self.string_period, 1.0)

        swings = 2.0 * (square - mean * mean)  # square of the amplitude
        slow = (bit < SLOW * lifted) * (swings > (SWING * lifted) ** 2) * (level <= extra) * (torque != 0.0)
        slow *= turn * wanted > nothing  # a string that is to stop, or to turn back, dips by right
        dip, stop = (armed > 0.5) * slow, slow * (armed <= -STUCK)
        quiet = (gave_up > nothing) * (ca.fabs(size - gave_up) <= CHANGED * gave_up)
        waited = None if self.retry_time is None else state("lifting.waited", "s")
        if waited is not None:
            quiet *= waited < self.retry_time
        watches = (watch > period) * ((gave_up <= nothing) + quiet)
        evidence = (dip + stop > 0.5) * (left > 0.0) * (1.0 - quiet)
        up, most = level > nothing, (self.max_factor - 1.0) * size
        taken = 0.0 if self.weight_relief is None else state("lifting.relief", "1")
        there = ca.fabs(wanted - asked) <= CHANGED * ca.fabs(wanted)  # what happens on the way to another set-point says nothing of it
        relapse = evidence * (1.0 - up) * watches * there
        back = (extra <= nothing) * (taken <= 0.0)  # all is as it is asked: no slower way there would have helped
        ends = (
            evidence * ca.if_else(up, level >= most, relapse * (relapses + back >= self.max_attempts)) + (vain > VAIN * self.string_period)
            > 0.5
        )
        lifts_now = evidence * (1.0 - ends)
        higher_by = ca.if_else(up, level + self.factor_step * size, ca.if_else(relapse, held, (self.first_factor - 1.0) * size))
        calms = up * (calm <= 0.0) * (1.0 - evidence)
        aim = ca.if_else(lifts_now, ca.fmin(higher_by, most), ca.if_else(ends + calms, 0.0, ca.if_else(up, level, 0.0)))
        rises = aim > extra
        slower = self.lower_rate / (1.0 + 0.5 * relapses * relapses)
        moved = ca.if_else(rises, ca.fmin(extra + self.raise_rate * period, aim), ca.fmax(extra - slower * period, aim))
        busy = (extra > nothing) + (aim > nothing)
        stands = (ca.fmin(bit, turn * speed) < SLOW * lifted) * (turn * wanted > nothing) * there
        memory = {
            x: self.observer.moved(x, torque, period, speed),
            asked: asked + turn * ca.fmin(ca.fmax(turn * (wanted - asked), -self.lower_rate * period), self.raise_rate * period),
            mean: mean + share * (swing - mean),
            square: square + share * (swing * swing - square),
            armed: ca.if_else(bit > FAST * lifted, 1.0, ca.if_else(armed > 0.5, 1.0 - dip, armed - share)),
            left: ca.if_else(evidence, 0.0, ca.if_else(dip, APART * self.string_period, ca.fmax(left - period, 0.0))),
            calm: ca.if_else(
                (aim > nothing) * ((swings > (STILL * lifted) ** 2) + rises), CALM * self.string_period, ca.fmax(calm - period, 0.0)
            ),
            vain: (1.0 - ends) * (1.0 - quiet) * ca.fmax(vain + ca.if_else(busy + stands > 0.5, period, -period), 0.0),
            watch: ca.if_else(busy, WATCHED * self.string_period, watches * (watch - period)),
            extra: moved,
            level: aim,
            held: ca.if_else(calms, level, ca.if_else(held > nothing, held, 0.0)),
            gave_up: ca.if_else(ends, size, ca.if_else(quiet, gave_up, 0.0)),
            relapses: ca.if_else(watches, relapses + relapse, 0.0),
            lifts: ca.if_else(lifts > 0.5, lifts, 0.0) + lifts_now * (1.0 - up),
        }
        if waited is not None:
            memory[waited] = quiet * (waited + period)
        outputs = {**inside.outputs, "lifting.reference": (turn * lifted, "rad/s")}
        if self.speed_limit_factor is not None:
            drive, unit = inside.outputs["top.torque"]
            bar = ca.fmax(ca.fmax(self.speed_limit_factor * size, self.min_speed_limit), lifted)
            over = ca.fmax(turn * speed - bar, 0.0)
            kept = ca.fmax(turn * drive - BRAKE * self.string_impedance * over, ca.fmin(turn * drive, 0.0))
            outputs["top.torque"] = (turn * kept, unit)
        if self.weight_relief is not None:
            full = signal("weight.reference", "N", default=self.weight)
            memory[taken] = ca.if_else(
                aim > nothing,
                ca.fmin(taken + self.unload_rate * period, self.weight_relief),
                ca.fmax(taken - self.reload_rate * period, 0.0),
            )
            outputs["bit.weight"] = (full * (1.0 - taken), "N")
        update = Update({**memory, **inside.memory}, outputs)
        load = self.observer.seen(self.observer.begun(speed, torque))["top.load"][0] / self.string_impedance
        return begun(update, signal, "lifting", {x: self.observer.begun(speed, torque), asked: wanted, mean: load, square: load * load})
