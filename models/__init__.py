"""Physics: one mechanism per file, parameters with units and sources."""

from toolbox.authoring import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
