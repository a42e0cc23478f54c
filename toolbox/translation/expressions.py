"""Expressions of the loops that are translated (`toolbox.translation.translation`): their kinds, and what of them is known."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Sequence
from typing import Any, NoReturn
from weakref import WeakKeyDictionary

import numpy as np

from toolbox.translation.kinds import CASTS, FUNCTIONS, STORED, Array, Arrays, Kind, NotTranslatable, Value, joined, known
from toolbox.translation.words import call, call_code, call_loop

COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
ARITHMETIC = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.BitAnd, ast.BitOr, ast.BitXor, ast.LShift, ast.RShift)

_SET: WeakKeyDictionary[ast.AST, frozenset[str]] = WeakKeyDictionary()
"""What `names_set` found, for as long as the tree is there."""


def names_set(tree: ast.AST) -> frozenset[str]:
    """Return the names to which a part of a function assigns values."""
    if tree not in _SET:
        _SET[tree] = frozenset(each.id for each in ast.walk(tree) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store))
    return _SET[tree]


class Expressions:
    """The expressions of one function: their kinds alone; a language, which is a class above this one, says them as well (`said`)."""

    final = False

    def __init__(self, translation: Any, made: Any):
        self.t, self.made = translation, made
        self.loops: dict[str, Kind] = {}
        self.count = 0
        self.names = {argument.arg: value for argument, value in zip(made.tree.args.args, made.arguments, strict=True)}

    def said(self, what: str, kind: Kind, *given: Any) -> Value:
        """Return an expression of a kind. Each language has a method named `what` to write the text."""
        return Value("", kind)

    def refuse(self, node: ast.AST, why: str = "") -> NoReturn:
        """Raise NotTranslatable for an expression, with the name of the function and the line."""
        line = getattr(node, "lineno", self.made.source.__code__.co_firstlineno)
        what = why or f"`{ast.unparse(node)[:80]}` is not known"
        raise NotTranslatable(f"{self.made.source.__module__}.{self.made.source.__qualname__}, line {line}: {what}")

    def value(self, node: ast.expr) -> Value:
        """An expression."""
        handler = getattr(self, f"of_{type(node).__name__}", None)
        if handler is None:
            self.refuse(node)
        found = handler(node)
        assert isinstance(found, Value)
        return found

    def of_Constant(self, node: ast.Constant) -> Value:
        """A number."""
        if isinstance(node.value, str):
            self.refuse(node)
        return known(node.value)

    def of_Name(self, node: ast.Name) -> Value:
        """Translate a name: a variable, or a constant from outside of the function."""
        name = node.id
        if name in self.loops:
            return self.said("variable", self.loops[name], name)
        if name in self.names:
            value = self.names[name]
            return value if value.kind == "none" else self.said("variable", value.kind, name)
        if name in self.made.local:
            return self.said("variable", self.made.local[name], name)
        if name in names_set(self.made.tree):
            self.refuse(node, f"`{name}` is read where it is not set")
        return self.number(node)

    def number(self, node: ast.expr) -> Value:
        """A constant of a module."""
        value = self.outside(node)
        if not isinstance(value, (int, float, np.integer, np.floating)):
            self.refuse(node)
        return known(value)

    def kind_of(self, name: str) -> Kind:
        """Return the kind of an argument; None if the name is no argument."""
        return self.names[name].kind if name in self.names else None

    def outside(self, node: ast.expr) -> Any:
        """Return the object that a name means outside of the function; None if there is no such object."""
        if isinstance(node, ast.Name):
            if node.id in self.names or node.id in self.made.local or node.id in self.loops:
                return None
            return self.made.source.__globals__.get(
                node.id, getattr(__builtins__, node.id, None) if not isinstance(__builtins__, dict) else __builtins__.get(node.id)
            )
        if isinstance(node, ast.Attribute):
            return getattr(self.outside(node.value), node.attr, None)
        return None

    def of_Attribute(self, node: ast.Attribute) -> Value:
        """An array, its size, or a constant of a module."""
        if isinstance(node.value, ast.Name) and isinstance(self.kind_of(node.value.id), Arrays):
            owner, fields = node.value.id, self.t.tuples[self.kind_of(node.value.id)]
            if node.attr not in fields:
                self.refuse(node)
            return Value(self.said("field", None, owner, node.attr).text, fields[node.attr], field=node.attr, owner=owner)
        if node.attr == "size":
            whole = self.value(node.value)
            if isinstance(whole.kind, Array):
                if None not in whole.kind.shape:
                    return known(math.prod(size for size in whole.kind.shape if size is not None))
                if not whole.field or len(whole.kind.shape) > 1:
                    self.refuse(node)
                return self.said("size", "i", whole, 0)
        return self.number(node)

    def of_Subscript(self, node: ast.Subscript) -> Value:
        """An entry or a row of an array, the rest of one, an entry of a tuple, or a size."""
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            return self.size_of(node, node.value.value)
        whole = self.value(node.value)
        if whole.kind is None:
            return Value("", None)
        if isinstance(whole.kind, tuple):
            index = self.value(node.slice)
            if not index.is_known:
                self.refuse(node)
            return self.said("of_tuple", whole.kind[index.known], whole, index.known)
        if not isinstance(whole.kind, Array):
            self.refuse(node)
        if isinstance(node.slice, ast.Slice):
            if len(whole.kind.shape) != 1 or node.slice.lower is None or node.slice.upper is not None or node.slice.step is not None:
                self.refuse(node)
            return self.said("rest", Array(whole.kind.dtype, (None,)), whole, self.value(node.slice.lower))
        indices = self.indices(node)
        fixed = self.fixed(whole, indices)
        if fixed is not None:
            return known(fixed)
        rest = whole.kind.shape[len(indices) :]
        if rest:
            return self.said("row", Array(whole.kind.dtype, rest), whole, indices)
        return self.said("entry", STORED[whole.kind.dtype], whole, indices)

    def size_of(self, node: ast.Subscript, of: ast.expr) -> Value:
        """A size of an array."""
        whole, place = self.value(of), self.value(node.slice).known
        if not isinstance(whole.kind, Array) or (whole.kind.shape[place] is None and not whole.field):
            self.refuse(node)
        return self.said("size", "i", whole, place) if whole.kind.shape[place] is None else known(whole.kind.shape[place])

    def indices(self, node: ast.Subscript) -> list[Value]:
        """The indices of an entry or a row."""
        found = [self.value(each) for each in (node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice])]
        if any(index.kind not in ("i", None) for index in found):
            self.refuse(node, f"an index of `{ast.unparse(node)}` is no whole number")
        return found

    def fixed(self, whole: Value, indices: Sequence[Value]) -> Any:
        """Return the number at a place of an array if the number never changes, else None."""
        return self.t.numbers.get((whole.field, indices[0].known)) if whole.field and len(indices) == 1 and indices[0].is_known else None

    def of_UnaryOp(self, node: ast.UnaryOp) -> Value:
        """Not, or minus."""
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return known(not value.known) if value.is_known else self.said("inverse", "b", value)
        if not isinstance(node.op, ast.USub):
            self.refuse(node)
        return known(-value.known) if value.is_known else self.said("negative", value.kind, value)

    def of_BinOp(self, node: ast.BinOp) -> Value:
        """Arithmetic."""
        a, b = self.value(node.left), self.value(node.right)
        if a.is_known and b.is_known:
            whole = ast.Expression(ast.fix_missing_locations(ast.BinOp(ast.Constant(a.known), node.op, ast.Constant(b.known))))
            return known(eval(compile(whole, "", "eval")))
        if isinstance(node.op, ast.Pow):
            return self.said("helped", "f", "square", a) if b.known == 2 else self.said("power", "f", a, b)
        kind = joined(a.kind, b.kind) if "u" not in (a.kind, b.kind) else "u"
        if kind == "b" or "none" in (a.kind, b.kind):
            self.refuse(node)
        if isinstance(node.op, ast.FloorDiv | ast.Mod):
            if kind not in ("i", None):
                self.refuse(node)
            return self.said("helped", "i", "floor_div" if isinstance(node.op, ast.FloorDiv) else "floor_mod", a, b)
        if not isinstance(node.op, ARITHMETIC):
            self.refuse(node)
        if isinstance(node.op, ast.Div):
            return self.said("quotient", "f", a, b)
        return self.said("arithmetic", kind, type(node.op), a, b)

    def of_Compare(self, node: ast.Compare) -> Value:
        """A comparison, also of several in a row."""
        parts = []
        left = self.value(node.left)
        sure = True
        for op, right_node in zip(node.ops, node.comparators, strict=True):
            right = self.value(right_node)
            if isinstance(op, (ast.Is, ast.IsNot)):
                if right.kind != "none" or len(node.ops) > 1:
                    self.refuse(node)
                return known((left.kind == "none" and left.known is None) == isinstance(op, ast.Is))
            if type(op) not in COMPARISONS:
                self.refuse(node)
            if left.is_known and right.is_known:
                parts.append(known(COMPARISONS[type(op)](left.known, right.known)))
            else:
                sure = False
                parts.append(self.said("comparison", "b", type(op), left, right))
            left = right
        if sure:
            return known(all(part.known for part in parts))
        return self.said("all_of", "b", parts)

    def of_BoolOp(self, node: ast.BoolOp) -> Value:
        """Translate `and` and `or`. Known operands are left out."""
        is_and = isinstance(node.op, ast.And)
        kept: list[Value] = []
        for each in node.values:
            value = self.value(each)
            if value.is_known and bool(value.known) is is_and:
                continue
            if value.is_known:
                if not kept:
                    return known(not is_and)
                kept.append(known(not is_and))
                break
            kept.append(value)
        if not kept:
            return known(is_and)
        return self.said("one_or_all", "b", is_and, kept)

    def of_IfExp(self, node: ast.IfExp) -> Value:
        """One of two values."""
        test = self.value(node.test)
        if test.is_known:
            return self.value(node.body if test.known else node.orelse)
        a, b = self.value(node.body), self.value(node.orelse)
        return self.said("choice", joined(a.kind, b.kind), test, a, b)

    def of_Call(self, node: ast.Call) -> Value:
        """Translate a call of model code, of another function of the loop, or of a function that C has."""
        if node.keywords:
            self.refuse(node)
        if isinstance(node.func, ast.Attribute) and node.func.attr == "view":
            return self.viewed(node, node.func.value)
        function = self.outside(node.func)
        if function is None:
            self.refuse(node)
        values = [self.value(each) for each in node.args]
        if function is call:
            return self.said("model", "none", values[0], values[1:])
        if function is call_code:
            return self.said("code", "none", values[0], values[1:])
        if function is call_loop:
            return self.said("loop", "i", *values)
        for known_function, handler in _CALLS:
            if function is known_function:
                return handler(self, node, values)
        if function in FUNCTIONS:
            return self.said("function", "f", FUNCTIONS[function], values)
        if function in CASTS:
            kind = CASTS[function]
            if values[0].is_known:
                return known(function(values[0].known))
            return self.said("cast", kind, values[0])
        plain = getattr(function, "py_func", function)
        if not hasattr(plain, "__code__") or any(value.kind is None for value in values):
            if any(value.kind is None for value in values) and not self.final:
                return Value("", None)
            self.refuse(node)
        values = [Value(value.text, Array(value.kind.dtype, (None,))) if isinstance(value.kind, Array) else value for value in values]
        made = self.t.written(function, values) if self.final else self.t.function(function, values)
        return self.said("called", made.returns, made, [value for value in values if value.kind != "none"])

    def viewed(self, node: ast.Call, of: ast.expr) -> Value:
        """The bits of a number as a whole number, or the other way."""
        value = self.value(of)
        wanted = CASTS.get(self.outside(node.args[0]))
        if (value.kind, wanted) == ("f", "i"):
            return self.said("helped", "i", "bits_of", value)
        if (value.kind, wanted) != ("i", "f"):
            self.refuse(node)
        return self.said("helped", "f", "number_of", value)

    def extreme(self, name: str, values: list[Value]) -> Value:
        """Return the smallest or largest of several numbers, with the choice that Python makes if a number is nan."""
        kind: Kind = None
        for value in values:
            kind = joined(kind, value.kind)
        found = values[0]
        for value in values[1:]:
            found = self.said("helped", kind, f"{name}_{'i' if kind == 'i' else 'f'}", found, value)
        return found


def _absolute(writer: Expressions, node: ast.Call, values: list[Value]) -> Value:
    if values[0].kind not in ("f", None):
        writer.refuse(node)
    return writer.said("function", "f", "fabs", values)


_CALLS: tuple[tuple[Any, Callable[[Expressions, ast.Call, list[Value]], Value]], ...] = (
    (min, lambda writer, node, values: writer.extreme("min", values)),
    (max, lambda writer, node, values: writer.extreme("max", values)),
    (abs, _absolute),
    (math.isfinite, lambda writer, node, values: writer.said("finite", "b", values[0])),
    (math.floor, lambda writer, node, values: writer.said("floor", "i", values[0])),
    (np.int8, lambda writer, node, values: writer.said("byte", "i", values[0])),
)
