"""Scenes: what a file says is what is simulated, what is saved is what was loaded, and every mistake is one clear error."""

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from controllers import Lifting, SlidingMode, SoftTorque, StiffPI, StringObserverController
from controllers.observers import Kalman
from models import BitRock, Block, BlockOnBelt, Coulomb, Exponential, wells
from toolbox import Sampled, SceneError, compose, simulate
from toolbox.inputs import sine
from toolbox.scenes.cases import Case, Waveform
from toolbox.scenes.scene import Scene

SCENES = Path(__file__).parents[2] / "studies" / "scenes"

RIG = """
title = "rig"
duration = "2 min"
accuracy = 1e-7
reference = "120 rpm"

[[plant]]
part = "wells.JANSEN_2"
bit_drag = "60 N m s/rad"

[[plant]]
part = "BitRock"
weight = "97.347 kN"
friction = { law = "Exponential", static = 0.8, decay = "0.9 s/rad" }

[start]
"chain.speed" = ["30 rpm", 1.0]

[inputs]
"bit.weight" = { ramp = { start = "50 kN", end = "97 kN", begin = 0, finish = "0.5 min" } }

[parameters]
"bit.friction.static" = 0.85
"chain.inertia.0" = "2.2 t m2"

[verdict]
element = "bit"
signal = "bit.speed"
effort = "top.torque"
after = "60 s"

[[controllers]]
label = "open loop"
inputs = { "top.torque" = "10 kN m" }

[[controllers]]
label = "stiff PI, 100 Hz"
law = "StiffPI"
proportional = "15 kN m s/rad"
sample_time = "10 ms"
delay = "3 ms"

[[controllers]]
label = "sliding mode"
law = "SlidingMode"
inputs = { "top.reference" = { table = { times = [0, 10, 10], values = ["60 rpm", "60 rpm", "120 rpm"] } } }
"""

BELT = """
title = "belt"
duration = 50
[[plant]]
part = "BlockOnBelt"
"""


@pytest.fixture
def written(tmp_path):
    """Write text to a scene file and return its path."""

    def write(text):
        path = tmp_path / "scene.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_every_quantity_of_a_file_arrives_in_si(written):
    scene = Scene.load(written(RIG))
    rpm = math.pi / 30
    law = Exponential(static=0.8, kinetic=0.5, decay=0.9)
    assert scene == Scene(
        title="rig",
        parts=(replace(wells.JANSEN_2, bit_drag=60.0), BitRock(weight=97_347.0, friction=law)),
        cases=(
            Case("open loop", inputs={"top.torque": 10_000.0}),
            Case("stiff PI, 100 Hz", StiffPI(proportional=15_000.0, reference=120 * rpm), 0.01, 0.003),
            Case(
                "sliding mode",
                SlidingMode(reference=120 * rpm),
                inputs={"top.reference": Waveform("table", {"times": (0.0, 10.0, 10.0), "values": (60 * rpm, 60 * rpm, 120 * rpm)})},
            ),
        ),
        duration=120.0,
        element="bit",
        signal="bit.speed",
        effort="top.torque",
        after=60.0,
        accuracy=1e-7,
        reference=120 * rpm,
        start={"chain.speed": (30 * rpm, 1.0)},
        inputs={"bit.weight": Waveform("ramp", {"start": 50_000.0, "end": 97_000.0, "begin": 0.0, "finish": 30.0})},
        parameters={"bit.friction.static": 0.85, "chain.inertia.0": 2200.0},
    )


def test_what_is_not_said_follows_from_the_plant(written):
    scene = Scene.load(written(BELT))
    assert scene.parts == (BlockOnBelt(),)
    assert scene.cases == (Case("no controller"),)
    assert (scene.element, scene.signal, scene.effort) == ("belt", "belt.slip", "block.force")
    assert (scene.duration, scene.after, scene.accuracy, scene.reference) == (50.0, 25.0, 1e-6, None)


