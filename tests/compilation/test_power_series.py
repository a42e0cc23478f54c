"""Coefficients of Taylor series: every recurrence against derivatives that casadi forms, and the steps made of them against solutions in closed form."""

import ctypes

import casadi as ca
import numpy as np
import pytest

from toolbox.compilation.emitter import OPERATIONS, compiled, function_text
from toolbox.compilation.power_series import NoSeries
from toolbox.compilation.taylor import Taylor, peaks_in_time, polynomial_body, series_body, series_of

SIGNATURE = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_double, *[ctypes.c_void_p] * 5)
T, X, P, M = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("p", 2), ca.SX.sym("m", 1)
U, V = 0.3 + 0.4 * ca.sin(X[0]) * X[1], 1.5 + 0.2 * T * T - 0.1 * X[1]

SMOOTH = {
    "ADD": U + V, "SUB": U - V, "MUL": U * V, "DIV": U / V, "SQRT": ca.sqrt(V), "EXP": ca.exp(U * V), "LOG": ca.log(V), "SIN": ca.sin(U * V),
    "COS": ca.cos(U * V), "TAN": ca.tan(U), "ASIN": ca.asin(U), "ACOS": ca.acos(U), "ATAN": ca.atan(U * V), "SINH": ca.sinh(U), "COSH": ca.cosh(U),
    "TANH": ca.tanh(U * V), "ASINH": ca.asinh(U), "ACOSH": ca.acosh(V), "ATANH": ca.atanh(U), "ERF": ca.erf(U), "LOG1P": ca.log1p(U),
    "EXPM1": ca.expm1(U), "POW": V ** U, "CONSTPOW": V**-1.7, "ATAN2": ca.atan2(U, V), "HYPOT": ca.hypot(U, V), "NEG": -U, "TWICE": 2 * U,
    "SQ": U**2, "INV": 1 / V, "whole power": U**7, "power of a parameter": V ** P[0], "parameter to a power": P[1] ** U, "constant factor": P[0] * U / P[1],
    "product of constants": (P[0] - 0.2) * ca.exp(P[1]) * U, "exp of a constant": ca.exp(P[0]) + U, "angle about a point": ca.atan2(P[0], V),
    "behind the axis": ca.atan2(U, -P[1] - U),
    "fabs": ca.fabs(V), "fabs below zero": ca.fabs(-V) * U, "FMIN": ca.fmin(U, V), "FMAX": ca.fmax(U, V), "zero": 0 * U + V,
}  # fmt: skip
JUMPS = {"FLOOR": ca.floor(U), "CEIL": ca.ceil(U), "SIGN": ca.sign(U), "FMOD": ca.fmod(U, 0.1), "LT": (U < V), "LE": U <= V, "EQ": U == V, "NE": U != V,
         "IF_ELSE_ZERO": ca.if_else(U > 0, V, 0), "COPYSIGN": ca.copysign(U, V), "NOT": ca.logic_not(U), "AND": ca.logic_and(U, V), "OR": ca.logic_or(U, V),
         "REMAINDER": ca.remainder(U, 0.1)}  # fmt: skip
AT = (0.7, np.array([0.4, -0.9]), np.array([0.3, 1.4]), np.array([1.0]))


def equations(value):
    flow = ca.vertcat(X[1] + 0.1 * ca.cos(T), -ca.sin(X[0]) + 0.2 * P[0] * M[0])
    return ca.Function("equations", [T, X, P, M], [flow, ca.densify(value)])


def table(function, order, at=AT, h=0.1):
    """Rows of coefficients 0 to `order`: two states and an output."""
    body = series_body(Taylor(order), function)
    text = "\n".join([function_text("series", body), *sorted(body.declarations)])
    address = compiled(text, ["series"], body.count)["series"]
    out, unused = np.zeros((order + 1, 3)), np.zeros(8)
    t, x, p, m = at
    SIGNATURE(address)(t, h, x.ctypes.data, unused.ctypes.data, p.ctypes.data, m.ctypes.data, out.ctypes.data)
    return np.vstack([out[-1:], out[:-1]])


def derivatives(function, count, at=AT):
    """Taylor coefficients 0 to `count` of the output along the flow, by repeated differentiation."""
    t, x, p, m = function.sx_in()
    flow, term = function(t, x, p, m)
    found = []
    for k in range(count + 1):
        found.append(float(ca.Function("term", [t, x, p, m], [term])(*at)))
        term = (ca.jtimes(term, x, flow) + ca.jtimes(term, t, ca.SX(1))) / (k + 1)
    return np.array(found)


@pytest.mark.parametrize("name", SMOOTH)
def test_every_recurrence_gives_the_derivatives_that_casadi_forms(name):
    function = equations(SMOOTH[name])
    expected, found = derivatives(function, 6), table(function, 6)[:, 2]
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12 * np.abs(expected).max())
    assert np.abs(expected[1:]).min() > 0.0  # the check cannot pass on zeros


