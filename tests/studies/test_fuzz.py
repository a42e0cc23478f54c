"""Random plants at the edges of their numbers: right answers, or errors of the toolbox that say why."""

import json

import pytest

from studies.benchmarks.fuzz import DEFECTS, examine


@pytest.mark.parametrize("number", range(4))
def test_no_draw_of_a_random_plant_ends_in_a_crash_a_nan_or_a_silent_wrong_answer(number, tmp_path):
    """A network of masses, another, a drill string with a drive, and a shipped scene; `python -m studies fuzz` takes hundreds."""
    log = tmp_path / "log.jsonl"
    examine(7, number, 20, log)
    ends = [line for line in map(json.loads, log.read_text().splitlines()) if "end" in line]
    assert not [line for line in ends if line["end"] in DEFECTS]
    assert sum(line["end"] == "done" for line in ends) >= 5  # most numbers make sense
