"""Laws that were designed with python-control, as controllers of a plant: the way in, beside `to_control`, the way out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import mapping, number
from toolbox.errors import SceneError
from toolbox.files.units import NumberOrText
from toolbox.modelling.components import Equations, Signal, Update
from toolbox.modelling.elements import State, state
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, names
from toolbox.vocabulary import Renamed, new_names_only

Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class LinearLaw(Renamed):
    """Data of a law that a system of python-control does not hold: signals, operating point and defaults from `to_control`.

    Attributes
    ----------
    measured_signals, actuated_signals
        The signals that are its inputs and outputs.
    at
        {signal: value at the working point}.
    defaults
        {set-point: value unless it is given}.
    """

    measured_signals: tuple[str, ...]
    actuated_signals: tuple[str, ...]
    at: Mapping[str, float]
    defaults: Mapping[str, float]


@dataclass(frozen=True)
class StateSpaceLaw(Controller):
    """A linear law about a working point, made by `from_control`.

        z' = A z + B e,  u = u0 + C z + D e           continuous; sampled by Tustin's rule
        z_(k+1) = A z_k + B e_k,  u_k = u0 + C z_k + D e_k        where the system is discrete: sampled only, with its own period

    e is reference - y where there is a reference, else y - y0.
    """

    measured_signals: tuple[str, ...] = ()  # type: ignore[misc]
    actuated_signals: tuple[str, ...] = ()  # type: ignore[misc]
    matrices: tuple[Matrix, Matrix, Matrix, Matrix] = ((), (), (), ())
    dt: Any = None  # type: ignore[misc]
    discrete: bool = False
    measured_at: tuple[float, ...] = ()
    driven_at: tuple[float, ...] = ()
    reference: float | None = None
    units: tuple[str, ...] | None = None
    defaults: tuple[tuple[str, float], ...] = ()
    """(set-point, its value unless it is given)."""
    typed: tuple[tuple[str, str], ...] = ()
    """(argument, text with a unit) of numbers that the plant tells the unit of."""

    def design(self, plant: HybridSystem) -> StateSpaceLaw:
        """The law with the units of the signals of a plant."""
        unit = plant.signal_unit(self.measured_signals[0]) if self.measured_signals else "1"  # of set-points, which no plant has
        names = (*self.measured_signals, *self.actuated_signals)
        units = tuple(unit if name.endswith(".reference") else plant.signal_unit(name) for name in names)
        given = dict(self.typed)
        point = tuple(
            number(f"at.{name}", given.get(f"at.{name}", value), of)
            for name, value, of in zip(names, (*self.measured_at, *self.driven_at), units, strict=True)
        )
        reference = None if self.reference is None else number("reference", given.get("reference", self.reference), unit)
        count = len(self.measured_signals)
        return replace(self, units=units, typed=(), measured_at=point[:count], driven_at=point[count:], reference=reference)

    def continuous(self, signal: Signal) -> Equations:
        if self.discrete:
            raise SceneError(f"A discrete system is a sampled law: give `sample_time`{'' if self.dt is None else f'={self.dt:g}'}.")
        z, e = self._memory(), self._read(signal)
        a, b, c, d = self._arrays()
        return Equations(
            flow={z: ca.mtimes(a, z) + ca.mtimes(b, e)} if z is not None else {}, outputs=self._given(self._sum(c, z) + ca.mtimes(d, e))
        )

    def sampled(self, signal: Signal, period: ca.SX) -> Update:
        z, e = self._memory(), self._read(signal)
        a, b, c, d = self._arrays()
        if not self.discrete and z is not None:  # Tustin's rule
            unit = ca.SX.eye(a.shape[0])
            solved = ca.solve(unit - period / 2 * a, ca.horzcat(unit + period / 2 * a, period * b))
            before = ca.solve(unit - period / 2 * ca.SX(a).T, ca.SX(c).T).T
            a, b, c, d = solved[:, : a.shape[0]], solved[:, a.shape[0] :], before, d + ca.mtimes(before, b) * period / 2
        memory = {z: ca.mtimes(a, z) + ca.mtimes(b, e)} if z is not None else {}
        return Update(memory=memory, outputs=self._given(self._sum(c, z) + ca.mtimes(d, e)))

    def _memory(self) -> State | None:
        rows = len(self.matrices[0])
        return state("law.memory", "1", rows) if rows else None

    def _arrays(self) -> tuple[Any, ...]:
        n, inputs, outputs = len(self.matrices[0]), len(self.measured_signals), len(self.actuated_signals)
        shapes = ((n, n), (n, inputs), (outputs, n), (outputs, inputs))
        return tuple(ca.SX(ca.DM(np.array(matrix, float).reshape(shape))) for matrix, shape in zip(self.matrices, shapes, strict=True))

    def _sum(self, c: Any, z: State | None) -> Any:
        return ca.SX(len(self.actuated_signals), 1) if z is None else ca.mtimes(c, z)

    def _read(self, signal: Signal) -> ca.SX:
        if self.typed:
            raise SceneError(
                f"Argument `{self.typed[0][0]}` must be a plain number where no plant tells its unit, but it is {self.typed[0][1]!r}."
            )
        units = self.units or ("1",) * (len(self.measured_signals) + len(self.actuated_signals))
        defaults = {name: 0.0 for name in self.measured_signals if name.endswith(".reference")} | dict(self.defaults)
        read = [
            signal(name, unit, *([defaults[name]] if name in defaults else []))
            for name, unit in zip(self.measured_signals, units, strict=False)
        ]
        if self.reference is not None:
            return signal(f"{self.measured_signals[0].partition('.')[0]}.reference", units[0], default=self.reference) - read[0]
        return ca.vertcat(*read) - ca.vertcat(*self.measured_at)

    def _given(self, u: Any) -> dict[str, tuple[Any, str]]:
        units = (self.units or ("1",) * (len(self.measured_signals) + len(self.actuated_signals)))[len(self.measured_signals) :]
        return {name: (self.driven_at[i] + u[i], unit) for i, (name, unit) in enumerate(zip(self.actuated_signals, units, strict=True))}


@new_names_only
def from_control(
    system: Any,
    *,
    measured_signals: str | Sequence[str] | None = None,
    actuated_signals: str | Sequence[str] | None = None,
    reference: NumberOrText | None = None,
    at: Mapping[str, NumberOrText] | None = None,
) -> StateSpaceLaw:
    """Make a controller from a linear system of python-control.

    Parameters
    ----------
    system
        A proper `control.StateSpace` or `control.TransferFunction`. A continuous system runs continuously, or sampled
        by Tustin's rule. A discrete system runs sampled, with its period `dt` (any period if its `dt` is True).
    measured_signals
        Signals that are the inputs of the system, in order, for example "top.speed". A set-point such as
        "top.reference" may be among them, but must not be the first. By default the signals of the controller from
        which `to_control` made the system, with the defaults of their set-points.
    actuated_signals
        Signals that are the outputs of the system, in order, for example "top.torque". By default the signals of the
        controller from which `to_control` made the system.
    reference
        Set-point, in the unit of the one measured signal, or text such as "60 rpm". The input of the system is then the
        error e = reference - y, as in the usual loop with negative feedback. The value is the default of the signal
        `top.reference` (of the measured part), so a run may change it in time. By default the input of the system is y
        itself, and the output keeps its sign, as for systems from `to_control`.
    at
        Operating point: {measured or actuated signal: value}, in SI or text with units. The value is 0 for signals that
        are left out. The inputs of the system are deviations of the measured signals from these values (if there is no
        reference). The values of the actuated signals are added to its outputs. By default the operating point of the
        controller from which `to_control` made the system, if `measured_signals`, `actuated_signals` and `reference`
        are left out too.

    Returns
    -------
    StateSpaceLaw
        A controller like any other, which can be simulated, swept, mapped, judged and exported.

    Raises
    ------
    SceneError
        If the system is improper or not linear, signals are missing or do not fit its inputs and outputs, or a
        reference is given for several measured signals.

    Examples
    --------
    >>> import control
    >>> from models import BitRock, wells
    >>> from toolbox import compose, from_control, simulate
    >>> pi = control.tf([600.0, 300.0], [1.0, 0.0])
    >>> drive = from_control(pi, measured_signals="top.speed", actuated_signals="top.torque", reference="120 rpm")
    >>> run = simulate(compose(wells.JANSEN_2, BitRock(weight="60 kN")), "120 s", controller=drive)
    >>> print(f"{run['top.speed'][-1]:.2f} rad/s")
    12.57 rad/s
    """
    law: LinearLaw | None = getattr(system, "law", None)
    if law is not None and at is None and measured_signals is None and actuated_signals is None and reference is None:
        at = law.at
    defaults = law.defaults if law is not None and measured_signals is None else {}
    inputs, outputs = _names("measured_signals", measured_signals, law), _names("actuated_signals", actuated_signals, law)
    found, matrices = _state_space(system)
    for word, named, count in (("measured_signals", inputs, found.ninputs), ("actuated_signals", outputs, found.noutputs)):
        if len(named) != count:
            raise SceneError(f"Argument `{word}` must name {count} signals, as many as the system has, but it names {len(named)}.")
    if reference is not None and len(inputs) != 1:
        raise SceneError(f"Argument `reference` must come with one measured signal, but there are {len(inputs)}.")
    point = mapping("at", at)
    for name in point:
        if name not in (*inputs, *outputs):
            raise SceneError(f"Argument `at` must name signals that the law measures or drives, but `{name}` is none.")
    typed: list[tuple[str, str]] = []

    def plain(word: str, value: Any) -> float:
        if isinstance(value, str):
            typed.append((word, value))
            return 0.0
        return number(word, value)

    timing = found.dt
    discrete = timing is not None and (timing is True or timing > 0)
    return StateSpaceLaw(
        measured_signals=inputs, actuated_signals=outputs, matrices=tuple(tuple(map(tuple, matrix.tolist())) if matrix.size else () for matrix in matrices),  # type: ignore[arg-type]
        dt=float(timing) if discrete and timing is not True else None, discrete=discrete,
        measured_at=tuple(plain(f"at.{name}", point.get(name, 0.0)) for name in inputs),
        driven_at=tuple(plain(f"at.{name}", point.get(name, 0.0)) for name in outputs),
        reference=None if reference is None else plain("reference", reference), typed=tuple(typed), defaults=tuple(defaults.items()),
    )  # fmt: skip


def _names(word: str, given: str | Sequence[str] | None, law: LinearLaw | None) -> tuple[str, ...]:
    """The signals that an argument names, by default those of the law that a system was made from; raises SceneError where there is none."""
    if given is None and law is None:
        raise SceneError(
            f"Argument `{word}` must name signals, because the system was not made by `to_control` from a law with a working point."
        )
    return names(given or (getattr(law, word) if law is not None else ()))


def _state_space(system: Any) -> tuple[Any, list[np.ndarray]]:
    """A system as `control.StateSpace` with its matrices A, B, C and D; raises SceneError where it is none, improper or not finite."""
    import control

    if not isinstance(system, (control.StateSpace, control.TransferFunction)):
        raise SceneError(f"Argument `system` must be a control.StateSpace or a control.TransferFunction, but it is {system!r}.")
    try:
        found = control.ss(system)
    except (ValueError, control.ControlMIMONotImplemented) as error:
        raise SceneError(f"Argument `system` must be proper, with at least as many poles as zeros, but: {error}.") from None
    matrices = [np.atleast_2d(np.asarray(matrix, float)) for matrix in (found.A, found.B, found.C, found.D)]
    if not all(np.isfinite(matrix).all() for matrix in matrices):
        raise SceneError("Argument `system` must have finite numbers, but one is none.")
    return found, matrices