def test_a_scene_simulates_what_the_same_arguments_simulate(written):
    scene = replace(Scene.load(written(RIG)), duration=20.0, after=10.0)
    rig = compose(replace(wells.JANSEN_2, bit_drag=60.0), BitRock(weight=97_347.0))
    expected = simulate(
        rig,
        20.0,
        start={"chain.speed": [math.pi, 1.0]},
        inputs={"bit.weight": ([0.0, 30.0], [50_000.0, 97_000.0]), "top.torque": 10_000.0},
        parameters={"bit.friction.static": 0.85, "chain.inertia": (2200.0, 374.0)},
        accuracy=1e-7,
    )
    run = scene.run("open loop")
    assert run.events == expected.events
    assert np.array_equal(run["bit.speed"], expected["bit.speed"])


STEPPED = ("elastic_face", "string_on_wall")  # bodies with many contacts


@pytest.mark.parametrize("name", sorted(path.stem for path in SCENES.glob("*.toml") if path.stem not in STEPPED))
def test_saving_and_loading_gives_an_equal_scene(root, tmp_path, name):
    scene = Scene.load(root / "studies" / "scenes" / f"{name}.toml")
    assert Scene.load(scene.save(tmp_path / "again.toml")) == scene


def test_the_saved_scene_of_every_feature_is_equal_and_holds_every_parameter_in_si(written, tmp_path):
    scene = Scene.load(written(RIG))
    path = scene.save(tmp_path / "resolved.toml")
    assert Scene.load(path) == scene
    text = path.read_text()
    for line in ("weight = 97347.0", "radius = 0.155575", "kinetic = 0.5", "bit_drag = 60.0", "integral = 2000.0", "sample_time = 0.01"):
        assert line in text
    parameters, _, units = text.partition("[units]")
    assert "kN" not in parameters and "rpm" not in parameters and 'N = "kN"' in units
    assert path.read_bytes() == Scene.load(path).save(tmp_path / "twice.toml").read_bytes()


def test_numbers_keep_every_digit(tmp_path):
    mass = 1 / 3 + 1e-16
    scene = Scene(
        "odd", (BlockOnBelt(mass=mass, friction=Coulomb(0.1 + 0.2, 0.1)),), (Case("a"),), 1e3 / 7, "belt", "belt.slip", "block.force", 0.1
    )
    assert Scene.load(scene.save(tmp_path / "odd.toml")) == scene


def test_shapes_of_inputs_become_the_inputs_of_the_same_name(written):
    shapes = {
        "step": '{ before = 0, after = "2 N", at = "5 s" }',
        "ramp": "{ start = 0, end = 1, begin = 0, finish = 9 }",
        "sine": '{ mean = 0, amplitude = "0.1 N", frequency = "2 Hz", phase = "90 deg" }',
        "sweep": '{ mean = 0, amplitude = 0.1, start = "1 Hz", end = "2 Hz", duration = "1 min" }',
        "noise": '{ mean = 0, deviation = "0.1 N", corner = "1 Hz", seed = 4 }',
        "table": "{ times = [0, 1], values = [0, 1] }",
    }
    for shape, numbers in shapes.items():
        scene = Scene.load(written(BELT + f'[inputs]\n"block.force" = {{ {shape} = {numbers} }}\n'))
        assert scene.inputs["block.force"].shape == shape
        scene.run("no controller")
    without_phase = Scene.load(written(BELT + '[inputs]\n"block.force" = { sine = { mean = 0, amplitude = 1, frequency = 1 } }\n'))
    assert without_phase.inputs["block.force"].build() == sine(0.0, 1.0, 1.0)


def test_a_friction_law_may_be_changed_without_naming_it_again(written):
    scene = Scene.load(written(BELT + "friction = { static = 1.5 }\n"))
    assert scene.parts[0].friction == replace(BlockOnBelt().friction, static=1.5)


