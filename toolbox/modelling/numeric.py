"""Functions of casadi that are called with arrays, where their numbers are: a call with matrices of casadi copies each number and costs ten times more."""

from __future__ import annotations

import math
import threading
from typing import Any

import casadi as ca
import numpy as np


class NumericFunction:
    """A casadi function of dense arguments and results, from arrays to arrays.

    It is called like the function itself, with numbers or arrays, and returns an array of two axes, or a tuple of them where the function has several results.
    Arguments of other sizes, such as a column for each of many points, go the way of casadi. Threads may call it side by side: each has its own memory.
    """

    def __init__(self, function: ca.Function):
        self.function = function
        self._sizes = [function.numel_in(i) for i in range(function.n_in())]
        self._shapes = [function.size_out(i) for i in range(function.n_out())]
        self._lengths = [math.prod(shape) for shape in self._shapes]
        self._own = threading.local()

    def __reduce__(self) -> Any:
        return NumericFunction, (self.function,)

    def __call__(self, *arguments: Any) -> Any:
        for size, argument in zip(self._sizes, arguments, strict=True):
            if np.size(argument) not in (1, size):
                found = self.function(*arguments)
                return tuple(map(np.array, found)) if isinstance(found, tuple) else np.array(found)
        if not hasattr(self._own, "given"):
            self._own.given, self._own.found, self._own.evaluate = self._memory()
        for array, argument in zip(self._own.given, arguments, strict=True):
            array[:] = argument if np.ndim(argument) < 2 else np.ravel(argument)
        self._own.evaluate()
        shaped = tuple(array.reshape(shape, order="F").copy(order="F") for array, shape in zip(self._own.found, self._shapes, strict=True))
        return shaped if len(shaped) > 1 else shaped[0]

    def _memory(self) -> tuple[list[np.ndarray], list[np.ndarray], Any]:
        """Arrays of the arguments and of the results of one thread, and what evaluates the one to the other."""
        given, found = ([np.empty(length) for length in lengths] for lengths in (self._sizes, self._lengths))
        buffer: Any
        buffer, evaluate = self.function.buffer()
        for i, array in enumerate(given):
            buffer.set_arg(i, array.data)
        for i, array in enumerate(found):
            buffer.set_res(i, array.data)
        self._own.buffer = buffer  # `evaluate` does not keep it alive
        return given, found, evaluate
