"""Physics: one mechanism per file, parameters with units and sources."""

from typing import TYPE_CHECKING

from toolbox.authoring import face

if TYPE_CHECKING:
    from models import closed_forms as closed_forms
    from models import oscillators as oscillators
    from models import wells as wells
    from models.axial import AxialChain as AxialChain
    from models.backlash import BacklashDrive as BacklashDrive
    from models.bar import OscillatorOnBar as OscillatorOnBar
    from models.belt import Absorber as Absorber
    from models.belt import Block as Block
    from models.belt import BlockOnBelt as BlockOnBelt
    from models.belt import BlocksOnBelt as BlocksOnBelt
    from models.belt import Guide as Guide
    from models.bit_rock import BitRock as BitRock
    from models.bristle_contact import BristleContact as BristleContact
    from models.bristle_contact import parabolic_shares as parabolic_shares
    from models.bristles import Dahl as Dahl
    from models.bristles import Dankowicz as Dankowicz
    from models.bristles import LuGre as LuGre
    from models.cranks import CrankSlider as CrankSlider
    from models.cranks import ScotchYoke as ScotchYoke
    from models.damper import FrictionDamper as FrictionDamper
    from models.disc_brake import DiscBrake as DiscBrake
    from models.disk_stack import DiskStack as DiskStack
    from models.disks import PressedDisks as PressedDisks
    from models.disks import TwoDisks as TwoDisks
    from models.disks import uniform_pressure_radius as uniform_pressure_radius
    from models.disks import uniform_wear_radius as uniform_wear_radius
    from models.dither import averaged_friction as averaged_friction
    from models.dither import tangential_dither as tangential_dither
    from models.drag_bit import DragBit as DragBit
    from models.drill_string import TorsionalChain as TorsionalChain
    from models.elastic.body import ElasticBody as ElasticBody
    from models.elastic.face import ElasticFace as ElasticFace
    from models.elastic.meshes import block_mesh as block_mesh
    from models.elastic.meshes import body_of_mesh as body_of_mesh
    from models.elastic.pad import ElasticPad as ElasticPad
    from models.elastic.reduced_body import ReducedBody as ReducedBody
    from models.elastic.slider import ElasticSlider as ElasticSlider
    from models.elastic_rock import ElasticRock as ElasticRock
    from models.flow_line import FlowLine as FlowLine
    from models.flow_line import OutletRCR as OutletRCR
    from models.friction import Coulomb as Coulomb
    from models.friction import CubicStribeck as CubicStribeck
    from models.friction import Drop as Drop
    from models.friction import Exponential as Exponential
    from models.friction import GaussianStribeck as GaussianStribeck
    from models.friction import Hyperbolic as Hyperbolic
    from models.friction import RationalStribeck as RationalStribeck
    from models.friction import Tabulated as Tabulated
    from models.friction import Transition as Transition
    from models.friction import TwoWay as TwoWay
    from models.friction import Viscous as Viscous
    from models.gear_stage import GearStage as GearStage
    from models.gears import GearNetwork as GearNetwork
    from models.hand_arm import HandArm as HandArm
    from models.hysteretic_bit_rock import HystereticBitRock as HystereticBitRock
    from models.hysteretic_bit_rock import SmoothHystereticBitRock as SmoothHystereticBitRock
    from models.lateral import WhirlingCollar as WhirlingCollar
    from models.lateral import whirl_ratio as whirl_ratio
    from models.overrunning_drive import OverrunningDrive as OverrunningDrive
    from models.pipe_sizes import inner_diameter as inner_diameter
    from models.rate_and_state import RateAndState as RateAndState
    from models.sections import Section as Section
    from models.sections import ToolJoint as ToolJoint
    from models.sections import read_sections as read_sections
    from models.shaft import shaft_frequencies as shaft_frequencies
    from models.shoe_brake import ShoeBrake as ShoeBrake
    from models.sliders import InclinedSlider as InclinedSlider
    from models.sliders import PlateContact as PlateContact
    from models.sliders import Slider as Slider
    from models.smooth_bit_rock import SmoothBitRock as SmoothBitRock
    from models.squeal import SquealingPad as SquealingPad
    from models.survey import Survey as Survey
    from models.survey import read_survey as read_survey
    from models.tabulated_string import DrillString as DrillString
    from models.top_drive import TopDrive as TopDrive
    from models.torque_and_drag import TorqueDrag as TorqueDrag
    from models.torque_and_drag import torque_drag as torque_drag
    from models.torsional_pendulum import TorsionalPendulum as TorsionalPendulum
    from models.valve_spool import ValveSpool as ValveSpool
    from models.wall_friction import StringOnWall as StringOnWall
    from models.wall_friction import WallContact as WallContact
    from models.wall_friction import sliding_resultant as sliding_resultant
    from models.wall_friction import string_on_wall as string_on_wall

__getattr__, __dir__ = face()
