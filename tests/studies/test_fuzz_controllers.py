"""Shipped controllers with numbers up to their bounds: nothing that is no finite number passes for a good run."""

import pytest

from studies.benchmarks.controllers import examine, shipped, trial

CONTROLLERS = sorted(shipped())


@pytest.mark.parametrize("name", CONTROLLERS)
def test_no_draw_of_a_shipped_controller_passes_with_a_value_that_is_no_finite_number(name):
    """In Python and in lanes, and of the first machines as C and as FMU; `python -m studies fuzz --section controllers` takes hundreds."""
    index = CONTROLLERS.index(name) + len(CONTROLLERS) * (1 if CONTROLLERS.index(name) % 5 else 4)
    outcomes = list(examine(3, index))
    assert not [each for each in outcomes if each[0] not in ("right", "left out")]
    assert sum(kind == "right" for kind, _ in outcomes) >= 5


def test_every_shipped_controller_has_its_turn():
    drawn = {trial(3, index)[0] for index in range(len(CONTROLLERS))}
    assert drawn >= set(CONTROLLERS) - {"LinearMPC", "NonlinearMPC", "BrakeMPC"}
