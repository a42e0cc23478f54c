"""The language of stick and slip: compose a plant, simulate it, measure it."""

from toolbox.compose import Component, Equations, HybridSystem, compose
from toolbox.elements import DryFriction, FrictionLaw, Relay, quantity, state, time
from toolbox.errors import BudgetError, SceneError, SimulationError, ZenoError
from toolbox.simulate import simulate

__all__ = [
    "BudgetError",
    "Component",
    "DryFriction",
    "Equations",
    "FrictionLaw",
    "HybridSystem",
    "Relay",
    "SceneError",
    "SimulationError",
    "ZenoError",
    "compose",
    "quantity",
    "simulate",
    "state",
    "time",
]
