"""A reference for mechanisms that shares no code with the toolbox: bodies in a row of coordinates, frictions, stops and one-way clutches, event by event.

    M q'' = f(t, q, q') + sum c_k F_k          slips c_k(q) q' - w_k(t)

Gauss's principle decides the accelerations: among those that stops and clutches allow, q'' minimises (a - M^-1 f)' M (a - M^-1 f) / 2 + sum bound |slip rate|
over the frictions without slip. Its dual is a least-squares problem with bounds on the forces, which `scipy.optimize.lsq_linear` solves whatever depends on
what; nothing is known of modes, groups or shares. Frictions that begin to slide then have their kinetic force, and the rest is decided again. Between events
scipy's DOP853 integrates with a relative tolerance of 1e-12; that what holds can go on holding is asked of the same least squares. Impacts are Newton's,
without restitution where that would add energy.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Row = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Friction:
    """Friction on the slip row(q) q' - pace(t): its bound at rest and its law in slip, kinetic(|slip|), forwards and backwards."""

    name: str
    row: Any
    static: float
    kinetic: Callable[[float], float]
    pace: Callable[[float], float] = lambda t: 0.0
    static_back: float | None = None
    kinetic_back: Callable[[float], float] | None = None

    def bounds(self) -> tuple[float, float]:
        """Lowest and highest force at rest."""
        return -self.static, self.static if self.static_back is None else self.static_back

    def force(self, side: int, slip: float) -> float:
        """The force in slip."""
        law = self.kinetic if side > 0 or self.kinetic_back is None else self.kinetic_back
        return -side * law(abs(slip))


@dataclass(frozen=True)
class Stop:
    """A rigid stop: row q - place(t) <= 0, with a restitution."""

    name: str
    row: Any
    restitution: float = 0.0
    place: Callable[[float], float] = lambda t: 0.0


@dataclass(frozen=True)
class Clutch:
    """A one-way clutch: row q' <= 0."""

    name: str
    row: Any


class LeftOut(Exception):
    """The reference cannot tell what the mechanism does, and why."""


