"""One pass of a block of lanes as machine code: one call advances all lanes by one trial step; each lane has its own step size and its own error test.

With explicit formulas a lane steps on, or searches an event inside a step whose end it has seen; either way a pass is one step from where the lane stands,
so that lanes that search and lanes that step on share the same instructions. With Taylor series it ends on the event at once
(`toolbox.lanes.series_pass`). The pass does what `toolbox.stepping.event_stepper` does between events, in the same order: error,
guards, acceptance, step size. It flags what it leaves to the loop.
"""

from __future__ import annotations

from dataclasses import dataclass

from toolbox.compilation.bodies import plain_body
from toolbox.compilation.emitter import compiled
from toolbox.compilation.emitter import function_text as scalar_text
from toolbox.compilation.program import Program
from toolbox.compilation.vector_emitter import VectorBody, function_text
from toolbox.compilation.work_layout import CUT_SHORT
from toolbox.lanes.arrival import Verdicts, emit_arrival
from toolbox.lanes.events import carries_events, settling
from toolbox.lanes.extrema import Path, measure_step
from toolbox.lanes.layout import SAMPLE
from toolbox.lanes.quintics import measure_quintics
from toolbox.lanes.samples import POINTERS, sampling
from toolbox.lanes.searches import Guards, emit_dips, emit_guards, emit_search
from toolbox.lanes.series_pass import series_pass
from toolbox.lanes.trial_step import Pass, Step, emit_step, explicit_formulas
from toolbox.lanes.vectors import Rows, Value, largest, smallest
from toolbox.measuring.quintics import with_derivatives
from toolbox.stepping.step_control import LEAP, LEAP_OF_SETTLED, SETTLED

LARGE = 200_000
"""Instructions above which a block is compiled in a hurry: many runs are worth seconds of it."""


@dataclass(frozen=True)
class Block:
    """A compiled pass for blocks of shape (size, width).

    code: addresses of it and of the settling of events, the signals measured and the samples, 0 where there are none;  rows: the first row of every item.
    """

    code: tuple[int, ...]
    width: int
    rows: dict[str, int]
    size: int


def block(program: Program, width: int, signals: tuple[str, ...] = (), windows: int = 0, late: tuple[bool, ...] = ()) -> Block:
    """The pass of a program of explicit steps or Taylor series, for blocks of `width` lanes; kept with the program.

    signals: measured in so many windows, and with them the bounds of friction that vary in time, which takes the dense output of DOP853 or series unless
    laws are sampled;  late: which of these have a delay.
    """
    key = ("lanes", width, signals, windows, late)
    found = program.outputs.get(key)
    if found is None:
        found = program.outputs[key] = _compiled(program, width, signals, windows, late)
    return found


def _compiled(program: Program, width: int, signals: tuple[str, ...], windows: int, late: tuple[bool, ...]) -> Block:
    made = Pass(program, width, signals, windows)
    flag = series_pass(made) if program.formulas.series else _explicit_pass(made)
    body, rows = made.body, made.rows
    body.store_bits(flag.differs(0.0).name, "%lanes", rows["waiting"])
    if program.updates:
        body.store_bits((~flag.differs(float(SAMPLE))).name, "%lanes", rows["due"])
    bodies = {"advance": body}
    if carries_events(program):
        bodies["settle"] = settling(made)
    if program.updates:
        bodies["sample"] = sampling(made, late)
    found = _machine_code(made, bodies)
    return Block(tuple(found.get(name, 0) for name in ("advance", "settle", "observe", "sample")), width, rows, made.size)


def _explicit_pass(made: Pass) -> Value:
    """One trial step of explicit formulas in every lane; returns the flags."""
    step = emit_step(made)
    guards = emit_guards(made, step)
    verdicts = _emit_verdicts(made, step, guards)
    continues, lost = emit_search(made, step, guards, verdicts.begins, verdicts.goes_on)
    was = made.loaded()
    found = _step_size(made, was, step, verdicts) | {"searching": [continues.choose(1.0, 0.0)]}
    found |= emit_arrival(made, was, step, guards.located, verdicts, lost)
    if made.count and not made.program.updates:
        path = Path(explicit_formulas(made.program), made.rhs, step.t, step.h, was, step.slopes, step.x, step.k)
        measure_step(made.observe, path, verdicts.moves, made.windows(was), made.rows, was["rtol"])
    made.store(found)
    return found["flag"][0]


