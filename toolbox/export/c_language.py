"""The loops in C99: the language of an exported machine (`toolbox.translation.translation`)."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.translation.kinds import FUNCTIONS, Array, Arrays, Kind, NotTranslatable, Value
from toolbox.translation.statements import Writer
from toolbox.translation.translation import Function, Translation

C_TYPES = {"f": "double", "i": "int64_t", "u": "uint64_t", "b": "int"}
STORED_TYPES = {
    "float64": "double", "int64": "int64_t", "uint64": "uint64_t", "bool": "uint8_t", "int8": "int8_t", "int32": "int32_t",
}  # fmt: skip
"""{dtype: type that is stored}."""

HELPERS = {
    "min_f": "static double min_f(double a, double b) { return b < a ? b : a; }",
    "max_f": "static double max_f(double a, double b) { return b > a ? b : a; }",
    "min_i": "static int64_t min_i(int64_t a, int64_t b) { return b < a ? b : a; }",
    "max_i": "static int64_t max_i(int64_t a, int64_t b) { return b > a ? b : a; }",
    "square": "static double square(double a) { return a * a; }",
    "floor_div": "static int64_t floor_div(int64_t a, int64_t b) { return a / b - (a % b != 0 && (a < 0) != (b < 0)); }",
    "floor_mod": "static int64_t floor_mod(int64_t a, int64_t b) { return a - b * (a / b - (a % b != 0 && (a < 0) != (b < 0))); }",
    "bits_of": "static int64_t bits_of(double a) { int64_t b; memcpy(&b, &a, sizeof b); return b; }",
    "number_of": "static double number_of(int64_t a) { double b; memcpy(&b, &a, sizeof b); return b; }",
}
OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^", ast.LShift: "<<", ast.RShift: ">>",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
WORDS = """floor pow fabs isfinite memcpy double float int long short signed unsigned register auto static struct union const default switch case do"""
RESERVED = {*FUNCTIONS.values(), *HELPERS, *WORDS.split()}


def c_number(value: Any) -> str:
    """A number as an expression in C."""
    if value is None:
        return "0"
    if isinstance(value, (bool, np.bool_)):
        return str(int(value))
    if isinstance(value, np.uint64):
        return f"UINT64_C({int(value)})"
    if isinstance(value, (int, np.integer)):
        text = str(int(value)) if abs(int(value)) < 2**31 else f"INT64_C({int(value)})"
        return f"({text})" if value < 0 else text
    value = float(value)
    text = "NAN" if math.isnan(value) else ("-" if value < 0 else "") + "INFINITY" if math.isinf(value) else repr(value)
    return f"({text})" if text[0] == "-" else text


def c_word(name: str) -> str:
    """The name of a variable in C."""
    return f"{name}_" if name in RESERVED else name


def _text(value: Value) -> str:
    return c_number(value.known) if value.is_known else value.text


class CExpressions(Writer):
    """Expressions in C: the text of each operation that `toolbox.translation.expressions` names."""

    final = True
    t: CTranslation

    def said(self, what: str, kind: Kind, *given: Any) -> Value:
        """An expression of a kind."""
        return Value(getattr(self, f"c_{what}")(kind, *given), kind)

    def c_variable(self, kind: Kind, name: str) -> str:
        return c_word(name)

    def c_field(self, kind: Kind, owner: str, name: str) -> str:
        return self.t.constant.get(name) or f"{owner}->{name}"

    def c_size(self, kind: Kind, whole: Value, place: int) -> str:
        raise NotTranslatable(f"{self.made.source.__qualname__}: a size of `{whole.field}` is not known")

    def c_of_tuple(self, kind: Kind, whole: Value, place: int) -> str:
        return f"{whole.text}.f{place}"

    def c_rest(self, kind: Kind, whole: Value, lower: Value) -> str:
        return f"({whole.text} + {_text(lower)})"

    def place(self, whole: Value, indices: Sequence[Value]) -> str:
        """The number of an entry in an array."""
        place = _text(indices[0])
        for size, index in zip(whole.kind.shape[1:], indices[1:], strict=False):
            place = f"({place}) * {size} + {_text(index)}"
        return place

    def c_row(self, kind: Array, whole: Value, indices: Sequence[Value]) -> str:
        return f"({whole.text} + ({self.place(whole, indices)}) * {math.prod(size for size in kind.shape if size is not None)})"

    def c_entry(self, kind: Kind, whole: Value, indices: Sequence[Value]) -> str:
        return f"{whole.text}[{self.place(whole, indices)}]"

    def c_inverse(self, kind: Kind, value: Value) -> str:
        return f"!({value.text})"

    def c_negative(self, kind: Kind, value: Value) -> str:
        return f"(-{value.text})"

    def c_helped(self, kind: Kind, name: str, *values: Value) -> str:
        self.t.helpers[name] = HELPERS[name]
        return f"{name}({', '.join(map(_text, values))})"

    def c_power(self, kind: Kind, a: Value, b: Value) -> str:
        return f"pow({_text(a)}, {_text(b)})"

    def c_quotient(self, kind: Kind, a: Value, b: Value) -> str:
        return f"({f'(double){_text(a)}' if a.kind == 'i' else _text(a)} / {_text(b)})"

    def c_arithmetic(self, kind: Kind, operation: type[ast.AST], a: Value, b: Value) -> str:
        return f"({_text(a)} {OPERATORS[operation]} {_text(b)})"

    def c_comparison(self, kind: Kind, operation: type[ast.AST], a: Value, b: Value) -> str:
        return f"{_text(a)} {OPERATORS[operation]} {_text(b)}"

    def c_all_of(self, kind: Kind, parts: Sequence[Value]) -> str:
        return "(" + " && ".join(map(_text, parts)) + ")"

    def c_one_or_all(self, kind: Kind, every: bool, parts: Sequence[Value]) -> str:
        return "(" + (" && " if every else " || ").join(map(_text, parts)) + ")"

    def c_choice(self, kind: Kind, test: Value, a: Value, b: Value) -> str:
        return f"({test.text} ? {_text(a)} : {_text(b)})"

    def c_function(self, kind: Kind, name: str, values: Sequence[Value]) -> str:
        return f"{name}({', '.join(map(_text, values))})"

    def c_cast(self, kind: str, value: Value) -> str:
        return f"({C_TYPES[kind]})({_text(value)})"

    def c_finite(self, kind: Kind, value: Value) -> str:
        return f"(isfinite({_text(value)}) != 0)"

    def c_floor(self, kind: Kind, value: Value) -> str:
        return f"(int64_t)floor({_text(value)})"

    def c_byte(self, kind: Kind, value: Value) -> str:
        return f"(int8_t)({_text(value)})"

    def c_called(self, kind: Kind, made: Function, values: Sequence[Value]) -> str:
        return f"{made.name}({', '.join(map(_text, values))})"

    def c_model(self, kind: Kind, address: Value, values: Sequence[Value]) -> str:
        given = ", ".join(map(_text, values))
        if not address.is_known:
            return f"{self.t.update}({address.text}, {given})"
        return f"{self.t.models[address.known]}({given})" if address.known else ""  # what the model does not have is never reached


class CWriter(CExpressions):
    """Writes one function in C."""

    def __init__(self, translation: CTranslation, made: Function):
        super().__init__(translation, made)
        self.lines: list[str] = []
        self.depth = 1

    def text(self) -> str:
        """The function in C."""
        self.body()
        parameters = [name for name, value in self.names.items() if value.kind != "none"]
        variables = {name: kind for name, kind in self.made.local.items() if name not in self.names}
        head = [
            f"  {self.t.c_type(kind)} {c_word(name)} = 0;".replace("* ", "*")
            for name, kind in variables.items()
            if not isinstance(kind, tuple)
        ]
        body = "\n".join(self.lines)
        set_only = {name: len(re.findall(rf"^ *{c_word(name)} = ", body, re.MULTILINE)) for name in variables}
        unread = [
            c_word(name)
            for name in (*parameters, *variables)
            if len(re.findall(rf"(?<![.>\w]){c_word(name)}\b", body)) == set_only.get(name, 0)
        ]
        quiet = ["  " + " ".join(f"(void){name};" for name in unread)] if unread else []
        return "\n".join([self.t.declaration(self.made) + " {", *head, *quiet, *self.lines, "}"])

    def emit(self, line: str) -> None:
        """Write one line."""
        self.lines.append("  " * self.depth + line)

    def nested(self, head: str, statements: Sequence[ast.stmt], tail: str = "}") -> None:
        """Write statements between braces."""
        self.emit(head)
        self.depth += 1
        self.block(statements)
        self.depth -= 1
        if tail:
            self.emit(tail)

    def jump(self, how: str) -> None:
        """Leave a loop, or a turn of it."""
        self.emit(f"{how};")

    def run(self, value: Value) -> None:
        """Carry out a call."""
        if value.text:
            self.emit(f"{value.text};")

    def give(self, values: Sequence[Value]) -> None:
        """End the function with its returned values."""
        if isinstance(self.made.returns, tuple):
            self.emit(f"return ({self.t.c_type(self.made.returns)}){{{', '.join(map(_text, values))}}};")
        else:
            self.emit(f"return {_text(values[0])};" if values else "return;")

    def branch(self, test: Value, body: Sequence[ast.stmt], otherwise: Sequence[ast.stmt]) -> None:
        """Statements under a condition, and others without it."""
        self.nested(f"if ({bare(test.text)}) {{", body, "" if otherwise else "}")
        if otherwise:
            self.nested("} else {", otherwise)

    def repeat(self, test: Value, body: Sequence[ast.stmt]) -> None:
        """Statements as long as a condition holds."""
        self.nested("for (;;) {" if test.is_known else f"while ({bare(test.text)}) {{", body)

    def through(self, name: str, bounds: tuple[Value, Value, int], body: Sequence[ast.stmt]) -> None:
        """Statements for every number of a range."""
        first, last, step = bounds
        end, word = f"end_{self.count}", c_word(name)
        bound = _text(last) if last.is_known else end
        more = "" if last.is_known else f", {end} = {last.text}"
        self.nested(
            f"for (int64_t {word} = {_text(first)}{more}; {word} {'<' if step == 1 else '>'} {bound}; {'++' if step == 1 else '--'}{word}) {{",
            body,
        )

    def each(self, name: str, values: Sequence[Value], body: Sequence[ast.stmt]) -> None:
        """Statements for each of a few numbers."""
        kind, place = values[0].kind, f"place_{self.count}"
        self.emit("{")
        self.depth += 1
        self.emit(f"static const {C_TYPES[kind]} each_{self.count}[{len(values)}] = {{{', '.join(map(_text, values))}}};")
        self.emit(f"int {place};")
        self.emit(f"for ({place} = 0; {place} < {len(values)}; ++{place}) {{")
        self.depth += 1
        self.emit(f"const {C_TYPES[kind]} {c_word(name)} = each_{self.count}[{place}];")
        self.block(body)
        for _ in range(2):
            self.depth -= 1
            self.emit("}")

    def at_once(self, targets: Sequence[ast.expr], values: Sequence[Value]) -> None:
        """Assign several values to several places. A value may read a place that the same statement assigns."""
        self.emit("{")
        self.depth += 1
        for i, value in enumerate(values):
            self.emit(f"const {self.t.c_type(value.kind)} new_{i} = {_text(value)};")
        super().at_once(targets, [Value(f"new_{i}", value.kind) for i, value in enumerate(values)])
        self.depth -= 1
        self.emit("}")

    def taken_apart(self, targets: Sequence[ast.expr], value: Value) -> None:
        """Set several places to the entries of a tuple."""
        self.emit("{")
        self.depth += 1
        self.emit(f"const {self.t.c_type(value.kind)} new = {value.text};")
        super().taken_apart(targets, Value("new", value.kind))
        self.emit("(void)new;")
        self.depth -= 1
        self.emit("}")

    def set(self, name: str, value: Value) -> None:
        """Set a variable."""
        self.emit(f"{c_word(name)} = {_text(value)};")

    def put(self, whole: Value, indices: Sequence[Value], value: Value) -> None:
        """Set an entry of an array."""
        self.emit(f"{self.c_entry(None, whole, indices)} = {_text(value)};")


def bare(text: str) -> str:
    """Return a condition without outer parentheses, because compilers warn that `=` may be meant there."""
    depth = 0
    for i, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and i < len(text) - 1:
            return text
    return bare(text[1:-1]) if text.startswith("(") else text


@dataclass
class CTranslation(Translation):
    """The functions that a loop reaches, as C.

    constant: {field: name in C} of arrays that never change;  models: {value of an address among the numbers: function in C}, `update` is called with
    addresses that are read from arrays;  struct: the type of `w`.
    """

    language: type[Any] = CWriter
    models: Mapping[int, str] = field(default_factory=dict)
    update: str = ""
    struct: str = ""
    structs: dict[tuple[str, ...], str] = field(default_factory=dict)
    helpers: dict[str, str] = field(default_factory=dict)

    def struct_of(self, kinds: tuple[str, ...]) -> str:
        """The struct of a tuple."""
        if not all(isinstance(kind, str) and kind in C_TYPES for kind in kinds):
            raise NotTranslatable(f"a tuple of {kinds} has no struct")
        return self.structs.setdefault(kinds, f"loop_{''.join(kinds)}")

    def c_type(self, kind: Kind) -> str:
        """The type in C of a kind."""
        if kind is None or kind == "none":
            return "void"
        if isinstance(kind, tuple):
            return self.struct_of(kind)
        if isinstance(kind, Array):
            return f"{STORED_TYPES[kind.dtype]} *"
        return f"{self.struct} *" if isinstance(kind, Arrays) else C_TYPES[kind]

    def declaration(self, made: Function) -> str:
        """The head of a function."""
        names = [argument.arg for argument in made.tree.args.args]
        given = [
            f"{self.c_type(value.kind)} {c_word(name)}".replace("* ", "*")
            for name, value in zip(names, made.arguments, strict=True)
            if value.kind != "none"
        ]
        return f"static {self.c_type(made.returns)} {made.name}({', '.join(given) or 'void'})"

    def source(self) -> str:
        """Return all written text, in an order that C can read."""
        structs = [
            f"typedef struct {{ {' '.join(f'{C_TYPES[kind]} f{i};' for i, kind in enumerate(kinds))} }} {name};"
            for kinds, name in self.structs.items()
        ]
        return "\n\n".join(["\n".join(structs), "\n".join(self.helpers.values()), *(made.text for made in self.order)])


def kinds_of(work: Mapping[str, np.ndarray]) -> dict[str, Array]:
    """The kinds of arrays whose sizes never change."""
    return {name: Array(str(array.dtype), array.shape) for name, array in work.items()}
