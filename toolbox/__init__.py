"""The language of stick and slip: compose a plant, simulate it, measure it."""

import sys
from importlib.util import LazyLoader, find_spec, module_from_spec
from types import ModuleType

from toolbox.faces import face, warn_of_hidden


def _public_module(name: str, file: str) -> ModuleType:
    """A file of a room under a short name, as in `from toolbox.measure import severity`; it is executed when something of it is first asked for."""
    if file not in sys.modules:
        spec = find_spec(file)
        assert spec is not None and spec.loader is not None
        spec.loader = LazyLoader(spec.loader)
        sys.modules[file] = module_from_spec(spec)
        spec.loader.exec_module(sys.modules[file])
        room, _, own = file.rpartition(".")
        setattr(sys.modules[room], own, sys.modules[file])  # as an import does
    sys.modules[f"{__name__}.{name}"] = sys.modules[file]
    return sys.modules[file]


# `measure.pyi`, `inputs.pyi` and `plot.pyi` say the same to mypy and editors
measure = _public_module("measure", "toolbox.measuring.measure")
inputs = _public_module("inputs", "toolbox.modelling.inputs")
plot = _public_module("plot", "toolbox.simulation.plot")

warn_of_hidden("controllers", "models")

__getattr__, __dir__, __all__ = face(__name__, __file__)
for _name in ("time", "__version__"):  # a star import must not hide the module `time`
    __all__.remove(_name)
