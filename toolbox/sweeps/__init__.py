"""Runs by the thousand."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.sweeps.designs import Variations as Variations
    from toolbox.sweeps.designs import grid as grid
    from toolbox.sweeps.designs import latin_hypercube as latin_hypercube
    from toolbox.sweeps.designs import listed as listed
    from toolbox.sweeps.designs import sobol as sobol
    from toolbox.sweeps.designs import uniform as uniform
    from toolbox.sweeps.results import Sweep as Sweep

__getattr__, __dir__ = face()
