"""What stays in memory of inputs given as casadi expressions, each of which is compiled."""

import gc
import os
import subprocess
import sys

import numpy as np
import pytest

from models import BlockOnBelt
from toolbox import compose, simulate, time
from toolbox.compilation.program import EXPRESSIONS

SCRIPT = """
import casadi as ca
from models import BlockOnBelt
from toolbox import compose, simulate, time

def resident():
    return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmRSS"))

plant = compose(BlockOnBelt())
for k in range(250):
    simulate(plant, 5.0, inputs={"block.force": 0.1 * ca.sin((1.0 + 1e-3 * k) * time)})
    if k == 49:
        begin = resident()
print(resident() - begin)
"""


def test_a_run_stays_whole_when_the_code_of_other_expressions_takes_its_place():
    plant = compose(BlockOnBelt())
    first = simulate(plant, 10.0, inputs={"block.force": 0.1 * (1.0 + 0.001 * time)})
    states = first.at(np.linspace(0.0, 10.0, 77)).states
    for k in range(2 * EXPRESSIONS):
        simulate(plant, 0.1, inputs={"block.force": 0.1 * (1.1 + 0.001 * k * time)})
    gc.collect()
    programs = [key for key in plant.cache if isinstance(key, tuple) and key[0] == "program" and "ExpressionKey" in repr(key[1])]
    assert len(programs) == EXPRESSIONS
    np.testing.assert_array_equal(first.at(np.linspace(0.0, 10.0, 77)).states, states)
    assert first.error_estimate < 1e-6
    again = simulate(plant, 10.0, inputs={"block.force": 0.1 * (1.0 + 0.001 * time)})
    np.testing.assert_array_equal(again.states, first.states)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_thousand_expressions_take_at_most_fifty_megabytes(tmp_path, root):
    """Two hundred of them a fifth of that, compiled for the first time."""
    environment = os.environ | {"STICKSLIP_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(root)}
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=110, check=True, env=environment)
    assert int(done.stdout) < 10_000
