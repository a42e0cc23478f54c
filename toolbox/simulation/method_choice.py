"""Method selection for method="auto": which method a run takes, and why. It is a rule of numbers that do not depend on the machine.

Measured on chains of n inertias with dry friction on each (60 s, static = kinetic): located events cost about n steps of cost n each time something switches,
time stepping a step of cost n at fixed intervals.

    n      events      time for an error of 1e-2: events     time stepping
    10     211         1 ms                                  22 ms
    30     671         75 to 120 ms                          89 ms
    100    2283        1500 to 3200 ms                       540 ms, at an error of 1e-3 1100 ms

    1. accuracy >= 1e-3 and at least 50 contacts: time stepping; where it cannot meet the accuracy, located events
    2. else located events, which choose between Taylor series and implicit steps themselves (`toolbox.simulation.stiffness`); explicit formulas where a law is
       sampled, or where the plant has no series or long ones (`toolbox.compilation.taylor`)
    3. where these find no end of switching, or no modes: time stepping, which passes such points

Taylor series took 0.5 to 0.75 of the time of explicit formulas at an equal error, from a block on a belt to ten inertias that all rub.

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
