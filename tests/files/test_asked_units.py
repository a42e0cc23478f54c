"""Answers are in the unit that the question was typed in: reports, tables, figures and files of results; numbers in Python stay floats in SI."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import re

import casadi as ca
import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.ticker import ScalarFormatter

from controllers import PI, SoftTorque, StiffPI
from models import BitRock, wells
from toolbox import (
    Sampled,
    Scene,
    Trajectory,
    closed_loop,
    compare,
    compose,
    equilibrium,
    hopf_points,
    margins,
    plot,
    severity_map,
    simulate,
    sweep,
    tune,
    use_units,
)
from toolbox.commands.command_line import main
from toolbox.files.unit_systems import asked_in, asked_units
from toolbox.files.units import TypedNumber, parse
from toolbox.inputs import ramp
from toolbox.measuring import metrics
from toolbox.onsets import SeverityMap
from toolbox.robustness import absorber_limit, performance_limit
from toolbox.sweeps import Sweep

RPM = np.pi / 30
WEIGHED = BitRock(weight=97_347.0)
RIG = compose(wells.JANSEN_2, WEIGHED)
SCENE = "studies/scenes/jansen_2.toml"


def line(text: str, word: str) -> str:
    return next(each for each in text.splitlines() if each.split()[:1] == [word])


def test_a_typed_number_is_the_float_it_is_and_remembers_its_unit():
    speed = parse("95 rpm", "rad/s")
    assert isinstance(speed, TypedNumber) and speed == pytest.approx(95 * RPM, rel=1e-15)
    assert repr(speed) == repr(float(speed)) and hash(speed) == hash(float(speed)) and f"{speed:.3f}" == "9.948"
    assert type(speed * 2) is float and type(-speed) is float and np.array([speed]).dtype == np.float64
    assert float(ca.DM(speed)) == speed
    for again in (pickle.loads(pickle.dumps(speed)), copy.deepcopy(speed)):
        assert again == speed and (again.unit, again.display_units) == ("rad/s", "rpm")


@pytest.mark.parametrize(
    "text, unit, display_units",
    [("95 RPM", "rad/s", "rpm"), ("95 1/min", "rad/s", "rpm"), ("10kNm", "N m", "kN m"), ("10000 Nm", "N m", "N m"), ("20 klb", "N", "klbf"),
     ("8 t", "N", "t"), ("8 t", "kg", "t"),
     ("5 ft-lbf", "N m", "lbf ft"), ("9 rad/s", "rad/s", "rad/s"), ("2 kNm/rad", "N m/rad", "kN m/rad")],
)  # fmt: skip
def test_the_unit_is_remembered_in_its_usual_spelling(text, unit, display_units):
    assert parse(text, unit).display_units == display_units


def test_ratios_and_degrees_of_temperature_are_plain_floats():
    assert type(parse("20 %", "1")) is float and type(parse("20 degC", "K")) is float


def test_arguments_count_before_fields_and_fields_that_have_a_size_of_their_own_do_not():
    law, part = PI(reference="95 rpm"), BitRock(weight="97 kN", radius="6 in")
    assert asked_units(fields=(Sampled(law, "10 ms"), part)) == {"rad/s": "rpm", "N": "kN"}
    assert asked_units(parse("1 deg/s", "rad/s"), parse("2 min", "s"), parse("3 mm", "m"), fields=(law,)) == {"rad/s": "deg/s", "m": "mm"}
    assert asked_in((1.0, parse("3 deg/s", "rad/s")), "rad/s") == "deg/s" and asked_in((1.0, 2.0), "rad/s") == "rad/s"


def test_a_run_is_reported_and_drawn_in_the_units_of_its_inputs_parameters_and_laws(tmp_path):
    run = simulate(RIG, "5 s", inputs={"top.torque": "10 kN m"})
    assert re.search(r"10 +\.\. 10 +end 10 kN m$", line(str(run), "top.torque")) and line(str(run), "bit.torque").endswith("kN m")
    assert line(str(run), "top.speed").endswith("rad/s")  # nobody typed a speed
    assert run["top.torque"][-1] == 10_000.0 and ">kN m</td>" in run._repr_html_()
    law = simulate(RIG, 5.0, controller=SoftTorque(reference="95 rpm"), sample_time="10 ms", parameters={"bit.weight": "90 kN"})
    assert re.search(r"end 95 rpm$", line(str(law), "top.reference")) and re.search(r"end 90 kN$", line(str(law), "bit.weight"))
    assert law["top.reference"][-1] == pytest.approx(95 * RPM)
    panels = law.plot("top.speed", "bit.weight")
    assert [panel.get_ylabel() for panel in panels] == ["top speed [rpm]", "bit weight [kN]"]
    assert plot.phase_plane(law, "top.reference", "bit.speed").get_ylabel() == "bit speed [rpm]"
    assert simulate(RIG, 5.0, inputs={"top.torque": ramp("1 kN m", "9 kN m", 0.0, "5 s")}).display_units == {"N m": "kN m"}
    assert simulate(RIG, 5.0, inputs={"top.torque": (["0 min", "1 s"], ["1 klbf ft", "2 klbf ft"])}).display_units == {"N m": "klbf ft"}
    saved = Trajectory.load(law.save(tmp_path / "run.npz"))
    assert line(str(saved), "top.reference") == line(str(law), "top.reference")
    found = compare(run, saved, signals=["bit.speed", "bit.torque"], labels=("constant", "soft torque"))
    assert found["bit.speed, maximum"].second == pytest.approx(law["bit.speed"].max(), rel=1e-3)
    assert "rpm" in str(found) and "kN m" in str(found) and "rad/s" not in str(found)
    with use_units("si"):
        assert "rpm" not in str(saved) and "kN" not in str(found)


def test_axes_that_are_shared_have_one_unit():
    plain, typed = (simulate(RIG, 5.0, inputs={"top.torque": torque}) for torque in (9_000.0, "12 kN m"))
    _, (left, right) = plt.subplots(1, 2, sharey=True)
    plot.traces(plain, "top.torque", ax=left)
    plot.traces(typed, "top.torque", ax=right)
    assert left.get_ylabel() == right.get_ylabel() == "top torque [N m]"
    assert isinstance(right.yaxis.get_major_formatter(), ScalarFormatter)  # of numbers as they are
    _, (left, right) = plt.subplots(1, 2, sharey=True)
    plot.traces(typed, "top.torque", ax=left)
    plot.traces(plain, "top.torque", ax=right)
    assert left.get_ylabel() == right.get_ylabel() == "top torque [kN m]" and right.yaxis.get_major_formatter()(9_000.0) == "9"


def test_every_run_of_a_scene_answers_in_the_units_of_the_scene():
    scene = Scene.load(SCENE)
    constant = scene.run("constant torque")  # in which nobody types a speed
    assert line(str(constant), "top.speed").endswith("rpm") and line(str(constant), "top.torque").endswith("kN m")


def test_steady_states_and_hopf_points_answer_alike():
    point = equilibrium(closed_loop(RIG, inputs={"top.torque": "20 kN m"}))
    assert line(str(point), "top.torque").split()[1:] == ["20", "kN", "m"] and point["top.torque"] == 20_000.0
    (hopf,) = hopf_points(closed_loop(RIG, StiffPI()), "top.reference", ("30 rpm", "140 rpm"))
    assert f"top.reference = {hopf.value / RPM:.6g} rpm" in str(hopf)


def test_margins_and_limits_answer_in_the_units_of_their_working_point():
    for law in (SoftTorque(reference="95 rpm"), Sampled(SoftTorque(), "10 ms")):
        given = {"top.reference": "95 rpm"} if law.__class__ is Sampled else {}
        found = margins(closed_loop(RIG, law, inputs=given))
        assert " at top.reference = 95 rpm, top.torque = " in str(found) and found.operating_point["top.reference"] == pytest.approx(
            95 * RPM
        )
    with use_units("metric"):
        assert f"top.torque = {found.operating_point['top.torque'] / 1e3:.4g} kN m" in str(found)
    limit = performance_limit(closed_loop(RIG, parameters={"bit.weight": "90 kN"}), {"top.speed": "40 rpm"})
    assert " at top.speed = 40 rpm, top.torque = " in str(limit) and limit.display_units == {"rad/s": "rpm", "N": "kN"}
    assert limit.signals["top.speed"] == pytest.approx(40 * RPM)


@pytest.mark.slow
def test_the_limit_of_absorbers_answers_in_the_unit_of_its_range():
    found, plain = (absorber_limit(RIG, between) for between in (("5 rpm", "100 rpm"), (5 * RPM, 100 * RPM)))
    assert found.speed == plain.speed and f"down to {found.speed / RPM:.4g} rpm: damping {found.damping:.4g} N m s/rad" in str(found)
    assert f"down to {found.speed:.4g} rad/s" in str(plain)
    with use_units("metric"):
        assert f"damping {found.damping / 1e3:.4g} kN m s/rad" in str(plain)


def test_scenes_differ_in_the_units_of_their_files():
    scene = Scene.load(SCENE)
    parts = tuple(dataclasses.replace(part, weight="90 kN") if isinstance(part, BitRock) else part for part in scene.parts)
    found = compare(scene, dataclasses.replace(scene, parts=parts, reference=parse("80 rpm", "rad/s"), accuracy=1e-7))
    rows = {row.split()[0]: row.split()[1:] for row in str(found).splitlines()[2:]}
    assert rows["plant.BitRock.weight"] == ["97.347", "90", "-7.347", "kN"] and rows["reference"] == ["95", "80", "-15", "rpm"]
    assert rows["accuracy"] == ["1e-06", "1e-07", "-9e-07"] and found["reference"].second == pytest.approx(80 * RPM)


def test_the_table_of_a_plant_shows_what_was_typed():
    html = compose(wells.JANSEN_2, BitRock(weight="97.347 kN"))._repr_html_()
    assert ">97.347</td>" in html and ">kN</td>" in html


def test_a_sweep_and_its_files_answer_in_the_units_of_its_values_and_of_the_run(tmp_path):
    found = sweep(
        closed_loop(RIG, inputs={"top.torque": "10 kN m"}),
        {"bit.weight": ["50 kN", "60 kN"]},
        5.0,
        metrics={"peak": metrics.maximum("top.torque")},
    )
    assert re.search(r"50 +60 +kN$", line(str(found), "bit.weight")) and " kN m " in line(str(found), "peak")
    assert found["bit.weight"].tolist() == [50e3, 60e3] and found["peak"].tolist() == [1e4, 1e4]
    for path in (tmp_path / "sweep.npz", tmp_path / "sweep.zarr"):
        assert str(Sweep.load(found.save(path))).split("\n")[1:] == str(found).split("\n")[1:]  # files hold no seconds
    plain = sweep(compose(wells.JANSEN_2, BitRock(weight="97 kN")), {"bit.weight": [50e3, 60e3]}, 5.0)
    assert re.search(r"50000 +60000 +N$", line(str(plain), "bit.weight"))  # plain numbers are asked in SI


@pytest.mark.slow
def test_a_map_answers_on_each_axis_in_its_unit(tmp_path):
    over = {"top.reference": ("30 rpm", "140 rpm"), "bit.weight": (60e3, 100e3)}
    found = severity_map(closed_loop(RIG, StiffPI()), over, shape=(2, 2), duration="30 s", halvings=0)
    assert "top.reference from 30 to 140 rpm" in str(found) and "bit.weight from 60000 to 100000 N" in str(found)
    again = SeverityMap.load(found.save(tmp_path / "map.npz"))
    axes = again.plot()
    assert str(again) == str(found) and axes[0].get_xlabel() == "top reference [rpm]" and axes[0].get_ylabel() == "bit weight [kN]"
    assert axes[0].get_xlim() == pytest.approx((30, 140))


def test_a_tuning_answers_in_the_units_of_its_bounds():
    law = PI(reference="95 rpm", proportional=900.0, integral=600.0)
    found = tune(RIG, law, "peak", {"pi.integral": ("0.1 kN m/rad", "2 kN m/rad")}, duration="5 s", runs=10)
    row = line(str(found), "pi.integral")
    assert "pi.integral [kN m/rad]" in row and row.endswith("0.1 .. 2, log") and " 0.6 " in row
    assert 100.0 <= found.law.integral <= 2000.0


def test_a_study_and_commands_answer_in_the_units_of_the_scene_and_of_their_options(capsys):
    scene = Scene.load(SCENE)
    assert scene.display_units["rad/s"] == "rpm" and isinstance(scene.reference, float)
    assert main(["simulate", SCENE, "--controller", scene.labels[0], "--duration", "5 s"]) == 0
    assert scene.case("soft torque").law.reference.display_units == "rpm"  # a law that has the set-point of the scene has its unit, too
    said = capsys.readouterr().out
    assert "rpm" in said and "rad/s " not in said and "kN m" in said
    assert main(["sweep", SCENE, "--controller", scene.labels[0], "--range", "bit.weight=50kN:60kN:2", "--out", "/dev/null"]) == 2
    capsys.readouterr()
    assert main(["simulate", SCENE, "--controller", scene.labels[0], "--duration", "5 s", "--units", "si"]) == 0
    assert "rpm" not in re.sub(r"^.*95 rpm$", "", capsys.readouterr().out, flags=re.MULTILINE)  # but for the title of the scene
