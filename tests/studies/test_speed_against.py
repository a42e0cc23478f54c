"""The comparison of this tree with another checkout: whose code is run, and what the table says."""

import os
import re
import sys

import numpy as np
import pytest

from studies.benchmarks.speed import HERE, METHODS, Comparison, main, turn_of

CASES = """
from types import SimpleNamespace
def cases():
    return {"belt": SimpleNamespace(loop=None, duration=1.0)}
"""


def checkout(folder, simulate):
    """A tree with one case, whose `simulate` has this body."""
    for name, text in {
        "toolbox/__init__.py": f"from types import SimpleNamespace\ndef simulate(loop, duration, *, method, accuracy):\n    {simulate}\n",
        "studies/__init__.py": "",
        "studies/benchmarks/__init__.py": "",
        "studies/benchmarks/cases.py": CASES,
    }.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder.resolve()


def test_a_turn_runs_the_packages_of_its_tree_and_leaves_out_the_methods_that_it_has_not(tmp_path):
    tree = checkout(tmp_path, "return SimpleNamespace(events=[method] * {'explicit': 7, 'event': 8}[method])")
    found = turn_of(tree, tmp_path / "code", ["belt", "rig"], 1e-6)
    assert found["tree"] == str(tree)
    assert found["versions"] == f"Python {sys.version.split()[0]}, numpy {np.__version__}"
    assert set(found["rows"]) == {f"belt {method}" for method in METHODS}
    assert found["rows"]["belt explicit"]["switches"] == 7 and found["rows"]["belt event"]["switches"] == 8
    assert found["rows"]["belt taylor"] == {"failure": "KeyError: 'taylor'"}


@pytest.mark.skipif(os.name != "posix", reason="the interpreter is a script of sh")
def test_a_tree_whose_interpreter_runs_other_packages_is_refused(tmp_path):
    own = checkout(tmp_path / "own", "return SimpleNamespace(events=[])")
    python = own / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nPYTHONPATH="{HERE}" exec "{sys.executable}" "$@"\n')
    python.chmod(0o755)
    with pytest.raises(SystemExit, match=re.escape(f"runs the packages of {HERE}")):
        turn_of(own, tmp_path / "code", ["none"], 1e-6)


def test_a_tree_whose_cases_fail_is_named_with_the_failure(tmp_path):
    tree = checkout(tmp_path, "raise ValueError('broken')")
    (tree / "studies/benchmarks/cases.py").write_text("raise RuntimeError('no cases today')")
    with pytest.raises(SystemExit, match="no cases today"):
        turn_of(tree, tmp_path / "code", ["belt"], 1e-6)


def test_a_folder_that_is_no_checkout_is_refused_before_anything_runs(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["--against", str(tmp_path)])
    assert "a checkout of the project" in capsys.readouterr().err


@pytest.mark.parametrize(("factor", "keeps"), [(1.0, True), (0.5, True), (1.029, True), (1.031, False), (2.0, False)])
def test_the_ratios_are_those_of_the_code_whatever_the_load_of_the_machine_does(factor, keeps):
    # in each turn the machine is slower by another factor, the same for both trees; in two of nine turns one tree is hit alone
    load = np.array([1.0, 3.0, 2.0, 1.5, 8.0, 1.2, 1.0, 4.0, 2.5])[:, None]
    theirs = load * np.array([1e-3, 5e-3])
    ours = factor * theirs
    ours[3] *= 5.0
    theirs[6] *= 7.0
    comparison = Comparison(("belt explicit", "rig event"), ours, theirs, ((17, 17), (93, 92)))
    np.testing.assert_allclose(comparison.ratios, factor, rtol=1e-12)
    assert comparison.overall == pytest.approx(factor, rel=1e-12)
    assert comparison.keeps == keeps
    words = str(comparison)
    assert f"This tree is {'within' if keeps else 'not within'} 3 % of the other: {100 * (factor - 1):+.1f} %." in words
    assert "Other switches: rig event." in words and "93 / 92" in words
    assert ("Slower by more than 3 %: no case." in words) == keeps
