"""The whole state of a run at one instant: what the plant and its laws remember, what laws hold, and what is on its way to the plant.

A run that begins with the state in which another one ended goes on as if it had never been cut, at the same absolute time: inputs, clocks, delays and the
noise of each sample are functions of that time and of the number of the sample, so that they follow by themselves. The pieces equal the whole run to the
accuracy of the steps, which are cut in other places.

A switch at the cut is listed once by the pieces together. The piece that ends there lists it if its steps reach the switch by their end. The modes in its last
state are then those behind the switch, and the next piece does not list it again. Otherwise the next piece lists it at its beginning. A jump of an input at
the cut, and a late output that arrives there, switch in the piece that ends; a sample due at the cut is taken by the next piece. A contact that numbers changed
between the pieces tear loose is listed by the next piece, too.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import FunctionType
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray, count_of, finite_array
from toolbox.errors import SceneError
from toolbox.modelling.clocks import Clock
from toolbox.modelling.closing import kind_of
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import fresh
from toolbox.modelling.numbers import is_remembered
from toolbox.modelling.remembering import offers_memory
from toolbox.modelling.start import place_starts

Layout = tuple[tuple[str, int, "int | None"], ...]
"""(name, first entry, number of entries) of every state of the plant, then of every state that a sampled law remembers, then of every signal that is held."""

ARRAYS = ("states", "memory", "held", "modes", "closures", "sizes")
"""What of a state is one array."""


@dataclass(frozen=True, eq=False)
class RunState:
    """Where a run is at one instant: `simulate(plant, duration, start=run.last, ...)` goes on from there, at the same absolute time.

    Attributes
    ----------
    time
        The instant [s].
    states
        States of the plant and of the laws that act continuously, shape (n,).
    memory
        States of the sampled laws, one law after the other, each followed by the noise of its last sample.
    held
        Signals that sampled laws hold.
    modes
        Mode of each element; None where the states decide. A run that goes on keeps them where its states and numbers are those that they belong to, and
        decides anew by states and forces where something was changed by hand.
    closures
        Closure of the gap of each rigid contact with which its mode was decided; None where there is none. A contact at rest is closed although its gap may be
        open or inside by round-off.
    sizes
        Largest guard of each element so far, in slip (or open) and in stick (or closed), shape (2, 2 elements): bounces end where they are low beside the gaps
        that there were, in a run that goes on, too. None where the run begins.
    taken, applied
        Number of samples that each sampled law has taken, and of those whose outputs the plant has got.
    waiting
        Outputs of each sampled law that are on their way, shape (samples, outputs), the oldest first.
    controllers
        What each Python law remembers: an array where it offers `get_memory`, a copy of the law where it is another object, None for a function.
    carried
        Whether an earlier run led here; else laws begin as they do at the start of a run.
    layout
        What the entries of `states`, `memory` and `held` are, by name.
    clocks
        Clock of each sampled law.
    """

    time: float
    states: FloatArray
    memory: FloatArray
    held: FloatArray
    modes: np.ndarray | None = None
    closures: FloatArray | None = None
    sizes: FloatArray | None = None
    taken: tuple[int, ...] = ()
    applied: tuple[int, ...] = ()
    waiting: tuple[FloatArray, ...] = ()
    controllers: tuple[Any, ...] = ()
    carried: bool = False
    layout: Layout = field(default=(), repr=False)
    clocks: tuple[Clock, ...] = field(default=(), repr=False)

    @staticmethod
    def begun(system: HybridSystem, plant: HybridSystem, clocks: Sequence[Clock], start: Mapping[str, Any] | None = None) -> RunState:
        """Return the state in which a run begins: at rest, with the memory of laws at zero, but for the values that are given.

        A signal that a late law drives has its default, or the value given, until the first output arrives; what other laws hold follows from their first
        sample at once, which reads the value given.

        Parameters
        ----------
        system, plant
            The closed system, and the plant in it.
        clocks
            Clock of each sampled law.
        start
            {state of the plant, state that a sampled law remembers, or signal that one holds: value}.

        Raises
        ------
        SceneError
            If a name is unknown, or a value does not fit.
        """
        given = start or {}
        held = {name for update in system.updates for name in update.names}
        known = {name for name in given if is_remembered(system, name) or name in held}
        states = system.begin.copy()
        place_starts(system, states, {name: value for name, value in given.items() if name not in known})
        memory = np.zeros(sum(update.memory.numel() + len(update.channels) for update in system.updates))
        few = len(system.updates)
        state = RunState(
            time=0.0, states=states, memory=memory, held=held_defaults(system, plant, clocks, plant.values), taken=(0,) * few, applied=(0,) * few,
            waiting=tuple(np.empty((0, update.outputs.numel())) for update in system.updates), layout=layout_of(system), clocks=tuple(clocks),
        )  # fmt: skip
        return state.with_values({name: given[name] for name in known})

    def with_values(self, given: Mapping[str, Any]) -> RunState:
        """Return the state with other values of named entries: states, memory of sampled laws, held signals, or an entry of a vector of
        these.

        Raises SceneError for a value of another size. Names that the state does not have are left out.
        """
        values = self.values
        for name, first, size in self.layout:
            if name in given:
                array = finite_array(given[name])
                if array is None or (array.ndim and array.shape != (count_of(size),)):
                    raise SceneError(f"Argument `{name}` must be {count_of(size)} finite number(s), but it is {given[name]!r}.")
                values[first : first + count_of(size)] = array
        for name, first, size in self.layout:  # an entry that is named beside its vector wins
            for i in range(size or 0):
                values[first + i] = given.get(f"{name}.{i}", values[first + i])
        return self.at_values(values)

    @property
    def values(self) -> FloatArray:
        """States, memory and held signals, one behind the other, as `layout` names them."""
        return np.concatenate([self.states, self.memory, self.held])

    def at_values(self, values: FloatArray) -> RunState:
        """Return the state with other `values`."""
        first, last = self.states.size, self.states.size + self.memory.size
        return replace(self, states=values[:first].copy(), memory=values[first:last].copy(), held=values[last:].copy())

    def __getitem__(self, name: str) -> Any:
        """The value of a state, of what a sampled law remembers, or of a signal held: a float, or an array of a vector. Raises KeyError for another name."""
        for each, first, size in self.layout:
            if each == name:
                return float(self.values[first]) if size is None else self.values[first : first + size]
        raise KeyError(name)

    def told(self) -> dict[str, Any] | None:
        """Return the state as numbers and lists, for a text file; None if a Python law does not give its memory. See `as_told`."""
        if not all(law is None or isinstance(law, np.ndarray) for law in self.controllers):
            return None
        arrays = {name: None if (value := getattr(self, name)) is None else value.tolist() for name in ARRAYS}
        rows = {name: [None if each is None else each.tolist() for each in getattr(self, name)] for name in ("waiting", "controllers")}
        return {"time": self.time, "taken": self.taken, "applied": self.applied, "carried": self.carried, **arrays, **rows}

    def as_told(self, told: Mapping[str, Any]) -> RunState:
        """Return the state of a run of the same loop that `told` gave."""
        arrays: dict[str, Any] = {
            name: None if told.get(name) is None else np.array(told[name], int if name == "modes" else float) for name in ARRAYS
        }
        waiting = tuple(np.array(rows, float).reshape(-1, own.shape[1]) for rows, own in zip(told["waiting"], self.waiting, strict=True))
        laws = tuple(None if each is None else np.array(each, float) for each in told["controllers"])
        taken, applied = (tuple(told[name]) for name in ("taken", "applied"))
        return replace(
            self, time=told["time"], carried=told["carried"], taken=taken, applied=applied, waiting=waiting, controllers=laws, **arrays
        )

    def on_clocks(self, clocks: Sequence[Clock]) -> RunState:
        """Return the state for a run with these sample times and delays: itself, if it has them.

        Controllers keep what they remember and hold, and outputs that are on their way stay so. With other sample times the next samples come when they would
        have come, and the time is set to fit; where no time fits all controllers, samples are counted from t = 0 on.
        """
        if tuple(clocks) == self.clocks:
            return self
        periods = [clock.period for clock in clocks]
        if periods == [clock.period for clock in self.clocks]:
            return replace(self, clocks=tuple(clocks))
        until = [taken * clock.period - self.time for taken, clock in zip(self.taken, self.clocks, strict=True)]
        more = max(0, *(math.ceil(wait / period) - taken for wait, taken, period in zip(until, self.taken, periods, strict=True)))
        taken, applied = (tuple(count + more for count in counts) for counts in (self.taken, self.applied))
        times = [count * period - wait for count, wait, period in zip(taken, until, periods, strict=True)]
        if max(times) - min(times) <= 1e-9 * min(periods):
            return replace(self, time=times[0], taken=taken, applied=applied, clocks=tuple(clocks))
        few = len(clocks)
        return replace(
            self, time=0.0, taken=(0,) * few, applied=(0,) * few, waiting=tuple(rows[:0] for rows in self.waiting), clocks=tuple(clocks)
        )

    def check(self, system: HybridSystem, clocks: Sequence[Clock], laws: Sequence[Any]) -> None:
        """Raise SceneError unless a run of this system, with laws of these clocks, can go on from here."""
        if layout_of(system) != self.layout:
            here, there = ({name for name, _, _ in layout} for layout in (self.layout, layout_of(system)))
            names = ", ".join(f"`{name}`" for name in sorted(here ^ there)) or "states of another size"
            raise SceneError(
                f"Argument `start` must be the state of a run of the same plant and laws, but they differ by {names}: to begin anew, give the "
                "states by name, `{name: state[name] for name in plant.states}`."
            )
        now, then = ([(clock.period, clock.delay) for clock in own] for own in (clocks, self.clocks))
        if now != then:
            raise SceneError(
                f"Argument `start` must be the state of a run with the same sample times and delays, but these are {then} s there and {now} s here."
            )
        for kept, law in zip(self.controllers, laws, strict=True):
            fits = isinstance(law, FunctionType) if kept is None else offers_memory(law) or type(kept) is type(law)
            if not fits:
                raise SceneError(
                    f"Argument `start` must be the state of a run with the same Python law, but `{kind_of(law)}` is another one."
                )

    def continued(self, laws: Sequence[Any]) -> list[Any]:
        """Return the Python laws of a run that begins here, with their memory. Each run has its own copies."""
        if not self.controllers:
            return [fresh(law) for law in laws]
        found = []
        for kept, law in zip(self.controllers, laws, strict=True):
            found.append(fresh(law if kept is None or isinstance(kept, np.ndarray) else kept))
            if isinstance(kept, np.ndarray):
                found[-1].set_memory(kept.copy())
        return found

    def remembering(self, laws: Sequence[Any]) -> RunState:
        """Return the state with the present memory of Python laws. SceneError is raised for an object that neither gives its memory nor can
        be copied."""
        kept: list[Any] = []
        for law in laws:
            if isinstance(law, FunctionType):
                kept.append(None)
            elif offers_memory(law):
                kept.append(np.array(law.get_memory(), float))
            else:
                try:
                    kept.append(copy.deepcopy(law))
                except Exception as error:  # whatever an object that holds a lock or a solver raises
                    raise SceneError(
                        f"The law `{kind_of(law)}` must offer `get_memory` and `set_memory`, or be copied, for a run to go on from its end, but "
                        f"`copy.deepcopy` fails: {error}"
                    ) from None
        return replace(self, controllers=tuple(kept))


def layout_of(system: HybridSystem) -> Layout:
    """What the entries of the states and of the memory of a closed system are."""
    found = [(name, first, size) for name, (first, size, _) in system.states.items()]
    place = system.x.numel()
    for update in system.updates:
        found += [(name, place + first, size) for name, (first, size) in update.places.items()]
        place += update.memory.numel() + len(update.channels)
    found += [(name, place + i, None) for update in system.updates for i, name in enumerate(update.names, update.first_held)]
    return tuple(found)


def held_defaults(system: HybridSystem, plant: HybridSystem, clocks: Sequence[Clock], values: np.ndarray) -> np.ndarray:
    """The signals that sampled laws hold before their first output, for parameters of the plant (one set, or one per column): (held,) or (sets, held).

    A signal that a late law drives has the default that it has without the law; every other is 0, and is set by the first sample.
    """
    held = np.zeros((*values.shape[1:], system.held.numel()))
    if any(clock.delay > 0.0 for clock in clocks):
        known = np.array(plant.input_defaults(values)).reshape(len(plant.inputs), *values.shape[1:])
        defaults = dict(zip(plant.inputs, known, strict=True))
        for update, clock in zip(system.updates, clocks, strict=True):
            for place, name in enumerate(update.names, update.first_held):
                if clock.delay > 0.0 and name in defaults:
                    held[..., place] = defaults[name]
    return held
