"""Machine code that is kept is that of the text as it stands, whatever file was edited and whatever was upgraded."""

from __future__ import annotations

import ast
import importlib
import inspect
import linecache
import os
import pkgutil
import subprocess
import sys
import textwrap

import llvmlite
import pytest

import controllers
import models
import studies
import toolbox
from controllers import condensing
from toolbox.compilation.stamps import followed, read_outside, stamp_of
from toolbox.lanes import loop as lanes_loop
from toolbox.translation import compiled
from toolbox.translation.compiled import KEPT, Compiled
from toolbox.translation.shipped import compiled_loops

FILES = {
    "loops_a": """
        from toolbox.translation.compiled import Compiled
        import loops_b
        from loops_b import FACTOR, helped

        def _result(x):
            "Words that say nothing to the machine."
            return 1000.0 * helped(x) + 100.0 * loops_b.OFFSET + 10.0 * FACTOR

        result = Compiled(_result, "f", gives="f")
    """,
    "loops_b": """
        from loops_c import deepest

        FACTOR = 2
        OFFSET = 3.0

        def helped(x):
            return x * deepest(x)
    """,
    "loops_c": """
        def deepest(x):
            return x * 0.5
    """,
}


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of three files, whose function is called in a process as good as new: (write a file anew, call)."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("STICKSLIP_CACHE_DIR", str(tmp_path / "cache"))
    times = {}

    def write(name, old="", new=""):
        texts[name] = texts[name].replace(old, new) if old else texts[name]
        path = tmp_path / f"{name}.py"
        path.write_text(inspect.cleandoc(texts[name]))
        os.utime(path, ns=times.setdefault(name, (path.stat().st_atime_ns, path.stat().st_mtime_ns)))

    def called():
        for name in FILES:
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        linecache.clearcache()
        loop = importlib.import_module("loops_a").result
        return loop.known(), loop(2.0)

    texts = dict(FILES)
    for name in FILES:
        write(name)
    yield write, called, tmp_path
    for name in FILES:
        sys.modules.pop(name, None)


FIRST = 1000.0 * 2.0 + 300.0 + 20.0


def test_code_of_an_unchanged_text_is_loaded_and_that_of_new_comments_and_words_too(package):
    write, called, _ = package
    assert called() == (False, FIRST)
    assert called() == (True, FIRST)
    write("loops_b", "FACTOR = 2", "# a word\n        FACTOR = 2")
    write("loops_a", "Words that say nothing", "Other words, which say nothing")
    assert called() == (True, FIRST)


@pytest.mark.parametrize(
    ("name", "old", "new", "value"),
    [
        ("loops_c", "x * 0.5", "x * 1.5", FIRST + 4000.0),  # called by a function of another file that is called
        ("loops_b", "FACTOR = 2", "FACTOR = 3", FIRST + 10.0),  # a constant of another file
        ("loops_b", "OFFSET = 3.0", "OFFSET = 4.0", FIRST + 100.0),  # one that is read through its module
        ("loops_a", "1000.0", "2000.0", FIRST + 2000.0),
    ],
)
def test_an_edit_of_whatever_is_called_or_read_is_compiled_even_with_size_and_time_of_the_file_as_before(package, name, old, new, value):
    write, called, _ = package
    assert called() == (False, FIRST)
    write(name, old, new)
    assert called() == (False, value)
    assert called() == (True, value)


def test_another_version_of_the_compiler_compiles_anew(package, monkeypatch):
    _, called, _ = package
    assert called() == (False, FIRST)
    monkeypatch.setattr(llvmlite, "__version__", "0.0.1")
    compiled.machine.cache_clear()
    assert called() == (False, FIRST)
    monkeypatch.undo()
    compiled.machine.cache_clear()


def test_files_of_earlier_texts_go(package):
    write, called, folder = package
    called()
    (path,) = folder.rglob("loops_a*.o")
    for factor in range(1, KEPT + 1):  # those of the last texts stay: another installation may have them
        write("loops_a", f"{factor}000.0", f"{factor + 1}000.0")
        called()
        assert path.exists() == (factor < KEPT)
    assert len(list(folder.rglob("loops_a*.o"))) == KEPT


