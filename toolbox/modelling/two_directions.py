"""Friction with two slip directions under one cone: the direction of its force, and when it sticks, breaks away and moves.

    stick:  v = 0 and |F| <= static                v = (v_1, v_2), F = (F_1, F_2)
    slip:   F = - kinetic d                        d = v / |v|

Right after the break-away v has no direction yet. From rest it grows against the force H that would hold it, and as long as it is small beside what friction
can change it by, friction turns it there at once, at the rate a kinetic / |v| with a the gain of the force. Until it moves,

    pull:   d along v - p start H / |H|            H from the same balance of forces with this contact sticking

with p = a static, the pace of the contact, and a short time `start`: a direction that exists at rest, and a rate that no step falls below. Along the pull
this is the exact law, and slip across it dies within `start`, however slowly the contact creeps. Several contacts that hold each other and break away at one
instant are held in turn by what lowers their H to kinetic friction, A F + y F = -b with y found by repeating the trial.

It ends where |v| exceeds p (2 stop + start exp(-(|v'| / (share p))^2)): a contact that breaks away fast, as its pull jumped or its kinetic friction is lower,
leaves at the first speed that can be told from rest, one that is released at its limit and gains speed slowly stays longer. Slip ends where friction alone
would need no more than the time `stop` to end it, which is then done: p stop is left of the speed, and p stop^2 / 2 of the way. A contact that cannot be held
there goes on along its pull. The times and the share follow from the accuracy and the duration of a run (`toolbox.simulation.work_arrays`).

Sources: the cone is that of A. Klarbring, A mathematical programming approach to three-dimensional contact problems with friction, Comput. Methods Appl. Mech.
Eng. 58 (1986) 175-200; the two ways to leave and enter rest are this toolbox's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from toolbox.errors import SceneError
from toolbox.modelling.elements import Element, length
from toolbox.modelling.elimination import coupled_groups

resolution = ca.SX.sym("resolution", 3)
"""Symbols of the times `stop` and `start` [s], and of the share: numbers of a run."""

EXACT = ca.SX([0.0, 1e-100, 1.0])
"""What they are outside of runs: the direction of the force is that of the slip wherever there is one."""

SWEEPS = 2
"""Repetitions of the trial for contacts that hold each other."""


class Cones:
    """The frictions with two slip directions among the elements of a plant; `places` holds the number of the first row of each, the second is the next one.

    slip: of all rows;  loader: for every element the number of the unilateral contact without which it has no load, or -1;  times: stop, start and share.
    """

    def __init__(self, elements: Sequence[Element], slip: ca.SX, loader: Sequence[int], times: ca.SX):
        self.elements, self.slip, self.times = elements, slip, times
        self.places = [i for i, element in enumerate(elements) if element.directions > 1]
        self.symbols = ca.vertcat(ca.SX(0, 1), *[elements[i].speed for i in self.places])
        self.loaded = {i: 1 - elements[loader[i]].mode if loader[i] >= 0 else ca.SX(1) for i in self.places}

    def shared(self, values: ca.SX) -> ca.SX:
        """Return the values of all rows, with the second row of each contact equal to its first."""
        values = ca.SX(values)
        for i in self.places:
            values[i + 1] = values[i]
        return values

    def at_speed(self, expression: ca.SX, speeds: ca.SX) -> ca.SX:
        """An expression with the slip speeds in the laws of these contacts."""
        return ca.substitute(expression, self.symbols, speeds) if self.places else expression

    def _pulled(self, i: int) -> ca.SX:
        """1 where the direction of the force is that of the pull."""
        return self.elements[i].mode ** 2 * (1 - self.elements[i + 1].mode) * self.loaded[i]

    def _speed(self, i: int) -> ca.SX:
        """|v| where the direction of the force is that of the slip; elsewhere a number that is not zero and has a derivative at rest."""
        return length(self.slip[i : i + 2], 1 - self.elements[i].mode ** 2 * self.elements[i + 1].mode * self.loaded[i])

    def trial(self, sticks: ca.SX, side: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return the arguments of the balance of forces for a trial that holds the contacts whose force follows the pull."""
        sticks, side = ca.SX(sticks), ca.SX(side)
        for i in self.places:
            slips = self.elements[i].mode ** 2 * self.elements[i + 1].mode
            sticks[i] = sticks[i + 1] = 1 - slips
            side[i : i + 2] = slips * self.slip[i : i + 2] / self._speed(i)
        return sticks, side, ca.vertcat(*[self._speed(i) for i in self.places])

    def sweeps(self, gain: ca.SX) -> int:
        """How often the trial is repeated: contacts that hold each other, and break away at one instant, find their directions together."""
        groups = coupled_groups(gain.sparsity())
        return SWEEPS if any(len(set(self.places) & set(group)) > 1 for group in groups) else 0

    def resisting(self, moved: Sequence[ca.SX]) -> dict[int, ca.SX]:
        """The slip rates that a force of 1 makes while the others hold: less than where nothing else does. moved: forces for a rate of 1 each."""
        return {i: 1 / forces[i] for i, forces in zip(self.places, moved, strict=True)}

    def yielding(self, holding: ca.SX, before: ca.SX | None, load: ca.SX, sliding: ca.SX, resisting: Mapping[int, ca.SX]) -> ca.SX:
        """The slip rates, in parts of minus the force, that lower the forces of a trial to kinetic friction where the force follows the pull.

        resisting: as of the method. With the gain of the contact alone one that stuck neighbours hold would yield so far that its pull turned round.
        """
        rows = ca.SX.zeros(self.slip.numel())
        kinetic = load * self.at_speed(sliding, ca.SX.zeros(len(self.places)))
        for i in self.places:
            pulled = self._pulled(i)
            own, now = resisting[i], 0 if before is None else before[i]
            rows[i] = rows[i + 1] = pulled * ((own + now) * length(holding[i : i + 2], 1 - pulled) / (kinetic[i] + (1 - pulled)) - own)
        return rows

    def directed(self, holding: ca.SX, bounds: ca.SX, side: ca.SX, gain: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Directions in which all rows slide, and the slip speeds in the laws, by the forces and bounds of the trial."""
        side = ca.SX(side)
        speeds = []
        self.pace, self.directions, self.along = {}, {}, {}
        for i in self.places:
            follows = self.elements[i + 1].mode
            v, H = self.slip[i : i + 2], holding[i : i + 2]
            pace = self.pace[i] = bounds[i] * (gain[i, i] + gain[i + 1, i + 1]) / 2
            pull = -H / length(H, 1 - self._pulled(i))
            ahead = v + pace * self.times[1] * pull
            self.along[i] = ca.dot(v, pull)
            self.directions[i] = follows * v / self._speed(i) + (1 - follows) * ahead / length(ahead, 1 - self._pulled(i))
            side[i : i + 2] = self.elements[i].mode ** 2 * self.directions[i]
            speeds.append(follows * self._speed(i) + (1 - follows) * self.along[i])
        return side, ca.vertcat(*speeds)

    def rounded(self, terms: ca.SX, force: ca.SX, holding: ca.SX, held: ca.SX) -> ca.SX:
        """Return the terms of all forces. Contacts whose force follows the pull get the round-off of the trial added.

        held: the terms of the forces of the trial, of which a component of the pull can be no more than the round-off, as where another contact holds it.
        """
        terms = ca.SX(terms)
        for i in self.places:
            pulled = self._pulled(i)
            terms[i : i + 2] += pulled * length(force[i : i + 2]) * held[i : i + 2] / length(holding[i : i + 2], 1 - pulled)
        return terms

    def moving_at(self, rates: ca.SX) -> None:
        """Set two speeds of each contact: slip counts as ended below `least`, and the force has the direction of the slip from `most`
        on."""
        stop, start, share = ca.vertsplit(self.times)
        self.least, self.most = {}, {}
        for i in self.places:
            pace = self.pace[i]
            speeding = ca.sumsqr(rates[i : i + 2]) / ((share * pace) ** 2 + 1e-300)
            self.least[i], self.most[i] = pace * stop, pace * (2 * stop + start * ca.exp(-speeding))

    def guards(self, i: int, stuck: ca.SX, limit: ca.SX) -> tuple[ca.SX, ca.SX] | None:
        """Return the two guards of element i if it is a friction with two directions, or the second direction of such a friction; None for
        any other element."""
        if i in self.places:
            mode, follows, loaded = self.elements[i].mode ** 2, self.elements[i + 1].mode, self.loaded[i]
            inside = (limit[i] ** 2 - ca.sumsqr(stuck[i : i + 2])) / length(stuck[i : i + 2], limit[i] ** 2)
            moving = follows * (self._speed(i) - self.least[i]) + (1 - follows) * self.along[i]
            return limit[i] + mode * (loaded * moving + 1 - loaded), inside + mode
        if self.elements[i].second:  # away from the pull it follows the slip, as the loops see to
            follows = self.elements[i].mode
            return follows + (1 - follows) * (self.most[i - 1] - self.along[i - 1]), ca.SX(1)
        return None

    def probed(self, slip: ca.SX, rate: ca.SX, force: ca.SX, bound: ca.SX, pace: ca.SX) -> tuple[ca.SX, ...]:
        """Return the values by which the loops decide the modes: slip speed, its rate, and minus the size of the force of each contact. The
        sign makes slip mode 1.

        In the place of the second direction stand both slips, with which no mode is decided.
        """
        slip, rate, force, pace = (ca.SX(ca.densify(each)) for each in (slip, rate, force, pace))
        for i in self.places:
            slip[i] = ca.sqrt(ca.sumsqr(self.slip[i : i + 2]))
            rate[i] = ca.dot(self.directions[i], rate[i : i + 2])
            force[i] = -ca.sqrt(ca.sumsqr(force[i : i + 2]))
            pace[i] = self.pace[i]
            slip[i + 1], rate[i + 1], force[i + 1], pace[i + 1] = self.slip[i], self.slip[i + 1], 0, 0
        return slip, rate, force, bound, pace

    def check_loads(self, attached: Sequence[int]) -> None:
        """Raise SceneError if a rigid contact presses a friction of two directions, because its impacts would need impulses in a cone."""
        for i in self.places:
            if attached[i] >= 0:
                name, rigid = self.elements[i].name, self.elements[attached[i]].name
                raise SceneError(
                    f"The load of `{name}`, which slips in two directions, must not come from the rigid contact `{rigid}`: give `{rigid}` a `stiffness` in "
                    "place of a restitution."
                )


def check_one_direction(elements: Sequence[Element], what: str, remedy: str) -> None:
    """Raise SceneError if an element is a friction with two slip directions. In the message, `what` is the feature for one direction only,
    and `remedy` the way out."""
    for element in elements:
        if element.directions > 1:
            raise SceneError(f"{what} knows friction with one slip direction, but `{element.name}` has two: {remedy}.")
