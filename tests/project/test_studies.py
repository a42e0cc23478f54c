"""The command that lists the studies and runs one."""

import subprocess
import sys


def command(root, *arguments):
    return subprocess.run([sys.executable, "-m", "studies", *arguments], capture_output=True, text=True, cwd=root, timeout=60)


def test_every_study_that_can_be_run_is_listed_with_its_question(root):
    listed = command(root).stdout
    for room in ("questions", "benchmarks"):
        for path in (root / "studies" / room).glob("[a-z]*.py"):
            assert (f"  {path.stem} " in listed) == ('__name__ == "__main__"' in path.read_text())


def test_a_study_is_run_by_its_name_with_its_own_arguments(root):
    done = command(root, "drives", "--help")
    assert done.returncode == 0 and "usage: python -m studies drives" in done.stdout


def test_help_of_a_study_without_options_is_its_text_and_runs_nothing(root):
    done = command(root, "maps", "--help")
    assert (
        done.returncode == 0
        and done.stdout.startswith("Where in a plane of two numbers")
        and "python -m studies maps [FOLDER]" in done.stdout
    )


def test_an_unknown_study_is_refused_with_the_nearest_name(root):
    done = command(root, "drive")
    assert done.returncode == 2 and done.stderr == "There is no study 'drive': did you mean 'drives'?\n"
