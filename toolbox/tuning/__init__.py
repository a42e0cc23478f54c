"""Numbers of a law that do best, at one machine or over the depth of a well."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
