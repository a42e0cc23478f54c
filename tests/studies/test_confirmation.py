"""The simulation that confirms the drive table: it is right by itself, and the table stands in it."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from controllers import PI, StiffPI
from studies.protocol import DELAY, GROUPS, LIMITS, PLANT, trial
from studies.questions import confirmation as study
from toolbox import Sampled, simulate
from toolbox.modelling import Takeover
from toolbox.robustness.groups import Machine
from toolbox.robustness.set_points import SETTLING

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="the C of a law is compiled with `cc`, which is not here")
QUIET = np.zeros(80_000)


def of(reference):
    return PI(reference=reference, proportional=4000.0, integral=1500.0, **LIMITS)


@pytest.mark.parametrize(("reference", "stuck"), [(13.0, False), (3.0, True)])
def test_numbers_of_a_run_are_those_of_the_event_loop_and_do_not_depend_on_the_step(tmp_path, reference, stuck):
    made = study.machine(trial("PI", of(8.0)), reference, tmp_path)
    found = made.numbers(Machine("declared"), "direct", 0.0, QUIET)
    finer = made.numbers(Machine("declared"), "direct", 0.0, QUIET, step=5e-4)
    begin = study.BEGUN + 2.0 * made.law.cycle(reference).period + 1.0 + SETTLING
    both = Takeover(StiffPI(reference=reference, **LIMITS), of(reference), at=study.BEGUN)
    run = simulate(PLANT, begin + 80.0, controller=Sampled(both, 0.01, delay=DELAY))
    assert (found["stuck"] > 0.0) == stuck
    assert found["stuck"] == pytest.approx(run.time_in("bit", "stick", after=begin), abs=0.05)
    speed = run.at(np.arange(begin, run.end, 0.01))["bit.speed"].mean()
    assert found["speed"] == pytest.approx(speed, rel=2e-3)
    for name, value in finer.items():
        assert found[name] == pytest.approx(value, rel=2e-3, abs=1e-9)


def test_a_machine_below_its_set_point_fails_and_says_which_run(tmp_path):
    made = study.machine(trial("PI", of(8.0)), 3.0, tmp_path)
    assert "stuck" in next(study.failures(made, GROUPS["declared"], "direct"))


@pytest.mark.slow
@pytest.mark.parametrize("label", study.CONFIRMED)
def test_the_table_stands(label):
    for group in ("declared", "robust"):
        found = study.row(label, group, "raised")
        speed = study.CONFIRMED[label][group][1]
        assert speed <= found.border <= speed + 0.1001
        assert len(found.failed) <= 0.02 * GROUPS[group].runs
        assert found.below <= 0.2 and found.why
