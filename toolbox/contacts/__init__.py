"""Contacts by the hundred on linear bodies: opening, stick and slip in two directions, by time stepping."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
