"""The language of stick and slip: compose a plant, simulate it, measure it."""

import sys
from importlib.util import LazyLoader, find_spec, module_from_spec
from types import ModuleType

from toolbox.calibration.fit import Fit, fit
from toolbox.calibration.recording import Recording
from toolbox.errors import AccuracyError, BudgetError, GrazingError, SceneError, SimulationError, ZenoError
from toolbox.export.c_code import export_c, to_control
from toolbox.export.fmu import export_fmu
from toolbox.measuring import measure as measure
from toolbox.measuring.measure import cycles, energy_audit, overshoot, settling, severity, stick_intervals
from toolbox.modelling import inputs as inputs
from toolbox.modelling.components import Component, Equations, Update
from toolbox.modelling.composition import compose
from toolbox.modelling.elements import DryFriction, FrictionLaw, Hysteresis, Relay, UnilateralContact, quantity, state
from toolbox.modelling.elements import time as time  # not in __all__: a star import must not shadow the module `time`
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.inputs import ramp, sine, square, step, triangle
from toolbox.modelling.laws import Controller, Sampled, Takeover
from toolbox.modelling.observers import Observed, Observer
from toolbox.modelling.regularisation import smoothed
from toolbox.onsets.onset import onset
from toolbox.onsets.severity_map import SeverityMap, severity_map
from toolbox.orbits.branch import Bifurcation, Branch
from toolbox.orbits.continuation import follow
from toolbox.orbits.limit_cycle import Cycle, CycleError, limit_cycle
from toolbox.orbits.sensitivity import Sensitivity, sensitivity
from toolbox.robustness.absorber import absorber_limit
from toolbox.robustness.limits import performance_limit
from toolbox.robustness.margins import Margins, margins
from toolbox.robustness.worst_case import WorstCase, cycle_phases, worst_case
from toolbox.scenes.scene import Scene
from toolbox.scenes.work_precision import WorkPrecision, work_precision
from toolbox.simulation.methods import Automatic, EventExact, Explicit, Implicit, Smoothing, TimeStepping
from toolbox.simulation.run import Budget
from toolbox.simulation.samples import Event
from toolbox.simulation.simulate import simulate
from toolbox.simulation.trajectory import Trajectory
from toolbox.steady_states import linear as linear
from toolbox.steady_states.equilibria import equilibria
from toolbox.steady_states.hopf import hopf_curve, hopf_points
from toolbox.steady_states.impedance import impedance, reflection
from toolbox.steady_states.linear import equilibrium, linearise
from toolbox.steady_states.poles import pole_locus
from toolbox.sweeps.sweep import Sweep, sweep
from toolbox.tuning.results import Tuned
from toolbox.tuning.tune import tune

__all__ = [
    "AccuracyError",
    "Automatic",
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
    "EventExact",
    "Explicit",
    "Fit",
    "FrictionLaw",
    "GrazingError",
    "HybridSystem",
    "Hysteresis",
    "Implicit",
    "Margins",
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
    "Smoothing",
    "Sweep",
    "Takeover",
    "TimeStepping",
    "Trajectory",
    "Tuned",
    "UnilateralContact",
    "Update",
    "WorkPrecision",
    "WorstCase",
    "ZenoError",
    "absorber_limit",
    "compose",
    "cycle_phases",
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
    "margins",
    "onset",
    "overshoot",
    "performance_limit",
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
    "worst_case",
]


def _lazy(name: str) -> ModuleType:
    """A module that is executed when something of it is first asked for: `plot` needs matplotlib, which few runs do."""
    spec = find_spec(name)
    assert spec is not None and spec.loader is not None
    spec.loader = LazyLoader(spec.loader)
    module = sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


plot = _lazy("toolbox.simulation.plot")

# the public modules have short names: `from toolbox.measure import severity` finds the one that stands in its room
for _name, _module in {"inputs": inputs, "linear": linear, "measure": measure, "plot": plot}.items():
    sys.modules[f"{__name__}.{_name}"] = _module
