"""Random machines of one kind, each judged by its own module: `examine(seed, number)` gives (kind, words) for every outcome.

A module of a section says in its head what right is. A finding is anything but "right", "left out" and
"refused", which a section says of a refusal that it proves right: an error of the toolbox and a hang among them.
"""

from __future__ import annotations

import faulthandler
import importlib
import time as clock
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

SECTIONS = ("levers", "cones", "controllers", "rests", "cuts", "mechanisms")
"""Modules of `studies.benchmarks`."""
FINE = ("right", "left out", "refused")
"""Outcomes that are no finding; a refusal is one only with a proof that it is right."""
LONGEST = 120.0
"""Time that one machine may take [s], compilation and repetitions at a higher accuracy included."""


def judged(section: str, seed: int, number: int) -> list[tuple[str, str]]:
    """The outcomes of one machine; a process in which it takes too long dies."""
    faulthandler.dump_traceback_later(LONGEST, exit=True)
    try:
        return list(importlib.import_module(f"studies.benchmarks.{section}").examine(seed, number))
    except Exception as error:
        return [("crash", f"{type(error).__name__}: {error}")]
    finally:
        faulthandler.cancel_dump_traceback_later()


def main(section: str, structures: int, seed: int, jobs: int, first: int) -> int:
    """Examine machines of a section in processes and print what was found; the number of findings."""
    counts: Counter[str] = Counter()
    began = clock.perf_counter()
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        waiting = [(number, pool.submit(judged, section, seed, number)) for number in range(first, first + structures)]
        for number, future in waiting:
            for kind, words in future.result():
                counts[kind] += 1
                if kind not in FINE:
                    print(f"  {section} {number}: {kind}: {words}", flush=True)
    print(f"\n{structures} machines of {section} in {clock.perf_counter() - began:.0f} s")
    for kind, count in counts.most_common():
        print(f"  {kind:<16}{count:8d}")
    return sum(count for kind, count in counts.items() if kind not in FINE)
