"""CasADi expressions on vectors: the same instructions as in `toolbox.compilation.emitter`, on `<W x double>`, one lane for each scenario.

exp, log, sin, cos and tanh are polynomials here, right to two units in the last place, at infinities, NaN and denormal numbers; what has no
vector version calls libm lane by lane.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import casadi as ca
import numpy as np

from toolbox.compilation.emitter import FLAGS, Body, inlined_call, literal

LARGEST_ANGLE = 1e6
"""Arguments of sin and cos beyond which libm reduces them."""

SELDOM = '!0 = !{!"branch_weights", i32 1, i32 10000}'
"""What the metadata !0 of a branch says: that it is hardly ever taken, so that nothing is moved out of registers on its account."""


class VectorBody(Body):
    """Text of one LLVM function on vectors of `width` doubles, a power of two; arrays are [item][width]."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.width = width
        self.type = f"<{width} x double>"
        self.references = f"<{width} x i1>"
        self.integers = f"<{width} x i64>"
        self.suffix = f"v{width}f64"
        self.functions: dict[str, str] = {}

    def number(self, value: float) -> str:
        return f"<{', '.join([f'double {literal(value)}'] * self.width)}>"

    def integer(self, value: int) -> str:
        """A constant of 64 bits in every lane."""
        return f"<{', '.join([f'i64 {value}'] * self.width)}>"

    def load(self, pointer: str, index: int) -> str:
        return self.value(f"load {self.type}, ptr {self._place(pointer, index)}, align {min(8 * self.width, 64)}")

    def store(self, value: str, pointer: str, index: int) -> None:
        self.lines.append(f"  store {self.type} {value}, ptr {self._place(pointer, index)}, align {min(8 * self.width, 64)}")

    def store_bits(self, truth: str, pointer: str, index: int) -> None:
        """Write truth values as an integer at the beginning of an item of a block. The first lane is the lowest bit."""
        bits = self.value(f"bitcast {self.references} {truth} to i{self.width}")
        bits = self.value(f"zext i{self.width} {bits} to i64") if self.width < 64 else bits
        self.lines.append(f"  store i64 {bits}, ptr {self._place(pointer, index)}")

    def _place(self, pointer: str, index: int) -> str:
        return self.value(f"getelementptr double, ptr {pointer}, i64 {index * self.width}")

    def call(self, name: str, *args: str) -> str:
        typed = ", ".join(f"{self.type} {a}" for a in args)
        if name.startswith("llvm."):
            self.declarations.add(f"declare {self.type} @{name}({', '.join([self.type] * len(args))}) nounwind readnone willreturn")
            return self.value(f"call {FLAGS} {self.type} @{name}({typed})")
        if name in FUNCTIONS:
            texts, needs = _function(name, self.width)
            self.functions |= texts
            self.declarations |= needs
            return self.value(f"call {self.type} @vector_{name}({typed})")
        return self.lane_by_lane(name, *args)

    def called(self, function: ca.Function, values: Sequence[str]) -> list[str]:
        """The results of a function that casadi calls, from its instructions: every lane has modes of its own, so that no rows are left out."""
        return inlined_call(self, function, values)

    def lane_by_lane(self, name: str, *args: str) -> str:
        """Call a scalar function of libm for every lane. The calls stand in a function of their own, so that the usual path without them
        keeps its registers."""
        given = [f"%x{i}" for i in range(len(args))]
        each = VectorBody(self.width)
        result = "poison"
        for lane in range(self.width):
            numbers = [each.value(f"extractelement {self.type} {a}, i64 {lane}") for a in given]
            result = each.value(f"insertelement {self.type} {result}, double {super(VectorBody, each).call(name, *numbers)}, i64 {lane}")
        head = f"define internal {self.type} @each_{name}({', '.join(f'{self.type} {a}' for a in given)}) noinline nounwind readnone willreturn {{"
        self.functions[f"each {name}"] = "\n".join([head, "entry:", *each.lines, f"  ret {self.type} {result}", "}"])
        self.declarations |= each.declarations
        return self.value(f"call {self.type} @each_{name}({', '.join(f'{self.type} {a}' for a in args)})")

    # --- memory that every lane reads at a place of its own
    def gather(self, pointer: str, places: str, flag: str) -> str:
        """Return the doubles at `places` (integers) of an array in the lanes whose `flag` is true; 0 in other lanes."""
        self.declarations.add(f"declare {self.type} @llvm.masked.gather.{self.suffix}.{self._pointers(True)}")
        target = self._pointed(pointer, places)
        last = f"<{self.width} x ptr> {target}, i32 8, {self.references} {flag}, {self.type} zeroinitializer"
        return self.value(f"call {self.type} @llvm.masked.gather.{self.suffix}.v{self.width}p0({last})")

    def scatter(self, value: str, pointer: str, places: str, flag: str) -> None:
        """Write to `places` (integers) of an array from the lanes whose `flag` is true."""
        self.declarations.add(f"declare void @llvm.masked.scatter.{self.suffix}.{self._pointers(False)}")
        target = self._pointed(pointer, places)
        given = f"{self.type} {value}, <{self.width} x ptr> {target}, i32 8, {self.references} {flag}"
        self.lines.append(f"  call void @llvm.masked.scatter.{self.suffix}.v{self.width}p0({given})")

    def _pointed(self, pointer: str, places: str) -> str:
        return self.value(f"getelementptr double, ptr {pointer}, {self.integers} {places}")

    def _pointers(self, gathers: bool) -> str:
        """Name and arguments of the intrinsics on vectors of pointers."""
        given = [f"<{self.width} x ptr>", "i32", self.references]
        given = [*given, self.type] if gathers else [self.type, *given]
        return f"v{self.width}p0({', '.join(given)})"

    def as_integers(self, a: str) -> str:
        """Whole numbers as integers."""
        return self.value(f"fptosi {self.type} {a} to {self.integers}")

    # --- memory, blocks and functions of the lanes' own
    def place(self, word: str, size: int | None = None) -> str:
        """Reserve memory for a vector, or for `size` vectors, at the beginning of the function, and return its address."""
        name = f"%{word}{self.count}"
        self.count += 1
        room = f"{self.type}, align {min(8 * self.width, 64)}" if size is None else f"[{size * self.width} x double], align 64"
        self.lines.insert(0, f"  {name} = alloca {room}")
        return name

    def renewed(self, pointer: str) -> str:
        """Return the same address under a name that the optimiser does not know. Values loaded from the old name are then loaded again."""
        return self.value(f'call ptr asm "", "=r,0"(ptr {pointer})')

    def spread(self, pointer: str, place: int) -> str:
        """Return a vector with the same double of an array in every lane."""
        one = self.value(f"load double, ptr {self.value(f'getelementptr double, ptr {pointer}, i64 {place}')}")
        first = self.value(f"insertelement {self.type} poison, double {one}, i64 0")
        return self.value(f"shufflevector {self.type} {first}, {self.type} poison, <{self.width} x i32> zeroinitializer")

    def block(self, label: str) -> None:
        """Go on in a block of its own."""
        self.lines += [f"  br label %{label}", f"{label}:"]

    def branch(self, flag: str, yes: str, no: str, following: str) -> None:
        """Go to one of two blocks by a truth, and go on writing in the block `following`."""
        self.lines += [f"  br i1 {flag}, label %{yes}, label %{no}", f"{following}:"]

    def from_block(self, truth: str, there: str, here: str) -> str:
        """Return the truth values if the previous block was `there`, and false if the previous block was `here`."""
        return self.value(f"phi {self.references} [ {truth}, %{there} ], [ zeroinitializer, %{here} ]")

    def keep_function(self, name: str, written: VectorBody) -> None:
        """Keep a function that works on vectors in memory, with its text; `call_on` calls it."""
        head = f"define internal void @{name}(ptr noalias %c) noinline nounwind {{"
        self.functions[name] = "\n".join([head, "entry:", *written.lines, "  ret void", "}"])
        self.declarations |= written.declarations

    def call_on(self, name: str, pointer: str) -> None:
        """Call such a function."""
        self.lines.append(f"  call void @{name}(ptr {pointer})")

    # --- words for what casadi has no instruction for
    def negative(self, a: str) -> str:
        return self.value(f"fneg {self.type} {a}")

    def mul_rounded(self, a: str, b: str) -> str:
        """a b, rounded before anything is added to it."""
        return self.value(f"fmul {self.type} {a}, {b}")

    def add_rounded(self, a: str, b: str) -> str:
        """a + b of numbers that are rounded."""
        return self.value(f"fadd {self.type} {a}, {b}")

    def fused(self, a: str, b: str, c: str) -> str:
        """a b + c with one rounding."""
        return self.intrinsic("fma", a, b, c)

    def both(self, a: str, b: str) -> str:
        return self.value(f"and {self.references} {a}, {b}")

    def either(self, a: str, b: str) -> str:
        return self.value(f"or {self.references} {a}, {b}")

    def opposite(self, a: str) -> str:
        """Truths that hold where others do not."""
        return self.value(f"xor {self.references} {a}, <{', '.join(['i1 true'] * self.width)}>")

    def in_any(self, a: str) -> str:
        """Whether a truth holds in any lane."""
        name = f"@llvm.vector.reduce.or.v{self.width}i1({self.references}"
        self.declarations.add(f"declare i1 {name})")
        return self.value(f"call i1 {name} {a})")

    def rough_log2(self, x: str) -> str:
        """Binary logarithm of a positive number to one part in a hundred, as `toolbox.stepping.event_stepper` takes it for step sizes."""
        bits = self.bits(x)
        exponent = self.double(self.arithmetic("add", self.arithmetic("lshr", bits, 52), 0x4338000000000000 - 1023))
        mantissa = self.arithmetic("or", self.arithmetic("and", bits, 0xFFFFFFFFFFFFF), 0x3FF0000000000000)
        f = self.sub(self.double(mantissa), self.number(1.0))
        curve = self.mul(f, self.sub(self.number(1.3465), self.mul(self.number(0.3465), f)))
        return self.add(self.sub(exponent, self.number(_SHIFT)), curve)

    def rough_exp2(self, x: str) -> str:
        """Two to the power of x, |x| < 1000, to one part in two hundred."""
        floor = self.intrinsic("floor", x)
        f = self.sub(x, floor)
        power = _power_of_two(self, self.arithmetic("sub", self.bits(self.add(floor, self.number(_SHIFT))), 0x4338000000000000))
        return self.mul(power, self.add(self.number(1.0), self.mul(f, self.add(self.number(0.6565), self.mul(self.number(0.3435), f)))))

    def combination(self, base: str, scale: str, factors: Sequence[float], values: Sequence[str]) -> str:
        """base + scale * sum(factor * value): factors stay constants, which vector instructions read from memory for nothing."""
        total = ""
        for factor, value in zip(factors, values, strict=True):
            if factor:
                term = self.mul(self.number(factor), value)
                total = self.add(total, term) if total else term
        total = self.mul(scale, total) if total else ""
        return self.add(base, total) if base and total else base or total


