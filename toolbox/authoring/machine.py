"""Functions as machine code."""

from toolbox.compilation.notices import announced as announced
from toolbox.translation.compiled import Compiled as Compiled
