"""A machine that Python steps from outside: inputs in, a step of time, signals out, as a test bench or a learning law does it.

The loop is that of `simulate`, compiled once; only its end moves. A step of time costs some microseconds beside the steps of the method.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import numpy as np

from toolbox.arguments import mapping, number, whole
from toolbox.compilation import work_layout as layout
from toolbox.compilation.program import Program
from toolbox.errors import SceneError, suggest
from toolbox.export.machine_c import Entry, Machine, machine, stopped, why
from toolbox.files.units import NumberOrText, in_si
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.laws import Sampled, names
from toolbox.simulation.carry_out import compiled_loop
from toolbox.simulation.request import Request
from toolbox.simulation.samples import Event, signal_reader
from toolbox.simulation.work_arrays import work_arrays
from toolbox.stepping.event_stepper import loop_of


@takes_loop
def stepper(
    loop: ClosedLoop,
    period: NumberOrText,
    *,
    inputs: str | Sequence[str] = (),
    outputs: str | Sequence[str] = (),
    duration: NumberOrText | None = None,
    accuracy: float | None = None,
) -> Stepper:
    """Return an object that simulates a plant with its controllers step by step, for use inside another program.

    Call its method `reset` once, and then its method `step` with new inputs once per period.

    Parameters
    ----------
    loop
        A loop, or a plant without controllers.
    period
        Time of one step [s].
    inputs
        Names of the inputs or parameters that `step` sets, in this order, by default none. Their values jump at the
        beginning of the step.
    outputs
        Names of the scalar signals that `reset` and `step` return, in this order, by default none.
    duration
        Time over which the accuracy is promised [s]. By default the duration of its scene, or a thousand periods. The
        machine can run on after it.
    accuracy
        Target for the global error, between 1e-13 and 0.1. By default the accuracy of its scene, else 1e-6.

    Returns
    -------
    Stepper
        The machine, at its start.

    Raises
    ------
    SceneError
        If an input or an output is unknown, the loop is stiff, or one of its controllers is written in Python. Step the
        machine with such a controller from your own program instead.
    SimulationError
        If the run over `duration`, which is carried out once, fails.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, stepper
    >>> machine = stepper(compose(BlockOnBelt()), "0.1 s", inputs="block.force", outputs="block.position")
    >>> position = machine.reset()
    >>> for _ in range(10):
    ...     position = machine.step([0.2])
    >>> print(f"{float(position[0]):.3f} m after 1 s")
    0.178 m after 1 s
    """
    step = number("period", period, "s", above=0)
    span = loop.duration or 1000.0 * step if duration is None else duration
    return Stepper(machine(loop, "machine", span, accuracy), step, names(inputs), names(outputs))


class Stepper:
    """A machine that is stepped from outside (`toolbox.export.stepper.stepper`).

    Attributes
    ----------
    period
        Time of one step [s].
    inputs, outputs
        Names of what `step` takes and returns.
    time
        The present time [s].
    events
        Switches of the last step, each with time, element, and mode before and after.
    """

    def __init__(self, made: Machine, period: float, inputs: Sequence[str], outputs: Sequence[str]):
        self._made, self._program = made, made.program
        self.period, self.inputs, self.outputs = period, tuple(inputs), tuple(outputs)
        self.events: list[Event] = []
        self._settable = [_entry(made.settable, name, "inputs") for name in self.inputs]
        self._wanted = [float(made.work["p"][entry.place]) for entry in made.settable]
        self._places = [made.settable.index(entry) for entry in self._settable]
        self._bounds = [(made.refusals.least[place], made.refusals.most[place]) for place in self._places]
        self._related = made.refusals.of(self._places)
        for name in self.outputs:
            if self._program.system.expression(name).numel() != 1:
                raise SceneError(f"Argument `outputs` must name scalar signals, but `{name}` has several entries.")
        work = work_arrays(made.run, made.program)
        self._work = work._replace(**{name: array.copy() for name, array in made.work.items() if name != "samplers"})
        self._work.ints[layout.BUDGET] = 2**62
        self._first = {name: array.copy() for name, array in self._work._asdict().items()}
        compiled_loop(made.run, made.program)  # says so where it has to be compiled first
        self._loop = loop_of(self._work).bound(self._work)
        self._values = np.empty(len(self.outputs))
        self._reader = signal_reader(made.program, self.outputs) if self.outputs else None
        self._addresses = [array.ctypes.data for array in (self._work.x, self._work.k, self._work.p, self._work.m, self._values)]
        self._steps, self._open = 0, True
        self.reset()

    @property
    def work(self) -> Any:
        """The arrays of the run, for who steps copies of it."""
        return self._work

    @property
    def program(self) -> Program:
        """The program of the run."""
        return self._program

    @property
    def system(self) -> Any:
        """The plant with its laws."""
        return self._program.system

    @property
    def places(self) -> list[int]:
        """Places of the inputs among the parameters of the run."""
        return [entry.place for entry in self._settable]

    @property
    def reader(self) -> Any:
        """Machine code that writes the outputs."""
        return self._reader

    @property
    def time(self) -> float:
        """The present time [s]."""
        return float(self._work.reals[layout.TIME])

    def reset(self, seed: int | None = None, start: Mapping[str, Any] | None = None) -> np.ndarray:
        """Go back to the start and return the outputs there.

        Parameters
        ----------
        seed
            Seed of the noise of all sampled laws from now on; None keeps it.
        start
            {state: value} in place of those of the loop; entries of vectors by their numbers, such as `chain.speed.1`.

        Returns
        -------
        numpy.ndarray
            The outputs at the start.
        """
        if seed is not None:
            loop = self._made.loop
            seeds = [dataclasses.replace(law, seed=whole("seed", seed, 0)) if isinstance(law, Sampled) else law for law in loop.controllers]
            run = Request(
                loop.with_controllers(seeds), self._made.run.duration, None, self._made.run.method, self._made.run.accuracy
            ).checked()
            seeded = work_arrays(run, self._program)
            self._first |= {"keys": seeded.keys, "clock_keys": seeded.clock_keys}
        for name, array in self._first.items():
            getattr(self._work, name)[...] = array
        for name, value in mapping("start", start).items():
            entry = _entry(self._made.states, name, "start")
            self._work.x[entry.place] = number(f"start.{name}", in_si(value, entry.unit, name), entry.unit)
        self._steps = 0
        return self._run(0.0)

    def step(self, values: Sequence[float] | np.ndarray | float = ()) -> np.ndarray:
        """Set the inputs, go on by one period, and return the outputs at its end.

        Parameters
        ----------
        values
            One number for each of `inputs`, in SI.

        Returns
        -------
        numpy.ndarray
            The outputs.

        Raises
        ------
        SceneError
            If the numbers are not as many as the inputs, or not finite, or out of their bounds, or the machine is closed.
        SimulationError
            If the machine cannot go on: switching without end, a negative load, steps that become too short.
        """
        if not self._open:
            raise SceneError("A machine that was closed cannot be stepped: make another one.")
        try:
            given = [float(value) for value in values] if np.iterable(values) else [float(values)]
        except (TypeError, ValueError):  # text, or no row
            given = []
            self._refuse(values, given)
        if len(given) != len(self._settable):
            self._refuse(values, given)
        inside = [low <= value <= high for value, (low, high) in zip(given, self._bounds, strict=True)]
        if not all(inside):
            self._refuse(values, given)
        if self._related is not None:
            for place, value in zip(self._places, given, strict=True):
                self._wanted[place] = value
            if not self._related.allow(self._wanted):
                self._refuse(values, given)
        work = self._work
        changed = [(entry.place, value) for entry, value in zip(self._settable, given, strict=True) if work.p[entry.place] != value]
        if changed:  # a jump in front of those of tables, in the place of the last one
            end = int(work.jump_first[work.ints[layout.JUMP]])
            work.ints[layout.JUMP] -= 1
            first = end - len(changed)
            work.jump_index[first:end], work.jump_value[first:end] = zip(*changed, strict=True)
            work.jump_first[work.ints[layout.JUMP]], work.jump_t[work.ints[layout.JUMP]] = first, work.reals[layout.TIME]
        self._steps += 1
        return self._run(self._steps * self.period)

    def close(self) -> None:
        """End the use of the machine."""
        self._open = False

    def _refuse(self, values: Any, given: Sequence[float]) -> NoReturn:
        """Raise SceneError for values that cannot be set."""
        if len(given) == len(self._settable) and all(map(math.isfinite, given)):
            for entry, value in zip(self._settable, given, strict=True):
                if (declared := self._made.number(entry)) is not None:
                    declared.check(value)
            raise SceneError(
                f"Argument `values` must be allowed beside the other numbers of the plant and its controllers, but it is {values!r}."
            )
        raise SceneError(
            f"Argument `values` must be {len(self.inputs)} finite number(s), for {', '.join(self.inputs) or 'no input'}, but it is {values!r}."
        )

    def _run(self, until: float) -> np.ndarray:
        work = self._work
        work.reals[layout.END] = until
        self.events = []
        status = layout.EVENTS_FULL
        while status == layout.EVENTS_FULL:
            work.ints[layout.EVENTS] = 0
            status = self._loop()
            if work.ints[layout.EVENTS]:
                self.events += self._switches()
        if status != layout.DONE:
            raise stopped(status)(f"The machine cannot be stepped on from t = {self.time:.9g} s: {why(status, work, self._program)}")
        if self._reader is not None:
            self._reader(work.reals[layout.TIME], 0.0, *self._addresses)
        return self._values.copy()

    def _switches(self) -> list[Event]:
        work, system = self._work, self._program.system
        told = [(i, element.name, element.mode_names) for i, element in enumerate(system.elements) if not element.second]
        told += [(place, name, legend) for name in system.shared_modes for place, legend in [system.element_modes(name)]]
        found = []
        for k in range(work.ints[layout.EVENTS]):
            before, after = (int(mode) for mode in work.ev_m[k, :2])
            found += [Event(float(work.ev_t[k]), name, legend[before], legend[after]) for i, name, legend in told if i == work.ev_i[k]]
        return found


def _entry(entries: Sequence[Entry], name: str, word: str) -> Entry:
    known = {each.name: each for each in entries}
    if name not in known:
        raise SceneError(f"Argument `{word}` must name numbers of the machine, but there is no `{name}`: {suggest(name, known)}")
    return known[name]
