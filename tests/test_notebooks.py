"""The notebooks: each script gives the answer that it states, and each .ipynb is the print of its script."""

import json
import math
import runpy

import matplotlib.pyplot as plt
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

    yield run
    plt.close("all")
    plt.ioff()


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


def test_soft_torque_and_sliding_mode_free_the_published_rig_that_sticks_without_them(answer):
    stuck = answer("05")
    assert stuck["constant torque"] == pytest.approx(43.4, abs=0.1)
    assert stuck["stiff PI"] > 30.0
    assert {stuck[label] for label in stuck if label.startswith(("soft", "sliding", "ideal"))} == {0.0}


def test_the_working_point_of_the_stiff_drive_is_bistable(answer):
    found = answer("13")
    assert found["Hopf speed"] < 9.948 < found["end of stick-slip"]
    assert found["ratio"] == pytest.approx(2.86, abs=0.03)
    assert found["stuck, undisturbed"] == 0.0 and found["stuck after the jolt"] > 5.0


def test_both_fits_find_the_law_behind_the_data_within_their_intervals(answer):
    found = answer("15")
    for name, value in found["truth"].items():
        for way in ("loop", "simulated"):
            low, high = found[way].interval(name)
            assert low <= value <= high
    assert (found["simulated"].errors < 0.1 * found["loop"].errors).all()
    assert "`bit.weight` and `bit.radius` cannot be" in found["refusal"]
