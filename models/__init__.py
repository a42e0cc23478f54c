"""Physics: one mechanism per file, parameters with units and sources."""

from models import oscillators, wells
from models.axial import AxialChain
from models.bar import OscillatorOnBar
from models.belt import Absorber, Block, BlockOnBelt, BlocksOnBelt
from models.bit_rock import BitRock
from models.bristles import Dahl, Dankowicz, LuGre
from models.damper import FrictionDamper
from models.disc_brake import DiscBrake
from models.disks import TwoDisks
from models.dither import averaged_friction
from models.drag_bit import DragBit
from models.drill_string import TorsionalChain
from models.elastic_rock import ElasticRock
from models.flow_line import FlowLine, OutletRCR
from models.friction import Coulomb, CubicStribeck, Exponential, Hyperbolic
from models.gears import GearNetwork
from models.hand_arm import HandArm
from models.hysteretic_bit_rock import HystereticBitRock, SmoothHystereticBitRock
from models.smooth_bit_rock import SmoothBitRock
from models.squeal import SquealingPad
from models.top_drive import TopDrive
from models.torsional_pendulum import TorsionalPendulum

__all__ = [
    "Absorber",
    "AxialChain",
    "BitRock",
    "Block",
    "BlockOnBelt",
    "BlocksOnBelt",
    "Coulomb",
    "CubicStribeck",
    "Dahl",
    "Dankowicz",
    "DiscBrake",
    "DragBit",
    "ElasticRock",
    "Exponential",
    "FlowLine",
    "FrictionDamper",
    "GearNetwork",
    "HandArm",
    "Hyperbolic",
    "HystereticBitRock",
    "LuGre",
    "OscillatorOnBar",
    "OutletRCR",
    "SmoothBitRock",
    "SmoothHystereticBitRock",
    "SquealingPad",
    "TopDrive",
    "TorsionalChain",
    "TorsionalPendulum",
    "TwoDisks",
    "averaged_friction",
    "oscillators",
    "wells",
]
