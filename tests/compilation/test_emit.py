"""Machine code against casadi and numpy: every operation, special values, the step functions, and the cache on disk."""

from __future__ import annotations

import ctypes
import math

import casadi as ca
import numpy as np
import pytest
from scipy import special

from models import Coulomb
from toolbox import Component, DryFriction, Equations, SceneError, compose, simulate, state
from toolbox.compilation import emitter as emit
from toolbox.compilation import explicit_step, kernel
from toolbox.compilation.formulas import ClosedEquations
from toolbox.compilation.runge_kutta import DOP853, DOPRI5
from toolbox.compilation.vector_emitter import LARGEST_ANGLE, VectorBody, function_text
from toolbox.modelling.elements import time
from toolbox.modelling.switching import switching

POINTER = ctypes.POINTER(ctypes.c_double)
SIGNATURE = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_double, *[POINTER] * 5)


def pointer(array):
    return array.ctypes.data_as(POINTER)


def machine_code(function):
    """The outputs of a casadi function of one vector, computed by its machine code."""
    body = emit.Body()
    outputs = emit.inline(body, function, [[body.load("%x", i) for i in range(function.nnz_in(0))]])
    for i, value in enumerate([value for output in outputs for value in output]):
        body.store(value, "%y", i)
    address = emit.compiled("\n".join([emit.function_text("f", body), *sorted(body.declarations)]), ["f"], body.count)["f"]
    call, size = SIGNATURE(address), sum(function.nnz_out(i) for i in range(function.n_out()))

    def evaluate(x):
        x, y, none = np.array(x, float), np.empty(size), np.zeros(1)
        call(0.0, 0.0, pointer(x), pointer(none), pointer(none), pointer(none), pointer(y))
        return y

    return evaluate


x, y = ca.SX.sym("x"), ca.SX.sym("y")
ANY, POSITIVE, UNIT, ABOVE_ONE = (-3.0, 3.0), (0.01, 5.0), (-0.99, 0.99), (1.01, 5.0)
TRUTH = (-1.49, 1.49)  # rounded to -1, 0, 1

