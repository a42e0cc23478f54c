"""What a newcomer does wrong is answered with what to write instead; each of these was tried by somebody who had read the README alone."""

from __future__ import annotations

import numpy as np
import pytest

import toolbox
from controllers import BrakePI, SoftTorque, StiffPI
from models import BitRock, wells
from tests.plants import RIG
from toolbox import Sampled, Scene, SceneError, closed_loop, compose, margins, measure, onset, simulate, sweep, use_units
from toolbox.commands.command_line import main
from toolbox.errors import UnusualValue
from toolbox.simulation import TimeStepping


@pytest.mark.parametrize(
    "use, says",
    [
        (lambda: BitRock(weight="97,3 kN"), r"`97,3 kN` has a comma: a decimal point is written"),
        (lambda: BitRock(weight="1,000 N"), r"has a comma"),
        (lambda: BitRock(weight="97000"), r"has no unit: write a plain number, or `97000 N`"),
        (lambda: BitRock(weight="97 rpm"), r"must be in N, but `97 rpm` is in rpm"),
        (lambda: simulate(RIG, 5.0, controller=SoftTorque), r"but it is the class SoftTorque: give one of it, `SoftTorque\(\.\.\.\)`"),
        (lambda: simulate(RIG, 5.0, controller="SoftTorque"), r"must be a Controller, Sampled or a callable, but it is 'SoftTorque'"),
        (lambda: simulate(60.0, RIG), r"`plant` must be a plant made by `compose`"),
        (
            lambda: simulate(RIG, 5.0, inputs={"top.torque": np.ones(1000)}),
            r"but it is array\(.{50,60}: values need their times, `\(times, values\)`",
        ),
        (lambda: simulate(RIG, 5.0, inputs={"top.torque": [1e4, 2e4, 3e4]}), r"values need their times"),
        (lambda: simulate(RIG, 5.0, inputs={"top.torque": lambda t: 1e4}), r"write a formula of the symbol `toolbox.time`"),
        (lambda: simulate(RIG, 5.0, start={"bit.velocity": 1.0}), r"There is no state `bit.velocity`: .*(chain|bit)\.speed"),
        (lambda: simulate(RIG, 5.0, method="rk45"), r"must be one of 'event', .*, but it is 'rk45'\.$"),
        (lambda: simulate(RIG, 5.0, accuracy="1 kg"), r"`accuracy` must be a plain number"),
        (lambda: onset(RIG, "top.reference", (3, 14)), r"a set-point belongs to a control law, and there is none: give one .a scene: "),
        (lambda: onset(closed_loop(RIG, StiffPI()), "top.refrence", (3, 14)), r"did you mean `top.reference`"),
        (lambda: Scene.load("studies/scenes/jansen_2.toml").run(0), r"There is no controller `0`: known are `constant torque`"),
        (lambda: measure.severity(np.ones(1000)), r"must be a trajectory, as `simulate` returns it, but it is .{1,60}\.$"),
        (lambda: BitRock(weight="97 kn"), r"`97 kn` is in kn: did you mean `kN`\?$"),
        (lambda: compose(BitRock()), r"BitRock needs the signal `bit.speed` .*, but no part gives it: add a part that gives `bit.speed`"),
        (
            lambda: simulate(RIG, 5.0, controller=BrakePI()),
            r"BrakePI needs `inertia` and `radius` of a disc: .* a plant with a `DiscBrake`\.$",
        ),
        (lambda: sweep(closed_loop(RIG, StiffPI()), {"bit.weight": 6e4}, 5.0), r"must be a list of finite numbers, such as \[1\.0, 2\.0\]"),
        (lambda: sweep(closed_loop(RIG, StiffPI()), {"bit.weight": [6e4]}), r"`duration` must be given for a loop that does not come from"),
        (lambda: margins(closed_loop(RIG)), r"must contain a controller, but it has none: give one, `closed_loop\(plant, controller\)`"),
        (lambda: use_units("imperial"), r"known are `si`, `metric`, `oilfield`"),
    ],
)
def test_a_wrong_use_is_answered_with_what_to_write_instead(use, says):
    with pytest.raises(SceneError, match=says):
        use()


def test_a_well_that_there_is_not_is_told_the_nearest():
    with pytest.raises(AttributeError, match="There is no well `JANSEN`: did you mean `JANSEN_2`"):
        wells.JANSEN  # noqa: B018


def test_a_misspelt_argument_or_name_is_told_the_nearest():
    with pytest.raises(TypeError, match=r"BitRock has no argument `wieght`: did you mean `weight`\?"):
        BitRock(wieght="97 kN")
    with pytest.raises(AttributeError, match=r"there is no `simulat` in `toolbox`: did you mean `simulate`\?"):
        toolbox.simulat  # noqa: B018


def test_a_sample_time_in_milliseconds_without_unit_warns():
    with pytest.warns(UnusualValue, match=r"`period` is 10 s, .* Did you mean `10 ms`"):
        Sampled(SoftTorque(reference="60 rpm"), 10)


def test_a_step_may_be_text_with_a_unit():
    assert simulate(RIG, 0.01, method=TimeStepping("1 ms")).time.size == 11


def test_a_scene_with_a_unit_outside_quotes_is_told_so(tmp_path):
    (tmp_path / "well.toml").write_text('duration = "60 s"\n[[plant]]\npart = "BitRock"\nweight = 97 kN\n')
    with pytest.raises(SceneError, match='A number with a unit needs quotes: "97 kN"'):
        Scene.load(tmp_path / "well.toml")


def test_a_misspelt_command_is_told_the_nearest(capsys):
    with pytest.raises(SystemExit):
        main(["stdy", "well.toml"])
    assert "there is no command `stdy`: did you mean `study`" in capsys.readouterr().err
