"""Every kind of number with every verb, on a block on a belt with a damper: the verb takes it, or refuses it with a sentence that is true.

The whole table is walked. Cells that take more than a few seconds (borders by runs) stand among the slow tests; every refusal is quick.
"""

from __future__ import annotations

import ast
import functools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import toolbox
from models import BlockOnBelt
from toolbox import (
    Controller,
    Equations,
    Quantity,
    Sampled,
    Scene,
    SceneError,
    Update,
    closed_loop,
    compose,
    follow,
    hopf_curve,
    hopf_points,
    limit_cycle,
    onset,
    quantity,
    severity_map,
    state,
    sweep,
    tune,
    worst_case,
)
from toolbox.inputs import sine
from toolbox.measuring import metrics
from toolbox.modelling import OptionalQuantity, number_kinds
from toolbox.page.controls import controls_of
from toolbox.page.setting import Setting
from toolbox.probability import chance
from toolbox.steady_states import pole_locus

BELT = compose(BlockOnBelt())


@dataclass(frozen=True)
class Damper(Controller):
    """u = -gain v, gain = 0.3 N s/m times a factor that the design alone knows; sampled, it remembers the last speed."""

    measured_signals = ("block.speed",)
    actuated_signals = ("block.force",)
    factor: Quantity = quantity(1.0, "1", "gain as a multiple of 0.3 N s/m", above=0)
    gain: OptionalQuantity = quantity(None, "N s/m", "gain")

    def design(self, plant):
        return replace(self, gain=0.3 * self.factor)

    def continuous(self, signal):
        return Equations(outputs={"block.force": (-self.gain * signal("block.speed", "m/s"), "N")})

    def sampled(self, signal, period):
        last, speed = state("damper.last", "m/s"), signal("block.speed", "m/s")
        return Update({last: speed}, {"block.force": (-self.gain * speed, "N")})


SENSORS = {"noise": {"block.speed": 1e-4}, "resolution": {"block.speed": 1e-4}}
MOVED = {"block.position": 1.2}
CONTINUOUS = closed_loop(BELT, Damper(), start=MOVED)
SAMPLED = closed_loop(BELT, Sampled(Damper(), 0.5, delay=0.1), start=MOVED)
SENSED = closed_loop(BELT, Sampled(Damper(), 0.5, **SENSORS), start=MOVED)
LATE = closed_loop(BELT, Sampled(Damper(), 0.5, jitter=0.05, missed_samples=0.05), start=MOVED)
SHAPED = closed_loop(
    BELT, Damper(), inputs={"block.load": sine(1.0, 0.1, 0.05)}, parameters={"block.belt_speed": 2.0}, start={"block.position": 0.14}
)
TABLED = closed_loop(BELT, Damper(), inputs={"block.attachment": ([0.0, 1.0], [0.0, 0.1])}, start=MOVED)

NUMBERS = {
    "input": (CONTINUOUS, "block.load", (0.95, 1.05)),
    "parameter": (CONTINUOUS, "block.belt_speed", (0.2, 0.6)),
    "parameter of a controller": (CONTINUOUS, "damper.gain", (0.25, 0.35)),
    "design": (CONTINUOUS, "damper.factor", (0.9, 1.1)),
    "sample time": (SAMPLED, "damper.sample_time", (0.4, 0.6)),
    "delay": (SAMPLED, "damper.delay", (0.0, 0.2)),
    "jitter": (LATE, "damper.jitter", (0.02, 0.06)),
    "missed samples": (LATE, "damper.missed_samples", (0.02, 0.3)),
    "noise": (SENSED, "damper.sensors.noise.0", (1e-4, 2e-4)),
    "resolution": (SENSED, "damper.sensors.resolution.0", (1e-4, 2e-4)),
    "shape": (SHAPED, "block.load.amplitude", (0.08, 0.12)),
    "node": (TABLED, "block.attachment.values.1", (0.08, 0.12)),
    "start": (CONTINUOUS, "block.position", (1.1, 1.3)),
}
"""{kind: (loop, name of a number of that kind, two values)}."""


@functools.cache
def cycle_of(kind: str) -> Any:
    """The cycle of stick-slip of the loop of a kind."""
    return limit_cycle(NUMBERS[kind][0], "60 s")


