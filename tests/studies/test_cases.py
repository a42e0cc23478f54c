"""The benchmark cases against references that share no code with the toolbox (plain scipy with explicit switching)."""

import numpy as np
import pytest

from studies.benchmarks.cases import cases
from studies.benchmarks.speed import scaled_error
from toolbox import simulate

CASES = cases()


@pytest.fixture(scope="module")
def truth():
    found = {}

    def of(name):
        if name not in found:
            case = CASES[name]
            grid = np.linspace(0.0, case.duration, 201)
            found[name] = grid, case.reference(case.duration, rtol=1e-12 if name != "sampled" else 1e-10, output_times=grid)
        return found[name]

    return of


@pytest.mark.parametrize("accuracy", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("name", CASES)
def test_every_case_keeps_the_accuracy_asked_within_ten_and_finds_the_same_switches(name, accuracy, truth):
    case = CASES[name]
    grid, reference = truth(name)
    run = simulate(case.loop, case.duration, accuracy=accuracy)
    assert scaled_error(run.at(grid).states, reference.states) < 10 * accuracy
    assert [(e.element, e.before, e.after) for e in run.events] == [(s.contact, s.before, s.after) for s in reference.switches]
    times, theirs = [e.time for e in run.events], [s.time for s in reference.switches]
    np.testing.assert_allclose(times, theirs, atol=20 * accuracy)  # switching times have the accuracy of the trajectory


@pytest.mark.parametrize("name", CASES)
def test_the_error_that_a_run_reports_is_the_error_it_made(name, truth):
    case = CASES[name]
    grid, reference = truth(name)
    run = simulate(case.loop, case.duration, accuracy=1e-6)
    made = scaled_error(run.at(grid).states, reference.states)
    assert made / 10 < run.error_estimate < max(10 * made, 1e-10)
