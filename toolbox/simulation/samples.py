"""What a run holds: signals at times, events, and the modes in which its elements stay."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any, Generic, NamedTuple, TypeVar

import casadi as ca
import numpy as np

from toolbox.arguments import FloatArray, number, short
from toolbox.compilation.bodies import plain_body
from toolbox.compilation.emitter import compiled, function_text
from toolbox.errors import SceneError, suggest
from toolbox.files.units import NumberOrText
from toolbox.modelling.input_kinds import ExpressionKey


class Event(NamedTuple):
    """A switch of an element: time [s], name of the element, and its mode before and after.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> event = simulate(compose(BlockOnBelt()), "60 s").events[0]
    >>> print(f"{event.time:.3f} s: {event.element} from {event.before} to {event.after}")
    0.262 s: belt from slip- to stick
    """

    time: float
    element: str
    before: str
    after: str


class Stays:
    """How long elements of a run stay in their modes, by its events."""

    begin: float
    end: float
    events: list[Event]

    @property
    def _legends(self) -> dict[str, dict[int, str]]:
        """{element: {mode: its word}}."""
        raise NotImplementedError

    def _at_last(self, element: str) -> str:
        """Mode of an element at the end of the run."""
        raise NotImplementedError

    def _no_element(self, name: str) -> SceneError:
        """The error of a name that is no element of the run."""
        return SceneError(f"There is no element `{name}`: {suggest(name, self._legends)}")

    def _events_of(self, element: str) -> list[Event]:
        """The switches of one element."""
        return [event for event in self.events if event.element == element]

    def intervals(self, element: str) -> list[tuple[float, float, str]]:
        """(begin, end, mode) of one element over the whole run, from the located events; raises SceneError for an unknown element."""
        if element not in self._legends:
            raise self._no_element(element)
        own = self._events_of(element)
        end = self.end
        mode = own[0].before if own else self._at_last(element)
        out, begin = [], self.begin
        for event in own:
            out.append((begin, event.time, mode))
            begin, mode = event.time, event.after
        out.append((begin, end, mode))
        return [piece for piece in out if piece[1] > piece[0]]

    def time_in(self, element: str, mode: str, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> float:
        """Seconds that an element spends in a mode between `after` and `until` (the end of the run). Raises SceneError for an `after` beyond the end."""
        stays = self._stays_in(element, mode)
        after = number("after", after, "s", at_most=self.end)  # no stick in no time would read as cured
        last = self.end if until is None else number("until", until, "s")
        return float(sum(max(0.0, min(end, last) - max(begin, after)) for begin, end in stays))

    def _stays_in(self, element: str, mode: str) -> list[tuple[float, float]]:
        """(begin, end) [s] of the stays of an element in a mode; raises SceneError for an unknown element or mode."""
        intervals = self.intervals(element)
        known = self._legends[element].values()
        if mode not in known:
            raise SceneError(f"There is no mode `{mode}` of `{element}`: {suggest(mode, known)}")
        return [(begin, end) for begin, end, word in intervals if word == mode]


Read = TypeVar("Read", covariant=True)
"""What a signal reads as: an array over times, or the float, or the array of a vector, of one time."""


class Modes(dict[str, Any]):
    """Modes by element. An unknown element raises the error of `unknown`, or an error that suggests the nearest name."""

    unknown: Callable[[str], SceneError] | None = None

    def __missing__(self, name: str) -> Any:
        raise self.unknown(name) if self.unknown else SceneError(f"There is no element `{name}`: {suggest(name, self)}")


class Samples(Generic[Read]):
    """Signals of a closed system at given times: `samples["bit.speed"]`, an array of shape (nt,), or (nt, n) for a vector state.

    Taken at a single time, entries are floats (or shape (n,)).
    """

    def __init__(
        self, program: Any, time: FloatArray, states: FloatArray, mode: np.ndarray, held: np.ndarray, parameters: np.ndarray, single: bool
    ):
        self.program = program
        self.time = time
        self.states = states
        self.mode = mode
        self.held = held
        self._constants = parameters[: program.first_held]
        self._single = single

    @property
    def names(self) -> list[str]:
        """Names of all signals: of the plant, of its inputs and of its elements."""
        system = self.program.system
        return [*system.signals, *system.inputs]

    def __contains__(self, name: object) -> bool:
        return self.program.system.has_signal(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def unit(self, name: str) -> str:
        """Unit of a signal; raises SceneError for an unknown name."""
        return self.program.system.signal_unit(name)

    @cached_property
    def modes(self) -> dict[str, np.ndarray]:
        """Mode of each element at `time`, as strings: "stick", "slip+", "slip-"; raises SceneError for an unknown element."""
        words = {}
        for name in self._elements:
            i, legend = self.program.system.element_modes(name)
            numbers, place = np.unique(self.mode[:, i], return_inverse=True)
            words[name] = np.array([legend[int(number)] for number in numbers], dtype=np.str_)[place]
        modes = Modes(words)
        modes.unknown = self.program.system.unknown_element_error
        return modes

    @property
    def _elements(self) -> list[str]:
        return [element.name for element in self.program.system.elements]

    def __getitem__(self, name: str) -> Read:
        rows = self.program.system.state_index(name)
        if rows is None:
            values = self.computed(name)
        else:
            first, size, _ = rows
            values = self.states[:, first] if size is None else self.states[:, first : first + size]
        if self._single:
            return float(values[0]) if values.ndim == 1 else values[0]  # type: ignore[return-value]
        return values  # type: ignore[return-value]

    def columns(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """{signal: its values at all times}, computed together: many signals cost little more than one. Raises SceneError for an unknown name."""
        system = self.program.system
        wanted = tuple(name for name in names if system.state_index(name) is None)
        expressions = [system.expression(name) for name in wanted]
        together = _function(self.program, wanted, ca.vertcat(*expressions)).over(self)
        found, end = {}, 0
        for name, expression in zip(wanted, expressions, strict=True):
            first, end = end, end + expression.numel()
            found[name] = together[:, first] if end - first == 1 else together[:, first:end]
        return {name: found[name] if name in found else np.asarray(self[name]) for name in names}

    def computed(self, wanted: str | ca.SX) -> np.ndarray:
        """Values of a signal by name, or of an expression in the plant's symbols, at all times."""
        signal = _signal(self.program, wanted)
        if not self.time.size:
            return np.empty(0)
        values = signal.over(self)
        return values[:, 0] if values.shape[1] == 1 else values


