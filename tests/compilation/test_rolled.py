"""Loops over equal rows, dense systems and bands in machine code, against casadi, numpy and the written-out code."""

import ctypes

import casadi as ca
import numpy as np
import pytest

from models import Coulomb
from studies.benchmarks.stiff import uniform
from toolbox import Component, DryFriction, Equations, compose, simulate, state
from toolbox.compilation import bodies, implicit_step
from toolbox.compilation.banded_systems import factor_text, solve_text, split
from toolbox.compilation.emitter import compiled, function_text, inline
from toolbox.compilation.rolled import Rolled, rolled_body, rolled_slope
from toolbox.compilation.vector_emitter import VectorBody
from toolbox.compilation.vector_emitter import function_text as vector_text
from toolbox.modelling import elimination
from toolbox.modelling.elimination import dense_solver, masked_solve

SIGNATURE = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_double, *[ctypes.c_void_p] * 5)


def functions(*made):
    """Compiled functions of named bodies."""
    text = [function_text(name, body) for name, body in made]
    declared = sorted(set().union(*[body.declarations for _, body in made]))
    found = compiled("\n".join([*text, *declared]), [name for name, _ in made], 0)
    return [SIGNATURE(found[name]) for name, _ in made]


def values(call, arguments, size, k=None):
    """What a compiled function of t, x, p and m writes."""
    t, *arrays = arguments
    x, p, m = (np.array(array, float) for array in arrays)
    k, y = np.zeros(1) if k is None else k, np.full(size, np.nan)
    call(t, 0.0, *(array.ctypes.data for array in (x, k, p, m, y)))
    return y


