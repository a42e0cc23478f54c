"""Published measurements of friction, identified again: which numbers come back, and which do not?

The recordings are made here from the published numbers by closed forms, without the toolbox, because the measured ones are not ours to ship.

    EMPS    electro-mechanical positioning system: A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, Workshop on Nonlinear System
            Identification Benchmarks, 2019: 95.1089 kg, 203.5034 N s/m, 20.3935 N, -3.1648 N; 35.15 N/V, position loop at 1 kHz
    PUMA    motors of a PUMA 560: P. I. Corke, B. Armstrong-Helouvry, A search for consensus among model parameters reported for the PUMA 560 robot, IEEE
            Int. Conf. Robotics and Automation (1994) 1608-1613; as in the Robotics Toolbox of P. I. Corke: inertia, viscous and Coulomb friction each way
    TX40    joint 1 of a Staubli TX40: repository thanhndv212/figaroh-examples, example `staubli_tx40` of FIGAROH: drive inertia, viscous and Coulomb friction,
            offset
    MX-64   servo Dynamixel MX-64, and MX-106: M. Duclusaud, G. Passault, V. Padois, O. Ly, Extended friction models for the physics simulation of servo
            actuators, arXiv 2410.08650; numbers of the repository Rhoban/bam: models M1 (Coulomb), M2 (Stribeck) and M3 (load)
    Panda   joint 1 of a Franka Emika Panda: C. Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano, A. De Luca, IEEE Robotics and Automation Letters 4 (2019)
            4147-4154: a sigmoid of the speed; numbers of the repository marcocognetti/FrankaEmikaPandaDynModel
    LuGre   steady friction of the example of C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, IEEE Trans. Automatic Control 40 (1995) 419-425:
            1.5 N, 1 N, 1 mm/s, 0.4 N s/m
    bench   steady points of a test bench: repository PaulHaacker/LuGre-Identification: 20 N, 5 N, 0.07 m/s, 35 N s/m
    valve   stem of a control valve: A. Kayihan, F. J. Doyle III, Control Eng. Practice 8 (2000) 799-812, as in M. A. A. S. Choudhury, N. F. Thornhill, S. L.
            Shah, Control Eng. Practice 13 (2005) 641-658: 384 lbf, 320 lbf, 0.01 in/s, 3.5 lbf s/in

    python -m studies measured_cases [--shift]        (--shift: EMPS with a free shift of the force, too)
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
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


TX40 = 0.362, 8.05, 7.14, 0.392
"""Inertia of the drive [kg m2], viscous friction [N m s/rad], Coulomb friction and offset [N m] of joint 1."""

MX64, MX64_STRIBECK = (0.0119512, 0.0116916, 0.0903868), (0.1379834, 0.0561193, 1.1202510, 0.0191808)
"""Inertia, viscous and Coulomb friction of M1; static and kinetic friction, Stribeck speed and viscous friction of M2, whose exponent is 3."""

MX106 = 0.0248469, 0.0119445, 0.1133533, 0.1082404
"""Inertia, viscous and Coulomb friction of M3, and friction for each N m of transmitted torque."""

PANDA = 0.54615, 5.1181, 0.039533
"""Height [N m], slope [s/rad] and shift [rad/s] of the sigmoid of joint 1."""

LBF = 4.4482216152605
VALVE = 384.0 * LBF, 320.0 * LBF, 0.01 * 0.0254, 3.5 * LBF / 0.0254
"""Static and kinetic friction [N], Stribeck speed [m/s] and viscous friction [N s/m] of the stem."""

NOISE = 2e-3
"""Noise of the force at steady points, as a fraction of the largest force."""


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


def turned(
    body: Any, torque: np.ndarray, step: float, encoder: float, load: np.ndarray | None = None, share: float = 0.0, offset: float = 0.0
) -> dict[str, np.ndarray]:
    """Time, torque, load and angle of a joint under held torques, by an encoder. body: inertia, viscous, level; share: level for each N m of load."""
    inertia, viscous, level = body
    angle, x, v = np.empty(torque.size), 0.0, 0.0
    for k, drive in enumerate(torque.tolist()):
        angle[k] = round(x / encoder) * encoder
        bound = level + (0.0 if load is None else share * abs(float(load[k])))
        x, v = moved(x, v, drive - offset, step, (inertia, viscous, bound, bound))
    found = {"time": step * np.arange(torque.size), "joint.torque": torque, "joint.angle": angle}
    return found if load is None else {**found, "joint.load": load}


def two_sines(size: float, step: float, seconds: float) -> np.ndarray:
    """A torque of two sines."""
    time = np.arange(0.0, seconds, step)
    found: np.ndarray = size * (0.8 * np.sin(5.0 * time) + 0.2 * np.sin(23.0 * time))
    return found


def steady(speed: np.ndarray, friction: np.ndarray, part: str = "joint", seed: int = 0) -> dict[str, np.ndarray]:
    """Steady points with noise."""
    noise = NOISE * float(np.abs(friction).max()) * np.random.default_rng(seed).standard_normal(speed.size)
    return {f"{part}.speed": speed, f"{part}.{'torque' if part == 'joint' else 'force'}": friction + noise}


def stribeck(speed: np.ndarray, law: Sequence[float], exponent: float = 2.0) -> np.ndarray:
    """Friction over positive speeds. law: static, kinetic, Stribeck speed, viscous."""
    static, kinetic, scale, viscous = law
    found: np.ndarray = kinetic + (static - kinetic) * np.exp(-((speed / scale) ** exponent)) + viscous * speed
    return found


def sigmoid(speed: np.ndarray) -> np.ndarray:
    """Friction of a joint of the Panda over its speed."""
    height, slope, shift = PANDA
    found: np.ndarray = height / (1.0 + np.exp(-slope * (speed + shift))) - height / (1.0 + np.exp(-slope * shift))
    return found


@dataclass(frozen=True)
class Case:
    """data and options: arguments of `identify`;  truth: {number: published value};  curve: published friction over speed, if it is another law."""

    data: Mapping[str, np.ndarray]
    truth: Mapping[str, float]
    options: Mapping[str, Any]
    curve: Callable[[np.ndarray], np.ndarray] | None = None


def _of_law(contact: str, law: Sequence[float]) -> dict[str, float]:
    """{number: value} of a Stribeck law with viscous friction."""
    names = "dry.static", "dry.kinetic", "dry.stribeck_speed", "viscous"
    return {f"{contact}.friction.{name}": value for name, value in zip(names, law, strict=True)}


def cases() -> dict[str, Case]:
    """{label: case}."""
    rail, bearing, held = "rail.friction.", "bearing.friction.", {"plant": "Joint", "zero_order_hold": "joint.torque"}
    found = {
        "EMPS": Case(emps(), {"axis.mass": MASS, f"{rail}viscous": VISCOUS, f"{rail}dry.static": LEVEL, "axis.force_offset": OFFSET}, {})
    }
    for label, (inertia, viscous, ahead, back) in PUMA.items():
        truth = {"joint.inertia": inertia, f"{bearing}forward.dry.static": ahead, f"{bearing}backward.dry.static": back,
                 f"{bearing}forward.viscous": viscous, f"{bearing}backward.viscous": viscous}  # fmt: skip
        found[label] = Case(puma(inertia, viscous, ahead, back), truth, {**held, "directions": True})
    names = "joint.inertia", f"{bearing}viscous", f"{bearing}dry.static", "joint.torque_offset"
    log = turned(TX40[:3], two_sines(30.0, 2e-3, 4.0), 2e-3, 2e-5, offset=TX40[3])
    found["TX40, joint 1"] = Case(log, dict(zip(names, TX40, strict=True)), held)
    step = 2.0 * math.pi / 4096.0
    log = turned(MX64, two_sines(0.3, 5e-3, 6.0), 5e-3, step)
    found["MX-64, M1"] = Case(log, dict(zip(names, (*MX64, 0.0), strict=True)), held)
    load = 2.0 + 2.0 * np.sin(0.9 * 5e-3 * np.arange(1200))
    log = turned(MX106[:3], two_sines(1.5, 5e-3, 6.0), 5e-3, step, load, MX106[3])
    truth = {**dict(zip(names, (*MX106[:3], 0.0), strict=True)), "joint.load_sensitivity": MX106[3] / MX106[2]}
    columns = {name: name for name in log}
    found["MX-106, M3"] = Case(log, truth, {"plant": "Joint", "zero_order_hold": ["joint.torque", "joint.load"], "columns": columns})
    speed = np.geomspace(0.05, 6.0, 40)
    found["MX-64, M2"] = Case(steady(speed, stribeck(speed, MX64_STRIBECK, 3.0)), _of_law("bearing", MX64_STRIBECK), {"plant": "Joint"},
                              lambda v: stribeck(v, MX64_STRIBECK, 3.0))  # fmt: skip
    both = np.concatenate([-np.geomspace(0.02, 2.0, 30)[::-1], np.geomspace(0.02, 2.0, 30)])
    found["Panda, joint 1"] = Case(steady(both, sigmoid(both)), {}, {"plant": "Joint", "directions": True}, sigmoid)
    speed = np.geomspace(1e-4, 0.02, 25)
    law: Sequence[float] = (1.5, 1.0, 1e-3, 0.4)
    found["LuGre, steady"] = Case(steady(speed, stribeck(speed, law), "axis"), _of_law("rail", law), {})
    speed, law = np.linspace(0.005, 0.6, 21), (20.0, 5.0, 0.07, 35.0)
    found["test bench"] = Case(steady(speed, stribeck(speed, law), "axis"), _of_law("rail", law), {})
    speed = np.geomspace(2e-5, 0.01, 40)
    found["control valve"] = Case(steady(speed, stribeck(speed, VALVE), "axis"), _of_law("rail", VALVE), {})
    return found


def report(label: str, case: Case, **options: Any) -> None:
    """Print the numbers that were published and found, and what the data do not tell."""
    began = clock.process_time()
    found = identify(case.data, **{**case.options, **options})
    spent = clock.process_time() - began
    for name, value in case.truth.items():
        low, high = found.interval(name) if name in found.names else (math.nan, math.nan)
        print(f"{label:<18} {name:<36} {value:>10.6g}   {low:.8g} .. {high:.8g}{'' if low <= value <= high else '   NOT held'}")
    for name in sorted({*found.names} - {*case.truth}):
        if name.endswith("]"):
            continue  # the state at the begin of a run was not published
        low, high = found.interval(name)
        print(f"{label:<18} {name:<36} {'-':>10}   {low:.8g} .. {high:.8g}")
    if case.curve is not None:
        speed, middle = found.curve[:2]
        seen = np.abs(speed) >= np.abs(found.points[0]).min()
        away = np.abs(middle[seen] - case.curve(speed[seen])).max() / np.abs(case.curve(speed)).max()
        print(f"{label:<18} largest difference of the curves, as a fraction of the largest friction: {away:.3f}")
    for left in found.residuals:
        print(f"{label:<18} residual of {left.signal}: {100.0 * left.part:.2g} % of its range, white p = {left.whiteness:.2g}")
    for name, why in found.untold.items():
        print(f"{label:<18} {name}: {why}")
    print(f"{label:<18} {spent:.1f} s of processor time", flush=True)


def main() -> None:
    """Print each case."""
    given = parser_of(__doc__)
    given.add_argument("--shift", action="store_true", help="EMPS with a free shift of the force, too")
    options = given.parse_args()
    print(f"{'case':<18} {'number':<36} {'published':>10}   interval of 95 %")
    for label, case in cases().items():
        report(label, case)
    if options.shift:
        report("EMPS, free shift", cases()["EMPS"], delayed_signals="axis.force")


if __name__ == "__main__":
    main()
