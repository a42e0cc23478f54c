"""Runs: what is asked, how it is carried out, the result."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.simulation.methods import EventExact as EventExact
    from toolbox.simulation.methods import Explicit as Explicit
    from toolbox.simulation.methods import Implicit as Implicit
    from toolbox.simulation.methods import Smoothing as Smoothing
    from toolbox.simulation.methods import TaylorSeries as TaylorSeries
    from toolbox.simulation.methods import TimeStepping as TimeStepping
    from toolbox.simulation.samples import Event as Event

__getattr__, __dir__ = face()
