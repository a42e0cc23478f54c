"""`origin.json` names exactly the files that a command opened, as the system tells it, and that are no part of what is installed."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.commands.test_output import EVERY
from toolbox import Scene, simulate
from toolbox.files.origin import Origin

ROOT = Path(__file__).parents[2]
SCENES = ROOT / "studies" / "scenes"

WATCHED = """
import json, os, sys
seen = {}

def hook(event, arguments):
    if event == "open" and isinstance(arguments[0], (str, bytes)) and not (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR):
        seen[os.path.realpath(os.fsdecode(arguments[0]))] = None

sys.addaudithook(hook)
from toolbox.commands.command_line import main
for line in json.loads(sys.stdin.read()):
    seen.clear()
    code = main(line)
    print("SEEN" + json.dumps([code, list(seen)]), flush=True)
"""

BELT = 'title = "belt"\nduration = 4\n[[plant]]\npart = "BlockOnBelt"\n[[controllers]]\nlabel = "one"\n'


def opened(lines, folder):
    """[(exit code, files that each command line opened for reading)], run one after the other in one process that the system watches."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, "-c", WATCHED], input=json.dumps(lines), capture_output=True, text=True, cwd=folder, env=environment, check=False
    )
    found = [json.loads(line[4:]) for line in done.stdout.splitlines() if line.startswith("SEEN")]
    assert len(found) == len(lines), done.stderr
    return found, done.stderr


def check(lines, folder, written=()):
    """Compare the origins of commands with what the system saw; written: files, beside those of `--out`, that a command keeps for itself."""
    found, errors = opened(lines, folder)
    for line, (code, seen) in zip(lines, found, strict=True):
        assert code == 0, (shlex.join(line), errors)
        out = folder / line[line.index("--out") + 1]
        inputs = {os.path.realpath(folder / path) for origin in out.rglob("origin.json") for path in Origin.read(origin.parent).inputs}
        installed = (
            "/proc/",
            "/sys/",
            "/dev/",
            "/etc/",
            "/usr/",
            sys.base_prefix,
            sys.prefix,
            os.path.realpath(sys.prefix),
            os.path.expanduser("~/."),
        )
        cache = os.environ.get("STICKSLIP_CACHE_DIR") or "/nonexistent"
        own = {
            path
            for path in seen
            if os.path.isfile(path)
            and not path.startswith(
                (*map(str, installed), os.path.realpath(cache), os.path.realpath(out), *(str(folder / name) for name in written))
            )
            and ".part" not in path
            and not (path.startswith(str(ROOT)) and Path(path).parts[len(ROOT.parts)] in ("toolbox", "controllers", ".git", ".venv"))
            and not (path.startswith(str(ROOT)) and path.endswith((".py", ".pyi", ".pyc", ".toml")) and not path.startswith(str(SCENES)))
        }
        assert inputs == own, (shlex.join(line), inputs ^ own)
        assert inputs


@pytest.fixture
def rig(tmp_path):
    """A folder with a scene whose string and survey are tables, a law in Python, and a log of a belt."""
    (tmp_path / "tables").mkdir()
    text = (SCENES / "aarsnes_shor.toml").read_text()
    for kind in ("sections", "survey"):
        (tmp_path / "tables" / f"{kind}.csv").write_bytes((ROOT / "models" / "tables" / f"aarsnes_shor_{kind}.csv").read_bytes())
        text = text.replace(f"../../models/tables/aarsnes_shor_{kind}", f"tables/{kind}")
    (tmp_path / "rig.toml").write_text(text)
    (tmp_path / "belt.toml").write_text(BELT)
    (tmp_path / "parts.py").write_text("from controllers import PI\n\n\nclass Own(PI):\n    pass\n")
    rows = "\n".join(f"{k / 10},{0.2 + 0.01 * (k % 7)}" for k in range(60))
    (tmp_path / "log.csv").write_text(f"time [s],block.speed [m/s]\n{rows}\n")
    return tmp_path


def test_an_origin_names_the_tables_of_string_and_survey_the_log_and_the_law_in_python(rig):
    lines = [
        ["simulate", "rig.toml", "--duration", "0.5 s", "--controller", "published PI", "--out", "one"],
        ["simulate", "belt.toml", "--load", "parts.py", "--out", "two"],
        ["fit", "belt.toml", "log.csv", "--range", "block.mass=0.5:2", "--starts", "1", "--out", "three"],
        ["simulate", str(SCENES / "elastic_face.toml"), "--duration", "1 ms", "--out", "four"],
        ["sweep", "belt.toml", "--range", "block.mass=0.5:2:2", "--metric", "severity", "--out", "five"],
        ["sweep", "belt.toml", "--range", "block.mass=0.5:2:2", "--metric", "severity", "--out", "five"],
        ["compare", "two/01_one.npz", "two/01_one.npz", "--out", "six"],
    ]
    check(lines, rig)
    names = {Path(path).name for path in Origin.read(rig / "one").inputs}
    assert names == {"rig.toml", "sections.csv", "survey.csv"}


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("scene", sorted(path.name for path in SCENES.glob("*.toml")))
def test_an_origin_names_all_files_of_every_shipped_scene(scene, tmp_path):
    check([["simulate", str(SCENES / scene), "--duration", "10 ms", "--out", "out"]], tmp_path)


