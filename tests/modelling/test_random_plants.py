"""Properties of plants that are drawn: what holds for every network of rotors, springs, dampers and one dry friction."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from models import Coulomb
from toolbox import Component, DryFriction, Equations, Trajectory, compose, quantity, simulate, state

RUN = 3.0


@dataclass(frozen=True)
class Rotor(Component):
    """J w' = -k a - c w - g (w - w of the rotor before) - F: a rotor on a spring and a damper, which the one before drags along."""

    inertia: float = quantity(1.0, "kg m2", "inertia", above=0)
    stiffness: float = quantity(1.0, "N m/rad", "spring to the ground", at_least=0)
    damping: float = quantity(0.1, "N m s/rad", "damper to the ground", at_least=0)
    drag: float = quantity(0.2, "N m s/rad", "damper to the rotor before", at_least=0)
    before: str = ""
    rubs: bool = False

    def equations(self, signal):
        a, w = state(f"{self.name}.angle", "rad"), state(f"{self.name}.speed", "rad/s")
        other = signal(f"{self.before}.speed", "rad/s") if self.before else 0.0
        rub = [DryFriction(f"{self.name}.rub", w, Coulomb(static=0.3, kinetic=0.2))] if self.rubs else []
        torque = -self.stiffness * a - self.damping * w - self.drag * (w - other) + sum(each.force for each in rub)
        return Equations(flow={a: w, w: torque / self.inertia}, elements=rub)


@st.composite
def networks(draw, rubs=None):
    """(parts, start): one to four rotors, each dragged by one that was drawn before it."""
    sizes = st.floats(0.2, 5.0)
    rubs = draw(st.booleans()) if rubs is None else rubs
    parts, start = [], {}
    for i in range(draw(st.integers(1, 4))):
        before = f"rotor{draw(st.integers(0, i - 1))}" if i else ""
        parts.append(Rotor(draw(sizes), draw(sizes), draw(sizes) / 5, draw(sizes) / 5, before, rubs and i == 0, name=f"rotor{i}"))
        start |= {f"rotor{i}.angle": draw(st.floats(-2.0, 2.0)), f"rotor{i}.speed": draw(st.floats(-2.0, 2.0))}
    return parts, start


def ended(run, names):
    return {name: run.at(run.time[-1])[name] for name in names}


@settings(max_examples=15)
@given(networks(rubs=False))
def test_a_plant_without_friction_moves_as_the_exponential_of_its_matrix(network):
    parts, start = network
    matrix = np.zeros((2 * len(parts), 2 * len(parts)))
    for i, part in enumerate(parts):
        matrix[2 * i, 2 * i + 1] = 1.0
        matrix[2 * i + 1, 2 * i : 2 * i + 2] = -part.stiffness / part.inertia, -(part.damping + part.drag) / part.inertia
        if part.before:
            matrix[2 * i + 1, 2 * int(part.before[5:]) + 1] = part.drag / part.inertia
    begin = [start[f"rotor{i}.{what}"] for i in range(len(parts)) for what in ("angle", "speed")]
    end = ended(simulate(compose(*parts), RUN, start=start, accuracy=1e-9), start)
    found = [end[f"rotor{i}.{what}"] for i in range(len(parts)) for what in ("angle", "speed")]
    np.testing.assert_allclose(found, expm(RUN * matrix) @ begin, atol=1e-7)


@settings(max_examples=15)
@given(networks(), st.randoms(use_true_random=False))
def test_parts_may_stand_in_any_order(network, chance):
    parts, start = network
    shuffled = chance.sample(parts, len(parts))
    runs = [simulate(compose(*order), RUN, start=start, accuracy=1e-9) for order in (parts, shuffled)]
    ends = [ended(run, start) for run in runs]
    assert len(runs[0].events) == len(runs[1].events)
    assert [ends[1][name] for name in ends[0]] == pytest.approx(list(ends[0].values()), abs=1e-7)


@settings(max_examples=10)
@given(networks(), st.randoms(use_true_random=False))
def test_names_may_stand_in_any_order_to_the_last_bit(network, chance):
    parts, start = network
    plant = compose(*parts)
    numbers = {f"{part.name}.{what}": 1.1 * getattr(part, what) for part in parts for what in ("inertia", "stiffness", "damping")}

    def mixed(names):
        return dict(chance.sample(sorted(names.items()), len(names)))

    one, other = (simulate(plant, RUN, start=mixed(start), parameters=mixed(numbers)) for _ in range(2))
    assert np.array_equal(one.time, other.time) and all(np.array_equal(one[name], other[name]) for name in start)


@settings(max_examples=10)
@given(networks())
def test_a_run_comes_back_from_its_file_as_it_was(network):
    parts, start = network
    run = simulate(compose(*parts), RUN, start=start)
    with tempfile.TemporaryDirectory() as folder:
        run.save(Path(folder) / "run.npz")
        back = Trajectory.load(Path(folder) / "run.npz")
    assert np.array_equal(back.time, run.time) and back.events == run.events
    assert all(np.array_equal(back[name], run[name]) for name in start)


@settings(max_examples=15)
@given(networks(rubs=True))
def test_a_run_that_is_cut_anywhere_goes_on_as_the_whole(network):
    parts, start = network
    plant = compose(*parts)
    whole = simulate(plant, RUN, start=start, accuracy=1e-9)
    first = simulate(plant, RUN / 3, start=start, accuracy=1e-9)
    rest = simulate(plant, 2 * RUN / 3, start=first.last, accuracy=1e-9)
    assert list(ended(rest, start).values()) == pytest.approx(list(ended(whole, start).values()), abs=1e-6)
    assert [event.element for event in first.events + rest.events] == [event.element for event in whole.events]
