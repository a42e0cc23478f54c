"""Gains over depth: what the table says is what runs, one law serves the well where the gains of no single depth do, and the C gives the same gains."""

from __future__ import annotations

import csv
import ctypes
import shutil
import subprocess
import sys

import numpy as np
import pytest

from controllers import LQG, PI, SoftTorque, StiffPI
from models import BitRock, DrillString, Section, ToolJoint, inner_diameter, shaft_frequencies
from toolbox import Sampled, SceneError, closed_loop, compose, margins, simulate
from toolbox.drilling import schedule
from toolbox.export.scheduled_c import export_schedule
from toolbox.robustness import TakenOver

TOP, SPEED = 2000.0, "120 rpm"
JOINT = ToolJoint("6.625 in", "3.25 in", "21 in", every="31.7 ft")


def sections(depth):
    pipe = Section(depth - 200.0, "5 in", inner_diameter("5 in", "19.5 ppf"), mass_per_length="23.5 ppf", tool_joint=JOINT)
    return [pipe, Section(200.0, "6.75 in", "2.8125 in")]


def well(depth):
    string = DrillString.from_tables(sections(depth), top_inertia=TOP, drag_rate=0.1, internal_damping="5 ms", elements=8)
    return compose(string, BitRock(weight="80 kN"))


def law(depth):
    """The drive for a distributed string: four impedances of its pipe, and the lowest frequency of a string whose top is held."""
    lowest = shaft_frequencies(sections(depth), 1, top_inertia=50.0 * TOP)[0]
    return Sampled(SoftTorque.for_string(sections(depth)[0].impedance, TOP, lowest, reference=SPEED), "10 ms", delay="30 ms")


@pytest.fixture(scope="module")
def found():
    return schedule(well, ["1 km", "2 km", "3 km", 5000.0], law, "20 s", mean_within=10.0, ripple_within=10.0)


def test_the_table_holds_the_designs_and_is_linear_between(found):
    assert found.names == ("pi.integral",) and found.depths == (1000.0, 2000.0, 3000.0, 5000.0)
    designed = [law(depth).law.integral for depth in found.depths]
    np.testing.assert_allclose(found.gains[:, 0], designed, rtol=1e-14)
    assert found.gains_at("1.5 km")["pi.integral"] == pytest.approx(0.5 * designed[0] + 0.5 * designed[1])
    assert found.gains_at(100.0)["pi.integral"] == designed[0] and found.gains_at(9000.0)["pi.integral"] == designed[3]
    assert found.law_at(2500.0).law.integral == found.gains_at(2500.0)["pi.integral"] and found.law_at(2500.0).delay == 0.03


@pytest.mark.slow
def test_one_law_over_depth_ends_stick_slip_where_that_of_no_single_depth_does():
    found = schedule(well, ["1 km", "2 km", "3 km", 5000.0], law, "120 s", starts=TakenOver(StiffPI(reference=SPEED), 4))
    assert found.holds and [each.depth for each in found.checked] == [1000.0, 1500.0, 2000.0, 2500.0, 3000.0, 4000.0, 5000.0]
    assert [each.designed for each in found.checked] == [True, False, True, False, True, False, True] and all(
        each.runs == 4 for each in found.checked
    )
    for depth in (1000.0, 2000.0):  # a run of its own: the drive before has left the string in stick-slip, which the law ends
        stuck = simulate(well(depth), 60.0, controller=StiffPI(reference=SPEED))
        assert stuck.time_in("bit", "stick", after=40.0) > 1.0
        state = {name: stuck.at(60.0)[name] for name in ("chain.twist", "chain.speed")}
        run = simulate(closed_loop(well(depth), found.law_at(depth), start=state), 120.0)
        assert run.time_in("bit", "stick", after=84.0) == 0.0
    for depth, bad in ((1000.0, [2000.0]), (5000.0, [1500.0])):
        other = closed_loop(well(bad[0]), law(depth))
        stuck = simulate(well(bad[0]), 60.0, controller=StiffPI(reference=SPEED))
        state = {name: stuck.at(60.0)[name] for name in ("chain.twist", "chain.speed")}
        held = simulate(other.replace(start=state), 120.0).time_in("bit", "stick", after=84.0)
        assert held > 1.0, depth
    for each in found.checked:
        assert each.disk_margin == pytest.approx(
            margins(closed_loop(well(each.depth), found.law_at(each.depth)), by_simulation=False).disk_margin
        )


