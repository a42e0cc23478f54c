"""A number that is far from what its field usually holds: one warning with both readings, and none for what was not typed."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from dataclasses import dataclass

import casadi as ca
import pytest

from controllers import PI, SoftTorque
from models import BitRock, DragBit, TorsionalChain, wells
from tests.plants import RIG
from toolbox import Component, Equations, closed_loop, compose, quantity, simulate, state
from toolbox.errors import UnusualValue
from toolbox.files.units import _WARNED as GIVEN  # only to begin anew
from toolbox.files.units import MISTAKEN, parse
from toolbox.scenes import catalogue


@pytest.fixture(autouse=True)
def nothing_said_yet():
    GIVEN.clear()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: SoftTorque(reference=95.0), "`SoftTorque.reference` is 95 rad/s, which is 907 rpm; .*`95 rpm` = 9.95 rad/s"),
        (lambda: BitRock(weight=20), "`BitRock.weight` is 20 N.*`20 kN` = 2e.04 N or `20 klbf` = 8.9e.04 N"),
        (lambda: BitRock(radius=6.125), "`BitRock.radius` is 6.125 m.*`6.125 in` = 0.156 m"),
        (lambda: DragBit(specific_energy=60.0), "`DragBit.specific_energy` is 60 Pa.*`60 MPa` = 6e.07 Pa"),
        (lambda: TorsionalChain(stiffness=(0.473,)), "`TorsionalChain.stiffness` is 0.473 N m/rad.*`0.473 kN m/rad` = 473 N m/rad"),
        (lambda: PI(reference="907 rpm"), r"`PI.reference` is `907 rpm` = 94.98 rad/s; usual is 0.05 to 40 rad/s \(0.477 to 382 rpm\).$"),
        (lambda: BitRock(weight=1e9), r"`BitRock.weight` is 1e\+09 N.*kN\).$"),
    ],
)  # fmt: skip
def test_a_number_in_the_wrong_unit_is_told_with_the_unit_that_was_meant(make, words):
    with pytest.warns(UnusualValue, match=words) as caught:
        make()
    assert len(caught) == 1 and caught[0].filename == __file__  # where it was typed


def test_it_is_said_once_and_not_again_by_the_law_that_is_designed_nor_for_numbers_that_nobody_typed():
    with pytest.warns(UnusualValue) as caught:
        law = SoftTorque(reference=95.0)
        simulate(RIG, 0.1, controller=law)
        PI(reference=95.0)
    assert len(caught) == 1
    changed = RIG.with_parameters({"bit.weight": 97.0})  # warnings are errors here
    assert changed.parts[1].weight == 97.0


def test_zero_and_either_direction_are_usual():
    assert PI(reference=0.0).reference == 0.0 and PI(reference=-8.0).reference == -8.0 and BitRock(weight=0.0).weight == 0.0


def test_a_part_of_ones_own_declares_what_is_usual_and_its_bounds_hold_beside():
    @dataclass(frozen=True)
    class Own(Component):
        gap: float = quantity(1e-3, "m", "gap", above=0, typical_range=(1e-6, 0.1))
        rate: float = quantity(1.0, "1/s", "rate", typical_range=(0.1, 10.0))

        def equations(self, signal):
            x = state("own.x", "m")
            return Equations(flow={x: -self.rate * x / self.gap})

    with pytest.warns(UnusualValue, match="`0.5 mm` = 0.0005 m"):
        Own(gap=0.5)
    with pytest.warns(UnusualValue, match=r"`Own.rate` is 100 1/s; usual is 0.1 to 10 1/s.$"):
        Own(rate=100.0)
    assert Own(gap=ca.SX.sym("gap")).gap.is_symbolic()


def test_every_unit_that_a_warning_offers_fits_its_field():
    assert all(parse(f"1 {other}", unit) != 1.0 for unit, others in MISTAKEN.items() for other in others)


def test_shipped_parts_and_laws_are_usual_by_themselves():
    made = 0
    for entry in catalogue.parts():
        if isinstance(entry.item, type):
            with contextlib.suppress(TypeError):  # fields without a default
                entry.item()
                made += 1
    assert made > 40


def test_a_command_says_it_in_one_line(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'title = "Rig"\nduration = "1 s"\nreference = 95\nverdict = { element = "bit", signal = "bit.speed" }\n'
        '[[plant]]\npart = "wells.JANSEN_2"\n[[plant]]\npart = "BitRock"\n[[controllers]]\nlabel = "PI"\nlaw = "PI"\n'
    )
    done = subprocess.run([sys.executable, "-m", "toolbox", "simulate", str(scene)], capture_output=True, text=True, check=True)
    assert (
        done.stderr.startswith("stickslip: warning: Argument `PI.reference` is 95 rad/s, which is 907 rpm;")
        and done.stderr.count("\n") == 1
    )


@pytest.mark.parametrize(
    ("name", "span", "words"),
    [
        ("top.reference", (30, 130), "`top.reference` is 130 rad/s.*`130 rpm` = 13.6 rad/s"),
        ("bit.weight", (40.0, 140.0), "`bit.weight` is 140 N.*`140 kN`"),
        ("pi.reference", (-100.0, 20.0), "`pi.reference` is -100 rad/s.*`-100 rpm`"),
    ],
)
def test_a_range_of_bare_numbers_far_from_what_is_usual_is_told(name, span, words):
    loop = closed_loop(compose(wells.JANSEN_2, BitRock()), PI(), element="bit")
    with pytest.warns(UnusualValue, match=words):
        assert loop.number(name).span(span) == span


@pytest.mark.parametrize(
    "span", [("30 rad/s", "130 rad/s"), ("30 rpm", "130 rpm"), (0.001, 30.0), (-2.0, 2.0), (parse("1 rad/s", "rad/s"), 130.0)]
)
def test_a_range_with_a_unit_or_within_what_is_usual_is_not(span):
    closed_loop(compose(wells.JANSEN_2, BitRock()), PI(), element="bit").number("top.reference").span(span)  # warnings are errors here
