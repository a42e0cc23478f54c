"""The loops in the text of LLVM, for work arrays of any size (`toolbox.translation.translation`).

A function takes a tuple of arrays as one pointer to a table: for every field its address, then its sizes. No flag allows LLVM to contract, reorder or
approximate anything, and processors of one kind have the operations that are used, so that the bits are the same on all of them.
"""

from __future__ import annotations

import ast
import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from toolbox.compilation.emitter import literal
from toolbox.translation.kinds import STORED, Array, Arrays, Kind, NotTranslatable, Value, joined, known
from toolbox.translation.statements import Writer
from toolbox.translation.translation import Function, Translation

TYPES = {"f": "double", "i": "i64", "u": "i64", "b": "i1"}
STORED_TYPES = {"float64": "double", "int64": "i64", "uint64": "i64", "bool": "i8", "int8": "i8", "int32": "i32"}
_ORDERED: dict[type[ast.AST], tuple[str, str, str]] = {
            ast.Lt: ("olt", "slt", "ult"), ast.LtE: ("ole", "sle", "ule"), ast.Gt: ("ogt", "sgt", "ugt"), ast.GtE: ("oge", "sge", "uge"),
            ast.Eq: ("oeq", "eq", "eq"), ast.NotEq: ("une", "ne", "ne")}  # fmt: skip
_WHOLE: dict[type[ast.AST], str] = dict(
    zip(
        (ast.Add, ast.Sub, ast.Mult, ast.BitAnd, ast.BitOr, ast.BitXor, ast.LShift),
        ["add", "sub", "mul", "and", "or", "xor", "shl"],
        strict=True,
    )
)
_REAL: dict[type[ast.AST], str] = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul"}
_TAKEN = {"square": "f", "bits_of": "f", "number_of": "i"}
"""{small function: kind of what it takes}; others take what they give."""
FIXED = "!invariant.load !0"
"""What says that the table of addresses and sizes does not change."""

_TAGS = {"double": "!tbaa !4", "i64": "!tbaa !5", "i32": "!tbaa !6", "i8": "!tbaa !7"}
"""What tells arrays of one type from those of others (`METADATA` of `toolbox.translation.llvm_module`)."""


def type_of(kind: Kind) -> str:
    """The type of a kind."""
    if kind is None or kind == "none":
        return "void"
    if isinstance(kind, tuple):
        return "{" + ", ".join(type_of(each) for each in kind) + "}"
    return "ptr" if isinstance(kind, (Array, Arrays)) else TYPES[kind]


def constant(value: Any, kind: str) -> str:
    """A number as a constant of a kind."""
    if kind == "f":
        return literal(float(value))
    if kind == "b":
        return "true" if value else "false"
    return str(int(value) - 2**64 if int(value) >= 2**63 else int(value))


