"""Severity maps: both borders, each against something that knows it otherwise, for every law."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import optimize

from controllers import PI, ImplicitSlidingMode, Lifting, SoftTorque, StiffPI, SuperTwisting
from models import BitRock, BlockOnBelt, Coulomb, wells
from toolbox import (
    Sampled,
    Scene,
    SceneError,
    closed_loop,
    compose,
    follow,
    hopf_curve,
    limit_cycle,
    onset,
    severity_map,
    simulate,
)
from toolbox.commands.command_line import main
from toolbox.onsets.borders import Edges, border
from toolbox.onsets.carried import Job
from toolbox.onsets.severity_map import SMOOTH, STICK_SLIP, SeverityMap

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
OVER = {"top.reference": (3.0, 14.0), "bit.weight": (50e3, 110e3)}
SCENES = Path(__file__).parents[2] / "studies" / "scenes"


@pytest.fixture(scope="module")
def found():
    return severity_map(closed_loop(RIG, StiffPI()), OVER, shape=(9, 4), halvings=5)


def test_a_border_between_cells_is_halved_onto_the_circle_that_makes_it():
    axes = (np.linspace(-1.5, 1.5, 17), np.linspace(-1.5, 1.6, 23))

    def inside(points):
        return (points**2).sum(axis=-1) < 1.0

    where, segments = border(axes, inside, halvings=50)
    places = segments.reshape(-1, 2)
    assert where.sum() == sum(inside(np.array([[x, y] for x in axes[0] for y in axes[1]])))
    np.testing.assert_allclose((places**2).sum(axis=1), 1.0, atol=1e-12)
    length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum()
    assert length == pytest.approx(2 * np.pi, rel=0.01)
    _, often = np.unique(places, axis=0, return_counts=True)
    assert (often == 2).all()  # one closed line


def test_smooth_running_of_a_continuous_law_is_lost_on_the_hopf_curve(found):
    weights = found.axes[1]
    curve = hopf_curve(closed_loop(RIG, StiffPI()), "top.reference", OVER["top.reference"], "bit.weight", weights)
    for weight, speed in zip(weights, curve, strict=True):
        assert found.border("smooth", weight) == pytest.approx([speed], rel=1e-9)


def test_an_edge_is_crossed_where_its_function_is_zero_and_not_where_it_does_not_change_its_sign():
    edges = Edges(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]]), np.array([[1.0, 0.0], [2.0, 0.0], [0.0, 4.0]]), np.empty((0, 2), int))
    parts = edges.roots(lambda points: np.exp(points[:, 0]) - 1.5 + points[:, 1] ** 3 - 20.0 * (points[:, 1] > 0), 1e-12)
    assert parts[0] == pytest.approx(np.log(1.5), rel=1e-12)
    assert np.isnan(parts[1])
    assert parts[2] == pytest.approx((20.5 ** (1 / 3) - 2.0) / 2.0, rel=1e-12)


def test_an_edge_on_which_a_function_jumps_from_minus_one_to_one_is_crossed_at_the_jump():
    edges = Edges(np.zeros((1, 2)), np.array([[1.0, 0.0]]), np.empty((0, 2), int))
    assert edges.roots(lambda points: np.where(points[:, 0] < 0.7, -1.0, 1.0), 1e-9) == pytest.approx([0.7], abs=1e-9)


def test_where_a_function_is_zero_to_the_last_bit_no_further_point_is_asked_for():
    edges, asked = Edges(np.zeros((1, 2)), np.array([[1.0, 0.0]]), np.empty((0, 2), int)), []

    def values(points):
        asked.append(points[0, 0])
        return points[:, 0] - 0.25

    assert edges.roots(values, 1e-12) == [0.25] and asked == [0.0, 1.0, 0.25]


LAWS = {
    "PI": closed_loop(RIG, StiffPI()),
    "PI at 100 Hz": closed_loop(RIG, Sampled(StiffPI(), 0.01)),
    "super-twisting": closed_loop(RIG, SuperTwisting(), sample_time=0.01),
    "implicit sliding mode": closed_loop(RIG, ImplicitSlidingMode(), sample_time=0.01),
    "lifting": closed_loop(RIG, Lifting(SoftTorque()), sample_time=0.01),
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow) if name != "PI at 100 Hz" else name for name in LAWS])
def test_both_borders_of_every_law_are_those_that_onset_finds(name):
    over = {"top.reference": (3.1, 14.0), "bit.weight": (80e3, 110e3)}
    mapped = severity_map(LAWS[name], over, shape=(6, 6), halvings=3)
    weight = float(mapped.axes[1][3])
    both = onset(LAWS[name].at("bit.weight", weight), "top.reference", over["top.reference"], num_values=6)
    cell = float(np.diff(mapped.axes[0])[0])
    assert mapped.border("smooth", weight) == pytest.approx([both.loss], abs=0.1 * cell * mapped.resolution)
    assert mapped.border("sticking", weight) == pytest.approx([both.end], abs=cell * mapped.resolution)
    assert not mapped.regions["none"].any()


@pytest.mark.slow
def test_a_function_in_python_is_mapped_and_its_borders_are_those_of_onset():
    def drive(t, y):
        return 8e3 + 4e3 * (y[1] - y[0])

    drive.defaults = {"top.reference": (6.0, "rad/s")}
    loop = closed_loop(RIG, Sampled(drive, 0.02, measured_signals="top.speed", actuated_signals="top.torque"))
    over = {"bit.weight": (40e3, 120e3), "chain.bit_drag": (30.0, 50.0)}
    mapped = severity_map(loop, over, shape=(np.int64(3), np.int32(2)), halvings=np.int64(2))
    both = onset(loop.at("chain.bit_drag", 50.0), "bit.weight", over["bit.weight"], num_values=3, tolerance=2e3)
    cell = float(np.diff(mapped.axes[0])[0])
    assert mapped.border("smooth", 50.0) == pytest.approx([border.value for border in both.losses], abs=cell * mapped.resolution)
    assert mapped.border("sticking", 50.0) == pytest.approx([border.value for border in both.ends], abs=cell * mapped.resolution)
    assert len(both.losses) + len(both.ends) > 0


# well, law, a range of the set-point and the number of its values; where the bit is stopped at once stick-slip dies earlier than in its cycle
CARRIED = [
    (wells.JANSEN_2, SoftTorque(), (4.0, 12.0), 9),
    (wells.JANSEN_2, SoftTorque(), (8.0, 9.0), 3),
    (wells.NAVARRO_LOPEZ_4, StiffPI(), (5.0, 8.0), 7),
    (wells.NAVARRO_LOPEZ_4, StiffPI(), (6.6, 9.5), 6),
    (wells.NAVARRO_LOPEZ_4, SoftTorque(), (3.0, 9.0), 9),
    (wells.NAVARRO_LOPEZ_2, SoftTorque(), (5.0, 8.0), 6),
]


@pytest.mark.slow
@pytest.mark.parametrize(("well", "law", "between", "values"), CARRIED)
def test_stick_slip_ends_where_its_cycle_followed_does_whatever_range_is_mapped(well, law, between, values):
    plant = compose(well, BitRock())
    seed = {wells.JANSEN_2: 6.0, wells.NAVARRO_LOPEZ_2: 4.0}.get(well, 5.0 if isinstance(law, StiffPI) else 3.0)
    cycle = limit_cycle(simulate(plant, 400.0, controller=law, inputs={"top.reference": seed}, accuracy=1e-9))
    lost = follow(cycle, "top.reference", (seed, 14.0), start_towards=14.0).bifurcations[0].value
    over = {"top.reference": between, "bit.weight": (97_347.0 - 500.0, 97_347.0 + 500.0)}
    found = severity_map(closed_loop(plant, law), over, shape=(values, 3), halvings=8)
    assert found.border("sticking", 97_347.0) == pytest.approx([lost], rel=5e-3)


@pytest.mark.slow
def test_standstill_is_no_stick_slip_and_has_regions_of_its_own():
    plant = compose(wells.NAVARRO_LOPEZ_4, BitRock())
    found = severity_map(plant, {"top.torque": (9600.0, 13_000.0), "bit.weight": (97_000.0, 97_694.0)}, shape=(18, 3), halvings=6)
    # the cycle of this string lives between its stall and its end, far below the break-away torque of 12 116 N m
    both = onset(closed_loop(plant, inputs={"top.torque": 10_300.0}), "top.torque", (9000.0, 13_000.0), num_values=5)
    assert found.border("sticking", 97_347.0) == pytest.approx([both.stall, both.end], rel=5e-3)
    assert not found.regions["bistable"][found.axes[0] > 10_700.0].any() and found.regions["smooth or stuck"].any()
    assert "smooth until it is stopped" in str(found)


def test_the_border_of_stick_slip_is_far_from_that_of_smooth_running(found):
    weight = found.axes[1][2]
    assert found.border("sticking", weight)[0] > 2 * found.border("smooth", weight)[0]  # the margin to one says nothing about the other


def test_regions_cover_the_map_once_and_both_branches_agree_outside_the_bistable_band(found):
    regions = found.regions
    assert (sum(where.astype(int) for where in regions.values()) == 1).all()
    assert regions["bistable"].any() and regions["free"].any() and regions["stick-slip"].any()
    free = regions["free"]
    assert (found.smooth.severity[free] < 1e-3).all()
    assert (found.smooth.verdict[free] == SMOOTH).all()
    sticks = regions["stick-slip"]
    assert (found.sticking.verdict[sticks] == STICK_SLIP).all()
    assert (found.sticking.severity[sticks | regions["bistable"]] > 0.9).all()


def test_a_sampled_law_is_mapped_as_it_runs_sampled():
    maps = [
        severity_map(closed_loop(RIG, law), {"top.reference": (5.0, 14.0), "bit.weight": (60e3, 80e3)}, shape=(3, 2), halvings=0)
        for law in (StiffPI(), Sampled(StiffPI(), 0.01, 0.005))
    ]
    np.testing.assert_array_equal(maps[0].smooth.verdict, maps[1].smooth.verdict)
    np.testing.assert_array_equal(maps[0].sticking.verdict, maps[1].sticking.verdict)
    assert (maps[0].growth != maps[1].growth).all() and np.allclose(maps[0].growth, maps[1].growth, rtol=0.05)
    assert "matrices" in maps[1].notes[0] and not maps[0].notes


def test_parameters_of_plant_and_law_may_be_varied():
    found = severity_map(
        closed_loop(RIG, PI(reference=9.0)),
        {"pi.proportional": (4e3, 2e4), "chain.bit_drag": (20.0, 60.0)},
        shape=(3, 3),
        halvings=1,
    )
    assert found.units == ("N m s/rad", "N m s/rad")
    assert not found.failures
    assert found.sticking.verdict[-1, 0] == STICK_SLIP  # stiff, little drag
    assert found.sticking.verdict[0, -1] == SMOOTH  # soft, much drag


def test_what_is_saved_comes_back_and_prints_and_draws(found, tmp_path):
    back = SeverityMap.load(found.save(tmp_path / "map.npz"))
    assert str(back) == str(found)
    assert "bistable" in str(found) and "existing stick-slip ends" in str(found)
    np.testing.assert_array_equal(back.sticking.severity, found.sticking.severity)
    for name in found.borders:
        np.testing.assert_array_equal(back.borders[name], found.borders[name])
    axes = back.plot()
    assert [ax.get_xlabel() for ax in axes] == ["top reference [rad/s]"] * 2
    assert axes[0].get_ylabel() == "bit weight [kN]"
    assert axes[0].get_ylim() == (50.0, 110.0)
    with pytest.raises(SceneError, match="There is no border `hopf`"):
        found.border("hopf", 60e3)


def test_a_map_of_an_earlier_version_comes_back_and_one_that_judged_in_a_window_is_refused(found, tmp_path):
    words = ["title", "names", "units", "element", "signal", "duration", "accuracy", "resolution", "runs", "notes"]
    told = {name: getattr(found, name) for name in words} | {
        "at": found.nominal_point,
        "seconds": 1.0,
        "errors": [["smooth", 1, 2, "it failed"]],
    }
    arrays = {"axis.0": found.axes[0], "axis.1": found.axes[1], "growth": found.growth}
    arrays |= {f"{branch}.{name}": values for branch in ("smooth", "sticking") for name, values in vars(getattr(found, branch)).items()}
    arrays |= {f"border.{name}": segments for name, segments in found.borders.items()}
    np.savez_compressed(tmp_path / "map.npz", map=np.array(json.dumps(told)), **arrays)
    back = SeverityMap.load(tmp_path / "map.npz")
    assert str(back) == str(dataclasses.replace(found, failures={("smooth", 1, 2): "it failed"}, display_units={}, situation=""))
    np.testing.assert_array_equal(back.sticking.severity, found.sticking.severity)
    np.testing.assert_array_equal(back.borders["sticking"], found.borders["sticking"])
    told["errors"] = [["smooth", 9, 0, "it failed"]]
    np.savez_compressed(tmp_path / "map.npz", map=np.array(json.dumps(told)), **arrays)
    with pytest.raises(SceneError, match="map.npz` must be .*: it has an error of a run that it does not have"):
        SeverityMap.load(tmp_path / "map.npz")
    np.savez_compressed(tmp_path / "map.npz", map=np.array(json.dumps(told)), **{"smooth.ratio": found.growth})
    with pytest.raises(SceneError, match="judged its runs in a window of time: map it again"):
        SeverityMap.load(tmp_path / "map.npz")


@pytest.mark.parametrize("law", [StiffPI(), Sampled(StiffPI(), 0.01, delay=0.015)], ids=["continuous", "late"])
def test_an_interrupted_map_goes_on_where_it_was(law, tmp_path, monkeypatch):
    loop, arguments = closed_loop(RIG, law), {"shape": (4, 3), "halvings": 2}
    whole = severity_map(loop, OVER, **arguments, checkpoint=tmp_path / "map")
    journal = tmp_path / "map" / "runs.jsonl"
    lines = cut_in_half(journal)
    assert len(lines) == 1 + whole.runs
    done = []
    monkeypatch.setattr(Job, "__call__", lambda job, own=Job.__call__: (done.append(job), own(job))[1])
    again = severity_map(loop, OVER, **arguments, checkpoint=tmp_path / "map")
    assert len(done) == whole.runs - (len(lines) // 2 - 1)
    assert journal.read_bytes() == b"".join(lines)
    np.testing.assert_array_equal(again.sticking.severity, whole.sticking.severity)
    np.testing.assert_array_equal(again.borders["sticking"], whole.borders["sticking"])
    with pytest.raises(
        SceneError, match="Argument `checkpoint` must come from a search with the same arguments.*another `shape`. Name another"
    ):
        severity_map(loop, OVER, **{**arguments, "shape": (3, 3)}, checkpoint=tmp_path / "map")


def cut_in_half(journal):
    """The lines of a journal, of which the file keeps the first half and a beginning: it was killed while it wrote."""
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[: len(lines) // 2]) + lines[len(lines) // 2][:20])
    return lines


@pytest.mark.parametrize("law", [StiffPI(), Sampled(StiffPI(), 0.01, delay=0.015)], ids=["continuous", "late"])
def test_an_interrupted_onset_goes_on_where_it_was(law, tmp_path, monkeypatch):
    loop, arguments = closed_loop(RIG, law), {"parameter": "top.reference", "num_values": 4, "checkpoint": tmp_path / "onset.jsonl"}
    whole = onset(loop, bounds=(8.0, 14.0), **arguments)
    lines = cut_in_half(tmp_path / "onset.jsonl")
    assert len(lines) == 1 + whole.runs
    done = []
    monkeypatch.setattr(Job, "__call__", lambda job, own=Job.__call__: (done.append(job), own(job))[1])
    again = onset(loop, bounds=(8.0, 14.0), **arguments)
    assert len(done) == whole.runs - (len(lines) // 2 - 1)
    assert (tmp_path / "onset.jsonl").read_bytes() == b"".join(lines)
    assert str(again) == str(whole) and again.end == whole.end
    with pytest.raises(
        SceneError, match="Argument `checkpoint` must come from a search with the same arguments.*another `bounds`. Name another"
    ):
        onset(loop, bounds=(8.0, 13.0), **arguments)


def test_the_command_maps_a_scene(tmp_path, capsys):
    command = ["map", str(SCENES / "jansen_2.toml"), "--range", "top.reference=30 rpm:130 rpm", "--range", "bit.weight=50kN:110kN"]
    assert main([*command, "--shape", "4x3", "--controller", "softer PI, 100 Hz", "--out", str(tmp_path / "maps")]) == 0
    assert "share of the map" in capsys.readouterr().out
    folder = tmp_path / "maps" / "01_softer_pi_100_hz"
    assert {"map.npz", "map.png", "map.txt"} <= {path.name for path in folder.iterdir()}
    assert SeverityMap.load(folder / "map.npz").smooth.verdict.shape == (4, 3)
    assert main([*command[:-1], "bit.weight=50kN", "--out", str(tmp_path / "none")]) == 2
    assert "Argument `--range` must be NAME=LOW:HIGH" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ranges": {"bit.weight": (1e3, 2e3)}}, "Argument `ranges` must map two names"),
        ({"ranges": {"bit.weight": (3e3, 2e3), "top.reference": (3.0, 4.0)}}, r"Argument `bit.weight` must be two finite numbers \(low"),
        (
            {"ranges": {"bit.wait": (1e3, 2e3), "top.reference": (3.0, 4.0)}},
            "There is no number `bit.wait` in this loop: did you mean `bit.weight`",
        ),
        ({"shape": (np.int64(1), 3)}, "Argument `shape.0` must be an integer >= 2"),
        ({"shape": (3,)}, "Argument `shape` must be two integers >= 2"),
        ({"halvings": -1}, "Argument `halvings` must be an integer >= 0 and <= 20"),
        ({"duration": 0.0}, "Argument `duration` must be > 0 s"),
        ({"ranges": {"bit.weight": (-1e3, 2e3), "top.reference": (3.0, 4.0)}}, "Argument `bit.weight` must be >= 0 N"),
    ],
)
def test_arguments_that_make_no_sense_are_refused_by_name(changes, message):
    with pytest.raises(SceneError, match=message):
        severity_map(closed_loop(RIG, StiffPI()), **{"ranges": OVER, **changes})


def test_a_contact_to_be_judged_that_there_is_not_is_refused_by_name():
    with pytest.raises(SceneError, match="There is no contact `bot` to be judged"):
        severity_map(closed_loop(RIG, StiffPI(), element="bot"), OVER)


def test_a_scene_whose_inputs_move_has_no_steady_state(tmp_path):
    scene = Scene.load(SCENES / "jansen_2.toml")
    from toolbox.scenes.cases import Waveform

    moving = dataclasses.replace(scene, inputs={"bit.weight": Waveform("sine", {"mean": 9e4, "amplitude": 1e3, "frequency": 0.1})})
    with pytest.raises(SceneError, match="`bit.weight` must be a number"):
        severity_map(moving["stiff PI"], {"top.reference": (3.0, 14.0), "chain.bit_drag": (20.0, 60.0)})


def grazing(damping):
    """Belt speed v beyond which a block under Coulomb friction 1 at rest and 1/2 in slip does not stick again, m = k = 1.

    It lets go at k x = 1 - c v with the speed v, swings about k x = 1/2 once, and sticks where the largest speed of that swing reaches v.
    """
    decay = damping / 2
    w = math.sqrt(1 - decay**2)
    t = np.linspace(4.0, 8.0, 40_001)

    def reserve(v):
        a, b = 0.5 - damping * v, (v + decay * (0.5 - damping * v)) / w
        return (np.exp(-decay * t) * ((w * b - decay * a) * np.cos(w * t) - (decay * b + w * a) * np.sin(w * t))).max() - v

    return optimize.brentq(reserve, 0.1, 20.0)


def test_the_border_of_grazing_is_known_to_its_part_of_a_cell_at_low_damping_too():
    """With a damping ratio of 0.0005 the cycle has a thousandth more speed than it needs: led in steps of a 24th of a cell it was lost 0.32 of a cell early."""
    block = compose(BlockOnBelt(mass=1.0, stiffness=1.0, belt_speed=1.0, damping=0.05, load=1.0, friction=Coulomb(static=1.0, kinetic=0.5)))
    over = {"block.belt_speed": (0.2, 8.0), "block.damping": (0.001, 0.2)}
    found = severity_map(closed_loop(block), over, shape=(13, 3))
    cell = (8.0 - 0.2) / 12
    for damping in found.axes[1].tolist():
        (border,) = found.border("sticking", damping)
        assert abs(border - grazing(damping)) <= 0.5 * found.resolution * cell * 1.001, damping