MACHINE = """
title = "string from a table"
duration = "20 s"
reference = "95 rpm"
[[plant]]
part = "DrillString"
sections = "tables/string.csv"
top_inertia = 2000
drag_rate = 0.1
elements = 2
[[plant]]
part = "BitRock"
[[controllers]]
label = "PI"
law = "StiffPI"
"""


@pytest.fixture(scope="module")
def well(tmp_path_factory):
    """A folder with scenes of a string whose sections are a table, one of them with sampled laws, a log of the machine, and a well that gets deeper."""
    folder = tmp_path_factory.mktemp("well")
    (folder / "tables").mkdir()
    (folder / "tables" / "string.csv").write_bytes((SCENES / "deepening_well.csv").read_bytes())
    (folder / "rig.toml").write_text(MACHINE)
    (folder / "other.toml").write_text(MACHINE.replace("95 rpm", "96 rpm"))
    (folder / "sampled.toml").write_text(MACHINE + 'sample_time = "10 ms"\n[[controllers]]\nlabel = "soft torque"\nlaw = "SoftTorque"\n')
    (folder / "well.toml").write_text((SCENES / "deepening_well.toml").read_text().replace("deepening_well.csv", "tables/string.csv"))
    run = simulate(Scene.load(folder / "rig.toml")["PI"], 20.0, output_times=np.linspace(0.0, 20.0, 201))
    names = {"top.speed": "rad/s", "top.torque": "N m", "bit.speed": "rad/s"}
    heads = ",".join(["time [s]", *(f"{name} [{unit}]" for name, unit in names.items())])
    np.savetxt(
        folder / "steady.csv", [[0.1, 8.5], [0.3, 15.5], [0.6, 26.0]], delimiter=",", header="axis.speed [m/s],axis.force [N]", comments=""
    )
    np.savetxt(folder / "log.csv", np.column_stack([run.time, *(run[name] for name in names)]), delimiter=",", header=heads, comments="")
    (folder / "road.csv").write_text("depth [m],picking up [kN],slacking off [kN]\n1800,700,600\n2200,900,650\n2450,1000,700\n")
    return folder


FILES = {
    "RIG": "rig.toml",
    "OTHER": "other.toml",
    "LOG": "log.csv",
    "STEADY": "steady.csv",
    "WELL": "well.toml",
    "INCLINED": str(SCENES / "aarsnes_shor.toml"),
    "ROAD": "road.csv",
    "pi.proportional=500:10e3": "stiffpi.proportional=500:10e3",  # the controller with the label PI is a stiff one here
}


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("command", EVERY)
def test_an_origin_names_all_files_of_every_command_that_writes_one(command, well):
    files = FILES | ({"RIG": "sampled.toml"} if command in ("setpoints", "estimate") else {})
    line = [command, *(files.get(word, word) for word in EVERY[command])]
    check([[*line, "--out", f"out_{command}"]], well)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_an_origin_names_a_posterior_and_a_log_and_no_journal(well):
    """Of commands that go on from a file of their own that file is no input: it is as it was before the first call."""
    posterior = [
        "posterior",
        "rig.toml",
        "log.csv",
        "--prior",
        "bit.weight=50kN:110kN",
        "--compare",
        "bit.speed=0.5 rad/s",
        "--controller",
        "PI",
    ]
    lines = [
        [*posterior, "--draws", "32", "--out", "known"],
        ["chance", "rig.toml", "--range", "top.reference=80rpm:130rpm:2", "--posterior", "known/posterior.npz", "--draws", "8", "--out", "chances"],
        [
            "setpoints", "sampled.toml", "--group", "nominal", "--posterior", "known/posterior.npz", "--draws", "2", "--protocol", "takeover",
            "--range", "top.reference=120 rpm:140 rpm", "--step", "10 rpm", "--out", "lowest",
        ],
        *[["tune", *(FILES.get(word, word) for word in EVERY["tune"]), "--checkpoint", "journal", "--out", out] for out in ("tuned", "again")],
    ]  # fmt: skip
    check(lines, well, ("journal",))
