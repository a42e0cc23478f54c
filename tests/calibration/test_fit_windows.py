"""Several windows have common and own numbers, and shifts in time between channels are found; one that is there and not free is a bias."""

import numpy as np
import pytest

from models import BitRock, BlockOnBelt, Coulomb, Exponential, wells
from studies.questions.synthetic import NOISE, TRUTH, true_rig
from toolbox import SceneError, closed_loop, compose, fit, simulate
from toolbox.calibration import Search, Window, validate
from toolbox.commands.command_line import main

RIG = compose(wells.JANSEN_2, BitRock())
FREE = list(TRUTH)
TIME = np.round(np.arange(0.0, 40.01, 0.04), 2)
DRIVE = {"top.torque": np.minimum(TIME / 4, 1) * (10_500 + 1500 * np.sin(0.25 * TIME)), "bit.weight": 95e3 + 4e3 * np.sin(0.4 * TIME)}


@pytest.fixture(scope="module")
def run():
    return simulate(true_rig(), TIME[-1], inputs={name: (TIME, values) for name, values in DRIVE.items()}, accuracy=1e-9)


def log(run, late, seed=1):
    """What a recorder wrote whose channels are late, with the noise of sensors."""
    random = np.random.default_rng(seed)
    taken = {name: run.at(np.clip(TIME - late.get(name, 0.0), 0.0, TIME[-1]))[name] for name in NOISE}
    return {"time": TIME, **DRIVE, **{name: values + NOISE[name] * random.standard_normal(TIME.size) for name, values in taken.items()}}


def sigmas(found, truth):
    return {name: abs(found[name] - value) / found.standard_errors[found.names.index(name)] for name, value in truth.items()}


def belt(static, kinetic, decay):
    return compose(BlockOnBelt(friction=Exponential(static=static, kinetic=kinetic, decay=decay)))


def test_windows_have_common_and_own_numbers():
    time = np.arange(0.0, 34.0, 0.04)
    truth = simulate(belt(1.0, 0.5, 3.0), 34.0, start={"block.speed": 0.2}, output_times=time, accuracy=1e-9)
    random = np.random.default_rng(2)
    data = {"time": time, **{name: truth[name] + 0.01 * random.standard_normal(time.size) for name in ("block.speed", "block.position")}}
    own = ("block.speed", "block.position")
    windows = [Window(3.0, 14.0, own), Window("22 s", 33.0, own)]
    law = {"belt.friction.static": 1.0, "belt.friction.kinetic": 0.5, "belt.friction.decay": 3.0}
    found = fit(belt(1.2, 0.6, 2.0), data, [*law, *own], window=windows, starts=1)
    starts = {f"{name}[{i}]": float(truth.at(begin)[name]) for name in own for i, begin in ((1, 3.0), (2, 22.0))}
    assert max(sigmas(found, law | starts).values()) < 4.0 and set(found.names) == {*law, *starts}
    assert set(found.parameters) == set(law) and "2 windows together" in str(found)
    alone = fit(belt(1.2, 0.6, 2.0), data, [*law, *own], window=(3.0, 14.0), starts=1)
    assert found.standard_errors[0] < alone.standard_errors[0]  # two tell more than one
    assert found.plot().shape == (2, 4)


@pytest.mark.parametrize("late", [0.3, 0.32])
def test_a_late_force_is_found_from_a_loop_and_biases_its_law_where_it_is_not_free(run, late):
    data = log(run, {"bit.torque": late})
    found = fit(RIG, data, [*FREE, "bit.torque.shift"], contact="bit", starts=1)
    assert max(sigmas(found, TRUTH | {"bit.torque.shift": late}).values()) < 4.0
    wrong = fit(RIG, data, FREE, contact="bit", starts=1)
    off = abs(wrong["bit.friction.static"] - TRUTH["bit.friction.static"])
    assert off > max(5.0 * found.standard_errors[0], wrong.interval_factor * wrong.standard_errors[0])


