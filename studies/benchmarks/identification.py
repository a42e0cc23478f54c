"""Do the intervals of `identify` hold? Eight kinds of recordings, and the same fit by scipy around a simulation written without the toolbox.

python -m studies identification [--seeds 10] [--kinds coast-down pulses] [--no-scipy]
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable
from typing import Any

import numpy as np

from models import Coulomb, GaussianStribeck, Joint, TwoWay, Viscous
from studies.command_line import parser_of
from toolbox import compose, identify, simulate
from toolbox.calibration import Recording

INERTIA, LEVEL, VISCOUS, OFFSET = 0.02, 0.3, 0.05, 0.05
TIME = np.arange(0.0, 3.0, 0.01)
TRUE = Joint(inertia=INERTIA, torque_offset=OFFSET, friction=Viscous(Coulomb(LEVEL, LEVEL), VISCOUS))
TRUTH = {"joint.inertia": INERTIA, "joint.torque_offset": OFFSET, "bearing.friction.dry.static": LEVEL, "bearing.friction.viscous": VISCOUS}
TWO = {
    "joint.inertia": INERTIA, "bearing.friction.forward.dry.static": 0.3, "bearing.friction.backward.dry.static": 0.45,
    "bearing.friction.forward.viscous": 0.05, "bearing.friction.backward.viscous": 0.07,
}  # fmt: skip
SPEED_NOISE, STEP = 0.02, 2e-4
"""Noise of the speed [rad/s], and step of the encoder [rad]."""


def moved(torque: np.ndarray | None, held: bool = False, joint: Any = TRUE, speed: float = 0.0) -> Any:
    """The motion of the joint under a torque at the samples."""
    plant = compose(joint)
    inputs: Any = {}
    if torque is not None:
        inputs = Recording.of({"time": TIME, "joint.torque": torque}, plant, zero_order_hold=["joint.torque"] if held else []).driving(
            plant
        )
    return simulate(plant, TIME[-1], inputs=inputs, start={"joint.speed": speed}, output_times=TIME, accuracy=1e-9)


def _log(run: Any, torque: np.ndarray | None, noise: np.ndarray) -> dict[str, np.ndarray]:
    data = {"time": TIME, "joint.speed": run["joint.speed"] + SPEED_NOISE * noise}
    return data if torque is None else {**data, "joint.torque": torque}


def _sine(random: Any) -> np.ndarray:
    found: np.ndarray = 1.2 * np.sin(5.0 * TIME + random.uniform(0.0, 6.0)) + 0.3 * np.sin(13.0 * TIME + random.uniform(0.0, 6.0))
    return found


def sine(random: Any) -> tuple[Any, dict[str, float], dict[str, Any]]:
    """A sum of two sines, speed with noise."""
    torque = _sine(random)
    return _log(moved(torque), torque, random.standard_normal(TIME.size)), TRUTH, {}


def held_commands(random: Any) -> tuple[Any, dict[str, float], dict[str, Any]]:
    """Commands of a digital drive, another one at each sample."""
    torque = _sine(random) + 0.2 * random.standard_normal(TIME.size)
    return _log(moved(torque, held=True), torque, random.standard_normal(TIME.size)), TRUTH, {}


def pulses(random: Any) -> tuple[Any, dict[str, float], dict[str, Any]]:
    """Pulses of both signs with pauses, held."""
    torque = np.repeat(random.permutation(np.tile([1.0, 0.0, -0.9, 0.0, 1.4], 4)), 15).astype(float)
    return _log(moved(torque, held=True), torque, random.standard_normal(TIME.size)), TRUTH, {"zero_order_hold": "joint.torque"}


def quantised_position(random: Any) -> tuple[Any, dict[str, float], dict[str, Any]]:
    """The position by an encoder, without noise."""
    torque = _sine(random)
    angle = moved(torque)["joint.angle"] + random.uniform(0.0, STEP)
    return {"time": TIME, "joint.torque": torque, "joint.angle": np.round(angle / STEP) * STEP}, TRUTH, {}


def both_directions(random: Any) -> tuple[Any, dict[str, float], dict[str, Any]]:
    """Friction that differs by direction."""
    torque = _sine(random)
    law = TwoWay(Viscous(Coulomb(0.3, 0.3), 0.05), Viscous(Coulomb(0.45, 0.45), 0.07))
    run = moved(torque, joint=Joint(inertia=INERTIA, friction=law))
    return _log(run, torque, random.standard_normal(TIME.size)), TWO, {"directions": True}


def coast_down(random: Any) -> tuple[Any, dict[str, float], dict[str, Any]]:
    """A coast-down without torque, of known inertia: friction is that one way, with the offset in it."""
    run = moved(None, speed=random.uniform(15.0, 25.0))
    truth = {"bearing.friction.dry.static": LEVEL + OFFSET, "bearing.friction.viscous": VISCOUS}
    stop = int(np.argmax(run["joint.speed"] <= 0.5))  # an offset does not hold where the joint rests
    data = {name: values[:stop] for name, values in _log(run, None, random.standard_normal(TIME.size)).items()}
    return data, truth, {"plant": Joint(inertia=INERTIA)}


def steady_speeds(random: Any) -> tuple[Any, dict[str, float], dict[str, Any]]:
    """Steady speeds one after another, the torque held."""
    torque = np.repeat(random.permutation([0.7, -0.8, 1.0, -1.1, 1.3]), 60)
    return _log(moved(torque, held=True), torque, random.standard_normal(TIME.size)), TRUTH, {"zero_order_hold": "joint.torque"}


def steady_points(random: Any) -> tuple[Any, dict[str, float], dict[str, Any]]:
    """A table of speed and torque, with a Stribeck curve."""
    speed = np.linspace(0.05, 3.0, 40)
    torque = 0.5 + 0.5 * np.exp(-((speed / 0.4) ** 2)) + 0.1 * speed + 0.005 * random.standard_normal(speed.size)
    law = "bearing.friction.dry."
    truth = {f"{law}static": 1.0, f"{law}kinetic": 0.5, f"{law}stribeck_speed": 0.4, "bearing.friction.viscous": 0.1}
    guess = Viscous(GaussianStribeck(0.8, 0.4, 0.6), 0.05)
    return {"joint.speed": speed, "joint.torque": torque}, truth, {"friction": guess}


KINDS: dict[str, Callable[[Any], tuple[Any, dict[str, float], dict[str, Any]]]] = {
    "sine": sine, "held commands": held_commands, "pulses": pulses, "quantised position": quantised_position, "both directions": both_directions,
    "coast-down": coast_down, "steady speeds": steady_speeds, "steady points": steady_points,
}  # fmt: skip


def coverage(kind: str, seeds: int) -> tuple[int, int, float]:
    """(intervals of 95 % that hold their number, intervals, processor time per fit [s])."""
    held = count = 0
    spent = 0.0
    for seed in range(seeds):
        data, truth, options = KINDS[kind](np.random.default_rng(seed))
        began = clock.process_time()
        found = identify(data, **{"plant": "Joint", **options})
        spent += clock.process_time() - began
        for name, value in truth.items():
            low, high = found.interval(name) if name in found.names else (math.inf, -math.inf)
            held += low <= value <= high
            count += 1
    return held, count, spent / seeds


def exact(numbers: np.ndarray, torque: np.ndarray, speed: float) -> np.ndarray:
    """Speed of a joint under held torque by closed forms, without the toolbox: exponentials in slip, exact stops, exact rest."""
    inertia, offset, level, viscous = numbers
    step, found, v = TIME[1] - TIME[0], np.empty(TIME.size), speed
    for k, drive in enumerate(torque.tolist()):
        found[k] = v
        left = step
        while left > 0.0:
            side = math.copysign(1.0, v) if v else (math.copysign(1.0, drive - offset) if abs(drive - offset) > level else 0.0)
            if not side:
                break
            end = (drive - offset - side * level) / viscous
            stop = inertia / viscous * math.log(1.0 - v / end) if v and v / end < 0.0 else math.inf
            slid = min(stop, left)
            v = 0.0 if stop <= left else end + (v - end) * math.exp(-viscous / inertia * slid)
            left -= slid
    return found


def beside_scipy() -> list[str]:
    """The same numbers by `scipy.optimize.least_squares` around the closed form, of three machines."""
    from scipy.optimize import least_squares

    lines = ["", "machine          largest difference / half-width   time, identify / scipy"]
    for label, numbers in (
        ("light joint", (0.005, 0.02, 0.1, 0.02)),
        ("joint", (0.02, 0.05, 0.3, 0.05)),
        ("heavy joint", (0.2, -0.4, 2.0, 0.1)),
    ):
        inertia, offset, level, viscous = numbers
        random = np.random.default_rng(3)
        torque = np.repeat(random.uniform(-4.0, 4.0, 60) * level, 5)
        data = {"time": TIME, "joint.torque": torque,
                "joint.speed": exact(np.array(numbers), torque, 0.0) + SPEED_NOISE * random.standard_normal(TIME.size)}  # fmt: skip
        identify(data, "Joint", zero_order_hold="joint.torque")  # compiles
        began = clock.process_time()
        found = identify(data, "Joint", zero_order_hold="joint.torque")
        own = clock.process_time() - began

        def left(z: np.ndarray, data: Any = data, torque: np.ndarray = torque) -> np.ndarray:
            return exact(z[:4], torque, float(z[4])) - data["joint.speed"]

        start = np.array([inertia * 1.3, offset + 0.1 * level, 0.8 * level, 0.7 * viscous, 0.0])
        began = clock.process_time()
        other = least_squares(left, start, x_scale=np.array([inertia, level, level, viscous, 1.0]), xtol=1e-12, ftol=1e-12).x
        theirs = clock.process_time() - began
        half = [0.5 * (found.interval(name)[1] - found.interval(name)[0]) for name in TRUTH]
        apart = max(abs(found[name] - value) / width for name, value, width in zip(TRUTH, other[:4], half, strict=True))
        lines.append(f"{label:<16} {apart:>31.3f}   {own / theirs:>22.2f}")
    return lines


def main() -> None:
    """Print coverage of each kind, and the comparison."""
    given = parser_of(__doc__)
    given.add_argument("--seeds", type=int, default=10, help="recordings of each kind (10)")
    given.add_argument("--kinds", nargs="*", choices=list(KINDS), default=list(KINDS), help="kinds of recordings (all)")
    given.add_argument("--no-scipy", action="store_true", help="without the comparison")
    options = given.parse_args()
    print("kind of recording     numbers held   coverage   processor time of a fit [s]", flush=True)
    for kind in options.kinds:
        held, count, spent = coverage(kind, options.seeds)
        print(f"{kind:<20} {held:>6} of {count:<5} {held / count:>9.3f}   {spent:>8.2f}", flush=True)
    if not options.no_scipy:
        print("\n".join(beside_scipy()))


if __name__ == "__main__":
    main()
