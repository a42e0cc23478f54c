"""Where every lane stands after a pass, and what the pass leaves to the loop."""

from __future__ import annotations

from dataclasses import dataclass

from toolbox.compilation.emitter import inline
from toolbox.lanes.layout import ALONE, EVENT, ROUND_OFF, SAMPLE, STOP
from toolbox.lanes.searches import Guards, signed
from toolbox.lanes.trial_step import Pass, Step
from toolbox.lanes.vectors import Rows, Truth, Value, largest


@dataclass(frozen=True)
class Verdicts:
    """What becomes of a step, lane by lane.

    accepted: it is taken;  arrives: it ends at an event;  moves: either;  refused: its error is too large;  begins: a search for an event begins;
    goes_on: one goes on;  meets: a sample is too near to be stepped to;  too_long: for what is measured in it;  odd: left to the scalar loop.
    """

    accepted: Truth
    arrives: Truth
    moves: Truth
    refused: Truth
    begins: Truth
    goes_on: Truth
    meets: Truth
    too_long: Truth
    odd: Truth


def emit_arrival(made: Pass, was: Rows, step: Step, guards: Guards, verdicts: Verdicts) -> tuple[Value, dict[str, list[Value]]]:
    """Time, and states, slopes, guards and sizes of a lane after the pass."""
    body, n, ng, own = made.body, made.n, made.ng, made.own
    accepted, moves = verdicts.accepted, verdicts.moves
    more: dict[str, list[Value]] = {}
    t_new = step.to_stop.choose(accepted.choose(step.stop, step.t + step.h), step.t + step.h)
    time = moves.choose(t_new, verdicts.meets.choose(step.stop, step.t))
    straight = inline(body, made.projected, [[t_new.name], step.ends, *step.given[2:]])[0] if made.ne else step.ends[:own]
    final = [accepted.choose(Value(body, straight[i]), step.x[i]) if i < own else step.x[i] for i in range(n)]
    more["x"] = [moves.choose(value, o) for value, o in zip(final, was["x"], strict=True)]
    more["k"] = [moves.choose(value, o) for value, o in zip(step.k, was["k"], strict=True)]
    more["g"] = [moves.choose(value, o) for value, o in zip(step.g, was["g"], strict=True)]
    more["scale"] = [(moves & (abs(value) > o)).choose(abs(value), o) for value, o in zip(step.x, was["scale"], strict=True)]
    more["group_scale"] = list(was["group_scale"])
    for i, group in enumerate(made.program.groups.tolist()):
        more["group_scale"][group] = largest(more["scale"][i], more["group_scale"][group])
    sizes = [(moves & (abs(step.g[j]) > o)).choose(abs(step.g[j]), o) for j, o in enumerate(was["guard_scale"])]
    more["guard_scale"] = sizes
    more["armed"] = [(guards.armed[j] | (moves & (signed(guards.side, step.g, j) > 1e-13 * sizes[j]))).choose(1.0, 0.0) for j in range(ng)]
    return time, more


def emit_flags(made: Pass, was: Rows, step: Step, verdicts: Verdicts, rejected: Truth, taken: Value, lost: Truth) -> Value:
    """What the pass leaves to the loop."""
    body, program = made.body, made.program
    every = Value(body, body.intrinsic("floor", (taken * (1 / 128)).name)) * 128.0
    stale = (verdicts.refused & rejected) | (verdicts.moves & ~every.differs(taken))
    flag = stale.choose(float(ROUND_OFF), was["flag"])
    flag = ((verdicts.accepted & step.to_stop) | verdicts.meets).choose(float(SAMPLE if program.updates else STOP), flag)
    flag = verdicts.arrives.choose(float(EVENT), flag)
    return (verdicts.odd | lost).choose(float(ALONE), flag)
