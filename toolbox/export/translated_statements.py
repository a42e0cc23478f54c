"""Statements of the loops in C (`toolbox.export.translation`)."""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence

from toolbox.compilation.calls import lent, owned
from toolbox.export.c_values import C_TYPES, STORED, Array, Kind, NotTranslatable, Value, c_word, joined, known
from toolbox.export.translated_expressions import Expressions


def _stores(body: list[ast.stmt], name: str) -> bool:
    """Whether statements give a name another value."""
    each = (part for statement in body for part in ast.walk(statement))
    return any(isinstance(part, ast.Name) and part.id == name and isinstance(part.ctx, ast.Store) for part in each)


class Writer(Expressions):
    """Writes one function, or, before its types are known, finds them."""

    def body(self) -> None:
        """All statements."""
        self.block(self.made.tree.body)

    def text(self) -> str:
        """The function in C."""
        self.body()
        parameters = [name for name, value in self.names.items() if value.kind != "none"]
        variables = {name: kind for name, kind in self.made.local.items() if name not in self.names}
        head = [
            f"  {self.t.c_type(kind)} {c_word(name)} = 0;".replace("* ", "*")
            for name, kind in variables.items()
            if not isinstance(kind, tuple)
        ]
        body = "\n".join(self.lines)
        set_only = {name: len(re.findall(rf"^ *{c_word(name)} = ", body, re.MULTILINE)) for name in variables}
        unread = [
            c_word(name)
            for name in (*parameters, *variables)
            if len(re.findall(rf"(?<![.>\w]){c_word(name)}\b", body)) == set_only.get(name, 0)
        ]
        quiet = ["  " + " ".join(f"(void){name};" for name in unread)] if unread else []
        return "\n".join([self.t.declaration(self.made) + " {", *head, *quiet, *self.lines, "}"])

    def emit(self, line: str) -> None:
        """Write one line."""
        self.lines.append("  " * self.depth + line)

    def block(self, statements: Sequence[ast.stmt]) -> None:
        """Write statements."""
        for node in statements:
            handler = getattr(self, f"on_{type(node).__name__}", None)
            if handler is None:
                self.refuse(node)
            handler(node)

    def nested(self, head: str, statements: Sequence[ast.stmt], tail: str = "}") -> None:
        """Write statements between braces."""
        self.emit(head)
        self.depth += 1
        self.block(statements)
        self.depth -= 1
        if tail:
            self.emit(tail)

    def on_Pass(self, node: ast.Pass) -> None:
        """Nothing."""

    def on_Break(self, node: ast.Break) -> None:
        """Leave a loop."""
        self.emit("break;")

    def on_Continue(self, node: ast.Continue) -> None:
        """The next turn of a loop."""
        self.emit("continue;")

    def on_Expr(self, node: ast.Expr) -> None:
        """A call for what it does, or words."""
        if isinstance(node.value, ast.Constant):
            return
        if not isinstance(node.value, ast.Call):
            self.refuse(node)
        value = self.value(node.value)
        if value.text:
            self.emit(f"{value.text};")

    def on_Return(self, node: ast.Return) -> None:
        """What a function gives."""
        if node.value is None:
            self.made.returns = joined(self.made.returns, "none")
            self.emit("return;")
            return
        if isinstance(node.value, ast.Tuple):
            values = [self.value(each) for each in node.value.elts]
            self.made.returns = joined(self.made.returns, tuple(value.kind for value in values))
            self.emit(
                f"return ({self.t.c_type(self.made.returns)}){{{', '.join(value.text for value in values)}}};" if self.final else "return;"
            )
            return
        value = self.value(node.value)
        self.made.returns = joined(self.made.returns, value.kind)
        self.emit(f"return {value.text};")

    def on_If(self, node: ast.If) -> None:
        """A condition; one that is known leaves out the other branch."""
        test = self.value(node.test)
        if test.is_known:
            self.block(node.body if test.known else node.orelse)
            return
        self.nested(f"if ({bare(test.text)}) {{", node.body, "" if node.orelse else "}")
        if node.orelse:
            self.nested("} else {", node.orelse)

    def on_While(self, node: ast.While) -> None:
        """A loop with a condition."""
        test = self.value(node.test)
        if node.orelse:
            self.refuse(node)
        if test.is_known and not test.known:
            return
        self.nested("for (;;) {" if test.is_known else f"while ({bare(test.text)}) {{", node.body)

    def on_For(self, node: ast.For) -> None:
        """A loop over a range, or over a few numbers that are known."""
        if node.orelse or not isinstance(node.target, ast.Name):
            self.refuse(node)
        self.count += 1
        name = f"unused_{self.count}" if node.target.id == "_" else node.target.id
        if name in self.names or _stores(node.body, name):
            self.refuse(node, f"`{name}` is changed inside its loop")
        if isinstance(node.iter, ast.Tuple):
            self.for_each(node, name, [self.value(each) for each in node.iter.elts])
            return
        if not (isinstance(node.iter, ast.Call) and self.outside(node.iter.func) is range):
            self.refuse(node.iter)
        bounds = [self.value(each) for each in node.iter.args]
        first, last, step = ([known(0), *bounds, known(1)] if len(bounds) == 1 else [*bounds, known(1)])[:3]
        if step.known not in (1, -1) or any(bound.kind != "i" for bound in (first, last)):
            self.refuse(node.iter)
        if first.is_known and last.is_known and (last.known - first.known) * step.known <= 0:
            return
        self.enter(name, "i")
        end, word = f"end_{self.count}", c_word(name)
        bound = last.text if last.is_known else end
        more = "" if last.is_known else f", {end} = {last.text}"
        self.nested(
            f"for (int64_t {word} = {first.text}{more}; {word} {'<' if step.known == 1 else '>'} {bound}; {'++' if step.known == 1 else '--'}{word}) {{",
            node.body,
        )
        self.leave(name)

    def for_each(self, node: ast.For, name: str, values: list[Value]) -> None:
        """A loop over a few numbers that are known."""
        kind = values[0].kind
        place = f"place_{self.count}"
        self.emit("{")
        self.depth += 1
        self.emit(f"static const {C_TYPES[kind]} each_{self.count}[{len(values)}] = {{{', '.join(value.text for value in values)}}};")
        self.emit(f"int {place};")
        self.enter(name, kind)
        self.emit(f"for ({place} = 0; {place} < {len(values)}; ++{place}) {{")
        self.depth += 1
        self.emit(f"const {C_TYPES[kind]} {c_word(name)} = each_{self.count}[{place}];")
        self.block(node.body)
        for _ in range(2):
            self.depth -= 1
            self.emit("}")
        self.leave(name)

    def enter(self, name: str, kind: Kind) -> None:
        """A variable of a loop begins."""
        if name in self.made.local or name in self.loops:
            raise NotTranslatable(f"{self.made.source.__qualname__}: `{name}` is the variable of a loop and another one")
        self.loops[name] = kind

    def leave(self, name: str) -> None:
        """A variable of a loop ends."""
        del self.loops[name]

    def on_Assign(self, node: ast.Assign) -> None:
        """An assignment, also to several at once."""
        if len(node.targets) != 1:
            self.refuse(node)
        target = node.targets[0]
        if not isinstance(target, ast.Tuple):
            if isinstance(target, ast.Name) and self.same_work(target.id, node.value):
                return
            self.store(target, self.value(node.value))
            return
        if isinstance(node.value, ast.Tuple):
            values = [self.value(each) for each in node.value.elts]
            if all(value.is_known for value in values) or self.apart(target, node.value):
                for each, value in zip(target.elts, values, strict=True):
                    self.store(each, value)
                return
            self.emit("{")
            self.depth += 1
            for i, value in enumerate(values):
                self.emit(f"const {self.t.c_type(value.kind)} new_{i} = {value.text};")
            for i, (each, value) in enumerate(zip(target.elts, values, strict=True)):
                self.store(each, Value(f"new_{i}", value.kind))
        else:
            value = self.value(node.value)
            if not isinstance(value.kind, tuple):
                if value.kind is None:
                    return
                self.refuse(node)
            self.emit("{")
            self.depth += 1
            if self.final:
                self.emit(f"const {self.t.c_type(value.kind)} new = {value.text};")
            for i, (each, kind) in enumerate(zip(target.elts, value.kind, strict=True)):
                if not (isinstance(each, ast.Name) and each.id == "_"):
                    self.store(each, Value(f"new.f{i}", kind))
            self.emit("(void)new;")
        self.depth -= 1
        self.emit("}")

    def same_work(self, name: str, node: ast.expr) -> bool:
        """Whether an assignment only lends the arrays to the function itself."""
        return (
            name in self.names and self.names[name].kind == "w" and isinstance(node, ast.Call) and self.outside(node.func) in (lent, owned)
        )

    def apart(self, target: ast.Tuple, values: ast.Tuple) -> bool:
        """Whether variables may be set one after another, because none of the later values reads one of them."""
        names = [each.id for each in target.elts if isinstance(each, ast.Name)]
        if len(names) < len(target.elts):
            return False
        later = [(i, each) for i, value in enumerate(values.elts) for each in ast.walk(value)]
        return not any(isinstance(each, ast.Name) and each.id in names[:i] for i, each in later)

    def store(self, target: ast.expr, value: Value) -> None:
        """Set a variable or an entry."""
        if isinstance(target, ast.Name):
            name = target.id
            if name in self.loops or (name in self.names and self.names[name].kind in ("w", "none")):
                self.refuse(target, f"`{name}` may not be set")
            if name in self.names:
                self.names[name] = Value("", joined(self.names[name].kind, value.kind))
                if self.names[name].kind != self.made.arguments[[a.arg for a in self.made.tree.args.args].index(name)].kind:
                    self.refuse(target, f"`{name}` changes its type")
            else:
                if value.kind == "none" or isinstance(value.kind, tuple):
                    self.refuse(target)
                self.made.local[name] = joined(self.made.local.get(name), value.kind)
            self.emit(f"{c_word(name)} = {value.text};")
            return
        if not isinstance(target, ast.Subscript):
            self.refuse(target)
        place = self.value(target, store=True)
        stored = STORED[place.dtype][1] if isinstance(place, Array) else ""
        assert not stored
        self.emit(f"{place.text} = {value.text};")

    def on_AugAssign(self, node: ast.AugAssign) -> None:
        """An assignment that computes with what was there."""
        changed = ast.BinOp(left=_loaded(node.target), op=node.op, right=node.value)
        ast.copy_location(changed, node)
        self.store(node.target, self.value(changed))


def _loaded(target: ast.expr) -> ast.expr:
    """The same place, to be read."""
    found = ast.parse(ast.unparse(target), mode="eval").body
    for each in ast.walk(found):
        if hasattr(each, "lineno"):
            each.lineno = target.lineno
    return found


def bare(text: str) -> str:
    """A condition without parentheses around the whole of it, of which compilers think that `=` was meant."""
    depth = 0
    for i, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and i < len(text) - 1:
            return text
    return bare(text[1:-1]) if text.startswith("(") else text
