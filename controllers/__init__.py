"""Control laws, one per file, and observers."""

from typing import TYPE_CHECKING

from toolbox.authoring import face

if TYPE_CHECKING:
    from controllers import observers as observers
    from controllers.active_damping import ActiveDamping as ActiveDamping
    from controllers.brake_force import BrakeForce as BrakeForce
    from controllers.brake_mpc import BrakeMPC as BrakeMPC
    from controllers.brake_pi import BrakePI as BrakePI
    from controllers.brake_sliding_mode import BrakeSlidingMode as BrakeSlidingMode
    from controllers.dither import NormalDither as NormalDither
    from controllers.dither import PhasedDither as PhasedDither
    from controllers.dither import SquareDither as SquareDither
    from controllers.dither import SweptDither as SweptDither
    from controllers.dither import dither_map as dither_map
    from controllers.h_infinity import HInfinity as HInfinity
    from controllers.held_speed import HeldSpeed as HeldSpeed
    from controllers.implicit_sliding_mode import ImplicitSlidingMode as ImplicitSlidingMode
    from controllers.lifting import Lifting as Lifting
    from controllers.linear_mpc import LinearMPC as LinearMPC
    from controllers.lqg import LQG as LQG
    from controllers.lqr import LQR as LQR
    from controllers.nonlinear_mpc import NonlinearMPC as NonlinearMPC
    from controllers.on_estimates import OnEstimates as OnEstimates
    from controllers.pi import PI as PI
    from controllers.pi import StiffPI as StiffPI
    from controllers.pipe import pipe_impedance as pipe_impedance
    from controllers.sliding_mode import IdealSlidingMode as IdealSlidingMode
    from controllers.sliding_mode import SlidingMode as SlidingMode
    from controllers.soft_torque import SoftTorque as SoftTorque
    from controllers.super_twisting import ImpedanceSuperTwisting as ImpedanceSuperTwisting
    from controllers.super_twisting import SuperTwisting as SuperTwisting
    from controllers.z_torque import ZTorque as ZTorque

__getattr__, __dir__ = face()