def function_text(name: str, body: VectorBody, others: Sequence[str] = ()) -> str:
    """Return the text of an exported function on a block of lanes and on `others` arrays. Vector functions that it calls stand in
    `body.functions`."""
    pointers = ", ".join(f"ptr %{word}" for word in ("lanes", *others))
    return "\n".join([f"define void @{name}({pointers}) nounwind alignstack(64) {{", "entry:", *body.lines, "  ret void", "}"])


@cache
def _function(name: str, width: int) -> tuple[dict[str, str], frozenset[str]]:
    """Texts of a vector function and those it calls, and what they declare."""
    body = VectorBody(width)
    value = FUNCTIONS[name](body, "%x")
    head = f"define internal {body.type} @vector_{name}({body.type} %x) nounwind readnone willreturn {'alwaysinline' if name in ('exp', 'log') else ''} {{"
    text = "\n".join([head, "entry:", *body.lines, f"  ret {body.type} {value}", "}"])
    return {**body.functions, name: text}, frozenset(body.declarations)


_SHIFT = 1.5 * 2.0**52  # added to a number below 2^51 it leaves the nearest integer in the low bits


def _nearest(body: Body, x: str) -> tuple[str, str]:
    """The nearest integer of |x| < 2^51 as a double and as bits whose low part is that integer."""
    shifted = body.add(x, body.number(_SHIFT))
    return body.sub(shifted, body.number(_SHIFT)), body.bits(shifted)


