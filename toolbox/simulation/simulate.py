"""The one verb: a plant, a duration and perhaps a controller in, a trajectory out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

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


@runtime_checkable
class SingleStart(Protocol):
    """A start of `toolbox.robustness`, such as `FromRest("30 s")`: it finds the loop of its run on the plant of a loop."""

    def single_loop(self, loop: ClosedLoop) -> ClosedLoop:
        """Return the loop of the only run that begins so."""


def simulate(
    loop: HybridSystem | ClosedLoop,
    duration: NumberOrText | None = None,
    *,
    start: Mapping[str, Any] | Samples | Equilibrium | RunState | SingleStart | None = None,
    inputs: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    controller: Any = None,
    sample_time: NumberOrText | None = None,
    method: Method | str = "event",
    accuracy: float | None = None,
    output_times: Sequence[float] | np.ndarray | None = None,
) -> Trajectory:
    """Simulate a closed loop, or a plant, and locate every switch between stick and slip as an event.

    The run begins at rest unless a start is given. `simulate(plant, duration, controller=..., ...)` is short for
    `simulate(closed_loop(plant, controller, ...), duration)`. Arguments that are given with a loop replace the
    arguments of the loop.

    Every number in `duration`, `start`, `inputs`, `parameters` and `sample_time` is in SI, or text with its unit: "2
    min", "95 rpm", "10 kN m".

    Parameters
    ----------
    loop
        A loop made by `closed_loop`, or a plant made by `compose` or `smoothed`.
    duration
        Length of the run [s], >= 0, from the time of `start` on. By default the duration of the scene, for a loop from
        a scene.
    start
        Start of the run, by default rest (all states 0) at the time 0. One of these:

        - {state, or signal that is a state: start value}. All other states are 0, and the time is 0.
        - One instant of another run, `run.at(12.5)`.
        - An `Equilibrium`, whose states are used.
        - A start of `toolbox.robustness` that begins one run, such as `FromRest("30 s")`, `SmoothRunning()` or
          `TakenOver(StiffPI(), phases=1)`. It is found on the plant of this loop, with the commands of its controllers.
        - `run.last`. The new run continues the old run at its end, as one run without interruption: at the same
          absolute time, with the memory of all controllers and the commands that are still delayed. Inputs are
          functions of the absolute time, and `time` of the new run begins at the end of the old run. An event exactly
          at this time is listed in one of the two runs only.
    inputs
        {signal, or parameter of the plant that changes in time: value}. A value is a number, text with a unit, a table
        (times, values), a shape of `toolbox.inputs` (`step`, `ramp`, `sine`, `noise`, `square`, `triangle`, `start_up`,
        `inputs.sweep`), or a casadi expression of `toolbox.time`. By default every input has the default value of its
        part.
    parameters
        {parameter of the plant or of a controller: value}, for this run only, by default none. The controller is not
        designed again: it keeps its design on the plant with its own values.
    controller
        A `Controller`, a callable (t, y) -> u, `Sampled(controller, period, delay)`, or a sequence of them. By default
        None: the inputs alone drive the plant, or the controllers of the given loop act.
    sample_time
        Sample time of the controller [s]. By default a `Controller` acts continuously.
    method
        A method or its name, by default "event":

        - "event" locates every switch. It uses the steps that are fastest for the run: Taylor series, explicit
          formulas, or linearly implicit formulas if these are cheaper. Runs with a controller in Python use explicit
          formulas. `run.why` gives the choice and its reason.
        - "taylor", "explicit" and "stiff" locate every switch with the named steps.
        - `TimeStepping(step)`, in short "time-stepping", moves in constant steps and locates no switch.
        - `Smoothing(width)`, in short "smoothed", replaces dry friction by a smooth function of the slip speed.

        `TimeStepping` without a step and `Smoothing` without a width refine the step or the width until the accuracy is
        met. Every method has the option `budget` for limits on the cost of a run:
        `EventExact(budget=Budget(seconds=60))`.
    accuracy
        Target for the global error, with every state scaled by its size, between 1e-13 and 0.1. By default the accuracy
        of the scene, else 1e-6.
    output_times
        Increasing times [s] between begin and end at which the run is recorded, shape (nt,). At an event the value
        after the event is recorded. By default every step is recorded, and both sides of every event.

    Returns
    -------
    Trajectory
        The signals, modes and events of the run.

    Raises
    ------
    SceneError
        If an argument cannot be simulated; the message names it.
    SimulationError, ZenoError, BudgetError
        If the run cannot be finished. `.run` of the error is the trajectory so far.
    ControllerError
        If a command or a memory value of a controller is not a finite number. The message names controller, signal and
        time.
    AccuracyError
        If a method cannot meet the accuracy at an acceptable cost.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import compose, simulate
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> run = simulate(rig, "60 s", controller=SoftTorque(reference="60 rpm"), sample_time="10 ms")
    >>> print(f"the bit sticks for {run.time_in('bit', 'stick'):.2f} s and ends at {run['bit.speed'][-1]:.2f} rad/s")
    the bit sticks for 4.61 s and ends at 6.27 rad/s
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
    elif not isinstance(start, SingleStart):
        begin = start
    if not isinstance(loop, ClosedLoop) or any(each is not None for each in (controller, sample_time, inputs, parameters, begin)):
        loop = closed_loop(loop, controller, sample_time=sample_time, inputs=inputs, parameters=parameters, start=begin)
    if isinstance(start, SingleStart):
        loop = start.single_loop(loop)
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
