"""Identification from recordings alone: the numbers of the machine are found, and what the data do not tell has its sentence and its experiment."""

import dataclasses

import numpy as np
import pytest

from models import Coulomb, GaussianStribeck, Joint, Viscous
from toolbox import Scene, SceneError, compose, identify, simulate
from toolbox.calibration import Identification, Recording, identification, residuals
from toolbox.calibration.identified import friction_over_speed
from toolbox.calibration.told_fit import hardly_told
from toolbox.commands.command_line import main
from toolbox.modelling.laws import names

TIME = np.arange(0.0, 4.0, 0.005)
TRUE = Joint(inertia=0.02, torque_offset=0.05, friction=Viscous(Coulomb(0.3, 0.3), 0.05))
TRUTH = {"joint.inertia": 0.02, "joint.torque_offset": 0.05, "bearing.friction.dry.static": 0.3, "bearing.friction.viscous": 0.05}
STEPS = np.where(TIME % 2.0 < 1.0, 1.0, -0.8)
SINE = 1.2 * np.sin(4.0 * TIME)


def log(torque=None, speed=0.0, seed=0, joint=TRUE, held=False):
    """A recording of 200 Hz: torque, and speed with noise of 0.01 rad/s."""
    plant, inputs = compose(joint), {}
    if torque is not None:
        data = {"time": TIME, "joint.torque": torque}
        inputs = Recording.of(data, plant, zero_order_hold="joint.torque").driving(plant) if held else {"joint.torque": (TIME, torque)}
    run = simulate(plant, TIME[-1], inputs=inputs, start={"joint.speed": speed}, output_times=TIME)
    found = {"time": TIME, "joint.speed": run["joint.speed"] + 0.01 * np.random.default_rng(seed).standard_normal(TIME.size)}
    return found if torque is None else {**found, "joint.torque": torque}


def off(found, truth):
    """Numbers that are farther from the truth than four standard errors, which one log of 16 000 has by chance."""
    errors = dict(zip(found.names, found.standard_errors, strict=True))
    return [name for name, value in truth.items() if not abs(found[name] - value) < 4.0 * errors[name]]


def test_steady_points_give_stribeck_and_viscous_friction_together():
    speed = np.linspace(0.005, 0.6, 21)
    found = identify({"axis.speed": speed, "axis.force": 5.0 + 15.0 * np.exp(-((speed / 0.07) ** 2)) + 35.0 * speed})
    named = {name.rpartition(".")[2]: value for name, value in zip(found.names, found.values, strict=True)}
    assert named == pytest.approx({"static": 20.0, "kinetic": 5.0, "stribeck_speed": 0.07, "viscous": 35.0})
    assert set(found.untold) == {"axis.mass", "axis.force_offset"}
    assert "accelerate by a measured force" in found.untold["axis.mass"] and "move both ways" in found.untold["axis.force_offset"]


def test_a_kinetic_friction_at_its_bound_of_zero_has_a_friction_curve():
    speed = np.linspace(0.005, 0.6, 21)
    found = identify({"axis.speed": speed, "axis.force": 20.0 * np.exp(-((speed / 0.07) ** 2)) + 35.0 * speed})
    kinetic = found.names.index("rail.friction.dry.kinetic")
    bound = dataclasses.replace(found, values=np.where(np.arange(found.values.size) == kinetic, 0.0, found.values))
    at, law, low, high = friction_over_speed(bound, found.points)
    assert np.allclose(law, 20.0 * np.exp(-((at / 0.07) ** 2)) + 35.0 * at, atol=1e-3) and (low <= law).all() and (law <= high).all()


def test_steady_points_both_ways_give_friction_of_each_direction():
    speed = np.linspace(0.1, 2.0, 15)
    force = np.concatenate([0.138 + 0.2 * speed, -0.565 - 0.3 * speed])
    found = identify({"joint.speed": np.concatenate([speed, -speed]), "joint.torque": force}, "Joint", directions=True)
    assert found["bearing.friction.forward.dry.static"] == pytest.approx(0.138)
    assert found["bearing.friction.backward.dry.static"] == pytest.approx(0.565)
    assert found["bearing.friction.forward.viscous"] == pytest.approx(0.2)
    assert found["bearing.friction.backward.viscous"] == pytest.approx(0.3)
    assert "differs by direction" in found.untold["joint.torque_offset"]


