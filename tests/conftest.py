"""What all tests share: figures without a screen, and the catalogue of a checkout that is not installed."""

import functools
import os
import shutil
import sys
import tempfile
import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parents[1]

settings.register_profile("quiet", deadline=None)  # the first example of a test may compile
settings.register_profile("quick", deadline=None, derandomize=True, database=None)
settings.load_profile("quiet")


def pytest_addoption(parser):
    words = "campaigns of faults, kills and interrupts in full, which take hours; without it a sample of each"
    parser.addoption("--exhaustive", action="store_true", help=words)
    parser.addoption(
        "--users-code", action="store_true", help="quick tests of models in the code that users have, which takes longer to make"
    )


def pytest_configure(config):
    os.environ["MPLBACKEND"] = "Agg"
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of workers and programs that tests start: see `toolbox.sweeps.executors.Workers`
    try:
        distribution("stickslip-toolbox")
    except PackageNotFoundError:
        config.stickslip_metadata = _registered()
    if config.option.markexpr == "not slow":  # the quick suite draws the same every time
        settings.load_profile("quick")
    if not config.pluginmanager.has_plugin("stickslip_pytest"):  # an installation registers it
        config.pluginmanager.import_plugin("stickslip_pytest")
    _refuse_former_column_heads()
    if not config.getoption("numprocesses", None):  # tests run in this process, not in others that it starts
        quick = config.option.markexpr == "not slow" and not config.option.users_code
        _keep_code_apart(quick)
        if quick:
            _compile_quickly()


def _refuse_former_column_heads():
    """Let every test fail that prints or writes a table in which a column has a former name (`toolbox.vocabulary`)."""
    from toolbox.files import printing, tables  # before any module takes their functions
    from toolbox.vocabulary import NOW

    former = {old: now for (place, old), now in NOW.items() if place == "column"}

    def checked(function, heads_of):
        @functools.wraps(function)
        def refusing(*args, **kwargs):
            for word in heads_of(*args):
                assert word not in former, f"the column `{word}` is now `{former[word]}`"
            return function(*args, **kwargs)

        return refusing

    # a list of fields (`left` is a range) has no heads
    printing.columns = checked(printing.columns, lambda rows, left=(0,), *_: rows[0] if rows and not isinstance(left, range) else ())
    printing._grid = checked(printing._grid, lambda headings, *_: headings)
    tables.write = checked(tables.write, lambda path, headings, *_: [word.split(" [")[0] for word in headings])


def _keep_code_apart(quick):
    """Keep the code of the quick suite, and that of all others of one version of LLVM, in a folder of its own.

    A folder keeps 4096 files. The slow suite and the two samples of `.ci/run`, which are of other versions, shared that of the user: the samples threw out
    what the slow suite had made, so that it compiled everything again each time.
    """
    import llvmlite

    from toolbox.compilation.kept_code import cache_directory

    os.environ["STICKSLIP_CACHE_DIR"] = str(cache_directory() / ("quick" if quick else f"tests-{llvmlite.__version__}"))


def _compile_quickly():
    """The code of every model is generated in the hurry in which users have that of large ones: the same arithmetic, to the last bit, which runs half as fast.

    Nearly half of the time of most rooms was compiling models, and two thirds of that the search for registers and for the order of instructions. The slow
    tests, those with `--users-code` and those that are run without `-m "not slow"` have the code of users; this code is kept apart. The C of an FMU, whose
    compilation was two thirds of the time of the tests of FMUs, is not optimised either.
    """
    import llvmlite.binding as llvm

    from toolbox.compilation import emitter
    from toolbox.export import fmu_archive

    llvm.set_option("tests", "-fast-isel=false")  # else products and sums are not fused, which changes their last bits
    object_code = emitter.object_code

    def hurried(text, processor, large=False, side_by_side=False):
        return object_code(text, processor, True, side_by_side)

    emitter.object_code = hurried
    fmu_archive.OPTIMISED = "-O0"


def pytest_unconfigure(config):
    folder = getattr(config, "stickslip_metadata", None)
    if folder is not None:
        shutil.rmtree(folder, ignore_errors=True)


def _registered():
    """A folder on the search path with the metadata that an installation would have written."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    folder = Path(tempfile.mkdtemp(prefix="stickslip-metadata-"))
    info = folder / "stickslip_toolbox-0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    points = [f"{name} = {module}" for name, module in project["entry-points"]["stickslip.parts"].items()]
    (info / "entry_points.txt").write_text("\n".join(["[stickslip.parts]", *points, ""]))
    sys.path.insert(0, str(folder))
    os.environ["PYTHONPATH"] = os.pathsep.join([str(folder), str(ROOT), os.environ.get("PYTHONPATH", "")])
    return folder


@pytest.fixture
def exhaustive(request):
    """Whether campaigns run in full."""
    return request.config.getoption("--exhaustive")


@pytest.fixture
def root():
    """The folder of the project."""
    return ROOT


@pytest.fixture(autouse=True)
def closed_figures():
    """No figure stays open behind a test: of more than twenty matplotlib warns, in whichever test happens to open the next."""
    yield
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")


@pytest.fixture
def empty(tmp_path, monkeypatch):
    """A machine without any compiled code, kept or shipped, and the folder where it would be."""
    from toolbox.translation import compiled

    monkeypatch.setenv("STICKSLIP_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(compiled, "SHIPPED", tmp_path / "objects")
    return tmp_path


@pytest.fixture(scope="session", autouse=True)
def event_loop():
    """The event loop and the reader of measures, compiled once per machine outside the time of any test, and what is said of it."""
    from models import BlockOnBelt
    from toolbox import compose, simulate, sweep
    from toolbox.measure import severity

    plant = compose(BlockOnBelt())
    severity(simulate(plant, 10.0), "block.speed")
    sweep(plant, {"block.mass": [1.0, 2.0]}, duration=1.0)
