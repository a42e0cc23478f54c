"""Scenes of a body with many contacts: read as other scenes are, run as in Python bit for bit, and refused where a plant must have equations."""

import csv
import dataclasses
import math

import numpy as np
import pytest

from controllers import PI
from models import AxialChain, Coulomb, Exponential, ReducedBody, TorsionalChain, sliding_resultant, string_on_wall
from studies.questions import elastic_sliders as study
from toolbox import SceneError
from toolbox.commands.command_line import main
from toolbox.contacts import press_contacts, step_contacts
from toolbox.contacts.newton import ContactSolver
from toolbox.inputs import ramp
from toolbox.scenes import ContactScene
from toolbox.scenes.contact_scene import load_scene

SCENE = """
title = "Block of two feet"
duration = "1 s"
step = "10 ms"

[inputs]
"surface.x" = "30 mm/s"

[[plant]]
part = "ElasticFace"
body = "feet.npz"
tangent = ["x"]
normal = "z"
force_ports = ["top"]
support_port = "back"
support_stiffness = "0.1 N/mm"
friction = { law = "Coulomb", static = 0.4, kinetic = 0.3 }

[[controllers]]
label = "light"
inputs = { top = "-1 N" }

[[controllers]]
label = "heavy"
inputs = { top = { ramp = { start = "-2 N", end = "-4 N", begin = "0 s", finish = "1 s" } } }
"""


def feet():
    """Two feet under a rigid bar on stiff springs: ports x.i along and z.i above the plate, the bar's back and top."""
    ports = ("x.0", "x.1", "z.0", "z.1", "back", "top")
    stiffness = np.zeros((6, 6))
    for foot, bar, k in ((0, 4, 1e5), (1, 4, 1e5), (2, 5, 1e6), (3, 5, 1e6)):
        spring = np.eye(6)[foot] - np.eye(6)[bar]
        stiffness += k * np.outer(spring, spring)
    return ReducedBody(
        ports,
        np.diag([0.01, 0.01, 0.01, 0.01, 1.0, 1.0]),
        1e-2 * stiffness,
        stiffness,
        contact_positions=[[0.0, 0.0], [0.01, 0.0]],
        contact_areas=[1e-5, 3e-5],
    )


@pytest.fixture
def written(tmp_path):
    feet().save(tmp_path / "feet.npz")

    def write(text=SCENE):
        path = tmp_path / "feet.toml"
        path.write_text(text)
        return path

    return write


def equal(one, other):
    for word in ("time", "coordinates", "rates", "contact_modes", "normal", "tangential", "slip", "friction_work"):
        assert np.array_equal(getattr(one, word), getattr(other, word)), word


def test_a_scene_runs_what_the_same_arguments_run_in_python(written):
    scene = ContactScene.load(written())
    body = feet().mounted({"back": (100.0, 0.0)})
    problem = body.in_contact(Coulomb(0.4, 0.3), ("x",), "z", pushed=("top",))
    for label, begin, top in (("light", -1.0, -1.0), ("heavy", -2.0, ramp(-2.0, -4.0, 0.0, 1.0))):
        rest = press_contacts(problem, {"top": begin})
        run = step_contacts(problem, 1.0, step=0.01, inputs={"top": top, "surface.x": 0.03}, start=rest)
        equal(scene.run(label), run)
        assert run.share()[0] == 1.0 and run.share("slip").max() == 1.0


def test_the_begin_of_a_run_is_at_rest_under_the_forces_at_its_beginning(written):
    scene = ContactScene.load(written(SCENE.replace('"30 mm/s"', '"0 m/s"')))
    run = scene.run("light")
    assert run.normal.sum(axis=1) == pytest.approx(np.ones(101), rel=1e-9)
    assert np.ptp(run["top"]) < 1e-12 * abs(run["top"][0])


