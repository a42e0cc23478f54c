"""Translation of the compiled loops: the functions under `toolbox.stepping` and all that they call, as they stand, into C99 or into the text of LLVM.

They are written in a part of Python that is nearly C: functions of named tuples of arrays, such as `w`, of numbers and of arrays, which allocate nothing and
raise nothing. Types follow from the arrays and from how the functions are called, one function for every set of types; tuples become structs; conditions that
are known, such as those on the sizes of a model in C, leave out what they rule out. Whatever is not known here is refused by name and line, so that a change of
the loop either arrives in both languages or stops them.

Why not numba: it writes no C, and the first design of a controller took 16.7 s with it, 2.2 s with this.
"""

from __future__ import annotations

import ast
import linecache
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from types import FunctionType
from typing import Any

from toolbox.translation.kinds import Array, Arrays, Kind, NotTranslatable, Value
from toolbox.translation.statements import Writer


@dataclass
class Function:
    """A function for one set of argument types: the kinds inferred so far, and its text."""

    name: str
    source: FunctionType
    tree: ast.FunctionDef
    arguments: tuple[Value, ...]
    local: dict[str, Kind] = field(default_factory=dict)
    returns: Kind = None
    text: str = ""


@dataclass
class Translation:
    """The functions that a loop reaches, in a language.

    Parameters
    ----------
    tuples
        {kind of a named tuple of arrays: {field: its kind}}.
    numbers
        {(field, index): value} of entries that never change.
    constant
        Fields that never change.
    language
        What writes a function.
    """

    tuples: Mapping[Arrays, Mapping[str, Array]]
    numbers: Mapping[tuple[str, int], Any]
    constant: Mapping[str, str]
    language: type[Any]
    made: dict[Any, Function] = field(default_factory=dict)
    order: list[Function] = field(default_factory=list)

    def function(self, source: Any, arguments: Sequence[Value]) -> Function:
        """A function for arguments of these kinds, inferred but not yet written."""
        plain = getattr(source, "py_func", source)
        key = (plain, *((each.kind, each.known) if each.kind == "none" else each.kind for each in arguments))
        if key not in self.made:
            base = f"loop_{plain.__name__.strip('_')}"
            taken = {each.name for each in self.made.values()}
            name = next(each for each in (base, *(f"{base}_{k}" for k in range(2, 99))) if each not in taken)
            kept = tuple(each if each.kind == "none" else Value("", each.kind) for each in arguments)
            made = self.made[key] = Function(name, plain, tree_of(plain), kept)
            for _ in range(6):
                before = (dict(made.local), made.returns)
                Writer(self, made).body()
                if before == (made.local, made.returns):
                    break
        return self.made[key]

    def written(self, source: Any, arguments: Sequence[Value]) -> Function:
        """Return the function with its text. The functions that it calls are written before it."""
        made = self.function(source, arguments)
        if not made.text:
            made.text = "/* */"  # nothing calls itself; what would is refused by the compiler
            made.text = self.language(self, made).text()
            self.order.append(made)
        return made


@cache
def _functions_of(path: str, source: str) -> dict[int, ast.FunctionDef]:
    """The functions of a file by the line that they begin at, with what decorates them."""
    found = [node for node in ast.walk(ast.parse(source, path)) if isinstance(node, ast.FunctionDef)]
    return {min([node.lineno, *(each.lineno for each in node.decorator_list)]): node for node in found}


def tree_of(plain: FunctionType) -> ast.FunctionDef:
    """Return the source of a function as a syntax tree. NotTranslatable is raised if the file is missing or has changed since, or if the
    function is a closure."""
    path = plain.__code__.co_filename
    found = _functions_of(path, "".join(linecache.getlines(path, plain.__globals__))).get(plain.__code__.co_firstlineno)
    if found is None or found.name != plain.__name__:
        raise NotTranslatable(f"{plain.__module__}.{plain.__qualname__}: there is no text of it")
    if plain.__closure__:
        raise NotTranslatable(f"{plain.__module__}.{plain.__qualname__}: it encloses `{plain.__code__.co_freevars[0]}`")
    return found
