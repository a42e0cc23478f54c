"""Clamps in expressions: fmin and fmax that let nan through, and limits that are opened so that a search passes them.

Why nan: fmin and fmax give their other argument where one is nan, and a limit would pass for a command. Why open limits: behind a limit an expression has no
slope, so that no slope leads a search for a steady state back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca

from toolbox.modelling.elimination import called_with, calls

CLAMPS = (ca.OP_FMIN, ca.OP_FMAX)
"""Operations that limit an argument by another one."""

SATURATIONS = (ca.OP_TANH, ca.OP_ATAN)
"""Operations that flatten out far from zero, where their slope is 1."""

Marked = tuple[ca.SX, bool]
"""An expression, and whether it depends on marked symbols only."""


def passing_nan(expressions: Sequence[ca.SX], never: ca.SX) -> list[ca.SX]:
    """Return expressions in which fmin and fmax give nan if an argument is nan. All other values are unchanged.

    Parameters
    ----------
    expressions
        Columns of expressions.
    never
        Symbols that are never nan, such as parameters, which are checked: what depends on nothing else is not looked at.
    """
    return rewritten(expressions, never, dict.fromkeys(CLAMPS, _clamp))


def opened(expressions: Sequence[ca.SX], moving: ca.SX) -> tuple[list[ca.SX], ca.SX, ca.SX]:
    """Return expressions whose limits let a share of the excess pass, the symbols of the shares, and the excess that each limit holds back.

        limited + share (wanted - limited)

    Share 1 opens a limit, share 0 leaves it as declared. A limit is a clamp one of whose arguments does not move, or a saturating function.
    Clamps between two moving arguments stay what they are.

    Parameters
    ----------
    expressions
        Columns of expressions.
    moving
        Symbols on which a signal depends that a limit may act on.

    Returns
    -------
    list of SX, SX, SX
        The expressions, a symbol per limit, and wanted - limited per limit.

    Examples
    --------
    >>> import casadi as ca
    >>> from toolbox.modelling.clamps import opened
    >>> x = ca.SX.sym("x")
    >>> (limited,), share, held_back = opened([ca.fmin(x, 2.0)], x)
    >>> f = ca.Function("f", [x, share], [limited, held_back])
    >>> [tuple(map(float, f(5.0, part))) for part in (0.0, 0.5, 1.0)]
    [(2.0, 3.0), (3.5, 3.0), (5.0, 3.0)]
    """
    shares: list[ca.SX] = []
    held_back: list[ca.SX] = []

    def open_limit(op: int, *arguments: Marked) -> ca.SX:
        values = [value for value, _ in arguments]
        limited = ca.SX.unary(op, *values) if len(values) == 1 else ca.SX.binary(op, *values)
        wanted = [value for value, fixed in arguments if not fixed]
        if len(wanted) != 1:
            return limited
        shares.append(ca.SX.sym(f"share_{len(shares)}"))
        held_back.append(wanted[0] - limited)
        return limited + shares[-1] * held_back[-1]

    moves = {symbol.element_hash() for symbol in ca.vertsplit(moving)}
    others = [symbol for symbol in ca.symvar(ca.vertcat(*map(ca.vec, expressions))) if symbol.element_hash() not in moves]
    result = rewritten(expressions, ca.vertcat(ca.SX(0, 1), *others), dict.fromkeys((*CLAMPS, *SATURATIONS), open_limit))
    return result, ca.vertcat(ca.SX(0, 1), *shares), ca.vertcat(ca.SX(0, 1), *held_back)


def rewritten(expressions: Sequence[ca.SX], marked: ca.SX, operations: dict[int, Callable[..., ca.SX]]) -> list[ca.SX]:
    """Return expressions with some operations replaced. Operations on marked symbols alone are not replaced.

    Parameters
    ----------
    expressions
        Columns of expressions.
    marked
        Symbols; what depends on nothing else is marked, too.
    operations
        {operation of casadi: function of its number and its arguments, each as (expression, whether it is marked)}.
    """
    columns = [ca.densify(ca.SX(each)) for each in expressions]
    together = ca.vertcat(ca.SX(0, 1), *columns)
    symbols = ca.symvar(together)
    function = ca.Function("scan", symbols, [together], {"max_io": 10**9}) if symbols else None
    steps = [] if function is None else [function.instruction_id(k) for k in range(function.n_instructions())]
    if function is None or not any(op in operations for op in steps):
        return columns
    sound = {symbol.element_hash() for symbol in ca.vertsplit(marked)}
    called, work, found = calls(function, steps), dict[int, Marked](), ca.SX(together)
    for k, op in enumerate(steps):
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
            if op in operations and not known:
                value = operations[op](op, *(work[i] for i in args))
            else:
                value = ca.SX.unary(op, *values) if len(args) == 1 else ca.SX.binary(op, *values)
            work[target[0]] = value, known
    rows = [0, *[int(sum(column.numel() for column in columns[: i + 1])) for i in range(len(columns))]]
    return ca.vertsplit(found, rows)


def _clamp(op: int, first: Marked, second: Marked) -> ca.SX:
    """fmin or fmax of two expressions, each with whether it is never nan; nan where one of them is. A comparison with nan is false."""
    (a, _), (b, b_known) = (second, first) if first[1] else (first, second)
    cut = ca.if_else(b < a if op == ca.OP_FMIN else b > a, b, a)  # a where it is nan
    return cut if b_known else ca.if_else(b <= ca.inf, cut, b)
