"""The one verb: a plant, a duration and perhaps a controller in, a trajectory out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from toolbox.files.units import NumberOrText
    from toolbox.modelling.closed_loop import ClosedLoop
    from toolbox.modelling.hybrid_system import HybridSystem
    from toolbox.modelling.steady_point import Equilibrium
    from toolbox.simulation.methods import Method
    from toolbox.simulation.run_state import RunState
    from toolbox.simulation.samples import Samples
    from toolbox.simulation.trajectory import Trajectory


def simulate(
    loop: HybridSystem | ClosedLoop,
    duration: NumberOrText | None = None,
    *,
    start: Mapping[str, Any] | Samples | Equilibrium | RunState | None = None,
    inputs: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    controller: Any = None,
    sample_time: NumberOrText | None = None,
    method: Method | str = "event",
    accuracy: float | None = None,
    output_times: Sequence[float] | np.ndarray | None = None,
) -> Trajectory:
    """Simulate a closed loop, or a plant, for `duration` seconds; every switch between stick and slip is located as an event.

    The run begins at rest unless a start is given. `simulate(plant, duration, controller=law, ...)` is short for
    `simulate(closed_loop(plant, law, ...), duration)`; what is given beside a loop takes the place of what the loop holds.

    Every number in `duration`, `start`, `inputs`, `parameters` and `sample_time` is in SI, or text with its unit: "2 min", "95 rpm", "10 kN m".

    Parameters
    ----------
    loop
        A loop made by `closed_loop`, or a plant made by `compose` or smoothed by `smoothed`.
    duration
        Length of the run [s], >= 0, from the time of `start` on; of a loop out of a scene, the duration of the scene by default.
    start
        Start values {state, or signal that is a state: value}; all other states are 0, and the time is 0. Or one instant of another run (`run.at(12.5)`), or an
        `equilibrium`, whose states are taken. Or `run.last`: the run goes on where that one ended, at the same absolute time, with the memory of all laws and
        what is on its way to the plant, so that the pieces are one run; inputs are those of that time, and `run.time` begins there.
    inputs
        Inputs {signal, or parameter of the plant that changes in time: value}. A value is a number, a table (times, values), a shape of `toolbox.inputs`
        (`step`, `ramp`, `sine`, `noise`, `square`, `triangle`, `inputs.sweep`), or a casadi expression of `toolbox.time`.
    parameters
        Parameters {name: value} for this run only, of the plant or of a law; the controller keeps the design on the declared values of the plant.
    controller
        A `Controller`, a callable (t, y) -> u, `Sampled(law, period, delay)`, or a sequence of them.
    sample_time
        Sample time of the controller [s]; without it a `Controller` acts continuously.
    method
        A method or its short form. "event" locates every switch, by the steps that were the fastest for such runs: Taylor series, explicit formulas, or
        linearly implicit ones where these are cheaper (runs with a law in Python stay explicit); `run.why` says which and why. "taylor", "explicit" and
        "stiff" prescribe the steps. `TimeStepping(step)`, short "time-stepping", locates no switch; `Smoothing(width)`, short "smoothed", regularises
        friction; both refine their option until the accuracy is met, unless it is given. What the run may spend at most is an option of every method:
        `EventExact(budget=Budget(seconds=60))`.
    accuracy
        Target for the global error, where every state is scaled by its size; between 1e-13 and 0.1. By default that of the scene, or 1e-6.
    output_times
        Increasing times [s] between begin and end at which the run is recorded, shape (nt,), as right-hand limits at events. Without them every step is
        recorded, and both sides of every event.

    Returns
    -------
    Trajectory
        The signals, modes and events of the run.

    Raises
    ------
    SceneError
        If an argument cannot be simulated; the message names it.
    SimulationError, ZenoError, BudgetError
        If the run cannot be finished; `.run` of the error is the trajectory so far.
    ControllerError
        If a controller gives a command, or remembers a value, that is no finite number; the message names controller, signal and time.
    AccuracyError
        If a method cannot meet the accuracy at a bearable price.
    """
    # here, so that a script pays for the machinery of runs with its first run
    from toolbox.errors import SceneError
    from toolbox.messages import LOG
    from toolbox.modelling.closed_loop import ClosedLoop, closed_loop
    from toolbox.simulation.request import Request, accuracy_of
    from toolbox.simulation.run_state import RunState
    from toolbox.simulation.samples import Samples

    at = begin = None
    if isinstance(start, (RunState, Samples)):
        at = start
    else:
        begin = start
    if not isinstance(loop, ClosedLoop) or any(each is not None for each in (controller, sample_time, inputs, parameters, begin)):
        loop = closed_loop(loop, controller, sample_time=sample_time, inputs=inputs, parameters=parameters, start=begin)
    duration = loop.duration if duration is None else duration
    if duration is None:
        raise SceneError("Argument `duration` must be given: only a loop out of a scene has one of its own.")
    accuracy = accuracy_of(loop, accuracy)
    run = Request(loop, duration, at, method, accuracy, output_times).checked()
    done = run.again()
    told = ("told", done.why.partition(" at t = ")[0])
    if done.why and not run.method.chooses and told not in run.system.cache:  # once for a plant; of what is chosen `run.why` tells alone
        run.system.cache[told] = True
        LOG.warning("method=%r was not taken: %s", run.method.text, done.why)
    return done