def test_a_coast_down_and_a_sine_and_steps_together_give_the_joint():
    found = identify([log(speed=20.0, seed=1), log(SINE, seed=2), log(STEPS, seed=3)], "Joint")
    assert off(found, TRUTH) == [] and found.white
    assert all(found.standard_errors[found.names.index(name)] < 1e-3 * value for name, value in TRUTH.items())
    assert "raise the force slowly" in found.untold["bearing.friction.dry.static"]
    speed, middle, _, high = found.curve
    right = np.sign(speed) * (0.3 + 0.05 * np.abs(speed))
    assert (np.abs(right - middle) < 2.0 * (high - middle)).all()  # four standard errors, as in `off`: all speeds are off together
    assert np.abs(found.points[1] - np.sign(found.points[0]) * (0.3 + 0.05 * np.abs(found.points[0]))).max() < 0.05


def test_a_coast_down_alone_gives_friction_over_the_inertia_and_says_so():
    found = identify(log(speed=20.0), Joint(inertia=0.02))
    assert "joint.inertia" not in found.names and "steps, or a sine of the largest torque" in found.untold["joint.inertia"]
    assert found["bearing.friction.viscous"] == pytest.approx(0.05, rel=0.01)
    assert found["bearing.friction.dry.static"] == pytest.approx(0.35, rel=0.01)  # the offset of 0.05 is part of it: motion is one way


def coast(first=20.0, noise=0.01):
    """Speed of a coast-down by its closed form: J v' = -(0.3 + 0.05 v), J = 0.02."""
    speed = np.maximum((first + 6.0) * np.exp(-2.5 * TIME) - 6.0, 0.0)
    return speed + noise * np.random.default_rng(5).standard_normal(TIME.size)


@pytest.mark.parametrize("torque", [0.0, 0.002 * np.random.default_rng(6).standard_normal(TIME.size)], ids=["zeros", "noise of a sensor"])
def test_a_coast_down_with_a_torque_of_zeros_tells_friction_over_the_inertia(torque, monkeypatch):
    runs = []
    simulated = residuals.simulate
    monkeypatch.setattr(residuals, "simulate", lambda *args, **options: runs.append(1) or simulated(*args, **options))
    found = identify({"time": TIME, "joint.speed": coast(), "joint.torque": torque + 0.0 * TIME}, Joint(inertia=0.1))
    plain = identify({"time": TIME, "joint.speed": coast()}, Joint(inertia=0.1))
    assert "joint.inertia" not in found.names and not found.at_bounds
    told = found.untold["joint.inertia"]
    assert "only friction over inertia" in told and "0.1 kg m2" in told and "steps, or a sine of the largest torque" in told
    for name, right in (("bearing.friction.dry.static", 5.0 * 0.3), ("bearing.friction.viscous", 5.0 * 0.05)):  # 5 = 0.1 / 0.02
        low, high = found.interval(name)
        assert low < right < high and high - low < 0.01 * right
        assert found[name] == pytest.approx(plain[name], abs=0.5 * (high - low))
    assert len(runs) < 60  # a search whose inertia goes to zero needs thousands


def test_a_constant_torque_tells_the_inertia_only_up_to_its_largest_value():
    speed = 14.0 * -np.expm1(-2.5 * TIME)  # 0.02 v' = 1.0 - 0.3 - 0.05 v: v' = 35 at rest
    data = {
        "time": TIME,
        "joint.speed": speed + 0.01 * np.random.default_rng(7).standard_normal(TIME.size),
        "joint.torque": np.ones(TIME.size),
    }
    for given, held in ((0.025, 0.025), (0.1, 0.5 / 35.0)):  # with 0.1 dry friction would be negative
        found = identify(data, Joint(inertia=given))
        inertia = float(found.plant.parts[0].inertia)
        assert inertia == pytest.approx(held, rel=2e-3) and "joint.inertia" not in found.names
        assert f"at most {1.0 / 35.0:.3f}"[:-1] in found.untold["joint.inertia"]
        for name, right in (("bearing.friction.dry.static", 1.0 - 35.0 * inertia), ("bearing.friction.viscous", 2.5 * inertia)):
            low, high = found.interval(name)
            assert low - 0.5 * (high - low) < right < high + 0.5 * (high - low)


