"""The tool that puts deliberate faults into copies of the tree."""

import ast

import pytest

from studies.benchmarks import faults


@pytest.fixture
def tree(tmp_path):
    (tmp_path / "toolbox" / "lanes").mkdir(parents=True)
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "__init__.py").touch()
    (tmp_path / "toolbox" / "lanes" / "step.py").write_text(
        "def half(a, b):\n    if a < b and b:\n        return 0.5 * (a + b)\n    return a\n"
    )
    (tmp_path / "models" / "block.py").write_text("def twice(a):\n    return a\n\n\ndef less(a):\n    return a - 3\n")
    return tmp_path


def test_each_operator_and_number_of_a_line_is_changed_alone():
    text = "def f(a, b):\n    return a - 2 if a <= b or b else a * b\n"
    changed = set()
    for number, begin, end, then in faults.changes(text):
        line = text.splitlines()[number - 1]
        changed.add(line[:begin] + then + line[end:])
        ast.parse(text.replace(line, line[:begin] + then + line[end:]))
    assert changed == {
        "    return a + 2 if a <= b or b else a * b",
        "    return a - 5 if a <= b or b else a * b",
        "    return a - 2 if a > b or b else a * b",
        "    return a - 2 if a <= b and b else a * b",
        "    return a - 2 if a <= b or b else a / b",
    }


def test_a_draw_is_repeated_by_its_seed_and_takes_each_room_in_turn(tree):
    found = faults.drawn([tree], 6, seed=3)
    assert found == faults.drawn([tree], 6, seed=3)
    assert [fault.room for fault in found] == ["lanes", "models"] * 3
    assert not {fault.line for fault in found} & {"return a"}  # it stands twice


def test_a_fault_changes_one_line_where_it_stands_once(tree):
    fault = faults.Fault("models", "models/block.py", "return a - 3", "return a + 3")
    assert fault.put(tree) and "return a + 3" in (tree / "models" / "block.py").read_text()
    assert not fault.put(tree)


def test_the_suite_of_the_room_is_asked_first_and_then_all(tree):
    fault = faults.Fault("models", "models/block.py", "return a - 3", "return a + 3")
    assert faults.caught(fault, tree, 0) == ""
    (tree / "tests" / "models").mkdir(parents=True)
    (tree / "tests" / "models" / "test_block.py").write_text(
        "from models.block import less\n\n\ndef test_less():\n    assert less(5) == 2\n"
    )
    assert faults.caught(fault, tree, 0) == "tests/models/test_block.py::test_less"
    assert "return a - 3" in (tree / "models" / "block.py").read_text()
