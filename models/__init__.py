"""Physics: one mechanism per file, parameters with units and sources."""

from models import wells
from models.belt import BlockOnBelt
from models.bristle_contact import BristleContact, parabolic_shares
from models.disk_stack import DiskStack
from models.disks import PressedDisks, TwoDisks, uniform_pressure_radius, uniform_wear_radius
from models.drill_string import BitRock, TorsionalChain
from models.friction import Coulomb, CubicStribeck, Exponential, Hyperbolic
from models.sliders import InclinedSlider, PlateContact, Slider

__all__ = [
    "BitRock",
    "BlockOnBelt",
    "BristleContact",
    "Coulomb",
    "CubicStribeck",
    "DiskStack",
    "Exponential",
    "Hyperbolic",
    "InclinedSlider",
    "PlateContact",
    "PressedDisks",
    "Slider",
    "TorsionalChain",
    "TwoDisks",
    "parabolic_shares",
    "uniform_pressure_radius",
    "uniform_wear_radius",
    "wells",
]
