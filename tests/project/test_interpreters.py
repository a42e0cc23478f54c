"""The interpreters on which the checks of a contribution run: the lowest that the project supports, and the newest of the machine."""

import os
import runpy
import sys

import pytest

pytestmark = pytest.mark.skipif(os.name != "posix", reason="the interpreters are scripts of sh")


@pytest.fixture
def interpreters(root):
    """The functions of the script."""
    return runpy.run_path(str(root / ".ci" / "interpreters.py"))


def machine(folder, path, pyenv=()):
    """Surroundings with interpreters that answer with these words: in PATH {name: answer}, and in pyenv versions."""
    for name, answer in path.items():
        make(folder / "bin" / name, answer)
    for version in pyenv:
        make(folder / "pyenv" / "versions" / version / "bin" / "python3", version)
    return {"PATH": f"{folder / 'missing'}:{folder / 'bin'}", "PYENV_ROOT": str(folder / "pyenv")}


def make(path, answer):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\nexit 127\n" if answer is None else f"#!/bin/sh\necho {answer}\n")
    path.chmod(0o755)


def test_the_newest_is_found_by_its_number_wherever_it_is(interpreters, tmp_path, capsys):
    surroundings = machine(tmp_path, {"python3": "3.11.2", "python3.9": "3.9.1"}, pyenv=["3.9.18", "3.13.0", "3.11.7", "3.10.13"])
    interpreters["main"]("newest", surroundings)
    assert capsys.readouterr().out.strip() == str(tmp_path / "pyenv/versions/3.13.0/bin/python3")
    interpreters["main"]("lowest", surroundings)
    assert capsys.readouterr().out.strip() == str(tmp_path / "pyenv/versions/3.11.7/bin/python3")


def test_what_does_not_answer_and_what_is_no_release_is_passed_over(interpreters, tmp_path, capsys):
    # a shim of a version that is not there ends with 127; a pre-release says nothing; a configuration script is no interpreter
    surroundings = machine(tmp_path, {"python3.15": "''", "python3.14": None, "python3.12": "3.12.1", "python3.14-config": "3.14.0"})
    interpreters["main"]("newest", surroundings)
    assert capsys.readouterr().out.strip() == str(tmp_path / "bin/python3.12")


@pytest.mark.parametrize(
    ("which", "there", "words"),
    [
        ("newest", {"python3": "3.11.9", "python3.10": "3.10.1"}, "a Python newer than 3.11, .* but there are: 3.10.1, 3.11.9."),
        ("lowest", {"python3": "3.13.0"}, "Python 3.11, .* but there are: 3.13.0."),
        ("newest", {}, "but there are: none."),
    ],
)
def test_a_machine_without_one_is_a_failure_in_a_sentence(interpreters, tmp_path, which, there, words):
    with pytest.raises(SystemExit, match=words):
        interpreters["main"](which, machine(tmp_path, there))


def test_an_interpreter_answers_with_its_version_where_it_is_a_release(interpreters, tmp_path):
    found = interpreters["found"]({"PATH": str(make_link(tmp_path, sys.executable))})
    assert list(found) == [tuple(sys.version_info[:3])]


def make_link(folder, target):
    """A folder with a link to an interpreter."""
    (folder / "python3").symlink_to(target)
    return folder