def test_one_speed_tells_friction_there_and_neither_inertia_nor_viscous_friction():
    random = np.random.default_rng(8)
    moving = {"time": TIME, "joint.speed": 5.0 + 0.01 * random.standard_normal(TIME.size), "joint.torque": np.full(TIME.size, 0.55)}
    points = {"joint.speed": 5.0 + 1e-3 * random.standard_normal(12), "joint.torque": 0.55 + 1e-3 * random.standard_normal(12)}
    for data in (moving, points):
        found = identify(data, "Joint")
        assert set(found.untold) >= {"joint.inertia", "bearing.friction.viscous", "joint.torque_offset"} and not found.at_bounds
        assert found["bearing.friction.dry.static"] == pytest.approx(0.55, rel=2e-3)
        assert "differ by a factor of five" in found.untold["bearing.friction.viscous"]


def test_a_coast_down_without_torque_beside_a_driven_recording_keeps_the_inertia():
    found = identify([{"time": TIME, "joint.speed": coast(), "joint.torque": 0.0 * TIME}, log(SINE, joint=Joint(
        inertia=0.02, friction=TRUE.friction))], "Joint")  # fmt: skip
    assert off(found, {**TRUTH, "joint.torque_offset": 0.0}) == []


def test_recordings_without_motion_are_refused_with_the_remedy():
    weak = 0.2 * np.sin(6.0 * TIME)
    for signal in ({"joint.angle": np.full(TIME.size, 0.3)}, {"joint.speed": 0.01 * np.random.default_rng(9).standard_normal(TIME.size)}):
        with pytest.raises(SceneError, match="must hold motion, but there is none: raise the force"):
            identify({"time": TIME, "joint.torque": weak, **signal}, "Joint")


def test_a_gap_makes_two_runs_each_with_its_own_start():
    data = log(SINE)
    kept = (TIME < 1.7) | (TIME > 2.3)
    found = identify({name: values[kept] for name, values in data.items()}, "Joint")
    assert off(found, TRUTH) == []
    assert {"joint.speed[1]", "joint.speed[2]"} <= set(found.names)


def test_the_clock_of_the_torque_is_found_to_be_late():
    data = log(SINE)
    late = {**data, "joint.torque": np.interp(TIME - 0.02, TIME, SINE)}
    found = identify(late, "Joint", delayed_signals="joint.torque")
    low, high = found.interval("joint.torque.shift")
    assert low <= 0.02 <= high and high - low < 2e-3
    assert found["joint.inertia"] == pytest.approx(0.02, rel=0.01)


def test_a_stribeck_curve_is_found_where_there_is_one():
    joint = Joint(inertia=0.5, friction=Viscous(GaussianStribeck(1.0, 0.5, 0.8), 0.05))
    found = identify(log(2.0 * np.sin(1.5 * TIME) + 0.6 * np.sin(7.0 * TIME), joint=joint, seed=4), "Joint")
    truth = {
        "joint.inertia": 0.5,
        "bearing.friction.dry.kinetic": 0.5,
        "bearing.friction.dry.stribeck_speed": 0.8,
        "bearing.friction.viscous": 0.05,
    }
    assert off(found, truth) == []


