"""Which method a run takes, and why, by method=None and by method="auto". Both are rules of numbers that do not depend on the machine.

By method=None switches are located as events, by the steps that were the fastest on the shipped scenes (`python -m studies methods`):

    1. explicit formulas where a law is sampled, because almost every step ends on a sample, of whatever order it is
    2. explicit formulas at an accuracy looser than FINE, where those of order 5 come closer, or finer than FINEST, where what a guard does within 1e-4 of a
       long step may count
    3. explicit formulas for more than FEW states, whose series take longer to compile, once on a machine, than a thousand runs save
    4. else Taylor series, or explicit formulas where the plant has no series (`toolbox.compilation.taylor`)

Either changes to implicit steps where these prove cheaper (`toolbox.simulation.stiffness`).

By method="auto", which is for runs that are repeated often enough for any time to compile:

    1. accuracy >= 1e-3 and at least 50 contacts: time stepping; where it cannot meet the accuracy, located events
    2. else located events, by Taylor series unless a law is sampled
    3. where these find no end of switching, or no modes: time stepping, which passes such points

Measured on chains of n inertias with dry friction on each (60 s, static = kinetic): located events cost about n steps of cost n each time something switches,
time stepping a step of cost n at fixed intervals.

    n      events      time for an error of 1e-2: events     time stepping
    10     211         1 ms                                  22 ms
    30     671         75 to 120 ms                          89 ms
    100    2283        1500 to 3200 ms                       540 ms, at an error of 1e-3 1100 ms

Smoothed friction is never chosen: in no measured case was it the cheapest.
"""

from __future__ import annotations

from toolbox.errors import AccuracyError, NoModes, ZenoError
from toolbox.simulation.methods import EventExact, TaylorSeries, TimeStepping
from toolbox.simulation.run import Run
from toolbox.simulation.trajectory import Trajectory

LOOSE = 1e-3
"""Accuracy from which time stepping can pay."""

MANY = 50
"""Contacts from which it does."""

FINEST, FINE = 1e-9, 1e-5
"""Accuracies between which steps are series by method=None."""

FEW = 12
"""States up to which they do."""


def fastest_located(run: Run) -> Trajectory:
    """The run with located events, by the rule of this module by method=None, with the reason in `why`."""
    states, reason = run.system.x.numel(), ""
    if run.system.updates:
        reason = "a law is sampled"
    elif not FINEST <= run.accuracy <= FINE:
        reason = f"an accuracy of {run.accuracy:g} is not between {FINEST:g} and {FINE:g}"
    elif states > FEW:
        reason = f"{states} states are more than {FEW}"
    done = run.again() if reason else run.again(method=TaylorSeries())
    formulas = done.program.formulas
    if not reason:
        reason = done.why.partition(": ")[2] or f"{states} state{'s' * (states != 1)} at an accuracy of {run.accuracy:g}"
    done.why = formulas.steps if formulas.implicit else f"{formulas.steps}: {reason}"
    return done


def cheapest_method(run: Run) -> Trajectory:
    """The run by the method of this module's rule, with the reason in `why`."""
    contacts = sum(element.holds and not element.second for element in run.system.elements)
    refused = ""
    stepped = not run.laws and all(element.directions == 1 for element in run.system.elements)
    if run.accuracy >= LOOSE and contacts >= MANY and stepped:
        try:
            done = run.again(method=TimeStepping())
        except AccuracyError as failed:
            refused = f"; time stepping stops at an error of {failed.run.error:.1e}"
        else:
            done.why = f"time-stepping: {contacts} contacts at an accuracy of {run.accuracy:g}, steps of {done.step:.3g} s"
            return done
    try:
        done = run.again(method=EventExact() if run.system.updates else TaylorSeries())
    except (ZenoError, NoModes) as failed:
        if not stepped:
            raise
        reason = str(failed).rstrip(".")
        done = run.again(method=TimeStepping())
        done.why = f"time-stepping, steps of {done.step:.3g} s: with located events, {reason[0].lower()}{reason[1:]}"
        return done
    formulas = done.program.formulas
    steps = formulas.steps if formulas.implicit or not done.why else f"{formulas.steps} ({done.why.partition(': ')[2]})"
    few = f"{contacts} contact{'s' * (contacts != 1)} at an accuracy of {run.accuracy:g}"
    done.why = f"event: {few}, {steps}{refused}"
    return done
