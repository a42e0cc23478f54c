"""The looks and the curves that all pictures share, spectrograms and films."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