class LlvmExpressions(Writer):
    """Expressions in LLVM: the text of each operation that `toolbox.translation.expressions` names."""

    final = True
    t: LlvmTranslation

    def __init__(self, translation: LlvmTranslation, made: Function):
        super().__init__(translation, made)
        self.lines: list[str] = []
        self.head: dict[str, list[str]] = {}
        self.numbers = 0
        self.ended = False

    # --- instructions
    def emit(self, line: str) -> None:
        """Write a line. Behind the end of a block, the line goes into a new block that is never reached."""
        if self.ended:
            self.start(self.label("dead"))
        self.lines.append(f"  {line}")

    def new(self, text: str) -> str:
        """Write an instruction and return the name of its result."""
        self.numbers += 1
        self.emit(f"%r{self.numbers} = {text}")
        return f"%r{self.numbers}"

    def label(self, word: str) -> str:
        """A name for a block."""
        self.numbers += 1
        return f"{word}{self.numbers}"

    def start(self, label: str) -> None:
        """Begin a block."""
        self.ended = False
        self.lines.append(f"{label}:")

    def go(self, label: str) -> None:
        """End a block by going to another one."""
        if not self.ended:
            self.emit(f"br label %{label}")
            self.ended = True

    def split(self, test: str, label: str, other: str) -> None:
        """End a block with a branch to the first label if the test holds, and to the other label otherwise."""
        self.emit(f"br i1 {test}, label %{label}, label %{other}")
        self.ended = True

    def slot(self, name: str, kind: Kind) -> str:
        """The place of a variable."""
        place = f"%{name}.{kind if isinstance(kind, str) else 'a'}"
        zero = {"double": "0.0", "ptr": "null", "i1": "false"}.get(type_of(kind), "0")
        self.head.setdefault(place, [f"{place} = alloca {type_of(kind)}", f"store {type_of(kind)} {zero}, ptr {place}"])
        return place

    def table(self, owner: str, place: int, kind: str, name: str) -> str:
        """An entry of the table behind `w`, read where the function begins."""
        found = f"%{owner}.{name}"
        address = f"{found}.at"
        self.head.setdefault(
            found,
            [f"{address} = getelementptr i64, ptr %{owner}.given, i64 {place}", f"{found} = load {kind}, ptr {address}, align 8, {FIXED}"],
        )
        return found

    def cast(self, value: Value, kind: Kind) -> str:
        """A value as one of another kind."""
        if value.is_known and value.kind != "none":
            return constant(value.known, kind)
        if value.kind == kind or not isinstance(kind, str) or {value.kind, kind} == {"i", "u"}:
            return value.text
        how = {"if": "sitofp", "uf": "uitofp", "bf": "uitofp", "bi": "zext", "bu": "zext", "fi": "fptosi", "fu": "fptoui"}[
            value.kind + kind
        ]
        return self.new(f"{how} {TYPES[value.kind]} {value.text} to {TYPES[kind]}")

    def truth(self, value: Value) -> str:
        """Whether a number is not zero."""
        if value.kind == "b" or value.is_known:
            return self.cast(value, "b")
        return self.new(f"fcmp une double {value.text}, 0.0" if value.kind == "f" else f"icmp ne i64 {value.text}, 0")

    # --- words
    def said(self, what: str, kind: Kind, *given: Any) -> Value:
        """An expression of a kind."""
        return Value(getattr(self, f"l_{what}")(kind, *given), kind)

    def l_variable(self, kind: Kind, name: str) -> str:
        if isinstance(kind, Arrays):
            return f"%{name}.given"
        return self.new(f"load {type_of(kind)}, ptr {self.slot(name, kind)}")

    def l_field(self, kind: Kind, owner: str, name: str) -> str:
        return self.table(owner, self.t.places[self.kind_of(owner)][name], "ptr", name)

    def l_size(self, kind: Kind, whole: Value, place: int) -> str:
        at = self.t.places[self.kind_of(whole.owner)][whole.field] + 1 + place
        return self.table(whole.owner, at, "i64", f"{whole.field}.size{place}")

    def l_of_tuple(self, kind: Kind, whole: Value, place: int) -> str:
        return self.new(f"extractvalue {type_of(whole.kind)} {whole.text}, {place}")

    def at(self, whole: Value, index: str) -> str:
        """The address of an entry."""
        return self.new(f"getelementptr inbounds {STORED_TYPES[whole.kind.dtype]}, ptr {whole.text}, i64 {index}")

    def address(self, whole: Value, indices: Sequence[Value]) -> str:
        """The address of an entry or a row."""
        place, dimensions = self.cast(indices[0], "i"), len(whole.kind.shape)
        if dimensions > 1 and not whole.field:
            raise NotTranslatable(f"{self.made.source.__qualname__}: the sizes of an array are not known here")
        for k in range(1, dimensions):
            place = self.new(f"mul nsw i64 {place}, {self.l_size('i', whole, k)}")
            if k < len(indices):
                place = self.new(f"add nsw i64 {place}, {self.cast(indices[k], 'i')}")
        return self.at(whole, place)

    def l_rest(self, kind: Kind, whole: Value, lower: Value) -> str:
        return self.at(whole, self.cast(lower, "i"))

    def l_row(self, kind: Kind, whole: Value, indices: Sequence[Value]) -> str:
        return self.address(whole, indices)

    def l_entry(self, kind: Kind, whole: Value, indices: Sequence[Value]) -> str:
        stored = STORED_TYPES[whole.kind.dtype]
        found = self.new(f"load {stored}, ptr {self.address(whole, indices)}, {_TAGS[stored]}")
        if kind == "b":
            return self.new(f"icmp ne i8 {found}, 0")
        return found if stored in ("double", "i64") else self.new(f"sext {stored} {found} to i64")

    def l_inverse(self, kind: Kind, value: Value) -> str:
        return self.new(f"xor i1 {self.truth(value)}, true")

    def l_negative(self, kind: Kind, value: Value) -> str:
        return self.new(f"fneg double {value.text}" if kind == "f" else f"sub i64 0, {self.cast(value, 'i')}")

    def l_helped(self, kind: Kind, name: str, *values: Value) -> str:
        word, given = name.split("_")[0], [self.cast(value, _TAKEN.get(name, kind)) for value in values]
        if name == "square":
            return self.new(f"fmul double {given[0]}, {given[0]}")
        if name in ("bits_of", "number_of"):
            source, target = ("double", "i64") if name == "bits_of" else ("i64", "double")
            return self.new(f"bitcast {source} {given[0]} to {target}")
        if word in ("min", "max"):
            order = ast.Lt if word == "min" else ast.Gt
            test = self.l_comparison("b", order, Value(given[1], kind), Value(given[0], kind))
            return self.new(f"select i1 {test}, {TYPES[kind]} {given[1]}, {TYPES[kind]} {given[0]}")
        rest = self.new(f"srem i64 {given[0]}, {given[1]}")
        signs = self.new(f"xor i64 {rest}, {given[1]}")
        unlike = self.new(f"icmp slt i64 {signs}, 0")
        inexact = self.new(f"icmp ne i64 {rest}, 0")
        wrong = self.new(f"and i1 {unlike}, {inexact}")
        if name == "floor_mod":
            return self.new(f"select i1 {wrong}, i64 {self.new(f'add i64 {rest}, {given[1]}')}, i64 {rest}")
        whole = self.new(f"sdiv i64 {given[0]}, {given[1]}")
        return self.new(f"sub i64 {whole}, {self.new(f'zext i1 {wrong} to i64')}")

    def l_power(self, kind: Kind, a: Value, b: Value) -> str:
        base = self.cast(a, "f")
        if not (b.is_known and isinstance(b.known, int) and b.known > 0):
            return self.libm("llvm.pow.f64", base, self.cast(b, "f"))
        found, left = "", b.known
        while left:  # by squares
            if left & 1:
                found = self.new(f"fmul double {found}, {base}") if found else base
            left >>= 1
            base = self.new(f"fmul double {base}, {base}") if left else base
        return found

    def libm(self, name: str, *given: str) -> str:
        """A call of a function of numbers."""
        self.t.declared.add(f"declare double @{name}({', '.join('double' for _ in given)})")
        return self.new(f"call double @{name}({', '.join(f'double {each}' for each in given)})")

    def l_quotient(self, kind: Kind, a: Value, b: Value) -> str:
        return self.new(f"fdiv double {self.cast(a, 'f')}, {self.cast(b, 'f')}")

    def l_arithmetic(self, kind: str, operation: type[ast.AST], a: Value, b: Value) -> str:
        word = _REAL[operation] if kind == "f" else ("lshr" if kind == "u" else "ashr") if operation is ast.RShift else _WHOLE[operation]
        return self.new(f"{word} {TYPES[kind]} {self.cast(a, kind)}, {self.cast(b, kind)}")

    def l_comparison(self, kind: Kind, operation: type[ast.AST], a: Value, b: Value) -> str:
        shared = "u" if "u" in (a.kind, b.kind) else joined(a.kind, b.kind)
        real, signed, unsigned = _ORDERED[operation]
        word = f"fcmp {real}" if shared == "f" else f"icmp {signed if shared == 'i' else unsigned}"
        return self.new(f"{word} {TYPES[shared]} {self.cast(a, shared)}, {self.cast(b, shared)}")

    def l_all_of(self, kind: Kind, parts: Sequence[Value]) -> str:
        found = self.cast(parts[0], "b")
        for part in parts[1:]:
            found = self.new(f"and i1 {found}, {self.cast(part, 'b')}")
        return found

    def of_BoolOp(self, node: ast.BoolOp) -> Value:
        """Translate `and` and `or`. A later operand is computed only if the earlier operands do not decide."""
        every = isinstance(node.op, ast.And)
        slot, end = "", self.label("both")
        for i, each in enumerate(node.values):
            value = self.value(each)
            if value.is_known and bool(value.known) is every:
                continue
            if value.is_known and not slot:
                return known(not every)
            slot = slot or self.slot(f"{end}", "b")
            self.emit(f"store i1 {self.truth(value)}, ptr {slot}")
            if value.is_known or i + 1 == len(node.values):
                break
            following = self.label("next")
            test = self.new(f"load i1, ptr {slot}")
            self.split(test, *((following, end) if every else (end, following)))
            self.start(following)
        if not slot:
            return known(every)
        self.go(end)
        self.start(end)
        return Value(self.new(f"load i1, ptr {slot}"), "b")

    def of_IfExp(self, node: ast.IfExp) -> Value:
        """Translate a conditional expression. Only the chosen value is computed."""
        test = self.value(node.test)
        if test.is_known:
            return self.value(node.body if test.known else node.orelse)
        silent = Writer(self.t, self.made)
        silent.names, silent.loops = self.names, self.loops
        kind = silent.value(node).kind
        first, second, end = self.label("then"), self.label("else"), self.label("chosen")
        slot = self.slot(end, kind)
        self.split(self.truth(test), first, second)
        for label, each in ((first, node.body), (second, node.orelse)):
            self.start(label)
            self.emit(f"store {type_of(kind)} {self.cast(self.value(each), kind)}, ptr {slot}")
            self.go(end)
        self.start(end)
        return Value(self.new(f"load {type_of(kind)}, ptr {slot}"), kind)

    def l_function(self, kind: Kind, name: str, values: Sequence[Value]) -> str:
        return self.libm(f"llvm.{name}.f64", *(self.cast(value, "f") for value in values))

    def l_cast(self, kind: str, value: Value) -> str:
        return self.cast(value, kind)

    def l_finite(self, kind: Kind, value: Value) -> str:
        return self.new(f"fcmp olt double {self.libm('llvm.fabs.f64', self.cast(value, 'f'))}, {literal(float('inf'))}")

    def l_floor(self, kind: Kind, value: Value) -> str:
        real = self.cast(value, "f")
        whole = self.new(f"fptosi double {real} to i64")
        above = self.new(f"fcmp ogt double {self.new(f'sitofp i64 {whole} to double')}, {real}")
        return self.new(f"sub i64 {whole}, {self.new(f'zext i1 {above} to i64')}")

    def l_byte(self, kind: Kind, value: Value) -> str:
        byte = self.new(f"trunc i64 {self.cast(value, 'i')} to i8")
        return self.new(f"sext i8 {byte} to i64")

    def l_called(self, kind: Kind, made: Function, values: Sequence[Value]) -> str:
        given = ", ".join(f"{type_of(value.kind)} {self.cast(value, value.kind)}" for value in values)
        text = f"call {type_of(kind)} @{made.name}({given})"
        if type_of(kind) != "void":
            return self.new(text)
        self.emit(text)
        return ""

    def l_model(self, kind: Kind, address: Value, values: Sequence[Value]) -> str:
        numbers, arrays = values[:2], values[2:]
        function = self.new(f"inttoptr i64 {address.text} to ptr")
        given = [*(f"double {self.cast(value, 'f')}" for value in numbers), *(f"ptr {value.text}" for value in arrays)]
        self.emit(f"call void {function}({', '.join(given)}) nounwind, {_TAGS['double']}")
        return ""

    def l_code(self, kind: Kind, address: Value, arrays: Sequence[Value]) -> str:
        function = self.new(f"inttoptr i64 {address.text} to ptr")
        self.emit(f"call void {function}({', '.join(f'ptr {value.text}' for value in arrays)}) nounwind")
        return ""

    def l_loop(self, kind: Kind, address: Value, work: Value) -> str:
        return self.new(f"call i64 {self.new(f'inttoptr i64 {address.text} to ptr')}(ptr {work.text}) nounwind")


