"""Smoothed friction: it converges to the set-valued law with its width, creeps at the speed of theory, and works in other integrators."""

import math
import pickle

import casadi as ca
import numpy as np
import pytest

from controllers import PI, IdealSlidingMode
from models import BitRock, BlockOnBelt, Coulomb, TwoDisks, wells
from tests.mechanisms import Ball
from tests.plants import BELT
from toolbox import SceneError, compose, linearise, simulate
from toolbox.errors import AccuracyError
from toolbox.modelling import smoothed
from toolbox.simulation import Smoothing

RIG = compose(wells.JANSEN_2, BitRock(weight=97_000.0))
DRIVE = PI(proportional=4000.0, integral=1500.0, reference=8.0)


def test_the_motion_tends_to_that_of_the_set_valued_law_as_the_width_falls():
    exact = simulate(RIG, 60.0, controller=DRIVE, accuracy=1e-10)
    widths = [1e-3, 1e-4, 1e-5, 1e-6]
    errors = [simulate(RIG, 60.0, controller=DRIVE, method=Smoothing(w)).difference(exact) for w in widths]
    order = np.polyfit(np.log(widths), np.log(errors), 1)[0]
    assert 2 / 3 - 0.05 < order < 1.1  # 1 where the contact creeps, 2/3 where the passage of a peak dominates
    assert errors[-1] < 1e-4


@pytest.mark.parametrize("share", [0.3, 0.6])
def test_a_loaded_contact_creeps_at_the_speed_of_its_law_where_the_set_valued_one_rests(share):
    plant = compose(BlockOnBelt(stiffness=1e-9, belt_speed=0.0, friction=Coulomb(static=1.0, kinetic=1.0)))
    run = simulate(plant, 20.0, inputs={"block.force": share}, method=Smoothing(1e-3))
    assert run["block.speed"][-1] == pytest.approx(1e-3 * math.atanh(share), rel=1e-6)
    assert simulate(plant, 20.0, inputs={"block.force": share})["block.speed"][-1] == 0.0
    assert run.time_in("belt", "stick") == 20.0  # less than three widths


@pytest.mark.parametrize("width", [0.1, 0.01, 0.001])
def test_the_matched_form_breaks_free_at_the_static_bound_and_the_plain_one_below_it(width):
    plant = compose(BlockOnBelt(stiffness=1e-9, belt_speed=0.0))  # F_s = 1 N, falling with 3 s/m
    speed = np.linspace(0.0, 30.0 * width, 20_001)

    def peak(matched):
        smooth = smoothed(plant, width, match_static_peak=matched)
        force = smooth.function("force", smooth.expression("belt.force"), "F")
        states = np.vstack([np.zeros_like(speed), speed])
        return np.abs(np.array(force(0.0, states, smooth.input_defaults(smooth.values), smooth.values, 0.0))).max()

    assert peak(True) == pytest.approx(1.0, rel=1e-5)
    assert peak(False) < 1.0 - 2 * width  # about w F_s' times some widths


def test_a_smooth_plant_runs_in_the_integrator_of_casadi():
    start = {"block.position": 0.5}
    smooth = smoothed(BELT, 1e-2)
    form = smooth.to_casadi()
    problem = {"t": form["t"], "x": form["x"], "p": ca.vertcat(form["p"], form["u"]), "ode": form["ode"]}
    grid = np.linspace(0.0, 20.0, 41)
    solver = ca.integrator("solver", "cvodes", problem, 0.0, grid, {"reltol": 1e-10, "abstol": 1e-12, "max_num_steps": 100_000})
    numbers = np.concatenate([smooth.values, np.zeros(1), np.array(smooth.input_defaults(smooth.values)).ravel()])
    theirs = np.array(solver(x0=[0.5, 0.0], p=numbers)["xf"]).T
    ours = simulate(smooth, 20.0, start=start, accuracy=1e-9)
    np.testing.assert_allclose(ours.at(grid).states, theirs, atol=1e-6)


def test_a_smooth_plant_and_the_method_are_the_same_run():
    by_method = simulate(RIG, 20.0, controller=DRIVE, method=Smoothing(1e-3))
    by_plant = simulate(smoothed(RIG, 1e-3), 20.0, controller=DRIVE, method="stiff", accuracy=by_method.run.method.tolerance)
    assert (by_method.states == by_plant.states).all()


