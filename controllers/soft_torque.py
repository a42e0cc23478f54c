"""Soft torque: a PI drive whose impedance matches the string, so that torsional waves are absorbed at the top."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from controllers.pi import PI
from controllers.torque_limits import TorqueLimits
from toolbox import Quantity, SceneError, quantity


@dataclass(frozen=True)
class SoftTorque(TorqueLimits):
    """Soft torque: PI control whose impedance matches a lumped string: proportional = sqrt(k J_b), integral = (k / J_b) J_r.

    k is the stiffness of all springs in series, J_b the inertia below the top drive, and J_r the inertia of the top
    drive. `design` reads them from `chain.inertia` and `chain.stiffness` of the plant and returns a `PI` with these
    gains.

    Both gains are divided by `detuning`, by default 1.

    Sources: J. D. Jansen, L. van den Steen, J. Sound Vib. 179 (1995) 647-668, and U. J. F. Aarsnes, F. Di Meglio, R. J.
    Shor, J. Sound Vib. 424 (2018) (matching condition, for lumped strings).

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      SoftTorque, continuous: proportional 420.6 N m s/rad, integral 2684 N m/rad, reference 60 rpm
    """

    reference: Quantity = quantity(8.0, "rad/s", "set-point of the top-drive speed", typical_range=(0.05, 40.0))
    detuning: Quantity = quantity(1.0, "1", "factor by which the gains are divided", above=0)

    @staticmethod
    def for_string(string_impedance: float, inertia: float, frequency: float, reference: float = 8.0, **limits: Any) -> PI:
        """Return the PI controller for a distributed string: proportional = 4 zeta, integral = (2 pi f)^2 J.

        At the frequency f the integral term cancels the inertia of the drive. The impedance of the drive at f is
        therefore 4 zeta, and the drive reflects the fraction |r| = 3/5 of a wave. At all other frequencies it reflects
        a larger fraction.

        Source: U. J. F. Aarsnes, F. Di Meglio, R. J. Shor, J. Sound Vib. 424 (2018).

        Parameters
        ----------
        string_impedance
            Wave impedance zeta of the pipe [N m s/rad], which `pipe_impedance` computes.
        inertia
            Inertia J of the drive [kg m2].
        frequency
            Lowest natural frequency f of the string [Hz].
        reference
            Set-point [rad/s], by default 8.
        limits
            Torque limits and other fields of `PI` as keyword arguments.

        Returns
        -------
        PI
            The controller.
        """
        return PI(proportional=4.0 * string_impedance, integral=(2.0 * np.pi * frequency) ** 2 * inertia, reference=reference, **limits)

    def design(self, plant):
        try:
            inertia, stiffness = plant.parameter("chain.inertia"), plant.parameter("chain.stiffness")
        except SceneError as error:
            raise SceneError(f"SoftTorque is designed on a chain of inertias: {error}") from None
        below = float(np.sum(inertia[1:]))
        series = 1.0 / float(np.sum(1.0 / stiffness))
        return PI(
            proportional=float(np.sqrt(series * below)) / self.detuning,
            integral=series / below * float(inertia[0]) / self.detuning,
            reference=self.reference,
            **self.limits,
        )
