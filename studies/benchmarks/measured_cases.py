"""Published measurements of friction, identified again: which numbers come back, and which do not?

The recordings are made here from the published numbers by closed forms, without the toolbox, because the measured ones are not ours to ship.

    EMPS    electro-mechanical positioning system: A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, Workshop on Nonlinear System
            Identification Benchmarks, 2019: 95.1089 kg, 203.5034 N s/m, 20.3935 N, -3.1648 N; 35.15 N/V, position loop at 1 kHz
    PUMA    motors of a PUMA 560: P. I. Corke, B. Armstrong-Helouvry, A search for consensus among model parameters reported for the PUMA 560 robot, IEEE
            Int. Conf. Robotics and Automation (1994) 1608-1613; as in the Robotics Toolbox of P. I. Corke: inertia, viscous and Coulomb friction each way
    LuGre   steady friction of the example of C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, IEEE Trans. Automatic Control 40 (1995) 419-425:
            1.5 N, 1 N, 1 mm/s, 0.4 N s/m

    python -m studies measured_cases
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from studies.command_line import parser_of
from toolbox import identify

MASS, VISCOUS, LEVEL, OFFSET = 95.1089, 203.5034, 20.3935, -3.1648
"""Published numbers of EMPS [kg, N s/m, N, N]."""

GAIN, POSITION_GAIN, SPEED_GAIN, STEP = 35.15065188248547, 160.18, 243.45, 1e-3
"""Its amplifier [N/V], gains of its loop, and its sample time [s]."""

PUMA = {"PUMA 560, motor 1": (200e-6, 1.48e-3, 0.435, 0.395), "PUMA 560, motor 2": (200e-6, 0.817e-3, 0.071, 0.126),
        "PUMA 560, motor 3": (200e-6, 1.38e-3, 0.105, 0.132)}  # fmt: skip
"""Inertia [kg m2], viscous friction [N m s/rad], Coulomb friction forwards and backwards [N m] of three motors."""


def moved(x: float, v: float, force: float, duration: float, body: Any = (MASS, VISCOUS, LEVEL, LEVEL)) -> tuple[float, float]:
    """(position, speed) after a time of constant force: exponentials in slip, exact stops and exact rest. body: mass, viscous, level each way."""
    mass, viscous, ahead, back = body
    while duration > 0.0:
        from_rest = 1.0 if force > ahead else -1.0 if force < -back else 0.0
        side = math.copysign(1.0, v) if v else from_rest
        if not side:
            return x, 0.0
        end, rate = (force - (ahead if side > 0.0 else -back)) / viscous, viscous / mass
        stop = math.log(1.0 - v / end) / rate if v and v / end < 0.0 else math.inf
        slid = min(stop, duration)
        fall = -math.expm1(-rate * slid)
        x, v = x + end * slid + (v - end) * fall / rate, 0.0 if stop <= duration else v + (end - v) * fall
        duration -= slid
    return x, v


def emps(seconds: float = 6.0) -> dict[str, np.ndarray]:
    """Time, force and position of EMPS in its loop on a trapezoidal speed profile: encoder of 50 nm, commands held for 1 ms."""
    count = round(seconds / STEP)
    time = np.arange(count) * STEP
    wanted = np.cumsum(0.11 * np.clip(3.0 * np.sin(2.0 * np.pi * time / 3.1), -1.0, 1.0)) * STEP
    x = v = before = last = 0.0
    position, force = np.empty(count), np.empty(count)
    for k in range(count):
        position[k] = seen = round(x / 5e-8) * 5e-8
        middle = 0.5 * (seen + before)
        volts = SPEED_GAIN * (POSITION_GAIN * (wanted[k] - seen) - (middle - last) / STEP)
        before, last, force[k] = seen, middle, GAIN * min(max(volts, -10.0), 10.0)
        x, v = moved(x, v, force[k] - OFFSET, STEP)
    return {"time": time, "axis.force": force, "axis.position": position}


def puma(inertia: float, viscous: float, ahead: float, back: float, seed: int = 0) -> dict[str, np.ndarray]:
    """Time, torque and speed of a motor under held torques of a sine, 200 Hz for 4 s, noise of 0.1 rad/s."""
    time = np.arange(0.0, 4.0, 0.005)
    torque = (1.6 * np.sin(5.0 * time) + 0.4 * np.sin(23.0 * time)) * max(ahead, back)
    speed, v = np.empty(time.size), 0.0
    for k, drive in enumerate(torque.tolist()):
        speed[k] = v
        _, v = moved(0.0, v, drive, 0.005, (inertia, viscous, ahead, back))
    return {"time": time, "joint.torque": torque, "joint.speed": speed + 0.1 * np.random.default_rng(seed).standard_normal(time.size)}


def steady() -> dict[str, np.ndarray]:
    """Steady points of the LuGre example, 0.1 mm/s to 20 mm/s."""
    speed = np.geomspace(1e-4, 0.02, 25)
    return {"axis.speed": speed, "axis.force": 1.0 + 0.5 * np.exp(-((speed / 1e-3) ** 2)) + 0.4 * speed}


def cases() -> dict[str, tuple[Any, Mapping[str, float]]]:
    """{case: (what is identified, {number: published value})}."""
    rail, bearing = "rail.friction.", "bearing.friction."
    found: dict[str, tuple[Any, Mapping[str, float]]] = {
        "EMPS": (
            identify(emps()),
            {"axis.mass": MASS, f"{rail}viscous": VISCOUS, f"{rail}dry.static": LEVEL, "axis.force_offset": OFFSET},
        )
    }
    for label, (inertia, viscous, ahead, back) in PUMA.items():
        one = identify(puma(inertia, viscous, ahead, back), "Joint", directions=True, zero_order_hold="joint.torque")
        truth = {"joint.inertia": inertia, f"{bearing}forward.dry.static": ahead, f"{bearing}backward.dry.static": back,
                 f"{bearing}forward.viscous": viscous, f"{bearing}backward.viscous": viscous}  # fmt: skip
        found[label] = one, truth
    truth = {f"{rail}dry.static": 1.5, f"{rail}dry.kinetic": 1.0, f"{rail}dry.speed": 1e-3, f"{rail}viscous": 0.4}
    found["LuGre, steady"] = identify(steady()), truth
    return found


def main() -> None:
    """Print the table."""
    parser_of(__doc__).parse_args()
    print(f"{'case':<18} {'number':<36} {'published':>10}   found")
    for label, (found, truth) in cases().items():
        for name, value in truth.items():
            low, high = found.interval(name) if name in found.names else (math.nan, math.nan)
            print(f"{label:<18} {name:<36} {value:>10.6g}   {low:.6g} .. {high:.6g}{'' if low <= value <= high else '   NOT held'}")
        for name, why in found.untold.items():
            print(f"{label:<18} {name}: {why}")


if __name__ == "__main__":
    main()