def test_every_law_of_friction_keeps_its_signals():
    for plant, contact, duration in ((compose(TwoDisks()), "disks", 1.0), (RIG, "bit", 5.0)):
        run = simulate(plant, duration, method=Smoothing(1e-3), start={"disks.rotor_speed": 2.0} if contact == "disks" else {})
        assert set(run.names) == set(simulate(plant, 0.0).names)
        assert np.isfinite(run[f"{contact}.force"]).all()


def test_a_relay_is_smoothed_to_a_boundary_layer():
    law = IdealSlidingMode(reference=8.0, inertia=2122.0, drag=340.0)  # a drag that is wrong by a fifth, to hold against
    ideal = simulate(RIG, 30.0, controller=law)
    layers = [simulate(RIG, 30.0, controller=law, method=Smoothing({"idealslidingmode": w, "bit": 1e-7})) for w in (1e-2, 1e-3)]
    surface = [np.abs(run["idealslidingmode.surface"][run.time > 25.0]).max() for run in layers]
    assert np.abs(ideal["idealslidingmode.surface"][ideal.time > 25.0]).max() < 1e-12
    assert surface[1] < 0.2 * surface[0]


def test_elements_that_are_not_named_stay_set_valued():
    run = simulate(RIG, 10.0, controller=IdealSlidingMode(reference=8.0), method=Smoothing({"idealslidingmode": 1e-3}))
    assert set(np.unique(run.modes["bit"])) <= {"stick", "slip+", "slip-"}
    assert (run["bit.speed"][run.modes["bit"] == "stick"] == 0.0).all()


def test_a_linear_model_of_a_smooth_plant_has_the_slope_of_its_law():
    plant = compose(BlockOnBelt(friction=Coulomb(static=1.0, kinetic=1.0)))
    model = linearise(smoothed(plant, 0.05), at={"block.position": 0.0, "block.speed": 0.2})
    assert model.A[1, 1] == pytest.approx(-1.0 / 0.05)  # -F_s / (m w)
    assert model.A[1, 0] == pytest.approx(-1.0)


def test_parameters_of_a_smooth_plant_match_its_peaks_again():
    twice = smoothed(BELT, 1e-2).with_parameters({"belt.friction.static": 2.0})
    assert twice.parameter("belt.smoothing_peak") == pytest.approx(
        smoothed(BELT.with_parameters({"belt.friction.static": 2.0}), 1e-2).parameter("belt.smoothing_peak")
    )
    assert twice.parameter("belt.smoothing_width") == 1e-2


def test_a_smooth_plant_and_its_run_travel():
    smooth = pickle.loads(pickle.dumps(smoothed(BELT, 1e-2)))
    assert smooth.widths == {"belt": 1e-2}
    run = simulate(BELT, 5.0, method=Smoothing(1e-2))
    twin = pickle.loads(pickle.dumps(run))
    assert (twin.at(2.5).states == run.at(2.5).states).all()
    assert twin.widths == {"belt": 1e-2}
    assert "smoothed, width 0.01 (belt)" in str(run)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4])
def test_the_dial_finds_the_width_and_reports_the_error_that_was_made(accuracy):
    exact = simulate(RIG, 100.0, controller=DRIVE, accuracy=1e-10)
    run = simulate(RIG, 100.0, controller=DRIVE, method="smoothed", accuracy=accuracy)
    made = run.difference(exact)
    assert made < accuracy
    assert made / 10 < run.error_estimate < 10 * made
    given = simulate(RIG, 100.0, controller=DRIVE, method=Smoothing(run.widths))
    assert made / 10 < given.error_estimate < 10 * made


def test_what_cannot_be_smoothed_or_reached_says_so():
    with pytest.raises(SceneError, match="The rigid contact `floor` cannot be smoothed: give it a `stiffness`"):
        simulate(compose(Ball()), 1.0, method="smoothed")
    with pytest.raises(SceneError, match="Argument `width.belt` must be > 0 m/s, but it is 0.0"):
        simulate(BELT, 1.0, method=Smoothing(0.0))
    with pytest.raises(SceneError, match="There is no friction or relay `bell`: did you mean `belt`"):
        smoothed(BELT, {"bell": 0.1})
    with pytest.raises(AccuracyError, match="cannot meet the accuracy 1e-12"):
        simulate(BELT, 50.0, method="smoothed", accuracy=1e-12)