# name: (casadi expression, numpy function, range of both arguments)
CASES = {
    "ADD": (x + y, np.add, ANY),
    "SUB": (x - y, np.subtract, ANY),
    "MUL": (x * y, np.multiply, ANY),
    "DIV": (x / y, np.divide, ANY),
    "NEG": (-x, lambda a, b: -a, ANY),
    "TWICE": (x + x, lambda a, b: 2 * a, ANY),
    "SQ": (x * x, lambda a, b: a * a, ANY),
    "INV": (1 / x, lambda a, b: 1 / a, ANY),
    "SQRT": (ca.sqrt(x), lambda a, b: np.sqrt(a), POSITIVE),
    "FABS": (ca.fabs(x), lambda a, b: np.abs(a), ANY),
    "FLOOR": (ca.floor(x), lambda a, b: np.floor(a), ANY),
    "CEIL": (ca.ceil(x), lambda a, b: np.ceil(a), ANY),
    "LT": (x < y, np.less, TRUTH),
    "LE": (x <= y, np.less_equal, TRUTH),
    "EQ": (ca.eq(x, y), np.equal, TRUTH),
    "NE": (ca.ne(x, y), np.not_equal, TRUTH),
    "NOT": (ca.logic_not(x), lambda a, b: np.logical_not(a), TRUTH),
    "AND": (ca.logic_and(x, y), np.logical_and, TRUTH),
    "OR": (ca.logic_or(x, y), np.logical_or, TRUTH),
    "IF_ELSE_ZERO": (ca.if_else(x, y, 0), lambda a, b: np.where(a != 0, b, 0.0), TRUTH),
    "SIGN": (ca.sign(x), lambda a, b: np.sign(a), TRUTH),
    "COPYSIGN": (ca.copysign(x, y), np.copysign, ANY),
    "FMIN": (ca.fmin(x, y), np.fmin, ANY),
    "FMAX": (ca.fmax(x, y), np.fmax, ANY),
    "FMOD": (ca.fmod(x, y), np.fmod, ANY),
    "REMAINDER": (ca.remainder(x, y), np.vectorize(math.remainder), ANY),
    "HYPOT": (ca.hypot(x, y), np.hypot, ANY),
    "ATAN2": (ca.atan2(x, y), np.arctan2, ANY),
    "POW": (x**y, np.power, POSITIVE),
    "CONSTPOW": (x**2.7, lambda a, b: a**2.7, POSITIVE),
    "EXP": (ca.exp(x), lambda a, b: np.exp(a), ANY),
    "LOG": (ca.log(x), lambda a, b: np.log(a), POSITIVE),
    "SIN": (ca.sin(x), lambda a, b: np.sin(a), ANY),
    "COS": (ca.cos(x), lambda a, b: np.cos(a), ANY),
    "TAN": (ca.tan(x), lambda a, b: np.tan(a), UNIT),
    "ASIN": (ca.asin(x), lambda a, b: np.arcsin(a), UNIT),
    "ACOS": (ca.acos(x), lambda a, b: np.arccos(a), UNIT),
    "ATAN": (ca.atan(x), lambda a, b: np.arctan(a), ANY),
    "SINH": (ca.sinh(x), lambda a, b: np.sinh(a), ANY),
    "COSH": (ca.cosh(x), lambda a, b: np.cosh(a), ANY),
    "TANH": (ca.tanh(x), lambda a, b: np.tanh(a), ANY),
    "ASINH": (ca.asinh(x), lambda a, b: np.arcsinh(a), ANY),
    "ACOSH": (ca.acosh(x), lambda a, b: np.arccosh(a), ABOVE_ONE),
    "ATANH": (ca.atanh(x), lambda a, b: np.arctanh(a), UNIT),
    "ERF": (ca.erf(x), lambda a, b: special.erf(a), ANY),
    "LOG1P": (ca.log1p(x), lambda a, b: np.log1p(a), UNIT),
    "EXPM1": (ca.expm1(x), lambda a, b: np.expm1(a), ANY),
}
STRUCTURAL = {"ASSIGN", "LIFT", "CONST", "INPUT", "OUTPUT"}  # no scalar function of their own
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 2.0, -3.0, math.inf, -math.inf, math.nan, 1e308, -1e308, 5e-324, 745.0, -745.0]


def scalar(expression):
    return ca.Function("f", [ca.vertcat(x, y)], [ca.densify(ca.SX(expression))])


def test_every_operation_the_emitter_knows_is_compared_here():
    assert set(CASES) | STRUCTURAL == emit.OPERATIONS


@pytest.mark.parametrize("name", CASES)
def test_casadi_machine_code_and_numpy_agree_on_random_inputs(name):
    expression, reference, (low, high) = CASES[name]
    function = scalar(expression)
    used = {function.instruction_id(k) for k in range(function.n_instructions())}
    assert getattr(ca, f"OP_{name}") in used  # the expression really contains the operation
    code = machine_code(function)
    a, b = np.random.default_rng(3).uniform(low, high, (2, 300))
    if (low, high) == TRUTH:
        a, b = np.round(a) + 0.0, np.round(b) + 0.0
    mine = np.array([code(point)[0] for point in zip(a, b, strict=True)])
    casadis = np.array([float(function(point)) for point in zip(a, b, strict=True)])
    assert np.array_equal(mine, casadis)  # one instruction, one library of functions: no round-off between the two
    np.testing.assert_allclose(mine, np.asarray(reference(a, b), float), rtol=2e-15, atol=0)  # numpy has functions of its own, to 4 ulp


@pytest.mark.parametrize("name", CASES)
def test_nan_infinity_and_zeros_mean_in_machine_code_what_they_mean_in_casadi(name):
    function = scalar(CASES[name][0])
    code = machine_code(function)
    for a in SPECIAL:
        for b in SPECIAL:
            mine, casadis = code((a, b))[0], float(function((a, b)))
            assert mine == casadis or (math.isnan(mine) and math.isnan(casadis)), f"{name}({a}, {b})"


