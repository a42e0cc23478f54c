"""What lies between the nodes of a run: its states there, by the steps that the run took, and the times at which two runs can be compared."""

from __future__ import annotations

from typing import Any

import numpy as np

from toolbox.compilation.program import Program, program_of
from toolbox.compilation.work_layout import Between


def states_between(run: Any, times: np.ndarray, row: np.ndarray) -> np.ndarray:
    """States at times within the recorded steps that begin at the nodes `row` of a run, which may have taken other steps at first."""
    if run.before is None:
        return _within(run, run.program, times, row)
    turn, formulas = run.before
    early = run.time[row] < turn
    states = np.empty((times.size, run.states.shape[1]))
    for chosen, program in ((early, program_of(run.run.system, run.run.kinds, formulas)), (~early, run.program)):
        states[chosen] = _within(run, program, times[chosen], row[chosen])
    return states


def _within(run: Any, program: Program, times: np.ndarray, row: np.ndarray) -> np.ndarray:
    """States at times by one step of a program from the node, or from the last step that has passed."""
    from toolbox.stepping import event_stepper as loop
    from toolbox.stepping.between import room_of

    states = np.empty((times.size, run.states.shape[1]))
    following = np.searchsorted(run.passed, run.time, side="right")
    work = Between(
        ints=program.ints, time=run.time, state=run.states, mode=run.mode, held=run.held, p=run.parameters.copy(), row=row, times=times, states=states,
        passed=run.passed, first=following, **room_of(program.kernel),
    )  # fmt: skip
    loop.evaluate(Between._make(np.ascontiguousarray(each) for each in work))
    return states


def outside_jumps(times: np.ndarray, run: Any, better: Any) -> tuple[np.ndarray, float]:
    """Return the times at which both runs have made the same impacts, and the largest distance between their impacts as a fraction of the
    duration."""
    jumps = [nodes._jumps(run.accuracy) for nodes in (run, better)]
    late, blur = 0.0, run._blur + better._blur
    for some, others in (jumps, jumps[::-1]):
        if not some.size:
            continue
        if not others.size:
            return times, 1.0
        right = np.minimum(np.searchsorted(others, some), others.size - 1)
        gap = np.minimum(np.abs(others[right] - some), np.abs(others[np.maximum(right - 1, 0)] - some))
        late = max(late, float(gap.max()) / (run.end - run.begin))
        reach = 2.0 * gap + blur
        within = np.searchsorted(np.sort(some - reach), times, side="right") > np.searchsorted(np.sort(some + reach), times, side="left")
        times = times[~within]
    return times, late
