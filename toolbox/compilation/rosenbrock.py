"""Linearly implicit Runge-Kutta (Rosenbrock) methods, for plants whose fast modes die long before anything happens.

With J = df/dx at the start of a step, stage i solves one linear system, all with the same matrix:

    (1/(gamma h) - J) u_i = f(t + alpha_i h, x + sum_j a_ij u_j) + sum_j c_ij u_j / h + gamma_i h df/dt

The last stage brings the solution to x + sum_j a_sj u_j + u_s, and u_s is its error estimate. Modes whose rate times h is large are damped out
within a step (L-stability), so that the step follows what happens, not the fastest mode.

The same damping would hide a mode that grows: its factor per step is right to 2 % where h times its rate is 2, has the wrong sign at 3, and falls to zero from
1/gamma on, with no error to see where the state still is at rest. Friction that falls steeply with speed has such modes. A pivot of the elimination is
1/(gamma h) less the rate at which its state grows: where one is below 1/(gamma h) - 2/h, the step is refused. Where contacts hold each other through coupled
inertias pivots do not tell, and the eigenvalues of df/dx are asked (`toolbox.simulation.growth`).

Why linearly implicit: within a mode the equations are smooth and their derivatives are known as formulas, so that one sparse factorisation per step, unrolled
into machine code without search for pivots, replaces the Newton iterations of implicit methods; and the result is a smooth function of h, which is
what finding events by stepping to them needs.

RODAS5P: G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within the Julia Differential Equations
package, BIT Numer. Math. 63 (2023) 27, doi:10.1007/s10543-023-00967-x.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

FASTEST_GROWTH = 2.0
"""Rate of growth of a mode, times the step, up to which the step stands."""


@dataclass(frozen=True)
class Rosenbrock:
    """Numbers of a stiffly accurate method, as in the equations of this module.

    alpha: nodes of the stages;  gamma: the diagonal;  slope_weights: gamma_i, weights of df/dt;  a, c: rows of the stages. `power` is the
    exponent of the step-size rule, for the error per unit step.
    """

    name: str
    order: int
    gamma: float
    alpha: tuple[float, ...]
    slope_weights: tuple[float, ...]
    a: tuple[tuple[float, ...], ...]
    c: tuple[tuple[float, ...], ...]
    power: float
    error_low: tuple[float, ...] = ()


# fmt: off
_A6 = (-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946)

RODAS5P = Rosenbrock(
    name="rodas5p",
    order=5,
    gamma=0.21193756319429014,
    alpha=(0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1.0, 1.0, 1.0),
    slope_weights=(0.21193756319429014, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734, 2.325825639765069, 0.0, 0.0, 0.0),
    a=(
        (),
        (3.0,),
        (2.849394379747939, 0.45842242204463923),
        (-6.954028509809101, 2.489845061869568, -10.358996098473584),
        (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
        _A6,
        (*_A6, 1.0),
        (*_A6, 1.0, 1.0),
    ),
    c=(
        (),
        (-14.155112264123755,),
        (-17.97296035885952, -2.859693295451294),
        (147.12150275711716, -1.41221402718213, 71.68940251302358),
        (165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306),
        (24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471),
        (30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623, -28.087943162872662),
        (37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002, -54.66780262877968, -9.48861652309627),
    ),
    power=1 / 4,
)
# fmt: on


def factors(jacobian: ca.SX, diagonal: ca.SX, extra: int = 0) -> tuple[ca.SX, ca.Function, ca.SX]:
    """Triangular factors of `D - jacobian` as a column, the Function (factors, right side) -> solution that uses them, and the least pivot.

    D holds `diagonal` in its rows but the last `extra`, which are algebraic: their right side is zero and their unknowns are left out. The elimination is
    written out on the sparsity pattern in an order of minimum degree and without pivoting: of a chain, twists go first and speeds remain
    tridiagonal, so that there is no fill. The algebraic rows have no part in the least pivot.
    """
    size = jacobian.shape[0]
    n = size - extra
    place = [0] * size
    order = list(_both_ways(jacobian.sparsity()).amd())
    for k, i in enumerate(order):
        place[i] = k
    rows: list[dict[int, ca.SX]] = [{} for _ in range(size)]
    for k, (i, j) in enumerate(zip(*jacobian.sparsity().get_triplet(), strict=True)):
        rows[place[i]][place[j]] = -jacobian.nz[k]
    for i in range(n):
        row = rows[place[i]]
        row[place[i]] = row.get(place[i], 0) + diagonal

    values: list[ca.SX] = []
    symbols: list[ca.SX] = []

    def kept(value: ca.SX) -> ca.SX:
        values.append(value)
        symbols.append(ca.SX.sym("lu"))
        return symbols[-1]

    right = ca.SX.sym("right", n)
    reduced = [right[i] if i < n else ca.SX(0) for i in order]
    below: list[set[int]] = [set() for _ in range(size)]
    for i, row in enumerate(rows):
        for j in row:
            if j < i:
                below[j].add(i)
    places = []
    for k in range(size):
        inverse = 1 / rows[k][k]
        places.append(len(values))
        kept(inverse)
        for i in sorted(below[k]):
            factor = rows[i].pop(k) * inverse
            reduced[i] = reduced[i] - kept(factor) * reduced[k]
            for j, entry in rows[k].items():
                if j > k:
                    if j not in rows[i] and j < i:
                        below[j].add(i)
                    rows[i][j] = rows[i].get(j, 0) - factor * entry
    solution: list[ca.SX] = [ca.SX(0)] * size
    for i in reversed(range(size)):
        # scaled rows leave one operation between neighbours of a chain, which wait for each other
        known = sum((kept(entry * values[places[i]]) * solution[j] for j, entry in sorted(rows[i].items()) if j > i), ca.SX(0))
        solution[i] = reduced[i] * symbols[places[i]] - known
    answer = ca.vertcat(*[solution[place[i]] for i in range(n)])
    least = diagonal
    for k, i in enumerate(order):
        if i < n:
            least = ca.fmin(least, rows[k][k])
    return ca.vertcat(*values), ca.Function("solve", [ca.vertcat(*symbols), right], [answer]), least


def elimination(jacobian: ca.Sparsity) -> tuple[int, int]:
    """Operations at most of the factors of a matrix of this pattern in `factors`, and of a solution with them, from the pattern alone.

    With l_k entries below the diagonal in column k of the symbolic factor: sum 1 + l_k + 2 l_k^2, and 2 (2 sum l_k + n). They grow as n for a chain and as
    n^3 where everything depends on everything.
    """
    upper, _ = _both_ways(jacobian).ldl(True)
    entries = np.bincount(np.array(upper.row(), int), minlength=upper.size1())
    return int((1 + entries + 2 * entries**2).sum()), int(2 * (2 * entries.sum() + entries.size))


def _both_ways(pattern: ca.Sparsity) -> ca.Sparsity:
    """The pattern with its transpose and the diagonal."""
    ones = ca.DM(pattern, 1)
    return (ones + ones.T + ca.DM.eye(pattern.size1())).sparsity()
