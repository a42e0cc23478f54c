"""Physics: one mechanism per file, parameters with units and sources."""

from models import wells
from models.axial import AxialChain
from models.belt import BlockOnBelt
from models.bit_rock import BitRock
from models.disks import TwoDisks
from models.drag_bit import DragBit
from models.drill_string import TorsionalChain
from models.elastic_rock import ElasticRock
from models.friction import Coulomb, CubicStribeck, Exponential, Hyperbolic
from models.hysteretic_bit_rock import HystereticBitRock, SmoothHystereticBitRock
from models.smooth_bit_rock import SmoothBitRock
from models.torsional_pendulum import TorsionalPendulum

__all__ = [
    "AxialChain",
    "BitRock",
    "BlockOnBelt",
    "Coulomb",
    "CubicStribeck",
    "DragBit",
    "ElasticRock",
    "Exponential",
    "Hyperbolic",
    "HystereticBitRock",
    "SmoothBitRock",
    "SmoothHystereticBitRock",
    "TorsionalChain",
    "TorsionalPendulum",
    "TwoDisks",
    "wells",
]
