"""A law of the top drive on the estimates of a string observer, which begins where the string is and looks as far ahead as commands are late."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from controllers.bumpless import acting, begun
from controllers.observers.linear import StringObserver
from toolbox import SceneError, Update, state
from toolbox.modelling import Observer, ObserverBasedController


@dataclass(frozen=True)
class StringObserverController(ObserverBasedController):
    """Controller of the top drive on the estimates of a `StringObserver`, with delay compensation and a bumpless start.

    It is `toolbox.modelling.ObserverBasedController` with two additions:

    - Delay compensation (Smith predictor). `delay_samples` is the delay of the commands on their way to the plant, in
      samples. The observer predicts its estimates over this delay, with the commands that have not arrived yet. The
      controller therefore acts on the state that the string will have when the command arrives, as if there were no
      delay (apart from model errors). The recorded estimates are the predicted estimates.
    - Bumpless start. At its first sample the observer begins with steady rotation at the measured speed under the
      present torque. The delayed commands begin at this torque. `ObserverBasedController` would begin with a stuck bit
      and an untwisted string, which would disturb the drive for some seconds. A string at rest starts as with
      `ObserverBasedController` (see `controllers.bumpless`).

    `StringObserver` is the base class of the observers in `controllers.observers`. With any other observer the class
    acts like `ObserverBasedController`.

    Source: O. J. M. Smith, Chem. Eng. Progress 53 (1957) 217-219 (delay compensation).

    Examples
    --------
    >>> from controllers import LQR, StringObserverController
    >>> from controllers.observers import Kalman
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, compose, simulate
    >>> drive = Sampled(StringObserverController(LQR(reference="60 rpm"), Kalman(), delay_samples=3), "10 ms", delay="30 ms")
    >>> run = simulate(compose(wells.JANSEN_2, BitRock(weight="60 kN")), "60 s", controller=drive)
    >>> print(f"{run['estimate.bit.speed'][-1]:.2f} rad/s estimated, {run['bit.speed'][-1]:.2f} rad/s")
    6.28 rad/s estimated, 6.28 rad/s
    """

    def sampled(self, signal, period):
        if not isinstance(self.observer, StringObserver):
            return super().sampled(signal, period)
        update = ObserverBasedController(self.law, Ahead(self.observer, self.delay_samples)).sampled(signal, period)
        if self.observer.initial_state_map is None:
            return update
        torque = acting(signal)
        starts = {memory: torque for memory in update.memory if memory.label.startswith("waiting")}
        state_of = next(memory for memory in update.memory if memory.label == "observer.state")
        return begun(update, signal, "observer", {state_of: self.observer.begun(signal("top.speed", "rad/s"), torque), **starts})


@dataclass(frozen=True)
class Ahead(Observer):
    """A string observer with estimates for `delay_samples` samples later, under the commands on their way; sampled only."""

    observer: Observer = field(default_factory=StringObserver)
    delay_samples: int = 0

    measured_signals: ClassVar[tuple[str, ...]] = ("top.speed",)

    def sampled(self, signal, period):
        if not isinstance(self.observer, StringObserver):
            raise SceneError(f"Argument `observer` must be an observer of a string, but it is {type(self.observer).__name__}.")
        line = [state(f"waiting{k}.top.torque", "N m") for k in range(self.delay_samples)]

        def arriving(name, unit, default=None):
            return line[0] if line and name == "top.torque" else signal(name, unit, default)

        update = self.observer.sampled(arriving, period)
        if not line:
            return update
        (x, following), *_ = update.memory.items()
        ahead = x
        for torque in line:
            ahead = self.observer.moved(ahead, torque, period)
        waiting = dict(zip(line, [*line[1:], signal("top.torque", "N m")], strict=True))
        return Update({x: following, **waiting}, self.observer.seen(ahead))
