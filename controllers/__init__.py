"""Control laws, one per file. Drill string laws drive `top.torque` [N m] and measure `top.speed` [rad/s] unless they say otherwise."""

from controllers.linear_mpc import LinearMPC
from controllers.nonlinear_mpc import NonlinearMPC
from controllers.pi import PI, StiffPI
from controllers.sliding_mode import IdealSlidingMode, SlidingMode
from controllers.soft_torque import SoftTorque

__all__ = ["PI", "IdealSlidingMode", "LinearMPC", "NonlinearMPC", "SlidingMode", "SoftTorque", "StiffPI"]
