"""The language of stick and slip: compose a plant, simulate it, measure it."""

import sys
from importlib.util import LazyLoader, find_spec, module_from_spec
from types import ModuleType
from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.calibration.fit import fit as fit
    from toolbox.calibration.recording import Recording as Recording
    from toolbox.calibration.results import Fit as Fit
    from toolbox.contacts.contact_run import ContactRun as ContactRun
    from toolbox.contacts.problem import ContactBody as ContactBody
    from toolbox.contacts.problem import ContactProblem as ContactProblem
    from toolbox.contacts.stepping import press_contacts as press_contacts
    from toolbox.contacts.stepping import step_contacts as step_contacts
    from toolbox.errors import AccuracyError as AccuracyError
    from toolbox.errors import BudgetError as BudgetError
    from toolbox.errors import GrazingError as GrazingError
    from toolbox.errors import SceneError as SceneError
    from toolbox.errors import SimulationError as SimulationError
    from toolbox.errors import UnusualValue as UnusualValue
    from toolbox.errors import ZenoError as ZenoError
    from toolbox.export.c_code import export_c as export_c
    from toolbox.export.c_code import to_control as to_control
    from toolbox.export.fmu import export_fmu as export_fmu
    from toolbox.export.from_control import from_control as from_control
    from toolbox.files.unit_systems import units as units
    from toolbox.measuring.energy import energy_audit as energy_audit
    from toolbox.measuring.measure import cycles as cycles
    from toolbox.measuring.measure import overshoot as overshoot
    from toolbox.measuring.measure import settling as settling
    from toolbox.measuring.measure import severity as severity
    from toolbox.measuring.measure import stick_intervals as stick_intervals
    from toolbox.modelling.closed_loop import ClosedLoop as ClosedLoop
    from toolbox.modelling.closed_loop import closed_loop as closed_loop
    from toolbox.modelling.components import Component as Component
    from toolbox.modelling.components import Equations as Equations
    from toolbox.modelling.components import Update as Update
    from toolbox.modelling.composition import compose as compose
    from toolbox.modelling.elements import DryFriction as DryFriction  # not in __all__: a star import must not shadow the module `time`
    from toolbox.modelling.elements import FrictionLaw as FrictionLaw
    from toolbox.modelling.elements import Hysteresis as Hysteresis
    from toolbox.modelling.elements import OptionalQuantities as OptionalQuantities
    from toolbox.modelling.elements import OptionalQuantity as OptionalQuantity
    from toolbox.modelling.elements import Quantities as Quantities
    from toolbox.modelling.elements import Quantity as Quantity
    from toolbox.modelling.elements import Relay as Relay
    from toolbox.modelling.elements import UnilateralContact as UnilateralContact
    from toolbox.modelling.elements import quantity as quantity
    from toolbox.modelling.elements import state as state
    from toolbox.modelling.elements import time as time
    from toolbox.modelling.hybrid_system import HybridSystem as HybridSystem
    from toolbox.modelling.inputs import ramp as ramp
    from toolbox.modelling.inputs import sine as sine
    from toolbox.modelling.inputs import square as square
    from toolbox.modelling.inputs import step as step
    from toolbox.modelling.inputs import triangle as triangle
    from toolbox.modelling.laws import Controller as Controller
    from toolbox.modelling.laws import Sampled as Sampled
    from toolbox.modelling.laws import Takeover as Takeover
    from toolbox.modelling.observers import Observed as Observed
    from toolbox.modelling.observers import Observer as Observer
    from toolbox.modelling.regularisation import smoothed as smoothed
    from toolbox.onsets.onset import onset as onset
    from toolbox.onsets.severity_map import SeverityMap as SeverityMap
    from toolbox.onsets.severity_map import severity_map as severity_map
    from toolbox.orbits.branch import Bifurcation as Bifurcation
    from toolbox.orbits.branch import Branch as Branch
    from toolbox.orbits.continuation import follow as follow
    from toolbox.orbits.limit_cycle import limit_cycle as limit_cycle
    from toolbox.orbits.orbit import Cycle as Cycle
    from toolbox.orbits.orbit import CycleError as CycleError
    from toolbox.orbits.sensitivity import Sensitivity as Sensitivity
    from toolbox.orbits.sensitivity import sensitivity as sensitivity
    from toolbox.robustness.absorber import absorber_limit as absorber_limit
    from toolbox.robustness.limits import performance_limit as performance_limit
    from toolbox.robustness.margins import Margins as Margins
    from toolbox.robustness.margins import margins as margins
    from toolbox.robustness.worst_case import WorstCase as WorstCase
    from toolbox.robustness.worst_case import cycle_phases as cycle_phases
    from toolbox.robustness.worst_case import worst_case as worst_case
    from toolbox.scenes.contact_scene import ContactScene as ContactScene
    from toolbox.scenes.differences import Differences as Differences
    from toolbox.scenes.differences import compare as compare
    from toolbox.scenes.scene import Scene as Scene
    from toolbox.scenes.work_precision import WorkPrecision as WorkPrecision
    from toolbox.scenes.work_precision import work_precision as work_precision
    from toolbox.simulation.methods import Automatic as Automatic
    from toolbox.simulation.methods import EventExact as EventExact
    from toolbox.simulation.methods import Explicit as Explicit
    from toolbox.simulation.methods import Implicit as Implicit
    from toolbox.simulation.methods import Smoothing as Smoothing
    from toolbox.simulation.methods import TaylorSeries as TaylorSeries
    from toolbox.simulation.methods import TimeStepping as TimeStepping
    from toolbox.simulation.run import Budget as Budget
    from toolbox.simulation.samples import Event as Event
    from toolbox.simulation.simulate import simulate as simulate
    from toolbox.simulation.trajectory import Trajectory as Trajectory
    from toolbox.steady_states.equilibria import equilibria as equilibria
    from toolbox.steady_states.hopf import hopf_curve as hopf_curve
    from toolbox.steady_states.hopf import hopf_points as hopf_points
    from toolbox.steady_states.impedance import impedance as impedance
    from toolbox.steady_states.impedance import reflection as reflection
    from toolbox.steady_states.linear import equilibrium as equilibrium
    from toolbox.steady_states.linear import linearise as linearise
    from toolbox.steady_states.poles import pole_locus as pole_locus
    from toolbox.sweeps.sweep import Sweep as Sweep
    from toolbox.sweeps.sweep import sweep as sweep
    from toolbox.tuning.results import Tuned as Tuned
    from toolbox.tuning.tune import tune as tune

