"""Steady states, linearisation, poles, Hopf points, impedance."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.steady_states.impedance import reflection as reflection
    from toolbox.steady_states.poles import pole_locus as pole_locus
    from toolbox.steady_states.shapes import ModeShapes as ModeShapes
    from toolbox.steady_states.shapes import mode_shapes as mode_shapes

__getattr__, __dir__ = face()
