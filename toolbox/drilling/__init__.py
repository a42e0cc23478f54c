"""Questions about a drill string: set-points, groups of machines, windows and gains over depth, and estimates of the bit."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
