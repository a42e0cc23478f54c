"""Reports: results, and folders of results, on one page that needs nothing else."""

from toolbox.faces import face

__getattr__, __dir__, __all__ = face(__name__, __file__)
