"""What an installation brings: data and type marks in the wheel, everything that the tests need in the sdist, and one version wherever it stands."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from toolbox.errors import check_version

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES = ("toolbox", "models", "controllers")


def sources(*folders: str) -> set[str]:
    """Files of these folders that a checkout has, without what running leaves."""
    found = (path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file())
    return {path.relative_to(ROOT).as_posix() for path in found if "__pycache__" not in path.parts}


@pytest.fixture(scope="module")
def built():
    """The files that hatchling would put into the wheel and into the sdist, beside README and LICENSE, which it adds by itself; nothing is built."""
    sdist = pytest.importorskip("hatchling.builders.sdist").SdistBuilder
    wheel = pytest.importorskip("hatchling.builders.wheel").WheelBuilder
    return [{each.distribution_path for each in kind(str(ROOT)).recurse_included_files()} for kind in (wheel, sdist)]


def test_the_wheel_has_every_module_and_all_data(built):
    wheel, _ = built
    assert sources(*PACKAGES) | {"stickslip.py", "stickslip_pytest.py"} == wheel
    assert {f"{package}/py.typed" for package in PACKAGES} <= wheel
    assert (
        {path for path in wheel if path.endswith(".csv")}
        == {f"models/tables/{path.name}" for path in (ROOT / "models" / "tables").glob("*.csv")}
        != set()
    )


def test_the_sdist_has_what_the_tests_and_the_pages_need(built):
    _, sdist = built
    needed = {
        "SECURITY.md",
        "CODE_OF_CONDUCT.md",
        ".ci/constraints.txt",
        ".github/workflows/tests.yml",
        "CHANGELOG.md",
        "CITATION.cff",
        "mkdocs.yml",
        "docs/index.md",
        "studies/scenes/jansen_2.toml",
        "tests/conftest.py",
        ".ci/run",
    }
    assert needed <= sdist and sources(*PACKAGES) <= sdist
    assert {path for path in sources("studies") if path.endswith((".py", ".toml", ".npz", ".ipynb"))} <= sdist


def test_modules_that_stand_beside_each_other_import_their_data_where_it_is_installed():
    from importlib.resources import files

    tables = files("models") / "tables"
    assert {entry.name for entry in tables.iterdir()} == {path.name for path in (ROOT / "models" / "tables").iterdir()}


def test_one_version_licence_and_name_wherever_they_stand():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    said = dict(re.findall(r"^(\w[\w-]*): (.+)$", citation, re.MULTILINE))
    project = PROJECT["project"]
    assert (said["title"], said["version"]) == (project["name"], project["version"])
    assert f"- name: {project['authors'][0]['name']}" in citation
    assert f"\n## {project['version']}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert said["license"] == "BSD-3-Clause" and "BSD 3-Clause" in (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert set(re.findall(r"^  - (?!name|type)(.+)$", citation, re.MULTILINE)) == set(project["keywords"])


def test_the_workflow_runs_the_commands_of_the_local_checks_on_every_version_and_system():
    workflow, local = ((ROOT / path).read_text(encoding="utf-8") for path in (".github/workflows/tests.yml", ".ci/run"))
    commands = re.findall(r"^ +(?:- )?run: (\w.+)$", workflow, re.MULTILINE)
    own = {"pip wheel --no-build-isolation --no-deps -w wheels ."}
    assert set(commands) - own == {
        "pip install -q -e '.[dev]'",
        "python -m pytest -n auto -m 'not slow'",
        "ruff check .",
        "ruff format --check .",
        "mypy",
    }
    for command in set(commands) - own:
        assert f".venv/bin/{command}" in local, f"`.ci/run` does not say `{command}`"
    least = PROJECT["project"]["requires-python"].removeprefix(">=")
    versions = re.findall(r'"(3\.\d+)"', re.search(r"python: \[(.+)\]", workflow)[1])
    assert versions[0] == least and versions == [f"3.{minor}" for minor in range(11, 16)]
    assert {"ubuntu", "macos", "windows"} == {system.partition("-")[0] for system in re.search(r" os: \[(.+?)\]", workflow)[1].split(", ")}


def test_the_constraints_of_developers_fit_what_is_declared():
    """Each package that is declared has a version there that is not below the declared one."""
    constraints = dict(re.findall(r"^([\w.-]+)==([\d.]+)", (ROOT / ".ci" / "constraints.txt").read_text(encoding="utf-8"), re.MULTILINE))
    extras = PROJECT["project"]["optional-dependencies"]
    for line in [*PROJECT["project"]["dependencies"], *extras["dev"], *extras["docs"]]:
        name, least = re.match(r"([\w-]+)(?:\[.*\])?>=([\d.]+)", line).groups()
        found = constraints[name.replace("_", "-")]
        assert tuple(map(int, found.split("."))) >= tuple(map(int, least.split("."))), f"{line}, but the constraints have {found}"


def test_a_package_that_is_too_old_says_which_version_works(monkeypatch):
    monkeypatch.setattr("importlib.metadata.requires", lambda name: ["numpy>=2.0", "pint>=0.24"])
    for installed, fits in (("0.23.2", False), ("0.24.0", True), ("0.24.0rc1", True), ("1.0", True)):
        monkeypatch.setattr("importlib.metadata.version", lambda name, given=installed: given)
        if fits:
            assert check_version("pint") is None
        else:
            with pytest.raises(ImportError, match=r"^pint 0.23.2 does not work with the toolbox: pip install 'pint>=0.24'.$"):
                check_version("pint")