BLOCKS = (1024, 64, 8, 1)
"""Times at which a function is evaluated in one call: as many as there are, then what is left of them."""


class SignalFunction:
    """A casadi function (t, x, constants, held, m) of a program, evaluated at many times at once. Threads may ask side by side: each has its own memory."""

    def __init__(self, function: ca.Function):
        self.function = function
        self._own = threading.local()

    def _buffer(self, size: int) -> tuple[Any, Callable[[], None]]:
        """The buffer of the function at so many times at once, and what evaluates it; each made once."""
        kept = self._own.__dict__
        if str(size) not in kept:
            repeated: Any = self.function.map(size) if size > 1 else self.function
            kept[str(size)] = repeated.buffer()
        return kept[str(size)]

    def over(self, samples: Samples[Any]) -> np.ndarray:
        """Return the values (nt, rows) at all times. Casadi reads and writes the arrays directly, because casadi itself copies one number
        after another."""
        given = (samples.time, samples.states, samples.held, samples.mode)
        time, states, held, mode = (np.ascontiguousarray(array, float) for array in given)
        found = np.empty((time.size, self.function.numel_out(0)))
        first = 0
        for size in BLOCKS:
            if time.size - first < size:
                continue
            constants = np.tile(samples._constants, (size, 1))
            buffer, evaluate = self._buffer(size)
            while time.size - first >= size:
                piece = slice(first, first + size)
                for i, array in enumerate((time[piece], states[piece], constants, held[piece], mode[piece])):
                    if array.size:  # a piece of an array without columns points beyond it, into foreign memory
                        buffer.set_arg(i, array.data)
                if found.size:
                    buffer.set_res(0, found[piece].data)
                evaluate()
                first += size
        return found


