"""Do gains that were tuned on one rig serve other wells, from 1500 to 5000 m, with and without friction along them, and a rig of four inertias?

Wells: API drill pipe of 5 in, 19.5 lb/ft, with its tool joints on 200 m of collars of 6.75 in, nine inertias, a drive as that of Jansen and van den Steen, the
bit, its drag and its 97 347 N of Navarro-Lopez and Cortes. With friction the hole is built from a quarter of its depth to half of it to 30 degrees, in mud of
1200 kg/m3, and rubs with coefficients of 0.25 at rest and 0.2 (4.9, 7.8 and 11.6 kN m before the string turns). The fourth rig is `NAVARRO_LOPEZ_4`.

Gains are those of the drive table on `JANSEN_2`, counted in parts of the string's own impedance and frequency, and of the drive's inertia J:

    om = lowest frequency of the string below a drive that does not turn,   zeta = k / om,   k = stiffness of all springs in series

    proportional, torque_scale ~ zeta    integral ~ J om^2    angle_scale ~ 1 / om    torque_walk ~ zeta sqrt(om)    drive_walk ~ J    sizes of speeds ~ 1

Why two go with J: the integral of an impedance cancels the inertia of its drive at om; the filter follows the measured speed at
drive_walk / (J noise sqrt(period)) [1/s], which a sample of 10 ms bounds.

Every law takes over from a stiff drive and is judged by `toolbox.drilling.set_points` on the declared well and on the group `one_at_a_time` (inertias,
stiffness and weight 10 and 20 % off, commands 30 ms later still). Laws see the top speed alone, are sampled every 10 ms, and their commands come 30 ms
late. By default from two phases with one seed for 80 s, which takes a minute or two for a well and a law; with --full from all phases with all seeds, and
for half an hour.

    python -m studies wells [--out FOLDER] [--only LABEL ...] [--laws LABEL ...] [--full]
        (the table and wells.csv; goes on where it was stopped)
"""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import eigh

from controllers import LQG, PI, Lifting, SoftTorque, StiffPI
from models import BitRock, Coulomb, DrillString, Section, Survey, ToolJoint, TorsionalChain, inner_diameter
from models.wells import JANSEN_2, NAVARRO_LOPEZ_4
from studies import gains
from studies.command_line import folder, parser_of, write_rows
from studies.protocol import DELAY, NOISE, WEIGHT
from studies.questions.drives import BETWEEN, LATE
from toolbox import Sampled, closed_loop, compose
from toolbox.drilling.groups import Group, Machine, machine_groups
from toolbox.drilling.lowest_set_point import Cells, SetPointLimit, borders
from toolbox.drilling.set_points import PROTOCOLS, Trial
from toolbox.files.printing import columns
from toolbox.robustness.margins import disk_margin

LIMITS: dict[str, Any] = {"lowest_torque": 0.0, "highest_torque": 40_000.0}
"""Those of a drive that turns the deepest well with friction: 20 kN m are asked for there in steady drilling."""
STIFF = StiffPI(**LIMITS)
LOWEST, HIGHEST = 2.0, 8.0
"""Set-points [rad/s] that are searched."""
MARGIN = 0.05
"""Disk margin that a set-point has to leave on every machine."""
GROUPS = ("nominal", "one_at_a_time")
JOINT = ToolJoint("6.625 in", "3.25 in", "21 in", every="31.7 ft")
TORQUE_SIZE = 3000.0
"""That of LQG as delivered [N m], with which its gains were tuned."""
POWERS = {
    "proportional": (1.0, 0.0, 0.0),
    "integral": (0.0, 2.0, 1.0),
    "torque_scale": (1.0, 0.0, 0.0),
    "angle_scale": (0.0, -1.0, 0.0),
    "torque_process_noise": (1.0, 0.5, 0.0),
    "drive_process_noise": (0.0, 0.0, 1.0),
}
"""Powers of impedance and frequency of the string and of the drive's inertia that go with a number of a law; one that is not named stays."""
FULL, BRIEF = "all phases and seeds, half an hour", "2 phases, 1 seed, 80 s"


