"""What sets the length of the steps of a run under way, in words of the plant: the message of a run that has spent its budget."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from toolbox.arguments import count_of
from toolbox.compilation import work_layout
from toolbox.compilation.program import Program
from toolbox.simulation.run import Run
from toolbox.simulation.stiffness import NEAR, progress, spectral_radius

SHARE = 0.2
"""Share of the steps from which on what ends them is the cause."""


def bottleneck(run: Run, program: Program, work: Any, switches: np.ndarray) -> str:
    """Why a run takes as many steps as it does: switches, samples, tables, waves of inputs, or the state whose error is the largest.

    `switches` is the number of those of each element so far.
    """
    t, steps, _ = progress(work)
    steps = max(steps, 1)
    if run.method.fixed_step is not None:
        return f"its step is {run.method.fixed_step:.2g} s"
    names = [element.name for element in program.system.elements]
    if switches.sum() >= SHARE * steps:
        most = int(np.argmax(switches))
        return f"`{names[most]}` switched {switches[most]} times"
    if len(run.clocks) and int(work.samplers[:, work_layout.TAKEN].sum()) >= SHARE * steps:
        return f"a law samples every {min(clock.period for clock in run.clocks):.3g} s"
    if int(work.ints[work_layout.JUMP]) >= SHARE * steps:
        return f"tables of inputs turn or jump at {int(work.ints[work_layout.JUMP])} times"
    mean, longest = t / steps, float(work.reals[work_layout.LONGEST])
    if mean > 0.5 * longest:
        return f"inputs that vary in time let no step be longer than {longest:.2g} s"
    cause = f"steps of about {mean:.1g} s, which {_largest_error(program, work)} asks for"
    if run.method.smooths:
        return cause
    radius = spectral_radius(program, t, work.x, work.p, work.m)
    if not program.formulas.implicit and NEAR < mean * radius < np.inf:
        cause += f", at a plant whose fastest time constant is {1.0 / radius:.1g} s (method stiff takes longer steps)"
    return cause


def _largest_error(program: Program, work: Any) -> str:
    """The state with the largest error, in units of its tolerance, of a step as long as the next one; or the contact whose force is followed."""
    ints, reals = work.ints, work.reals
    n, base, hidden = int(ints[work_layout.N]), int(2 * ints[work_layout.N] + 2 * ints[work_layout.NG]), work.excited.size
    pointer, h = ctypes.c_void_p, float(reals[work_layout.STEP_SIZE])
    step = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_double, *[pointer] * 5)(int(ints[work_layout.STEP]))
    out = np.zeros(work.y.size)
    step(float(reals[work_layout.TIME]), h, *(array.ctypes.data for array in (work.x, work.k, work.p, work.m, out)))
    size = np.maximum(np.maximum(work.scale, 1e-10 * work.group_scale[work.group]), 1e-14)
    share = max(reals[work_layout.RTOL] * min(h / reals[work_layout.HORIZON], 0.1), 1e-14)
    errors = np.abs(out[base : base + n]) / (share * size + work.noise[:n] * h)
    lowest = base + n if ints[work_layout.TWO_ERRORS] else base
    elements = [program.system.elements[int(i)].name for i in work.excited]
    in_stick = 2 * np.array(work.excited, int) + int(ints[work_layout.NG])
    errors[n - hidden :] = np.abs(out[lowest + n - hidden : lowest + n]) / ((0.02 if ints[work_layout.TWO_ERRORS] else 3e-4) * np.maximum(
        work.guard_scale[in_stick], 1e-300))  # fmt: skip
    most = int(np.argmax(np.where(np.isfinite(errors), errors, np.inf)))
    if most >= n - hidden:
        return f"the force of `{elements[most - (n - hidden)]}`"
    labels = [
        f"{name}.{i}" if size is not None else name for name, (_, size, _) in program.system.states.items() for i in range(count_of(size))
    ]
    return f"`{labels[most]}`"
