"""Parts, laws, and the hybrid system that they make."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
