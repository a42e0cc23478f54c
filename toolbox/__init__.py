"""The language of stick and slip: compose a plant, simulate it, measure it."""

from toolbox.closed_loop import Controller, Sampled
from toolbox.compose import compose
from toolbox.elements import DryFriction, FrictionLaw, Hysteresis, Relay, UnilateralContact, quantity, state, time
from toolbox.errors import BudgetError, SceneError, SimulationError, ZenoError
from toolbox.hybrid import HybridSystem
from toolbox.impedance import impedance, reflection
from toolbox.inputs import ramp, sine, step
from toolbox.linear import equilibrium, linearise
from toolbox.measure import energy_audit, overshoot, settling, severity, stick_intervals
from toolbox.onset import onset
from toolbox.parts import Component, Equations, Update
from toolbox.scene import Scene
from toolbox.simulate import simulate
from toolbox.stability import equilibria, hopf_curve, hopf_points, pole_locus
from toolbox.trajectory import Event, Trajectory

__all__ = [
    "BudgetError",
    "Component",
    "Controller",
    "DryFriction",
    "Equations",
    "Event",
    "FrictionLaw",
    "HybridSystem",
    "Hysteresis",
    "Relay",
    "Sampled",
    "Scene",
    "SceneError",
    "SimulationError",
    "Trajectory",
    "UnilateralContact",
    "Update",
    "ZenoError",
    "compose",
    "energy_audit",
    "equilibria",
    "equilibrium",
    "hopf_curve",
    "hopf_points",
    "impedance",
    "linearise",
    "onset",
    "overshoot",
    "pole_locus",
    "quantity",
    "ramp",
    "reflection",
    "settling",
    "severity",
    "simulate",
    "sine",
    "state",
    "step",
    "stick_intervals",
    "time",
]
