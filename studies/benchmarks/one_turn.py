"""Processor time of the cases of a tree, one turn: a file that uses only names that older trees have, because it runs with the packages of each of two trees.

`studies/benchmarks/speed.py --against` starts it.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import toolbox
from studies.benchmarks.cases import cases
from toolbox import simulate

SECONDS = 0.15
"""Processor time for which the run of a case is repeated."""

FEWEST = 3
"""Runs of a case, at least."""


def turn(names: list[str], methods: list[str], accuracy: float) -> dict[str, Any]:
    """Return where the packages come from, their versions, and by case and method the least processor time of a run [s] and its number of switches."""
    rows: dict[str, Any] = {}
    known = cases()
    for name in (name for name in names if name in known):
        case = known[name]
        for method in methods:
            try:
                switches = len(simulate(case.loop, case.duration, method=method, accuracy=accuracy).events)  # compiled from here on
            except Exception as failure:  # an older tree may not have the method
                rows[f"{name} {method}"] = {"failure": f"{type(failure).__name__}: {failure}"}
                continue
            times: list[float] = []
            while len(times) < FEWEST or sum(times) < SECONDS:
                began = time.process_time()
                simulate(case.loop, case.duration, method=method, accuracy=accuracy)
                times.append(time.process_time() - began)
            rows[f"{name} {method}"] = {"seconds": min(times), "switches": switches}
    versions = f"Python {sys.version.split()[0]}, numpy {np.__version__}"
    return {"tree": str(Path(toolbox.__file__).resolve().parents[1]), "versions": versions, "rows": rows}


def report() -> None:
    """Print as JSON the turn that the command line asks for: cases and methods, both with commas, and the accuracy."""
    names, methods, accuracy = sys.argv[1:]
    print(json.dumps(turn(names.split(","), methods.split(","), float(accuracy))))
