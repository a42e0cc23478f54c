"""Chances in place of verdicts: numbers that are known as distributions, and what a machine then does, with bounds."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
