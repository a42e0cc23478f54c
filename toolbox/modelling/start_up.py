"""The speed at the top of a string whose bit breaks free, is caught at the final speed, and swings no more.

Bit of the inertia J at the end of a spring of the stiffness k, with the torque F(y) = kinetic + (static - kinetic) exp(-decay y) of the rock and a drag c,
at the speed y; top at the speed w:

    J y' = T - F(y) - c y,   T = k z + d z',   z' = w - y

The string is flat: a motion of the bit gives the torque T = J y' + F(y) + c y and, without the damper d, the speed of the top w = y + T' / k (M. Fliess,
J. Levine, P. Martin, P. Rouchon, Int. J. Control 61 (1995) 1327-1361). The motion has three parts:

1. wind-up: y = 0, and T rises to F(0); w rises to the speed W within half of the time, and stays there;
2. release: w = W, and y is the motion of the bit itself, up to the speed at which the rock's torque has fallen by 95 %;
3. catch: y is a polynomial of the fifth degree to the final speed, with the speed, acceleration and jerk of the release at its beginning, and neither
   acceleration nor jerk at its end. There T = F + c y, and top and bit turn alike.

Why the bit lets go by itself: rock whose torque falls with speed makes every slow motion of the bit unstable, J lambda = -F'(0), so that an error of the
drive grows by exp(lambda t) while the bit is slow. No top that is told its speed holds the bit on a slow motion; the release lasts as short as it can.

A PI drive of the inertia I and the drag d follows w if it has the torque U = I w' + d w + T: the set-point is w + e with proportional e + integral of e = U,
as much earlier as the commands come late.

The idea, to move the string from rest to its final speed by a planned motion: U. J. F. Aarsnes, F. Di Meglio, R. J. Shor, J. Process Control 70 (2018)
24-35, there for a distributed string. Motion and formulas are this toolbox's, for a string of one spring.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

STEP, COARSE = 1e-3, 20
"""Step of the motion [s], and how many of them lie between two nodes of the set-point."""

FALLEN = 3.0
"""Speed at which the bit is caught, times the decay of the rock's torque: exp(-3) = 5 % are left."""


class Motion(NamedTuple):
    """A planned motion at even steps from 0 on: speed of the bit, speed of the top [rad/s], torque of the string [N m], each of shape (n,)."""

    bit: np.ndarray
    top: np.ndarray
    torque: np.ndarray


def motion(
    end: float,
    wind_up: float,
    catch: float,
    inertia: float,
    stiffness: float,
    static: float,
    kinetic: float,
    decay: float,
    drag: float,
    damping: float,
) -> Motion:
    """The motion of wind-up, release and catch."""
    count = math.ceil(wind_up / STEP)
    rising = np.clip(2.0 * np.arange(1, count + 1) / count, 0.0, 1.0)
    winding = rising**3 * (10.0 - 15.0 * rising + 6.0 * rising**2)
    winding *= static / stiffness / (winding.sum() * STEP)
    speed = float(winding[-1])

    def rate(y: float, torque: float) -> float:
        return (torque - kinetic - (static - kinetic) * math.exp(-decay * y) - drag * y) / inertia

    y, torque, slow, free = 0.0, static, min(FALLEN / decay, 0.6 * end), [0.0]
    while y < slow:  # by the midpoint rule
        half = y + 0.5 * STEP * rate(y, torque)
        middle = torque + 0.5 * STEP * stiffness * (speed - y)
        torque += STEP * stiffness * (speed - half)
        gained = STEP * rate(half, middle)
        if gained <= 0.0 and len(free) > 2:  # a rock that does not let go: the bit would swing back
            break
        y += gained
        free.append(y)
    a = rate(y, torque)
    b = (stiffness * (speed - y) + (decay * (static - kinetic) * math.exp(-decay * y) - drag) * a) / inertia
    r = catch
    matrix = [[r**3, r**4, r**5], [3 * r**2, 4 * r**3, 5 * r**4], [6 * r, 12 * r**2, 20 * r**3]]
    c3, c4, c5 = np.linalg.solve(matrix, [end - y - a * r - 0.5 * b * r**2, -a - b * r, -b])
    s = STEP * np.arange(1, math.ceil(r / STEP))
    caught = np.append(y + a * s + 0.5 * b * s**2 + c3 * s**3 + c4 * s**4 + c5 * s**5, end)
    s = np.append(s, r)
    acceleration = a + b * s + 3 * c3 * s**2 + 4 * c4 * s**3 + 5 * c5 * s**4
    jerk = b + 6 * c3 * s + 12 * c4 * s**2 + 20 * c5 * s**3
    falling = decay * (static - kinetic) * np.exp(-decay * caught)
    followed = caught + (inertia * jerk + (drag - falling) * acceleration) / stiffness
    rest = math.ceil(10.0 * damping / stiffness / STEP)  # until a damper beside the spring has come to rest
    caught, followed, acceleration, falling = (
        np.append(each, np.full(rest, each[-1])) for each in (caught, followed, acceleration, falling)
    )
    bit = np.concatenate([np.zeros(count), free, caught])
    top = np.concatenate([winding, np.full(len(free), speed), followed])
    pulls = np.concatenate([
        stiffness * STEP * np.cumsum(winding),
        np.full(len(free), static) + stiffness * STEP * np.concatenate([[0.0], np.cumsum(speed - 0.5 * (np.array(free[1:]) + free[:-1]))]),
        inertia * acceleration + kinetic + falling / decay + drag * caught,
    ])  # fmt: skip
    return Motion(bit, _through(top, bit, pulls, stiffness, damping), pulls)


def _through(top: np.ndarray, bit: np.ndarray, torque: np.ndarray, stiffness: float, damping: float) -> np.ndarray:
    """The speed of the top where a damper acts beside the spring, T = k twist + damping twist'."""
    if not damping:
        return top
    lag = math.exp(-STEP * stiffness / damping)
    twist, before, result = 0.0, 0.0, np.empty(bit.size)
    for i, asked in enumerate((torque / stiffness).tolist()):
        before, twist = twist, lag * twist + (1.0 - lag) * asked
        result[i] = (twist - before) / STEP
    result[-1] = 0.0
    speed: np.ndarray = bit + result
    return speed


def commanded(found: Motion, inertia: float, drag: float, proportional: float, integral: float, delay: float) -> np.ndarray:
    """The set-point, at even steps and beyond the motion, with which a PI drive follows the speed of the top."""
    settling = 8.0 * proportional / integral if integral else 0.0
    beyond = np.full(math.ceil((settling + delay) / STEP), found.top[-1])
    top = np.concatenate([found.top, beyond])
    wanted = inertia * np.gradient(top, STEP) + drag * top + np.concatenate([found.torque, np.full(beyond.size, found.torque[-1])])
    early = round(delay / STEP)
    wanted = np.append(wanted[early:], np.full(early, wanted[-1]))
    errors, total = np.empty(top.size), 0.0
    for i, torque in enumerate(wanted.tolist()):
        errors[i] = (torque - integral * total) / proportional
        total += STEP * errors[i]
    if not integral:
        return top + errors
    errors[-1] = 0.0  # an integral has the torque by then
    result: np.ndarray = top + errors
    return result
