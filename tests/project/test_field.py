"""The language knows no field: what stands below `toolbox.drilling` names no signal of a drill string, a brake or any other shipped machine.

How it is counted: a name of the field is a string `place.quantity` that a file of `models` or `controllers` holds as a whole, such as the `top.torque` that a
string takes or the `brake.force` that a law gives. No string of a file below `drilling`, the pieces of f-strings included, may contain one as a word.
Docstrings and comments do not count: their examples are drill strings, as the tests run them. Names of files are none.
"""

import ast
import re

from tests.project.test_rooms import FLOORS, room

NAME = re.compile(r"(?<![\w.])[a-z_]+\.[a-z_]+(?!\w|\.\w)")
FILES = {"setup.py", "csv", "h", "c", "cpp", "py"}


def strings(path):
    """(line, text) of the strings of a file that are no docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    return [
        (node.lineno, node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone
    ]


def names_of_the_field(root):
    texts = {text for package in ("models", "controllers") for path in (root / package).rglob("*.py") for _, text in strings(path)}
    return {text for text in texts if NAME.fullmatch(text) and text.rpartition(".")[2] not in FILES}


def test_nothing_below_drilling_names_a_signal_of_a_machine(root):
    field = names_of_the_field(root)
    assert {"top.torque", "bit.weight", "brake.force", "pad.normal_force", "disc.speed"} <= field and len(field) > 100
    below = FLOORS[: FLOORS.index("drilling")]
    named = [
        f"{path.relative_to(root)}:{line} names {name}"
        for path in sorted((root / "toolbox").rglob("*.py"))
        if room(path.relative_to(root)) in below
        for line, text in strings(path)
        for name in NAME.findall(text)
        if name in field
    ]
    assert not named, "\n".join(named)
