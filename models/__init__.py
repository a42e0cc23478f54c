"""Physics: one mechanism per file, parameters with units and sources."""

from models import wells
from models.bar import OscillatorOnBar
from models.belt import BlockOnBelt
from models.disks import TwoDisks
from models.drill_string import BitRock, TorsionalChain
from models.flow_line import FlowLine, OutletRCR
from models.friction import Coulomb, CubicStribeck, Exponential, Hyperbolic
from models.gears import GearNetwork
from models.hand_arm import HandArm
from models.top_drive import TopDrive

__all__ = [
    "BitRock",
    "BlockOnBelt",
    "Coulomb",
    "CubicStribeck",
    "Exponential",
    "FlowLine",
    "GearNetwork",
    "HandArm",
    "Hyperbolic",
    "OscillatorOnBar",
    "OutletRCR",
    "TopDrive",
    "TorsionalChain",
    "TwoDisks",
    "wells",
]
