"""Observers of a drill string: speed and torque of the bit, and the friction of the rock, from what is measured at the surface."""

from controllers.moving_horizon import MovingHorizon
from controllers.observers.linear import DisturbanceObserver, Kalman
from controllers.observers.sliding import SlidingObserver

__all__ = ["DisturbanceObserver", "Kalman", "MovingHorizon", "SlidingObserver"]
