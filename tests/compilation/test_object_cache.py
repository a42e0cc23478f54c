"""Machine code of models: kept where the user has a place for it, and small in memory."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path

import casadi as ca
import pytest

from models import BlockOnBelt
from toolbox import compose, simulate
from toolbox import time as t
from toolbox.compilation import kept_code
from toolbox.compilation.kept_code import cache_directory, keep, kept

posix = pytest.mark.skipif(os.name != "posix", reason="owners and modes are those of POSIX")
root_only = pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="only root can give files away")


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


@pytest.fixture
def untold(monkeypatch):
    monkeypatch.setattr(kept_code, "_TOLD", [])


@posix
def test_the_folders_of_machine_code_are_their_users_alone(tmp_path):
    before = os.umask(0)
    try:
        assert keep(tmp_path / "a" / "b" / "one.o", b"code")
    finally:
        os.umask(before)
    assert [(tmp_path / name).stat().st_mode & 0o777 for name in ("a", "a/b")] == [0o700, 0o700]
    assert kept(tmp_path / "a" / "b" / "one.o") == b"code"


@posix
@pytest.mark.parametrize("mode", [0o777, 0o702, 0o1777], ids=["all write", "others write", "sticky"])
@pytest.mark.parametrize("part", ["a", "a/b"])
def test_code_is_taken_and_kept_only_where_others_cannot_put_it(tmp_path, untold, caplog, mode, part):
    path = tmp_path / "a" / "b" / "one.o"
    assert keep(path, b"code")
    (tmp_path / part).chmod(mode)
    safe = mode == 0o1777  # as /tmp: nobody moves what is another's
    with caplog.at_level(logging.WARNING, logger="stickslip"):
        for _ in range(3):
            assert (kept(path) == b"code") == safe
            assert keep(path, b"code") == safe
    assert len(caplog.messages) == (0 if safe else 1)
    assert safe or (str(tmp_path / part) in caplog.text and "STICKSLIP_CACHE_DIR" in caplog.text)


@root_only
@pytest.mark.parametrize("part", ["a", "a/b", "a/b/one.o"])
def test_code_of_another_user_is_not_taken(tmp_path, untold, part):
    path = tmp_path / "a" / "b" / "one.o"
    assert keep(path, b"code") and kept(path) == b"code"
    os.chown(tmp_path / part, 12_345, 12_345)
    assert kept(path) is None


@posix
def test_a_link_to_a_folder_in_which_others_write_is_followed_before_it_is_trusted(tmp_path, untold):
    (tmp_path / "open" / "loops").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "open" / "loops")
    assert keep(tmp_path / "link" / "one.o", b"code")
    (tmp_path / "open").chmod(0o777)
    assert kept(tmp_path / "link" / "one.o") is None


@posix
def test_a_planted_file_in_an_open_folder_is_not_run(tmp_path, root):
    """A loop doubles; what is planted as its machine code is that of another one, which trebles."""
    for name, factor in (("loops_two", 2.0), ("loops_three", 3.0)):
        (tmp_path / f"{name}.py").write_text(
            "from toolbox.translation.compiled import Compiled\n"
            f"def times(x): return {factor} * x\n"
            'loop = Compiled(times, "f", gives="f")\n'
            "print(loop.known(), loop(2.0))\n"
        )

    def answer(name):
        paths = os.pathsep.join([str(tmp_path), str(root), os.environ.get("PYTHONPATH", "")])
        environment = {**os.environ, "STICKSLIP_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": paths}
        return subprocess.run(
            [sys.executable, "-c", f"import logging; logging.basicConfig(); import {name}"], capture_output=True, text=True, env=environment
        )

    for name, known in (("loops_two", "False 4.0"), ("loops_two", "True 4.0"), ("loops_three", "False 6.0")):
        done = answer(name)
        assert done.stdout.strip() == known, done.stderr
    mine, planted = ((tmp_path / "cache" / "loops").glob(f"{name}.*.o") for name in ("loops_two", "loops_three"))
    next(mine).write_bytes(next(planted).read_bytes())
    (tmp_path / "cache").chmod(0o777)
    told = answer("loops_two")
    assert told.stdout.split() == ["False", "4.0"], told.stderr
    assert told.stderr.count("is not kept in") == 1
    (tmp_path / "cache").chmod(0o700)  # the twin: where the user alone can have put it, it is taken
    assert answer("loops_two").stdout.split() == ["True", "6.0"]