def test_a_law_of_a_straight_contact_takes_its_decay_per_metre(written):
    text = BELT + 'friction = { law = "Exponential", decay = "2 s/mm" }\n'
    assert Scene.load(written(text)).parts[0].friction == Exponential(decay=2000.0)
    with pytest.raises(SceneError, match="must be in s/rad"):
        Scene.load(written(text.replace("s/mm", "kg")))


LIFTING = """
[[controllers]]
label = "lifting"
law = "SoftTorque"
highest_torque = "20 kN m"
inside = "Lifting"
sample_time = "10 ms"
delay = "30 ms"

[[controllers]]
label = "on estimates, lifting"
law = "SlidingMode"
reference = "50 rpm"
inside = [
    { law = "StringObserverController", delay_samples = 3, observer = { law = "observers.Kalman", speed_noise = "0.1 rpm" } },
    { law = "Lifting", first_factor = 1.6, observer = { torque_walk = 3000.0 } },
]
sample_time = "10 ms"
"""
"""Two laws inside others, for the end of `RIG`."""


def test_a_law_may_stand_inside_others_which_take_the_set_point_too(written, tmp_path):
    scene = Scene.load(written(RIG + LIFTING))
    assert scene.case("lifting").law == Lifting(SoftTorque(reference="120 rpm", highest_torque=20e3), reference="120 rpm")
    inner = StringObserverController(SlidingMode(reference="50 rpm"), Kalman(speed_noise="0.1 rpm"), delay_samples=3)
    around = Lifting(inner, reference="120 rpm", first_factor=1.6, observer=Kalman(torque_process_noise=3000.0))
    assert scene.case("on estimates, lifting").law == around
    assert Scene.load(scene.save(tmp_path / "again.toml")).cases == scene.cases


def test_a_law_inside_another_acts(written):
    slow = (RIG + LIFTING).replace('reference = "120 rpm"', 'reference = "40 rpm"').replace('"bit.friction.static" = 0.85', "")
    scene = Scene.load(written(slow))
    run = scene.run("lifting")
    assert run["lifting.lifts"][-1] >= 1
    assert run.time_in("bit", "stick") and not run.time_in("bit", "stick", after=100.0)


def test_the_set_point_of_a_law_wins_over_that_of_the_scene(written):
    text = RIG.replace('proportional = "15 kN m s/rad"', 'reference = "60 rpm"')
    scene = Scene.load(written(text))
    assert scene.case("stiff PI, 100 Hz").law.reference == 2 * math.pi
    assert scene.case("sliding mode").law.reference == 4 * math.pi


def test_two_parts_of_a_kind_get_names(written):
    text = 'title = "two"\nduration = 5\nverdict = { element = "second.belt" }\n[[plant]]\npart = "BlockOnBelt"\n'
    text += '[[plant]]\npart = "BlockOnBelt"\nname = "second"\n'
    assert Scene.load(written(text)).parts[1].name == "second"
    with pytest.raises(SceneError, match="which of `belt`, `second.belt`"):
        Scene.load(written(text.replace('verdict = { element = "second.belt" }\n', "")))


ALONG_A_HOLE = """
title = "friction along the hole"
duration = 5
[[plant]]
part = "DrillString"
sections = "sections.csv"
survey = "survey.csv"
top_inertia = 2000
elements = 8
friction = { law = "Coulomb" }
[[plant]]
part = "BitRock"
"""


