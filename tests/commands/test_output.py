"""What commands print: JSON for other programs, nothing, or text that fits the terminal."""

import contextlib
import json
import os
import re
import shlex
import subprocess
import sys
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from toolbox.commands import command_line, terminal
from toolbox.commands.command_line import main
from toolbox.files.origin import Origin, hashes
from toolbox.files.printing import columns
from toolbox.files.results import as_data
from toolbox.scenes.scene import Scene

BELT = """
title = "belt"
duration = 8
[[plant]]
part = "BlockOnBelt"
[[controllers]]
label = "one"
[[controllers]]
label = "two"
"""


@pytest.fixture
def belt(tmp_path):
    path = tmp_path / "belt.toml"
    path.write_text(BELT)
    return str(path)


def asked(capsys, *arguments):
    assert main([*arguments, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert main([*arguments, "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    return found


def test_the_rows_of_a_study_are_json(belt, tmp_path, capsys):
    found = asked(capsys, "study", belt, "--out", str(tmp_path / "out"))
    assert found["title"] == "belt" and [row["controller"] for row in found["rows"]] == ["one", "two"]
    assert found["rows"][0]["stuck"] > 0 and found["rows"][0]["settling"] is None


def test_runs_are_json(belt, capsys):
    run = asked(capsys, "simulate", belt)["runs"]["one"]
    assert run["end"] == 8.0 and run["events"] >= 2 and run["signals"]["belt.slip"]["highest"] >= run["signals"]["belt.slip"]["lowest"]
    assert 0 < run["error"] < 1e-3


def test_sweeps_comparisons_and_lists_are_json(belt, tmp_path, capsys):
    found = asked(capsys, "sweep", belt, "--range", "block.mass=0.5:2:3", "--controller", "one", "--out", str(tmp_path / "swept"))
    assert found["one"]["names"] == ["block.mass"] and len(found["one"]["metrics"]["severity"]) == 3
    other = tmp_path / "other.toml"
    other.write_text(BELT.replace("duration = 8", "duration = 9"))
    assert {"name": "duration", "unit": "1", "first": 8.0, "second": 9.0} in asked(capsys, "compare", belt, str(other))["rows"]
    [entry] = asked(capsys, "list", "BlockOnBelt")
    assert entry["kind"] == "part" and {"mass", "stiffness"} <= {each["name"] for each in entry["parameters"]}
    assert "scene" in asked(capsys, "list", "scene") and "severity" in asked(capsys, "list", "metrics")


def test_every_command_says_what_it_found():
    """A command without data for `--json` would print null."""
    for module, _ in command_line.COMMANDS.values():
        source = (Path(command_line.__file__).parent / f"{module}.py").read_text()
        assert "given.found" in source or "answer(given" in source, module  # `answer` keeps what was found


@pytest.mark.parametrize("command", ["simulate", "study"])
def test_the_bar_of_a_command_moves_on_from_case_to_case_and_stays_before_its_end(belt, tmp_path, monkeypatch, command):
    class Bar(contextlib.AbstractContextManager):
        def __init__(self):
            self.n, self.places = 0.0, []

        def __exit__(self, *raised):
            pass

        def set_description_str(self, text, refresh):
            self.places.append((self.n, text))

        def update(self, moved):
            self.n += moved
            self.places[-1] = (self.n, self.places[-1][1])

    bars = []
    monkeypatch.setattr(terminal, "progress_bar", lambda total, *_, **looks: bars.append((total, Bar())) or bars[-1][1])
    assert main([command, belt, "--out", str(tmp_path / "out")]) == 0
    [(total, bar)] = bars
    places = [place for place, _ in bar.places]
    assert total == 2 and places == sorted(set(places)) and places[-1] < total
    assert {text: place for place, text in bar.places}.items() >= {"one": 0.0, "two": 1.0}.items()


def test_an_error_is_one_line_on_stderr_and_no_json(tmp_path, capsys):
    assert main(["simulate", str(tmp_path / "none.toml"), "--json"]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1


def test_what_json_cannot_say_is_said_otherwise():
    assert as_data([float("nan"), float("inf"), -float("inf"), 1 + 2j, {("a", 1): max}]) == [
        None, "inf", "-inf", [1.0, 2.0], {'["a", 1]': "max"},
    ]  # fmt: skip


LINES = [
    "  name  3 m  a meaning that goes on for quite some words until it is longer than the terminal",
    "A sentence that goes on and on until it is longer than what the terminal has room for in one line.",
    "1  22  333  4444  55555  666666  7777777  88888888  999999999  1010101010  11111111111",
]


def test_long_lines_are_broken_between_words_on_a_terminal_only(capsys, monkeypatch):
    terminal.show("\n".join(LINES))
    assert capsys.readouterr().out.splitlines() == LINES
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setattr(terminal.shutil, "get_terminal_size", lambda: os.terminal_size((60, 20)))
    terminal.show("\n".join(LINES))
    printed = capsys.readouterr().out.splitlines()
    assert printed[-1] == LINES[-1] and all(len(line) <= 60 for line in printed[:-1])
    assert (
        printed[0].startswith("  name  3 m  a meaning")
        and printed[1].startswith(" " * 13)
        and " ".join(printed).split() == " ".join(LINES).split()
    )


def test_a_table_that_is_wider_than_the_terminal_comes_in_parts_with_the_first_column(capsys, monkeypatch):
    heads = ["controller", "verdict", "stuck", "severity", "settling", "peak top.torque"]
    rows = [
        ["constant torque", "stick-slip", "43.40 s", "1.471", "never", "10 kN m"],
        ["PI", "free", "0.00 s", "0.002", "81.9 s", "13.02 kN m"],
    ]
    table = columns([heads, *rows], indent="")
    table.insert(1, "-" * len(table[0]))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setattr(terminal.shutil, "get_terminal_size", lambda: os.terminal_size((45, 20)))
    terminal.show("\n".join(["A title.", "", *table, "", "An end."]))
    printed = capsys.readouterr().out.split("\n")
    assert printed[:2] == ["A title.", ""] and printed[-3:] == ["", "An end.", ""] and max(map(len, printed)) <= 45
    parts = [part.split("\n") for part in "\n".join(printed[2:-3]).split("\n\n")]
    assert len(parts) > 1 and all(set(part[1]) == {"-"} and len(part[1]) == max(map(len, part)) for part in parts)
    for k, row in zip((0, 2, 3), (heads, *rows), strict=True):
        lines = [re.split(r" {2,}", part[k]) for part in parts]
        assert [line[0] for line in lines] == [row[0]] * len(parts) and [cell for line in lines for cell in line[1:]] == row[1:]


def test_list_finds_by_name_first_and_else_by_what_is_said(capsys):
    assert main(["list", "BitRock"]) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("  BitRock: ")
    assert main(["list", "LinearMPC"]) == 0  # the very name is enough, also where others hold it
    printed = capsys.readouterr().out
    assert (
        "  LinearMPC: " in printed
        and "  NonlinearMPC: " not in printed
        and re.search("^Others that speak of it: .*NonlinearMPC", printed, re.M)
    )
    for typed, name in (
        ("soft torque", "SoftTorque"),
        ("z-torque", "ZTorque"),
        ("friction", "FrictionDamper"),
        ("observer", "StringObserverController"),
    ):
        assert main(["list", typed]) == 0
        assert capsys.readouterr().out.splitlines()[1].startswith(f"  {name}: "), typed
    assert main(["list", "impedance"]) == 0  # one bears it in its name, and the one that is sought speaks of it
    assert re.search("^Others that speak of it: .*SoftTorque", capsys.readouterr().out, re.MULTILINE)
    assert main(["list", "friction law"]) == 0
    assert "GaussianStribeck" in capsys.readouterr().out
    assert main(["list", "sample_time"]) == 0
    assert "sample_time" in capsys.readouterr().out
    assert main(["list", "no such thing"]) == 2
    capsys.readouterr()
    assert main(["list", "hyperbola"]) == 0
    assert "RationalStribeck" in capsys.readouterr().out


def completed(line, tmp_path):
    """What a shell is told could stand behind a line."""
    told = tmp_path / "told"
    environment = {
        **os.environ, "_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_IFS": "\n", "_ARGCOMPLETE_STDOUT_FILENAME": str(told),
    }  # fmt: skip
    subprocess.run(
        [sys.executable, "-c", "from toolbox.commands.command_line import script; script()"], env=environment, check=False, timeout=100
    )
    return told.read_text().split()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("stickslip st", ["study"]), ("stickslip s", ["study", "simulate", "setpoints", "sweep", "schedule"]), ("stickslip map --sh", ["--shape"]),
        ("stickslip study --units ", ["si", "metric", "oilfield"]), ("stickslip --ver", ["--version"]),
    ],
)  # fmt: skip
def test_a_shell_is_told_what_could_be_typed_next(line, words, tmp_path):
    pytest.importorskip("argcomplete")
    assert sorted(completed(line, tmp_path)) == sorted(words)


@pytest.mark.parametrize("line", ["--version", "--help", ""])
def test_what_needs_no_command_imports_none_and_none_of_what_they_calculate_with(line):
    program = f"""
import sys
from toolbox.commands.command_line import script
sys.argv = ["stickslip", *{line.split()!r}]
try:
    script()
finally:
    print([name for name in ("numpy", "casadi", "toolbox.commands.study", "toolbox.commands.terminal") if name in sys.modules], file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=100)
    assert done.returncode == (0 if line else 2)
    assert done.stderr.splitlines()[-1] == "[]"


def test_a_command_imports_no_other_command():
    program = """
import sys
from toolbox.commands.command_line import main
assert main(["list", "metrics", "--quiet"]) == 0
print(sorted(set(COMMANDS) & {name.rpartition(".")[2] for name in sys.modules if name.startswith("toolbox.commands.")}))
""".replace("COMMANDS", repr([module for module, _ in command_line.COMMANDS.values()]))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=100)
    assert done.stdout.strip() == "['listing']"


RIG = """
title = "two inertias"
duration = "20 s"
reference = "95 rpm"
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
[[controllers]]
label = "PI"
law = "PI"
"""

EVERY = {
    "study": ["RIG"],
    "simulate": ["RIG"],
    "onset": ["RIG", "--range", "top.reference=90 rpm:140 rpm", "--values", "3"],
    "map": ["RIG", "--range", "top.reference=60rpm:130rpm", "--range", "bit.weight=60kN:110kN", "--shape", "3x3"],
    "sweep": ["RIG", "--range", "bit.weight=80kN:90kN:2"],
    "margins": ["RIG"],
    "basin": ["RIG", "--controller", "PI", "--range", "bit.speed=0 rpm:290 rpm", "--runs", "16"],
    "compare": ["RIG", "OTHER"],
    "chance": ["RIG", "--range", "top.reference=80rpm:130rpm:2", "--uncertainty", "bit.weight=97 kN +- 8 kN", "--draws", "8"],
    "tune": ["RIG", "--controller", "PI", "--range", "pi.proportional=500:10e3", "--objective", "severity", "--runs", "10"],
    "posterior": ["RIG", "--controller", "PI", "--prior", "bit.weight=50kN:110kN", "--measured", "severity=1.9 +- 0.1", "--draws", "32"],
    "fit": ["RIG", "LOG", "--range", "bit.friction.kinetic=0.3:0.7"],
    "estimate": ["RIG", "LOG", "--controller", "PI"],
    "identify": ["STEADY", "--plant", "Axis"],
    "answer": ["RIG", "--controller", "PI", "--phases", "1", "--duration", "60 s"],
    "setpoints": ["RIG", "--initial-controller", "PI", "--group", "nominal", "--range", "top.reference=120 rpm:140 rpm", "--step", "10 rpm"],
    "tradeoff": ["RIG", "--duration", "2"],
    "torquedrag": ["INCLINED", "--measured", "ROAD", "--friction-depth", "20 km", "--change", "10%"],
    "schedule": ["WELL", "--controller", "stiff PI", "--depths", "2000", "2500", "--duration", "5 s"],
    "windows": [
        "WELL", "--controller", "stiff PI", "--depths", "2km", "--range", "top.reference=60 rpm:140 rpm", "--range", "bit.weight=60 kN:100 kN",
        "--along", "80 kN", "--shape", "3x3",
    ],
}  # fmt: skip

SCENES = {"compare": {"first.toml", "second.toml"}}
"""{command: its scenes, if they are not one}."""


def verb_of(name):
    """The parser of a command."""
    [commands] = (each.choices for each in command_line._parser([name])._actions if isinstance(each.choices, dict))
    assert set(commands) == set(command_line.COMMANDS)
    return commands[name]


def test_every_command_that_writes_a_folder_is_tried_below():
    commands = {name: verb_of(name) for name in command_line.COMMANDS}
    writing = {name for name, verb in commands.items() if any("--out" in each.option_strings for each in verb._actions)}
    assert writing - {"export"} == set(EVERY)  # what is exported is a program, not a result
    for name, verb in commands.items():
        assert {"--json", "--quiet", "--units"} <= {word for each in verb._actions for word in each.option_strings}, name


@pytest.mark.parametrize("command", [*EVERY, "export"])
def test_a_folder_that_cannot_be_written_is_refused_before_any_work(command, root, tmp_path, monkeypatch, capsys):
    """A search of hours would be lost at its end."""

    def read(*_, **__):
        raise AssertionError("It was begun.")

    monkeypatch.setattr(Scene, "load", read)
    (tmp_path / "taken").write_text("mine")
    words = [
        str(tmp_path / f"{word}.toml") if word.isupper() and word.isalpha() else word
        for word in EVERY.get(command, ["RIG", "--part", "law"])
    ]
    for place, why in ((tmp_path / "taken" / "out", "cannot: Not a directory."), (tmp_path / "taken", "is something else.")):
        assert main([command, *words, "--out", str(place)]) == 2
        told = capsys.readouterr().err
        assert told.startswith("stickslip: Argument `--out` must be a folder") and told.endswith(f"{why}\n") and told.count("\n") == 1


@pytest.mark.skipif(os.name != "posix", reason="closes what POSIX calls 1")
@pytest.mark.parametrize("output", ["closed", "full"])
def test_results_are_whole_where_nothing_can_be_printed(output, tmp_path):
    for name, speed in (("one", 95), ("other", 96)):
        (tmp_path / f"{name}.toml").write_text(RIG.replace("95 rpm", f"{speed} rpm"))
    if output == "full" and not os.path.exists("/dev/full"):
        pytest.skip("this system has no device that is full")
    begin = {"closed": 'exec "$@" >&-', "full": 'exec "$@" >/dev/full'}[output]
    command = [
        sys.executable,
        "-m",
        "toolbox",
        "compare",
        str(tmp_path / "one.toml"),
        str(tmp_path / "other.toml"),
        "--json",
        "--out",
        str(tmp_path / "out"),
    ]
    ended = subprocess.run(["sh", "-c", begin, "sh", *command], stderr=subprocess.PIPE, text=True, check=False, timeout=100)
    assert (ended.returncode, ended.stderr) == ((0, "") if output == "closed" else (1, "stickslip: Output: No space left on device.\n"))
    assert "96" in (tmp_path / "out" / "compare.txt").read_text() and (tmp_path / "out" / "second.toml").exists()


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """A scene and a log of its machine."""
    folder = tmp_path_factory.mktemp("inputs")
    (folder / "rig.toml").write_text(RIG)
    (folder / "other.toml").write_text(RIG.replace("95 rpm", "96 rpm"))
    (folder / "sampled.toml").write_text(RIG + 'sample_time = "10 ms"\n[[controllers]]\nlabel = "soft torque"\nlaw = "SoftTorque"\n')
    assert main(["simulate", str(folder / "rig.toml"), "--quiet", "--out", str(folder / "run")]) == 0
    with np.load(next((folder / "run").glob("*.npz"))) as data:
        times = np.arange(0.0, 20.0, 0.1)
        names = {"top.speed": "rad/s", "top.torque": "N m", "bit.speed": "rad/s"}
        rows = np.column_stack([times, *(np.interp(times, data["time"], data[name]) for name in names)])
    heads = ",".join(["time [s]", *(f"{name} [{unit}]" for name, unit in names.items())])
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=heads, comments="")
    speed = np.linspace(0.005, 0.6, 21)
    rows = np.column_stack([speed, 5.0 + 15.0 * np.exp(-((speed / 0.07) ** 2)) + 35.0 * speed])
    (folder / "road.csv").write_text("depth [m],picking up [kN],slacking off [kN]\n1800,700,600\n2200,900,650\n2450,1000,700\n")
    np.savetxt(folder / "steady.csv", rows, delimiter=",", header="axis.speed [m/s],axis.force [N]", comments="")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("command", EVERY)
def test_every_command_that_writes_a_folder_has_its_report_and_writes_the_same_again(command, inputs, root, tmp_path, capsys):
    """Of the same call all bytes but those of `origin.json` are the same, `--json` is JSON, `--quiet` is nothing, and `report` makes a page of the folder."""
    scene = str(inputs / ("sampled.toml" if command in ("setpoints", "estimate") else "rig.toml"))
    places = {
        "RIG": scene,
        "LOG": str(inputs / "log.csv"),
        "STEADY": str(inputs / "steady.csv"),
        "ROAD": str(inputs / "road.csv"),
        "OTHER": str(inputs / "other.toml"),
        "WELL": str(root / "studies/scenes/deepening_well.toml"),
        "INCLINED": str(root / "studies/scenes/aarsnes_shor.toml"),
    }
    line = [command, *(places.get(word, word) for word in EVERY[command])]
    (tmp_path / "first").mkdir()
    (tmp_path / "second").mkdir()
    assert main([*line, "--json", "--out", str(tmp_path / "first" / "out")]) == 0
    assert json.loads(capsys.readouterr().out) is not None
    assert main([*line, "--quiet", "--out", str(tmp_path / "second" / "out")]) == 0
    assert capsys.readouterr().out == ""
    for folder in {path.parent for path in (tmp_path / "first").rglob("origin.json")}:
        held = {path.name for path in folder.iterdir()}
        assert held >= SCENES.get(command, {"scene.toml"}) | {f"{command}.txt"}, held
        origin = Origin.read(folder)
        assert origin.command == f"stickslip {shlex.join([*line, '--json', '--out', str(tmp_path / 'first' / 'out')])}"
        assert datetime.fromisoformat(origin.began).utcoffset() == timedelta(0) and {"Python", "casadi", "numpy"} <= origin.versions.keys()
        given = [Path(places[word]) for word in EVERY[command] if word in places]
        own = {
            "WELL": ["studies/scenes/deepening_well.csv"],
            "INCLINED": [f"models/tables/aarsnes_shor_{each}.csv" for each in ("sections", "survey")],
        }
        tables = [root / each for word in EVERY[command] for each in own.get(word, ())]  # which the scene names
        assert origin.inputs == hashes([*given, *tables])
        kept = {
            name for name in held if name.endswith(".jsonl") or (folder / name / "runs.jsonl").is_file()
        }  # journals of what was interrupted
        others = held - origin.files.keys() - kept
        assert origin.files.keys() <= held and others <= {"origin.json", "sweep.zarr"} and origin.changed(folder) == []
    first, second = (
        {str(path.relative_to(tmp_path / side)): path.read_bytes() for path in (tmp_path / side).rglob("*") if path.is_file()}
        for side in ("first", "second")
    )
    origins = [name for name in first if name.endswith("origin.json")]
    assert origins and first.keys() == second.keys()
    timed = {"tradeoff": ("tradeoff.csv", "tradeoff.png", "tradeoff.npz", "tradeoff.txt"), "sweep": "sweep.zarr/zarr.json"}.get(command, ())
    assert [name for name in first if first[name] != second[name] and name not in origins and not name.endswith(timed or "\0")] == []
    assert main(["report", str(tmp_path / "first" / "out"), "--page", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text()
    assert f"stickslip {command}" in page and "<h2>" in page
    answer = page.partition("Appendix</h2>")[0]
    assert command == "compare" or ("<table>" in answer and "<pre>" not in answer)
