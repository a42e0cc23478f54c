"""Statements of the loops that are translated (`toolbox.translation.translation`)."""

from __future__ import annotations

import ast
from collections.abc import Sequence

from toolbox.translation.expressions import Expressions, names_set
from toolbox.translation.kinds import Array, Arrays, Kind, NotTranslatable, Value, joined, known


class Writer(Expressions):
    """Walks through one function and finds the kinds of its variables; a language, which is a class above this one, writes it down as well."""

    def body(self) -> None:
        """All statements."""
        self.block(self.made.tree.body)

    def block(self, statements: Sequence[ast.stmt]) -> None:
        """Write statements."""
        for node in statements:
            handler = getattr(self, f"on_{type(node).__name__}", None)
            if handler is None:
                self.refuse(node)
            handler(node)

    def on_Pass(self, node: ast.Pass) -> None:
        """Nothing."""

    def on_Break(self, node: ast.Break) -> None:
        """Leave a loop."""
        self.jump("break")

    def on_Continue(self, node: ast.Continue) -> None:
        """The next turn of a loop."""
        self.jump("continue")

    def jump(self, how: str) -> None:
        """Leave a loop, or a turn of it."""

    def on_Expr(self, node: ast.Expr) -> None:
        """Translate a call that stands as a statement. A docstring is left out."""
        if isinstance(node.value, ast.Constant):
            return
        if not isinstance(node.value, ast.Call):
            self.refuse(node)
        self.run(self.value(node.value))

    def run(self, value: Value) -> None:
        """Carry out a call."""

    def on_Return(self, node: ast.Return) -> None:
        """What a function gives."""
        if isinstance(node.value, ast.Tuple):
            values = [self.value(each) for each in node.value.elts]
            kind: Kind = tuple(value.kind for value in values)
        else:
            values = [self.value(node.value)] if node.value is not None else []
            kind = values[0].kind if values else "none"
        self.made.returns = joined(self.made.returns, kind)
        self.give(values)

    def give(self, values: Sequence[Value]) -> None:
        """End the function with its returned values."""

    def on_If(self, node: ast.If) -> None:
        """Translate an if statement. If the condition is known, only the branch that runs is translated."""
        test = self.value(node.test)
        if test.is_known:
            self.block(node.body if test.known else node.orelse)
            return
        self.branch(test, node.body, node.orelse)

    def branch(self, test: Value, body: Sequence[ast.stmt], otherwise: Sequence[ast.stmt]) -> None:
        """Statements under a condition, and others without it."""
        self.block(body)
        self.block(otherwise)

    def on_While(self, node: ast.While) -> None:
        """A loop with a condition."""
        self.again()
        test = self.value(node.test)
        if node.orelse:
            self.refuse(node)
        if test.is_known and not test.known:
            return
        self.repeat(test, node.body)

    def again(self) -> None:
        """The place before the condition of a loop."""

    def repeat(self, test: Value, body: Sequence[ast.stmt]) -> None:
        """Statements as long as a condition holds."""
        self.block(body)

    def on_For(self, node: ast.For) -> None:
        """A loop over a range, or over a few numbers that are known."""
        if node.orelse or not isinstance(node.target, ast.Name):
            self.refuse(node)
        self.count += 1
        name = f"unused_{self.count}" if node.target.id == "_" else node.target.id
        if name in self.names or any(name in names_set(each) for each in node.body):
            self.refuse(node, f"`{name}` is changed inside its loop")
        if isinstance(node.iter, ast.Tuple):
            values = [self.value(each) for each in node.iter.elts]
            if not all(value.is_known for value in values):
                self.refuse(node.iter)
            self.enter(name, values[0].kind)
            self.each(name, values, node.body)
            self.leave(name)
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
        self.through(name, (first, last, step.known), node.body)
        self.leave(name)

    def through(self, name: str, bounds: tuple[Value, Value, int], body: Sequence[ast.stmt]) -> None:
        """Statements for every number of a range: its first, the one behind its last, and 1 or -1."""
        self.block(body)

    def each(self, name: str, values: Sequence[Value], body: Sequence[ast.stmt]) -> None:
        """Statements for each of a few numbers that are known."""
        self.block(body)

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
            self.store(target, self.value(node.value))
            return
        if isinstance(node.value, ast.Tuple):
            values = [self.value(each) for each in node.value.elts]
            if all(value.is_known for value in values) or self.apart(target, node.value):
                for each, value in zip(target.elts, values, strict=True):
                    self.store(each, value)
                return
            self.at_once(target.elts, values)
            return
        value = self.value(node.value)
        if isinstance(value.kind, tuple):
            self.taken_apart(target.elts, value)
        elif value.kind is not None:
            self.refuse(node)

    def at_once(self, targets: Sequence[ast.expr], values: Sequence[Value]) -> None:
        """Assign several values to several places. A value may read a place that the same statement assigns."""
        for each, value in zip(targets, values, strict=True):
            self.store(each, value)

    def taken_apart(self, targets: Sequence[ast.expr], value: Value) -> None:
        """Set several places to the entries of a tuple."""
        for i, (each, kind) in enumerate(zip(targets, value.kind, strict=True)):
            if not (isinstance(each, ast.Name) and each.id == "_"):
                self.store(each, self.said("of_tuple", kind, value, i))

    def apart(self, target: ast.Tuple, values: ast.Tuple) -> bool:
        """Return whether the variables may be assigned one after another: no later value reads an earlier variable."""
        names = [each.id for each in target.elts if isinstance(each, ast.Name)]
        if len(names) < len(target.elts):
            return False
        later = [(i, each) for i, value in enumerate(values.elts) for each in ast.walk(value)]
        return not any(isinstance(each, ast.Name) and each.id in names[:i] for i, each in later)

    def store(self, target: ast.expr, value: Value) -> None:
        """Set a variable or an entry."""
        if isinstance(target, ast.Name):
            name = target.id
            if name in self.loops or (isinstance(self.kind_of(name), Arrays) or self.kind_of(name) == "none"):
                self.refuse(target, f"`{name}` may not be set")
            if name in self.names:
                self.names[name] = Value("", joined(self.names[name].kind, value.kind))
                if self.names[name].kind != self.made.arguments[[a.arg for a in self.made.tree.args.args].index(name)].kind:
                    self.refuse(target, f"`{name}` changes its type")
            else:
                if value.kind == "none" or isinstance(value.kind, tuple):
                    self.refuse(target)
                self.made.local[name] = joined(self.made.local.get(name), value.kind)
            self.set(name, value)
            return
        if not isinstance(target, ast.Subscript):
            self.refuse(target)
        whole = self.value(target.value)
        if not isinstance(whole.kind, Array) or isinstance(target.slice, ast.Slice):
            self.refuse(target)
        indices = self.indices(target)
        if len(indices) < len(whole.kind.shape):
            self.refuse(target)
        if whole.field in self.t.constant or self.fixed(whole, indices) is not None:
            self.refuse(target, f"`{ast.unparse(target)}` never changes")
        self.put(whole, indices, value)

    def set(self, name: str, value: Value) -> None:
        """Set a variable."""

    def put(self, whole: Value, indices: Sequence[Value], value: Value) -> None:
        """Set an entry of an array."""

    def on_AugAssign(self, node: ast.AugAssign) -> None:
        """Translate an augmented assignment, such as `x += 1`."""
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
