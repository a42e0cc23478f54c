"""A number of everything that enters the machine code of a function: of its text, however deep, and of whatever it reads.

Compiled functions enclose nothing, have no defaults and hold no functions of their own, which the translator refuses.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

VERSIONED = {"llvmlite", "numpy"}
"""Packages whose code enters the number of a function by their version alone, as that of Python does."""


def stamp_of(function: Any, *besides: Any) -> str:
    """Return a hash, in hexadecimal digits, of a function, of everything that it calls and reads, and of additional values such as
    versions."""
    found = hashlib.sha256(repr(besides).encode())
    for text in sorted(f"{_name(each)} {_digest(each)}" for each in followed(function)):
        found.update(text.encode() + b"\n")
    return found.hexdigest()


def followed(function: Any) -> list[FunctionType]:
    """The function itself and all that it calls, however deep."""
    found: dict[FunctionType, None] = {}
    waiting = [function]
    while waiting:
        plain = _plain(waiting.pop())
        if plain is not None and plain not in found:
            found[plain] = None
            waiting += [value for _, value in read_outside(plain)]
    return list(found)


def _plain(thing: Any) -> FunctionType | None:
    """The Python function behind a compiled one, or itself; None for anything else, and for what stands in a versioned package."""
    found = getattr(thing, "py_func", thing)
    return found if isinstance(found, FunctionType) and not _versioned(found.__module__) else None


def _versioned(module: str | None) -> bool:
    top = (module or "builtins").partition(".")[0]
    return top in VERSIONED or top in sys.stdlib_module_names


def _name(plain: FunctionType) -> str:
    return f"{plain.__module__}.{plain.__qualname__}"


def _digest(plain: FunctionType) -> str:
    """A number of one function: its code without file, lines and the words that describe it, what its constants are and which functions it calls."""
    code = plain.__code__
    constants = code.co_consts[1:] if plain.__doc__ is not None and code.co_consts[:1] == (plain.__doc__,) else code.co_consts
    found = hashlib.sha256(code.co_code)
    found.update(repr((code.co_names, code.co_varnames, code.co_argcount, code.co_flags, constants)).encode())
    for name, value in read_outside(plain):
        found.update(f"{name} = {_text(value, name, plain)}\n".encode())
    return found.hexdigest()


def read_outside(plain: FunctionType) -> Iterator[tuple[str, Any]]:
    """(name, value) of whatever a function reads from outside: globals, also of modules that it names."""
    names = sorted(plain.__code__.co_names)
    waiting = [(name, plain.__globals__[name]) for name in names if name in plain.__globals__]
    while waiting:
        name, value = waiting.pop(0)
        if not isinstance(value, ModuleType):
            yield name, value
        elif not _versioned(value.__name__):
            waiting += [(f"{name}.{word}", vars(value)[word]) for word in names if word in vars(value)]


def _text(value: Any, name: str, user: FunctionType) -> str:
    """A value as text that another value does not have."""
    plain = _plain(value)
    if plain is not None:
        return f"function {_name(plain)}"
    if isinstance(value, (int, float, np.generic)):
        return f"{type(value).__name__} {value!r}"
    if callable(value) and _versioned(getattr(value, "__module__", None)):  # types and functions of Python and numpy
        return f"function {value.__module__}.{value.__qualname__}"
    raise TypeError(f"Function `{user.__qualname__}` must read constants and functions only, but `{name}` holds a {type(value).__name__}.")
