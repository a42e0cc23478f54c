"""Functions of casadi as C99 that strict compilers accept without a warning."""

from __future__ import annotations

import re
from collections.abc import Sequence

import casadi as ca

_HEAD = re.compile(r"^(?:static |CASADI_SYMBOL_EXPORT )?int \w+\(const casadi_real\*\* arg[^)]*\) ?\{\n", re.MULTILINE)


def casadi_text(name: str, functions: Sequence[ca.Function]) -> str:
    """The C that casadi writes for functions; whatever is global begins with the name, and nothing is there that nobody reads."""
    generator = ca.CodeGenerator(name, {"casadi_int": "int", "casadi_real": "double", "main": False, "mex": False, "with_header": False})
    for function in functions:
        generator.add(function)
    body = generator.dump()
    if len(functions) == 1:
        entry = body.index(f"int {functions[0].name()}(")
        rest = body.find("CASADI_SYMBOL_EXPORT", entry)  # from here on casadi describes the function to casadi
        body = body[: rest if rest > 0 else None].rstrip()
    for array in re.findall(r"static const casadi_int (casadi_s\d+)\[", body):  # sparsities that only casadi's own description reads
        if len(re.findall(rf"\b{array}\b", body)) == 2:
            body = re.sub(rf"^(#define {array} |static const casadi_int {array}\[).*\n", "", body, flags=re.MULTILINE)
    body = body.replace("_release(int mem) {\n", "_release(int mem) {\n  (void)mem;\n")
    return _HEAD.sub(lambda found: f"{found[0]}  (void)arg; (void)res; (void)iw; (void)w; (void)mem;\n", body)
