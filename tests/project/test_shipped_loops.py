"""A wheel carries the machine code of the loops, an installation of it takes that code, and any other machine code is compiled as in a source tree."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from toolbox.stepping import event_stepper, noise
from toolbox.translation import compiled, shipped
from toolbox.translation.compiled import Compiled

ROOT = Path(__file__).parents[2]


def made_anew(loop):
    return Compiled(loop.py_func, *loop.arguments, gives=loop.gives)


def test_all_loops_are_found_by_their_text():
    found = shipped.compiled_loops()
    assert {event_stepper.advance_plain, event_stepper.advance_series, event_stepper.evaluate, noise.normal} <= set(found) and len(
        found
    ) >= 11


def test_shipped_code_is_taken_where_it_is_of_the_same_text_and_machine_and_undamaged(empty, monkeypatch):
    monkeypatch.setattr(shipped, "compiled_loops", lambda: [noise.normal])
    (path,) = shipped.write(empty / "objects")
    expected = noise.normal(7, 5)
    with monkeypatch.context() as patched:
        patched.setattr(compiled, "object_code", lambda *_: pytest.fail("compiled"))
        assert made_anew(noise.normal)(7, 5) == expected
    compilations = []
    monkeypatch.setattr(compiled, "object_code", lambda *given: compilations.append(1) or pytest.fail("compiled"))
    for path_of_cache in (empty / "cache" / "loops").iterdir():
        path_of_cache.unlink()
    with monkeypatch.context() as patched:
        patched.setattr(compiled, "machine", lambda: "another version of LLVM")
        with pytest.raises(pytest.fail.Exception):
            made_anew(noise.normal)(7, 5)
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    with pytest.raises(pytest.fail.Exception):
        made_anew(noise.normal)(7, 5)
    assert len(compilations) == 2


@pytest.mark.slow
def test_a_wheel_built_beside_the_dependencies_runs_without_compiling_a_loop(tmp_path):
    pytest.importorskip("hatchling")
    build = "from hatchling.build import build_wheel; import sys; print(build_wheel(sys.argv[1]))"
    done = subprocess.run([sys.executable, "-c", build, str(tmp_path)], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.name.split("-")[2:4] == ["py3", "none"] and not wheel.name.endswith("-any.whl")
    objects = [entry for entry in zipfile.ZipFile(wheel).infolist() if entry.filename.startswith("toolbox/translation/objects/")]
    assert len(objects) >= 11 and sum(entry.compress_size for entry in objects) < 5e6
    zipfile.ZipFile(wheel).extractall(tmp_path / "installed")
    run = (
        "import toolbox.translation.compiled as compiled\n"
        "compiled.object_code = None\n"
        "from models import BlockOnBelt\nfrom toolbox import compose, simulate, sweep\nfrom toolbox.measure import severity\n"
        "assert 'installed' in compiled.__file__\n"
        "run = simulate(compose(BlockOnBelt()), 20.0, method='explicit')\nrun.at([1.0])\nseverity(run, 'block.speed')\n"
        "simulate(compose(BlockOnBelt()), 20.0)\n"
    )
    environment = {"PYTHONPATH": str(tmp_path / "installed"), "STICKSLIP_CACHE_DIR": str(tmp_path / "cache"), "PATH": ""}
    done = subprocess.run([sys.executable, "-c", run], cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    assert "compiling" not in done.stderr
