"""Expressions of the loops in C (`toolbox.export.translation`)."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np

from toolbox.compilation.calls import call, lent, owned
from toolbox.export.c_values import (
    C_TYPES,
    CASTS,
    FUNCTIONS,
    HELPERS,
    OPERATORS,
    STORED,
    Array,
    Kind,
    NotTranslatable,
    Value,
    c_word,
    joined,
    known,
)


class Expressions:
    """The expressions of one function, or, before its types are known, their kinds."""

    def __init__(self, translation: Any, made: Any, final: bool = False):
        self.t, self.made, self.final = translation, made, final
        self.lines: list[str] = []
        self.depth = 1
        self.loops: dict[str, int] = {}
        self.count = 0
        self.names = {argument.arg: value for argument, value in zip(made.tree.args.args, made.arguments, strict=True)}

    def refuse(self, node: ast.AST, why: str = "") -> NoReturn:
        """Refuse what is not known, by name and line."""
        line = self.made.source.__code__.co_firstlineno + getattr(node, "lineno", 1) - 1
        what = why or f"`{ast.unparse(node)[:80]}` is not known"
        raise NotTranslatable(f"{self.made.source.__module__}.{self.made.source.__qualname__}, line {line}: {what}")

    def value(self, node: ast.expr, store: bool = False) -> Value:
        """An expression."""
        if isinstance(node, ast.Subscript):
            return self.entry(node, store)
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
        """A variable, or what stands outside of the function."""
        name = node.id
        if name in self.loops:
            return Value(c_word(name), self.loops[name])
        if name in self.names:
            value = self.names[name]
            return value if value.kind == "none" else Value(c_word(name), value.kind)
        if name in self.made.local:
            return Value(c_word(name), self.made.local[name])
        if any(isinstance(each, ast.Name) and each.id == name and isinstance(each.ctx, ast.Store) for each in ast.walk(self.made.tree)):
            self.refuse(node, f"`{name}` is read where it is not set")
        return self.number(node)

    def number(self, node: ast.expr) -> Value:
        """A constant of a module."""
        value = self.outside(node)
        if not isinstance(value, (int, float, np.integer, np.floating)):
            self.refuse(node)
        return known(value)

    def outside(self, node: ast.expr) -> Any:
        """What a name means outside of the function; None for nothing."""
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
        if isinstance(node.value, ast.Name) and node.value.id in self.names and self.names[node.value.id].kind == "w":
            if node.attr not in self.t.work:
                self.refuse(node)
            array = self.t.work[node.attr]
            place = self.t.constant.get(node.attr)
            return Value(place or f"{node.value.id}->{node.attr}", Array(str(array.dtype), array.shape))
        if node.attr == "size":
            array_kind = self.value(node.value).kind
            if isinstance(array_kind, Array) and None not in array_kind.shape:
                return known(math.prod(size for size in array_kind.shape if size is not None))
        return self.number(node)

    def entry(self, node: ast.Subscript, store: bool) -> Value:
        """An entry or a row of an array, the rest of one, an entry of a tuple, or a size."""
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            return self.size_of(node, node.value.value)
        whole = self.value(node.value)
        if whole.kind is None:
            return Value("0", None)
        if isinstance(whole.kind, tuple):
            index = self.value(node.slice)
            if not index.is_known:
                self.refuse(node)
            return Value(f"{whole.text}.f{index.known}", whole.kind[index.known])
        if not isinstance(whole.kind, Array):
            self.refuse(node)
        return self.entry_of(node, whole, store)

    def size_of(self, node: ast.Subscript, of: ast.expr) -> Value:
        """A size of an array."""
        kind, place = self.value(of).kind, self.value(node.slice).known
        if not isinstance(kind, Array) or kind.shape[place] is None:
            self.refuse(node)
        return known(kind.shape[place])

    def entry_of(self, node: ast.Subscript, whole: Value, store: bool) -> Value:
        """An entry or a row of an array, or the rest of one."""
        shape = whole.kind.shape
        if isinstance(node.slice, ast.Slice):
            if len(shape) != 1 or node.slice.lower is None or node.slice.upper is not None or node.slice.step is not None:
                self.refuse(node)
            return Value(f"({whole.text} + {self.value(node.slice.lower).text})", Array(whole.kind.dtype, (None,)))
        indices = [self.value(each) for each in (node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice])]
        if any(index.kind not in ("i", None) for index in indices):
            self.refuse(node, f"an index of `{ast.unparse(node)}` is no whole number")
        if isinstance(node.value, ast.Attribute) and len(indices) == 1 and indices[0].is_known:
            fixed = self.t.numbers.get((node.value.attr, indices[0].known))
            if fixed is not None:
                if store:
                    self.refuse(node, f"`{ast.unparse(node)}` never changes")
                return known(fixed)
        if store and isinstance(node.value, ast.Attribute) and node.value.attr in self.t.constant:
            self.refuse(node, f"`{node.value.attr}` never changes")
        place = indices[0].text
        for size, index in zip(shape[1:], indices[1:], strict=False):
            place = f"({place}) * {size} + {index.text}"
        rest = shape[len(indices) :]
        if rest:
            return Value(
                f"({whole.text} + ({place}) * {math.prod(size for size in rest if size is not None)})", Array(whole.kind.dtype, rest)
            )
        return Value(f"{whole.text}[{place}]", STORED[whole.kind.dtype][0])

    def of_UnaryOp(self, node: ast.UnaryOp) -> Value:
        """Not, or minus."""
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return known(not value.known) if value.is_known else Value(f"!({value.text})", "b")
        if not isinstance(node.op, ast.USub):
            self.refuse(node)
        return known(-value.known) if value.is_known else Value(f"(-{value.text})", value.kind)

    def of_BinOp(self, node: ast.BinOp) -> Value:
        """Arithmetic."""
        a, b = self.value(node.left), self.value(node.right)
        if a.is_known and b.is_known:
            return known(
                eval(
                    compile(
                        ast.Expression(ast.fix_missing_locations(ast.BinOp(ast.Constant(a.known), node.op, ast.Constant(b.known)))),
                        "",
                        "eval",
                    )
                )
            )
        if isinstance(node.op, ast.Pow):
            if b.known == 2:
                return self.helped("square", "f", a)
            return Value(f"pow({a.text}, {b.text})", "f")
        kind = joined(a.kind, b.kind) if "u" not in (a.kind, b.kind) else "u"
        if kind == "b" or "none" in (a.kind, b.kind):
            self.refuse(node)
        if isinstance(node.op, ast.FloorDiv | ast.Mod):
            if kind not in ("i", None):
                self.refuse(node)
            return self.helped("floor_div" if isinstance(node.op, ast.FloorDiv) else "floor_mod", "i", a, b)
        if type(node.op) not in OPERATORS:
            self.refuse(node)
        if isinstance(node.op, ast.Div):
            return Value(f"({f'(double){a.text}' if a.kind == 'i' else a.text} / {b.text})", "f")
        return Value(f"({a.text} {OPERATORS[type(node.op)]} {b.text})", kind)

    def helped(self, name: str, kind: str, *values: Value) -> Value:
        """A call of a small function of ours."""
        if self.final:
            self.t.helpers[name] = HELPERS[name]
        return Value(f"{name}({', '.join(value.text for value in values)})", kind)

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
            if type(op) not in OPERATORS:
                self.refuse(node)
            if left.is_known and right.is_known:
                text = OPERATORS[type(op)]
                parts.append(known(eval(f"a {text} b", {"a": left.known, "b": right.known})))
            else:
                sure = False
                parts.append(Value(f"{left.text} {OPERATORS[type(op)]} {right.text}", "b"))
            left = right
        if sure:
            return known(all(part.known for part in parts))
        return Value("(" + " && ".join(part.text for part in parts) + ")", "b")

    def of_BoolOp(self, node: ast.BoolOp) -> Value:
        """And, or: what is known is left out."""
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
        return Value("(" + (" && " if is_and else " || ").join(value.text for value in kept) + ")", "b")

    def of_IfExp(self, node: ast.IfExp) -> Value:
        """One of two values."""
        test = self.value(node.test)
        if test.is_known:
            return self.value(node.body if test.known else node.orelse)
        a, b = self.value(node.body), self.value(node.orelse)
        return Value(f"({test.text} ? {a.text} : {b.text})", joined(a.kind, b.kind))

    def of_Call(self, node: ast.Call) -> Value:
        """A call: of model code, of a function of the loop, or of one that C has."""
        if node.keywords:
            self.refuse(node)
        if isinstance(node.func, ast.Attribute) and node.func.attr == "view":
            return self.viewed(node, node.func.value)
        function = self.outside(node.func)
        if function is None:
            self.refuse(node)
        if function in (lent, owned):
            return self.value(node.args[0])
        values = [self.value(each) for each in node.args]
        if function is call:
            return self.model_call(values)
        for known_function, handler in _CALLS:
            if function is known_function:
                return handler(self, node, values)
        if function in FUNCTIONS:
            return Value(f"{FUNCTIONS[function]}({', '.join(value.text for value in values)})", "f")
        if function in CASTS:
            kind = CASTS[function]
            if values[0].is_known:
                return known(function(values[0].known))
            return Value(f"({C_TYPES[kind]})({values[0].text})", kind)
        plain = getattr(function, "py_func", function)
        if not hasattr(plain, "__code__") or any(value.kind is None for value in values):
            if any(value.kind is None for value in values) and not self.final:
                return Value("0", None)
            self.refuse(node)
        values = [Value(value.text, Array(value.kind.dtype, (None,))) if isinstance(value.kind, Array) else value for value in values]
        made = self.t.written(function, values) if self.final else self.t.function(function, values)
        return Value(f"{made.name}({', '.join(value.text for value in values if value.kind != 'none')})", made.returns)

    def viewed(self, node: ast.Call, of: ast.expr) -> Value:
        """The bits of a number as a whole number, or the other way."""
        value = self.value(of)
        wanted = CASTS.get(self.outside(node.args[0]))
        if (value.kind, wanted) == ("f", "i"):
            return self.helped("bits_of", "i", value)
        if (value.kind, wanted) != ("i", "f"):
            self.refuse(node)
        return self.helped("number_of", "f", value)

    def model_call(self, values: list[Value]) -> Value:
        """A call of model code, whose address is a number of the model or stands in an array."""
        address, rest = values[0], ", ".join(value.text for value in values[1:])
        if not address.is_known:
            return Value(f"{self.t.update}({address.text}, {rest})", "none")
        if address.known == 0:
            return Value("", "none")  # what the model does not have is never reached
        return Value(f"{self.t.models[address.known]}({rest})", "none")

    def extreme(self, name: str, values: list[Value]) -> Value:
        """The smallest or largest of some numbers, as Python chooses where one is not a number."""
        kind: Kind = None
        for value in values:
            kind = joined(kind, value.kind)
        found = values[0]
        for value in values[1:]:
            found = self.helped(f"{name}_{'i' if kind == 'i' else 'f'}", kind, found, value)
        return found


def _absolute(writer: Expressions, node: ast.Call, values: list[Value]) -> Value:
    if values[0].kind not in ("f", None):
        writer.refuse(node)
    return Value(f"fabs({values[0].text})", "f")


_CALLS: tuple[tuple[Any, Callable[[Expressions, ast.Call, list[Value]], Value]], ...] = (
    (min, lambda writer, node, values: writer.extreme("min", values)),
    (max, lambda writer, node, values: writer.extreme("max", values)),
    (abs, _absolute),
    (math.isfinite, lambda writer, node, values: Value(f"(isfinite({values[0].text}) != 0)", "b")),
    (math.floor, lambda writer, node, values: Value(f"(int64_t)floor({values[0].text})", "i")),
    (np.int8, lambda writer, node, values: Value(f"(int8_t)({values[0].text})", "i")),
)
