"""Physics: one mechanism per file, parameters with units and sources."""

from models import closed_forms, oscillators, wells
from models.bar import OscillatorOnBar
from models.belt import Absorber, Block, BlockOnBelt, BlocksOnBelt
from models.bristles import Dahl, Dankowicz, LuGre
from models.damper import FrictionDamper
from models.disc_brake import DiscBrake
from models.disks import TwoDisks
from models.dither import averaged_friction
from models.drill_string import BitRock, TorsionalChain
from models.flow_line import FlowLine, OutletRCR
from models.friction import Coulomb, CubicStribeck, Exponential, Hyperbolic
from models.gears import GearNetwork
from models.hand_arm import HandArm
from models.squeal import SquealingPad
from models.top_drive import TopDrive

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
    "FlowLine",
    "FrictionDamper",
    "GearNetwork",
    "HandArm",
    "Hyperbolic",
    "LuGre",
    "OscillatorOnBar",
    "OutletRCR",
    "SquealingPad",
    "TopDrive",
    "TorsionalChain",
    "TwoDisks",
    "averaged_friction",
    "closed_forms",
    "oscillators",
    "wells",
]
