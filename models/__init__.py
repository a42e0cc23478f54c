"""Physics: one mechanism per file, parameters with units and sources."""

from models import wells
from models.belt import BlockOnBelt
from models.disks import TwoDisks
from models.drill_string import BitRock, TorsionalChain
from models.friction import Coulomb, CubicStribeck, Exponential, Hyperbolic
from models.lateral import WhirlingCollar, whirl_ratio

__all__ = [
    "BitRock",
    "BlockOnBelt",
    "Coulomb",
    "CubicStribeck",
    "Exponential",
    "Hyperbolic",
    "TorsionalChain",
    "TwoDisks",
    "WhirlingCollar",
    "wells",
    "whirl_ratio",
]
