"""A casadi function at thousands of samples at once, instruction by instruction with numpy.

casadi calls a function once for each sample, and copies whatever is the same for all of them; numpy takes one array for each instruction that depends on
what was measured, and one number for any other, which for the law of a contact is a hundred times as fast.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

_UNARY: dict[int, Callable[[Any], Any]] = {
    ca.OP_ASSIGN: lambda a: a, ca.OP_LIFT: lambda a: a, ca.OP_NEG: np.negative, ca.OP_EXP: np.exp, ca.OP_LOG: np.log, ca.OP_SQRT: np.sqrt,
    ca.OP_SQ: np.square, ca.OP_TWICE: lambda a: 2.0 * a, ca.OP_INV: lambda a: 1.0 / a, ca.OP_SIN: np.sin, ca.OP_COS: np.cos, ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin, ca.OP_ACOS: np.arccos, ca.OP_ATAN: np.arctan, ca.OP_SINH: np.sinh, ca.OP_COSH: np.cosh, ca.OP_TANH: np.tanh,
    ca.OP_ASINH: np.arcsinh, ca.OP_ACOSH: np.arccosh, ca.OP_ATANH: np.arctanh, ca.OP_FABS: np.abs, ca.OP_SIGN: np.sign, ca.OP_FLOOR: np.floor,
    ca.OP_CEIL: np.ceil, ca.OP_NOT: lambda a: np.where(a == 0, 1.0, 0.0), ca.OP_LOG1P: np.log1p, ca.OP_EXPM1: np.expm1,
}  # fmt: skip
_BINARY: dict[int, Callable[[Any, Any], Any]] = {
    ca.OP_ADD: np.add, ca.OP_SUB: np.subtract, ca.OP_MUL: np.multiply, ca.OP_DIV: np.divide, ca.OP_POW: np.power, ca.OP_CONSTPOW: np.power,
    ca.OP_FMIN: np.fmin, ca.OP_FMAX: np.fmax, ca.OP_ATAN2: np.arctan2, ca.OP_FMOD: np.fmod, ca.OP_HYPOT: np.hypot, ca.OP_COPYSIGN: np.copysign,
    ca.OP_LT: lambda a, b: np.where(a < b, 1.0, 0.0), ca.OP_LE: lambda a, b: np.where(a <= b, 1.0, 0.0),
    ca.OP_EQ: lambda a, b: np.where(a == b, 1.0, 0.0), ca.OP_NE: lambda a, b: np.where(a != b, 1.0, 0.0),
    ca.OP_AND: lambda a, b: np.where((a != 0) & (b != 0), 1.0, 0.0), ca.OP_OR: lambda a, b: np.where((a != 0) | (b != 0), 1.0, 0.0),
    ca.OP_IF_ELSE_ZERO: lambda a, b: np.where(a != 0, b, 0.0),
}  # fmt: skip


class Columnwise:
    """An SX function whose arguments are, row by row, numbers or arrays of one length, and whose results are so too.

    At an operation that numpy has not, such as erf, casadi evaluates the whole function.
    """

    def __init__(self, function: ca.Function):
        self.function = function
        self.steps: list[tuple[int, list[int], list[int], float]] = []
        for k in range(function.n_instructions()):
            op = function.instruction_id(k)
            constant = function.instruction_constant(k) if op == ca.OP_CONST else 0.0
            self.steps.append((op, function.instruction_output(k), function.instruction_input(k), constant))
        self.known = all(op in (ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT) or op in _UNARY or op in _BINARY for op, *_ in self.steps)
        self.places = [self._places(function.sparsity_out(i)) for i in range(function.n_out())]

    @staticmethod
    def _places(sparsity: ca.Sparsity) -> list[int]:
        """Rows of a column, or places in a matrix column by column, of the nonzeros."""
        rows, columns = sparsity.get_triplet()
        return [r + c * sparsity.size1() for r, c in zip(rows, columns, strict=True)]

    def __call__(self, *arguments: Sequence[Any], count: int) -> list[list[Any]]:
        """Entries of every result, each a number or an array of `count`; arguments: rows of each."""
        if not self.known:
            columns = [np.array([np.broadcast_to(row, count) for row in rows]).reshape(len(rows), count) for rows in arguments]
            found = [np.array(each) for each in self.function.map(count)(*columns)]
            return [list(each.reshape(each.shape[0], count, -1).transpose(2, 0, 1).reshape(-1, count)) for each in found]
        work: dict[int, Any] = {}
        results: list[list[Any]] = [[0.0] * (self.function.numel_out(i)) for i in range(self.function.n_out())]
        with np.errstate(all="ignore"):
            for op, out, given, constant in self.steps:
                if op == ca.OP_CONST:
                    work[out[0]] = constant
                elif op == ca.OP_INPUT:
                    work[out[0]] = arguments[given[0]][given[1]]
                elif op == ca.OP_OUTPUT:
                    results[out[0]][self.places[out[0]][out[1]]] = work[given[0]]
                elif op in _UNARY:
                    work[out[0]] = _UNARY[op](work[given[0]])
                else:
                    work[out[0]] = _BINARY[op](work[given[0]], work[given[1]])
        return results
