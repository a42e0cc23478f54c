"""The pytest plugin: what a failed check says and draws, what the marker repeats, and that it costs nothing where nobody asks for it."""

from __future__ import annotations

import math
import re
import subprocess
import sys
import tomllib

import numpy as np
import pytest

from controllers import PI, IdealSlidingMode, SoftTorque, StiffPI
from models import BitRock, wells
from tests import public  # noqa: F401 (loads all modules: `pytester` forgets those that are first loaded inside of it)
from toolbox import Sampled, SceneError, closed_loop, compose, inputs, measure, simulate
from toolbox.robustness.checks import Checks, Perturbation

pytest_plugins = "pytester"

LIGHT = """
import sys

def test_nothing_heavy_is_loaded(request):
    assert request.config.pluginmanager.has_plugin("stickslip_pytest")
    heavy = [name for name in ("casadi", "llvmlite", "numpy", "scipy", "matplotlib", "toolbox") if name in sys.modules]
    assert heavy == []
"""


@pytest.fixture(scope="module")
def rig():
    return compose(wells.JANSEN_2, BitRock())


@pytest.fixture(scope="module")
def stiff(rig):
    return simulate(rig, 120.0, controller=StiffPI(reference=9.95))


@pytest.fixture(scope="module")
def soft(rig):
    return simulate(rig, 200.0, controller=SoftTorque(reference=9.95))


@pytest.fixture
def checks(tmp_path):
    return Checks(folder=tmp_path / "figures", name="some test")


def failure(check, *arguments, **named):
    with pytest.raises(AssertionError) as failed:
        check(*arguments, **named)
    return str(failed.value)


def figure(text):
    """The bytes of the figure that a message names."""
    from pathlib import Path

    return Path(re.search(r"Figure: (.+\.png)", text)[1]).read_bytes()


# --- what a check says


def test_a_bit_that_sticks_is_reported_with_times_and_a_figure(checks, stiff):
    text = failure(checks.no_stick_slip, stiff, after=60.0)
    sticks = measure.stick_intervals(stiff, "bit", 60.0)
    assert f"sticks {len(sticks)} time(s)" in text and f"{sticks[0][0]:.4g} s" in text
    assert figure(text).startswith(b"\x89PNG")


def test_a_bit_that_will_stick_is_reported_though_the_run_shows_no_stick(checks):
    rig = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
    slowed = {end: inputs.ramp(10.0, end, 0.0, 600.0) for end in (3.985, 4.0)}
    grows, calm = (simulate(closed_loop(rig, PI(4_000.0, 1_500.0), inputs={"top.reference": each}), 680.0) for each in slowed.values())
    assert "but a small disturbance of smooth running grows in" in failure(checks.no_stick_slip, grows, after=600.0)
    checks.no_stick_slip(calm, after=600.0)
    falls = simulate(rig, 6.0, controller=StiffPI(reference=6.5), start={"chain.twist": [16.4], "chain.speed": [4.55, 1.95]})
    assert "but stick-slip later: no stick in the time that was looked at" in failure(checks.no_stick_slip, falls, after=0.1)


def test_a_free_bit_passes(checks, soft):
    checks.no_stick_slip(soft, after=100.0)
    assert checks.severity_below(soft, 0.01, after=180.0) == measure.severity(soft, after=180.0)
    assert checks.settles(soft, "bit.speed", 9.95, within=100.0) < 100.0
    checks.energy_balances(soft)
    assert not checks.folder.exists()


def test_a_severity_is_reported_with_the_range_behind_it(checks, stiff):
    text = failure(checks.severity_below, stiff, 0.5, after=60.0)
    found = measure.extent(stiff, "bit.speed", 60.0)
    assert f"{measure.severity(stiff, after=60.0):.4g}" in text and f"{found.maximum:.5g}" in text and "mean" in text


def test_a_bound_counts_between_the_steps(checks, soft):
    peak = measure.extent(soft, "top.torque")
    checks.bounded(soft, "top.torque", high=peak.maximum)
    text = failure(checks.bounded, soft, "top.torque", high=peak.maximum - 1.0)
    assert f"{peak.maximum:.6g} N m at {peak.time_of_maximum:.4g} s" in text
    low = failure(checks.respects_limits, soft, {"top.speed": (1.0, 20.0)})
    assert "`top.speed` must be >= 1 rad/s" in low
    assert "respects_limits.png" in low and "bounded.png" in text
    checks.respects_limits(soft, {"top.torque": peak.maximum + 1.0})