def test_the_sign_of_a_negative_zero_is_copied():
    code = machine_code(scalar(ca.copysign(x, y)))
    assert code((2.0, -0.0))[0] == -2.0
    assert code((2.0, 0.0))[0] == 2.0


def test_if_else_takes_one_branch_and_ignores_a_nan_in_the_other():
    function = scalar(ca.if_else(x > 0, ca.log(x), y))
    code = machine_code(function)
    for point in ((2.0, 5.0), (-2.0, 5.0), (0.0, 5.0), (math.nan, 5.0)):
        mine, casadis = code(point)[0], float(function(point))
        assert mine == casadis or (math.isnan(mine) and math.isnan(casadis))
    assert code((-2.0, 5.0))[0] == 5.0


@pytest.mark.parametrize("seed", range(8))
def test_random_expressions_agree_to_round_off(seed):
    rng = np.random.default_rng(seed)
    values = rng.uniform(-2, 2, (4, 50))
    symbols = ca.SX.sym("x", 4)
    pool = [(symbols[i], values[i]) for i in range(4)]
    # well-conditioned combinations, so that a difference of round-off stays one
    kinds = [
        lambda a, b: (ca.sin(a[0]) + b[0], np.sin(a[1]) + b[1]),
        lambda a, b: (a[0] * ca.tanh(b[0]), a[1] * np.tanh(b[1])),
        lambda a, b: (ca.fmin(a[0], b[0]), np.fmin(a[1], b[1])),
        lambda a, b: (ca.fmax(a[0], -b[0]), np.fmax(a[1], -b[1])),
        lambda a, b: (a[0] / (2 + b[0] ** 2), a[1] / (2 + b[1] ** 2)),
        lambda a, b: (ca.exp(-ca.fabs(a[0])) - b[0], np.exp(-np.abs(a[1])) - b[1]),
        lambda a, b: (ca.sqrt(1 + a[0] ** 2) + 3 * b[0], np.sqrt(1 + a[1] ** 2) + 3 * b[1]),
        lambda a, b: (ca.hypot(a[0], b[0]), np.hypot(a[1], b[1])),
        lambda a, b: (ca.atan2(a[0], 3 + ca.cos(b[0])), np.arctan2(a[1], 3 + np.cos(b[1]))),
        lambda a, b: (ca.if_else(a[0] > 0, a[0], b[0]), np.where(a[1] > 0, a[1], b[1])),
        lambda a, b: (ca.fabs(a[0]) ** 0.7, np.abs(a[1]) ** 0.7),
    ]
    for _ in range(60):
        first, second = (pool[rng.integers(len(pool))] for _ in range(2))
        pool.append(kinds[rng.integers(len(kinds))](first, second))
    outputs = pool[-10:]
    function = ca.Function("f", [symbols], [ca.vertcat(*[ca.densify(sx) for sx, _ in outputs])])
    code = machine_code(function)
    for k in range(values.shape[1]):
        mine, casadis = code(values[:, k]), np.array(function(values[:, k])).ravel()
        scale = 1 + np.abs(casadis).max()
        # fused multiply-add and reciprocals differ in the last digit; some 60 operations deep
        np.testing.assert_allclose(mine, casadis, rtol=0, atol=1e-12 * scale)
        np.testing.assert_allclose(mine, [float(v[k]) for _, v in outputs], rtol=0, atol=1e-12 * scale)


def test_an_unknown_operation_is_an_error_that_names_it():
    with pytest.raises(SceneError, match="ERFINV"):
        machine_code(scalar(ca.erfinv(x)))


def test_an_unknown_operation_in_a_plant_is_an_error_that_names_it():
    class Odd(Component):
        def equations(self, signal):
            z = state("odd.z", "1")
            return Equations(flow={z: ca.erfinv(z)})

    with pytest.raises(SceneError, match="ERFINV"):
        simulate(compose(Odd()), 1.0)


