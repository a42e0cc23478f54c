"""Physics: one mechanism per file, parameters with units and sources."""

from models import wells
from models.belt import BlockOnBelt
from models.disks import TwoDisks
from models.drill_string import BitRock, TorsionalChain
from models.friction import Coulomb, CubicStribeck, Exponential, Hyperbolic
from models.gears import GearNetwork
from models.top_drive import TopDrive

__all__ = [
    "BitRock",
    "BlockOnBelt",
    "Coulomb",
    "CubicStribeck",
    "Exponential",
    "GearNetwork",
    "Hyperbolic",
    "TopDrive",
    "TorsionalChain",
    "TwoDisks",
    "wells",
]
