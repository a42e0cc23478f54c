"""The language of stick and slip: compose a plant, simulate it, measure it."""

import sys
from importlib.util import LazyLoader, find_spec, module_from_spec
from types import ModuleType
from typing import TYPE_CHECKING

from toolbox.faces import face, warn_of_hidden


def _public_module(name: str, file: str) -> ModuleType:
    """A file of a room under a short name, as in `from toolbox.measure import severity`; it is executed when something of it is first asked for."""
    if file not in sys.modules:
        spec = find_spec(file)
        assert spec is not None and spec.loader is not None
        spec.loader = LazyLoader(spec.loader)
        sys.modules[file] = module_from_spec(spec)
        spec.loader.exec_module(sys.modules[file])
        room, _, own = file.rpartition(".")
        setattr(sys.modules[room], own, sys.modules[file])  # as an import does
    sys.modules[f"{__name__}.{name}"] = sys.modules[file]
    return sys.modules[file]


if TYPE_CHECKING:
    from toolbox import authoring as authoring
    from toolbox import errors as errors
    from toolbox.calibration.fit import fit as fit
    from toolbox.errors import SceneError as SceneError
    from toolbox.errors import SimulationError as SimulationError
    from toolbox.export.c_code import export_c as export_c
    from toolbox.export.c_code import to_control as to_control
    from toolbox.export.fmu import export_fmu as export_fmu
    from toolbox.export.from_control import from_control as from_control
    from toolbox.export.stepper import stepper as stepper
    from toolbox.files.unit_systems import units as units
    from toolbox.measuring import measure as measure
    from toolbox.measuring.energy import energy_audit as energy_audit
    from toolbox.modelling import inputs as inputs
    from toolbox.modelling.closed_loop import ClosedLoop as ClosedLoop
    from toolbox.modelling.closed_loop import closed_loop as closed_loop
    from toolbox.modelling.components import Component as Component
    from toolbox.modelling.components import Equations as Equations
    from toolbox.modelling.components import Update as Update
    from toolbox.modelling.composition import compose as compose
    from toolbox.modelling.elements import DryFriction as DryFriction
    from toolbox.modelling.elements import FrictionLaw as FrictionLaw
    from toolbox.modelling.elements import Quantity as Quantity
    from toolbox.modelling.elements import quantity as quantity
    from toolbox.modelling.elements import state as state
    from toolbox.modelling.elements import time as time
    from toolbox.modelling.hybrid_system import HybridSystem as HybridSystem
    from toolbox.modelling.laws import Controller as Controller
    from toolbox.modelling.laws import Sampled as Sampled
    from toolbox.modelling.one_way_clutch import OneWayClutch as OneWayClutch
    from toolbox.modelling.unilateral_contact import UnilateralContact as UnilateralContact
    from toolbox.onsets.onset import onset as onset
    from toolbox.onsets.severity_map import severity_map as severity_map
    from toolbox.orbits.continuation import follow as follow
    from toolbox.orbits.limit_cycle import limit_cycle as limit_cycle
    from toolbox.orbits.sensitivity import sensitivity as sensitivity
    from toolbox.robustness.lowest_set_point import lowest_set_point as lowest_set_point
    from toolbox.robustness.margins import margins as margins
    from toolbox.robustness.worst_case import worst_case as worst_case
    from toolbox.scenes.differences import compare as compare
    from toolbox.scenes.scene import Scene as Scene
    from toolbox.scenes.work_precision import work_precision as work_precision
    from toolbox.simulation import plot as plot
    from toolbox.simulation.budget import Budget as Budget
    from toolbox.simulation.simulate import simulate as simulate
    from toolbox.simulation.trajectory import Trajectory as Trajectory
    from toolbox.steady_states.equilibria import equilibria as equilibria
    from toolbox.steady_states.hopf import hopf_curve as hopf_curve
    from toolbox.steady_states.hopf import hopf_points as hopf_points
    from toolbox.steady_states.impedance import impedance as impedance
    from toolbox.steady_states.linear import equilibrium as equilibrium
    from toolbox.steady_states.linear import linearise as linearise
    from toolbox.sweeps.sweep import sweep as sweep
    from toolbox.tuning.tune import tune as tune
else:  # `measure.pyi`, `inputs.pyi` and `plot.pyi` say the same to mypy and editors
    measure = _public_module("measure", "toolbox.measuring.measure")
    inputs = _public_module("inputs", "toolbox.modelling.inputs")
    plot = _public_module("plot", "toolbox.simulation.plot")

warn_of_hidden("controllers", "models")

__getattr__, __dir__ = face("time")  # a star import must not hide the module `time`
