"""Steady states, linearisation, poles, Hopf points, impedance."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
