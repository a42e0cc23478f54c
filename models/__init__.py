"""Physics: one mechanism per file, parameters with units and sources."""

from models import closed_forms, oscillators, wells
from models.axial import AxialChain
from models.bar import OscillatorOnBar
from models.belt import Absorber, Block, BlockOnBelt, BlocksOnBelt
from models.bit_rock import BitRock
from models.bristle_contact import BristleContact, parabolic_shares
from models.bristles import Dahl, Dankowicz, LuGre
from models.damper import FrictionDamper
from models.disc_brake import DiscBrake
from models.disk_stack import DiskStack
from models.disks import PressedDisks, TwoDisks, uniform_pressure_radius, uniform_wear_radius
from models.dither import averaged_friction, tangential_dither
from models.drag_bit import DragBit
from models.drill_string import TorsionalChain
from models.elastic.body import ElasticBody
from models.elastic.meshes import block_mesh, body_of_mesh
from models.elastic.pad import ElasticPad
from models.elastic.reduction import ReducedBody
from models.elastic.slider import ElasticSlider
from models.elastic_rock import ElasticRock
from models.flow_line import FlowLine, OutletRCR
from models.friction import Coulomb, CubicStribeck, Drop, Exponential, GaussianStribeck, Hyperbolic, RationalStribeck, Tabulated, Transition
from models.gears import GearNetwork
from models.hand_arm import HandArm
from models.hysteretic_bit_rock import HystereticBitRock, SmoothHystereticBitRock
from models.lateral import WhirlingCollar, whirl_ratio
from models.sections import Section, read_sections
from models.shaft import shaft_frequencies
from models.sliders import InclinedSlider, PlateContact, Slider
from models.smooth_bit_rock import SmoothBitRock
from models.squeal import SquealingPad
from models.string_on_wall import sliding_resultant, string_on_wall
from models.survey import Survey, read_survey
from models.tabulated_string import DrillString
from models.top_drive import TopDrive
from models.torsional_pendulum import TorsionalPendulum

__all__ = [
    "Absorber",
    "AxialChain",
    "BitRock",
    "Block",
    "BlockOnBelt",
    "BlocksOnBelt",
    "BristleContact",
    "Coulomb",
    "CubicStribeck",
    "Dahl",
    "Dankowicz",
    "DiscBrake",
    "DiskStack",
    "DragBit",
    "DrillString",
    "Drop",
    "ElasticBody",
    "ElasticPad",
    "ElasticRock",
    "ElasticSlider",
    "Exponential",
    "FlowLine",
    "FrictionDamper",
    "GaussianStribeck",
    "GearNetwork",
    "HandArm",
    "Hyperbolic",
    "HystereticBitRock",
    "InclinedSlider",
    "LuGre",
    "OscillatorOnBar",
    "OutletRCR",
    "PlateContact",
    "PressedDisks",
    "RationalStribeck",
    "ReducedBody",
    "Section",
    "Slider",
    "SmoothBitRock",
    "SmoothHystereticBitRock",
    "SquealingPad",
    "Survey",
    "Tabulated",
    "TopDrive",
    "TorsionalChain",
    "TorsionalPendulum",
    "Transition",
    "TwoDisks",
    "WhirlingCollar",
    "averaged_friction",
    "block_mesh",
    "body_of_mesh",
    "closed_forms",
    "oscillators",
    "parabolic_shares",
    "read_sections",
    "read_survey",
    "shaft_frequencies",
    "sliding_resultant",
    "string_on_wall",
    "tangential_dither",
    "uniform_pressure_radius",
    "uniform_wear_radius",
    "wells",
    "whirl_ratio",
]
