"""Whoever waits for a compiler is told so, once."""

from __future__ import annotations

import os
import subprocess
import sys

from models import TorsionalChain
from toolbox import compose, simulate

MODULE = """
from toolbox.translation.compiled import Compiled

def _twice(x):
    return 2.0 * x

twice = Compiled(_twice, "f", gives="f")
"""
PROGRAM = """
import doubling
from toolbox.messages import write_log_to_stderr
from toolbox.compilation.notices import announced

write_log_to_stderr()
print(announced("doubling", doubling.twice), announced("doubling", doubling.twice), doubling.twice(2.0))
"""


def test_a_function_is_said_to_be_compiled_once_per_machine(tmp_path):
    (tmp_path / "doubling.py").write_text(MODULE)
    path = os.pathsep.join([str(tmp_path), os.getcwd(), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "STICKSLIP_CACHE_DIR": str(tmp_path / "cache")}
    seen = []
    for _ in range(2):
        seen.append(subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True))
    assert seen[0].stdout.split() == ["True", "False", "4.0"]
    assert seen[0].stderr == "stickslip: compiling the doubling, once per machine (some seconds) ...\n"
    assert seen[1].stdout.split() == ["False", "False", "4.0"] and seen[1].stderr == ""


def test_long_machine_code_is_announced_before_it_is_written_and_short_is_not(monkeypatch, caplog):
    def chain(n):
        return compose(TorsionalChain(inertia=(1.0,) * n, stiffness=(1.0,) * (n - 1), damping=(0.1,) * (n - 1)))

    caplog.set_level("INFO", logger="stickslip")
    simulate(chain(3), 0.0, method="stiff")
    assert caplog.text == ""
    monkeypatch.setattr("toolbox.compilation.notices.LONG", 50)
    for method in ("stiff", "explicit"):
        simulate(chain(4), 0.0, method=method)
        assert "writing the equations as" in caplog.text
        caplog.clear()