def _power_of_two(body: Body, exponent: str) -> str:
    """2 to an integer from -1022 to 1023."""
    return body.double(body.arithmetic("shl", body.arithmetic("add", exponent, 1023), 52))


@cache
def _exp_coefficients() -> tuple[float, ...]:
    """q in exp r = 1 + r + r^2 q(r), |r| <= log(2) / 2: Chebyshev interpolation in long doubles, relative error below 1e-17."""
    wide = np.longdouble
    size, half = 10, np.log(wide(2)) / 2
    nodes = half * np.cos(np.pi * (2 * np.arange(size, dtype=wide) + 1) / (2 * size))
    factorial = np.cumprod(np.append(wide(1), np.arange(1, 30, dtype=wide)))
    values = sum(nodes**k / factorial[k + 2] for k in range(26))
    divided = values.copy()  # Newton's divided differences, then powers
    for k in range(1, size):
        divided[k:] = (divided[k:] - divided[k - 1 : -1]) / (nodes[k:] - nodes[: size - k])
    powers = np.zeros(size, dtype=wide)
    for k in reversed(range(size)):
        powers = np.append(wide(0), powers[:-1]) - nodes[k] * powers
        powers[0] += divided[k]
    return tuple(float(c) for c in powers)


def _exp(body: Body, x: str) -> str:
    for how, bound in (("ogt", 800.0), ("olt", -800.0)):  # NaN stays
        x = body.select(body.compare(how, x, body.number(bound)), body.number(bound), x)
    n, bits = _nearest(body, body.mul(x, body.number(1.4426950408889634)))
    r = body.sub(body.sub(x, body.mul(n, body.number(6.93147180369123816490e-01))), body.mul(n, body.number(1.90821492927058770002e-10)))
    tail = body.polynomial(r, _exp_coefficients())
    value = body.add(body.number(1.0), body.add(r, body.mul(body.mul(r, r), tail)))
    exponent = body.arithmetic("ashr", body.arithmetic("shl", bits, 32), 32)
    half = body.arithmetic("ashr", exponent, 1)
    scaled = body.mul(value, _power_of_two(body, half))
    return body.mul(scaled, _power_of_two(body, body.arithmetic("sub", exponent, half)))


