"""The vocabulary of the public interface: each term, what it means, and the former names that it replaced.

A former name is refused with the new one: as an argument (`new_names_only`), as an attribute or a field (`Renamed`), as an option of a command, and as
the name of a class or a command. Files keep their meaning: result files and scenes with former names load (`new_field`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, TypeVar

from toolbox.errors import SceneError, suggest


class Entry(NamedTuple):
    """One term.

    Attributes
    ----------
    places
        Functions, classes and commands in which the former name stood, separated by spaces; a command as `stickslip-onset`.
    old, new
        Former name, and the name now.
    meaning
        What is called so.
    """

    places: str
    old: str
    new: str
    meaning: str


RESULTS = (
    "Basin Chance DescribingFunction Estimates Fit LowestSetPoints Margins ModeShapes Onset Posterior Prediction Schedule SeverityMap SmallestError "
    "StabilityChart Sweep Tuned UncertainOnset Validation Windows Equilibrium HopfPoint"
)
LIFTING = "Lifting"
ENTRIES = (
    # ranges
    Entry("onset hopf_points hopf_curve uncertain_onset absorber_limit lowest_set_point LowestSetPoints UncertainOnset", "between", "bounds",
          "(low, high) of one parameter"),
    Entry("follow", "span", "bounds", "(low, high) of one parameter"),
    Entry("severity_map chance stability_chart windows", "over", "ranges", "{name: (low, high) or values} of several parameters"),
    Entry("basin Basin", "box", "ranges", "{name: (low, high)} of several states"),
    Entry("fit tune latin_hypercube sobol uniform", "bounds", "ranges", "{name: (low, high)} of several parameters"),
    Entry("sweep", "vary", "ranges", "{name: values} of several parameters"),
    # uncertainty and results of fits
    Entry("worst_case survives", "errors", "uncertainty", "deviations of parameters from their nominal values"),
    Entry("chance drawn drawn_group uncertain_onset Chance UncertainOnset", "uncertain", "uncertainty", "distributions of parameters"),
    Entry("smallest_error", "ranges", "uncertainty", "deviations of parameters from their nominal values"),
    Entry("Fit", "errors", "standard_errors", "standard errors of the fitted values"),
    Entry("Fit", "mute", "unidentifiable", "parameters that the data do not determine"),
    Entry("Fit", "strays", "outliers", "samples that were left out as outliers"),
    Entry("Fit", "resting", "fixed_by", "signals that are at rest"),
    Entry("Fit Validation", "apart", "initial_mismatch", "difference between measured and simulated start"),
    Entry("Sweep SeverityMap", "errors", "failures", "{run: message} of the runs that failed"),
    Entry("WorkPrecision", "truths", "references", "runs of the highest accuracy"),
    Entry("WorkPrecision", "disagreement", "reference_error", "difference between the references"),
    Entry("Prediction", "cover", "coverage", "share of the measured samples within the band"),
    Entry("Knowledge", "strength", "rock_strength", "deviation of the logarithm of the strength of the rock"),
    Entry("LinearMPC NonlinearMPC BrakeMPC", "priority", "violation_cost", "cost of a limit that is passed"),
    # checkpoints and progress
    Entry("severity_map chance posterior compare_models windows sweep", "out", "checkpoint", "file or folder from which a stopped search continues"),
    Entry("tune", "journal", "checkpoint", "file from which a stopped search continues"),
    Entry("lowest_set_point", "known", "checkpoint", "file from which a stopped search continues"),
    Entry("lowest_set_point", "say", "callback", "function that is called with a line of text for every new outcome"),
    # signals, controllers and metrics
    Entry("Controller Sampled LinearLaw from_control performance_limit", "measures", "measured_signals", "signals that a controller measures"),
    Entry("Controller Sampled LinearLaw from_control performance_limit", "drives", "actuated_signals", "signals that a controller sets"),
    Entry("sweep compare posterior compare_models worst_case survives Sweep Scene", "measures", "metrics", "numbers that are read from a run"),
    Entry("Sweep", "measure_units", "metric_units", "{metric: unit}"),
    Entry("closed_loop to_control windows schedule", "law", "controller", "controller of a loop"),
    Entry("ClosedLoop Trajectory", "laws", "controllers", "controllers of a loop"),
    Entry("ClosedLoop", "with_laws", "with_controllers", "the loop with other controllers"),
    Entry("ClosedLoop", "law_words", "controller_names", "names of the controllers"),
    Entry(f"ClosedLoop HybridSystem Scene Trajectory {RESULTS}", "asked", "display_units", "{unit: unit in which a value is shown}"),
    Entry("Onset", "between", "cycle_runs", "runs inside stick-slip between the values of the grid"),
    # delays and noise
    Entry("SlidingMode SuperTwisting ImpedanceSuperTwisting ImplicitSlidingMode IdealSlidingMode LQG OnEstimates Observed", "late", "delay_samples",
          "delay of the actuator, in samples"),
    Entry("machine_groups Machine", "late", "delay", "delay of the commands [s]"),
    Entry("LQG LinearMPC NonlinearMPC MovingHorizon Kalman", "torque_walk", "torque_process_noise",
          "intensity of the process noise of the torque at the bit"),
    Entry("LQG LinearMPC NonlinearMPC MovingHorizon Kalman", "drive_walk", "drive_process_noise",
          "intensity of the process noise of the torque of the drive"),
    Entry("NonlinearMPC", "strength_walk", "strength_process_noise", "intensity of the process noise of the strength of the rock"),
    # set-points
    Entry("lowest_set_point LowestSetPoints schedule", "before", "initial_controller", "controller whose stick-slip is taken over"),
    Entry("lowest_set_point", "ways", "protocols", "protocols of the takeover"),
    Entry("lowest_set_point", "lasts", "long_run", "whether a set-point is confirmed for half an hour"),
    Entry("SetPointLimit", "until", "highest", "highest set-point that holds"),
    Entry("SetPointLimit Outcome", "above", "time_above_setpoint", "share of the time with the top above the set-point"),
    Entry("SetPointLimit Outcome", "again", "relapses_per_hour", "most lifts an hour after the recovery"),
    Entry("toolbox.robustness", "Held", "SetPointLimit", "result of a search for the lowest set-point"),
    Entry(LIFTING, "first", "first_factor", "first raised set-point as a multiple of the set-point"),
    Entry(LIFTING, "further", "factor_step", "increase of a raised set-point that does not help"),
    Entry(LIFTING, "highest", "max_factor", "highest raised set-point as a multiple of the set-point"),
    Entry(LIFTING, "off", "unload_rate", "rate at which weight is taken off"),
    Entry(LIFTING, "back", "reload_rate", "rate at which weight comes back"),
    Entry(LIFTING, "tries", "max_attempts", "relapses until the controller gives up"),
    Entry(LIFTING, "limit", "speed_limit_factor", "top speed above which the torque is lowered, as a multiple of the set-point"),
    Entry(LIFTING, "least_limit", "min_speed_limit", "top speed below which no limit lowers the torque"),
    # others
    Entry("quantity", "usual", "typical_range", "range of plausible values"),
    Entry("Absorber", "bearable", "max_negative_damping", "largest negative damping that an absorber makes up for"),
    Entry("from_recording", "hole", "max_gap", "largest gap, in samples"),
    # groups of plants and protocols of the lowest set-point
    Entry("group", "declared", "nominal", "plant with its nominal values"),
    Entry("group", "real", "noisy", "noise, and 10 % more weight"),
    Entry("group", "robust", "one_at_a_time", "one deviation on each plant"),
    Entry("group", "corners", "combined", "three deviations at once"),
    Entry("group", "rocks", "other_rocks", "other friction laws of the rock"),
    Entry("group", "weight", "varying_weight", "weight on bit that varies in time"),
    Entry("protocol", "direct", "takeover", "the controller takes over, and the set-point stays"),
    Entry("protocol", "raised", "ramp", "the set-point is raised, and ramps down after the takeover"),
    Entry("SetPointLimit", "margin_declared", "margin_nominal", "disk margin of the nominal plant"),
    Entry("verdict", "free at last", "recovered", "verdict on a run that is free after several sticks"),
    Entry("verdict", "sticks once", "recovered after 1 stick", "verdict on a run that is free after one stick"),
    # column heads of tables
    Entry("column", "law", "controller", "controller that a row is about"),
    Entry("column", "declared", "nominal", "nominal value of a parameter, or the plant with its nominal values"),
    Entry("column", "real", "noisy", "noise, and 10 % more weight"),
    Entry("column", "robust", "one_at_a_time", "one deviation on each plant"),
    Entry("column", "corners", "combined", "three deviations at once"),
    Entry("column", "rocks", "other_rocks", "other friction laws of the rock"),
    Entry("column", "direct", "takeover", "the controller takes over, and the set-point stays"),
    Entry("column", "raised", "ramp", "the set-point is raised, and ramps down after the takeover"),
    Entry("column", "measure", "metric", "number that is read from a run"),
    Entry("column", "way", "stopping distance", "distance until a brake has stopped"),
    Entry("WrongNumber", "declared", "nominal", "value of the number on the nominal plant"),
    # commands
    Entry("stickslip", "drives", "setpoints", "command that prints the lowest set-points"),
    Entry("stickslip-onset stickslip-setpoints", "--from", "--range NAME=LOW:HIGH", "range of a parameter"),
    Entry("stickslip-onset stickslip-setpoints", "--to", "--range NAME=LOW:HIGH", "range of a parameter"),
    Entry("stickslip-onset", "--parameter", "--range NAME=LOW:HIGH", "parameter that varies, and its range"),
    Entry("stickslip-map stickslip-windows", "--x", "--range NAME=LOW:HIGH", "range of a parameter"),
    Entry("stickslip-map stickslip-windows", "--y", "--range NAME=LOW:HIGH", "range of a parameter"),
    Entry("stickslip-sweep", "--vary", "--range", "range of a parameter"),
    Entry("stickslip-chance", "--over", "--range", "range of a parameter"),
    Entry("stickslip-basin", "--box", "--range", "range of a state"),
    Entry("stickslip-tune", "--free", "--range", "range of a parameter"),
    Entry("stickslip-study stickslip-sweep stickslip-compare", "--measure", "--metric", "number that is read from a run"),
    Entry("stickslip-tune", "--over", "--aggregate", "how the values of several scenes become one"),
    Entry("stickslip-tune", "--journal", "--checkpoint", "file from which a stopped search continues"),
    Entry("stickslip-margins", "--wrong", "--uncertainty", "deviation of a parameter"),
    Entry("stickslip-map", "--off", "--uncertainty", "deviation of parameters"),
    Entry("stickslip-onset stickslip-chance stickslip-setpoints", "--uncertain", "--uncertainty", "distribution of a parameter"),
    Entry("stickslip-setpoints stickslip-schedule", "--before", "--initial-controller", "controller whose stick-slip is taken over"),
    Entry("stickslip-setpoints", "--way", "--protocol", "protocol of the takeover"),
    Entry("stickslip-posterior", "--hole", "--max-gap", "largest gap, in samples"),
)  # fmt: skip
"""The terms that replaced others. Exceptions stand in the docs."""

NOW = {(place, entry.old): entry.new for entry in ENTRIES for place in entry.places.split()}
"""{(place, former name): name now}."""

Arguments = ParamSpec("Arguments")
Found = TypeVar("Found")


def refuse_former_names(place: str, words: Any) -> None:
    """Raise SceneError for the first word that is a former name in that place, with the name now."""
    for word in words:
        if (place, word) in NOW:
            raise SceneError(f"Argument `{word}` of `{place}` is now `{NOW[place, word]}`.")


def now_or_near(place: str, word: str, known: Iterable[str]) -> str:
    """Return the end of an error message about an unknown name: the name now of a former one, or the nearest known names."""
    names = list(known)
    return f"it is now `{NOW[place, word]}`." if NOW.get((place, word)) in names else suggest(word, names)


def new_names_only(function: Callable[Arguments, Found]) -> Callable[Arguments, Found]:
    """Let a function refuse the former names of its arguments with the names now."""

    @functools.wraps(function)
    def checked(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Found:
        refuse_former_names(function.__name__, kwargs)
        return function(*args, **kwargs)

    return checked


def new_field(kind: type, word: str) -> str:
    """Return the name now of a field of a class; the same word where it was never renamed."""
    return next((NOW[each.__name__, word] for each in kind.__mro__ if (each.__name__, word) in NOW), word)


class Renamed:
    """A class that refuses former names of its arguments and attributes with the names now."""

    if not TYPE_CHECKING:  # a checker of types must see neither, or it takes every name for an attribute

        def __init_subclass__(cls, **kwargs: Any) -> None:
            """Refuse former names among the attributes that a subclass declares."""
            super().__init_subclass__(**kwargs)
            for word in vars(cls):
                if (now := new_field(cls.__mro__[1], word)) != word:
                    raise SceneError(f"Attribute `{word}` of `{cls.__name__}` is now `{now}`.")

        def __new__(cls, *args: Any, **kwargs: Any) -> Any:
            """Refuse former names of arguments."""
            for word in kwargs:
                if (now := new_field(cls, word)) != word and word not in getattr(cls, "__dataclass_fields__", {}):
                    raise SceneError(f"Argument `{word}` of `{cls.__name__}` is now `{now}`.")
            return super().__new__(cls)

        def __getattr__(self, name: str) -> Any:
            now = new_field(type(self), name)
            if now != name and not hasattr(type(self), name):
                raise AttributeError(f"`{name}` of `{type(self).__name__}` is now `{now}`.", name=name, obj=self)
            return object.__getattribute__(self, name)  # as it fails without this method
