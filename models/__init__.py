"""Physics: one mechanism per file, parameters with units and sources."""

from models import wells
from models.belt import BlockOnBelt
from models.bit_rock import BitRock
from models.disks import TwoDisks
from models.drill_string import TorsionalChain
from models.friction import Coulomb, CubicStribeck, Exponential, Hyperbolic
from models.hysteretic_bit_rock import HystereticBitRock, SmoothHystereticBitRock
from models.smooth_bit_rock import SmoothBitRock

__all__ = [
    "BitRock",
    "BlockOnBelt",
    "Coulomb",
    "CubicStribeck",
    "Exponential",
    "Hyperbolic",
    "HystereticBitRock",
    "SmoothBitRock",
    "SmoothHystereticBitRock",
    "TorsionalChain",
    "TwoDisks",
    "wells",
]
