"""The keys of a scene file: what is listed is what is read, with the defaults that it says."""

from __future__ import annotations

import pytest

from toolbox import Scene, SceneError
from toolbox.commands.command_line import main
from toolbox.scenes import keys
from toolbox.scenes.cases import Measured

WHOLE = """
title = "Two inertias"
duration = "60 s"
accuracy = 1e-6
reference = "95 rpm"
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
weight = "97 kN"
[[controllers]]
label = "soft torque"
law = "SoftTorque"
detuning = 1.2
inside = "Lifting"
sample_time = "10 ms"
delay = 0.0
noise = { "top.speed" = 0.01 }
resolution = { "top.speed" = 0.01 }
jitter = "2 ms"
missed_samples = 0.01
seed = 0
inputs = { "bit.weight" = "90 kN" }
[start]
"bit.speed" = 1.0
[inputs]
"bit.weight" = "95 kN"
[parameters]
"bit.friction.static" = 0.7
[verdict]
element = "bit"
signal = "bit.speed"
effort = "top.torque"
after = "30 s"
standstill_speed = 0.1
[measured]
file = "log.csv"
columns = { time = "Time" }
windows = [["5 s", "35 s"]]
[units]
"N" = "klbf"
"""


def written(text, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return Scene.load(path)


def test_every_key_is_read(tmp_path):
    scene = written(WHOLE, tmp_path)
    listed = {name for table in keys.KEYS if table != keys.CONTACTS for name in keys.names(table)}
    assert listed == {line.split(" = ")[0] for line in WHOLE.splitlines() if " = " in line and not line.startswith('"')} - {"weight", "detuning"} | {
        "plant", "controllers", "start", "parameters", "verdict", "measured", "units",
    }  # fmt: skip
    assert (
        scene.measured == Measured((tmp_path / "log.csv").resolve(), {"time": "Time"}, ((5.0, 35.0),))
        and scene.case("soft torque").noise == {"top.speed": 0.01}
        and type(scene.case("soft torque").law).__name__ == "Lifting"
        and scene.standstill_speed == 0.1
        and scene.parameters == {"bit.friction.static": 0.7}
    )


def test_a_scene_shows_its_units_and_keeps_them_in_its_file(tmp_path):
    scene = written(WHOLE.replace('"N" = "klbf"', '"N" = "klbf"\n"m/s" = "km/h"'), tmp_path)
    assert (scene.display_units["rad/s"], scene.display_units["N"], scene.display_units["m/s"]) == ("rpm", "klbf", "km/h")
    again = Scene.load(scene.save(tmp_path / "saved.toml"))
    shown = {unit: other for unit, other in scene.display_units.items() if unit != other}
    assert again == scene and again.display_units == shown
    assert again["soft torque"].display_units["rad/s"] == "rpm"
    for wrong, why in (('"N" = "bar"', "must be in N"), ('"bogus" = "km"', "`bogus` is none"), ('"N" = 3', "units.N")):
        with pytest.raises(SceneError, match=why):
            written(WHOLE.replace('"N" = "klbf"', wrong), tmp_path)


def test_without_its_optional_keys_a_scene_has_the_defaults_that_are_listed(tmp_path):
    short = written('title = "rig"\nduration = 60\n[[plant]]\npart = "wells.JANSEN_2"\n[[plant]]\npart = "BitRock"\n'
                    '[[controllers]]\nlabel = "soft"\nlaw = "SoftTorque"\nsample_time = "10 ms"\n', tmp_path)  # fmt: skip
    defaults = {key.name: key.default for table in ("scene", "[[controllers]]", "[verdict]") for key in keys.KEYS[table]}
    case = short.cases[0]
    assert short.accuracy == float(defaults["accuracy"]) and (case.delay, case.seed) == (float(defaults["delay"]), int(defaults["seed"]))
    assert defaults["after"] == "half of the duration" and short.after == 30.0
    assert [defaults[name] for name in ("reference", "standstill_speed", "noise")] == ["none"] * 3
    assert (short.reference, short.standstill_speed, case.noise) == (None, None, {})
    assert (short.element, short.signal, short.effort) == ("bit", "bit.speed", "top.torque")


@pytest.mark.parametrize("table", ["scene", "[verdict]", "[[controllers]]"])
def test_a_key_that_is_not_listed_is_refused_and_one_that_is_required_is_missed(table, tmp_path):
    line = {"scene": ("title", "titel"), "[verdict]": ("element", "elemnt"), "[[controllers]]": ("seed", "sede")}[table]
    with pytest.raises(SceneError, match=f"There is no key `{line[1]}`.*`{line[0]}`"):
        written(WHOLE.replace(f"\n{line[0]} =", f"\n{line[1]} ="), tmp_path)
    for name in keys.required(table):
        if name not in ("plant",):
            with pytest.raises(SceneError, match=f"The key `{name}` is missing"):
                written("\n".join(row for row in WHOLE.splitlines() if not row.startswith(f"{name} =")), tmp_path)


def test_the_list_prints_every_key_with_unit_default_and_meaning(capsys):
    assert main(["list", "scene"]) == 0
    printed = capsys.readouterr().out
    for table, entries in keys.KEYS.items():
        assert table == "scene" or f"\n{table}\n" in printed
        for key in entries:
            rows = [row for row in printed.splitlines() if row.startswith(f"  {key.name} ")]
            assert any(key.unit in row and key.default in row and row.endswith(key.meaning) for row in rows)
            assert key.meaning and key.default


JANSEN = "studies/scenes/jansen_2.toml"


@pytest.mark.parametrize(
    ("command", "option"),
    [
        (["simulate", "--duration", "-5"], "--duration"),
        (["simulate", "--accuracy", "-1"], "--accuracy"),
        (["onset", "--range", "top.reference=2:16", "--values", "2"], "--values"),
        (["onset", "--range", "top.reference=2:16", "--tolerance", "-1"], "--tolerance"),
        (["map", "--range", "top.reference=3:14", "--range", "bit.weight=50kN:90kN", "--shape", "1x1", "--out", "OUT"], "--shape"),
        (["sweep", "--range", "bit.weight=5e4:9e4", "--sampling", "sobol", "--runs", "3", "--out", "OUT"], "--runs"),
        (["sweep", "--range", "bit.weight=5e4:9e4", "--sampling", "random", "--runs", "4", "--seed", "-1", "--out", "OUT"], "--seed"),
        (
            ["tune", "--controller", "soft torque", "--range", "softtorque.detuning=2:1", "--objective", "severity", "--out", "OUT"],
            "--range",
        ),
        (
            [
                "tune",
                "--controller",
                "soft torque",
                "--range",
                "softtorque.detuning=1:2",
                "--objective",
                "severity",
                "--runs",
                "2",
                "--out",
                "OUT",
            ],
            "--runs",
        ),
        (
            ["tune", "--controller", "constant torque", "--range", "softtorque.detuning=1:2", "--objective", "severity", "--out", "OUT"],
            "--controller",
        ),
        (["fit", "studies/data/rig.csv", "--free", "bit.weight", "--free", "bit.weight"], "--free"),
        (["fit", "studies/data/rig.csv", "--free", "bit.friction.static", "--starts", "0"], "--starts"),
        (["tradeoff", "--duration", "-1"], "--duration"),
    ],
    ids=lambda value: value if isinstance(value, str) else " ".join(value)[:50],
)
def test_errors_of_commands_name_the_option(command, option, root, tmp_path, capsys):
    words = [str(tmp_path / "out") if word == "OUT" else str(root / word) if word.endswith(".csv") else word for word in command[1:]]
    assert main([command[0], str(root / JANSEN), *words]) == 2
    assert capsys.readouterr().err.startswith(f"stickslip: Argument `{option}`")


def test_an_error_of_a_key_of_the_scene_keeps_the_name_of_the_key(root, tmp_path, capsys):
    path = tmp_path / "scene.toml"
    path.write_text((root / JANSEN).read_text().replace('duration = "120 s"', 'duration = "-1 s"'))
    assert main(["simulate", str(path)]) == 2
    assert "`duration`" in capsys.readouterr().err
