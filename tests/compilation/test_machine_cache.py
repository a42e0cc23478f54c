"""The cached loops are made anew when a file that they call into changes."""

from __future__ import annotations

from types import ModuleType

from toolbox.compilation.numba_cache import checksum
from toolbox.lanes import loop as lanes_loop
from toolbox.measuring import measuring_loop as tally_loop
from toolbox.simulation import event_loop as loop
from toolbox.simulation import stepping_loop


def module(path, text):
    path.write_text(text)
    found = ModuleType(path.stem)
    found.__file__ = str(path)
    return found


def test_an_edit_of_any_file_changes_the_checksum(tmp_path):
    one, other = module(tmp_path / "one.py", "x = 1\n"), module(tmp_path / "other.py", "y = 1\n")
    before = checksum(one, other)
    assert checksum(one, other) == before >= 0
    module(tmp_path / "other.py", "y = 2\n")
    assert checksum(one, other) != before


def test_loops_that_call_functions_of_other_files_carry_their_checksum():
    for function, files in ((lanes_loop.run, (loop, tally_loop)), (stepping_loop.advance, (loop,))):
        assert checksum(*files) in [cell.cell_contents for cell in function.py_func.__closure__ if isinstance(cell.cell_contents, int)]
