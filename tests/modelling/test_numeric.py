"""Functions of casadi from arrays to arrays: the same numbers as casadi gives, in every shape."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np

from toolbox.modelling.numeric import NumericFunction

A, X, EMPTY = ca.SX.sym("a"), ca.SX.sym("x", 3), ca.SX.sym("e", 0)
MATRIX = ca.vertcat(ca.horzcat(A, X[0]), ca.horzcat(X[1] * X[2], 2.0), ca.horzcat(X[0] / A, X[2]))
FUNCTION = ca.Function("both", [A, X, EMPTY], [ca.densify(MATRIX), ca.densify(ca.vertcat(ca.sin(X), A))])


def test_numbers_are_those_of_casadi_bit_by_bit_and_stay_when_it_is_called_again():
    numeric = NumericFunction(FUNCTION)
    matrix, column = numeric(2.0, np.array([1.0, 3.0, 5.0]), np.empty(0))
    expected = FUNCTION(2.0, np.array([1.0, 3.0, 5.0]), np.empty(0))
    numeric(7.0, np.zeros(3), np.empty(0))
    assert matrix.shape == (3, 2) and column.shape == (4, 1)
    assert np.array_equal(matrix, np.array(expected[0])) and np.array_equal(column, np.array(expected[1]))


def test_one_number_stands_for_all_and_a_column_per_point_gives_all_points():
    numeric = NumericFunction(FUNCTION)
    assert np.array_equal(numeric(2.0, 3.0, [])[1], numeric(2.0, np.full(3, 3.0), [])[1])
    points = np.arange(1.0, 7.0).reshape(2, 3).T  # not contiguous, as slices of a table are
    _, columns = numeric(2.0, points, np.empty((0, 2)))
    assert np.array_equal(columns, np.hstack([numeric(2.0, points[:, k], [])[1] for k in range(2)]))


def test_threads_do_not_write_into_each_others_numbers_and_a_pickled_one_gives_the_same():
    numeric = pickle.loads(pickle.dumps(NumericFunction(FUNCTION)))
    values = [float(k) for k in range(1, 200)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda value: float(numeric(value, value, [])[0][0, 0]), values))
    assert found == values
