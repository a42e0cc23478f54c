"""Loops as machine code do what their text does in Python, to the last bit, on every processor, and are compiled once."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from tests.refusals import each_of, refusals
from toolbox.compilation import work_layout
from toolbox.stepping import event_stepper, noise, time_stepper
from toolbox.translation import compiled
from toolbox.translation.compiled import Compiled
from toolbox.translation.kinds import NotTranslatable
from toolbox.translation.words import call

OFFSET = 3


def arithmetic(a, b):
    s = a / b - 2.0 * a + b**2 + abs(a) ** 0.7 + abs(a - b)
    return s * math.sqrt(abs(a)) - math.copysign(0.25, b) + math.floor(7.0 * a) + OFFSET


def powers(a):
    return a**3 + 2.0 * a**4


def divided(i, j):
    return 1000 * (i // j) + i % j + (i << 2) - (i >> 1) + (i & 6) - (i | 9) + (i ^ 5)


def extremes(a, b):
    return 3.0 * min(a, b, 0.5) + max(b, a)


def minutely(a):
    return (a + 0.5).view(np.int64) if False else np.int64(2.0 * a)


def chosen(i, j):
    first = i if i > j else 2.0 * j
    if 0 <= i < j or i - j != 0:
        first += 10.0
    elif i > 3 and j > 3:
        first -= 1.0
    else:
        first = -first
    return first


def _pair(i):
    if i > 2:
        return True, i, 0.5 * i
    return False, 0, 1.0


def looped(n, stop):
    total, k = 0.0, 0
    for i in range(n):
        if i == stop:
            continue
        if i > 2 * stop:
            break
        even, whole, part = _pair(i)
        total += part + whole if even else 0.25
    for i in range(n - 1, -1, -1):
        total = total * 0.5 + i
    while True:
        k += 1
        if k > n:
            break
    for sign in (1.0, -2.0):
        k, total = k + 1, total + sign * k
    for late in (False, True):
        total += 100.0 if late else 0.0
    return total


def scrambled(key, number):
    found = noise.scrambled(key + np.uint64(2 * number + 1) * np.uint64(0x9E3779B97F4A7C15))
    return float(found >> np.uint64(11))


class Arrays(NamedTuple):
    reals: np.ndarray
    wholes: np.ndarray
    flags: np.ndarray
    table: np.ndarray
    bytes: np.ndarray
    block: np.ndarray
    few: np.ndarray


KINDS = {
    "reals": ("float64", 1), "wholes": ("int64", 1), "flags": ("bool", 1), "table": ("float64", 2), "bytes": ("int8", 2), "block": ("float64", 3),
    "few": ("int32", 1),
}  # fmt: skip


def _sum(values, count):
    total = 0.0
    for i in range(count):
        total += values[i]
    return total


def on_arrays(w):
    for i in range(w.reals.size):
        w.flags[i] = w.reals[i] > 0.0 and w.wholes[i] != 0
        w.few[i] = w.wholes[i] - 2
        w.wholes[i] += 3 if w.flags[i] else -i
    for r in range(w.table.shape[0]):
        row = w.table[r]
        for c in range(w.table.shape[1]):
            w.table[r, c] += row[c] * w.reals[c] + _sum(w.reals[1:], 2)
            w.bytes[r, c] = np.int8(100 * r + 90 * c)
            for d in range(w.block.shape[2]):
                w.block[r, c, d] = w.table[r, c] + 0.5 * d - w.few[c]
    return w.wholes[0] + w.block.shape[1] * 10 + (1 if not w.flags[0] else 2)


def arrays(seed=3):
    draw = np.random.default_rng(seed)
    return Arrays(
        draw.normal(size=4), draw.integers(-3, 4, 4), np.zeros(4, bool), draw.normal(size=(3, 4)), np.zeros((3, 4), np.int8), np.zeros((3, 4, 2)),
        np.zeros(4, np.int32),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("function", "kinds", "gives"),
    [(arithmetic, "ff", "f"), (divided, "ii", "i"), (extremes, "ff", "f"), (minutely, "f", "i"), (chosen, "ii", "f"), (looped, "ii", "f")],
)
def test_functions_of_numbers_give_what_they_give_in_python(empty, function, kinds, gives):
    made = Compiled(function, *kinds, gives=gives)
    draw = np.random.default_rng(1)
    for _ in range(300):
        given = [float(draw.normal()) * 4.0 if kind == "f" else int(draw.integers(-9, 10)) or 1 for kind in kinds]
        expected = function(*given)
        assert made(*given) == expected and isinstance(made(*given), float if gives == "f" else int), (given, expected)


def test_whole_powers_are_products_of_squares(empty):
    made = Compiled(powers, "f", gives="f")
    for a in np.random.default_rng(2).normal(size=50).tolist():
        assert made(a) == a * (a * a) + 2.0 * ((a * a) * (a * a))


def test_extremes_take_what_python_takes_where_one_is_no_number(empty):
    made = Compiled(extremes, "f", "f", gives="f")
    for given in ((math.nan, 1.0), (1.0, math.nan), (-0.0, 0.0), (0.0, -0.0), (math.inf, -math.inf)):
        np.testing.assert_array_equal(made(*given), extremes(*given))


def test_whole_numbers_without_sign_wrap_around(empty):
    made = Compiled(scrambled, "u", "i", gives="f")
    with np.errstate(over="ignore"):
        for key in (0, 7, 2**63 + 11, 2**64 - 1):
            assert [made(key, k) for k in range(20)] == [scrambled(np.uint64(key), k) for k in range(20)]


def test_arrays_of_all_kinds_and_sizes_are_read_and_written_in_place(empty):
    made = Compiled(on_arrays, KINDS)
    for seed in range(4):
        ours, theirs = arrays(seed), arrays(seed)
        with np.errstate(over="ignore"):
            few = np.array([100 * r + 90 * c for r in range(3) for c in range(4)]).astype(np.int8).reshape(3, 4)
        assert made(ours) == _in_python(theirs, few)
        for name in KINDS:
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)


def _in_python(w, few):
    """What `on_arrays` does, where numpy refuses a number that is too large for a byte."""
    w.flags[:] = (w.reals > 0.0) & (w.wholes != 0)
    w.few[:] = w.wholes - 2
    w.wholes[:] += np.where(w.flags, 3, -np.arange(4))
    total = 0.0 + w.reals[1] + w.reals[2]
    for r in range(3):
        for c in range(4):
            w.table[r, c] += w.table[r, c] * w.reals[c] + total
            w.block[r, c] = w.table[r, c] + 0.5 * np.arange(2) - w.few[c]
    w.bytes[:] = few
    return w.wholes[0] + 40 + (2 if w.flags[0] else 1)


test_wrong_uses_are_refused_in_these_words = refusals(
    *each_of(lambda wrong: Compiled(on_arrays, KINDS)(arrays()._replace(reals=wrong)), "reals", (arrays().reals.astype(np.float32), arrays().wholes,
     np.zeros((4, 2))[:, 0], np.zeros((2, 2)), arrays().reals.astype(arrays().reals.dtype.newbyteorder()), [1.0], 1.0, None), TypeError),
    *each_of(lambda wrong: Compiled(on_arrays, KINDS)(wrong), "reals", (tuple(arrays())[:-1], (*arrays(), arrays().reals), ()), TypeError),
)  # fmt: skip


def test_arrays_of_a_file_and_whole_numbers_of_another_name_are_read_and_written_in_place(empty, tmp_path):
    made, given, other = Compiled(on_arrays, KINDS), arrays(), arrays()
    mapped = np.memmap(tmp_path / "reals", other.reals.dtype, "w+", shape=other.reals.shape)
    mapped[:] = other.reals
    found = other._replace(reals=mapped, wholes=other.wholes.view(np.longlong))
    assert made(given) == made(found)
    for mine, theirs in zip(given, found, strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_a_bound_call_does_the_same_to_arrays_that_are_looked_at_once(empty):
    made, given, other = Compiled(on_arrays, KINDS), arrays(), arrays()
    run = made.bound(other._replace(wholes=other.wholes.view(np.longlong)))  # arrays live on with the call alone
    for _ in range(2):
        assert made(given) == run()
    for mine, theirs in zip(given, other, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    with pytest.raises(TypeError, match="must be given arrays"):
        made.bound(other._replace(table=other.table[:, ::2]))


def test_it_is_compiled_once_and_a_damaged_object_anew(empty, monkeypatch):
    assert not Compiled(extremes, "f", "f", gives="f").known()
    assert Compiled(extremes, "f", "f", gives="f")(1.0, 2.0) == 3.5
    (path,) = (empty / "cache" / "loops").iterdir()
    made = Compiled(extremes, "f", "f", gives="f")
    assert made.known()
    with monkeypatch.context() as patched:
        patched.setattr(compiled, "object_code", lambda *_: pytest.fail("compiled again"))
        assert made(1.0, 2.0) == 3.5
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    assert not Compiled(extremes, "f", "f", gives="f").known()
    assert Compiled(extremes, "f", "f", gives="f")(1.0, 2.0) == 3.5 and Compiled(extremes, "f", "f", gives="f").known()


def test_what_a_loop_reads_and_the_translator_enter_the_number_of_its_code(monkeypatch):
    stamps = [Compiled(arithmetic, "f", "f", gives="f")._stamp, Compiled(arithmetic, "f", "i", gives="f")._stamp]
    with monkeypatch.context() as patched:
        patched.setitem(globals(), "OFFSET", 4)
        stamps.append(Compiled(arithmetic, "f", "f", gives="f")._stamp)
    with monkeypatch.context() as patched:
        patched.setattr(compiled, "_translator", lambda: "another one")
        stamps.append(Compiled(arithmetic, "f", "f", gives="f")._stamp)
    monkeypatch.setattr(compiled, "machine", lambda: "another machine")
    stamps.append(Compiled(arithmetic, "f", "f", gives="f")._stamp)
    assert len(set(stamps)) == len(stamps)


LOOPS = [event_stepper.advance_plain, event_stepper.advance_series, event_stepper.evaluate, time_stepper.advance, noise.normal]


@pytest.mark.parametrize("loop", LOOPS, ids=lambda loop: f"{loop.py_func.__name__} {len(loop.arguments)}")
def test_nothing_in_the_loops_hangs_on_the_processor_or_may_be_rounded_otherwise(loop):
    words = set(loop.text.split())
    assert not words & {"contract", "fast", "reassoc", "arcp", "afn", "nsz", "nnan", "ninf", "llvm.fma.f64", "llvm.fmuladd.f64"}
    assert compiled.plain_processor()[1] == ""


def test_the_kinds_of_the_arrays_are_those_that_runs_have():
    assert list(work_layout.KINDS) == list(work_layout.Work._fields)
    assert list(work_layout.BETWEEN_KINDS) == list(work_layout.Between._fields)


def unknown(a):
    return sum([a])


def text_of(w):
    call(w.ints[0], 0.0, 0.0, w.x, w.x, w.x, w.x, w.x)
    return "words"


@pytest.mark.parametrize(
    ("function", "line", "given"), [(unknown, 1, ("f",)), (text_of, 2, ({"ints": ("int64", 1), "x": ("float64", 1)},))]
)
def test_what_the_translator_does_not_know_is_refused_by_name_and_line(empty, function, line, given):
    with pytest.raises(NotTranslatable, match=rf"test_compiled.{function.__name__}, line {function.__code__.co_firstlineno + line}"):
        Compiled(function, *given, gives="f").ready()


def test_a_function_that_encloses_something_is_refused(empty):
    OFFSET = 4.0  # beside a constant of the module that has its name

    def moved(a):
        return a + OFFSET

    with pytest.raises(NotTranslatable, match="moved: it encloses `OFFSET`"):
        Compiled(moved, "f", gives="f").ready()