def test_a_string_on_its_hole_and_a_bit_on_the_rock_are_told_what_to_say(written, tmp_path):
    (tmp_path / "sections.csv").write_text("length [m],OD [in],ID [in],material\n2000,5,4.276,steel\n")
    (tmp_path / "survey.csv").write_text("MD [m],Inc [deg],Azi [deg]\n0,60,0\n2000,60,0\n")
    for element in ("chain.8", "bit"):  # hole and rock at the last inertia are one friction, and either may be judged
        assert Scene.load(written(f'{ALONG_A_HOLE}[verdict]\nelement = "{element}"\n')).plant().shared_modes["bit"][0] == "chain.8"
    on_bottom = ALONG_A_HOLE.replace("elements", "on_bottom = true\nelements")
    with pytest.raises(
        SceneError, match=r'which of `chain.0`, ..., `chain.7`, `bit` is to be judged\? .* \[verdict\], such as `element = "bit"`'
    ):
        Scene.load(written(on_bottom))
    assert Scene.load(written(f'{on_bottom}[verdict]\nelement = "bit"\n')).element == "bit"


def test_a_scene_loads_with_twice_as_many_elements(written, tmp_path):
    (tmp_path / "sections.csv").write_text("length [m],OD [in],ID [in],material\n2000,5,4.276,steel\n")
    (tmp_path / "survey.csv").write_text("MD [m],Inc [deg],Azi [deg]\n0,60,0\n2000,60,0\n")
    text = f'{ALONG_A_HOLE}[verdict]\nelement = "bit"\n'
    for path in (written(text), written(text.replace("elements = 8\n", 'band = "1 Hz"\n'))):
        own, finer = Scene.load(path).parts[0], Scene.load(path, refined=True).parts[0]
        assert finer.element_count == 2 * own.element_count
        assert sum(finer.inertia) == pytest.approx(sum(own.inertia))
    with pytest.raises(SceneError, match="no number of elements can be doubled"):
        Scene.load(written(RIG), refined=True)


def edited(*pair):
    old, new = pair
    assert old in RIG
    return RIG.replace(old, new)


