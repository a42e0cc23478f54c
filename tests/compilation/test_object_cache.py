"""Machine code of models: kept where the user has a place for it, and small in memory."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import pytest

from models import BlockOnBelt
from toolbox import compose, simulate
from toolbox import time as t
from toolbox.compilation.kept_code import cache_directory


def test_a_user_without_a_home_simulates_and_keeps_nothing(monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    for name in ("STICKSLIP_CACHE_DIR", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    run = simulate(compose(BlockOnBelt()), 1.0, inputs={"block.force": 0.123 * ca.sin(1.357 * t)})
    assert run.end == 1.0
    with pytest.raises(OSError):
        (cache_directory() / "objects").mkdir(parents=True)
