"""The language of stick and slip: compose a plant, simulate it, measure it."""

from toolbox.closed_loop import Controller, Sampled
from toolbox.compose import compose
from toolbox.elements import DryFriction, FrictionLaw, Relay, quantity, state, time
from toolbox.errors import BudgetError, SceneError, SimulationError, ZenoError
from toolbox.hybrid import HybridSystem
from toolbox.inputs import ramp, sine, step, sweep
from toolbox.parts import Component, Equations, Update
from toolbox.simulate import simulate

__all__ = [
    "BudgetError",
    "Component",
    "Controller",
    "DryFriction",
    "Equations",
    "FrictionLaw",
    "HybridSystem",
    "Relay",
    "Sampled",
    "SceneError",
    "SimulationError",
    "Update",
    "ZenoError",
    "compose",
    "quantity",
    "ramp",
    "simulate",
    "sine",
    "state",
    "step",
    "sweep",
    "time",
]
