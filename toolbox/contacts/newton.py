"""The contact problem of one step, solved by a semismooth Newton method.

With everything but the displacements s of the contacts eliminated, the forces on the body at its contacts are  K_c s - r,  and with the pressures
N = -(K_c s - r)_n, tractions T = (K_c s - r)_t, slips d = s_t - held the unknown s solves (Alart and Curnier)

    N = max(0, y_n),        y_n = N + rho_n (s_n - gap)
    T = y min(1, mu N / |y|),   y = T - rho_t d

Every pass solves the equations that these become where the sets open, stick and slip are those of the last s: on open contacts N = 0, on closed ones
s_n = gap, on sticking ones d = 0, and on sliding ones the linearised cone. Held displacements leave the system, so its size is that of what moves.

Why not relaxation contact by contact: what holds a rigid motion is 1e4 to 1e8 times softer than the elastic body between two contacts, and sweeps from
contact to contact carry a change of the rigid motion through all of them. Newton's passes solve for all at once and their number hardly depends on it.
Source: P. Alart, A. Curnier, Computer Methods in Applied Mechanics and Engineering 92 (1991) 353-375, doi:10.1016/0045-7825(91)90022-X.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WEAKEST = 1e-11
"""Stiffness, in parts of that of the body, below which springs that help to find a first solution are left out at once."""

FULL, PARTS = 16, (1.0, 0.6, 0.35, 0.2, 0.1, 0.05)
"""Passes with full steps, and the parts of a step that are tried after them."""

FREE = 1e-2
"""Round-off of the forces, in parts of what acts, beyond which displacements are those of a motion that nothing holds."""

PASSES = 40
"""Newton passes from one guess, before the next is tried."""


@dataclass
class Solution:
    """Displacements (m,), pressures (c,), tractions (c, k), slips (c, k), states open (c,) and stuck (c,), and the passes it took."""

    moved: np.ndarray
    normal: np.ndarray
    tangential: np.ndarray
    slip: np.ndarray
    is_open: np.ndarray
    sticks: np.ndarray
    passes: int


@dataclass
class Given:
    """One problem: r = `right` (m,), gap (c,), displacements of no slip `held` (c, k), coefficients of friction (c,), and given loads (c,).

    The loads count only where contacts do not open.
    """

    right: np.ndarray
    gap: np.ndarray
    held: np.ndarray
    friction: np.ndarray
    load: np.ndarray


@dataclass
class _Sets:
    """Which contacts are open and stick, and the point (y, bound) about which the cone of those that slide is linearised."""

    is_open: np.ndarray
    sticks: np.ndarray
    trial: np.ndarray
    bound: np.ndarray


@dataclass
class _Point:
    """Forces, pressures, tractions, slips, residuals of the equations at the head, and the sets that they make."""

    force: np.ndarray
    normal: np.ndarray
    traction: np.ndarray
    slip: np.ndarray
    residual: np.ndarray
    sets: _Sets


class ContactSolver:
    """Solves the contact problem for one matrix K_c (m, m) and many right sides.

    contacts, directions: c and k, where m = c k for given loads and c (1 + k) for contacts that open.
    """

    def __init__(self, stiffness: np.ndarray, contacts: int, directions: int):
        self.stiffness, self.contacts, self.directions = stiffness, contacts, directions
        self.opens = len(stiffness) == contacts * (1 + directions)
        self.first = contacts if self.opens else 0
        self.sizes = np.abs(stiffness)
        diagonal = np.diag(stiffness)
        self.rho_normal = diagonal[: self.first]
        self.rho_tangent = diagonal[self.first :].reshape(contacts, directions).mean(axis=1)

    def solve(self, given: Given, guess: Solution | None) -> Solution | None:
        """The solution, None where no guess leads to one. guess: the solution of a similar problem, such as the step before."""
        stuck = np.concatenate([given.gap, given.held.ravel()]) if self.opens else given.held.ravel()
        size = np.abs(given.right).max() + np.abs(self.stiffness @ stuck - given.right).max()
        passes = 0
        begins: list[tuple[np.ndarray, _Sets | None]] = [(stuck, None)]
        if guess is not None:
            moved = stuck.copy()
            moved[self.first :] += guess.slip.ravel()
            begins.insert(0, (moved, self._sets_of(guess, given)))
        for moved, sets in begins:
            found = self._passes(moved, sets, given, size)
            if found is not None:
                found.passes += passes
                return found
            passes += PASSES
        found = self._from_stiff(stuck, given, size)
        if found is not None:
            found.passes += passes
        return found

    def _from_stiff(self, stuck: np.ndarray, given: Given, size: float) -> Solution | None:
        """The solution by following that of contacts with springs of their own to the position without slip, until the springs are gone.

        With strong springs every contact decides alone; each weaker set of springs begins at the solution of the one before.
        """
        plain, added = self.stiffness, np.diag(np.diag(self.stiffness))
        strength, ratio, moved, passes = 10.0, 0.1, stuck, 0
        while ratio < 0.999:
            following = strength * ratio if strength * ratio > WEAKEST else 0.0
            self.stiffness = plain + following * added
            held = Given(given.right + following * (added @ stuck), given.gap, given.held, given.friction, given.load)
            try:
                found = self._passes(moved, None, held, size)
            finally:
                self.stiffness = plain
            passes += PASSES if found is None else found.passes
            if found is None:
                ratio = np.sqrt(ratio)
            elif following == 0.0:
                found.passes = passes
                return found
            else:
                strength, moved, ratio = following, found.moved, max(ratio**2, 0.1)
        return None

    def _sets_of(self, guess: Solution, given: Given) -> _Sets:
        """The sets of another solution."""
        trial = guess.tangential - self.rho_tangent[:, None] * guess.slip
        bound = given.friction * (guess.normal if self.opens else given.load)
        slides = ~guess.is_open & ~guess.sticks & (np.linalg.norm(trial, axis=1) > 0)
        return _Sets(guess.is_open, ~guess.is_open & ~slides, trial, bound)

    def _passes(self, moved: np.ndarray, sets: _Sets | None, given: Given, size: float) -> Solution | None:
        """The solution from one guess, None where there is none. size: of the forces at work."""
        before = None
        for number in range(PASSES):
            point = self._point(moved, given)
            if number or sets is None:
                sets = point.sets
            state = (sets.is_open.tobytes(), sets.sticks.tobytes())
            # forces are the small rest of large ones, and their round-off is that of these
            round_off = 1e-14 * (self.sizes @ np.abs(moved)).max()
            if round_off > max(FREE * size, 1e-300):  # equations that are singular but for round-off: any residual would do
                return None
            if state == before and np.abs(point.residual).max() <= 1e-11 * size + round_off:
                tiny = np.linalg.norm(point.slip, axis=1) * self.rho_tangent <= 1e-11 * size + round_off  # at rest on the edge of its cone
                sticks = sets.sticks | (tiny & ~sets.is_open)
                point.slip[sticks] = 0.0
                point.traction[sets.is_open] = 0.0
                normal = np.where(sets.is_open, 0.0, np.maximum(point.normal, 0.0)) if self.opens else point.normal
                return Solution(moved, normal, point.traction, point.slip, sets.is_open, sticks, number)
            step = self._direction(point.force, moved, given, sets)
            if step is None:
                return None
            if number < FULL:
                moved = moved + step
            else:  # in a circle: the part of the step that leaves the smallest residual
                moved = min((moved + part * step for part in PARTS), key=lambda s: np.linalg.norm(self._point(s, given).residual))
            before = state
        return None

    def _point(self, moved: np.ndarray, given: Given) -> _Point:
        """What holds at displacements (m,)."""
        force = self.stiffness @ moved - given.right
        normal = -force[: self.first] if self.opens else given.load
        traction = force[self.first :].reshape(given.held.shape)
        slip = moved[self.first :].reshape(given.held.shape) - given.held
        closure = normal + self.rho_normal * (moved[: self.first] - given.gap) if self.opens else given.load
        trial = traction - self.rho_tangent[:, None] * slip
        length = np.linalg.norm(trial, axis=1)
        bound = given.friction * np.maximum(closure, 0.0)
        residual = (traction - trial * (np.minimum(bound, length) / np.maximum(length, 1e-300))[:, None]).ravel()
        if self.opens:
            residual = np.concatenate([normal - np.maximum(closure, 0.0), residual])
        return _Point(force, normal, traction, slip, residual, _Sets(closure <= 0.0, (length <= bound) & (closure > 0.0), trial, bound))

    def _direction(self, force: np.ndarray, moved: np.ndarray, given: Given, sets: _Sets) -> np.ndarray | None:
        """The Newton step of all displacements (m,), None where its equations are singular."""
        c, k, first = self.contacts, self.directions, self.first
        step, known = np.zeros(len(moved)), np.zeros(len(moved), bool)
        if self.opens:
            known[:c] = ~sets.is_open
            step[:c] = np.where(sets.is_open, 0.0, given.gap - moved[:c])
        known[first:] = np.repeat(sets.sticks, k)
        step[first:] = np.where(known[first:], given.held.ravel() - moved[first:], 0.0)
        unknown = np.flatnonzero(~known)
        if not unknown.size:
            return step
        change = force + self.stiffness @ step  # forces where only what is known moves
        matrix = self.stiffness[np.ix_(unknown, unknown)]
        target = -change[unknown]
        slides = np.flatnonzero(~sets.sticks & ~sets.is_open)
        if slides.size:
            place = np.full(len(moved), -1)
            place[unknown] = np.arange(unknown.size)
            columns = first + slides[:, None] * k + np.arange(k)
            rows = place[columns]
            trial, bound = sets.trial[slides], sets.bound[slides]
            length = np.linalg.norm(trial, axis=1)
            along = trial / length[:, None]
            # of the cone y min(1, b / |y|): what it changes by with y, across its direction
            across = np.minimum(bound / length, 1.0)[:, None, None] * (np.eye(k) - along[:, :, None] * along[:, None, :])
            block = self.stiffness[columns][:, :, unknown]
            rho = self.rho_tangent[slides]
            traction = change[columns]
            new_trial = traction - rho[:, None] * (moved[columns] - given.held[slides])
            matrix[rows] = block - np.einsum("sij,sju->siu", across, block)
            matrix[rows[:, :, None], rows[:, None, :]] += across * rho[:, None, None]
            right = bound[:, None] * along + np.einsum("sij,sj->si", across, new_trial - trial) - traction
            if self.opens:  # the bound follows the pressure, whose change is -dF_n; closed contacts stay at their gaps
                pull = given.friction[slides, None] * along
                matrix[rows] += pull[:, :, None] * self.stiffness[slides][:, None, unknown]
                right += -pull * change[slides, None] - bound[:, None] * along
            target[rows] = right
        try:
            step[unknown] = np.linalg.solve(matrix, target)
        except np.linalg.LinAlgError:
            return None
        return step if np.isfinite(step).all() else None
