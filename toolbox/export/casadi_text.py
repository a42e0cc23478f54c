"""Functions of casadi as C99 that strict compilers accept without a warning."""

from __future__ import annotations

import re
from collections.abc import Sequence

import casadi as ca

_HEAD = re.compile(r"^(static int \w+\(const casadi_real\*\* arg[^)]*\)) ?\{\n", re.MULTILINE)
_EXPORTED = re.compile(r"^CASADI_SYMBOL_EXPORT [^\n]*(?:\}\n|\{\n(?:(?!\}\n)[^\n]*\n)*\}\n)\n*", re.MULTILINE)
_ENTRY = re.compile(r"^CASADI_SYMBOL_EXPORT int (\w+)\(const casadi_real\*\* arg[^)]*\) ?\{\n  return (casadi_f\d+)\(", re.MULTILINE)


def casadi_text(name: str, functions: Sequence[ca.Function], given: bool = False) -> str:
    """The C that casadi writes for functions, each of them `static int FUNCTION(arg, res, iw, w, mem)`.

    Whatever is global begins with the name, and nothing is there that nobody reads.  given: no pointer in `arg` and `res` is null, and nothing asks.
    """
    generator = ca.CodeGenerator(name, {"casadi_int": "int", "casadi_real": "double", "main": False, "mex": False, "with_header": False})
    for function in functions:
        generator.add(function)
    body = generator.dump()
    entries = dict(_ENTRY.findall(body))
    body = _EXPORTED.sub("", body)  # what describes the functions to casadi, too
    for array in re.findall(r"static const casadi_int (casadi_s\d+)\[", body):  # sparsities that only these descriptions read
        if len(re.findall(rf"\b{array}\b", body)) == 2:
            body = re.sub(rf"^(#define {array} |static const casadi_int {array}\[).*\n", "", body, flags=re.MULTILINE)
    body = re.sub(r"^casadi_real casadi_(\w+)\(", r"static casadi_real casadi_\1(", body, flags=re.MULTILINE)
    if given:
        body = re.sub(r"arg\[(\d+)\]\? arg\[\1\]\[(\d+)\] : 0;", r"arg[\1][\2];", body)
        body = re.sub(r"if \(res\[(\d+)\]!=0\) res\[\1\]", r"res[\1]", body)
    body = _HEAD.sub(lambda found: f"{found[1]} {{\n  (void)arg; (void)res; (void)iw; (void)w; (void)mem;\n", body)
    arguments = "const casadi_real** arg, casadi_real** res, casadi_int* iw, casadi_real* w, int mem"
    lines = [f"static int {entry}({arguments}) {{ return {inner}(arg, res, iw, w, mem); }}" for entry, inner in entries.items()]
    return "\n".join([body.rstrip(), "", *lines])
