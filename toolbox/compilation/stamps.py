"""A number of everything that enters the machine code of a function: of its text, however deep, and of whatever it reads."""

from __future__ import annotations

import dis
import hashlib
import sys
from collections.abc import Callable, Iterator
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

VERSIONED = {"llvmlite", "numpy"}
"""Packages whose code enters the number of a function by their version alone, as that of Python does."""


def stamp_of(function: Any, *besides: Any) -> str:
    """A number, in hexadecimal digits, of a function, of all that it calls and reads, and of what else is given, such as versions."""
    found = hashlib.sha256(repr(besides).encode())
    for text in sorted(f"{name} {digest}" for name, digest in ((_name(each), _digest(each)) for each in followed(function))):
        found.update(text.encode() + b"\n")
    return found.hexdigest()


def followed(function: Any) -> list[Any]:
    """The function itself and all that it calls, however deep: Python functions and compiled ones."""
    found: dict[int, Any] = {}
    waiting = [function]
    while waiting:
        each = waiting.pop()
        if id(each) not in found:
            found[id(each)] = each
            waiting += [value for _, value in read_outside(_plain(each)) if _plain(value) is not None]
    return list(found.values())


def _plain(thing: Any) -> FunctionType | None:
    """The Python function behind a compiled one, or itself; None for anything else, and for what stands in a versioned package."""
    found = getattr(thing, "py_func", thing)
    return found if isinstance(found, FunctionType) and not _versioned(found.__module__) else None


def _versioned(module: str | None) -> bool:
    top = (module or "builtins").partition(".")[0]
    return top in VERSIONED or top in sys.stdlib_module_names


def _name(thing: Any) -> str:
    plain = _plain(thing)
    assert plain is not None
    return f"{plain.__module__}.{plain.__qualname__}"


def _digest(thing: Any) -> str:
    """A number of one function: its code, what its constants are and which functions it calls, but not of those."""
    plain = _plain(thing)
    assert plain is not None
    found = hashlib.sha256()
    _add_code(found.update, plain.__code__, plain.__doc__)
    for name, value in read_outside(plain):
        found.update(f"{name} = {_text(value, name, plain)}\n".encode())
    return found.hexdigest()


def _add_code(update: Callable[[bytes], None], code: CodeType, words: str | None = None) -> None:
    """Add the byte code of a function and of those inside it, without file, line numbers and the words that describe it."""
    update(code.co_code + getattr(code, "co_exceptiontable", b""))
    update(repr((code.co_names, code.co_varnames, code.co_freevars, code.co_argcount, code.co_kwonlyargcount, code.co_flags)).encode())
    constants = code.co_consts[1:] if words is not None and code.co_consts[:1] == (words,) else code.co_consts
    for constant in constants:
        if isinstance(constant, CodeType):
            _add_code(update, constant)
        else:
            update(f"{repr(sorted(constant, key=repr)) if isinstance(constant, frozenset) else repr(constant)};".encode())


def read_outside(plain: FunctionType | None) -> Iterator[tuple[str, Any]]:
    """(name, value) of whatever a function reads from outside: globals, also of modules that it names, what it encloses, defaults; containers opened."""
    if plain is None:
        return
    names = _names(plain.__code__)
    waiting = [(name, plain.__globals__[name]) for name in names if name in plain.__globals__]
    waiting += [(name, sys.modules[name]) for name in names if name in sys.modules and name in _imported(plain.__code__)]
    waiting += [(name, cell.cell_contents) for name, cell in zip(plain.__code__.co_freevars, plain.__closure__ or (), strict=True)]
    waiting += [(f"default {k}", value) for k, value in enumerate(plain.__defaults__ or ())]
    waiting += [(f"default {name}", value) for name, value in sorted((plain.__kwdefaults__ or {}).items())]
    while waiting:
        name, value = waiting.pop(0)
        if isinstance(value, ModuleType):
            if not _versioned(value.__name__):
                waiting += [(f"{name}.{word}", vars(value)[word]) for word in names if word in vars(value)]
        elif isinstance(value, (tuple, list)):
            yield f"{name}.length", len(value)
            waiting += [(f"{name}.{k}", entry) for k, entry in enumerate(value)]
        else:
            yield name, value


def _names(code: CodeType) -> list[str]:
    """Names that a function and those inside it use, of globals and attributes."""
    inner = [name for constant in code.co_consts if isinstance(constant, CodeType) for name in _names(constant)]
    return sorted({*code.co_names, *inner})


@cache
def _imported(code: CodeType) -> frozenset[str]:
    """Modules that a function and those inside it import."""
    here = {each.argval for each in dis.get_instructions(code) if each.opname == "IMPORT_NAME"}
    return frozenset(here.union(*[_imported(constant) for constant in code.co_consts if isinstance(constant, CodeType)]))


def _text(value: Any, name: str, user: FunctionType) -> str:
    """A value as text that another value does not have."""
    if _plain(value) is not None:
        return f"function {_name(value)}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}"
    if isinstance(value, type):
        return f"class {value.__module__}.{value.__qualname__} {getattr(value, '_fields', '')}"
    if isinstance(value, (int, float, complex, str, bytes, type(None), np.generic)):
        return f"{type(value).__name__} {value!r}"
    if callable(value) and _versioned(getattr(value, "__module__", None)):  # functions of Python and numpy
        return f"function {value.__module__}.{value.__qualname__}"
    raise TypeError(f"Function `{user.__qualname__}` must read constants and functions only, but `{name}` holds a {type(value).__name__}.")