@pytest.mark.parametrize("name", JUMPS)
def test_what_jumps_has_no_series(name):
    assert series_of(Taylor(4), equations(JUMPS[name])) == "an operation of the plant has no Taylor series"
    with pytest.raises(NoSeries):
        series_body(Taylor(4), equations(JUMPS[name]))


def test_every_operation_of_the_emitter_has_a_series_or_is_known_to_have_none():
    aside = {"ASSIGN", "LIFT", "CONST", "INPUT", "OUTPUT", "FABS"}
    assert OPERATIONS - aside == (SMOOTH.keys() & OPERATIONS) | JUMPS.keys()


@pytest.mark.parametrize(("value", "hidden"), [
    (ca.sin(2 * T + P[0]), False), (P[0] * T * ca.cos(T * T), False), (ca.exp(X[0] * T), False), (T / P[1], False),
    (ca.exp(-T * T), True), (1 / (1 + T * T), True), (ca.tanh(5 * T) * X[0], True), (ca.sqrt(T), True)])  # fmt: skip
def test_a_peak_in_time_may_hide_from_coefficients_and_a_wave_does_not(value, hidden):
    assert peaks_in_time(equations(value)) is hidden


def test_high_orders_are_right_too():
    """tan t, whose radius of convergence is pi/2: the ratio of coefficients two apart is (2/pi)^2."""
    function = ca.Function("equations", [T, X, P, M], [ca.vertcat(1, 0), ca.tan(X[0])])
    found = table(function, 30, (0.0, np.zeros(2), np.zeros(2), np.zeros(1)))[:, 2]
    assert found[[1, 3, 5]] == pytest.approx([1.0, 1 / 3, 2 / 15], rel=1e-14)
    assert not found[::2].any()
    assert found[29] / found[27] == pytest.approx(4 / np.pi**2, rel=1e-12)


@pytest.mark.parametrize(("start", "side"), [(1.0, 1.0), (-1.0, -1.0), (0.0, 1.0), (1e-12, -1.0), (-1e-12, 1.0)])
def test_a_kink_takes_the_side_on_which_the_solution_is_just_after_the_start(start, side):
    """x' = side, y' = |x|: an x that is zero but for round-off has the sign of what it becomes."""
    function = ca.Function("equations", [T, X, P, M], [ca.vertcat(P[0], ca.fabs(X[0])), ca.fmax(X[0], 0) + ca.fmin(X[0], 0)])
    found = table(function, 4, (0.0, np.array([start, 0.0]), np.array([side, 0.0]), np.zeros(1)), h=1.0)
    assert found[1, 1] == abs(start)
    assert found[2, 1] == 0.5  # y = |start| t + t^2/2 on the side that it goes to, or is on
    assert found[1, 2] == side


def test_a_kink_left_with_no_speed_takes_the_side_of_the_acceleration():
    function = ca.Function("equations", [T, X, P, M], [ca.vertcat(X[1], -1.0), ca.fabs(X[0])])
    assert table(function, 3, (0.0, np.zeros(2), np.zeros(2), np.zeros(1)))[2, 2] == 0.5  # |-t^2/2|


@pytest.mark.parametrize("order", [6, 10, 15])
def test_a_step_has_the_order_of_its_series(order):
    """The pendulum with a forced pivot: halving the step divides the error by about 2^order."""
    function = equations(U * V)
    body, step = series_body(Taylor(order), function), polynomial_body(Taylor(order), 2, 1)
    text = "\n".join([function_text("series", body), function_text("step", step), *sorted(body.declarations | step.declarations)])
    found = compiled(text, ["series", "step"], body.count)
    series, step = (SIGNATURE(found[name]) for name in ("series", "step"))

    def integrated(pieces, duration):
        t, x, p, m = AT[0], *(array.copy() for array in AT[1:])
        k, y = np.zeros(3 * (order + 1)), np.zeros(16)
        for _ in range(pieces):
            for call, h, out in ((series, duration / pieces, k), (step, duration / pieces, y)):
                call(t, h, *(array.ctypes.data for array in (x, k, p, m, out)))
            t += duration / pieces
            x[:] = y[:2]
        return np.append(x, y[4])

    duration = 3.2
    exact = integrated(128, duration)
    coarse, fine = (np.abs(integrated(pieces, duration) - exact).max() for pieces in (2, 4))
    assert fine > 1e-13
    assert np.log2(coarse / fine) == pytest.approx(order, abs=1.5)
    t, x, p, m = AT
    slopes = np.array(function(t, x, p, m)[0]).ravel()
    k, y = np.zeros(3 * (order + 1)), np.zeros(16)
    series(t, 0.1, *(array.ctypes.data for array in (x, k, p, m, k)))
    step(t, 0.0, *(array.ctypes.data for array in (x, k, p, m, y)))
    assert k[:2] == pytest.approx(slopes, rel=1e-15)  # the table begins with the slopes
    assert y[:2] == pytest.approx(x, abs=0)
    assert y[2:4] == pytest.approx(slopes, rel=1e-15)
