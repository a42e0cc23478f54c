"""The notebooks: each script gives the answer that it states, and each .ipynb is the print of its script."""

import json
import math
import runpy

import pytest

from studies.notebooks.__main__ import FOLDER, scripts

NAMES = [path.stem for path in scripts()]


def cells_of_script(text):
    """[(kind, source)] of a script in percent format, without jupytext."""
    cells = []
    for line in text.splitlines():
        if line.startswith("# %%"):
            cells.append(("markdown" if "[markdown]" in line else "code", []))
        else:
            cells[-1][1].append(line)
    found = []
    for kind, lines in cells:
        if kind == "markdown":
            lines = [line.removeprefix("#").removeprefix(" ") for line in lines if line.startswith("#")]
        found.append((kind, "\n".join(lines).strip()))
    return found


@pytest.fixture
def answer():
    """Runs a notebook script and returns its `answer`."""

    def run(name):
        path = next(path for path in scripts() if path.stem.startswith(name))
        return runpy.run_path(str(path))["answer"]

    return run


@pytest.mark.parametrize("name", NAMES)
def test_script_and_notebook_agree_and_the_notebook_has_been_run(name):
    notebook = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    cells = [(cell["cell_type"], "".join(cell["source"]).strip()) for cell in notebook["cells"]]
    assert cells == cells_of_script((FOLDER / f"{name}.py").read_text(encoding="utf-8")), (
        "build it again: python -m studies.notebooks " + name
    )
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert not [output for output in outputs if output["output_type"] == "error"]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2
    assert (FOLDER / f"{name}.ipynb").stat().st_size < 300_000


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_asks_one_question_says_the_theory_and_answers(name):
    text = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
    for word in ("# **Question.**", "# **Theory.**", "# **Answer.**"):
        assert text.count(word) == 1


def test_a_smooth_curve_loses_9_percent_of_the_breakaway_torque_and_creeps_where_the_bit_stands(answer):
    found = answer("01")
    assert found["peak at 0.1 rad/s"] == pytest.approx(0.91, abs=0.005)
    assert found["peak at 0.01 rad/s"] == pytest.approx(0.987, abs=0.0005)
    assert found["creep"] == pytest.approx(found["creep by theory"], rel=1e-5)
    assert found["speed of the set-valued bit"] == 0.0
    assert found["turns that the model believes"] > 10
    assert found["steps at 0.001 rad/s over exact"] > 2


def test_a_block_on_a_belt_repeats_its_closed_form(answer):
    found = answer("02")
    assert found["stick"] == pytest.approx(4.0, rel=1e-8)  # 2 z with z = 2
    assert found["slip"] == pytest.approx(2 * (math.pi - math.atan(2.0)), rel=1e-8)
    assert found["largest error"] < 1e-6


def test_friction_in_mechanisms_follows_the_energy_and_the_least_of_the_ways_to_move(answer):
    found = answer("16")
    assert found["rest"] == pytest.approx(4 * math.pi + math.asin(0.45), rel=1e-7)
    assert found["error of the force"] < 1e-8
    assert found["least torque of the clutch"] >= -1e-9 and 0.4 < found["locked"] < 0.6


@pytest.mark.slow
def test_soft_torque_and_sliding_mode_free_the_published_rig_that_sticks_without_them(answer):
    stuck = answer("05")
    assert stuck["constant torque"] == pytest.approx(43.4, abs=0.1)
    assert stuck["stiff PI"] > 30.0
    assert {stuck[label] for label in stuck if label.startswith(("soft", "sliding", "ideal"))} == {0.0}


@pytest.mark.slow
def test_the_working_point_of_the_stiff_drive_is_bistable(answer):
    found = answer("13")
    assert found["Hopf speed"] < 9.948 < found["end of stick-slip"]
    assert found["ratio"] == pytest.approx(2.86, abs=0.03)
    assert found["stuck, undisturbed"] == 0.0 and found["stuck after the jolt"] > 5.0


