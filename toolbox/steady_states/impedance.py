"""What a drive does to the waves that reach it: its impedance against frequency, and how much of a wave it sends back.

A torsional wave that runs up a string with characteristic impedance zeta meets the impedance Z of whatever turns its top, and the part

    r = (zeta - Z) / (zeta + Z)

of it comes back: |r| = 1 for a drive that holds its speed or gives way to everything, 0 for one that matches. A drive that absorbs the waves at the
frequency of stick-slip cannot feed it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.arguments import finite_array, number
from toolbox.errors import SceneError
from toolbox.files.units import NumberOrText
from toolbox.modelling.components import Component, Equations
from toolbox.modelling.composition import assembled, compose
from toolbox.modelling.drive import drive_among
from toolbox.modelling.elements import Quantity, quantity, state
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import SIGNALS, Controller, Sampled, designed, names
from toolbox.steady_states.linear import linearise
from toolbox.vocabulary import new_names_only


@dataclass(frozen=True)
class _Turned(Component):
    """A shaft whose speed is imposed: it gives `motion` and forgets nothing but its angle."""

    motion: str = ""
    start: Quantity = quantity(0.0, "rad/s", "speed about which it is imposed")

    def equations(self, signal: Any) -> Equations:
        angle = state("imposed.angle", "rad")
        speed = signal("imposed.speed", "rad/s", default=self.start)
        return Equations(flow={angle: speed}, outputs={self.motion: (speed, "rad/s")})


@new_names_only
def impedance(
    *parts: Component | Sampled,
    frequency: Sequence[float] | np.ndarray,
    plant: HybridSystem | None = None,
    speed_signal: str | None = None,
    torque_signal: str | None = None,
    inertia: NumberOrText = 0.0,
    drag: NumberOrText = 0.0,
    speed: NumberOrText = 0.0,
    at: Mapping[str, Any] | None = None,
) -> np.ndarray:
    """Compute the impedance Z(i w) = -torque / speed of a drive at imposed speed.

        PI controller:  Z = K_p + K_i / (i w);      with the top inertia and drag:  Z = K_p + K_i / (i w) + i w J + c_r

    The impedance of a controller with limits or nested loops depends on the operating point.

    Parameters
    ----------
    parts
        The controller, and the parts between it and the string, such as a drive with lags and limits. A `Sampled`
        controller adds its hold and delay as exp(-i w (period / 2 + delay)), which is accurate well below half of the
        sampling rate.
    frequency
        Frequencies w [rad/s], > 0.
    plant
        The plant on which the controller is designed. By default None, for a controller whose gains are given.
    speed_signal, torque_signal
        Names of the speed and of the torque at the top. By default the first signals that the controller measures and
        gives.
    inertia, drag
        Inertia J [kg m2] and drag c_r [N m s/rad] of the top drive, which are added to the impedance of the parts. By
        default 0.
    speed
        Speed around which the controller is linearised [rad/s], by default 0.
    at
        {state of the controller: value} at this speed, around which the controller is linearised. States that are left
        out are 0 (by default all states).

    Returns
    -------
    complex array, shape of `frequency`
        The impedance [N m s/rad].

    Raises
    ------
    SceneError
        If a controller measures other signals than `speed_signal`, or a frequency is not positive.

    Examples
    --------
    >>> from controllers import PI
    >>> from toolbox import impedance
    >>> drive = PI(proportional=400.0, integral=200.0, reference="60 rpm")
    >>> print(impedance(drive, frequency=[0.5, 1.0, 2.0]).round(1))
    [400.-400.j 400.-200.j 400.-100.j]
    """
    w = finite_array(frequency)
    if w is None or not w.size or not (w > 0).all():
        raise SceneError(f"Argument `frequency` must be numbers > 0 rad/s, but it is {frequency!r}.")
    inertia, drag = number("inertia", inertia, "kg m2", at_least=0), number("drag", drag, "N m s/rad", at_least=0)
    speed = number("speed", speed, "rad/s")
    if plant is not None and not isinstance(plant, HybridSystem):
        raise SceneError(f"Argument `plant` must be a plant made by `compose`, but it is a {type(plant).__name__}.")
    late, own = 0.0, []
    for part in parts:
        law = part
        if isinstance(part, Sampled):
            part.check()
            late += part.period / 2 + part.delay
            law = part.law  # type: ignore[assignment]
        if not isinstance(law, Component):
            raise SceneError(f"Argument `parts` must be control laws and parts of a drive, but one is {law!r}.")
        if isinstance(law, Controller) and plant is not None:
            law = designed(law, plant)
        own.append(law)
    at_ends = [next(iter(names(getattr(each, word))), "") for each in own if isinstance(each, Controller) for word in SIGNALS][:2]
    routes = [name for part in own for name in part.redirected_signals]
    at_ends = at_ends or list(drive_among(routes, routes.__contains__) or ("", ""))
    speed_signal, torque_signal = (
        end if named is None else named for named, end in zip((speed_signal, torque_signal), at_ends, strict=True)
    )
    turned = _Turned(motion=speed_signal, start=float(speed))
    driven = compose(turned, *own) if plant is None else assembled((turned, *own))
    if not isinstance(torque_signal, str) or torque_signal not in driven.signals:
        raise SceneError(f"Argument `parts` must give the signal `{torque_signal}`, but they do not.")
    system = linearise(driven, at, inputs="imposed.speed", outputs=torque_signal)
    response = np.array([np.ravel(system(1j * each))[0] for each in w.ravel()]).reshape(w.shape)
    return -response * np.exp(-1j * w * late) + 1j * w * inertia + drag


def reflection(impedance: np.ndarray, characteristic: float) -> np.ndarray:
    """Compute the fraction of a torsional wave that the top reflects, r = (zeta - Z) / (zeta + Z).

    Parameters
    ----------
    impedance
        Impedance Z of the drive [N m s/rad], as the function `impedance` returns it.
    characteristic
        Characteristic impedance zeta of the string [N m s/rad]: I_p sqrt(G rho) of a pipe, sqrt(k J) of a lumped
        string.

    Returns
    -------
    complex array, shape of `impedance`
        The reflection coefficient [1]. 0 means that the drive absorbs the wave.

    Raises
    ------
    SceneError
        If zeta is not > 0.

    Examples
    --------
    >>> from controllers import PI
    >>> from toolbox import impedance
    >>> from toolbox.steady_states import reflection
    >>> drive = PI(proportional=400.0, integral=200.0, reference="60 rpm")
    >>> print(abs(reflection(impedance(drive, frequency=[0.5, 1.0, 2.0]), characteristic=400.0)).round(3))
    [0.447 0.243 0.124]
    """
    characteristic = number("characteristic", characteristic, "N m s/rad", above=0)
    try:
        z = np.asarray(impedance, complex)
    except (TypeError, ValueError):
        z = np.array(np.nan)
    if not np.isfinite(z).all():
        raise SceneError(f"Argument `impedance` must be finite complex numbers in N m s/rad, but it is {impedance!r}.")
    return (characteristic - z) / (characteristic + z)