def test_two_files_and_one_command_give_the_friction_curve(tmp_path, capsys):
    for name, data in (("steps", log(STEPS)), ("sine", log(SINE))):
        rows = np.stack([data["time"], data["joint.speed"] * 30.0 / np.pi, data["joint.torque"]], axis=1)
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="t [s],speed [rpm],torque [N m]", comments="")
    columns = [f"--column={signal}={label}" for signal, label in (("time", "t"), ("joint.speed", "speed"), ("joint.torque", "torque"))]
    out = tmp_path / "found"
    files = [str(tmp_path / "steps.csv"), str(tmp_path / "sine.csv")]
    assert main(["identify", *files, "--plant", "Joint", *columns, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "bearing.friction.viscous" in said and "rpm" in said  # the unit of the log
    assert {path.name for path in out.iterdir()} >= {
        "identify.txt",
        "identify.csv",
        "identify.npz",
        "scene.toml",
        "friction.png",
        "residuals.png",
    }
    found = Identification.load(out / "identify.npz")
    assert off(found, TRUTH) == [] and found.untold
    scene = Scene.load(out / "scene.toml")  # the first recording again
    again = scene.run("no controller").at(TIME[::20])["joint.speed"]
    assert np.abs(again - log(STEPS)["joint.speed"][::20]).max() < 0.05  # five deviations of the noise
    with pytest.raises(SceneError, match="read from a file"):
        found.scene()


def test_files_with_other_headings_and_signals_are_identified_together(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(identification, "SLOW", -1.0)
    run = simulate(compose(TRUE), TIME[-1], inputs={"joint.torque": (TIME, STEPS)}, output_times=TIME)
    angle = np.degrees(run["joint.angle"]) + 0.01 * np.random.default_rng(3).standard_normal(TIME.size)
    rows = [f"{t:.3f};{a:.4f};{m:.4f}".replace(".", ",") for t, a, m in zip(TIME, angle, STEPS, strict=True)]
    (tmp_path / "steps.csv").write_text(
        "\n".join(["Zeit [s];Winkel [deg];Moment [N m]", *rows[::-1]]), encoding="utf-16"
    )  # the newest row first
    data = log(SINE, seed=2)
    table = np.stack([data["time"], data["joint.speed"] * 30.0 / np.pi, 1e3 * SINE], axis=1)
    np.savetxt(tmp_path / "sine.csv", table, delimiter=",", header="t [s],n [rpm],T [N mm]", comments="")
    files = [str(tmp_path / "steps.csv"), str(tmp_path / "sine.csv")]
    named = {"time": ("Zeit", "t"), "joint.angle": "Winkel", "joint.speed": "n", "joint.torque": ("Moment", "T")}
    with caplog.at_level("INFO", logger="stickslip"):
        found = identify(files, "Joint", columns=named)
    assert off(found, TRUTH) == [] and "dry and viscous friction is fitted" in caplog.text
    typed = [f"--column={signal}={label}" for signal, labels in named.items() for label in names(labels)]
    assert main(["identify", *files, "--plant", "Joint", *typed, "--out", str(tmp_path / "found")]) == 0
    assert Identification.load(tmp_path / "found" / "identify.npz").values == pytest.approx(found.values, rel=1e-12, nan_ok=True)


def test_a_recording_without_torque_says_that_it_counts_as_zero():
    found = identify([{"time": TIME, "joint.speed": coast()}, log(SINE, joint=Joint(inertia=0.02, friction=TRUE.friction))], "Joint")
    assert "no `joint.torque`, which counts as 0" in found.recordings[0] and "counts as 0" not in found.recordings[1]
    with pytest.raises(SceneError, match="must have a column that `columns` names"):
        identify({"t": TIME, "n [rad/s]": coast()}, "Joint", columns={"joint.speed": "speed", "joint.torque": "torque"})


def test_what_cannot_be_identified_is_refused_with_what_must_be_there():
    with pytest.raises(SceneError, match="must hold `joint.angle` or `joint.speed`"):
        identify({"time": TIME, "joint.torque": SINE}, "Joint")
    with pytest.raises(SceneError, match="for any other plant use `fit`"):
        identify({"time": TIME}, Coulomb())
    with pytest.raises(SceneError, match="both: identify one after the other"):
        identify([log(SINE), {"joint.speed": TIME[1:], "joint.torque": TIME[1:]}], "Joint")


def test_a_search_that_ends_where_nothing_moves_is_followed_by_others():
    random = np.random.default_rng(41)
    torque = np.repeat(random.permutation([0.7, -0.8, 1.0, -1.1, 1.3]), 60)  # the first search ends at 2.8 N m
    time = np.arange(0.0, 3.0, 0.01)
    plant = compose(TRUE)
    inputs = Recording.of({"time": time, "joint.torque": torque}, plant, zero_order_hold="joint.torque").driving(plant)
    run = simulate(plant, time[-1], inputs=inputs, output_times=time, accuracy=1e-9)
    speed = run["joint.speed"] + 0.02 * random.standard_normal(time.size)
    found = identify({"time": time, "joint.torque": torque, "joint.speed": speed}, "Joint", zero_order_hold="joint.torque")
    assert off(found, TRUTH) == [] and found.white


def test_steady_points_of_another_exponent_still_give_a_stribeck_curve():
    speed = np.geomspace(0.05, 6.0, 40)
    friction = 0.056 + 0.082 * np.exp(-((speed / 1.12) ** 3)) + 0.019 * speed
    found = identify({"joint.speed": speed, "joint.torque": friction}, "Joint")
    assert "bearing.friction.dry.stribeck_speed" in found.names and not found.white
    v, middle = found.curve[:2]
    there = v >= speed[0]
    assert np.abs(middle - np.interp(v, speed, friction))[there].max() < 0.05 * friction.max()


def test_friction_is_answered_in_units_of_force_and_of_the_log():
    speed = np.linspace(0.005, 0.6, 21)
    force = 5.0 + 15.0 * np.exp(-((speed / 0.07) ** 2)) + 35.0 * speed
    plain = identify({"axis.speed": speed, "axis.force": force})
    assert dict(zip(plain.names, plain.units, strict=True)) == {
        "rail.friction.dry.static": "N", "rail.friction.dry.kinetic": "N", "rail.friction.dry.stribeck_speed": "m/s", "rail.friction.viscous": "N s/m",
    }  # fmt: skip
    columns = {"axis.speed": "v [mm/s]", "axis.force": "F [kN]"}
    said = str(identify({"v [mm/s]": 1e3 * speed, "F [kN]": 1e-3 * force}, columns=columns))
    rows = {line.split()[0]: line.split("  ") for line in said.splitlines() if line.startswith("  rail.friction") and ".." in line}
    shown = {name: [cell.strip() for cell in row if cell.strip()] for name, row in rows.items()}
    assert shown["rail.friction.dry.static"][1] == "0.02" and "kN" in shown["rail.friction.dry.static"]
    assert shown["rail.friction.viscous"][1] == "3.5e-05" and "kN s/mm" in shown["rail.friction.viscous"]


def test_pictures_show_the_speed_once_scaled_and_each_run_from_its_begin():
    logs = []
    for seed, torque in enumerate((STEPS, SINE)):
        data = log(torque, seed=seed)
        logs.append({"t": data["time"], "n [rpm]": data["joint.speed"] * 30.0 / np.pi, "T [N m]": data["joint.torque"]})
    found = identify(logs, "Joint", columns={"time": "t", "joint.speed": "n [rpm]", "joint.torque": "T [N m]"})
    assert off(found, TRUTH) == []  # `T` is the torque, and `t` the time
    ax = found.plot()
    assert ax.get_xlabel() == "speed [rpm]"
    assert ax.get_xlim()[1] < 1.2 * found.points[0].max()  # matplotlib draws in SI, and its ticks are in rpm
    axes = found.plot_residuals()
    assert [each.get_ylabel() for each in axes[0]] == ["joint speed, run 1 [rpm]", "joint speed, run 2 [rpm]"]
    assert all(each.get_xlim()[0] == 0.0 for each in axes[0])


def test_each_panel_of_residuals_lasts_as_long_as_its_recording():
    short = {"time": TIME[:200], "joint.speed": coast()[:200]}
    found = identify([log(SINE, joint=Joint(inertia=0.02, friction=TRUE.friction)), short, log(STEPS, seed=1)], "Joint")
    axes = found.plot_residuals()
    ends = np.array([[ax.get_xlim() for ax in row] for row in axes])
    assert ends == pytest.approx(np.broadcast_to([[0.0, 4.0 - 0.005], [0.0, 0.995], [0.0, 4.0 - 0.005]], (2, 3, 2)))


def test_a_start_without_influence_is_told_with_its_recording(tmp_path):
    run = simulate(compose(TRUE), TIME[-1], inputs={"joint.torque": (TIME, STEPS)}, output_times=TIME)
    angle = run["joint.angle"] + 1e-3 * np.random.default_rng(3).standard_normal(TIME.size)
    for name, data in (
        ("steps", {"time": TIME, "joint.angle": angle, "joint.torque": STEPS}),
        ("coast", {"time": TIME, "joint.speed": coast()}),
    ):
        np.savetxt(tmp_path / f"{name}.csv", np.stack(list(data.values()), axis=1), delimiter=",", header=",".join(data), comments="")
    found = identify([tmp_path / "steps.csv", tmp_path / "coast.csv"], Joint(), columns={
        "time": "time [s]", "joint.angle": "joint.angle [rad]", "joint.speed": "joint.speed [rad/s]", "joint.torque": "joint.torque [N m]"})  # fmt: skip
    assert found.runs == ("steps.csv", "coast.csv") and "joint.angle" in found.unidentifiable
    assert "`joint.angle` has no influence in coast.csv, and so no estimate." in str(found)
    found.save(tmp_path / "found.npz")
    assert str(Identification.load(tmp_path / "found.npz")) == str(found)


CURVED = Joint(inertia=0.035, friction=Viscous(GaussianStribeck(0.55, 0.4, 0.12), 0.021))
CURVE = {
    "joint.inertia": 0.035, "bearing.friction.dry.static": 0.55, "bearing.friction.dry.kinetic": 0.4,
    "bearing.friction.dry.stribeck_speed": 0.12, "bearing.friction.viscous": 0.021,
}  # fmt: skip


def rises(noise, seed=0):
    """A recording of 100 Hz: the torque, with noise, rises slowly from rest until the joint moves, and drops; the angle by an encoder."""
    time, plant = np.arange(0.0, 12.0, 0.01), compose(CURVED)
    part = time % 1.5
    torque = np.where(part < 1.0, 0.62 * part, 0.0) * np.where(time % 3.0 < 1.5, 1.0, -1.0)
    run = simulate(plant, time[-1], inputs={"joint.torque": (time, torque)}, output_times=time)
    scatter = noise * np.random.default_rng(seed).standard_normal(time.size)
    return {"time": time, "joint.angle": np.round(run["joint.angle"] / 2e-4) * 2e-4, "joint.torque": torque + scatter}


def test_noise_of_the_torque_does_not_outweigh_a_coast_down():
    """Its residuals repeat each other for hundreds of samples: with the weight of as many independent samples they would set the inertia, wrong and sure."""
    run = simulate(compose(CURVED), 0.6, start={"joint.speed": 4.0}, output_times=np.arange(0.0, 0.6, 0.002))
    coast = {"time": run.time, "joint.speed": run["joint.speed"] + 0.05 * np.random.default_rng(5).standard_normal(run.time.size)}
    found = identify([rises(0.004), coast], "Joint", fixed="joint.torque_offset")
    told = {name: value for name, value in CURVE.items() if name in found.names}
    assert "joint.inertia" in told and off(found, told) == []
    assert any("joint.torque scatters by about 0.004" in line and "record the command of the drive" in line for line in found.force_noise)


def test_a_torque_without_noise_has_no_remark_of_its_noise():
    assert identify(log(SINE), "Joint").force_noise == ()


def test_a_torque_that_jumps_between_lines_gives_the_stribeck_curve():
    time, plant = np.arange(0.0, 6.0, 0.004), compose(CURVED)
    torque = np.select(
        [time < 0.3, time < 0.8, time < 1.2, time < 1.7, time < 2.0], [0.0, 0.62, 0.0, -0.62, 0.0], 0.7 * np.sin(np.pi * (time - 2.0))
    )
    jumping = Recording.of({"time": time, "joint.torque": torque}, plant).stepping(["joint.torque"])
    run = simulate(plant, time[-1], inputs=jumping.driving(plant), output_times=time)
    found = identify({"time": time, "joint.angle": np.round(run["joint.angle"] / 1e-4) * 1e-4, "joint.torque": torque}, "Joint")
    assert found.stepped and off(found, CURVE) == []
    assert "joint.torque jumps at its samples" in str(found)


def test_a_wide_interval_names_its_reason_and_the_experiment():
    found = identify(log(SINE), "Joint")
    size, law = len(found.names), "bearing.friction.dry.static"
    i, k = found.names.index("joint.inertia"), found.names.index(law)
    errors = 0.1 * np.abs(found.values)
    covariance = np.diag(errors**2)
    covariance[i, k] = covariance[k, i] = 0.95 * errors[i] * errors[k]
    wide = dataclasses.replace(found, standard_errors=errors, covariance=covariance)
    told = hardly_told(wide, "joint.inertia")
    assert (
        set(told) == {"joint.inertia"}
        and f"`{law}` (correlation +0.95)" in told["joint.inertia"]
        and "accelerate by" in told["joint.inertia"]
    )
    apart = dataclasses.replace(wide, covariance=np.diag(errors**2))
    assert hardly_told(apart, "joint.inertia") == {} and hardly_told(found, "joint.inertia") == {} and size > 3


def test_a_wide_interval_of_a_stribeck_speed_says_what_it_is():
    speed = np.linspace(0.005, 0.6, 21)
    found = identify({"axis.speed": speed, "axis.force": 5.0 + 15.0 * np.exp(-((speed / 0.07) ** 2)) + 35.0 * speed})
    wide = dataclasses.replace(found, standard_errors=0.25 * np.abs(found.values))
    told = hardly_told(wide, "axis.mass")
    assert [*told] == ["rail.friction.dry.stribeck_speed"] and "around which friction falls from static to kinetic" in next(
        iter(told.values())
    )
