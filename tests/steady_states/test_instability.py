"""The sentence about a controller under which smooth running is unstable, beside runs that start near smooth running."""

import re

import numpy as np
import pytest

from controllers import SoftTorque, StiffPI, ZTorque
from tests.plants import RIG
from toolbox import Sampled, closed_loop, simulate
from toolbox.commands.command_line import main
from toolbox.steady_states.instability import instability
from toolbox.steady_states.steady_loop import smooth_start

WEIGHT = {"bit.weight": "97.347 kN"}


def swing(loop, duration):
    """Times of the upper peaks of the speed of the bit and half of how much lower the next trough is, in a run that starts near smooth running."""
    run = simulate(loop.replace(start=smooth_start(loop)), duration, output_times=np.arange(0.0, duration, 0.01))
    speed = run["bit.speed"]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(speed)))) + 1
    halves = 0.5 * (speed[turns[:-1]] - speed[turns[1:]])
    return run.time[turns[:-1]][halves > 0.0], halves[halves > 0.0]


def test_a_swing_doubles_in_the_time_that_is_said():
    loop = closed_loop(RIG, Sampled(ZTorque(reference=8.0), "10 ms", delay="200 ms"), inputs=WEIGHT)
    words = instability(loop)
    assert words.startswith("Smooth running is unstable with these sample times and delays") and words.endswith("without them is stable.")
    doubles = float(re.search(r"doubles every ([\d.]+) s", words)[1])
    times, heights = swing(loop, 60.0)
    late = (times > 17.0) & (heights < 2.0)
    rate = np.polyfit(times[late], np.log(heights[late]), 1)[0]
    assert late.sum() > 4 and np.log(2.0) / rate == pytest.approx(doubles, rel=0.02)


def test_nothing_is_said_of_a_loop_in_which_a_swing_decays():
    loop = closed_loop(RIG, Sampled(SoftTorque(reference=9.9), "10 ms", delay="30 ms"), inputs=WEIGHT)
    times, heights = swing(loop, 60.0)
    assert instability(loop) == "" and heights[times > 40.0].max() < 0.5 * heights[times < 20.0].max()


def test_sampling_is_not_blamed_for_what_the_controller_does_without_it():
    for loop in (
        closed_loop(RIG, StiffPI(reference=3.0), inputs=WEIGHT),
        closed_loop(RIG, Sampled(StiffPI(reference=3.0), "10 ms"), inputs=WEIGHT),
    ):
        words = instability(loop)
        assert words.startswith("Smooth running is unstable: a small swing") and "without" not in words


def test_nothing_is_said_where_nothing_is_known():
    assert instability(closed_loop(RIG, inputs=WEIGHT | {"top.torque": 0.0})) == ""
    assert instability(closed_loop(RIG, Sampled(lambda t, y: 9e3, 0.01), inputs=WEIGHT)) == ""


def test_a_study_says_which_controller_is_unstable(root, tmp_path, capsys):
    text = (root / "studies" / "scenes" / "jansen_2.toml").read_text(encoding="utf-8")
    (tmp_path / "scene.toml").write_text(
        text[: text.index("[[controllers]]")].replace("120 s", "5 s").replace("60 s", "2 s") + DELAYED, encoding="utf-8"
    )
    assert main(["study", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) in (0, 1)
    told = capsys.readouterr().out
    assert "late: Smooth running is unstable with these sample times and delays" in told and "early: Smooth" not in told
    assert "late: Smooth running is unstable" in (tmp_path / "out" / "study.txt").read_text(encoding="utf-8")


DELAYED = """
[[controllers]]
label = "late"
law = "ZTorque"
sample_time = "10 ms"
delay = "200 ms"

[[controllers]]
label = "early"
law = "ZTorque"
sample_time = "10 ms"
delay = "30 ms"
"""