class LlvmWriter(LlvmExpressions):
    """Writes one function in the text of LLVM."""

    def __init__(self, translation: LlvmTranslation, made: Function):
        super().__init__(translation, made)
        self.exits: list[dict[str, str]] = []
        self.turn = ""

    def text(self) -> str:
        """The function."""
        self.body()
        gives = type_of(self.made.returns)
        if not self.ended:
            self.emit("ret void" if gives == "void" else "unreachable")
        given = {name: value.kind for name, value in self.names.items() if value.kind != "none"}
        stores = [
            f"store {type_of(kind)} %{name}.given, ptr {self.slot(name, kind)}"
            for name, kind in given.items()
            if not isinstance(kind, Arrays)
        ]
        arguments = ", ".join(
            f"{type_of(kind)}{' noalias readonly' if isinstance(kind, Arrays) else ''} %{name}.given" for name, kind in given.items()
        )
        head = [f"  {line}" for lines in self.head.values() for line in lines] + [f"  {line}" for line in stores]
        return "\n".join(
            [
                f"define internal {gives} @{self.made.name}({arguments}) nounwind {{",
                "entry:",
                *head,
                "  br label %begin",
                "begin:",
                *self.lines,
                "}",
            ]
        )

    def jump(self, how: str) -> None:
        """Leave a loop, or a turn of it."""
        self.go(self.exits[-1][how])

    def give(self, values: Sequence[Value]) -> None:
        """End the function with its returned values."""
        kind = self.made.returns
        if not values:
            self.emit("ret void")
        elif isinstance(kind, tuple):
            whole = "poison"
            for i, value in enumerate(values):
                whole = self.new(f"insertvalue {type_of(kind)} {whole}, {type_of(kind[i])} {self.cast(value, kind[i])}, {i}")
            self.emit(f"ret {type_of(kind)} {whole}")
        else:
            self.emit(f"ret {type_of(kind)} {self.cast(values[0], kind)}")
        self.ended = True

    def branch(self, test: Value, body: Sequence[ast.stmt], otherwise: Sequence[ast.stmt]) -> None:
        """Statements under a condition, and others without it."""
        first, end = self.label("then"), self.label("end")
        second = self.label("else") if otherwise else end
        self.split(self.truth(test), first, second)
        self.start(first)
        self.block(body)
        self.go(end)
        if otherwise:
            self.start(second)
            self.block(otherwise)
            self.go(end)
        self.start(end)

    def again(self) -> None:
        """The place before the condition of a loop."""
        self.turn = self.label("turn")
        self.go(self.turn)
        self.start(self.turn)

    def repeat(self, test: Value, body: Sequence[ast.stmt]) -> None:
        """Statements as long as a condition holds."""
        turn, inside, end = self.turn, self.label("body"), self.label("done")
        self.split(self.truth(test), inside, end)
        self.looped(inside, turn, end, body)
        self.go(turn)
        self.start(end)

    def looped(self, inside: str, turn: str, end: str, body: Sequence[ast.stmt]) -> None:
        """The statements of a loop."""
        self.start(inside)
        self.exits.append({"break": end, "continue": turn})
        self.block(body)
        self.exits.pop()

    def through(self, name: str, bounds: tuple[Value, Value, int], body: Sequence[ast.stmt], each: Any = None) -> None:
        """Statements for every number of a range."""
        first, last, step = bounds
        slot, limit = self.slot(name, "i"), self.cast(last, "i")
        turn, inside, following, end = (self.label(word) for word in ("turn", "body", "next", "done"))
        self.emit(f"store i64 {self.cast(first, 'i')}, ptr {slot}")
        self.go(turn)
        self.start(turn)
        self.split(self.new(f"icmp {'slt' if step == 1 else 'sgt'} i64 {self.new(f'load i64, ptr {slot}')}, {limit}"), inside, end)
        if each is not None:
            self.start(inside)
            each()
            inside = self.label("body")
            self.go(inside)
        self.looped(inside, following, end, body)
        self.go(following)
        self.start(following)
        before = self.new(f"load i64, ptr {slot}")
        self.emit(f"store i64 {self.new(f'add nsw i64 {before}, {step}')}, ptr {slot}")
        self.go(turn)
        self.start(end)

    def each(self, name: str, values: Sequence[Value], body: Sequence[ast.stmt]) -> None:
        """Statements for each of a few numbers."""
        kind, place = values[0].kind, f"place_{self.count}"
        held = f"@{self.made.name}.each{self.count}"
        entries = ", ".join(f"{TYPES[kind]} {self.cast(value, kind)}" for value in values)
        self.t.globals.append(f"{held} = internal constant [{len(values)} x {TYPES[kind]}] [{entries}]")

        def taken() -> None:
            index = self.new(f"load i64, ptr {self.slot(place, 'i')}")
            at = self.new(f"getelementptr {TYPES[kind]}, ptr {held}, i64 {index}")
            self.emit(f"store {TYPES[kind]} {self.new(f'load {TYPES[kind]}, ptr {at}')}, ptr {self.slot(name, kind)}")

        self.through(place, (known(0), known(len(values)), 1), body, taken)

    def set(self, name: str, value: Value) -> None:
        """Set a variable."""
        kind = self.names[name].kind if name in self.names else self.made.local[name]
        self.emit(f"store {type_of(kind)} {self.cast(value, kind)}, ptr {self.slot(name, kind)}")

    def put(self, whole: Value, indices: Sequence[Value], value: Value) -> None:
        """Set an entry of an array."""
        stored = STORED_TYPES[whole.kind.dtype]
        number = self.cast(value, STORED[whole.kind.dtype])
        if stored == "i8" and STORED[whole.kind.dtype] == "b":
            number = self.new(f"zext i1 {number} to i8")
        elif stored in ("i8", "i32"):
            number = self.new(f"trunc i64 {number} to {stored}")
        self.emit(f"store {stored} {number}, ptr {self.address(whole, indices)}, {_TAGS[stored]}")


@dataclass
class LlvmTranslation(Translation):
    """The functions that a loop reaches, as text of LLVM."""

    language: type[Any] = LlvmWriter
    globals: list[str] = field(default_factory=list)
    declared: set[str] = field(default_factory=set)

    @cached_property
    def places(self) -> dict[Arrays, dict[str, int]]:
        """{tuple: {field: place of the address of the field in the table}}. The sizes of the field follow its address."""
        sizes = {each: [1 + len(kind.shape) for kind in fields.values()] for each, fields in self.tuples.items()}
        return {each: dict(zip(fields, itertools.accumulate(sizes[each], initial=0), strict=False)) for each, fields in self.tuples.items()}
