"""Systems of python-control as controllers: the law that comes back is the law that went out, and a loop is what theory says it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import control
import numpy as np
import pytest

from controllers import PI
from tests.plants import RIG
from toolbox import (
    Controller,
    Equations,
    Sampled,
    SceneError,
    Update,
    closed_loop,
    export_c,
    from_control,
    limit_cycle,
    onset,
    severity_map,
    simulate,
    state,
    sweep,
    to_control,
)
from toolbox.inputs import step
from toolbox.measure import severity
from toolbox.measuring import metrics

DRIVE = PI(reference=9.95, proportional=1500.0, integral=500.0)
SIGNALS = {"measured_signals": "top.speed", "actuated_signals": "top.torque"}


def pi(dt=0):
    """The transfer function of DRIVE, continuous or by the rule that its sampled form follows."""
    s = control.tf([1, 0], [1], dt)
    return 1500.0 + 500.0 / s if dt == 0 else 1500.0 + 500.0 * dt / (s - 1)


def test_a_pi_drive_as_a_transfer_function_runs_as_the_law_itself():
    mine, theirs = (simulate(RIG, 60.0, controller=law, accuracy=1e-9) for law in (DRIVE, from_control(pi(), reference=9.95, **SIGNALS)))
    assert len(mine.events) == len(theirs.events) > 0
    assert np.allclose(mine.at(60.0)["bit.speed"], theirs.at(60.0)["bit.speed"], atol=1e-7)
    faster = simulate(RIG, 60.0, controller=from_control(pi(), reference=9.95, **SIGNALS), inputs={"top.reference": step(9.95, 12.0, 20.0)})
    assert faster.at(60.0)["top.speed"] == pytest.approx(12.0, rel=0.03)


def test_a_set_point_and_a_working_point_may_be_typed_with_units():
    typed = from_control(pi(), reference="90 rpm", at={"top.torque": "2 kN m"}, **SIGNALS)
    plain = from_control(pi(), reference=3.0 * np.pi, at={"top.torque": 2000.0}, **SIGNALS)
    runs = [simulate(RIG, 20.0, controller=law) for law in (typed, plain)]
    assert np.array_equal(runs[0].states, runs[1].states)
    with pytest.raises(SceneError, match="`reference` must be in rad/s, but `90 N` is in N"):
        simulate(RIG, 1.0, controller=from_control(pi(), reference="90 N", **SIGNALS))
    with pytest.raises(SceneError, match="`at.top.torque` must be in N m, but `2 kN` is in kN"):
        simulate(RIG, 1.0, controller=from_control(pi(), at={"top.torque": "2 kN"}, **SIGNALS))


def test_what_goes_out_comes_back_the_same_law():
    out = to_control(closed_loop(RIG, DRIVE))
    back = from_control(out, measured_signals=("top.speed", "top.reference"), actuated_signals="top.torque")
    inputs = {"top.reference": 9.95}
    runs = [simulate(RIG, 30.0, controller=law, inputs=inputs, accuracy=1e-9) for law in (DRIVE, back)]
    assert np.allclose(runs[0].at(30.0)["top.torque"], runs[1].at(30.0)["top.torque"], rtol=1e-7)
    again = to_control(closed_loop(RIG, from_control(pi(), reference=9.95, **SIGNALS)))
    w = np.array([0.3, 2.0, 20.0])
    assert np.allclose(control.frequency_response(again[0, 0], w).complex, -control.frequency_response(pi(), w).complex)


@dataclass(frozen=True)
class Leaning(Controller):
    """A law with constants everywhere: z' = y - 9, u = 8000 + 300 z - 1500 (y - r), z(k+1) = z + T (y - 9)."""

    measured_signals: ClassVar[tuple[str, ...]] = ("top.speed",)
    actuated_signals: ClassVar[tuple[str, ...]] = ("top.torque",)

    def continuous(self, signal):
        z, y = state("leaning.sum", "rad"), signal("top.speed", "rad/s")
        return Equations(flow={z: 9.0 - y}, outputs={"top.torque": (self._drive(signal, z), "N m")})

    def sampled(self, signal, period):
        z, y = state("leaning.sum", "rad"), signal("top.speed", "rad/s")
        return Update(memory={z: z + period * (9.0 - y)}, outputs={"top.torque": (self._drive(signal, z), "N m")})

    def _drive(self, signal, z):
        return 8000.0 + 300.0 * z - 1500.0 * (signal("top.speed", "rad/s") - signal("top.reference", "rad/s", default=9.5))


@pytest.mark.parametrize("law", [DRIVE, Leaning()], ids=["PI", "with constants"])
@pytest.mark.parametrize("period", [None, 0.02])
def test_a_law_that_goes_out_comes_back_with_its_working_point_and_set_points(law, period):
    out = to_control(closed_loop(RIG, law, sample_time=period))
    back = from_control(out)
    runs = [simulate(RIG, 30.0, controller=each, sample_time=period, accuracy=1e-9, inputs=inputs) for each in (law, back) for inputs in (
        {}, {"top.reference": step(9.0, 10.0, 15.0)})]  # fmt: skip
    for mine, theirs in ((runs[0], runs[2]), (runs[1], runs[3])):
        assert np.allclose(mine.at(29.0)["top.torque"], theirs.at(29.0)["top.torque"], rtol=1e-7)
    assert abs(runs[0].at(29.0)["top.torque"] - runs[1].at(29.0)["top.torque"]) > 1.0
    again = to_control(closed_loop(RIG, back, sample_time=period))
    assert again.law.at == pytest.approx(out.law.at) and again.law.defaults == out.law.defaults
    with pytest.raises(SceneError, match="`measured_signals` must name signals, because the system was not made by `to_control`"):
        from_control(2.0 * out)


