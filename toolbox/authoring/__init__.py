"""What authors of parts, laws and packages of their own build on, beside the names of `toolbox` itself.

Everything here is public: it changes only with a line in the changelog. `models` and `controllers` import nothing else of the toolbox. The files group the
names by subject; `from toolbox.authoring import number` imports only the file that has it.
"""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