def tuned(loop: Any, name: str, values: tuple[float, float]) -> Any:
    scene = Scene.of(BELT, 2.0, {"damper": loop.controllers[0]}, inputs=dict(loop.inputs))
    return tune(scene, "damper", lambda run: float(run["block.position"][-1]), {name: values}, runs=10)


def explored(loop: Any, name: str, values: tuple[float, float]) -> Any:
    """The loop that the page of `stickslip explore` runs when its slider stands at another value."""
    [control] = [each for each in controls_of(loop, {}) if each.number.name == name]
    found, unknown = Setting("damper", {control.number.name: values[1]}).loop(loop)
    assert not unknown and found.number(name).value == pytest.approx(values[1]) != loop.number(name).value
    return found


VERBS = {
    "onset": lambda kind, loop, name, values: onset(loop, name, values, num_values=3, duration=60.0, accuracy=1e-4),
    "severity_map": lambda kind, loop, name, values: severity_map(loop, {name: values, "block.mass": (0.9, 1.1)}, shape=(2, 2), halvings=0),
    "sweep": lambda kind, loop, name, values: sweep(loop, {name: values}, 1.0, metrics={"end": metrics.final("block.position")}),
    "follow": lambda kind, loop, name, values: follow(cycle_of(kind), name, values, points=2),
    "hopf_points": lambda kind, loop, name, values: hopf_points(loop, name, values, num_values=2),
    "hopf_curve": lambda kind, loop, name, values: hopf_curve(loop, "block.belt_speed", (0.1, 1.0), name, values[:1]),
    "pole_locus": lambda kind, loop, name, values: pole_locus(loop, name, values),
    "worst_case": lambda kind, loop, name, values: worst_case(loop, 20.0, uncertainty={name: 1.01}, starts=[MOVED]),
    "chance": lambda kind, loop, name, values: chance(loop, {name: values}, {"block.mass": "1 kg +- 0.01 kg"}, draws=2, duration=200.0),
    "tune": lambda kind, loop, name, values: tuned(loop, name, values),
    "explore": lambda kind, loop, name, values: explored(loop, name, values),
}

DESIGN = "only the design of a controller uses it, so the equations of the loop have no derivative by it"
NOISE = "it is the noise of a sensor, which has no influence on smooth running and cycles, because they are computed without noise: vary it with `sweep`"
STEPS = "it is the step of an encoder, by which the equations of the loop have no derivative"
SHAPE = "it shapes an input in time, and steady running has constant inputs"
NODE = "it is a number of a table in time, by which no derivative is computed"
START = "it is a start value, which has no influence on steady running and cycles: vary it with `sweep`"
LATENESS = "it is jitter, with which a loop has no poles"
MISSES = "it is a probability of missed samples, with which a loop has no poles"
NO_PERIOD = "`jitter` and `missed_samples` must be left out"
MOVING = "must be a number for an onset to exist, but the loop varies it in time"
TABLE = "`block.attachment` is a table, which is the same in all runs"
GAINS = "must hold gains of the controller that is tuned"
NO_SLOPE = {"design": DESIGN, "noise": NOISE, "resolution": STEPS, "shape": SHAPE, "node": NODE, "start": START}

REFUSED: dict[str, dict[str, str]] = {
    "onset": {"design": DESIGN, "jitter": LATENESS, "missed samples": MISSES, "shape": MOVING, "node": MOVING, "start": START},
    "severity_map": {"design": DESIGN, "jitter": LATENESS, "missed samples": MISSES, "shape": SHAPE, "node": NODE, "start": START},
    "sweep": {"node": TABLE},
    "follow": {
        "design": DESIGN, "start": START, "node": "must be constant, a sine or an expression of time in a periodic motion, but it is a table",
        **dict.fromkeys(("jitter", "missed samples"), NO_PERIOD), **dict.fromkeys(("noise", "resolution"), "encoder"),
        **dict.fromkeys(("sample time", "delay"), "must act continuously for a free cycle"),
    },
    "hopf_points": NO_SLOPE | dict.fromkeys(("jitter", "missed samples"), NO_PERIOD),
    "hopf_curve": NO_SLOPE | dict.fromkeys(("jitter", "missed samples"), NO_PERIOD),
    "pole_locus": NO_SLOPE | dict.fromkeys(("jitter", "missed samples"), NO_PERIOD),
    "worst_case": {"node": TABLE, "start": "it is a start value: give `starts`"},
    "chance": {"node": TABLE},
    "tune": {
        **dict.fromkeys(("input", "parameter", "start"), f"{GAINS}.*it is none of them: vary it by `sweep`"),
        **dict.fromkeys(("shape", "node"), f"{GAINS}.*it is none of them"),
        **dict.fromkeys(("sample time", "delay", "jitter", "missed samples", "noise", "resolution"), f"{GAINS}.*hardware.*vary it by `sweep`"),
    },
    "explore": {},
}  # fmt: skip
"""{verb: {kind: words of the sentence that refuses it}}; every other pair is taken."""

