"""A few samples that break the law move nothing, noise with a memory widens the intervals, and equal static and kinetic friction is a result."""

import numpy as np
import pytest

from models import BitRock, BlockOnBelt, Coulomb, Exponential, wells
from studies.questions.synthetic import COLUMNS, FOLDER, TRUTH
from toolbox import SceneError, closed_loop, compose, fit, simulate
from toolbox.calibration import Recording, Search
from toolbox.calibration.break_away import break_away
from toolbox.commands.command_line import main

RIG = compose(wells.JANSEN_2, BitRock())
FREE = list(TRUTH)
SLIP = np.linspace(-1.0, 1.0, 400)
SLIP = SLIP[np.abs(SLIP) > 0.02]
SIDE = np.sign(SLIP)


def reversed_speed():
    """The synthetic rig with the speed of half a per cent of its slipping samples reversed, which nobody took out before."""
    recording = Recording.of(FOLDER / "rig.csv", RIG, COLUMNS)
    speed = recording.signals["bit.speed"].copy()
    at = np.random.default_rng(3).choice(np.flatnonzero(speed > 1.0), 5, replace=False)
    speed[at] *= -1.0
    return Recording(recording.time, {**recording.signals, "bit.speed": speed}, "reversed", recording.units)


def test_half_a_per_cent_of_samples_with_reversed_speed_moves_no_number_out_of_its_interval():
    clean = fit(RIG, FOLDER / "rig.csv", FREE, columns=COLUMNS, contact="bit", starts=1)
    found = fit(RIG, reversed_speed(), FREE, contact="bit", starts=1)
    moved = np.abs(found.values - clean.values) / (clean.interval_factor * clean.standard_errors)
    assert (moved < 0.5).all() and {name: left_out.sum() for name, left_out in found.outliers.items()} == {"bit.torque": 5}
    assert "5 sample(s) of bit.torque break the law and were left out" in str(found)
    kept = fit(RIG, reversed_speed(), FREE, contact="bit", starts=Search(1, robust=None))  # and without it they do
    assert (np.abs(kept.values - clean.values) / (clean.interval_factor * clean.standard_errors)).max() > 3.0
    with pytest.raises(SceneError, match="`robust` must be > 1"):
        fit(RIG, reversed_speed(), FREE, contact="bit", starts=Search(robust=0.5))


def test_nothing_is_left_out_where_the_law_itself_is_wrong():
    force = np.where(np.abs(SLIP) < 0.3, 2.0, 1.0) * SIDE
    data = {"time": 0.01 * np.arange(SLIP.size), "block.speed": SLIP, "belt.force": -force}
    found = fit(
        compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=2.0, kinetic=2.0))),
        data,
        "belt.friction.kinetic",
        contact="belt",
        starts=1,
    )
    assert not found.outliers


@pytest.mark.parametrize("seed", range(4))
def test_equal_static_and_kinetic_friction_is_a_result_without_a_decay(seed):
    noise = 0.1 * np.random.default_rng(seed).standard_normal(SLIP.size)
    data = {"time": 0.01 * np.arange(SLIP.size), "block.speed": SLIP, "belt.force": -2.0 * SIDE + noise}
    belt = compose(BlockOnBelt(belt_speed=0.0, friction=Exponential(static=2.5, kinetic=1.0, decay=1.0)))
    found = fit(belt, data, ["belt.friction.static", "belt.friction.kinetic", "belt.friction.decay"], contact="belt")
    assert found["belt.friction.static"] == pytest.approx(found["belt.friction.kinetic"], rel=1e-12) == pytest.approx(2.0, abs=0.02)
    assert found.indistinguishable_friction == "belt.friction." and found.unidentifiable == ("belt.friction.decay",) and not found.at_bounds
    printed = str(found)
    assert "are one number: the data do not tell them apart" in printed and "undetermined" in printed and "inf " not in printed


def test_intervals_under_noise_with_a_memory_hold_the_truth_as_often_as_they_say():
    belt = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=0.5, kinetic=0.5)))
    hits, widths = 0, []
    for seed in range(60):
        random = np.random.default_rng(seed)
        noise = random.standard_normal(600)
        for k in range(1, 600):
            noise[k] += 0.8 * noise[k - 1]
        data = {"time": 0.01 * np.arange(600.0), "block.speed": np.linspace(1.0, 2.0, 600), "belt.force": -0.4 - 0.02 * noise}
        found = fit(belt, data, "belt.friction.kinetic", contact="belt", starts=1, ranges={"belt.friction.kinetic": (0.01, 0.5)})
        low, high = found.interval("belt.friction.kinetic")
        hits += low <= 0.4 <= high
        widths.append((high - low) / 2 / (found.interval_factor * found.residuals[0].rms / np.sqrt(600)))
    assert hits >= 51  # of 60, as white noise is held to; intervals that take noise for white hold it in about 30
    assert np.median(widths) == pytest.approx(3.0, rel=0.2)  # sqrt(1.8 / 0.2)


