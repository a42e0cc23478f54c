"""A law of the top drive on the estimates of a string observer that begins where the string is."""

from __future__ import annotations

from dataclasses import dataclass

from controllers.bumpless import acting, begun
from controllers.observers.linear import StringObserver
from toolbox import Observed


@dataclass(frozen=True)
class OnEstimates(Observed):
    """`toolbox.Observed` for a `StringObserver`, which begins as if the string turned steadily at the measured speed under the torque that acts.

    Without this, an observer that is switched on in the middle of a run takes the bit for stuck and the string for slack, and its law kicks the drive for
    seconds. Commands on their way (`late`) begin at the torque that acts. A rig at rest is started as before (see `controllers.bumpless`).
    """

    def sampled(self, signal, period):
        update = super().sampled(signal, period)
        if not isinstance(self.observer, StringObserver) or self.observer.begins is None:
            return update
        torque = acting(signal)
        begun_state = self.observer.begun(signal("top.speed", "rad/s"), torque)
        starts = {}
        for memory in update.memory:
            if memory.label == "observer.state":
                starts[memory] = begun_state
            elif memory.label.startswith("waiting"):
                starts[memory] = torque
        return begun(update, signal, "observer", starts)
