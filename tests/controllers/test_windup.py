"""Integrals of sampled controllers whose command is cut: what is left of them is bounded for every sample time, and why.

Back-calculation. The drive stands at a speed that it cannot leave, so that the error e is constant, and the command stays at its limit. With a gain I on the
integral z, which is led back in the tracking time T_t, the excess x = wanted - command obeys, from sample to sample of the period T,

    z' = z + T (e - x / (I T_t)),    x' = (1 - T / T_t) x + T I e.

With T_t >= T the factor is between 0 and 1, so that |x_k| <= |x_0| + I max(T_t, T) |e|: bounded, whatever the gains are. With T > 2 T_t it grows by
|1 - T / T_t| > 1 at each sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

from controllers import LQR, PI, HInfinity, SlidingMode, ZTorque
from models import BitRock, wells
from toolbox import Component, Equations, SceneError, compose, quantity, simulate, state

HIGHEST, SPEED, REFERENCE = 5e3, 1.0, 9.0


@dataclass(frozen=True)
class Jammed(Component):
    """A drive that turns at a constant speed, whatever its torque is: the string takes all of it."""

    speed: float = quantity(SPEED, "rad/s", "speed of the drive")

    def equations(self, signal):
        torque, speed = signal("top.torque", "N m", default=0.0), ca.SX(self.speed)
        gives = {"top.speed": (speed, "rad/s"), "bit.speed": (speed, "rad/s"), "top.load": (torque, "N m")}
        return Equations(flow={state("jammed.angle", "rad"): self.speed}, outputs=gives)


PLANT = compose(Jammed())


PERIOD, GAIN, ERROR = 0.1, 2000.0, REFERENCE - SPEED
LIMITS = {"lowest_torque": -HIGHEST, "highest_torque": HIGHEST, "reference": REFERENCE}


def law_of(kind, tracking):
    """(law, name of its integral z, wanted torque at z = 0, derivative of the wanted torque with z), with the tracking time [s]."""
    if kind == "PI":
        return PI(proportional=GAIN * tracking, integral=GAIN, **LIMITS), "pi.angle", GAIN * tracking * ERROR, GAIN
    if kind == "ZTorque":
        law = ZTorque(impedance=300.0, integral=GAIN, inertia=0.0, filter_time=PERIOD, back_calculation=GAIN * tracking, **LIMITS)
        return law, "ztorque.angle", 300.0 * ERROR, GAIN
    law = LQR(
        states=("bit.speed",),
        units=("rad/s",),
        gain=(300.0, GAIN),
        operating_point=(REFERENCE, 0.0),
        operating_point_slope=(0.0, 0.0),
        tracking_time=tracking,
        **LIMITS,
    )
    return law, "lqr.angle", 300.0 * ERROR, -GAIN  # u = ... - K_i z, z' = w - reference


@pytest.mark.parametrize("kind", ["PI", "ZTorque", "LQR"])
@pytest.mark.parametrize("ratio", [1e-3, 0.5, 1.0, 1.9, 2.1, 5.0, 1e3, 1e9])
def test_the_excess_of_a_command_that_is_cut_follows_its_recursion_and_is_bounded(kind, ratio):
    law, name, forward, slope = law_of(kind, PERIOD / ratio)
    many, tracking = 400, max(PERIOD / ratio, PERIOD)
    run = simulate(PLANT, many * PERIOD, controller=law, sample_time=PERIOD)
    angle = run.at((np.arange(many) + 0.5) * PERIOD)[name]  # as the law saw it at sample k
    excess = forward + slope * angle - HIGHEST
    first = int(np.argmax(excess > 0.0))
    assert first < 10
    after = (1.0 - PERIOD / tracking) * excess[first:-1] + PERIOD * GAIN * ERROR
    np.testing.assert_allclose(excess[first + 1 :], after, rtol=1e-9, atol=1e-6)
    assert np.abs(excess[first:]).max() <= excess[first] + GAIN * tracking * ERROR * (1.0 + 1e-9)
    if ratio > 2.0:  # the twin: led back with the tracking time itself, it grows without bound
        assert abs(1.0 - ratio) > 1.0


@pytest.mark.parametrize("ratio", [0.01, 1.0, 2.5, 100.0, 1e4])
def test_the_surface_of_a_drive_that_cannot_move_obeys_its_reaching_law_whatever_the_period_is(ratio):
    # the integral takes up what the drive cannot give, so that s' = s - T eta sat(s / width), as if it had been given: |s'| <= max(|s|, T eta)
    eta = 2.0
    width = eta * PERIOD / ratio
    law = SlidingMode(
        inertia=2000.0,
        drag=0.0,
        reaching_rate=eta,
        boundary_layer=width,
        surface_gain=0.2,
        lowest_torque=0.0,
        highest_torque=HIGHEST,
        reference=5.0,
    )
    run = simulate(PLANT, 60.0, controller=law, sample_time=PERIOD)
    middle = (np.arange(600) + 0.5) * PERIOD
    s, torque = run.at(middle)["slidingmode.surface"], run.at(middle)["top.torque"]
    same = np.flatnonzero(torque[1:-1] == torque[:-2]) + 1  # samples at which the string takes the torque that is commanded
    assert same.size > 20 and s[0] == SPEED - 5.0
    after = s - PERIOD * eta * np.clip(s / width, -1.0, 1.0)
    np.testing.assert_allclose(s[same + 1], after[same], atol=1e-9)
    assert (
        np.abs(s).max() <= max(abs(s[0]), PERIOD * eta) + PERIOD * HIGHEST / 2000.0
    )  # what the string takes is a sample behind the command


def test_the_observer_of_h_infinity_decays_while_its_command_is_cut_and_no_period_lets_it_grow():
    # Y > 0 with (A + B B'X / g^2 - Y C'C) Y + Y (...)' = -(Y (F'F / g^2 + C'C) Y + B B') < 0: all poles of K without its own torque are on the left
    law = HInfinity(lowest_torque=0.0, highest_torque=2e4).design(compose(wells.JANSEN_2, BitRock(weight=80e3)))
    n = law.order
    A = np.zeros((n, n))
    A.ravel()[list(law.nonzero_indices) or slice(None)] = law.controller_matrices[: -3 * n]
    _, C, drive = np.reshape(law.controller_matrices[-3 * n :], (3, n))
    poles = np.linalg.eigvals(A - np.outer(drive, C))
    assert poles.real.max() < 0.0
    fastest = np.abs(np.concatenate([poles, np.linalg.eigvals(A)])).max()
    law.check_period(2.0 / fastest)  # |1 + z + z^2 / 2 + z^3 / 6 + z^4 / 24| <= 1 for |z| <= 2 on the left
    with pytest.raises(SceneError, match="`sample_time` must be at most"):
        law.check_period(3.0 / fastest)  # beyond 2.83 nowhere on the left


def test_a_filter_of_z_torque_that_would_swing_ever_more_is_refused():
    # f' = f + T / T_f (w - f): |1 - T / T_f| > 1 above 2 T_f
    law = ZTorque(filter_time=0.05, lowest_torque=0.0, highest_torque=2e4)
    plant = compose(wells.JANSEN_2, BitRock(weight=80e3))
    assert np.isfinite(simulate(plant, 1.0, controller=law, sample_time=0.1)["top.torque"]).all()
    with pytest.raises(SceneError, match="`sample_time` must be <= 0.1 s"):
        simulate(plant, 1.0, controller=law, sample_time=0.101)
