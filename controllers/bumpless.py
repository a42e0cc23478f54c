"""Bumpless start of sampled laws: a law that takes over from another drive begins with the torque that acts.

At its first sample a law reads the torque that is held at the top (`top.torque`, given by the drive before it, see `toolbox.modelling.Takeover`) and sets its
integrals, filters and observers to what gives the same torque under the present measurement. Where no torque acts, nothing is taken over, and the memory
keeps its start values: a rig at rest is started as before.

Source: bumpless transfer and tracking, K. J. Åström, T. Hägglund, Advanced PID Control, ISA 2006, section 3.6.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from toolbox import Update, state


def begun(update: Update, signal: Any, name: str, starts: Mapping[Any, Any]) -> Update:
    """Return the update of a law with a bumpless start. If a torque acts at the first sample, the memory begins at `starts`.

    update: that of the law.  signal: what gives its measurements.  name: of the law in its memory; `<name>.started` [1] is 1 once the first sample is over.
    starts: {state of the memory: start value}, an expression of measurements and of `acting(signal)`. A memory `<...>.last_torque` of a rate
    limit begins at the torque that acts.
    """
    started, torque = state(f"{name}.started", "1"), acting(signal)
    first = (started < 0.5) * (torque != 0.0)
    every = {memory: torque for memory in update.memory if memory.label.endswith(".last_torque")} | dict(starts)
    old = [ca.SX(memory) for memory in every]
    new = [ca.if_else(first, value, memory) for memory, value in zip(old, every.values(), strict=True)]
    values = [ca.SX(value) for value in update.memory.values()] + [ca.SX(value) for value, _ in update.outputs.values()]
    values = ca.substitute(values, old, new) if old else values
    count = len(update.memory)
    memory = dict(zip(update.memory, values[:count], strict=True)) | {started: ca.SX(1)}
    outputs = {key: (value, unit) for (key, (_, unit)), value in zip(update.outputs.items(), values[count:], strict=True)}
    return Update(memory, outputs)


def acting(signal: Any) -> Any:
    """The torque [N m] that is held at the top when a law samples."""
    return signal("top.torque", "N m")


def over(value: Any, gain: Any) -> Any:
    """Return value / gain, or 0 if the gain is 0. An integral with this value gives `value` after the gain."""
    return ca.if_else(gain == 0.0, 0.0, value / (gain + (gain == 0.0)))
