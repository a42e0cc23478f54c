"""Control laws, one per file, and observers."""

from toolbox.authoring import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