@pytest.mark.slow
def test_a_table_that_is_too_coarse_is_found_out_between_its_rows():
    """The integral gain falls with the square of the length, so that halfway between 1000 and 3000 m a straight line is nearly twice too high."""
    found = schedule(well, (1000.0, 3000.0), law, "120 s", starts=TakenOver(StiffPI(reference=SPEED), 4))
    assert [each.failed > 0 for each in found.checked] == [False, True, False] and not found.holds
    assert "runs fail at 2000 m" in str(found)


def test_the_drive_gets_a_table_and_the_report_a_picture(found, tmp_path):
    rows = list(csv.reader(found.to_csv(tmp_path / "drive.csv").read_text().splitlines()))
    assert rows[0] == ["depth [m]", "pi.integral [N m/rad]"] and [float(row[0]) for row in rows[1:]] == [1000.0, 2000.0, 3000.0, 5000.0]
    text = str(found)
    assert "every run succeeds at every depth" in text and "depth [km]" in text and "between" in text
    axes = found.plot()
    assert len(axes) == 2 and axes[0].lines[0].get_ydata().tolist() == found.gains[:, 0].tolist()
    assert axes[-1].get_xlabel() == "depth [km]" and axes[0].lines[0].get_xdata().tolist() == [
        1.0,
        2.0,
        3.0,
        5.0,
    ]  # as the depths were typed
    assert "started from smooth running" in text


@pytest.mark.skipif(shutil.which("cc") is None or sys.platform != "linux", reason="the C is compiled with `cc`, which is not here")
def test_the_c_of_a_schedule_gives_its_gains_and_steps_its_law(found, tmp_path):
    files = export_schedule(found, well(1000.0), tmp_path / "drive")
    library = tmp_path / "drive.so"
    warnings = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    subprocess.run(["cc", *warnings, "-shared", "-fPIC", str(files[0]), str(files[2]), "-lm", "-o", str(library)], check=True)
    functions = ctypes.CDLL(str(library))
    functions.drive_gains_at.argtypes = [ctypes.c_double, ctypes.POINTER(ctypes.c_double)]
    names = [line.split("law.")[1].split()[0] for line in files[1].read_text().splitlines() if "law." in line and "gains[" in line]
    assert "integral" in names
    gains = (ctypes.c_double * len(names))()
    for depth in (0.0, 1000.0, 1700.0, 3000.0, 4999.0, 8000.0):
        functions.drive_gains_at(depth, gains)
        now = found.law_at(depth).law
        assert list(gains) == pytest.approx([getattr(now, name) for name in names], rel=1e-14)


def test_mistakes_are_told():
    for depths, word in (((1000.0,), "two rising"), ((2000.0, 1000.0), "two rising"), (("1 kg", "2 kg"), "must be in m")):
        with pytest.raises(SceneError, match=word):
            schedule(well, depths, law, 10.0)
    with pytest.raises(SceneError, match="Argument `controller` must be a Controller"):
        schedule(well, (1000.0, 2000.0), 3.0, 10.0)
    with pytest.raises(SceneError, match="Argument `well` must give a plant, or a loop without laws"):
        schedule(lambda depth: closed_loop(well(depth), PI()), (1000.0, 2000.0), law, 10.0)

    def growing(depth):
        return compose(DrillString.from_tables(sections(depth), top_inertia=TOP, elements=int(depth / 500.0)), BitRock())

    with pytest.raises(SceneError, match="as many numbers at every depth"):
        schedule(growing, (1000.0, 2000.0), LQG(reference=12.0), 10.0)
