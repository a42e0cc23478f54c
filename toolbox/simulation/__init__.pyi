from .methods import EventExact as EventExact
from .methods import Explicit as Explicit
from .methods import Implicit as Implicit
from .methods import Smoothing as Smoothing
from .methods import TaylorSeries as TaylorSeries
from .methods import TimeStepping as TimeStepping
from .samples import Event as Event
