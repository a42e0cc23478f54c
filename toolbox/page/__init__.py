"""A local page that simulates a closed loop while its numbers are turned: traces, verdict, poles and the map around the working point."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
