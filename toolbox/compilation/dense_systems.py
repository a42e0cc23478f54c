"""Dense systems of equations in machine code: loops at run time over the entries that the equations of a model compute.

`dense_factor` splits a matrix into triangular factors and `dense_solve` solves with them, both for any size n, in natural order and without search for
pivots, as `toolbox.modelling.elimination` does where it writes the operations out. The work is n^3/3 operations for factors and n^2 for a solution; rows of
sliding contacts, which hold a one alone, cost next to nothing.

A matrix lies column by column, each column filled up to `width` blocks of 8 numbers, followed by the columns of the lower factor and by the inverse
pivots. Zeros outside the triangles let every loop run over whole blocks.
"""

from __future__ import annotations

from toolbox.compilation.loop_text import LoopText

BLOCK = 8
"""Numbers of a block: one register of 512 bits."""

NAMES = ("dense_factor", "dense_solve")


def blocks(n: int) -> int:
    """Blocks of a column of n numbers."""
    return -(-n // BLOCK)


def factor_size(n: int) -> int:
    """Numbers that a matrix of n rows takes with its factors."""
    return (2 * n + 1) * blocks(n) * BLOCK


class _Text(LoopText):
    """The same, with blocks of numbers."""

    def vector_at(self, pointer: str, block: str) -> str:
        return self.value(f"getelementptr {_V}, ptr {pointer}, i64 {block}")

    def spread(self, number: str, kind: str = "double") -> str:
        """A number of a kind in every place of a block."""
        block = f"<{BLOCK} x {kind}>"
        one = self.value(f"insertelement {block} poison, {kind} {number}, i32 0")
        return self.value(f"shufflevector {block} {one}, {block} poison, <{BLOCK} x i32> zeroinitializer")

    def less_product(self, first: str, end: str, target: str, factor: str, source: str) -> None:
        """target -= factor * source over a range of blocks."""
        many = self.spread(factor)
        with self.loop(first, end) as c:
            place = self.vector_at(target, c)
            product = self.value(f"fmul contract {_V} {many}, {self.load(self.vector_at(source, c), _V)}")
            self.store(self.value(f"fsub contract {_V} {self.load(place, _V)}, {product}"), place, _V)


_V = f"<{BLOCK} x double>"
_I = f"<{BLOCK} x i64>"
_LANES = f"<{', '.join(f'i64 {i}' for i in range(BLOCK))}>"


def _parts(text: _Text) -> tuple[str, str, str]:
    """(numbers in a column, the lower factor, the inverse pivots)."""
    length = text.value(f"mul i64 %width, {BLOCK}")
    size = text.value(f"mul i64 %n, {length}")
    lower = text.at("%a", size)
    return length, lower, text.at(lower, size)


def _factor() -> str:
    text = _Text()
    length, lower, inverses = _parts(text)
    with text.loop("0", "%n") as k:
        offset = text.value(f"mul i64 {k}, {length}")
        column, below = text.at("%a", offset), text.at(lower, offset)
        inverse = text.value(f"fdiv double 1.0, {text.load(text.at(column, k))}")
        text.store(inverse, text.at(inverses, k))
        first = text.value(f"sdiv i64 {k}, {BLOCK}")
        scale = text.spread(inverse)
        here = text.spread(k, "i64")
        with text.loop(first, "%width") as c:
            start = text.spread(text.value(f"mul i64 {c}, {BLOCK}"), "i64")
            rows = text.value(f"add {_I} {start}, {_LANES}")
            place = text.vector_at(column, c)
            old = text.load(place, _V)
            under = text.value(f"icmp sgt {_I} {rows}, {here}")
            scaled = text.value(f"fmul {_V} {old}, {scale}")
            text.store(text.value(f"select <{BLOCK} x i1> {under}, {_V} {scaled}, {_V} zeroinitializer"), text.vector_at(below, c), _V)
            over = text.value(f"icmp slt {_I} {rows}, {here}")
            text.store(text.value(f"select <{BLOCK} x i1> {over}, {_V} {old}, {_V} zeroinitializer"), place, _V)
        following = text.value(f"add i64 {k}, 1")
        with text.loop(following, "%n") as j:
            other = text.at("%a", text.value(f"mul i64 {j}, {length}"))
            factor = text.load(text.at(other, k))
            q = f"s{next(text.numbers)}"
            text.lines.append(f"  {'%' + q} = fcmp oeq double {factor}, 0.0")
            text.lines.append(f"  br i1 %{q}, label %{q}_skip, label %{q}_go")
            text.start(f"{q}_go")
            text.less_product(first, "%width", other, factor, below)
            text.go(f"{q}_skip")
            text.start(f"{q}_skip")
    return text.function("dense_factor", "i64 %n, i64 %width, ptr %a")


def _solve() -> str:
    text = _Text()
    length, lower, inverses = _parts(text)
    with text.loop("0", "%n") as k:
        known = text.load(text.at("%b", k))
        first = text.value(f"sdiv i64 {k}, {BLOCK}")
        text.less_product(first, "%width", "%b", known, text.at(lower, text.value(f"mul i64 {k}, {length}")))
    with text.loop("0", "%n", down=True) as k:
        place = text.at("%b", k)
        known = text.value(f"fmul double {text.load(place)}, {text.load(text.at(inverses, k))}")
        end = text.value(f"add i64 {text.value(f'sdiv i64 {k}, {BLOCK}')}, 1")
        text.less_product("0", end, "%b", known, text.at("%a", text.value(f"mul i64 {k}, {length}")))
        text.store(known, place)
    return text.function("dense_solve", "i64 %n, i64 %width, ptr %a, ptr %b")


def module_text() -> str:
    """The LLVM module of both functions."""
    return "\n".join([_factor(), _solve()]).replace("define internal", "define")