@pytest.mark.slow
def test_a_dirty_log_gives_the_law_the_shift_of_its_clock_and_a_set_point_that_is_no_lower_than_that_of_the_truth(answer):
    found = answer("15")
    assert found["flaws"] == {
        "top.torque": {"drop-out": 4}, "bit.weight": {"null": 4}, "top.speed": {}, "bit.speed": {"reversed": 4}, "bit.torque": {},
    }  # fmt: skip
    assert (
        found["probabilities"]["constant"] < 1e-6 and 0.1 < found["probabilities"]["Gaussian"] < 0.9
    )  # two that fall cannot be told apart
    for name, value in found["truth"].items():
        assert abs(found["known"][name].mean() - value) < 3 * found["known"][name].std()
    assert found["late"] == pytest.approx(0.4, abs=0.01)
    assert found["cover"]["before"] < 0.5 and found["cover"]["after"] == pytest.approx(0.95, abs=0.03)
    for label in ("exponential", "Gaussian"):
        for drive, truth in found["lowest of the truth"].items():
            assert truth <= found["lowest"][label][drive] < truth + 25.0


def test_the_period_of_two_disks_coming_to_rest_goes_from_1_to_3_and_the_critical_curve_is_that_of_theory(answer):
    found = answer("03")
    assert found["onset"] == pytest.approx(1.0, abs=0.1)
    assert found["termination"] == pytest.approx(3.0, abs=0.15)
    assert found["from 3 rad/s"] > 4.0
    assert found["error of the curve"] < 2e-4  # the bisection stops at 1e-4 of the logarithm


@pytest.mark.slow
def test_slips_of_eight_rotors_keep_their_length_while_sticks_grow(answer):
    found = answer("04")
    assert found["slips, last fifth over first"] == pytest.approx(1.0, abs=0.2)
    assert found["sticks, last fifth over first"] > 1.3
    assert found["sticks, end over first fifth, largest of faces"] > 10.0


@pytest.mark.slow
def test_what_becomes_of_the_collar_belongs_to_a_gain_and_a_way_of_starting(answer):
    found = answer("06")
    assert found["stuck under the stiff drive"] > 1.0  # the problem exists
    rows, ways = found["outcomes"], found["ways"]
    inside = {gain: {word for word, way in zip(row, ways, strict=True) if way.startswith("inside")} for gain, row in rows.items()}
    assert [gain for gain, row in rows.items() if row[ways.index("ramp over 60 s")] == "never strikes"] == [0.05, 0.1, 0.2, 0.4, 0.8]
    assert [gain for gain, row in rows.items() if row[0] == "never strikes"] == [0.1, 0.2]
    assert inside[0.05] == inside[0.1] == inside[0.8] == {"strikes, comes off"} and inside[1.3] == {"stick-slip"}
    assert "rolls on the wall" in inside[0.2] & inside[0.4]
    assert all(severity < 0.02 for severity in found["severity"].values())  # the bit tells no difference
    assert found["speed above which rolling lasts"] < found["set-point"] < found["speed at which whirl reaches the wall"]


@pytest.mark.slow
def test_a_lowered_peak_parks_the_string_and_exact_modes_free_it(answer):
    found = answer("08")
    parked = found.pop("tanh, lowered peak")
    assert parked["stuck"] == 60.0 and parked["fallbacks"] == 0
    bound = found.pop("break-away torque")
    assert parked["largest load"] < bound
    free, matched = found["exact modes"], found["matched peak"]
    assert free["late"] == 0.0 and free["largest load"] > bound and not free["fallbacks"]
    assert free["speed"] == pytest.approx(4.0, abs=0.02)
    assert matched["largest load"] > bound and free["stuck"] < matched["stuck"] < parked["stuck"]


def test_friction_along_an_inclined_string_makes_it_stick_off_bottom_and_a_drive_near_the_pipe_impedance_frees_it(answer):
    found = answer("10")
    assert found["stuck"]["published PI"] > 1.0
    assert found["stuck"]["PI of 4 pipe impedances"] == 0.0
    # beyond the closed form: the viscous drag of a string that is wound up at 28 N m/s
    assert found["break-off torque simulated"] == pytest.approx(found["break-off torque"], rel=2e-3)