def well(depth: float, inclination: float = 0.0) -> DrillString:
    """The string of a depth [m] in a vertical hole, or with friction in one of that inclination [deg] from half of its depth on."""
    pipes = [
        Section(depth - 200.0, "5 in", inner_diameter("5 in", "19.5 ppf"), mass_per_length="23.5 ppf", tool_joint=JOINT),
        Section(200.0, "6.75 in", "2.8125 in"),
    ]
    end, built = math.radians(inclination), (0.0, depth / 4, depth / 2, depth)
    hole: dict[str, Any] = {"survey": Survey(built, (0.0, 0.0, end, end), (0.0,) * 4), "friction": Coulomb(static=0.25, kinetic=0.2)}
    return DrillString.from_tables(
        pipes,
        top_inertia=JANSEN_2.inertia[0],
        top_drag=JANSEN_2.top_drag,
        bit_drag=JANSEN_2.bit_drag,
        drag_rate=0.1,
        internal_damping="5 ms",
        elements=8,
        **(hole | {"on_bottom": True, "mud_density": 1200.0} if inclination else {}),
    )


def wells() -> dict[str, TorsionalChain]:
    """The strings by label."""
    depths = (1500.0, 3000.0, 5000.0)
    found: dict[str, TorsionalChain] = {f"{depth:.0f} m": well(depth) for depth in depths}
    found |= {f"{depth:.0f} m, friction": well(depth, 30.0) for depth in depths}
    return found | {"four inertias": NAVARRO_LOPEZ_4}


def swing(chain: TorsionalChain) -> tuple[float, float]:
    """Impedance zeta [N m s/rad] and lowest frequency om [rad/s] of a string below a drive that does not turn."""
    stretch = np.diff(np.eye(len(chain.inertia)), axis=0)  # twists of turned inertias
    stiffness = (stretch.T @ np.diag(chain.stiffness) @ stretch)[1:, 1:]
    frequency = math.sqrt(eigh(stiffness, np.diag(chain.inertia[1:]), eigvals_only=True)[0])
    return 1.0 / float(np.sum(1.0 / np.array(chain.stiffness))) / frequency, frequency


def scaled(numbers: Mapping[str, float], chain: TorsionalChain) -> dict[str, Any]:
    """Numbers of a law on `JANSEN_2`, in the same parts of the impedance, the frequency and the drive of another string."""
    ratios = np.array([*swing(chain), chain.inertia[0]]) / np.array([*swing(JANSEN_2), JANSEN_2.inertia[0]])
    return {name: float(f"{value * np.prod(ratios ** np.array(POWERS.get(name, (0.0,) * 3))):.4g}") for name, value in numbers.items()}


def numbers() -> dict[str, dict[str, Any]]:
    """The gains of the drive table that are scaled, by the label of their law."""
    return {
        "LQG, between, lifting": gains.between("LQG", "LQG, lifting", BETWEEN) | {"torque_scale": TORQUE_SIZE},
        "impedance, tuned, lifting": gains.stored("impedance, lifting"),
    }


AS_THEY_ARE = ", not scaled"
"""What the label of a law ends with that has the gains of `JANSEN_2`."""
LABELS = ("LQG, between, lifting", "impedance, tuned, lifting", "soft torque, lifting", f"impedance, tuned, lifting{AS_THEY_ARE}")


class WithMargins(Trial):
    """A trial that keeps the disk margins it has found, and stops at the first machine that leaves less than `MARGIN`, the heaviest bit first."""

    def disk_margins(self, machines: Sequence[Machine], reference: float) -> tuple[float, float, str]:
        declared, found = _disk_margin(self, Machine("nominal"), reference), []
        for machine in sorted(machines, key=lambda each: "weight" not in each.name):
            found.append((_disk_margin(self, machine, reference), machine.name))
            if not found[-1][0] >= MARGIN:
                break
        return declared, *min(found)


@cache
def _disk_margin(tried: Trial, machine: Machine, reference: float) -> float:
    return disk_margin(tried.steady(machine, reference))


def trial(chain: TorsionalChain, label: str) -> Trial:
    """A law of that label on a string: "soft torque, lifting", or one of `numbers`."""
    plant, name = compose(chain, BitRock(weight=WEIGHT)), label.removesuffix(AS_THEY_ARE)
    if name in numbers():
        q = numbers()[name] if label.endswith(AS_THEY_ARE) else scaled(numbers()[name], chain)
        law: Any = LQG(delay_samples=LATE, speed_noise=NOISE, **q, **LIMITS) if name.startswith("LQG") else PI(**q, **LIMITS)
    else:
        law = SoftTorque(**LIMITS)
    return WithMargins(replace(closed_loop(plant, Sampled(Lifting(law), 0.01, DELAY)), label=label), STIFF)


def groups(tried: Trial, full: bool = False) -> list[Group]:
    """The declared well and those beside it, with few phases and one seed unless the protocol is full."""
    every = machine_groups(tried.loop, NOISE, DELAY)
    chosen = [replace(every[name], min_disk_margin=MARGIN) for name in GROUPS]
    return chosen if full else [replace(each, takeover_phases=(0.0, 0.5), seeds=each.seeds[:1]) for each in chosen]


