"""What a drive sends back of a wave, against the impedances written by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controllers import PI, SlidingMode, SoftTorque, StiffPI
from models import BitRock, TopDrive, wells
from toolbox import Sampled, SceneError, compose, impedance
from toolbox.steady_states import reflection

W = np.array([0.1, 1.0, 3.0, 20.0])
CHAIN = wells.JANSEN_2
ZETA = math.sqrt(473.0 * 374.0)
"""sqrt(k J_b) [N m s/rad], the impedance of the lumped string below the top."""


def test_the_impedance_of_a_pi_law_is_its_transfer_function():
    z = impedance(PI(proportional=4000.0, integral=1500.0), frequency=W)
    np.testing.assert_allclose(z, 4000.0 + 1500.0 / (1j * W), rtol=1e-12)


def test_soft_torque_absorbs_at_its_design_frequency_and_a_stiff_drive_reflects():
    # K_i = w_n^2 J_r cancels the inertia of the top at w_n = sqrt(k / J_b), and K_p is what the string asks for
    plant, w_n = compose(CHAIN, BitRock()), math.sqrt(473.0 / 374.0)
    at = {"frequency": [w_n], "plant": plant, "inertia": CHAIN.inertia[0]}
    assert abs(reflection(impedance(SoftTorque(), **at), ZETA)[0]) < 1e-12
    assert abs(reflection(impedance(StiffPI(), **at), ZETA)[0]) > 0.9
    # off the frequency the match is lost
    off = {"frequency": [3 * w_n], "plant": plant, "inertia": CHAIN.inertia[0]}
    assert abs(reflection(impedance(SoftTorque(), **off), ZETA)[0]) > 0.9
    # detuned gains reflect |P - zeta| / (P + zeta) where the inertia is cancelled
    law = PI(proportional=2 * ZETA, integral=w_n**2 * CHAIN.inertia[0])
    assert abs(reflection(impedance(law, **at), ZETA)[0]) == pytest.approx(1 / 3, rel=1e-12)


def test_drag_on_the_top_absorbs_too_and_spoils_the_match():
    at = {"frequency": [math.sqrt(473.0 / 374.0)], "plant": compose(CHAIN, BitRock()), "inertia": CHAIN.inertia[0], "drag": 425.0}
    assert abs(reflection(impedance(SoftTorque(), **at), ZETA)[0]) == pytest.approx(425.0 / (2 * ZETA + 425.0), rel=1e-12)


def test_lags_of_the_drive_turn_the_impedance():
    drive = TopDrive(drive_lag=0.05, encoder_lag=0.02)
    z = impedance(PI(proportional=4000.0, integral=1500.0), drive, frequency=W)
    np.testing.assert_allclose(z, (4000.0 + 1500.0 / (1j * W)) / ((1 + 0.05j * W) * (1 + 0.02j * W)), rtol=1e-12)


def test_sampling_and_delay_turn_it_by_half_a_period_and_the_delay():
    law = PI()
    z = impedance(Sampled(law, 0.02, 0.01), frequency=W)
    np.testing.assert_allclose(z, impedance(law, frequency=W) * np.exp(-0.02j * W), rtol=1e-12)


def test_a_fixed_end_and_a_free_end_send_everything_back():
    np.testing.assert_allclose(reflection(np.array([0.0, 1e15]), ZETA), [1.0, -1.0], rtol=1e-10)


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: impedance(PI(), frequency=[0.0]), "frequency"),
        (lambda: impedance(PI(), frequency=[1.0], inertia=-1.0), "inertia"),
        (lambda: impedance(lambda t, y: 0.0, frequency=[1.0]), "parts"),
        (lambda: impedance(TopDrive(), frequency=[1.0], torque_signal="top.load"), r"top\.load"),
        (lambda: impedance(SlidingMode(), frequency=[1.0], plant=compose(CHAIN, BitRock())), r"bit\.speed"),
        (lambda: reflection(np.ones(1), 0.0), "characteristic"),
    ],
)
def test_a_mistake_is_named(call, word):
    with pytest.raises(SceneError, match=word):
        call()