def test_the_figure_of_a_limit_that_is_broken_shows_the_limit(checks, soft, monkeypatch):
    drawn = []
    monkeypatch.setattr("matplotlib.pyplot.close", drawn.append)
    failure(checks.respects_limits, soft, {"top.torque": (0.0, 30_000.0), "top.speed": (1.0, 20.0)})
    ax = drawn[0].axes[0]
    limits = [line.get_ydata()[0] for line in ax.get_lines() if line.get_linestyle() == ":"]
    assert limits == [1.0, 20.0] and ax.get_ylim()[0] < 0.0 and ax.get_ylim()[1] > 20.0


def test_what_never_settles_says_where_it_ends(checks, stiff):
    assert "but it never does, and ends at" in failure(checks.settles, stiff, "bit.speed", 9.95, within=60.0)


def test_an_energy_that_does_not_balance_shows_the_audit(checks, soft):
    assert "residual" in failure(checks.energy_balances, soft, within=0.0)


def test_a_law_beats_another_by_severity_and_stick(checks, stiff, soft):
    assert checks.beats(soft, stiff, after=100.0) < 0.1
    text = failure(checks.beats, stiff, soft, after=100.0)
    assert "must beat the other" in text and figure(text).startswith(b"\x89PNG")


@pytest.mark.slow
def test_an_onset_above_the_limit_shows_both_borders(checks, rig):
    given = {"bounds": (3.0, 15.0), "num_values": 5, "tolerance": 0.2}
    # the smooth border of the stiff drive is far below this limit: stick-slip that exists is not
    text = failure(checks.onset_below, closed_loop(rig, StiffPI()), "top.reference", 9.0, **given)
    assert "existing stick-slip ends at 12." in text and "smooth running is lost at" not in text.partition(".\n")[0]
    assert figure(text).startswith(b"\x89PNG")
    assert checks.onset_below(closed_loop(rig, SoftTorque()), "top.reference", 9.0, **given).end < 9.0


def test_a_figure_that_cannot_be_drawn_hides_nothing(stiff, tmp_path):
    (tmp_path / "file").write_text("")
    text = failure(Checks(folder=tmp_path / "file").no_stick_slip, stiff, after=60.0)
    assert "must not stick" in text and "There is no figure" in text


def test_a_mistake_in_a_check_is_no_failure_of_the_law(checks, soft, rig):
    with pytest.raises(SceneError, match="bit"):
        checks.no_stick_slip(soft, after=10.0, element="bitt")
    with pytest.raises(SceneError, match="limit"):
        checks.onset_below(rig, "top.reference", 99.0, bounds=(1.0, 9.0))
    with pytest.raises(SceneError, match="limits"):
        checks.respects_limits(soft, {})


def test_a_perturbation_scales_declared_numbers(rig):
    given = Perturbation({"bit.weight": 0.2, "chain.inertia": -0.5})(rig)
    assert given["bit.weight"] == pytest.approx(1.2 * 97_347.0)
    np.testing.assert_allclose(given["chain.inertia"], [1061.0, 187.0])
    with pytest.raises(SceneError, match="bit.weight"):
        Perturbation({"bit.wait": 0.1})(rig)


# --- in a run of pytest


OWN = """
import pytest
from models import BlockOnBelt
from toolbox import compose, simulate

BELT = compose(BlockOnBelt())

def test_a_block_that_sticks(stickslip_checks):
    stickslip_checks.no_stick_slip(simulate(BELT, 30.0), after=1.0)

@pytest.mark.stickslip_perturbed({"block.mass": 0.2, "block.stiffness": 0.1})
def test_masses(perturbed):
    given = perturbed(BELT)
    assert all(abs(value - 1.0) < 0.25 for value in given.values())
"""


def test_a_failure_shows_numbers_and_saves_its_figure_where_asked(pytester):
    pytester.makepyfile(OWN)
    result = pytester.runpytest_inprocess("-p", "stickslip_pytest", "--strict-markers", "--stickslip-figures", "seen")
    result.assert_outcomes(passed=5, failed=1)
    result.stdout.fnmatch_lines(
        ["*`belt` must not stick after 1 s, but it sticks * time(s) for * s in all*", "*Figure: seen/*no_stick_slip.png"]
    )
    assert [path.name for path in (pytester.path / "seen").iterdir()] == ["test_a_block_that_sticks_no_stick_slip.png"]
    assert "checks.py" not in result.stdout.str()  # the traceback ends in the user's line


def test_the_marker_repeats_a_test_for_each_perturbation_by_name(pytester):
    pytester.makepyfile(OWN)
    result = pytester.runpytest_inprocess("-p", "stickslip_pytest", "--collect-only", "-q", "-k", "masses")
    for word in ("nominal", "block.mass +20 %", "block.mass -20 %", "block.stiffness +10 %", "block.stiffness -10 %"):
        assert f"test_masses[{word}]" in result.stdout.str()


