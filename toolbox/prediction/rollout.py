"""Predicted motion of a plant under held inputs, with derivatives: the exact hybrid flow, or the same with regularised friction.

A rollout holds the inputs over N intervals, and gives the state at their ends with its derivatives with respect to the state and the inputs at their
beginnings. Steps are Runge-Kutta steps of order four and fixed length; a contact that releases or sticks inside a step cuts it where its guard crosses
zero. Across a switch at time s the derivatives jump by the saltation matrix

    dx+ = dx- + (f- - f+) ds,   ds = -(g_x dx- + g_u du) / (g_x f-),   g the guard that crosses zero

so that the result is the derivative of the hybrid flow along its own sequence of modes. Source: R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of
Non-Smooth Mechanical Systems, Springer 2004, chapter 7.

Why peaks are matched: tanh(v / width) times a falling law has a peak below the static bound, and a prediction with that peak believes in a release
that does not come. `regularised` adds what is missing, within a few widths of rest:

    F(v) = -load tanh(v / width) [mu(|v|) + b exp(-|v| / (2 width))],   b such that max |F| = load mu_static
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from toolbox.compilation.emitter import Body, compiled, function_text, inline
from toolbox.errors import SceneError
from toolbox.modelling.elements import Element
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.regularisation import Regularisation
from toolbox.modelling.switching import switching
from toolbox.modelling.two_directions import check_one_direction
from toolbox.prediction.rollout_loop import Motion, advance_rollout


class Rollout:
    """Compiled prediction of a plant: `advance` computes states and derivatives, `states` computes only the states and is faster.

    Modes are 0 (stick), 1 and -1 (slip in either direction). `scale` holds one factor per contact, which multiplies the
    load of the contact. Values may be written into the array `scale`.

    Parameters
    ----------
    plant
        A plant whose contacts are `DryFriction`.
    actuated_signals
        Names of the inputs that vary. All other inputs have their default values.
    interval
        Length of an interval with constant inputs [s].
    steps
        Number of Runge-Kutta steps per interval.
    regularisation
        Result of `regularised`. None for exact modes.

    Raises
    ------
    SceneError
        If the plant has other elements or depends on time.

    Examples
    --------
    >>> import numpy as np
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.authoring import Rollout
    >>> rollout = Rollout(compose(wells.JANSEN_2, BitRock()), ["top.torque"], interval=0.1, steps=2)
    >>> states, modes = rollout.states(np.array([15.0, 10.0, 10.0]), np.full((5, 1), 12e3))
    >>> print(states[-1].round(2), modes[-1])
    [15.34 10.13  8.83] [1.]
    """

    def __init__(
        self,
        plant: HybridSystem,
        actuated_signals: Sequence[str],
        interval: float,
        steps: int,
        regularisation: Regularisation | None = None,
    ):
        check_one_direction(plant.elements, "A prediction", "predict with a plant that has a contact for each direction")
        for element in plant.elements:
            if element.law is None or element.companions:
                raise SceneError(
                    f"A prediction knows contacts with dry friction without breaks, but `{element.name}` is a {type(element).__name__}."
                )
        if ca.depends_on(plant.flow, plant.t):
            raise SceneError("A prediction must not depend on time, but the equations of this plant do.")
        self.plant, self.actuated_signals, self.interval, self.steps, self.regularisation = (
            plant,
            tuple(actuated_signals),
            float(interval),
            int(steps),
            regularisation,
        )
        self.columns = np.array([list(plant.inputs).index(name) for name in actuated_signals], np.int64)
        self.inputs = np.array(plant.input_defaults(plant.values)).ravel()
        self.numbers = np.append(plant.values, np.ones(len(plant.elements)))
        self.n, self.contacts = plant.x.numel(), 0 if regularisation else len(plant.elements)
        self.slip = self._slip() if self.contacts else None
        self._compile()

    @property
    def scale(self) -> np.ndarray:
        """Factor of the load of each contact, shape (contacts,). Values may be written into this array."""
        return self.numbers[self.plant.values.size :]

    def __reduce__(self) -> Any:
        """A rollout travels as its arguments and factors."""
        return _rollout_again, (self.plant, self.actuated_signals, self.interval, self.steps, self.regularisation, self.scale.copy())

    def __deepcopy__(self, memo: Any) -> Rollout:
        twin = object.__new__(type(self))  # `copy.copy` would compile again
        template = Motion(*(each.copy() for each in self.template))
        twin.__dict__.update(self.__dict__, inputs=self.inputs.copy(), numbers=template.p, template=template)
        return twin

    def modes(self, state: np.ndarray) -> np.ndarray:
        """Return the mode of each contact at a state, shape (contacts,): the sign of its slip, 0 if the slip is exactly zero.

        Parameters
        ----------
        state
            States of the plant, shape (n,).
        """
        if not self.contacts:
            return np.zeros(0)
        if self.slip is not None:
            rows, offset = self.slip
            return np.sign(rows @ state + offset)
        slips = self.plant.slip_function(0.0, state, self.inputs, self.plant.values, np.zeros(self.contacts))
        return np.sign(np.array(slips).ravel())

    def _slip(self) -> tuple[np.ndarray, np.ndarray] | None:
        """(rows, offset) where all slips are rows x + offset, which is most plants; else None."""
        plant = self.plant
        slips = ca.vertcat(*[element.slip for element in plant.elements])
        rows = ca.jacobian(slips, plant.x)
        if ca.depends_on(rows, plant.x) or ca.depends_on(slips, ca.vertcat(plant.u, plant.m)):
            return None
        found = ca.Function("slip", [plant.x, plant.p, plant.t], [ca.densify(rows), ca.densify(slips)])
        values = found(np.zeros(self.n), plant.values, 0.0)
        return np.array(values[0]), np.array(values[1]).ravel()

    def advance(
        self, state: np.ndarray, inputs: np.ndarray, interval: float | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return states (N+1, n), derivatives dx_(k+1)/dx_k (N, n, n) and dx_(k+1)/du_k (N, n, n_u), and modes (N+1, contacts).

        Parameters
        ----------
        state
            States at the beginning, shape (n,).
        inputs
            Inputs of each interval, shape (N, n_u), in the order of `actuated_signals`.
        interval
            Length of an interval [s], with the same number of steps. By default the length that was given for the
            rollout.
        """
        motion = self.motion(state, inputs, interval, derivatives=True)
        advance_rollout(motion)
        return motion.X, motion.A, motion.B, motion.M

    def states(self, state: np.ndarray, inputs: np.ndarray, interval: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return states (N+1, n) and modes (N+1, contacts) for inputs of N intervals.

        Parameters
        ----------
        state
            States at the beginning, shape (n,).
        inputs
            Inputs of each interval, shape (N, n_u), in the order of `actuated_signals`.
        interval
            Length of an interval [s], with the same number of steps. By default the length that was given for the
            rollout.
        """
        motion = self.motion(state, inputs, interval)
        advance_rollout(motion)
        return motion.X, motion.M

    def motion(self, state: np.ndarray, inputs: np.ndarray, interval: float | None = None, derivatives: bool = False) -> Motion:
        """Return the arrays of a motion, which `advance_rollout` or the compiled loop of a controller fills.

        They have room for N + 1 states of the plant, and hold the state at the beginning.

        Parameters
        ----------
        state
            States at the beginning, shape (n,).
        inputs
            Inputs of each interval, shape (N, n_u), in the order of `actuated_signals`.
        interval
            Length of an interval [s], with the same number of steps. By default the length that was given for the
            rollout.
        derivatives
            Whether derivatives are computed, too, by default False.
        """
        count, n = inputs.shape[0], self.n
        X, M = np.empty((count + 1, n)), np.zeros((count + 1, self.contacts))
        X[0], M[0] = state, self.modes(state)
        many = count if derivatives else 0
        A, B = np.empty((many, n, n)), np.empty((many, n, len(self.actuated_signals)))
        length = self.template.interval if interval is None else np.array([interval], float)
        return self.template._replace(interval=length, X=X, M=M, U=np.ascontiguousarray(inputs, float), A=A, B=B)

    def _compile(self) -> None:
        """Machine code of a step, of a step with its derivatives, and of what a switch needs."""
        plant = self.plant
        scale, h = ca.SX.sym("scale", len(plant.elements)), ca.SX.sym("h")
        twins, flow = [], plant.flow
        for i, element in enumerate(plant.elements):
            twin = copy.copy(element)
            twin.load, twin.static = scale[i] * element.load, scale[i] * element.static
            if self.regularisation is not None:
                declared = copy.copy(twin)
                declared.law = _declared_law(plant, element)
                flow = ca.substitute(flow, plant.F[i], self.regularisation(declared))
            else:
                twins.append(twin)
        form = switching(plant.t, plant.x, flow, twins)
        x, u, m = plant.x, plant.u, plant.m
        p = ca.vertcat(plant.p, scale)
        at = [x, u, p, m]
        field = ca.Function("field", at, [ca.substitute(form.field, plant.t, 0)])
        guard = ca.densify(ca.substitute(form.guards[: 2 * len(twins)], plant.t, 0))  # behind them come kinks, over which a plan steps
        guards = ca.Function("guards", at, [guard])
        a = field(*at)
        b = field(x + h / 2 * a, u, p, m)
        c = field(x + h / 2 * b, u, p, m)
        d = field(x + h * c, u, p, m)
        end = x + h / 6 * (a + 2 * b + 2 * c + d)
        driven = u[self.columns.tolist()]
        move = ca.vertcat(ca.densify(end), guards(end, u, p, m))
        slope = [ca.vec(ca.densify(ca.jacobian(end, v)).T) for v in (x, driven)]
        edge = [ca.densify(a), guard, *[ca.vec(ca.densify(ca.jacobian(guard, v)).T) for v in (x, driven)], ca.densify(form.projected)]
        texts, declared_names, instructions = [], set(), 0
        for name, expression in (("move", move), ("slope", ca.vertcat(move, *slope)), ("edge", ca.vertcat(*edge))):
            function = ca.Function(name, [h, *at], [expression])
            body = Body()
            places = {1: "%x", 2: "%k", 3: "%p", 4: "%m"}
            loaded = [["%h"], *([body.load(place, j) for j in range(function.numel_in(i))] for i, place in places.items())]
            (values,) = inline(body, function, loaded)
            for i, value in enumerate(values):
                body.store(value, "%y", i)
            texts.append(function_text(name, body))
            declared_names |= body.declarations
            instructions += body.count
        found = compiled("\n".join([*texts, *sorted(declared_names)]), ["move", "slope", "edge"], instructions)
        ints = np.array([found["move"], found["slope"], found["edge"], self.steps], np.int64)
        n, ne, wide, none, empty = self.n, self.contacts, self.n + len(self.actuated_signals), np.empty((0, 0)), np.empty((0, 0, 0))
        y, z = np.empty(n + 2 * ne + n * wide), np.empty(2 * n + 2 * ne * (1 + wide))
        self.template = Motion(
            ints, np.array([self.interval]), self.inputs.copy(), self.columns, self.numbers, none, none, none, empty, empty,
            np.empty(n), np.zeros(ne), y, z, np.empty(n), np.empty(wide), np.empty((n, wide)), np.empty((n, wide)),
        )  # fmt: skip


def _declared_law(plant: HybridSystem, element: Element) -> Any:
    """The friction law of a contact with the numbers of the declared plant."""
    for part in plant.parts:
        law = getattr(part, "friction", None)
        if law is not None and type(law) is type(element.law):
            return law
    raise SceneError(f"`{element.name}` cannot be regularised: no part of the plant holds its law as `friction`.")


def _rollout_again(plant: Any, actuated_signals: Any, interval: float, steps: int, regularisation: Any, scale: np.ndarray) -> Rollout:
    """A rollout from what `Rollout.__reduce__` gives."""
    made = Rollout(plant, actuated_signals, interval, steps, regularisation)
    made.scale[:] = scale
    return made
