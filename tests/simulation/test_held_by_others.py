"""Contacts that hold each other at rest while forces vary, against explicit modes and scipy (`studies.benchmarks.enumerated_modes`)."""

from dataclasses import replace

import numpy as np
import pytest

from studies.benchmarks.differential import BUDGET, loop_of
from studies.benchmarks.enumerated_modes import Reference
from studies.benchmarks.rubbing_machines import Machine, Sine, Table, Trial, given
from toolbox import compose, simulate
from toolbox.simulation.methods import METHODS

REST = {f"machine.{kind}{i}": 0.0 for kind in "xv" for i in range(3)}


def compared(trial, method, accuracy):
    """The run of a trial, and its largest difference to the reference, relative to the largest position and the largest speed."""
    times = np.linspace(0.0, trial.duration, 101)
    right = Reference(trial, 1e-12).run(times)
    run = simulate(
        loop_of(compose(trial.machine), trial),
        trial.duration,
        output_times=times,
        method=replace(METHODS[method], budget=BUDGET),
        accuracy=accuracy,
    )
    found = np.column_stack([run[f"machine.{kind}{i}"] for kind in "xv" for i in range(3)])
    size = np.repeat([np.abs(right[:, :3]).max(), np.abs(right[:, 3:]).max()], 3)
    return run, (np.abs(found - right) / size).max()


@pytest.mark.parametrize("method", ["event", "stiff"])
def test_a_relay_whose_slip_is_only_round_off_is_let_go_once(method):
    """At rest v + lean x of the last mass is some 1e-22: what the projection leaves, not a slip that can fall to zero."""
    machine = Machine(
        mass=(1.252859809452906, 0.689877407093719, 0.8739211367425308), ground=(0.9445946326126271, 1.9234493682125073, 3.1807860772110366),
        damping=(0.05952100476780183, 0.05877088687422548, 0.10449683272840175), tie=(4.731000225510803, 9.126946717428263),
        static=(0.9656689234500804,), kinetic=(0.9656689234500804,), speed=(1.0,), bound=(1.0420677623536136,), lean=(1.0683435844220015,),
        rubs=("1 0 Coulomb one",), relays=("2 ground",),
    )  # fmt: skip
    inputs = {
        "machine.push1": -5.232658104599153,
        "machine.push2": Table((2.9052912798141826, 6.663676202137003), (0.37181623265831193, 4.618833937955818)),
    }
    run, error = compared(Trial(machine, REST, inputs, duration=7.180243700807554), method, 1e-8)
    assert error < 1e-7
    assert [event[1:] for event in run.events[:2]] == [("machine.relay0", "stick", "slip-"), ("machine.rub0", "slip-", "slip+")]


@pytest.mark.parametrize("method", ["event", "explicit", "stiff"])
def test_a_body_held_by_two_contacts_takes_no_steps_for_the_round_off_of_their_balance(method):
    """The middle mass is carried along by a contact whose force is the rest of larger ones, 1e-17 N of 1 N: its speed has no scale but their round-off."""
    machine = Machine(
        mass=(2.19, 0.86, 0.68), ground=(3.6, 2.9, 2.9), damping=(0.14, 0.29, 0.26), tie=(5.5, 8.9), static=(1.18, 1.49), kinetic=(1.18, 1.49),
        speed=(1.0, 1.0), bound=(1.14,), lean=(0.14,), rubs=("1 0 Coulomb one", "2 ground Coulomb one"), relays=("0 ground",),
    )  # fmt: skip
    inputs = {"machine.push0": Sine(0.32, 1.22, 0.237, 4.576), "machine.push2": Sine(2.58, 2.84, 0.765, 3.489)}
    run, error = compared(Trial(machine, REST, inputs, duration=5.9), method, 1e-7)
    assert error < 1e-6 and sum(run.steps) < 3_000
    assert run.error_estimate < 1e-6  # its second run comes to an end, too


PAIR = Machine(
    mass=(2.67, 1.1), ground=(0.0, 0.0), damping=(0.03, 0.045), tie=(5.98,), static=(1.3,), kinetic=(1.3,), speed=(1.0,), bound=(0.64,), lean=(1.61,),
    rubs=("1 0 Coulomb one",), relays=("0 ground",),
)  # fmt: skip
NEIGHBOUR = Machine(
    mass=(2.16, 0.54, 0.96), ground=(3.2, 0.14, 2.5), damping=(0.08, 0.27, 0.18), tie=(6.6, 5.2), static=(0.63,), kinetic=(0.63,), speed=(1.0,),
    bound=(2.26,), lean=(0.89,), rubs=("2 1 Coulomb one",), relays=("1 ground",),
)  # fmt: skip


LAST_OF_THREE = Machine(
    mass=(1.49, 2.6, 2.06), ground=(0.0, 0.0, 0.0), damping=(0.15, 0.094, 0.084), tie=(9.4, 7.3), static=(0.87, 0.344), kinetic=(0.87, 0.344),
    speed=(0.44, 0.125), bound=(2.4,), lean=(0.42,), rubs=("1 0 Coulomb one", "2 ground Coulomb one"), relays=("2 1",),
)  # fmt: skip
"""The first mass is held by one that is held by a third, whose force alone is none: its round-off comes from two contacts away."""


@pytest.mark.parametrize("method", ["event", "explicit", "stiff"])
@pytest.mark.parametrize(
    ("machine", "inputs"),
    [
        (LAST_OF_THREE, {"machine.push2": Sine(0.151, 0.171, 0.2088, 4.4138)}),
        (PAIR, {"machine.push0": Sine(0.066, 0.114, 0.413, 0.925), "machine.push1": -0.175}),
        (NEIGHBOUR, {"machine.push2": Table((1.7, 1.7, 2.9, 2.9), (-0.006, 0.16, 0.16, 0.21))}),
    ],
)
def test_bodies_that_only_round_off_moves_take_long_steps(machine, inputs, method):
    """Forces stay within the bounds, so nothing moves; round-off goes from the speed of a held body to its place, and on to a free neighbour."""
    run = simulate(compose(machine), 7.2, method=replace(METHODS[method], budget=BUDGET), accuracy=1e-8, inputs=given(inputs))
    assert not run.events and np.abs(run.states).max() < 1e-14
    assert sum(run.steps) < 1_000
