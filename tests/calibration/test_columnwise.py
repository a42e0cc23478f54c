"""A casadi function at many samples at once gives what casadi gives at each."""

import casadi as ca
import numpy as np
import pytest

from toolbox.calibration.columnwise import Columnwise

X, Y = ca.SX.sym("x", 2), ca.SX.sym("y")


@pytest.mark.parametrize(
    "expressions",
    [
        [X[0] + ca.exp(-X[1] * Y), ca.vertcat(X[0] * Y, 3.0, X[1] / Y)],
        [ca.if_else(X[0] < Y, ca.tanh(X[1]), ca.fabs(X[0]) ** 1.5), ca.fmax(X[0], ca.sign(X[1]))],
        [ca.jacobian(ca.vertcat(X[0] ** 2 * Y, ca.sin(X[1])), X), ca.SX(2, 1)],
        [ca.erf(X[0]) + Y, ca.vertcat(X[1], 2.0)],  # numpy has no erf
    ],
)
def test_every_sample_is_that_of_casadi(expressions):
    function = ca.Function("f", [X, Y], expressions)
    x = np.random.default_rng(2).uniform(0.1, 2.0, (2, 50))
    found = Columnwise(function)(list(x), [0.7], count=50)
    for k in range(50):
        for rows, expected in zip(found, function(x[:, k], 0.7), strict=True):
            here = [float(np.broadcast_to(row, 50)[k]) for row in rows]
            assert here == pytest.approx(np.array(ca.densify(expected)).ravel(order="F").tolist(), rel=1e-14, abs=1e-300)
