from .impedance import reflection as reflection
from .poles import pole_locus as pole_locus
from .shapes import ModeShapes as ModeShapes
from .shapes import mode_shapes as mode_shapes
