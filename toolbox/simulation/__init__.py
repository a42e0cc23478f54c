"""Runs: what is asked, how it is carried out, the result."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