@dataclass(frozen=True)
class Row:
    """A law on a well: its numbers, what was found for (group, way), and how it was judged."""

    well: str
    label: str
    numbers: Mapping[str, float]
    found: Mapping[tuple[str, str], SetPointLimit]
    judged: str

    def flat(self) -> dict[str, Any]:
        """The row as one level of names."""
        declared, robust = (self.found[name, "takeover"] for name in GROUPS)
        speeds = {
            f"{name} {way}": self.found[name, way].lowest_set_point for name in GROUPS for way in PROTOCOLS if (name, way) in self.found
        }
        return {
            "well": self.well, "label": self.label, **speeds,
            "disk margin": declared.disk_margin, "disk margin, one_at_a_time": robust.disk_margin, "weakest": robust.weakest_plant,
            "recovery": declared.recovery_time, "recovery, one_at_a_time": robust.recovery_time,
            "fastest, one_at_a_time": robust.max_bit_speed / robust.lowest_set_point,
            "below, nominal": declared.why, "below, one_at_a_time": robust.why,
            "gains": ", ".join(f"{name} {value:g}" for name, value in self.numbers.items()), "judged": self.judged,
        }  # fmt: skip


def row(name: str, label: str, full: bool = False, cells: Cells | None = None, ways: Sequence[str] = PROTOCOLS) -> Row:
    """The row of a law on a well."""
    chain = wells()[name]
    tried = trial(chain, label)
    law = tried.of(8.0).law
    designed = law.design(tried.plant) if isinstance(law, SoftTorque) else law
    shown = ("proportional", "integral") if isinstance(designed, PI) else (*gains.stored("LQG"), "torque_scale")
    found = borders(tried, groups(tried, full), ways, cells, LOWEST, higher=HIGHEST, lasts=full)
    return Row(name, label, {each: float(f"{getattr(designed, each):.4g}") for each in shown}, found, FULL if full else BRIEF)


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows as text."""

    def said(value: Any, form: str) -> str:
        return f"{value:{form}}" if value == value else "none"

    lines = [("well", "controller", *GROUPS, "disk margin", "recovery", "bit", "what fails below on one_at_a_time")]
    for each in rows:
        pairs = [" / ".join(said(each[f"{name} {way}"], ".1f") for way in PROTOCOLS if f"{name} {way}" in each) for name in GROUPS]
        margins = f"{said(each['disk margin'], '.2f')} / {said(each['disk margin, one_at_a_time'], '.2f')}"
        price = f"{said(each['recovery'], '.0f')} / {said(each['recovery, one_at_a_time'], '.0f')} s"
        lines.append(
            (
                each["well"],
                each["label"],
                *pairs,
                margins,
                price,
                f"{said(each['fastest, one_at_a_time'], '.1f')} x",
                each["below, one_at_a_time"],
            )
        )
    return "\n".join(columns(lines, left=(0, 1, 7)))


def known(path: Path) -> dict[tuple[str, str], dict[str, Any]]:
    """{(well, label): row} of a table that was written before; none where there is none."""
    if not path.exists():
        return {}
    texts = ("well", "label", "weakest", "below, nominal", "below, one_at_a_time", "gains", "judged")
    with path.open(encoding="utf-8", newline="") as file:
        rows = [{name: text if name in texts else float(text) for name, text in row.items()} for row in csv.DictReader(file)]
    return {(str(each["well"]), str(each["label"])): each for each in rows}


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the table, and with --out its csv."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=folder, help="folder for wells.csv and for what is known of single set-points")
    parser.add_argument("--only", nargs="+", choices=list(wells()), default=list(wells()), metavar="WELL", help=f"some of: {list(wells())}")
    parser.add_argument("--laws", nargs="+", choices=LABELS, default=list(LABELS), metavar="LABEL", help=f"some of: {list(LABELS)}")
    parser.add_argument("--full", action="store_true", help="all phases and seeds, and half an hour (hours)")
    given = parser.parse_args(arguments)
    cells = Cells(given.out / "wells.jsonl" if given.out else None, lambda line: print(line, file=sys.stderr, flush=True))
    rows = known(given.out / "wells.csv") if given.out else {}
    for label in given.controllers:
        for name in given.only:
            if rows.get((name, label), {}).get("judged") != (FULL if given.full else BRIEF):
                rows[name, label] = row(name, label, given.full, cells).flat()
            if given.out:
                write_rows(list(rows.values()), given.out / "wells.csv")
    print(table([rows[name, label] for label in given.controllers for name in given.only]))


if __name__ == "__main__":
    main()
