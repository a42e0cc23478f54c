"""Variational equations, sensitivities, limit cycles and their branches."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.orbits.branch import Bifurcation as Bifurcation
    from toolbox.orbits.branch import Branch as Branch
    from toolbox.orbits.orbit import Cycle as Cycle
    from toolbox.orbits.orbit import CycleError as CycleError
    from toolbox.orbits.sensitivity import Sensitivity as Sensitivity

__getattr__, __dir__ = face()
