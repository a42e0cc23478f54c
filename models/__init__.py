"""Physics: one mechanism per file, parameters with units and sources."""

from models import wells
from models.belt import BlockOnBelt
from models.disks import TwoDisks
from models.drill_string import BitRock, TorsionalChain
from models.friction import Coulomb, CubicStribeck, Exponential, Hyperbolic, Transition
from models.sections import Section, read_sections
from models.shaft import shaft_frequencies
from models.survey import Survey, read_survey
from models.tabulated_string import DrillString

__all__ = [
    "BitRock",
    "BlockOnBelt",
    "Coulomb",
    "CubicStribeck",
    "DrillString",
    "Exponential",
    "Hyperbolic",
    "Section",
    "Survey",
    "TorsionalChain",
    "Transition",
    "TwoDisks",
    "read_sections",
    "read_survey",
    "shaft_frequencies",
    "wells",
]
