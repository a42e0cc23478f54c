from .designs import Variations as Variations
from .designs import grid as grid
from .designs import latin_hypercube as latin_hypercube
from .designs import listed as listed
from .designs import sobol as sobol
from .designs import uniform as uniform
from .results import Sweep as Sweep