def test_late_inputs_and_outputs_are_found_by_simulation(run):
    data = log(run, {"bit.speed": 0.3})
    del data["bit.torque"]
    data["top.torque"] = np.interp(TIME - 0.3, TIME, data["top.torque"])
    shifts = {"top.torque.shift": 0.3, "bit.shift": 0.3}  # the weight on bit, an input, is not late
    found = fit(RIG, data, [*FREE, *shifts], dict.fromkeys(shifts, (-1.0, "1 s")), starts=Search(1, seed=3))
    assert max(sigmas(found, TRUTH | shifts).values()) < 4.0 and found.white
    assert not set(found.parameters) - set(TRUTH)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"window": [Window(0, 10, "bit.weight")]}, "`free` must hold `bit.weight`, which window 1 has for its own"),
        ({"window": [(0, 10), 3]}, "`window` must be two times"),
        ({"window": (10, 0)}, "`end` must be > begin"),
        ({"ranges": {"bit.friction.static[3]": (0, 1)}, "window": [(0, 10), (10, 20)]}, "`bit.friction.static\\[3\\]`, which is not free"),
        ({"free": [*FREE, "bit.torque.shift", "bit.speed.shift"], "contact": "bit"}, "one shift at most where a contact is fitted"),
        ({"free": [*FREE, "bit.speed.shift"], "ranges": {"bit.speed.shift": (-30, 30)}}, "closer bounds of the shift"),
        ({"free": "bit.sped.shift"}, "There is no"),
    ],
)
def test_bad_windows_and_shifts_are_refused_in_words(run, arguments, words):
    data = log(run, {})
    if "contact" not in arguments:
        del data["bit.torque"]
    with pytest.raises(SceneError, match=words):
        fit(RIG, data, **{"free": FREE, **arguments})


def test_the_command_takes_windows_own_numbers_and_shifts(root, tmp_path, run, capsys):
    data = log(run, {"bit.torque": 0.3})
    del data["bit.weight"]
    table = "\n".join([",".join(f"{name} [{'s' if name == 'time' else RIG.unit(name)}]" for name in data), *(
        ",".join(f"{value:.9g}" for value in row) for row in zip(*data.values(), strict=True))])  # fmt: skip
    (tmp_path / "log.csv").write_text(table)
    words = ["fit", str(root / "studies" / "scenes" / "jansen_2.toml"), str(tmp_path / "log.csv"), "--contact", "bit", "--starts", "1"]
    words += ["--free", "bit.friction.static", "--range", "bit.torque.shift=-1:1 s", "--free", "bit.weight", "--own", "bit.weight"]
    assert main([*words, "--window", "0:20", "--window", "20:40", "--robust", "4"]) == 0
    told = capsys.readouterr().out
    assert "bit.weight[1]" in told and "bit.weight[2]" in told and "bit.torque.shift" in told and "2 windows together" in told
    assert main(words) == 2 and "`--own` must come with windows" in capsys.readouterr().err


def test_a_window_that_begins_in_motion_is_told_until_its_start_is_free():
    """A simulation begins at the start of the loop in every window, so that the law takes the blame for another start."""
    time = np.linspace(0.0, 20.0, 801)
    block = compose(BlockOnBelt(mass=2.0, stiffness=8.0, belt_speed=0.3, friction=Coulomb(static=1.5, kinetic=1.0)))
    run = simulate(closed_loop(block, start={"block.speed": 0.3}), 20.0, output_times=time)
    noise = 1e-3 * np.random.default_rng(2).standard_normal((2, time.size))
    log = {"time": time, "block.position": run["block.position"] + noise[0], "block.speed": run["block.speed"] + noise[1]}
    law, start = ["belt.friction.static", "belt.friction.kinetic"], ["block.position", "block.speed"]
    windows = [Window(5.0, 9.0, own=tuple(start)), Window(11.0, 15.0, own=tuple(start))]
    blind = fit(block, log, law, window=[(5.0, 9.0), (11.0, 15.0)])
    assert blind.initial_mismatch["block.position"] > 0.05 and "begins every window at the start of the loop" in str(blind)
    found = fit(block, log, [*law, *start], window=windows)
    assert not found.initial_mismatch and "begins every window" not in str(found)
    assert found["belt.friction.static"] == pytest.approx(1.5, abs=3e-3)
    assert abs(blind["belt.friction.static"] - 1.5) > 0.02
    there, elsewhere = (
        validate(closed_loop(block, start=begin), log, window=(5.0, 9.0)) for begin in ({name: run.at(5.0)[name] for name in start}, {})
    )
    assert (
        not there.initial_mismatch and elsewhere.initial_mismatch["block.position"] > 0.05 and "give the loop the `start`" in str(elsewhere)
    )