def chain(n, total=True):
    """Rows of a chain with ends of their own, equal and different numbers, kinks, powers, time, results that repeat, are constant or are zero."""
    t, x, p, m = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("p", n), ca.SX.sym("m", n)
    torque = [p[i] * (x[i] - x[i + 1]) + 0.1 * (x[i] - x[i + 1]) ** 3 for i in range(n - 1)]
    rows = []
    for i in range(n):
        net = (torque[i - 1] if i else ca.sin(t)) - (torque[i] if i < n - 1 else ca.exp(-x[i]))
        rows.append(net / (1.0 + 0.1 * i) - m[i] * ca.fabs(x[i]) * ca.sqrt(p[i]))
    whole = ca.vertcat(*rows, *rows[: n // 2], ca.SX(3.0), ca.SX(0.0), *[x[i] for i in range(n)], t, sum(rows) if total else 0)
    whole = ca.vertcat(whole, *[p[i] * p[0] * m[i] for i in range(n)])
    whole[1] = 0
    return ca.Function("chain", [t, x, p, m], [ca.sparsify(whole)])


def coupled(n):
    """Dense systems: one of parameters and modes, one of states, and the derivative of the second."""
    t, x, p, m = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("p", n, n), ca.SX.sym("m", n)
    constant = ca.diag(1 - m * m) @ (p @ p.T) + ca.diag(m * m)
    moving = p @ p.T + ca.diag(x * x)
    first, second = masked_solve(constant, ca.sin(x) + t), masked_solve(moving, x)
    return ca.Function("coupled", [t, x, ca.vec(p), m], [ca.vertcat(first, second, ca.jtimes(second, x, first))]), constant


@pytest.mark.parametrize("n", [3, 37])
def test_what_one_row_alone_needs_is_computed_in_its_loop_and_what_all_need_once_before_it(n):
    t, x, p = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("p", n)
    rolled = Rolled(ca.Function("f", [t, x, p], [(ca.exp(-x) * ca.sin(x) + p) * ca.exp(p[0])]), ("%t", "%x", "%p"))
    assert [len(group.roots) for group in rolled.groups] == [1, n]
    assert rolled.size == n + 1  # the results, and the one number that they share


@pytest.mark.parametrize("n", [3, 37])
@pytest.mark.parametrize("name", ["exp", "log", "tanh"])
def test_functions_in_loops_are_those_of_numpy_and_the_same_in_every_row(name, n):
    t, x, p, m = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("p", 1), ca.SX.sym("m", 1)
    function = ca.Function("f", [t, x, p, m], [ca.vertcat(*[getattr(ca, name)(p * x[i]) for i in range(n)])])
    (call,) = functions(("f", rolled_body("f", function, 0)))
    arguments = np.concatenate(
        [np.random.default_rng(0).normal(scale=10.0, size=60), [0.0, -0.0, 5e-324, 1e-310, 750.0, -750.0, np.inf, -np.inf, np.nan]]
    )
    with np.errstate(all="ignore"):
        for value in arguments:
            found = values(call, (0.0, np.full(n, value), [1.0], [0.0]), n)
            assert len({row.hex() for row in found}) == 1  # done on several rows at once or alone
            expected = getattr(np, name)(value)
            assert found[0] == pytest.approx(expected, rel=4.5e-16, abs=5e-324, nan_ok=True)


@pytest.mark.parametrize("n", [1, 2, 3, 5, 40])
def test_rows_in_loops_give_what_casadi_gives(n):
    function, random = chain(n), np.random.default_rng(n)
    arguments = 0.3, random.normal(size=n), 1.0 + random.random(n), random.integers(-1, 2, n)
    body, size = rolled_body("f", function, 2), function.nnz_out()
    (call,) = functions(("f", body))
    found = values(call, arguments, size + 2)
    assert np.isnan(found[:2]).all()
    kept = np.array(function(*arguments).nonzeros())
    np.testing.assert_allclose(found[2:], kept, rtol=1e-14, atol=1e-14)
    once, each, room = rolled_slope(function)
    first, second = functions(("once", once), ("slope", each))
    memory = np.zeros(room + 8)
    start = (-memory.ctypes.data // 8) % 8  # aligned, as the array on the stack of a step is
    memory = memory[start:]
    t, *arrays = arguments
    x, p, m = (np.array(array, float) for array in arrays)
    first(t, 0.0, x.ctypes.data, x.ctypes.data, p.ctypes.data, m.ctypes.data, memory.ctypes.data)
    np.testing.assert_allclose(values(second, arguments, size, memory), kept, rtol=1e-14, atol=1e-14)


def test_loops_do_not_grow_with_the_rows():
    short, long = (rolled_body("f", chain(n, False), 0) for n in (50, 400))
    assert long.count < 1.1 * short.count + 50
    plain = bodies.plain_body(chain(400, False), 0)
    assert plain.count > 20 * long.count


@pytest.mark.parametrize("n", [10, 16, 17, pytest.param(33, marks=pytest.mark.slow)])
def test_dense_systems_are_solved_to_round_off(n):
    function, _ = coupled(n)
    random = np.random.default_rng(n)
    arguments = 0.3, random.normal(size=n), (random.normal(size=(n, n)) + 2 * np.sqrt(n) * np.eye(n)).ravel(), random.integers(0, 2, n)
    exact = np.array(function(*arguments)).ravel()
    for made in (rolled_body("f", function, 0), bodies.plain_body(function, 0)):
        (call,) = functions(("f", made))
        np.testing.assert_allclose(values(call, arguments, 3 * n), exact, rtol=1e-11, atol=1e-13)
    p, m = arguments[2].reshape(n, n, order="F"), arguments[3]
    matrix = (1 - m * m)[:, None] * (p @ p.T) + np.diag(m * m)
    np.testing.assert_allclose(exact[:n], np.linalg.solve(matrix, np.sin(arguments[1]) + 0.3), rtol=1e-10, atol=1e-13)
    x, moving = arguments[1], p @ p.T + np.diag(arguments[1] ** 2)
    y = np.linalg.solve(moving, x)
    np.testing.assert_allclose(exact[2 * n :], np.linalg.solve(moving, exact[:n] - 2 * x * exact[:n] * y), rtol=1e-9, atol=1e-13)


def test_lanes_write_a_dense_system_out():
    n = 11
    function, _ = coupled(n)
    random = np.random.default_rng(5)
    lanes = [(0.3, random.normal(size=n), (random.normal(size=(n, n)) + 7 * np.eye(n)).ravel(), random.integers(0, 2, n)) for _ in range(2)]
    body = VectorBody(2)
    given = [[body.load("%lanes", 0)], *([body.load(name, i) for i in range(size)] for name, size in (("%x", n), ("%p", n * n), ("%m", n)))]
    (results,) = inline(body, function, given)
    for i, value in enumerate(results):
        body.store(value, "%y", i)
    text = vector_text("f", body, ("x", "p", "m", "y"))
    address = compiled("\n".join([text, *body.functions.values(), *sorted(body.declarations)]), ["f"], 0)["f"]
    arrays = [np.ascontiguousarray(np.array(part).T, float) for part in zip(*[([t], x, p, m) for t, x, p, m in lanes], strict=True)]
    buffers = [np.zeros(array.size + 8) for array in (*arrays, np.zeros((3 * n, 2)))]
    places = [buffer[(-buffer.ctypes.data // 8) % 8 :] for buffer in buffers]
    for place, array in zip(places, arrays, strict=False):
        place[: array.size] = array.ravel()
    t, x, p, m, y = places
    ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 5)(address)(*(place.ctypes.data for place in (t, x, p, m, y)))
    for lane, arguments in enumerate(lanes):
        np.testing.assert_allclose(y[: 6 * n].reshape(3 * n, 2)[:, lane], np.array(function(*arguments)).ravel(), rtol=1e-11, atol=1e-13)


def test_only_dense_groups_become_calls(monkeypatch):
    x = ca.SX.sym("x", 24)

    def called(matrix):
        return len(elimination.calls(ca.Function("f", [x], [masked_solve(matrix, x[: matrix.shape[0]])])))

    full = ca.SX.ones(12, 12) + 12 * ca.diag(x[:12])
    apart = ca.diagcat(full, full)
    assert called(full) == 1
    assert called(apart) == 2
    assert called(ca.diagcat(full[:9, :9], full[:9, :9])) == 0
    assert called(ca.diag(x) + ca.SX(ca.Sparsity.banded(24, 1), 0.1)) == 0
    mixed = np.random.default_rng(0).permutation(24).tolist()
    function = ca.Function("f", [x], [masked_solve(apart[mixed, mixed], x)])
    matrix = np.array(ca.Function("matrix", [x], [apart[mixed, mixed]])(np.arange(1.0, 25)))
    np.testing.assert_allclose(np.array(function(np.arange(1.0, 25))).ravel(), np.linalg.solve(matrix, np.arange(1.0, 25)), rtol=1e-12)
    assert dense_solver(12) is dense_solver(12)


def steps(plant, limit, monkeypatch):
    """One implicit step with an elimination written out up to a limit of operations, and its program."""
    monkeypatch.setattr(implicit_step, "MOST", limit)
    plant.cache.clear()
    program = simulate(plant, 0.0, method="stiff", inputs={"top.torque": 10_000.0}).program
    kernel, random = program.kernel, np.random.default_rng(0)
    x, k, p = random.normal(size=kernel.states), random.normal(size=kernel.slopes), 0.5 + random.random(program.p_size)
    m, y = random.integers(-1, 2, kernel.elements).astype(float), np.zeros(8 * kernel.states + 8 * kernel.guards)
    SIGNATURE(kernel.addresses[1])(0.3, 1e-2, *(array.ctypes.data for array in (x, k, p, m, y)))
    return y, program


@pytest.mark.parametrize(("n", "everywhere"), [(2, False), (5, False), (6, True), (40, True)])
def test_a_banded_elimination_takes_the_step_of_the_one_written_out(n, everywhere, monkeypatch):
    plant = uniform(n, everywhere)
    (plain, _), (banded, _) = (steps(plant, limit, monkeypatch) for limit in (10**9, 0))
    np.testing.assert_allclose(banded, plain, rtol=0, atol=1e-13 * np.abs(plain).max())


@pytest.mark.parametrize(("width", "rows"), [(1, 1), (1, 2), (1, 3), (1, 12), (2, 3), (2, 9), (2, 10), (3, 17), (6, 40)])
def test_a_band_is_solved_from_both_its_ends(width, rows):
    text = "\n".join([factor_text(width, rows), solve_text(width, rows)]).replace("define internal", "define")
    found = compiled(text, ["band_factor", "band_solve"], 0)
    random, near = np.random.default_rng(rows), np.abs(np.subtract.outer(np.arange(rows), np.arange(rows))) <= width
    matrix = np.where(near, random.normal(size=(rows, rows)), 0.0) + np.diag(np.full(rows, 4.0 * width))
    band = np.array([[matrix[i, j] if 0 <= (j := i + c) < rows else 0.0 for c in range(-width, width + 1)] for i in range(rows)])
    pointer, right = ctypes.c_void_p, random.normal(size=rows)
    solution = right.copy()
    least = ctypes.CFUNCTYPE(ctypes.c_double, pointer, ctypes.c_double)(found["band_factor"])(band.ctypes.data, 1e3)
    ctypes.CFUNCTYPE(None, pointer, pointer)(found["band_solve"])(band.ctypes.data, solution.ctypes.data)
    np.testing.assert_allclose(solution, np.linalg.solve(matrix, right), rtol=1e-12, atol=1e-13)
    pivots = 1.0 / band[:, width]
    assert least == pytest.approx(pivots.min())
    assert np.prod(pivots) == pytest.approx(np.linalg.det(matrix))


@pytest.mark.slow
def test_the_implicit_step_of_a_chain_is_as_long_for_twice_as_many(monkeypatch):
    sizes = [steps(uniform(n, True), 0, monkeypatch)[1].kernel.instructions for n in (250, 500)]
    assert sizes[1] < 1.1 * sizes[0] < 6000


def test_a_matrix_without_a_band_is_not_split():
    assert split(ca.Sparsity.dense(20, 20)) is None
    assert split(ca.Sparsity.diag(20)) is None
    found = split(ca.Sparsity.banded(20, 1))
    assert found.width == 1
    assert sorted(found.apart + found.others) == list(range(20))


class Pulled(Component):
    """Six masses that a full matrix of inertia ties together, one of them rubbing on a bound."""

    def equations(self, signal):
        n = 6
        x, v = state("masses.x", "m", size=n), state("masses.v", "m/s", size=n)
        rubs = [DryFriction(f"rub.{i}", v[i], Coulomb(static=1.0 + 0.1 * i, kinetic=0.5)) for i in range(n)]
        push = signal("masses.push", "N", default=0.0)
        inverse = np.linalg.inv(np.eye(n) + 0.2 * np.ones((n, n)))
        force = ca.vertcat(*[push - (1 + i) * x[i] + rub.force for i, rub in enumerate(rubs)])
        return Equations(flow={x: v, v: ca.DM(inverse) @ force}, elements=rubs)


def test_all_methods_agree_where_forces_are_solved_for_in_calls(monkeypatch):
    push = {"masses.push": ([0.0, 2.0, 6.0], [0.0, 4.0, -4.0])}
    monkeypatch.setattr(elimination, "LARGE", 4)
    grid = np.linspace(0.0, 6.0, 61)
    runs = {
        method: simulate(compose(Pulled()), 6.0, inputs=push, method=method, accuracy=1e-7) for method in ("explicit", "stiff", "taylor")
    }
    assert runs["taylor"].program.formulas.series
    monkeypatch.setattr(elimination, "LARGE", 1000)
    monkeypatch.setattr(bodies, "ROLLED", 10**9)
    plain = simulate(compose(Pulled()), 6.0, inputs=push, method="explicit", accuracy=1e-7)
    switches = [(e.element, e.before, e.after) for e in plain.events]
    assert len(switches) > 10
    size = np.abs(plain.states).max(axis=0)
    for method, run in runs.items():
        assert [(e.element, e.before, e.after) for e in run.events] == switches
        within = 1e-9 if method == "explicit" else 1e-5
        assert (np.abs(run.at(grid).states - plain.at(grid).states) <= within * size).all()
    assert sum(runs["explicit"].steps) == sum(plain.steps)
    assert runs["explicit"].program.excited.size == plain.program.excited.size == 0
