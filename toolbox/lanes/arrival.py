"""Where every lane stands after a pass, and what the pass leaves to the loop."""

from __future__ import annotations

from dataclasses import dataclass

from toolbox.compilation.emitter import inline
from toolbox.lanes.layout import ALONE, EVENT, ROUND_OFF, SAMPLE, STOP
from toolbox.lanes.searches import signed
from toolbox.lanes.trial_step import Pass, Step
from toolbox.lanes.vectors import Rows, Truth, Value, largest


@dataclass(frozen=True)
class Verdicts:
    """Result of a step in every lane.

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


def emit_arrival(made: Pass, was: Rows, step: Step, located: Value, verdicts: Verdicts, lost: Truth) -> dict[str, list[Value]]:
    """Time, counts, flag, states, slopes, guards and sizes of a lane after the pass.

    located: the guard that it arrives at;  lost: lanes whose search is left to the scalar loop.
    """
    body, ng, own = made.body, made.ng, made.own
    accepted, moves, refused = verdicts.accepted, verdicts.moves, verdicts.refused
    side, armed = made.sides(was)
    t_new = step.to_stop.choose(accepted.choose(step.stop, step.t + step.h), step.t + step.h)
    straight = inline(body, made.projected, [[t_new.name], step.ends, *step.given[2:]])[0] if made.ne else step.ends[:own]
    final = [accepted.choose(Value(body, name), x) for name, x in zip(straight, step.x, strict=False)] + step.x[own:]
    found = {
        name: [moves.choose(value, o) for value, o in zip(column, was[name], strict=True)]
        for name, column in {"x": final, "k": step.k, "g": step.g}.items()
    }
    found["scale"] = [(moves & (abs(value) > o)).choose(abs(value), o) for value, o in zip(step.x, was["scale"], strict=True)]
    found["group_scale"] = list(was["group_scale"])
    for i, group in enumerate(made.program.groups.tolist()):
        found["group_scale"][group] = largest(found["scale"][i], found["group_scale"][group])
    sizes = [(moves & (abs(step.g[j]) > o)).choose(abs(step.g[j]), o) for j, o in enumerate(was["guard_scale"])]
    found["guard_scale"] = sizes
    found["armed"] = [(armed[j] | (moves & (signed(side, step.g, j) > 1e-13 * sizes[j]))).choose(1.0, 0.0) for j in range(ng)]
    taken = was["accepted"] + moves.choose(1.0, 0.0)
    every = Value(body, body.intrinsic("floor", (taken * (1 / 128)).name)) * 128.0
    stale = (refused & was["rejected"].differs(0.0)) | (moves & ~every.differs(taken))
    flag = stale.choose(float(ROUND_OFF), was["flag"])
    flag = ((accepted & step.to_stop) | verdicts.meets).choose(float(SAMPLE if made.program.updates else STOP), flag)
    flag = verdicts.arrives.choose(float(EVENT), flag)
    numbers = {
        "time": moves.choose(t_new, verdicts.meets.choose(step.stop, step.t)), "rejected": refused.choose(1.0, moves.choose(0.0, was["rejected"])),
        "located": verdicts.arrives.choose(located, was["located"]), "accepted": taken, "refused": was["refused"] + refused.choose(1.0, 0.0),
        "flag": (verdicts.odd | lost).choose(float(ALONE), flag),
    }  # fmt: skip
    return found | {name: [value] for name, value in numbers.items()}