__all__ = [
    "AccuracyError",
    "Automatic",
    "Bifurcation",
    "Branch",
    "Budget",
    "BudgetError",
    "ClosedLoop",
    "Component",
    "ContactBody",
    "ContactProblem",
    "ContactRun",
    "ContactScene",
    "Controller",
    "Cycle",
    "CycleError",
    "Differences",
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
    "OptionalQuantities",
    "OptionalQuantity",
    "Quantities",
    "Quantity",
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
    "TaylorSeries",
    "TimeStepping",
    "Trajectory",
    "Tuned",
    "UnilateralContact",
    "UnusualValue",
    "Update",
    "WorkPrecision",
    "WorstCase",
    "ZenoError",
    "absorber_limit",
    "closed_loop",
    "compare",
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
    "from_control",
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
    "press_contacts",
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
    "step_contacts",
    "stick_intervals",
    "sweep",
    "to_control",
    "triangle",
    "tune",
    "units",
    "work_precision",
    "worst_case",
]

_ROOMS = {
    "toolbox.calibration.fit": "fit",
    "toolbox.calibration.recording": "Recording",
    "toolbox.calibration.results": "Fit",
    "toolbox.contacts.contact_run": "ContactRun",
    "toolbox.contacts.problem": "ContactBody, ContactProblem",
    "toolbox.contacts.stepping": "press_contacts, step_contacts",
    "toolbox.errors": "AccuracyError, BudgetError, GrazingError, SceneError, SimulationError, UnusualValue, ZenoError",
    "toolbox.export.c_code": "export_c, to_control",
    "toolbox.export.from_control": "from_control",
    "toolbox.export.fmu": "export_fmu",
    "toolbox.files.unit_systems": "units",
    "toolbox.measuring.energy": "energy_audit",
    "toolbox.measuring.measure": "cycles, overshoot, settling, severity, stick_intervals",
    "toolbox.modelling.components": "Component, Equations, Update",
    "toolbox.modelling.closed_loop": "ClosedLoop, closed_loop",
    "toolbox.modelling.composition": "compose",
    "toolbox.modelling.elements": "DryFriction, FrictionLaw, Hysteresis, OptionalQuantities, OptionalQuantity, Quantities, Quantity, "
    "Relay, UnilateralContact, quantity, state, time",
    "toolbox.modelling.hybrid_system": "HybridSystem",
    "toolbox.modelling.inputs": "ramp, sine, square, step, triangle",
    "toolbox.modelling.laws": "Controller, Sampled, Takeover",
    "toolbox.modelling.observers": "Observed, Observer",
    "toolbox.modelling.regularisation": "smoothed",
    "toolbox.onsets.onset": "onset",
    "toolbox.onsets.severity_map": "SeverityMap, severity_map",
    "toolbox.orbits.branch": "Bifurcation, Branch",
    "toolbox.orbits.continuation": "follow",
    "toolbox.orbits.limit_cycle": "limit_cycle",
    "toolbox.orbits.orbit": "Cycle, CycleError",
    "toolbox.orbits.sensitivity": "Sensitivity, sensitivity",
    "toolbox.robustness.absorber": "absorber_limit",
    "toolbox.robustness.limits": "performance_limit",
    "toolbox.robustness.margins": "Margins, margins",
    "toolbox.robustness.worst_case": "WorstCase, cycle_phases, worst_case",
    "toolbox.scenes.differences": "Differences, compare",
    "toolbox.scenes.contact_scene": "ContactScene",
    "toolbox.scenes.scene": "Scene",
    "toolbox.scenes.work_precision": "WorkPrecision, work_precision",
    "toolbox.simulation.methods": "Automatic, EventExact, Explicit, Implicit, Smoothing, TaylorSeries, TimeStepping",
    "toolbox.simulation.run": "Budget",
    "toolbox.simulation.samples": "Event",
    "toolbox.simulation.simulate": "simulate",
    "toolbox.simulation.trajectory": "Trajectory",
    "toolbox.steady_states.equilibria": "equilibria",
    "toolbox.steady_states.hopf": "hopf_curve, hopf_points",
    "toolbox.steady_states.impedance": "impedance, reflection",
    "toolbox.steady_states.linear": "equilibrium, linearise",
    "toolbox.steady_states.poles": "pole_locus",
    "toolbox.sweeps.sweep": "Sweep, sweep",
    "toolbox.tuning.results": "Tuned",
    "toolbox.tuning.tune": "tune",
}
"""{file: what is imported from it, when it is first asked for}: a script pays for what it uses."""

__getattr__, __dir__ = face(globals(), _ROOMS)


def _lazy(name: str) -> ModuleType:
    """A module that is executed when something of it is first asked for."""
    if name in sys.modules:
        return sys.modules[name]
    spec = find_spec(name)
    assert spec is not None and spec.loader is not None
    spec.loader = LazyLoader(spec.loader)
    module = sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# the public modules have short names: `from toolbox.measure import severity` finds the one that stands in its room
if TYPE_CHECKING:
    from toolbox.measuring import measure as measure
    from toolbox.modelling import inputs as inputs
    from toolbox.simulation import plot as plot
    from toolbox.steady_states import linear as linear
else:
    inputs = sys.modules[f"{__name__}.inputs"] = _lazy("toolbox.modelling.inputs")
    linear = sys.modules[f"{__name__}.linear"] = _lazy("toolbox.steady_states.linear")
    measure = sys.modules[f"{__name__}.measure"] = _lazy("toolbox.measuring.measure")
    plot = sys.modules[f"{__name__}.plot"] = _lazy("toolbox.simulation.plot")
