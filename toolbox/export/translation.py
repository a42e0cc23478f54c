"""Translation of the compiled loops into C99: the functions under `toolbox.stepping` and all that they call, as they stand.

They are written in a part of Python that is nearly C: functions of one set of arrays `w`, numbers and arrays, which allocate nothing and raise nothing. Types
follow from the arrays and from how the functions are called, one C function for every set of types; tuples become structs; conditions that are known, such as
those on the sizes of the model, leave out what they rule out. Whatever is not known here is refused by name and line, so that a change of the loop either
arrives in C or stops the export.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.export.c_values import C_TYPES, STORED, Array, Kind, NotTranslatable, Value, c_word
from toolbox.export.translated_statements import Writer


@dataclass
class Function:
    """One function for one set of types: its kinds as far as they are inferred, and its text in C."""

    name: str
    source: Any
    tree: ast.FunctionDef
    arguments: tuple[Value, ...]
    local: dict[str, Kind] = field(default_factory=dict)
    returns: Kind = None
    text: str = ""


@dataclass
class Translation:
    """The functions that a loop reaches, as C.

    Parameters
    ----------
    work
        {field of the arrays: array}: their dtypes and sizes are those of the C.
    numbers
        {(field, index): value} of entries that never change.
    constant
        {field: name in C} of arrays that never change.
    models
        {value of an address among the numbers: function in C};  `update` is called with addresses that are read from arrays.
    """

    work: Mapping[str, np.ndarray]
    numbers: Mapping[tuple[str, int], Any]
    constant: Mapping[str, str]
    models: Mapping[int, str]
    update: str
    struct: str
    made: dict[Any, Function] = field(default_factory=dict)
    order: list[Function] = field(default_factory=list)
    structs: dict[tuple[str, ...], str] = field(default_factory=dict)
    helpers: dict[str, str] = field(default_factory=dict)

    def function(self, source: Any, arguments: Sequence[Value]) -> Function:
        """A function for arguments of these kinds, inferred but not yet written."""
        plain = getattr(source, "py_func", source)
        key = (plain, *((each.kind, each.known) if each.kind == "none" else each.kind for each in arguments))
        if key not in self.made:
            tree = ast.parse(textwrap.dedent(inspect.getsource(plain))).body[0]
            assert isinstance(tree, ast.FunctionDef)
            base = f"loop_{plain.__name__.strip('_')}"
            taken = {each.name for each in self.made.values()}
            name = next(each for each in (base, *(f"{base}_{k}" for k in range(2, 99))) if each not in taken)
            kept = tuple(each if each.kind == "none" else Value("", each.kind) for each in arguments)
            made = self.made[key] = Function(name, plain, tree, kept)
            for _ in range(6):
                before = (dict(made.local), made.returns)
                Writer(self, made).body()
                if before == (made.local, made.returns):
                    break
        return self.made[key]

    def written(self, source: Any, arguments: Sequence[Value]) -> Function:
        """The same with its text, and that of all that it calls before it."""
        made = self.function(source, arguments)
        if not made.text:
            made.text = "/* */"  # nothing calls itself; what would is refused by the compiler
            writer = Writer(self, made, final=True)
            made.text = writer.text()
            self.order.append(made)
        return made

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
            return f"{STORED[kind.dtype][1]} *"
        return f"{self.struct} *" if kind == "w" else C_TYPES[kind]

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
        """Everything that has been written, in an order in which C can read it."""
        structs = [
            f"typedef struct {{ {' '.join(f'{C_TYPES[kind]} f{i};' for i, kind in enumerate(kinds))} }} {name};"
            for kinds, name in self.structs.items()
        ]
        return "\n\n".join(["\n".join(structs), "\n".join(self.helpers.values()), *(made.text for made in self.order)])
