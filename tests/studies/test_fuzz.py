"""Random plants: right answers at ordinary numbers, and at the edges of them right answers or errors of the toolbox that say why."""

import json

import numpy as np
import pytest

from studies.benchmarks import differential, fuzz_sections
from studies.benchmarks.fuzz import DEFECTS, examine
from toolbox import compose, simulate


@pytest.mark.parametrize("number", range(4))
def test_no_draw_of_a_random_plant_ends_in_a_crash_a_nan_or_a_silent_wrong_answer(number, tmp_path):
    """A network of masses, another, a drill string with a drive, and a shipped scene; `python -m studies fuzz` takes hundreds."""
    log = tmp_path / "log.jsonl"
    examine(7, number, 20, log)
    ends = [line for line in map(json.loads, log.read_text().splitlines()) if "end" in line]
    assert not [line for line in ends if line["end"] in DEFECTS]
    assert sum(line["end"] == "done" for line in ends) >= 5  # most numbers make sense


@pytest.mark.parametrize("number", range(len(differential.KINDS)))
def test_a_random_machine_of_every_kind_moves_as_explicit_modes_and_scipy_say(number):
    """One draw each, by every method that its number takes; `python -m studies fuzz --reference` takes thousands."""
    found = []
    differential.examine(1, number, 1, lambda **words: found.append(words))
    assert {words["end"] for words in found} == {"right"}


@pytest.mark.filterwarnings("ignore::toolbox.errors.UnusualValue")  # no machine, but numbers that the engine must survive
@pytest.mark.parametrize("section", ["rests", "cuts"])
@pytest.mark.parametrize("number", range(6))
def test_random_bodies_come_to_rest_and_random_runs_go_on_where_they_are_cut(section, number):
    """All methods, ordinary units and others; `python -m studies fuzz --section rests` takes hundreds."""
    assert {kind for kind, _ in fuzz_sections.judged(section, 5, number)} == {"right"}


def test_what_the_reference_moves_by_at_rest_is_no_error_of_a_run_that_rests():
    one, times = differential.trial(1, 1379, 0), np.linspace(0.0, 1.0, 101)
    right = differential.Reference(one, 1e-12).run(times)
    assert 0.0 < np.abs(right).max() < 1e-12  # its steps end in forces that balance to round-off only
    run = simulate(differential.loop_of(compose(one.machine), one), 1.0, output_times=times)
    assert not run.states.any()
    assert differential._apart(run.states, right) == 0.0
    assert differential._apart(run.states + 1e-11, right) > 1e-6


@pytest.mark.parametrize(("number", "draw"), [(2720, 1), (2951, 2)])
def test_a_rest_that_a_weak_load_ends_for_a_moment_is_not_stepped_over_by_the_reference(number, draw):
    one = differential.trial(1, number, draw)
    times = np.linspace(0.0, one.duration, 101)
    reference = differential.Reference(one, 1e-12)
    right = reference.run(times)
    run = simulate(differential.loop_of(compose(one.machine), one), one.duration, output_times=times, accuracy=1e-8)
    assert [event.time for event in run.events] == pytest.approx([each[0] for each in reference.events], abs=1e-7)
    assert differential._apart(run.states, right) < 1e-7


def test_a_comparison_that_was_stopped_goes_on_where_it_was(tmp_path):
    log = tmp_path / "log.jsonl"
    differential.work(1, 1, range(1, 2), log)
    first = log.read_text()
    log.write_text(first + '{"number": 3, "beg')  # killed in the middle of a line
    differential.work(1, 1, range(1, 4, 2), log)
    lines = list(differential.lines_of(log))
    assert log.read_text().startswith(first) and [line["number"] for line in lines if line.get("end") == "done"] == [1, 3]
