"""Does `onset` find the borders of wells that nobody chose?

Strings of two to four inertias, some with dry friction along them, under drives drawn by a seed: gains of a PI, soft torque, sliding modes, continuous and
sampled. Two measures that share the simulation with `onset`, but neither its growth nor its judge nor its search:

- Where stick-slip ends: a run that sticks and slips is carried outwards by a slow ramp of the set-point, by 3e-6 of the border per second where it is near;
  where its last stick ends is the border. A cycle that is lost slowly outlives its border by some 0.2 % so. Of cycles that live side by side the ramp may
  follow any.
- Where smooth running is lost: half a percent to either side of the border, a disturbance of 1e-4 of steady running must grow, or die.

    python -m studies random_wells --count 30 --seed 0        (a table; some ten minutes)
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from scipy.linalg import eigh

from controllers import PI, SlidingMode, SoftTorque, StiffPI, SuperTwisting
from models import BitRock, Exponential, TorsionalChain
from studies.command_line import parser_of
from studies.timing import timed
from toolbox import ClosedLoop, Sampled, closed_loop, compose, equilibrium, onset, simulate
from toolbox.errors import SceneError, SimulationError

RANGE = (1.0, 25.0)
"""Set-points in which borders are looked for [rad/s]."""

RATE = 3e-6
"""Of the ramps, in parts of the border per second."""

BESIDE = 0.005
"""How far beside the border of smooth running its growth is looked at, in parts."""


@dataclass(frozen=True)
class Well:
    """A string with its rock and its drive, in words and as a loop."""

    label: str
    loop: ClosedLoop
    swing: float


def well(number: int, seed: int) -> Well:
    """One of the wells of a seed; every tenth has dry friction along its string."""
    draw = np.random.default_rng((seed, number))
    n = int(draw.integers(2, 5))
    inertia = (draw.uniform(800.0, 3000.0), *draw.uniform(100.0, 700.0, n - 2), draw.uniform(150.0, 600.0))
    stiffness = tuple(draw.uniform(300.0, 1000.0, n - 1) * (n - 1))
    weight, along = draw.uniform(40e3, 160e3), number % 10 == 9
    load = weight * BitRock(weight=weight).radius
    friction: dict[str, Any] = {}
    if along:
        friction = {"friction": Exponential(static=1.0, kinetic=draw.uniform(0.6, 0.9), decay=draw.uniform(0.3, 1.0))}
        friction["friction_load"] = tuple(draw.uniform(0.0, 0.1, n - 1) * load)
    damping, drags = tuple(draw.uniform(5.0, 40.0, n - 1)), (draw.uniform(0.0, 400.0), draw.uniform(0.0, 40.0))
    chain = TorsionalChain(inertia, stiffness, damping, top_drag=drags[0], bit_drag=drags[1], **friction)
    impedance = math.sqrt(stiffness[0] / sum(1.0 / (k / stiffness[0]) for k in stiffness) * sum(inertia[1:]))
    laws = (
        PI(impedance * draw.uniform(0.5, 4.0), impedance * draw.uniform(0.2, 1.5)),
        StiffPI(),
        SoftTorque(),
        SlidingMode(),
        SuperTwisting(),
    )
    law = laws[int(draw.integers(len(laws)))]
    sampled = isinstance(law, SuperTwisting) or draw.uniform() < 0.3
    loop = closed_loop(compose(chain, BitRock(weight=weight)), law, element="bit", **({"sample_time": 0.01} if sampled else {}))
    words = f"{n} inertias, {type(law).__name__}{', 100 Hz' if sampled else ''}{', friction along' if along else ''}"
    return Well(words, loop, 2.0 * math.pi * math.sqrt(sum(inertia[1:]) * sum(1.0 / k for k in stiffness)))


def ramped(well: Well, end: float, outwards: float) -> float:
    """The set-point of the last stick of all ramps through a border, most slowly at the border itself; nan without a stick.

    One comes from rest at 0.6 of the border; the others begin at 0.9 of it, in swings of each mode of the string, so large that the bit stops.
    """
    ways = [(-0.4, None), *((-0.1, start) for start in swings(well, end * (1.0 - 0.1 * outwards)))]
    last = []
    for inside, start in ways:
        values = end * (1.0 + outwards * np.array([inside, inside, -0.01, 0.01, 0.03]))
        pace = np.array([30.0, 1.0, 10.0]) * RATE * end
        times = np.cumsum([0.0, 100.0 * well.swing, *(np.abs(np.diff(values[1:])) / pace)])
        run = simulate(well.loop.replace(inputs={"top.reference": (times, values)}, start=start or {}), times[-1])
        sticks = [event.time for event in run.events if event.element == "bit" and event.before == "stick"]
        last += [float(np.interp(sticks[-1], times, values))] if sticks else []
    return max(last, key=lambda value: value * outwards, default=math.nan)


def swings(well: Well, speed: float) -> list[dict[str, Any]]:
    """States of swings in each mode of the string, as on free ends, in which the bit swings by 1.5 and 3 times its mean speed."""
    chain = next(part for part in well.loop.plant.parts if isinstance(part, TorsionalChain))
    stretch = np.diff(-np.eye(len(chain.inertia)), axis=0)  # twists of turned inertias
    found = []
    shapes = eigh(stretch.T @ np.diag(chain.stiffness) @ stretch, np.diag(chain.inertia))[1].T[1:]
    rest = rested(well, speed)
    for shape, size in itertools.product(shapes, (1.5, 3.0)):
        found.append(rest | {"chain.speed": speed * (1.0 + size * shape / shape[-1])})
    return found


def rested(well: Well, speed: float) -> dict[str, Any]:
    """States of steady running: of the string, and of the law where it has a continuous form."""
    loop = well.loop.at("top.reference", speed)
    laws = [
        StiffPI() if isinstance(law, Sampled) and isinstance(law.law, SuperTwisting) else getattr(law, "law", law)
        for law in loop.controllers
    ]
    rest = equilibrium(closed_loop(loop.plant, *laws, inputs=loop.inputs))
    remembered = [name for name, number in loop.variable_numbers().items() if number.is_start and not loop.plant.has_signal(name)]
    return {name: rest[name] for name in (*loop.plant.states, *remembered) if name in rest}


def growth(well: Well, value: float) -> float:
    """Rate at which a disturbance of 1e-4 of steady running grows, from what is left of it after forty swings and after eighty [1/s]."""
    loop, start = well.loop.at("top.reference", value), rested(well, value)
    start["chain.speed"] = np.append(start["chain.speed"][:-1], (1.0 + 1e-4) * start["chain.speed"][-1])
    run = simulate(loop.replace(start=start), 80.0 * well.swing, accuracy=1e-9)
    sizes = [np.ptp(run.at(np.linspace(k - 10.0, k, 2001) * well.swing)["bit.speed"]) for k in (40.0, 80.0)]
    return math.log(sizes[1] / sizes[0]) / (40.0 * well.swing)


def row(well: Well) -> tuple[str, bool]:
    """The line of a well, and whether the measures agree."""
    found, took = timed(lambda: onset(well.loop.at("top.reference", 8.0), "top.reference", RANGE, num_values=9), clock=perf_counter)
    text, agree = f"{well.label:<40}{took:>7.1f} s", True
    if found.losses:
        loss = found.loss
        rates = [growth(well, loss * (1.0 + side)) for side in (-BESIDE, BESIDE)]
        right = rates[0] > 0 > rates[1] if found.losses[0].safe == "above" else rates[0] < 0 < rates[1]
        text, agree = text + f"{loss:>11.5f}{'grows and dies' if right else f'{rates[0]:.1e} {rates[1]:.1e}':>22}", right
    else:
        text += f"{'-':>11}{'':>22}"
    if found.ends:
        end = found.end
        at = ramped(well, end, 1.0 if found.ends[0].safe == "above" else -1.0)
        others = [each.high for each in found.coexisting]
        away = min(abs(at / each - 1.0) for each in (end, *others))
        text, agree = (
            text + f"{end:>11.5f}{at:>11.5f}{100 * away:>9.3f} %{f'  of {len(others)} cycles' if others else ''}",
            agree and away < 0.005,
        )
    else:
        text += f"{'-':>11}"
    return text, agree


def main() -> None:
    """Print the table and how many agree."""
    parser = parser_of(__doc__)
    parser.add_argument("--count", type=int, default=30, help="how many wells")
    parser.add_argument("--seed", type=int, default=0, help="what draws them")
    given = parser.parse_args()
    print(f"{'well and drive':<40}{'onset':>9}{'loss':>11}{'beside it':>22}{'end':>11}{'ramp':>11}{'away':>11}")
    agreed = refused = 0
    for number in range(given.count):
        one = well(number, given.seed)
        try:
            text, agree = row(one)
        except (SceneError, SimulationError) as error:
            text, agree, refused = f"{one.label:<40}{error}", False, refused + 1
        agreed += agree
        print(text + ("" if agree else "   <--"), flush=True)
    print(f"\n{agreed} of {given.count} agree, {refused} refused")


if __name__ == "__main__":
    main()