def test_a_value_that_cannot_be_told_from_another_is_refused():
    def reading(x):
        return x * FILES["x"]

    with pytest.raises(TypeError, match="`test_a_value.*reading` must read constants and functions only, but `FILES` holds a dict"):
        stamp_of(reading)


PACKAGES = (toolbox, models, controllers, studies)


def own(thing):
    """The Python function behind a compiled one of these packages, or None."""
    plain = getattr(thing, "py_func", thing)
    packages = [package.__name__ for package in PACKAGES]
    return plain if inspect.isfunction(plain) and plain.__module__.partition(".")[0] in packages else None


def compiled_functions():
    """{name: function} of all that is compiled, found by importing every module."""
    found = {}
    for package in PACKAGES:
        for entry in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if entry.name.endswith("__main__"):
                continue
            module = importlib.import_module(entry.name)
            for name, value in vars(module).items():
                if isinstance(value, Compiled) and value.py_func.__module__ == entry.name:
                    found[f"{entry.name}.{name}"] = value
    return found


def words_of(plain):
    """Names that the text of a function uses as they stand, and (name, attribute) pairs."""
    (function,) = ast.parse(textwrap.dedent(inspect.getsource(plain))).body
    nodes = [node for line in function.body for node in ast.walk(line)]
    names = {node.id for node in nodes if isinstance(node, ast.Name)}
    pairs = {(node.value.id, node.attr) for node in nodes if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)}
    return names, pairs


def called_by_text(function):
    """Functions that the text of one leads to, and the names that each reads from its module: as a reader would follow them."""
    found, waiting = {}, [own(function)]
    while waiting:
        plain = waiting.pop()
        if plain in found:
            continue
        names, pairs = words_of(plain)
        space = vars(sys.modules[plain.__module__])
        values = {name: space[name] for name in names if name in space and name != plain.__name__}
        values |= {
            f"{name}.{word}": getattr(space[name], word)
            for name, word in pairs
            if inspect.ismodule(space.get(name)) and space[name].__name__.partition(".")[0] in {package.__name__ for package in PACKAGES}
        }
        found[plain] = values
        waiting += [own(value) for value in values.values() if own(value)]
    return found


def test_every_cached_function_is_kept_under_all_that_it_calls_and_reads_in_every_file():
    kept = compiled_functions()
    assert len(kept) >= 15 and {name.split(".")[0] for name in kept} >= {"toolbox", "controllers"}
    for name, function in kept.items():
        by_text = called_by_text(function)
        plain = {own(each) for each in followed(function)}
        missing = {each.__code__.co_filename for each in by_text} - {each.__code__.co_filename for each in plain}
        assert not missing, f"{name} is kept without {missing}"
        assert not set(by_text) - plain, f"{name} is kept without {set(by_text) - plain}"
        for each, values in by_text.items():
            seen = {word for word, _ in read_outside(each)}
            unseen = {word for word, value in values.items() if not inspect.ismodule(value) and word not in seen}
            assert not unseen, f"{name} is kept without `{unseen}`, which `{each.__qualname__}` reads"


def test_loops_of_several_files_follow_all_of_them():
    def files(function):
        return {own(each).__module__ for each in followed(function)}

    assert files(condensing.regulated) >= {"controllers.condensing", "toolbox.prediction.rollout_loop"}
    assert files(lanes_loop.run) >= {"toolbox.lanes.loop", "toolbox.measuring.stay_loop"} and len(files(lanes_loop.run)) >= 3
    assert {loop.py_func.__module__ for loop in compiled_loops()} >= {"controllers.condensing", "toolbox.lanes.loop"}


def test_without_a_folder_that_can_be_written_loops_work():
    code = "from toolbox.stepping.noise import normal\nimport numpy as np\nprint(normal.known(), normal(np.uint64(3), 4) < 9.0, normal.known())\n"
    nowhere = {**os.environ, "STICKSLIP_CACHE_DIR": f"{os.devnull}/cache"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=nowhere)
    assert done.stdout.split() == ["False", "True", "True"], done.stderr
