"""Many copies of a machine as one vector environment of gymnasium: one call steps them all, without Python between them but for the call of the loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import whole
from toolbox.compilation import work_layout as layout
from toolbox.compilation.work_layout import Work
from toolbox.export.environment import Environment, Ranges, environment, gymnasium
from toolbox.export.machine_c import stopped, why
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.stepping.event_stepper import loop_of


@takes_loop
def vector_environment(
    loop: ClosedLoop,
    count: int,
    period: NumberOrText,
    duration: NumberOrText,
    *,
    actions: Ranges | Sequence[str],
    observations: Ranges,
    reward: Callable[[dict[str, np.ndarray], np.ndarray], np.ndarray],
    start: Callable[[np.random.Generator], Mapping[str, Any]] | None = None,
    accuracy: float | None = None,
) -> VectorEnvironment:
    """Return many copies of a machine as a vector environment of gymnasium.

    Parameters
    ----------
    loop
        A loop, or a plant without laws.
    count
        Number of copies.
    period, duration, actions, observations, start, accuracy
        As in `environment`.
    reward
        Function of {signal: array, shape (count,)} at the end of a step, actions included, and of the number of switches in it, shape (count,), that
        returns the rewards, shape (count,).

    Returns
    -------
    VectorEnvironment
        A `gymnasium.vector.VectorEnv`. A copy whose time is over begins anew in the next step, in which its action does nothing.

    Raises
    ------
    SceneError
        As `environment`, and if `count` is none.
    """
    single = environment(
        loop,
        period,
        duration,
        actions=actions,
        observations=observations,
        reward=lambda signals, events: 0.0,
        start=start,
        accuracy=accuracy,
    )
    return VectorEnvironment(single, whole("count", count, 1), reward)


class VectorEnvironment(gymnasium.vector.VectorEnv):
    """Copies of a machine as a vector environment (`toolbox.export.vector_environment.vector_environment`)."""

    metadata: dict[str, Any] = {"autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}  # noqa: RUF012 (as gymnasium declares it)

    def __init__(self, single: Environment, count: int, reward: Callable[..., np.ndarray]):
        self.num_envs, self._single, self._reward = count, single, reward
        self.single_action_space, self.single_observation_space = single.action_space, single.observation_space
        self.action_space = gymnasium.vector.utils.batch_space(single.action_space, count)
        self.observation_space = gymnasium.vector.utils.batch_space(single.observation_space, count)
        first, self._machine = single.machine.work, single.machine
        self._stacks = Work(*(np.repeat(array[None], count, 0) for array in first))
        self._rows = [Work(*(stack[i] for stack in self._stacks)) for i in range(count)]
        compiled = loop_of(first)
        self._runs = [compiled.bound(row) for row in self._rows]
        self._values = np.zeros((count, len(self._machine.outputs)))
        system = self._machine.system
        same = [[i for i in range(system.x.numel()) if ca.is_equal(system.expression(name), system.x[i])] for name in self._machine.outputs]
        self._known = [row[0] for row in same] if all(same) else None  # outputs that are states need no machine code
        self._given = [[row.x, row.k, row.p, row.m, values] for row, values in zip(self._rows, self._values, strict=True)]
        self._addresses = [[array.ctypes.data for array in arrays] for arrays in self._given]
        self._steps, self._over = np.zeros(count, np.int64), np.zeros(count, bool)
        self._draws = [gymnasium.utils.seeding.np_random(None)[0] for _ in range(count)]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode in every copy; seed: of each copy, or of the first one, from which the others count on. Returns (observations, {})."""
        seeds = [None if seed is None else seed + i for i in range(self.num_envs)] if seed is None or isinstance(seed, int) else list(seed)
        for i, each in enumerate(seeds):
            if each is not None:
                self._draws[i] = gymnasium.utils.seeding.np_random(each)[0]
            self._begin(i, each is not None)
        self._over[:] = False
        return self._values.copy(), {}

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Go on by one period in every copy. Returns (observations, rewards, terminated, truncated, {"time", "switches"}). Raises SimulationError."""
        space: Any = self.action_space
        given = np.clip(np.asarray(actions, float).reshape(space.shape), space.low, space.high)
        begun = self._over.copy()
        for i in np.flatnonzero(begun):
            self._begin(int(i), False)
        self._jump(np.flatnonzero(~begun), given)
        self._steps[~begun] += 1
        switches = self._go_on()
        self._read()
        signals = dict(zip(self._machine.outputs, self._values.T, strict=True)) | dict(zip(self._machine.inputs, given.T, strict=True))
        rewards = np.where(begun, 0.0, self._reward(signals, switches))
        times = self._stacks.reals[:, layout.TIME].copy()
        self._over = times >= self._single.duration - 1e-9 * self._machine.period
        about = {"time": times, "switches": switches}
        return self._values.copy(), rewards, np.zeros(self.num_envs, bool), self._over.copy(), about

    def close_extras(self, **_: Any) -> None:
        """End the use of the machine."""
        self._machine.close()

    def _begin(self, i: int, seeded: bool) -> None:
        """A new episode of one copy, as `Environment.reset` begins it."""
        self._values[i] = self._single.begin(self._draws[i], seeded)
        for array, stack in zip(self._machine.work, self._stacks, strict=True):
            stack[i] = array
        self._steps[i] = 0

    def _jump(self, rows: np.ndarray, given: np.ndarray) -> None:
        """Inputs that change become a jump now, in front of those of tables."""
        w, places = self._stacks, self._machine.places
        rows = rows[(w.p[rows][:, places] != given[rows]).any(1)]
        if not rows.size or not places:
            return
        end = w.jump_first[rows, w.ints[rows, layout.JUMP]]
        w.ints[rows, layout.JUMP] -= 1
        entry = w.ints[rows, layout.JUMP]
        for j, place in enumerate(places):
            w.jump_index[rows, end - len(places) + j] = place
            w.jump_value[rows, end - len(places) + j] = given[rows, j]
        w.jump_first[rows, entry], w.jump_t[rows, entry] = end - len(places), w.reals[rows, layout.TIME]

    def _go_on(self) -> np.ndarray:
        """Run every copy to the end of its step; returns its switches."""
        w = self._stacks
        w.reals[:, layout.END] = self._steps * self._machine.period
        w.ints[:, layout.EVENTS] = 0
        statuses = [run() for run in self._runs]
        switches = w.ints[:, layout.EVENTS].copy()
        for i, status in enumerate(statuses):
            while status == layout.EVENTS_FULL:
                w.ints[i, layout.EVENTS] = 0
                status = self._runs[i]()
                switches[i] += w.ints[i, layout.EVENTS]
            if status != layout.DONE:
                words = why(status, self._rows[i], self._machine.program)
                raise stopped(status)(f"Copy {i} cannot be stepped on from t = {w.reals[i, layout.TIME]:.9g} s: {words}")
        return switches

    def _read(self) -> None:
        if self._known is not None:
            self._values[:] = self._stacks.x[:, self._known]
        else:
            times = self._stacks.reals[:, layout.TIME].tolist()
            for time, addresses in zip(times, self._addresses, strict=True):
                self._machine.reader(time, 0.0, *addresses)
