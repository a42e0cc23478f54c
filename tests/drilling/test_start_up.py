"""A planned start from rest: the bit breaks free, is caught, and no stick-slip follows where a step and a ramp of the set-point leave the bit in it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from controllers import PI, StiffPI
from models import Block, wells
from tests.plants import RIG
from toolbox import Sampled, Scene, SceneError, closed_loop, compose, inputs, simulate
from toolbox.drilling import start_up

LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}
STATIC, KINETIC, DECAY = 12_116.0, 7572.0, 0.9
STRING = {"inertia": 374.0, "stiffness": 473.0, "static": STATIC, "kinetic": KINETIC, "decay": DECAY, "drag": 50.0}


def rock(speed):
    return KINETIC + (STATIC - KINETIC) * np.exp(-DECAY * speed)


def driven(top, damping, seconds):
    """(time, speed of the bit, torque of the string) of a bit whose string is turned at its top, from the release on, by another integrator."""

    def rates(t, x):
        twist, bit = x
        torque = STRING["stiffness"] * twist + damping * (np.interp(t, top.times, top.values) - bit)
        stuck = bit <= 0.0 and torque <= STATIC
        return np.interp(t, top.times, top.values) - bit, 0.0 if stuck else (torque - rock(bit) - 50.0 * bit) / STRING["inertia"]

    times = np.linspace(0.0, seconds, 2001)
    found = solve_ivp(rates, (0.0, seconds), [0.0, 0.0], t_eval=times, max_step=5e-3, rtol=1e-9, atol=1e-9, method="RK23")
    return times, found.y[1], STRING["stiffness"] * found.y[0]


@pytest.mark.parametrize("damping", [0.0, 23.2])
def test_bit_and_top_end_at_the_final_speed_with_the_twist_that_the_rock_needs(damping):
    """J y' = T - F(y) - c y and T' = k (w - y): at the end w = y, y' = 0 and T = F(y) + c y."""
    end = 6.0
    planned = inputs.start_up(end, 0.0, 5.0, 4.0, damping=damping, **STRING)
    times, bit, torque = driven(planned, damping, planned.times[-1] + 4.0)
    after = times > planned.times[-1]
    assert planned.values[0] == 0.0 and planned.values[-1] == pytest.approx(end, rel=1e-3)
    assert (bit[times < 4.9] == 0.0).all()
    np.testing.assert_allclose(bit[after], end, rtol=0.05)
    np.testing.assert_allclose(torque[after], rock(end) + 50.0 * end, rtol=0.01)
    ramped = inputs.Table.of("ramp", (0.0, planned.times[-1]), (0.0, end))
    assert np.ptp(driven(ramped, damping, planned.times[-1] + 4.0)[1][after]) > end


@pytest.mark.parametrize(("kind", "speed"), [(StiffPI, 5.0), (PI, 7.0)])
def test_a_drive_is_free_after_a_planned_start_and_sticks_after_a_step_and_a_ramp(kind, speed):
    loop = closed_loop(RIG, Sampled(kind(**LIMITS), 0.01, delay=0.03))
    stuck = {}
    for name, asked in {"step": speed, "ramp": inputs.ramp(0.0, speed, 0.0, 30.0), "planned": start_up(loop, speed)}.items():
        run = simulate(loop, 150.0, inputs={"top.reference": asked})
        stuck[name] = run.time_in("bit", "stick", after=100.0)
    assert min(stuck["step"], stuck["ramp"]) > 10.0
    assert stuck["planned"] == 0.0
    assert run["bit.speed"][run.time > 140.0] == pytest.approx(speed, rel=5e-3)  # the stiff drive damps the string slowly


def test_the_numbers_are_those_of_plant_and_controller():
    loop = closed_loop(RIG, Sampled(PI(**LIMITS), 0.01, delay=0.03))
    numbers = start_up(loop, "60 rpm").numbers
    load = 97_347.0 * 0.155575
    assert (numbers["inertia"], numbers["stiffness"], numbers["damping"], numbers["drive_inertia"]) == (374.0, 473.0, 23.2, 2122.0)
    assert [numbers[name] for name in ("static", "kinetic", "decay")] == pytest.approx([0.8 * load, 0.5 * load, 0.9], rel=1e-6)
    assert (numbers["proportional"], numbers["integral"]) == (4000.0, 1500.0) and numbers["delay"] == pytest.approx(0.035)
    assert numbers["catch"] == pytest.approx(0.7 * 2.0 * np.pi * np.sqrt(374.0 / 473.0), rel=1e-12)


def test_a_scene_holds_the_shape_and_gives_the_same_run(tmp_path):
    loop = closed_loop(RIG, Sampled(PI(**LIMITS), 0.01, delay=0.03))
    planned = start_up(loop, 7.0, wind_up=10.0)
    text = f"""title = "Start-up"
duration = "60 s"
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
weight = 97347.0
[[controllers]]
label = "PI"
law = "PI"
lowest_torque = 0.0
highest_torque = "20 kN m"
sample_time = "10 ms"
delay = "30 ms"
[inputs]
"top.reference" = {{ start_up = {{ {", ".join(f"{name} = {value!r}" for name, value in planned.numbers.items())} }} }}
"""
    (tmp_path / "scene.toml").write_text(text, encoding="utf-8")
    scene = Scene.load(tmp_path / "scene.toml")
    run = simulate(scene["PI"])
    same = simulate(loop, 60.0, inputs={"top.reference": planned})
    assert run.at(60.0)["bit.speed"] == pytest.approx(same.at(60.0)["bit.speed"], rel=1e-4)
    scene.save(tmp_path / "again.toml")
    assert Scene.load(tmp_path / "again.toml").inputs == scene.inputs


def test_a_rock_that_holds_more_when_it_slides_and_plants_without_rock_or_chain_are_refused():
    with pytest.raises(SceneError, match="kinetic"):
        inputs.start_up(3.0, 0.0, 5.0, 4.0, **{**STRING, "kinetic": 13_000.0})
    with pytest.raises(SceneError, match="chain of inertias"):
        start_up(closed_loop(compose(Block())), 3.0)
    with pytest.raises(SceneError, match="no contact `bit`"):
        start_up(closed_loop(compose(wells.JANSEN_2)), 3.0)