def output_function(program: Any, wanted: str | ca.SX) -> ca.Function:
    """casadi Function (t, x, constants, held, m) -> signal or expression of a program; raises SceneError for an unknown name."""
    return _signal(program, wanted).function


def _signal(program: Any, wanted: str | ca.SX) -> SignalFunction:
    if isinstance(wanted, ca.SX):
        return _function(program, ExpressionKey(wanted), wanted)
    return _function(program, wanted, program.system.expression(wanted))


def _function(program: Any, key: str | tuple[str, ...] | ExpressionKey, expression: ca.SX) -> SignalFunction:
    system = program.system
    if key not in program.signals:
        p, first = program.expressions[0], program.first_held
        expression = program.closed(ca.densify(ca.SX(expression)))
        function = ca.Function("signal", [system.t, system.x, p[:first], p[first:], system.m], [expression])
        program.signals[key] = SignalFunction(function)
    return program.signals[key]


def read_signals(program: Any, names: tuple[str, ...], t: float, work: Any) -> np.ndarray:
    """Scalar signals of a run under way, by machine code: a law in Python asks for them at every sample."""
    values = np.empty(len(names))
    signal_reader(program, names)(t, 0.0, *(array.ctypes.data for array in (work.x, work.k, work.p, work.m, values)))
    return values


def signal_reader(program: Any, names: tuple[str, ...]) -> Any:
    """Machine code (t, 0, x, k, p, m, values), the last five as addresses, that writes scalar signals."""
    key = f"reader of {names}"
    reader = program.outputs.get(key)
    if reader is None:
        system = program.system
        expressions = program.closed(ca.vertcat(*map(system.expression, names)))
        body = plain_body(ca.Function("signals", [system.t, system.x, program.expressions[0], system.m], [ca.densify(expressions)]), 0)
        made = compiled("\n".join([function_text("signals", body), *sorted(body.declarations)]), ["signals"], body.count)
        kind = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_double, *[ctypes.c_void_p] * 5)
        reader = program.outputs[key] = kind(made["signals"])
    return reader


# ------------------------------------------------------------------------------------------------------------------- sampling inside the steps
def window(run: Any, after: NumberOrText, until: NumberOrText | None) -> tuple[float, float]:
    """Check a time window of a run, and return its begin and end.

    A run that failed ends at its last recorded time.

    Parameters
    ----------
    run
        The run.
    after, until
        Begin and end of the window [s]. If `after` lies before the run, the window begins with the run. None for
        `until` means the end of the run.

    Returns
    -------
    float, float
        Begin and end [s].

    Raises
    ------
    SceneError
        If the window is empty or outside the run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> from toolbox.authoring import window
    >>> print(window(simulate(compose(BlockOnBelt()), "60 s"), "20 s", None))
    (20.0, 60.0)
    """
    check_run(run)
    last = float(run.every_step.time[-1])
    if last <= run.begin:
        raise SceneError("Argument `run` must last longer than 0 s to be measured, but it ends where it begins.")
    begin = max(float(number("after", after, "s", at_least=0, below=last)), run.begin)
    return begin, last if until is None else float(number("until", until, "s", above=begin, at_most=last))


def check_run(run: Any) -> None:
    """Raise SceneError for anything but a trajectory."""
    if not isinstance(run, Stays):
        raise SceneError(f"Argument `run` must be a trajectory, as `simulate` returns it, but it is {short(run)}.")


def scalar(samples: Samples[Any], signal: str) -> np.ndarray:
    """Values of a signal, shape (nt,); raises SceneError for an unknown name or a vector."""
    values = np.asarray(samples[signal])
    if values.ndim != 1:
        raise SceneError(f"Argument `signal` must be a scalar, but `{signal}` has {values.shape[1]} entries: name one, e.g. `{signal}.0`.")
    return values