def _log(body: Body, x: str) -> str:
    tiny = body.compare("olt", x, body.number(2.0**-1022))
    scaled = body.select(tiny, body.mul(x, body.number(2.0**54)), x)
    bits = body.bits(scaled)
    exponent = body.arithmetic(
        "ashr", body.arithmetic("sub", bits, 0x3FE6A09E667F3BCD), 52
    )  # the mantissa is then between sqrt(1/2) and sqrt(2)
    f = body.sub(body.double(body.arithmetic("sub", bits, body.arithmetic("shl", exponent, 52))), body.number(1.0))
    shifted = body.double(body.arithmetic("add", exponent, 0x4338000000000000))
    k = body.sub(body.sub(shifted, body.number(_SHIFT)), body.select(tiny, body.number(54.0), body.number(0.0)))
    s = body.div(f, body.add(body.number(2.0), f))
    z = body.mul(s, s)
    series = (6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01, 2.222219843214978396e-01,
              1.818357216161805012e-01, 1.531383769920937332e-01, 1.479819860511658591e-01)  # fmt: skip
    tail = body.mul(z, body.polynomial(z, series))
    square = body.mul(body.number(0.5), body.mul(f, f))
    small = body.add(body.mul(s, body.add(square, tail)), body.mul(k, body.number(1.90821492927058770002e-10)))
    value = body.sub(body.mul(k, body.number(6.93147180369123816490e-01)), body.sub(body.sub(square, small), f))
    value = body.select(body.compare("oeq", x, body.number(np.inf)), x, value)
    value = body.select(body.compare("oeq", x, body.number(0.0)), body.number(-np.inf), value)
    return body.select(body.compare("olt", x, body.number(0.0)), body.number(np.nan), body.select(body.compare("uno", x, x), x, value))


