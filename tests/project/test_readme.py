"""The README runs when pasted, prints what it says it prints, and its numbers in prose are true."""

import contextlib
import io
import itertools
import math
import re
from dataclasses import dataclass

import casadi as ca
import pytest

from controllers import SoftTorque
from models import BitRock, wells
from studies.questions import pictures
from toolbox import Component, Equations, compose, measure, quantity, simulate
from toolbox.onsets import verdicts
from toolbox.scenes.scene import Scene
from toolbox.scenes.verdict_table import table

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)")
TIMES = re.compile(r"[\d.]+ (ms|s$)|-{9,}", re.MULTILINE)  # differ, as errors and step counts do; a long time widens its column
ERRORS = re.compile(r"\d(\.\d)?e-\d\d")
STEPS = re.compile(r"\d+ steps, \d+ rejected")


@pytest.fixture
def readme(root):
    return (root / "README.md").read_text()


def examples(readme):
    """(code, printed) of every Python block; None where no output is shown below it."""
    return re.findall(r"```python\n(.*?)```(?:\n\n```text\n(.*?)```)?", readme, re.DOTALL)


def same(shown, printed):
    """Equal words, and numbers equal to what is shown, but for what depends on the machine."""
    for pattern in (TIMES, STEPS):
        shown, printed = pattern.sub("", shown), pattern.sub("", printed)
    assert all(float(error[0]) <= 1e-6 for error in re.finditer(ERRORS, printed) if not error[0].startswith("1e-06"))
    shown, printed = ERRORS.sub("", shown), ERRORS.sub("", printed)
    assert NUMBER.sub("#", shown).split() == NUMBER.sub("#", printed).split()
    ours, theirs = ([float(word) for word in NUMBER.findall(text)] for text in (shown, printed))
    assert ours == pytest.approx(theirs, rel=2e-3, abs=2e-3)


@pytest.mark.parametrize("page", ["README.md", "docs/add_a_model.md", "docs/add_a_controller.md"])
def test_python_blocks_with_an_output_run_when_pasted_and_print_what_is_shown(page, root, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = [(code, shown) for code, shown in examples((root / page).read_text()) if shown]
    assert len(blocks) == 1
    for code, shown in blocks:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, page, "exec"), {"__name__": "__main__"})
        same(shown, printed.getvalue())
    assert (tmp_path / "soft.png").exists() == (page == "README.md")


def test_the_readme_is_short_and_its_links_lead_somewhere(readme, root):
    assert len(readme.splitlines()) <= 150 and len(readme.split()) <= 1500
    links = re.findall(r"\]\(([^)#]+?)\)", readme)
    assert len(links) > 10 and [link for link in links if not link.startswith("https://") and not (root / link).exists()] == []
    assert readme.count("```python") == 1 == len(examples(readme))


def test_the_table_of_the_readme_is_that_of_the_study(readme, root):
    shown = re.search(r"```text\n(Four-inertia rig.*?)\n\nFigures, ", readme, re.DOTALL)[1]
    scene = Scene.load(root / "studies" / "scenes" / "navarro_lopez_4.toml")
    labels = [line.partition("  ")[0] for line in shown.splitlines()[6:]]
    same(shown, table(scene, [verdicts.verdict_row(scene, label)[0] for label in labels]))


@dataclass(frozen=True)
class TanhRock(Component):
    """The law of `BitRock` with tanh(w / width) in place of the sign."""

    load: float = quantity(97_347.0 * 0.155575, "N m", "weight times radius")
    width: float = quantity(0.01, "rad/s", "width of the transition")

    def equations(self, signal):
        w = signal("bit.speed", "rad/s")
        friction = 0.5 + 0.3 * ca.exp(-0.9 * ca.fabs(w))
        return Equations(outputs={"bit.torque": (self.load * friction * ca.tanh(w / self.width), "N m")})


def test_a_regularised_bit_creeps_and_is_stiff_where_the_exact_one_stands(root):
    page = (root / "docs" / "friction.md").read_text()
    degrees = math.degrees(60 * 0.01 * math.atanh(0.9))
    assert f"by {degrees:.0f} degrees a minute" in " ".join(page.split())
    push = {"inputs": {"top.torque": 6000.0}}
    exact = simulate(compose(wells.NAVARRO_LOPEZ_4, BitRock(weight=97_347.0)), 200.0, **push, method="explicit")
    smooth = simulate(compose(wells.NAVARRO_LOPEZ_4, TanhRock()), 200.0, **push, method="explicit")
    assert measure.extent(exact, "bit.speed").maximum == 0.0
    creep = smooth.at(200.0)["bit.speed"]
    assert creep == pytest.approx(0.01 * math.atanh(6000.0 / (97_347.0 * 0.155575 * 0.8)), rel=0.02)  # less what drags take
    assert f"at the end of the run is {creep:.4f} rad/s instead of 0" in " ".join(page.split())
    few, many = (
        int(word.replace(" ", ""))
        for word in re.search(r"tries some (\d+) steps .*? and ([\d ]+) steps with tanh", " ".join(page.split())).groups()
    )
    assert sum(exact.steps) == pytest.approx(few, rel=0.15)
    assert sum(smooth.steps) == pytest.approx(many, rel=0.15)


def test_the_figure_shows_stick_slip_in_every_cycle_and_none_after_the_string_is_wound_up_once(readme, root):
    constant, soft = pictures.runs().values()
    releases = [event.time for event in constant.events if event.after == "slip+"]
    sticks = measure.stick_intervals(constant, "bit")
    assert len(releases) > 10
    assert all(any(begin > last and end <= now for begin, end in sticks) for last, now in itertools.pairwise(releases))
    assert [event.after for event in soft.events] == ["slip+"]
    assert soft.at(pictures.DURATION)["top.torque"] == pytest.approx(10_000.0, rel=0.02)
    path = re.search(r"!\[.*?\]\((.*?)\)", readme)[1]
    assert (root / path) == pictures.PATH
    assert pictures.PATH.stat().st_size > 10_000


def test_every_part_and_law_is_in_the_tables_of_the_documentation(root):
    import controllers
    import models

    names = [*controllers.__all__, *(name for name in models.__all__ if name != "wells"), *(f"wells.{name}" for name in wells.__all__)]
    assert [name for name in names if f"`{name}`" not in (root / "docs" / "parts.md").read_text()] == []


def test_a_new_input_or_gain_never_recompiles():
    rig = compose(wells.NAVARRO_LOPEZ_4, BitRock(weight=97_347.0))
    assert len({id(simulate(rig, 1.0, inputs={"top.torque": torque}).program.kernel) for torque in (10_000.0, 10_500.0)}) == 1
    assert len({id(simulate(rig, 1.0, controller=SoftTorque(reference=speed)).program.kernel) for speed in (4.7, 5.0)}) == 1
