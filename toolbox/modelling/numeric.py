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
        own = self._own
        if not hasattr(own, "given"):
            own.given, own.found, own.evaluate = self._memory()
        for array, argument in zip(own.given, arguments, strict=True):
            if isinstance(argument, float):  # asked first, because numpy takes a microsecond to tell the size of a number
                array.fill(argument)
                continue
            values = argument if isinstance(argument, np.ndarray) else np.asarray(argument)
            if values.size not in (1, array.size):
                found = self.function(*arguments)
                return tuple(map(np.array, found)) if isinstance(found, tuple) else np.array(found)
            array[:] = values if values.ndim < 2 else values.ravel()
        own.evaluate()
        shaped = tuple([array.copy().reshape(shape, order="F") for array, shape in zip(own.found, self._shapes, strict=True)])
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
