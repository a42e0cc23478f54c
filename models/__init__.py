"""Physics: one mechanism per file, parameters with units and sources."""

from models import wells
from models.belt import BlockOnBelt
from models.disk_stack import DiskStack
from models.disks import TwoDisks, uniform_pressure_radius, uniform_wear_radius
from models.drill_string import BitRock, TorsionalChain
from models.friction import Coulomb, CubicStribeck, Exponential, Hyperbolic

__all__ = [
    "BitRock",
    "BlockOnBelt",
    "Coulomb",
    "CubicStribeck",
    "DiskStack",
    "Exponential",
    "Hyperbolic",
    "TorsionalChain",
    "TwoDisks",
    "uniform_pressure_radius",
    "uniform_wear_radius",
    "wells",
]