@pytest.mark.slow
def test_a_row_of_bristles_slips_by_regions_and_converges_to_the_rounded_contact(answer):
    found = answer("11")
    assert found["partial"] > 0.3
    assert found["error of 1"] == pytest.approx(0.19, abs=0.01)
    assert found["error of 16"] < 0.01 and 1.5 < found["order"] < 2.1
    assert found["last row over rigid"] == pytest.approx(1.0, abs=1e-3)
    assert found["first row over rigid"] < 0.3
    assert found["share at 0.16 s"] == pytest.approx(0.57, abs=0.05)
    assert found["share at 0.20 s"] == pytest.approx(0.26, abs=0.05)
    assert 0.01 < found["nodes before rigid"] < 0.016


@pytest.mark.slow
def test_a_drive_that_gives_way_or_knows_the_string_ends_stick_slip_far_below_one_that_holds_the_speed(answer):
    found = answer("07")
    lowest, swing = found["lowest"], found["swing of the bit on the light drive"]
    assert lowest["LQG, tuned"]["nominal, takeover"] <= 4.0 < 8.0 < lowest["stiff PI"]["nominal, takeover"]
    assert lowest["LQG, tuned"]["one_at_a_time, ramp"] <= 4.0 < lowest["soft torque"]["one_at_a_time, ramp"]
    assert lowest["LQG, tuned"]["one_at_a_time, takeover"] <= 8.0
    assert not lowest["LQG"]["one_at_a_time, takeover"] <= 8.0  # or none at all
    assert swing["LQG"] > 0.2 > 0.05 > swing["LQG, tuned"]


@pytest.mark.slow
def test_dither_of_the_load_helps_in_a_band_amplifies_below_it_and_fades_above(answer):
    found = answer("09")
    low, high = found["band"]
    assert 1.5 < low < 3.0 and 4.0 < high < 6.0
    swing = found["swing"]
    assert swing["none"] == 1.0 and swing["in the band"] < 0.5 < swing["far above"] < 0.9
    assert swing["below the natural frequency"] > 1.5 and found["largest"] > 1.5
    assert found["least up to depth 0.4"] > 0.5
    # along the slip the mean friction rises with speed, which that of a dithered load cannot
    assert found["mean friction at 0.1 m/s under B = 0.5 m/s"] < 0.5 * found["mean friction at 0.3 m/s under B = 0.5 m/s"]


@pytest.mark.slow
def test_located_events_reach_an_accuracy_that_the_level_of_detail_makes_useless(answer):
    found = answer("12")
    least, detail, accuracy = found["least error"], found["by detail"], found["by accuracy 1e-2"]
    assert found["disagreement"] < 1e-11 and max(least[method] for method in ("explicit", "stiff", "taylor")) < 1e-11
    assert least["time-stepping"] > 1e-5 and least["smoothed"] > 1e-3
    assert detail[2] == pytest.approx(0.18, abs=0.01) and 0.02 < detail[10] < 0.1 and 0.02 < detail[20] < 0.1
    assert all(accuracy[elements] < detail[elements] for elements in detail)
    assert found["events"][50] > 50 * found["events"][2]
    assert found["why"] == "Taylor series of order 16: 4 states at an accuracy of 1e-06"


@pytest.mark.slow
def test_tuned_gains_free_a_well_from_tables_on_a_finer_model_and_another_weight_than_they_were_tuned_on(answer):
    found = answer("14")
    assert found["given"] > 1.0 and found["tuned"] < 0.2
    assert found["stuck"]["as published"] > 5.0 and found["stuck"]["tuned"] == 0.0
    assert found["severity"]["as published"] > 1.0 and found["severity"]["tuned"] < 0.3
    assert 1.0 < found["proportional"] / found["impedance"] < 8.0
    assert found["sticks"] == ["chain.inertia.0 -20 %, bit.weight +20 %, delay +100 %"] and found["runs"] == 32
    assert found["failed"] >= 28 and found["swing"] == pytest.approx(0.44, abs=0.03)  # a swing of the second mode goes on
    assert "#define DRIVE_READS 3" in found["header"] and "y[0]  top.speed [rad/s]" in found["header"]
