"""Numerical methods."""

from toolbox.halving import halved as halved
from toolbox.measuring.sticks import stands as stands
from toolbox.simulation.samples import window as window
from toolbox.steady_states.linear_loop import zero_order_hold as zero_order_hold