def test_a_discrete_system_runs_at_its_own_period_only():
    law = from_control(pi(0.02), reference=9.95, **SIGNALS)
    mine, theirs = (simulate(RIG, 40.0, controller=Sampled(each, 0.02, delay=0.01), start={"top.speed": 9.0, "bit.speed": 9.0}) for each in (
        from_control(control.ss([[1.0]], [[0.02]], [[500.0]], [[1500.0]], 0.02), reference=9.95, **SIGNALS), law))  # fmt: skip
    assert np.allclose(mine.states[-1], theirs.states[-1], rtol=1e-9)
    # z(k+1) = z + T e, u = I z + P e, in numbers: two samples by hand
    run = simulate(RIG, 0.03, controller=law, sample_time=0.02)
    first = 1500.0 * 9.95
    assert run.at(0.01)["top.torque"] == pytest.approx(first)
    assert run.at(0.025)["top.torque"] == pytest.approx(1500.0 * (9.95 - run.at(0.02)["top.speed"]) + 500.0 * 0.02 * 9.95)
    with pytest.raises(SceneError, match=r"`sample_time` must be 0.02 s, for which the law was designed, but it is 0.01 s"):
        simulate(RIG, 1.0, controller=law, sample_time=0.01)
    with pytest.raises(SceneError, match=r"discrete system is a sampled law: give `sample_time`=0.02"):
        simulate(RIG, 1.0, controller=law)


def test_a_continuous_system_is_sampled_by_tustins_rule():
    lead = control.tf([300.0, 2000.0, 500.0], [0.01, 1.0, 0.2])
    mine = from_control(lead, reference=9.0, **SIGNALS)
    theirs = from_control(control.sample_system(control.ss(lead), 0.01, "tustin"), reference=9.0, **SIGNALS)
    runs = [simulate(RIG, 20.0, controller=law, sample_time=0.01, accuracy=1e-8) for law in (mine, theirs)]
    assert np.allclose(runs[0].states[-1][:3], runs[1].states[-1][:3], rtol=1e-6)


def test_about_a_working_point_the_system_sees_deviations():
    gain = control.ss([], [], [], [[-1500.0]])
    law = from_control(gain, at={"top.speed": 9.0, "top.torque": 9000.0}, **SIGNALS)
    run = simulate(RIG, 5.0, controller=law)
    for t in (1.0, 4.0):
        now = run.at(t)
        assert now["top.torque"] == pytest.approx(9000.0 - 1500.0 * (now["top.speed"] - 9.0))


@pytest.mark.slow
def test_it_is_a_law_like_any_other(tmp_path):
    law = from_control(pi(), reference=9.95, **SIGNALS)
    found = onset(closed_loop(RIG, law), "top.reference", (5.0, 14.0), num_values=4)
    assert found.end is not None
    assert found.end == pytest.approx(onset(closed_loop(RIG, DRIVE), "top.reference", (5.0, 14.0), num_values=4).end, rel=1e-3)
    table = sweep(closed_loop(RIG, law), {"bit.weight": [80e3, 97e3]}, duration=60.0, metrics={"stuck": metrics.stuck_ratio("bit", 30.0)})
    assert table.metrics["stuck"].shape == (2,)
    source, header = export_c(closed_loop(RIG, law, sample_time=0.01), tmp_path / "drive")
    assert "top.reference" in header.read_text() and source.exists()
    assert severity(simulate(RIG, 60.0, controller=law, sample_time=0.01), "bit.speed") >= 0
    assert limit_cycle(closed_loop(RIG, from_control(20_000 + 2000 / control.tf("s"), reference=6.0, **SIGNALS)), 200.0).period > 1.0


@pytest.mark.slow
def test_it_is_mapped_as_the_law_itself():
    law = from_control(pi(), reference=9.95, **SIGNALS)
    over = {"top.reference": ("70 rpm", "130 rpm"), "bit.weight": ("80 kN", "100 kN")}
    mine, theirs = (severity_map(closed_loop(RIG, each), over, shape=(3, 2), halvings=0) for each in (DRIVE, law))
    assert np.array_equal(mine.smooth.verdict, theirs.smooth.verdict) and np.array_equal(mine.sticking.verdict, theirs.sticking.verdict)
    assert np.allclose(mine.growth, theirs.growth, rtol=1e-8)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: from_control(control.tf([1, 0, 0], [1, 1]), **SIGNALS), "must be proper"),
        (lambda: from_control(3.0, **SIGNALS), "must be a control.StateSpace or a control.TransferFunction, but it is 3.0"),
        (lambda: from_control(pi(), measured_signals=("top.speed", "bit.speed"), actuated_signals="top.torque"),
         "`measured_signals` must name 1 signals, .* but it names 2"),
        (lambda: from_control(pi(), measured_signals="top.speed", actuated_signals=()), "`actuated_signals` must name 1 signals"),
        (lambda: from_control(to_control(closed_loop(RIG, DRIVE)), measured_signals=("a", "b"), actuated_signals="c", reference=1.0),
         "one measured signal, but there are 2"),
        (lambda: from_control(pi(), reference=np.nan, **SIGNALS), "`reference` must be a finite number"),
        (lambda: from_control(pi(), at={"bit.speed": 1.0}, **SIGNALS), "`bit.speed` is none"),
        (lambda: from_control(control.ss([], [], [], [[np.nan]]), **SIGNALS), "finite"),
        (lambda: simulate(RIG, 1.0, controller=pi()), r"is a system of python-control: give `from_control\("),
        (lambda: simulate(RIG, 1.0, controller=from_control(pi(), measured_signals="top.sped", actuated_signals="top.torque")), "top.speed"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(make, words):
    with pytest.raises(SceneError, match=words):
        make()
