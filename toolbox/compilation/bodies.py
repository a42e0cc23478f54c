"""Bodies of the functions of a kernel, written out or in loops, and loops over the states."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from toolbox.compilation.emitter import Body, function_text, inline
from toolbox.compilation.rolled import rolled_body, rolled_slope
from toolbox.modelling.elimination import calls, size_solved

ROLLED = 1_500
"""Instructions of a function beyond which it is written as loops over equal rows."""


def arguments_of(body: Body, function: ca.Function) -> list[list[str]]:
    """Values of the inputs (t, x, p, m and, for updates, the controller state in k)."""
    pointers = ["", "%x", "%p", "%m", "%k"]
    values = [["%t"]]
    for i in range(1, function.n_in()):
        values.append([body.load(pointers[i], j) for j in range(function.numel_in(i))])
    return values


def operations(function: ca.Function) -> int:
    """Return the number of operations of a function. A dense system of n equations that the function solves counts 2 n^2, because its
    factors are known."""
    return function.n_instructions() + sum(2 * size_solved(called.name())[0] ** 2 for called in calls(function).values())


def is_long(function: ca.Function) -> bool:
    """Whether a function is written as loops over equal rows."""
    return function.n_instructions() > ROLLED


def body_of(name: str, function: ca.Function, offset: int = 0) -> Body:
    """Return the body of a function as by `plain_body`. A long function is written in loops."""
    return rolled_body(name, function, offset) if is_long(function) else plain_body(function, offset)


def slope_bodies(body: Body, rhs: ca.Function) -> tuple[dict[str, Body], str]:
    """The functions that give the slopes of a stage, called with a pointer as k: what is the same in all stages is computed once, by `body`."""
    if not is_long(rhs):
        return {"slope": plain_body(rhs, 0)}, "%k"
    once, each, size = rolled_slope(rhs)
    kept = body.value(f"alloca [{size} x double], align 64")
    body.lines.append(f"  call void @once(double %t, double %h, ptr %x, ptr %k, ptr %p, ptr %m, ptr {kept})")
    return {"once": once, "slope": each}, kept


def end_bodies(field: ca.Function, n: int) -> tuple[dict[str, Body], str]:
    """Return the body and the name of the function that a step calls at its end. If the kernel is in loops, this is its own function
    `field`."""
    return ({"ends": plain_body(field, n)}, "ends") if not is_long(field) else ({}, "field")


def plain_body(function: ca.Function, offset: int) -> Body:
    """The instructions that evaluate a function of the arguments of every kernel and write its values from an offset on."""
    body = Body()
    (values,) = inline(body, function, arguments_of(body, function))
    for i, value in enumerate(values):
        body.store(value, "%y", offset + i)
    return body


def internal_text(body: Body, inner: dict[str, Body]) -> str:
    """The text of functions that only `body` calls."""
    for function in inner.values():
        body.declarations |= function.declarations
    return "\n".join(function_text(name, function).replace("define void", "define internal void") for name, function in inner.items())


def loop_over(body: Body, n: int, target: str, base: str, factors: Sequence[float], sources: Sequence[str], scale: str = "%h") -> None:
    """target[i] = base[i] + scale * sum(factor * source[i]) for all i, left to LLVM to vectorise."""
    label = f"l{body.count}"
    body.lines += [f"  br label %{label}a", f"{label}a:", f"  br label %{label}", f"{label}:"]
    body.lines.append(f"  %{label}i = phi i64 [0, %{label}a], [%{label}n, %{label}]")

    def at(pointer: str) -> str:
        place = body.value(f"getelementptr double, ptr {pointer}, i64 %{label}i")
        return body.value(f"load double, ptr {place}")

    start = at(base) if base else ""
    used = [(f, s) for f, s in zip(factors, sources, strict=True) if f]
    value = body.combination(start, scale, [f for f, _ in used], [at(s) for _, s in used])
    place = body.value(f"getelementptr double, ptr {target}, i64 %{label}i")
    body.lines += [
        f"  store double {value}, ptr {place}",
        f"  %{label}n = add i64 %{label}i, 1",
        f"  %{label}c = icmp ult i64 %{label}n, {n}",
        f"  br i1 %{label}c, label %{label}, label %{label}z",
        f"{label}z:",
    ]