MISTAKES = [
    # TOML
    ("title = ", "must be TOML"),
    ("[[plant]", "must be TOML"),
    ("x = " + "[" * 5000, "must be TOML"),
    # keys
    ("", "key `title` is missing"),
    (edited('title = "rig"', ""), "key `title` is missing"),
    (edited('duration = "2 min"', ""), "key `duration` is missing"),
    (edited("duration =", "durations ="), "no key `durations` in the scene: did you mean `duration`"),
    (edited("weight =", "wieght ="), "no key `wieght` in `BitRock`: did you mean `weight`"),
    (edited("decay =", "decai ="), "no key `decai` in `BitRock.friction`: did you mean `decay`"),
    (edited("proportional =", "proportionnal ="), "no key `proportionnal` in `StiffPI`: did you mean `proportional`"),
    (edited("delay =", "delai ="), "no key `delai` in `StiffPI`: did you mean `delay`"),
    (edited("after =", "aftre ="), "no key `aftre` in verdict: did you mean `after`"),
    (edited("begin =", "beginn ="), "no key `beginn` in bit.weight.ramp: did you mean `begin`"),
    (edited(', finish = "0.5 min"', ""), "key `finish` is missing in bit.weight.ramp"),
    (edited('part = "BitRock"', ""), "key `part` is missing in plant[2]"),
    (edited('label = "open loop"', ""), "key `label` is missing in controllers[1]"),
    (edited('label = "open loop"', 'label = "open loop"\nproportional = 3'), "no key `proportional` in controller `open loop`, which has no `law`"),
    (edited('sample_time = "10 ms"', ""), "`delay` of `stiff PI, 100 Hz` must come with `sample_time`"),
    # names
    (edited('"BitRock"', '"BitRok"'), "no part `BitRok`: did you mean `BitRock`"),
    (edited('"wells.JANSEN_2"', '"wells.JANSEN_3"'), "no part `wells.JANSEN_3`: did you mean `wells.JANSEN_2`"),
    (edited('"BitRock"', '"StiffPI"'), "must be a part, but it is a control law"),
    (edited('"BitRock"', '"os.system"'), "There is no part `os.system`"),
    (edited('"BitRock"', "3"), "must be text"),
    (edited('"Exponential"', '"Exponentail"'), "no friction law `Exponentail`: did you mean `Exponential`"),
    (edited('"StiffPI"', '"StifPI"'), "no control law `StifPI`: did you mean `StiffPI`"),
    (edited('element = "bit"', 'element = "bitt"'), "`bitt`: did you mean `bit`"),
    (edited('signal = "bit.speed"', 'signal = "bit.sped"'), "no signal `bit.sped`: did you mean `bit.speed`"),
    (edited('effort = "top.torque"', 'effort = "top.torqe"'), "no signal `top.torqe`: did you mean `top.torque`"),
    (edited('"chain.speed" =', '"chain.sped" ='), "no signal `chain.sped`: did you mean `chain.speed`"),
    (edited('"bit.weight" =', '"bit.wieght" ='), "no input `bit.wieght`: did you mean `bit.weight`"),
    (edited('"bit.friction.static" =', '"bit.friction.statik" ='), "no parameter `bit.friction.statik`: did you mean `bit.friction.static`"),
    (edited("ramp =", "rampe ="), "`bit.weight` must be a number or one of `step`, `ramp`"),
    (edited('label = "sliding mode"', 'label = "open loop"'), "labels of controllers must differ, but `open loop`"),
    (edited('signal = "bit.speed"', 'signal = "chain.speed"'), "must name scalars, but `chain.speed`"),
    # units and numbers
    (edited("97.347 kN", "97.347 kg"), "`BitRock.weight` must be in N, but `97.347 kg` is in kg"),
    (edited("120 rpm", "2 Hz"), "`reference` must be in rad/s"),
    (edited("97.347 kN", "97.347 kNN"), "unknown unit `kNN`: did you mean `kN`"),
    (edited("2 min", "2 m"), "`duration` must be in s"),
    (edited("10 kN m", "10 kN"), "`top.torque` must be in N m"),
    (edited('"30 rpm", 1.0', '"30 rpm", 1.0, 2.0'), "must have shape (2,)"),
    (edited("2.2 t m2", "2.2 t"), "`chain.inertia.0` must be in kg m2"),
    (edited('"97.347 kN"', "-97347.0"), "must be >= 0 N, but it is -97347.0"),
    (edited('"97.347 kN"', "nan"), "must be a finite number >= 0 N"),
    (edited('"97.347 kN"', "inf"), "must be a finite number >= 0 N"),
    (edited('"97.347 kN"', "true"), "`weight` of BitRock must be a number in N"),
    (edited('"97.347 kN"', "[97347.0]"), "`weight` of BitRock must be one number in N"),
    (edited('"97.347 kN"', "{ law = 1 }"), "`weight` of BitRock must be a number"),
    (edited('bit_drag = "60 N m s/rad"', "inertia = 3.0"), "must be a row of numbers"),
    (edited('bit_drag = "60 N m s/rad"', "inertia = [3.0, 2.0, 1.0]"), "must have 2 entries"),
    (edited('bit_drag = "60 N m s/rad"', "inertia = [3.0, 0.0]"), "must be > 0 kg m2"),
    (edited('bit_drag = "60 N m s/rad"', "name = 3"), "`name` of TorsionalChain must be"),
    (edited('{ law = "Exponential", static = 0.8, decay = "0.9 s/rad" }', '"Exponential"'), "must be a table with `law`"),
    (edited("static = 0.8,", "static = 0.3,"), "must be <= the static coefficient"),
    (edited("duration = \"2 min\"", "duration = -1"), "`duration` must be > 0 s"),
    (edited("duration = \"2 min\"", "duration = 0"), "`duration` must be > 0 s"),
    (edited("accuracy = 1e-7", "accuracy = 1"), "`accuracy` must be >= 1e-13 and <= 0.1"),
    (edited("accuracy = 1e-7", 'accuracy = "fine"'), "`accuracy` must be a finite number"),
    (edited('after = "60 s"', 'after = "3 min"'), "`verdict.after` must be"),
    (edited('sample_time = "10 ms"', "sample_time = 0"), "`sample_time` must be > 0 s"),
    (edited('delay = "3 ms"', 'delay = "-3 ms"'), "`delay` must be >= 0 s"),
    (edited("times = [0, 10, 10]", "times = [0, 10, 9]"), "must have non-decreasing times"),
    (edited("times = [0, 10, 10]", "times = [0, 10]"), "must have as many times as values"),
    (edited("times = [0, 10, 10]", "times = 0"), "must be a list of numbers"),
    # types
    (edited('title = "rig"', 'title = "two\\nlines"'), "`title` must be text in one line"),
    (edited('title = "rig"', "title = 3"), "`title` must be text"),
    (edited('title = "rig"', "title = \"rig\"\ninputs = 3"), "must be TOML"),  # twice the same table
    ("title = 'a'\nduration = 1\nplant = 3", "must be written as [[plant]]"),
    ("title = 'a'\nduration = 1\nplant = [3]", "`plant[1]` must be a table"),
    ("title = 'a'\nduration = 1\nplant = []", "needs at least one part"),
    ("title = 'a'\nduration = 1\n[[plant]]\npart = 'wells.JANSEN_2'", "must have a contact that can stick"),
    ("title = 'a'\nduration = 1\nstart = 3\n[[plant]]\npart = 'BlockOnBelt'", "`start` must be a table"),
    ("title = 'a'\nduration = 1\ncontrollers = 3\n[[plant]]\npart = 'BlockOnBelt'", "must be written as [[controllers]]"),
    ("title = 'a'\nduration = 1\n[[plant]]\npart = 'BitRock'", "BitRock needs the signal `bit.speed`"),
    (BELT + "[[controllers]]\nlabel = 'pi'\nlaw = 'StiffPI'", "Controller `pi`: "),
    # laws inside others
    (edited('law = "SlidingMode"', 'law = "Lifting"'), '`Lifting` acts around another law: name that one under `law`, and write `inside = "Lifting"`'),
    (edited('law = "SlidingMode"', 'law = "SlidingMode"\ninside = "PI"'), "`sliding mode.inside[1]` must name a law that acts around another one, but `PI`"),
    (edited('law = "SlidingMode"', 'law = "SlidingMode"\ninside = "Lifing"'), "no control law `Lifing`: did you mean `Lifting`"),
    (edited('law = "SlidingMode"', 'law = "SlidingMode"\ninside = 3'), "`sliding mode.inside[1]` must be a table"),
    (edited('law = "SlidingMode"', 'law = "SlidingMode"\ninside = { first_factor = 2 }'), "key `law` is missing in sliding mode.inside[1]"),
    (edited('law = "SlidingMode"', 'law = "SlidingMode"\ninside = { law = "Lifting", frist_factor = 2 }'), "did you mean `first_factor`"),
    (edited('law = "SlidingMode"', 'law = "SlidingMode"\ninside = { law = "Lifting", observer = 3 }'), "`Lifting.observer` must be a table with `law`"),
    (edited('law = "SlidingMode"', 'law = "SlidingMode"\ninside = { law = "Lifting", observer = { law = "PI" } }'), "`observer` must be a StringObserver"),
    (edited('law = "SlidingMode"', 'law = "SlidingMode"\ninside = "StringObserverController"'), "The key `observer` is missing in `StringObserverController`"),
    (edited('label = "open loop"', 'label = "open loop"\ninside = "Lifting"'), "no key `inside` in controller `open loop`, which has no `law`"),
    (edited('law = "SlidingMode"', 'law = "IdealSlidingMode"\nsample_time = "10 ms"'), "Controller `sliding mode`: IdealSlidingMode has no sampled form"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "words"), MISTAKES)
