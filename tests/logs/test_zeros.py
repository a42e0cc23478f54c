"""Zeros are data where a machine stands, an input is off or pauses between pulses; they are drop-outs where a few of them interrupt what goes on."""

import numpy as np
import pytest

from models import BlockOnBelt, Coulomb
from tests.plants import BELT
from toolbox import SceneError, compose, fit, simulate
from toolbox.calibration import Recording
from toolbox.commands.command_line import main

TIME = np.arange(0.0, 20.0, 0.01)
RANDOM = np.random.default_rng(7)
NOISE = RANDOM.standard_normal(TIME.size)

DATA = {
    "pulses of two seconds": np.where(TIME % 4.0 < 2.0, 3.0, 0.0),
    "pulses with pauses of two samples": np.where(np.arange(TIME.size) % 20 < 18, 3.0, 0.0),
    "pulses with pauses of two samples, measured": np.where(np.arange(TIME.size) % 20 < 18, 3.0 + 0.01 * NOISE, 0.0),
    "a random binary sequence": 3.0 * np.repeat(RANDOM.integers(0, 2, TIME.size // 4), 4),
    "three levels of random length": 3.0 * np.repeat(RANDOM.integers(-1, 2, TIME.size // 5), 5),
    "stairs": np.repeat(np.arange(20.0), TIME.size // 20),
    "two short pulses": np.where(np.isin(np.arange(TIME.size) // 3, (40, 300)), 5.0, 0.0),
    "one pulse of three samples": np.where(np.arange(TIME.size) // 3 == 40, 5.0, 0.0),
    "a set point with a pause": np.where((TIME > 5.0) & (TIME < 8.0), 0.0, 12.0),
    "a measured speed with a standstill": np.where((TIME > 5.0) & (TIME < 8.0), 0.0, 12.0 + 0.1 * NOISE),
    "stick-slip, rounded": np.round(12.0 * np.maximum(0.0, np.sin(3.0 * TIME)), 2),
    "stick-slip, sampled seldom": np.round(12.0 * np.maximum(0.0, np.sin(3.0 * 50.0 * TIME)), 2),
}
"""Channels of which every sample is data."""


@pytest.mark.parametrize("name", DATA)
def test_zeros_of_a_machine_or_an_input_are_data(name):
    log = {"time": TIME, "block.force": np.asarray(DATA[name], float)}
    assert Recording.of(log, BELT).flaws == ()


@pytest.mark.parametrize(
    "values", [12.0 + 0.1 * NOISE, np.round(12.0 + 0.3 * NOISE, 1), 12.0 + 3.0 * np.sin(TIME)], ids=["noisy", "rounded", "smooth"]
)
def test_a_few_zeros_inside_of_what_goes_on_are_drop_outs_beside_a_standstill_that_is_not(values):
    values = np.where((TIME > 15.0) & (TIME < 18.0), 0.0, values)
    lost = [300, 301, 302, 700, 1100, 1101]
    values[lost] = 0.0
    found = Recording.of({"time": TIME, "block.force": values}, BELT)
    assert found.found("block.force") == {"drop-out": 6}
    assert np.flatnonzero(np.isnan(found.signals["block.force"])).tolist() == lost


def test_a_recording_says_how_to_keep_what_was_left_out_and_so_does_the_error_of_a_gap(tmp_path, capsys):
    force = 12.0 + 0.1 * NOISE
    force[300:304] = 0.0
    log = {"time": TIME, "block.force": force, "block.position": np.sin(TIME)}
    said = "--accept-flaw drop-out (in Python Recording.of(..., accepted_flaws=['drop-out']))"
    assert said in str(Recording.of(log, BELT))
    with pytest.raises(SceneError, match="--accept-flaw drop-out") as error:
        fit(BELT, log, ["block.mass"])
    assert said in str(error.value) and "4 drop-out" in str(error.value)
    kept = Recording.of(log, BELT, accepted_flaws=["drop-out"])
    assert kept.flaws == () and "--accept-flaw" not in str(kept)
    with pytest.raises(SystemExit):
        main(["fit", "--help"])
    assert "--accept-flaw" in capsys.readouterr().out


def test_a_null_of_logs_that_is_a_reading_can_be_kept():
    position = np.linspace(-1000.0, -998.5, TIME.size)
    position[100] = -999.25
    log = {"time": TIME, "block.position": position}
    assert Recording.of(log, BELT).found("block.position") == {"null": 1}
    assert Recording.of(log, BELT, accepted_flaws=["null", "outlier"]).flaws == ()


def test_a_step_test_gives_the_numbers_of_the_block_that_was_pushed():
    true = compose(BlockOnBelt(mass=2.0, stiffness=20.0, damping=0.5, belt_speed=0.0, friction=Coulomb(1.0, 0.8)))
    force = np.where((TIME % 4.0 < 2.0) & (TIME >= 1.0), 3.0, 0.0)
    run = simulate(true, 20.0, inputs={"block.force": (TIME, force)}, output_times=np.append(TIME, 20.0)[: TIME.size])
    log = {"time": TIME, "block.force": force, "block.position": run["block.position"] + 1e-5 * NOISE}
    guess = compose(BlockOnBelt(mass=1.5, stiffness=20.0, damping=0.5, belt_speed=0.0, friction=Coulomb(0.9, 0.7)))
    found = fit(guess, log, ["block.mass", "belt.friction.static", "belt.friction.kinetic"])
    for name, value in (("block.mass", 2.0), ("belt.friction.static", 1.0), ("belt.friction.kinetic", 0.8)):
        low, high = found.interval(name)
        assert low <= value <= high and high - low < 0.05 * value
