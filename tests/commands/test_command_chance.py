"""The commands `stickslip chance`, `posterior`, `basin` and those that take distributions: from a scene, or from a log, to probabilities."""

import json

import numpy as np
import pytest

import toolbox.probability.chances as chances
from toolbox import simulate
from toolbox.commands.command_line import main
from toolbox.probability import Basin, Chance, Posterior, UncertainOnset, Uniform, basin, chance
from toolbox.scenes.scene import Scene

RIG = """
title = "Two inertias"
duration = "60 s"
reference = "95 rpm"
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
weight = "90 kN"
[[controllers]]
label = "constant torque"
inputs = { "top.torque" = "9 kN m" }
[[controllers]]
label = "stiff PI"
law = "StiffPI"
"""

ASKED = [
    "--range",
    "top.reference=60 rpm:140 rpm:2",
    "--uncertainty",
    "bit.weight=90 kN +- 9 %",
    "--uncertainty",
    "bit.friction.static=0.7:0.9",
]
ASKED += ["--controller", "stiff PI", "--draws", "20"]


@pytest.fixture
def rig(tmp_path):
    (tmp_path / "rig.toml").write_text(RIG)
    return tmp_path / "rig.toml"


def test_chances_are_those_of_the_function_in_the_units_that_were_typed(rig, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"
    assert main(["chance", str(rig), *ASKED, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "top.reference [rpm]" in printed and "bit.friction.static known as 0.7 to 0.9" in printed
    found = Chance.load(out / "chance.npz")
    assert (out / "chance.txt").read_text() == f"{found}\n"
    uncertain = {"bit.weight": "90 kN +- 9 %", "bit.friction.static": Uniform(0.7, 0.9)}
    same = chance(Scene.load(rig)["stiff PI"], {"top.reference": ["60 rpm", "140 rpm"]}, uncertain, draws=20)
    assert np.array_equal(found.outcomes["stiff PI"], same.outcomes["as it is"]) and 0 < found.chances["stiff PI"].mean() < 1
    names = {"chance.txt", "chance.csv", "chance.npz", "chance.png", "chance_01.jsonl", "scene.toml", "origin.json"}
    assert {path.name for path in out.iterdir()} == names
    assert "chance.npz" in (out / "origin.json").read_text()
    monkeypatch.setattr(chances.Search, "block", None)  # what is known is not asked again
    assert main(["chance", str(rig), *ASKED, "--out", str(out)]) == 0
    assert main(["chance", str(rig), *ASKED, "--seed", "1", "--out", str(out)]) == 2


def test_a_controller_without_the_number_is_left_out_by_name(rig, capsys):
    asked = ["--range", "top.reference=60 rpm:140 rpm:2", "--uncertainty", "bit.weight=90 kN +- 9 %", "--draws", "4"]
    assert main(["chance", str(rig), *asked]) == 0
    printed = capsys.readouterr()
    assert "warning: `constant torque` is left out: There is no number `top.reference`" in printed.err
    assert "stiff PI" in printed.out and "constant torque" not in printed.out
    assert main(["chance", str(rig), *asked, "--controller", "constant torque"]) == 2
    assert "There is no number `top.reference`" in capsys.readouterr().err
    assert main(["chance", str(rig), "--range", "top.refrence=1:2:2", *asked[2:]]) == 2  # known under no controller
    assert "did you mean `top.reference`" in capsys.readouterr().err


def test_a_recording_becomes_a_posterior_and_that_becomes_chances(rig, tmp_path, capsys):
    scene = Scene.load(rig)
    run = simulate(scene["constant torque"].at("bit.weight", 80e3), "30 s", output_times=np.linspace(0.0, 30.0, 601))
    rows = zip(run.time, run["top.torque"], run["top.speed"] * 60 / (2 * np.pi), strict=True)
    table = "time [s],torque [N m],speed [rpm]\n" + "".join(f"{t:.9g},{u:.9g},{w:.9g}\n" for t, u, w in rows)
    (tmp_path / "rig.csv").write_text(table)
    columns = ["--column", "top.torque=torque", "--column", "top.speed=speed"]
    compared = ["--compare", "top.speed=0.3 rad/s", "--prior", "bit.weight=50kN:110kN", "--draws", "64"]
    assert main(["posterior", str(rig), str(tmp_path / "rig.csv"), *columns, *compared, "--out", str(tmp_path / "known")]) == 0
    assert "Posterior of Two inertias: 64 draws" in capsys.readouterr().out
    assert {"bands.csv", "bands.png"} <= {path.name for path in (tmp_path / "known").iterdir()}
    known = Posterior.load(tmp_path / "known" / "posterior.npz")["bit.weight"]
    assert abs(known.mean() - 80e3) < 3 * known.std() + 200.0 and known.std() < 5e3
    again = ["chance", str(rig), "--posterior", str(tmp_path / "known" / "posterior.npz"), "--range", "top.reference=6:8:2", "--draws", "8"]
    assert main([*again, "--controller", "stiff PI", "--json"]) == 0
    assert np.shape(json.loads(capsys.readouterr().out)["outcomes"]["stiff PI"]) == (2, 8)


def test_what_a_posterior_cannot_compare_is_refused(rig, tmp_path, capsys):
    (tmp_path / "rig.csv").write_text("time [s],top.torque [N m],top.speed [rad/s]\n0,1,1\n1,1,1\n2,1,1\n")
    given = ["posterior", str(rig), str(tmp_path / "rig.csv"), "--prior", "bit.weight=50kN:110kN", "--compare"]
    assert main([*given, "top.torque=1 N m"]) == 2
    assert "names `top.torque`; there are: top.speed" in capsys.readouterr().err
    assert main([*given, "top.speed"]) == 2
    assert "`--compare` must be SIGNAL=DEVIATION" in capsys.readouterr().err


def test_a_log_of_the_surface_becomes_estimates(rig, tmp_path, capsys):
    run = simulate(Scene.load(rig)["constant torque"], "20 s", output_times=np.linspace(0.0, 20.0, 401))
    rows = zip(run.time, run["top.torque"], run["top.speed"], strict=True)
    (tmp_path / "rig.csv").write_text(
        "time [s],torque [N m],top.speed [rad/s]\n" + "".join(f"{t:.9g},{u:.9g},{w:.9g}\n" for t, u, w in rows)
    )
    out = tmp_path / "out"
    columns = ["--column", "top.torque=torque", "--column", "top.speed=top.speed"]
    assert main(["estimate", str(rig), str(tmp_path / "rig.csv"), *columns, "--members", "16", "--out", str(out)]) == 0
    assert "bit speed" in capsys.readouterr().out
    assert {path.name for path in out.iterdir()} == {f"estimate.{kind}" for kind in ("txt", "csv", "npz", "png")} | {
        "scene.toml",
        "origin.json",
    }


def test_a_part_of_a_log_with_holes_is_used_where_that_is_said(rig, tmp_path, capsys):
    rows = [f"{t:.1f},{'' if 20 <= k < 24 else 5 * t},{0.01 + 0.001 * (k % 7)}\n" for k, t in enumerate(np.arange(0.0, 6.0, 0.1))]
    (tmp_path / "rig.csv").write_text("time [s],top.torque [N m],top.speed [rad/s]\n" + "".join(rows))
    given = ["posterior", str(rig), str(tmp_path / "rig.csv"), "--prior", "bit.weight=50kN:110kN", "--compare", "top.speed=0.1 rad/s"]
    assert main([*given, "--draws", "32"]) == 2
    assert "choose among the windows" in capsys.readouterr().err
    assert main([*given, "--draws", "32", "--max-gap", "4", "--window", "0:4", "--mean", "1 s"]) == 0
    printed = capsys.readouterr().out
    assert "Recording of" in printed and "4 null" in printed and "top.speed from 3 s" in printed and "from 4 s" not in printed


def test_a_basin_is_that_of_the_function(rig, tmp_path, capsys):
    out = tmp_path / "out"
    asked = [
        "basin",
        str(rig),
        "--controller",
        "stiff PI",
        "--range",
        "bit.speed=0 rpm:250 rpm",
        "--runs",
        "60",
        "--duration",
        "90",
        "--out",
        str(out),
    ]
    assert main(asked) == 0
    found = Basin.load(out / "basin.npz")
    same = basin(Scene.load(rig)["stiff PI"], {"bit.speed": ("0 rpm", "250 rpm")}, 60, duration=90.0)
    assert np.array_equal(found.outcomes, same.outcomes) and 0.0 < found.share < 1.0
    assert (out / "basin.txt").read_text() == f"{found}\n" and "250" in capsys.readouterr().out
    assert {path.name for path in out.iterdir()} == {"basin.txt", "basin.csv", "basin.npz", "basin.png", "scene.toml", "origin.json"}
    assert main(["basin", str(rig), "--controller", "stiff PI", "--range", "bit.weight=50kN:60kN"]) == 2
    assert "must name states" in capsys.readouterr().err


def test_an_onset_of_numbers_that_are_distributions_is_one_of_draws(rig, tmp_path, capsys):
    out = tmp_path / "out"
    asked = ["onset", str(rig), "--range", "top.reference=40 rpm:200 rpm", "--values", "4", "--draws", "12"]
    assert main([*asked, "--uncertainty", "bit.weight=90 kN +- 9 %", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "from 40 to 200 rpm: Two inertias, 12 draws" in printed and "bit.weight known as 90 kN +- 8.1 kN" in printed
    found = UncertainOnset.load(out / "drawn_onset.npz")
    assert list(found.onset_values) == ["stiff PI"] and found.points.shape == (12, 1)
    names = {f"drawn_onset.{kind}" for kind in ("txt", "csv", "npz", "png")}
    assert {path.name for path in out.iterdir()} == {*names, "scene.toml", "origin.json"}
    assert main([*asked, "--uncertainty", "bit.weight=90 kN +- 9 %", "--at", "90 rpm"]) == 2
    assert "`--at` must not be given" in capsys.readouterr().err


@pytest.mark.slow
def test_the_drive_table_takes_machines_that_are_drawn(rig, capsys):
    asked = [
        "setpoints",
        str(rig),
        "--initial-controller",
        "stiff PI",
        "--controller",
        "soft torque",
        "--protocol",
        "takeover",
        "--range",
        "top.reference=80 rpm:120 rpm",
    ]
    text = rig.read_text() + '[[controllers]]\nlabel = "soft torque"\nlaw = "SoftTorque"\n'
    rig.write_text(text)
    assert main([*asked, "--step", "20 rpm", "--uncertainty", "bit.weight=90 kN +- 9 %", "--draws", "3"]) == 0
    printed = capsys.readouterr().out
    assert "soft torque  drawn  takeover" in printed and "soft torque  nominal" not in printed
