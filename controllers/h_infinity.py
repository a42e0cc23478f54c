"""H-infinity control of the top drive from its speed alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from controllers.bumpless import acting, begun
from controllers.observers.linear import refuse_swinging
from controllers.string_model import drilling_point, entries, with_entries
from controllers.torque_limits import TorqueLimits
from toolbox import Equations, Quantity, SceneError, Update, quantity, state
from toolbox.authoring import halved
from toolbox.modelling import OptionalQuantities, OptionalQuantity


@dataclass(frozen=True)
class HInfinity(TorqueLimits):
    """H-infinity controller of the top drive from the top speed: it minimises the worst-case gain from disturbances to errors.

        u = u_0 + K(s) (1 + integrator_leak / s) (w_top - reference)
        || (T_bit / disturbance_scale, n / speed_noise) -> (w_bit / bit_speed_scale, z / angle_scale, u / torque_scale) || < gamma

    - K(s) is the computed controller, u the torque of the drive and u_0 the torque at the operating point. w_top and
      w_bit are the speeds of top and bit. T_bit is a disturbance of the bit torque and n the error of the measured top
      speed.
    - z is the error of the top speed filtered with 1 / (s + integrator_leak). A true integral is not possible here: a
      constant measurement error would make it grow without bound, so no controller would have a finite norm.
    - K without an integrator leaves a steady speed error under an unknown load. The factor 1 + integrator_leak / s,
      which is not part of the norm, turns the slowest pole of K into an integrator. It changes nothing at frequencies
      well above `integrator_leak`.

    `design` does three steps:

    1. It linearises the plant with the bit sliding at `reference`.
    2. It finds the smallest norm that any controller reaches.
    3. It returns the central controller for `norm_factor` times the smallest norm, because this controller is better
       conditioned than the controller of the smallest norm.

    The states of K are an observer of the string under the worst disturbance. With torque limits the observer uses the
    limited torque, and the integral stops while the torque is limited (anti-windup). In the sampled form states and
    integral are initialised at steady state under the present torque (bumpless start, `controllers.bumpless`).

    Range of validity: near the operating point.

    Source: J. C. Doyle, K. Glover, P. P. Khargonekar, B. A. Francis, IEEE Trans. Automatic Control 34 (1989) 831-847.

    Examples
    --------
    >>> from controllers import HInfinity
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), HInfinity(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      HInfinity, continuous: reference 60 rpm, bit_speed_scale 19.1 rpm, angle_scale 8 rad, torque_scale 3000 N m,
        disturbance_scale 1000 N m, speed_noise 0.2865 rpm, integrator_leak 0.005 1/s, norm_factor 1.2, operating_torque
        10546 N m, gamma 2.468
    """

    reference: Quantity = quantity(8.0, "rad/s", "set-point of the speed", above=0, typical_range=(0.05, 40.0))
    bit_speed_scale: Quantity = quantity(2.0, "rad/s", "scale of the bit speed in the norm", above=0)
    angle_scale: Quantity = quantity(8.0, "rad", "scale of the integral in the norm", above=0)
    torque_scale: Quantity = quantity(3000.0, "N m", "scale of the torque in the norm", above=0)
    disturbance_scale: Quantity = quantity(1000.0, "N m", "disturbance of the bit torque", above=0)
    speed_noise: Quantity = quantity(0.03, "rad/s", "error of the measured top speed", above=0)
    integrator_leak: Quantity = quantity(0.005, "1/s", "pole of the weight on the top speed", above=0)
    norm_factor: Quantity = quantity(1.2, "1", "allowed norm as a multiple of the smallest norm", above=1)
    order: int = 0
    nonzero_indices: tuple[int, ...] = ()
    controller_matrices: OptionalQuantities = quantity(
        None,
        "1",
        "A of K where `nonzero_indices` says (everywhere if it is empty), B, C, and its drive column, row by row; filled in by design",
    )
    operating_torque: OptionalQuantity = quantity(None, "N m", "u_0; filled in by design")
    initial_state_map: OptionalQuantities = quantity(None, "1", "states of K at rest per torque beyond u_0, then K(0); filled in by design")
    gamma: OptionalQuantity = quantity(None, "1", "bound of the norm; filled in by design")

    def design(self, plant):
        """Return a copy of the controller with the matrices, the operating torque and the norm `gamma` computed on the plant.

        If `controller_matrices` is given, the method returns this controller unchanged. Raises SceneError if no controller
        has a finite norm on this plant.

        Parameters
        ----------
        plant
            The plant on which the controller is designed.
        """
        if self.controller_matrices is not None:
            return self
        model, x, u, A = drilling_point(plant, self.reference)
        n = x.size
        F = np.block([[A, np.zeros((n, 1))], [model.top[None, :], np.array([[-self.integrator_leak]])]])
        B1 = np.append(-model.E, 0.0)[:, None] * self.disturbance_scale
        B2 = np.append(model.B, 0.0)[:, None] * self.torque_scale
        C1 = np.vstack([np.append(model.bit, 0.0) / self.bit_speed_scale, np.append(np.zeros(n), 1 / self.angle_scale)])
        C2 = np.append(model.top, 0.0)[None, :] / self.speed_noise
        none = SceneError("HInfinity found no stabilising law at this point: choose another `reference` or other sizes.")
        low, high = 0.0, 1.0
        while central_law(F, B1, B2, C1, C2, high) is None:
            low, high = high, 2 * high
            if high > 1e6:
                raise none
        _, high = halved(lambda gamma: central_law(F, B1, B2, C1, C2, gamma) is not None, low, high, 1e-4)
        law = central_law(F, B1, B2, C1, C2, self.norm_factor * high)
        if law is None:
            raise none
        A_K, B_K, C_K = law
        places = entries(A_K)
        numbers = [A_K.ravel()[list(places)], B_K / self.speed_noise, C_K * self.torque_scale, B2 / self.torque_scale]
        matrices = np.concatenate([matrix.ravel() for matrix in numbers])
        begins = -np.linalg.solve(A_K, B_K.ravel() / self.speed_noise)
        steady = float(C_K.ravel() @ begins) * self.torque_scale
        return replace(
            self, order=n + 1, nonzero_indices=places, controller_matrices=tuple(matrices.tolist()), operating_torque=u,
            initial_state_map=(*(begins / steady).tolist(), steady), gamma=self.norm_factor * high,
        )  # fmt: skip

    def check_period(self, period):
        """Raise SceneError if the sample time is too long.

        The states of K move by one Runge-Kutta step per sample. If the sample time is too long, states that should
        decay grow. This is checked with and without active torque limits.

        Parameters
        ----------
        period
            Sample time [s].
        """
        if self.controller_matrices is None:
            return
        n = self.order
        _, C, drive = np.reshape(self.controller_matrices[-3 * n :], (3, n))
        A = np.zeros((n, n))
        A.ravel()[list(self.nonzero_indices) or slice(None)] = self.controller_matrices[: -3 * n]
        free, cut = np.linalg.eigvals(A), np.linalg.eigvals(A - np.outer(drive, C))
        rates = np.concatenate([free[free.real <= 0.0], cut if self.limits_known else []])
        refuse_swinging(type(self).__name__, rates, period, "A larger `speed_noise` has slower poles.")

    def continuous(self, signal):
        x, angle, rate, turning, command, _ = self._law(signal, None)
        return Equations(flow={x: rate(x), angle: turning}, outputs={"top.torque": (command, "N m")})

    def sampled(self, signal, period):
        x, angle, rate, turning, command, memory = self._law(signal, period)
        a = rate(x)
        b = rate(x + period / 2 * a)
        c = rate(x + period / 2 * b)
        d = rate(x + period * c)
        memory = {x: x + period / 6 * (a + 2 * b + 2 * c + d), angle: angle + period * turning, **memory}
        beyond = acting(signal) - self.operating_torque
        starts = {
            x: ca.vertcat(*self.initial_state_map[:-1]) * beyond,
            angle: (beyond / self.initial_state_map[-1] - self._error(signal)) / self.integrator_leak,
        }
        return begun(Update(memory, {"top.torque": (command, "N m")}), signal, "hinfinity", starts)

    def _column(self, name):
        """B, C or the drive column of K."""
        n, place = self.order, ("B", "C", "drive").index(name)
        many = len(self.nonzero_indices) or n * n
        return ca.vertcat(*self.controller_matrices[many + place * n : many + (place + 1) * n])

    def _error(self, signal):
        return signal("top.speed", "rad/s") - signal("top.reference", "rad/s", default=self.reference)

    def _law(self, signal, period):
        if self.controller_matrices is None or self.operating_torque is None or self.initial_state_map is None:
            raise SceneError("HInfinity needs the plant it acts on: call `design(plant)`.")
        n = self.order
        A = with_entries((n, n), self.nonzero_indices, ca.vertcat(*self.controller_matrices[: len(self.nonzero_indices) or n * n]))
        B, C, drive = self._column("B"), self._column("C").T, self._column("drive")
        x, angle = state("hinfinity.state", "1", n), state("hinfinity.angle", "rad")
        error = self._error(signal)
        wanted = self.operating_torque + C @ x
        command, memory = self.limited(wanted, period)
        # A holds drive C: the observer knows its own torque, of which the limits take something away
        cut = 0 if command is wanted else drive * (command - wanted)
        turning = error if command is wanted else error * (command == wanted)
        return x, angle, lambda z: A @ z + B * (error + self.integrator_leak * angle) + cut, turning, command, memory


def central_law(
    A: np.ndarray, B1: np.ndarray, B2: np.ndarray, C1: np.ndarray, C2: np.ndarray, level: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return (A_K, B_K, C_K) of the central law u = K y with a norm below `level`, or None if no law reaches it.

    Plant: x' = A x + B1 d + B2 u, counted (C1 x, u), measured y = C2 x + n; norm from (d, n) to what is counted. With the stabilising solutions of
    A'X + X A + X (B1 B1' / level^2 - B2 B2') X + C1'C1 = 0 and A Y + Y A' + Y (C1'C1 / level^2 - C2'C2) Y + B1 B1' = 0, both >= 0, and spectral radius of
    X Y below level^2.
    """
    X = _riccati(A, B1 @ B1.T / level**2 - B2 @ B2.T, C1.T @ C1)
    Y = _riccati(A.T, C1.T @ C1 / level**2 - C2.T @ C2, B1 @ B1.T)
    if X is None or Y is None or np.abs(np.linalg.eigvals(X @ Y)).max() >= level**2:
        return None
    F, L = -B2.T @ X, -Y @ C2.T
    Z = np.linalg.inv(np.eye(A.shape[0]) - Y @ X / level**2)
    return A + B1 @ B1.T @ X / level**2 + B2 @ F + Z @ L @ C2, -Z @ L, F


def _riccati(A: np.ndarray, R: np.ndarray, Q: np.ndarray) -> np.ndarray | None:
    """The stabilising solution X >= 0 of A'X + X A + X R X + Q = 0 from the stable subspace of its Hamiltonian; None where there is none."""
    from scipy.linalg import schur

    n = A.shape[0]
    hamiltonian = np.block([[A, R], [-Q, -A.T]])
    if np.abs(np.linalg.eigvals(hamiltonian).real).min() < 1e-9:
        return None
    _, basis, stable = schur(hamiltonian, sort="lhp")
    if stable != n or np.linalg.cond(basis[:n, :n]) > 1e12:
        return None
    X = np.linalg.solve(basis[:n, :n].T, basis[n:, :n].T).T
    X = (X + X.T) / 2
    return X if np.linalg.eigvalsh(X).min() > -1e-9 * max(np.abs(X).max(), 1.0) else None