def _tanh(body: Body, x: str) -> str:
    z = body.mul(x, x)
    top = body.polynomial(z, (-1.61468768441708447952e3, -9.92877231001918586564e1, -9.64399179425052238628e-1))
    bottom = body.polynomial(z, (4.84406305325125486048e3, 2.23548839060100448583e3, 1.12811678491632931402e2, 1.0))
    small = body.add(x, body.mul(body.mul(x, z), body.div(top, bottom)))
    size = body.intrinsic("fabs", x)
    large = body.sub(body.number(1.0), body.div(body.number(2.0), body.add(body.call("exp", body.add(size, size)), body.number(1.0))))
    return body.intrinsic("copysign", body.select(body.compare("ult", size, body.number(0.625)), small, large), x)


def _circular(which: str) -> Callable[[VectorBody, str], str]:
    """sin or cos: reduction by pi/2 in three parts, and the two kernels of fdlibm."""

    def write(body: VectorBody, x: str) -> str:
        odd = body.compare("ugt", body.intrinsic("fabs", x), body.number(LARGEST_ANGLE))
        any_odd = body.in_any(odd)
        body.declarations.add(SELDOM)
        body.lines += [f"  br i1 {any_odd}, label %odd, label %usual, !prof !0", "odd:"]
        slow = body.lane_by_lane(which, x)
        body.lines += [f"  ret {body.type} {slow}", "usual:"]
        n, bits = _nearest(body, body.mul(x, body.number(2 / np.pi)))
        back = body.value(f"fneg {body.type} {n}")
        r = x
        for part in (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591833e-33):
            r = body.fused(back, body.number(part), r)
        z = body.mul(r, r)
        sine = (-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04, 2.75573137070700676789e-06,
                -2.50507602534068634195e-08, 1.58969099521155010221e-10)  # fmt: skip
        cosine = (4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05, -2.75573143513906633035e-07,
                  2.08757232129817482790e-09, -1.13596475577881948265e-11)  # fmt: skip
        s = body.add(r, body.mul(body.mul(r, z), body.polynomial(z, sine)))
        half = body.mul(body.number(0.5), z)
        w = body.sub(body.number(1.0), half)
        lost = body.sub(body.sub(body.number(1.0), w), half)
        c = body.add(w, body.add(lost, body.mul(body.mul(z, z), body.polynomial(z, cosine))))
        if which == "cos":
            bits = body.arithmetic("add", bits, 1)
        swap = body.value(f"trunc {body.integers} {bits} to {body.references}")
        turned = body.value(f"trunc {body.integers} {body.arithmetic('lshr', bits, 1)} to {body.references}")
        value = body.select(swap, c, s)
        return body.select(turned, body.value(f"fneg {body.type} {value}"), value)

    return write


POLYNOMIALS: dict[str, Callable[[Body, str], str]] = {"exp": _exp, "log": _log, "tanh": _tanh}
"""What arithmetic does, without a branch, for one number as for a vector of them."""

FUNCTIONS: dict[str, Callable[[VectorBody, str], str]] = {**POLYNOMIALS, "sin": _circular("sin"), "cos": _circular("cos")}
"""What has a vector version."""
