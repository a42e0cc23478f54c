"""A law of the top drive on the estimates of a string observer, which begins where the string is and looks as far ahead as commands are late."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from controllers.bumpless import acting, begun
from controllers.observers.linear import StringObserver
from toolbox import SceneError, Update, state
from toolbox.modelling import Observed, Observer


@dataclass(frozen=True)
class OnEstimates(Observed):
    """`toolbox.modelling.Observed` for a `StringObserver`, at the arrival time of a command, and with a bumpless start.

    Where commands reach the plant `late` samples later, the estimates are carried on to that instant under the commands that are on their way: the law
    acts on the string that its command will meet, and its own loop has no delay but for what the model lacks (O. J. M. Smith, Chem. Eng. Progress 53
    (1957) 217-219). The estimates are recorded for that instant, too.

    At its first sample the observer begins as if the string turned steadily at the measured speed under the torque that acts, and the commands on their way
    begin at that torque. `Observed` takes the bit for stuck and the string for slack, and kicks the drive for seconds. A rig at rest is
    started as before (see `controllers.bumpless`). Other observers are left to `Observed`.
    """

    def sampled(self, signal, period):
        if not isinstance(self.observer, StringObserver):
            return super().sampled(signal, period)
        update = Observed(self.law, Ahead(self.observer, self.delay_samples)).sampled(signal, period)
        if self.observer.initial_state_map is None:
            return update
        torque = acting(signal)
        starts = {memory: torque for memory in update.memory if memory.label.startswith("waiting")}
        state_of = next(memory for memory in update.memory if memory.label == "observer.state")
        return begun(update, signal, "observer", {state_of: self.observer.begun(signal("top.speed", "rad/s"), torque), **starts})


@dataclass(frozen=True)
class Ahead(Observer):
    """A string observer whose estimates are those of `late` samples later, under the commands that are on their way; sampled only."""

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
