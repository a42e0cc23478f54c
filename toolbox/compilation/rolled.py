"""Functions of many equal rows as loops: machine code whose size does not grow with the number of rows.

A chain of n inertias, or n contacts that hold each other, is n times the same formula on other states and parameters. The instructions of a casadi function
do not say so: they are one straight line. Here they are cut into cells, values that are used in more than one place or are results, each with the operations
that it alone needs. Cells of one shape that do not wait for each other become one loop, whose operands are read at places that advance evenly, or from a
table of places; cells without companions are written out. Every operation is done on the same operands as in the straight line.

Cells that parameters and modes alone decide, such as the factors of a matrix of inertia, can be computed once for many calls.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

import casadi as ca

from toolbox.compilation.dense_systems import BLOCK, blocks, factor_size
from toolbox.compilation.emitter import Body, operation
from toolbox.compilation.vector_emitter import POLYNOMIALS
from toolbox.modelling.elimination import calls, size_solved

FEWEST = 4
"""Cells of one shape from which they become a loop."""

NUMBERS = ("%t", "%h")
"""Arguments that are numbers."""

FACTOR, SOLVE, PART = -1, -2, -3
"""Operations beside those of casadi: factors of a dense matrix, a solution with them, one entry of it."""


APART = {"!1 = distinct !{}", "!2 = distinct !{!2, !3}", '!3 = !{!"llvm.loop.parallel_accesses", !1}'}
"""Says of a loop that no pass reads what another one writes, which LLVM does not see where places are read from a table: else it is not done on several
cells at once."""


class Node(NamedTuple):
    """A value: an operation on other nodes. Of inputs `args` is (input, place), of a part of a solution (solution, place)."""

    op: int
    args: tuple[int, ...]
    number: float = 0.0


@dataclass
class Group:
    """Cells of equal shape at a level: their roots, and the nodes that they read, in the same order for every cell."""

    level: int
    fixed: bool
    code: tuple
    roots: list[int] = field(default_factory=list)
    reads: list[tuple[int, ...]] = field(default_factory=list)


class Graph:
    """Nodes of an SX function, with dense systems as nodes of their own."""

    def __init__(self, function: ca.Function):
        self.nodes: list[Node] = []
        self.numbers: dict[float, int] = {}
        self.factors: dict[tuple[int, ...], int] = {}
        self.outputs: list[tuple[int, int]] = []
        work: dict[int, int] = {}
        operations = [function.instruction_id(k) for k in range(function.n_instructions())]
        called = calls(function, operations)
        first = [0]
        for i in range(function.n_out()):
            first.append(first[-1] + function.nnz_out(i))
        self.size = first[-1]
        nodes = self.nodes
        for k, op in enumerate(operations):
            if op == ca.OP_CONST:
                work[function.instruction_output(k)[0]] = self.constant(function.instruction_constant(k))
                continue
            args, target = function.instruction_input(k), function.instruction_output(k)
            if op == ca.OP_OUTPUT:
                self.outputs.append((first[target[0]] + target[1], work[args[0]]))
            elif op in (ca.OP_ASSIGN, ca.OP_LIFT):
                work[target[0]] = work[args[0]]
            elif op == ca.OP_CALL:
                work |= zip(target, self._called(called[k], [work[a] for a in args]), strict=True)
            else:
                nodes.append(Node(op, tuple(args) if op == ca.OP_INPUT else tuple([work[a] for a in args])))
                work[target[0]] = len(nodes) - 1

    def _new(self, op: int, args: tuple[int, ...], number: float = 0.0) -> int:
        self.nodes.append(Node(op, args, number))
        return len(self.nodes) - 1

    def constant(self, number: float) -> int:
        """The node of a number."""
        if number not in self.numbers or number == 0.0:  # zero has a sign
            self.numbers[number] = self._new(ca.OP_CONST, (), number)
        return self.numbers[number]

    def _called(self, function: ca.Function, values: Sequence[int]) -> list[int]:
        n, derived = size_solved(function.name())
        assert n, "only dense systems are calls"
        matrix, rest = tuple(values[: n * n]), list(values[n * n :])
        if matrix not in self.factors:
            self.factors[matrix] = self._new(FACTOR, matrix, n)
        solution = self._solved(n, self.factors[matrix], rest[:n])
        if not derived:
            return solution
        slopes, right = rest[n : n + n * n], rest[n + n * n :]
        for i in range(n):
            for j in range(n):
                entry = self.nodes[slopes[i + j * n]]
                if entry.op != ca.OP_CONST or entry.number:
                    right[i] = self._new(ca.OP_SUB, (right[i], self._new(ca.OP_MUL, (slopes[i + j * n], solution[j]))))
        return self._solved(n, self.factors[matrix], right)

    def _solved(self, n: int, factor: int, right: Sequence[int]) -> list[int]:
        solution = self._new(SOLVE, (factor, *right), n)
        return [self._new(PART, (solution, i)) for i in range(n)]


class Rolled:
    """An SX function as loops over cells of one shape.

    function: of the inputs whose arrays `pointers` names, or the number itself for %t and %h;  fixed: inputs that do not change between calls.
    """

    def __init__(self, function: ca.Function, pointers: Sequence[str], fixed: Sequence[int] = ()):
        self.pointers = pointers
        self.graph = Graph(function)
        self.nodes = self.graph.nodes
        self.targets: dict[int, list[int]] = defaultdict(list)
        for place, node in self.graph.outputs:
            self.targets[node].append(place)
        owner = self._owners()
        self.slot: dict[int, int] = {}
        self.groups = self._groups(owner, set(fixed))
        self.size = self._place()

    def is_leaf(self, node: int) -> bool:
        """Return whether a node is read from an array without computation."""
        return self.nodes[node].op in (ca.OP_INPUT, ca.OP_CONST, PART)

    def _owners(self) -> list[int]:
        """The cell of every node: itself, or the one cell that needs it; -1 where nothing does."""
        nodes, shared = self.nodes, -2
        owner = [-1] * len(nodes)
        for place in self.targets:
            owner[place] = place if not self.is_leaf(place) else -1
        for i in reversed(range(len(nodes))):
            node = nodes[i]
            if owner[i] == shared:
                owner[i] = i
            if node.op == PART:
                if owner[i] != -1 or i in self.targets:
                    owner[node.args[0]] = shared
                continue
            if owner[i] == -1 or node.op in (ca.OP_INPUT, ca.OP_CONST):
                continue
            alone = node.op in (FACTOR, SOLVE)
            for a in node.args:
                owner[a] = shared if alone or owner[a] not in (-1, owner[i]) else owner[i]
        return owner

    def _groups(self, owner: list[int], fixed: set[int]) -> list[Group]:
        """Cells by level, in which nothing waits, and shape."""
        nodes, targets = self.nodes, self.targets
        members: dict[int, list[int]] = defaultdict(list)
        level, constant = [0] * len(nodes), [False] * len(nodes)
        found: dict[tuple, Group] = {}
        for i, (op, args, _) in enumerate(nodes):
            if op == ca.OP_INPUT:
                constant[i] = args[0] in fixed
                continue
            if op == ca.OP_CONST:
                constant[i] = True
                continue
            if op == PART:
                level[i], constant[i] = level[args[0]], constant[args[0]]
                continue
            if owner[i] != i:
                if owner[i] != -1:
                    members[owner[i]].append(i)
                continue
            inside = members.pop(i, [])
            inside.append(i)
            code, reads = self._shape(inside)
            level[i] = 1 + max([level[a] for a in reads], default=0)
            constant[i] = bool(fixed) and i not in targets and all(constant[a] for a in reads)
            key = (level[i], constant[i], i in targets, code)
            group = found.get(key)
            if group is None:
                group = found[key] = Group(level[i], constant[i], code)
            group.roots.append(i)
            group.reads.append(reads)
        return sorted(found.values(), key=lambda group: group.level)

    def _shape(self, members: Sequence[int]) -> tuple[tuple, tuple[int, ...]]:
        """(operations in order with operands as numbers from 0 or, of what is read from elsewhere, from -1 down, and the kinds of these; those nodes)."""
        where: dict[int, int] = {}
        outside: list[int] = []
        code: list = []
        for k, node in enumerate(members):
            op, args, _ = self.nodes[node]
            for a in args:
                if a not in where:
                    outside.append(a)
                    where[a] = -len(outside)
            code.append((op, *[where[a] for a in args]))
            where[node] = k
        return (tuple(code), tuple([self.kind(a) for a in outside])), tuple(outside)

    def kind(self, node: int) -> str:
        """Where a node is read: the pointer of an input, a number by its name, "%constant" or "%cell"."""
        op, args, _ = self.nodes[node]
        if op == ca.OP_INPUT:
            return self.pointers[args[0]]
        return "%constant" if op == ca.OP_CONST else "%cell"

    def _place(self) -> int:
        """Give every cell a place in memory, neighbours in a group side by side; returns the size."""
        size = 0
        for group in self.groups:
            op = group.code[0][0][0]
            if op in (FACTOR, SOLVE):
                for root in group.roots:
                    size = -(-size // BLOCK) * BLOCK
                    self.slot[root] = size
                    n = int(self.nodes[root].number)
                    size += factor_size(n) if op == FACTOR else blocks(n) * BLOCK
                continue
            for root in group.roots:
                self.slot[root] = size
                size += 1
        return size

    def at(self, node: int) -> int:
        """Return the index of a read value in its array."""
        entry = self.nodes[node]
        if entry.op == PART:
            return self.slot[entry.args[0]] + entry.args[1]
        return entry.args[1] if entry.op == ca.OP_INPUT else self.slot[node]


POINTERS = ("%t", "%x", "%p", "%m", "%k")
"""Where the arguments (t, x, p, m and, for updates and impacts, k) of a function of a kernel are."""


def rolled_body(name: str, function: ca.Function, offset: int) -> RolledBody:
    """The instructions that evaluate a function of the arguments of every kernel, in loops, and write its values from an offset on."""
    rolled = Rolled(function, POINTERS[: function.n_in()])
    body = RolledBody(name)
    body.write(rolled, body.value(f"alloca [{max(rolled.size, 1)} x double], align 64"), "%y", offset)
    return body


def rolled_slope(rhs: ca.Function) -> tuple[RolledBody, RolledBody, int]:
    """Two functions and the size of an array: the first writes into it, as y, what parameters and modes decide; with it as k the second gives the slopes."""
    rolled = Rolled(rhs, POINTERS[: rhs.n_in()], fixed=(2, 3))
    once, each = RolledBody("once"), RolledBody("slope")
    once.write(rolled, "%y", "", 0, (True,))
    each.write(rolled, "%k", "%y", 0, (False,))
    return once, each, max(rolled.size, 1)


class RolledBody(Body):
    """Text of a function with the instructions of a `Rolled`, in loops."""

    attributes = "nounwind noinline"  # so that a value is the same number wherever the function is called
    pointer = "ptr noalias"  # arrays of their own, so that loops may be done on several cells at once

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name
        self.tables = 0
        self.known: dict[tuple[str, int], str] = {}

    def call(self, name: str, *args: str) -> str:
        """Call a function, or write out its polynomial if it has one. A loop with a call cannot handle several cells at once."""
        return POLYNOMIALS[name](self, *args) if name in POLYNOMIALS else super().call(name, *args)

    def write(self, rolled: Rolled, cells: str, target: str, offset: int, parts: tuple[bool, ...] = (True, False)) -> None:
        """Write the cells and the results, the results from an offset in an array on. `parts` chooses fixed cells, cells that are not
        fixed, or both."""
        self.rolled, self.cells, self.known = rolled, cells, {}
        for group in rolled.groups:
            if group.fixed not in parts:
                continue
            op = group.code[0][0][0]
            if op in (FACTOR, SOLVE):
                for root in group.roots:
                    self._system(root)
            elif len(group.roots) < FEWEST:
                for root, reads in zip(group.roots, group.reads, strict=True):
                    value = self._computed(group.code[0], [self._read(node) for node in reads])
                    self._keep(root, value, target, offset)
            else:
                self._loop(group, target, offset)
        if False in parts:
            leaves = [(node, offset + place) for node, places in rolled.targets.items() if rolled.is_leaf(node) for place in places]
            written = {place for places in rolled.targets.values() for place in places}
            missing = [
                offset + place for place in range(rolled.graph.size) if place not in written
            ]  # results that casadi leaves out are zero
            zero = rolled.graph.constant(0.0)
            leaves += [(zero, place) for place in missing]
            self._copy([node for node, _ in leaves], target, [place for _, place in leaves])

    def _computed(self, code: tuple, values: Sequence[str]) -> str:
        made: list[str] = []
        for op, *where in code:
            made.append(operation(self, op, [made[a] if a >= 0 else values[-1 - a] for a in where]))
        return made[-1]

    def _keep(self, root: int, value: str, target: str, offset: int) -> None:
        place = self.rolled.slot[root]
        self.store(value, self.cells, place)
        self.known["%cell", place] = value
        results = [offset + result for result in self.rolled.targets.get(root, ())]
        self._copy([root] * len(results), target, results)

    def _read(self, node: int) -> str:
        kind = self.rolled.kind(node)
        if kind == "%constant":
            return self.number(self.rolled.nodes[node].number)
        if kind in NUMBERS:
            return kind
        place = self.rolled.at(node)
        if (kind, place) not in self.known:
            self.known[kind, place] = self.load(self.cells if kind == "%cell" else kind, place)
        return self.known[kind, place]

    def _system(self, root: int) -> None:
        """Factors of a dense matrix, or a solution with them, at their place among the cells."""
        node = self.rolled.nodes[root]
        n = int(node.number)
        place = self._pointer(self.cells, self.rolled.slot[root])
        length = blocks(n) * BLOCK
        if node.op == FACTOR:
            self.clear(place, factor_size(n))
            self._gather(node.args, place, [i + j * length for j in range(n) for i in range(n)])
            self.run("dense_factor", ("i64", f"{n}"), ("i64", f"{blocks(n)}"), ("ptr", place))
            return
        self.clear(place, length)
        self._gather(node.args[1:], place, list(range(n)))
        self.run(
            "dense_solve",
            ("i64", f"{n}"),
            ("i64", f"{blocks(n)}"),
            ("ptr", self._pointer(self.cells, self.rolled.slot[node.args[0]])),
            ("ptr", place),
        )

    def _gather(self, nodes: Sequence[int], target: str, places: Sequence[int]) -> None:
        """Copy values that are not zero to places of an array that holds zeros."""
        entries = [self.rolled.nodes[node] for node in nodes]
        kept = [k for k, entry in enumerate(entries) if entry.op != ca.OP_CONST or entry.number]
        self._copy([nodes[k] for k in kept], target, [places[k] for k in kept])

    def _copy(self, nodes: Sequence[int], target: str, places: Sequence[int]) -> None:
        """Copy values to places of an array."""
        kinds: dict[str, list[tuple[int, int]]] = defaultdict(list)
        for node, place in zip(nodes, places, strict=True):
            kinds[self.rolled.kind(node)].append((node, place))
        for kind, pairs in kinds.items():
            if len(pairs) < FEWEST or kind in NUMBERS:
                for node, place in pairs:
                    self.store(self._read(node), target, place)
                continue
            with self._counted(len(pairs)) as label:
                value = self._operand(kind, [node for node, _ in pairs], label)
                self._store_at(value, target, self._index([place for _, place in pairs], label))

    def _pointer(self, pointer: str, place: int) -> str:
        return self.value(f"getelementptr double, ptr {pointer}, i64 {place}")

    def _loop(self, group: Group, target: str, offset: int) -> None:
        count, rolled = len(group.roots), self.rolled
        kinds = group.code[1]
        before = {}
        for k, kind in enumerate(kinds):  # what all cells read is read once
            column = [reads[k] for reads in group.reads]
            if kind in NUMBERS or len({self._same(node) for node in column}) == 1:
                before[k] = self._read(column[0])
        with self._counted(count) as label:
            values = [
                before[k] if k in before else self._operand(kind, [reads[k] for reads in group.reads], label)
                for k, kind in enumerate(kinds)
            ]
            value = self._computed(group.code[0], values)
            self._store_at(value, self.cells, self._index([rolled.slot[root] for root in group.roots], label))
            results = [rolled.targets.get(root, []) for root in group.roots]
            common = min(map(len, results))
            for q in range(common):
                self._store_at(value, target, self._index([offset + result[q] for result in results], label))
        more = [(root, offset + place) for root, result in zip(group.roots, results, strict=True) for place in result[common:]]
        self._copy([root for root, _ in more], target, [place for _, place in more])

    @contextmanager
    def _counted(self, count: int) -> Iterator[str]:
        """A loop whose counter is the label yielded, with an i behind it."""
        label = f"g{self.count}"
        self.count += 1
        self.lines += [f"  br label %{label}a", f"{label}a:", f"  br label %{label}", f"{label}:"]
        self.lines.append(f"  %{label}i = phi i64 [0, %{label}a], [%{label}n, %{label}]")
        first = len(self.lines)
        yield label
        for k in range(first, len(self.lines)):
            if " load " in self.lines[k] or self.lines[k].startswith("  store "):
                self.lines[k] += ", !llvm.access.group !1"
        self.declarations |= APART
        self.lines += [
            f"  %{label}n = add i64 %{label}i, 1",
            f"  %{label}c = icmp ult i64 %{label}n, {count}",
            f"  br i1 %{label}c, label %{label}, label %{label}z, !llvm.loop !2",
            f"{label}z:",
        ]

    def _operand(self, kind: str, nodes: Sequence[int], label: str) -> str:
        """What the cells of a loop read in one place of their formula."""
        if kind == "%constant" and len({self.number(self.rolled.nodes[node].number) for node in nodes}) == 1:
            return self.number(self.rolled.nodes[nodes[0]].number)
        if kind == "%constant":
            return self._load_at(self._table("double", [self.number(self.rolled.nodes[node].number) for node in nodes]), f"%{label}i")
        return self._load_at(self.cells if kind == "%cell" else kind, self._index([self.rolled.at(node) for node in nodes], label))

    def _same(self, node: int) -> object:
        entry = self.rolled.nodes[node]
        return self.number(entry.number) if entry.op == ca.OP_CONST else self.rolled.at(node)

    def _index(self, places: Sequence[int], label: str) -> str:
        """The place of each cell: first + counter * stride where they advance evenly, else from a table."""
        stride = places[1] - places[0]
        if all(b - a == stride for a, b in itertools.pairwise(places)):
            scaled = f"%{label}i" if stride == 1 else self.value(f"mul i64 %{label}i, {stride}")
            return scaled if not places[0] else self.value(f"add i64 {scaled}, {places[0]}")
        place = self.value(f"getelementptr i32, ptr {self._table('i32', [str(p) for p in places])}, i64 %{label}i")
        return self.value(f"zext i32 {self.value(f'load i32, ptr {place}')} to i64")

    def _table(self, kind: str, entries: Sequence[str]) -> str:
        name = f"@{self.name}_{self.tables}"
        self.tables += 1
        self.declarations.add(
            f"{name} = internal constant [{len(entries)} x {kind}] [{', '.join(f'{kind} {e}' for e in entries)}], align 64"
        )
        return name

    def _load_at(self, pointer: str, index: str) -> str:
        return self.value(f"load double, ptr {self.value(f'getelementptr double, ptr {pointer}, i64 {index}')}")

    def _store_at(self, value: str, pointer: str, index: str) -> None:
        target = self.value(f"getelementptr double, ptr {pointer}, i64 {index}")
        self.lines.append(f"  store double {value}, ptr {target}")
