from .ensemble import Ensemble as Ensemble
from .linear import DisturbanceObserver as DisturbanceObserver
from .linear import Kalman as Kalman
from .moving_horizon import MovingHorizon as MovingHorizon
from .sliding import SlidingObserver as SlidingObserver