def test_a_window_is_fitted_alone_and_the_command_takes_it(tmp_path, capsys, root):
    found = fit(RIG, FOLDER / "rig.csv", "bit.friction.kinetic", columns=COLUMNS, contact="bit", window=("10 s", 30.0), starts=1)
    assert "over 20 s" in found.data_description
    with pytest.raises(SceneError, match="`window` must be two times"):
        fit(RIG, FOLDER / "rig.csv", "bit.friction.kinetic", columns=COLUMNS, contact="bit", window=(1.0,))
    columns = [word for name, heading in COLUMNS.items() for word in ("--column", f"{name}={heading}")]
    scene = str(root / "studies" / "scenes" / "jansen_2.toml")
    words = ["fit", scene, str(FOLDER / "rig.csv"), "--free", "bit.friction.kinetic", *columns, "--contact", "bit", "--starts", "1"]
    assert main([*words, "--window", "10:30", "--robust", "off", "--shift", "bit.torque=0 s"]) == 0
    told = capsys.readouterr().out
    assert "over 20 s" in told and "bit.torque" in told and "usually every 0.04 s" in told
    assert main([*words, "--window", "10"]) == 2 and "BEGIN:END" in capsys.readouterr().err


@pytest.mark.parametrize(("static", "within"), [(0.5, 0.002), (0.55, 0.002), (0.7, 0.005)])
@pytest.mark.parametrize("noise", [0.002, 0.02])
def test_the_force_at_break_away_is_found_whether_it_drops_there_or_not(static, within, noise):
    """At 100 Hz the pull rises by 0.17 N from a sample to the next: where friction does not drop, 2.5 N stay for some samples at rest, which are no rise."""
    time = np.linspace(0.0, 40.0, 4001)
    pull = 12.0 * np.sin(0.7 * time) + 4.0 * np.sin(2.1 * time)
    slide = compose(BlockOnBelt(belt_speed=0.0, stiffness=30.0, load=5.0, friction=Coulomb(static=static, kinetic=0.5)))
    run = simulate(closed_loop(slide, inputs={"block.force": (time, pull)}), 40.0, output_times=time)
    force = run["belt.force"] + noise * np.random.default_rng(0).standard_normal(time.size)
    guess = compose(BlockOnBelt(belt_speed=0.0, stiffness=30.0, load=5.0, friction=Coulomb()))
    log = {"time": time, "block.speed": run["block.speed"], "belt.force": force}
    found = fit(guess, log, ["belt.friction.static", "belt.friction.kinetic"], contact="belt")
    assert abs(found["belt.friction.static"] - static) < within
    assert abs(found["belt.friction.kinetic"] - 0.5) < 0.001
    assert (found.indistinguishable_friction != "") == (static == 0.5)


@pytest.mark.parametrize(("static", "within"), [(0.7, 0.002), (0.55, 0.01)])
def test_forces_at_break_away_are_told_between_samples_where_the_pull_rises_by_a_fifth_from_one_to_the_next(static, within):
    """At 25 Hz a sample is 0.3 N before break-away in the mean, beside a noise of 2 mN; the drop from 0.55 is half of what the pull rises between samples."""
    time = np.linspace(0.0, 40.0, 1001)
    pull = 12.0 * np.sin(0.7 * time) + 4.0 * np.sin(2.1 * time)
    slide = compose(BlockOnBelt(belt_speed=0.0, stiffness=30.0, load=5.0, friction=Coulomb(static=static, kinetic=0.5)))
    run = simulate(closed_loop(slide, inputs={"block.force": (time, pull)}), 40.0, output_times=time)
    force = run["belt.force"] + 0.002 * np.random.default_rng(0).standard_normal(time.size)
    guess = compose(BlockOnBelt(belt_speed=0.0, stiffness=30.0, load=5.0, friction=Coulomb()))
    log = {"time": time, "block.speed": run["block.speed"], "belt.force": force}
    found = fit(guess, log, ["belt.friction.static", "belt.friction.kinetic"], contact="belt")
    assert not found.indistinguishable_friction and not found.outliers and abs(found["belt.friction.static"] - static) < within
    low, high = found.interval("belt.friction.static")
    assert low < static < high


def test_a_force_at_break_away_does_not_depend_on_the_unit_of_time():
    """The same samples within a millisecond: powers of such times are as small as 1e-27."""
    t = np.arange(30.0)
    force = np.where(t < 20.4, 1.0 + 0.1 * t + 0.002 * t**2, 2.0)
    slip = np.where(t < 20.4, 0.0, 0.3 * (t - 20.4) + 0.02 * (t - 20.4) ** 2)
    slow, fast = (break_away(time[:27], force[:27], slip[:27], 20, 1.0) for time in (t, 1e-4 * t))
    assert slow.force == pytest.approx(1.0 + 2.04 + 0.002 * 20.4**2, abs=1e-6)
    assert fast.force == pytest.approx(slow.force, rel=1e-9) and fast.sample == slow.sample == 20
