"""The study of wells: what its gains are counted in, that its wells stick and slip, and that a border of its table is one."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import pytest

from controllers import LQG
from models.wells import JANSEN_2, NAVARRO_LOPEZ_4
from studies.questions import wells as study
from toolbox.drilling.set_points import PROTOCOLS

TABLE = Path(__file__).parents[2] / "docs" / "wells.csv"


def test_a_string_of_one_inertia_below_its_drive_swings_as_the_closed_form_says():
    stiffness, below = JANSEN_2.stiffness[0], JANSEN_2.inertia[1]
    assert study.swing(JANSEN_2) == pytest.approx((math.sqrt(stiffness * below), math.sqrt(stiffness / below)), rel=1e-12)


def test_gains_are_the_same_parts_of_any_string():
    kept = study.numbers()["LQG, between, lifting"] | study.numbers()["impedance, tuned, lifting"]
    assert study.scaled(kept, JANSEN_2) == kept
    stiffer = replace(JANSEN_2, stiffness=(4.0 * JANSEN_2.stiffness[0],))  # twice the impedance, twice the frequency
    factors = {"proportional": 2.0, "integral": 4.0, "torque_scale": 2.0, "angle_scale": 0.5, "torque_process_noise": 2.0 * math.sqrt(2.0)}
    for name, value in study.scaled(kept, stiffer).items():
        assert value == pytest.approx(kept[name] * factors.get(name, 1.0), rel=1e-3), name
    light = study.scaled(kept, NAVARRO_LOPEZ_4)["drive_process_noise"] / kept["drive_process_noise"]
    assert light == pytest.approx(NAVARRO_LOPEZ_4.inertia[0] / JANSEN_2.inertia[0], rel=1e-3)


@pytest.mark.parametrize("name", list(study.wells()))
def test_the_stiff_drive_has_every_well_in_stick_slip(name):
    tried = study.trial(study.wells()[name], study.LABELS[0])
    assert all(tried.cycle(speed).sticks for speed in ((4.0, 5.0) if name == "four inertias" else (4.0, 8.0)))  # that one is damped more
    assert isinstance(tried.of(4.0).law, LQG) and tried.of(4.0).law.reference == 4.0


def test_friction_along_the_deepest_well_asks_for_the_torque_that_is_told():
    loads = {name: sum(chain.friction_load or ()) * 0.25 for name, chain in study.wells().items() if "friction" in name}
    assert [round(each / 1e3, 1) for each in loads.values()] == [4.9, 7.8, 11.6]


def test_a_border_of_the_table_is_one():
    name, label = "1500 m", "impedance, tuned, lifting"
    with TABLE.open(encoding="utf-8", newline="") as file:
        border = next(float(row["nominal takeover"]) for row in csv.DictReader(file) if (row["well"], row["label"]) == (name, label))
    tried = study.trial(study.wells()[name], label)
    declared = study.groups(tried)[0]

    def holds(speed):
        return tried.outcome(declared, speed).passed and tried.disk_margins(declared.machines, speed)[0] >= study.MARGIN

    assert holds(round(border + 0.1, 6)) and not holds(round(border - 0.1, 6))


@pytest.mark.slow
def test_a_row_has_what_the_table_shows():
    found = study.row("3000 m", "impedance, tuned, lifting", ways=PROTOCOLS[:1]).flat()
    assert found["one_at_a_time takeover"] <= 4.5 and found["judged"] == study.BRIEF and found["disk margin, one_at_a_time"] > 0.0
    text = study.table([found])
    assert "3000 m" in text and f"{found['one_at_a_time takeover']:.1f}" in text
