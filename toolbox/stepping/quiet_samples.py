"""From one sample to the next while nothing else happens: the short path of the event loop for laws that are sampled.

Where steps could be several times as long as the time between two samples, almost every one ends on a sample, crosses no guard and is accepted at once. Such
steps need no choice of size, no search for events and no record before the sample. Whatever is not so is left to the loop, which does it as it always does;
the numbers are the same to the last bit.
"""

from __future__ import annotations

from toolbox.compilation import work_layout as layout
from toolbox.stepping.calendar import next_stop, record, samples
from toolbox.stepping.crossings import watch
from toolbox.stepping.guards import accept, held_quietly, project
from toolbox.stepping.step_control import scaled_error
from toolbox.translation.words import call

REFRESHED = 32
"""Accepted steps after which the loop measures round-off again."""


def cut_short(h, wanted):
    """Whether a step h is so much shorter than the one wanted that its error says nothing of how long the next one may be."""
    return layout.CUT_SHORT * h <= wanted


def samples_rule(w):
    """Whether the next step ends on a sample of a compiled law, which cuts it short, and no element bounces or switches."""
    few = w.samplers.shape[0]
    if few == 0 or w.ints[layout.IMPLICIT] == 1 or w.ints[layout.SERIES] != 0:
        return False
    for c in range(few):
        if w.samplers[c, layout.ADDRESS] == 0:
            return False
    for i in range(w.ints[layout.NE]):
        if w.kind[i] != layout.FRICTION:
            return False
    return cut_short(next_stop(w) - w.reals[layout.TIME], min(w.reals[layout.STEP_SIZE], w.reals[layout.LONGEST]))


def from_sample_to_sample(w, every_node, budget):
    """Step from sample to sample as long as nothing else happens.

    budget: accepted and refused steps at which the loop pauses. Returns whether a sample has been taken after which the modes are still to be decided.
    """
    wanted = min(w.reals[layout.STEP_SIZE], w.reals[layout.LONGEST])
    last = w.reals[layout.END]
    if w.ints[layout.JUMP] < w.jump_t.size:
        last = min(last, w.jump_t[w.ints[layout.JUMP]])
    if w.ints[layout.OUTPUT] < w.out_t.size:
        last = min(last, w.out_t[w.ints[layout.OUTPUT]])
    while True:
        t = w.reals[layout.TIME]
        stop = next_stop(w)
        h = stop - t
        due = w.ints[layout.ACCEPTED] + 1
        if not (cut_short(h, wanted) and stop < last and h > 1e-13 * abs(t) and h > 1e-300):
            return False
        if due % REFRESHED == 0 or due + w.ints[layout.REJECTED] > budget or w.ints[layout.RECORDS] + 8 > w.rec_t.size:
            return False
        call(w.ints[layout.STEP], t, h, w.x, w.k, w.p, w.m, w.y)
        error = scaled_error(w, h)
        if not error <= 1.0:
            return False
        hit, suspicious, _ = watch(w, h, error, False)
        if hit or suspicious:
            return False
        w.ints[layout.ACCEPTED] = due
        w.reals[layout.STEP_OLD] = 0.0
        w.reals[layout.TIME] = stop
        accept(w)
        project(w, stop)
        status, changed = samples(w, stop)
        if status != layout.DONE:  # the loop asks again, and ends there
            return False
        if changed and not held_quietly(w):
            return True
        if every_node:
            record(w, stop, w.x)
