"""What a newcomer does wrong is answered with what to write instead; each of these was tried by somebody who had read the README alone."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import SoftTorque, StiffPI
from models import BitRock, wells
from tests.plants import RIG
from toolbox import Scene, SceneError, closed_loop, measure, onset, simulate, use_units


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
        (lambda: use_units("imperial"), r"known are `si`, `metric`, `oilfield`"),
    ],
)
def test_a_wrong_use_is_answered_with_what_to_write_instead(use, says):
    with pytest.raises(SceneError, match=says):
        use()


def test_a_well_that_there_is_not_is_told_the_nearest():
    with pytest.raises(AttributeError, match="There is no well `JANSEN`: did you mean `JANSEN_2`"):
        wells.JANSEN  # noqa: B018
