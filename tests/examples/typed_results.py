"""A script of a user who reads results: it runs, and mypy in strict mode knows the type of everything that is read."""

from typing import assert_type

import numpy as np
from numpy.typing import NDArray

from controllers import PI, StiffPI
from models import BitRock, wells
from toolbox import (
    Controller,
    HybridSystem,
    Sampled,
    Trajectory,
    closed_loop,
    compare,
    compose,
    equilibrium,
    fit,
    follow,
    limit_cycle,
    measure,
    onset,
    severity_map,
    simulate,
    sweep,
    tune,
)
from toolbox.calibration import Fit, Recording
from toolbox.onsets import SeverityMap
from toolbox.sweeps import Sweep
from toolbox.tuning import Tuned

Floats = NDArray[np.float64]

rig = compose(wells.JANSEN_2, BitRock(weight="97.347 kN"))
assert_type(rig, HybridSystem)

run = simulate(rig, "20 s", controller=StiffPI(reference="95 rpm"))
assert_type(run, Trajectory)
assert_type(run["bit.speed"], Floats)
assert_type(run.time, Floats)
assert_type(run.error_estimate, float)
assert_type(run.steps, tuple[int, int])
assert_type(run.events[0].time, float)
assert_type(run.events[0].element, str)
assert_type(run.time_in("bit", "stick", after="10 s"), float)
assert_type(run.intervals("bit"), list[tuple[float, float, str]])
assert_type(run.at([1.0, 2.0])["bit.speed"], Floats)
speed: float = run.at("12.5 s")["bit.speed"]
assert_type(run.main_signals, list[str])
peak = float(run["bit.speed"].max())
sticks = run.modes["bit"] == "stick"
assert_type(measure.severity(run, after="10 s"), float)
assert_type(measure.extent(run, "bit.speed").maximum, float)
assert_type(measure.stick_intervals(run, "bit"), list[tuple[float, float]])
assert_type(compare(run, run)["bit.speed, maximum"].change, float | None)
rest = equilibrium(closed_loop(rig, inputs={"top.torque": "20 kN m"}))
steady: float = rest["bit.speed"]

found = onset(
    closed_loop(rig, StiffPI()).at("top.reference", "125 rpm"),
    "top.reference",
    ("100 rpm", "130 rpm"),
    num_values=3,
    duration="40 s",
    tolerance="5 rpm",
)
assert_type(found.end, float)
assert_type(found.values, Floats)
assert_type(found.bistable, list[tuple[float, float]])
assert_type(found.verdict(12.0), str)
for name, border in found.borders:
    assert_type(name, str)
    assert_type(border.value, float)

over = {"top.reference": ("60 rpm", "140 rpm"), "bit.weight": ("80 kN", "100 kN")}
chart = severity_map(closed_loop(rig, StiffPI()), over, shape=(2, 2), duration="20 s", halvings=0)
assert_type(chart, SeverityMap)
assert_type(chart.smooth.severity, Floats)
assert_type(chart.axes[0], Floats)
assert_type(chart.regions["free"], NDArray[np.bool_])
assert_type(chart.border("smooth", 90e3), Floats)

swept = sweep(closed_loop(rig, StiffPI()), {"bit.weight": ["50 kN", "60 kN"]}, "5 s")
assert_type(swept, Sweep)
assert_type(swept["severity"], Floats)
assert_type(swept.points, Floats)
assert_type(swept.failures, dict[int, str])

tuned = tune(
    rig, PI(reference="95 rpm", proportional=900.0, integral=600.0), "peak", {"pi.integral": (100.0, 2000.0)}, duration="5 s", runs=10
)
assert_type(tuned, Tuned)
assert_type(tuned.best.numbers, tuple[float | None, ...])
assert_type(tuned.counted(tuned.best), tuple[float, ...])
law = tuned.law
assert_type(law, Controller | Sampled)
assert isinstance(law, PI)
assert_type(law.integral, float)

times = np.linspace(0.0, 5.0, 51)
again = simulate(rig, 5.0, inputs={"top.torque": "20 kN m"}, output_times=times)
recording = Recording(times, {"bit.speed": again["bit.speed"]}, "a test")
fitted = fit(closed_loop(rig, inputs={"top.torque": 20_000.0}), recording, ["bit.weight"], {"bit.weight": ("90 kN", "105 kN")})
assert_type(fitted, Fit)
assert_type(fitted["bit.weight"], float)
assert_type(fitted.interval("bit.weight"), tuple[float, float])
assert_type(fitted.values, Floats)
assert_type(fitted.parameters, dict[str, float])

cycle = limit_cycle(closed_loop(rig, StiffPI(reference="95 rpm")), settle="60 s")
assert_type(cycle.period, float)
assert_type(cycle.stable, bool)
branch = follow(cycle, "stiffpi.reference", ("85 rpm", "100 rpm"), points=3)
assert_type(branch.values, list[float])
assert_type(branch.periods, Floats)
assert_type(branch.extremes("bit.speed"), Floats)
assert_type(branch.stable, NDArray[np.bool_])
