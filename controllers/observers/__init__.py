"""Observers of a drill string: speed and torque of the bit, and the friction of the rock, from what is measured at the surface."""

from toolbox.authoring import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
