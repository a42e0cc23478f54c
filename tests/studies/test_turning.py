"""The benchmark of the page: it counts every key once, and no answer is painted before its key."""

import re
import shutil

import pytest

from studies.benchmarks import turning

pytest.importorskip("playwright.sync_api", reason="the page is timed in a browser by playwright, pip install 'stickslip-toolbox[browser]'")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium on the path")
def test_every_key_is_timed_once(capsys, monkeypatch):
    counted = []
    painted = turning.painted
    monkeypatch.setattr(turning, "painted", lambda *given: counted.append(painted(*given)) or counted[-1])
    turning.main([str(turning.SCENES / "block_on_belt.toml"), "--presses", "3"])
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == len(counted) + 2 and all(len(times) == 3 and min(times) > 0.0 for times in counted)
    assert re.match(r"block_on_belt, .+ \d+ +\d+ +\d+ +\d+\.\d$", printed[1])