SLOW = {"onset", "severity_map"}
PAIRS = [
    pytest.param(verb, kind, marks=pytest.mark.slow) if verb in SLOW and kind not in REFUSED[verb] else (verb, kind)
    for verb in VERBS
    for kind in NUMBERS
]


def test_the_table_has_every_kind():
    known = {str(kind) for kind in vars(number_kinds).values() if isinstance(kind, number_kinds.NumberKind)} - {"shift"}  # of a fit alone
    assert {str(loop.number(name).kind) for loop, name, _ in NUMBERS.values()} == known
    assert {kind.removesuffix(" of a controller") for kind in NUMBERS} == known
    assert all(words.keys() <= NUMBERS.keys() for words in REFUSED.values()) and REFUSED.keys() == VERBS.keys()


@pytest.mark.parametrize(("verb", "kind"), PAIRS)
def test_a_verb_takes_a_kind_or_says_why_not(verb, kind):
    loop, name, values = NUMBERS[kind]
    words = REFUSED[verb].get(kind)
    if words is None:
        assert VERBS[verb](kind, loop, name, values) is not None
    else:
        with pytest.raises(SceneError, match=words):
            VERBS[verb](kind, loop, name, values)


def test_what_a_sweep_takes_changes_the_run():
    """Each kind acts: the block ends elsewhere with the other value."""
    for kind, (loop, name, values) in NUMBERS.items():
        ends = [float(toolbox.simulate(loop.at(name, value), 8.0, accuracy=1e-10).states[-1, 0]) for value in values]
        assert np.ptp(ends) > 1e-9, kind


FOLDERS = ("toolbox", "models", "controllers")
HOME = Path("toolbox", "modelling", "number_kinds.py")


def comparisons_with_kinds():
    """Places outside `number_kinds.py` that compare with a kind of number: by its object, by its class, or by its word.

    Counted are comparisons (`==`, `!=`, `is`, `in`) and cases of `match` in which a name of a kind that the file imports from `number_kinds` stands, or
    `<number>.kind` or `str(<number>.kind)` beside the word of a kind.
    """
    words = {str(kind) for kind in vars(number_kinds).values() if isinstance(kind, number_kinds.NumberKind)}
    objects = {name for name, kind in vars(number_kinds).items() if isinstance(kind, number_kinds.NumberKind)}
    root, found = Path(toolbox.__file__).parents[1], []
    for path in (path for folder in FOLDERS for path in (root / folder).rglob("*.py")):
        if path == root / HOME:
            continue
        text = path.read_text(encoding="utf-8")
        if "number_kinds" not in text and ".kind" not in text:
            continue
        tree = ast.parse(text)
        for node in ast.walk(tree):
            if isinstance(node, (ast.Compare, ast.match_case)):
                inside = [*ast.walk(node)] if isinstance(node, ast.Compare) else [*ast.walk(node.pattern)]
                texts = {each.value for each in inside if isinstance(each, ast.Constant)}
                names = {each.id for each in inside if isinstance(each, ast.Name)} | {
                    each.attr for each in inside if isinstance(each, ast.Attribute)
                }
                if (names & objects and "number_kinds" in path.read_text(encoding="utf-8")) or (
                    "kind" in names and texts & words and "number" in names
                ):
                    found.append((str(path.relative_to(root)), node.lineno))
    return found


def test_nothing_compares_with_a_kind_outside_its_file():
    assert comparisons_with_kinds() == []
