"""Searches by least squares: a number that changes the residuals by next to nothing stays at its start, and nothing overflows."""

import warnings

import numpy as np

from toolbox.calibration.least_squares import LeastSquares


class Line:
    """y = a t + b 1e-160, beside data of a line that does not go through 0."""

    outputs = ("y",)
    by_samples = False

    def __init__(self):
        self.t = np.linspace(0.0, 1.0, 20)
        self.measured = {"y": 3.0 * self.t + 1.0}

    def model(self, values):
        return {"y": values[0] * self.t + values[1] * 1e-160}

    def slopes(self, values, sizes):
        return {"y": np.stack([self.t, np.full(self.t.size, 1e-160)], axis=1)}


def test_a_number_whose_slope_is_next_to_nothing_is_not_moved_and_nothing_overflows():
    line = Line()
    first, ends = np.array([1.0, 2.0]), (np.zeros(2), np.full(2, np.inf))
    search = LeastSquares(line, ("a", "b"), ("1", "1"), first, *ends, None, None, 1, 0, 0.95)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = search._descend(first, {"y": 1.0}, [line])
    right = 3.0 + line.t.sum() / (line.t @ line.t)  # of a line through 0
    assert abs(found.x[0] - right) < 1e-5 and found.x[1] == 2.0
