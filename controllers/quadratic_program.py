"""Dense quadratic programs of predictive laws, solved again and again with other vectors, and the check that every answer must pass.

    minimise 1/2 z' H z + g' z   subject to   low <= (z, A z) <= high

An answer counts only if it passes its own Karush-Kuhn-Tucker conditions here, whatever the solver says of it: a solver may report success with violated
bounds, most of all when it is started warm.

Which solver: daqp (active sets) is fastest on condensed programs, most of all through its own package (extra `mpc`), which keeps what it knows of the matrices
from sample to sample, where the plug-in of casadi begins anew; piqp (interior points) is slower and steady; osqp (first order) is slow, most of all in
the tail, where many limits are active and it may stop short of an answer that counts; qrqp often fails on these programs, which the check notices. hpipm
is left out: how many of these programs it misses depends on the processor (one or two in a hundred and fifty). `studies/benchmarks/mpc_speed.py`
measures the others.

Why not one interface to all, such as qpsolvers: it took 2.7 times as long.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from toolbox import SceneError
from toolbox.authoring import announced, time_left

SOLVERS = ("daqp", "piqp", "osqp", "proxqp", "qrqp")
"""Solvers by name: osqp through its own interface, daqp too where its package is installed, the others as they ship with casadi."""

TOLERANCE = 1e-6
"""The largest KKT residual of an answer that counts: plans that two solvers of a drilling law agree to count differ in their first torque by less than 1e-4 of
its limit. osqp and proxqp, which are of first order, are asked for 1e-8 and 1e-9."""


@dataclass(frozen=True)
class Residuals:
    """Distance of an answer from the optimum, as fractions of the sizes of the compared terms.

    stationarity: |H z + g + y_z + A' y_A|;  violation: how far outside its bounds (z, A z) is;  complementarity: the largest multiplier times its distance
    from its bound. All are 0 at the optimum, and inf where the answer is not finite.
    """

    stationarity: float
    violation: float
    complementarity: float

    @property
    def largest(self) -> float:
        """The largest of the three."""
        return max(self.stationarity, self.violation, self.complementarity)


def residuals(H: np.ndarray, A: np.ndarray, g: np.ndarray, low: np.ndarray, high: np.ndarray, z: np.ndarray, y: np.ndarray) -> Residuals:
    """The KKT residuals of z with multipliers y (of the bounds on z, then on A z; positive at `high`, negative at `low`)."""
    from controllers.condensing import Check, kkt

    found = np.empty(3 + z.size)
    kkt(Check(H, A, g, low, high, z, y, found))
    return Residuals(*found[:3].tolist())


@dataclass(frozen=True)
class Answer:
    """z and its multipliers, whether they passed the check, and why not."""

    z: np.ndarray
    multipliers: np.ndarray
    sound: bool
    reason: str
    residuals: Residuals


class QuadraticProgram:
    """A program of n unknowns and m rows for one of `SOLVERS`; H and A may change in place between solutions.

    warm: start from the last sound answer. Raises SceneError for an unknown solver.
    """

    def __init__(self, H: np.ndarray, A: np.ndarray, solver: str = "daqp", warm: bool = True):
        if solver not in SOLVERS:
            raise SceneError(f"Argument `solver` must be one of {', '.join(SOLVERS)}, but it is {solver!r}.")
        from controllers.condensing import kkt

        announced("check of quadratic programs", kkt)
        self.solver, self.warm = solver, warm
        self.H, self.A = np.array(H, float), np.array(A, float).reshape(-1, H.shape[0])
        self._start()

    def _start(self) -> None:
        self._call: Any = interface(self.solver)(self.solver, self.H, self.A)

    def __getstate__(self) -> dict[str, Any]:
        """A program travels without its solver, which starts again, cold: the next answer is the same but for round-off."""
        return {name: value.copy() if isinstance(value, np.ndarray) else value for name, value in self.__dict__.items() if name != "_call"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._start()

    def update(self, H: np.ndarray, A: np.ndarray) -> None:
        """Other matrices of the same shape, in place."""
        self.H[:], self.A[:] = H, A
        self._call.matrices(self.H, self.A)

    def solve(self, g: np.ndarray, low: np.ndarray, high: np.ndarray) -> Answer:
        """Return the answer for these vectors. An unsolvable program raises no error, but a run ends if its seconds are used up."""
        left = time_left()
        if not (np.isfinite(g).all() and not np.isnan(low).any() and not np.isnan(high).any()):
            nothing = np.full(g.size + self.A.shape[0], np.nan)
            return Answer(nothing[: g.size], nothing, False, "the problem is not finite", Residuals(np.inf, np.inf, np.inf))
        try:
            z, y = self._call(g, low, high, left)
        except RuntimeError as error:  # a plug-in that gives up
            z, y = np.full(g.size, np.nan), np.full(low.size, np.nan)
            self._call.forget()
            return Answer(z, y, False, f"{self.solver} stopped: {str(error).splitlines()[-1]}", Residuals(np.inf, np.inf, np.inf))
        found = residuals(self.H, self.A, g, low, high, z, y)
        sound = found.largest <= TOLERANCE
        if not sound or not self.warm:
            self._call.forget()
        reason = "" if sound else f"KKT residual {found.largest:.1e} of the answer of {self.solver}, violation {found.violation:.1e}"
        return Answer(z, y, sound, reason, found)


def interface(solver: str) -> Any:
    """Return the class that calls a solver."""
    own = {"osqp": _Osqp} | ({"daqp": _Daqp} if importlib.util.find_spec("daqp") else {})
    return own.get(solver, _Plugin)


class _Plugin:
    """A solver that ships with casadi, called through buffers that stay where they are."""

    def __init__(self, solver: str, H: np.ndarray, A: np.ndarray):
        n, m = H.shape[0], A.shape[0]
        quiet = {"print_iter": False, "print_header": False, "print_info": False}
        special: dict[str, dict[str, Any]] = {
            "qrqp": quiet | {"max_iter": 200},
            "daqp": {"daqp": {"iter_limit": 400}},
            "proxqp": {"proxqp": {"eps_abs": 1e-9, "eps_rel": 0.0}},
        }
        options = {"error_on_fail": False, "print_time": False} | special.get(solver, {})
        self.function = ca.conic("program", solver, {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(m, n)}, options)
        buffer: Any
        buffer, self.trigger = self.function.buffer()
        self.buffer = buffer
        self.given = {name: np.zeros(self.function.numel_in(name)) for name in self.function.name_in()}
        self.found = {name: np.zeros(self.function.numel_out(name)) for name in self.function.name_out()}
        for i, array in enumerate(self.given.values()):
            buffer.set_arg(i, array.data)
        for i, array in enumerate(self.found.values()):
            buffer.set_res(i, array.data)
        self.n = n
        self.matrices(H, A)

    def matrices(self, H: np.ndarray, A: np.ndarray) -> None:
        self.given["h"][:], self.given["a"][:] = H.ravel(), A.T.ravel()

    def forget(self) -> None:
        for name in ("x0", "lam_x0", "lam_a0"):
            self.given[name][:] = 0.0

    def __call__(self, g: np.ndarray, low: np.ndarray, high: np.ndarray, left: float) -> tuple[np.ndarray, np.ndarray]:
        given, found, n = self.given, self.found, self.n
        given["g"][:] = g
        given["lbx"][:], given["ubx"][:], given["lba"][:], given["uba"][:] = low[:n], high[:n], low[n:], high[n:]
        self.trigger()
        for name in ("x", "lam_x", "lam_a"):
            given[f"{name}0"][:] = found[name]
        return found["x"].copy(), np.concatenate([found["lam_x"], found["lam_a"]])


DAQP_FLAGS = {-1: "nothing keeps all limits", -2: "it goes in circles", -4: "its iterations are used up"}
"""What it means that DAQP ends with a flag below 0."""


class _Daqp:
    """DAQP through its own interface, which starts from its last active set (D. Arnström, A. Bemporad, D. Axehill, IEEE Trans. Autom. Control 67 (2022)).

    Other matrices, and an end without an answer, begin anew: with an active set of other matrices it may end in numbers that are not finite (0.11).
    """

    def __init__(self, solver: str, H: np.ndarray, A: np.ndarray):
        self.H, self.A = H, A
        self.model: Any = None

    def matrices(self, H: np.ndarray, A: np.ndarray) -> None:
        self.forget()

    def forget(self) -> None:
        self.model = None

    def __call__(self, g: np.ndarray, low: np.ndarray, high: np.ndarray, left: float) -> tuple[np.ndarray, np.ndarray]:
        if self.model is not None and self.model.update(f=g, bupper=high, blower=low) >= 0:
            z, _, flag, found = self.model.solve()
            if flag > 0 and np.isfinite(z).all():
                return z, found["lam"]
        import daqp

        self.model = daqp.Model()
        self.model.settings = {"primal_tol": 1e-11, "iter_limit": 400}
        flag, _ = self.model.setup(self.H, g, self.A, high, low)
        if flag >= 0:
            z, _, flag, found = self.model.solve()
        if flag <= 0:
            raise RuntimeError(DAQP_FLAGS.get(flag, f"flag {flag}"))
        return z, found["lam"]


class _Osqp:
    """OSQP through its own interface, matrices updated in place, started from its last answer (B. Stellato et al., Math. Prog. Comp. 12 (2020))."""

    def __init__(self, solver: str, H: np.ndarray, A: np.ndarray):
        import osqp

        self.program = osqp.OSQP()
        self.n, self.left = H.shape[0], np.inf
        self.upper = np.triu(np.ones_like(H)).T.astype(bool)  # transposed: scipy stores columns
        P, rows = self._sparse(H, A)
        many = rows.shape[0]
        self.program.setup(P, np.zeros(self.n), rows, np.full(many, -1.0), np.full(many, 1.0), verbose=False, eps_abs=1e-8, eps_rel=1e-9)  # fmt: skip

    def _sparse(self, H: np.ndarray, A: np.ndarray) -> tuple[Any, Any]:
        from scipy.sparse import csc_matrix

        # every entry is kept, zeros too, so that other numbers fit into the same pattern
        upper = csc_matrix(np.triu(np.ones_like(H)))
        upper.data = H.T[self.upper]
        dense = csc_matrix(np.ones((self.n + A.shape[0], self.n)))
        dense.data = np.vstack([np.eye(self.n), A]).T.ravel()
        return upper, dense

    def matrices(self, H: np.ndarray, A: np.ndarray) -> None:
        self.program.update(Px=H.T[self.upper], Ax=np.vstack([np.eye(self.n), A]).T.ravel())

    def forget(self) -> None:
        self.program.warm_start(x=np.zeros(self.n), y=np.zeros(self.program.m))

    def __call__(self, g: np.ndarray, low: np.ndarray, high: np.ndarray, left: float) -> tuple[np.ndarray, np.ndarray]:
        if left != self.left:
            self.left = left
            self.program.update_settings(time_limit=min(left, 1e10))
        self.program.update(q=g, l=np.maximum(low, -1e30), u=np.minimum(high, 1e30))
        result = self.program.solve(raise_error=False)
        return np.asarray(result.x, float), np.asarray(result.y, float)
