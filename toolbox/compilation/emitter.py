"""CasADi expressions to machine code through LLVM, with no C compiler on the machine.

A casadi SX function is a straight line of scalar instructions. `inline` writes them as LLVM IR, `compiled` optimises a module of such
functions and returns their addresses; object code is cached on disk under a hash of the IR, the LLVM version and the processor.
"""

from __future__ import annotations

import contextlib
import ctypes
import ctypes.util
import hashlib
import itertools
import os
import struct
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any
from weakref import WeakValueDictionary

import casadi as ca

from toolbox.compilation.dense_systems import BLOCK, NAMES, blocks, factor_size, module_text
from toolbox.compilation.kept_code import cache_directory, keep, kept
from toolbox.errors import SceneError
from toolbox.modelling.elimination import calls, size_solved

FLAGS = "contract nsz arcp"
"""Fast-math flags: fused multiply-add and reciprocals, never reassociation; NaN and infinity keep their meaning."""

_BINARY = {ca.OP_ADD: "fadd", ca.OP_SUB: "fsub", ca.OP_MUL: "fmul", ca.OP_DIV: "fdiv"}
_INTRINSIC = {ca.OP_SQRT: "sqrt", ca.OP_FABS: "fabs", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil"}
_COMPARE = {ca.OP_LT: "olt", ca.OP_LE: "ole", ca.OP_EQ: "oeq", ca.OP_NE: "une"}
# libm's exp, with its table, has a shorter latency than an inlined polynomial, and the stages of a step wait for it one after the other
_LIBM_1 = {
    ca.OP_EXP: "exp", ca.OP_LOG: "log", ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan", ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos", ca.OP_ATAN: "atan", ca.OP_SINH: "sinh", ca.OP_COSH: "cosh", ca.OP_TANH: "tanh", ca.OP_ASINH: "asinh",
    ca.OP_ACOSH: "acosh", ca.OP_ATANH: "atanh", ca.OP_ERF: "erf", ca.OP_LOG1P: "log1p", ca.OP_EXPM1: "expm1",
}  # fmt: skip
_LIBM_2 = {ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow", ca.OP_ATAN2: "atan2", ca.OP_FMOD: "fmod", ca.OP_HYPOT: "hypot",
           ca.OP_REMAINDER: "remainder", ca.OP_FMIN: "fmin", ca.OP_FMAX: "fmax"}  # fmt: skip
LIBM = sorted({*_LIBM_1.values(), *_LIBM_2.values()} - {"fmin", "fmax"})
OPERATIONS = {"ADD", "SUB", "MUL", "DIV", "SQRT", "FABS", "FLOOR", "CEIL", "LT", "LE", "EQ", "NE", "EXP", "LOG", "SIN", "COS", "TAN", "ASIN",
              "ACOS", "ATAN", "SINH", "COSH", "TANH", "ASINH", "ACOSH", "ATANH", "ERF", "LOG1P", "EXPM1", "POW", "CONSTPOW", "ATAN2", "FMOD",
              "HYPOT", "REMAINDER", "FMIN", "FMAX", "NEG", "TWICE", "SQ", "INV", "NOT", "AND", "OR", "SIGN", "COPYSIGN", "IF_ELSE_ZERO",
              "ASSIGN", "LIFT", "CONST", "INPUT", "OUTPUT"}  # fmt: skip
"""Names of the casadi operations that `inline` knows."""


def literal(value: float) -> str:
    """A double as exact LLVM text."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', float(value)))[0]:016X}"


class Body:
    """Text of one LLVM function under construction, with numbered values of one type: doubles here, vectors of them in `toolbox.compilation.vector_emitter`."""

    type = "double"
    references = "i1"
    integers = "i64"
    suffix = "f64"
    attributes = "nounwind"
    pointer = "ptr"

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.count = 0
        self.declarations: set[str] = set()
        self.products: dict[tuple[str, float], str] = {}
        self.factors: dict[tuple[str, ...], str] = {}

    def value(self, text: str) -> str:
        """Append an instruction and return the name of its result."""
        name = f"%v{self.count}"
        self.count += 1
        self.lines.append(f"  {name} = {text}")
        return name

    def number(self, value: float) -> str:
        """A constant of the body's type."""
        return literal(value)

    def integer(self, value: int) -> str:
        """A constant of 64 bits."""
        return str(value)

    def add(self, a: str, b: str) -> str:
        return self.value(f"fadd {FLAGS} {self.type} {a}, {b}")

    def mul(self, a: str, b: str) -> str:
        return self.value(f"fmul {FLAGS} {self.type} {a}, {b}")

    def sub(self, a: str, b: str) -> str:
        return self.value(f"fsub {FLAGS} {self.type} {a}, {b}")

    def div(self, a: str, b: str) -> str:
        return self.value(f"fdiv {FLAGS} {self.type} {a}, {b}")

    def select(self, flag: str, a: str, b: str) -> str:
        return self.value(f"select {self.references} {flag}, {self.type} {a}, {self.type} {b}")

    def load(self, pointer: str, index: int) -> str:
        return self.value(f"load double, ptr {self.value(f'getelementptr double, ptr {pointer}, i64 {index}')}")

    def store(self, value: str, pointer: str, index: int) -> None:
        target = self.value(f"getelementptr double, ptr {pointer}, i64 {index}")
        self.lines.append(f"  store double {value}, ptr {target}")

    def intrinsic(self, name: str, *args: str) -> str:
        """Call an LLVM intrinsic, such as sqrt, that takes the body's type."""
        return self.call(f"llvm.{name}.{self.suffix}", *args)

    def call(self, name: str, *args: str) -> str:
        """Call a scalar function, an LLVM intrinsic or a libm function."""
        self.declarations.add(f"declare double @{name}({', '.join(['double'] * len(args))}) nounwind readnone willreturn")
        return self.value(f"call {FLAGS} double @{name}({', '.join('double ' + a for a in args)})")

    def truth(self, flag: str) -> str:
        return self.select(flag, self.number(1.0), self.number(0.0))

    def compare(self, how: str, a: str, b: str) -> str:
        return self.value(f"fcmp {how} {self.type} {a}, {b}")

    def nonzero(self, a: str) -> str:
        return self.compare("une", a, self.number(0.0))

    def combination(self, base: str, scale: str, factors: Sequence[float], values: Sequence[str]) -> str:
        """base + sum((scale * factor) * value), skipping zero factors; the last value, which comes last in time, is added last.

        The products scale * factor are written once and serve all states.
        """
        total = base
        for factor, value in zip(factors, values, strict=True):
            if factor:
                key = (scale, factor)
                if key not in self.products:
                    self.products[key] = self.mul(scale, self.number(factor))
                term = self.mul(self.products[key], value)
                total = self.add(total, term) if total else term
        return total

    def bits(self, a: str) -> str:
        return self.value(f"bitcast {self.type} {a} to {self.integers}")

    def double(self, a: str) -> str:
        return self.value(f"bitcast {self.integers} {a} to {self.type}")

    def arithmetic(self, how: str, a: str, b: str | int) -> str:
        """Integer arithmetic: add, sub, shl, ashr, lshr, and."""
        return self.value(f"{how} {self.integers} {a}, {b if isinstance(b, str) else self.integer(b)}")

    def polynomial(self, x: str, coefficients: Sequence[float]) -> str:
        """sum c_i x^i by Estrin's scheme, whose terms do not wait for each other."""
        terms = [self.number(c) for c in coefficients]
        power = x
        while len(terms) > 1:
            pairs = [self.add(terms[i], self.mul(terms[i + 1], power)) for i in range(0, len(terms) - 1, 2)]
            terms = pairs + terms[2 * len(pairs) :]
            power = self.mul(power, power) if len(terms) > 1 else power
        return terms[0]

    def called(self, function: ca.Function, values: Sequence[str]) -> list[str]:
        """The results of a function that casadi calls, from the nonzeros of its arguments one after the other: solutions of dense systems by loops."""
        n, derived = size_solved(function.name())
        if not n:
            return inlined_call(self, function, values)
        matrix, rest = tuple(values[: n * n]), list(values[n * n :])
        solution = self.dense_solution(n, matrix, rest[:n])
        if not derived:
            return solution
        slopes, right = rest[n : n + n * n], rest[n + n * n :]
        zero = self.number(0.0)
        for i in range(n):
            for j in range(n):
                if slopes[i + j * n] != zero:
                    right[i] = self.value(f"fsub {FLAGS} double {right[i]}, {self.mul(slopes[i + j * n], solution[j])}")
        return self.dense_solution(n, matrix, right)

    def dense_solution(self, n: int, matrix: tuple[str, ...], right: Sequence[str]) -> list[str]:
        """Solution of a system with a matrix column by column, whose factors are made once."""
        if matrix not in self.factors:
            self.factors[matrix] = self.factored(n, matrix, self.value(f"alloca [{factor_size(n)} x double], align 64"))
        length = blocks(n) * BLOCK
        column = self.value(f"alloca [{length} x double], align 64")
        for i in range(length):
            self.store(right[i] if i < n else self.number(0.0), column, i)
        self.run("dense_solve", ("i64", f"{n}"), ("i64", f"{blocks(n)}"), ("ptr", self.factors[matrix]), ("ptr", column))
        return [self.load(column, i) for i in range(n)]

    def factored(self, n: int, matrix: Sequence[str], target: str) -> str:
        """Write the factors of a matrix, given column by column, to a place in memory; returns the place."""
        self.clear(target, factor_size(n))
        zero, length = self.number(0.0), blocks(n) * BLOCK
        for j in range(n):
            for i in range(n):
                if matrix[i + j * n] != zero:
                    self.store(matrix[i + j * n], target, i + j * length)
        self.run("dense_factor", ("i64", f"{n}"), ("i64", f"{blocks(n)}"), ("ptr", target))
        return target

    def clear(self, pointer: str, size: int) -> None:
        """Fill an array of doubles with zeros."""
        self.declarations.add("declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)")
        self.lines.append(f"  call void @llvm.memset.p0.i64(ptr align 64 {pointer}, i8 0, i64 {8 * size}, i1 false)")

    def run(self, name: str, *arguments: tuple[str, str]) -> None:
        """Call a function that returns nothing, with (type, value) of each argument."""
        self.declarations.add(f"declare void @{name}({', '.join(kind for kind, _ in arguments)}) nounwind")
        self.lines.append(f"  call void @{name}({', '.join(f'{kind} {value}' for kind, value in arguments)})")


def inlined_call(body: Body, function: ca.Function, values: Sequence[str]) -> list[str]:
    """The results of a function that casadi calls, from its instructions."""
    given = iter(values)
    results = inline(body, function, [[next(given) for _ in range(function.nnz_in(i))] for i in range(function.n_in())])
    return [value for result in results for value in result]


def inline(body: Body, function: ca.Function, arguments: Sequence[Sequence[str]]) -> list[list[str]]:
    """Write the instructions of an SX function into `body` and return the values of its outputs.

    arguments: one sequence of value names per input, in the order of its nonzeros. Raises SceneError naming an operation that has
    no translation.
    """
    work: dict[int, str] = {}
    operations = [function.instruction_id(k) for k in range(function.n_instructions())]
    called = calls(function, operations)
    outputs = [[body.number(0.0)] * function.nnz_out(i) for i in range(function.n_out())]
    for k, op in enumerate(operations):
        args = function.instruction_input(k)
        target = function.instruction_output(k)
        if op == ca.OP_INPUT:
            work[target[0]] = arguments[args[0]][args[1]]
        elif op == ca.OP_OUTPUT:
            outputs[target[0]][target[1]] = work[args[0]]
        elif op == ca.OP_CONST:
            work[target[0]] = body.number(function.instruction_constant(k))
        elif op == ca.OP_CALL:
            work |= zip(target, body.called(called[k], [work[a] for a in args]), strict=True)
        else:
            work[target[0]] = operation(body, op, [work[a] for a in args])
    return outputs


def operation(body: Body, op: int, v: list[str]) -> str:
    """Write one casadi operation into a body; returns the value. Raises SceneError naming an operation that has no translation."""
    if op in _BINARY:
        return body.value(f"{_BINARY[op]} {FLAGS} {body.type} {v[0]}, {v[1]}")
    if op == ca.OP_NEG:
        return body.value(f"fneg {FLAGS} {body.type} {v[0]}")
    if op == ca.OP_SQ:
        return body.mul(v[0], v[0])
    if op == ca.OP_TWICE:
        return body.add(v[0], v[0])
    if op == ca.OP_INV:
        return body.value(f"fdiv {FLAGS} {body.type} {body.number(1.0)}, {v[0]}")
    if op in (ca.OP_ASSIGN, ca.OP_LIFT):
        return v[0]
    if op in _INTRINSIC:
        return body.intrinsic(_INTRINSIC[op], v[0])
    if op in _LIBM_1:
        return body.call(_LIBM_1[op], v[0])
    if op == ca.OP_FMIN or op == ca.OP_FMAX:
        return body.intrinsic("minnum" if op == ca.OP_FMIN else "maxnum", *v)
    if op in _LIBM_2:
        return body.call(_LIBM_2[op], *v)
    if op in _COMPARE:
        return body.truth(body.compare(_COMPARE[op], *v))
    if op == ca.OP_NOT:
        return body.truth(body.compare("oeq", v[0], body.number(0.0)))
    if op in (ca.OP_AND, ca.OP_OR):
        both = "and" if op == ca.OP_AND else "or"
        return body.truth(body.value(f"{both} {body.references} {body.nonzero(v[0])}, {body.nonzero(v[1])}"))
    if op == ca.OP_IF_ELSE_ZERO:
        return body.select(body.nonzero(v[0]), v[1], body.number(0.0))
    if op == ca.OP_COPYSIGN:
        return body.intrinsic("copysign", *v)
    if op == ca.OP_SIGN:
        positive, negative = (body.compare(how, v[0], body.number(0.0)) for how in ("ogt", "olt"))
        return body.select(positive, body.number(1.0), body.select(negative, body.number(-1.0), v[0]))  # keeps zero, and NaN
    names = [name for name in dir(ca) if name.startswith("OP_") and getattr(ca, name) == op]
    raise SceneError(f"The casadi operation {'/'.join(names) or op} has no machine code here; write the expression with other functions.")


ARRAYS = ("%x", "%k", "%p", "%m", "%y")
"""Arguments of every compiled function behind time and step: states, slopes, parameters, modes, output."""


def function_text(name: str, body: Body) -> str:
    """One exported function with the common signature."""
    given = ", ".join(["double %t", "double %h", *(f"{body.pointer} {array}" for array in ARRAYS)])
    return "\n".join([f"define void @{name}({given}) {body.attributes} {{", "entry:", *body.lines, "  ret void", "}"])


_LOADED: WeakValueDictionary[str, Any] = WeakValueDictionary()
_KEPT: dict[str, Any] = {}
_MACHINE: list[Any] = []
_LINKER: list[Any] = []
_NUMBERS = itertools.count()


LARGE = 20_000
"""Instructions above which code that is compiled for one run is generated in a hurry, which makes it run half as fast."""


def compiled(text: str, names: Sequence[str], instructions: int, large: int = LARGE) -> dict[str, int]:
    """Addresses of the functions `names` of an LLVM module given as text; the code lives as long as the process.

    instructions: size of the module, above `large` of which the code generator hurries.
    """
    return compiled_for(text, names, instructions, False, large=large)[0]


def compiled_for(
    text: str, names: Sequence[str], instructions: int, passing: bool, side_by_side: bool = False, large: int = LARGE
) -> tuple[dict[str, int], Any]:
    """Addresses as of `compiled`; with `passing`, of code that lives as long as the second value: whoever calls them has to hold it.

    side_by_side: whether equal instructions on neighbours are to be joined in vectors, which pays where there are many and costs time where there are few.
    """
    with COMPILING:
        key, library = _library(text, names, instructions > large, side_by_side)
        if not passing:
            _KEPT[key] = library
        return {name: library[name] for name in names}, library


COMPILING = threading.Lock()
"""Else two threads load the same code."""


def _library(text: str, names: Sequence[str], large: bool, side_by_side: bool) -> tuple[str, Any]:
    """(key, loaded code) of a module."""
    import llvmlite.binding as llvm

    host = f"{llvm.llvm_version_info} {' '.join(_processor(llvm))} {sys.platform}"
    key = hashlib.sha256(f"{host} {large}{' joined' if side_by_side else ''}\n{text}".encode()).hexdigest()[:32]
    found = _LOADED.get(key)
    if found is None:
        path = cache_directory() / "objects" / f"{key}.o"
        image = kept(path)
        if image is None:
            image = object_code(text, _processor(llvm), large, side_by_side)
            if keep(path, image):
                _make_room(path.parent)
        found = _LOADED[key] = linked(f"kernel-{key}", image, names, _dense_systems(text))
    return key, found


def linked(title: str, image: bytes, names: Sequence[str], others: Mapping[str, int] = MappingProxyType({})) -> Any:
    """Link object code and return its functions `names`, ready to be called. The code may call functions of libm, and the other functions
    at the given addresses."""
    import llvmlite.binding as llvm

    library = llvm.JITLibraryBuilder().add_object_img(image).add_current_process()
    for symbol in LIBM:
        library = library.import_symbol(symbol, _libm_address(symbol))
    for symbol, address in others.items():
        library = library.import_symbol(symbol, address)
    for name in names:
        library = library.export_symbol(name)
    if not _LINKER:
        _target()
        _LINKER.append(llvm.create_lljit_compiler(use_jit_link=False))  # one for all: each takes a third of a megabyte
    return library.link(_LINKER[0], f"{title}-{next(_NUMBERS)}")


def _dense_systems(text: str) -> dict[str, int]:
    """Addresses of the loops for dense systems where a module calls them; their code lives as long as the process."""
    if not any(f"declare void @{name}(" in text for name in NAMES):
        return {}
    key, library = _library(module_text(), NAMES, large=False, side_by_side=False)
    _KEPT[key] = library
    return {name: library[name] for name in NAMES}


def _processor(llvm: Any) -> tuple[str, str]:
    """(name, features) of the processor that the code of models is for: this one, or the plain one of the name in STICKSLIP_PROCESSOR, such as generic."""
    name = os.environ.get("STICKSLIP_PROCESSOR")
    return (name, "") if name else (llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten())


def register_width() -> int:
    """How many doubles a vector register of this processor holds."""
    import llvmlite.binding as llvm

    return 8 if llvm.get_host_cpu_features().get("avx512f") else 4


def compiler() -> str:
    """Return the versions of the compiler and the kind of its target machine."""
    import llvmlite
    import llvmlite.binding as llvm

    return f"{llvmlite.__version__} {llvm.llvm_version_info} {llvm.get_default_triple()}"


def _target() -> Any:
    """This machine, for which code is written."""
    import llvmlite.binding as llvm

    if not _MACHINE:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        _MACHINE.append(llvm.Target.from_default_triple())
    return _MACHINE[0]


def object_code(text: str, processor: tuple[str, str], large: bool = False, side_by_side: bool = False) -> bytes:
    """The text of an LLVM module as object code for a processor, given by its name and features; see `compiled`."""
    import llvmlite.binding as llvm

    name, features = processor
    machine = _target().create_target_machine(
        cpu=name,
        features=features,
        opt=0 if large else 2,
        codemodel="jitdefault",
        jit=True,
        reloc="pic",
    )
    module = llvm.parse_assembly(text, llvm.create_context())  # which keeps its types and constants to itself, and goes with it
    module.verify()
    tuning = llvm.PipelineTuningOptions(speed_level=1 if large else 2)
    tuning.slp_vectorization = side_by_side
    builder = llvm.create_pass_builder(machine, tuning)
    passes = builder.getModulePassManager()
    passes.run(module, builder)
    if (
        type(passes)._dispose is llvm.ffi.ObjectRef._dispose
    ):  # llvmlite inherits the one that does nothing, and 0.15 MB a module stay (0.50)
        llvm.newpassmanagers.NewPassManager._dispose(passes)
    return machine.emit_object(module)


def _make_room(directory: Path) -> None:
    """Forget the older half of the object files where there are more than 4096: every formula of time leaves one."""
    with contextlib.suppress(OSError):
        files = [entry for entry in os.scandir(directory) if entry.name.endswith(".o")]
        if len(files) > 4096:
            for entry in sorted(files, key=lambda entry: entry.stat().st_mtime)[: len(files) // 2]:
                os.unlink(entry.path)


_LIBRARY: list[Any] = []


def _libm_address(symbol: str) -> int:
    if not _LIBRARY:
        usual = {"linux": "libm.so.6", "win32": "ucrtbase", "darwin": "libSystem.dylib"}
        try:
            _LIBRARY.append(ctypes.CDLL(usual.get(sys.platform, "libm.so")))
        except OSError:
            _LIBRARY.append(ctypes.CDLL(ctypes.util.find_library("m")))
    return ctypes.cast(getattr(_LIBRARY[0], symbol), ctypes.c_void_p).value or 0