@dataclass
class Reference:
    """A mechanism from event to event; `events` are (time, name, what), `q` and `v` where it ends, `largest` the largest size of each state.

    inertia: q -> M, or its diagonal;  pull: (t, q, v) -> f, all but the contacts.
    """

    inertia: Any
    pull: Callable[[float, np.ndarray, np.ndarray], np.ndarray]
    contacts: Sequence[Any]
    q: np.ndarray
    v: np.ndarray
    duration: float
    steps: int = 300
    ahead: float = 1e-7
    events: list[tuple[float, str, str]] = field(default_factory=list)
    closes: float = 2e-6

    def __post_init__(self) -> None:
        self.q, self.v = np.array(self.q, float), np.array(self.v, float)
        self.t, self.n = 0.0, self.q.size
        self.largest = np.abs(np.concatenate([self.q, self.v]))
        self.rubs = [k for k, c in enumerate(self.contacts) if isinstance(c, Friction)]
        self.stops = [k for k, c in enumerate(self.contacts) if isinstance(c, Stop)]
        self.clutches = [k for k, c in enumerate(self.contacts) if isinstance(c, Clutch)]
        self.mode = dict.fromkeys(range(len(self.contacts)), 0)
        for k in self.rubs:
            slip = self.slip(k, self.t, self.q, self.v)
            self.mode[k] = 0 if abs(slip) < 1e-14 else int(math.copysign(1, slip))
        for k in self.stops:
            self.mode[k] = 0 if abs(self.gap(k, self.t, self.q)) < 1e-14 and abs(self.slip(k, self.t, self.q, self.v)) < 1e-14 else 1
        for k in self.clutches:
            self.mode[k] = 0 if abs(self.slip(k, self.t, self.q, self.v)) < 1e-14 else 1
        self._decide()
        self._through()

    def _row(self, k: int, q: np.ndarray) -> np.ndarray:
        row = self.contacts[k].row
        return np.asarray(row(q) if callable(row) else row, float)

    def _pace(self, k: int, t: float) -> float:
        contact = self.contacts[k]
        if isinstance(contact, Friction):
            return contact.pace(t)
        return _slope(contact.place, t) if isinstance(contact, Stop) else 0.0

    def slip(self, k: int, t: float, q: np.ndarray, v: np.ndarray) -> float:
        """Slip of a contact, or the rate at which a gap closes."""
        return float(self._row(k, q) @ v) - self._pace(k, t)

    def gap(self, k: int, t: float, q: np.ndarray) -> float:
        """How far a stop is closed: below zero while it is open."""
        return float(self._row(k, q) @ q) - self.contacts[k].place(t)

    def _mass(self, q: np.ndarray) -> np.ndarray:
        found = np.asarray(self.inertia(q) if callable(self.inertia) else self.inertia, float)
        return found if found.ndim == 2 else np.diag(found)

    def _free(self, t: float, q: np.ndarray, v: np.ndarray, mode: dict[int, int]) -> np.ndarray:
        """The force without what holds."""
        force = np.array(self.pull(t, q, v), float)
        for k in self.rubs:
            if mode[k] != 0:
                slip = self.slip(k, t, q, v)
                force += self._row(k, q) * self.contacts[k].force(mode[k], slip if slip * mode[k] > 0 else 0.0)
        return force

    def _held(self, t: float, q: np.ndarray, v: np.ndarray, holding: Sequence[int], mode: dict[int, int]) -> tuple[Any, ...]:
        """(inverse mass, rows, A, b): slip rates of what holds are A F + b."""
        inverse = np.linalg.inv(self._mass(q))
        rows = np.array([self._row(k, q) for k in holding]).reshape(len(holding), self.n)
        turning = np.array([_turning(self.contacts[k].row, q, v) for k in holding])
        pace = np.array([_slope(lambda s, k=k: self._pace(k, s), t) for k in holding])
        b = rows @ inverse @ self._free(t, q, v, mode) + turning - pace
        return inverse, rows, rows @ inverse @ rows.T, b

    def _limits(self, holding: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        bounds = [self.contacts[k].bounds() if k in self.rubs else (-np.inf, 0.0) for k in holding]
        low, high = np.array(bounds).reshape(-1, 2).T
        return low, np.maximum(high, low + 1e-14)

    def _gauss(self, t: float, q: np.ndarray, v: np.ndarray, holding: Sequence[int], mode: dict[int, int]) -> np.ndarray:
        """Slip rates of what may hold."""
        from scipy.optimize import lsq_linear

        if not holding:
            return np.zeros(0)
        _, _, A, b = self._held(t, q, v, holding, mode)
        # what depends on each other is told apart by so little that the rates do not feel it
        root = np.linalg.cholesky(A + 1e-11 * np.trace(A) * np.eye(len(b))).T
        given, right = root, np.linalg.solve(root.T, -b)
        low, high = self._limits(holding)
        found = lsq_linear(given, right, (low, high), method="bvls", tol=1e-15, max_iter=500)
        return A @ found.x + b

    def _decide(self) -> None:
        """Modes of what is at zero, a little ahead of the present time."""
        found = [self._decided(step * max(1.0, self.duration)) for step in (self.ahead, 30 * self.ahead)]
        if found[0] != found[1]:
            raise LeftOut("decides one way now and another way a moment later")
        for k, mode in found[0].items():
            if mode != self.mode[k]:
                self._note(k, mode)
        self.mode = found[0]

    def _decided(self, step: float) -> dict[int, int]:
        mode = dict(self.mode)
        t, q, v = self.t + step, self.q + step * self.v, self.v
        for _ in range(20):
            holding = [k for k, m in mode.items() if m == 0]
            rates = self._gauss(t, q, v, holding, mode)
            size = 1e-9 * (1.0 + np.abs(rates).max(initial=0.0))
            released = [(k, r) for k, r in zip(holding, rates, strict=True) if k in self.rubs and abs(r) > size]
            opened = [k for k, r in zip(holding, rates, strict=True) if k not in self.rubs and r < -size]
            if not released:
                for k in opened:
                    mode[k] = 1
                self._check_slides(t, q, v, mode)
                return mode
            for k, rate in released:
                mode[k] = int(math.copysign(1, rate))
        raise LeftOut("no end of deciding")

    def _check_slides(self, t: float, q: np.ndarray, v: np.ndarray, mode: dict[int, int]) -> None:
        """What has just been released must go the way it was released."""
        a = self._acceleration(t, q, v, mode)
        for k in self.rubs:
            if mode[k] != 0 and self.mode[k] == 0:
                rate = float(self._row(k, q) @ a) + _turning(self.contacts[k].row, q, v) - _slope(lambda s, k=k: self._pace(k, s), t)
                if rate * mode[k] < 0:
                    raise LeftOut("released, and goes the other way")

    def _note(self, k: int, mode: int) -> None:
        words = {0: "stick", 1: "slip+", -1: "slip-"} if k in self.rubs else {0: "closed", 1: "open"}
        if k in self.clutches:
            words = {0: "locked", 1: "free"}
        self.events.append((self.t, self.contacts[k].name, words[mode]))

    def _acceleration(self, t: float, q: np.ndarray, v: np.ndarray, mode: dict[int, int]) -> np.ndarray:
        holding = [k for k, m in mode.items() if m == 0]
        free = self._free(t, q, v, mode)
        if not holding:
            return np.linalg.solve(self._mass(q), free)
        inverse, rows, A, b = self._held(t, q, v, holding, mode)
        force = np.linalg.lstsq(A, -b, rcond=1e-11)[0]
        return inverse @ (free + rows.T @ force)

    def _wrong(self, t: float, q: np.ndarray, v: np.ndarray, armed: dict[int, bool]) -> list[int]:
        """What does not go on as it is: slips that ended, gaps that closed; -1 for what holds no longer."""
        found = []
        for k in self.rubs:
            if self.mode[k] != 0 and armed[k] and self.mode[k] * self.slip(k, t, q, v) <= 0.0:
                found.append(k)
        for k in self.stops:
            if self.mode[k] == 1 and armed[k] and self.gap(k, t, q) >= 0.0:
                found.append(k)
        for k in self.clutches:
            if self.mode[k] == 1 and armed[k] and self.slip(k, t, q, v) >= 0.0:
                found.append(k)
        holding = [k for k, m in self.mode.items() if m == 0]
        if holding:
            rates = self._gauss(t, q, v, holding, self.mode)
            rates = np.array([min(r, 0.0) if k not in self.rubs else r for k, r in zip(holding, rates, strict=True)])
            if np.abs(rates).max() > 1e-9 * (1.0 + np.abs(self.pull(t, q, v)).max()):
                found.append(-1)
        return found

    def _through(self) -> None:
        from scipy.integrate import DOP853

        n, most = self.n, 3000
        while self.t < self.duration * (1 - 1e-14):
            most -= 1
            if most == 0:
                raise LeftOut("too many events")
            began = self.t

            def slope(t: float, y: np.ndarray) -> np.ndarray:
                return np.concatenate([y[n:], self._acceleration(t, y[:n], y[n:], self.mode)])

            y = np.concatenate([self.q, self.v])
            solver = DOP853(slope, self.t, y, self.duration, rtol=1e-12, atol=1e-14 * (1 + self.largest), max_step=self.duration / self.steps,
                            first_step=min(1e-9 * self.duration, self.duration - self.t))  # fmt: skip
            armed = dict.fromkeys(self.mode, False)
            self._arm(armed, self.t, self.q, self.v)
            event = None
            while event is None and solver.status == "running":
                solver.step()
                if solver.status == "failed":
                    raise LeftOut("the integration fails")
                dense, low = solver.dense_output(), solver.t_old
                for high in np.linspace(solver.t_old, solver.t, 5)[1:]:
                    at = dense(high)
                    wrong = self._wrong(high, at[:n], at[n:], armed)
                    if wrong:
                        event = self._sharp(dense, low, high, armed)
                        break
                    self._arm(armed, high, at[:n], at[n:])
                    self.largest = np.maximum(self.largest, np.abs(at))
                    low = high
            if event is None:
                self.t, self.q, self.v = solver.t, solver.y[:n].copy(), solver.y[n:].copy()
                return
            self.t, wrong, y = event
            self.q, self.v = y[:n].copy(), y[n:].copy()
            self._happens(wrong)
            if self.t - began < 1e-12 and most < 2800:
                raise LeftOut("events without end")

    def _arm(self, armed: dict[int, bool], t: float, q: np.ndarray, v: np.ndarray) -> None:
        for k in armed:
            if self.mode[k] == 0:
                continue
            value = self.gap(k, t, q) if k in self.stops else self.slip(k, t, q, v)
            value = -value if k not in self.rubs else self.mode[k] * value
            armed[k] = armed[k] or value > 1e-15 * (1 + float(self.largest.max()))
            if k in self.stops and not armed[k] and self.gap(k, t, q) > -1e-13 and self.slip(k, t, q, v) > 1e-12:
                armed[k] = True

    def _sharp(self, dense: Any, low: float, high: float, armed: dict[int, bool]) -> tuple[float, list[int], np.ndarray]:
        n = self.n
        for _ in range(200):
            middle = 0.5 * (low + high)
            if not low < middle < high:
                break
            at = dense(middle)
            if self._wrong(middle, at[:n], at[n:], armed):
                high = middle
            else:
                low = middle
        at = dense(high)
        return high, self._wrong(high, at[:n], at[n:], armed), at

    def _happens(self, wrong: Sequence[int]) -> None:
        for k in wrong:
            if k in self.rubs:
                lever = np.abs(self._row(k, self.q)).max() if callable(self.contacts[k].row) else 1.0
                self.mode[k] = 0 if lever > 1e-6 else -self.mode[k]  # at a dead centre the slip passes through zero
                self.events.append((self.t, self.contacts[k].name, "stops"))
        if any(k in self.stops or k in self.clutches for k in wrong):
            self._impact([k for k in wrong if k >= 0 and k not in self.rubs])
        self._at_zero()
        scale = float(np.abs(self.largest[self.n :]).max()) + 1e-300
        for k in self.rubs:  # two slips that end at one instant
            if self.mode[k] != 0 and not callable(self.contacts[k].row) and abs(self.slip(k, self.t, self.q, self.v)) <= 1e-11 * scale:
                self.mode[k] = 0
        for k in self.clutches:  # and one that comes to no slip as it does
            if self.mode[k] == 1 and abs(self.slip(k, self.t, self.q, self.v)) <= 1e-11 * scale:
                self.mode[k] = 0
        self._decide()

    def _at_zero(self) -> None:
        """Remove the round-off of slips that are zero."""
        holding = [k for k, m in self.mode.items() if m == 0]
        if holding:
            inverse = np.linalg.inv(self._mass(self.q))
            rows = np.array([self._row(k, self.q) for k in holding])
            slips = np.array([self.slip(k, self.t, self.q, self.v) for k in holding])
            self.v = self.v - inverse @ rows.T @ np.linalg.lstsq(rows @ inverse @ rows.T, slips, rcond=1e-11)[0]

    def _impact(self, struck: Sequence[int]) -> None:
        """Newton's impact of what is closed, what has just closed, and all clutches: 0 <= P, 0 <= -(slip + e slip before), one of them zero.

        Where that adds energy, as where a clutch makes a heavy body rebound as fast as the light one that strikes, restitution is left out.
        """
        taking = [k for k in [*self.stops, *self.clutches] if self.mode[k] == 0 or k in struck or k in self.clutches]
        inverse = np.linalg.inv(self._mass(self.q))
        rows = np.array([self._row(k, self.q) for k in taking])
        before = np.array([self.slip(k, self.t, self.q, self.v) for k in taking])
        e = np.array([getattr(self.contacts[k], "restitution", 0.0) for k in taking])
        P, after = _impulses(rows @ inverse @ rows.T, before, e)
        if P @ (before + after) < -1e-12 * np.abs(P) @ np.abs(before):  # it would add energy, and is one without restitution
            P, after = _impulses(rows @ inverse @ rows.T, before, 0 * e)
        self.v = self.v - inverse @ rows.T @ P
        scale = float(np.abs(self.largest[self.n :]).max()) + 1e-300
        for k, slip in zip(taking, after, strict=True):
            if k in self.clutches:
                self.mode[k] = 0 if abs(slip) <= 1e-11 * scale else 1
            else:
                self.mode[k] = 0 if slip > -self.closes * scale else 1
            self.events.append((self.t, self.contacts[k].name, "strikes"))
        for _ in range(2):  # an impact may end or turn a slip, or set one in motion, and what closes takes the rest of it
            for k in self.rubs:
                slip = self.slip(k, self.t, self.q, self.v)
                self.mode[k] = 0 if abs(slip) <= 1e-11 * scale else int(math.copysign(1, slip))
            self._at_zero()


def _impulses(A: np.ndarray, before: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Impulses of an impact, and the slips after it."""
    size, target = np.abs(before).max() + 1e-300, np.where(before > 0, -e * before, 0.0)
    for held in itertools.product((True, False), repeat=len(before)):
        on = np.flatnonzero(held)
        P = np.zeros(len(before))
        P[on] = np.linalg.lstsq(A[np.ix_(on, on)], (before - target)[on], rcond=1e-11)[0] if on.size else []
        after = before - A @ P
        if (
            (-1e-10 * size / A.diagonal().min() <= P).all()
            and (after <= target + 1e-10 * size).all()
            and (np.abs((after - target)[on]) <= 1e-9 * size).all()
        ):
            return P, after
    raise LeftOut("no impact")


def _slope(value: Callable[[float], float], t: float) -> float:
    """The derivative of a smooth function of time, by differences of order six."""
    h = 1e-3
    weights = ((1, 45.0), (2, -9.0), (3, 1.0))
    return sum(w * (value(t + k * h) - value(t - k * h)) for k, w in weights) / (60 * h)


def _turning(row: Any, q: np.ndarray, v: np.ndarray) -> float:
    """What a row that depends on q adds to the slip rate."""
    return _slope(lambda s: float(np.asarray(row(q + s * v)) @ v), 0.0) if callable(row) else 0.0
