"""Physics: one mechanism per file, parameters with units and sources."""

from models import oscillators, wells
from models.belt import Absorber, Block, BlockOnBelt, BlocksOnBelt
from models.bristles import Dahl, Dankowicz, LuGre
from models.damper import FrictionDamper
from models.disc_brake import DiscBrake
from models.disks import TwoDisks
from models.dither import averaged_friction
from models.drill_string import BitRock, TorsionalChain
from models.friction import Coulomb, CubicStribeck, Exponential, Hyperbolic
from models.squeal import SquealingPad

__all__ = [
    "Absorber",
    "BitRock",
    "Block",
    "BlockOnBelt",
    "BlocksOnBelt",
    "Coulomb",
    "CubicStribeck",
    "Dahl",
    "Dankowicz",
    "DiscBrake",
    "Exponential",
    "FrictionDamper",
    "Hyperbolic",
    "LuGre",
    "SquealingPad",
    "TorsionalChain",
    "TwoDisks",
    "averaged_friction",
    "oscillators",
    "wells",
]
