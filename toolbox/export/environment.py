"""A machine as an environment of gymnasium, for laws that learn: actions are inputs, observations are signals, the reward is the user's."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.arguments import checked_range, number
from toolbox.errors import SceneError
from toolbox.export.stepper import stepper
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.simulation.samples import Event

try:
    import gymnasium
except ImportError:
    raise ImportError("An environment needs gymnasium: pip install -e '.[learning]' in the folder of the toolbox") from None

Ranges = Mapping[str, tuple[NumberOrText, NumberOrText]]


@takes_loop
def environment(
    loop: ClosedLoop,
    period: NumberOrText,
    duration: NumberOrText,
    *,
    actions: Ranges | Sequence[str],
    observations: Ranges,
    reward: Callable[[dict[str, float], Sequence[Event]], float],
    terminated: Callable[[dict[str, float]], bool] | None = None,
    start: Callable[[np.random.Generator], Mapping[str, Any]] | None = None,
    accuracy: float | None = None,
) -> Environment:
    """Return a machine as an environment of gymnasium.

    Parameters
    ----------
    loop
        A loop, or a plant without laws.
    period
        Time of one step [s].
    duration
        Time after which an episode is truncated [s].
    actions
        {input or parameter: (low, high)}; names alone take the range in which every sound value lies.
    observations
        {scalar signal: (low, high)}, the range of the space; the signal itself is not cut off.
    reward
        Function of {signal: value} at the end of a step, actions included, and of the switches in it, that returns the reward.
    terminated
        Function of {signal: value} that says whether an episode has ended; by default none ends before its time.
    start
        Function of a random number generator that returns {state: value} of an episode; by default that of the loop.
    accuracy
        As in `simulate`.

    Returns
    -------
    Environment
        A `gymnasium.Env` with spaces of `float64`; `reset(seed=...)` seeds the noise of sampled laws, too.

    Raises
    ------
    SceneError
        As `stepper`, and if a range is none, or an input has no range of its own.
    """
    spans: dict[str, tuple[float, float]] = {}
    for name in actions:
        entry = loop.number(name)
        given = actions[name] if isinstance(actions, Mapping) else entry.usual
        if given is None:
            raise SceneError(f"Argument `actions` must give the range of `{name}`, which declares none: {{{name!r}: (low, high)}}.")
        spans[name] = entry.between(given, f"actions.{name}")
    seen = {name: checked_range(given, f"observations.{name}", loop.system.signal_unit(name)) for name, given in observations.items()}
    made = stepper(loop, period, inputs=tuple(spans), outputs=tuple(seen), duration=duration, accuracy=accuracy)
    return Environment(made, number("duration", duration, "s", above=0), spans, seen, reward, terminated, start)


class Environment(gymnasium.Env):
    """A machine as an environment (`toolbox.export.environment.environment`); `machine` is its stepper."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 (as gymnasium declares it)

    def __init__(
        self,
        machine: Any,
        duration: float,
        actions: Mapping[str, tuple[float, float]],
        observations: Mapping[str, tuple[float, float]],
        reward: Callable[..., float],
        terminated: Callable[..., bool] | None,
        start: Callable[..., Mapping[str, Any]] | None,
    ):
        self.machine, self.duration = machine, duration
        self._reward, self._terminated, self._start = reward, terminated, start
        self.action_space, self.observation_space = _box(actions), _box(observations)
        self._spans, self._names = list(actions.values()), (*machine.outputs, *machine.inputs)
        self._late = duration - 1e-9 * machine.period

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; options: {"start": {state: value}} in place of the drawn one. Returns (observation, {})."""
        super().reset(seed=seed)
        return self.begin(self.np_random, seed is not None, (options or {}).get("start")), {}

    def begin(self, draw: np.random.Generator, seeded: bool, start: Mapping[str, Any] | None = None) -> np.ndarray:
        """Begin an episode and return the outputs. The start is drawn by default, and the noise of laws gets a drawn seed if a seed was
        given."""
        start = start or (self._start(draw) if self._start else None)
        return self.machine.reset(int(draw.integers(2**31)) if seeded else None, start)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Go on by one period; actions beyond their ranges are cut off. Returns (observation, reward, terminated, truncated, {"time", "events"})."""
        machine = self.machine
        given = np.asarray(action, float).ravel().tolist()
        if len(given) == len(self._spans):  # the machine refuses others
            given = [min(max(value, low), high) for value, (low, high) in zip(given, self._spans, strict=True)]
        seen = machine.step(given)
        signals = dict(zip(self._names, seen.tolist() + given, strict=True))
        ended = bool(self._terminated(signals)) if self._terminated else False
        time, events = machine.time, machine.events
        return seen, float(self._reward(signals, events)), ended, time >= self._late, {"time": time, "events": events}

    def close(self) -> None:
        """End the use of the machine."""
        self.machine.close()


def _box(spans: Mapping[str, tuple[float, float]]) -> Any:
    low, high = (np.array([span[side] for span in spans.values()]) for side in (0, 1))
    return gymnasium.spaces.Box(low, high, dtype=np.float64)