def test_a_body_that_its_forces_lift_off_has_no_rest_to_begin_from(written, tmp_path, capsys):
    path = written(SCENE.replace('"-1 N"', '"1 N"'))
    assert main(["simulate", str(path), "--controller", "light", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "Controller `light`: the body must be at rest under the forces at its beginning" in said and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


OWN = """
from dataclasses import dataclass
import numpy as np
from toolbox import FrictionLaw, Quantity, quantity
from toolbox.contacts import ContactBody, ContactProblem
from models import Coulomb


@dataclass(frozen=True)
class MySlidingBlock(ContactBody):
    '''A block on its face.'''

    mass: Quantity = quantity(2.0, "kg", "mass", above=0)
    load: Quantity = quantity(10.0, "N", "normal load", at_least=0)
    friction: FrictionLaw = Coulomb(0.4, 0.4)

    def problem(self):
        one = np.eye(1)
        ends = {"force_inputs": {"block.force": [1.0]}, "outputs": {"block": [1.0]}}
        return ContactProblem(self.mass * one, 0 * one, one[None], self.friction, load=[self.load], **ends)
"""


def test_a_body_of_ones_own_runs_where_its_file_is_loaded(tmp_path, capsys):
    (tmp_path / "my_sliding_block.py").write_text(OWN)
    (tmp_path / "block.toml").write_text(
        'title = "own"\nduration = "1 s"\nstep = "10 ms"\n[inputs]\n"block.force" = { ramp = { start = 0, end = "8 N", begin = 0, finish = 1 } }\n'
        '[[plant]]\npart = "MySlidingBlock"\nload = "10 N"\n'
    )
    assert main(["simulate", str(tmp_path / "block.toml")]) == 2
    assert "There is no part `MySlidingBlock`" in capsys.readouterr().err
    assert main(["simulate", str(tmp_path / "block.toml"), "--load", str(tmp_path / "my_sliding_block.py")]) == 0
    printed = capsys.readouterr().out
    assert (
        "100 steps to 1 s, 1 contacts (0% stick, 100% slip" in printed and "the last contact sticks at 0.5 s" in printed
    )  # where 8 t reaches mu N


def test_the_published_cube_runs_as_in_python_bit_for_bit_and_repeats_the_shared_area(root):
    path = root / "studies" / "scenes" / "elastic_face.toml"
    run = ContactScene.load(path).run("no controller")
    body = ReducedBody.load(path.with_suffix(".npz"))
    law = Exponential(static=0.35, kinetic=0.25, decay=1.0)
    problem = body.mounted({"back": (1e4, 5e3)}).in_contact(law, ("x", "y"), "z", pushed=("top",))
    assert problem.contacts == 121 and problem.contact_areas.sum() == pytest.approx(1e-4)
    plate = {"top": -10.0, "surface.x": ramp(0.0, 0.1, 0.0, 40.0)}
    equal(run, step_contacts(problem, 0.24, step=2e-3, inputs=plate, start=press_contacts(problem, {"top": -10.0})))
    found = study.measures(run)
    assert found["share at 0.16 s"] == pytest.approx(0.57, abs=0.05)
    assert found["share at 0.20 s"] == pytest.approx(0.26, abs=0.05)
    assert found["no node sticks from [s]"] == pytest.approx(0.2175, abs=0.005)
    assert 0.2275 <= found["full friction from [s]"] <= 0.230 + 1e-12


def test_a_string_under_a_sampled_law_runs_as_in_python_bit_for_bit_and_takes_the_drag_and_the_torque_of_the_closed_form(root, tmp_path):
    scene = ContactScene.load(root / "studies" / "scenes" / "string_on_wall.toml")
    axial = AxialChain(mass=(5000.0,) * 2, stiffness=(4e6,) * 2, damping=(2e5,) * 2)
    torsional = TorsionalChain(inertia=(2000.0, 100.0, 100.0), stiffness=(2000.0,) * 2, damping=(80.0,) * 2)
    problem = string_on_wall(axial, torsional, radius=0.1, loads=(2000.0, 5000.0), friction=Coulomb(0.3, 0.3), top_drive=True)
    law = PI(proportional="3 kN m s/rad", integral="2.5 kN m/rad", reference="20 rpm")
    for label, hook_speed in (("turned", 0.0), ("turned and lowered", 0.2)):
        run, rest = scene.run(label), press_contacts(problem)
        inputs = {"hook.speed": hook_speed} if hook_speed else {}
        equal(run, step_contacts(problem, 30.0, step=0.02, inputs=inputs, controller=law, sample_time=0.02, start=rest))
        drag, torque = sliding_resultant(0.3, 7000.0, hook_speed, 20 * math.pi / 30, 0.1)
        assert run.inputs["top.torque"][-1] == pytest.approx(torque, rel=2e-3)
        assert -4e6 * run["axial.0"][-1] == pytest.approx(drag, abs=1e-3 * 0.3 * 7000.0)
    assert -4e6 * scene.run("lowered")["axial.0"][-1] == pytest.approx(0.3 * 7000.0, rel=1e-3)  # without turning all of the drag
    run.to_csv(tmp_path / "run.csv")
    headings = (tmp_path / "run.csv").read_text().partition("\n")[0].split(",")
    assert {"axial.0 [m]", "bit [rad]", "bit.speed [rad/s]", "top.torque [N m]", "hook.speed [m/s]", "tangential 1 force [N]"} <= set(
        headings
    )


def test_of_many_contacts_the_table_leaves_their_displacements_to_the_data(root, tmp_path):
    scene = ContactScene.load(root / "studies" / "scenes" / "elastic_face.toml")
    run = dataclasses.replace(scene, duration=4e-3).run("no controller")
    headings = run.to_csv(tmp_path / "run.csv").read_text().partition("\n")[0].split(",")
    assert {"back [m]", "top [m]", "top [N]"} <= set(headings) and not {"x.0 [m]", "z.0 [m]"} & set(headings)
    with np.load(run.save(tmp_path / "run.npz")) as data:
        assert np.array_equal(data["output.z.0"], run["z.0"])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('sample_time = "20 ms"', "", "Controller `turned`: Argument `controller` must hold sampled laws: give `sample_time`"),
        (
            'sample_time = "20 ms"',
            'sample_time = "30 ms"',
            "Controller `turned`: Argument `sample_time` must be a whole number of steps of 0.02 s",
        ),
        (
            'sample_time = "20 ms"',
            'sample_time = "20 ms"\ndelay = "5 ms"',
            "Controller `turned`: Argument `delay` must be a whole number of steps",
        ),
        ('sample_time = "20 ms"', 'sample_time = "20 ms"\nnoise = { "top.sped" = 0.1 }', "top.speed"),
        ('law = "PI"', 'law = "P"', "There is no control law `P`"),
        ("top_drive = true", "", "Controller `turned`: Argument `controller` must drive an input of the body, `bit.weight`"),
        ('"hook.speed" = "0.2 m/s"', '"hook.speed" = "0.2 rpm"', "`hook.speed` must be in m/s"),
        ('loads = ["2 kN", "5 kN"]', 'loads = ["2 kN"]', "`loads` must be finite numbers >= 0"),
    ],
)
def test_what_is_wrong_with_a_law_or_its_body_is_said_before_anything_runs(root, tmp_path, old, new, words):
    text = (root / "studies" / "scenes" / "string_on_wall.toml").read_text()
    assert old in text
    (tmp_path / "string.toml").write_text(text.replace(old, new, 1))
    with pytest.raises(SceneError) as caught:
        ContactScene.load(tmp_path / "string.toml")
    assert words in str(caught.value)


