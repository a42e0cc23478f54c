"""Clamps of controllers that let nan through: fmin and fmax give their other argument where one is nan, and a limit would pass for a command."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from toolbox.modelling.elimination import called_with, calls

CLAMPS = (ca.OP_FMIN, ca.OP_FMAX)


def passing_nan(expressions: Sequence[ca.SX], never: ca.SX) -> list[ca.SX]:
    """Return expressions in which fmin and fmax are nan if one of their arguments is; all other values stay what they are.

    Parameters
    ----------
    expressions
        Columns of expressions.
    never
        Symbols that are never nan, such as parameters, which are checked: what depends on nothing else is not looked at.
    """
    columns = [ca.densify(ca.SX(each)) for each in expressions]
    together = ca.vertcat(ca.SX(0, 1), *columns)
    symbols = ca.symvar(together)
    function = ca.Function("scan", symbols, [together], {"max_io": 10**9}) if symbols else None
    operations = [] if function is None else [function.instruction_id(k) for k in range(function.n_instructions())]
    if function is None or not any(op in operations for op in CLAMPS):
        return columns
    sound = {symbol.element_hash() for symbol in ca.vertsplit(never)}
    called, work, found = calls(function, operations), dict[int, tuple[ca.SX, bool]](), ca.SX(together)
    for k, op in enumerate(operations):
        args, target = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_INPUT:
            work[target[0]] = symbols[args[0]], symbols[args[0]].element_hash() in sound
        elif op == ca.OP_CONST:
            work[target[0]] = ca.SX(function.instruction_constant(k)), True
        elif op == ca.OP_OUTPUT:
            found.nz[target[1]] = work[args[0]][0]
        elif op == ca.OP_CALL:
            results = called_with(called[k], [work[i][0] for i in args])
            work |= {place: (result, False) for place, result in zip(target, results, strict=True)}
        else:
            values = [work[i][0] for i in args]
            known = all(work[i][1] for i in args)
            if op in CLAMPS and not known:
                value = _clamp(op, *(work[i] for i in args))
            else:
                value = ca.SX.unary(op, *values) if len(args) == 1 else ca.SX.binary(op, *values)
            work[target[0]] = value, known
    rows = [0, *[int(sum(column.numel() for column in columns[: i + 1])) for i in range(len(columns))]]
    return ca.vertsplit(found, rows)


def _clamp(op: int, first: tuple[ca.SX, bool], second: tuple[ca.SX, bool]) -> ca.SX:
    """fmin or fmax of two expressions, each with whether it is never nan; nan where one of them is. A comparison with nan is false."""
    (a, _), (b, b_known) = (second, first) if first[1] else (first, second)
    cut = ca.if_else(b < a if op == ca.OP_FMIN else b > a, b, a)  # a where it is nan
    return cut if b_known else ca.if_else(b <= ca.inf, cut, b)