def test_the_former_name_of_the_fixture_is_refused_with_the_new_one(pytester):
    pytester.makepyfile("import stickslip\ndef test_it(stickslip): pass\n")
    result = pytester.runpytest_inprocess("-p", "stickslip_pytest")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["The fixture `stickslip` is now `stickslip_checks`."])
    assert "Traceback" not in result.stdout.str()


@pytest.mark.parametrize("marker", ["", "@pytest.mark.stickslip_perturbed()", '@pytest.mark.stickslip_perturbed({"block.mass": -0.1})'])
def test_a_marker_without_its_numbers_is_an_error_that_shows_how(pytester, marker):
    pytester.makepyfile(f"import pytest\n{marker}\ndef test_it(perturbed): pass\n")
    result = pytester.runpytest_inprocess("-p", "stickslip_pytest")
    result.stdout.fnmatch_lines(["*needs the marker `stickslip_perturbed({*bit.weight*: 0.2})`*"])


def test_a_start_of_pytest_with_the_plugin_imports_nothing_heavy(pytester, monkeypatch):
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # those of other packages may be heavy: zarr brings numpy
    pytester.makepyfile(LIGHT)
    result = pytester.run(sys.executable, "-m", "pytest", "-q", "-p", "stickslip_pytest")
    assert result.ret == 0, result.stdout.str()


def test_the_plugin_is_registered_and_packed(root):
    project = tomllib.loads((root / "pyproject.toml").read_text())
    assert project["project"]["entry-points"]["pytest11"] == {"stickslip_pytest": "stickslip_pytest"}
    assert "stickslip_pytest.py" in project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    code = "import sys, stickslip_pytest; print('casadi' in sys.modules or 'toolbox' in sys.modules)"
    assert (
        subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True, timeout=60).stdout.strip()
        == "False"
    )


def test_the_severity_of_a_machine_at_rest_is_no_number_and_fails(checks, rig):
    run = simulate(rig, 10.0)
    assert math.isnan(measure.severity(run))
    assert "must be below" in failure(checks.severity_below, run, 0.5, after=1.0)


# --- margins and the worst case


def test_a_loop_with_too_little_margin_shows_its_table_and_its_nyquist_curve(checks, rig):
    loop = closed_loop(rig, Sampled(SoftTorque(reference=5.0), 0.01, 0.03))
    assert checks.robust(loop, disk_margin=0.25, peak_sensitivity=4.0, gain=(0.5, 2.0), delay=0.1).stable
    text = failure(checks.robust, loop, disk_margin=0.35, delay=1.0)
    assert "The disk margin must be >= 0.35, but it is 0.293" in text and "1 s more of delay, but it bears 0.319 s" in text
    assert "SoftTorque, sampled every 10 ms" in text and figure(text).startswith(b"\x89PNG")
    with pytest.raises(SceneError, match="disk_margin"):
        checks.robust(loop)


def test_a_law_that_switches_is_judged_by_what_is_measured(checks, rig):
    loop = closed_loop(rig, IdealSlidingMode(reference=6.0))
    checks.robust(loop, gain=(0.8, 1.2), simulation_duration=30.0)
    text = failure(checks.robust, loop, disk_margin=0.1, simulation_duration=30.0)
    assert "There is no linear loop" in text and "but it is nan" in text


ROBUST = """
from controllers import LQG, StiffPI
from models import BitRock, wells
from toolbox import Sampled, closed_loop, compose, simulate
from toolbox.robustness import cycle_phases

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
STUCK = simulate(RIG, 100.0, controller=StiffPI(reference=6.5), sample_time=0.01)
LAW = Sampled(LQG(reference=6.5, delay_samples=3), 0.01, delay=0.03)

def test_margin(stickslip_checks):
    stickslip_checks.robust(closed_loop(RIG, LAW), disk_margin=0.35)

def test_declared(stickslip_checks):
    stickslip_checks.survives(closed_loop(RIG, LAW), 100.0, starts=cycle_phases(STUCK, 2))

def test_lighter(stickslip_checks):
    stickslip_checks.survives(closed_loop(RIG, LAW), 100.0, uncertainty={"chain.inertia.0": 0.8}, starts=cycle_phases(STUCK, 2))
"""


def test_one_line_of_the_fixture_asserts_margin_and_worst_case(pytester):
    pytester.makepyfile(ROBUST)
    result = pytester.runpytest_inprocess("-p", "stickslip_pytest", "--stickslip-figures", "seen")
    result.assert_outcomes(passed=1, failed=2)
    result.stdout.fnmatch_lines(
        ["*The disk margin must be >= 0.35, but it is *", "*2 of 4 runs fail, the worst with chain.inertia.0 -20 %*"]
    )
    assert sorted(path.name for path in (pytester.path / "seen").iterdir()) == ["test_lighter_survives.png", "test_margin_robust.png"]
    assert "checks.py" not in result.stdout.str()
