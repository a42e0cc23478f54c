"""Control laws, one per file, and observers."""

from controllers import observers
from controllers.active_damping import ActiveDamping
from controllers.brake_force import BrakeForce
from controllers.brake_mpc import BrakeMPC
from controllers.brake_pi import BrakePI
from controllers.brake_sliding_mode import BrakeSlidingMode
from controllers.dither import NormalDither, PhasedDither, SquareDither, SweptDither, dither_map
from controllers.h_infinity import HInfinity
from controllers.implicit_sliding_mode import ImplicitSlidingMode
from controllers.lifting import Lifting
from controllers.linear_mpc import LinearMPC
from controllers.lqg import LQG
from controllers.lqr import LQR
from controllers.nonlinear_mpc import NonlinearMPC
from controllers.on_estimates import OnEstimates
from controllers.pi import PI, StiffPI
from controllers.pipe import pipe_impedance
from controllers.sliding_mode import IdealSlidingMode, SlidingMode
from controllers.soft_torque import SoftTorque
from controllers.super_twisting import ImpedanceSuperTwisting, SuperTwisting
from controllers.z_torque import ZTorque

__all__ = [
    "LQG",
    "LQR",
    "PI",
    "ActiveDamping",
    "BrakeForce",
    "BrakeMPC",
    "BrakePI",
    "BrakeSlidingMode",
    "HInfinity",
    "IdealSlidingMode",
    "ImpedanceSuperTwisting",
    "ImplicitSlidingMode",
    "Lifting",
    "LinearMPC",
    "NonlinearMPC",
    "NormalDither",
    "OnEstimates",
    "PhasedDither",
    "SlidingMode",
    "SoftTorque",
    "SquareDither",
    "StiffPI",
    "SuperTwisting",
    "SweptDither",
    "ZTorque",
    "dither_map",
    "observers",
    "pipe_impedance",
]
