"""Which steps a run takes that locates its switches, where no kind of steps is named: a rule of numbers that do not depend on the machine.

    1. explicit formulas where a law is sampled, because almost every step ends on a sample, of whatever order it is
    2. explicit formulas at an accuracy looser than FINE, where those of order 5 come closer, or finer than FINEST, where what a guard does within 1e-4 of a
       long step may count
    3. explicit formulas for more than FEW states, whose series take longer to compile, once on a machine, than a thousand runs save
    4. else Taylor series, or explicit formulas where the plant has no series (`toolbox.compilation.taylor`)

These were the fastest on the shipped scenes (`python -m studies methods`). Either changes to implicit steps where these prove cheaper
(`toolbox.simulation.stiffness`).

Methods that locate no switch are never chosen. Time stepping is the faster one for very many contacts at a loose accuracy: on chains of n inertias with dry
friction on each (60 s, static = kinetic) located events cost about n steps of cost n each time something switches, time stepping a step of cost n at fixed
intervals.

    n      events      time for an error of 1e-2: events     time stepping
    10     211         1 ms                                  22 ms
    30     671         75 to 120 ms                          89 ms
    100    2283        1500 to 3200 ms                       540 ms, at an error of 1e-3 1100 ms

Smoothed friction was the cheapest in no measured case.
"""

from __future__ import annotations

from toolbox.modelling.hybrid_system import HybridSystem

FINEST, FINE = 1e-9, 1e-5
"""Accuracies between which steps are series."""

FEW = 9
"""States up to which they are."""


def without_series(accuracy: float, system: HybridSystem) -> str:
    """Return the reason why a closed system is not stepped by Taylor series; empty if it is."""
    states = system.x.numel()
    if system.updates:
        return "a law is sampled"
    if not FINEST <= accuracy <= FINE:
        return f"an accuracy of {accuracy:g} is not between {FINEST:g} and {FINE:g}"
    return f"{states} states are more than {FEW}" if states > FEW else ""


def reason(accuracy: float, system: HybridSystem) -> str:
    """Return the reason for the choice of steps of a closed system, series or not."""
    states = system.x.numel()
    return without_series(accuracy, system) or f"{states} state{'s' * (states != 1)} at an accuracy of {accuracy:g}"
