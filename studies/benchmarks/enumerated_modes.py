"""A reference for machines that rub and switch which shares no code with the event loop.

Between events scipy's DOP853 integrates the machine of `studies.benchmarks.rubbing_machines` in plain numbers, one explicit set of modes at a time. Events are
found on the dense output, on a fine grid and in every dip of it, and made sharp by integrating to them again. At every event all sets of modes of the contacts
at zero slip are written down, and those that agree with the forces are kept: where two do, and the contacts hold each other, Coulomb's law does not
say how the machine goes on, and the reference leaves the case out.
"""

from __future__ import annotations

import bisect
import itertools
import math
from typing import Any

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

from studies.benchmarks.rubbing_machines import Sine, Table, Trial

GRID = np.arange(1, 5) / 4
"""Fractions of a step at which its guards are looked at."""
LOOKS = 200
"""Steps, at least, in which a run is looked at."""
MOST_EVENTS = 600
ZERO = 1e-9
"""Relative size below which a guard has not left zero yet."""
SMALL = 1e-4
"""Size of a slip, of a closure and of a signal [m/s, m, 1]: a contact that is let go may come back to rest when it has slid at a hundredth of that."""


class LeftOut(Exception):
    """The reference cannot say what the machine does, and why."""


class Reference:
    """A trial, integrated to a relative tolerance.

    State y: positions, then speeds.  contacts: rubs, then relays; each has a mode, 0 stick or -+1 = the sign of its slip.  events: (time, guard, its number).
    """

    def __init__(self, trial: Trial, tolerance: float):
        machine = trial.machine
        n = self.n = len(machine.mass)
        self.trial, self.tolerance = trial, tolerance
        self.longest = trial.duration / LOOKS  # at rest a step has no error, and would pass a load that comes and goes
        mass = np.array(machine.mass)
        self.push = np.vstack([np.zeros((n, n)), np.diag(1.0 / mass)])  # columns: what a unit force on each body does to y'
        rigidity = np.diag(machine.ground)
        for i in range(n - 1):
            rigidity[i : i + 2, i : i + 2] += machine.tie[i] * np.array([[1.0, -1.0], [-1.0, 1.0]])  # type: ignore[index]
        self.free = np.block([[np.zeros((n, n)), np.eye(n)], [-rigidity / mass[:, None], -np.diag(np.array(machine.damping) / mass)]])
        self.rubs = [words.split() for words in machine.rubs]
        relays = [words.split() for words in machine.relays]
        self.span = np.array([self._between(body, against) for body, against in [*(w[:2] for w in self.rubs), *relays]]).reshape(-1, n)
        lean = [0.0] * len(self.rubs) + list(machine.lean or ())
        self.slips = np.hstack([np.array(lean)[:, None] * self.span, self.span])  # rows: slip = row y - belt
        self.acts = self.push @ self.span.T  # columns: what a unit force of each contact does to y'
        self.coupling = self.slips @ self.acts
        self.on_belt = np.array([float(words[1] == "belt") for words in self.rubs] + [0.0] * len(relays))
        self.walls = [self._between(*words.split()) for words in machine.walls]
        self.switches = [words.split() for words in machine.switches]
        self.mode = np.zeros(len(self.slips), int)
        self.beyond = np.zeros(len(self.slips), bool)
        self.closed = np.zeros(len(self.walls), bool)
        self.on = np.zeros(len(self.switches), bool)
        self.pushes = [f"machine.push{i}" for i in range(n)]
        self.belted, self.still = bool(self.on_belt.any()), np.zeros(len(self.slips))
        self.inverses: dict[tuple[int, ...], np.ndarray] = {}
        self.servo = 0.0
        self.side = 0.0
        self.events: list[tuple[float, str, int]] = []

    def _between(self, body: str, against: str) -> np.ndarray:
        row = np.zeros(self.n)
        row[int(body)] = 1.0
        if against.isdigit():
            row[int(against)] -= 1.0
        return row

    # --------------------------------------------------------------------------------------------------------------------------- forces
    def input(self, name: str, t: float, default: float = 0.0) -> tuple[float, float]:
        """Value and rate of an input in the piece that holds at the instant `self.side`, continued to t."""
        value = self.trial.inputs.get(name, default)
        if isinstance(value, Sine):
            turn = 2 * math.pi * value.frequency
            return value.mean + value.amplitude * math.sin(turn * t + value.phase), value.amplitude * turn * math.cos(
                turn * t + value.phase
            )
        if isinstance(value, Table):
            last = bisect.bisect_right(value.times, self.side) - 1
            if last < 0:
                return value.values[0], 0.0
            if last + 1 == len(value.times):
                return value.values[-1], 0.0
            slope = (value.values[last + 1] - value.values[last]) / (value.times[last + 1] - value.times[last])
            return value.values[last] + slope * (t - value.times[last]), slope
        return value, 0.0

    def wall(self, i: int, y: np.ndarray) -> tuple[float, float]:
        """Closure and force of a wall, were it closed."""
        machine = self.trial.machine
        closure = float(self.walls[i].dot(y[: self.n])) - machine.gap[i]  # type: ignore[index]
        return closure, machine.stiffness[i] * closure + machine.drag[i] * float(self.walls[i].dot(y[self.n :]))  # type: ignore[index]

    def loaded(self, k: int) -> bool:
        """Whether contact k is pressed at all."""
        return k >= len(self.rubs) or not self.rubs[k][3].isdigit() or bool(self.closed[int(self.rubs[k][3])])

    def limits(self, t: float, y: np.ndarray, slip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Static bound and kinetic friction of every contact."""
        machine = self.trial.machine
        static, kinetic = np.zeros(len(slip)), np.zeros(len(slip))
        for k, (_, _, law, load) in enumerate(self.rubs):
            pressed = 1.0
            if load.isdigit():
                pressed = self.wall(int(load), y)[1] if self.closed[int(load)] else 0.0
            elif load == "input":
                pressed = self.input(f"machine.load{k}", t, 1.0)[0]
            high, low, speed = machine.static[k], machine.kinetic[k], machine.speed[k]  # type: ignore[index]
            static[k] = pressed * high
            if law == "Coulomb":
                kinetic[k] = pressed * low
            elif law == "StepFriction":
                kinetic[k] = pressed * (low if self.beyond[k] else high)
            else:
                kinetic[k] = pressed * (low + (high - low) * math.exp(min(-self.mode[k] * slip[k] / speed, 30.0)))
        for i, bound in enumerate(machine.bound or ()):
            static[len(self.rubs) + i] = kinetic[len(self.rubs) + i] = bound
        return static, kinetic

    def _without(self, t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rates of y without contacts, slips, and the rates of the belt under each contact."""
        force = [self.input(name, t)[0] for name in self.pushes]
        force[0] += self.servo
        bare = self.free @ y + self.push @ force + self.held(y)
        slip = self.slips @ y
        if not self.belted:
            return bare, slip, self.still
        belt, rate = self.input("machine.belt", t)
        return bare, slip - self.on_belt * belt, self.on_belt * rate

    def held(self, y: np.ndarray) -> np.ndarray | float:
        """What walls and switches add to the rates of y."""
        machine, total = self.trial.machine, 0.0
        for i in range(len(self.walls)):
            if self.closed[i]:
                total = total - self.wall(i, y)[1] * (self.push @ self.walls[i])
        for i, words in enumerate(self.switches):
            if self.on[i]:
                total = total + machine.kick[i] * self.push[:, int(words[2])]  # type: ignore[index]
        return total

    def forces(self, t: float, y: np.ndarray) -> tuple[np.ndarray, ...]:
        """Forces of the contacts, their static bounds, slips and slip rates, and the rates of y, in the modes that hold."""
        bare, slip, belt = self._without(t, y)
        static, kinetic = self.limits(t, y, slip)
        force = -self.mode * kinetic
        rest = self.slips @ bare - belt
        stuck = [k for k in range(len(slip)) if self.mode[k] == 0 and self.loaded(k)]
        if stuck:
            force[stuck] = 0.0
            force[stuck] = self._inverse(tuple(stuck)) @ -(rest + self.coupling @ force)[stuck]
        return force, static, slip, rest + self.coupling @ force, bare + self.acts @ force

    def _inverse(self, stuck: tuple[int, ...]) -> np.ndarray:
        if stuck not in self.inverses:
            self.inverses[stuck] = np.linalg.inv(self.coupling[np.ix_(stuck, stuck)])
        return self.inverses[stuck]

    def rates(self, t: float, y: np.ndarray) -> np.ndarray:
        """y' in the modes that hold."""
        return self.forces(t, y)[4]

    def guards(self, t: float, y: np.ndarray) -> dict[tuple[str, int], tuple[float, float]]:
        """{(what, which): (a number that is positive while the mode holds, its size)}."""
        machine = self.trial.machine
        force, static, slip, _, _ = self.forces(t, y)
        found: dict[tuple[str, int], tuple[float, float]] = {}
        for k in range(len(slip)):
            if not self.loaded(k):
                continue
            if self.mode[k] == 0:
                found["over", k] = static[k] - force[k], static[k] + abs(force[k])
                found["under", k] = static[k] + force[k], static[k] + abs(force[k])
                continue
            found["slip", k] = self.mode[k] * slip[k], SMALL
            if k < len(self.rubs) and self.rubs[k][2] == "StepFriction":
                over = self.mode[k] * slip[k] - machine.speed[k]  # type: ignore[index]
                found["break", k] = over if self.beyond[k] else -over, SMALL
        for i in range(len(self.walls)):
            closure, pushes = self.wall(i, y)
            reach = pushes / machine.stiffness[i]  # type: ignore[index]
            found["wall", i] = reach if self.closed[i] else -min(closure, reach), SMALL
        for i in range(len(self.switches)):
            seen = self._seen(i, t, y)
            found["switch", i] = seen - machine.low[i] if self.on[i] else machine.high[i] - seen, SMALL  # type: ignore[index]
        return found

    def _seen(self, i: int, t: float, y: np.ndarray) -> float:
        read, body, _ = self.switches[i]
        return self.input("machine.signal", t)[0] if read == "input" else float(y[int(body) + (self.n if read == "speed" else 0)])

    # ---------------------------------------------------------------------------------------------------------------------------- modes
    def settle(self, t: float, y: np.ndarray, zero: set[int], forced: dict[int, int]) -> np.ndarray:
        """Decide the modes of the contacts in `zero`, of which `forced` slide as said; the others slide as their slips do. Returns y with exact zeros."""
        machine = self.trial.machine
        for i in range(len(self.switches)):  # an input may have thrown one
            seen = self._seen(i, t, y)
            if (self.on[i] and seen < machine.low[i] - ZERO) or (not self.on[i] and seen > machine.high[i] + ZERO):  # type: ignore[index]
                self.on[i] = not self.on[i]
        _, slip, _ = self._without(t, y)
        leaving = {
            k: int(self.mode[k])
            for k in range(len(slip))
            if k not in zero and self.mode[k] != 0 and abs(slip[k]) < 1e-13 and self.loaded(k)
        }
        forced = leaving | forced  # released at this very instant
        zero = {k for k in [*zero, *leaving] if self.loaded(k)}
        if zero:
            rows = sorted(zero)
            y = y - self.acts[:, rows] @ np.linalg.solve(self.coupling[np.ix_(rows, rows)], slip[rows])
        for k in range(len(slip)):
            if k not in zero:
                self.mode[k] = int(np.sign(slip[k])) or 1
                if k < len(self.rubs) and abs(abs(slip[k]) - machine.speed[k]) > ZERO:  # type: ignore[index]
                    self.beyond[k] = abs(slip[k]) > machine.speed[k]  # type: ignore[index]
            else:
                self.beyond[k] = False
        for part in self._parts(sorted(zero)):
            self._decide(t, y, part, {k: forced[k] for k in part if k in forced})
        return y

    def _parts(self, zero: list[int]) -> list[list[int]]:
        """Contacts that act on each other's slip rates, together."""
        parts: list[list[int]] = []
        for k in zero:
            touching = [part for part in parts if any(self.coupling[k, j] != 0.0 for j in part)]
            parts = [part for part in parts if part not in touching] + [sorted([k, *itertools.chain(*touching)])]
        return parts

    def _decide(self, t: float, y: np.ndarray, part: list[int], forced: dict[int, int]) -> None:
        """The one set of modes of these contacts that agrees with the forces."""
        found = []
        for modes in itertools.product(*[(forced[k],) if k in forced else (0, 1, -1) for k in part]):
            self.mode[part] = modes
            force, static, _, rate, _ = self.forces(t, y)
            pace = np.abs(self.coupling) @ (static + np.abs(force)) + 1e-12
            agrees, clear = True, True
            for k, mode in zip(part, modes, strict=True):
                if mode == 0:
                    agrees = agrees and abs(force[k]) <= static[k] * (1 + ZERO) + 1e-13
                    clear = clear and abs(force[k]) < static[k] * (1 - 1e-6)
                else:
                    agrees = agrees and mode * rate[k] > (-1e-7 if k in forced else 1e-9) * pace[k]
                    clear = clear and (k in forced or mode * rate[k] > 1e-6 * pace[k])
            if agrees:
                found.append((modes, clear))
        if not found and forced:
            return self._decide(t, y, part, {})
        if len(part) == 1 and len(found) > 1:  # alone, what can stick sticks
            found = [one for one in found if one[0] == (0,)] or found
        if len(found) > 1 and sum(clear for _, clear in found) == 1:  # at its limit a contact is on the border of two sets
            found = [one for one in found if one[1]]
        if len(found) != 1:
            raise LeftOut("a second consistent set of modes" if found else "no consistent set of modes")
        self.mode[part] = found[0][0]
        return None

    def _stuck(self) -> set[int]:
        return {k for k in range(len(self.mode)) if self.mode[k] == 0 and self.loaded(k)}

    # ----------------------------------------------------------------------------------------------------------------------------- time
    def run(self, times: np.ndarray) -> np.ndarray:
        """States at times from 0 to the duration; raises LeftOut."""
        trial, out = self.trial, np.empty((len(times), 2 * self.n))
        stops = sorted(
            {t for value in trial.inputs.values() if isinstance(value, Table) for t in value.times if 0 < t < trial.duration}
            | {trial.duration}
        )
        y = np.array([trial.start[f"machine.{kind}{i}"] for kind in "xv" for i in range(self.n)])
        t, taken, applied, queue = 0.0, 0, 0, []
        for i in range(len(self.walls)):
            closure, pushes = self.wall(i, y)
            self.closed[i] = closure > 0.0 and pushes > 0.0
        _, slip, _ = self._without(0.0, y)
        y = self.settle(0.0, y, {k for k in range(len(slip)) if abs(slip[k]) < 1e-15}, {})
        while True:
            changed = False
            if trial.law is not None:
                law, period, delay = trial.law
                while taken * period <= t < trial.duration:
                    queue.append(law.stiffness * (law.place - y[0]) - law.damping * y[self.n])
                    taken += 1
                while applied < taken and applied * period + delay <= t:
                    self.servo, changed = queue[applied], True
                    applied += 1
            if changed:
                y = self.settle(t, y, self._stuck(), {})
            if t >= trial.duration:
                out[times >= t] = y
                return out
            stop = next(s for s in stops if s > t)
            if trial.law is not None:
                stop = min(stop, taken * trial.law[1], applied * trial.law[1] + trial.law[2] if applied < taken else np.inf)
            y = self._until(t, y, stop, times, out)
            t = stop
            _, slip, _ = self._without(t, y)
            stuck = self._stuck()
            before = self.on_belt * self.input("machine.belt", t)[0]
            self.side = t
            jumped = before != self.on_belt * self.input("machine.belt", t)[0]
            if t in stops:
                y = self.settle(t, y, {k for k in stuck if not jumped[k] or abs(self._without(t, y)[1][k]) < 1e-12}, {})

    def _until(self, t: float, y: np.ndarray, stop: float, times: np.ndarray, out: np.ndarray) -> np.ndarray:
        """Integrate to the next stop through all events, filling in `out`."""
        while t < stop:
            solver = DOP853(self.rates, t, y, stop, rtol=self.tolerance, atol=self.tolerance * 1e-2, max_step=self.longest)
            armed: set[tuple[str, int]] = set()
            low = self.guards(t, y)
            armed = {name for name, (value, size) in low.items() if value > ZERO * size}
            event = None
            while event is None and t < stop:
                if solver.step() is not None or solver.status == "failed":
                    raise LeftOut("the reference takes no step")
                dense = solver.dense_output()
                event = self._first(dense, t, solver.t, armed)
                end = solver.t if event is None else event[0]
                inside = (times >= t) & (times < end)
                out[inside] = dense(times[inside]).T
                if event is None:
                    t, y = solver.t, solver.y
                    continue
                t, y = self._sharpened(t, y, *event)
            if event is not None:
                self.events.append((t, *event[1]))
                if len(self.events) > MOST_EVENTS:
                    raise LeftOut("too many events for the reference")
                y = self._switch(t, y, event[1])
        return y

    def _first(self, dense: Any, begin: float, end: float, armed: set[tuple[str, int]]) -> tuple[float, tuple[str, int]] | None:
        """Time and name of the first guard that falls through zero in a step."""
        points = begin + (end - begin) * np.concatenate([[0.0], GRID])
        small = 1e-5 * (end - begin)
        values = [self.guards(s, dense(s)) for s in points]
        beside = [self.guards(s, dense(s)) for s in [points[0] + small, *(points[1:] - small)]]
        first: tuple[float, tuple[str, int]] | None = None
        for name in values[0]:
            row = [value[name][0] for value in values]
            slopes = [
                (near[name][0] - value[name][0]) * (1 if i == 0 else -1) for i, (near, value) in enumerate(zip(beside, values, strict=True))
            ]
            for i in range(len(points)):
                if first is not None and i and points[i - 1] > first[0]:
                    break
                if name not in armed:
                    size = values[i][name][1]
                    if row[i] > ZERO * size:
                        armed.add(name)
                    elif row[i] < -ZERO * 10 * size:
                        raise LeftOut("a guard leaves zero to the wrong side")
                    continue
                if i == 0:
                    continue

                def value(s: float, name: tuple[str, int] = name) -> float:
                    return self.guards(s, dense(s))[name][0]

                a, b = points[i - 1], points[i]
                if row[i] > 0.0 and row[i - 1] > 0.0 and slopes[i - 1] < 0.0 < slopes[i]:
                    b = _lowest(value, a, 0.5 * (a + b), b)
                if value(b) <= 0.0 < value(a):
                    at = float(brentq(value, a, b, xtol=1e-15, rtol=1e-14))
                    if first is None or at < first[0]:
                        first = at, name
                    break
        return first

    def _sharpened(self, t: float, y: np.ndarray, at: float, name: tuple[str, int]) -> tuple[float, np.ndarray]:
        """The event located on the dense output, by integrating to it from the beginning of its step and following the guard to its zero."""

        def there(at: float) -> np.ndarray:
            if at <= t:
                return y
            solver = DOP853(self.rates, t, y, at, rtol=self.tolerance, atol=self.tolerance * 1e-2, first_step=at - t)
            while solver.status == "running":
                solver.step()
            return solver.y

        for _ in range(3):
            state = there(at)
            small = 1e-7 * max(at - t, 1e-6)
            here, ahead = self.guards(at, state)[name][0], self.guards(at + small, state + small * self.rates(at, state))[name][0]
            slope = (ahead - here) / small
            move = -here / slope if slope < 0.0 else 0.0
            if abs(move) > 1e-6 * max(at - t, 1e-9) + 1e-9 or abs(move) < 1e-15:
                break
            at = max(t, at + move)
        return at, there(at)

    def _switch(self, t: float, y: np.ndarray, name: tuple[str, int]) -> np.ndarray:
        """What a guard at zero does."""
        what, k = name
        zero, forced = self._stuck(), {}
        if what == "over":
            forced[k] = -1
        elif what == "under":
            forced[k] = 1
        elif what == "slip":
            zero.add(k)
        elif what == "break":
            self.beyond[k] = not self.beyond[k]
        elif what == "wall":
            self.closed[k] = not self.closed[k]
            zero = {one for one in zero if self.loaded(one)}
        else:
            self.on[k] = not self.on[k]
        return self.settle(t, y, zero, forced)


def _lowest(value: Any, left: float, middle: float, right: float) -> float:
    """Where a function that dips between left and right is lowest, or where it is first found below zero."""
    golden = 0.381966
    best, low = middle, value(middle)
    for _ in range(25):
        wide = right - best > best - left
        new = best + golden * (right - best) if wide else best - golden * (best - left)
        f = value(new)
        if f <= 0.0:
            return new
        if f < low:
            left, right = (best, right) if wide else (left, best)
            best, low = new, f
        elif wide:
            right = new
        else:
            left = new
        if low > 0.0 and right - left < 1e-9 * max(abs(right), 1e-3):
            break
    return best
