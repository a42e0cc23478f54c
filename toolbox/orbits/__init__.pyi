from .branch import Bifurcation as Bifurcation
from .branch import Branch as Branch
from .orbit import Cycle as Cycle
from .orbit import CycleError as CycleError
from .sensitivity import Sensitivity as Sensitivity