@pytest.mark.slow
def test_the_file_of_the_published_cube_is_the_body_of_the_study(root):
    made, kept = study.face_body(), ReducedBody.load(root / "studies" / "scenes" / "elastic_face.npz")
    assert made.ports == kept.ports and np.array_equal(made.contact_positions, kept.contact_positions)
    for word in ("mass", "stiffness", "contact_areas"):
        assert getattr(made, word) == pytest.approx(getattr(kept, word), rel=1e-6, abs=1e-9 * np.abs(getattr(kept, word)).max()), word


def test_the_command_writes_report_figure_and_data_that_agree_with_the_run(written, tmp_path, capsys):
    path, out = written(), tmp_path / "out"
    assert main(["simulate", str(path), "--out", str(out)]) == 0
    stems = ("01_light", "02_heavy")
    assert {file.name for file in out.iterdir()} == {
        "simulate.txt",
        "origin.json",
        *(stem + tail for stem in stems for tail in (".npz", ".csv", ".png")),
    }
    run = ContactScene.load(path).run("heavy")
    run.error_estimate  # noqa: B018  as the command measures it
    lines = str(run).splitlines()
    printed = capsys.readouterr().out
    assert lines[1] in printed and lines[2] in printed and lines[3] in printed
    assert (out / "simulate.txt").read_text().startswith("Simulation of Block of two feet\n\nlight\n100 steps to 1 s, 2 contacts")
    with np.load(out / "02_heavy.npz", allow_pickle=False) as data:
        for word in ("time", "contact_modes", "normal", "tangential", "slip", "friction_work"):
            assert np.array_equal(data[word], getattr(run, word))
        assert np.array_equal(data["contact_positions"], feet().contact_positions) and np.array_equal(
            data["contact_areas"], feet().contact_areas
        )
        assert np.array_equal(data["output.back.speed"], run["back.speed"]) and np.array_equal(data["energy.elastic"], run.energy.elastic)
    with (out / "02_heavy.csv").open(newline="") as file:
        headings, *rows = csv.reader(file)
    table = dict(zip(headings, np.array(rows, float).T, strict=True))
    assert np.array_equal(table["stick"], run.share()) and np.array_equal(table["taken by friction [J]"], run.friction_work.sum(axis=1))
    assert np.array_equal(table["top [N]"], run.inputs["top"]) and np.array_equal(table["top [m]"], run["top"])
    assert np.array_equal(table["back.speed [m/s]"], run["back.speed"]) and np.array_equal(table["x.0 [m]"], run["x.0"])
    assert main(["simulate", str(path), "--controller", "light", "--duration", "0.5 s", "--format", "svg", "--out", str(out)]) == 0
    assert {file.name for file in out.iterdir()} == {"simulate.txt", "origin.json", "01_light.npz", "01_light.csv", "01_light.svg"}
    assert "50 steps to 0.5 s" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('step = "10 ms"', "", "The key `step` is missing in the scene"),
        ('step = "10 ms"', 'step = "10 mm"', "`step` must be in s"),
        ('step = "10 ms"', 'step = "-1 s"', "`step` must be > 0 s"),
        ('step = "10 ms"', 'stepp = "10 ms"', "There is no key `stepp` in the scene: did you mean `step`"),
        ('step = "10 ms"', 'step = "10 ms"\naccuracy = 1e-6', "There is no key `accuracy` in the scene"),
        ('"30 mm/s"', '"30 mm"', "`surface.x` must be in m/s"),
        ('"surface.x"', '"surface.y"', "There is no input `surface.y`: did you mean `surface.x`"),
        ('tangent = ["x"]', 'tangent = ["w"]', "There are no ports `w.0`"),
        ('tangent = ["x"]', "", "The key `tangent` is missing in `ElasticFace`"),
        ('tangent = ["x"]', 'tangent = ["x", "x"]', "words that differ"),
        ('normal = "z"', "", "Either `normal` must be given, for contacts that open and close, or `loads`"),
        ('tangent = ["x"]', 'tangent = "x"', "`tangent` of elasticface must be a row of strings"),
        ('body = "feet.npz"', "body = 3", "`ElasticFace.body`: it must be the path of a file, or a table"),
        ('normal = "z"', 'loads = ["1 N"]', "Argument `load` must be finite numbers >= 0 of the shape (2,)"),
        ('normal = "z"', 'loads = ["1 N", "-1 N"]', "`loads` of elasticface must be >= 0"),
        ('support_port = "back"', "", "must come with `support_port`"),
        ('support_port = "back"', 'support_port = "bak"', "There is no port `bak`: did you mean `back`"),
        ('"0.1 N/mm"', '"0.1 N"', "`ElasticFace.support_stiffness` must be in N/m"),
        ('"feet.npz"', '"foot.npz"', "did you mean `feet.npz`"),
        ('part = "ElasticFace"', 'part = "ElasticFac"', "did you mean `ElasticFace`"),
        ('label = "heavy"', 'label = "light"', "The labels of controllers must differ"),
        ("[[controllers]]\nlabel = \"light\"", '[[plant]]\npart = "BitRock"\n[[controllers]]\nlabel = "light"', "`plant` must be `ElasticFace` alone"),
        ('inputs = { top = "-1 N" }', 'law = "PI"\nproportional = 1\nintegral = 1', "Controller `light`"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_scene_is_said_with_its_key(written, old, new, words):
    assert old in SCENE
    path = written(SCENE.replace(old, new, 1))
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert words.lower() in str(caught.value).lower() and str(path) in str(caught.value)


@pytest.mark.parametrize(
    "command",
    [
        ["study", "SCENE", "--out", "OUT"],
        ["onset", "SCENE", "--range", "friction.static=0.1:0.4"],
        ["map", "SCENE", "--range", "a=1:2", "--range", "b=1:2", "--out", "OUT"],
        ["sweep", "SCENE", "--range", "top=1:2:3", "--out", "OUT"],
        ["tune", "SCENE", "--controller", "light", "--range", "a=1:2", "--objective", "severity", "--out", "OUT"],
        ["fit", "SCENE", "data.csv", "--range", "a=1:2", "--out", "OUT"],
        ["tradeoff", "SCENE"],
        ["compare", "SCENE", "SCENE"],
    ],
    ids=lambda command: command[0],
)
def test_commands_that_need_equations_say_what_runs_such_a_scene(written, tmp_path, capsys, command):
    path = written()
    given = [str({"SCENE": path, "OUT": tmp_path / "out"}.get(word, word)) for word in command]
    assert main(given) == 2
    said = capsys.readouterr().err
    assert "are stepped together, and `stickslip simulate` runs them" in said and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_run_that_fails_is_reported_as_far_as_it_went_beside_one_that_does_not(written, tmp_path, capsys, monkeypatch):
    solved = ContactSolver.solve

    def solve(self, given, last):  # two states of rest are looked for while the scene is read, and one before every run
        solve.calls += 1
        return None if solve.calls == 3 + 40 else solved(self, given, last)

    solve.calls = 0
    monkeypatch.setattr(ContactSolver, "solve", solve)
    assert main(["simulate", str(written()), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    light, heavy = printed.split("\nheavy\n")
    assert "failed: No set of open, sticking and sliding contacts solves the step at 0.4 s." in light and "39 steps to 0.39 s" in light
    assert "100 steps to 1 s" in heavy and "error: ask" not in heavy
    with np.load(tmp_path / "out" / "01_light.npz") as data:
        assert data["time"][-1] == pytest.approx(0.39)


@pytest.mark.parametrize("option", [["--method", "stiff"], ["--accuracy", "1e-3"]])
def test_options_of_other_methods_are_refused(written, capsys, option):
    assert main(["simulate", str(written()), *option]) == 2
    assert f"{option[0]} must be left out" in capsys.readouterr().err


def test_a_scene_of_a_plant_is_no_scene_of_contacts(root):
    with pytest.raises(SceneError, match="body with many contacts, such as ElasticFace, but its plant has equations"):
        ContactScene.load(root / "studies" / "scenes" / "block_on_belt.toml")


def test_a_scene_in_python_asks_for_a_body_with_contacts():
    scene = ContactScene("a body without contacts", ReducedBody(("x.0",), [[1.0]], [[0.0]], [[1.0]]), 1.0, 0.1)
    for ask in (scene.check, lambda: scene.run("no controller")):
        with pytest.raises(SceneError, match="`body` must be a body with many contacts, such as ElasticFace"):
            ask()