def test_a_mistake_in_a_scene_is_one_error_that_names_the_file_and_the_key(written, text, words):
    path = written(text)
    with pytest.raises(SceneError) as caught:
        Scene.load(path)
    assert str(caught.value).startswith(f"Scene `{path}`: ")
    assert words in str(caught.value)


def test_a_file_that_is_missing_or_no_text_is_named(tmp_path, written):
    written(BELT)
    with pytest.raises(SceneError, match="There is no file `.*`: did you mean `scene.toml`"):
        Scene.load(tmp_path / "scen.toml")
    with pytest.raises(SceneError, match="There is no file"):
        Scene.load(tmp_path / "nowhere" / "scene.toml")
    with pytest.raises(SceneError, match="cannot be read"):
        Scene.load(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SceneError, match="must be text in UTF-8"):
        Scene.load(tmp_path / "binary.toml")


def test_loading_a_scene_compiles_and_simulates_nothing(written):
    code = f"import sys; from toolbox.scenes.scene import Scene; Scene.load({str(written(RIG))!r}); print('llvmlite' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60).stdout == "False\n"


def test_a_scene_that_cannot_be_written_leaves_the_old_file_as_it_was(written, tmp_path, monkeypatch):
    scene = Scene.load(written(BELT))
    target = tmp_path / "kept.toml"
    target.write_text("mine")
    monkeypatch.setattr("os.replace", lambda *names: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        scene.save(target)
    assert target.read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept.toml", "scene.toml"]
    with pytest.raises(SceneError, match="Cannot write"):
        scene.save(tmp_path / "nowhere" / "scene.toml")


def test_a_part_outside_the_catalogue_cannot_be_saved(written, tmp_path):
    class Private(BlockOnBelt):
        pass

    scene = replace(Scene.load(written(BELT)), parts=(Private(),))
    with pytest.raises(SceneError, match="must be in the catalogue"):
        scene.save(tmp_path / "private.toml")
    assert not (tmp_path / "private.toml").exists()


def test_a_file_that_begins_with_a_byte_order_mark_is_read(tmp_path):
    (tmp_path / "mark.toml").write_bytes(b"\xef\xbb\xbf" + BELT.encode())
    assert Scene.load(tmp_path / "mark.toml").title == "belt"


def test_an_unknown_label_is_answered_with_the_nearest(written):
    with pytest.raises(SceneError, match="did you mean `open loop`"):
        Scene.load(written(RIG)).run("open lop")


# --- sensors

SENSORS = 'delay = "3 ms"\nnoise = { "top.speed" = "0.1 rpm" }\nresolution = { "top.speed" = 0.002 }\nseed = 7\n'


def test_the_sensors_of_a_sampled_law_are_read_run_and_saved(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(RIG.replace('delay = "3 ms"\n', SENSORS).replace('"2 min"', '"2 s"').replace('after = "60 s"', 'after = "1 s"'))
    scene = Scene.load(path)
    case = scene.case("stiff PI, 100 Hz")
    assert (case.noise["top.speed"], case.resolution["top.speed"], case.seed) == (pytest.approx(0.1 * 2 * math.pi / 60), 0.002, 7)
    assert Scene.load(scene.save(tmp_path / "again.toml")).case(case.label) == case
    noisy, silent = scene.run(case.label), replace(scene, cases=(replace(case, noise={}, resolution={}),)).run(case.label)
    assert np.abs(noisy.at(1.9)["top.speed"] - silent.at(1.9)["top.speed"]) > 1e-6
    np.testing.assert_array_equal(noisy["top.speed"], scene.run(case.label)["top.speed"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('delay = "3 ms"\n', 'noise = { "top.sped" = 0.1 }\n', "top.sped"),
        ('delay = "3 ms"\n', 'noise = { "bit.speed" = 0.1 }\n', "bit.speed"),
        ('delay = "3 ms"\n', 'noise = { "top.speed" = "3 m" }\n', "noise.top.speed"),
        ('delay = "3 ms"\n', "resolution = 0.1\n", "resolution"),
        ('delay = "3 ms"\n', "seed = -1\n", "seed"),
        (
            'sample_time = "10 ms"\ndelay = "3 ms"\n',
            'noise = { "top.speed" = 0.1 }\n',
            "`noise` of `stiff PI, 100 Hz` must come with `sample_time`",
        ),
    ],
    ids=["unknown", "not measured", "unit", "no table", "seed", "continuous"],
)
def test_wrong_sensors_are_one_clear_error(tmp_path, old, new, message):
    path = tmp_path / "scene.toml"
    path.write_text(RIG.replace(old, new))
    with pytest.raises(SceneError, match=message.replace(".", r"\.")):
        Scene.load(path)


def test_a_scene_made_of_a_plant_and_laws_is_that_of_a_file_that_does_not_say_how_to_judge(tmp_path):
    text = """
        title = "Two inertias"
        duration = 120.0
        reference = 9.9
        plant = [{ part = "wells.JANSEN_2" }, { part = "BitRock", weight = 97_347.0 }]
        [[controllers]]
        label = "soft torque"
        law = "SoftTorque"
        sample_time = 0.01
        delay = 0.02
        noise = { "top.speed" = 0.01 }
        [[controllers]]
        label = "stiff"
        law = "StiffPI"
    """
    path = tmp_path / "rig.toml"
    path.write_text(text)
    soft = Sampled(SoftTorque(reference=9.9), 0.01, delay=0.02, noise={"top.speed": 0.01})
    rig = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
    made = Scene.of(rig, 120.0, {"soft torque": soft, "stiff": StiffPI(reference=9.9)}, title="Two inertias")
    assert made == Scene.load(path)
    assert made.run("stiff").time_in("bit", "stick", after=60.0) > 10.0
    belt = Scene.of(compose(BlockOnBelt()), 30.0)
    assert (belt.element, belt.signal, belt.effort, belt.labels, belt.reference) == (
        "belt",
        "belt.slip",
        "block.force",
        ["no controller"],
        None,
    )
    two = Scene.of(rig, 120.0, {"slow": StiffPI(reference=3.0), "fast": StiffPI(reference=9.0)})
    assert two.reference is None  # laws that want different speeds


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((BlockOnBelt(), 30.0), "`plant` must be a plant"),
        ((compose(BlockOnBelt()), "30 m"), "`duration` must be"),
        ((compose(BlockOnBelt()), 30.0, {"mine": lambda t, y: 0.0}), "`controller` must be"),
        ((compose(Block()), 30.0), "must have a contact"),
    ],
)
def test_a_scene_is_not_made_of_what_it_cannot_hold(arguments, words):
    with pytest.raises(SceneError, match=words):
        Scene.of(*arguments)
    with pytest.raises(SceneError, match="did you mean `belt`"):
        Scene.of(compose(BlockOnBelt()), 30.0, element="bely")


def test_a_scene_prints_its_plant_and_its_cases():
    path = Path(__file__).parents[2] / "studies" / "scenes" / "jansen_2.toml"
    text = str(Scene.load(path))
    assert "TorsionalChain + BitRock, 120 s, judged by `bit` and `bit.speed`" in text
    assert "constant torque: no law" in text and "late: SlidingMode, every 0.01 s, 0.02 s late" in text
    assert max(map(len, text.splitlines())) < 120


def test_a_scene_or_a_part_where_a_plant_belongs_is_refused_in_one_short_line_that_says_what_to_write():
    scene = Scene.load(Path(__file__).parents[2] / "studies" / "scenes" / "jansen_2.toml")
    for wrong, words in (
        (scene, "a Scene, which runs its cases itself: `scene.run"),
        (scene.parts[0], r"a TorsionalChain: `compose\(TorsionalChain"),
    ):
        with pytest.raises(SceneError, match=f"made by `compose`, but it is {words}.{{,16}}$"):
            simulate(wrong, 1.0)
