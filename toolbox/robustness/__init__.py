"""How far a closed loop is from failing: margins at steady running, the best that any law can have, and the worst case of the machine itself."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
