"""Observers of a drill string: speed and torque of the bit, and the friction of the rock, from what is measured at the surface."""

from typing import TYPE_CHECKING

from toolbox.authoring import face

if TYPE_CHECKING:
    from controllers.moving_horizon import MovingHorizon as MovingHorizon
    from controllers.observers.ensemble import Ensemble as Ensemble
    from controllers.observers.linear import DisturbanceObserver as DisturbanceObserver
    from controllers.observers.linear import Kalman as Kalman
    from controllers.observers.sliding import SlidingObserver as SlidingObserver

__getattr__, __dir__ = face()
