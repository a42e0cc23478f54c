"""Periodic inputs against the answer of an integrator and of a brake."""

import numpy as np
import pytest

from models import DiscBrake, TorsionalChain
from toolbox import SceneError, compose, simulate
from toolbox.inputs import square, triangle


@pytest.mark.parametrize(("shape", "peak"), [(square, 0.25 * 0.4), (triangle, 0.125 * 0.4)])
def test_a_periodic_force_without_mean_moves_an_integrator_up_and_back_in_every_period(shape, peak):
    # speed of a free inertia of 1 kg m2 under +-0.4 N m of 2 Hz: half a period of a square gives 0.4 * 0.25, of a triangle half of that
    plant = compose(TorsionalChain(inertia=(1.0, 1.0), stiffness=(0.0,), damping=(0.0,)))
    run = simulate(plant, 5.0, inputs={"top.torque": shape(0.0, 0.4, 2.0, until=5.0)}, accuracy=1e-10)
    np.testing.assert_allclose(run.at(np.arange(0.0, 5.0, 0.5))["top.speed"], 0.0, atol=1e-9)
    np.testing.assert_allclose(run.at(np.arange(0.25, 5.0, 0.5))["top.speed"], peak, rtol=1e-9)


def test_a_square_pressure_of_a_brake_presses_with_its_two_values_only():
    run = simulate(compose(DiscBrake()), 0.5, start={"disc.speed": 5.0}, inputs={"brake.force": square(1000.0, 300.0, 40.0, until=0.5)})
    assert set(np.round(run["brake.force"], 9)) == {700.0, 1300.0}
    assert run.at(0.001)["brake.force"] == 1300.0


def test_waveforms_refuse_what_is_no_wave():
    for given in ((1.0, 1.0, 0.0, 1.0), (1.0, 1.0, 1.0, -1.0), (1.0, np.nan, 1.0, 1.0), (0.0, 1.0, 1e9, 1.0)):
        with pytest.raises(SceneError):
            square(*given)
