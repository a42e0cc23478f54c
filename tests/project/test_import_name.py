"""`import stickslip`: all public names under one import name that no other distribution has."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

import controllers
import models
import stickslip
import toolbox


def test_every_public_name_is_that_of_its_face_and_none_has_two_meanings():
    homes = [
        (name, face) for face in (toolbox, models, controllers) for name in (*face.__all__, *(["time", "__version__"] * (face is toolbox)))
    ]
    assert sorted(name for name, _ in homes) == sorted(dir(stickslip))
    assert stickslip.__all__ == sorted({name for name, _ in homes} - {"time", "__version__"}) and len(stickslip.__all__) == len(homes) - 2
    assert all(getattr(stickslip, name) is getattr(face, name) for name, face in homes)


def test_its_version_is_that_of_the_distribution():
    assert stickslip.__version__ == toolbox.__version__ == importlib.metadata.version("stickslip-toolbox")
    told = subprocess.run([sys.executable, "-m", "toolbox", "--version"], capture_output=True, text=True, check=True, timeout=60)
    assert told.stdout == f"stickslip-toolbox {stickslip.__version__}\n"


@pytest.mark.parametrize(
    ("name", "home"), [("posterior", "toolbox.probability"), ("severity", "toolbox.measure"), ("Kalman", "controllers.observers")]
)
def test_a_name_of_a_room_is_refused_with_the_line_that_imports_it(name, home):
    with pytest.raises(ImportError, match=rf"^`{name}` is in `{home}`: write `from {home} import {name}`\.$"):
        exec(f"from stickslip import {name}")
    with pytest.raises(AttributeError, match=f"module 'stickslip' has no attribute '{name}': `{name}` is in `{home}`"):
        getattr(stickslip, name)
    assert not hasattr(stickslip, name)


@pytest.mark.parametrize(
    ("room", "name", "home"),
    [("robustness", "windows", "toolbox.drilling"), ("tuning", "severity", "toolbox.measure"), ("probability", "simulate", "toolbox")],
)
def test_a_room_refuses_a_name_that_is_public_elsewhere_with_the_line_that_imports_it(room, name, home):
    with pytest.raises(ImportError, match=rf"^`{name}` is in `{home}`: write `from {home} import {name}`\.$"):
        exec(f"from toolbox.{room} import {name}")


def test_rooms_are_there_and_what_does_not_exist_is_not():
    assert stickslip.probability is importlib.import_module("toolbox.probability")
    with pytest.raises(AttributeError, match="module 'stickslip' has no attribute 'nothing'$"):
        stickslip.nothing  # noqa: B018
    with pytest.raises(ImportError, match="cannot import name 'nothing'"):
        exec("from stickslip import nothing")
    with pytest.raises(AttributeError, match="'_nothing'"):
        stickslip._nothing  # noqa: B018


def test_a_star_import_hides_no_module_of_python_and_importing_it_loads_nothing_heavy():
    code = "import sys, stickslip; print('casadi' in sys.modules, 'numpy' in sys.modules); import time"
    code += "; from stickslip import *; print(time.time() > 0, simulate)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60).stdout
    assert done.startswith("False False\nTrue <function simulate")
