"""The language of stick and slip: compose a plant, simulate it, measure it."""

from toolbox.branch import Bifurcation, Branch
from toolbox.closed_loop import Controller, Sampled, Takeover
from toolbox.compose import compose
from toolbox.continuation import follow
from toolbox.cycle import Cycle, CycleError, limit_cycle
from toolbox.elements import DryFriction, FrictionLaw, Hysteresis, Relay, UnilateralContact, quantity, state
from toolbox.elements import time as time  # not in __all__: a star import must not shadow the module `time`
from toolbox.errors import AccuracyError, BudgetError, GrazingError, SceneError, SimulationError, ZenoError
from toolbox.export import export_c, to_control
from toolbox.fit import Fit, fit
from toolbox.fmu import export_fmu
from toolbox.hopf import hopf_curve, hopf_points
from toolbox.hybrid import HybridSystem
from toolbox.impedance import impedance, reflection
from toolbox.inputs import ramp, sine, square, step, triangle
from toolbox.linear import equilibrium, linearise
from toolbox.measure import cycles, energy_audit, overshoot, settling, severity, stick_intervals
from toolbox.observed import Observed, Observer
from toolbox.onset import onset
from toolbox.parts import Component, Equations, Update
from toolbox.recording import Recording
from toolbox.scene import Scene
from toolbox.sensitivity import Sensitivity, sensitivity
from toolbox.severity_map import SeverityMap, severity_map
from toolbox.simulate import Budget, simulate
from toolbox.smoothed import smoothed
from toolbox.stability import pole_locus
from toolbox.steady_states import equilibria
from toolbox.sweep import Sweep, sweep
from toolbox.trajectory import Event, Trajectory
from toolbox.tune import tune
from toolbox.tuned import Tuned
from toolbox.work_precision import WorkPrecision, work_precision

__all__ = [
    "AccuracyError",
    "Bifurcation",
    "Branch",
    "Budget",
    "BudgetError",
    "Component",
    "Controller",
    "Cycle",
    "CycleError",
    "DryFriction",
    "Equations",
    "Event",
    "Fit",
    "FrictionLaw",
    "GrazingError",
    "HybridSystem",
    "Hysteresis",
    "Observed",
    "Observer",
    "Recording",
    "Relay",
    "Sampled",
    "Scene",
    "SceneError",
    "Sensitivity",
    "SeverityMap",
    "SimulationError",
    "Sweep",
    "Takeover",
    "Trajectory",
    "Tuned",
    "UnilateralContact",
    "Update",
    "WorkPrecision",
    "ZenoError",
    "compose",
    "cycles",
    "energy_audit",
    "equilibria",
    "equilibrium",
    "export_c",
    "export_fmu",
    "fit",
    "follow",
    "hopf_curve",
    "hopf_points",
    "impedance",
    "limit_cycle",
    "linearise",
    "onset",
    "overshoot",
    "pole_locus",
    "quantity",
    "ramp",
    "reflection",
    "sensitivity",
    "settling",
    "severity",
    "severity_map",
    "simulate",
    "sine",
    "smoothed",
    "square",
    "state",
    "step",
    "stick_intervals",
    "sweep",
    "to_control",
    "triangle",
    "tune",
    "work_precision",
]