@pytest.mark.slow
def test_a_function_too_large_to_be_optimised_hard_is_as_right_as_a_small_one():
    # 24 000 instructions: the code generator takes its fast way
    symbols = ca.SX.sym("x", 3)
    values = [symbols[i] for i in range(3)]
    for i in range(4000):
        a, b, c = values
        values = [ca.sin(b) + 0.5 * a, 0.7 * c - ca.fabs(a) * 0.1, 0.3 * b + 0.01 * i]
    function = ca.Function("f", [symbols], [ca.vertcat(*values)])
    assert function.n_instructions() > 20_000
    code = machine_code(function)
    for point in np.random.default_rng(2).normal(size=(20, 3)):
        np.testing.assert_allclose(code(point), np.array(function(point)).ravel(), rtol=1e-11)


# --- the cache on disk


def damage(path, how):
    content = path.read_bytes()
    if how == "flipped":
        path.write_bytes(content[:-9] + bytes([content[-9] ^ 0x40]) + content[-8:])
    elif how == "truncated":
        path.write_bytes(content[: len(content) // 2])
    elif how == "empty":
        path.write_bytes(b"")
    elif how == "garbage":
        path.write_bytes(bytes(range(256)) * 20)
    elif how == "directory":
        path.unlink()
        path.mkdir()


@pytest.mark.parametrize("how", ["flipped", "truncated", "empty", "garbage", "directory"])
def test_a_damaged_object_file_is_recovered_from(how, tmp_path, monkeypatch):
    monkeypatch.setenv("STICKSLIP_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(emit, "_LOADED", {})
    function = scalar(3 * x + ca.sin(y))
    assert machine_code(function)((2.0, 0.0))[0] == 6.0
    (path,) = (tmp_path / "objects").iterdir()
    whole = path.read_bytes()
    damage(path, how)
    monkeypatch.setattr(emit, "_LOADED", {})  # as in a new process
    assert machine_code(function)((2.0, 0.0))[0] == 6.0
    if how != "directory":
        assert path.read_bytes() == whole


def test_an_object_file_is_written_once_and_used_again(tmp_path, monkeypatch):
    monkeypatch.setenv("STICKSLIP_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(emit, "_LOADED", {})
    machine_code(scalar(7 * x + y))
    monkeypatch.setattr(emit, "_LOADED", {})
    monkeypatch.setattr(emit, "object_code", lambda *_: pytest.fail("compiled again"))
    assert machine_code(scalar(7 * x + y))((1.0, 1.0))[0] == 8.0
    assert len(list((tmp_path / "objects").iterdir())) == 1


def test_a_cache_that_cannot_be_written_only_costs_time(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("not a directory")
    monkeypatch.setenv("STICKSLIP_CACHE_DIR", str(blocked))
    monkeypatch.setattr(emit, "_LOADED", {})
    assert machine_code(scalar(5 * x - y))((1.0, 1.0))[0] == 4.0


# --- the step functions

FORMULAS = pytest.mark.parametrize("formulas", [DOPRI5, DOP853], ids=lambda formulas: formulas.name)


def step_function(formulas, flow, states, elements=(), parameters=None):
    """(step, project-free) callable (t, h, x, p, m) -> (x(t + h), whole output vector) of a closed system."""
    p = ca.SX(0, 1) if parameters is None else parameters
    form = switching(time, states, flow, elements)
    equations = ClosedEquations(time, states, p, elements, form)
    made = kernel.kernel_of(equations, formulas, formulas.step(equations))
    n, size = states.numel(), 4 * states.numel() + 2 * made.guards
    field, step = SIGNATURE(made.addresses[0]), SIGNATURE(made.addresses[1])

    def call(t, h, x, p=(0.0,), m=(0.0,)):
        x, p, m = (np.array(a, float) for a in (x, p, m))
        none, y = np.zeros(1), np.full(size, np.nan)
        field(t, 0.0, pointer(x), pointer(none), pointer(p), pointer(m), pointer(y))
        k, out = y[n : 2 * n].copy(), np.full(size, np.nan)
        step(t, h, pointer(x), pointer(k), pointer(p), pointer(m), pointer(out))
        return out

    return call


@FORMULAS
@pytest.mark.parametrize("unrolled", [0, 10**9], ids=["looped", "unrolled"])
def test_the_local_error_shrinks_with_the_order_of_the_formulas_plus_one(formulas, unrolled, monkeypatch):
    # y' = y cos t, y(t) = exp(sin t), together with a pendulum-free rotation (c, s)' = (-s, c)
    monkeypatch.setattr(explicit_step, "UNROLLED", unrolled)
    z = ca.SX.sym("z", 3)
    call = step_function(formulas, ca.vertcat(z[0] * ca.cos(time), -z[2], z[1]), z)

    def error(h, t=0.3):
        exact = [math.exp(math.sin(t + h)), math.cos(t + h), math.sin(t + h)]
        return np.abs(call(t, h, [math.exp(math.sin(t)), math.cos(t), math.sin(t)])[:3] - exact)

    h = 0.05 if formulas is DOPRI5 else 0.4
    order = np.log2(error(h) / error(h / 2))
    # the next term of the error adds about h to the ratio
    np.testing.assert_allclose(order, formulas.order + 1, atol=0.5)


@FORMULAS
def test_the_coefficients_satisfy_the_conditions_of_their_order(formulas):
    b, c = np.array(formulas.b), np.array(formulas.c)
    for k in range(formulas.order):  # quadrature: sum b c^k = 1 / (k + 1)
        assert abs(b @ c**k - 1 / (k + 1)) < 1e-14
    for row, node in zip(formulas.a, formulas.c, strict=True):
        assert abs(sum(row) - node) < 1e-14
    assert abs(sum(formulas.error)) < 1e-14  # an error estimate vanishes on a constant slope
    assert abs(sum(formulas.error_low)) < 1e-14


@FORMULAS
def test_the_looped_step_agrees_with_the_unrolled_step(formulas, monkeypatch):
    n = 7
    position, speed, p = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("p", 3)
    contacts = [DryFriction(f"c{i}", speed[i] - p[2], Coulomb(static=0.5, kinetic=0.3), 1 + 0.1 * i) for i in range(n)]
    force = ca.vertcat(*[contact.force for contact in contacts])
    pull = p[0] * (ca.vertcat(position[1:], 0) - 2 * position + ca.vertcat(0, position[:-1])) - p[1] * speed**3 + ca.sin(time)
    flow = ca.vertcat(speed, pull + force)
    states = ca.vertcat(position, speed)
    results = []
    for unrolled in (0, 10**9):
        monkeypatch.setattr(explicit_step, "UNROLLED", unrolled)
        call = step_function(formulas, flow, states, contacts, p)
        rng = np.random.default_rng(1)
        results.append([call(rng.uniform(0, 5), rng.uniform(0.01, 0.3), rng.normal(size=2 * n), rng.uniform(0.1, 2, 3), rng.integers(-1, 2, n))
                        for _ in range(40)])  # fmt: skip
    looped, unrolled = map(np.array, results)
    written = slice(0, None) if formulas.error_low else slice(0, -2 * n)
    assert np.isfinite(unrolled[:, written]).all()
    # the order of the same additions differs
    np.testing.assert_allclose(looped[:, written], unrolled[:, written], rtol=0, atol=1e-13 * (1 + np.abs(unrolled[:, written]).max()))


@FORMULAS
def test_a_simulation_does_not_depend_on_how_its_step_is_written(formulas, monkeypatch):
    from models import BlockOnBelt

    accuracy = 1e-4 if formulas is DOPRI5 else 1e-9
    runs = []
    for unrolled in (0, 10**9):
        monkeypatch.setattr(explicit_step, "UNROLLED", unrolled)
        plant = compose(BlockOnBelt())
        plant.cache = {}  # compile for this run alone
        runs.append(simulate(plant, 20.0, accuracy=accuracy))
    looped, unrolled = runs
    assert [(e.before, e.after) for e in looped.events] == [(e.before, e.after) for e in unrolled.events]
    np.testing.assert_allclose([e.time for e in looped.events], [e.time for e in unrolled.events], atol=10 * accuracy)


# ------------------------------------------------------------------------------------------------------------------------------------ vectors
RANDOM = np.random.default_rng(5)


def vector_code(width, inputs, write):
    """What `write(body, values)` computes on vectors: a function of arrays, one per input."""
    body = VectorBody(width)
    values = write(body, [body.load("%lanes", i) for i in range(inputs)])
    for i, value in enumerate(values):
        body.store(value, "%lanes", inputs + i)
    text = "\n".join([function_text("f", body), *body.functions.values(), *sorted(body.declarations)])
    call = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(emit.compiled(text, ["f"], body.count)["f"])
    rows = inputs + len(values)
    raw = np.zeros(rows * width + 8)
    lanes = raw[(-raw.ctypes.data % 64) // 8 :][: rows * width].reshape(rows, width)

    def evaluate(*arrays):
        size = len(arrays[0])
        out = np.empty((len(values), size))
        for first in range(0, size, width):
            count = min(width, size - first)
            lanes[:inputs, :count] = [array[first : first + count] for array in arrays]
            call(lanes.ctypes.data)
            out[:, first : first + count] = lanes[inputs:, :count]
        return out

    return evaluate


def spread(low, high, count=4000):
    return RANDOM.uniform(low, high, count)


def magnitudes(low, high, count=2000):
    return 10.0 ** RANDOM.uniform(low, high, count) * RANDOM.choice([-1.0, 1.0], count)


MULTIPLES = np.arange(1, 2000) * (np.pi / 2)
ARGUMENTS = {
    "exp": np.concatenate([spread(-745.0, 709.7), spread(-1.0, 1.0), magnitudes(-310, 2)]),
    "log": np.abs(np.concatenate([magnitudes(-323, 308), spread(0.5, 2.0), 1.0 + magnitudes(-15, -1)])),
    "tanh": np.concatenate([spread(-25.0, 25.0), magnitudes(-310, 1)]),
    "sin": np.concatenate([spread(-10.0, 10.0), spread(-LARGEST_ANGLE, LARGEST_ANGLE), magnitudes(-310, 300), MULTIPLES]),
    "cos": np.concatenate([spread(-10.0, 10.0), spread(-LARGEST_ANGLE, LARGEST_ANGLE), magnitudes(-310, 300), MULTIPLES]),
}


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="long doubles are doubles here")
@pytest.mark.parametrize("width", [4, 8, 16])
@pytest.mark.parametrize("name", ARGUMENTS)
def test_vector_functions_are_right_to_two_units_in_the_last_place(name, width):
    x = ARGUMENTS[name]
    (found,) = vector_code(width, 1, lambda body, values: [body.call(name, values[0])])(x)
    exact = getattr(np, name)(x.astype(np.longdouble))
    unit = np.spacing(np.abs(exact.astype(float)))
    assert float((np.abs(found - exact) / unit).max()) < 2.0


@pytest.mark.parametrize("width", [4, 8, 16])
@pytest.mark.parametrize("name", ARGUMENTS)
def test_vector_functions_treat_special_values_as_libm_does(name, width):
    x = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, -5e-324, 1e308, -1e308, 710.0, -746.0])
    (found,) = vector_code(width, 1, lambda body, values: [body.call(name, values[0])])(x)
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(found, getattr(np, name)(x), rtol=4e-16)


@pytest.mark.parametrize("name", CASES)
def test_every_operation_gives_on_vectors_what_it_gives_on_numbers(name):
    function = scalar(CASES[name][0])
    a, b = (np.ravel(v) for v in np.meshgrid(SPECIAL, SPECIAL))
    random = spread(*CASES[name][2], 21), spread(*CASES[name][2], 21)
    if CASES[name][2] == TRUTH:
        random = tuple(np.round(v) + 0.0 for v in random)
    a, b = np.concatenate([a, random[0]]), np.concatenate([b, random[1]])
    (found,) = vector_code(8, 2, lambda body, values: emit.inline(body, function, [values])[0])(a, b)
    code = machine_code(function)
    expected = np.array([code(point)[0] for point in zip(a, b, strict=True)])
    np.testing.assert_allclose(found, expected, rtol=4.5e-16, atol=0)
