"""What the toolbox says while it works: records of one named logger, and bars where somebody can see them."""

from __future__ import annotations

import io
import subprocess
import sys
import time

import pytest

from controllers import SoftTorque
from models import BitRock, oscillators, wells
from toolbox import closed_loop, compose, hopf_points, margins, messages, onset, sensitivity, severity_map, simulate
from toolbox.commands import listing
from toolbox.commands.command_line import main
from toolbox.messages import progress_bar

SAYS = """
import logging
{before}
from toolbox.messages import LOG
{after}
LOG.debug("detail")
LOG.info("compiling")
LOG.warning("no zarr")
"""
COMMAND = "import toolbox.messages; toolbox.messages.write_log_to_stderr()"
OWN = "logging.basicConfig(format='%(name)s %(levelname)s %(message)s', level='{}')"


@pytest.mark.parametrize(
    ("before", "after", "stderr"),
    [
        ("", "", ""),
        ("", COMMAND, "stickslip: compiling\nstickslip: no zarr\n"),
        ("", f"{COMMAND}; {COMMAND}; logging.getLogger('stickslip').setLevel('WARNING')", "stickslip: no zarr\n"),
        (OWN.format("INFO"), "", "stickslip INFO compiling\nstickslip WARNING no zarr\n"),
        (OWN.format("WARNING"), "", "stickslip WARNING no zarr\n"),
        (OWN.format("INFO"), COMMAND, "stickslip INFO compiling\nstickslip WARNING no zarr\n"),
    ],
    ids=[
        "a library is silent",
        "a command",
        "a quieter command",
        "a program's own handlers",
        "quieter ones",
        "a command in such a program",
    ],
)
def test_records_of_the_logger_are_written_once_and_by_a_command_or_the_program_alone(before, after, stderr):
    done = subprocess.run([sys.executable, "-c", SAYS.format(before=before, after=after)], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", stderr)


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_bar_is_shown_on_a_terminal_and_in_a_notebook_and_nowhere_else(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert progress_bar(10, "work").disable
    monkeypatch.setattr(sys, "stderr", Terminal())
    assert not progress_bar(10, "work").disable
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    shell = type("ZMQInteractiveShell", (), {})()
    monkeypatch.setitem(sys.modules, "IPython", type("IPython", (), {"get_ipython": staticmethod(lambda: shell)}))
    assert not progress_bar(10, "work").disable


def written(stream, longest=60.0):
    """What has been written when something has, or after so many seconds of waiting."""
    end = time.monotonic() + longest
    while not stream.getvalue() and time.monotonic() < end:
        time.sleep(0.02)
    return stream.getvalue()


def test_a_bar_moves_by_one_whether_or_not_somebody_waits_for_its_work():
    told = []
    with progress_bar(10, "runs", disable=False, file=io.StringIO()) as alone:
        alone.update()
    with messages.at_every_step(lambda: told.append("step")), progress_bar(10, "runs", disable=False, file=io.StringIO()) as waited_for:
        waited_for.update()
        waited_for.update(4)
    assert (alone.n, waited_for.n) == (1, 5) and told == ["step", "step"]


def test_silent_work_gives_a_sign_of_life_on_a_terminal(monkeypatch):
    monkeypatch.setattr(messages, "SILENT", 0.05)
    monkeypatch.setattr(sys, "stderr", Terminal())
    with messages.sign_of_life("a search"):
        assert written(sys.stderr) == "stickslip: a search ...\n"
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with messages.sign_of_life("a search"):
        assert not written(sys.stderr, 0.5)


def test_verbs_that_may_take_seconds_give_a_sign_of_life_once_and_on_a_terminal_only(monkeypatch):
    loop = closed_loop(compose(wells.JANSEN_2, BitRock()), SoftTorque(reference=8.0), label="soft torque")
    monkeypatch.setattr(messages, "SILENT", 0.0)
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    run = simulate(loop, 40.0)
    assert terminal.getvalue().count("at work") == 0
    for verb, arguments in ((margins, (loop,)), (hopf_points, (loop, "top.reference", (2.0, 8.0))), (sensitivity, (run, ["bit.weight"]))):
        terminal.truncate(0)
        terminal.seek(0)
        verb(*arguments)
        assert terminal.getvalue() == f"stickslip: {verb.__name__} is at work ...\n"
    terminal.truncate(0)
    terminal.seek(0)
    with messages.sign_of_life("a search"):
        assert written(terminal) == "stickslip: a search ...\n"
        margins(loop)
    assert terminal.getvalue() == "stickslip: a search ...\n"
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    margins(loop)
    assert sys.stderr.getvalue() == ""


def test_a_bar_whose_first_step_comes_late_is_drawn_before_it(monkeypatch):
    monkeypatch.setattr(messages, "SILENT", 0.05)
    monkeypatch.setattr(sys, "stderr", Terminal())
    with messages.sign_of_life("a search"), progress_bar(10, "runs"):
        text = written(sys.stderr)
    assert "runs:   0%" in text and "a search" not in text


def test_a_command_that_is_slow_and_shows_no_bar_says_that_it_is_at_work(monkeypatch):
    monkeypatch.setattr(messages, "SILENT", 0.05)
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    monkeypatch.setattr(listing, "run", lambda given: int(written(terminal) == ""))
    assert main(["list"]) == 0
    assert terminal.getvalue() == "stickslip: list is at work ...\n"


def counted(monkeypatch, module):
    """Labels of the bars that a module makes, with how far each came."""
    seen = []

    class Bar:
        def __init__(self, total, what, **looks):
            self.entry = [what, total, 0]
            seen.append(self.entry)

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

        def update(self, count=1):
            self.entry[2] += count

    monkeypatch.setattr(f"{module}.progress_bar", Bar)
    return seen


def test_an_onset_tells_how_many_runs_it_made(monkeypatch):
    seen = counted(monkeypatch, "toolbox.onsets.onset")
    found = onset(compose(oscillators.THOMSEN_FIDLIN), "block.belt_speed", (0.3, 0.5), num_values=3, tolerance=5e-2)
    assert seen[0][:2] == ["onset", None] and 0 < seen[0][2] <= found.runs


def test_a_map_tells_how_far_its_runs_and_its_borders_are(monkeypatch):
    grid, border = (counted(monkeypatch, f"toolbox.onsets.{module}") for module in ("front", "severity_map"))
    over = {"top.torque": (6e3, 20e3), "bit.weight": (60e3, 110e3)}
    found = severity_map(compose(wells.JANSEN_2, BitRock()), over, shape=(3, 3), halvings=1)
    assert grid[0] == ["map, smooth running", 9, 9] and all(entry[1] == entry[2] for entry in grid)
    assert [entry[0] for entry in border] == ["map, near borders", "map, borders"]
    assert sum(entry[2] for entry in border) > 0 and found.runs > 9
