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
    Entry("SlidingMode SuperTwisting ImpedanceSuperTwisting ImplicitSlidingMode IdealSlidingMode LQG StringObserverController "
          "ObserverBasedController", "late", "delay_samples", "delay of the actuator, in samples"),
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
    Entry("SetPointLimit", "until", "highest_set_point", "highest set-point that holds"),
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
    # names that a reader of the signatures could not explain
    Entry("Windows", "free", "free_from", "value of the first number from which on stick-slip ends by itself"),
    Entry("Windows", "smooth", "smooth_from", "value of the first number from which on smooth running is stable"),
    Entry("Windows windows", "along", "second_values", "values of the second number at which windows are read"),
    Entry("Windows", "lowest", "first_low", "low end of the range of the first number"),
    Entry("Windows", "highest", "first_high", "high end of the range of the first number"),
    Entry("Windows", "at", "operating_points", "operating point of the two numbers at every depth"),
    Entry("Windows", "margin", "onset_margins", "distance of the operating point from both borders, as a fraction of itself"),
    Entry("Windows", "maps", "severity_maps", "severity map of every depth"),
    Entry("SetPointLimit Outcome", "fastest", "max_bit_speed", "highest speed of the bit after the takeover"),
    Entry("SetPointLimit Outcome", "torque", "max_torque", "highest torque of the drive after the takeover"),
    Entry("SetPointLimit Outcome", "lifts", "max_lifts", "most lifts from the takeover on"),
    Entry("SetPointLimit Outcome", "relief", "max_weight_relief", "largest mean share of the weight that is taken off"),
    Entry("SetPointLimit Outcome", "growth", "growth_rate", "largest growth rate of a small disturbance of smooth running"),
    Entry("SetPointLimit", "margin", "disk_margin", "smallest disk margin over the plants of a group"),
    Entry("SetPointLimit", "margin_nominal", "disk_margin_nominal", "disk margin of the nominal plant"),
    Entry("SetPointLimit", "weakest", "weakest_plant", "plant with the smallest disk margin"),
    Entry("SetPointLimit", "speed", "lowest_set_point", "lowest set-point that holds"),
    Entry("SetPointLimit", "highest", "highest_set_point", "highest set-point that holds"),
    Entry("SetPointLimit Outcome", "recovery", "recovery_time", "longest time until the top is back at the set-point"),
    Entry("Cycle", "returning", "monodromy_indices", "states in the order of the rows of the monodromy matrix"),
    Entry("Cycle", "step", "newton_step", "last Newton step, relative"),
    Entry("Cycle", "period_error", "last_period_change", "last change of the period"),
    Entry("Estimate", "stuck", "probability_stuck", "probability that the bit sticks now"),
    Entry("Estimate", "sticking", "probability_stick_slip", "probability that the bit has stuck within the last period"),
    Entry("Estimate", "strength", "rock_strength", "strength of the rock as a multiple of the nominal one"),
    Entry("Estimate", "margin", "onset_margin", "mean bit speed above the border of smooth running"),
    Entry("Estimates", "alarm", "stick_slip", "whether there is stick-slip"),
    Entry("Estimates", "slow", "sampling_too_slow", "whether the log is too slow to show stick-slip"),
    Entry("Estimates", "measured", "measured_samples", "number of samples with a top speed"),
    Entry("SmallestError", "beside", "own_stick_slip", "verdict of runs that start from the loop's own stick-slip"),
    Entry("SmallestError WorstCase Schedule", "way", "run_conditions", "start of the runs, judged contact and judged time"),
    Entry("SmallestError", "held", "largest_tolerated", "largest size at which every error was a success"),
    Entry("SmallestError", "unknown", "undetermined_reason", "reason for which there is no guaranteed size"),
    Entry("SmallestError", "guaranteed", "guaranteed_size", "size below which no error makes smooth running unstable"),
    Entry("SmallestError", "numbers", "parameters", "parameters that may be wrong, and their ranges"),
    Entry("Schedule", "every", "all_gains", "all parameters of the controller at the depths of the table"),
    Entry("Fit", "equal", "indistinguishable_friction", "friction law whose static and kinetic friction the data cannot tell apart"),
    Entry("Fit", "factor", "interval_factor", "half width of an interval as a multiple of the standard error"),
    Entry("Fit", "exact", "exact_derivatives", "whether derivatives of the model are exact"),
    Entry("Fit", "sampling", "sampling_errors", "error of each parameter because inputs are known at their samples only"),
    Entry("Fit", "agreeing", "agreeing_starts", "number of searches that ended at this optimum"),
    Entry("Fit", "condition", "condition_number", "condition number of the scaled Jacobian"),
    Entry("Fit", "measured", "data_description", "sentence on the fitted data"),
    Entry("Validation", "compared", "data_description", "sentence on the compared data"),
    Entry("Basin Chance", "judged", "judged_runs", "number of runs that the judge carried on"),
    Entry("Basin", "point", "equilibrium", "equilibrium that is disturbed"),
    Entry("Basin", "starts", "initial_states", "disturbed states"),
    Entry("Basin", "smallest", "smallest_disturbances", "disturbed states at the border nearest to the equilibrium"),
    Entry("Group", "judged", "judged_time", "length of the judged time"),
    Entry("Group", "phases", "takeover_phases", "phases of the cycle at which the controller takes over"),
    Entry("Group", "margin", "min_disk_margin", "disk margin that must be left"),
    Entry("Machine", "factors", "parameter_factors", "{parameter: factor of its nominal value}"),
    Entry("Machine", "weight", "weight_variation", "variation of the weight in time"),
    Entry("Answers", "at", "nominal_value", "value of the set-point in the scene"),
    Entry("Answers", "entries", "results", "{label of a controller: its answers}"),
    Entry("ContactRun", "rubbed", "friction_work", "energy that friction has taken"),
    Entry("ContactRun", "passes", "newton_iterations", "Newton iterations of every step"),
    Entry("ContactRun", "modes", "contact_modes", "stick, slip or open of every contact"),
    Entry("ContactProblem", "surface", "surface_velocity", "velocity of the counter-surface per unit of an input"),
    Entry("ContactProblem ReducedBody", "places", "contact_positions", "coordinates of the contacts"),
    Entry("ContactProblem ReducedBody", "areas", "contact_areas", "area of every contact"),
    Entry("ContactProblem", "forces", "force_inputs", "force on the coordinates per unit of an input"),
    Entry("ReducedBody", "errors", "frequency_errors", "relative errors of the natural frequencies"),
    Entry("ReducedBody", "rigid", "rigid_body_modes", "number of rigid-body modes"),
    Entry("ReducedBody", "band", "cutoff_frequency", "frequency up to which modes are kept"),
    Entry("ElasticFace", "closing", "normal_sign", "sign of a normal displacement that closes a contact"),
    Entry("ElasticFace ElasticPad", "pushed", "force_ports", "ports on which forces act"),
    Entry("ElasticFace ElasticSlider", "held", "support_port", "port that a spring and a damper hold"),
    Entry("ElasticPad", "approach", "initial_approach", "approach of the disc at every contact of the unloaded pad"),
    Entry("TorqueDrag", "hanging", "frictionless_tension", "tension without friction along the borehole"),
    Entry("TorqueDrag", "front", "sliding_front", "depth above which the string slides"),
    Entry("TorqueDrag", "bit_held", "bit_static", "whether the rock holds the bit"),
    Entry("torque_drag", "at_top", "load_at_top", "hook load or torque that is applied at the top"),
    Entry("Draws", "others", "independent", "distributions of parameters that are known independently"),
    Entry("Posterior", "points", "samples", "samples of the posterior"),
    Entry("Posterior", "evidence", "log_evidence", "logarithm of the evidence"),
    Entry("Posterior", "error", "log_evidence_error", "standard error of the logarithm of the evidence"),
    Entry("Posterior", "stages", "tempering_stages", "number of tempered likelihoods"),
    Entry("UncertainOnset", "borders", "onset_values", "value of the parameter at which stick-slip begins on each sampled plant"),
    Entry("UncertainOnset", "smooth", "smooth_running_limits", "highest value at which each sampled plant loses smooth running"),
    Entry("UncertainOnset", "unknown", "undecided_runs", "number of runs without a verdict"),
    Entry("ModelComparison", "scores", "log_scores", "logarithmic predictive scores of windows that were left out"),
    Entry("Tuned tune", "over", "aggregate", "how the values of several scenes become one"),
    Entry("Tuned", "simulated", "simulated_runs", "number of runs of this call"),
    Entry("hopf_curve", "over", "second_parameter", "parameter whose values are given"),
    Entry("Margins", "joint", "multiloop", "margins of several commands together"),
    Entry("Margins", "loops", "loop_margins", "margins of every command with the others closed"),
    Entry("Margins", "loop", "linear_loop", "linear loop"),
    Entry("Margins", "signals", "operating_point", "values of set-points, commands and states at the operating point"),
    Entry("Margins", "measured", "simulated_margins", "margins found by simulation"),
    Entry("SeverityMap StabilityChart", "at", "nominal_point", "nominal values of the two parameters"),
    Entry("StabilityChart", "growth", "growth_rate", "largest real part of the poles"),
    Entry("DescribingFunction", "exact", "given_cycle", "period and slips of the cycle that was given"),
    Entry("DescribingFunction", "slip", "steady_slip", "slip of steady running"),
    Entry("DescribingFunction", "response", "linear_response", "frequency response from force to slip"),
    Entry("Branch", "ended", "stop_reason", "reason for which the continuation ended"),
    Entry("follow", "first", "stop_at_bifurcation", "whether to end at the first bifurcation"),
    Entry("follow", "towards", "start_towards", "end of the range to start towards"),
    Entry("Prediction", "measured", "measured_values", "measured values of the signals"),
    Entry("LQR LQG HInfinity LinearMPC NonlinearMPC", "bit_size", "bit_speed_scale", "deviation of the bit speed that counts as one"),
    Entry("LQR LQG LinearMPC NonlinearMPC", "top_size", "top_speed_scale", "deviation of the top speed that counts as one"),
    Entry("LQR LQG HInfinity", "angle_size", "angle_scale", "deviation of the integral that counts as one"),
    Entry("LQR LQG HInfinity LinearMPC NonlinearMPC", "torque_size", "torque_scale", "deviation of the torque that counts as one"),
    Entry("LinearMPC NonlinearMPC", "move_size", "torque_step_scale", "change of the torque in a period that counts as one"),
    Entry("LQR LQG", "tracking", "tracking_time", "time in which the integral follows a command that is cut"),
    Entry("LQR LQG", "point", "operating_point", "states and torque at the operating point"),
    Entry("LQR LQG", "slope", "operating_point_slope", "change of the operating point per rad/s of set-point"),
    Entry("HInfinity", "margin", "norm_factor", "allowed norm as a multiple of the smallest"),
    Entry("HInfinity", "disturbance", "disturbance_scale", "disturbance of the bit torque that counts as one"),
    Entry("HInfinity", "leak", "integrator_leak", "pole of the integrator"),
    Entry("HInfinity", "places", "nonzero_indices", "indices of the entries of the matrix that are not zero"),
    Entry("HInfinity", "matrices", "controller_matrices", "entries of A, B and C of the controller"),
    Entry("HInfinity", "torque", "operating_torque", "torque at the operating point"),
    Entry("HInfinity Kalman DisturbanceObserver SlidingObserver", "begins", "initial_state_map", "initial states per unit of torque and speed"),
    Entry("HInfinity", "worst", "gamma", "norm that is kept"),
    Entry("Kalman DisturbanceObserver SlidingObserver", "places", "model_indices", "indices of the entries of the model that are not zero"),
    Entry("Kalman DisturbanceObserver SlidingObserver", "rock", "rock_friction", "kinetic torque, excess at rest and decay of the rock"),
    Entry("SlidingObserver", "size", "switching_gain", "largest switching injection"),
    Entry("SlidingObserver", "layer", "boundary_layer", "error below which the switching is linear"),
    Entry("LinearMPC NonlinearMPC", "noise", "sensor_noise", "standard deviation of every sensor"),
    Entry("LinearMPC NonlinearMPC", "patience", "fallback_time", "time of standstill after which the soft drive takes over"),
    Entry("LinearMPC NonlinearMPC", "warm", "warm_start", "whether a program starts from the solution before"),
    Entry("LinearMPC NonlinearMPC", "soft", "soft_limits", "whether limits of speed and twist give way"),
    Entry("NonlinearMPC", "matched", "match_static_peak", "whether the peak of regularised friction is that of static friction"),
    Entry("NonlinearMPC", "drive_error", "drive_torque_error", "error of the inertia or torque of the drive, as a fraction of it"),
    Entry("NonlinearMPC", "strength_time", "rock_strength_time", "time in which the strength of the rock is followed"),
    Entry("NonlinearMPC", "rest_speed", "standstill_speed", "speed of the bit below which it is at rest"),
    Entry("NonlinearMPC", "adapt", "adapt_rock_strength", "whether the strength of the rock is estimated"),
    Entry("NonlinearMPC", "slowest", "min_bit_speed_factor", "lowest speed of a turning bit as a multiple of the set-point"),
    Entry("NonlinearMPC", "margin", "holding_torque_margin", "share by which the rock can hold more than it has held"),
    Entry("SlidingMode IdealSlidingMode ImplicitSlidingMode SuperTwisting ImpedanceSuperTwisting", "surface", "surface_gain",
          "weight of the integrals in the sliding surface"),
    Entry("SlidingMode IdealSlidingMode ImplicitSlidingMode SuperTwisting ImpedanceSuperTwisting", "reaching", "reaching_rate",
          "rate at which the surface is reached"),
    Entry("SlidingMode", "width", "boundary_layer", "distance from the surface below which the switching is linear"),
    Entry("ImplicitSlidingMode", "learning", "adaptation_gain", "share of the deviation by which the disturbance is corrected in a sample"),
    Entry("Lifting", "rise", "raise_rate", "rate at which the set-point is raised"),
    Entry("Lifting", "fall", "lower_rate", "rate at which the set-point is lowered"),
    Entry("Lifting", "relief", "weight_relief", "share of the weight that is taken off"),
    Entry("Knowledge", "rock", "rock_correlation_time", "time in which the strength of the rock changes"),
    Entry("Knowledge", "load", "load_variation", "variation of weight and rock in a second, as a fraction of them"),
    Entry("Knowledge", "lasting", "parameter_correlation_time", "time in which the spread of the parameters returns"),
    Entry("GaussianStribeck", "speed", "stribeck_speed", "speed at which friction falls"),
    Entry("SmoothStepFriction", "speed", "transition_speed", "speed about which friction falls"),
    Entry("StepFriction", "speed", "drop_speed", "speed at which friction drops"),
    Entry("MeasuredContact", "still", "standstill_speed", "slip speed up to which the contact sticks"),
    Entry("Absorber", "on", "attached_to", "part to which the absorber is attached"),
    Entry("HandArm", "holds", "attached_to", "part that the hand grips"),
    Entry("OscillatorOnBar", "contact", "contact_position", "position of the contact along the bar"),
    Entry("TorsionalChain DrillString", "collar", "collar_index", "index of the first disk of the collars"),
    Entry("absorber_limit", "own_inertia", "keep_inertia", "whether the inertia of the drive is not tuned"),
    Entry("impedance", "motion", "speed_signal", "signal of the speed at the top"),
    Entry("impedance", "effort", "torque_signal", "signal of the torque at the top"),
    # core classes
    Entry("ClosedLoop", "acting", "differentiable_number", "number with respect to which the equations have a derivative"),
    Entry("ClosedLoop", "free", "varied_number", "number that has an effect and may vary"),
    Entry("ClosedLoop", "bare", "without_controllers", "the loop without its controllers"),
    Entry("ClosedLoop", "but", "replace", "the loop with other values of some fields"),
    Entry("ClosedLoop", "changes_in_time", "depends_on_time", "whether time itself enters the equations"),
    Entry("ClosedLoop", "closed", "assembly", "plant with its controllers as parts, and their clocks"),
    Entry("ClosedLoop", "continuous", "continuous_loop", "the loop with every controller in its continuous form"),
    Entry("ClosedLoop", "sampled", "is_sampled", "whether a controller of the loop samples"),
    Entry("ClosedLoop", "kinds", "input_kinds", "how each input is given"),
    Entry("ClosedLoop", "numbers", "variable_numbers", "{name: number of the loop that can be varied}"),
    Entry("ClosedLoop", "values", "input_values", "{input: its checked value}"),
    Entry("ClosedLoop", "overridden", "overriding_inputs", "{parameter without effect: the input that takes its place}"),
    Entry("ClosedLoop Scene", "standstill", "standstill_speed", "value of the judged signal at which the machine stands"),
    Entry("Scene", "contact", "judged_contact", "contact whose sticking is judged"),
    Entry("Scene", "judges", "judged_names", "names of the judged contact and signal, in words"),
    Entry("Scene", "keys", "settings", "{key of the scene file: value in SI}"),
    Entry("Scene", "needs", "dependencies", "parts of the plant on which the metrics depend"),
    Entry("HybridSystem", "forces", "force_function", "casadi Function of the forces of the elements"),
    Entry("HybridSystem", "slips", "slip_function", "casadi Function of the slips of the elements"),
    Entry("HybridSystem", "leaders", "shared_modes", "frictions that have the mode of another friction on the same slip"),
    Entry("HybridSystem", "must_hold", "parameter_check", "function that refuses numbers with which the forces cannot act"),
    Entry("HybridSystem", "no_element", "unknown_element_error", "error of a name that is no element"),
    Entry("HybridSystem", "rows", "state_index", "first row, size and unit of a state"),
    Entry("HybridSystem", "switch", "element_modes", "number of an element, and the names of its modes"),
    Entry("HybridSystem", "switching", "switched_equations", "fields, forces and guards with modes as input"),
    Entry("HybridSystem", "told", "typed_units", "{unit: unit that was typed} of the scene of a plant"),
    Entry("HybridSystem", "varying", "with_time_varying", "the plant with parameters as inputs"),
    Entry("HybridSystem", "with_forces", "substitute_forces", "expression with the forces of the elements put in"),
    Entry("HybridSystem Component", "routes", "redirected_signals", "{signal that controllers name: signal that takes its place}"),
    Entry("Element", "legend", "mode_names", "{mode: name}"),
    Entry("Element", "watched", "event_field", "field of the expression whose sign switches an element"),
    Entry("Element", "expressions", "expression_fields", "fields that hold casadi expressions"),
    Entry("Element", "one_way", "is_unilateral", "whether the force that holds a slip has one sign"),
    Entry("Equations", "gives", "outputs", "{signal: (expression, unit)}"),
    Entry("FrictionLaw", "breaks", "break_speeds", "slip speeds at which a friction law jumps"),
    Entry("Update", "external", "from_callable", "whether the values come from a Python callable"),
    Entry("Observer", "estimator", "create_estimator", "make the estimator of an observer that is no casadi expression"),
    Entry("Stateful", "remembers", "memory_fields", "attributes that are the memory of an object"),
    Entry("toolbox.modelling", "Remembering", "Stateful", "object whose memory can be saved and restored"),
    Entry("toolbox.modelling", "Observed", "ObserverBasedController", "controller on the estimates of an observer"),
    Entry("controllers", "OnEstimates", "StringObserverController", "controller on the estimates of an observer of a string"),
    Entry("models", "Guide", "GuideContact", "second surface that rubs on a block"),
    Entry("models", "Drop", "StepFriction", "friction that drops at one slip speed"),
    Entry("models", "Transition", "SmoothStepFriction", "friction that falls smoothly about one slip speed"),
    Entry("toolbox", "units", "use_units", "choose the units of reports, tables and figures"),
    Entry("Sampled", "measured_by", "with_sensor_units", "the controller with noise and resolution as numbers"),
    # parts, friction laws and controllers
    Entry("Axis", "offset", "force_offset", "constant force against positive motion"),
    Entry("Joint", "offset", "torque_offset", "constant torque against positive motion"),
    Entry("Axis Joint", "load_share", "load_sensitivity", "growth of friction for each unit of load"),
    Entry("Axis Joint", "loaded", "has_load", "whether there is a load that adds to friction"),
    Entry("Axis Joint", "filtered", "has_speed_filter", "whether the recorder filters the speed"),
    Entry("Axis Joint", "prefix", "signal_prefix", "first word of the signal names"),
    Entry("Axis Joint", "contact", "contact_name", "name of the contact"),
    Entry("Axis Joint", "body", "body_field", "field with the mass or inertia"),
    Entry("Axis Joint", "place", "position_name", "last word of the signal of the position"),
    Entry("Axis Joint", "force", "force_name", "last word of the signal of the force"),
    Entry("BrakeMPC", "speed_size", "speed_scale", "deviation of the speed that counts as one"),
    Entry("BrakeMPC", "angle_size", "angle_scale", "deviation of the angle that counts as one"),
    Entry("BrakeMPC", "move_size", "force_step_scale", "change of the force in a period that counts as one"),
    Entry("BrakeSlidingMode", "surface", "surface_gain", "weight of the integral in the sliding surface"),
    Entry("BrakeSlidingMode", "reaching", "reaching_rate", "rate at which the surface is reached"),
    Entry("BrakeSlidingMode", "width", "boundary_layer", "distance from the surface below which the switching is linear"),
    Entry("BrakeForce BrakePI BrakeSlidingMode BrakeMPC", "growth", "border_growth", "growth of the border of groan with the disc speed"),
    Entry("RationalStribeck", "rise", "quadratic_rise", "rise of friction with the square of the slip speed"),
    Entry("Dankowicz", "reach", "presliding_displacement", "largest deflection of the bristles"),
    Entry("DiscBrake", "other_friction", "second_pad_friction", "friction law of the second pad"),
    Entry("DiskStack", "clamped", "static_positions", "axial positions at rest under a force"),
    Entry("DragBit", "geometry", "bit_geometry_number", "bit geometry number gamma"),
    Entry("DragBit", "inclination", "cutter_inclination", "ratio zeta of axial to tangential cutting force"),
    Entry("DragBit", "engagement", "engagement_depth", "depth of cut from which the wear flats carry in full"),
    Entry("DragBit", "prescribed", "has_prescribed_speed", "whether the rotation speed is an input"),
    Entry("ElasticBody", "entries", "dof_map", "row of the displacement of every node along every axis"),
    Entry("ElasticBody", "on", "face_nodes", "numbers of the nodes of a face"),
    Entry("ElasticBody", "row_areas", "node_row_areas", "areas of the rows of nodes of a face"),
    Entry("ElasticBody", "rows", "node_row_ports", "ports of the rows of nodes of a face"),
    Entry("ElasticFace", "stiffness", "support_stiffness", "stiffness of the spring at the support port"),
    Entry("ElasticFace", "damping", "support_damping", "damping at the support port"),
    Entry("ElasticPad", "pressed", "steady_sliding_displacement", "displacement at steady sliding"),
    Entry("FlowLine", "gel_load", "gel_pressure", "pressure by which the gel law of every segment is multiplied"),
    Entry("GearNetwork", "driven", "input_node", "node that controllers drive"),
    Entry("HInfinity", "matrix_indices", "nonzero_indices", "indices of the entries of the matrix that are not zero"),
    Entry("HystereticBitRock SmoothHystereticBitRock", "beta0", "hysteresis_fraction", "half distance of the branches as a fraction of the torque"),
    Entry("HystereticBitRock SmoothHystereticBitRock", "beta1", "hysteresis_steepness", "steepness of the change between the branches"),
    Entry("SmoothBitRock SmoothHystereticBitRock", "b0", "torque_per_weight", "torque per weight at high speed"),
    Entry("SmoothBitRock SmoothHystereticBitRock", "b1", "zero_speed_steepness", "steepness at zero speed"),
    Entry("SmoothBitRock SmoothHystereticBitRock", "b2", "peak_height", "height of the peak of the torque"),
    Entry("SmoothBitRock SmoothHystereticBitRock", "b3", "peak_narrowness", "narrowness of the peak of the torque"),
    Entry("NonlinearMPC", "steps", "integration_steps", "integration steps in a period"),
    Entry("PhasedDither", "size", "speed_scale", "deviation of the speed at which the depth is reached"),
    Entry("RateAndState", "floor", "regularisation_speed", "slip speed below which friction is viscous"),
    Entry("ReducedBody", "moved", "controllable_body", "the body without modes that no port can move"),
    Entry("Section", "mass", "mass_per_length", "mass per length as it hangs"),
    Entry("Section", "inertia", "inertia_per_length", "inertia per length"),
    Entry("Section", "rigidity", "torsional_rigidity", "torsional rigidity G J"),
    Entry("ToolJoint", "part", "length_fraction", "length of the joint as a fraction of the distance of joints"),
    Entry("TorqueDrag", "moves", "is_moving", "whether the whole string moves"),
    Entry("TorqueDrag", "sliding", "is_sliding", "whether the string slides, at every depth"),
    Entry("TorqueDrag", "neutral", "neutral_point", "depth below which the string is in compression"),
    Entry("TorsionalChain", "lumped", "mode_summary", "number of inertias and first torsional modes, in words"),
    Entry("WhirlingCollar", "drag", "quadratic_drag", "drag of the mud per speed squared"),
    Entry("WhirlingCollar", "radius", "outer_radius", "outer radius of the collar"),
    Entry("WhirlingCollar", "mass", "modal_mass", "modal mass with the mud"),
    # runs
    Entry("Trajectory", "ambiguous", "ambiguous_events", "events at which other modes were consistent"),
    Entry("Trajectory", "anchors", "restart_nodes", "the run with nodes from which steps lead to every state between them"),
    Entry("Trajectory", "approach", "impact_speeds", "speeds of approach at impacts"),
    Entry("Trajectory ContactRun", "error", "error_estimate", "largest relative difference of a state to a more accurate run"),
    Entry("Trajectory", "inside", "interpolated", "signals at times within recorded steps"),
    Entry("Trajectory", "limits", "signal_limits", "limits of signals that drives and controllers set"),
    Entry("Trajectory", "nodes", "every_step", "the run with every step recorded"),
    Entry("Trajectory", "point", "at_instant", "signals at one instant of a run in progress"),
    Entry("smoothed regularised SmoothSystem", "matched", "match_static_peak", "whether the peak of regularised friction is that of static friction"),
    # arguments of functions
    Entry("fit identify", "held", "zero_order_hold", "measured inputs that keep a value until the next sample"),
    Entry("identify", "keep", "accepted_flaws", "kinds of flaws of a log that are data"),
    Entry("identify", "known", "fixed", "numbers that are known and stay"),
    Entry("identify", "shifts", "delayed_signals", "signals that may have been written too late"),
    Entry("margins", "measured", "by_simulation", "whether margins are also found by simulation"),
    Entry("margins", "inertia", "inertia_parameter", "name of the inertia that simulations vary"),
    Entry("margins", "duration", "simulation_duration", "length of the simulations"),
    Entry("onset hopf_points uncertain_onset", "values", "num_values", "number of values of the parameter"),
    Entry("dither_map", "offset", "other_load", "part of the load that another input gives"),
    # groups of plants and protocols of the lowest set-point
    Entry("group", "declared", "nominal", "plant with its nominal values"),
    Entry("group", "real", "noisy", "noise, and 10 % more weight"),
    Entry("group", "robust", "one_at_a_time", "one deviation on each plant"),
    Entry("group", "corners", "combined", "three deviations at once"),
    Entry("group", "rocks", "other_rocks", "other friction laws of the rock"),
    Entry("group", "weight", "varying_weight", "weight on bit that varies in time"),
    Entry("protocol", "direct", "takeover", "the controller takes over, and the set-point stays"),
    Entry("protocol", "raised", "ramp", "the set-point is raised, and ramps down after the takeover"),
    Entry("SetPointLimit", "margin_declared", "disk_margin_nominal", "disk margin of the nominal plant"),
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
    Entry("stickslip-fit stickslip-identify", "--held", "--zero-order-hold", "measured input that keeps a value until the next sample"),
    Entry("stickslip-estimate stickslip-fit stickslip-identify stickslip-posterior", "--keep", "--accept-flaw", "kind of flaw of a log that is data"),
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
    """Return a function that refuses the former names of its arguments with the names now.

    Parameters
    ----------
    function
        Function whose renamed arguments have entries in the vocabulary, under the name of the function.

    Returns
    -------
    function
        The function, with this check before each call.

    Examples
    --------
    >>> from toolbox.authoring import new_names_only
    >>> @new_names_only
    ... def hopf_curve(second_parameter):
    ...     return 2 * second_parameter
    >>> hopf_curve(second_parameter=3)
    6
    >>> hopf_curve(over=3)
    Traceback (most recent call last):
    toolbox.errors.SceneError: Argument `over` of `hopf_curve` is now `second_parameter`.
    """

    @functools.wraps(function)
    def checked(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Found:
        refuse_former_names(function.__name__, kwargs)
        return function(*args, **kwargs)

    return checked


def new_field(kind: type | str, word: str) -> str:
    """Return the name now of a field of a class, or of the class with this name; the same word if it was never renamed."""
    names = [kind] if isinstance(kind, str) else [each.__name__ for each in kind.__mro__]
    return next((NOW[name, word] for name in names if (name, word) in NOW), word)


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
