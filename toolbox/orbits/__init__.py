"""Variational equations, sensitivities, limit cycles and their branches."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