def _machine_code(made: Pass, bodies: dict[str, VectorBody]) -> dict[str, int]:
    """Addresses of the functions of a block, and of the signals that are measured."""
    scalar_texts: list[str] = []
    functions, declared = dict(made.body.functions), set(made.body.declarations)
    if made.count:
        plain = plain_body(made.observe, 0)
        scalar_texts.append(scalar_text("observe", plain))
        declared |= plain.declarations
    for other in bodies.values():
        functions |= other.functions
        declared |= other.declarations
    texts = [function_text(name, text, POINTERS if name == "sample" else ()) for name, text in bodies.items()]
    names = [*bodies, *(["observe"] if made.count else [])]
    count = sum(text.count for text in bodies.values())
    return compiled("\n".join([*texts, *scalar_texts, *functions.values(), *sorted(declared)]), names, count, LARGE)


def _emit_verdicts(made: Pass, step: Step, guards: Guards) -> Verdicts:
    """Which steps are taken, refused, searched or left to the scalar loop."""
    program, was, error = made.program, step.was, step.error
    # a sample nearer than can be resolved: its time is this one
    meets = guards.runs & step.unresolved & step.to_stop if program.updates else made.never
    fresh = guards.runs & ~step.searching & ~step.probing & ~meets
    searching, probing = guards.runs & step.searching, guards.runs & step.probing
    event = searching & guards.near & ~guards.below
    seen = error < 1e4
    hit, odd = (fresh | probing) & seen & guards.hit, (fresh & ((seen & guards.odd) | step.unresolved)) | (probing & guards.odd)
    asks, dipped, doubtful = emit_dips(made, step, guards, (fresh, probing, event), (hit, odd))
    odd |= dipped | doubtful
    event &= ~dipped
    begins = hit & ~odd
    goes_on = searching & ~event & ~dipped
    good = error <= 1.0
    steps = fresh & ~hit & ~odd & ~asks
    too_long = made.never
    if made.count and program.updates:
        derived = with_derivatives(program, made.signals, program.unguarded)
        edges = made.windows(was)
        others, numbers = [list(was["p"]), list(was["m"])], {name: was[name] for name in ("rtol", "longest", "end")}
        ends = (step.t, list(was["x"])), (step.t + step.h, step.x)
        too_long = measure_quintics(derived, ends, others, (steps | event) & good, edges, made.rows, numbers)
        good &= ~too_long
    accepted, arrives = steps & good, event & good
    moves = accepted | arrives
    refused = (steps | event) & ~good
    return Verdicts(accepted, arrives, moves, refused, begins, goes_on, meets, too_long, odd)


def _step_size(made: Pass, was: Rows, step: Step, verdicts: Verdicts) -> dict[str, list[Value]]:
    """The next step size of a lane, and what is remembered of this one."""
    body, h, error, accepted = made.body, step.h, step.error, verdicts.accepted
    power = float(explicit_formulas(made.program).power)
    logarithm = Value(body, body.rough_log2(largest(error, 1e-10).name))
    prediction = Value(body, body.rough_log2((h / was["step_old"]).name)) + power * (was["error_old"] - logarithm)
    growth = -power * logarithm
    growth = growth + (was["step_old"] > 0.0).choose(smallest(prediction, 0.0), 0.0)
    exponent = smallest(largest(accepted.choose(growth, -power * logarithm), -900.0), 900.0)
    factor = Value(body, body.rough_exp2(exponent.name))
    most = (h < SETTLED * was["step_old"]).choose(LEAP_OF_SETTLED, LEAP)
    grown = h * smallest(largest(0.85 * factor, 0.2), was["rejected"].differs(0.0).choose(1.0, most))
    grown = (h < step.wanted).choose(largest(grown, step.wanted), grown)
    cut = h * CUT_SHORT <= step.wanted
    grown = cut.choose(was["wanted"], grown)
    shrunk = h * verdicts.too_long.choose(0.5, (error < 1e30).choose(largest(0.9 * factor, 0.1), 0.1))
    return {
        "wanted": [accepted.choose(grown, verdicts.refused.choose(shrunk, was["wanted"]))],
        "error_old": [accepted.choose(largest(logarithm, -13.3), was["error_old"])],
        "step_old": [accepted.choose(cut.choose(0.0, h), was["step_old"])],
    }
